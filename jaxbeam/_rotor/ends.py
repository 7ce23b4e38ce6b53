"""What a beam is held by at its root, and what it carries at its tip."""

from jaxbeam._rotor.parameters import Parameters, optional, parameter
from jaxbeam._status import Status
from jaxbeam._types import Real, Scalar


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


class TipBody(Parameters):
    """What makes a rigid body of the mass at the tip: a payload, a tip brake, a tuning mass.

    | field         | symbol | meaning                                          | unit   | allowed |
    |---------------|--------|--------------------------------------------------|--------|---------|
    | offset        | c      | of its centre of mass, beyond the tip            | m      | any     |
    | inertia       | J      | about its centre, across the beam, as it turns   | kg m^2 | >= 0    |
    |               |        | where the beam bends in plane                    |        |         |
    | axial_inertia | J_x    | about the beam's axis (a rod: 0; a ball: J)      | kg m^2 | >= 0    |
    | flap_inertia  | J_f    | as `inertia`, where the beam bends in flap; the  | kg m^2 | >= 0 or |
    |               |        | same unless it is given                          |        | None    |

    Its mass is the `tip_mass` of the rotor; with all of these zero it is a point (nearly, in
    elements, which hold a body by a stiff spring). It turns with the end of the beam; its axes are
    those of the last section, which twist and pitch turn.

    Raises `TypeError` for what is no real number, and `ValueError` for what is not allowed.
    """

    offset: Scalar = parameter(Status.INVALID_TIP_BODY, zero=None)
    inertia: Scalar = parameter(Status.INVALID_TIP_BODY, zero=True)
    axial_inertia: Scalar = parameter(Status.INVALID_TIP_BODY, zero=True)
    flap_inertia: Scalar | None = optional(Status.INVALID_TIP_BODY, zero=True)

    def __init__(
        self,
        offset: Real = 0.0,
        inertia: Real = 0.0,
        axial_inertia: Real = 0.0,
        flap_inertia: Real | None = None,
    ) -> None:
        self._take(locals())
