"""Events that end a run: what is asked at the end of each step."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from jaxbeam._results import without_derivatives
from jaxbeam._solvers.system import State
from jaxbeam._types import Scalar


class Events(NamedTuple):
    """Conditions, functions of t and y, and the direction of each; no derivatives are taken."""

    conditions: list[Callable[[Scalar, State], Any]]
    directions: list[bool | None]

    def values(self, t: Scalar, y: State) -> list[Array]:
        """The value of each condition."""
        return [jnp.asarray(f(*without_derivatives((t, y)))) for f in self.conditions]

    def happened(self, before: list[Array], values: list[Array]) -> list[Array]:
        """The mask of conditions that a step meets that ends at these values."""
        return [_happened(*each) for each in zip(self.directions, before, values, strict=True)]


def _happened(direction: bool | None, before: Array, value: Array) -> Array:
    """Whether an event happened: a truth, or a change of sign in the direction that is asked
    for."""
    if value.dtype == bool:
        return value
    if direction is None:
        return jnp.sign(before) != jnp.sign(value)
    if direction:
        return (before <= 0) & (value > 0)
    return (before > 0) & (value <= 0)
