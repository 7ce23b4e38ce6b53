"""Matrices of small motion about a steady state."""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.shapes import Shapes
from jaxbeam._rotor.directions import APART, CouplingGroup, Direction
from jaxbeam._types import Code, Matrix, Scalar


class SystemPart(NamedTuple):
    """Coordinates of some directions, direction by direction: which of all they are (`rows`), how
    many each direction has (`sizes`), and their matrices."""

    rows: np.ndarray
    directions: list[Direction]
    sizes: list[int]
    mass: Matrix
    by_rates: Matrix
    stiffness: Matrix
    taken_along: Matrix | None


class LinearSystem(eqx.Module):
    """Small motion about steady rotation: mass q'' + gyroscopic q' + stiffness q = 0.

    `mass` is symmetric positive definite, `gyroscopic` skew, `stiffness` symmetric; its unit is N/m
    when coordinates are metres. `coupling` says which directions are coupled. Within a group those
    of the first kind are coupled with those of the second by `gyroscopic` alone, which couples
    nothing else; that is what the eigensolver builds on. In-plane and axial coordinates of a
    straight beam that turns in its plane are such, with flap alone. `directions` names the
    direction of each coordinate, `shapes` are the functions on a beam that varies, `state` are the
    coordinates of the steady state, of planar elements and under loads, `lacking` is what stiffness
    may be too small by, of models that know it, and `taken_along` (n, n) how all else moves as a
    rigid body with those of a root that yields, by which modes are labelled. `steady_strain` is the
    largest axial strain of it, below zero where the beam is pushed: of uniform elements that at the
    root, else P / EA from the tension on the undeformed beam, without loads. Unless `status` is OK
    all numbers are NaN.

    About a state under loads, or with damping, it is `general`: mass q'' + (gyroscopic + damping)
    q' + stiffness q = 0, in which anything may be coupled, `damping` is symmetric (None: there is
    none) but for that of full sections with unequal coefficients, and stiffness is symmetric where
    loads have a potential (`conservative`).
    """

    mass: Matrix
    gyroscopic: Matrix
    stiffness: Matrix
    steady_strain: Scalar
    status: Code
    directions: tuple[Direction, ...] = eqx.field(static=True)
    coupling: tuple[CouplingGroup, ...] = eqx.field(static=True, default=APART)
    shapes: Shapes | None = None
    state: Float[Array, " q"] | None = None
    damping: Matrix | None = None
    lacking: Matrix | None = None
    taken_along: Matrix | None = None
    general: bool = eqx.field(static=True, default=False)
    conservative: bool = eqx.field(static=True, default=True)

    @property
    def by_rates(self) -> Matrix:
        """The matrix that goes with q': gyroscopic coupling and damping."""
        return self.gyroscopic if self.damping is None else self.gyroscopic + self.damping

    def where(self, *directions: Direction) -> np.ndarray:
        """Indices of the coordinates of some directions, in the order of these."""
        found = [np.flatnonzero([f == g for g in self.directions]) for f in directions]
        return np.concatenate(found) if found else np.zeros(0, int)

    def part(self, *directions: Direction) -> SystemPart:
        """The part of the system in some directions, those of them that it has."""
        there = [f for f in dict.fromkeys(directions) if f in self.directions]
        rows = self.where(*there)
        every = (self.mass, self.by_rates, self.stiffness, self.taken_along)
        own = np.ix_(rows, rows)
        matrices: list[Any] = [None if a is None else a[own] for a in every]
        return SystemPart(rows, there, [self.where(f).size for f in there], *matrices)
