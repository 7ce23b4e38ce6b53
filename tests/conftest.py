"""Strict numerics for the whole session, set before anything is computed."""

import contextlib
import ctypes
import faulthandler
import gc
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

from tests.helpers import OLD_EMITTERS

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_num_cpu_devices", 8)  # virtual ones, for sweeps over several
# Much of the time of all tests is LLVM's: here it does not optimise. What users run, optimised, is
# tested in processes of their own: the README, and what takes `tests.helpers.USERS`.
os.environ["XLA_FLAGS"] = " ".join(["--xla_backend_optimization_level=0", *OLD_EMITTERS])
gc.set_threshold(100_000, 50, 100)  # tracing makes many objects, few of them garbage


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


LONGEST = 300.0  # s for one random scene, with its compilation on a busy machine


@pytest.fixture
def watched(request: pytest.FixtureRequest, testrun_uid: str) -> Iterator[Callable]:
    """`with watched(scene):` ends the process with a traceback where a random scene does not end.

    pytest-xdist starts a test again whose process ended: then tell of the scene instead. NumPy need
    not warn: what is not finite is found by comparisons.
    """
    test = hashlib.sha256(f"{testrun_uid} {request.node.nodeid}".encode()).hexdigest()
    current = Path(tempfile.gettempdir(), f"jaxbeam-fuzz-{test[:16]}")
    if current.exists():
        scene = current.read_text()
        current.unlink()
        pytest.fail(f"the process ended (after {LONGEST:.0f} s?) at: {scene}")
    # A traceback is to be seen although pytest captures what tests write.
    with request.config.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
        terminal = os.dup(2)

    @contextlib.contextmanager
    def watch(scene: object) -> Iterator[None]:
        current.write_text(repr(scene))
        faulthandler.dump_traceback_later(LONGEST, exit=True, file=terminal)
        try:
            with np.errstate(all="ignore"):
                yield
        finally:
            faulthandler.cancel_dump_traceback_later()

    yield watch
    current.unlink(missing_ok=True)
    os.close(terminal)
