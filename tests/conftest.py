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

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_num_cpu_devices", 8)  # virtual ones, for sweeps over several
gc.set_threshold(100_000, 50, 100)  # tracing makes many objects, few of them garbage


def pytest_configure(config: pytest.Config) -> None:
    from tests import shapes

    shapes.check()
    from tests.helpers import xla_flags  # imports the package, which is to be checked

    os.environ["XLA_FLAGS"] = xla_flags(0)  # what asks for more is in tests/helpers.py


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        item.add_marker(pytest.mark.filterwarnings("error"))


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
