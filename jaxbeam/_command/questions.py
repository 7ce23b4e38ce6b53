"""What a scene may ask: functions of one case, whose arguments are tables of parts, and keys of the
question's own table."""

import inspect
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

import jaxbeam as jb
from jaxbeam._checks import count_functions
from jaxbeam._rotor.directions import Counts
from jaxbeam._types import Real

Dims = dict[str, dict[str, list[Any]]]
Labels = tuple[jb.models.Label, ...]


def _counting(question: Callable[..., Any]) -> Callable[..., Any]:
    """The question with its `**counts` of modes, by direction, as named arguments."""
    every = inspect.signature(question)
    kind = inspect.Parameter.KEYWORD_ONLY
    counts = [inspect.Parameter(n, kind, default=0, annotation=int) for n in Counts.__annotations__]
    kept = [p for p in every.parameters.values() if p.kind is not p.VAR_KEYWORD]
    question.__signature__ = every.replace(parameters=[*kept, *counts])  # type: ignore[attr-defined]
    return question


@_counting
def _frequencies(
    model: Any,
    rotor: Any,
    angular_speed: Real,
    loads: Any = None,
    damping: Any = None,
    **counts: int,
) -> dict[str, Any]:
    which = _which(**counts)
    found = jb.modes(
        model, rotor, angular_speed, which, throw=False, **_there(loads=loads, damping=damping)
    )
    names = ("frequency", "frequency_hz", "growth_rate", "damping_ratio", "steady_strain", "status")
    return {name: getattr(found, name) for name in names}


@_counting
def _southwell(
    model: Any, rotor: Any, angular_speed: Real = 0.0, loads: Any = None, **counts: int
) -> dict[str, Any]:
    which = _which(**counts)
    given = _there(loads=loads)
    return vars(jb.southwell(model, rotor, angular_speed, which, throw=False, **given))


def _spin_up(
    model: Any, rotor: Any, motion: Any, until: float, points: int = 201,
    max_steps: int = 100_000, loads: Any = None, damping: Any = None,
) -> dict[str, Any]:  # fmt: skip
    given = _there(loads=loads, damping=damping)
    times = _times(until, points)
    run = jb.simulate(model, rotor, motion, times, max_steps=max_steps, throw=False, **given)
    value, when = jax.numpy.array([run.peak(direction) for direction in range(3)]).T
    names = ("tip", "hub_force", "hub_torque", "strain_energy", "energy", "imbalance", "status")
    return {"peak": value, "peak_time": when, **{name: getattr(run, name) for name in names}}


def _there(**given: Any) -> dict[str, Any]:
    return {name: value for name, value in given.items() if value is not None}


def _which(**keys: Any) -> Labels:
    counts = {name: keys[name] for name in Counts.__annotations__ if name in keys}
    for direction, count in counts.items():
        count_functions(direction, count)
    if not any(counts.values()):
        raise ValueError(f"asks for no mode: {', '.join(Counts.__annotations__)}: one must be > 0")
    return jb.labels(**counts)


def _times(until: float, points: int = 201, max_steps: int = 1, **_: Any) -> np.ndarray:
    count_functions("points", points, 2)
    count_functions("max_steps", max_steps, 1)
    if not 0 < until < np.inf:
        raise ValueError(f"until must be finite and > 0, got {until}")
    return np.linspace(0.0, until, points)


def _over_modes(*names: str) -> Callable[..., Dims]:
    return lambda **keys: {name: {"mode": list(_which(**keys))} for name in names}


def _over_time(**keys: Any) -> Dims:
    time, axis = {"time": _times(**keys).tolist()}, {"axis": ["a1", "a2", "a3"]}
    way = {"direction": ["axial", "in plane", "flap"]}
    dims = {"peak": way, "peak_time": way, "tip": time | way}
    dims |= {"hub_force": time | axis, "hub_torque": time | axis}
    return dims | dict.fromkeys(("strain_energy", "energy", "imbalance"), time)


QUESTIONS: dict[str, tuple[Callable[..., Any], Callable[..., Dims], str]] = {
    "frequencies": (
        _frequencies,
        _over_modes("frequency", "frequency_hz", "growth_rate", "damping_ratio"),
        "frequency (rad/s)",
    ),
    "southwell": (_southwell, _over_modes("coefficient"), "Southwell coefficient (-)"),
    "spin_up": (_spin_up, _over_time, "peak deflection of the tip (m)"),
}
