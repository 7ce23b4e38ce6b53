"""The way from a scene to the solution of diffrax: by our own loop, or by that of diffrax."""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix
from jax.flatten_util import ravel_pytree
from jax.tree_util import Partial
from jaxtyping import Array

from jaxbeam._numerics.brackets import halved
from jaxbeam._results import replaced, without_derivatives
from jaxbeam._simulation.scene import Scene
from jaxbeam._simulation.step_limits import during
from jaxbeam._solvers.adjoint import run
from jaxbeam._solvers.rodas import Rosenbrock
from jaxbeam._solvers.run import Run, RunInputs, Settings, conditions, integrate_steps, output
from jaxbeam._solvers.system import SecondOrderSystem, State
from jaxbeam._types import Scalar

# Controllers that never report a jump, which spares code; others may report one at any step.
_NEVER_JUMP = (diffrax.PIDController, diffrax.ConstantStepSize, diffrax.StepTo)

_SAVE_STATE = diffrax.SubSaveAt(t1=True).fn  # the default function of diffrax's `SubSaveAt`

# Times and states along a run; times are infinite beyond its end.
EnergySamples = tuple[Array, State] | None


class Calendar(NamedTuple):
    """Output `times` by the user's clock, for a run that counts time since an `origin`."""

    times: Array
    origin: Scalar

    @property
    def since(self) -> Array:
        """The output times since the origin."""
        return self.times - self.origin

    def event(self, event: diffrax.Event | None) -> diffrax.Event | None:
        """An event whose conditions get times by the user's clock."""
        if event is None:
            return None
        found = jax.tree.map(
            lambda f: Partial(_by_clock, f, self.origin), event.cond_fn, is_leaf=callable
        )
        return eqx.tree_at(lambda e: e.cond_fn, event, found, is_leaf=callable)

    def dated(self, solution: diffrax.Solution) -> diffrax.Solution:
        """A solution with times by the user's clock, from one with times since the origin."""
        t0, t1, ts = jax.tree.map(
            lambda t: self.origin + t, (solution.t0, solution.t1, solution.ts)
        )
        path = solution.interpolation
        dense = None if path is None else _Dense(path, self.origin)
        return replaced(solution, t0=t0, t1=t1, ts=ts, interpolation=dense)

    def saved(self, sub: diffrax.SubSaveAt, scene: Scene) -> diffrax.SubSaveAt:
        """A `SubSaveAt` of diffrax with times since the origin, whose function gets times by the
        user's clock."""
        if sub.fn is not _SAVE_STATE:
            sub = replaced(sub, fn=Partial(_by_clock, sub.fn, self.origin))
        if sub.ts is None:
            return sub
        return replaced(sub, ts=_after_jumps(scene, sub.ts - self.origin, self.since[-1]))

    def controller(self, given: Any) -> Any:
        """A controller of diffrax with its declared times, if any, counted since the origin."""
        if isinstance(given, diffrax.StepTo):
            return diffrax.StepTo(given.ts - self.origin)
        if not isinstance(given, diffrax.ClipStepSizeController):
            return given
        steps, jumps = (
            None if times is None else times - self.origin
            for times in (given.step_ts, given.jump_ts)
        )  # fmt: skip
        within = self.controller(given.controller)
        return replaced(given, step_ts=steps, jump_ts=jumps, controller=within)


def _after_jumps(scene: Scene, times: Array, end: Scalar) -> Array:
    """Times of outputs: at a jump, unless the run ends there, a moment after it."""
    if not scene.has_jumps:
        return times
    own, end = without_derivatives((times, end))
    return times + (jnp.minimum(jax.vmap(scene.pauses.after)(own), end) - own)


def _by_clock(function: Any, origin: Scalar, t: Any, y: Any, args: Scene, **more: Any) -> Any:
    """The result of a user's function of time, state and scene at a time since the origin."""
    for name in ("t0", "t1"):
        if name in more:
            more[name] = more[name] + origin
    return function(t + origin, y, args.since(-origin), **more)


def integrate(
    scene: Scene, y0: State, calendar: Calendar, solver: diffrax.AbstractSolver,
    controller: diffrax.AbstractStepSizeController, dt0: Any,
    event: diffrax.Event | None, max_steps: int | None, adjoint: diffrax.AbstractAdjoint | None,
) -> tuple[diffrax.Solution, EnergySamples]:  # fmt: skip
    """Outputs at the times of a calendar (and with an event at the end of the run), and states
    along the run for the balance of energy. Derivatives are by the discrete adjoint, or in forward
    mode if `adjoint` is `ForwardMode`."""
    inner = getattr(controller, "controller", controller)
    settings = Settings(
        SecondOrderSystem.term(solver), solver, controller, dt0, event,
        is_far if event is None else None, max_steps,
        bool(scene.pauses.first.size) or not isinstance(inner, _NEVER_JUMP),
    )  # fmt: skip
    # States between outputs, too, since outputs may miss times at which energies are large.
    wanted = calendar.since
    watch = without_derivatives(during(wanted))
    start, every = wanted[0], jnp.sort(jnp.concatenate([wanted, watch]))
    asked = _after_jumps(scene, every, every[-1])
    scene = _prepared(scene, solver).with_closures_traced(start)
    inputs, constant = RunInputs(scene, y0, start, asked), without_derivatives(settings)
    came = integrate_steps(constant, inputs)[0] if adjoint is not None else run(inputs, constant)
    n = y0.q.size

    def at(times: Array) -> tuple[Array, Array]:
        # Counted with floats, which compiles in half the time.
        places = jnp.sum((every[None] < times[:, None]).astype(times.dtype), 1).astype(int)
        return jnp.where(places < came.reached, times, jnp.inf), came.outputs[places]

    def states(outputs: Array) -> State:
        return State(outputs[:, :n], outputs[:, n:-1], outputs[:, -1])

    seconds, outputs = at(wanted)
    ts = jnp.where(jnp.isfinite(seconds), calendar.times, jnp.inf)
    happened = came.stopped
    for each in came.happened:
        happened |= each
    mask = None
    if event is not None:
        end, last = _end(settings, inputs, event, came)
        ts = jnp.append(jnp.where(seconds <= end, ts, jnp.inf), jnp.inf)
        place = jnp.sum(jnp.isfinite(ts))
        ts = ts.at[place].set(calendar.origin + end)
        outputs = jnp.concatenate([outputs, last[None]]).at[place].set(last)
        structure = jax.tree.structure(event.cond_fn, is_leaf=callable)
        mask = jax.tree.unflatten(structure, came.happened)
    solution = diffrax.Solution(
        t0=calendar.times[0], t1=calendar.times[-1], ts=ts, ys=states(outputs), interpolation=None,
        stats={
            "num_steps": came.steps, "num_accepted_steps": came.kept,
            "num_rejected_steps": came.steps - came.kept, "max_steps": max_steps,
        },
        result=diffrax.RESULTS.where(happened, diffrax.RESULTS.event_occurred, came.result),
        solver_state=None, controller_state=None, made_jump=None, event_mask=mask,
    )  # fmt: skip
    seen, outputs = at(watch)
    return solution, (seen, states(outputs))


def _prepared(scene: Scene, solver: diffrax.AbstractSolver) -> Scene:
    """The scene with what a solver needs: the inverse mass matrix for solvers other than Rosenbrock
    methods, since these alone ask for no accelerations."""
    return scene if isinstance(solver, Rosenbrock) else scene.with_inverse()


def _end(
    settings: Settings, inputs: RunInputs, event: diffrax.Event, came: Run
) -> tuple[Scalar, Array]:
    """The time at which a run with an event ended, and the state there."""
    if event.root_finder is None:
        return jax.lax.stop_gradient(came.t), came.y
    assert came.last is not None
    step, (_, unravel) = came.last, ravel_pytree(inputs.y0)

    def ahead(t: Scalar, _: Any) -> Scalar:
        """The function whose root is the end: zero at the event, or at the end of the last step
        without one."""
        found = step.t1 - t
        y = unravel(output(settings.solver, step, t))
        for which, condition in zip(came.happened, conditions(settings, inputs), strict=True):
            value = jnp.asarray(condition(t, y))
            if value.dtype != bool:
                found = jnp.where(which, value, found)
        return found

    # By the sign of the condition first: Newton's method stays within a bracket. A step that ends
    # beyond a peak has a slope there that leads away from the event.
    def sign(t: Scalar) -> Array:
        return jnp.sign(without_derivatives(ahead(t, None)))

    lower, upper = without_derivatives((step.t0, step.t1))
    first_sign = sign(lower)
    lower, upper = halved(lambda t: sign(t) == first_sign, lower, upper, 24)
    root = optimistix.root_find(
        ahead, event.root_finder, upper, options={"lower": lower, "upper": upper}, throw=False
    ).value
    first = came.kept == 0
    return jnp.where(first, came.t, root), jnp.where(
        first, came.y, output(settings.solver, step, root)
    )


def is_far(scene: Scene, y: State) -> Array:
    """Whether the tip is displaced by more than any beam can be."""
    return jnp.linalg.norm(scene.equations.tip(y.q)) > 10 * scene.equations.length


def by_diffrax(
    scene: Scene, y0: State, calendar: Calendar, solver: diffrax.AbstractSolver,
    controller: diffrax.AbstractStepSizeController, dt0: Any,
    event: diffrax.Event | None, max_steps: int | None, adjoint: diffrax.AbstractAdjoint | None,
    saveat: diffrax.SaveAt | None, progress_meter: diffrax.AbstractProgressMeter | None,
) -> tuple[diffrax.Solution, EnergySamples]:  # fmt: skip
    """A run by diffrax itself, for features that our own loop has not: other times saved, progress
    meters, other adjoints."""
    scene, times = _prepared(scene, solver), calendar.since
    watched = not isinstance(adjoint, diffrax.BacksolveAdjoint)
    if saveat is None:
        saveat = diffrax.SaveAt(ts=calendar.times, t1=event is not None)
    saveat = _each(lambda sub: calendar.saved(sub, scene), saveat)
    if watched:
        # States between outputs, for the balance of energy.
        watch = diffrax.SubSaveAt(ts=during(times), fn=lambda t, y, args: without_derivatives(y))
        saveat = replaced(saveat, subs=(saveat.subs, watch))
        event = diffrax.Event(_runaway) if event is None else event
    solution = diffrax.diffeqsolve(
        SecondOrderSystem.term(solver), solver, times[0], times[-1], dt0, y0, scene, saveat=saveat,
        stepsize_controller=controller, max_steps=max_steps, throw=False, event=event,
        adjoint=diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint,
        progress_meter=diffrax.NoProgressMeter() if progress_meter is None else progress_meter,
    )  # fmt: skip
    if not watched:
        return calendar.dated(solution), None
    assert solution.ts is not None
    assert solution.ys is not None
    (ts, seen), (ys, states) = solution.ts, solution.ys
    return calendar.dated(replaced(solution, ts=ts, ys=ys)), (seen, states)


class _Dense(diffrax.AbstractPath):
    """Dense output of a run by the user's clock, from that by the time since an origin."""

    interpolation: Any
    origin: Scalar

    @property
    def t0(self) -> Any:  # type: ignore[override]
        return self.interpolation.t0 + self.origin

    @property
    def t1(self) -> Any:  # type: ignore[override]
        return self.interpolation.t1 + self.origin

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> Any:
        """The state at t0, or with t1 its change from t0 to t1."""
        if t1 is not None:
            t1 = t1 - self.origin
        return self.interpolation.evaluate(t0 - self.origin, t1, left)

    def derivative(self, t: Any, left: bool = True) -> Any:
        """The rate of the state at t."""
        return self.interpolation.derivative(t - self.origin, left)


def _runaway(t: Scalar, y: State, args: Scene, **_: Any) -> Array:
    """The condition that ends a run whose tip is too far away, so that no batch waits for it."""
    return is_far(*without_derivatives((args, y)))


def held_within(saveat: diffrax.SaveAt, times: Array) -> tuple[diffrax.SaveAt, Array]:
    """The `saveat` with its times clipped to the run, and whether they were within it."""
    within = jnp.asarray(True)

    def held(sub: diffrax.SubSaveAt) -> diffrax.SubSaveAt:
        nonlocal within
        if sub.ts is None:
            return sub
        within &= jnp.all((sub.ts >= times[0]) & (sub.ts <= times[-1]))
        return replaced(sub, ts=jnp.clip(jnp.nan_to_num(sub.ts), times[0], times[-1]))

    return _each(held, saveat), within


def _each(change: Callable[[diffrax.SubSaveAt], diffrax.SubSaveAt], saveat: Any) -> diffrax.SaveAt:
    subs = jax.tree.map(change, saveat.subs, is_leaf=lambda s: isinstance(s, diffrax.SubSaveAt))
    changed: diffrax.SaveAt = replaced(saveat, subs=subs)
    return changed
