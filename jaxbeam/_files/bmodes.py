"""Beams from the section files and main files of BModes, versions 1.03 and 3.00."""

import math
from collections.abc import Sequence
from pathlib import Path

from jaxbeam._files.formats import BladeFormat, refuse_other
from jaxbeam._files.names import meanings
from jaxbeam._files.nrel import (
    REASONS,
    Head,
    NamedValues,
    Value,
    beside,
    blade_of,
    count_of,
    ignoring_too,
    named,
    number,
    require,
    table_rows,
    value_in,
)
from jaxbeam._files.tables import (
    AXIAL,
    DEGREES,
    FLAP,
    IN_PLANE,
    MASS,
    POLARS,
    TORSION,
    UNITS,
    BladeTable,
    unit_in,
)
from jaxbeam._files.texts import FilePath, entries, is_number, mistake, read_lines
from jaxbeam._rotor.ends import TipBody
from jaxbeam._rotor.spanwise import AbstractSpanwise
from jaxbeam._types import Real

# Columns of a section file.
_SECTION = ["sec_loc", "str_tw", "tw_iner", "mass_den", "flp_iner", "edge_iner", "flp_stff"]
_SECTION += ["edge_stff", "tor_stff", "axial_stff", "cg_offst", "sc_offst", "tc_offst"]
_USED = "sec_loc str_tw mass_den flp_iner edge_iner flp_stff edge_stff tor_stff axial_stff"
# Factors of properties in a main file.
_FACTORS = {
    "sec_mass_mult": MASS, "flp_iner_mult": POLARS[0], "lag_iner_mult": POLARS[1],
    "flp_stff_mult": FLAP, "edge_stff_mult": IN_PLANE, "tor_stff_mult": TORSION,
    "axial_stff_mult": AXIAL,
}  # fmt: skip
# Names of values by line of a main file of version 3.00; 1.03 has no cm_axial. Lines of free text
# are "-". Empty lines are skipped before a value, but not before free text.
_LINES = """
- - - - Echo beam_type rot_rpm rpm_mult radius hub_rad precone bl_thp hub_conn modepr
TabDelim mid_node_tw - - tip_mass cm_loc cm_axial ixx_tip iyy_tip izz_tip ixy_tip izx_tip iyz_tip
- - id_mat sec_props_file - - sec_mass_mult flp_iner_mult lag_iner_mult flp_stff_mult edge_stff_mult
tor_stff_mult axial_stff_mult cg_offst_mult sc_offst_mult tc_offst_mult
""".split()  # noqa: SIM905
_ALSO = {"romg": "rot_rpm", "romg_mult": "rpm_mult", "rroot": "hub_rad", "btp": "precone"}
_TRUTHS = ("Echo", "TabDelim", "mid_node_tw")
_FREE = 2  # number of lines of free text at the beginning of a main file


def read_bmodes(
    path: FilePath,
    *,
    length: Real | None = None,
    axial_stiffness: Real | AbstractSpanwise | None = None,
) -> BladeTable:
    """A beam from a section file of BModes, or from a main file (`.bmi`), which names one.

    See `BladeFormat`.
    """
    path = Path(path)
    lines = read_lines(path)
    if not is_main_file(lines):
        return _sections(path, lines, length, axial_stiffness, {})
    if length is not None:
        raise ValueError(f"{path}: a main file says the length, so none must be given")
    said = _said(lines)
    others = ("beam_type", "hub_conn", "hub_rad", "tip_mass", "rot_rpm", "rpm_mult", "bl_thp")
    needed = ("sec_mass_mult", "flp_stff_mult", "edge_stff_mult", "axial_stff_mult")
    require(path, said, ("radius", *others, *needed, "sec_props_file"))
    require(path, said, [name for name in (*_LINES, *_FACTORS) if name.lower() in said])
    factors = {
        property_: number(path, said, name, False)
        for name, property_ in _FACTORS.items() if name in said
    }  # fmt: skip
    beam_type, hub_conn, hub, tip_mass = (number(path, said, name, True) for name in others[:4])
    rpm, multiple, pitch = (number(path, said, name) for name in others[4:])
    cone = number(path, said, "precone") if "precone" in said else 0.0
    radius = number(path, said, "radius", False)
    for name, wrong in (
        ("beam_type", beam_type != 1 and "must be 1, a blade"),
        ("hub_conn", hub_conn != 1 and "must be 1, a clamped root"),
        ("radius", radius <= hub and f"must be greater than hub_rad, {hub:g}"),
        ("bl_thp", abs(pitch) > 360 and "must be within 360 degrees"),
        ("precone", abs(cone) > 90 and "must be within 90 degrees"),
    ):
        if wrong:
            line, title, text = said[name][0]
            raise mistake(path, line, title, f"{wrong}, got {text}")
    sections, rows = beside(path, said["sec_props_file"][0], "section")
    table = _sections(sections, rows, radius - hub, axial_stiffness, factors)
    left = [values[0] for name, values in said.items() if name in REASONS]
    return ignoring_too(table, left)._replace(
        # Measured from the axis, not along the blade.
        hub_radius=hub * math.cos(math.radians(cone)),
        tip_mass=tip_mass,
        pitch=pitch * DEGREES if pitch else None,
        angular_speed=rpm * multiple * math.pi / 30,
        precone=math.radians(cone) if cone else None,
        tip_body=_body(path, said, tip_mass),
    )


def _body(path: Path, said: NamedValues, mass: float) -> TipBody | None:
    """The body that a main file makes of the tip mass; None for a point mass."""
    lag, flap, axial = (
        number(path, said, name, True) if name in said else 0.0
        for name in ("ixx_tip", "iyy_tip", "izz_tip")
    )
    offset = number(path, said, "cm_axial") if "cm_axial" in said else 0.0
    if not (offset or lag or flap or axial):
        return None
    return TipBody(mass, offset, lag, axial, None if flap == lag else flap)


def is_main_file(lines: Sequence[str]) -> bool:
    """Whether lines are those of a main file, by names of values or by their order."""
    expected = {name.lower() for name in _LINES} & named(lines, _FREE, None).keys()
    return "sec_props_file" in expected or len(expected) > 4 or _by_line(lines) is not None


def is_section_file(lines: Sequence[str]) -> bool:
    """Whether lines are those of a section file: after a title n_secs, by name or before rows of
    thirteen numbers."""
    count = next((line for line in lines[1:] if line.strip()), "")
    rows = (line for line in lines if _is_row(line) and len(entries(line)) >= len(_SECTION))
    fits = is_number(value_in(count)) and not _is_row(count)
    return fits and ("n_secs" in named([count], 0, None) or next(rows, None) is not None)


def _said(lines: Sequence[str]) -> NamedValues:
    """The values of a main file by name, found by line or else by name; names of older versions
    become those of newer ones."""
    if said := _by_line(lines):
        return said
    by_name: NamedValues = {}
    for name, values in named(lines, _FREE, None).items():
        by_name.setdefault(_ALSO.get(name, name), []).extend(values)
    return by_name


def _by_line(lines: Sequence[str]) -> NamedValues | None:
    """The values of a main file by their lines, if all lines are there: BModes itself reads them
    without names."""
    for names in (_LINES, [name for name in _LINES if name != "cm_axial"]):
        said: NamedValues = {}
        at = 0
        for name in names:
            while name != "-" and at < len(lines) and not lines[at].strip():
                at += 1
            if at >= len(lines):
                break
            if name != "-":
                value = _expected(name, at + 1, lines[at])
                if value is None:
                    break
                said[name.lower()] = [value]
            at += 1
        else:
            return said
    return None


def _expected(name: str, number: int, line: str) -> Value | None:
    """The value of a line for a name, if the line does not bear another name."""
    text = value_in(line)
    called = [_ALSO.get(other, other) for other in named([line], 0, None)]
    expected = {other.lower() for other in _LINES}
    if any(other in expected and other != name.lower() for other in called):
        return None
    if name in _TRUTHS:
        fits = text.lstrip(".").lower().startswith(("t", "f"))
    else:
        fits = is_number(text) != (name == "sec_props_file") and bool(text)
    return Value(number, name, text) if fits else None


def _sections(
    path: Path,
    lines: Sequence[str],
    length: Real | None,
    axial_stiffness: Real | AbstractSpanwise | None,
    factors: dict[str, float],
) -> BladeTable:
    """The blade of a section file, with properties times factors."""
    first = next((i for i in range(1, len(lines)) if lines[i].strip()), None)
    if first is None or not is_section_file(lines):
        refuse_other(path, lines, BladeFormat.BMODES)
    if first is None:
        raise ValueError(f"{path}: no n_secs, titles and units after the first line")
    count = count_of(path, first + 1, "n_secs", value_in(lines[first]))
    start = next((i for i in range(first + 1, len(lines)) if _is_row(lines[i])), first + 1)
    between = [i for i in range(first + 1, start) if lines[i].strip()]
    below = between[-1] if between else first
    head = between[-2] if len(between) > 1 else below
    has_units = len(between) > 1 or all(unit_in(u) in _ANY_UNIT for u in lines[below].split())
    units = lines[below] if has_units and between else ""
    scaled = meanings(_USED, factors)
    rows = table_rows(path, lines, start, count, "n_secs", len(_SECTION))
    needed = ("sec_loc", "mass_den", "flp_stff", "edge_stff", "axial_stff")
    titles = Head(head + 1, _SECTION, units, below + 1)
    return blade_of(path, titles, scaled, rows, length, axial_stiffness, needed)


_ANY_UNIT = {unit for units in UNITS.values() for unit in units} | {"m"}


def _is_row(line: str) -> bool:
    cells = entries(line)
    return len(cells) > 1 and all(map(is_number, cells[: len(_SECTION)]))
