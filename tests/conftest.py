"""Strict numerics for the whole session, set before anything is computed."""

import contextlib
import ctypes
import gc
import os
from collections.abc import Iterator
from pathlib import Path

import equinox as eqx
import jax
import pytest
from jax._src.xla_bridge import backends_are_initialized

from tests import shapes, tiers
from tests.compilation import xla_flags

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_num_cpu_devices", 8)  # virtual ones, for sweeps over several
gc.set_threshold(100_000, 50, 100)  # tracing makes many objects, few of them garbage


def pytest_configure(config: pytest.Config) -> None:
    tiers.running = config.getoption("markexpr")
    if tiers.running in ("exhaustive", "release"):  # a sixth of the time
        shapes.check()
    assert not backends_are_initialized(), "too late: XLA has read its flags"
    os.environ["XLA_FLAGS"] = xla_flags(0)
    os.environ["JAXBEAM_KEEP"] = "off"  # what a command keeps in the folder of the user


# Files that take long begin first: who comes to one at the end would be left alone with it.
LONG = (
    "studies/test_methods.py", "studies/test_papers.py", "simulation/test_simulate.py",
    "models/test_space.py", "vibration/test_space.py", "vibration/test_modes.py",
    "ladder/test_space.py", "vibration/test_many_modes.py", "simulation/test_manoeuvres.py",
    "simulation/test_events.py", "test_results.py",
)  # fmt: skip


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        item.add_marker(pytest.mark.filterwarnings("error"))
    tests = Path(__file__).parent
    order = {tests / name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: order.get(item.path, len(LONG)))


@pytest.fixture(autouse=True)
def _room_for_programs() -> Iterator[None]:
    """Compiled programs keep memory, and memory maps; with all 65,530 of Linux taken the compiler
    crashes."""
    yield
    maps = Path("/proc/self/maps")
    if not maps.exists():
        return
    resident = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    if maps.read_bytes().count(b"\n") > 30_000 or resident > 4 << 30:
        jax.clear_caches()
        eqx.clear_caches()
        gc.collect()
        # The allocator of Linux keeps what is freed: we would come here after every test.
        with contextlib.suppress(AttributeError):
            ctypes.CDLL(None).malloc_trim(0)
