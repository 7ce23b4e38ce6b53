"""The reverse mode of a run: one sweep backwards over the steps that were made."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jaxbeam._numerics.kernel import reverse_mode
from jaxbeam._solvers.run import (
    Given,
    Run,
    Step,
    Tape,
    Task,
    anywhere,
    as_arrays,
    blank,
    level,
    march,
    output,
    place,
    solver_state_of,
)


@eqx.filter_custom_vjp
def run(given: Given, task: Task) -> Run:
    """Runs the task, with reverse mode by the discrete adjoint: of `outputs`, `y` and `last`.

    The derivative of what was computed, to rounding: each step that was kept is transposed, with
    its length as it is (as in diffrax, error control carries no derivatives). Before each step the
    state is written down: `ROWS` = 1024 states at most; where steps are more, every 2nd, 4th, ...
    is, and those between are computed once more. Besides, two numbers for each of `max_steps`, and
    a third where something may jump.

    Derivatives of derivatives: forward over reverse.
    """
    return march(task, given)[0]


@run.def_fwd
def _forwards(perturbed: Any, given: Given, task: Task) -> tuple[Run, tuple[Tape, Array, Array]]:
    result, tape = march(task, given, blank(task, given))
    assert tape is not None
    return result, (tape, result.kept, ~(result.t < given.times[-1]))


class _Back(NamedTuple):
    """Where the sweep is: in each span between two rows of the tape it goes up, computing the
    states in between anew, and then down."""

    k: Array  # the step to be looked at
    first: Array  # of the span
    up: Array
    span: Float[Array, "s+1 r"]  # states before its steps
    output: Array  # the last one that was not yet looked at
    row: Float[Array, " r"]  # what belongs to the state after step k
    given: Any  # what belongs to the arguments, so far


@run.def_bwd
def _backwards(residuals: Any, out: Run, perturbed: Any, given: Given, task: Task) -> Any:
    (tape, count, finished), solver = residuals, task.solver
    steps, rows = len(tape.ends) - 1, len(tape.rows) - 1
    times, m = given.times, ravel_pytree(given.y0)[0].size
    moving, still = eqx.partition(given, perturbed)
    start_state, shape = eqx.partition((given.y0, solver_state_of(task, given)), eqx.is_array)
    _, unravel = ravel_pytree(start_state)
    zero = jnp.zeros_like(tape.rows[0])
    at_outputs = jnp.zeros((times.size, m), zero.dtype) if out.outputs is None else out.outputs
    at_end = zero[:m] if out.y is None else out.y
    longest = 1 << ((steps - 1) // rows).bit_length()  # span
    stride = 1 << level(jnp.maximum(count - 1, 0), rows).astype(count.dtype)

    def advance(moving: Any, row: Array, k: Array) -> tuple[Array, Step]:
        own: Given = eqx.combine(moving, still)
        ends = tape.ends[k]
        t0, t1, jumped = ends[0], ends[1], ends[2] > 0 if task.jumps else False
        t0 = jnp.where(k == 0, own.start, t0)
        t1 = jnp.where((k == count - 1) & finished, own.times[-1], t1)
        y, solver_state = eqx.combine(unravel(row), shape)
        y, _, info, solver_state, _ = solver.step(
            task.term, t0, t1, y, own.args, solver_state, jumped
        )
        row, _ = ravel_pytree(eqx.filter((y, as_arrays(solver_state)), eqx.is_array))
        return row, Step(t0, t1, info)

    def row_of(first: Array) -> Array:
        return tape.rows[place(jnp.maximum(first, 0), rows)]

    first = jnp.maximum(count - 1, 0) & ~(stride - 1)
    back = _Back(
        first,
        first,
        first < count - 1,
        jnp.zeros((longest + 1, zero.size), zero.dtype).at[0].set(row_of(first)),
        _reached(times, tape, count),
        zero.at[:m].set(at_end),
        jax.tree.map(jnp.zeros_like, moving),
    )
    back = back._replace(k=jnp.where(count > 0, back.k, -1))

    def body(back: _Back) -> _Back:
        k, first = back.k, back.first
        active = k >= 0
        k = jnp.maximum(k, 0)
        down = active & ~back.up
        row = back.span[k - first]
        with reverse_mode():
            (after, step), pull = jax.vjp(lambda moving, row: advance(moving, row, k), moving, row)
        before = jnp.where(k > 0, tape.ends[k - 1, 1], -jnp.inf)

        def here(i: Array) -> Array:
            return down & (i > 0) & (times[i] > before)

        def gather(state: Any) -> Any:
            i, at_step, at_times = state
            own = here(i)
            _, pull = jax.vjp(lambda step, t: output(solver, step, t), step, times[i])
            to_step, to_t = pull(jnp.where(own, at_outputs[i], 0.0))
            at_step = jax.tree.map(jnp.add, at_step, to_step)
            if at_times is not None:
                at_times = at_times.at[i].add(to_t)
            return i - own, at_step, at_times

        at_step = jax.tree.map(jnp.zeros_like, step)
        if out.last is not None:
            at_step = jax.tree.map(
                lambda a, b: a if b is None else jnp.where(k == count - 1, b, a),
                at_step, out.last, is_leaf=lambda x: x is None,
            )  # fmt: skip
        at_times = None if moving.times is None else jnp.zeros_like(times)
        i, at_step, at_times = jax.lax.while_loop(
            lambda state: anywhere.bind(here(state[0])), gather, (back.output, at_step, at_times)
        )
        to_given, to_row = pull((back.row, at_step))
        if at_times is not None:
            to_given = eqx.tree_at(lambda g: g.times, to_given, to_given.times + at_times)
        # Where a lane failed, states may not be finite, but then nothing depends on them.
        weights = jax.tree.leaves((back.row, at_step))
        matters = down & jnp.any(jnp.stack([jnp.any(a != 0) for a in weights]))
        total = jax.tree.map(lambda a, b: a + jnp.where(matters, b, 0.0), back.given, to_given)
        to_row = jnp.where(down, jnp.where(matters, to_row, 0.0), back.row)

        # To the next step: up to the last one of the span, then down to its first.
        top = jnp.minimum(first + stride, count) - 1
        up = back.up & (k + 1 < top)
        done = down & (k == first)
        lower = jnp.where(done, first - stride, first)
        k = jnp.where(back.up, k + 1, jnp.where(done & (stride > 1), lower, k - 1))
        up = up | (done & (stride > 1))
        at = jnp.where(done, 0, jnp.where(active & back.up, k - first, longest))
        row = jnp.where(done, row_of(lower), after)
        span = jax.lax.dynamic_update_index_in_dim(back.span, row, at, 0)
        k = jnp.where(active & (lower >= 0), k, -1)
        return _Back(k, lower, up, span, i, to_row, total)

    back = jax.lax.while_loop(lambda back: anywhere.bind(back.k >= 0), body, back)
    # The first output is the state at the start, on which the first state of the solver depends.
    to_y0 = at_outputs[0]

    def start(moving: Any) -> Array:
        own: Given = eqx.combine(moving, still)
        state = solver_state_of(task, own)
        return ravel_pytree(eqx.filter((own.y0, state), eqx.is_array))[0]

    _, pull = jax.vjp(start, moving)
    (to_given,) = pull(back.row.at[:m].add(to_y0))
    return jax.tree.map(jnp.add, back.given, to_given)


def _reached(times: Array, tape: Tape, count: Array) -> Array:
    """The last output within the steps that were made."""
    end = tape.ends[jnp.maximum(count - 1, 0), 1]
    return jnp.where(count > 0, jnp.sum(times <= end) - 1, 0)
