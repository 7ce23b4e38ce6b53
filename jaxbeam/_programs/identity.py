"""Sources, versions and settings, on which a kept program depends besides its arguments."""

import functools
import hashlib
import importlib.metadata
import os
import platform
import time
from pathlib import Path
from typing import Any

import jax
from jax.extend import backend

from jaxbeam._programs.structure import NotKept

_SOURCES = Path(__file__).parents[1]
_STARTED = time.time_ns()
_VERSIONS = ("jax", "jaxlib", "numpy", "equinox", "diffrax", "optimistix", "lineax")
FORMAT = 1  # version of the format of kept files


@functools.cache
def sources() -> tuple[str, int]:
    """A digest of the package as this process runs it, and when a file of it was last changed.

    Raises `NotKept` where a file is younger than the process: what runs may be an older one.
    """
    digest, last = hashlib.sha256(), 0
    files = sorted(_SOURCES.rglob("*.py"))
    for path in files:
        text = path.read_bytes()
        digest.update(f"{path.relative_to(_SOURCES)} {len(text)}\n".encode() + text)
        last = max(last, path.stat().st_mtime_ns)
    if not files or last > _STARTED:
        raise NotKept("a source of jaxbeam that has changed since it was imported")
    return digest.hexdigest(), last


def sources_stayed() -> bool:
    """Whether no file of the package has changed since `sources` was asked."""
    return max(path.stat().st_mtime_ns for path in _SOURCES.rglob("*.py")) == sources()[1]


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python and of all packages that traced programs depend on."""
    found = {name: importlib.metadata.version(name) for name in _VERSIONS}
    return {"python": platform.python_version(), "format": str(FORMAT), **found}


def settings() -> tuple[Any, ...]:
    """Current settings of JAX, without those of its cache, and EQX_ON_ERROR of the environment."""
    named = jax.config.values
    read = tuple(getattr(jax.config, name, None) for name in named if "cache" not in name)
    return (*read, os.environ.get("EQX_ON_ERROR"))


def surroundings() -> dict[str, Any]:
    """Everything that a program depends on beside its arguments and its function, as text."""
    names = [name for name in jax.config.values if "cache" not in name]
    return {
        "sources": sources()[0],
        "versions": versions(),
        "settings": {**dict(zip(names, map(repr, settings()), strict=False)),
                     "on_error": os.environ.get("EQX_ON_ERROR")},
        "backends": sorted(backend.backends()),
        "backend": [jax.default_backend(), jax.device_count()],
    }  # fmt: skip
