"""How long a fixed step may be: growth of one step, and the largest step of a model."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from jaxbeam._checks import check_all, count_functions, kind_of, positive, real_scalar
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._modes.modes import find
from jaxbeam._modes.wanted import lowest
from jaxbeam._numerics.brackets import halved
from jaxbeam._programs.program import Program
from jaxbeam._results import InHertz, finish, harmless, nan_unless, replaced
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._solvers.system import SecondOrderSystem, State
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Matrix, Real, Scalar

# Angles per step, in rad, that are searched. Explicit methods of s stages become unstable before s
# - 1; methods that are stable up to 1e3 count as always stable.
_ANGLES = np.geomspace(1e-3, 1e3, 2000)
# Solvers that keep more than the state from step to step, or need it in two parts.
_OTHERS = diffrax.LeapfrogMidpoint, diffrax.ReversibleHeun, diffrax.SemiImplicitEuler


class _Oscillator(SecondOrderSystem):
    """The test equation q'' + 2 zeta q' + q = 0."""

    mass: Matrix
    ratio: Scalar

    @property
    def is_linear(self) -> bool:
        return True

    def force(self, x: Any, q: Array, v: Array) -> Array:
        return -q - 2 * self.ratio * v


class Amplification(eqx.Module):
    """The `factor` by which one step multiplies the amplitude of a vibration, and a `status`,
    unless which is OK it is NaN (derivatives: as in `modes`)."""

    factor: Scalar
    status: Code


def amplification(
    solver: diffrax.AbstractSolver, angle: Real, damping_ratio: Real = 0.0, *, throw: bool = True
) -> Amplification:
    """Factor by which one step multiplies the amplitude of a vibration: above 1 it grows.

    The spectral radius of one step of length h on q'' + 2 zeta omega q' + omega^2 q = 0, with
    `angle` = h omega (rad, > 0) and `damping_ratio` = zeta. For a Runge-Kutta method and zeta = 0
    it is abs(R(i angle)), R the stability function. `solver` is any one-step solver that `simulate`
    takes; stages of stock implicit ones are solved to rounding, whatever their root finder.

    `angle` is () in rad, `damping_ratio` () without unit and of any sign. Returns an
    `Amplification`. `throw=False` returns failures in its status, and NaN: `STEP_FAILED` where a
    stage is not solved, `INVALID_STEP` for traced numbers out of range, `NOT_FINITE`.

    Raises `TypeError` or `ValueError` for a malformed argument, and, with `throw`, `ValueError` for
    a number out of range (under `jit` `RuntimeError`) and `RuntimeError` where the step fails.

    E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), sections IV.2, IV.3.
    """
    solver, angle = _checked(solver), positive("angle", angle)
    result = _amplified(solver, angle, real_scalar("damping_ratio", damping_ratio))
    return finish(result, throw)


def _checked(solver: Any) -> diffrax.AbstractSolver:
    if not isinstance(solver, diffrax.AbstractSolver):
        raise TypeError(f"solver must be a diffrax solver, got {kind_of(solver)}")
    if isinstance(solver, _OTHERS):
        raise TypeError(f"solver must be a one-step method, got {type(solver).__name__}")
    if isinstance(solver, diffrax.AbstractImplicitSolver):
        # The root finder of a solver may take its tolerances from a step-size controller; here is
        # none.
        tight = diffrax.VeryChord(rtol=1e-12, atol=1e-12)
        solver = replaced(solver, root_finder=tight)
    return solver


@Program
def _amplified(solver: diffrax.AbstractSolver, angle: Scalar, ratio: Scalar) -> Amplification:
    # `positive` returns NaN for numbers that are not.
    fine = jnp.isfinite(angle) & jnp.isfinite(ratio)
    angle, ratio = harmless(fine, (angle, ratio))
    factor, done = _factor(solver, angle, ratio)
    status = first_broken(
        (fine, Status.INVALID_STEP),
        (done, Status.STEP_FAILED),
        (jnp.isfinite(factor), Status.NOT_FINITE),
    )
    return Amplification(nan_unless(status == Status.OK, factor), status)


def _factor(
    solver: diffrax.AbstractSolver, angle: Scalar, ratio: Scalar
) -> tuple[Scalar, Bool[Array, ""]]:
    """The spectral radius of one step, and whether its stages were solved."""
    system = _Oscillator(jnp.eye(1, dtype=angle.dtype), ratio)
    case = SecondOrderSystem.term(solver), jnp.zeros_like(angle), angle

    def step(start: Array) -> tuple[Array, Any]:
        y0 = State(start[:1], start[1:])
        kept = solver.init(*case, y0, system)
        y1, *_, result = solver.step(*case, y0, system, kept, False)
        return jnp.concatenate([y1.q, y1.v]), result == diffrax.RESULTS.successful

    ((a, b), (c, d)), done = jax.vmap(step)(jnp.eye(2, dtype=angle.dtype))
    # Eigenvalues half +- sqrt(square), in a form without cancellation.
    half, square = (a + d) / 2, ((a - d) / 2) ** 2 + b * c
    root = jnp.sqrt(jnp.abs(square))
    radius = jnp.where(square < 0, jnp.hypot(half, root), jnp.abs(half) + root)
    return radius, jnp.all(done)


class StableStep(InHertz, eqx.Module):
    """The largest stable `step`, in s; infinite where any step is stable.

    `frequency` is the highest of the model, in rad/s, the one that limits. Unless `status` is OK
    both are NaN (derivatives: as in `modes`).
    """

    step: Scalar
    frequency: Scalar
    status: Code


def stable_step(
    model: AbstractModel,
    rotor: AnyRotor,
    angular_speed: Real,
    solver: diffrax.AbstractSolver,
    *,
    steps: int = 1000,
    growth: Real = 100.0,
    throw: bool = True,
) -> StableStep:
    """Largest fixed step of a solver with which small motion about steady rotation does not grow.

    That is, at `angular_speed` (rad/s), by more than the factor `growth` (> 1) in `steps` (an int
    >= 1) steps. `model` and `rotor` are those of `modes`, `solver` is any one-step one of diffrax.

    It is the smallest z with amplification(solver, z)^steps > growth, over the highest frequency of
    the model: of all modes that one is the first to grow. An allowance for growth is needed because
    many methods (Euler, Heun, and some of high order) grow at any step, those of low order too fast
    to be of use, others so slowly that nobody sees it; where a method is truly stable up to some
    step, the allowance changes little. A longer run wants more `steps`. Without damping; adaptive
    explicit methods end up near this step however slow the motion. z is a number of the method:
    derivatives are those of the frequency. With `throw=False` failures are in `StableStep.status`:
    those of `modes`, and `NO_EQUILIBRIUM` where the model itself has a mode that grows.

    Raises `ValueError` or `TypeError` for a malformed argument, and what `modes` raises. A traced
    `growth` out of range is `INVALID_STEP`.
    """
    solver = _checked(solver)
    count_functions("steps", steps, 1)
    growth = real_scalar("growth", growth)
    check_all("growth must be finite and > 1", growth, lambda x: (x > 1) & (x < np.inf))
    model, rotor, speed = checked_case(model, rotor, angular_speed)
    found = find(model, rotor, speed, lowest(model, len(model.directions)), judged=False)
    frequency = jnp.max(found.frequency)
    stable = ~(jnp.max(found.growth_rate) > 1e-8 * frequency)
    allowed = jnp.isfinite(growth) & (growth > 1)
    allows = first_broken((allowed, Status.INVALID_STEP))
    status = first_failure(found.status, allows, first_broken((stable, Status.NO_EQUILIBRIUM)))
    ok = status == Status.OK
    frequency = jnp.where(ok, frequency, 1.0)
    step = _limit(solver, jnp.log(jnp.where(allowed, growth, 2.0)) / steps) / frequency
    result = StableStep(nan_unless(ok, step), nan_unless(ok, frequency), status)
    return finish(result, throw)


@Program
def _limit(solver: diffrax.AbstractSolver, rate: Scalar) -> Scalar:
    """The smallest angle per step at which the logarithm of the amplification exceeds `rate`."""

    def grows(angle: Scalar) -> Array:
        factor, done = _factor(solver, angle, jnp.zeros_like(angle))
        return ~(done & (jnp.log(factor) <= rate))  # false, that is unstable, for NaN

    angles = jnp.asarray(_ANGLES, rate.dtype)
    unstable = jax.vmap(grows)(angles)
    first = jnp.argmax(unstable)
    stable = jnp.where(first > 0, angles[first - 1], 0.0)
    _, angle = halved(lambda angle: ~grows(angle), stable, angles[first], 44)  # to rounding
    return jnp.where(jnp.any(unstable), angle, jnp.inf)
