"""What rotates: a uniform slender beam, and the rotor that carries it.

Y: H. H. Yoo, R. R. Ryan, R. A. Scott, Dynamics of flexible beams undergoing overall motions,
Journal of Sound and Vibration, 1995.
B: M. Berzeri, A. A. Shabana, A finite element study of the geometric centrifugal stiffening effect,
Technical Report MBS99-5-UIC, 1999.
"""

import dataclasses
import warnings
from collections.abc import Iterator, Mapping
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import is_known_valid, is_valid, kind_of, known, positive, real_scalar, require
from jaxbeam._status import Status
from jaxbeam._types import Code, Number, Real, Scalar, is_known


def parameter(status: Status, *, zero: bool = False) -> Any:
    """Field of a scalar that is positive, or `zero`; `status` is what breaking that is called."""
    return eqx.field(metadata={"status": status, "zero": zero})


class _Parameters(eqx.Module):
    """Scalars with rules, each at its field, checked when built from numbers that are known.

    A further one is a field with its rule and an argument of `__init__` of the same name.
    """

    def _take(self, given: Mapping[str, Any]) -> None:
        """Each field from the argument of its name; those with a rule as scalars."""
        for field in dataclasses.fields(self):
            value = given[field.name]
            setattr(self, field.name, real_scalar(field.name, value) if field.metadata else value)

    def __check_init__(self) -> None:
        for field in dataclasses.fields(self):
            value, rule = getattr(self, field.name), field.metadata
            if rule and is_known(value):
                require(rule["status"], is_known_valid(value, rule["zero"]), value)

    def status(self, angular_speed: Scalar) -> Code:
        """`Status` of the parameters: the first that is out of range. Works under `jit`, `vmap`."""
        code = jnp.where(jnp.isfinite(angular_speed), Status.OK, Status.INVALID_ANGULAR_SPEED)
        for value, rule in reversed([*self._rules()]):
            code = jnp.where(is_valid(value, rule["zero"]), code, rule["status"])
        return code

    def _rules(self) -> Iterator[tuple[Any, Mapping[str, Any]]]:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if isinstance(value, _Parameters):
                yield from value._rules()
            else:
                yield value, field.metadata

    def checked(self) -> Self:
        """Rebuilt, so that what comes from `eqx.tree_at` or `vmap` meets the checks as well."""
        values = [getattr(self, field.name) for field in dataclasses.fields(self)]
        return type(self)(*(v.checked() if isinstance(v, _Parameters) else v for v in values))


class Beam(_Parameters):
    """Uniform, initially straight, slender beam: no shear, no rotary inertia.

    | field                       | symbol | unit  | allowed |
    |-----------------------------|--------|-------|---------|
    | length                      | L      | m     | > 0     |
    | mass_per_length             | rho    | kg/m  | > 0     |
    | axial_stiffness             | EA     | N     | > 0     |
    | in_plane_bending_stiffness  | EI_zz  | N m^2 | > 0     |
    | flap_bending_stiffness      | EI_yy  | N m^2 | > 0     |

    "In plane" is bending within the plane of rotation (lag), "flap" bending out of it. Every
    field is a scalar leaf, so any of them can be swept, fitted or differentiated.
    """

    length: Scalar = parameter(Status.INVALID_LENGTH)
    mass_per_length: Scalar = parameter(Status.INVALID_MASS_PER_LENGTH)
    axial_stiffness: Scalar = parameter(Status.INVALID_AXIAL_STIFFNESS)
    in_plane_bending_stiffness: Scalar = parameter(Status.INVALID_IN_PLANE_BENDING_STIFFNESS)
    flap_bending_stiffness: Scalar = parameter(Status.INVALID_FLAP_BENDING_STIFFNESS)

    def __init__(
        self,
        length: Real,
        mass_per_length: Real,
        axial_stiffness: Real,
        in_plane_bending_stiffness: Real,
        flap_bending_stiffness: Real,
    ) -> None:
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
        """From material and cross-section: rho = density * area, EA, EI.

        SI units: m, Pa, kg/m^3, m^2, m^4. `flap_second_moment` defaults to the in-plane one.
        """
        named = {
            "youngs_modulus": youngs_modulus,
            "density": density,
            "area": area,
            "in_plane_second_moment": in_plane_second_moment,
        }
        if flap_second_moment is not None:
            named["flap_second_moment"] = flap_second_moment
        section = {name: known(positive(name, value)) for name, value in named.items()}
        modulus = section["youngs_modulus"]
        in_plane = modulus * section["in_plane_second_moment"]
        flap = in_plane
        if flap_second_moment is not None:
            flap = modulus * section["flap_second_moment"]
        return cls(
            length=length,
            mass_per_length=section["density"] * section["area"],
            axial_stiffness=modulus * section["area"],
            in_plane_bending_stiffness=in_plane,
            flap_bending_stiffness=flap,
        )

    @classmethod
    def from_slenderness(cls, slenderness: Real, *, flap_to_in_plane: Real = 1.0) -> Self:
        """Nondimensional beam: L = rho = EI_zz = 1, EA = slenderness^2.

        slenderness = L sqrt(EA / EI_zz) = L sqrt(A / I_zz). Frequencies and speeds of such a beam
        are in units of sqrt(EI_zz / (rho L^4)) (B eqs. 64-65), hub radii in units of L, tip masses
        in units of the mass of the beam. `flap_to_in_plane` is EI_yy / EI_zz.
        """
        ratio = known(positive("slenderness", slenderness))
        return cls(
            length=1.0,
            mass_per_length=1.0,
            axial_stiffness=ratio**2,
            in_plane_bending_stiffness=1.0,
            flap_bending_stiffness=positive("flap_to_in_plane", flap_to_in_plane),
        )

    @property
    def mass(self) -> Number:
        """Mass of the beam, rho L, in kg."""
        return self.mass_per_length * self.length

    @property
    def frequency_scale(self) -> Number:
        """sqrt(EI_zz / (rho L^4)) in rad/s (B eq. 64, where m = rho L)."""
        return jnp.sqrt(self.in_plane_bending_stiffness / (self.mass_per_length * self.length**4))

    @property
    def slenderness(self) -> Number:
        """L sqrt(EA / EI_zz), without unit."""
        return self.length * jnp.sqrt(self.axial_stiffness / self.in_plane_bending_stiffness)


class Rotor(_Parameters):
    """A beam clamped radially to a rigid hub, with a point mass at its tip.

    | field      | symbol | unit | allowed |
    |------------|--------|------|---------|
    | beam       |        |      |         |
    | hub_radius | R      | m    | >= 0    |
    | tip_mass   | m_t    | kg   | >= 0    |

    The hub radius is the distance from the axis of rotation to the root of the beam.
    """

    beam: Beam
    hub_radius: Scalar = parameter(Status.INVALID_HUB_RADIUS, zero=True)
    tip_mass: Scalar = parameter(Status.INVALID_TIP_MASS, zero=True)

    def __init__(self, beam: Beam, hub_radius: Real = 0.0, tip_mass: Real = 0.0) -> None:
        if not isinstance(beam, Beam):
            raise TypeError(f"beam must be a Beam, got {kind_of(beam)}")
        self._take(locals())

    @property
    def frequency_scale(self) -> Number:
        """The frequency scale of the beam, in rad/s."""
        return self.beam.frequency_scale

    @property
    def compliance(self) -> Float[Array, "2"]:
        """Deflection of the tip in plane and in flap by the moment of a uniform load about the
        root, L^2 / (4 EI), in 1/N."""
        beam = self.beam
        stiffness = [beam.in_plane_bending_stiffness, beam.flap_bending_stiffness]
        return beam.length**2 / (4 * jnp.stack(stiffness))

    def tension(self, angular_speed: Number) -> tuple[Any, Any, Any]:
        """Axial force of steady rotation, as three coefficients in N: see `tension`."""
        beam = self.beam
        return tension(angular_speed**2, self.hub_radius, self.tip_mass, beam.mass, beam.length)

    def steady_strain(self, angular_speed: Number) -> Number:
        """P(0) / EA, without unit: the largest of `tension`, at the root, over EA."""
        c0, c1, c2 = self.tension(angular_speed)
        return (c0 + c1 + c2 / 2) / self.beam.axial_stiffness

    def tears(self, angular_speed: Number) -> Any:
        """Whether a rod of constant axial stiffness has no steady state at this speed.

        Omega L (rho / EA)^(1/2) = beta with m_t beta tan(beta) = rho L or beyond.
        """
        beam = self.beam
        beta = jnp.abs(angular_speed) * jnp.sqrt(beam.mass * beam.length / beam.axial_stiffness)
        holds = (beta < np.pi / 2) & (self.tip_mass * beta * jnp.tan(beta) < beam.mass)
        return ~holds


def tension(
    spin2: Any, hub_radius: Any, tip_mass: Any, mass: Any = 1.0, length: Any = 1.0, axial: Any = 0.0
) -> tuple[Any, Any, Any]:
    """Axial force that carries the undeformed beam along, as three coefficients c in N:

    P(x) = -int_x^L a1 dm = c_0 + c_1 (1 - xi) + c_2 (1 - xi^2) / 2,  xi = x / L,

    where a1(X) = axial - spin2 X is the acceleration along the beam at the distance X = R + x from
    the axis. P of Y eqs. 19-20, with the tip mass in the mass measure; in steady rotation, spin2 =
    Omega^2 and axial = 0, EA times the strains of B eqs. 41-43:

    P(x) = Omega^2 { m_t (R + L) + rho R (L - x) + rho (L^2 - x^2) / 2 }
    """
    return (
        tip_mass * (spin2 * (hub_radius + length) - axial),
        mass * (spin2 * hub_radius - axial),
        mass * spin2 * length,
    )


class SpringRotor(_Parameters):
    """The discrete analogue of a rotating beam (Y, section 6, Fig. 10, Table 2).

    A particle slides in a massless tube that is hinged at the distance `hub_radius` from the axis;
    one spring acts along the tube, one at the hinge.

    | field                 | symbol | unit   | allowed |
    |-----------------------|--------|--------|---------|
    | mass                  | m      | kg     | > 0     |
    | length                | L      | m      | > 0     |
    | hub_radius            | d      | m      | >= 0    |
    | translational_spring  | k_T    | N/m    | > 0     |
    | torsional_spring      | k_r    | N m    | > 0     |
    """

    mass: Scalar = parameter(Status.INVALID_MASS)
    length: Scalar = parameter(Status.INVALID_LENGTH)
    hub_radius: Scalar = parameter(Status.INVALID_HUB_RADIUS, zero=True)
    translational_spring: Scalar = parameter(Status.INVALID_TRANSLATIONAL_SPRING)
    torsional_spring: Scalar = parameter(Status.INVALID_TORSIONAL_SPRING)

    def __init__(
        self,
        mass: Real,
        length: Real,
        hub_radius: Real,
        translational_spring: Real,
        torsional_spring: Real,
    ) -> None:
        self._take(locals())

    @property
    def frequency_scale(self) -> Number:
        """(k_r / (m L^2))^(1/2), in rad/s."""
        return jnp.sqrt(self.torsional_spring / self.mass) / self.length

    @property
    def compliance(self) -> Float[Array, "2"]:
        """Deflection of the tip by a moment about the hinge, in 1/N; in plane alone."""
        return jnp.stack([self.length / self.torsional_spring, jnp.zeros_like(self.length)])


AnyRotor = Rotor | SpringRotor  # whichever a model takes, its `rotor_type`


def checked_rotor(kind: type[Rotor] | type[SpringRotor], rotor: Any) -> Any:
    """The rotor, checked for structure and, where values are known, for range.

    Every public function comes through here. Also the place that warns when 64-bit floats are off.
    """
    if not jax.config.read("jax_enable_x64"):
        warnings.warn(
            "jax runs in 32-bit floats: results will carry about three digits. Call "
            "jax.config.update('jax_enable_x64', True) before anything else.",
            stacklevel=4,
        )
    if not isinstance(rotor, kind):
        raise TypeError(f"rotor must be a {kind.__name__}, got {kind_of(rotor)}")
    return rotor.checked()
