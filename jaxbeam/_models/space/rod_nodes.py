"""Coordinates of the nodes of a rod, and what changes and velocities of them are.

Coordinates q (7 n,) are displacements u, and 2 L (p - (1, 0, 0, 0)) of quaternions p, of all nodes
in axes of the beam, those of ends on supports in axes of these, so that zero is the undeformed one;
quaternions count as of length one. They change by (h, t) of free nodes in axes that turn with them,
which is what forces and matrices are by; of ends on supports by what these leave free
(`rod_supports.py`).

Velocities of motion in time are rates of such changes too, at ends those of the undeformed rod, and
with turns times the length: so their mass is constant.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.space.rod_elements import on_diagonal
from jaxbeam._models.space.rod_supports import Held, free_changes
from jaxbeam._models.space.rod_tables import RodTables
from jaxbeam._numerics.quaternions import crossing, quaternion_product, rotated, rotation
from jaxbeam._types import Scalar

Coordinates = Float[Array, " q"]  # displacements and quaternions of nodes
UPRIGHT = np.eye(4)[0]


class Rod(eqx.Module):
    """A rod: elements, masses, supports."""

    tables: RodTables
    mass: Float[Array, "N N"]  # by velocities of nodes
    root: Held | None  # None: clamped
    tip: Held | None  # None: free
    length: Scalar

    @property
    def ends(self) -> list[tuple[int, Held]]:
        """The indices of nodes that are on supports, and these."""
        return [(node, end) for node, end in ((0, self.root), (-1, self.tip)) if end is not None]

    @property
    def led_ends(self) -> list[tuple[int, Held]]:
        """The nodes on supports whose changes follow from those that are free."""
        return [(node, end) for node, end in self.ends if end.leads]

    @property
    def free(self) -> np.ndarray:
        """Places of the changes that are free among those of all nodes."""
        ways = (None if end is None else end.ways for end in (self.root, self.tip))
        return free_changes(len(self.tables.place), *ways)

    def nodes(self, q: Coordinates) -> tuple[Float[Array, "nodes 3"], Float[Array, "nodes 4"]]:
        """Displacements and quaternions of nodes, these of length one."""
        u, p = self.raw_nodes(q)
        return u, p / jnp.sqrt(jnp.sum(p * p, 1, keepdims=True))

    def raw_nodes(self, q: Coordinates) -> tuple[Float[Array, "nodes 3"], Float[Array, "nodes 4"]]:
        """Displacements and quaternions of nodes, these as they are."""
        u, p = self.by_nodes(q)
        return u, p + UPRIGHT[None]

    def by_nodes(self, q: Coordinates) -> tuple[Float[Array, "nodes 3"], Float[Array, "nodes 4"]]:
        """Displacements of nodes and changes of quaternions, or changes of these, by those of
        coordinates."""
        both = q.reshape(-1, 7)
        u, p = both[:, :3], both[:, 3:] / (2 * self.length)
        for node, end in self.ends:
            if end.attitude is not None:
                placed, attitude = end.outward(u[node], p[node])
                u, p = u.at[node].set(placed), p.at[node].set(attitude)
        return u, p

    def placed(self, u: Float[Array, "nodes 3"], p: Float[Array, "nodes 4"]) -> Coordinates:
        """Coordinates of displacements and quaternions."""
        return self.coordinates(u, p - UPRIGHT[None])

    def coordinates(self, u: Float[Array, "nodes 3"], p: Float[Array, "nodes 4"]) -> Coordinates:
        """Coordinates of displacements and changes of quaternions, or changes of them."""
        for node, end in self.ends:
            placed, attitude = end.own(u[node], p[node])
            u, p = u.at[node].set(placed), p.at[node].set(attitude)
        return jnp.concatenate([u, 2 * self.length * p], 1).reshape(-1)

    def changed(self, q: Coordinates, change: Float[Array, " f"]) -> Coordinates:
        """The coordinates q after a change of those that are free."""
        u, p = self.nodes(q)
        every = self.spread(q, change)
        moved = u + jnp.einsum("nij,nj->ni", rotation(p), every[:, :3])
        return self.placed(moved, rotated(p, every[:, 3:]))

    def rates(self, q: Coordinates, change: Float[Array, " f"]) -> Coordinates:
        """The rates of coordinates q by small changes."""
        return self.rates_of(self.nodes(q)[1], self.spread(q, change))

    def rates_of(self, p: Float[Array, "nodes 4"], rates: Float[Array, "nodes 6"]) -> Coordinates:
        """The rates of coordinates by rates of nodes with these quaternions, in their axes."""
        moving = jnp.einsum("nij,nj->ni", rotation(p), rates[:, :3])
        by_half = jnp.concatenate([jnp.zeros_like(p[:, :1]), rates[:, 3:] / 2], 1)
        return self.coordinates(moving, quaternion_product(p, by_half))

    def spread(self, q: Coordinates, change: Float[Array, " f"]) -> Float[Array, "nodes 6"]:
        """Changes of all nodes from those that are free."""
        every = jnp.zeros(6 * len(self.tables.place), change.dtype)
        every = every.at[self.free].set(change, unique_indices=True).reshape(-1, 6)
        for node, basis in self._bases(q):
            every = every.at[node].set(basis @ every[node])
        return every

    def _bases(self, q: Coordinates) -> list[tuple[int, Float[Array, "6 6"]]]:
        """The matrices B of the ends whose changes follow from free ones."""
        return [(node, end.basis(self.nodes(q)[1][node])) for node, end in self.led_ends]

    def led(self, q: Coordinates, matrix: Float[Array, "N N"]) -> Float[Array, "N N"]:
        """A matrix by changes in which the free ones of each end lead the others."""
        for node, basis in self._bases(q):
            own = slot(node)
            matrix = matrix.at[own].set(basis.T @ matrix[own])
            matrix = matrix.at[:, own].set(matrix[:, own] @ basis)
        return matrix

    def taken_along(self, q: Coordinates) -> Float[Array, "f f"]:
        """The rigid motion of all but the root with the root: by its ways, as displacements and as
        turns times the length."""
        u, p = self.nodes(q)
        place, root, n = self.tables.place + u, self.root, len(u)
        way = jnp.eye(6, dtype=u.dtype)
        if root is not None and root.leads:
            way = on_diagonal(jnp.stack([rotation(p[0])] * 2)) @ root.basis(p[0])
        shift, turn = way[:3], way[3:]
        moving = shift[None] - crossing(place - place[:1]) @ turn[None]
        turn = jnp.broadcast_to(self.length * turn, (n, 3, 6))
        for node, end in self.led_ends:
            if node:
                moving, turn = (a.at[node].set(end.axes.T @ a[node]) for a in (moving, turn))
        units = jnp.stack([1.0] * 3 + [self.length] * 3)
        every = jnp.concatenate([moving, turn], 1) / units[None, None]
        every = jnp.zeros((6 * n, 6 * n), u.dtype).at[6:, :6].set(every[1:].reshape(-1, 6))
        return every[np.ix_(self.free, self.free)]

    @property
    def _rest(self) -> Coordinates:
        return jnp.zeros(7 * len(self.tables.place), self.length.dtype)

    @property
    def _units(self) -> Float[Array, " f"]:
        turns = self.free % 6 > 2
        return jnp.where(turns, 1 / self.length, 1.0)

    def of_velocities(self, v: Float[Array, " f"]) -> Float[Array, "nodes 6"]:
        """Rates of nodes in their axes, by velocities."""
        return self.spread(self._rest, self._units * v)

    def on_velocities(self, force: Float[Array, "nodes 6"]) -> Float[Array, " f"]:
        """The forces that do on velocities the work of forces on nodes in their axes."""
        return self._units * self._led_back(force)

    def to_velocities(self, change: Float[Array, "nodes 6"]) -> Float[Array, " f"]:
        """The changes that velocities are the rates of, from changes of nodes in their axes."""
        return self._led_back(change) / self._units

    def _led_back(self, sixes: Float[Array, "nodes 6"]) -> Float[Array, " f"]:
        for node, basis in self._bases(self._rest):
            sixes = sixes.at[node].set(basis.T @ sixes[node])
        return sixes.reshape(-1)[self.free]

    def by_velocities(self, matrix: Float[Array, "N N"]) -> Float[Array, "f f"]:
        """A matrix by changes of nodes as one by velocities."""
        own = self.led(self._rest, matrix)[np.ix_(self.free, self.free)]
        return self._units[:, None] * own * self._units[None]

    def after_nodes(
        self, matrix: Float[Array, "f f"], blocks: Float[Array, "nodes 6 6"]
    ) -> Float[Array, "f f"]:
        """A matrix by velocities, composed with blocks that map changes of nodes."""
        n, free = len(self.tables.place), self.free
        for node, basis in self._bases(self._rest):
            blocks = blocks.at[node].set(basis.T @ blocks[node] @ basis)
        every = jnp.zeros((len(free), 6 * n), matrix.dtype)
        every = every.at[:, free].set(matrix / self._units[None], unique_indices=True)
        out = jnp.einsum("mna,nab->mnb", every.reshape(-1, n, 6), blocks)
        return out.reshape(-1, 6 * n)[:, free] * self._units[None]

    def between_ends(self, by_node: Float[Array, "nodes 3 3"]) -> Float[Array, "nodes 3 3"]:
        """Rotations of nodes from axes that turn with them; of ends that are led none, since ways
        stay as they are."""
        for node, _ in self.led_ends:
            by_node = by_node.at[node].set(jnp.eye(3), unique_indices=True)
        return by_node


def slot(node: int) -> slice:
    """Places of the changes of the first node, 0, or of the last, -1."""
    return slice(0, 6) if node == 0 else slice(-6, None)
