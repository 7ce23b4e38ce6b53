"""A loop whose batches wait for nobody.

In a batch of loops that end at different times, `jax.lax.while_loop` goes on for all until the last
one ends. Here the next case takes the place of one that is done.
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

# Cases that other devices than a CPU work on together: one that makes place for the next costs
# them more than some steps that nobody needs.
_MANY = 1 << 17

GoesOn = Callable[[Any, Any], Any]
StepFunction = Callable[[Any, Any], Any]


def loop(goes_on: GoesOn, step: StepFunction, fixed: Any, state: Any) -> Any:
    """The state after `while goes_on(fixed, state): state = step(fixed, state)`.

    `fixed` and `state` are pytrees that hold all arrays that the two functions see; `step` must
    leave a state as it is that is done. In a batch, by `jax.vmap` once or several times, 32 cases
    on a CPU (131,072 elsewhere) are worked on at a time; one that is done makes place for the next.
    Each gets the steps that it would get alone, in the order given.

    Differentiable in forward mode, to any order: rates are then a part of the state.
    """
    (own, start), rest = eqx.partition((fixed, state), eqx.is_array)
    given, own_tree = jax.tree.flatten(own)
    at, state_tree = jax.tree.flatten(start)

    def combined(given: _Leaves, at: _Leaves) -> Any:
        trees = jax.tree.unflatten(own_tree, given), jax.tree.unflatten(state_tree, at)
        return eqx.combine(trees, rest)

    def more(given: _Leaves, at: _Leaves) -> Any:
        return goes_on(*combined(given, at))

    def once(given: _Leaves, at: _Leaves) -> _Leaves:
        return jax.tree.leaves(eqx.filter(step(*combined(given, at)), eqx.is_array))

    out = _loop(more, once, given, at, {})
    return eqx.combine(jax.tree.unflatten(state_tree, out), rest[1])


_Leaves = list[Array]
# Rates among the leaves, numbered one list behind the other, with the differentiations that made
# them: they change only what these and others made, and not when a case ends. A case may have
# several of each.
_Riders = dict[int, frozenset[int]]


def _loop(
    more: GoesOn, once: StepFunction, given: _Leaves, start: _Leaves, riders: _Riders
) -> _Leaves:
    """The `loop` of lists of arrays, some of which are `riders`."""
    count = len(given)

    def plain(leaves: _Leaves) -> _Leaves:
        given, start = leaves[:count], leaves[count:]
        return jax.lax.while_loop(
            lambda at: anywhere.bind(more(given, at)), lambda at: once(given, at), start
        )

    def carried(size: int, moves: tuple[bool, ...], leaves: _Leaves) -> Any:
        made = [riders.get(i, frozenset()) for i in range(len(leaves))]
        moving = [by for by, moved in zip(made, moves, strict=True) if moved]
        if not all(moving):
            return None
        rides = [any(by <= own for by in moving) for own in made]
        return _aboard(size, moves, rides, more, once, leaves, count, riders)

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


def _everywhere(size: int, a: Array, moved: bool) -> Array:
    return a if moved else jnp.broadcast_to(a, (size, *a.shape))


def _aboard(
    size: int, moves: tuple[bool, ...], rides: list[bool], more: GoesOn, once: StepFunction,
    leaves: _Leaves, count: int, riders: _Riders,
) -> tuple[_Leaves, list[bool]]:  # fmt: skip
    """The batch rule of riders: a batch in which riders alone differ is one case with so many of
    each that `rides`."""
    axes = [0 if own else None for own in rides]
    every = jax.vmap(once, in_axes=(axes[:count], axes[count:]))

    def step(given: _Leaves, at: _Leaves) -> _Leaves:
        out = zip(every(given, at), rides[count:], strict=True)
        return [a if own else a[0] for a, own in out]

    def goes_on(*now: _Leaves) -> Any:
        first = iter(rides)
        return more(*([a[0] if next(first) else a for a in part] for part in now))

    triples = zip(leaves, moves, rides, strict=True)
    leaves = [_everywhere(size, a, moved) if own else a for a, moved, own in triples]
    return _loop(goes_on, step, leaves[:count], leaves[count:], riders), rides[count:]


def _with_rates(
    more: GoesOn, once: StepFunction, leaves: _Leaves, rates: Any, count: int, riders: _Riders
) -> tuple[_Leaves, Any]:
    """The final state and its rates, which ride with it."""
    moving = [i for i, a in enumerate(leaves) if eqx.is_inexact_array(a)]
    own = sum(i < count for i in moving)  # rates of what is given, behind it
    states = len(leaves) - count

    def pushed(given: _Leaves, at: _Leaves) -> _Leaves:
        now, rate = [*given[:count], *at[:states]], [*given[count:], *at[states:]]

        def by_moving(some: _Leaves) -> tuple[_Leaves, _Leaves]:
            every = list(now)
            for i, a in zip(moving, some, strict=True):
                every[i] = a
            out = once(every[:count], every[count:])
            return [out[i - count] for i in moving[own:]], out

        _, rate, out = jax.jvp(by_moving, ([now[i] for i in moving],), (rate,), has_aux=True)
        return [*out, *rate]

    def goes_on(given: _Leaves, at: _Leaves) -> Any:
        return more(given[:count], at[:states])

    given = [*leaves[:count], *(rates[i] for i in moving[:own])]
    start = [*leaves[count:], *(rates[i] for i in moving[own:])]
    this = frozenset([len(frozenset().union(*riders.values()))])
    old = {i if i < count else i + own: by for i, by in riders.items()}
    places = [*range(count, count + own), *range(count + own + states, len(given) + len(start))]
    new = {at: riders.get(i, this) | this for at, i in zip(places, moving, strict=True)}
    out = _loop(goes_on, pushed, given, start, old | new)
    found = dict(zip(moving[own:], out[states:], strict=True))
    none = jax.dtypes.float0
    return out[:states], [
        found.get(i, np.zeros(leaves[i].shape, none)) for i in range(count, len(leaves))
    ]


class _Ensemble:
    """Cases that go ahead together; their beginnings are of each case where it `moves`."""

    def __init__(
        self, goes_on: GoesOn, step: StepFunction, size: int, moves: tuple[bool, ...]
    ) -> None:
        self.goes_on, self.step = jax.vmap(goes_on), jax.vmap(step)
        self.size, self.moves = size, moves

    def starts(self, size: int, start: _Leaves) -> _Leaves:
        """The beginnings of the first cases, `size` of them."""
        return [
            a[:size] if moved else _everywhere(size, a, False)
            for a, moved in zip(start, self.moves, strict=True)
        ]

    def together(self, fixed: _Leaves, start: _Leaves) -> _Leaves:
        """All cases side by side, until the last one is done."""
        return jax.lax.while_loop(
            lambda state: jnp.any(self.goes_on(fixed, state)),
            lambda state: self.step(fixed, state),
            self.starts(self.size, start),
        )

    def in_batches_of(self, width: int) -> StepFunction:
        """A function that runs all cases, `width` of them at a time."""

        def run(fixed: _Leaves, start: _Leaves) -> _Leaves:
            small = self.size <= width
            return self.together(fixed, start) if small else self.queue(width, fixed, start)

        return run

    def queue(self, width: int, fixed: _Leaves, start: _Leaves) -> _Leaves:
        """The final states, each case taken as soon as there is a place for it."""
        size, nobody = self.size, jnp.asarray(self.size)

        def exchange(now: Any) -> Any:
            """Puts away one case that is done, and takes the next one."""
            done, who, coming, own, state, results = now
            lane = jnp.argmax(done)
            results = _put(results, [_row(a, lane) for a in state], who[lane])
            # When all are taken the lane stays as it is, done, and belongs to nobody. What it is is
            # read from the results: were it read from the state that is overwritten then, XLA would
            # copy all of that.
            old = [_row(a, who[lane]) for a in results]
            there = coming < size
            next_one = jnp.minimum(coming, size - 1)
            pairs = zip(start, self.moves, strict=True)
            new = [_row(a, next_one) if moved else a for a, moved in pairs]
            new = [jnp.where(there, a, b) for a, b in zip(new, old, strict=True)]
            own = _put(own, [_row(a, next_one) for a in fixed], lane)
            who = who.at[lane].set(jnp.where(there, coming, nobody))
            state = _put(state, new, lane)
            return done.at[lane].set(False), who, coming + there, own, state, results

        def body(now: Any) -> Any:
            who, coming, own, state, results = now
            state = self.step(own, state)
            done: Bool[Array, " w"] = ~self.goes_on(own, state) & (who < size)
            now = done, who, coming, own, state, results
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
