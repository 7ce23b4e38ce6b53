"""Arguments and results of programs as text, by structure, so that reading it executes nothing."""

import dataclasses
import enum
import functools
import importlib
import types
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np

# Packages whose modules, classes and functions a text may name: kept programs belong to their
# versions.
PACKAGES = ("jaxbeam", "jax", "numpy", "equinox", "diffrax", "optimistix", "lineax")
Path = tuple[str | int, ...]


class NotKept(Exception):
    """The error that an object has no text that is sure to say everything about it."""


def _no_text(value: Any) -> Any:
    raise NotKept(f"an object of the class {type(value).__qualname__}")


class Encoder:
    """An encoder of values as nested lists of text and whole numbers, for `json`.

    `array` encodes arrays that are traced; arrays in static parts are encoded with all their
    numbers. `given` is a table, by id, of static parts of the arguments and their paths there: in a
    result these are encoded as the paths. `seen` becomes such a table of all that was encoded.
    `other` encodes a function or an object without a name in `PACKAGES`, and raises by default.
    """

    def __init__(
        self, array: Callable[[Any], Any], given: Mapping[int, tuple[Path, Any]] | None = None,
        other: Callable[[Any], Any] = _no_text,
    ) -> None:  # fmt: skip
        self._array, self._given, self._other = array, given or {}, other
        self.seen: dict[int, tuple[Path, Any]] = {}

    def __call__(self, value: Any, static: bool = False, path: Path = ()) -> Any:
        kind = type(value)
        if value is None or kind in (bool, int, str):
            return value
        if kind in _NUMBERS:
            return [kind.__name__, *_NUMBERS[kind](value)]
        if static:
            if id(value) in self._given:
                return ["given", *self._given[id(value)][0]]
            self.seen.setdefault(id(value), (path, value))  # value held: no other gets its id
        if isinstance(value, jax.Array | np.ndarray | np.generic):
            return self._numbers(value, static)
        if isinstance(value, enum.Enum):
            return ["enum", *name_of(kind), value.name]
        if isinstance(value, np.dtype):
            return ["dtype", _dtype(value)]
        if kind is dict:
            items = value.items()
            return ["dict", *([self(k, True), self(v, static, (*path, k))] for k, v in items)]
        if kind in (tuple, list) or (isinstance(value, tuple) and _has_items_alone(value)):
            title = [kind.__name__] if kind in (tuple, list) else ["named", *name_of(kind)]
            return [*title, *(self(v, static, (*path, i)) for i, v in enumerate(value))]
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self._fields(value, static, path)
        named = _name_or_none(value)
        if named is not None:
            return ["name", *named]
        if id(value) in self._given:
            return ["given", *self._given[id(value)][0]]
        self.seen.setdefault(id(value), (path, value))
        return self._other(value)

    def _numbers(self, value: Any, static: bool) -> Any:
        if not static and eqx.is_array(value):
            return ["array", self._array(value)]
        if isinstance(value, jax.core.Tracer):
            raise NotKept("a number that is traced")
        if type(value) is np.ndarray:
            kind = "numpy"
        elif isinstance(value, np.generic):
            kind = "number"
        elif isinstance(value, jax.Array):
            kind = "weak" if value.weak_type else "jax"
        else:
            raise NotKept("an array of a class of its own")
        numbers = np.asarray(value)
        return [kind, _dtype(numbers.dtype), list(numbers.shape), numbers.tobytes().hex()]

    def _fields(self, value: Any, static: bool, path: Path) -> Any:
        fields = {field.name: field for field in dataclasses.fields(value)}
        if not vars(value).keys() <= {*fields, *functools.WRAPPER_ASSIGNMENTS, "__wrapped__"}:
            raise NotKept(f"a {type(value).__qualname__} with more than its fields")
        traced = isinstance(value, eqx.Module)
        if not (static or traced) and not jax.tree_util.all_leaves([value]):
            raise NotKept(f"an object of the class {type(value).__qualname__}")
        said: list[Any] = ["of", *name_of(type(value))]
        for name, field in fields.items():
            if name in vars(value):
                fixed = static or not traced or bool(field.metadata.get("static", False))
                said.append([name, self(vars(value)[name], fixed, (*path, name))])
        return said


def _dtype(dtype: np.dtype) -> str:
    if dtype.kind not in "biufcSU":  # names of other kinds are not unique
        raise NotKept(f"an array of {dtype}")
    return dtype.str


def _has_items_alone(value: Any) -> bool:
    """Whether a tuple is a `NamedTuple` without further attributes."""
    return hasattr(value, "_fields") and not getattr(value, "__dict__", None)


_NUMBERS: dict[type, Callable[[Any], Iterable[str]]] = {
    float: lambda x: [x.hex()],
    complex: lambda x: [x.real.hex(), x.imag.hex()],
    bytes: lambda x: [x.hex()],
}


def name_of(thing: Any) -> tuple[str, str]:
    """The module and the name of an object of one of `PACKAGES`; raises `NotKept` for others."""
    named = _name_or_none(thing)
    if named is None:
        raise NotKept(f"the class {getattr(thing, '__qualname__', type(thing).__qualname__)}")
    return named


def _name_or_none(thing: Any) -> tuple[str, str] | None:
    if isinstance(thing, types.ModuleType):
        return (thing.__name__, "") if _is_ours(thing.__name__) else None
    module, name = getattr(thing, "__module__", None), getattr(thing, "__qualname__", None)
    if not (isinstance(module, str) and isinstance(name, str) and _is_ours(module)):
        return None
    try:
        return (module, name) if named(module, name) is thing else None
    except (ImportError, AttributeError):
        return None


def _is_ours(module: str) -> bool:
    return module.split(".")[0] in PACKAGES


def named(module: str, name: str) -> Any:
    """The object of this name in a module of one of `PACKAGES`."""
    if not _is_ours(module):
        raise NotKept(module)
    found = importlib.import_module(module)
    return functools.reduce(getattr, name.split("."), found) if name else found


def decoded(said: Any, array: Callable[[Any], Any], given: Any) -> Any:
    """The value of an encoded text, with array(index) for traced arrays, and static parts taken
    from the arguments `given`. Objects are made of their fields; nothing that the text names is
    called."""
    if said is None or type(said) in (bool, int, str):
        return said
    kind, *rest = said

    def each(values: Any) -> Any:
        return [decoded(value, array, given) for value in values]

    if kind in _SIMPLE:
        return _SIMPLE[kind](*rest)
    if kind == "array":
        return array(rest[0])
    if kind == "given":
        return functools.reduce(_item, rest, given)
    if kind in ("tuple", "list"):
        return tuple(each(rest)) if kind == "tuple" else each(rest)
    if kind == "dict":
        return dict(each(pair) for pair in rest)
    if kind == "name":
        return named(*rest)
    made = named(*rest[:2])
    if kind == "enum" and issubclass(made, enum.Enum):
        return made.__members__[rest[2]]
    if kind == "named" and issubclass(made, tuple) and hasattr(made, "_fields"):
        return tuple.__new__(made, each(rest[2:]))
    if kind == "of" and dataclasses.is_dataclass(made) and isinstance(made, type):
        fields = {field.name for field in dataclasses.fields(made)}
        value = object.__new__(made)
        for name, part in rest[2:]:
            if name not in fields:
                raise NotKept(name)
            object.__setattr__(value, name, decoded(part, array, given))
        return value
    raise NotKept(str(kind))


def _item(value: Any, step: Any) -> Any:
    return value[step] if isinstance(value, tuple | list | dict) else vars(value)[step]


def _array(dtype: str, shape: list[int], numbers: str) -> np.ndarray:
    return np.frombuffer(bytes.fromhex(numbers), np.dtype(dtype)).reshape(shape).copy()


_SIMPLE: dict[str, Callable[..., Any]] = {
    "float": float.fromhex,
    "complex": lambda a, b: complex(float.fromhex(a), float.fromhex(b)),
    "bytes": bytes.fromhex,
    "dtype": np.dtype,
    "numpy": _array,
    "number": lambda *said: _array(*said)[()],
    "jax": lambda *said: jax.numpy.asarray(_array(*said)),
}
