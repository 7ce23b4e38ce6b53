"""What a beam is held by at its root, and what it carries at its tip."""

from typing import Any, ClassVar

from jaxbeam._checks import check_kind, needs, real_scalar
from jaxbeam._rotor.parameters import Parameters, optional, parameter
from jaxbeam._status import Status
from jaxbeam._types import Number, Real, Scalar


class RootSprings(Parameters):
    """Rotational springs between hub and root, one for each direction that yields.

    | field    |                                          | unit    | allowed      |
    |----------|------------------------------------------|---------|--------------|
    | in_plane | about the axis of rotation (lag)         | N m/rad | >= 0 or None |
    | flap     | about the axis across beam and rotation  | N m/rad | >= 0 or None |

    With `precone` both are tilted by it: the axis for lag is across the beam as it stands. Energy
    k phi(0)^2 / 2, phi(0) the slope at the root; None: rigid; zero: a free hinge, at the root,
    which is at the `hub_radius`. What swings there at rest has the frequency zero, of which the
    square alone has derivatives: those of the frequency are NaN, in both modes.

    Raises `TypeError` for what is no real number, and `ValueError` for what is not allowed.
    """

    in_plane: Scalar | None = optional(Status.INVALID_ROOT_SPRINGS, zero=True)
    flap: Scalar | None = optional(Status.INVALID_ROOT_SPRINGS, zero=True)

    def __init__(self, in_plane: Real | None = None, flap: Real | None = None) -> None:
        self._take(locals())


class PointMass(Parameters):
    """A point at the tip, which has a `mass` in kg, >= 0, alone: what a `tip_mass` makes."""

    is_body: ClassVar[bool] = False
    mass: Scalar = parameter(Status.INVALID_TIP_MASS, zero=True)

    def __init__(self, mass: Real) -> None:
        self._take({"mass": mass})

    def centre(self, value: Any, slope: Any, length: Any = 1.0) -> Any:
        """What has a value and a slope by x / length at the tip, at the centre of mass."""
        return value

    def second_moment(self, radius: Number) -> Number:
        """Moment of inertia about an axis across the beam, so far from the centre of mass."""
        return self.mass * radius**2


class TipBody(Parameters):
    """A rigid body at the tip in the place of a point mass: a payload, a tip brake, a tuning mass.

    | field         | symbol | meaning                                          | unit   | allowed |
    |---------------|--------|--------------------------------------------------|--------|---------|
    | mass          | m_t    |                                                  | kg     | >= 0    |
    | offset        | c      | of its centre of mass, beyond the tip            | m      | any     |
    | inertia       | J      | about its centre, across the beam, as it turns   | kg m^2 | >= 0    |
    |               |        | where the beam bends in plane                    |        |         |
    | axial_inertia | J_x    | about the beam's axis (a rod: 0; a ball: J)      | kg m^2 | >= 0    |
    | flap_inertia  | J_f    | as `inertia`, where the beam bends in flap; the  | kg m^2 | >= 0 or |
    |               |        | same unless it is given                          |        | None    |

    With all but the mass zero it is a point (nearly, in elements, which hold a body by a stiff
    spring). It turns with the end of the beam; its axes are those of the last section, which twist
    and pitch turn.

    Raises `TypeError` for what is no real number, and `ValueError` for what is not allowed.
    """

    is_body: ClassVar[bool] = True
    mass: Scalar = parameter(Status.INVALID_TIP_MASS, zero=True)
    offset: Scalar = parameter(Status.INVALID_TIP_BODY, zero=None)
    inertia: Scalar = parameter(Status.INVALID_TIP_BODY, zero=True)
    axial_inertia: Scalar = parameter(Status.INVALID_TIP_BODY, zero=True)
    flap_inertia: Scalar | None = optional(Status.INVALID_TIP_BODY, zero=True)

    @needs("mass", "a TipBody has a mass, and the rotor then takes no tip_mass: TipBody(mass=...)")
    def __init__(
        self,
        mass: Real,
        offset: Real = 0.0,
        inertia: Real = 0.0,
        axial_inertia: Real = 0.0,
        flap_inertia: Real | None = None,
    ) -> None:
        self._take(locals())

    def centre(self, value: Any, slope: Any, length: Any = 1.0) -> Any:
        """What has a value and a slope at the tip, at the centre of mass, as of a `PointMass`."""
        return value + self.offset / length * slope

    def second_moment(self, radius: Number) -> Number:
        """Moment of inertia as of a `PointMass`, and of the body itself in the plane."""
        return self.mass * radius**2 + self.inertia


Tip = PointMass | TipBody


def tip_of(tip_mass: Real | None, tip_body: Any) -> Tip:
    """What is at the tip, of which at most one is given; a point gives way to another mass."""
    check_kind("tip_body", tip_body, TipBody, PointMass, type(None))
    if tip_mass is None:
        return PointMass(0.0) if tip_body is None else tip_body
    if isinstance(tip_body, TipBody):
        raise ValueError(
            "tip_mass: the tip_body has a mass of its own: give TipBody(mass=..., offset=..., "
            "inertia=...) and no tip_mass"
        )
    return PointMass(real_scalar("tip_mass", tip_mass))
