"""Motions against the formulas of the papers, against each other, and bad input."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb

TIMES = np.array([0.0, 0.3, 1.1, 1.999, 2.0, 2.5])
G = jnp.array([0.0, 0.0, -9.81])


def along(motion, times):
    """Speed about a3 and its rate at each time."""
    hub = jax.jit(jax.vmap(lambda t: motion.hub(t, None)))(jnp.asarray(times))
    return hub.angular_velocity[:, 2], hub.angular_velocity_rate[:, 2]


def smooth(tau):
    return tau - np.sin(2 * np.pi * tau) / (2 * np.pi), 1 - np.cos(2 * np.pi * tau)


def quintic(tau):
    return 6 * tau**5 - 15 * tau**4 + 10 * tau**3, 30 * tau**4 - 60 * tau**3 + 30 * tau**2


@pytest.mark.parametrize(
    ("motion", "law"), [(jb.SmoothSpinUp, smooth), (jb.motions.QuinticSpinUp, quintic)]
)
def test_spin_ups_follow_the_printed_laws(motion, law):
    """Y eqs. 21 and 23, with T = 2 s."""
    speed, rate = along(motion(3.0, 2.0), TIMES)
    expected, slope = law(np.minimum(TIMES / 2.0, 1.0))
    np.testing.assert_allclose(speed, 3.0 * expected, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(rate, 1.5 * slope, rtol=1e-12, atol=1e-12)


def test_angle_of_the_smooth_spin_up_is_that_of_berzeri():
    """B eq. 13."""
    t, duration, speed = TIMES, 2.0, 3.0
    during = t**2 / 2 + (duration / (2 * np.pi)) ** 2 * (np.cos(2 * np.pi * t / duration) - 1)
    printed = np.where(t < duration, speed / duration * during, speed * (t - duration / 2))
    angle = jax.vmap(jb.SmoothSpinUp(speed, duration).angle)(jnp.asarray(t))
    np.testing.assert_allclose(angle, printed, rtol=1e-13, atol=1e-14)


def test_other_rotations():
    t = TIMES
    speed, rate = along(jb.ConstantSpeed(4.0), t)
    np.testing.assert_array_equal(speed, 4.0)
    np.testing.assert_array_equal(rate, 0.0)
    speed, rate = along(jb.motions.ModulatedSpeed(4.0, 0.2, 7.0), t)
    np.testing.assert_allclose(speed, 4.0 * (1 + 0.2 * np.sin(7 * t)), rtol=1e-13)
    np.testing.assert_allclose(rate, 4.0 * 0.2 * 7 * np.cos(7 * t), rtol=1e-12)
    up_and_down = jb.motions.SpinUpThenDown(jb.motions.QuinticSpinUp(4.0, 2.0), down_at=5.0)
    speed, _ = along(up_and_down, [1.0, 3.0, 6.0, 7.5])
    np.testing.assert_allclose(speed, [2.0, 4.0, 2.0, 0.0], atol=1e-13)


def test_pose_and_velocity_state_the_same_motion():
    """A hub on a moving, tilting platform, by position and rotation or by its velocities."""

    def position(t):
        return jnp.stack([jnp.sin(t), 0.3 * t**2, jnp.cos(2 * t)])

    def rotation(t):
        about = jb.ConstantSpeed(1.3, axis=[0.6, 0.0, 0.8]).attitude(t)
        return about @ jb.SmoothSpinUp(2.0, 3.0).attitude(t)

    pose = jb.motions.HubPose(position, rotation)
    velocities = jb.motions.HubVelocity(
        lambda t: pose.velocities(t)[0], lambda t: pose.velocities(t)[1]
    )
    t = jnp.asarray(0.7)
    hub, q = jax.jit(lambda t: (pose.hub(t, None), rotation(t)))(t)
    for a, b in zip(hub, jax.jit(lambda t: velocities.hub(t, None))(t), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-14)
    # velocity and acceleration of the hub, turned back to inertial axes
    rate, second = jax.jit(
        lambda t: (jax.jacfwd(position)(t), jax.jacfwd(jax.jacfwd(position))(t))
    )(t)
    np.testing.assert_allclose(q @ hub.velocity, rate, rtol=1e-12)
    np.testing.assert_allclose(q @ hub.acceleration, second, rtol=1e-12)
    # Q' = Q omega~
    omega = hub.angular_velocity
    skew = np.cross(np.eye(3), omega)  # rows e_i x omega: the matrix of omega x
    np.testing.assert_allclose(jax.jit(jax.jacfwd(rotation))(t), q @ skew, rtol=1e-12, atol=1e-13)


def test_gravity_turns_with_the_hub():
    """About a horizontal axis gravity swings in the plane of rotation."""
    motion = jb.ConstantSpeed(2.0)
    pull = motion.hub(jnp.asarray(0.6), jnp.array([0.0, -9.81, 0.0])).gravity
    np.testing.assert_allclose(pull, [-9.81 * np.sin(1.2), -9.81 * np.cos(1.2), 0.0], rtol=1e-13)
    with pytest.raises(ValueError, match="gravity needs the attitude"):
        jb.motions.HubVelocity(lambda t: jnp.zeros(3), lambda t: jnp.zeros(3)).hub(
            jnp.asarray(0.0), G
        )


def test_inclined_axis():
    """omega = Omega (cos b a1 + sin b a2) (Y, Figs. 7-9)."""
    hub = jb.ConstantSpeed(3.0, jb.motions.inclined_axis(0.4)).hub(jnp.asarray(1.0), None)
    np.testing.assert_allclose(hub.angular_velocity, [3 * np.cos(0.4), 3 * np.sin(0.4), 0.0])


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: jb.SmoothSpinUp(1.0, 0.0), ValueError, "duration must be finite and > 0"),
        (
            lambda: jb.motions.QuinticSpinUp(1.0, -1.0),
            ValueError,
            "duration must be finite and > 0",
        ),
        (lambda: jb.SmoothSpinUp("1", 1.0), TypeError, "angular_speed must be a real"),
        (lambda: jb.motions.ModulatedSpeed(1.0, 0.1, 0.0), ValueError, "frequency must be finite"),
        (lambda: jb.ConstantSpeed(1.0, [0, 0, 2.0]), ValueError, "axis must be a unit vector"),
        (lambda: jb.ConstantSpeed(1.0, [0, 1.0]), ValueError, r"axis must have shape \(3,\)"),
        (lambda: jb.motions.SpinUpThenDown(3.0, 1.0), TypeError, "up must be a motion"),
        (
            lambda: jb.motions.HubVelocity(lambda t: jnp.zeros(2), lambda t: jnp.zeros(3)),
            ValueError,
            r"velocity must return real numbers of shape \(3,\), got float64 \(2,\)",
        ),
        (
            lambda: jb.motions.HubVelocity(lambda t: jnp.zeros(3), 3.0),
            TypeError,
            "angular_velocity must be a function of time",
        ),
        (
            lambda: jb.motions.HubPose(lambda t: jnp.zeros(3), lambda t: jnp.zeros((3, 2))),
            ValueError,
            r"rotation must return real numbers of shape \(3, 3\)",
        ),
        (
            lambda: jb.motions.HubPose(lambda t: jnp.zeros(3), lambda t: 2 * jnp.eye(3)),
            ValueError,
            "rotation must be a proper orthogonal matrix",
        ),
        (lambda: jb.Loads(gravity=[1.0, 2.0]), ValueError, r"gravity must have shape \(3,\)"),
        (lambda: jb.Loads(tip_force=[1.0, np.nan, 0]), ValueError, "must be finite"),
        (
            lambda: jb.Loads(tip_force=lambda t: t),
            ValueError,
            r"tip_force must return real numbers of shape",
        ),
        (lambda: jb.Damping(mass_coefficient=-1.0), ValueError, "damping must be finite and >= 0"),
    ],
)
def test_bad_input(build, error, message):
    with pytest.raises(error, match=message):
        build()
