"""Symmetric band matrices, and eigenvalues of gyroscopic systems of them.

An array (n, b + 1) holds of column after column the diagonal entry and the b below it; all others
are zero. Axes of lanes may follow (see `kernel`).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._programs.lanes import compute_once, pairwise_sum

Band = Float[Array, "n w ..."]
_Vector = Float[Array, "n ..."]


def band(matrix: Float[np.ndarray, "n n"], width: int) -> Float[np.ndarray, "n w"]:
    """The band array of a constant symmetric matrix (n, n), `width` being b + 1."""
    n = len(matrix)
    wide = np.pad(matrix, ((0, width), (0, 0)))
    return np.stack([wide[j : j + width, j] for j in range(n)])


def full(matrix: Float[Array, "n n *lanes"]) -> Float[Array, "n n *lanes"]:
    """The band array of a symmetric matrix (n, n) without zeros, of width n."""
    none = jnp.zeros_like(matrix)
    return jnp.stack([jnp.concatenate([matrix[j:, j], none[:j, j]]) for j in range(len(matrix))])


def width_of(*matrices: Float[np.ndarray, "n n"]) -> int:
    """Width b + 1 of a band that holds all matrices: the main diagonal and those below it."""
    diagonals = (int(np.max(np.abs(np.subtract(*np.nonzero(a))), initial=0)) for a in matrices)
    return 1 + max(diagonals, default=0)


def band_matvec(a: Any, x: _Vector) -> _Vector:
    """The product A x of a symmetric band matrix with a vector."""
    y = a[:, 0] * x
    for m in range(1, a.shape[1]):
        below = a[:-m, m]
        none = jnp.zeros_like(y[:m])
        y = y + jnp.concatenate([below * x[m:], none]) + jnp.concatenate([none, below * x[:-m]])
    return compute_once(y)


def factors(a: Band) -> tuple[_Vector, Float[Array, "n b ..."]]:
    """The factors of A = (1 + L) D (1 + L)^T without pivoting: D and the columns of L below the
    diagonal.

    A pivot that is exactly zero, as where omega is an eigenvalue to the last bit, is replaced by
    one of the size of rounding, with which inverse iteration works.
    """
    b, eps = a.shape[1] - 1, jnp.finfo(a.dtype).eps
    none = jnp.zeros((b, *a.shape[2:]), a.dtype)

    def longer(x: Array) -> Array:
        return jnp.concatenate([x, none[:1]])

    def eliminate(ahead: Any, column: Array) -> tuple[Any, tuple[Array, Array]]:
        # `ahead` has for each of the next b columns the sum that elimination takes from it so far.
        whole, column = column[0], column - longer(ahead[0])
        pivot = jnp.where(column[0] == 0, eps * jnp.abs(whole), column[0])
        below = column[1:] * (1 / pivot)[None]
        taken = [column[j + 1][None] * below[j:] for j in range(b)]
        before = [longer(x) for x in ahead[1:]] + [none[:1]]
        return [x + y for x, y in zip(before, taken, strict=True)], (pivot, below)

    _, (d, below) = jax.lax.scan(eliminate, [none[j:] for j in range(b)], a)
    return d, below


def solved(d: _Vector, below: Float[Array, "n b ..."], x: _Vector) -> _Vector:
    """The solution A^-1 x, by what `factors` returns."""

    def back(after: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        y = row[0] - pairwise_sum(row[1] * after)
        return jnp.concatenate([y[None], after[:-1]]), y

    y = _forward(below, x)
    return jax.lax.scan(back, jnp.zeros_like(below[0] * x[:1]), (y / d, below), reverse=True)[1]


def _forward(below: Float[Array, "n b ..."], x: _Vector) -> _Vector:
    """The solution (1 + L)^-1 x, by the columns `below` the diagonal of L."""

    def eliminate(ahead: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        y = row[0] - ahead[0]
        ahead = jnp.concatenate([ahead[1:], jnp.zeros_like(ahead[:1])])
        return ahead + row[1] * y[None], y

    return jax.lax.scan(eliminate, jnp.zeros_like(below[0] * x[:1]), (x, below))[1]


def polished(a: Band, x: _Vector) -> _Vector:
    """The vector A^-1 x at unit length: one inverse iteration towards the null space of A."""
    x = solved(*factors(a), x)
    return x / jnp.sqrt(pairwise_sum(x**2))


class Pencil(NamedTuple):
    """The pencil D(omega) = K - omega^2 M + omega C of symmetric bands of one width; C may be
    None."""

    k: Band
    m: Band
    c: Band | None = None

    def matrix(self, omega: Float[Array, "..."]) -> Band:
        """The matrix D(omega)."""
        d = self.k - omega**2 * self.m
        return d if self.c is None else d + omega * self.c

    def slope(self, omega: Float[Array, "..."]) -> Band:
        """The matrix 2 omega M - C, minus the derivative of D(omega)."""
        d = 2 * omega * self.m
        return d if self.c is None else d - self.c


class Found(NamedTuple):
    """A frequency and its vector, whether the iteration converged, and how many frequencies lie
    `below` the one found, by Sylvester's law of inertia: K must be positive definite."""

    omega: Float[Array, "..."]
    x: Array
    done: Bool[Array, "..."]
    below: Float[Array, "..."]


def refined(pencil: Pencil, omega: Float[Array, "..."], x: _Vector) -> Found:
    """Frequency omega and vector x, x^T M x = 1, of D(omega) x = 0 near a guess.

    Inverse iteration x <- D^-1 D' x with Rayleigh quotients: the error of x falls by a factor of
    the order of the relative change of omega; the error of omega is the square of that of x. It
    ends where the error of x is near rounding.
    """
    none, tolerance = jnp.zeros_like(omega), 5e3 * jnp.finfo(x.dtype).eps

    def times(a: Band | None, x: Array) -> Array:
        return jnp.zeros_like(x) if a is None else band_matvec(a, x)

    def go_on(state: tuple[Array, ...]) -> Array:
        return (state[0] < 8) & jnp.any(state[-1] < 1)

    def improve(state: tuple[Array, ...]) -> tuple[Array, ...]:
        i, omega, x, mx, cx, below, done = state
        d, columns = factors(pencil.matrix(omega))
        right = cx - 2 * omega * mx
        new = solved(d, columns, right)
        new_mx, new_cx = times(pencil.m, new), times(pencil.c, new)
        size = pairwise_sum(new * new_mx) ** -0.5
        # The root of x^T D(omega + change) x, with D x = right * size and x^T M x = 1.
        constant = size**2 * pairwise_sum(new * right)
        linear = size**2 * pairwise_sum(new * new_cx) - 2 * omega
        change = 2 * constant / (jnp.sqrt(linear**2 + 4 * constant) - linear)
        better = omega + change
        sine = jnp.sqrt(jnp.abs(1 - (size * pairwise_sum(x * new_mx)) ** 2))
        # Frequencies below omega, without the one found. The count by the last omega is the best,
        # unless omega is right to rounding: then the sign of its own pivot is not certain.
        lower = pairwise_sum(jnp.where(d < 0, 1.0, 0.0)) - jnp.where(change < 0, 1.0, 0.0)
        counts = (done < 1) & ((i < 1) | (jnp.abs(change) > 1e-10 * better))
        # A case that has converged stays as it is while others of the batch go on.
        small = jnp.where(jnp.abs(change) * sine < tolerance * better, 1.0, 0.0)
        return (
            i + 1,
            jnp.where(done < 1, better, omega),
            *(jnp.where(done < 1, size * a, b) for a, b in ((new, x), (new_mx, mx), (new_cx, cx))),
            jnp.where(counts, lower, below),
            jnp.where(done < 1, small, done),
        )

    mx = times(pencil.m, x)
    size = pairwise_sum(x * mx) ** -0.5
    state: tuple[Array, ...] = (
        jnp.zeros((), int), omega, size * x, size * mx, size * times(pencil.c, x), none, none
    )  # fmt: skip
    _, omega, x, _, _, below, done = jax.lax.while_loop(go_on, improve, state)
    return Found(omega, x, done > 0, below)


def largest(a: Float[Array, "m m *lanes"], count: int) -> Float[Array, "k *lanes"]:
    """Largest eigenvalues of small symmetric matrices of even size, to some three digits of their
    differences, by three sweeps of Jacobi's method with disjoint rotations side by side."""
    m = len(a)
    half = m // 2
    # Each pair of rows meets once in m - 1 rounds, as players in a tournament, the first of whom
    # keeps his seat (R. P. Brent, F. T. Luk, SIAM J. Sci. Stat. Comput. 6, 1985).
    order = np.concatenate([[0, half], np.arange(1, half - 1), np.arange(half + 1, m), [half - 1]])

    def rotations(a: Array, _: Any) -> tuple[Array, None]:
        pairs = [(a[i, i], a[half + i, half + i], a[i, half + i]) for i in range(half)]
        first, second, between = (jnp.stack(part) for part in zip(*pairs, strict=True))
        alone = jnp.abs(between) < 1e3 * jnp.finfo(a.dtype).tiny
        slope = (second - first) / (2 * jnp.where(alone, 1.0, between))
        t = jnp.where(slope < 0, -1.0, 1.0) / (jnp.abs(slope) + jnp.sqrt(slope**2 + 1))
        t = jnp.where(alone, 0.0, t)
        cosine = 1 / jnp.sqrt(1 + t**2)
        c, s = cosine[:, None], (t * cosine)[:, None]
        for _side in range(2):
            a = jnp.concatenate([c * a[:half] - s * a[half:], s * a[:half] + c * a[half:]])
            a = jnp.swapaxes(jnp.stack([a[i] for i in order]), 0, 1)
        return a, None

    a, _ = jax.lax.scan(rotations, a, None, length=3 * (m - 1))
    values = [a[i, i] for i in range(m)]
    found: list[Array] = []
    while len(found) < count:
        for i in range(len(values) - 1):  # the largest sinks to the end
            low, high = (
                jnp.minimum(values[i], values[i + 1]),
                jnp.maximum(values[i], values[i + 1]),
            )
            values[i], values[i + 1] = low, high
        found.append(values.pop())
    return jnp.stack(found)


def congruent(
    k: Float[Array, "m m *lanes"], a: Float[Array, "m m *lanes"]
) -> Float[Array, "m m *lanes"]:
    """The matrix F^-1 A F^-T with K = F F^T, for small matrices."""
    d, below = factors(full(k))
    root = jnp.sqrt(d)[:, None]

    def divided(b: Array) -> Array:
        return _forward(below[:, :, None], b) / root

    return divided(jnp.swapaxes(divided(a), 0, 1))
