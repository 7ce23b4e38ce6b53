"""Eigenpairs of quadratic problems without structure: damped, unstable, under following forces."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from jaxbeam._numerics.gyroscopic import by_skew, by_skew_shifted
from jaxbeam._numerics.linalg import modes_and_squares
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._programs.batches import one_by_one


def quadratic_eigenpairs(
    mass: Float[Array, "n n"], by_rates: Float[Array, "n n"], stiffness: Float[Array, "n n"],
    conservative: bool, free: int = 0,
) -> tuple[Complex[Array, " n"], Complex[Array, "n n"]]:  # fmt: skip
    """Half of the eigenpairs: n of all 2 n lambda with (lambda^2 M + lambda C + K) x = 0, and x as
    rows. Of a complex pair it is the one with Im lambda > 0, of the real ones the larger half:
    those that grow of undamped pairs +-lambda, the slower one of each overdamped pair.

    Modes that grow without oscillating come first, then all others by |lambda|, overdamped ones by
    the undamped frequency of their shape. Eigenvectors have unit modal mass, x^H M x = 1, and any
    phase. `conservative`: C is skew and K symmetric; then modes are found as in
    `gyroscopic_eigenpairs` where K is positive definite, or singular with `free` motions without
    stiffness at most.

    Otherwise, in coordinates of modes of the symmetric part of K with squares of frequencies mu,
    and with w^2 = |mu|, the eigenvalues of

        [[-A^-1 D, -A^-1 W^-1], [W^-1, 0]],   A = W^-1 K W^-1,  D = W^-1 C W^-1,  W = diag(w),

    are 1 / lambda, so that the lowest lambda are the most accurate.
    """
    solver = _conservative if conservative else one_by_one(_by_companion)
    if conservative and free:
        solver = one_by_one(functools.partial(_with_free_motions, free))
    found: tuple[Array, Array] = solver(mass, by_rates, stiffness)
    return found


@one_by_one
def _conservative(m: Array, c: Array, k: Array) -> tuple[Array, Array]:
    lam, x, stable = by_skew(m, c, k)
    found: tuple[Array, Array] = jax.lax.cond(
        stable, lambda: (lam, x.T), lambda: _by_companion(m, c, k)
    )
    return found


def _with_free_motions(free: int, m: Array, c: Array, k: Array) -> tuple[Array, Array]:
    lam, x, stable = by_skew_shifted(m, c, k, free)
    fine = stable & jnp.all(jnp.isfinite(lam))
    found: tuple[Array, Array] = jax.lax.cond(
        fine, lambda: (lam, x.T), lambda: _by_companion(m, c, k)
    )
    return found


@one_by_one
def _by_companion(m: Array, c: Array, k: Array) -> tuple[Array, Array]:
    n = len(m)
    modes, mu = modes_and_squares(m, symmetric_part(k))
    tiny = jnp.finfo(mu.dtype).tiny
    inverse_roots = 1 / jnp.sqrt(jnp.maximum(jnp.abs(mu), tiny))
    modes = modes * inverse_roots[:, None]
    stiff, rates = modes @ k @ modes.T, modes @ c @ modes.T
    right = jnp.linalg.solve(stiff, jnp.concatenate([rates, jnp.diag(inverse_roots)], 1))
    zeros = jnp.zeros_like(m)
    companion = jnp.concatenate([-right, jnp.concatenate([jnp.diag(inverse_roots), zeros], 1)])
    finite = jnp.all(jnp.isfinite(companion))
    companion = jnp.where(finite, companion, jnp.eye(2 * n, dtype=m.dtype))
    nu, z = jax.lax.linalg.eig(companion, compute_left_eigenvectors=False)
    lam, x = 1 / nu, z[:n].T @ modes
    mass = jnp.sum(x.conj() * (x @ m), 1).real
    x = x / jnp.sqrt(mass)[:, None]
    # Of complex pairs Im lambda > 0 is kept, of the real eigenvalues the larger half.
    real = lam.imag == 0
    rank = jnp.sum((lam.real[None] > lam.real[:, None]) & real[None], 1)
    kept = (lam.imag > 0) | (real & (rank < jnp.sum(real) // 2))
    square = jnp.abs(lam) ** 2
    natural = jnp.abs(jnp.sum(x.conj() * (x @ k), 1))
    square = jnp.where(real, jnp.where(lam.real > 0, -square, natural), square)
    order = jnp.argsort(jnp.where(kept, square, jnp.inf))[:n]
    fine = jnp.where(finite, 1.0, jnp.nan)
    return fine * lam[order], fine * x[order]
