"""Blade files of OpenFAST's ElastoDyn, written."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxbeam._checks import check_kind, concrete_array
from jaxbeam._files.tables import DEGREES
from jaxbeam._files.texts import FilePath
from jaxbeam._rotor.beam import Beam
from jaxbeam._rotor.spanwise import AbstractSpanwise, Spanwise
from jaxbeam._types import is_concrete

_STEP = 1e-9  # distance, over L, of two stations of the file that are one step of a beam
# More stations, for properties that are not linear between stations
_MORE = np.linspace(0.0, 1.0, 51)
_TUNING = [("FlStTunr(1)", 1), ("FlStTunr(2)", 1), ("AdjBlMs", 1), ("AdjFlSt", 1), ("AdjEdSt", 1)]
_PITCH_AXIS = 0.25  # needed by aerodynamics alone


def write_elastodyn(
    path: FilePath,
    beam: Beam,
    *,
    flap: Sequence[Any],
    edge: Any,
    damping: Sequence[float] = (0.0, 0.0, 0.0),
    title: str = "written by jaxbeam",
) -> None:
    """Write a blade file of ElastoDyn (OpenFAST) with a beam and the shapes of its modes.

    `path` is where, `beam` a `Beam`, `title` a line of text in the file. `flap` are two rows, of
    the first two flap modes, and `edge` is one, of the first in plane, of coefficients of xi^2 to
    xi^6 that sum to one: `Modes.polynomials` of the blade at its speed. `damping` are ratios of
    these three modes, over the critical one, without unit.

    Stations are those of all properties together, where one is a function of x / L with 51
    equidistant ones; a step is written as two stations 1e-9 apart, since ElastoDyn wants them to
    increase; places nearer than twice that become one. Twist goes into the file in the sense of
    `BladeFormat`. ElastoDyn's blades do not stretch or twist: `axial_stiffness`,
    `torsional_stiffness` and `polar_inertia` are not in the file.

    `read_blade` reads it back.

    Raises `TypeError` unless all numbers are known, and `ValueError` where damping is out of range
    or coefficients do not sum to one within 0.0015, which ElastoDyn refuses.
    """
    check_kind("beam", beam, Beam)
    if not is_concrete(beam):
        raise TypeError("beam must be known: write the file outside of jax.jit, vmap and grad")
    shapes = {
        name: _coefficients(name, row)
        for name, row in zip(("BldFl1Sh", "BldFl2Sh"), _two(flap), strict=True)
    } | {"BldEdgSh": _coefficients("BldEdgSh", edge)}
    ratios = concrete_array("damping", damping)
    if ratios.shape != (3,) or not np.all((ratios >= 0) & (ratios < 1)):
        raise ValueError(f"damping must be three ratios from 0 to below 1, got {damping}")
    rows = _rows(beam)
    named = [("BldFlDmp(1)", ratios[0] * 100), ("BldFlDmp(2)", ratios[1] * 100)]
    named += [("BldEdDmp(1)", ratios[2] * 100)]
    lines = [
        "------- ELASTODYN V1.00.* INDIVIDUAL BLADE INPUT FILE --------------------------",
        title.splitlines()[0] if title else "",
        "---------------------- BLADE PARAMETERS ----------------------------------------",
        _line(len(rows), "NBlInpSt"),
        *(_line(value, name) for name, value in named),
        "---------------------- BLADE ADJUSTMENT FACTORS --------------------------------",
        *(_line(value, name) for name, value in _TUNING),
        "---------------------- DISTRIBUTED BLADE PROPERTIES ----------------------------",
        "BlFract PitchAxis StrcTwst BMassDen FlpStff EdgStff",
        "(-) (-) (deg) (kg/m) (Nm^2) (Nm^2)",
        *(" ".join(f"{value:.12g}" for value in row) for row in rows),
        "---------------------- BLADE MODE SHAPES ---------------------------------------",
        *(
            _line(value, f"{name}({power})")
            for name, row in shapes.items()
            for power, value in enumerate(row, 2)
        ),
    ]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _line(value: float, name: str) -> str:
    return f"{value:>20.12g}   {name}"


def _two(flap: Any) -> list[Any]:
    if not np.iterable(flap):
        raise TypeError(f"flap must be the coefficients of two modes, got {flap!r}")
    rows = list(flap)
    if len(rows) != 2:
        raise ValueError(f"flap must be the coefficients of two modes, got {len(rows)}")
    return rows


def _coefficients(name: str, row: Any) -> np.ndarray:
    values = concrete_array(name, row)
    if values.shape != (5,):
        raise ValueError(
            f"{name} must be five coefficients, of xi^2 to xi^6, got shape {values.shape}"
        )
    if not abs(values.sum() - 1) <= 0.0015:  # true for NaN
        raise ValueError(f"{name} must sum to one, got {values.sum():g}")
    return values


def _rows(beam: Beam) -> np.ndarray:
    """Rows of the table of stations, whose places increase."""
    if beam.point_masses is not None:
        raise ValueError(
            "point_masses: a blade file of ElastoDyn has none; leave them out, or spread them over "
            "mass_per_length"
        )
    twist = 0.0 if beam.twist is None else beam.twist
    given = (
        twist,
        beam.mass_per_length,
        beam.flap_bending_stiffness,
        beam.in_plane_bending_stiffness,
    )
    places = sorted({0.0, 1.0, *(float(x) for p in given for x in _stations(p))})
    first, last = _merged(places)
    before, behind = (
        np.stack([_values(p, at, side) for p in given], -1) for at, side in ((first, -1), (last, 1))
    )
    jumps = ~np.isclose(before, behind, rtol=_STEP, atol=0).all(1)
    end = np.where(last == 1, 1.0, first + _STEP * jumps)  # a step next to the tip ends at the tip
    table = np.concatenate([np.c_[end - _STEP, before][jumps], np.c_[end, behind]])
    at, twist, *others = table[np.argsort(table[:, 0])].T
    return np.stack([at, np.full(at.size, _PITCH_AXIS), twist / DEGREES, *others], -1)


def _merged(places: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """First and last of groups of places so near to each other that no two stations fit between
    them."""
    groups: list[list[float]] = []
    for x in places:
        if groups and x - groups[-1][0] <= 2 * _STEP:
            groups[-1].append(x)
        else:
            groups.append([x])
    return np.array([group[0] for group in groups]), np.array([group[-1] for group in groups])


def _stations(value: Any) -> Any:
    if isinstance(value, Spanwise):
        return value.stations
    return (*_MORE, *value.kinks) if isinstance(value, AbstractSpanwise) else ()


def _values(value: Any, at: np.ndarray, side: int) -> np.ndarray:
    """Values of a property at places, or just before (side -1) or after (1) a jump there."""
    if isinstance(value, Spanwise):
        places, values = np.asarray(value.stations), np.asarray(value.values)
        first = np.searchsorted(places, at, side="left")
        last = np.searchsorted(places, at, side="right") - 1
        own = first if side < 0 else last
        between = np.interp(at, places, values)
        return np.where(first <= last, values[np.clip(own, 0, places.size - 1)], between)
    if isinstance(value, AbstractSpanwise):
        beside = np.clip(at + 1e-12 * side, 0.0, 1.0)  # a property has no value at a kink
        return np.asarray(value.at(beside))
    return np.full(at.size, float(value))
