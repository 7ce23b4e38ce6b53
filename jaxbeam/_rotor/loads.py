"""What acts on the beam beside its hub: gravity, a force at the tip, damping."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import real_array, real_scalar, require
from jaxbeam._rotor.motion import (
    Times,
    check_function_of_time,
    function_of_time,
    no_times,
    time_list,
)
from jaxbeam._status import Status
from jaxbeam._types import Real, Scalar, Triple, is_known


class Loads(eqx.Module):
    """External loads, none by default.

    | field     | unit  |                                                                        |
    |-----------|-------|------------------------------------------------------------------------|
    | gravity   | m/s^2 | shape (3,), in inertial axes: those of the hub at angle zero           |
    | tip_force | N     | shape (3,) or a function of time to (3,), in hub axes: a1, a2, a3      |
    | changes   | s     | times at which `tip_force` begins or ends something smoothly           |
    | jumps     | s     | times at which `tip_force` jumps                                       |

    A force along the beam stiffens it in tension and softens it in compression in every model
    that knows of `Rotor.tension`. A callable that is a pytree carries its parameters as leaves.
    Steps end at the times declared; a pulse that is shorter than a thousandth of a run may be
    passed over if it is not declared.
    """

    gravity: Triple | None
    tip_force: Triple | Callable[[Scalar], Triple] | None
    changes: Times | None
    jumps: Float[Array, " j"] | None

    def __init__(
        self, gravity: Any = None, tip_force: Any = None, changes: Any = (), jumps: Any = ()
    ) -> None:
        # No arrays where there are none, so that `NO_LOADS` starts no backend of JAX.
        self.changes = time_list("changes", changes) if np.size(changes) else None
        self.jumps = time_list("jumps", jumps) if np.size(jumps) else None
        self.gravity = None if gravity is None else _triple("gravity", gravity)
        if callable(tip_force):
            check_function_of_time("tip_force", tip_force, (3,))
            self.tip_force = function_of_time(tip_force)
        else:
            self.tip_force = None if tip_force is None else _triple("tip_force", tip_force)

    def at_tip(self, t: Scalar) -> Triple | None:
        """Force at the tip at time t."""
        force = self.tip_force
        return jnp.asarray(force(t)) if callable(force) else force

    def change_times(self) -> Times:
        """The times that were given as `changes`."""
        return no_times() if self.changes is None else self.changes

    def jump_times(self) -> Times:
        """The times that were given as `jumps`."""
        return no_times() if self.jumps is None else self.jumps


class Damping(eqx.Module):
    """Proportional damping: forces -(mass dT/dq' + stiffness d/dt elastic_force(q)).

    `mass` in 1/s, `stiffness` in s, both >= 0: a mode of frequency w at rest has the damping ratio
    (mass / w + stiffness w) / 2. T is the kinetic energy seen from the hub. Stiffness damping is of
    the coordinates of a model: `DiscreteNC` and `DiscreteNP` agree in it to first order only. None
    leaves a term out.
    """

    mass: Scalar | None
    stiffness: Scalar | None

    def __init__(self, mass: Real | None = None, stiffness: Real | None = None) -> None:
        self.mass = _rate("mass", mass)
        self.stiffness = _rate("stiffness", stiffness)


def _rate(name: str, value: Any) -> Scalar | None:
    if value is None:
        return None
    value = real_scalar(f"damping {name}", value)
    if is_known(value):
        number = float(np.asarray(value))
        require(Status.INVALID_DAMPING, bool(np.isfinite(number)) and number >= 0, number)
    return value


def _triple(name: str, value: Any) -> Triple:
    vector = real_array(name, value)
    if vector.shape != (3,):
        raise ValueError(f"{name} must have shape (3,), got {vector.shape}")
    if is_known(vector):
        require(Status.INVALID_LOAD, bool(np.isfinite(np.asarray(vector)).all()), vector)
    return vector


# What public functions take where nothing is given.
NO_LOADS = Loads()
NO_DAMPING = Damping()
