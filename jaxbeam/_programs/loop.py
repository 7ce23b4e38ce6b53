"""A loop for batches of cases that end after different numbers of steps.

`jax.lax.while_loop` goes on for all cases of a batch until the last one ends. Here the next case
takes the place of one that is done.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxbeam._programs.anywhere import anywhere
from jaxbeam._programs.batches import CPU_LANES, batchable, reaches
from jaxbeam._programs.platforms import by_platform

# Cases that a GPU works on together: replacing one that is done costs more there than some
# superfluous steps.
_MANY = 1 << 17

GoesOn = Callable[[Any, Any], Any]
StepFunction = Callable[[Any, Any], Any]


def loop(goes_on: GoesOn, step: StepFunction, fixed: Any, state: Any) -> Any:
    """The state after `while goes_on(fixed, state): state = step(fixed, state)`.

    `fixed` and `state` are pytrees with all arrays that the two functions use; `step` must not
    change a state that is done. Of a batch, by `jax.vmap` once or several times, 32 cases on a CPU
    (131,072 elsewhere) are worked on at a time, and the next one takes the place of one that is
    done. Each gets the steps that it would get alone, in their order.

    Differentiable in forward mode, to any order: rates are then a part of the state.
    """
    (arrays, start), rest = eqx.partition((fixed, state), eqx.is_array)
    given, arrays_tree = jax.tree.flatten(arrays)
    at, state_tree = jax.tree.flatten(start)

    def combined(given: _Leaves, at: _Leaves) -> Any:
        trees = jax.tree.unflatten(arrays_tree, given), jax.tree.unflatten(state_tree, at)
        return eqx.combine(trees, rest)

    def more(given: _Leaves, at: _Leaves) -> Any:
        return goes_on(*combined(given, at))

    def once(given: _Leaves, at: _Leaves) -> _Leaves:
        return jax.tree.leaves(eqx.filter(step(*combined(given, at)), eqx.is_array))

    out = _loop(more, once, given, at, {})
    return eqx.combine(jax.tree.unflatten(state_tree, out), rest[1])


_Leaves = list[Array]
# Indices of leaves that are rates, counted through both lists of leaves, each with the set of
# differentiations (numbered) that made it. Rates influence only other rates, not when a case ends.
# So one case may carry several values of each: a batch in which only rates differ is one loop.
_Riders = dict[int, frozenset[int]]


def _loop(
    more: GoesOn, once: StepFunction, given: _Leaves, start: _Leaves, riders: _Riders
) -> _Leaves:
    """The `loop` by lists of arrays, some of which are rates, `riders` (see `_Riders`)."""
    count = len(given)

    def plain(leaves: _Leaves) -> _Leaves:
        given, start = leaves[:count], leaves[count:]
        return jax.lax.while_loop(
            lambda at: anywhere.bind(more(given, at)), lambda at: once(given, at), start
        )

    def carried(size: int, moves: tuple[bool, ...], leaves: _Leaves) -> Any:
        made = [riders.get(i, frozenset()) for i in range(len(leaves))]
        moving = [origins for origins, moved in zip(made, moves, strict=True) if moved]
        if not all(moving):
            return None
        rides = [any(origins <= origin for origins in moving) for origin in made]
        return _batch_of_rates(size, moves, rides, more, once, leaves, count, riders)

    def many(size: int, moves: tuple[bool, ...], leaves: _Leaves) -> _Leaves:
        def whole(moving: _Leaves, at: _Leaves) -> tuple[_Leaves, _Leaves]:
            rest = iter(moving)
            pairs = zip(leaves[:count], moves, strict=False)
            return [next(rest) if moved else a for a, moved in pairs], at

        moving = [a for a, moved in zip(leaves[:count], moves, strict=False) if moved]
        ensemble = _Ensemble(
            lambda *now: more(*whole(*now)), lambda *now: once(*whole(*now)), size, moves[count:]
        )
        if not reaches(size, CPU_LANES + 1):
            return ensemble.together(moving, leaves[count:])
        return by_platform(
            moving,
            leaves[count:],
            cpu=ensemble.in_batches_of(CPU_LANES),
            default=ensemble.in_batches_of(_MANY),
        )

    @jax.custom_jvp
    def run(leaves: _Leaves) -> _Leaves:
        return batchable(plain, many, unless=carried)(leaves)

    @run.defjvp
    def rule(primals: tuple[_Leaves], tangents: tuple[Any]) -> tuple[_Leaves, Any]:
        return _with_rates(more, once, primals[0], tangents[0], count, riders)

    return run([*given, *start])


def _for_each_case(size: int, a: Array, moved: bool) -> Array:
    return a if moved else jnp.broadcast_to(a, (size, *a.shape))


def _batch_of_rates(
    size: int, moves: tuple[bool, ...], rides: list[bool], more: GoesOn, once: StepFunction,
    leaves: _Leaves, count: int, riders: _Riders,
) -> tuple[_Leaves, list[bool]]:  # fmt: skip
    """The loop of a batch in which only rates differ between cases: that of one case, with `size`
    values of each leaf that `rides`."""
    axes = [0 if is_rate else None for is_rate in rides]
    every = jax.vmap(once, in_axes=(axes[:count], axes[count:]))

    def step(given: _Leaves, at: _Leaves) -> _Leaves:
        out = zip(every(given, at), rides[count:], strict=True)
        return [a if is_rate else a[0] for a, is_rate in out]

    def goes_on(*now: _Leaves) -> Any:
        first = iter(rides)
        return more(*([a[0] if next(first) else a for a in part] for part in now))

    triples = zip(leaves, moves, rides, strict=True)
    leaves = [_for_each_case(size, a, moved) if is_rate else a for a, moved, is_rate in triples]
    return _loop(goes_on, step, leaves[:count], leaves[count:], riders), rides[count:]


def _with_rates(
    more: GoesOn, once: StepFunction, leaves: _Leaves, rates: Any, count: int, riders: _Riders
) -> tuple[_Leaves, Any]:
    """The final state of the loop and its rates, which are carried along as parts of the state."""
    moving = [i for i, a in enumerate(leaves) if eqx.is_inexact_array(a)]
    n_given = sum(i < count for i in moving)  # number of rates of `given`, which come after it
    states = len(leaves) - count

    def pushed(given: _Leaves, at: _Leaves) -> _Leaves:
        now, rate = [*given[:count], *at[:states]], [*given[count:], *at[states:]]

        def by_moving(some: _Leaves) -> tuple[_Leaves, _Leaves]:
            every = list(now)
            for i, a in zip(moving, some, strict=True):
                every[i] = a
            out = once(every[:count], every[count:])
            return [out[i - count] for i in moving[n_given:]], out

        _, rate, out = jax.jvp(by_moving, ([now[i] for i in moving],), (rate,), has_aux=True)
        return [*out, *rate]

    def goes_on(given: _Leaves, at: _Leaves) -> Any:
        return more(given[:count], at[:states])

    given = [*leaves[:count], *(rates[i] for i in moving[:n_given])]
    start = [*leaves[count:], *(rates[i] for i in moving[n_given:])]
    this = frozenset([len(frozenset().union(*riders.values()))])
    old = {i if i < count else i + n_given: makers for i, makers in riders.items()}
    places = [
        *range(count, count + n_given),
        *range(count + n_given + states, len(given) + len(start)),
    ]
    new = {at: riders.get(i, this) | this for at, i in zip(places, moving, strict=True)}
    out = _loop(goes_on, pushed, given, start, old | new)
    found = dict(zip(moving[n_given:], out[states:], strict=True))
    none = jax.dtypes.float0
    return out[:states], [
        found.get(i, np.zeros(leaves[i].shape, none)) for i in range(count, len(leaves))
    ]


class _Ensemble:
    """A batch of `size` cases of a loop; `moves` says which leaves of the state begin with a value
    for each case."""

    def __init__(
        self, goes_on: GoesOn, step: StepFunction, size: int, moves: tuple[bool, ...]
    ) -> None:
        self.goes_on, self.step = jax.vmap(goes_on), jax.vmap(step)
        self.size, self.moves = size, moves

    def starts(self, size: int, start: _Leaves) -> _Leaves:
        """First states of the first `size` cases."""
        return [
            a[:size] if moved else _for_each_case(size, a, False)
            for a, moved in zip(start, self.moves, strict=True)
        ]

    def together(self, fixed: _Leaves, start: _Leaves) -> _Leaves:
        """The final states, with steps for all cases until the last one is done."""
        return jax.lax.while_loop(
            lambda state: jnp.any(self.goes_on(fixed, state)),
            lambda state: self.step(fixed, state),
            self.starts(self.size, start),
        )

    def in_batches_of(self, width: int) -> StepFunction:
        """A function that returns the final states of all cases, worked on `width` at a time."""

        def run(fixed: _Leaves, start: _Leaves) -> _Leaves:
            small = self.size <= width
            return self.together(fixed, start) if small else self.queue(width, fixed, start)

        return run

    def queue(self, width: int, fixed: _Leaves, start: _Leaves) -> _Leaves:
        """The final states, with `width` lanes: the next case starts where one is done."""
        size, no_case = self.size, jnp.asarray(self.size)

        def exchange(now: Any) -> Any:
            """Store the result of one case that is done, and start the next one in its lane."""
            done, who, coming, lane_fixed, state, results = now
            lane = jnp.argmax(done)
            results = _put(results, [_row(a, lane) for a in state], who[lane])
            # When all cases have been started, the lane keeps its final state and belongs to no
            # case. That state is read from the results: if it were read from `state`, which is
            # overwritten next, XLA would copy all of that.
            old = [_row(a, who[lane]) for a in results]
            is_left = coming < size
            next_one = jnp.minimum(coming, size - 1)
            pairs = zip(start, self.moves, strict=True)
            new = [_row(a, next_one) if moved else a for a, moved in pairs]
            new = [jnp.where(is_left, a, b) for a, b in zip(new, old, strict=True)]
            lane_fixed = _put(lane_fixed, [_row(a, next_one) for a in fixed], lane)
            who = who.at[lane].set(jnp.where(is_left, coming, no_case))
            state = _put(state, new, lane)
            return done.at[lane].set(False), who, coming + is_left, lane_fixed, state, results

        def body(now: Any) -> Any:
            who, coming, lane_fixed, state, results = now
            state = self.step(lane_fixed, state)
            done: Bool[Array, " w"] = ~self.goes_on(lane_fixed, state) & (who < size)
            now = done, who, coming, lane_fixed, state, results
            return jax.lax.while_loop(lambda now: jnp.any(now[0]), exchange, now)[1:]

        first = [a[:width] for a in fixed]
        now = (
            jnp.arange(width), jnp.asarray(width), first, self.starts(width, start),
            self.starts(size, start),
        )  # fmt: skip
        return jax.lax.while_loop(lambda now: jnp.any(now[0] < size), body, now)[4]


def _row(a: Array, i: Array) -> Array:
    return jax.lax.dynamic_index_in_dim(a, i, 0, False)


def _put(leaves: _Leaves, rows: _Leaves, i: Array) -> _Leaves:
    return [
        jax.lax.dynamic_update_index_in_dim(a, row, i, 0)
        for a, row in zip(leaves, rows, strict=True)
    ]
