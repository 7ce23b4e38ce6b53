"""Elements of beams whose properties vary along the span, and what is at the ends of beams.

Integrals over an element go part by part, from kink to kink, by Gauss points in each of them: a
table of stations that are not nodes is integrated as it is, and costs as much as so many elements.

Any array may have further axes, of lanes, behind those it is said to have (see `kernel`).
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.basis import hermite
from jaxbeam._models.laws import POINTS, WEIGHTS, Element, Rule, elongation
from jaxbeam._models.shapes import section_angle
from jaxbeam._models.space import GAUSS, SIMPSON, SpatialElement, SpatialRule, spatial_rule
from jaxbeam._models.strained import EndSprings, Parts
from jaxbeam._numerics.lanes import contract
from jaxbeam._numerics.platforms import loops_are_dear
from jaxbeam._rotor.beam import Beam, Rotor
from jaxbeam._rotor.spanwise import Property, along
from jaxbeam._types import Number

Cuts = tuple[tuple[float, ...], ...]  # of each element its parts' edges, from 0 to 1
ARule = TypeVar("ARule", Rule, SpatialRule)


@functools.lru_cache(maxsize=64)
def cuts(edges: tuple[float, ...], n_elements: int) -> Cuts:
    """Where elements are cut at the kinks of a beam. All have as many parts: where there are fewer
    kinks the longest part is halved."""
    inside: list[list[float]] = [[0.0, 1.0] for _ in range(n_elements)]
    for kink in edges[1:-1]:
        node = round(kink * n_elements)
        if abs(kink * n_elements - node) > 1e-9:
            i = int(kink * n_elements)
            inside[i].append(kink * n_elements - i)
    most = max(map(len, inside))
    for parts in inside:
        parts.sort()
        while len(parts) < most:
            i = int(np.argmax(np.diff(parts)))
            parts.insert(i + 1, (parts[i] + parts[i + 1]) / 2)
    return tuple(map(tuple, inside))


@functools.lru_cache(maxsize=64)
def rules(parts: Cuts, rule: Callable[..., ARule]) -> ARule | None:
    """Those of the parts of every element, with axes of elements and parts before all others; None
    where elements are not cut."""
    if len(parts[0]) == 2:
        return None
    every = [
        _stacked([rule(len(parts), *ends) for ends in itertools.pairwise(part)]) for part in parts
    ]
    return _stacked(every)


def _stacked(some: list[ARule]) -> ARule:
    return type(some[0])(*map(np.stack, zip(*some, strict=True)))


def each_element(function: Callable[..., Array], of: tuple[Any, ...], axes: int) -> Array:
    """Of every element: where the last of these has more than so many axes, those of lanes, one
    after the other, so that what is needed on the way stays in the cache, and loops over lanes are
    not mixed up with what becomes of the results; but all at once where loops are dear."""
    if of[-1].ndim > axes and not loops_are_dear():
        return jax.lax.map(lambda of: function(*of), of)
    return jax.vmap(function)(*of)


def _points(
    parts: Cuts, rule: tuple[np.ndarray, np.ndarray] = (POINTS, WEIGHTS)
) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points in the coordinate s of each element, and weights over x / L: (E, m, g)."""
    edges = np.asarray(parts)[..., None]
    sizes = np.diff(edges, axis=1)
    return edges[:, :-1] + sizes * rule[0], sizes * rule[1] / len(parts)


def _at(value: Property, xi: Float[np.ndarray, "E m g"]) -> Float[Array, "E m g"]:
    """A property at points."""
    return along(value, xi.ravel()).reshape(xi.shape)


class Sections(eqx.Module):
    """Properties at the points of integration of elements."""

    mass: Float[Array, "E 4 4"]  # int N N^T dm
    axial_stiffness: Number  # mean of EA
    bending_stiffness: Number  # mean of EI
    element: Element  # whose arrays have axes of elements and, if these are cut, of parts

    def __init__(self, beam: Beam, parts: Cuts, element: type[Element]) -> None:
        n, (s, weight) = len(parts), _points(parts)
        xi = (np.arange(n)[:, None, None] + s) / n
        shapes = hermite(s.ravel(), 1 / n).value.reshape(*s.shape, 4)
        gram = np.einsum("emg,emgi,emgj->emgij", weight, shapes, shapes)
        mass = _at(beam.mass_per_length, xi) * beam.length
        self.mass = jnp.sum(gram * mass[..., None, None], (1, 2))
        axial, bending = (
            _at(value, xi) for value in (beam.axial_stiffness, beam.in_plane_bending_stiffness)
        )
        self.axial_stiffness = jnp.sum(weight * axial)
        self.bending_stiffness = jnp.sum(weight * bending)
        stretching = axial / self.axial_stiffness
        bending = bending / (self.axial_stiffness * beam.length**2)
        if s.shape[1] == 1:
            stretching, bending = stretching[:, 0], bending[:, 0]
        self.element = element(bending, n, stretching)


class SpatialPart(eqx.Module):
    """One element of `SpatialSections`."""

    law: SpatialElement | Parts
    mass: Array  # int N N^T dm (4, 4, *lanes)
    polar: Array  # the same of the polar inertia, over L^2

    def weighed(self, field: Float[Array, "2 2 4 *lanes"]) -> Float[Array, "2 2 4 *lanes"]:
        """Inertia times nodal values of displacement and twist."""
        nodes = field.reshape(4, 4, *field.shape[3:])
        moved = contract(self.mass[:, :, None], nodes[None, :, :3], 1, field.ndim - 3)
        turned = contract(self.polar[:, :, None], nodes[None, :, 3:], 1, field.ndim - 3)
        return jnp.concatenate([moved, turned], 1).reshape(field.shape)


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
        self.parts = parts = cuts(beam.edges, n)[: 1 if self.alike else n]
        s, weight = _points(parts, GAUSS)
        xi = (np.arange(len(parts))[:, None, None] + s) / n
        lag, flap, torsion = (
            _at(value, xi)
            for value in (
                beam.in_plane_bending_stiffness, beam.flap_bending_stiffness,
                beam.torsional_stiffness,
            )
        )  # fmt: skip
        axial = weight * _at(beam.axial_stiffness, xi)
        self.axial_stiffness = jnp.sum(axial)
        self.bending_stiffness = jnp.sum(weight * lag)
        over = self.axial_stiffness * beam.length**2
        angle = section_angle(rotor, lambda turn: along(turn, xi.ravel()))
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
        self.each = SpatialPart(law, *_inertia(beam, parts, n))
        if self.alike:
            self.each = jax.tree.map(lambda a: a[0], self.each)

    def by_element(self, function: Callable[..., Array], *local: Array) -> Array:
        """What a function of a `SpatialPart` and coordinates (2, 2, 4, *lanes) makes of each."""
        if self.alike:
            return each_element(lambda *local: function(self.each, *local), local, 4)
        each, rule = self.each, rules(self.parts, spatial_rule)
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
    """What of int EA dx belongs to each point of stretch of an element: int EA N dx, where its
    share of strain energy is as its quadratic N. Where a step of EA makes one of these negative,
    or next to nothing, as much as is needed of int EA H dx, of hats H, which never are."""

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


def body_mass(rotor: Rotor) -> Float[Array, "2 2"] | None:
    """Mass matrix of the tip body that belongs to the position of the tip and to L r' there; None
    for a point.

    Its centre is at r + c r' and its kinetic energy m_t |d(r + c r')/dt|^2 / 2 + J |dr'/dt|^2 / 2,
    which are those of a rigid body as far as r' of the end is a unit vector: see `Ends`.
    """
    if rotor.tip is None:
        return None
    mass, length = rotor.tip_mass, rotor.beam.length
    arm = mass * rotor.tip.offset / length
    own = arm * rotor.tip.offset / length + rotor.tip.inertia / length**2
    return jnp.stack([mass, arm, arm, own]).reshape(2, 2)


class Ends(EndSprings):
    """Elastic energy of what is at the ends, by the displacement gradients d = r' - a1 there, with
    components in the order a2, a1.

    A spring at the root has k phi^2 / 2, phi the angle of the tangent. Where a body is at the tip,
    10 EA L eps^2 / 2 keeps r' of the end a unit vector: else the pull of the body, which acts on
    its centre at r + c r', would stretch the end ever more the shorter the elements are. The beam
    does not know that its end is not strained, which costs of the first order: bending frequencies
    less than the strain there times h / L, h the length of an element; axial ones some hundredths
    of h / L.
    """

    spring: Number | None  # N m / rad
    hold: Number | None  # J

    def __init__(self, rotor: Rotor, axial_stiffness: Number) -> None:
        self.spring, _ = rotor.springs
        self.hold = None
        if rotor.tip is not None:
            self.hold = 10 * axial_stiffness * rotor.beam.length

    @property
    def stiffness(self) -> list[Number]:
        return [k for k in (self.spring, self.hold) if k is not None]

    def strains(self, e: Float[Array, "2 2 *lanes"]) -> list[Number]:
        """The angle at the root and the elongation at the tip."""
        root, tip = e
        angle = [] if self.spring is None else [jnp.arctan2(root[0], 1 + root[1])]
        return angle if self.hold is None else [*angle, elongation(tip)]


def _inertia(beam: Beam, parts: Cuts, n_elements: int) -> list[Float[Array, "E 4 4"]]:
    """Mass of elements, and their polar inertia over L^2, by values and slopes of their ends."""
    s, weight = _points(parts)
    weight = weight * len(parts) / n_elements  # of an element, over x / L
    xi = (np.arange(len(parts))[:, None, None] + s) / n_elements
    shapes = hermite(s.ravel(), 1 / n_elements).value.reshape(*s.shape, 4)
    gram = np.einsum("emg,emgi,emgj->emgij", weight, shapes, shapes)
    mass = _at(beam.mass_per_length, xi) * beam.length
    if beam.polar_inertia is None:
        axial, lag, flap = (
            _at(value, xi)
            for value in (
                beam.axial_stiffness, beam.in_plane_bending_stiffness, beam.flap_bending_stiffness
            )
        )  # fmt: skip
        polar = mass * (lag + flap) / (axial * beam.length**2)
    else:
        polar = _at(beam.polar_inertia, xi) / beam.length
    return [jnp.sum(gram * a[..., None, None], (1, 2)) for a in (mass, polar)]
