"""The example of the README prints what the README says, and its commands are those of CI."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def _block(language: str) -> str:
    return re.search(rf"```{language}\n(.*?)```", README, re.DOTALL).group(1)


def _numbers(text: str) -> list[float]:
    return [float(n) for n in re.findall(r"-?\d+\.\d+", text)]


def test_example_prints_what_is_printed():
    program = _block("python")
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True
    )
    stated, printed = _block("text").splitlines(), done.stdout.splitlines()
    assert len(stated) == len(printed) == 4
    for claim, line in zip(stated, printed, strict=True):
        np.testing.assert_allclose(_numbers(line), _numbers(claim), rtol=1e-8)


def test_continuous_integration_runs_the_test_command():
    command = 'python -m pip install ".[test]" && python -m pytest'
    assert f"```sh\n{command}\n```" in README
    assert (
        command.split("python -m ", 1)[1]
        .replace("[", r"\[")
        .replace("]", r"\]")
        .replace(".", r"\.", 1)
        in (ROOT / ".ci" / "run").read_text()
    )


def test_pictures_exist():
    for path in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / path).is_file()
