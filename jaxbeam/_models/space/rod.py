"""The rod of full sections in space."""

import dataclasses
from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import count_functions
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.contract.small_motion import small_motion
from jaxbeam._models.contract.supports import (
    AS_BUILT,
    ROOT_SPRINGS,
    SUPPORTS,
    TURNED,
    check_supported,
)
from jaxbeam._models.space.rod_edges import breaks_of, element_edges, soft_breaks
from jaxbeam._models.space.rod_in_time import RodEquations
from jaxbeam._models.space.rod_supports import ends_of, free_changes, moving_end
from jaxbeam._models.space.rod_tables import node_rows
from jaxbeam._rotor.beam import CONED_AND_MORE, Beam, Rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.motion import spinning
from jaxbeam._types import Scalar

_STIFF = 1e6  # spring in the place of what is held, over that of the beam
MOST_LACKING = 0.1  # of a frequency that is no failure, see `SpatialRod.frequency_error`
_OF_NODE = (
    Direction.AXIAL, Direction.IN_PLANE, Direction.FLAP,
    Direction.TORSION, Direction.FLAP, Direction.IN_PLANE,
)  # fmt: skip


class SpatialRod(AbstractModel[Rotor]):
    """A rod of full sections about an axis that may be curved, geometrically exact: it stretches,
    shears, bends both ways and twists, by any motion of the hub and any turns.

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
    properties and kinks of the axis become ends of elements by themselves, and where numbers are
    known places beyond which sections are 300 times as soft as others, as at tips of real blades:
    one polynomial of the forces would have modes there that no blade has. Where numbers are traced
    `frequency_error` of `Modes` tells, and the status of all else (`TOO_FEW_FUNCTIONS`): take
    elements, or `suited(rotor)` of a rotor whose numbers are known. Rotations may be of any size;
    where sections of one element turn against each other by more than its polynomials follow, by
    an estimate of 0.02 rad (3 rad in all of degree 2, 19 of degree 8), that is `OUT_OF_RANGE`.
    Costs go with the cube of the number of coordinates.

    It takes all that a rotor and loads have (`Rotor`, `Loads`); loads that follow turn with the
    sections from axes of the undeformed beam. Runs whose forces in sections are by much in the
    highest polynomials are `TOO_FEW_FUNCTIONS`. Either end may be on a `Support`, alone of all
    models:

        hinge = jb.blades.Support(about_2=0.0, attitude=(0.0, 0.0, 0.3))  # flap, with some pitch
        propped = jb.blades.Support(0.0, None, None, 0.0, 0.0, 0.0)  # held across
        rotor = jb.Rotor(beam, 0.5, root_support=hinge, tip_support=propped)

    What is held rigidly has no coordinates, and `hub_force` is what both ends give.

    Raises `TypeError` or `ValueError` unless `degree` is an int >= 2 and `elements` one >= 1.
    """

    supports = (
        AS_BUILT | ROOT_SPRINGS | SUPPORTS | TURNED
        | {
            "blade", "precone", CONED_AND_MORE, "loads.tip_moment", "loads.follows",
            "beam.gyration", "tip_body.centre_of_mass",
            "damping.section_coefficients",
        }
    )  # fmt: skip
    needs = frozenset({"beam.torsional_stiffness"})
    called = ""
    couples_all = True
    is_reference = True
    # Half as many steps more as by ten times as much: velocities count by how far they go alone.
    step_tolerance = 1e-7
    degree: int = eqx.field(static=True, default=8)
    elements: int = eqx.field(static=True, default=1)
    # Ends of elements, and which ways are free at root and tip, if these have supports, which
    # `suited` sets.
    _ends: tuple[float, ...] | None = eqx.field(static=True, default=None, kw_only=True)
    _ways: tuple[tuple[int, ...] | None, tuple[int, ...] | None] = eqx.field(
        static=True, default=(None, None), kw_only=True
    )

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
    def step_cost(self) -> float:
        nodes = (len(self._edges) - 1) * self.degree
        return 15 + 6 * nodes + 0.9 * nodes**2  # dense matrices, but half as many steps or fewer

    def slow_modes(self, rotor: Rotor, count: int) -> int:
        # The highest third is of shear, of which a beam has hardly any.
        return 2 * count // 3 if isinstance(rotor.beam, Beam) else count

    @property
    def directions(self) -> tuple[Direction, ...]:
        return tuple(_OF_NODE[way % 6] for way in self._free)

    @property
    def _free(self) -> np.ndarray:
        return free_changes((len(self._edges) - 1) * self.degree + 1, *self._ways)

    @property
    def sizes(self) -> tuple[int, int]:
        return 7 * ((len(self._edges) - 1) * self.degree + 1), len(self._free)

    def in_motion(self, rotor: Rotor) -> tuple[Self, Rotor]:
        """Model and rotor with ends whose ways of motion stay as they are in axes of their nodes,
        so that inertia is constant: a rotation that is held beside two that are free is on a spring
        so stiff that it is as good as held.

        Raises `ValueError` for an end whose shifts have other ways once it has turned.
        """
        stiff = _STIFF * rotor.beam.mean.in_plane_bending_stiffness / rotor.beam.length
        given = []
        for name, end in zip(("root_support", "tip_support"), ends_of(rotor), strict=True):
            attitude = getattr(getattr(rotor, name), "attitude", None)
            given.append(moving_end(name, end, attitude, stiff))
        rotor = eqx.tree_at(
            lambda r: (r.root_springs, r.root_support, r.tip_support), rotor, (None, *given),
            is_leaf=lambda part: part is None,
        )  # fmt: skip
        return self.suited(rotor), rotor

    def equations(self, rotor: Rotor) -> RodEquations:
        """Equations of motion, of the steady state and of small motion about it."""
        check_supported(self, rotor)
        return RodEquations(rotor, self.degree, self._edges)

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        equations = self.equations(rotor)
        state = equations.equilibrium(spinning(speed))
        return small_motion(self, rotor, speed, equations, state)

    def judged(self, rotor: Rotor) -> bool:
        """Whether too few functions are a failure, which is so for any beam: how soft some part of
        it is depends on all that couples."""
        return True

    def most_error(self, rotor: Rotor, speed: Scalar) -> Any:
        return MOST_LACKING

    def frequency_error(
        self, system: LinearSystem, rotor: Rotor, speed: Scalar, eigenvalue: Array, shape: Array
    ) -> Float[Array, " k"] | None:
        """The relative rise of frequencies if strains, not forces, were polynomials."""
        if system.lacking is None:
            return None
        more = jnp.sum((shape.conj() * (shape @ system.lacking)).real, 1)
        square = jnp.abs(eigenvalue) ** 2
        return jnp.abs(more) / (2 * jnp.where(square > 0, square, 1.0))

    def suited(self, rotor: Rotor) -> Self:
        breaks = breaks_of(rotor.beam)
        soft = soft_breaks(rotor.beam)
        if soft is None and self._ends is not None and set(breaks) <= set(self._ends):
            ends = self._ends  # as they were found when numbers were known
        else:
            ends = element_edges(tuple(sorted({*breaks, *(soft or ())})), self.elements)
        root, tip = (None if end is None else end.ways for end in ends_of(rotor))
        return dataclasses.replace(self, _ends=ends, _ways=(root, tip))

    def displacement(self, xi: Float[np.ndarray, " p"], rotor: Rotor) -> Float[Array, "3 p n"]:
        """Axial, in-plane and flap displacement at x = xi L per unit of each coordinate."""
        return self._shapes(xi, rotor)[:3]

    def torsion(self, xi: Float[np.ndarray, " p"], rotor: Rotor) -> Float[Array, "p n"]:
        """Angle of rotation about a1 at x = xi L per unit of each coordinate, in rad over the
        length."""
        return self._shapes(xi, rotor)[3]

    def _shapes(self, xi: Float[np.ndarray, " p"], rotor: Rotor) -> Float[Array, "4 p n"]:
        rows, _ = node_rows(self._edges, self.degree, np.asarray(xi, float))
        out = np.zeros((4, len(xi), 6 * rows.shape[1]))
        for way in range(4):
            out[way, :, way::6] = rows
        every = jnp.asarray(out)
        for node, end in zip((0, -1), ends_of(rotor), strict=True):
            if end is not None and end.leads and end.attitude is not None:
                at = np.arange(6) + (0 if node == 0 else out.shape[2] - 6)
                along, about = end.axes[:, None], end.axes[:1, None]
                own = jnp.asarray(rows[:, node])[None, :, None]
                every = every.at[:3, :, at[:3]].set(along * own)
                every = every.at[3:, :, at[3:]].set(about * own)
        return every[:, :, self._free]
