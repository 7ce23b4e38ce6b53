"""What solvers of second-order systems share: one step as a polynomial in time, and its work."""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._solvers.system import SecondOrderSystem, State, without_derivatives
from jaxbeam._types import Scalar, Vector

_NODES = (1 + np.polynomial.legendre.leggauss(4)[0]) / 2
# From values at the nodes to coefficients of s, ..., s^4 of the integral of the cubic there.
_INTEGRAL = np.linalg.inv(np.vander(_NODES, increasing=True)) / np.arange(1, 5)[:, None]


class StepPolynomial(diffrax.AbstractLocalInterpolation):
    """y(t0 + s h) = y0 + bends_1 s + bends_2 s^2 + ... Unlike Hermite's cubic through the ends of a
    step, what solvers put in here does not amplify what is stiff."""

    t0: Any  # type: ignore[misc]
    t1: Any  # type: ignore[misc]
    y0: State
    bends: State  # with a leading axis

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> Any:
        """As in diffrax: the value at t0, or the increment from t0 to t1."""
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        s = (t0 - self.t0) / length(self.t0, self.t1)
        powers = s ** np.arange(1, len(self.bends.work) + 1)
        return jax.tree.map(lambda y, c: y + powers @ c, self.y0, self.bends)


def length(t0: Scalar, t1: Scalar) -> Scalar:
    """Of a step. In a batch, lanes that are done go on with steps of length zero, whose results are
    thrown away; dividing by zero, or overflow in a long step, would still leave NaN in gradients.
    """
    return jnp.where(t1 == t0, 1e-9, t1 - t0)


def finished(
    system: SecondOrderSystem, t0: Scalar, h: Scalar, y0: State, end: Float[Array, " 2n"],
    bends: Float[Array, "m 2n"],
) -> tuple[State, dict[str, State]]:  # fmt: skip
    """The end of a step and its `StepPolynomial`, from those of q and v side by side.

    The work is found by quadrature along the polynomial: it drives nothing, so it needs no stages
    of its own, and it carries no derivatives.
    """
    n, m = y0.q.size, len(bends)
    system, t0, h, start, along = without_derivatives(
        (system, t0, h, jnp.concatenate([y0.q, y0.v]), bends)
    )
    states = start[None] + _NODES[:, None] ** np.arange(1, m + 1)[None] @ along

    def power(t: Scalar, y: Array) -> Scalar:
        return system.power(system.inputs(t), y[:n], y[n:])

    work = h * (_INTEGRAL @ jax.vmap(power)(t0 + h * _NODES, states))
    info = {"y0": y0, "bends": State(bends[:, :n], bends[:, n:], jnp.pad(work, (0, m - 4)))}
    return State(end[:n], end[n:], y0.work + jnp.sum(work)), info


def quintic(h: Scalar, y0: Array, a0: Vector, y1: Array, a1: Vector) -> Array:
    """For `finished`, Hermite's polynomial: coefficients of s, ..., s^5 of q and v side by side."""
    n = a0.size
    q0, v0, q1, v1 = y0[:n], h * y0[n:], y1[:n], h * y1[n:]
    a0, a1 = h**2 * a0, h**2 * a1
    d, e, f = q1 - q0 - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
    q = [v0, a0 / 2, 10 * d - 4 * e + f / 2, -15 * d + 7 * e - f, 6 * d - 3 * e + f / 2]
    v = [2 * q[1], 3 * q[2], 4 * q[3], 5 * q[4], jnp.zeros_like(d)]
    return jnp.concatenate([jnp.stack(q), jnp.stack(v) / h], 1)
