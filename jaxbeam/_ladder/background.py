"""Programs compiled side by side, on cores that would be idle."""

import os
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, Self


class BackgroundCompiler:
    """A compiler of programs that are likely to be called, in threads, during which XLA releases
    Python's lock.

    A thread only fills JAX's cache of programs, by `lower` and `compile`, which take no time where
    that has them. The call itself is the caller's, and finds its program there; it compiles as
    usual where the thread failed, or was under other settings of JAX than those of the caller.
    """

    def __init__(self) -> None:
        self.threads = ThreadPoolExecutor(os.cpu_count() or 1)
        self.begun: dict[Hashable, Future[Any]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.threads.shutdown(wait=False, cancel_futures=True)

    def begin(self, key: Hashable, compiled: Callable[[], Any]) -> None:
        """Call `compiled` as soon as a core is free, in the order of such calls."""
        if key not in self.begun:
            self.begun[key] = self.threads.submit(compiled)

    def await_it(self, key: Hashable) -> None:
        """Wait for a compilation that has begun; drop one that has not, which the caller then
        does."""
        future = self.begun.get(key)
        if future is not None and not future.cancel():
            wait([future])
