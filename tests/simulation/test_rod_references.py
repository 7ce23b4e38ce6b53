"""The rod in time against integration of velocities and forces alone, and closed forms of bodies
that fly."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipj

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam._numerics.quaternions import rotation
from tests.helpers import optimised
from tests.references import elastica
from tests.references.intrinsic_in_time import Scene, run
from tests.simulation.rods import (
    ALONG,
    FREE,
    TIGHT,
    coned,
    coupled,
    slender,
    spun_up,
    uniform,
)

TIMES = np.linspace(0, 6, 7)
STILL = jb.ConstantSpeed(0.0)
INCLINED = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
SKEW = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
# The blade of README.md; the beam of Y Fig. 3, twice as stiff in plane; and one where all couples.
README = slender(8.0, 0.20196, 5.0326e6, 566.4, 566.4, 0.5, 0.1)
ABRUPT = slender(30.5, 550.0, 6.4e8, 9.91e6, 4.95e6)


def reference(case, way, motion, times, n=10, steps=20):
    """What the tip does, by the equations of velocities and forces."""
    speed, duration = float(motion.speed), float(motion.duration)
    scene = spun_up(case, way, speed, duration, np.asarray(motion.axis))
    return run(scene, times, n, steps).tip


@pytest.mark.exhaustive
def test_the_reference_in_a_plane_is_an_elastica():
    """Of which angle and strain are polynomials; it neither shears nor has rotary inertia, and the
    other one next to none. The sizes of both agree as well."""
    length, mass, axial, bending = 2.0, 1.3, 4e4, 7.0
    times = np.linspace(0, 1, 6)
    stiffness = np.diag([axial, 1e9, 1e9, bending, bending, bending])
    inertia = np.diag([mass, mass, mass, 2e-8, 1e-8, 1e-8])
    case = uniform(stiffness, inertia, length, 0.4, 0.3)
    scene = spun_up(case, "smooth", 3.0, 1.0, [0, 0, 1])
    found, fewer = (run(scene, times, n, 10).tip for n in (12, 10))

    def speed(t):
        return 3 * (t - jnp.sin(2 * jnp.pi * t) / (2 * jnp.pi))

    beam = elastica.Beam(length, mass, axial, bending, 0.4, 0.3)
    exact = elastica.tip_history(beam, speed, times, 9, 4, 1e-10)
    assert np.abs(exact).max() > 1.5
    np.testing.assert_allclose(fewer, found, atol=2e-7)
    np.testing.assert_allclose(found[:, :2], exact, atol=2e-6)


QUINTIC = jb.motions.QuinticSpinUp
SPIN_UPS = {  # until when, to what share of the length, and sizes of model and reference
    "smooth, about a3": (README, "smooth", jb.SmoothSpinUp(4.0, 15.0), 15, 0.08, 8, 10),
    "smooth, inclined": (README, "smooth", jb.SmoothSpinUp(4.0, 15.0, INCLINED), 15, 0.5, 8, 10),
    "abrupt, about a3": (ABRUPT, "quintic", QUINTIC(0.5, 1.0), 10, 0.9, 12, 12),
    "abrupt, skew": (ABRUPT, "quintic", QUINTIC(0.5, 1.0, SKEW), 10, 0.9, 12, 12),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", SPIN_UPS)
def test_spin_ups(name):
    """To half of the length, and abruptly to nine tenths of it."""
    case, way, motion, end, least, degree, n = SPIN_UPS[name]
    times = np.linspace(0, end, end + 1)
    exact, fewer = (reference(case, way, motion, times, n + more, 20) for more in (2, 0))
    peak = np.linalg.norm(exact, axis=1).max()
    assert peak > least * float(case.rotor.length)
    np.testing.assert_allclose(fewer, exact, atol=3e-7 * peak)
    found = optimised(
        lambda: jb.simulate(
            SpatialRod(degree), case.rotor, motion, times, stepsize_controller=TIGHT
        )
    )()  # fmt: skip
    np.testing.assert_allclose(found.tip, exact, atol=1e-6 * peak)
    assert np.abs(found.imbalance).max() < 1e-8


@pytest.mark.slow
def test_a_coupled_blade_with_offsets():
    """Full sections with centres off a bent axis, twisted, pitched, with a body at the tip; to
    three fifths of its length."""
    case, times = coupled(), np.linspace(0, 1.0, 5)
    motion = jb.SmoothSpinUp(6.0, 1.0, SKEW)
    exact, fewer = (reference(case, "smooth", motion, times, n, 10) for n in (10, 8))
    np.testing.assert_allclose(fewer, exact, atol=1e-7)

    @jax.jit
    def found():
        control = diffrax.PIDController(rtol=1e-7, atol=1e-9)
        return jb.simulate(
            SpatialRod(8), case.rotor, motion, times, stepsize_controller=control, throw=False
        ).tip

    np.testing.assert_allclose(found(), exact, atol=1e-7)


@pytest.mark.exhaustive
@pytest.mark.parametrize("follows", [False, True])
def test_loads_on_a_blade_in_a_cone(follows):
    """The same blade in a cone, with a force and a moment that rise at its tip, in axes of the hub
    or in those of the blade, which turn with the last section."""
    case, times, angle = coned(coupled(), 0.3), np.linspace(0, 1.0, 5), 0.3
    force, moment = np.array([1.0, 2.0, -3.0]), np.array([0.5, -0.7, 0.9])
    cos, sin = np.cos(angle), np.sin(angle)
    tilt = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])

    def at_ends(t, turned):
        inward = tilt if follows else turned[1].T @ turned[0]
        six = t**4 * np.concatenate([inward @ force, inward @ moment])
        return np.stack([0 * six, six])

    scene = spun_up(case, "smooth", 5.0, 1.0, SKEW)._replace(loads=at_ends)
    exact = run(scene, times, 10, 20).tip
    loads = jb.Loads(
        tip_force=lambda t: t**4 * force, tip_moment=lambda t: t**4 * moment, follows=follows
    )
    found = optimised(
        lambda: jb.simulate(
            SpatialRod(8), case.rotor, jb.SmoothSpinUp(5.0, 1.0, SKEW), times, loads=loads,
            stepsize_controller=TIGHT,
        )
    )()  # fmt: skip
    np.testing.assert_allclose(found.tip, exact, atol=3e-8)
    assert np.abs(found.imbalance).max() < 1e-8


def turned(run, xi=0.5):
    """Rotations (T, 3, 3) of sections in space."""
    angles = np.asarray(run.rotation(xi))[:, 0]
    own = Rotation.from_rotvec(np.stack([angles[:, 0], -angles[:, 2], angles[:, 1]], 1))
    hub = jax.vmap(run.scene.motion.attitude)(run.times)
    return np.asarray(hub) @ own.as_matrix()


@functools.cache
def bar(sections, solver=None):
    """Its run, by the speed and axis of a hub that lets it go, its middle on the axis; by constant
    steps, since it rings at first, under what turns with it."""
    inertia = np.diag([1.0, 1, 1, *sections])
    case = uniform(1e9 * np.eye(6), inertia, 1.0, -0.5, root_support=FREE)
    return optimised(
        lambda speed, axis, step=0.002: jb.simulate(
            SpatialRod(2), case.rotor, jb.ConstantSpeed(speed, axis), TIMES, dt0=step,
            solver=solver, stepsize_controller=diffrax.ConstantStepSize(), balance_tolerance=0.1,
        )
    )  # fmt: skip


def precession(inertia, start, times):
    """Of a body that is alike across its first axis, by Euler: about that, and both about the
    angular momentum."""
    axial, across = inertia
    momentum = np.array([axial, across, across]) * start
    rest = start[0] * (1 - axial / across)
    own = Rotation.from_rotvec(rest * times[:, None] * ALONG)
    return (Rotation.from_rotvec(times[:, None] * momentum / across) * own).as_matrix()


@pytest.mark.exhaustive
def test_precession_of_a_body_that_flies():
    """Let go by a hub, turning five times."""
    axis, speed = np.array([0.6, 0.0, 0.8]), 5.0
    exact = precession((0.2, 0.1 + 1 / 12), speed * axis, TIMES)
    found = turned(bar((0.2, 0.1, 0.1))(speed, axis))
    np.testing.assert_allclose(found, exact, atol=5e-7)


@pytest.mark.exhaustive
def test_implicit_stages_of_a_body_that_flies():
    """Are of order 5, on turns that are far from small."""
    axis, speed = np.array([0.6, 0.0, 0.8]), 5.0
    exact = precession((0.2, 0.1 + 1 / 12), speed * axis, TIMES)
    run = bar((0.2, 0.1, 0.1), jb.solvers.ChordKvaerno5())
    errors = [np.abs(turned(run(speed, axis, 0.16 / 2**k)) - exact).max() for k in range(3)]
    np.testing.assert_allclose(np.log2(np.divide(errors[:-1], errors[1:])), 5, atol=0.3)


def tumbling(inertia, start, times):
    """Of a body whose moments all differ, by Jacobi's elliptic functions: w = (a dn, -b sn, c cn),
    where it begins without spin about its middle axis; and its rotation by that."""
    (i1, i2, i3), (a, _, c) = inertia, start
    rate = a * np.sqrt((i1 - i2) * (i1 - i3) / (i2 * i3))
    b = (i1 - i3) * a * c / (i2 * rate)
    parameter = (i2 - i3) * b * c / (i1 * a * rate)
    assert 0.8 < parameter < 1

    def slope(t, y):
        sn, cn, dn, _ = ellipj(rate * t, parameter)
        w = np.array([a * dn, -b * sn, c * cn])
        return np.concatenate([[-y[1:] @ w], y[0] * w + np.cross(y[1:], w)]) / 2

    found = solve_ivp(slope, times[[0, -1]], np.eye(4)[0], "DOP853", times, rtol=1e-12, atol=1e-13)
    return Rotation.from_quat(found.y[[1, 2, 3, 0]].T).as_matrix()


@pytest.mark.exhaustive
def test_a_body_that_tumbles():
    """About its middle axis, over and over."""
    start = np.array([4.0, 0.0, 2.0])
    speed = np.linalg.norm(start)
    exact = tumbling((0.3, 0.2 + 1 / 12, 0.1 + 1 / 12), start, TIMES)
    found = turned(bar((0.3, 0.2, 0.1))(speed, start / speed))
    np.testing.assert_allclose(found, exact, atol=7e-7)


STRAND = uniform(
    np.diag([1e4, 1e4, 1e4, 500.0, 500, 500]), np.diag([1.0, 1, 1, 20, 10, 10]), 10.0,
    root_support=FREE,
)  # fmt: skip


DEAD = 0.5 * np.array([0.08, 0.06, 0, 0.4, -0.3, 1.0])  # force and moments


def pulse(t, xp=jnp):
    """From zero to 200 and back, in two and a half seconds each, smoothly."""
    return xp.where(t < 5.0, 200 * xp.sin(np.pi * t / 5.0) ** 8, 0.0)


def push(t):
    return pulse(t) * DEAD[:3]


def wrench(t):
    return pulse(t) * DEAD[3:]


PUSHES = jb.Loads(tip_force=push, tip_moment=wrench, changes=[5.0])


@functools.cache
def strand_reference(n, steps):
    """Where root and tip go."""

    def dead(t, turned):
        force = pulse(t, np) * DEAD
        at_tip = (force.reshape(2, 3) @ turned[1]).ravel()
        return np.stack([np.zeros(6), at_tip])

    found = run(Scene(STRAND.rod, loads=dead), np.linspace(0, 10, 9), n, steps)
    return found.places - found.places[:1], found.energy


@functools.cache
def strand(degree, elements):
    """Its run."""
    times = np.linspace(0, 10, 9)
    return optimised(
        lambda: jb.simulate(
            SpatialRod(degree, elements), STRAND.rotor, STILL, times, loads=PUSHES,
            stepsize_controller=TIGHT,
        )
    )()  # fmt: skip


@pytest.mark.exhaustive
def test_a_strand_that_flies():
    """In space, as of J. C. Simo and L. Vu-Quoc, Computer Methods in Applied Mechanics and
    Engineering 66, 1988: its dimensions, and a force and moments at one end that rise and vanish
    again. Elements converge, to what velocities and forces do; it flies 50 m/s kg on."""
    exact, energy = strand_reference(12, 20)
    fewer, _ = strand_reference(10, 20)
    np.testing.assert_allclose(fewer, exact, atol=3e-5)
    for degree, elements, tolerance in ((6, 1, 1e-2), (8, 1, 7e-4), (6, 2, 3e-5), (8, 2, 4e-6)):
        found = strand(degree, elements)
        ends = np.asarray(found.displacement([0.0, 1.0]))
        np.testing.assert_allclose(ends, exact, atol=tolerance)
    np.testing.assert_allclose(found.energy, energy, atol=3e-6)


@jax.jit
def momenta(equations, q, v):
    """Momentum and moment of momentum about the origin, of nodes of a rod in a hub at rest."""
    rod = equations.rod
    u, p = rod.nodes(q)
    own = (rod.mass @ rod.of_velocities(v).reshape(-1)).reshape(-1, 2, 3)
    linear, angular = jnp.einsum("nij,nxj->xni", rotation(p), own)
    return jnp.sum(linear, 0), jnp.sum(angular + jnp.cross(rod.tables.place + u, linear), 0)


def momenta_of(run):
    """Those at all times."""
    states = zip(run.state.q, run.state.v, strict=True)
    found = [momenta(run.scene.equations, *pair) for pair in states]
    return [np.stack(part) for part in zip(*found, strict=True)]


@pytest.mark.exhaustive
def test_what_a_flying_strand_keeps():
    """Its centre goes as the impulse says, and energy and momenta stay; no hub holds it."""
    found = strand(8, 2)
    at, weight = np.polynomial.legendre.leggauss(16)
    places = np.asarray(found.displacement((1 + at) / 2))
    centre = np.einsum("p,tpi->ti", weight / 2, places)
    t = np.asarray(found.times)
    after = t >= 5.0
    speed = 1000 * 35 / 128 * DEAD[:3] / 10  # by the impulse, over the mass
    np.testing.assert_allclose(centre[after], (t[after, None] - 2.5) * speed, atol=3e-7)
    np.testing.assert_allclose(found.energy[after] / found.energy[-1], 1.0, atol=1e-7)
    linear, angular = (part[after] for part in momenta_of(found))
    np.testing.assert_allclose(linear, np.tile(10 * speed, (len(linear), 1)), atol=3e-8)
    np.testing.assert_allclose(angular, np.tile(angular[0], (len(angular), 1)), atol=2e-7)
    assert np.abs(found.hub_force).max() < 1e-10
    assert np.abs(found.hub_torque).max() < 1e-10
    assert np.abs(found.imbalance).max() < 1e-8


@pytest.mark.exhaustive
def test_the_strand_under_the_load_that_was_printed():
    """Twice as much of it, in a triangle of five seconds: elements converge, and all is kept."""
    times, dead = np.linspace(0, 10, 9), 2 * DEAD

    def triangle(t):
        return jnp.maximum(0.0, 200 * (1 - jnp.abs(t - 2.5) / 2.5))

    loads = jb.Loads(
        tip_force=lambda t: triangle(t) * dead[:3], tip_moment=lambda t: triangle(t) * dead[3:],
        changes=[2.5, 5.0],
    )  # fmt: skip
    coarse, fine = (
        optimised(
            lambda model=model: jb.simulate(
                model, STRAND.rotor, STILL, times, loads=loads,
                stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-9),
            )
        )()
        for model in (SpatialRod(6, 2), SpatialRod(8, 3))
    )  # fmt: skip
    ends = [np.asarray(run.displacement([0.0, 1.0])) for run in (coarse, fine)]
    assert np.abs(ends[1]).max() > 30  # the centre goes (4, 3) m/s
    np.testing.assert_allclose(*ends, atol=2e-3)
    after = times >= 5.0
    linear, angular = (part[after] for part in momenta_of(fine))
    np.testing.assert_allclose(linear, np.tile(500 * dead[:3], (len(linear), 1)), atol=3e-9)
    np.testing.assert_allclose(angular, np.tile(angular[0], (len(angular), 1)), atol=5e-8)
    np.testing.assert_allclose(fine.energy[after] / fine.energy[-1], 1.0, atol=1e-8)
    assert np.abs(fine.imbalance).max() < 1e-8
