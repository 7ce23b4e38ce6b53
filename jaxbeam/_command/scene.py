"""A scene in TOML as a function of its swept numbers."""

import functools
import inspect
import math
import sys
from collections.abc import Callable, Collection, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np

import jaxbeam as jb
from jaxbeam._checks import count_functions
from jaxbeam._command.parts import (
    TABLES,
    Numbers,
    Part,
    blamed,
    class_of,
    in_radians,
    is_number,
    is_real,
    keys_of,
    part,
    unless_among,
)
from jaxbeam._command.questions import QUESTIONS, Dims
from jaxbeam._types import Real

# Tables whose class is named, with the base of the class.
_NAMED = {"model": jb.models.AbstractModel, "motion": jb.motions.Motion}


class Job(NamedTuple):
    """A question of a scene: the function of the swept numbers that answers it, and the axes."""

    question: str
    case: Callable[..., dict[str, Any]]
    axes: dict[str, list[float]]
    dims: Dims


def read(tables: Mapping[str, Any]) -> Job:
    """The scene in a file, or a `ValueError` with the first mistake there; nothing is computed."""
    for key, value in tables.items():
        unless_among(key, (*TABLES, *QUESTIONS, "sweep"), _no_table(key), "but")
        if not isinstance(value, dict):
            raise ValueError(f"{key} must be a table: [{key}], and its keys below")
    asked = [question for question in QUESTIONS if question in tables]
    if len(asked) != 1:
        got = " and ".join(f"[{question}]" for question in asked) or "none"
        raise ValueError(f"must ask one of [{'], ['.join(QUESTIONS)}], there is {got}")
    question = asked[0]
    axes = {name: _values(name, given) for name, given in _flat(tables.get("sweep", {})).items()}
    scene = _Scene({name: dict(given) for name, given in tables.items()}, axes)
    scene.gather(question)
    for table in tables.keys() - scene.parts.keys() - {"sweep"}:
        there = ", ".join(sorted(scene.parts))
        raise ValueError(f"[{table}] has no use here: tables are {there}")
    own = scene.tables[question]
    if not axes and "angular_speed" in scene.parts[question].keys[question]:
        name = next((name for name in own if name.startswith("angular_speed")), "angular_speed")
        axes = {name: [own.get(name, 0.0)]}
    scene.check_swept(axes)
    first = _in_radians(scene.keys, dict.fromkeys(axes, 1.0))
    for table in scene.parts.keys() - {question}:
        scene.made(table, first)  # so that numbers besides these are checked
    with blamed("sweep"):
        jb.grid(**axes) if axes else None
    with blamed(question):
        keys = {key: value for key, value in own.items() if in_radians(key, scene.keys) == key}
        case = functools.partial(_answer, scene.question(question), scene.tables)
        return Job(question, case, axes, QUESTIONS[question][1](**keys))


class _Scene:
    """The parts of a scene that have been gathered so far, with their tables."""

    def __init__(self, tables: dict[str, dict[str, Any]], axes: Collection[str]) -> None:
        self.tables, self.axes = tables, axes
        self.parts: dict[str, Part] = {}
        self.needs: dict[str, list[str]] = {}

    @property
    def keys(self) -> dict[str, list[str]]:
        """Numbers that can be swept, each with the tables that have one of its name."""
        found: dict[str, list[str]] = {}
        for each in self.parts.values():
            for path, keys in each.keys.items():
                for name in filter(lambda name: is_real(keys[name]), keys):
                    found.setdefault(name, []).append(path)
        return found

    def gather(self, table: str) -> None:
        """Prepare the part that a table describes, after those that it needs."""
        given = self.tables.setdefault(table, {})
        makers = self._makers(table, given)
        # Beams have several makers, of which none is inspected.
        every = inspect.signature(makers[0]).parameters
        self.needs[table] = [
            name for name, p in every.items()
            if name in TABLES and (p.default is p.empty or name in self.tables)
        ]  # fmt: skip
        for needed in self.needs[table]:
            self.gather(needed)
        keys = keys_of(makers[0])
        said = {in_radians(name, keys) for name in (*given, *self.axes)}
        if "angular_speed" in keys.keys() - said and "beam" in self.parts:
            given |= _speed_in(self.made("beam", dict.fromkeys(self.axes, 1.0)))
        there = {name: value for name, value in given.items() if (table, name) not in _CLASSES}
        swept = [in_radians(name, keys) for name in self.axes]
        self.parts[table] = part(table, makers, there, swept)

    def _makers(self, table: str, given: dict[str, Any]) -> list[Any]:
        if table in _NAMED:
            return [class_of(table, given.get("name"), _NAMED[table])]
        if table == "rotor":
            kind: Any = class_of("model", self.tables["model"].get("name"), _NAMED["model"])
            return [kind.rotor_type]
        makers: dict[str, list[Any]] = {
            "beam": [jb.Beam, jb.Beam.from_section, jb.Beam.from_slenderness, read_blade],
            "loads": [jb.Loads], "damping": [jb.Damping],
        }  # fmt: skip
        return makers[table] if table in makers else [QUESTIONS[table][0]]

    def made(self, table: str, numbers: Numbers) -> Any:
        """The object that a table describes, made of these numbers."""
        others = {needed: self.made(needed, numbers) for needed in self.needs[table]}
        return self.parts[table].make(numbers, **others)

    def question(self, name: str) -> Callable[[Numbers], Any]:
        """The function of swept numbers that a question is."""
        return lambda numbers: self.made(name, _in_radians(self.keys, numbers))

    def kept_by(self) -> Any:
        """The tables and axes that tell this scene from others; None where a file is read, which
        may change."""
        return None if "file" in self.tables.get("beam", {}) else (self.tables, list(self.axes))

    def check_swept(self, axes: Collection[str]) -> None:
        """Raise `ValueError` unless each axis names exactly one number."""
        numbers = self.keys
        paths = {f"{path}.{name}" for name, those in numbers.items() for path in those}
        meant: dict[str, str] = {}
        for axis in axes:
            name = in_radians(axis, numbers)
            if name not in paths:
                unless_among(name, numbers, f"[sweep] {axis} is not swept", "numbers are")
                if len(numbers[name]) > 1:
                    those = " or ".join(f"{path}.{name}" for path in numbers[name])
                    raise ValueError(f"[sweep] {axis} is several numbers: write {those}")
                name = f"{numbers[name][0]}.{name}"
            if name in meant:
                raise ValueError(f"[sweep] {axis} is {meant[name]} again")
            meant[name] = axis


_CLASSES = {("model", "name"), ("motion", "name")}


def _answer(make: Callable[[Numbers], Any], _: Any, **numbers: Any) -> Any:
    """The answer of one case; tables are an argument for the identity of a folder."""
    return make(numbers)


def _in_radians(keys: Collection[str], numbers: Numbers) -> Numbers:
    """Swept numbers by name of the argument, with speeds in rad/s."""
    names = {name: in_radians(name, keys) for name in numbers}
    return {
        base: numbers[name] if base == name else jb.rpm(numbers[name])
        for name, base in names.items()
    }


def _no_table(key: str) -> str:
    """The complaint about a table that does not exist, with the table that a key of this name
    belongs to."""
    owners = {"rotor": jb.Rotor, "beam": jb.Beam, "loads": jb.Loads, "damping": jb.Damping}
    where = next((table for table, kind in owners.items() if key in keys_of(kind)), None)
    return f"there is no table {key}" + (f", it is [{where}.{key}]" if where else "")


def _flat(sweep: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Swept values by path: `rotor.hub_radius = [...]` is a table in a table."""
    found: dict[str, Any] = {}
    for name, given in sweep.items():
        if isinstance(given, dict) and not {"from", "to", "count"} & given.keys():
            found |= _flat(given, f"{path}{name}.")
        else:
            found[f"{path}{name}"] = given
    return found


def _values(name: str, given: Any) -> list[float]:
    """The values of a number that is swept."""
    if isinstance(given, dict) and given.keys() == {"from", "to", "count"}:
        with blamed("sweep"):
            count_functions(f"{name} count", given["count"], 2)
        if all(is_number(given[end]) and math.isfinite(given[end]) for end in ("from", "to")):
            return np.linspace(given["from"], given["to"], given["count"]).tolist()
    if not isinstance(given, list) or not given or not all(map(is_number, given)):
        form = "a list of numbers or {from = 0.0, to = 1.0, count = 11}"
        raise ValueError(f"[sweep] {name} must be {form}, got {given!r}")
    return [float(value) for value in given]


def read_blade(
    file: str,
    length: Real | None = None,
    axial_stiffness: Real | None = None,
    reduced: bool = False,
) -> Any:
    table = jb.blades.read_blade(file, length=length, axial_stiffness=axial_stiffness)
    _note("\n".join(f"{file}: {ignored}" for ignored in table.ignored))
    if not reduced:
        return table
    if isinstance(table.beam, jb.Beam):
        raise ValueError(f"reduced is for files of full sections, which {file} is not")
    with jax.ensure_compile_time_eval():  # concrete, also within a function that is traced
        return table._replace(beam=table.beam.beam())


def _speed_in(beam: Any) -> dict[str, float]:
    """The speed that the file of a beam states, if it does, for scenes without one."""
    speed = getattr(beam, "angular_speed", None)
    _note("" if speed is None else f"angular_speed is {speed:.6g} rad/s, as the beam's file says")
    return {} if speed is None else {"angular_speed": speed}


_note = functools.cache(lambda text: text and print(text, file=sys.stderr))  # printed once
