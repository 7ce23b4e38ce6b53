"""Checks of concrete loads, motions and speeds by NumPy, before anything is compiled.

The rules are those of `loads_in_range` and of `Conditions.status`, which check all numbers, traced
ones too. Here a rule counts as broken only where concrete numbers break it.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np

from jaxbeam._rotor.loads import Loads
from jaxbeam._rotor.motion import Motion, Spin
from jaxbeam._rotor.spanwise import samples
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import is_concrete

_STRAY = 1e-9  # a component of this share of the largest one counts as zero


def refuse(throw: bool, *rules: tuple[bool, Status]) -> None:
    """Raise the error of the first rule that does not hold, with `throw`; rules are pairs of
    whether they hold and their status."""
    for holds, status in rules:
        if throw and not holds:
            raise_unless_ok(None, status)


def stays_in_plane(loads: Loads, motion: Motion | None = None) -> bool:
    """Whether no concrete load has a component out of the plane of rotation. Gravity counts in a
    steady state, and in a motion that is known to be about a3."""
    vectors = [_concrete(loads.tip_force), *_along_span(loads)]
    axis = _concrete(motion.axis) if isinstance(motion, Spin) else None
    if motion is None or (axis is not None and _small(axis[:2], axis)):
        vectors.append(_concrete(loads.gravity))
    return all(_small(v[2], v) for v in vectors if v is not None)


def rests_in_hub(loads: Loads, speeds: Iterable[Any]) -> bool:
    """Whether gravity is constant in the hub: along a3, or in a hub at rest. True for traced
    gravity and speeds."""
    gravity, numbers = _concrete(loads.gravity), [_concrete(speed) for speed in speeds]
    turns = any(speed is not None and speed != 0 for speed in numbers)
    return gravity is None or not turns or not gravity[:2].any()


def acts_along(loads: Loads) -> bool:
    """Whether no concrete load acts across the undeformed beam."""
    vectors = [_concrete(loads.gravity), _concrete(loads.tip_force), *_along_span(loads)]
    return all(_small(v[1:], v) for v in vectors if v is not None)


def is_finite(*arrays: Any) -> bool:
    """Whether all concrete arrays among these are finite."""
    return all(np.isfinite(a).all() for a in map(_concrete, arrays) if a is not None)


def _concrete(value: Any) -> np.ndarray | None:
    if value is None or callable(value) or not is_concrete(value):
        return None
    return np.asarray(value, float)


def _along_span(loads: Loads) -> list[np.ndarray]:
    """Concrete forces along the span: those on points, and a force per length that is constant."""
    components, points = loads.force_per_length, loads.point_forces
    forces = None if points is None else _concrete(points.forces)
    vectors = [] if forces is None else [*forces]
    if components is None or callable(components):
        return vectors
    numbers = [_concrete(samples(component)) for component in components]
    if any(a is None or a.ndim for a in numbers):
        return vectors
    return [*vectors, np.array(numbers)]


def _small(components: Any, whole: np.ndarray) -> bool:
    return bool(np.all(np.abs(components) <= _STRAY * np.abs(whole).max()))
