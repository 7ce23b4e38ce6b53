"""What holds for every result: a case that failed gives NaN, and batches answer case by case."""

import inspect

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._results import finite_rows
from tests.beams import README_ROTOR
from tests.fitting.lines import line
from tests.tiers import exhaustive, slow

BEAM = jb.Beam.from_slenderness(70.0)
FIRST = jb.labels(in_plane=1)
TIMES = jnp.linspace(0.0, 4.0, 9)
OK = jb.Status.OK


def rotor(tip_mass=0.3):
    return jb.Rotor(BEAM, 0.1, tip_mass)


def run(speed, tip_mass=0.3, model=jb.Hybrid(0, 2, 0), **kwargs):  # noqa: B008
    motion = jb.SmoothSpinUp(speed, 3.0)
    return jb.simulate(model, rotor(tip_mass), motion, TIMES, throw=False, **kwargs)


def run_through_functions(tip_mass):
    """Its leaves are not arrays alone."""

    def turn(t):
        return jnp.asarray([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])

    motion = jb.motions.HubPose(lambda t: jnp.array([0.0, 1.0, 0.0]) * jnp.sin(t) ** 2, turn)
    return jb.simulate(jb.Hybrid(0, 1, 0), rotor(tip_mass), motion, TIMES, throw=False)


def fitted(intercept):
    """A straight line that passes through zero at one."""
    x = np.linspace(-1.0, 2.0, 12)
    y = intercept * (1 - x) + 0.01 * np.cos(9 * x)
    free = {name: jb.FreeParameter(0.5, -np.inf) for name in "ab"}
    return jb.fit(line(x, y, 0.02), free, throw=False)


def answered(speed):
    question = jb.ladder.PeakDeflection(jb.SmoothSpinUp(speed, 3.0), TIMES)
    return jb.ladder.evaluate(jb.Hybrid(0, 2, 0), rotor(), question)


MODEL = jb.Hybrid(2, 3, 2)
ELEMENT = jb.papers.GreenANCF(1)
# A case of each result, as a function of a number between 1 and 2.
RESULTS = {
    "Simulation": run,
    "Simulation through functions": run_through_functions,
    "Modes": lambda x: jb.modes(MODEL, rotor(), x, 4, throw=False),
    "Modes by bands": lambda x: jb.modes(jb.Hybrid(), rotor(), x, 2, throw=False),
    "LinearSystem": lambda x: MODEL.linearise(rotor(), x, throw=False),
    "Southwell": lambda x: jb.southwell(jb.Hybrid(0, 3, 0), rotor(), x, FIRST, throw=False),
    "Crossing": lambda x: jb.crossing(
        jb.Hybrid(0, 3, 0), rotor(), (0.1, 9.0), FIRST[0], 2.0 * x, throw=False
    ),
    "CriticalSpeed": lambda x: jb.critical_speed(jb.Classical(0, 3, 0), rotor(x), throw=False),
    "StableStep": lambda x: jb.solvers.stable_step(
        jb.Hybrid(0, 3, 0), rotor(), x, diffrax.Bosh3(), throw=False
    ),
    "Floquet": lambda x: jb.floquet(
        jb.Hybrid(0, 2, 0), rotor(), jb.motions.ModulatedSpeed(x, 0.3, 5.0), throw=False
    ),
    "Tongue": lambda x: jb.tongue(
        jb.Hybrid(0, 1, 0), rotor(), x, FIRST * 2, [0.1, 0.2], throw=False
    ),
    "Fit": fitted,
    "Answer": answered,
}
QUICK, SLOW = ("LinearSystem",), ("Modes",)


def _asks_nothing(method):
    _, *others = inspect.signature(method).parameters.values()
    return all(other.default is not other.empty for other in others)


def asked(result):
    """Every array that a result answers with: fields, properties, methods without arguments."""
    found = {"fields": result}
    for name, member in inspect.getmembers(type(result)):
        if name.startswith("_") or name in ("labels", "where", "distance"):
            continue
        if isinstance(member, property):
            found[name] = getattr(result, name)
        elif callable(member) and name != "predict" and _asks_nothing(member):
            found[name] = getattr(result, name)()
    if isinstance(result, jb.results.Fit):
        found["predict"] = result.predict(lambda a, b: a * jnp.arange(3.0) + b)
        found["width"] = result.width(0.5)
    if isinstance(result, jb.results.Simulation):
        found["points"] = result.displacement([0.5, 1.0]), result.partial.strain([0.0, 0.1])
        found["flap"] = result.peak(2, 0.5)
        found["fields"] = result.times, result.state, result.imbalance, result.status
        found["partial"] = result.partial.peak()
    return eqx.filter(found, eqx.is_array)


def assert_same(a, b, **tolerance):
    assert jax.tree.structure(a) == jax.tree.structure(b)
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert x.shape == y.shape
        scale = np.abs(x).max(initial=0.0, where=np.isfinite(x))
        np.testing.assert_allclose(x, y, atol=1e-8 * scale, **tolerance)


@pytest.mark.parametrize(
    "name",
    [n if n in QUICK else slow(n) if n in SLOW else exhaustive(n) for n in RESULTS],
)
def test_batches_answer_as_their_cases_do(name):
    """Nested maps of either kind, asked outside and inside, and a single case of them."""
    build, x = RESULTS[name], jnp.array([[1.0, 1.5], [1.8, 2.0], [1.2, 1.1]])

    def both(x):
        result = build(x)
        return result, asked(result)

    outer = eqx.filter_vmap if name == "Simulation through functions" else jax.vmap
    batch, inside = eqx.filter_jit(outer(eqx.filter_vmap(both)))(x)
    assert type(batch).__name__ == name.split()[0]
    assert_same(eqx.filter_jit(asked)(batch), inside, rtol=1e-6)

    def at(tree, *index):
        return jax.tree.map(lambda a: a[index] if eqx.is_array(a) and a.ndim > 1 else a, tree)

    one = at(batch, 2, 0)
    assert one.status.ndim == (name == "Tongue")  # which has one for each depth
    assert_same(eqx.filter_jit(asked)(one), at(inside, 2, 0), rtol=1e-6)
    assert str(batch)
    assert str(one)


def test_labels_of_a_batch():
    modes = jax.jit(jax.vmap(lambda x: jb.modes(MODEL, rotor(), x, 2, throw=False)))
    first = jb.labels(flap=1, in_plane=1)
    assert [set(labels) for labels in modes(jnp.array([1.0, 2.0])).labels] == [set(first)] * 2


def test_text_of_a_batch_of_fits():
    fits = jax.vmap(fitted)(jnp.array([1.0, 2.0, jnp.nan]))
    assert str(fits).startswith("3 fits: 2 ok; 1 ")
    assert str(jax.eval_shape(fitted, jnp.ones(()))).startswith("Fit(")


@pytest.mark.slow
def test_sweep_does_not_call_a_failed_run_ok():
    """Of a beam of 8 m: the classical theory diverges at 3 and 4 rad/s, with peaks of -97 m."""
    times = jnp.linspace(0.0, 20.0, 21)

    def peak(speed):
        motion = jb.SmoothSpinUp(speed, 15.0)
        run = jb.simulate(jb.Classical(0, 2, 0), README_ROTOR, motion, times, throw=False)
        return run.peak()[0]

    table = jb.sweep(peak, jb.grid(speed=[1.0, 3.0, 4.0]))
    assert table["status"].tolist() == [OK, jb.Status.NOT_FINITE, jb.Status.NOT_FINITE]
    assert -0.3 < table["value"][0] < -0.1
    assert np.isnan(table["value"][1:]).all()


@pytest.mark.slow
def test_runs_that_failed_answer_as_far_as_they_may_be_trusted():
    """Stopped by `max_steps`; diverged; out of balance; out of range."""

    @jax.jit
    @jax.vmap
    def cases(speed, tip_mass, rtol, balance_tolerance):
        control = diffrax.PIDController(rtol=rtol, atol=1e-9)
        return run(
            speed, tip_mass, jb.Classical(0, 1, 0), stepsize_controller=control, max_steps=100,
            balance_tolerance=balance_tolerance,
        )  # fmt: skip

    runs = cases(
        jnp.array([3.0, 40.0, 1.0, 1.0]), jnp.array([0.3, 0.3, 0.3, -1.0]),
        jnp.array([1e-12, 1e-3, 1e-4, 1e-4]), jnp.array([1e-3, 1.0, 1e-12, 1e-3]),
    )  # fmt: skip
    names = [jb.Status(s).name for s in runs.status.tolist()]
    every = [jax.tree.map(lambda a, i=i: a[i], runs) for i in range(4)]
    stopped, diverged, unbalanced, invalid = every
    np.testing.assert_array_equal(runs.tip, [one.tip for one in every])
    best = [one.partial.peak() for one in every]
    np.testing.assert_allclose(runs.partial.peak(), np.transpose(best), rtol=1e-12)
    assert names == ["MAX_STEPS", "DIVERGED", "UNBALANCED", "INVALID_TIP_MASS"]
    for one in (stopped, diverged):
        reached = np.isfinite(one.times)
        assert 0 < reached.sum() < TIMES.size
        for ask in (lambda r: r.tip, lambda r: r.energy):
            assert np.isfinite(ask(one)[reached]).all()
            assert np.isnan(ask(one)[~reached]).all()
            np.testing.assert_array_equal(ask(one), ask(one.partial))
    for one in (stopped, diverged, unbalanced, invalid):
        assert np.isnan(one.peak()).all()
    for one in (stopped, diverged, unbalanced):
        assert np.isfinite(one.partial.peak()).all()
        assert float(one.partial.peak()[1]) <= float(one.end_time)
    assert np.isnan(unbalanced.tip).all()
    assert np.isfinite(unbalanced.partial.tip).all()
    assert np.isfinite(unbalanced.state.q).all()
    assert np.isnan(invalid.tip).all()
    assert np.isnan(invalid.partial.tip).all()
    assert np.isnan(invalid.partial.peak()).all()


def test_matrices_out_of_range_are_nan():
    """Not those of the harmless numbers in place of them."""
    system = jax.jit(lambda m: MODEL.linearise(rotor(m), 1.0, throw=False))(-1.0)
    assert int(system.status) == jb.Status.INVALID_TIP_MASS
    for matrix in (system.mass, system.gyroscopic, system.stiffness, system.steady_strain):
        assert np.isnan(matrix).all()


def test_answers_that_failed_are_nan():
    question = jb.ladder.DeflectionHistory(jb.SmoothSpinUp(3.0, 3.0), TIMES, max_steps=10)
    found = jb.ladder.evaluate(jb.Hybrid(0, 2, 0), rotor(), question, throw=False)
    assert int(found.status) == jb.Status.MAX_STEPS
    for number in (found.value, found.scale, found.size, found.slope):
        assert np.isnan(number).all()
    assert int(found.steps) == 10


# A number as a function of a parameter that cases share and one of their own, with good and bad
# values of the latter.
NUMBERS = {
    "modes": (
        lambda p, x: jb.modes(jb.Hybrid(2, 3, 0), rotor(p), x, FIRST, throw=False).frequency[0],
        [1.0, 1e3, np.nan],
    ),
    "modes in bands": (
        lambda p, x: jb.modes(jb.Hybrid(), rotor(p), x, 2, throw=False).frequency[1],
        [1.0, 1e3, np.nan],
    ),
    "modes of elements": (
        lambda p, x: jb.modes(jb.papers.GreenANCF(2), rotor(p), x, 1, throw=False).frequency[0],
        [1.0, 1e9, np.nan],
    ),
    "linearise": (
        lambda p, x: jb.papers.ANCF(1).linearise(rotor(p), x, throw=False).stiffness.max(),
        [1.0, 1e9, np.nan],
    ),
    "southwell": (
        lambda p, x: jb.southwell(
            jb.Hybrid(2, 3, 0), rotor(p), x + p, FIRST, throw=False
        ).coefficient[0],
        [1.0, 1e4, np.nan],
    ),
    "crossing": (
        lambda p, x: jb.crossing(
            jb.Hybrid(0, 3, 0), rotor(p), (0.1 * p, 9.0), FIRST[0], x, throw=False
        ).angular_speed,
        [4.0, 1e-3, np.nan],
    ),
    "critical_speed": (
        lambda p, x: jb.critical_speed(
            jb.Classical(0, 3, 0), jb.Rotor(BEAM, x, p), throw=False
        ).angular_speed,
        [0.1, np.inf, np.nan],
    ),
    "stable_step": (
        lambda p, x: jb.solvers.stable_step(
            jb.Hybrid(2, 3, 0), rotor(p), x, diffrax.Bosh3(), growth=100.0 * p, throw=False
        ).step,
        [1.0, 1e3, np.nan],
    ),
    "floquet": (
        lambda p, x: jb.floquet(
            jb.Hybrid(0, 2, 0), rotor(p), jb.motions.ModulatedSpeed(x, 0.3, 5.0 * p),
            damping=jb.Damping(0.1 * p), throw=False,
        ).growth_rate,
        [1.0, 1e3, np.nan],
    ),
    "tongue": (
        lambda p, x: jb.tongue(
            jb.Hybrid(0, 1, 0), rotor(p), x, FIRST * 2, [0.2], damping=jb.Damping(0.01 * p),
            throw=False,
        ).frequency[0, 0],
        [1.0, 1e-3, np.nan],
    ),
    "stiffening_ratio": (
        lambda p, x: jb.stiffening_ratio(rotor(p), x, throw=False).ratio, [1.0, np.inf, np.nan]
    ),
    "steady": (
        lambda p, x: jb.steady(ELEMENT, rotor(p), x, throw=False).section_force(0.3)[0, 0],
        [1.0, 1e9, np.nan],
    ),
    "steady_start": (
        lambda p, x: jb.steady_start(
            jb.papers.GreenANCF(1), rotor(p), jb.ConstantSpeed(x), throw=False
        ).q.max(),
        [1.0, np.inf, np.nan],
    ),
}  # fmt: skip


SLOW_NUMBERS = "modes", "critical_speed"


def check_derivatives(push, pull, x):
    """`push` and `pull` differentiate, by the shared parameter, forwards and in reverse."""
    p, x = jnp.asarray(0.3), jnp.asarray(x)
    value, forward = jax.jit(
        lambda p, x: jax.jvp(
            lambda p: jax.vmap(push, (None, 0))(p, x), (p,), (jnp.ones_like(p),)
        )
    )(p, x)  # fmt: skip
    reverse = jax.jit(jax.grad(lambda p, x: jnp.sum(jax.vmap(pull, (None, 0))(p, x))))(p, x)
    for numbers in (value, forward):
        assert np.isfinite(numbers[0])
        assert np.isnan(numbers[1:]).all()
    assert abs(forward[0]) > 1e-9
    np.testing.assert_allclose(reverse, forward[0], rtol=1e-7)
    # A single case does not know whether others share its parameters.
    alone = jax.jit(jax.grad(pull))
    np.testing.assert_allclose(alone(p, x[0]), forward[0], rtol=1e-7)
    assert float(alone(p, x[1])) == 0.0


@pytest.mark.parametrize(
    "name",
    [slow(n) if n in SLOW_NUMBERS else exhaustive(n) for n in NUMBERS],
)
def test_derivatives_where_a_case_failed(name):
    """NaN forwards, nothing in reverse: gradients by what lanes share are those of good lanes."""
    number, x = NUMBERS[name]
    check_derivatives(number, number, x)


@pytest.mark.exhaustive
def test_derivatives_where_a_run_failed():
    def number(**kwargs):
        def of(p, x):
            found = run(x, p, jb.Hybrid(0, 1, 0), max_steps=100, **kwargs)
            return found.peak()[0] + found.tip[-1, 1] + found.hub_torque[-1, 2] + found.energy[-1]

        return of

    check_derivatives(number(adjoint=diffrax.ForwardMode()), number(), [1.0, 1e3, np.nan])


@pytest.mark.slow
def test_second_derivatives_where_a_case_failed():
    number, (good, bad, _) = NUMBERS["modes"]
    second = jax.jit(jax.jacfwd(jax.jacfwd(number)))
    assert np.isfinite(second(0.3, good))
    assert np.isnan(second(0.3, bad))
    assert float(jax.jit(jax.jacfwd(jax.grad(number)))(0.3, bad)) == 0.0


def test_rows_are_finite_whatever_their_size():
    largest = np.finfo(float).max
    rows = np.full((6, 300), largest)
    rows[1, 7], rows[2, 8], rows[3, 9], rows[3, 10] = np.nan, np.inf, np.inf, -np.inf
    rows[4] = 5e-324
    rows[5] *= -1
    expected = [True, False, False, False, True, True]
    assert finite_rows(jnp.asarray(rows)).tolist() == expected
    assert finite_rows(jnp.asarray(rows[:, :7])).all()
