"""Results of a sweep, chunk by chunk: in memory, or in a folder that outlives the process.

A folder holds

    sweep.json     what sweep it is: program, parameters, chunk, results, precision, versions
    cases.npz      the parameters of all cases
    NAME.npy       one ordinary NumPy array for each result, all cases along its first axis
    index.txt      a line for each finished chunk: checksums of its part of each array

A chunk is written into the arrays first and into the index then. So whatever ends the process, a
chunk is in the index only if it was written whole; and as its checksums are compared with the
arrays on opening, it counts only if it still is. Lines of the index carry a checksum too, and the
mark of their sweep, so that those of another one do not count: a folder may be removed under a
sweep, and another begin in its place.
"""

import contextlib
import io
import json
import os
import urllib.parse
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxbeam._sweeps.cases import Cases

_FORMAT = 3
_NEW = ".new-"  # prefix of files that are not in place yet
INFORMATION = ("function", "reads")  # entries for people only: folders are compared by program


class Spec(NamedTuple):
    """The type and shape of one result of one case."""

    dtype: np.dtype
    shape: tuple[int, ...]

    def blank(self, n: int) -> np.ndarray:
        """Placeholders for n cases: NaN, or zero for types without NaN."""
        filled = np.nan if np.issubdtype(self.dtype, np.inexact) else 0
        return np.full((n, *self.shape), filled, self.dtype)


class ChunkResults(NamedTuple):
    """Results of a chunk by name, and messages of cases that raised, by their index in it."""

    results: dict[str, np.ndarray]
    errors: dict[int, str]
    computed: bool = True  # false where every worker that tried died


class _Chunks:
    """The division of cases into chunks of `chunk` cases, of which the last may be shorter."""

    def __init__(self, n: int, chunk: int) -> None:
        self.n, self.chunk = n, chunk
        self.number = -(-n // chunk)

    def length(self, number: int) -> int:
        """The number of cases in the chunk of this number."""
        return min(self.chunk, self.n - number * self.chunk)

    def by_case(self, number: int, part: ChunkResults) -> dict[int, str]:
        """Messages of a chunk by number of the case in the sweep."""
        return {number * self.chunk + place: text for place, text in part.errors.items()}


class Memory(_Chunks):
    """A store of results in memory."""

    def __init__(self, specs: Mapping[str, Spec], n: int, chunk: int) -> None:
        super().__init__(n, chunk)
        self._results = {name: spec.blank(n) for name, spec in specs.items()}
        self._errors: dict[int, str] = {}
        self._left = dict.fromkeys(range(self.number))

    def missing(self) -> list[int]:
        """Numbers of the chunks without results."""
        return list(self._left)

    def put(self, number: int, part: ChunkResults) -> None:
        """Keep the results of a chunk."""
        start = number * self.chunk
        del self._left[number]
        for name, values in part.results.items():
            self._results[name][start : start + len(values)] = values
        self._errors |= self.by_case(number, part)

    def collected(self) -> tuple[dict[str, np.ndarray], dict[int, str]]:
        """Results and messages of all cases."""
        assert not self._left
        return self._results, self._errors


class ResultFolder(_Chunks):
    """A store of results in a folder, made by `opened` or `reopened`."""

    def __init__(
        self, folder: Path, mark: str, specs: Mapping[str, Spec], n: int, chunk: int
    ) -> None:
        super().__init__(n, chunk)
        self.folder, self.mark, self.specs = folder, mark, specs
        self.errors = self._finished()
        self.computed: dict[int, bool] = {}  # chunks that were put; false for those given up

    def missing(self) -> list[int]:
        """Numbers of the chunks without complete results."""
        return [k for k in range(self.number) if k not in self.errors]

    def put(self, number: int, part: ChunkResults) -> None:
        """Write a chunk; one that was not computed is missing when the folder is opened again."""
        errors = self.by_case(number, part)
        try:
            self._must_be_ours()
            checks = {}
            for name, values in part.results.items():
                data = np.ascontiguousarray(values, self.specs[name].dtype).tobytes()
                checks[name] = zlib.crc32(data)
                self._write(name, number, data)
            if part.computed:
                self._finish(number, checks, errors)
        # Raised if the folder is removed after the check.
        except (FileNotFoundError, NotADirectoryError):
            raise _taken(self.folder) from None
        except OSError as error:
            raise _told(error, self.folder) from error
        self.errors[number], self.computed[number] = errors, part.computed

    def collected(self) -> tuple[dict[str, np.ndarray], dict[int, str]]:
        """Results, as arrays mapped from their files, and messages of all cases."""
        if self.computed:  # other processes may have written meanwhile
            self._must_be_ours()
            given_up = [k for k, computed in self.computed.items() if not computed]
            self.errors = {**self._finished(), **{k: self.errors[k] for k in given_up}}
        missing = self.missing()
        if missing:
            raise ValueError(
                f"{self.folder}: {len(missing)} of {self.number} chunks are missing or "
                "damaged; run the same sweep again to compute them"
            )
        results = {}
        for name, spec in self.specs.items():
            shape = (self.n, *spec.shape)
            if 0 in shape:
                results[name] = np.zeros(shape, spec.dtype)
            else:
                start = len(self._header(name))
                results[name] = np.memmap(self._file(name), spec.dtype, "r", start, shape)
        return results, {i: e for part in self.errors.values() for i, e in part.items()}

    def _finished(self) -> dict[int, dict[int, str]]:
        """Messages of the chunks that are complete, by number of the chunk."""
        index = self.folder / "index.txt"
        lines = index.read_bytes().split(b"\n") if index.exists() else []
        finished = {}
        for line in lines:
            check, _, text = line.partition(b" ")
            if check == _check(text):
                entry = json.loads(text)
                number = entry["chunk"]
                if entry.get("sweep") == self.mark and entry["checks"] == self._checks(number):
                    finished[number] = {int(i): e for i, e in entry["errors"].items()}
        return finished

    def _finish(self, number: int, checks: dict[str, int], errors: dict[int, str]) -> None:
        """Write the line of the index that says that a chunk is complete."""
        entry = {"sweep": self.mark, "chunk": number, "checks": checks, "errors": errors}
        text = json.dumps(entry).encode()
        with open(self.folder / "index.txt", "ab+") as file:
            # This line must not follow a half-written line of a process that died.
            torn = file.tell() and (file.seek(-1, os.SEEK_END), file.read())[1] != b"\n"
            file.write(b"\n" * bool(torn) + _check(text) + b" " + text + b"\n")

    def _must_be_ours(self) -> None:
        try:
            ours = _digest(_identity(self.folder)) == self.mark
        except ValueError:  # raised if this is no folder of a sweep
            ours = False
        if not ours:
            raise _taken(self.folder)

    def _file(self, name: str) -> Path:
        return self.folder / f"{urllib.parse.quote(name, safe=' ')}.npy"

    def _header(self, name: str) -> bytes:
        spec = self.specs[name]
        description = np.lib.format.dtype_to_descr(spec.dtype)
        header = {"descr": description, "fortran_order": False, "shape": (self.n, *spec.shape)}
        file = io.BytesIO()
        np.lib.format.write_array_header_1_0(file, header)
        return file.getvalue()

    def _place(self, name: str, number: int) -> tuple[int, int]:
        """Offset and length, in bytes, of the part of a chunk in the file of a result."""
        start = number * self.chunk
        spec = self.specs[name]
        row = spec.dtype.itemsize * int(np.prod(spec.shape, dtype=int))
        return len(self._header(name)) + start * row, self.length(number) * row

    def _checks(self, number: int) -> dict[str, int]:
        """Checksums of the parts of a chunk in the files, of those that can be read."""
        checks = {}
        for name in self.specs:
            place, length = self._place(name, number)
            try:
                with open(self._file(name), "rb") as file:
                    header = self._header(name)
                    whole = file.read(len(header)) == header
                    file.seek(place)
                    data = file.read(length)
            except FileNotFoundError:
                continue
            if whole and len(data) == length:
                checks[name] = zlib.crc32(data)
        return checks

    def _write(self, name: str, number: int, data: bytes) -> None:
        path, header = self._file(name), self._header(name)
        place, _ = self._place(name, number)
        path.touch()
        with open(path, "r+b") as file:
            if file.read(len(header)) != header:
                file.seek(0)
                file.write(header)
            file.seek(place)
            file.write(data)


def opened(
    folder: Path, identity: dict[str, Any], specs: Mapping[str, Spec], cases: Cases
) -> ResultFolder:
    """The folder of this sweep, new or to go on with; one of another sweep is refused."""
    results = {name: [spec.dtype.str, list(spec.shape)] for name, spec in specs.items()}
    if len({name.casefold() for name in results}) < len(results):
        raise ValueError(f"names of results must differ in more than case, got {list(results)}")
    described = {"format": _FORMAT, **identity, "results": results}
    try:
        files = os.listdir(folder) if folder.exists() else []
        if "sweep.json" in files:
            there = _identity(folder)
            _refuse_another(folder, there, described)
            described = there  # the mark of its lines in the index
        elif any(not name.startswith(_NEW) for name in files):
            raise ValueError(
                f"{folder} holds files that are not of a sweep: name a folder that is new or empty"
            )
        else:
            folder.mkdir(parents=True, exist_ok=True)
            text = json.dumps({**described, "check": _digest(described)}, indent=2)
            _replace(folder / "sweep.json", text.encode())
        if not _whole(_cases(folder), identity):
            file = io.BytesIO()
            arrays: dict[str, Any] = {f"axis:{n}": a for n, a in cases.axes.items()}
            arrays |= {f"list:{n}": a for n, a in (cases.of_list or {}).items()}
            np.savez(file, **arrays)
            _replace(folder / "cases.npz", file.getvalue())
    except OSError as error:
        raise _told(error, folder) from error
    return ResultFolder(folder, _digest(described), specs, len(cases), identity["chunk"])


def reopened(folder: Path) -> tuple[ResultFolder, dict[str, Any], Cases]:
    """The folder of any sweep, the identity of this sweep, and its cases."""
    identity, cases = _identity(folder), _cases(folder)
    if identity["format"] != _FORMAT:
        raise ValueError(
            f"{folder} is of another version, whose folders have the format {identity['format']}, "
            f"while this one reads {_FORMAT}: run the sweep again, with another folder"
        )
    if cases is None or not _whole(cases, identity):
        raise ValueError(f"{folder}: cases.npz is missing or damaged; run the same sweep again")
    specs = {
        n: Spec(_readable(folder, n, d), tuple(s)) for n, (d, s) in identity["results"].items()
    }
    store = ResultFolder(folder, _digest(identity), specs, len(cases), identity["chunk"])
    return store, identity, cases


def _readable(folder: Path, name: str, described: str) -> np.dtype:
    """The type of a result from its description; earlier versions had none for types beyond those
    of NumPy."""
    with contextlib.suppress(TypeError):
        dtype = np.dtype(described)
        if dtype.kind in "biufc":
            return dtype
    raise ValueError(
        f"{folder}: {name} was written as {described!r}, which does not say what its numbers are: "
        "run the sweep again, with another folder"
    )


def _identity(folder: Path) -> dict[str, Any]:
    try:
        identity = json.loads((folder / "sweep.json").read_text())
        if identity.pop("check") != _digest(identity):
            raise ValueError("its checksum is another one")
    except FileNotFoundError:
        raise ValueError(f"{folder} is not the folder of a sweep: it has no sweep.json") from None
    except (ValueError, KeyError) as error:
        raise ValueError(
            f"{folder}/sweep.json is damaged, so it cannot be said whose results these are: name "
            "another folder"
        ) from error
    return identity


def _digest(identity: dict[str, Any]) -> str:
    return _check(json.dumps(identity).encode()).decode()


def _refuse_another(folder: Path, there: dict[str, Any], here: dict[str, Any]) -> None:
    # Compared as texts, since the order of parameters and dimensions matters.
    names = [name for name in {**here, **there} if name not in INFORMATION]
    both = {name: [json.dumps(one.get(name)) for one in (there, here)] for name in names}
    other = {name: texts for name, texts in both.items() if texts[0] != texts[1]}
    if other:
        said = [
            f"{n} (there {a}, here {b})" if len(a + b) < 60 else n for n, (a, b) in other.items()
        ]
        raise ValueError(
            f"{folder} belongs to another sweep, of {there.get('function')}, different in "
            f"{', '.join(said)}: name another folder, or remove this one"
        )


def _cases(folder: Path) -> Cases | None:
    try:
        with np.load(folder / "cases.npz", allow_pickle=False) as file:
            axes = {n[5:]: file[n] for n in file.files if n.startswith("axis:")}
            of_list = {n[5:]: file[n] for n in file.files if n.startswith("list:")}
    except PermissionError:
        raise
    except Exception:  # errors of NumPy, zipfile and zlib for damaged files
        return None
    return Cases(axes, of_list or None)


def _whole(cases: Cases | None, identity: dict[str, Any]) -> bool:
    return cases is not None and cases.described() == identity["parameters"]


def _replace(path: Path, data: bytes) -> None:
    """Write a file whole or not at all, by renaming."""
    # A unique name, since others may write it, too.
    new = path.with_name(f"{_NEW}{path.name}.{os.urandom(8).hex()}")
    with open(new, "wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    os.replace(new, path)


def _check(text: bytes) -> bytes:
    return f"{zlib.crc32(text):08x}".encode()


def _told(error: OSError, folder: Path) -> OSError:
    text = (
        f"cannot write to {folder}: {error.strerror or error}. Chunks finished before are intact: "
        "once this is mended, the same sweep goes on from there"
    )
    return OSError(error.errno, text)


def _taken(folder: Path) -> RuntimeError:
    return RuntimeError(
        f"{folder} was removed, or taken over by another sweep, while this one wrote to it, so "
        "that its results are lost: run it again, into a folder that is left alone until it ends"
    )
