"""Small vibration of a coned beam about its deflected steady rotation.

In a cone the spin has a component along the beam: it bends the beam outward, towards the plane of
rotation, and couples flap with lag by Coriolis forces. Both effects are of one order and nearly
cancel in soft beams, so that a theory about the undeformed axis of the cone is worse than none
(at 5 degrees, gamma = 8 and EI_zz / EI_yy = 16 the first frequency is 1.3 % low there, 0.04 % high
without a cone). Here the steady state is that of the exact rod without extension, shear and
torsion, and motion about it is linear.

With t the elevation of the tangent above the plane of rotation, X the distance from the axis,

    t = cone + turn of the root + ...,   X = R + int cos t dx,

the steady state is where int EI_yy t'^2 dx - W^2 int X^2 dm is stationary. A small change of it
turns the tangent by e in elevation and by b across, to the side of the plane that it lies in; the
section follows without torsion if it turns about the tangent by c, c' = t' b. The energies are

    EI_yy e'^2 + EI_zz (b' + t' c)^2 - EI_yy [t'^2 b^2 - b'^2 + (b' + t' c)^2]
    + H cos t (e^2 + b^2) - m W^2 (X_1^2 + Y_1^2)

and m (X_1'^2 + Y_1'^2 + Z_1'^2) (rates there) over two, X_1 = -int e sin t, Y_1 = int b, Z_1 = int
e cos t and H the radial force W^2 int_x^L X dm. Lag and flap move in quadrature. What the first
moments EI_yy t' do along changes of second order is in these terms by (EI_yy t')' = H sin t, so
that nothing is divided by cos t: a cone may be a right angle, a shaft in the axis. Springs of the
root act about the axes of the cone, see `lag_of_root`.

About the axis of rotation the energy is no minimum beyond the first frequency at rest, and yet the
beam may be stable, by Coriolis forces: modes tell. For sections of two stiffnesses they grow
between the two frequencies,

    (lambda^2 + w_1^2 - W^2) (lambda^2 + w_2^2 - W^2) + 4 W^2 lambda^2 = 0.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._models.bases.basis import Functions
from jaxbeam._models.bases.layered import massless
from jaxbeam._models.bases.shapes import Shapes
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._numerics.linalg import largest
from jaxbeam._numerics.newton import find_root
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.directions import Direction, coupling_groups
from jaxbeam._rotor.span import Span, on
from jaxbeam._rotor.spanwise import at_ends
from jaxbeam._status import Status
from jaxbeam._types import Code, Matrix, Scalar, Vector


class _Cone(NamedTuple):
    """A coned rotor and its bending functions at the p points of integration along the span."""

    rotor: Rotor
    span: Span
    mass: Float[Array, " p"]  # mass of each point, kg
    lag: Float[Array, " p"]  # EI_zz, N m^2
    flap: Float[Array, " p"]  # EI_yy, N m^2
    bending: tuple[Functions, Functions]  # functions in plane and in flap, whose slopes are angles
    root_slopes: tuple[Vector, Vector]  # slopes of these functions at the root

    @classmethod
    def sampled(cls, rotor: Rotor, shapes: Shapes) -> "_Cone":
        """A rotor and functions at the points of `shapes`: all that does not depend on speed."""
        beam, span, (_, n, _) = rotor.beam, shapes.span, shapes.counts
        columns = slice(None, n), slice(n, None)
        in_plane, flap = (Functions(*(a[:, column] for a in shapes.at)) for column in columns)
        return cls(
            rotor, span, beam.length * span.weight * on(beam.mass_with_points, span),
            on(beam.in_plane_bending_stiffness, span), on(beam.flap_bending_stiffness, span),
            (in_plane, flap), (shapes.ends.root[:n], shapes.ends.root[n:]),
        )  # fmt: skip

    def springs(self) -> tuple[Any, Any]:
        """Stiffness of the springs at the root in plane and in flap; zero where it is clamped."""
        first, second = (jnp.zeros(()) if s is None else s for s in self.rotor.springs)
        return first, second

    def shape(self, bent_by: Vector) -> tuple[Any, Any, Any, Any]:
        """Elevation t and dt/dx at the points, and distance X from the axis at points and tip, for
        coordinates `bent_by` of the flap functions."""
        flap, length = self.bending[1], self.rotor.beam.length
        elevation = self.rotor.precone + flap.slope @ bent_by
        cos = jnp.cos(elevation)
        distance = self.rotor.hub_radius + length * self.span.up_to(cos)
        at_tip = self.rotor.hub_radius + length * self.span.total(cos)
        return elevation, flap.curvature @ bent_by / length, distance, at_tip

    def height(self, sin: Any, distance: Any, at_tip: Scalar) -> Any:
        """int X Z dm, Z the height above the root, for sin t and X at the points and X at the
        tip."""
        length, tip_mass = self.rotor.beam.length, self.rotor.tip_mass
        heights, tip_height = length * self.span.up_to(sin), length * self.span.total(sin)
        return (self.mass * distance) @ heights + tip_mass * at_tip * tip_height

    def strain(self, tension: Vector, outward: Scalar, angle: Scalar) -> Scalar:
        """The largest strain: of `tension` at the points, or of the radial force `outward`
        at the root, where the tangent is turned by `angle`."""
        stiffness, cone = self.rotor.beam.axial_stiffness, self.rotor.precone
        assert cone is not None
        compliance = 1 / at_ends(stiffness, self.rotor.beam.edges)[0][0]
        at_root = outward * jnp.cos(cone + angle) * compliance
        return largest(jnp.append(at_root, tension / on(stiffness, self.span)), by=jnp.abs)

    def steady(self, speed: Scalar) -> tuple[Vector, Code]:
        """Coordinates of the flap functions in steady rotation, rad, and the status of the
        search."""
        length, spring = self.rotor.beam.length, self.springs()[1]
        flap = self.bending[1]
        scale = jnp.max(self.flap) / length

        def gradient(bent_by: Vector, fraction: Any = 1.0) -> Vector:
            def energy(bent_by: Vector) -> Scalar:
                _, curvature, distance, at_tip = self.shape(bent_by)
                elastic = length * self.span.total(self.flap * curvature**2)
                elastic = elastic + spring * (self.root_slopes[1] @ bent_by) ** 2
                inertia = self.mass @ distance**2 + self.rotor.tip_mass * at_tip**2
                return (elastic - fraction * speed**2 * inertia) / (2 * scale)

            return jax.grad(energy)(bent_by)

        straight = jnp.zeros(flap.slope.shape[1], speed.dtype)
        load = jax.lax.stop_gradient(jnp.max(jnp.abs(gradient(straight))))
        bent_by, done = find_root(gradient, straight, support=load * jnp.eye(straight.size))
        return bent_by, jnp.where(done < 1, Status.NOT_CONVERGED, Status.OK)


def lag_of_root(lag: Any, moment: Any, bent_by: Scalar) -> Scalar:
    """The root's stiffness against a small turn b of the tangent across, in N m, at the steady
    turn a = `bent_by` in flap, by its spring `lag` and the `moment` with which it holds the flap.

    Its axes are those of the cone. Springs have k phi^2 / 2, phi the components about these of the
    least rotation from the direction of the cone to the tangent. With f = a / sin a

        phi_lag = f b,   phi_flap = a - (a - sin a cos a) / (2 sin^2 a) b^2,

    so that a hinge for lag is across the blade as it stands, not about the axis of rotation, and
    the moment in flap, that of its spring or of a clamp, does work.
    """
    small = jnp.abs(bent_by) < 1e-2
    a = jnp.where(small, 1.0, bent_by)
    ratio = jnp.where(small, 1 + bent_by**2 / 6 + 7 * bent_by**4 / 360, a / jnp.sin(a))
    sinks = (a - jnp.sin(a) * jnp.cos(a)) / jnp.sin(a) ** 2
    sinks = jnp.where(small, 2 * bent_by / 3 + 4 * bent_by**3 / 45, sinks)
    held: Scalar = lag * ratio**2 - moment * sinks
    return held


def _over(weight: Array, a: Array, b: Array) -> Matrix:
    """Integrals (n, n) of products of functions a and b (p, n) by weights (p,)."""
    return a.T @ (weight[:, None] * b)


def coned_system(
    rotor: Rotor, speed: Scalar, shapes: Shapes, directions: tuple[Direction, ...]
) -> LinearSystem:
    """Matrices of small motion for bending functions alone: b = f' q / L in plane, e in flap."""
    cone = _Cone.sampled(rotor, shapes)
    span = cone.span
    bent_by, status = cone.steady(speed)
    elevation, dt_dx, distance, at_tip = cone.shape(bent_by)
    length, tip_mass, dm = rotor.beam.length, rotor.tip_mass, cone.mass
    sin, cos = jnp.sin(elevation)[:, None], jnp.cos(elevation)[:, None]
    in_plane, flap_functions = cone.bending
    # Columns are functions; angles for a coordinate of one metre, displacements in metres.
    across, across_rate = in_plane.slope / length, in_plane.curvature / length**2
    rise, bending = flap_functions.slope / length, flap_functions.curvature / length**2
    displacements = [length * a for a in (across, -rise * sin, rise * cos)]
    y, x, z = (span.up_to(a) for a in displacements)
    y_tip, x_tip, z_tip = (span.total(a) for a in displacements)
    angle = cone.root_slopes[1] @ bent_by
    # The least rotation of the root turns it about the tangent as well.
    by_root = jnp.tan(angle / 2) * cone.root_slopes[0][None] / length
    roll = length * span.up_to(dt_dx[:, None] * across) + by_root
    side = across_rate + dt_dx[:, None] * roll  # the curvature in the section's other direction
    # The radial force over speed^2 of the mass beyond each point, and the tension, with a tip mass.
    outward = span.beyond(dm / span.weight * distance)
    tension = speed**2 * (outward + tip_mass * at_tip) * cos[:, 0]

    def inertia(a: Any, b: Any, a_tip: Any, b_tip: Any) -> Any:
        return _over(dm, a, b) + tip_mass * a_tip[:, None] * b_tip[None]

    dx, excess = length * span.weight, cone.lag - cone.flap
    lag, flap = cone.springs()
    moment = -(speed**2) * cone.height(sin[:, 0], distance, at_tip)
    root_stiffness = lag_of_root(lag, moment, angle), flap
    springs = [k * (e / length)[:, None] * (e / length)[None]
               for k, e in zip(root_stiffness, cone.root_slopes, strict=True)]  # fmt: skip
    m_lag, m_x = inertia(y, y, y_tip, y_tip), inertia(x, x, x_tip, x_tip)
    k_lag = (
        _over(dx * excess, side, side)
        + _over(dx * cone.flap, across_rate, across_rate)
        + _over(dx * (tension - cone.flap * dt_dx**2), across, across)
        - speed**2 * m_lag + springs[0]
    )  # fmt: skip
    k_flap = (
        _over(dx * cone.flap, bending, bending) + _over(dx * tension, rise, rise) - speed**2 * m_x
        + springs[1]
    )  # fmt: skip
    coriolis = 2 * speed * inertia(y, x, y_tip, x_tip)
    first_moment = jnp.sum(dm * distance) + tip_mass * at_tip
    block = jax.scipy.linalg.block_diag
    mass = block(m_lag, m_x + inertia(z, z, z_tip, z_tip))
    if least_mass := massless(shapes.basis, mass.dtype):
        mass = mass + least_mass * (rotor.beam.mass + tip_mass) * jnp.eye(len(mass))
    return LinearSystem(
        mass=mass,
        gyroscopic=jnp.block([[0 * m_lag, coriolis], [-coriolis.T, 0 * m_x]]),
        stiffness=block(k_lag, k_flap),
        steady_strain=cone.strain(tension, speed**2 * first_moment, angle),
        status=status,
        directions=directions,
        coupling=coupling_groups(rotor),
    )
