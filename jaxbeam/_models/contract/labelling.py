"""Which uncoupled mode a coupled one is like: what labels of modes are."""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxbeam._numerics.linalg import solve_columns, symmetric_modes
from jaxbeam._numerics.loose import shift, symmetric_part
from jaxbeam._rotor.directions import Direction


def participation(
    m: Array, k: Array, x: Array, directions: Sequence[Direction], sizes: Sequence[int], free: int,
    bent: bool,
) -> Float[Array, "n n"]:  # fmt: skip
    """Share of the kinetic energy of coupled mode i that lies in uncoupled mode j; `sizes` are
    those of the directions, one behind the other. About states that are `bent` axial motion follows
    bending: a beam that may only move across cannot but stretch."""
    parts, ends = [], np.cumsum([0, *sizes])
    places = {f: slice(*each) for f, each in zip(directions, itertools.pairwise(ends), strict=True)}
    axial = places.get(Direction.AXIAL)
    for direction, part in places.items():
        follows = bent and axial is not None and direction in (Direction.IN_PLANE, Direction.FLAP)
        unit = jnp.eye(len(m), dtype=m.dtype)[:, part]
        if not follows:
            v = symmetric_modes(m[part, part], k[part, part], free)
            parts.append(jnp.abs(x[:, part] @ m[part, part] @ v.T) ** 2)
            continue
        assert axial is not None
        along = k[axial, axial]
        if free:  # which nothing may hold
            along = along + shift(m[axial, axial], along, free) * m[axial, axial]
        with_it = solve_columns(along, k[axial, part])
        moved = unit - jnp.eye(len(m), dtype=m.dtype)[:, axial] @ with_it
        inertia, stiffness = (moved.T @ a @ moved for a in (m, k))
        v = symmetric_modes(symmetric_part(inertia), symmetric_part(stiffness), free)
        parts.append(jnp.abs(x @ m @ (moved @ v.T)) ** 2)
    share = jnp.concatenate(parts, axis=1)
    return share / jnp.sum(share, axis=1, keepdims=True)


def assigned(share: Float[Array, "n n"]) -> Int[Array, " n"]:
    """Column for each row: the largest entry first, each row and column used once.

    All pairs that prefer each other are settled at once, which ends in the same assignment as
    taking the largest entry left, in a few rounds instead of n.
    """
    n = share.shape[0]

    def body(state: tuple[Array, Array]) -> tuple[Array, Array]:
        left, column = state
        preferred = jnp.argmax(left, axis=1)
        mutual = (column < 0) & (jnp.argmax(left, axis=0)[preferred] == jnp.arange(n))
        taken = jnp.any(mutual[:, None] & (preferred[:, None] == jnp.arange(n)[None]), axis=0)
        left = jnp.where(mutual[:, None] | taken[None], -1.0, left)
        return left, jnp.where(mutual, preferred, column)

    # NaN, from a case that failed, would never settle.
    start = jnp.where(jnp.isnan(share), 0.0, share)
    return jax.lax.while_loop(lambda state: jnp.any(state[1] < 0), body, (start, jnp.full(n, -1)))[
        1
    ]
