"""What comes out of a simulation, computed when asked for."""

import dataclasses
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxbeam._checks import places, renamed
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._programs.program import Program
from jaxbeam._results import asked_with, finite_rows, nan_unless, per_case
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._simulation.scene import Scene
from jaxbeam._solvers.system import State
from jaxbeam._status import Status, in_range, trusted
from jaxbeam._types import Scalar, Vector


class Simulation(eqx.Module):
    """What became of a scene: T times, n coordinates, p points.

    | field      | shape  | unit |                                                               |
    |------------|--------|------|---------------------------------------------------------------|
    | times      | (T,)   | s    | output times                                                  |
    | state      | (T, n) | m    | coordinates `q`, rates `v`, `work` (see `Scene`); NaN where   |
    |            |        |      | the run did not get (it failed, or an event ended it)         |
    | imbalance  | (T,)   |      | change of `jacobi_integral` less work, over its largest parts |
    | status     | ()     |      | `Status`                                                      |
    | end_time   | ()     | s    | the last output time that was reached                         |
    | solution   |        |      | the solution of diffrax: statistics, interpolation, events    |
    | scene      |        |      | what was simulated: its equations, motion, loads and damping; |
    |            |        |      | part of no table                                              |
    | model      |        |      | of what theory; no array, and part of no table                |
    | rotor      |        |      | of what, as it was given; part of no table                    |

    Everything else is computed when asked for. Displacements are in the hub frame, components
    axial, in plane, flap, from the undeformed place; points are given as xi = x / L.

    **Runs that failed** do not pass for others. `peak` is NaN unless `status` is OK (a run that an
    event of yours ended is OK). Histories of a run that was stopped (`MAX_STEPS`, `STEP_FAILED`,
    `DIVERGED`) reach as far as it got and are NaN from there on, as after an event; with any other
    failure they are NaN throughout. `partial` answers with all that there is. Where a number is
    NaN, so is its derivative in forward mode; in reverse mode nothing flows back from it.

    **Batches**: a `Simulation` that `jax.vmap` or `equinox.filter_vmap` returns answers everything
    with the axes of the batch in front. Only where a function in the scene (of a `HubPose`, say)
    closes over a number that was mapped, JAX wants it to be asked in the mapped function.
    """

    times: Float[Array, "... T"]
    state: State
    imbalance: Float[Array, "... T"]
    status: Int[Array, "..."]
    end_time: Float[Array, "..."]
    solution: diffrax.Solution
    scene: Scene = asked_with()
    is_partial: bool = eqx.field(static=True, default=False)
    model: AbstractModel | None = eqx.field(static=True, default=None)
    rotor: AnyRotor | None = asked_with()

    @property
    def partial(self) -> "Simulation":
        """The run, which answers with all that there is, whatever its status.

        That is the history up to where it got, and the peak of that; NaN where parameters are out
        of range, since then nothing was simulated.
        """
        return dataclasses.replace(self, is_partial=True)

    @per_case
    def displacement(self, xi: Any = 1.0) -> Float[Array, "T p 3"]:
        """Displacement of the points x = `xi` L, one number or p of them from 0 to 1, in m.

        Raises `ValueError` for points out of range, and `TypeError` for traced ones.
        """
        return self._each(_displacement, *_points(xi))

    @property
    @per_case
    def tip(self) -> Float[Array, "T 3"]:
        """Displacement of the tip, in m."""
        return self.displacement()[:, 0]

    @per_case
    def strain(self, xi: Any = 0.0) -> Float[Array, "T p"]:
        """Axial strain of the centre line at `xi`, as in `displacement`."""
        return self._each(_strain, *_points(xi))

    @per_case
    def curvature(self, xi: Any = 0.0) -> Float[Array, "T p 2"]:
        """In-plane and flap curvature at `xi`, as in `displacement`, in 1/m.

        In axes that turn with the section, but not with pitch and twist that the beam has by
        itself: surface strain is the axial one less y times it.
        """
        return self._each(_curvature, *_points(xi))

    @per_case
    def torsion(self, xi: Any = 1.0) -> Float[Array, "T p"]:
        """Angle of torsion at `xi`, as in `displacement`, in rad: zero but in `SpatialANCF`.

        By it the section has turned about the tangent from where the least rotation from a1 to the
        tangent brings it.
        """
        return self._each(_torsion, *_points(xi))

    @property
    @per_case
    def strain_energy(self) -> Float[Array, " T"]:
        """Strain energy, in J."""
        return self._each(_strain_energy)

    @property
    @per_case
    def energy(self) -> Float[Array, " T"]:
        """Kinetic energy in the inertial frame plus strain energy, in J."""
        return self._each(Scene.total_energy)

    @property
    @per_case
    def jacobi_integral(self) -> Float[Array, " T"]:
        """Kinetic energy seen from the hub, centrifugal potential and strain energy, in J."""
        return self._each(_jacobi)

    @property
    @per_case
    def hub_force(self) -> Float[Array, "T 3"]:
        """Force of the hub on the beam, in N, hub axes."""
        return self._each(Scene.reaction)[0]

    @property
    @per_case
    def hub_torque(self) -> Float[Array, "T 3"]:
        """Moment of the hub on the beam about the centre of the hub, in N m, hub axes."""
        return self._each(Scene.reaction)[1]

    @renamed(component="direction")
    @per_case
    def peak(self, direction: int = 1, xi: float = 1.0) -> tuple[Scalar, Scalar]:
        """Largest deflection either way (m, with its sign) of a point, and when (s).

        `direction` 0, 1, 2 is axial, in plane, flap (see `Direction`), the point x = `xi` L.
        Between output times by cubic interpolation with the rates, exact to fourth order. The value
        is differentiable; the time carries no derivative. NaN unless `status` is OK:
        `partial.peak()` is that of the run so far.

        Raises `ValueError` for another direction or point, and for fewer than two output times.
        """
        if self.times.size < 2:
            raise ValueError("peak needs two or more output times")
        return _peak(self, *checked_point(direction, xi))

    def _each(self, function: Any, *xi: float) -> Any:
        return _mapped(self, function, xi)

    def _outputs(self, fine: Array) -> tuple[Array, Array, State]:
        """Which outputs there are an answer for, given that the status is `fine`; times and states.

        What is out of range ran with harmless numbers in place of its own, and never has an answer.
        Harmless ones take the place of outputs without an answer, too: NaN would end up in
        gradients by the parameters of the scene.
        """
        valid = jnp.isfinite(self.times) & (in_range(self.status) if self.is_partial else fine)
        valid &= finite_rows(jnp.concatenate([self.state.q, self.state.v], 1))
        first = jnp.min(jnp.where(valid, self.times, jnp.inf), initial=jnp.inf)
        times = jnp.where(valid, self.times, jnp.where(jnp.isfinite(first), first, 0.0))
        state = jax.tree.map(
            lambda a: jnp.where(valid.reshape(-1, *(1,) * (a.ndim - 1)), a, 0.0), self.state
        )
        return valid, times, state


@Program
def _mapped(run: Simulation, function: Any, xi: tuple[float, ...]) -> Any:
    scene = run.scene
    valid, times, state = run._outputs(trusted(run.status))
    found = jax.vmap(lambda t, y: function(scene, scene.after(t), y, *xi))(times, state)
    return nan_unless(valid, found)


def _points(xi: Any) -> tuple[float, ...]:
    return tuple(places(xi).tolist())


def checked_point(direction: int, xi: float) -> tuple[int, float]:
    whole = isinstance(direction, int | np.integer) and not isinstance(direction, bool)
    if not whole or direction not in (0, 1, 2):
        raise ValueError(f"direction must be 0 (axial), 1 (in plane) or 2 (flap), got {direction}")
    points = _points(xi)
    if len(points) != 1:
        raise ValueError(f"xi must be one number in [0, 1], got {xi}")
    return int(direction), points[0]


def _displacement(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, "p 3"]:
    return scene.equations.displacement(y.q, np.array(xi))


def _strain(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, " p"]:
    return scene.equations.strain(y.q, np.array(xi))


def _curvature(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, "p 2"]:
    return scene.equations.curvature(y.q, np.array(xi))


def _torsion(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, " p"]:
    return scene.equations.torsion(y.q, np.array(xi))


def _strain_energy(scene: Scene, t: Scalar, y: State) -> Scalar:
    return scene.equations.strain_energy(y.q)


def _jacobi(scene: Scene, t: Scalar, y: State) -> Scalar:
    return sum(scene.energies(t, y))  # type: ignore[return-value]


@Program
def _peak(run: Simulation, direction: int, xi: float) -> tuple[Scalar, Scalar]:
    valid, times, state = run._outputs(run.status == Status.OK)

    def place(q: Vector) -> Scalar:
        return run.scene.equations.displacement(q, np.array([xi]))[0, direction]

    def both(y: State) -> tuple[Scalar, Scalar]:
        return jax.jvp(place, (y.q,), (y.v,))

    u, rate = jax.vmap(both)(state)
    t, h = times[:-1], jnp.diff(times)
    s, value = jax.vmap(_extremes)(u[:-1], h * rate[:-1], u[1:], h * rate[1:])
    between = valid[:-1] & valid[1:]
    at = jnp.argmax(jnp.where(between[:, None], jnp.abs(value), -1.0))
    found = value.ravel()[at], (t[:, None] + h[:, None] * s).ravel()[at]
    return nan_unless(jnp.any(between), found)


def _extremes(u0: Scalar, v0: Scalar, u1: Scalar, v1: Scalar) -> tuple[Vector, Vector]:
    """Where in [0, 1] the cubic of these values and slopes can be extreme, and its values there."""
    rise = u1 - u0
    a, b = v0 + v1 - 2 * rise, 3 * rise - 2 * v0 - v1
    # Roots of v0 + 2 b s + 3 a s^2, in the form that does not cancel. They carry no derivative:
    # where an extremum is does not matter to the derivative of its value.
    half = -b - jnp.copysign(jnp.sqrt(jnp.maximum(b**2 - 3 * a * v0, 0.0)), b)
    roots = half / jnp.where(a == 0, 1.0, 3 * a), v0 / jnp.where(half == 0, 1.0, half)
    s = jax.lax.stop_gradient(jnp.stack([jnp.zeros_like(a), jnp.ones_like(a), *roots]))
    s = jnp.clip(s, 0.0, 1.0)
    return s, u0 + s * (v0 + s * (b + s * a))
