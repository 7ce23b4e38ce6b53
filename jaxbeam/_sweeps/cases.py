"""Many cases of one thing: grids and lists of named parameters."""

import dataclasses
import hashlib
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from jaxbeam._checks import unmasked
from jaxbeam._types import is_concrete


@dataclasses.dataclass(frozen=True, eq=False)  # no comparison of arrays
class Cases:
    """Named parameters of N cases. Made by `grid` or `points`.

    `axes` holds the coordinates of the dimensions that the cases are laid out along, with product
    of lengths N; `columns[name]` the value of a parameter in each case, shape (N,). A grid makes
    its columns when they are asked for: `at` gives those of a few cases, however many there are.
    """

    axes: dict[str, np.ndarray]
    # Parameters of an explicit list of cases; None for a grid.
    of_list: dict[str, np.ndarray] | None = None

    def __len__(self) -> int:
        return math.prod(len(axis) for axis in self.axes.values())

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters."""
        return tuple(self.axes if self.of_list is None else self.of_list)

    @property
    def columns(self) -> dict[str, np.ndarray]:
        """The value of each parameter in each case."""
        return self.at(np.arange(len(self)))

    def described(self) -> list[list[Any]]:
        """A description that tells these cases from others, in order: name, number, ends, and a
        digest of all bits."""
        columns = {**self.axes, **(self.of_list or {})}.items()
        # As texts, since NaN would not equal itself.
        ends = {name: [repr(column[i].item()) for i in (0, -1)] for name, column in columns}
        return [
            [name, len(column), *ends[name], hashlib.sha256(column.tobytes()).hexdigest()]
            for name, column in columns
        ]

    def at(self, index: np.ndarray) -> dict[str, np.ndarray]:
        """Values of the parameters, by name, in the cases of these numbers, `index`."""
        if self.of_list is not None:
            return {name: column[index] for name, column in self.of_list.items()}
        places = np.unravel_index(index, [len(axis) for axis in self.axes.values()])
        return {n: a[place] for (n, a), place in zip(self.axes.items(), places, strict=True)}


def grid(**axes: Any) -> Cases:
    """Cases in a grid: the Cartesian product of lists, the last one fastest.

    `**axes` are lists of numbers (floats, or ints typed by hand) without repetition, by the name of
    the parameter: `grid(angular_speed=[0.0, 1.0], tip_mass=[0])`. Returns `Cases`.

    Raises `ValueError` or `TypeError`, naming the list, and `TypeError` where numbers are traced.
    """
    coords = {name: _column(name, values) for name, values in _some(axes).items()}
    for name, column in coords.items():
        if len(np.unique(column)) < len(column):
            raise ValueError(f"{name} must not repeat values in a grid")
    return Cases(coords)


def points(**columns: Any) -> Cases:
    """Explicit cases, one for each position in equally long lists.

    `**columns` are lists of numbers, by the name of the parameter, as in `grid` but with
    repetition: `points(angular_speed=[0.0, 1.0], tip_mass=[0.1, 0.1])`. Returns `Cases`.

    Raises as `grid` does, and `ValueError` for lists of unequal lengths.
    """
    values = {name: _column(name, column) for name, column in _some(columns).items()}
    if "case" in values:
        raise ValueError("case is the name of the dimension of a list, not of a parameter")
    lengths = {name: len(column) for name, column in values.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns must be equally long, got {lengths}")
    n = next(iter(lengths.values()))
    return Cases({"case": np.arange(n)}, values)


def checked_cases(cases: Any) -> Cases:
    """The argument as `Cases`; a dictionary counts as the axes of a grid."""
    if isinstance(cases, Cases):
        return cases
    if isinstance(cases, Mapping):
        for name in cases:
            if not isinstance(name, str):
                raise TypeError(f"cases must name parameters by texts, got {name!r}")
        return grid(**cases)
    raise TypeError(
        "cases must be made by jaxbeam.grid or jaxbeam.points, or be a dictionary of lists by name "
        f"as jaxbeam.grid takes them, got {type(cases).__name__}"
    )


def _some(named: dict[str, Any]) -> dict[str, Any]:
    if not named:
        raise ValueError("name at least one parameter, as in grid(angular_speed=[0.0, 1.0])")
    return named


def refuse_traced(given: Any) -> None:
    """Raise `TypeError` if numbers of a sweep are traced."""
    if not is_concrete(given):
        raise TypeError(
            "a sweep cannot be inside jax.grad, jax.jit or jax.vmap, since its results go to "
            "NumPy: differentiate inside the swept function, or take jax.vmap in its place"
        )


def _column(name: str, values: Any) -> np.ndarray:
    refuse_traced(values)
    values = unmasked(name, values)
    try:
        column = np.asarray(values)
    except ValueError:  # raised for lists of unequal lengths
        raise ValueError(f"{name} must be a list of numbers, got {values!r}") from None
    if column.ndim != 1 or column.size == 0:
        raise ValueError(f"{name} must be one-dimensional and not empty, got {column.shape}")
    if isinstance(values, list | tuple | range) and np.issubdtype(column.dtype, np.integer):
        column = column.astype(float)  # integers typed by hand are meant as numbers
    if not np.issubdtype(column.dtype, np.floating):
        raise TypeError(f"{name} must be real floating-point numbers, got {column.dtype}")
    if name == "status":
        raise ValueError("status is the name of the outcome, not of a parameter")
    return column.astype(float)
