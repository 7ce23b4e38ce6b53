"""Beams from tables that spreadsheets, editors and scripts write."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from jaxbeam._files.formats import BladeFormat, no_format, refuse_other
from jaxbeam._files.names import NAMES
from jaxbeam._files.tables import (
    AXIAL,
    FLAP,
    IN_PLANE,
    MASS,
    PLACE,
    BladeTable,
    Column,
    Row,
    blade,
    factor_of,
    unit_in,
)
from jaxbeam._files.texts import FilePath, mistake, read_lines
from jaxbeam._rotor.spanwise import AbstractSpanwise
from jaxbeam._types import Real

# Words that units are made of, besides those of `UNITS`. What follows a name is its unit if it
# consists of such words, else a part of another name, as in x_cg_m.
_UNIT_WORD = re.compile(
    r"per|deg\w*|rad\w*|grad|gon|turns?|rev|ft|in|inch(es)?|yd|lb[fm]?s?|klbf?|kips?|slugs?|psi|ksi"
    r"|([kMG]?(N|Pa|lbf?|kg|m|cm|mm|ft|in)\d?)+",
    re.IGNORECASE,
)
# Numbers with commas or non-breaking blanks between thousands.
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_GROUPED = re.compile("(?<=\\d)[\u00a0\u202f](?=\\d{3})")


def read_csv(
    path: FilePath,
    *,
    length: Real | None = None,
    axial_stiffness: Real | AbstractSpanwise | None = None,
) -> BladeTable:
    """A beam from a table with commas, semicolons or tabs between entries. See `BladeFormat`."""
    path = Path(path)
    lines = read_lines(path)
    if count_named(path, lines) < 2:
        refuse_other(path, lines, BladeFormat.CSV)
    ((line, titles), *rows), by = _records(path, lines)
    columns: dict[str, Column] = {}
    for i, title in enumerate(titles):
        name, unit = _parted(title)
        if name in NAMES:
            meaning, units = NAMES[name]
            factor = factor_of(path, line, title, unit, units)
            if meaning in columns:
                also = columns[meaning].title
                raise mistake(path, line, title, f"is {meaning} again, after column {also}")
            columns[meaning] = Column(title, i, factor)
    if not columns:
        raise no_format(path, f"since line {line} names no column of a table")
    named = {
        PLACE: "x_over_L", MASS: "mass_per_length_kg_per_m", IN_PLANE: "in_plane_stiffness_N_m2",
        FLAP: "flap_stiffness_N_m2", AXIAL: "axial_stiffness_N",
    }  # fmt: skip
    by_length = PLACE in columns and _parted(columns[PLACE].title)[0] == "x"
    if by_length and length is not None:
        raise mistake(path, line, columns[PLACE].title, "says the length, so none must be given")
    return blade(
        path, line, titles, columns, _with_points(path, rows, columns, by),
        None if by_length else length, axial_stiffness, named, by_length=by_length,
    )  # fmt: skip


def _records(path: Path, lines: Sequence[str]) -> tuple[list[Row], str]:
    """Entries of lines that are not empty, cut to the number of titles where only blanks follow;
    and the separator of entries."""
    lines = [re.sub("[\u200b\ufeff\0]", "", line) for line in lines]
    lines = ["" if line.lstrip().startswith("#") else line for line in lines]
    # The line by which files tell Excel their separator.
    declared = re.fullmatch(r"\s*sep=([,;\t])\s*", lines[0], re.IGNORECASE)
    if declared:
        lines[0] = ""
    head = next((line for line in lines if line.strip()), "")
    unquoted = re.sub(r'"[^"]*"', "", head)
    by = declared[1] if declared else max(";\t,", key=unquoted.count)
    try:
        records = [*_parsed(lines, by)]
    except csv.Error as error:
        raise ValueError(f"{path}: not a table, {error}") from error
    if not records:
        raise ValueError(f"{path}: no line names the columns")
    titles = records[0][1]
    while titles and not titles[-1]:
        titles.pop()
    for _, cells in records[1:]:
        while len(cells) > len(titles) and not cells[-1]:
            cells.pop()
    return records, by


def _parsed(lines: Sequence[str], by: str) -> Iterator[Row]:
    ended = (f"{line}\n" for line in lines)
    reader, line = csv.reader(ended, delimiter=by, skipinitialspace=True), 1
    for record in reader:
        cells = [" ".join(_GROUPED.sub("", cell).split()) for cell in record]
        if any(cells):
            yield line, cells
        line = reader.line_num + 1


def _with_points(
    path: Path, rows: Sequence[Row], columns: Mapping[str, Column], by: str
) -> list[Row]:
    """Rows with decimal points in the place of decimal commas. Raises where entries are separated
    `by` commas, too, and commas in all numbers could separate thousands."""
    numbers = [(column.title, column.number) for column in columns.values()]
    found = [
        (line, title, cells[i])
        for line, cells in rows for title, i in numbers if i < len(cells)
    ]  # fmt: skip
    pointed = next((line for line, _, cell in found if "." in cell), None)
    for line, title, cell in found:
        if "," in cell and pointed is not None:
            what = f"{cell} has a comma, but numbers in line {pointed} have a decimal point"
            raise mistake(path, line, title, what)
    commas = [entry for entry in found if "," in entry[2]]
    if by == "," and commas and all(_THOUSANDS.fullmatch(cell) for _, _, cell in commas):
        line, title, cell = commas[0]
        what = f'the comma of "{cell}" may be of thousands or a decimal one: write a point or none'
        raise mistake(path, line, title, what)
    places = {i for _, i in numbers}
    return [
        (line, [c.replace(",", ".") if i in places else c for i, c in enumerate(cells)])
        for line, cells in rows
    ]


def count_named(path: Path, lines: Sequence[str]) -> int:
    """The number of columns with known names, if lines are those of a table."""
    try:
        ((_, titles), *_), _ = _records(path, lines)
    except ValueError:
        return 0
    return sum(_parted(title)[0] in NAMES for title in titles)


def _parted(title: str) -> tuple[str, str]:
    """Name of a column, as in `NAMES` if it is known, and its unit."""
    bracketed = re.fullmatch(r"([^\[(]*)[\[(](.*)[\])]", title)
    said, unit = bracketed.groups() if bracketed else (title, "")
    said = re.sub(r"[\s_-]+", "_", said.strip())
    said = re.sub(r"^x_?/_?l(?![a-z])", "x/l", said, flags=re.IGNORECASE)
    name = said.lower()
    if not bracketed:
        fits = [n for n in NAMES if f"{name}_".startswith(f"{n}_")]
        name = max(fits, key=len, default=title)
        unit = said[len(name) + 1 :]
        words = re.split(r"[_*/^·.]", unit) if unit_in(unit) else []
        if name in NAMES and not all(map(_UNIT_WORD.fullmatch, words)):
            taken = NAMES[name][1]
            name = name if unit_in(unit.replace("_per_", "/")) in taken else title
    return name, unit_in(unit.replace("_per_", "/"))
