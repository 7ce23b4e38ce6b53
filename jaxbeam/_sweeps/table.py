"""Results of many cases, labelled: taken by value, kept in files."""

import csv
import dataclasses
import functools
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np

from jaxbeam._status import Status
from jaxbeam._sweeps.cases import Cases
from jaxbeam._sweeps.store import reopened

_LINES = 4096  # lines of a CSV file that are formatted at a time


@dataclasses.dataclass(frozen=True, eq=False)  # arrays are not compared
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
        if name not in self:
            raise KeyError(f"no values named {name!r}; there are {sorted(self.values)}")
        return self.values[name]

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self.values

    def __iter__(self) -> Iterator[str]:
        """Names of the values, as of a dictionary."""
        return iter(self.values)

    def sel(self, **at: Any) -> Self:
        """The part of the table at these coordinates, by value: `table.sel(tip_mass=0.5)`.

        `**at` are numbers, lists or slices by the name of a dimension or, in an explicit list, of a
        parameter, which selects cases and keeps the dimension "case". A number must be a coordinate
        to a relative 1e-9, and takes the nearest one; a list of numbers keeps that dimension, a
        slice takes all coordinates between its ends, both included.

        Raises `KeyError` for a dimension or coordinate that is not there, `TypeError` for what is
        no number, and `ValueError` for a slice with a step.
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
            ends = [end for end in (wanted.start, wanted.stop) if end is not None]
            if wanted.step is not None or column.dtype.kind == "U" or not all(map(_real, ends)):
                raise ValueError(f"{name}: a slice is from one number to another, without step")
            keep, slack = np.ones(column.shape, bool), _slack(column)
            if wanted.start is not None:
                keep &= column >= wanted.start - slack
            if wanted.stop is not None:
                keep &= column <= wanted.stop + slack
            index: Any = np.flatnonzero(keep)
        elif isinstance(wanted, list) or type(wanted) is tuple or bool(getattr(wanted, "ndim", 0)):
            # A `Label`, which is a tuple, counts as one name.
            found = [_find(name, column, w) for w in wanted]
            index = np.concatenate(found) if found else np.zeros(0, int)
        else:
            index = _find(name, column, wanted)
            if dim == name:
                index = int(index[0])
        return self.take(dim, index)

    def take(self, dim: str, index: Any) -> Self:
        """The part of the table at these positions, `index`, an int or a list of them, along `dim`.

        Raises `KeyError` for a dimension and `IndexError` for a position that is not there.
        """
        if dim not in self.coords:
            raise KeyError(f"no dimension named {dim!r}; there are {sorted(self.coords)}")
        places, size = np.asarray(index), len(self.coords[dim])
        whole = places.dtype.kind in "iu" or not places.size
        if not whole or places.ndim > 1 or ((places < -size) | (places >= size)).any():
            raise IndexError(f"{dim} has {size} positions, from 0, got {index!r}")
        index = places.astype(int)
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
        """Messages by flat case number within the part of the table that is selected."""
        dims = self.dims["status"]
        if not self.errors or dim not in dims:
            return self.errors
        shape = self.values["status"].shape
        numbers = np.arange(math.prod(shape)).reshape(shape)
        kept = np.take(numbers, index, axis=dims.index(dim)).ravel()
        return {i: self.errors[int(n)] for i, n in enumerate(kept) if int(n) in self.errors}

    def message(self, **at: Any) -> str:
        """The fate of one case, named by its coordinates `**at` as in `sel`, in words.

        Raises `ValueError` unless they name one case, and what `sel` raises.
        """
        part = self.sel(**at)
        if part.values["status"].size != 1:
            raise ValueError("message: name one case by all its coordinates")
        code = int(part.values["status"].item())
        if code not in list(Status):
            raise ValueError(f"message: {code} is no status that this version knows")
        return part.errors.get(0, Status(code).message)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all of it to a NumPy archive (.npz) at `path`, without pickling."""
        meta = {"dims": self.dims, "errors": self.errors}
        with open(path, "wb") as file:
            arrays: dict[str, Any] = {"meta": np.asarray(json.dumps(meta))}
            arrays |= {f"value:{n}": v for n, v in self.values.items()}
            arrays |= {f"coord:{n}": c for n, c in self.coords.items()}
            np.savez_compressed(file, **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read what `save` wrote to `path`, or the folder of a sweep that is finished.

        Raises `ValueError` for what is neither, and `OSError` where it cannot be read.
        """
        if os.path.isdir(path):
            store, identity, cases = reopened(Path(path))
            return cls(**vars(as_table(cases, *store.collected(), identity["dims"])))
        try:
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
        except OSError as error:
            if error.errno is not None:  # the file is missing or may not be read
                raise
            raise ValueError(f"{path} is not a table: Table.save did not write it") from error
        except Exception as error:  # errors of NumPy, zipfile and zlib for files that are no tables
            raise ValueError(f"{path} is not a table: Table.save did not write it") from error

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write a file at `path` of one line a case: coordinates, then every value.

        Further dimensions of a value are columns, as are the parts of complex ones.
        """
        lead = self.dims["status"]
        shape = self.values["status"].shape
        # Functions from a block of lines to the values of a column there.
        columns: dict[str, Callable[[slice], np.ndarray]] = {}
        for place, dim in enumerate(lead):
            columns[dim] = functools.partial(_along, self.coords[dim], place, shape)
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
                    columns[f"{title}.real"] = column.real.__getitem__
                    columns[f"{title}.imag"] = column.imag.__getitem__
                else:
                    columns[title] = column.__getitem__
        with open(path, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            for start in range(0, math.prod(shape), _LINES):
                lines = slice(start, min(start + _LINES, math.prod(shape)))
                # repr of a Python float reads back to the same float
                writer.writerows(zip(*(c(lines).tolist() for c in columns.values()), strict=True))

    def to_xarray(self) -> Any:
        """The table as an `xarray.Dataset`.

        Raises `ImportError` without the package xarray.
        """
        try:
            import xarray
        except ImportError as error:
            raise ImportError("to_xarray needs the package xarray: pip install xarray") from error
        return xarray.Dataset({n: (self.dims[n], v) for n, v in self.values.items()}, self.coords)


def _along(axis: np.ndarray, place: int, shape: tuple[int, ...], lines: slice) -> np.ndarray:
    """Coordinates of cases along the dimension at this place, for a slice of cases."""
    return axis[np.unravel_index(np.arange(lines.start, lines.stop), shape)[place]]


def _slack(column: np.ndarray) -> float:
    """The distance by which a number may miss a coordinate of an axis: 1e-9 of the smallest
    distance of two."""
    gaps = np.diff(np.unique(column[np.isfinite(column)]))
    scale = float(gaps.min()) if gaps.size else float(np.abs(column[:1]).max(initial=0.0))
    return 1e-9 * scale


def _find(name: str, column: np.ndarray, wanted: Any) -> np.ndarray:
    if column.dtype.kind == "U":
        found = np.flatnonzero(column == str(wanted))
        if not found.size:
            raise KeyError(f"{name} has no coordinate {str(wanted)!r}; there are {column.tolist()}")
        return found
    if not _real(wanted):
        raise TypeError(f"{name} must be selected by numbers, got {wanted!r}")
    number = float(wanted)
    exact = np.flatnonzero(np.isnan(column) if np.isnan(number) else column == number)
    if exact.size:
        return exact
    away = np.abs(column - number)
    if not np.isfinite(away).any():
        raise KeyError(f"{name} has no coordinate {wanted!r}")
    near = float(column[np.nanargmin(away)])
    if not np.isclose(near, number, rtol=1e-9, atol=_slack(column)):
        raise KeyError(f"{name} has no coordinate {wanted!r}, nearest {near}")
    return np.flatnonzero(column == near)


def _real(value: Any) -> bool:
    """Whether a value is a real number, as Python, NumPy or JAX have them."""
    kind = getattr(value, "dtype", np.dtype(type(value) if type(value) in (int, float) else object))
    return np.ndim(value) == 0 and np.dtype(kind).kind in "iuf"


def layout(
    cases: Cases,
    shapes: Mapping[str, tuple[int, ...]],
    extra: Mapping[str, Mapping[str, Sequence[Any]]],
) -> tuple[dict[str, tuple[str, ...]], dict[str, np.ndarray]]:
    """Dimensions of each result, whose shapes in one case are given, and all coordinates."""
    lead, parameters = tuple(cases.axes), dict(cases.of_list or {})
    coords = dict(cases.axes)
    dims = dict.fromkeys(parameters, lead)
    unknown = set(extra) - set(shapes)
    if unknown:
        raise ValueError(f"dims: no results named {sorted(unknown)}; there are {sorted(shapes)}")
    taken = set(shapes) & {*coords, *parameters}
    if taken:
        raise ValueError(f"results and parameters share the names {sorted(taken)}")
    for name, rest in shapes.items():
        if name in extra:
            named = {d: coordinate(d, c) for d, c in extra[name].items()}
            if tuple(len(c) for c in named.values()) != rest:
                given = {d: len(c) for d, c in named.items()}
                raise ValueError(f"dims: {name} has further dimensions {rest}, dims says {given}")
        else:
            named = {f"{name}_{i}": np.arange(size) for i, size in enumerate(rest)}
        for dim, column in named.items():
            if dim in lead or (dim in coords and not np.array_equal(coords[dim], column)):
                raise ValueError(f"dims: two different sets of coordinates for {dim!r}")
            coords[dim] = column
        dims[name] = (*lead, *named)
    return dims, coords


def as_table(
    cases: Cases,
    results: Mapping[str, np.ndarray],
    errors: dict[int, str],
    extra: Mapping[str, Mapping[str, Sequence[Any]]],
) -> Table:
    """Results of all cases with their status, as a `Table`."""
    dims, coords = layout(cases, {name: v.shape[1:] for name, v in results.items()}, extra)
    shape = tuple(len(axis) for axis in cases.axes.values())
    values = dict(cases.of_list or {})
    values |= {name: value.reshape(shape + value.shape[1:]) for name, value in results.items()}
    return Table(values, dims, coords, errors)


def coordinate(dim: str, given: Sequence[Any]) -> np.ndarray:
    """Coordinates of a dimension: numbers as they are, others, such as labels of modes, as
    texts."""
    numbers = all(isinstance(g, int | float | np.number) for g in given)
    column = np.asarray(given) if numbers else np.asarray([str(g) for g in given])
    if column.ndim != 1:
        raise ValueError(f"dims: coordinates of {dim!r} must be one-dimensional")
    return column
