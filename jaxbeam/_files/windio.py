"""Blades from turbines in windIO, versions 1 and 2."""

import itertools
import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxbeam._files.beamdyn import ORDER
from jaxbeam._files.formats import BladeFormat, refuse_other
from jaxbeam._files.section_axes import (
    BEAMDYN,
    Axis,
    Piece,
    Sixes,
    axis_of,
    blade_table,
    checked_sections,
    from_triangles,
    seen_from,
)
from jaxbeam._files.tables import FEATHER, BladeTable
from jaxbeam._files.texts import FilePath, as_number, mistake, read_lines
from jaxbeam._numerics.splines import spline_rows
from jaxbeam._rotor.points import PointMasses
from jaxbeam._rotor.sections import SIXES

_NAMES = [f"K{i + 1}{j + 1}" for i, j in zip(*SIXES, strict=True)]
_NEEDED = "K11 K22 K33 K44 K55 K66"  # entries that must be there; others are zero without them
_INERTIA = "mass cm_x cm_y i_edge i_flap i_plr i_cp"
_SAME = 1e-9  # distance of places on grids that count as equal
# Difference, over the length, between a grid and shares of the length of arc that is allowed.
_APART = 0.01
_END = 1e-5  # distance from the ends, over the length, in which no point mass may be
KeyPath = tuple[str, ...]


def read_windio(turbine: FilePath | Mapping[str, Any], *, component: str = "blade") -> BladeTable:
    """A blade of full sections from a turbine in windIO, version 1 or 2.

    `turbine` is the path of the YAML file, which takes the package PyYAML (`pip install
    "jaxbeam[yaml]"`), or what a YAML reader made of it; `component` is the name of the blade in
    components.

    Of version 1 elastic_properties_mb/six_x_six is read: stiff_matrix and inertia_matrix, 21
    numbers a station, reference_axis and twist (rad), or those of outer_shape_bem where they are
    missing. Of version 2 these are structure/elastic_properties with stiffness_matrix (K11 to K66)
    and inertia_matrix (mass, cm_x, cm_y, i_edge, i_flap, i_plr and i_cp, about the axis),
    structural_damping (mu) and point_mass, reference_axis, and the twist (deg) of outer_shape.

    Axes, order and the sense of twist are those of BeamDyn (`read_beamdyn`), in either version:
    x to the suction side, y to the trailing edge, z along the blade. (The descriptions of matrices
    in the schema of version 2 let x go to the trailing edge; turbines that are published do not.)
    Axis and twist are cubic splines over z through the points of their grids; where grids differ,
    each is a spline over its own first. Matrices are linear between stations, whose grid is the
    share of the length of arc; of an axis whose own grid is not, by more than 1 %, a warning says
    so.

    Returns a `BladeTable` whose `beam` is the `Blade`, with mu as `damping` unless it is zero, and
    a point mass at the tip as `tip_mass`.

    Sources: the ontology of windIO, versions 1.0 and 2.0, and turbines of IEA Wind in it.

    Raises `ImportError` without PyYAML, `ValueError`, which names the file and the keys of the
    first mistake, and `OSError` where the file cannot be read.
    """
    if isinstance(turbine, Mapping):
        path, tree = Path("turbine"), turbine
    else:
        path = Path(turbine)
        lines = read_lines(path)
        refuse_other(path, lines, BladeFormat.WINDIO)
        tree = _parsed(path, "\n".join(lines))
    top: KeyPath = ("components", component)
    blade = _within(path, tree, top)
    if "structure" in blade or "outer_shape" in blade:
        return _second(path, blade, top)
    return _first(path, blade, top)


def _parsed(path: Path, text: str) -> Any:
    try:
        import yaml
    except ImportError as error:
        what = 'a windIO file takes the package PyYAML: pip install "jaxbeam[yaml]"'
        raise ImportError(f"{path}: {what}, or parse it yourself") from error
    try:
        return yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise mistake(path, line, None, f"not YAML: {error.problem}") from error


def _first(path: Path, blade: Mapping[str, Any], top: KeyPath) -> BladeTable:
    """The blade of a file of version 1 of windIO."""
    keys: KeyPath = (*top, "elastic_properties_mb", "six_x_six")
    sections = _within(path, blade, keys, 2)
    shape: KeyPath = (*top, "outer_shape_bem")
    parts = [
        (sections[name], (*keys, name)) if name in sections
        else (_within(path, blade, (*shape, name), 2), (*shape, name))
        for name in ("reference_axis", "twist")
    ]  # fmt: skip
    axis = _axis(path, parts, FEATHER)
    grids, matrices = [], []
    for name in ("stiff_matrix", "inertia_matrix"):
        table = _within(path, sections, (*keys, name), len(keys))
        grids.append(_grid(path, table, (*keys, name)))
        rows = _within(path, table, (*keys, name, "values"), len(keys) + 1)
        numbers = [
            _numbers(path, row, (*keys, name, "values", f"station {i}"), len(SIXES[0]))
            for i, row in enumerate(_listed(path, rows, (*keys, name, "values"), len(grids[-1])), 1)
        ]
        matrices.append(from_triangles(np.array(numbers)))
    return _blade(path, axis, grids, matrices)


def _second(path: Path, blade: Mapping[str, Any], top: KeyPath) -> BladeTable:
    """The blade of a file of version 2 of windIO."""
    names = (*top, "reference_axis"), (*top, "outer_shape", "twist")
    parts = [(_within(path, blade, keys, 2), keys) for keys in names]
    axis = _axis(path, parts, FEATHER * math.pi / 180)
    keys: KeyPath = (*top, "structure", "elastic_properties")
    sections = _within(path, blade, keys, 2)
    grids, columns = [], []
    for name, needed, every in (
        ("stiffness_matrix", _NEEDED, _NAMES), ("inertia_matrix", _INERTIA, _INERTIA.split()),
    ):  # fmt: skip
        table = _within(path, sections, (*keys, name), len(keys))
        grid = _grid(path, table, (*keys, name))
        for each in needed.split():
            _within(path, table, (*keys, name, each), len(keys) + 1)
        columns.append({
            each: _numbers(path, table[each], (*keys, name, each), len(grid))
            if each in table else np.zeros(len(grid)) for each in every
        })  # fmt: skip
        grids.append(grid)
    stiff = from_triangles(np.stack([columns[0][name] for name in _NAMES], 1))
    masses = _masses(path, sections.get("point_mass"), (*keys, "point_mass"))
    mu = _mu(path, sections.get("structural_damping"), (*keys, "structural_damping", "mu"))
    table = _blade(path, axis, grids, [stiff, _inertia(**columns[1])], mu, masses)
    tip = sum(mass for place, mass in masses if place > 1 - _END)
    return table._replace(tip_mass=tip or None)


def _inertia(
    mass: np.ndarray, cm_x: np.ndarray, cm_y: np.ndarray, i_edge: np.ndarray, i_flap: np.ndarray,
    i_plr: np.ndarray, i_cp: np.ndarray,
) -> Sixes:  # fmt: skip
    own = np.zeros((len(mass), 6, 6))
    for (row, column), values in {
        (0, 0): mass, (1, 1): mass, (2, 2): mass, (0, 5): -mass * cm_y, (1, 5): mass * cm_x,
        (2, 3): mass * cm_y, (2, 4): -mass * cm_x, (3, 3): i_edge, (4, 4): i_flap, (5, 5): i_plr,
        (3, 4): -i_cp,
    }.items():  # fmt: skip
        own[:, row, column] = own[:, column, row] = values
    return own


def _masses(path: Path, table: Any, keys: KeyPath) -> list[tuple[float, float]]:
    """Places and masses of point masses on the blade, without those of no mass."""
    if table is None:
        return []
    grid = _numbers(path, _within(path, table, (*keys, "grid"), len(keys)), (*keys, "grid"))
    own = (*keys, "mass")
    mass = _numbers(path, _within(path, table, own, len(keys)), own, len(grid))
    return [(float(x), float(m)) for x, m in zip(grid, mass, strict=True) if m and x > _END]


def _mu(path: Path, table: Any, keys: KeyPath) -> tuple[float, ...] | None:
    if table is None or "mu" not in table:
        return None
    mu = _numbers(path, table["mu"], keys, 6)
    return tuple(float(mu[i]) for i in ORDER) if np.any(mu) else None


def _axis(path: Path, parts: Sequence[tuple[Any, KeyPath]], factor: float) -> Axis:
    """The axis from a line in space and the twist, each found below its keys."""
    line, twist = parts
    tables = {
        name: _table(path, _within(path, line[0], (*line[1], name), len(line[1])), (*line[1], name))
        for name in "xyz"
    } | {"twist": _table(path, *twist)}
    grid = np.sort(np.concatenate([own for own, _ in tables.values()]))
    grid = grid[np.concatenate([[True], np.diff(grid) > _SAME])]
    x, y, z, angle = (
        values if len(own) == len(grid) else spline_rows(own, grid)[0] @ values
        for own, values in tables.values()
    )
    _check_increase(path, z, (*line[1], "z"))
    axis = axis_of([Piece(np.stack([x, y, z], 1) @ BEAMDYN.T, factor * angle)])
    off = np.max(np.abs(axis.given - grid))
    if off > _APART:
        warnings.warn(
            f"{path}, {'/'.join(line[1])}: grid is not the share of the length of arc, but off by "
            f"{off:.2g} of the length; matrices are taken at shares of the length",
            stacklevel=4,
        )
    return axis


def _blade(
    path: Path, axis: Axis, grids: Sequence[np.ndarray], matrices: Sequence[Sixes],
    damping: tuple[float, ...] | None = None, masses: Sequence[tuple[float, float]] = (),
) -> BladeTable:  # fmt: skip
    """The blade from stiffness and inertia, each on its own grid."""
    stations = np.union1d(*grids)
    both = []
    for grid, own in zip(grids, matrices, strict=True):
        left = np.clip(np.searchsorted(grid, stations, side="right") - 1, 0, len(grid) - 2)
        share = ((stations - grid[left]) / (grid[left + 1] - grid[left]))[:, None, None]
        both.append((1 - share) * own[left] + share * own[left + 1])
    lines = [f"matrices at {station:g}" for station in stations]
    stiffness, inertia = checked_sections(path, both[0], both[1], lines)
    inner = [each for each in masses if each[0] <= 1 - _END]
    points = PointMasses(*map(list, zip(*inner, strict=True))) if inner else None
    return blade_table(
        axis, stations.tolist(), seen_from(BEAMDYN, stiffness), seen_from(BEAMDYN, inertia),
        damping=damping, point_masses=points,
    )  # fmt: skip


def _wrong(path: Path, keys: KeyPath, what: str) -> ValueError:
    return ValueError(f"{path}, {'/'.join(keys)}: {what}")


def _within(path: Path, tree: Any, keys: KeyPath, start: int = 0) -> Any:
    """The branch of a file below keys, the first `start` of which led to the tree."""
    for i in range(start, len(keys)):
        if not isinstance(tree, Mapping) or keys[i] not in tree:
            there = f"there are {', '.join(map(str, tree))}" if isinstance(tree, Mapping) else ""
            raise _wrong(path, keys[: i + 1], f"is missing; {there or 'nothing is there'}")
        tree = tree[keys[i]]
    return tree


def _listed(path: Path, values: Any, keys: KeyPath, count: int | None = None) -> Any:
    if not isinstance(values, Sequence | np.ndarray) or isinstance(values, str):
        raise _wrong(path, keys, f"must be a list, got {values!r}")
    if count is not None and len(values) != count:
        raise _wrong(path, keys, f"must be a list of {count}, got {len(values)}")
    return values


def _numbers(path: Path, values: Any, keys: KeyPath, count: int | None = None) -> np.ndarray:
    """A list of `count` finite numbers; YAML reads 1e5 as a text."""
    numbers = []
    for i, value in enumerate(_listed(path, values, keys, count), 1):
        try:
            number = as_number(value) if isinstance(value, str) else float(value)
        except (TypeError, ValueError):
            raise _wrong(path, keys, f"number {i} is no number, {value!r}") from None
        if not math.isfinite(number):
            raise _wrong(path, keys, f"number {i} must be finite, got {value}")
        numbers.append(number)
    return np.array(numbers)


def _grid(path: Path, table: Any, keys: KeyPath) -> np.ndarray:
    grid = _numbers(path, _within(path, table, (*keys, "grid"), len(keys)), (*keys, "grid"))
    if len(grid) < 2 or abs(grid[0]) > _SAME or abs(grid[-1] - 1) > _SAME:
        got = f"{grid[0]:g} to {grid[-1]:g}" if len(grid) else "nothing"
        raise _wrong(path, (*keys, "grid"), f"must go from 0 to 1, got {got}")
    _check_increase(path, grid, (*keys, "grid"))
    grid[0], grid[-1] = 0.0, 1.0
    return grid


def _check_increase(path: Path, values: np.ndarray, keys: KeyPath) -> None:
    for before, here in itertools.pairwise(values):
        if not here > before:
            raise _wrong(path, keys, f"must increase, got {here:g} after {before:g}")


def _table(path: Path, table: Any, keys: KeyPath) -> tuple[np.ndarray, np.ndarray]:
    """A grid and the values on it, found below keys of a table."""
    grid = _grid(path, table, keys)
    own = (*keys, "values")
    return grid, _numbers(path, _within(path, table, own, len(keys)), own, len(grid))
