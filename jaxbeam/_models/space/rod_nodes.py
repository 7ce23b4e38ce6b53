"""Coordinates of the nodes of a rod, and what changes and velocities of them are.

Coordinates q (7 n,) are the displacement u of the root, 2 L (p - (1, 0, 0, 0)) of quaternions p of
all nodes, which count as of length one, and L eps of the strains eps = R^T r' - x' at Gauss points
in the place of the displacements of the other nodes, which follow from these (`rod_places.py`): so
zero is the undeformed rod. They are in axes of the beam, those of ends on supports in axes of
these. With displacements for coordinates torsion and bending of one step would make shear, by their
product, which is stiff, while torsion has hardly any inertia: steps of linearly implicit methods
had to be a third as long, or less.

Coordinates change by (h, t) of free nodes in axes that turn with them, which is what forces and
matrices are by; of ends on supports by what these leave free (`rod_supports.py`).

Velocities of motion in time are rates of such changes too, at ends those of the undeformed rod, and
with turns times the length: so their mass is constant.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.space.rod_elements import Bent, bent, on_diagonal
from jaxbeam._models.space.rod_places import (
    displacements,
    integrals,
    strain_rates,
    strains,
    turning,
    without_drift,
)
from jaxbeam._models.space.rod_supports import Held, free_changes
from jaxbeam._models.space.rod_tables import RodTables
from jaxbeam._numerics.quaternions import (
    conjugate,
    cross,
    crossing,
    normalised,
    quaternion_product,
    rotated,
    rotation,
)
from jaxbeam._types import Coordinates, Scalar, Triple

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
        u, p = self.loose_nodes(q)
        return without_drift(self.tables, u, self.held_tip), p

    def loose_nodes(
        self, q: Coordinates
    ) -> tuple[Float[Array, "nodes 3"], Float[Array, "nodes 4"]]:
        """Displacements and quaternions of nodes where strains alone say where the tip is."""
        root, p, strain = self.parts(q)
        p = normalised(p + UPRIGHT[None])
        return displacements(self.tables, root, p, strain), p

    def quaternions(self, q: Coordinates) -> Float[Array, "nodes 4"]:
        """Quaternions of nodes, of whatever length they have."""
        return self.parts(q)[1] + UPRIGHT[None]

    def turn_error(self, q: Coordinates) -> Scalar:
        """An estimate of the error of rotations between nodes, in rad: what squares
        of lengths of quaternions, which are one at nodes, lack there; 0.3 of it for degree 2."""
        p = jnp.asarray(self.tables.shapes) @ self.tables.of_elements(self.nodes(q)[1])
        return jnp.max(jnp.abs(1 - jnp.sum(p**2, -1)))

    def least_stretch(self, q: Coordinates) -> Scalar:
        """The least of r' along the undeformed tangent, seen from sections: below zero the axis is
        turned back on itself."""
        along = bent(self.tables, *self.nodes(q)).stretch * self.tables.tangent
        return jnp.min(jnp.sum(along, -1))

    def parts(
        self, q: Coordinates
    ) -> tuple[Triple, Float[Array, "nodes 4"], Float[Array, "E p 3"]]:
        """The displacement of the root, changes of quaternions and strains, or changes of them, in
        axes of the beam, by those of coordinates."""
        both, tables = q.reshape(-1, 7), self.tables
        root, p = both[0, :3], both[:, 3:] / (2 * self.length)
        strain = both[1:, :3].reshape(tables.elements, -1, 3) / self.length
        for node, end in self.ends:
            if end.attitude is not None:
                outward = end.outward(root, p[node])
                root, p = outward[0] if node == 0 else root, p.at[node].set(outward[1])
        return root, p, strain

    def joined(
        self, root: Triple, p: Float[Array, "nodes 4"], strain: Float[Array, "E p 3"]
    ) -> Coordinates:
        """Coordinates, or changes of them, of such parts."""
        for node, end in self.ends:
            own = end.own(root, p[node])
            root, p = own[0] if node == 0 else root, p.at[node].set(own[1])
        first = jnp.concatenate([root[None], self.length * strain.reshape(-1, 3)])
        return jnp.concatenate([first, 2 * self.length * p], 1).reshape(-1)

    def coordinates(self, u: Float[Array, "nodes 3"], p: Float[Array, "nodes 4"]) -> Coordinates:
        """Coordinates of displacements and quaternions."""
        return self.joined(u[0], p - UPRIGHT[None], strains(self.tables, u, p))

    @property
    def held_tip(self) -> Float[Array, "3 3"] | None:
        """The projection of displacements of the tip on the ways in which it is held, if any."""
        if self.tip is None or not (held := 1 - self.tip.free(0)).any():
            return None
        return (self.tip.axes * held) @ self.tip.axes.T

    def changed(self, q: Coordinates, change: Float[Array, " f"]) -> Coordinates:
        """The coordinates q after a change of those that are free."""
        u, p = self.nodes(q)
        every = self.spread(q, change)
        moved = u + jnp.einsum("nij,nj->ni", rotation(p), every[:, :3])
        return self.coordinates(moved, rotated(p, every[:, 3:]))

    def rates(self, q: Coordinates, change: Float[Array, " f"]) -> Coordinates:
        """The rates of coordinates q by small changes."""
        return self.rates_of(q, self.spread(q, change))

    def rates_of(self, q: Coordinates, rates: Float[Array, "nodes 6"]) -> Coordinates:
        """The rates of coordinates q by rates of nodes, in axes that turn with these."""
        state = bent(self.tables, *self.loose_nodes(q))
        return self.rates_in(state, self.quaternions(q), rates)

    def rates_in(
        self, state: Bent, p: Float[Array, "nodes 4"], rates: Float[Array, "nodes 6"]
    ) -> Coordinates:
        """The rates of coordinates of a state whose quaternions p are of whatever length."""
        half = jnp.concatenate([jnp.zeros_like(p[:, :1]), rates[:, 3:] / 2], 1)
        root, strain = state.turns[0, 0] @ rates[0, :3], strain_rates(self.tables, state, rates)
        return self.joined(root, quaternion_product(p, half), strain)

    def velocities_in(
        self, state: Bent, p: Float[Array, "nodes 4"], rates: Coordinates
    ) -> Float[Array, " f"]:
        """The velocities whose rates of coordinates are these, as in `rates_in`."""
        (root, spun, strain), tables = self.parts(rates), self.tables
        turns = small_turns(p, spun)
        slopes = strain + cross(turning(tables, state, turns), state.stretch)
        slopes = jnp.einsum("egba,egb->ega", state.inward, slopes)
        moved = without_drift(tables, integrals(tables, root, slopes), self.held_tip)
        inward = jnp.einsum("nba,nb->na", rotation(p), moved)
        return self.to_velocities(jnp.concatenate([inward, turns], 1))

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

    def after_changes(
        self, matrix: Float[Array, "f f"], changes: Float[Array, "N N"]
    ) -> Float[Array, "f f"]:
        """A matrix by velocities, after what makes changes of nodes of such changes."""
        own = self.led(self._rest, changes)[np.ix_(self.free, self.free)]
        return (matrix / self._units[None]) @ own * self._units[None]

    def between_ends(self, by_node: Float[Array, "nodes 3 3"]) -> Float[Array, "nodes 3 3"]:
        """Rotations of nodes from axes that turn with them; of ends that are led none, since ways
        stay as they are."""
        for node, _ in self.led_ends:
            by_node = by_node.at[node].set(jnp.eye(3), unique_indices=True)
        return by_node


def small_turns(
    p: Float[Array, "nodes 4"], change: Float[Array, "nodes 4"]
) -> Float[Array, "nodes 3"]:
    """Small turns of nodes, in their axes, from changes of quaternions of whatever length."""
    size = jnp.sum(p * p, 1, keepdims=True)
    return 2 * quaternion_product(conjugate(p), change)[:, 1:] / size


def slot(node: int) -> slice:
    """Places of the changes of the first node, 0, or of the last, -1."""
    return slice(0, 6) if node == 0 else slice(-6, None)
