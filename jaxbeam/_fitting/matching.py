"""Which computed mode is which measured one."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxbeam._checks import real_array, with_gaps


def match_modes(measured: Any, computed: Any) -> Array:
    """The computed frequency that each measured one belongs to: an index (int) for each of these.

    `measured` (k,) and `computed` (n,), k <= n, are in the same unit and any order. The assignment
    of k different modes with the least sum of squares of log(measured / computed), by dynamic
    programming: on a line the best assignment crosses nothing. NaN (or a masked one) among the
    measured takes no mode, and its index means nothing; NaN among the computed is a mode that is
    not there. No derivative.

    Raises `ValueError` for other shapes, and `TypeError` for what are no real numbers.
    """
    measured = real_array("measured", with_gaps(measured))
    computed = real_array("computed", computed)
    if measured.ndim != 1 or computed.ndim != 1 or not 0 < measured.size <= computed.size:
        raise ValueError(
            "measured and computed must be lists, not empty and the latter no shorter, got shapes "
            f"{measured.shape} and {computed.shape}"
        )
    measured, computed = jax.lax.stop_gradient((jnp.log(measured), jnp.log(computed)))
    rows, columns = jnp.argsort(measured), jnp.argsort(computed)  # sorted, NaN last
    given = jnp.isfinite(measured[rows])
    cost = (measured[rows][:, None] - computed[columns][None]) ** 2
    cost = jnp.where(jnp.isfinite(cost), cost, 1e30)
    n = computed.size
    never = jnp.asarray([jnp.inf], cost.dtype)
    # Least cost of the rows so far, with the first 0 .. n modes.
    least = jnp.zeros(n + 1, cost.dtype)
    ends = []
    for i in range(measured.size):
        end = least[:-1] + cost[i]  # this row takes mode j, the rows before it modes below j
        ends.append(end)
        best = jax.lax.cummin(jnp.concatenate([never, end]))
        least = jnp.where(given[i], best, least)
    found, below = [jnp.zeros((), int)] * measured.size, jnp.asarray(n)
    for i in reversed(range(measured.size)):
        at = jnp.argmin(jnp.where(jnp.arange(n) < below, ends[i], jnp.inf))
        found[i], below = at, jnp.where(given[i], at, below)
    matched = columns[jnp.stack(found)]
    return jnp.zeros(measured.size, int).at[rows].set(matched)
