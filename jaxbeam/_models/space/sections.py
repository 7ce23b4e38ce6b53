"""Properties of beams in space at the points of integration of elements: see `ancf/sections.py`."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.ancf.sections import Cuts, at_points, cuts, each_element, gauss_points, rules
from jaxbeam._models.bases.basis import hermite
from jaxbeam._models.bases.loads import section_angle
from jaxbeam._models.contract.strained import Parts
from jaxbeam._models.space.energies import GAUSS, SIMPSON, SpatialElement, spatial_rule
from jaxbeam._programs.lanes import sum_of_products
from jaxbeam._programs.platforms import loops_are_dear
from jaxbeam._rotor.beam import Beam, Rotor
from jaxbeam._rotor.span import polar_inertia
from jaxbeam._rotor.spanwise import along
from jaxbeam._types import Number


class SpatialPart(eqx.Module):
    """One element of `SpatialSections`."""

    law: SpatialElement | Parts
    mass: Array  # int N N^T dm (4, 4, *lanes)
    polar: Array  # the same of the polar inertia, over L^2

    def weighed(self, field: Float[Array, "2 2 4 *lanes"]) -> Float[Array, "2 2 4 *lanes"]:
        """Inertia times nodal values of displacement and twist."""
        nodes = field.reshape(4, 4, *field.shape[3:])
        moved = sum_of_products(self.mass[:, :, None], nodes[None, :, :3], 1, field.ndim - 3)
        rotated = sum_of_products(self.polar[:, :, None], nodes[None, :, 3:], 1, field.ndim - 3)
        return jnp.concatenate([moved, rotated], 1).reshape(field.shape)


class SpatialSections(eqx.Module):
    """Properties of a rotor's beam at the points of integration of elements in space."""

    each: SpatialPart  # arrays have a first axis of elements, unless all elements are alike
    axial_stiffness: Number  # mean of EA
    bending_stiffness: Number  # mean of EI in plane
    n_elements: int = eqx.field(static=True)
    parts: Cuts = eqx.field(static=True)  # of all elements, or of one where all are alike
    alike: bool = eqx.field(static=True)

    def __init__(self, rotor: Rotor, n_elements: int) -> None:
        beam, n = rotor.beam, n_elements
        assert beam.torsional_stiffness is not None
        self.n_elements, self.alike = n, beam.is_uniform and rotor.pitch is None
        self.parts = parts = cuts(beam.stiffness_edges, n)[: 1 if self.alike else n]
        s, weight = gauss_points(parts, GAUSS)
        xi = (np.arange(len(parts))[:, None, None] + s) / n
        lag, flap, torsion = (
            at_points(value, xi)
            for value in (
                beam.in_plane_bending_stiffness, beam.flap_bending_stiffness,
                beam.torsional_stiffness,
            )
        )  # fmt: skip
        axial = weight * at_points(beam.axial_stiffness, xi)
        self.axial_stiffness = jnp.sum(axial)
        self.bending_stiffness = jnp.sum(weight * lag)
        over = self.axial_stiffness * beam.length**2
        angle = section_angle(rotor, lambda angle: along(angle, xi.ravel()))
        bending: Any = (lag / over, None, flap / over)
        if angle is not None:
            cos, sin = (f(angle).reshape(xi.shape) for f in (jnp.cos, jnp.sin))
            mixed = (lag - flap) * sin * cos
            bending = lag * cos**2 + flap * sin**2, mixed, flap * cos**2 + lag * sin**2
            bending = tuple(a / over for a in bending)
        stretching = None
        if not self.alike:
            shares = _stretching(s, weight, axial / self.axial_stiffness) * n / SIMPSON[1][None]
            stretching = jnp.repeat(shares[:, None] / s.shape[1], s.shape[1], 1)  # of each part
        law: Any = SpatialElement(bending, torsion / over, n, stretching)
        if len(parts[0]) == 2:
            law = jax.tree.map(lambda a: a[:, 0], law)
        self.each = SpatialPart(law, *_inertia(beam, n, self.alike))
        if self.alike:
            self.each = jax.tree.map(lambda a: a[0], self.each)

    def by_element(self, function: Callable[..., Array], *local: Array) -> Array:
        """The results of a function of a `SpatialPart` and coordinates (2, 2, 4, *lanes) for each
        element."""
        each, rule = self.each, rules(self.parts, spatial_rule)
        if local[0].ndim == 4 and rule is None and not loops_are_dear():
            # Elements are the lanes where there are no others.
            if self.alike:
                each = jax.tree.map(lambda a: a[None], each)
            moved = jax.tree.map(lambda a: jnp.moveaxis(a, 0, -1), (each, *local))
            return jnp.moveaxis(function(*moved), -1, 0)
        if self.alike:
            return each_element(lambda *local: function(each, *local), local, 4)
        if rule is not None:  # attached here, since lanes are behind the axes of `each` only
            each = dataclasses.replace(each, law=Parts(dataclasses.replace(each.law, part=rule)))
        return each_element(function, (each, *local), 4)

    def grams(self) -> tuple[Float[Array, "E 4 4"], Float[Array, "E 4 4"]]:
        """Mass and polar inertia of every element."""
        mass, polar = self.each.mass, self.each.polar
        if self.alike:
            many = self.n_elements, 4, 4
            mass, polar = (jnp.broadcast_to(a[None], many) for a in (mass, polar))
        return mass, polar


def _stretching(s: np.ndarray, weight: np.ndarray, axial: Any) -> Float[Array, "E 3"]:
    """Weights of int EA dx at the points of stretch of an element: int EA N dx, where its share of
    strain energy is as its quadratic N. Where a step of EA makes one of these negative, or next to
    nothing, as much as is needed of int EA H dx, of hats H, which never are."""

    def shared(shapes: np.ndarray, value: Any) -> Any:  # (E, m, g, 3) and (E, m, g) to (E, 3)
        return jnp.sum(value[..., None] * shapes, (1, 2))

    quadratics = np.stack([1 - 3 * s + 2 * s**2, 4 * s - 4 * s**2, 2 * s**2 - s], -1)
    hats = np.maximum(0.0, 1 - 2 * np.abs(s[..., None] - SIMPSON[0]))
    own, safe = shared(quadratics, axial), shared(hats, axial) / shared(hats, weight)
    safe = safe * SIMPSON[1][None]
    safe = safe * (jnp.sum(own, 1) / jnp.sum(safe, 1))[:, None]
    gap = safe - own
    needed = jnp.where(gap > 0, (safe / 4 - own) / jnp.where(gap > 0, gap, 1.0), 0.0)
    return own + jnp.clip(jnp.max(needed, 1, keepdims=True), 0.0, 1.0) * gap


def _inertia(beam: Beam, n_elements: int, alike: bool) -> list[Float[Array, "E 4 4"]]:
    """Mass of elements, and their polar inertia over L^2, by values and slopes of their ends."""
    parts = cuts(beam.edges, n_elements)[: 1 if alike else n_elements]
    s, weight = gauss_points(parts)
    weight = weight * len(parts) / n_elements  # of an element, over x / L
    xi = (np.arange(len(parts))[:, None, None] + s) / n_elements
    shapes = hermite(s.ravel(), 1 / n_elements).value.reshape(*s.shape, 4)
    gram = np.einsum("emg,emgi,emgj->emgij", weight, shapes, shapes)
    mass = at_points(beam.mass_with_points, xi) * beam.length
    polar = polar_inertia(beam, lambda value: at_points(value, xi)) / beam.length
    return [jnp.sum(gram * a[..., None, None], (1, 2)) for a in (mass, polar)]
