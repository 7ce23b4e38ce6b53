"""Files of BeamDyn: what they say, and say wrongly."""

import dataclasses
import re

import numpy as np
import pytest

from jaxbeam import blades
from jaxbeam._rotor.blade import Blade
from tests.files.made_up import FOLDER, are_the_same, is_refused, is_the_blade

PRIMARY = (FOLDER / "primary_beamdyn.inp").read_text()
SECTIONS = (FOLDER / "blade_beamdyn.inp").read_text()


def test_a_blade_of_beamdyn():
    table = blades.read_blade(FOLDER / "primary_beamdyn.inp")
    is_the_blade(table.beam)
    assert table.damping == (3e-3, 2e-3, 1e-3, 6e-3, 5e-3, 4e-3)
    assert table.ignored == ()
    assert table.rotor(hub_radius=1.0).beam.length == table.beam.length


def test_a_blade_goes_to_beamdyn_and_back(tmp_path):
    table = blades.read_beamdyn(FOLDER / "primary_beamdyn.inp")
    blades.write_beamdyn(tmp_path / "b.dat", table.beam, damping=table.damping)
    again = blades.read_blade(tmp_path / "b.dat")
    are_the_same(table.beam, again.beam)
    assert again.damping == table.damping


def test_kinks_are_where_members_meet(tmp_path):
    """A swept tip of which half is bent by 45 degrees, with a step of its sections there."""
    stiffness = np.diag([1e8, 1e7, 2e7, 1e6, 2e6, 8e6])
    inertia = np.diag([10.0, 10.0, 10.0, 0.3, 0.1, 0.2])
    factors = np.array([1.0, 1.0, 0.5, 0.25])[:, None, None]
    points = [[0, 0, 0], [2, 0, 0], [3, -1, 0]]
    middle = 2 / (2 + np.sqrt(2))
    blade = Blade(
        [0, middle, middle, 1], factors * stiffness, factors * inertia, points, [0.2, 0.1, 0.0],
        [0, middle, 1], [middle],
    )  # fmt: skip
    blades.write_beamdyn(tmp_path / "b.dat", blade)
    table = blades.read_beamdyn(tmp_path / "b.dat")
    are_the_same(blade, table.beam)
    assert table.damping is None
    assert len(table.beam.kinks) == 1
    beyond, _ = table.beam.axis_at(np.array([1 - (1 - middle) / 2]))
    np.testing.assert_allclose(beyond[0], [2.5, -0.5, 0], atol=1e-12)


def test_a_blade_file_alone_has_no_axis(tmp_path):
    path = FOLDER / "blade_beamdyn.inp"
    with pytest.raises(
        ValueError, match=r"has no axis: read the primary file of BeamDyn.* or give"
    ):
        blades.read_blade(path)
    straight = blades.read_blade(path, length=10.0).beam
    assert float(straight.length) == 10.0
    np.testing.assert_array_equal(straight.axis, [[0, 0, 0], [10, 0, 0]])
    np.testing.assert_array_equal(straight.twist, 0)
    with pytest.raises(ValueError, match=r"says the axis, so no length must be given"):
        blades.read_blade(FOLDER / "primary_beamdyn.inp", length=10.0)
    with pytest.raises(ValueError, match=r"which says axial_stiffness: give none"):
        blades.read_blade(FOLDER / "primary_beamdyn.inp", axial_stiffness=1e9)


def test_damping_of_modes_is_not_that_of_the_blade(tmp_path):
    """As blade files of OpenFAST have it since version 5."""
    for kind, damping, ignored in ((0, None, 0), (2, None, 1)):
        text = SECTIONS.replace("1   damp_type", f"{kind}   damp_type")
        text = text.replace(
            "----- DISTRIBUTED", "--- Modal Damping\n1 n_modes\n0.01 zeta\n--- Distributed"
        )
        (tmp_path / "b.inp").write_text(text)
        table = blades.read_blade(tmp_path / "b.inp", length=10.0)
        assert table.damping is damping
        assert len(table.ignored) == ignored


def test_matrices_that_are_not_symmetric_are_told(tmp_path):
    first = "1.000000000000000e+07  9.000000000000000e+06 -1.000000000000000e+05"
    assert first in SECTIONS
    (tmp_path / "b.inp").write_text(SECTIONS.replace(first, first.replace("-1.0", "-1.2"), 1))
    said = (
        r"b\.inp, line 11: the stiffness matrix is not symmetric, -120000 and -100000 in rows 4 a"
    )
    with pytest.warns(UserWarning, match=said):
        beam = blades.read_blade(tmp_path / "b.inp", length=10.0).beam
    np.testing.assert_allclose(beam.stiffness_at(np.zeros(1))[0, 4, 5], -1.1e5 * -1, rtol=1e-12)


def row(number):
    """The words of a line of the blade file, from 1."""
    return SECTIONS.splitlines()[number - 1]


WRONG_SECTIONS = {
    "a row that is short": (
        row(13),
        row(13).rsplit(" ", 1)[0],
        r"line 13: station 1 of 3, row 2 of K: .* got 5 entr",
    ),
    "a row that is long": (
        row(13),
        row(13) + " 1.0",
        r"line 13: station 1 of 3, row 2 of K: 6 numbers .* got 7",
    ),
    "a word": (
        row(12),
        row(12).replace("1.0", "l.0", 1),
        r"line 12, column K11: not a number, 'l\.0",
    ),
    "too few stations": (
        "  3   station_total",
        "  4   station_total",
        r"station 4 of 4: a number is needed, got the end",
    ),
    "a station before": (
        " 0.400000",
        "-0.400000",
        r"line 26, column station: stations must not decrease",
    ),
    "no end": (
        " 1.000000\n",
        " 0.900000\n",
        r"column station: stations must end at 1, the tip, got 0\.9",
    ),
    "a negative stiffness": (
        row(12),
        row(12).replace(" 1.0", "-1.0", 1),
        r"line 11: the stiffness matrix must be positive d",
    ),
    "no mass": (
        row(19),
        row(19).replace(" 1.0", " 0.0", 1),
        r"line 11: the mass matrix must have a mass > 0",
    ),
    "no count": ("station_total ", "stations_total", r"of no known kind"),
}


@pytest.mark.parametrize("what", WRONG_SECTIONS)
def test_what_is_wrong_in_a_blade_file(what, tmp_path):
    there, instead, said = WRONG_SECTIONS[what]
    said = r"b\.inp.*" + said
    is_refused(tmp_path / "b.inp", SECTIONS, there, instead, said, length=10.0)


WRONG_PRIMARY = {
    "a step back": (
        "5.000000  3.0",
        "2.000000  3.0",
        r"line 11, column kp_zr: must increase, got 2 after 2\.5",
    ),
    "a word": (
        "5.000000  3.0",
        "5.000000  x",
        r"line 11, column initial_twist: not a number, 'x00",
    ),
    "another count": (
        "          5   kp_total",
        "          6   kp_total",
        r"line 5, column kp_total: 6 key points, but members ha",
    ),
    "no blade file": (
        '"blade_beamdyn.inp"',
        '"no_such.inp"',
        r"line 17, column BldFile: the blade fi.*no_such\.inp can",
    ),
    "no name of it": ("BldFile", "Blade", r"no line has bldfile behind its value"),
}


@pytest.mark.parametrize("what", WRONG_PRIMARY)
def test_what_is_wrong_in_a_primary_file(what, tmp_path):
    (tmp_path / "blade_beamdyn.inp").write_text(SECTIONS)
    is_refused(tmp_path / "p.inp", PRIMARY, *WRONG_PRIMARY[what])


def test_what_a_writer_does_not_write(tmp_path):
    blade = Blade([0, 1], [np.eye(6)] * 2, [np.eye(6)] * 2, [[0, 0, 0], [1, 0, 0], [0.5, 1, 0]])
    for given, how, said in (
        (blade, {}, "axis: the first coordinate of its points, which BeamDyn has splines over"),
        (None, {}, "blade must be a Blade"),
        (
            dataclasses.replace(blade, gyration=0.1),
            {},
            "gyration: a blade file of BeamDyn has none",
        ),
    ):
        with pytest.raises((ValueError, TypeError), match=re.escape(said)):
            blades.write_beamdyn(tmp_path / "b.dat", given, **how)
