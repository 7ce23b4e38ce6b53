"""Elastic forces of the elements of a rod, and their tangents.

The rotation of a section is that of the quaternion Q = sum N_i P_i of the quaternions of nodes,
whatever its length. With R this rotation, r' the derivative of the place by arc length and x' that
of the undeformed axis,

    eps = R^T r' - x',   kap = 2 vec(Q^-1 Q')     (strains of Simo and Reissner)

in axes of the undeformed beam. Nodes change by (h_i, t_i) in axes that turn with them, P_i exp(t_i)
and u_i + R_i (h_i + t_i x h_i / 2), which to first order is

    dQ = sum N_i L_i t_i,   dQ' = sum N_i' L_i t_i,   dr' = sum N_i' R_i h_i

with 2 L_i = (-x_i^T; w_i + x_i~) of P_i = (w_i, x_i): 4, 4 and 3 numbers, and all that follows is
in them. Seen from the section they are a = Q^-1 dQ, b = Q^-1 dQ' and d = R^T dr'. With v = R^T r'
and k_0 the first of Q^-1 Q',

    d eps = d + 2 v x a,   d kap = 2 b - a_0 kap - 2 k_0 a - a x kap

(a, b their last three where they stand for vectors), and what forces f and moments m do to second
order is a quadratic form of the eleven, but for terms of single nodes. Where fibres lengthen as
sections twist, eps has t (i^2 k^2 / 2 + i^2 k_0 k) more, t the undeformed tangent and k = t.kap: a
force f then does the moment f.t (i^2 k + i^2 k_0) about t, too, and f.t i^2 dk^2 to second order.

Of sections only the numbers N_i and N_i' meet nodes. So sums over sections are of matrices by the
eleven, and L_i and R_i, which are of nodes alone, come last: a fifth of the work.

J. C. Simo, L. Vu-Quoc, Computer Methods in Applied Mechanics and Engineering 58, 1986; E. Zupan, M.
Saje, D. Zupan, same journal 198, 2009, on quaternions as unknowns.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.space.rod_tables import RodTables
from jaxbeam._numerics.multilinear import multilinear
from jaxbeam._numerics.quaternions import crossing, leading, rotation

_Three = Float[Array, "E p 3"]


class Bent(NamedTuple):
    """Elements in a state: the data of force and tangent, at p Gauss points and k nodes."""

    strain: Float[Array, "E p 6"]
    stretch: _Three  # v
    spin: Float[Array, "E p"]  # k_0
    seen: Float[Array, "E p 4 4"]  # of quaternions q -> Q^-1 q
    inward: Float[Array, "E p 3 3"]  # R^T
    by_eleven: Float[Array, "E p 6 11"]  # strains by (dQ, dQ', dr')
    quaternions: Float[Array, "E k 4"]  # P_i
    leads: Float[Array, "E k 4 3"]  # L_i
    turns: Float[Array, "E k 3 3"]  # R_i


def bent(tables: RodTables, u: Float[Array, "nodes 3"], p: Float[Array, "nodes 4"]) -> Bent:
    """Elements whose nodes have moved by u and turned by the quaternions p."""
    leads, turns = tables.of_elements(_leading(p)), tables.of_elements(rotation(p))
    u, p = tables.of_elements(u), tables.of_elements(p)
    q = jnp.asarray(tables.shapes) @ p
    seen = _seen_from(q / jnp.sum(q * q, -1, keepdims=True))
    inward = rotation(q).swapaxes(-1, -2)
    stretch = jnp.einsum("egij,egj->egi", inward, tables.tangent + tables.rate @ u)
    rate = jnp.einsum("egcd,egd->egc", seen, tables.rate @ p)
    spin, curved = rate[..., 0], 2 * rate[..., 1:]
    strain = jnp.concatenate([stretch - tables.tangent, curved], -1)
    by_a = _by_seen(jnp.concatenate([rate, stretch], -1)) @ seen
    # b is in kap alone, with a factor of two, and d in eps.
    by_b = jnp.pad(2 * seen[:, :, 1:], ((0, 0), (0, 0), (3, 0), (0, 0)))
    by_d = jnp.pad(inward, ((0, 0), (0, 0), (0, 3), (0, 0)))
    by = jnp.concatenate([by_a, by_b, by_d], -1)
    if tables.fibres is not None:
        strain, by = _lengthened(tables.tangent, tables.fibres, strain, by)
    return Bent(strain, stretch, spin, seen, inward, by, p, leads, turns)


def by_changes(tables: RodTables, state: Bent) -> Float[Array, "E m l"]:
    """The matrix of strains by changes of nodes."""
    count, k, by = len(tables.rate), state.leads.shape[1], state.by_eleven

    def of_nodes(part: Array, rows: Array) -> Float[Array, "E p 6 k 3"]:
        size = part.shape[-1]
        out = part.reshape(count, -1, size) @ rows.swapaxes(1, 2).reshape(count, size, -1)
        return out.reshape(*by.shape[:3], k, 3)

    shapes, rate = tables.shapes[None, :, None, :, None], tables.rate[:, :, None, :, None]
    by_turns = shapes * of_nodes(by[..., :4], state.leads)
    by_turns = by_turns + rate * of_nodes(by[..., 4:8], state.leads)
    moved = rate * of_nodes(by[..., 8:], state.turns)
    return jnp.concatenate([moved, by_turns], -1).reshape(count, -1, 6 * k)


def _lengthened(
    tangent: _Three, fibres: tuple[Float[Array, "E p"], Float[Array, "E p"]],
    strain: Float[Array, "E p 6"], by: Float[Array, "E p 6 11"],
) -> tuple[Float[Array, "E p 6"], Float[Array, "E p 6 11"]]:  # fmt: skip
    """Strains with the lengthening of fibres added, which is along the undeformed tangent."""
    square, built = fibres
    about = jnp.sum(tangent * strain[..., 3:], -1)
    longer = (square * about / 2 + built) * about
    more = (square * about + built)[..., None, None] * tangent[..., None]
    by = by.at[..., :3, :].add(more * _twisting(tangent, by)[..., None, :])
    return strain.at[..., :3].add(longer[..., None] * tangent), by


def _twisting(tangent: _Three, by_eleven: Float[Array, "E p 6 11"]) -> Float[Array, "E p 11"]:
    """The rate of twist by the eleven numbers."""
    return jnp.einsum("egs,egsz->egz", tangent, by_eleven[..., 3:, :])


def pulled(
    tables: RodTables, curved: _Three, force: Float[Array, "E p 6"]
) -> Float[Array, "E p 6"]:
    """Forces in sections with the moments of fibres that they pull, which are about tangents."""
    if tables.fibres is None:
        return force
    square, built = tables.fibres
    tension, about = (jnp.sum(tables.tangent * part, -1) for part in (force[..., :3], curved))
    more = tension * (square * about + built)
    return force.at[..., 3:].add(more[..., None] * tables.tangent)


@multilinear(4)
def _seen_from(q: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4 4"]:
    """The matrix of p -> q^-1 p, by q over the square of its length."""
    w, x = q[0], q[1:]
    return np.block([[w, x], [-x[:, None], w * np.eye(3) - np.cross(x, np.eye(3)).T]])


@multilinear(4)
def _leading(p: Float[np.ndarray, "4"]) -> Float[np.ndarray, "4 3"]:
    """The matrices L of quaternions of nodes."""
    w, x = p[0], p[1:]
    return np.vstack([-x, w * np.eye(3) + np.cross(x, np.eye(3)).T]) / 2


@multilinear(7)
def _by_seen(given: Float[np.ndarray, "7"]) -> Float[np.ndarray, "6 4"]:
    """The derivatives of strains by a, from Q^-1 Q' and v."""
    spin, curved, stretch = given[0], 2 * given[1:4], given[4:]
    v, k = (np.cross(part, np.eye(3)).T for part in (stretch, curved))
    top, low = [np.zeros((3, 1)), 2 * v], [-curved[:, None], k - 2 * spin * np.eye(3)]
    return np.block([top, low])


def nodal(tables: RodTables, state: Bent, force: Float[Array, "E p 6"]) -> Float[Array, "E k 6"]:
    """Forces on nodes, in axes of these, by forces in sections at Gauss points with weights."""
    push, couple = _on_nodes(tables, state, force)
    pairs = (state.turns, push), (state.leads, couple)
    return jnp.concatenate([jnp.einsum("ekct,ekc->ekt", *pair) for pair in pairs], -1)


def _on_nodes(
    tables: RodTables, state: Bent, force: Float[Array, "E p 6"]
) -> tuple[Float[Array, "E k 3"], Float[Array, "E k 4"]]:
    """Forces on nodes by forces in sections, for changes of places and of quaternions."""
    eleven = jnp.einsum("egsz,egs->egz", state.by_eleven, force)
    back = tables.rate.swapaxes(1, 2)
    couple = jnp.asarray(tables.shapes).T @ eleven[..., :4] + back @ eleven[..., 4:8]
    return back @ eleven[..., 8:], couple


def geometric(
    tables: RodTables, state: Bent, force: Float[Array, "E p 6"]
) -> Float[Array, "E l l"]:
    """Second derivatives of the strains times forces, by changes of nodes."""
    push, couple = _on_nodes(tables, state, force)
    by_q, by_both, by_rise, by_rate = _by_absolute(tables, state, force)
    shapes, rate = jnp.asarray(tables.shapes), tables.rate
    by_turns = _summed(shapes[None, :, :, None] * shapes[None, :, None], by_q)
    mixed = shapes[None, :, :, None] * rate[:, :, None]
    both = _summed(mixed, jnp.concatenate([by_both, by_rise], -1))
    by_turns = by_turns + both[..., :4] + both[..., :4].transpose(0, 2, 1, 4, 3)
    if by_rate is not None:
        by_turns = by_turns + _summed(rate[..., None] * rate[:, :, None], by_rate)
    left = state.leads[:, :, None].swapaxes(-1, -2)
    by_turns = left @ (by_turns @ state.leads[:, None])
    moved = left @ (both[..., 4:] @ state.turns[:, None])
    # Terms of single nodes: of the exponential, and of positions that a turn takes along.
    around = -jnp.sum(couple * state.quaternions, -1)[..., None, None] / 4 * np.eye(3)[None, None]
    moving = -crossing(jnp.einsum("ekct,ekc->ekt", state.turns, push)) / 2
    own = np.eye(shapes.shape[1])[None, :, :, None, None]
    by_turns, moved = by_turns + own * around[:, :, None], moved + own * moving[:, :, None]
    low = jnp.concatenate([moved, by_turns], -1)
    top = jnp.concatenate([0 * by_turns, moved.transpose(0, 2, 1, 4, 3)], -1)
    out = jnp.concatenate([top, low], -2).transpose(0, 1, 3, 2, 4)
    return out.reshape(len(out), out.shape[1] * 6, -1)


def _summed(pairs: Array, forms: Float[Array, "E p a b"]) -> Float[Array, "E k k a b"]:
    """Sums over sections of forms times a number for each two nodes."""
    count, points, k, _ = pairs.shape
    flat = pairs.reshape(count, points, -1).swapaxes(1, 2)
    out = flat @ forms.reshape(len(forms), points, -1)
    return out.reshape(len(forms), k, k, *forms.shape[2:])


def _by_absolute(
    tables: RodTables, state: Bent, force: Float[Array, "E p 6"]
) -> tuple[Array, Array, Array, Array | None]:
    """The quadratic form of (dQ, dQ', dr'): its parts by (dQ, dQ), (dQ, dQ') and (dQ, dr'), and
    where fibres lengthen by (dQ', dQ')."""
    force = pulled(tables, state.strain[..., 3:], force)
    parts = _second(force[..., :3], force[..., 3:], state)
    back, by_rate = state.seen.swapaxes(-1, -2), None
    ways = state.seen, state.seen, state.inward
    by_q, by_both, by_rise = (back @ part @ way for part, way in zip(parts, ways, strict=True))
    if tables.fibres is not None:
        twisting = _twisting(tables.tangent, state.by_eleven)
        stiff = jnp.sum(force[..., :3] * tables.tangent, -1) * tables.fibres[0]
        form = stiff[..., None, None] * _outer(twisting, twisting)
        by_q, by_both, by_rate = (
            by_q + form[..., :4, :4],
            by_both + form[..., :4, 4:8],
            form[..., 4:8, 4:8],
        )
    return by_q, by_both, by_rise, by_rate


def on_diagonal(blocks: Float[Array, "*e k b b"]) -> Float[Array, "*e l l"]:
    """Matrices with these blocks on their diagonals."""
    count, size = blocks.shape[-3], blocks.shape[-1]
    spread = blocks[..., :, :, None, :]
    spread = spread * leading(np.eye(count)[:, None, :, None], spread)
    return spread.reshape(*blocks.shape[:-3], count * size, count * size)


def _outer(a: Array, b: Array) -> Array:
    return a[..., :, None] * b[..., None, :]


def _second(f: _Three, m: _Three, state: Bent) -> tuple[Array, Array, Array]:
    """The quadratic form of (a, b, d), as second derivatives by (a, a), (a, b) and (a, d): there
    are no others."""
    force = jnp.concatenate([f, m], -1)
    given = jnp.concatenate([state.spin[..., None], state.strain[..., 3:], state.stretch], -1)
    by_both = _by_forces(force)
    return _by_a(force, given), by_both[..., :4], by_both[..., 4:]


@multilinear(6, 7)
def _by_a(force: Float[np.ndarray, "6"], given: Float[np.ndarray, "7"]) -> Float[np.ndarray, "4 4"]:
    """The second derivatives by (a, a), by forces and moments, and k_0, kap and v."""
    (f, m), spin, curved, stretch = force.reshape(2, 3), given[0], given[1:4], given[4:]
    along, both = curved @ m, np.outer(f, stretch)
    a0_a = -2 * np.cross(f, stretch) + 4 * spin * m + 2 * np.cross(curved, m)
    a_a = 2 * (both + both.T) - (4 * f @ stretch + 2 * along) * np.eye(3)
    return np.block([[2 * along, a0_a], [a0_a[:, None], a_a]])


@multilinear(6)
def _by_forces(force: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4 7"]:
    """The second derivatives by (a, b) and (a, d): of -2 (a0 m.b + b0 m.a + m.(a x b)) and of
    2 a.(f x d)."""
    f, m = (np.cross(part, np.eye(3)).T for part in force.reshape(2, 3))
    couple, none = force[3:], np.zeros((1, 1))
    by_b = -2 * np.block([[none, couple[None]], [couple[:, None], -m]])
    return np.hstack([by_b, np.vstack([np.zeros((1, 3)), 2 * f])])
