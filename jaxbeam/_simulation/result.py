"""What comes out of a simulation, computed when asked for."""

import dataclasses
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._programs.program import Program
from jaxbeam._results import asked_with, finite_rows, harmless, nan_unless, per_case
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._simulation.along_span import AlongSpan, Instant, points_of
from jaxbeam._simulation.scene import Scene
from jaxbeam._solvers.system import State
from jaxbeam._status import Status, in_range, trusted
from jaxbeam._types import Coordinates, Scalar, Vector


class Simulation(AlongSpan):
    """The course of a scene in time: T times, n coordinates, p points.

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
    axial, in plane, flap, from the undeformed place; points are given as xi = x / L. Along the span
    there are `displacement`, `rotation`, `strain`, `curvature`, `torsion`, `section_force` and
    `section_moment`; `tip`, `hub_force`, `hub_torque` and energies by time.

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
        """The run so far, which answers whatever its status.

        That is the history up to where it got, and the peak of that; NaN where parameters are out
        of range, since then nothing was simulated.
        """
        return dataclasses.replace(self, is_partial=True)

    @property
    @per_case
    def energy(self) -> Float[Array, " T"]:
        """Kinetic energy in the inertial frame plus strain energy, in J."""
        return self._each(_energy)

    @property
    @per_case
    def jacobi_integral(self) -> Float[Array, " T"]:
        """Kinetic energy seen from the hub, centrifugal potential and strain energy, in J."""
        return self._each(_jacobi)

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

    def _each(self, function: Callable[..., Any], *xi: float) -> Any:
        return _mapped(self, function, xi)

    def _outputs(self, fine: Array) -> tuple[Array, Array, State]:
        """The mask of outputs that may be used, given that the status is `fine`, with times and
        states, harmless ones in the place of others: NaN would come into gradients by parameters of
        the scene.

        Cases out of range ran with harmless numbers, and have no outputs that may be used.

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
    # NaN of a case that failed would come into gradients by parameters of its rotor that other
    # cases share.
    scene, rotor = run.scene, harmless(in_range(run.status), run.rotor)
    valid, times, state = run._outputs(trusted(run.status))

    def one(t: Scalar, y: State) -> Any:
        return function(Instant(scene, rotor, scene.after(t), y), *xi)

    found = jax.vmap(one)(times, state)
    return nan_unless(valid, found)


def checked_point(direction: int, xi: float) -> tuple[int, float]:
    whole = isinstance(direction, int | np.integer) and not isinstance(direction, bool)
    if not whole or direction not in (0, 1, 2):
        raise ValueError(f"direction must be 0 (axial), 1 (in plane) or 2 (flap), got {direction}")
    points = points_of(xi)
    if len(points) != 1:
        raise ValueError(f"xi must be one number in [0, 1], got {xi}")
    return int(direction), points[0]


def _energy(now: Instant) -> Scalar:
    return now.scene.total_energy(now.t, now.y)


def _jacobi(now: Instant) -> Scalar:
    return sum(now.scene.energies(now.t, now.y))  # type: ignore[return-value]


@Program
def _peak(run: Simulation, direction: int, xi: float) -> tuple[Scalar, Scalar]:
    valid, times, state = run._outputs(run.status == Status.OK)

    def place(q: Coordinates) -> Scalar:
        return run.scene.equations.displacement(q, np.array([xi]))[0, direction]

    def both(y: State) -> tuple[Scalar, Scalar]:
        return jax.jvp(place, (y.q,), (run.scene.equations.kinematics(y.q, y.v),))

    u, rate = jax.vmap(both)(state)
    t, h = times[:-1], jnp.diff(times)
    s, value = jax.vmap(_extremes)(u[:-1], h * rate[:-1], u[1:], h * rate[1:])
    between = valid[:-1] & valid[1:]
    at = jnp.argmax(jnp.where(between[:, None], jnp.abs(value), -1.0))
    found = value.ravel()[at], (t[:, None] + h[:, None] * s).ravel()[at]
    return nan_unless(jnp.any(between), found)


def _extremes(u0: Scalar, v0: Scalar, u1: Scalar, v1: Scalar) -> tuple[Vector, Vector]:
    """The places in [0, 1] at which a cubic, with these values and slopes at both ends, may have an
    extremum, and its values there."""
    rise = u1 - u0
    a, b = v0 + v1 - 2 * rise, 3 * rise - 2 * v0 - v1
    # Roots of v0 + 2 b s + 3 a s^2 in a form without cancellation. They have no derivatives: the
    # value at an extremum does not change by moving its place.
    half = -b - jnp.copysign(jnp.sqrt(jnp.maximum(b**2 - 3 * a * v0, 0.0)), b)
    roots = half / jnp.where(a == 0, 1.0, 3 * a), v0 / jnp.where(half == 0, 1.0, half)
    s = jax.lax.stop_gradient(jnp.stack([jnp.zeros_like(a), jnp.ones_like(a), *roots]))
    s = jnp.clip(s, 0.0, 1.0)
    return s, u0 + s * (v0 + s * (b + s * a))
