"""A loop whose batches wait for nobody.

In a batch of loops that end at different times, `jax.lax.while_loop` goes on for all until the last
one ends. Here the next case takes the place of one that is done.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxbeam._numerics.anywhere import anywhere
from jaxbeam._numerics.batches import CPU_LANES, batchable

_MANY = 8192  # cases that other devices than a CPU work on together

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

    leaves, tree = jax.tree.flatten((own, state))
    fixed_count = len(jax.tree.leaves(own))

    def plain(leaves: list[Array]) -> Any:
        own, state = jax.tree.unflatten(tree, leaves)
        return jax.lax.while_loop(
            lambda state: anywhere.bind(more(own, state)), lambda state: once(own, state), state
        )

    def many(size: int, moves: tuple[bool, ...], leaves: list[Array]) -> Any:
        def whole(given: list[Array], state: Any) -> tuple[Any, Any]:
            moving = iter(given)
            parts = [
                next(moving) if moved else a
                for a, moved in zip(leaves[:fixed_count], moves, strict=False)
            ]
            return jax.tree.unflatten(tree, parts + jax.tree.leaves(state))

        def start(a: Array, moved: bool) -> Array:
            return a if moved else jnp.broadcast_to(a, (size, *a.shape))

        pairs = list(zip(leaves, moves, strict=True))
        given = [a for a, moved in pairs[:fixed_count] if moved]
        states = jax.tree.unflatten(
            jax.tree.structure(state), [start(*pair) for pair in pairs[fixed_count:]]
        )
        ensemble = _Ensemble(lambda *now: more(*whole(*now)), lambda *now: once(*whole(*now)))
        if size <= CPU_LANES:
            return ensemble.together(given, states)
        return jax.lax.platform_dependent(
            given, states, cpu=ensemble.by(CPU_LANES), default=ensemble.by(_MANY)
        )

    @jax.custom_jvp
    def run(leaves: list[Array]) -> Any:
        return batchable(plain, many)(leaves)

    @run.defjvp
    def rule(primals: Any, tangents: Any) -> Any:
        return jax.jvp(plain, primals, tangents)

    return eqx.combine(run(leaves), rest[1])


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
