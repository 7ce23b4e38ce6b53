"""What a question can be answered by: rungs from cheap to rich, and what speaks against one.

Two chains make up the ladder. *Linear* theories with 1, 2, 4, ... bending functions; they converge
at once, but to an answer that is wrong by what their theory leaves out. *Non-linear* ones, of which
exact rods converge to the right answer for a material of the engineering strain: `PlanarRod` in the
plane, `SpatialRod` in space. The latter needs to know how the beam twists; where its
`torsional_stiffness` is not given, von Karman beams take its place, which are right to second order
of deflection over length.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._ladder.deformed import straightened
from jaxbeam._ladder.questions import Question, checked_question
from jaxbeam._models.ancf.theories import PlanarRod
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.supports import check_supported, missing, unsupported
from jaxbeam._models.modal.theories import Classical, Hybrid, VonKarman
from jaxbeam._models.space.rod import SpatialRod
from jaxbeam._programs.program import Program
from jaxbeam._results import replaced
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.beam_sections import sections_of
from jaxbeam._rotor.checked import checked_rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._types import Real, Scalar
from jaxbeam._vibration.stiffening import bending_at_rest, stiffening_of, timoshenko_reduction

ELEMENTS = (1, 2, 4, 8, 16, 32, 64)
DEGREES = (2, 3, 4, 6, 8, 12, 16, 24)  # degrees of rods, whose elements end where properties jump
# Error of von Karman beams over `Indicators.nonlinearity`; 0.8 to 1.2 in studies/validity.py.
SPACE = 2.0


class Rung(NamedTuple):
    """A `model`, and what it is expected to cost, `cost`, over the cheapest of the ladder."""

    model: AbstractModel
    cost: float

    @property
    def name(self) -> str:
        """The name of the rung in words: its theory and its size."""
        return self.model.title


def space_alone(question: Question, rotor: Rotor) -> str:
    """Features of a question or a rotor that only rods in space know, in words; empty for none."""
    return question.space_alone or next(iter(missing(Hybrid, rotor, moving=question.moving)), "")


def check_answerable(question: Question, rotor: Rotor) -> None:
    """Raise `ValueError` if question or rotor has what only `SpatialRod` can answer, which does not
    support the rotor. That depends on what there is alone, so that numbers may be traced."""
    needed = question.space_alone or next(iter(missing(VonKarman, rotor)), "")
    if needed and (why := unsupported(SpatialRod, rotor)):
        raise ValueError(f"{needed}: of this SpatialRod alone is the judge. {why}")


def chains(
    question: Question, rotor: Rotor, planar: bool
) -> tuple[list[AbstractModel], list[AbstractModel]]:
    """Linear and non-linear models for a question, each from coarse to fine, suited to a rotor and
    to others that are like it. There may be no linear ones.
    """
    counts = () if space_alone(question, rotor) else question.functions
    linear: list[AbstractModel] = [Hybrid.of_size(n, rotor, planar) for n in counts]
    least = question.functions[0]
    if planar:
        return linear, [PlanarRod(n).suited(rotor) for n in sizes_for(rotor) if 2 * n >= least]
    if not unsupported(SpatialRod, rotor):
        return linear, [SpatialRod(p).suited(rotor) for p in DEGREES if p >= least]
    return linear, [VonKarman.of_size(n, rotor, planar) for n in counts if n > 1]


def sizes_for(rotor: Rotor) -> tuple[int, ...]:
    """Numbers of elements, each twice the last, with nodes at the kinks of the beam if there are
    such, or at its steps: what jumps within an element leaves an error of first order."""
    for places in (rotor.beam.edges, rotor.beam.steps):
        for first in range(1, 13):
            if _at_nodes(places, first):
                return tuple(n for k in range(8) if (n := first * 2**k) <= 2 * ELEMENTS[-1])
    return ELEMENTS


def _at_nodes(places: tuple[float, ...], n_elements: int) -> bool:
    along = np.asarray(places) * n_elements
    return bool(np.all(np.abs(along - np.round(along)) < 1e-7))


def rungs(rotor: Rotor, question: Question, models: Sequence[AbstractModel] = ()) -> list[Rung]:
    """All rungs for a question about a rotor, cheapest first, with the cost of a run to expect.

    They are beams in bending alone without (`Classical`) and with (`Hybrid`) motion-induced
    stiffness, without stretch (`RootStrain` has it quasi-statically); those with stretch; von
    Karman beams; and exact rods, in space if the beam has a `torsional_stiffness`. Models have no
    flap and no torsion where motion and loads stay in the plane, and those that do not support
    something of the rotor or the question are left out. `rotor` is a `Rotor`, `question`
    a `Question`, `models` are some of your own, which stand beside these; returns a list of `Rung`.

    Raises `ValueError` or `TypeError` for a malformed argument, and `ValueError` where no model
    supports all of it.
    """
    checked_question(question)
    rotor = checked_rotor(Rotor, rotor)
    check_answerable(question, rotor)
    return rungs_of(question, rotor, bool(is_planar(question, rotor)), models)


def rungs_of(
    question: Question, rotor: Rotor, planar: bool, own: Sequence[AbstractModel] = ()
) -> list[Rung]:
    """The rungs of a question where it is known whether all stays in the plane."""
    linear, nonlinear = chains(question, rotor, planar)
    judged = nonlinear[0].is_reference  # without it von Karman beams are among the rungs already
    # For a cone there are only `Hybrid` without stretch and rods.
    counts = question.functions if linear and rotor.precone is None else ()
    models: list[AbstractModel] = [Classical.of_size(n, rotor, planar) for n in counts if n < 8]
    models += [*linear, *nonlinear]
    for n in counts:
        models += [Hybrid.of_size(n, rotor, planar, n)] * (n >= 4)
        models += [VonKarman.of_size(n, rotor, planar)] * (n in (2, 4) and judged)
    models += [_suited(model, question, rotor) for model in own]
    costs = [question.cost(model) for model in models]
    found = [Rung(m, cost / min(costs)) for m, cost in zip(models, costs, strict=True)]
    return sorted(found, key=lambda rung: rung.cost)


def _suited(model: AbstractModel, question: Question, rotor: Rotor) -> AbstractModel:
    """A user's model as it suits a rotor, if it can answer the question."""
    model, rotor, _ = checked_case(model, rotor)
    check_supported(model, rotor, question.loads, moving=question.moving)
    return model


class Indicators(eqx.Module):
    """Facts about a question that are known before it is answered.

    | field                | shape |                                                              |
    |----------------------|-------|--------------------------------------------------------------|
    | stiffening_ratio     | ()    | motion-induced over elastic stiffness at the largest speed   |
    | steady_strain        | ()    | P / EA at the largest speed, its largest magnitude           |
    | size                 | ()    | largest deflection of the tip over the length, linear theory |
    |                      |       | (where none bears what is asked, the coarsest rod)           |
    | slope                | ()    | largest slope there, of the same                             |
    | rest_frequency       | (6,)  | of the first bending modes in plane, rad/s                   |
    | excited              | (6,)  | how much each takes part in what the hub's rotation excites  |
    | timoshenko_reduction | (2,6) | share of each frequency, in plane and in flap (if that takes |
    |                      |       | part), that shear and rotary inertia, which elements have    |
    |                      |       | not, would take off: an estimate for solid metal. Of turned  |
    |                      |       | sections off the lowest frequencies                          |
    """

    stiffening_ratio: Scalar
    steady_strain: Scalar
    size: Scalar
    slope: Scalar
    rest_frequency: Array
    excited: Array
    timoshenko_reduction: Array

    @property
    def nonlinearity(self) -> Real:
        """The measure by which linear theories, and that of von Karman, go wrong."""
        return self.size**2 + self.steady_strain


@Program
def indicators(question: Question, rotor: Rotor) -> Indicators:
    """Indicators without size and slope, which are infinite until a linear theory has said them."""
    # Of a beam in a cone as if it lay in the plane, where the tension is no less.
    rotor = replaced(straightened(rotor), precone=None)
    speed = question.speed()
    omega, shape = bending_at_rest(rotor)
    unknown = jnp.full_like(speed, jnp.inf)
    return Indicators(
        stiffening_ratio=stiffening_of(shape[0], rotor, speed),
        steady_strain=jnp.abs(rotor.steady_strain(speed)),
        size=unknown,
        slope=unknown,
        rest_frequency=omega[:6],
        excited=question.excited(omega[:6]),
        timoshenko_reduction=timoshenko_reduction(rotor),
    )


@Program
def is_planar(question: Question, rotor: Rotor) -> Array:
    """Whether motion, loads and answer stay in the plane of rotation."""
    # Where sections are turned, what begins in the plane leaves it; so does a beam in a cone.
    leaves = rotor.couples_bending or rotor.precone is not None or space_alone(question, rotor)
    return question.planar(rotor) & (not leaves)


def scout_of(linear: list[AbstractModel], elements: list[AbstractModel]) -> AbstractModel:
    """The model that says how large deflections are: linear, if there is one."""
    return linear[min(2, len(linear) - 1)] if linear else elements[0]


def judges(nonlinear: list[AbstractModel], rotor: Rotor) -> list[AbstractModel]:
    """Rungs that may judge: coarser ones seldom do, and each would have to be compiled."""
    coarse = 2
    by_elements = nonlinear[0].is_reference and not isinstance(nonlinear[0], SpatialRod)
    if rotor.varies and by_elements:
        # Index of the first number of elements of four or more.
        coarse = sum(n < 4 for n in sizes_for(rotor))
    return nonlinear[min(coarse, len(nonlinear) - 2) :]


def ruled_out(model: AbstractModel, beforehand: Indicators, tolerance: float) -> str:
    """The reason why a model need not be tried: a tenth of its typical error
    (`studies/validity.py`; of a mode, its share) exceeds the tolerance. Empty if there is none."""
    if model.is_reference:
        return ""
    ratio, size, slope, strain = (
        float(number)
        for number in (
            beforehand.stiffening_ratio, beforehand.size, beforehand.slope, beforehand.steady_strain
        )
    )  # fmt: skip
    for error, why in (
        (model.neglects.stiffening * ratio, f"stiffening ratio {ratio:.2g}"),
        (model.neglects.deflection * size**2, f"deflection {size:.2g} L, slope {slope:.2g}"),
        (model.neglects.strain * strain, f"steady strain {strain:.2g}"),
    ):
        if 0.1 * error > tolerance:
            return why
    n = model.directions.count(Direction.IN_PLANE)
    if 0 < n < len(beforehand.excited) and beforehand.excited[n] > 10 * tolerance:
        return (
            f"mode {n + 1} takes part, {float(beforehand.excited[n]):.1g} of what the first could"
        )
    return ""


def left_out_by(judge: AbstractModel, beforehand: Indicators) -> float:
    """The error that a judge may have however many elements it has."""
    return 0.0 if judge.is_reference else SPACE * float(beforehand.nonlinearity)


def convergence_factor(question: Question, rotor: Rotor, judge: AbstractModel) -> float:
    """The share of the difference between two rungs that the error of the finer one may be: twice
    what the order of convergence says for half the length of elements."""
    order = question.order
    if isinstance(judge, SpatialRod):
        return float(2.0 ** (1 - order)) if len(sections_of(rotor.beam).edges) <= 2 else 1.0
    finest = sizes_for(rotor)[-1]
    if not _at_nodes(rotor.beam.edges, finest):
        order = min(order, 3)
    return float(2.0 ** (1 - order)) if _at_nodes(rotor.beam.steps, finest) else 1.0
