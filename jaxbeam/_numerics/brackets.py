"""Searches for the number at which a function of one number changes its sign."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxbeam._types import Scalar, Vector

_MORE = 100  # evaluations to narrow a change of sign that was found


def halved(
    before: Callable[[Array], Bool[Array, "*n"]], lower: Array, upper: Array, times: int
) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    """Both ends of an interval after bisections, `times` of them, for the place at which `before`,
    true at the lower end, becomes false; of arrays entry by entry."""

    def halve(_: Any, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        lower, upper = ends
        middle = (lower + upper) / 2
        below = before(middle)
        return jnp.where(below, middle, lower), jnp.where(below, upper, middle)

    ends: tuple[Array, Array] = jax.lax.fori_loop(0, times, halve, (lower, upper))
    return ends


class Looks(NamedTuple):
    """The settings of a search.

    The function is evaluated at `bottom`, then at values each `ratio` times the last, up to `top`
    and at most `many` times. A change of sign is narrowed until values differ by less than `close`,
    relatively: by the Illinois rule (secants between the ends, with the function at an end that
    stays halved each time), or by bisection if the function is `signs`, -1 or 1, alone.
    """

    bottom: Scalar
    ratio: Scalar | float
    top: Scalar
    many: Array | int
    close: float = 1e-14
    signs: bool = False


class Bracket(NamedTuple):
    """The state of a search: the `value` at which the function is evaluated next, and the `last`
    one; the ends `a` and `b` of the bracket, each a pair of a value and the function there; and
    what evaluations have `kept`."""

    tries: Array
    value: Scalar
    last: Scalar
    a: Vector
    b: Vector
    positive: Array  # whether the function is positive at `last`
    kept: Any

    @property
    def found(self) -> Array:
        """Whether the function was seen to be zero or below."""
        return self.b[1] <= 0

    def ended(self, looks: Looks) -> Array:
        """Whether evaluations are left: if so, a search that is over ended for another reason."""
        return self.tries < looks.many + _MORE


def first_change(
    look: Callable[[Bracket], tuple[Scalar, Any, Array]], looks: Looks, kept: Any,
    fine: Callable[[Any], Array],
) -> Bracket:  # fmt: skip
    """The search for the least value at which a function, positive at first, is zero or negative.

    `look` returns the function at the `value` of a bracket, what is to be kept, and whether the
    function cannot be evaluated there: then the search ends in the state before. It also ends where
    what it has kept is not `fine`.
    """
    zero, one = jnp.zeros_like(looks.bottom), jnp.ones_like(looks.bottom)
    a, b = jnp.stack([zero, one]), jnp.stack([looks.top, one])
    begin = Bracket(jnp.asarray(0), looks.bottom, zero, a, b, jnp.asarray(True), kept)
    return _searched(look, looks, fine, begin)


def change_between(
    function: Callable[[Scalar], Scalar], ends: tuple[Scalar, Scalar], values: tuple[Scalar, Scalar]
) -> Scalar:
    """The place between two `ends`, at which a function has these `values`, where its sign changes,
    to rounding; without meaning where it has the same sign at both."""
    side = jnp.where(values[0] < values[1], -1.0, 1.0)
    least = jnp.finfo(side.dtype).tiny ** 0.5  # above zero, where the first end is the place
    a = jnp.stack([ends[0], jnp.maximum(side * values[0], least)])
    b = jnp.stack([ends[1], side * values[1]])
    none = jnp.asarray(0)
    begin = Bracket(none, (ends[0] + ends[1]) / 2, ends[0], a, b, jnp.asarray(True), none)

    def look(here: Bracket) -> tuple[Scalar, Array, Array]:
        return side * function(here.value), none, jnp.asarray(False)

    # The top is below all, so that nothing is looked at beyond the ends.
    looks = Looks(ends[0], 1.0, jnp.full_like(side, -jnp.inf), 0)
    return _searched(look, looks, lambda _: jnp.asarray(True), begin).value


def _searched(
    look: Callable[[Bracket], tuple[Scalar, Any, Array]], looks: Looks,
    fine: Callable[[Any], Array], begin: Bracket,
) -> Bracket:  # fmt: skip
    """The end of a search from where it begins: see `first_change`."""
    one = jnp.ones_like(begin.value)
    close = max(looks.close, 4 * float(jnp.finfo(one.dtype).eps))

    def step(bracket: Bracket) -> Bracket:
        number, kept, fails = look(bracket)
        positive = number > 0
        stays = one if looks.signs else jnp.where(positive == bracket.positive, one / 2, one)
        weight, point = jnp.stack([one, stays]), jnp.stack([bracket.value, number])
        a = jnp.where(positive, point, bracket.a * weight)
        b = jnp.where(positive, bracket.b * weight, point)
        found = b[1] <= 0
        secant = a[0] + (b[0] - a[0]) * a[1] / (a[1] - b[1])
        value = jnp.where(found, secant, bracket.value * looks.ratio)
        # Until a change of sign is found there is no upper end.
        b = jnp.where(found, b, bracket.b)
        new = Bracket(bracket.tries + 1, value, bracket.value, a, b, positive, kept)
        end = bracket._replace(tries=bracket.tries + 1, last=bracket.value)
        return jax.tree.map(lambda old, new: jnp.where(fails, old, new), end, new)

    def goes_on(bracket: Bracket) -> Array:
        more = jnp.where(
            bracket.found,
            jnp.abs(bracket.value - bracket.last) > close * jnp.abs(bracket.value),
            bracket.value <= looks.top * (1 + 1e-9),
        )
        return more & fine(bracket.kept) & bracket.ended(looks)

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
