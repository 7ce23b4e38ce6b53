"""The rod of full sections, against integration of its equilibrium, closed forms and numbers of
other programs."""

import functools
import json
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam._models.space.rod_state import Around, balance
from jaxbeam._rotor.loads import TipLoad
from jaxbeam.blades import Blade, read_blade
from tests.beams import soft_tipped
from tests.files.made_up import FOLDER
from tests.references import full_rod
from tests.tiers import slow

# Wang, Yu, Sprague, Jonkman, AIAA 2013: a composite box beam of 10 m, SI.
BOX = np.zeros((6, 6))
BOX[:3, :3] = np.diag([1368.17e3, 88.56e3, 38.78e3])
BOX[3:, 3:] = [[16960, 17610, -351], [17610, 59120, -370], [-351, -370, 141470]]


def inertia(mass, centre, about):
    """Inertia about the reference point, of a mass at a centre with moments about that."""
    c = np.array(
        [[0, -centre[2], centre[1]], [centre[2], 0, -centre[0]], [-centre[1], centre[0], 0]]
    )
    return np.block([[mass * np.eye(3), -mass * c], [mass * c, np.diag(about) - mass * c @ c]])


DEFAULT = SpatialRod()
UNIT = inertia(1.0, (0.0, 0.0, 0.0), (2e-3, 1e-3, 1e-3))


def steady(blade, speed=0.0, model=DEFAULT, rotor=None, **loads):
    rotor = jb.Rotor(blade) if rotor is None else rotor
    return jb.steady(model, rotor, speed, loads=jb.Loads(**loads))


@functools.cache
def coupled():
    """A blade whose sections are full and turned, about a curved axis, on a hub."""
    rng = np.random.default_rng(3)
    stiffness, masses = [], []
    for _ in range(3):
        a = rng.normal(size=(6, 6))
        size = np.sqrt([1e6, 2e5, 2e5, 3e2, 4e2, 6e2])
        stiffness.append(size[:, None] * (a @ a.T / 6 + 2 * np.eye(6)) * size)
        centre = (0.0, *(0.05 * rng.normal(size=2)))
        masses.append(inertia(1 + rng.random(), centre, (0.02, 0.008, 0.012)))
    axis = [[0, 0, 0], [1, 0.02, 0], [2, 0.1, 0.05], [3, 0.3, 0.1]]
    return Blade([0, 0.4, 1], stiffness, masses, axis, twist=[0.3, 0.2, 0.1, 0])


@pytest.mark.exhaustive
def test_tangents_are_derivatives_of_forces():
    """About any state, with all loads, of a root that yields."""
    body = jb.TipBody(0.5, 0.1, 0.02, 0.01, 0.03)
    rotor = jb.Rotor(coupled(), 1.0, tip_body=body, root_springs=jb.RootSprings(200.0, 300.0))
    equations = SpatialRod(3, 2).suited(rotor).equations(rotor)
    rod, rng = equations.rod, np.random.default_rng(0)
    change = jnp.asarray(0.2 * rng.normal(size=rod.free.size))
    q = rod.changed(equations.rest, change)
    three = [jnp.asarray(rng.normal(size=3)) for _ in range(5)]

    @jax.jit
    def both(q, follows):
        for_tip = [TipLoad(three[3], three[4], True), TipLoad(three[3], three[4], False)]
        out = []
        for load in for_tip:
            integral = equations.span_integral((), load.follows)
            xi, _ = integral.points
            span = integral.generalised_force(jnp.stack([1 + xi, 2 - xi, xi**2], 1))
            around = Around(three[0], three[1], three[2], load, span)

            def force(change, around=around):
                return balance(rod, rod.changed(q, change), around).residual.reshape(-1)[rod.free]

            tangent = jax.jacfwd(force)(jnp.zeros(rod.free.size))
            own = balance(rod, q, around).stiffness[np.ix_(rod.free, rod.free)]
            out.append((tangent, own))
        return out

    for tangent, own in both(q, True):
        np.testing.assert_allclose(own, tangent, atol=1e-9 * np.abs(tangent).max())


@pytest.mark.exhaustive
@pytest.mark.parametrize(("degree", "elements", "tolerance"), [(8, 1, 1e-10), (5, 2, 1e-8)])
def test_a_composite_beam(degree, elements, tolerance):
    """The tip under 150 N as that of Wang and others, who state it so."""
    blade = Blade([0, 1], [BOX] * 2, [UNIT] * 2, 10.0)
    tip = steady(blade, model=SpatialRod(degree, elements), tip_force=[0, 0, 150.0]).tip
    expected = [-9.02726627566299e-2, -6.47488486259037e-2, 1.22973648292371]
    np.testing.assert_allclose(tip, expected, atol=1.3 * tolerance)


@pytest.mark.exhaustive
def test_a_twisted_beam():
    """Half a turn over 10 m under 4 MN, as of Wang and others."""
    stiff = np.diag([2.5e10, 8.2604167e9, 8.2604167e9, 1.41872656e8, 5.20833e8, 1.30208333e8])
    blade = Blade([0, 1], [stiff] * 2, [UNIT] * 2, 10.0, twist=[0, np.pi / 2])
    tip = steady(blade, model=SpatialRod(10, 2), tip_force=[0, 0, -4e6]).tip
    np.testing.assert_allclose(
        tip, [-1.14152599953942, -1.71805334646388, -3.59321324026952], atol=4e-10
    )


def _vector(moment):
    """A moment along axes 1, 2, 3, from one of torsion, in plane and in flap."""
    return np.array([moment[0], -moment[2], moment[1]])


@pytest.mark.slow
def test_a_turning_blade_of_full_sections():
    """Displacement and section forces, under gravity's like and a load at the tip, against
    integration of equilibrium along the axis."""
    stiff, mass = np.asarray(coupled().stiffness_at(np.zeros(1))[0]), inertia(
        1.2, (0, 0.03, -0.02), (0.02, 0.008, 0.012)
    )  # fmt: skip
    blade = Blade([0, 1], [stiff] * 2, [mass] * 2, 3.0)
    rotor, force = jb.Rotor(blade, 1.0), np.array([5.0, 3.0, -8.0])
    loads = {"tip_force": force, "force_per_length": (0.5, -1.0, 2.0)}
    at = np.array([0.0, 0.37, 1.0])
    state = steady(blade, 6.0, SpatialRod(10), rotor, **loads)
    case = full_rod.Case(
        place=lambda s: np.array([1.0 + s, 0, 0]), tangent=lambda s: np.eye(3)[0],
        stiffness=lambda s: stiff, inertia=lambda s: mass, length=3.0,
        omega=np.array([0, 0, 6.0]), force=force, line=np.array([0.5, -1.0, 2.0]),
    )  # fmt: skip
    forces, moments = state.section_force(at), state.section_moment(at)
    guess = np.concatenate([forces[0], _vector(moments[0])])
    found = full_rod.steady(case, guess, at * 3.0)
    straight = np.stack([1 + 3 * at, 0 * at, 0 * at], 1)
    np.testing.assert_allclose(state.displacement(at), found[:, :3] - straight, atol=1e-8)
    scale = np.abs(found[:, 7:]).max()
    np.testing.assert_allclose(forces, found[:, 7:10], atol=1e-6 * scale)
    own = np.stack([_vector(moment) for moment in np.asarray(moments)])
    np.testing.assert_allclose(own, found[:, 10:], atol=1e-6 * scale)
    turn = full_rod.matrix(found[0, 3:7])
    np.testing.assert_allclose(state.hub_force, -turn @ found[0, 7:10], rtol=1e-8, atol=1e-6)


@pytest.mark.slow
def test_a_straight_beam_is_that_of_hybrid():
    """Frequencies in the limit of slender sections, where rotary inertia is nothing; of torsion by
    its closed form, with what the sections' inertia does in a turning hub."""
    beam = jb.Beam(8.0, 0.2, 5e9, 566.0, 400.0, torsional_stiffness=200.0, polar_inertia=1e-6)
    rotor = jb.Rotor(beam, 0.5, 0.1)
    which = jb.labels(in_plane=2, flap=3)

    @jax.jit
    def frequencies(speed):
        rod = jb.modes(SpatialRod(12), rotor, speed, (*which, *jb.labels(torsion=1)))
        return rod.frequency, jb.modes(jb.Hybrid(6, 14, 14), rotor, speed, which).frequency

    (*rod, torsion), hybrid = frequencies(7.0)
    np.testing.assert_allclose(rod, hybrid, rtol=2e-5)
    wave = np.pi / 2 / 8 * np.sqrt(200.0 / 1e-6)
    # Moments of inertia (J2, J3) share J as 400 to 566, and turning adds W^2 (J3 - J2) / J.
    propeller = 49.0 * (566.0 - 400.0) / 966.0
    np.testing.assert_allclose(torsion**2, wave**2 + propeller, rtol=1e-7)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("name", "tolerance"),
    [
        slow("primary_beamdyn.inp", 1e-6),
        ("blade_windio.yaml", 1e-6),
        # What is between its stations is linear in other quantities.
        ("blade_hawc2.htc", 2e-4),
    ],
)
def test_one_blade_in_three_formats(name, tolerance):
    """Six frequencies at rest and at speed, of a program of another hand: see `made_up.py`."""
    expected = json.loads((FOLDER / "expected.json").read_text())
    with warnings.catch_warnings():  # of radii of gyration, which are what HAWC2 takes them for
        warnings.simplefilter("ignore")
        blade = read_blade(FOLDER / name).beam
    find = jax.jit(
        lambda radius, speed: (
            jb.modes(SpatialRod(8, 3), jb.Rotor(blade, radius), speed, 6).frequency_hz
        )
    )
    np.testing.assert_allclose(find(0.0, 0.0), expected["at_rest_Hz"], rtol=tolerance)
    np.testing.assert_allclose(find(1.0, 5.0), expected["frequencies_Hz"], rtol=tolerance)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("degree", "tolerance"), [(8, 1e-5), (10, 2e-7)])
def test_six_frequencies_of_a_coupled_blade(degree, tolerance):
    """At 60 rad/s, of full stiffness and a mass off the axis, by 48 and 60 coordinates. Programs of
    other hands, one of rods and one of the intrinsic equations, agree on them to 4e-13."""
    drawn = 0.05 * np.random.default_rng(3).normal(size=(6, 6))
    own = np.sqrt(np.diag(BOX))
    stiffness = BOX + own[:, None] * (drawn + drawn.T) / 2 * own
    mass = inertia(8.538e-2, (0.0, 0.03, -0.02), (1.4433e-2, 4.097e-3, 1.0336e-2))
    rotor = jb.Rotor(Blade([0, 1], [stiffness] * 2, [mass] * 2, 10.0), 1.0)
    found = jb.modes(SpatialRod(degree), rotor, 60.0, 6).frequency
    expected = [51.88327419, 69.11968344, 175.50090638, 200.20279406, 262.65129505, 370.73567622]
    np.testing.assert_allclose(found, expected, rtol=tolerance)


@pytest.mark.exhaustive
def test_roll_up_in_one_step():
    """A moment 2 pi EI / L at the tip bends a beam to a circle, twice as much to two."""
    beam = jb.Beam(10.0, 1.0, 1e8, 1.0, 1.0, torsional_stiffness=1.0)
    for turns, tolerance in ((1, 1e-6), (2, 1e-6)):
        moment = [0, 0, turns * 2 * np.pi / 10]
        state = steady(beam, model=SpatialRod(10, 2), tip_moment=moment, follows=True)
        np.testing.assert_allclose(state.tip, [-10.0, 0, 0], atol=10 * tolerance)


@pytest.mark.exhaustive
def test_columns_that_follow_and_that_do_not():
    """Euler's, Beck's and Leipholz's loads, over EI / L^2."""
    beam = jb.Beam(2.0, 1.0, 1e7, 3.0, 4.0, torsional_stiffness=1.0, polar_inertia=1e-8)
    rotor, unit, model = jb.Rotor(beam), 3.0 / 4, SpatialRod(10)

    def factor(**loads):
        return jb.critical_load(model, rotor, jb.Loads(**loads)).factor

    assert abs(factor(tip_force=[-unit, 0, 0]) / (np.pi**2 / 4) - 1) < 1e-5
    assert abs(factor(tip_force=[-unit, 0, 0], follows=True) / 20.0509532 - 1) < 1e-5
    line = (-unit / 2, 0.0, 0.0)
    assert abs(factor(force_per_length=line, follows=True) / 40.0537 - 1) < 1e-5


@pytest.mark.exhaustive
def test_gradients_by_all_numbers_of_sections():
    """Frequencies about steady rotation, by stiffness, inertia, axis and twist, against
    differences."""
    blade, rng = coupled(), np.random.default_rng(1)
    names = ("stiffness", "inertia", "axis", "twist")
    ways = {
        name: jnp.asarray(rng.normal(size=getattr(blade, name).shape)) * size
        for name, size in zip(names, (1.0, 1e-3, 1e-2, 1e-2), strict=True)
    }

    @jax.jit
    def frequencies(h):
        parts = [getattr(blade, name) + h * ways[name] for name in names]
        stiffness, masses, axis, twist = parts
        rotor = jb.Rotor(Blade(blade.stations, stiffness, masses, axis, twist), 1.0)
        return jb.modes(SpatialRod(5), rotor, 8.0, 4).frequency

    slope = jax.jit(jax.jacfwd(frequencies))(0.0)
    back = jax.jit(jax.jacrev(frequencies))(0.0)
    step = 1e-2
    apart = [frequencies(k * step) - frequencies(-k * step) for k in (1, 2, 3)]
    found = np.array([45, -9, 1]) @ np.stack(apart) / (60 * step)
    np.testing.assert_allclose(slope, found, rtol=0, atol=1e-7 * np.abs(found).max())
    np.testing.assert_allclose(back, slope, rtol=1e-8, atol=1e-10 * np.abs(found).max())


@pytest.mark.exhaustive
def test_modes_of_a_blade():
    """With themselves, and as shapes for other programs; and what stability asks of a rotor."""
    rotor = jb.Rotor(coupled(), 1.0)
    model = SpatialRod(4).suited(rotor)
    # Those of the straight beam that is left of the blade, which is some per mille lighter.
    own = model.equations(rotor).rigid_moments
    np.testing.assert_allclose(rotor.rigid_moments, own, rtol=0.01)
    modes = jb.modes(model, rotor, 0.0, 3)
    np.testing.assert_allclose(np.diagonal(modes.mac(modes)), 1.0, rtol=1e-12)
    assert np.all(modes.polynomials().misfit[:2] < 0.1)


@pytest.mark.exhaustive
def test_a_root_that_yields_both_ways():
    """The root does not turn about the beam, and forces have a potential: tips by forces are a
    symmetric matrix, which is that of differences."""
    beam = jb.Beam(8.0, 0.2, 5e6, 566.0, 400.0, torsional_stiffness=200.0, polar_inertia=1e-2)
    rotor = jb.Rotor(beam, 0.5, 0.1, root_springs=jb.RootSprings(60.0, 40.0))

    @jax.jit
    def tip(force):
        state = steady(beam, rotor=rotor, model=SpatialRod(6), tip_force=force)
        return state.tip, state.torsion(0.0)[0]

    force, step = jnp.array([0, 10.0, 10.0]), 1e-3
    place, about = tip(force)
    np.testing.assert_allclose(place, [-4.8334545, 4.6360097, 5.6457276], atol=1e-6)  # ANCF(16)
    assert abs(about) < 1e-12
    slopes = jax.jit(jax.jacfwd(lambda force: tip(force)[0]))(force)
    np.testing.assert_allclose(slopes, slopes.T, atol=1e-6)
    each = [(tip(force + step * e)[0] - tip(force - step * e)[0]) / (2 * step) for e in np.eye(3)]
    np.testing.assert_allclose(slopes, np.stack(each, 1), atol=1e-6)


@pytest.mark.exhaustive
def test_a_point_force_on_an_axis_of_uneven_points():
    """The hub bears the force that was given, wherever points of the axis are."""
    stiff = np.diag([1e6, 1e5, 1e5, 3e2, 4e2, 6e2])
    blade = Blade([0, 1], [stiff] * 2, [UNIT] * 2, [[0, 0, 0], [1, 0, 0], [3, 0, 0]])
    points = jb.PointForces([0.2], [[0, 0, 3.0]])
    state = steady(blade, model=SpatialRod(4, 5), point_forces=points)  # it acts at a node
    arm = float(blade.axis_at(np.array([0.2]))[0][0, 0])
    np.testing.assert_allclose(state.hub_force, [0, 0, -3.0], atol=1e-9)
    np.testing.assert_allclose(state.hub_torque, [0, 3 * arm, 0], atol=1e-4)


@pytest.mark.exhaustive
def test_sections_beside_a_point_force():
    """Between the root and a force of 3 N half way the shear is 3 N, and beyond it nothing."""
    beam = jb.Beam(8.0, 0.2, 5e6, 5660.0, 4000.0, torsional_stiffness=2000.0, polar_inertia=0.01)
    line = jb.Spanwise([0, 0.6, 0.6, 1.0], [1.0, 1.0, 0.0, 0.0])
    points = jb.PointForces([0.5], [[0, 0, 3.0]])
    state = steady(beam, point_forces=points, force_per_length=[0, line, 0])
    at = np.array([0.0, 0.2, 0.45, 0.55, 0.7, 1.0])
    force, moment = state.section_force(at), state.section_moment(at)
    shear = np.stack([np.maximum(4.8 - 8 * at, 0), 3.0 * (at < 0.5)], 1)
    np.testing.assert_allclose(force[:, 1:], shear, atol=1e-3)
    bending = np.stack([np.maximum(4.8 - 8 * at, 0) ** 2 / 2, 3 * np.maximum(4 - 8 * at, 0)], 1)
    np.testing.assert_allclose(moment[:, 1:], bending, atol=1e-3)


@pytest.mark.exhaustive
def test_twist_between_sections():
    """A blade keeps the kinks of a beam's twist, and a beam what twist does between sections."""
    uneven = jb.Spanwise([0, 0.2, 0.4, 1], [0.5, 0.1, 0, 0])
    given = 8.0, 0.2, 5e6, 566.0, 400.0
    beam = jb.Beam(*given, twist=uneven, torsional_stiffness=200.0, polar_inertia=0.01)
    blade, xi = Blade.of(beam), np.linspace(0.05, 0.95, 19)
    np.testing.assert_allclose(blade.twist_at(xi), uneven.at(xi), atol=3e-4)
    twist = [0.3, 0.05, 0, 0.1, 0.2, 0]
    axis = 3 * np.linspace(0, 1, 6)[:, None] * np.eye(3)[0]
    blade = Blade([0, 1], [BOX] * 2, [UNIT] * 2, axis, twist)
    plain = Blade([0, 1], [BOX] * 2, [UNIT] * 2, axis)
    turned = blade.beam().twist.at(np.linspace(0, 1, 6)) - plain.beam().twist.at(np.array([0.5]))
    np.testing.assert_allclose(turned, twist, atol=1e-9)
    steps = jb.Spanwise([0, 0.4, 0.4, 1], [0.5, 0.1, 0, 0])
    with pytest.raises(ValueError, match="does not jump"):
        Blade.of(jb.Beam(*given, twist=steps, torsional_stiffness=200.0))


def test_what_it_refuses():
    blade = coupled()
    rotor = jb.Rotor(blade, 1.0)
    with pytest.raises(ValueError, match="blade: Hybrid has no full sections"):
        jb.modes(jb.Hybrid(), rotor, 1.0)
    exponential = jb.solvers.Magnus()
    with pytest.raises(TypeError, match="Magnus needs forces that are linear"):
        jb.simulate(SpatialRod(), rotor, jb.ConstantSpeed(1.0), [0.0, 1.0], solver=exponential)
    half = jb.Rotor(blade, 1.0, root_support=jb.blades.Support(along_1=0.0, about_2=0.0))
    with pytest.raises(ValueError, match="root_support: in motion in time an end that turns"):
        jb.simulate(SpatialRod(), half, jb.ConstantSpeed(1.0), [0.0, 1.0])
    with pytest.raises(ValueError, match="stiffness must be symmetric"):
        Blade([0, 1], [BOX + np.eye(6, k=1) * 1e5] * 2, [UNIT] * 2, 10.0)
    with pytest.raises(ValueError, match="positive definite"):
        Blade([0, 1], [-BOX] * 2, [UNIT] * 2, 10.0)


def test_blades_and_beams():
    """A beam makes a blade, and that the beam again; sections are those of the table."""
    at = [0.0, 0.3, 0.3, 1.0]
    beam = jb.Beam(
        8.0, jb.Spanwise(at, [3.0, 2.0, 1.0, 1.0]), 5e6, 566.0, jb.Spanwise([0, 1], [400.0, 300.0]),
        twist=jb.Spanwise([0, 1], [0.2, 0.0]), torsional_stiffness=200.0, polar_inertia=0.01,
    )  # fmt: skip
    blade = Blade.of(beam)
    again = blade.beam()
    xi = np.array([0.1, 0.29, 0.31, 0.8])
    for name in ("mass_per_length", "flap_bending_stiffness", "twist", "axial_stiffness"):
        own, other = (
            value.at(xi) if isinstance(value, jb.Spanwise) else value
            for value in (getattr(beam, name), getattr(again, name))
        )
        np.testing.assert_allclose(other, own, rtol=1e-9)
    np.testing.assert_allclose([blade.length, blade.mass], [8.0, beam.mass], rtol=1e-12)
    assert blade.breaks == (0.3,)


@pytest.mark.slow
def test_a_soft_tip_is_told_or_has_an_element():
    """One polynomial of the forces has modes that no blade has: where numbers are known such a tip
    is an element, and where they are traced the status tells."""
    rotor = jb.Rotor(soft_tipped(), 1.0)
    suited = SpatialRod().suited(rotor)
    assert len(suited.directions) > 48

    def traced(model):
        return jax.jit(lambda r: jb.modes(model, r, 1.0, 4, throw=False))(rotor)

    found, other = jb.modes(SpatialRod(), rotor, 1.0, 4), traced(SpatialRod(8, 6))
    assert found.model == suited
    assert found.status == other.status == jb.Status.OK
    np.testing.assert_allclose(found.frequency, other.frequency, rtol=2e-4)
    assert traced(SpatialRod()).status == jb.Status.TOO_FEW_FUNCTIONS


@pytest.mark.exhaustive
def test_what_forces_leave_out():
    """Against four elements: an estimate, which is no bound but not far below either."""
    rotor = jb.Rotor(coupled(), 1.0)
    found, exact = (jb.modes(SpatialRod(*size), rotor, 8.0, 6) for size in ((5,), (8, 4)))
    error = np.abs(found.frequency / exact.frequency - 1)
    assert (error <= 3 * np.asarray(found.frequency_error)).all()
    assert np.max(found.frequency_error) < 1e-2
