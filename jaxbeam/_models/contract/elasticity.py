"""Elastic and viscous forces of beams whose displacements are linear in the coordinates."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._programs.lanes import matvec_once, pairwise_sum
from jaxbeam._types import Matrix, Number, Vector


class Elasticity(eqx.Module):
    """Elastic forces as a function of the coordinates."""

    takes_lanes: ClassVar[bool] = False  # whether it suits `kernel`; each class says so itself

    @abc.abstractmethod
    def energy(self, q: Vector) -> Number:
        """Strain energy, J."""

    @abc.abstractmethod
    def force(self, q: Vector) -> Vector:
        """Left-hand side of the equations; the gradient of the energy unless a theory differs."""

    def nonconservative_force(self, q: Vector) -> Vector:
        """The force minus the gradient of the energy."""
        return jnp.zeros_like(q)

    @abc.abstractmethod
    def tangent(self, q: Vector) -> Matrix:
        """The tangent d force / dq."""

    @abc.abstractmethod
    def viscous(self, q: Vector, v: Vector) -> Vector:
        """The viscous force, of stresses that are the stiffness times the rates of strain: see
        `damping_data.py`."""

    @abc.abstractmethod
    def viscous_tangents(self, q: Vector, v: Vector) -> tuple[Matrix, Matrix]:
        """Derivatives of the viscous force by q and by v."""

    @abc.abstractmethod
    def strain(self, gradient: Float[Array, "p 3"]) -> Float[Array, " p"]:
        """Axial strain from the displacement gradient du/dx."""


class LinearElasticity(Elasticity):
    """Linear elasticity: U = q.K q / 2, axial strain u1' (or s')."""

    takes_lanes: ClassVar[bool] = True

    stiffness: Matrix

    def energy(self, q: Vector) -> Number:
        return pairwise_sum(q * self.force(q)) / 2

    def force(self, q: Vector) -> Vector:
        return matvec_once(self.stiffness, q)

    def tangent(self, q: Vector) -> Matrix:
        return self.stiffness

    def viscous(self, q: Vector, v: Vector) -> Vector:
        return self.force(v)

    def viscous_tangents(self, q: Vector, v: Vector) -> tuple[Matrix, Matrix]:
        return jnp.zeros_like(self.stiffness), self.stiffness

    def strain(self, gradient: Float[Array, "p 3"]) -> Float[Array, " p"]:
        return gradient[:, 0]
