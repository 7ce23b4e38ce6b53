"""The way from a scene to the solution of diffrax: by our own loop, or by that of diffrax."""

from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from jaxbeam._results import without_derivatives
from jaxbeam._simulation.scene import Scene
from jaxbeam._simulation.step_limits import during
from jaxbeam._solvers.adjoint import run
from jaxbeam._solvers.rodas import Rosenbrock
from jaxbeam._solvers.run import Inputs, Run, Settings, conditions, integrate_steps, output
from jaxbeam._solvers.system import State, second_order_term
from jaxbeam._types import Scalar

# Controllers that never tell of a jump, which saves code; with others one may come at any step.
_NEVER_JUMP = (diffrax.PIDController, diffrax.ConstantStepSize, diffrax.StepTo)

EnergySamples = tuple[Array, State] | None  # times, infinite where a run did not get, and states


def integrate(
    scene: Scene, y0: State, start: Scalar, times: Array, solver: diffrax.AbstractSolver,
    controller: diffrax.AbstractStepSizeController, dt0: Any,
    event: diffrax.Event | None, max_steps: int | None, adjoint: diffrax.AbstractAdjoint | None,
) -> tuple[diffrax.Solution, EnergySamples]:  # fmt: skip
    """Outputs at `times` (and at the end of the run, with an event), and states all along the run;
    with the discrete adjoint, or if `adjoint` is `ForwardMode` with derivatives in that mode.

    The first step begins at `start`, a moment after the first time if something jumps there.
    """
    inner = getattr(controller, "controller", controller)
    settings = Settings(
        second_order_term(solver), solver, controller, dt0, event,
        is_far if event is None else None, max_steps,
        bool(scene.pauses.opens.size) or not isinstance(inner, _NEVER_JUMP),
    )  # fmt: skip
    # Outputs may miss where energies are large.
    watch = jnp.maximum(without_derivatives(during(times)), start)
    every = jnp.sort(jnp.concatenate([times, watch]))
    scene = _prepared(scene, solver).with_closures_traced(start)
    inputs, constant = Inputs(scene, y0, start, every), without_derivatives(settings)
    came = integrate_steps(constant, inputs)[0] if adjoint is not None else run(inputs, constant)
    n = y0.q.size

    def at(times: Array) -> tuple[Array, Array]:
        # Counted in real numbers, which compiles in half the time.
        places = jnp.sum((every[None] < times[:, None]).astype(times.dtype), 1).astype(int)
        return jnp.where(places < came.reached, times, jnp.inf), came.outputs[places]

    def states(outputs: Array) -> State:
        return State(outputs[:, :n], outputs[:, n:-1], outputs[:, -1])

    ts, outputs = at(times)
    happened = came.stopped
    for each in came.happened:
        happened |= each
    mask = None
    if event is not None:
        end, last = _end(settings, inputs, event, came)
        ts = jnp.append(jnp.where(ts <= end, ts, jnp.inf), jnp.inf)
        place = jnp.sum(jnp.isfinite(ts))
        ts = ts.at[place].set(end)
        outputs = jnp.concatenate([outputs, last[None]]).at[place].set(last)
        structure = jax.tree.structure(event.cond_fn, is_leaf=callable)
        mask = jax.tree.unflatten(structure, came.happened)
    solution = diffrax.Solution(
        t0=start, t1=times[-1], ts=ts, ys=states(outputs), interpolation=None,
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
    """Rosenbrock methods alone ask for no accelerations, others at every stage."""
    return scene if isinstance(solver, Rosenbrock) else scene.with_inverse()


def _end(
    settings: Settings, inputs: Inputs, event: diffrax.Event, came: Run
) -> tuple[Scalar, Array]:
    """When a run with an event ended, and the state there."""
    if event.root_finder is None:
        return jax.lax.stop_gradient(came.t), came.y
    assert came.last is not None
    step, (_, unravel) = came.last, ravel_pytree(inputs.y0)

    def ahead(t: Scalar, _: Any) -> Scalar:
        """Zero at the event, or at the end of the last step if there is none."""
        found = step.t1 - t
        y = unravel(output(settings.solver, step, t))
        for which, condition in zip(came.happened, conditions(settings, inputs), strict=True):
            value = jnp.asarray(condition(t, y))
            if value.dtype != bool:
                found = jnp.where(which, value, found)
        return found

    # Between signs that differ Newton's method cannot leave the way: a step that ends beyond a peak
    # has a slope that points away from where the limit was met.
    lower, upper = _bracket(lambda t: ahead(t, None), *without_derivatives((step.t0, step.t1)))
    root = optimistix.root_find(
        ahead, event.root_finder, upper, options={"lower": lower, "upper": upper}, throw=False
    ).value
    first = came.kept == 0
    return jnp.where(first, came.t, root), jnp.where(
        first, came.y, output(settings.solver, step, root)
    )


def _bracket(
    function: Callable[[Scalar], Scalar], lower: Scalar, upper: Scalar
) -> tuple[Scalar, Scalar]:
    """A millionth of the interval, or less, at whose ends the function has the signs that it has
    at those of the whole one."""
    sign = jnp.sign(without_derivatives(function(lower)))

    def halve(_: Any, ends: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
        lower, upper = ends
        middle = (lower + upper) / 2
        before = jnp.sign(without_derivatives(function(middle))) == sign
        return jnp.where(before, middle, lower), jnp.where(before, upper, middle)

    ends: tuple[Scalar, Scalar] = jax.lax.fori_loop(0, 24, halve, (lower, upper))
    return ends


def is_far(scene: Scene, y: State) -> Array:
    """Whether the tip is where no beam goes."""
    return jnp.linalg.norm(scene.equations.tip(y.q)) > 10 * scene.equations.length


def by_diffrax(
    scene: Scene, y0: State, start: Scalar, times: Array, solver: diffrax.AbstractSolver,
    controller: diffrax.AbstractStepSizeController, dt0: Any,
    event: diffrax.Event | None, max_steps: int | None, adjoint: diffrax.AbstractAdjoint | None,
    saveat: diffrax.SaveAt | None, progress_meter: diffrax.AbstractProgressMeter | None,
) -> tuple[diffrax.Solution, EnergySamples]:  # fmt: skip
    """A run by diffrax itself, with all that it knows: what is saved, progress, other adjoints."""
    scene = _prepared(scene, solver)
    watched = not isinstance(adjoint, diffrax.BacksolveAdjoint)
    if saveat is None:
        saveat = diffrax.SaveAt(ts=times, t1=event is not None)
    saveat, _ = held_within(saveat, times, start)
    if watched:
        # See above.
        watch = diffrax.SubSaveAt(
            ts=during(jnp.stack([start, times[-1]])), fn=lambda t, y, args: without_derivatives(y)
        )
        saveat = eqx.tree_at(lambda s: s.subs, saveat, (saveat.subs, watch))
        event = diffrax.Event(_runaway) if event is None else event
    solution = diffrax.diffeqsolve(
        second_order_term(solver), solver, start, times[-1], dt0, y0, scene, saveat=saveat,
        stepsize_controller=controller, max_steps=max_steps, throw=False, event=event,
        adjoint=diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint,
        progress_meter=diffrax.NoProgressMeter() if progress_meter is None else progress_meter,
    )  # fmt: skip
    if not watched:
        return solution, None
    assert solution.ts is not None
    assert solution.ys is not None
    (ts, seen), (ys, states) = solution.ts, solution.ys
    own = eqx.tree_at(lambda s: (s.ts, s.ys), solution, (ts, ys), is_leaf=lambda x: x is None)
    return own, (seen, states)


def _runaway(t: Scalar, y: State, args: Scene, **_: Any) -> Array:
    """Nothing is to be had beyond: do not let a batch wait for it."""
    return is_far(*without_derivatives((args, y)))


def held_within(
    saveat: diffrax.SaveAt, times: Array, earliest: Scalar | None = None
) -> tuple[diffrax.SaveAt, Array]:
    """`saveat` with its times held within the run, and whether they were."""
    within = jnp.asarray(True)

    def held(sub: diffrax.SubSaveAt) -> diffrax.SubSaveAt:
        nonlocal within
        if sub.ts is None:
            return sub
        within &= jnp.all((sub.ts >= times[0]) & (sub.ts <= times[-1]))
        ts = jnp.clip(jnp.nan_to_num(sub.ts), times[0] if earliest is None else earliest, times[-1])
        return eqx.tree_at(lambda s: s.ts, sub, ts)

    subs = jax.tree.map(held, saveat.subs, is_leaf=lambda s: isinstance(s, diffrax.SubSaveAt))
    return eqx.tree_at(lambda s: s.subs, saveat, subs, is_leaf=lambda s: s is None), within
