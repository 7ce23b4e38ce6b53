"""Files of OpenFAST's BeamDyn, written."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxbeam._checks import check_kind, concrete_array
from jaxbeam._files.beamdyn import ORDER
from jaxbeam._files.section_axes import BEAMDYN, seen_from
from jaxbeam._files.tables import FEATHER
from jaxbeam._files.texts import FilePath
from jaxbeam._rotor.blade import Blade
from jaxbeam._rotor.sections import full_matrices
from jaxbeam._types import is_concrete

_CONTROL = (
    ("False", "Echo"), ("True", "QuasiStaticInit"), ("0", "rhoinf"), ("2", "quadrature"),
    ("DEFAULT", "refine"), ("DEFAULT", "n_fact"), ("DEFAULT", "DTBeam"),
    ("DEFAULT", "load_retries"), ("DEFAULT", "NRMax"), ("DEFAULT", "stop_tol"),
    ("DEFAULT", "tngt_stf_fd"), ("DEFAULT", "tngt_stf_comp"), ("DEFAULT", "tngt_stf_pert"),
    ("DEFAULT", "tngt_stf_difftol"), ("True", "RotStates"),
)  # fmt: skip
_ORDER = 10  # order of BeamDyn's elements
_AFTER = (
    ("False", "UsePitchAct"), ("0.0", "PitchJ"), ("0.0", "PitchK"), ("0.0", "PitchC"),
)  # fmt: skip
_OUTPUTS = (("False", "SumPrint"), ('"ES15.6E3"', "OutFmt"), ("0", "NNodeOuts"), ("1", "OutNd"))


def known_blade(blade: Blade, form: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Concrete numbers of a blade that a file can hold: points of the axis, twist, stiffness,
    inertia."""
    check_kind("blade", blade, Blade)
    if not is_concrete(blade):
        raise TypeError("blade must be known: write the file outside of jax.jit, vmap and grad")
    if blade.point_masses is not None:
        raise ValueError(
            f"point_masses: a blade file of {form} has none; leave them out, or spread them over "
            "inertia"
        )
    if blade.gyration is not None:
        raise ValueError(f"gyration: a blade file of {form} has none; leave it out")
    axis, twist = np.asarray(blade.axis), np.asarray(blade.twist)
    if not np.all(np.diff(axis[:, 0]) > 0):
        raise ValueError(
            f"axis: the first coordinate of its points, which {form} has splines over, must "
            f"increase, got {axis[:, 0].tolist()}"
        )
    stiffness, inertia = (
        np.asarray(full_matrices(rows)) for rows in (blade.stiffness, blade.inertia)
    )
    return axis, twist, stiffness, inertia


def write_beamdyn(
    path: FilePath,
    blade: Blade,
    *,
    damping: Sequence[float] | None = None,
    title: str = "written by jaxbeam",
) -> None:
    """Write a `Blade` as a primary file of BeamDyn and a blade file beside it.

    `path` is that of the primary file, and "_blade" behind its stem makes that of the other one.
    `blade` is the blade; its points are key points, its kinks where members meet, and its
    matrices stand at its stations, all with as many digits as it has. `damping` are the six factors
    (s) of stiffnesses that make damping of them, in the order of sixes of a blade, as
    `BladeTable.damping` has them; None is damp_type 0. `title` is the second line of both.

    `read_beamdyn` reads it back. Controls of BeamDyn are at their defaults.

    Raises `TypeError` unless all numbers are known, and `ValueError` for point masses and
    `gyration`, for an axis that turns back, and for damping below zero.
    """
    path = Path(path)
    axis, twist, stiffness, inertia = known_blade(blade, "BeamDyn")
    factors = np.zeros(6) if damping is None else concrete_array("damping", damping)
    if factors.shape != (6,) or not np.all((factors >= 0) & np.isfinite(factors)):
        raise ValueError(f"damping must be six factors of zero or more, in s, got {damping}")
    beside = path.with_name(f"{path.stem}_blade{path.suffix}")
    title = title.splitlines()[0] if title else ""
    ends = [0, *(blade.axis_stations.index(kink) for kink in blade.kinks), len(axis) - 1]
    rows = np.concatenate([axis @ BEAMDYN, np.rad2deg(FEATHER * twist)[:, None]], 1)
    primary = [
        "--------- BEAMDYN with OpenFAST INPUT FILE -------------------------------------",
        title,
        "---------------------- SIMULATION CONTROL --------------------------------------",
        *(_line(*each) for each in _CONTROL),
        "---------------------- GEOMETRY PARAMETER --------------------------------------",
        _line(len(ends) - 1, "member_total"),
        _line(len(axis), "kp_total"),
        *(f"{i} {end - start + 1}" for i, (start, end) in enumerate(itertools.pairwise(ends), 1)),
        "kp_xr kp_yr kp_zr initial_twist",
        "(m) (m) (m) (deg)",
        *numbers_of(rows),
        "---------------------- MESH PARAMETER ------------------------------------------",
        _line(_ORDER, "order_elem"),
        "---------------------- MATERIAL PARAMETER --------------------------------------",
        _line(f'"{beside.name}"', "BldFile"),
        "---------------------- PITCH ACTUATOR PARAMETERS -------------------------------",
        *(_line(*each) for each in _AFTER),
        "---------------------- OUTPUTS -------------------------------------------------",
        *(_line(*each) for each in _OUTPUTS),
        "OutList",
        "END",
    ]
    matrices = (seen_from(BEAMDYN.T, each) for each in (stiffness, inertia))
    mu = np.zeros(6)
    mu[ORDER] = factors
    sections = [
        "------- BEAMDYN V1.00.* INDIVIDUAL BLADE INPUT FILE ----------------------------",
        title,
        "---------------------- BLADE PARAMETERS ----------------------------------------",
        _line(len(blade.stations), "station_total"),
        _line(int(damping is not None), "damp_type"),
        "---------------------- DAMPING COEFFICIENT -------------------------------------",
        "mu1 mu2 mu3 mu4 mu5 mu6",
        "(-) (-) (-) (-) (-) (-)",
        *numbers_of(mu[None]),
        "---------------------- DISTRIBUTED PROPERTIES ----------------------------------",
    ]
    for station, k, m in zip(blade.stations, *matrices, strict=True):
        sections += [repr(station), *numbers_of(k), "", *numbers_of(m), ""]
    for file, lines in ((path, primary), (beside, sections)):
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _line(value: object, name: str) -> str:
    return f"{value!s:>20}   {name}"


def numbers_of(rows: np.ndarray) -> list[str]:
    """Rows of numbers as text with all digits, and without negative zeros."""
    return [" ".join(f"{value:.17g}" for value in row) for row in rows + 0.0]
