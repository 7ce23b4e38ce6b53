"""No more model than a question needs: of the rungs of the ladder, the one to stand on.

The finest of the non-linear rungs that has converged is the judge of all cheaper ones; what is
known beforehand, or follows from rungs that were asked, says which need not come before the judge.
In a fresh process nearly all time is compilation, a program for each rung: so what is sure to be
asked is compiled side by side, and what cannot matter is not.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from jaxbeam._checks import real_scalar
from jaxbeam._ladder.background import BackgroundCompiler
from jaxbeam._ladder.choice import NOT_NEEDED, Choice, Evidence
from jaxbeam._ladder.evaluate import UNKNOWN, answer_of, prepare_answer
from jaxbeam._ladder.questions import Answer, Question, checked_question
from jaxbeam._ladder.rungs import (
    Indicators,
    Rung,
    chains,
    check_answerable,
    convergence_factor,
    indicators,
    is_planar,
    judges,
    left_out_by,
    ruled_out,
    rungs_of,
    scout_of,
)
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._results import finish, replaced
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.checked import checked_rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._status import Status

INTEGRATION = 0.05  # share of the tolerance left to numerical integration
JUDGE = 1.0  # difference of the last two rungs of the judge that is allowed, over the tolerance
LARGE = 0.1  # and where the scout fails
_UNCONFIRMED = 0.25  # error, over the tolerance, that two rungs which agree first may both have
# And any two: loads that set in at once shake high modes, whose errors fall but slowly.
_LEAST = 0.05


def checked_tolerance(tolerance: float) -> float:
    """The tolerance as a float, or an error where it is not a positive number."""
    if isinstance(tolerance, bool) or not isinstance(tolerance, int | float | np.floating):
        raise TypeError(f"tolerance must be a number, got {type(tolerance).__name__}")
    if not 1e-8 <= tolerance < 1:
        raise ValueError(f"tolerance must be between 1e-8 and 1, got {tolerance}")
    return float(tolerance)


def choose_model(
    rotor: Rotor, question: Question, tolerance: float = 1e-3, *,
    models: Sequence[AbstractModel] = (), throw: bool = True,
) -> Choice:  # fmt: skip
    """The cheapest model that answers a question about a rotor to a relative `tolerance`.

    `rotor` is a `Rotor`, `question` a `Question`, `tolerance` from 1e-8 to below 1. `models` are
    some of your own, each one more rung beside those there are (`jaxbeam.ladder.rungs`). Returns a
    `jaxbeam.ladder.Choice`.

    `DeflectionHistory`, `PeakDeflection`, `RootStrain` and `ModalFrequencies` are questions. First
    a linear theory in bending says how large deflections are, and `Indicators` rule out what cannot
    do. Then exact rods are refined until the last two differ by less than the tolerance, those in
    the plane from four elements on, those in space in degree from four: they are the judge. In
    space that takes the `torsional_stiffness` of the beam; where it is not given von Karman beams
    judge there, and estimates have their own error on top, twice the square of the deflection over
    length plus the strain. What rods in space alone bear (a moment at the tip or a load that
    follows it, motion in a cone, full sections, supports) is answered by these alone, and the
    coarsest of them looks first. Cheaper rungs are tried in order of cost until one agrees, but for
    those that a better one of their kind, far off itself, rules out. The estimate of a rung is its
    distance from the judge, plus what the judge may be off, a twentieth of the tolerance at least,
    plus what ten times tighter integration changes.

    The judge's material has the engineering strain (`PlanarRod`, `SpatialRod`). To estimates of
    rungs of any other axial law is added what laws that agree at small strains may differ by, from
    the strains that the judge meets: see `Answer.constitutive_uncertainty`, which
    `Choice.constitutive_uncertainty` repeats.

    It takes the time of the judge and half of it again, seldom that of the finest rods; each
    model is compiled once for all questions of a kind, side by side on the cores there are. For
    many cases use `ladder_sweep`.

    `throw=False` returns in `Choice.status` what depends on the numbers: that no rung was found to
    meet the tolerance (`TOLERANCE_NOT_MET`; the best answer is in `Choice.partial`), or that none
    has an answer, and why.

    Raises `ValueError` or `TypeError` for a malformed argument, or where rods in space alone
    could answer and the beam has no `torsional_stiffness`; and, with `throw`, `ValueError` for
    parameters out of range and `RuntimeError` else, with what was found as a note.
    """
    checked_question(question)
    rotor, tolerance = checked_rotor(Rotor, rotor), checked_tolerance(tolerance)
    check_answerable(question, rotor)
    with BackgroundCompiler() as compiler:
        asker = _Asker(question, rotor, INTEGRATION * tolerance, compiler)
        choice = _chosen(asker, tolerance, models)
    return finish(choice, throw, noted=True)


def _chosen(ask: "_Asker", tolerance: float, own: Sequence[AbstractModel]) -> Choice:
    question, rotor = ask.question, ask.rotor
    planar = bool(is_planar(question, rotor))
    linear, nonlinear = chains(question, rotor, planar)
    rungs, elements = rungs_of(question, rotor, planar, own), judges(nonlinear, rotor)
    scout = scout_of(linear, elements)
    seen, beforehand = _scouted(ask, scout, elements)
    given = Status(int(seen.status))
    if given.blames_input and given != Status.OUT_OF_PLANE:  # others may have flap
        return _none(given, seen, beforehand, tolerance, ())
    if planar:
        in_plane = beforehand.timoshenko_reduction[:1]
        beforehand = replaced(beforehand, timoshenko_reduction=in_plane)
    if linear and 0.3 * beforehand.size**2 <= tolerance:  # what linear theory leaves out as a rule
        cheaper = itertools.takewhile(lambda rung: rung.model != elements[1], rungs)
        ask.begin(*[r.model for r in cheaper if not ruled_out(r.model, beforehand, tolerance)][:1])

    share = convergence_factor(question, rotor, elements[0])
    place, left, _ = refined(ask.batch, 1, elements, tolerance, share)
    judge = elements[place[0]]
    noise = ask.now(judge, 0.1).distance(ask(judge))
    error = float(left[0] + noise) + left_out_by(judge, beforehand)
    trial = _Trial(ask, tolerance, beforehand, scout, nonlinear, judge, error)
    for model in (scout, *elements):
        if model in ask.found or model == scout:
            trial.estimates[model] = trial.estimate(model)
    enough = next(rung.cost for rung in rungs if rung.model == judge)
    for rung in rungs:  # whatever costs less than the judge is asked, from the cheapest on
        trial.look_at(rung, may_ask=rung.cost < enough)
    return trial.choice(rungs)


def _none(
    status: Status, seen: Answer, beforehand: Indicators, tolerance: float,
    evidence: tuple[Evidence, ...],
) -> Choice:  # fmt: skip
    """The result of a search without a choice, with the reason by `seen`, an answer that failed."""
    return Choice(
        rung=None,
        estimate=np.inf,
        status=status,
        tolerance=tolerance,
        partial=np.full_like(seen.value, np.nan),
        constitutive_uncertainty=np.nan,
        indicators=jax.tree.map(lambda a: np.full_like(a, np.nan), beforehand),
        evidence=evidence,
    )


def _scouted(
    ask: "_Asker", scout: AbstractModel, elements: list[AbstractModel]
) -> tuple[Answer, Indicators]:
    """The scout's answer to a question, and the size of deflections, which `ask` is told. In the
    meantime programs are compiled that are sure to be needed."""
    question, rotor = ask.question, ask.rotor
    ask.begin(scout)
    ask.compiler.begin(Indicators, functools.partial(indicators.prepare, question, rotor))
    ask.begin(*elements[:2])
    seen = ask.now(scout)
    given = Status(int(seen.status))
    ask.compiler.await_it(Indicators)
    beforehand = jax.device_get(indicators(question, rotor))
    if given == Status.OK:
        beforehand = replaced(beforehand, size=seen.size, slope=seen.slope)
    ask.size = float(np.clip(beforehand.size, 1e-9, 1.0)) if given == Status.OK else LARGE
    return seen, beforehand


class _Asker:
    """A rotor and a question that rungs are asked, with the answers so far."""

    def __init__(
        self, question: Question, rotor: Rotor, accuracy: float, compiler: BackgroundCompiler
    ) -> None:
        self.question, self.rotor = question, rotor
        self.accuracy, self.compiler = accuracy, compiler
        self.size = UNKNOWN
        self.found: dict[AbstractModel, Answer] = {}

    def given(self, model: AbstractModel, tighter: float = 1.0) -> tuple[Any, ...]:
        # Arrays that are not weakly typed, as those of `ask`: else all would compile twice.
        how = (real_scalar("accuracy", self.accuracy * tighter), real_scalar("size", self.size))
        return self.question, self.rotor, model, *how

    def begin(self, *models: AbstractModel) -> None:
        """Compile, in the background, the programs of models that are to be asked soon."""
        for model in models:
            self.compiler.begin(model, functools.partial(prepare_answer, *self.given(model)))

    def now(self, model: AbstractModel, tighter: float = 1.0) -> Answer:
        """The answer of a model now, which is not kept."""
        self.compiler.await_it(model)
        return jax.device_get(answer_of(*self.given(model, tighter)))

    def __call__(self, model: AbstractModel) -> Answer:
        if model not in self.found:
            self.found[model] = self.now(model)
        return self.found[model]

    def batch(self, model: AbstractModel, _: np.ndarray) -> Answer:
        """The answer as that of a batch of one."""
        return jax.tree.map(lambda leaf: np.asarray(leaf)[None], self(model))

    def apart(self, model: AbstractModel, better: AbstractModel) -> float:
        return float(self(model).distance(self(better)))


def refined(
    ask: Callable[[AbstractModel, np.ndarray], Answer], cases: int, elements: list[AbstractModel],
    tolerance: float, share: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """The judge of each of so many cases, as its place among elements that are refined until the
    answer stands still, its possible error, and whether it does stand still. Where a finer one
    fails, the finest that another confirms. `ask` answers some of the cases, in a batch."""
    judge, steady = np.ones(cases, int), np.zeros(cases, bool)
    left, before = np.full((2, cases), np.inf)
    going = np.arange(cases)
    for k, pair in enumerate(itertools.pairwise(elements), 1):
        coarse, fine = (ask(model, going) for model in pair)
        apart, last = coarse.distance(fine), before[going]
        # Two rungs may agree by chance: so little is left only if those before agreed as well.
        confirmed = np.where(
            np.isinf(last), np.minimum(apart / 2, _UNCONFIRMED * tolerance), share**2 * last
        )
        here = np.maximum(share * apart, confirmed)
        fails = np.isfinite(left[going]) & ~np.isfinite(apart)
        # Finer ones vibrate faster.
        fails |= (coarse.status == Status.MAX_STEPS) & (fine.status == Status.MAX_STEPS)
        on = going[~fails]
        judge[on], left[on], before[on] = k, here[~fails], apart[~fails]
        steady[on] = np.maximum(before, left)[on] <= JUDGE * tolerance
        going = on[~steady[on]]
        if not going.size:
            break
    return judge, np.maximum(left, _LEAST * tolerance), steady


@dataclasses.dataclass
class _Trial:
    """The trial of the rungs before the judge: their errors as far as known, and the verdict on
    each.

    The judge may be off by `left`.
    """

    ask: _Asker
    tolerance: float
    beforehand: Indicators
    scout: AbstractModel
    nonlinear: list[AbstractModel]
    judge: AbstractModel
    left: float
    estimates: dict[AbstractModel, float] = dataclasses.field(default_factory=dict)
    verdicts: dict[AbstractModel, str] = dataclasses.field(default_factory=dict)
    # Rungs that were asked, by kind of model.
    tried: dict[Any, list[AbstractModel]] = dataclasses.field(default_factory=dict)
    chosen: Rung | None = None

    @property
    def constitutive_uncertainty(self) -> float:
        """The change of the answer that another axial law might make, by the strains of the
        judge."""
        return float(self.ask(self.judge).constitutive_uncertainty)

    def estimate(self, model: AbstractModel) -> float:
        """The error of a rung, which is asked for it."""
        apart = self.ask.apart(model, self.judge)
        # If its law is another one what that may change counts, even if it agrees by chance.
        law = 0.0 if model.is_reference else self.constitutive_uncertainty
        return apart + self.left + law if np.isfinite(apart) else np.inf

    def look_at(self, rung: Rung, may_ask: bool) -> None:
        """Give the verdict on a rung; it is asked only if none is chosen yet and `in_vain` has no
        reason against it."""
        model = rung.model
        before = self.tried.setdefault((type(model), _stretches(model)), [])
        if may_ask and self.chosen is None and model not in self.estimates:
            if why := self.in_vain(model, before):
                self.verdicts[model] = f"ruled out: {why}"
                return
            self.estimates[model] = self.estimate(model)
        if model not in self.estimates:
            return
        before.append(model)
        status = Status(int(self.ask(model).status))
        self.verdicts[model] = "misses it" if status == Status.OK else status.name
        if self.estimates[model] <= self.tolerance:
            self.verdicts[model] = "meets it" if self.chosen is None else "meets it too"
            self.chosen = self.chosen or rung

    def in_vain(self, model: AbstractModel, before: list[AbstractModel]) -> str:
        """The reason why a rung need not be asked; empty if it has to be."""
        if why := ruled_out(model, self.beforehand, self.tolerance) or self.misses(model):
            return why
        stuck = len(before) > 1 and (
            self.ask.apart(*before[-2:]) < 0.1 * self.estimates[before[-1]]
        )
        return "more functions do not help" if stuck else ""

    def misses(self, model: AbstractModel) -> str:
        """The evidence against a rung from the answers of rungs that were asked."""
        if model in self.nonlinear:  # half as fine is four times as wrong, or more
            finer = self.nonlinear[self.nonlinear.index(model) :]
            better = next(m for m in finer if m in self.estimates)
            if self.estimates[better] > self.tolerance / 4:
                return f"{better.title}: {self.estimates[better]:.2g}"
        scout = self.scout
        poor = 3 * self.tolerance
        if not (model.is_linear and scout.is_linear):
            return ""
        if self.ask.apart(scout, self.judge) > poor:
            # Another linear theory is no better, but by more functions, or in its stretch.
            bends = [m.directions.count(Direction.IN_PLANE) for m in (model, scout)]
            less = bends[0] <= bends[1] and not _stretches(model)
            if less or 0.1 * self.beforehand.size**2 > self.tolerance:
                return f"{scout.title}: {self.estimates[scout]:.2g}"
        return ""

    def choice(self, rungs: list[Rung]) -> Choice:
        """The choice, after all rungs have a verdict."""
        estimates, verdicts = self.estimates, self.verdicts
        evidence = tuple(
            Evidence(r, estimates.get(r.model, np.nan), verdicts.get(r.model, NOT_NEEDED))
            for r in rungs
        )
        best = self.chosen or _best(self.ask, evidence)
        if isinstance(best, Answer):
            return _none(Status(int(best.status)), best, self.beforehand, self.tolerance, evidence)
        return Choice(
            rung=best,
            estimate=estimates.get(best.model, np.inf),
            status=Status.OK if self.chosen else Status.TOLERANCE_NOT_MET,
            tolerance=self.tolerance,
            partial=np.asarray(self.ask(best.model).value),
            constitutive_uncertainty=self.constitutive_uncertainty,
            indicators=self.beforehand,
            evidence=evidence,
        )


def _stretches(model: AbstractModel) -> bool:
    return Direction.AXIAL in model.directions


def _best(ask: _Asker, evidence: tuple[Evidence, ...]) -> Rung | Answer:
    """The rung to take where none is good enough: that of the least estimate, else the richest with
    an answer, else the richest that was asked, which failed."""
    answers = [e for e in evidence if np.isfinite(e.estimate)]
    if answers:
        return min(answers, key=lambda e: e.estimate).rung
    asked = [e.rung for e in evidence if e.rung.model in ask.found]
    fine = [rung for rung in asked if int(ask(rung.model).status) == Status.OK]
    return fine[-1] if fine else ask(asked[-1].model)
