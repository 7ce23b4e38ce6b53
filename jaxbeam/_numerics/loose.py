"""Modes without stiffness, such as the swing of a blade on a free hinge at rest.

Eigenproblems are solved by K^-1, for the sake of the lowest modes. If K is (nearly) singular, K^-1
has one eigenvalue so large that its rounding spoils all others. K + s M is regular, and has the
same modes with omega^2 larger by s: exactly without Coriolis forces, else to first order in s.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float

_FAR = 1e4  # ratio of bending to lowest frequency from which on a shift is used


def cholesky(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    return jax.lax.linalg.cholesky(a, symmetrize_input=False)


def lower_solve(a: Array, b: Array, transpose: bool = False) -> Array:
    """Returns x with a x = b, a lower triangular, or a^T x = b."""
    return jax.lax.linalg.triangular_solve(a, b, left_side=True, lower=True, transpose_a=transpose)


def symmetric_part(a: Any) -> Any:
    """(a + a^T) / 2, of arrays of JAX or NumPy."""
    return (a + a.T) / 2


def reduced(a: Array, b: Array) -> tuple[Array, Array]:
    """The Cholesky factor F of b = F F^T, and the symmetric matrix F^-1 a F^-T."""
    factor = cholesky(b)
    inner = lower_solve(factor, lower_solve(factor, a).T)
    return factor, symmetric_part(inner)


def shifted_if_loose(
    found: Callable[[Array], tuple[Array, ...]], shift: Callable[[], Array], free: int
) -> Any:
    """The results of `found(0)`, or of `found(shift())` where those are inaccurate.

    `found` takes the shift s of K + s M, and returns eigenvalues first. Without a shift they are
    inaccurate, or NaN, where the lowest is far below the first that bends the blade, which comes
    after as many as may be `free`. A loop, so that `found` is compiled once.
    """
    like = jax.eval_shape(shift)
    start = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), jax.eval_shape(found, like))

    def again(state: tuple[Array, tuple[Array, ...]]) -> Bool[Array, ""]:
        tries, (lam, *_) = state
        frequency = jnp.sort(jnp.abs(lam))
        bending = frequency[min(free, len(lam) - 1)]
        loose = ~(frequency[0] * _FAR >= bending)
        return (tries == 0) | ((tries == 1) & loose)

    def body(state: tuple[Array, tuple[Array, ...]]) -> tuple[Array, tuple[Array, ...]]:
        more = jax.lax.cond(state[0] == 0, lambda: jnp.zeros(like.shape, like.dtype), shift)
        return state[0] + 1, found(more)

    return jax.lax.while_loop(again, body, (jnp.asarray(0), start))[1]


def shift(mass: Float[Array, "n n"], stiffness: Float[Array, "n n"], free: int) -> Array:
    """The shift s of K + s M, in rad^2/s^2: small beside squares of bending frequencies, which come
    after `free` others, large beside rounding of the largest one."""
    _, inner = reduced(stiffness, mass)
    _, square = jax.lax.linalg.eigh(inner, symmetrize_input=False)
    largest = jnp.max(jnp.abs(square))
    floor = 1e3 * jnp.finfo(square.dtype).eps * jnp.where(largest > 0, largest, 1.0)
    return jnp.maximum(square[min(free, len(mass) - 1)] / _FAR**2, floor)


def without_shift(
    lam: Complex[Array, " n"],
    lost: Array,
    k: Float[Array, "n n"],
    x: Complex[Array, "n n"],
    free: int,
) -> Complex[Array, " n"]:
    """Eigenvalues without shift of modes in columns x, of unit modal mass, from `lam` with it and
    `lost`, its part of omega^2. Where there is a shift, omega^2 is zero if it is within rounding of
    x^H K x."""
    eps, square = jnp.finfo(k.dtype).eps, lam.imag**2 - lost
    size = jnp.abs(x)
    bound = 8 * jnp.sum(size * (jnp.abs(k) @ size), 0) + 4 * jnp.abs(square[min(free, len(k) - 1)])
    square = jnp.where(jnp.abs(square) <= eps * bound, 0.0, square)
    root = jnp.sqrt(jnp.abs(square))
    new = jax.lax.complex(jnp.where(square < 0, root, 0.0), jnp.where(square < 0, 0.0, root))
    return jnp.where(lost == 0, lam, new)
