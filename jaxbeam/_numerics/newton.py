"""Roots of functions of few unknowns, found by Newton's method and differentiated exactly."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxbeam._numerics.linalg import solve


def value_and_jacobian(
    function: Callable[[Float[Array, " n"]], Float[Array, " m"]], x: Float[Array, " n"]
) -> tuple[Float[Array, " m"], Float[Array, "m n"]]:
    """A function and its derivatives, from one evaluation."""
    slope, value = jax.jacfwd(lambda x: (function(x),) * 2, has_aux=True)(x)
    return value, slope


def find_root(
    residual: Callable[..., Float[Array, " n"]],
    start: Float[Array, " n"],
    acceptable: Callable[[Float[Array, " n"]], Bool[Array, ""]] = lambda _: jnp.asarray(True),
) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """x with residual(x) = 0, and the share of the load that was reached (1: all of it).

    Newton's method on residual(x, fraction), with the fraction raised from zero to one in adaptive
    steps where one step will not do. Unknowns should be of order one. `acceptable` bars roots that
    mean nothing. Differentiable to any order by the implicit function theorem.
    """

    def newton(x: Array, fraction: Array) -> tuple[Array, Array]:
        def body(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            x, _, k = state
            value, slope = value_and_jacobian(lambda x: residual(x, fraction), x)
            dx = _held(slope, value)
            return x - dx, jnp.max(jnp.abs(dx)) / (1 + jnp.max(jnp.abs(x))), k + 1

        def go_on(state: tuple[Array, Array, Array]) -> Array:
            return (state[1] > 1e-13) & (state[2] < 20)  # NaN ends it too

        x, change, _ = jax.lax.while_loop(go_on, body, (x, jnp.asarray(jnp.inf), jnp.asarray(0)))
        # At round-off the step stalls slightly above the tolerance: accept that.
        return x, (change < 1e-10) & acceptable(x)

    def continuation(_: object, start: Array) -> tuple[Array, Array]:
        def body(state: tuple[Array, Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
            x, done, step, k = state
            target = jnp.minimum(done + step, 1.0)
            new, ok = newton(x, target)
            return (
                jnp.where(ok, new, x),
                jnp.where(ok, target, done),
                jnp.where(ok, 2 * step, step / 4),
                k + 1,
            )

        def go_on(state: tuple[Array, Array, Array, Array]) -> Array:
            return (state[1] < 1) & (state[2] > 1e-9) & (state[3] < 100)

        one = jnp.ones((), start.dtype)
        x, done, _, _ = jax.lax.while_loop(go_on, body, (start, 0 * one, one, jnp.asarray(0)))
        return x, done

    return jax.lax.custom_root(
        residual,
        start,
        continuation,
        lambda g, y: _held(jax.jacfwd(g)(jnp.zeros_like(y)), y),
        has_aux=True,
    )


def _held(slope: Float[Array, "n n"], value: Float[Array, " n"]) -> Float[Array, " n"]:
    """x with slope x = value, zero where nothing holds and nothing pushes: a free hinge at rest."""
    free = jnp.all(slope == 0, 1)
    return solve(slope + jnp.diag(jnp.where(free, 1.0, 0.0)), value)
