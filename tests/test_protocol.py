"""One protocol for failure, of every public function: what depends on numbers raises the sentence
of a status, or, with `throw=False`, is that status, beside numbers that are NaN."""

import dataclasses
import importlib
import inspect
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import Status
from tests.package import SUBJECTS
from tests.tiers import exhaustive

SPRINGS = jb.papers.SpringRotor(1.3, 0.8, 0.4, 6000.0, 30.0)
DISCRETE = jb.papers.DiscreteLC(), SPRINGS
BEAM = jb.Beam.from_slenderness(70.0)
ROTOR = jb.Rotor(BEAM, 0.1, 0.3)
FIRST = jb.labels(in_plane=1)
TIMES = jnp.linspace(0.0, 4.0, 5)
SHORT_BLADE = jb.blades.Blade.of(jb.Beam(1.0, 1.0, 1e4, 1.0, 2.0, torsional_stiffness=1.0))


class Failing(NamedTuple):
    """What a function says of a number that is good, and of one with which it fails."""

    call: Callable[..., Any]  # of the number, and `throw`
    good: float
    bad: float
    status: Status


def slope_where_there_is_none(width, **how):
    """Of a straight line through points that lie within `width` of each other."""
    x = np.linspace(-1.0, 2.0, 6)

    class Line(jb.fitting.Experiment):
        level: jax.Array
        slope: jax.Array
        measured: jax.Array
        noise: jax.Array

        def predicted(self):
            return self.level + self.slope * width * x

    def line(level, slope):
        return Line(level, slope, jnp.asarray(0.4 + 0.1 * np.cos(9 * x)), 0.1 * jnp.ones(6))

    return jb.fit(line, {name: jb.FreeParameter(0.5) for name in ("level", "slope")}, **how)


FAILING = {
    "models.AbstractModel.linearise": Failing(
        lambda x, **how: DISCRETE[0].linearise(SPRINGS, x, **how),
        1.0, np.nan, Status.INVALID_ANGULAR_SPEED,
    ),
    "modes": Failing(
        lambda x, **how: jb.modes(*DISCRETE, x, 1, **how), 1.0, 90.0, Status.NO_EQUILIBRIUM
    ),
    "southwell": Failing(
        lambda x, **how: jb.southwell(*DISCRETE, x, 1, **how), 1.0, 90.0, Status.NO_EQUILIBRIUM
    ),
    "stiffening_ratio": Failing(
        lambda x, **how: jb.stiffening_ratio(ROTOR, x, **how), 1.0, 1e200, Status.NOT_FINITE
    ),
    "crossing": Failing(
        lambda x, **how: jb.crossing(*DISCRETE, (0.1, 4.0), FIRST[0], x, **how),
        3.0, 1e-3, Status.NO_CROSSING,
    ),
    "critical_speed": Failing(
        lambda x, **how: jb.critical_speed(
            jb.Hybrid(0, 2, 0), ROTOR, loads=jb.Loads(tip_force=jnp.stack([-x, 0 * x, 0 * x])),
            **how,
        ), 1.0, 9.0, Status.BUCKLED,
    ),
    "critical_load": Failing(
        lambda x, **how: jb.critical_load(
            jb.Hybrid(0, 2, 0), ROTOR, jb.Loads(tip_force=[-1.0, 0.0, 0.0]), x, **how
        ), 1.0, np.nan, Status.INVALID_ANGULAR_SPEED,
    ),
    "floquet": Failing(
        lambda x, **how: jb.floquet(
            *DISCRETE, jb.motions.ModulatedSpeed(1.0, 0.1, x), steps=64, **how
        ), 5.0, 1e-3, Status.TOO_FEW_STEPS,
    ),
    "tongue": Failing(
        lambda x, **how: jb.tongue(
            jb.Hybrid(0, 1, 0), ROTOR, 1.0, FIRST * 2, [0.1], damping=jb.Damping(x), **how
        ), 1e-3, 3.0, Status.NO_TONGUE,
    ),
    "simulate": Failing(
        lambda x, **how: jb.simulate(
            jb.Hybrid(0, 1, 0), ROTOR, jb.SmoothSpinUp(x, 3.0), TIMES, max_steps=100, **how
        ), 1.0, 1e3, Status.MAX_STEPS,
    ),
    "steady_start": Failing(
        lambda x, **how: jb.steady_start(jb.PlanarRod(1), ROTOR, jb.ConstantSpeed(x), **how),
        1.0, 1e3, Status.NOT_CONVERGED,
    ),
    "steady": Failing(
        lambda x, **how: jb.steady(jb.PlanarRod(1), ROTOR, x, **how),
        1.0, 1e3, Status.NOT_CONVERGED,
    ),
    "fit": Failing(slope_where_there_is_none, 1.0, 0.0, Status.NOT_IDENTIFIABLE),
    "solvers.stable_step": Failing(
        lambda x, **how: jb.solvers.stable_step(*DISCRETE, x, diffrax.Bosh3(), **how),
        1.0, 20.0, Status.NO_EQUILIBRIUM,
    ),
    "solvers.amplification": Failing(
        lambda x, **how: jb.solvers.amplification(diffrax.Bosh3(), x, **how),
        1.0, 1e200, Status.NOT_FINITE,
    ),
    "blades.reduction": Failing(
        lambda x, **how: jb.blades.reduction(
            jb.Rotor(SHORT_BLADE, x), 1, rod=jb.SpatialRod(2), **how
        ), 1.0, np.inf, Status.INVALID_HUB_RADIUS,
    ),
    "ladder.evaluate": Failing(
        lambda x, **how: jb.ladder.evaluate(
            jb.Hybrid(0, 1, 0), ROTOR,
            jb.ladder.PeakDeflection(jb.SmoothSpinUp(x, 3.0), TIMES, max_steps=100), **how,
        ), 1.0, 1e3, Status.MAX_STEPS,
    ),
}  # fmt: skip
QUICK = ("solvers.amplification",)
# What a result says of its case whether or not that failed: how far a search came, and what was
# given to it.
BESIDE = {
    "Modes": ("residual", "frequency_error"),
    "Crossing": ("harmonic",),
    "Tongue": ("depth", "onset"),
    "SteadyStart": ("v", "work"),
    "Answer": ("steps",),
}


def numbers(result):
    """What a result answers with: by name, what is real or complex."""
    if isinstance(result, jb.results.Simulation):
        return {"peak": result.peak()}
    if isinstance(result, jb.results.Fit):
        return {"parameters": result.parameters, "deviation": result.standard_deviation}
    fields = dataclasses.fields(result) if dataclasses.is_dataclass(result) else ()
    asked_with = [field.name for field in fields if field.metadata.get("asked_with")]
    beside = (*BESIDE.get(type(result).__name__, ()), *asked_with)
    found = {name: getattr(result, name) for name in vars(result) if name not in beside}
    return eqx.filter(found, eqx.is_inexact_array)


@pytest.mark.parametrize("name", [n if n in QUICK else exhaustive(n) for n in FAILING])
def test_what_fails_raises_or_carries_a_status(name):
    call, good, bad, status = FAILING[name]
    fails = pytest.raises(ValueError if status.blames_input else RuntimeError)
    with fails as caught:
        call(jnp.asarray(bad))
    assert str(caught.value).startswith(status.message)
    alone = call(jnp.asarray(good))
    assert np.all(alone.status == Status.OK)

    def case(x):
        found = call(x, throw=False)
        return found.status, numbers(found)

    batch = jax.jit(jax.vmap(case))
    (told, values), (fine, others) = (batch(jnp.array([good, x])) for x in (bad, good))
    assert np.all(told[0] == Status.OK)
    assert np.all(told[1] == status)
    assert np.all(fine == Status.OK)
    expected = jax.tree.leaves(numbers(alone))
    assert len(expected) == len(jax.tree.leaves(values)) > 0
    for one, value, other in zip(expected, *map(jax.tree.leaves, (values, others)), strict=True):
        assert np.isnan(value[1]).all()
        np.testing.assert_array_equal(value[0], other[0])  # whatever is beside it
        np.testing.assert_allclose(value[0], one, rtol=1e-8, atol=1e-10)


# A batch has a status for each of its cases, and never raises for one: `throw` has no meaning.
BATCHES = ("sweep", "ladder_sweep", "campbell")
# Nothing that these return depends on whether numbers are good: they check arguments, and raise at
# once for those that are not.
CHECK_ALONE = (
    "labels",  # names
    "programs.compile_well",  # a choice
    "keep",  # a folder: refused, or a warning and no more
    "programs.keep",
    "programs.kept",  # a function, which fails as it does
    "grid",  # parameters, as they were given
    "points",
    "rpm",  # a product
    "deflection_limit",  # an event
    "motions.inclined_axis",  # a cosine and a sine: NaN for NaN, of which what takes it tells
    "ladder.rungs",  # models, of which none is asked
    "blades.read_blade",  # files: read, or refused with the line that is wrong
    "blades.section_stiffness",  # matrices, which a Blade checks
    "blades.section_inertia",
    "blades.read_beamdyn",
    "blades.read_hawc2",
    "blades.read_vabs",
    "blades.read_windio",
    "blades.write_beamdyn",
    "blades.write_elastodyn",
    "blades.write_hawc2",
)
IN_PYTHON = ("choose_model",)  # no function of JAX: tested below


def functions():
    """All public functions, and the method of models that fails as functions do."""
    found = {"models.AbstractModel.linearise": jb.models.AbstractModel.linearise}
    for name, room in jb._ROOMS.items():
        if room != "jaxbeam" and inspect.isfunction(getattr(jb, name)):
            found[name] = getattr(jb, name)
    for subject in SUBJECTS:
        for name, value in vars(importlib.import_module(f"jaxbeam.{subject}")).items():
            if name[0] != "_" and inspect.isfunction(value):
                found[f"{subject}.{name}"] = value
    return found


def test_every_public_function_is_of_one_of_these_kinds():
    """A new one that can fail takes `throw`, and a place among `FAILING`."""
    all_of_them = functions()
    throwing = {n for n, f in all_of_them.items() if "throw" in inspect.signature(f).parameters}
    assert throwing == {*FAILING, *IN_PYTHON}
    assert set(all_of_them) - throwing == {*BATCHES, *CHECK_ALONE}
    assert len(throwing) == 18
    for name in throwing:
        throw = inspect.signature(all_of_them[name]).parameters["throw"]
        assert throw.kind is throw.KEYWORD_ONLY
        assert throw.default is True
        assert "throw" in all_of_them[name].__doc__


def test_arguments_come_in_one_order():
    """Model, rotor, what is asked; then what may be left out, by keyword alone from `loads` on."""
    for name, function in functions().items():
        given = [p for p in inspect.signature(function).parameters.values() if p.name != "self"]
        names = [p.name for p in given]
        first = [n for n in ("model", "rotor") if n in names]
        assert names[: len(first)] == first, name
        for parameter in given:
            if parameter.name in ("loads", "damping", "steps", "max_steps", "devices", "progress"):
                asked = name == "critical_load"  # the least factor of these loads
                assert asked or parameter.kind is parameter.KEYWORD_ONLY, name


@pytest.mark.exhaustive
def test_a_batch_has_a_status_for_each_case_and_never_raises():
    speeds = [1.0, np.nan, 90.0, 2.0]
    diagram = jb.campbell(*DISCRETE, speeds, FIRST)
    bad = [Status.INVALID_ANGULAR_SPEED, Status.NO_EQUILIBRIUM]
    assert diagram.status.tolist() == [Status.OK, *bad, Status.OK]
    frequency = diagram.table["frequency"][:, 0]
    np.testing.assert_array_equal(np.isnan(frequency), [False, True, True, False])
    np.testing.assert_array_equal(
        jb.campbell(*DISCRETE, [1.0, 3.0, 4.0, 2.0], FIRST).table["frequency"][[0, 3], 0],
        frequency[[0, 3]],
    )
    assert (jb.campbell(*DISCRETE, [90.0], FIRST).status == Status.NO_EQUILIBRIUM).all()


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("loads", "max_steps", "status"),
    [
        (jb.Loads(tip_force=lambda t: jnp.array([0.0, 0.0, 1.0]) / (4 - t)), 20_000,
         Status.INVALID_LOAD),
        (jb.Loads(), 1, Status.MAX_STEPS),
    ],
    ids=["load", "steps"],
)  # fmt: skip
def test_a_choice_that_there_is_not(loads, max_steps, status):
    motion = jb.SmoothSpinUp(3.0, 3.0, jb.motions.inclined_axis(0.5))
    question = jb.ladder.PeakDeflection(motion, TIMES, loads=loads, max_steps=max_steps)
    choice = jb.choose_model(ROTOR, question, 1e-2, throw=False)
    assert choice.status == status
    assert choice.rung is choice.model is None
    assert not choice.met
    assert np.isinf(choice.estimate)
    assert np.isnan(choice.answer).all()
    assert np.isnan(choice.partial).all()
    assert np.isnan(choice.indicators.size)
    assert status.message in str(choice)
    fails = pytest.raises(ValueError if status.blames_input else RuntimeError)
    with fails as caught:
        jb.choose_model(ROTOR, question, 1e-2)
    assert re.match(re.escape(status.message), str(caught.value))
