"""Motions in time: a model on a moving hub, integrated with diffrax."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Array, Float

from jaxbeam._beam import checked_rotor, positive
from jaxbeam._loads import Damping, Loads
from jaxbeam._models.base import AbstractModel, equilibrium
from jaxbeam._motion import Motion
from jaxbeam._scene import Scene, check_scene, check_start, checked_times, input_status
from jaxbeam._solvers.rodas import Rodas5P
from jaxbeam._solvers.system import State, second_order_term, without_derivatives
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Scalar, Vector


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
    | scene      |        |      | what was simulated                                            |

    Everything else is computed when asked for. Displacements are in the hub frame, components
    axial, in plane, flap, from the undeformed place; points are given as xi = x / L.
    """

    times: Float[Array, " T"]
    state: State
    imbalance: Float[Array, " T"]
    status: Code
    end_time: Scalar
    solution: diffrax.Solution
    scene: Scene

    def displacement(self, xi: Any = 1.0) -> Float[Array, "T p 3"]:
        """Displacement of the points xi, in m."""
        return self._each(_displacement, *_points(xi))

    @property
    def tip(self) -> Float[Array, "T 3"]:
        """Displacement of the tip, in m."""
        return self.displacement()[:, 0]

    def strain(self, xi: Any = 0.0) -> Float[Array, "T p"]:
        """Axial strain of the centre line."""
        return self._each(_strain, *_points(xi))

    def curvature(self, xi: Any = 0.0) -> Float[Array, "T p 2"]:
        """In-plane and flap curvature, in 1/m: surface strain is the axial one less y times it."""
        return self._each(_curvature, *_points(xi))

    @property
    def strain_energy(self) -> Float[Array, " T"]:
        """In J."""
        return self._each(_strain_energy)

    @property
    def energy(self) -> Float[Array, " T"]:
        """Kinetic energy in the inertial frame plus strain energy, in J."""
        return self._each(Scene.total_energy)

    @property
    def jacobi_integral(self) -> Float[Array, " T"]:
        """Kinetic energy seen from the hub, centrifugal potential and strain energy, in J."""
        return self._each(_jacobi)

    @property
    def hub_force(self) -> Float[Array, "T 3"]:
        """Force of the hub on the beam, in N, hub axes."""
        return self._each(Scene.reaction)[0]

    @property
    def hub_torque(self) -> Float[Array, "T 3"]:
        """Moment of the hub on the beam about the centre of the hub, in N m, hub axes."""
        return self._each(Scene.reaction)[1]

    def peak(self, component: int = 1, xi: float = 1.0) -> tuple[Scalar, Scalar]:
        """Largest deflection either way (m, with its sign) of a point, and when (s).

        Between output times by cubic interpolation with the rates, exact to fourth order.
        Components 0, 1, 2 are axial, in plane, flap. The value is differentiable; the time carries
        no derivative.
        """
        if self.times.size < 2:
            raise ValueError("peak needs two or more output times")
        return _peak(self, *_checked_point(component, xi))

    def _each(self, function: Any, *xi: float) -> Any:
        return _mapped(function, self.scene, self.times, self.state, xi)


@eqx.filter_jit
def _mapped(function: Any, scene: Scene, times: Array, state: State, xi: tuple[float, ...]) -> Any:
    return jax.vmap(lambda t, y: function(scene, t, y, *xi))(times, state)


def _points(xi: Any) -> tuple[float, ...]:
    points = np.atleast_1d(np.asarray(xi, float))
    if points.ndim != 1 or not ((points >= 0) & (points <= 1)).all():
        raise ValueError(f"xi must be a number or a list of numbers in [0, 1], got {xi}")
    return tuple(points.tolist())


def _checked_point(component: int, xi: float) -> tuple[int, float]:
    if component not in (0, 1, 2):
        raise ValueError(f"component must be 0 (axial), 1 (in plane) or 2 (flap), got {component}")
    (point,) = _points(xi)
    return component, point


def _displacement(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, "p 3"]:
    return scene.equations.displacement(y.q, np.array(xi))


def _strain(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, " p"]:
    return scene.equations.strain(y.q, np.array(xi))


def _curvature(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, "p 2"]:
    return scene.equations.curvature(y.q, np.array(xi))


def _strain_energy(scene: Scene, t: Scalar, y: State) -> Scalar:
    return scene.equations.strain_energy(y.q)


def _jacobi(scene: Scene, t: Scalar, y: State) -> Scalar:
    return sum(scene.energies(t, y))  # type: ignore[return-value]


@eqx.filter_jit
def _peak(run: Simulation, component: int, xi: float) -> tuple[Scalar, Scalar]:
    def place(q: Vector) -> Scalar:
        return run.scene.equations.displacement(q, np.array([xi]))[0, component]

    def both(y: State) -> tuple[Scalar, Scalar]:
        return jax.jvp(place, (y.q,), (y.v,))

    u, rate = jax.vmap(both)(run.state)
    t, h = run.times[:-1], jnp.diff(run.times)
    s, value = jax.vmap(_extremes)(u[:-1], h * rate[:-1], u[1:], h * rate[1:])
    at = jnp.argmax(jnp.where(jnp.isnan(value), -1.0, jnp.abs(value)))
    return value.ravel()[at], (t[:, None] + h[:, None] * s).ravel()[at]


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


def simulate(
    model: AbstractModel,
    rotor: Any,
    motion: Motion,
    times: Any,
    *,
    loads: Loads | None = None,
    damping: Damping | None = None,
    start: State | None = None,
    solver: diffrax.AbstractSolver | None = None,
    stepsize_controller: diffrax.AbstractStepSizeController | None = None,
    dt0: Any = None,
    saveat: diffrax.SaveAt | None = None,
    adjoint: diffrax.AbstractAdjoint | None = None,
    event: diffrax.Event | None = None,
    progress_meter: diffrax.AbstractProgressMeter | None = None,
    max_steps: int | None = 100_000,
    balance_tolerance: float = 1e-3,
    throw: bool = True,
) -> Simulation:
    """Integrate a model through a motion of its hub, from times[0] to times[-1] (s, increasing).

    By default the beam starts undeformed and at rest in the hub (`start`: see `steady_start`, or
    give a `State`), `Rodas5P` integrates with relative tolerance 1e-6, and the state is saved at
    `times`. `solver`, `stepsize_controller`, `dt0`, `saveat`, `adjoint`, `event`, `progress_meter`
    and `max_steps` are those of `diffrax.diffeqsolve`; functions in them see t, the `State` and the
    `Scene`. Numbers in them compile anew when they change, arrays (`rtol=jnp.asarray(1e-8)`) do
    not. With an `event`, a last output at the end of the run comes on top. With a `saveat` of
    another shape than that of a state (`fn`, `subs`), take the result from `Simulation.solution`;
    nothing is then judged but whether the solver gave up.

    Reverse mode works as it is, forward mode with `adjoint=diffrax.ForwardMode()`. Write one case;
    `jax.vmap` or `jaxbeam.sweep` batch it. `throw=False` keeps failures in `Simulation.status`:

    - the parameters, the motion or the loads are out of range, or leave the plane of the model;
    - the solver gave up (`MAX_STEPS`, `STEP_FAILED`), or its result is not finite;
    - the tip went farther than ten lengths: `DIVERGED`. The run ends there, and what came before is
      kept. With an `event` of your own it goes on;
    - the energy is out of balance with the work done by more than `balance_tolerance` times the
      largest energy (`UNBALANCED`; the numbers are kept): a loose tolerance with an explicit solver
      can return a success that is nonsense.
    """
    rotor = checked_rotor(model.rotor_type, rotor)
    times = checked_times(times)
    loads = Loads() if loads is None else loads
    damping = Damping() if damping is None else damping
    check_scene(motion, loads, damping, times[0])
    if start is not None:
        check_start(model, start)
    if saveat is not None:
        _check_saveat(saveat, times)
    result = _simulate(
        model, rotor, motion, times, loads, damping, start,
        Rodas5P() if solver is None else solver,
        stepsize_controller, dt0, saveat,
        diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint,
        event,
        diffrax.NoProgressMeter() if progress_meter is None else progress_meter,
        max_steps,
        balance_tolerance,
    )  # fmt: skip
    return raise_unless_ok(result, result.status) if throw else result


@eqx.filter_jit
def _simulate(
    model: AbstractModel, rotor: Any, motion: Motion, times: Array, loads: Loads, damping: Damping,
    start: State | None, solver: diffrax.AbstractSolver,
    controller: diffrax.AbstractStepSizeController | None, dt0: Any,
    saveat: diffrax.SaveAt | None, adjoint: diffrax.AbstractAdjoint, event: diffrax.Event | None,
    progress_meter: diffrax.AbstractProgressMeter, max_steps: int | None, balance_tolerance: float,
) -> Simulation:  # fmt: skip
    given = input_status(model, rotor, motion, loads, damping, times)
    fine = given == Status.OK
    # A NaN in one lane of a batch would keep all others waiting, and end up in gradients of
    # parameters that lanes share: harmless values take its place.
    rotor, motion, loads, damping = jax.tree.map(
        lambda leaf: jnp.where(fine, leaf, 1.0) if eqx.is_inexact_array(leaf) else leaf,
        (rotor, motion, loads, damping),
    )
    times = jnp.where(fine, times, jnp.linspace(0.0, 1.0, times.size))
    if saveat is None:
        saveat = diffrax.SaveAt(ts=times, t1=event is not None)
    now = Scene(model, rotor, motion, loads, damping)
    n = len(model.families)
    if start is None:
        zero = jnp.zeros(n, times.dtype)
        y0 = State(zero, zero, jnp.zeros((), times.dtype))
    else:
        y0 = State(start.q, start.v, jnp.zeros((), times.dtype))
        started = jnp.all(jnp.isfinite(start.q)) & jnp.all(jnp.isfinite(start.v))
        given = jnp.where(fine & ~started, Status.INVALID_START, given)
        y0 = jax.tree.map(lambda leaf: jnp.where(started, leaf, 0.0), y0)
    if controller is None:
        controller = diffrax.PIDController(
            rtol=1e-6,
            atol=1e-7 * now.equations.size,
            dtmin=1e-12 * (times[-1] - times[0]),  # where forces are NaN, do not go on for ever
            force_dtmin=False,
        )
    solution = diffrax.diffeqsolve(
        second_order_term(solver), solver, times[0], times[-1], dt0, y0, now, saveat=saveat,
        stepsize_controller=controller, adjoint=adjoint,
        event=diffrax.Event(_runaway) if event is None else event, max_steps=max_steps,
        progress_meter=progress_meter, throw=False,
    )  # fmt: skip
    ended = _solver_status(solution.result, event is None)
    at, state = _saved(solution, times, n)
    reached = jnp.isfinite(at)
    state = jax.tree.map(lambda a: jnp.where(_beside(reached, a), a, jnp.nan), state)
    safe = jax.tree.map(jnp.nan_to_num, state)
    when = jnp.where(reached, at, times[0])
    imbalance, far = _account(*without_derivatives((now, times[0], y0, when, safe)))

    status = jnp.asarray(Status.OK)
    unbalanced = jnp.any(reached & ~(jnp.abs(imbalance) <= balance_tolerance))
    status = jnp.where(unbalanced, Status.UNBALANCED, status)
    status = jnp.where(jnp.any(reached & far), Status.DIVERGED, status)
    finite = jax.tree.map(lambda a: jnp.all(jnp.isfinite(a) | ~_beside(reached, a)), state)
    status = jnp.where(jax.tree.reduce(jnp.logical_and, finite), status, Status.NOT_FINITE)
    status = jnp.where(ended != Status.OK, ended, status)
    status = jnp.where(given != Status.OK, given, status)
    return Simulation(
        times=jnp.where(reached, at, jnp.nan),
        state=state,
        imbalance=jnp.where(reached, imbalance, jnp.nan),
        status=status,
        end_time=jnp.max(when, initial=times[0]),
        solution=solution,
        scene=now,
    )


def _beside(mask: Array, values: Array) -> Array:
    """`mask` with axes of length one, to stand beside `values`."""
    return mask.reshape(-1, *(1,) * (values.ndim - 1))


def _account(
    scene: Scene, t0: Scalar, y0: State, times: Array, states: State
) -> tuple[Array, Array]:
    """Change of energy less work over the largest energy, and whether the tip is too far away."""

    def one(t: Scalar, y: State) -> tuple[Scalar, Scalar, Array]:
        parts = jnp.stack(scene.energies(t, y))
        balance = jnp.sum(parts) - scene.work_unit * y.work
        return balance, jnp.sum(jnp.abs(parts)), _far(scene, y)

    balance0, size0, _ = one(t0, y0)
    balance, size, far = jax.vmap(one)(times, states)
    largest = jnp.maximum(jnp.max(size, initial=0.0), size0)
    return (balance - balance0) / jnp.where(largest > 0, largest, 1.0), far


def _saved(solution: diffrax.Solution, times: Array, n: int) -> tuple[Array, State]:
    if isinstance(solution.ys, State):
        assert solution.ts is not None
        return solution.ts, solution.ys
    if solution.interpolation is not None:
        reached = times <= solution.interpolation.t1
        return jnp.where(reached, times, jnp.inf), jax.vmap(solution.evaluate)(times)
    none = jnp.zeros((0, n), times.dtype)
    return none[:, 0], State(none, none, none[:, 0])


def _runaway(t: Scalar, y: State, args: Scene, **_: Any) -> Array:
    """Nothing is to be had beyond: do not let a batch wait for it."""
    return _far(args, y)


def _far(scene: Scene, y: State) -> Array:
    return jnp.linalg.norm(scene.equations.tip(y.q)) > 10 * scene.equations.size


def _solver_status(result: Any, event_means_runaway: bool) -> Code:
    status = jnp.asarray(Status.STEP_FAILED)
    for code, meaning in (
        (diffrax.RESULTS.successful, Status.OK),
        (diffrax.RESULTS.event_occurred, Status.DIVERGED if event_means_runaway else Status.OK),
        (diffrax.RESULTS.max_steps_reached, Status.MAX_STEPS),
    ):
        status = jnp.where(result == code, meaning, status)
    return status


def _check_saveat(saveat: diffrax.SaveAt, times: Array) -> None:
    for sub in jax.tree.leaves(saveat.subs, is_leaf=lambda s: isinstance(s, diffrax.SubSaveAt)):
        if sub.ts is None or any(isinstance(a, jax.core.Tracer) for a in (sub.ts, times)):
            continue
        if not np.all((sub.ts >= times[0]) & (sub.ts <= times[-1])):
            raise ValueError("saveat must save within times[0] and times[-1]")


def steady_start(
    model: AbstractModel,
    rotor: Any,
    motion: Motion,
    t: Any = 0.0,
    *,
    loads: Loads | None = None,
    throw: bool = True,
) -> State:
    """The state in which the beam rests in the hub if the hub went on as it moves at time t.

    Rates of the hub's velocities are left out. Displacements of a state are
    `model.equations(rotor).displacement(state.q, xi)`, xi an array. Raises `RuntimeError` where
    no such state is found; with `throw=False` its coordinates are then NaN, which `simulate`
    reports. An equilibrium need not be stable: ask `modes`.
    """
    rotor = checked_rotor(model.rotor_type, rotor)
    t = jnp.asarray(t, jnp.result_type(float))
    loads = Loads() if loads is None else loads
    check_scene(motion, loads, Damping(), t)
    state, status = _steady(model, rotor, motion, t, loads)
    return raise_unless_ok(state, status) if throw else state


@eqx.filter_jit
def _steady(
    model: AbstractModel, rotor: Any, motion: Motion, t: Scalar, loads: Loads
) -> tuple[State, Code]:
    given = input_status(model, rotor, motion, loads, Damping(), t[None])
    hub = motion.hub(t, loads.gravity)
    zero = jnp.zeros(3, t.dtype)
    hub = hub._replace(velocity_rate=zero, angular_velocity_rate=zero)
    q, status = equilibrium(model.equations(rotor), hub, loads.at_tip(t))
    status = jnp.where(given == Status.OK, status, given)
    q = jnp.where(status == Status.OK, q, jnp.nan)
    return State(q, jnp.zeros_like(q), jnp.zeros((), t.dtype)), status


def deflection_limit(limit: Any, component: int = 1, xi: float = 1.0) -> diffrax.Event:
    """Event that ends a run where a deflection reaches `limit` (m) either way, to rounding in time.

    `component` 0, 1, 2: axial, in plane, flap, of the point xi. The last output is at the event.
    """
    return diffrax.Event(
        _Limit(positive("limit", limit), *_checked_point(component, xi)),
        optimistix.Newton(rtol=1e-10, atol=1e-10),
    )


class _Limit(eqx.Module):
    limit: Scalar
    component: int = eqx.field(static=True)
    xi: float = eqx.field(static=True)

    def __call__(self, t: Scalar, y: State, args: Scene, **_: Any) -> Scalar:
        u = args.equations.displacement(y.q, np.array([self.xi]))[0, self.component]
        return self.limit - jnp.abs(u)
