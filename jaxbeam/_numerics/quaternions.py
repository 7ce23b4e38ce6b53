"""Rotations by quaternions (w, x), of any length but zero, and by turns.

A turn (3,) is the axis times the angle in rad. Arrays may have any axes in front.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._numerics.multilinear import multilinear

_SMALL = 1e-2  # squares of half angles below this have series that are exact to rounding
Quaternion = Float[Array, "*k 4"]
Turn = Float[Array, "*k 3"]


def leading(a: Any, like: Array) -> Any:
    """The array a with as many first axes of length one as make it of the rank of `like`."""
    return a.reshape((1,) * (like.ndim - a.ndim) + a.shape)


@multilinear(3)
def crossing(a: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The matrix of b -> a x b."""
    return np.cross(a, np.eye(3)).T


@multilinear(3, 3)
def cross(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The product a x b."""
    return np.cross(a, b)


def rotation(q: Quaternion) -> Float[Array, "*k 3 3"]:
    """The matrix of the rotation: 1 + 2 (w x~ + x~ x~) / |q|^2."""
    less = turned_by(q)
    return less + leading(np.eye(3), less)


def turned_by(q: Quaternion) -> Float[Array, "*k 3 3"]:
    """The matrix of the rotation less the unit matrix, exact to rounding for small turns."""
    w, x = q[..., :1, None], q[..., 1:]
    square = jnp.sum(x * x, -1)[..., None, None]
    rotated = w * crossing(x) + x[..., :, None] * x[..., None, :]
    rotated = rotated - square * leading(np.eye(3), rotated)
    return 2 * rotated / jnp.sum(q * q, -1)[..., None, None]


def conjugate(q: Quaternion) -> Quaternion:
    """The quaternion (w, -x): of one of length one that of the inverse rotation."""
    return jnp.concatenate([q[..., :1], -q[..., 1:]], -1)


@multilinear(4, 4)
def quaternion_product(
    p: Float[np.ndarray, "4"], q: Float[np.ndarray, "4"]
) -> Float[np.ndarray, "4"]:
    """The product p q: first the rotation q, then p."""
    w, x, v, y = p[0], p[1:], q[0], q[1:]
    return np.append(w * v - x @ y, w * y + v * x + np.cross(x, y))


def of_turn(vector: Turn) -> Quaternion:
    """The quaternion of length one of a turn: (cos, sin of half the angle along the axis)."""
    square = jnp.sum(vector * vector, -1, keepdims=True) / 4
    small = square < _SMALL
    half = jnp.sqrt(jnp.where(small, 1.0, square))
    # Series of sin(a) / a and of cos(a) in powers of a^2, with half the angle a.
    sine = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    cosine = 1 - square / 2 * (1 - square / 12 * (1 - square / 30 * (1 - square / 56)))
    share = jnp.where(small, sine, jnp.sin(half) / half)
    return jnp.concatenate([jnp.where(small, cosine, jnp.cos(half)), share * vector / 2], -1)


def turn_of(q: Quaternion) -> Turn:
    """The turn of a quaternion, of at most 2 pi: that of q by a is that of -q by 2 pi - a."""
    w, x = q[..., :1], q[..., 1:]
    square = jnp.sum(x * x, -1, keepdims=True)
    size = jnp.sum(q * q, -1, keepdims=True)
    small = (square < _SMALL * size) & (w > 0)
    sine = jnp.sqrt(jnp.where(small, 1.0, square))
    # The series of arctan(t) / t in powers of t^2, t = |x| / w.
    ratio = jnp.where(small, square / jnp.where(w > 0, w, 1.0) ** 2, 0.0)
    series = sum((-ratio) ** k / (2 * k + 1) for k in range(10)) / jnp.where(small, w, 1.0)
    return 2 * x * jnp.where(small, series, jnp.arctan2(sine, w) / sine)


def rotated(q: Quaternion, vector: Turn) -> Quaternion:
    """The quaternion, of length one, of the rotation q after the turn `vector` about axes of the
    body, which q has turned."""
    return normalised(quaternion_product(q, of_turn(vector)))


def normalised(q: Quaternion) -> Quaternion:
    """The quaternion q scaled to length one."""
    return q / jnp.sqrt(jnp.sum(q * q, -1, keepdims=True))
