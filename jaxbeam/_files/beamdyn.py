"""Blades from the primary files and blade files of OpenFAST's BeamDyn."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxbeam._files.formats import BladeFormat, refuse_other
from jaxbeam._files.nrel import NamedValues, beside, count_of, named, number, require, table_rows
from jaxbeam._files.section_axes import (
    BEAMDYN,
    Axis,
    Piece,
    axis_of,
    blade_table,
    checked_sections,
    increasing,
    next_row,
    no_axis,
    seen_from,
    shares,
    six_rows,
    straight,
)
from jaxbeam._files.tables import FEATHER, BladeTable
from jaxbeam._files.texts import FilePath, entries, is_number, mistake, number_in, read_lines
from jaxbeam._types import Real

_KEYS = "kp_xr", "kp_yr", "kp_zr", "initial_twist"
ORDER = [2, 1, 0, 5, 4, 3]  # order of the six components of a `Blade` in the file, without signs
_MODAL = ("zeta is ignored: it is damping of modes, not of the blade.",)
_END = 1e-6  # distance of the last station from 1 that is allowed


def read_beamdyn(path: FilePath, *, length: Real | None = None) -> BladeTable:
    """A blade of full sections from the files of BeamDyn (OpenFAST).

    `path` is that of the primary file, which has the key points of the axis (kp_xr, kp_yr, kp_zr in
    m, initial_twist in deg) and names the blade file (BldFile), which is looked for beside it. The
    blade file alone has no axis: with its `length`, in m, it makes a blade that is straight and
    without twist.

    Its axes are x to the suction side, y to the trailing edge and z along the blade; here these are
    a3, -a2 and a1. Sections stand across the axis; the twist is about -z. Matrices are about the
    reference axis, in the order of forces along x, y, z and moments about them, at stations from 0
    to 1 of the length of arc, and linear between them. Where a matrix is not symmetric the mean is
    taken, with a warning if it is more than rounding. Through the key points of each member, and
    the twist there, go cubic splines over z (BeamDyn fits polynomials to them); members meet in
    kinks. Key points are kept as they are: where the first one is not at zero, the blade begins
    there.

    Returns a `BladeTable` whose `beam` is the `Blade`, and whose `damping` has the coefficients mu1
    to mu6 in its order where damp_type is 1.

    Source: the user's guide of BeamDyn in the documentation of OpenFAST.

    Raises `ValueError`, which names file, line and column of the first mistake, and `OSError` where
    the file cannot be read.
    """
    path = Path(path)
    lines = read_lines(path)
    said = named(lines, 0, None)
    if "kp_total" in said:
        if length is not None:
            raise ValueError(f"{path}: a primary file says the axis, so no length must be given")
        require(path, said, ("member_total", "kp_total", "bldfile"))
        axis = _axis(path, lines, said)
        path, lines = beside(path, said["bldfile"][0], "blade")
        said = named(lines, 0, None)
    elif "station_total" in said:
        if length is None:
            better = "read the primary file of BeamDyn, which names it as BldFile"
            raise no_axis(path, "a blade file of BeamDyn", better)
        axis = straight(length)
    if "station_total" not in said:
        refuse_other(path, lines, BladeFormat.BEAMDYN)
    require(path, said, ("station_total", "damp_type"))
    return _sections(path, lines, said, axis)


def _axis(path: Path, lines: Sequence[str], said: NamedValues) -> Axis:
    """The axis through the key points of a primary file."""
    members, total = (
        count_of(path, said[name][0].line, name, said[name][0].text)
        for name in ("member_total", "kp_total")
    )
    start = max(said[name][0].line for name in ("member_total", "kp_total"))
    counts = table_rows(path, lines, start, members, "member_total", 2)
    sizes = [count_of(path, line, "key points of the member", cells[1]) for line, cells in counts]
    if sum(sizes) - members + 1 != total:
        what = f"{total} key points, but members have {sizes}, and share those where they meet"
        raise mistake(path, said["kp_total"][0].line, "kp_total", what)
    start = counts[-1][0]
    start = next((i for i in range(start, len(lines)) if _is_row(lines[i], 4)), start)
    rows = table_rows(path, lines, start, total, "kp_total", 4)
    table = np.array([
        [number_in(path, line, *each) for each in zip(_KEYS, cells, strict=True)]
        for line, cells in rows
    ])  # fmt: skip
    increasing(path, "kp_zr", [line for line, _ in rows], table[:, 2].tolist())
    points, angles = table[:, :3] @ BEAMDYN.T, FEATHER * np.deg2rad(table[:, 3])
    pieces, first = [], 0
    for line, size in zip([line for line, _ in counts], sizes, strict=True):
        if size < 2:
            raise mistake(path, line, None, f"a member has two key points or more, got {size}")
        pieces.append(Piece(points[first : first + size], angles[first : first + size]))
        first += size - 1
    return axis_of(pieces)


def _sections(path: Path, lines: Sequence[str], said: NamedValues, axis: Axis) -> BladeTable:
    """The blade with the sections of a blade file, about an axis."""
    total = said["station_total"][0]
    count = count_of(path, total.line, "station_total", total.text)
    if count < 2:
        raise mistake(path, total.line, "station_total", f"must be 2 or more, got {count}")
    start = next((i for i, line in enumerate(lines) if "DISTRIBUTED" in line.upper()), None)
    if start is None:
        raise ValueError(f"{path}: no line has DISTRIBUTED PROPERTIES, behind which stations are")
    at, stations, starts, matrices = start + 1, list[float](), list[int](), list[np.ndarray]()
    for station in range(1, count + 1):
        row, at = next_row(path, lines, at, 1, f"station {station} of {count}")
        starts.append(row[0])
        stations.append(number_in(path, row[0], "station", row[1][0]))
        for name in "KM":
            matrix, at = six_rows(path, lines, at, name, f"station {station} of {count}, ")
            matrices.append(matrix)
    if abs(stations[-1] - 1) > _END:
        what = f"stations must end at 1, the tip, got {stations[-1]:g}"
        raise mistake(path, starts[-1], "station", what)
    places = shares(path, "station", starts, stations)
    stiffness, inertia = checked_sections(
        path, np.array(matrices[::2]), np.array(matrices[1::2]), starts
    )
    return blade_table(
        axis, places, seen_from(BEAMDYN, stiffness), seen_from(BEAMDYN, inertia),
        _MODAL if number(path, said, "damp_type", True) == 2 else (), _damping(path, lines, said),
    )  # fmt: skip


def _damping(path: Path, lines: Sequence[str], said: NamedValues) -> tuple[float, ...] | None:
    """Coefficients mu in the order of components of a `Blade`; None without damping."""
    if number(path, said, "damp_type", True) != 1:
        return None
    head = next((i for i, line in enumerate(lines) if line.split()[:1] == ["mu1"]), None)
    start = next((i for i in range(head or 0, len(lines)) if head and _is_row(lines[i], 6)), None)
    if start is None:
        raise ValueError(f"{path}: no row of numbers follows mu1 to mu6, and damp_type is 1")
    given = [
        number_in(path, start + 1, f"mu{i}", text, True)
        for i, text in enumerate(entries(lines[start])[:6], 1)
    ]
    return tuple(given[i] for i in ORDER)


def _is_row(line: str, width: int) -> bool:
    cells = entries(line)
    return len(cells) >= width and all(map(is_number, cells[:width]))
