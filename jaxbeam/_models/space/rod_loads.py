"""What acts on the nodes of a rod beside its elements and supports: inertia, gravity, loads."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.contract.span_integrals import AbstractSpanForce, AbstractSpanIntegral
from jaxbeam._models.space.rod_elements import on_diagonal
from jaxbeam._models.space.rod_tables import RodTables
from jaxbeam._numerics.quaternions import cross, crossing, rotation
from jaxbeam._rotor.loads import TipLoad
from jaxbeam._rotor.spanwise import points_within
from jaxbeam._types import Number, Triple, Vector

_POINTS = 8  # of each piece, at which forces along the span are looked at
_Sixes = Float[Array, "nodes 6"]
_Matrix = Float[Array, "N N"]


class Still(NamedTuple):
    """Nodes that rest in a hub, and how it moves, in axes of the beam."""

    u: Float[Array, "nodes 3"]
    p: Float[Array, "nodes 4"]
    attitude: Float[Array, "nodes 3 3"]  # rotations of the nodes
    velocity: Triple
    spin: Triple


def velocities(tables: RodTables, still: Still) -> _Sixes:
    """Velocities of nodes and their angular velocities, in axes that turn with them."""
    moving = along_hub(tables.place + still.u, still.velocity, still.spin)
    return jnp.concatenate([_inward(still.attitude, moving[:, i : i + 3]) for i in (0, 3)], 1)


def along_hub(place: Float[Array, "nodes 3"], velocity: Triple, spin: Triple) -> _Sixes:
    """Velocities and angular velocities, in axes of the beam, of places that rest in a moving
    hub."""
    spun = jnp.broadcast_to(spin, place.shape)
    return jnp.concatenate([velocity[None] + cross(spun, place), spun], 1)


def _inward(
    attitude: Float[Array, "nodes 3 3"], vectors: Float[Array, "nodes 3"]
) -> Float[Array, "nodes 3"]:
    return jnp.einsum("nji,nj->ni", attitude, vectors)


def carried(v: _Sixes) -> Float[Array, "nodes 6 6"]:
    """The matrices [[w~, v~], [0, w~]] of velocities (v, w), by which these carry small changes
    along."""
    moving, spun = crossing(v[:, :3]), crossing(v[:, 3:])
    upper = jnp.concatenate([spun, moving], 2)
    return jnp.concatenate([upper, jnp.concatenate([0 * spun, spun], 2)], 1)


def twisting(p: _Sixes) -> Float[Array, "nodes 6 6"]:
    """The skew matrices [[0, p~], [p~, h~]] of momenta or forces (p, h): the product with
    velocities is that of `carried` transposed with (p, h)."""
    first, second = crossing(p[:, :3]), crossing(p[:, 3:])
    upper = jnp.concatenate([0 * first, first], 2)
    return jnp.concatenate([upper, jnp.concatenate([first, second], 2)], 1)


class Carried(NamedTuple):
    """The effect of steady rotation: forces of inertia, and matrices of small motion."""

    force: _Sixes  # A^T M v
    gyroscopic: _Matrix  # M A - A^T M - J
    stiffness: _Matrix  # the symmetric part of -A^T M A - J A


def carried_along(mass: _Matrix, v: _Sixes) -> Carried:
    """Forces and matrices of steady rotation on nodes with these velocities, by T = v.M v / 2 with
    M that is constant."""
    n = len(v)
    a, p = carried(v), (mass @ v.reshape(-1)).reshape(n, 6)

    def carried_by(matrix: _Matrix) -> _Matrix:  # A^T of it
        return (a.swapaxes(1, 2) @ matrix.reshape(n, 6, -1)).reshape(6 * n, 6 * n)

    by_a = carried_by(mass).T
    both = carried_by(by_a)
    j = twisting(p)
    gyro = by_a - by_a.T - on_diagonal(j)
    stiff = -both - on_diagonal(j @ a)
    return Carried(jnp.einsum("nji,nj->ni", a, p), gyro, (stiff + stiff.T) / 2)


class NodeForces(NamedTuple):
    """Forces on nodes in their own axes, and minus their derivatives by changes of nodes: of those
    that have a potential the symmetric part, of others the whole."""

    force: _Sixes
    conservative: _Sixes  # what of it has a potential
    stiffness: _Matrix


def acting(
    tables: RodTables, still: Still, gravity: Triple, load: TipLoad | None,
    span: "RodSpanForce | None",
) -> NodeForces:  # fmt: skip
    """Forces of gravity, of a load at the tip and along the span, in axes of the beam."""
    attitude, n = still.attitude, len(still.u)
    none = jnp.zeros((n, 3), still.u.dtype)
    dead = tables.weight[:, :1] * gravity[None]
    if load is not None and not load.follows:
        dead = dead.at[-1].add(load.force)
    if span is not None and span.dead is not None:
        dead = dead + span.dead
    down = _inward(attitude, jnp.broadcast_to(gravity, (n, 3)))
    first = tables.weight[:, 1:]
    pushed = _inward(attitude, dead)
    held = jnp.concatenate([pushed, cross(first, down)], 1)
    by_turn = jnp.concatenate([crossing(pushed), crossing(first) @ crossing(down)], 1)
    block = jnp.concatenate([jnp.zeros((n, 6, 3), down.dtype), by_turn], 2)
    block = (block + block.swapaxes(1, 2)) / 2
    free = jnp.zeros_like(held)
    if load is not None and load.follows:
        free = free.at[-1].add(jnp.concatenate([load.force, load.moment]))
    elif load is not None:
        moment = attitude[-1].T @ load.moment
        free = free.at[-1, 3:].add(moment)
        block = block.at[-1, 3:, 3:].add(crossing(moment))
    stiffness = -on_diagonal(block)
    if span is not None and span.following is not None:
        along = jnp.einsum("jab,ijb->ija", attitude, span.following)
        own = _inward(attitude, jnp.sum(along, 1))
        free = free + jnp.concatenate([own, none], 1)
        by = jnp.einsum("iba,jbc,ijcd->iajd", attitude, attitude, crossing(span.following))
        by = jnp.pad(by, ((0, 0), (0, 3), (0, 0), (3, 0))).reshape(6 * n, 6 * n)
        diagonal = jnp.pad(crossing(own), ((0, 0), (0, 3), (3, 0)))
        stiffness = stiffness + by - on_diagonal(diagonal)
    return NodeForces(held + free, held, stiffness)


class RodSpanForce(AbstractSpanForce):
    """Forces along the span by node, in axes of the beam: of those in axes of the hub int N_i f ds,
    of those that turn with the sections int N_i N_j f ds, since R f is sum N_j R_j f there."""

    dead: Float[Array, "nodes 3"] | None
    following: Float[Array, "nodes nodes 3"] | None

    def on(self, equations: Any, q: Vector) -> Vector:
        out: Vector = equations.on_span(q, self)
        return out

    def tangent(self, equations: Any, q: Vector) -> Any:
        return equations.span_tangent(q, self)


class RodSpanIntegral(AbstractSpanIntegral):
    """Forces along the span of a rod, by Gauss points in pieces of elements."""

    rod: Any
    paces: Any  # a function of places: arc length by the share of it, m
    axes: Float[Array, "3 3"]  # of the beam, as rows, in those of the hub
    edges: tuple[float, ...] = eqx.field(static=True)
    follows: bool = eqx.field(static=True)

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        return points_within(self.edges, _POINTS)

    def pace(self, length: Number) -> Float[Array, "p 1"]:
        pace: Any = self.paces(self.points[0])[:, None]
        return pace

    def generalised_force(self, density: Float[Array, "p 3"]) -> RodSpanForce:
        places, weight = self.points
        rows, _ = self.rod.tables.interpolating(places)
        force = (self.paces(places) * weight)[:, None] * density
        if self.follows:
            pairs = jnp.einsum("pi,pj,pc->ijc", rows, rows, force)
            return RodSpanForce(None, pairs)
        return RodSpanForce(rows.T @ force @ self.axes.T, None)

    def acting(self, q: Vector, density: Float[Array, "p 3"]) -> Float[Array, "p 3"]:
        if not self.follows:
            return density
        rows, _ = self.rod.tables.interpolating(self.points[0])
        attitude = rotation(self.rod.nodes(q)[1])
        return jnp.einsum("pi,iab,pb->pa", rows, attitude, density) @ self.axes
