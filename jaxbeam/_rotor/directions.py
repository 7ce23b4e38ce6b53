"""Directions of motion, labels of modes, and which directions are coupled."""

import enum
from collections.abc import Iterable
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np

from jaxbeam._checks import count_functions
from jaxbeam._rotor.beam import AnyRotor, Rotor


class Direction(enum.IntEnum):
    """The direction in which a coordinate or a mode moves: along the beam, in the plane of
    rotation, along the axis of rotation, or about the beam. The first three are also the components
    of displacements."""

    AXIAL = 0
    IN_PLANE = 1
    FLAP = 2
    TORSION = 3

    @property
    def title(self) -> str:
        return ("axial", "in-plane bending", "flap bending", "torsion")[self]


def naming(directions: Iterable[Direction]) -> Direction:
    """The direction that names modes of these directions together: bending before axial."""
    return min(directions, key=lambda direction: (direction == Direction.AXIAL, direction))


class Label(NamedTuple):
    """Name of a mode: its `direction` (`Direction`), and its `number` within that, from 1."""

    direction: Direction
    number: int

    def __str__(self) -> str:
        return f"{self.direction.title} {self.number}"


class Counts(TypedDict, total=False):
    """Numbers of modes, by direction."""

    in_plane: int
    flap: int
    axial: int
    torsion: int


def labels(**counts: Unpack[Counts]) -> tuple[Label, ...]:
    """Labels of the first modes of each direction, in the order in which they are asked for.

    `**counts` are how many, ints >= 0, by the names `in_plane`, `flap`, `axial` and `torsion`:
    `labels(flap=1, in_plane=2)` is `flap bending 1`, `in-plane bending 1`, `in-plane bending 2`.
    Returns a tuple of `Label`.

    Raises `TypeError` for any other name or kind of number, and `ValueError` for a negative one.
    """
    named = {name: Direction[name.upper()] for name in Counts.__annotations__}
    found = []
    for name, count in counts.items():
        if name not in named:
            raise TypeError(f"labels are of {', '.join(named)}, not of {name!r}")
        wanted: Any = int(count) if isinstance(count, np.integer) else count
        count_functions(name, wanted)
        found += [Label(named[name], k + 1) for k in range(wanted)]
    return tuple(found)


# Directions that move in phase, and those that move in quadrature to them. Where both are the same,
# all of them are coupled in any phase.
CouplingGroup = tuple[tuple[Direction, ...], tuple[Direction, ...]]
_TORSION: CouplingGroup = ((Direction.TORSION,), ())
ALL_COUPLED: tuple[CouplingGroup, ...] = ((tuple(Direction), tuple(Direction)),)
APART: tuple[CouplingGroup, ...] = (
    ((Direction.IN_PLANE,), (Direction.AXIAL,)),
    ((Direction.FLAP,), ()),
    _TORSION,
)


def coupling_groups(rotor: AnyRotor) -> tuple[CouplingGroup, ...]:
    """The groups of directions that are coupled in small motion about steady rotation.

    In-plane bending is coupled with axial motion, and with flap where sections are turned. A body
    at the tip couples flap with torsion, by its spin about the beam. In a coned beam all are
    coupled: in-plane bending and torsion in quadrature to flap and axial motion, or with turned
    sections in any phase.
    """
    if not isinstance(rotor, Rotor):
        return APART
    if rotor.precone is not None:
        if rotor.couples_bending:
            return ALL_COUPLED
        return (((Direction.IN_PLANE, Direction.TORSION), (Direction.FLAP, Direction.AXIAL)),)
    twisting = (Direction.TORSION,) * rotor.tip_body.is_body
    torsion = () if twisting else (_TORSION,)
    if rotor.couples_bending:
        return (((Direction.IN_PLANE, Direction.FLAP), (Direction.AXIAL, *twisting)), *torsion)
    return (((Direction.IN_PLANE,), (Direction.AXIAL,)), ((Direction.FLAP,), twisting), *torsion)


def is_hinged(rotor: AnyRotor) -> bool:
    """Whether the root yields, so that with springs of zero stiffness the beam may move freely."""
    return loose_motions(rotor) > 0


def loose_motions(rotor: AnyRotor) -> int:
    """How many motions of the beam as a rigid body its root may leave to themselves."""
    if rotor.root_support is not None:
        return sum(spring is not None for spring in rotor.root_support.springs)
    return 0 if rotor.root_springs is None else 2
