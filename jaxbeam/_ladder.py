"""No more model than a question needs: rungs from cheap to rich, and the one to stand on.

Two chains make up the ladder. *Linear* theories with 1, 2, 4, ... bending functions; they converge
at once, but to an answer that is wrong by what their theory leaves out. *Non-linear* ones, of which
elements converge to the right answer for a material of the engineering strain (`EngineeringANCF`;
in space, where there are none, von Karman beams do to second order of deflection over length). The
finest of the latter that has converged is the judge of all cheaper rungs; what is known beforehand
says which need not come before the judge.
"""

import dataclasses
import itertools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._basis import CantileverModes, Polynomials
from jaxbeam._beam import Rotor, checked_rotor, positive, real_scalar
from jaxbeam._indicators import stiffening_ratio
from jaxbeam._models.ancf import EngineeringANCF
from jaxbeam._models.base import AbstractModel, checked_model
from jaxbeam._models.modal import Classical, Hybrid, VonKarman
from jaxbeam._modes import modes
from jaxbeam._questions import Answer, ModalFrequencies, Question, checked_question
from jaxbeam._status import Status
from jaxbeam._types import Real, Scalar

ELEMENTS = (1, 2, 4, 8, 16, 32, 64)
INTEGRATION = 0.05  # of the tolerance, left to numerical integration
JUDGE = 0.5  # of the tolerance, by which the last two rungs of the judge may differ
SPACE = 2.0  # error of von Karman beams over `Indicators.reach`; 0.8 to 1.2 in studies/validity.py
UNKNOWN = 1e-4  # deflection over length to expect where nothing is known
LARGE = 0.1  # and where linear theory fails
NOT_NEEDED = "not needed"


class Rung(NamedTuple):
    """A model, and what it is expected to cost, over the cheapest of the ladder."""

    model: AbstractModel
    cost: float

    @property
    def name(self) -> str:
        """In words."""
        return describe(self.model)


def describe(model: AbstractModel) -> str:
    """A rung in words: theory and size."""
    if isinstance(model, EngineeringANCF):
        return f"{model.n_elements} element{'s' * (model.n_elements > 1)}"
    assert isinstance(model, Classical | Hybrid | VonKarman)
    n, flap = model.n_in_plane, model.n_flap
    kind = "mode" if isinstance(model.basis, CantileverModes) else "function"
    count = f"{n} and {flap} {kind}s" if flap else f"{n} {kind}{'s' * (n > 1)}"
    stretch = f", stretch {model.n_stretch}" if model.n_stretch else ""
    title = {Classical: "classical", Hybrid: "hybrid", VonKarman: "von Karman"}[type(model)]
    return f"{title}, {count}{stretch}"


def chains(question: Question, planar: bool) -> tuple[list[AbstractModel], list[AbstractModel]]:
    """Linear and non-linear models for a question, each from coarse to fine."""
    linear = [_modal(Hybrid, n, planar) for n in question.functions]
    if planar:
        return linear, [EngineeringANCF(n) for n in ELEMENTS if 2 * n >= question.functions[0]]
    return linear, [_modal(VonKarman, n, planar) for n in question.functions if n > 1]


def _modal(theory: type[Any], n: int, planar: bool, stretch: int = 0) -> AbstractModel:
    """With n functions across, each way. Those of von Karman's u1 follow u2'^2."""
    # One or two modes at rest do better than as many polynomials, from three on these win.
    stretch = 2 * n + 1 if theory is VonKarman else stretch
    few = n <= 2 and theory is not VonKarman
    basis = CantileverModes() if few else Polynomials()
    model: AbstractModel = theory(stretch, n, 0 if planar else n, basis=basis)
    return model


def ladder(question: Question, rotor: Rotor) -> list[Rung]:
    """All rungs for a question about a rotor, cheapest first, with the cost of a run to expect.

    In bending alone without (`Classical`) and with (`Hybrid`) motion-induced stiffness, stretch
    being left out (`RootStrain` has it quasi-statically); with stretch; von Karman; in the plane,
    elements. Nothing out of the plane where motion and loads stay in it.
    """
    checked_question(question)
    return rungs_of(question, bool(_planar(question, checked_rotor(Rotor, rotor))))


def rungs_of(question: Question, planar: bool) -> list[Rung]:
    """The same where it is known whether all stays in the plane."""
    linear, nonlinear = chains(question, planar)
    models = [_modal(Classical, n, planar) for n in question.functions if n < 8]
    models += [*linear, *nonlinear]
    for n in question.functions:
        models += [_modal(Hybrid, n, planar, n)] * (n >= 4)
        models += [_modal(VonKarman, n, planar)] * (n in (2, 4) and planar)
    costs = [_cost(question, model) for model in models]
    rungs = [Rung(m, cost / min(costs)) for m, cost in zip(models, costs, strict=True)]
    return sorted(rungs, key=lambda rung: rung.cost)


def _cost(question: Question, model: AbstractModel) -> float:
    """In us of a case in a batch on one core, roughly: of steps and unknowns. `studies/ladder.py`
    measures some."""
    n = len(model.families)
    if isinstance(question, ModalFrequencies):
        return 40 + 5e-3 * n**3
    if isinstance(model, EngineeringANCF):  # more than twice as many steps as linear motion
        return 2.3 * 200 * (2 + 2.2 * model.n_elements)
    step = (1.9 if isinstance(model, Classical) else 2) + 1.2 * n
    return 200 * step * (5 if isinstance(model, VonKarman) else 1)


class Indicators(eqx.Module):
    """What is known of a question before it is answered.

    | field            | shape |                                                                |
    |------------------|-------|----------------------------------------------------------------|
    | stiffening_ratio | ()    | motion-induced over elastic stiffness at the largest speed     |
    | steady_strain    | ()    | P(0) / EA at the largest speed                                 |
    | size             | ()    | largest deflection of the tip over the length, linear theory   |
    | slope            | ()    | largest slope there, of the same                               |
    | rest_frequency   | (6,)  | of the first bending modes in plane, rad/s                     |
    | excited          | (6,)  | how much each takes part in what the hub's rotation excites    |
    """

    stiffening_ratio: Scalar
    steady_strain: Scalar
    size: Scalar
    slope: Scalar
    rest_frequency: Array
    excited: Array

    @property
    def reach(self) -> Scalar:
        """What linear theories, and that of von Karman, leave out goes with this."""
        return self.size**2 + self.steady_strain


@eqx.filter_jit
def _indicators(question: Question, rotor: Rotor, found: Answer) -> Indicators:
    """`found` is the answer of a linear theory."""
    speed = question.speed()
    fine = found.status == Status.OK
    omega = modes(Hybrid(0, 8, 0), rotor, 0.0, 6, throw=False).frequency
    return Indicators(
        stiffening_ratio=stiffening_ratio(rotor, speed),
        steady_strain=rotor.steady_strain(speed),
        size=jnp.where(fine, found.size, jnp.inf),
        slope=jnp.where(fine, found.slope, jnp.inf),
        rest_frequency=omega,
        excited=question.excited(omega),
    )


@eqx.filter_jit
def _planar(question: Question, rotor: Rotor) -> Array:
    return question.planar(rotor)


def answer(
    question: Question,
    rotor: Rotor,
    model: AbstractModel,
    accuracy: Real = 1e-6,
    size: Real = UNKNOWN,
) -> Answer:
    """What one model says: `Question.answer`, compiled. Failures are left in `Answer.status`,
    and the numbers are then NaN.

    `accuracy` is that of numerical integration, relative, where the largest deflection is `size`
    times the length. Raises `ValueError` or `TypeError` for parameters out of range.
    """
    return _answer(
        checked_question(question),
        checked_rotor(Rotor, rotor),
        checked_model(model),
        positive("accuracy", accuracy),
        positive("size", size),
    )


@eqx.filter_jit
def _answer(
    question: Question, rotor: Rotor, model: AbstractModel, accuracy: Scalar, size: Scalar
) -> Answer:
    return question.answer(model, rotor, accuracy, size)


class Evidence(NamedTuple):
    """What became of one rung: its expected cost, the estimate of its error (NaN: not run), and
    the verdict in words."""

    rung: Rung
    estimate: float
    verdict: str


@dataclasses.dataclass(frozen=True, eq=False)
class Choice:
    """The cheapest rung found to meet a tolerance; as text, a table of the rungs looked at.

    `met` is False where no rung was found to: then `rung` is the best there is, and `estimate` its
    error. `partial` is what the rung says, `answer` the same where the tolerance is met, else NaN.
    `law` is what an axial law other than the engineering strain might change (`Answer.law`).
    """

    rung: Rung
    estimate: float
    met: bool
    tolerance: float
    partial: np.ndarray
    law: float
    indicators: Indicators
    evidence: tuple[Evidence, ...]

    @property
    def answer(self) -> np.ndarray:
        """What the rung says, if that meets the tolerance."""
        return self.partial if self.met else np.full_like(self.partial, np.nan)

    @property
    def model(self) -> AbstractModel:
        """Of the rung."""
        return self.rung.model

    def __str__(self) -> str:
        known = self.indicators
        takes_part = known.excited > 0.1 * self.tolerance
        highest = np.max(known.rest_frequency, where=takes_part, initial=0.0)
        excited = f"excited up to {highest:.3g} rad/s" if highest else "no mode excited by the hub"
        lines = [
            f"stiffening ratio {float(known.stiffening_ratio):.2g}, deflection "
            f"{float(known.size):.2g} L, slope {float(known.slope):.2g}, steady strain "
            f"{float(known.steady_strain):.2g}, {excited}",
        ]
        if self.law > self.tolerance:
            lines.append(
                "strains are not small: an axial law other than that of the engineering strain "
                f"might change this by some {self.law:.1g}"
            )
        lines.append(f"{'rung':34} {'cost':>8} {'estimate':>10}  verdict")
        for rung, estimate, verdict in self.evidence:
            if verdict == NOT_NEEDED:
                continue
            said = "" if np.isnan(estimate) else f"{estimate:.2g}"
            lines.append(f"{rung.name:34} {rung.cost:8.3g} {said:>10}  {verdict}")
        if self.met:
            lines.append(f"{self.rung.name}: error {self.estimate:.2g}, asked {self.tolerance:.2g}")
        else:
            lines.append(
                f"no rung was found to meet {self.tolerance:.2g}; the best, {self.rung.name}, has "
                f"{self.estimate:.2g}"
            )
        return "\n".join(lines)


def scout_of(linear: list[AbstractModel]) -> AbstractModel:
    """The linear theory that says how large deflections are."""
    return linear[min(2, len(linear) - 1)]


def ruled_out(model: AbstractModel, known: Indicators, tolerance: float) -> str:
    """Why it need not be tried: a tenth of what it leaves out as a rule (`studies/validity.py`; of
    a mode, its share) is too much."""
    if isinstance(model, EngineeringANCF):
        return ""
    assert isinstance(model, Classical | Hybrid | VonKarman)
    if isinstance(model, Classical) and 0.05 * known.stiffening_ratio > tolerance:
        return f"stiffening ratio {float(known.stiffening_ratio):.2g}"
    if not isinstance(model, VonKarman):
        if 0.03 * known.size**2 > tolerance:
            return f"deflection {float(known.size):.2g} L, slope {float(known.slope):.2g}"
        if 0.04 * known.steady_strain > tolerance:
            return f"steady strain {float(known.steady_strain):.2g}"
    n = model.n_in_plane
    if n < len(known.excited) and known.excited[n] > 10 * tolerance:
        return f"mode {n + 1} takes part, {float(known.excited[n]):.1g} of what the first could"
    return ""


def has_other_law(model: AbstractModel) -> bool:
    """Whether its material is not that of the engineering strain, to which errors refer. Then what
    the law may change (`Answer.law`) is part of its error, even if it agrees by chance."""
    return not isinstance(model, EngineeringANCF)


def checked_tolerance(tolerance: float) -> float:
    """As a float."""
    if isinstance(tolerance, bool) or not isinstance(tolerance, int | float | np.floating):
        raise TypeError(f"tolerance must be a number, got {type(tolerance).__name__}")
    if not 1e-8 <= tolerance < 1:
        raise ValueError(f"tolerance must be between 1e-8 and 1, got {tolerance}")
    return float(tolerance)


def choose_model(question: Question, rotor: Rotor, tolerance: float = 1e-3) -> Choice:
    """The cheapest model that answers a question about a rotor to a relative `tolerance`.

    `DeflectionHistory`, `PeakDeflection`, `RootStrain` and `ModalFrequencies` are questions. First
    a linear theory in bending says how large deflections are, and `Indicators` rule out what cannot
    do. Then elements are refined until the last two differ by less than half the tolerance: they
    are the judge (in space von Karman beams are, and estimates have their own error on top, twice
    the square of the deflection over length plus the strain). Cheaper rungs are tried in order of
    cost until one agrees. The estimate of a rung is its distance from the judge, plus what the
    judge may be off, plus what ten times tighter integration changes.

    The judge's material has the engineering strain (`EngineeringANCF`). To estimates of rungs of
    any other axial law is added what laws that agree at small strains may differ by, from the
    strains that the judge meets: see `Answer.law`, which `Choice.law` repeats.

    It takes the time of the judge and half of it again, seldom that of the finest elements; each
    model is compiled once for all questions of a kind. For many cases use `ladder_sweep`. Raises
    `ValueError` or `TypeError` for a malformed argument or parameters out of range, `RuntimeError`
    where no model gives an answer.
    """
    checked_question(question)
    rotor, tolerance = checked_rotor(Rotor, rotor), checked_tolerance(tolerance)
    planar = bool(_planar(question, rotor))
    linear, nonlinear = chains(question, planar)
    rungs = rungs_of(question, planar)
    ask = _Asker(question, rotor, INTEGRATION * tolerance)
    scout = ask.now(scout_of(linear))
    given = Status(int(scout.status))
    if Status.OK < given < Status.OUT_OF_PLANE:
        raise ValueError(given.message)
    known = jax.device_get(_indicators(question, rotor, scout))
    ask.size = float(np.clip(known.size, 1e-9, 1.0)) if given == Status.OK else LARGE

    judge, left = _refined(ask, nonlinear, tolerance)
    noise = ask.now(judge, 0.1).distance(ask(judge))
    left = left + float(noise) + (0.0 if planar else SPACE * float(known.reach))
    law = float(ask(judge).law)

    def estimate(model: AbstractModel) -> float:
        return ask.apart(model, judge) + left + (law if has_other_law(model) else 0.0)

    estimates = {m: estimate(m) for m in nonlinear if m in ask.found}
    # Then whatever costs less, from the cheapest on.
    enough = next(rung.cost for rung in rungs if rung.model == judge)
    verdicts: dict[AbstractModel, str] = {}
    tried: dict[Any, list[AbstractModel]] = {}
    chosen: Rung | None = None
    for rung in rungs:
        model = rung.model
        if chosen is None and model not in estimates and rung.cost < enough:
            before = tried.setdefault((type(model), getattr(model, "n_stretch", 0) > 0), [])
            why = ruled_out(model, known, tolerance)
            if (
                not why
                and len(before) > 1
                and ask.apart(*before[-2:]) < 0.1 * estimates[before[-1]]
            ):
                why = "more functions do not help"
            if why:
                verdicts[model] = f"ruled out: {why}"
                continue
            estimates[model] = estimate(model)
            before.append(model)
        if model in estimates:
            status = Status(int(ask(model).status))
            verdicts[model] = "misses it" if status == Status.OK else status.name
            if estimates[model] <= tolerance:
                verdicts[model] = "meets it" if chosen is None else "meets it too"
                chosen = chosen or rung
    evidence = tuple(
        Evidence(r, estimates.get(r.model, np.nan), verdicts.get(r.model, NOT_NEEDED))
        for r in rungs
    )
    best = chosen or _best(ask, evidence)
    return Choice(
        rung=best,
        estimate=estimates.get(best.model, np.inf),
        met=chosen is not None,
        tolerance=tolerance,
        partial=np.asarray(ask(best.model).value),
        law=law,
        indicators=known,
        evidence=evidence,
    )


class _Asker:
    """Answers to one question, kept."""

    def __init__(self, question: Question, rotor: Rotor, accuracy: float) -> None:
        self.question, self.rotor, self.accuracy = question, rotor, accuracy
        self.size = UNKNOWN
        self.found: dict[AbstractModel, Answer] = {}

    def now(self, model: AbstractModel, tighter: float = 1.0) -> Answer:
        """Without keeping it."""
        # Arrays that are not weakly typed, as those of `answer`: else all would compile twice.
        how = (real_scalar("accuracy", self.accuracy * tighter), real_scalar("size", self.size))
        return jax.device_get(_answer(self.question, self.rotor, model, *how))

    def __call__(self, model: AbstractModel) -> Answer:
        if model not in self.found:
            self.found[model] = self.now(model)
        return self.found[model]

    def apart(self, model: AbstractModel, better: AbstractModel) -> float:
        return float(self(model).distance(self(better)))


def _refined(
    ask: _Asker, nonlinear: list[AbstractModel], tolerance: float
) -> tuple[AbstractModel, float]:
    """The judge, refined until it stands still, and how far it may be off. Where a finer one fails,
    the finest that another confirms."""
    share = left_of(ask.question)
    judge, left, before = nonlinear[2], np.inf, np.inf
    for coarse, fine in itertools.pairwise(nonlinear[1:]):
        apart = ask.apart(coarse, fine)
        if np.isfinite(left) and not np.isfinite(apart):
            break
        # Two rungs may agree by chance: so little is left only if those before agreed as well.
        here = share * apart if np.isinf(before) else max(share * apart, share**2 * before)
        judge, left, before = fine, here, apart
        if apart <= JUDGE * tolerance:
            break
    return judge, left


def left_of(question: Question) -> float:
    """Share of the difference between two rungs that the finer may be off: twice what the order of
    convergence says, elements being halved."""
    return float(2.0 ** (1 - question.order))


def _best(ask: _Asker, evidence: tuple[Evidence, ...]) -> Rung:
    """Where none is good enough: the least estimate, else the richest that has an answer."""
    answers = [e for e in evidence if np.isfinite(e.estimate)]
    if answers:
        return min(answers, key=lambda e: e.estimate).rung
    asked = [e.rung for e in evidence if e.rung.model in ask.found]
    fine = [rung for rung in asked if int(ask(rung.model).status) == Status.OK]
    if not fine:
        said = Status(int(ask(asked[-1].model).status))
        raise RuntimeError(f"no rung has an answer: {said.message}")
    return fine[-1]
