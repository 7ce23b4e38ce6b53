"""Motion in time of a rod in a hub that moves anyhow."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._models.contract.equations import Undeformed
from jaxbeam._models.space.rod_elements import (
    Bent,
    bent,
    by_changes,
    geometric,
    nodal,
    on_diagonal,
)
from jaxbeam._models.space.rod_equations import RestingRod
from jaxbeam._models.space.rod_kinematics import Moving
from jaxbeam._models.space.rod_loads import RodSpanForce, Still, acting, along_hub, twisting
from jaxbeam._models.space.rod_motion import inertia_of, inertia_tangents
from jaxbeam._models.space.rod_nodes import slot
from jaxbeam._models.space.rod_supports import dampers_of
from jaxbeam._numerics.linalg import positive_inverse
from jaxbeam._numerics.quaternions import rotation, turned_by
from jaxbeam._programs.lanes import pairwise_sum
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.loads import TipLoad
from jaxbeam._rotor.motion import Hub
from jaxbeam._types import Coordinates, Matrix, Number, Triple, Vector

_FIRST = 12.0  # square of a first frequency, over EI / (m L^3)
_Sixes = Float[Array, "nodes 6"]


class RodEquations(RestingRod):
    """A rod in a hub that moves anyhow: M v' = force(hub, q, v), q' = kinematics(q, v).

    Velocities are those of nodes seen from the hub, in axes that turn with them, those of turns
    times the length; see `rod_motion.py`.
    """

    def __init__(self, rotor: Rotor, degree: int, ends: tuple[float, ...]) -> None:
        super().__init__(rotor, degree, ends)

    def kinematics(self, q: Coordinates, v: Vector) -> Coordinates:
        return self.rod.rates_of(q, self.rod.of_velocities(v))

    def stage_kinematics(self, q: Coordinates, v: Vector, g: Number) -> Moving:
        return Moving.of(self.rod, q, self.rod.of_velocities(v), g)

    def as_velocities(self, q: Coordinates, change: Coordinates) -> Vector:
        state = bent(self.rod.tables, *self.rod.loose_nodes(q))
        return self.rod.velocities_in(state, self.rod.quaternions(q), change)

    def displaced(self, q: Coordinates) -> Vector:
        u, p = self.rod.nodes(q)
        inward = jnp.einsum("nba,nb->na", rotation(p), u)
        return self.rod.to_velocities(jnp.concatenate([inward, 2 * p[:, 1:]], 1))

    def velocity_measure(self) -> Matrix:
        """The matrix M (K + w^2 M)^-1 M over the mass: the square of how far velocities go in
        modes, by their frequencies, w being the least that counts, some first one, in m^2. As they
        are, turns of sections across the beam, of hardly any inertia, and all that a blow rings
        would have steps of their own, up to fifty times as many."""
        rod, mass = self.rod, self.rigid_moments[0]
        tables, (u, p) = rod.tables, rod.nodes(self.rest)
        by = by_changes(tables, bent(tables, u, p))
        elastic = tables.assembled(by.swapaxes(1, 2) @ tables.stiffness @ by)
        for node, end in rod.ends:
            at = slot(node)
            elastic = elastic.at[at, at].add(end.acting(u[node], p[node])[2])
        least = _FIRST * self.energy_scale / (mass * self.length**2)
        held = rod.by_velocities(elastic) + least * self.mass
        return self.mass @ positive_inverse(held) @ self.mass / mass

    def force(self, hub: Hub, q: Coordinates, v: Vector, tip_force: Any) -> Vector:
        rod, (u, p) = self.rod, self.rod.nodes(q)
        tables, (still, rates, gravity) = rod.tables, self._moving(hub, u, p)
        state, own = self._strained(u, p)
        inertia, _ = inertia_of(rod, still, rates, rod.of_velocities(v))
        loads = acting(tables, still, gravity, self.load_in_beam_axes(tip_force), None)
        out = inertia + loads.force - tables.gathered(nodal(tables, state, own))
        for node, end in rod.ends:
            out = out.at[node].add(-end.acting(u[node], p[node])[0])
        return rod.on_velocities(out)

    def tangents(
        self, hub: Hub, q: Coordinates, v: Vector, tip_force: Any
    ) -> tuple[Matrix, Matrix]:
        rod, (u, p) = self.rod, self.rod.nodes(q)
        tables, (still, rates, gravity) = rod.tables, self._moving(hub, u, p)
        state, own = self._strained(u, p)
        by = by_changes(tables, state)
        elements = by.swapaxes(1, 2) @ tables.stiffness @ by + geometric(tables, state, own)
        _, made_of = inertia_of(rod, still, rates, rod.of_velocities(v))
        k, c = inertia_tangents(rod.mass, made_of)
        loads = acting(tables, still, gravity, self.load_in_beam_axes(tip_force), None)
        k = k + tables.assembled(elements) + loads.stiffness
        # Of forces that have a potential this is the symmetric part.
        skew = tables.gathered(nodal(tables, state, own)) - loads.conservative
        for node, end in rod.ends:
            push, held, _ = end.acting(u[node], p[node])
            skew, at = skew.at[node].add(push), slot(node)
            k = k.at[at, at].add(held)
        k = k + on_diagonal(twisting(skew)) / 2
        return rod.by_velocities(k), rod.by_velocities(c)

    def _moving(
        self, hub: Hub, u: Float[Array, "nodes 3"], p: Float[Array, "nodes 4"]
    ) -> tuple[Still, tuple[Triple, Triple], Triple]:
        """Nodes in a hub that moves, the rates of its velocities, and gravity, in axes of the
        beam."""
        velocity, spin, *rates, gravity = (self.axes @ part for part in hub)
        return Still(u, p, rotation(p), velocity, spin), (rates[0], rates[1]), gravity

    def _strained(
        self, u: Float[Array, "nodes 3"], p: Float[Array, "nodes 4"]
    ) -> tuple[Bent, Float[Array, "E p 6"]]:
        """Elements whose nodes are there, and forces in sections at Gauss points."""
        tables = self.rod.tables
        state = bent(tables, u, p)
        strain = state.strain.reshape(tables.elements, -1)
        own = jnp.einsum("eij,ej->ei", tables.stiffness, strain)
        return state, own.reshape(state.strain.shape)

    def on_span(self, q: Coordinates, span: RodSpanForce) -> Vector:
        """A force along the span as one on velocities."""
        return self.rod.on_velocities(self._acting(q, None, span).force)

    def span_tangent(self, q: Coordinates, span: RodSpanForce) -> Matrix:
        """Minus the derivative of `on_span`."""
        loads = self._acting(q, None, span)
        return self.rod.by_velocities(
            loads.stiffness - on_diagonal(twisting(loads.conservative)) / 2
        )

    def _acting(self, q: Coordinates, load: TipLoad | None, span: RodSpanForce | None) -> Any:
        none, (u, p) = jnp.zeros(3, q.dtype), self.rod.nodes(q)
        return acting(self.rod.tables, Still(u, p, rotation(p), none, none), none, load, span)

    def tip_power(self, q: Coordinates, v: Vector, tip_force: Any) -> Number:
        load = self.load_in_beam_axes(tip_force)
        return pairwise_sum(self.rod.of_velocities(v)[-1] * self._acting(q, load, None).force[-1])

    def tip_action(self, q: Coordinates, tip_force: Any) -> tuple[Triple, Triple]:
        load = self.load_in_beam_axes(tip_force)
        assert load is not None
        force, moment = load.force, load.moment
        if load.follows:
            attitude = rotation(self.rod.nodes(q)[1][-1])
            force, moment = attitude @ force, attitude @ moment
        return force @ self.axes, moment @ self.axes

    @property
    def undeformed(self) -> Undeformed:
        tables, axes = self.rod.tables, self.axes
        ways = jax.vmap(lambda way: along_hub(tables.place, way[:3], way[3:]))(jnp.eye(6))
        rigid = ways.reshape(6, -1)
        inertia = rigid @ self.rod.mass @ rigid.T
        first = jnp.stack([inertia[5, 1], inertia[3, 2], inertia[4, 0]])
        tip = tables.place[-1] @ axes
        return Undeformed(inertia[0, 0], first @ axes, axes.T @ inertia[3:, 3:] @ axes, tip)

    def kinetic_energy(self, q: Coordinates, v: Vector, velocity: Triple, spin: Triple) -> Number:
        rod, (u, p) = self.rod, self.rod.nodes(q)
        velocity, spin = self.axes @ velocity, self.axes @ spin
        place = rod.tables.place
        rigid, moving = (along_hub(at, velocity, spin) for at in (place, place + u))
        # In axes that turn: what is seen there less what would be without any turn.
        more = jnp.einsum("nji,nxj->nxi", turned_by(p), moving.reshape(-1, 2, 3)).reshape(-1, 6)
        more = more + along_hub(u, 0 * velocity, spin) * np.repeat([1.0, 0.0], 3)[None]
        more = (rod.of_velocities(v) + more).reshape(-1)
        return more @ (rod.mass @ (rigid.reshape(-1) + more / 2))

    def first_moment(self, q: Coordinates) -> Triple:
        (u, p), weight = self.rod.nodes(q), self.rod.tables.weight
        moved = jnp.einsum("nij,nj->ni", turned_by(p), weight[:, 1:])
        return jnp.sum(weight[:, :1] * u + moved, 0) @ self.axes

    def elastic_force(self, q: Coordinates) -> Vector:
        zero = jnp.zeros(3, q.dtype)
        return -self.force(Hub(*(zero,) * 5), q, jnp.zeros_like(self.mass[0]), None)

    def nonconservative_force(self, q: Coordinates) -> Vector:
        return jnp.zeros_like(self.mass[0])

    def viscous_force(self, q: Coordinates, v: Vector) -> Vector:
        return self._viscous(q, v, None)

    def _viscous(self, q: Coordinates, v: Vector, drag: Drag | None) -> Vector:
        """Viscous forces of sections and springs, whose stress is their stiffness times the rate of
        strain; with a `drag` times its coefficients, and with those of dampers."""
        rod, (u, p), w = self.rod, self.rod.nodes(q), self.rod.of_velocities(v)
        tables, whole = rod.tables, 1.0 if drag is None else drag.stiffness_coefficient
        state = bent(tables, u, p)
        out = tables.gathered(nodal(tables, state, self._viscous_sections(state, w, drag)))
        dampers = (None, None) if drag is None else dampers_of(drag)
        for node, end in rod.ends:
            by, coefficient = end.rates(p[node]), jnp.zeros(6, q.dtype)
            if whole is not None:
                coefficient = coefficient + whole * end.stiffness
            own = dampers[node]
            if own is not None:
                coefficient = coefficient + own
            out = out.at[node].add(by.T @ (coefficient * (by @ w[node])))
        return rod.on_velocities(out)

    def damping(self, q: Coordinates, v: Vector, drag: Drag) -> Vector:
        out = jnp.zeros_like(v)
        if drag.mass_coefficient is not None:
            out = out + drag.mass_coefficient * (self.mass @ v)
        if drag.matrix is not None:
            out = out + drag.matrix @ v
        return out + self._viscous(q, v, drag) if _damps_nodes(drag) else out

    def damping_tangents(self, q: Coordinates, v: Vector, drag: Drag) -> tuple[Matrix, Matrix]:
        k, c = jnp.zeros_like(self.mass), jnp.zeros_like(self.mass)
        if drag.mass_coefficient is not None:
            c = c + drag.mass_coefficient * self.mass
        if drag.matrix is not None:
            c = c + drag.matrix
        if not _damps_nodes(drag):
            return k, c

        def along(change: Vector, v: Vector) -> Vector:
            return self._viscous(q + self.kinematics(q, change), v, drag)

        dk, dc = jax.jacfwd(along, (0, 1))(jnp.zeros_like(v), v)
        return k + dk, c + dc


def _damps_nodes(drag: Drag) -> bool:
    """Whether rates of strains or of ends are damped, which are of single nodes and elements."""
    return drag.is_viscous or any(damper is not None for damper in dampers_of(drag))
