"""What a straight beam leaves out of a blade, against blades that are built without it."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam.blades import Blade, reduction, section_inertia, section_stiffness

LENGTH = 10.0
SHEAR = {"in_plane_shear_stiffness": 1.5e7, "flap_shear_stiffness": 8e6}
CENTRES = {"tension_centre": (-0.08, 0.02), "shear_centre": (-0.02, 0.01)}
STIFF = {
    "axial_stiffness": 8e7, "in_plane_bending_stiffness": 5e6, "flap_bending_stiffness": 1e6,
    "torsional_stiffness": 6e5, "principal_angle": 0.05,
}  # fmt: skip
MASS = {"mass_per_length": 60.0, "in_plane_inertia": 2.0, "flap_inertia": 0.3}
MASS_CENTRE = (-0.1, 0.01)


def sections(shear=1.0, offsets=True, couplings=True):
    """Stiffness and inertia with so much shear stiffness, and with or without the rest."""
    scaled = {name: shear * value for name, value in SHEAR.items()}
    centred = np.linalg.inv(section_stiffness(**STIFF, **scaled))
    if couplings:  # of torsion with bending, and of stretch with torsion, at the centres
        for row, column, share in ((3, 4, 0.4), (0, 3, -0.3)):
            entry = share * np.sqrt(centred[row, row] * centred[column, column])
            centred[row, column] = centred[column, row] = entry
    if offsets:
        (ty, tz), (sy, sz) = CENTRES.values()
        to_centres = np.eye(6)
        to_centres[0, 4:], to_centres[1, 3], to_centres[2, 3] = (tz, -ty), -sz, sy
        back = np.linalg.inv(to_centres)
        centred = back @ centred @ back.T
    centre = MASS_CENTRE if offsets else (0.0, 0.0)
    inertia = section_inertia(**MASS, mass_centre=centre)
    return np.linalg.inv(centred), np.asarray(inertia)


def frequencies(stiffness, inertia, near):
    """Roots of the determinant of a uniform straight cantilever: small displacements and turns z
    and forces f go along it by z' = C f + (e1's turn), f' = -w^2 M z - (e1's moment)."""
    across = np.zeros((6, 6))
    across[1, 5], across[2, 4] = 1.0, -1.0  # u' = gamma + theta x e1
    size = np.sqrt(np.diag(stiffness))

    def free(w):
        inward = np.block([
            [across, np.linalg.inv(stiffness) * size],
            [-(w**2) * inertia / size[:, None], -(across.T * size) / size[:, None]],
        ])  # fmt: skip
        return np.linalg.det(expm(inward * LENGTH)[6:, 6:])

    return np.array([brentq(free, w * (1 - 1e-4), w * (1 + 1e-4), xtol=1e-13) for w in near])


@pytest.mark.slow
def test_each_thing_left_out():
    """Of a uniform straight blade, whose variants are built again without it."""
    found = reduction(jb.Rotor(Blade([0, 1], *sections(), LENGTH)), 4, rod=SpatialRod(12))
    own = frequencies(*sections(), found.frequency)
    np.testing.assert_allclose(found.frequency, own, rtol=1e-9)
    variants = {
        "couplings": {"couplings": False}, "offsets": {"offsets": False}, "shear": {"shear": 1e6},
    }  # fmt: skip
    for name, change in variants.items():
        told = np.asarray(getattr(found, name))
        true = frequencies(*sections(**change), own * (1 + told)) / own - 1
        # A stiff one stands for no shear: see `BeamSections`.
        np.testing.assert_allclose(told, true, atol=1e-5 if name == "shear" else 1e-8)
        assert np.abs(told).max() > 1e-3
    np.testing.assert_allclose(found.curvature, 0, atol=1e-9)


@pytest.mark.exhaustive
def test_the_curve_of_the_axis_and_the_beam():
    """Of a swept blade the frequencies without its sweep are those of the straight one; those of
    the beam are what modes of it are, on springs, with a mass at the tip, of a step."""
    stiffness, inertia = sections()
    at, factor = [0, 0.5, 0.5, 1], np.array([1.0, 1.0, 0.8, 0.5])[:, None, None]
    arc = 0.3 * np.linspace(0, 1, 21)
    bent = LENGTH / 0.3 * np.stack([np.sin(arc), np.cos(arc) - 1, 0 * arc], 1)
    ends = {"tip_mass": 20.0, "root_springs": jb.RootSprings(1e6, 8e5)}
    rotors = [
        jb.Rotor(Blade(at, factor * stiffness, factor * inertia, axis), **ends)
        for axis in (bent, LENGTH)
    ]
    swept, plain = (reduction(rotor) for rotor in rotors)
    np.testing.assert_allclose(swept.frequency * (1 + swept.curvature), plain.frequency, rtol=1e-7)
    assert np.abs(swept.curvature).max() > 1e-3
    beam = jb.Rotor(rotors[0].beam.beam(), **ends)
    modes = [jb.modes(SpatialRod(), each, 0.0, 3).frequency for each in (rotors[0], beam)]
    np.testing.assert_allclose(swept.frequency, modes[0], rtol=1e-8)
    # What stands for a shear that is rigid costs digits.
    np.testing.assert_allclose(swept.beam, modes[1] / modes[0] - 1, atol=1e-5)


def test_it_is_of_blades_alone():
    beam = jb.Beam(1.0, 1.0, 1e4, 4.0, 1.0, torsional_stiffness=1.0)
    with pytest.raises(TypeError, match=r"rotor\.beam must be a Blade, got Beam"):
        reduction(jb.Rotor(beam))
    blade = Blade([0, 1], *sections(), LENGTH)
    with pytest.raises(TypeError, match="rotor must be a Rotor, got Blade"):
        reduction(blade)
