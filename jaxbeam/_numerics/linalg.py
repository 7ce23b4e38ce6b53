"""Dense linear algebra that cannot hang.

Two independent *batched* LAPACK calls in one XLA program can wait for each other for ever on a
machine with two cores: each is split into tasks for the thread pool whose workers they block.
Everything below therefore gives LAPACK one matrix at a time. `one_by_one` turns `vmap` into a loop
over single calls. It leaves LAPACK one core, which costs little, and gives each case its own
branches and number of iterations. On a GPU, whose libraries take batches, all cases go at once.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Inexact, Int

from jaxbeam._numerics.blocks import BlockInverse, BlockTridiagonal
from jaxbeam._numerics.gauss_jordan import gauss_jordan
from jaxbeam._numerics.loose import (
    cholesky,
    lower_solve,
    reduced,
    shift,
    shifted_if_loose,
    symmetric_part,
    without_shift,
)
from jaxbeam._numerics.small import SmallInverse, SmallMatrix
from jaxbeam._programs.batches import one_by_one


@one_by_one
def _lapack_solve(a: Inexact[Array, "n n"], b: Inexact[Array, " n"]) -> Inexact[Array, " n"]:
    return jnp.linalg.solve(a, b)


def solve(a: Inexact[Array, "n n"], b: Inexact[Array, " n"]) -> Inexact[Array, " n"]:
    """The solution x of a x = b, differentiable to any order in both modes."""
    frozen = jax.lax.stop_gradient(a)
    return jax.lax.custom_linear_solve(
        lambda x: a @ x,
        b,
        solve=lambda _, y: _lapack_solve(frozen, y),
        transpose_solve=lambda _, y: _lapack_solve(frozen.T, y),
    )


@one_by_one
def solve_columns(a: Float[Array, "n n"], b: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """The solution x of a x = b in columns, without derivatives."""
    return jnp.linalg.solve(a, b)


def quotient(a: Inexact[Array, ""], b: Inexact[Array, ""]) -> Inexact[Array, ""]:
    """The quotient a / b, linear in a, with 0 / 0 = 0 and otherwise NaN or inf where b is zero. In
    reverse mode too: a zero cotangent gives zero, so that a derivative that does not exist spoils
    no others."""
    fixed = jax.lax.stop_gradient(b)

    def divide(_: object, y: Array) -> Array:
        return jnp.where(y == 0, y, y / fixed)

    return jax.lax.custom_linear_solve(lambda x: b * x, a, divide, divide)


@one_by_one
def _lapack_inverse(a: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]:
    return jnp.linalg.inv(a)


def largest(
    a: Float[Array, "..."], by: Callable[[Array], Array] = jnp.positive
) -> Float[Array, ""]:
    """The largest of an array's numbers, or the one of the largest measure `by`, with its own
    derivative. That of `jnp.max` divides by the count of numbers equal to it: by zero where XLA
    computes them twice, once with more digits."""
    return a.reshape(-1)[jnp.argmax(by(a))]


def dense(a: Float[Array, "n n"] | BlockTridiagonal | SmallMatrix) -> Float[Array, "n n"]:
    """The matrix as an array (n, n)."""
    return a.dense() if isinstance(a, BlockTridiagonal | SmallMatrix) else a


@overload
def inverse(a: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]: ...
@overload
def inverse(a: BlockTridiagonal) -> BlockInverse: ...
@overload
def inverse(a: SmallMatrix) -> SmallInverse: ...
def inverse(
    a: Inexact[Array, "n n"] | BlockTridiagonal | SmallMatrix,
) -> Inexact[Array, "n n"] | BlockInverse | SmallInverse:
    """Inverse of a matrix, to be multiplied (`@`) with many right-hand sides."""
    return a.inverse() if isinstance(a, BlockTridiagonal | SmallMatrix) else _dense_inverse(a)


def outer(
    like: Float[Array, "n n"] | BlockTridiagonal | SmallMatrix,
    x: Float[Array, "s n *lanes"],
    y: Float[Array, "s n *lanes"],
) -> Any:
    """The sum over i of x_i y_i^T as a matrix of the kind of `like`, with the blocks of that alone;
    with lanes unless `like` is an array."""
    return like.outer(x, y) if isinstance(like, BlockTridiagonal | SmallMatrix) else x.T @ y


@jax.custom_jvp
def _dense_inverse(a: Inexact[Array, "n n"]) -> Inexact[Array, "n n"]:
    """The inverse of a dense matrix, up to n = 100 without LAPACK and about as fast: on a busy
    machine LAPACK's threads may wait for each other a hundred times as long as they work, in each
    time step."""
    return gauss_jordan(a) if a.shape[0] <= 100 else _lapack_inverse(a)


class Factors(eqx.Module):
    """A dense matrix in triangular factors, for a few right-hand sides (`@`, from either side): a
    third of the work of an inverse, by operations of LAPACK whose threads do not wait."""

    triangles: Float[Array, "n n"]  # L, without its unit diagonal, below U
    order: Int[Array, " n"]  # rows of the matrix in the order of pivots

    @classmethod
    def of_matrix(cls, a: Float[Array, "n n"]) -> "Factors":
        """The factors of a matrix, with row pivoting."""
        triangles, _, order = jax.lax.linalg.lu(a)
        return cls(triangles, order)

    def __matmul__(self, right: Float[Array, " n"]) -> Float[Array, " n"]:
        lower = self._solved(right[self.order], lower=True)
        return self._solved(lower, lower=False)

    def __rmatmul__(self, left: Float[Array, " n"]) -> Float[Array, " n"]:
        upper = self._solved(left, lower=False, transpose_a=True)
        out = self._solved(upper, lower=True, transpose_a=True)
        return jnp.zeros_like(out).at[self.order].set(out, unique_indices=True)

    def _solved(
        self, right: Float[Array, " n"], *, lower: bool, transpose_a: bool = False
    ) -> Float[Array, " n"]:
        return jax.lax.linalg.triangular_solve(
            self.triangles, right[:, None], left_side=True, lower=lower, unit_diagonal=lower,
            transpose_a=transpose_a,
        )[:, 0]  # fmt: skip


@_dense_inverse.defjvp
def _inverse_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    b = _dense_inverse(*primals)
    return b, -b @ tangents[0] @ b


@jax.custom_jvp
@one_by_one
def positive_inverse(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The inverse of a symmetric positive definite matrix; NaN of others."""
    lower = cholesky(a)
    back = lower_solve(lower, jnp.eye(len(a), dtype=a.dtype))
    return back.T @ back


@positive_inverse.defjvp
def _positive_inverse_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    b = positive_inverse(*primals)
    return b, -b @ tangents[0] @ b


class BlockPairs(NamedTuple):
    """All n eigenpairs of a planar gyroscopic system, see `planar_eigenpairs`."""

    eigenvalue: Inexact[Array, " n"]
    right: Inexact[Array, "n n"]  # eigenvectors as rows
    positive: Int[Array, ""]  # whether the axial stiffness is positive definite


def planar_eigenpairs(
    mass: Float[Array, "n n"],
    gyroscopic: Float[Array, "n n"],
    stiffness: Float[Array, "n n"],
    n_transverse: int,
    free: int = 0,
) -> BlockPairs:
    """All lambda, x with (lambda^2 M + lambda G + K) x = 0 and Im lambda >= 0, lowest first.

    The first `n_transverse` coordinates w are transverse, the others u axial; M and K do not
    couple the two, G couples nothing else. Then w and u move in quadrature, and with g the block
    of G that takes u' into the equations of w, two real n-by-n problems replace the complex
    2n-by-2n one.

    K positive definite (Hermitian, all modes stable). With K = L L^T and M = F F^T,

        B = [[-L_w^-1 g L_u^-T, L_w^-1 F_w], [(L_u^-1 F_u)^T, 0]]

    has the singular values 1 / omega. The lowest frequencies are the largest singular values, so
    they come out to full relative accuracy however stiff the rest is.

    K indefinite. The general problem in nu = 1 / omega^2, z = (w, -u / lambda),

        A^-1 B z = nu z,  A = [[K_w, 0], [g^T, K_u]],  B = [[M_w, -g], [0, M_u]],

    gives growing and decaying modes (without axial coordinates a symmetric problem does). Of a pair
    +-lambda the one with Im > 0 is returned, of a real pair the growing one. Where K is not
    positive definite in u `positive` is 0: if these are axial there is no steady state to vibrate
    about.

    K_w singular, or nearly, as it may be where hinges are `free`: as if it were definite, see
    `_numerics/loose.py`.

    Eigenvectors are scaled to x^T S M x = 1 with S = diag(1 on w, -1 on u). For stable modes that
    is unit modal mass: w is real, u imaginary.
    """
    return BlockPairs(*_eigensolver(n_transverse, free)(mass, gyroscopic, stiffness))


class _Planar(NamedTuple):
    """A planar gyroscopic system, with a method for each case of `planar_eigenpairs` that returns
    lambda and x, as columns."""

    m: Array
    g: Array  # the block of G that takes u' into the equations of w
    k: Array
    nt: int  # number of transverse coordinates, which come first
    transverse: np.ndarray  # (n, 1), whether a coordinate is transverse

    def definite(self, lw: Array, lu: Array) -> tuple[Array, Array]:
        """The modes where K is positive definite, by the Cholesky factors of K_w and K_u."""
        m, g, _, nt, transverse = self
        na = len(m) - nt
        fw = lower_solve(lw, cholesky(m[:nt, :nt]))
        fu = lower_solve(lu, cholesky(m[nt:, nt:]))
        coupling = lower_solve(lu, lower_solve(lw, g).T).T
        b = jnp.block([[-coupling, fw], [fu.T, jnp.zeros((na, nt), m.dtype)]])
        u, sigma, vt = jax.lax.linalg.svd(b, full_matrices=False)
        w = lower_solve(lw, u[:nt], transpose=True)
        a = lower_solve(lu, vt.T[:na], transpose=True)
        x = jnp.concatenate([w, a])
        x = x / jnp.sqrt(jnp.sum(x * (m @ x), axis=0))[None]
        x = jax.lax.complex(jnp.where(transverse, x, 0.0), jnp.where(transverse, 0.0, -x))
        return jax.lax.complex(0 * sigma, 1 / sigma), x

    def shifted(self, more: Array, lu: Array, free: int) -> tuple[Array, Array]:
        """The modes by way of K_w + `more` M_w; NaN where that is not positive definite."""
        m, g, k, nt, transverse = self
        inertia = m[:nt, :nt]
        lw = cholesky(k[:nt, :nt] + more * inertia)
        fine = jnp.isfinite(lw[0, 0])
        lam, x = self.definite(jnp.where(fine, lw, jnp.eye(nt, dtype=m.dtype)), lu)
        lam = jnp.where(fine, lam, jnp.nan)
        w, v = x[:nt].real, x[nt:].imag
        # The shift changes lambda^2 by -2 lambda y^T dK x / y^T (2 lambda M + G) x.
        moving = 1 + jnp.sum(w * (g @ v), 0) / lam.imag
        new = without_shift(lam, more * jnp.sum(w * (inertia @ w), 0) / moving, k, x, free)
        x = jnp.where(transverse, x, x * jnp.where(more == 0, 1.0, new / lam)[None])
        norm = jnp.sum(jnp.where(transverse, x, -x) * (m @ x), axis=0)
        return new, x / jnp.where(more == 0, 1.0, jnp.sqrt(norm))[None]

    def indefinite(self) -> tuple[Array, Array]:
        """The modes where K is not positive definite."""
        m, g, k, nt, transverse = self
        zero = jnp.zeros(g.shape, m.dtype)
        a = jnp.block([[k[:nt, :nt], zero], [g.T, k[nt:, nt:]]])
        b = jnp.block([[m[:nt, :nt], -g], [zero.T, m[nt:, nt:]]])
        nu, z = jax.lax.linalg.eig(jnp.linalg.solve(a, b), compute_left_eigenvectors=False)
        omega = jnp.sqrt(1 / nu)  # principal root: Re >= 0
        growing = (omega.real == 0) & (omega.imag > 0)
        omega = jnp.where(growing, -omega, omega)
        lam = jax.lax.complex(-omega.imag, jnp.abs(omega.real))  # i omega, no negative zero
        x = jnp.where(transverse, z, -lam[None] * z)
        order = jnp.argsort(-(lam**2).real)
        lam, x = lam[order], x[:, order]
        norm = jnp.sum(jnp.where(transverse, x, -x) * (m @ x), axis=0)
        return lam, x / jnp.sqrt(norm)[None]

    def transverse_alone(self) -> tuple[Array, Array]:
        """The modes of a system without axial coordinates."""
        v, mu = modes_and_squares(self.m, self.k)
        root = jnp.sqrt(jnp.abs(mu))
        lam = jax.lax.complex(jnp.where(mu < 0, root, 0), jnp.where(mu < 0, 0, root))
        return lam, v.T + 0j


def _eigensolver(nt: int, free: int) -> Callable[[Array, Array, Array], tuple[Array, ...]]:
    def factors(m: Array, gyro: Array, k: Array) -> tuple[_Planar, Array, Array, Array, Array]:
        """The system, Cholesky factors of K_u and K_w, and whether each of these exists."""
        planar = _Planar(m, gyro[:nt, nt:], k, nt, (np.arange(len(m)) < nt)[:, None])
        lu, lw = cholesky(k[nt:, nt:]), cholesky(k[:nt, :nt])
        # Where there is no factor all of its entries are NaN, so that the first one tells.
        axial_ok, stable = (jnp.all(jnp.isfinite(factor[:1, :1])) for factor in (lu, lw))
        return planar, lu, lw, axial_ok, stable

    def quick(m: Array, gyro: Array, k: Array) -> tuple[tuple[Array, Array, Array], Array]:
        planar, lu, lw, axial_ok, fine = factors(m, gyro, k)
        lam, x = planar.definite(lw, lu)
        fine &= axial_ok & jnp.all(jnp.isfinite(lam)) & jnp.all(jnp.isfinite(x))
        return (lam, x.T, axial_ok.astype(int)), fine

    def solver(m: Array, gyro: Array, k: Array) -> tuple[Array, Array, Array]:
        n = m.shape[0]
        planar, lu, lw, axial_ok, stable = factors(m, gyro, k)
        finite = jnp.all(jnp.isfinite(m + gyro + k))

        def definite(_: None) -> tuple[Array, Array]:
            return planar.definite(lw, lu)

        def indefinite(_: None) -> tuple[Array, Array]:
            return planar.indefinite() if nt < n else planar.transverse_alone()

        def loose(_: None) -> tuple[Array, Array]:
            lam, x = shifted_if_loose(
                lambda more: planar.shifted(more, lu, free),
                lambda: shift(m[:nt, :nt], k[:nt, :nt], free),
                free,
            )
            return jax.lax.cond(jnp.isfinite(lam[0]), lambda: (lam, x), lambda: indefinite(None))

        def nothing(_: None) -> tuple[Array, Array]:
            nan = jnp.full((n, n), jnp.nan, m.dtype) + 0j
            return nan[0], nan

        case = jnp.where(axial_ok if free else axial_ok & stable, 0, 1)
        case = jnp.where(finite, case, 2)
        lam, x = jax.lax.switch(case, [loose if free else definite, indefinite, nothing], None)
        return lam, x.T, axial_ok.astype(int)

    return one_by_one(solver, None if free else quick)


def symmetric_modes(
    mass: Float[Array, "n n"], stiffness: Float[Array, "n n"], free: int = 0
) -> Float[Array, "n n"]:
    """Mass-normalised eigenvectors of K v = mu M v as rows, lowest mu first; K may be indefinite,
    and singular with `free` motions without stiffness at most.

    By F^T K^-1 F y = y / mu, M = F F^T, so that the lowest modes are the most accurate.
    """

    def found(mass: Array, stiffness: Array) -> tuple[Array, Array]:
        return _shifted_modes(mass, stiffness, free)

    return one_by_one(found if free else modes_and_squares)(mass, stiffness)[0]


@one_by_one
def lowest_eigenpair(
    a: Float[Array, "n n"], b: Float[Array, "n n"]
) -> tuple[Float[Array, ""], Float[Array, " n"]]:
    """The lowest mu, and x, of a x = mu b x, with a symmetric and b symmetric positive definite."""
    f, inner = reduced(a, b)
    y, mu = jax.lax.linalg.eigh(inner, symmetrize_input=False)  # eigenvalues in ascending order
    return mu[0], lower_solve(f, y[:, :1], transpose=True)[:, 0]


@one_by_one
def eigensystem(
    a: Float[Array, "n n"],
) -> tuple[Inexact[Array, " n"], Inexact[Array, "n n"], Inexact[Array, "n n"]]:
    """Eigenvalues, right eigenvectors and left ones (y^H a = mu y^H), as columns."""
    mu, left, right = jax.lax.linalg.eig(a)
    return mu, right, left


def positive_definite(a: Float[Array, "n n"]) -> Bool[Array, ""]:
    """Whether a symmetric matrix is positive definite: it has a Cholesky factor."""
    return _factor(jax.lax.stop_gradient(a)) > 0


@one_by_one
def _factor(a: Float[Array, "n n"]) -> Float[Array, ""]:
    return jnp.all(jnp.isfinite(cholesky(a))).astype(a.dtype)


def modes_and_squares(
    mass: Array, stiffness: Array, more: Array | None = None
) -> tuple[Array, Array]:
    """Modes of K v = mu M v as rows, and their mu; by way of K + `more` M if there is a shift."""
    f = cholesky(mass)
    flexible = jnp.linalg.solve(stiffness if more is None else stiffness + more * mass, f)
    a = f.T @ flexible
    y, nu = jax.lax.linalg.eigh(symmetric_part(a), symmetrize_input=False)
    # 1 / mu of the fastest modes may be rounding alone, whose sign means nothing: it is positive.
    size = jnp.abs(nu)
    nu = jax.lax.select(size < len(nu) * jnp.finfo(nu.dtype).eps * nu[-1], size, nu)
    mu, order = jax.lax.sort_key_val(1 / nu, jnp.arange(len(nu)))
    v = (flexible @ y)[:, order].T
    v = v / jnp.sqrt(jnp.sum(v * (v @ mass), axis=1))[:, None]
    return v, mu if more is None else mu - more


def _shifted_modes(mass: Array, stiffness: Array, free: int) -> tuple[Array, Array]:
    def found(more: Array) -> tuple[Array, Array]:
        v, mu = modes_and_squares(mass, stiffness, more)
        return jnp.sqrt(jnp.abs(mu)), v

    omega, v = shifted_if_loose(found, lambda: shift(mass, stiffness, free), free)
    return v, omega
