"""Matrices of few rows as `kernel` takes them: products and the inverse without libraries."""

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
    """A matrix with lanes behind its axes, with the operations of `BlockTridiagonal`."""

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
        """The sum of x_i y_i^T, as a matrix of this kind."""
        return SmallMatrix(matmul(x.swapaxes(0, 1), y))

    def dense(self) -> Float[Array, "n n"]:
        """The matrix as an array; not where there are lanes."""
        return self.array

    def inverse(self) -> "SmallInverse":
        """The solver of systems with this matrix; differentiable in both modes."""
        return SmallInverse(self)


class SmallInverse(eqx.Module):
    """Inverse of a `SmallMatrix` A, to be multiplied with vectors (`@`); as `BlockInverse` it is
    for matrices that need no pivoting."""

    matrix: SmallMatrix
    inverse: SmallMatrix

    def __init__(self, matrix: SmallMatrix) -> None:
        self.matrix = matrix
        self.inverse = SmallMatrix(small_inverse(jax.lax.stop_gradient(matrix.array)))

    def __matmul__(self, b: _Vector) -> _Vector:
        own, whole = self.inverse, self.matrix
        x: Array = jax.lax.custom_linear_solve(
            lambda x: whole @ x, b, lambda _, b: own @ b, lambda _, b: b @ own
        )
        return x

    def __rmatmul__(self, b: _Vector) -> _Vector:
        """The product b^T A^-1."""
        own, whole = self.inverse, self.matrix
        x: Array = jax.lax.custom_linear_solve(
            lambda x: x @ whole, b, lambda _, b: b @ own, lambda _, b: own @ b
        )
        return x


@jax.custom_jvp
def inverses(a: Float[Array, "q n n"]) -> Float[Array, "q n n"]:
    """The inverse of each of many matrices that are symmetric and positive definite."""
    size = jnp.sqrt(jnp.diagonal(a, axis1=1, axis2=2))
    units = size[:, :, None] * size[:, None]  # lest rounding of large entries meets small ones
    alike = small_inverse((a / units).transpose(1, 2, 0))
    return alike.transpose(2, 0, 1) / units


@inverses.defjvp
def _inverses_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    out = inverses(*primals)
    return out, -out @ tangents[0] @ out


def small_inverse(a: Float[Array, "b b *lanes"]) -> Float[Array, "b b *lanes"]:
    """The inverse by Gauss and Jordan in place, without pivoting; so short a loop compiles to one
    function."""
    lanes = (1,) * (a.ndim - 2)
    places = np.arange(len(a))

    def body(k: Array, a: Array) -> Array:
        here = places == k
        across, down = here.reshape(1, -1, *lanes), here.reshape(-1, 1, *lanes)
        row = jax.lax.dynamic_index_in_dim(a, k, 0)
        column = jax.lax.dynamic_index_in_dim(a, k, 1)
        pivot = jax.lax.dynamic_index_in_dim(column, k, 0)
        row = jnp.where(across, 1.0, row) / pivot
        a = jnp.where(across, 0.0, a) - jnp.where(down, 0.0, column) * row
        return jnp.where(down, row, a)

    return jax.lax.fori_loop(0, len(a), body, a, unroll=written_out(len(a)))


def written_out(rounds: int) -> int:
    """The number of turns of a short loop that are written out: programs grow with them."""
    return min(rounds, 16) if loops_are_dear() else 1
