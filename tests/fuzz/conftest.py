"""Random scenes that do not end are told of."""

import contextlib
import faulthandler
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

LONGEST = 1800.0  # s for one random scene: more than any takes on the busiest machine


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
