"""The state in which a beam rests in its hub."""

from typing import Any

import jax.numpy as jnp

from jaxbeam._checks import real_scalar
from jaxbeam._models.contract.base import AbstractModel, checked_case
from jaxbeam._models.contract.equilibrium import equilibrium
from jaxbeam._models.contract.loaded import acting_on, equations_under
from jaxbeam._programs.program import Program
from jaxbeam._results import nan_unless
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.loads import NO_DAMPING, NO_LOADS, Loads
from jaxbeam._rotor.motion import Motion
from jaxbeam._simulation.checks import check_scene, scene_status
from jaxbeam._solvers.system import State
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Scalar


def steady_start(
    model: AbstractModel,
    rotor: AnyRotor,
    motion: Motion,
    t: Any = 0.0,
    *,
    loads: Loads = NO_LOADS,
    throw: bool = True,
) -> State:
    """The state in which the beam rests in the hub if the hub went on as it moves at time t.

    `model`, `rotor`, `motion` and `loads` are those of `simulate`, `t` in s. Rates of the hub's
    velocities are left out. Returns a `State` without rates; displacements of it are
    `model.equations(rotor).displacement(state.q, xi)`, xi an array. An equilibrium need not be
    stable: ask `modes`. With `throw=False` coordinates of a state that is not found are NaN, which
    `simulate` reports.

    Raises `ValueError` or `TypeError` for what is malformed or out of range, and `RuntimeError`
    where no such state is found.
    """
    model, rotor, _ = checked_case(model, rotor)
    t = real_scalar("t", t)
    check_scene(motion, loads, NO_DAMPING, t)
    state, status = _steady(model, rotor, motion, t, loads)
    return raise_unless_ok(state, status) if throw else state


@Program
def _steady(
    model: AbstractModel, rotor: AnyRotor, motion: Motion, t: Scalar, loads: Loads
) -> tuple[State, Code]:
    given, (rotor, motion, loads, *_) = scene_status(
        model, rotor, motion, loads, NO_DAMPING, t[None], t[None]
    )
    hub = motion.hub(t, loads.gravity)
    zero = jnp.zeros(3, t.dtype)
    hub = hub._replace(velocity_rate=zero, angular_velocity_rate=zero)
    equations = equations_under(model, rotor, loads)
    q, status = equilibrium(equations, hub, *acting_on(equations, loads, t))
    status = jnp.where(given == Status.OK, status, given)
    q = nan_unless(status == Status.OK, q)
    return State(q, jnp.zeros_like(q)), status
