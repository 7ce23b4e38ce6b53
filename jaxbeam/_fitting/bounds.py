"""Where a search ends that bounds hold: which parameters they hold, and on which side."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._fitting.free import FreeParameter
from jaxbeam._fitting.result import Problem, variance
from jaxbeam._types import Scalar

# Singular values below this share of the largest count as zero: derivatives of frequencies have an
# accuracy of 1e-9.
RANK = 1e-7
CLOSE = 0.1  # values nearer to a bound than this share of a standard deviation count as at it
_THERE = 36.0  # value of a variable of the search at a bound: e^-36 is the rounding of one
# Ratio of the change that data ask for to the distance from a bound, from which on the bound holds
# a value.
_FAR = 9.0


def units(free: dict[str, FreeParameter], z: Array) -> tuple[Array, Array]:
    """The slope of each parameter by its variable, and the measure of its changes: see
    `FreeParameter.unit`."""
    pairs = [each.unit(z[i]) for i, each in enumerate(free.values())]
    slope, unit = (jnp.stack(column) for column in zip(*pairs, strict=True))
    return jnp.maximum(slope, jnp.finfo(z.dtype).tiny), unit


def rooms(free: dict[str, FreeParameter], z: Array) -> Array:
    """The distances (2, m) of m values from their lower and upper bounds."""
    values = [(each, each.value(z[i])) for i, each in enumerate(free.values())]
    pairs = [[value - each.lower, each.upper - value] for each, value in values]
    return jnp.stack([jnp.stack(pair) for pair in pairs], 1)


def settled(problem: Problem, z: Array) -> tuple[Array, Array, Array, Array]:
    """Parameters after those that the data press against a bound are moved there, and others to
    where they then fit best, by two steps of Gauss and Newton, unless that makes the fit worse.

    Returns the variables of the search, residuals and their Jacobian there, and for each parameter
    -1 where its lower bound holds it, 1 where its upper one does, else 0. A search alone comes near
    a bound in ever smaller steps, and gives up somewhere.
    """
    free = problem.free
    bounded = np.array([each.bounded for each in free.values()]).T
    low, high = np.where(bounded, _THERE, np.inf) * np.array([[-1.0], [1.0]])

    def look(carry: Any, first: Any) -> tuple[Any, Any]:
        z, origin, least, side = carry
        residual, jacobian = problem.with_jacobian(z)
        slope, unit = units(free, z)
        by_value, square = jacobian / slope[None], jnp.sum(residual**2)
        fine = first | (square <= least * (1 + 1e-9))
        here = jnp.where(first, _pressed(residual, by_value, rooms(free, z)), side)
        here = jnp.where(fine, here, 0)
        ahead = _stepped(
            z, residual, by_value * unit[None], unit / slope, here, rooms(free, z) / unit[None]
        )
        following = jnp.where(fine, ahead, origin)
        return (following, origin, square, here), (z, residual, jacobian, side)

    z = jnp.clip(z, low, high)  # beyond these limits slopes vanish and values stay the same
    nothing = jnp.zeros(z.size, int)
    start: Any = z, z, jnp.asarray(jnp.inf, z.dtype), nothing
    _, rows = jax.lax.scan(look, start, np.array([True, False, False]))
    z, residual, jacobian, side = (row[-1] for row in rows)
    return z, residual, jacobian, side


def _pressed(residual: Array, by_value: Array, room: Array) -> Array:
    """The side, -1 or 1, of the bound that the data press each value against, all other parameters
    being fixed; 0 for others."""
    stiffness = jnp.sum(by_value**2, 0)
    wanted = -(residual @ by_value) / jnp.where(stiffness > 0, stiffness, 1.0)
    side = jnp.where(wanted < 0, -1, 1)
    return jnp.where(jnp.abs(wanted) > _FAR * jnp.where(side < 0, room[0], room[1]), side, 0)


def _stepped(
    z: Array, residual: Array, by_unit: Array, rate: Array, side: Array, room: Array
) -> Array:
    """Parameters with those that are held moved to their bounds, and the others after a step; z
    itself where none is held."""
    held = side != 0
    way = jnp.where(side < 0, -room[0], jnp.where(side > 0, room[1], 0.0))
    finite = jnp.all(jnp.isfinite(by_unit)) & jnp.all(jnp.isfinite(residual))
    rest = jnp.where(finite, jnp.where(held[None], 0.0, by_unit), 0.0)
    left = jnp.where(finite, residual + by_unit @ way, 0.0)
    step = rate * jnp.linalg.lstsq(rest, -left, RANK)[0]
    stepped = jnp.where(held, side * _THERE, z + jnp.clip(step, -1.0, 1.0))
    return jnp.where(jnp.any(held), stepped, z)


def decomposed(by_unit: Array, held: Array) -> tuple[Array, Array, Array]:
    """Singular vectors and values of a Jacobian in which parameters that are `held` count as known:
    each of these gets a singular vector of its own, and the others are conditional on them."""
    m = held.size
    few = max(m - len(by_unit), 0)  # zero rows for directions without measurements
    by_unit = jnp.pad(by_unit, ((0, few), (0, 0)))

    def certain(matrix: Array) -> tuple[Array, Array, Array]:
        along, certainty, combinations = jnp.linalg.svd(matrix, full_matrices=False)
        return along, jnp.where(certainty > RANK * certainty[0], certainty, 0.0), combinations

    spread = variance(*certain(by_unit)[1:])
    column = jnp.sqrt(jnp.sum(by_unit**2, 0))
    finite = jnp.isfinite(spread) & (spread > 0)
    own = jnp.where(finite, 1 / jnp.sqrt(jnp.where(finite, spread, 1.0)), column)
    rows = jnp.diag(jnp.where(held, own, 0.0))
    return certain(jnp.concatenate([jnp.where(held[None], 0.0, by_unit), rows]))


def gain(residual: Array, along: Array, certainty: Array) -> Scalar:
    """The reduction of the sum of squares that another step of Gauss and Newton would bring."""
    return jnp.sum(jnp.where(certainty > 0, residual @ along[: residual.size], 0.0) ** 2)


def others_arrived(residual: Array, by_unit: Array, there: Array, scale: Scalar) -> Array:
    """Whether some parameters are at a bound, which a search approaches in ever smaller steps, and
    all others within a tenth of a standard deviation of where a step would take them."""
    along, certainty, _ = decomposed(by_unit, there)
    return jnp.any(there) & (gain(residual, along, certainty) <= (CLOSE * scale) ** 2)


def least_certain(certainty: Array, combinations: Array, held: Array) -> Scalar:
    """The certainty of the combination of parameters that is known least, among those that no bound
    holds."""
    own = jnp.sum(jnp.where(held[None], combinations**2, 0.0), 1) > 0.5
    return jnp.min(jnp.where(own, jnp.inf, certainty))
