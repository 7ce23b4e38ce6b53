"""What is written for people to read: examples print what pages say, names and links are there.

Pages are README.md, the Markdown files of the folders, and the docstrings of public modules. The
blocks of code of a page run one after the other in one process. Blocks `python` print what blocks
`text` say, to the digits that any machine gives; blocks `py` what blocks `txt` say, to a tenth.
"""

import ast
import importlib
import inspect
import operator
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import jaxbeam as jb
from tests.helpers import run_optimised

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "jaxbeam"


def _pages() -> dict[str, str]:
    """Text by path."""
    folders = [ROOT, *(ROOT / name for name in ("docs", "jaxbeam", "studies", "tests"))]
    pages = {path: path.read_text() for folder in folders for path in sorted(folder.glob("*.md"))}
    for path in sorted(PACKAGE.glob("[!_]*.py")):
        pages[path] = ast.get_docstring(ast.parse(path.read_text()))
    return {path.relative_to(ROOT).as_posix(): page for path, page in pages.items()}


PAGES = _pages()
README = PAGES["README.md"]


def _blocks(page: str, *languages: str) -> list[tuple[str, str]]:
    """Language and text of the blocks in one of some languages, in their order."""
    found = re.findall(r"^```(\w+)\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    return [(language, text) for language, text in found if language in languages]


def _with_examples() -> list:
    """Names of pages; what is to be exact may differ between releases of JAX."""
    names = [name for name, page in PAGES.items() if _blocks(page, "python", "py")]
    exact = {name: _blocks(PAGES[name], "text") for name in names}
    return [pytest.param(n, marks=[pytest.mark.release] if exact[n] else []) for n in names]


def _numbers(text: str) -> list[float]:
    return [float(n) for n in re.findall(r"-?\d+\.\d+", text)]


def _words(text: str) -> list[str]:
    return re.sub(r"[\d.e-]+", "#", text).split()


def _tolerance(kind: str, claim: str) -> float:
    """Relative, of the numbers in a line. Answers of runs in time, whose adaptive steps may differ
    between machines, are those that are printed with six digits."""
    if kind == "txt":
        return 0.1
    digits = [len(n.replace(".", "").lstrip("0")) for n in re.findall(r"\d+\.\d+", claim)]
    return 1e-8 if max(digits) > 6 else 1e-5


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", _with_examples())
def test_examples_print_what_is_printed(name, tmp_path):
    page = PAGES[name]
    program = "\n".join(text for _, text in _blocks(page, "python", "py"))
    printed = run_optimised("-c", program, cwd=tmp_path).splitlines()
    outputs = _blocks(page, "text", "txt")
    stated = [(kind, line) for kind, text in outputs for line in text.splitlines()]
    assert len(printed) == len(stated) > 0
    for (kind, claim), line in zip(stated, printed, strict=True):
        assert _words(line) == _words(claim)
        tolerance = _tolerance(kind, claim)
        np.testing.assert_allclose(_numbers(line), _numbers(claim), rtol=tolerance)


@pytest.mark.exhaustive
def test_the_command_writes_what_its_page_says(tmp_path):
    page = PAGES["docs/command.md"]
    ((_, scene), (_, command)) = _blocks(page, "toml", "sh")
    (tmp_path / re.match(r"# (\w+\.toml):", scene)[1]).write_text(scene)
    python, *arguments = shlex.split(command)
    assert python == "python"
    run_optimised(*arguments, cwd=tmp_path)
    for name in re.findall(r"`(blade/[\w.]+)`", page):
        assert (tmp_path / name).stat().st_size > 1000
    found = jb.Table.load(tmp_path / "blade" / "frequencies.npz")
    count = int(re.search(r"of the (\d+) cases", page)[1])
    assert found["frequency"].shape == (21, 3, 3)
    assert found["status"].size == count
    assert not found["status"].any()


def test_the_readme_is_short():
    lines = README.splitlines()
    assert len(lines) <= 150
    assert max(map(len, lines)) <= 110
    first = "\n".join(lines[:45])
    assert 'pip install ".[test]"' in first  # all that a first look needs, output included
    assert len(re.findall("^```", first, re.MULTILINE)) == 6


def test_continuous_integration_runs_the_test_command():
    pattern = re.search("grep -m1 '(.*)' README.md", (ROOT / ".ci" / "run").read_text())[1]
    found = next(line for line in README.splitlines() if re.search(pattern, line))
    assert found == 'python -m pip install ".[test]" && python -m pytest'


def test_the_table_of_names_has_all_of_them():
    named = set(re.findall(r"`(\w+(?:\.\w+)*)`", PAGES["docs/names.md"]))
    subjects = {name for name in jb._ROOMS if jb._ROOMS[name] == "jaxbeam"}
    public = {name for name in jb._ROOMS if name not in subjects} | {"plot"}
    for subject in subjects - {"plot"}:
        names = vars(importlib.import_module(f"jaxbeam.{subject}")).items()
        own = [n for n, value in names if n[0] != "_" and not inspect.ismodule(value)]
        public |= {f"{subject}.{name}" for name in own}
    assert public <= named
    assert len([name for name in public if "." not in name]) <= 45


def test_help_is_one_page_that_names_what_is_everyday():
    said = set(re.findall(r"\w+", jb.__doc__))
    assert {name for name, room in jb._ROOMS.items() if room != "jaxbeam"} - said == set()
    assert len(jb.__doc__.splitlines()) <= 40


def test_a_name_that_is_elsewhere_says_where():
    with pytest.raises(AttributeError, match=r"it is in jaxbeam\.motions"):
        jb.QuinticSpinUp  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'Quintic'$"):
        jb.Quintic  # noqa: B018
    with pytest.raises(AttributeError, match=r"'jaxbeam\.models' has .* it is in jaxbeam$"):
        jb.models.Hybrid  # noqa: B018


def test_an_old_name_says_the_new_one():
    for name, now in jb._RENAMED.items():
        with pytest.raises(AttributeError, match=f"it is {re.escape(now)} now$"):
            getattr(jb, name)
        path = re.match(r"jaxbeam\.([\w.]+)", now)[1]
        assert operator.attrgetter(path)(jb) is not None


def test_the_index_of_equations_names_what_there_is():
    index = PAGES["jaxbeam/README.md"].split("Where the equations of the papers are")[1]
    index = index.split("\n\n## ")[0]
    assert len(re.findall(r"^\| [YB] ", index, re.MULTILINE)) > 15
    trees = [ast.walk(ast.parse(path.read_text())) for path in PACKAGE.rglob("*.py")]
    nodes = [node for tree in trees for node in tree]
    defined = {n.name: n for n in nodes if isinstance(n, ast.ClassDef | ast.FunctionDef)}
    for name in re.findall(r"`([\w./]+)`", index):
        if name.endswith(".py"):
            assert (PACKAGE / name).is_file(), name
        else:
            owner, *method = name.split(".")
            inside = {n.name for n in ast.walk(defined[owner]) if isinstance(n, ast.FunctionDef)}
            assert set(method) <= inside, name


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_somewhere(name):
    for link in re.findall(r"\]\(([^)]+)\)", PAGES[name]):
        path, _, heading = link.partition("#")
        target = (ROOT / name).parent.joinpath(path).resolve() if path else ROOT / name
        assert "://" in link or target.exists(), link
        if heading and "://" not in link:
            titles = re.findall(r"^#+ (.*)", target.read_text(), re.MULTILINE)
            assert heading in [re.sub(r"[^\w -]", "", t.lower()).replace(" ", "-") for t in titles]


def test_files_that_are_named_exist():
    """In pages and in the package: as `docs/loads.md`, from the root."""
    texts = [*PAGES.values(), *(path.read_text() for path in PACKAGE.rglob("*.py"))]
    pattern = r"(?<![\w/.])(?:docs|jaxbeam|studies|tests)/[\w/]+\.(?:md|py|png)"
    named = {path for text in texts for path in re.findall(pattern, text)}
    for path in named - {"studies/name.py"}:  # which stands for one that is yet to be written
        assert (ROOT / path).is_file(), path
