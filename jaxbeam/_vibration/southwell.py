"""Southwell coefficients: how fast modes stiffen with speed.

B: M. Berzeri, A. A. Shabana, A finite element study of the geometric centrifugal stiffening effect,
Technical Report MBS99-5-UIC, 1999.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._models.base import AbstractModel, Label, checked_case
from jaxbeam._numerics.program import Program
from jaxbeam._results import harmless, where_known
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Real, Scalar
from jaxbeam._vibration.modes import Selection, choose, find


class Southwell(eqx.Module):
    """`coefficient`: phi = d(omega^2) / d(Omega^2), shape (k,), without unit; and a `status`."""

    coefficient: Float[Array, " k"]
    status: Code


def southwell(
    model: AbstractModel,
    rotor: AnyRotor,
    angular_speed: Real = 0.0,
    which: int | Sequence[Label] | None = None,
    *,
    throw: bool = True,
) -> Southwell:
    """Southwell coefficients phi = d(omega^2) / d(Omega^2) of the modes `which` (see `modes`).

    At rest this is phi of omega^2 = omega_0^2 + phi Omega^2 (B eq. 67); at speed it is the local
    slope. It includes the Coriolis coupling of bending with stretch when the model has stretch.
    By differentiation, not by differences: omega d(omega)/d(Omega) / Omega at speed, and half the
    second derivative of omega^2 at rest, where the former is 0 / 0. Itself differentiable with
    respect to rotor and speed. For a mode that diverges omega^2 is -growth_rate^2.

    Raises as `modes` does; `throw=False` gives NaN and a status where a case fails (derivatives:
    as in `modes`).
    """
    selection = choose(model, which)
    result = _southwell(model, *checked_case(model, rotor, angular_speed), selection)
    return raise_unless_ok(result, result.status) if throw else result


@Program
def _southwell(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, selection: Selection
) -> Southwell:
    given = rotor.status(speed)
    fine = given == Status.OK
    rotor, speed = harmless(fine, (rotor, speed))

    def square(omega: Scalar) -> tuple[Float[Array, " k"], Code]:
        found = find(model, rotor, omega, selection)
        return -(found.eigenvalue**2).real, found.status

    def rate(omega: Scalar) -> tuple[Float[Array, " k"], Code]:
        _, slope, status = jax.jvp(square, (omega,), (jnp.ones_like(omega),), has_aux=True)
        # NaN would end up in gradients by parameters that cases of a batch share.
        return jnp.where(status == Status.OK, slope, 0.0), status

    def at_rest(_: Scalar) -> tuple[Float[Array, " k"], Code]:
        zero, one = jnp.zeros_like(speed), jnp.ones_like(speed)
        _, curvature, status = jax.jvp(rate, (zero,), (one,), has_aux=True)
        return curvature / 2, status

    def at_speed(omega: Scalar) -> tuple[Float[Array, " k"], Code]:
        slope, status = rate(omega)
        return slope / (2 * omega), status

    # A safe speed, since under vmap both branches run and 0 / 0 would spoil derivatives.
    resting = speed == 0
    safe = jnp.where(resting, rotor.frequency_scale, speed)
    result, status = jax.lax.cond(resting, at_rest, at_speed, safe)
    status = jnp.where(fine, status, given)
    return Southwell(where_known(status == Status.OK, result), status)
