"""Files of blades as they come: titles are free, columns have any order, spreadsheets any comma."""

import re

import jax
import numpy as np
import pytest

from jaxbeam import blades
from tests.rotor.files import CSV, DECK, ELASTODYN, SECTIONS, whole


def reading(folder, text, name="blade.txt", sections=SECTIONS, **given):
    (folder / "sec.dat").write_text(sections)
    data = text if isinstance(text, bytes) else text.encode()
    (folder / name).write_bytes(data)
    return blades.read_blade(folder / name, **given)


def is_the_blade(table, twist=True):
    """The one that all files above say."""
    beam = table.beam
    assert float(beam.length) == 50.0
    assert beam.mass_per_length.stations == (0.0, 0.5, 1.0)
    np.testing.assert_allclose(beam.mass_per_length.values, [300, 100, 10], rtol=1e-14)
    np.testing.assert_allclose(beam.flap_bending_stiffness.values, [2e9, 5e8, 1e7], rtol=1e-14)
    np.testing.assert_allclose(beam.in_plane_bending_stiffness.values, [4e9, 1e9, 5e7], rtol=1e-14)
    if twist:
        np.testing.assert_allclose(beam.twist.values, -np.radians([10, 5, 0]), rtol=1e-14)
    else:
        assert beam.twist is None


def is_the_deck(table):
    is_the_blade(table)
    assert (table.hub_radius, table.tip_mass) == (1.5, 100.0)
    assert table.angular_speed == pytest.approx(12.1 * np.pi / 30)


@pytest.mark.parametrize(
    "deck",
    [
        DECK.format(title="a blade"),
        DECK.format(title="61.5 radius blade"),
        DECK.format(title="2 tip_mass options"),
        DECK.format(title="a blade").replace("rot_rpm", "romg").replace("rpm_mult", "romg_mult"),
        DECK.format(title="a blade").replace("12.1 rot_rpm", "1.21D+01 / Rot_RPM"),
        whole(),
        whole("1.03", "romg", "romg_mult"),
        whole(speed="romg", speed_mult="romg_mult"),
        whole(title="61.5 radius", general="61.5 radius of another", tip="2 tip_mass options"),
        whole("1.03", title="2 hub_rad", general="", tip="2 tip_mass options"),
        whole(speed="speed", speed_mult="times").replace("hub_rad", "r").replace("radius:", "R"),
        whole().replace("51.5      radius", "\n\n  51.5 , radius"),
    ],
)
def test_main_files_whose_titles_are_free(deck, tmp_path):
    """What stands in lines of free text is no value, and names are but notes if all lines are
    there."""
    is_the_deck(reading(tmp_path, deck))
    is_the_deck(reading(tmp_path, deck.replace("\n", "\r\n"), "blade.bmi"))


def test_names_that_are_said_twice_are_not_guessed(tmp_path):
    deck = DECK.format(title="a blade").replace("0. precone", "2 tip_mass options\n0. precone")
    with pytest.raises(ValueError, match=r"line 12, column tip_mass: is said again, after line 8"):
        reading(tmp_path, deck)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("", ""),
        ("BlFract StrcTwst BMassDen FlpStff EdgStff", "blfract strctwst bmassden flpstff edgstff"),
        ("{title}", "12 NBlInpSt, said by nobody"),
        ("header\n{title}", "------\n------ FAST INDIVIDUAL BLADE FILE\n12 NBlInpSt blades"),
        ("3 NBlInpSt", "3, NBlInpSt, ! number of stations"),
        ("(deg)", "(-)"),
        ("(-) (deg) (kg/m) (Nm^2) (Nm^2)", ""),
        ("(-) (deg) (kg/m) (Nm^2) (Nm^2)", "- deg kg/m N-m^2 N·m²"),
        ("(kg/m) (Nm^2) (Nm^2)", "(t/m) (kN m^2) [GN m^2]"),
        ("0.5 5.0 100.0 5.0E8 1.0E9", "0.5,5.0,100.0,5.0D8,1.0D+9 station 2 of 3"),
        ("0.5 5.0 100.0 5.0E8 1.0E9", "0.5 5.0\n\n  100.0 .5+9 1.E9 / 7 8"),
    ],
)
def test_columns_and_units_of_elastodyn(old, new, tmp_path):
    text = ELASTODYN.replace(old, new).replace("{title}", "a blade")
    if "(t/m)" in new:
        text = text.replace(" 300.0 2.0E9 4.0E9", " 0.3 2.0E6 4.0").replace("10.0 1.0E7 5.0E7", (
            "1D-2 1.0E4 0.05")).replace("100.0 5.0E8 1.0E9", "0.1 5.0E5 1.0")  # fmt: skip
    is_the_blade(reading(tmp_path, text, length=50.0, axial_stiffness=1e10))


def test_each_factor_of_elastodyn_is_that_of_its_column(tmp_path):
    factors = {"AdjBlMs": 2.0, "AdjFlSt": 3.0, "AdjEdSt": 5.0}
    text = ELASTODYN
    for name, factor in factors.items():
        text = text.replace(f"1 {name}", f"{factor} {name}")
    plain, given = (
        reading(tmp_path, each, length=50.0, axial_stiffness=1e10).beam
        for each in (ELASTODYN, text)
    )
    columns = "mass_per_length", "flap_bending_stiffness", "in_plane_bending_stiffness"
    for column, factor in zip(columns, factors.values(), strict=True):
        found, exact = (getattr(beam, column).values for beam in (given, plain))
        np.testing.assert_allclose(found, factor * exact, rtol=1e-14)


def test_names_in_small_letters_are_used_and_not_ignored(tmp_path):
    small = ELASTODYN.replace("AdjFlSt", "adjflst\n1 flsttunr(1)")
    text = small.replace("{title}", "BlFract BMassDen")
    plain = reading(tmp_path, ELASTODYN, length=50.0, axial_stiffness=1e10)
    small = reading(tmp_path, text, length=50.0, axial_stiffness=1e10)
    is_the_blade(small)
    assert small.ignored == plain.ignored


def test_columns_of_elastodyn_in_another_order(tmp_path):
    """Units stay where they were in some such files: x / L has none, whatever is said."""
    head, rows = ELASTODYN.split("BlFract")[0], np.array(
        [[10, 0, 300, 2e9, 4e9], [5, 0.5, 100, 5e8, 1e9], [0, 1, 10, 1e7, 5e7]]
    )  # fmt: skip
    lines = "\n".join(" ".join(map(str, row)) for row in rows)
    text = f"{head}StrcTwst BlFract BMassDen FlpStff EdgStff\n(-) (deg) (kg/m) (Nm^2) (Nm^2)\n"
    is_the_blade(reading(tmp_path, text + lines, length=50.0, axial_stiffness=1e10))
    turned = rows[:, [4, 3, 2, 1, 0]] / [1e3, 1, 1, 1, 180 / np.pi]
    lines = "\n".join(" ".join(map(repr, row.tolist())) for row in turned)
    text = f"{head}EdgStff FlpStff BMassDen BlFract StrcTwst\n(kNm^2) - (kg/m) - (rad)\n{lines}\n"
    is_the_blade(reading(tmp_path, text, length=50.0, axial_stiffness=1e10))


def test_sections_as_fortran_reads_them(tmp_path):
    """Repeated entries, commas, slashes, notes behind the last, other units."""
    given = {"length": 50.0}
    is_the_blade(reading(tmp_path, SECTIONS, **given))
    other = SECTIONS.replace("1e10 0 0 0", "1e10 3*0.0 ! root").replace("1e9  0 0 0", "1e9,2*0,0/")
    other = other.replace("0.0 10 10 300 1 1", "0.0, 10, 10 300\n  2*1")
    is_the_blade(reading(tmp_path, other, **given))
    units = "(-) (rad) (deg) (g/m) (kg-m) (kg-m) (MNm^2) (Nm^2) (kNm^2) (kN) (m) (m) (m)"
    other = SECTIONS.replace("- - - - - - - - - - - - -", units)
    for old, new in (
        ("10 10 300 1 1 2e9 4e9 1e8 1e10", f"{np.radians(10):.17g} 10 3e5 1 1 2e3 4e9 1e5 1e7"),
        ("5  5 100 1 1 5e8 1e9 1e8 1e9", f"{np.radians(5):.17g} 5 1e5 1 1 5e2 1e9 1e5 1e6"),
        ("10 1 1 1e7 5e7 1e8 1e8", "1e4 1 1 1e1 5e7 1e5 1e5"),
    ):
        other = other.replace(old, new)
    table = reading(tmp_path, other, **given)
    is_the_blade(table)
    np.testing.assert_allclose(table.beam.axial_stiffness.values, [1e10, 1e9, 1e8])
    np.testing.assert_allclose(table.beam.torsional_stiffness.values, 1e8)
    np.testing.assert_allclose(table.beam.polar_inertia.values, 2.0)


@pytest.mark.parametrize(
    ("change", "also"),
    [
        (lambda text: text, ""),
        (lambda text: text.replace(",", ";"), ""),
        (lambda text: text.replace(",", "\t"), ""),
        (lambda text: text.replace(",", ";").replace("0.5", "0,5"), ""),
        (lambda text: "sep=;\n" + text.replace(",", ";").replace("0.5", '"0,5"'), ""),
        (lambda text: text.replace("\n", "\r\n").encode("utf-8-sig"), ""),
        (lambda text: text.replace(",", "\t").replace("\n", "\r\n").encode("utf-16"), ""),
        (lambda text: text.replace("\n", ",,\n") + ",,,,,\n\n ,,\n", ""),
        (lambda text: text.replace("x_over_L", "x/L").replace("\n", "\r"), ""),
        (lambda text: text.replace("x_over_L", '"x / L"'), ""),
        (
            lambda text: text.replace(
                "flap_stiffness_N_m2", '"Flap stiffness\n[N\u00a0m²]"'
            ).encode("cp1252"),
            "",
        ),
        (
            lambda text: text.replace("mass_per_length_kg_per_m", "mass per\u00a0length [g/m]")
            .replace(",300,", ",300\u202f000,").replace(",100,", ",100\u00a0000,")
            .replace(",10,", ",10000,"),
            "",
        ),
    ],
)  # fmt: skip
def test_tables_as_spreadsheets_write_them(change, also, tmp_path):
    is_the_blade(reading(tmp_path, change(CSV), length=50.0, axial_stiffness=1e10), twist=False)


def test_a_table_of_words_is_no_section_file(tmp_path):
    head, *rows = CSV.split()
    words = [line.replace(",", f",{word},", 1) for line, word in zip(rows, "abc", strict=True)]
    text = "\n".join([head.replace(",", ",section,", 1), *words])
    is_the_blade(reading(tmp_path, text, length=50.0, axial_stiffness=1e10), twist=False)


SAID = {
    "a point and a comma": (
        CSV.replace(",", ";").replace("0.5;100", "0.5;1,5"),
        "line 3, column mass_per_length_kg_per_m: 1,5 has a comma, but numbers in line 3 have",
    ),
    "thousands": (CSV.replace("300", '"3,000,00"').replace("0.5", '"0,5"'), "not a number, '3.000"),
    "commas of thousands": (
        CSV.replace("0.5,", "1,").replace("300", '"3,000"'),
        'the comma of "3,000" may be of thousands or a decimal one',
    ),
    "a day": (CSV.replace(",300,", ",10-12,"), "not a number, '10-12'"),
    "a unit of elastodyn": (
        ELASTODYN.replace("(kg/m)", "(slug/ft)"),
        "line 10, column BMassDen: its unit must be kg/m, g/m, t/m, got 'slug/ft'",
    ),
    "too few units": (ELASTODYN.replace("(deg) ", ""), "line 10: 4 units for 5 columns"),
    "a title twice": (ELASTODYN.replace("FlpStff", "EdgStff"), "line 9, column EdgStff: is in_pl"),
    "a decimal comma": (
        ELASTODYN.replace("0.5 5.0 100.0", "0,5 5,0 100,0"),
        "line 12: 8 entries for 5 columns",
    ),
    "a quote": (ELASTODYN.replace(" 100.0 ", " '100.0 "), 'BMassDen: not a number, "\'100.0"'),
    "a fraction": (ELASTODYN.replace(" 100.0 ", " 100/2 "), "BMassDen: not a number, '100/2'"),
    "a comma for a point": (ELASTODYN.replace("4.0E9", "4,E9"), "line 11: 6 entries for 5 columns"),
    "no twist": (ELASTODYN.replace("StrcTwst", "Twist"), "line 9: no column StrcTwst"),
    "half a station": (ELASTODYN.replace("3 NBl", "2.5 NBl"), "line 4, column NBlInpSt: must be a"),
    "an empty entry": (ELASTODYN.replace(" 100.0 ", ",,"), "column BMassDen: not a number, ''"),
    "a count twice": (
        ELASTODYN.replace("3 NBlInpSt", "3 NBlInpSt\n3 nblinpst"),
        "line 5, column NBlInpSt: is said again, after line 4",
    ),
    "a unit of sections": (
        SECTIONS.replace("- - - - - -", "- - - lbm/in - -", 1),
        "line 4, column mass_den: its unit must be kg/m, g/m, t/m, got 'lbm/in'",
    ),
}


@pytest.mark.parametrize(("text", "said"), SAID.values(), ids=SAID)
def test_what_is_not_known_is_said(text, said, tmp_path):
    with pytest.raises(ValueError, match=re.escape(said)) as caught:
        reading(tmp_path, text, length=50.0, axial_stiffness=1e10)
    assert str(caught.value).startswith(str(tmp_path))


def test_a_main_file_that_names_no_section_file(tmp_path):
    deck = DECK.format(title="TITLE").replace("'sec.dat' sec_props_file\n", "")
    with pytest.raises(ValueError, match="no line has sec_props_file behind its value"):
        reading(tmp_path, deck)


def test_what_a_main_file_says_of_a_missing_file(tmp_path):
    deck = DECK.format(title="TITLE").replace("sec.dat", "no_such.dat")
    said = r"blade\.txt, line 12, column sec_props_file: the section file .*no_such\.dat cannot be"
    with pytest.raises(ValueError, match=said):
        reading(tmp_path, deck)


# As the title of a kind says, a file of each in a few lines.
NEIGHBOURS = {
    "an ElastoDyn tower file": "TOWER\nown\n2 NTwInpSt\nHtFract TMassDen TwFAStif TwSSStif\n",
    "an ElastoDyn primary file": 'ED\nown\n63.0 TipRad - (m)\n"a.dat" BldFile(1) - blade\n',
    "an AeroDyn blade file": "AERODYN\nown\n2 NumBlNds\nBlSpn BlCrvAC BlSwpAC BlTwist BlChord\n",
    "an Excel workbook (save it as CSV)": b"PK\x03\x04\x14\x00\x06\x00\x08\x00[Content_Types].xml",
}
FORMATS = blades.BladeFormat


@pytest.mark.parametrize("title", NEIGHBOURS)
def test_files_of_neighbours_are_named(title, tmp_path):
    path, text = tmp_path / "file", NEIGHBOURS[title]
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    for form in (None, FORMATS.CSV, FORMATS.ELASTODYN, FORMATS.BMODES):
        with pytest.raises(ValueError, match=re.escape(f"file is {title}, which is not read; kno")):
            blades.read_blade(path, length=12.0, format=form)


def test_another_format_than_that_of_a_file_is_refused(tmp_path):
    path = tmp_path / "file"
    for text, title, own in (
        (ELASTODYN.format(title="own"), "an ElastoDyn blade file", FORMATS.ELASTODYN),
        (DECK.format(title="own"), "a BModes main file", FORMATS.BMODES),
        (SECTIONS, "a BModes section file", FORMATS.BMODES),
    ):
        path.write_text(text)
        for form in {*FORMATS} - {own, FORMATS.WINDIO}:
            said = f"file is {title}: take read_blade, with {own} or none"
            with pytest.raises(ValueError, match=said):
                blades.read_blade(path, length=12.0, format=form)
    with pytest.raises(TypeError, match=r"format must be a BladeFormat, got 'csv'"):
        blades.read_blade(path, format="csv")


def test_files_without_a_kind_are_refused(tmp_path):
    for text in ("a letter\nof two lines\n", "1,2,3\n4,5,6\n", "{}"):
        with pytest.raises(ValueError, match=r"is of no known kind, .*; known are tables of named"):
            reading(tmp_path, text)


SYNONYMS = {
    "x/L": "BlFract sec_loc span_fraction x_over_L",
    "mass_per_length [kg/m]": "BMassDen(kg/m) mass_den_kg_per_m rhoA[kg*m^-1] linear_mass[t/m]",
    "edge_stiffness [N m^2]": "EdgStff[Nm2] edge_stff(Nm²) EIedge_N_m2 EI_lag[GNm2] lag-EI(N·m^2)",
    "flap_stiffness [N m^2]": "FlpStff(Nm^2) flp_stff_kN_m2 EIflap[N*m**2] EI_flapwise_Nm2",
    "EA [N]": "EAStff[kN] axial_stff_N axial_stiffness(MN) Axial_Rigidity[N]",
    "GJ [Nm2]": "GJStff(Nm^2) tor_stff_N_m2 torsional_stiffness[kNm2] GJ[Nm2/rad] GJ_Nm2",
    "polar_inertia [kg m]": "polar_inertia_kg_m2_per_m torsional_inertia(kgm) polar_inertia[gm]",
}


def test_properties_have_the_names_that_people_use(tmp_path):
    row = [1.0, 20.0, 2e6, 1e6, 1e8, 5e5, 0.4]
    plain = dict(zip(SYNONYMS, row, strict=True))
    units = {"kN": 1e3, "MN": 1e6, "GN": 1e9, "t/": 1e3, "[g": 1e-3}

    def read(titles, numbers):
        lines = [titles, [0.0, *numbers[1:]], numbers]
        text = "\n".join(";".join(map(str, line)) for line in lines)
        return reading(tmp_path, f"# comment\n# another\n{text}", length=12.0)

    wanted = read([*plain], row)
    assert wanted.ignored == ()
    assert float(wanted.beam.torsional_stiffness.values[0]) == 5e5
    for i, (title, others) in enumerate(SYNONYMS.items()):
        for other in others.split():
            factor = next((f for unit, f in units.items() if unit in other), 1.0)
            titles = [other if name == title else name for name in plain]
            found = read(titles, [x / factor if j == i else x for j, x in enumerate(row)])
            assert found.ignored == ()
            same_numbers(found.beam, wanted.beam)
    alone = read([*[*plain][:6], "FlpIner [kg m]"], row)
    assert "a Beam takes their sum" in alone.ignored[0]
    assert alone.beam.polar_inertia is None


def same_numbers(beam, other):
    leaves = (jax.tree.leaves(each) for each in (beam, other))
    for a, b in zip(*leaves, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def test_inertias_of_both_directions_are_the_polar_one(tmp_path):
    text = CSV.replace("\n", ",0.3,0.2,0.0\n").replace(
        ",0.3,0.2,0.0", ",FlpIner_kg_m,edge_iner (kg m),GJ [Nm2]", 1
    )
    found = reading(tmp_path, text, length=50.0, axial_stiffness=1e10)
    np.testing.assert_allclose(found.beam.polar_inertia.values, 0.5)
    assert found.ignored == ()
    assert found.beam.torsional_stiffness is None  # zero at all stations


@pytest.mark.parametrize(
    ("title", "got"),
    [
        ("GJ [deg]", "'deg'"), ("GJ [lbf ft^2]", "'lbfft2'"), ("GJ", "none"), ("GJ []", "none"),
        ("GJ_kip_ft2", "'kipft2'"), ("polar inertia [kg m^2]", "'kgm2'"), ("EA [Nm2]", "'Nm2'"),
        ("twist [1/m]", "'1/m'"), ("tor_stff_N_m", "'Nm'"),
    ],
)  # fmt: skip
def test_units_are_never_ignored(title, got, tmp_path):
    text = CSV.replace("\n", ",1.0\n").replace(",1.0", f",{title}", 1)
    with pytest.raises(ValueError, match=re.escape(f"column {title}: its unit must be ")) as caught:
        reading(tmp_path, text, length=50.0, axial_stiffness=1e10)
    assert str(caught.value).endswith(f"got {got}")


@pytest.mark.parametrize("title", ["EA_offset_m", "x_cg_m", "twist_center", "GJ ratio [-]", "mass"])
def test_names_that_begin_like_others_are_others(title, tmp_path):
    text = CSV.replace("\n", ",1.0\n").replace(",1.0", f",{title}", 1)
    found = reading(tmp_path, text, length=50.0, axial_stiffness=1e10)
    assert found.ignored == (
        f"{title} is ignored: a Beam has nothing of this name (in the file up to 1).",
    )
