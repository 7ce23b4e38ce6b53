"""Motions and functions of time with all that they close over as leaves."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxbeam._rotor.motion import Hub, Motion, Times
from jaxbeam._types import Scalar, Triple


class TracedMotion(Motion):
    """A motion by functions of time that have been traced: a program without the user's
    functions."""

    program: Callable[[Scalar], Hub]
    changes: Array
    jumps: Array

    def velocities(self, t: Scalar) -> tuple[Triple, Triple]:
        hub = self.program(t)
        return hub.velocity, hub.angular_velocity

    def hub(self, t: Scalar, gravity: Triple | None) -> Hub:
        return self.program(t)

    def change_times(self) -> Times:
        return self.changes

    def jump_times(self) -> Times:
        return self.jumps


def converted(part: Any, t: Scalar) -> Any:
    """A function of time as a pytree whose leaves are all its numbers, those that it closes over
    too, but not those of default arguments, which would be one for all cases."""

    def at(t: Scalar) -> Array:
        return jnp.asarray(part(t))

    return eqx.filter_closure_convert(at, t) if callable(part) else part
