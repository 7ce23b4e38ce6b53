"""How ends of a rod are held: beams between supports, hinges about any axis, buckling, against
transfer matrices, rigid bodies and printed numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam._models.contract.supports import unsupported
from jaxbeam._models.space.rod_state import Around, balance
from jaxbeam._rotor.loads import TipLoad
from jaxbeam.blades import Blade
from tests.tiers import slow

Support = jb.blades.Support
BALL = {"about_1": 0.0, "about_2": 0.0, "about_3": 0.0}
FREE = Support(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def uniform(stiffness, rotary, length=1.0):
    """A blade of diagonal sections, of mass one per length."""
    mass = np.diag([1, 1, 1, 2 * rotary, rotary, rotary])
    return Blade([0, 1], [np.diag(stiffness)] * 2, [mass] * 2, length)


def coupled():
    """A blade of full sections, turned, about a curved axis."""
    rng = np.random.default_rng(3)
    a, size = rng.normal(size=(6, 6)), np.sqrt([1e6, 2e5, 2e5, 3e2, 4e2, 6e2])
    stiffness = size[:, None] * (a @ a.T / 6 + 2 * np.eye(6)) * size
    mass = np.diag([1.2, 1.2, 1.2, 0.02, 0.008, 0.012])
    axis = [[0, 0, 0], [1, 0.02, 0], [2, 0.1, 0.05], [3, 0.3, 0.1]]
    return Blade([0, 1], [stiffness] * 2, [mass] * 2, axis, twist=[0.3, 0.2, 0.1, 0])


SHEAR, BENDING, ROTARY = 200.0, 1.0, 0.004
STOUT = uniform([4e3, SHEAR, SHEAR, 3.0, 7.0, BENDING], ROTARY)


def misses(omega, root, tip):
    """What is zero at frequencies of a Timoshenko beam between springs (k, K), against shift and
    rotation, infinite where held: w' = psi + Q / GA, psi' = M / EI, and what has inertia."""
    rates = np.array(
        [
            [0, 1, 0, 1 / SHEAR],
            [0, 0, 1 / BENDING, 0],
            [0, -ROTARY * omega**2, 0, -1],
            [-(omega**2), 0, 0, 0],
        ]
    )
    # A spring (c, s) has c w = s Q, and both ends as many conditions.
    (c, s), (d, r) = ((1, 0) if np.isinf(k) else (k, 1) for k in root)
    start = np.array([[s, 0, 0, c], [0, r, d, 0]]).T
    (c, s), (d, r) = ((1, 0) if np.isinf(k) else (k, 1) for k in tip)
    end = np.array([[c, 0, 0, s], [0, d, r, 0]])
    return np.linalg.det(end @ expm(rates) @ start)


HELD = np.inf
BEAMS = {  # supports, springs in plane, and frequencies of slender beams, roots over the length
    "clamped-pinned": (None, Support(0.0, **BALL), (HELD, HELD), (HELD, 0), [3.9266, 7.0686]),
    "simply supported": (
        Support(about_2=0.0, about_3=0.0), Support(0.0, **BALL), (HELD, 0), (HELD, 0),
        [np.pi, 2 * np.pi],
    ),
    "pinned-guided": (
        Support(about_2=0.0, about_3=0.0), Support(0.0, 0.0, 0.0, 0.0), (HELD, 0), (0, HELD),
        [np.pi / 2, 3 * np.pi / 2],
    ),
    "clamped-clamped": (None, Support(), (HELD, HELD), (HELD, HELD), [4.7300, 7.8532]),
    "clamped-guided": (
        None, Support(0.0, 0.0, 0.0, 0.0), (HELD, HELD), (0, HELD), [2.3650, 5.4978],
    ),
    "free-free": (FREE, None, (0, 0), (0, 0), [4.7300, 7.8532]),
    "clamped, tip on a spring": (
        None, Support(0.0, 40.0, 0.0, 0.0, 0.0, 0.0), (HELD, HELD), (40, 0), [3.3, 5.1],
    ),
    "on four springs": (
        Support(None, 50.0, None, None, None, 3.0), Support(0.0, 20.0, 0.0, 0.0, 0.0, 5.0),
        (50, 3), (20, 5), [2.6, 4.2],
    ),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", [slow("clamped-pinned"), *list(BEAMS)[1:]])
def test_beams_between_supports(name):
    """The first two frequencies in plane, with shear and rotary inertia."""
    root, tip, at_root, at_tip, near = BEAMS[name]
    rotor = jb.Rotor(STOUT, root_support=root, tip_support=tip)
    modes = jb.modes(SpatialRod(11), rotor, 0.0, 10)
    found = np.asarray(modes.frequency)[modes.energy_share[:, jb.models.Direction.IN_PLANE] > 0.5]
    still = 3 if name == "free-free" else 0
    if still:  # as a body, in all directions, and exactly
        np.testing.assert_array_equal(modes.frequency[:6], 0.0)
        found = found[found > 0]
    bounds = np.linspace(0.3 * near[0] ** 2, 1.02 * near[1] ** 2, 400)
    values = [misses(omega, at_root, at_tip) for omega in bounds]
    places = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))
    expected = [
        brentq(misses, bounds[k], bounds[k + 1], (at_root, at_tip), xtol=1e-13) for k in places
    ]
    assert len(expected) >= 1
    np.testing.assert_allclose(found[: len(expected)], expected, rtol=1e-8)


SLENDER = uniform([1e6, 1e6, 1e6, 1.0, 1.0, 1.0], 1e-7)
PUSH = {"tip_force": [-1.0, 0, 0]}


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("root", "tip", "loads", "expected", "tolerance"),
    [
        pytest.param(
            Support(about_2=0.0, about_3=0.0), Support(0.0, **BALL), PUSH, np.pi**2, 1e-7,
            id="Euler, both ends pinned",
        ),
        pytest.param(
            None, Support(0.0, **BALL), PUSH, 4.493409457909064**2, 3e-5, id="clamped and pinned"
        ),
        pytest.param(
            None, Support(0.0, 0.0, 0.0, 0.0), PUSH, np.pi**2, 1e-7, id="clamped and guided"
        ),
        pytest.param(None, Support(0.0), PUSH, 4 * np.pi**2, 2e-5, id="both ends clamped"),
        pytest.param(
            None, Support(0.0, about_1=0.0), {"tip_moment": [1.0, 0, 0]}, 2 * 4.493409457909064,
            3e-5, id="hockling: Greenhill, both ends clamped and twisted",
        ),
        pytest.param(
            Support(along_2=0.0, about_2=0.0, attitude=(0.7, 0.0, 0.0)), Support(0.0, **BALL),
            {"tip_moment": [1.0, 0, 0]}, np.pi, 3e-8,
            id="Greenhill's shaft between hinges, 2 pi: half of it, from its middle",
        ),
        pytest.param(
            None, None, {"gravity": [-1.0, 0, 0]}, 7.837347439, 3e-8, id="Greenhill's column",
        ),
    ],
)  # fmt: skip
def test_buckling_between_supports(root, tip, loads, expected, tolerance):
    """Loads over EI / L^2, and a moment over EI / L, of an axis that does not shorten."""
    rotor = jb.Rotor(SLENDER, root_support=root, tip_support=tip)
    found = jb.critical_load(SpatialRod(8), rotor, jb.Loads(**loads))
    assert abs(found.factor / expected - 1) < tolerance


def plate():
    """Half of the hinged right-angle frame of J. H. Argyris and others, 1979: its leg, from the
    apex, where what moves is symmetric about the plane that bisects it, to its hinge."""
    modulus, depth, thickness = 71240.0, 30.0, 0.6
    shear = modulus / (2 * 1.31)
    area, torsion = depth * thickness, depth * thickness**3 / 3
    bending = depth * thickness**3 / 12, thickness * depth**3 / 12
    stiffness = [modulus * area, *[shear * area] * 2, shear * torsion]
    return uniform([*stiffness, *(modulus * second for second in bending)], 1.0, 240.0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("way", [1, -1])
def test_a_hinged_frame(way):
    """Moments at its hinges, about these, buckle it out of its plane at 622.2 N mm, either way (J.
    C. Simo and L. Vu-Quoc, Computer Methods in Applied Mechanics and Engineering 58, 1986)."""
    across = (0.0, 0.0, np.pi / 4)  # from the leg to the line between the hinges
    apex = Support(None, 0.0, 0.0, 0.0, attitude=across)
    hinge = Support(0.0, about_3=0.0, attitude=across)
    rotor = jb.Rotor(plate(), root_support=apex, tip_support=hinge)
    loads = jb.Loads(tip_moment=[0, 0, 100.0 * way])
    found = jb.critical_load(SpatialRod(6), rotor, loads)
    assert abs(100 * found.factor / 622.2 - 1) < 1e-3


RIGID = uniform([1e7] * 3 + [1e7] * 3, 1e-3)
# int r r^T dm of it from the root, and int r dm
SECOND, FIRST = np.diag([1 / 3, 1e-3, 1e-3]), np.array([0.5, 0, 0])


def crossed(a):
    return np.cross(np.eye(3), a).T * -1


@pytest.mark.slow
def test_a_rigid_blade_on_a_hinge_about_any_axis():
    """Frequency at speed, damping by a damper and stiffening, of a hinge for flap, one of which
    flap goes with pitch (delta-3), and one about any axis: I theta'' + d theta' + (k + Omega^2 c)
    theta = 0, with c from the second order of places by rotations about the axis."""
    radius, speed, spring, damper = 0.3, 5.0, 7.0, 0.2
    attitudes = np.array([[0, 0, 0.0], [0, 0, 0.4], [0.3, 0.2, -0.5]])

    def of_hinge(attitude):
        support = Support(about_2=spring, attitude=attitude)
        rotor, model = jb.Rotor(RIGID, radius, root_support=support), SpatialRod(2)
        still = jb.modes(model, rotor, speed, 1)
        damping = jb.Damping(root_dampers=[0, 0, 0, 0, damper, 0])
        damped = jb.modes(model, rotor, speed, 1, damping=damping)
        # It flaps, however much its hinge pitches it: nothing is twisted.
        rise = jb.southwell(model, rotor, speed, jb.labels(flap=1))
        return still.frequency[0], damped.eigenvalue[0], rise.coefficient[0]

    found = jax.jit(jax.vmap(of_hinge))(attitudes)
    for attitude, frequency, damped, rise in zip(attitudes, *found, strict=True):
        axis = Rotation.from_rotvec(attitude).as_matrix()[:, 1]
        n, flat = crossed(axis), np.diag([1.0, 1.0, 0.0])
        inertia = np.trace(SECOND) - axis @ SECOND @ axis
        ahead = radius * np.eye(3)[0]
        c = np.trace(n.T @ flat @ n @ SECOND) + np.trace(flat @ n @ n @ SECOND)
        c = -(c + ahead @ flat @ n @ n @ FIRST)
        square = (spring + speed**2 * c) / inertia
        np.testing.assert_allclose(frequency**2, square, rtol=1e-4)
        rate = damper / (2 * inertia)
        np.testing.assert_allclose(damped, -rate + 1j * np.sqrt(square - rate**2), rtol=1e-4)
        np.testing.assert_allclose(rise, c / inertia, rtol=1e-4)


@pytest.mark.exhaustive
def test_a_large_rotation_about_an_inclined_hinge():
    """Where the moments of a force, of rotation and of the spring about the axis are in balance;
    and what the hub bears beside."""
    attitude, radius, speed, spring = np.array([0.3, 0.2, -0.5]), 0.3, 2.0, 3.0
    force, support = np.array([0.3, -1.0, 4.0]), Support(about_2=spring, attitude=attitude)
    rotor = jb.Rotor(RIGID, radius, root_support=support)
    state = jb.steady(SpatialRod(2), rotor, speed, loads=jb.Loads(tip_force=force))
    axis = Rotation.from_rotvec(attitude).as_matrix()[:, 1]
    flat, ahead = np.diag([1.0, 1.0, 0.0]), radius * np.eye(3)[0]

    def moment(angle):
        turn = Rotation.from_rotvec(angle * axis).as_matrix()
        arms = speed**2 * flat @ (turn @ SECOND @ turn.T + np.outer(ahead, turn @ FIRST))
        inertial = np.array([arms[2, 1] - arms[1, 2], arms[0, 2] - arms[2, 0], 0])
        inertial[2] = arms[1, 0] - arms[0, 1]
        return axis @ (np.cross(turn[:, 0], force) + inertial) - spring * angle

    angle = brentq(moment, -2, 2)
    assert abs(angle) > 0.5
    turn = Rotation.from_rotvec(angle * axis).as_matrix()
    np.testing.assert_allclose(state.tip, turn[:, 0] - np.eye(3)[0], atol=1e-5)
    inertial = speed**2 * flat @ (ahead + turn @ FIRST)
    np.testing.assert_allclose(state.hub_force, -force - inertial, atol=1e-4)


@pytest.mark.exhaustive
def test_reactions_of_two_ends():
    """A uniform load on a beam that is clamped and propped, and on one that is clamped at both
    ends: q L^2 / 8 and / 12 at the root, and the hub bears all of the load."""
    load, model = jb.Loads(force_per_length=(0, 0, 1e-3)), SpatialRod(6)
    for tip, share in ((Support(0.0, **BALL), 8), (Support(), 12)):
        state = jb.steady(model, jb.Rotor(SLENDER, 0.5, tip_support=tip), 0.0, loads=load)
        np.testing.assert_allclose(state.section_moment(0.0)[0, 2], 1e-3 / share, rtol=1e-4)
        np.testing.assert_allclose(state.hub_force, [0, 0, -1e-3], atol=1e-9)
        np.testing.assert_allclose(state.hub_torque, [0, 1e-3, 0], atol=1e-8)


HELD_BOTH = {
    "inclined hinges": (
        Support(about_3=50.0, attitude=(0.3, -0.2, 0.5)),
        Support(100.0, None, 0.0, 50.0, None, 0.0, attitude=(0.1, 0.7, 0.2)),
    ),
    "two turns, two shifts": (
        Support(300.0, None, 0.0, 50.0, None, 20.0), Support(0.0, 200.0, 0.0, 10.0, 20.0, 30.0),
    ),
    "three turns": (
        Support(None, 100.0, 200.0, 50.0, 30.0, 20.0, (0.4, 0.2, -0.3)), Support(**BALL),
    ),
    "all": (Support(10.0, 100.0, 200.0, 50.0, 30.0, 20.0, (0.4, 0.2, -0.3)), Support()),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", HELD_BOTH)
def test_forces_and_tangents_of_supports(name):
    """About any state: tangents are derivatives of forces, and these of the energy."""
    root, tip = HELD_BOTH[name]
    rotor = jb.Rotor(coupled(), 1.0, root_support=root, tip_support=tip)
    equations = SpatialRod(2).suited(rotor).equations(rotor)
    rod, rng = equations.rod, np.random.default_rng(0)
    three = [jnp.asarray(rng.normal(size=3)) for _ in range(5)]
    zero = jnp.zeros(rod.free.size)

    @jax.jit
    def both(change):
        q = rod.changed(equations.rest, change)
        still = Around(*(0 * part for part in three[:3]), None, None)
        around = Around(*three[:3], TipLoad(three[3], three[4], True), None)

        def force(change, around=around):
            return balance(rod, rod.changed(q, change), around).residual.reshape(-1)[rod.free]

        tangent = balance(rod, q, around).stiffness[np.ix_(rod.free, rod.free)]
        energy = jax.grad(lambda change: equations.strain_energy(rod.changed(q, change)))
        return jax.jacfwd(force)(zero), tangent, energy(zero), force(zero, still)

    by_force, tangent, by_energy, elastic = both(jnp.asarray(0.3 * rng.normal(size=zero.size)))
    np.testing.assert_allclose(tangent, by_force, atol=1e-13 * np.abs(by_force).max())
    np.testing.assert_allclose(elastic, by_energy, atol=1e-13 * np.abs(elastic).max())


@pytest.mark.exhaustive
def test_gradients_by_supports():
    """Tips and frequencies about bent states, by springs and the axes of both ends, against
    differences, in both modes."""
    springs = jnp.array([300.0, 50.0, 20.0, 80.0, 30.0])
    start = jnp.concatenate([springs, jnp.array([0.3, -0.2, 0.5, 0.1, 0.4, 0.2])])
    loads = jb.Loads(tip_force=[3.0, -20.0, 30.0])

    @jax.jit
    def found(x):
        root = Support(along_3=x[0], about_2=x[1], about_3=x[2], attitude=x[5:8])
        tip = Support(0.0, x[3], None, 0.0, 0.0, x[4], attitude=x[8:])
        rotor = jb.Rotor(coupled(), 1.0, root_support=root, tip_support=tip)
        model = SpatialRod(2)
        modes = jb.modes(model, rotor, 3.0, 2, loads=loads)
        return jnp.concatenate([jb.steady(model, rotor, 3.0, loads=loads).tip, modes.frequency])

    slope, back = jax.jit(jax.jacfwd(found))(start), jax.jit(jax.jacrev(found))(start)
    np.testing.assert_allclose(back, slope, rtol=1e-9, atol=1e-12 * np.abs(slope).max())
    step = 1e-5 * np.maximum(np.abs(start), 1.0)
    each = [(found(start + h) - found(start - h)) / (2 * h.max()) for h in np.diag(step)]
    np.testing.assert_allclose(slope, np.stack(each, 1), rtol=1e-5, atol=1e-7)


@pytest.mark.exhaustive
def test_gradients_of_a_growing_mode():
    """A column between pins, under more than Euler's load P: its growth is pi^2 / L^2 times the
    root of (P - pi^2 EI / L^2) L^2 / (pi^2 m), and other modes have no part in its derivatives."""
    ends = {"root_support": Support(about_2=0.0, about_3=0.0), "tip_support": Support(0.0, **BALL)}

    @jax.jit
    def growth(x):
        beam = jb.Beam(1.0, 1.0, 1e8, x[0], 4.0, torsional_stiffness=1.0, polar_inertia=1e-9)
        loads = jb.Loads(tip_force=jnp.stack([-x[1], 0 * x[1], 0 * x[1]]))
        return jb.modes(SpatialRod(8), jb.Rotor(beam, **ends), 0.0, 2, loads=loads).growth_rate[0]

    at = jnp.array([1.0, 1.5 * np.pi**2])
    size = np.pi**2 * np.sqrt(0.5)
    assert abs(growth(at) / size - 1) < 1e-6
    expected = np.array([-(np.pi**4), np.pi**2]) / (2 * size)
    np.testing.assert_allclose(jax.jit(jax.jacrev(growth))(at), expected, rtol=2e-6)


@pytest.mark.exhaustive
def test_what_nothing_holds():
    """A steady state that nothing holds says so, and one that rotation holds is found."""
    rotor = jb.Rotor(SLENDER, 0.2, root_support=Support(about_2=0.0))
    find = jax.jit(lambda speed: jb.steady(SpatialRod(3), rotor, speed, throw=False).status)
    assert find(0.0) == jb.Status.NOT_HELD
    assert find(3.0) == jb.Status.OK


def test_what_supports_may_be():
    """Values, places and dampers, and what other models say of it."""
    beam = jb.Beam(1.0, 1.0, 1e4, 16.0, 1.0, torsional_stiffness=3.0)
    hinge = Support(about_2=0.0, attitude=(0, 0, 0.1))
    for wrong in ({"about_2": -1.0}, {"along_1": np.inf}, {"attitude": [0, 0, 7.0]}):
        with pytest.raises(ValueError, match="springs of a support must be >= 0"):
            Support(**wrong)
    with pytest.raises(ValueError, match=r"attitude must have shape \(3,\), a rotation vector"):
        Support(attitude=np.eye(3))
    with pytest.raises(ValueError, match="there are root_springs as well"):
        jb.Rotor(beam, root_springs=jb.RootSprings(), root_support=hinge)
    rotor = jb.Rotor(beam, root_support=hinge, tip_support=Support())
    for model in (jb.Hybrid, jb.PlanarRod, jb.Classical, jb.papers.DiscreteNP):
        why = unsupported(model, rotor)
        assert why.startswith(f"root_support: {model.__name__} has no support"), why
    assert unsupported(SpatialRod, rotor) == ""
    for damping, complaint in (
        ({"root_dampers": [1.0, 0, 0, 0, 0, 0]}, "the support holds rigidly what is along_1"),
        ({"flap_damper": 1.0}, "dampers of a root_support are root_dampers"),
        ({"root_dampers": [1.0]}, r"must have shape \(6,\), along three axes"),
        ({"tip_dampers": [-1.0] * 6}, "finite and >= 0"),
    ):
        with pytest.raises(ValueError, match=complaint):
            jb.modes(SpatialRod(), rotor, 1.0, damping=jb.Damping(**damping))
    clamped = jb.Rotor(beam)
    with pytest.raises(ValueError, match="give the Rotor tip_support"):
        jb.modes(SpatialRod(), clamped, 1.0, damping=jb.Damping(tip_dampers=[0.0] * 6))
