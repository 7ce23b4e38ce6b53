"""What is known of a scene before anything is compiled: numbers that are concrete, by NumPy.

The rules are those of `loads_in_range` and of `Conditions.status`, which look again at all numbers,
traced ones too. Here a rule is broken only where that is certain.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from jaxbeam._rotor.loads import Loads
from jaxbeam._rotor.motion import Motion, Spin
from jaxbeam._rotor.spanwise import samples
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import is_concrete

_STRAY = 1e-9  # what is but rounding, of what is beside it


def refuse(throw: bool, *rules: tuple[bool, Status]) -> None:
    """Raise the error of the first rule that is known not to hold, if failures are raised."""
    for holds, status in rules:
        if throw and not holds:
            raise_unless_ok(None, status)


def stays_in_plane(loads: Loads, motion: Motion | None = None) -> bool:
    """Whether none of the loads that are known leaves the plane of rotation, in a steady state or
    in a motion; gravity where that is known to turn about a3."""
    vectors = [_concrete(loads.tip_force), *_along_span(loads)]
    axis = _concrete(motion.axis) if isinstance(motion, Spin) else None
    if motion is None or (axis is not None and _small(axis[:2], axis)):
        vectors.append(_concrete(loads.gravity))
    return all(_small(v[2], v) for v in vectors if v is not None)


def rests_in_hub(loads: Loads, speeds: Iterable[Any]) -> bool:
    """Whether gravity, as far as it is known, does not turn in a hub of known speeds."""
    gravity, numbers = _concrete(loads.gravity), [_concrete(speed) for speed in speeds]
    turns = any(speed is not None and speed != 0 for speed in numbers)
    return gravity is None or not turns or not gravity[:2].any()


def acts_along(loads: Loads) -> bool:
    """Whether no load that is known acts across the undeformed beam."""
    vectors = [_concrete(loads.gravity), _concrete(loads.tip_force), *_along_span(loads)]
    return all(_small(v[1:], v) for v in vectors if v is not None)


def is_finite(*arrays: Any) -> bool:
    """Whether all that is known is finite."""
    return all(np.isfinite(a).all() for a in map(_concrete, arrays) if a is not None)


def _concrete(value: Any) -> np.ndarray | None:
    if value is None or callable(value) or not is_concrete(value):
        return None
    return np.asarray(value, float)


def _along_span(loads: Loads) -> list[np.ndarray]:
    """The force along the span where it is constant, and those on points: of what varies along it
    nothing is said."""
    parts, points = loads.force_per_length, loads.point_forces
    forces = None if points is None else _concrete(points.forces)
    found = [] if forces is None else [*forces]
    if parts is None or callable(parts):
        return found
    numbers = [_concrete(samples(part)) for part in parts]
    if any(a is None or a.ndim for a in numbers):
        return found
    return [*found, np.array(numbers)]


def _small(part: Any, whole: np.ndarray) -> bool:
    return bool(np.all(np.abs(part) <= _STRAY * np.abs(whole).max()))
