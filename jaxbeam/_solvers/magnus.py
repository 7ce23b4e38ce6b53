"""Exponential integration of linear second-order systems whose coefficients vary with time."""

from typing import Any, ClassVar, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._numerics.exponential import exponential
from jaxbeam._numerics.linalg import dense, inverse
from jaxbeam._results import without_derivatives
from jaxbeam._solvers.steps import Interpolation, SecondOrderSolver, length
from jaxbeam._solvers.system import SecondOrderSystem, State
from jaxbeam._types import Matrix, Scalar, Vector

# The points of Gauss and Legendre with two nodes; that the commutator of the values there counts
# 3^(1/2) / 12 is what gives order 4 (section 5.4 of the review cited below).
_GAUSS = 0.5 + np.array([-1.0, 1.0]) * np.sqrt(3) / 6
_SLOW = 0.1  # angle in a step of motions that are not measured from their equilibrium
_PLACES = np.array([0.0, *_GAUSS, 1.0])
# From values at 0, 1/2, 1 to coefficients of s, s^2, s^3 of the integral of the parabola there.
_SIMPSON = np.array([[1.0, 0.0, 0.0], [-1.5, 2.0, -0.5], [2 / 3, -4 / 3, 2 / 3]])


class _Moment(NamedTuple):
    """The linear system at one time: q'' = stiffness q + damping q' + load, the moving place p, its
    rates, and what is left to do, stiffness p + load + damping p' - p''."""

    stiffness: Matrix
    damping: Matrix
    place: Vector
    rate: Vector
    rest: Vector


class MagnusInterpolation(Interpolation):
    """z along a step by its own exponential, so that steps may be longer than a vibration; the
    moving place by the cubic through its ends.

    With A linear in time, the exponent is s mean + s (s - 1) tilt / 2 + s^3 twist, `exponent`.
    """

    start: Float[Array, " m"]
    exponent: Float[Array, "3 m m"]
    scale: Scalar
    place: Float[Array, "4 n"]
    unit: Scalar  # of the part of the work that is in z
    work: Float[Array, " 3"]  # the rest of it

    def at(self, s: Scalar) -> State:
        return self.state(s, self.offset(s))

    def offset(self, s: Scalar) -> Float[Array, " m"]:
        """The vector z = (q - p, (q' - p') / scale, 1, work / unit) at the share s of the step, p
        being the moving place."""
        mean, tilt, commutator = self.exponent
        return exponential(s * (mean + (s - 1) / 2 * tilt + s**2 * commutator)) @ self.start

    def state(self, s: Scalar, z: Float[Array, " m"]) -> State:
        """The state whose vector is z."""
        n = self.y0.q.size

        def moving(s: Scalar) -> Vector:
            p0, p1, r0, r1 = self.place
            bend = s * (1 - s) * ((1 - s) * (r0 + p0 - p1) - s * (r1 + p0 - p1))
            return p0 + s * (p1 - p0) + bend

        place, rate = jax.jvp(moving, (s,), (jnp.ones_like(s),))
        work = s * (self.work[0] + s * (self.work[1] + s * self.work[2]))
        work = jax.lax.stop_gradient(self.y0.work + self.unit * z[-1] + work)
        rate = rate / length(self.t0, self.t1)
        return State(place + z[:n], rate + self.scale * z[n : 2 * n], work)


class Magnus(SecondOrderSolver):
    """Fourth-order Magnus integration of q'' = M^-1 force(t, q, q') for forces linear in q and q'.

    y = (q, q') is measured from a moving place p(t). With force(t, q, 0) = f - K q it is

        p = Re[(K + i s M)^-1 f],   s = (0.1 / h)^2,

    of all but what is slow in a step the moving equilibrium, so that what remains, z' = A z + (0,
    ...), is driven by little but p' and p''; of motions that nothing holds it is zero, since K may
    be singular or negative. Then

        z(t + h) = exp(h (A_1 + A_2) / 2 - sqrt(3) h^2 [A_1, A_2] / 12) z(t),

    A_1, A_2 at the two Gauss points (the drive is in A, by one more row and column, and so is the
    part of the power that is linear in z, by another row). Exact in one step where the coefficients
    do not change, and accurate where they change little from step to step, however fast the system
    itself is: fixed steps are what it is for. What is quadratic in the power is integrated by
    Simpson's rule, to which steps longer than a vibration are long. Its error estimate, the
    part of the commutator, is that of the method of order 2, and asks for shorter steps than
    needed. Steps that beat against a vibration, 2 pi / h near its angular frequency, lose accuracy.

    S. Blanes, F. Casas, J. A. Oteo, J. Ros, The Magnus expansion and some of its applications,
    Physics Reports 470 (2009), section 5.
    """

    interpolation_cls: ClassVar = MagnusInterpolation

    def order(self, terms: Any) -> int:
        """The order of the solution, 4."""
        return 4

    def error_order(self, terms: Any) -> int:
        """The order of the local error of the embedded method, 2."""
        return 3

    def init(self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem) -> None:
        """Nothing is kept from step to step."""
        if not args.is_linear:
            raise TypeError("Magnus needs forces that are linear in q and q': give another solver")

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem, solver_state: None,
        made_jump: Any,
    ) -> tuple[State, State, dict[str, Any], None, Any]:  # fmt: skip
        """One step of the method."""
        h = length(t0, t1)
        n = y0.q.size
        flexible = inverse(dense(args.mass))
        at = jax.vmap(lambda t: _moment(args, flexible, t, (_SLOW / h) ** 2))(t0 + h * _PLACES)
        # In units of the fastest vibration, so that q and q' / scale are of one size.
        fastest = jnp.sqrt(jnp.max(jnp.sum(jnp.abs(at.stiffness[0]), 1)))
        scale = jnp.maximum(jax.lax.stop_gradient(fastest), 1 / h)  # there may be none
        power = jax.vmap(lambda t, q, v: _power(args, t, q, v))
        given = power(t0 + h * _GAUSS, at.place[1:3], at.rate[1:3])
        rows, unit = _work_rows(given, scale)
        inner = jax.tree.map(lambda a: a[1:3], at)
        a1, a2 = h * jax.vmap(lambda at, row: _first_order(at, scale, row))(inner, rows)
        commutator = np.sqrt(3) / 12 * (a2 @ a1 - a1 @ a2)
        apart = y0.q - at.place[0], (y0.v - at.rate[0]) / scale
        info: dict[str, Any] = {
            "y0": y0,
            "start": jnp.concatenate([*apart, jnp.stack([jnp.ones_like(h), jnp.zeros_like(h)])]),
            "exponent": jnp.stack([(a1 + a2) / 2, np.sqrt(3) * (a2 - a1), commutator]),
            "scale": scale,
            "place": jnp.concatenate([at.place[::3], h * at.rate[::3]]),
            "unit": unit,
        }
        along = MagnusInterpolation(t0=t0, t1=t0 + h, **info, work=jnp.zeros_like(h, shape=3))
        half, one = jnp.full_like(h, 0.5), jnp.ones_like(h)
        middle = along.offset(half)
        states = [y0, along.state(half, middle), along.at(one)]
        off = commutator @ middle
        error = State(off[:n], scale * off[n : 2 * n], jnp.zeros_like(y0.work))
        shares = np.array([0.0, 0.5, 1.0])
        places = jax.vmap(lambda s: along.state(s, 0 * middle))(shares)
        states = jax.tree.map(lambda *a: jnp.stack(a), *states)
        there, by_q, by_v = power(t0 + h * shares, places.q, places.v)
        here, _, _ = power(t0 + h * shares, states.q, states.v)
        moved = by_q * (states.q - places.q) + by_v * (states.v - places.v)
        work = h * (_SIMPSON @ (here - there - jnp.sum(without_derivatives(moved), 1)))
        end = jax.tree.map(lambda a: a[2], states)
        end = State(end.q, end.v, end.work + jnp.sum(work))
        return end, error, {**info, "work": work}, None, diffrax.RESULTS.successful


def _moment(system: SecondOrderSystem, flexible: Matrix, t: Scalar, slow: Scalar) -> _Moment:
    """The data of the system at a time that the method takes; `flexible` is the inverse of the
    mass, `slow` the square of the frequency below which motions are not measured from their
    equilibrium."""
    one, zero = jnp.ones_like(t), jnp.zeros_like(flexible[0])

    def given(t: Scalar) -> tuple[Vector, Matrix, Matrix]:
        x = system.inputs(t)
        k, c = system.tangents(x, zero, zero)
        return system.force(x, zero, zero), dense(k), dense(c)

    def moving(t: Scalar) -> Any:
        return jax.jvp(given, (t,), (one,))

    (now, first), (_, second) = jax.jvp(moving, (t,), (one,))
    load, k, c = now
    lagging = inverse(k + 1j * slow * dense(system.mass))
    p = lagging @ (load + 0j)
    p1 = lagging @ (first[0] - first[1] @ p)
    p2 = lagging @ (second[0] - second[1] @ p - 2 * first[1] @ p1)
    stiffness, damping = -(flexible @ k), -(flexible @ c)
    # K Re(p) - slow M Im(p) = f: so much of the load is left, without cancellation.
    rest = -slow * p.imag + damping @ p1.real - p2.real
    return _Moment(stiffness, damping, p.real, p1.real, rest)


def _power(system: SecondOrderSystem, t: Scalar, q: Vector, v: Vector) -> tuple[Array, ...]:
    """The power in a state, and its derivatives by q and v there; by parameters it has none."""
    system, t, q, v = without_derivatives((system, t, q, v))
    found, (by_q, by_v) = jax.value_and_grad(
        lambda q, v: system.power(system.inputs(t), q, v), argnums=(0, 1)
    )(q, v)
    return found, by_q, by_v


def _work_rows(given: tuple[Array, ...], scale: Scalar) -> tuple[Float[Array, "2 m"], Scalar]:
    """The rows that the rate of the work takes of z at the Gauss points, in a unit, and that."""
    there, by_q, by_v = given
    none = jnp.zeros_like(there[:, None])
    rows = jnp.concatenate([by_q, jax.lax.stop_gradient(scale) * by_v, there[:, None], none], 1)
    size = jnp.max(jnp.abs(rows)) / jax.lax.stop_gradient(scale)
    unit = jnp.where(size > 0, size, 1.0)
    return rows / unit, unit


def _first_order(at: _Moment, scale: Scalar, row: Float[Array, " m"]) -> Float[Array, "m m"]:
    """The matrix of z' = A z with z = (q, q' / scale, 1, work)."""
    n = at.place.size
    none = jnp.zeros((n, n + 1))
    above = jnp.concatenate([none[:, :n], scale * jnp.eye(n), none[:, :2]], 1)
    below = [at.stiffness / scale, at.damping, at.rest[:, None] / scale, none[:, :1]]
    end = jnp.stack([jnp.zeros_like(row), row])
    return jnp.concatenate([above, jnp.concatenate(below, 1), end])
