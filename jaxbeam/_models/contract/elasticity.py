"""Elastic and viscous forces of beams whose displacements are linear in the coordinates."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._types import Matrix, Scalar, Vector


class Elasticity(eqx.Module):
    """Elastic forces as a function of the coordinates."""

    @abc.abstractmethod
    def energy(self, q: Vector) -> Scalar:
        """Strain energy, J."""

    def force(self, q: Vector) -> Vector:
        """Left-hand side of the equations; the gradient of the energy unless a theory differs."""
        return jax.grad(self.energy)(q)

    def nonconservative_force(self, q: Vector) -> Vector:
        """The force minus the gradient of the energy."""
        return jnp.zeros_like(q)

    def tangent(self, q: Vector) -> Matrix:
        """d force / dq."""
        return jax.jacfwd(self.force)(q)

    @abc.abstractmethod
    def viscous(self, q: Vector, v: Vector) -> Vector:
        """What stresses do that are the stiffness times the rates of strain: see `strained.py`."""

    def viscous_tangents(self, q: Vector, v: Vector) -> tuple[Matrix, Matrix]:
        """Derivatives of this by q and by v."""
        by: tuple[Matrix, Matrix] = jax.jacfwd(self.viscous, (0, 1))(q, v)
        return by

    @abc.abstractmethod
    def strain(self, gradient: Float[Array, "p 3"]) -> Float[Array, " p"]:
        """Axial strain from the displacement gradient du/dx."""


class LinearElasticity(Elasticity):
    """U = q.K q / 2, axial strain u1' (or s')."""

    stiffness: Matrix

    def energy(self, q: Vector) -> Scalar:
        return q @ self.stiffness @ q / 2

    def force(self, q: Vector) -> Vector:
        return self.stiffness @ q

    def tangent(self, q: Vector) -> Matrix:
        return self.stiffness

    def viscous(self, q: Vector, v: Vector) -> Vector:
        return self.stiffness @ v

    def viscous_tangents(self, q: Vector, v: Vector) -> tuple[Matrix, Matrix]:
        return jnp.zeros_like(self.stiffness), self.stiffness

    def strain(self, gradient: Float[Array, "p 3"]) -> Float[Array, " p"]:
        return gradient[:, 0]
