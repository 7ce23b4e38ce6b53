"""The reverse mode of a run: one sweep backwards over the steps that were made."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jaxbeam._programs.anywhere import anywhere
from jaxbeam._programs.kernel import reverse_mode
from jaxbeam._programs.loop import loop
from jaxbeam._solvers.run import (
    Run,
    RunInputs,
    Settings,
    Step,
    Tape,
    as_arrays,
    as_row,
    checkpoint_level,
    empty_tape,
    integrate_steps,
    output,
    solver_state_of,
    tape_row,
)
from jaxbeam._solvers.system import State


@eqx.filter_custom_vjp
def run(inputs: RunInputs, settings: Settings) -> Run:
    """Runs the task, with reverse mode by the discrete adjoint: of `outputs`, `y` and `last`.

    The derivative of what was computed, to rounding: each step that was kept is transposed, with
    its length as it is (as in diffrax, error control carries no derivatives). Before each step the
    state is written down: `ROWS` = 1024 states at most; where steps are more, every 2nd, 4th, ...
    is, and those between are computed once more. Besides, a number for each of `max_steps`, and
    half of one more where something may jump.

    Derivatives of derivatives: forward over reverse.
    """
    return integrate_steps(settings, inputs)[0]


@run.def_fwd
def _forwards(
    perturbed: Any, inputs: RunInputs, settings: Settings
) -> tuple[Run, tuple[Tape, Array, Array]]:
    result, tape = integrate_steps(settings, inputs, empty_tape(settings, inputs))
    assert tape is not None
    return result, (tape, result.kept, ~(result.t < inputs.times[-1]))


class _Back(NamedTuple):
    """The state of the sweep: in each span between two rows of the tape it goes up, computing the
    states in between anew, and then down."""

    k: Array  # the step to be looked at
    first: Array  # of the span
    up: Array
    span: Float[Array, "S r"]  # states before its steps
    output: Array  # the last one that was not yet looked at
    row: Float[Array, " r"]  # cotangent of the state after step k
    inputs: Any  # cotangent of the arguments, so far


class _Sweep(NamedTuple):
    """The constants of the way back, and how a step is made."""

    settings: Settings
    moving: Any  # what is given and derivatives are asked by
    still: Any  # the rest of what is given
    times: Float[Array, " T"]
    tape: Tape
    unpack: Callable[[Array], tuple[State, Any]]  # y and the solver's state, from a row
    steps: Array  # that were kept
    finished: Array  # whether the last one ended at the last time
    at_outputs: Float[Array, "T m"]  # cotangent of the outputs
    at_last: Step | None  # cotangent of the last step
    longest: int  # span that may be
    stride: Array  # steps from row to row

    def row_of(self, first: Array) -> Array:
        """Reads the state before the first step of a span from the tape."""
        return self.tape.rows[tape_row(jnp.maximum(first, 0), len(self.tape.rows) - 1)]

    def advance(self, moving: Any, row: Array, k: Array) -> tuple[Array, Step]:
        """Makes step k anew from the state in `row`; returns the state after it, and the step."""
        settings, t1 = self.settings, self.tape.ends[k]
        own: RunInputs = eqx.combine(moving, self.still)
        t0, jumped = self.tape.start_of(k)
        t0 = jnp.where(k == 0, own.start, t0)
        t1 = jnp.where((k == self.steps - 1) & self.finished, own.times[-1], t1)
        y, solver_state = self.unpack(row)
        y, _, info, solver_state, _ = settings.solver.step(
            settings.term, t0, t1, y, own.args, solver_state, jumped
        )
        return as_row(y, as_arrays(solver_state)), Step(t0, t1, info)

    def goes_on(self, back: _Back) -> Array:
        return back.k >= 0

    def step(self, back: _Back) -> _Back:
        """Looks at step k, up or down, and goes on; nothing changes in a lane that is done."""
        active = back.k >= 0
        k = jnp.maximum(back.k, 0)
        down = active & ~back.up
        row = back.span[k - back.first]
        with reverse_mode():
            (after, step), pull = jax.vjp(
                lambda moving, row: self.advance(moving, row, k), self.moving, row
            )
        i, at_step, at_times = self.gather(back.output, k, down, step)
        # Where all lanes go up there is nothing to be pulled back.
        to_given, to_row = jax.lax.cond(
            anywhere.bind(down),
            lambda: pull((back.row, at_step)),
            lambda: jax.tree.map(jnp.zeros_like, (self.moving, row)),
        )
        if at_times is not None:
            to_given = eqx.tree_at(lambda g: g.times, to_given, to_given.times + at_times)
        # Where a lane failed, states may not be finite, but then nothing depends on them.
        weights = jax.tree.leaves((back.row, at_step))
        matters = down & jnp.any(jnp.stack([jnp.any(a != 0) for a in weights]))
        total = jax.tree.map(lambda a, b: a + jnp.where(matters, b, 0.0), back.inputs, to_given)
        to_row = jnp.where(down, jnp.where(matters, to_row, 0.0), back.row)
        back = self.move(back, k, active, down, after)
        return back._replace(output=i, row=to_row, inputs=total)

    def gather(self, i: Array, k: Array, down: Array, step: Step) -> tuple[Array, Step, Any]:
        """Takes the outputs within step k, from the i-th one downwards, if the sweep goes down.

        Returns the last one before the step, and the cotangents of the step and of the times.
        """
        before = jnp.where(k > 0, self.tape.ends[k - 1], -jnp.inf)

        def here(i: Array) -> Array:
            return down & (i > 0) & (self.times[i] > before)

        def add(state: Any) -> Any:
            i, at_step, at_times = state
            own = here(i)
            _, pull = jax.vjp(
                lambda step, t: output(self.settings.solver, step, t), step, self.times[i]
            )
            to_step, to_t = pull(jnp.where(own, self.at_outputs[i], 0.0))
            at_step = jax.tree.map(jnp.add, at_step, to_step)
            if at_times is not None:
                at_times = at_times.at[i].add(to_t)
            return i - own, at_step, at_times

        at_step = jax.tree.map(jnp.zeros_like, step)
        if self.at_last is not None:
            at_step = jax.tree.map(
                lambda a, b: a if b is None else jnp.where(k == self.steps - 1, b, a),
                at_step, self.at_last, is_leaf=lambda x: x is None,
            )  # fmt: skip
        at_times = None if self.moving.times is None else jnp.zeros_like(self.times)
        return jax.lax.while_loop(
            lambda state: anywhere.bind(here(state[0])), add, (i, at_step, at_times)
        )

    def move(self, back: _Back, k: Array, active: Array, down: Array, after: Array) -> _Back:
        """Goes to the next step: up to the last one of the span, then down to its first. On the
        way up the state after step k is kept."""
        first, stride = back.first, self.stride
        top = jnp.minimum(first + stride, self.steps) - 1
        up = back.up & (k + 1 < top)
        done = down & (k == first)
        lower = jnp.where(done, first - stride, first)
        k = jnp.where(back.up, k + 1, jnp.where(done & (stride > 1), lower, k - 1))
        up = up | (done & (stride > 1))
        at = jnp.where(done, 0, jnp.where(active & back.up, k - first, self.longest))
        row = jnp.where(done, self.row_of(lower), after)
        span = jax.lax.dynamic_update_index_in_dim(back.span, row, at, 0)
        k = jnp.where(active & (lower >= 0), k, -1)
        return back._replace(k=k, first=lower, up=up, span=span)


@run.def_bwd
def _backwards(
    residuals: Any, out: Run, perturbed: Any, inputs: RunInputs, settings: Settings
) -> Any:
    sweep, back = _begin(residuals, out, perturbed, inputs, settings)
    back = loop(_Sweep.goes_on, _Sweep.step, sweep, back)
    # The first output is the state at the start, on which the first state of the solver depends.
    to_y0 = sweep.at_outputs[0]

    def start(moving: Any) -> Array:
        own: RunInputs = eqx.combine(moving, sweep.still)
        return as_row(own.y0, solver_state_of(settings, own))

    _, pull = jax.vjp(start, sweep.moving)
    (to_given,) = pull(back.row.at[: to_y0.size].add(to_y0))
    return jax.tree.map(jnp.add, back.inputs, to_given)


def _begin(
    residuals: tuple[Tape, Array, Array],
    out: Run,
    perturbed: Any,
    inputs: RunInputs,
    settings: Settings,
) -> tuple[_Sweep, _Back]:
    """Puts the sweep at the first step of the last span."""
    tape, count, finished = residuals
    steps, rows = len(tape.ends) - 1, len(tape.rows) - 1
    times, m = inputs.times, ravel_pytree(inputs.y0)[0].size
    moving, still = eqx.partition(inputs, perturbed)
    start_state, shape = eqx.partition((inputs.y0, solver_state_of(settings, inputs)), eqx.is_array)
    _, unravel = ravel_pytree(start_state)
    zero = jnp.zeros_like(tape.rows[0])
    at_outputs = jnp.zeros((times.size, m), zero.dtype) if out.outputs is None else out.outputs
    at_end = zero[:m] if out.y is None else out.y
    longest = 1 << ((steps - 1) // rows).bit_length()
    stride = 1 << checkpoint_level(jnp.maximum(count - 1, 0), rows).astype(count.dtype)
    sweep = _Sweep(
        settings, moving, still, times, tape, lambda row: eqx.combine(unravel(row), shape),
        count, finished, at_outputs, out.last, longest, stride,
    )  # fmt: skip
    first = jnp.maximum(count - 1, 0) & ~(stride - 1)
    back = _Back(
        first,
        first,
        first < count - 1,
        jnp.zeros((longest + 1, zero.size), zero.dtype).at[0].set(sweep.row_of(first)),
        _reached(times, tape, count),
        zero.at[:m].set(at_end),
        jax.tree.map(jnp.zeros_like, moving),
    )
    return sweep, back._replace(k=jnp.where(count > 0, back.k, -1))


def _reached(times: Array, tape: Tape, count: Array) -> Array:
    """The last output within the steps that were made."""
    end = tape.ends[jnp.maximum(count - 1, 0)]
    return jnp.where(count > 0, jnp.sum(times <= end) - 1, 0)
