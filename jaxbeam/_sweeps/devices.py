"""One function over many chunks of cases, on many devices of this process.

Each device runs the very program that one device would run: `jax.shard_map` compiles another one,
off by rounding (1e-13 in frequencies, and as far as the tolerance allows in adaptive runs), and
makes the devices wait for each other. So a thread feeds each device, and the numbers of a case do
not depend on how many there are.
"""

import collections
import concurrent.futures
import itertools
from collections.abc import Callable, Generator, Sequence
from typing import Any

import jax

from jaxbeam._sweeps.chunks import Columns, Work
from jaxbeam._sweeps.store import ChunkResults


def checked_devices(devices: Any) -> tuple[jax.Device | None, ...]:
    """Devices of this process, some possibly named several times; the default one for `None`."""
    if devices is None:
        return (None,)
    given = tuple(devices) if isinstance(devices, Sequence) else ()
    if not given or not all(isinstance(d, jax.Device) for d in given):
        raise TypeError(f"devices must be some of jax.devices(), got {devices!r}")
    kinds = {f"{d.platform} {d.device_kind}" for d in given}
    if len(kinds) > 1:
        raise ValueError(f"devices must be of one kind, got {sorted(kinds)}")
    if any(d.process_index != jax.process_index() for d in given):
        raise ValueError("devices must be of this process, some of jax.local_devices()")
    return given


def on_devices(
    work: Work,
    columns: Callable[[int], Columns],
    numbers: Sequence[int],
    devices: Sequence[jax.Device | None],
) -> Generator[tuple[int, ChunkResults]]:
    """Numbers of chunks and their results, in the order in which they end; each device works on as
    many at a time as it is named."""
    exact = jax.config.read("jax_enable_x64")

    def compute(number: int, device: jax.Device | None) -> ChunkResults:
        if jax.config.read("jax_enable_x64") != exact:
            raise RuntimeError(
                "settings made by a context manager do not reach the threads of devices: use "
                "jax.config.update('jax_enable_x64', True)"
            )
        return work.on(columns(number), device)

    if len(devices) == 1:
        for number in numbers:
            yield number, compute(number, devices[0])
        return
    more = collections.Counter(devices)
    rest = iter(numbers)
    with concurrent.futures.ThreadPoolExecutor(len(devices)) as pool:
        # One chunk for each device first, so that each compiles once.
        running = {pool.submit(compute, k, d): (k, d) for d, k in zip(more, rest, strict=False)}
        while running:
            ended, _ = concurrent.futures.wait(
                running, return_when=concurrent.futures.FIRST_COMPLETED
            )
            # Results first, errors last, so that no result is lost.
            for future in sorted(ended, key=lambda f: f.exception() is not None):
                number, device = running.pop(future)
                found = future.result()
                for k in itertools.islice(rest, more.pop(device, 1)):
                    running[pool.submit(compute, k, device)] = k, device
                yield number, found
