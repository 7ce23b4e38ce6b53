"""Motions in time: a model on a moving hub, integrated with diffrax."""

import dataclasses
import functools
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import count_functions, real_scalar
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.equations import forces_are_resolved
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, finite_rows, nan_unless, without_derivatives
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping
from jaxbeam._rotor.first_look import is_finite, refuse
from jaxbeam._rotor.loads import NO_LOADS, Loads, bending
from jaxbeam._rotor.motion import Hub, Motion
from jaxbeam._simulation.checks import (
    Seen,
    check_kinds,
    check_scene,
    checked_start,
    checked_times,
    increasing,
    scene_status,
)
from jaxbeam._simulation.first_short import first_short
from jaxbeam._simulation.following import MOTION_MISSED, AfterImpulse, following
from jaxbeam._simulation.integration import (
    Calendar,
    EnergySamples,
    by_diffrax,
    held_within,
    integrate,
    is_far,
)
from jaxbeam._simulation.result import Simulation
from jaxbeam._simulation.scene import Scene
from jaxbeam._simulation.step_limits import SAMPLES, StepLimits, during
from jaxbeam._solvers.rodas import Rodas5P
from jaxbeam._solvers.steps import SecondOrderSolver, run_core
from jaxbeam._solvers.system import State
from jaxbeam._status import Status, first_broken, first_failure, in_range
from jaxbeam._types import Code, Scalar, is_concrete


def simulate(
    model: AbstractModel,
    rotor: AnyRotor,
    motion: Motion,
    times: Any,
    *,
    loads: Loads = NO_LOADS,
    damping: Damping = NO_DAMPING,
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

    `model` is a theory such as `Hybrid()`, `rotor` a `Rotor` (a `SpringRotor` for the discrete
    ones), `motion` how its hub moves (`SmoothSpinUp`, `jb.motions`), `times` (T,) two at least;
    `loads` and `damping` as in `Loads` and `Damping`. Returns a `Simulation`.

    By default the beam starts undeformed and at rest in the hub (`start`: see `steady_start`, or
    give a `State`), `Rodas5P` integrates with tolerance 1e-6 (1e-7 in a `SpatialRod`), relative to
    the state and to the deflection to expect (the largest static one under the loads), and the
    state is saved at `times`. `solver`, `stepsize_controller`, `dt0`, `saveat`, `adjoint`, `event`,
    `progress_meter` and `max_steps` are those of `diffrax.diffeqsolve`; functions in them see t,
    the `State` and the `Scene`; solvers and controllers of your own see time counted from times[0].
    Numbers in them compile anew when they change, arrays (`rtol=jnp.asarray(1e-8)`) do not. With an
    `event`, a last output at the end of the run comes on top. With a `saveat` of another shape than
    that of a state (`fn`, `subs`), take the result from `Simulation.solution`; nothing is then
    judged but whether the solver gave up.

    Steps follow the motion and the loads, whatever controller asks for them: they are no longer
    than an event that lasts a thousandth of the run or more, wherever it is; they end at the times
    that motion and loads declare (`Motion.change_times`, `Motion.jump_times`, `Loads`), at which
    also the shortest event is seen, and the beam gets the impulse of a jump of the hub's velocity;
    and a step in which the hub's velocity changes by other than the integral of its rate is made
    anew and shorter. `BacksolveAdjoint` has none of this: give its controller a `dtmax`.

    Reverse mode works as it is, forward mode with `adjoint=diffrax.ForwardMode()`. Write one case;
    `jax.vmap` or `jaxbeam.sweep` batch it. `throw=False` keeps failures in `Simulation.status`;
    what is asked of a run that failed is NaN from there on, or throughout (see `Simulation`):

    - the parameters, the motion or the loads are out of range, or leave the plane of the model;
    - the solver gave up (`MAX_STEPS`, `STEP_FAILED`), or its result is not finite;
    - the tip went farther than ten lengths: `DIVERGED`. The run ends there, and what came before is
      kept. With an `event` of your own, or `BacksolveAdjoint`, it goes on;
    - the hub's velocity jumps, by more than 1e-5 of its largest, where no jump is declared
      (`UNRESOLVED`): the run ends there, and what came before is kept;
    - sections of an element in space turn against each other by more than its polynomials follow
      (`OUT_OF_RANGE`);
    - of a `SpatialRod`: forces in sections are on average to a tenth or more in the highest third
      of its polynomials (`TOO_FEW_FUNCTIONS`);
    - the energy is out of balance with the work done by more than `balance_tolerance` times the
      largest energy (`UNBALANCED`): a loose tolerance with an explicit solver can return a success
      that is nonsense.

    Raises `ValueError` or `TypeError` for a malformed argument and, with `throw`, `ValueError` for
    the first of these (under `jit` `RuntimeError`) and `RuntimeError` for the others.
    """
    model, rotor, _ = checked_case(model, rotor)
    times = checked_times(times)
    check_scene(motion, loads, damping, times[0], (model, rotor), throw)
    if start is not None:
        start = checked_start(model.in_motion(rotor)[0], start)
        refuse(throw, (is_finite(start.q, start.v), Status.INVALID_START))
    if max_steps is not None:
        count_functions("max_steps", max_steps, least=1)
    real_scalar("balance_tolerance", balance_tolerance)
    if dt0 is not None:
        forward = real_scalar("dt0", dt0)
        refuse(throw, (not is_concrete(forward) or float(forward) > 0, Status.INVALID_TIMES))
    check_kinds(
        solver=solver, stepsize_controller=stepsize_controller, saveat=saveat, adjoint=adjoint,
        event=event, progress_meter=progress_meter,
    )  # fmt: skip
    jumps = motion.jump_times().size or loads.jump_times().size
    if isinstance(adjoint, diffrax.BacksolveAdjoint) and (solver is None or event or jumps):
        raise ValueError(
            "BacksolveAdjoint integrates another system backwards and bears neither events nor "
            "jumps: give a solver that takes any system (diffrax.Kvaerno5(), ...) and none of these"
        )
    result = first_short(
        _simulate, max_steps, model, rotor, motion, times, loads, damping, start,
        Rodas5P() if solver is None else solver,
        stepsize_controller, dt0, saveat,
        adjoint, event, progress_meter, balance_tolerance,
    )  # fmt: skip
    return dataclasses.replace(finish(result, throw), model=model, rotor=rotor)


@functools.partial(Program, level=3)  # a run that is made again is long
def _simulate(
    model: AbstractModel, rotor: AnyRotor, motion: Motion, times: Array, loads: Loads,
    damping: Damping, start: State | None, solver: diffrax.AbstractSolver,
    controller: diffrax.AbstractStepSizeController | None, dt0: Any,
    saveat: diffrax.SaveAt | None, adjoint: diffrax.AbstractAdjoint | None,
    event: diffrax.Event | None, progress_meter: diffrax.AbstractProgressMeter | None,
    balance_tolerance: float, max_steps: int | None,
) -> Simulation:  # fmt: skip
    given, (rotor, motion, loads, damping, seen) = scene_status(
        model, rotor, motion, loads, damping, times, during(times, SAMPLES)
    )
    # Only bad output times are replaced: a `saveat` and a controller may hold others that go with
    # good ones.
    times = jnp.where(increasing(times), times, np.linspace(0.0, 1.0, times.size))
    if saveat is not None:
        saveat, within = held_within(saveat, times)
        given = first_failure(given, first_broken((within, Status.INVALID_TIMES)))
    if dt0 is not None:  # diffrax raises for a negative first step
        forward = jnp.isfinite(dt0) & (dt0 > 0)
        given = first_failure(given, first_broken((forward, Status.INVALID_TIMES)))
        dt0 = jnp.where(forward, dt0, times[-1] - times[0])
    moving, own = model.in_motion(rotor)
    now = Scene(moving, own, motion, loads, damping, times)
    if start is None:
        q, v = (jnp.zeros(size, times.dtype) for size in moving.sizes)
        y0 = State(q, v)
    else:
        started = jnp.all(jnp.isfinite(start.q)) & jnp.all(jnp.isfinite(start.v))
        given = first_failure(given, first_broken((started, Status.INVALID_START)))
        y0 = jax.tree.map(lambda leaf: jnp.where(started, leaf, 0.0), start)
    size, moment = _yardstick(*without_derivatives((rotor, now, y0, seen, times[0])))
    if dt0 is None and isinstance(controller, _CHOOSING | None):
        dt0 = moment
    if controller is None:
        controller = adaptive(model.step_tolerance, model.step_tolerance * size, times)
    how = (solver, controller, dt0, event, max_steps, adjoint)
    history = _integrated(now, y0, times, (seen, moment), how, saveat, progress_meter)
    return _judged(given, now, history, balance_tolerance)


class _History(NamedTuple):
    """The outputs of a run before they are judged."""

    start: State
    reached: Array  # whether each output time was reached, (T,)
    times: Array  # times of outputs, NaN where not reached
    state: State  # states at outputs, NaN where not reached
    calendar: Calendar
    scene: Scene  # the scene by the time since the origin of the calendar
    watch: EnergySamples  # states along the run, for the balance of energy
    ended: Code  # result code of the solver
    solution: diffrax.Solution


def adaptive(rtol: Any, atol: Any, times: Array) -> diffrax.PIDController:
    """A step-size controller for a run over `times` to these tolerances, relative and absolute."""
    return diffrax.PIDController(
        rtol=rtol,
        atol=atol,
        dtmin=1e-12 * (times[-1] - times[0]),  # ends runs whose forces are NaN
        force_dtmin=False,
    )


def _integrated(
    now: Scene, y0: State, times: Array, seen: tuple[Seen, Scalar], how: tuple[Any, ...],
    saveat: diffrax.SaveAt | None, progress_meter: diffrax.AbstractProgressMeter | None,
) -> _History:  # fmt: skip
    """A run by our own loop, or by diffrax where features are asked for that our loop has not."""
    solver, controller, dt0, event, max_steps, adjoint = how
    ours = isinstance(solver, SecondOrderSolver) and isinstance(adjoint, diffrax.ForwardMode | None)
    # This adjoint takes no wrapped solver, controller or event.
    backsolved = isinstance(adjoint, diffrax.BacksolveAdjoint)
    # Time is counted from the beginning of the run, since late times are rounded.
    calendar = Calendar(times, without_derivatives(times[0]))
    scene = now.since(calendar.origin)
    event, controller = calendar.event(event), calendar.controller(controller)
    if not backsolved:
        controller = following(controller, StepLimits(scene, times, *seen))
    if now.pauses.sided:
        solver = AfterImpulse(solver)
    if now.has_jumps:
        start = calendar.since[0]
        jumped = scene.pauses.jumped(without_derivatives(start))
        y0 = jax.lax.cond(jumped, lambda: scene.after_impulse(start, y0), lambda: y0)
    how = (scene, y0, calendar, solver, controller, dt0, event, max_steps, adjoint)
    if ours and saveat is None and progress_meter is None:
        solution, watch = integrate(*how)
    else:
        solution, watch = by_diffrax(*how, saveat, progress_meter)
    ended = _solver_status(solution.result, event is None and not backsolved)
    at, state = _saved(solution, times, y0.q.size)
    if saveat is None:  # the output times as given, not rounded by adding the origin again
        own = at[: times.size]
        rounding = 16 * jnp.finfo(times.dtype).eps * jnp.max(jnp.abs(times))
        at = at.at[: times.size].set(jnp.where(jnp.abs(own - times) <= rounding, times, own))
    reached = jnp.isfinite(at)
    state = jax.tree.map(lambda a: jnp.where(_beside(reached, a), a, jnp.nan), state)
    return _History(y0, reached, at, state, calendar, scene, watch, ended, solution)


def _judged(given: Code, now: Scene, run: _History, balance_tolerance: float) -> Simulation:
    """The result of a run, with the first status that is not OK: of the arguments (`given`), of the
    solver, or of the states it returned."""
    reached, at, state, t0 = run.reached, run.times, run.state, run.calendar.times[0]
    saved = at - run.calendar.origin, state
    imbalance, near, fits, followed = _account(
        *without_derivatives((run.scene, run.start, saved, run.watch))
    )
    finite = finite_rows(jnp.concatenate([state.q, state.v, state.work[:, None]], 1))
    balanced = jnp.abs(imbalance) <= balance_tolerance
    # Together, since `jnp.all` of each one separately takes programs of its own to compile.
    finite, balanced = jnp.all(~reached[None] | jnp.stack([finite, balanced]), 1)
    numbers = first_broken(
        (finite, Status.NOT_FINITE), (near, Status.DIVERGED), (fits, Status.OUT_OF_RANGE),
        (balanced, Status.UNBALANCED), (followed, Status.TOO_FEW_FUNCTIONS),
    )  # fmt: skip
    status = first_failure(given, run.ended, numbers)
    # A case out of range ran with harmless numbers, whose results are not used.
    simulated = in_range(given)
    end_time = jnp.max(jnp.where(reached, at, t0), initial=t0)
    at, imbalance = nan_unless(reached & simulated, (at, imbalance))
    return Simulation(
        times=at,
        state=nan_unless(simulated, state),
        imbalance=imbalance,
        status=status,
        end_time=nan_unless(simulated, end_time),
        solution=run.solution,
        scene=now,
    )


# Controllers that choose the first step themselves. diffrax's way to do so does not know the scene.
_CHOOSING = diffrax.PIDController | diffrax.ClipStepSizeController


def _beside(mask: Array, values: Array) -> Array:
    """A `mask` with axes of length one behind its own, so that it broadcasts over `values`."""
    return mask.reshape(-1, *(1,) * (values.ndim - 1))


def _account(
    scene: Scene, y0: State, saved: tuple[Array, State], watch: EnergySamples
) -> tuple[Array, Array, Array, Array | bool]:
    """The energy residual of outputs, which is the change of energy less work over the largest
    energy; and, of all states along the run, whether no tip is too far away, no element is beyond
    its range, and whether functions are enough for the forces, on average."""
    start = jnp.zeros_like(saved[0], shape=1), jax.tree.map(lambda a: a[None], y0)
    parts = [saved, start] if watch is None else [saved, start, watch]
    times, states = jax.tree.map(lambda *a: jnp.concatenate(a), *parts)
    reached = jnp.isfinite(times)
    states = jax.tree.map(
        lambda a: jnp.where(_beside(reached, a) & jnp.isfinite(a), a, 0.0), states
    )

    def one(t: Scalar, y: State) -> tuple[Scalar, Scalar, Array, Any]:
        parts = run_core(_parts, None, scene, scene.hub(scene.after(t)), y)
        balance = jnp.sum(parts) - scene.work_unit * y.work
        good = jnp.stack([~is_far(scene, y), scene.equations.is_in_range(y.q)])
        return balance, jnp.sum(jnp.abs(parts)), good, scene.equations.high_share(y.q)

    balance, size, good, share = jax.vmap(one)(jnp.where(reached, times, 0.0), states)
    # Energies of motions this small (1e-60 lengths) are near the smallest float, and may be zero in
    # one part of the program and not in another.
    least = scene.equations.energy_scale * jnp.finfo(size.dtype).tiny ** 0.4
    n, largest = saved[0].size, jnp.maximum(jnp.max(size), least)
    near, fits = jnp.all(good, 0)
    followed = forces_are_resolved(jax.tree.map(jnp.sum, share))
    relative = (balance[:n] - balance[n]) / jnp.where(largest > 0, largest, 1.0)
    return relative, near, fits, followed


def _parts(_: None, scene: Scene, hub: Hub, y: State) -> Float[Array, "3 *lanes"]:
    return jnp.stack(scene.energies_in(hub, y))


def _yardstick(
    rotor: AnyRotor, scene: Scene, y0: State, seen: Seen, start: Scalar
) -> tuple[Scalar, Scalar]:
    """A deflection of the size to expect, in m, for the tolerance: the largest static one under the
    loads `seen`, by that of a uniform load of the same moment about the root, that at the start, or
    that of the first mode after a jump; at least 1e-6 and at most 0.1 lengths. And a time within
    which the first mode moves, in s."""
    equations, (hub, force, span) = scene.equations, seen
    (mass, first, second), radius = equations.rigid_moments, equations.tip_radius - equations.length
    spin, rate = hub.angular_velocity, hub.angular_velocity_rate
    # Inertia force across the undeformed beam at the distance X from the centre of the hub, per
    # mass: -(acceleration + X times these).
    spin_up_terms = [rate[:, 2] + spin[:, 0] * spin[:, 1], spin[:, 0] * spin[:, 2] - rate[:, 1]]
    across = jax.vmap(lambda hub: hub.acceleration)(hub)[:, 1:]
    moment = across * (first - radius * mass) + jnp.stack(spin_up_terms, 1) * (
        second - radius * first
    )
    if force is not None:
        moment = moment - jax.vmap(lambda load: bending(load, equations.length))(force)
    if span is not None:
        moment = moment - equations.length * span[:, 1, 1:]
    static = moment * rotor.compliance[None]
    moving = equations.kinematics(y0.q, y0.v)
    at, speed = jax.jvp(equations.tip, (y0.q,), (moving,))
    # First frequency of a uniform cantilever: 3.516 = 1.875^2, with cos(1.875) cosh(1.875) = -1.
    frequency = 3.5 * jnp.sqrt(equations.energy_scale / mass) / equations.length
    parts = [static, at[None], speed[None] / frequency]
    if scene.has_jumps:
        parts.append(_blows(scene, start) / frequency)
    size = [jnp.linalg.norm(a, axis=-1) for a in parts]
    largest = jnp.nan_to_num(jnp.max(jnp.concatenate(size)), nan=0.0)
    return jnp.clip(largest, 1e-6 * equations.length, 0.1 * equations.length), 0.1 / frequency


def _blows(scene: Scene, start: Scalar) -> Float[Array, "k 4"]:
    """Jumps of the hub's velocity at the tip, across the beam, in m/s, from the start of a run
    on."""
    pauses = scene.pauses
    within = (pauses.first >= start - pauses.near) & (pauses.first < pauses.end)
    times = jnp.where(within, pauses.first, start)
    sides = pauses.early(times), jax.vmap(pauses.after)(times)
    before, after = (jax.vmap(lambda t: scene.velocities_of(scene.hub(t)))(t) for t in sides)
    return jnp.where(within[:, None], after - before, 0.0)[:, np.array([1, 2, 4, 5])]


def _saved(solution: diffrax.Solution, times: Array, n: int) -> tuple[Array, State]:
    if isinstance(solution.ys, State):
        assert solution.ts is not None
        return solution.ts, solution.ys
    if solution.interpolation is not None:
        reached = times <= solution.interpolation.t1
        return jnp.where(reached, times, jnp.inf), jax.vmap(solution.evaluate)(times)
    none = jnp.zeros((0, n), times.dtype)
    return none[:, 0], State(none, none, none[:, 0])


def _solver_status(result: Any, event_means_runaway: bool) -> Code:
    status = jnp.asarray(Status.STEP_FAILED)
    for code, meaning in (
        (diffrax.RESULTS.successful, Status.OK),
        (diffrax.RESULTS.event_occurred, Status.DIVERGED if event_means_runaway else Status.OK),
        (diffrax.RESULTS.max_steps_reached, Status.MAX_STEPS),
        (MOTION_MISSED, Status.UNRESOLVED),
    ):
        status = jnp.where(result == code, meaning, status)
    return status
