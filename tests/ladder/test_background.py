"""Programs compiled ahead of being called: how many, and that what cannot matter is none of them.

Numbers of programs do not depend on how busy the machine is, as times do.
"""

import threading

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._ladder import evaluate
from jaxbeam._ladder.background import BackgroundCompiler
from tests.beams import README_ROTOR
from tests.helpers import slender
from tests.ladder.questions import spin_up, steady

COMPILED: list[str] = []


@jax.monitoring.register_event_duration_secs_listener
def _listen(event: str, duration: float, **more: object) -> None:
    if event == "/jax/core/compile/backend_compile_duration":
        COMPILED.append(str(more.get("fun_name")))


@pytest.fixture
def compiled():
    """Names of the functions compiled since the test began, as in a fresh process."""
    jax.clear_caches()
    eqx.clear_caches()
    COMPILED.clear()
    return COMPILED


def large(names, name):
    """How many of them are answers: those that take long."""
    return sum(name in each for each in names)


def asked(choice):
    """Rungs that were asked, in words."""
    return {e.rung.name for e in choice.evidence if np.isfinite(e.estimate)}


def test_a_call_finds_the_program_compiled_ahead(compiled):
    """Else all would be compiled twice."""

    @eqx.filter_jit
    def squared(kind, x):
        return x * x if kind == "square" else x

    x = jnp.arange(3.0)
    with BackgroundCompiler() as compiler:
        compiler.begin("it", lambda: squared.lower("square", x).compile())
        compiler.await_it("it")
    before = large(compiled, "squared")
    np.testing.assert_array_equal(squared("square", x), [0.0, 1.0, 4.0])
    assert before == large(compiled, "squared") == 1


def test_ahead_keeps_its_order_and_waits_for_nothing_else():
    done, gate = [], threading.Event()
    with BackgroundCompiler() as compiler:
        compiler.threads._max_workers = 1
        compiler.begin("first", gate.wait)
        compiler.begin("first", lambda: done.append("twice"))
        compiler.begin("second", lambda: done.append("second"))
        compiler.begin("third", lambda: 1 / 0)
        compiler.await_it("second")  # has not begun: left to the caller
        compiler.await_it("unknown")
        gate.set()
        compiler.await_it("first")
        compiler.await_it("third")
        gate.clear()
        compiler.begin("fourth", gate.wait)
        compiler.begin("fifth", lambda: done.append("fifth"))
    gate.set()
    compiler.threads.shutdown(wait=True)
    assert done == []


def readme():
    """The question in the docstring of `jaxbeam.ladder`."""
    motion = jb.SmoothSpinUp(4.0, duration=15.0)
    return README_ROTOR, jb.ladder.PeakDeflection(motion, jnp.linspace(0.0, 20.0, 201))


@pytest.mark.exhaustive
def test_programs_of_a_choice(compiled):
    """Four rungs suffice, and a second choice needs no program."""
    choice = jb.choose_model(*readme(), tolerance=1e-2)
    assert choice.met
    assert asked(choice) == {"hybrid, 1 mode", "hybrid, 4 functions", "4 elements", "8 elements"}
    assert large(compiled, "_answer") == 4
    assert len(compiled) <= 16  # some of one operation
    compiled.clear()
    jb.choose_model(*readme(), tolerance=1e-2)
    assert compiled == []


@pytest.mark.exhaustive
def test_no_linear_rung_where_linear_theory_misses(compiled):
    """One has said so, of which there are seven; and none of the elements that are too coarse."""
    rotor, question = spin_up(1.5, 3.0)
    choice = jb.choose_model(rotor, question, 1e-3)
    assert choice.met
    assert choice.indicators.size > 0.05
    assert {name for name in asked(choice) if "elements" not in name} == {"hybrid, 4 functions"}
    assert asked(choice) >= {"4 elements", "8 elements"}
    assert large(compiled, "_answer") == len(asked(choice)) <= 4
    said = {e.rung.name: e.verdict for e in choice.evidence}
    assert said["2 elements"].startswith("ruled out: 4 elements: ")


@pytest.mark.exhaustive
def test_programs_of_a_choice_of_frequencies(compiled):
    question = jb.ladder.ModalFrequencies(1.0, jb.labels(in_plane=2))
    choice = jb.choose_model(slender(1000.0), question, 1e-2)
    assert choice.met
    assert large(compiled, "_answer") == len(asked(choice)) <= 5


@pytest.mark.exhaustive
def test_programs_of_a_sweep(compiled):
    """What is known without an answer, two linear rungs and three of elements, at most."""
    cases = jb.grid(gamma=[0.5, 2.0, 5.0], hub=[0.0, 1.0])
    table = jb.ladder_sweep(steady, cases, 1e-2, representatives=4, chunk=4)
    assert (table["status"] == 0).all()
    assert large(compiled, "batched") <= 6
    compiled.clear()
    jb.ladder_sweep(steady, cases, 1e-2, representatives=4, chunk=4)
    assert compiled == []


def stout(gamma):
    """Strains of some per cent, which linear theory does not bear."""
    return slender(30.0), jb.ladder.ModalFrequencies(gamma, jb.labels(in_plane=1))


@pytest.mark.exhaustive
def test_no_linear_rung_in_a_sweep_that_is_beyond_them(compiled):
    """But the one that looks first."""
    cases = jb.points(gamma=[10.0, 11.0])
    table = jb.ladder_sweep(stout, cases, 1e-3, representatives=2, chunk=2)
    assert all(name.endswith("elements") for name in table["rung"])
    assert large(compiled, "batched") <= 5


@pytest.mark.exhaustive
def test_a_long_run_is_made_anew(compiled, monkeypatch):
    """By a program that is compiled well: the first one gives up before that takes longer."""
    monkeypatch.setattr(evaluate, "STEPS", 3)
    rotor, question = readme()
    answer = jb.ladder.evaluate(jb.Hybrid(0, 1, 0), rotor, question)
    assert answer.status == jb.Status.OK
    assert answer.steps > 3
    assert large(compiled, "_answer") == 2
    compiled.clear()
    again = jb.ladder.evaluate(jb.Hybrid(0, 1, 0), rotor, question)
    np.testing.assert_array_equal(again.value, answer.value)
    assert compiled == []
