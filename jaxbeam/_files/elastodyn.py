"""Beams from the blade files of OpenFAST's ElastoDyn, of FAST 8 and of FAST 7."""

from collections.abc import Sequence
from pathlib import Path

from jaxbeam._files.formats import BladeFormat, refuse_other
from jaxbeam._files.names import meanings
from jaxbeam._files.nrel import (
    Head,
    blade_of,
    count_of,
    ignoring_too,
    named,
    number,
    require,
    table_rows,
)
from jaxbeam._files.tables import FLAP, IN_PLANE, MASS, BladeTable
from jaxbeam._files.texts import FilePath, read_lines
from jaxbeam._rotor.spanwise import AbstractSpanwise
from jaxbeam._types import Real

_COLUMNS = "blfract strctwst bmassden flpstff edgstff eastff gjstff flpiner edginer"


def read_elastodyn(
    path: FilePath,
    *,
    length: Real | None = None,
    axial_stiffness: Real | AbstractSpanwise | None = None,
) -> BladeTable:
    """A beam from a blade file of ElastoDyn (OpenFAST, FAST 8), or of FAST 7, which looks the same.

    See `BladeFormat`.
    """
    path = Path(path)
    lines = read_lines(path)
    head = head_of_stations(lines)
    if head is None:
        refuse_other(path, lines, BladeFormat.ELASTODYN)
        raise ValueError(f"{path}: no line has BlFract among titles, so there are no stations")
    titles = _titles(lines[head])
    said = named(lines, _free(lines), head)
    used = ("NBlInpSt", "AdjBlMs", "AdjFlSt", "AdjEdSt")
    require(path, said, used)
    size = said["nblinpst"][0]
    count = count_of(path, size.line, size.name, size.text)
    mass, flap, edge = (number(path, said, name, False) for name in used[1:])
    columns = meanings(_COLUMNS, {MASS: mass, FLAP: flap, IN_PLANE: edge})
    units = lines[head + 1] if head + 1 < len(lines) else ""
    rows = table_rows(path, lines, head + 2, count, "NBlInpSt", len(titles))
    needed = ("BlFract", "StrcTwst", "BMassDen", "FlpStff", "EdgStff", "EAStff")
    table = blade_of(
        path,
        Head(head + 1, titles, units, head + 2),
        columns,
        rows,
        length,
        axial_stiffness,
        needed,
    )
    others = [
        value
        for part in (said, named(lines, rows[-1][0], len(lines)))
        for name, values in part.items() if name not in map(str.lower, used) for value in values
    ]  # fmt: skip
    return ignoring_too(table, others)


def head_of_stations(lines: Sequence[str]) -> int | None:
    """The index of the line with the titles of the columns; None where there is none."""
    start = _free(lines)
    for i, line in enumerate(lines[start:], start):
        words = {title.lower() for title in _titles(line)}
        if "blfract" in words and words & {"bmassden", "flpstff", "edgstff", "strctwst"}:
            return i
    return None


def _free(lines: Sequence[str]) -> int:
    """The number of lines of free text that are titles of the file: two, in FAST 7 three."""
    return 3 if lines[1:2] and lines[1].lstrip().startswith("--") else 2


def _titles(line: str) -> list[str]:
    return line.split("!")[0].replace(",", " ").split()
