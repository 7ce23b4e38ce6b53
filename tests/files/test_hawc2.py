"""Files of HAWC2: what they say, and the traps in them."""

import re
import warnings

import numpy as np
import pytest

from jaxbeam import blades
from jaxbeam._rotor.blade import Blade
from jaxbeam._rotor.sections import frames
from tests.files.made_up import (
    FOLDER,
    INERTIA,
    TENSION_CENTRE,
    TURNED,
    TWIST,
    about,
    are_the_same,
    is_the_blade,
)

MAIN = (FOLDER / "blade_hawc2.htc").read_text()
SECTIONS = (FOLDER / "blade_hawc2_st.dat").read_text()


def reading(folder, main=MAIN, sections=SECTIONS, **given):
    (folder / "blade_hawc2_st.dat").write_text(sections)
    (folder / "b.htc").write_text(main)
    return blades.read_hawc2(folder / "b.htc", **given).beam


def test_a_blade_of_hawc2():
    """The file has no product of inertia about axes that are turned by 3 and 5 degrees. Its twist
    is seen along z, not about the axis."""
    with pytest.warns(UserWarning, match=r"st\.dat, line 8: ri_x and ri_y are read as .* by 5\.6"):
        blade = blades.read_blade(FOLDER / "blade_hawc2.htc").beam
    about_centre = about(np.subtract((-0.1, 0.01), TENSION_CENTRE), 60, 60, 60, 2.3, 0.3, 2.0)
    cos, sin = np.cos(TURNED), np.sin(TURNED)
    axes = np.array([[cos, -sin], [sin, cos]])
    product = (axes.T @ about_centre[4:, 4:] @ axes)[0, 1]
    inertia = INERTIA.copy()
    inertia[4:, 4:] -= axes @ [[0, product], [product, 0]] @ axes.T
    is_the_blade(blade, inertia, twist=4e-3)
    places = np.array([0.0, 0.5, 1.0])
    points, slopes = blade.axis_at(places)
    seen = np.asarray(frames(slopes, blade.twist_at(places)))[:, :, 1]
    angle = np.arctan2(seen[:, 2], seen[:, 1])
    np.testing.assert_allclose(angle[[0, 2]], TWIST(points[:, 0])[[0, 2]], atol=1e-8)
    np.testing.assert_allclose(angle[1], TWIST(points[1, 0]), atol=1e-4)


def test_a_blade_goes_to_hawc2_and_back(tmp_path):
    blade = blades.read_beamdyn(FOLDER / "primary_beamdyn.inp").beam
    blades.write_hawc2(tmp_path / "b.htc", blade)
    again = blades.read_hawc2(tmp_path / "b.htc", gyration_about_mass_centre=False).beam
    are_the_same(blade, again)
    is_the_blade(again)


def test_radii_of_gyration_are_read_in_two_ways(tmp_path):
    """A mass of 2 kg/m at (0.3, 0) of the elastic centre with radii of 0.5 and 0.1 m: about the
    centre of mass the second one is too small to be about the elastic centre."""
    row = "{} 2 0.3 0 0.5 {} 0 0 0 1e6 0 0 0 0 0 1e6 0 0 0 0 1e8 0 0 0 1e5 0 0 1e6 0 1e5"
    st = "1\n#1 own\n$1 2\n{}\n{}\n"
    path = tmp_path / "st.dat"
    for radius, flag, second in (
        (0.4, False, 2 * 0.4**2),
        (0.4, True, 2 * (0.4**2 + 0.3**2)),
        (0.1, True, 2 * (0.1**2 + 0.3**2)),
    ):
        path.write_text(st.format(row.format(0, radius), row.format(7, radius)))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            table = blades.read_hawc2(path, length=7.0, gyration_about_mass_centre=flag)
        inertia = np.asarray(table.beam.inertia_at(np.zeros(1)))[0]
        np.testing.assert_allclose(np.diag(inertia)[4:], [2 * 0.25, second], rtol=1e-12)
        np.testing.assert_allclose(inertia[0, 5], -2 * 0.3, rtol=1e-12)
    with pytest.raises(
        ValueError, match=r"line 4, column ri_x: .* give gyration_about_mass_centre=T"
    ):
        blades.read_hawc2(path, length=7.0, gyration_about_mass_centre=False)
    path.write_text(st.format(row.format(0, 0.4), row.format(7, 0.4)))
    with pytest.warns(
        UserWarning, match=r"line 4: ri_x and ri_y are read as radii .* by 1e\+02 %|5"
    ):
        blades.read_blade(path, length=7.0)


def test_matrices_about_another_point_are_told(tmp_path):
    """The tension centre is 0.2 m from the axis; K33 and K34 say so again."""
    row = "{} 2 0.2 0 0.5 0.4 0 0.2 0 1e6 0 0 0 0 0 1e6 0 0 0 0 1e8 0 -2e7 0 1e5 0 0 5e6 0 1e5"
    path = tmp_path / "st.dat"
    path.write_text(f"1\n#1 own\n$1 2\n{row.format(0)}\n{row.format(7)}\n")
    with pytest.warns(UserWarning, match=r"tension centre at \(x_e, y_e\) from their reference"):
        blades.read_blade(path, length=7.0)


def test_half_chords_on_the_other_side_are_told(tmp_path):
    """A half chord off the axis of pitch along chords that are twisted, and prebend; in the second
    file the twist has the other sign."""
    z = np.linspace(0.0, 60.0, 21)
    twist, along = 14 * (1 - z / 60) ** 2, -0.8 * np.sin(np.pi * (z / 60) ** 0.5)
    y = along * np.tan(np.radians(-twist)) - 2.0 * (z / 60) ** 2
    wide = SECTIONS.replace("1.00092867187742e+01", "6.005e+01")

    def htc(sign):
        rows = zip(along, y, z, -sign * twist, strict=True)
        lines = (
            f"sec {i} {' '.join(map(repr, map(float, row)))};" for i, row in enumerate(rows, 1)
        )
        return re.sub(r"sec 1 .*(?=\s+end c2_def)", "\n".join(lines), MAIN, flags=re.DOTALL)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reading(tmp_path, htc(1), wide, gyration_about_mass_centre=False)
    with pytest.warns(UserWarning, match=r"y of c2_def goes as - x tan\(twist\)"):
        reading(tmp_path, htc(-1), wide, gyration_about_mass_centre=False)


def test_names_begin_in_a_folder_above_and_one_body_is_chosen(tmp_path):
    (tmp_path / "htc" / "case").mkdir(parents=True)
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "st.dat").write_text(SECTIONS)
    tower = MAIN.replace("blade1", "tower")
    blade = MAIN.replace("./blade_hawc2_st.dat", "./data/st.dat")
    path = tmp_path / "htc" / "case" / "a.htc"
    path.write_text(f"begin new_htc_structure;\n{tower}\n{blade}end new_htc_structure;\nexit;\n")
    given = {"gyration_about_mass_centre": False}
    table = blades.read_hawc2(path, **given)
    assert float(table.beam.length) == pytest.approx(10.00928672)
    with pytest.raises(
        ValueError, match=r"0 main bodies with a c2_def are called hub, of tower, bl"
    ):
        blades.read_hawc2(path, body="hub", **given)
    with pytest.raises(ValueError, match=r"line 6, column filename: there is no file"):
        blades.read_hawc2(path, body="tower", **given)


WRONG = {
    "isotropic sections": (
        MAIN,
        "FPM 1",
        "FPM 0",
        r"b\.htc, line 6, column FPM: .*fully populated",
    ),
    "another set": (MAIN, "set 1 1", "set 1 2", r"st\.dat: there is no set #1 with a subset \$2"),
    "no numbers of a set": (MAIN, "set 1 1", "set 1", r"b\.htc, line 7, column set: must be two"),
    "a step back": (MAIN, "0.050000 5.0", "0.050000 2.0", r"line 13, column z: must increase"),
    "a word": (MAIN, "-3.000000;", "deg;", r"b\.htc, line 13, column twist: not a number, 'deg'"),
    "too few": (MAIN, "5.000000 -3.000000;", ";", r"b\.htc, line 13, column sec: a number, x, y"),
    "no axis": (MAIN, "c2_def", "c3_def", r"b\.htc: no main_body has a c2_def"),
    "too many": (SECTIONS, "$1 3", "$1 4", r"st\.dat, line \d+: \$1 is 4, but the table ends aft"),
    "a letter": (SECTIONS, "6.00000000000000e+01", "x", r"st\.dat, line 7, column m: not a number"),
    "stations": (SECTIONS, "4.00371", "40.0371", r"line 8, column r: stations must not decrease"),
    "no mass": (
        SECTIONS,
        "6.00000000000000e+01",
        "0.0",
        r"line 7, column m: must be finite and > 0",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_in_files_of_hawc2(what, tmp_path):
    text, there, instead, said = WRONG[what]
    assert there in text
    changed = text.replace(there, instead)
    given = {"main" if text is MAIN else "sections": changed}
    with pytest.raises(ValueError, match=said):
        reading(tmp_path, gyration_about_mass_centre=True, **given)


def test_sections_alone_have_no_axis():
    with pytest.raises(ValueError, match=r"has no axis: read the htc file.* or give length"):
        blades.read_blade(FOLDER / "blade_hawc2_st.dat")
    with pytest.raises(ValueError, match=r"c2_def says the axis, so no length must be given"):
        blades.read_blade(FOLDER / "blade_hawc2.htc", length=10.0)


def test_inertias_that_hawc2_has_no_numbers_for(tmp_path):
    stiff = [np.diag([1e8, 1e7, 1e7, 1e6, 1e6, 1e6])] * 2
    plane = about((0.1, 0.2), 3.0, 3.0, 3.0, 0.5, 0.3, 0.2)
    for change, at in ((0.01, (3, 3)), (0.01, (3, 4)), (0.01, (0, 1)), (0.01, (1, 5))):
        other = plane.copy()
        other[at] += change
        other[at[::-1]] = other[at]
        blade = Blade([0, 1], stiff, [plane, other], 10.0)
        with pytest.raises(ValueError, match=r"at station 2 it is not that of a plane section"):
            blades.write_hawc2(tmp_path / "b.htc", blade)
    kinked = Blade([0, 1], stiff, [plane] * 2, [[0, 0, 0], [1, 0, 0], [2, 1, 0]], kinks=[0.5])
    with pytest.raises(ValueError, match=r"kinks: a c2_def of HAWC2 has none"):
        blades.write_hawc2(tmp_path / "b.htc", kinked)
