"""Declared times, at which steps end and go on, and what is asked on either side of them."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxbeam._results import replaced, without_derivatives
from jaxbeam._rotor.clock import place
from jaxbeam._rotor.motion import Times
from jaxbeam._types import Scalar

# Number of declared times up to which they mark the beginning and end of a smooth motion, not the
# corners of a table.
_FEW = 2
# Distance of declared times, over the duration of the run, below which they count as one.
_CLOSE = 1e-11


class Pauses(eqx.Module):
    """Declared times at which steps end and begin.

    Declared times closer than the shortest step count as one, and steps end at the first of them.
    At a jump, and at corners (which three declared times and more count as), motion and loads are
    evaluated on the side of the step: a few units of rounding before the first or after the last of
    these times. Nothing here has derivatives.
    """

    # For each declared time the first and the last of those that count as one with it, in order.
    first: Times
    last: Times
    jumps: Bool[Array, " k"]  # whether a motion or load jumps there
    end: Scalar  # end of the run, s
    near: Scalar  # s, distance up to which times count as one
    sided: bool = eqx.field(static=True)  # whether motion and loads are evaluated on both sides

    def __init__(
        self, changes: Times, jumps: Float[Array, " j"], times: Array | None = None
    ) -> None:
        """Pauses of a run over `times`, at the declared times of changes and jumps."""
        changes, jumps, times = without_derivatives((changes, jumps, times))
        every = jnp.concatenate([changes, jumps])
        self.sided = bool(jumps.size) or every.size > _FEW
        zero = jnp.zeros((), every.dtype)
        start, self.end, self.near = zero - jnp.inf, zero + jnp.inf, zero
        if times is not None:
            start, self.end = times[0], times[-1]
            # Steps are not shorter than this, nor are times of jumps more accurate.
            unit = float(jnp.finfo(zero.dtype).eps)
            told = 32 * unit * jnp.maximum(jnp.abs(start), jnp.abs(self.end))
            self.near = jnp.maximum(max(_CLOSE, 128 * unit) * (self.end - start), told)
        every = jnp.sort(jnp.where(jnp.isfinite(every), every, jnp.inf))
        if not every.size:
            self.first, self.last, self.jumps = every, every, every > 0
            return

        def one(first: Scalar, t: Scalar) -> tuple[Scalar, Scalar]:
            first = jnp.where(t > first + self.near, t, first)
            return first, jnp.minimum(first, t)  # times before the run stay as they are

        # One after the other, so that no pause is longer than `near`, however many times there are.
        _, self.first = jax.lax.scan(one, start, every, unroll=every.size <= 8)
        self.last = every[_places(self.first, self.first, "right") - 1]
        jumps = jnp.sort(jumps)
        self.jumps = _places(jumps, self.last, "right") > _places(jumps, self.first, "left")

    def since(self, origin: Scalar) -> "Pauses":
        """Pauses by a clock that shows zero at time `origin`."""
        first, last, end = (times - origin for times in (self.first, self.last, self.end))
        return replaced(self, first=first, last=last, end=end)

    def ahead(self, t: Scalar) -> Scalar:
        """The next declared time after t; infinite if the run ends before or at it."""
        i = place(self.first, t, "right")
        stop = self.first[jnp.minimum(i, self.first.size - 1)]
        there = (i < self.first.size) & (stop < self.end - self.near)
        return jnp.where(there, stop, jnp.inf)

    def at(self, t: Scalar) -> Array:
        """Whether a step that ends at t ends at a declared time."""
        return self.first[self._of(t)] == t

    def jumped(self, t: Scalar) -> Array:
        """Whether a motion or load jumps at the time t at which a step ends or begins."""
        i = self._of(t)
        return self.jumps[i] & (self.first[i] == t)

    def apart(self, t: Scalar) -> Scalar:
        """The longest of the distances between the declared times about t and of those next to
        these: a pulse is short, but not what follows it. The beginning of the run, at zero, and its
        end count as declared times here. Infinite for fewer times than a table has."""
        most = self.first.size - 1
        if most < _FEW:
            return jnp.full_like(t, jnp.inf)
        i, zero = place(self.first, t, "right"), jnp.zeros_like(t)

        def at(k: Array) -> Scalar:
            there = jnp.where(k > most, self.end, self.first[jnp.clip(k, 0, most)])
            return jnp.where(k < 0, zero, there)

        return jnp.max(jnp.stack([at(k) - at(k - 1) for k in (i - 1, i, i + 1)]))

    def before(self, t: Scalar) -> Scalar:
        """The latest time to evaluate in a step that ends at t: a moment before a declared time,
        else infinite."""
        return jnp.where(self.at(t), self.early(t), jnp.inf)

    @property
    def latest(self) -> Scalar:
        """The latest time to evaluate in a run: a jump at its end is no part of it."""
        first = jnp.where(self.first >= self.end - self.near, self.first, jnp.inf)
        first = jnp.min(first, initial=jnp.inf)
        early = self.early(first)
        return jnp.where(early <= self.end, early, jnp.inf)

    def after(self, t: Scalar) -> Scalar:
        """The earliest time to evaluate in a step that begins at t: a moment after a declared time,
        else t."""
        i = self._of(t)
        late = self.last[i] + self._room(self.last[i])
        return jnp.where(self.first[i] <= t, jnp.maximum(t, late), t)

    def early(self, t: Array) -> Array:
        """A time a few units of rounding before t, which may be infinite."""
        there = t < jnp.inf
        return jnp.where(there, t - self._room(jnp.where(there, t, 0.0)), t)

    def _of(self, t: Scalar) -> Array:
        """The index of the last declared time up to t, or zero before all of them."""
        return jnp.maximum(place(self.first, t, "right") - 1, 0)

    def _room(self, t: Array) -> Array:
        return jnp.finfo(t.dtype).eps * (4 * jnp.abs(t) + self.near)


def _places(times: Array, of: Array, side: str) -> Array:
    return jax.vmap(lambda t: place(times, t, side))(of)
