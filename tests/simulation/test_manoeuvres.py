"""What the two papers say of their manoeuvres, and convergence to an independent solution."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

import jaxbeam as jb
from tests.beams import ABRUPT, ALUMINIUM, ALUMINIUM_SECTION, PAPER_SPRINGS, SMOOTH, SPATIAL
from tests.references import elastica

ROTOR = jb.Rotor(ALUMINIUM)


@pytest.mark.exhaustive
def test_discrete_models():
    """Y Figs. 12-14. NC and NP agree; LC is wrong yet plausible at 10 rad/s and unbounded at 20; LP
    stays within 2 %; NS is no better than LP."""
    times = np.linspace(0.0, 2.0, 201)
    tight = diffrax.PIDController(rtol=1e-11, atol=1e-13)
    y, status = {}, {}
    for name in ("NC", "NP", "LC", "LP", "NS"):
        model = getattr(jb.papers, f"Discrete{name}")()
        for speed in (10, 20):
            for law in (jb.SmoothSpinUp, jb.motions.QuinticSpinUp):
                run = jb.simulate(
                    model, PAPER_SPRINGS, law(float(speed), 1.0), times, stepsize_controller=tight,
                    throw=False,
                )  # fmt: skip
                y[name, speed, law], status[name, speed] = (
                    np.asarray(run.tip[:, 1]),
                    int(run.status),
                )

    def gap(name, speed, law=jb.SmoothSpinUp):
        exact = y["NC", speed, law]
        return np.abs(y[name, speed, law] - exact).max() / np.abs(exact).max()

    assert status.pop(("LC", 20)) == jb.Status.DIVERGED
    assert set(status.values()) == {jb.Status.OK}
    assert 0.2 < gap("LC", 10) < 1
    for speed in (10, 20):
        assert gap("NP", speed) < 1e-9
        assert gap("NP", speed, jb.motions.QuinticSpinUp) < 1e-9
        assert gap("LP", speed) < 0.02
        assert 3 < gap("NS", speed) / gap("LP", speed) < 5


@pytest.mark.slow
def test_smooth_spin_up():
    """Y Fig. 6: the classical theory diverges, the hybrid one does not and comes back to zero."""
    motion, times = jb.SmoothSpinUp(6.0, 120.0), np.linspace(0.0, 150.0, 301)
    hybrid = jb.simulate(jb.Hybrid(3, 4, 0), SMOOTH, motion, times)
    classical = jb.simulate(jb.Classical(3, 4, 0), SMOOTH, motion, times, throw=False)
    elements = jb.simulate(jb.papers.GreenANCF(8), SMOOTH, motion, times)
    np.testing.assert_allclose(hybrid.tip[:, 1], elements.tip[:, 1], atol=2e-5)
    assert np.abs(hybrid.tip[times > 121, 1]).max() < 1e-3 * abs(float(hybrid.peak()[0]))
    assert int(classical.status) == jb.Status.DIVERGED
    # it goes wrong, within a few periods, where the speed passes the first rest frequency
    rest = 3.5160153 * float(SMOOTH.beam.frequency_scale)
    turn = 2 * np.pi * times / 120.0
    passed = times[np.argmax(6.0 * (turn - np.sin(turn)) / (2 * np.pi) > rest)]
    assert passed < float(classical.end_time) < passed + 3 * 2 * np.pi / rest
    early = times < passed / 2
    np.testing.assert_allclose(classical.tip[early, 1], hybrid.tip[early, 1], atol=0.1)


@pytest.mark.exhaustive
def test_explicit_steps_at_loose_tolerance_fail_and_say_so():
    """Each step passes the solver's own test, and energy appears: the tip ends metres away."""
    case = jb.papers.GreenANCF(2), ROTOR, jb.SmoothSpinUp(4.0, 15.0), [0.0, 8.0]
    good = jb.simulate(*case)
    run = jb.simulate(
        *case, solver=diffrax.Tsit5(), max_steps=10**6, throw=False,
        stepsize_controller=diffrax.PIDController(rtol=1e-3, atol=1e-3),
    )  # fmt: skip
    assert run.solution.result == diffrax.RESULTS.successful
    assert np.abs(run.partial.tip[-1] - good.tip[-1]).max() > 1.0
    assert int(run.status) == jb.Status.UNBALANCED
    assert int(good.status) == jb.Status.OK


@pytest.mark.exhaustive
def test_mass_damping_is_the_same_in_all_coordinates():
    """Drag on velocities relative to the hub: NC and NP are one system, damped or not."""
    tips = [
        jb.simulate(
            model, PAPER_SPRINGS, jb.SmoothSpinUp(10.0, 1.0), [0.0, 0.5, 1.0, 2.0],
            damping=jb.Damping(mass_coefficient=0.7),
            stepsize_controller=diffrax.PIDController(rtol=1e-11, atol=1e-13),
        ).tip
        for model in (jb.papers.DiscreteNC(), jb.papers.DiscreteNP())
    ]  # fmt: skip
    np.testing.assert_allclose(*tips, rtol=1e-9, atol=1e-10)


@pytest.mark.exhaustive
def test_abrupt_spin_up():
    """Y Fig. 4: foreshortening shows in u1 of the hybrid model, not of the classical one; at three
    quarters of the length the hybrid model is some 20 % off."""
    motion, times = jb.motions.QuinticSpinUp(0.31, 1.0), np.linspace(0.0, 10.0, 201)
    runs = {
        "hybrid": jb.simulate(jb.Hybrid(3, 4, 0), ABRUPT, motion, times),
        "classical": jb.simulate(jb.Classical(3, 4, 0), ABRUPT, motion, times, throw=False),
        "exact": jb.simulate(jb.papers.GreenANCF(16), ABRUPT, motion, times),
    }
    peak = {name: abs(float(run.peak()[0])) for name, run in runs.items()}
    assert 0.6 < peak["exact"] / 30.5 < 0.85
    assert 0.15 < peak["hybrid"] / peak["exact"] - 1 < 0.3
    assert np.min(runs["hybrid"].tip[:, 0]) < -5
    assert np.abs(runs["classical"].tip[:, 0]).max() < 0.5


@pytest.mark.exhaustive
def test_spatial_spin_up():
    """Y Fig. 8: the outward deflection u2 settles away from zero, u3 swings about zero."""
    motion, times = (
        jb.SmoothSpinUp(3.0, 1.5, jb.motions.inclined_axis(np.pi / 3)),
        np.linspace(0, 15.0, 301),
    )
    for model in (jb.Hybrid(3, 4, 4), jb.VonKarman(8, 4, 4)):
        tip = np.asarray(jb.simulate(model, SPATIAL, motion, times).tip)
        late = times > 2
        middle = tip[late].mean(0)
        steady = jb.steady_start(model, SPATIAL, motion, 2.0)
        rest = jnp.tensordot(model.displacement(np.ones(1), SPATIAL), steady.q, 1)[:, 0]
        assert middle[1] < -0.1 or middle[1] > 0.1
        np.testing.assert_allclose(middle[1], rest[1], rtol=0.1)
        assert abs(middle[2]) < 0.1 * np.abs(tip[late, 2]).max()
        assert abs(float(rest[2])) < 1e-9


TIMES = np.linspace(0.0, 20.0, 401)
TIGHT = diffrax.PIDController(rtol=1e-8, atol=1e-9)
LENGTH, MODULUS, DENSITY, AREA, SECOND_MOMENT = ALUMINIUM_SECTION.values()
EXACT = elastica.Beam(LENGTH, DENSITY * AREA, MODULUS * AREA, MODULUS * SECOND_MOMENT)


@pytest.fixture(scope="module")
def exact():
    """Tip of the geometrically exact beam on B Ref. 21, at 2 and 4 rad/s."""
    return {
        speed: elastica.tip_history(
            EXACT, jb.SmoothSpinUp(speed, 15.0).angular_speed, TIMES, rtol=1e-9
        )
        for speed in (2.0, 4.0)
    }


def deviation(model, speed, exact):
    """Largest distance of the tip over the run, and error of the peak, over the peak."""
    run = jb.simulate(
        model, ROTOR, jb.SmoothSpinUp(speed, 15.0), TIMES, stepsize_controller=TIGHT
    )  # fmt: skip
    spline = CubicSpline(TIMES, exact[speed][:, 1])
    turns = spline.derivative().roots(extrapolate=False)
    peak = np.abs(spline(turns)).max()
    distance = np.abs(run.tip - np.pad(exact[speed], ((0, 0), (0, 1)))).max()
    return distance / peak, abs(abs(float(run.peak()[0])) / peak - 1)


@pytest.mark.exhaustive
def test_reference_is_converged(exact):
    """Two functions more for the angle, one for the strain."""
    speed = jb.SmoothSpinUp(4.0, 15.0).angular_speed
    more = elastica.tip_history(EXACT, speed, TIMES, n_angle=9, n_strain=4, rtol=1e-9)
    np.testing.assert_allclose(exact[4.0], more, atol=1e-8)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("theory", "counts", "order", "peak_order", "peak_error"),
    [
        (jb.papers.GreenANCF, (4, 16), 4, 4, 1e-5),
        # the chord is shorter than the arc by h^2, and so is the mean strain that it stands for
        (jb.papers.ANCF, (4, 16), 2, 1, 1e-5),
        (jb.papers.ChordANCF, (8, 32), 2, 1.5, 2e-4),
        (jb.papers.TangentANCF, (8, 32), 3, 3, 3e-4),
    ],
    ids=lambda v: getattr(v, "__name__", None),
)
def test_elements_converge_to_the_exact_beam(exact, theory, counts, order, peak_order, peak_error):
    for speed in (2.0, 4.0):
        errors = np.array([deviation(theory(n), speed, exact) for n in counts])
        found, found_peak = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
        assert order - 0.1 < found < order + 0.6
        assert found_peak > peak_order - 0.1
        assert errors[-1, 1] < peak_error


@pytest.mark.exhaustive
def test_two_elements_of_model_a_are_enough(exact):
    """B, section 3: at 2 and 4 rad/s."""
    assert max(deviation(jb.papers.ANCF(2), 2.0, exact)) < 2e-3
    assert max(deviation(jb.papers.ANCF(2), 4.0, exact)) < 4e-3


@pytest.mark.exhaustive
def test_remainder_of_model_a_vanishes_with_its_elements():
    """Work of the forces of B eq. A-5 beyond the gradient of B eq. 9, over the strain energy."""
    motion = jb.SmoothSpinUp(4.0, 15.0)

    def remainder(n):
        run = jb.simulate(jb.papers.ANCF(n), ROTOR, motion, np.linspace(0.0, 20.0, 801))
        rate = jax.vmap(lambda y: run.scene.equations.nonconservative_force(y.q) @ y.v)
        work = cumulative_trapezoid(rate(run.state), run.times)
        return np.abs(work).max() / np.max(run.strain_energy)

    counts = (2, 8)
    shares = [remainder(n) for n in counts]
    assert 0.05 < shares[0] < 0.2
    assert np.polyfit(np.log(counts), np.log(shares), 1)[0] < -1.7


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("build", "limit"),
    [
        (lambda n: jb.Hybrid(n, n, 0), 2e-3),
        (lambda n: jb.VonKarman(2 * n, n, 0), 6e-3),
    ],
    ids=["Hybrid", "VonKarman"],
)
def test_modal_models_converge_exponentially_to_their_own_limit(exact, build, limit):
    """The limit is the exact beam to second order in deflection over length: its distance at 4
    rad/s, where that is 7 %, is stated; at 2 rad/s, where it is half that, it is a quarter."""
    motion = jb.SmoothSpinUp(4.0, 15.0)
    tips = [
        jb.simulate(build(n), ROTOR, motion, TIMES, stepsize_controller=TIGHT).tip[:, 1]
        for n in (2, 3, 4, 6)
    ]
    errors = [np.abs(tip - tips[-1]).max() for tip in tips[:-1]]
    assert errors[1] < errors[0] / 5
    assert errors[2] < errors[1] / 5
    fast, slow = (max(deviation(build(6), speed, exact)) for speed in (4.0, 2.0))
    assert fast < limit
    assert slow < fast / 3


@pytest.mark.exhaustive
def test_linear_elements_have_the_limit_of_the_hybrid_model(exact):
    """One linear theory, small-strain, by elements and by polynomials."""
    found = [
        deviation(m, 4.0, exact)[1] for m in (jb.papers.SmallStrainANCF(10), jb.Hybrid(5, 5, 0))
    ]
    np.testing.assert_allclose(*found, rtol=0.01)


@pytest.mark.exhaustive
def test_model_zero_fails_where_berzeri_says():
    """Unstable with one element at 10 rad/s and two at 40, where ten agree with Model A."""

    def growth(model, speed):
        return float(jb.modes(model, ROTOR, speed, 1).growth_rate[0])

    assert growth(jb.papers.ChordANCF(1), 10.0) > 1
    assert growth(jb.papers.ChordANCF(2), 10.0) == 0
    assert growth(jb.papers.ChordANCF(2), 40.0) > 10
    assert growth(jb.papers.TangentANCF(1), 4.0) > 1
    for model in (
        jb.papers.ANCF(1),
        jb.papers.ANCF(2),
        jb.papers.GreenANCF(2),
        jb.papers.ChordANCF(10),
    ):
        assert growth(model, 10.0) == 0
    assert growth(jb.papers.ANCF(2), 40.0) == growth(jb.papers.ChordANCF(10), 40.0) == 0
    first = jb.labels(in_plane=1)
    ten = [
        jb.modes(m, ROTOR, 10.0, first).frequency
        for m in (jb.papers.ChordANCF(10), jb.papers.ANCF(10))
    ]
    np.testing.assert_allclose(*ten, rtol=0.02)


@pytest.mark.exhaustive
def test_model_zero_in_time():
    """B Fig. 6: at 10 rad/s one element leaves, ten stay with Model A."""
    motion, times = jb.SmoothSpinUp(10.0, 15.0), np.linspace(0.0, 20.0, 101)
    loose = diffrax.PIDController(rtol=1e-5, atol=1e-5)
    one = jb.simulate(
        jb.papers.ChordANCF(1), ROTOR, motion, times, throw=False, max_steps=20_000,
        stepsize_controller=loose,
    )  # fmt: skip
    assert np.nanmax(np.abs(one.partial.tip[:, 1])) > 4.0
    runs = [
        jb.simulate(m, ROTOR, motion, times, stepsize_controller=loose)
        for m in (jb.papers.ChordANCF(10), jb.papers.ANCF(10))
    ]
    peaks = [float(run.peak()[0]) for run in runs]
    np.testing.assert_allclose(*peaks, rtol=0.02)


@pytest.mark.exhaustive
def test_steady_stretch_by_every_model():
    """L (tan b / b - 1) of a linear-elastic rod; strain measures differ by the strain itself."""
    rotor, motion = jb.Rotor(jb.Beam(10.0, 1.2, 2.8e7, 1.4e4, 1.4e4)), jb.ConstantSpeed(6.0)
    b = 60.0 * np.sqrt(1.2 / 2.8e7)
    exact = 10.0 * (np.tan(b) / b - 1)
    for model, tolerance in (
        (jb.Hybrid(5, 1, 0), 1e-8), (jb.Classical(5, 1, 0), 1e-8), (jb.VonKarman(5, 1, 0), 1e-8),
        (jb.papers.ChordANCF(4), 1e-8), (jb.papers.TangentANCF(4), 1e-8),
        (jb.papers.GreenANCF(8), 3e-4), (jb.papers.ANCF(8), 3e-4),
        (jb.papers.SmallStrainANCF(8), 3e-4),
    ):  # fmt: skip
        run = jb.simulate(
            model, rotor, motion, [0.0, 1e-3], start=jb.steady_start(model, rotor, motion)
        )
        np.testing.assert_allclose(run.tip[0, 0], exact, rtol=tolerance)


@pytest.mark.exhaustive
def test_discrete_frequencies():
    """Exact models agree at speed; LC diverges at sqrt(k_r / m) / L; LP is k_r / m + d Omega^2."""
    both = [
        jb.modes(m, PAPER_SPRINGS, 10.0, 2).frequency
        for m in (jb.papers.DiscreteNC(), jb.papers.DiscreteNP())
    ]
    np.testing.assert_allclose(*both, rtol=1e-12)
    critical = np.sqrt(300.0)
    for speed, grows in ((0.9999 * critical, False), (1.0001 * critical, True)):
        growth = jb.modes(jb.papers.DiscreteLC(), PAPER_SPRINGS, speed, 1).growth_rate[0]
        assert (growth > 0) == grows
    # without stretch, LP is an oscillator; k_T makes it nearly so
    stiff = jb.papers.SpringRotor(1.0, 1.0, 1.0, 1e12, 300.0)
    frequency = jb.modes(jb.papers.DiscreteLP(), stiff, 10.0, 1).frequency[0]
    np.testing.assert_allclose(frequency, np.sqrt(400.0), rtol=1e-8)
