"""Rotations about a fixed axis: spin-ups of the papers, constant, modulated and tabulated speed.

Y and B are the papers of `_models/contract/__init__.py`.
"""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import check_all, increase, kind_of, positive, real_scalar, shaped_array
from jaxbeam._results import replaced
from jaxbeam._rotor.motion import Spin, Times, no_times, time_list
from jaxbeam._types import Real, Scalar, Triple


def inclined_axis(angle: Real) -> Triple:
    """Axis of rotation, shape (3,), at `angle` (rad, any) from the beam, in the plane of a1 and a2.

    cos(angle) a1 + sin(angle) a2, the beam on a tapered hub (Y, Figs. 7-9): then a3, and with it
    "flap", is the direction of rotation, and "in plane" the outward one. Default axes are a3.

    Raises `TypeError` or `ValueError` for what is no real scalar.
    """
    angle = real_scalar("angle", angle)
    return jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.zeros_like(angle)])


def _axis(axis: Any) -> Triple:
    if axis is None:
        return jnp.asarray([0.0, 0.0, 1.0], jnp.result_type(float))
    vector = shaped_array("axis", axis, (3,))
    check_all("axis must be a unit vector", vector, lambda x: abs(np.linalg.norm(x) - 1) < 1e-6)
    return vector


class ConstantSpeed(Spin):
    """Steady rotation at `angular_speed` (rad/s, either sign) about `axis`.

    The axis is a unit vector of shape (3,) in hub axes, a3 by default.

    Raises `TypeError` or `ValueError` for a malformed argument or a number out of range.
    """

    speed: Scalar
    axis: Triple

    def __init__(self, angular_speed: Real, axis: Any = None) -> None:
        self.speed, self.axis = real_scalar("angular_speed", angular_speed), _axis(axis)

    def angle(self, t: Scalar) -> Scalar:
        return self.speed * t


class _SpinUp(Spin):
    # Subclasses repeat __init__, since type checkers would make one from their fields.
    speed: Scalar
    duration: Scalar
    axis: Triple

    def __init__(self, angular_speed: Real, duration: Real, axis: Any = None) -> None:
        self.speed, self.axis = real_scalar("angular_speed", angular_speed), _axis(axis)
        self.duration = positive("duration", duration)

    @abc.abstractmethod
    def profile(self, tau: Scalar) -> Scalar:
        """Integral of `rise` from 0 to tau, in [0, 1]: 1/2 at tau = 1."""

    @abc.abstractmethod
    def rise(self, tau: Scalar) -> Scalar:
        """The speed over its final value: the derivative of `profile`, stated so that programs have
        a third of the operations."""

    def change_times(self) -> Times:
        """The times at which the speed begins and ends to rise."""
        return jnp.stack([jnp.zeros_like(self.duration), self.duration])

    def angle(self, t: Scalar) -> Scalar:
        # Times are compared, not the ratio t / duration clipped to one: where t is a little more
        # than the duration and the ratio rounds to one, JAX halves the derivative of a clip.
        done, tau = self._share(t)
        after = jnp.where(done, t - self.duration, 0.0)
        return self.speed * (self.duration * self.profile(tau) + after)

    def angular_speed(self, t: Scalar) -> Scalar:
        return self.speed * self.rise(self._share(t)[1])

    def _share(self, t: Scalar) -> tuple[Array, Scalar]:
        """Whether the spin-up is over, and the share of its duration that has passed."""
        done = t > self.duration
        return done, jnp.where(done, 1.0, jnp.where(t < 0, 0.0, t / self.duration))


class SmoothSpinUp(_SpinUp):
    """Speed from rest to `angular_speed` (rad/s, any sign) in `duration` T (s, > 0), then constant.

    Omega(t) = Omega_s [t / T - sin(2 pi t / T) / (2 pi)] (Y eq. 23); its integral is B eq. 13.
    `axis` as in `ConstantSpeed`.

    Raises `TypeError` or `ValueError` for a malformed argument or a number out of range.
    """

    def __init__(self, angular_speed: Real, duration: Real, axis: Any = None) -> None:
        super().__init__(angular_speed, duration, axis)

    def profile(self, tau: Scalar) -> Scalar:
        circle = 2 * jnp.pi
        return tau**2 / 2 + (jnp.cos(circle * tau) - 1) / circle**2

    def rise(self, tau: Scalar) -> Scalar:
        circle = 2 * jnp.pi
        return tau - jnp.sin(circle * tau) / circle


class QuinticSpinUp(_SpinUp):
    """Speed from rest to `angular_speed` (rad/s, any sign) in `duration` T (s, > 0), then constant.

    Omega(t) = Omega_s (6 tau^5 - 15 tau^4 + 10 tau^3), tau = t / T (Y eq. 21). `axis` as in
    `ConstantSpeed`.

    Raises `TypeError` or `ValueError` for a malformed argument or a number out of range.
    """

    def __init__(self, angular_speed: Real, duration: Real, axis: Any = None) -> None:
        super().__init__(angular_speed, duration, axis)

    def profile(self, tau: Scalar) -> Scalar:
        return tau**6 - 3 * tau**5 + 2.5 * tau**4

    def rise(self, tau: Scalar) -> Scalar:
        return tau**3 * (10 + tau * (6 * tau - 15))


class ModulatedSpeed(Spin):
    """A speed that swings about its mean: Omega(t) = mean [1 + depth sin(frequency t)].

    `mean` in rad/s, either sign; `depth` without unit; `frequency` in rad/s, > 0; `axis` as in
    `ConstantSpeed`.

    Raises `TypeError` or `ValueError` for a malformed argument or a number out of range.
    """

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
    """A spin-up, undone later: Omega(t) = up(t) - up(t - down_at).

    `up` is a motion about a fixed axis, such as `SmoothSpinUp`; `down_at` (s, > 0) is when it
    begins to be undone.

    Raises `TypeError` where `up` is none, and `ValueError` unless `down_at` is finite and > 0.
    """

    up: Spin
    down_at: Scalar
    axis: Triple

    def __init__(self, up: Spin, down_at: Real) -> None:
        if not isinstance(up, Spin):
            raise TypeError(f"up must be a motion about a fixed axis, got {kind_of(up)}")
        self.up, self.down_at, self.axis = up, positive("down_at", down_at), up.axis

    def change_times(self) -> Times:
        """The times of changes of the spin-up, and `down_at` later of the spin-down."""
        up = self.up.change_times()
        return jnp.concatenate([up, self.down_at + up])

    def jump_times(self) -> Times:
        """The times of jumps of the spin-up, and `down_at` later of the spin-down."""
        up = self.up.jump_times()
        return jnp.concatenate([up, self.down_at + up])

    def angle(self, t: Scalar) -> Scalar:
        # Some motions have an angle before t = 0, but the spin-down has none before `down_at`.
        return self.up.angle(t) - self.up.angle(jnp.maximum(t - self.down_at, 0.0))


class TabulatedSpeed(Spin):
    """A measured or planned speed: `speeds` (rad/s) at increasing `times` (s), each of shape (k,).

    Between them the speed is linear, with corners that steps meet exactly. With `smooth=True` it is
    Hermite's cubic whose slope at each time is that of the parabola through it and its neighbours,
    and zero at both ends; steps end at its times, too. Before the first time and after the last one
    the speed is constant. `axis` as in `ConstantSpeed`.

    Raises `ValueError` unless both are finite and equally many, two at least, and times increase,
    and `TypeError` for what are no real numbers.
    """

    times: Times
    pieces: Float[Array, "4 p"]  # coefficients of the speed by the time since a piece began
    angles: Times  # angle at the beginning of each piece, since the first time
    axis: Triple
    smooth: bool = eqx.field(static=True)

    def __init__(self, times: Any, speeds: Any, *, smooth: bool = False, axis: Any = None) -> None:
        self.times, s = time_list("times", times), time_list("speeds", speeds)
        if self.times.size < 2 or self.times.shape != s.shape:
            raise ValueError(
                "times and speeds must be two or more numbers each, equally many: got shapes "
                f"{self.times.shape} and {s.shape}"
            )
        check_all("times of a tabulated speed must increase", self.times, increase)
        self.axis, self.smooth = _axis(axis), smooth
        h = jnp.diff(self.times)
        rise = jnp.diff(s) / h
        none = jnp.zeros_like(rise)
        if smooth:
            inner = (h[1:] * rise[:-1] + h[:-1] * rise[1:]) / (h[1:] + h[:-1])
            slope = jnp.concatenate([none[:1], inner, none[:1]])
            bend = (3 * rise - 2 * slope[:-1] - slope[1:]) / h
            cubic = (slope[:-1] + slope[1:] - 2 * rise) / h**2
            self.pieces = jnp.stack([s[:-1], slope[:-1], bend, cubic])
        else:
            self.pieces = jnp.stack([s[:-1], rise, none, none])
        a, b, c, d = self.pieces
        angle_there = h * (a + h * (b / 2 + h * (c / 3 + h * d / 4)))
        self.angles = jnp.concatenate([none[:1], jnp.cumsum(angle_there)])

    def change_times(self) -> Times:
        """The times of the table if the speed is smooth there; none otherwise."""
        return self.times if self.smooth else no_times()

    def jump_times(self) -> Times:
        """The times of the table if the speed has corners there; none otherwise."""
        return no_times() if self.smooth else self.times

    def valid(self, t: Scalar) -> Array:
        return super().valid(t) & jnp.all(jnp.diff(self.times) > 0)

    def since(self, origin: Scalar) -> "TabulatedSpeed":
        """The table with other times: the difference of times that are close is exact."""
        return replaced(self, times=self.times - origin)

    def _piece(self, t: Scalar) -> tuple[Scalar, Scalar, Array, Scalar]:
        """The piece of the table at t: time since it began, time before or after the table,
        coefficients of the speed, and angle where it began."""
        first, last = self.times[0], self.times[-1]
        inside = jnp.where(t < first, first, jnp.where(t > last, last, t))
        i = jnp.searchsorted(self.times, t, side="right") - 1
        i = jnp.clip(i, 0, self.times.size - 2)
        return inside - self.times[i], t - inside, self.pieces[:, i], self.angles[i]

    def angular_speed(self, t: Scalar) -> Scalar:
        """The speed by the table, in rad/s."""
        s, _, (a, b, c, d), _ = self._piece(t)
        return a + s * (b + s * (c + s * d))

    def angle(self, t: Scalar) -> Scalar:
        """The angle turned from the first time of the table on, in rad."""
        s, beyond, (a, b, c, d), before = self._piece(t)
        angle_there = before + s * (a + s * (b / 2 + s * (c / 3 + s * d / 4)))
        return angle_there + self.angular_speed(t) * beyond
