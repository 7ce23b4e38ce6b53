"""How a rigid body at the tip turns, to second order, in Cartesian models.

The section at the tip turns by the vector phi a1 - e3 a2 + e2 a3, e2 and e3 the slopes there, phi =
int (e2 e3' - e3 e2') dx / 2 (rates along x) what it turns about the beam, which does not twist,
beyond the least rotation that brings a1 to the tangent e. So its angular velocity w has, with rates
in time and omega that of the hub,

    w . e = omega . e + phi' - (e2 e3' - e3 e2') / 2

along the beam, and about d2, its axis in plane before it deforms, d2 = (0, c, s), d3 = (0, -s, c),
c = cos(theta) and s = sin(theta) of twist and pitch together, h = c e2 + s e3, g = c e3 - s e2,

    w . d2 = p - (g' + omega_1 h) + r phi - (r g h + p h^2) / 2,   p = omega . d2, r = omega . d3.

Here are J_x (w . e)^2 / 2 and D (w . d2)^2 / 2, D = J_f - J. What a body of no axial inertia, and
of the in-plane one both ways, has besides is J |e' + omega x e|^2 / 2: see `CartesianEquations`.
"""

from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxbeam._models.bases.loads import section_angle
from jaxbeam._models.bases.shapes import Shapes
from jaxbeam._models.modal.shape_integrals import one_hots
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._programs.lanes import matvec_once, pairwise_sum
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.ends import TipBody
from jaxbeam._rotor.motion import Hub
from jaxbeam._rotor.spanwise import along
from jaxbeam._types import Matrix, Number, Triple, Vector


class TipRotation(eqx.Module):
    """The effect of the axial inertia of a body, and of the difference D of the two others.

    All are vectors and matrices of the coordinates q of a model: e2 = slopes[0] . q and so on.
    """

    axial: Number  # J_x, kg m^2
    excess: Number | None  # D, kg m^2; None: both inertias are the same
    first: Triple  # d2
    second: Triple  # d3
    slopes: tuple[Vector, Vector]  # e2, e3
    winding: Matrix | None  # phi = q . winding q / 2; None in a theory of first order

    @classmethod
    def of(cls, rotor: Rotor, body: TipBody, shapes: Shapes, to_second_order: bool) -> Self:
        """The rotation of the body at the tip of a rotor, by the functions along its beam."""
        length = rotor.beam.length
        angle = section_angle(rotor, lambda angle: along(angle, np.ones(1)))
        one_hot = one_hots(shapes.counts)
        zero = jnp.zeros_like(length)
        theta = zero if angle is None else angle[0]
        cos, sin = jnp.cos(theta), jnp.sin(theta)
        lag, flap = (jnp.asarray(shapes.ends.tip_slope * one_hot[:, k]) / length for k in (1, 2))
        return cls(
            axial=body.axial_inertia,
            excess=None if body.flap_inertia is None else body.flap_inertia - body.inertia,
            first=jnp.stack([zero, cos, sin]),
            second=jnp.stack([zero, -sin, cos]),
            slopes=(lag, flap),
            winding=_winding(rotor, shapes) if to_second_order else None,
        )

    @property
    def mass(self) -> Any:
        """The contribution of the body to the mass matrix."""
        return 0.0 if self.excess is None else self.excess * _outer(self._bent[0])

    @property
    def inertia(self) -> Matrix:
        """J_x and D in the moments of inertia of the undeformed beam, kg m^2."""
        about: Any = self.axial * np.diag([1.0, 0.0, 0.0])
        return about if self.excess is None else about + self.excess * _outer(self.first)

    @property
    def _bent(self) -> tuple[Vector, Vector]:
        """The vectors g and h of the docstring of the module."""
        (_, c, s), (lag, flap) = self.first, self.slopes
        return c * flap - s * lag, c * lag + s * flap

    def energy(self, q: Vector, v: Vector, spin: Triple) -> Number:
        """Kinetic energy to second order, without that of the rigid beam."""
        rise, square = self._along(spin)
        out = pairwise_sum(rise * q) + pairwise_sum(q * matvec_once(square, q)) / 2
        if self.winding is not None:
            wound = matvec_once(self.winding - self._swept / 2, v)
            out = out + self.axial * spin[0] * pairwise_sum(q * wound)
        if self.excess is None:
            return out
        g, h = self._bent
        p, rate_about = (
            pairwise_sum(self.first * spin),
            -(pairwise_sum(g * v) + spin[0] * pairwise_sum(h * q)),
        )
        across = pairwise_sum(q * matvec_once(self._across(spin), q))
        own = p * rate_about + rate_about**2 / 2 + p * across / 2
        return out + self.excess * own

    def force(self, hub: Hub, q: Vector, v: Vector) -> Vector:
        """-d/dt dT/dq' + dT/dq, but for what the mass matrix says."""
        stiffness, damping = self.tangents(hub)
        out = self._along(hub.angular_velocity)[0]
        out = out - matvec_once(stiffness, q) - matvec_once(damping, v)
        if self.excess is not None:
            g, h = self._bent
            p, rate = (
                pairwise_sum(self.first * a)
                for a in (hub.angular_velocity, hub.angular_velocity_rate)
            )
            out = out + self.excess * (rate * g - hub.angular_velocity[0] * p * h)
        return out

    def tangents(self, hub: Hub) -> tuple[Matrix, Matrix]:
        """Stiffness and damping by the body: minus the derivatives of `force` by q and q'."""
        spin, rate = hub.angular_velocity, hub.angular_velocity_rate
        stiffness, damping = -self._along(spin)[1], jnp.zeros_like(self._swept)
        if self.winding is not None:
            stiffness = stiffness + self.axial * rate[0] * (self.winding + self._swept / 2)
            damping = damping + self.axial * spin[0] * self._swept
        if self.excess is None:
            return stiffness, damping
        g, h = self._bent
        crossed = g[:, None] * h[None]
        more = rate[0] * crossed - spin[0] ** 2 * _outer(h)
        more = more - pairwise_sum(self.first * spin) * self._across(spin)
        damping = damping + self.excess * spin[0] * (crossed - crossed.swapaxes(0, 1))
        return stiffness + self.excess * more, damping

    @property
    def _swept(self) -> Matrix:
        """e2 e3' - e3 e2' as q . swept q'."""
        lag, flap = self.slopes
        return lag[:, None] * flap[None] - flap[:, None] * lag[None]

    def _along(self, spin: Triple) -> tuple[Vector, Matrix]:
        """First and second derivatives by q of J_x (omega . e)^2 / 2."""
        lag, flap = self.slopes
        along = spin[1] * lag + spin[2] * flap
        second = _outer(along)
        if self.winding is not None:
            second = second - spin[0] ** 2 * (_outer(lag) + _outer(flap))
        return self.axial * spin[0] * along, self.axial * second

    def _across(self, spin: Triple) -> Matrix:
        """Twice the part of w . d2 that is of second order."""
        g, h = self._bent
        if self.winding is None:
            return jnp.zeros_like(self._swept)
        p, r = pairwise_sum(self.first * spin), pairwise_sum(self.second * spin)
        crossed = g[:, None] * h[None]
        crossed = (crossed + crossed.swapaxes(0, 1)) / 2
        return r * (self.winding - crossed) - p * _outer(h)


def _winding(rotor: Rotor, shapes: Shapes) -> Matrix:
    """int (e2 e3' - e3 e2') dx, symmetric."""
    one_hot, f = one_hots(shapes.counts), shapes.at
    # Axial functions may have no curvature at the clamp: nobody asks for it.
    curvature = jnp.where(one_hot[None, :, 0] > 0, 0.0, f.curvature)
    lag, flap = one_hot[:, 1], one_hot[:, 2]
    mixed = f.slope.T @ (shapes.span.weight[:, None] * curvature)
    mixed = mixed * (np.outer(lag, flap) - np.outer(flap, lag))
    return symmetric_part(mixed) / rotor.beam.length**2


def _outer(x: Vector) -> Matrix:
    return x[:, None] * x[None]
