"""What is asked of a beam as built: stability, stiffening, fits and the choice of a model."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.beams import AS_BUILT
from tests.helpers import optimised
from tests.tiers import exhaustive, slow

MODEL = jb.Hybrid(3, 8, 8)
FIRST = jb.labels(in_plane=1, flap=1)
UNCOUPLED = jb.Rotor(
    jb.Beam(
        2.0, jb.Spanwise([0, 0.4, 0.4, 1], [1.6, 1.3, 1.0, 0.7]), 4e4,
        jb.Spanwise([0, 0.5, 1], [14.0, 9.0, 5.0]), jb.Spanwise([0, 1], [8.0, 3.0]),
    ),
    hub_radius=0.3,
    tip_mass=0.2,
    root_springs=jb.RootSprings(in_plane=60.0),
)  # fmt: skip


@pytest.mark.parametrize("speed", [slow(0.0), exhaustive(2.0)])
def test_southwell_coefficients_are_slopes_of_squares(speed):
    """d omega^2 / d Omega^2, at rest from a small speed."""
    found = jb.southwell(MODEL, AS_BUILT, speed, FIRST).coefficient

    def square(speed):
        return np.asarray(jb.modes(MODEL, AS_BUILT, speed, FIRST).frequency) ** 2

    low, high = (0.0, 0.02) if speed == 0 else (speed - 0.01, speed + 0.01)
    slope = (square(high) - square(low)) / (high**2 - low**2)
    np.testing.assert_allclose(found, slope, rtol=2e-4)


@pytest.mark.exhaustive
def test_a_classical_beam_diverges_at_its_first_frequency():
    """Whatever its properties: K - Omega^2 M in plane (Y, section 5); of a beam whose sections are
    turned the plane has part in both directions, and it happens later."""
    classical = jb.Classical(3, 8, 8)
    first = jb.modes(classical, UNCOUPLED, 0.0, jb.labels(in_plane=1)).frequency[0]
    found = jb.critical_speed(classical, UNCOUPLED)
    np.testing.assert_allclose(found.angular_speed, first, rtol=1e-9)
    turned = jb.Classical(3, 8, 8)
    lowest = jb.modes(turned, AS_BUILT, 0.0, 1).frequency[0]
    critical = float(jb.critical_speed(turned, AS_BUILT).angular_speed)
    assert critical > lowest
    below, beyond = (
        jb.modes(turned, AS_BUILT, share * critical, 1).growth_rate[0] for share in (0.999, 1.001)
    )
    assert below == 0
    assert beyond > 0


@pytest.mark.slow
def test_elements_lose_their_stability_where_they_tear():
    """A varying rod tears where its axial stiffness is used up, which the modal theory knows."""
    elements = jb.PlanarRod(8)
    modal = jb.Hybrid(12, 8, 0)
    found, wanted = (jb.critical_speed(m, UNCOUPLED) for m in (elements, modal))
    np.testing.assert_allclose(found.angular_speed, wanted.angular_speed, rtol=1e-3)


@pytest.mark.parametrize("rotor", [slow(AS_BUILT, id="turned"), UNCOUPLED])
@pytest.mark.exhaustive
def test_multipliers_without_modulation(rotor):
    """exp(+-i omega T) of all modes."""
    model = jb.Hybrid(1, 3, 3)
    motion = jb.motions.ModulatedSpeed(2.0, 0.0, 5.0)
    found = jb.floquet(model, rotor, motion, steps=256)
    system = model.linearise(rotor, 2.0)
    inverse, none = np.linalg.inv(system.mass), np.zeros((7, 7))
    below = [-inverse @ system.stiffness, -inverse @ system.gyroscopic]
    wanted = np.exp(np.linalg.eigvals(np.block([[none, np.eye(7)], below])) * 2 * np.pi / 5.0)
    apart = np.abs(np.asarray(found.multipliers)[:, None] - wanted[None])
    assert np.max(np.min(apart, 1)) < 1e-5
    assert np.max(np.min(apart, 0)) < 1e-5


@pytest.mark.exhaustive
def test_a_tongue_of_flap_with_lag_where_sections_are_turned():
    """Inside its boundaries a mode grows, outside none does."""
    model = jb.Hybrid(0, 3, 3)
    found = jb.tongue(model, AS_BUILT, 2.0, FIRST, [0.1], steps=48)
    low, high = np.asarray(found.frequency)[0]
    assert low < high

    def growth(frequency):
        motion = jb.motions.ModulatedSpeed(2.0, 0.1, frequency)
        return float(jb.floquet(model, AS_BUILT, motion, steps=96).growth_rate)

    width = high - low
    assert growth((low + high) / 2) > 1e-4
    assert growth(low - 0.2 * width) < 1e-6
    assert growth(high + 0.2 * width) < 1e-6
    with pytest.raises(ValueError, match="coupled with each other"):
        jb.tongue(jb.Hybrid(0, 3, 3), UNCOUPLED, 2.0, FIRST, [0.1])


@pytest.mark.slow
def test_stable_step():
    """Over the period of the fastest mode it is that of any beam."""

    def over_period(rotor):
        model = jb.Hybrid(0, 3, 3)
        step = jb.solvers.stable_step(model, rotor, 0.0, diffrax.Tsit5()).step
        system = model.linearise(rotor, 0.0)
        square = np.linalg.eigvals(np.linalg.solve(system.mass, system.stiffness))
        return step * np.sqrt(np.max(square.real))

    uniform = jb.Rotor(jb.Beam(1.0, 1.0, 1e4, 2.0, 1.0))
    np.testing.assert_allclose(over_period(AS_BUILT), over_period(uniform), rtol=1e-6)


def built(**changes):
    given = {"stiff": 5.0, "soft": 2.0, "spring": 12.0, "tip_mass": 0.15} | changes
    stations = (0.0, 0.5, 1.0)
    flap = jb.Spanwise(
        stations, jnp.stack([given["stiff"], 3.0 + 0 * given["soft"], given["soft"]])
    )
    beam = jb.Beam(1.0, jb.Spanwise(stations, [1.0, 0.8, 0.5]), 1e5, 16.0, flap)
    root = jb.RootSprings(flap=given["spring"])
    return jb.Rotor(beam, 0.2, given["tip_mass"], root_springs=root)


TRUTH = {"stiff": 5.0, "soft": 2.0, "spring": 12.0, "tip_mass": 0.15}
FITTED = jb.Hybrid(0, 0, 10)


@pytest.mark.exhaustive
def test_fit_of_stations_a_spring_and_a_tip_mass():
    """Frequencies without noise give all of them back, from 20 % off."""
    speeds, labels = np.array([0.0, 4.0, 8.0]), jb.labels(flap=3)
    data = np.stack([jb.modes(FITTED, built(), speed, labels).frequency for speed in speeds])

    def experiments(**values):
        return jb.FrequencyData(FITTED, built(**values), speeds, data, 1e-4 * data, labels)

    free = {
        name: jb.FreeParameter(value * (1.2 if i % 2 else 0.8))
        for i, (name, value) in enumerate(TRUTH.items())
    }
    found = optimised(lambda: jb.fit(experiments, free))()
    for name, value in TRUTH.items():
        np.testing.assert_allclose(found.parameters[name], value, rtol=1e-6)


@pytest.mark.exhaustive
def test_choice_of_a_model():
    """The rung chosen is right to the tolerance, against elements twice as fine as the judge; of
    turned sections, which no element in the plane has, it is honest."""
    question = jb.ladder.PeakDeflection(jb.SmoothSpinUp(2.5, 4.0), np.linspace(0.0, 5.0, 40))
    choice = jb.choose_model(UNCOUPLED, question, 1e-2)
    assert choice.met
    truth = jb.ladder.evaluate(jb.PlanarRod(16), UNCOUPLED, question, 1e-6)
    assert np.abs(choice.answer / np.asarray(truth.value) - 1).max() < 1e-2
    frequencies = jb.ladder.ModalFrequencies(2.0, FIRST)
    choice = jb.choose_model(AS_BUILT, frequencies, 0.05)
    assert choice.met
    converged = jb.modes(jb.Hybrid(0, 20, 20), AS_BUILT, 2.0, FIRST).frequency
    assert np.abs(choice.answer / np.asarray(converged) - 1).max() < 0.05
    cases = jb.grid(tip_mass=[0.1, 0.3])
    table = jb.ladder_sweep(
        lambda tip_mass: (
            jb.Rotor(UNCOUPLED.beam, 0.3, tip_mass, root_springs=UNCOUPLED.root_springs),
            jb.ladder.ModalFrequencies(2.0, jb.labels(in_plane=2)),
        ),
        cases, 1e-2,
    )  # fmt: skip
    assert (table["status"] == jb.Status.OK).all()


@pytest.mark.slow
def test_a_large_batch_is_single_cases():
    """Three hundred blades at once, in rows, and the same numbers."""

    def frequency(stiffness):
        return jb.modes(FITTED, built(stiff=stiffness), 4.0, 2, throw=False).frequency

    stiffness = jnp.linspace(4.0, 6.0, 300)
    many = jax.jit(jax.vmap(frequency))(stiffness)
    np.testing.assert_allclose(many[17], frequency(stiffness[17]), rtol=1e-11)


@pytest.mark.exhaustive
@pytest.mark.parametrize("stretch", [0, 3])
def test_blades_of_a_large_batch_fail_alone(stretch):
    """Three hundred random blades at once, some of which fail: numbers, labels, estimates and
    derivatives of single cases, in rows the last of which is not full. Without stretch derivatives
    are by forms, with it by matrices."""
    model, stations = jb.Hybrid(stretch, 6, 6), [0.0, 0.4, 0.4, 1.0]
    draw = np.random.default_rng(8).uniform(0.7, 1.3, (300, 9))
    draw[[3, 77], 0] = -1.0

    def found(v):
        taper = np.array([4.0, 3.0, 2.0, 1.0])
        mass, flap = (jb.Spanwise(stations, s * taper) for s in (v[0], 300.0 * v[1:5]))
        beam = jb.Beam(10.0, mass, 1e7, 3e3 * v[5], flap, twist=jb.Spanwise([0, 1], v[6:8]))
        return jb.modes(model, jb.Rotor(beam, 1.0, 2.0 * v[8]), 3.0 * v[5], 4, throw=False)

    def both(v):
        return found(v), jax.jacrev(lambda v: found(v).frequency)(v)

    many, slopes = jax.jit(jax.vmap(both))(jnp.asarray(draw))
    one = jax.jit(both)
    for i in (0, 3, 77, 123, 299):
        single, slope = one(jnp.asarray(draw[i]))
        mine = jax.tree.map(lambda a, i=i: a[i], many)
        assert mine.status == single.status
        if mine.status == jb.Status.OK:  # else numbers that are harmless have labels
            assert mine.labels == single.labels
            errors = mine.frequency_error, single.frequency_error
            np.testing.assert_allclose(*errors, rtol=1e-2, atol=1e-12)
        np.testing.assert_allclose(mine.frequency, single.frequency, rtol=1e-9)
        np.testing.assert_allclose(mine.shape, single.shape, atol=1e-6)
        np.testing.assert_allclose(slopes[i], slope, rtol=1e-7, atol=1e-9)
    failed = np.asarray(many.status) != jb.Status.OK
    invalid = np.asarray(many.status) == jb.Status.INVALID_MASS_PER_LENGTH
    assert np.flatnonzero(invalid).tolist() == [3, 77]
    assert np.isnan(many.frequency[failed]).all()
    fine, step = np.flatnonzero(~failed)[0], 1e-5 * np.eye(9)[3]
    ends = [one(jnp.asarray(draw[fine] + s * step))[0].frequency for s in (1, -1)]
    # But for what six functions leave out.
    np.testing.assert_allclose(slopes[fine][:, 3], (ends[0] - ends[1]) / 2e-5, atol=4e-3)


@pytest.mark.exhaustive
def test_choices_for_a_step_within_elements():
    """Estimates are honest, and functions that follow the step cheap: EI falls to a quarter at 0.3,
    where no number of elements of a power of two has a node."""
    stations = (0, 0.3, 0.3, 1)
    beam = jb.Beam(
        10.0, jb.Spanwise(stations, [60, 50, 30, 12]), 1e9,
        jb.Spanwise(stations, [9e5, 8e5, 2e5, 4e4]), 1e6,
    )  # fmt: skip
    rotor, labels = jb.Rotor(beam, 1.0, 5.0), jb.labels(in_plane=2)
    exact = np.asarray(jb.modes(jb.Hybrid(24, 24, 0), rotor, 3.0, labels).frequency)
    question = jb.ladder.ModalFrequencies(3.0, labels)
    choice = jb.choose_model(rotor, question, 1e-3)
    assert choice.met
    assert np.abs(choice.answer / exact - 1).max() < choice.estimate
    assert choice.rung.cost < 2  # some functions
    table = jb.ladder_sweep(
        lambda tip_mass: (jb.Rotor(beam, 1.0, tip_mass), question), jb.grid(tip_mass=[5.0]), 1e-3
    )
    assert (table["status"] == jb.Status.OK).all()
    assert np.abs(table["value"][0] / exact - 1).max() < table["estimate"][0]


@pytest.mark.exhaustive
def test_the_largest_steady_strain_is_beside_a_step():
    """P / EA where EA falls to 0.7 of itself, in every theory; P(L / 2) = Omega^2 (1 - 1/4) / 2."""
    steps = jb.Spanwise([0, 0.5, 0.5, 1], [1e4, 1e4, 7e3, 7e3])
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, steps, 1.0, 1.0))
    for model in (jb.Hybrid(2, 6, 0), jb.VonKarman(4, 6, 0), jb.PlanarRod(2)):
        strain = jb.modes(model, rotor, 8.0, 1).steady_strain
        np.testing.assert_allclose(strain, 64 * 0.375 / 7e3, rtol=1e-6)
