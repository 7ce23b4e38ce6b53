"""Models of a continuous beam whose displacements are linear in the coordinates."""

import abc

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.basis import Basis, Functions
from jaxbeam._models.bases.loads import FunctionCounts
from jaxbeam._models.bases.shapes import COMPONENTS, Shapes, all_functions, sampled
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.equilibrium import Rest
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.contract.small_motion import small_motion
from jaxbeam._models.modal.shape_integrals import (
    ShapeIntegrals,
    linear_stiffness,
    one_hots,
    shape_integrals,
    varying_stiffness,
)
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._status import Status
from jaxbeam._types import Matrix, Scalar


class CartesianModel(AbstractModel[Rotor]):
    """A model with `counts` functions of one basis for axial, in-plane and flap displacement."""

    @property
    @abc.abstractmethod
    def functions_from(self) -> Basis:
        """The basis that all functions of the model come from."""

    @property
    @abc.abstractmethod
    def counts(self) -> FunctionCounts:
        """Number of axial, in-plane and flap coordinates; they come in this order."""

    @property
    def directions(self) -> tuple[Direction, ...]:
        """Directions of the coordinates: axial first, then in plane, then flap."""
        each = zip(COMPONENTS, self.counts, strict=True)
        return tuple(direction for direction, count in each for _ in range(count))

    @property
    def foreshortens(self) -> bool:
        """Whether axial coordinates are arc-length stretch, so that deflection shortens u1."""
        return False

    @property
    def products(self) -> int:
        """The number of functions whose products the points of integration are exact for."""
        return max(self.counts)

    @property
    def one_hot(self) -> Float[np.ndarray, "n 3"]:
        """Rows of the unit matrix: 1 in the column of the direction of each coordinate."""
        return one_hots(self.counts)

    def shapes(self, rotor: Rotor) -> Shapes | None:
        """The functions at points along the beam of a rotor; None for a uniform beam without
        pitch, for which `shape_integrals` are enough."""
        uniform = not rotor.varies and rotor.pitch is None
        return None if uniform else self.sampled(rotor, None)

    def sampled(self, rotor: Rotor, shapes: Shapes | None) -> Shapes:
        """The functions at points along the beam: `shapes`, or where these are None, new ones."""
        if shapes is not None:
            return shapes
        return sampled(self.functions_from, self.counts, self.products, rotor.beam.edges)

    def displacement(self, xi: Float[np.ndarray, " p"], rotor: Rotor) -> Float[Array, "3 p n"]:
        """Displacement to first order: foreshortening is of second order."""
        table = self.functions(self.shapes(rotor), np.asarray(xi, float)).value
        return jnp.einsum("pn,nc->cpn", table, self.one_hot)

    def functions(self, shapes: Shapes | None, xi: np.ndarray) -> Functions:
        """The functions at any x / L, from `shapes` along the beam or, with None, the basis."""
        if shapes is None:
            return all_functions(self.functions_from, self.counts, xi)
        return shapes.places(xi)

    @property
    def shape_integrals(self) -> ShapeIntegrals:
        """Integrals of the functions over a uniform beam, computed once."""
        return shape_integrals(self.functions_from, self.counts)

    def linear_stiffness(self, rotor: Rotor, shapes: Shapes | None) -> Matrix:
        """EA int f' f' dx axially, EI int f'' f'' dx in bending, and springs at the root."""
        if shapes is None:
            return linear_stiffness(self.functions_from, self.counts, rotor)
        return varying_stiffness(shapes, rotor)


def linear_system(model: CartesianModel, rotor: Rotor, speed: Scalar) -> LinearSystem:
    """Matrices of small motion of a linear model: the coefficients of its equations of motion."""
    rest = Rest(jnp.zeros(len(model.directions), speed.dtype), jnp.asarray(Status.OK))
    strain = rotor.steady_strain(speed)
    return small_motion(model, rotor, speed, model.equations(rotor), rest, steady_strain=strain)
