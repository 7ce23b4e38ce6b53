"""Algebra of nodes that have positions and slopes, in the words of `elements.py`."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._numerics.blocks import padded
from jaxbeam._types import Triple

PlanarNodes = Float[Array, "k 2 2 *lanes"]  # in m: value and L times slope


def on_ends(n: int, force: Float[Array, "c 3 *rest"]) -> Float[Array, "c 4 *rest"]:
    """Forces on values and slopes of both ends from those on gradients, see `Element`: the
    transpose of `_gradients`, but for the length."""
    chord = n * force[:, 1:2]
    return jnp.concatenate([-chord, force[:, :1], chord, force[:, 2:]], 1)


def of_elements(nodes: PlanarNodes) -> Float[Array, "E 2 4 *lanes"]:
    """Values and slopes at both nodes of every element."""
    return jnp.concatenate([nodes[:-1], nodes[1:]], 2)


def constant(vector: Triple) -> Float[Array, "1 2 2 *lanes"]:
    """Nodal values of a constant field."""
    value = jnp.stack([vector[1], vector[0]])
    return jnp.stack([value, jnp.zeros_like(value)], 1)[None]


def quarter_turned(nodes: PlanarNodes) -> PlanarNodes:
    """A field turned by a quarter: `QUARTER_TURN` applied at every node."""
    return jnp.concatenate([nodes[:, 1:], -nodes[:, :1]], 1)


def assembled(local: Float[Array, "E 2 4 2 4 *lanes"]) -> Float[Array, "k 4 12 *lanes"]:
    """Rows of blocks, see `BlockTridiagonal`."""
    n, lanes = len(local), local.shape[5:]
    # Rows by end, component, value and slope; columns the same.
    ends = local.reshape(n, 2, 2, 2, 2, 2, 2, *lanes)
    axes = (2, 0, 1, 3, 5, 4, 6)
    first, last = ends.transpose(*axes, *range(7, ends.ndim)).reshape(2, n, 4, 8, *lanes)
    beyond = jnp.zeros_like(first[:, :, :4])
    first = padded(jnp.concatenate([beyond, first], 2), 0, 1)
    last = padded(jnp.concatenate([last, beyond], 2), 1, 0)
    return first + last
