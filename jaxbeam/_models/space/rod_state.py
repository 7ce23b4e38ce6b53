"""States of a rod that rests in its hub: force, tangents, and the search for where they balance.

Coordinates and their changes are those of `rod_nodes.py`.
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
from jaxbeam._models.space.rod_nodes import Rod, slot
from jaxbeam._numerics.linalg import solve
from jaxbeam._numerics.quaternions import rotation
from jaxbeam._programs.batches import one_by_one
from jaxbeam._programs.one_function import without_dead_parts
from jaxbeam._rotor.loads import TipLoad
from jaxbeam._types import Coordinates, Scalar, Triple

_CLOSE = 1e-9  # a change of Newton's method, in lengths and rad, after which it has ended,
_ROUNDING = 0.6  # or the resolution of the numbers to this power: 7e-5 in single precision
_LEFT = 1e-2  # of that is allowed to what is foreseen to be left after a change
_NONE = 1e-9  # in the place of a change before the first
_MOST = 30  # changes for one share of the loads
_FAR = 1e3  # a change that leads nowhere, in lengths and rad,
_SWING = 0.5  # and of a root, which turns by no more at once: else it might come to another state
_LEAST = 1e-5  # share of the loads by which they rise at least
_IN_ALL = 600  # changes, for all shares


class Around(NamedTuple):
    """The surroundings of a rod, in axes of the beam: the motion of the hub, and loads."""

    velocity: Triple
    spin: Triple
    gravity: Triple  # less the acceleration of the hub, m/s^2
    load: TipLoad | None
    span: RodSpanForce | None

    def times(self, share: Scalar | float) -> "Around":
        """A share of all loads; those of inertia go with the square of velocities."""
        root = jnp.sqrt(share)
        loads = jax.tree.map(lambda a: share * a, (self.gravity, self.load, self.span))
        return Around(root * self.velocity, root * self.spin, *loads)


class Balance(NamedTuple):
    """A state and its balance: the residual, and the matrices of small motion about the state, of
    all nodes, of which those that are free lead the root."""

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
    """The balance of the state q; with `force` the tangent has that in sections, the residual its
    own, unless the rod `rests`."""
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


class _NewtonState(NamedTuple):
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
    """A state of rest, without derivatives, the share of loads that was reached (1: all), and the
    matrices of small motion about it."""

    q: Coordinates
    share: Scalar
    gyroscopic: Float[Array, "N N"]
    stiffness: Float[Array, "N N"]


def settled(rod: Rod, around: Around) -> Settled:
    """The state of rest of a rod; on a CPU each case of a batch by itself, by its own number of
    steps."""
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
    swings = np.flatnonzero((free >= 3) & (free < 6))  # turns of the root
    close = max(_CLOSE, float(jnp.finfo(one.dtype).eps) ** _ROUNDING)

    def body(now: _NewtonState) -> _NewtonState:
        rests = now.settled >= 1
        share = jnp.minimum(now.settled + now.rise, 1.0)
        here = balance(rod, now.q, around.times(share), now.force, rests)
        out = here.residual.reshape(-1)[free]
        change = -solve(here.stiffness[np.ix_(free, free)], out)
        if rod.root is not None:  # which may be held by nothing, and need not be
            change = jnp.where(jnp.any(out != 0), change, 0.0)
        swing = jnp.max(jnp.abs(change[swings]), initial=0.0)
        part = jnp.minimum(1.0, _SWING / jnp.maximum(swing, _SWING))
        change = part * change
        size = jnp.max(jnp.abs(scale * change))
        by_elements = tables.of_elements(rod.spread(now.q, change)).reshape(len(none), -1)
        strain = here.strain + jnp.einsum("eml,el->em", here.by_changes, by_elements)
        force = jnp.einsum("eij,ej->ei", tables.stiffness, strain)
        q = rod.changed(now.q, change)
        # What is left after a change is less than it by as much as that is less than the one before
        # it, at least.
        ended = (size < close) | (size * size < _LEFT * close * now.before) & (part == 1)
        lost = ~ended & (~(size < _FAR) | (now.tries >= _MOST))

        def pick(a: Any, b: Any, c: Any) -> Any:
            return jnp.where(rests, c, jnp.where(ended, a, jnp.where(lost, b, c)))

        return _NewtonState(
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

    def go_on(now: _NewtonState) -> Array:
        more: Array = (now.rise > _LEAST) & (now.in_all < _IN_ALL)
        return more

    zero = jnp.asarray(0)
    matrix = jnp.zeros((6 * len(tables.place),) * 2, one.dtype)
    first = _NewtonState(
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

    out = rates_of(residual, given, tangents[2])
    stiffness = matrices_with_derivatives(pair, (q, *given))[1][np.ix_(rod.free, rod.free)]
    if rod.root is not None:  # what nothing holds at rest, where nothing acts, stays as it is
        stiffness = stiffness + jnp.diag(_rounding(stiffness))
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
    return out, rates_of(matrices, primals[1], tangents[1])


def rates_of(function: Callable[[Any], Any], given: Any, rates: Any) -> Any:
    """The rates of a function of a tree by rates of its numbers, of which some may be None."""
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


def _rounding(stiffness: Float[Array, "f f"]) -> Float[Array, " f"]:
    """The rounding of the diagonal of a stiffness, which keeps it regular."""
    return jax.lax.stop_gradient(jnp.finfo(stiffness.dtype).eps * jnp.abs(jnp.diagonal(stiffness)))
