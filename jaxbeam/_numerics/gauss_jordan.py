"""Inverses of small matrices by the method of Gauss and Jordan, without libraries."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Inexact

from jaxbeam._programs.platforms import loops_are_dear

_FEW = 16  # rows up to which the elimination may be written out without a loop


def gauss_jordan(a: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]:
    """The inverse of a matrix, with row pivoting."""
    return _written_out(a) if loops_are_dear() and len(a) <= _FEW else _by_loop(a)


def _by_loop(a: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]:
    """The inverse by a loop over columns, in place."""
    n = a.shape[0]
    places = jnp.arange(n)

    def body(k: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        a, order = state
        p = jnp.argmax(jnp.where(places >= k, jnp.abs(a[:, k]), -1.0))
        row, pivot, chosen = a[p], a[p, k], order[p]
        a, order = a.at[p].set(a[k]), order.at[p].set(order[k]).at[k].set(chosen)
        is_pivot = places == k
        column = jnp.where(is_pivot, 0.0, a[:, k])
        row = jnp.where(is_pivot, 1.0, row) / pivot
        a = jnp.where(is_pivot[None], 0.0, a) - column[:, None] * row[None]
        return jnp.where(is_pivot[:, None], row[None], a), order

    a, order = jax.lax.fori_loop(0, n, body, (a, places))
    return a[:, jnp.argsort(order)]


def _written_out(a: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]:
    """The inverse without a loop. Rows are not swapped but chosen by masks, which make fewer GPU
    kernels than reading and writing at computed places."""
    places = np.arange(a.shape[0])
    left = jnp.ones(a.shape[0], bool)  # rows that have not been pivots
    chosen = []
    for k in places:
        p = jnp.argmax(jnp.where(left, jnp.abs(a[:, k]), -1.0))
        pivot_row, pivot_column = places == p, places == k
        row = jnp.sum(jnp.where(pivot_row[:, None], a, 0.0), 0)
        column = jnp.where(pivot_row, 0.0, a[:, k])
        row = jnp.where(pivot_column, 1.0, row) / row[k]
        a = jnp.where(pivot_column[None], 0.0, a) - column[:, None] * row[None]
        a = jnp.where(pivot_row[:, None], row[None], a)
        left = left & ~pivot_row
        chosen.append(pivot_row)
    # Row k of the inverse is in the row that was the k-th pivot, and its column p in the column
    # whose pivot was row p: both are put in order.
    which = jnp.stack(chosen)
    a = jnp.sum(jnp.where(which[:, :, None], a[None], 0.0), 1)
    return jnp.sum(jnp.where(which[None], a[:, :, None], 0.0), 1)
