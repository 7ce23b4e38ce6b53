"""Beams from tables of sectional properties: what all formats share, and CSV.

A format says which of its columns means what, and hands its rows to `blade`.
"""

import csv
import math
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jaxbeam._rotor.beam import Beam
from jaxbeam._rotor.parameters import TURN
from jaxbeam._rotor.spanwise import AbstractSpanwise, Spanwise
from jaxbeam._types import Real


class BladeTable(NamedTuple):
    """What a file says of a blade.

    `ignored` has a sentence for each thing in the file that a `Beam` does not have, unless it
    changes nothing: offsets of zero, say. The fields after it are None but for a main file of
    BModes, which knows more than the beam.
    """

    beam: Beam
    ignored: tuple[str, ...]
    hub_radius: float | None = None  # m
    tip_mass: float | None = None  # kg
    pitch: float | None = None  # rad, in the sense of the twist of the beam; None: zero, too
    angular_speed: float | None = None  # rad/s


class Column(NamedTuple):
    """Where in a row a property is, and what makes it one in SI units, in the sense of a `Beam`."""

    title: str
    number: int
    factor: float = 1.0


Row = tuple[int, list[str]]  # number of the line, its entries
FilePath = str | os.PathLike[str]
PLACE, TWIST = "place", "twist"  # all other properties must be positive
IN_PLANE, FLAP = "in_plane_bending_stiffness", "flap_bending_stiffness"
MASS, AXIAL = "mass_per_length", "axial_stiffness"
# To feather the leading edge goes upwind. The axis of a rotor that turns clockwise as seen from
# there is downwind, and towards it a `Beam` counts its twist. BModes makes the same change.
FEATHER = -1.0
DEGREES = FEATHER * math.pi / 180

_LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_MASSES = {"kg/m": 1.0, "g/m": 1e-3, "t/m": 1e3}
_FORCES = {"N": 1.0, "kN": 1e3, "MN": 1e6, "GN": 1e9}
_STIFFNESSES = {f"{force}m2": factor for force, factor in _FORCES.items()} | {"Nmm2": 1e-6}
_ANGLES = {"deg": DEGREES, "rad": FEATHER}
# By name: the property, and its units.
_NAMES: dict[str, tuple[str, Mapping[str, float]]] = {
    "x_over_l": (PLACE, {"": 1.0}),
    "x": (PLACE, _LENGTHS),
    "mass_per_length": (MASS, _MASSES),
    "axial_stiffness": (AXIAL, _FORCES),
    "twist": (TWIST, _ANGLES),
    "structural_twist": (TWIST, _ANGLES),
}
for _name, _planes in (
    (IN_PLANE, ("in_plane", "edge", "edgewise", "lag")),
    (FLAP, ("flap", "flapwise")),
):
    for _plane in _planes:
        _NAMES[f"{_plane}_stiffness"] = _NAMES[f"{_plane}_bending_stiffness"] = _name, _STIFFNESSES


def read_csv(
    path: FilePath,
    *,
    length: Real | None = None,
    axial_stiffness: Real | AbstractSpanwise | None = None,
) -> BladeTable:
    """A beam from a table with commas between entries.

    Lines that begin with # are comments. The first other line names the columns, in any order, each
    a name and then a unit: `flap_stiffness_N_m2` or `flap stiffness [N m^2]`.

    | name                                    | unit                                           |
    |-----------------------------------------|------------------------------------------------|
    | x_over_L, from 0 to 1                   | none                                           |
    | or x, from 0 at the root                | m, cm, mm                                      |
    | mass_per_length                         | kg/m, g/m, t/m; after a name `_kg_per_m`       |
    | in_plane_stiffness, or edge, edgewise,  | N m^2, kN m^2, MN m^2, GN m^2, N mm^2; after a |
    | lag for in_plane                        | name `_N_m2`                                   |
    | flap_stiffness, or flapwise             | the same                                       |
    | axial_stiffness, if there               | N, kN, MN, GN                                  |
    | twist or structural_twist, if there     | deg, rad                                       |

    `_bending_stiffness` may stand for `_stiffness`. Other columns are named in `ignored`. Each
    later line is a station. Values are linear from one to the next; two equal ones are a step.

    `length`, in m, is needed with x_over_L; with x it is the last station. `axial_stiffness`, in N,
    takes the place of the column, and is needed without one. Frequencies of bending hardly depend
    on it if the beam is stretched by little at its speed.

    Twist is positive in the file as in tables of wind turbines: towards feather, the leading edge
    upwind. Such a rotor turns clockwise as seen from upwind, so its axis by the right-hand rule is
    downwind, and that is where `Beam.twist` is positive: its values are the negative ones of the
    file, and a pitch towards feather is a negative `Rotor.pitch`. Frequencies do not depend on the
    sense, but to which side a mode in plane moves in flap does. Zero at all stations is no twist.

    Raises `ValueError`, which names file, line and column of the first mistake.
    """
    path = Path(path)
    rows = [
        (i, [cell.strip() for cell in next(csv.reader([line]))])
        for i, line in enumerate(read_lines(path), 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not rows:
        raise ValueError(f"{path}: no line names the columns")
    (line, titles), *rows = rows
    columns: dict[str, Column] = {}
    for i, title in enumerate(titles):
        name, unit = _parted(title)
        if name in _NAMES:
            meaning, units = _NAMES[name]
            if unit not in units:
                if name == "x" and title[1:2] == "_":
                    continue  # another column whose name begins with x_
                known = ", ".join(units) or "none at all"
                got = f"{unit!r}" if unit else "none"
                raise mistake(path, line, title, f"its unit must be {known}, got {got}")
            if meaning in columns:
                also = columns[meaning].title
                raise mistake(path, line, title, f"is {meaning} again, after column {also}")
            columns[meaning] = Column(title, i, units[unit])
    named = {
        PLACE: "x_over_L", MASS: "mass_per_length_kg_per_m", IN_PLANE: "in_plane_stiffness_N_m2",
        FLAP: "flap_stiffness_N_m2", AXIAL: "axial_stiffness_N",
    }  # fmt: skip
    by_length = PLACE in columns and _parted(columns[PLACE].title)[0] == "x"
    if by_length and length is not None:
        raise mistake(path, line, columns[PLACE].title, "says the length, so none must be given")
    return blade(
        path, line, titles, columns, rows, None if by_length else length, axial_stiffness,
        named, by_length=by_length,
    )  # fmt: skip


def _parted(title: str) -> tuple[str, str]:
    """Name, as in `_NAMES` if it is one, and unit of a column."""
    if bracketed := re.fullmatch(r"([^\[(]*)[\[(](.*)[\])]", title):
        name, unit = bracketed.groups()
        name = re.sub(r"[\s_-]+", "_", name.strip()).lower()
        name = {"x/l": "x_over_l"}.get(name, name)
    else:
        fits = [n for n in _NAMES if f"{title}_".lower().startswith(f"{n}_")]
        name = max(fits, key=len, default=title)
        unit = title[len(name) + 1 :]
    unit = re.sub(r"[\s_*^·.]", "", unit.replace("_per_", "/").replace("²", "2"))
    return name, "" if unit == "-" else unit


def blade(
    path: Path,
    line: int,
    titles: Sequence[str],
    columns: Mapping[str, Column],
    rows: Sequence[Row],
    length: Real | None,
    axial_stiffness: Real | AbstractSpanwise | None,
    named: Mapping[str, str],
    *,
    by_length: bool = False,
    reasons: Mapping[str, str] | None = None,
) -> BladeTable:
    """The blade of a table whose titles are in a line, each row as long as they are.

    `named` has the properties that must be there, and what a column of each could be called;
    `reasons` why columns of the format are not used, by title in small letters.
    """
    columns = dict(columns)
    given = columns.pop(AXIAL, None) if axial_stiffness is not None else None
    there = {*columns} if axial_stiffness is None else {*columns, AXIAL}
    missing = [title for name, title in named.items() if name not in there]
    if missing:
        hint = "" if AXIAL in there else "; axial_stiffness may also be given as an argument, in N"
        raise ValueError(f"{path}, line {line}: no column {', '.join(missing)}{hint}")
    if length is None and not by_length:
        raise ValueError(f"{path}: length must be given, in m, since the file does not say it")
    numbers = _numbers(path, line, len(titles), columns, rows, by_length)
    places = numbers.pop(PLACE)
    stations = [x / places[-1] for x in places]  # by 1 unless the file says the length
    if length is None:
        length = places[-1]
    if not any(numbers.get(TWIST, ())):
        numbers.pop(TWIST, None)
    properties: dict[str, Any] = {name: Spanwise(stations, v) for name, v in numbers.items()}
    if axial_stiffness is not None:
        properties[AXIAL] = axial_stiffness
    used = {column.number for column in columns.values()} | ({given.number} if given else set())
    ignored = [f"{given.title} is ignored: axial_stiffness was given."] if given else []
    ignored += [
        ignoring(title, reasons or {})
        for i, title in enumerate(titles)
        if i not in used and not all(is_number(cells[i], 0) for _, cells in rows)
    ]
    return BladeTable(Beam(length=length, **properties), tuple(ignored))


def _numbers(
    path: Path,
    line: int,
    width: int,
    columns: Mapping[str, Column],
    rows: Sequence[Row],
    by_length: bool,
) -> dict[str, list[float]]:
    """Properties at the stations; the first mistake raises."""
    values: dict[str, list[float]] = {name: [] for name in columns}
    place = columns[PLACE].title
    for line, cells in rows:
        if len(cells) != width:
            raise mistake(path, line, None, f"{len(cells)} entries for {width} columns")
        for name, (title, i, factor) in columns.items():
            signed = name in (PLACE, TWIST)
            number = number_in(path, line, title, cells[i], None if signed else False)
            if name == TWIST and abs(number * factor) > TURN:
                raise mistake(path, line, title, f"must be within a turn, got {cells[i]}")
            values[name].append(number * factor or 0.0)  # no negative zero
        if wrong := _misplaced(values[PLACE]):
            raise mistake(path, line, place, wrong)
    x = values[PLACE]
    if len(x) < 2:
        raise mistake(path, line, None, f"a table needs two stations or more, there are {len(x)}")
    if not by_length and x[-1] != 1:
        raise mistake(path, line, place, f"stations must end at 1, the tip, got {x[-1]:g}")
    if x[-1] == x[-2]:
        raise mistake(path, line, place, "a step must be between the ends, not at the tip")
    return values


def _misplaced(stations: Sequence[float]) -> str:
    """What is wrong with the last one so far, if anything is."""
    here, before = stations[-1], stations[-2] if len(stations) > 1 else None
    if before is None:
        return f"stations must begin at 0, the root, got {here:g}" if here else ""
    if here < before:
        return f"stations must not decrease, got {here:g} after {before:g}"
    if here == before == 0:
        return "a step must be between the ends, not at the root"
    return f"more than two stations are equal, at {here:g}" if stations[-3:].count(here) > 2 else ""


def read_lines(path: Path) -> list[str]:
    """Lines of a text, in whichever encoding its comments are."""
    return path.read_text(encoding="utf-8-sig", errors="replace").split("\n")


def mistake(path: Path, line: int, column: str | None, what: str) -> ValueError:
    where = f"{path}, line {line}" + (f", column {column}" if column else "")
    return ValueError(f"{where}: {what}")


def number_in(path: Path, line: int, column: str, text: str, zero: bool | None = None) -> float:
    """A finite number, positive or `zero`; with None it may have any sign."""
    try:
        number = _float(text)
    except ValueError:
        raise mistake(path, line, column, f"not a number, {text!r}") from None
    fine = math.isfinite(number) and (zero is None or number > 0 or (zero and number == 0))
    if not fine:
        rule = {None: "", False: " and > 0", True: " and >= 0"}[zero]
        raise mistake(path, line, column, f"must be finite{rule}, got {text}")
    return number


def _float(text: str) -> float:
    # Fortran writes 1.0D+10, and does not know Python's 1_000.
    return float(re.sub("[dD]", "e", text.replace("_", "?")))


def is_number(text: str, value: float) -> bool:
    """Whether a text is this number."""
    try:
        return _float(text) == value
    except ValueError:
        return False


def ignoring(title: str, reasons: Mapping[str, str]) -> str:
    """The sentence on something in a file that is not used."""
    return f"{title} is ignored: {reasons.get(title.lower(), 'a Beam has nothing of this name')}."
