"""Modes that nothing holds, such as the swing of a blade on a free hinge at rest.

With K singular, or nearly, its inverse, by which eigenproblems find what is lowest best, has one
value that drowns all others in its rounding. K + s M is regular, and its modes are those of K but
for s: exactly where there are no Coriolis forces, to first order where there are.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float

_FAR = 1e4  # frequencies whose ratio costs that many units of rounding


def cholesky(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    return jax.lax.linalg.cholesky(a, symmetrize_input=False)


def lower_solve(a: Array, b: Array, transpose: bool = False) -> Array:
    """Returns x with a x = b, a lower triangular, or a^T x = b."""
    return jax.lax.linalg.triangular_solve(a, b, left_side=True, lower=True, transpose_a=transpose)


def symmetric_part(a: Any) -> Any:
    """(a + a^T) / 2, of arrays of JAX or NumPy."""
    return (a + a.T) / 2


def reduced(a: Array, b: Array) -> tuple[Array, Array]:
    """The factor F with b = F F^T, and F^-1 a F^-T."""
    f = cholesky(b)
    inner = lower_solve(f, lower_solve(f, a).T)
    return f, symmetric_part(inner)


def settled(
    found: Callable[[Array], tuple[Array, ...]], shift: Callable[[], Array], free: int
) -> Any:
    """The results of `found(0)`, of which the first are eigenvalues; and where the lowest are so
    far below those that bend the blade, behind as many as may be `free`, that these have lost
    digits, or are not numbers, as where K is singular, those of `found(shift())`. A loop, so that
    it is compiled once."""
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
    """The shift s of K + s M: small beside squares of frequencies of bending, large beside
    rounding."""
    _, inner = reduced(stiffness, mass)
    _, square = jax.lax.linalg.eigh(inner, symmetrize_input=False)
    largest = jnp.max(jnp.abs(square))
    floor = 1e3 * jnp.finfo(square.dtype).eps * jnp.where(largest > 0, largest, 1.0)
    return jnp.maximum(square[min(free, len(mass) - 1)] / _FAR**2, floor)


def unshifted(
    lam: Complex[Array, " n"],
    lost: Array,
    k: Float[Array, "n n"],
    x: Complex[Array, "n n"],
    free: int,
) -> Complex[Array, " n"]:
    """Eigenvalues of modes in columns x, of unit modal mass, from those with the shift and what of
    their omega^2 is the shift's: as they are without one, else zero where x^H K x, or omega^2,
    cannot be told from rounding."""
    eps, square = jnp.finfo(k.dtype).eps, lam.imag**2 - lost
    size = jnp.abs(x)
    bound = 8 * jnp.sum(size * (jnp.abs(k) @ size), 0) + 4 * jnp.abs(square[min(free, len(k) - 1)])
    square = jnp.where(jnp.abs(square) <= eps * bound, 0.0, square)
    root = jnp.sqrt(jnp.abs(square))
    new = jax.lax.complex(jnp.where(square < 0, root, 0.0), jnp.where(square < 0, 0.0, root))
    return jnp.where(lost == 0, lam, new)
