"""What the functions of `jaxbeam` return, to look up what is in it, and for annotations.

Each has the name of its function: `Modes`, `Southwell`, `Campbell`, `Crossing`, `CriticalSpeed`,
`CriticalLoad`, `Floquet`, `Tongue`, `Steady`, `Simulation`, `SteadyStart`, `StableStep`,
`Amplification`, `StiffeningRatio`, `Fit`. `ShapePolynomials` come from `Modes.polynomials`, a
`Scene` is what a run goes through, and `Cases` come from `jaxbeam.grid` and `jaxbeam.points`. What
is asked of a batch of results has the axes of the batch in front.

**A result knows its `rotor` and its `model`**, and is asked in one way: what needs to be told
nothing is a property (`run.tip`, `found.frequency`), what is asked along the span is a method of
the places xi = x / L (`run.torsion(xi)`, `found.displacement(xi)`), one number or p of them.

**No number comes from a case that failed.** What can fail has a `status` (see `jaxbeam.Status`): it
raises unless `throw=False` is given. `sweep`, `ladder_sweep` and `campbell` are batches by
themselves: they have one status for each case, and never raise for it. The answers of a case that
failed are NaN. They are also NaN where only some of them are taken into a sweep, which then says
`NOT_FINITE`. A run that was stopped keeps its history up to there. What there is nevertheless, like
the peak so far or the best fit, is found under the name `partial` (`run.partial.peak()`).

**Look at `status` before a gradient.** Derivatives of such a NaN are NaN in forward mode, but zero
in reverse mode: a case does not know whether it is one of a batch, and NaN would spoil the gradient
by all parameters that its cases share.
"""

from jaxbeam._fitting.result import Fit as Fit
from jaxbeam._modes.result import Modes as Modes
from jaxbeam._modes.shapes import ShapePolynomials as ShapePolynomials
from jaxbeam._simulation.result import Simulation as Simulation
from jaxbeam._simulation.scene import Scene as Scene
from jaxbeam._simulation.stable_step import Amplification as Amplification
from jaxbeam._simulation.stable_step import StableStep as StableStep
from jaxbeam._simulation.steady import Steady as Steady
from jaxbeam._simulation.steady import SteadyStart as SteadyStart
from jaxbeam._stability.critical_load import CriticalLoad as CriticalLoad
from jaxbeam._stability.critical_speed import CriticalSpeed as CriticalSpeed
from jaxbeam._stability.floquet import Floquet as Floquet
from jaxbeam._stability.tongues import Tongue as Tongue
from jaxbeam._sweeps.cases import Cases as Cases
from jaxbeam._vibration.campbell import Campbell as Campbell
from jaxbeam._vibration.crossing import Crossing as Crossing
from jaxbeam._vibration.southwell import Southwell as Southwell
from jaxbeam._vibration.stiffening import StiffeningRatio as StiffeningRatio
