"""A slender beam, and the rotor that carries it. Y and B are the papers of `_models/contract`."""

import dataclasses
from typing import Any, Self

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import check_kind, numpy_if_concrete, positive
from jaxbeam._numerics.linalg import largest
from jaxbeam._rotor.ends import RootSprings, Tip, tip_of
from jaxbeam._rotor.parameters import (
    FULL_TURN,
    Parameters,
    along_span,
    angle,
    optional,
    parameter,
    required,
)
from jaxbeam._rotor.points import PointMasses, WithPoints
from jaxbeam._rotor.sections import AbstractSections
from jaxbeam._rotor.span import Span, on, outboard, tension
from jaxbeam._rotor.spanwise import (
    AbstractSpanwise,
    Property,
    along,
    at_ends,
    edges_between,
    mean,
    points_within,
)
from jaxbeam._rotor.spring_rotor import SpringRotor
from jaxbeam._rotor.support import Support
from jaxbeam._status import Status
from jaxbeam._types import Number, Real, Scalar, Triple

_POINTS = 8  # Gauss points of each segment, for integrals of the tension
CONED_AND_MORE = "precone beside pitch, twist or a body at the tip"  # a feature for models to know


class Beam(Parameters):
    """Initially straight, slender beam without shear.

    | field                       | symbol | unit  | allowed |
    |-----------------------------|--------|-------|---------|
    | length                      | L      | m     | > 0     |
    | mass_per_length             | rho    | kg/m  | > 0     |
    | axial_stiffness             | EA     | N     | > 0     |
    | in_plane_bending_stiffness  | EI_zz  | N m^2 | > 0     |
    | flap_bending_stiffness      | EI_yy  | N m^2 | > 0     |

    "In plane" is bending within the plane of rotation (lag), "flap" bending out of it. Each is a
    number, for a uniform beam, or varies along the span: `Spanwise` or `SpanwiseFunction`, all but
    the length. `twist`, if there is one, is the angle in rad, a turn at most, by which the axes of
    the section are turned about the beam, its first axis (of the in-plane stiffness) towards the
    third of the hub; the same for all sections it is a pitch. Every number is a leaf, so any of
    them can be swept, fitted or differentiated.

    Models in space ask how it twists: `torsional_stiffness` GJ in N m^2, > 0, and `polar_inertia`,
    that about the beam per length, in kg m, > 0; without it that of a solid section, rho (EI_zz +
    EI_yy) / EA. Where it is given modal theories have rotary inertia (but in cones), shared by both
    ways of bending as stiffness is, as rods always have; planar elements leave it out.
    `point_masses` are `PointMasses` between the ends.

    Raises `TypeError` for what is no real number, nor varies along the span as it may, and
    `ValueError` for what is not allowed; numbers that are traced are told of by a `Status` instead.
    """

    length: Scalar = parameter(Status.INVALID_LENGTH)
    mass_per_length: Property = along_span(Status.INVALID_MASS_PER_LENGTH)
    axial_stiffness: Property = along_span(Status.INVALID_AXIAL_STIFFNESS)
    in_plane_bending_stiffness: Property = along_span(Status.INVALID_IN_PLANE_BENDING_STIFFNESS)
    flap_bending_stiffness: Property = along_span(Status.INVALID_FLAP_BENDING_STIFFNESS)
    twist: Property | None = angle(Status.INVALID_TWIST, FULL_TURN, varies=True)
    torsional_stiffness: Property | None = optional(
        Status.INVALID_TORSIONAL_STIFFNESS, varies=True, of_torsion=True
    )
    polar_inertia: Property | None = optional(
        Status.INVALID_POLAR_INERTIA, varies=True, of_torsion=True
    )
    point_masses: PointMasses | None = None

    def __init__(
        self,
        length: Real,
        mass_per_length: Real | AbstractSpanwise,
        axial_stiffness: Real | AbstractSpanwise,
        in_plane_bending_stiffness: Real | AbstractSpanwise,
        flap_bending_stiffness: Real | AbstractSpanwise,
        twist: Real | AbstractSpanwise | None = None,
        torsional_stiffness: Real | AbstractSpanwise | None = None,
        polar_inertia: Real | AbstractSpanwise | None = None,
        point_masses: PointMasses | None = None,
    ) -> None:
        check_kind("point_masses", point_masses, PointMasses, type(None))
        self._take(locals())

    @classmethod
    def from_section(
        cls,
        *,
        length: Real,
        youngs_modulus: Real,
        density: Real,
        area: Real,
        in_plane_second_moment: Real,
        flap_second_moment: Real | None = None,
    ) -> Self:
        """A uniform beam from its material and its cross-section: rho = density * area, EA and EI.

        `length` in m, `youngs_modulus` E in Pa, `density` in kg/m^3, `area` A in m^2, and I in m^4,
        `in_plane_second_moment` and `flap_second_moment`, which is the former by default; all > 0.
        Raises as `Beam` does.
        """
        if flap_second_moment is None:
            flap_second_moment = in_plane_second_moment
        named = {
            "youngs_modulus": youngs_modulus,
            "density": density,
            "area": area,
            "in_plane_second_moment": in_plane_second_moment,
            "flap_second_moment": flap_second_moment,
        }
        modulus, density, area, *moments = (
            numpy_if_concrete(positive(name, value)) for name, value in named.items()
        )
        return cls(length, density * area, modulus * area, *(modulus * i for i in moments))

    @classmethod
    def from_slenderness(cls, slenderness: Real, *, flap_to_in_plane: Real = 1.0) -> Self:
        """Nondimensional beam: L = rho = EI_zz = 1, EA = slenderness^2.

        `slenderness` is L sqrt(EA / EI_zz) = L sqrt(A / I_zz), `flap_to_in_plane` EI_yy / EI_zz;
        both are > 0 and without unit. Frequencies and speeds of such a beam are in units of
        sqrt(EI_zz / (rho L^4)) (B eqs. 64-65), hub radii in units of L, tip masses in units of the
        mass of the beam. Raises as `Beam` does.
        """
        ratio = numpy_if_concrete(positive("slenderness", slenderness))
        return cls(
            length=1.0,
            mass_per_length=1.0,
            axial_stiffness=ratio**2,
            in_plane_bending_stiffness=1.0,
            flap_bending_stiffness=positive("flap_to_in_plane", flap_to_in_plane),
        )

    @property
    def is_uniform(self) -> bool:
        """Whether nothing varies along the span, and sections are not turned."""
        return self.twist is None and not self._varying()

    @property
    def edges(self) -> tuple[float, ...]:
        """Edges x / L, from 0 to 1, between which all properties are smooth."""
        return edges_between(self._varying())

    @property
    def stiffness_edges(self) -> tuple[float, ...]:
        """Edges x / L, from 0 to 1, between which all but the mass is smooth."""
        return edges_between(self._varying(mass=False))

    @property
    def steps(self) -> tuple[float, ...]:
        """Places x / L at which a property may jump."""
        return tuple(sorted({step for p in self._varying() for step in p.steps}))

    @property
    def mass_with_points(self) -> Property:
        """Mass per length with the `point_masses`, in kg/m: what has inertia along the span."""
        if self.point_masses is None:
            return self.mass_per_length
        return WithPoints(self.mass_per_length, self.point_masses, self.length)

    @property
    def span_features(self) -> tuple[str, ...]:
        """The features that models have to know of properties along the span."""
        varies = isinstance(self.mass_per_length, AbstractSpanwise) or self._varying(mass=False)
        return ("spanwise",) if varies else ()

    def _varying(self, *, mass: bool = True) -> list[AbstractSpanwise]:
        names = (f.name for f in dataclasses.fields(self) if f.name != "mass_per_length")
        every = [*(getattr(self, name) for name in names), *[self.mass_with_points] * mass]
        return [value for value in every if isinstance(value, AbstractSpanwise)]

    @property
    def mean(self) -> "Beam":
        """The uniform beam whose properties are the means of these over the span."""
        if self.is_uniform:
            return self
        return Beam(
            self.length, mean(self.mass_with_points), mean(self.axial_stiffness),
            mean(self.in_plane_bending_stiffness), mean(self.flap_bending_stiffness),
        )  # fmt: skip

    @property
    def mass(self) -> Number:
        """Mass of the beam, int rho dx, and of what is at points of it, in kg."""
        return mean(self.mass_with_points) * self.length

    @property
    def frequency_scale(self) -> Number:
        """sqrt(EI_zz / (rho L^4)) in rad/s (B eq. 64, where m = rho L), of the `mean` beam."""
        beam = self.mean
        # L is outside of the root: its fourth power is beyond 32 bits for small beams.
        return jnp.sqrt(beam.in_plane_bending_stiffness / beam.mass_per_length) / beam.length**2

    @property
    def slenderness(self) -> Number:
        """L sqrt(EA / EI_zz), without unit, of the `mean` beam."""
        beam = self.mean
        return beam.length * jnp.sqrt(beam.axial_stiffness / beam.in_plane_bending_stiffness)


class Rotor(Parameters):
    """A beam that points radially from a rigid hub, with a mass at its tip, a point or a body.

    | field        | symbol | unit | allowed                   |
    |--------------|--------|------|---------------------------|
    | beam         |        |      | a `Beam` or a `Blade`     |
    | hub_radius   | R      | m    | any                       |
    | tip_mass     | m_t    | kg   | >= 0                      |
    | pitch        | theta  | rad  | -2 pi to 2 pi, or None    |
    | root_springs |        |      | `RootSprings`, or None    |
    | tip_body     |        |      | a `TipBody`, `RigidBody`  |
    | precone      | beta   | rad  | -pi / 2 to pi / 2 or None |
    | root_support |        |      | a `Support`, or None      |
    | tip_support  |        |      | a `Support`, or None      |

    The hub radius is the distance from the axis of rotation to the root, along the beam: below zero
    the beam points inward, from a rim to the axis, and beyond it where -R < L. What is before the
    axis is pushed towards the root, and buckles at a speed (`critical_speed`). The root is clamped
    unless there are `root_springs` or, for `SpatialRod`, a `root_support`, and the tip free
    unless there is a `tip_support`. What is at the tip is a point, of the `tip_mass`, or a
    `tip_body`, which has a mass of its own: one of them is given, or none, where nothing is there.
    `tip_mass` reads the mass of either, `tip_body` the body or the point. Sections are as the beam
    says unless `pitch` turns them all, an angle added to the twist. With a `precone` the beam
    leaves the hub at that angle from the plane of rotation, towards a3: at a right angle it is a
    shaft, in the axis where the hub radius is zero. None is not there: a pitch of zero counts as
    one, and lets models look for what it might couple.

    Raises `TypeError` and `ValueError` as `Beam` does, and `ValueError` for both masses at the tip,
    or for springs and a support at the root.
    """

    beam: Any  # a `Beam` or a `Blade`
    hub_radius: Scalar = parameter(Status.INVALID_HUB_RADIUS, zero=None)
    tip_body: Tip = required()
    pitch: Scalar | None = angle(Status.INVALID_PITCH, FULL_TURN)
    root_springs: RootSprings | None = None
    precone: Scalar | None = angle(Status.INVALID_PRECONE, FULL_TURN / 4)
    root_support: Support | None = None
    tip_support: Support | None = None

    def __init__(
        self,
        beam: Beam | AbstractSections,
        hub_radius: Real = 0.0,
        tip_mass: Real | None = None,
        pitch: Real | None = None,
        root_springs: RootSprings | None = None,
        tip_body: Tip | None = None,
        precone: Real | None = None,
        root_support: Support | None = None,
        tip_support: Support | None = None,
    ) -> None:
        check_kind("beam", beam, Beam, AbstractSections)
        check_kind("root_springs", root_springs, RootSprings, type(None))
        check_kind("root_support", root_support, Support, type(None))
        check_kind("tip_support", tip_support, Support, type(None))
        if root_springs is not None and root_support is not None:
            raise ValueError("root_support: there are root_springs as well; give one of them")
        tip_body = tip_of(tip_mass, tip_body)
        self._take(locals())

    @property
    def features(self) -> tuple[str, ...]:
        """The features that a model has to know: fields that may be None and are not, except those
        of torsion; a body at the tip, properties that vary, and `CONED_AND_MORE`."""
        more = self.couples_bending or self.tip_body.is_body
        return (
            *(CONED_AND_MORE,) * (more and self.precone is not None),
            *self.beam.span_features,
            *("tip_body",) * self.tip_body.is_body,
            *super().features,
        )

    @property
    def tip_mass(self) -> Number:
        """The mass at the tip, in kg."""
        return self.tip_body.mass

    @property
    def springs(self) -> tuple[Number | None, Number | None]:
        """Springs of the root, in plane and in flap; None where it is clamped."""
        springs = self.root_springs
        return (None, None) if springs is None else (springs.in_plane, springs.flap)

    @property
    def length(self) -> Number:
        """The length of the beam, in m."""
        return self.beam.length

    @property
    def varies(self) -> bool:
        """Whether properties of the beam vary along the span, its sections are twisted, or both."""
        return not self.beam.is_uniform

    @property
    def couples_bending(self) -> bool:
        """Whether sections are turned, so that flap bending and bending in plane are coupled."""
        return self.pitch is not None or self.beam.twist is not None

    @property
    def turns_mass(self) -> bool:
        """Whether sections or a body at the tip have rotary inertia."""
        return self.beam.polar_inertia is not None or self.tip_body.is_body

    @property
    def frequency_scale(self) -> Number:
        return self.beam.frequency_scale

    @property
    def compliance(self) -> Float[Array, "2"]:
        """Deflection of the tip in plane and in flap by the moment of a uniform load about the
        root, L^2 / (4 EI) of the `mean` beam, in 1/N."""
        beam = self.beam.mean
        both = beam.in_plane_bending_stiffness, beam.flap_bending_stiffness
        return beam.length**2 / (4 * jnp.stack(both))

    @property
    def tip_mass_radius(self) -> Number:
        """Distance of the centre of the tip mass from the axis, in m."""
        radius: Number = self.tip_body.centre(self.hub_radius + self.beam.length, 1.0)
        return radius

    @property
    def rigid_moments(self) -> Triple:
        """The moments int (1, X, X^2) dm of the straight beam with its tip mass, X distances from
        the axis."""
        beam = self.beam if isinstance(self.beam, Beam) else self.beam.beam()
        radius, length, mass = self.hub_radius, beam.length, beam.mass
        tip_mass, tip_mass_radius = self.tip_mass, self.tip_mass_radius
        if beam.is_uniform:
            first, second = length / 2, radius**2 + radius * length + length**2 / 3
        else:
            xi, weight = points_within(beam.edges)
            share: Any = weight * along(beam.mass_with_points, xi) * length / mass
            first = length * (share @ xi)
            second = share @ (radius + length * xi) ** 2
        return jnp.stack(
            [
                mass + tip_mass,
                mass * (radius + first) + tip_mass * tip_mass_radius,
                mass * second + self.tip_body.second_moment(tip_mass_radius),
            ]
        )

    def tension(self, angular_speed: Number | np.ndarray) -> tuple[Any, Any, Any]:
        """Axial force of steady rotation, as three coefficients in N: see `tension`."""
        beam = self.beam
        return tension(
            angular_speed**2, self.hub_radius, self.tip_mass, beam.mass, beam.length,
            tip_mass_radius=self.tip_mass_radius,
        )  # fmt: skip

    def steady_strain(self, angular_speed: Number) -> Number:
        """The strain P / EA of steady rotation, without unit, where its magnitude is largest: for a
        uniform beam at the root, or where it crosses the axis."""
        c0, c1, c2 = self.tension(angular_speed)
        beam = self.beam
        if beam.is_uniform:
            outer = 1 - jnp.clip(-self.hub_radius / beam.length, 0.0, 1.0)
            root, axis = c0 + c1 + c2 / 2, c0 + c1 * outer + c2 * outer * (2 - outer) / 2
            return jnp.where(jnp.abs(axis) > jnp.abs(root), axis, root) / beam.axial_stiffness
        span = Span.between(beam.edges, _POINTS)
        share, outside, moment = outboard(beam.mass_with_points, span)
        strain = (c0 + c1 * outside + c2 * moment) / on(beam.axial_stiffness, span)
        # The strain on both sides of every kink, where the stiffness may have a step.
        first, last = at_ends(beam.axial_stiffness, beam.edges)
        inner = span.at_edges(jnp.stack([share, span.xi * share], 1))
        outside, moment = (inner[-1:] - inner).T
        force = c0 + c1 * outside + c2 * moment
        return largest(jnp.concatenate([strain, force[:-1] / first, force[1:] / last]), by=jnp.abs)

    def tears(self, angular_speed: Number) -> Any:
        """Whether a uniform rod of constant axial stiffness has no steady state at this speed.

        Omega L (rho / EA)^(1/2) = beta with m_t beta tan(beta) = rho L or beyond. Raises
        `ValueError` for a beam that varies along the span, or has a body at its tip.
        """
        beam = self.beam
        if not beam.is_uniform or self.tip_body.is_body:
            raise ValueError("tears knows uniform beams with a point at their tip alone")
        beta = jnp.abs(angular_speed) * jnp.sqrt(beam.mass * beam.length / beam.axial_stiffness)
        return ~((beta < np.pi / 2) & (self.tip_mass * beta * jnp.tan(beta) < beam.mass))


AnyRotor = Rotor | SpringRotor  # a model takes one of them, its `rotor_type`
