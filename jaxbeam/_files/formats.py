"""Which files of beams and blades there are, told by what is in them, and which are read."""

import enum
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Self

READ = (
    "tables of named columns (CSV), blade files of ElastoDyn, section files and main files of "
    "BModes, primary files and blade files of BeamDyn, HAWC2, windIO and VABS"
)


_NAME = r"^[^#\n]*(?<!\S)(?:{})(?!\w)"  # pattern of a word of a line outside of comments


class BladeFormat(enum.Enum):
    """Formats of files that `read_blade` tells apart, and can be told (`format=`).

    `BEAMDYN`, `HAWC2`, `WINDIO` and `VABS` have full sections: see `read_beamdyn`, `read_hawc2`,
    `read_windio` and `read_vabs`. The others make a `Beam`.

    **CSV**, tables with commas, semicolons or tabs between entries.

    Lines that begin with # are comments. The first other line names the columns, in any order, each
    a name and then a unit: `flap_stiffness_N_m2` or `flap stiffness [N m^2]`.

    | name                                   | or                                | unit           |
    |----------------------------------------|-----------------------------------|----------------|
    | x_over_L, x/L (from 0 to 1)            | BlFract, sec_loc, span_fraction   | none           |
    | or x (from 0 at the root)              |                                   | m, cm, mm      |
    | mass_per_length                        | BMassDen, mass_den, linear_mass,  | kg/m, g/m, t/m |
    |                                        | linear_density, rhoA              |                |
    | in_plane_stiffness (edge, edgewise,    | EI_edge, EIedge, edge_EI, and so  | N m^2, kN m^2, |
    | lag, lead_lag for in_plane)            | on; EdgStff, edge_stff            | MN m^2, GN m^2,|
    |                                        |                                   | N mm^2         |
    | flap_stiffness (flapwise,              | EI_flap, EIflap, flap_EI, and so  | the same       |
    | out_of_plane for flap)                 | on; FlpStff, flp_stff             |                |
    | axial_stiffness, if there              | EA, EAStff, axial_stff            | N, kN, MN, GN  |
    | twist, structural_twist, if there      | StrcTwst, str_tw, twist_angle     | deg, rad       |
    | torsional_stiffness, if there          | GJ, GJStff, tor_stff              | as in plane    |
    | polar_inertia, if there                | or both flap_inertia and          | kg m, g m, t m,|
    |                                        | edge_inertia, FlpIner and EdgIner | kg m^2/m       |

    `_bending_stiffness` and `_rigidity` may stand for `_stiffness`. A name without brackets is
    followed by its unit, as in `flap_stiffness_N_m2` and `mass_per_length_kg_per_m`. Units are
    converted; any other one is refused. Torsional stiffness and polar inertia are taken where they
    are positive at all stations. All other columns are named in `ignored`. Each later line is a
    station. Values are linear from one to the next; two equal ones are a step. Numbers may have a
    decimal comma, all of them or none; in quotes, where commas part entries.

    `length`, in m, is needed with x_over_L; with x it is the last station. `axial_stiffness`, in N,
    takes the place of the column, and is needed without one. Frequencies of bending hardly depend
    on it if the beam is stretched by little at its speed.

    Twist is positive in the file as in tables of wind turbines: towards feather, the leading edge
    upwind. Such a rotor turns clockwise as seen from upwind, so its axis by the right-hand rule is
    downwind, and that is where `Beam.twist` is positive: its values are the negative ones of the
    file, and a pitch towards feather is a negative `Rotor.pitch`. Frequencies do not depend on the
    sense, but to which side a mode in plane moves in flap does. Zero at all stations is no twist.

    **ELASTODYN**, blade files of ElastoDyn (OpenFAST, FAST 8), or of FAST 7, which look the same.

    `length`, in m, is TipRad - HubRad of the main file, and is needed. Used are NBlInpSt, the
    columns BlFract, StrcTwst (deg), BMassDen (kg/m), FlpStff and EdgStff (N m^2; edgewise is in
    plane without twist) and, if there, EAStff (N), GJStff (N m^2), FlpIner and EdgIner (kg m,
    together the polar inertia), and the factors AdjBlMs, AdjFlSt, AdjEdSt. Columns have any order;
    units that the line below them has instead are converted. All else is named in `ignored`:
    damping, tuners and shapes of modes, further columns of older files. `axial_stiffness`, in N,
    takes the place of EAStff and is needed without it; in ElastoDyn itself blades do not stretch.

    Values are linear from one station to the next. The sense of the twist is that of a table:
    positive in the file (about minus the axis from root to tip) is negative in the beam.

    Sources: OpenFAST documentation, ElastoDyn; J. Jonkman, M. Buhl, FAST User's Guide,
    NREL/EL-500-38230, 2005; for the NREL 5-MW blade Jonkman et al., NREL/TP-500-38060, 2009.

    **BMODES**, section files of BModes, and main files (`.bmi`), which name one.

    A section file has a title, n_secs, a line of titles, a line of units and n_secs rows of the
    thirteen columns sec_loc (x / L), str_tw, tw_iner (deg), mass_den (kg/m), flp_iner, edge_iner
    (kg m), flp_stff, edge_stff, tor_stff (N m^2), axial_stff (N), cg_offst, sc_offst, tc_offst (m),
    known by their order, as in BModes; other units are converted. What follows are notes. It needs
    `length`, in m. `axial_stiffness`, in N, takes the place of axial_stff. Where they are positive
    everywhere tor_stff is the torsional stiffness, and flp_iner + edge_iner the polar inertia.

    A main file is read line by line, as BModes of version 3.00 or 1.03 does, or, if lines are
    missing, by the names behind the values. Its length is radius - hub_rad; its factors are
    applied; hub radius (hub_rad is along the coned blade), precone (positive towards the axis of
    rotation, downwind), tip mass, pitch (bl_thp) and speed (rot_rpm times rpm_mult, or romg times
    romg_mult) are fields of the result, and so is the body that cm_axial and the inertias ixx_tip
    (in plane), iyy_tip (in flap) and izz_tip (axial), which the program takes about the centre of
    mass, make of the tip mass; `BladeTable.rotor()` makes a rotor of them all. beam_type must be 1,
    a blade, and hub_conn 1, clamped. The section file is looked for beside it.

    Values are linear from one station to the next. (BModes has constant ones in each of its
    elements; where these are few, its frequencies differ by per cents.) The sense of twist and
    pitch is that of a table (CSV): positive in the file is negative in the beam and the result.

    Source: G. Bir, User's Guide to BModes, NREL/TP-500-39133, 2005, and the program itself.
    """

    CSV = "csv"
    ELASTODYN = "elastodyn"
    BMODES = "bmodes"
    BEAMDYN = "beamdyn"
    HAWC2 = "hawc2"
    WINDIO = "windio"
    VABS = "vabs"


class Signature(NamedTuple):
    """A kind of file: its title, its format if it can be read, and patterns of texts that are all
    in it."""

    title: str
    format: BladeFormat | None
    texts: tuple[re.Pattern[str], ...]

    @classmethod
    def of(
        cls, title: str, *texts: str, words: str = "", format: BladeFormat | None = None
    ) -> Self:
        """A kind of file with `words`, which stand alone in lines or behind a value, and other
        texts."""
        every = [*texts, *map(_NAME.format, words.split())]
        return cls(title, format, tuple(re.compile(text, re.M | re.I) for text in every))


SIGNATURES = (
    Signature.of("an Excel workbook (save it as CSV)", r"\APK\x03\x04"),
    Signature.of("a BeamDyn blade file", words="station_total", format=BladeFormat.BEAMDYN),
    Signature.of("a BeamDyn primary file", words="kp_total", format=BladeFormat.BEAMDYN),
    Signature.of("an ElastoDyn tower file", words="HtFract TMassDen|TwFAStif"),
    Signature.of("an ElastoDyn primary file", r"BldFile\W?1", words="TipRad"),
    Signature.of("an AeroDyn blade file", words="BlSpn BlChord"),
    Signature.of(
        "a HAWC2 htc file",
        r"^\s*begin\s+(new_htc_structure|main_body|c2_def|timoschenko_input)",
        format=BladeFormat.HAWC2,
    ),
    Signature.of(
        "a HAWC2 st file", r"^\s*#\s*\d+", r"^\s*\$\s*\d+\s+\d+", format=BladeFormat.HAWC2
    ),
    Signature.of(
        "a windIO YAML file",
        r"^['\"]?components['\"]?\s*:",
        r"^\s+['\"]?blade['\"]?\s*:",
        format=BladeFormat.WINDIO,
    ),
    Signature.of(
        "a VABS .K file",
        r"the 6x6 mass matrix|^\s*(timoshenko|classical) stiffness matrix",
        format=BladeFormat.VABS,
    ),
    Signature.of("an ElastoDyn blade file", words="BlFract NBlInpSt", format=BladeFormat.ELASTODYN),
    Signature.of("a BModes main file", words="sec_props_file", format=BladeFormat.BMODES),
    Signature.of("a BModes section file", words="n_secs", format=BladeFormat.BMODES),
)


def signature_of(lines: Sequence[str]) -> Signature | None:
    """The kind of a file with these lines; None for unknown ones."""
    text = "\n".join(lines)
    for each in SIGNATURES:
        if all(re.search(part, text) for part in each.texts):
            return each
    return None


def refuse_other(path: Path, lines: Sequence[str], format: BladeFormat) -> None:
    """Raise `ValueError` where a file is of another format than the one that is asked for."""
    found = signature_of(lines)
    if found is None or found.format == format:
        return
    if found.format:
        raise ValueError(f"{path} is {found.title}: take read_blade, with {found.format} or none")
    raise ValueError(f"{path} is {found.title}, which is not read; known are {READ}")


def no_format(path: Path, why: str) -> ValueError:
    """The error for a file of no known kind."""
    return ValueError(f"{path} is of no known kind, {why}; known are {READ}")
