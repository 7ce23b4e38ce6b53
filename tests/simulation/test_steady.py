"""Steady states, and force and moment in sections of them and of beams in motion."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._models.contract.section_loads import Environment, Moved, section_loads
from jaxbeam._simulation.scene import Scene
from jaxbeam._solvers.system import State
from tests.beams import AS_BUILT, SPRINGS, short
from tests.helpers import finite_difference, name
from tests.references.loaded_rod import Rod, steady
from tests.references.quaternions import rotation
from tests.tiers import exhaustive, slow

ROTOR = jb.Rotor(short(4e6), hub_radius=0.4, tip_mass=0.3)
XI = np.array([0.0, 0.21, 0.5, 0.77, 1.0])


# --- closed forms --------------------------------------------------------------------------------


def test_a_cantilever_at_rest():
    """Shear and moment of forces at the tip and along the span, which have a step, and weight."""
    model, force = jb.Hybrid(0, 1, 1), np.array([0.0, 3.0, -2.0])
    up = jb.Spanwise([0, 0.3, 0.3, 1], [2.0, 2.0, 5.0, 1.5])
    loads = jb.Loads([0.0, 0.0, -9.8], tip_force=force, force_per_length=(0.0, up, 4.0))

    @jax.jit
    def found(q):
        scene = Scene(model, ROTOR, jb.ConstantSpeed(0.0), loads, jb.Damping())
        t, moved = jnp.zeros(()), Moved(q, 0 * q, 0 * q)
        outside = Environment(scene.hub(t), loads, t)
        return section_loads(ROTOR, scene.equations, outside, moved, XI)

    fine = np.linspace(0, 1, 20001)
    x, length = (fine[1:] + fine[:-1]) / 2, 2.0
    beyond = np.where(x[None] > XI[:, None], length / len(x), 0.0)
    each = np.where(x < 0.3, 2.0, 5.0 - 5.0 * (x - 0.3))
    down = 4.0 - 9.8 * 1.3  # ROTOR has 1.3 kg/m and 0.3 kg at its tip
    shear = np.stack([beyond @ each + 3.0, down * length * (1 - XI) - 2.0 - 9.8 * 0.3], 1)
    arm = length * (x[None] - XI[:, None])
    lag = (beyond * arm) @ each + 3.0 * length * (1 - XI)
    flap = down * length**2 * (1 - XI) ** 2 / 2 - (2.0 + 9.8 * 0.3) * length * (1 - XI)
    forces, moments = found(jnp.full(2, 1e-9))
    np.testing.assert_allclose(forces[:, 1:], shear, atol=1e-7, rtol=0)
    np.testing.assert_allclose(moments[:, 1:], np.stack([lag, flap], 1), atol=1e-7, rtol=0)
    assert np.abs(moments[:, 0]).max() < 1e-7


@pytest.mark.slow
def test_a_rotating_beam_bends_by_what_its_sections_bear():
    """Tension is that of rotation, and the moment EI times the curvature: with tension times
    deflection, most of what is there."""
    model, force, speed, x = jb.Hybrid(0, 14, 14), 1e-3, 12.0, np.array([0.0, 0.1, 0.4, 0.9])

    @jax.jit
    def found(force):
        loads = jb.Loads(tip_force=jnp.stack([0 * force, force, -0.7 * force]))
        state = jb.steady(model, ROTOR, speed, loads=loads)
        first = state.section_force(x), state.section_moment(x), state.curvature(x)
        return *first, state.rotation(x), state.displacement(x), state.hub_torque

    forces, moments, curvature, angles, place, torque = found(force)
    c0, c1, c2 = ROTOR.tension(speed)
    np.testing.assert_allclose(forces[:, 0], c0 + c1 * (1 - x) + c2 * (1 - x**2) / 2, rtol=1e-6)
    bends = curvature * np.array([[11.0, 7.0]])
    np.testing.assert_allclose(moments[:, 1:], bends, atol=2e-4 * np.abs(bends).max(), rtol=0)
    assert abs(moments[0, 1] / (2 * force)) < 0.4  # without tension it is the force by its arm
    np.testing.assert_allclose(angles[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(angles[1:, 1], np.gradient(place[:, 1], 2 * x)[1:], rtol=0.5)
    np.testing.assert_allclose(torque[2], -moments[0, 1] - 0.4 * forces[0, 1], rtol=1e-6)
    np.testing.assert_allclose(torque[1], moments[0, 2] + 0.4 * forces[0, 2], rtol=1e-6)


# --- balance -------------------------------------------------------------------------------------


class Tumbling(jb.motions.Motion):
    """A hub that moves in every way at once, or in the plane."""

    parts: jax.Array  # (4, 3)

    def velocities(self, t):
        velocity, spin, velocity_rate, spin_rate = self.parts
        return velocity + t * velocity_rate, spin + t * spin_rate

    def attitude(self, t):
        return jnp.eye(3)


MASS = jb.Spanwise([0, 0.3, 0.3, 1], [1.6, 1.2, 1.0, 0.7])
TORSION = {"torsional_stiffness": 6.0, "polar_inertia": 1e-12}
STEPPED = jb.Rotor(jb.Beam(2.0, MASS, 4e3, 14.0, 8.0, **TORSION), 0.4, 0.3)
BODY = jb.TipBody(0.3, 0.1, 0.02, 0.005)
LINE = (jb.Spanwise([0, 0.4, 0.4, 1], [1.0, -2.0, 0.5, 3.0]), 0.7, -1.1)
PUSH = {"tip_force": [0.4, 0.5, -0.6], "force_per_length": LINE, "gravity": [1.0, -2.0, 3.0]}
BALANCED = [
    slow(jb.VonKarman(5, 3, 2), STEPPED, PUSH),
    exhaustive(jb.Classical(3, 4, 3), AS_BUILT, PUSH),
    exhaustive(jb.PlanarRod(2), STEPPED, PUSH),
    exhaustive(jb.papers.ANCF(3), dataclasses.replace(STEPPED, tip_body=BODY), PUSH),
]  # fmt: skip


def at_root(model, rotor, loads, parts, size=0.05):
    """Force and torque of the hub by what the root bears, and as runs have it, in any motion."""
    model = model.suited(rotor)
    rng, t = np.random.default_rng(3), jnp.asarray(0.2)
    q, v, a = size * rng.normal(size=(3, len(model.directions)))

    @jax.jit
    def found(q, v, a):
        scene = Scene(model, rotor, Tumbling(parts), loads, jb.Damping())
        equations = scene.equations
        outside = Environment(scene.hub(t), loads, t)
        forces, moments = section_loads(rotor, equations, outside, Moved(q, v, a), np.zeros(1))
        axes = equations.section_axes(q, np.zeros(1))[0]
        twist, lag, flap = moments[0]
        force = forces[0] @ axes
        moment = jnp.stack([twist, -flap, lag]) @ axes
        root = equations.undeformed_at(np.zeros(1))[0]
        reaction = scene.reaction(t, State(q, v, jnp.zeros(())), a)
        return (-force, -moment - jnp.cross(root, force)), reaction

    return found(*map(jnp.asarray, (q, v, a)))


def moving(planar):
    flat = np.array([[1, 1, 0], [0, 0, 1]] * 2) if planar else 1.0
    return jnp.asarray(np.random.default_rng(1).normal(size=(4, 3)) * flat)


@pytest.mark.parametrize(("model", "rotor", "loads"), BALANCED, ids=name)
def test_the_hub_bears_what_the_root_does(model, rotor, loads):
    """In any state and motion, steps and kinks of mass and load among them; without inertia of
    twist, whose moment is about the tangent in sections, and about the undeformed beam in runs."""
    planar = jb.models.Direction.FLAP not in model.directions
    if planar:
        loads = {name: (*value[:2], 0.0) for name, value in loads.items()}
    found, right = at_root(model, rotor, jb.Loads(**loads), moving(planar))
    for a, b in zip(found, right, strict=True):
        # Functions that follow a beam's tables are integrated to some 1e-8.
        near = 1e-7 if rotor is AS_BUILT else 1e-10
        np.testing.assert_allclose(a, b, atol=near * np.abs(b).max(), rtol=0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("rotor", [STEPPED, AS_BUILT], ids=["stepped", "as built"])
def test_theories_of_second_order_are_balanced_to_that(rotor):
    """What remains of `Hybrid` is of third order in the displacements."""
    left = []
    for size in (4e-2, 2e-2, 1e-2):
        found, right = at_root(jb.Hybrid(3, 4, 3), rotor, jb.Loads(**PUSH), moving(False), size)
        left.append(max(np.abs(a - b).max() for a, b in zip(found, right, strict=True)))
    order = np.log2(np.array(left[:-1]) / left[1:])
    assert (order > 2.7).all(), left


@pytest.mark.exhaustive
def test_runs_have_section_loads():
    """With inertia: at the root those of the hub, with damping too but for that which is drag."""
    motion, times = jb.SmoothSpinUp(5e-3, 1.0), np.linspace(0.0, 1.0, 4)
    run = jb.simulate(jb.Hybrid(0, 3, 0), ROTOR, motion, times)
    forces, moments = run.section_force(XI), run.section_moment(XI)
    assert forces.shape == moments.shape == (4, 5, 3)
    torque, size = run.hub_torque[:, 2], np.abs(run.hub_torque[:, 2]).max()
    at_root = -moments[:, 0, 1] - 0.4 * forces[:, 0, 1]
    np.testing.assert_allclose(at_root, torque, atol=1e-4 * size, rtol=0)
    np.testing.assert_allclose(forces[:, 0, 0], -run.hub_force[:, 0], rtol=1e-4, atol=1e-9)
    # Of the mass alone that is at the end.
    assert np.abs(moments[:, -1]).max() < 1e-12 * size
    assert np.abs(forces[1:, -1, 1]).min() > 1e-5


# --- against another rod -------------------------------------------------------------------------

BLADE = Rod(
    length=2.0, mass=1.3, axial=4e5, lag=44.0, flap=7.0, torsion=6.0, polar=1e-9,
    twist=lambda x: 0.5 - 0.6 * x, pitch=0.2, cone=0.12, hub=0.4, speed=6.0, tip_mass=0.3,
    force=(1.0, 2.0, 1.0), moment=(0.5, 1.0, -1.0), line=(0.2, -0.5, 0.8),
    gravity=(0.0, 0.0, -9.8),
)  # fmt: skip
HEAVY = dataclasses.replace(BLADE, offset=0.1, inertia=0.02, axial_inertia=0.005, follows=True)
FLAT = Rod(
    length=20.0, mass=40.0, axial=4e8, lag=6e6, flap=2e6, torsion=1e6, hub=1.0, speed=3.0,
    force=(0.0, 3000.0, 2500.0),
)  # fmt: skip


def right_of(rod):
    """Forces, moments and turned axes by another method, as `Steady` has them."""
    points, y = steady(rod)
    q, n, m = (points.between(part, XI) for part in (y[3:7], y[7:10], y[10:13]))
    n, m = (np.einsum("ijk,ik->jk", rotation(q), a) for a in (n, m))
    return n.T, np.stack([m[0], m[2], -m[1]], 1)


def by_rod(rod, degree):
    twist = {}
    if callable(rod.twist):
        values = rod.at("twist", np.array([0.0, 1.0]))
        twist = {"twist": jb.Spanwise([0, 1], values)}
    beam = jb.Beam(
        rod.length, rod.mass, rod.axial, rod.lag, rod.flap, torsional_stiffness=rod.torsion,
        polar_inertia=max(rod.polar, 1e-9), **twist,
    )  # fmt: skip
    body = jb.TipBody(rod.tip_mass, rod.offset, rod.inertia, rod.axial_inertia)
    more = {"pitch": rod.pitch, "precone": rod.cone} if rod.cone else {}
    more |= {"tip_body": body} if rod.offset else {"tip_mass": rod.tip_mass}
    loads = {"gravity": rod.gravity, "tip_force": rod.force}
    if rod.cone:
        loads |= {"tip_moment": rod.moment, "force_per_length": rod.line, "follows": rod.follows}
    model, rotor = jb.SpatialRod(degree), jb.Rotor(beam, rod.hub, **more)
    return jb.steady(model, rotor, rod.speed, loads=jb.Loads(**loads))


@pytest.mark.parametrize("rod", [exhaustive(BLADE), exhaustive(HEAVY), exhaustive(FLAT)])
def test_against_another_rod(rod):
    """Forces and moments in sections, whose errors fall exponentially with the degree."""
    right = right_of(rod)
    size = np.array([np.abs(b).max() for b in right])
    errors = []
    for degree in (8, 14):
        state = by_rod(rod, degree)
        found = state.section_force(XI), state.section_moment(XI)
        errors.append([np.abs(a - b).max() for a, b in zip(found, right, strict=True)] / size)
    assert (errors[1] < errors[0] / 10).all()
    assert (errors[1] < (1e-7 if rod is FLAT else 1e-3)).all()


# --- protocol ------------------------------------------------------------------------------------


@pytest.mark.exhaustive
def test_batches_and_gradients():
    """A lane that fails is alone; and what a section bears has derivatives."""
    model, sizes = jb.Hybrid(0, 3, 0), jnp.array([1.0, np.nan, 3.0])

    def root(size, speed):
        loads = jb.Loads(tip_force=jnp.stack([0 * size, 1e-2 * size, 0 * size]))
        return jb.steady(model, ROTOR, speed, loads=loads, throw=False)

    @jax.jit
    def found(sizes):
        batch = jax.vmap(root, (0, None))(sizes, 4.0)
        slope = jax.grad(lambda w: root(1.0, w).section_moment(0.2)[0, 1])(4.0)
        return batch.status, batch.section_moment(0.2), batch.tip, slope

    status, moments, tips, slope = found(sizes)
    assert status.tolist() == [jb.Status.OK, jb.Status.INVALID_LOAD, jb.Status.OK]
    assert np.isnan(moments[1]).all()
    assert np.isnan(tips[1]).all()
    np.testing.assert_allclose(moments[2, 0, 1] / moments[0, 0, 1], 3.0, rtol=1e-3)
    one = jax.jit(lambda w: root(1.0, w).section_moment(0.2)[0, 1])
    np.testing.assert_allclose(
        slope, finite_difference(lambda w: one(w[0]), [4.0])[..., 0], rtol=1e-4
    )


@pytest.mark.slow
def test_a_rod_that_tears_does_not_rest_folded():
    """Beyond the speed at which it tears, the search may end in a rod that lies turned back through
    the axis: an equilibrium, but of no rod that is clamped."""
    rotor = jb.Rotor(jb.Beam.from_slenderness(70.0), 0.1, 0.3)
    speeds = np.array([60.0, 100.0, 150.0, 300.0, 1e6])

    @jax.jit
    @jax.vmap
    def status(speed):
        return jb.steady(jb.PlanarRod(2), rotor, speed, throw=False).status

    torn = [bool(rotor.tears(speed)) for speed in speeds]
    assert torn == [False, True, True, True, True]
    assert (status(speeds) != jb.Status.OK).tolist() == torn


def test_it_is_where_a_run_begins():
    """`steady_start` finds the same state; loads that change in time are refused."""
    model, loads = jb.PlanarRod(1), jb.Loads(tip_force=[0.0, -0.3, 0.0])
    start = jb.steady_start(model, ROTOR, jb.ConstantSpeed(2.0), loads=loads)
    found = jb.steady(model, ROTOR, 2.0, loads=loads)
    np.testing.assert_allclose(found.q, start.q, rtol=1e-12)
    with pytest.raises(ValueError, match=r"loads\.tip_force must be constant"):
        jb.steady(model, ROTOR, 2.0, loads=jb.Loads(tip_force=lambda t: t * jnp.ones(3)))


def test_what_has_no_sections_says_so():
    found = jb.steady(jb.papers.DiscreteNC(), SPRINGS, 1.0)
    assert found.status == jb.Status.OK
    assert found.hub_force[0] < 0
    with pytest.raises(ValueError, match="SpringRotor has none: ask for hub_force"):
        found.section_moment(0.5)
    with pytest.raises(ValueError, match="xi must be"):
        found.displacement(1.5)
