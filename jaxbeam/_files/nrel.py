"""What blade files of OpenFAST's ElastoDyn and of BModes share."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from jaxbeam._files.tables import (
    PLACE,
    UNITS,
    BladeTable,
    Column,
    Row,
    blade,
    factor_of,
    ignoring,
    unit_in,
)
from jaxbeam._files.texts import entries, is_number, mistake, number_in, read_lines
from jaxbeam._rotor.spanwise import AbstractSpanwise
from jaxbeam._types import Real

REASONS = {
    name: reason
    for reason, names in {
        "it belongs to the aerodynamics": "aerocent pitchaxis",
        "bending and torsion are coupled by no stiffness": "alpha",
        "the axes of inertia are those of the stiffness": "tw_iner",
        "the beam is straight": "precrvref preswpref",
        "the centre of mass is on the axis of the beam": "flpcgof edgcgof cg_offst",
        "the centre of tension is on the axis of the beam": "flpeaof edgeaof tc_offst",
        "the shear centre is on the axis of the beam": "sc_offst",
        "damping is an argument of a simulation": "bldfldmp bldeddmp",
        "frequencies follow from stiffness and mass": "flsttunr",
        "shapes of modes are computed": "bldfl1sh bldfl2sh bldedgsh",
        "the tip mass is on the axis of the beam": "cm_loc",
        "axes of the tip body are those of the last section": "ixy_tip izx_tip iyz_tip",
    }.items()
    for name in names.split()
}
Meanings = Mapping[str, tuple[str, float]]  # from title in lower case to property and factor
_VALUE = re.compile(
    r"\s*('[^']*'|\"[^\"]*\"|[^\s,]+)(?:\s*[,/!]|\s)[\s:-]*([A-Za-z]\w*(?:\(\d+\))?)"
)


class Value(NamedTuple):
    """A value of a line, and the name after it."""

    line: int
    name: str
    text: str


NamedValues = dict[str, list[Value]]  # values by name in lower case


class Head(NamedTuple):
    """Titles of columns and their units, which may be empty, with their line numbers."""

    line: int
    titles: Sequence[str]
    units: str
    units_line: int


def value_in(line: str) -> str:
    """The first entry of a line; of a text in quotes the text."""
    found = _VALUE.match(f"{line} end")
    text = found[1] if found else ""
    return (entries(text) or [""])[0]


def named(lines: Sequence[str], start: int, stop: int | None) -> NamedValues:
    """The values of lines that have a value and then its name."""
    said: NamedValues = {}
    for i, line in enumerate(lines[start:stop], start + 1):
        found = _VALUE.match(line)
        if found and not line.lstrip().startswith("--"):
            value = Value(i, found[2], value_in(line))
            said.setdefault(found[2].lower(), []).append(value)
    return said


def beside(path: Path, value: Value, kind: str) -> tuple[Path, list[str]]:
    """The file of a kind that a value of another one names, and its lines."""
    there = path.parent / value.text.replace("\\", "/")
    try:
        return there, read_lines(there)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        what = f"the {kind} file {there} cannot be read: {why}"
        raise mistake(path, value.line, value.name, what) from error


def require(path: Path, said: NamedValues, names: Sequence[str]) -> None:
    """Raise `ValueError` unless each of these names is there exactly once."""
    missing = [name for name in names if name.lower() not in said]
    if missing:
        raise ValueError(f"{path}: no line has {', '.join(missing)} behind its value")
    for name in names:
        first, *others = said[name.lower()]
        if others:
            raise mistake(path, others[0].line, name, f"is said again, after line {first.line}")


def number(path: Path, said: NamedValues, name: str, zero: bool | None = None) -> float:
    """The number of a name, positive or `zero`; with None it may have any sign."""
    value = said[name.lower()][0]
    return number_in(path, value.line, value.name, value.text, zero)


def count_of(path: Path, line: int, name: str, text: str) -> int:
    """The number of rows that a line states, checked."""
    count = number_in(path, line, name, text, False)
    if count != int(count):
        raise mistake(path, line, name, f"must be a whole number, got {text}")
    return int(count)


def table_rows(
    path: Path, lines: Sequence[str], start: int, count: int, name: str, width: int
) -> list[Row]:
    """The rows of a table, as many as the file states, read as by Fortran: a row may go on in the
    next line, and text after its last entry is ignored, unless it is a number."""
    rows: list[Row] = []
    at = start
    while len(rows) < count:
        line, cells = at + 1, entries(lines[at]) if at < len(lines) else ["--"]
        at += 1
        if not cells:
            continue
        if not re.match(r"[+-]?[.\d]", cells[0]):  # a line of text ends the table
            what = f"{name} is {count:g}, but the table ends after {len(rows)}"
            raise mistake(path, min(line, len(lines)), None, what)
        whole, until = cells, at
        while len(whole) < width and until < len(lines):
            more = entries(lines[until])
            if not all(map(is_number, more)):
                break
            whole, until = [*whole, *more], until + 1
        if len(whole) == width:
            cells, at = whole, until
        # The next entry may be the rest of a number, such as E9 of 4.,E9.
        left = any(is_number(start + text) for text in cells[width:][:1] for start in ("", "1"))
        if len(cells) < width or left:
            raise mistake(path, line, None, f"{len(cells)} entries for {width} columns")
        rows.append((line, cells[:width]))
    return rows


def blade_of(
    path: Path,
    head: Head,
    meanings: Meanings,
    rows: Sequence[Row],
    length: Real | None,
    axial_stiffness: Real | AbstractSpanwise | None,
    needed: Iterable[str],
) -> BladeTable:
    """The blade of a table, whose known titles may be in any order and case."""
    units = re.findall(r"\([^)]*\)|\[[^\]]*\]|[^\s,]+", head.units)
    if units and len(units) != len(head.titles):
        what = f"{len(units)} units for {len(head.titles)} columns: each in brackets, or (-)"
        raise mistake(path, head.units_line, None, what)
    columns: dict[str, Column] = {}
    for i, title in enumerate(head.titles):
        if title.lower() not in meanings:
            continue
        name, factor = meanings[title.lower()]
        allowed = UNITS[name]
        # The unit (-) is that of the format; places x / L have none whatever is stated.
        own = unit_in(units[i]) if units and name != PLACE else ""
        own = own or next(iter(allowed))
        if name in columns:
            what = f"is {name} again, after column {columns[name].title}"
            raise mistake(path, head.line, title, what)
        factor *= factor_of(path, head.units_line, title, own, allowed)
        columns[name] = Column(title, i, factor)
    titles = {meanings[title.lower()][0]: title for title in needed}
    return blade(
        path, head.line, head.titles, columns, rows, length, axial_stiffness, titles,
        reasons=REASONS,
    )  # fmt: skip


def ignoring_too(table: BladeTable, others: Iterable[Value]) -> BladeTable:
    """The table with sentences about further named values that are ignored, one for each array,
    without those that change nothing."""
    left: dict[str, list[str]] = {}
    for _, name, text in others:
        array = re.sub(r"\(?\d+\)?$", "", name)
        array = array if array.lower() in REASONS else name
        if not is_number(text, 1 if array.lower() == "flsttunr" else 0):
            left.setdefault(array, [] if array != name else [text])
    sentences = tuple(ignoring(name, values, REASONS) for name, values in left.items())
    return table._replace(ignored=table.ignored + sentences)
