"""Conversion of other units to SI."""

import math
from typing import Any

from jaxbeam._checks import plain, real_array, real_scalar

_RPM = math.pi / 30  # one turn per minute in rad/s


def rpm(speed: Any) -> Any:
    """A `speed` in turns per minute, of any shape, in rad/s: speed pi / 30.

    A number of Python gives one; numbers that are traced, arrays and lists give arrays of the same
    shape, (), (k,) and so on: `jaxbeam.modes(model, rotor, jaxbeam.rpm(12.1))`.

    Raises `TypeError` for what are no real numbers.
    """
    speed = plain(speed)
    if isinstance(speed, int | float):
        real_scalar("speed", speed)
        return speed * _RPM
    return real_array("speed", speed) * _RPM
