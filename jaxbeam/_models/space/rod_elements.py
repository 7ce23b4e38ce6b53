"""Elastic forces of the elements of a rod, and their tangents.

The rotation of a section is that of the quaternion Q = sum N_i P_i of the quaternions of nodes,
whatever its length. Seen from it, a node is turned by rho_i = Q^-1 P_i = (w_i, x_i), and with R the
rotation, r' the derivative of the place by arc length and x' that of the undeformed axis,

    eps = R^T r' - x',   kap = 2 sum N_i' x_i     (strains of Simo and Reissner)

in axes of the undeformed beam. Nodes change by (h_i, t_i) in axes that turn with them, P_i exp(t_i)
and u_i + R_i (h_i + t_i x h_i / 2). To first order Q^-1 dQ = a, Q^-1 dQ' = b and R^T du' = d, where

    a = sum N_i L_i t_i,   b = sum N_i' L_i t_i,   d = sum N_i' R^T R_i h_i,

with 2 L_i = (-x_i^T; w_i + x_i~), are 4, 4 and 3 numbers, and all that follows is in them: with
v = R^T r' and k_0 = sum N_i' w_i,

    d eps = d + 2 v x a,   d kap = 2 b - a_0 kap - 2 k_0 a - a x kap

(a, b their last three where they stand for vectors), and what forces f and moments m do to second
order is a quadratic form of the eleven, but for terms of single nodes. Where fibres lengthen as
sections twist, eps has t (i^2 k^2 / 2 + i^2 k_0 k) more, t the undeformed tangent and k = t.kap: a
force f then does the moment f.t (i^2 k + i^2 k_0) about t, too, and f.t i^2 dk^2 to second order.

J. C. Simo, L. Vu-Quoc, Computer Methods in Applied Mechanics and Engineering 58, 1986; E. Zupan, M.
Saje, D. Zupan, same journal 198, 2009, on quaternions as unknowns.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.space.rod_tables import RodTables
from jaxbeam._numerics.quaternions import crossing, leading, rotation

_Three = Float[Array, "E p 3"]


class Bent(NamedTuple):
    """Elements in a state: what force and tangent are made of, at p Gauss points and k nodes."""

    strain: Float[Array, "E p 6"]
    stretch: _Three  # v
    spin: Float[Array, "E p"]  # k_0
    between: Float[Array, "E p k 4"]  # rho
    turns: Float[Array, "E p k 3 3"]  # R^T R_i
    by_nodes: Float[Array, "E p 11 l"]  # (a, b, d) by changes of nodes
    by_eleven: Float[Array, "E p 6 11"]  # strains by these

    @property
    def by_changes(self) -> Float[Array, "E m l"]:
        """Strains by changes of nodes."""
        out = self.by_eleven @ self.by_nodes
        return out.reshape(len(out), -1, out.shape[-1])


def bent(tables: RodTables, u: Float[Array, "nodes 3"], p: Float[Array, "nodes 4"]) -> Bent:
    """Elements whose nodes have moved by u and turned by the quaternions p."""
    shapes, rate = tables.shapes, tables.rate
    u, p = tables.of_elements(u), tables.of_elements(p)
    q = jnp.einsum("gk,ekc->egc", shapes, p)
    attitude = rotation(q)
    stretch = jnp.einsum("egji,egj->egi", attitude, tables.tangent + rate @ u)
    between = jnp.einsum("egcd,ekd->egkc", _seen_from(q), p)
    w, x = between[..., 0], between[..., 1:]
    spin = jnp.sum(rate * w, 2)
    curved = 2 * jnp.einsum("egk,egkc->egc", rate, x)
    by_eleven = _by_eleven(stretch, curved, spin)
    strain = jnp.concatenate([stretch - tables.tangent, curved], -1)
    if tables.fibres is not None:
        strain, by_eleven = _lengthened(tables.tangent, tables.fibres, strain, by_eleven)
    turns = jnp.einsum("egji,ekjl->egkil", attitude, rotation(p))
    about = jnp.concatenate(
        [-x[..., None, :], w[..., None, None] * np.eye(3)[None, None, None] + crossing(x)], -2
    ) / 2  # fmt: skip
    none = jnp.zeros((*w.shape, 8, 3), w.dtype)
    moved = jnp.concatenate([none, rate[..., None, None] * turns], -2)
    values = shapes[None, :, :, None, None] * about
    rotated = jnp.concatenate([values, rate[..., None, None] * about, none[..., :3, :]], -2)
    by_nodes = jnp.concatenate([moved, rotated], -1).transpose(0, 1, 3, 2, 4)
    by_nodes = by_nodes.reshape(*by_nodes.shape[:3], -1)
    return Bent(strain, stretch, spin, between, turns, by_nodes, by_eleven)


def _lengthened(
    tangent: _Three, fibres: tuple[Float[Array, "E p"], Float[Array, "E p"]],
    strain: Float[Array, "E p 6"], by_eleven: Float[Array, "E p 6 11"],
) -> tuple[Float[Array, "E p 6"], Float[Array, "E p 6 11"]]:  # fmt: skip
    """Strains with what fibres lengthen by, which is along the undeformed tangent."""
    square, built = fibres
    about = jnp.sum(tangent * strain[..., 3:], -1)
    longer = (square * about / 2 + built) * about
    more = (square * about + built)[..., None, None] * tangent[..., None]
    by_eleven = by_eleven.at[..., :3, :].add(more * _twisting(tangent, by_eleven)[..., None, :])
    return strain.at[..., :3].add(longer[..., None] * tangent), by_eleven


def _twisting(tangent: _Three, by_eleven: Float[Array, "E p 6 11"]) -> Float[Array, "E p 11"]:
    """The rate of twist by the eleven."""
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


def _seen_from(q: Float[Array, "*k 4"]) -> Float[Array, "*k 4 4"]:
    """The matrix of p -> q^-1 p."""
    w, x, y, z = (q[..., i] for i in range(4))
    rows = jnp.stack([w, x, y, z, -x, w, z, -y, -y, -z, w, x, -z, y, -x, w], -1)
    return rows.reshape(*q.shape[:-1], 4, 4) / jnp.sum(q * q, -1)[..., None, None]


def _by_eleven(
    stretch: _Three, curved: _Three, spin: Float[Array, "E p"]
) -> Float[Array, "E p 6 11"]:
    eye, none = jnp.broadcast_to(np.eye(3), (*spin.shape, 3, 3)), jnp.zeros((*spin.shape, 3, 1))
    by_a = crossing(curved) - 2 * spin[..., None, None] * eye
    top = [none, 2 * crossing(stretch), none, 0 * eye, eye]
    low = [-curved[..., None], by_a, none, 2 * eye, 0 * eye]
    return jnp.concatenate([jnp.concatenate(top, -1), jnp.concatenate(low, -1)], -2)


def nodal(state: Bent, force: Float[Array, "E p 6"]) -> Float[Array, "E k 6"]:
    """What forces in sections, at Gauss points with weights, do on nodes, in axes of these."""
    by_eleven = jnp.einsum("egsz,egs->egz", state.by_eleven, force)
    out = jnp.einsum("egzl,egz->el", state.by_nodes, by_eleven)
    return out.reshape(len(out), -1, 6)


def geometric(
    tables: RodTables, state: Bent, force: Float[Array, "E p 6"], on_nodes: Float[Array, "E k 6"]
) -> Float[Array, "E l l"]:
    """Second derivatives of the strains times forces, by changes of nodes; `on_nodes` is what
    `nodal` makes of these forces."""
    curved, stretch, spin = state.strain[..., 3:], state.stretch, state.spin
    force = pulled(tables, curved, force)
    f, m = force[..., :3], force[..., 3:]
    form, by_eleven = state.by_nodes, _second(f, m, stretch, curved, spin)
    if tables.fibres is not None:
        twisting = _twisting(tables.tangent, state.by_eleven)
        stiff = jnp.sum(f * tables.tangent, -1) * tables.fibres[0]
        by_eleven = by_eleven + stiff[..., None, None] * _outer(twisting, twisting)
    second = form.swapaxes(-1, -2) @ (by_eleven @ form)
    out = jnp.sum(second, 1)
    # Terms of single nodes: of the exponential, and of positions that a turn takes along.
    shapes, rate = tables.shapes, tables.rate
    w, x = state.between[..., 0], state.between[..., 1:]
    about = jnp.cross(f, stretch) - spin[..., None] * m - jnp.cross(curved, m) / 2
    along = jnp.sum(curved * m, -1)
    own = jnp.einsum("egk,egc,egkc->ek", rate, m, x)
    own = own + jnp.einsum("gk,egc,egkc->ek", shapes, about, x)
    own = own - jnp.einsum("gk,eg,egk->ek", shapes, along, w) / 2
    around = -own[..., None, None] / 2 * np.eye(3)[None, None]
    moving = -crossing(on_nodes[..., :3]) / 2
    block = jnp.concatenate(
        [
            jnp.concatenate([0 * around, moving.swapaxes(-1, -2)], -1),
            jnp.concatenate([moving, around], -1),
        ],
        -2,
    )
    return out + on_diagonal(block)


def on_diagonal(blocks: Float[Array, "*e k b b"]) -> Float[Array, "*e l l"]:
    """Matrices with these blocks on their diagonals."""
    count, size = blocks.shape[-3], blocks.shape[-1]
    spread = blocks[..., :, :, None, :]
    spread = spread * leading(np.eye(count)[:, None, :, None], spread)
    return spread.reshape(*blocks.shape[:-3], count * size, count * size)


def _outer(a: Array, b: Array) -> Array:
    return a[..., :, None] * b[..., None, :]


def _second(
    f: _Three, m: _Three, stretch: _Three, curved: _Three, spin: Float[Array, "E p"]
) -> Float[Array, "E p 11 11"]:
    """The quadratic form of (a, b, d), as its matrix of second derivatives."""
    eye = np.eye(3)[None, None]
    along = jnp.sum(curved * m, -1)[..., None, None]
    both = _outer(f, stretch)
    pull = jnp.sum(f * stretch, -1)[..., None, None]
    a0_a0 = 2 * along
    a0_a = -2 * jnp.cross(f, stretch) + 4 * spin[..., None] * m + 2 * jnp.cross(curved, m)
    a_a = 2 * (both + both.swapaxes(-1, -2)) - (4 * pull + 2 * along) * eye
    top = jnp.concatenate([a0_a0, a0_a[..., None, :]], -1)
    a = jnp.concatenate([top, jnp.concatenate([a0_a[..., None], a_a], -1)], -2)
    column, none = m[..., :, None], jnp.zeros_like(along)
    # -2 (a0 m.b + b0 m.a + m.(a x b)), rows a, columns b
    a_b = -2 * jnp.concatenate(
        [
            jnp.concatenate([none, m[..., None, :]], -1),
            jnp.concatenate([column, -crossing(m)], -1),
        ],
        -2,
    )
    # 2 a.(f x d)
    a_d = jnp.concatenate([jnp.zeros_like(f)[..., None, :], 2 * crossing(f)], -2)
    zero_bb, zero_bd = jnp.zeros((*spin.shape, 4, 4)), jnp.zeros((*spin.shape, 4, 3))
    zero_dd = jnp.zeros((*spin.shape, 3, 3))
    return jnp.concatenate(
        [
            jnp.concatenate([a, a_b, a_d], -1),
            jnp.concatenate([a_b.swapaxes(-1, -2), zero_bb, zero_bd], -1),
            jnp.concatenate([a_d.swapaxes(-1, -2), zero_bd.swapaxes(-1, -2), zero_dd], -1),
        ],
        -2,
    )
