"""Exponential integration of linear second-order systems whose coefficients vary with time."""

from typing import Any, ClassVar, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._linalg import dense, exponential, inverse
from jaxbeam._solvers.steps import length
from jaxbeam._solvers.system import SecondOrderSystem, State, work_rate
from jaxbeam._types import Matrix, Scalar, Vector

_GAUSS = 0.5 + np.array([-1.0, 1.0]) * np.sqrt(3) / 6
_PLACES = np.array([0.0, *_GAUSS, 1.0])
# From values at 0, 1/2, 1 to coefficients of s, s^2, s^3 of the integral of the parabola there.
_SIMPSON = np.array([[1.0, 0.0, 0.0], [-1.5, 2.0, -0.5], [2 / 3, -4 / 3, 2 / 3]])


class _Moment(NamedTuple):
    """At one time: q'' = stiffness q + damping q' + load, and the moving equilibrium p with
    stiffness p + load = 0, its rates, and what is left to do, damping p' - p''."""

    stiffness: Matrix
    damping: Matrix
    place: Vector
    rate: Vector
    rest: Vector


class MagnusInterpolation(diffrax.AbstractLocalInterpolation):
    """z along a step by its own exponential, so that steps may be longer than a vibration; the
    moving equilibrium by the cubic through its ends.

    With A linear in time, the exponent is s mean + s (s - 1) tilt / 2 + s^3 twist, `exponent`.
    """

    t0: Any  # type: ignore[misc]
    t1: Any  # type: ignore[misc]
    y0: State
    start: Float[Array, " m"]
    exponent: Float[Array, "3 m m"]
    scale: Scalar
    place: Float[Array, "4 n"]
    work: Float[Array, " 3"]

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> Any:
        """As in diffrax: the value at t0, or the increment from t0 to t1."""
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        s = (t0 - self.t0) / length(self.t0, self.t1)
        return self.at(s)

    def at(self, s: Any) -> State:
        """y at the share s of the step."""
        n = self.y0.q.size
        mean, tilt, twist = self.exponent
        z = exponential(s * (mean + (s - 1) / 2 * tilt + s**2 * twist)) @ self.start

        def of(s: Scalar) -> Vector:
            p0, p1, r0, r1 = self.place
            bend = s * (1 - s) * ((1 - s) * (r0 + p0 - p1) - s * (r1 + p0 - p1))
            return p0 + s * (p1 - p0) + bend

        place, rate = jax.jvp(of, (jnp.asarray(s, z.dtype),), (jnp.ones((), z.dtype),))
        work = self.y0.work + s * (self.work[0] + s * (self.work[1] + s * self.work[2]))
        return State(place + z[:n], rate / length(self.t0, self.t1) + self.scale * z[n:-1], work)


class Magnus(diffrax.AbstractAdaptiveSolver):
    """Fourth-order Magnus integration of q'' = M^-1 force(t, q, q') for forces linear in q and q'.

    y = (q, q') is measured from the moving equilibrium p(t), at which force(t, p, 0) = 0, so that
    what remains, z' = A z + (0, ...), is driven by p' and p'' alone, and

        z(t + h) = exp(h (A_1 + A_2) / 2 - sqrt(3) h^2 [A_1, A_2] / 12) z(t),

    A_1, A_2 at the two Gauss points (the drive is in A, by one more row and column). Exact in one
    step where the coefficients do not change, and accurate where they change little from step to
    step, however fast the system itself is: fixed steps are what it is for. Its error estimate, the
    part of the commutator, is that of the method of order 2, and asks for shorter steps than
    needed. Steps that beat against a vibration, 2 pi / h near its angular frequency, lose accuracy.

    S. Blanes, F. Casas, J. A. Oteo, J. Ros, The Magnus expansion and some of its applications,
    Physics Reports 470 (2009), section 5.
    """

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = MagnusInterpolation

    def order(self, terms: Any) -> int:
        """4."""
        return 4

    def error_order(self, terms: Any) -> int:
        """Local error of the embedded method, of order 2."""
        return 3

    def init(self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem) -> None:
        """Nothing is kept from step to step."""
        if not args.is_linear:
            raise TypeError("Magnus needs forces that are linear in q and q': give another solver")

    def func(self, terms: Any, t0: Any, y0: State, args: SecondOrderSystem) -> State:
        """The first-order right-hand side."""
        return args.rate(t0, y0)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem, solver_state: None,
        made_jump: Any,
    ) -> tuple[State, State, dict[str, Any], None, Any]:  # fmt: skip
        """One step."""
        h = length(t0, t1)
        n = y0.q.size
        at = jax.vmap(lambda t: _moment(args, t))(t0 + h * _PLACES)
        # In units of the fastest vibration, so that q and q' / scale are of one size.
        scale = jnp.sqrt(jnp.max(jnp.sum(jnp.abs(at.stiffness[0]), 1)))
        _, a1, a2, _ = h * jax.vmap(lambda at: _first_order(at, scale))(at)
        twist = np.sqrt(3) / 12 * (a2 @ a1 - a1 @ a2)
        info: dict[str, Any] = {
            "y0": y0,
            "start": jnp.concatenate(
                [y0.q - at.place[0], (y0.v - at.rate[0]) / scale, jnp.ones(1)]
            ),
            "exponent": jnp.stack([(a1 + a2) / 2, np.sqrt(3) * (a2 - a1), twist]),
            "scale": scale,
            "place": jnp.concatenate([at.place[::3], h * at.rate[::3]]),
            "work": jnp.zeros(3),
        }
        along = MagnusInterpolation(t0=t0, t1=t0 + h, **info)
        states = [y0, along.at(0.5), along.at(1.0)]
        moved = jnp.concatenate(
            [states[1].q - at.place[1], (states[1].v - at.rate[1]) / scale, jnp.ones(1)]
        )
        off = twist @ moved
        error = State(off[:n], scale * off[n:-1], jnp.zeros_like(y0.work))
        powers = [
            work_rate(args, t, y.q, y.v)
            for t, y in zip((t0, t0 + h / 2, t0 + h), states, strict=True)
        ]
        info["work"] = h * (_SIMPSON @ jnp.stack(powers))
        end = State(states[2].q, states[2].v, y0.work + jnp.sum(info["work"]))
        return end, error, info, None, diffrax.RESULTS.successful


def _moment(system: SecondOrderSystem, t: Scalar) -> _Moment:
    one = jnp.ones_like(t)

    def coefficients(t: Scalar) -> tuple[Matrix, Matrix, Vector]:
        zero = jnp.zeros(system.mass.shape[0], t.dtype)
        x = system.inputs(t)
        k, c = system.tangents(x, zero, zero)
        return dense(k), dense(c), system.force(x, zero, zero)

    def place(t: Scalar) -> Vector:
        k, _, load = coefficients(t)
        return inverse(k) @ load

    def rate(t: Scalar) -> tuple[Vector, Vector]:
        return jax.jvp(place, (t,), (one,))

    (at, moving), (_, turning) = jax.jvp(rate, (t,), (one,))
    k, c, _ = coefficients(t)
    flexible = inverse(dense(system.mass))
    stiffness, damping = -(flexible @ k), -(flexible @ c)
    return _Moment(stiffness, damping, at, moving, damping @ moving - turning)


def _first_order(at: _Moment, scale: Scalar) -> Float[Array, "m m"]:
    """z' = A z with z = (q, q' / scale, 1)."""
    n = at.place.size
    none = jnp.zeros((n, n + 1))
    above = jnp.concatenate([none[:, :n], scale * jnp.eye(n), none[:, :1]], 1)
    below = jnp.concatenate([at.stiffness / scale, at.damping, at.rest[:, None] / scale], 1)
    return jnp.concatenate([above, below, jnp.zeros((1, 2 * n + 1))])
