"""Point masses and point forces along the span.

Each is spread over `WIDTH` of the span about its place, so that integrals along the span include it
as a density. Frequencies change by some 1e-12, as the square of the width.
"""

import itertools
from collections.abc import Sequence
from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import check_all, concrete_array, known_array, shaped_array
from jaxbeam._results import replaced
from jaxbeam._rotor.clock import Clock, Later
from jaxbeam._rotor.motion import check_function_of_time, function_of_time
from jaxbeam._rotor.parameters import Parameters
from jaxbeam._rotor.spanwise import AbstractSpanwise, Property, along, at_ends, samples
from jaxbeam._status import Status
from jaxbeam._types import Number, Scalar

WIDTH = 1e-6  # width of a box, over the length of the beam
_DIGITS = 12  # digits to which ends of boxes are rounded, so that equal ones compare as equal


class Boxes(eqx.Module):
    """The short pieces of the span over which points are spread."""

    ends: tuple[tuple[float, float], ...] = eqx.field(static=True)

    @classmethod
    def about(cls, places: Sequence[float]) -> Self:
        """The boxes, of width `WIDTH`, about places x / L."""
        both = ((place - WIDTH / 2, place + WIDTH / 2) for place in places)
        return cls(tuple((round(a, _DIGITS), round(b, _DIGITS)) for a, b in both))

    @property
    def kinks(self) -> tuple[float, ...]:
        """Places x / L at which the boxes begin and end."""
        return tuple(itertools.chain(*self.ends))

    def density(self, xi: np.ndarray) -> Float[np.ndarray, "p k"]:
        """The density of each of k boxes, constant there with integral one, at p places xi."""
        start, end = np.asarray(self.ends).T
        inside = (start < xi[:, None]) & (xi[:, None] < end)
        return inside / (end - start)


class PointMasses(Parameters):
    """Masses at points of a beam: sensors, joints, brakes, what is bolted on.

    | field  | meaning                                                       | unit | allowed |
    |--------|---------------------------------------------------------------|------|---------|
    | places | x / L (k,), increasing: known numbers between 0 and 1, of     |      | 0 to 1  |
    |        | which each stays away from the ends and the next by 1e-5      |      |         |
    | masses | m_i (k,), differentiable                                      | kg   | >= 0    |

    They have inertia as points of the beam's axis do: no moment of inertia of their own. What is at
    the tip is a `tip_mass` or a `TipBody` of the rotor.

    Raises `TypeError` for what are no real numbers, and `ValueError` for what is not allowed.
    """

    places: tuple[float, ...] = eqx.field(static=True)
    masses: Float[Array, " k"] = eqx.field(
        metadata={"status": Status.INVALID_POINT_MASSES, "zero": True}
    )

    def __init__(self, places: Any, masses: Any) -> None:
        self.places = checked_places(places)
        self.masses = jnp.atleast_1d(known_array("masses", masses))
        if self.masses.shape != (len(self.places),):
            raise ValueError(
                f"masses must be as many as places, {len(self.places)}, got shape "
                f"{self.masses.shape}"
            )


class PointForces(eqx.Module):
    """Forces on points of a beam: of a strut, a wire, a brake.

    `places` (k,) are x / L as those of `PointMasses`; `forces` (k, 3) are in N, in hub axes, or a
    function of time to such.

    Raises `TypeError` for what are no real numbers, and `ValueError` for other shapes, places that
    are not allowed and known numbers that are not finite.
    """

    places: tuple[float, ...] = eqx.field(static=True)
    forces: Any

    def __init__(self, places: Any, forces: Any) -> None:
        self.places = checked_places(places)
        shape = (len(self.places), 3)
        if callable(forces):
            check_function_of_time("forces", forces, shape)
            self.forces = function_of_time(forces)
            return
        self.forces = shaped_array("forces", forces, shape, ", three components for each place")
        check_all(Status.INVALID_LOAD, self.forces)

    @property
    def boxes(self) -> Boxes:
        """The pieces of the span over which the forces are spread."""
        return Boxes.about(self.places)

    def since(self, clock: Clock) -> "PointForces":
        """Forces by a clock that shows zero at its origin."""
        forces = self.forces
        return replaced(self, forces=Later(forces, clock)) if callable(forces) else self

    def along_span(self, t: Scalar, xi: np.ndarray, length: Number) -> Float[Array, "p 3"]:
        """Force per length at time t and places x / L, in N/m."""
        forces = jnp.asarray(self.forces(t)) if callable(self.forces) else self.forces
        return jnp.asarray(self.boxes.density(xi)) @ forces / length


class WithPoints(AbstractSpanwise):
    """A mass per length with point masses, spread over boxes, as a property along the span."""

    beam: Property  # mass per length without points, kg/m
    masses: Float[Array, " k"]  # point masses over the length of the beam, kg/m
    boxes: Boxes
    kinks: tuple[float, ...] = eqx.field(static=True)
    steps: tuple[float, ...] = eqx.field(static=True)

    def __init__(self, beam: Property, points: PointMasses, length: Number) -> None:
        self.beam, self.boxes = beam, Boxes.about(points.places)
        self.masses = points.masses / length
        varies = isinstance(beam, AbstractSpanwise)
        kinks, steps = (beam.kinks, beam.steps) if varies else ((), ())
        self.kinks = tuple(sorted({*kinks, *self.boxes.kinks}))
        self.steps = tuple(sorted({*steps, *self.boxes.kinks}))

    def at(self, xi: Float[Array | np.ndarray, " p"]) -> Float[Array, " p"]:
        return along(self.beam, xi) + self.boxes.density(np.asarray(xi, float)) @ self.masses

    def within(self, edges: tuple[float, ...], s: Array) -> Float[Array, "e p"]:
        varies = isinstance(self.beam, AbstractSpanwise)
        beam = self.beam.within(edges, s) if varies else jnp.broadcast_to(self.beam, s.shape)
        return beam + self._between(edges)[:, None]

    def ends(self, edges: tuple[float, ...]) -> tuple[Float[Array, " e"], Float[Array, " e"]]:
        first, last = at_ends(self.beam, edges)
        return first + self._between(edges), last + self._between(edges)

    def samples(self) -> Float[Array, " k"]:
        return jnp.concatenate([jnp.ravel(samples(self.beam)), self.masses])

    def _between(self, edges: tuple[float, ...]) -> Float[Array, " e"]:
        """The mass per length of the points in each segment between edges, constant there."""
        places = np.asarray(edges)
        return jnp.asarray(self.boxes.density((places[1:] + places[:-1]) / 2)) @ self.masses


def checked_places(given: Any) -> tuple[float, ...]:
    """Places x / L of points as numbers, checked: increasing, apart, and away from both ends."""
    places = np.atleast_1d(concrete_array("places", given))
    if places.ndim != 1 or not places.size:
        raise ValueError(f"places must be one or more in a row, got shape {places.shape}")
    least = 10 * WIDTH
    if not (np.all(places >= least) and np.all(places <= 1 - least)):  # NaN is neither
        raise ValueError(
            f"places must be between 0 and 1 (x / L), got {places.tolist()}: what is at the tip is "
            "a tip_mass, a tip_body or a tip_force"
        )
    if not np.all(np.diff(places) >= least):
        raise ValueError(
            f"places must increase, by {least:g} at least, got {places.tolist()}: what is at one "
            "place is one point"
        )
    return tuple(places.tolist())
