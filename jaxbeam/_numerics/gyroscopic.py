"""Modes of systems with any gyroscopic matrix, as eigenpairs of skew matrices."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._numerics.linalg import BlockPairs
from jaxbeam._numerics.loose import cholesky, lower_solve, shift, shifted_if_loose, without_shift
from jaxbeam._programs.batches import one_by_one

_ROOM = 1e-3  # largest shift, over the square of the lowest bending frequency


def gyroscopic_eigenpairs(
    mass: Float[Array, "n n"], gyroscopic: Float[Array, "n n"], stiffness: Float[Array, "n n"],
    free: int = 0,
) -> BlockPairs:  # fmt: skip
    """All lambda, x with (lambda^2 M + lambda G + K) x = 0 and Im lambda > 0, lowest first, for
    any skew G and K positive definite, or singular with `free` motions without stiffness at most;
    else `positive` is 0 and results are NaN.

    With K = L L^T, M = F F^T the skew matrix

        [[-L^-1 G L^-T, -L^-1 F], [F^T L^-T, 0]]

    has the eigenvalues 1 / lambda, the lowest frequencies for the largest. Eigenvectors have unit
    modal mass, x^H M x = 1, and any phase.
    """
    solver = _with_free_motions(free) if free else _gyroscopic
    return BlockPairs(*solver(mass, gyroscopic, stiffness))


@one_by_one
def _gyroscopic(m: Array, gyro: Array, k: Array) -> tuple[Array, Array, Array]:
    lam, x, stable = by_skew(m, gyro, k)
    return lam, x.T, stable.astype(int)


def _with_free_motions(free: int) -> Callable[[Array, Array, Array], tuple[Array, Array, Array]]:
    def solver(m: Array, gyro: Array, k: Array) -> tuple[Array, Array, Array]:
        lam, x, stable = by_skew_shifted(m, gyro, k, free)
        return lam, x.T, stable.astype(int)

    solve_each: Callable[[Array, Array, Array], Any] = one_by_one(solver)
    return solve_each


def _skew(m: Array, gyro: Array, k: Array) -> tuple[Array, Array, Array]:
    """The skew matrix of `gyroscopic_eigenpairs`, the Cholesky factor L of K, and whether K has
    one."""
    lower = cholesky(k)
    stable = jnp.all(jnp.isfinite(lower)) & jnp.all(jnp.isfinite(m + gyro))
    lower = jnp.where(stable, lower, jnp.eye(len(m), dtype=m.dtype))
    reduced_gyro = lower_solve(lower, lower_solve(lower, gyro).T).T
    mixed = lower_solve(lower, cholesky(m))
    skew = jnp.block([[-reduced_gyro, -mixed], [mixed.T, jnp.zeros_like(m)]])
    return (skew - skew.T) / 2, lower, stable


def lowest_by_skew(
    m: Array, gyro: Array, k: Array, count: int
) -> tuple[Array, Array, Array, Array]:
    """The lowest eigenpairs of `gyroscopic_eigenpairs`, `count` of them, with modes as rows, the
    share of their energy that is kinetic, and whether K is positive definite.

    The skew matrix S has the symmetric S^T S with each eigenvalue 1 / omega^2 twice. Its real
    eigenproblem, an eighth of the work of that of S, gives the subspace of the lowest modes, and S
    within this subspace the modes: to full accuracy where not far above the lowest frequency.
    """
    n = len(m)
    skew, lower, stable = _skew(m, gyro, k)
    vectors, _ = jax.lax.linalg.eigh(skew.T @ skew, symmetrize_input=False)
    subspace = vectors[:, -2 * count :]
    y, nu = jax.lax.linalg.eigh(1j * (subspace.T @ skew @ subspace), symmetrize_input=False)
    y = subspace @ y[:, ::-1][:, :count]
    kinetic = jnp.sum(jnp.abs(y[n:]) ** 2, 0)
    parts = lower_solve(lower, jnp.concatenate([y[:n].real, y[:n].imag], 1), transpose=True)
    x = jax.lax.complex(parts[:, :count], parts[:, count:])
    x = x / jnp.sqrt(jnp.sum((x.conj() * (m @ x)).real, axis=0))[None]
    return 1j / nu[::-1][:count], x.T, kinetic, stable


def by_skew(m: Array, gyro: Array, k: Array) -> tuple[Array, Array, Array]:
    """The eigenpairs of `gyroscopic_eigenpairs`, with modes as columns."""
    n = len(m)
    skew, lower, stable = _skew(m, gyro, k)
    y, nu = jax.lax.linalg.eigh(1j * skew, symmetrize_input=False)
    x = lower_solve(lower + 0j, y[:n, ::-1][:, :n], transpose=True)
    x = x / jnp.sqrt(jnp.sum((x.conj() * (m @ x)).real, axis=0))[None]
    fine = jnp.where(stable, 1.0, jnp.nan)
    return fine * 1j / nu[::-1][:n], fine * x, stable


def by_skew_shifted(m: Array, gyro: Array, k: Array, free: int) -> Any:
    """The eigenpairs of `by_skew` where up to `free` motions may have no stiffness. They count as
    not stable where rounding of high frequencies needs a shift that is not small beside squares of
    bending frequencies: with that an indefinite K may seem to be positive definite."""

    def found(more: Array) -> tuple[Array, Array, Array]:
        lam, x, stable = by_skew(m, gyro, k + more * m)
        kinetic = 1 + jnp.sum(x.conj() * (gyro @ x), 0) / (2 * lam)
        bending = jnp.sort(jnp.abs(lam))[min(free, len(k) - 1)]
        stable &= more <= _ROOM * bending**2
        return without_shift(lam, more / kinetic.real, k, x, free), x, stable

    return shifted_if_loose(found, lambda: shift(m, k, free), free)
