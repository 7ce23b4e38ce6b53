"""Linearly implicit (Rosenbrock) integration of second-order systems."""

from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._programs.kernel import Adjoint
from jaxbeam._solvers.stages import Stages, Tableau, back_through_stages, stages
from jaxbeam._solvers.steps import (
    SecondOrderSolver,
    StepPolynomial,
    combined,
    length,
    run_core,
    step_inputs,
    step_result,
    work_along,
)
from jaxbeam._solvers.system import SecondOrderSystem, State
from jaxbeam._types import Number

Rows = tuple[tuple[float, ...], ...]


def _tableau(
    order: int, gamma: float, weight: Rows, coupling: Rows, times: tuple[float, ...],
    rate: tuple[float, ...], dense: Rows,
) -> Tableau:  # fmt: skip
    """A tableau from what papers print: weights of all stages but the last ones, which start where
    the one before ends, and no zeros."""
    s = len(coupling) + 1

    def square(rows: Rows) -> np.ndarray:
        out = np.zeros((s, s))
        for i, row in enumerate(rows):
            out[i + 1, : len(row)] = row
        return out

    whole = square(weight)
    for i in range(len(weight) + 1, s):
        whole[i] = whole[i - 1]
        whole[i, i - 1] = 1.0
    last = (1.0,) * (s - len(times))
    none = (0.0,) * (s - len(rate))
    coefficients = np.zeros((3, s))
    for row, given in zip(coefficients, dense, strict=False):
        row[: len(given)] = given
    return Tableau(
        order, gamma, whole, square(coupling), np.array((*times, *last)), np.array((*rate, *none)),
        coefficients,
    )  # fmt: skip


# E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), section IV.7 and code
# RODAS with the coefficients of G. Steinebach, Order-reduction of ROW-methods for DAEs and
# method of lines applications, TH Darmstadt preprint 1741 (1995).
_RODAS4P = _tableau(
    order=4,
    gamma=0.25,
    weight=(
        (3.0,),
        (1.831036793486759, 0.4955183967433795),
        (2.304376582692669, -0.05249275245743001, -1.176798761832782),
        (-7.170454962423024, -4.741636671481785, -16.31002631330971, -1.062004044111401),
    ),
    coupling=(
        (-12.0,),
        (-8.791795173947035, -2.207865586973518),
        (10.81793056857153, 6.780270611428266, 19.53485944642410),
        (34.19095006749676, 15.49671153725963, 54.74760875964130, 14.16005392148534),
        (
            34.62605830930532, 15.30084976114473, 56.99955578662667, 18.40807009793095,
            -5.714285714285717,
        ),
    ),
    times=(0.0, 0.75, 0.21, 0.63),
    rate=(0.25, -0.5, -0.023504, -0.0362),
    dense=(
        (25.09876703708589, 11.62013104361867, 28.49148307714626, -5.664021568594133),
        (
            1.638054557396973, -0.7373619806678748, 8.477918219238990, 15.99253148779520,
            -1.882352941176471,
        ),
    ),
)  # fmt: skip

# G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within
# the Julia Differential Equations package, BIT 63:27 (2023).
_RODAS5P = _tableau(
    order=5,
    gamma=0.21193756319429014,
    weight=(
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    (
        -7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256,
        0.030198172008377946,
    ),
),
    coupling=(
    (-14.155112264123755,),
    (-17.97296035885952, -2.859693295451294),
    (147.12150275711716, -1.41221402718213, 71.68940251302358),
    (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
    (
        24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125,
        -0.6610691825249471,
    ),
    (
        30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783,
        -19.097331116725623, -28.087943162872662,
    ),
    (
        37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047,
        -40.06618937091002, -54.66780262877968, -9.48861652309627,
    ),
),
    times=(
        0.0, 0.6358126895828704, 0.4095798393397535, 0.9769306725060716, 0.4288403609558664,
    ),
    rate=(
        0.21193756319429014, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734,
        2.325825639765069,
    ),
    dense=(
        (
            25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204,
            0.524948541321073, 1.1241088310450404, 0.4272876194431874, -0.17202221070155493,
        ),
        (
            -9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796,
            20.176138334709044, 15.98066361424651, -6.789040303419874, -6.710236069923372,
        ),
        (
            11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643,
            -52.072871366152654, -59.78993625266729, -0.15582684282751913, 4.883087185713722,
        ),
    ),
)  # fmt: skip


class Rosenbrock(SecondOrderSolver):
    """Rosenbrock methods for `SecondOrderSystem`: L-stable, stiffly accurate, no Newton iteration.

    Stages for q are eliminated, so that the one matrix of a step is n by n:
    M / (h g) + C + h g K, factorised (or, where dense, inverted) once a step.
    """

    tableau: eqx.AbstractClassVar[Tableau]
    interpolation_cls: ClassVar = StepPolynomial

    def order(self, terms: Any) -> int:
        """The order of the solution."""
        return self.tableau.order

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem, solver_state: None,
        made_jump: Any,
    ) -> tuple[State, State, dict[str, State], None, Any]:  # fmt: skip
        """One step of the method."""
        h = length(t0, t1)
        x0, rate = jax.jvp(args.inputs, (t0,), (jnp.ones_like(t0),))
        # Rounding must not take the last stage past a jump at t1.
        inputs, between = step_inputs(args, jnp.minimum(t0 + h * self.tableau.times, t1), t0, h)
        end, error, coefficients, work = run_core(
            Rosenbrock._core, self, args, h, y0, (x0, rate), inputs, between,
            adjoint=_ADJOINT,
        )  # fmt: skip
        return *step_result(y0, end, error, coefficients, work), None, diffrax.RESULTS.successful

    def _core(
        self, system: SecondOrderSystem, h: Number, y0: State, start: Any, inputs: Any, between: Any
    ) -> tuple[Array, Array, Array, Array]:
        """End, error and polynomial of q and v side by side, and the work."""
        done = stages(self.tableau, system, h, y0, start, inputs).done
        end, error, coefficients = self._result(y0, done)
        return end, error, coefficients, work_along(system, between, h, y0, coefficients)

    def _result(self, y0: State, done: Array) -> tuple[Array, Array, Array]:
        change, d1, d2, d3 = combined(self.tableau.of_stages, done)
        coefficients = jnp.stack([change + d1, d2 - d1, d3 - d2, -d3])
        return jnp.concatenate([y0.q, y0.v]) + change, done[-1], coefficients

    def _forwards(
        self, system: SecondOrderSystem, h: Number, y0: State, start: Any, inputs: Any, between: Any
    ) -> tuple[Any, Stages]:
        """The result, and the stages for the way back, on which nobody asks for the work."""
        found = stages(self.tableau, system, h, y0, start, inputs, every=True)
        result = self._result(y0, found.done)
        return (*result, jnp.zeros_like(result[2][:, 0])), found

    def _backwards(self, moving: Any, args: Any, found: Stages, out: Any) -> Any:
        return back_through_stages(self.tableau, moving, args, found, out)


_ADJOINT = Adjoint(Rosenbrock._forwards, Rosenbrock._backwards)


class Rodas4P(Rosenbrock):
    """Rosenbrock method of order 4 with an embedded one of order 3: six stages.

    Dense output is of order 3. G. Steinebach, TH Darmstadt preprint 1741, 1995.
    """

    tableau = _RODAS4P


class Rodas5P(Rosenbrock):
    """Rosenbrock method of order 5 with an embedded one of order 4: eight stages.

    Dense output is of order 4. G. Steinebach, BIT 63:27, 2023.
    """

    tableau = _RODAS5P
