"""Supports of either end of a beam: rigid, by springs or free, along and about three axes."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._checks import shaped_array
from jaxbeam._rotor.parameters import FULL_TURN, Parameters, optional
from jaxbeam._status import Status
from jaxbeam._types import Number, Real, Scalar

WAYS = ("along_1", "along_2", "along_3", "about_1", "about_2", "about_3")


def _spring() -> Any:
    return optional(Status.INVALID_SUPPORT, zero=True)


def _is_attitude(vector: Array) -> Array:
    return jnp.all(jnp.isfinite(vector)) & (jnp.sum(vector**2) <= FULL_TURN**2)


class Support(Parameters):
    """How an end of a beam is held to the hub, in three ways to shift and three to rotate.

    | field    | shape |                                                  | unit    | allowed      |
    |----------|-------|--------------------------------------------------|---------|--------------|
    | along_1  | ()    | spring against shifts along its first axis       | N/m     | >= 0 or None |
    | along_2  | ()    | along its second axis                            | N/m     | >= 0 or None |
    | along_3  | ()    | along its third axis                             | N/m     | >= 0 or None |
    | about_1  | ()    | spring against rotation about its first axis     | N m/rad | >= 0 or None |
    | about_2  | ()    | about its second axis                            | N m/rad | >= 0 or None |
    | about_3  | ()    | about its third axis                             | N m/rad | >= 0 or None |
    | attitude | (3,)  | rotation vector that takes the axes of the beam  | rad     | <= 2 pi long |
    |          |       | to those of the support                          |         | or None      |

    None: held rigidly, exactly; zero: free. So `Support()` is a clamp, `Support(about_1=0.0,
    about_2=0.0, about_3=0.0)` a ball joint, `Support(about_2=0.0)` a flapping hinge, and with
    `attitude=(0, 0, d3)` one whose axis is inclined. Of the tip, too: free along the beam alone it
    is guided, with `Support(0.0, 40.0, 0.0, 0.0, 0.0, 0.0)` it is on a spring across.

    Axes are 1 along the beam as it leaves the hub, 2 in the plane of rotation, the way it turns, 3
    across both: those of the hub, tilted by a `precone`, of both ends and however the beam is
    curved; pitch and twist do not turn them. The support turns with the hub. With u the
    displacement of the end, and phi the rotation vector of its section, both from where they are in
    the undeformed beam, the springs have the energy

        sum_k along_k (a_k . u)^2 / 2 + sum_k about_k (a_k . phi)^2 / 2,

    a_k the axes; what is held rigidly is a_k . u = 0 and a_k . phi = 0, the limit of stiff springs.
    So a hinge about one axis turns about that, however far, and one about two axes has its rotation
    vector in their plane. phi is up to a whole turn long; half a turn is beyond a hinge about two.

    Raises `TypeError` for what is no real number, and `ValueError` for what is not allowed.
    """

    along_1: Scalar | None = _spring()
    along_2: Scalar | None = _spring()
    along_3: Scalar | None = _spring()
    about_1: Scalar | None = _spring()
    about_2: Scalar | None = _spring()
    about_3: Scalar | None = _spring()
    attitude: Float[Array, "3"] | None = eqx.field(
        default=None,
        metadata={"status": Status.INVALID_SUPPORT, "valid": _is_attitude, "optional": True},
    )

    def __init__(
        self,
        along_1: Real | None = None,
        along_2: Real | None = None,
        along_3: Real | None = None,
        about_1: Real | None = None,
        about_2: Real | None = None,
        about_3: Real | None = None,
        attitude: Sequence[Any] | Array | None = None,
    ) -> None:
        self._take({**locals(), "attitude": None})
        if attitude is not None:
            self.attitude = shaped_array("attitude", attitude, (3,), ", a rotation vector in rad")

    @property
    def springs(self) -> tuple[Number | None, ...]:
        """Springs along and about the three axes, in the order of fields; None where rigid."""
        return tuple(getattr(self, name) for name in WAYS)
