"""What the functions of `jaxbeam` return, to look up what is in it, and for annotations.

What can fail has a `status` (see `jaxbeam.Status`); numbers of a case that failed are NaN.
"""

from jaxbeam._fitting.result import Fit as Fit
from jaxbeam._modes.result import Modes as Modes
from jaxbeam._modes.shapes import ShapePolynomials as ShapePolynomials
from jaxbeam._simulation.result import Simulation as Simulation
from jaxbeam._simulation.scene import Scene as Scene
from jaxbeam._simulation.stable_step import Amplification as Amplification
from jaxbeam._simulation.stable_step import StableStep as StableStep
from jaxbeam._simulation.steady import SteadyStart as SteadyStart
from jaxbeam._stability.critical_speed import CriticalSpeed as CriticalSpeed
from jaxbeam._stability.floquet import Floquet as Floquet
from jaxbeam._stability.tongues import Tongue as Tongue
from jaxbeam._sweeps.cases import Cases as Cases
from jaxbeam._vibration.campbell import Campbell as Campbell
from jaxbeam._vibration.crossing import Crossing as Crossing
from jaxbeam._vibration.southwell import Southwell as Southwell
from jaxbeam._vibration.stiffening import StiffeningRatio as StiffeningRatio
