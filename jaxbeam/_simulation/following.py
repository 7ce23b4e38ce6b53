"""Steps that follow the motion, and impulses where it jumps, for any controller and solver."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._programs.lanes import pairwise_sum
from jaxbeam._results import replaced, without_derivatives
from jaxbeam._simulation.scene import Scene
from jaxbeam._simulation.step_limits import StepLimits
from jaxbeam._solvers.steps import WEIGHTS, inputs_along, length
from jaxbeam._solvers.system import State
from jaxbeam._types import Matrix, Scalar

# Change of the hub's speed in a step that its rate does not explain, over the largest speed, beyond
# which the step is rejected.
_MISMATCH = 1e-6
_JUMP = 1e-5  # unexplained change of the hub's speed beyond which a run ends, in its shortest step
_MISSED = 1e-3  # unexplained change of the hub's speed beyond which a run ends, summed over it
_SHORTEST = 1e-9  # shortest step, over the duration of the run: a change within it is a jump
# Result of a run that missed a change of its motion; diffrax itself does not use this code here.
MOTION_MISSED = diffrax.RESULTS.max_steps_rejected


class _Followed(eqx.Module):
    """The state of `_Following` between steps."""

    wanted: Scalar  # end of the next step as the controller wants it
    inner: Any
    velocities: Float[Array, " 6"]  # velocities of the hub at the end of the last accepted step
    # Change of velocities so far that the integral of their rates does not explain.
    missed: Float[Array, " 6"]
    speed: Scalar


class _Following(diffrax.AbstractStepSizeController):
    """A controller whose steps are limited by what motion and loads do: `StepLimits`."""

    controller: diffrax.AbstractStepSizeController
    step_limits: StepLimits

    def __init__(
        self, controller: diffrax.AbstractStepSizeController, step_limits: StepLimits
    ) -> None:
        self.controller, self.step_limits = controller, step_limits

    def wrap(self, direction: Any) -> Any:
        """The controller itself, as diffrax asks for it: runs go forwards."""
        return replaced(self, controller=self.controller.wrap(direction))

    def init(
        self, terms: Any, t0: Any, t1: Any, y0: State, dt0: Any, args: Scene, *rest: Any
    ) -> Any:
        """The end of the first step, and the state of the controller."""
        step_limits = self.step_limits
        wanted, inner = self.controller.init(terms, t0, t1, y0, dt0, args, *rest)
        state = _Followed(
            jnp.asarray(wanted),
            inner,
            step_limits.velocities,
            jnp.zeros_like(step_limits.velocities),
            step_limits.speed,
        )
        return step_limits.limit(*without_derivatives((t0, state.wanted)), self._adaptive), state

    def adapt_step_size(
        self, t0: Any, t1: Any, y0: State, y1_candidate: State, args: Scene, y_error: Any,
        error_order: Any, controller_state: _Followed,
    ) -> Any:  # fmt: skip
        """Whether the step is accepted, the next step, and whether a declared time lies between
        them."""
        step_limits, state = self.step_limits, controller_state
        sizes = self._sizes(t0, t1, args, (y0, y1_candidate, y_error))
        keep, start, wanted, jumped, inner, result = self.controller.adapt_step_size(
            t0, t1, sizes[0], sizes[1], args, sizes[2], error_order, state.inner
        )
        t0, t1 = without_derivatives((t0, t1))
        if self._adaptive:
            wanted = step_limits.resting(args, y1_candidate, start, wanted)
        else:
            # The controller within knows only the steps that it asked for, not the parts that these
            # are divided into, and one that it asked for may end at a declared time.
            whole = t1 >= state.wanted - step_limits.pauses.near
            start = jnp.where(whole, start, t1)
            wanted = jnp.where(whole, wanted, state.wanted)
            inner = _chosen(whole, inner, state.inner)

        h = length(t0, t1)
        hub, *_ = inputs_along(args.within(t0, t1), t0, h)
        velocities = jax.vmap(args.velocities_of)(hub)
        rate = jax.vmap(args.velocity_rates_of)(hub)
        before = state.velocities
        if args.has_jumps:
            before = jnp.where(step_limits.pauses.jumped(t0), velocities[0], before)
        mismatch = velocities[-1] - before - h * (WEIGHTS @ rate[1:-1])
        speed = jnp.maximum(state.speed, jnp.max(jnp.abs(velocities)))
        off, rounding = jnp.max(jnp.abs(mismatch)), float(jnp.finfo(h.dtype).eps)
        shortest = h <= jnp.maximum(_SHORTEST * step_limits.duration, step_limits.pauses.near)
        # Change of velocity by rounding of times.
        unknown = step_limits.rounding * jnp.max(jnp.abs(rate))
        seen = shortest | (off <= (_MISMATCH + 32 * rounding) * speed + unknown)
        missed = state.missed + mismatch

        kept = keep & seen
        again = keep & ~seen
        start = jnp.where(again, t0, start)
        inner = _chosen(again, state.inner, inner)
        jump = shortest & (off > (_JUMP + 1e2 * rounding) * speed)
        lost = kept & (jump | (jnp.max(jnp.abs(missed)) > (_MISSED + 1e3 * rounding) * speed))
        result = diffrax.RESULTS.where(lost, MOTION_MISSED, result)
        if step_limits.pauses.first.size:
            stopped = kept & step_limits.pauses.at(t1)
            jumped = jumped | stopped
            # One that knows the same declared times would leave a gap after them.
            start = jnp.where(stopped, t1, start)
            wanted = jnp.where(stopped & (wanted <= start), start + h, wanted)
        end = jnp.where(
            again,
            t0 + h / 10,
            step_limits.limit(*without_derivatives((start, jnp.asarray(wanted))), self._adaptive),
        )
        state = _Followed(
            jnp.where(again, state.wanted, wanted), inner,
            jnp.where(kept, velocities[-1], state.velocities),
            jnp.where(kept, missed, state.missed), speed,
        )  # fmt: skip
        return kept, start, end, jumped, state, result

    @property
    def _adaptive(self) -> bool:
        return isinstance(self.controller, diffrax.AbstractAdaptiveStepSizeController)

    def _sizes(self, t0: Any, t1: Any, scene: Scene, given: tuple[State, ...]) -> tuple[State, ...]:
        """The two states of a step and its error, in the form in which the controller measures
        them."""
        pauses = self.step_limits.pauses
        if not self._adaptive:
            return given
        own, measure = given, self.step_limits.measure
        if measure is not None:
            y0, y1, off = (_measured(measure, y) for y in given)
            # Controllers reject steps with infinite errors, or with states that are NaN, but not
            # with errors that are NaN: these become infinite.
            own = y0, y1, jax.tree.map(lambda a: jnp.where(jnp.isnan(a), jnp.inf, a), off)
        if not pauses.sided:
            return own
        apart = pauses.apart(t0)
        quick = apart < self.step_limits.quick
        seen = _displacements(scene, jnp.where(quick, apart, 0.0), *given)
        chosen: tuple[State, ...] = _chosen(quick, seen, own)
        return chosen


class _AdaptiveFollowing(_Following, diffrax.AbstractAdaptiveStepSizeController):
    """A controller with tolerances whose steps are limited by what motion and loads do."""

    rtol: Any
    atol: Any
    norm: Any

    def __init__(
        self, controller: diffrax.AbstractAdaptiveStepSizeController, step_limits: StepLimits
    ) -> None:
        super().__init__(controller, step_limits)
        self.rtol, self.atol, self.norm = controller.rtol, controller.atol, controller.norm


def _measured(by: Matrix, y: State) -> State:
    """A state with one velocity in the place of all, the root of v^T W v (see
    `Equations.velocity_measure`); NaN where it is not finite."""
    square = y.v @ (by @ y.v)
    size = jnp.where(jnp.isfinite(square), jnp.sqrt(jnp.maximum(square, 0.0)), jnp.nan)
    return State(y.q, jnp.full_like(y.v, size), y.work)


def following(
    controller: diffrax.AbstractStepSizeController, step_limits: StepLimits
) -> _Following:
    """The `controller`, with steps that are limited by what motion and loads do."""
    if isinstance(controller, diffrax.AbstractAdaptiveStepSizeController):
        return _AdaptiveFollowing(controller, step_limits)
    return _Following(controller, step_limits)


def _displacements(
    scene: Scene, apart: Scalar, y0: State, y1: State, error: State
) -> tuple[State, State, State]:
    """Two states and an error as displacements, in m, for step-size control. Each coordinate
    becomes its root mean square along the beam, by mass, and so does each rate. The error of a rate
    becomes the displacement that it makes in a mode with one period between two corners of the
    motion, a time `apart` (s).

    A motion with corners excites all modes, also those that no step between two corners resolves.
    These have small displacements but large velocities, about which a table with slower samples
    says nothing. Errors of slower modes show in the error of the displacement.
    """
    equations, per_rate = scene.equations, apart / (2 * np.pi)
    mass = equations.rigid_moments[0]

    def mean(a: Array) -> Scalar:
        return jnp.sqrt(jnp.maximum(pairwise_sum(a * (scene.mass @ a)), 0.0) / mass)

    def of(y: State, q: Scalar, v: Scalar) -> State:
        return State(jnp.full_like(y.q, q), jnp.full_like(y.v, v), y.work)

    first, last = (mean(equations.displaced(y.q)) for y in (y0, y1))
    changed = mean(equations.as_velocities(y1.q, error.q))
    off = of(error, changed, per_rate * mean(error.v))
    return of(y0, first, first), of(y1, last, last), off


def _chosen(which: Any, a: Any, b: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(which, a, b), a, b)


class AfterImpulse(diffrax.AbstractWrappedSolver):
    """Any solver, which evaluates motion and loads on the step's side of a jump, and gives the beam
    the impulse of a jump of the hub's velocity where a step follows one."""

    solver: diffrax.AbstractSolver  # type: ignore[misc]

    @property
    def term_structure(self) -> Any:
        """The structure of terms of the solver within."""
        return self.solver.term_structure

    @property
    def interpolation_cls(self) -> Any:  # type: ignore[override]
        """The interpolation of the solver within."""
        return self.solver.interpolation_cls

    @property
    def term_compatible_contr_kwargs(self) -> Any:
        """The arguments for terms of the solver within."""
        return self.solver.term_compatible_contr_kwargs

    @property
    def root_finder(self) -> Any:
        """The root finder of the solver within, if it is implicit."""
        return self.solver.root_finder  # type: ignore[attr-defined]

    def order(self, terms: Any) -> Any:
        """The order of the solver within."""
        return self.solver.order(terms)

    def error_order(self, terms: Any) -> Any:
        """The order of the error estimate of the solver within."""
        return self.solver.error_order(terms)

    def init(self, terms: Any, t0: Any, t1: Any, y0: State, args: Scene) -> Any:
        """The first state of the solver within, at t0, after a jump there."""
        return self.solver.init(terms, t0, t1, y0, args.within(t0))

    def func(self, terms: Any, t0: Any, y0: State, args: Scene) -> Any:
        """The rate that the solver within computes at t0, after a jump there."""
        return self.solver.func(terms, t0, y0, args.within(t0))

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: State, args: Scene, solver_state: Any,
        made_jump: Any,
    ) -> Any:  # fmt: skip
        """One step of the solver within, after the impulse of a jump at t0."""
        if made_jump is not False and args.has_jumps:
            # Steps also resume after smooth changes and where a controller says so, but only jumps
            # have an impulse.
            after_impulse = made_jump & args.pauses.jumped(t0)
            y0 = jax.lax.cond(after_impulse, lambda: args.after_impulse(t0, y0), lambda: y0)
        return self.solver.step(terms, t0, t1, y0, args.within(t0, t1), solver_state, made_jump)
