"""Spans of time about what is declared, which no step enters."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxbeam._results import without_derivatives
from jaxbeam._rotor.motion import Times
from jaxbeam._types import Scalar


class Pauses(eqx.Module):
    """Steps end where a pause opens and resume where it closes, a few units of rounding later.

    A pause reaches from `margin` before a declared time to `margin` after it; declared times that
    are too close for a step between them share one. No derivatives are taken by what is in here.
    """

    opens: Times
    closes: Times
    jumps: Bool[Array, " k"]  # whether something jumps within
    margin: Scalar  # s

    def __init__(self, changes: Times, jumps: Float[Array, " j"], margin: Scalar) -> None:
        changes, jumps, self.margin = without_derivatives((changes, jumps, margin))
        times = jnp.sort(jnp.concatenate([changes, jumps]))
        if not times.size:
            self.opens, self.closes, self.jumps = times, times, times > 0
            return
        # Of each time the first and the last of those that it shares its pause with; infinite ones
        # are not apart, and never come.
        apart, end = jnp.diff(times) > 4 * self.margin, jnp.ones(1, bool)
        first = jnp.where(jnp.concatenate([end, apart]), times, -jnp.inf)
        last = jnp.where(jnp.concatenate([apart, end]), times, jnp.inf)
        # By halves: of a few times XLA's own `cummax` takes a quarter of a second to compile.
        opens = jax.lax.associative_scan(jnp.maximum, first)
        closes = jax.lax.associative_scan(jnp.minimum, last, reverse=True)
        self.opens, self.closes = opens - self.margin, closes + self.margin
        own = jumps[None]
        self.jumps = jnp.any((self.opens[:, None] < own) & (own < self.closes[:, None]), 1)

    def ahead(self, t: Scalar) -> Scalar:
        """Where the next pause opens after t."""
        return jnp.min(jnp.where(self.opens > t, self.opens, jnp.inf), initial=jnp.inf)

    def passed(self, t: Scalar) -> Scalar:
        """t, or where the pause closes in which a step ended at t, rounded as it may be."""
        within = (self.opens - self.margin / 2 <= t) & (t < self.closes)
        return jnp.max(jnp.where(within, self.closes, t), initial=t)
