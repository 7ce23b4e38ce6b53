"""The discrete analogue of a rotating beam (Y: see `_models/contract/__init__.py`)."""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._rotor.parameters import Parameters, parameter
from jaxbeam._status import Status
from jaxbeam._types import Number, Real, Scalar


class SpringRotor(Parameters):
    """The discrete analogue of a rotating beam (Y, section 6, Fig. 10, Table 2).

    A particle slides in a massless tube that is hinged at the distance `hub_radius` from the axis;
    one spring acts along the tube, one at the hinge.

    | field                 | symbol | unit   | allowed |
    |-----------------------|--------|--------|---------|
    | mass                  | m      | kg     | > 0     |
    | length                | L      | m      | > 0     |
    | hub_radius            | d      | m      | any     |
    | translational_spring  | k_T    | N/m    | > 0     |
    | torsional_spring      | k_r    | N m    | > 0     |

    Raises `TypeError` for what is no real number, and `ValueError` for what is not allowed.
    """

    # What it has not, and is asked for as any rotor is.
    varies: ClassVar[bool] = False
    pitch: ClassVar[None] = None
    precone: ClassVar[None] = None
    root_springs: ClassVar[None] = None
    root_support: ClassVar[None] = None
    tip_support: ClassVar[None] = None
    springs: ClassVar[tuple[None, None]] = (None, None)
    mass: Scalar = parameter(Status.INVALID_MASS)
    length: Scalar = parameter(Status.INVALID_LENGTH)
    hub_radius: Scalar = parameter(Status.INVALID_HUB_RADIUS, zero=None)
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
        """Frequency scale (k_r / (m L^2))^(1/2), in rad/s."""
        return jnp.sqrt(self.torsional_spring / self.mass) / self.length

    @property
    def compliance(self) -> Float[Array, "2"]:
        """Deflection of the tip by a moment about the hinge, in 1/N: in plane, and zero in flap."""
        return jnp.stack([self.length / self.torsional_spring, jnp.zeros_like(self.length)])
