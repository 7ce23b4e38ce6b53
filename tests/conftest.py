"""Strict numerics for the whole session, set before anything is computed."""

import contextlib
import ctypes
import gc
import math
import os
import time
from collections.abc import Iterator
from pathlib import Path

import equinox as eqx
import jax
import pytest
from jax._src.xla_bridge import backends_are_initialized

from tests import shapes
from tests.compilation import xla_flags

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_num_cpu_devices", 8)  # virtual ones, for sweeps over several
gc.set_threshold(100_000, 50, 100)  # tracing makes many objects, few of them garbage


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("markexpr") != "slow":  # a sixth of the time; quick tests go everywhere
        shapes.check()
    assert not backends_are_initialized(), "too late: XLA has read its flags"
    os.environ["XLA_FLAGS"] = xla_flags(0)


# Files that take long begin first: who comes to one at the end would be left alone with it.
LONG = (
    "test_studies.py", "simulation/test_simulate.py", "ladder/test_space.py",
    "vibration/test_many_modes.py", "simulation/test_manoeuvres.py", "simulation/test_events.py",
)  # fmt: skip


# CI begins no test after this time, in seconds since 1970: on a slow machine some are left to its
# next run, which begins with other files and studies.
UNTIL = float(os.environ.get("TESTS_UNTIL", "inf"))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    if time.time() > UNTIL:
        pytest.skip("no time left")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        item.add_marker(pytest.mark.filterwarnings("error"))
    tests = Path(__file__).parent
    order = {tests / name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: order.get(item.path, len(LONG)))
    if math.isfinite(UNTIL):
        groups = dict.fromkeys(_group(item) for item in items if _group(item) not in order)
        begin = int(UNTIL / 60) % max(len(groups), 1)
        turned = {group: 1 + (k - begin) % len(groups) for k, group in enumerate(groups)}
        items.sort(key=lambda item: turned.get(_group(item), 0))


def _group(item: pytest.Item) -> object:
    """The file; of studies each its own, but for the main one."""
    alone = item.path.name == LONG[0] and not item.get_closest_marker("xdist_group")
    return item.nodeid if alone else item.path


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
