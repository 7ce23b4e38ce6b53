"""Clocks that show zero at the beginning of a run, since floats round late times coarsely."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._results import without_derivatives
from jaxbeam._types import Scalar


class Clock(eqx.Module):
    """The time of functions that jump at known times, from the time since an `origin`.

    The sum of both is rounded, and may come to the other side of a jump. It is kept on the side
    that the time since the origin says, by a few units of rounding, since functions that compare
    it with times of jumps may round as well.
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
        exact, rounded = without_derivatives((since, t))
        i = place(jumps - self.origin, exact, "left")
        margin = 4 * jnp.finfo(t.dtype).eps * (jnp.abs(self.origin) + jnp.abs(jumps))
        last = (jumps + margin)[jnp.maximum(i - 1, 0)]
        coming = (jumps - margin)[jnp.minimum(i, jumps.size - 1)]
        kept = jnp.where(i > 0, jnp.maximum(rounded, last), rounded)
        kept = jnp.where(i < jumps.size, jnp.minimum(kept, coming), kept)
        return t + (kept - rounded)


def place(times: Array, t: Scalar, side: str) -> Array:
    """The number of increasing times before t; with `side` "right" those equal to t count too."""
    if times.size <= 64:  # comparing all compiles in less time
        before = times <= t if side == "right" else times < t
        return jnp.sum(before)
    return jnp.searchsorted(times, t, side=side)


class Later(eqx.Module):
    """A function of the time since an origin, from a function of time and a clock."""

    function: Callable[[Scalar], Any]
    clock: Clock

    def __call__(self, t: Scalar) -> Any:
        return self.function(self.clock.time(t))
