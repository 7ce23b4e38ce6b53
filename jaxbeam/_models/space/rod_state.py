"""States of a rod that rests in its hub: force, tangents, and the search for where they balance.

Coordinates q (7 n,) are displacements u, and 2 L (p - (1, 0, 0, 0)) of quaternions p, of all nodes
in axes of the beam, those of ends on supports in axes of these, so that zero is the undeformed one;
quaternions count as of length one. They change by (h, t) of free nodes in axes that turn with them,
which is what forces and matrices are by; of ends on supports by what these leave free
(`rod_supports.py`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import jaxpr_as_fun
from jaxtyping import Array, Bool, Float

from jaxbeam._models.space.rod_elements import bent, by_changes, geometric, nodal, on_diagonal
from jaxbeam._models.space.rod_loads import (
    RodSpanForce,
    Still,
    acting,
    carried_along,
    twisting,
    velocities,
)
from jaxbeam._models.space.rod_supports import Held, free_changes
from jaxbeam._models.space.rod_tables import RodTables
from jaxbeam._numerics.linalg import solve
from jaxbeam._numerics.quaternions import product, rotated, rotation
from jaxbeam._programs.batches import one_by_one
from jaxbeam._programs.one_function import without_dead_parts
from jaxbeam._rotor.loads import TipLoad
from jaxbeam._types import Scalar, Triple

Coordinates = Float[Array, " q"]  # displacements and quaternions of nodes
_CLOSE = 1e-9  # a change of Newton's method, in lengths and rad, after which it has ended,
_ROUNDING = 0.6  # or the resolution of the numbers to this power: 7e-5 in single precision
_LEFT = 1e-2  # of that is allowed to what is foreseen to be left after a change
_NONE = 1e-9  # in the place of a change before the first
_MOST = 30  # changes for one share of the loads
_FAR = 1e3  # a change that leads nowhere, in lengths and rad
_LEAST = 1e-5  # share of the loads by which they rise at least
_IN_ALL = 600  # changes, for all shares
UPRIGHT = np.eye(4)[0]


class Around(NamedTuple):
    """What a rod rests in, in axes of the beam: how the hub moves, and loads."""

    velocity: Triple
    spin: Triple
    gravity: Triple  # less the acceleration of the hub, m/s^2
    load: TipLoad | None
    span: RodSpanForce | None

    def times(self, share: Scalar | float) -> "Around":
        """So much of all loads; those of inertia go with the square of velocities."""
        root = jnp.sqrt(share)
        loads = jax.tree.map(lambda a: share * a, (self.gravity, self.load, self.span))
        return Around(root * self.velocity, root * self.spin, *loads)


class Rod(eqx.Module):
    """A rod: elements, masses, supports."""

    tables: RodTables
    mass: Float[Array, "N N"]  # by velocities of nodes
    root: Held | None  # None: clamped
    tip: Held | None  # None: free
    length: Scalar

    @property
    def ends(self) -> list[tuple[int, Held]]:
        """Nodes that are on supports, and these."""
        return [(node, end) for node, end in ((0, self.root), (-1, self.tip)) if end is not None]

    @property
    def led_ends(self) -> list[tuple[int, Held]]:
        """Nodes on supports whose changes are led by what is free."""
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
        """q after a change of what is free."""
        u, p = self.nodes(q)
        every = self.spread(q, change)
        moved = u + jnp.einsum("nij,nj->ni", rotation(p), every[:, :3])
        return self.placed(moved, rotated(p, every[:, 3:]))

    def rates(self, q: Coordinates, change: Float[Array, " f"]) -> Coordinates:
        """How q begins to change."""
        return self.turning(self.nodes(q)[1], self.spread(q, change))

    def turning(
        self, p: Float[Array, "nodes 4"], rates: Float[Array, "nodes 6"]
    ) -> Coordinates:
        """How coordinates change where nodes with these quaternions do so, in their axes."""
        moving = jnp.einsum("nij,nj->ni", rotation(p), rates[:, :3])
        by_half = jnp.concatenate([jnp.zeros_like(p[:, :1]), rates[:, 3:] / 2], 1)
        return self.coordinates(moving, product(p, by_half))

    def spread(self, q: Coordinates, change: Float[Array, " f"]) -> Float[Array, "nodes 6"]:
        """Changes of all nodes from those that are free."""
        every = jnp.zeros(6 * len(self.tables.place), change.dtype)
        every = every.at[self.free].set(change, unique_indices=True).reshape(-1, 6)
        for node, basis in self._bases(q):
            every = every.at[node].set(basis @ every[node])
        return every

    def _bases(self, q: Coordinates) -> list[tuple[int, Float[Array, "6 6"]]]:
        """B of the ends that are led."""
        return [(node, end.basis(self.nodes(q)[1][node])) for node, end in self.led_ends]

    def led(self, q: Coordinates, matrix: Float[Array, "N N"]) -> Float[Array, "N N"]:
        """A matrix by changes of which, at ends, those that are free lead the others."""
        for node, basis in self._bases(q):
            own = slot(node)
            matrix = matrix.at[own].set(basis.T @ matrix[own])
            matrix = matrix.at[:, own].set(matrix[:, own] @ basis)
        return matrix

    # Velocities v are by changes that are free, at ends those of the undeformed rod, with turns times
    # the length: so their mass is constant.

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
        """Forces on nodes in their axes as those on velocities."""
        return self._units * self._led_back(force)

    def to_velocities(self, change: Float[Array, "nodes 6"]) -> Float[Array, " f"]:
        """Changes of nodes in their axes as those of which velocities are the rates."""
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
        """A matrix by velocities, after what these blocks make of changes of nodes."""
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


class Balance(NamedTuple):
    """A state looked at: what is out of balance, and the matrices of small motion about it, of all
    nodes, of which those that are free lead the root."""

    residual: Float[Array, "nodes 6"]
    stiffness: Float[Array, "N N"]
    gyroscopic: Float[Array, "N N"]
    elastic: Float[Array, "N N"]  # B^T S B, for damping
    strain: Float[Array, "E m"]
    by_changes: Float[Array, "E m l"]  # B


def balance(
    rod: Rod, q: Coordinates, around: Around, force: Float[Array, "E m"] | None = None,
    rests: Bool[Array, ""] | bool = False,
) -> Balance:  # fmt: skip
    """The state q; with `force` the tangent has that in sections, the residual its own, unless the
    rod `rests`."""
    tables = rod.tables
    u, p = rod.nodes(q)
    state = bent(tables, u, p)
    shape, by = state.strain.shape, by_changes(tables, state)
    strain = state.strain.reshape(len(by), -1)
    own = jnp.einsum("eij,ej->ei", tables.stiffness, strain)
    used = own if force is None else jnp.where(rests, own, force)
    on_nodes = nodal(tables, state, own.reshape(shape))
    kept = on_nodes if force is None else nodal(tables, state, used.reshape(shape))
    elastic = tables.assembled(by.swapaxes(1, 2) @ tables.stiffness @ by)
    bending = tables.assembled(geometric(tables, state, used.reshape(shape)))
    still = Still(u, p, rotation(p), around.velocity, around.spin)
    moving = carried_along(rod.mass, velocities(tables, still))
    loads = acting(tables, still, around.gravity, around.load, around.span)
    conservative = tables.gathered(kept) - moving.force - loads.conservative
    residual = tables.gathered(on_nodes) - moving.force - loads.force
    stiffness = elastic + bending + moving.stiffness + loads.stiffness
    for node, end in rod.ends:
        push, held, alone = end.acting(u[node], p[node])
        residual, conservative = (a.at[node].add(push) for a in (residual, conservative))
        at = slot(node)
        stiffness, elastic = (a.at[at, at].add(b) for a, b in ((stiffness, held), (elastic, alone)))
    # The derivative of a force that has a potential, by changes in turning axes, is symmetric but
    # for half of what turns the force: zero where it is.
    stiffness = stiffness + on_diagonal(twisting(conservative)) / 2
    stiffness, gyroscopic, elastic = (
        rod.led(q, matrix) for matrix in (stiffness, moving.gyroscopic, elastic)
    )
    for node, end in rod.led_ends:
        at = slot(node)
        stiffness = stiffness.at[at, at].add(end.by_reaction(p[node], residual[node]))
        residual = residual.at[node].set(end.basis(p[node]).T @ residual[node])
    return Balance(residual, stiffness, gyroscopic, elastic, strain, by)


class _Search(NamedTuple):
    q: Coordinates
    force: Float[Array, "E m"]
    kept: Coordinates  # of the largest share that is settled
    kept_force: Float[Array, "E m"]
    settled: Scalar
    rise: Scalar
    tries: Array  # at this share
    in_all: Array
    before: Scalar  # the last change, in lengths and rad
    matrices: tuple[Float[Array, "N N"], Float[Array, "N N"]]  # of the state that was looked at


class Settled(NamedTuple):
    """Where a rod rests, without derivatives, the share of loads that was reached (1: all), and the
    matrices of small motion about it."""

    q: Coordinates
    share: Scalar
    gyroscopic: Float[Array, "N N"]
    stiffness: Float[Array, "N N"]


def settled(rod: Rod, around: Around) -> Settled:
    """Where the rod rests; on a CPU each case of a batch by itself, by its own number of steps."""
    arrays, rest = eqx.partition((rod, around), eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)

    def one(*leaves: Array) -> Settled:
        return _settled(*eqx.combine(jax.tree.unflatten(structure, leaves), rest))

    return Settled(*one_by_one(one)(*leaves))


def _settled(rod: Rod, around: Around) -> Settled:
    """The state of rest of one case.

    Newton's method with forces in sections for unknowns beside the coordinates (D. Magisano and
    others, International Journal for Numerical Methods in Engineering 2017): the tangent has forces
    as they were foreseen, so that what is stiff axially does not shorten steps. Loads rise in
    steps where one will not do. The last state is looked at once more, for its matrices.
    """
    tables, free = rod.tables, rod.free
    one = jnp.ones((), tables.place.dtype)
    rest = jnp.zeros(7 * len(tables.place), one.dtype)
    none = jnp.zeros(tables.stiffness.shape[:2], one.dtype)
    scale = jnp.asarray(np.resize([1.0] * 3 + [0.0] * 3, 6 * len(tables.place))[free])
    scale = jnp.where(scale > 0, 1 / rod.length, 1.0)
    close = max(_CLOSE, float(jnp.finfo(one.dtype).eps) ** _ROUNDING)

    def body(now: _Search) -> _Search:
        rests = now.settled >= 1
        share = jnp.minimum(now.settled + now.rise, 1.0)
        here = balance(rod, now.q, around.times(share), now.force, rests)
        out = here.residual.reshape(-1)[free]
        change = -solve(here.stiffness[np.ix_(free, free)], out)
        if rod.root is not None:  # which may be held by nothing, and need not be
            change = jnp.where(jnp.any(out != 0), change, 0.0)
        size = jnp.max(jnp.abs(scale * change))
        by_elements = tables.of_elements(rod.spread(now.q, change)).reshape(len(none), -1)
        strain = here.strain + jnp.einsum("eml,el->em", here.by_changes, by_elements)
        force = jnp.einsum("eij,ej->ei", tables.stiffness, strain)
        q = rod.changed(now.q, change)
        # What is left after a change is less than it by as much as that is less than the one before
        # it, at least.
        ended = (size < close) | (size * size < _LEFT * close * now.before)
        lost = ~ended & (~(size < _FAR) | (now.tries >= _MOST))

        def pick(a: Any, b: Any, c: Any) -> Any:
            return jnp.where(rests, c, jnp.where(ended, a, jnp.where(lost, b, c)))

        return _Search(
            jnp.where(rests, now.q, pick(q, now.kept, q)),
            pick(force, now.kept_force, force),
            pick(q, now.kept, now.kept),
            pick(force, now.kept_force, now.kept_force),
            pick(share, now.settled, now.settled),
            pick(2 * now.rise, now.rise / 4, now.rise),
            pick(0, 0, now.tries + 1),
            jnp.where(rests, _IN_ALL, now.in_all + 1),
            pick(_NONE, _NONE, size),
            (here.gyroscopic, here.stiffness),
        )

    def go_on(now: _Search) -> Array:
        more: Array = (now.rise > _LEAST) & (now.in_all < _IN_ALL)
        return more

    zero = jnp.asarray(0)
    matrix = jnp.zeros((6 * len(tables.place),) * 2, one.dtype)
    first = _Search(
        rest, none, rest, none, 0 * one, one, zero, zero, 0 * one + _NONE, (matrix, matrix)
    )
    end = jax.lax.while_loop(go_on, body, first)
    return Settled(end.kept, end.settled, *end.matrices)


@eqx.filter_custom_jvp
def differentiable(q: Coordinates, pair: "_Pair", given: tuple[Rod, Around]) -> Coordinates:
    """A state that is settled, by the matrices of small motion about it, with its derivatives by
    all that it rests in: K dh = -dr."""
    return q


@differentiable.def_jvp
def _differentiable_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    # Through the function itself, not its argument: then this rule can be differentiated again.
    q, (_, pair, given) = differentiable(*primals), primals
    rod = given[0]

    def residual(given: tuple[Rod, Around]) -> Float[Array, " f"]:
        return balance(given[0], q, given[1]).residual.reshape(-1)[rod.free]

    out = pushed(residual, given, tangents[2])
    stiffness = matrices_with_derivatives(pair, (q, *given))[1][np.ix_(rod.free, rod.free)]
    if rod.root is not None:  # what nothing holds at rest, where nothing acts, stays as it is
        stiffness = stiffness + jnp.diag(_hair(stiffness))
    change = -solve(stiffness, out)
    return q, rod.rates(q, change)


_Pair = tuple[Float[Array, "N N"], Float[Array, "N N"]]


@eqx.filter_custom_jvp
def matrices_with_derivatives(pair: _Pair, given: tuple[Coordinates, Rod, Around]) -> _Pair:
    """The matrices of rates and of stiffness of small motion about a state that is settled, with
    their derivatives by it and by all that it rests in."""
    return pair


@matrices_with_derivatives.def_jvp
def _matrices_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
    def matrices(given: tuple[Coordinates, Rod, Around]) -> _Pair:
        q, rod, around = given
        here = balance(rod, q, around)
        return here.gyroscopic, here.stiffness

    out = matrices_with_derivatives(*primals)
    return out, pushed(matrices, primals[1], tangents[1])


def pushed(function: Callable[[Any], Any], given: Any, rates: Any) -> Any:
    """What a function of a tree does to rates of its numbers, of which some may be None."""
    rates = jax.tree.map(
        lambda t, a: jnp.zeros_like(a) if t is None and eqx.is_inexact_array(a) else t,
        rates, given, is_leaf=lambda part: part is None,
    )  # fmt: skip
    arrays, rest = eqx.partition(given, eqx.is_inexact_array)
    rates = eqx.filter(rates, eqx.is_inexact_array)
    closed, out = jax.make_jaxpr(
        lambda arrays: function(eqx.combine(arrays, rest)), return_shape=True
    )(arrays)
    needed = jaxpr_as_fun(without_dead_parts(closed))  # of a `balance` that is the smaller part
    at, by = jax.tree.leaves(arrays), jax.tree.leaves(rates)
    return jax.tree.unflatten(jax.tree.structure(out), jax.jvp(needed, at, by)[1])


def _hair(stiffness: Float[Array, "f f"]) -> Float[Array, " f"]:
    """What is rounding to the diagonal of a stiffness, and keeps it regular."""
    return jax.lax.stop_gradient(jnp.finfo(stiffness.dtype).eps * jnp.abs(jnp.diagonal(stiffness)))
