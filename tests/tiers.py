"""Tiers of tests: the one that is run, and marks for single cases of a parametrisation.

What belongs where is said in tests/README.md.
"""

from typing import Any

import pytest

running = ""  # set by conftest.py before any test is imported


def slow(*case: Any, **more: Any) -> Any:
    """A case that CI runs; of a test that is exhaustive otherwise, in both tiers."""
    return pytest.param(*case, marks=pytest.mark.slow, **more)


def exhaustive(*case: Any, **more: Any) -> Any:
    """A case that is left to the exhaustive tier."""
    return pytest.param(*case, marks=pytest.mark.exhaustive, **more)
