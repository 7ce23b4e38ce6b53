"""Clocks of runs, which show zero where these begin, since late times are rounded."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._results import without_derivatives
from jaxbeam._types import Scalar


class Clock(eqx.Module):
    """The time, for functions of time that jump at known times, `since` an origin.

    The sum of both is rounded, and may fall on the other side of a jump than it is by the clock
    that shows zero at the origin: it is held on its own side, a few units of rounding away, which
    functions may lose that compare times of their own.
    """

    origin: Scalar
    jumps: Float[Array, " k"]

    def __init__(self, origin: Scalar, jumps: Float[Array, " k"]) -> None:
        self.origin, self.jumps = without_derivatives((origin, jnp.sort(jumps)))

    def time(self, since: Scalar) -> Scalar:
        """The time `since` after the origin."""
        t, jumps = self.origin + since, self.jumps
        if not jumps.size:
            return t
        own, rough = without_derivatives((since, t))
        i = place(jumps - self.origin, own, "left")
        room = 4 * jnp.finfo(t.dtype).eps * (jnp.abs(self.origin) + jnp.abs(jumps))
        last = (jumps + room)[jnp.maximum(i - 1, 0)]
        coming = (jumps - room)[jnp.minimum(i, jumps.size - 1)]
        held = jnp.where(i > 0, jnp.maximum(rough, last), rough)
        held = jnp.where(i < jumps.size, jnp.minimum(held, coming), held)
        return t + (held - rough)


def place(times: Array, t: Scalar, side: str) -> Array:
    """The number of increasing times that are before t, those at t too if `side` is "right"."""
    if times.size <= 64:  # by comparing all, which compiles in less time
        before = times <= t if side == "right" else times < t
        return jnp.sum(before)
    return jnp.searchsorted(times, t, side=side)


class Later(eqx.Module):
    """A function of time with its clock shifted."""

    function: Callable[[Scalar], Any]
    clock: Clock

    def __call__(self, t: Scalar) -> Any:
        return self.function(self.clock.time(t))
