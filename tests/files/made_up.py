"""The blade of `tests/data/sections`, which is there in four formats: numbers of our own, and what
a reader must make of them, from its centres and stiffnesses.

It is 10 m long along a1, with a prebend of 0.3 m against a3, a sweep of 0.15 m against a2 and a
twist of 10 degrees at the root. `expected.json` has six frequencies (Hz) at rest and at 5 rad/s
with a hub radius of 1 m, of the rod in space by a program of another hand.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from jaxbeam import blades

FOLDER = Path(__file__).parents[1] / "data" / "sections"
STATIONS = (0.0, 0.4, 1.0)
# z, and points of the reference axis, and twist in degrees, in axes of a blade.
ALONG = np.array([0.0, 2.5, 5.0, 7.5, 10.0])
AXIS = CubicSpline(
    ALONG,
    np.stack([ALONG, [0, 0, -0.02, -0.06, -0.15], [0, 0, -0.05, -0.15, -0.3]], 1),
)
TWIST = CubicSpline(ALONG, -np.radians([10.0, 6.0, 3.0, 1.0, 0.0]))
MASS = np.array([100.0, 60.0, 20.0])


def lengths(share=400):
    """Length of arc from the root at places along a1, by Gauss's rule in many intervals."""
    along = np.linspace(0, 10, 4 * share + 1)
    node, weight = np.polynomial.legendre.leggauss(5)
    half = np.diff(along) / 2
    speed = np.linalg.norm(AXIS(along[:-1, None] + half[:, None] * (1 + node), 1), axis=-1)
    return along, np.concatenate([[0], np.cumsum(half * (speed @ weight))])


LENGTH = lengths()[1][-1]


def about(centre, along=0.0, second=0.0, third=0.0, torsion=0.0, flap=0.0, plane=0.0, turned=0.0):
    """A section's matrix about the reference point, from what is diagonal at a centre, in axes that
    are turned about the blade: from the forces of small strains, one after the other."""
    cos, sin = np.cos(turned), np.sin(turned)
    c2, c3 = centre
    own = np.array([[1, 0, 0], [0, cos, sin], [0, -sin, cos]])  # rows are the turned axes
    matrix = np.zeros((6, 6))
    for strain in range(6):
        stretch, curve = np.eye(6)[strain, :3], np.eye(6)[strain, 3:]
        at = np.array([0, c2, c3])
        there = own @ (stretch + np.cross(curve, at))
        force = own.T @ ([along, second, third] * there)
        moment = own.T @ ([torsion, flap, plane] * (own @ curve))
        matrix[:, strain] = [*force, *(moment + np.cross(at, force))]
    return matrix


# At the middle station: stretch and bending about the tension centre, shear and torsion about the
# shear centre, principal axes turned by 3 degrees; mass and moments about the centre of mass.
TENSION_CENTRE, TURNED = (-0.08, 0.02), np.radians(3.0)
STIFFNESS = about(TENSION_CENTRE, along=8e7, flap=1e6, plane=5e6, turned=TURNED)
STIFFNESS += about((-0.02, 0.01), second=1.5e7, third=8e6, torsion=6e5, turned=TURNED)
INERTIA = about((-0.1, 0.01), 60.0, 60.0, 60.0, 2.3, 0.3, 2.0)


def is_the_blade(blade, inertia=INERTIA, twist=1e-8):
    """The one above: its axis, twist, length and mass, and the sections of the middle station."""
    along, arc = lengths()
    places = arc[::50] / LENGTH
    points, slopes = blade.axis_at(places)
    np.testing.assert_allclose(points, AXIS(along[::50]), atol=1e-8)
    tangents = AXIS(along[::50], 1)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    np.testing.assert_allclose(slopes / LENGTH, tangents, atol=1e-6)
    np.testing.assert_allclose(blade.twist_at(places), TWIST(along[::50]), atol=twist)
    np.testing.assert_allclose(float(blade.length), LENGTH, rtol=1e-10)
    np.testing.assert_allclose(float(blade.mass), np.trapezoid(MASS, STATIONS) * LENGTH, rtol=1e-8)
    np.testing.assert_allclose(blade.stations, STATIONS, rtol=1e-12)
    middle = np.array([0.4])
    for got, true in (
        (blade.stiffness_at(middle)[0], STIFFNESS),
        (blade.inertia_at(middle)[0], inertia),
    ):
        size = np.sqrt(np.outer(np.diag(true), np.diag(true)))
        np.testing.assert_allclose(got / size, true / size, atol=1e-12)


def are_the_same(blade, other, tolerance=1e-12):
    """Two blades, by all that they hold: lengths by that of the axis, matrices by their largest."""
    assert len(blade.axis_stations) == len(other.axis_stations)
    size = np.max(np.abs(blade.axis))
    for mine, theirs, scale in (
        (blade.stations, other.stations, 1.0),
        (blade.axis_stations, other.axis_stations, 1.0),
        (blade.kinks, other.kinks, 1.0),
        (blade.axis, other.axis, size),
        (blade.twist, other.twist, 1.0),
    ):
        np.testing.assert_allclose(np.divide(mine, scale), np.divide(theirs, scale), atol=tolerance)
    for mine, theirs in ((blade.stiffness, other.stiffness), (blade.inertia, other.inertia)):
        size = np.max(np.abs(mine), axis=1, keepdims=True)
        np.testing.assert_allclose(mine / size, theirs / size, atol=tolerance)


def is_refused(file, text, there, instead, said, **arguments):
    """A file, of a text that is changed in one place, is not read, and the error says so."""
    assert there in text
    file.write_text(text.replace(there, instead, 1))
    with pytest.raises(ValueError, match=said):
        blades.read_blade(file, **arguments)
