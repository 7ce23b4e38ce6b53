"""Beams that point inward, from a rim to the axis and beyond: pushed, they soften and buckle."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._modes.search import MANY
from jaxbeam.models import Direction
from tests.helpers import name
from tests.references import power_series
from tests.tiers import exhaustive, slow

SLENDER = 1000.0
WAYS = "in plane", "flap"


def inward(hub, tip=0.0, slenderness=SLENDER, **more):
    beam = jb.Beam(1.0, 1.0, slenderness**2, 1.0, 1.0, torsional_stiffness=0.5)
    return jb.Rotor(beam, hub, tip, **more)


@pytest.mark.parametrize(
    ("hub", "tip", "speed"),
    [(-1.0, 0.0, 2.0), exhaustive(-3.0, 0.2, 0.8), exhaustive(-0.4, 0.1, 3.0),
     exhaustive(-20.0, 0.0, 0.6)],
)  # fmt: skip
def test_frequencies_are_those_of_power_series(hub, tip, speed):
    found = jb.modes(jb.Hybrid(0, 9, 9), inward(hub, tip), speed, jb.labels(in_plane=2, flap=2))
    exact = [power_series.frequencies(speed, hub, tip, None, way, count=2) for way in WAYS]
    np.testing.assert_allclose(found.frequency, np.concatenate(exact), rtol=1e-8)
    error = np.abs(found.frequency / np.concatenate(exact) - 1)
    assert (error <= 3 * found.frequency_error + 1e-11).all()


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "tolerance"),
    [(jb.Hybrid(6, 12, 0), 1e-8), (jb.PlanarRod(16), 1e-5), (jb.papers.GreenANCF(16), 1e-5),
     (jb.papers.ANCF(16), 1e-5), (jb.papers.SmallStrainANCF(16), 1e-5),
     (jb.VonKarman(17, 8, 0), 1e-5), (jb.SpatialRod(8), 1e-5)],
    ids=name,
)  # fmt: skip
def test_all_theories_agree_while_strains_are_small(model, tolerance):
    """With stretch, 4e-5 strain at most; beyond the critical speed growth rates, too."""
    which = jb.labels(in_plane=2)
    for hub, tip, speed in ((-1.0, 0.0, 2.0), (-0.4, 0.1, 3.0)):
        found = jb.modes(model, inward(hub, tip), speed, which)
        exact = power_series.frequencies(speed, hub, tip, SLENDER, count=2)
        np.testing.assert_allclose(found.frequency, exact, rtol=tolerance)
    beyond = jb.modes(model, inward(-1.5), 3.0, which)
    right = jb.modes(jb.Hybrid(6, 16, 0), inward(-1.5), 3.0, which)
    np.testing.assert_allclose(beyond.growth_rate, right.growth_rate, rtol=1e-3, atol=1e-9)
    assert beyond.growth_rate[0] > 1


CRITICAL = [
    (jb.Hybrid(0, 9, 9), 1e-9), exhaustive(jb.Hybrid(4, 9, 0), 1e-9),
    exhaustive(jb.PlanarRod(8), 3e-5), exhaustive(jb.papers.GreenANCF(8), 3e-5),
    exhaustive(jb.papers.ANCF(8), 3e-5), exhaustive(jb.papers.SmallStrainANCF(8), 3e-5),
    exhaustive(jb.VonKarman(17, 8, 0), 3e-5), exhaustive(jb.SpatialRod(6), 3e-5),
]  # fmt: skip


@pytest.mark.parametrize(("model", "tolerance"), CRITICAL, ids=name)
def test_it_buckles_at_the_speed_of_power_series(model, tolerance):
    """In plane, where it is driven out besides; crossing the axis, far from it, with a tip mass."""
    for hub, tip in ((-1.0, 0.0), (-3.0, 0.2), (-0.4, 0.1), (-50.0, 0.0)):
        found = jb.critical_speed(model, inward(hub, tip))
        exact = power_series.critical_speed(hub, tip)
        np.testing.assert_allclose(found.angular_speed, exact, rtol=tolerance)
        assert found.direction == Direction.IN_PLANE
    if Direction.FLAP in model.directions:
        beam = jb.Beam(1.0, 1.0, SLENDER**2, 100.0, 1.0, torsional_stiffness=0.5)
        soft = jb.Rotor(beam, -3.0, 0.2)
        found = jb.critical_speed(model, soft)
        exact = power_series.critical_speed(-3.0, 0.2, "flap")
        np.testing.assert_allclose(found.angular_speed, exact, rtol=tolerance)
        assert found.direction == Direction.FLAP


def test_the_heavy_column_is_the_limit_of_a_wide_rim():
    """Greenhill's 7.8373: W^2 (R - ...) as gravity, for R of ten thousand lengths."""
    found = jb.critical_speed(jb.Hybrid(0, 9, 9), inward(-1e4)).angular_speed
    np.testing.assert_allclose(found**2 * 1e4, 7.8373474, rtol=2e-4)


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.Hybrid(0, 9, 0), jb.PlanarRod(4)], ids=name)
def test_critical_speeds_have_gradients(model):
    """By differences; of the modal theory against those of power series, too."""
    of = jax.jit(lambda hub, tip: jb.critical_speed(model, inward(hub, tip)).angular_speed)
    exact = jax.jit(jax.grad(of, (0, 1)))(-1.2, 0.1)
    forward = jax.jit(jax.jacfwd(of, (0, 1)))(-1.2, 0.1)
    np.testing.assert_allclose(forward, exact, rtol=1e-9)
    step = 1e-5
    theirs = [of] if not isinstance(model, jb.Hybrid) else [of, power_series.critical_speed]
    for one in theirs:
        slopes = [
            (one(-1.2 + step, 0.1) - one(-1.2 - step, 0.1)) / (2 * step),
            (one(-1.2, 0.1 + step) - one(-1.2, 0.1 - step)) / (2 * step),
        ]
        np.testing.assert_allclose(exact, slopes, rtol=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.Hybrid(4, 12, 8), jb.PlanarRod(8)], ids=name)
def test_a_batch_by_bands_is_that_of_single_cases(model):
    """Outward, crossing the axis, inward, and beyond the critical speed, where they grow."""
    which = jb.labels(in_plane=2)

    def of(hub, speed):
        found = jb.modes(model, inward(hub, 0.1), speed, which, throw=False)
        return found.eigenvalue, found.frequency_error, found.steady_strain, found.status

    hub = jnp.linspace(-3.0, 1.0, MANY)
    speed = jnp.tile(jnp.array([0.5, 1.0, 1.5, 2.5]), MANY // 4)
    many = jax.jit(jax.vmap(of))(hub, speed)
    alone = jax.jit(lambda hub, speed: jax.lax.map(lambda x: of(*x), (hub, speed)))(hub, speed)
    assert (many[3] == 0).all()
    assert (np.asarray(many[0]).real.max(1) > 0.1).sum() > 20
    np.testing.assert_allclose(many[0], alone[0], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(many[2], alone[2], rtol=1e-6, atol=1e-12)


def test_southwell_coefficients_go_on_below_the_axis():
    """Affine in the hub radius: from outside of it to within."""

    @jax.jit
    @jax.vmap
    def of(hub):
        return jb.southwell(jb.Hybrid(0, 8, 0), inward(hub), 0.0, 2).coefficient

    low, middle, high = of(jnp.array([-2.0, 0.0, 2.0]))
    np.testing.assert_allclose(low + high, 2 * middle, rtol=1e-9)
    assert (low < 0).all()


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.Hybrid(0, 6, 0), jb.PlanarRod(3)], ids=name)
def test_a_rigid_blade_falls_off_its_spring(model):
    """k + W^2 R L m / 2 = 0 in plane; on a free hinge at once, and outward never."""

    def of(hub, spring):
        root = jb.RootSprings(in_plane=spring)
        rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e7, 1e5, 1e5), hub, root_springs=root)
        return jb.critical_speed(model, rotor).angular_speed

    np.testing.assert_allclose(of(-2.0, 3.0), np.sqrt(3.0), rtol=1e-4)
    assert of(-2.0, 0.0) == 0
    if model.is_linear:
        assert of(0.5, 0.0) == np.inf


@pytest.mark.exhaustive
def test_a_taper_that_points_inward_buckles_alike_in_two_theories():
    taper, flap = jb.Spanwise([0.0, 1.0], [1.0, 0.3]), jb.Spanwise([0.0, 1.0], [2.0, 0.6])
    rotor = jb.Rotor(jb.Beam(1.0, jb.Spanwise([0.0, 1.0], [1.0, 0.5]), 1e6, taper, flap), -2.0)
    modal, elements = (
        jb.critical_speed(model, rotor).angular_speed
        for model in (jb.Hybrid(0, 12, 12), jb.PlanarRod(8))
    )
    np.testing.assert_allclose(elements, modal, rtol=6e-5)


@pytest.mark.exhaustive
def test_strains_have_signs():
    """Uniform and by table, pushed at the root, pulled where the beam crosses the axis."""
    speed, ones = jnp.asarray(2.0), jb.Spanwise([0.0, 0.3, 1.0], [1.0, 1.0, 1.0])
    varies = jb.Beam(1.0, ones, SLENDER**2, 1.0, 1.0)
    for hub, tip in ((-2.0, 0.0), (-0.4, 0.1), (-0.9, 0.3), (0.5, 0.1)):
        x = np.linspace(0.0, 1.0, 100_001)
        pull = hub * (1 - x) + (1 - x**2) / 2 + tip * (hub + 1)
        exact = speed**2 * pull[np.argmax(np.abs(pull))] / SLENDER**2
        plain, table = inward(hub, tip), jb.Rotor(varies, hub, tip)
        np.testing.assert_allclose(plain.steady_strain(speed), exact, rtol=1e-9)
        np.testing.assert_allclose(table.steady_strain(speed), exact, rtol=2e-2)


@pytest.mark.parametrize("model", [jb.papers.DiscreteLP(), slow(jb.papers.DiscreteNC())], ids=name)
def test_the_discrete_analogue_falls_off_the_rim(model):
    """k_r + m d L W^2 = 0, but for what the soft tube gives."""
    rotor = jb.papers.SpringRotor(1.0, 1.0, -3.0, 1e8, 2.0)
    found = jb.critical_speed(model, rotor).angular_speed
    np.testing.assert_allclose(found, np.sqrt(2.0 / 3.0), rtol=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.Hybrid(0, 8, 0), jb.PlanarRod(6)], ids=name)
def test_spin_ups(model):
    """Work balances energy; it lags more than from the axis outward. About the critical speed a
    disturbance swings, or grows at the rate that modes have."""
    rotor, critical = inward(-1.0, slenderness=200.0), power_series.critical_speed(-1.0)
    run = jb.simulate(
        model, rotor, jb.SmoothSpinUp(0.5 * critical, 8.0), jnp.linspace(0.0, 10.0, 51)
    )
    assert abs(run.imbalance).max() < 1e-5
    assert abs(run.tip[-1, 1]) < 0.05
    speed = 1.2 * critical
    growing = jb.modes(model, rotor, speed, 1)
    rate, shape = growing.growth_rate[0], growing.shape[0].real
    rest = jb.steady_start(model, rotor, jb.ConstantSpeed(speed))
    start = jb.solvers.State(rest.q + 1e-6 * shape, rate * 1e-6 * shape)
    times = jnp.linspace(0.0, 3.0 / rate, 4)
    run = jb.simulate(model, rotor, jb.ConstantSpeed(speed), times, start=start)
    tip = np.asarray(run.tip[:, 1])
    np.testing.assert_allclose(tip / tip[0], np.exp(rate * times), rtol=1e-3)
