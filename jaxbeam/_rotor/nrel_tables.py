"""Beams from the blade files of OpenFAST's ElastoDyn and of BModes."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from jaxbeam._rotor.spanwise import AbstractSpanwise
from jaxbeam._rotor.tables import (
    AXIAL,
    DEGREES,
    FLAP,
    IN_PLANE,
    MASS,
    PLACE,
    TWIST,
    BladeTable,
    Column,
    FilePath,
    Row,
    blade,
    ignoring,
    is_number,
    mistake,
    number_in,
    read_lines,
)
from jaxbeam._types import Real

_REASONS = {
    name: reason
    for reason, names in {
        "it belongs to the aerodynamics": "aerocent pitchaxis",
        "sections are not turned by torsion": "gjstff tor_stff alpha",
        "sections have no rotary inertia": "flpiner edginer flp_iner edge_iner tw_iner",
        "the beam is straight": "precrvref preswpref",
        "the centre of mass is on the axis of the beam": "flpcgof edgcgof cg_offst",
        "the centre of tension is on the axis of the beam": "flpeaof edgeaof tc_offst",
        "the shear centre is on the axis of the beam": "sc_offst",
        "damping is an argument of a simulation": "bldfldmp bldeddmp",
        "frequencies follow from stiffness and mass": "flsttunr",
        "shapes of modes are computed": "bldfl1sh bldfl2sh bldedgsh",
        "give it to a Rotor as precone": "precone",
        "the tip mass is on the axis of the beam": "cm_loc",
        "give it to a Rotor in a TipBody, as offset": "cm_axial",
        "give it to a Rotor in a TipBody, as inertia": (
            "ixx_tip iyy_tip izz_tip ixy_tip izx_tip iyz_tip"
        ),
    }.items()
    for name in names.split()
}
# Columns of a section file of BModes.
_SECTION = ["sec_loc", "str_tw", "tw_iner", "mass_den", "flp_iner", "edge_iner", "flp_stff"]
_SECTION += ["edge_stff", "tor_stff", "axial_stff", "cg_offst", "sc_offst", "tc_offst"]
_Known = Mapping[str, tuple[str, float]]  # by title: the property, its factor to SI units
_Said = dict[str, tuple[int, str]]  # by name: number of the line, the value as text


def read_elastodyn(
    path: FilePath,
    *,
    length: Real,
    axial_stiffness: Real | AbstractSpanwise | None = None,
) -> BladeTable:
    """A beam from a blade file of ElastoDyn (OpenFAST, FAST 8), or of FAST 7, which looks the same.

    `length`, in m, is TipRad - HubRad of the main file. Used are NBlInpSt, the columns BlFract,
    StrcTwst (deg), BMassDen (kg/m), FlpStff and EdgStff (N m^2; edgewise is in plane without twist)
    and, if there, EAStff (N), and the factors AdjBlMs, AdjFlSt, AdjEdSt. All else is named in
    `ignored`: damping, tuners and shapes of modes, further columns of older files.
    `axial_stiffness`, in N, takes the place of EAStff and is needed without it; in ElastoDyn itself
    blades do not stretch.

    Values are linear from one station to the next. The sense of the twist is that of `read_csv`:
    positive in the file (about minus the axis from root to tip) is negative in the beam.

    Sources: OpenFAST documentation, ElastoDyn; J. Jonkman, M. Buhl, FAST User's Guide,
    NREL/EL-500-38230, 2005; for the NREL 5-MW blade Jonkman et al., NREL/TP-500-38060, 2009.

    Raises `ValueError`, which names file, line and column of the first mistake.
    """
    path = Path(path)
    lines = read_lines(path)
    head = next((i for i, line in enumerate(lines) if line.split()[:1] == ["BlFract"]), None)
    if head is None:
        raise ValueError(f"{path}: no line begins with BlFract, so there is no table of stations")
    said = _named(lines, 2, head)  # after two lines of titles
    used = ("NBlInpSt", "AdjBlMs", "AdjFlSt", "AdjEdSt")
    _require(path, said, used)
    count, mass, flap, edge = (number_in(path, *_at(said, name), False) for name in used)
    known = {
        "BlFract": (PLACE, 1.0), "BMassDen": (MASS, mass), "FlpStff": (FLAP, flap),
        "EdgStff": (IN_PLANE, edge), "StrcTwst": (TWIST, DEGREES), "EAStff": (AXIAL, 1.0),
    }  # fmt: skip
    rows = _rows(path, lines, head + 2, count, "NBlInpSt")  # after the line of units
    table = _blade(path, head + 1, lines[head].split(), known, rows, length, axial_stiffness)
    others = said | _named(lines, rows[-1][0], len(lines))
    return _ignoring_too(table, {n: text for n, (_, text) in others.items() if n not in used})


def read_bmodes(
    path: FilePath,
    *,
    length: Real | None = None,
    axial_stiffness: Real | AbstractSpanwise | None = None,
) -> BladeTable:
    """A beam from a section file of BModes, or from a main file (`.bmi`), which names one.

    A section file has a title, n_secs, a line of titles, a line of units and n_secs rows of the
    thirteen columns sec_loc (x / L), str_tw, tw_iner (deg), mass_den (kg/m), flp_iner, edge_iner
    (kg m), flp_stff, edge_stff, tor_stff (N m^2), axial_stff (N), cg_offst, sc_offst, tc_offst (m),
    known by their order, as in BModes. What follows are notes. It needs `length`, in m.
    `axial_stiffness`, in N, takes the place of axial_stff.

    In a main file values are found by the names behind them. Its length is radius - hub_rad; its
    factors of mass, flap, edge and axial stiffness are applied; hub radius, tip mass, pitch
    (bl_thp) and speed (rot_rpm times rpm_mult) are fields of the result. beam_type must be 1, a
    blade, and hub_conn 1, clamped. The section file is looked for beside it.

    Values are linear from one station to the next. (BModes has constant ones in each of its
    elements; where these are few, its frequencies differ by per cents.) The sense of twist and
    pitch is that of `read_csv`: positive in the file is negative in the beam and the result.

    Source: G. Bir, User's Guide to BModes, NREL/TP-500-39133, 2005.

    Raises `ValueError`, which names file, line and column of the first mistake.
    """
    path = Path(path)
    if path.suffix.lower() != ".bmi":
        return _sections(path, length, axial_stiffness, (1.0, 1.0, 1.0, 1.0))
    if length is not None:
        raise ValueError(f"{path}: a main file says the length, so none must be given")
    said = _named(read_lines(path), 0, None)
    factors = ("sec_mass_mult", "flp_stff_mult", "edge_stff_mult", "axial_stff_mult")
    others = ("beam_type", "hub_conn", "hub_rad", "tip_mass", "rot_rpm", "rpm_mult", "bl_thp")
    _require(path, said, ("radius", *others, *factors, "sec_props_file"))
    scales = [number_in(path, *_at(said, name), False) for name in factors]
    beam_type, hub_conn, hub, tip_mass = (
        number_in(path, *_at(said, name), True) for name in others[:4]
    )
    rpm, multiple, pitch = (number_in(path, *_at(said, name)) for name in others[4:])
    radius = number_in(path, *_at(said, "radius"), False)
    for name, wrong in (
        ("beam_type", beam_type != 1 and "must be 1, a blade"),
        ("hub_conn", hub_conn != 1 and "must be 1, a clamped root"),
        ("radius", radius <= hub and f"must be greater than hub_rad, {hub:g}"),
        ("bl_thp", abs(pitch) > 360 and "must be within 360 degrees"),
    ):
        if wrong:
            line, _, text = _at(said, name)
            raise mistake(path, line, name, f"{wrong}, got {text}")
    sections = path.parent / said["sec_props_file"][1].strip("'\"").replace("\\", "/")
    table = _sections(sections, radius - hub, axial_stiffness, scales)
    left = {name: text for name, (_, text) in said.items() if name in _REASONS}
    return _ignoring_too(table, left)._replace(
        hub_radius=hub,
        tip_mass=tip_mass,
        pitch=pitch * DEGREES if pitch else None,
        angular_speed=rpm * multiple * math.pi / 30,
    )


def _sections(
    path: Path,
    length: Real | None,
    axial_stiffness: Real | AbstractSpanwise | None,
    factors: Sequence[float],
) -> BladeTable:
    """From a section file of BModes; factors of mass, flap, edge and axial stiffness."""
    lines = read_lines(path)
    filled = [i for i, line in enumerate(lines) if i and line.strip()]  # after the title
    if len(filled) < 3:
        raise ValueError(f"{path}: no n_secs, titles and units after the first line")
    first, head, units = filled[:3]
    count = number_in(path, first + 1, "n_secs", lines[first].split()[0], False)
    mass, flap, edge, stretch = factors
    known = {
        "sec_loc": (PLACE, 1.0), "mass_den": (MASS, mass), "flp_stff": (FLAP, flap),
        "edge_stff": (IN_PLANE, edge), "str_tw": (TWIST, DEGREES), "axial_stff": (AXIAL, stretch),
    }  # fmt: skip
    rows = _rows(path, lines, units + 1, count, "n_secs")
    return _blade(path, head + 1, _SECTION, known, rows, length, axial_stiffness)


def _blade(
    path: Path,
    line: int,
    titles: Sequence[str],
    known: _Known,
    rows: Sequence[Row],
    length: Real | None,
    axial_stiffness: Real | AbstractSpanwise | None,
) -> BladeTable:
    columns = {}
    for i, title in enumerate(titles):
        if title in known:
            name, factor = known[title]
            columns[name] = Column(title, i, factor)
    named = {name: title for title, (name, _) in known.items()}
    return blade(
        path, line, titles, columns, rows, length, axial_stiffness, named, reasons=_REASONS
    )


def _rows(path: Path, lines: Sequence[str], start: int, count: float, name: str) -> list[Row]:
    """Entries of as many lines as a number says; comments begin with !."""
    filled = [(i + 1, lines[i].split("!")[0].split()) for i in range(start, len(lines))]
    rows = [(line, cells) for line, cells in filled if cells][: int(count)]
    ends = next((i for i, (_, cells) in enumerate(rows) if cells[0].startswith("--")), len(rows))
    if ends < count:
        last = rows[ends][0] if ends < len(rows) else len(lines)
        raise mistake(path, last, None, f"{name} is {count:g}, but the table ends after {ends}")
    return rows


def _named(lines: Sequence[str], start: int, stop: int | None) -> _Said:
    """What lines of a value and then its name say."""
    said: _Said = {}
    for i, line in enumerate(lines[start:stop], start + 1):
        found = re.match(r"\s*('[^']*'|\"[^\"]*\"|\S+)\s+([A-Za-z]\w*(\(\d+\))?)", line)
        if found and not line.lstrip().startswith("--"):
            said.setdefault(found[2], (i, found[1]))
    return said


def _require(path: Path, said: _Said, names: Sequence[str]) -> None:
    missing = [name for name in names if name not in said]
    if missing:
        raise ValueError(f"{path}: no line has {', '.join(missing)} behind its value")


def _at(said: _Said, name: str) -> tuple[int, str, str]:
    line, text = said[name]
    return line, name, text


def _ignoring_too(table: BladeTable, others: Mapping[str, str]) -> BladeTable:
    """With the sentences on named values, but those that change nothing; one for each array."""
    left = []
    for name, text in others.items():
        array = re.sub(r"\(?\d+\)?$", "", name)
        array = array if array.lower() in _REASONS else name
        if array not in left and not is_number(text, 1 if array == "FlStTunr" else 0):
            left.append(array)
    return table._replace(ignored=table.ignored + tuple(ignoring(n, _REASONS) for n in left))
