"""Functions that know what to do with a batch, however many `jax.vmap` it comes from."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array

# From the number of cases, which leaves are of each case, and all leaves, to results (n, ...).
Many = Callable[[int, tuple[bool, ...], list[Array]], Any]

CPU_LANES = 32  # cases that a CPU works on together: their matrices stay in the cache


def batchable(one: Callable[..., Any], many: Many) -> Callable[..., Any]:
    """`one` of a list of arrays; a batch of it is `many`.

    Batches of batches are one batch, in which cases get copies of what only some of them share.
    """
    function = custom_vmap(lambda leaves: one(leaves))

    @function.def_vmap
    def rule(size: int, batched: Any, leaves: list[Array]) -> tuple[Any, Any]:
        out = _batch(many, size, tuple(batched[0]))(leaves)
        return out, jax.tree.map(lambda _: True, out)

    return function


def _batch(many: Many, size: int, own: tuple[bool, ...]) -> Callable[..., Any]:
    function = custom_vmap(lambda leaves: many(size, own, leaves))

    @function.def_vmap
    def rule(more: int, batched: Any, leaves: list[Array]) -> tuple[Any, Any]:
        def flat(a: Array, own: bool, varies: bool) -> Array:
            if not own:
                return jnp.repeat(a, size, 0) if varies else a
            a = a if varies else jnp.broadcast_to(a, (more, *a.shape))
            return a.reshape(more * size, *a.shape[2:])

        all_flat = [flat(*each) for each in zip(leaves, own, batched[0], strict=True)]
        moves = tuple(a or b for a, b in zip(own, batched[0], strict=True))
        out = _batch(many, more * size, moves)(all_flat)
        out = jax.tree.map(lambda a: a.reshape(more, size, *a.shape[1:]), out)
        return out, jax.tree.map(lambda _: True, out)

    return function
