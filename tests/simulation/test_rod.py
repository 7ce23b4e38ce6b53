"""The rod in time: small motion is that of its modes, what is conserved, loads and reactions,
orders, gradients, batches."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import chebyshev
from scipy.special import ellipj, ellipk

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam.blades import Support
from tests.helpers import finite_difference, optimised
from tests.simulation.rods import FREE, TIGHT, coupled, slender, uniform

SKEW = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
STILL = jb.ConstantSpeed(0.0)
COUPLED = coupled().rotor


@pytest.mark.exhaustive
def test_small_motion_is_that_of_modes():
    """Let go where a force and a moment about its axis have bent and twisted it, a blade that turns
    rings in its modes, to 1e-6 of each frequency that can be told: in thirty periods, in all
    directions. Half the difference of two runs, to either side, is linear to third order."""
    model, speed = SpatialRod(4), 6.0
    omega = np.asarray(jb.modes(model, COUPLED, speed, 24).frequency)
    times = np.linspace(0, 60 * np.pi / omega[0], 501)
    motion = jb.ConstantSpeed(speed)

    @optimised
    def rung(size):
        loads = jb.Loads(
            tip_force=size * jnp.array([0, 1.0, 0.7]), tip_moment=size * jnp.array([1.0, 0, 0])
        )
        start = jb.steady_start(model, COUPLED, motion, loads=loads)
        run = jb.simulate(
            model, COUPLED, motion, times, start=start, max_steps=10**6,
            stepsize_controller=diffrax.PIDController(rtol=1e-13, atol=1e-17),
        )  # fmt: skip
        return jnp.concatenate([run.tip, run.torsion(1.0)], 1)

    found = np.asarray(rung(1e-3) - rung(-1e-3)) / 2e-3
    found = found / np.abs(found).max(0)

    def missed(omega):
        phase = times[:, None] * omega
        waves = np.concatenate([np.cos(phase), np.sin(phase)], 1)
        by, *_ = np.linalg.lstsq(waves, found, rcond=None)
        return np.abs(waves @ by - found).max(0)

    fine = missed(omega)
    assert fine.max() < 2e-7
    for k in range(4):  # each of which a millionth more would spoil
        off = missed(omega * (1 + 1e-6 * (np.arange(24) == k)))
        assert (off / fine).max() > 100


@pytest.mark.slow
def test_torsion_rung_by_a_step_of_moment():
    """A small moment about its axis, at once, on a blade that turns: the phase of the first mode of
    torsion along ten periods is that of its frequency of `modes`, to which the propeller moment of
    unlike moments of inertia of its sections adds a seventh. Bending rings, too."""
    stiffness, inertia = np.diag([1e6, 1e6, 1e6, 4, 5e3, 8e3]), np.diag([1, 1, 1, 0.01, 1e-3, 9e-3])
    rotor, model, speed = uniform(stiffness, inertia, 1.0, 0.3).rotor, SpatialRod(2), 20.0
    modes, motion = jb.modes(model, rotor, speed, 4), jb.ConstantSpeed(speed)
    assert modes.labels[0] == jb.labels(torsion=1)[0]
    omega = np.asarray(modes.frequency)
    times = np.linspace(0, 20 * np.pi / omega[0], 161)
    run = jb.simulate(
        model, rotor, motion, times, start=jb.steady_start(model, rotor, motion),
        loads=jb.Loads(tip_moment=[1e-3, 0, 0]),
        stepsize_controller=diffrax.PIDController(rtol=1e-8, atol=1e-10),
    )  # fmt: skip
    found = np.asarray(run.torsion(1.0))[:, 0]

    def missed(share):
        phase = times[:, None] * omega * np.array([share, 1, 1, 1])
        waves = np.concatenate([np.cos(phase), np.sin(phase), np.ones_like(times[:, None])], 1)
        return waves @ np.linalg.lstsq(waves, found, rcond=None)[0] - found

    left, slope = missed(1.0), (missed(1 + 1e-4) - missed(1 - 1e-4)) / 2e-4
    assert np.abs(left).max() < 1e-4 * np.abs(found).max()
    assert abs(slope @ left) < 2e-7 * slope @ slope  # the share by which another one fits better


@pytest.mark.exhaustive
def test_torsion_of_a_thin_blade_in_rotation():
    """Rung by a moment, sections that are thin in flap: the propeller moment adds the square of the
    speed to that of each frequency (2 k - 1) pi / (2 L) (GJ / I)^(1/2)."""
    stiffness, inertia = np.diag([1e6, 1e6, 1e6, 4.0, 5e3, 5e3]), np.diag([1, 1, 1, 0.01, 0, 0.01])
    rotor, speed, pulse = uniform(stiffness, inertia, 1.0).rotor, 10.0, 0.3

    def moment(t):
        rung = jnp.where(t < pulse, 1e-3 * jnp.sin(jnp.pi * t / pulse) ** 8, 0.0)
        return jnp.stack([rung, 0 * rung, 0 * rung])

    times = np.append(0.0, np.linspace(pulse, 3.0, 201))
    loads, motion = jb.Loads(tip_moment=moment, changes=[pulse]), jb.ConstantSpeed(speed)
    start = jb.steady_start(SpatialRod(10), rotor, motion)  # else it would ring in stretch
    run = optimised(
        lambda: jb.simulate(
            SpatialRod(10), rotor, motion, times, loads=loads, start=start,
            stepsize_controller=diffrax.PIDController(rtol=1e-8, atol=1e-11),
        )
    )()  # fmt: skip
    found = np.asarray(run.torsion(1.0))[1:, 0]
    found = found / np.abs(found).max()
    omega = np.hypot(np.arange(1, 12, 2) * np.pi / 2 * 20, speed)

    def missed(share):
        phase = times[1:, None] * omega * np.where(omega == omega[0], share, 1.0)
        waves = np.concatenate([np.cos(phase), np.sin(phase)], 1)
        return waves @ np.linalg.lstsq(waves, found, rcond=None)[0] - found

    fine, *off = (np.abs(missed(share)).max() for share in (1.0, 1 - 1e-6, 1 + 1e-6))
    assert fine < 1e-5
    assert min(off) > 2 * fine


@pytest.mark.exhaustive
def test_a_slender_rod_is_a_beam():
    """Of small deflection, about an inclined axis: as `Hybrid` has it."""
    beam = jb.Beam(8.0, 0.2, 5e6, 566.0, 400.0, torsional_stiffness=300.0, polar_inertia=1e-5)
    rotor, times = jb.Rotor(beam, 0.5, 0.1), np.linspace(0, 4.0, 9)
    motion = jb.SmoothSpinUp(0.01, 4.0, jb.motions.inclined_axis(1.1))
    rod, hybrid = (
        jb.simulate(model, rotor, motion, times, stepsize_controller=TIGHT).tip
        for model in (SpatialRod(8), jb.Hybrid())
    )
    np.testing.assert_allclose(rod, hybrid, atol=1e-5 * np.abs(rod).max())


@pytest.mark.exhaustive
def test_gravity_is_a_hub_that_falls_upwards():
    """In a rotating hub, of a blade with offsets and a body."""
    gravity, times, model = np.array([0.3, -1.0, -4.0]), np.linspace(0, 1.0, 5), SpatialRod(10)
    motion = jb.ConstantSpeed(3.0, SKEW)
    weighed = jb.simulate(
        model, COUPLED, motion, times, loads=jb.Loads(gravity), stepsize_controller=TIGHT
    )
    lifted = jb.motions.HubPose(lambda t: -gravity * t**2 / 2, motion.attitude)
    # At rest in its hub at first, where both begin.
    moved = jb.simulate(model, COUPLED, lifted, times, stepsize_controller=TIGHT)
    np.testing.assert_allclose(weighed.tip, moved.tip, atol=2e-6)
    assert np.abs(weighed.tip).max() > 0.05


@pytest.mark.exhaustive
def test_what_acts_at_the_hub():
    """Force by the momentum of what moves, moment by power, both by sections at the root, and these
    by their strains; of a blade that bends by a third of its length."""
    length, mass, axial, lag, flap, radius, carried = 8.0, 0.2, 5e5, 566.0, 400.0, 0.5, 0.3
    rotor = slender(length, mass, axial, lag, flap, radius, carried).rotor
    middle, half, count = 6.0, 0.5, 17
    times = middle + half * chebyshev.chebpts2(count)
    motion = jb.SmoothSpinUp(4.0, 12.0, SKEW)
    run = optimised(
        lambda: jb.simulate(
            SpatialRod(10), rotor, motion, np.concatenate([[0.0], times]),
            stepsize_controller=TIGHT,
        )
    )()  # fmt: skip
    at, weight = np.polynomial.legendre.leggauss(16)
    xi = np.append((1 + at) / 2, 1.0)
    places = np.asarray(run.displacement(xi)) + (radius + length * xi)[:, None] * np.eye(3)[0]
    moments = np.einsum("p,tpi->ti", np.append(mass * length * weight / 2, carried), places)
    attitude = np.asarray(jax.vmap(motion.attitude)(run.times))
    in_space = np.einsum("tij,tj->ti", attitude, moments)[1:]

    def rate(values, order):
        through = np.linalg.inv(chebyshev.chebvander((times - middle) / half, count - 1))
        return chebyshev.chebval(0.0, chebyshev.chebder(through @ values, order)) / half**order

    at_middle = 1 + count // 2
    force = attitude[at_middle].T @ rate(in_space, 2)
    scale = np.abs(run.hub_force).max()
    np.testing.assert_allclose(run.hub_force[at_middle], force, atol=1e-5 * scale)
    power = rate(np.asarray(run.energy)[1:], 1)
    speed = float(motion.angular_speed(run.times[at_middle]))
    np.testing.assert_allclose(speed * SKEW @ run.hub_torque[at_middle], power, rtol=1e-6)
    root, moment = run.section_force(0.0)[:, 0], run.section_moment(0.0)[:, 0]
    own = np.stack([moment[:, 0], -moment[:, 2], moment[:, 1]], 1)
    np.testing.assert_allclose(run.hub_force, -root, atol=1e-6 * scale)
    torque = -own + np.cross(radius * np.eye(3)[0], run.hub_force)
    size = np.abs(torque).max()
    np.testing.assert_allclose(run.hub_torque, torque, atol=1e-6 * size)
    strained = axial * np.asarray(run.strain(0.0))[:, 0]
    curved = np.asarray(run.curvature(0.0))[:, 0] * [lag, flap]
    np.testing.assert_allclose(strained, root[:, 0], atol=1e-5 * scale)
    np.testing.assert_allclose(curved, moment[:, 1:], atol=1e-5 * size)


@pytest.mark.exhaustive
def test_a_cantilever_pushed_across():
    """To two fifths of its length, by the default tolerance, against a finer rod by a tight one."""
    beam = slender(8.0, 0.20196, 5.0326e6, 566.4, 566.4).rotor
    loads = jb.Loads(tip_force=lambda t: jnp.sin(jnp.pi * t / 2) ** 2 * jnp.array([0, 6.0, 8.0]))
    tips = [
        optimised(
            lambda model=model, control=control: jb.simulate(
                model, beam, STILL, np.linspace(0, 2, 21), loads=loads, stepsize_controller=control
            )
        )().tip
        for model, control in ((SpatialRod(), None), (SpatialRod(12), TIGHT))
    ]  # fmt: skip
    peak = np.abs(tips[1]).max()
    assert peak > 3.2
    np.testing.assert_allclose(*tips, atol=2e-6 * peak)


SOLVERS = pytest.mark.parametrize(
    "solver", [jb.solvers.Rodas5P(), jb.solvers.ChordKvaerno5()], ids=lambda s: type(s).__name__
)


@functools.cache
def let_go(solver):
    """Ends of a soft bar that a hub has let go, turning five times, by the length of steps."""
    case = uniform(
        100 * np.eye(6), np.diag([1.0, 1, 1, 0.2, 0.1, 0.1]), 1.0, -0.5, root_support=FREE
    )
    motion = jb.ConstantSpeed(5.0, [0.6, 0.0, 0.8])

    @optimised
    def ends(step):
        run = jb.simulate(
            SpatialRod(2), case.rotor, motion, np.linspace(0, 6, 4), dt0=step, solver=solver,
            stepsize_controller=diffrax.ConstantStepSize(), balance_tolerance=0.1,
        )  # fmt: skip
        return run.displacement([0.0, 1.0])

    return ends


@pytest.mark.exhaustive
@SOLVERS
def test_the_order_of_constant_steps(solver):
    """Against much shorter ones of a Rosenbrock method."""
    exact = np.asarray(let_go(jb.solvers.Rodas5P())(jnp.asarray(0.04 / 2**6)))
    found = [np.asarray(let_go(solver)(jnp.asarray(0.04 / 2**k))) for k in (1, 2, 3)]
    errors = [np.abs(one - exact).max() for one in found]
    assert errors[-1] < 1e-6
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 5, atol=0.8)


STIFF = uniform(1e9 * np.eye(6), np.diag([1.0, 1, 1, 2e-3, 1e-3, 1e-3]), 1.0).rotor


@functools.cache
def pendulum(slides):
    """A stiff bar on a hinge about a3, tilted about its own axis before that, let fall; along the
    hinge, too, where it slides."""

    @jax.jit
    def fall(tilt, gravity):
        hinge = Support(
            about_3=0.0, along_3=0.0 if slides else None,
            attitude=jnp.stack([tilt, 0 * tilt, 0 * tilt]),
        )  # fmt: skip
        return jb.simulate(
            SpatialRod(2), jb.Rotor(STIFF.beam, root_support=hinge), STILL, np.linspace(0, 4, 9),
            loads=jb.Loads(gravity), dt0=0.001, stepsize_controller=diffrax.ConstantStepSize(),
        )  # fmt: skip

    return fall


@pytest.mark.exhaustive
@pytest.mark.parametrize(("tilt", "slides"), [(0.0, False), (0.7, False), (0.7, True)])
def test_a_pendulum(tilt, slides):
    """From the horizontal, as by elliptic functions, through some periods; and along its hinge as
    what falls freely."""
    g, down, times = 9.81, 0.4 * slides, np.linspace(0, 4, 9)
    across = np.array([0.0, np.cos(tilt), np.sin(tilt)])  # the way it swings, up
    hinge = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    run = pendulum(slides)(tilt, -g * across - down * hinge)
    length = (1 / 3 + 1e-3) / 0.5  # of the simple pendulum
    sn, *_ = ellipj(ellipk(0.5) - np.sqrt(g / length) * times, 0.5)
    angle = 2 * np.arcsin(np.sqrt(0.5) * sn)  # from straight down
    exact = np.sin(angle)[:, None] * np.eye(3)[0] - np.cos(angle)[:, None] * across
    exact = exact - down * times[:, None] ** 2 / 2 * hinge
    tip = np.asarray(run.tip) + np.eye(3)[0]
    np.testing.assert_allclose(tip, exact, atol=5e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("end", ["root_support", "tip_support"])
def test_a_bar_on_a_smooth_plane(end):
    """Let go by a hub that turns: its middle flies straight, and it turns on; held by either end,
    neither of which is loaded."""
    plane, times = Support(along_1=0.0, along_2=0.0, about_3=0.0), np.linspace(0, 2, 5)
    free = {"root_support": FREE, "tip_support": None, end: plane}
    rotor = jb.Rotor(STIFF.beam, 0.3, **free)
    run = optimised(
        lambda: jb.simulate(
            SpatialRod(2), rotor, jb.ConstantSpeed(5.0), times, dt0=0.001,
            stepsize_controller=diffrax.ConstantStepSize(),
        )
    )()  # fmt: skip
    angle, middle = 5 * times, 0.8 * np.stack([0 * times + 1, 5 * times, 0 * times], 1)
    along = np.stack([np.cos(angle), np.sin(angle), 0 * times], 1)
    exact = np.stack([middle - along / 2, middle + along / 2], 1)
    places = np.asarray(run.displacement([0.0, 1.0])) + np.array([[0.3], [1.3]]) * np.eye(3)[0]
    attitude = np.asarray(jax.vmap(run.scene.motion.attitude)(run.times))
    in_space = np.einsum("tij,tpj->tpi", attitude, places)
    np.testing.assert_allclose(in_space, exact, atol=2e-7)


VALUES = jnp.array(
    [2.0, 1.3, 4e4, 11.0, 7.0, 6.0, 0.03, 0.4, 0.3, 0.2, 0.1, 1.5, 0.9, 0.3, 1e-3, 0.5, 0.1]
)


def outcome(p, solver, adjoint=None):
    """Tip and twist after a spin-up, by every number there is."""
    beam = jb.Beam(*p[:5], torsional_stiffness=p[5], polar_inertia=p[6])
    rotor = jb.Rotor(beam, p[7], p[8], pitch=p[9], precone=p[10])
    motion = jb.SmoothSpinUp(p[11], p[12], SKEW)
    loads = jb.Loads(
        jnp.array([0.0, -1.0, -0.5]), jnp.stack([0 * p[15], p[15], 0.4 * p[15]]),
        tip_moment=p[16] * jnp.ones(3),
    )  # fmt: skip
    run = jb.simulate(
        SpatialRod(3), rotor, motion, jnp.linspace(0.0, 0.4, 3), damping=jb.Damping(p[13], p[14]),
        loads=loads, stepsize_controller=diffrax.ConstantStepSize(), dt0=0.01, max_steps=64,
        solver=solver, adjoint=adjoint, throw=False,
    )  # fmt: skip
    return jnp.append(run.tip[-1], run.torsion(1.0)[-1])


@pytest.mark.exhaustive
@SOLVERS
def test_gradients_by_every_parameter(solver):
    """Both ways, against differences of the same discrete solution."""

    def value(p, adjoint=None):
        return outcome(p, solver, adjoint)

    push = jax.jit(
        lambda along: jax.jvp(lambda p: value(p, diffrax.ForwardMode()), (VALUES,), (along,))[1]
    )
    exact = np.stack([push(along) for along in jnp.eye(VALUES.size)], -1)
    pull = jax.jit(lambda weights: jax.vjp(value, VALUES)[1](weights)[0])
    back = np.stack([pull(weights) for weights in jnp.eye(4)])
    numeric, size = finite_difference(jax.jit(value), VALUES), np.asarray(VALUES)
    scale = np.abs(exact * size).max(1, keepdims=True)
    np.testing.assert_allclose(exact * size / scale, numeric * size / scale, rtol=0, atol=1e-7)
    np.testing.assert_allclose(back * size / scale, exact * size / scale, rtol=0, atol=2e-8)


@pytest.mark.exhaustive
def test_a_batch_is_its_cases():
    """Over speeds, one of which bends it beyond its range, or says so."""
    times = np.linspace(0, 1.0, 5)

    def run(speed):
        motion = jb.SmoothSpinUp(speed, 1.0, SKEW)
        return jb.simulate(SpatialRod(3), COUPLED, motion, times, throw=False)

    speeds = jnp.array([2.0, jnp.nan, 6.0])
    batch, one = jax.jit(jax.vmap(run))(speeds), jax.jit(run)
    assert list(batch.status) == [jb.Status.OK, jb.Status.INVALID_MOTION, jb.Status.OK]
    assert np.isnan(batch.tip[1]).all()
    for k in (0, 2):
        alone = one(speeds[k])
        np.testing.assert_allclose(batch.tip[k], alone.tip, rtol=0, atol=1e-7)
        np.testing.assert_allclose(batch.hub_torque[k], alone.hub_torque, rtol=1e-4, atol=1e-4)


@pytest.mark.exhaustive
def test_limits_and_starts():
    """A run ends at a deflection, and one that begins in a steady state stays there."""
    model, times = SpatialRod(4), np.linspace(0, 1.0, 5)
    motion = jb.SmoothSpinUp(6.0, 1.0, SKEW)
    run = jb.simulate(
        model, COUPLED, motion, times, event=jb.deflection_limit(0.3), stepsize_controller=TIGHT
    )
    assert run.status == jb.Status.OK
    reached = np.asarray(run.tip)[np.isfinite(np.asarray(run.times)), 1]
    np.testing.assert_allclose(np.abs(reached[-1]), 0.3, atol=1e-9)
    there = jb.simulate(
        model, COUPLED, motion, np.array([0.0, float(run.end_time)]), stepsize_controller=TIGHT
    )
    np.testing.assert_allclose(there.tip[-1, 1], reached[-1], atol=1e-7)
    steady, gravity = jb.ConstantSpeed(6.0), jb.Loads(np.array([0, 0, -9.81]))
    start = jb.steady_start(model, COUPLED, steady, loads=gravity)
    stays = jb.simulate(model, COUPLED, steady, times, loads=gravity, start=start)
    assert np.ptp(stays.tip, axis=0).max() < 1e-8
    same = jb.steady(model, COUPLED, 6.0, loads=gravity)
    np.testing.assert_allclose(stays.tip[0], same.tip, atol=1e-10)
    np.testing.assert_allclose(stays.hub_torque[-1], same.hub_torque, atol=1e-5)
