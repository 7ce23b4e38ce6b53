"""The folder in which programs are kept between processes."""

import contextlib
import hashlib
import importlib.util
import os
import stat
import tempfile
import time
import warnings
from pathlib import Path
from typing import NamedTuple

import jax
from jax.experimental.compilation_cache import compilation_cache

_MAGIC = b"jaxbeam, a traced program\n"
_ABANDONED = 3600.0  # s: nobody writes a file for so long


class Folder(NamedTuple):
    """Where traced programs are kept, or None where none are."""

    path: Path
    traced: Path | None

    def read(self, key: str) -> bytes | None:
        """What was kept under this name, whole; or None."""
        if self.traced is None:
            return None
        try:
            said = (self.traced / key).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            return warn_once(f"{self.traced} cannot be read ({error})")
        body = said[len(_MAGIC) + 32 :]
        if said != _MAGIC + hashlib.sha256(body).digest() + body:
            return warn_once(f"{self.traced / key} is damaged")
        return body

    def write(self, key: str, body: bytes) -> None:
        """Keep this under a name: all of it or nothing, whatever happens to this process."""
        if self.traced is None:
            return
        try:
            _write(self.traced / key, _MAGIC + hashlib.sha256(body).digest() + body)
        except OSError as error:
            warn_once(f"{self.traced} cannot be written to ({error})")


_folder: Folder | None = None
_warned = False


def folder() -> Folder | None:
    """Where programs are kept, if they are."""
    return _folder


def keep(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Keep programs in a folder, between processes.

    What follows is traced and compiled once for all processes that keep the same `folder`: by
    default `jaxbeam` in the folder of the user's caches (`XDG_CACHE_HOME`, or `~/.cache`). It holds
    the compiled programs of JAX's own cache, of which it sets the folder and that every program is
    worth it, and beside them the traced ones of this package by `jax.export`; with `pip install
    "jaxbeam[keep]"`, without which a process traces anew. The folder may be deleted at any time.

    Results are the same to the last bit, whether a program was kept or is new. A program belongs to
    what it is of (model, shapes, types, functions of this package), to the sources of this package,
    to versions of JAX and of all others that it is made with, and to JAX's settings; numbers are
    arguments. What cannot be told from others, a function of yours say, is traced as ever.

    Returns the folder; None where it cannot be made, with a warning. There is one for each process,
    too, where a file is damaged or cannot be written: then programs are made as if none were kept.

    Raises `TypeError` unless `folder` is a path, and `ValueError` where it belongs to another user
    or others may write to it: they could have your process run programs of theirs.
    """
    global _folder
    if not isinstance(folder, str | os.PathLike | None):
        raise TypeError(f"folder must be a path, got {type(folder).__name__}")
    try:
        path = Path(_default() if folder is None else folder).expanduser().absolute()
        for each in (path, path / "compiled", path / "traced"):
            each.mkdir(mode=0o700, parents=True, exist_ok=True)
            _refuse_foreign(each)
    except (OSError, RuntimeError) as error:  # no home
        warn_once(f"{folder or 'the folder of caches'} cannot be made ({error})")
        return None
    traced: Path | None = path / "traced"
    if importlib.util.find_spec("flatbuffers") is None:
        warn_once('traced programs need flatbuffers (pip install "jaxbeam[keep]")')
        traced = None
    writable = _is_writable(path / "compiled")
    _tidy(path / "traced")
    jax.config.update("jax_compilation_cache_dir", str(path / "compiled"))
    # JAX warns for each program that it cannot write.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0 if writable else 1e9)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    compilation_cache.reset_cache()  # it may have looked for its folder already
    _folder = Folder(path, traced)
    return path


def warn_once(why: str) -> None:
    """Say why programs are not kept, once in a process."""
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(f"programs are compiled and not kept: {why}", stacklevel=2)


def _default() -> Path:
    caches = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(caches) if os.path.isabs(caches) else Path.home() / ".cache") / "jaxbeam"


def _refuse_foreign(path: Path) -> None:
    """Raise where others may write."""
    status = path.stat()
    if not hasattr(os, "geteuid"):
        return  # Windows: folders of a user are that user's
    if status.st_uid != os.geteuid():
        raise ValueError(f"folder must be yours, and {path} belongs to user {status.st_uid}")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise ValueError(f"folder must be yours alone to write to: chmod go-w {path}")


def _is_writable(path: Path) -> bool:
    try:
        _write(path / ".written", b"")
    except OSError as error:
        warn_once(f"{path} cannot be written to ({error})")
        return False
    return True


def _write(path: Path, body: bytes) -> None:
    handle, name = tempfile.mkstemp(prefix=".", suffix=".part", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(body)
        os.replace(name, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise


def _tidy(path: Path) -> None:
    """Remove what processes left that were killed while they wrote."""
    with contextlib.suppress(OSError):
        for part in path.glob(".*.part"):
            if time.time() - part.stat().st_mtime > _ABANDONED:
                part.unlink(missing_ok=True)
