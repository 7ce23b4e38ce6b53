"""Motion under a force along the span."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._numerics.linalg import dense
from jaxbeam._simulation.scene import Scene
from jaxbeam._solvers.system import State
from tests.beams import AS_BUILT
from tests.helpers import finite_difference
from tests.simulation.common import TIGHT
from tests.tiers import exhaustive

MASS = jb.Spanwise([0, 0.3, 0.3, 1], [1.6, 1.2, 1.0, 0.7])
BEAM = jb.Beam(2.0, MASS, 4e3, 14.0, 8.0, torsional_stiffness=6.0, polar_inertia=0.03)
ROTOR = jb.Rotor(BEAM, hub_radius=0.4)
SPEED, TILTED = 1.5, np.array([0.6, -0.8, 0.5])
MOTION = jb.ConstantSpeed(SPEED)


def weight(t):
    """Of each length what gravity does on it, in the axes of the hub, which turns."""
    cos, sin = jnp.cos(SPEED * t), jnp.sin(SPEED * t)
    x, y, z = TILTED
    return tuple(
        jb.Spanwise(MASS.stations, g * MASS.values)
        for g in (x * cos + y * sin, y * cos - x * sin, z)
    )


MODELS = [jb.VonKarman(5, 3, 2), jb.PlanarRod(2), jb.SpatialRod(2), jb.Hybrid(2, 3, 3)]


def both(model):
    """Gravity, and the same as a force along the span; in the plane for a model that is planar."""
    share = np.array([1.0, 1.0, 0.0 if isinstance(model, jb.PlanarRod) else 1.0])

    def own(t):
        return tuple(
            jb.Spanwise(part.stations, s * part.values)
            for s, part in zip(share, weight(t), strict=True)
        )

    return jb.Loads(gravity=share * TILTED), jb.Loads(force_per_length=own)


@pytest.mark.parametrize("model", [MODELS[-1], *map(exhaustive, MODELS[:-1])])
def test_weight_as_a_force_along_the_span(model):
    """Forces, tangents, power and what the hub feels are those of gravity, in any state."""
    model, rng, t = model.suited(ROTOR), np.random.default_rng(3), jnp.asarray(0.7)
    q, v = (0.05 * jnp.asarray(rng.normal(size=n)) for n in model.sizes)
    state = State(q, v, jnp.zeros(()))

    @jax.jit
    def seen(q, v):
        found = []
        for loads in both(model):
            scene = Scene(model, ROTOR, MOTION, loads, jb.Damping())
            x = scene.inputs(t)
            k = dense(scene.tangents(x, q, v)[0])
            found.append((scene.force(x, q, v), k, scene.power(x, q, v), scene.reaction(t, state)))
        return found

    gravity, span = seen(state.q, state.v)
    for a, b in zip(jax.tree.leaves(gravity), jax.tree.leaves(span), strict=True):
        np.testing.assert_allclose(b, a, atol=1e-10 * np.abs(a).max(), rtol=0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", MODELS)
def test_motion_under_weight_as_a_force_along_the_span(model):
    """It moves the beam, and pulls at the hub, as gravity does; and its work is balanced."""
    times = np.linspace(0.0, 3.0, 7)
    gravity, span = (
        jb.simulate(model, ROTOR, MOTION, times, loads=loads, stepsize_controller=TIGHT)
        for loads in both(model)
    )
    assert np.abs(gravity.tip).max() > 0.05
    np.testing.assert_allclose(span.tip, gravity.tip, atol=1e-7)
    np.testing.assert_allclose(span.hub_force, gravity.hub_force, atol=1e-5)
    np.testing.assert_allclose(span.hub_torque, gravity.hub_torque, atol=1e-5)
    assert np.abs(span.imbalance).max() < 1e-6
    states = [
        jb.steady_start(model, ROTOR, jb.ConstantSpeed(0.0), loads=loads).q for loads in both(model)
    ]
    np.testing.assert_allclose(states[1], states[0], atol=1e-9)


TABLE = jb.Spanwise([0, 0.3, 0.3, 1], [1.0, 2.0, -1.0, 0.5])
FOLLOWING = jb.Loads(force_per_length=(1.0, TABLE, 0.7), follows=True)


@pytest.mark.exhaustive
def test_runs_under_a_force_that_turns_with_the_sections():
    """Its work is balanced, and what the hub feels is the change of momentum less all forces: at
    rest after a slow rise, to the sum of the forces and of their moments."""
    model = jb.SpatialRod(2)

    def rising(t):
        share = jnp.minimum(t, 1.0)
        return (0.3 * share, jb.Spanwise(TABLE.stations, share * TABLE.values), 0.5 * share)

    loads = jb.Loads(force_per_length=rising, follows=True, changes=[1.0])
    run = jb.simulate(
        model, ROTOR, MOTION, np.linspace(0.0, 2.0, 5), loads=loads, stepsize_controller=TIGHT
    )
    assert np.abs(run.tip[:, 1:]).max() > 0.1
    assert np.abs(run.imbalance).max() < 1e-6
    still = jb.ConstantSpeed(0.0)
    start = jb.steady_start(model, ROTOR, still, loads=FOLLOWING)
    rest = jb.simulate(model, ROTOR, still, [0.0, 0.01], start=start, loads=FOLLOWING)
    span, equations = rest.scene.span, rest.scene.equations
    (xi, weight), q = span.integral.points, start.q
    force = 2.0 * weight[:, None] * span.integral.acting(q, span.density(jnp.zeros(())))
    place = equations.displacement(q, xi) + (0.4 + 2.0 * xi)[:, None] * np.array([1.0, 0, 0])
    np.testing.assert_allclose(rest.hub_force[-1], -force.sum(0), atol=1e-6)
    np.testing.assert_allclose(rest.hub_torque[-1], -np.cross(place, force).sum(0), atol=1e-6)


@pytest.mark.exhaustive
def test_gradients_and_jumps():
    """By a value of the table; a force that is declared to jump is that of two runs."""
    model, times = jb.Hybrid(1, 3, 2), np.linspace(0.0, 2.0, 3)

    def tip(size):
        loads = jb.Loads(
            force_per_length=(0.0, jb.Spanwise([0, 1], jnp.stack([0 * size, size])), 0.0)
        )
        run = jb.simulate(model, AS_BUILT, MOTION, times, loads=loads, stepsize_controller=TIGHT)
        return run.tip[-1]

    slope = finite_difference(lambda x: tip(x[0]), jnp.array([0.7]))
    np.testing.assert_allclose(jax.jacrev(tip)(0.7), slope[:, 0], rtol=1e-5)

    def late(t):
        return (0.0 * t, jnp.where(t > 1.0, 0.7, 0.0), 0.0 * t)

    whole = jb.simulate(
        model, AS_BUILT, MOTION, times, loads=jb.Loads(force_per_length=late, jumps=[1.0]),
        stepsize_controller=TIGHT,
    )  # fmt: skip
    first = jb.simulate(model, AS_BUILT, MOTION, times[:2], stepsize_controller=TIGHT)
    start = jax.tree.map(lambda a: a[-1], first.state)
    second = jb.simulate(
        model, AS_BUILT, MOTION, times[1:], loads=jb.Loads(force_per_length=(0.0, 0.7, 0.0)),
        start=start, stepsize_controller=TIGHT,
    )  # fmt: skip
    np.testing.assert_allclose(whole.tip[-1], second.tip[-1], atol=1e-8)


@pytest.mark.exhaustive
def test_a_wave_that_travels_along_the_span():
    """A function of x that knows the time, as one of tables that do, at many stations."""
    model, times, at = jb.Hybrid(0, 3, 0), np.linspace(0.0, 2.0, 5), np.linspace(0.0, 1.0, 401)

    def wave(x, t):
        return jnp.sin(3 * x - 2 * t)

    tips = [
        jb.simulate(
            model, ROTOR, MOTION, times, loads=jb.Loads(force_per_length=force),
            stepsize_controller=TIGHT,
        ).tip
        for force in (
            lambda t: (0.0, jb.blades.SpanwiseFunction(lambda x: wave(x, t)), 0.0),
            lambda t: (0.0, jb.Spanwise(at, wave(jnp.asarray(at), t)), 0.0),
        )
    ]  # fmt: skip
    assert np.abs(tips[0]).max() > 0.05
    np.testing.assert_allclose(tips[1], tips[0], atol=1e-5)


def test_discrete_models_take_none():
    rotor = jb.papers.SpringRotor(1.0, 1.0, 0.1, 100.0, 10.0)
    loads = jb.Loads(force_per_length=(0.0, 1.0, 0.0))
    with pytest.raises(ValueError, match="has no force along the span"):
        jb.steady_start(jb.papers.DiscreteLC(), rotor, MOTION, loads=loads)


def test_what_turns_with_the_sections_is_refused_in_a_plane_and_where_it_would_need_a_potential():
    with pytest.raises(ValueError, match=r"loads\.follows: PlanarRod has no load that turns"):
        jb.modes(jb.PlanarRod(2), ROTOR, 0.0, loads=FOLLOWING)
    with pytest.raises(ValueError, match=r"loads\.follows: a moment, or a force that turns"):
        jb.critical_speed(jb.SpatialRod(2), ROTOR, loads=FOLLOWING)
    assert jb.Loads(gravity=[0, 0, -9.8], follows=True).has_potential
