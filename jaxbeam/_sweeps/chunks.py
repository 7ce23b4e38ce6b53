"""One chunk of cases: computed all at once, and those that raise kept from the others."""

import functools
import importlib.metadata
import os
import platform
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from jaxbeam._programs.functions import identity
from jaxbeam._programs.program import Program
from jaxbeam._results import found_alone
from jaxbeam._status import Status, said, unlogged
from jaxbeam._sweeps.cases import refuse_traced
from jaxbeam._sweeps.store import ChunkResults, Spec

Columns = dict[str, np.ndarray]
_MADE_WITH = ("jaxbeam", "jax", "jaxlib", "equinox", "diffrax", "numpy")


def batched(function: Callable[..., Any], columns: dict[str, jax.Array]) -> Any:
    """The results of `function(**parameters)` for every row of columns of parameters."""
    program, arrays = _program(function)
    return program(arrays, columns)


def prepare(function: Callable[..., Any], columns: dict[str, jax.Array]) -> None:
    """Compile the program of `batched` for such columns."""
    program, arrays = _program(function)
    program.prepare(arrays, columns)


def lowered(function: Callable[..., Any], columns: dict[str, jax.Array]) -> Any:
    """The program of `batched`, lowered and not yet compiled."""
    program, arrays = _program(function)
    return program.lower(arrays, columns)


def _program(function: Callable[..., Any]) -> tuple[Program, tuple[Any, ...]]:
    """The program of a function, as one of its arrays, and these arrays, so that functions that
    differ only in arrays share it."""
    leaves, structure = jax.tree.flatten(function)
    arrays = tuple(leaf if eqx.is_array(leaf) else None for leaf in leaves)
    rest = tuple(None if eqx.is_array(leaf) else leaf for leaf in leaves)
    return _program_without(structure, rest, tuple(map(type, rest))), arrays


@functools.lru_cache(maxsize=16)
def _program_without(structure: Any, rest: tuple[Any, ...], _: tuple[type, ...]) -> Program:
    """The program of a function without its arrays. Programs of functions that are swept once, such
    as lambdas, are dropped when others have come; types distinguish 1 from 1.0, which are equal."""

    def run(arrays: tuple[Any, ...], columns: dict[str, jax.Array]) -> Any:
        leaves = [own if a is None else a for a, own in zip(arrays, rest, strict=True)]
        function = jax.tree.unflatten(structure, leaves)
        return jax.vmap(lambda parameters: found_alone(function(**parameters)))(columns)

    def said() -> Any:
        return ["swept", identity(jax.tree.unflatten(structure, rest))]

    return Program(run, jax.jit, calls=0, identity=said)


class Work(NamedTuple):
    """The work for every chunk: a function, the shapes of results of one case, and the number of
    cases at a time."""

    function: Callable[..., Any]
    specs: Mapping[str, Spec]
    chunk: int

    def on(self, columns: Columns, device: jax.Device | None) -> ChunkResults:
        """Results of these cases, and messages of those that raised."""
        n, results = self._blank(columns)
        errors: dict[int, str] = {}
        function = placed(self.function, device)

        def run(lanes: np.ndarray) -> dict[str, np.ndarray]:
            # All chunks have one shape, for one program: the last one is filled up with copies. A
            # case keeps its place, whatever becomes of others, so that its numbers are the same to
            # the last bit.
            case = np.full(self.chunk, lanes[0])
            case[lanes] = lanes
            filled = jax.device_put({name: c[case] for name, c in columns.items()}, device)
            result = batched(function, filled)
            refuse_traced(result)  # raises for traced numbers that the function reads from outside
            found = named(jax.device_get(result))
            kept = {name: np.asarray(leaf, self.specs[name].dtype) for name, leaf in found.items()}
            return {name: leaf[lanes] for name, leaf in kept.items()}

        for lanes, found in _isolated(run, np.arange(n)):
            if isinstance(found, str):
                errors[int(lanes[0])] = found
                results["status"][lanes] = Status.RAISED
                continue
            if "status" not in found:
                found["status"] = _finite(found, len(lanes))
            for name, leaf in found.items():
                results[name][lanes] = leaf
        return ChunkResults(results, errors)

    def lost(self, columns: Columns, message: str) -> ChunkResults:
        """The placeholder for a chunk whose workers all died: NaN, and status RAISED with a
        message."""
        n, results = self._blank(columns)
        results["status"][:] = Status.RAISED
        return ChunkResults(results, dict.fromkeys(range(n), message), computed=False)

    def _blank(self, columns: Columns) -> tuple[int, dict[str, np.ndarray]]:
        """The number of these cases, and placeholders for their results."""
        n = len(next(iter(columns.values())))
        return n, {name: spec.blank(n) for name, spec in self.specs.items()}


def placed(function: Callable[..., Any], device: jax.Device | None) -> Callable[..., Any]:
    """The function with all arrays that are bound to it on a device."""
    arrays, rest = eqx.partition(function, eqx.is_array)
    return function if device is None else eqx.combine(jax.device_put(arrays, device), rest)


def named(result: Any) -> dict[str, Any]:
    """Leaves of a result by the path to them: "frequency", "a.b", or "value" for a lone array."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(result)
    found: dict[str, Any] = {}
    for path, leaf in leaves:
        name = jax.tree_util.keystr(path, simple=True, separator=".") or "value"
        if name in found:
            raise ValueError(f"two results of the swept function have the name {name!r}")
        found[name] = leaf
    return found


def _finite(results: Mapping[str, np.ndarray], n: int) -> np.ndarray:
    """Status of n cases whose results have none: OK where all numbers are finite."""
    finite = np.ones(n, bool)
    for value in results.values():
        if np.issubdtype(value.dtype, np.inexact):
            finite &= np.isfinite(value).reshape(n, -1).all(1)
    return np.where(finite, Status.OK, Status.NOT_FINITE)


def _isolated(
    run: Callable[[np.ndarray], dict[str, np.ndarray]], index: np.ndarray
) -> list[tuple[np.ndarray, dict[str, np.ndarray] | str]]:
    """Results of the cases in `index`, divided into halves until each case that raises is alone,
    with its message."""
    try:
        with unlogged():
            return [(index, run(index))]
    except Exception as error:
        sentence = said(error)
        if sentence is None:  # another error, such as lack of memory
            raise
    if len(index) == 1:
        return [(index, sentence)]
    half = len(index) // 2
    return _isolated(run, index[:half]) + _isolated(run, index[half:])


def made_with() -> dict[str, Any]:
    """Versions and hardware on which, besides the program, the last bits of results may depend."""
    device = jax.device_put(0.0).device
    versions = {name: importlib.metadata.version(name) for name in _MADE_WITH}
    flags = os.environ.get("XLA_FLAGS", "").split()
    return {
        "precision": "float64" if jax.config.read("jax_enable_x64") else "float32",
        "platform": f"{device.platform} {device.device_kind} {platform.machine()}",
        "flags": [f for f in flags if "host_platform_device_count" not in f],
        "versions": {"python": platform.python_version(), **versions},
    }
