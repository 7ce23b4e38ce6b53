"""Whatever a user gets wrong, the first line that they read says what it was."""

import copy
import dataclasses
import functools
import logging
import pickle

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._fitting.matching import match_modes
from jaxbeam._status import raise_unless_ok, said
from tests.helpers import run_optimised

SENTENCE = "length must be finite and > 0"


def stiffness(length):
    rotor = jb.papers.SpringRotor(1.0, length, 1.0, 100.0, 1.0)
    return jb.papers.DiscreteLP().linearise(rotor, 0.5).stiffness.sum()


@pytest.mark.parametrize(
    "compiled",
    [
        jax.jit(stiffness),
        eqx.filter_jit(stiffness),
        jax.jit(lambda r: jax.vmap(stiffness)(jnp.stack([r, -r]))),
        jax.jit(jax.grad(stiffness)),
        jax.jit(lambda r: jax.lax.map(stiffness, r[None])),
        jax.jit(lambda r: jax.vmap(jax.grad(stiffness))(jnp.stack([r, -r]))),
    ],
    ids=["jit", "filter_jit", "vmap", "grad", "map", "vmap of grad"],
)
def test_an_error_in_a_compiled_program_is_one_sentence_at_both_ends(compiled, caplog):
    """In the log before the exception, and as its last line; nothing of the tools in between."""
    with pytest.raises((RuntimeError, ValueError)) as caught:  # by what waits for the result
        jax.block_until_ready(compiled(jnp.asarray(-1.0)))
    assert str(caught.value).splitlines()[-1] == f"CaseError: {SENTENCE}"
    assert [record.getMessage() for record in caplog.records] == [SENTENCE]
    assert "filter_jit" not in str(caught.value)
    assert "EQX" not in str(caught.value)


@pytest.mark.parametrize(
    "known",
    [
        stiffness,
        jax.grad(stiffness),
        jax.jacfwd(stiffness),
        lambda r: jax.vmap(stiffness)(jnp.stack([r, -r])),
        lambda r: jax.vmap(jax.grad(stiffness))(jnp.stack([r, -r])),
    ],
    ids=["plain", "grad", "jacfwd", "vmap", "vmap of grad"],
)
def test_where_values_are_known_the_error_is_plain(known):
    with pytest.raises(ValueError, match=SENTENCE) as caught:
        known(jnp.asarray(-1.0))
    assert str(caught.value) in (SENTENCE, f"{SENTENCE}, got -1.0")


def test_of_a_batch_the_largest_status_is_told_and_good_cases_pass():
    def case(code):
        return raise_unless_ok({"x": code * 2.0, "n": code}, code)["x"]

    good = jnp.zeros(3, int)
    assert (jax.jit(jax.vmap(case))(good) == 0).all()
    with pytest.raises(RuntimeError, match=f"CaseError: {jb.Status.NO_TONGUE.message[:20]}"):
        jax.jit(jax.vmap(case))(good.at[1].set(jb.Status.NO_TONGUE).at[2].set(1))


def test_what_cases_of_a_sweep_say_is_collected_and_not_logged(caplog):
    caplog.set_level(logging.INFO)
    try:
        raise KeyError("an error that is handled already")
    except KeyError:
        table = jb.sweep(lambda r: stiffness(r), jb.grid(r=[0.1, -1.0, 0.2]))
        of_user = jb.sweep(lambda a: eqx.error_if(a, a < 0, "too small"), jb.grid(a=[0.1, -1.0]))
    assert table.errors == {1: SENTENCE}
    assert of_user.errors == {1: "too small"}
    assert not caplog.records


def test_the_sentence_is_found_whatever_the_exception_became():
    text = f"INTERNAL: CpuCallback error calling callback: Traceback\nCaseError: {SENTENCE}"
    for kind in (ValueError, RuntimeError, jax.errors.JaxRuntimeError):
        assert said(kind(text)) == SENTENCE
        assert said(kind("out of memory")) is None


ROTOR, MODEL = jb.Rotor(jb.Beam.from_slenderness(70.0), 0.5, 0.1), jb.Hybrid(3, 8, 2)
MOTION, TIMES, WHICH = jb.SmoothSpinUp(1.0, 2.0), [0.0, 1.0, 2.0], jb.labels(in_plane=2)
FREQUENCIES = {"angular_speed": [0.0], "measured": [[1.0, 2.0]], "noise": 0.1, "which": WHICH}


def data(**changed):
    return jb.FrequencyData(MODEL, ROTOR, **{**FREQUENCIES, **changed})


def run(**given):
    return jb.simulate(MODEL, ROTOR, MOTION, TIMES, **given)


def history(**given):
    return jb.fitting.HistoryData(MODEL, ROTOR, MOTION, TIMES, [0.0, 0.0, 0.0], 0.1, **given)


def moved(velocity):
    return jb.motions.HubVelocity(velocity, lambda t: jnp.zeros(3))


FREE = {"stiffness": jb.FreeParameter(0.9)}


def found(stiffness):
    beam = jb.Beam(1.0, 1.0, 4900.0, stiffness, 1.0)
    return jb.FrequencyData(jb.Hybrid(0, 4, 0), jb.Rotor(beam), [0.0], [[3.5, 22.0]], 0.1, WHICH)


def downhill(**given):
    return jb.fit(found, FREE, descent=jb.fitting.Descent(**given))


def clearance(**changed):
    given = {"angular_speed": [1.0], "which": WHICH, "harmonics": [1], **changed}
    return jb.fitting.ResonanceMargin(MODEL, ROTOR, **given)


@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("times", lambda x: jb.simulate(MODEL, ROTOR, MOTION, x)),
        ("times", lambda x: jb.ladder.PeakDeflection(MOTION, x)),
        ("times", lambda x: jb.fitting.HistoryData(MODEL, ROTOR, MOTION, x, [0.0, 1.0], 0.1)),
        ("gravity", lambda x: jb.Loads(gravity=x)),
        ("tip_force", lambda x: jb.Loads(tip_force=x)),
        ("axis", lambda x: jb.ConstantSpeed(1.0, axis=x)),
        ("depths", lambda x: jb.tongue(MODEL, ROTOR, 1.0, (WHICH[0], WHICH[0]), x)),
        ("measured", lambda x: match_modes(x, [1.0, 2.0])),
        ("computed", lambda x: match_modes([1.0], x)),
        ("angular_speed", lambda x: data(angular_speed=x)),
        ("measured", lambda x: data(measured=x)),
        ("noise", lambda x: data(noise=x)),
        ("start.q", lambda x: run(start=jb.solvers.State(x, x))),
        ("xi", lambda x: jb.deflection_limit(1.0, xi=x)),
        ("xi", lambda x: jb.fitting.StaticData(MODEL, ROTOR, jb.Loads(), [0.1], 0.1, x)),
        ("harmonics", lambda x: jb.results.Campbell(MODEL, ROTOR, WHICH, None).crossings(x)),
        ("a", lambda x: jb.grid(a=x)),
        ("a", lambda x: jb.points(a=x)),
    ],
)
@pytest.mark.parametrize(
    "wrong",
    [
        [0.0, 1j], jnp.array([0.0, 1.0 + 1j]), [False, True], "01", ["0", "1"], [None, 1.0],
        [[0.0], [1.0, 2.0]], {}, b"0",
    ],
    ids=repr,
)  # fmt: skip
def test_numbers_are_real(name, call, wrong):
    """A complex number was taken for its real part, a text for the number that it spells."""
    with pytest.raises((TypeError, ValueError), match=f"^{name} must be ") as caught:
        call(wrong)
    assert "\n" not in str(caught.value)


def test_numbers_that_are_real_pass():
    @jax.jit
    def traced(x):
        return jb.Loads([0.0, x, 1]).gravity, jb.ladder.PeakDeflection(MOTION, [0, x]).times

    assert traced(2.0)[0].dtype == traced(2.0)[1].dtype == float
    for fine in ([0, 1], (0.0, 1.0), range(2), np.arange(2), np.arange(2, dtype=np.float32)):
        np.testing.assert_array_equal(jb.ladder.PeakDeflection(MOTION, fine).times, [0.0, 1.0])


def test_integers_of_numpy_and_one_label_are_taken_as_those_of_python():
    two = np.int64(2)
    assert float(jb.FreeParameter(two).guess) == float(jb.ConstantSpeed(two).speed) == 2.0
    assert jb.sweep(lambda a: a, {"a": [1.0, 3.0, 5.0]}, chunk=two)["value"].shape == (3,)
    assert data(which=two).which == 2
    assert clearance(harmonics=np.array([1, 2])).harmonics == (1, 2)
    assert clearance(harmonics=[two]).harmonics == (2,)
    assert data(which=WHICH[0], measured=[[1.0]]).which == WHICH[:1]


@pytest.mark.parametrize("wrong", [None, "Hybrid", jb.Hybrid, ROTOR], ids=repr)
@pytest.mark.parametrize(
    "call",
    [
        lambda m: jb.modes(m, ROTOR, 1.0),
        lambda m: jb.southwell(m, ROTOR, 0.0, WHICH),
        lambda m: jb.campbell(m, ROTOR, [1.0], WHICH),
        lambda m: jb.crossing(m, ROTOR, (0.1, 1.0), WHICH[0], 1.0),
        lambda m: jb.critical_speed(m, ROTOR),
        lambda m: jb.floquet(m, ROTOR, jb.motions.ModulatedSpeed(1.0, 0.1, 2.0)),
        lambda m: jb.tongue(m, ROTOR, 1.0, (WHICH[0], WHICH[0]), [0.1]),
        lambda m: jb.solvers.stable_step(m, ROTOR, 1.0, diffrax.Euler()),
        lambda m: jb.simulate(m, ROTOR, MOTION, TIMES),
        lambda m: jb.steady_start(m, ROTOR, MOTION),
        lambda m: jb.ladder.evaluate(m, ROTOR, jb.ladder.ModalFrequencies(1.0, WHICH)),
        lambda m: jb.FrequencyData(m, ROTOR, **FREQUENCIES),
        lambda m: jb.fitting.HistoryData(m, ROTOR, MOTION, TIMES, [0.0, 0.0, 0.0], 0.1),
        lambda m: jb.fitting.StaticData(m, ROTOR, jb.Loads(), [0.0], 0.1),
        lambda m: jb.fitting.ResonanceMargin(m, ROTOR, [1.0], WHICH, [1]),
    ],
)
def test_what_is_no_model_is_named(call, wrong):
    with pytest.raises(TypeError, match=r"^model must be a model, such as jaxbeam.Hybrid\(\), got"):
        call(wrong)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: jb.modes(MODEL, jb.Rotor, 1.0), "rotor must be a Rotor, got the class Rotor"),
        (lambda: jb.modes(MODEL, ROTOR, 1.0, np.array([1, 2])), "which must be an int or labels"),
        (lambda: jb.modes(MODEL, ROTOR, 1.0, jnp.float32(2.0)), "which must be an int or labels"),
        (lambda: jb.labels(in_plane="2"), "in_plane must be an int, got str"),
        (lambda: jb.labels(edge=1), "labels are of in_plane, flap, axial, torsion, not of 'edge'"),
        (lambda: jb.labels(flap=-1), "flap must be >= 0, got -1"),
        (lambda: jb.labels(axial=True), "axial must be an int, got bool"),
        (lambda: jb.ladder.ModalFrequencies(1.0, 3), "which must be labels"),
        (lambda: data(which=2.0), "which must be labels, an int or None, got 2.0"),
        (lambda: data(which=None, among="3"), "among must be an int, got str"),
        (lambda: data(noise=[0.1, 0.1, 0.1]), r"noise must be a number or have shape \(1, 2\)"),
        (lambda: clearance(which=3), "which must be a list, got 3"),
        (lambda: clearance(harmonics=3), "harmonics must be a list, got 3"),
        (lambda: jb.deflection_limit(1.0, True), "direction must be 0 "),
        (lambda: jb.deflection_limit(1.0, np.array([1, 2])), "direction must be 0 "),
        (lambda: jb.deflection_limit(1.0, 1, [0.0, 1.0]), "xi must be one number"),
        (lambda: run(solver=diffrax.Tsit5), "solver must be a diffrax.AbstractSolver, got the cl"),
        (lambda: run(saveat=[0.0]), "saveat must be a diffrax.SaveAt, got list"),
        (lambda: run(stepsize_controller=1e-6), "stepsize_controller must be a diffrax"),
        (lambda: run(event=lambda *_: 1.0), "event must be a diffrax.Event, got function"),
        (lambda: run(max_steps=1e5), "max_steps must be an int, got float"),
        (lambda: run(dt0="0.1"), "dt0 must be a real"),
        (lambda: run(balance_tolerance=None), "balance_tolerance must be a real"),
        (lambda: jb.steady_start(MODEL, ROTOR, MOTION, [0.0]), "t must be a real"),
        (lambda: jb.simulate(MODEL, ROTOR, jb.SmoothSpinUp, TIMES), "motion must be a Motion, got"),
        (lambda: jb.ladder.PeakDeflection(MOTION, TIMES, max_steps="9"), "max_steps must be an"),
        (lambda: history(of=3), "of must be a function of a Simulation, got 3"),
        (lambda: history(sovler=3), "sovler is no argument of HistoryData, nor of simulate"),
        (lambda: history(adjoint=None), "adjoint must not be given: HistoryData has its own"),
        (lambda: history(throw=True), "throw must not be given: HistoryData has its own"),
        (lambda: clearance(harmonics=np.array([1.0])), "harmonics must be integers >= 1"),
        (lambda: moved(lambda t: "x"), r"velocity must return real numbers of shape \(3,\)"),
        (lambda: moved(lambda t: None), "velocity must return real numbers"),
        (lambda: moved(lambda t: 1j * jnp.ones(3)), "velocity must return real numbers"),
        (lambda: moved(jb.ConstantSpeed), "velocity must return real numbers"),
        (lambda: jb.Loads(tip_force=lambda t: None), "tip_force must return real numbers"),
        (lambda: jb.Hybrid(basis=jb.models.Polynomials), "basis must be a Basis, got the class"),
        (lambda: jb.fit(None, FREE), "experiments must be a function of the parameters, got None"),
        (lambda: jb.fit(found, {1: jb.FreeParameter(1.0)}), "free must name parameters by texts"),
        (lambda: jb.fit(found, FREE, solver="LM"), "solver must be a least-squares solver, got s"),
        (lambda: jb.fit(found, FREE, max_steps=-1), "max_steps must be >= 1, got -1"),
        (lambda: jb.fit(found, FREE, max_steps="9"), "max_steps must be an int, got str"),
        (lambda: downhill(starts=0), "descent.starts must be >= 1, got 0"),
        (lambda: downhill(steps=1.5), "descent.steps must be an int, got float"),
        (lambda: downhill(starts_within="1"), "descent.starts_within must be a real"),
        (lambda: downhill(optimiser="adam"), "descent.optimiser must be an optimiser of optax"),
        (lambda: jb.sweep(abs, {"a": [1.0]}, folder=3), "folder must be a path, got 3"),
        (lambda: jb.sweep(abs, {"a": [1.0]}, dims="x"), "dims must be like"),
        (lambda: jb.sweep(abs, {"a": [1.0]}, dims={"x": ["y"]}), "dims must be like"),
        (lambda: jb.points(case=[1.0]), "case is the name of the dimension of a list"),
        (lambda: jb.sweep(3, {"a": [1.0]}), "function must take parameters by name, got int"),
        (lambda: jb.sweep(abs, {"a": [1.0]}, devices=2), "devices must be some of jax.devices"),
        (lambda: jb.ladder_sweep(3, {"a": [1.0]}), "situation must take parameters by name"),
    ],
)  # fmt: skip
def test_arguments_of_a_wrong_kind_are_named(call, said):
    with pytest.raises((TypeError, ValueError), match=f"^{said}") as caught:
        call()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("sweep", [jb.sweep, jb.ladder_sweep])
@pytest.mark.parametrize("wrong", [None, [1.0], 3, "a", {"a"}], ids=repr)
def test_cases_are_a_grid_a_list_or_a_dictionary(sweep, wrong):
    with pytest.raises(TypeError, match=r"^cases must be made by jaxbeam.grid or jaxbeam.points"):
        sweep(lambda a: a, wrong)
    with pytest.raises(TypeError, match=r"^cases must name parameters by texts, got 1"):
        sweep(lambda a: a, {1: [1.0]})


def test_a_dictionary_of_cases_is_a_grid():
    given = {"a": [1, 2], "b": np.array([3.0, 4.0])}
    ours, theirs = (jb.sweep(lambda a, b: a * b, c) for c in (given, jb.grid(**given)))
    np.testing.assert_array_equal(ours["value"], theirs["value"])
    assert ours.dims == theirs.dims


def test_harmonics_of_a_diagram():
    diagram = jb.results.Campbell(MODEL, ROTOR, WHICH, None)
    for wrong in (3, [0.0], [-1], [[1]], [float("nan")]):
        with pytest.raises(ValueError, match=r"^harmonics must be a list of numbers > 0, got"):
            diagram.crossings(wrong)


def test_selections_that_find_nothing_say_so():
    nan = float("nan")
    table = jb.sweep(lambda a: a, {"a": [1.0, 2.0]})
    with pytest.raises(KeyError, match="a has no coordinate nan'"):
        table.sel(a=nan)
    with pytest.raises(KeyError, match="a has no coordinate inf'"):
        table.sel(a=float("inf"))
    with pytest.raises(TypeError, match="a must be selected by numbers"):
        table.sel(a=1j)
    with pytest.raises(TypeError, match="a must be selected by numbers"):
        table.sel(a=np.complex128(1.0))
    with pytest.raises(ValueError, match="a: a slice is from one number to another"):
        table.sel(a=slice("1", "2"))
    with pytest.raises(KeyError, match="no dimension named 'b'"):
        table.take("b", 0)
    for wrong in (2, -3, "0", 1.0, [True, False], [[0]]):
        with pytest.raises(IndexError, match="a has 2 positions, from 0, got"):
            table.take("a", wrong)
    for wrong in (0, ["value"], None):
        with pytest.raises(KeyError, match="no values named"):
            table[wrong]
    assert list(table) == ["value", "status"]
    assert "value" in table
    assert 0 not in table
    assert table.sel(a=jnp.asarray(2.0))["value"] == table.sel(a=np.array(2.0))["value"] == 2.0
    assert table.sel(a=jnp.asarray([2.0]))["value"].shape == (1,)
    assert np.isnan(jb.sweep(lambda a: a, {"a": [1.0, nan]}).sel(a=nan)["value"])


def test_files_that_are_no_tables(tmp_path):
    text, numbers, other = (tmp_path / name for name in ("a.txt", "a.npy", "a.npz"))
    text.write_text("a,b\n1,2\n")
    np.save(numbers, np.zeros(3))
    np.savez(other, x=np.zeros(3))
    (tmp_path / "empty.npz").touch()
    for path in (text, numbers, other, tmp_path / "empty.npz"):
        with pytest.raises(ValueError, match=f"^{path} is not a table: Table.save did not write"):
            jb.Table.load(path)
    with pytest.raises(FileNotFoundError, match=r"No such file or directory: '.*missing.npz'"):
        jb.Table.load(tmp_path / "missing.npz")
    with pytest.raises(ValueError, match=r"is not the folder of a sweep: it has no sweep.json"):
        jb.Table.load(tmp_path)


@pytest.mark.slow
def test_results_are_printed_copied_and_compared():
    def print_it(measured):
        result = jb.fit(functools.partial(measured_by, measured), FREE)
        assert str(result).startswith("Fit(")  # its numbers are not known yet
        return result

    def measured_by(measured, stiffness):
        return dataclasses.replace(found(stiffness), measured=measured[None])

    several = jax.jit(jax.vmap(print_it))(jnp.array([[3.5, 22.0], [3.6, 22.5]]))
    assert str(several) == "2 fits: 2 ok"
    one = jax.tree.map(lambda leaf: leaf[0] if jnp.ndim(leaf) else leaf, several)
    assert "95 % interval" in str(one)
    with pytest.raises(ValueError, match=r"^confidence must be between 0 and 1, got '0.9'"):
        one.interval("0.9")
    table = jb.sweep(lambda a: a, {"a": [1.0, 2.0]})
    for result in (table, jb.grid(a=[1.0, 2.0]), one):
        for same in (copy.deepcopy(result), pickle.loads(pickle.dumps(result))):
            assert str(same) == str(result)
    assert table != copy.deepcopy(table)  # by identity: arrays have no single answer


SHORT = """
import warnings
import jax, jax.numpy as jnp
import jaxbeam as jb

warnings.simplefilter("ignore")  # which says so, too

def run(speed):
    motion, rotor = jb.SmoothSpinUp(speed, 15.0), jb.Rotor(jb.Beam(8.0, 0.2, 5e6, 566.0, 566.0))
    times = jnp.array([0.0, 20.0])
    return jb.simulate(jb.Hybrid(0, 1, 0), rotor, motion, times, max_steps=3).tip

for call in (run, jax.jit(run)):
    try:
        jax.block_until_ready(call(jnp.asarray(4.0)))
    except (RuntimeError, ValueError) as error:
        print(str(error).replace(chr(10), " "))
"""


@pytest.mark.slow
def test_in_short_floats_a_run_that_ends_early_says_what_to_call():
    """In 32 bits, which JAX has by default, a tolerance may be out of reach."""
    said = run_optimised("-c", SHORT, level=0).splitlines()
    assert len(said) == 2
    for line in said:
        assert "used up max_steps" in line
        assert "32-bit floats" in line
        assert "jax.config.update('jax_enable_x64', True)" in line
    assert "Magnus" in jb.Status.MAX_STEPS.message


def test_times_of_jumps_may_be_traced_one_by_one():
    """In a list, which NumPy cannot make an array of."""

    @jax.jit
    def times(t):
        step = jb.motions.HubVelocity(
            lambda _: jnp.zeros(3), lambda s: jnp.where(s < t, 0.0, jnp.ones(3)), jumps=[t]
        )
        loads = jb.Loads(tip_force=jnp.ones(3), jumps=[t, 2 * t], changes=(t,))
        none = jb.Loads(jumps=[]), jb.Loads(jumps=np.zeros(0))
        assert not any(load.jump_times().size for load in none)
        return step.jump_times(), loads.jump_times(), loads.change_times()

    assert [list(each) for each in times(0.5)] == [[0.5], [0.5, 1.0], [0.5]]
    with pytest.raises(TypeError, match="jumps must be real numbers"):
        jb.Loads(jumps=[None])
    with pytest.raises(ValueError, match="jumps must be a list"):
        jb.Loads(jumps=[[0.5]])


def test_functions_of_numpy_are_told_to_be_of_jax():
    """Of x alone they may be of NumPy, also in a program that is being compiled."""

    def mean(width):
        plain = jb.blades.SpanwiseFunction(lambda xi: 2.0 + np.sin(xi))
        return jb.Beam(1.0, plain, width, 1.0, 1.0).mean.mass_per_length

    np.testing.assert_allclose(jax.jit(mean)(3.0), 3 - np.cos(1.0), rtol=1e-12)

    def sampled(function, a):
        return jb.blades.SpanwiseFunction(lambda xi: function(a) + xi).samples()

    told = r"function .*\(jnp\.sin for np\.sin\)"
    for bad in (np.sin, float):
        with pytest.raises(TypeError, match=told):
            jax.jit(functools.partial(sampled, bad))(1.0)
    with pytest.raises(TypeError, match=r"tip_force .*jnp\.sin for np"):
        jb.Loads(tip_force=lambda t: np.array([0.0, 0.0, 1.0]) * np.sin(t))
    with pytest.raises(TypeError, match=r"angular_velocity .*jnp\.where for if"):
        jb.motions.HubVelocity(
            lambda _: jnp.zeros(3), lambda t: jnp.ones(3) if t > 1 else jnp.zeros(3)
        )
