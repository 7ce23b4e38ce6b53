"""Chunks sent to an executor: processes of this machine, or of a cluster.

The function is pickled once; each chunk takes it along with the parameters of its own cases, and
brings back their results. What goes wrong within a chunk comes back as a text, so that an exception
of the executor itself says that a worker died, or could not begin.
"""

import collections
import functools
import os
import pickle
import sys
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import (
    ALL_COMPLETED,
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    wait,
)
from typing import Any

import jax

from jaxbeam._sweeps.chunks import Columns, Work, made_with
from jaxbeam._sweeps.store import ChunkResults

try:  # it can pickle functions of scripts and notebooks, and comes with Dask and with loky
    import cloudpickle as pickler
except ImportError:
    pickler = pickle

_DEATHS = 3  # number of workers whose death a chunk may cause before it is given up
_MADE = 10  # number of executors that are made before the sweep is given up
_MANY = 1024  # number of chunks sent ahead to executors that do not tell their number of workers
_LOOK = 5.0  # seconds without a result after which workers are counted
_PATIENCE = 45.0  # seconds without any worker after which a sweep is given up


def on_executor(
    work: Work, columns: Callable[[int], Columns], numbers: Sequence[int], executor: Any
) -> Generator[tuple[int, ChunkResults]]:
    """Numbers of chunks and their results, in the order in which they end.

    Executors of the standard library end with the first worker that dies: they are made again, and
    what they had not answered is sent again. A chunk that was out at two deaths is tried alone, so
    that it is to blame for a third. Dask replaces workers by itself; a chunk that it gives up is
    tried alone once more. It waits for ever where all of them are gone: `_Watch` does not.
    """
    job, pool = _pickled(work), _made(executor)
    made, answered, watch = 1, False, _Watch()
    ahead = 2 * getattr(pool, "_max_workers", _MANY // 2)
    deaths: collections.Counter[int] = collections.Counter()
    waiting = collections.deque(numbers)
    running: dict[Future[ChunkResults | str], int] = {}

    def may_go(number: int) -> bool:
        suspects = {k for k, times in deaths.items() if times >= _DEATHS - 1}
        suspected = bool(suspects) and not suspects.isdisjoint((number, *running.values()))
        return not running or (not suspected and len(running) < ahead)

    try:
        while waiting or running:
            broken: BrokenExecutor | None = None
            try:
                while waiting and may_go(waiting[0]):
                    number = waiting[0]
                    future = pool.submit(_answer, job, columns(number), deaths[number])
                    running[future] = waiting.popleft()
            except BrokenExecutor as error:
                broken = error
            for future in watch.ended(pool, running, all_of_them=broken is not None):
                number = running.pop(future)
                found = _found(future)
                if not isinstance(found, BaseException):
                    answered = True
                    yield number, found
                    continue
                if isinstance(found, BrokenExecutor):
                    broken = found
                # Dask has tried again itself, and also blames chunks that only waited at workers
                # that died.
                deaths[number] += 1 if isinstance(found, BrokenExecutor) else _DEATHS - 1
                if deaths[number] < _DEATHS:
                    waiting.append(number)
                    continue
                text = f"the worker that computed its chunk died: {type(found).__name__}: {found}"
                yield number, work.lost(columns(number), text)
            if broken and not running:
                if made == _MADE and not answered:
                    raise RuntimeError(
                        f"{made} executors ended, one after the other, before any chunk was "
                        "answered: do workers start at all? A script whose processes start afresh "
                        'must call sweep below `if __name__ == "__main__":`'
                    ) from broken
                pool, made = _another(executor, broken), made + 1
    finally:
        for future in running:
            future.cancel()
        if not isinstance(executor, Executor):
            pool.shutdown(wait=False)


class _Watch:
    """A watch that waits for results of an executor as long as it has workers, or may get some."""

    def __init__(self) -> None:
        self.start = time.monotonic()
        self.seen: float | None = None  # time when there last was a worker; None: not known
        self.warned = False

    def ended(self, pool: Executor, running: Any, all_of_them: bool) -> Iterable[Any]:
        """The jobs that have ended of those running; an empty set from time to time while none
        has."""
        if self.seen is None:
            self._look(pool)
        if all_of_them:
            return wait(running, return_when=ALL_COMPLETED).done
        ended = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED).done
        if not ended:
            self._look(pool)
        return ended

    def _look(self, pool: Executor) -> None:
        workers, now = _workers(pool), time.monotonic()
        if workers is None:
            return
        if workers:
            self.seen = now
        elif self.seen is not None and now - self.seen > _PATIENCE:
            raise RuntimeError(
                f"all workers of the executor are gone, and for {now - self.seen:.0f} s none came "
                "in their place: start others, and run the same sweep again (with a folder it goes "
                "on from the chunks that are done)"
            )
        elif self.seen is None and now - self.start > _PATIENCE and not self.warned:
            self.warned = True
            warnings.warn("the executor has no workers: the sweep waits for one", stacklevel=2)


def _workers(pool: Executor) -> int | None:
    """The number of workers of a Dask executor; None for others."""
    client = getattr(pool, "_client", None)
    if client is None:
        return None
    try:
        return len(client.nthreads())
    except Exception:  # raised by a scheduler that does not answer, which ends its chunks itself
        return None


def _made(executor: Any) -> Executor:
    given = isinstance(executor, Executor) or not callable(executor)
    pool = executor if given else executor()
    if not isinstance(pool, Executor):
        raise TypeError(
            f"executor must be, or make, a concurrent.futures.Executor, got {executor!r}"
        )
    context = getattr(pool, "_mp_context", None)
    if context is not None and context.get_start_method() == "fork":
        raise ValueError(
            "executor must start its processes afresh, since JAX does not survive a fork: pass "
            'mp_context=multiprocessing.get_context("spawn")'
        )
    return pool


def _another(executor: Any, end: BaseException) -> Executor:
    """A new executor in the place of one that ended."""
    if isinstance(executor, Executor):
        raise RuntimeError(
            "a worker died, and the executor with it: pass a function that makes executors, and "
            "sweeps go on with a new one"
        ) from end
    return _made(executor)


def _found(future: Future[ChunkResults | str]) -> ChunkResults | BaseException:
    """The results of a chunk, or the exception that says that its worker died."""
    if future.cancelled():
        raise RuntimeError("the executor was shut down, or lost its connection")
    death = future.exception()
    if death is None:
        found = future.result()
        if isinstance(found, str):
            raise RuntimeError(f"a worker failed: {found}")
        return found
    if not isinstance(death, _deaths()):
        raise RuntimeError(
            f"a worker could not begin: {type(death).__name__}: {death}; it needs jaxbeam, and "
            "what the function imports"
        ) from death
    return death


def _deaths() -> tuple[type[BaseException], ...]:
    """The exceptions that executors raise where a worker died."""
    dask = sys.modules.get("distributed.scheduler")
    return (BrokenExecutor,) if dask is None else (BrokenExecutor, dask.KilledWorker)


def _pickled(work: Work) -> bytes:
    exact = jax.config.read("jax_enable_x64")
    try:
        return pickler.dumps((os.getpid(), exact, made_with(), work))
    except Exception as error:  # the class depends on the executor
        raise TypeError(
            "function must be picklable to go to an executor: define it in a module, with what it "
            f"needs bound by jax.tree_util.Partial, or install cloudpickle ({error})"
        ) from error


@functools.lru_cache(maxsize=4)
def _opened(job: bytes) -> Work:
    caller, exact, theirs, work = pickle.loads(job)
    if os.getpid() != caller:  # settings of a context manager do not reach callbacks
        jax.config.update("jax_enable_x64", exact)
    ours = made_with()
    other = [f"{n} ({ours[n]}, not {theirs[n]})" for n in ours if ours[n] != theirs[n]]
    if other:
        raise RuntimeError(f"it would find other bits, being different in {', '.join(other)}")
    return work


def _answer(job: bytes, columns: Columns, deaths: int) -> ChunkResults | str:
    """The results of a worker for a chunk, or the error for all of it. The number of deaths is an
    argument, since Dask identifies calls by these: a new try must not be taken for the one that
    failed."""
    try:
        return _opened(job).on(columns, None)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
