"""Tables of a scene as what they describe, by the constructors of the package: its arguments are
keys, and those that are made of numbers themselves are tables within, as in [rotor.root_springs].

So what a class gains by an argument is known here without a word, if its annotation says of what
kind it is.
"""

import contextlib
import difflib
import functools
import inspect
import sys
import types
import typing
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx

import jaxbeam as jb

TABLES = ("model", "beam", "rotor", "motion", "loads", "damping")
RPM = "_rpm"  # suffix of keys for speeds in turns per minute
_SPEEDS = ("angular_speed", "mean", "ratio_speed")  # names of angular speeds of motions and damping
Numbers = Mapping[str, Any]
Keys = dict[str, inspect.Parameter]


class Part(NamedTuple):
    """A table of a scene: its arguments by the path of their table, those of tables within
    included, and the function that makes it of swept numbers and of other tables."""

    keys: dict[str, Keys]
    make: Callable[..., Any]


@contextlib.contextmanager
def blamed(table: str) -> Iterator[None]:
    """A block whose errors name the table that the argument is in."""
    try:
        yield
    except (TypeError, ValueError) as error:
        raise ValueError(f"[{table}] {str(error).splitlines()[0]}") from error


def unless_among(key: str, allowed: Collection[str], complaint: str, those: str) -> None:
    if key not in allowed:
        near = difflib.get_close_matches(key, allowed, 1)
        meant = f"did you mean {near[0]}? " if near else ""
        raise ValueError(f"{complaint}: {meant}{those} {', '.join(allowed) or 'none'}")


def is_number(value: Any) -> bool:
    huge = isinstance(value, int) and abs(value) > sys.float_info.max
    return isinstance(value, int | float) and not isinstance(value, bool) and not huge


def is_real(parameter: inspect.Parameter | None) -> bool:
    """Whether an argument is a number that can be swept: see `Real`."""
    stated = None if parameter is None else parameter.annotation
    return isinstance(stated, types.UnionType) and float in typing.get_args(stated)


def _takes_lists(parameter: inspect.Parameter) -> bool:
    stated = parameter.annotation
    kinds = typing.get_args(stated) if isinstance(stated, types.UnionType) else (stated,)
    return any(k is Any or typing.get_origin(k) in (Sequence, list, tuple) for k in kinds)


def keys_of(maker: Callable[..., Any]) -> Keys:
    """Names of arguments that come from the maker's own table."""
    every = inspect.signature(maker).parameters
    return {name: p for name, p in every.items() if name not in TABLES and name[0] != "_"}


def in_radians(name: str, keys: Collection[str]) -> str:
    """The name of the argument that a key stands for: without the suffix of speeds in rpm."""
    base = name.removesuffix(RPM)
    last = base.rpartition(".")[2]
    return base if last in _SPEEDS and last in keys and base != name else name


@functools.cache
def public(base: type) -> dict[str, type]:
    """Classes of this kind that users have, by name."""
    places = (jb, jb.models, jb.papers, jb.motions, jb.blades)
    every = {name: getattr(at, name) for at in places for name in dir(at) if name[0].isupper()}
    return {
        name: kind for name, kind in sorted(every.items())
        if inspect.isclass(kind) and issubclass(kind, base) and not inspect.isabstract(kind)
    }  # fmt: skip


def class_of(table: str, name: Any, base: type) -> type:
    """The public class of this name, if it derives from `base` and can be made of numbers."""
    kinds = public(base)
    offered = [
        name for name, kind in kinds.items()
        if all(is_real(p) or p.default is not p.empty for p in keys_of(kind).values())
    ]  # fmt: skip
    if now := jb._RENAMED.get(str(name)):
        raise ValueError(f"[{table}] {name} is {now} now")
    unless_among(str(name), offered, f"[{table}] needs a name, got {name!r}", "there are")
    return kinds[name]


def part(path: str, makers: list[Any], given: Mapping[str, Any], swept: Collection[str]) -> Part:
    """The part that a table describes, by whichever maker fits its keys best.

    `make` takes all numbers that are swept, by name or by path and name, and parts by name that
    are tables of their own.
    """
    named: dict[str, tuple[str, Any]] = {}
    for key, value in given.items():
        name = in_radians(key, _all_keys(makers))
        if name in named:
            raise ValueError(f"[{path}] {key} is {named[name][0]} again")
        named[name] = key, value
    own = {name for name in _all_keys(makers) if {name, f"{path}.{name}"} & set(swept)}
    maker = _fitting(path, makers, named, own)
    arguments = keys_of(maker)
    plain: dict[str, Any] = {}
    inner: dict[str, Callable[..., Any]] = {}
    keys = {path: arguments}
    for name, (key, value) in named.items():
        kinds = _kinds(arguments[name])
        if kinds and not isinstance(value, dict) and not is_real(arguments[name]):
            raise ValueError(f"[{path}] {key} must be a table, [{path}.{key}], got {value!r}")
        if isinstance(value, dict) and kinds:
            within = part(f"{path}.{name}", kinds, value, swept)
            inner[name], keys = within.make, {**keys, **within.keys}
        else:
            plain[name] = _known(path, key, value, arguments[name])
            if key != name:
                plain[name] = jb.rpm(plain[name])

    def make(numbers: Numbers, **others: Any) -> Any:
        moving = {
            name: numbers[each] for name, parameter in arguments.items() if is_real(parameter)
            for each in (name, f"{path}.{name}") if each in numbers
        }  # fmt: skip
        parts = {name: within(numbers) for name, within in inner.items()}
        with blamed(path):
            if isinstance(others.get("beam"), jb.blades.BladeTable):
                return others.pop("beam").rotor(**others, **{**plain, **parts, **moving})
            return maker(**others, **{**plain, **parts, **moving})

    return Part(keys, make)


def _all_keys(makers: list[Any]) -> set[str]:
    return {name for maker in makers for name in keys_of(maker)}


def _kinds(parameter: inspect.Parameter) -> list[type]:
    """Classes that can be made from a table in the place of this argument."""
    stated = typing.get_args(parameter.annotation) or (parameter.annotation,)
    bases = [each for each in stated if inspect.isclass(each) and issubclass(each, eqx.Module)]
    return [kind for base in bases for kind in public(base).values()]


def _fitting(path: str, makers: list[Any], given: Collection[str], swept: Collection[str]) -> Any:
    """The maker whose arguments fit the keys best; raises if some are missing."""

    def lacks(maker: Any) -> list[str]:
        required = [name for name, p in keys_of(maker).items() if p.default is p.empty]
        return [name for name in required if name not in given and name not in swept]

    maker = min(makers, key=lambda m: len({*given} - {*keys_of(m)}) + len(lacks(m)))
    keys = keys_of(maker)
    those = "its keys are" if len(makers) == 1 else f"{maker.__qualname__} takes"
    for key in given:
        unless_among(key, keys, f"[{path}] has no {key}", those)
    if lacks(maker):
        raise ValueError(f"[{path}] lacks {', '.join(lacks(maker))}: {those} {', '.join(keys)}")
    return maker


def _known(path: str, key: str, value: Any, parameter: inspect.Parameter) -> Any:
    """The value of an argument that is a number, a text, a bool or a list of these."""
    for kind, called in ((str, "a text in quotes"), (bool, "true or false")):
        if parameter.annotation is kind:
            if not isinstance(value, kind):
                raise ValueError(f"[{path}] {key} must be {called}, got {value!r}")
            return value
    if _takes_lists(parameter) and isinstance(value, list | dict):
        return _nested(path, key, value)
    stated = parameter.annotation
    if inspect.isclass(stated) and not issubclass(stated, int | float):
        raise ValueError(f"[{path}] {key} is made in scripts alone: leave it out")
    if not is_number(value):
        raise ValueError(f"[{path}] {key} must be a number, got {value!r}")
    return value


def _nested(path: str, key: str, value: Any) -> Any:
    """Lists of numbers, as deep as an argument wants them, and what varies along the span."""
    if isinstance(value, list):
        return [_nested(path, key, each) for each in value]
    if isinstance(value, dict):
        return part(f"{path}.{key}", [jb.Spanwise], value, ()).make({})
    if not is_number(value):
        raise ValueError(f"[{path}] {key} must be a number, got {value!r}")
    return value
