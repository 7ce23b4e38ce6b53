"""Frames by least rotations: how an element in space is deformed, and what forces on that are to
its nodes. See `_models/space/energies.py`, whose words and local coordinates are used.

A change of the local coordinates turns the frame of the first node by Phi about its own axes,

    Phi_1 = da + c(t).dr' / |r'|,   Phi_2 = -m_3.dr' / |r'|,   Phi_3 = m_2.dr' / |r'|,

m_2 and m_3 being its axes across and c(t) what `carried` says. Seen from it, a vector v changes by
F dv - Phi x v, and the turn to the last node by da_B + c(u).du - Phi.u + n.du, where u is the
tangent there, n what `carried` says in this frame with the sign changed.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.space.points import Points
from jaxbeam._programs.lanes import append_axes, compute_once, pairwise_sum, sum_of_products
from jaxbeam._rotor.motion import axes, cross, skew
from jaxbeam._types import Number, Triple

LocalCoordinates = Float[Array, "13 *lanes"]
Natural = Float[Array, "10 *lanes"]  # see `deformation`
A1 = np.array([1.0, 0.0, 0.0])


class Frames(NamedTuple):
    """The frame of the first node, its rows the axes, and what is seen from it."""

    rows: Float[Array, "3 3 *lanes"]
    first: Triple  # r' of the first node, and of the last one
    last: Triple
    size: Number  # |r'| of the first node, and of the last one
    end_size: Number
    chord: Triple  # the chord in axes of the frame, and r' of the last node
    ahead: Triple
    end: Points  # the last node in axes of the frame
    lean: Triple  # n of the module's docstring


def frames(e: LocalCoordinates, n_elements: int) -> Frames:
    """Frames at both ends of an element."""
    r = stretched(gradients(e))
    first, last, lanes = r[:, 0], r[:, 2], e.ndim - 1
    size = jnp.sqrt(pairwise_sum(first * first))
    rows = compute_once(axes(first / size[None], e[9]))
    chord, ahead = (sum_of_products(rows, v[None], 1, lanes) for v in (r[:, 1], last))
    size, end_size, chord, ahead = compute_once(
        (size, jnp.sqrt(pairwise_sum(last * last)), chord, ahead)
    )
    # L r'' at the last node, from the derivative of the cubic by x / L.
    bend = n_elements * (4 * ahead - 6 * chord)
    bend = jnp.concatenate([bend[:1] + 2 * n_elements * size[None], bend[1:]])
    end = Points.of(ahead, bend)
    lean = end.u2[None] * end.rows[2] - end.u3[None] * end.rows[1]
    return Frames(rows, first, last, size, end_size, chord, ahead, end, compute_once(lean))


def deformation(e: LocalCoordinates, n_elements: int) -> Natural:
    """The deformation of an element without its rigid motion: |r'| of the first node; r' on the
    chord and at the last node in the axes of the first node's frame; and the turn that twists it:
    its rate at the first node, from there to the last, and its rate there."""
    frame = frames(e, n_elements)
    size, end_size = frame.size, frame.end_size
    rotation = e[11] - e[9] - between(frame.first / size[None], frame.last / end_size[None])
    # Angles of nodes count up to whole turns, which beyond -a1 are different ones.
    rotation = rotation - 2 * np.pi * jnp.round(rotation / (2 * np.pi))
    rest = jnp.stack([e[10], rotation, e[12] - frame.end.rise])
    return compute_once(jnp.concatenate([size[None], frame.chord, frame.ahead, rest]))


class _Acting(NamedTuple):
    """Forces (c, k, *lanes), k of them, on vectors seen from a frame, on its turning, and on the
    last three numbers of `deformation`."""

    size: Array
    moment: Array
    chord: Array
    ahead: Array
    rest: Array

    def on_first(self, frame: Frames) -> Array:
        """The force on r' of the first node that turns the frame across, in its axes."""
        across = self.moment[1:] / frame.size[None, None]
        return jnp.concatenate([self.size, across[1:], -across[:1]])

    def by_node(self, frame: Frames) -> Float[Array, "13 k *lanes"]:
        """Forces on r' of the first node in axes of its frame, on its turning about the tangent,
        and on what is left."""
        parts = self.on_first(frame), self.moment[:1], self.chord, self.ahead, self.rest
        return compute_once(jnp.concatenate(parts))


def _acting(frame: Frames, force: Float[Array, "10 k *lanes"], n_elements: int) -> _Acting:
    """The forces that do the work of a force on `deformation`, where the frame turns by Phi."""
    lean, (none, one) = frame.lean, (f(frame.size) for f in (jnp.zeros_like, jnp.ones_like))
    slope = jnp.stack(frame.end.forces(jnp.stack([one, none, none]))[:3])
    slope = sum_of_products(frame.end.rows, slope[:, None], 0, max(lean.ndim - 1, 1))
    slope = compute_once(4 * n_elements * lean - slope)
    chord = force[1:4] - 6 * n_elements * lean[:, None] * force[9:]
    ahead = force[4:7] + lean[:, None] * force[8:9] + slope[:, None] * force[9:]
    chord, ahead = compute_once((chord, ahead))
    moment = cross(chord, _wide(frame.chord[:, None], chord))
    moment = moment + cross(ahead, _wide(frame.ahead[:, None], ahead))
    moment = moment - frame.end.rows[0][:, None] * (frame.end_size[None] * force[8])[None]
    return _Acting(force[:1], moment, chord, ahead, force[7:])


def _on_nodes(frame: Frames, force: Float[Array, "13 k *lanes"]) -> Float[Array, "13 k *lanes"]:
    """Forces on the local coordinates, from those of `_Acting.by_node`."""
    roll, rest = force[3:4], force[10:]
    vectors = jnp.stack([force[:3], force[4:7], force[7:10]], 1)
    moved = sum_of_products(frame.rows[:, :, None, None], vectors[:, None], 0, force.ndim - 1)
    about = [carried(r)[:, None] * by for r, by in ((frame.first, roll), (frame.last, rest[1:2]))]
    moved = moved + jnp.stack([about[0], jnp.zeros_like(about[0]), about[1]], 1)
    return compute_once(jnp.concatenate([moved.reshape(9, *force.shape[1:]), roll, rest]))


def pulled_back(
    frame: Frames, force: Float[Array, "10 k *lanes"], n_elements: int
) -> Float[Array, "13 k *lanes"]:
    """Forces on the local coordinates that do the work of k forces on `deformation`."""
    return _on_nodes(frame, _acting(frame, force, n_elements).by_node(frame))


def pulled_back_tangent(
    frame: Frames, force: Natural, second: Float[Array, "10 10 *lanes"], n_elements: int
) -> Float[Array, "13 13 *lanes"]:
    """The derivative by the local coordinates of what `pulled_back` makes of a force on
    `deformation`, by which the derivatives of that are `second`."""
    lanes, force, none = force.ndim - 1, force[:, None], jnp.zeros_like(frame.size)
    acting = _acting(frame, force, n_elements)
    # How the directions of turn and twist at the last node change.
    own, leans = frame.end.second(jnp.stack([none - 1, none, none]))
    leans = leans.swapaxes(0, 1)
    bends = n_elements * force[9][None] * leans
    aheads = force[8][None] * leans + force[9][None] * own + 4 * (bends + bends.swapaxes(0, 1))
    chords = jnp.concatenate([jnp.zeros_like(bends), -6 * bends.swapaxes(0, 1)])
    more = jnp.concatenate([chords, jnp.concatenate([-6 * bends, aheads])], 1)
    second = compute_once(second + jnp.pad(more, ((1, 3), (1, 3), *((0, 0),) * lanes)))
    # Forces of the frame by `deformation`, and by what `_Acting.by_node` does work on.
    by = _acting(frame, second, n_elements)
    unit, tip = append_axes(np.eye(3), lanes), frame.end.rows[0]
    on_ahead = (
        unit / frame.end_size[None, None] - frame.end_size[None, None] * tip[:, None] * tip[None]
    )
    on_ahead = skew(acting.ahead[:, 0]) - force[8][None] * on_ahead
    by_turning = jnp.concatenate([skew(acting.chord[:, 0]), on_ahead], 1)
    by_turning = jnp.pad(by_turning, ((0, 0), (1, 3), *((0, 0),) * lanes))
    change = compute_once(jnp.concatenate([*by._replace(moment=by.moment + by_turning)]))
    change = _acting(frame, change.swapaxes(0, 1), n_elements).by_node(frame).swapaxes(0, 1)
    by = _Acting(*(change[i:j] for i, j in ((0, 1), (1, 4), (4, 7), (7, 10), (10, 13))))
    # How the frame turns and |r'| changes.
    units = np.eye(13)
    about = append_axes(np.stack([units[3], 0 * units[3], 0 * units[3]]), lanes)
    rotation = append_axes(np.stack([0 * units[3], -units[2], units[1]]), lanes)
    rotation = about + rotation / frame.size[None, None]
    fixed = acting.on_first(frame)
    less = jnp.concatenate([jnp.zeros_like(fixed[:1]), fixed[1:]]) / frame.size[None, None]
    first = by.on_first(frame) + cross(rotation, _wide(fixed, rotation))
    first = first - less * append_axes(units[:1], lanes)
    chord = by.chord + cross(rotation, _wide(acting.chord, rotation))
    ahead = by.ahead + cross(rotation, _wide(acting.ahead, rotation))
    out = compute_once(jnp.concatenate([first, by.moment[:1], chord, ahead, by.rest]))
    for _ in range(2):
        out = _on_nodes(frame, out).swapaxes(0, 1)
    # How what turns the sections at both nodes about the tangent changes.
    first, last = _carried_by(frame.first), _carried_by(frame.last)
    first, last = acting.moment[0][None] * first, force[8][None] * last
    rolls = jnp.stack([first, jnp.zeros_like(first), last], 1)
    rolls = rolls[:, :, :, None] * append_axes(np.eye(3)[None, :, None], lanes)
    return out + jnp.pad(
        rolls.reshape(9, 9, *force.shape[2:]), ((0, 4), (0, 4), *((0, 0),) * lanes)
    )


def _wide(v: Array, many: Array) -> Array:
    return jnp.broadcast_to(v, many.shape)


def carried(r: Triple) -> Triple:
    """How a change of r' turns the section about the tangent if the least rotation from a1 brings
    it there: (0, r_3, -r_2) / (|r'| (|r'| + r_1))."""
    size, share = _sizes(r)
    return jnp.stack([jnp.zeros_like(size), r[2], -r[1]]) * (share / size)[None]


def rolls(e: LocalCoordinates, n_elements: int) -> Float[Array, "4 13 *lanes"]:
    """How changes of the local coordinates turn the section about the tangent, at the first node
    and at the last one: by da + c(r').dr', which goes along the beam, times L, with

        L dk_1 + t.(dr' x L r'') / |r'|^2.

    Rows are that angle and its slope at the first node, and both at the last node.
    """
    first, chord, last = stretched(gradients(e)).swapaxes(0, 1)
    bends = 6 * chord - 4 * first - 2 * last, 2 * first - 6 * chord + 4 * last
    rows: list[Array] = []
    for node, (r, bend) in enumerate(zip((first, last), bends, strict=True)):
        size = jnp.sqrt(pairwise_sum(r * r))
        for way, by in enumerate((carried(r), n_elements * cross(bend, r) / size[None] ** 3)):
            by_gradients = jnp.zeros((3, 3, *e.shape[1:]), e.dtype).at[:, 2 * node].set(by)
            unit = np.eye(4)[2 * node + way]
            by_angles = jnp.broadcast_to(append_axes(unit, e.ndim - 1), (4, *e.shape[1:]))
            rows.append(jnp.concatenate([by_gradients.reshape(9, *e.shape[1:]), by_angles]))
    return jnp.stack(rows)


def _sizes(r: Triple) -> tuple[Number, Number]:
    """The lengths |r'| and 1 / (|r'| + r_1), without cancellation."""
    size, ahead = jnp.sqrt(pairwise_sum(r * r)), r[0] > 0
    across = r[1] * r[1] + r[2] * r[2]
    top = jnp.where(ahead, 1.0, size - r[0])
    return size, top / jnp.where(ahead, size + r[0], across)


def _carried_by(r: Triple) -> Float[Array, "3 3 *lanes"]:
    """The derivative of `carried`."""
    size, share = _sizes(r)
    t, g = r / size[None], share / size
    none = jnp.zeros_like(g)
    lower = t * (1 / size + share)[None]
    lower = -g[None] * jnp.stack([lower[0] + share, lower[1], lower[2]])
    spin = jnp.stack([none, none, none, none, none, g, none, -g, none]).reshape(3, *lower.shape)
    return spin + jnp.stack([none, r[2], -r[1]])[:, None] * lower[None]


def between(t: Triple, u: Triple) -> Number:
    """Area of the triangle of a1, t and u on the unit sphere, with the sign of a1.(t x u)."""
    up = t[1] * u[2] - t[2] * u[1]
    return 2 * jnp.arctan2(up, 1 + t[0] + u[0] + pairwise_sum(t * u))


def gradients(e: LocalCoordinates) -> Float[Array, "3 3 *lanes"]:
    """Gradients of r - x a1, by components, at the first node, on the chord, at the last node."""
    return e[:9].reshape(3, 3, *e.shape[1:])


def stretched(d: Float[Array, "3 k *lanes"]) -> Array:
    """The gradient r' from that of displacements, d + a1."""
    return d + append_axes(A1[:, None], d.ndim - 2)
