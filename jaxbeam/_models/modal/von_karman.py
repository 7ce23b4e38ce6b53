"""Elastic energy of the von Karman strain, which is quartic in the coordinates."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._models.contract.elasticity import Elasticity
from jaxbeam._models.contract.strained import viscous
from jaxbeam._types import Matrix, Number, Scalar, Vector


class VonKarmanElasticity(Elasticity):
    """U = EA L int strain^2 dx / 2 + q . bending q / 2, strain = u1' + (u2'^2 + u3'^2) / 2."""

    bending: Matrix
    axial_stiffness: Number
    length: Number
    slope: Float[Array, "p n"]
    weight: Float[Array, " p"]  # of a point, over the axial stiffness times that which is there
    one_hot: Float[Array, "n 3"]

    def energy(self, q: Vector) -> Scalar:
        stretch = jnp.sum(self.weight * self.strain(self._gradient(q)) ** 2)
        return self.axial_stiffness * self.length * stretch / 2 + q @ self.bending @ q / 2

    def force(self, q: Vector) -> Vector:
        gradient = self._gradient(q)
        tension = self.axial_stiffness * self.weight * self.strain(gradient)
        along = jnp.concatenate([jnp.ones_like(gradient[:, :1]), gradient[:, 1:]], 1)
        pull = self.slope.T @ (tension[:, None] * along)  # (n, 3): work along each direction
        return jnp.sum(pull * self.one_hot, 1) + self.bending @ q

    def tangent(self, q: Vector) -> Matrix:
        gradient = self._gradient(q)
        along = jnp.concatenate([jnp.ones_like(gradient[:, :1]), gradient[:, 1:]], 1)
        rows = self.slope * (along @ self.one_hot.T)  # d strain / dq, times length
        weight = self.axial_stiffness / self.length * self.weight
        geometric = self.slope.T @ ((weight * self.strain(gradient))[:, None] * self.slope)
        bends = self.one_hot[:, 1:] @ self.one_hot[:, 1:].T
        return rows.T @ (weight[:, None] * rows) + geometric * bends + self.bending

    def viscous(self, q: Vector, v: Vector) -> Vector:
        def strain(q: Vector) -> Array:
            return self.strain(self._gradient(q))

        stiffness = self.axial_stiffness * self.length * self.weight
        return viscous(strain, lambda rate: stiffness * rate, q, v) + self.bending @ v

    def strain(self, gradient: Float[Array, "p 3"]) -> Float[Array, " p"]:
        return gradient[:, 0] + jnp.sum(gradient[:, 1:] ** 2, 1) / 2

    def _gradient(self, q: Vector) -> Float[Array, "p 3"]:
        return self.slope @ (self.one_hot * q[:, None]) / self.length
