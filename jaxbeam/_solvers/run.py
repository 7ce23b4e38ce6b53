"""A run: steps of a solver under any controller, with outputs at given times, as a small program.

This is what `diffrax.diffeqsolve` does, for the one case that beams ask for. It is written anew
since its size is what a user waits for: half of a spin-up is compiled, not computed.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.flatten_util import ravel_pytree
from jax.interpreters import batching, mlir
from jaxtyping import Array, Float

from jaxbeam._results import without_derivatives
from jaxbeam._solvers.system import State
from jaxbeam._types import Scalar

_OK = diffrax.RESULTS.successful
# Whether something holds in any lane of a batch. A loop that asks this goes on for all lanes alike,
# and what is written into its buffers is not copied for the sake of lanes that are done.
anywhere = Primitive("anywhere")
anywhere.def_impl(lambda x: x)
anywhere.def_abstract_eval(lambda x: x)
mlir.register_lowering(anywhere, lambda _, x: [x])


def _anywhere_in_batch(given: Any, _: Any) -> Any:
    return anywhere.bind(jnp.any(given[0], 0)), None


batching.primitive_batchers[anywhere] = _anywhere_in_batch


class Task(eqx.Module):
    """How to run; no derivatives are taken by what is in here."""

    term: diffrax.AbstractTerm
    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractStepSizeController
    dt0: Any
    event: diffrax.Event | None
    ends: Callable[[Any, State], Array] | None  # whether there is nothing to be had beyond
    max_steps: int | None = eqx.field(static=True)
    jumps: bool = eqx.field(static=True)  # whether the controller may tell of jumps


class Given(eqx.Module):
    """What to run, and to take derivatives by."""

    args: Any
    y0: State
    start: Scalar  # of the first step
    times: Float[Array, " T"]  # of outputs, increasing, the first not after `start`; the last ends


def conditions(task: Task, given: Given) -> list[Callable[[Scalar, State], Any]]:
    """The conditions of the event, as functions of t and y."""
    if task.event is None:
        return []
    more = {
        "terms": task.term, "solver": task.solver, "t0": given.start, "t1": given.times[-1],
        "dt0": task.dt0, "saveat": diffrax.SaveAt(ts=given.times), "max_steps": task.max_steps,
        "stepsize_controller": task.controller,
    }  # fmt: skip
    found = jax.tree.leaves(task.event.cond_fn, is_leaf=callable)
    return [functools.partial(_asked, f, given.args, more) for f in found]


def _asked(function: Any, args: Any, more: dict[str, Any], t: Scalar, y: State) -> Any:
    return function(t, y, args, **more)


class Step(NamedTuple):
    """The last step that was kept, for the interpolation of the solver."""

    t0: Scalar
    t1: Scalar
    info: Any


class Run(NamedTuple):
    """What came of a run: its outputs, how it ended, and what was spent."""

    outputs: Float[Array, "T m"]  # the flat state at the times; `reached` of them
    y: Float[Array, " m"]  # at the end of the last step
    last: Step | None
    reached: Array
    t: Scalar  # where the last step ended
    stopped: Array  # by `Task.ends`
    happened: list[Array]  # which event
    result: Any
    steps: Array
    kept: Array


class Tape(NamedTuple):
    """What is written down of each step for reverse mode, with a row for what is not to be kept."""

    rows: Float[Array, "c+1 r"]  # state of the equations and the solver before a step, see `place`
    ends: Float[Array, "k+1 e"]  # start and end of each step, whether something jumped


class _Now(NamedTuple):
    t0: Scalar
    t1: Scalar
    y: State
    jumped: Any
    solver_state: Any
    controller_state: Any
    values: list[Array]
    tape: Tape | None
    run: Run


def march(task: Task, given: Given, tape: Tape | None = None) -> tuple[Run, Tape | None]:
    """Runs the task; with an empty `tape` that is filled."""
    solver, controller, args = task.solver, task.controller, given.args
    times, end = given.times, given.times[-1]
    order: Any = solver.error_order(task.term)
    seen = without_derivatives((args, given.y0, given.start, end))
    t1, controller_state = controller.init(
        task.term, seen[2], seen[3], seen[1], task.dt0, seen[0], solver.func, order
    )
    t1 = jnp.minimum(t1, end)
    flat, _ = ravel_pytree(given.y0)
    yes, no, count = jnp.asarray(True), jnp.asarray(False), jnp.asarray(0)
    # Steps that would leave but a splinter end at the end, to which 100 units of rounding are near.
    nearly = end - 128 * jnp.finfo(times.dtype).eps * jnp.abs(end)

    last = None
    started = solver_state_of(task, given)
    located = task.event is not None and task.event.root_finder is not None
    if located:
        step = eqx.filter_eval_shape(
            solver.step, task.term, given.start, t1, given.y0, args, started, False
        )
        info = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), step[2])
        last = Step(given.start, t1, info)

    asked = conditions(task, without_derivatives(given))
    directions: list[bool | None] = [None] * len(asked)
    if task.event is not None and task.event.direction is not None:
        directions = jax.tree.leaves(task.event.direction, is_leaf=lambda d: d is None)

    def events(t: Scalar, y: State, before: list[Array] | None) -> tuple[list[Array], list[Array]]:
        values = [jnp.asarray(f(*without_derivatives((t, y)))) for f in asked]
        if before is None:
            return values, [v if v.dtype == bool else no for v in values]
        return values, [_happened(*each) for each in zip(directions, before, values, strict=True)]

    values, happened = events(given.start, given.y0, None)
    first = Run(
        outputs=jnp.zeros((times.size + 1, flat.size), flat.dtype).at[0].set(flat),
        y=flat, last=last, reached=count + 1, t=given.start, stopped=no, happened=happened,
        result=diffrax.RESULTS.where(yes, _OK, _OK), steps=count, kept=count,
    )  # fmt: skip
    now = _Now(
        given.start, t1, given.y0, no if task.jumps else False, started,
        as_arrays(controller_state), values, tape, first,
    )  # fmt: skip
    arrays, static = eqx.partition(now, eqx.is_array)

    def unfinished(now: _Now) -> Array:
        run = now.run
        more = (now.t0 < end) & (run.result == _OK) & ~run.stopped
        for event in run.happened:
            more &= ~event
        return more

    def goes_on(now: _Now) -> Array:
        more = unfinished(now)
        return more if task.max_steps is None else more & (now.run.steps < task.max_steps)

    def body(arrays: Any) -> Any:
        now: _Now = eqx.combine(arrays, static)
        run = now.run
        active = goes_on(now)
        y, error, info, solver_state, solver_result = solver.step(
            task.term, now.t0, now.t1, now.y, args, now.solver_state, now.jumped
        )
        error = jax.tree.map(lambda e: jnp.where(jnp.isnan(e), jnp.inf, e), error)
        keep, t0, t1, jumped, controller_state, controller_result = controller.adapt_step_size(
            *without_derivatives((now.t0, now.t1, now.y, y, args, error)), order,
            now.controller_state,
        )  # fmt: skip
        kept = jnp.asarray(keep & active)
        t0 = jnp.minimum(t0, end)
        t1 = jnp.where(t1 > nearly, jnp.where(keep, end, t0 + 0.5 * (end - t0)), t1)
        result = diffrax.RESULTS.where(keep, solver_result, _OK)
        result = diffrax.RESULTS.where(result == _OK, controller_result, result)
        along = Step(now.t0, now.t1, info)
        outputs, reached = _saved(solver, times, along, kept, run.outputs, run.reached)
        tape = now.tape
        if tape is not None:
            row, _ = ravel_pytree(eqx.filter((now.y, now.solver_state), eqx.is_array))
            ends = [now.t0, now.t1] + ([now.jumped.astype(t0.dtype)] if task.jumps else [])
            tape = _written(tape, row, jnp.stack(ends), run.kept, kept)
        values, happened = events(now.t1, y, now.values)
        far = no if task.ends is None else task.ends(*without_derivatives((args, y)))
        new = (
            run.stopped | far,
            [a | b for a, b in zip(run.happened, happened, strict=True)],
            values, now.t1, y, ravel_pytree(y)[0], solver_state, jumped if task.jumps else None,
            along if located else None,
        )  # fmt: skip
        old = (
            run.stopped, run.happened,
            now.values, run.t, now.y, run.y, now.solver_state, now.jumped if task.jumps else None,
            run.last,
        )  # fmt: skip
        stopped, happened, values, t, y, flat, solver_state, jumped, last = _where(kept, new, old)
        t0, t1, controller_state, result = _where(
            active,
            (t0, t1, controller_state, result),
            (now.t0, now.t1, now.controller_state, run.result),
        )
        run = Run(
            outputs, flat, last, reached, t, stopped, happened, result,
            run.steps + active, run.kept + kept,
        )  # fmt: skip
        jumped = jumped if task.jumps else False
        after = _Now(t0, t1, y, jumped, solver_state, controller_state, values, tape, run)
        return eqx.filter(after, eqx.is_array)

    arrays = jax.lax.while_loop(
        lambda arrays: anywhere.bind(goes_on(eqx.combine(arrays, static))), body, arrays
    )
    now = eqx.combine(arrays, static)
    run = now.run
    result = diffrax.RESULTS.where(unfinished(now), diffrax.RESULTS.max_steps_reached, run.result)
    return run._replace(outputs=run.outputs[:-1], result=result), now.tape


def _where(which: Array, a: Any, b: Any) -> Any:
    return jax.tree.map(
        lambda a, b: jnp.where(which, a, b) if eqx.is_array(a) or eqx.is_array(b) else a, a, b
    )


def _happened(direction: bool | None, before: Array, value: Array) -> Array:
    """As in diffrax: a truth, or a change of sign in the direction that is asked for."""
    if value.dtype == bool:
        return value
    if direction is None:
        return jnp.sign(before) != jnp.sign(value)
    if direction:
        return (before <= 0) & (value > 0)
    return (before > 0) & (value <= 0)


def output(solver: diffrax.AbstractSolver, step: Step, t: Scalar) -> Float[Array, " m"]:
    """The flat state at a time within a step."""
    along = solver.interpolation_cls(t0=step.t0, t1=step.t1, **step.info)
    return ravel_pytree(along.evaluate(t))[0]


def _saved(
    solver: diffrax.AbstractSolver, times: Array, step: Step, kept: Array, outputs: Array,
    reached: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """The outputs up to the end of a step, and how many there are; there is one row too many."""

    def within(i: Array) -> Array:
        return kept & (i < times.size) & (times[jnp.minimum(i, times.size - 1)] <= step.t1)

    def save(state: tuple[Array, Array]) -> tuple[Array, Array]:
        outputs, i = state
        here = within(i)
        row = output(solver, step, times[jnp.minimum(i, times.size - 1)])
        at = jnp.where(here, i, times.size)
        return jax.lax.dynamic_update_index_in_dim(outputs, row, at, 0), i + here

    return jax.lax.while_loop(
        lambda state: anywhere.bind(within(state[1])), save, (outputs, reached)
    )


ROWS = 1024  # states that are kept at most; where steps are more, every 2nd, 4th, ... is


def blank(task: Task, given: Given) -> Tape:
    """A tape with room for all steps."""
    steps = task.max_steps
    if steps is None:
        raise ValueError(
            "max_steps=None knows no bound for what reverse mode has to remember: give max_steps, "
            "or adjoint=diffrax.ForwardMode()"
        )
    kept = solver_state_of(task, given)
    row, _ = ravel_pytree(eqx.filter((given.y0, kept), eqx.is_array))
    # So many that spans between rows are no longer than there are rows.
    rows = min(max(ROWS, _power(int((2 * steps) ** 0.5))), _power(steps))
    ends = jnp.zeros((steps + 1, 3 if task.jumps else 2), given.times.dtype)
    return Tape(jnp.zeros((rows + 1, row.size), row.dtype), ends)


def solver_state_of(task: Task, given: Given) -> Any:
    """The state of the solver at the start."""
    state = task.solver.init(task.term, given.start, given.start, given.y0, given.args)
    return as_arrays(state)


def as_arrays(tree: Any) -> Any:
    """Numbers and truths as arrays, which loops carry."""
    return jax.tree.map(lambda a: jnp.asarray(a) if eqx.is_array_like(a) else a, tree)


def _power(n: int) -> int:
    """The smallest power of two that is not less than n."""
    return 1 << max(n - 1, 0).bit_length()


def level(k: Any, rows: int) -> Array:
    """m, where of the steps up to the k-th every 2^m-th is kept in so many rows."""
    return 32 - jax.lax.clz(jnp.asarray(k // rows, jnp.int32))


def place(k: Array, rows: int) -> Array:
    """The row of step k, which is a multiple of 2^level; nothing is ever moved: each level fills
    the rows of steps that are of no use to it, odd multiples of half of its own stride."""
    m = level(k, rows).astype(k.dtype)
    half = jnp.where(m > 0, 1 << jnp.maximum(m - 1, 0), 0)
    j = (k - rows * half) >> m
    share = rows >> m
    return jnp.where(m > 0, ((j % share) << m) + half + j // share, k)


def _written(tape: Tape, row: Array, ends: Array, k: Array, kept: Array) -> Tape:
    rows, steps = len(tape.rows) - 1, len(tape.ends) - 1
    whole = k & ((1 << level(k, rows).astype(k.dtype)) - 1) == 0
    at = jnp.where(kept & whole, place(k, rows), rows)
    return Tape(
        jax.lax.dynamic_update_index_in_dim(tape.rows, row, at, 0),
        jax.lax.dynamic_update_index_in_dim(tape.ends, ends, jnp.where(kept, k, steps), 0),
    )
