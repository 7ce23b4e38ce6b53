"""The rod of full sections in space."""

import dataclasses
from typing import Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import count_functions
from jaxbeam._models.contract.base import AbstractModel, small_motion
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.contract.supports import AS_BUILT, ROOT_SPRINGS, TURNED, check_supported
from jaxbeam._models.space.rod_equations import RodEquations
from jaxbeam._models.space.rod_tables import breaks_of, element_edges, node_rows
from jaxbeam._rotor.beam import CONED_AND_MORE, Rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.motion import spinning
from jaxbeam._types import Scalar

_OF_NODE = (
    Direction.AXIAL, Direction.IN_PLANE, Direction.FLAP,
    Direction.TORSION, Direction.FLAP, Direction.IN_PLANE,
)  # fmt: skip


class SpatialRod(AbstractModel[Rotor]):
    """A rod of full sections about an axis that may be curved, geometrically exact: it stretches,
    shears, bends both ways and twists, in steady rotation and in small motion about it.

    Strains are those of Simo and Reissner, sections 6 x 6 stiffnesses and inertias with all their
    couplings and offsets (`Blade`; a `Beam` is one whose sections are diagonal, with the rotary
    inertia of its polar_inertia and hardly any shear). So centrifugal stiffening, Coriolis and
    gyroscopic terms, propeller moments and what tension does to bending and torsion of offset
    sections are exact; what tension does to twisted sections by the length of their fibres (the
    trapeze effect, T i^2 beside GJ) is there where a `Blade` has its `gyration`.

    `elements` of `degree` p have p nodes each beside the root's, six coordinates a node:
    displacements and quaternions of rotations are polynomials of that degree, forces of one less,
    against which compliances are integrated. Errors fall exponentially with the degree: 48
    coordinates, the default, have six frequencies of a coupled blade to 2e-6 or so. Steps of
    properties and kinks of the axis become ends of elements by themselves. Within an element
    rotations may differ by less than half a turn; from the undeformed blade they may be of any
    size. Costs go with the cube of the number of coordinates.

    It takes all that a rotor and constant loads have (`Rotor`, `Loads`); loads that follow turn
    with the sections from axes of the undeformed beam. Motion in time it leaves to `SpatialANCF`.

    Raises `TypeError` or `ValueError` unless `degree` is an int >= 2 and `elements` one >= 1.
    """

    supports = (
        AS_BUILT | ROOT_SPRINGS | TURNED
        | {
            "blade", "precone", CONED_AND_MORE, "loads.tip_moment", "loads.follows",
            "beam.gyration", "tip_body.flap_inertia", "tip_body.centre_of_mass",
            "damping.section_coefficients",
        }
    )  # fmt: skip
    needs = frozenset({"beam.torsional_stiffness"})
    called = ""
    couples_all = True
    in_time = False
    degree: int = eqx.field(static=True, default=8)
    elements: int = eqx.field(static=True, default=1)
    # Ends of elements, and whether the root yields in plane and in flap, which `suited` sets.
    _ends: tuple[float, ...] | None = eqx.field(static=True, default=None, kw_only=True)
    _yields: tuple[bool, bool] = eqx.field(static=True, default=(False, False), kw_only=True)

    def __check_init__(self) -> None:
        count_functions("degree", self.degree, least=2)
        count_functions("elements", self.elements, least=1)

    @property
    def title(self) -> str:
        count = len(self._edges) - 1
        return self._titled(
            f"rod of {count} element{'s' * (count > 1)} of degree {self.degree} in space"
        )

    @property
    def _edges(self) -> tuple[float, ...]:
        return element_edges((), self.elements) if self._ends is None else self._ends

    @property
    def directions(self) -> tuple[Direction, ...]:
        in_plane, flap = self._yields
        root = (Direction.FLAP,) * flap + (Direction.IN_PLANE,) * in_plane
        return root + _OF_NODE * ((len(self._edges) - 1) * self.degree)

    def equations(self, rotor: Rotor) -> RodEquations:
        """Equations of the steady state and of small motion about it."""
        check_supported(self, rotor)
        return RodEquations(rotor, self.degree, self.elements)

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        equations = self.equations(rotor)
        state = equations.equilibrium(spinning(speed))
        return small_motion(self, rotor, speed, equations, state)

    def suited(self, rotor: Rotor) -> Self:
        in_plane, flap = (spring is not None for spring in rotor.springs)
        ends = element_edges(breaks_of(rotor.beam), self.elements)
        return dataclasses.replace(self, _ends=ends, _yields=(in_plane, flap))

    def displacement(self, xi: Float[np.ndarray, " p"], rotor: Rotor) -> Float[Array, "3 p n"]:
        """Axial, in-plane and flap displacement at x = xi L per unit of each coordinate."""
        return jnp.asarray(self._shapes(xi)[:3])

    def torsion(self, xi: Float[np.ndarray, " p"]) -> Float[Array, "p n"]:
        """Angle of rotation about a1 at x = xi L per unit of each coordinate, in rad over the
        length."""
        return jnp.asarray(self._shapes(xi)[3])

    def _shapes(self, xi: Float[np.ndarray, " p"]) -> Float[np.ndarray, "4 p n"]:
        rows, _ = node_rows(self._edges, self.degree, np.asarray(xi, float))
        out = np.zeros((4, len(xi), len(self.directions)))
        free = len(self.directions) - 6 * (rows.shape[1] - 1)  # of the root, which moves nothing
        for way in range(4):
            out[way, :, free + way :: 6] = rows[:, 1:]
        return out
