"""Force and moment in sections, from equilibrium of all that is outboard of them.

What a section bears is what acts beyond it: the inertia of the beam in any motion of it and of its
hub, gravity, forces along the span, and at the tip a load and the inertia of a mass or a body, all
of it where the deformed beam is. So section forces are as accurate as displacements. The stiffness
times the curvature of the model, which is a second derivative, is much less so: by 8 elements 0.6
and 1.8 % low at the root of a blade that loads bend, where equilibrium is 1e-6 off.
"""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.rotary import SecondMoments, of_sections
from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._models.contract.equations import Equations
from jaxbeam._rotor.beam import AnyRotor, Rotor
from jaxbeam._rotor.loads import Loads
from jaxbeam._rotor.motion import Hub, cross
from jaxbeam._rotor.span import Span, on
from jaxbeam._types import Coordinates, Number, Scalar, Triple, Vector

_POINTS = 16  # Gauss points of each piece: exact for products of three cubics and a line
_Rows = Float[Array, "p 3"]


class Environment(NamedTuple):
    """Motion of the hub, loads and damping of a beam at time t."""

    hub: Hub
    loads: Loads
    t: Scalar
    damping: Drag = Drag()

    @property
    def drag(self) -> Number | None:
        """Damping in proportion to inertia, 1/s."""
        return self.damping.mass_coefficient


class Moved(NamedTuple):
    """Coordinates of a beam in motion, velocities, and rates of velocities."""

    q: Coordinates
    v: Vector
    a: Vector


def section_loads(
    rotor: AnyRotor | None, equations: Equations, outside: Environment, moved: Moved, xi: np.ndarray
) -> tuple[Float[Array, "p 3"], Float[Array, "p 3"]]:
    """Force (N) and moment (N m) on sections at x = xi L by the beam outboard of them, in their
    axes: the tangent and the two other axes of `Equations.section_axes`. Moments are that about the
    tangent (torsion), that about the third axis (bending in plane), and minus that about the second
    axis (bending in flap).

    Raises `ValueError` for a beam that has no sections.
    """
    if not isinstance(rotor, Rotor):
        raise ValueError(
            "section_force and section_moment are of beams that have sections, and a SpringRotor "
            "has none: ask for hub_force and hub_torque"
        )
    beam, q = rotor.beam, moved.q
    own = equations.own_section_loads(q, moved.v, xi, outside)
    if own is not None:
        return own
    edges = sorted({*equations.pieces, *beam.edges, *outside.loads.kinks})
    span = Span.between(tuple(edges), _POINTS)
    force, couple = _along(rotor, equations, outside, moved, span)
    tip_force, tip_moment = _at_tip(rotor, equations, outside, moved)
    # Moments are taken about the tip: those near it would else be small differences of large ones.
    end = equations.undeformed.tip + equations.tip(q)
    arm = equations.placed(q, span) - end[None]
    each = jnp.concatenate([force, couple + jnp.cross(arm, force)], 1)
    beyond = span.interpolated(span.beyond(each), xi)
    force = tip_force[None] + beyond[:, :3]
    here = equations.undeformed_at(xi) + equations.displacement(q, xi)
    moment = tip_moment[None] + beyond[:, 3:] + jnp.cross(end[None] - here, force)
    axes = equations.section_axes(q, xi)
    force, (twist, lowering, lag) = (
        jnp.einsum("pkc,pc->pk", axes, force),
        jnp.einsum("pkc,pc->kp", axes, moment),
    )
    return force, jnp.stack([twist, lag, -lowering], 1)


def _along(
    rotor: Rotor, equations: Equations, outside: Environment, moved: Moved, span: Span
) -> tuple[_Rows, _Rows]:
    """Force (N) and couple (N m) by x / L at the points of a span: inertia, damping and loads."""
    (hub, loads, t, _), drag, (q, v, a) = outside, outside.drag, moved
    beam, xi = rotor.beam, np.asarray(span.xi)
    mass = (beam.length * on(beam.mass_with_points, span))[:, None]

    def speed(q: Coordinates, v: Vector) -> _Rows:
        return jax.jvp(lambda q: equations.placed(q, span), (q,), (v,))[1]

    def velocity(q: Coordinates, v: Vector, velocity: Triple, spin: Triple) -> _Rows:
        return velocity[None] + jnp.cross(spin[None], equations.placed(q, span)) + speed(q, v)

    moving, rate = jax.jvp(velocity, (q, v, *_velocities(hub)), (v, a, *_rates(hub)))
    force = -mass * (rate + jnp.cross(hub.angular_velocity[None], moving))
    if drag is not None:
        force = force - drag * mass * speed(q, v)
    density = loads.along_span(t, xi, beam.length)
    if density is not None:
        force = force + beam.length * density
    return force, _turned(rotor, equations, outside, moved, span)


def _turned(
    rotor: Rotor, equations: Equations, outside: Environment, moved: Moved, span: Span
) -> _Rows:
    """Couple (N m) by x / L at the points of a span by the rotary inertia of sections."""
    hub, (q, v, a) = outside.hub, moved
    moments = of_sections(rotor, functools.partial(on, span=span))
    none = jnp.zeros((len(np.asarray(span.xi)), 3), q.dtype)
    if moments is None:
        return none
    moments = SecondMoments(*(None if e is None else rotor.beam.length * e for e in moments))

    def momentum(q: Coordinates, v: Vector, spin: Triple) -> _Rows:
        own = equations.section_momentum(q, v, spin, span, moments)
        return none if own is None else own

    spin = hub.angular_velocity
    h, rate = jax.jvp(momentum, (q, v, spin), (v, a, hub.angular_velocity_rate))
    couple = -rate - jnp.cross(spin[None], h)
    return couple if outside.drag is None else couple - outside.drag * momentum(q, v, 0 * spin)


def _at_tip(
    rotor: Rotor, equations: Equations, outside: Environment, moved: Moved
) -> tuple[Triple, Triple]:
    """Force at the tip, and moment about it, by inertia, damping and load of the mass or body
    there."""
    (hub, loads, t, _), drag, (q, v, a) = outside, outside.drag, moved
    body = rotor.tip_body

    def momenta(q: Coordinates, v: Vector, velocity: Triple, spin: Triple) -> tuple[Triple, Triple]:
        def energy(velocity: Triple, spin: Triple) -> Number:
            return equations.tip_energy(body, q, v, velocity, spin)

        return jax.grad(energy, (0, 1))(velocity, spin)

    (p, h), (dp, dh) = jax.jvp(momenta, (q, v, *_velocities(hub)), (v, a, *_rates(hub)))
    spin = hub.angular_velocity
    force, moment = -dp - cross(spin, p), -dh - cross(spin, h) - cross(hub.velocity, p)
    if drag is not None:
        still = jnp.zeros_like(spin)
        p, h = momenta(q, v, still, still)
        force, moment = force - drag * p, moment - drag * h
    end = equations.undeformed.tip + equations.tip(q)
    moment = moment - cross(end, force)
    load = loads.at_tip(t)
    if load is None:
        return force, moment
    push, couple = equations.tip_action(q, load)
    return force + push, moment + couple


def _velocities(hub: Hub) -> tuple[Triple, Triple]:
    return hub.velocity, hub.angular_velocity


def _rates(hub: Hub) -> tuple[Triple, Triple]:
    """Rates of the velocities of the hub, gravity being an acceleration the other way."""
    return hub.velocity_rate - hub.gravity, hub.angular_velocity_rate
