"""Sections at points of an element in space, turned from the frames of least rotation."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from jaxbeam._models.space.points import Points

# Moments of twist and of bending about the axes before the turn (3, g), and what goes with them on
# the turn and on its rate (g).
Way = tuple[Array, Array, Array]


class Rotated(NamedTuple):
    """Points, the cosine and the sine of the turn there, and its rate."""

    points: Points
    cos: Array
    sin: Array
    rate: Array

    def before_turn(self, v: Array, w: Array) -> tuple[Array, Array]:
        """Moments about the axes before the turn, from those about the axes of the section."""
        return self.cos * v - self.sin * w, self.sin * v + self.cos * w

    def strain_ways(self, strains: Array) -> list[Way]:
        """How twist and curvatures of the section go with r', turn, L r'' and rate."""
        _, v, w = strains
        none, one = jnp.zeros_like(v), jnp.ones_like(v)
        return [
            (jnp.stack([one, none, none]), none, one),
            (jnp.stack([none, self.cos, self.sin]), w, none),
            (jnp.stack([none, -self.sin, self.cos]), -v, none),
        ]

    def moment_ways(self, moments: Array, on_turn: Array) -> list[Way]:
        """The way of the moments, and that of its change with the turn if they stay as they are."""
        (twist, second, third), (_, k2, k3) = moments, self.points.seen
        none = jnp.zeros_like(twist)
        later = jnp.stack([none, -third, second])
        return [(moments, on_turn, twist), (later, -second * k2 - third * k3, none)]
