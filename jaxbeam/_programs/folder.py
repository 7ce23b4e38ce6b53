"""The folder in which programs are kept between processes."""

import contextlib
import hashlib
import importlib
import importlib.util
import os
import platform
import stat
import tempfile
import time
import warnings
import zlib
from pathlib import Path
from typing import NamedTuple

import jax
from jax.experimental.compilation_cache import compilation_cache

_MAGIC = b"jaxbeam, a traced program\n"
_STAMP = ".looked_at"  # its time is when files of JAX's cache were last checked
_ZSTD = b"\x28\xb5\x2f\xfd"  # first bytes of files compressed by Zstandard, not by zlib
_ABANDONED = 3600.0  # s: an unfinished file of this age is not being written any more
_UNUSED = 90 * 86400.0  # s: programs that were not read for so long are removed


class ProgramFolder(NamedTuple):
    """The folder of traced programs; its `traced` is None where none are kept."""

    path: Path
    traced: Path | None

    def read(self, key: str) -> bytes | None:
        """The bytes that were kept under this name; None where there are none or they are
        damaged."""
        if self.traced is None:
            return None
        try:
            said = (self.traced / key).read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            warn_once(f"{self.traced} cannot be read ({error})")
            return None
        body = said[len(_MAGIC) + 32 :]
        if said != _MAGIC + hashlib.sha256(body).digest() + body:
            warn_once(f"{self.traced / key} is damaged")
            return None
        return body

    def write(self, key: str, body: bytes) -> None:
        """Write bytes under a name: all of them or nothing, whatever happens to this process."""
        if self.traced is None:
            return
        try:
            _write(self.traced / key, _MAGIC + hashlib.sha256(body).digest() + body)
        except OSError as error:
            warn_once(f"{self.traced} cannot be written to ({error})")


_folder: ProgramFolder | None = None
_warned = False


def folder() -> ProgramFolder | None:
    """The folder in which programs are kept, if they are."""
    return _folder


def keep(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Keep programs in a folder, between processes.

    What follows is traced and compiled once for all processes that keep the same `folder`. By
    default it is what the environment names (`JAXBEAM_KEEP`; "off" there keeps nothing), or else
    `jaxbeam` in the folder of the user's caches (`XDG_CACHE_HOME`, or `~/.cache`). It has the
    compiled programs of JAX's own cache, which is set to keep all of them there, and beside them
    traced programs of this package by `jax.export`, for which there is
    `pip install "jaxbeam[keep]"`: without it each process traces anew. Programs that no process has
    asked for in 90 days are removed, and the folder may be deleted any time.

    Results are the same to the last bit whether a program was kept or is new. A program belongs to
    all that it is made of: model, shapes, types and functions of this package, the sources of
    this package, versions of Python, JAX and all others that have a part in it, and settings of
    JAX. Numbers are its arguments, and functions among these, such as loads by time, are told from
    others as `kept` tells them. What cannot be told, such as a class of yours, is traced in each
    process; `kept` is for compiled functions of yours.

    Returns the folder, or None where nothing is kept: the environment says so, or the folder
    cannot be made. Then, and where a file is damaged or cannot be written, there is one warning in
    a process, and programs are made as if none were kept.

    Raises `TypeError` unless `folder` is a path, and `ValueError` where it belongs to another user
    or others may write to it: they could have your process run programs of theirs.
    """
    global _folder
    if not isinstance(folder, str | os.PathLike | None):
        raise TypeError(f"folder must be a path, got {type(folder).__name__}")
    named = folder or os.environ.get("JAXBEAM_KEEP") or _caches()
    if folder is None and named == "off":
        return None
    try:
        path = Path(named).expanduser().absolute()
        compiled, traced = path / "compiled" / _machine(), path / "traced"
        for each in (path, traced, path / "compiled", compiled):
            each.mkdir(mode=0o700, parents=True, exist_ok=True)
            _refuse_foreign(each)
    except (OSError, RuntimeError) as error:  # there is no home
        warn_once(f"{named} cannot be made ({error})")
        return None
    has_format = importlib.util.find_spec("flatbuffers") is not None
    if not has_format:
        warn_once('traced programs need `pip install "jaxbeam[keep]"`, compiled ones are kept')
    _mend(compiled)
    writable = _is_writable(compiled)
    _tidy(path)
    jax.config.update("jax_compilation_cache_dir", str(compiled))
    # JAX would warn of each program that it cannot write.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0 if writable else 1e9)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    compilation_cache.reset_cache()  # JAX's cache may have chosen its folder already
    _folder = ProgramFolder(path, traced if has_format else None)
    return path


def warn_once(why: str) -> None:
    """Warn that programs are not kept and why, once in a process."""
    global _warned
    if not _warned:
        _warned = True
        warnings.warn(f"not all programs are kept: {why}", stacklevel=3)


def _caches() -> Path:
    caches = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(caches) if os.path.isabs(caches) else Path("~/.cache")) / "jaxbeam"


def _machine() -> str:
    """A name for this kind of processor, a digest of its model and flags: some releases of JAX run
    programs that were compiled for other processors."""
    said = platform.machine()
    with contextlib.suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
        said += "".join(line for line in lines if line.startswith(("model name", "flags", "Feat")))
    return hashlib.sha256(said.encode()).hexdigest()[:12]


def _refuse_foreign(path: Path) -> None:
    """Raise `ValueError` where other users may write to a folder."""
    status = path.stat()
    if not hasattr(os, "geteuid"):
        return  # Windows: folders of a user are that user's
    if status.st_uid != os.geteuid():
        raise ValueError(f"folder must be yours, and {path} belongs to user {status.st_uid}")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise ValueError(f"folder must be yours alone to write to: chmod go-w {path}")


def _mend(compiled: Path) -> None:
    """Remove incomplete files of JAX's cache, among those written since the last check. JAX writes
    in place, so that a process that is killed leaves half a file: JAX would warn of it in all other
    processes and never replace it."""
    stamp = compiled / _STAMP
    with contextlib.suppress(OSError):
        since = stamp.stat().st_mtime - 10.0 if stamp.exists() else 0.0
        for file in compiled.glob("*-cache"):
            if file.stat().st_mtime >= since and not _is_whole(file.read_bytes()):
                file.unlink(missing_ok=True)


def _is_whole(said: bytes) -> bool:
    try:
        _decompress(said)
    except ImportError:
        return True  # JAX cannot read it either
    except Exception:  # each library raises errors of its own
        return False
    return True


def _decompress(said: bytes) -> None:
    if not said.startswith(_ZSTD):
        zlib.decompress(said)
    elif importlib.util.find_spec("zstandard"):
        importlib.import_module("zstandard").ZstdDecompressor().decompress(said)
    else:  # zstd is part of Python from 3.14 on
        importlib.import_module("compression.zstd").decompress(said)


def _is_writable(path: Path) -> bool:
    try:
        _write(path / _STAMP, b"")
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
    """Remove unfinished files of processes that were killed, and programs that were not read for a
    long time, those of earlier versions among them. A process that is reading one has it open
    already; others make it anew."""
    now = time.time()
    for part in path.glob("traced/.*.part"):
        with contextlib.suppress(OSError):
            if now - part.stat().st_mtime > _ABANDONED:
                part.unlink(missing_ok=True)
    for file in (*path.glob("traced/[!.]*"), *path.glob("compiled/*/*-cache")):
        with contextlib.suppress(OSError):
            status = file.stat()
            if now - max(status.st_atime, status.st_mtime) > _UNUSED:
                file.unlink(missing_ok=True)
