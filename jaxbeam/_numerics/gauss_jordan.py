"""Inverses of small matrices by the method of Gauss and Jordan, without libraries."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Inexact

from jaxbeam._programs.platforms import loops_are_dear

_FEW = 16  # rows up to which it may be written out


def gauss_jordan(a: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]:
    """Inverse, with row pivoting."""
    return _written_out(a) if loops_are_dear() and len(a) <= _FEW else _in_turn(a)


def _in_turn(a: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]:
    """The inverse, made in place."""
    n = a.shape[0]
    places = jnp.arange(n)

    def body(k: Array, state: tuple[Array, Array]) -> tuple[Array, Array]:
        a, order = state
        p = jnp.argmax(jnp.where(places >= k, jnp.abs(a[:, k]), -1.0))
        row, pivot, chosen = a[p], a[p, k], order[p]
        a, order = a.at[p].set(a[k]), order.at[p].set(order[k]).at[k].set(chosen)
        here = places == k
        column = jnp.where(here, 0.0, a[:, k])
        row = jnp.where(here, 1.0, row) / pivot
        a = jnp.where(here[None], 0.0, a) - column[:, None] * row[None]
        return jnp.where(here[:, None], row[None], a), order

    a, order = jax.lax.fori_loop(0, n, body, (a, places))
    return a[:, jnp.argsort(order)]


def _written_out(a: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]:
    """The inverse without a loop. Rows stay where they are, and are chosen by masks, which make
    fewer kernels than reading and writing at places that are computed."""
    places = np.arange(a.shape[0])
    left = jnp.ones(a.shape[0], bool)  # rows that have not had their turn
    chosen = []
    for k in places:
        p = jnp.argmax(jnp.where(left, jnp.abs(a[:, k]), -1.0))
        mine, here = places == p, places == k
        row = jnp.sum(jnp.where(mine[:, None], a, 0.0), 0)
        column = jnp.where(mine, 0.0, a[:, k])
        row = jnp.where(here, 1.0, row) / row[k]
        a = jnp.where(here[None], 0.0, a) - column[:, None] * row[None]
        a = jnp.where(mine[:, None], row[None], a)
        left = left & ~mine
        chosen.append(mine)
    # What belongs to the unknown k stands in the row chosen in its turn, and what belongs to the
    # equation p in the column of the turn in which that was chosen.
    which = jnp.stack(chosen)
    a = jnp.sum(jnp.where(which[:, :, None], a[None], 0.0), 1)
    return jnp.sum(jnp.where(which[None], a[:, :, None], 0.0), 1)
