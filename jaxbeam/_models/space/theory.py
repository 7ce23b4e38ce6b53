"""The model of a beam that bends both ways and twists."""

import dataclasses
from typing import Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import count_functions
from jaxbeam._models.bases.basis import HermiteElements
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.supports import AS_BUILT, ROOT_SPRINGS, TURNED, check_supported
from jaxbeam._models.space.elements import SpatialEquations
from jaxbeam._models.space.nodes import components
from jaxbeam._rotor.beam import CONED_AND_MORE, Rotor
from jaxbeam._rotor.directions import Direction


class SpatialANCF(AbstractModel[Rotor]):
    """Finite elements that bend both ways, twist and stretch, geometrically exact and free of
    shear; positions and slopes of nodes are in the hub frame.

    Energy int [EA eps^2 + GJ k_1^2 + bending as sections are turned] dx / 2, eps = |r'| - 1 the
    engineering strain, k_1 the twist per length and (k_2, k_3) the curvatures of the frame that the
    section keeps, all by the unstretched length. In a plane it converges to what `PlanarRod`
    does, which integrates stretch with more points. Rotations may be of any size, within an element
    less than a right angle. It takes moments, and loads that turn with the sections (`Loads`),
    pitch, twist, pre-cone, springs of the root and bodies at the tip of one inertia across the
    beam; the beam needs its `torsional_stiffness`. Left out: shear, rotary inertia of bending, the
    moment of a gyroscope with which the axial inertia of a body answers where the beam points out
    of the plane of rotation, the moment that turns flat sections into that plane (propeller
    moment), and what tension does to torsion: it untwists twisted sections, and stiffens torsion by
    T i^2 / GJ, i the polar radius of gyration. So frequencies of torsion are those at rest, nearly,
    at any speed. Inertia of twist is that of the spin of sections about the tangent in small motion
    about a state (`modes`), and in runs that of the rate of the angle of twist, which in beams that
    are bent far is another one. Damping in proportion to mass has the inertia of each.

    Each of `n_elements` elements has 8 coordinates, and the clamped root two. Costs go with their
    number, errors with the fourth power of an element's length. Roots that yield have a slope more
    each way. Formulation and sources: see `_models/space/energies.py`.

    Raises `TypeError` or `ValueError` unless `n_elements` is an int >= 1.
    """

    supports = (
        AS_BUILT | ROOT_SPRINGS | TURNED
        | {"precone", CONED_AND_MORE, "loads.tip_moment", "loads.follows"}
    )  # fmt: skip
    needs = frozenset({"beam.torsional_stiffness"})
    called = ""
    is_reference = True
    n_elements: int = eqx.field(static=True, default=10)
    # Whether the root yields in plane and in flap, which `suited` sets.
    _yields: tuple[bool, bool] = eqx.field(static=True, default=(False, False), kw_only=True)

    def __check_init__(self) -> None:
        count_functions("n_elements", self.n_elements, least=1)

    @property
    def title(self) -> str:
        return self._titled(f"{self.n_elements} element{'s' * (self.n_elements > 1)} in space")

    @property
    def step_cost(self) -> float:
        return 4 * 2.3 * (2 + 2.2 * self.n_elements)  # blocks of eight, four times those in a plane

    @property
    def _coordinates(self) -> list[tuple[int, int]]:
        """Component of each coordinate, and its place among values and slopes of all nodes."""
        ways, absent = components(*self._yields)
        places = [
            (way, 2 * k + d) for k in range(self.n_elements + 1) for d in (0, 1) for way in ways
        ]
        return places[absent:]

    @property
    def directions(self) -> tuple[Direction, ...]:
        return tuple(Direction(way) for way, _ in self._coordinates)

    def equations(self, rotor: Rotor) -> SpatialEquations:
        """Equations of motion."""
        check_supported(self, rotor)
        return SpatialEquations(rotor, self.n_elements)

    def suited(self, rotor: Rotor) -> Self:
        in_plane, flap = (spring is not None for spring in rotor.springs)
        return dataclasses.replace(self, _yields=(in_plane, flap))

    def displacement(self, xi: Float[np.ndarray, " p"], rotor: Rotor) -> Float[Array, "3 p n"]:
        """Axial, in-plane and flap displacement at x = xi L per unit of each coordinate."""
        return self._shapes(xi)[:3]

    def torsion(self, xi: Float[np.ndarray, " p"], rotor: Rotor) -> Float[Array, "p n"]:
        """Angle of torsion at x = xi L per unit of each coordinate, in rad over the length."""
        return self._shapes(xi)[3]

    def _shapes(self, xi: Float[np.ndarray, " p"]) -> Float[Array, "4 p n"]:
        n, coordinates = self.n_elements, self._coordinates
        # Functions that are zero at the root: the slope there, then value and slope of each node.
        shapes = HermiteElements(n).stretch(2 * n + 1, np.asarray(xi, float)).value
        out = np.zeros((4, len(xi), len(coordinates)))
        for column, (way, place) in enumerate(coordinates):
            out[way, :, column] = shapes[:, place - 1]
        return jnp.asarray(out)
