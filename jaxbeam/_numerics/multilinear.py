"""Functions of short vectors that are linear in each, such as products of quaternions, by tables.

Put together number by number they are a dozen operations, each compiled by itself; the product with
a table of constants is one, and so is its derivative.
"""

import functools
import itertools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array


def multilinear(*sizes: int) -> Callable[[Callable[..., Any]], Callable[..., Array]]:
    """A decorator for a function of vectors of these sizes, linear in each: a formula for single
    vectors of NumPy, which is asked for its values at unit vectors. What it makes takes arrays with
    axes in front, as many in each, which broadcast; what is not finite spreads to all results."""

    def decorate(formula: Callable[..., Any]) -> Callable[..., Array]:
        units = itertools.product(*map(np.eye, sizes))
        values = np.array([formula(*each) for each in units])
        table, shape = values.reshape(len(values), -1), values.shape[1:]

        @functools.wraps(formula)
        def function(*vectors: Array) -> Array:
            whole = vectors[0]
            for other in vectors[1:]:
                whole = whole[..., :, None] * other[..., None, :]
                whole = whole.reshape(*whole.shape[:-2], -1)
            # A product of matrices would be a call of a library, which takes longer than this sum.
            rows = table.astype(whole.dtype).reshape((1,) * (whole.ndim - 1) + table.shape)
            out = jnp.sum(whole[..., None] * rows, -2)
            return out.reshape(*whole.shape[:-1], *shape)

        return function

    return decorate
