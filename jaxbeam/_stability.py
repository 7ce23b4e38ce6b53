"""Speeds at which steady rotation loses its stability, as differentiable functions of parameters.

The energy relative to the hub, V = q'.M q' / 2 + q.K q / 2, is constant along small motions about
steady rotation, M q'' + G q' + K q = 0 with G skew (B eq. 61). While K is positive definite it is a
Liapunov function, and a beam at rest is stable: so what comes first as the speed rises is always
that K becomes singular. There is no flutter before. Nor is there any beyond, as long as the axial
block of K is positive definite: with p negative eigenvalues of K the matrix

    lambda^2 [M_w - g (lambda^2 M_u + K_u)^-1 g_u] + K_w,   g_u = -g^T,

of the transverse motion is symmetric, has p negative eigenvalues at lambda = 0 and none for large
real lambda; so p modes grow without oscillation, and p is all that a Hamiltonian system with p
negative energies can have. Damping changes none of it (theorem of Kelvin, Tait and Chetaev).

So the critical speed is the smallest one at which K is singular, and what is singular names it: a
transverse block, divergence; the axial one, where the centrifugal load grows as fast with stretch
as the rod can carry: it tears.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._linalg import dense, lowest_eigenpair, solve
from jaxbeam._models.base import AbstractModel, Family, checked_case
from jaxbeam._motion import spinning
from jaxbeam._results import where_known, without_derivatives
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Matrix, Scalar, Vector

_SCANNED = 64  # speeds at which a model that is not affine is looked at


class CriticalSpeed(eqx.Module):
    """Where steady rotation loses its stability.

    | field         | shape | unit  |                                                              |
    |---------------|-------|-------|--------------------------------------------------------------|
    | angular_speed | ()    | rad/s | smallest speed at which the stiffness is singular; infinite  |
    |               |       |       | where there is none                                          |
    | family        | ()    |       | `Family` of the coordinates that give way: `IN_PLANE` and    |
    |               |       |       | `FLAP` diverge, `AXIAL` means that the rod tears: beyond, it |
    |               |       |       | has no equilibrium; without meaning where there is no speed  |
    | shape         | (n,)  |       | the direction that gives way, largest entry 1                |
    | status        | ()    |       | `Status`                                                     |
    """

    angular_speed: Scalar
    family: Code
    shape: Vector
    status: Code


def critical_speed(model: AbstractModel, rotor: Any, *, throw: bool = True) -> CriticalSpeed:
    """Smallest speed at which steady rotation loses its stability (rad/s): K(Omega) is singular.

    Where K is affine in Omega^2 (`Hybrid`, `Classical`, `SmallStrainANCF`, `DiscreteLC`, `LP`)
    this is one eigenproblem, K_0 x = -Omega^2 K_1 x. Else K, at the steady state of each speed, is
    looked at from half the first rest frequency up to the speed at which a rod of constant axial
    stiffness tears, and a change of sign of its lowest eigenvalue is enclosed. From there it is, by
    Newton's method, the root of the scalar f of the bordered system

        [[K, b], [b^T, 0]] (x, f) = (0, 1),

    through which it is differentiable by every parameter, in both modes and to any order.

    That of `EngineeringANCF` tears there. Materials that harden (`ANCF`, `GreenANCF`) have a steady
    state at any speed; infinity then means: none up to there, where their strains are of order one.
    An interval of instability narrower than a step of the scan (64 up to there, in ratio) that ends
    again would be missed. Beyond divergence `modes` says how fast what grows (`growth_rate`).

    `throw=False` returns failures in `CriticalSpeed.status`, and NaN (derivatives: as in `modes`;
    those of an infinite speed are zero). Errors as in `modes`.
    """
    rotor, zero = checked_case(model, rotor)
    result = _critical(model, rotor, zero)
    return raise_unless_ok(result, result.status) if throw else result


@eqx.filter_jit
def _critical(model: AbstractModel, rotor: Any, zero: Scalar) -> CriticalSpeed:
    given = rotor.status(zero)
    fine = given == Status.OK
    rotor = jax.tree.map(lambda leaf: jnp.where(fine, leaf, 1.0), rotor)
    start, family, x, status = _guess(model, *without_derivatives((rotor, zero)))
    status = jnp.where(fine, status, given).astype(int)
    exists = jnp.isfinite(start) & (status == Status.OK)
    start = jnp.where(exists, start, 1.0)
    # Coordinates in which K has ones on its diagonal at rest, so that the border fits.
    scale = jax.lax.stop_gradient(jnp.diag(_undeformed(model, rotor, zero))) ** -0.5
    border = x / scale / jnp.linalg.norm(x / scale)

    def bordered(speed: Scalar) -> tuple[Scalar, Vector]:
        """f, and the direction x."""
        k = _undeformed(model, rotor, speed)
        if not _is_affine(model, rotor):  # where a rod tears there is no state to be at
            tears = family == Family.AXIAL
            moved = model.matrices(rotor, jnp.where(tears | ~exists, 0.0, speed)).stiffness
            k = jnp.where(tears, k, moved)
        # In a case without a critical speed any regular problem will do.
        k = jnp.where(exists, scale[:, None] * k * scale[None], jnp.eye(x.size))
        system = jnp.block([[k, border[:, None]], [border[None], jnp.zeros((1, 1))]])
        solution = solve(system, jnp.zeros(x.size + 1).at[-1].set(1.0))
        return jnp.where(exists, solution[-1], speed - 1.0), scale * solution[:-1]

    def newton(_: object, start: Scalar) -> tuple[Scalar, Vector]:
        def body(state: tuple[Array, ...]) -> tuple[Array, ...]:
            speed, _, _, k = state
            value, slope, x = jax.jvp(bordered, (speed,), (jnp.ones_like(speed),), has_aux=True)
            return speed - value / slope, x, jnp.abs(value / slope), k + 1

        def go_on(state: tuple[Array, ...]) -> Array:
            speed, _, change, k = state
            return (change > 1e-14 * jnp.abs(speed)) & (k < 8)

        first = start, x, jnp.full_like(start, jnp.inf), jnp.asarray(0)
        return jax.lax.while_loop(go_on, body, first)[:2]

    found, x = jax.lax.custom_root(
        lambda speed: bordered(speed)[0], start, newton, lambda g, y: y / g(jnp.ones_like(y)),
        has_aux=True,
    )  # fmt: skip
    # The guess is right to many digits: another root would be another answer.
    lost = exists & ~(jnp.abs(found - start) <= 1e-4 * start)
    status = jnp.where(lost, Status.INACCURATE, status)
    ok = status == Status.OK
    return CriticalSpeed(
        angular_speed=where_known(ok, jnp.where(exists, found, jnp.inf)),
        family=family,
        shape=jnp.where(ok & exists, x / x[jnp.argmax(jnp.abs(x))], jnp.nan),
        status=status,
    )


def _is_affine(model: AbstractModel, rotor: Any) -> bool:
    """Whether K is affine in Omega^2: nothing in the steady state changes it."""
    return model.equations(rotor).is_linear or Family.AXIAL not in model.families


def _undeformed(model: AbstractModel, rotor: Any, speed: Scalar) -> Matrix:
    """K of the beam kept as it is at rest; its axial block is that of a rod of constant stiffness,
    wherever it is."""
    equations, rest = model.equations(rotor), jnp.zeros(len(model.families), speed.dtype)
    k = dense(equations.tangents(spinning(speed), rest, rest, None)[0])
    return (k + k.T) / 2


def _guess(model: AbstractModel, rotor: Any, zero: Scalar) -> tuple[Scalar, Code, Vector, Code]:
    """Critical speed, family and direction, and a status."""
    one, n = jnp.ones_like(zero), len(model.families)

    def rate(speed: Scalar) -> Matrix:
        return jax.jvp(lambda speed: _undeformed(model, rotor, speed), (speed,), (one,))[1]

    k0 = _undeformed(model, rotor, zero)
    k1 = jax.jvp(rate, (zero,), (one,))[1] / 2  # exactly, without the cancellation of differences
    present = [family for family in Family if family in model.families]
    rows = {family: _rows(model, family) for family in present}
    speeds, shapes = [], []
    for family in present:
        own = np.ix_(rows[family], rows[family])
        least, x = lowest_eigenpair(k1[own], k0[own])  # K_1 x = least K_0 x
        soft = least < -1e-13 * jnp.linalg.norm(k1[own]) / jnp.linalg.norm(k0[own])
        speeds.append(jnp.where(soft, jnp.abs(jnp.where(soft, least, 1.0)) ** -0.5, jnp.inf))
        shapes.append(jnp.zeros(n, zero.dtype).at[rows[family]].set(x))
    speed, shape, codes = (
        jnp.stack(speeds),
        jnp.stack(shapes),
        jnp.asarray([int(f) for f in present]),
    )
    if _is_affine(model, rotor):
        first = jnp.argmin(speed)
        return speed[first], codes[first], shape[first], jnp.asarray(Status.OK)

    tears = present.index(Family.AXIAL)
    bottom, top = jnp.min(speed) / 2, 0.999 * speed[tears]
    ratio = (top / bottom) ** (1 / (_SCANNED - 1))

    def body(search: _Search) -> _Search:
        """Steps up while K is positive definite, then regula falsi and bisection in turn."""
        system = model.matrices(rotor, search.speed)
        value, x = [], []
        for family in present:
            own = np.ix_(rows[family], rows[family])
            least, direction = lowest_eigenpair(system.stiffness[own], k0[own])
            value.append(least)
            x.append(jnp.zeros(n, zero.dtype).at[rows[family]].set(direction))
        least, low = jnp.min(jnp.stack(value)), jnp.argmin(jnp.stack(value))
        stable = least > 0
        a = jnp.where(stable, jnp.stack([search.speed, least]), search.a)
        b = jnp.where(stable, search.b, jnp.stack([search.speed, least]))
        false = a[0] + (b[0] - a[0]) * a[1] / (a[1] - b[1])
        inside = jnp.where(search.tries % 2 == 0, false, (a[0] + b[0]) / 2)
        return _Search(
            tries=search.tries + 1,
            speed=jnp.where(b[1] <= 0, inside, search.speed * ratio),
            a=a, b=b, family=codes[low], x=jnp.stack(x)[low], axial=value[tears],
            status=system.status,
        )  # fmt: skip

    def go_on(search: _Search) -> Array:
        more = jnp.where(
            search.b[1] <= 0,
            search.b[0] - search.a[0] > 1e-5 * search.a[0],
            search.speed <= top * (1 + 1e-9),
        )
        return more & (search.status == Status.OK) & (search.tries < _SCANNED + 100)

    ok = jnp.asarray(int(Status.OK))
    start = _Search(
        tries=jnp.asarray(0), speed=bottom, a=jnp.stack([0 * one, one]), b=jnp.stack([top, one]),
        family=codes[tears], x=shape[tears], axial=one, status=ok,
    )  # fmt: skip
    end = jax.lax.while_loop(go_on, body, start)
    # A thousandth below the speed of tearing a constant axial stiffness has left 0.002 of itself;
    # one that hardens has more than it began with.
    diverges, hardens = end.b[1] <= 0, end.axial > 0.1
    torn = jnp.where(hardens, jnp.inf, speed[tears])
    return (
        jnp.where(diverges, (end.a[0] + end.b[0]) / 2, torn),
        jnp.where(diverges, end.family, codes[tears]),
        jnp.where(diverges, end.x, shape[tears]),
        end.status,
    )


class _Search(NamedTuple):
    """Where the search for a change of sign is: `a` and `b` are speeds and lowest eigenvalues."""

    tries: Array
    speed: Scalar
    a: Vector
    b: Vector
    family: Code
    x: Vector
    axial: Scalar  # lowest eigenvalue of the axial block
    status: Code


def _rows(model: AbstractModel, family: Family) -> np.ndarray:
    return np.flatnonzero([f == family for f in model.families])
