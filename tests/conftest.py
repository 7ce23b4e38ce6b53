"""Strict numerics for the whole session, set before anything is computed."""

import gc
import os
from pathlib import Path

import equinox as eqx
import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_num_cpu_devices", 8)  # virtual ones, for sweeps over several
# Much of the time of all tests is LLVM's: here it does not optimise. What users run, optimised, is
# tested in processes of their own: the README, the studies, and what takes `tests.helpers.USERS`.
os.environ["XLA_FLAGS"] = "--xla_backend_optimization_level=0"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        item.add_marker(pytest.mark.filterwarnings("error"))


@pytest.fixture(autouse=True)
def _room_for_programs():
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
