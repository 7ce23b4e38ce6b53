"""Programs that are compiled ahead of being called, and once."""

import threading

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._ladder import evaluate
from jaxbeam._ladder.background import BackgroundCompiler
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


@pytest.mark.exhaustive
def test_a_second_choice_compiles_nothing(compiled):
    rotor, question = spin_up(1.5, 3.0)
    assert jb.choose_model(rotor, question, 1e-2).met
    assert large(compiled, "_answer") > 0
    compiled.clear()
    jb.choose_model(rotor, question, 1e-2)
    assert compiled == []


@pytest.mark.exhaustive
def test_a_second_sweep_compiles_nothing(compiled):
    cases = jb.grid(gamma=[0.5, 2.0, 5.0], hub=[0.0, 1.0])
    table = jb.ladder_sweep(steady, cases, 1e-2, representatives=4, chunk=4)
    assert (table["status"] == 0).all()
    assert large(compiled, "batched") > 0
    compiled.clear()
    jb.ladder_sweep(steady, cases, 1e-2, representatives=4, chunk=4)
    assert compiled == []


@pytest.mark.exhaustive
def test_a_long_run_is_made_anew(compiled, monkeypatch):
    """By a program that is compiled well: the first one gives up before that takes longer."""
    monkeypatch.setattr(evaluate, "STEPS", 3)
    rotor, question = spin_up(2.0, 5.0)
    answer = jb.ladder.evaluate(jb.Hybrid(0, 1, 0), rotor, question)
    assert answer.status == jb.Status.OK
    assert answer.steps > 3
    assert large(compiled, "_answer") == 2
    compiled.clear()
    again = jb.ladder.evaluate(jb.Hybrid(0, 1, 0), rotor, question)
    np.testing.assert_array_equal(again.value, answer.value)
    assert compiled == []
