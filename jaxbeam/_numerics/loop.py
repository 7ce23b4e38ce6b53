"""A loop whose batches wait for nobody.

In a batch of loops that end at different times, `jax.lax.while_loop` goes on for all until the last
one ends. Here the next case takes the place of one that is done.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Bool

from jaxbeam._numerics.anywhere import anywhere

_LANES = 32  # cases that a CPU works on together: their matrices stay in the cache
_MANY = 8192  # the same elsewhere

GoesOn = Callable[[Any, Any], Any]
Step = Callable[[Any, Any], Any]


def loop(goes_on: GoesOn, step: Step, fixed: Any, state: Any) -> Any:
    """The state after `while goes_on(fixed, state): state = step(fixed, state)`.

    `fixed` and `state` are pytrees that hold all arrays that the two functions see; `step` must
    leave a state as it is that is done. In a batch, by `jax.vmap` once or several times, 32 cases
    on a CPU (8192 elsewhere) are worked on at a time; one that is done makes place for the next.
    Each gets the steps that it would get alone, in the order given.

    Differentiable in forward mode, in which a batch goes on for all until the last one ends.
    """

    (own, state), rest = eqx.partition((fixed, state), eqx.is_array)

    def more(own: Any, state: Any) -> Any:
        return goes_on(*eqx.combine((own, state), rest))

    def once(own: Any, state: Any) -> Any:
        return eqx.filter(step(*eqx.combine((own, state), rest)), eqx.is_array)

    def plain(own: Any, state: Any) -> Any:
        return jax.lax.while_loop(
            lambda state: anywhere.bind(more(own, state)), lambda state: once(own, state), state
        )

    @jax.custom_jvp
    def run(own: Any, state: Any) -> Any:
        return _batchable(plain, more, once)(own, state)

    @run.defjvp
    def rule(primals: tuple[Any, Any], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
        return jax.jvp(plain, primals, tangents)

    return eqx.combine(run(own, state), rest[1])


def _batchable(plain: Step, goes_on: GoesOn, step: Step) -> Step:
    one = custom_vmap(plain)

    @one.def_vmap
    def rule(size: int, batched: Any, fixed: Any, state: Any) -> tuple[Any, Any]:
        leaves, tree = jax.tree.flatten(fixed)
        flags = jax.tree.leaves(batched[0])
        start = jax.tree.map(lambda a, own: _repeated(a, own, size), state, batched[1])
        own = [a for a, moves in zip(leaves, flags, strict=True) if moves]
        shared = [a for a, moves in zip(leaves, flags, strict=True) if not moves]

        def steps(shared: list[Array], moves: list[bool]) -> _Ensemble:
            def whole(own: list[Array]) -> Any:
                parts = iter(shared), iter(own)
                return jax.tree.unflatten(tree, [next(parts[moved]) for moved in moves])

            return _Ensemble(
                lambda own, state: goes_on(whole(own), state),
                lambda own, state: step(whole(own), state),
            )

        out = _of_cases(steps, flags)(shared, own, start)
        return out, jax.tree.map(lambda _: True, out)

    return one


def _repeated(a: Array, batched: bool, size: int) -> Array:
    return a if batched else jnp.broadcast_to(a, (size, *a.shape))


def _of_cases(steps: Callable[..., "_Ensemble"], moves: list[bool]) -> Callable[..., Any]:
    """The loop of n cases, of what they share, what is their own (n, ...), and states (n, ...).

    A batch of b of these is one of b n cases.
    """

    @custom_vmap
    def function(shared: list[Array], own: list[Array], start: Any) -> Any:
        ensemble = steps(shared, moves)
        if len(jax.tree.leaves(start)[0]) <= _LANES:
            return ensemble.together(own, start)
        return jax.lax.platform_dependent(
            own, start, cpu=ensemble.by(_LANES), default=ensemble.by(_MANY)
        )

    @function.def_vmap
    def rule(size: int, batched: Any, shared: Any, own: Any, start: Any) -> tuple[Any, Any]:
        n = len(jax.tree.leaves(start)[0])

        def flat(a: Array, batched: bool) -> Array:
            return _repeated(a, batched, size).reshape(size * n, *a.shape[1 + batched :])

        def copied(a: Array) -> Array:
            return jnp.repeat(a, n, 0)

        # What groups of cases share, but not all of them, each case gets a copy of.
        parts = iter(zip(shared, batched[0], strict=True)), iter(zip(own, batched[1], strict=True))
        some: tuple[list[Array], list[Array]] = [], []
        flags = []
        for moved in moves:
            a, varies = next(parts[moved])
            flags.append(moved or varies)
            some[flags[-1]].append(flat(a, varies) if moved else copied(a) if varies else a)
        states = jax.tree.map(flat, start, batched[2])
        out = _of_cases(steps, flags)(*some, states)
        out = jax.tree.map(lambda a: a.reshape(size, n, *a.shape[1:]), out)
        return out, jax.tree.map(lambda _: True, out)

    return function


class _Ensemble:
    """Cases that go ahead together."""

    def __init__(self, goes_on: GoesOn, step: Step) -> None:
        self.goes_on, self.step = jax.vmap(goes_on), jax.vmap(step)

    def together(self, fixed: Any, state: Any) -> Any:
        """All until the last one is done."""
        return jax.lax.while_loop(
            lambda state: jnp.any(self.goes_on(fixed, state)),
            lambda state: self.step(fixed, state),
            state,
        )

    def by(self, width: int) -> Step:
        """So many at a time."""

        def run(fixed: Any, start: Any) -> Any:
            size = len(jax.tree.leaves(start)[0])
            return self.together(fixed, start) if size <= width else self.queue(width, fixed, start)

        return run

    def queue(self, width: int, fixed: Any, start: Any) -> Any:
        """Each as soon as there is a place for it."""
        cases = fixed, start
        size = len(jax.tree.leaves(start)[0])
        lanes = jax.tree.map(lambda a: a[:width], cases)
        nobody = jnp.asarray(size)

        def exchange(now: Any) -> Any:
            """Puts away one case that is done, and takes the next one."""
            done, who, coming, lanes, results = now
            lane = jnp.argmax(done)
            results = _put(results, _taken(lanes[1], lane), who[lane])
            # When all are taken the lane stays as it is, done, and belongs to nobody.
            there = coming < size
            new, old = _taken(cases, jnp.minimum(coming, size - 1)), _taken(lanes, lane)
            lanes = _put(lanes, jax.tree.map(lambda a, b: jnp.where(there, a, b), new, old), lane)
            who = who.at[lane].set(jnp.where(there, coming, nobody))
            return done.at[lane].set(False), who, coming + there, lanes, results

        def body(now: Any) -> Any:
            who, coming, (own, state), results = now
            state = self.step(own, state)
            done: Bool[Array, " w"] = ~self.goes_on(own, state) & (who < size)
            now = done, who, coming, (own, state), results
            return jax.lax.while_loop(lambda now: jnp.any(now[0]), exchange, now)[1:]

        now = jnp.arange(width), jnp.asarray(width), lanes, start
        return jax.lax.while_loop(lambda now: jnp.any(now[0] < size), body, now)[3]


def _taken(tree: Any, i: Array) -> Any:
    return jax.tree.map(lambda a: jax.lax.dynamic_index_in_dim(a, i, 0, False), tree)


def _put(tree: Any, row: Any, i: Array) -> Any:
    return jax.tree.map(lambda a, b: jax.lax.dynamic_update_index_in_dim(a, b, i, 0), tree, row)
