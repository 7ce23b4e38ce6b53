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

B: M. Berzeri, A. A. Shabana, A finite element study of the geometric centrifugal stiffening effect,
Technical Report MBS99-5-UIC, 1999.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.base import AbstractModel, Family, checked_case, planes_of
from jaxbeam._numerics.linalg import dense, lowest_eigenpair, solve
from jaxbeam._numerics.program import Program
from jaxbeam._results import harmless, where_known, without_derivatives
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.motion import spinning
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


def critical_speed(model: AbstractModel, rotor: AnyRotor, *, throw: bool = True) -> CriticalSpeed:
    """Smallest speed at which steady rotation loses its stability (rad/s): K(Omega) is singular.

    Where K is affine in Omega^2 (`Hybrid`, `Classical`, `SmallStrainANCF`, `DiscreteLC`, `LP`)
    this is one eigenproblem, K_0 x = -Omega^2 K_1 x. Else K, at the steady state of each speed, is
    looked at from half the first rest frequency up to the speed at which a rod of constant axial
    stiffness tears, and the speed at which its lowest eigenvalue changes sign is found to rounding.
    It is also the root of the scalar f of the bordered system

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


@Program
def _critical(model: AbstractModel, rotor: AnyRotor, zero: Scalar) -> CriticalSpeed:
    given = rotor.status(zero)
    fine = given == Status.OK
    rotor = harmless(fine, rotor)
    found, family, x, status = _search(model, *without_derivatives((rotor, zero)))
    status = jnp.where(fine, status, given).astype(int)
    ok = status == Status.OK
    exists = jnp.isfinite(found) & ok
    place = _Place(model, family, x, exists)
    speed = _root(place, rotor, jnp.where(exists, found, 1.0))
    return CriticalSpeed(
        angular_speed=where_known(ok, jnp.where(exists, speed, jnp.inf)),
        family=family,
        shape=jnp.where(exists, x / x[jnp.argmax(jnp.abs(x))], jnp.nan),
        status=status,
    )


class _Place(eqx.Module):
    """What is known of a critical speed, without derivatives."""

    model: AbstractModel
    family: Code
    x: Vector
    exists: Array

    def bordered(self, rotor: AnyRotor, speed: Scalar) -> Scalar:
        """The function f that is zero at the critical speed."""
        model, x = self.model, self.x
        # Coordinates in which K has ones on its diagonal at rest, so that the border fits.
        rest = without_derivatives(_undeformed(model, rotor, jnp.zeros_like(speed)))
        scale = jnp.diag(rest) ** -0.5
        border = x / scale / jnp.linalg.norm(x / scale)
        k = _undeformed(model, rotor, speed)
        if not _is_affine(model, rotor):  # where a rod tears there is no state to be at
            tears = self.family == Family.AXIAL
            moved = model.matrices(rotor, jnp.where(tears | ~self.exists, 0.0, speed)).stiffness
            k = jnp.where(tears, k, moved)
        # In a case without a critical speed any regular problem will do.
        k = jnp.where(self.exists, scale[:, None] * k * scale[None], jnp.eye(x.size))
        system = jnp.block([[k, border[:, None]], [border[None], jnp.zeros((1, 1))]])
        solution = solve(system, jnp.zeros(x.size + 1).at[-1].set(1.0))
        return jnp.where(self.exists, solution[-1], speed - 1.0)


@eqx.filter_custom_jvp
def _root(place: _Place, rotor: AnyRotor, speed: Scalar) -> Scalar:
    """The critical speed, with its derivatives as the root of f: only where they are asked for is
    f looked at."""
    return speed


@_root.def_jvp
def _root_jvp(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Scalar, Scalar]:
    place, rotor, speed = primals
    # Through the function itself: then this rule can be differentiated again.
    speed = _root(*primals)
    _, change = jax.linearize(place.bordered, rotor, speed)
    still = jax.tree.map(jnp.zeros_like, rotor)
    rates = jax.tree.map(lambda t, z: z if t is None else t, tangents[1], still, is_leaf=_is_none)
    slope = change(still, jnp.ones_like(speed))
    return speed, -change(rates, jnp.zeros_like(speed)) / slope


def _is_none(x: Any) -> bool:
    return x is None


def _is_affine(model: AbstractModel, rotor: AnyRotor) -> bool:
    """Whether K is affine in Omega^2: nothing in the steady state changes it."""
    return model.equations(rotor).is_linear or Family.AXIAL not in model.families


def _undeformed(model: AbstractModel, rotor: AnyRotor, speed: Scalar) -> Matrix:
    """K of the beam kept as it is at rest; its axial block is that of a rod of constant stiffness,
    wherever it is."""
    equations, rest = model.equations(rotor), jnp.zeros(len(model.families), speed.dtype)
    k = dense(equations.tangents(spinning(speed), rest, rest, None)[0])
    return (k + k.T) / 2


def _search(
    model: AbstractModel, rotor: AnyRotor, zero: Scalar
) -> tuple[Scalar, Code, Vector, Code]:
    """Critical speed, family and direction, and a status."""
    k0, speed, shape = _alone(model, rotor, zero)
    present = list(_groups(model, rotor))
    codes = jnp.asarray([int(f) for f in present])
    if _is_affine(model, rotor):
        first = jnp.argmin(speed)
        return speed[first], codes[first], shape[first], jnp.asarray(Status.OK)

    tears = present.index(Family.AXIAL)
    bottom, top = jnp.min(speed) / 2, 0.999 * speed[tears]
    ratio = (top / bottom) ** (1 / (_SCANNED - 1))
    scan = _Scan(model, rotor, k0, codes, tears, top, ratio)
    end = jax.lax.while_loop(scan.goes_on, scan.step, scan.start(zero, bottom, shape[tears]))
    # A thousandth below the speed of tearing a constant axial stiffness has left 0.002 of itself;
    # one that hardens has more than it began with.
    diverges, hardens = end.b[1] <= 0, end.axial > 0.1
    torn = jnp.where(hardens, jnp.inf, speed[tears])
    lost = (end.tries == _SCANNED + 100) & (end.status == Status.OK)
    return (
        jnp.where(diverges, end.speed, torn),
        jnp.where(diverges, end.family, codes[tears]),
        jnp.where(diverges, end.x, shape[tears]),
        jnp.where(lost, Status.INACCURATE, end.status),
    )


def _alone(
    model: AbstractModel, rotor: AnyRotor, zero: Scalar
) -> tuple[Matrix, Float[Array, " f"], Float[Array, "f n"]]:
    """K at rest, and the speed and the direction in which each family alone would give way, were
    the beam kept as it is at rest."""
    one = jnp.ones_like(zero)

    def with_rate(speed: Scalar) -> tuple[Matrix, Matrix]:
        return jax.jvp(lambda speed: _undeformed(model, rotor, speed), (speed,), (one,))

    (k0, _), (_, curvature) = jax.jvp(with_rate, (zero,), (one,))
    k1 = curvature / 2  # exactly, without the cancellation of differences
    speeds, shapes = [], []
    for rows in _groups(model, rotor).values():
        least, x = _softest(rows, k1, k0)  # K_1 x = least K_0 x
        own = np.ix_(rows, rows)
        soft = least < -1e-13 * jnp.linalg.norm(k1[own]) / jnp.linalg.norm(k0[own])
        speeds.append(jnp.where(soft, jnp.abs(jnp.where(soft, least, 1.0)) ** -0.5, jnp.inf))
        shapes.append(x)
    return k0, jnp.stack(speeds), jnp.stack(shapes)


class _State(NamedTuple):
    """Where the search for a change of sign is: `a` and `b` are speeds and lowest eigenvalues."""

    tries: Array
    last: Scalar
    speed: Scalar
    a: Vector
    b: Vector
    stable: Array  # whether K was positive definite at `last`
    family: Code
    x: Vector
    axial: Scalar  # lowest eigenvalue of the axial block
    status: Code


class _Scan(NamedTuple):
    """The search for a change of sign of the lowest eigenvalue of K, at the steady state of each
    speed up to `top`."""

    model: AbstractModel
    rotor: AnyRotor
    k0: Matrix
    codes: Array
    tears: int  # place of the axial family among `codes`
    top: Scalar
    ratio: Scalar  # of one speed that is looked at to the last

    def start(self, zero: Scalar, bottom: Scalar, axial: Vector) -> _State:
        """Before the first look, at the speed `bottom`; nothing is found yet."""
        one = jnp.ones_like(zero)
        return _State(
            tries=jnp.asarray(0), last=zero, speed=bottom, a=jnp.stack([zero, one]),
            b=jnp.stack([self.top, one]), stable=jnp.asarray(True), family=self.codes[self.tears],
            x=axial, axial=one, status=jnp.asarray(int(Status.OK)),
        )  # fmt: skip

    def step(self, search: _State) -> _State:
        """Steps up while K is positive definite, then the Illinois rule: secants between the ends
        of the bracket, with the value at an end that stays halved each time."""
        one = jnp.ones_like(search.speed)
        system = self.model.matrices(self.rotor, search.speed)
        groups = _groups(self.model, self.rotor).values()
        pairs = [_softest(rows, system.stiffness, self.k0) for rows in groups]
        value, x = zip(*pairs, strict=True)
        least, low = jnp.min(jnp.stack(value)), jnp.argmin(jnp.stack(value))
        here, stable = jnp.stack([search.speed, least]), least > 0
        weight = jnp.stack([one, jnp.where(stable == search.stable, one / 2, one)])
        a = jnp.where(stable, here, search.a * weight)
        b = jnp.where(stable, search.b * weight, here)
        found = b[1] <= 0
        secant = a[0] + (b[0] - a[0]) * a[1] / (a[1] - b[1])
        return _State(
            tries=search.tries + 1,
            last=search.speed,
            speed=jnp.where(found, secant, search.speed * self.ratio),
            # Until a change of sign is found the upper end is none.
            a=a, b=jnp.where(found, b, search.b), stable=stable, family=self.codes[low],
            x=jnp.stack(x)[low], axial=value[self.tears], status=system.status,
        )  # fmt: skip

    def goes_on(self, search: _State) -> Array:
        """Up to the top, or until the bracket is as narrow as rounding lets it be."""
        more = jnp.where(
            search.b[1] <= 0,
            jnp.abs(search.speed - search.last) > 1e-14 * search.speed,
            search.speed <= self.top * (1 + 1e-9),
        )
        return more & (search.status == Status.OK) & (search.tries < _SCANNED + 100)


def _softest(rows: np.ndarray, k: Matrix, k0: Matrix) -> tuple[Scalar, Vector]:
    """The lowest eigenvalue of K x = value K_0 x in some coordinates, and x among all."""
    least, x = lowest_eigenpair(k[np.ix_(rows, rows)], k0[np.ix_(rows, rows)])
    return least, x @ np.eye(len(k))[rows]


def _groups(model: AbstractModel, rotor: AnyRotor) -> dict[Family, np.ndarray]:
    """Coordinates that lose their stability together, under the name of one of their families."""
    groups = {}
    for transverse, axial in planes_of(rotor):
        for families in (transverse, axial):
            rows = np.flatnonzero([family in families for family in model.families])
            if rows.size:
                groups[model.families[rows[0]]] = rows
    return dict(sorted(groups.items()))
