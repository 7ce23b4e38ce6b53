"""Generalised forces of forces along the span on the coordinates of a model."""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._programs.lanes import matvec, pairwise_sum
from jaxbeam._rotor.span import Span
from jaxbeam._rotor.spanwise import points_within
from jaxbeam._types import Coordinates, Matrix, Number, Vector

POINTS = 6  # Gauss points in an element: exact for a cubic times a force of degree eight


class AbstractSpanForce(eqx.Module):
    """The generalised force of a force along the span on coordinates of equations of motion. It is
    linear in its arrays, so that multiples of the force are made by multiplying these."""

    @abc.abstractmethod
    def on(self, equations: Any, q: Coordinates) -> Vector:
        """The generalised force at coordinates q."""

    @abc.abstractmethod
    def tangent(self, equations: Any, q: Coordinates) -> Any:
        """Minus the derivative of the force by q, of the kind of `Equations.mass`; None where that
        is zero."""

    def power(self, equations: Any, q: Coordinates, v: Vector) -> Number:
        """The power of the force along the span, in W."""
        return pairwise_sum(self.on(equations, q) * v)


class SpanForce(AbstractSpanForce):
    """A generalised force that is linear in the coordinates: force - stiffness q."""

    force: Vector
    stiffness: Matrix | None  # None: zero

    def on(self, equations: Any, q: Coordinates) -> Vector:
        return self.force if self.stiffness is None else self.force - matvec(self.stiffness, q)

    def tangent(self, equations: Any, q: Coordinates) -> Matrix | None:
        return self.stiffness


class AbstractSpanIntegral(eqx.Module):
    """A rule of integration for the work of a force along the span."""

    @property
    @abc.abstractmethod
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Places x / L of the rule, and weights."""

    def pace(self, length: Number) -> Any:
        """Derivative of arc length by x / L at the places, () or (p, 1), in m, for a beam of this
        length."""
        return length

    @abc.abstractmethod
    def generalised_force(self, density: Float[Array, "p 3"]) -> AbstractSpanForce:
        """The generalised force of a force per length given at the places, in N/m."""

    def acting(self, q: Coordinates, density: Float[Array, "p 3"]) -> Float[Array, "p 3"]:
        """Force per length in axes of the hub, from a density in the axes in which it is given."""
        return density


class ElementSpanIntegral(AbstractSpanIntegral):
    """A rule of integration over elements, whose displacements are linear in the coordinates."""

    equations: Any
    edges: tuple[float, ...] = eqx.field(static=True)  # nodes and kinks

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        return points_within(self.edges, POINTS)

    def generalised_force(self, density: Float[Array, "p 3"]) -> SpanForce:
        equations = self.equations
        xi, weight = self.points
        rest = jnp.zeros(equations.mass.shape[0], equations.length.dtype)
        _, back = jax.vjp(lambda q: equations.displacement(q, xi), rest)
        (force,) = back(equations.length * weight[:, None] * density)
        return SpanForce(force, None)

    @classmethod
    def of(cls, equations: Any, n_elements: int, kinks: tuple[float, ...]) -> "ElementSpanIntegral":
        """The rule for elements, divided at kinks of the force that are no nodes."""
        nodes = np.linspace(0.0, 1.0, n_elements + 1)
        own = [kink for kink in kinks if np.min(np.abs(nodes - kink)) > 1e-9]
        return cls(equations, tuple(sorted([*nodes.tolist(), *own])))


class FunctionSpanIntegral(AbstractSpanIntegral):
    """A rule of integration for functions f_a, each in one direction. In theories in which
    deflection shortens the beam the force along it also does work on -int_0^x u'^2 / 2."""

    value: Any  # (p, n)
    slope: Any  # (p, n) by x / L
    size: Number
    model: Any = eqx.field(static=True)
    edges: tuple[float, ...] = eqx.field(static=True)

    @property
    def span(self) -> Span:
        """The span of the rule's points of integration."""
        out: Span = self.model.functions_from.rule(self.model.products, self.edges)
        return out

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        return self.span.xi, self.span.weight

    def generalised_force(self, density: Float[Array, "p 3"]) -> SpanForce:
        span, one_hot = self.span, self.model.one_hot
        weight = span.weight
        pull = self.size * (self.value.T @ (weight[:, None] * density))
        force = jnp.sum(pull * one_hot, 1)
        if not self.model.foreshortens:
            return SpanForce(force, None)
        tension = span.beyond(density[:, 0])  # tension over the length of the beam, N/m
        bends = one_hot[:, 1:] @ one_hot[:, 1:].T
        return SpanForce(force, self.slope.T @ ((weight * tension)[:, None] * self.slope) * bends)
