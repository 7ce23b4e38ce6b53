"""Small motion about the state that loads deform, with damping."""

from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import kind_of
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.drag import drag_of
from jaxbeam._models.contract.equations import Equations, Inputs, forces_are_resolved
from jaxbeam._models.contract.equilibrium import Rest
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.contract.small_motion import guarded, small_motion
from jaxbeam._models.contract.span_integrals import AbstractSpanForce, AbstractSpanIntegral
from jaxbeam._models.contract.supports import check_supported
from jaxbeam._results import harmless
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping, damping_in_range
from jaxbeam._rotor.directions import ALL_COUPLED, Direction
from jaxbeam._rotor.first_look import refuse, rests_in_hub, stays_in_plane
from jaxbeam._rotor.loads import NO_LOADS, Loads, loads_in_range
from jaxbeam._rotor.motion import spinning
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Scalar

Held = TypeVar("Held", bound="Conditions | None")


class Conditions(eqx.Module):
    """Conditions of steady rotation: loads that are constant in the hub, and damping."""

    loads: Loads
    damping: Damping

    def status(self, model: AbstractModel, rotor: AnyRotor, speed: Scalar) -> Code:
        """The status of loads and damping: whether they are in range, and gravity is constant in
        the hub."""
        loads, none = self.loads, jnp.zeros(3, speed.dtype)
        gravity = none if loads.gravity is None else loads.gravity
        tip, span = loads.at_tip(none[0]), loads.span_moments(none[0], rotor.length)
        finite, planar = loads_in_range(gravity, -gravity, tip, span)
        return first_broken(
            (finite, Status.INVALID_LOAD),
            (damping_in_range(self.damping), Status.INVALID_DAMPING),
            ((speed == 0) | jnp.all(gravity[:2] == 0), Status.TURNING_GRAVITY),
            (planar | (Direction.FLAP in model.directions), Status.OUT_OF_PLANE),
        )

    def state(self, model: AbstractModel, rotor: AnyRotor, speed: Scalar) -> Rest:
        """Coordinates of the steady state, and the status of the search for it."""
        equations = equations_under(model, rotor, self.loads)
        return held_at_rest(rotor, equations, self.inputs(equations, speed))

    def inputs(self, equations: Equations, speed: Scalar, factor: Scalar | None = None) -> Inputs:
        """The steady motion of the hub with gravity, the load at the tip and the force along the
        span; all loads times `factor`."""
        hub, loads = spinning(speed), loads_at(equations, self.loads, jnp.zeros_like(speed))
        gravity = hub.gravity if self.loads.gravity is None else self.loads.gravity
        if factor is not None:
            gravity, loads = jax.tree.map(lambda part: factor * part, (gravity, loads))
        return hub._replace(gravity=gravity), *loads

    def system(
        self, model: AbstractModel, rotor: AnyRotor, speed: Scalar, factor: Scalar | None = None
    ) -> LinearSystem:
        """Matrices of small motion about the steady state under the loads times `factor`, for
        parameters in range."""
        equations = equations_under(model, rotor, self.loads)
        inputs = self.inputs(equations, speed, factor)
        state = resting(rotor, equations, inputs)
        damping, drag = None, drag_of(self.damping, model, rotor, equations)
        if not drag.is_none:
            damping = equations.damping_matrix_about(state.q, drag)
        return small_motion(
            model, rotor, speed, equations, state, inputs,
            coupling=ALL_COUPLED, state=state.q, damping=damping, general=True,
            conservative=self.loads.has_potential and damping is None,
        )  # fmt: skip


def held_at_rest(rotor: AnyRotor, equations: Equations, inputs: Inputs) -> Rest:
    """The state of `resting`, with `NOT_HELD` where the beam could as well rest elsewhere, and
    `TOO_FEW_FUNCTIONS` where functions are not enough for the forces in it."""
    state = resting(rotor, equations, inputs)
    stiff = equations.is_held(state)
    held = first_broken((True if stiff is None else stiff, Status.NOT_HELD))
    few = first_broken(
        (forces_are_resolved(equations.high_share(state.q)), Status.TOO_FEW_FUNCTIONS)
    )
    return state._replace(status=first_failure(held, state.status, few))


def resting(rotor: AnyRotor, equations: Equations, inputs: Inputs) -> Rest:
    """Coordinates at which the beam rests in its hub, and the status of the search, which also
    fails where the tip is displaced by more than ten lengths."""
    state = equations.equilibrium(*inputs)
    # On a free hinge in the axis of rotation a linear theory may deflect without bound.
    near = jnp.max(jnp.abs(equations.tip(state.q))) < 10 * equations.length  # false for NaN
    sprung = jnp.asarray(True)
    if rotor.root_springs is not None:
        sprung = jnp.all(jnp.stack([k != 0 for k in rotor.springs if k is not None]))
    far = first_broken((near | sprung, Status.NOT_HELD), (near, Status.DIVERGED))
    return state._replace(status=first_failure(state.status, far))


def equations_under(model: AbstractModel, rotor: AnyRotor, loads: Loads) -> Equations:
    """Equations of motion of a model that must know the loads; raises `ValueError` otherwise."""
    check_supported(model, rotor, loads)
    return model.equations(rotor)


class SpanLoad(eqx.Module):
    """A force along the span in the equations of one beam."""

    integral: AbstractSpanIntegral
    density: Callable[[Scalar], Float[Array, "p 3"]]  # the force at the points of integration, N/m

    @classmethod
    def of(cls, equations: Equations, loads: Loads) -> "SpanLoad | None":
        """The force along the span of some loads; None without one."""
        if not loads.act_along_span:
            return None
        integral = equations.span_integral(loads.kinks, loads.follows)
        places = tuple(integral.points[0].tolist())
        return cls(integral, _Density(loads, integral.pace(equations.length), places))

    def __call__(self, t: Scalar) -> AbstractSpanForce:
        """The generalised force of the force along the span at time t."""
        return self.integral.generalised_force(self.density(t))


class _Density(eqx.Module):
    """The force per length, in N/m, at places x / L as a function of time."""

    loads: Loads
    pace: Any  # derivative of arc length by x / L, m
    xi: tuple[float, ...] = eqx.field(static=True)

    def __call__(self, t: Scalar) -> Float[Array, "p 3"]:
        density: Any = self.loads.along_span(t, np.array(self.xi), self.pace)
        return density


def loads_at(equations: Equations, loads: Loads, t: Scalar) -> tuple[Any, AbstractSpanForce | None]:
    """The loads at the tip and along the span at time t."""
    span = SpanLoad.of(equations, loads)
    return loads.at_tip(t), None if span is None else span(t)


def checked_damping(damping: Any, case: tuple[AbstractModel, AnyRotor] | None = None) -> Damping:
    """The argument, if it is a `Damping` and the model and rotor of a `case` know it; raises
    otherwise."""
    if not isinstance(damping, Damping):
        raise TypeError(f"damping must be of class Damping, got {kind_of(damping)}")
    if case is not None:
        check_supported(*case, damping=damping)
    return damping


def checked_conditions(
    loads: Any, damping: Any, case: tuple[AbstractModel, AnyRotor] | None = None,
    speeds: Iterable[Any] = (), throw: bool = False,
) -> Conditions | None:  # fmt: skip
    """Loads and damping as `Conditions`; None where there are none.

    Raises for arguments of other kinds, loads that depend on time, and features that the model of a
    `case`, a model and a rotor, does not know; with `throw` also for concrete numbers that cannot
    be right at `speeds` (see `first_look.py`).
    """
    if not isinstance(loads, Loads):
        raise TypeError(f"loads must be of class Loads, got {kind_of(loads)}")
    checked_damping(damping)
    given = {name: getattr(loads, name) for name in ("tip_force", "tip_moment", "force_per_length")}
    if loads.point_forces is not None:
        given["point_forces.forces"] = loads.point_forces.forces
    for name, part in given.items():
        if callable(part):
            raise ValueError(
                f"loads.{name} must be constant for a steady state: got a function of time"
            )
    if loads.are_none:
        loads = NO_LOADS
    if loads is NO_LOADS and damping.are_none:
        return None
    if case is not None:
        model, rotor = case
        check_supported(model, rotor, loads, damping)
        planar = Direction.FLAP in model.directions or stays_in_plane(loads)
        refuse(
            throw,
            (rests_in_hub(loads, speeds), Status.TURNING_GRAVITY),
            (planar, Status.OUT_OF_PLANE),
        )
    return Conditions(loads, damping)


def checked_potential(
    loads: Any, case: tuple[AbstractModel, AnyRotor], throw: bool
) -> Conditions | None:
    """Loads without damping as `Conditions`, for a model and a rotor that turns; None without
    loads. Raises `ValueError` for loads that have no potential."""
    conditions = checked_conditions(loads, NO_DAMPING, case, (1.0,), throw)
    if loads.has_potential:
        return conditions
    raise ValueError(
        f"{loads.features[0]}: a moment, or a force that turns with the beam, has no "
        "potential; leave it out, or take jaxbeam.modes at the speeds that matter, whose "
        "frequencies and growth rates tell"
    )


def system_of(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, conditions: Conditions | None
) -> LinearSystem:
    """Matrices of small motion about steady rotation, under conditions or, with None, without."""
    if conditions is None:
        return model.matrices(rotor, speed)
    return conditions.system(model, rotor, speed)


def guarded_conditions(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, conditions: Held
) -> tuple[Code, AnyRotor, Scalar, Held]:
    """The status of rotor, speed and conditions, and these with harmless numbers where they are not
    in range."""
    given, rotor, speed = guarded(rotor, speed)
    if conditions is None:
        return given, rotor, speed, conditions
    status = conditions.status(model, rotor, speed)
    held = harmless(status == Status.OK, conditions)
    return first_failure(given, status), rotor, speed, held
