"""Fitting: what is found is what was put in, how sure it is, and what the data cannot tell."""

import itertools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure
from optimistix import LevenbergMarquardt
from scipy.stats import chi2, t

import jaxbeam as jb
from jaxbeam import plot
from jaxbeam._fitting.matching import match_modes
from tests.fitting.lines import line
from tests.helpers import optimised, slender

MODEL = jb.Hybrid(3, 6, 6)
SPEEDS = [0.0, 2.0, 4.0, 6.0]
KNOWN_MASS = 0.25  # kg, added to the tip in half of the tests: it sets the scale of forces
WHICH = jb.labels(in_plane=3, flap=3, axial=1)
TRUTH = {
    "in_plane": 2.0, "flap": 1.2, "axial": 3e4, "mass": 1.1, "hub": 0.3, "tip": 0.4,
}  # fmt: skip


def rotor_of(in_plane, flap, axial, mass, hub, tip):
    return jb.Rotor(jb.Beam(1.0, mass, axial, in_plane, flap), hub, tip)


def with_and_without(measured, noise, model=MODEL, which=WHICH):
    """Frequencies of the rotor as it is, and with a known mass at its tip."""

    def experiments(tip, **others):
        return [
            jb.FrequencyData(model, rotor_of(tip=tip + more, **others), SPEEDS, y, s, which)
            for more, y, s in zip((0.0, KNOWN_MASS), measured, noise, strict=True)
        ]

    return experiments


def blank():
    return np.ones((2, len(SPEEDS), len(WHICH)))


@pytest.fixture(scope="module")
def frequencies():
    experiments = with_and_without(blank(), blank())(**TRUTH)
    return np.stack([jax.jit(lambda e: e.predicted())(e) for e in experiments])


def off(by=0.5, seed=0, truth=TRUTH):
    """Guesses that far off, either way."""
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], len(truth))
    return {
        name: jb.FreeParameter(value * (1 + by * sign))
        for (name, value), sign in zip(truth.items(), signs, strict=True)
    }


def relative(fit, truth=TRUTH):
    return max(abs(float(fit.parameters[name]) / value - 1) for name, value in truth.items())


@pytest.mark.parametrize("seed", range(30))
def test_modes_are_matched_as_by_brute_force(seed):
    rng = np.random.default_rng(seed)
    computed = rng.permutation(np.cumsum(rng.uniform(0.1, 2.0, 6)))
    measured = rng.choice(computed, 4, replace=False) * np.exp(0.3 * rng.normal(size=4))
    if seed % 3 == 0:
        measured[rng.integers(4)] = np.nan
    here = np.flatnonzero(np.isfinite(measured))
    found = np.asarray(match_modes(measured, computed))[here]

    def cost(places):
        return np.sum(np.log(measured[here] / computed[list(places)]) ** 2)

    least = min(cost(p) for p in itertools.permutations(range(6), len(here)))
    assert len(set(found.tolist())) == len(here)
    np.testing.assert_allclose(cost(found), least, rtol=1e-12)


def test_match_passes_over_modes_without_an_answer():
    assert np.asarray(match_modes([1.0, 3.1], [jnp.nan, 3.0, 1.1])).tolist() == [2, 1]
    for measured in ([1.0, 2.0], []):
        with pytest.raises(ValueError, match="not empty and the latter no shorter"):
            match_modes(measured, [1.0])


@pytest.mark.exhaustive
def test_frequencies_without_noise_give_the_parameters_back(frequencies):
    experiments = with_and_without(frequencies, 1e-3 * frequencies)
    for seed in range(8):
        found = jb.fit(experiments, off(seed=seed))
        assert int(found.status) == 0
        assert relative(found) < 1e-8


@pytest.mark.exhaustive
def test_unlabelled_frequencies_with_gaps_in_any_order(frequencies):
    """Columns shuffled, the lowest mode missed at one speed, no labels."""
    rng = np.random.default_rng(5)
    planar = jb.Hybrid(0, 6, 0)
    which = jb.labels(in_plane=5)
    truth = {"in_plane": 2.0, "hub": 0.3, "tip": 0.4}

    def experiments(measured, labels):
        def build(in_plane, hub, tip):
            rotor = rotor_of(in_plane, 1.0, 3e4, 1.1, hub, tip)
            return jb.FrequencyData(planar, rotor, SPEEDS, measured, 0.05, labels, among=None)

        return build

    exact = np.asarray(experiments(np.ones((4, 5)), which)(**truth).predicted())
    seen = exact[:, [0, 2, 3]].copy()  # the second was never seen
    seen[1, 0] = np.nan
    shuffled = np.stack([rng.permutation(row) for row in seen])
    found = jb.fit(experiments(shuffled, None), off(0.2, 1, truth))
    assert int(found.status) == 0
    assert relative(found, truth) < 1e-8


@pytest.mark.slow
def test_columns_are_in_the_order_of_the_labels():
    seen = 3.516 * np.sqrt([[4000.0, 1000.0]])  # flap, and then in plane

    def measured(in_plane, flap):
        rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e6, in_plane, flap))
        which = jb.labels(flap=1, in_plane=1)
        return jb.FrequencyData(jb.Hybrid(0, 2, 2), rotor, [0.0], seen, 0.01, which)

    guesses = {"in_plane": jb.FreeParameter(2000.0), "flap": jb.FreeParameter(2500.0)}
    found = jb.fit(measured, guesses).parameters
    np.testing.assert_allclose([found["in_plane"], found["flap"]], [1000.0, 4000.0], rtol=0.01)


OMEGA, TIMES = 1.5, np.linspace(0.0, 4.0, 101)
HISTORY_TRUTH = {
    "in_plane": 2.0, "mass": 1.1, "hub": 0.3, "tip": 0.4, "decay": 0.3, "viscosity": 2e-3,
}  # fmt: skip


def tip_and_torque(run):
    return jnp.stack([run.tip[:, 1], run.hub_torque[:, 2]], 1)


def spun_up(measured, noise):
    """Tip deflection and torque of the hub in a spin-up with a force that plucks the tip, so
    briefly that the second mode rings: two frequencies tell two kinds of damping apart."""

    def experiments(in_plane, mass, hub, tip, decay, viscosity):
        return jb.fitting.HistoryData(
            jb.Hybrid(0, 3, 0), jb.Rotor(jb.Beam(1.0, mass, 1e5, in_plane, in_plane), hub, tip),
            jb.SmoothSpinUp(OMEGA, 1.0), TIMES, measured, noise, tip_and_torque,
            loads=jb.Loads(tip_force=pluck), damping=jb.Damping(decay, viscosity),
            stepsize_controller=diffrax.ConstantStepSize(), dt0=0.02, max_steps=256,
        )  # fmt: skip

    return experiments


def pluck(t):
    return jnp.stack([0.0 * t, 5.0 * jnp.exp(-(((t - 1.5) / 0.04) ** 2)), 0.0 * t])


@pytest.fixture(scope="module")
def history():
    blank = np.ones((len(TIMES), 2))
    return np.asarray(jax.jit(lambda: spun_up(blank, blank)(**HISTORY_TRUTH).predicted())())


def history_noise(history):
    return 0.02 * np.abs(history).max(0) * np.ones_like(history)


@pytest.mark.exhaustive
def test_histories_without_noise_give_the_parameters_back(history):
    found = jb.fit(spun_up(history, history_noise(history)), off(seed=0, truth=HISTORY_TRUTH))
    assert int(found.status) == 0
    assert relative(found, HISTORY_TRUTH) < 1e-8


DRAWS = 100


def judge(fits, truth):
    """Means within what 100 draws allow; 95 % intervals that cover so."""
    status = np.asarray(fits.status)
    assert (status == 0).all()
    values = np.stack([np.asarray(fits.parameters[name]) for name in truth], 1)
    standard_deviation = np.stack([np.asarray(fits.standard_deviation[name]) for name in truth], 1)
    interval = jax.vmap(lambda fit: fit.interval())(fits)
    exact = np.array(list(truth.values()))
    covered = np.stack(
        [
            (np.asarray(interval[name])[:, 0] < x) & (x < np.asarray(interval[name])[:, 1])
            for name, x in truth.items()
        ],
        1,
    )
    assert 0.90 <= covered.mean() <= 0.99
    assert (covered.mean(0) >= 0.88).all()
    # Correlated as they are: bias^T covariance^-1 bias is chi squared with m degrees of freedom.
    bias = values.mean(0) - exact
    spread = np.cov(values.T) / len(values)
    assert bias @ np.linalg.solve(spread, bias) < chi2.ppf(0.99, len(truth))
    # What the covariance says is what is seen.
    np.testing.assert_allclose(np.sqrt((standard_deviation**2).mean(0)), values.std(0), rtol=0.3)
    reduced_chi_squared = np.asarray(fits.reduced_chi_squared)
    assert abs(reduced_chi_squared.mean() - 1) < 4 * np.sqrt(
        2 / float(fits.degrees_of_freedom[0]) / len(reduced_chi_squared)
    )


@pytest.mark.exhaustive
def test_noisy_frequencies(frequencies):
    noise = 1e-3 * frequencies
    rng = np.random.default_rng(3)
    draws = frequencies + noise * rng.normal(size=(DRAWS, *frequencies.shape))
    fits = jax.jit(jax.vmap(lambda y: jb.fit(with_and_without(y, noise), off(0.1))))(draws)
    judge(fits, TRUTH)


@pytest.mark.exhaustive
def test_noisy_histories(history):
    noise = history_noise(history)
    rng = np.random.default_rng(4)
    draws = history + noise * rng.normal(size=(DRAWS, *history.shape))
    guess = off(0.02, truth=HISTORY_TRUTH)
    solver = LevenbergMarquardt(rtol=1e-4, atol=1e-4)  # far within the noise
    fits = optimised(jax.vmap(lambda y: jb.fit(spun_up(y, noise), guess, solver=solver)))(draws)
    judge(fits, HISTORY_TRUTH)


def at_rest(measured, noise=0.01):
    def experiments(in_plane, mass):
        rotor = jb.Rotor(jb.Beam(1.0, mass, 3e4, in_plane, 1.0))
        which = jb.labels(in_plane=2)
        return jb.FrequencyData(jb.Hybrid(0, 8, 0), rotor, [0.0], measured, noise, which)

    return experiments


AT_REST = np.sqrt(2.0 / 1.1) * np.array([[3.5160152685, 22.0344915647]])


@pytest.mark.exhaustive
def test_stiffness_and_mass_cannot_be_told_from_frequencies_at_rest():
    free = {"in_plane": jb.FreeParameter(1.5), "mass": jb.FreeParameter(1.0)}
    found = jb.fit(at_rest(AT_REST), free, throw=False)
    assert int(found.status) == jb.Status.NOT_IDENTIFIABLE
    assert np.isnan(list(found.parameters.values())).all()
    best = found.partial
    assert np.isinf(list(best.standard_deviation.values())).all()
    ratio = float(best.parameters["in_plane"] / best.parameters["mass"])
    np.testing.assert_allclose(ratio, 2.0 / 1.1, rtol=1e-6)
    np.testing.assert_allclose(np.abs(found.combinations[-1]), np.sqrt(0.5), rtol=1e-5)
    text = str(found)
    assert "the data cannot tell this combination" in text
    assert "the data cannot tell all parameters apart" in text
    # A mass that was weighed decides.
    weighed = {"in_plane": jb.FreeParameter(1.5), "mass": jb.FreeParameter(1.0, prior=(1.1, 0.011))}
    found = jb.fit(at_rest(AT_REST), weighed)
    assert int(found.status) == 0
    np.testing.assert_allclose(found.parameters["in_plane"], 2.0, rtol=1e-6)
    np.testing.assert_allclose(found.standard_deviation["in_plane"], 0.02, rtol=0.2)
    assert float(found.correlation[0, 1]) > 0.9


@pytest.mark.slow
def test_a_search_that_cannot_get_lower_has_arrived():
    """At the minimum the sum of squares is all rounding, and no step is seen to be one downhill."""
    x = np.linspace(-1.0, 2.0, 12)
    y = 0.3 + 0.7 * x + 0.1 * np.cos(9 * x)
    slope, intercept = np.polyfit(x, y, 1)
    for off, status in ((0.0, jb.Status.OK), (1e-3, jb.Status.FIT_NOT_CONVERGED)):
        free = {
            "a": jb.FreeParameter(intercept + off, -np.inf),
            "b": jb.FreeParameter(slope, -np.inf),
        }
        descent = jb.fitting.Descent(starts=1, steps=1, starts_within=0.0)
        found = jb.fit(line(x, y, 0.01), free, max_steps=1, descent=descent, throw=False)
        assert found.status == status


FREE_LINE = {"a": jb.FreeParameter(0.5, -np.inf), "b": jb.FreeParameter(0.5, -np.inf)}


@pytest.mark.parametrize("known_noise", [True, False])
def test_a_straight_line(known_noise):
    """Against the closed form, with a number missing."""
    rng = np.random.default_rng(0)
    x = np.linspace(-1.0, 2.0, 12)
    y = 0.7 - 1.3 * x + 0.1 * rng.normal(size=12)
    y[4] = np.nan
    here = np.isfinite(y)
    design = np.stack([np.ones(12), x], 1)[here]
    wanted, (rest,), *_ = np.linalg.lstsq(design, y[here])
    found = jb.fit(line(x, y, 0.2), FREE_LINE, known_noise=known_noise)
    assert int(found.degrees_of_freedom) == 9
    assert {name: int(side) for name, side in found.at_bound.items()} == {"a": 0, "b": 0}
    level = 0.2 if known_noise else np.sqrt(rest / 9)
    covariance = level**2 * np.linalg.inv(design.T @ design)
    np.testing.assert_allclose([found.parameters["a"], found.parameters["b"]], wanted, rtol=1e-8)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-8)
    np.testing.assert_allclose(found.reduced_chi_squared, rest / 0.04 / 9, rtol=1e-10)
    width = 1.959963984540054 if known_noise else t.ppf(0.975, 9)
    low, high = found.interval()["b"]
    np.testing.assert_allclose(high - low, 2 * width * np.sqrt(covariance[1, 1]), rtol=1e-8)
    value, standard_deviation = found.predict(lambda a, b: a + b * jnp.asarray([0.0, 3.0]))
    at = np.array([[1.0, 0.0], [1.0, 3.0]])
    np.testing.assert_allclose(value, at @ wanted, rtol=1e-8)
    np.testing.assert_allclose(
        standard_deviation, np.sqrt(np.diag(at @ covariance @ at.T)), rtol=1e-8
    )


def test_residuals_are_plotted():
    x = np.linspace(0.0, 1.0, 20)
    y = 1.0 + x
    y[3:5] = np.nan
    axes = Figure().subplots()
    one = line(x, y + 0.1 * np.sin(9 * x), 0.1)
    plot.residuals(jb.fit(lambda a, b: [one(a, b), one(a, b)], FREE_LINE), axes)
    drawn = [curve.get_xydata() for curve in axes.lines if len(curve.get_xdata()) == 20]
    assert [np.isfinite(points[:, 1]).sum() for points in drawn] == [18, 18]
    assert [points[0, 0] for points in drawn] == [0.0, 20.0]
    assert axes.get_ylabel() == "residual / noise (-)"


def test_residuals_larger_than_the_noise_are_reported():
    x = np.linspace(0.0, 1.0, 20)
    found = jb.fit(line(x, np.exp(2 * x), 0.01), FREE_LINE, descent=jb.fitting.Descent(steps=5))
    assert found.excess() > 5
    assert "residuals are larger than the noise explains" in str(found)


@pytest.mark.slow
@pytest.mark.parametrize("truth", [0.0, -0.01])
def test_a_parameter_at_its_bound_is_held_there_and_known(truth):
    """An intercept at or below its bound: the data tell it as well as anywhere else."""
    x = np.linspace(0.0, 1.0, 20)
    found = jb.fit(
        line(x, truth + 2 * x, 1e-3),
        {"a": jb.FreeParameter(0.5), "b": jb.FreeParameter(1.0)},
        progress=0,
    )
    assert int(found.status) == 0
    assert bool(found.at_bound["a"])
    assert not bool(found.at_bound["b"])
    assert "held by a bound: a" in str(found)
    design = np.stack([np.ones(20), x], 1)
    wanted = 1e-3 * np.sqrt(np.linalg.inv(design.T @ design)[0, 0])
    np.testing.assert_allclose(found.standard_deviation["a"], wanted, rtol=1e-6)
    low, high = found.interval()["a"]
    assert low == 0.0
    assert 1.95 * wanted < high < 2.06 * wanted


@pytest.mark.exhaustive
def test_a_bound_does_not_end_the_search_for_others():
    """Steps that are too few are, whatever a bound holds: exp(b) = 1 is far from b = 20."""

    class Apart(jb.fitting.Experiment):
        a: jax.Array
        b: jax.Array
        measured: jax.Array
        noise: jax.Array

        def predicted(self):
            return jnp.stack([self.a, jnp.exp(self.b), jnp.exp(self.b)])

    @jax.jit
    @jax.vmap
    def found(guess):
        free = {"a": jb.FreeParameter(1.0), "b": jb.FreeParameter(guess, -np.inf)}
        data = jnp.array([-5.0, 1.0, 1.0]), jnp.array([1e-3, 1e-2, 1e-2])
        return jb.fit(lambda a, b: Apart(a, b, *data), free, max_steps=6, throw=False)

    many = found(jnp.array([20.0, 0.3]))
    assert many.status.tolist() == [jb.Status.FIT_NOT_CONVERGED, jb.Status.OK]
    assert many.at_bound["a"].tolist() == [-1, -1]
    assert many.partial.parameters["b"][0] > 1
    np.testing.assert_allclose(many.parameters["b"][1], 0.0, atol=1e-6)


PLAIN = jb.FreeParameter(1.0)
HELD = {  # what is free, and on which side it should be held
    "upper": ({"a": jb.FreeParameter(0.3, 0.0, 0.5), "b": PLAIN}, {"a": 1}),
    "lower": ({"a": jb.FreeParameter(1.5, 1.2), "b": PLAIN}, {"a": -1}),
    "upper alone": ({"a": jb.FreeParameter(0.3, -np.inf, 0.5), "b": PLAIN}, {"a": 1}),
    "guess near it": ({"a": jb.FreeParameter(0.4999999, 0.0, 0.5), "b": PLAIN}, {"a": 1}),
    "slope": ({"a": jb.FreeParameter(0.3), "b": jb.FreeParameter(3.0, 2.5, 9.0)}, {"b": -1}),
    "both": (
        {"a": jb.FreeParameter(0.3, 0.0, 0.5), "b": jb.FreeParameter(1.0, 0.0, 1.5)},
        {"a": 1, "b": 1},
    ),
    "none": ({"a": jb.FreeParameter(0.3, 0.0, 9.0), "b": PLAIN}, {}),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("noise", [1e-1, 1e-3, 1e-5])
@pytest.mark.parametrize("which", HELD)
def test_bounds_that_exclude_the_truth_are_told_by_name_and_side(which, noise):
    """What is free, and its deviation, are those of least squares with the rest known."""
    x = np.linspace(0.0, 1.0, 6)
    y = 1 + 2 * x + noise * np.random.default_rng(0).normal(size=6)
    free, sides = HELD[which]
    found = jb.fit(line(x, y, noise), free, progress=0)
    assert {name: int(side) for name, side in found.at_bound.items() if side} == sides
    values = {n: free[n].lower if side < 0 else free[n].upper for n, side in sides.items()}
    design = {"a": np.ones(6), "b": x}
    names = [n for n in free if n not in sides]
    left = y - sum(values[n] * design[n] for n in sides)
    if names:
        matrix = np.stack([design[n] for n in names], 1)
        best = dict(zip(names, np.linalg.lstsq(matrix, left, rcond=None)[0], strict=True))
        deviations = noise * np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
        for n, deviation in zip(names, deviations, strict=True):
            np.testing.assert_allclose(found.standard_deviation[n], deviation, rtol=1e-6)
            assert abs(found.parameters[n] - best[n]) < 1e-3 * deviation
    for n in sides:
        np.testing.assert_allclose(found.parameters[n], values[n], rtol=1e-14)
        assert f"{n} ({'lower' if sides[n] < 0 else 'upper'})" in str(found)
    assert (found.excess() > 5) == bool(sides) or noise == 1e-1
    assert "cannot tell" not in str(found)


@pytest.mark.exhaustive
def test_one_that_is_held_leaves_neighbours_alone():
    """In a batch, whose data lie on both sides of a bound; what they cannot tell is not held."""
    x = np.linspace(0.0, 1.0, 6)
    free = {"a": jb.FreeParameter(0.3, 0.0, 0.5), "b": jb.FreeParameter(1.0)}

    @jax.jit
    @jax.vmap
    def found(y, x):
        return jb.fit(line(x, y, 1e-2), free, throw=False)

    ys = jnp.stack([1.0 + 2 * x, 0.25 + 2 * x, 0.25 + 2 * np.ones(6)])
    many = found(ys, jnp.stack([x, x, np.ones(6)]))
    assert many.status.tolist() == [0, 0, jb.Status.NOT_IDENTIFIABLE]
    assert many.at_bound["a"].tolist()[:2] == [1, 0]
    assert many.at_bound["b"].tolist()[:2] == [0, 0]
    np.testing.assert_allclose(many.parameters["a"], [0.5, 0.25, np.nan], rtol=1e-6)
    best = np.sum((1.0 + 2 * x - 0.5) * x) / np.sum(x**2)
    np.testing.assert_allclose(many.parameters["b"], [best, 2.0, np.nan], rtol=1e-6)


@pytest.mark.slow
def test_a_parameter_at_its_upper_bound_near_the_guess_is_known():
    """The room that the search had is no measure of what the data tell."""
    x = np.linspace(0.0, 1.0, 20)
    free = {"a": jb.FreeParameter(0.5, upper=0.53), "b": jb.FreeParameter(1.0)}
    found = jb.fit(line(x, 0.6 + 2 * x, 1e-2), free, progress=0)
    assert bool(found.at_bound["a"])
    design = np.stack([np.ones(20), x], 1)
    wanted = 1e-2 * np.sqrt(np.linalg.inv(design.T @ design)[0, 0])
    np.testing.assert_allclose(found.standard_deviation["a"], wanted, rtol=1e-6)
    assert "cannot tell" not in str(found)


@pytest.mark.slow
@pytest.mark.parametrize("guess", [0.0, 1e-3, 1e3])
def test_whether_data_tell_a_parameter_does_not_depend_on_units(guess):
    x = np.linspace(-1.0, 1.0, 20)
    free = {name: jb.FreeParameter(guess, -np.inf) for name in "ab"}
    sure = jb.fit(line(x, 1e6 + 1e6 * x, 10.0), free)
    assert int(sure.status) == 0
    free = {name: jb.FreeParameter(1e-3, -np.inf) for name in "ab"}
    unsure = jb.fit(line(x, 1e-3 + 1e-3 * x, 10.0), free, throw=False)
    assert int(unsure.status) == jb.Status.NOT_IDENTIFIABLE


@pytest.mark.slow
def test_too_little_data_in_a_batch_is_reported_case_by_case():
    x = np.linspace(0.0, 1.0, 3)

    def one(y, known_noise):
        return jb.fit(line(x, y, 0.1), FREE_LINE, known_noise=known_noise, throw=False)

    y = jnp.array([[1.0, 2.1, 3.0], [1.0, np.nan, 2.0], [1.0, np.nan, np.nan]])
    for known_noise, wanted in ((True, [0, 0, 31]), (False, [0, 31, 31])):
        found = jax.jit(jax.vmap(lambda y, known=known_noise: one(y, known)))(y)
        assert found.status.tolist() == wanted
        assert np.isinf(found.partial.standard_deviation["b"][-1])
        assert np.isnan(found.standard_deviation["b"][-1])
    few = jax.jit(lambda y: jb.fit(line(x[:1], y), FREE_LINE, throw=False))(y[0, :1])
    assert int(few.status) == jb.Status.NOT_IDENTIFIABLE
    assert few.certainty.shape == (2,)


def test_a_fit_that_failed_is_raised():
    """Also in a compiled batch. All is measured at one place, which does not tell a slope."""
    y = jnp.array([[1.0, 1.1], [1.2, 1.3]])

    def one(y):
        return jb.fit(line(np.zeros(2), y, 0.1), FREE_LINE)

    for found in (lambda: one(y[0]), lambda: jax.jit(jax.vmap(one))(y)):
        with pytest.raises(RuntimeError, match="the data cannot tell all parameters apart"):
            jax.block_until_ready(found().reduced_chi_squared)


def test_guesses_in_a_batch():
    x = np.linspace(0.0, 1.0, 5)
    experiment = line(x, 1.0 + 2 * x)
    found = jax.vmap(
        lambda g: jb.fit(experiment, {"a": jb.FreeParameter(g), "b": jb.FreeParameter(g)})
    )(jnp.array([0.5, 5.0]))
    np.testing.assert_allclose(found.parameters["b"], [2.0, 2.0], rtol=1e-8)


def clearance(hub=0.1, **changes):
    given = {"angular_speed": [0.4, 0.5], "which": jb.labels(flap=1), "harmonics": [1, 8]} | changes
    return jb.fitting.ResonanceMargin(jb.Hybrid(0, 1, 6), slender(hub=hub), margin=0.1, **given)


@pytest.mark.slow
def test_clearance_is_what_is_missing():
    """Flap 1 at 3.54 and 3.55 rad/s: 8 per revolution is 3.2 and 4.0, crossed."""
    demand = clearance()
    frequency = [float(jb.modes(demand.model, demand.rotor, w, 1).frequency[0]) for w in (0.4, 0.5)]
    distance = np.array([[f / (k * w) - 1 for f, w in zip(frequency, (0.4, 0.5), strict=True)]
                         for k in (1, 8)])  # fmt: skip
    np.testing.assert_allclose(demand.distance()[0], distance, rtol=1e-9)
    assert distance[1, 0] > 0 > distance[1, 1]
    side = np.sign(np.log1p(distance[1]).mean())
    wanted = [[0.0, 0.0], np.maximum(0.1 - side * distance[1], 0.0)]
    np.testing.assert_allclose(demand.predicted()[0], wanted, rtol=1e-9)
    for changes, message in (
        ({"angular_speed": [0.0, 1.0]}, "angular_speed must be > 0"),
        ({"harmonics": [0]}, "harmonics must be integers >= 1"),
        ({"harmonics": []}, "harmonics must be integers >= 1"),
    ):
        with pytest.raises(ValueError, match=message):
            clearance(**changes)


def test_many_starts_find_what_one_does_not():
    """The frequency of a sine, from a guess in another of its valleys."""
    x = np.linspace(0.0, 10.0, 80)

    class Sine(jb.fitting.Experiment):
        omega: jax.Array
        measured: jax.Array
        noise: jax.Array

        def predicted(self):
            return jnp.sin(self.omega * x)

    def experiments(omega):
        return Sine(omega, jnp.asarray(np.sin(3.0 * x)), jnp.full(80, 0.1))

    found = jb.fit(experiments, {"omega": jb.FreeParameter(1.9)}, progress=False)
    np.testing.assert_allclose(found.parameters["omega"], 3.0, rtol=1e-8)


@pytest.mark.parametrize(
    "bounds", [(0.0, np.inf), (-np.inf, 5.0), (1.0, 4.0), (-np.inf, np.inf), (-3.0, np.inf)]
)
def test_bounds_hold_and_the_guess_is_at_zero(bounds):
    free = jb.FreeParameter(2.0, *bounds)
    np.testing.assert_allclose(free.value(jnp.asarray(0.0)), 2.0, rtol=1e-14)
    far = jnp.array([-30.0, -1.0, 0.0, 1.0, 30.0])
    values = jax.vmap(free.value)(far)
    assert (np.diff(values) > 0).all()
    assert (values >= bounds[0]).all()
    assert (values <= bounds[1]).all()


@pytest.mark.slow
def test_static_deflections_tell_stiffness():
    """w = F x^2 (3 L - x) / (6 EI), small; with gravity too."""
    xi, force, stiffness = np.array([0.3, 0.6, 1.0]), 1e-3, 2.0
    bent = force * xi**2 * (3 - xi) / (6 * stiffness)

    def experiments(in_plane):
        rotor = jb.Rotor(jb.Beam(1.0, 1.1, 3e6, in_plane, 1.0))
        return jb.fitting.StaticData(
            jb.Hybrid(0, 4, 0), rotor, jb.Loads(tip_force=[0.0, force, 0.0]), bent, 1e-7, xi
        )

    found = jb.fit(experiments, {"in_plane": jb.FreeParameter(1.0)})
    assert int(found.status) == 0
    np.testing.assert_allclose(found.parameters["in_plane"], stiffness, rtol=1e-6)
    rotor = slender(500.0)
    loads = jb.Loads(gravity=[0.0, -1e-3, 0.0])
    (sag,) = jb.fitting.StaticData(jb.papers.GreenANCF(8), rotor, loads, [1.0], 1.0).predicted()
    np.testing.assert_allclose(sag, -1e-3 / 8, rtol=1e-5)


def freq(speeds=(0.0, 1.0), measured=((3.5,), (3.6,)), noise=0.1, **kwargs):
    which = kwargs.pop("which", jb.labels(in_plane=1))
    return jb.FrequencyData(
        jb.Hybrid(0, 3, 0), slender(), list(speeds), np.array(measured), noise, which, **kwargs
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speeds": (1.0, 0.0)}, "angular_speed must increase"),
        ({"speeds": (0.0, np.nan)}, "angular_speed must be finite"),
        ({"measured": ((3.5,), (-3.6,))}, "measured frequencies must be > 0"),
        ({"measured": ((np.nan,), (np.nan,))}, "measured must hold a number at least"),
        ({"measured": ((np.inf,), (1.0,))}, "measured must be finite, or NaN where missing"),
        ({"measured": (3.5, 3.6)}, r"measured must have shape \(2, any\)"),
        ({"noise": 0.0}, "noise must be finite and > 0"),
        ({"noise": np.nan}, "noise must be finite and > 0"),
        ({"which": jb.labels(in_plane=2)}, "which must name 1 modes"),
        ({"which": 2}, "which must name 1 modes"),
        ({"which": None, "among": 7}, "among must be between 1 and 3"),
    ],
)
def test_bad_data_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        freq(**changes)


@pytest.mark.slow
def test_bad_histories_and_problems_are_named():
    def history(times, measured, **kwargs):
        return jb.fitting.HistoryData(
            jb.Hybrid(0, 1, 0), slender(), jb.ConstantSpeed(1.0), times, measured, 0.1, **kwargs
        )

    with pytest.raises(ValueError, match="times must be a list of 2 or more"):
        history([0.0], [0.0])
    with pytest.raises(ValueError, match="times must be finite and increasing"):
        history([0.0, 2.0, 1.0], [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match=r"measured must have shape \(2, \.\.\.\)"):
        history([0.0, 1.0], [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="of must give the shape"):
        history([0.0, 1.0], [0.0, 0.0], of=lambda run: run.tip).predicted()
    free = {"in_plane": jb.FreeParameter(1.5), "mass": jb.FreeParameter(1.0)}
    with pytest.raises(ValueError, match="1 numbers measured are too few for 2 parameters"):
        jb.fit(at_rest([[3.5, np.nan]]), free)
    with pytest.raises(ValueError, match="nothing tells the level of the noise"):
        jb.fit(at_rest([[3.5, 22.0]]), free, known_noise=False)
    with pytest.raises(ValueError, match="free must be a dict"):
        jb.fit(at_rest([[3.5, 22.0]]), {})
    with pytest.raises(TypeError, match=r"free\['mass'\] must be a FreeParameter"):
        jb.fit(at_rest([[3.5, 22.0]]), {"mass": 1.0})
    with pytest.raises(TypeError, match="experiments must return"):
        jb.fit(lambda a: a, {"a": jb.FreeParameter(1.0)})
    with pytest.raises(ValueError, match="guess must be finite and between"):
        jb.FreeParameter(-1.0)
    with pytest.raises(ValueError, match="prior must be a mean and a standard deviation"):
        jb.FreeParameter(1.0, prior=(1.0, 0.0))
    with pytest.raises(ValueError, match="prior must be a mean and a standard deviation"):
        jb.FreeParameter(1.0, prior=1.0)
    weighed = {"in_plane": jb.FreeParameter(1.5), "mass": jb.FreeParameter(1.0, prior=(1.0, 0.1))}
    with pytest.raises(ValueError, match="needs known_noise=True"):
        jb.fit(at_rest([[3.5, 22.0]]), weighed, known_noise=False)
    with pytest.raises(TypeError, match="descent must be a Descent"):
        jb.fit(at_rest([[3.5, 22.0]]), free, descent=16)
    with pytest.raises(ValueError, match="needs a model with flap functions"):
        jb.fitting.StaticData(
            jb.papers.GreenANCF(2), slender(), jb.Loads(), [0.0], 1.0, direction=2
        )


@pytest.mark.exhaustive
def test_one_bad_draw_spoils_no_other(frequencies):
    """A draw that no beam explains, and one of NaN, beside good ones."""
    noise = 1e-3 * frequencies

    def one(y):
        return jb.fit(with_and_without(y, noise), off(0.1), throw=False)

    draws = np.stack([frequencies, frequencies, frequencies])
    draws[1] *= np.linspace(0.2, 3.0, len(WHICH))
    draws[2] = np.nan
    fits = jax.jit(jax.vmap(one))(draws)
    np.testing.assert_allclose(
        [fits.parameters[name][0] for name in TRUTH], list(TRUTH.values()), rtol=1e-8
    )
    assert int(fits.status[0]) == 0
    assert int(fits.status[2]) == jb.Status.NOT_IDENTIFIABLE
    assert float(fits.reduced_chi_squared[1]) > 100


def test_nothing_rests_under_what_turns_in_the_hub():
    """Gravity across the axis of a hub that turns, and forces that are functions of time."""
    model, rotor = jb.Hybrid(0, 3, 3), slender()

    def data(gravity, speed, **more):
        loads = jb.Loads(gravity=gravity, **more)
        return jb.fitting.StaticData(model, rotor, loads, [0.0], 1.0, angular_speed=speed)

    with pytest.raises(ValueError, match="gravity must be along the axis of rotation"):
        data([0.0, -0.5, 0.0], 2.0)
    with pytest.raises(ValueError, match="tip_force must be constant"):
        data(None, 0.0, tip_force=lambda t: jnp.stack([0 * t, t, 0 * t]))
    assert np.isfinite(data([0.0, -0.5, 0.0], 0.0).predicted()).all()
    assert np.isfinite(data([0.0, 0.0, -9.8], 2.0).predicted()).all()
    across = jax.jit(lambda speed: data([0.0, -0.5, 0.0], speed).predicted())(2.0)
    assert np.isnan(across).all()
