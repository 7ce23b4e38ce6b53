"""Frames by least rotations: how an element in space is deformed, and what forces on that are to
its nodes. See `_models/space/energies.py`, whose words and local coordinates are used.

A change of the local coordinates turns the frame of the first node by Phi about its own axes,

    Phi_1 = da + c(t).dr' / |r'|,   Phi_2 = -m_3.dr' / |r'|,   Phi_3 = m_2.dr' / |r'|,

m_2 and m_3 being its axes across and c(t) what `carried` says. Seen from it, a vector v changes by
F dv - Phi x v, and the turn to the last node by da_B + c(u).du - Phi.u + n.du, where u is the
tangent there, n what `carried` says in this frame with the sign changed.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._programs.lanes import beside, contract, total, transposed
from jaxbeam._rotor.motion import cross
from jaxbeam._types import Number, Triple

Local = Float[Array, "13 *lanes"]
Natural = Float[Array, "10 *lanes"]  # see `deformation`
A1 = np.array([1.0, 0.0, 0.0])


class Seen(NamedTuple):
    """What is seen from the frame of the first node: |r'| there, the chord, r' of the last node."""

    size: Number
    chord: Triple
    ahead: Triple


class Frames(NamedTuple):
    """The frame of the first node, its rows the axes, and what is seen from it."""

    rows: Float[Array, "3 3 *lanes"]
    first: Triple  # r' of the first node, and of the last one
    last: Triple
    seen: Seen


def frames(e: Local) -> Frames:
    """Frames at both ends of an element."""
    r = stretched(gradients(e))
    first, last, lanes = r[:, 0], r[:, 2], e.ndim - 1
    size = jnp.sqrt(total(first * first))
    rows = axes(first / size[None], e[9])
    chord, ahead = (contract(rows, v[None], 1, lanes) for v in (r[:, 1], last))
    return Frames(rows, first, last, Seen(size, chord, ahead))


def deformation(e: Local, n_elements: int) -> Natural:
    """What is left of an element when it is not moved rigidly: |r'| of the first node; r' on the
    chord and at the last node in the axes of the first node's frame; and the turn that twists it:
    its rate at the first node, from there to the last, and its rate there."""
    frame = frames(e)
    (size, chord, ahead), end = frame.seen, jnp.sqrt(total(frame.last * frame.last))
    _, y, z = bent = _bend(frame.seen, n_elements)
    along = total(ahead * bent) / end**2
    y, z = (y - ahead[1] * along) / end, (z - ahead[2] * along) / end
    rise = (ahead[2] * y - ahead[1] * z) / (end + ahead[0])
    rotation = e[11] - e[9] - between(frame.first / size[None], frame.last / end[None])
    # Angles of nodes count up to whole turns, which beyond -a1 are different ones.
    rotation = rotation - 2 * np.pi * jnp.round(rotation / (2 * np.pi))
    rest = jnp.stack([e[10], rotation, e[12] - rise])
    return jnp.concatenate([size[None], chord, ahead, rest])


def _bend(seen: Seen, n_elements: int) -> Triple:
    """L r'' at the last node, from the derivative of the cubic by x / L."""
    bend = n_elements * (4 * seen.ahead - 6 * seen.chord)
    none = jnp.zeros_like(seen.size)
    return bend + n_elements * jnp.stack([2 * seen.size, none, none])


class _Acting(NamedTuple):
    """Forces (c, k, *lanes), k of them, on what is seen and on the turning of the frame."""

    size: Array
    moment: Array
    chord: Array
    ahead: Array


def _seen_forces(seen: Seen, force: Float[Array, "10 k *lanes"], n_elements: int) -> _Acting:
    """What does the work of a force on `deformation`, where the frame turns by Phi."""
    end = jnp.sqrt(total(seen.ahead * seen.ahead))
    tip = seen.ahead / end[None]
    bend = _bend(seen, n_elements)
    along = total(tip * bend)
    s = (bend - tip * along[None]) / end[None]
    share = 1 / (1 + tip[0])
    none = jnp.zeros_like(share)
    lean = jnp.stack([none, -tip[2], tip[1]]) * share[None]  # n of the module's docstring
    rise = (tip[2] * s[1] - tip[1] * s[2]) * share
    # From the twist at the last node, by t and t' there, and from the turn between the nodes.
    by_s = lean[:, None] * force[9:]
    by_t = (jnp.stack([rise, s[2], -s[1]]) * share[None])[:, None] * force[9:]
    by_t = by_t + lean[:, None] * force[8:9] - (along / end)[None, None] * by_s
    out = total(tip[:, None] * by_t) + total(s[:, None] * by_s)
    by_ahead = (by_t - tip[:, None] * out[None]) / end[None, None]
    by_bend = by_s * (n_elements / end)[None, None]
    chord = force[1:4] - 6 * by_bend
    ahead = force[4:7] + by_ahead + 4 * by_bend
    moment = cross(chord, _beside(seen.chord, chord)) + cross(ahead, _beside(seen.ahead, ahead))
    moment = moment - tip[:, None] * force[8:9]
    return _Acting(force[:1] + 2 * by_bend[:1], moment, chord, ahead)


def _on_nodes(
    frame: Frames, first: Array, last: Array, roll: Array, chord: Array, rest: Array
) -> Float[Array, "13 k *lanes"]:
    """Forces on the local coordinates, from those on r' of both nodes and on the chord in axes of
    the frame, on its turning about the tangent, and on the last three numbers of `deformation`."""
    lanes, back = frame.first.ndim - 1, frame.rows.swapaxes(0, 1)[:, :, None]
    first, chord, last = (contract(back, v[None], 1, lanes + 1) for v in (first, chord, last))
    first = first + carried(frame.first)[:, None] * roll
    last = last + carried(frame.last)[:, None] * rest[1:2]
    moved = jnp.stack([first, chord, last], 1)
    return jnp.concatenate([moved.reshape(9, *moved.shape[2:]), roll, rest])


def pulled_back(
    frame: Frames, force: Float[Array, "10 k *lanes"], n_elements: int
) -> Float[Array, "13 k *lanes"]:
    """Forces on the local coordinates that do the work of k forces on `deformation`."""
    acting = _seen_forces(frame.seen, force, n_elements)
    first = _on_first(frame, acting)
    return _on_nodes(frame, first, acting.ahead, acting.moment[:1], acting.chord, force[7:])


def _on_first(frame: Frames, acting: _Acting) -> Array:
    """The force on r' of the first node that turns the frame across, in its axes."""
    across = acting.moment[1:] / frame.seen.size[None, None]
    return jnp.concatenate([acting.size, across[1:], -across[:1]])


@transposed(on=False)
def pulled_back_tangent(
    frame: Frames, force: Natural, second: Float[Array, "10 10 *lanes"], n_elements: int
) -> Float[Array, "13 13 *lanes"]:
    """The derivative by the local coordinates of what `pulled_back` makes of a force on
    `deformation`, by which the derivatives of that are `second`."""
    seen, force, lanes = frame.seen, force[:, None], force.ndim - 1
    many = _seen_forces(seen, jnp.concatenate([force, second], 1), n_elements)
    acting = _Acting(*(part[:, :1] for part in many))
    by_force = jnp.concatenate([part[:, 1:] for part in many])

    def flat(z: Float[Array, "7 *lanes"]) -> Float[Array, "10 *lanes"]:
        moved = _seen_forces(Seen(z[0], z[1:4], z[4:]), force, n_elements)
        return jnp.concatenate(moved)[:, 0]

    # Forces of the frame by `deformation`: as these go with what is seen, and with the force.
    z = jnp.concatenate([seen.size[None], seen.chord, seen.ahead])
    units = jnp.broadcast_to(beside(np.eye(7), lanes), (7, *z.shape))
    by_seen = jax.vmap(lambda unit: jax.jvp(flat, (z,), (unit,))[1], out_axes=1)(units)
    by_seen = jnp.pad(by_seen, ((0, 0), (0, 3), *((0, 0),) * lanes))
    change = jnp.concatenate([by_seen + by_force, second[7:]])
    # And by the local coordinates.
    change = pulled_back(frame, change.swapaxes(0, 1), n_elements).swapaxes(0, 1)
    # How the frame turns and |r'| changes: forces of one on these, on the local coordinates.
    ways = np.zeros((10, 4))
    ways[:4] = np.eye(4)
    one: Array = jnp.broadcast_to(beside(ways, lanes), (10, 4, *seen.size.shape))
    none = jnp.zeros_like(one[:3])
    moves = _on_first(frame, _Acting(one[:1], one[1:4], none, none))
    moves = _on_nodes(frame, moves, none, one[1:2], none, none).swapaxes(0, 1)
    grows, rotation = moves[:1], moves[1:]
    fixed = _on_first(frame, acting)
    less = jnp.concatenate([jnp.zeros_like(fixed[:1]), -fixed[1:]]) / seen.size[None, None]
    first = _on_first(frame, _Acting(change[:1], change[1:4], change[4:7], change[7:10]))
    first = first + cross(rotation, _wide(fixed, rotation)) + less * grows
    chord = change[4:7] + cross(rotation, _wide(acting.chord, rotation))
    ahead = change[7:10] + cross(rotation, _wide(acting.ahead, rotation))
    out = _on_nodes(frame, first, ahead, change[1:2], chord, change[10:])
    out = out + _at_gradient(0, acting.moment[0][None] * _carried_by(frame.first))
    return out + _at_gradient(2, force[8][None] * _carried_by(frame.last))


def _beside(v: Array, many: Array) -> Array:
    """A vector as often as there are others, (3, k, *lanes)."""
    return jnp.broadcast_to(v[:, None], many.shape)


def _wide(v: Array, many: Array) -> Array:
    return jnp.broadcast_to(v, many.shape)


def _at_gradient(i: int, block: Float[Array, "3 3 *lanes"]) -> Float[Array, "13 13 *lanes"]:
    """Where r' of the first (0) or last (2) node acts on itself: components are three apart."""
    lanes = block.ndim - 2
    none = jnp.zeros_like(block)
    wide = jnp.stack([block if j == i else none for j in range(3)], 1)
    wide = wide.reshape(9, 3, *block.shape[2:])
    none = jnp.zeros_like(wide)
    wide = jnp.stack([wide if j == i else none for j in range(3)], 2)
    return jnp.pad(wide.reshape(9, 9, *block.shape[2:]), ((0, 4), (0, 4), *((0, 0),) * lanes))


def carried(r: Triple) -> Triple:
    """How a change of r' turns the section about the tangent if the least rotation from a1 brings
    it there: (0, r_3, -r_2) / (|r'| (|r'| + r_1))."""
    size, share = _sizes(r)
    return jnp.stack([jnp.zeros_like(size), r[2], -r[1]]) * (share / size)[None]


def _sizes(r: Triple) -> tuple[Number, Number]:
    """|r'| and 1 / (|r'| + r_1), without cancellation."""
    size, ahead = jnp.sqrt(total(r * r)), r[0] > 0
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


def axes(t: Triple, angle: Number) -> Float[Array, "3 3 *lanes"]:
    """Rows: t, and the axes of a section that is turned by an angle from where the least rotation
    brings a2 and a3, which exists unless t is -a1."""
    x, y, z = t
    # 1 / (1 + x), in the second form without cancellation.
    ahead = x > 0
    share = jnp.where(ahead, 1.0, 1 - x) / jnp.where(ahead, 1 + x, y * y + z * z)
    second = jnp.stack([-y, 1 - y * y * share, -y * z * share])
    third = jnp.stack([-z, -y * z * share, 1 - z * z * share])
    cos, sin = jnp.cos(angle)[None], jnp.sin(angle)[None]
    return jnp.stack([t, cos * second + sin * third, cos * third - sin * second])


def between(t: Triple, u: Triple) -> Number:
    """Area of the triangle of a1, t and u on the unit sphere, with the sign of a1.(t x u)."""
    up = t[1] * u[2] - t[2] * u[1]
    return 2 * jnp.arctan2(up, 1 + t[0] + u[0] + total(t * u))


def gradients(e: Local) -> Float[Array, "3 3 *lanes"]:
    """Gradients of r - x a1, by components, at the first node, on the chord, at the last node."""
    return e[:9].reshape(3, 3, *e.shape[1:])


def stretched(d: Float[Array, "3 k *lanes"]) -> Array:
    """The gradient r' from that of displacements, d + a1."""
    return d + beside(A1[:, None], d.ndim - 2)
