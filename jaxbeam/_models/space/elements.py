"""Elements in absolute nodal coordinates that bend both ways and twist, at a cost linear in their
number.

A node has a displacement u, its slope along the beam, an angle of twist a and the twist k_1 of the
material. All are fields of cubic elements: inertia forces are, as in the plane, the mass matrix of
all nodes, the clamped one too, times the nodal values of

    u'' + a_O + (omega~ omega~ + omega'~) r + 2 omega~ u',   r = X a1 + u,

and, for the twist, the polar inertia times a'' + omega_1' (where k_1 stands for the slope of a,
from which it differs in beams that bend both ways). Where a beam is bent its sections spin about
the tangent at another rate, see `rolls`. As the mass matrix of that depends on coordinates, small
motion about a state has it (`mass_about`), and runs have not. Elastic forces are those of
`_models/space/energies.py`. Sections have no inertia beside that of twist and no propeller moment,
a share (Omega / omega_T)^2 of the stiffness of torsion with the frequency omega_T; and tension T
neither untwists them nor stiffens torsion, by T i^2 / GJ with the polar radius of gyration i.

Coordinates go node by node, values then slopes, so that all matrices are block-tridiagonal with
blocks of eight; at the clamped node two are free, L u_1' and the twist. All are metres: L times an
angle, L^2 times a twist. Any array may have further axes, of lanes, behind those it is said to have
(see `kernel`).
"""

from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.ancf.sections import body_mass
from jaxbeam._models.bases.basis import Functions, hermite
from jaxbeam._models.contract.equations import Undeformed
from jaxbeam._models.contract.span_integrals import AbstractSpanIntegral, ElementSpanIntegral
from jaxbeam._models.space.elasticity import SpatialElasticity
from jaxbeam._models.space.ends import SpatialEnds, in_beam_axes, push, push_tangent
from jaxbeam._models.space.energies import elongation, section_angles
from jaxbeam._models.space.following import FollowingIntegral
from jaxbeam._models.space.frames import A1, carried, rolls
from jaxbeam._models.space.nodes import (
    SpatialNodes,
    assembled,
    components,
    mass_rows,
    mixed_rows,
    of_elements,
)
from jaxbeam._models.space.sections import SpatialSections
from jaxbeam._numerics.blocks import BlockTridiagonal, padded
from jaxbeam._programs.lanes import append_axes, matvec, pairwise_sum, sum_of_products
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.ends import TipBody
from jaxbeam._rotor.loads import TipLoad
from jaxbeam._rotor.motion import Hub, axes, hub_matrices, skew
from jaxbeam._types import Number, Triple, Vector

_MOVED = np.diag([1.0, 1.0, 1.0, 0.0])  # components of displacement, without the twist


class SpatialEquations(SpatialElasticity):
    """Elements in space on a moving hub, with a mass at the tip.

    Inertia and loads; what is elastic is in `_models/space/elasticity.py`.
    """

    mass: BlockTridiagonal
    rigid_moments: Triple
    length: Number
    tip_radius: Number
    energy_scale: Number
    straight: SpatialNodes  # of X a1
    gram: Float[Array, "k 2 3 2 *#lanes"]  # mass matrix of each component of displacement, by rows
    tip_mass: Float[Array, "2 2 *#lanes"]
    tip_polar: Number
    axes: Float[Array, "3 3 *#lanes"] | None  # rows: of the beam in those of the hub
    bears_body: bool = eqx.field(static=True)

    def __init__(self, rotor: Rotor, n_elements: int) -> None:
        length = rotor.beam.length
        self.length, self.tip_radius, self.rigid_moments = (
            length,
            rotor.hub_radius + length,
            rotor.rigid_moments,
        )
        self.ways, self.absent = components(*(spring is not None for spring in rotor.springs))
        self.sections = SpatialSections(rotor, n_elements)
        self.energy_scale = self.sections.bending_stiffness / length
        self.ends = SpatialEnds(rotor, self.sections.axial_stiffness, n_elements)
        none = jnp.zeros_like(length)
        self.axes, root = None, jnp.stack([rotor.hub_radius, none, none])
        if rotor.precone is not None:
            cos, sin, one = jnp.cos(rotor.precone), jnp.sin(rotor.precone), jnp.ones_like(none)
            self.axes = jnp.stack([cos, none, sin, none, one, none, -sin, none, cos]).reshape(3, 3)
            root = self.axes @ root
        along = length * np.linspace(0.0, 1.0, n_elements + 1)
        place = root[None] + along[:, None] * A1[None]
        slope = jnp.broadcast_to(length * A1[None], place.shape)
        self.straight = self._nodal(jnp.stack([place, slope], 1))
        body = rotor.tip_body
        self.bears_body = body.is_body
        if isinstance(body, TipBody):
            self.tip_mass, self.tip_polar = body_mass(body, length), body.axial_inertia / length**2
        else:
            self.tip_mass, self.tip_polar = jnp.pad(body.mass[None, None], ((0, 1), (0, 1))), none
        mass, polar = self.sections.grams()
        self.gram = mass_rows(mass, self.tip_mass)
        polar = mass_rows(polar, jnp.pad(self.tip_polar[None, None], ((0, 1), (0, 1))))
        self.mass = self._matrix(
            mixed_rows(self.gram, _MOVED) + mixed_rows(polar, np.eye(4) - _MOVED)
        )

    @property
    def kernel(self) -> Self:
        return self

    @property
    def undeformed(self) -> Undeformed:
        """The beam that points from the hub along its own axis, where that is not a1, with the
        axial inertia of a body."""
        along = A1 if self.axes is None else self.axes[0]
        about = self.tip_polar * self.length**2 * along[:, None] * along[None]
        if self.axes is None:
            straight = super().undeformed
            return straight._replace(inertia=straight.inertia + about)
        mass, first, second = self.rigid_moments
        radius = self.tip_radius - self.length
        root, first = radius * A1, first - radius * mass
        second = second - radius * (2 * first + radius * mass)
        mixed = root[:, None] * along[None]
        second_moment = mass * root[:, None] * root[None] + first * (mixed + mixed.T)
        second_moment = second_moment + second * along[:, None] * along[None]
        inertia = jnp.trace(second_moment) * np.eye(3) - second_moment + about
        return Undeformed(mass, mass * root + first * along, inertia, root + self.length * along)

    def force(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | TipLoad | None) -> Vector:
        hub = self._hub(hub)
        place, speed = self.straight + self._nodes(q), self._nodes(v)
        centrifugal, coriolis = hub_matrices(hub)
        field = self._by(centrifugal, place) + self._by(coriolis, speed)
        twist = self.length * hub.angular_velocity_rate[:1]
        field = field + self._constant(jnp.concatenate([hub.acceleration, twist]))
        own = self.sections.by_element(
            lambda part, local, field: self._elastic(part, local) + part.weighed(field),
            of_elements(self._nodes(q)), of_elements(field),
        )  # fmt: skip
        at_tip = self._borne(field[-1])
        if self.bears_body:
            at_tip = at_tip + self._spun(hub, self._nodes(q)[-1], speed[-1])
        if tip_force is not None:
            at_tip = at_tip - self._pushed(tip_force, q)
        return -self._gathered(own, at_tip, self._at_ends(self.ends.force, q))

    def tangents(
        self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | TipLoad | None
    ) -> tuple[BlockTridiagonal, BlockTridiagonal]:
        hub = self._hub(hub)
        both = (self._four(matrix) for matrix in hub_matrices(hub))
        k, c = (self._matrix(mixed_rows(self.gram, mixing)) for mixing in both)
        k = k + self.elastic_tangent(q)
        if self.bears_body:
            k, c = (a + self._matrix(b) for a, b in zip((k, c), self._spun_rows(hub), strict=True))
        if isinstance(tip_force, TipLoad):
            k = k + self._matrix(-self._pushed_tangent(tip_force, q))
        return k, c

    def mass_about(self, q: Vector) -> BlockTridiagonal:
        """The mass matrix about a state, of sections that spin about the tangent; `mass` takes the
        rate of the angle of twist for that spin: see the module's docstring."""

        def one(part: Any, local: Array) -> Array:
            rows = rolls(self._strains(local), self.sections.n_elements)
            lanes = rows.ndim - 2
            weighed = sum_of_products(part.polar[:, :, None], rows[None], 1, lanes)
            return self._by_nodes(sum_of_products(rows[:, :, None], weighed[:, None], 0, lanes))

        local = of_elements(self._nodes(q))
        last = rolls(self._strains(local[-1]), self.sections.n_elements)[2]
        at_tip = self._by_nodes(self.tip_polar * last[:, None] * last[None])
        own = self.sections.by_element(one, local) + padded(at_tip[None], len(local) - 1, 0)
        return self._matrix(mixed_rows(self.gram, _MOVED) + assembled(own))

    def span_integral(self, kinks: tuple[float, ...], follows: bool) -> AbstractSpanIntegral:
        kind = FollowingIntegral if follows else ElementSpanIntegral
        return kind.of(self, self.sections.n_elements, kinks)

    def kinetic_energy(self, q: Vector, v: Vector, velocity: Triple, spin: Triple) -> Number:
        """int |a + b|^2 - |a|^2 dm / 2, a = v + omega x X a1 and b = omega x u + u', and for the
        twist j (a' + omega_1)^2 / 2 without what is there when it rests."""
        velocity, spin = self._inward(velocity), self._inward(spin)
        skew_spin = skew(spin)
        own = self._nodes(v) + self._by(skew_spin, self._nodes(q))
        roll = jnp.concatenate([velocity, self.length * spin[:1]])
        carried = self._by(skew_spin, self.straight) + self._constant(roll)
        energy = self._product(own, own / 2 + carried)
        if self.bears_body:
            about = pairwise_sum(spin * self._seen(self._nodes(q)[-1, 1]))
            rest = self._nodes(v)[-1, 0, 3] + self.length * spin[0]
            energy = energy + self.tip_polar * about * (rest + about / 2)
        return energy

    def first_moment(self, q: Vector) -> Triple:
        nodes, units = self._nodes(q), np.eye(4)[:3]
        axes = [
            append_axes(unit, q.ndim - 1) + jnp.zeros((4, *q.shape[1:]), q.dtype) for unit in units
        ]
        fields = [jnp.broadcast_to(self._constant(axis), nodes.shape) for axis in axes]
        return self._outward(jnp.stack([self._product(field, nodes) for field in fields]))

    def _product(self, a: SpatialNodes, b: SpatialNodes) -> Number:
        """int a . b dm of two fields, and polar inertia times their twists."""
        weighed = self.sections.by_element(lambda part, b: part.weighed(b), of_elements(b))
        own = of_elements(a) * weighed
        at_tip = a[-1] * self._borne(b[-1])
        return pairwise_sum(own.reshape(-1, *own.shape[4:])) + pairwise_sum(
            at_tip.reshape(8, *own.shape[4:])
        )

    def tip_power(self, q: Vector, v: Vector, tip_force: Triple | TipLoad) -> Number:
        rates = self._nodes(v)[-1] * self._pushed(tip_force, q)
        return pairwise_sum(rates.reshape(8, *q.shape[1:]))

    def tip_action(self, q: Vector, tip_force: Triple | TipLoad) -> tuple[Triple, Triple]:
        if not isinstance(tip_force, TipLoad):
            return super().tip_action(q, tip_force)
        force, moment = in_beam_axes(self._inside(tip_force), *self._tip_state(q))
        return self._outward(force), self._outward(moment)

    def _pushed(self, tip_force: Triple | TipLoad, q: Vector) -> Float[Array, "2 4 *#lanes"]:
        """The generalised force of a load on the last node."""
        if not isinstance(tip_force, TipLoad):
            pull = jnp.concatenate([self._inward(tip_force), jnp.zeros_like(tip_force[:1])])
            return self._constant(pull)[0]
        own, size = push(self._inside(tip_force), *self._tip_state(q)), self.length
        value = self._ordered(own[:3], own[6] / size)
        return jnp.stack([value, self._ordered(own[3:6] / size, 0 * own[6])])

    def _pushed_tangent(self, load: TipLoad, q: Vector) -> Float[Array, "k 8 24 *#lanes"]:
        """Rows of blocks of the derivative of a load's force by the coordinates."""
        own, size = push_tangent(self._inside(load), *self._tip_state(q)), self.length
        value = jnp.stack([*(own[c] for c in self.ways[:3]), own[6] / size]) / size
        slope = jnp.stack([*(own[3 + c] for c in self.ways[:3]), 0 * own[6]]) / size**2
        by = jnp.concatenate([value, slope]).swapaxes(0, 1)
        none = 0 * by[0]
        by = jnp.stack([none, none, none, by[3], *(by[c] for c in self.ways[:3]), none])
        row = jnp.pad(by.swapaxes(0, 1), ((0, 0), (8, 8), *((0, 0),) * (q.ndim - 1)))
        return padded(row[None], len(self.straight) - 1, 0)

    def _inside(self, load: TipLoad) -> TipLoad:
        """A load in axes of the beam, from one that may be in axes of the hub."""
        if load.follows:
            return load
        return TipLoad(self._inward(load.force), self._inward(load.moment), load.follows)

    def _tip_state(self, q: Vector) -> tuple[Triple, Number]:
        """Displacement gradient and angle of twist at the tip."""
        last = self._nodes(q)[-1] / self.length
        return self._seen(last[1]), last[0, 3]

    def tip(self, q: Vector) -> Triple:
        return self._outward(self._seen(self._nodes(q)[-1, 0]))

    def displacement(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        """Displacement by the cubic in the element where a point is."""
        shapes, local = self._around(q, xi)
        u = self._seen(jnp.sum(shapes.value[0][:, :, None] * local, 1).T)
        return jax.vmap(self._outward, 1)(u)

    def strain(self, q: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        return elongation(self.gradient(q, xi))

    def gradient(self, q: Vector, xi: np.ndarray) -> Float[Array, "3 p"]:
        """Displacement gradient r' - a1 at x = xi L, in axes of the beam."""
        shapes, local = self._around(q, xi)
        return self._seen(jnp.sum(shapes.slope[0][:, :, None] * local, 1).T) / self.length

    def curvature(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 2"]:
        shapes, local = self._around(q, xi)
        bend = self._seen(jnp.sum(shapes.curvature[0][:, :, None] * local, 1).T) / self.length**2
        t = self.gradient(q, xi) + A1[:, None]
        size = jnp.sqrt(pairwise_sum(t * t))
        t = t / size[None]
        rate = (bend - t * pairwise_sum(t * bend)[None]) / size[None]
        return jnp.einsum("kcp,cp->pk", axes(t, self.torsion(q, xi))[1:], rate)

    def direction(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        r = self.gradient(q, xi) + A1[:, None]
        return r.T if self.axes is None else r.T @ self.axes

    def section_axes(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3 3"]:
        r = self.gradient(q, xi) + A1[:, None]
        own = axes(r / jnp.sqrt(pairwise_sum(r * r))[None], self.torsion(q, xi))
        rows = jnp.moveaxis(own, 2, 0)
        return rows if self.axes is None else rows @ self.axes

    def roll(self, q: Vector, v: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        def bent(q: Vector) -> tuple[Array, Array]:
            return self.torsion(q, xi), self.gradient(q, xi)

        (_, d), (rate, moving) = jax.jvp(bent, (q,), (v,))
        return rate + pairwise_sum(carried(d + A1[:, None]) * moving)

    def turning_energy(self, body: TipBody, q: Vector, v: Vector, spin: Triple) -> Number:
        about = pairwise_sum(
            self._inward(spin) * (self._seen(self._nodes(q)[-1, 1]) / self.length + A1)
        )
        rate = self._nodes(v)[-1, 0, 3] / self.length
        own = self.tip_polar * self.length**2 * (rate + about) ** 2 / 2
        return super().turning_energy(body, q, v, spin) + own

    @property
    def pieces(self) -> tuple[float, ...]:
        return tuple(np.linspace(0.0, 1.0, self.sections.n_elements + 1).tolist())

    def torsion(self, q: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        """The angle of torsion at x = xi L, from where the least rotation brings the section."""
        n, (index, s) = self.sections.n_elements, self._place(xi)
        local = jax.vmap(self._strains)(of_elements(self._nodes(q))[index])
        return section_angles(local, s, n)

    def _place(self, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The elements that points are in, and their places there."""
        xi, n = np.asarray(xi, float), self.sections.n_elements
        index = np.clip((xi * n).astype(int), 0, n - 1)
        return index, xi * n - index

    def _around(self, q: Vector, xi: np.ndarray) -> tuple[Functions, Float[Array, "p 4 4"]]:
        """Shapes at points, (1, p, 4), and coordinates of the elements where they are."""
        index, s = self._place(xi)
        shapes = Functions(*(a[None] for a in hermite(s, 1 / self.sections.n_elements)))
        return shapes, of_elements(self._nodes(q))[index].reshape(-1, 4, 4)

    def _borne(self, field: Float[Array, "2 4 *#lanes"]) -> Float[Array, "2 4 *#lanes"]:
        """Mass matrix at the tip times a field there."""
        moved = sum_of_products(self.tip_mass[:, :, None], field[None], 1, field.ndim - 2)
        twist = jnp.stack([self.tip_polar * field[0, 3], 0 * field[0, 3]])
        return jnp.concatenate([moved[:, :3], twist[:, None]], 1)

    def _spun(
        self, hub: Hub, u: Float[Array, "2 4 *#lanes"], rate: Float[Array, "2 4 *#lanes"]
    ) -> Float[Array, "2 4 *#lanes"]:
        """The force of a body at the tip that spins about its axis t at a' + omega.t, but for that
        of a'' + omega_1': j (omega'.u' + omega.t') on the twist, -j (a' + omega.t) omega on the
        slope."""
        spin, push = hub.angular_velocity, hub.angular_velocity_rate
        slope, turns = self._seen(u[1]), self._seen(rate[1])
        about = rate[0, 3] + self.length * spin[0] + pairwise_sum(spin * slope)
        twist = self.tip_polar * (pairwise_sum(push * slope) + pairwise_sum(spin * turns))
        held_back = self._ordered(-self.tip_polar * about * spin, 0 * twist)
        return jnp.stack([self._ordered(0 * spin, twist), held_back])

    def _spun_rows(self, hub: Hub) -> tuple[Array, Array]:
        """Rows of blocks of the derivatives of the spinning body's force by coordinates and
        rates."""
        spin, push = hub.angular_velocity, hub.angular_velocity_rate
        none = jnp.zeros_like(spin[0])
        slope, rate = (
            jnp.concatenate([jnp.zeros_like(a), a])
            for a in (self._ordered(spin, none), self._ordered(push, none))
        )
        twist = append_axes(np.eye(8)[3], spin.ndim - 1)
        stiff = twist[:, None] * rate[None] - slope[:, None] * slope[None]
        drag = twist[:, None] * slope[None] - slope[:, None] * twist[None]

        def at_tip(block: Array) -> Array:
            row = jnp.pad(self.tip_polar * block, ((0, 0), (8, 8), *((0, 0),) * (spin.ndim - 1)))
            return padded(row[None], len(self.straight) - 1, 0)

        return at_tip(stiff), at_tip(drag)

    def _hub(self, hub: Hub) -> Hub:
        """Motion of the hub in axes of the beam."""
        return hub if self.axes is None else Hub(*(self._inward(vector) for vector in hub))

    def _inward(self, vector: Triple) -> Triple:
        """A vector in axes of the beam, from one in axes of the hub."""
        return vector if self.axes is None else matvec(self.axes, vector)

    def _outward(self, vector: Triple) -> Triple:
        """A vector in axes of the hub, from one in axes of the beam."""
        if self.axes is None:
            return vector
        # NaN, of a case that failed, is kept from the derivative by axes that others share.
        there = jnp.where(vector == vector, vector, 0.0)
        return matvec(self.axes.swapaxes(0, 1), there) + (vector - there)

    def _nodal(self, vectors: Float[Array, "k 2 3"]) -> SpatialNodes:
        """Nodal values of vectors in the order a1, a2, a3, without twist."""
        ordered = [vectors[:, :, c] for c in self.ways[:3]]
        return jnp.stack([*ordered, jnp.zeros_like(ordered[0])], 2)

    def _constant(self, field: Float[Array, "4 *#lanes"]) -> Float[Array, "1 2 4 *#lanes"]:
        """Nodal values of a constant field, given in the order a1, a2, a3, twist."""
        value = self._ordered(field[:3], field[3])
        return jnp.stack([value, jnp.zeros_like(value)])[None]

    def _by(self, matrix: Float[Array, "3 3 *#lanes"], nodes: SpatialNodes) -> SpatialNodes:
        """A matrix times the displacements of all nodes."""
        return sum_of_products(self._four(matrix)[None, None], nodes[:, :, None], 3, nodes.ndim - 3)
