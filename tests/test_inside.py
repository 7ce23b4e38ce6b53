"""The page for whoever extends the package is true of the code: names, files, glossary."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "jaxbeam"
PAGE = (PACKAGE / "README.md").read_text()
LINES = PAGE.split("\n## Glossary\n")[1].strip().splitlines()
GLOSSARY = [line for line in LINES if line.startswith("- ")]
FILES = [*PACKAGE.rglob("*.py"), *(ROOT / "tests").rglob("*.py")]


def test_files_that_it_names_are_there():
    there = {path.relative_to(ROOT).as_posix() for path in FILES}
    there |= {path.relative_to(PACKAGE).as_posix() for path in FILES if PACKAGE in path.parents}
    there |= {path.name for path in FILES if PACKAGE in path.parents}
    for name in re.findall(r"`([\w/]+\.py)`", PAGE):
        assert name in there or (PACKAGE / name).is_file(), name
    for link in re.findall(r"\]\(([^)#\s]+)\)", PAGE):
        assert (PACKAGE / link).is_file(), link


def test_names_that_it_says_are_in_the_code():
    code = {word for path in FILES for word in re.findall(r"\w+", path.read_text())}
    code |= {part for path in FILES for part in path.relative_to(ROOT).with_suffix("").parts}
    for name in re.findall(r"`([A-Za-z_][\w.]*(?:\(\))?)`", PAGE):
        missing = set(re.findall(r"\w+", name.removesuffix(".py"))) - code
        assert not missing, name


def test_the_glossary_is_in_order_with_a_line_for_each_term():
    assert len(LINES) - 2 == len(GLOSSARY)  # a sentence is above, and no line is broken
    terms = [re.match(r"- \*\*([\w ]+)\*\*: [A-Z].*\.$", line)[1] for line in GLOSSARY]
    assert 50 <= len(terms) <= 80
    assert terms == sorted(set(terms), key=str.casefold)
    assert max(map(len, PAGE.splitlines())) <= 110
