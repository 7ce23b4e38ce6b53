"""Answers of many cases by many models, each computed once."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._checks import real_scalar
from jaxbeam._ladder.background import BackgroundCompiler
from jaxbeam._ladder.deformed import straightened
from jaxbeam._ladder.evaluate import UNKNOWN
from jaxbeam._ladder.questions import Answer, Question
from jaxbeam._ladder.rungs import is_planar
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._rotor.beam import Rotor
from jaxbeam._sweeps.cases import Cases
from jaxbeam._sweeps.sweep import compiled, sweep
from jaxbeam._sweeps.table import Table
from jaxbeam._types import Scalar

Example = tuple[Rotor, Question]
Situation = Callable[..., Example]
SIZE = "deflection to expect"  # no parameter of the user's has this name


class Know(eqx.Module):
    """Facts that need no answer of a model: the steady strain, and whether all motion stays in the
    plane."""

    situation: Situation

    def __call__(self, **parameters: Scalar) -> dict[str, Any]:
        rotor, question = self.situation(**parameters)
        speed = question.speed()
        strain = jnp.abs(straightened(rotor).steady_strain(speed))
        status = rotor.status(jnp.zeros_like(speed))  # the rest is for the first answer to say
        return {"strain": strain, "planar": is_planar(question, rotor), "status": status}


class Ask(eqx.Module):
    """A function of one case that a sweep maps over cases: the answer by `model`."""

    situation: Situation
    model: AbstractModel
    accuracy: Scalar

    def __call__(self, **parameters: Scalar) -> Answer:
        size = parameters.pop(SIZE)
        rotor, question = self.situation(**parameters)
        return question.answer(self.model, rotor, self.accuracy, size)


def answers_in(table: Table) -> Answer:
    """The answers that a table holds, as one batched `Answer`."""
    leaves: list[Any] = [table[field.name] for field in dataclasses.fields(Answer)]
    return Answer(*leaves)


def some_of(answers: Answer, which: np.ndarray) -> Answer:
    """The part of a batched `Answer` that belongs to some cases."""
    return jax.tree.map(lambda leaf: leaf[which], answers)


class Pool:
    """Answers of cases by models, computed when asked for and kept."""

    def __init__(
        self, situation: Situation, cases: Cases, accuracy: float,
        compiler: BackgroundCompiler, **how: Any,
    ) -> None:  # fmt: skip
        self.compiler, self.situation, self.accuracy = compiler, situation, accuracy
        self.columns = cases.columns
        self.how, self.n = how, len(cases)  # how: chunk, devices and progress of `sweep`
        self.size, self.steps = np.full(self.n, UNKNOWN), np.zeros(self.n, int)
        self.found: dict[AbstractModel, Answer] = {}  # batched; status -1 where not asked

    def cases(self, which: np.ndarray, more: Mapping[str, np.ndarray]) -> Cases:
        """The cases `which`, filled up to whole chunks, since other sizes would need new
        programs."""
        chunk = self.how["chunk"]
        filled = np.resize(which, -(-len(which) // chunk) * chunk)
        columns = {name: c[filled] for name, c in {**self.columns, **more}.items()}
        return Cases({"row": np.arange(len(filled))}, columns)

    def run(self, function: Any, which: np.ndarray, **more: np.ndarray) -> Table:
        table = sweep(function, self.cases(which, more), **self.how)
        return table.take("row", np.arange(len(which)))

    def asks(self, model: AbstractModel, tighter: float = 1.0) -> Ask:
        return Ask(self.situation, model, real_scalar("accuracy", self.accuracy * tighter))

    def begin(self, *models: AbstractModel) -> None:
        """Compile, in the background, the programs of models that are to be asked soon."""
        some = self.cases(np.zeros(1, int), {SIZE: self.size})
        how = self.how["chunk"], self.how["devices"]
        for model in models:
            self.compiler.begin(model, functools.partial(compiled, self.asks(model), some, *how))

    def ask(self, model: AbstractModel, which: np.ndarray, tighter: float = 1.0) -> Table:
        """The table of answers of some cases by a model, which is not kept."""
        self.compiler.await_it(model)
        return self.run(self.asks(model, tighter), which, **{SIZE: self.size})

    def __call__(self, model: AbstractModel, which: np.ndarray) -> Answer:
        there = self.found.get(model)
        new = which if there is None else which[there.status[which] < 0]
        if new.size:
            # A batch goes on until its slowest case is done.
            new = new[np.argsort(self.steps[new], kind="stable")]
            self.keep(model, new, self.ask(model, new))
        return some_of(self.found[model], which)

    def keep(self, model: AbstractModel, which: np.ndarray, table: Table) -> None:
        """Remember the answers of these cases by a model."""
        new = answers_in(table)
        if model not in self.found:
            blank = jax.tree.map(lambda leaf: np.zeros((self.n, *leaf.shape[1:]), leaf.dtype), new)
            self.found[model] = dataclasses.replace(blank, status=np.full(self.n, -1))
        for kept, leaf in zip(*map(jax.tree.leaves, (self.found[model], new)), strict=True):
            kept[which] = leaf
