"""Small motion about the state that loads deform, with damping."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxbeam._checks import kind_of
from jaxbeam._models.contract.base import (
    AbstractModel,
    Equations,
    LinearSystem,
    guarded,
    steady_strain,
)
from jaxbeam._models.contract.equilibrium import equilibrium
from jaxbeam._models.contract.spread import SpanForce
from jaxbeam._numerics.linalg import dense
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.directions import Direction, is_hinged
from jaxbeam._rotor.loads import NO_LOADS, Damping, Loads
from jaxbeam._rotor.motion import Hub, spinning
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Scalar, Vector

_ALL = ((tuple(Direction), tuple(Direction)),)


class Conditions(eqx.Module):
    """Loads that are constant in the hub, and damping: under what a beam turns steadily."""

    loads: Loads
    damping: Damping

    def status(self, model: AbstractModel, speed: Scalar) -> Code:
        """Whether these are in range, and nothing turns in the hub."""
        zero = jnp.zeros(3, speed.dtype)
        given: Any = (self.loads.gravity, self.loads.tip_force, self.loads.tip_moment)
        gravity, force, moment = (zero if part is None else part for part in given)
        rates = jnp.stack([zero[0], *jax.tree.leaves(self.damping)])
        span = self.loads.span_moments(zero[0])
        span = jnp.zeros((2, 3), speed.dtype) if span is None else span
        loads = jnp.concatenate([jnp.stack([gravity, force, moment]), span])
        planar = Direction.FLAP in model.directions or jnp.all(loads[:, 2] == 0)
        return first_broken(
            (jnp.all(jnp.isfinite(loads)), Status.INVALID_LOAD),
            (jnp.all(jnp.isfinite(rates) & (rates >= 0)), Status.INVALID_DAMPING),
            ((speed == 0) | jnp.all(gravity[:2] == 0), Status.TURNING_GRAVITY),
            (planar, Status.OUT_OF_PLANE),
        )

    def state(self, model: AbstractModel, rotor: AnyRotor, speed: Scalar) -> tuple[Vector, Code]:
        """Coordinates of the steady state, and the status of the search for it."""
        equations = equations_under(model, rotor, self.loads)
        return equilibrium(equations, *self.acting(equations, speed))

    def acting(
        self, equations: Equations, speed: Scalar, factor: Scalar | None = None
    ) -> tuple[Hub, Any, SpanForce | None]:
        """The hub that turns steadily, in gravity, and what acts at the tip and along the span; all
        loads so many times."""
        hub, loads = spinning(speed), acting_on(equations, self.loads, jnp.zeros_like(speed))
        gravity = hub.gravity if self.loads.gravity is None else self.loads.gravity
        if factor is not None:
            gravity, loads = jax.tree.map(lambda part: factor * part, (gravity, loads))
        return hub._replace(gravity=gravity), *loads

    def system(
        self, model: AbstractModel, rotor: AnyRotor, speed: Scalar, factor: Scalar | None = None
    ) -> LinearSystem:
        """Matrices of small motion about the steady state, for what is in range, under so many
        times the loads."""
        equations = equations_under(model, rotor, self.loads)
        hub, tip, span = self.acting(equations, speed, factor)
        q, status = equilibrium(equations, hub, tip, span)
        # Nothing holds a free hinge in the axis of rotation, and linear theories bend without end.
        near = jnp.max(jnp.abs(equations.tip(q))) < 10 * equations.length  # NaN is not
        nowhere = Status.NOT_HELD if is_hinged(rotor) else Status.DIVERGED
        status = first_failure(status, first_broken((near, nowhere)))
        still = jnp.zeros_like(q)
        k, c = equations.tangents(hub, q, still, tip)
        if span is not None and span.stiffness is not None:
            k = k + span.stiffness
        scale = equations.as_force(q, jnp.ones_like(q))[:, None]
        rates = self.damping.mass_coefficient, self.damping.stiffness_coefficient
        damping = None
        if rates != (None, None):
            damping = dense(equations.damping_tangents(q, still, *rates)[1]) / scale
        return LinearSystem(
            mass=dense(equations.mass) / scale,
            gyroscopic=dense(c) / scale,
            stiffness=dense(k) / scale,
            steady_strain=steady_strain(rotor, speed, equations, q),
            status=status,
            directions=model.directions,
            coupling=_ALL,
            shapes=equations.functions,
            damping=damping,
            general=True,
            conservative=self.loads.is_plain and damping is None,
        )


def equations_under(model: AbstractModel, rotor: AnyRotor, loads: Loads) -> Equations:
    """Equations of motion, if they can bear what is at the tip."""
    equations = model.equations(rotor)
    if loads.is_plain or equations.takes_moments:
        return equations
    name = "follows" if loads.tip_moment is None else "tip_moment"
    raise ValueError(
        f"loads.{name}: {type(model).__name__} takes a force in hub axes alone at its tip; "
        "take jaxbeam.SpatialANCF, or leave it out"
    )


def acting_on(equations: Equations, loads: Loads, t: Scalar) -> tuple[Any, SpanForce | None]:
    """What acts at the tip, and along the span, at time t."""
    if loads.force_per_length is None:
        return loads.at_tip(t), None
    spread = equations.spread(loads.kinks)
    density: Any = loads.along_span(t, spread.points[0])
    return loads.at_tip(t), spread.acting(density)


def checked_damping(damping: Any) -> Damping:
    """The argument, if it is a damping."""
    if not isinstance(damping, Damping):
        raise TypeError(f"damping must be of class Damping, got {kind_of(damping)}")
    return damping


def checked_conditions(loads: Any, damping: Any) -> Conditions | None:
    """Loads and damping, if they are what a beam can turn steadily under; None where there are
    none."""
    if not isinstance(loads, Loads):
        raise TypeError(f"loads must be of class Loads, got {kind_of(loads)}")
    checked_damping(damping)
    for name in ("tip_force", "tip_moment", "force_per_length"):
        if callable(getattr(loads, name)):
            raise ValueError(
                f"loads.{name} must be constant for a steady state: got a function of time"
            )
    if loads.are_none:
        loads = NO_LOADS
    if loads is NO_LOADS and damping.mass_coefficient is damping.stiffness_coefficient is None:
        return None
    return Conditions(loads, damping)


def system_of(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, conditions: Conditions | None
) -> LinearSystem:
    """Matrices of small motion under conditions, if there are any."""
    if conditions is None:
        return model.matrices(rotor, speed)
    return conditions.system(model, rotor, speed)


def guarded_conditions(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, conditions: Conditions | None
) -> tuple[Code, AnyRotor, Scalar, Conditions | None]:
    """Whether all is in range, under conditions if there are any, and harmless numbers in the place
    of those that are not."""
    given, rotor, speed = guarded(rotor, speed)
    if conditions is None:
        return given, rotor, speed, None
    status = conditions.status(model, speed)
    fine = status == Status.OK
    held = jax.tree.map(lambda leaf: jnp.where(fine, leaf, 0.0), conditions)
    return first_failure(given, status), rotor, speed, held
