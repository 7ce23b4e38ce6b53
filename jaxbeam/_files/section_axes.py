"""Axes and sections of other programs as those of a `Blade`: what all their readers and writers
share."""

import itertools
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from jaxbeam._files.tables import BladeTable, Row
from jaxbeam._files.texts import entries, is_number, mistake, number_in
from jaxbeam._numerics.splines import spline_rows
from jaxbeam._rotor.blade import Blade
from jaxbeam._rotor.points import PointMasses
from jaxbeam._rotor.sections import SIXES, unsymmetric
from jaxbeam._types import Real

Sixes = Float[np.ndarray, "n 6 6"]
# Matrices from axes of a file to those of a `Blade`, all right-handed. BeamDyn and windIO: x to the
# suction side (downwind), y to the trailing edge, z along. HAWC2: x to the leading edge, y
# downwind, z along.
BEAMDYN = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
HAWC2 = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

# Accuracy of the axis of a `Blade`, over the length or in rad. If points of the file give the first
# accuracy, they are taken, so that a file that was written is read again as it was; else points are
# added to reach the second.
_EXACT, _BETTER = 1e-9, 2.5e-10
_HALVINGS = 12
_POOR = 1e-6  # error of an axis beyond which a warning follows
_NODES = 10


class Piece(NamedTuple):
    """Points of an axis between kinks, in axes of a `Blade`, and the twist there; splines go
    through them over the first coordinate, which increases."""

    points: Float[np.ndarray, "k 3"]
    twist: Float[np.ndarray, " k"]

    def at(self, along: Float[np.ndarray, " m"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points, slopes and twist at these values of the first coordinate."""
        value, slope = spline_rows(self.points[:, 0], along)
        return value @ self.points, slope @ self.points, value @ self.twist

    def arc(self, along: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Lengths of arc from the first point to these values of the first coordinate, by Gauss's
        rule between them."""
        every = np.union1d(self.points[:, 0], along)
        node, weight = np.polynomial.legendre.leggauss(_NODES)
        half = np.diff(every)[:, None] / 2
        _, slope, _ = self.at((every[:-1, None] + half * (1 + node)).ravel())
        speed = np.linalg.norm(slope, axis=1).reshape(-1, _NODES)
        length = np.concatenate([[0.0], np.cumsum(half[:, 0] * (speed @ weight))])
        found: np.ndarray = length[np.searchsorted(every, along)]
        return found


class Axis(NamedTuple):
    """The axis of a `Blade`, and where along it the points of the file are."""

    points: Float[np.ndarray, "k 3"]
    twist: Float[np.ndarray, " k"]
    places: list[float]
    kinks: list[float]
    length: float
    given: Float[np.ndarray, " p"]  # places of the file's points, as shares of the length


def axis_of(pieces: Sequence[Piece]) -> Axis:
    """The axis of a `Blade` through pieces one after the other, with as many points as its splines
    over the length of arc need."""
    scale = sum(float(piece.arc(piece.points[-1:, 0])[0]) for piece in pieces)
    along = [_enough(piece, scale) for piece in pieces]
    arcs = [piece.arc(own) for piece, own in zip(pieces, along, strict=True)]
    ends = np.concatenate([[0.0], np.cumsum([arc[-1] for arc in arcs])])
    length = ends[-1]
    points, twist, places, given = (list[np.ndarray]() for _ in range(4))
    for piece, own, arc, start in zip(pieces, along, arcs, ends[:-1], strict=True):
        skipped = slice(bool(points), None)  # its first point is the last one of the piece before
        place, (at, _, angle) = (start + arc) / length, piece.at(own)
        points.append(at[skipped])
        twist.append(angle[skipped])
        places.append(place[skipped])
        given.append(place[np.searchsorted(own, piece.points[:, 0])][skipped])
    kinks = [float(each[-1]) for each in places[:-1]]
    return Axis(
        np.concatenate(points), np.concatenate(twist), np.concatenate(places).tolist(), kinks,
        float(length), np.concatenate(given),
    )  # fmt: skip


def _enough(piece: Piece, length: float) -> np.ndarray:
    """Places of points: those of the piece, and halfway between them until splines are accurate."""
    along, allowed = piece.points[:, 0], _EXACT
    for _ in range(_HALVINGS):
        gaps = [along[:-1] + share * np.diff(along) for share in (1 / 3, 1 / 2, 2 / 3)]
        places = np.concatenate([along, *gaps])
        points, _, twist = piece.at(places)
        exact = np.concatenate([points / length, twist[:, None]], 1)
        arc, count = piece.arc(places), len(along)
        value, _ = spline_rows(arc[:count], arc[count:])
        off = np.max(np.abs(value @ exact[:count] - exact[count:]), axis=1)
        worst = np.max(off.reshape(len(gaps), -1), axis=0)
        if np.all(worst <= allowed):
            return along
        allowed = _BETTER
        along = np.sort(np.concatenate([along, gaps[1][worst > allowed]]))
    if np.max(worst) > _POOR:
        warnings.warn(
            f"the axis bends so much that splines are off by {np.max(worst):.1g} of its length: "
            "look at points that are near to each other",
            stacklevel=6,
        )
    return along


def straight(length: Real) -> Axis:
    """The straight axis of a known length, without twist."""
    whole = float(length)
    points = whole * np.eye(2, 3, -1)
    return Axis(points, np.zeros(2), [0.0, 1.0], [], whole, np.array([0.0, 1.0]))


def no_axis(path: Path, what: str, better: str) -> ValueError:
    return ValueError(
        f"{path} is {what}, which has no axis: {better}, or give length, in m, which makes the "
        "blade straight and without twist"
    )


def blade_table(
    axis: Axis, stations: Sequence[float], stiffness: Sixes, inertia: Sixes,
    ignored: Sequence[str] = (), damping: tuple[float, ...] | None = None,
    point_masses: PointMasses | None = None,
) -> BladeTable:  # fmt: skip
    """The result of a reader, from sections in axes of a `Blade`, with concrete numbers also within
    a function that is traced."""
    with jax.ensure_compile_time_eval():
        blade = Blade(
            stations, stiffness, inertia, axis.points, axis.twist, axis.places, axis.kinks,
            point_masses,
        )  # fmt: skip
    return BladeTable(blade, tuple(ignored), damping=damping)


def shift(along: np.ndarray, across: np.ndarray) -> Sixes:
    """Matrices (n, 6, 6) from strains (or velocities) at the reference point to those at points of
    sections, at `along` and `across` in the first and second axis of a file whose third is along
    the blade. A stiffness K at the points is S^T K S at the reference point."""
    made = np.broadcast_to(np.eye(6), (len(along), 6, 6)).copy()
    made[:, 0, 5], made[:, 1, 5] = -across, along
    made[:, 2, 3], made[:, 2, 4] = across, -along
    return made


def about_third(angles: np.ndarray) -> Sixes:
    """Matrices (n, 6, 6) whose columns are axes turned about the third one by angles."""
    cos, sin = np.cos(angles), np.sin(angles)
    made = np.zeros((len(angles), 6, 6))
    for at in (0, 3):
        made[:, at, at], made[:, at, at + 1] = cos, -sin
        made[:, at + 1, at], made[:, at + 1, at + 1] = sin, cos
        made[:, at + 2, at + 2] = 1.0
    return made


def seen_from(axes: np.ndarray, matrices: Sixes) -> Sixes:
    """Matrices in other axes, which are the rows of `axes`."""
    both = np.kron(np.eye(2), axes)
    seen: Sixes = both @ matrices @ both.T
    return seen


def from_triangles(rows: Float[np.ndarray, "n 21"]) -> Sixes:
    """Symmetric matrices from upper triangles, given row by row."""
    made = np.zeros((len(rows), 6, 6))
    made[:, SIXES[0], SIXES[1]] = rows
    made[:, SIXES[1], SIXES[0]] = rows
    return made


def checked_sections(
    path: Path, stiffness: Sixes, inertia: Sixes, lines: Sequence[int | str]
) -> tuple[Sixes, Sixes]:
    """Matrices for a `Blade`, made symmetric.

    `lines` say where in the file each station begins. Raises unless stiffnesses are positive
    definite and inertias have a mass, and warns of what is more than rounding.
    """
    stiffness, inertia = (
        _symmetric(path, name, matrices, lines)
        for name, matrices in (("stiffness", stiffness), ("mass", inertia))
    )
    for line, k, m in zip(lines, stiffness, inertia, strict=True):
        size = np.sqrt(np.abs(np.diagonal(k)))
        size = np.where(size > 0, size, 1.0)
        least = np.linalg.eigvalsh(k / np.outer(size, size))[0]
        if not least > 0:
            raise mistake_at(
                path, line, f"the stiffness matrix must be positive definite, and is not: the "
                f"smallest eigenvalue, with the diagonal scaled to one, is {least:.3g}; look at "
                "signs and at the order of rows",
            )  # fmt: skip
        own = np.diagonal(m)
        if not (np.all(own[:3] > 0) and np.all(own[3:] >= 0)):
            raise mistake_at(
                path, line, "the mass matrix must have a mass > 0 and moments of inertia >= 0, "
                f"got the diagonal {own.tolist()}",
            )  # fmt: skip
    return stiffness, inertia


def six_rows(
    path: Path, lines: Sequence[str], at: int, name: str, where: str = ""
) -> tuple[np.ndarray, int]:
    """The matrix of six rows of numbers from a line on, and the place behind it."""
    matrix = np.zeros((6, 6))
    for i in range(1, 7):
        (line, cells), at = next_row(path, lines, at, 6, f"{where}row {i} of {name}")
        matrix[i - 1] = [
            number_in(path, line, f"{name}{i}{j}", text) for j, text in enumerate(cells, 1)
        ]
    return matrix, at


def next_row(path: Path, lines: Sequence[str], at: int, width: int, what: str) -> tuple[Row, int]:
    """The next line that is neither empty nor a bar, with `width` numbers, and the place behind
    it."""
    while at < len(lines) and not lines[at].strip(" =\t"):
        at += 1
    cells = entries(lines[at]) if at < len(lines) else []
    if len(cells) < width or (len(cells) > width and is_number(cells[width])):
        got = f"{len(cells)} entries" if cells else "the end of the file"
        need = f"{width} numbers are" if width > 1 else "a number is"
        raise mistake(path, min(at + 1, len(lines)), None, f"{what}: {need} needed, got {got}")
    return (at + 1, cells[:width]), at + 1


def mistake_at(path: Path, line: int | str, what: str) -> ValueError:
    if isinstance(line, int):
        return mistake(path, line, None, what)
    return ValueError(f"{path}, {line}: {what}")


def _symmetric(path: Path, name: str, matrices: Sixes, lines: Sequence[int | str]) -> Sixes:
    if (found := unsymmetric(matrices)) is not None:
        station, row, column = found
        pair = matrices[station, row, column], matrices[station, column, row]
        where = lines[station]
        where = f"line {where}" if isinstance(where, int) else where
        warnings.warn(
            f"{path}, {where}: the {name} matrix is not symmetric, {pair[0]:g} and {pair[1]:g} in "
            f"rows {row + 1} and {column + 1}; the mean is taken",
            stacklevel=5,
        )
    return (matrices + matrices.swapaxes(1, 2)) / 2


def increasing(path: Path, column: str, lines: Sequence[int], values: Sequence[float]) -> None:
    """Raise `ValueError` unless values that splines are taken over increase."""
    for line, (before, here) in zip(lines[1:], itertools.pairwise(values), strict=True):
        if not here > before:
            raise mistake(path, line, column, f"must increase, got {here:g} after {before:g}")


def shares(path: Path, column: str, lines: Sequence[int], values: Sequence[float]) -> list[float]:
    """Places along the axis as shares of the last one, where two may be equal: a step."""
    last = values[-1]
    if not last > 0 or values[0] != 0:
        line, got = (lines[0], values[0]) if values[0] else (lines[-1], last)
        raise mistake(path, line, column, f"stations must go from 0 to the tip, got {got:g}")
    for i, (before, here) in enumerate(itertools.pairwise(values), 1):
        if here < before:
            what = f"stations must not decrease, got {here:g} after {before:g}"
            raise mistake(path, lines[i], column, what)
        if here == before and (here in (0, last) or values[i + 1] == here):
            what = f"a step is two equal stations between the ends, got {here:g}"
            raise mistake(path, lines[i], column, what)
    return [value / last for value in values]
