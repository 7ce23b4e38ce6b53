"""Elements of beams whose properties vary along the span; springs and bodies at their ends.

Integrals over an element go part by part, from kink to kink, by Gauss points in each part: so
stations of a table need not be nodes; a part costs as much as an element.

Any array may have axes of lanes behind all others (see `kernel`).
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.ancf.energies import (
    POINTS,
    WEIGHTS,
    Element,
    Rule,
    elongation,
    map_rows,
    rule,
)
from jaxbeam._models.ancf.nodes import assembled
from jaxbeam._models.ancf.strained import Parts, Strained, gradient_of
from jaxbeam._models.bases.basis import hermite
from jaxbeam._programs.lanes import append_axes, sum_of_products, transposed
from jaxbeam._programs.platforms import loops_are_dear
from jaxbeam._results import replaced
from jaxbeam._rotor.beam import Beam, Rotor
from jaxbeam._rotor.ends import TipBody
from jaxbeam._rotor.spanwise import Property, along
from jaxbeam._types import Number

Cuts = tuple[tuple[float, ...], ...]  # for each element the edges of its parts, from 0 to 1


@functools.lru_cache(maxsize=64)
def cuts(edges: tuple[float, ...], n_elements: int) -> Cuts:
    """Edges of the parts into which kinks, `edges` of a beam, cut its elements. Elements with fewer
    parts than others have their longest part halved, until all have the same number."""
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
def rules(parts: Cuts) -> Rule | None:
    """Quadratures of the parts of every element, with first axes of elements and parts; None where
    elements are not cut."""
    if len(parts[0]) == 2:
        return None
    every = [
        _stacked([rule(len(parts), *ends) for ends in itertools.pairwise(part)]) for part in parts
    ]
    return _stacked(every)


def _stacked(quadratures: list[Rule]) -> Rule:
    return Rule(*map(np.stack, zip(*quadratures, strict=True)))


def each_element(function: Callable[..., Array], arguments: tuple[Any, ...]) -> Array:
    """The results of a function for every element, whose arguments have a first axis of elements.

    Where the last argument (E, 2, 4, *lanes) has lanes, elements go one after the other:
    intermediate results stay in the cache, and XLA does not fuse the loops over lanes with later
    operations. On a GPU, where loops are slow, all elements go at once.
    """
    if arguments[-1].ndim > 3 and not loops_are_dear():
        # In reverse mode intermediate results are computed again, not kept.
        result = jax.checkpoint(lambda element: function(*element), prevent_cse=False)
        return jax.lax.map(result, arguments)
    return jax.vmap(function)(*arguments)


def gauss_points(parts: Cuts) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points s from 0 to 1 of each element, and weights over x / L: (E, m, g), m parts."""
    edges = np.asarray(parts)[..., None]
    sizes = np.diff(edges, axis=1)
    return edges[:, :-1] + sizes * POINTS, sizes * WEIGHTS / len(parts)


def at_points(value: Property, xi: Float[np.ndarray, "E m g"]) -> Float[Array, "E m g"]:
    """Values of a property at the points x / L."""
    return along(value, xi.ravel()).reshape(xi.shape)


class Sections(eqx.Module):
    """Mass and law of the elements of a beam. Those of a uniform beam are equal, and kept once.
    Where properties vary, arrays have a first axis of elements, and those of the law a second one
    of parts if elements are cut."""

    mass: Number  # int N N^T dm of each (E, 4, 4, *lanes); of a uniform beam int dm of one
    axial_stiffness: Number  # mean of EA, N
    bending_stiffness: Number  # mean of EI, N m^2
    law: Element
    n_elements: int = eqx.field(static=True)
    parts: Cuts | None = eqx.field(static=True)  # None: a uniform beam

    def __init__(self, beam: Beam, n_elements: int, law: type[Element]) -> None:
        self.n_elements = n = n_elements
        if beam.is_uniform:
            self.parts, self.mass = None, beam.mass / n
            self.axial_stiffness = beam.axial_stiffness
            self.bending_stiffness = beam.in_plane_bending_stiffness
            self.law = law(self.bending_stiffness / (self.axial_stiffness * beam.length**2), n)
            return
        s, weight = gauss_points(cuts(beam.edges, n))
        xi = (np.arange(n)[:, None, None] + s) / n
        shapes = hermite(s.ravel(), 1 / n).value.reshape(*s.shape, 4)
        gram = np.einsum("emg,emgi,emgj->emgij", weight, shapes, shapes)
        mass = at_points(beam.mass_with_points, xi) * beam.length
        self.mass = jnp.sum(gram * mass[..., None, None], (1, 2))
        # Strains are integrated between kinks of stiffness, not of mass: fewer points in each step.
        self.parts = parts = cuts(beam.stiffness_edges, n)
        s, weight = gauss_points(parts)
        xi = (np.arange(n)[:, None, None] + s) / n
        axial, bending = (
            at_points(value, xi)
            for value in (beam.axial_stiffness, beam.in_plane_bending_stiffness)
        )
        self.axial_stiffness = jnp.sum(weight * axial)
        self.bending_stiffness = jnp.sum(weight * bending)
        stretching = axial / self.axial_stiffness
        bending = bending / (self.axial_stiffness * beam.length**2)
        if s.shape[1] == 1:
            stretching, bending = stretching[:, 0], bending[:, 0]
        self.law = law(bending, n, stretching)

    def by_element(self, function: Callable[..., Array], *local: Array) -> Array:
        """The results of a function of law, mass and coordinates (2, 4, *lanes) for every
        element."""
        if self.parts is None:
            return each_element(lambda *local: function(self.law, self.mass, *local), local)
        # The quadrature of parts joins the law here alone, since it has no axes of lanes.
        rule_of_parts = rules(self.parts)
        law: Any = self.law
        if rule_of_parts is not None:
            law = Parts(dataclasses.replace(law, part=rule_of_parts))
        return each_element(function, (law, self.mass, *local))

    def mass_product(self, mass: Array, field: Float[Array, "2 4 *lanes"]) -> Array:
        """The product of an element's int N N^T dm and nodal values of a field, (2, 4, *lanes)."""
        if self.parts is None:
            return mass * map_rows(self._gram, field)
        return sum_of_products(mass[None], field[:, None], 2, field.ndim - 2)

    def inertial(self, matrix: np.ndarray, lanes: int) -> Float[Array, "k 4 12 *lanes"]:
        """The matrix int N (matrix N)^T dm of all elements, in rows of blocks, for a constant
        `matrix` (2, 2) of components."""
        if self.parts is None:
            local = np.einsum("cd,ij->cidj", matrix, self._gram)[None]
            return self.mass * append_axes(assembled(jnp.repeat(local, self.n_elements, 0)), lanes)
        rotated = append_axes(matrix[None, :, None, :, None], lanes)
        return assembled(rotated * self.mass[:, None, :, None])

    @property
    def _gram(self) -> np.ndarray:
        """The integral int N N^T over an element of unit mass, (4, 4)."""
        value = hermite(POINTS, 1 / self.n_elements).value
        return np.einsum("g,gi,gj->ij", WEIGHTS, value, value)


def body_mass(body: TipBody, length: Number) -> Float[Array, "2 2"]:
    """Mass matrix (2, 2) of a body at the tip, by the position r of the tip and L r' there.

    Its centre is at r + c r' and its kinetic energy m_t |d(r + c r')/dt|^2 / 2 + J |dr'/dt|^2 / 2,
    as of a rigid body where r' at the end is a unit vector, which `PlanarEnds` sees to.
    """
    arm = body.mass * body.offset / length
    by_slope = arm * body.offset / length + body.inertia / length**2
    return jnp.stack([body.mass, arm, arm, by_slope]).reshape(2, 2)


class PlanarEnds(Strained):
    """Springs at both ends, with strains of the displacement gradients d = r' - a1 at root and tip
    (2, 2, *lanes), components in the order a2, a1, each by one of these alone, and the energy sum
    k s^2 / 2.

    A spring at the root has the energy k phi^2 / 2, phi the angle of the tangent. Where a body is
    at the tip, the energy 10 n EA L eps^2 / 2, of n elements, keeps r' of the end a unit vector:
    else the force of the body, which acts on its centre at r + c r', would stretch the end the more
    the shorter elements are. An end without strain is an error of first order in the length h of an
    element: of bending frequencies less than the strain there times h / L, of axial ones some
    hundredths of h / L.
    """

    spring: Number | None  # stiffness of the spring at the root, N m / rad; None: clamped
    hold: Number | None  # 10 n EA L, J; None: no body

    def __init__(self, rotor: Rotor, axial_stiffness: Number, n_elements: int) -> None:
        self.spring, _ = rotor.springs
        hold = 10 * n_elements * axial_stiffness * rotor.beam.length
        self.hold = hold if rotor.tip_body.is_body else None

    def damped_by(self, dampers: tuple[Number | None, Number | None]) -> Self:
        """The ends with dampers in the place of springs, and nothing at the tip; their force is
        `viscous` of these ends."""
        return replaced(self, spring=dampers[0], hold=None)

    @property
    def stiffness(self) -> list[Number]:
        """Stiffness of each of the springs that are there."""
        return [k for k in (self.spring, self.hold) if k is not None]

    @property
    def are_plain(self) -> bool:
        """Whether there are no springs."""
        return not self.stiffness

    def strains(self, e: Float[Array, "2 2 *lanes"]) -> list[Number]:
        """The angle at the root and the elongation at the tip, of springs that are there."""
        root, tip = e
        angle = [] if self.spring is None else [jnp.arctan2(root[0], 1 + root[1])]
        return angle if self.hold is None else [*angle, elongation(tip)]

    def stresses(self, strains: list[Number]) -> list[Number]:
        return [k * s for k, s in zip(self.stiffness, strains, strict=True)]

    def energy(self, d: Float[Array, "2 2 *lanes"]) -> Number:
        energy = jnp.zeros_like(d[0, 0])
        for k, s in zip(self.stiffness, self.strains(d), strict=True):
            energy = energy + k * s**2 / 2
        return energy

    def force(self, d: Float[Array, "2 2 *lanes"]) -> Float[Array, "2 2 *lanes"]:
        return gradient_of(self.energy)(d)

    def tangent(self, d: Float[Array, "2 2 *lanes"]) -> Float[Array, "2 2 2 *lanes"]:
        """The tangent d force / dd of each end."""
        return self.derivative(self.force, d)

    def viscous_tangents(self, e: Array, rate: Array) -> tuple[Array, Array]:
        return (
            self.derivative(lambda e: self.viscous(e, rate), e),
            self.derivative(lambda rate: self.viscous(e, rate), rate),
        )

    @transposed(on=False)
    def derivative(
        self, function: Callable[[Array], Array], e: Array
    ) -> Float[Array, "2 2 2 *lanes"]:
        """The derivative of each force by its own gradient; there is none by the other."""
        push, units = jax.linearize(function, e)[1], jnp.eye(e.shape[1], dtype=e.dtype)[:, None]
        along = jnp.broadcast_to(append_axes(units, e.ndim - 2), (e.shape[1], *e.shape))
        return jax.vmap(push, out_axes=2)(along)
