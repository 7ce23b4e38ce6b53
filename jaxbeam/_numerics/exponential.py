"""The exponential of a matrix, without LAPACK."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def exponential(a: Float[Array, "n n"], squarings: int = 26) -> Float[Array, "n n"]:
    """exp(a), by Taylor's series of a / 2^k and k squarings; differentiable in both modes.

    Without LAPACK, and for norms up to 2^24 (`jax.scipy.linalg.expm` stops at 2^16 by default).
    The relative error is about eps times the norm, which rounding of `a` alone makes of it. A batch
    does all `squarings`: fewer are quicker, and give NaN for norms above 2^(squarings - 2).
    """
    n = a.shape[0]
    norm = jax.lax.stop_gradient(jnp.max(jnp.sum(jnp.abs(a), 0)))
    # With the norm at most 1/4, the terms left out after degree 12 are below 1e-17.
    k = jnp.maximum(jnp.ceil(jnp.log2(jnp.maximum(norm, 1e-300))) + 2, 0)
    a = jnp.where(k <= squarings, a * jnp.exp2(-k), jnp.nan)
    eye = jnp.eye(n, dtype=a.dtype)
    a2 = a @ a
    a3 = a2 @ a
    # e = exp(a) - 1 is squared, not exp(a), so that small e keep their digits: (1 + e)^2 - 1 =
    # 2 e + e^2.
    weights = 1.0 / np.cumprod(np.arange(1.0, 13.0))
    groups = [
        weights[3 * i] * a + weights[3 * i + 1] * a2 + weights[3 * i + 2] * a3 for i in range(4)
    ]
    e = groups[3]
    for group in groups[2::-1]:
        e = group + a3 @ e

    def square(e: Array, i: Array) -> tuple[Array, None]:
        return jax.lax.cond(i < k, lambda e: 2 * e + e @ e, lambda e: e, e), None

    e, _ = jax.lax.scan(square, e, jnp.arange(float(squarings), dtype=a.dtype))
    return e + eye
