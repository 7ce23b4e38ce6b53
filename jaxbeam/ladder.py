"""Questions that models are chosen for, and what `jaxbeam.choose_model` goes by.

A question is passed as an object, `jaxbeam.choose_model(rotor, PeakDeflection(motion, times))`.
`rungs` lists the models for it from cheap to dear, `evaluate` has one of them answer it.
"""

from jaxbeam._ladder.choice import Choice as Choice
from jaxbeam._ladder.choice import Evidence as Evidence
from jaxbeam._ladder.choose import evaluate as evaluate
from jaxbeam._ladder.questions import Answer as Answer
from jaxbeam._ladder.questions import DeflectionHistory as DeflectionHistory
from jaxbeam._ladder.questions import ModalFrequencies as ModalFrequencies
from jaxbeam._ladder.questions import PeakDeflection as PeakDeflection
from jaxbeam._ladder.questions import Question as Question
from jaxbeam._ladder.questions import RootStrain as RootStrain
from jaxbeam._ladder.rungs import Indicators as Indicators
from jaxbeam._ladder.rungs import Rung as Rung
from jaxbeam._ladder.rungs import rungs as rungs
