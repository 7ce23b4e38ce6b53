"""Eigenpairs of quadratic problems without structure: damped, unstable, under following forces."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from jaxbeam._numerics.gyroscopic import by_skew, by_skew_settled
from jaxbeam._numerics.linalg import modes_and_squares
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._programs.batches import one_by_one


def quadratic_eigenpairs(
    mass: Float[Array, "n n"], by_rates: Float[Array, "n n"], stiffness: Float[Array, "n n"],
    conservative: bool, free: int = 0,
) -> tuple[Complex[Array, " n"], Complex[Array, "n n"]]:  # fmt: skip
    """Half of the eigenpairs: n of all 2 n lambda with (lambda^2 M + lambda C + K) x = 0, lowest
    first, and x as rows: of a pair of complex ones that with Im lambda > 0, of the real ones the
    larger half, which of undamped pairs +-lambda are those that grow, and of each damped pair the
    slower.

    Those that grow without swinging come before all others, which go by |lambda|, what creeps back
    without swinging by the frequency of its own shape without damping. Eigenvectors have unit modal
    mass, x^H M x = 1, and any phase. `conservative`: C is skew and K symmetric, so that, where K is
    positive definite, all is found as in `gyroscopic_eigenpairs`, or singular where so many motions
    may be `free`.

    In modes of the symmetric part of K, mu their squares of frequencies, and with w^2 = |mu|, the
    eigenvalues of

        [[-A^-1 D, -A^-1 W^-1], [W^-1, 0]],   A = W^-1 K W^-1,  D = W^-1 C W^-1,  W = diag(w),

    are 1 / lambda, so that the lowest are the largest.
    """
    solver = _conservative if conservative else one_by_one(_by_companion)
    if conservative and free:
        solver = one_by_one(functools.partial(_freely, free))
    found: tuple[Array, Array] = solver(mass, by_rates, stiffness)
    return found


@one_by_one
def _conservative(m: Array, c: Array, k: Array) -> tuple[Array, Array]:
    lam, x, stable = by_skew(m, c, k)
    found: tuple[Array, Array] = jax.lax.cond(
        stable, lambda: (lam, x.T), lambda: _by_companion(m, c, k)
    )
    return found


def _freely(free: int, m: Array, c: Array, k: Array) -> tuple[Array, Array]:
    lam, x, stable = by_skew_settled(m, c, k, free)
    fine = stable & jnp.all(jnp.isfinite(lam))
    found: tuple[Array, Array] = jax.lax.cond(
        fine, lambda: (lam, x.T), lambda: _by_companion(m, c, k)
    )
    return found


@one_by_one
def _by_companion(m: Array, c: Array, k: Array) -> tuple[Array, Array]:
    n = len(m)
    own, mu = modes_and_squares(m, symmetric_part(k))
    tiny = jnp.finfo(mu.dtype).tiny
    over = 1 / jnp.sqrt(jnp.maximum(jnp.abs(mu), tiny))
    own = own * over[:, None]
    stiff, rates = own @ k @ own.T, own @ c @ own.T
    right = jnp.linalg.solve(stiff, jnp.concatenate([rates, jnp.diag(over)], 1))
    none = jnp.zeros_like(m)
    companion = jnp.concatenate([-right, jnp.concatenate([jnp.diag(over), none], 1)])
    finite = jnp.all(jnp.isfinite(companion))
    companion = jnp.where(finite, companion, jnp.eye(2 * n, dtype=m.dtype))
    nu, z = jax.lax.linalg.eig(companion, compute_left_eigenvectors=False)
    lam, x = 1 / nu, z[:n].T @ own
    mass = jnp.sum(x.conj() * (x @ m), 1).real
    x = x / jnp.sqrt(mass)[:, None]
    # Of the real ones those that are at least the middle one.
    real = lam.imag == 0
    rank = jnp.sum((lam.real[None] > lam.real[:, None]) & real[None], 1)
    kept = (lam.imag > 0) | (real & (rank < jnp.sum(real) // 2))
    square = jnp.abs(lam) ** 2
    natural = jnp.abs(jnp.sum(x.conj() * (x @ k), 1))
    square = jnp.where(real, jnp.where(lam.real > 0, -square, natural), square)
    order = jnp.argsort(jnp.where(kept, square, jnp.inf))[:n]
    fine = jnp.where(finite, 1.0, jnp.nan)
    return fine * lam[order], fine * x[order]
