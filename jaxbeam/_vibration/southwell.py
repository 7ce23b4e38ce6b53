"""Southwell coefficients: how fast modes stiffen with speed.

B is the paper of `_models/contract/__init__.py`.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.loaded import Conditions, checked_potential, system_of
from jaxbeam._models.contract.small_motion import guarded
from jaxbeam._modes.modes import find
from jaxbeam._modes.result import Modes
from jaxbeam._modes.wanted import Wanted, choose
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, nan_unless, without_derivatives
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.directions import Label, is_hinged
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Matrix, Real, Scalar

# Speed, over the frequency scale, that stands for rest: rounding of axial motion grows towards
# zero.
_CLOSE = 3e-6


class Southwell(eqx.Module):
    """The `coefficient` phi = d(omega^2) / d(Omega^2), shape (k,), without unit; and a `status`."""

    coefficient: Float[Array, " k"]
    status: Code


def southwell(
    model: AbstractModel,
    rotor: AnyRotor,
    angular_speed: Real = 0.0,
    which: int | Sequence[Label] | None = None,
    *,
    loads: Loads = NO_LOADS,
    throw: bool = True,
) -> Southwell:
    """Southwell coefficients phi = d(omega^2) / d(Omega^2) of modes.

    `model`, `rotor`, `angular_speed` (rad/s, either sign) and `which` are those of `modes`.

    At rest this is phi of omega^2 = omega_0^2 + phi Omega^2 (B eq. 67); at speed it is the local
    slope. It includes the Coriolis coupling of bending with stretch when the model has stretch.
    By differentiation, not by differences: omega d(omega)/d(Omega) / Omega at speed, and half the
    second derivative of omega^2 at rest, where the former is 0 / 0. Itself differentiable with
    respect to rotor and speed. For a mode that diverges omega^2 is -growth_rate^2.

    Under `loads` (see `modes`) it includes what the speed does to the state that they deform. They
    must have a potential: with a force that follows the tip, or a moment, omega^2 need not be even
    in the speed. `throw=False` gives NaN and a status where a case fails (derivatives: as in
    `modes`).

    Raises as `modes` does, and `ValueError` for loads without a potential.
    """
    model, rotor, speed = checked_case(model, rotor, angular_speed)
    conditions = checked_potential(loads, (model, rotor), throw)
    result = _southwell(model, rotor, speed, choose(model, which), conditions)
    return finish(result, throw)


@Program
def _southwell(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, wanted: Wanted,
    conditions: Conditions | None,
) -> Southwell:  # fmt: skip
    given, rotor, speed = guarded(rotor, speed)

    def square(omega: Scalar) -> tuple[Float[Array, " k"], Modes]:
        found = find(model, rotor, omega, wanted, conditions=conditions)
        return -(found.eigenvalue**2).real, found

    # At rest the quotient is 0 / 0. It is even in speed, so that at a speed near zero it and its
    # derivatives are right to 1e-11 of their change with speed.
    moving, moves = _near(speed, _CLOSE * without_derivatives(rotor).frequency_scale)
    _, slope, found = jax.jvp(square, (moving,), (jnp.ones_like(speed),), has_aux=True)
    status = found.status
    if is_hinged(rotor):
        slope = jnp.where(
            found.eigenvalue == 0, _swinging(model, rotor, moving, found, conditions), slope
        )
    # NaN would come into gradients by parameters that cases of a batch share.
    result = jnp.where(status == Status.OK, slope, 0.0) / (2 * jnp.where(moves, moving, 1.0))
    finite = moves & jnp.all(jnp.isfinite(result))
    status = first_failure(given, status, first_broken((finite, Status.NOT_FINITE)))
    return Southwell(nan_unless(status == Status.OK, result), status)


def _swinging(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, found: Modes,
    conditions: Conditions | None,
) -> Float[Array, " k"]:  # fmt: skip
    """The derivative d(omega^2) / d Omega of modes whose frequency is zero to rounding: those of
    free hinges at rest, and of lag on a hinge in the axis of rotation, which does not stiffen."""

    def stiffness(omega: Scalar) -> Matrix:
        return system_of(model, rotor, omega, conditions).stiffness

    _, rate = jax.jvp(stiffness, (speed,), (jnp.ones_like(speed),))
    # Shapes are of unit modal mass.
    return jnp.sum(found.shape.conj() * (found.shape @ rate.T), 1).real


def _near(speed: Scalar, close: Scalar) -> tuple[Scalar, Bool[Array, ""]]:
    """The speed (speed^2 + close^2)^1/2, and true; or the speed itself and false where `close`
    overflows."""
    # Scaled, since the square may overflow.
    larger = without_derivatives(jnp.maximum(jnp.abs(speed), close))
    exists = jnp.isfinite(larger) & (larger > 0)
    unit, x, y = (jnp.where(exists, a, 1.0) for a in (larger, speed, close))
    return jnp.where(exists, unit * jnp.sqrt((x / unit) ** 2 + (y / unit) ** 2), speed), exists
