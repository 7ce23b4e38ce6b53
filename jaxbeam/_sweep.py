"""Run one function over many cases: labelled grids and lists, in chunks, with nothing lost."""

import csv
import dataclasses
import json
import math
import os
import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._status import Status


@dataclasses.dataclass(frozen=True)
class Cases:
    """Named parameters of N cases. Made by `grid` or `listed`.

    `columns[name]` holds the value of each parameter in each case, shape (N,); `axes` the
    coordinates of the dimensions that the cases are laid out along, with product of lengths N.
    """

    columns: dict[str, np.ndarray]
    axes: dict[str, np.ndarray]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def grid(**axes: Any) -> Cases:
    """Cartesian product, the last axis fastest: `grid(angular_speed=[0.0, 1.0], tip_mass=[0])`."""
    coords = {name: _column(name, values) for name, values in _some(axes).items()}
    for name, column in coords.items():
        if len(np.unique(column)) < len(column):
            raise ValueError(f"{name} must not repeat values in a grid")
    mesh = np.meshgrid(*coords.values(), indexing="ij")
    return Cases({n: m.ravel() for n, m in zip(coords, mesh, strict=True)}, coords)


def listed(**columns: Any) -> Cases:
    """Explicit cases, one for each position in the equally long columns."""
    values = {name: _column(name, column) for name, column in _some(columns).items()}
    lengths = {name: len(column) for name, column in values.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns must be equally long, got {lengths}")
    n = next(iter(lengths.values()))
    return Cases(values, {"case": np.arange(n)})


def _some(named: dict[str, Any]) -> dict[str, Any]:
    if not named:
        raise ValueError("name at least one parameter, as in grid(angular_speed=[0.0, 1.0])")
    return named


def _column(name: str, values: Any) -> np.ndarray:
    column = np.asarray(values)
    if column.ndim != 1 or column.size == 0:
        raise ValueError(f"{name} must be one-dimensional and not empty, got {column.shape}")
    if isinstance(values, list | tuple | range) and np.issubdtype(column.dtype, np.integer):
        column = column.astype(float)  # [0, 1, 2] typed by hand means numbers
    if not np.issubdtype(column.dtype, np.floating):
        raise TypeError(f"{name} must be real floating-point numbers, got {column.dtype}")
    if name == "status":
        raise ValueError("status is the name of the outcome, not of a parameter")
    return column.astype(float)


@dataclasses.dataclass(frozen=True)
class Table:
    """Labelled arrays: the results of a sweep.

    `values[name]` is an array whose leading dimensions are those of the cases, `dims[name]` names
    its dimensions, `coords` holds coordinates by dimension. `status` is among the values (see
    `Status`); `errors` maps the flat number of a case that raised to its message. Parameters of an
    explicit list are values too, along the dimension "case".
    """

    values: dict[str, np.ndarray]
    dims: dict[str, tuple[str, ...]]
    coords: dict[str, np.ndarray]
    errors: dict[int, str] = dataclasses.field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.values:
            raise KeyError(f"no values named {name!r}; there are {sorted(self.values)}")
        return self.values[name]

    def sel(self, **at: Any) -> Self:
        """The part of the table at these coordinates, by value: `table.sel(tip_mass=0.5)`.

        A number must be a coordinate to a relative 1e-9, a list of numbers keeps that dimension,
        a slice takes all coordinates between its ends, both included. In an explicit list the
        parameters select cases and keep the dimension "case".
        """
        table = self
        for name, wanted in at.items():
            table = table._sel(name, wanted)
        return table

    def _sel(self, name: str, wanted: Any) -> Self:
        if name in self.coords:
            dim, column = name, self.coords[name]
        elif self.dims.get(name) == ("case",):
            dim, column = "case", self.values[name]
        else:
            raise KeyError(f"no dimension named {name!r}; there are {sorted(self.coords)}")
        if isinstance(wanted, slice):
            if wanted.step is not None or column.dtype.kind == "U":
                raise ValueError(f"{name}: a slice is from one number to another, without step")
            keep, slack = np.ones(column.shape, bool), _slack(column)
            if wanted.start is not None:
                keep &= column >= wanted.start - slack
            if wanted.stop is not None:
                keep &= column <= wanted.stop + slack
            index: Any = np.flatnonzero(keep)
        elif isinstance(wanted, list | np.ndarray) or type(wanted) is tuple:  # a Label is one name
            found = [_find(name, column, w) for w in wanted]
            index = np.concatenate(found) if found else np.zeros(0, int)
        else:
            index = _find(name, column, wanted)
            if dim == name:
                index = int(index[0])
        return self.take(dim, index)

    def take(self, dim: str, index: Any) -> Self:
        """The part at these positions along a dimension."""
        values = {
            n: np.take(v, index, axis=self.dims[n].index(dim)) if dim in self.dims[n] else v
            for n, v in self.values.items()
        }
        gone = np.ndim(index) == 0
        dims = {n: tuple(d for d in ds if not (gone and d == dim)) for n, ds in self.dims.items()}
        coords = dict(self.coords)
        if gone:
            del coords[dim]
        else:
            coords[dim] = coords[dim][index]
        return dataclasses.replace(
            self, values=values, dims=dims, coords=coords, errors=self._moved(dim, index)
        )

    def _moved(self, dim: str, index: Any) -> dict[int, str]:
        """Messages under the flat case numbers of the part that is taken."""
        dims = self.dims["status"]
        if not self.errors or dim not in dims:
            return self.errors
        shape = self.values["status"].shape
        numbers = np.arange(math.prod(shape)).reshape(shape)
        kept = np.take(numbers, index, axis=dims.index(dim)).ravel()
        return {i: self.errors[int(n)] for i, n in enumerate(kept) if int(n) in self.errors}

    def message(self, **at: Any) -> str:
        """What became of one case, in words."""
        part = self.sel(**at)
        if part.values["status"].size != 1:
            raise ValueError("message: name one case by all its coordinates")
        status = Status(int(part.values["status"].item()))
        return part.errors.get(0, status.message)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all of it to a NumPy archive (.npz), without pickling."""
        meta = {"dims": self.dims, "errors": self.errors}
        with open(path, "wb") as file:
            arrays: dict[str, Any] = {"meta": np.asarray(json.dumps(meta))}
            arrays |= {f"value:{n}": v for n, v in self.values.items()}
            arrays |= {f"coord:{n}": c for n, c in self.coords.items()}
            np.savez_compressed(file, **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read what `save` wrote."""
        with np.load(path, allow_pickle=False) as file:
            meta = json.loads(str(file["meta"]))

            def part(kind: str) -> dict[str, np.ndarray]:
                return {n[6:]: file[n] for n in file.files if n.startswith(kind)}

            return cls(
                values=part("value:"),
                dims={n: tuple(d) for n, d in meta["dims"].items()},
                coords=part("coord:"),
                errors={int(i): text for i, text in meta["errors"].items()},
            )

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """One line a case: its coordinates, then every value, further dimensions as columns."""
        lead = self.dims["status"]
        shape = self.values["status"].shape
        columns: dict[str, np.ndarray] = {}
        mesh = np.meshgrid(*(self.coords[d] for d in lead), indexing="ij")
        columns |= {d: m.ravel() for d, m in zip(lead, mesh, strict=True)}
        for name, value in self.values.items():
            if self.dims[name][: len(lead)] != lead:
                continue
            rest = self.dims[name][len(lead) :]
            flat = value.reshape(math.prod(shape), *value.shape[len(lead) :])
            for index in np.ndindex(flat.shape[1:]):
                marks = [str(self.coords[d][i]) for d, i in zip(rest, index, strict=True)]
                title = f"{name}[{', '.join(marks)}]" if marks else name
                column = flat[(slice(None), *index)]
                if np.iscomplexobj(column):
                    columns |= {f"{title}.real": column.real, f"{title}.imag": column.imag}
                else:
                    columns[title] = column
        with open(path, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            # repr of a Python float reads back to the same float
            writer.writerows(zip(*(c.tolist() for c in columns.values()), strict=True))

    def to_xarray(self) -> Any:
        """The same as an `xarray.Dataset`; needs the package xarray."""
        try:
            import xarray
        except ImportError as error:
            raise ImportError("to_xarray needs the package xarray: pip install xarray") from error
        return xarray.Dataset({n: (self.dims[n], v) for n, v in self.values.items()}, self.coords)


def _slack(column: np.ndarray) -> float:
    """How far a number may be from a coordinate: 1e-9 of the smallest distance between two."""
    gaps = np.diff(np.unique(column[np.isfinite(column)]))
    scale = float(gaps.min()) if gaps.size else float(np.abs(column[:1]).max(initial=0.0))
    return 1e-9 * scale


def _find(name: str, column: np.ndarray, wanted: Any) -> np.ndarray:
    if column.dtype.kind == "U":
        found = np.flatnonzero(column == str(wanted))
        if not found.size:
            raise KeyError(f"{name} has no coordinate {str(wanted)!r}; there are {column.tolist()}")
        return found
    if isinstance(wanted, bool) or not isinstance(wanted, int | float | np.number):
        raise TypeError(f"{name} must be selected by numbers, got {wanted!r}")
    found = np.flatnonzero(np.isclose(column, wanted, rtol=1e-9, atol=_slack(column)))
    if not found.size:
        near = float(column[np.nanargmin(np.abs(column - wanted))])
        raise KeyError(f"{name} has no coordinate {wanted!r}, nearest {near}")
    return found


def sweep(
    function: Callable[..., Any],
    cases: Cases,
    *,
    chunk: int = 256,
    progress: bool | None = None,
    dims: Mapping[str, Mapping[str, Sequence[Any]]] | None = None,
) -> Table:
    """Evaluate `function(**parameters)` for every case and collect the results by name.

    The function is written for one case: it takes the parameters of `cases` as scalars, by name,
    and returns an array, or a dictionary, dataclass or `eqx.Module` of arrays. It is compiled once
    (again only for another function object, so what it reads from outside is frozen: bind arrays
    that change between sweeps with `jax.tree_util.Partial(function, *arrays)`) and vectorised over
    `chunk` cases at a time, which bounds the memory it needs; results go to NumPy as they come.

    One failing case never touches another. If the result has an entry `status` it is the status of
    the case; otherwise a case is `NOT_FINITE` when any of its results is not. A case that raises
    inside the compiled code (`eqx.error_if`) is found by halving its chunk, gets
    `Status.RAISED`, NaN (or zero) results and its message in `Table.errors`, and the others are
    kept. Asking for a status (`modes(..., throw=False)`) is much faster than raising.

    `dims` names further dimensions of a result and their coordinates, as in
    `dims={"frequency": {"mode": ["1", "2"]}}`. `progress` shows a line on stderr as chunks end;
    by default only in sweeps that last longer than two seconds.
    """
    if isinstance(chunk, bool) or not isinstance(chunk, int) or chunk < 1:
        raise ValueError(f"chunk must be an int >= 1, got {chunk!r}")
    n = len(cases)
    chunk = min(chunk, n)
    report = _Progress(n, progress)
    collected: dict[str, np.ndarray] | None = None
    errors: dict[int, str] = {}

    def run(index: np.ndarray) -> dict[str, np.ndarray]:
        # The last chunk, or a part of one, is filled up: one shape, one compilation.
        filled = np.resize(index, chunk)
        columns = {name: jnp.asarray(column[filled]) for name, column in cases.columns.items()}
        result = jax.device_get(_batched(function, columns))
        return {name: leaf[: len(index)] for name, leaf in _named(result).items()}

    for start in range(0, n, chunk):
        index = np.arange(start, min(start + chunk, n))
        for part, result in _isolated(run, index):
            if isinstance(result, str):
                errors[int(part[0])] = result
                continue
            if collected is None:
                collected = {k: _blank(v, n) for k, v in result.items()}
            for name, leaf in result.items():
                collected[name][part] = leaf
        report(int(index[-1]) + 1)
    report.end()
    if collected is None:
        raise RuntimeError(f"every case raised; the first one said: {errors[0]}")
    return tabled(cases, collected, errors, dims or {})


@eqx.filter_jit  # its errors, unlike those of jax.jit, say only what went wrong
def _batched(function: Callable[..., Any], columns: dict[str, jax.Array]) -> Any:
    return jax.vmap(lambda parameters: function(**parameters))(columns)


def _isolated(
    run: Callable[[np.ndarray], dict[str, np.ndarray]], index: np.ndarray
) -> list[tuple[np.ndarray, dict[str, np.ndarray] | str]]:
    """Results of the cases in `index` in parts, a message for each case that raises alone."""
    try:
        return [(index, run(index))]
    except eqx.EquinoxRuntimeError as error:  # not other errors of the machine, say of memory
        if len(index) == 1:
            return [(index, _said(error))]
        half = len(index) // 2
        return _isolated(run, index[:half]) + _isolated(run, index[half:])


def _said(error: Exception) -> str:
    """The sentence in an exception, without the stacks that equinox writes around it."""
    found = re.search(r"EquinoxRuntimeError: (.*?)(?:\n\n|$)", str(error), re.DOTALL)
    return found.group(1) if found else str(error).strip().split("\n")[0]


def _named(result: Any) -> dict[str, np.ndarray]:
    """Leaves of a result by the path to them: "frequency", "a.b", or "value" for a lone array."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(result)
    if not leaves:
        raise TypeError("the swept function must return at least one array")
    return {
        jax.tree_util.keystr(path, simple=True, separator=".") or "value": np.asarray(leaf)
        for path, leaf in leaves
    }


def _blank(like: np.ndarray, n: int) -> np.ndarray:
    shape = (n, *like.shape[1:])
    if np.issubdtype(like.dtype, np.inexact):
        return np.full(shape, np.nan, like.dtype)
    return np.zeros(shape, like.dtype)


def tabled(
    cases: Cases,
    collected: dict[str, np.ndarray],
    errors: dict[int, str],
    extra: Mapping[str, Mapping[str, Sequence[Any]]],
) -> Table:
    """Results of all cases, in their order, as a table."""
    n = len(cases)
    lead, shape = tuple(cases.axes), tuple(len(a) for a in cases.axes.values())
    if "status" not in collected:
        finite = np.ones(n, bool)
        for value in collected.values():
            if np.issubdtype(value.dtype, np.inexact):
                finite &= np.isfinite(value).reshape(n, -1).all(1)
        collected["status"] = np.where(finite, Status.OK, Status.NOT_FINITE)
    if collected["status"].shape != (n,) or collected["status"].dtype.kind != "i":
        raise ValueError("the entry status of a result must be an integer scalar, see Status")
    for i in errors:
        collected["status"][i] = Status.RAISED
    coords = dict(cases.axes)
    values: dict[str, np.ndarray] = {}
    dims: dict[str, tuple[str, ...]] = {}
    if lead == ("case",):
        values |= cases.columns
        dims |= dict.fromkeys(cases.columns, lead)
    unknown = set(extra) - set(collected)
    if unknown:
        raise ValueError(f"dims: no results named {sorted(unknown)}; there are {sorted(collected)}")
    taken = set(collected) & {*coords, *values}
    if taken:
        raise ValueError(f"results and parameters share the names {sorted(taken)}")
    for name, value in collected.items():
        rest = value.shape[1:]
        if name in extra:
            named = {d: _coordinate(d, c) for d, c in extra[name].items()}
            if tuple(len(c) for c in named.values()) != rest:
                given = {d: len(c) for d, c in named.items()}
                raise ValueError(f"dims: {name} has further dimensions {rest}, dims says {given}")
        else:
            named = {f"{name}_{i}": np.arange(size) for i, size in enumerate(rest)}
        for dim, coordinate in named.items():
            if dim in lead or (dim in coords and not np.array_equal(coords[dim], coordinate)):
                raise ValueError(f"dims: two different sets of coordinates for {dim!r}")
            coords[dim] = coordinate
        values[name] = value.reshape(shape + rest)
        dims[name] = (*lead, *named)
    return Table(values, dims, coords, errors)


def _coordinate(dim: str, given: Sequence[Any]) -> np.ndarray:
    """Numbers as they are, anything else (labels of modes, say) by its text."""
    numbers = all(isinstance(g, int | float | np.number) for g in given)
    column = np.asarray(given) if numbers else np.asarray([str(g) for g in given])
    if column.ndim != 1:
        raise ValueError(f"dims: coordinates of {dim!r} must be one-dimensional")
    return column


class _Progress:
    """One line on stderr, rewritten after each chunk; silent in short sweeps unless asked for."""

    def __init__(self, total: int, wanted: bool | None) -> None:
        self.total, self.wanted = total, wanted
        self.start, self.next, self.shown = time.perf_counter(), 0.0, False

    def __call__(self, done: int) -> None:
        elapsed = time.perf_counter() - self.start
        last = done == self.total
        wanted = self.wanted or (self.wanted is None and (self.shown or (elapsed > 2 and not last)))
        if wanted and (last or elapsed > self.next):
            left = elapsed / done * (self.total - done)
            text = f"\r{done}/{self.total} cases, {done / elapsed:.0f}/s, {left:.0f} s left "
            print(text, end="", file=sys.stderr, flush=True)
            self.shown, self.next = True, elapsed + 0.25

    def end(self) -> None:
        if self.shown:
            print(file=sys.stderr)
