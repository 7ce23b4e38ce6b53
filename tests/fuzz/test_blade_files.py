"""Files of blades that were mangled, or written in another way: numbers that are right, or a
`ValueError` that names the file and, unless all of it is wrong, the line."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxbeam import blades
from tests import tiers
from tests.fuzz.scenes import examples
from tests.rotor.files import CSV, DECK, ELASTODYN, SECTIONS, whole

FILES = {
    "main file": DECK.format(title="a blade"), "whole main file": whole(), "sections": SECTIONS,
    "elastodyn": ELASTODYN.format(title="a blade"), "csv": CSV, "tabs": CSV.replace(",", "\t"),
}  # fmt: skip
ODD = [
    "", " ", "\t", ",", ";", "/", "'", '"', "\n", "\r", "\0", "\ufeff", "\u00a0", "-", "--", "!",
    "#", "3*", "*", "1e999", "1e-999", "nan", "inf", "-1", "0", "0,5", "1D5", "1+5", "9" * 400,
    "1_0", "radius", "tip_mass", "BlFract", "n_secs", "sec_props_file", "x", "(deg)", "(kN)", "(-)",
    "\udc80",
]  # fmt: skip


@st.composite
def mangled(draw, text):
    """With a few pieces cut out, written over, doubled, or exchanged for what is odd."""
    for _ in range(draw(st.integers(1, 3))):
        words = re.split(r"(\s+|,)", text)
        at = draw(st.integers(0, len(words) - 1))
        kind = draw(st.sampled_from(["piece", "before", "rest", "line", "double", "byte"]))
        odd = draw(st.sampled_from(ODD))
        lines = text.split("\n")
        line = draw(st.integers(0, len(lines) - 1))
        if kind == "piece":
            text = "".join([*words[:at], odd, *words[at + 1 :]])
        elif kind == "before":
            text = "".join([*words[:at], odd, *words[at:]])
        elif kind == "rest":
            text = "".join(words[:at])
        elif kind == "line":
            text = "\n".join(lines[:line] + lines[line + 1 :])
        elif kind == "double":
            text = "\n".join([*lines[: line + 1], *lines[line:]])
        else:
            byte = draw(st.integers(0, len(text)))
            text = text[:byte] + draw(st.characters()) + text[byte + 1 :]
    return text


@st.composite
def mangled_files(draw):
    """One of the files, and the section file beside it, one of both mangled."""
    name = draw(st.sampled_from(list(FILES)))
    text, sections = FILES[name], SECTIONS
    if "main" in name and draw(st.booleans()):
        return name, text, draw(mangled(sections))
    return name, draw(mangled(text)), sections


def written(folder, text):
    (folder).write_bytes(text.encode("utf-8", "surrogateescape" if "\udc80" in text else "replace"))


# Few in the quick tier; in the exhaustive one as many as there are scenes of other kinds.
EACH = pytest.mark.parametrize("tier", ["quick", tiers.exhaustive("exhaustive")])


@EACH
@examples(400)
@given(case=mangled_files())
def test_mangled_files_are_read_or_refused(case, tier, tmp_path, watched):
    name, text, sections = case
    written(tmp_path / "sec.dat", sections)
    file = tmp_path / "blade.txt"
    written(file, text)
    known = {} if "main" in name else {"length": 50.0, "axial_stiffness": 1e10}
    formats = [None]
    formats += [blades.BladeFormat.ELASTODYN] if name == "elastodyn" else []
    formats += [blades.BladeFormat.BMODES] if "main" in name or name == "sections" else []
    with watched(case):
        for form in formats:
            try:
                table = blades.read_blade(file, format=form, **known)
            except ValueError as error:
                said = str(error)
                assert said.startswith(str(tmp_path)), said
                assert len(said.splitlines()) == 1, said
                continue
            is_sane(table)


def is_sane(table):
    """All numbers are finite and in range, and they make a rotor."""
    beam = table.beam
    assert float(beam.length) > 0
    for name in ("mass_per_length", "in_plane_bending_stiffness", "flap_bending_stiffness"):
        values = np.asarray(getattr(beam, name).values)
        assert np.isfinite(values).all()
        assert (values > 0).all()
    if table.hub_radius is not None:
        assert np.isfinite([table.hub_radius, table.tip_mass, table.angular_speed]).all()
    table.rotor(tip_mass=1.0)
    assert all(len(sentence.splitlines()) == 1 for sentence in table.ignored)


@st.composite
def rewritten(draw):
    """The table of `CSV` as any program might write it."""
    rows = [line.split(",") for line in CSV.split()]
    order = draw(st.permutations(range(4)))
    rows = [[row[i] for i in order] for row in rows]
    by = draw(st.sampled_from([",", ";", "\t"]))
    comma = draw(st.booleans())
    quoted = draw(st.booleans()) or (comma and by == ",")
    blank = draw(st.sampled_from(["", " ", "\u00a0"]))

    def cell(text):
        number = text[0].isdigit()
        text = text.replace(".", ",") if comma and number else text
        text = text.upper() if number and draw(st.booleans()) else text
        return f'{blank if by != chr(9) and blank == " " else ""}"{text}"' if quoted else (
            f"{blank}{text}{blank}"
        )  # fmt: skip

    titles = draw(st.sampled_from([str, str.upper, lambda t: t.replace("x_over_L", "x/L")]))
    if draw(st.booleans()):
        rows[0] = [
            re.sub(r"_(kg_per_m|N_m2)$", r" [\1]", t.replace("x_over_L", "X / L")) for t in rows[0]
        ]
        rows[0] = [t.replace("kg_per_m", "kg/m").replace("N_m2", "N m²") for t in rows[0]]
    elif titles is not str.upper:
        rows[0] = [titles(t) for t in rows[0]]
    lines = [by.join(map(cell, row)) + draw(st.sampled_from(["", by, 2 * by])) for row in rows]
    width = max(line.count(by) for line in lines)
    lines = [lines[0], *lines[1:], *draw(st.sampled_from([[], [""], ["", width * by]]))]
    text = draw(st.sampled_from(["\n", "\r\n", "\r"])).join(lines)
    return text.encode(draw(st.sampled_from(["utf-8", "utf-8-sig", "cp1252", "utf-16"])))


@EACH
@examples(160)
@given(data=rewritten())
def test_tables_of_any_program_say_the_same(data, tier, tmp_path, watched):
    file = tmp_path / "blade.csv"
    file.write_bytes(data)
    with watched(data):
        beam = blades.read_blade(file, length=50.0, axial_stiffness=1e10).beam
    np.testing.assert_array_equal(beam.mass_per_length.values, [300, 100, 10])
    np.testing.assert_array_equal(beam.flap_bending_stiffness.values, [2e9, 5e8, 1e7])
    np.testing.assert_array_equal(beam.in_plane_bending_stiffness.values, [4e9, 1e9, 5e7])
