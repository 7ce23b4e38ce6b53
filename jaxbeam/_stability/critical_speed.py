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
transverse block, divergence, which in a beam that points inward is buckling; the axial one, where
the centrifugal load grows as fast with stretch as the rod can carry: it tears.

B is the paper of `_models/contract/__init__.py`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.left_out import status_of_shape
from jaxbeam._models.contract.loaded import Conditions, checked_potential, guarded_conditions
from jaxbeam._numerics.brackets import Looks
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, replaced, without_derivatives
from jaxbeam._rotor.beam import AnyRotor, Rotor
from jaxbeam._rotor.damping import NO_DAMPING
from jaxbeam._rotor.directions import Direction, naming
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._rotor.motion import spinning
from jaxbeam._stability.singular import (
    AbstractPlace,
    Groups,
    Scan,
    answer,
    direction_of_energy,
    gives_way,
    groups_of,
    is_affine,
    softest,
)
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Matrix, Number, Scalar, Vector

_WEAK_SPRING = 1e-10  # stiffness, over EI / L, of springs that stand for free hinges
_ROUGH = 1e-11  # stiffness, over EA L, above rounding of the stiffness of a hinge near tearing
_HARD = 0.1  # share of its axial stiffness at rest that a rod which does not tear keeps
_FINER = 4.0  # factor of the speed for which functions have to be enough where bending gives way
# Number of speeds searched for models whose stiffness is not affine in the square of the speed.
_SCANNED = 64


class CriticalSpeed(eqx.Module):
    """The speed at which steady rotation loses its stability.

    | field         | shape | unit  |                                                              |
    |---------------|-------|-------|--------------------------------------------------------------|
    | angular_speed | ()    | rad/s | smallest speed at which the stiffness is singular; infinite  |
    |               |       |       | where there is none                                          |
    | direction     | ()    |       | `Direction` of the coordinates that give way: `IN_PLANE` and |
    |               |       |       | `FLAP` diverge, `AXIAL` means that the rod tears: beyond, it |
    |               |       |       | has no equilibrium; without meaning where there is no speed  |
    | shape         | (n,)  |       | the shape that gives way, largest entry 1                    |
    | status        | ()    |       | `Status`                                                     |
    """

    angular_speed: Scalar
    direction: Code
    shape: Vector
    status: Code


def critical_speed(
    model: AbstractModel, rotor: AnyRotor, *, loads: Loads = NO_LOADS, throw: bool = True
) -> CriticalSpeed:
    """Smallest speed at which steady rotation loses its stability (rad/s): K(Omega) is singular.

    `model`, `rotor` and `loads` are those of `modes`. Where K is affine in Omega^2 (`Hybrid`,
    `Classical`, `SmallStrainANCF`, `DiscreteLC`, `LP`) this is one eigenproblem, K_0 x = -Omega^2
    K_1 x. Else K, at the steady state of each speed, is looked at from half the first rest
    frequency (of a beam that points inward from where it might buckle, if that is sooner) up to the
    speed at which a rod of constant axial stiffness tears, and the speed at which its lowest
    eigenvalue changes sign is found to rounding. It is also the root of the scalar
    f of the bordered system

        [[K, b], [b^T, 0]] (x, f) = (0, 1),

    through which it is differentiable by every parameter, in both modes and to any order.

    That of `PlanarRod` tears there. Materials that harden (`ANCF`, `GreenANCF`) have a steady
    state at any speed; infinity then means: none up to there, where their strains are of order one.
    An interval of instability narrower than a step of the scan (64 up to there, in ratio) that ends
    again would be missed. Beyond divergence `modes` says how fast what grows (`growth_rate`).

    What nothing holds at rest, a blade on a free hinge, is stable if it stiffens as it turns; else
    the speed is zero, and has no derivatives. A hinge for lag in the axis of rotation, which no
    speed holds nor drives out, does not count.

    Under `loads` (see `modes`), which must have a potential and are differentiated by as well, K is
    that about the state that they deform, and all is coupled with all; `direction` is that of the
    coordinates that take most of the elastic energy. Where they buckle the beam at rest the status
    is `BUCKLED`.

    `throw=False` returns failures in `CriticalSpeed.status`, and NaN (derivatives: as in `modes`;
    those of an infinite speed are zero).

    Raises as `modes` does, and `ValueError` for loads without a potential.
    """
    model, rotor, zero = checked_case(model, rotor)
    conditions = checked_potential(loads, (model, rotor), throw)
    result = _critical(model, rotor, zero, conditions)
    return finish(result, throw)


_Given = tuple[AnyRotor, Conditions | None]


@Program
def _critical(
    model: AbstractModel, rotor: AnyRotor, zero: Scalar, conditions: Conditions | None
) -> CriticalSpeed:
    one = jnp.ones_like(zero)  # a load that turns in the hub does so at any speed but zero
    at_speed = jnp.asarray(0) if conditions is None else conditions.status(model, rotor, one)
    given, rotor, _, conditions = guarded_conditions(model, rotor, zero, conditions)
    fixed = without_derivatives((rotor, zero))
    if conditions is None and model.couples_all:
        conditions = Conditions(NO_LOADS, NO_DAMPING)
    if conditions is None:
        searched = _search(model, *fixed)
    else:
        searched = _search_under(model, *fixed, without_derivatives(conditions))
    found, direction, x, status = searched
    resolved = _resolved(model, fixed[0], found)
    few = first_broken((resolved, Status.TOO_FEW_FUNCTIONS))
    there = jnp.isfinite(found)
    lacks = jnp.where(there, status_of_shape(model, rotor, x), Status.OK)
    status = first_failure(given, at_speed, status, few, lacks)
    exists = there & (status == Status.OK)
    place = _CriticalSpeedPlace(x=x, exists=exists, model=model, direction=direction)
    speed, shape = answer(place, (rotor, conditions), found, status)
    return CriticalSpeed(angular_speed=speed, direction=direction, shape=shape, status=status)


def _resolved(model: AbstractModel, rotor: AnyRotor, speed: Scalar) -> Bool[Array, ""]:
    """Whether a model's own number of functions is enough to say that bending gives way at this
    speed, or not below it.

    A beam that points outwards never gives way by bending. One inside the axis (a negative hub
    radius) or in a cone may, where tension nearly cancels its stiffness: the remainder has a
    relative error a hundred times that of a frequency, so that functions have to be enough for
    boundary layers four times as thin.
    """
    if not isinstance(rotor, Rotor) or Direction.IN_PLANE not in model.directions:
        return jnp.ones((), bool)
    leans = (rotor.hub_radius < 0) | (rotor.precone is not None)
    return ~leans | model.resolves(rotor, _FINER * jnp.where(leans, speed, 0.0))


class _CriticalSpeedPlace(AbstractPlace):
    """The singular stiffness at a critical speed."""

    x: Vector
    exists: Array
    model: AbstractModel
    direction: Code

    def rest(self, given: _Given) -> Matrix:
        return _undeformed(self.model, given[0], jnp.zeros_like(self.x[0]))

    def stiffness(self, given: _Given, value: Scalar) -> Matrix:
        model, (rotor, conditions) = self.model, given
        if conditions is not None:
            here = jnp.where(self.exists, value, 0.0)
            return symmetric_part(conditions.system(model, rotor, here).stiffness)
        k = _undeformed(self.model, rotor, value)
        if is_affine(model, rotor):
            return k
        tears = self.direction == Direction.AXIAL  # where a rod tears there is no state to be at
        moved = model.matrices(rotor, jnp.where(tears | ~self.exists, 0.0, value)).stiffness
        return jnp.where(tears, k, moved)


def _undeformed(model: AbstractModel, rotor: AnyRotor, speed: Scalar) -> Matrix:
    """The stiffness K of the beam in its shape at rest; its axial block is that of a rod of
    constant axial stiffness."""
    equations = model.equations(rotor)
    return symmetric_part(equations.matrices_about(spinning(speed), equations.rest)[2])


def _search(
    model: AbstractModel, rotor: AnyRotor, zero: Scalar
) -> tuple[Scalar, Code, Vector, Code]:
    """The critical speed, the direction and the shape that give way, and a status."""
    groups, free = groups_of(model, rotor), rotor
    weak = _weak_spring(rotor, is_affine(model, rotor))
    rotor = _with_weak_springs(rotor, weak)
    k0, speed, shape = _alone(model, rotor, zero, groups)
    sound = _sound(speed)
    if is_affine(model, rotor):
        if rotor is not free:
            speed = _without_weak_springs(
                speed, shape, k0, _undeformed(model, free, zero), rotor, weak
            )
        first = jnp.argmin(speed)
        return speed[first], groups.codes[first], shape[first], sound

    tears = groups.directions.index(Direction.AXIAL)
    bottom, top = _bottom(rotor, speed), 0.999 * speed[tears]
    ratio = (top / bottom) ** (1 / (_SCANNED - 1))

    def at(speed: Scalar) -> tuple[Matrix, Code]:
        system = model.matrices(rotor, speed)
        return system.stiffness, system.status

    looks = Looks(bottom, ratio, top, _SCANNED)
    scan = Scan(at, groups, lambda _: k0, looks, rotor is not free)
    end = scan.run(tears, shape[tears])
    # At 0.999 of the speed of tearing a constant axial stiffness has 0.002 of its value at rest;
    # one that hardens has more than at rest.
    hardens = end.kept.values[tears] > _HARD
    torn = jnp.where(hardens, jnp.inf, speed[tears])
    speed = jnp.where(end.found, end.value, torn)
    if rotor is not free:
        rest = _undeformed(model, free, zero)
        speed = _without_weak_springs(speed[None], end.kept.x[None], k0, rest, rotor, weak)[0]
    return (
        speed,
        jnp.where(end.found, end.kept.direction, groups.codes[tears]),
        jnp.where(end.found, end.kept.x, shape[tears]),
        first_failure(sound, scan.status(end)),
    )


def _search_under(
    model: AbstractModel, rotor: AnyRotor, zero: Scalar, conditions: Conditions
) -> tuple[Scalar, Code, Vector, Code]:
    """The critical speed under loads, the direction and the shape that give way, and a status."""
    groups = groups_of(model, rotor)
    rest, speed, _ = _alone(
        model, _with_weak_springs(rotor, _weak_spring(rotor, True)), zero, groups
    )
    every = Groups((naming(model.directions),), (np.arange(len(rest)),))

    def at(speed: Scalar) -> tuple[Matrix, Code]:
        system = conditions.system(model, rotor, speed)
        k = symmetric_part(system.stiffness)
        # A tension stretches a rod that is about to tear by any number of lengths, but not at rest.
        far = (system.status == Status.DIVERGED) & (speed > 0) & jnp.all(jnp.isfinite(k))
        return k, jnp.where(far, Status.OK, system.status)

    k0, status = at(zero)
    least, x = softest(every.rows[0], k0, rest)
    held = first_broken((jnp.isfinite(least), Status.NOT_FINITE), (least > 0, Status.BUCKLED))
    at_rest = first_failure(status, held)
    if is_affine(model, rotor):
        _, k1 = _with_speed(model, rotor, zero)
        fine = jnp.where(at_rest == Status.OK, k0, rest)
        square, x = gives_way(every.rows[0], k1, fine)
        found, status = jnp.sqrt(square), _sound(square)
    else:
        tears = groups.directions.index(Direction.AXIAL)
        bottom, top = _bottom(rotor, speed), 0.999 * speed[tears]
        ratio = (top / bottom) ** (1 / (_SCANNED - 1))
        scan = Scan(at, every, lambda _: rest, Looks(bottom, ratio, top, _SCANNED))
        end = scan.run(0, x)
        torn = jnp.where(end.kept.values[0] > _HARD, jnp.inf, speed[tears])
        found, x = jnp.where(end.found, end.value, torn), end.kept.x
        status = first_failure(_sound(speed), scan.status(end))
    status = first_failure(at_rest, status)
    return found, direction_of_energy(model.directions, rest, x), x, status


def _bottom(rotor: AnyRotor, speed: Float[Array, " f"]) -> Scalar:
    """The first speed of the search: half the first frequency at rest; for a beam in compression
    less, so that the same compression at the tip would not buckle it (Euler)."""
    bottom = jnp.min(speed) / 2
    if not isinstance(rotor, Rotor):
        return bottom
    outside = rotor.tension(jnp.ones_like(bottom))[0]
    push = -jnp.minimum(jnp.minimum(outside, rotor.rigid_moments[1]), 0.0)
    beam = rotor.beam.mean
    softer = jnp.minimum(beam.in_plane_bending_stiffness, beam.flap_bending_stiffness)
    euler = np.pi**2 / 4 * softer / beam.length**2
    buckles = jnp.sqrt(euler / jnp.where(push > 0, push, 1.0))
    return jnp.where(push > 0, jnp.minimum(bottom, buckles), bottom)


def _sound(speed: Float[Array, "*f"]) -> Code:
    """The status of a critical speed: OK for numbers and for infinity, which means that there is
    none, but not for NaN, from overflow."""
    return first_broken((jnp.all(~jnp.isnan(speed)), Status.NOT_FINITE))


def _weak_spring(rotor: AnyRotor, is_affine: bool) -> Number | float:
    """The stiffness, over EI / L, of springs that stand for free hinges. It is above rounding: with
    tension the stiffness of elements is a difference of larger numbers."""
    if is_affine or not isinstance(rotor, Rotor):
        return _WEAK_SPRING
    beam = rotor.beam.mean
    ratio = beam.axial_stiffness / beam.in_plane_bending_stiffness
    return jnp.maximum(_ROUGH * ratio * beam.length**2, _WEAK_SPRING)


def _with_weak_springs(rotor: AnyRotor, weak: Number | float) -> AnyRotor:
    """The rotor with weak springs where hinges are free, so that K at rest is definite."""
    if not isinstance(rotor, Rotor) or rotor.root_springs is None:
        return rotor
    beam = rotor.beam.mean
    weak = weak * beam.in_plane_bending_stiffness / beam.length
    held = jax.tree.map(lambda k: jnp.where(k < weak / 10, weak, k), rotor.root_springs)
    return replaced(rotor, root_springs=held)


def _without_weak_springs(
    speed: Float[Array, " f"], shape: Float[Array, "f n"], k0: Matrix, free: Matrix,
    rotor: AnyRotor, weak: Number | float,
) -> Float[Array, " f"]:  # fmt: skip
    """The critical speeds without the weak springs. Motion held by these alone gives way at once,
    or, if it takes a much higher speed than such a spring would, at none."""

    def energy(k: Matrix) -> Float[Array, " f"]:
        return jnp.sum(shape * (shape @ k), 1)

    swings = energy(free) < energy(k0) / 2
    at_once = speed**2 < 1e4 * weak * rotor.frequency_scale**2
    return jnp.where(swings, jnp.where(at_once, 0.0, jnp.inf), speed)


def _alone(
    model: AbstractModel, rotor: AnyRotor, zero: Scalar, groups: Groups
) -> tuple[Matrix, Float[Array, " f"], Float[Array, "f n"]]:
    """The stiffness K at rest, and for each group the speed and the shape with which it would give
    way if the beam kept its shape at rest."""
    k0, k1 = _with_speed(model, rotor, zero)
    squares, shapes = zip(*(gives_way(rows, k1, k0) for rows in groups.rows), strict=True)
    return k0, jnp.sqrt(jnp.stack(squares)), jnp.stack(shapes)


def _with_speed(model: AbstractModel, rotor: AnyRotor, zero: Scalar) -> tuple[Matrix, Matrix]:
    """The matrices K_0 and K_1 of K = K_0 + Omega^2 K_1, for the beam in its shape at rest."""
    one = jnp.ones_like(zero)

    def with_rate(speed: Scalar) -> tuple[Matrix, Matrix]:
        return jax.jvp(lambda speed: _undeformed(model, rotor, speed), (speed,), (one,))

    (k0, _), (_, curvature) = jax.jvp(with_rate, (zero,), (one,))
    return k0, curvature / 2  # exactly, without the cancellation of differences
