"""Simulation: balances, outputs, loads, events, gradients, batches, and what goes wrong."""

import functools

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.beams import AS_BUILT, SPRINGS, short
from tests.helpers import (
    DISCRETE,
    ELEMENTS,
    YIELDING,
    finite_difference,
    name,
    optimised,
    reverse_mode,
)
from tests.simulation.common import BLADE, ROTOR, RUNS, TIGHT
from tests.tiers import exhaustive, slow

BUILT = [(m, AS_BUILT) for m in YIELDING]
OFTEN = [model for model, _ in RUNS]


def power_of_loads(scene, t, y):
    """Of gravity and the force at the tip, in the inertial frame."""
    hub, equations = scene.hub(t), scene.equations
    mass, first, _ = equations.rigid_moments

    def power(force, moment, along, carried):
        at, moved = jax.jvp(moment, (y.q,), (y.v,))
        at = at.at[0].add(along)
        return force @ (moved + carried * hub.velocity + jnp.cross(hub.angular_velocity, at))

    weight = power(hub.gravity, equations.first_moment, first, mass)
    return weight + power(scene.loads.at_tip(t), equations.tip, equations.tip_radius, 1.0)


@pytest.mark.parametrize(
    ("model", "rotor"),
    [exhaustive(*RUNS[0]), slow(*BUILT[0]), *(exhaustive(*case) for case in RUNS[1:] + BUILT[1:])],
    ids=name,
)
def test_work_balance_during_spin_up(model, rotor):
    """Hub torque times speed, gravity, tip force and damping give the change of total energy."""
    times = jnp.linspace(0.0, 1.0, 401)
    loads = jb.Loads(gravity=[0.0, -9.81, 0.0], tip_force=lambda t: jnp.array([2.0, 1.0, 0.0]) * t)
    damping = jb.Damping(mass_coefficient=0.3, stiffness_coefficient=2e-3)
    motion = jb.SmoothSpinUp(3.0, 1.0)
    run = jb.simulate(
        model, rotor, motion, times, loads=loads, damping=damping, stepsize_controller=TIGHT
    )

    def besides_hub(t, y):
        """Power of everything but the hub, less that lost to what is not conservative."""
        equations = run.scene.equations
        momentum = jax.grad(equations.kinetic_energy, 1)(y.q, y.v, jnp.zeros(3), jnp.zeros(3))
        lost = (0.3 * momentum + 2e-3 * equations.viscous_force(y.q, y.v)) @ y.v
        return power_of_loads(run.scene, t, y) - lost - equations.nonconservative_force(y.q) @ y.v

    speed = jax.vmap(motion.angular_speed)(times)
    power = run.hub_torque[:, 2] * speed + jax.jit(jax.vmap(besides_hub))(times, run.state)
    h = times[1] - times[0]
    weights = h / 3 * np.r_[1, np.tile([4, 2], 199), 4, 1]  # Simpson
    change = run.energy[-1] - run.energy[0]
    np.testing.assert_allclose(weights @ power, change, rtol=2e-6)
    assert np.abs(run.imbalance).max() < 1e-7


def drift(run):
    """Of the Jacobi integral, over the largest strain energy."""
    h = run.jacobi_integral
    return np.abs(h - h[0]).max() / np.abs(run.strain_energy).max()


LONG_RUNS = RUNS[:2]


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "rotor", "periods"),
    [slow(*RUNS[1], 10)]
    + [(*case, 100 if case in LONG_RUNS else 20) for case in [*RUNS, BUILT[0], BUILT[2]]],
    ids=name,
)
def test_jacobi_integral_is_constant_at_constant_speed(model, rotor, periods):
    """Drift below 1e-10 for each period of bending; ANCF has no energy, but a remainder."""
    if rotor is ROTOR:  # less slender: what counts is the number of steps, which stretch limits
        rotor = jb.Rotor(short(4e3), hub_radius=0.4, tip_mass=0.3)
    scale = np.sqrt(30 / 1.3) / 0.8 if rotor is SPRINGS else 3.5 * float(rotor.frequency_scale)
    end = periods * 2 * np.pi / scale
    speed = 0.3 * scale
    motion = jb.ConstantSpeed(speed)
    # Let go from the equilibrium under a force across the tip: bent, and stretch hardly rings.
    push = jb.Loads(tip_force=[0.0, 2.0 if rotor is SPRINGS else 0.08, 0.0])
    start = jb.steady_start(model, rotor, motion, loads=push)
    run = optimised(
        lambda: jb.simulate(
            model, rotor, motion, np.linspace(0, end, 50), start=start, max_steps=10**6,
            stepsize_controller=diffrax.PIDController(rtol=1e-8, atol=1e-10),
        )
    )()  # fmt: skip
    if isinstance(model, jb.papers.ANCF):
        # what the forces of B eq. A-5 do beyond the gradient of B eq. 9
        assert drift(run) < 1e-1
        assert np.abs(run.imbalance).max() < 1e-8
    else:
        assert drift(run) < 1e-10 * periods


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "model", [jb.Hybrid(2, 2, 2), jb.VonKarman(4, 2, 2), jb.papers.GreenANCF(2)], ids=name
)
def test_jacobi_integral_of_large_motion(model):
    """The same in space, about an inclined axis, and bent by a tenth of the length."""
    flat = isinstance(model, jb.papers.GreenANCF)
    motion = jb.ConstantSpeed(1.0, None if flat else jb.motions.inclined_axis(1.1))
    push = jb.Loads(tip_force=[0.0, -0.8, 0.0 if flat else 0.5])
    start = jb.steady_start(model, ROTOR, motion, loads=push)
    run = optimised(
        lambda: jb.simulate(
            model, ROTOR, motion, np.linspace(0, 20.0, 201), start=start, max_steps=10**6,
            stepsize_controller=TIGHT,
        )
    )()  # fmt: skip
    assert np.abs(run.tip[0, 1]) > 0.15
    assert drift(run) < 1e-8


@pytest.mark.slow
def test_steady_start_stays():
    """Spinning steadily, inclined and with gravity along the axis: nothing moves."""
    model = jb.VonKarman(5, 3, 2)
    motion = jb.ConstantSpeed(3.0, jb.motions.inclined_axis(1.2))
    axis = np.asarray(jb.motions.inclined_axis(1.2))
    loads = jb.Loads(gravity=-9.81 * axis)
    start = jb.steady_start(model, ROTOR, motion, loads=loads)
    run = jb.simulate(model, ROTOR, motion, [0.0, 0.5, 1.0], loads=loads, start=start)
    assert np.abs(start.q).max() > 1e-2
    np.testing.assert_allclose(run.state.q[-1], start.q, atol=1e-8)


def test_steady_stretch_of_a_rod():
    """L (tan b / b - 1), b = Omega L sqrt(rho / EA); rho Omega^2 L^3 / (3 EA) for small b."""
    beam = jb.Beam(10.0, 1.2, 2.8e7, 1.4e4, 1.4e4)
    speed, length = 6.0, 10.0
    b = speed * length * np.sqrt(1.2 / 2.8e7)
    start = jb.steady_start(jb.Hybrid(4, 1, 0), jb.Rotor(beam), jb.ConstantSpeed(speed))
    tip = jb.Hybrid(4, 1, 0).displacement(np.ones(1), jb.Rotor(beam))[0, 0] @ start.q
    np.testing.assert_allclose(tip, length * (np.tan(b) / b - 1), rtol=1e-8)
    np.testing.assert_allclose(tip, 1.2 * speed**2 * length**3 / (3 * 2.8e7), rtol=2e-4)
    # the strain of von Karman is the linear one while nothing bends
    start = jb.steady_start(jb.VonKarman(6, 1, 0), jb.Rotor(beam), jb.ConstantSpeed(speed))
    assert np.isclose(
        jb.VonKarman(6, 1, 0).displacement(np.ones(1), jb.Rotor(beam))[0, 0] @ start.q,
        tip,
        rtol=1e-8,
    )


@pytest.mark.release
def test_static_deflections():
    """Cantilever under a tip force and under its weight: F L^3 / 3 EI, rho g L^4 / 8 EI."""
    rotor, model = jb.Rotor(BLADE), jb.Hybrid(2, 5, 5)
    still = jb.ConstantSpeed(0.0)
    for load, expected in (
        (jb.Loads(tip_force=[0.0, 0.02, 0.0]), [0.0, 0.02 * 8 / (3 * 11.0), 0.0]),
        (jb.Loads(tip_force=[0.0, 0.0, 0.02]), [0.0, 0.0, 0.02 * 8 / (3 * 7.0)]),
        (jb.Loads(gravity=[0.0, 0.0, -0.1]), [0.0, 0.0, -0.1 * 1.3 * 16 / (8 * 7.0)]),
    ):
        start = jb.steady_start(model, rotor, still, loads=load)
        tip = jnp.tensordot(model.displacement(np.ones(1), rotor), start.q, 1)[:, 0]
        np.testing.assert_allclose(tip, expected, rtol=1e-9, atol=1e-12)


def test_tip_force_along_the_beam_buckles_it():
    """Euler: the stiffness of bending vanishes at F = pi^2 EI / (4 L^2)."""
    model, still = jb.Hybrid(0, 8, 0), jb.ConstantSpeed(0.0)
    euler = np.pi**2 * 11.0 / (4 * 2.0**2)
    for share in (0.999, 1.001):
        loads = jb.Loads([0, 0, 0], [-share * euler, 0, 0])
        scene = jb.results.Scene(model, jb.Rotor(BLADE), still, loads,
                         jb.Damping())  # fmt: skip
        zero = jnp.zeros(8)
        k, _ = scene.tangents(scene.inputs(jnp.zeros(())), zero, zero)
        assert (np.linalg.eigvalsh(k)[0] > 0) == (share < 1)


@pytest.mark.exhaustive
def test_damping_ratio():
    """(mass / w + stiffness w) / 2 of the first mode, by logarithmic decrement."""
    rotor, model = jb.Rotor(BLADE), jb.papers.GreenANCF(3)
    found = jb.modes(model, rotor, 0.0, jb.labels(in_plane=1))
    w, shape = float(found.frequency[0]), found.shape[0].real
    ratio = 0.02
    damping = jb.Damping(mass_coefficient=ratio * w, stiffness_coefficient=ratio / w)
    period = 2 * np.pi / (w * np.sqrt(1 - ratio**2))
    start = jb.solvers.State(1e-4 * shape, 0 * shape, jnp.zeros(()))
    run = jb.simulate(
        model, rotor, jb.ConstantSpeed(0.0), period * np.arange(4), damping=damping, start=start,
        stepsize_controller=TIGHT,
    )  # fmt: skip
    tip = run.tip[:, 1]
    decrement = np.log(tip[0] / tip[3]) / 3
    np.testing.assert_allclose(decrement, 2 * np.pi * ratio / np.sqrt(1 - ratio**2), rtol=1e-5)


@pytest.mark.slow
def test_outputs():
    model = jb.Hybrid(2, 3, 2)
    run = jb.simulate(model, ROTOR, jb.motions.QuinticSpinUp(3.0, 1.0), np.linspace(0, 1, 11))
    assert run.displacement([0.0, 0.5, 1.0]).shape == (11, 3, 3)
    np.testing.assert_allclose(run.displacement(0.0), 0.0, atol=1e-15)
    assert run.strain([0.0, 1.0]).shape == (11, 2)
    assert run.curvature(0.0).shape == (11, 1, 2)
    assert run.hub_force.shape == run.hub_torque.shape == (11, 3)
    # foreshortening: u1 = s - int u2'^2 / 2 (Y eq. 4), here of a deflection known in closed form
    x = np.linspace(0, 1, 2001)
    u2 = run.displacement(x)[-1, :, 1]
    slope = np.gradient(u2, x * 2.0, edge_order=2)
    short = np.trapezoid(slope**2, x * 2.0) / 2
    stretch = jnp.tensordot(model.displacement(np.ones(1), ROTOR), run.state.q[-1], 1)[0, 0]
    np.testing.assert_allclose(run.tip[-1, 0], stretch - short, rtol=1e-4)
    # tension at the root over EA, and the moment that the hub carries at the end of the spin-up
    centrifugal = 9.0 * (1.3 * 2.0 * (0.4 + 1.0) + 0.3 * 2.4)
    assert abs(run.strain(0.0)[-1, 0] * 4e4 / centrifugal - 1) < 0.2
    with pytest.raises(ValueError, match=r"in \[0, 1\]"):
        run.displacement(1.5)
    # where the largest value is at the end, it is that one
    early = jb.simulate(model, ROTOR, jb.motions.QuinticSpinUp(3.0, 1.0), np.linspace(0, 0.3, 11))
    np.testing.assert_allclose(early.peak()[0], early.tip[-1, 1], rtol=1e-12)
    assert float(early.peak()[1]) == 0.3


@pytest.mark.slow
def test_peak_between_output_times():
    """Of a free vibration, wherever its extremum falls between two output times."""
    model, still = jb.Hybrid(0, 1, 0), jb.ConstantSpeed(0.0)
    w = float(jb.modes(model, ROTOR, 0.0, jb.labels(in_plane=1)).frequency[0])
    times = jnp.linspace(0.0, 2.0 / w, 9)
    when = times[5] + jnp.array([-0.01, 0.0, 0.01, 0.3, 0.7]) * times[1]
    size = jnp.array([1.0, -1.0, 1.0, -1.0, 1.0])

    def peak(when, size):
        start = jb.solvers.State(
            (size * jnp.cos(w * when))[None], (w * size * jnp.sin(w * when))[None], jnp.zeros(())
        )
        run = jb.simulate(
            model, ROTOR, still, times, start=start, stepsize_controller=TIGHT, throw=False
        )
        return run.peak(), run.tip[0, 1] / start.q[0]

    (value, found), scale = jax.jit(jax.vmap(peak))(when, size)
    # error of the cubic: h^4 / 384 of the fourth derivative in value, h^3 in its slope
    np.testing.assert_allclose(value, size * scale, rtol=0.25**4 / 384)
    np.testing.assert_allclose(w * found, w * when, atol=0.25**3 / 100)


@pytest.mark.slow
def test_event_ends_the_run_where_the_limit_is_reached():
    run = jb.simulate(
        jb.Hybrid(2, 3, 0), ROTOR, jb.motions.QuinticSpinUp(3.0, 1.0), np.linspace(0, 1, 21),
        event=jb.deflection_limit(0.05),
    )  # fmt: skip
    reached = np.isfinite(run.times)
    assert 0 < float(run.end_time) < 1
    np.testing.assert_allclose(np.abs(run.tip[reached][-1, 1]), 0.05, rtol=1e-5)
    assert np.isnan(run.tip[~reached]).all()
    assert int(run.status) == jb.Status.OK
    np.testing.assert_allclose(np.abs(run.peak()[0]), 0.05, rtol=1e-5)


@pytest.mark.slow
def test_events_are_found_however_long_the_step_in_which_they_are():
    """Near a peak a step ends beyond it, with a slope that points away from the event; what a step
    passes and comes back from it does not see."""
    model, motion, times = jb.Hybrid(0, 2, 0), jb.motions.QuinticSpinUp(3.0, 3.0), (0.0, 4.0)
    fine = np.linspace(*times, 2001)
    way = np.abs(jb.simulate(model, ROTOR, motion, fine, stepsize_controller=TIGHT).tip[:, 1])
    last = way.argmax() + 1
    below = np.geomspace(1e-4, 0.1, 128)
    limits = way.max() * (1 - below)

    def end(limit):
        run = jb.simulate(
            model, ROTOR, motion, times, event=jb.deflection_limit(limit), throw=False,
            stepsize_controller=diffrax.PIDController(rtol=1e-3, atol=1e-4),
        )  # fmt: skip
        return run.end_time

    found = np.asarray(jax.jit(jax.vmap(end))(limits))
    seen, exact = found < times[1], np.interp(limits, way[:last], fine[:last])
    assert below[~seen].max() < 0.1
    np.testing.assert_allclose(found[seen], exact[seen], atol=3e-4)


@pytest.mark.exhaustive
def test_diffrax_objects_pass_through():
    times = np.linspace(0, 1, 5)
    case = (jb.Hybrid(2, 3, 0), ROTOR, jb.motions.QuinticSpinUp(3.0, 1.0), times)
    plain = jb.simulate(*case).tip
    dense = jb.simulate(*case, saveat=diffrax.SaveAt(dense=True))
    np.testing.assert_allclose(dense.tip, plain, atol=1e-7)
    steps = jb.simulate(
        *case, saveat=diffrax.SaveAt(steps=True), max_steps=500, solver=diffrax.Dopri8(),
        stepsize_controller=diffrax.ConstantStepSize(), dt0=0.004,
    )  # fmt: skip
    reached = np.isfinite(steps.times)
    assert reached.sum() == 250
    np.testing.assert_allclose(steps.tip[reached][-1], plain[-1], atol=1e-6)
    late = jb.simulate(*case[:3], [0.25, 0.5], saveat=diffrax.SaveAt(t1=True))
    assert late.times.shape == (1,)
    ended = jb.simulate(*case, saveat=diffrax.SaveAt(dense=True), event=jb.deflection_limit(0.05))
    assert 0 < float(ended.end_time) < 1
    assert np.isnan(ended.tip[-1]).all()
    own = jb.simulate(*case, saveat=diffrax.SaveAt(t1=True, fn=lambda t, y, scene: y.q[0]))
    assert own.solution.ys.shape == (1,)
    assert own.times.size == 0


# length, density, EA, EI, hub, tip mass; speed, duration; damping. For springs m, L, d, k_T, k_r.
# The spin-up outlasts the run: differences across its end would see the kink of a third derivative.
VALUES = jnp.array([2.0, 1.3, 4e4, 150.0, 0.4, 0.3, 3.0, 1.4, 0.3, 2e-3])
SPRING_VALUES = jnp.array([1.3, 0.8, 0.4, 6000.0, 30.0, 3.0, 1.4, 0.3, 2e-3])


def outcome(model, p, **kwargs):
    """Peak deflection, within the run, and final one as a function of every parameter."""
    if model.rotor_type is jb.papers.SpringRotor:
        rotor = jb.papers.SpringRotor(*p[:5])
    else:
        rotor = jb.Rotor(jb.Beam(p[0], p[1], p[2], p[3], p[3]), p[4], p[5])
    motion, damping = jb.SmoothSpinUp(p[-4], p[-3]), jb.Damping(p[-2], p[-1])
    run = jb.simulate(
        model, rotor, motion, jnp.linspace(0.0, 1.2, 13), damping=damping, throw=False, **kwargs
    )
    return jnp.stack([run.peak()[0], run.tip[-1, 1]])


@pytest.mark.exhaustive
@pytest.mark.parametrize(("model", "rotor"), [slow(*RUNS[0]), *RUNS[1:]], ids=name)
def test_gradients_by_every_parameter(model, rotor):
    """Forward and reverse mode against differences of the same discrete solution, to 1e-6."""
    p = SPRING_VALUES if rotor is SPRINGS else VALUES
    fixed = {"stepsize_controller": diffrax.ConstantStepSize(), "dt0": 0.02, "max_steps": 64}

    def value(p, **kwargs):
        return outcome(model, p, **fixed, **kwargs)

    def forward_only(p):
        return value(p, adjoint=diffrax.ForwardMode())

    # One direction at a time: what is not batched compiles in half the time.
    push = jax.jit(lambda along: jax.jvp(forward_only, (p,), (along,))[1])
    forward = np.stack([push(along) for along in jnp.eye(p.size)], -1)
    alone, jacobian = reverse_mode(value, 2)
    reverse, difference = jacobian(p), finite_difference(alone, p, 1e-3)
    np.testing.assert_allclose(forward * p[None], difference * p[None], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9, atol=1e-11 * np.abs(forward).max())
    assert np.subtract(*np.abs(alone(p))) > 1e-3  # the peak is not the end


@pytest.mark.release
@pytest.mark.slow
def test_gradient_of_the_smallest_model():
    """Reverse mode through adaptive steps, by hub radius, against differences."""

    def final(radius):
        run = jb.simulate(
            jb.Hybrid(0, 1, 0), jb.Rotor(BLADE, radius), jb.motions.QuinticSpinUp(3.0, 1.4),
            [0.0, 1.0],
            stepsize_controller=TIGHT, max_steps=1000,
        )  # fmt: skip
        return run.tip[-1, 1]

    change = finite_difference(lambda r: final(r[0]), jnp.array([0.4]), 1e-2)
    np.testing.assert_allclose(jax.grad(final)(0.4), change[0], rtol=1e-6)


@pytest.mark.exhaustive
def test_gradients_of_adaptive_steps_under_vmap():
    """Lanes in lock-step, of unlike lengths, have the gradients of single runs and of differences,
    within what steps chosen for 1e-9 leave of either."""
    model, p = jb.Hybrid(2, 3, 0), VALUES
    lanes = jnp.stack([p, p.at[-4].set(1.0), p.at[3].multiply(20.0)])

    def value(p):
        peak, end = outcome(model, p, stepsize_controller=TIGHT)
        return peak + 0.7 * end

    reverse = jax.jit(jax.vmap(jax.grad(value)))(lanes)
    single = jax.jit(jax.value_and_grad(value))
    for lane, found in zip(lanes, reverse, strict=True):
        effect = np.abs(found * lane).max()
        assert (np.abs((found - single(lane)[1]) * lane) < 1e-5 * effect).all()
    difference = finite_difference(lambda v: single(p.at[-4].set(v[0]))[0], p[-4:-3], 3e-3)
    np.testing.assert_allclose(reverse[0][-4], difference[0], rtol=1e-5)


SPATIAL = jnp.array([2.0, 1.3, 4e4, 11.0, 7.0, 0.4, 0.3, 3.0, 1.4, 1.1, -2.0, 0.5])


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.Hybrid(1, 2, 2), jb.VonKarman(3, 2, 2)])
def test_gradients_in_space(model):
    """By both bending stiffnesses, the angle of the axis, gravity and the force at the tip."""

    def final(p, **kwargs):
        run = jb.simulate(
            model, jb.Rotor(jb.Beam(*p[:5]), p[5], p[6]),
            jb.motions.QuinticSpinUp(p[7], p[8], jb.motions.inclined_axis(p[9])), [0.0, 0.5, 1.0],
            loads=jb.Loads(p[10] * jnp.eye(3)[2], p[11] * jnp.ones(3)), throw=False,
            stepsize_controller=diffrax.ConstantStepSize(), dt0=0.01, max_steps=128, **kwargs,
        )  # fmt: skip
        return run.tip[-1, 1:]

    value, jacobian = reverse_mode(final, 2)
    reverse, difference = jacobian(SPATIAL), finite_difference(value, SPATIAL, 1e-3)
    np.testing.assert_allclose(
        reverse * SPATIAL[None], difference * SPATIAL[None], rtol=1e-6, atol=1e-8
    )
    assert (np.abs(reverse * SPATIAL[None]).max(0) > 1e-6).all()  # each of them matters


class Circle(eqx.Module):
    """A turntable on a swing: radius, tilt and rates are parameters of the motion."""

    p: jax.Array

    def position(self, t):
        angle = self.p[0] * t
        return self.p[1] * jnp.stack([jnp.sin(angle), 1 - jnp.cos(angle), 0 * t])

    def rotation(self, t):
        tilt = self.p[2] * jnp.sin(t)
        return jb.ConstantSpeed(1.0).attitude(self.p[3] * t) @ jb.ConstantSpeed(
            1.0, [0.0, 1.0, 0.0]
        ).attitude(tilt)


MOTIONS = {
    "Modulated": (lambda p: jb.motions.ModulatedSpeed(p[0], p[1], p[2]), [3.0, 0.4, 5.0]),
    "UpThenDown": (
        lambda p: jb.motions.SpinUpThenDown(jb.motions.QuinticSpinUp(p[0], p[1]), p[2]),
        [3.0, 0.545, 0.615]
    ),
    "Velocity": (
        lambda p: jb.motions.HubVelocity(
            jax.tree_util.Partial(lambda p, t: p * jnp.sin(3 * t) * jnp.ones(3), p[0]),
            jax.tree_util.Partial(lambda p, t: p * jnp.cos(2 * t) * jnp.ones(3), p[1]),
        ),
        [0.3, 0.7],
    ),
    "Pose": (
        lambda p: jb.motions.HubPose(Circle(p).position, Circle(p).rotation), [1.2, 0.4, 0.3, 1.5]
    ),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize(("build", "p"), MOTIONS.values(), ids=MOTIONS.keys())
def test_gradients_by_parameters_of_motions(build, p):
    p = jnp.array(p)

    def final(p):
        run = jb.simulate(
            jb.Hybrid(1, 1, 1), ROTOR, build(p), [0.0, 0.5, 1.0], throw=False,
            stepsize_controller=diffrax.ConstantStepSize(), dt0=0.005, max_steps=256,
        )  # fmt: skip
        return run.tip[-1]

    value, jacobian = reverse_mode(final, 3)
    reverse = jacobian(p)
    # Steps so small that no kink of a motion passes a stage: UpThenDown has three.
    difference = finite_difference(value, p, 1e-4)
    effect = reverse * p[None]
    np.testing.assert_allclose(effect, difference * p[None], rtol=1e-6, atol=1e-9)
    assert (np.abs(effect).max(0) > 1e-6).all()


def run_case(**changes):
    case = {
        "model": jb.Hybrid(2, 3, 0), "rotor": ROTOR, "motion": jb.motions.QuinticSpinUp(3.0, 1.0),
        "times": np.linspace(0, 1, 5),
    } | changes  # fmt: skip
    return jb.simulate(case.pop("model"), case.pop("rotor"), case.pop("motion"), **case)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"times": [0.0, np.nan]}, ValueError, "times must be finite and increasing"),
        ({"times": [0.0, 1.0, 0.5]}, ValueError, "times must be finite and increasing"),
        ({"times": [0.0]}, ValueError, "times must be a list of 2 or more"),
        slow(
            {"saveat": diffrax.SaveAt(ts=jnp.array([0.5, 2.0]))},
            ValueError,
            "saveat must save within them",
        ),
        ({"motion": 3.0}, TypeError, "motion must be a Motion, got float"),
        ({"rotor": SPRINGS}, TypeError, "rotor must be a Rotor, got SpringRotor"),
        ({"start": jnp.zeros(5)}, TypeError, "start must be a State"),
        (
            {"start": jb.solvers.State(jnp.zeros(4), jnp.zeros(5), jnp.zeros(()))},
            ValueError,
            r"start.q must have shape \(5,\), got \(4,\)",
        ),
        slow(
            {"motion": jb.motions.QuinticSpinUp(3.0, 1.0, jb.motions.inclined_axis(1.0))},
            ValueError,
            "leave the plane of rotation",
        ),
        slow({"loads": jb.Loads(gravity=[0, 0, -9.81])}, ValueError, "leave the plane"),
        (
            {
                "motion": jb.motions.HubVelocity(lambda t: jnp.zeros(3), lambda t: jnp.zeros(3)),
                "loads": jb.Loads(gravity=[0, -9.81, 0]),
            },
            ValueError,
            "gravity needs the attitude of the hub",
        ),
        ({"max_steps": 3}, RuntimeError, "used up max_steps"),
        slow(
            {"stepsize_controller": diffrax.PIDController(
                rtol=1e-9, atol=1e-12, dtmin=0.05, force_dtmin=False
            )},
            RuntimeError,
            "could not make a step",
        ),
        slow(
            {"solver": diffrax.Euler(), "stepsize_controller": diffrax.ConstantStepSize(),
             "dt0": 0.01},
            RuntimeError,
            "not finite|ten lengths",
        ),
        slow(
            {"model": jb.Classical(2, 3, 0), "motion": jb.motions.QuinticSpinUp(12.0, 0.5),
             "times": np.linspace(0, 3, 9)},
            RuntimeError,
            "more than ten lengths",
        ),
    ],
)  # fmt: skip
def test_what_goes_wrong_is_told(changes, error, message):
    with pytest.raises(error, match=message):
        run_case(**changes)


@pytest.mark.exhaustive
def test_what_a_bad_case_brings_along():
    """A bad rotor or time beside times that a saveat or a controller holds: a status each."""
    times = jnp.array([0.0, 1.5, 3.0])
    steps = diffrax.StepTo(jnp.linspace(0.0, 3.0, 301))

    @jax.jit
    @jax.vmap
    def status(tip_mass, late):
        run = jb.simulate(
            jb.Hybrid(0, 1, 0), jb.Rotor(BLADE, 0.4, tip_mass),
            jb.motions.QuinticSpinUp(1.0, 1.0), times,
            saveat=diffrax.SaveAt(ts=jnp.stack([0.0 * late, late])), throw=False,
            stepsize_controller=steps,
        )  # fmt: skip
        return run.status, jnp.stack([run.tip[-1, 1], run.peak()[0], run.energy[0]])

    found, tip = status(jnp.array([0.3, -1.0, 0.3, 0.3]), jnp.array([3.0, 3.0, 4.0, jnp.nan]))
    assert [jb.Status(int(s)).name for s in found] == [
        "OK", "INVALID_TIP_MASS", "INVALID_TIMES", "INVALID_TIMES"
    ]  # fmt: skip
    assert np.isfinite(tip[0]).all()
    assert np.isnan(tip[1]).all()  # not those of the harmless numbers that it ran with


@pytest.mark.exhaustive
def test_verdict_does_not_depend_on_what_is_saved():
    """A manoeuvre that ends at rest has no energy at its ends; loads may vanish at outputs."""
    motion = jb.motions.SpinUpThenDown(jb.SmoothSpinUp(3.0, 20.0), 25.0)
    run = jb.simulate(jb.Hybrid(0, 1, 0), ROTOR, motion, [0.0, 50.0])
    assert int(run.status) == jb.Status.OK
    aside = jb.Loads(tip_force=lambda t: jnp.array([0.0, 0.0, 5.0]) * jnp.sin(jnp.pi * t) ** 2)
    with pytest.raises(ValueError, match="leave the plane"):
        jb.simulate(jb.Hybrid(2, 3, 0), ROTOR, motion, [0.0, 1.0, 2.0], loads=aside)


@pytest.mark.exhaustive
def test_default_tolerance_suits_stiff_beams():
    """Deflections of a millionth of the length are resolved as well as large ones."""
    rotor = jb.Rotor(jb.Beam(2.0, 1.3, 1e9, 1e7, 1e7), 0.4, 0.3)
    for model in (jb.Hybrid(2, 3, 0), jb.papers.GreenANCF(2)):
        case = model, rotor, jb.motions.QuinticSpinUp(3.0, 1.0), np.linspace(0.0, 1.0, 11)
        run = jb.simulate(*case)
        exact = jb.simulate(
            *case, max_steps=10**6, stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-14)
        )
        np.testing.assert_allclose(run.peak()[0], exact.peak()[0], rtol=1e-4)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "adjoint",
    [diffrax.DirectAdjoint(), diffrax.RecursiveCheckpointAdjoint(checkpoints=5),
     diffrax.ForwardMode(), diffrax.BacksolveAdjoint()],
    ids=lambda a: type(a).__name__,
)  # fmt: skip
def test_adjoints_solvers_and_progress_pass_through(adjoint):
    differentiate = jax.jacfwd if isinstance(adjoint, diffrax.ForwardMode) else jax.grad
    change = change_by_speed()
    slope = jax.jit(differentiate(functools.partial(by_speed, adjoint=adjoint)))(3.0)
    np.testing.assert_allclose(slope, change, rtol=1e-5)


def by_speed(speed, **options):
    run = jb.simulate(
        jb.Hybrid(0, 1, 0), ROTOR, jb.motions.QuinticSpinUp(speed, 1.0), [0.0, 1.0],
        solver=diffrax.Dopri8(), max_steps=64, progress_meter=diffrax.TextProgressMeter(),
        stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-10), **options,
    )  # fmt: skip
    return run.tip[-1, 1]


@functools.cache
def change_by_speed():
    plain = jax.jit(lambda s: by_speed(s[0]))
    return finite_difference(plain, jnp.array([3.0]), 1e-2)[0]


def test_backsolve_says_what_it_needs():
    with pytest.raises(ValueError, match="BacksolveAdjoint integrates another system"):
        run_case(adjoint=diffrax.BacksolveAdjoint())


@pytest.mark.exhaustive
def test_lanes_that_end_badly_leave_others_alone():
    """Diverged, out of steps: neighbours, and their gradients, are those of single runs."""

    def tip(model, speed, **kwargs):
        motion = jb.motions.QuinticSpinUp(speed, 0.5)
        run = jb.simulate(
            model, ROTOR, motion, np.linspace(0.0, 3.0, 9), throw=False, **kwargs
        )  # fmt: skip
        return run.tip[-1, 1], run.status

    fast = 12.0
    for model, gentle, kwargs, ended in (
        (jb.Classical(2, 3, 0), 0.5, {}, jb.Status.DIVERGED),
        (jb.Hybrid(2, 3, 0), 0.0, {"max_steps": 64}, jb.Status.MAX_STEPS),
    ):
        one = jax.jit(jax.value_and_grad(lambda s: tip(model, s, **kwargs), has_aux=True))  # noqa: B023
        (value, status), slope = jax.jit(jax.vmap(one))(jnp.array([gentle, fast]))
        assert status.tolist() == [jb.Status.OK, ended]
        (alone, _), alone_slope = one(gentle)
        np.testing.assert_allclose(value[0], alone, rtol=1e-12)
        np.testing.assert_allclose(slope[0], alone_slope, rtol=1e-9)
        assert np.abs(slope[0]) > 1e-3


@pytest.mark.parametrize(
    ("model", "rotor"),
    [(jb.Hybrid(2, 2, 2), ROTOR)]
    + [slow(m, ROTOR) for m in (jb.Classical(2, 2, 2), jb.VonKarman(3, 2, 2))]
    + [slow(*BUILT[0]), *(exhaustive(*case) for case in BUILT[1:])]
    + [slow(m, ROTOR) if m in OFTEN else exhaustive(m, ROTOR) for m in ELEMENTS]
    + [slow(m, SPRINGS) if m in OFTEN else exhaustive(m, SPRINGS) for m in DISCRETE],
    ids=name,
)
def test_force_and_torque_of_the_hub_balance_power(model, rotor):
    """F.v + C.omega + tip power = rate of the total energy less gravity's, and what the model has
    of forces without a potential, for any motion that it bears."""
    rng = np.random.default_rng(5)
    a, b = jnp.asarray(rng.normal(size=(2, 3)))
    load = np.array([[0.3, -9.81, 2.0], [1.0, 2.0, -0.5]])
    axis = np.array([0.6, 0.0, 0.8])
    if jb.models.Direction.FLAP not in model.directions:
        flat = np.array([1.0, 1.0, 0.0])
        a, b, load, axis = flat * a, flat * b, flat * load, np.array([0.0, 0.0, 1.0])

    def rotation(t):
        turn = jb.ConstantSpeed(1.3, axis).attitude(t)
        return turn @ jb.motions.QuinticSpinUp(2.0, 3.0).attitude(t)

    motion = jb.motions.HubPose(lambda t: jnp.sin(t * a) + b * t**2, rotation)
    loads = jb.Loads(*load)
    q, v = jnp.asarray(0.05 * rng.normal(size=(2, len(model.directions))))

    @jax.jit
    def both(t):
        scene = jb.results.Scene(model, rotor, motion, loads, jb.Damping())
        hub, y = scene.hub(t), jb.solvers.State(q, v)
        moving = jb.solvers.State(v, scene.acceleration(t, q, v))
        rate = jax.jvp(scene.total_energy, (t, y), (jnp.ones(()), moving))[1]
        force, torque = scene.reaction(t, y)
        of_hub = force @ hub.velocity + torque @ hub.angular_velocity
        lost = scene.equations.nonconservative_force(q) @ v
        return rate, power_of_loads(scene, t, y) + of_hub - lost

    np.testing.assert_allclose(*both(jnp.asarray(0.7)), rtol=1e-11)


@pytest.mark.exhaustive
def test_hub_carries_the_weight():
    """At rest under gravity: F = -M g, C = -S x g."""
    down = jb.Loads([0.0, -9.81, 0.0])
    still, model = jb.ConstantSpeed(0.0), jb.Hybrid(0, 4, 0)
    stiff = jb.Rotor(jb.Beam(2.0, 1.3, 1e9, 1e6, 1e6), 0.4, 0.3)
    start = jb.steady_start(model, stiff, still, loads=down)
    run = jb.simulate(model, stiff, still, [0.0, 0.1], loads=down, start=start)
    np.testing.assert_allclose(run.hub_force[-1, 1], 9.81 * (2.6 + 0.3), rtol=1e-9)
    np.testing.assert_allclose(run.hub_torque[-1, 2], 9.81 * (2.6 * 1.4 + 0.3 * 2.4), rtol=1e-6)


@pytest.mark.exhaustive
def test_a_success_that_is_nonsense_is_flagged():
    """A fixed step too long for an explicit solver to follow the bending: finite, and wrong."""
    loose = {"solver": diffrax.Heun(), "stepsize_controller": diffrax.ConstantStepSize()}
    model = jb.Hybrid(0, 1, 0)
    good = run_case(model=model)
    bad = run_case(model=model, throw=False, dt0=0.25, **loose)
    assert bad.solution.result == diffrax.RESULTS.successful
    assert np.abs(bad.partial.tip[-1] - good.tip[-1]).max() > 0.01
    assert np.isnan(bad.tip).all()
    assert int(bad.status) == jb.Status.UNBALANCED
    assert int(good.status) == jb.Status.OK


@pytest.mark.slow
def test_batch_keeps_failures_to_themselves():
    """Bad parameters: a status each, neighbours exact."""
    model = jb.Hybrid(2, 3, 0)

    def case(tip_mass, duration):
        run = jb.simulate(
            model, jb.Rotor(BLADE, 0.4, tip_mass), jb.SmoothSpinUp(3.0, duration),
            jnp.linspace(0.0, 1.0, 5), throw=False,
        )  # fmt: skip
        return run.tip[-1, 1], run.status, (run.end_time, run.times, run.state)

    tips = jnp.array([0.3, -1.0, np.nan, 0.3, 0.1])
    durations = jnp.array([1.0, 1.0, 1.0, -2.0, 0.7])
    value, status, more = jax.jit(jax.vmap(case))(tips, durations)
    ok, tip, motion = jb.Status.OK, jb.Status.INVALID_TIP_MASS, jb.Status.INVALID_MOTION
    np.testing.assert_array_equal(status, [ok, tip, tip, motion, ok])
    # What is out of range was not simulated, so that it has no other numbers either.
    for field in jax.tree.leaves(more):
        assert np.isnan(field[1:4]).all()
        assert np.isfinite(field[jnp.array([0, 4])]).all()
    for i in (0, 4):
        alone = jax.jit(case)(tips[i], durations[i])[0]
        np.testing.assert_allclose(value[i], alone, rtol=1e-9)


@pytest.mark.exhaustive
def test_bad_times_in_a_batch():
    """Decreasing or NaN times of one lane are its own affair."""

    def case(times):
        run = jb.simulate(
            jb.Hybrid(0, 1, 0), ROTOR, jb.motions.QuinticSpinUp(3.0, 1.0), times, throw=False
        )
        return run.tip[-1, 1], run.status

    lanes = jnp.array([[0.0, 0.5, 1.0], [0.0, 1.0, 0.5], [0.0, jnp.nan, 1.0], [0.0, 0.2, 1.0]])
    tip, status = jax.jit(jax.vmap(case))(lanes)
    invalid = jb.Status.INVALID_TIMES
    np.testing.assert_array_equal(status, [jb.Status.OK, invalid, invalid, jb.Status.OK])
    np.testing.assert_allclose(tip[0], tip[3], rtol=1e-5)


def test_single_precision_warns():
    with jax.enable_x64(False):
        rotor = jb.Rotor(BLADE)
        with pytest.warns(UserWarning, match="32-bit"), pytest.raises(TypeError, match="motion"):
            jb.simulate(jb.Hybrid(0, 1, 0), rotor, None, [0.0, 1.0])


def gap(t, value):
    """NaN for a hundredth of a run from 0 to 1, off the output times and their 64th parts."""
    return jnp.where((t > 0.392) & (t < 0.402), jnp.nan, value)


@pytest.mark.slow
def test_a_gap_in_motion_or_load_between_outputs_is_named():
    def run(motion, loads):
        return jb.simulate(
            jb.papers.DiscreteNC(),
            SPRINGS,
            motion,
            [0.0, 1.0],
            loads=loads,
            max_steps=2000,
            throw=False,
        ).status

    steady = jb.motions.HubVelocity(lambda t: jnp.zeros(3), lambda t: jnp.array([0.0, 0.0, 1.0]))
    torn = jb.motions.HubVelocity(
        lambda t: jnp.zeros(3), lambda t: jnp.array([0.0, 0.0, gap(t, 1.0)])
    )
    push = jb.Loads(tip_force=lambda t: jnp.array([0.0, gap(t, 1.0), 0.0]))
    assert run(torn, jb.Loads()) == jb.Status.INVALID_MOTION
    assert run(steady, push) == jb.Status.INVALID_LOAD


@pytest.mark.slow
def test_derivatives_of_a_run_at_rest():
    """By a speed that is zero: nothing moves, and yet steps are as short as derivatives need. As
    differences have it, which move."""
    times = jnp.linspace(0.0, 3.0, 7)
    motion = jb.SmoothSpinUp

    @jax.jit
    def both(speed, rate):
        def tip(speed):
            run = jb.simulate(
                jb.Hybrid(0, 2, 0), ROTOR, motion(speed, 1.5), times, throw=False,
                adjoint=diffrax.ForwardMode(),
            )  # fmt: skip
            return run.tip[:, 1]

        return jax.jvp(tip, (speed,), (rate,))

    h = 1e-4
    expected = (both(h, 0.0)[0] - both(-h, 0.0)[0]) / (2 * h)
    found = both(0.0, 1.0)[1]
    assert float(jnp.abs(expected).max()) > 1e-3
    np.testing.assert_allclose(found, expected, atol=1e-5 * float(jnp.abs(expected).max()))
