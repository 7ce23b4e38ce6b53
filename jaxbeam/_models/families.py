"""Which way things move, what modes are called, and which of them are coupled."""

import enum
from typing import NamedTuple

import numpy as np

from jaxbeam._checks import count_functions
from jaxbeam._rotor.beam import AnyRotor, Rotor


class Family(enum.IntEnum):
    """Which way a coordinate or a mode moves."""

    IN_PLANE = 0
    FLAP = 1
    AXIAL = 2
    TORSION = 3

    @property
    def title(self) -> str:
        return ("in-plane bending", "flap bending", "axial", "torsion")[self]


class Label(NamedTuple):
    """Name of a mode: its family, and its number within the family, from 1."""

    family: Family
    order: int

    def __str__(self) -> str:
        return f"{self.family.title} {self.order}"


def labels(
    *, in_plane: int = 0, flap: int = 0, axial: int = 0, torsion: int = 0
) -> tuple[Label, ...]:
    """Labels of the first modes of each family: `labels(in_plane=2, flap=1)` is three labels."""
    named = {"in_plane": in_plane, "flap": flap, "axial": axial, "torsion": torsion}
    for name, count in named.items():
        count_functions(name, int(count) if isinstance(count, np.integer) else count)
    counts = zip(Family, named.values(), strict=True)
    return tuple(Label(f, k + 1) for f, count in counts for k in range(count))


# Families that move in phase, and those that move in quadrature to them; where both are the same
# anything may be coupled with anything.
Plane = tuple[tuple[Family, ...], tuple[Family, ...]]
_TORSION: Plane = ((Family.TORSION,), ())
APART: tuple[Plane, ...] = (
    ((Family.IN_PLANE,), (Family.AXIAL,)),
    ((Family.FLAP,), ()),
    _TORSION,
)


def planes_of(rotor: AnyRotor) -> tuple[Plane, ...]:
    """Which families of modes are coupled: flap with none, unless sections are turned or the beam
    is coned; torsion too where it is coned, and all with all where it is both."""
    if not isinstance(rotor, Rotor):
        return APART
    if rotor.precone is not None:
        if rotor.couples_bending:
            return ((tuple(Family), tuple(Family)),)
        return (((Family.IN_PLANE, Family.TORSION), (Family.FLAP, Family.AXIAL)),)
    if rotor.couples_bending:
        return (((Family.IN_PLANE, Family.FLAP), (Family.AXIAL,)), _TORSION)
    return APART
