"""What a beam says along its span, at one time of a run or at rest in its hub."""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import places
from jaxbeam._models.contract.section_loads import Environment, Moved, section_loads
from jaxbeam._results import per_case
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._simulation.scene import Scene
from jaxbeam._solvers.system import State
from jaxbeam._types import Scalar, Triple, Vector


class Instant(NamedTuple):
    """A scene at one time, with the state of the beam."""

    scene: Scene
    rotor: AnyRotor | None
    t: Scalar
    y: State
    rests: bool = False  # whether the beam rests in the hub

    @property
    def acceleration(self) -> Vector:
        """Acceleration v' of the coordinates, by the equations of motion."""
        if self.rests:
            return 0 * self.y.q
        return self.scene.acceleration(self.t, self.y.q, self.y.v)


class AlongSpan(eqx.Module):
    """Answers of runs and steady states along the span, with axes of times or none in front.

    Displacements are in the hub frame, components axial, in plane, flap, from the undeformed place;
    points are given as xi = x / L, one number or p of them from 0 to 1. Each of these raises
    `ValueError` for points out of range, and `TypeError` for traced ones.
    """

    @abc.abstractmethod
    def _each(self, function: Callable[..., Any], *xi: float) -> Any:
        """The results of a function of each `Instant` and the points."""

    @per_case
    def displacement(self, xi: Any = 1.0) -> Float[Array, "*times p 3"]:
        """Displacement of the points x = `xi` L, one number or p of them from 0 to 1, in m.

        Raises `ValueError` for points out of range, and `TypeError` for traced ones.
        """
        return self._each(_displacement, *points_of(xi))

    @property
    @per_case
    def tip(self) -> Float[Array, "*times 3"]:
        """Displacement of the tip, in m."""
        return self._each(_displacement, 1.0)[..., 0, :]

    @per_case
    def rotation(self, xi: Any = 1.0) -> Float[Array, "*times p 3"]:
        """Angles by which sections at `xi` have turned, in rad: about the beam, in plane, in flap.

        The axis of the rotation times its angle: along the undeformed beam, about a3, and about
        -a2, so that small ones are the angle of torsion and the slopes of the deflection.

        Raises `ValueError` for points out of range, and `TypeError` for traced ones.
        """
        return self._each(_rotation, *points_of(xi))

    @per_case
    def strain(self, xi: Any = 0.0) -> Float[Array, "*times p"]:
        """Axial strain of the centre line at `xi`, as in `displacement`.

        Raises `ValueError` for points out of range, and `TypeError` for traced ones.
        """
        return self._each(_strain, *points_of(xi))

    @per_case
    def curvature(self, xi: Any = 0.0) -> Float[Array, "*times p 2"]:
        """In-plane and flap curvature at `xi`, as in `displacement`, in 1/m.

        In axes that turn with the section, but not with pitch and twist that the beam has by
        itself: surface strain is the axial one less y times it.

        Raises `ValueError` for points out of range, and `TypeError` for traced ones.
        """
        return self._each(_curvature, *points_of(xi))

    @per_case
    def torsion(self, xi: Any = 1.0) -> Float[Array, "*times p"]:
        """Angle of torsion at `xi`, as in `displacement`, in rad: zero but of models in space.

        By it the section has turned about the tangent from where the least rotation from a1 to the
        tangent brings it.

        Raises `ValueError` for points out of range, and `TypeError` for traced ones.
        """
        return self._each(_torsion, *points_of(xi))

    @per_case
    def section_force(self, xi: Any = 0.0) -> Float[Array, "*times p 3"]:
        """Force in sections at `xi`, in N: tension, and shear in plane and in flap.

        By it what is outboard pulls at the section; from equilibrium, as `section_moment`, whose
        axes it has.

        Raises `ValueError` for points out of range, and for a `SpringRotor`, which has no sections,
        and `TypeError` for traced points.
        """
        return self._each(_section_loads, *points_of(xi))[0]

    @per_case
    def section_moment(self, xi: Any = 0.0) -> Float[Array, "*times p 3"]:
        """Moment in sections at `xi`, in N m: of torsion, of bending in plane, of bending in flap.

        It is that of all that is outboard, at the deformed places: inertia, of the hub's motion and
        of the beam in it, gravity, forces along the span and at the tip, mass or body there. In
        runs accelerations are those of the equations of motion. So it is as accurate as
        displacements. In a theory of second order (`Hybrid`) it is that of second order, tension
        times deflection included; `Classical`, whose equations leave this out, has it here.

        Axes are those of `curvature`: the tangent, and what the section has turned a2 and a3 to,
        without the pitch and twist of the beam itself. Where these are no part of it, bending
        moments are, for slender beams, EI times the curvature, and bend towards a2 and a3: as a
        vector (M_0, M_1, M_2) is M_0 along the tangent, -M_2 along the first axis across, M_1 along
        the second one. The hub bears the opposite of what the root does, and damping in proportion
        to inertia, which acts from outside.

        Raises `ValueError` for points out of range, and for a `SpringRotor`, which has no sections,
        and `TypeError` for traced points.
        """
        return self._each(_section_loads, *points_of(xi))[1]

    @property
    @per_case
    def strain_energy(self) -> Float[Array, "*times"]:
        """Strain energy, in J."""
        return self._each(_strain_energy)

    @property
    @per_case
    def hub_force(self) -> Float[Array, "*times 3"]:
        """Force of the hub on the beam, in N, hub axes."""
        return self._each(_reaction)[0]

    @property
    @per_case
    def hub_torque(self) -> Float[Array, "*times 3"]:
        """Moment of the hub on the beam about the centre of the hub, in N m, hub axes."""
        return self._each(_reaction)[1]


def points_of(xi: Any) -> tuple[float, ...]:
    """The argument as places x / L."""
    return tuple(places(xi).tolist())


def _displacement(now: Instant, *xi: float) -> Float[Array, "p 3"]:
    return now.scene.equations.displacement(now.y.q, np.array(xi))


def _rotation(now: Instant, *xi: float) -> Float[Array, "p 3"]:
    return now.scene.equations.rotation(now.y.q, np.array(xi))


def _strain(now: Instant, *xi: float) -> Float[Array, " p"]:
    return now.scene.equations.strain(now.y.q, np.array(xi))


def _curvature(now: Instant, *xi: float) -> Float[Array, "p 2"]:
    return now.scene.equations.curvature(now.y.q, np.array(xi))


def _torsion(now: Instant, *xi: float) -> Float[Array, " p"]:
    return now.scene.equations.torsion(now.y.q, np.array(xi))


def _section_loads(now: Instant, *xi: float) -> tuple[Float[Array, "p 3"], Float[Array, "p 3"]]:
    scene, t, y = now.scene, now.t, now.y
    outside = Environment(scene.hub(t), scene.loads, t, scene.damping)
    moved = Moved(y.q, y.v, now.acceleration)
    return section_loads(now.rotor, scene.equations, outside, moved, np.array(xi))


def _strain_energy(now: Instant) -> Scalar:
    return now.scene.equations.strain_energy(now.y.q)


def _reaction(now: Instant) -> tuple[Triple, Triple]:
    return now.scene.reaction(now.t, now.y, now.acceleration, rests=now.rests)
