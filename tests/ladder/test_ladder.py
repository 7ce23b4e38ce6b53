"""The ladder: what its rungs are, that the one chosen meets the tolerance, and what it costs."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.helpers import slender
from tests.ladder.questions import TIMES, spin_up, steady
from tests.references import power_series
from tests.tiers import slow

QUESTIONS = {
    "peak": jb.ladder.PeakDeflection(jb.SmoothSpinUp(1.0, 1.0), TIMES),
    "history": jb.ladder.DeflectionHistory(jb.SmoothSpinUp(1.0, 1.0), TIMES),
    "strain": jb.ladder.RootStrain(jb.SmoothSpinUp(1.0, 1.0), TIMES),
    "frequencies": jb.ladder.ModalFrequencies(1.0, jb.labels(in_plane=2)),
}
each = pytest.mark.parametrize("question", QUESTIONS.values(), ids=QUESTIONS)


@each
def test_rungs_come_in_order_of_cost(question):
    rungs = jb.ladder.rungs(slender(), question)
    costs = [rung.cost for rung in rungs]
    assert costs == sorted(costs)
    assert costs[0] == 1.0
    names = [rung.name for rung in rungs]
    assert len(set(names)) == len(names)

    def at(name):
        (place,) = [i for i, n in enumerate(names) if n == name]
        return place

    few = "2 modes" if question is QUESTIONS["frequencies"] else "1 mode"
    order = [f"hybrid, {few}", "hybrid, 4 functions", "hybrid, 4 functions, stretch 4"]
    for rich in ("von Karman, 4 functions, stretch 9", "16 elements"):
        places = [at(name) for name in (*order, rich, "32 elements", "64 elements")]
        assert places == sorted(places)
    assert at(f"classical, {few}") < at(f"hybrid, {few}")


@each
def test_nothing_out_of_the_plane_where_all_stays_in_it(question):
    for rung in jb.ladder.rungs(slender(), question):
        assert jb.models.Direction.FLAP not in rung.model.directions


INCLINED = jb.ladder.PeakDeflection(jb.SmoothSpinUp(1.0, 1.0, jb.motions.inclined_axis(0.7)), TIMES)
GRAVITY = jb.Loads(gravity=[0.0, 0.0, -9.8])


@pytest.mark.parametrize(
    "question",
    [
        INCLINED,
        jb.ladder.RootStrain(jb.SmoothSpinUp(1.0, 1.0), TIMES, loads=GRAVITY),
        jb.ladder.ModalFrequencies(1.0, jb.labels(flap=1)),
    ],
)
def test_what_leaves_the_plane_gets_models_that_do(question):
    rungs = jb.ladder.rungs(slender(), question)
    assert all(jb.models.Direction.FLAP in rung.model.directions for rung in rungs)
    assert isinstance(rungs[-1].model, jb.VonKarman)


@pytest.mark.parametrize("spread", [0.3, 1.3, 2.6, 7.7])
def test_spectrum_of_a_spin_up(spread):
    """Y eq. 23 has the angular acceleration (Omega / T) (1 - cos 2 pi t / T), with the spectrum
    sin(a) / a / (1 - (a / pi)^2), a = omega T / 2, over its value at zero."""
    omega = np.array(power_series.frequencies(0.0))
    duration = 2 * spread / omega[0]
    question = jb.ladder.PeakDeflection(
        jb.SmoothSpinUp(3.0, duration), [0.0, 0.5 * duration, duration]
    )
    a = omega * duration / 2
    wanted = np.abs(np.sinc(a / np.pi) / (1 - (a / np.pi) ** 2)) * (omega[0] / omega) ** 3
    np.testing.assert_allclose(question.excited(jnp.asarray(omega)), wanted, atol=2e-4)


CASES = [(0.05, 0.0, 0.0, 1e-3), (2.0, 0.5, 0.0, 1e-2), slow(6.0, 0.0, 0.5, 1e-3)]


@pytest.mark.exhaustive
@pytest.mark.parametrize(("gamma", "hub", "tip", "tolerance"), CASES)
def test_frequencies_against_power_series(gamma, hub, tip, tolerance):
    """Strains are small, so that linear stretch is right as well."""
    rotor = slender(1000.0, hub, tip)
    choice = jb.choose_model(
        rotor, jb.ladder.ModalFrequencies(gamma, jb.labels(in_plane=2)), tolerance
    )
    exact = np.array(power_series.frequencies(gamma, hub, tip, 1000.0, count=2))
    error = np.max(np.abs(choice.answer / exact - 1))
    assert choice.met
    assert error <= choice.estimate <= tolerance
    # The verdicts say what is so.
    for _, estimate, verdict in choice.evidence:
        if verdict.startswith("meets it"):
            assert estimate <= tolerance
        if verdict == "misses it":
            assert estimate > tolerance
    assert isinstance(choice.model, jb.Classical) == (gamma < 0.1)
    if gamma > 1:
        assert "ruled out: stiffening ratio" in str(choice)
    assert choice.rung.name in str(choice).splitlines()[-1]


@pytest.mark.exhaustive
def test_no_rung_meets_what_is_asked():
    """Out of the plane, strains of a hundredth are more than von Karman beams bear."""
    question = jb.ladder.ModalFrequencies(5.0, jb.labels(in_plane=1, flap=1))
    choice = jb.choose_model(slender(30.0), question, 1e-3, throw=False)
    assert choice.status == jb.Status.TOLERANCE_NOT_MET
    assert not choice.met
    assert np.isnan(choice.answer).all()
    assert np.isfinite(choice.partial).all()
    assert 1e-3 < choice.estimate < 1
    assert choice.estimate == min(e.estimate for e in choice.evidence if e.estimate > 0)
    last = str(choice).splitlines()[-1]
    assert last.startswith(f"no rung was found to meet 0.001; the best, {choice.rung.name}")


def test_errors():
    rotor, question = slender(), QUESTIONS["frequencies"]
    for tolerance in (0.0, -1.0, 1.0, float("nan")):
        with pytest.raises(ValueError, match="tolerance must be between"):
            jb.choose_model(rotor, question, tolerance)
    with pytest.raises(TypeError, match="tolerance must be a number"):
        jb.choose_model(rotor, question, "fine")
    with pytest.raises(TypeError, match="question must be a Question"):
        jb.choose_model(rotor, jb.SmoothSpinUp(1.0, 1.0))
    with pytest.raises(TypeError, match="rotor must be a Rotor"):
        jb.choose_model(rotor.beam, question)
    with pytest.raises(ValueError, match="times must"):
        jb.ladder.PeakDeflection(jb.ConstantSpeed(1.0), [1.0])
    with pytest.raises(ValueError, match="must be labels"):
        jb.ladder.ModalFrequencies(1.0, ["flap 1"])
    for label in (
        jb.models.Label(jb.models.Direction.FLAP, 9),
        jb.models.Label(jb.models.Direction.FLAP, 0),
        *jb.labels(axial=1),
    ):
        with pytest.raises(ValueError, match="which: bending or torsion of number 1 to 8"):
            jb.ladder.ModalFrequencies(1.0, label)
    with pytest.raises(TypeError, match="question must be a Question"):
        jb.ladder.rungs(rotor, rotor)
    with pytest.raises(ValueError, match="accuracy must be finite and > 0"):
        jb.ladder.evaluate(jb.Hybrid(), rotor, question, 0.0)
    with pytest.raises(ValueError, match="direction must be 0"):
        jb.ladder.PeakDeflection(jb.ConstantSpeed(1.0), TIMES, direction=3)
    cases = jb.points(speed=[1.0])
    with pytest.raises(TypeError, match="situation must return a Rotor and a Question"):
        jb.ladder_sweep(lambda speed: speed, cases)
    with pytest.raises(ValueError, match="tolerance must be between"):
        jb.ladder_sweep(lambda speed: (rotor, question), cases, 0.0)
    with pytest.raises(ValueError, match="representatives must be >= 2"):
        jb.ladder_sweep(lambda speed: (rotor, question), cases, representatives=1)
    with pytest.raises(ValueError, match="chunk must be >= 1"):
        jb.ladder_sweep(lambda speed: (rotor, question), cases, chunk=0)


def test_distance_of_answers():
    zero, ok, bad = jnp.zeros(()), jnp.asarray(jb.Status.OK), jnp.asarray(jb.Status.DIVERGED)

    def answer(value, status=ok):
        return jb.ladder.Answer(
            jnp.asarray(value), jnp.asarray([4.0, 2.0]), zero, zero, zero, status
        )

    assert float(answer([4.0, 1.0]).distance(answer([4.0, 2.0]))) == 0.5
    assert float(answer([5.0, 2.0]).distance(answer([4.0, 2.0]))) == 0.25
    assert float(answer([4.0, 2.0], bad).distance(answer([4.0, 2.0]))) == np.inf
    assert float(answer([4.0, 2.0]).distance(answer([4.0, 2.0], bad))) == np.inf
    assert float(answer([np.nan, 2.0]).distance(answer([4.0, 2.0]))) == np.inf
    none = jb.ladder.Answer(jnp.zeros(2), jnp.zeros(2), zero, zero, zero, ok)
    assert float(none.distance(none)) == 0.0
    assert float(answer([4.0, 2.0]).distance(none)) == np.inf


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [slow(jb.Hybrid(0, 2, 0)), jb.Hybrid(4, 2, 0), jb.PlanarRod(4)])
def test_strain_at_the_root_of_a_slow_spin_up(model):
    """At its end P(0) / EA, by dynamics of stretch or quasi-statically."""
    rotor = slender(300.0, 0.5, 0.3)
    question = jb.ladder.RootStrain(jb.SmoothSpinUp(1.5, 40.0), np.linspace(0.0, 45.0, 31))
    found = jb.ladder.evaluate(model, rotor, question, 1e-6)
    c0, c1, c2 = rotor.tension(jnp.asarray(1.5))
    wanted = float((c0 + c1 + c2 / 2) / rotor.beam.axial_stiffness)
    assert int(found.status) == 0
    np.testing.assert_allclose(found.value[-1], wanted, rtol=2e-3)


def sweep_of(tolerance, **columns):
    return jb.ladder_sweep(spin_up, jb.points(**columns), tolerance, representatives=8)


@pytest.mark.exhaustive
def test_sweep_holds_its_tolerance_and_bad_cases_stay_alone():
    """Against 16 elements, integrated tightly."""
    rng = np.random.default_rng(11)
    n, tolerance = 16, 1e-3
    columns = {
        "speed": np.exp(rng.uniform(np.log(0.05), np.log(4.0), n)),
        "duration": np.exp(rng.uniform(np.log(1.0), np.log(8.0), n)),
        "hub": rng.uniform(0.0, 1.0, n),
    }
    bad = {3: ("speed", np.nan), 8: ("hub", np.nan), 14: ("duration", 0.0)}
    for i, (name, value) in bad.items():
        columns[name][i] = value
    table = sweep_of(tolerance, **columns)
    wanted = {3: "INVALID_MOTION", 8: "INVALID_HUB_RADIUS", 14: "INVALID_MOTION"}
    for i, name in wanted.items():
        assert jb.Status(int(table["status"][i])).name == name
        assert np.isnan(table["value"][i]).all()

    def truth(speed, duration, hub):
        rotor, question = spin_up(speed, duration, hub)
        found = question.answer(jb.PlanarRod(16), rotor, jnp.asarray(1e-6), jnp.asarray(1e-3))
        return {"value": found.value[0], "size": found.size, "status": found.status}

    exact = jb.sweep(truth, jb.points(**columns), chunk=8, progress=False)
    fine = np.flatnonzero(exact["status"] == 0)
    assert len(fine) >= n - 5
    error = np.abs(table["value"][fine, 0] / exact["value"][fine] - 1)
    said = table["status"][fine] == 0
    assert said.mean() > 0.9
    assert (error[said] <= tolerance).all()
    assert (error[said] <= table["estimate"][fine][said]).all()
    # Linear theory where deflections are small, elements where they are not.
    rung = np.array([name.split(",")[0] for name in table["rung"][fine]])
    assert (rung[exact["size"][fine] > 0.2] != "hybrid").all()
    assert (rung[exact["size"][fine] < 1e-3] == "hybrid").all()


@pytest.mark.exhaustive
def test_sweep_of_frequencies_on_a_grid():
    """Against power series; a case that raises, and one out of range, touch no other."""
    speeds, hubs, tolerance = [0.5, 2.0, 5.0, 1000.0, 8.0], [0.0, 1.0, np.nan], 1e-2
    table = jb.ladder_sweep(
        steady, jb.grid(gamma=speeds, hub=hubs), tolerance, representatives=4, chunk=4
    )
    assert table["value"].shape == (5, 3, 2)
    for i, gamma in enumerate(speeds):
        for j, hub in enumerate(hubs):
            status = jb.Status(int(table["status"][i, j]))
            if gamma > 100:
                assert status == jb.Status.RAISED
                assert "too fast" in table.message(gamma=gamma, hub=hub)
            elif np.isnan(hub):
                assert status == jb.Status.INVALID_HUB_RADIUS
            else:
                exact = np.array(power_series.frequencies(gamma, hub, 0.0, 1000.0, count=2))
                error = np.max(np.abs(table["value"][i, j] / exact - 1))
                assert status == jb.Status.OK
                assert error <= table["estimate"][i, j] <= tolerance
                assert table["rung"][i, j] != ""


@pytest.mark.slow
def test_sweep_where_no_case_is_in_range():
    table = jb.ladder_sweep(steady, jb.points(gamma=[1.0, np.nan], hub=[np.inf, 0.0]), chunk=2)
    assert [jb.Status(int(s)).name for s in table["status"]] == [
        "INVALID_HUB_RADIUS", "INVALID_ANGULAR_SPEED",
    ]  # fmt: skip
    assert np.isnan(table["value"]).all()
    assert np.isinf(table["estimate"]).all()


@pytest.mark.exhaustive
def test_space_where_von_karman_is_all_there_is():
    """A wide swing about an inclined axis: nothing here is right to 1e-3, and the ladder says so.
    A narrow one is answered."""
    rotor = slender(200.0)

    def asked(speed):
        motion = jb.SmoothSpinUp(speed, 2.0, jb.motions.inclined_axis(0.8))
        return jb.ladder.PeakDeflection(motion, TIMES * 3.0, direction=2)

    wide = jb.choose_model(rotor, asked(3.0), 1e-3, throw=False)
    assert not wide.met
    assert float(wide.indicators.size) > 0.05
    narrow = jb.choose_model(rotor, asked(0.02), 1e-2)
    assert narrow.met
    assert jb.models.Direction.FLAP in narrow.model.directions
