"""Rotary inertia: what mass off the axis does where sections turn, to second order in slopes.

A section, or a rigid body at the tip, carries three directors: d1 along the beam and d2, d3 across,
a1, a2 and a3 at rest. A beam that does not twist turns it to the tangent by the least rotation, and
then about that by phi = int (e2 e3' - e3 e2') dx / 2, with slopes e2 and e3, rates along x. So they
are

    d1 = (1 - (e2^2 + e3^2) / 2) a1 + e2 a2 + e3 a3
    d2 = -e2 a1 + (1 - e2^2 / 2) a2 + (phi - e2 e3 / 2) a3
    d3 = -e3 a1 - (phi + e2 e3 / 2) a2 + (1 - e3^2 / 2) a3

and with second moments E_kl = int y_k y_l dm of its mass in these axes it has the kinetic energy
sum E_kl (d_k' + omega x d_k).(d_l' + omega x d_l) / 2 (rates in time). Mass along the beam, E_11, a
body alone has. As displacements, directors are linear in theories of first order, which leave out
what is of second order here.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.loads import in_beam_axes, section_angle
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.ends import TipBody
from jaxbeam._rotor.span import section_inertia
from jaxbeam._rotor.spanwise import Property, along

_Square = Float[Array, "3 3 *#lanes"]


class SecondMoments(NamedTuple):
    """Second moments E_kl of mass in axes of the beam; None for zero."""

    along: Any  # E_11
    lag: Any  # E_22
    flap: Any  # E_33
    crossed: Any  # E_23

    @property
    def rigid(self) -> Any:
        """The matrix of moments of inertia tr(E) - E, of mass with these second moments E."""
        one, two, three, crossed = (0.0 if e is None else e for e in self)
        none = jnp.zeros_like(two)
        rows = [[two + three, none, none], [none, one + three, -crossed + none],
                [none, -crossed + none, one + two]]  # fmt: skip
        return jnp.stack([jnp.stack(row) for row in rows])


def of_sections(rotor: Rotor, at: Callable[[Property], Any]) -> SecondMoments | None:
    """Second moments of sections per length, in kg m, at places where `at` gives the values of a
    property; None where sections have no rotary inertia."""
    both = section_inertia(rotor.beam, at)
    if both is None:
        return None
    angle = section_angle(rotor, at)
    axes = None if angle is None else (jnp.cos(angle), jnp.sin(angle))
    (lag, flap), crossed = in_beam_axes(*both, axes)
    return SecondMoments(None, lag, flap, crossed)


def of_body(rotor: Rotor) -> SecondMoments | None:
    """Second moments of a body at the tip, in kg m^2; None for a point mass."""
    body = rotor.tip_body
    if not isinstance(body, TipBody):
        return None
    in_plane, about = body.inertia, body.axial_inertia
    up = in_plane if body.flap_inertia is None else body.flap_inertia
    alike = (in_plane + up - about) / 2
    if body.flap_inertia is None:
        return SecondMoments(alike, in_plane - alike, up - alike, None)
    angle = section_angle(rotor, lambda angle: along(angle, np.ones(1))[0])
    axes = None if angle is None else (jnp.cos(angle), jnp.sin(angle))
    (lag, flap), crossed = in_beam_axes(in_plane - alike, up - alike, axes)
    return SecondMoments(alike, lag, flap, crossed)


def first_order(b: _Square) -> tuple[Array, ...]:
    """Coefficients (2, 2), by products of slopes in plane and in flap, of each E_kl in sum E_kl
    d_k.B d_l with directors to first order. B is 1 for the mass, 2 omega~ for Coriolis forces and
    omega~ omega~ + omega'~ for the other inertia forces."""
    one, none = b[0, 0], jnp.zeros_like(b[0, 0])
    return (
        b[1:, 1:],
        _square(one, none, none, none),
        _square(none, none, none, one),
        _square(none, one, one, none),
    )


def second_order(b: _Square) -> tuple[Array, ...]:
    """Twice the coefficients (2, 2), by products of slopes, of each E_kl in sum E_kl d_k.B a_l with
    the terms of d_k of second order in slopes."""
    none, mixed = jnp.zeros_like(b[0, 0]), -(b[1, 1] + b[2, 2]) / 2
    return (
        _square(-b[0, 0], none, none, -b[0, 0]),
        _square(-b[1, 1], -b[2, 1] / 2, -b[2, 1] / 2, none),
        _square(none, -b[1, 2] / 2, -b[1, 2] / 2, -b[2, 2]),
        _square(-b[1, 2], mixed, mixed, -b[2, 1]),
    )


def by_winding(b: _Square) -> Float[Array, "3 *#lanes"]:
    """Coefficients, by the turn phi, of E_22, E_33 and E_23 in sum E_kl d_k.B a_l."""
    return jnp.stack([b[2, 1], -b[1, 2], b[2, 2] - b[1, 1]])


def constant(b: _Square) -> Float[Array, "4 2 *#lanes"]:
    """Coefficients, by slopes in plane and in flap, of each E_kl in sum E_kl d_k.B a_l."""
    none = jnp.zeros_like(b[0, 0])
    rows = [[b[1, 0], b[2, 0]], [-b[0, 1], none], [none, -b[0, 2]], [-b[0, 2], -b[0, 1]]]
    return jnp.stack([jnp.stack(row) for row in rows])


def directors(e2: Array, e3: Array, phi: Array | None) -> Float[Array, "3 3 p"]:
    """The three directors as rows, from slopes e2 and e3 and the turn phi; with None to first
    order."""
    one, none = jnp.ones_like(e2), jnp.zeros_like(e2)
    rows = [[one, e2, e3], [-e2, one, none], [-e3, none, one]]
    out = jnp.stack([jnp.stack(row) for row in rows])
    if phi is None:
        return out
    both = e2 * e3 / 2
    rows = [
        [-(e2**2 + e3**2) / 2, none, none],
        [none, -(e2**2) / 2, phi - both],
        [none, -phi - both, -(e3**2) / 2],
    ]
    return out + jnp.stack([jnp.stack(row) for row in rows])


def angular_momentum(
    moments: SecondMoments, d: Array, rate: Array, spin: Array
) -> Float[Array, "p 3"]:
    """Angular momentum sum E_kl d_k x (d_l' + omega x d_l) at each of p points, from directors d
    and their rates."""
    moving = rate + jnp.cross(spin[None, :, None], d, axis=1)
    of = [(0, 0, moments.along), (1, 1, moments.lag), (2, 2, moments.flap)]
    of += [(1, 2, moments.crossed), (2, 1, moments.crossed)]
    parts = [e[None] * jnp.cross(d[k], moving[m], axis=0) for k, m, e in of if e is not None]
    return functools.reduce(jnp.add, parts).T


def _square(a: Array, b: Array, c: Array, d: Array) -> Array:
    return jnp.stack([jnp.stack([a, b]), jnp.stack([c, d])])
