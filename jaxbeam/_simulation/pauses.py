"""Declared times, at which steps end and go on, and what is asked on either side of them."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxbeam._results import replaced, without_derivatives
from jaxbeam._rotor.clock import place
from jaxbeam._rotor.motion import Times
from jaxbeam._types import Scalar

_FEW = 2  # declared times that are no table: where a motion begins and ends, smoothly
_CLOSE = 1e-11  # times, relative to the run, that are one: less than controllers make a step of


class Pauses(eqx.Module):
    """Declared times at which steps end, and from which they go on: no time is lost.

    Declared times that are closer than a step can be are one, and steps end at the first of them.
    What jumps is asked for on either side, a few units of rounding before the first and after the
    last; so is what has corners, as three declared times and more are taken for. No derivatives
    are taken by what is in here.
    """

    # Of each declared time the first and the last of those that are one with it, in order.
    first: Times
    last: Times
    jumps: Bool[Array, " k"]  # whether something jumps there
    end: Scalar  # of the run, s
    near: Scalar  # s: times that are no further apart are one
    sided: bool = eqx.field(static=True)  # whether they are asked for on either side

    def __init__(
        self, changes: Times, jumps: Float[Array, " j"], times: Array | None = None
    ) -> None:
        """Pauses of a run over `times`, if there is to be one."""
        changes, jumps, times = without_derivatives((changes, jumps, times))
        every = jnp.concatenate([changes, jumps])
        self.sided = bool(jumps.size) or every.size > _FEW
        zero = jnp.zeros((), every.dtype)
        start, self.end, self.near = zero - jnp.inf, zero + jnp.inf, zero
        if times is not None:
            start, self.end = times[0], times[-1]
            # The loop makes no step that is shorter, and functions of time know no jump better.
            unit = float(jnp.finfo(zero.dtype).eps)
            told = 32 * unit * jnp.maximum(jnp.abs(start), jnp.abs(self.end))
            self.near = jnp.maximum(max(_CLOSE, 128 * unit) * (self.end - start), told)
        every = jnp.sort(jnp.where(jnp.isfinite(every), every, jnp.inf))
        if not every.size:
            self.first, self.last, self.jumps = every, every, every > 0
            return

        def one(first: Scalar, t: Scalar) -> tuple[Scalar, Scalar]:
            first = jnp.where(t > first + self.near, t, first)
            return first, jnp.minimum(first, t)  # which is t before the run

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
        """The next declared time after t, unless the run ends with it."""
        i = place(self.first, t, "right")
        stop = self.first[jnp.minimum(i, self.first.size - 1)]
        there = (i < self.first.size) & (stop < self.end - self.near)
        return jnp.where(there, stop, jnp.inf)

    def at(self, t: Scalar) -> Array:
        """Whether a step that ends at t ends at a declared time."""
        return self.first[self._of(t)] == t

    def jumped(self, t: Scalar) -> Array:
        """Whether something jumps where a step ends or begins at t."""
        i = self._of(t)
        return self.jumps[i] & (self.first[i] == t)

    def apart(self, t: Scalar) -> Scalar:
        """The distance of the declared times between which a step from t lies, or of those beside
        them, whichever is most: a pulse is short, and what follows it is not. So is that of what
        lies before the first of them in a run, which begins at zero by its own clock, and after the
        last. Infinite where they are too few for a table."""
        most = self.first.size - 1
        if most < _FEW:
            return jnp.full_like(t, jnp.inf)
        i, zero = place(self.first, t, "right"), jnp.zeros_like(t)

        def at(k: Array) -> Scalar:
            there = jnp.where(k > most, self.end, self.first[jnp.clip(k, 0, most)])
            return jnp.where(k < 0, zero, there)

        return jnp.max(jnp.stack([at(k) - at(k - 1) for k in (i - 1, i, i + 1)]))

    def before(self, t: Scalar) -> Scalar:
        """The latest time to ask for in a step that ends at t, infinite where none is declared."""
        return jnp.where(self.at(t), self.early(t), jnp.inf)

    @property
    def latest(self) -> Scalar:
        """The latest time to ask for in a run: what begins where it ends is no part of it."""
        first = jnp.where(self.first >= self.end - self.near, self.first, jnp.inf)
        first = jnp.min(first, initial=jnp.inf)
        early = self.early(first)
        return jnp.where(early <= self.end, early, jnp.inf)

    def after(self, t: Scalar) -> Scalar:
        """The earliest time to ask for in a step that begins at t, which is t where none is
        declared."""
        i = self._of(t)
        late = self.last[i] + self._room(self.last[i])
        return jnp.where(self.first[i] <= t, jnp.maximum(t, late), t)

    def early(self, t: Array) -> Array:
        """A few units of rounding before t, which may be infinite."""
        there = t < jnp.inf
        return jnp.where(there, t - self._room(jnp.where(there, t, 0.0)), t)

    def _of(self, t: Scalar) -> Array:
        """The index of the last declared time up to t, or of the first one before all of them."""
        return jnp.maximum(place(self.first, t, "right") - 1, 0)

    def _room(self, t: Array) -> Array:
        return jnp.finfo(t.dtype).eps * (4 * jnp.abs(t) + self.near)


def _places(times: Array, of: Array, side: str) -> Array:
    return jax.vmap(lambda t: place(times, t, side))(of)
