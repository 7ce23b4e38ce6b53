"""A diagonally implicit Runge-Kutta method of order 5 for second-order systems."""

from typing import Any, ClassVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._numerics.blocks import padded
from jaxbeam._numerics.linalg import inverse
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
from jaxbeam._types import Number, Vector

_TABLEAU = diffrax.Kvaerno5.tableau
_GAMMA = 0.26
_TIMES = np.asarray(_TABLEAU.c)


def _rows(rows: Any) -> np.ndarray:
    return np.stack([np.pad(row, (0, 7 - len(row))) for row in rows])


_WEIGHT, _PREDICTOR = _rows(_TABLEAU.a_lower), _rows(_TABLEAU.a_predictor)
_ERROR = np.asarray(_TABLEAU.b_error)


class ChordKvaerno5(SecondOrderSolver):
    """Kvaerno's L-stable method of order 5(4) for `SecondOrderSystem`, by chord iterations.

    Each stage has `iterations` of them, an int >= 1.

    With q = q~ + h g v and v = v~ + h g a, a stage solves M a = f(t, q, v) for a alone; all stages
    and iterations share one matrix M + h g C + (h g)^2 K. The embedded error is filtered by it, and
    dense output is the quintic through q, q' and q'' at both ends. Very accurate at fixed steps;
    where steps are so long that the matrix ages, the embedded error sees little of what the
    iterations leave: adaptive steps want more `iterations`, or `Rodas5P`.

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
        inputs, between = step_inputs(args, t0 + h * _TIMES, t0, h)
        end, error, coefficients, work, last = run_core(
            ChordKvaerno5._core, self, args, h, y0, a, args.inputs(t0), inputs, between
        )
        return *step_result(y0, end, error, coefficients, work), last, diffrax.RESULTS.successful

    def _core(
        self, system: SecondOrderSystem, h: Number, y0: State, a: Vector, x0: Any, inputs: Any,
        between: Any,
    ) -> tuple[Array, Array, Array, Array, Vector]:  # fmt: skip
        """The end, error and polynomial of q and v side by side, the work, and the last q''."""
        q, v = y0.q, y0.v
        n, g = len(q), _GAMMA * h
        k, c = system.tangents(x0, q, v)
        solve = inverse(system.mass + g * c + g**2 * k)
        both = jnp.concatenate([q, v])

        def stage(done: Array, row: Any) -> tuple[Array, None]:
            i, rows, now = row
            step, past = combined(rows, done)
            explicit = both + h * step

            def at(a: Vector) -> tuple[Vector, Vector]:
                rate = explicit[n:] + g * a
                return explicit[:n] + g * rate, rate

            def improve(a: Vector, _: None) -> tuple[Vector, None]:
                return a - solve @ (system.mass @ a - system.force(now, *at(a))), None

            a, _ = jax.lax.scan(improve, past[n:], None, length=self.iterations)
            new = jnp.concatenate([at(a)[1], a])
            return jax.lax.dynamic_update_index_in_dim(done, new, i, 0), None

        rows = jnp.asarray(np.stack([_WEIGHT, _PREDICTOR], 1), q.dtype)
        start = padded(jnp.concatenate([v, a])[None], 0, 6)
        done, _ = jax.lax.scan(stage, start, (jnp.arange(1, 7), rows, inputs))

        # The last stage is the end of the step.
        change, off = h * combined(np.stack([np.append(_WEIGHT[-1, :-1], _GAMMA), _ERROR]), done)
        filtered = solve @ (system.mass @ off[n:] - g * (k @ off[:n]))
        off = jnp.concatenate([off[:n] + g * filtered, filtered])
        coefficients = _quintic(h, both, a, both + change, done[-1, n:])
        work = work_along(system, between, h, y0, coefficients)
        return both + change, off, coefficients, work, done[-1, n:]


def _quintic(h: Number, y0: Array, a0: Vector, y1: Array, a1: Vector) -> Array:
    """Hermite's polynomial: coefficients of s, ..., s^5 of q and v side by side."""
    n = len(a0)
    q0, v0, q1, v1 = y0[:n], h * y0[n:], y1[:n], h * y1[n:]
    a0, a1 = h**2 * a0, h**2 * a1
    d, e, f = q1 - q0 - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
    q = [v0, a0 / 2, 10 * d - 4 * e + f / 2, -15 * d + 7 * e - f, 6 * d - 3 * e + f / 2]
    v = [2 * q[1], 3 * q[2], 4 * q[3], 5 * q[4], jnp.zeros_like(d)]
    return jnp.concatenate([jnp.stack(q), jnp.stack(v) / h], 1)
