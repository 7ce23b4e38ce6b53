"""The example of the README prints what the README says, and its commands are those of CI."""

import ast
import importlib
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

import jaxbeam as jb
from tests.helpers import run_optimised

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
INSIDE = (ROOT / "jaxbeam" / "README.md").read_text()


def _blocks(language: str) -> str:
    """All blocks of a language, one after the other."""
    return "".join(re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL))


def _numbers(text: str) -> list[float]:
    return [float(n) for n in re.findall(r"-?\d+\.\d+", text)]


@pytest.mark.release
@pytest.mark.exhaustive
def test_example_prints_what_is_printed():
    program = _blocks("python")
    said = run_optimised("-c", program)
    stated, printed = _blocks("text").splitlines(), said.splitlines()
    assert len(stated) == len(printed) == 7
    for i, (claim, line) in enumerate(zip(stated, printed, strict=True)):
        # adaptive steps of the simulation, in lines five and six, may differ between machines
        tolerance = 1e-5 if i in (4, 5) else 1e-8
        np.testing.assert_allclose(_numbers(line), _numbers(claim), rtol=tolerance)
        assert ("True" in line) == ("True" in claim)


@pytest.mark.exhaustive
def test_longer_examples_print_what_is_printed(tmp_path):
    program = _blocks("python") + _blocks("py")
    said = run_optimised("-c", program, cwd=tmp_path)
    stated = _blocks("txt").splitlines()
    printed = said.splitlines()[-len(stated) :]
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
        names = vars(importlib.import_module(f"jaxbeam.{subject}")).items()
        own = [n for n, value in names if n[0] != "_" and not inspect.ismodule(value)]
        public |= {f"{subject}.{name}" for name in own}
    assert public <= named
    assert len([name for name in public if "." not in name]) <= 40


def test_help_is_one_page_that_names_what_is_everyday():
    said = set(re.findall(r"\w+", jb.__doc__))
    assert {name for name, room in jb._ROOMS.items() if room != "jaxbeam"} - said == set()
    assert len(jb.__doc__.splitlines()) <= 40


def test_a_name_that_is_elsewhere_says_where():
    with pytest.raises(AttributeError, match=r"it is in jaxbeam\.motions"):
        jb.QuinticSpinUp  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'Quintic'$"):
        jb.Quintic  # noqa: B018


def test_the_index_of_equations_names_what_there_is():
    index = INSIDE.split("Where the equations of the papers are")[1].split("\n\n## ")[0]
    assert len(re.findall(r"^\| [YB] ", index, re.MULTILINE)) > 15
    package = ROOT / "jaxbeam"
    trees = [ast.walk(ast.parse(path.read_text())) for path in package.rglob("*.py")]
    nodes = [node for tree in trees for node in tree]
    defined = {n.name: n for n in nodes if isinstance(n, ast.ClassDef | ast.FunctionDef)}
    for name in re.findall(r"`([\w./]+)`", index):
        if name.endswith(".py"):
            assert (package / name).is_file(), name
        else:
            owner, *method = name.split(".")
            inside = {n.name for n in ast.walk(defined[owner]) if isinstance(n, ast.FunctionDef)}
            assert set(method) <= inside, name


def test_pictures_exist():
    for path in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / path).is_file()
