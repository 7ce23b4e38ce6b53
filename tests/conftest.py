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


def pytest_configure(config: pytest.Config) -> None:
    # Most of the quick tests' time is LLVM's; the slow ones compile as users do.
    if config.option.markexpr == "not slow":
        light = "--xla_backend_optimization_level=0"
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {light}".strip()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        item.add_marker(pytest.mark.filterwarnings("error"))


@pytest.fixture(autouse=True)
def _room_for_programs():
    """Compiled programs keep memory maps; with all 65,530 of Linux taken the compiler crashes."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > 30_000:
        jax.clear_caches()
        eqx.clear_caches()
        gc.collect()
