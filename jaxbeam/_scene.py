"""A model in motion under loads: what solvers integrate, and its balance of energy and momentum."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._beam import require
from jaxbeam._blocks import BlockInverse, BlockTridiagonal
from jaxbeam._kernel import total
from jaxbeam._linalg import inverse
from jaxbeam._loads import Damping, Loads
from jaxbeam._models.base import AbstractModel, Equations, Family
from jaxbeam._motion import Hub, Motion, skew
from jaxbeam._solvers.system import SecondOrderSystem, State
from jaxbeam._status import Status
from jaxbeam._types import Code, Matrix, Scalar, Triple, Vector

Inputs = tuple[Hub, Triple | None]


class Scene(SecondOrderSystem):
    """A model of one rotor, its motion, loads and damping: what diffrax gets as `args`.

    The balance that is kept along the way is that of the energy relative to the hub,
    h = q'.dT/dq' - T + U: the Jacobi integral, constant while the hub turns steadily. It changes by

        h' = -(dT/dv . v' + dT/domega . omega') + power of gravity, tip force and damping

    with T less that of the rigid beam, which does not need the inertia of the rigid beam and so
    does not drown what matters.
    """

    equations: Equations
    inverse_mass: Matrix | BlockInverse
    motion: Motion
    loads: Loads
    damping: Damping

    def __init__(
        self, model: AbstractModel, rotor: Any, motion: Motion, loads: Loads, damping: Damping
    ) -> None:
        """From parameters in range."""
        self.equations = model.equations(rotor)
        self.inverse_mass = inverse(self.equations.mass)
        self.motion, self.loads, self.damping = motion, loads, damping

    @property  # type: ignore[misc]
    def mass(self) -> Matrix | BlockTridiagonal:  # type: ignore[override]
        return self.equations.mass

    @property
    def kernel(self) -> "Scene | None":
        if not self.equations.takes_lanes:
            return None
        without: Scene = eqx.tree_at(
            lambda s: (s.inverse_mass, s.motion, s.loads.tip_force), self, (None,) * 3,
            is_leaf=lambda leaf: leaf is None,
        )  # fmt: skip
        return without

    @property
    def work_unit(self) -> Scalar:
        """J per unit of `State.work`."""
        return self.equations.energy_scale / self.equations.size

    @property
    def is_linear(self) -> bool:
        return self.equations.is_linear

    def hub(self, t: Scalar) -> Hub:
        """Motion of the hub."""
        return self.motion.hub(t, self.loads.gravity)

    def inputs(self, t: Scalar) -> Inputs:
        """Motion of the hub, and force at the tip."""
        return self.hub(t), self.loads.at_tip(t)

    def force(self, x: Inputs, q: Vector, v: Vector) -> Vector:
        hub, tip_force = x
        out = self.equations.force(hub, q, v, tip_force)
        return out - self.equations.as_force(q, self._damping(q, v))

    def _damping(self, q: Vector, v: Vector) -> Vector:
        """As a generalised force."""
        return self.equations.damping(q, v, self.damping.mass, self.damping.stiffness)

    def tangents(self, x: Inputs, q: Vector, v: Vector) -> tuple[Any, Any]:
        hub, tip_force = x
        k, c = self.equations.tangents(hub, q, v, tip_force)
        if self.damping.mass is not None or self.damping.stiffness is not None:
            dk, dc = self.equations.damping_tangents(
                q, v, self.damping.mass, self.damping.stiffness
            )
            k, c = k + dk, c + dc
        return k, c

    def acceleration(self, t: Scalar, q: Vector, v: Vector) -> Vector:
        return self.inverse_mass @ self.force(self.inputs(t), q, v)

    def power(self, x: Inputs, q: Vector, v: Vector) -> Scalar:
        """Rate of the balance of energy, in `work_unit` per second."""
        (hub, tip_force), equations = x, self.equations
        _, moved = jax.jvp(
            lambda *twist: equations.kinetic_energy(q, v, *twist),
            (hub.velocity, hub.angular_velocity),
            (hub.velocity_rate, hub.angular_velocity_rate),
        )
        out = -moved - total((equations.nonconservative_force(q) + self._damping(q, v)) * v)
        if self.loads.gravity is not None:
            out = out + total(hub.gravity * jax.jvp(equations.first_moment, (q,), (v,))[1])
        if tip_force is not None:
            out = out + total(tip_force * jax.jvp(equations.tip, (q,), (v,))[1])
        return out / self.work_unit

    def energies(self, t: Scalar, y: State) -> tuple[Scalar, Scalar, Scalar]:
        """T_2 (seen from the hub), -T_0 (centrifugal potential) and U, in J; h is their sum."""
        hub, zero = self.hub(t), jnp.zeros(3, y.q.dtype)
        moving = self.equations.kinetic_energy(y.q, y.v, zero, zero)
        carried = self.equations.kinetic_energy(
            y.q, jnp.zeros_like(y.v), hub.velocity, hub.angular_velocity
        )
        return moving, -carried, self.equations.strain_energy(y.q)

    def total_energy(self, t: Scalar, y: State) -> Scalar:
        """Kinetic energy in the inertial frame, rigid beam included, plus strain energy, J."""
        hub = self.hub(t)
        return self.kinetic(y.q, y.v, hub.velocity, hub.angular_velocity) + (
            self.equations.strain_energy(y.q)
        )

    def kinetic(self, q: Vector, v: Vector, velocity: Triple, spin: Triple) -> Scalar:
        """T in the inertial frame, J."""
        mass, first, second = self.equations.rigid
        beam = jnp.zeros(3, q.dtype).at[0].set(first)
        rigid = (
            mass * (velocity @ velocity) / 2
            + velocity @ skew(spin) @ beam
            + second * (spin[1] ** 2 + spin[2] ** 2) / 2
        )
        return rigid + self.equations.kinetic_energy(q, v, velocity, spin)

    def reaction(self, t: Scalar, y: State) -> tuple[Triple, Triple]:
        """Force and moment about the centre of the hub by which the hub moves the beam.

        F = p' + omega x p - M g - F_tip, C = H' + omega x H + v x p - S x g - r_tip x F_tip, with
        p = dT/dv and H = dT/domega. Damping by `Damping.mass` is taken to act between hub and beam.
        """
        hub, q, v = self.hub(t), y.q, y.v
        a = self.acceleration(t, q, v)
        (p, h), (dp, dh) = jax.jvp(
            jax.grad(self.kinetic, argnums=(2, 3)),
            (q, v, hub.velocity, hub.angular_velocity),
            (v, a, hub.velocity_rate, hub.angular_velocity_rate),
        )
        mass, first, _ = self.equations.rigid
        along = jnp.zeros(3, q.dtype).at[0].set(1.0)
        moment = self.equations.first_moment(q) + first * along
        force = dp + skew(hub.angular_velocity) @ p - mass * hub.gravity
        couple = dh + skew(hub.angular_velocity) @ h + skew(hub.velocity) @ p
        couple = couple - skew(moment) @ hub.gravity
        tip = self.loads.at_tip(t)
        if tip is not None:
            end = self.equations.tip(q) + self.equations.end * along
            force, couple = force - tip, couple - skew(end) @ tip
        return force, couple


def input_status(
    model: AbstractModel, rotor: Any, motion: Motion, loads: Loads, damping: Damping, times: Array
) -> Code:
    """The first thing that is out of range, at any of the output times or `during` the run."""

    def one(t: Scalar) -> tuple[Array, Array, Array]:
        hub, force = motion.hub(t, loads.gravity), loads.at_tip(t)
        force = jnp.zeros(3, t.dtype) if force is None else force
        turn, rate, push = hub.angular_velocity, hub.angular_velocity_rate, hub.acceleration
        stray = jnp.array([turn[0], turn[1], rate[0], rate[1], push[2], force[2]])
        kept = jnp.array([turn[2], turn[2], rate[2], rate[2], jnp.max(jnp.abs(push)), force[1]])
        planar = jnp.all(jnp.abs(stray) <= 1e-9 * jnp.abs(kept) + 1e-12)
        moves = jnp.all(jnp.isfinite(jnp.stack(hub[:4]))) & motion.valid(t)
        return moves, jnp.all(jnp.isfinite(force)) & jnp.all(jnp.isfinite(hub.gravity)), planar

    moves, loaded, planar = jax.vmap(one)(jnp.concatenate([times, during(times)]))
    rates = jnp.stack([jnp.zeros((), times.dtype), *jax.tree.leaves(damping)])
    status = jnp.asarray(Status.OK)
    if Family.FLAP not in model.families:
        status = jnp.where(jnp.all(planar), status, Status.OUT_OF_PLANE)
    for ok, code in (
        (jnp.all(loaded), Status.INVALID_LOAD),
        (jnp.all(moves), Status.INVALID_MOTION),
        (jnp.all(jnp.isfinite(rates) & (rates >= 0)), Status.INVALID_DAMPING),
        (increasing(times), Status.INVALID_TIMES),
    ):
        status = jnp.where(ok, status, code)
    given = rotor.status(jnp.zeros((), times.dtype))
    return jnp.where(given == Status.OK, status, given).astype(int)


def increasing(times: Array) -> Array:
    """Whether times are finite and increasing."""
    return jnp.all(jnp.isfinite(times)) & jnp.all(jnp.diff(times) > 0)


def during(times: Array) -> Array:
    """Times all along a run, whatever its output times are: what is looked at on the way."""
    return jnp.linspace(times[0], times[-1], 65)


def check_scene(motion: Any, loads: Any, damping: Any, t: Array) -> None:
    for name, value, kind in (
        ("motion", motion, Motion), ("loads", loads, Loads), ("damping", damping, Damping)
    ):  # fmt: skip
        if not isinstance(value, kind):
            article = "a" if kind is Motion else "of class"
            raise TypeError(f"{name} must be {article} {kind.__name__}, got {type(value).__name__}")
    shapes = [a.shape for a in eqx.filter_eval_shape(motion.twist, t)]
    if shapes != [(3,), (3,)]:
        raise ValueError(f"motion.twist must return two vectors of shape (3,), got {shapes}")
    if loads.gravity is not None:
        eqx.filter_eval_shape(motion.attitude, t)  # raises where it is not stated


def checked_times(times: Any) -> Array:
    times = jnp.asarray(times, jnp.result_type(float))
    if times.ndim != 1 or times.size < 2:
        raise ValueError(f"times must be a list of two or more numbers, got shape {times.shape}")
    if not isinstance(times, jax.core.Tracer):
        known = np.asarray(times)
        require(Status.INVALID_TIMES, bool(np.isfinite(known).all()), known)
        require(Status.INVALID_TIMES, bool((np.diff(known) > 0).all()), known)
    return times


def check_start(model: AbstractModel, start: Any) -> None:
    if not isinstance(start, State):
        raise TypeError(f"start must be a State, got {type(start).__name__}")
    n = len(model.families)
    for name in ("q", "v"):
        if np.shape(getattr(start, name)) != (n,):
            raise ValueError(
                f"start.{name} must have shape ({n},), got {np.shape(getattr(start, name))}"
            )
