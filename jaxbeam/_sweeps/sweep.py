"""Run one function over many cases: in chunks, on devices or workers, with nothing lost."""

import contextlib
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._checks import plain
from jaxbeam._sweeps.cases import Cases, checked_cases, refuse_traced
from jaxbeam._sweeps.chunks import Columns, Work, batched, made_with, named, placed, prepare
from jaxbeam._sweeps.devices import checked_devices, on_devices
from jaxbeam._sweeps.executors import on_executor
from jaxbeam._sweeps.identity import program_of
from jaxbeam._sweeps.store import Memory, ResultFolder, Spec, opened
from jaxbeam._sweeps.table import Table, as_table, coordinate, layout

Dims = Mapping[str, Mapping[str, Sequence[Any]]]


def sweep(
    function: Callable[..., Any],
    cases: Cases | Mapping[str, Any],
    *,
    chunk: int = 256,
    devices: Sequence[jax.Device] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    folder: str | os.PathLike[str] | None = None,
    progress: bool | None = None,
    dims: Dims | None = None,
) -> Table:
    """Evaluate `function(**parameters)` for every case and collect the results by name.

    `cases` are made by `grid` or `points`; a dictionary of lists, by name, is a grid. The function
    is written for one case: it takes their parameters as scalars, by name, and returns an array, or
    a dictionary, dataclass or `eqx.Module` of arrays. It is compiled once (again only for another
    function object, so what it reads from outside is frozen: bind arrays that change between sweeps
    with `jax.tree_util.Partial(function, *arrays)`; the programs of the last sixteen functions are
    kept) and vectorised over `chunk` cases at a time, which bounds the memory it needs; results go
    to NumPy as they come. Numbers of types that NumPy
    has not (bfloat16, float8, int4) are kept, the same ones, as float32 or integers of 8 bits.

    One failing case never touches another. If the result has an entry `status` it is the status of
    the case; otherwise a case is `NOT_FINITE` when any of its results is not. A case that raises
    inside the compiled code (`eqx.error_if`) is found by halving its chunk, gets
    `Status.RAISED`, NaN (or zero) results and its message in `Table.errors`, and the others are
    kept. Asking for a status (`modes(..., throw=False)`) is much faster than raising. So a batch
    has no `throw`: it never raises for a case, unless every one of them raises.

    `devices` are some of `jax.local_devices()`: each works on a chunk at a time, a device named
    twice on two (`devices=2 * jax.devices()` takes two cores of a CPU). Each is fed by a thread;
    settings of JAX that a context manager makes do not reach it.

    `executor` is a `concurrent.futures.Executor` whose workers compute the chunks instead, each
    with its default device: of Dask (`client.get_executor()`), of `mpi4py.futures`, or, since those
    of the standard library end with a worker that dies, a function that makes one:
    `executor=lambda: ProcessPoolExecutor(8, multiprocessing.get_context("spawn"))`, or
    `lambda: loky.get_reusable_executor(8)`. The function is pickled once. The chunk of a worker
    that died is sent again; one that three workers died of is given up: its cases get
    `Status.RAISED`, a folder holds them as missing, the others are kept. Where all workers of
    Dask are gone, and none comes in their place for 45 seconds, it raises `RuntimeError`.

    The numbers depend neither on devices nor on workers of the same kind.

    `folder` keeps the results as they come, and memory flat: the values of the table are mapped
    from files there. A sweep that was killed goes on with the chunks that are missing or damaged
    when it is run again, on any number of devices or workers; a finished one is read. The folder of
    another sweep (of a function that compiles to another program, other parameters, chunks,
    precision, kind of device, or versions of packages) is refused; what callbacks to Python do is
    not seen. A sweep whose folder is removed while it runs, or taken over by another one, raises
    `RuntimeError`, and never mixes its results with others. `Table.load(folder)` reads it without
    the function.

    `dims` names further dimensions of a result and their coordinates, as in
    `dims={"frequency": {"mode": ["1", "2"]}}`. `progress` shows a line on stderr as chunks end;
    by default only in sweeps that last longer than two seconds.

    Raises `ValueError` or `TypeError` for a malformed argument or the folder of another sweep, and
    where numbers are traced, and `RuntimeError` where every case raised.
    """
    job = _checked(function, cases, chunk, devices, executor, folder, dims)
    specs, store = job.begin()
    job.run(specs, store, progress)
    results, errors = store.collected()
    if len(errors) == len(job.cases):
        raise RuntimeError(f"every case raised; the first one said: {errors[0]}")
    return as_table(job.cases, results, errors, job.dims)


def _checked(
    function: Any, cases: Any, chunk: Any, devices: Any, executor: Any, folder: Any, dims: Any
) -> "_Job":
    """The arguments of `sweep`, checked and converted; raises for those that are malformed."""
    if not callable(function):
        raise TypeError(f"function must take parameters by name, got {type(function).__name__}")
    refuse_traced(function)
    cases, chunk = checked_cases(cases), plain(chunk)
    if isinstance(chunk, bool) or not isinstance(chunk, int) or chunk < 1:
        raise ValueError(f"chunk must be an int >= 1, got {chunk!r}")
    chunk = min(chunk, len(cases))
    if executor is not None and devices is not None:
        raise ValueError("give devices of this process or an executor, whose workers use their own")
    if folder is not None and not isinstance(folder, str | os.PathLike):
        raise TypeError(f"folder must be a path, got {folder!r}")
    values = list(dims.values()) if isinstance(dims, Mapping) else []
    if not all(isinstance(part, Mapping) for part in (dims or {}, *values)):
        raise TypeError(
            'dims must be like {"frequency": {"mode": ["1", "2"]}}: by name of a result, its '
            f"further dimensions with their coordinates; got {dims!r}"
        )
    dims = {
        name: {dim: coordinate(dim, column).tolist() for dim, column in further.items()}
        for name, further in (dims or {}).items()
    }
    place = None if folder is None else Path(folder)
    return _Job(function, cases, chunk, checked_devices(devices), executor, place, dims)


class _Job(NamedTuple):
    """A sweep to be run: its function, its cases, devices or an executor, and where results are
    kept."""

    function: Callable[..., Any]
    cases: Cases
    chunk: int
    devices: tuple[jax.Device | None, ...]
    executor: Any  # executor in the place of devices; None: devices are used
    folder: Path | None
    dims: Dims

    def begin(self) -> tuple[dict[str, Spec], Memory | ResultFolder]:
        """The specs of results of one case, and the store for results."""
        cases, chunk = self.cases, self.chunk
        with _lowered_for(self.devices[0]):
            first = jax.device_put(cases.at(np.arange(chunk)))
            specs = _specs(self.function, first)
            layout(cases, {name: spec.shape for name, spec in specs.items()}, self.dims)
            if self.folder is None:
                return specs, Memory(specs, len(cases), chunk)
            identity = {
                **program_of(self.function, first), "cases": len(cases), "chunk": chunk,
                "parameters": cases.described(), "dims": self.dims, **made_with(),
            }  # fmt: skip
        return specs, opened(self.folder, identity, specs, cases)

    def run(
        self, specs: Mapping[str, Spec], store: Memory | ResultFolder, progress: bool | None
    ) -> None:
        """Compute the chunks that are missing in the store."""
        missing = store.missing()
        report = _Progress(sum(map(store.length, missing)), progress)
        what = Work(self.function, specs, self.chunk), self.columns, missing
        if self.executor is None:
            computed = on_devices(*what, self.devices)
        else:
            computed = on_executor(*what, self.executor)
        with contextlib.closing(computed) as found:
            for number, part in found:
                store.put(number, part)
                report(store.length(number))
        report.end()

    def columns(self, number: int) -> Columns:
        """Parameters of the cases in the chunk of this number."""
        start = number * self.chunk
        return self.cases.at(np.arange(start, min(start + self.chunk, len(self.cases))))


def _lowered_for(device: jax.Device | None) -> contextlib.AbstractContextManager[Any]:
    """A block in which programs are lowered for the platform of a device, not for the default
    one."""
    if device is None or device.platform == jax.default_backend():
        return contextlib.nullcontext()
    return jax.default_device(device)


def _specs(function: Callable[..., Any], columns: dict[str, jax.Array]) -> dict[str, Spec]:
    """Results of one case by the path to them: "frequency", "a.b", or "value" for a lone array."""
    out = named(eqx.filter_eval_shape(batched, function, columns))
    if not out:
        raise TypeError("the swept function must return at least one array")
    specs = {name: Spec(_kept_as(name, leaf.dtype), leaf.shape[1:]) for name, leaf in out.items()}
    status = specs.setdefault("status", Spec(np.dtype(int), ()))
    if status.shape or status.dtype.kind != "i":
        raise ValueError("the entry status of a result must be an integer scalar, see Status")
    return specs


def _kept_as(name: str, dtype: Any) -> np.dtype:
    """The type in which NumPy keeps a result: bfloat16, float8 and int4, which it has not, become
    the shortest type that holds the same numbers."""
    if isinstance(dtype, np.dtype) and dtype.isbuiltin == 1:
        return dtype
    wider = {jnp.floating: np.float32, jnp.signedinteger: np.int8, jnp.unsignedinteger: np.uint8}
    for kind, kept in wider.items():
        if jnp.issubdtype(dtype, kind):
            return np.dtype(kept)
    raise TypeError(
        f"the swept function must return numbers, but {name} is of {dtype}: of a key of random "
        "numbers return jax.random.key_data(key), and leave out what is no number"
    )


def compiled(
    function: Callable[..., Any], cases: Cases, chunk: int, devices: Sequence[jax.Device] | None
) -> None:
    """Compile the program that `sweep` runs, on the first device."""
    device = checked_devices(devices)[0]
    first = jax.device_put(cases.at(np.arange(min(chunk, len(cases)))), device)
    prepare(placed(function, device), first)


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
