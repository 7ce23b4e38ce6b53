"""One function over many chunks of cases, on many devices of this process and of others.

Each device runs the very program that one device would run: `jax.shard_map` compiles another one,
off by rounding (1e-13 in frequencies, and as far as the tolerance allows in adaptive runs), and
makes the devices wait for each other. So a thread feeds each device, and the numbers of a case do
not depend on how many there are. Processes speak to each other between chunks alone.
"""

import collections
import concurrent.futures
import dataclasses
import functools
import io
import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Self, TypeVar

import jax
import numpy as np
from jax.experimental import multihost_utils

from jaxbeam._numerics.program import Program

Result = TypeVar("Result")
Said = tuple[Any, dict[str, np.ndarray]]  # what JSON bears, and arrays
Compute = Callable[[int, jax.Device | None], Said]


@dataclasses.dataclass(frozen=True)
class Team:
    """Devices that share a sweep; `None` stands for the default device."""

    here: tuple[jax.Device | None, ...]  # of this process
    owners: tuple[int, ...]  # process of each device of all

    @classmethod
    def of(cls, devices: Sequence[jax.Device] | None) -> Self:
        """These, those of other processes among them; a device may be named several times."""
        me = jax.process_index()
        if devices is None:
            return cls((None,), (me,))
        given = tuple(devices) if isinstance(devices, Sequence) else ()
        if not given or not all(isinstance(d, jax.Device) for d in given):
            raise TypeError(f"devices must be some of jax.devices(), got {devices!r}")
        kinds = {f"{d.platform} {d.device_kind}" for d in given}
        if len(kinds) > 1:
            raise ValueError(f"devices must be of one kind, got {sorted(kinds)}")
        owners = tuple(d.process_index for d in given)
        if set(owners) not in ({me}, set(range(jax.process_count()))):
            raise ValueError(
                "devices must be of this process alone, or of every process: those of processes "
                f"{sorted(set(owners))} are named here, in process {me} of {jax.process_count()}"
            )
        return cls(tuple(d for d in given if d.process_index == me), owners)

    @property
    def shared(self) -> bool:
        """Whether other processes take part."""
        return len(set(self.owners)) > 1

    @property
    def leads(self) -> bool:
        """Whether this process is the one that writes."""
        return not self.shared or jax.process_index() == 0

    def each(self, compute: Compute, numbers: Sequence[int]) -> Iterator[dict[int, Said]]:
        """What `compute(number, device)` returns for every number, some at a time, as they end.

        Every process is given all of it. Several go ahead in step, a number for each device: so
        none waits long for another, and what fails in one is told to all.
        """
        if not self.shared:
            for number, found in _streamed(compute, numbers, self.here):
                yield {number: found}
            return
        for start in range(0, len(numbers), len(self.owners)):
            dealt = zip(numbers[start : start + len(self.owners)], self.owners, strict=False)
            mine = [number for number, owner in dealt if owner == jax.process_index()]
            every = self.together(functools.partial(_packed, compute, mine, self.here))
            yield {k: unpacked for each in every for k, unpacked in _unpacked(each)}

    def together(self, work: Callable[[], Said]) -> list[Said]:
        """What `work` returns in each process; an exception in one is raised in all."""
        if not self.shared:
            return [work()]
        failure: Exception | None = None
        try:
            said, arrays = work()
        except Exception as error:
            failure, said, arrays = error, None, {}
        failed = None if failure is None else f"{type(failure).__name__}: {failure}"
        content: dict[str, Any] = {f"value:{name}": array for name, array in arrays.items()}
        content["said"] = np.asarray(json.dumps([said, failed]))
        file = io.BytesIO()
        np.savez(file, **content)
        found = []
        for data in _everyones(file.getvalue()):
            with np.load(io.BytesIO(data), allow_pickle=False) as parts:
                values = {n[6:]: parts[n] for n in parts.files if n != "said"}
                found.append((json.loads(str(parts["said"])), values))
        if failure is not None:
            raise failure
        for process, ((_, failed), _) in enumerate(found):
            if failed is not None:
                raise RuntimeError(f"process {process} failed: {failed}")
        return [(said, arrays) for (said, _), arrays in found]

    def in_turn(self, work: Callable[[], Result]) -> Result:
        """`work()`, in the process that leads first, then in the others."""
        results: list[Result] = []

        def take(turn: bool) -> Said:
            if self.leads == turn:
                results.append(work())
            return None, {}

        for turn in (True, False):
            self.together(functools.partial(take, turn))
        return results[0]


def _streamed(
    compute: Compute, numbers: Sequence[int], devices: Sequence[jax.Device | None]
) -> Iterator[tuple[int, Said]]:
    """As they end, one at a time on each device, or as many as the device is named."""
    if len(devices) == 1:
        for number in numbers:
            yield number, compute(number, devices[0])
        return
    exact = jax.config.read("jax_enable_x64")

    def work(number: int, device: jax.Device | None) -> Said:
        if jax.config.read("jax_enable_x64") != exact:
            raise RuntimeError(
                "settings made by a context manager do not reach the threads of devices: use "
                "jax.config.update('jax_enable_x64', True)"
            )
        return compute(number, device)

    more = collections.Counter(devices)
    rest = iter(numbers)
    with concurrent.futures.ThreadPoolExecutor(len(devices)) as pool:
        # One at first, so that each device compiles once.
        running = {pool.submit(work, k, d): (k, d) for d, k in zip(more, rest, strict=False)}
        while running:
            ended, _ = concurrent.futures.wait(
                running, return_when=concurrent.futures.FIRST_COMPLETED
            )
            for future in sorted(ended, key=lambda f: f.exception() is not None):  # lose nothing
                number, device = running.pop(future)
                found = future.result()
                for k in itertools.islice(rest, more.pop(device, 1)):
                    running[pool.submit(work, k, device)] = k, device
                yield number, found


def _packed(compute: Compute, numbers: Sequence[int], devices: Sequence[Any]) -> Said:
    """Several arrays in one, since every transfer between processes has a price."""
    found = dict(_streamed(compute, numbers, devices))
    arrays = {f"{k} {name}": a for k, (_, part) in found.items() for name, a in part.items()}
    return {k: said for k, (said, _) in found.items()}, arrays


def _unpacked(packed: Said) -> Iterator[tuple[int, Said]]:
    texts, arrays = packed
    for k, said in texts.items():
        start = f"{k} "
        part = {n.removeprefix(start): a for n, a in arrays.items() if n.startswith(start)}
        yield int(k), (said, part)


@Program  # its errors, unlike those of jax.jit, say only what went wrong
def batched(function: Callable[..., Any], columns: dict[str, jax.Array]) -> Any:
    """`function(**parameters)` of every case."""
    return jax.vmap(lambda parameters: function(**parameters))(columns)


def _everyones(mine: bytes) -> list[bytes]:
    """What each process hands in, brought to all of them."""
    sizes = multihost_utils.process_allgather(np.asarray(len(mine), np.int32))
    # Of a length that seldom changes: each is compiled for.
    padded = np.zeros(1 << int(sizes.max() - 1).bit_length(), np.uint8)
    padded[: len(mine)] = np.frombuffer(mine, np.uint8)
    every = multihost_utils.process_allgather(padded)
    return [data[:size].tobytes() for data, size in zip(every, sizes, strict=True)]
