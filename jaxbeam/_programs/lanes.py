"""The rule of lanes: what `kernel` works on has the axes of a batch behind all others.

Arithmetic of numbers alike is then that of whole arrays, in the vector units of a processor. Most
of NumPy works with it as it is: sums and products of arrays, indexing and stacking along first
axes. Here is the rest, with which functions for one case are functions for many: tables of
constants beside arrays with lanes, products that sum over an axis, and sums along the first axis.

To write `@` and `jnp.sum` in their place, and have a traced program rewritten, would have to know
of every product which of its axes are lanes once `jax.vmap` has put them in front; these functions
say so where it is known.
"""

import functools
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float


def contract(a: Any, x: Any, axis: int, lanes: int) -> Array:
    """Sum over an axis of a * x, which broadcast: the form of a product that a kernel bears. Where
    there are axes of lanes it is written out, so that they fill vector units."""
    if not lanes:
        return jnp.sum(a * x, axis)

    def part(array: Any, i: int) -> Any:
        return array[(slice(None),) * axis + (i if array.shape[axis] > 1 else 0,)]

    terms = [part(a, i) * part(x, i) for i in range(max(a.shape[axis], x.shape[axis]))]
    return functools.reduce(jnp.add, terms)


def beside(table: Any, axes: int) -> Any:
    """The table with axes of length one behind its own, to stand beside arrays with lanes."""
    return table.reshape(*table.shape, *(1,) * axes)


def total(x: Float[Array, "n *rest"]) -> Float[Array, "*rest"]:
    """Sum along the first axis, by halves."""
    if len(x) == 3:  # the same sum, in fewer operations
        return x[0] + x[1] + x[2]
    while len(x) > 1:
        half = len(x) // 2
        x = jnp.concatenate([x[:half] + x[half : 2 * half], x[2 * half :]])
    return x[0]
