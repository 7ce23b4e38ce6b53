"""Integration in time: solvers of M q'' = f(t, q, q') that use its structure, and all of diffrax.

**Solvers of ours** are passed as objects, `jaxbeam.simulate(..., solver=Rodas4P())`. `Rodas5P` (the
default, of order 5) and `Rodas4P` are linearly implicit and solve systems of n by n; the cost of a
step is linear in the number of elements. `Rosenbrock` is their base. `ChordKvaerno5` has implicit
stages, for fixed steps. `Magnus` makes exponential steps for the linear models, which are exact at
constant speed. To give these solvers a system of your own, see `SecondOrderSystem`, `State` and
`SecondOrderSystem.term`.

**Any diffrax** solver of ordinary differential equations (explicit, implicit, or both), step-size
controller, adjoint, `SaveAt`, event or progress meter passes through `simulate`.

**Gradients.** Reverse mode is one sweep backwards over the steps that a solver of ours has made,
with any controller and event: it is the derivative of what was computed, to rounding. It keeps 1024
states of a run at most (and a number or three for each of `max_steps`), and computes those between
once more where there are more steps. Forward mode wants `adjoint=diffrax.ForwardMode()`, and
`BacksolveAdjoint` a solver of diffrax itself. Second derivatives go forward over reverse:
`jax.jacfwd(jax.grad(f))`. docs/speed.md says what gradients cost. Steps follow what moves, also
where derivatives would want shorter ones: docs/limitations.md says when.

**Balance of energy.** A run that the solver calls a success, but whose energy is not balanced by
the work done, is reported as `UNBALANCED`, and its answers are NaN: an explicit solver at loose
tolerance can return a deflection of 7 m for 0.5 m and call it good. Of 40 runs of
`studies/integrator_stability.py` adaptive explicit methods at loose tolerance ended in such
nonsense in 9, and the balance of energy caught all of these.

**Where a method is stable.** Fixed explicit steps fail at `stable_step`, the largest fixed step of
any integrator on any model. `amplification` is what a step makes of an oscillation; `stable_step`
searches with it.
"""

from jaxbeam._simulation.stable_step import amplification as amplification
from jaxbeam._simulation.stable_step import stable_step as stable_step
from jaxbeam._solvers.kvaerno import ChordKvaerno5 as ChordKvaerno5
from jaxbeam._solvers.magnus import Magnus as Magnus
from jaxbeam._solvers.rodas import Rodas4P as Rodas4P
from jaxbeam._solvers.rodas import Rodas5P as Rodas5P
from jaxbeam._solvers.rodas import Rosenbrock as Rosenbrock
from jaxbeam._solvers.system import SecondOrderSystem as SecondOrderSystem
from jaxbeam._solvers.system import State as State
