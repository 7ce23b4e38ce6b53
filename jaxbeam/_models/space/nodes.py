"""Algebra of nodes that have positions, slopes and twist, in the words of
`_models/space/elements.py`."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._numerics.blocks import padded
from jaxbeam._programs.lanes import append_axes

SpatialNodes = Float[Array, "k 2 4 *#lanes"]  # in m: value and L times slope, by component
# Components of a node: those that a clamped root has not come first, see `SpatialEquations`.
Ways = tuple[int, int, int, int]
LAG_FIRST, FLAP_FIRST = (1, 2, 0, 3), (2, 1, 0, 3)  # 0, 1, 2: along a1, a2, a3; 3: twist


def components(in_plane_yields: bool, flap_yields: bool) -> tuple[Ways, int]:
    """The order of components of a node, and how many numbers of the first one are not
    coordinates."""
    ways = FLAP_FIRST if in_plane_yields and not flap_yields else LAG_FIRST
    return ways, 6 - in_plane_yields - flap_yields


def of_elements(nodes: SpatialNodes) -> Float[Array, "E 2 2 4 *#lanes"]:
    """Values and slopes at both nodes of every element."""
    return jnp.stack([nodes[:-1], nodes[1:]], 1)


def mass_rows(local: Float[Array, "E 4 4"], at_tip: Float[Array, "2 2"]) -> Float[Array, "k 2 3 2"]:
    """Mass matrix of one component of all nodes, from those of elements and what is at the tip, by
    rows of blocks: below, own, above."""
    ends = local.reshape(-1, 2, 2, 2, 2)  # end, value and slope; the same
    none = jnp.zeros_like(ends[:, 0, :, 0])
    first = jnp.stack([none, ends[:, 0, :, 0], ends[:, 0, :, 1]], 2)
    last = jnp.stack([ends[:, 1, :, 0], ends[:, 1, :, 1], none], 2)
    rows = padded(first, 0, 1) + padded(last, 1, 0)
    tip = jnp.stack([jnp.zeros_like(at_tip), at_tip, jnp.zeros_like(at_tip)], 1)[None]
    return rows + padded(tip, len(local), 0)


def mixed_rows(
    gram: Float[Array, "k 2 3 2 *#lanes"], mixing: Any
) -> Float[Array, "k 8 24 *#lanes"]:
    """Rows of blocks for all components, which `mixing` (4, 4, *lanes) mixes."""
    lanes = gram.ndim - 4
    mixing = append_axes(mixing, lanes - (mixing.ndim - 2))
    rows = gram[:, :, None, :, :, None] * mixing[None, None, :, None, None]
    return rows.reshape(len(gram), 8, 24, *rows.shape[6:])


def assembled(local: Float[Array, "E 16 16 *#lanes"]) -> Float[Array, "k 8 24 *#lanes"]:
    """Rows of blocks, see `BlockTridiagonal`, from the matrices of elements."""
    beyond = jnp.zeros_like(local[:, :8, :8])
    first = padded(jnp.concatenate([beyond, local[:, :8]], 2), 0, 1)
    last = padded(jnp.concatenate([local[:, 8:], beyond], 2), 1, 0)
    return first + last
