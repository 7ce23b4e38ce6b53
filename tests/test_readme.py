"""The example of the README prints what the README says, and its commands are those of CI."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import jaxbeam as jb

from tests.helpers import USERS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def _blocks(language: str) -> str:
    """All blocks of a language, one after the other."""
    return "".join(re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL))


def _numbers(text: str) -> list[float]:
    return [float(n) for n in re.findall(r"-?\d+\.\d+", text)]


def test_example_prints_what_is_printed():
    program = _blocks("python")
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True,
        env=USERS,
    )  # fmt: skip
    stated, printed = _blocks("text").splitlines(), done.stdout.splitlines()
    assert len(stated) == len(printed) == 7
    for i, (claim, line) in enumerate(zip(stated, printed, strict=True)):
        # adaptive steps of the simulation, in lines five and six, may differ between machines
        tolerance = 1e-5 if i in (4, 5) else 1e-8
        np.testing.assert_allclose(_numbers(line), _numbers(claim), rtol=tolerance)
        assert ("True" in line) == ("True" in claim)


@pytest.mark.slow
def test_longer_examples_print_what_is_printed(tmp_path):
    program = _blocks("python") + _blocks("py")
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=300, check=True,
        env=USERS, cwd=tmp_path,
    )  # fmt: skip
    stated = _blocks("txt").splitlines()
    printed = done.stdout.splitlines()[-len(stated) :]
    for claim, line in zip(stated, printed, strict=True):
        assert re.sub(r"[\d.e-]+", "#", line).split() == re.sub(r"[\d.e-]+", "#", claim).split()
        np.testing.assert_allclose(_numbers(line), _numbers(claim), rtol=0.1)


def test_continuous_integration_runs_the_test_command():
    pattern = re.search("grep -m1 '(.*)' README.md", (ROOT / ".ci" / "run").read_text())[1]
    found = next(line for line in README.splitlines() if re.search(pattern, line))
    assert found == 'python -m pip install ".[test]" && python -m pytest'


def test_the_table_of_names_has_all_of_them():
    table = README.split("## What there is")[1].split("\n\n**To begin with**")[0]
    named = set(re.findall(r"`(\w+(?:\.\w+)*)`", table))
    subjects = {name for name in jb._ROOMS if jb._ROOMS[name] == "jaxbeam"}
    public = {name for name in jb._ROOMS if name not in subjects} | {"plot"}
    for subject in subjects - {"plot"}:
        names = vars(importlib.import_module(f"jaxbeam.{subject}"))
        public |= {f"{subject}.{name}" for name in names if not name.startswith("_")}
    assert public <= named
    assert len([name for name in public if "." not in name]) <= 40


def test_help_is_one_page_that_names_what_is_everyday():
    said = set(re.findall(r"\w+", jb.__doc__))
    assert {name for name, room in jb._ROOMS.items() if room != "jaxbeam"} - said == set()
    assert len(jb.__doc__.splitlines()) <= 40


def test_a_name_that_is_elsewhere_says_where():
    with pytest.raises(AttributeError, match="it is in jaxbeam.motions"):
        jb.QuinticSpinUp  # noqa: B018
    with pytest.raises(AttributeError, match="no attribute 'Quintic'$"):
        jb.Quintic  # noqa: B018


def test_pictures_exist():
    for path in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / path).is_file()
