"""Where a search ends that bounds hold: which parameters they hold, and on which side."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._fitting.free import FreeParameter
from jaxbeam._fitting.result import Problem, variance
from jaxbeam._types import Scalar

RANK = 1e-7  # of the largest singular value; frequencies and their derivatives are good to 1e-9
CLOSE = 0.1  # of a standard deviation: as close as that to a bound is at it
_THERE = 36.0  # in the variables of the search: e^-36 is the rounding of one
_FAR = 9.0  # times the room left, which the data ask for beyond a bound that holds them


def units(free: dict[str, FreeParameter], z: Array) -> tuple[Array, Array]:
    """The slope of each parameter by its variable, and the measure of its changes: see
    `FreeParameter.unit`."""
    pairs = [each.unit(z[i]) for i, each in enumerate(free.values())]
    slope, unit = (jnp.stack(column) for column in zip(*pairs, strict=True))
    return jnp.maximum(slope, jnp.finfo(z.dtype).tiny), unit


def rooms(free: dict[str, FreeParameter], z: Array) -> Array:
    """The distance (2, m) of each value from its lower and its upper bound."""
    values = [(each, each.value(z[i])) for i, each in enumerate(free.values())]
    pairs = [[value - each.lower, each.upper - value] for each, value in values]
    return jnp.stack([jnp.stack(pair) for pair in pairs], 1)


def settled(problem: Problem, z: Array) -> tuple[Array, Array, Array, Array]:
    """Parameters after those that the data press against a bound are put there, and the others
    where they fit best with that, by two steps of Gauss and Newton, unless that makes things worse.

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

    z = jnp.clip(z, low, high)  # beyond, slopes vanish and values stay
    nothing = jnp.zeros(z.size, int)
    start: Any = z, z, jnp.asarray(jnp.inf, z.dtype), nothing
    _, rows = jax.lax.scan(look, start, np.array([True, False, False]))
    z, residual, jacobian, side = (row[-1] for row in rows)
    return z, residual, jacobian, side


def _pressed(residual: Array, by_value: Array, room: Array) -> Array:
    """The side, -1 or 1, of the bound far beyond which the data ask for a value, all other
    parameters as they are; 0 for others."""
    stiffness = jnp.sum(by_value**2, 0)
    wanted = -(residual @ by_value) / jnp.where(stiffness > 0, stiffness, 1.0)
    side = jnp.where(wanted < 0, -1, 1)
    return jnp.where(jnp.abs(wanted) > _FAR * jnp.where(side < 0, room[0], room[1]), side, 0)


def _stepped(
    z: Array, residual: Array, by_unit: Array, rate: Array, side: Array, room: Array
) -> Array:
    """Parameters at their bounds where they are held there, and after a step of the others; z
    itself where nothing is held."""
    held = side != 0
    way = jnp.where(side < 0, -room[0], jnp.where(side > 0, room[1], 0.0))
    finite = jnp.all(jnp.isfinite(by_unit)) & jnp.all(jnp.isfinite(residual))
    rest = jnp.where(finite, jnp.where(held[None], 0.0, by_unit), 0.0)
    left = jnp.where(finite, residual + by_unit @ way, 0.0)
    step = rate * jnp.linalg.lstsq(rest, -left, RANK)[0]
    stepped = jnp.where(held, side * _THERE, z + jnp.clip(step, -1.0, 1.0))
    return jnp.where(jnp.any(held), stepped, z)


def decomposed(by_unit: Array, held: Array) -> tuple[Array, Array, Array]:
    """Singular vectors and values of a Jacobian in which parameters that are `held` are known: the
    data on one of these stand alone, and all else is conditional on it."""
    m = held.size
    few = max(m - len(by_unit), 0)  # rows of zeros, for directions that nothing was measured in
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
    """The reduction of the sum of squares that another step of Gauss and Newton promises."""
    return jnp.sum(jnp.where(certainty > 0, residual @ along[: residual.size], 0.0) ** 2)


def others_arrived(residual: Array, by_unit: Array, there: Array, scale: Scalar) -> Array:
    """Whether some parameters are at a bound, to which a search goes on in ever smaller steps, and
    all others where a step would not take them a tenth of a standard deviation farther."""
    along, certainty, _ = decomposed(by_unit, there)
    return jnp.any(there) & (gain(residual, along, certainty) <= (CLOSE * scale) ** 2)


def least_certain(certainty: Array, combinations: Array, held: Array) -> Scalar:
    """The certainty of the combination that is known least, among those that no bound holds."""
    own = jnp.sum(jnp.where(held[None], combinations**2, 0.0), 1) > 0.5
    return jnp.min(jnp.where(own, jnp.inf, certainty))
