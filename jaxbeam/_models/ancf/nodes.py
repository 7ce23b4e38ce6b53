"""Algebra of nodal values: position and L times slope, for each component across and along."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._numerics.blocks import padded
from jaxbeam._types import Triple

PlanarNodes = Float[Array, "k 2 2 *lanes"]  # k nodes, components a2 and a1, value and L slope, m


def on_ends(n: int, force: Float[Array, "c 3 *rest"]) -> Float[Array, "c 4 *rest"]:
    """Forces on values and slopes at both ends of one of n elements from those on its three
    gradients (see `energies.py`): the transpose of `ElementEquations._gradients`, times L."""
    chord = n * force[:, 1:2]
    return jnp.concatenate([-chord, force[:, :1], chord, force[:, 2:]], 1)


def element_values(nodes: PlanarNodes) -> Float[Array, "E 2 4 *lanes"]:
    """Nodal values element by element: value and slope at its first and at its last node."""
    return jnp.concatenate([nodes[:-1], nodes[1:]], 2)


def constant(vector: Triple) -> Float[Array, "1 2 2 *lanes"]:
    """Nodal values of a constant field, from its components (a1, a2, a3)."""
    value = jnp.stack([vector[1], vector[0]])
    return jnp.stack([value, jnp.zeros_like(value)], 1)[None]


def quarter_turned(nodes: PlanarNodes) -> PlanarNodes:
    """Nodal values of a field turned by a right angle: `QUARTER_TURN` applied at every node."""
    return jnp.concatenate([nodes[:, 1:], -nodes[:, :1]], 1)


def assembled(local: Float[Array, "E 2 4 2 4 *lanes"]) -> Float[Array, "k 4 12 *lanes"]:
    """The block-tridiagonal matrix of k nodes, in rows of blocks (see `BlockTridiagonal`), from
    those of E = k - 1 elements."""
    n, lanes = len(local), local.shape[5:]
    # Axes of rows, and of columns: component; end of the element; value and slope.
    ends = local.reshape(n, 2, 2, 2, 2, 2, 2, *lanes)
    axes = (2, 0, 1, 3, 5, 4, 6)
    first, last = ends.transpose(*axes, *range(7, ends.ndim)).reshape(2, n, 4, 8, *lanes)
    zeros = jnp.zeros_like(first[:, :, :4])
    first = padded(jnp.concatenate([zeros, first], 2), 0, 1)
    last = padded(jnp.concatenate([last, zeros], 2), 1, 0)
    return first + last
