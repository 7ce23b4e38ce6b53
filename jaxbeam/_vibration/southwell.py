"""Southwell coefficients, Campbell diagrams, and speeds at which a frequency is met."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import known_array, real_scalar
from jaxbeam._models.base import AbstractModel, Label, checked_case
from jaxbeam._results import where_known
from jaxbeam._rotor.beam import Rotor
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._sweeps.cases import grid
from jaxbeam._sweeps.sweep import sweep
from jaxbeam._sweeps.table import Table
from jaxbeam._types import Code, Real, Scalar
from jaxbeam._vibration.modes import Choice, choose, find


class Southwell(eqx.Module):
    """`coefficient`: phi = d(omega^2) / d(Omega^2), shape (k,), without unit; and a `status`."""

    coefficient: Float[Array, " k"]
    status: Code


def southwell(
    model: AbstractModel,
    rotor: Any,
    which: int | Sequence[Label],
    angular_speed: Real = 0.0,
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
    choice = choose(model, which)
    result = _southwell(model, *checked_case(model, rotor, angular_speed), choice)
    return raise_unless_ok(result, result.status) if throw else result


@eqx.filter_jit
def _southwell(model: AbstractModel, rotor: Any, speed: Scalar, choice: Choice) -> Southwell:
    given = rotor.status(speed)
    fine = given == Status.OK
    rotor, speed = jax.tree.map(lambda leaf: jnp.where(fine, leaf, 1.0), (rotor, speed))

    def square(omega: Scalar) -> tuple[Float[Array, " k"], Code]:
        found = find(model, rotor, omega, choice)
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


class Crossing(NamedTuple):
    """A speed at which `label` is met by `harmonic` times the speed (rad/s)."""

    label: Label
    harmonic: float
    angular_speed: float


class Campbell(eqx.Module):
    """Frequency over speed for labelled modes of one rotor.

    `table` holds `frequency` and `growth_rate` (rad/s, 1/s; dimensions angular_speed, mode) and
    `status`; `labels` names the modes.
    """

    model: AbstractModel
    rotor: Rotor
    labels: tuple[Label, ...] = eqx.field(static=True)
    table: Table = eqx.field(static=True)

    def crossings(self, harmonics: Sequence[float] = (1, 2, 3, 4, 5, 6)) -> list[Crossing]:
        """All speeds in the range of the diagram where frequency = harmonic * speed.

        Sign changes between neighbouring speeds of the diagram, refined by `crossing`; two
        crossings between two neighbours are not seen. Where a label changes branch in a veering and
        the line passes through the gap, there is no crossing. Ordered by speed.
        """
        factors = known_array("harmonics", harmonics)
        if factors.ndim != 1 or not (np.isfinite(factors) & (factors > 0)).all():
            raise ValueError(f"harmonics must be a list of numbers > 0, got {harmonics!r}")
        speed = self.table.coords["angular_speed"]
        found = []
        for column, label in enumerate(self.labels):
            for harmonic in harmonics:
                gap = self.table["frequency"][:, column] - harmonic * np.abs(speed)
                # A gap that is zero at rest, in divergence, is no resonance.
                gap = np.where(self.table["growth_rate"][:, column] > 0, np.nan, gap)
                # A root on a sample counts once, for the interval that it begins.
                change = (gap[:-1] * gap[1:] < 0) | (gap[:-1] == 0)
                change[-1:] |= gap[-1:] == 0
                for i in np.flatnonzero(change):
                    bracket = (float(speed[i]), float(speed[i + 1]))
                    at = crossing(self.model, self.rotor, label, harmonic, bracket, throw=False)
                    if at.status == Status.OK:
                        found.append(Crossing(label, harmonic, float(at.angular_speed)))
        return sorted(found, key=lambda c: c.angular_speed)


def campbell(
    model: AbstractModel,
    rotor: Rotor,
    angular_speeds: Float[np.ndarray, " s"],
    which: Sequence[Label],
) -> Campbell:
    """Campbell diagram: frequencies of the labelled modes at each of the speeds (rad/s)."""
    which = (which,) if isinstance(which, Label) else which
    if not isinstance(which, Sequence):
        raise TypeError(f"which must be labels, got {which!r}")
    which = tuple(which)
    rotor, _ = checked_case(model, rotor)
    table = sweep(
        # the rotor as an argument: diagrams of other rotors reuse the compiled code
        jax.tree_util.Partial(_campbell_case, model, rotor, choose(model, which)),
        grid(angular_speed=angular_speeds),
        dims={
            name: {"mode": [str(label) for label in which]} for name in ("frequency", "growth_rate")
        },
    )
    return Campbell(model, rotor, which, table)


def _campbell_case(
    model: AbstractModel, rotor: Rotor, choice: Choice, *, angular_speed: Scalar
) -> dict[str, Array]:
    found = find(model, rotor, angular_speed, choice)
    return {
        "frequency": found.frequency,
        "growth_rate": found.growth_rate,
        "status": found.status,
    }


class Resonance(eqx.Module):
    """`angular_speed` (rad/s) at which a frequency is a multiple of it, and a `status`."""

    angular_speed: Scalar
    status: Code


def crossing(
    model: AbstractModel,
    rotor: Rotor,
    label: Label,
    harmonic: Real,
    bracket: tuple[Real, Real],
    *,
    throw: bool = True,
) -> Resonance:
    """Speed in `bracket` (rad/s) at which the frequency of `label` is `harmonic` times the speed.

    Newton's method with exact derivatives, kept inside the bracket by bisection, to rounding.
    Differentiable with respect to rotor and harmonic by the implicit function theorem, and works
    under `jit` and `vmap`. If frequency - harmonic * speed does not change sign over the bracket,
    or only jumps because the label changes branch in a veering, that is an error, or `NO_CROSSING`
    and NaN with `throw=False` (derivatives: as in `modes`).
    """
    if not isinstance(label, Label):
        raise TypeError(f"label must be a Label, got {label!r}")
    if not isinstance(bracket, tuple | list) or len(bracket) != 2:
        raise ValueError(f"bracket must be two speeds, got {bracket!r}")
    ends = tuple(real_scalar("bracket", end) for end in bracket)
    ratio = real_scalar("harmonic", harmonic)
    for name, value, least in (("harmonic", ratio, 0), *(("bracket", e, -np.inf) for e in ends)):
        known = not isinstance(value, jax.core.Tracer)
        if known and not (np.isfinite(number := float(np.asarray(value))) and number > least):
            raise ValueError(
                f"{name} must be finite{' and > 0' if least == 0 else ''}, got {value}"
            )
    rotor, _ = checked_case(model, rotor)
    result = _crossing(model, rotor, choose(model, (label,)), ratio, *ends)
    return raise_unless_ok(result, result.status) if throw else result


@eqx.filter_jit
def _crossing(
    model: AbstractModel, rotor: Rotor, choice: Choice, harmonic: Scalar, low: Scalar, high: Scalar
) -> Resonance:
    sound = jnp.isfinite(harmonic)
    harmonic = jnp.where(sound, harmonic, 1.0)

    def gap_and_status(speed: Scalar) -> tuple[Scalar, Code]:
        found = find(model, rotor, speed, choice)
        return found.frequency[0] - harmonic * jnp.abs(speed), found.status

    def gap(speed: Scalar) -> Scalar:
        return gap_and_status(speed)[0]

    def regular(speed: Scalar) -> Scalar:
        """`gap`; in a case that failed, a function that has a slope."""
        value, status = gap_and_status(speed)
        return jnp.where(status == Status.OK, value, speed)

    low, high = jax.lax.stop_gradient((low, high))
    (at_low, at_high), (status, at_high_status) = jax.lax.map(
        gap_and_status, jnp.stack([low, high])
    )
    status = jnp.where(status == Status.OK, at_high_status, status)
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
    # Bisection also ends at a jump, where a label changes branch: the gap says which it was.
    miss = jnp.abs(gap(jax.lax.stop_gradient(speed)))
    ok &= miss <= 1e-9 * jnp.abs(harmonic * speed)
    status = jnp.where((status == Status.OK) & ~ok, Status.NO_CROSSING, status)
    return Resonance(where_known(status == Status.OK, speed), status)
