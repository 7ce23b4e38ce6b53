"""Sweeps and spin-ups that a TOML file describes, for those who do not want to write a script."""

import argparse
import contextlib
import dataclasses
import difflib
import functools
import inspect
import math
import sys
import tomllib
import typing
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import jaxbeam as jb
from jaxbeam import plot
from jaxbeam._checks import count_functions
from jaxbeam._types import Real

_ROTOR = """\
[beam]                        # arguments of Beam, Beam.from_section or Beam.from_slenderness
length = 8.0                  # m
youngs_modulus = 6.895e10     # Pa
density = 2767.0              # kg/m^3
area = 7.299e-5               # m^2
in_plane_second_moment = 8.214e-9  # m^4; flap_second_moment is the same unless given
[rotor]
hub_radius = 0.5              # m
tip_mass = 0.1                # kg
"""
_HYBRID = f"""\
[model]
name = "Hybrid"               # a model of jaxbeam; other keys are its arguments (n_in_plane = 24)
{_ROTOR}"""
EXAMPLES = {
    "frequencies": f"""{_HYBRID}\
[frequencies]                 # the question: how many modes of each direction
in_plane = 2
flap = 1                      # also axial, and angular_speed (rad/s) where it is not swept
[sweep]                       # numbers from above, by name: lists, or from, to and how many
angular_speed = {{from = 0.0, to = 10.0, count = 21}}
tip_mass = [0.0, 0.1, 0.2]
""",
    "southwell": f"""{_HYBRID}\
[southwell]                   # the question: of which modes, at rest unless angular_speed is given
in_plane = 2
[sweep]
hub_radius = {{from = 0.0, to = 4.0, count = 9}}
""",
    "spin_up": f"""\
[model]
name = "ExactRodANCF"         # geometrically exact elements, in the plane of rotation
n_elements = 8
{_ROTOR}\
[motion]
name = "SmoothSpinUp"         # a motion of jaxbeam; other keys are its arguments
angular_speed = 4.0           # rad/s
duration = 15.0               # s
[spin_up]                     # the question; without [sweep] histories, with it the peak of each
until = 20.0                  # s
points = 201                  # output times
""",
}
_EPILOG = f"""\
Frequencies over speed, for three tip masses (--example prints it, and the others):

{EXAMPLES["frequencies"]}
A [beam] may have file = "blade.csv", any file of blades.read_blade beside it, of which what it says
of rotor and angular_speed holds unless the scene has others. [root_springs] are jaxbeam's
RootSprings, and a [tip_body] (TipBody) is in the place of a tip_mass.
A spin-up, which may have [loads] (gravity = [0.0, -9.81, 0.0]) and [damping] as well:

{EXAMPLES["spin_up"]}
Arguments, units and what a model can do are those of the package: help(jaxbeam.Beam) in Python.
FOLDER gets a table, as .csv and as .npz (for jaxbeam.Table.load), and a figure. A case that fails
has a status there (see jaxbeam.Status) and leaves the others alone. A sweep that was stopped goes
on when the same command runs again; after a change in the file remove FOLDER/chunks, or name
another FOLDER. Exit status: 0 if a case is ok, 1 if none is, 2 for a mistake in the file.
"""
Dims = dict[str, dict[str, list[Any]]]
Labels = tuple[jb.models.Label, ...]
TABLES = ("model", "beam", "rotor", "root_springs", "tip_body", "motion", "loads", "damping")
BASES = {"model": jb.models.AbstractModel, "motion": jb.motions.Motion}
PARTS: Any = {"root_springs": [jb.RootSprings], "tip_body": [jb.TipBody], "loads": [jb.Loads]}


def _beam_in(file: str, length: Real | None = None, axial_stiffness: Real | None = None) -> Any:
    table = jb.blades.read_blade(file, length=length, axial_stiffness=axial_stiffness)
    _note("\n".join(f"{file}: {ignored}" for ignored in table.ignored))
    return table


def _speed_in(beam: Any) -> dict[str, float]:
    """The speed that the file of a beam states, if it does, for where a scene has none."""
    speed = getattr(beam, "angular_speed", None)
    _note("" if speed is None else f"angular_speed is {speed:.6g} rad/s, as the beam's file says")
    return {} if speed is None else {"angular_speed": speed}


_note = functools.cache(lambda text: text and print(text, file=sys.stderr))  # once, not every time


# Questions: functions of one case. Arguments are TABLES, and keys of the question's own table.
def _frequencies(
    model: Any, rotor: Any, angular_speed: Real, in_plane: int = 0, flap: int = 0, axial: int = 0
) -> dict[str, Any]:
    found = jb.modes(model, rotor, angular_speed, _which(in_plane, flap, axial), throw=False)
    names = ("frequency", "growth_rate", "steady_strain", "status")
    return {name: getattr(found, name) for name in names}


def _southwell(
    model: Any, rotor: Any, angular_speed: Real = 0.0, in_plane: int = 0, flap: int = 0,
    axial: int = 0,
) -> dict[str, Any]:  # fmt: skip
    which = _which(in_plane, flap, axial)
    return vars(jb.southwell(model, rotor, angular_speed, which, throw=False))


def _spin_up(
    model: Any, rotor: Any, motion: Any, until: float, points: int = 201,
    max_steps: int = 100_000, loads: Any = None, damping: Any = None,
) -> dict[str, Any]:  # fmt: skip
    given = {n: v for n, v in (("loads", loads), ("damping", damping)) if v is not None}
    times = _times(until, points)
    run = jb.simulate(model, rotor, motion, times, max_steps=max_steps, throw=False, **given)
    value, when = jax.numpy.array([run.peak(component) for component in range(3)]).T
    names = ("tip", "hub_force", "hub_torque", "strain_energy", "energy", "imbalance", "status")
    return {"peak": value, "peak_time": when, **{name: getattr(run, name) for name in names}}


def _which(in_plane: int = 0, flap: int = 0, axial: int = 0, **_: Any) -> Labels:
    counts = {"in_plane": in_plane, "flap": flap, "axial": axial}  # columns carry their names
    for direction, count in counts.items():
        count_functions(direction, count)
    if not any(counts.values()):
        raise ValueError("asks for no mode: in_plane, flap or axial must be > 0")
    return jb.labels(**counts)


def _times(until: float, points: int = 201, max_steps: int = 1, **_: Any) -> np.ndarray:
    count_functions("points", points, 2)
    count_functions("max_steps", max_steps, 1)
    if not 0 < until < np.inf:
        raise ValueError(f"until must be finite and > 0, got {until}")
    return np.linspace(0.0, until, points)


def _over_modes(*names: str) -> Callable[..., Dims]:
    return lambda **keys: {name: {"mode": list(_which(**keys))} for name in names}


def _over_time(**keys: Any) -> Dims:
    time, axis = {"time": _times(**keys).tolist()}, {"axis": ["a1", "a2", "a3"]}
    way = {"direction": ["axial", "in plane", "flap"]}
    dims = {"peak": way, "peak_time": way, "tip": time | way}
    dims |= {"hub_force": time | axis, "hub_torque": time | axis}
    return dims | dict.fromkeys(("strain_energy", "energy", "imbalance"), time)


QUESTIONS: dict[str, tuple[Callable[..., Any], Callable[..., Dims], str]] = {
    "frequencies": (_frequencies, _over_modes("frequency", "growth_rate"), "frequency (rad/s)"),
    "southwell": (_southwell, _over_modes("coefficient"), "Southwell coefficient (-)"),
    "spin_up": (_spin_up, _over_time, "peak deflection of the tip (m)"),
}


class Job(NamedTuple):
    """A question, the function of the swept numbers that answers it, and what it is swept over."""

    question: str
    case: Callable[..., dict[str, Any]]
    axes: dict[str, list[float]]
    dims: Dims


def read(tables: Mapping[str, Any]) -> Job:
    """The scene in a file, or a `ValueError` with the first mistake there; nothing is computed."""
    for key, value in tables.items():
        _unless_among(key, (*TABLES, *QUESTIONS, "sweep"), f"there is no table {key}", "but")
        if not isinstance(value, dict):
            raise ValueError(f"{key} must be a table: [{key}], and its keys below")
    tables = {name: dict(given) for name, given in tables.items()}
    asked = [question for question in QUESTIONS if question in tables]
    if len(asked) != 1:
        got = " and ".join(f"[{question}]" for question in asked) or "none"
        raise ValueError(f"must ask one of [{'], ['.join(QUESTIONS)}], there is {got}")
    ask, over, _ = QUESTIONS[question := asked[0]]
    axes = {name: _values(name, given) for name, given in tables.get("sweep", {}).items()}
    beams = [jb.Beam, jb.Beam.from_section, jb.Beam.from_slenderness, _beam_in]
    makers = {**PARTS, "damping": [jb.Damping], "beam": beams, question: [ask]}
    takes: dict[str, dict[str, inspect.Parameter]] = {}
    made: dict[str, Callable[[Mapping[str, Any]], Any]] = {}  # from the swept numbers

    def gather(table: str) -> None:
        given = dict(tables.get(table, {}))
        if table in BASES:
            makers[table] = [_class(table, given.pop("name", None), BASES[table])]
        if table == "model":
            makers["rotor"] = [makers["model"][0].rotor_type]
        needs = _needs(makers[table][0], tables)  # of beams, which alone have several, nothing
        for needed in needs:
            gather(needed)
        if "angular_speed" in _keys(makers[table][0]).keys() - {*given, *axes} and "beam" in made:
            given |= _speed_in(made["beam"](dict.fromkeys(axes, 1.0)))
            tables[table] |= given  # as if it stood there
        maker = _fitting(table, makers[table], given, axes)
        takes[table] = _keys(maker)

        def make(numbers: Mapping[str, Any]) -> Any:
            swept = {name: n for name, n in numbers.items() if _is_real(takes[table].get(name))}
            parts = {needed: made[needed](numbers) for needed in needs}
            with _blamed(table):
                if isinstance(parts.get("beam"), jb.blades.BladeTable):
                    return parts.pop("beam").rotor(**parts, **{**given, **swept})
                return maker(**parts, **{**given, **swept})

        made[table] = make

    gather(question)
    for table in tables.keys() - made.keys() - {"sweep"}:
        raise ValueError(f"[{table}] has no use here: tables are {', '.join(sorted(made))}")
    if not axes and "angular_speed" in takes[question]:
        axes = {"angular_speed": [tables[question].get("angular_speed", 0.0)]}
    numbers = {name: 0 for own in takes.values() for name in own if _is_real(own[name])}
    for name in axes:  # no two tables have a number of one name
        _unless_among(name, numbers, f"[sweep] {name} is not swept", "numbers are")
    for table in made.keys() - {question}:
        made[table](dict.fromkeys(axes, 1.0))  # so that other numbers than these are checked
    with _blamed("sweep"):
        jb.grid(**axes) if axes else None
    with _blamed(question):
        case = functools.partial(_answer, made[question], tables)
        return Job(question, case, axes, over(**tables[question]))


def _answer(make: Callable[[Mapping[str, Any]], Any], _: Any, **numbers: Any) -> Any:
    """The answer of one case; the tables are there for the index of the folder."""
    return make(numbers)


@contextlib.contextmanager
def _blamed(table: str) -> Iterator[None]:
    """What the library says of an argument, with the table that it stands in."""
    try:
        yield
    except (TypeError, ValueError) as error:
        raise ValueError(f"[{table}] {str(error).splitlines()[0]}") from error


def _unless_among(key: str, allowed: Collection[str], complaint: str, those: str) -> None:
    if key not in allowed:
        near = difflib.get_close_matches(key, allowed, 1)
        meant = f"did you mean {near[0]}? " if near else ""
        raise ValueError(f"{complaint}: {meant}{those} {', '.join(allowed) or 'none'}")


def _is_number(value: Any) -> bool:
    huge = isinstance(value, int) and abs(value) > sys.float_info.max
    return isinstance(value, int | float) and not isinstance(value, bool) and not huge


def _is_real(parameter: inspect.Parameter | None) -> bool:
    return parameter is not None and float in typing.get_args(parameter.annotation)  # see Real


def _keys(maker: Callable[..., Any]) -> dict[str, inspect.Parameter]:
    """Arguments that come from the maker's own table."""
    every = inspect.signature(maker).parameters
    return {name: p for name, p in every.items() if name not in TABLES and name[0] != "_"}


def _needs(maker: Callable[..., Any], tables: Collection[str]) -> list[str]:
    """Arguments that are tables of their own, of which some may be left out."""
    every = inspect.signature(maker).parameters.items()
    return [n for n, p in every if n in TABLES and (p.default is p.empty or n in tables)]


def _class(table: str, name: Any, base: type) -> type:
    """The public class of this name, of those that are made from numbers."""
    places = (jb, jb.models, jb.motions)
    public = {name: getattr(at, name) for at in places for name in dir(at) if name[0].isupper()}
    kinds = {n: k for n, k in sorted(public.items()) if inspect.isclass(k) and issubclass(k, base)}
    offered = [
        name for name, kind in kinds.items() if not inspect.isabstract(kind)
        and all(_is_real(p) or p.default is not p.empty for p in _keys(kind).values())
    ]  # fmt: skip
    _unless_among(str(name), offered, f"[{table}] needs a name, got {name!r}", "there are")
    return kinds[name]


def _fitting(
    table: str, makers: list[Any], given: Mapping[str, Any], swept: Collection[str]
) -> Any:
    """Whichever maker fits the keys best, which must be complete."""

    def lacks(maker: Any) -> list[str]:
        required = [name for name, p in _keys(maker).items() if p.default is p.empty]
        return [name for name in required if name not in given and name not in swept]

    maker = min(makers, key=lambda m: len(given.keys() - _keys(m)) + len(lacks(m)))
    keys = _keys(maker)
    those = "its keys are" if len(makers) == 1 else f"{maker.__qualname__} takes"
    for key, value in given.items():
        _unless_among(key, keys, f"[{table}] has no {key}", those)
        if keys[key].annotation is str:
            if not isinstance(value, str):
                raise ValueError(f"[{table}] {key} must be a text in quotes, got {value!r}")
            continue
        several = isinstance(value, list) and keys[key].annotation is Any  # say an axis
        if not all(map(_is_number, value if several else [value])):
            raise ValueError(f"[{table}] {key} must be a number, got {value!r}")
    if lacks(maker):
        raise ValueError(f"[{table}] lacks {', '.join(lacks(maker))}: {those} {', '.join(keys)}")
    return maker


def _values(name: str, given: Any) -> list[float]:
    """The values of a number that is swept."""
    if isinstance(given, dict) and given.keys() == {"from", "to", "count"}:
        with _blamed("sweep"):
            count_functions(f"{name} count", given["count"], 2)
        if all(_is_number(given[end]) and math.isfinite(given[end]) for end in ("from", "to")):
            return np.linspace(given["from"], given["to"], given["count"]).tolist()
    if not isinstance(given, list) or not given or not all(map(_is_number, given)):
        form = "a list of numbers or {from = 0.0, to = 1.0, count = 11}"
        raise ValueError(f"[sweep] {name} must be {form}, got {given!r}")
    return [float(value) for value in given]


def run(scene: Job, out: Path, cores: int, chunk: int) -> bool:
    """Answer the question, write all files, and say what became of the cases."""
    if scene.axes:
        cases = jb.grid(**scene.axes)
        print(f"{len(cases)} cases over {', '.join(cases.names)}", flush=True)
        how: Any = {"chunk": chunk, "devices": cores * jax.devices(), "folder": out / "chunks"}
        table = jb.sweep(scene.case, cases, dims=scene.dims, **how)
        drawn, label = next(iter(scene.dims)), QUESTIONS[scene.question][2]
        status, figure = table["status"], plot.swept(table, drawn, label)
        values = {n: v for n, v in table.values.items() if "time" not in table.dims[n]}
    else:
        values = {name: np.asarray(value) for name, value in scene.case().items()}
        coords = {d: np.array(c) for further in scene.dims.values() for d, c in further.items()}
        status = values["status"]
        values["status"] = np.full(coords["time"].shape, status)
        table = jb.Table(values, {n: tuple(scene.dims.get(n, ["time"])) for n in values}, coords)
        figure = plot.history(table)
    out.mkdir(parents=True, exist_ok=True)
    path = out / scene.question
    table.save(path.with_suffix(".npz"))
    dataclasses.replace(table, values=values).to_csv(path.with_suffix(".csv"))
    figure.savefig(path.with_suffix(".png"), dpi=150)
    print(f"{np.sum(status == jb.Status.OK)} of {status.size} ok")
    for code, count in zip(*np.unique(status, return_counts=True), strict=True):
        if code != jb.Status.OK:
            print(f"{count} {jb.Status(code).name}: {jb.Status(code).message}")
    print(f"{path}.csv, .npz and .png")
    return bool((status == jb.Status.OK).any())


def main(argv: list[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser("python -m jaxbeam", description=__doc__, epilog=_EPILOG)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("scene", nargs="?", type=Path, metavar="SCENE.toml")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="default: the name of the file")
    parser.add_argument("--cores", type=int, default=1, metavar="N", help="chunks at once (1)")
    parser.add_argument("--chunk", type=int, default=32, metavar="N", help="cases at once (32)")
    parser.add_argument("--example", choices=list(EXAMPLES), help="print a scene that runs")
    parser.add_argument("--version", action="version", version=f"jaxbeam {jb.__version__}")
    given = parser.parse_args(argv)
    if given.example:
        print(EXAMPLES[given.example], end="")
        return 0
    if given.scene is None or given.cores < 1 or given.chunk < 1:
        parser.error("name a SCENE.toml, and one core and one case at least")
    jax.config.update("jax_enable_x64", True)
    try:
        tables = tomllib.loads(given.scene.read_text("utf-8-sig"))
        if isinstance(beam := tables.get("beam"), dict) and isinstance(beam.get("file"), str):
            beam["file"] = str(given.scene.parent / beam["file"])  # it lies beside the scene
        out = given.out or Path(given.scene.stem)
        return 0 if run(read(tables), out, given.cores, given.chunk) else 1
    except (ValueError, OSError) as error:  # what is wrong with the file or the folder
        where, said = getattr(error, "filename", None), getattr(error, "strerror", None)
        said = str(said or error).splitlines()[0]
        print(f"{where or given.scene}: {said}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped: the same command goes on with what is left of a sweep", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
