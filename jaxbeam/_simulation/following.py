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

_MISMATCH = 1e-6  # of the hub's speed in a step, relative to the largest, that is not accepted
_JUMP = 1e-5  # the same in the shortest step, by which a run ends
_MISSED = 1e-3  # the same summed over a run
_SHORTEST = 1e-9  # step, relative to the run: what changes within it is a jump
# What a run ends with that missed something of its motion; diffrax itself does not use it here.
MOTION_MISSED = diffrax.RESULTS.max_steps_rejected


class _Followed(eqx.Module):
    """State of `Following`."""

    wanted: Scalar  # end of the step that the controller wants
    inner: Any
    velocities: Float[Array, " 6"]  # at the end of the last step that was kept
    missed: Float[Array, " 6"]  # of their change so far, by the integral of their rates
    speed: Scalar


class _Following(diffrax.AbstractStepSizeController):
    """Any controller, with steps that see what motion and loads do."""

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
        """Whether the step is kept, the next one, and whether a stop was passed between them."""
        step_limits, state = self.step_limits, controller_state
        sizes = self._sizes(t0, t1, args, (y0, y1_candidate, y_error))
        keep, start, wanted, jumped, inner, result = self.controller.adapt_step_size(
            t0, t1, sizes[0], sizes[1], args, sizes[2], error_order, state.inner
        )
        t0, t1 = without_derivatives((t0, t1))
        if self._adaptive:
            wanted = step_limits.resting(args, y1_candidate, start, wanted)
        else:
            # It knows the steps that it wants alone, and not those into which they are divided.
            # What it wanted may be one with a declared time.
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
        unknown = step_limits.rounding * jnp.max(jnp.abs(rate))  # since times are rounded
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
            # A controller that knows of the same times leaves a gap at them.
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
        """The two states of a step and its error, as the controller is to see them."""
        pauses = self.step_limits.pauses
        if not self._adaptive:
            return given
        own, measure = given, self.step_limits.measure
        if measure is not None:
            y0, y1, off = (_measured(measure, y) for y in given)
            # Controllers know a state that is no number, and an error that is infinite.
            own = y0, y1, jax.tree.map(lambda a: jnp.where(jnp.isnan(a), jnp.inf, a), off)
        if not pauses.sided:
            return own
        apart = pauses.apart(t0)
        quick = apart < self.step_limits.quick
        seen = _displacements(scene, jnp.where(quick, apart, 0.0), *given)
        chosen: tuple[State, ...] = _chosen(quick, seen, own)
        return chosen


class _AdaptiveFollowing(_Following, diffrax.AbstractAdaptiveStepSizeController):
    """A controller with tolerances, within steps that follow the motion."""

    rtol: Any
    atol: Any
    norm: Any

    def __init__(
        self, controller: diffrax.AbstractAdaptiveStepSizeController, step_limits: StepLimits
    ) -> None:
        super().__init__(controller, step_limits)
        self.rtol, self.atol, self.norm = controller.rtol, controller.atol, controller.norm


def _measured(by: Matrix, y: State) -> State:
    """A state with one velocity for all, see `Equations.velocity_measure`: NaN where it is not
    finite."""
    square = y.v @ (by @ y.v)
    size = jnp.where(jnp.isfinite(square), jnp.sqrt(jnp.maximum(square, 0.0)), jnp.nan)
    return State(y.q, jnp.full_like(y.v, size), y.work)


def following(
    controller: diffrax.AbstractStepSizeController, step_limits: StepLimits
) -> _Following:
    """The `controller`, with steps that see what motion and loads do."""
    if isinstance(controller, diffrax.AbstractAdaptiveStepSizeController):
        return _AdaptiveFollowing(controller, step_limits)
    return _Following(controller, step_limits)


def _displacements(
    scene: Scene, apart: Scalar, y0: State, y1: State, error: State
) -> tuple[State, State, State]:
    """Two states and an error as displacements, in m. Each coordinate is the mean along the beam,
    root of mean square by the mass; each rate is too, but that of the error is what it makes of a
    mode that goes round once between two corners, so far `apart`, in s.

    What has corners sets all modes in motion, those too that no step between two corners resolves.
    Their displacements are small, but not their velocities; and of these a table whose samples are
    slower than they are knows nothing. Of slower modes the error of the displacement tells.
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
    """Any solver, asking for what jumps on the side of its step, with the impulse of a jump of the
    hub's velocity where steps resume after one."""

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
        """The first state of the solver within, after a jump at t0."""
        return self.solver.init(terms, t0, t1, y0, args.within(t0))

    def func(self, terms: Any, t0: Any, y0: State, args: Scene) -> Any:
        """The rate of the solver within, after a jump at t0."""
        return self.solver.func(terms, t0, y0, args.within(t0))

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: State, args: Scene, solver_state: Any,
        made_jump: Any,
    ) -> Any:  # fmt: skip
        """One step, after the impulse if there is one."""
        if made_jump is not False and args.has_jumps:
            # Steps also resume after what begins or ends smoothly, and where a controller says so.
            after_impulse = made_jump & args.pauses.jumped(t0)
            y0 = jax.lax.cond(after_impulse, lambda: args.after_impulse(t0, y0), lambda: y0)
        return self.solver.step(terms, t0, t1, y0, args.within(t0, t1), solver_state, made_jump)
