"""Planar cubic elements in absolute nodal coordinates, at a cost linear in their number.

An element has the displacement and slope of its two nodes, across and along the beam. Inertia is
that of any beam on a moving hub (see `cartesian.py`), element by element, with the constant mass
matrix H = int N N^T; elastic forces, which are the same in any frame, are those of
`_models/ancf/energies.py`. Coordinates go node by node, (w, L w', u, L u'), so that all matrices
are block-tridiagonal; of the clamped node only the last is free (B eqs. 18-20): 4 n + 1 coordinates
for n elements, all in metres. Where the root yields L w' of the first node is one more, before L
u'.

Mass and law of elements, one for a uniform beam and one for each element where properties vary, are
those of `sections.py`.

Vectors have their components in the order a2, a1, and any array may have axes of lanes behind all
others (see `kernel`).

B is the paper of `_models/contract/__init__.py`.
"""

from collections.abc import Callable
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.ancf.energies import (
    QUARTER_TURN,
    Element,
    LocalGradients,
)
from jaxbeam._models.ancf.nodes import (
    PlanarNodes,
    assembled,
    constant,
    element_values,
    on_ends,
    quarter_turned,
)
from jaxbeam._models.ancf.sections import PlanarEnds, Sections, body_mass
from jaxbeam._models.ancf.strained import Parts, force_of, gradient_of
from jaxbeam._models.bases.basis import Functions, hermite
from jaxbeam._models.contract.damping_data import Dampers
from jaxbeam._models.contract.equations import Equations
from jaxbeam._models.contract.span_integrals import ElementSpanIntegral
from jaxbeam._numerics.blocks import BlockTridiagonal, padded
from jaxbeam._programs.lanes import append_axes, pairwise_sum, sum_of_products
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.ends import TipBody
from jaxbeam._rotor.motion import Hub
from jaxbeam._types import Number, Triple, Vector

Law = Element | Parts


class ElementEquations(Equations):
    """Elements of any theory on a moving hub, with a mass at the tip.

    Elements can represent any rigid rotation. So the field of accelerations is one of nodal values,
    and inertia forces are the mass matrix of all nodes, the clamped one too, times those of

        q'' + a_O - omega^2 r + (omega' r + 2 omega r' turned by a right angle),   r = X a1 + u.
    """

    mass: BlockTridiagonal
    rigid_moments: Triple
    length: Number
    tip_radius: Number
    energy_scale: Number
    skew_mass: BlockTridiagonal  # M times a turn by a right angle
    straight: PlanarNodes  # nodal values of X a1, the undeformed beam
    tip_mass: Number
    tip_body: Float[Array, "2 2 *lanes"] | None  # mass matrix by r and L r'; None: a point
    sections: Sections
    ends: PlanarEnds
    yields: bool = eqx.field(static=True)  # whether the slope at the root is a coordinate

    def __init__(self, rotor: Rotor, n_elements: int, element: type[Element]) -> None:
        beam = rotor.beam
        radius, length = rotor.hub_radius, beam.length
        self.length, self.tip_radius, self.rigid_moments = (
            length,
            radius + length,
            rotor.rigid_moments,
        )
        body = rotor.tip_body
        self.tip_mass = body.mass
        self.tip_body = body_mass(body, length) if isinstance(body, TipBody) else None
        along = radius + length * append_axes(np.linspace(0.0, 1.0, n_elements + 1), length.ndim)
        along = jnp.stack([along, length + jnp.zeros_like(along)], 1)
        self.straight = jnp.stack([jnp.zeros_like(along), along], 1)
        self.sections = Sections(beam, n_elements, element)
        self.energy_scale = self.sections.bending_stiffness / length
        self.ends = PlanarEnds(rotor, self.axial_stiffness, n_elements)
        self.yields = self.ends.spring is not None
        self.mass, self.skew_mass = self._inertial(np.eye(2)), self._inertial(QUARTER_TURN)

    @property
    def kernel(self) -> Self:
        return self

    @property
    def element(self) -> Element:
        """The law of the elements: one, or where properties vary one with arrays for each."""
        return self.sections.law

    @property
    def axial_stiffness(self) -> Number:
        """The mean of EA, in N."""
        return self.sections.axial_stiffness

    def _inertial(self, matrix: np.ndarray) -> BlockTridiagonal:
        """The mass matrix int N (matrix N)^T dm of elements and tip, for a constant `matrix` (2, 2)
        of components."""
        lanes = self.tip_mass.ndim
        rows = self.sections.inertial(matrix, lanes)
        if self.tip_body is None:
            at_tip = np.zeros((len(self.straight), 4, 12))
            at_tip[-1, ::2, 4:8:2] = matrix
            rows = rows + self.tip_mass * append_axes(at_tip, lanes)
        else:
            rotated = append_axes(matrix[:, None, :, None], lanes)
            rows = rows + self._at_node(-1, rotated * self.tip_body[None, :, None])
        return self._matrix(rows)

    def force(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None) -> Vector:
        spin, rate = hub.angular_velocity[2], hub.angular_velocity_rate[2]
        place = self.straight + self._nodes(q)
        field = quarter_turned(rate * place + 2 * spin * self._nodes(v)) - spin**2 * place
        field = field + constant(hub.acceleration)

        def element_force(law: Law, mass: Array, local: Array, field: Array) -> Array:
            return self._elastic(law, local) + self.sections.mass_product(mass, field)

        forces = self.sections.by_element(
            element_force, element_values(self._nodes(q)), element_values(field)
        )
        at_tip = self._tip_mass_product(field[-1])
        if tip_force is not None:
            at_tip = at_tip - constant(tip_force)[0]
        at_tip = at_tip[:, 0] if self.tip_body is None else at_tip
        return -self._assembled_force(forces, at_tip, self._at_ends(self.ends.force, q))

    def tangents(
        self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None
    ) -> tuple[BlockTridiagonal, BlockTridiagonal]:
        spin, rate = hub.angular_velocity[2], hub.angular_velocity_rate[2]
        k = -(spin**2) * self.mass + rate * self.skew_mass + self.elastic_tangent(q)
        return k, 2 * spin * self.skew_mass

    def span_integral(self, kinks: tuple[float, ...], follows: bool) -> ElementSpanIntegral:
        return ElementSpanIntegral.of(self, self.element.n_elements, kinks)

    def elastic_tangent(self, q: Vector) -> BlockTridiagonal:
        def element_tangent(law: Law, _: Array, local: Array) -> Array:
            return self._by_local(law.tangent(self._gradients(local)))

        tangents = self.sections.by_element(element_tangent, element_values(self._nodes(q)))
        return self._assembled_tangent(tangents, self._at_ends(self.ends.tangent, q))

    def elastic_force(self, q: Vector) -> Vector:
        forces = self.sections.by_element(
            lambda law, _, local: self._elastic(law, local), element_values(self._nodes(q))
        )
        zero = jnp.zeros_like(forces[-1, :, 0])
        return self._assembled_force(forces, zero, self._at_ends(self.ends.force, q))

    def viscous_force(self, q: Vector, v: Vector) -> Vector:
        def element_force(law: Law, _: Array, local: Array, rate: Array) -> Array:
            force = law.viscous(self._gradients(local), self._gradients(rate))
            return on_ends(self.element.n_elements, self.axial_stiffness * force)

        forces = self.sections.by_element(
            element_force, element_values(self._nodes(q)), element_values(self._nodes(v))
        )
        zero = jnp.zeros_like(forces[-1, :, 0])
        return self._assembled_force(forces, zero, self._at_ends(self.ends.viscous, q, v))

    def viscous_tangents(self, q: Vector, v: Vector) -> tuple[BlockTridiagonal, BlockTridiagonal]:
        def element_tangents(law: Law, _: Array, local: Array, rate: Array) -> Array:
            by_e_and_rate = law.viscous_tangents(self._gradients(local), self._gradients(rate))
            return jnp.stack([self._by_local(tangent) for tangent in by_e_and_rate])

        tangents = self.sections.by_element(
            element_tangents, element_values(self._nodes(q)), element_values(self._nodes(v))
        )
        ends = self._at_ends(self.ends.viscous_tangents, q, v) or (None, None)
        by_q, by_v = (self._assembled_tangent(tangents[:, i], ends[i]) for i in (0, 1))
        return by_q, by_v

    def damper_force(self, q: Vector, v: Vector, dampers: Dampers) -> Vector:
        zero, ends = jnp.zeros_like(element_values(self._nodes(q))), self.ends.damped_by(dampers)
        return self._assembled_force(zero, zero[-1, :, 0], self._at_ends(ends.viscous, q, v))

    def damper_tangents(
        self, q: Vector, v: Vector, dampers: Dampers
    ) -> tuple[BlockTridiagonal, BlockTridiagonal]:
        tangents = self._at_ends(self.ends.damped_by(dampers).viscous_tangents, q, v)
        by_q, by_v = (self._assembled_tangent(None, each) for each in tangents)
        return by_q, by_v

    def _by_local(self, tangent: Float[Array, "2 3 2 3 *lanes"]) -> Array:
        """The tangent of an element by its coordinates, (2, 4, 2, 4), from that of its law by
        gradients."""
        n = self.element.n_elements
        tangent = self.axial_stiffness / self.length * tangent
        rows = on_ends(n, tangent).reshape(8, *tangent.shape[2:])
        both = jax.vmap(lambda row: on_ends(n, row))(rows)
        return both.reshape(2, 4, *both.shape[1:])

    def _elastic(self, law: Law, local: Float[Array, "2 4 *lanes"]) -> Array:
        """Elastic force of an element, (2, 4, *lanes)."""
        force = force_of(law, self._gradients(local), self.element.is_conservative)
        force = self.axial_stiffness * force
        return on_ends(self.element.n_elements, force)

    def _tip_mass_product(self, field: Float[Array, "2 2 *lanes"]) -> Float[Array, "2 2 *lanes"]:
        """The mass matrix of the tip times nodal values of a field there; a point mass multiplies
        slopes too, which the caller drops."""
        if self.tip_body is None:
            return self.tip_mass * field
        return sum_of_products(self.tip_body[None], field[:, None], 2, field.ndim - 2)

    def strain_energy(self, q: Vector) -> Number:
        each = self.sections.by_element(
            lambda law, _, local: law.energy(self._gradients(local)), element_values(self._nodes(q))
        )
        energy = pairwise_sum(each)
        energy = self.axial_stiffness * self.length * energy
        return energy if self.ends.are_plain else energy + self._at_ends(self.ends.energy, q)

    def nonconservative_force(self, q: Vector) -> Vector:
        if self.element.is_conservative:
            return jnp.zeros_like(q)
        return self.elastic_force(q) - gradient_of(self.strain_energy)(q)

    def kinetic_energy(self, q: Vector, v: Vector, velocity: Triple, spin: Triple) -> Number:
        """Kinetic energy less that of the rigid beam, int |a + b|^2 - |a|^2 dm / 2, with
        a = v + omega x X a1 and b = omega x u + u'."""
        relative = self._nodes(v) + spin[2] * quarter_turned(self._nodes(q))
        straight_velocity = spin[2] * quarter_turned(self.straight) + constant(velocity)
        return self._product(relative, relative / 2 + straight_velocity)

    def first_moment(self, q: Vector) -> Triple:
        nodes, axes = self._nodes(q), jnp.eye(3, dtype=q.dtype)
        along, across = (
            self._product(
                jnp.broadcast_to(constant(append_axes(axis, q.ndim - 1)), nodes.shape), nodes
            )
            for axis in axes[:2]
        )
        return jnp.stack([along, across, jnp.zeros_like(along)])

    def _product(self, a: PlanarNodes, b: PlanarNodes) -> Number:
        """The integral int a . b dm of two fields, by their nodal values."""
        forces = self.sections.by_element(
            lambda _, mass, field: self.sections.mass_product(mass, field), element_values(b)
        )
        products = element_values(a) * forces
        products = pairwise_sum(products.reshape(-1, *products.shape[3:]))
        if self.tip_body is None:
            return products + self.tip_mass * pairwise_sum(a[-1, :, 0] * b[-1, :, 0])
        at_tip = a[-1] * self._tip_mass_product(b[-1])
        return products + pairwise_sum(at_tip.reshape(4, *at_tip.shape[2:]))

    def tip(self, q: Vector) -> Triple:
        return jnp.stack([q[-2], q[-4], jnp.zeros_like(q[-1])])

    def displacement(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        """Displacement of the points x = `xi` L, by the cubics of the elements that they are in."""
        shapes, local = self._at_points(q, xi)
        across, along = jnp.sum(shapes.value * local, 2)
        return jnp.stack([along, across, jnp.zeros_like(along)], 1)

    def strain(self, q: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        return self.element.strain(self.gradient(q, xi))

    def gradient(self, q: Vector, xi: np.ndarray) -> Float[Array, "2 p"]:
        """Displacement gradient d = r' - a1 at x = xi L."""
        shapes, local = self._at_points(q, xi)
        return jnp.sum(shapes.slope * local, 2) / self.length

    def direction(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        across, along = self.gradient(q, xi)
        return jnp.stack([1 + along, across, jnp.zeros_like(along)], 1)

    def is_unfolded(self, q: Vector) -> Array:
        """Whether the tangent turns by less than a right angle over every half of an element, and
        from the direction of the clamp, if the root does not yield, to the tangent there."""
        xi = np.linspace(0.0, 1.0, 2 * self.element.n_elements + 1)
        tangents = self.direction(q, xi)
        clamp = tangents[:1] if self.yields else np.array([[1.0, 0.0, 0.0]])
        before = jnp.concatenate([clamp, tangents[:-1]])
        return jnp.all(jnp.sum(before * tangents, 1) > 0)

    @property
    def pieces(self) -> tuple[float, ...]:
        return tuple(np.linspace(0.0, 1.0, self.element.n_elements + 1).tolist())

    def curvature(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 2"]:
        shapes, local = self._at_points(q, xi)
        rate, other = jnp.sum(shapes.curvature * local, 2) / self.length**2
        across, along = self.gradient(q, xi)
        along = 1 + along
        bend = (along * rate - across * other) / (along**2 + across**2)
        return jnp.stack([bend, jnp.zeros_like(bend)], 1)

    def _at_points(self, q: Vector, xi: np.ndarray) -> tuple[Functions, Float[Array, "2 p 4"]]:
        """Shape functions at points, (1, p, 4), and nodal values of the elements that these are
        in."""
        xi, n = np.asarray(xi, float), self.element.n_elements
        index = np.clip((xi * n).astype(int), 0, n - 1)
        shapes = Functions(*(a[None] for a in hermite(xi * n - index, 1 / n)))
        return shapes, element_values(self._nodes(q))[index].swapaxes(0, 1)

    def _gradients(self, local: Float[Array, "2 4 *lanes"]) -> LocalGradients:
        """Displacement gradient of an element at its first end, on its chord and at its last end,
        from its nodal values."""
        chord = self.element.n_elements * (local[:, 2:3] - local[:, :1])
        return jnp.concatenate([local[:, 1:2], chord, local[:, 3:]], 1) / self.length

    def _nodes(self, q: Vector) -> PlanarNodes:
        """Nodal values of coordinates, with zeros for those that the root holds."""
        nodes = padded(q, self._absent, 0).reshape(-1, 2, 2, *q.shape[1:])
        return self._reordered(nodes)

    def _at_ends(self, function: Callable[..., Any], *q: Vector) -> Any:
        """The result of a function of the displacement gradients at root and tip, from
        coordinates; None without springs at the ends."""
        if self.ends.are_plain:
            return None
        nodes = map(self._nodes, q)
        return function(*(jnp.stack([n[0, :, 1], n[-1, :, 1]]) / self.length for n in nodes))

    @property
    def _absent(self) -> int:
        return 2 if self.yields else 3

    def _reordered(self, nodes: PlanarNodes) -> PlanarNodes:
        """Values in the order of nodes from that of coordinates, or back. Where the root yields,
        coordinates have both values of the first node before its slopes, so that those that the
        root holds come first."""
        if not self.yields:
            return nodes
        return jnp.concatenate([nodes[:1].swapaxes(1, 2), nodes[1:]])

    def _matrix(self, rows: Float[Array, "k 4 12 *lanes"]) -> BlockTridiagonal:
        """The matrix in the order of coordinates, from rows of blocks in that of nodes."""
        if self.yields:
            blocks = rows.reshape(len(rows), 2, 2, 3, 2, 2, *rows.shape[3:])
            first, second = blocks[0].swapaxes(0, 1), blocks[1]
            diagonal, below = first[:, :, 1:2].swapaxes(3, 4), second[:, :, :1].swapaxes(3, 4)
            first = jnp.concatenate([first[:, :, :1], diagonal, first[:, :, 2:]], 2)
            second = jnp.concatenate([below, second[:, :, 1:]], 2)
            blocks = jnp.concatenate([first[None], second[None], blocks[2:]])
            rows = blocks.reshape(rows.shape)
        return BlockTridiagonal(rows, absent=self._absent)

    def _at_node(self, i: int, block: Float[Array, "2 2 2 2 *lanes"]) -> Array:
        """Rows of blocks (k, 4, 12, *lanes) that are zero but for a diagonal block at the first
        (i = 0) or the last (i = -1) node."""
        lanes, more = block.shape[4:], len(self.straight) - 1
        sides = ((0, 0), (4, 4), *((0, 0),) * len(lanes))
        row = jnp.pad(block.reshape(4, 4, *lanes), sides)[None]
        return padded(row, -i * more, (1 + i) * more)

    def _assembled_tangent(
        self, local: Float[Array, "E 2 4 2 4 *lanes"] | None,
        ends: Float[Array, "2 2 2 *lanes"] | None,
    ) -> BlockTridiagonal:  # fmt: skip
        """Sum of the tangents of elements and of springs at the ends, as one matrix."""
        rows: Any = 0.0 if local is None else assembled(local)
        if ends is not None:
            no_lanes = ((0, 0),) * (ends.ndim - 3)
            for i, slopes in zip((0, -1), ends / self.length**2, strict=True):
                block = jnp.pad(slopes[:, None, :, None], (*((0, 0), (1, 0)) * 2, *no_lanes))
                rows = rows + self._at_node(i, block)
        return self._matrix(rows)

    def _assembled_force(
        self, local: Float[Array, "E 2 4 *lanes"], at_tip: Array,
        ends: Float[Array, "2 2 *lanes"] | None,
    ) -> Vector:  # fmt: skip
        """Sum of forces of elements on their nodes, of a force at the tip (2, *lanes), or with that
        on the slope (2, 2, *lanes), and of springs at the ends, as a vector of coordinates."""
        nodal = padded(local[:, :, :2], 0, 1) + padded(local[:, :, 2:], 1, 0)
        if at_tip.ndim == local.ndim - 2:
            at_tip = jnp.stack([at_tip, jnp.zeros_like(at_tip)], 1)
        nodal = nodal + padded(at_tip[None], len(local), 0)
        if ends is not None:
            slopes = ends / self.length
            slopes = jnp.stack([jnp.zeros_like(slopes), slopes], 2)
            nodal = nodal + padded(slopes[:1], 0, len(local)) + padded(slopes[1:], len(local), 0)
        return self._reordered(nodal).reshape(-1, *local.shape[3:])[self._absent :]
