"""Functions that suit a beam, on the blade of the NREL 5-MW turbine."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

import jaxbeam as jb
from jaxbeam._rotor.span import Span
from tests.references import blade as blade_reference
from tests.tiers import slow

BLADE = jb.blades.read_blade(blade_reference.NREL, length=61.5, axial_stiffness=1e10).beam


@pytest.mark.exhaustive
@pytest.mark.parametrize("rpm", [0.0, slow(12.1)])
def test_of_a_twisted_blade(rpm):
    """Some functions are for what a moment bends across. What all of them leave is estimated to
    some 1e-9, which is what quadrature leaves."""
    speed = rpm * np.pi / 30
    exact = np.array(blade_reference.frequencies(blade_reference.nrel5mw(), speed, 5))
    for count, tolerances in (
        (12, (4e-7, 1e-7, 2e-5, 2.5e-5, 2.5e-4)),
        (16, (5e-9, 2e-8, 2e-6, 4e-6, 2e-5)),
    ):
        found = jb.modes(jb.Hybrid(0, count, count), jb.Rotor(BLADE, 1.5), speed, 5)
        error = np.abs(np.asarray(found.frequency) / exact - 1)
        assert (error < tolerances).all()
        estimate = np.asarray(found.frequency_error)
        assert (estimate > error / 3).all()
        assert (estimate < 30 * error).all()
        assert (np.abs(estimate - error) < (4e-9, 2e-10, 4e-8, 3e-8, 7e-8)).all()


def test_of_a_beam_turned_as_a_whole():
    """What bends across is no other function then."""
    beam = jb.Beam(1.0, 1.0, 1e6, 16.0, 1.0, twist=0.3)
    found = jb.modes(jb.Hybrid(0, 12, 12), jb.Rotor(beam), 0.0, 4).frequency
    first, second, third = 3.5160152685, 22.0344915647, 61.6972144135
    assert np.allclose(found, [first, 4 * first, second, third], rtol=1e-8)


def cone(**more):
    """A blade that tapers in both directions to a tenth: 1 / EI grows ten thousandfold."""
    mass, stiffness = (
        jb.blades.SpanwiseFunction(lambda x, n=n: (1 - 0.9 * x) ** n, **more) for n in (2, 4)
    )
    return jb.Beam(1.0, mass, 1e9, stiffness, stiffness)


def test_of_what_is_soft_at_its_tip():
    """A truncated cone; the same where the stiffness of a table is traced; two stations that are
    next to each other, as steps are written. References are of tests/references/blade.py.
    """
    model = jb.Hybrid(0, 12, 0)
    found = jb.modes(model, jb.Rotor(cone()), 0.0, 2)
    wanted = blade_reference.Blade(
        mass=lambda x: (1 - 0.9 * x) ** 2, flap=lambda x: (1 - 0.9 * x) ** 4
    )
    exact = np.array(blade_reference.flap(wanted, 0.0, 2))
    np.testing.assert_allclose(found.frequency, exact, rtol=1e-7)
    assert np.max(found.frequency_error) < 1e-7


@pytest.mark.slow
def test_of_a_layer_at_the_root():
    """At high speed a beam bends near its clamp: graded polynomials are for that, built or not."""
    stiffness = jb.Spanwise([0.0, 1.0], [1.0, 0.3])
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e8, 1.0, stiffness), 0.1)
    wanted = blade_reference.Blade(hub=0.1, flap=lambda x: 1 - 0.7 * x)
    exact = np.array(blade_reference.flap(wanted, 100.0, 3))
    for grading, most in ((2, 6e-5), (1, 3e-4)):
        model = jb.Hybrid(0, 0, 14, jb.models.Polynomials(grading=grading))
        found = jb.modes(model, rotor, 100.0, 3)
        error = np.abs(np.asarray(found.frequency) / exact - 1)
        assert error.max() < most
        assert (error < 3 * np.asarray(found.frequency_error) + 1e-10).all()
        assert (np.asarray(found.frequency_error) < 3 * error + 1e-10).all()


def rod():
    """A truncated cone that stretches: EA goes with the mass."""

    def section(size):
        return jb.blades.SpanwiseFunction(lambda x: size * (1 - 0.6 * x) ** 2)

    return jb.Beam(1.0, section(1.0), section(1e2), 1.0, 1.0)


@pytest.mark.slow
def test_of_a_rod_that_stretches():
    """(1 - 0.6 x) times the displacement is a string's: tan k = -2 k / 3, and in rotation, without
    a Coriolis force, omega^2 = 100 k^2 - Omega^2. Errors of 2e-8 and 4e-4."""
    k = [scipy.optimize.brentq(lambda k: np.tan(k) + k * 2 / 3, a, a + 1.5) for a in (1.6, 4.72)]
    found = jb.modes(jb.Hybrid(5, 0, 0), jb.Rotor(rod()), 8.0, jb.labels(axial=2))
    error = found.frequency / np.sqrt(100 * np.square(k) - 64) - 1
    np.testing.assert_allclose(found.frequency_error, error, rtol=0.1)


@pytest.mark.exhaustive
def test_of_a_rod_that_stretches_and_bends():
    """With the Coriolis force: errors from 8e-9 to 3e-4, against twice as many functions."""

    @jax.jit
    def found(speed):
        models, labels = (jb.Hybrid(5, 7, 0), jb.Hybrid(9, 11, 0)), jb.labels(in_plane=2, axial=2)
        few, many = (jb.modes(m, jb.Rotor(rod(), 0.1), speed, labels) for m in models)
        return few.frequency / many.frequency - 1, few.frequency_error

    error, estimate = found(4.0)
    np.testing.assert_allclose(estimate, error, rtol=0.1)


def stations(soft, gap=1e-6):
    stiffness = jb.Spanwise([0, 0.3, 0.3 + gap, 1], jnp.array([1.0, 1.0, 0.5, 1.0]) * soft)
    return jb.Rotor(jb.Beam(1.0, 1.0, 1e9, stiffness, 1.0))


def test_no_columns_have_integrals():
    """Models with one function in each direction have none that tension makes."""
    span = Span.between((0.0, 0.5, 1.0), 4)
    for integral in (span.up_to, span.beyond):
        assert integral(np.zeros((8, 0))).shape == (8, 0)


@pytest.mark.slow
def test_traced_values_and_stations_side_by_side():
    """Values may be traced; a step that is written as two near stations is one."""
    soft = np.array([1.0, 1.0, 1.0, 0.01])

    def frequency(soft, gap=1e-6):
        return jb.modes(jb.Hybrid(0, 12, 0), stations(soft, gap), 1.0, 2).frequency

    values = np.array([1.0, 1.0, 0.5, 1.0]) * soft
    near = blade_reference.Blade(flap=((0, 0.3, 0.3, 1), tuple(values)), lag=1.0)
    flap = np.array(blade_reference.flap(near, 1.0, 2))
    exact = np.sqrt(flap**2 - 1)
    np.testing.assert_allclose(jax.jit(frequency)(soft), exact, rtol=5e-6)
    np.testing.assert_allclose(frequency(jnp.asarray(soft), 1e-12), exact, rtol=1e-6)
    slope = jax.jit(jax.jacrev(frequency))(soft)
    ends = [jax.jit(frequency)(soft * (1 + step)) for step in (1e-5, -1e-5)]
    np.testing.assert_allclose(slope @ soft, (ends[0] - ends[1]) / 2e-5, rtol=1e-6)


@pytest.mark.slow
def test_what_nobody_declared_is_estimated():
    """A step that no kink names, a property that varies faster than points of integration, and too
    few functions: the error is known, and beyond 1e-3 there is a status."""

    def step(x):
        return jnp.where(x < 0.43, 1.0, 0.25)

    def of(function, n=16, kinks=()):
        beam = jb.Beam(1.0, 1.0, 1e9, jb.blades.SpanwiseFunction(function, kinks), 1.0)
        return jb.modes(jb.Hybrid(0, n, 0), jb.Rotor(beam), 0.0, 3, throw=False)

    exact = np.asarray(of(step, 24, (0.43,)).frequency)
    found = of(step)
    if found.status == jb.Status.OK:
        error = np.abs(np.asarray(found.frequency) / exact - 1)
        assert (found.frequency_error > error / 3).all()
    else:
        assert found.status == jb.Status.TOO_FEW_FUNCTIONS
    assert np.max(found.frequency_error) > 1e-4
    waves = of(lambda x: 1.2 + jnp.sin(900 * x))
    assert waves.status == jb.Status.TOO_FEW_FUNCTIONS
    assert np.isnan(waves.frequency).all()
    few = of(step, 3, (0.43,))
    assert few.status == jb.Status.TOO_FEW_FUNCTIONS
    assert np.max(few.frequency_error) > 1e-3


@pytest.mark.exhaustive
def test_memory_grows_with_the_number_of_stations():
    """Of six hundred some tens of MB."""
    places, rng = np.linspace(0, 1, 600), np.random.default_rng(0)
    values = [rng.uniform(0.5, 1.0, places.size) for _ in range(3)]

    def frequency(values):
        mass, lag, flap = (jb.Spanwise(places, v) for v in values)
        return jb.modes(jb.Hybrid(0, 16, 16), jb.Rotor(jb.Beam(1.0, mass, 1e6, lag, flap)), 1.0)

    program = jax.jit(frequency).lower(values).compile()
    assert program.memory_analysis().temp_size_in_bytes < 2e8
