"""What a question can be answered by: rungs from cheap to rich, and what speaks against one.

Two chains make up the ladder. *Linear* theories with 1, 2, 4, ... bending functions; they converge
at once, but to an answer that is wrong by what their theory leaves out. *Non-linear* ones, of which
elements converge to the right answer for a material of the engineering strain: `ExactRodANCF`
in the plane, `SpatialANCF` in space. That needs to know how the beam twists; where its
`torsional_stiffness` is not given, von Karman beams take its place, which are right to second order
of deflection over length.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._ladder.questions import ModalFrequencies, Question, checked_question
from jaxbeam._models.ancf.theories import ExactRodANCF
from jaxbeam._models.bases.basis import CantileverModes, Polynomials, Yielding
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.modal.theories import Classical, Hybrid, VonKarman
from jaxbeam._models.space.theory import SpatialANCF
from jaxbeam._programs.program import Program
from jaxbeam._rotor.beam import Rotor, checked_rotor
from jaxbeam._types import Real, Scalar
from jaxbeam._vibration.stiffening import bending_at_rest, stiffening_of, timoshenko_reduction

ELEMENTS = (1, 2, 4, 8, 16, 32, 64)
# Error of von Karman beams over `Indicators.nonlinearity`; 0.8 to 1.2 in studies/validity.py.
SPACE = 2.0


class Rung(NamedTuple):
    """A `model`, and what it is expected to cost, `cost`, over the cheapest of the ladder."""

    model: AbstractModel
    cost: float

    @property
    def name(self) -> str:
        """The name of the rung in words: its theory and its size."""
        return describe(self.model)


def describe(model: AbstractModel) -> str:
    """A rung in words: theory and size."""
    if isinstance(model, ExactRodANCF | SpatialANCF):
        where = " in space" if isinstance(model, SpatialANCF) else ""
        return f"{model.n_elements} element{'s' * (model.n_elements > 1)}{where}"
    assert isinstance(model, Classical | Hybrid | VonKarman)
    n, flap = model.n_in_plane, model.n_flap
    basis = model.basis.basis if isinstance(model.basis, Yielding) else model.basis
    kind = "mode" if isinstance(basis, CantileverModes) else "function"
    count = f"{n} and {flap} {kind}s" if flap else f"{n} {kind}{'s' * (n > 1)}"
    stretch = f", stretch {model.n_stretch}" if model.n_stretch else ""
    title = {Classical: "classical", Hybrid: "hybrid", VonKarman: "von Karman"}[type(model)]
    return f"{title}, {count}{stretch}"


def space_alone(question: Question, rotor: Rotor) -> str:
    """What of a question or a rotor elements in space alone bear, in words, or nothing."""
    if question.space_alone or rotor.precone is None:
        return question.space_alone
    if not isinstance(question, ModalFrequencies):
        return "precone in motion"
    # About the deflected beam in a cone `Hybrid` has frequencies, but not of all rotors.
    beyond = rotor.couples_bending or rotor.tip_body is not None
    return "precone beside pitch, twist or a body at the tip" if beyond else ""


def check_answerable(question: Question, rotor: Rotor) -> None:
    """Raise `ValueError` where elements in space are needed, and how the beam twists is not said.

    That does not depend on numbers.
    """
    needed = space_alone(question, rotor) or ("precone" if rotor.precone is not None else "")
    if needed and not _in_space(rotor):
        raise ValueError(
            f"{needed}: of this SpatialANCF alone is the judge, which twists: give "
            "torsional_stiffness=..., GJ in N m^2, to the Beam, and no flap_inertia to a TipBody"
        )


def _in_space(rotor: Rotor) -> bool:
    """Whether elements in space know all that the rotor has."""
    uneven = rotor.tip_body is not None and rotor.tip_body.flap_inertia is not None
    return rotor.beam.torsional_stiffness is not None and not uneven


def chains(
    question: Question, rotor: Rotor, planar: bool
) -> tuple[list[AbstractModel], list[AbstractModel]]:
    """Linear and non-linear models for a question, each from coarse to fine, suited to a rotor and
    to others that are like it. There may be no linear ones.
    """
    counts = () if space_alone(question, rotor) else question.functions
    linear: list[AbstractModel] = [_modal(Hybrid, n, rotor, planar) for n in counts]
    if planar or _in_space(rotor):
        sizes = [n for n in sizes_for(rotor) if 2 * n >= question.functions[0]]
        theory = ExactRodANCF if planar else SpatialANCF
        return linear, [theory(n).suited(rotor) for n in sizes]
    return linear, [_modal(VonKarman, n, rotor, planar) for n in counts if n > 1]


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


def _modal(theory: type[Any], n: int, rotor: Rotor, planar: bool, stretch: int = 0) -> Any:
    """A modal model with n functions across, each way, and one more where the root yields.

    Functions of von Karman's u1 follow u2'^2."""
    # One or two modes at rest do better than as many polynomials, from three on these win; of beams
    # that vary they are not the modes.
    stretch = 2 * n + 1 if theory is VonKarman else stretch
    few = n <= 2 and theory is not VonKarman and rotor.beam.is_uniform
    basis = CantileverModes() if few else Polynomials()
    in_plane, flap = (n + (spring is not None) for spring in rotor.springs)
    return theory(stretch, in_plane, 0 if planar else flap, basis=basis).suited(rotor)


def rungs(rotor: Rotor, question: Question) -> list[Rung]:
    """All rungs for a question about a rotor, cheapest first, with the cost of a run to expect.

    In bending alone without (`Classical`) and with (`Hybrid`) motion-induced stiffness, stretch
    being left out (`RootStrain` has it quasi-statically); with stretch; von Karman; elements, those
    in space if the beam has a `torsional_stiffness`. Nothing out of the plane where motion and
    loads stay in it; and only models that bear what there is. `rotor` is a `Rotor`, `question` a
    `Question`; returns a list of `Rung`.

    Raises `ValueError` or `TypeError` for a malformed argument, and `ValueError` where no model
    bears what there is.
    """
    checked_question(question)
    rotor = checked_rotor(Rotor, rotor)
    check_answerable(question, rotor)
    return rungs_of(question, rotor, bool(is_planar(question, rotor)))


def rungs_of(question: Question, rotor: Rotor, planar: bool) -> list[Rung]:
    """`rungs` where it is known whether all stays in the plane."""
    linear, nonlinear = chains(question, rotor, planar)
    judged = is_of_elements(nonlinear[0])  # else von Karman beams are there already
    # In a cone there is `Hybrid` without stretch alone, beside elements.
    counts = question.functions if linear and rotor.precone is None else ()
    models = [_modal(Classical, n, rotor, planar) for n in counts if n < 8]
    models += [*linear, *nonlinear]
    for n in counts:
        models += [_modal(Hybrid, n, rotor, planar, n)] * (n >= 4)
        models += [_modal(VonKarman, n, rotor, planar)] * (n in (2, 4) and judged)
    costs = [_cost(question, model) for model in models]
    found = [Rung(m, cost / min(costs)) for m, cost in zip(models, costs, strict=True)]
    return sorted(found, key=lambda rung: rung.cost)


def _cost(question: Question, model: AbstractModel) -> float:
    """Cost in us of a case in a batch on one core, roughly: of steps and unknowns.

    `studies/ladder.py` measures some of these numbers: an eigenproblem of n unknowns, 200 steps of
    a linear run, 2.3 times as many where motion is not linear, five times the work where von
    Karman's strain is integrated. They say only which of two rungs is tried first.
    """
    n = len(model.directions)
    if isinstance(question, ModalFrequencies):
        return 40 + 5e-3 * n**3
    if isinstance(model, ExactRodANCF | SpatialANCF):
        # More than twice as many steps as linear motion; of blocks of eight in place of four.
        dearer = 4 if isinstance(model, SpatialANCF) else 1
        return dearer * 2.3 * 200 * (2 + 2.2 * model.n_elements)
    step = (1.9 if isinstance(model, Classical) else 2) + 1.2 * n
    return 200 * step * (5 if isinstance(model, VonKarman) else 1)


class Indicators(eqx.Module):
    """What is known of a question before it is answered.

    | field                | shape |                                                              |
    |----------------------|-------|--------------------------------------------------------------|
    | stiffening_ratio     | ()    | motion-induced over elastic stiffness at the largest speed   |
    | steady_strain        | ()    | P(0) / EA at the largest speed                               |
    | size                 | ()    | largest deflection of the tip over the length, linear theory |
    |                      |       | (where none bears what is asked, the coarsest elements)      |
    | slope                | ()    | largest slope there, of the same                             |
    | rest_frequency       | (6,)  | of the first bending modes in plane, rad/s                   |
    | excited              | (6,)  | how much each takes part in what the hub's rotation excites  |
    | timoshenko_reduction | (2,6) | share of each frequency, in plane and in flap (if that takes |
    |                      |       | part), that shear and rotary inertia, which no rung has,     |
    |                      |       | would take off: an estimate for solid metal. Of turned       |
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
        """What linear theories, and that of von Karman, leave out goes with this."""
        return self.size**2 + self.steady_strain


@Program
def indicators(question: Question, rotor: Rotor) -> Indicators:
    """Indicators but size and slope, which a linear theory has to say: these are infinite."""
    # Of a beam in a cone as if it lay in the plane, where the tension is no less.
    rotor = eqx.tree_at(lambda r: r.precone, rotor, None, is_leaf=lambda x: x is None)
    speed = question.speed()
    omega, shape = bending_at_rest(rotor)
    unknown = jnp.full_like(speed, jnp.inf)
    return Indicators(
        stiffening_ratio=stiffening_of(shape[0], rotor, speed),
        steady_strain=rotor.steady_strain(speed),
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
    leaves = rotor.couples_bending or rotor.precone is not None or question.space_alone
    return question.planar(rotor) & (not leaves)


def scout_of(linear: list[AbstractModel], elements: list[AbstractModel]) -> AbstractModel:
    """The model that says how large deflections are: linear, if there is one."""
    return linear[min(2, len(linear) - 1)] if linear else elements[0]


def judges(nonlinear: list[AbstractModel], rotor: Rotor) -> list[AbstractModel]:
    """Rungs that may judge: coarser ones seldom do, and each would have to be compiled."""
    coarse = 2
    if not rotor.beam.is_uniform and is_of_elements(nonlinear[0]):
        coarse = sum(n < 4 for n in sizes_for(rotor))  # which may begin with ten
    return nonlinear[min(coarse, len(nonlinear) - 2) :]


def ruled_out(model: AbstractModel, beforehand: Indicators, tolerance: float) -> str:
    """Why it need not be tried: a tenth of what it leaves out as a rule (`studies/validity.py`; of
    a mode, its share) is too much."""
    if is_of_elements(model):
        return ""
    assert isinstance(model, Classical | Hybrid | VonKarman)
    if isinstance(model, Classical) and 0.05 * beforehand.stiffening_ratio > tolerance:
        return f"stiffening ratio {float(beforehand.stiffening_ratio):.2g}"
    if not isinstance(model, VonKarman):
        if 0.03 * beforehand.size**2 > tolerance:
            return f"deflection {float(beforehand.size):.2g} L, slope {float(beforehand.slope):.2g}"
        if 0.04 * beforehand.steady_strain > tolerance:
            return f"steady strain {float(beforehand.steady_strain):.2g}"
    elif 0.05 * SPACE * beforehand.size**2 > tolerance:
        return f"deflection {float(beforehand.size):.2g} L, slope {float(beforehand.slope):.2g}"
    n = model.n_in_plane
    if n < len(beforehand.excited) and beforehand.excited[n] > 10 * tolerance:
        return (
            f"mode {n + 1} takes part, {float(beforehand.excited[n]):.1g} of what the first could"
        )
    return ""


def has_other_law(model: AbstractModel) -> bool:
    """Whether its material is not that of the engineering strain, to which errors refer. Then what
    the law may change (`Answer.constitutive_uncertainty`) is part of its error, even if it agrees
    by chance."""
    return not is_of_elements(model)


def is_of_elements(model: AbstractModel) -> bool:
    """Whether it is a rung of geometrically exact elements."""
    return isinstance(model, ExactRodANCF | SpatialANCF)


def left_out_by(judge: AbstractModel, beforehand: Indicators) -> float:
    """What a judge may be off however fine it is."""
    return 0.0 if is_of_elements(judge) else SPACE * float(beforehand.nonlinearity)


def convergence_factor(question: Question, rotor: Rotor) -> float:
    """Share of the difference between two rungs that the finer may be off: twice what the order of
    convergence says, elements being halved. With a kink of a property within elements the order is
    three at most, with a step one: then the differences to come add up to the last one."""
    finest = sizes_for(rotor)[-1]
    order = question.order
    if not _at_nodes(rotor.beam.edges, finest):
        order = min(order, 3)
    return float(2.0 ** (1 - order)) if _at_nodes(rotor.beam.steps, finest) else 1.0
