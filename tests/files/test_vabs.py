"""Sections of VABS, one in a file."""

import numpy as np
import pytest

from jaxbeam import blades
from tests.files.made_up import FOLDER, INERTIA, STIFFNESS, is_refused

PATH = FOLDER / "section.K"
TEXT = PATH.read_text()


def test_a_section_of_vabs():
    blade = blades.read_blade(PATH, length=3.0).beam
    assert float(blade.length) == pytest.approx(3.0, rel=1e-14)
    for got, true in ((blade.stiffness_at, STIFFNESS), (blade.inertia_at, INERTIA)):
        size = np.sqrt(np.outer(np.diag(true), np.diag(true)))
        np.testing.assert_allclose(got(np.array([0.7]))[0] / size, true / size, atol=1e-12)


def test_sections_along_an_axis(tmp_path):
    """The second one is drawn with x2 to the trailing edge: its offsets have the other sign."""
    points, twist = [[0, 0, 0], [2, 0, -0.1], [4, 0.1, -0.3]], [0.2, 0.1, 0.0]
    table = blades.read_vabs([PATH] * 3, [0, 0.5, 1], points, twist, x2_angle=np.pi)
    blade = table.beam
    np.testing.assert_array_equal(blade.axis, points)
    np.testing.assert_array_equal(blade.twist, twist)
    away = np.diag([1.0, -1, -1, 1, -1, -1])
    got = np.asarray(blade.stiffness_at(np.array([0.2])))[0]
    np.testing.assert_allclose(got, away @ STIFFNESS @ away, atol=1e-12 * 8e7)
    quarter = blades.read_vabs([PATH] * 3, [0, 0.5, 1], points, twist, x2_angle=np.pi / 2).beam
    got = np.asarray(quarter.inertia_at(np.array([0.2])))[0]
    # The centre of mass at (-0.1, 0.01) of the drawing, whose x2 is a3 and whose x3 is -a2.
    np.testing.assert_allclose([-got[0, 5], got[0, 4]], [60 * -0.01, 60 * -0.1], rtol=1e-12)
    assert table.ignored == ()
    path = tmp_path / "trapeze.K"
    path.write_text(TEXT + "\n Trapeze Effects Related Matrices\n ====\n")
    (told,) = blades.read_blade(path, length=1.0).ignored
    assert told.endswith("trapeze.K: Trapeze matrices are ignored.")


WRONG = {
    "no shear": (
        "Timoshenko Stiffness",
        "Classical Stiffness",
        r"but the classical one alone: let V",
    ),
    "no mass": (" The 6X6 Mass Matrix\n", "\n", r"there is no line The 6X6 Mass Matrix"),
    "a word": ("6.000000000000000e+01", "x", r"line 4, column M11: not a number, 'x'"),
    "a short row": ("6.000000000000000e-01  6.0", "6.0", r"line 4: row 1 of M: 6 .* got 5 entries"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_in_files_of_vabs(what, tmp_path):
    there, instead, said = WRONG[what]
    said = r"section\.K.*" + said
    is_refused(tmp_path / "section.K", TEXT, there, instead, said, length=1.0)


def test_what_is_wrong_with_arguments():
    with pytest.raises(
        ValueError, match=r"a file of VABS, which has no axis: give read_vabs the ax"
    ):
        blades.read_blade(PATH)
    with pytest.raises(ValueError, match=r"paths must be as many as stations, 2, got 1"):
        blades.read_vabs([PATH], [0, 1], 3.0)
    with pytest.raises(TypeError, match=r"paths must be a list"):
        blades.read_vabs(str(PATH), [0, 1], 3.0)
    with pytest.raises(ValueError, match=r"x2_angle must be within a turn"):
        blades.read_vabs([PATH] * 2, [0, 1], 3.0, x2_angle=90.0)
