"""Springs at the root of a beam, and the mass or body at its tip."""

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._checks import check_kind, real_scalar, shaped_array
from jaxbeam._rotor.parameters import Parameters, optional, parameter, whole
from jaxbeam._status import Status
from jaxbeam._types import Number, Real, Scalar, is_concrete

_ROUNDED = 1e-6  # relative error allowed of an inertia, for numbers given with six digits


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
        """The value at the centre of mass of a function that has, at the tip, this value and this
        slope by x / length."""
        return value

    def second_moment(self, radius: Number) -> Number:
        """Moment of inertia about an axis across the beam at a distance from the centre of mass."""
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

    With all but the mass zero it is a point (nearly, in planar elements, which hold a body by a
    stiff spring). It turns with the end of the beam; its axes are those of the last section, which
    twist and pitch turn.

    Raises `TypeError` for what is no real number, and `ValueError` for what is not allowed.
    """

    is_body: ClassVar[bool] = True
    mass: Scalar = parameter(Status.INVALID_TIP_MASS, zero=True)
    offset: Scalar = parameter(Status.INVALID_TIP_BODY, zero=None)
    inertia: Scalar = parameter(Status.INVALID_TIP_BODY, zero=True)
    axial_inertia: Scalar = parameter(Status.INVALID_TIP_BODY, zero=True)
    flap_inertia: Scalar | None = optional(Status.INVALID_TIP_BODY, zero=True)

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
        """The value at the centre of mass of a function with a value and a slope at the tip, as of
        a `PointMass`."""
        return value + self.offset / length * slope

    def second_moment(self, radius: Number) -> Number:
        """Moment of inertia as of a `PointMass`, and of the body itself in the plane."""
        return self.mass * radius**2 + self.inertia

    @property
    def in_space(self) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
        """Centre of mass from the tip, and inertia about it, in axes of the last section."""
        flap = self.inertia if self.flap_inertia is None else self.flap_inertia
        about = jnp.diag(jnp.stack([self.axial_inertia, flap, self.inertia]))
        return self.offset * np.eye(3)[0], about


@jax.jit
def is_body_inertia(inertia: Float[Array, "3 3"]) -> Bool[Array, ""]:
    """Whether J can be the inertia of a body: int r r^T dm = tr(J) / 2 - J must be positive
    semidefinite. Then so is J, and no principal moment is more than the sum of the other two."""
    trace = jnp.trace(inertia)
    spread = trace / 2 * np.eye(3) - inertia
    return jnp.all(jnp.linalg.eigvalsh(spread) >= -_ROUNDED * trace)  # false for NaN


@jax.jit
def is_place(centre: Float[Array, "3"]) -> Bool[Array, ""]:
    """Whether all coordinates of a centre of mass are finite."""
    return jnp.all(jnp.isfinite(centre))


class RigidBody(Parameters):
    """A rigid body at the tip of a full inertia, with its centre of mass anywhere.

    | field          | symbol | meaning                                       | unit   | allowed |
    |----------------|--------|-----------------------------------------------|--------|---------|
    | mass           | m_t    |                                               | kg     | >= 0    |
    | centre_of_mass | c      | (3,) from the tip                             | m      | any     |
    | inertia        | J      | (3, 3), symmetric, about the centre of mass:  | kg m^2 | that of |
    |                |        | int (r.r - r r^T) dm, products with a minus   |        | a body  |

    Axes are those of the last section, which twist and pitch turn: along the blade, towards the
    leading edge, and a third one. Principal moments are >= 0, and none is more than the sum of the
    other two (to 1e-6 of the trace, for numbers that were rounded). `Rotor(tip_body=...)` takes it
    in the place of a `TipBody`; `SpatialRod` knows it, with all that a turning hub does to
    its products of inertia, and all other models refuse it by name.

    Raises `TypeError` for what are no real numbers, and `ValueError` for what is not allowed.
    """

    is_body: ClassVar[bool] = True
    mass: Scalar = parameter(Status.INVALID_TIP_MASS, zero=True)
    centre_of_mass: Float[Array, "3"] = whole(Status.INVALID_RIGID_BODY, is_place)
    inertia: Float[Array, "3 3"] = whole(Status.INVALID_RIGID_BODY, is_body_inertia)

    def __init__(self, mass: Real, centre_of_mass: Any, inertia: Any) -> None:
        self.mass = real_scalar("mass", mass)
        self.centre_of_mass = shaped_array("centre_of_mass", centre_of_mass, (3,))
        given = shaped_array("inertia", inertia, (3, 3))
        self.inertia = (given + given.T) / 2
        if is_concrete(given):
            each = np.asarray(given)
            if np.any(np.abs(each - each.T) > _ROUNDED * np.abs(each).max()):
                raise ValueError(f"inertia must be symmetric, got {each.tolist()}")

    def _given(self) -> Iterator[tuple[str, Mapping[str, Any]]]:
        yield "centre_of_mass", {}  # a feature, since models for a `TipBody` do not know it

    def centre(self, value: Any, slope: Any, length: Any = 1.0) -> Any:
        """The value at the centre of mass of a function with a value and a slope at the tip, as of
        a `PointMass`."""
        return value + self.centre_of_mass[0] / length * slope

    def second_moment(self, radius: Number) -> Number:
        """Moment of inertia as of a `PointMass`, and of the body itself in the plane."""
        return self.mass * (radius**2 + self.centre_of_mass[1] ** 2) + self.inertia[2, 2]

    @property
    def in_space(self) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
        """Centre of mass from the tip, and inertia about it, in axes of the last section."""
        return self.centre_of_mass, self.inertia


Tip = PointMass | TipBody | RigidBody


def tip_of(tip_mass: Real | None, tip_body: Any) -> Tip:
    """The mass or body at the tip, from the two arguments of `Rotor`, one of which must be None; a
    `tip_mass` may take the place of a `PointMass`."""
    check_kind("tip_body", tip_body, TipBody, RigidBody, PointMass, type(None))
    if tip_mass is None:
        return PointMass(0.0) if tip_body is None else tip_body
    if tip_body is not None and tip_body.is_body:
        raise ValueError(
            "tip_mass: the tip_body has a mass of its own: give TipBody(mass=..., offset=..., "
            "inertia=...) and no tip_mass"
        )
    return PointMass(real_scalar("tip_mass", tip_mass))
