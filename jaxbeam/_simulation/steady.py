"""The state in which a beam rests in its hub."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from jaxbeam._checks import real_scalar
from jaxbeam._models.contract.base import AbstractModel, checked_case
from jaxbeam._models.contract.equilibrium import equilibrium
from jaxbeam._models.contract.loaded import equations_under, loads_at
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, nan_unless
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.loads import NO_DAMPING, NO_LOADS, Loads
from jaxbeam._rotor.motion import Motion
from jaxbeam._simulation.checks import check_scene, scene_status
from jaxbeam._solvers.system import State
from jaxbeam._status import Status, first_failure
from jaxbeam._types import Code, Scalar


class SteadyStart(State):
    """A `State` at rest in the hub, to begin a run with, that says how it was found.

    `q` (n,) are its coordinates, and NaN unless `status` is OK; `v` (n,) and `work` () are zero.
    """

    status: Code

    def __init__(self, q: Array, status: Code) -> None:
        super().__init__(q, jnp.zeros_like(q))
        self.status = status


def steady_start(
    model: AbstractModel,
    rotor: AnyRotor,
    motion: Motion,
    t: Any = 0.0,
    *,
    loads: Loads = NO_LOADS,
    throw: bool = True,
) -> SteadyStart:
    """The state in which the beam rests in the hub if the hub went on as it moves at time t.

    Where the forces on the beam vanish, f(q, 0) = 0, under the velocities that `motion` has at `t`
    () in s, without their rates, and under the `loads` of that moment; `model`, `rotor`, `motion`
    and `loads` are those of `simulate`. An equilibrium need not be stable: ask `modes`. Returns a
    `SteadyStart`, which is a `State` and so what `simulate` takes as its `start`; displacements are
    `model.equations(rotor).displacement(state.q, xi)`, xi an array.

    `throw=False` returns failures in `SteadyStart.status`, those of motion, loads and parameters
    out of range, and those of the search, and NaN; a run that begins with it is `INVALID_START`.

    Raises `ValueError` or `TypeError` for a malformed argument, and, with `throw`, `ValueError` for
    what is out of range (under `jit` `RuntimeError`) and `RuntimeError` where there is no such
    state, or it is not found.
    """
    model, rotor, _ = checked_case(model, rotor)
    t = real_scalar("t", t)
    check_scene(motion, loads, NO_DAMPING, t, (model, rotor), throw)
    return finish(_steady(model, rotor, motion, t, loads), throw)


@Program
def _steady(
    model: AbstractModel, rotor: AnyRotor, motion: Motion, t: Scalar, loads: Loads
) -> SteadyStart:
    given, (rotor, motion, loads, *_) = scene_status(
        model, rotor, motion, loads, NO_DAMPING, t[None], t[None]
    )
    hub = motion.hub(t, loads.gravity)
    zero = jnp.zeros(3, t.dtype)
    hub = hub._replace(velocity_rate=zero, angular_velocity_rate=zero)
    equations = equations_under(model, rotor, loads)
    q, status = equilibrium(equations, hub, *loads_at(equations, loads, t))
    status = first_failure(given, status)
    return SteadyStart(nan_unless(status == Status.OK, q), status)
