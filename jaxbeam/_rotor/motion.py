"""Prescribed motion of the hub.

Every motion states where the hub is or how fast it moves; rates come from `jax.jvp`. Components are
those of the hub frame: a1 along the undeformed beam, a2 in the plane of rotation, a3 normal to it.
Numbers in a motion are leaves: they can be swept, fitted and differentiated like those of a beam.
"""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import check_all, is_there, kind_of, number_list, traceable
from jaxbeam._programs.lanes import append_axes, matmul, matvec
from jaxbeam._rotor.clock import Clock
from jaxbeam._types import Number, Scalar, Triple, is_concrete

Rotation = Float[Array, "3 3"]
Times = Float[Array, " k"]
# _EPSILON[i] is the matrix of b -> e_i x b.
_EPSILON = np.cross(np.eye(3)[:, None], np.eye(3)[None]).swapaxes(1, 2)


class Hub(NamedTuple):
    """Motion of the hub at one time: components, shape (3,) each, in the hub frame.

    `velocity` (m/s) is that of the point on the axis from which the hub radius is measured,
    `angular_velocity` (rad/s) that of the frame; `velocity_rate` (m/s^2) and
    `angular_velocity_rate` (rad/s^2) are the rates of these *components*. `gravity` (m/s^2) enters
    like an acceleration of the hub the other way.
    """

    velocity: Triple
    angular_velocity: Triple
    velocity_rate: Triple
    angular_velocity_rate: Triple
    gravity: Triple

    @property
    def acceleration(self) -> Triple:
        """Acceleration of the reference point, less gravity: v' + omega x v - g."""
        carried = cross(self.angular_velocity, self.velocity)
        return self.velocity_rate + carried - self.gravity


def spinning(angular_speed: Number) -> Hub:
    """The motion of a hub that turns steadily about a3."""
    zero = jnp.zeros_like(angular_speed)
    zeros = jnp.stack([zero, zero, zero])
    return Hub(zeros, jnp.stack([zero, zero, angular_speed]), zeros, zeros, zeros)


class Motion(eqx.Module):
    """How the hub moves: subclass it, or use `HubVelocity` and `HubPose`."""

    @abc.abstractmethod
    def velocities(self, t: Scalar) -> tuple[Triple, Triple]:
        """Velocity (m/s) and angular velocity (rad/s) of the hub, in its frame, at time `t` (s)."""

    def attitude(self, t: Scalar) -> Rotation:
        """Columns: hub axes in inertial components at time `t` (s). Only gravity asks for it.

        Raises `ValueError` unless a motion states it.
        """
        raise ValueError(
            f"gravity needs the attitude of the hub, which {type(self).__name__} does not state; "
            "use HubPose, or one of the motions about a fixed axis"
        )

    def valid(self, t: Scalar) -> Array:
        """Whether the motion is allowed at time `t` (s), besides being finite."""
        return jnp.asarray(True)

    def change_times(self) -> Times:
        """Times (s) at which the motion begins or ends something smoothly; none by default.

        Steps end there, so that nothing that happens between two of them is passed over, however
        short it is. What lasts longer than a thousandth of a run is found without being declared.
        """
        return no_times()

    def jump_times(self) -> Times:
        """Times (s) at which velocity, angular velocity or their rates jump; none by default.

        Steps end there, the beam gets the impulse of a jump of velocity, and derivatives by such a
        time are right. A jump of a velocity that is not declared ends a run as `UNRESOLVED`.
        """
        return no_times()

    def since(self, origin: Scalar) -> "Motion":
        """Motion by a clock that shows zero at time `origin` (s).

        Runs count time from their beginning, since a time of 1.7e9 s, as clocks of computers show
        it, is rounded to 2.4e-7 s. By default `origin` is added again where the motion is asked
        for; a motion that knows better, as `TabulatedSpeed` does, says so.
        """
        return _Since(self, origin)

    def hub(self, t: Scalar, gravity: Triple | None) -> Hub:
        """The `Hub` at time t; `gravity` is in inertial components."""
        (velocity, spin), (rate, spin_rate) = self.velocities_and_rates(t)
        hub_gravity = jnp.zeros_like(velocity) if gravity is None else self.attitude(t).T @ gravity
        return Hub(velocity, spin, rate, spin_rate, hub_gravity)

    def velocities_and_rates(
        self, t: Scalar
    ) -> tuple[tuple[Triple, Triple], tuple[Triple, Triple]]:
        """The `velocities` and their rates, at time t."""
        return jax.jvp(self.velocities, (t,), (jnp.ones_like(t),))


class _Since(Motion):
    """A motion as a function of the time since the origin of a clock."""

    motion: Motion
    clock: Clock

    def __init__(self, motion: Motion, origin: Scalar) -> None:
        self.motion, self.clock = motion, Clock(origin, motion.jump_times())

    def velocities(self, t: Scalar) -> tuple[Triple, Triple]:
        return self.motion.velocities(self.clock.time(t))

    def attitude(self, t: Scalar) -> Rotation:
        return self.motion.attitude(self.clock.time(t))

    def valid(self, t: Scalar) -> Array:
        return self.motion.valid(self.clock.time(t))

    def hub(self, t: Scalar, gravity: Triple | None) -> Hub:
        return self.motion.hub(self.clock.time(t), gravity)

    def change_times(self) -> Times:
        return self.motion.change_times() - self.clock.origin

    def jump_times(self) -> Times:
        return self.motion.jump_times() - self.clock.origin


class Spin(Motion):
    """Rotation about an axis that is fixed in space and in the hub; subclasses state the angle."""

    axis: eqx.AbstractVar[Triple]

    @abc.abstractmethod
    def angle(self, t: Scalar) -> Scalar:
        """Angle turned from time 0 to `t` (s), in rad."""

    def angular_speed(self, t: Scalar) -> Scalar:
        """Rate of the angle at time `t` (s), in rad/s."""
        return jax.jvp(self.angle, (t,), (jnp.ones_like(t),))[1]

    def velocities(self, t: Scalar) -> tuple[Triple, Triple]:
        return jnp.zeros_like(self.axis), self.angular_speed(t) * self.axis

    def velocities_and_rates(
        self, t: Scalar
    ) -> tuple[tuple[Triple, Triple], tuple[Triple, Triple]]:
        # By the derivative of the speed alone: a third of the operations to compile.
        speed, rate = jax.jvp(self.angular_speed, (t,), (jnp.ones_like(t),))
        zero = jnp.zeros_like(self.axis)
        return (zero, speed * self.axis), (zero, rate * self.axis)

    def valid(self, t: Scalar) -> Array:
        return jnp.abs(self.axis @ self.axis - 1) < 1e-6

    def attitude(self, t: Scalar) -> Rotation:
        """Hub axes by Rodrigues' formula; hub and inertial axes coincide at angle zero."""
        angle, k = self.angle(t), skew(self.axis)
        return jnp.eye(3, dtype=k.dtype) + jnp.sin(angle) * k + (1 - jnp.cos(angle)) * (k @ k)


def cross(a: Triple, b: Triple) -> Triple:
    """The product a x b; `jnp.cross` takes three times as many operations."""
    (x, y, z), (u, v, w) = a, b
    return jnp.stack([y * w - z * v, z * u - x * w, x * v - y * u])


def skew(a: Triple) -> Float[Array, "3 3 *#lanes"]:
    """The matrix of b -> a x b."""
    table = append_axes(_EPSILON.reshape(3, 9).T, a.ndim - 1)
    return matvec(table, a).reshape(3, 3, *a.shape[1:])


def axes(t: Triple) -> Float[Array, "3 3 *lanes"]:
    """Rows: a unit vector t, and what the least rotation of a1 to t makes of a2 and a3: it exists
    unless t is -a1."""
    x, y, z = t
    # 1 / (1 + x): where x < 0 as (1 - x) / (1 - x^2), without cancellation.
    ahead = x > 0
    share = jnp.where(ahead, 1.0, 1 - x) / jnp.where(ahead, 1 + x, y * y + z * z)
    second = jnp.stack([-y, 1 - y * y * share, -y * z * share])
    third = jnp.stack([-z, -y * z * share, 1 - z * z * share])
    return jnp.stack([t, second, third])


def rotation_vector(t: Triple) -> Triple:
    """The least rotation that brings a1 to a unit vector t: its axis times its angle, in rad."""
    x, y, z = t
    real = jnp.sqrt(jnp.maximum(1 + x, jnp.finfo(t.dtype).tiny) / 2)  # cosine of half the angle
    # The least rotation, from a1 to t, as its axis times the sine of half its angle.
    least = jnp.stack([jnp.zeros_like(x), -z, y]) / (2 * real)[None]
    square = jnp.sum(least * least, 0)
    small = square < 1e-8
    size = jnp.sqrt(jnp.where(small, 1.0, square))
    near = (2 - square / 3 * (2 / real**2)) / real  # 2 atan(s / w) / s to second order in s
    return jnp.where(small, near, 2 * jnp.arctan2(size, real) / size)[None] * least


def hub_matrices(hub: Hub) -> tuple[Float[Array, "3 3 *#lanes"], Float[Array, "3 3 *#lanes"]]:
    """The matrices omega~ omega~ + omega'~ and 2 omega~, by which the acceleration of a point
    depends on its position and on its velocity in the hub."""
    spin = skew(hub.angular_velocity)
    return matmul(spin, spin) + skew(hub.angular_velocity_rate), 2 * spin


def no_times() -> Times:
    return jnp.zeros(0, jnp.result_type(float))


def time_list(name: str, given: Any) -> Times:
    """`given` as a list of finite real numbers, or the error that says which argument is wrong."""
    values = number_list(name, given) if is_there(given) else no_times()
    check_all(f"{name} must be finite", values)
    return values


class _Declared(Motion):
    changes: Times
    jumps: Float[Array, " j"]

    def __init__(self, changes: Any, jumps: Any) -> None:
        self.changes, self.jumps = time_list("changes", changes), time_list("jumps", jumps)

    def change_times(self) -> Times:
        """The times that were given as `changes`."""
        return self.changes

    def jump_times(self) -> Times:
        """The times that were given as `jumps`."""
        return self.jumps


class HubVelocity(_Declared):
    """Any motion, by functions of time for velocity and angular velocity in the hub frame.

    `velocity(t)` and `angular_velocity(t)` take a scalar time (s) and return shape (3,) (m/s,
    rad/s). Callables that are pytrees (an `equinox.Module`, a `jax.tree_util.Partial`) carry their
    parameters as leaves. `changes` (k,) and `jumps` (j,) are times (s) as in `Motion.change_times`
    and `Motion.jump_times`.

    Raises `TypeError` for what is no function of time to real numbers, or none that JAX can trace,
    and `ValueError` for another shape or times that are not finite.
    """

    velocity: Callable[[Scalar], Triple]
    angular_velocity: Callable[[Scalar], Triple]

    def __init__(
        self,
        velocity: Callable[[Scalar], Triple],
        angular_velocity: Callable[[Scalar], Triple],
        *,
        changes: Any = (),
        jumps: Any = (),
    ) -> None:
        super().__init__(changes, jumps)
        self.velocity = function_of_time(velocity)
        self.angular_velocity = function_of_time(angular_velocity)

    def __check_init__(self) -> None:
        check_function_of_time("velocity", self.velocity, (3,))
        check_function_of_time("angular_velocity", self.angular_velocity, (3,))

    def velocities(self, t: Scalar) -> tuple[Triple, Triple]:
        return jnp.asarray(self.velocity(t)), jnp.asarray(self.angular_velocity(t))


class HubPose(_Declared):
    """Any motion, by functions of time for position and rotation.

    `position(t)`, shape (3,), in m and inertial components; `rotation(t)`, shape (3, 3), proper
    orthogonal, its columns the hub axes in inertial components. v = Q^T p', omega = vee(Q^T Q').
    `changes` (k,) and `jumps` (j,) are times (s) as in `Motion.change_times` and
    `Motion.jump_times`.

    Raises as `HubVelocity` does, and `ValueError` where the rotation is none at t = 0.
    """

    position: Callable[[Scalar], Triple]
    rotation: Callable[[Scalar], Rotation]

    def __init__(
        self,
        position: Callable[[Scalar], Triple],
        rotation: Callable[[Scalar], Rotation],
        *,
        changes: Any = (),
        jumps: Any = (),
    ) -> None:
        super().__init__(changes, jumps)
        self.position, self.rotation = function_of_time(position), function_of_time(rotation)

    def __check_init__(self) -> None:
        check_function_of_time("position", self.position, (3,))
        check_function_of_time("rotation", self.rotation, (3, 3))
        start = self.rotation(jnp.zeros((), jnp.result_type(float)))
        if is_concrete(start):
            q = np.asarray(start)
            if not (np.abs(q.T @ q - np.eye(3)).max() < 1e-6 and np.linalg.det(q) > 0):
                raise ValueError("rotation must be a proper orthogonal matrix; at t = 0 it is not")

    def velocities(self, t: Scalar) -> tuple[Triple, Triple]:
        one = (jnp.ones_like(t),)
        _, velocity = jax.jvp(lambda t: jnp.asarray(self.position(t)), (t,), one)
        q, rate = jax.jvp(lambda t: jnp.asarray(self.rotation(t)), (t,), one)
        return q.T @ velocity, jnp.tensordot(_EPSILON, q.T @ rate, 2) / 2

    def attitude(self, t: Scalar) -> Rotation:
        return jnp.asarray(self.rotation(t))

    def valid(self, t: Scalar) -> Array:
        q = self.attitude(t)
        return jnp.max(jnp.abs(q.T @ q - jnp.eye(3, dtype=q.dtype))) < 1e-6


def function_of_time(function: Any) -> Any:
    """A function of time as a pytree, wrapped if it is none, so that results that hold it may be
    returned by `jax.jit` and `jax.vmap`."""
    plain = callable(function) and jax.tree_util.all_leaves([function])
    return jax.tree_util.Partial(function) if plain else function


def check_function_of_time(name: str, function: Any, shape: tuple[int, ...]) -> None:
    """Raise unless `function` takes a time and returns real numbers of this shape."""
    if not callable(function):
        raise TypeError(f"{name} must be a function of time, got {kind_of(function)}")

    def array(t: Scalar) -> Array:
        with traceable(name):
            given = function(t)
        try:
            return jnp.asarray(given)
        except (TypeError, ValueError) as error:
            raise TypeError(
                f"{name} must return real numbers of shape {shape}, got {given!r}"
            ) from error

    out = eqx.filter_eval_shape(array, jax.ShapeDtypeStruct((), jnp.result_type(float)))
    if out.shape != shape or not jnp.issubdtype(out.dtype, jnp.floating):
        raise ValueError(
            f"{name} must return real numbers of shape {shape}, got {out.dtype} {out.shape}"
        )
