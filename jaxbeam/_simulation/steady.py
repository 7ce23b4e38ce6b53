"""The state in which a beam rests in its hub."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._checks import real_scalar
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.loaded import (
    Conditions,
    checked_conditions,
    equations_under,
    guarded_conditions,
    held_at_rest,
    loads_at,
)
from jaxbeam._programs.program import Program
from jaxbeam._results import asked_with, finish, harmless, nan_unless
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.damping import NO_DAMPING
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._rotor.motion import Motion
from jaxbeam._rotor.spins import ConstantSpeed
from jaxbeam._simulation.along_span import AlongSpan, Instant
from jaxbeam._simulation.checks import check_scene, scene_status
from jaxbeam._simulation.scene import Scene
from jaxbeam._solvers.system import State
from jaxbeam._status import Status, first_failure, in_range
from jaxbeam._types import Code, Scalar


class Steady(AlongSpan):
    """A beam that rests in its hub, which turns steadily: n coordinates, p points.

    | field         | shape | unit  |                                                              |
    |---------------|-------|-------|--------------------------------------------------------------|
    | q             | (n,)  | m     | coordinates of the model                                     |
    | angular_speed | ()    | rad/s |                                                              |
    | status        | ()    |       | `Status`; unless OK the answers are NaN                      |
    | scene         |       |       | equations, motion and loads; part of no table                |
    | model         |       |       | of what theory; no array, and part of no table               |
    | rotor         |       |       | of what, as it was given; part of no table                   |

    Along the span, at xi = x / L, it answers `displacement`, `rotation`, `strain`, `curvature`,
    `torsion`, `section_force` and `section_moment`, and as a whole `tip`, `hub_force`, `hub_torque`
    and `strain_energy`. Of a batch all this has the axes of the batch in front.
    """

    q: Float[Array, "... n"]
    angular_speed: Float[Array, "..."]
    status: Code
    scene: Scene = asked_with()
    model: AbstractModel | None = eqx.field(static=True, default=None)
    rotor: AnyRotor | None = asked_with()

    def _each(self, function: Callable[..., Any], *xi: float) -> Any:
        return _asked(self, function, xi)


def steady(
    model: AbstractModel,
    rotor: AnyRotor,
    angular_speed: Any,
    *,
    loads: Loads = NO_LOADS,
    throw: bool = True,
) -> Steady:
    """The state that loads and rotation deform, with internal forces and moments at any place.

    Where the forces on the beam vanish, f(q, 0) = 0, while the hub turns at `angular_speed` () in
    rad/s, either way, about a3; zero is a beam at rest. `model` and `rotor` are those of `modes`,
    `loads` those under which it finds modes: constant in the hub or following the tip, with gravity
    along the axis where the hub turns. Found by continuation and Newton's method. An equilibrium
    need not be stable: ask `modes`.

    Returns a `Steady`, differentiable and, under `jax.vmap`, one of a batch. Internal forces are
    from equilibrium of all that is outboard, and as accurate as displacements. `throw=False` leaves
    failures in `Steady.status`, and NaN in its answers.

    Raises `ValueError` or `TypeError` for a malformed argument, and, with `throw`, `ValueError` for
    what is out of range (under `jit` `RuntimeError`) and `RuntimeError` where there is no such
    state, or it is not found.
    """
    model, rotor, speed = checked_case(model, rotor, angular_speed)
    checked_conditions(loads, NO_DAMPING, (model, rotor), (speed,), throw)
    found = finish(_steady(model, rotor, speed, Conditions(loads, NO_DAMPING)), throw)
    return dataclasses.replace(found, model=model, rotor=rotor)


@Program
def _steady(model: AbstractModel, rotor: AnyRotor, speed: Scalar, conditions: Conditions) -> Steady:
    given, rotor, speed, conditions = guarded_conditions(model, rotor, speed, conditions)
    q, status, *_ = conditions.state(model, rotor, speed)
    status = first_failure(given, status)
    scene = Scene(model, rotor, ConstantSpeed(speed), conditions.loads, NO_DAMPING)
    q, at = nan_unless(status == Status.OK, (q, speed))
    return Steady(q, at, status, scene)


@Program
def _asked(steady: Steady, function: Callable[..., Any], xi: tuple[float, ...]) -> Any:
    fine = steady.status == Status.OK
    q = jnp.where(fine, steady.q, 0.0)  # NaN would come into gradients
    # `0 * q`, not constant zeros, with which XLA 0.10 for CPUs crashes.
    state = State(q, 0 * q)
    rotor = harmless(in_range(steady.status), steady.rotor)
    now = Instant(steady.scene, rotor, jnp.zeros((), q.dtype), state, rests=True)
    return nan_unless(fine, function(now, *xi))


class SteadyStart(State):
    """A `State` at rest in the hub, to begin a run with, that says how it was found.

    `q` (n,) are its coordinates, and NaN unless `status` is OK; `v` (m,) and `work` () are zero.
    """

    status: Code

    def __init__(self, q: Array, v: Array, status: Code) -> None:
        super().__init__(q, v)
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

    That of `steady` for any motion, to begin a run with: where the forces on the beam vanish,
    f(q, 0) = 0, under the velocities that `motion` has at `t` () in s, without their rates, and
    under the `loads` of that moment; `model`, `rotor`, `motion` and `loads` are those of
    `simulate`. An equilibrium need not be stable: ask `modes`. Returns a `SteadyStart`, which is a
    `State` and so what `simulate` takes as its `start`.

    `throw=False` returns failures in `SteadyStart.status`, those of motion, loads and parameters
    out of range, and those of the search, and NaN; a run that begins with it is `INVALID_START`.

    Raises `ValueError` or `TypeError` for a malformed argument, and, with `throw`, `ValueError` for
    what is out of range (under `jit` `RuntimeError`) and `RuntimeError` where there is no such
    state, or it is not found.
    """
    model, rotor, _ = checked_case(model, rotor)
    t = real_scalar("t", t)
    check_scene(motion, loads, NO_DAMPING, t, (model, rotor), throw)
    return finish(_start(model, rotor, motion, t, loads), throw)


@Program
def _start(
    model: AbstractModel, rotor: AnyRotor, motion: Motion, t: Scalar, loads: Loads
) -> SteadyStart:
    given, (rotor, motion, loads, *_) = scene_status(
        model, rotor, motion, loads, NO_DAMPING, t[None], t[None]
    )
    hub = motion.hub(t, loads.gravity)
    zero = jnp.zeros(3, t.dtype)
    hub = hub._replace(velocity_rate=zero, angular_velocity_rate=zero)
    model, rotor = model.in_motion(rotor)
    equations = equations_under(model, rotor, loads)
    q, status, *_ = held_at_rest(rotor, equations, (hub, *loads_at(equations, loads, t)))
    status = first_failure(given, status)
    v = jnp.zeros(model.sizes[1], t.dtype)
    return SteadyStart(nan_unless(status == Status.OK, q), v, status)
