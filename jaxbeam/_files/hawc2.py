"""Blades from HAWC2: sections of its st files, with fully populated matrices, and main bodies."""

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._files.formats import BladeFormat, refuse_other
from jaxbeam._files.nrel import table_rows
from jaxbeam._files.section_axes import (
    HAWC2,
    Axis,
    Piece,
    Sixes,
    about_third,
    axis_of,
    blade_table,
    checked_sections,
    from_triangles,
    increasing,
    no_axis,
    seen_from,
    shares,
    shift,
    straight,
)
from jaxbeam._files.tables import BladeTable, Row, ignoring
from jaxbeam._files.texts import FilePath, entries, is_number, mistake, number_in, read_lines
from jaxbeam._rotor.sections import frames
from jaxbeam._types import Real

COLUMNS = """
r m x_cg y_cg ri_x ri_y pitch x_e y_e K11 K12 K13 K14 K15 K16 K22 K23 K24 K25 K26 K33 K34 K35 K36
K44 K45 K46 K55 K56 K66
""".split()  # noqa: SIM905
# Properties that must be positive (False) or may be zero, too (True).
_SIGNS = {"m": False, "ri_x": True, "ri_y": True}
_ISOTROPIC = 19  # number of columns of a file without FPM
_BODY = "blade1"
# Relative difference of moments of inertia by which two meanings of radii are told apart.
_APART = 0.01
_UPWARDS = 3  # number of folders above that of an htc file that names of files may be relative to


class _MainBody(NamedTuple):
    """A main body of an htc file: words of its lines after their names, with line numbers."""

    name: str
    said: dict[str, tuple[int, list[str]]]
    axis: list[Row]


def read_hawc2(
    path: FilePath,
    *,
    length: Real | None = None,
    body: str | None = None,
    gyration_about_mass_centre: bool | None = None,
) -> BladeTable:
    """A blade of full sections from an htc file of HAWC2 and the st file that it names.

    `path` is that of the htc file. Its main body `body` is read, by default the only one, or
    "blade1": the c2_def, and of its timoschenko_input the filename, FPM, which must be 1, and the
    set (1 1 if none is named). Names of files may begin in the folder of the htc file or in one
    above it. An st file alone has no axis: with its `length`, in m, its set 1 1 makes a blade that
    is straight and without twist.

    The axes are x to the leading edge, y downwind and z along the blade; here these are a2, a3 and
    a1. The axis is that of c2_def, the half chord, by cubic splines over z; sections stand across
    it, and twist (deg) is the angle from x, about +z, at which their first axis is seen along z:
    the angle about the axis that it makes is a spline, too. In the st file r is the length of arc,
    matrices are about the elastic centre (x_e, y_e) in axes turned by pitch (deg, about +z), in the
    order of forces along x, y, z and moments about them, and (x_cg, y_cg) is the centre of mass.
    Matrices that they make about the axis are linear between stations.

    ri_x and ri_y are radii of gyration about the elastic centre, about the turned axes. Some
    programs write those about the centre of mass: `gyration_about_mass_centre` says which they are,
    and None reads them as HAWC2 does, with a warning where it matters. Other warnings are of
    matrices that seem to be about the axis, of a c2_def whose half chord seems to be on the other
    side of the axis of pitch, and of an r that ends elsewhere than c2_def.

    Returns a `BladeTable` whose `beam` is the `Blade`.

    Source: T. J. Larsen, A. M. Hansen, How 2 HAWC2, the user's manual, Risø-R-1597.

    Raises `ValueError`, which names file, line and column of the first mistake, and `OSError` where
    the file cannot be read.
    """
    path = Path(path)
    lines = read_lines(path)
    if any(re.match(r"\s*begin\s+\w+", line, re.I) for line in lines):
        if length is not None:
            raise ValueError(f"{path}: c2_def says the axis, so no length must be given")
        chosen = _chosen(path, _bodies(path, lines), body)
        axis = _axis(path, chosen)
        number, subset = _set(path, chosen)
        ignored = [
            ignoring(name, [], {name: "damping is an argument of a simulation"})
            for name in chosen.said if name.startswith("damping")
        ]  # fmt: skip
        path, lines = _sections_beside(path, chosen)
    else:
        refuse_other(path, lines, BladeFormat.HAWC2)
        if length is None:
            better = "read the htc file, whose c2_def is the axis"
            raise no_axis(path, "an st file of HAWC2", better)
        axis, number, subset, ignored = straight(length), 1, 1, []
    rows = _rows(path, lines, number, subset)
    numbers = np.array([
        [
            number_in(path, line, name, text, _SIGNS.get(name))
            for name, text in zip(COLUMNS, cells, strict=True)
        ]
        for line, cells in rows
    ])  # fmt: skip
    starts = [line for line, _ in rows]
    places = shares(path, "r", starts, numbers[:, 0].tolist())
    if abs(numbers[-1, 0] / axis.length - 1) > _APART:
        warnings.warn(
            f"{path}, line {starts[-1]}: r ends at {numbers[-1, 0]:g} m, and the axis is "
            f"{axis.length:g} m long: r is taken in proportion",
            stacklevel=2,
        )
    stiffness = _stiffness(path, numbers)
    inertia = _inertia(path, starts, numbers, gyration_about_mass_centre)
    stiffness, inertia = checked_sections(path, stiffness, inertia, starts)
    return blade_table(
        axis, places, seen_from(HAWC2, stiffness), seen_from(HAWC2, inertia), ignored
    )


def twist_of(slope: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """The twist of a `Blade` whose sections have their second axis at these angles, from a2 to a3,
    when seen along the blade."""
    own, across = _across(slope)
    seen = np.stack([0 * angle, np.cos(angle), np.sin(angle)], 1)
    # The component along the blade, so that the axis is across.
    seen[:, 0] = -np.sum(seen * slope, 1) / slope[:, 0]
    twist = np.arctan2(np.sum(seen * across, 1), np.sum(seen * own, 1))
    return _near(twist, angle)


def angle_of(slope: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """The angle at which the second axis of sections is seen along the blade, from the twist."""
    own, across = _across(slope)
    second = np.cos(twist)[:, None] * own + np.sin(twist)[:, None] * across
    return _near(np.arctan2(second[:, 2], second[:, 1]), twist)


def _across(slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Second and third axis of sections without twist, from the derivative of the axis."""
    with jax.ensure_compile_time_eval():  # concrete, also within a function that is traced
        axes = np.asarray(frames(jnp.asarray(slope), jnp.zeros(len(slope))))
    _, own, across = np.moveaxis(axes, 2, 0)
    return own, across


def _near(angle: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Angles changed by whole turns to be within half a turn of others."""
    near: np.ndarray = other + np.mod(angle - other + np.pi, 2 * np.pi) - np.pi
    return near


def _bodies(path: Path, lines: Sequence[str]) -> list[_MainBody]:
    """Main bodies of an htc file, with their blocks timoschenko_input and c2_def."""
    found: list[_MainBody] = []
    blocks: list[str] = []
    for number, line in enumerate(lines, 1):
        words = line.split(";")[0].split()
        if not words:
            continue
        name = words[0].lower()
        if name == "begin":
            blocks.append(words[1].lower() if len(words) > 1 else "")
            found += [_MainBody("", {}, [])] if blocks[-1] == "main_body" else []
        elif name == "end":
            blocks = blocks[:-1]
        elif "main_body" in blocks:
            if name == "sec" and blocks[-1] == "c2_def":
                found[-1].axis.append((number, words[2:]))
            elif name == "name" and blocks[-1] == "main_body" and len(words) > 1:
                found[-1] = found[-1]._replace(name=words[1])
            else:
                found[-1].said[name] = number, words[1:]
    return [body for body in found if body.axis]


def _chosen(path: Path, bodies: Sequence[_MainBody], name: str | None) -> _MainBody:
    wanted = [body for body in bodies if body.name == (name or _BODY)]
    wanted = list(bodies) if name is None and len(bodies) == 1 else wanted
    if len(wanted) == 1:
        return wanted[0]
    names = ", ".join(body.name for body in bodies)
    if not bodies:
        raise ValueError(f"{path}: no main_body has a c2_def; it may be in another file, which a "
                         "line continue_in_file names: read that")  # fmt: skip
    raise ValueError(
        f"{path}: {len(wanted)} main bodies with a c2_def are called {name or _BODY}, of {names}: "
        "name one as body"
    )


def _axis(path: Path, body: _MainBody) -> Axis:
    titles = "x", "y", "z", "twist"
    for line, cells in body.axis:
        if len(cells) < len(titles):
            raise mistake(path, line, "sec", "a number, x, y, z and twist are needed")
    lines = [line for line, _ in body.axis]
    table = np.array([
        [number_in(path, line, *each) for each in zip(titles, cells, strict=False)]
        for line, cells in body.axis
    ])  # fmt: skip
    if len(table) < 2:
        raise mistake(path, lines[0], "sec", "two or more are needed")
    increasing(path, "z", lines, table[:, 2].tolist())
    _warn_of_side(path, table)
    angle = np.deg2rad(table[:, 3])
    piece = Piece(table[:, :3] @ HAWC2.T, angle)
    _, slope, _ = piece.at(table[:, 2])
    return axis_of([piece._replace(twist=twist_of(slope, angle))])


def _warn_of_side(path: Path, table: np.ndarray) -> None:
    """Warn where the line of half chords seems to be on the wrong side of the pitch axis.

    Where the chord is turned by the twist, a half chord that is x off the pitch axis along the
    chord is x tan(twist) off it in y. Smooth offsets besides are prebend.
    """
    x, y, z, twist = table.T
    along = x * np.tan(np.deg2rad(twist))
    if len(z) < 8 or np.ptp(along) < 1e-3 * np.ptp(z):
        return
    smooth = np.polynomial.chebyshev.chebvander(2 * (z - z[0]) / np.ptp(z) - 1, 4)
    rest = [part - smooth @ np.linalg.lstsq(smooth, part, rcond=None)[0] for part in (along, y)]
    factor = rest[0] @ rest[1] / (rest[0] @ rest[0])
    if abs(factor + 1) < 0.2 and np.linalg.norm(rest[1] + rest[0]) < 0.3 * np.linalg.norm(rest[1]):
        warnings.warn(
            f"{path}: y of c2_def goes as - x tan(twist): the half chord is off the axis of pitch "
            "on the other side than twist says, so one of them may have the wrong sign",
            stacklevel=4,
        )


def _set(path: Path, body: _MainBody) -> tuple[int, int]:
    line, words = body.said.get("fpm", (body.axis[0][0], ["0"]))
    if words[:1] != ["1"]:
        what = (
            "main bodies are read that have FPM 1, fully populated matrices; others have sections"
        )
        raise mistake(path, line, "FPM", f"{what} of another kind, in 19 columns")
    line, words = body.said.get("set", (0, ["1", "1"]))
    if len(words) < 2 or not all(word.isdigit() for word in words[:2]):
        raise mistake(path, line, "set", f"must be two whole numbers, got {' '.join(words)}")
    return int(words[0]), int(words[1])


def _sections_beside(path: Path, body: _MainBody) -> tuple[Path, list[str]]:
    """The path of the st file that a main body names, and its lines."""
    if "filename" not in body.said:
        raise ValueError(f"{path}: main body {body.name} has no filename of its sections")
    line, words = body.said["filename"]
    name = " ".join(words).strip("\"'").replace("\\", "/")
    folders = [path.parent, *path.resolve().parent.parents[:_UPWARDS]]
    there = next((folder / name for folder in folders if (folder / name).is_file()), None)
    if there is None:
        what = f"there is no file {name} beside {path.name} or in the folders above"
        raise mistake(path, line, "filename", what)
    return there, read_lines(there)


def _rows(path: Path, lines: Sequence[str], number: int, subset: int) -> list[Row]:
    """Rows of one subset of one set of an st file."""
    lines = [line.split(";")[0] for line in lines]
    start = _line_of(lines, rf"\s*#\s*{number}(?!\d)", 0)
    if start is not None:
        start = _line_of(lines, rf"\s*\$\s*{subset}(?!\d)", start)
    if start is None:
        raise ValueError(f"{path}: there is no set #{number} with a subset ${subset}")
    words = lines[start].replace("$", " $ ").split()
    count = int(words[2]) if len(words) > 2 and words[2].isdigit() else 0
    if count < 2:
        raise mistake(
            path, start + 1, f"${subset}", "the number of stations must follow, 2 or more"
        )
    first = entries(lines[start + 1]) if start + 1 < len(lines) else []
    if sum(map(is_number, first)) == _ISOTROPIC:
        what = f"{_ISOTROPIC} columns, as for FPM 0; read are {len(COLUMNS)}, with FPM 1"
        raise mistake(path, start + 2, None, what)
    return table_rows(path, lines, start + 1, count, f"${subset}", len(COLUMNS))


def _line_of(lines: Sequence[str], pattern: str, start: int) -> int | None:
    return next((i for i in range(start, len(lines)) if re.match(pattern, lines[i])), None)


def _stiffness(path: Path, numbers: np.ndarray) -> Sixes:
    pitch, x, y = np.deg2rad(numbers[:, 6]), numbers[:, 7], numbers[:, 8]
    own, axes, to = from_triangles(numbers[:, 9:]), about_third(pitch), shift(x, y)
    matrices: Sixes = axes @ own @ axes.swapaxes(1, 2)
    centre, there = tension_centre(matrices), np.stack([x, y], 1)
    far = np.linalg.norm(there, axis=1) > 0.01 * np.sqrt(
        np.trace(matrices[:, 3:5, 3:5], axis1=1, axis2=2) / matrices[:, 2, 2]
    )
    off = np.linalg.norm(centre - there, axis=1) < 0.1 * np.linalg.norm(there, axis=1)
    if np.sum(off & far) > len(far) / 2:
        warnings.warn(
            f"{path}: matrices have their tension centre at (x_e, y_e) from their reference point, "
            "as if they were about the axis already; HAWC2 takes them about (x_e, y_e), and so "
            "they are read",
            stacklevel=3,
        )
    whole: Sixes = to.swapaxes(1, 2) @ matrices @ to
    return whole


def tension_centre(matrices: Sixes) -> np.ndarray:
    """Places (n, 2) across sections at which a force along them bends nothing, from the reference
    point, in axes and in the order of HAWC2."""
    soft = np.linalg.inv(matrices)
    off = np.linalg.solve(soft[:, 3:5, 3:5], soft[:, 3:5, 2:3])[:, :, 0]
    return np.stack([off[:, 1], -off[:, 0]], 1)


def _inertia(
    path: Path, lines: Sequence[int], numbers: np.ndarray, about_mass: bool | None
) -> Sixes:
    mass, x, y, first, second = numbers[:, 1:6].T
    own = np.zeros((len(mass), 6, 6))
    for i, radius in enumerate((first**2, second**2, first**2 + second**2)):
        own[:, i, i], own[:, 3 + i, 3 + i] = mass, mass * radius
    axes, to = about_third(np.deg2rad(numbers[:, 6])), shift(x, y)
    own = axes @ own @ axes.swapaxes(1, 2)
    off = shift(x - numbers[:, 7], y - numbers[:, 8])[:, :3, 3:]
    more = np.zeros_like(own)
    more[:, 3:, 3:] = mass[:, None, None] * off.swapaxes(1, 2) @ off
    either = [to.swapaxes(1, 2) @ (own - part) @ to for part in (more, 0 * more)]
    size = [np.diagonal(each, axis1=1, axis2=2)[:, 3:] for each in either]
    apart = np.max(np.abs(size[0] / size[1] - 1), axis=1)
    worst = int(np.argmax(apart))
    if about_mass is None and apart[worst] > _APART:
        warnings.warn(
            f"{path}, line {lines[worst]}: ri_x and ri_y are read as radii of gyration about the "
            "elastic centre, as HAWC2 does; about the centre of mass, as some programs write them, "
            f"moments of inertia would differ by {100 * apart[worst]:.2g} %: say which by "
            "gyration_about_mass_centre",
            stacklevel=3,
        )
    least = np.linalg.eigvalsh((own - more)[:, 3:, 3:])[:, 0]
    if not about_mass and np.any(least < -1e-9 * own[:, 5, 5]):
        what = "the centre of mass is further from the elastic centre than radii about that allow"
        line = lines[int(np.argmin(least))]
        raise mistake(path, line, "ri_x", f"{what}: give gyration_about_mass_centre=True")
    return either[bool(about_mass)]
