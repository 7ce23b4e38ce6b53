"""Identities of functions by all that they compute with: instructions, constants, references."""

import builtins
import dis
import functools
import sys
import types
from collections.abc import Iterator
from typing import Any

import jax

from jaxbeam._programs.structure import PACKAGES, Encoder, NotKept, name_of

# Modules of Python, besides `PACKAGES`, whose functions depend on their arguments alone.
_PLAIN = frozenset({
    "builtins", "cmath", "collections", "dataclasses", "enum", "functools", "itertools", "math",
    "operator", "types", "typing",
})  # fmt: skip
# Builtins of Python that a function may use: none that opens files, evaluates text or asks users.
_BUILTINS = frozenset({
    "abs", "all", "any", "bool", "callable", "complex", "dict", "divmod", "enumerate", "filter",
    "float", "frozenset", "hasattr", "int", "isinstance", "issubclass", "iter", "len", "list",
    "map", "max", "min", "next", "object", "pow", "property", "range", "repr", "reversed", "round",
    "set", "slice", "sorted", "str", "sum", "super", "tuple", "type", "zip", "ArithmeticError",
    "AssertionError", "Exception", "IndexError", "KeyError", "NotImplementedError", "RuntimeError",
    "TypeError", "ValueError", "ZeroDivisionError", "__build_class__", "__name__",
})  # fmt: skip
# Names of functions that read files or draw random numbers.
_READING = frozenset({
    "DataSource", "fromfile", "fromregex", "genfromtxt", "load", "loadtxt", "memmap", "open_memmap",
    "random", "tree_deserialise_leaves",
})  # fmt: skip
_JITTED = type(jax.jit(lambda: 0))


def identity(function: Any) -> Any:
    """A description that tells a function from all others, as nested lists of text.

    A function of Python is its instructions and constants, its defaults, what it closes over, and
    all names that it finds in its module: numbers and arrays by value, functions in the same way,
    names of `PACKAGES` and of modules of `_PLAIN` as names. An object of these packages may return
    what tells it from others from a method `kept_by`. Raises `NotKept` for all else: objects of
    other classes, other modules, and functions that read files.
    """
    seen: dict[int, tuple[int, Any]] = {}

    def other(value: Any) -> Any:
        if id(value) in seen:
            return ["again", seen[id(value)][0]]
        seen[id(value)] = len(seen), value  # the value is held, so that no other gets its id
        if isinstance(value, _JITTED):
            return ["jit", encode(vars(value)["__wrapped__"], True)]
        if isinstance(value, types.FunctionType):
            return _function(value, encode)
        if isinstance(value, types.MethodType):
            return ["method", encode(value.__self__, True), encode(value.__func__, True)]
        if isinstance(value, functools.partial):
            parts = value.func, value.args, value.keywords
            return ["partial", *(encode(part, True) for part in parts)]
        if type(value) in (jax.custom_jvp, jax.custom_vjp):
            return [type(value).__name__, encode(dict(vars(value)), True)]
        if hasattr(value, "kept_by") and (said := value.kept_by()) is not None:
            return ["as", *name_of(type(value)), encode(said, True)]
        if type(value) is object:
            return ["mark", *_mark(value)]
        if _is_plain(value):
            return ["plain", value.__module__, value.__qualname__]
        if isinstance(value, types.ModuleType) and value.__name__ in _PLAIN:
            return ["plain", value.__name__]
        raise NotKept(_title(value))

    encode = Encoder(lambda array: array, other=other)
    try:
        return encode(function, True)
    except RecursionError:
        raise NotKept("what refers to itself") from None
    except ValueError as error:  # an empty cell of a closure: a variable that is not bound yet
        raise NotKept(str(error)) from None


def _mark(value: object) -> tuple[str, str]:
    """Module and name of an `object()` of `PACKAGES` that is a default value, such as that of an
    axis name that `jax.vmap` was not given."""
    for module in sorted(name for name in sys.modules if name.split(".")[0] in PACKAGES):
        for name, other in list(vars(sys.modules[module]).items()):
            if other is value:
                return module, name
    raise NotKept("an object without a name")


def _title(value: Any) -> str:
    """A phrase for a value, for a warning."""
    if isinstance(value, types.ModuleType):
        return f"the module {value.__name__}"
    if isinstance(value, type):
        return f"the class {value.__qualname__}"
    return f"an object of the class {type(value).__qualname__}"


def _is_plain(value: Any) -> bool:
    """Whether a value is a class or function of a module of `_PLAIN`."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", "")
    if module not in _PLAIN or "." in name:
        return False
    if module == "builtins" and name not in _BUILTINS:
        return False
    return getattr(__import__(module), name, None) is value


def _function(function: types.FunctionType, encode: Encoder) -> Any:
    """The description of a function of Python. In functions of `PACKAGES` names are not followed:
    the version of the package says what they mean."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    bound = function.__defaults__, function.__kwdefaults__, cells
    said = ["function", _code(function.__code__, encode), encode(bound, True)]
    if str(function.__globals__.get("__name__")).split(".")[0] in PACKAGES:
        return said
    for value in cells:
        _refuse_reading(_own_name(value))
    if vars(function).keys() - {"__wrapped__"}:
        raise NotKept(f"attributes of the function {function.__qualname__}")
    return [*said, [[name, _outside(function, name, encode)] for name in _names(function.__code__)]]


def _outside(function: types.FunctionType, name: str, encode: Encoder) -> Any:
    """The description of the value that a name has in the module of a function."""
    if name in function.__globals__:
        value = function.__globals__[name]
        _refuse_reading(_own_name(value))
        return encode(value, True)
    if name in _BUILTINS and hasattr(builtins, name):
        return ["builtin"]
    raise NotKept(f"the name {name}")


def _code(code: types.CodeType, encode: Encoder) -> Any:
    """The description of code: instructions and constants, but not lines of the file."""
    shape = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    constants = [_constant(value, encode) for value in code.co_consts]
    return [code.co_code.hex(), code.co_exceptiontable.hex(), shape, names, constants]


def _constant(value: Any, encode: Encoder) -> Any:
    if isinstance(value, types.CodeType):
        return ["code", _code(value, encode)]
    if isinstance(value, tuple | frozenset):
        parts = [_constant(part, encode) for part in value]
        return [type(value).__name__, parts if isinstance(value, tuple) else sorted(parts, key=str)]
    return ["..."] if value is ... else encode(value, True)


def _names(code: types.CodeType) -> list[str]:
    """Names that code looks up in its module; raises `NotKept` where it changes globals, imports
    other modules or reads files."""
    found = set()
    for step in _steps(code):
        name = str(step.argval)
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS"):
            found.add(name)
        elif step.opname in ("STORE_GLOBAL", "DELETE_GLOBAL"):
            raise NotKept(f"the name {name}, which it changes")
        elif step.opname == "IMPORT_NAME":
            if name.split(".")[0] not in {*PACKAGES, *_PLAIN}:
                raise NotKept(f"the module {name}")
        elif step.opname in ("LOAD_ATTR", "LOAD_METHOD", "IMPORT_FROM"):
            _refuse_reading(name)
    return sorted(found)


def _own_name(value: Any) -> str:
    return str(getattr(value, "__name__", "")).rpartition(".")[2]


def _refuse_reading(name: str) -> None:
    if name in _READING or name.startswith("read_"):
        raise NotKept(f"{name}, which may read a file or draw numbers")


def _steps(code: types.CodeType) -> Iterator[dis.Instruction]:
    yield from dis.get_instructions(code)
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _steps(constant)
