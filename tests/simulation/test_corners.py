"""Motions with corners, as measured ones have: steps end there, and chase no fast modes then."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import jaxbeam as jb
from jaxbeam._numerics.linalg import dense
from jaxbeam._simulation.scene import Scene
from tests.beams import README_ROTOR

MODEL = jb.Hybrid(0, 5, 0)
ROTOR = jb.Rotor(jb.Beam(1.5, 0.8, 1e6, 60.0, 60.0))
# A base that is shaken: its velocity is measured a hundred times a second.
TIMES = np.linspace(0.0, 0.5, 51)
PUSHES = np.random.default_rng(5).standard_normal(50).cumsum() * 0.3  # m/s^2
A2, A3 = jnp.array([0.0, 1.0, 0.0]), jnp.array([0.0, 0.0, 1.0])


def shaken(**declared):
    speeds = jnp.asarray(np.concatenate([[0.0], np.cumsum(PUSHES * 0.01)]))
    return jb.motions.HubVelocity(
        lambda t: jnp.interp(t, TIMES, speeds) * A2, lambda t: jnp.zeros(3), **declared
    )


def right():
    """Lag of the tip: each mode is an oscillator under a force that is constant between samples."""
    scene = Scene(MODEL, ROTOR, shaken(), jb.Loads(), jb.Damping())
    zero = jnp.zeros(5)

    @jax.jit
    def matrices(push):
        still = scene.inputs(jnp.asarray(0.0))
        hub = still[0]._replace(velocity=0 * A2, velocity_rate=push * A2)
        k, _ = scene.tangents(still, zero, zero)
        tip = jax.jacfwd(lambda q: scene.equations.tip(q)[1])(zero)
        return dense(k), dense(scene.mass), scene.force((hub, *still[1:]), zero, zero), tip

    k, m, per_push, to_tip = map(np.asarray, matrices(1.0))
    squares, shapes = scipy.linalg.eigh(k, m)
    w, force, to_tip = np.sqrt(squares), shapes.T @ per_push, to_tip @ shapes
    c, s = np.cos(0.01 * w), np.sin(0.01 * w)
    y, rate, out = np.zeros(5), np.zeros(5), [0.0]
    for push in PUSHES:
        rest = force * push / squares
        y, rate = (y - rest) * c + rate / w * s + rest, rate * c - (y - rest) * w * s
        out.append(to_tip @ y)
    return np.array(out)


@pytest.mark.slow
def test_a_shaken_base_takes_a_few_steps_between_samples():
    """Three; one by what is exact between samples."""
    motion, expected = shaken(changes=TIMES[1:-1]), right()
    for solver, steps, off in ((None, 3.3, 1e-4), (jb.solvers.Magnus(), 1.03, 1e-9)):
        run = jb.simulate(MODEL, ROTOR, motion, TIMES, solver=solver)
        assert run.solution.stats["num_steps"] < steps * 50
        bound = off * abs(expected).max()
        np.testing.assert_allclose(run.tip[:, 1], expected, rtol=0, atol=bound)
        assert abs(run.imbalance).max() < 1e-5


@pytest.mark.exhaustive
@pytest.mark.parametrize("smooth", [False, True])
def test_a_speed_as_an_encoder_gives_it(smooth):
    """Noise of 0.05 rad/s at 50 Hz, also where it is smoothed."""
    times = np.arange(0.0, 2.0, 0.02)
    speeds = 3.0 * times + 0.05 * np.random.default_rng(3).standard_normal(times.size)
    table = jb.motions.TabulatedSpeed(times, speeds, smooth=smooth)
    rotor = jb.Rotor(jb.Beam(2.0, 1.2, 3e6, 400.0, 150.0), 0.1)

    @jax.jit
    def found(tolerance):
        control = diffrax.PIDController(rtol=tolerance, atol=0.05 * tolerance)
        how = {"stepsize_controller": control, "throw": False}
        run = jb.simulate(jb.PlanarRod(4), rotor, table, times[::10], **how)
        return run.tip[:, 1], run.solution.stats["num_steps"], run.status

    (tip, steps, status), (expected, _, _) = found(1e-6), found(1e-8)
    assert status == jb.Status.OK
    assert steps < 13 * times.size  # 16 to 94 where corners are taken for events
    np.testing.assert_allclose(tip, expected, rtol=0, atol=2e-3 * abs(expected).max())


@pytest.mark.exhaustive
def test_what_a_jump_deflects_is_expected():
    """Tolerances are not those of a beam that stays where it is."""
    blow = jb.motions.HubVelocity(
        lambda t: jnp.zeros(3), lambda t: jnp.where(t >= 0.5, 0.5, 0.0) * A3, jumps=[0.5]
    )
    run = jb.simulate(jb.PlanarRod(8), README_ROTOR, blow, [0.0, 6.0, 12.0])
    assert abs(run.tip[:, 1]).max() > 0.1
