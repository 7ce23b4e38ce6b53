"""Beams from tables of sectional properties: what all formats share.

A format says which of its columns means what, and hands its rows to `blade`.
"""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jaxbeam._files.texts import as_number, is_number, mistake, number_in
from jaxbeam._rotor.beam import Beam, Rotor
from jaxbeam._rotor.ends import TipBody
from jaxbeam._rotor.parameters import FULL_TURN
from jaxbeam._rotor.spanwise import AbstractSpanwise, Spanwise
from jaxbeam._types import Real


class BladeTable(NamedTuple):
    """The contents of a file of a blade.

    | field         | unit  |                                                                   |
    |---------------|-------|-------------------------------------------------------------------|
    | beam          |       | the `Beam`; of a file that has full sections the `Blade`, which a |
    |               |       | `Rotor` takes as well                                             |
    | ignored       |       | a sentence for each thing in the file that it does not have       |
    |               |       | and that changes something (offsets of zero do not)               |
    | hub_radius    | m     | as in `Rotor`                                                     |
    | tip_mass      | kg    | as in `Rotor`                                                     |
    | pitch         | rad   | in the sense of the twist of the beam; None: zero, too            |
    | angular_speed | rad/s |                                                                   |
    | precone       | rad   | None: zero, too                                                   |
    | tip_body      |       | of the tip mass; None: it is a point                              |
    | damping       | s     | of files with full sections: the six `section_coefficients` of a  |
    |               |       | `Damping`, in the order of sixes of a `Blade`                     |

    From `hub_radius` to `tip_body` all are None but for a main file of BModes, which knows more
    than the beam; `rotor()` puts them together. `beam.beam()` is what is left of a `Blade` for
    models that know no more than a `Beam`: `table.rotor(beam=table.beam.beam())`.
    """

    beam: Any  # a `Beam`, or a `Blade`
    ignored: tuple[str, ...]
    hub_radius: float | None = None  # m
    tip_mass: float | None = None  # kg
    pitch: float | None = None  # rad, positive as the twist of the beam; None: zero, too
    angular_speed: float | None = None  # rad/s
    precone: float | None = None  # rad; None: zero, too
    tip_body: TipBody | None = None  # None: a point
    damping: tuple[float, ...] | None = None  # s

    def rotor(self, **instead: Any) -> Rotor:
        """The rotor that the file tells of, with other arguments of `Rotor` given by name.

        `**instead` are these: `table.rotor(hub_radius=1.5, root_springs=RootSprings(flap=1e9))`. A
        `tip_mass` or a `tip_body` takes the place of all that the file has at the tip.
        """
        tip = () if {"tip_mass", "tip_body"} & instead.keys() else ("tip_mass", "tip_body")
        names = ("beam", "hub_radius", "pitch", "precone", *tip[self.tip_body is not None :][:1])
        told = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return Rotor(**{**told, **instead})


class Column(NamedTuple):
    """The index of a property in a row, and the factor to SI units with the sign of a `Beam`."""

    title: str
    number: int
    factor: float = 1.0


Row = tuple[int, list[str]]  # line number and entries
PLACE, TWIST = "place", "twist"  # names of properties that need not be positive
IN_PLANE, FLAP = "in_plane_bending_stiffness", "flap_bending_stiffness"
MASS, AXIAL = "mass_per_length", "axial_stiffness"
TORSION, POLAR = "torsional_stiffness", "polar_inertia"
POLARS = f"{POLAR} in flap", f"{POLAR} in plane"  # properties whose sum the polar inertia is
# Files count twist positive towards feather, where the leading edge goes upwind. A `Beam` counts it
# towards the axis of rotation, which for a rotor turning clockwise as seen from upwind is downwind.
# BModes makes the same change.
FEATHER = -1.0
DEGREES = FEATHER * math.pi / 180

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_FORCES = {"N": 1.0, "kN": 1e3, "MN": 1e6, "GN": 1e9}
_STIFFNESSES = {f"{force}m2": factor for force, factor in _FORCES.items()} | {"Nmm2": 1e-6}
# Factors to SI by unit, for each property; first the unit of the formats of turbines.
UNITS: dict[str, Mapping[str, float]] = {
    PLACE: {"": 1.0},
    MASS: {"kg/m": 1.0, "g/m": 1e-3, "t/m": 1e3},
    IN_PLANE: _STIFFNESSES,
    FLAP: _STIFFNESSES,
    AXIAL: _FORCES,
    TWIST: {"deg": DEGREES, "rad": FEATHER},
    TORSION: _STIFFNESSES | {"Nm2/rad": 1.0},
    **{name: {"kgm": 1.0, "kgm2/m": 1.0, "gm": 1e-3, "tm": 1e3} for name in (POLAR, *POLARS)},
}
# Properties that a beam need not have are taken if they are positive at all stations, since many
# files have zeros there.
_TOGETHER = {
    (TORSION,): "a Beam takes it if it is > 0 at all stations",
    (POLAR,): "a Beam takes it if it is > 0 at all stations",
    POLARS: "a Beam takes their sum if both are > 0 at all stations",
}


def unit_in(text: str) -> str:
    """A unit in the spelling of `UNITS`: without brackets, blanks and signs of products and
    powers."""
    plain = text.strip().strip("[]()").replace("²", "2").replace("°", "deg")
    plain = re.sub(r"degrees?\b", "deg", re.sub(r"radians?\b", "rad", plain))
    plain = re.sub(r"[\s*·⋅.]*m\s*\^?\s*[-⁻][1¹]$", "/m", plain)
    plain = re.sub(r"(?<=\w)\s*[*^·⋅.-]{1,2}\s*(?=\w)|[\s_]", "", plain)
    return "" if plain == "-" else plain


def factor_of(path: Path, line: int, title: str, unit: str, units: Mapping[str, float]) -> float:
    """The factor from a unit to that of a `Beam`; raises an error that lists the units allowed."""
    if unit not in units:
        allowed = ", ".join(units) or "none at all"
        got = f"{unit!r}" if unit else "none"
        raise mistake(path, line, title, f"its unit must be {allowed}, got {got}")
    return units[unit]


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
    columns, left = _used(columns, rows)
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
    stations = [x / places[-1] for x in places]  # the factor is 1 unless the file states the length
    if length is None:
        length = places[-1]
    if POLARS[0] in numbers:
        both = zip(*(numbers.pop(name) for name in POLARS), strict=True)
        numbers[POLAR] = [sum(pair) for pair in both]
    if not any(numbers.get(TWIST, ())):
        numbers.pop(TWIST, None)
    try:
        properties: dict[str, Any] = {name: Spanwise(stations, v) for name, v in numbers.items()}
        if axial_stiffness is not None:
            properties[AXIAL] = axial_stiffness
        beam = Beam(length=length, **properties)
    except ValueError as error:  # numbers too large for a float, or places too close
        raise mistake(path, line, None, str(error).splitlines()[0]) from error
    used = {column.number for column in columns.values()} | ({given.number} if given else set())
    ignored = [f"{given.title} is ignored: axial_stiffness was given."] if given else []
    for i, title in enumerate(titles):
        values = [cells[i] for _, cells in rows]
        if i not in used and not all(is_number(value, 0) for value in values):
            why = {**(reasons or {}), **({title.lower(): left[i]} if i in left else {})}
            ignored.append(ignoring(title or f"column {i + 1}", values, why))
    return BladeTable(beam, tuple(ignored))


def _used(
    columns: Mapping[str, Column], rows: Sequence[Row]
) -> tuple[dict[str, Column], dict[int, str]]:
    """The columns that are used, and by number the reasons why others are not."""
    taken, left = dict(columns), dict[int, str]()
    for names, why in _TOGETHER.items():
        there = [taken[name] for name in names if name in taken]
        again = names == POLARS and POLAR in taken
        if (
            again
            or len(there) < len(names)
            or not all(_positive(r, c) for r in rows for c in there)
        ):
            left |= {taken.pop(name).number: why for name in names if name in taken}
    return taken, left


def _positive(row: Row, column: Column) -> bool:
    text = row[1][column.number] if column.number < len(row[1]) else ""
    return not is_number(text) or not as_number(text) <= 0  # text that is no number raises later


def _numbers(
    path: Path,
    line: int,
    width: int,
    columns: Mapping[str, Column],
    rows: Sequence[Row],
    by_length: bool,
) -> dict[str, list[float]]:
    """Properties at the stations; raises for the first mistake."""
    values: dict[str, list[float]] = {name: [] for name in columns}
    place = columns[PLACE].title
    for line, cells in rows:
        if len(cells) != width:
            raise mistake(path, line, None, f"{len(cells)} entries for {width} columns")
        for name, (title, i, factor) in columns.items():
            signed = name in (PLACE, TWIST)
            number = number_in(path, line, title, cells[i], None if signed else False)
            if name == TWIST and abs(number * factor) > FULL_TURN:
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
    """The complaint about the last of these stations; empty if it is right."""
    here, before = stations[-1], stations[-2] if len(stations) > 1 else None
    if before is None:
        return f"stations must begin at 0, the root, got {here:g}" if here else ""
    if here < before:
        return f"stations must not decrease, got {here:g} after {before:g}"
    if here == before == 0:
        return "a step must be between the ends, not at the root"
    return f"more than two stations are equal, at {here:g}" if stations[-3:].count(here) > 2 else ""


def ignoring(title: str, values: Sequence[str], reasons: Mapping[str, str]) -> str:
    """The sentence about values of a file that are not used, with the largest of them."""
    reason = reasons.get(title.lower(), "a Beam has nothing of this name")
    sizes = [abs(as_number(value)) for value in values if is_number(value)]
    if sizes and len(sizes) == len(values):
        reason += f" (in the file {'' if len(sizes) == 1 else 'up to '}{max(sizes):g})"
    return f"{title} is ignored: {reason}."
