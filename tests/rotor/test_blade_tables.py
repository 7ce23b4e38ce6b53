"""Blades from files: the three formats agree, and what is wrong in one is said in a line."""

import functools
import re

import equinox as eqx
import jax
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import blades
from tests.references.blade import NREL

read_csv, read_elastodyn, read_bmodes = (
    functools.partial(blades.read_blade, format=form)
    for form in (blades.BladeFormat.CSV, blades.BladeFormat.ELASTODYN, blades.BladeFormat.BMODES)
)
EA = 9.7e9
ROWS = np.loadtxt(NREL, delimiter=",", skiprows=2)  # x / L, twist, mass, flap, edge
PUBLISHED_FACTOR = 1.04536  # AdjBlMs in OpenFAST's file of this blade
CSV_TITLES = "x_over_L,structural_twist_deg,mass_per_length_kg_per_m,flap_stiffness_N_m2,"
CSV_TITLES += "edge_stiffness_N_m2"


def write(path, *lines):
    path.write_text("\n".join(lines) + "\n")
    return path


def row(values):
    return "  ".join(f"{value:.17g}" for value in values)


def elastodyn(path, rows=ROWS, titles="BlFract StrcTwst BMassDen FlpStff EdgStff", **changed):
    """A blade file as OpenFAST 3 has it."""
    said = {
        "NBlInpSt": len(rows), "BldFlDmp(1)": 0.477465, "BldFlDmp(2)": 0.477465,
        "BldEdDmp(1)": 0.477465, "FlStTunr(1)": 1, "FlStTunr(2)": 1, "AdjBlMs": 1, "AdjFlSt": 1,
        "AdjEdSt": 1,
    } | changed  # fmt: skip
    named = [f"{value}  {name}  - what it is (-)" for name, value in said.items() if value != ""]
    return write(
        path,
        "------- ELASTODYN V1.00.* INDIVIDUAL BLADE INPUT FILE ----------",
        "NREL 5-MW, written by a test",
        "---------------------- BLADE PARAMETERS ------------------------",
        *named[:4],
        "---------------------- BLADE ADJUSTMENT FACTORS ----------------",
        *named[4:],
        "---------------------- DISTRIBUTED BLADE PROPERTIES ------------",
        titles,
        "(-)  " * len(titles.split()),
        *(line if isinstance(line, str) else row(line) for line in rows),
        "---------------------- BLADE MODE SHAPES -----------------------",
        *(f"  {i / 10}  BldFl1Sh({i}) - Flap mode 1, coeff of x^{i}" for i in range(2, 7)),
    )


def bmodes_rows(**columns):
    given = {"tw_iner": 0.0, "axial_stff": EA} | columns
    table = np.zeros((len(ROWS), 13))
    for i, j in enumerate((0, 1, 3, 6, 7)):
        table[:, j] = ROWS[:, i]
    for name, value in given.items():
        table[:, SECTION.index(name)] = value
    return table


SECTION = ["sec_loc", "str_tw", "tw_iner", "mass_den", "flp_iner", "edge_iner", "flp_stff"]
SECTION += ["edge_stff", "tor_stff", "axial_stff", "cg_offst", "sc_offst", "tc_offst"]


def sections(path, rows=None, count=None):
    rows = bmodes_rows() if rows is None else rows
    return write(
        path,
        "Blade section properties",
        f"{len(rows) if count is None else count}   n_secs:  number of sections (-)",
        "",
        "  ".join(SECTION),
        "(-)  " * 13,
        *(line if isinstance(line, str) else row(line) for line in rows),
        "",
        "**Note: what follows the rows is not read",
    )


def main_file(path, **changed):
    """A main file of BModes as its own examples have it."""
    said = {
        "Echo": "true", "beam_type": 1, "rot_rpm": 12.1, "rpm_mult": 1.0, "radius": 63.0,
        "hub_rad": 1.5, "precone": 0.0, "bl_thp": 0.0, "hub_conn": 1, "tip_mass": 0.0,
        "cm_loc": 0.0, "cm_axial": 0.0, "ixx_tip": 0.0, "sec_props_file": "'my blade.dat'",
        "sec_mass_mult": 1.0, "flp_stff_mult": 1.0, "edge_stff_mult": 1.0, "axial_stff_mult": 1.0,
    } | changed  # fmt: skip
    return write(
        path,
        "======================   BModes Main Input File   ==================",
        "A title",
        "",
        "--------- General parameters ---------------------------------------",
        *(f"{value}   {name}:   what it is (-)" for name, value in said.items() if value != ""),
        "--------- Finite element discretization ----------------------------",
        "2  nselt: number of elements",
        "Distance of element boundary nodes from blade root, el_loc()",
        "0. 0.5 1.",
    )


def mass_by_trapezia(x, mass, length):
    return length * np.sum(np.diff(x) * (mass[1:] + mass[:-1]) / 2)


def same(one, two):
    for name in (
        "mass_per_length",
        "in_plane_bending_stiffness",
        "flap_bending_stiffness",
        "twist",
    ):
        a, b = getattr(one, name), getattr(two, name)
        assert a.stations == b.stations
        np.testing.assert_allclose(a.values, b.values, rtol=1e-14)
    assert float(one.length) == pytest.approx(float(two.length), rel=1e-15)


def nrel():
    return read_csv(NREL, length=61.5, axial_stiffness=EA)


def test_the_published_blade_has_its_mass(tmp_path):
    beam = nrel().beam
    mass = mass_by_trapezia(ROWS[:, 0], ROWS[:, 2], 61.5)
    assert mass == pytest.approx(16_845, abs=1)
    assert float(beam.mass) == pytest.approx(mass, rel=1e-13)
    # 17,740 kg are published with this factor, for the sum over the 17 nodes of that model.
    file = elastodyn(tmp_path / "blade.dat", AdjBlMs=PUBLISHED_FACTOR)
    adjusted = float(read_elastodyn(file, length=61.5, axial_stiffness=EA).beam.mass)
    assert adjusted == pytest.approx(PUBLISHED_FACTOR * mass, rel=1e-13)
    assert adjusted == pytest.approx(17_740, rel=0.01)


def test_properties_are_where_they_belong():
    beam = nrel().beam
    np.testing.assert_array_equal(beam.twist.stations, ROWS[:, 0])
    np.testing.assert_allclose(beam.twist.values, -np.radians(ROWS[:, 1]))  # against the axis
    np.testing.assert_allclose(beam.flap_bending_stiffness.values, ROWS[:, 3])
    np.testing.assert_allclose(beam.in_plane_bending_stiffness.values, ROWS[:, 4])
    assert float(beam.axial_stiffness) == EA
    assert nrel()[1:] == ((), *7 * [None])


def test_all_formats_give_the_same_beam(tmp_path):
    want = nrel().beam
    file = elastodyn(tmp_path / "blade.dat")
    same(read_elastodyn(file, length=61.5, axial_stiffness=EA).beam, want)
    found = read_bmodes(sections(tmp_path / "my blade.dat"), length=61.5).beam
    same(found, want)
    np.testing.assert_array_equal(found.axial_stiffness.values, EA)
    same(read_bmodes(main_file(tmp_path / "blade.bmi")).beam, want)


def test_files_written_by_pybmodes_read_the_same(tmp_path):
    io = pytest.importorskip("pybmodes.io._elastodyn.writer")
    reader = pytest.importorskip("pybmodes.io.elastodyn_reader")
    theirs = reader.read_elastodyn_blade(elastodyn(tmp_path / "blade.dat"))
    io.write_elastodyn_blade(theirs, tmp_path / "theirs.dat")
    table = read_elastodyn(tmp_path / "theirs.dat", length=61.5, axial_stiffness=EA)
    same(table.beam, nrel().beam)
    props = pytest.importorskip("pybmodes.io.sec_props")
    theirs = props.read_sec_props(sections(tmp_path / "sections.dat"))
    ours = read_bmodes(tmp_path / "sections.dat", length=61.5).beam
    np.testing.assert_array_equal(ours.mass_per_length.values, theirs.mass_den)
    np.testing.assert_array_equal(ours.in_plane_bending_stiffness.values, theirs.edge_stff)


def test_units_and_names_of_columns(tmp_path):
    plain = read_csv(
        write(
            tmp_path / "plain.csv",
            "x_m,mass_per_length_kg_per_m,in_plane_stiffness_N_m2,flap_stiffness_N_m2,"
            "axial_stiffness_N,twist_rad",
            "0,2,3e6,4e6,5e9,0.1", "1,3,4e6,5e6,6e9,0.05", "2,4,5e6,6e6,7e9,0.02",
        )
    ).beam  # fmt: skip
    assert float(plain.length) == 2.0
    assert plain.twist.stations == (0.0, 0.5, 1.0)
    np.testing.assert_allclose(plain.twist.values, [-0.1, -0.05, -0.02])
    other = read_csv(
        write(
            tmp_path / "other.csv",
            "# in other units, in another order\n",
            "Twist [deg], Lag bending stiffness [MN m^2], flapwise_stiffness_kN_m2,"
            " Axial stiffness (GN), mass_per_length_g_per_m, x [mm]",
            f"{np.degrees(0.1):.17g}, 3, 4e3, 5, 2e3, 0", "# a comment between",
            f"{np.degrees(0.05):.17g}, 4, 5e3, 6, 3e3, 1000",
            f"{np.degrees(0.02):.17g}, 5, 6e3, 7, 4e3, 2000",
        )
    ).beam  # fmt: skip
    same(other, plain)
    np.testing.assert_allclose(other.axial_stiffness.values, plain.axial_stiffness.values)


def test_steps_and_no_twist(tmp_path):
    beam = read_csv(
        write(
            tmp_path / "step.csv",
            "x/L [-],mass_per_length_kg_per_m,edge_stiffness_N_m2,flap_stiffness_N_m2,twist_deg",
            "0,1,4,1,0", "0.5,1,4,1,0", "0.5,0.6,2,0.3,0", "1,0.6,2,0.3,0",
        ),
        length=2.0,
        axial_stiffness=1e3,
    ).beam  # fmt: skip
    assert beam.twist is None
    assert float(beam.mass) == pytest.approx(1.6)
    assert beam.edges == (0.0, 0.5, 1.0)


def test_what_is_ignored_in_csv(tmp_path):
    text = NREL.read_text().splitlines()
    more = [f"{line},{i},foil {i},0" for i, line in enumerate(text)]
    file = write(tmp_path / "more.csv", f"{text[1]},x_cg_m,foil,sweep_m", *more[2:])
    table = read_csv(file, length=61.5, axial_stiffness=EA)
    same(table.beam, nrel().beam)
    assert table.ignored == (  # not the column of zeros
        "x_cg_m is ignored: a Beam has nothing of this name (in the file up to 50).",
        "foil is ignored: a Beam has nothing of this name.",
    )


def test_what_is_ignored_in_elastodyn(tmp_path):
    older = "BlFract AeroCent StrcTwst BMassDen FlpStff EdgStff GJStff EAStff FlpcgOf Unheard"
    ones = np.ones(len(ROWS))
    rows = np.column_stack(
        [ROWS[:, 0], 0.25 * ones, *ROWS[:, 1:].T, 1e9 * ones, EA * ones, 0 * ones, ones]
    )
    file = elastodyn(tmp_path / "older.dat", rows, older, **{"FlStTunr(1)": 1.1, "AdjEdSt": 2})
    table = read_elastodyn(file, length=61.5)
    np.testing.assert_array_equal(table.beam.axial_stiffness.values, EA)
    np.testing.assert_allclose(table.beam.in_plane_bending_stiffness.values, 2 * ROWS[:, 4])
    np.testing.assert_array_equal(table.beam.torsional_stiffness.values, 1e9)
    names = [sentence.split(" is ignored: ")[0] for sentence in table.ignored]
    assert names == [
        "AeroCent",
        "Unheard",
        "BldFlDmp",
        "BldEdDmp",
        "FlStTunr",
        "BldFl1Sh",
    ]
    assert "BldFlDmp is ignored: damping is an argument of a simulation." in table.ignored
    table = read_elastodyn(file, length=61.5, axial_stiffness=1e8)
    assert float(table.beam.axial_stiffness) == 1e8
    assert table.ignored[0] == "EAStff is ignored: axial_stiffness was given."


def test_main_file_of_bmodes(tmp_path):
    rows = bmodes_rows(tw_iner=1.0, cg_offst=0.1, tor_stff=7e7, flp_iner=3.0, edge_iner=40.0)
    sections(tmp_path / "my blade.dat", rows)
    changed = {"tip_mass": 40.0, "bl_thp": 3.0, "rpm_mult": 2.0, "precone": -2.5, "cm_axial": 0.2}
    factors = {"sec_mass_mult": 2.0, "flp_stff_mult": 3.0, "edge_stff_mult": 4.0}
    changed |= {"tor_stff_mult": 6.0, "flp_iner_mult": 7.0, "lag_iner_mult": 8.0}
    file = main_file(tmp_path / "blade.bmi", axial_stff_mult=5.0, **changed, **factors)
    table = read_bmodes(file)
    assert table.hub_radius == pytest.approx(1.5 * np.cos(np.radians(2.5)))
    assert table.tip_mass == 40.0
    assert table.pitch == pytest.approx(-np.radians(3.0))  # in the sense of the twist
    assert table.angular_speed == pytest.approx(2 * 12.1 * np.pi / 30)
    assert float(table.beam.length) == 61.5
    np.testing.assert_allclose(table.beam.mass_per_length.values, 2 * ROWS[:, 2])
    np.testing.assert_allclose(table.beam.flap_bending_stiffness.values, 3 * ROWS[:, 3])
    np.testing.assert_allclose(table.beam.in_plane_bending_stiffness.values, 4 * ROWS[:, 4])
    np.testing.assert_allclose(table.beam.axial_stiffness.values, 5 * EA)
    np.testing.assert_allclose(table.beam.torsional_stiffness.values, 6 * 7e7)
    np.testing.assert_allclose(table.beam.polar_inertia.values, 7 * 3.0 + 8 * 40.0)
    names = [sentence.split(" is ignored: ")[0] for sentence in table.ignored]
    assert names == ["tw_iner", "cg_offst"]
    assert "on the axis of the beam (in the file up to 0.1)" in table.ignored[1]
    assert table.precone == pytest.approx(-np.radians(2.5))
    rotor = table.rotor(tip_mass=3.0)
    assert isinstance(rotor, jb.Rotor)
    assert (rotor.tip_mass, rotor.pitch, rotor.precone) == (3.0, table.pitch, table.precone)
    assert not rotor.tip_body.is_body
    rotor = table.rotor()
    assert [float(leaf) for leaf in jax.tree.leaves(rotor.tip_body)] == [40.0, 0.2, 0.0, 0.0]
    whole = {"cm_loc": 0.05, "ixx_tip": 10.0, "iyy_tip": 1.75, "izz_tip": 2.5, "ixy_tip": 1.0}
    table = read_bmodes(main_file(tmp_path / "blade.bmi", tip_mass=40.0, **whole))
    assert table.ignored[2:] == (
        "cm_loc is ignored: the tip mass is on the axis of the beam (in the file 0.05).",
        "ixy_tip is ignored: axes of the tip body are those of the last section (in the file 1).",
    )
    assert eqx.tree_equal(table.rotor().tip_body, jb.TipBody(40.0, 0.0, 10.0, 2.5, 1.75))
    whole["iyy_tip"] = 10.0
    table = read_bmodes(main_file(tmp_path / "blade.bmi", tip_mass=40.0, **whole))
    assert table.rotor().tip_body.flap_inertia is None


def csv_with(*lines, titles=CSV_TITLES):
    def read(folder):
        file = write(folder / "a.csv", "# comment", titles, *lines)
        return read_csv(file, length=61.5, axial_stiffness=EA)

    return read


GOOD = "0,1,2,3,4", "1,1,2,3,4"
BAD_CSV = {
    "fewer entries": (csv_with("0,1,2,3,4", "1,1,2,3"), "line 4: 4 entries for 5 columns"),
    "not a number": (
        csv_with("0,1,2,3,4", "1,1,2,three,4"),
        "line 4, column flap_stiffness_N_m2: not a number, 'three'",
    ),
    "empty": (csv_with("0,1,,3,4", GOOD[1]), "line 3, column mass_per_length_kg_per_m: not a num"),
    "NaN": (
        csv_with("0,nan,2,3,4", GOOD[1]),
        "line 3, column structural_twist_deg: must be finite, got nan",
    ),
    "negative": (
        csv_with("0,1,2,3,-4", GOOD[1]),
        "line 3, column edge_stiffness_N_m2: must be finite and > 0, got -4",
    ),
    "the first of several": (csv_with("0,1,2,3,4", "0.5,x,2,3,4", "0.4,1,0,3,4"), "line 4, column"),
    "degrees for radians": (
        csv_with("0,13.3,2,3,4", GOOD[1], titles=CSV_TITLES.replace("twist_deg", "twist_rad")),
        "line 3, column structural_twist_rad: must be within a turn, got 13.3",
    ),
    "decreasing": (
        csv_with("0,1,2,3,4", "0.5,1,2,3,4", "0.4,1,2,3,4", GOOD[1]),
        "line 5, column x_over_L: stations must not decrease, got 0.4 after 0.5",
    ),
    "three equal": (
        csv_with("0,1,2,3,4", *["0.5,1,2,3,4"] * 3, GOOD[1]),
        "line 6, column x_over_L: more than two stations are equal, at 0.5",
    ),
    "begin": (
        csv_with("0.1,1,2,3,4", GOOD[1]),
        "line 3, column x_over_L: stations must begin at 0",
    ),
    "end": (csv_with(GOOD[0], "0.9,1,2,3,4"), "line 4, column x_over_L: stations must end at 1"),
    "step at the root": (csv_with(GOOD[0], *GOOD), "line 4, column x_over_L: a step must be betw"),
    "step at the tip": (csv_with(*GOOD, GOOD[1]), "line 5, column x_over_L: a step must be betw"),
    "one station": (csv_with(GOOD[0]), "line 3: a table needs two stations or more, there are 1"),
    "no station": (csv_with(), "line 2: a table needs two stations or more, there are 0"),
    "unit of something else": (
        csv_with(*GOOD, titles=CSV_TITLES.replace("flap_stiffness_N_m2", "flap_stiffness_deg")),
        "line 2, column flap_stiffness_deg: its unit must be Nm2, kNm2, MNm2, GNm2, Nmm2, got",
    ),
    "no unit": (
        csv_with(*GOOD, titles=CSV_TITLES.replace("mass_per_length_kg_per_m", "mass_per_length")),
        "line 2, column mass_per_length: its unit must be kg/m, g/m, t/m, got none",
    ),
    "a place in feet": (
        csv_with(*GOOD, titles=CSV_TITLES.replace("x_over_L", "x_ft")),
        "line 2, column x_ft: its unit must be m, cm, mm, got 'ft'",
    ),
    "missing": (
        csv_with(*GOOD, titles="x_over_L,twist_deg,chord,flap_stiffness_N_m2,thickness"),
        "line 2: no column mass_per_length_kg_per_m, in_plane_stiffness_N_m2",
    ),
    "twice": (
        csv_with(*GOOD, titles=CSV_TITLES.replace("flap_", "lag_")),
        "line 2, column edge_stiffness_N_m2: is in_plane_bending_stiffness again, after column lag",
    ),
    "length twice": (
        csv_with(*GOOD, titles=CSV_TITLES.replace("x_over_L", "x_m")),
        "line 2, column x_m: says the length, so none must be given",
    ),
    "no length": (
        lambda folder: read_csv(NREL, axial_stiffness=EA),
        ": length must be given, in m, since the file does not say it",
    ),
    "no axial stiffness": (
        lambda folder: read_csv(NREL, length=61.5),
        "line 2: no column axial_stiffness_N; axial_stiffness may also be given as an argument",
    ),
    "no titles": (lambda folder: read_csv(write(folder / "a.csv", "# nothing")), "no line"),
}


def elastodyn_with(rows=ROWS, **changed):
    def read(folder):
        file = elastodyn(folder / "a.dat", rows, **changed)
        return read_elastodyn(file, length=61.5, axial_stiffness=EA)

    return read


def sections_with(rows=None, count=None):
    return lambda folder: read_bmodes(sections(folder / "a.dat", rows, count), length=61.5)


def main_with(**changed):
    def read(folder):
        sections(folder / "my blade.dat")
        return read_bmodes(main_file(folder / "a.bmi", **changed))

    return read


BAD_OTHERS = {
    "no table": (
        lambda folder: read_elastodyn(write(folder / "a.dat", "BMassDen"), length=1.0),
        ": no line has BlFract among titles",
    ),
    "no factor": (elastodyn_with(AdjBlMs="", NBlInpSt=""), ": no line has NBlInpSt, AdjBlMs"),
    "factor": (
        elastodyn_with(AdjFlSt="-1.0"),
        "line 12, column AdjFlSt: must be finite and > 0, got -1.0",
    ),
    "fewer rows": (elastodyn_with(NBlInpSt=60), "NBlInpSt is 60, but the table ends after 49"),
    "more rows": (
        elastodyn_with(NBlInpSt=48),
        "line 64, column BlFract: stations must end at 1, the tip, got 0.99512",
    ),
    "column": (
        elastodyn_with(titles="BlFract StrcTwst BMassDen FlpStff Chord"),
        "line 15: no column EdgStff",
    ),
    "row": (
        elastodyn_with([*ROWS[:3], "0.1 1 2 3", *ROWS[4:]]),
        "line 20: 4 entries for 5 columns",
    ),
    "value": (
        elastodyn_with([*ROWS[:3], "0.1 1 2 -3 4", *ROWS[4:]]),
        "line 20, column FlpStff: must be finite and > 0, got -3",
    ),
    "no EAStff": (
        lambda folder: read_elastodyn(elastodyn(folder / "a.dat"), length=61.5),
        "line 15: no column EAStff; axial_stiffness may also be given",
    ),
    "n_secs": (sections_with(count="many"), "line 2, column n_secs: not a number, 'many'"),
    "sections missing": (sections_with(count=70), "n_secs is 70, but the table ends after"),
    "section": (
        sections_with([*bmodes_rows()[:1], "0.1 " * 12]),
        "line 7: 12 entries for 13 columns",
    ),
    "section value": (
        sections_with([*bmodes_rows()[:1], "1 0 0 0 0 0 1 1 1 1 0 0 0"]),
        "line 7, column mass_den: must be finite and > 0, got 0",
    ),
    "not sections": (
        lambda folder: read_bmodes(write(folder / "a.dat", "a title"), length=61.5),
        ": no n_secs, titles and units",
    ),
    "no length": (lambda f: read_bmodes(sections(f / "a.dat")), ": length must be given"),
    "tower": (main_with(beam_type=2), "line 6, column beam_type: must be 1, a blade, got 2"),
    "inertia": (main_with(ixx_tip=-1), "column ixx_tip: must be finite and >= 0, got -1"),
    "hinged": (main_with(hub_conn=4), "line 13, column hub_conn: must be 1, a clamped root, got 4"),
    "radius": (main_with(hub_rad=70), "line 9, column radius: must be greater than hub_rad, 70"),
    "precone": (main_with(precone=95), "line 11, column precone: must be within 90 degrees, got"),
    "pitch": (
        main_with(bl_thp=365), "line 12, column bl_thp: must be within 360 degrees, got 365"
    ),
    "no radius": (main_with(radius=""), ": no line has radius behind its value"),
    "length twice": (
        lambda folder: read_bmodes(main_file(folder / "a.bmi"), length=61.5),
        ": a main file says the length, so none must be given",
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("read", "said"),
    [*BAD_CSV.values(), *BAD_OTHERS.values()],
    ids=[*(f"CSV: {name}" for name in BAD_CSV), *BAD_OTHERS],
)
def test_what_is_wrong_is_said_in_a_line(read, said, tmp_path):
    with pytest.raises(ValueError, match=re.escape(said)) as caught:
        read(tmp_path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert message.startswith((str(tmp_path), str(NREL)))


@pytest.mark.parametrize("read", [read_csv, read_elastodyn, read_bmodes])
def test_a_file_that_is_not_there(read, tmp_path):
    with pytest.raises(FileNotFoundError):
        read(tmp_path / "none.dat", length=1.0)


def test_a_section_file_that_is_not_there(tmp_path):
    """The mistake is in the main file: its line is named."""
    said = r"a\.bmi, line 18, column sec_props_file: .*my blade\.dat cannot be read: No such file"
    with pytest.raises(ValueError, match=said):
        read_bmodes(main_file(tmp_path / "a.bmi"))


def test_numbers_as_fortran_writes_them(tmp_path):
    rows = [re.sub("e", "D", row(line)) for line in ROWS]
    file = elastodyn(tmp_path / "blade.dat", [f"{line}  ! a comment" for line in rows])
    same(read_elastodyn(str(file), length=61.5, axial_stiffness=EA).beam, nrel().beam)
