"""The page of the studies has a section for each, and what it links to is there."""

import re

import pytest

from tests.studies.common import STUDIES

PAGE = (STUDIES / "README.md").read_text()
SCRIPTS = sorted(path.stem for path in set(STUDIES.glob("*.py")) - {STUDIES / "common.py"})
SHORT = sorted(path.name for path in (STUDIES / "short").glob("*.py"))


def anchor(title):
    """What a heading is called in links."""
    return re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")


HEADINGS = re.findall(r"^#+ (.*)$", PAGE, re.MULTILINE)
LINKS = re.findall(r"\]\(([^)\s]+)\)", PAGE)


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_study_has_its_section_and_its_line_in_the_table(name):
    """The section says how it is called, and what was found or drawn."""
    _, *after = PAGE.split(f"\n### {name}\n")
    assert len(after) == 1
    section = " ".join(re.split(r"\n##+ ", after[0])[0].split())
    assert f"studies/{name}.py [--quick]`" in section
    assert len(re.findall(r"\d", section)) > 3
    assert PAGE.count(f"\n| [`{name}.py`](#{anchor(name)}) | ") == 1


def test_every_short_script_is_named():
    assert SHORT
    assert all(f"[`short/{name}`](short/{name})" in PAGE for name in SHORT)


def test_links_lead_somewhere():
    figures = {path.name for path in (STUDIES / "figures").iterdir()}
    linked = {link.removeprefix("figures/") for link in LINKS if link.startswith("figures/")}
    assert linked == figures  # no figure is kept that no page shows
    for link in LINKS:
        if link.startswith("#"):
            assert link[1:] in map(anchor, HEADINGS), link
        else:
            assert (STUDIES / link).exists(), link


def test_every_heading_below_a_chapter_is_a_study():
    sections = re.findall(r"^### (.*)$", PAGE, re.MULTILINE)
    assert sorted(sections) == SCRIPTS
