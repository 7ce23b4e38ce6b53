"""Speeds at which a frequency is a multiple of the speed."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._checks import check_all, real_scalar
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case, fastest
from jaxbeam._models.contract.loaded import Conditions, checked_conditions
from jaxbeam._modes.modes import find
from jaxbeam._modes.wanted import Wanted, choose
from jaxbeam._numerics.brackets import change_between, root
from jaxbeam._programs.program import Program
from jaxbeam._results import InHertz, finish, nan_unless, without_derivatives
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping
from jaxbeam._rotor.directions import Label
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Real, Scalar

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

    By the Illinois rule, secants that keep the bracket, to rounding. Differentiable with respect to
    rotor, loads, damping and harmonic by the implicit function theorem, and works under `jit` and
    `vmap`. `throw=False` leaves failures in `Crossing.status`, and gives NaN (derivatives: as in
    `modes`).

    Raises what `modes` does, and `RuntimeError` (`NO_CROSSING`) if frequency - harmonic * speed
    does not change sign over the bracket, or only jumps as the label changes branch in a veering.
    """
    if not isinstance(label, Label):
        raise TypeError(f"label must be a Label, got {label!r}")
    if not isinstance(bracket, tuple | list) or len(bracket) != 2:
        raise ValueError(f"bracket must be two speeds, got {bracket!r}")
    ends = tuple(real_scalar("bracket", end) for end in bracket)
    ratio = real_scalar("harmonic", harmonic)
    check_all("harmonic must be finite and > 0", ratio, lambda x: np.isfinite(x) & (x > 0))
    for end in ends:
        check_all("bracket must be finite", end)
    model, rotor, _ = checked_case(model, rotor, fastest(ends))
    conditions = checked_conditions(loads, damping, (model, rotor), ends, throw)
    speed, status = _crossing(model, rotor, choose(model, (label,)), conditions, ratio, *ends)
    result = Crossing(label, ratio, speed, status)
    return finish(result, throw)


_Given = tuple[Rotor, Wanted, Conditions | None, Scalar]


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

    def gap_and_status(given: _Given, speed: Scalar) -> tuple[Scalar, Code]:
        rotor, wanted, conditions, harmonic = given
        found = find(model, rotor, speed, wanted, conditions=conditions)
        return found.frequency[0] - harmonic * jnp.abs(speed), found.status

    def gap(given: _Given, speed: Scalar, failed: Scalar) -> Scalar:
        """The frequency less the multiple of a speed, or another number where that failed."""
        value, status = gap_and_status(given, speed)
        return jnp.where(status == Status.OK, value, failed)

    given = rotor, wanted, conditions, harmonic
    fixed, ends = without_derivatives(given), without_derivatives((low, high))
    values, statuses = jax.lax.map(functools.partial(gap_and_status, fixed), jnp.stack(ends))
    status = first_failure(*statuses)
    ok = sound & (values[0] * values[1] <= 0)  # False for NaN
    # What cannot be told on the way counts as beyond.
    place = change_between(lambda speed: gap(fixed, speed, values[1]), ends, (values[0], values[1]))
    place = jnp.where(ok, place, sum(ends) / 2)
    # The search also ends at a jump, where a label changes branch: the gap says which it was.
    miss, there = gap_and_status(fixed, place)
    status = first_failure(status, jnp.where(ok, there, Status.OK))
    ok &= jnp.abs(miss) <= _JUMP * jnp.abs(harmonic * place)
    # Where a case failed by another function, which has a slope.
    speed = root(lambda given, speed: gap(given, speed, speed), given, place)
    status = first_failure(status, first_broken((ok, Status.NO_CROSSING)))
    return nan_unless(status == Status.OK, speed), status
