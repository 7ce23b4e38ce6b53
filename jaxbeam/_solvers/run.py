"""A run: steps of a solver under any controller, with outputs at given times, as a small program.

This is what `diffrax.diffeqsolve` does, for the one case that beams ask for. It is written anew
since its size is what a user waits for: half of a spin-up is compiled, not computed.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jax.tree_util import Partial
from jaxtyping import Array, Float

from jaxbeam._programs.anywhere import anywhere
from jaxbeam._programs.loop import loop
from jaxbeam._results import without_derivatives
from jaxbeam._solvers.events import Events
from jaxbeam._solvers.system import State
from jaxbeam._types import Scalar

_OK = diffrax.RESULTS.successful


class Settings(eqx.Module):
    """Settings of a run, by which no derivatives are taken."""

    term: diffrax.AbstractTerm
    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractStepSizeController
    dt0: Any
    event: diffrax.Event | None
    ends: Callable[[Any, State], Array] | None  # whether there is nothing to be had beyond
    max_steps: int | None = eqx.field(static=True)
    jumps: bool = eqx.field(static=True)  # whether the controller may tell of jumps

    @property
    def locates(self) -> bool:
        """Whether the event is to be found within the last step."""
        return self.event is not None and self.event.root_finder is not None


class RunInputs(eqx.Module):
    """The inputs of a run, by which there are derivatives."""

    args: Any
    y0: State
    start: Scalar  # of the first step
    times: Float[Array, " T"]  # of outputs, increasing, the first not after `start`; the last ends


def conditions(settings: Settings, inputs: RunInputs) -> list[Callable[[Scalar, State], Any]]:
    """The conditions of the event, as functions of t and y."""
    if settings.event is None:
        return []
    more = {
        "terms": settings.term, "solver": settings.solver,
        "t0": inputs.start, "t1": inputs.times[-1],
        "dt0": settings.dt0, "saveat": diffrax.SaveAt(ts=inputs.times),
        "max_steps": settings.max_steps,
        "stepsize_controller": settings.controller,
    }  # fmt: skip
    found = jax.tree.leaves(settings.event.cond_fn, is_leaf=callable)
    return [Partial(_asked, f, inputs.args, more) for f in found]


def _asked(function: Any, args: Any, more: dict[str, Any], t: Scalar, y: State) -> Any:
    return function(t, y, args, **more)


def _events(settings: Settings, inputs: RunInputs) -> Events:
    asked = conditions(settings, without_derivatives(inputs))
    directions: list[bool | None] = [None] * len(asked)
    if settings.event is not None and settings.event.direction is not None:
        directions = jax.tree.leaves(settings.event.direction, is_leaf=lambda d: d is None)
    return Events(asked, directions)


class Step(NamedTuple):
    """The last step that was kept, for the interpolation of the solver."""

    t0: Scalar
    t1: Scalar
    info: Any


class Run(NamedTuple):
    """The result of a run: its outputs, how it ended, and what was spent."""

    outputs: Float[Array, "T m"]  # the flat state at the times; `reached` of them
    y: Float[Array, " m"]  # at the end of the last step
    last: Step | None
    reached: Array
    t: Scalar  # where the last step ended
    stopped: Array  # by `Settings.ends`
    happened: list[Array]  # which event
    result: Any
    steps: Array
    kept: Array


class Tape(NamedTuple):
    """The record of each step for reverse mode, with a row for what is not to be kept."""

    rows: Float[Array, "C r"]  # state of the equations and the solver before a step, see `tape_row`
    ends: Float[Array, " K"]  # end of each step
    # What lies between the end of the step before and its start, less than nothing after a jump;
    # where one may be. Few units of rounding as it is, it is exact in 32 bits, too: room for steps
    # that are not made costs time, since it is filled with zeros.
    gaps: Float[Array, " K"] | None

    def start_of(self, k: Array) -> tuple[Array, Array | bool]:
        """Start of the k-th step, which is not the first, and whether something jumped there."""
        before = self.ends[jnp.maximum(k - 1, 0)]
        if self.gaps is None:
            return before, False
        gap = self.gaps[k]
        return before + jnp.abs(gap).astype(before.dtype), gap < 0


class LoopState(NamedTuple):
    """The state of the loop before the step from t0 to t1, which may have to be made anew."""

    t0: Scalar
    t1: Scalar
    y: State
    jumped: Any
    solver_state: Any
    controller_state: Any
    values: list[Array]
    tape: Tape | None
    run: Run


class _Verdict(NamedTuple):
    """The verdict of the controller on a step: whether it is kept, and how to go on."""

    kept: Array
    t0: Scalar
    t1: Scalar
    jumped: Any
    controller_state: Any
    result: Any


def integrate_steps(
    settings: Settings, inputs: RunInputs, tape: Tape | None = None
) -> tuple[Run, Tape | None]:
    """Runs the task; with an empty `tape` that is filled."""
    stepping, now = _begin(settings, inputs, tape)
    now = loop(_Stepping.goes_on, _Stepping.step, stepping, now)
    run, unfinished = now.run, stepping.unfinished(now)
    result = diffrax.RESULTS.where(unfinished, diffrax.RESULTS.max_steps_reached, run.result)
    return run._replace(outputs=run.outputs[:-1], result=result), now.tape


def _begin(
    settings: Settings, inputs: RunInputs, tape: Tape | None
) -> tuple["_Stepping", LoopState]:
    """Chooses the first step, and finds what holds before it."""
    solver, end = settings.solver, inputs.times[-1]
    order: Any = solver.error_order(settings.term)
    seen = without_derivatives((inputs.args, inputs.y0, inputs.start, end))
    t1, controller_state = settings.controller.init(
        settings.term, seen[2], seen[3], seen[1], settings.dt0, seen[0], solver.func, order
    )
    t1 = jnp.minimum(t1, end)
    flat, _ = ravel_pytree(inputs.y0)
    yes, no, count = jnp.asarray(True), jnp.asarray(False), jnp.asarray(0)
    # Steps that would leave but a splinter end at the end, to which 100 units of rounding are near.
    nearly = end - 128 * jnp.finfo(inputs.times.dtype).eps * jnp.abs(end)
    solver_state = solver_state_of(settings, inputs)
    last = _no_step(settings, inputs, t1, solver_state) if settings.locates else None
    events = _events(settings, inputs)
    values = events.values(inputs.start, inputs.y0)
    run = Run(
        outputs=jnp.zeros((inputs.times.size + 1, flat.size), flat.dtype).at[0].set(flat),
        y=flat, last=last, reached=count + 1, t=inputs.start, stopped=no,
        happened=[v if v.dtype == bool else no for v in values],
        result=diffrax.RESULTS.where(yes, _OK, _OK), steps=count, kept=count,
    )  # fmt: skip
    now = LoopState(
        inputs.start, t1, inputs.y0, no if settings.jumps else False, solver_state,
        as_arrays(controller_state), values, tape, run,
    )  # fmt: skip
    return _Stepping(settings, inputs, order, end, nearly, events), now


def _no_step(settings: Settings, inputs: RunInputs, t1: Scalar, solver_state: Any) -> Step:
    """Returns zeros in the place of the last step, before there is one."""
    step = eqx.filter_eval_shape(
        settings.solver.step,
        settings.term,
        inputs.start,
        t1,
        inputs.y0,
        inputs.args,
        solver_state,
        False,
    )
    info = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), step[2])
    return Step(inputs.start, t1, info)


class _Stepping(NamedTuple):
    """The constants of a run from step to step, and how a step is made."""

    settings: Settings
    inputs: RunInputs
    order: Any  # of the error, which the controller asks for
    end: Scalar
    nearly: Scalar  # steps that would end later end at the end
    events: Events

    def unfinished(self, now: LoopState) -> Array:
        """Whether there is more to be run, however many steps were made."""
        run = now.run
        more = (now.t0 < self.end) & (run.result == _OK) & ~run.stopped
        for event in run.happened:
            more &= ~event
        return more

    def goes_on(self, now: LoopState) -> Array:
        more, most = self.unfinished(now), self.settings.max_steps
        return more if most is None else more & (now.run.steps < most)

    def step(self, now: LoopState) -> LoopState:
        """Makes a step; nothing changes in a lane that is done."""
        settings, args, run = self.settings, self.inputs.args, now.run
        active = self.goes_on(now)
        y, error, info, solver_state, solver_result = settings.solver.step(
            settings.term, now.t0, now.t1, now.y, args, now.solver_state, now.jumped
        )
        verdict = self.verdict_on(now, active, y, error, solver_result)
        kept, along = verdict.kept, Step(now.t0, now.t1, info)
        outputs, reached = _saved(
            settings.solver, self.inputs.times, along, kept, run.outputs, run.reached
        )
        tape = self.write(now, kept)
        values = self.events.values(now.t1, y)
        happened = self.events.happened(now.values, values)
        far = jnp.asarray(False)
        if settings.ends is not None:
            far = settings.ends(*without_derivatives((args, y)))
        new = (
            run.stopped | far,
            [a | b for a, b in zip(run.happened, happened, strict=True)],
            values, now.t1, y, ravel_pytree(y)[0], solver_state,
            verdict.jumped if settings.jumps else None, along if settings.locates else None,
        )  # fmt: skip
        old = (
            run.stopped, run.happened,
            now.values, run.t, now.y, run.y, now.solver_state,
            now.jumped if settings.jumps else None, run.last,
        )  # fmt: skip
        stopped, happened, values, t, y, flat, solver_state, jumped, last = _where(kept, new, old)
        t0, t1, controller_state, result = _where(
            active,
            (verdict.t0, verdict.t1, verdict.controller_state, verdict.result),
            (now.t0, now.t1, now.controller_state, run.result),
        )
        run = Run(
            outputs, flat, last, reached, t, stopped, happened, result,
            run.steps + active, run.kept + kept,
        )  # fmt: skip
        jumped = jumped if settings.jumps else False
        return LoopState(t0, t1, y, jumped, solver_state, controller_state, values, tape, run)

    def verdict_on(
        self, now: LoopState, active: Array, y: State, error: Any, solver_result: Any
    ) -> _Verdict:
        """Ask the controller about the step that led to y; in a lane that is not `active` nothing
        is kept."""
        error = jax.tree.map(lambda e: jnp.where(jnp.isnan(e), jnp.inf, e), error)
        keep, t0, t1, jumped, controller_state, controller_result = (
            self.settings.controller.adapt_step_size(
                *without_derivatives((now.t0, now.t1, now.y, y, self.inputs.args, error)),
                self.order, now.controller_state,
            )
        )  # fmt: skip
        kept = jnp.asarray(keep & active)
        t0 = jnp.minimum(t0, self.end)
        t1 = jnp.where(t1 > self.nearly, jnp.where(keep, self.end, t0 + 0.5 * (self.end - t0)), t1)
        result = diffrax.RESULTS.where(keep, solver_result, _OK)
        result = diffrax.RESULTS.where(result == _OK, controller_result, result)
        return _Verdict(kept, t0, t1, jumped, controller_state, result)

    def write(self, now: LoopState, kept: Array) -> Tape | None:
        """Writes the step down, if there is a tape."""
        if now.tape is None:
            return None
        row = as_row(now.y, now.solver_state)
        gap = None
        if self.settings.jumps:
            gap = jnp.maximum(now.t0 - now.run.t, 0.0).astype(jnp.float32)
            gap = jnp.where(now.jumped, -jnp.maximum(gap, jnp.finfo(gap.dtype).tiny), gap)
        return _written(now.tape, row, now.t1, gap, now.run.kept, kept)


def _where(which: Array, a: Any, b: Any) -> Any:
    return jax.tree.map(
        lambda a, b: jnp.where(which, a, b) if eqx.is_array(a) or eqx.is_array(b) else a, a, b
    )


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


def empty_tape(settings: Settings, inputs: RunInputs) -> Tape:
    """A tape with room for all steps."""
    steps = settings.max_steps
    if steps is None:
        raise ValueError(
            "max_steps=None knows no bound for what reverse mode has to remember: give max_steps, "
            "or adjoint=diffrax.ForwardMode()"
        )
    row = as_row(inputs.y0, solver_state_of(settings, inputs))
    # So many that spans between rows are no longer than there are rows.
    rows = min(max(ROWS, _power(int((2 * steps) ** 0.5))), _power(steps))
    ends = jnp.zeros(steps + 1, inputs.times.dtype)
    gaps = jnp.zeros(steps + 1, jnp.float32) if settings.jumps else None
    return Tape(jnp.zeros((rows + 1, row.size), row.dtype), ends, gaps)


def solver_state_of(settings: Settings, inputs: RunInputs) -> Any:
    """The state of the solver at the start."""
    state = settings.solver.init(settings.term, inputs.start, inputs.start, inputs.y0, inputs.args)
    return as_arrays(state)


def as_row(y: State, solver_state: Any) -> Float[Array, " r"]:
    """The row of a tape for the state before a step."""
    return ravel_pytree(eqx.filter((y, solver_state), eqx.is_array))[0]


def as_arrays(tree: Any) -> Any:
    """A tree with arrays in the place of numbers and truths, which loops carry."""
    return jax.tree.map(lambda a: jnp.asarray(a) if eqx.is_array_like(a) else a, tree)


def _power(n: int) -> int:
    """The smallest power of two that is not less than n."""
    return 1 << max(n - 1, 0).bit_length()


def checkpoint_level(k: Any, rows: int) -> Array:
    """The level m at which every 2^m-th of the steps up to the k-th is kept in `rows` rows."""
    return 32 - jax.lax.clz(jnp.asarray(k // rows, jnp.int32))


def tape_row(k: Array, rows: int) -> Array:
    """The row of step k, which is a multiple of 2^level; nothing is ever moved: each level fills
    the rows of steps that are of no use to it, odd multiples of half of its own stride."""
    m = checkpoint_level(k, rows).astype(k.dtype)
    half = jnp.where(m > 0, 1 << jnp.maximum(m - 1, 0), 0)
    j = (k - rows * half) >> m
    share = rows >> m
    return jnp.where(m > 0, ((j % share) << m) + half + j // share, k)


def _written(tape: Tape, row: Array, end: Array, gap: Array | None, k: Array, kept: Array) -> Tape:
    rows, steps = len(tape.rows) - 1, len(tape.ends) - 1
    whole = k & ((1 << checkpoint_level(k, rows).astype(k.dtype)) - 1) == 0
    at, k = jnp.where(kept & whole, tape_row(k, rows), rows), jnp.where(kept, k, steps)
    return Tape(
        jax.lax.dynamic_update_index_in_dim(tape.rows, row, at, 0),
        jax.lax.dynamic_update_index_in_dim(tape.ends, end, k, 0),
        None if gap is None else jax.lax.dynamic_update_index_in_dim(tape.gaps, gap, k, 0),
    )
