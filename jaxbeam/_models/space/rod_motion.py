"""Motion in time of a rod: inertia, kinematics, and tangents of both.

Nodes have velocities w = (V, W) seen from the hub, in axes that turn with them, and u' = R V,
P' = P (0, W) / 2. With r = (R^T (v + omega x X), R^T omega) what the hub gives them, and s the same
of the rates of v and omega,

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
from jaxbeam._numerics.kinematics import Kinematics
from jaxbeam._numerics.linalg import Factors
from jaxbeam._numerics.quaternions import conjugate, quaternion_product, rotation
from jaxbeam._types import Matrix, Number, Triple, Vector

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


class Turning(Kinematics):
    """Kinematics of nodes where a step begins: dP = D dP', with D by (0, W) / 2 from the right."""

    rod: Rod
    p: Float[Array, "nodes 4"]  # of whatever length
    w: _Sixes
    g: Number

    def before(self, first: Vector) -> Vector:
        moving, turns = self.rod.by_nodes(first)
        own = self.g**2 / (1 + (self.g**2) * jnp.sum(self.w[:, 3:] ** 2, 1, keepdims=True) / 4)
        half = jnp.concatenate([jnp.zeros_like(own), self.w[:, 3:] / 2], 1)
        spun = own * (turns / self.g + quaternion_product(turns, half))
        by_turn = jnp.cross(self._turns(spun), self.w[:, :3])
        moved = self.g * (moving + jnp.einsum("nij,nj->ni", rotation(self.p), by_turn))
        return self.rod.coordinates(moved, spun)

    def rates(self, z: Vector) -> Vector:
        return self.rod.rates_of(self.p, self.rod.of_velocities(z))

    def seen(self, change: Vector) -> Vector:
        moved, spun = self.rod.by_nodes(change)
        inward = jnp.einsum("nji,nj->ni", rotation(self.p), moved)
        return self.rod.to_velocities(jnp.concatenate([inward, self._turns(spun)], 1))

    def eliminated(self, stiffness: Matrix) -> Matrix:
        g, w = self.g, self.w
        own = g**2 / (1 + g**2 * jnp.sum(w[:, 3:] ** 2, 1) / 4)
        eye = jnp.broadcast_to(jnp.eye(3), (len(w), 3, 3))
        spun = own[:, None, None] * (eye / g - carried(w)[:, 3:, 3:] / 2)
        moved = -g * carried(w)[:, :3, 3:] @ spun
        upper = jnp.concatenate([g * eye, moved], 2)
        blocks = jnp.concatenate([upper, jnp.concatenate([0 * eye, spun], 2)], 1)
        return self.rod.after_nodes(stiffness, blocks)

    def inverse(self, matrix: Matrix) -> Factors:
        return Factors.of(matrix)

    def _turns(self, spun: Float[Array, "nodes 4"]) -> Float[Array, "nodes 3"]:
        """Small turns of nodes, in their axes, from changes of their quaternions."""
        size = jnp.sum(self.p * self.p, 1, keepdims=True)
        return 2 * quaternion_product(conjugate(self.p), spun)[:, 1:] / size
