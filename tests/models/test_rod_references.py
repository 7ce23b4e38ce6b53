"""Statics and vibration of the rod against closed forms, and integration that knows of no
elements."""

import functools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.special import jv

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam.blades import Blade
from tests.references import full_rod, intrinsic
from tests.references.rod import lateral_buckling

POINTS = np.linspace(0, 1, 161)
ALONG = np.eye(3)[0]
# Bathe and Bolourchi 1979: a bend of 45 degrees, of radius 100 and a section 1 x 1.
RADIUS, BEND = 100.0, np.pi / 4
SQUARE = np.diag([1e7, 41.6667e5, 41.6667e5, 8.333e5, 8.333e5, 8.333e5])


@jax.jit
def held(axis, stiffness, force, moment):
    """Points of the bent axis half way and at the tip, and force and moment at the root."""
    unit = np.diag([1.0, 1.0, 1.0, 2e-3, 1e-3, 1e-3])
    blade = Blade([0, 1], jnp.stack([stiffness] * 2), [unit] * 2, axis)
    loads = jb.Loads(tip_force=force, tip_moment=moment)
    state = jb.steady(SpatialRod(10, 2), jb.Rotor(blade), 0.0, loads=loads, throw=False)
    at = np.array([0.5, 1.0])
    root = state.section_force(0.0)[0], state.section_moment(0.0)[0]
    return blade.axis_at(at)[0] + state.displacement(at), *root, state.status


def integrated(place, tangent, turned, stiffness, length, root, at=(0.5, 1.0), **loads):
    """The same points by shooting, from what elements say of the root."""

    def across(s):
        both = np.kron(np.eye(2), turned(s))
        return both @ stiffness @ both.T

    case = full_rod.Case(
        place=place, tangent=tangent, stiffness=across, inertia=lambda s: np.eye(6), length=length,
        **{name: np.asarray(load, float) for name, load in loads.items()},
    )  # fmt: skip
    force, moment = (np.asarray(part) for part in root)
    guess = np.concatenate([force, [moment[0], -moment[2], moment[1]]])
    return full_rod.steady(case, guess, np.array(at) * length)[:, :3]


def straight(length):
    return {"place": lambda s: s * ALONG, "tangent": lambda s: ALONG, "turned": lambda s: np.eye(3),
            "length": length}  # fmt: skip


@pytest.mark.exhaustive
def test_a_bend_on_the_arc_and_on_a_parabola():
    """Under 600 out of the plane: on the true arc as integrated along it, and on the parabola
    through its ends and its middle, which is another problem, as Kynema states it."""
    angle = BEND * POINTS
    arc = RADIUS * np.stack([np.sin(angle), np.cos(angle) - 1, 0 * angle], 1)
    force = [0, 0, 600.0]
    found, *root, status = held(arc, SQUARE, force, np.zeros(3))
    assert status == 0

    def turned(s):
        cos, sin = np.cos(s / RADIUS), np.sin(s / RADIUS)
        return np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]])

    def place(s):
        return RADIUS * np.array([np.sin(s / RADIUS), np.cos(s / RADIUS) - 1, 0])

    exact = integrated(
        place, lambda s: turned(s)[:, 0], turned, SQUARE, RADIUS * BEND, root, force=force
    )
    np.testing.assert_allclose(found, exact, atol=1e-8)
    ends = np.array([[0, 0, 0], [38.2683, -7.61205, 0], [70.7107, -29.2893, 0]])
    along = ends[2, 0] * POINTS
    parabola = np.stack([along, np.polyval(np.polyfit(*ends.T[:2], 2), along), 0 * along], 1)
    found, *_ = held(parabola, SQUARE, force, np.zeros(3))
    stated = [-23.6459716009048, 13.7208006040058, 53.5776450626989]
    np.testing.assert_allclose(found[1] - parabola[-1], stated, atol=1e-5)


@pytest.mark.exhaustive
def test_a_helix():
    """Of a beam that is alike in all directions, by a dead moment at its end: exp(s [M] / EI) turns
    its tangent. And, with a force as well, as integrated."""
    stiff = np.diag([1e5, 1e5, 1e5, 1.0, 1.0, 1.0])
    moment = np.array([1.0, 2.0, 0.0])
    found, *_ = held(POINTS[:, None] * ALONG, stiff, np.zeros(3), moment)
    skew = np.cross(np.eye(3), moment)
    generator = np.block([[skew, ALONG[:, None]], [np.zeros((1, 4))]])
    places = [expm(s * generator)[:3, 3] for s in (0.5, 1.0)]
    np.testing.assert_allclose(found, places, atol=1e-8)
    force = np.array([0.5, -1.0, 3.0])
    found, *root, _ = held(POINTS[:, None] * ALONG, stiff, force, moment)
    exact = integrated(stiffness=stiff, root=root, force=force, moment=moment, **straight(1.0))
    np.testing.assert_allclose(found, exact, atol=1e-11)


@pytest.mark.exhaustive
def test_the_princeton_beam():
    """Bent both ways and twisted by 13.345 N at 30 degrees from its stiff direction."""
    stiff = np.diag([2.84191e6, 6.40131e5, 9.03881e5, 3.10338, 2.42873, 36.2794])
    force = 13.345 * np.array([0, np.cos(np.pi / 6), np.sin(np.pi / 6)])
    found, *root, status = held(0.508 * POINTS[:, None] * ALONG, stiff, force, np.zeros(3))
    assert status == 0
    exact = integrated(stiffness=stiff, root=root, force=force, **straight(0.508))
    np.testing.assert_allclose(found, exact, atol=1e-12)


@functools.cache
def vibrating():
    """The first mode in flap, the second there and one in plane, of a thick cantilever."""
    mass = np.diag([2.0, 2.0, 2.0, 0.028, 0.01, 0.018])

    @jax.jit
    def find(stiff):
        blade = Blade([0, 1], jnp.stack([stiff] * 2), [mass] * 2, 1.0)
        which = jb.labels(flap=2, in_plane=1, torsion=1)
        return jb.modes(SpatialRod(12), jb.Rotor(blade), 0.0, which, throw=False).frequency

    return find


def of_timoshenko(bending, shear, mass, rotary, near):
    """A frequency of a cantilever, from the exponential of its equations in multiple precision."""
    with mpmath.workdps(30):

        def missing(w):
            by = mpmath.matrix(4, 4)  # of displacement, rotation, moment, shear force
            by[0, 1], by[0, 3], by[1, 2] = 1, 1 / mpmath.mpf(shear), 1 / mpmath.mpf(bending)
            by[2, 1], by[2, 3], by[3, 0] = -rotary * w**2, -1, -mass * w**2
            end = mpmath.expm(by)
            return end[2, 2] * end[3, 3] - end[2, 3] * end[3, 2]

        return float(mpmath.findroot(missing, mpmath.mpf(float(near))))


@pytest.mark.exhaustive
@pytest.mark.parametrize("shear", [3e4, 3e8])
def test_beams_of_timoshenko_and_of_rayleigh(shear):
    """With rotary inertia, and with shear or none to speak of; torsion is that of a shaft."""
    stiff = np.diag([2e6, shear, 1.3 * shear, 3e3, 5e3, 9e3])
    found = np.asarray(vibrating()(stiff))
    flap = [of_timoshenko(5e3, 1.3 * shear, 2.0, 0.01, near) for near in found[:2]]
    plane = of_timoshenko(9e3, shear, 2.0, 0.018, found[2])
    np.testing.assert_allclose(found[:3], [*flap, plane], rtol=1e-8)
    np.testing.assert_allclose(found[3], np.pi / 2 * np.sqrt(3e3 / 0.028), rtol=1e-8)


@pytest.mark.slow
def test_lateral_buckling_of_thin_strips():
    """Across at the tip a strip of no thickness gives way at J_-1/4(P L^2 / (2 sqrt(EI GJ))) = 0,
    4.0126; one that bends a thousand times less the other way 1e-3 later, as integrated."""
    model, weak, torsion = SpatialRod(10), 3.0, 2.0

    @jax.jit
    def factor(stiff, axial):
        beam = jb.Beam(
            2.0, 1.0, axial, stiff, weak, torsional_stiffness=torsion, polar_inertia=1e-8
        )
        across = jb.Loads(tip_force=[0, np.sqrt(weak * torsion) / 4, 0])
        return jb.critical_load(model, jb.Rotor(beam), across).factor

    thin = 2 * brentq(lambda x: jv(-0.25, x), 1.5, 2.5, xtol=1e-14)
    # What bends ten million times less the other way gives way 1e-7 later, and rounding of numbers
    # so far apart is of that size.
    assert abs(factor(1e7 * weak, 1e10) / thin - 1) < 1e-6
    for ratio, tolerance in ((1e3, 4e-7), (1e4, 4e-7)):
        exact = lateral_buckling(ratio, torsion / weak) / np.sqrt(torsion / weak)
        assert abs(factor(ratio * weak, 1e7) / exact - 1) < tolerance


def offset_sections():
    """Stiffness and inertia at root and tip: full, with centres of mass off the axis."""
    rng, size = np.random.default_rng(3), np.sqrt([1e6, 2e5, 2e5, 3e2, 4e2, 6e2])
    stiffness, masses = [], []
    for _ in range(2):
        drawn = rng.normal(size=(6, 6))
        stiffness.append(size[:, None] * (drawn @ drawn.T / 6 + 2 * np.eye(6)) * size)
        mass, arm = 1 + rng.random(), np.cross([0.0, *(0.05 * rng.normal(size=2))], np.eye(3)).T
        about = np.diag([0.02, 0.008, 0.012]) - mass * arm @ arm
        masses.append(np.block([[mass * np.eye(3), -mass * arm], [mass * arm, about]]))
    return np.stack(stiffness), np.stack(masses)


@pytest.mark.slow
def test_a_turning_blade_with_offsets_as_by_intrinsic_equations():
    """Six frequencies of a tapered blade of full sections, twisted, swept and bent: equations of
    velocities and forces alone agree to 1e-11, and so do these at another number of points."""
    stiffness, masses = offset_sections()
    points = np.array([[0, 0, 0], [1, 0.02, 0], [2, 0.1, 0.05], [3, 0.3, 0.1]])
    twist, radius, speed = np.array([0.3, 0.2, 0.1, 0.05]), 1.0, 8.0
    axis = np.polyfit(np.linspace(0, 1, 4), points, 3)  # the one cubic through four points
    angle = np.polyfit(np.linspace(0, 1, 4), twist, 3)

    def slope(x):
        return np.array([3 * x**2, 2 * x, 1]) @ axis[:3]

    def along(tables):
        def at(x):
            tangent = slope(x) / np.linalg.norm(slope(x))
            third = np.cross(tangent, [0, 1, 0])
            third = third / np.linalg.norm(third)
            second, turn = np.cross(third, tangent), np.polyval(angle, x)
            cos, sin = np.cos(turn), np.sin(turn)
            across = cos * second + sin * third, cos * third - sin * second
            frame = np.kron(np.eye(2), np.stack([tangent, *across], 1))
            return frame @ ((1 - x) * tables[0] + x * tables[1]) @ frame.T

        return at

    def place(x):
        return x ** np.array([3, 2, 1, 0]) @ axis + radius * ALONG

    rod = intrinsic.Rod(place, slope, along(stiffness), along(masses))
    exact, fewer = (intrinsic.frequencies(rod, speed, 6, count) for count in (24, 18))
    np.testing.assert_allclose(fewer, exact, rtol=1e-11)
    assert np.abs(exact.real).max() < 1e-11 * exact.imag[0]
    rotor = jb.Rotor(Blade([0, 1], stiffness, masses, points, twist), radius)
    found = jb.modes(SpatialRod(14), rotor, speed, 6).frequency
    np.testing.assert_allclose(found, exact.imag, rtol=1e-10)
