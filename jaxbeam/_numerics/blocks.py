"""Block-tridiagonal matrices: products, sums and elimination at a cost linear in their size."""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._numerics.small import small_inverse, written_out
from jaxbeam._programs.lanes import compute_once, sum_of_products
from jaxbeam._programs.platforms import loops_are_dear

Blocks = Float[Array, "k b b *lanes"]
_Vector = Float[Array, "n *lanes"]


class BlockTridiagonal(eqx.Module):
    """Square matrix with k blocks of b by b on its diagonal and k - 1 beside it on either side.

    `rows` (k, b, 3 b) holds, row of blocks by row, the lower block, the diagonal and the upper one;
    the first lower and the last upper block are ignored. So are the first `absent` rows and columns
    of the first block, which are not part of the matrix: its size is n = k b - absent. Sums,
    multiples by scalars and products with vectors (n,) are written as for arrays. All of them may
    have axes of lanes behind the others (see `kernel`).
    """

    rows: Float[Array, "k b c *lanes"]
    absent: int = eqx.field(static=True, default=0)

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (n, n) of the whole matrix."""
        k, b = self.rows.shape[:2]
        return (k * b - self.absent,) * 2

    def __add__(self, other: "BlockTridiagonal") -> "BlockTridiagonal":
        return jax.tree.map(jnp.add, self, other)

    def __mul__(self, factor: Any) -> "BlockTridiagonal":
        return jax.tree.map(lambda a: factor * a, self)

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> "BlockTridiagonal":
        return self * (1 / divisor)

    def __matmul__(self, x: _Vector) -> _Vector:
        b = self.rows.shape[1]
        beside, k = padded(x, self.absent + b, b).reshape(-1, b, *x.shape[1:]), len(self.rows)
        if x.ndim > 1 and not loops_are_dear():
            # Each number is read where it is: windows of blocks, or rows in a loop, would be
            # copies.
            places = [(side, i) for side in range(3) for i in range(b)]
            terms = [
                self.rows[:, :, side * b + i] * beside[side : side + k, i : i + 1]
                for side, i in places
            ]
            return self.flat(compute_once(functools.reduce(jnp.add, terms)))
        window = jnp.concatenate([beside[:-2], beside[1:-1], beside[2:]], 1)
        return self.flat(sum_of_products(self.rows, window[:, None], 2, x.ndim - 1))

    def __rmatmul__(self, x: _Vector) -> _Vector:
        """The product x^T A."""
        b = self.rows.shape[1]
        terms = compute_once(sum_of_products(self.rows, self.blocked(x)[:, :, None], 1, x.ndim - 1))
        low, diagonal, up = terms[1:, :b], terms[:, b : 2 * b], terms[:-1, 2 * b :]
        return self.flat(diagonal + padded(low, 0, 1) + padded(up, 1, 0))

    def outer(
        self, x: Float[Array, "s n *lanes"], y: Float[Array, "s n *lanes"]
    ) -> "BlockTridiagonal":
        """The sum over i of x_i y_i^T, as a block-tridiagonal matrix: without entries elsewhere."""
        lanes = x.ndim - 2
        left = jax.vmap(self.blocked)(x)
        beside = jax.vmap(lambda y: padded(self.blocked(y), 1, 1))(y)
        window = jnp.concatenate([beside[:, :-2], beside[:, 1:-1], beside[:, 2:]], 2)
        rows = sum_of_products(left[:, :, :, None], window[:, :, None], 0, lanes)
        return BlockTridiagonal(rows, self.absent)

    def dense(self) -> Float[Array, "n n"]:
        """The whole matrix as an array (n, n); not for matrices with lanes."""
        k, b, _ = self.rows.shape
        # Rows of blocks are padded to be b longer than rows of the matrix, then written one behind
        # the other and cut into rows of the matrix: so each begins b columns after the last.
        width = (k + 2) * b
        rows = jnp.pad(self.rows.swapaxes(0, 1), ((0, 0), (0, 0), (0, width - 2 * b)))
        out = rows.reshape(b, k * (width + b))[:, : k * width].reshape(b, k, width)
        return out.swapaxes(0, 1).reshape(k * b, width)[self.absent :, b + self.absent : -b]

    def inverse(self) -> "BlockInverse":
        """The inverse by elimination, for products with vectors; differentiable in both modes."""
        return BlockInverse(self)

    def matrix_of(self, linear: Callable[[_Vector], _Vector]) -> Float[Array, "n n"]:
        """The matrix, as an array, of a linear map with the blocks of this matrix. Columns three
        blocks apart have no row in common, so that one product gives many of them."""
        k, b, _ = self.rows.shape
        place = np.arange(k * b)[self.absent :]
        probes = place % (3 * b) == np.arange(3 * b)[:, None]
        found = jax.vmap(linear)(jnp.asarray(probes, self.rows.dtype))
        near = np.abs(place[:, None] // b - place // b) <= 1
        return jnp.where(near, found[place % (3 * b)].T, 0.0)

    def blocked(self, x: _Vector) -> Float[Array, "k b *lanes"]:
        """The blocks (k, b) of a vector, with zeros for absent rows."""
        return padded(x, self.absent, 0).reshape(*self.rows.shape[:2], *x.shape[1:])

    def flat(self, x: Float[Array, "k b *lanes"]) -> _Vector:
        """The vector (n,) of blocks (k, b), without absent rows."""
        return x.reshape(-1, *x.shape[2:])[self.absent :]


class BlockInverse(eqx.Module):
    """Inverse of a block-tridiagonal A, to be multiplied with vectors (`@`).

    Block elimination A = (S^-1 + L) (1 + G), S block-diagonal, L the lower blocks, without
    pivoting: for matrices whose leading parts are safely invertible, such as those of time steps
    (mass plus a little of all else) and of stable structures.
    """

    matrix: BlockTridiagonal
    pivots: Blocks  # S
    fore: Blocks  # S L
    back: Blocks  # G = S U

    def __init__(self, matrix: BlockTridiagonal) -> None:
        self.matrix = matrix
        rows = jax.lax.stop_gradient(matrix.rows)
        k, b = rows.shape[:2]
        # Absent rows and columns become those of the unit matrix.
        present = np.ones((k, b, 3, b), bool)
        present[0, :, 0] = present[-1, :, 2] = present[0, : matrix.absent] = False
        present[0, :, 1, : matrix.absent] = present[1:2, :, 0, : matrix.absent] = False
        ones = np.zeros((k, b, 3, b))
        ones[0, :, 1][np.arange(matrix.absent), np.arange(matrix.absent)] = 1.0
        shape = (k, b, 3 * b, *(1,) * (rows.ndim - 3))
        rows = jnp.where(present.reshape(shape), rows, ones.reshape(shape))

        low, diagonal, up = rows[:, :, :b], rows[:, :, b : 2 * b], rows[:, :, 2 * b :]

        def eliminate(before: Array, row: tuple[Array, ...]) -> tuple[Array, Array]:
            low, diagonal, up = row
            pivot = small_inverse(diagonal - _times(low, _times(before, up)))
            return pivot, pivot

        above = jnp.concatenate([jnp.zeros_like(up[:1]), up[:-1]])
        unroll = written_out(k)
        none = jnp.zeros_like(up[0])
        self.pivots = jax.lax.scan(eliminate, none, (low, diagonal, above), unroll=unroll)[1]
        products = jax.vmap(_times)
        self.fore, self.back = products(self.pivots, low), products(self.pivots, up)

    def __matmul__(self, b: _Vector) -> _Vector:
        return self._solved(b, lambda x: self.matrix @ x, _solve, _solve_transposed)

    def __rmatmul__(self, b: _Vector) -> _Vector:
        """The product b^T A^-1."""
        return self._solved(b, lambda x: x @ self.matrix, _solve_transposed, _solve)

    def _solved(
        self, b: _Vector, product: Callable[[_Vector], _Vector], *solvers: Callable[..., Array]
    ) -> _Vector:
        """The solution x of product(x) = b, where the product is with A or with its transpose, by
        two `solvers`: that of product(x) = b, then that of the transposed system."""
        factors = jax.lax.stop_gradient((self.pivots, self.fore, self.back))

        def solve(solver: Callable[..., Array], _: Any, b: _Vector) -> _Vector:
            return self.matrix.flat(solver(*factors, self.matrix.blocked(b)))

        x: Array = jax.lax.custom_linear_solve(
            product, b, *(functools.partial(solve, solver) for solver in solvers)
        )
        return x


def padded(x: Array, before: int, after: int) -> Array:
    """An array with rows of zeros before and after its own along the first axis."""
    return jnp.pad(x, ((before, after), *((0, 0),) * (x.ndim - 1)))


def _sweep(
    steps: Blocks, b: Float[Array, "k b *lanes"], *, reverse: bool
) -> Float[Array, "k b *lanes"]:
    """The solution of y_i = b_i - steps_i y_(i-1), or y_(i+1) in `reverse`, block by block."""

    def step(y: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        y = row[0] - _apply(row[1], y)
        return y, y

    unroll = written_out(len(b))
    return jax.lax.scan(step, jnp.zeros_like(b[0]), (b, steps), reverse=reverse, unroll=unroll)[1]


def _solve(pivots: Blocks, fore: Blocks, back: Blocks, b: Float[Array, "k b *lanes"]) -> Array:
    return _sweep(back, _sweep(fore, jax.vmap(_apply)(pivots, b), reverse=False), reverse=True)


def _solve_transposed(
    pivots: Blocks, fore: Blocks, back: Blocks, b: Float[Array, "k b *lanes"]
) -> Array:
    """The solution x of A^T x = b: (1 + G)^T z = b, (1 + S L)^T w = z and x = S^T w."""
    before = jnp.concatenate([jnp.zeros_like(back[:1]), back[:-1]]).swapaxes(1, 2)
    after = jnp.concatenate([fore[1:], jnp.zeros_like(fore[:1])]).swapaxes(1, 2)
    w = _sweep(after, _sweep(before, b, reverse=False), reverse=True)
    return jax.vmap(_apply)(pivots.swapaxes(1, 2), w)


def _times(a: Float[Array, "b b *lanes"], b: Float[Array, "b b *lanes"]) -> Array:
    """The product of small matrices written out as sums, which XLA fuses, and whose lanes fill
    vector units."""
    return sum_of_products(a[:, :, None], b[None], 1, a.ndim - 2)


def _apply(a: Float[Array, "b c *#lanes"], x: Float[Array, "c *#lanes"]) -> Array:
    return sum_of_products(a, x[None], 1, x.ndim - 1)
