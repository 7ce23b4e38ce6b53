"""What `jaxbeam.fit` takes beyond frequencies, and its search from many starts.

`jaxbeam.FrequencyData` is the everyday experiment. To write one, derive from `Experiment`: what was
measured, and what a model predicts in its place.
"""

from jaxbeam._fitting.experiments import Experiment as Experiment
from jaxbeam._fitting.experiments import HistoryData as HistoryData
from jaxbeam._fitting.experiments import ResonanceMargin as ResonanceMargin
from jaxbeam._fitting.experiments import StaticData as StaticData
from jaxbeam._fitting.fit import Descent as Descent
from jaxbeam._fitting.matching import match_modes as match_modes
