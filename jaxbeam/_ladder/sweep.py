"""Many questions on the ladder: a few say how rungs err, all are answered on what suffices."""

import contextlib
import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._checks import count_functions
from jaxbeam._ladder.background import BackgroundCompiler
from jaxbeam._ladder.choose import INTEGRATION, LARGE, checked_tolerance, refined
from jaxbeam._ladder.evaluate import UNKNOWN
from jaxbeam._ladder.pool import Example, Know, Pool, Situation, answers_in, some_of
from jaxbeam._ladder.questions import Answer, Question
from jaxbeam._ladder.rungs import (
    SPACE,
    chains,
    check_answerable,
    convergence_factor,
    judges,
    scout_of,
)
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._rotor.beam import Rotor
from jaxbeam._status import Status
from jaxbeam._sweeps.cases import Cases, checked_cases
from jaxbeam._sweeps.table import Table, as_table

_SAFETY = 1.5
# Ratio of a rung's error to its distance from the rung below, where nothing else is known.
_RATIO = 0.25
_NOISE = 0.1  # differences below this share of the tolerance count as noise
_SMALL = 0.1  # nonlinearity over the tolerance up to which linear theory itself counts as exact
_START = 0.5  # typical error of the first rung that is asked, over the tolerance


class _Chain(NamedTuple):
    """Errors of a chain of models, calibrated by answers of representative cases.

    The error of rung k is `ratio[k]` times its distance from rung k - 1, at least `floor[k]`; plus
    `theory` times `Indicators.nonlinearity`, up to the nonlinearity `limit`; plus `noise` of
    integration.
    """

    models: list[AbstractModel]
    start: int
    ratio: np.ndarray
    floor: np.ndarray
    theory: float
    limit: float
    noise: float

    def left_out(self, nonlinearity: np.ndarray) -> np.ndarray:
        """The error of the theory itself at a deflection, which finer rungs do not reduce."""
        finite = np.isfinite(nonlinearity) | (self.theory == 0)
        inside = self.theory * np.where(np.isfinite(nonlinearity), nonlinearity, 0.0)
        return np.where(finite & (nonlinearity <= self.limit), inside, np.inf)


def ladder_sweep(
    situation: Situation,
    cases: Cases | Mapping[str, Any],
    tolerance: float = 1e-3,
    *,
    representatives: int = 16,
    chunk: int = 16,
    devices: Sequence[jax.Device] | None = None,
    progress: bool | None = None,
) -> Table:
    """Answer a question about every case, each on a rung that suffices.

    `situation(**parameters)` returns a `Rotor` and a `Question`; like a function given to `sweep`
    it is written for one case and sees the parameters of `cases` as scalars. All questions must be
    of one kind, and of equally many times. `tolerance` is relative, from 1e-8 to below 1.

    A linear theory in bending looks at every case (or, where none bears what is asked, the coarsest
    rods in space do). Of those in the plane, and of those in space, `representatives` that
    differ most are followed up both chains of the ladder (see `choose_model`) until the last two
    rungs differ by less than the tolerance. They tell what linear theory leaves out, over the
    square of deflection over length plus the steady strain; on each rung, the error of
    discretisation over the distance from the rung below; what integration adds; and where to start.
    Then each case gets the answers of two neighbouring rungs. The estimate of its error is 1.5
    times the sum of what these, its deflection and integration say, plus, but for exact rods, what
    another axial law might change (`Answer.constitutive_uncertainty`); where that is more than the
    tolerance the case goes on to a richer rung, of the same chain or the non-linear one.

    The `Table` holds, beside the coordinates of the cases:

    | name     | shape  |                                                                        |
    |----------|--------|------------------------------------------------------------------------|
    | value    | (m,)   | the answer: `Answer.value` of the rung; NaN unless status is OK        |
    | partial  | (m,)   | the best answer that there is, whatever the estimate of its error      |
    | estimate | ()     | of its relative error; infinite where no rung has an answer            |
    | rung     | ()     | in words                                                               |
    | outgrown | ()     | how often the estimate was too large and a richer rung was asked       |
    | status   | ()     | `Status`; `TOLERANCE_NOT_MET` where the best answer is not good enough |

    `chunk`, `devices` and `progress` are those of `sweep`. Each model is compiled once, side by
    side on the cores there are; where `cases` are few that takes longer than all else, so the
    cheapest rungs of both kinds are left out, and others until they are needed.

    Raises `ValueError` or `TypeError` as `choose_model` does, but never for what is wrong with a
    case: a batch has a status for each and, as `sweep`, no `throw`.
    """
    if not callable(situation):
        raise TypeError(f"situation must take parameters by name, got {type(situation).__name__}")
    cases, tolerance = checked_cases(cases), checked_tolerance(tolerance)
    count_functions("representatives", representatives, least=2)
    count_functions("chunk", chunk, least=1)
    example = _example(situation, cases)
    check_answerable(example[1], example[0])
    with BackgroundCompiler() as compiler:
        how = {"chunk": chunk, "devices": devices, "progress": progress}
        pool = Pool(situation, cases, INTEGRATION * tolerance, compiler, **how)
        return _answered(pool, cases, example, tolerance, representatives)


def _answered(
    pool: Pool, cases: Cases, example: Example, tolerance: float, representatives: int
) -> Table:
    n = len(cases)
    beforehand = pool.run(Know(pool.situation), np.arange(n))
    given = beforehand["status"]
    results = _blank(n, 1)
    results["status"][:] = given
    for planar in (True, False):
        which = np.flatnonzero((given == Status.OK) & (beforehand["planar"] == planar))
        if which.size:
            part = _swept(
                pool, example, which, beforehand["strain"], planar, tolerance, representatives
            )
            for name in ("value", "partial"):
                if results[name].shape[1:] != part[name].shape[1:]:
                    results[name] = np.full((n, *part[name].shape[1:]), np.nan)
            for name, values in part.items():
                results[name][which] = values
    return as_table(cases, results, beforehand.errors, {})


def _blank(n: int, m: int) -> dict[str, np.ndarray]:
    return {
        "value": np.full((n, m), np.nan),
        "partial": np.full((n, m), np.nan),
        "estimate": np.full(n, np.inf),
        "rung": np.full(n, "", "U64"),
        "outgrown": np.zeros(n, int),
        "status": np.zeros(n, int),
    }


def _example(situation: Situation, cases: Cases) -> Example:
    """Rotor and question of the first case, as an example of the kind of all; without numbers where
    its own are out of range."""
    number = jax.ShapeDtypeStruct((), jnp.result_type(float))
    out = eqx.filter_eval_shape(situation, **dict.fromkeys(cases.columns, number))
    if not isinstance(out, tuple) or [*map(_kind, out)] != [Rotor, Question]:
        raise TypeError("situation must return a Rotor and a Question")
    first = {name: jnp.asarray(column[0]) for name, column in cases.columns.items()}
    with contextlib.suppress(ValueError):
        return situation(**first)
    return out


def _kind(value: Any) -> type | None:
    kinds = [kind for kind in (Rotor, Question) if isinstance(value, kind)]
    return kinds[0] if kinds else None


def _swept(
    pool: Pool, example: Example, cases: np.ndarray, strain: np.ndarray, planar: bool,
    tolerance: float, representatives: int,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Results of these cases, which either all stay in the plane or all do not."""
    rotor, question = example
    linear, nonlinear = chains(question, rotor, planar)
    elements = judges(nonlinear, rotor)
    share, first = convergence_factor(question, rotor, elements[0]), scout_of(linear, elements)
    # One that is cheaper, others would have to be compiled for few cases.
    linear = linear[max(linear.index(first) - 1, 0) :] if linear else []
    pool.begin(first, *elements[:2])
    scout = pool.ask(first, cases)
    given, ok = scout["status"], scout["status"] == Status.OK
    pool.size[cases] = np.where(ok, np.clip(scout["size"], 1e-9, 1.0), LARGE)
    pool.steps[cases] = scout["steps"]
    exact = np.flatnonzero(ok & (scout["size"] >= UNKNOWN))  # integrated tightly enough as it is
    pool.keep(first, cases[exact], scout.take("row", exact))
    nonlinearity = np.where(ok, scout["size"] ** 2 + strain[cases], np.inf)
    fine = ok | ((given > Status.OUT_OF_PLANE) & (given != Status.RAISED))

    out = _blank(len(cases), scout["value"].shape[1])
    out["status"][:] = given
    if not fine.any():
        return out
    linear = linear if 0.03 * nonlinearity.min() <= tolerance else []  # a tenth of its error
    pool.begin(*linear[:2])
    sample = _representatives(pool, cases, nonlinearity, np.flatnonzero(fine), representatives)
    rich, truth = _calibrated(pool, elements, cases[sample], tolerance, share)
    these = truth, rich.theory, cases[sample], nonlinearity[sample], tolerance, share
    poor = [_linear(pool, linear, *these)] if linear else []
    estimate, status = out["estimate"], out["status"]
    for chain in (*poor, rich):
        left_out = chain.left_out(nonlinearity)
        todo = fine & ~(estimate <= tolerance)
        if chain is not rich:  # no finer rung mends what its theory leaves out
            todo &= _SAFETY * left_out <= 0.8 * tolerance
        which = np.flatnonzero(todo)
        for k in range(chain.start, len(chain.models)):
            if not which.size:
                break
            coarse, here = (pool(model, cases[which]) for model in chain.models[k - 1 : k + 1])
            own = np.maximum(chain.ratio[k] * here.distance(coarse), chain.floor[k])
            error = _SAFETY * (own + left_out[which] + chain.noise)
            if not chain.models[k].is_reference:  # models without stretch know no strain
                error = error + np.maximum(here.constitutive_uncertainty, strain[cases[which]])
            nothing = out["rung"][which] == ""  # then any answer is better
            better = (error < estimate[which]) | (nothing & (here.status == Status.OK))
            best = which[better]
            estimate[best], out["partial"][best] = error[better], here.value[better]
            out["rung"][best] = chain.models[k].title
            status[which] = here.status
            which = which[~(error <= tolerance)]
            if k + 1 < len(chain.models) or chain is not rich:
                out["outgrown"][which] += 1
    best_kept = np.isfinite(estimate) | (status == Status.OK)
    status[fine & best_kept] = Status.TOLERANCE_NOT_MET
    status[fine & (estimate <= tolerance)] = Status.OK
    ok = status == Status.OK
    out["value"][ok] = out["partial"][ok]
    return out


def _representatives(
    pool: Pool, cases: np.ndarray, nonlinearity: np.ndarray, fine: np.ndarray, count: int
) -> np.ndarray:
    """Places in `cases` far from each other in the ranks of parameters and of nonlinearity, the
    most nonlinear first: each is the one that is farthest from all before it."""
    columns = [c[cases][fine] for c in pool.columns.values()]
    columns += 2 * [nonlinearity[fine]]  # nonlinearity, with twice the weight of a parameter
    ranks = [np.unique(c, return_inverse=True)[1].astype(float) for c in columns]
    place = np.stack([r / max(r.max(), 1.0) for r in ranks], 1)
    chosen = [int(np.argmax(np.where(np.isfinite(nonlinearity[fine]), nonlinearity[fine], -1.0)))]
    nearest = np.full(len(fine), np.inf)
    while len(chosen) < min(count, len(fine)):
        nearest = np.minimum(nearest, np.linalg.norm(place - place[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(nearest)))
    return fine[np.array(chosen)]


def _calibrated(
    pool: Pool, elements: list[AbstractModel], sample: np.ndarray, tolerance: float, share: float
) -> tuple[_Chain, Answer]:
    """The non-linear chain, and its best answers, not OK where none stands still."""
    judge, _, steady = refined(
        lambda model, which: pool(model, sample[which]), len(sample), elements, tolerance, share
    )
    finest = [pool(elements[k], sample[i : i + 1]) for i, k in enumerate(judge)]
    best = jax.tree.map(lambda *leaves: np.concatenate(leaves), *finest)
    status = np.where(steady, best.status, Status.TOLERANCE_NOT_MET)
    truth = dataclasses.replace(best, status=status)
    chain = _chain(pool, sample, elements, truth, judge, share, tolerance)
    middle = elements[int(np.median(judge))]
    noise = _noise(pool, sample, middle, truth)
    return chain._replace(theory=0.0 if middle.is_reference else SPACE, noise=noise), truth


def _linear(
    pool: Pool, linear: Sequence[AbstractModel], truth: Answer, beyond: float,
    sample: np.ndarray, nonlinearity: np.ndarray, tolerance: float, share: float,
) -> _Chain:  # fmt: skip
    """The linear chain, up to a rung whose number of functions will do. Where the reach is small it
    errs by that number alone."""
    small = (nonlinearity <= _SMALL * tolerance) & (truth.status == Status.OK)
    for top in range(min(2, len(linear)), len(linear) + 1):
        models = list(linear[:top])
        chain = _chain(pool, sample, models, truth, np.where(small, top, 0), share, tolerance)
        best = pool(models[-1], sample)
        off, own = best.distance(truth), np.zeros(len(sample))
        if top > 1:
            own = chain.ratio[-1] * best.distance(pool(models[-2], sample))
        if not small.any() or np.median(own[small]) <= _START * tolerance:
            break
    use = np.isfinite(off) & np.isfinite(own) & (nonlinearity > 0)
    more = np.maximum(off - own - _NOISE * tolerance, 0)[use] / nonlinearity[use]
    limit = float(np.max(nonlinearity[np.isfinite(off)], initial=-1.0))
    return chain._replace(
        theory=float(np.max(more, initial=0.0)) + beyond, limit=limit,
        noise=_noise(pool, sample, chain.models[chain.start], truth),
    )  # fmt: skip


def _chain(
    pool: Pool, sample: np.ndarray, models: list[AbstractModel], best: Answer, judge: np.ndarray,
    share: float, tolerance: float,
) -> _Chain:  # fmt: skip
    """The `_Chain` of models, with ratio, floor and start by the errors of rungs k < judge[i] for
    representatives i of a sample, against the best answers; the caller fills in the rest."""
    ratio, floor = np.full(len(models), _RATIO), np.zeros(len(models))
    start = last = len(models) - 1
    for k in range(1, min(int(judge.max()), last) + 1):
        some = np.flatnonzero((judge > k) & (best.status == Status.OK))
        if not some.size:
            continue
        below, here = (pool(models[i], sample[some]) for i in (k - 1, k))
        apart, error = here.distance(below), here.distance(some_of(best, some))
        seen = np.isfinite(apart) & np.isfinite(error)
        if seen.any():
            # Two rungs may agree by chance: then the error that is usual here is believed.
            floor[k] = np.median(error[seen]) / 2
        seen &= apart > _NOISE * tolerance
        if seen.any():
            ratio[k] = max(share / 2, np.max((error[seen] - floor[k]) / apart[seen]))
        if np.median(error) <= _START * tolerance:
            start = min(start, k)
    start = min(start, max(int(np.median(judge)), 1), last)
    return _Chain(models, start, ratio, floor, 0.0, np.inf, 0.0)


def _noise(pool: Pool, sample: np.ndarray, model: AbstractModel, truth: Answer) -> float:
    """How much answers change where integration is ten times tighter."""
    fine = np.asarray(truth.status == Status.OK)
    if not fine.any():
        return 0.0
    tight = pool.ask(model, sample[fine], 0.1)
    off = pool(model, sample[fine]).distance(answers_in(tight))
    return float(np.max(off[np.isfinite(off)], initial=0.0))
