"""Matrices of few rows with axes of lanes: products and inverses without calls of libraries."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._programs.lanes import matmul, matvec_once
from jaxbeam._programs.platforms import loops_are_dear

_Vector = Float[Array, "n *lanes"]


class SmallMatrix(eqx.Module):
    """A dense matrix, with axes of lanes behind its own, and the operations of
    `BlockTridiagonal`."""

    array: Float[Array, "n n *#lanes"]

    @property
    def shape(self) -> tuple[int, int]:
        """Shape (n, n) of the matrix."""
        n, m = self.array.shape[:2]
        return n, m

    def __add__(self, other: "SmallMatrix | Array") -> "SmallMatrix":
        return SmallMatrix(self.array + (other.array if isinstance(other, SmallMatrix) else other))

    def __mul__(self, factor: Any) -> "SmallMatrix":
        return SmallMatrix(factor * self.array)

    __rmul__ = __mul__

    def __truediv__(self, divisor: Any) -> "SmallMatrix":
        return self * (1 / divisor)

    def __matmul__(self, x: _Vector) -> _Vector:
        return matvec_once(self.array, x)

    def __rmatmul__(self, x: _Vector) -> _Vector:
        """The product x^T A."""
        return matvec_once(self.array.swapaxes(0, 1), x)

    def outer(self, x: Float[Array, "s n *lanes"], y: Float[Array, "s n *lanes"]) -> "SmallMatrix":
        """The sum over i of x_i y_i^T, as a `SmallMatrix`."""
        return SmallMatrix(matmul(x.swapaxes(0, 1), y))

    def dense(self) -> Float[Array, "n n"]:
        """The matrix as an array (n, n); not for matrices with lanes."""
        return self.array

    def inverse(self) -> "SmallInverse":
        """The inverse, for products with vectors; differentiable in both modes."""
        return SmallInverse(self)


class SmallInverse(eqx.Module):
    """Inverse of a `SmallMatrix` A, to be multiplied with vectors (`@`), for matrices that need no
    pivoting, like `BlockInverse`."""

    matrix: SmallMatrix
    inverse: SmallMatrix

    def __init__(self, matrix: SmallMatrix) -> None:
        self.matrix = matrix
        self.inverse = SmallMatrix(small_inverse(jax.lax.stop_gradient(matrix.array)))

    def __matmul__(self, b: _Vector) -> _Vector:
        back, a = self.inverse, self.matrix
        x: Array = jax.lax.custom_linear_solve(
            lambda x: a @ x, b, lambda _, b: back @ b, lambda _, b: b @ back
        )
        return x

    def __rmatmul__(self, b: _Vector) -> _Vector:
        """The product b^T A^-1."""
        back, a = self.inverse, self.matrix
        x: Array = jax.lax.custom_linear_solve(
            lambda x: x @ a, b, lambda _, b: b @ back, lambda _, b: back @ b
        )
        return x


@jax.custom_jvp
def inverses(a: Float[Array, "q n n"]) -> Float[Array, "q n n"]:
    """The inverse of each of many matrices that are symmetric and positive definite."""
    size = jnp.sqrt(jnp.diagonal(a, axis1=1, axis2=2))
    units = size[:, :, None] * size[:, None]  # ones on the diagonal: small entries keep digits
    scaled = small_inverse((a / units).transpose(1, 2, 0))
    return scaled.transpose(2, 0, 1) / units


@inverses.defjvp
def _inverses_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    out = inverses(*primals)
    return out, -out @ tangents[0] @ out


def small_inverse(a: Float[Array, "b b *lanes"]) -> Float[Array, "b b *lanes"]:
    """The inverse by Gauss and Jordan in place, without pivoting: a loop short enough for a
    `kernel`."""
    lanes = (1,) * (a.ndim - 2)
    places = np.arange(len(a))

    def body(k: Array, a: Array) -> Array:
        is_pivot = places == k
        across, down = is_pivot.reshape(1, -1, *lanes), is_pivot.reshape(-1, 1, *lanes)
        row = jax.lax.dynamic_index_in_dim(a, k, 0)
        column = jax.lax.dynamic_index_in_dim(a, k, 1)
        pivot = jax.lax.dynamic_index_in_dim(column, k, 0)
        row = jnp.where(across, 1.0, row) / pivot
        a = jnp.where(across, 0.0, a) - jnp.where(down, 0.0, column) * row
        return jnp.where(down, row, a)

    return jax.lax.fori_loop(0, len(a), body, a, unroll=written_out(len(a)))


def written_out(rounds: int) -> int:
    """The number of turns to unroll of a short loop: many on a GPU, one on a CPU, where programs
    stay small."""
    return min(rounds, 16) if loops_are_dear() else 1
