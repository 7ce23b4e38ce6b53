"""Roots of functions of few unknowns, found by Newton's method and differentiated exactly."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._numerics.linalg import positive_definite, solve

_FAR = 0.5  # change of an unknown beyond which a minimum counts as far from the start
_SHORT, _NEAR = 1 / 16, 0.2  # first short step of the load, and largest change of unknowns in one


def value_and_jacobian(
    function: Callable[[Float[Array, " n"]], Float[Array, " m"]], x: Float[Array, " n"]
) -> tuple[Float[Array, " m"], Float[Array, "m n"]]:
    """The value of a function and its Jacobian by forward mode, from one evaluation."""
    slope, value = jax.jacfwd(lambda x: (function(x),) * 2, has_aux=True)(x)
    return value, slope


def find_root(
    residual: Callable[..., Float[Array, " n"]],
    start: Float[Array, " n"],
    acceptable: Callable[[Float[Array, " n"]], Bool[Array, ""]] = lambda _: jnp.asarray(True),
    support: Float[Array, "n n"] | None = None,
    jacobian: Callable[..., BlockTridiagonal] | None = None,
) -> tuple[Float[Array, " n"], Float[Array, ""]]:
    """The root x of residual(x) = 0, and the fraction of the load that was reached (1: all of it).

    Newton's method on residual(x, fraction), with the fraction of the load raised from zero to one
    in adaptive steps where one step does not converge. Unknowns should be of order one.
    `acceptable` excludes roots without physical meaning. Differentiable to any order by the
    implicit function theorem. A residual whose derivatives are block-tridiagonal may come with its
    `jacobian`(x, fraction): without that forward mode takes one pass for each unknown.

    With a `support`, a matrix, the residual is the gradient of an energy. Newton's method may jump
    to another root, so a second search follows where it finds none, none that is a minimum of the
    energy, or one far from the start. The second search follows a minimum in short steps, with
    (1 - fraction) `support` x added to the residual: without that, motions that only the load gives
    stiffness would be large under any fraction of it. If it ends in a minimum, that is the answer.
    """
    search = _RootSearch(residual, acceptable, support, jacobian)
    like = None if jacobian is None else jax.eval_shape(jacobian, start, jnp.ones((), start.dtype))

    def solved(linear: Callable[[Array], Array], y: Array) -> Array:
        by_all = jax.jacfwd(linear)(jnp.zeros_like(y)) if like is None else like.matrix_of(linear)
        return _solved_unless_free(by_all, y)

    return jax.lax.custom_root(
        residual, start, lambda _, start: search.run(start), solved, has_aux=True
    )


class _RootSearch(NamedTuple):
    """The problem of `find_root`, and its search."""

    residual: Callable[..., Array]
    acceptable: Callable[[Array], Array]
    support: Array | None
    jacobian: Callable[..., BlockTridiagonal] | None

    def run(self, start: Array) -> tuple[Array, Array]:
        """The root, and the fraction of the load that was reached."""
        zero = jnp.zeros((), start.dtype)
        if self.support is None:
            return self._followed(start, zero)[:2]

        def again(state: tuple[Any, ...]) -> tuple[Any, ...]:
            tries, *before = state
            found = self._followed(start, jnp.where(tries > 0, 1.0, zero))
            better = (tries == 0) | found[2]
            kept = (jnp.where(better, a, b) for a, b in zip(found, before, strict=True))
            return (tries + 1, *kept)

        first = jnp.asarray(0), start, zero, jnp.asarray(False)
        end = jax.lax.while_loop(lambda state: (state[0] < 2) & ~state[3], again, first)
        return end[1], end[2]

    def _followed(self, start: Array, held: Array) -> tuple[Array, Array, Array]:
        """The root followed from no load to all of it, with the support if `held` is one and not
        zero: x, the fraction reached, and whether x is a minimum not too far from the start."""

        def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
            x, done, step, minimum, k = state
            target = jnp.minimum(done + step, 1.0)
            new, ok, least = self._newton(x, target, held)
            ok &= (held == 0) | (least & (jnp.max(jnp.abs(new - x)) < _NEAR))
            return (
                jnp.where(ok, new, x),
                jnp.where(ok, target, done),
                jnp.where(ok, 2 * step, step / 4),
                jnp.where(ok, least, minimum),
                k + 1,
            )

        def go_on(state: tuple[Any, ...]) -> Array:
            more: Array = (state[1] < 1) & (state[2] > 1e-9) & (state[4] < 100)
            return more

        one = jnp.ones((), start.dtype)
        first = start, 0 * one, jnp.where(held > 0, _SHORT, one), one > 0, jnp.asarray(0)
        x, done, _, minimum, _ = jax.lax.while_loop(go_on, body, first)
        far = (held == 0) & (jnp.max(jnp.abs(x - start)) > _FAR)
        return x, done, minimum & (done == 1) & ~far

    def _newton(self, x: Array, fraction: Array, held: Array) -> tuple[Array, Array, Array]:
        """The root at a fraction of the load, whether one was found, and whether it is a
        minimum."""
        support = self.support

        def residual(x: Array) -> Array:
            out = self.residual(x, fraction)
            return out if support is None else out + held * (1 - fraction) * (support @ x)

        def body(state: tuple[Any, ...]) -> tuple[Any, ...]:
            x, _, _, k = state
            value, slope = self._value_and_slope(residual, x, fraction, held)
            dx = _solved_unless_free(slope, value)
            return x - dx, slope, jnp.max(jnp.abs(dx)) / (1 + jnp.max(jnp.abs(x))), k + 1

        def go_on(state: tuple[Any, ...]) -> Array:
            more: Array = (state[2] > 1e-13) & (state[3] < 20)  # false for NaN
            return more

        unit, far = jnp.eye(x.size, dtype=x.dtype), jnp.asarray(jnp.inf, x.dtype)
        x, slope, change, _ = jax.lax.while_loop(go_on, body, (x, unit, far, jnp.asarray(0)))
        minimum = jnp.asarray(True) if support is None else positive_definite(slope + slope.T)
        # Rounding may keep the step slightly above the tolerance: that is accepted.
        return x, (change < 1e-10) & self.acceptable(x), minimum

    def _value_and_slope(
        self, residual: Callable[[Array], Array], x: Array, fraction: Array, held: Array
    ) -> tuple[Array, Array]:
        """The residual with its support, and its derivatives."""
        if self.jacobian is None:
            return value_and_jacobian(residual, x)
        slope = self.jacobian(x, fraction).dense()
        if self.support is not None:
            slope = slope + held * (1 - fraction) * self.support
        return residual(x), slope


def _solved_unless_free(
    slope: Float[Array, "n n"], value: Float[Array, " n"]
) -> Float[Array, " n"]:
    """The solution x of slope x = value, with x = value, zero at equilibrium, for unknowns whose
    row of the matrix is zero, such as the angle of a free hinge at rest."""
    free = jnp.all(slope == 0, 1)
    return solve(slope + jnp.diag(jnp.where(free, 1.0, 0.0)), value)
