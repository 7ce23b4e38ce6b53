"""Blades from sections that VABS has analysed, one in a file."""

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxbeam._checks import real_scalar
from jaxbeam._files.formats import BladeFormat, refuse_other
from jaxbeam._files.section_axes import checked_sections, seen_from, six_rows
from jaxbeam._files.tables import BladeTable
from jaxbeam._files.texts import FilePath, read_lines
from jaxbeam._rotor.blade import Blade

_MASS = r"the\s+6\s*x\s*6\s+mass\s+matrix\s*$"
_STIFFNESS = r"timoshenko\s+stiffness\s+matrix"
_CLASSICAL = r"classical\s+stiffness\s+matrix"
_TRAPEZE = r"trapeze\s+effect"


def read_vabs(
    paths: Sequence[FilePath],
    stations: Sequence[float],
    axis: Any,
    twist: Any = None,
    axis_stations: Sequence[float] | None = None,
    kinks: Sequence[float] = (),
    *,
    x2_angle: float = 0.0,
) -> BladeTable:
    """A blade of full sections from files of VABS (.K), one for each station.

    `paths` (n,) are those of the files, and `stations` (n,) the places of their sections along the
    axis, from 0 to 1 as shares of its length. `axis`, `twist`, `axis_stations` and `kinks` are as
    those of a `Blade`, of which VABS knows nothing.

    Read are "The 6X6 Mass Matrix" and the "Timoshenko Stiffness Matrix", about the origin of the
    drawing, in the order of a `Blade`: along x1, shear along x2 and x3, torsion, bending about x2
    and x3. x1 goes along the blade. `x2_angle` (rad) is that of x2 from the second axis of sections
    (the leading edge, without twist) towards the third one: zero if the section was drawn with x2
    to the leading edge and x3 downwind, pi if both are the other way. Units must have been SI; a
    file does not say them. Trapeze matrices are not used, which `ignored` says.

    Returns a `BladeTable` whose `beam` is the `Blade`.

    Source: the manual of VABS.

    Raises what `Blade` does, `ValueError`, which names file, line and column of the first mistake,
    and `OSError` where a file cannot be read.
    """
    if isinstance(paths, str) or not isinstance(paths, Sequence):
        raise TypeError(f"paths must be a list, one for each of stations, got {paths!r}")
    if len(paths) != len(stations):
        raise ValueError(f"paths must be as many as stations, {len(stations)}, got {len(paths)}")
    angle = float(real_scalar("x2_angle", x2_angle))
    if not abs(angle) <= 2 * math.pi:
        raise ValueError(f"x2_angle must be within a turn, in rad, got {x2_angle}")
    cos, sin = math.cos(angle), math.sin(angle)
    axes = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    sections = {path: _section(path) for path in map(Path, paths)}
    stiffness, inertia = (
        seen_from(axes, np.concatenate([sections[Path(path)][i] for path in paths])) for i in (0, 1)
    )
    blade = Blade(stations, stiffness, inertia, axis, twist, axis_stations, kinks)
    told = [f"{path}: {what}" for path, (_, _, left) in sections.items() for what in left]
    return BladeTable(blade, tuple(told))


def _section(path: Path) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Stiffness and inertia (1, 6, 6) of a file, and sentences about its entries that are
    ignored."""
    lines = read_lines(path)
    refuse_other(path, lines, BladeFormat.VABS)
    found = {
        name: next((i for i, line in enumerate(lines) if re.search(name, line, re.I)), None)
        for name in (_MASS, _STIFFNESS, _CLASSICAL, _TRAPEZE)
    }
    mass, stiffness = found[_MASS], found[_STIFFNESS]
    if mass is None:
        raise ValueError(f"{path}: there is no line The 6X6 Mass Matrix")
    if stiffness is None:
        there = "the classical one alone" if found[_CLASSICAL] is not None else "none"
        raise ValueError(
            f"{path}: there is no Timoshenko Stiffness Matrix, but {there}: let VABS make one, "
            "since shear is needed"
        )
    k, _ = six_rows(path, lines, stiffness + 1, "K")
    m, _ = six_rows(path, lines, mass + 1, "M")
    k, m = checked_sections(path, k[None], m[None], [stiffness + 1])
    left = ["Trapeze matrices are ignored."] if found[_TRAPEZE] is not None else []
    return k, m, left
