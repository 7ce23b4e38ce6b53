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

from jaxbeam._beam import positive, real_scalar
from jaxbeam._types import Real, Scalar, Triple

Rotation = Float[Array, "3 3"]
# _EPSILON[i] is the matrix of b -> e_i x b.
_EPSILON = np.cross(np.eye(3)[:, None], np.eye(3)[None]).swapaxes(1, 2)


class Hub(NamedTuple):
    """Motion of the hub at one time, components in the hub frame.

    `velocity` (m/s) is that of the point on the axis from which the hub radius is measured,
    `angular_velocity` (rad/s) that of the frame; the other two are the rates of these *components*.
    `gravity` (m/s^2) enters like an acceleration of the hub the other way.
    """

    velocity: Triple
    angular_velocity: Triple
    velocity_rate: Triple
    angular_velocity_rate: Triple
    gravity: Triple

    @property
    def acceleration(self) -> Triple:
        """Of the reference point, less gravity: v' + omega x v - g."""
        turning = cross(self.angular_velocity, self.velocity)
        return self.velocity_rate + turning - self.gravity


def spinning(angular_speed: Scalar) -> Hub:
    """The hub turning steadily about a3."""
    none = jnp.zeros_like(angular_speed)
    zero = jnp.stack([none, none, none])
    return Hub(zero, jnp.stack([none, none, angular_speed]), zero, zero, zero)


class Motion(eqx.Module):
    """How the hub moves: subclass it, or use `HubVelocity` and `HubPose`."""

    @abc.abstractmethod
    def twist(self, t: Scalar) -> tuple[Triple, Triple]:
        """Velocity and angular velocity of the hub in the hub frame at time t (s)."""

    def attitude(self, t: Scalar) -> Rotation:
        """Columns: hub axes in inertial components. Only gravity asks for it."""
        raise ValueError(
            f"gravity needs the attitude of the hub, which {type(self).__name__} does not state; "
            "use HubPose, or one of the motions about a fixed axis"
        )

    def valid(self, t: Scalar) -> Array:
        """Whether the motion makes sense at time t, beside being finite."""
        return jnp.asarray(True)

    def hub(self, t: Scalar, gravity: Triple | None) -> Hub:
        """Everything at time t; `gravity` is in inertial components."""
        (velocity, spin), (rate, spin_rate) = self.twist_and_rates(t)
        pull = jnp.zeros_like(velocity) if gravity is None else self.attitude(t).T @ gravity
        return Hub(velocity, spin, rate, spin_rate, pull)

    def twist_and_rates(self, t: Scalar) -> tuple[tuple[Triple, Triple], tuple[Triple, Triple]]:
        """`twist` and its rate."""
        return jax.jvp(self.twist, (t,), (jnp.ones_like(t),))


class Spin(Motion):
    """Rotation about an axis that is fixed in space and in the hub; subclasses state the angle."""

    axis: eqx.AbstractVar[Triple]

    @abc.abstractmethod
    def angle(self, t: Scalar) -> Scalar:
        """Angle turned since t = 0, in rad."""

    def angular_speed(self, t: Scalar) -> Scalar:
        """Rate of the angle, in rad/s."""
        return jax.jvp(self.angle, (t,), (jnp.ones_like(t),))[1]

    def twist(self, t: Scalar) -> tuple[Triple, Triple]:
        return jnp.zeros_like(self.axis), self.angular_speed(t) * self.axis

    def twist_and_rates(self, t: Scalar) -> tuple[tuple[Triple, Triple], tuple[Triple, Triple]]:
        # Through the one scalar that varies: a third of the operations to compile.
        speed, rate = jax.jvp(self.angular_speed, (t,), (jnp.ones_like(t),))
        zero = jnp.zeros_like(self.axis)
        return (zero, speed * self.axis), (zero, rate * self.axis)

    def valid(self, t: Scalar) -> Array:
        return jnp.abs(self.axis @ self.axis - 1) < 1e-6

    def attitude(self, t: Scalar) -> Rotation:
        """By Rodrigues' formula; hub and inertial axes coincide at angle zero."""
        angle, k = self.angle(t), skew(self.axis)
        return jnp.eye(3, dtype=k.dtype) + jnp.sin(angle) * k + (1 - jnp.cos(angle)) * (k @ k)


def cross(a: Triple, b: Triple) -> Triple:
    """a x b; `jnp.cross` takes three times as many operations."""
    (x, y, z), (u, v, w) = a, b
    return jnp.stack([y * w - z * v, z * u - x * w, x * v - y * u])


def skew(a: Triple) -> Rotation:
    """The matrix of b -> a x b."""
    return jnp.tensordot(a, _EPSILON, 1)


def inclined(angle: Real) -> Triple:
    """Axis of rotation at `angle` (rad) from the beam, in the plane of a1 and a2.

    cos(angle) a1 + sin(angle) a2, the beam on a tapered hub (Y, Figs. 7-9): then a3, and with it
    "flap", is the direction of rotation, and "in plane" the outward one. Default axes are a3.
    """
    angle = real_scalar("angle", angle)
    return jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.zeros_like(angle)])


def _axis(axis: Any) -> Triple:
    if axis is None:
        return jnp.asarray([0.0, 0.0, 1.0], jnp.result_type(float))
    vector = jnp.asarray(axis, jnp.result_type(float))
    if vector.shape != (3,):
        raise ValueError(f"axis must have shape (3,), got {vector.shape}")
    if not isinstance(vector, jax.core.Tracer):
        length = float(np.linalg.norm(np.asarray(vector)))
        if not abs(length - 1) < 1e-6:
            raise ValueError(f"axis must be a unit vector, got length {length}")
    return vector


class ConstantSpeed(Spin):
    """Steady rotation at `angular_speed` (rad/s)."""

    speed: Scalar
    axis: Triple

    def __init__(self, angular_speed: Real, axis: Any = None) -> None:
        self.speed, self.axis = real_scalar("angular_speed", angular_speed), _axis(axis)

    def angle(self, t: Scalar) -> Scalar:
        return self.speed * t


class _SpinUp(Spin):
    # Subclasses repeat __init__: type checkers would otherwise make one from the fields.
    speed: Scalar
    duration: Scalar
    axis: Triple

    def __init__(self, angular_speed: Real, duration: Real, axis: Any = None) -> None:
        self.speed, self.axis = real_scalar("angular_speed", angular_speed), _axis(axis)
        self.duration = positive("duration", duration)

    @abc.abstractmethod
    def profile(self, tau: Scalar) -> Scalar:
        """Integral from 0 to tau in [0, 1] of the speed over its final value; 1/2 at 1."""

    def angle(self, t: Scalar) -> Scalar:
        tau = jnp.clip(t / self.duration, 0.0, 1.0)
        after = jnp.maximum(t - self.duration, 0.0)
        return self.speed * (self.duration * self.profile(tau) + after)


class SmoothSpinUp(_SpinUp):
    """From rest to `angular_speed` (rad/s) in `duration` T (s), then constant.

    Omega(t) = Omega_s [t / T - sin(2 pi t / T) / (2 pi)] (Y eq. 23); its integral is B eq. 13.
    """

    def __init__(self, angular_speed: Real, duration: Real, axis: Any = None) -> None:
        super().__init__(angular_speed, duration, axis)

    def profile(self, tau: Scalar) -> Scalar:
        turn = 2 * jnp.pi
        return tau**2 / 2 + (jnp.cos(turn * tau) - 1) / turn**2


class QuinticSpinUp(_SpinUp):
    """From rest to `angular_speed` (rad/s) in `duration` T (s), then constant.

    Omega(t) = Omega_s (6 tau^5 - 15 tau^4 + 10 tau^3), tau = t / T (Y eq. 21).
    """

    def __init__(self, angular_speed: Real, duration: Real, axis: Any = None) -> None:
        super().__init__(angular_speed, duration, axis)

    def profile(self, tau: Scalar) -> Scalar:
        return tau**6 - 3 * tau**5 + 2.5 * tau**4


class ModulatedSpeed(Spin):
    """Omega(t) = mean [1 + depth sin(frequency t)]: `mean` in rad/s, `frequency` in rad/s."""

    mean: Scalar
    depth: Scalar
    frequency: Scalar
    axis: Triple

    def __init__(self, mean: Real, depth: Real, frequency: Real, axis: Any = None) -> None:
        self.mean, self.depth = real_scalar("mean", mean), real_scalar("depth", depth)
        self.frequency, self.axis = positive("frequency", frequency), _axis(axis)

    def angle(self, t: Scalar) -> Scalar:
        swing = (1 - jnp.cos(self.frequency * t)) / self.frequency
        return self.mean * (t + self.depth * swing)


class SpinUpThenDown(Spin):
    """A spin-up, undone from time `down_at` (s) on: Omega(t) = up(t) - up(t - down_at)."""

    up: Spin
    down_at: Scalar
    axis: Triple

    def __init__(self, up: Spin, down_at: Real) -> None:
        if not isinstance(up, Spin):
            raise TypeError(f"up must be a motion about a fixed axis, got {type(up).__name__}")
        self.up, self.down_at, self.axis = up, positive("down_at", down_at), up.axis

    def angle(self, t: Scalar) -> Scalar:
        # Angles before t = 0 are not all zero: the descent must not begin before its time.
        return self.up.angle(t) - self.up.angle(jnp.maximum(t - self.down_at, 0.0))


class HubVelocity(Motion):
    """Any motion, by functions of time for velocity and angular velocity in the hub frame.

    Each takes a scalar time (s) and returns shape (3,) (m/s, rad/s). Callables that are pytrees
    (an `equinox.Module`, a `jax.tree_util.Partial`) carry their parameters as leaves.
    """

    velocity: Callable[[Scalar], Triple]
    angular_velocity: Callable[[Scalar], Triple]

    def __check_init__(self) -> None:
        check_function_of_time("velocity", self.velocity, (3,))
        check_function_of_time("angular_velocity", self.angular_velocity, (3,))

    def twist(self, t: Scalar) -> tuple[Triple, Triple]:
        return jnp.asarray(self.velocity(t)), jnp.asarray(self.angular_velocity(t))


class HubPose(Motion):
    """Any motion, by functions of time for position and rotation.

    `position(t)`, shape (3,), in m and inertial components; `rotation(t)`, shape (3, 3), proper
    orthogonal, its columns the hub axes in inertial components. v = Q^T p', omega = vee(Q^T Q').
    """

    position: Callable[[Scalar], Triple]
    rotation: Callable[[Scalar], Rotation]

    def __check_init__(self) -> None:
        check_function_of_time("position", self.position, (3,))
        check_function_of_time("rotation", self.rotation, (3, 3))
        start = self.rotation(jnp.zeros((), jnp.result_type(float)))
        if not isinstance(start, jax.core.Tracer):
            q = np.asarray(start)
            if not (np.abs(q.T @ q - np.eye(3)).max() < 1e-6 and np.linalg.det(q) > 0):
                raise ValueError("rotation must be a proper orthogonal matrix; at t = 0 it is not")

    def twist(self, t: Scalar) -> tuple[Triple, Triple]:
        one = (jnp.ones_like(t),)
        _, velocity = jax.jvp(lambda t: jnp.asarray(self.position(t)), (t,), one)
        q, rate = jax.jvp(lambda t: jnp.asarray(self.rotation(t)), (t,), one)
        return q.T @ velocity, jnp.tensordot(_EPSILON, q.T @ rate, 2) / 2

    def attitude(self, t: Scalar) -> Rotation:
        return jnp.asarray(self.rotation(t))

    def valid(self, t: Scalar) -> Array:
        q = self.attitude(t)
        return jnp.max(jnp.abs(q.T @ q - jnp.eye(3, dtype=q.dtype))) < 1e-6


def check_function_of_time(name: str, function: Any, shape: tuple[int, ...]) -> None:
    """Raise unless `function` takes a time and returns real numbers of this shape."""
    if not callable(function):
        raise TypeError(f"{name} must be a function of time, got {type(function).__name__}")
    time = jax.ShapeDtypeStruct((), jnp.result_type(float))
    out = eqx.filter_eval_shape(lambda t: jnp.asarray(function(t)), time)
    if out.shape != shape or not jnp.issubdtype(out.dtype, jnp.floating):
        raise ValueError(
            f"{name} must return real numbers of shape {shape}, got {out.dtype} {out.shape}"
        )
