"""Where a function of one number changes its sign."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxbeam._types import Scalar, Vector

_MORE = 100  # looks to narrow what was found


def halved(
    before: Callable[[Array], Bool[Array, "*n"]], lower: Array, upper: Array, times: int
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Ends of intervals after bisections that keep the place at which `before`, true at the lower
    end, becomes false; of arrays entry by entry."""

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        lower, upper = ends
        middle = (lower + upper) / 2
        below = before(middle)
        return jnp.where(below, middle, lower), jnp.where(below, upper, middle)

    ends: tuple[Array, Array] = jax.lax.fori_loop(0, times, halve, (lower, upper))
    return ends


class Looks(NamedTuple):
    """The settings of a search: from the value `bottom` on, each `ratio` times the last, `many`
    looks up to the `top`; what was found is narrowed until values differ by less than `close`,
    relatively: by the Illinois rule (secants between the ends, with the function at an end that
    stays halved each time), or, where the function is a sign alone, by halving."""

    bottom: Scalar
    ratio: Scalar | float
    top: Scalar
    many: Array | int
    close: float = 1e-14
    signs: bool = False


class Bracket(NamedTuple):
    """Where a search is: the `value` to look at and the `last` one; `a` and `b` are the values at
    its ends with the function there; and what the looks have `kept`."""

    tries: Array
    value: Scalar
    last: Scalar
    a: Vector
    b: Vector
    positive: Array  # whether the function is so at `last`
    kept: Any

    @property
    def found(self) -> Array:
        """Whether the function was seen to be zero or below."""
        return self.b[1] <= 0

    def ended(self, looks: Looks) -> Array:
        """Whether the search ended for another reason than want of looks."""
        return self.tries < looks.many + _MORE


def first_change(
    look: Callable[[Bracket], tuple[Scalar, Any, Array]], looks: Looks, kept: Any,
    fine: Callable[[Any], Array],
) -> Bracket:  # fmt: skip
    """The search for the least value at which a function that begins above zero is so no more.

    `look` returns the function at the `value` of a bracket, what is to be kept, and whether this
    was one look too many, as nothing can be told there: then the search ends as it was before. It
    also ends where what it has kept is not `fine`.
    """
    zero, one = jnp.zeros_like(looks.bottom), jnp.ones_like(looks.bottom)

    def step(here: Bracket) -> Bracket:
        number, kept, in_vain = look(here)
        positive = number > 0
        stays = one if looks.signs else jnp.where(positive == here.positive, one / 2, one)
        weight, point = jnp.stack([one, stays]), jnp.stack([here.value, number])
        a = jnp.where(positive, point, here.a * weight)
        b = jnp.where(positive, here.b * weight, point)
        found = b[1] <= 0
        secant = a[0] + (b[0] - a[0]) * a[1] / (a[1] - b[1])
        value = jnp.where(found, secant, here.value * looks.ratio)
        # Until a change of sign is found the upper end is none.
        b = jnp.where(found, b, here.b)
        new = Bracket(here.tries + 1, value, here.value, a, b, positive, kept)
        end = here._replace(tries=here.tries + 1, last=here.value)
        return jax.tree.map(lambda old, new: jnp.where(in_vain, old, new), end, new)

    def goes_on(here: Bracket) -> Array:
        more = jnp.where(
            here.found,
            jnp.abs(here.value - here.last) > looks.close * here.value,
            here.value <= looks.top * (1 + 1e-9),
        )
        return more & fine(here.kept) & here.ended(looks)

    a, b = jnp.stack([zero, one]), jnp.stack([looks.top, one])
    begin = Bracket(jnp.asarray(0), looks.bottom, zero, a, b, jnp.asarray(True), kept)
    return jax.lax.while_loop(goes_on, step, begin)
