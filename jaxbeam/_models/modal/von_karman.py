"""Elastic energy of the von Karman strain, which is quartic in the coordinates."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._models.contract.elasticity import Elasticity
from jaxbeam._programs.lanes import matmul, matvec_once, pairwise_sum
from jaxbeam._types import Matrix, Number, Vector


class VonKarmanElasticity(Elasticity):
    """U = EA L int strain^2 dx / 2 + q . bending q / 2, strain = u1' + (u2'^2 + u3'^2) / 2."""

    takes_lanes: ClassVar[bool] = True
    bending: Matrix
    axial_stiffness: Number
    length: Number
    slope: Float[Array, "p n *#lanes"]
    # Weight of each point of integration times EA there over `axial_stiffness`.
    weight: Float[Array, "p *#lanes"]
    one_hot: Float[Array, "n 3 *#lanes"]

    def energy(self, q: Vector) -> Number:
        stretch = pairwise_sum(self.weight * self.strain(self._gradient(q)) ** 2)
        bent = pairwise_sum(q * matvec_once(self.bending, q))
        return self.axial_stiffness * self.length * stretch / 2 + bent / 2

    def force(self, q: Vector) -> Vector:
        gradient = self._gradient(q)
        return self._axial_force(gradient, self.strain(gradient)) + matvec_once(self.bending, q)

    def tangent(self, q: Vector) -> Matrix:
        gradient = self._gradient(q)
        rows = self._rows(gradient)
        return self._product(rows, rows) + self._geometric(self.strain(gradient)) + self.bending

    def viscous(self, q: Vector, v: Vector) -> Vector:
        gradient = self._gradient(q)
        return self._axial_force(gradient, self._rate(gradient, v)) + matvec_once(self.bending, v)

    def viscous_tangents(self, q: Vector, v: Vector) -> tuple[Matrix, Matrix]:
        gradient, rates = self._gradient(q), self._gradient(v)
        rows, row_rates = self._rows(gradient), self._rows(rates) - self._rows(0 * rates)
        by_q = self._product(rows, row_rates) + self._geometric(self._rate(gradient, v))
        return by_q, self._product(rows, rows) + self.bending

    def strain(self, gradient: Float[Array, "p 3 *#lanes"]) -> Float[Array, "p *#lanes"]:
        return gradient[:, 0] + (gradient[:, 1] ** 2 + gradient[:, 2] ** 2) / 2

    def _gradient(self, q: Vector) -> Float[Array, "p 3 *#lanes"]:
        return matmul(self.slope, self.one_hot * q[:, None]) / self.length

    def _rows(self, gradient: Float[Array, "p 3 *#lanes"]) -> Float[Array, "p n *#lanes"]:
        """Rows (p, n) of d strain / dq at the points, times length."""
        along = jnp.concatenate([jnp.ones_like(gradient[:, :1]), gradient[:, 1:]], 1)
        return self.slope * matmul(along, self.one_hot.swapaxes(0, 1))

    def _rate(self, gradient: Float[Array, "p 3 *#lanes"], v: Vector) -> Float[Array, "p *#lanes"]:
        """The rate of the strain at the points, (p,)."""
        return matvec_once(self._rows(gradient), v) / self.length

    def _axial_force(
        self, gradient: Float[Array, "p 3 *#lanes"], strain: Float[Array, "p *#lanes"]
    ) -> Vector:
        """The generalised force (n,) of the axial force EA strain at the points."""
        rows = self._rows(gradient).swapaxes(0, 1)
        return matvec_once(rows, self.axial_stiffness * self.weight * strain)

    def _product(
        self, rows: Float[Array, "p n *#lanes"], others: Float[Array, "p n *#lanes"]
    ) -> Matrix:
        weight = self.axial_stiffness / self.length * self.weight
        return matmul(rows.swapaxes(0, 1), weight[:, None] * others)

    def _geometric(self, strain: Float[Array, "p *#lanes"]) -> Matrix:
        """The geometric stiffness of a strain, by the derivative of `_rows` by q."""
        bending = self.one_hot[:, 1:]
        same_direction = matmul(bending, bending.swapaxes(0, 1))
        return self._product(self.slope, strain[:, None] * self.slope) * same_direction
