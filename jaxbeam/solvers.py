"""Integrators of M q'' = f(t, q, q') that use its structure, and how to give them such a system.

They are passed as objects, `jaxbeam.simulate(..., solver=Rodas4P())`; any solver of diffrax will do
as well. `amplification` is what a step makes of an oscillation; `stable_step` searches the largest
step with it.
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
from jaxbeam._solvers.system import second_order_term as second_order_term
