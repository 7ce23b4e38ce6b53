"""Where a function of one number changes its sign, and how that place goes with parameters."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
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
    a, b = jnp.stack([zero, one]), jnp.stack([looks.top, one])
    begin = Bracket(jnp.asarray(0), looks.bottom, zero, a, b, jnp.asarray(True), kept)
    return _searched(look, looks, fine, begin)


def change_between(
    function: Callable[[Scalar], Scalar], ends: tuple[Scalar, Scalar],
    values: tuple[Scalar, Scalar], close: float = 1e-14,
) -> Scalar:  # fmt: skip
    """The place between two `ends`, at which a function has these `values`, where its sign changes,
    by secants until two are `close`, relatively; without meaning where it has the same sign at
    both."""
    side = jnp.where(values[0] < values[1], -1.0, 1.0)
    least = jnp.finfo(side.dtype).tiny ** 0.5  # above zero, where the first end is the place
    a = jnp.stack([ends[0], jnp.maximum(side * values[0], least)])
    b = jnp.stack([ends[1], side * values[1]])
    none = jnp.asarray(0)
    begin = Bracket(none, (ends[0] + ends[1]) / 2, ends[0], a, b, jnp.asarray(True), none)

    def look(here: Bracket) -> tuple[Scalar, Array, Array]:
        return side * function(here.value), none, jnp.asarray(False)

    # The top is below all, so that nothing is looked at beyond the ends.
    looks = Looks(ends[0], 1.0, jnp.full_like(side, -jnp.inf), 0, close)
    return _searched(look, looks, lambda _: jnp.asarray(True), begin).value


def _searched(
    look: Callable[[Bracket], tuple[Scalar, Any, Array]], looks: Looks,
    fine: Callable[[Any], Array], begin: Bracket,
) -> Bracket:  # fmt: skip
    """The end of a search from where it begins: see `first_change`."""
    one = jnp.ones_like(begin.value)

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
            jnp.abs(here.value - here.last) > looks.close * jnp.abs(here.value),
            here.value <= looks.top * (1 + 1e-9),
        )
        return more & fine(here.kept) & here.ended(looks)

    return jax.lax.while_loop(goes_on, step, begin)


@eqx.filter_custom_jvp
def root(function: Callable[[Any, Scalar], Scalar], given: Any, value: Scalar) -> Scalar:
    """The `value`, with its derivatives, of any order, as the root of function(given, value) by all
    that is `given`: only where they are asked for is the function looked at."""
    return value


@root.def_jvp
def _root_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Scalar, Scalar]:
    function, given, value = primals
    # Through the function itself: then this rule can be differentiated again.
    value = root(*primals)
    numbers, others = eqx.partition(given, eqx.is_inexact_array)
    _, change = jax.linearize(
        lambda numbers, value: function(eqx.combine(numbers, others), value), numbers, value
    )
    still = jax.tree.map(jnp.zeros_like, numbers)
    rates = jax.tree.map(
        lambda t, z: z if t is None else t, tangents[1], still, is_leaf=lambda t: t is None
    )
    slope = change(still, jnp.ones_like(value))
    return value, -change(rates, jnp.zeros_like(value)) / slope
