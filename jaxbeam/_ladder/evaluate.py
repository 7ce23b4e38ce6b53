"""What one model answers to a question, compiled."""

from jaxbeam._checks import positive
from jaxbeam._ladder.questions import Answer, Question, checked_question
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._programs.program import Program
from jaxbeam._results import finish
from jaxbeam._rotor.beam import Rotor
from jaxbeam._simulation.first_short import STEPS, quick_first
from jaxbeam._types import Real, Scalar

UNKNOWN = 1e-4  # deflection over length to expect where nothing is known


def evaluate(
    model: AbstractModel,
    rotor: Rotor,
    question: Question,
    accuracy: Real = 1e-6,
    size: Real = UNKNOWN,
    *,
    throw: bool = True,
) -> Answer:
    """The answer of one model to a question about a rotor: `Question.answer`, compiled.

    `model` and `rotor` are those of `modes`, `question` is a `Question`; `accuracy` > 0 is that of
    numerical integration, relative, where the largest deflection is `size` > 0 times the length.
    Returns an `Answer`. With `throw=False` failures of a model are left in `Answer.status`, and
    the numbers are then NaN.

    Raises `ValueError` or `TypeError` for a malformed argument or parameters out of range, and
    `RuntimeError` where the model has no answer.
    """
    question = checked_question(question)
    model, rotor, _ = checked_case(model, rotor)
    how = positive("accuracy", accuracy), positive("size", size)
    return finish(answer_of(question, rotor, model, *how), throw)


@Program
def _answer(
    question: Question, rotor: Rotor, model: AbstractModel, accuracy: Scalar, size: Scalar
) -> Answer:
    return question.answer(model, rotor, accuracy, size)


def answer_of(question: Question, *given: object) -> Answer:
    """The answer to a question, by rotor, model, accuracy and size that are `given`; by the quickly
    compiled program first, unless a run is longer than that is worth."""
    short = question.within(STEPS)
    answer: Answer = quick_first(_answer, (short, *given), (question, *given), short is question)
    return answer


def prepare_answer(question: Question, *given: object) -> None:
    """Compile the program that `answer_of` takes first; not within other programs."""
    _answer.prepare(question.within(STEPS), *given)
