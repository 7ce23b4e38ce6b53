"""Shapes that recur in signatures, under one name each; and whether numbers are concrete."""

from typing import Any

import jax
from jaxtyping import Array, Complex, Float, Int

Scalar = Float[Array, ""]
Real = float | Scalar  # what a user may give where a scalar is wanted
Code = Int[Array, ""]
Number = Float[Array, "*#lanes"]  # one number for each lane, or of length 1 for all lanes
Matrix = Float[Array, "n n *#lanes"]
Vector = Float[Array, "n *lanes"]  # one number for each coordinate, with lanes behind
Coordinates = Float[Array, "q *lanes"]  # those of a rod are more than its velocities, n
Vectors = Complex[Array, "k n"]
Triple = Float[Array, "3 *lanes"]  # components along a1 (the beam), a2 (in plane), a3 (the axis)


def is_concrete(tree: Any) -> bool:
    """Whether the numbers of a pytree can be seen; under `jit`, `vmap`, `grad` they may not."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(tree))
