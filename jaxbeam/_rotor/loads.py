"""Loads on the beam: gravity, force and moment at the tip, forces along the span and on points."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import (
    check_all,
    check_kind,
    is_there,
    kind_of,
    shaped_array,
    traceable,
)
from jaxbeam._results import replaced
from jaxbeam._rotor.clock import Clock, Later
from jaxbeam._rotor.motion import (
    Times,
    check_function_of_time,
    function_of_time,
    no_times,
    time_list,
)
from jaxbeam._rotor.points import PointForces
from jaxbeam._rotor.span import Span
from jaxbeam._rotor.spanwise import AbstractSpanwise, along, points_within, samples, taken
from jaxbeam._status import Status
from jaxbeam._types import Number, Scalar, Triple

_POINTS = 8  # points of each segment between kinks at which loads along the span are checked
TipPart = Triple | Callable[[Scalar], Triple] | None


class TipLoad(eqx.Module):
    """A force (N) and a moment (N m) at the tip, in hub axes or, if it `follows`, in axes of the
    section there: the tangent, and a2 and a3 turned by the least rotation from a1 to the tangent
    and by the twist."""

    force: Triple
    moment: Triple
    follows: bool = eqx.field(static=True)


def bending(load: Triple | TipLoad, length: Scalar) -> Float[Array, "2"]:
    """Moments about the root, in plane and in flap, in N m, of a load at the tip of a straight
    beam."""
    if not isinstance(load, TipLoad):
        return length * load[1:]
    _, lowering, in_plane = load.moment
    return length * load.force[1:] + jnp.stack([in_plane, -lowering])


class Loads(eqx.Module):
    """External loads, none by default.

    | field            | unit  |                                                                 |
    |------------------|-------|-----------------------------------------------------------------|
    | gravity          | m/s^2 | shape (3,), in inertial axes: those of the hub at angle zero    |
    | tip_force        | N     | shape (3,) or a function of time to (3,), in hub axes: a1 to a3 |
    | changes          | s     | shape (k,): when a load begins or ends something smoothly       |
    | jumps            | s     | shape (j,): when it jumps                                       |
    | tip_moment       | N m   | as `tip_force`; models in space alone bear it                   |
    | follows          |       | whether forces and moment turn with the sections where they     |
    |                  |       | act, as that of a thruster and a pressure do: then their axes   |
    |                  |       | are those of the section (see `TipLoad`); models in space alone |
    | force_per_length | N/m   | along the span, by the unstretched length, in hub axes: three   |
    |                  |       | of them, each a number, a `Spanwise` or a `SpanwiseFunction`;   |
    |                  |       | or a function of time to three such; integrated with six points |
    |                  |       | of each element or as products of functions, and between kinks  |
    | point_forces     | N     | `PointForces`: of struts, wires and brakes between the ends     |

    A force along the beam stiffens it in tension and softens it in compression in every model
    that knows of `Rotor.tension`. A callable that is a pytree carries its parameters as leaves.
    Steps end at the times declared; a pulse that is shorter than a thousandth of a run may be
    passed over if it is not declared.

    Raises `TypeError` or `ValueError` for an argument of another kind or shape, and `ValueError`
    for known numbers that are not finite.
    """

    gravity: Triple | None
    tip_force: TipPart
    tip_moment: TipPart
    force_per_length: Any  # three numbers or `Spanwise`, a function of time to such, or None
    point_forces: PointForces | None
    changes: Times | None
    jumps: Float[Array, " j"] | None
    follows: bool = eqx.field(static=True)

    def __init__(
        self, gravity: Any = None, tip_force: Any = None, changes: Any = (), jumps: Any = (),
        *, tip_moment: Any = None, follows: bool = False, force_per_length: Any = None,
        point_forces: PointForces | None = None,
    ) -> None:  # fmt: skip
        check_kind("point_forces", point_forces, PointForces, type(None))
        self.point_forces = point_forces
        # None and not empty arrays, so that `NO_LOADS` starts no backend of JAX.
        self.changes = time_list("changes", changes) if is_there(changes) else None
        self.jumps = time_list("jumps", jumps) if is_there(jumps) else None
        self.gravity = None if gravity is None else _triple("gravity", gravity)
        self.tip_force = _at_any_time("tip_force", tip_force)
        self.tip_moment = _at_any_time("tip_moment", tip_moment)
        self.force_per_length = _along_span(force_per_length)
        if not isinstance(follows, bool):
            raise TypeError(f"follows must be True or False, got {kind_of(follows)}")
        self.follows = follows

    @property
    def are_none(self) -> bool:
        """Whether there are no loads."""
        parts = self.gravity, self.tip_force, self.tip_moment
        return not self.act_along_span and all(part is None for part in parts)

    @property
    def act_along_span(self) -> bool:
        """Whether there are forces along the span or on points of it."""
        return not (self.force_per_length is self.point_forces is None)

    @property
    def turns(self) -> bool:
        """Whether some load turns with the sections."""
        parts = self.tip_force, self.tip_moment, self.force_per_length, self.point_forces
        return self.follows and any(part is not None for part in parts)

    @property
    def has_potential(self) -> bool:
        """Whether all loads have a potential in the hub: forces in hub axes, no moments."""
        return self.tip_moment is None and not self.turns

    @property
    def features(self) -> tuple[str, ...]:
        """The features that a model has to know, beyond gravity and a force at the tip in hub
        axes."""
        along_span = self.force_per_length, self.point_forces
        present = self.tip_moment is not None, self.turns, *(x is not None for x in along_span)
        names = "tip_moment", "follows", "force_per_length", "point_forces"
        return tuple(f"loads.{name}" for name, it in zip(names, present, strict=True) if it)

    def at_tip(self, t: Scalar) -> Triple | TipLoad | None:
        """The load at the tip at time t: a force in hub axes alone as (3,), else a `TipLoad`; None
        where there is none."""
        force, moment = (
            jnp.asarray(part(t)) if callable(part) else part
            for part in (self.tip_force, self.tip_moment)
        )
        if moment is None and not (self.follows and force is not None):
            return force
        zero = jnp.zeros(3, t.dtype)
        return TipLoad(
            zero if force is None else force, zero if moment is None else moment, self.follows
        )

    @property
    def kinks(self) -> tuple[float, ...]:
        """The x / L at which forces along the span are not smooth."""
        parts = self.force_per_length
        if callable(parts):
            now = jax.ShapeDtypeStruct((), jnp.result_type(float))
            parts = eqx.filter_eval_shape(lambda t: tuple(self.force_per_length(t)), now)
        varying = [part for part in parts or () if isinstance(part, AbstractSpanwise)]
        kinks = {kink for part in varying for kink in part.kinks}
        if self.point_forces is not None:
            kinks |= set(self.point_forces.boxes.kinks)
        return tuple(sorted(kinks))

    def along_span(
        self, t: Scalar, xi: Float[np.ndarray, " p"], length: Number
    ) -> Float[Array, "p 3"] | None:
        """The force per length at time t and places x / L, none of which is a kink, of a beam of
        this length."""
        parts, points = self.force_per_length, self.point_forces
        out = None if points is None else points.along_span(t, xi, length)
        if parts is None:
            return out
        parts = parts(t) if callable(parts) else parts
        spread = jnp.stack([along(part, xi) for part in parts], 1)
        return spread if out is None else spread + out

    def span_moments(self, t: Scalar, length: Number) -> Float[Array, "3 3"] | None:
        """Integrals int f dx, int (x / L) f dx and int abs(f) dx of the force per length f, in N.
        The last one is a scale also where forces balance each other."""
        xi, weight = points_within((0.0, *self.kinks, 1.0))
        force = self.along_span(t, xi, length)
        if force is None:
            return None
        sums = jnp.stack([weight, weight * xi]) @ force
        return length * jnp.concatenate([sums, (weight @ jnp.abs(force))[None]])

    def since(self, origin: Scalar) -> "Loads":
        """Loads as functions of the time since `origin` (s), as in `Motion.since`."""
        clock, parts = Clock(origin, self.jump_times()), dict[str, Any]()
        for name in ("tip_force", "tip_moment", "force_per_length"):
            if callable(part := getattr(self, name)):
                parts[name] = Later(part, clock)
        if self.point_forces is not None:
            parts["point_forces"] = self.point_forces.since(clock)
        for name in ("changes", "jumps"):
            if (times := getattr(self, name)) is not None:
                parts[name] = times - origin
        return replaced(self, **parts)

    def change_times(self) -> Times:
        """The times that were given as `changes`."""
        return no_times() if self.changes is None else self.changes

    def jump_times(self) -> Times:
        """The times that were given as `jumps`."""
        return no_times() if self.jumps is None else self.jumps


def _at_any_time(name: str, value: Any) -> TipPart:
    if callable(value):
        check_function_of_time(name, value, (3,))
        return function_of_time(value)
    return None if value is None else _triple(name, value)


def _along_span(value: Any) -> Any:
    name = "force_per_length"
    if value is None:
        return None
    if callable(value):
        value = function_of_time(value)

        def parts(t: Scalar) -> tuple[Any, ...]:
            with traceable(name):
                return _three(name, value(t))

        eqx.filter_eval_shape(parts, jax.ShapeDtypeStruct((), jnp.result_type(float)))
        return value
    given = tuple(taken(name, part, True) for part in _three(name, value))
    for part in given:
        check_all(Status.INVALID_LOAD, samples(part))
    return given


def _three(name: str, value: Any) -> tuple[Any, ...]:
    """The three components of a force per length, as a tuple; raises `ValueError` for others."""
    given = tuple(value) if hasattr(value, "__len__") or hasattr(value, "__iter__") else (value,)
    if len(given) != 3:
        raise ValueError(
            f"{name} must have three parts, along a1, a2 and a3, each a number, a Spanwise or a "
            f"SpanwiseFunction, got {len(given)}"
        )
    return given


def _triple(name: str, value: Any) -> Triple:
    vector = shaped_array(name, value, (3,))
    check_all(Status.INVALID_LOAD, vector)
    return vector


def in_plane(stray: Array, kept: Array) -> Array:
    """Whether components `stray` out of the plane of rotation are rounding beside those `kept`."""
    return jnp.all(jnp.abs(stray) <= 1e-9 * jnp.abs(kept))


def loads_in_range(
    gravity: Triple, push: Triple, tip: Any, span: Float[Array, "3 3"] | None
) -> tuple[Array, Array]:
    """Whether all loads are finite, and whether all are in plane: gravity, acceleration of the hub
    less gravity `push`, load at the `tip`, and along the `span` as of `Loads.span_moments`."""
    along = jnp.zeros((3, 3), gravity.dtype) if span is None else span
    given = jnp.concatenate([jnp.stack([gravity, *jax.tree.leaves(tip)]), along])
    # Loads at the tip with moments or turning are for models in space, where no plane matters.
    force = tip if isinstance(tip, Array) else jnp.zeros(3, gravity.dtype)
    each = jnp.stack([push, force, along[2]])
    stray, kept = each[:, 2], jnp.max(jnp.abs(each), 1)
    return jnp.all(jnp.isfinite(given)), in_plane(stray, kept)


def are_along(loads: Loads, length: Number) -> Array:
    """Whether all of some constant loads act along the undeformed beam, of this length."""
    span = Span.between((0.0, *loads.kinks, 1.0), _POINTS)
    density = loads.along_span(jnp.zeros(()), span.xi, length)
    given: list[Any] = [loads.gravity, loads.tip_force, density]
    rows = [jnp.atleast_2d(part) for part in given if part is not None]
    fine = [in_plane(jnp.abs(row[:, 1:]), jnp.max(jnp.abs(row))) for row in rows]
    return jnp.all(jnp.stack(fine))


def only_pull(loads: Loads, length: Scalar) -> Array:
    """Whether constant loads are tension in every section of a straight beam of this length: then
    no multiple of them buckles it."""
    span = Span.between((0.0, *loads.kinks, 1.0), _POINTS)
    force = jnp.zeros(span.xi.size + 1, length.dtype)
    density = loads.along_span(jnp.zeros_like(length), span.xi, length)
    if density is not None:
        along = density[:, 0]
        force = length * jnp.append(span.beyond(along), span.total(along))
    tip: Any = loads.tip_force
    if tip is not None:
        force = force + tip[0]
    compresses = jnp.asarray(False) if loads.gravity is None else loads.gravity[0] < 0
    return are_along(loads, length) & loads.has_potential & jnp.all(force >= 0) & ~compresses


NO_LOADS = Loads()  # the default of public functions
