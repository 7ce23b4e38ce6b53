"""Labels of modes: the uncoupled mode that a coupled one has most of."""

import itertools
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Inexact, Int

from jaxbeam._models.contract.linear_system import SystemPart
from jaxbeam._numerics.linalg import solve_columns, symmetric_modes
from jaxbeam._numerics.loose import shift, symmetric_part
from jaxbeam._rotor.directions import Direction


def uncoupled(part: SystemPart, free: int, bent: bool) -> Float[Array, "n n"]:
    """The products M v of the uncoupled modes v of a part of a system, of unit modal mass, as
    columns.

    Modes are uncoupled by direction, but some motions follow others statically. About states that
    are `bent` axial motion follows bending, since a bent beam that only moved across would stretch.
    All other motion follows torsion, since coupled sections or a curved axis would hold torsion
    alone by their stiffness. Rigid-body motion of a root that yields (`taken_along` of
    `LinearSystem`) is part of the direction of the root: flap about an inclined hinge pitches the
    beam without torsion.
    """
    m, k, taken_along = part.mass, symmetric_part(part.stiffness), part.taken_along
    if taken_along is not None:
        rigid = jnp.eye(len(m), dtype=m.dtype) + taken_along
        m, k = (symmetric_part(rigid.T @ a @ rigid) for a in (m, k))
    ends = itertools.pairwise(np.cumsum([0, *part.sizes]))
    places = {f: slice(*each) for f, each in zip(part.directions, ends, strict=True)}
    axial = places.get(Direction.AXIAL)
    every = np.arange(len(m))
    alike: dict[int, list[Any]] = {}  # eigenproblems by size, each of which is compiled once
    for direction, own in places.items():
        unit = jnp.eye(len(m), dtype=m.dtype)[:, own]
        follows = every[:0]
        if direction == Direction.TORSION:
            follows = np.setdiff1d(every, every[own])
        elif bent and axial is not None and direction != Direction.AXIAL:
            follows = every[axial]
        if not follows.size:
            heavy, inertia, stiffness = unit @ m[own, own], m[own, own], k[own, own]
        else:
            both = np.ix_(follows, follows)
            along = k[both]
            if free:  # which nothing may hold
                along = along + shift(m[both], along, free) * m[both]
            with_it = solve_columns(along, k[follows, own])
            moved = unit - jnp.eye(len(m), dtype=m.dtype)[:, follows] @ with_it
            heavy = m @ moved
            inertia, stiffness = (symmetric_part(moved.T @ a @ moved) for a in (m, k))
        alike.setdefault(unit.shape[1], []).append((own, heavy, inertia, stiffness))
    out = jnp.zeros_like(m)
    for each in alike.values():
        stacks = tuple(jnp.stack([one[i] for one in each]) for i in (2, 3))
        found = jax.lax.map(lambda pair: symmetric_modes(pair[0], pair[1], free), stacks)
        for (own, heavy, *_), v in zip(each, found, strict=True):
            out = out.at[:, own].set(heavy @ v.T)
    # What takes others along is taken along by nothing: the inverse of 1 + N is 1 - N.
    return out if taken_along is None else out - taken_along.T @ out


def participation(x: Inexact[Array, "k n"], heavy: Float[Array, "n n"]) -> Float[Array, "k n"]:
    """Share of the kinetic energy of each coupled mode, a row of x, in each uncoupled mode v, with
    `heavy` the columns M v."""
    share = jnp.abs(x @ heavy) ** 2
    return share / jnp.sum(share, axis=1, keepdims=True)


def assigned(share: Float[Array, "n n"]) -> Int[Array, " n"]:
    """The column assigned to each row: that of the largest entry of all, then of the largest left,
    each row and column once.

    All pairs that are each other's largest entries are assigned at once: the result is the same,
    after a few rounds instead of n.
    """
    n = share.shape[0]

    def body(state: tuple[Array, Array]) -> tuple[Array, Array]:
        left, column = state
        preferred = jnp.argmax(left, axis=1)
        mutual = (column < 0) & (jnp.argmax(left, axis=0)[preferred] == jnp.arange(n))
        taken = jnp.any(mutual[:, None] & (preferred[:, None] == jnp.arange(n)[None]), axis=0)
        left = jnp.where(mutual[:, None] | taken[None], -1.0, left)
        return left, jnp.where(mutual, preferred, column)

    # With NaN, from a case that failed, the loop would not end.
    start = jnp.where(jnp.isnan(share), 0.0, share)
    return jax.lax.while_loop(lambda state: jnp.any(state[1] < 0), body, (start, jnp.full(n, -1)))[
        1
    ]


def ranked(label: Int[Array, " k"], sizes: Sequence[int]) -> Int[Array, " k"]:
    """Labels, as indices of coordinates ordered by direction with these sizes, renumbered within
    each direction in the order of the modes: where two modes of a direction come near they exchange
    their motion, not their numbers."""
    ends = np.cumsum(sizes)
    direction = jnp.sum(label[:, None] >= ends[None], 1)
    alike = direction[:, None] == direction[None]
    before = jnp.sum(alike & np.tri(len(label), k=-1, dtype=bool), 1)
    return jnp.asarray(ends - np.asarray(sizes))[direction] + before
