"""Inertia of a rod that moves in time, and its tangents.

Nodes have velocities w = (V, W) seen from the hub, in axes that turn with them: u' = R V and P' =
P (0, W) / 2 (`rod_kinematics.py`). With r = (R^T (v + omega x X), R^T omega) what the hub gives
them, and s the same of the rates of v and omega,

    nu = w + r,   nu' = w' + s + A(r) w,   M nu' = A(nu)^T M nu + forces

are their velocities, and the rates of these, in space: M is constant, and A ([[W~, V~], [0, W~]])
and J (`twisting`) are of single nodes. By small changes (h, t) of nodes, in their axes, r changes
by A(r), so

    f = A(nu)^T M nu - M (s + A(r) w),
    df = (J(M nu) + A(nu)^T M) (dw + A(r) dh) - M ((A(s) - A(w) A(r)) dh + A(r) dw).

Quaternions of nodes are made of length one before they are used: so forces depend on rotations
alone, tangents are by small changes, and what a step leaves of the length is of no account.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._models.space.rod_elements import on_diagonal
from jaxbeam._models.space.rod_loads import Still, carried, twisting, velocities
from jaxbeam._models.space.rod_nodes import Rod
from jaxbeam._types import Triple

_Sixes = Float[Array, "nodes 6"]
_Every = Float[Array, "N N"]


def inertia_of(
    rod: Rod, still: Still, rates: tuple[Triple, Triple], w: _Sixes
) -> tuple[_Sixes, tuple[_Sixes, ...]]:
    """The force of inertia on nodes with these velocities, seen from a hub whose own have these
    rates; and the data of its tangents."""
    n = len(w)
    r = velocities(rod.tables, still)
    s = velocities(rod.tables, still._replace(velocity=rates[0], spin=rates[1]))
    nu = w + r
    p = (rod.mass @ nu.reshape(-1)).reshape(n, 6)
    rate = s + jnp.einsum("nij,nj->ni", carried(r), w)
    force = jnp.einsum("nji,nj->ni", carried(nu), p) - (rod.mass @ rate.reshape(-1)).reshape(n, 6)
    return force, (w, r, s, nu, p)


def inertia_tangents(mass: _Every, made_of: tuple[_Sixes, ...]) -> tuple[_Every, _Every]:
    """Minus the derivatives of the force of inertia, by changes of nodes and by their rates."""
    w, r, s, nu, p = made_of
    n = len(w)
    a = carried(r)

    def before(blocks: Float[Array, "nodes 6 6"], matrix: _Every) -> _Every:
        return (blocks @ matrix.reshape(n, 6, -1)).reshape(6 * n, 6 * n)

    def after(matrix: _Every, blocks: Float[Array, "nodes 6 6"]) -> _Every:
        return before(blocks.swapaxes(1, 2), matrix.T).T

    both = on_diagonal(twisting(p)) + before(carried(nu).swapaxes(1, 2), mass)
    by_changes = after(mass, carried(s) - carried(w) @ a) - after(both, a)
    return by_changes, after(mass, a) - both
