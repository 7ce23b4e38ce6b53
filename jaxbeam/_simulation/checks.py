"""What may be out of range in a scene, found before it moves."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxbeam._checks import check_all, check_kind, increase, kind_of, number_list, shaped_array
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.supports import check_supported
from jaxbeam._results import harmless
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.damping import Damping, damping_in_range
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.first_look import refuse, stays_in_plane
from jaxbeam._rotor.loads import Loads, in_plane, loads_in_range
from jaxbeam._rotor.motion import Hub, Motion
from jaxbeam._solvers.system import State
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Scalar

# Motion of the hub, load at the tip, and moments of the force along the span as of
# `Loads.span_moments`, or None.
Seen = tuple[Hub, Any, Array | None]


def scene_status(
    model: AbstractModel, rotor: AnyRotor, motion: Motion, loads: Loads, damping: Damping,
    times: Array, between: Array,
) -> tuple[Code, Any]:  # fmt: skip
    """The status of a scene, looked at at output times and at times `between`; and rotor, motion,
    loads, damping and inputs at the latter, each replaced by harmless numbers where it is out of
    range (one by one, since others may be shared by the cases of a batch)."""

    def seen(t: Scalar) -> Seen:
        return motion.hub(t, loads.gravity), loads.at_tip(t), loads.span_moments(t, rotor.length)

    def one(t: Scalar, x: Seen) -> tuple[Array, Array, Array]:
        hub, tip, span = x
        spin, rate = hub.angular_velocity, hub.angular_velocity_rate
        loaded, planar = loads_in_range(hub.gravity, hub.acceleration, tip, span)
        planar &= in_plane(spin[:2], spin[2]) & in_plane(rate[:2], rate[2])
        moves = jnp.all(jnp.isfinite(jnp.stack(hub[:4]))) & motion.valid(t)
        return moves, loaded, planar

    moments = jnp.concatenate([between, times])
    inputs = jax.vmap(seen)(moments)
    moves, loaded, planar = jax.vmap(one)(moments, inputs)
    ahead, calm = increasing(times), damping_in_range(damping)
    # Together, since `jnp.all` of each one separately takes programs of its own to compile.
    moves, loaded, planar = jnp.all(jnp.stack([moves, loaded, planar]), 1)
    fastest = jnp.sqrt(jnp.max(jnp.sum(inputs[0].angular_velocity ** 2, 1)))
    status = first_broken(
        (moves, Status.INVALID_MOTION),
        (loaded, Status.INVALID_LOAD),
        (Direction.FLAP in model.directions or planar, Status.OUT_OF_PLANE),
        (model.resolves(rotor, fastest), Status.TOO_FEW_FUNCTIONS),
    )
    seen = jax.tree.map(lambda a: a[: between.size], inputs)
    motion, loads, seen = harmless(ahead & (status == Status.OK), (motion, loads, seen))
    given = rotor.status(jnp.zeros((), times.dtype))
    rotor, damping = harmless(given == Status.OK, rotor), harmless(calm, damping)
    rest = first_broken((ahead, Status.INVALID_TIMES), (calm, Status.INVALID_DAMPING))
    return first_failure(given, rest, status), (rotor, motion, loads, damping, seen)


def increasing(times: Array) -> Array:
    """Whether times are finite and increase."""
    return jnp.all(jnp.isfinite(times)) & jnp.all(jnp.diff(times) > 0)


def check_scene(
    motion: Any, loads: Any, damping: Any, t: Array,
    case: tuple[AbstractModel, AnyRotor] | None = None, throw: bool = False,
) -> None:  # fmt: skip
    """Raise for arguments that make no scene. With a `case`, a model and a rotor, raise also for
    features that the model does not know, and with `throw` for concrete numbers that cannot be
    right (see `first_look.py`)."""
    for name, value, kind in (
        ("motion", motion, Motion), ("loads", loads, Loads), ("damping", damping, Damping)
    ):  # fmt: skip
        if not isinstance(value, kind):
            article = "a" if kind is Motion else "of class"
            raise TypeError(f"{name} must be {article} {kind.__name__}, got {kind_of(value)}")
    shapes = [a.shape for a in eqx.filter_eval_shape(motion.velocities, t)]
    if shapes != [(3,), (3,)]:
        raise ValueError(f"motion.velocities must return two vectors of shape (3,), got {shapes}")
    if loads.gravity is not None:
        # Raises where the motion does not state its attitude.
        eqx.filter_eval_shape(motion.attitude, t)
    if case is not None:
        model, rotor = case
        check_supported(model, rotor, loads, damping)
        planar = Direction.FLAP in model.directions or stays_in_plane(loads, motion)
        refuse(throw, (planar, Status.OUT_OF_PLANE))


def checked_times(times: Any) -> Array:
    times = number_list("times", times, least=2)
    check_all(Status.INVALID_TIMES, times, increase)
    return times


def checked_start(model: AbstractModel, start: Any) -> State:
    """The start with zero work, if it is a state of this model; raises otherwise."""
    check_kind("start", start, State)
    sizes = dict(zip(("q", "v"), model.sizes, strict=True))
    return State(
        *(shaped_array(f"start.{name}", getattr(start, name), (n,)) for name, n in sizes.items())
    )


_KINDS = {
    "solver": diffrax.AbstractSolver,
    "stepsize_controller": diffrax.AbstractStepSizeController,
    "saveat": diffrax.SaveAt,
    "adjoint": diffrax.AbstractAdjoint,
    "event": diffrax.Event,
    "progress_meter": diffrax.AbstractProgressMeter,
}


def check_kinds(**given: Any) -> None:
    """Raise `TypeError` unless the arguments for integration are of the classes of diffrax that
    they must be."""
    for name, value in given.items():
        kind = _KINDS[name]
        if value is not None and not isinstance(value, kind):
            raise TypeError(f"{name} must be a diffrax.{kind.__name__}, got {kind_of(value)}")
