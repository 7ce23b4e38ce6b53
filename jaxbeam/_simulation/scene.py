"""A model in motion under loads: what solvers integrate, and its balance of energy and momentum."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._models.contract.drag import drag_of
from jaxbeam._models.contract.equations import Equations, Inputs
from jaxbeam._models.contract.loaded import SpanLoad, equations_under
from jaxbeam._numerics.blocks import BlockInverse, BlockTridiagonal
from jaxbeam._numerics.kinematics import Kinematics
from jaxbeam._numerics.linalg import inverse
from jaxbeam._numerics.small import SmallMatrix
from jaxbeam._programs.lanes import pairwise_sum
from jaxbeam._results import replaced, without_derivatives
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.clock import Clock, Later, place
from jaxbeam._rotor.damping import Damping
from jaxbeam._rotor.loads import Loads
from jaxbeam._rotor.motion import Hub, Motion, Times, skew
from jaxbeam._simulation.closures import TracedMotion, converted
from jaxbeam._simulation.pauses import Pauses
from jaxbeam._solvers.system import SecondOrderSystem, State
from jaxbeam._types import Coordinates, Matrix, Number, Scalar, Triple, Vector


class Scene(SecondOrderSystem):
    """A model of one rotor, its motion, loads and damping: what diffrax gets as `args`.

    `model`, `rotor`, `motion`, `loads`, `damping` and `times` are those of `simulate`, in range.

    The balance that is kept along the way is that of the energy relative to the hub,
    h = q'.dT/dq' - T + U: the Jacobi integral, constant while the hub turns steadily. It changes by

        h' = -(dT/dv . v' + dT/domega . omega') + power of gravity, tip force and damping

    with T less that of the rigid beam, which does not need the inertia of the rigid beam and so
    does not drown what matters.
    """

    equations: Equations
    span: SpanLoad | None  # force along the span; None without one
    # For solvers that need accelerations; None for others.
    inverse_mass: Matrix | BlockInverse | None
    motion: Motion
    loads: Loads
    damping: Drag
    pauses: Pauses  # declared times at which steps end
    # Earliest and latest time at which motion and loads are evaluated, s.
    between: tuple[Scalar, Scalar] | None
    jumps: tuple[Times, Times]  # times at which motion and loads may jump, increasing

    def __init__(
        self, model: AbstractModel, rotor: AnyRotor, motion: Motion, loads: Loads, damping: Damping,
        times: Array | None = None,
    ) -> None:  # fmt: skip
        """A scene of parameters in range, for a run from times[0] to times[-1] if there is to be
        one."""
        self.equations = equations_under(model, rotor, loads)
        self.span, self.inverse_mass = SpanLoad.of(self.equations, loads), None
        self.motion, self.loads = motion, loads
        self.damping = drag_of(damping, model, rotor, self.equations)
        changes = jnp.concatenate([motion.change_times(), loads.change_times()])
        self.jumps = jnp.sort(motion.jump_times()), jnp.sort(loads.jump_times())
        self.pauses = Pauses(changes, jnp.concatenate(self.jumps), times)
        self.between = (jnp.asarray(-jnp.inf), self.pauses.latest) if self.pauses.sided else None

    def since(self, origin: Scalar) -> "Scene":
        """Scene by a clock that shows zero at time `origin`, as in `Motion.since`."""
        span, pauses = self.span, self.pauses.since(origin)
        if span is not None:
            clock = Clock(origin, self.loads.jump_times())
            span = SpanLoad(span.integral, Later(span.density, clock))
        between = None if self.between is None else (self.between[0], pauses.latest)
        jumps = tuple(times - origin for times in self.jumps)
        motion, loads = self.motion.since(origin), self.loads.since(origin)
        return replaced(
            self, motion=motion, loads=loads, span=span, pauses=pauses, between=between, jumps=jumps
        )

    def within(self, t0: Scalar, t1: Scalar | None = None) -> "Scene":
        """The scene of a step from t0 to t1, which asks for what jumps there on its own side."""
        if self.between is None:
            return self
        t0, latest = without_derivatives((t0, self.between[1]))
        if t1 is not None:
            latest = jnp.minimum(latest, self.pauses.before(without_derivatives(t1)))
        return replaced(self, between=(self.pauses.after(t0), latest))

    @property  # type: ignore[misc]
    def mass(self) -> Matrix | BlockTridiagonal | SmallMatrix:  # type: ignore[override]
        return self.equations.mass

    @property
    def kernel(self) -> "Scene | None":
        equations = self.equations.kernel
        if equations is None:
            return None
        loads = replaced(
            self.loads, tip_force=None, tip_moment=None, force_per_length=None, changes=None,
            jumps=None, point_forces=None,
        )  # fmt: skip
        return replaced(
            self, equations=equations, loads=loads, span=None, inverse_mass=None, motion=None,
            pauses=None, between=None, jumps=None,
        )  # fmt: skip

    @property
    def work_unit(self) -> Number:
        """The unit of `State.work`, in J."""
        return self.equations.energy_scale / self.equations.length

    @property
    def is_linear(self) -> bool:
        return self.equations.is_linear

    def hub(self, t: Scalar) -> Hub:
        """Motion of the hub."""
        return self.motion.hub(self._within(t), self.loads.gravity)

    def with_closures_traced(self, t: Scalar) -> "Scene":
        """The scene with all that motion and loads are made of as leaves, what functions of
        the user close over too, and without tracing them ever again; t is any time."""
        gravity, loads = self.loads.gravity, self.loads
        hub = eqx.filter_closure_convert(lambda t: self.motion.hub(t, gravity), t)
        motion = TracedMotion(hub, self.motion.change_times(), self.motion.jump_times())
        force, moment = (converted(part, t) for part in (loads.tip_force, loads.tip_moment))
        loads = replaced(
            loads, tip_force=force, tip_moment=moment, force_per_length=None, point_forces=None
        )
        span = self.span
        if span is not None:
            span = SpanLoad(span.integral, eqx.filter_closure_convert(span.density, t))
        return replaced(self, motion=motion, loads=loads, span=span)

    def with_inverse(self) -> "Scene":
        """The scene for a solver that asks for accelerations at every stage."""
        return replaced(self, inverse_mass=inverse(self.mass))

    def _within(self, t: Scalar) -> Scalar:
        """The time t, or where a step ends or begins at a jump there, a moment before or after
        it."""
        if self.between is None:
            return t
        own = jax.lax.stop_gradient(t)
        earliest, latest = self.between
        return t + (jnp.minimum(jnp.maximum(own, earliest), latest) - own)

    @property
    def has_jumps(self) -> bool:
        """Whether the hub's velocity, its rate or a load may jump, as declared."""
        return any(times.size for times in self.jumps)

    def after(self, t: Scalar) -> Scalar:
        """The time t, or a moment later where something jumps at t; at the end of the run, which no
        jump is part of, a moment earlier."""
        if self.between is None:
            return t
        own = jax.lax.stop_gradient(t)
        return self._within(t + (self.pauses.after(own) - own))

    def velocities_of(self, hub: Hub) -> Float[Array, " 6"]:
        """Velocity of the hub and what its rotation makes of it at the tip, in m/s."""
        return jnp.concatenate([hub.velocity, self.equations.tip_radius * hub.angular_velocity])

    def velocity_rates_of(self, hub: Hub) -> Float[Array, " 6"]:
        """The rate of `velocities_of`, in m/s^2."""
        return jnp.concatenate(
            [hub.velocity_rate, self.equations.tip_radius * hub.angular_velocity_rate]
        )

    def after_impulse(self, t: Scalar, y: State) -> State:
        """The state y after what jumps at the declared time t.

        A jump of the hub's velocities is a rate without end: the generalised momentum that it
        leaves behind is that of the inertia forces, M dq' = -(inertia forces of the jump), q stays,
        and the work is exact since velocities rise together. By the time of the jump the state
        has derivatives: y goes on to it with the rates before, and back with those after. A load
        may jump at the same time by another parameter: between the two the load alone is new.
        """
        t = jax.lax.stop_gradient(t)
        before, after = self.pauses.before(t), self.pauses.after(t)
        late, load_late = (_late(jumps, before, after) for jumps in self.jumps)
        (old, *old_loads), (new, *new_loads) = self.inputs(before + late), self.inputs(after + late)
        y = self._moved(y, (old, *old_loads), load_late)
        y = self._moved(y, (old, *new_loads), late - load_late)
        zero = jnp.zeros_like(old.velocity)
        still = Hub(zero, zero, zero, zero, zero)
        jump = still._replace(
            velocity_rate=new.velocity - old.velocity,
            angular_velocity_rate=new.angular_velocity - old.angular_velocity,
        )
        impulse = self.equations.force(jump, y.q, jnp.zeros_like(y.v), None)
        impulse = impulse - self.equations.force(still, y.q, jnp.zeros_like(y.v), None)
        v = y.v + self._over_mass(impulse)
        halfway = jump._replace(
            velocity=(old.velocity + new.velocity) / 2,
            angular_velocity=(old.angular_velocity + new.angular_velocity) / 2,
        )
        work = self._moved_by(*without_derivatives((halfway, y.q, (y.v + v) / 2))) / self.work_unit
        y = State(y.q, v, y.work - jax.lax.stop_gradient(work))
        return self._moved(y, (new, *new_loads), -late)

    def _moved(self, y: State, x: Inputs, h: Scalar) -> State:
        """The state a time h after y under these inputs, to first order in h."""
        rate = self.kinematics(y.q, y.v), self._over_mass(self.force(x, y.q, y.v))
        return State(y.q + h * rate[0], y.v + h * rate[1], y.work)

    def inputs(self, t: Scalar) -> Inputs:
        """Motion of the hub, and what acts at the tip and along the span."""
        within = self._within(t)
        span = None if self.span is None else self.span(within)
        return self.hub(t), self.loads.at_tip(within), span

    def kinematics(self, q: Coordinates, v: Vector) -> Coordinates:
        return self.equations.kinematics(q, v)

    def stage_kinematics(self, q: Coordinates, v: Vector, g: Number) -> Kinematics:
        return self.equations.stage_kinematics(q, v, g)

    def force(self, x: Inputs, q: Coordinates, v: Vector) -> Vector:
        out = self.equations.force_under(x, q, v)
        return out - self.equations.as_force(q, self._damping(q, v))

    def _damping(self, q: Coordinates, v: Vector) -> Vector:
        """The damping as a generalised force."""
        return self.equations.damping(q, v, self.damping)

    def tangents(self, x: Inputs, q: Coordinates, v: Vector) -> tuple[Any, Any]:
        k, c = self.equations.tangents_under(x, q, v)
        if not self.damping.is_none:
            dk, dc = self.equations.damping_tangents(q, v, self.damping)
            k, c = k + dk, c + dc
        return k, c

    def acceleration(self, t: Scalar, q: Coordinates, v: Vector) -> Vector:
        return self._over_mass(self.force(self.inputs(t), q, v))

    def _over_mass(self, force: Vector) -> Vector:
        kept = self.inverse_mass
        return (inverse(self.mass) if kept is None else kept) @ force

    def power(self, x: Inputs, q: Coordinates, v: Vector) -> Number:
        """Rate of the balance of energy, in `work_unit` per second."""
        (hub, tip_force, span), equations = x, self.equations
        out = -self._moved_by(hub, q, v) - pairwise_sum(
            (equations.nonconservative_force(q) + self._damping(q, v)) * v
        )
        if self.loads.gravity is not None:
            moving = self.kinematics(q, v)
            out = out + pairwise_sum(
                hub.gravity * jax.jvp(equations.first_moment, (q,), (moving,))[1]
            )
        if tip_force is not None:
            out = out + equations.tip_power(q, v, tip_force)
        if span is not None:
            out = out + span.power(equations, q, v)
        return out / self.work_unit

    def _moved_by(self, hub: Hub, q: Coordinates, v: Vector) -> Number:
        """The rate dT/dv . v' + dT/domega . omega' at which the motion of the hub changes the
        kinetic energy T."""
        _, out = jax.jvp(
            lambda *velocities: self.equations.kinetic_energy(q, v, *velocities),
            (hub.velocity, hub.angular_velocity),
            (hub.velocity_rate, hub.angular_velocity_rate),
        )
        return out

    def energies(self, t: Scalar, y: State) -> tuple[Scalar, Scalar, Scalar]:
        """The energies T_2 (seen from the hub), -T_0 (centrifugal potential) and U, in J; h is
        their sum."""
        return self.energies_in(self.hub(t), y)

    def energies_in(self, hub: Hub, y: State) -> tuple[Number, Number, Number]:
        """Energies of a state where the hub moves like this."""
        # For the beam moving in a hub at rest, and for the beam at rest in the moving hub.
        moving, carried = jax.vmap(
            lambda own: self.equations.kinetic_energy(
                y.q, own * y.v, (1 - own) * hub.velocity, (1 - own) * hub.angular_velocity
            )
        )(jnp.array([1.0, 0.0], y.q.dtype))
        return moving, -carried, self.equations.strain_energy(y.q)

    def total_energy(self, t: Scalar, y: State) -> Scalar:
        """Kinetic energy in the inertial frame, rigid beam included, plus strain energy, J."""
        hub = self.hub(t)
        return self.kinetic(y.q, y.v, hub.velocity, hub.angular_velocity) + (
            self.equations.strain_energy(y.q)
        )

    def kinetic(self, q: Coordinates, v: Vector, velocity: Triple, spin: Triple) -> Number:
        """Kinetic energy in the inertial frame, in J."""
        mass, first, inertia, _ = self.equations.undeformed
        rigid = (
            mass * (velocity @ velocity) / 2
            + velocity @ skew(spin) @ first
            + spin @ inertia @ spin / 2
        )
        return rigid + self.equations.kinetic_energy(q, v, velocity, spin)

    def reaction(
        self, t: Scalar, y: State, acceleration: Vector | None = None, *, rests: bool = False
    ) -> tuple[Triple, Triple]:
        """Force and moment about the centre of the hub by which the hub moves the beam, whose
        `acceleration` v' is by default that of the equations, unless it `rests` in the hub.

        F = p' + omega x p - M g - F_tip, C = H' + omega x H + v x p - S x g - r_tip x F_tip -
        M_tip, with p = dT/dv and H = dT/domega. Damping by `Damping.mass` is taken to act between
        hub and beam.
        """
        hub, q, v = self.hub(t), y.q, y.v
        own = self.equations.own_reaction(hub, q, *self.inputs(t)[1:]) if rests else None
        if own is not None:
            return own
        a = self.acceleration(t, q, v) if acceleration is None else acceleration
        (p, h), (dp, dh) = jax.jvp(
            jax.grad(self.kinetic, argnums=(2, 3)),
            (q, v, hub.velocity, hub.angular_velocity),
            (self.kinematics(q, v), a, hub.velocity_rate, hub.angular_velocity_rate),
        )
        mass, first, _, end = self.equations.undeformed
        moment = self.equations.first_moment(q) + first
        force = dp + skew(hub.angular_velocity) @ p - mass * hub.gravity
        couple = dh + skew(hub.angular_velocity) @ h + skew(hub.velocity) @ p
        couple = couple - skew(moment) @ hub.gravity
        tip = self.loads.at_tip(t)
        if tip is not None:
            end = self.equations.tip(q) + end
            push, moment = self.equations.tip_action(q, tip)
            force, couple = force - push, couple - skew(end) @ push - moment
        if self.span is not None:
            push, moment = self._span_action(self.span, t, q)
            force, couple = force - push, couple - moment
        return force, couple

    def _span_action(self, span: SpanLoad, t: Scalar, q: Coordinates) -> tuple[Triple, Triple]:
        """The resultant of the force along the span, and its moment about the centre of the hub."""
        equations, (xi, weight) = self.equations, span.integral.points
        pace = span.integral.pace(equations.length) * weight[:, None]
        force = pace * span.integral.acting(q, span.density(t))
        place = equations.undeformed_at(xi) + equations.displacement(q, xi)
        return jnp.sum(force, 0), jnp.sum(jnp.cross(place, force), 0)


def _late(jumps: Times, before: Scalar, after: Scalar) -> Scalar:
    """Zero, with the derivative of a time of a jump between `before` and `after`, if there is one
    in `jumps` (increasing); of several, which steps cannot tell apart, the mean of first and
    last."""
    if not jumps.size:
        return jnp.zeros_like(before)
    own = jax.lax.stop_gradient(jumps)
    first, beyond = place(own, before, "right"), place(own, after, "left")
    at = jnp.mean(jumps[jnp.clip(jnp.stack([first, beyond - 1]), 0, jumps.size - 1)])
    return jnp.where(beyond > first, at - jax.lax.stop_gradient(at), 0.0)
