"""Programs traced once for all processes, by `jax.export`."""

import hashlib
import json
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
from jax import export

from jaxbeam._programs.folder import ProgramFolder, folder, warn_once
from jaxbeam._programs.functions import identity
from jaxbeam._programs.identity import settings, sources_stayed, surroundings
from jaxbeam._programs.structure import Encoder, NotKept, decoded

_Outside = tuple[tuple[Any, ...], dict[str, Any]]


class TracedProgram(NamedTuple):
    """An exported program of arrays, and the result of its function with placeholders for these."""

    exported: Any
    leaves: list[Any]  # leaves of the result, `_ArrayPlace` for arrays
    structure: Any  # structure of the result
    compiled: dict[Any, Callable[..., Any]]  # programs by options of the compiler

    def program(self, options: dict[str, Any]) -> Any:
        """The program of arrays as a `jax.jit`, compiled with these options."""
        how = tuple(options.items())
        if how not in self.compiled:
            exported = self.exported

            def call(*arrays: Any) -> Any:
                return exported.call(*arrays)

            # Name of the function, by which JAX names its program.
            call.__name__ = exported.fun_name
            self.compiled[how] = jax.jit(call, compiler_options=options or None)
        return self.compiled[how]

    def result(self, found: list[Any]) -> Any:
        """The result of the function, with the arrays that the program returned."""
        leaves = [found[x.index] if isinstance(x, _ArrayPlace) else x for x in self.leaves]
        return jax.tree.unflatten(self.structure, leaves)


class _ArrayPlace:
    """A placeholder for the array of this index among those that a program returns."""

    def __init__(self, index: int) -> None:
        self.index = index


class Traces:
    """Traced programs of one function, by kinds of arguments."""

    def __init__(
        self, name: Callable[[], Any], function: Callable[..., Any],
        refused: Callable[[Exception], object],
    ) -> None:  # fmt: skip
        """`name` tells the function from others, and `refused` hears why a program is not kept."""
        self._name, self._function, self._refused = name, function, refused
        self._found: dict[Any, TracedProgram | None] = {}

    def lookup(self, args: Any, kwargs: Any) -> tuple[TracedProgram | None, list[Any]]:
        """The traced program for these arguments and the arrays among them; None where programs are
        not kept."""
        program_folder = folder()
        if program_folder is None or program_folder.traced is None:
            return None, []
        given = args, dict(sorted(kwargs.items()))
        leaves, structure = jax.tree.flatten(given)
        arrays = [leaf for leaf in leaves if eqx.is_array(leaf)]
        kinds = (str(_shape(x)) if eqx.is_array(x) else (type(x), x) for x in leaves)
        try:
            hash(kind := (structure, *kinds, settings(), program_folder.path))
        except Exception:  # leaves that cannot be hashed, or settings of another release of JAX
            return None, []
        if not all(map(_is_here, arrays)):
            return None, []
        if kind not in self._found:
            self._found[kind] = self._traced(program_folder, given)
        return self._found[kind], arrays

    def _traced(self, program_folder: ProgramFolder, given: _Outside) -> TracedProgram | None:
        """The program for such arguments: read from the folder, or new and written there; None
        where it cannot be kept."""
        try:
            encoder = Encoder(_shape, other=identity)
            key = json.dumps([self._name(), surroundings(), encoder(given)], sort_keys=True)
            name = hashlib.sha256(key.encode()).hexdigest()
            if (body := program_folder.read(name)) is not None:
                try:
                    return _read(body, given)
                except Exception as error:
                    warn_once(f"{program_folder.traced}/{name} cannot be read ({error})")
            body, traced = _made(self._function, given, encoder.seen)
        except (NotKept, NotImplementedError) as error:
            self._refused(error)
            return None
        # Raised by the function, whose call raises it again, or by unusual objects.
        except Exception:
            return None
        if sources_stayed():
            program_folder.write(name, body)
        return traced


def _shape(array: Any) -> list[Any]:
    return [array.dtype.name, list(array.shape), bool(getattr(array, "weak_type", False))]


def _is_here(array: Any) -> bool:
    """Whether an array lies on one device of the kind that programs are compiled for."""
    if not isinstance(array, jax.Array):
        return True
    devices = array.devices()
    return len(devices) == 1 and next(iter(devices)).platform == jax.default_backend()


def _made(function: Callable[..., Any], given: _Outside, seen: Any) -> tuple[bytes, TracedProgram]:
    """A new program of a function for such arguments, as bytes to be kept and as read from them."""
    exported, result, structure = _exported(function, given, seen)
    text = json.dumps(result).encode()
    body = len(text).to_bytes(8, "little") + text + bytes(exported.serialize(vjp_order=0))
    traced = _read(body, given)
    if traced.structure != structure:
        raise NotKept("a result that is another one when it is read again")
    return body, traced


def _exported(function: Callable[..., Any], given: _Outside, seen: Any) -> tuple[Any, Any, Any]:
    """The exported program of a function for such arguments, its result as nested lists of text,
    and the structure of that result."""
    leaves, structure = jax.tree.flatten(given)
    dynamic = [i for i, leaf in enumerate(leaves) if eqx.is_array(leaf)]
    said: Any = None
    built: Any = None

    def run(*arrays: Any) -> list[Any]:
        nonlocal said, built
        args, kwargs = jax.tree.unflatten(structure, [
            dict(zip(dynamic, arrays, strict=True)).get(i, leaf) for i, leaf in enumerate(leaves)
        ])  # fmt: skip
        found: list[Any] = []

        def array(leaf: Any) -> int:
            found.append(leaf)
            return len(found) - 1

        result = function(*args, **kwargs)
        said, built = Encoder(array, seen)(result), jax.tree.structure(result)
        return found

    shapes = [
        jax.ShapeDtypeStruct(x.shape, x.dtype, weak_type=bool(getattr(x, "weak_type", False)))
        for x in (leaves[i] for i in dynamic)
    ]
    run.__name__ = function.__name__
    return export.export(jax.jit(run))(*shapes), said, built


def _read(body: bytes, given: _Outside) -> TracedProgram:
    size = int.from_bytes(body[:8], "little")
    result = decoded(json.loads(body[8 : 8 + size]), _ArrayPlace, given)
    leaves, structure = jax.tree.flatten(result)
    exported = export.deserialize(bytearray(body[8 + size :]))
    return TracedProgram(exported, leaves, structure, {})
