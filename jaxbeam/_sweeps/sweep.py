"""Run one function over many cases: in chunks, on one device or many, with nothing lost."""

import contextlib
import functools
import hashlib
import importlib.metadata
import inspect
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from jaxbeam._status import Status, said, unlogged
from jaxbeam._sweeps.cases import Cases, checked_cases
from jaxbeam._sweeps.devices import Said, Team, batched
from jaxbeam._sweeps.store import INFORMATION, Folder, Memory, Spec, opened
from jaxbeam._sweeps.table import Table, coordinate, layout, tabled

Dims = Mapping[str, Mapping[str, Sequence[Any]]]
_MADE_WITH = ("jaxbeam", "jax", "jaxlib", "equinox", "diffrax", "numpy")


def sweep(
    function: Callable[..., Any],
    cases: Cases | Mapping[str, Any],
    *,
    chunk: int = 256,
    devices: Sequence[jax.Device] | None = None,
    folder: str | os.PathLike[str] | None = None,
    progress: bool | None = None,
    dims: Dims | None = None,
) -> Table:
    """Evaluate `function(**parameters)` for every case and collect the results by name.

    `cases` are made by `grid` or `points`; a dictionary of lists, by name, is a grid. The function
    is written for one case: it takes their parameters as scalars, by name, and returns an array, or
    a dictionary, dataclass or `eqx.Module` of arrays. It is compiled once (again only for another
    function object, so what it reads from outside is frozen: bind arrays that change between sweeps
    with `jax.tree_util.Partial(function, *arrays)`) and vectorised over `chunk` cases at a time,
    which bounds the memory it needs; results go to NumPy as they come.

    One failing case never touches another. If the result has an entry `status` it is the status of
    the case; otherwise a case is `NOT_FINITE` when any of its results is not. A case that raises
    inside the compiled code (`eqx.error_if`) is found by halving its chunk, gets
    `Status.RAISED`, NaN (or zero) results and its message in `Table.errors`, and the others are
    kept. Asking for a status (`modes(..., throw=False)`) is much faster than raising.

    `devices` are some of `jax.devices()`: each works on a chunk at a time, a device named twice on
    two (`devices=2 * jax.devices()` takes two cores of a CPU); the numbers do not depend on them.
    After `jax.distributed.initialize`, `jax.devices()` are those of all processes: every process
    runs the same sweep, computes its part, and gets the whole table. Each device is fed by a
    thread; settings of JAX that a context manager makes do not reach it.

    `folder` keeps the results as they come, and memory flat: the values of the table are mapped
    from files there. A sweep that was killed goes on with the chunks that are missing or damaged
    when it is run again, on any number of devices; a finished one is read. The folder of another
    sweep (of a function that compiles to another program, other parameters, chunks, precision,
    kind of device, or versions of packages) is refused; what callbacks to Python do is not seen.
    `Table.load(folder)` reads it without the function. Other processes must see it too. Where one
    of them dies, JAX ends the others after its heartbeat, in a minute or two; the folder remains.

    `dims` names further dimensions of a result and their coordinates, as in
    `dims={"frequency": {"mode": ["1", "2"]}}`. `progress` shows a line on stderr as chunks end;
    by default only in sweeps that last longer than two seconds.
    """
    job = _checked(function, cases, chunk, devices, folder, dims)
    specs, identity, store = job.team.in_turn(job.begin)
    job.agree(identity, store)
    job.run(specs, store, progress)
    results, errors = job.team.in_turn(store.collected)
    if len(errors) == len(job.cases):
        raise RuntimeError(f"every case raised; the first one said: {errors[0]}")
    return tabled(job.cases, results, errors, job.dims)


def _checked(function: Any, cases: Any, chunk: Any, devices: Any, folder: Any, dims: Any) -> "_Job":
    """The arguments of `sweep`, or an error that says which is malformed."""
    if not callable(function):
        raise TypeError(f"function must take parameters by name, got {type(function).__name__}")
    cases = checked_cases(cases)
    if isinstance(chunk, bool) or not isinstance(chunk, int) or chunk < 1:
        raise ValueError(f"chunk must be an int >= 1, got {chunk!r}")
    chunk = min(chunk, len(cases))
    team = Team.of(devices)
    if folder is not None and not isinstance(folder, str | os.PathLike):
        raise TypeError(f"folder must be a path, got {folder!r}")
    if not all(isinstance(part, Mapping) for part in (dims or {}, *_values(dims))):
        raise TypeError(
            'dims must be like {"frequency": {"mode": ["1", "2"]}}: by name of a result, its '
            f"further dimensions with their coordinates; got {dims!r}"
        )
    dims = {
        name: {dim: coordinate(dim, column).tolist() for dim, column in further.items()}
        for name, further in (dims or {}).items()
    }
    return _Job(function, cases, chunk, team, None if folder is None else Path(folder), dims)


def _values(mapping: Any) -> list[Any]:
    return list(mapping.values()) if isinstance(mapping, Mapping) else []


class _Job(NamedTuple):
    """A sweep that is to be done: what, over which cases, by whom, and where results are kept."""

    function: Callable[..., Any]
    cases: Cases
    chunk: int
    team: Team
    folder: Path | None
    dims: Dims

    def begin(self) -> tuple[dict[str, Spec], dict[str, Any], Memory | Folder]:
        """What one case gives, what tells this sweep from others, and the place for results."""
        cases, chunk, team = self.cases, self.chunk, self.team
        with _lowered_for(team.here[0]):
            first = jax.device_put(cases.at(np.arange(chunk)))
            specs = _specs(self.function, first)
            layout(cases, {name: spec.shape for name, spec in specs.items()}, self.dims)
            if self.folder is None and not team.shared:
                return specs, {}, Memory(specs, len(cases), chunk)
            identity = {
                **_program(self.function, first), "cases": len(cases), "chunk": chunk,
                "parameters": cases.described(), "dims": self.dims, **_made_with(first),
            }  # fmt: skip
        if self.folder is None:
            return specs, identity, Memory(specs, len(cases), chunk)
        return specs, identity, opened(self.folder, identity, specs, cases, writes=team.leads)

    def agree(self, identity: Mapping[str, Any], store: Memory | Folder) -> None:
        """Raise an error unless all processes are about to do the same."""
        what = [(name, kept) for name, kept in identity.items() if name not in INFORMATION]
        ours = json.dumps([what, self.team.owners, store.missing()])
        if any(theirs != ours for theirs, _ in self.team.together(lambda: (ours, {}))):
            raise ValueError(
                "processes must run the same sweep: they differ in function, cases, chunk, dims, "
                "order of devices, or versions"
            )

    def run(self, specs: Mapping[str, Spec], store: Memory | Folder, progress: bool | None) -> None:
        """Fill the store with the chunks that are missing."""
        missing = store.missing()
        total = sum(map(store.length, missing))
        report = _Progress(total, progress if self.team.leads else False)
        compute = functools.partial(_computed, self.function, self.cases, self.chunk, specs)
        for chunks in self.team.each(compute, missing):
            self.team.together(functools.partial(_keep, store, chunks))
            report(sum(map(store.length, chunks)))
        report.end()


def _lowered_for(device: jax.Device | None) -> contextlib.AbstractContextManager[Any]:
    """Makes programs that of another platform than the default one; they do not name a device."""
    if device is None or device.platform == jax.default_backend():
        return contextlib.nullcontext()
    return jax.default_device(device)


def _specs(function: Callable[..., Any], columns: dict[str, jax.Array]) -> dict[str, Spec]:
    """Results of one case by the path to them: "frequency", "a.b", or "value" for a lone array."""
    out = _named(eqx.filter_eval_shape(batched, function, columns))
    if not out:
        raise TypeError("the swept function must return at least one array")
    specs = {name: Spec(np.dtype(leaf.dtype), leaf.shape[1:]) for name, leaf in out.items()}
    status = specs.setdefault("status", Spec(np.dtype(int), ()))
    if status.shape or status.dtype.kind != "i":
        raise ValueError("the entry status of a result must be an integer scalar, see Status")
    return specs


def _named(result: Any) -> dict[str, Any]:
    leaves, _ = jax.tree_util.tree_flatten_with_path(result)
    return {
        jax.tree_util.keystr(path, simple=True, separator=".") or "value": leaf
        for path, leaf in leaves
    }


def _computed(
    function: Callable[..., Any],
    cases: Cases,
    chunk: int,
    specs: Mapping[str, Spec],
    number: int,
    device: jax.Device | None,
) -> tuple[dict[int, str], dict[str, np.ndarray]]:
    """Messages of the cases in a chunk that raised, by number of case, and results of all."""
    start = number * chunk
    n = min(chunk, len(cases) - start)
    results = {name: spec.blank(n) for name, spec in specs.items()}
    errors: dict[int, str] = {}
    placed = _placed(function, device)

    def run(lanes: np.ndarray) -> dict[str, np.ndarray]:
        # One shape, one compilation: other lanes are filled up. A case keeps its lane, whatever
        # becomes of its neighbours, so its numbers stay the same to the last bit.
        case = np.full(chunk, start + lanes[0])
        case[lanes] = start + lanes
        columns = jax.device_put(cases.at(case), device)
        found = _named(jax.device_get(batched(placed, columns)))
        return {name: np.asarray(leaf)[lanes] for name, leaf in found.items()}

    for lanes, found in _isolated(run, np.arange(n)):
        if isinstance(found, str):
            errors[start + int(lanes[0])] = found
            results["status"][lanes] = Status.RAISED
            continue
        if "status" not in found:
            found["status"] = _finite(found, len(lanes))
        for name, leaf in found.items():
            results[name][lanes] = leaf
    return errors, results


def _placed(function: Callable[..., Any], device: jax.Device | None) -> Callable[..., Any]:
    """The function with what is bound to it on a device."""
    arrays, rest = eqx.partition(function, eqx.is_array)
    return function if device is None else eqx.combine(jax.device_put(arrays, device), rest)


def compiled(
    function: Callable[..., Any], cases: Cases, chunk: int, devices: Sequence[jax.Device] | None
) -> None:
    """Have the program at hand that `sweep` runs, on the first device."""
    device = Team.of(devices).here[0]
    first = jax.device_put(cases.at(np.arange(min(chunk, len(cases)))), device)
    batched.lower(_placed(function, device), first).compile()


def _keep(store: Memory | Folder, chunks: dict[int, Said]) -> Said:
    for number, (errors, results) in chunks.items():
        store.put(number, results, {int(i): text for i, text in errors.items()})
    return None, {}


def _finite(results: Mapping[str, np.ndarray], n: int) -> np.ndarray:
    """Status of n cases that do not tell it themselves."""
    finite = np.ones(n, bool)
    for value in results.values():
        if np.issubdtype(value.dtype, np.inexact):
            finite &= np.isfinite(value).reshape(n, -1).all(1)
    return np.where(finite, Status.OK, Status.NOT_FINITE)


def _isolated(
    run: Callable[[np.ndarray], dict[str, np.ndarray]], index: np.ndarray
) -> list[tuple[np.ndarray, dict[str, np.ndarray] | str]]:
    """Results of the cases in `index` in parts, a message for each case that raises alone."""
    try:
        with unlogged():
            return [(index, run(index))]
    except Exception as error:
        sentence = said(error)
        if sentence is None:  # another error, say of memory
            raise
    if len(index) == 1:
        return [(index, sentence)]
    half = len(index) // 2
    return _isolated(run, index[:half]) + _isolated(run, index[half:])


def _program(function: Callable[..., Any], columns: dict[str, jax.Array]) -> dict[str, Any]:
    """What tells a function from others: the program that it compiles to, with all constants in
    it, and the arrays bound to it; beside them, for people, what it reads."""
    text = batched.lower(function, columns).as_text()
    program = hashlib.sha256(text.encode())
    for leaf in jax.tree.leaves(eqx.filter(function, eqx.is_array)):
        program.update(np.asarray(leaf).tobytes())
    bare = inspect.unwrap(function)
    while isinstance(bare, functools.partial):  # that of JAX is one
        bare = bare.func
    name = getattr(bare, "__qualname__", type(bare).__qualname__)
    return {
        "function": f"{getattr(bare, '__module__', None)}.{name}",
        "reads": _reads(function, bare),
        "program": program.hexdigest(),
    }


def _reads(function: Any, bare: Any) -> dict[str, str]:
    """Modules and numbers that a function is bound to, or finds outside."""
    parts: dict[str, Any] = {}
    if isinstance(function, eqx.Module):
        parts = {name: getattr(function, name) for name in vars(function)}
    elif isinstance(function, functools.partial):
        parts = {**{str(i): a for i, a in enumerate(function.args)}, **function.keywords}
    if inspect.isfunction(bare):
        with contextlib.suppress(ValueError):  # of a name that is not bound yet
            outside = inspect.getclosurevars(bare)
            parts |= {**outside.globals, **outside.nonlocals}
    kinds = (eqx.Module, int, float, str, np.ndarray, jax.Array, tuple, dict)

    def number(leaf: Any) -> Any:
        return leaf.item() if eqx.is_array(leaf) and leaf.ndim == 0 else leaf

    return {
        name: eqx.tree_pformat(jax.tree.map(number, part), short_arrays=False)
        for name, part in parts.items()
        if isinstance(part, kinds)
    }


def _made_with(columns: dict[str, jax.Array]) -> dict[str, Any]:
    """What the last bits may depend on beside the program."""
    (device,) = next(iter(columns.values())).devices()
    versions = {name: importlib.metadata.version(name) for name in _MADE_WITH}
    flags = os.environ.get("XLA_FLAGS", "").split()
    return {
        "precision": "float64" if jax.config.read("jax_enable_x64") else "float32",
        "platform": f"{device.platform} {device.device_kind} {platform.machine()}",
        "flags": [f for f in flags if "host_platform_device_count" not in f],
        "versions": {"python": platform.python_version(), **versions},
    }


class _Progress:
    """One line on stderr, rewritten after each chunk; silent in short sweeps unless asked for."""

    def __init__(self, total: int, wanted: bool | None) -> None:
        self.total, self.wanted, self.done = total, wanted, 0
        self.start, self.next, self.shown = time.perf_counter(), 0.0, False

    def __call__(self, more: int) -> None:
        self.done += more
        elapsed = time.perf_counter() - self.start
        last = self.done == self.total
        wanted = self.wanted or (self.wanted is None and (self.shown or (elapsed > 2 and not last)))
        if wanted and (last or elapsed > self.next):
            rate = self.done / elapsed
            left = (self.total - self.done) / rate
            text = f"\r{self.done}/{self.total} cases, {rate:.0f}/s, {left:.0f} s left "
            print(text, end="", file=sys.stderr, flush=True)
            self.shown, self.next = True, elapsed + 0.25

    def end(self) -> None:
        if self.shown:
            print(file=sys.stderr)
