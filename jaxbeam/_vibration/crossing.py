"""Speeds at which a frequency is a multiple of the speed."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._checks import real_scalar
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case, fastest
from jaxbeam._models.contract.loaded import Conditions, checked_conditions
from jaxbeam._modes.modes import find
from jaxbeam._modes.wanted import Wanted, choose
from jaxbeam._programs.program import Program
from jaxbeam._results import InHertz, finish, nan_unless
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping
from jaxbeam._rotor.directions import Label
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Real, Scalar, is_concrete

# Share of the frequency below which a gap of a veering counts as rounding, as of rods whose axial
# is much larger than their bending stiffness.
_JUMP = 1e-6


class Crossing(InHertz, eqx.Module):
    """The `angular_speed` (rad/s) at which the frequency of the mode `label` is `harmonic` times
    it, and a `status`."""

    label: Label = eqx.field(static=True)
    harmonic: Scalar
    angular_speed: Scalar
    status: Code

    @property
    def frequency(self) -> Any:
        """The frequency, `harmonic` times the speed, whose sign does not count, in rad/s; of a
        batch with its axes."""
        return self.harmonic * abs(self.angular_speed)


def crossing(
    model: AbstractModel,
    rotor: Rotor,
    bracket: tuple[Real, Real],
    label: Label,
    harmonic: Real,
    *,
    loads: Loads = NO_LOADS,
    damping: Damping = NO_DAMPING,
    throw: bool = True,
) -> Crossing:
    """The speed at which the frequency of a mode is a multiple of the speed: a resonance.

    `bracket` are two speeds (rad/s) between which it is, `label` names the mode (`labels`), and
    `harmonic` > 0 is the multiple. `model`, `rotor`, `loads` and `damping` are those of `modes`.

    Newton's method with exact derivatives, kept inside the bracket by bisection, to rounding.
    Differentiable with respect to rotor and harmonic by the implicit function theorem, and works
    under `jit` and `vmap`. `throw=False` leaves failures in `Crossing.status`, and gives NaN
    (derivatives: as in `modes`).

    Raises what `modes` does, and `RuntimeError` (`NO_CROSSING`) if frequency - harmonic * speed
    does not change sign over the bracket, or only jumps as the label changes branch in a veering.
    """
    if not isinstance(label, Label):
        raise TypeError(f"label must be a Label, got {label!r}")
    if not isinstance(bracket, tuple | list) or len(bracket) != 2:
        raise ValueError(f"bracket must be two speeds, got {bracket!r}")
    ends = tuple(real_scalar("bracket", end) for end in bracket)
    ratio = real_scalar("harmonic", harmonic)
    for name, value, least in (("harmonic", ratio, 0), *(("bracket", e, -np.inf) for e in ends)):
        if is_concrete(value) and not (
            np.isfinite(number := float(np.asarray(value))) and number > least
        ):
            raise ValueError(
                f"{name} must be finite{' and > 0' if least == 0 else ''}, got {value}"
            )
    model, rotor, _ = checked_case(model, rotor, fastest(ends))
    conditions = checked_conditions(loads, damping, (model, rotor), ends, throw)
    speed, status = _crossing(model, rotor, choose(model, (label,)), conditions, ratio, *ends)
    result = Crossing(label, ratio, speed, status)
    return finish(result, throw)


@Program
def _crossing(
    model: AbstractModel,
    rotor: Rotor,
    wanted: Wanted,
    conditions: Conditions | None,
    harmonic: Scalar,
    low: Scalar,
    high: Scalar,
) -> tuple[Scalar, Code]:
    sound = jnp.isfinite(harmonic)
    harmonic = jnp.where(sound, harmonic, 1.0)

    def gap_and_status(speed: Scalar) -> tuple[Scalar, Code]:
        found = find(model, rotor, speed, wanted, conditions=conditions)
        return found.frequency[0] - harmonic * jnp.abs(speed), found.status

    def gap(speed: Scalar) -> Scalar:
        return gap_and_status(speed)[0]

    def regular(speed: Scalar) -> Scalar:
        """The function `gap`, or in a case that failed any function with a slope."""
        value, status = gap_and_status(speed)
        return jnp.where(status == Status.OK, value, speed)

    low, high = jax.lax.stop_gradient((low, high))
    (at_low, at_high), (status, at_high_status) = jax.lax.map(
        gap_and_status, jnp.stack([low, high])
    )
    status = first_failure(status, at_high_status)
    ok = sound & (at_low * at_high <= 0)  # False for NaN

    State = tuple[Array, Array, Array, Array, Array]  # speed, bracket, last change, count

    def search(_: object, start: Scalar) -> Scalar:
        def body(state: State) -> State:
            speed, a, b, _, k = state
            value, slope = jax.jvp(gap, (speed,), (jnp.ones_like(speed),))
            left = jnp.sign(value) == jnp.sign(at_low)
            a, b = jnp.where(left, speed, a), jnp.where(left, b, speed)
            trial = speed - value / slope
            inside = (trial >= jnp.minimum(a, b)) & (trial <= jnp.maximum(a, b))
            new = jnp.where(value == 0, speed, jnp.where(inside, trial, (a + b) / 2))
            return new, a, b, jnp.abs(new - speed), k + 1

        def go_on(state: State) -> Array:
            speed, _, _, change, k = state
            return ok & (change > 4 * jnp.finfo(speed.dtype).eps * jnp.abs(speed)) & (k < 100)

        infinite = jnp.full_like(start, jnp.inf)
        return jax.lax.while_loop(go_on, body, (start, low, high, infinite, jnp.asarray(0)))[0]

    middle = (low + high) / 2
    speed = jax.lax.custom_root(regular, middle, search, lambda g, y: y / g(jnp.ones_like(y)))
    # Bisection also ends at a jump, where a label changes branch: the gap there tells.
    miss = jnp.abs(gap(jax.lax.stop_gradient(speed)))
    ok &= miss <= _JUMP * jnp.abs(harmonic * speed)
    status = first_failure(status, first_broken((ok, Status.NO_CROSSING)))
    return nan_unless(status == Status.OK, speed), status
