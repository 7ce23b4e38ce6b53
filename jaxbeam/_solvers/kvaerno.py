"""A diagonally implicit Runge-Kutta method of order 5 for second-order systems."""

from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._numerics.blocks import padded
from jaxbeam._numerics.kinematics import Straight
from jaxbeam._results import without_derivatives
from jaxbeam._solvers.steps import (
    Linearised,
    SecondOrderSolver,
    StepPolynomial,
    combined,
    length,
    run_core,
    step_result,
)
from jaxbeam._solvers.system import SecondOrderSystem, State
from jaxbeam._types import Number, Vector

_TABLEAU = diffrax.Kvaerno5.tableau
_GAMMA = 0.26
_TIMES = np.asarray(_TABLEAU.c)


def _rows(rows: Any) -> np.ndarray:
    return np.stack([np.pad(row, (0, 7 - len(row))) for row in rows])


_WEIGHT, _PREDICTOR = _rows(_TABLEAU.a_lower), _rows(_TABLEAU.a_predictor)
_ERROR = np.asarray(_TABLEAU.b_error)
_WHOLE = np.pad(_WEIGHT, ((1, 0), (0, 0))) + np.diag([0.0, *[_GAMMA] * 6])  # of every stage


def _along() -> np.ndarray:
    """Weights (4, 7) of stages, by s, ..., s^4, in the state along a step: of order 4, stages being
    of order 2, and of order 5 at its end. What is stiff goes with the states at implicit stages
    alone, since the rate at the start, by forces that may have jumped, is large of it."""
    c, implicit = np.array([0.0, *_TIMES]), _WHOLE[1:]
    of_start = np.array([1.0, *-np.linalg.solve(implicit[:, 1:], implicit[:, 0])])
    terms = np.stack([c**0, c, c**2, _WHOLE @ c**2, c**3, of_start], 1)
    values = np.zeros((4, 6))
    values[[0, 1, 2, 3, 3], range(5)] = 1, 1 / 2, 1 / 3, 1 / 12, 1 / 4
    least = values @ np.linalg.pinv(terms)
    return least + (_WHOLE[-1] - least.sum(0)) / 4


_ALONG = _along()


class ChordKvaerno5(SecondOrderSolver):
    """Kvaerno's L-stable method of order 5(4) for `SecondOrderSystem`, by chord iterations.

    Each stage has `iterations` of them, an int >= 1.

    With q = q~ + h g q' and v = v~ + h g v', a stage solves q' = kinematics(q, v) and
    M v' = f(t, q, v); all stages and iterations share one matrix, M / (h g) + C + h g K where
    q' = v. The embedded error is filtered by it, and dense output is of order 4. Very accurate at
    fixed steps; where steps are so long that the matrix ages, the embedded error sees little of
    what the iterations leave: adaptive steps want more `iterations`, or `Rodas5P`.

    A. Kvaerno, Singly diagonally implicit Runge-Kutta methods with an explicit first stage,
    BIT 44 (2004); coefficients from `diffrax.Kvaerno5`.

    Raises `TypeError` or `ValueError` for any other number of iterations.
    """

    iterations: int = eqx.field(static=True, default=3)
    interpolation_cls: ClassVar = StepPolynomial

    def __check_init__(self) -> None:
        if isinstance(self.iterations, bool) or not isinstance(self.iterations, int):
            raise TypeError(f"iterations must be an int, got {type(self.iterations).__name__}")
        if self.iterations < 1:
            raise ValueError(f"iterations must be at least 1, got {self.iterations}")

    def order(self, terms: Any) -> int:
        """The order of the solution, 5."""
        return 5

    def init(self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem) -> Vector:
        """The acceleration at the start: from there on it is that of the last stage. Computed from
        the state anew, it would amplify what the iterations left in stiff components."""
        return args.acceleration(t0, y0.q, y0.v)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem,
        solver_state: Vector, made_jump: Any,
    ) -> tuple[State, State, dict[str, State], Vector, Any]:  # fmt: skip
        """One step. After a jump of the forces the acceleration is computed anew."""
        h, a = length(t0, t1), solver_state
        if made_jump is not False:
            a = jax.lax.cond(
                made_jump, lambda: args.acceleration(t0, y0.q, y0.v), lambda: solver_state
            )
        inputs = jax.vmap(args.inputs)(t0 + h * np.array([0.0, *_TIMES]))
        end, error, coefficients, work, last = run_core(
            ChordKvaerno5._core, self, args, h, y0, a, inputs
        )
        return *step_result(y0, end, error, coefficients, work), last, diffrax.RESULTS.successful

    def _core(
        self, system: SecondOrderSystem, h: Number, y0: State, a: Vector, inputs: Any
    ) -> tuple[Array, Array, Array, Array, Vector]:
        """The end, error and polynomial of q and v side by side, the work, and the last v'."""
        q, v = y0.q, y0.v
        n, g = len(q), _GAMMA * h
        x0, later = (jax.tree.map(part, inputs) for part in (lambda x: x[0], lambda x: x[1:]))
        about = Linearised.of(system, q, v, g, system.tangents(x0, q, v))
        plain = isinstance(about.kinematics, Straight)
        both = jnp.concatenate([q, v])

        def stage(done: Array, row: Any) -> tuple[Array, None]:
            i, rows, now = row
            step, guess = combined(rows, done)
            explicit = both + h * step

            def improve(rate: Array, _: None) -> tuple[Array, None]:
                if plain:  # q' = v holds in every iteration, and needs no product with K
                    rate = jnp.concatenate([explicit[n:] + g * rate[n:], rate[n:]])
                at = explicit + g * rate
                at_q, at_v = at[:n], at[n:]
                off_v = system.force(now, at_q, at_v) - system.mass @ rate[n:]
                if plain:
                    change = about.solve @ off_v / g
                    return rate + jnp.concatenate([g * change, change]), None
                off_q = system.kinematics(at_q, at_v) - rate[:n]
                return rate + about.change(off_q, off_v) / g, None

            rate, _ = jax.lax.scan(improve, guess, None, length=self.iterations)
            return jax.lax.dynamic_update_index_in_dim(done, rate, i, 0), None

        rows = jnp.asarray(np.stack([_WEIGHT, _PREDICTOR], 1), q.dtype)
        start = padded(jnp.concatenate([system.kinematics(q, v), a])[None], 0, 6)
        done, _ = jax.lax.scan(stage, start, (jnp.arange(1, 7), rows, later))

        # The last stage is the end of the step.
        change, off = h * combined(np.stack([_WHOLE[-1], _ERROR]), done)
        off = about.change(off[:n] / g, system.mass @ off[n:] / g)
        work = _work(system, inputs, h, both, done)
        return both + change, off, h * combined(_ALONG, done), work, done[-1, n:]


def _work(
    system: SecondOrderSystem, inputs: Any, h: Number, start: Array, done: Float[Array, "7 m *k"]
) -> Float[Array, "4 *k"]:
    """The work, by powers at stages."""
    system, inputs, h, start, done = without_derivatives((system, inputs, h, start, done))
    n = len(start) - system.mass.shape[0]
    states = start[None] + h * combined(_WHOLE, done)
    power = jax.vmap(lambda x, y: system.power(x, y[:n], y[n:]))(inputs, states)
    return h * combined(_ALONG, power[:, None])[:, 0]
