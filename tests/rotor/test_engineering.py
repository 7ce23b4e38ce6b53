"""Sections from engineering numbers, against sums over fibres and particles, and what centres are
for."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxbeam.blades import Blade, section_inertia, section_stiffness
from tests.files import made_up

CENTRES = {"tension_centre": (-0.08, 0.02), "shear_centre": (-0.02, 0.01)}
STIFF = {
    "axial_stiffness": 8e7, "flap_bending_stiffness": 1e6, "in_plane_bending_stiffness": 5e6,
    "torsional_stiffness": 6e5, "in_plane_shear_stiffness": 1.5e7, "flap_shear_stiffness": 8e6,
    "principal_angle": np.radians(3.0), **CENTRES,
}  # fmt: skip


def principal(y, z, weight):
    """Sum, centre, principal moments about it (of y^2, of z^2), and the angle of their axes."""
    total, centre = weight.sum(), np.array([weight @ y, weight @ z]) / weight.sum()
    y, z = y - centre[0], z - centre[1]
    values, axes = np.linalg.eigh([[weight @ y**2, weight @ (y * z)], [0, weight @ z**2]], "U")
    return total, centre, values[1], values[0], np.arctan2(axes[1, 1], axes[0, 1])


def test_sums_over_fibres_and_particles():
    """Fibres that bear stretch alone, and particles, anywhere in the plane of a section."""
    rng = np.random.default_rng(5)
    y, z = rng.normal(size=40) + 0.3, rng.normal(size=40) - 0.1
    weight = 1 + rng.random(40)
    total, centre, about3, about2, angle = principal(y, z, weight)
    shear, torsion = 1e-9, 1e-9
    stiff = section_stiffness(
        axial_stiffness=total, in_plane_bending_stiffness=about3, flap_bending_stiffness=about2,
        torsional_stiffness=torsion, in_plane_shear_stiffness=shear, flap_shear_stiffness=shear,
        tension_centre=centre, principal_angle=angle,
    )  # fmt: skip
    mass = section_inertia(
        mass_per_length=total, in_plane_inertia=about3, flap_inertia=about2, mass_centre=centre,
        inertia_angle=angle,
    )  # fmt: skip
    arm = np.stack([0 * y, y, z], 1)
    for _ in range(4):
        six = rng.normal(size=6)
        there = six[:3] + np.cross(six[3:], arm)
        np.testing.assert_allclose(six @ mass @ six, weight @ np.sum(there**2, 1), rtol=1e-13)
        np.testing.assert_allclose(six @ stiff @ six, weight @ there[:, 0] ** 2, rtol=1e-8)


def test_a_section_that_is_written_out():
    """By forces of small strains, one after the other, as files' tests have it."""
    one = section_stiffness(**STIFF)
    size = np.sqrt(np.outer(np.diag(made_up.STIFFNESS), np.diag(made_up.STIFFNESS)))
    np.testing.assert_allclose(one / size, made_up.STIFFNESS / size, atol=1e-14)
    several = section_stiffness(**STIFF | {"torsional_stiffness": [6e5, 5e5, 4e5]})
    assert several.shape == (3, 6, 6)
    np.testing.assert_allclose(several[0], one, rtol=1e-14)
    inertia = section_inertia(
        mass_per_length=60.0, in_plane_inertia=2.0, flap_inertia=0.3, mass_centre=(-0.1, 0.01)
    )
    np.testing.assert_allclose(inertia, made_up.INERTIA, atol=1e-14)
    blade = Blade([0, 0.5, 1], several, inertia, 10.0)
    np.testing.assert_allclose(blade.inertia_at(np.array([0.3]))[0], inertia, rtol=1e-14)


def test_what_centres_are_for():
    """Moments do not stretch at the tension centre, tension there does not bend, force across
    through the shear centre does not twist; all strains are those of the stiffness alone."""
    compliance = np.linalg.inv(section_stiffness(**STIFF))
    t, s = (np.array([0.0, *at]) for at in CENTRES.values())
    bent = compliance @ [0, 0, 0, 0, 3.0, -7.0]
    assert abs(bent[0] + np.cross(bent[3:], t)[0]) < 1e-12 * np.abs(bent).max()
    pull = np.array([5.0, 0, 0])
    pulled = compliance @ np.concatenate([pull, np.cross(t, pull)])
    np.testing.assert_allclose(pulled[3:], 0, atol=1e-12 * pulled[0])
    np.testing.assert_allclose(pulled[0], 5.0 / 8e7, rtol=1e-12)
    push = np.array([0, 4.0, -2.0])
    pushed = compliance @ np.concatenate([push, np.cross(s, push)])
    assert abs(pushed[3]) < 1e-12 * np.abs(pushed).max()
    angle = STIFF["principal_angle"]
    axis = np.array([0, np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(axis @ pushed[:3], axis @ push / 1.5e7, rtol=1e-12)
    about = compliance @ np.concatenate([np.zeros(3), 9.0 * axis])
    np.testing.assert_allclose(about[3:], 9.0 / 1e6 * axis, atol=1e-18)


def test_derivatives_are_those_of_the_energy():
    strain = jnp.array([1e-3, 2e-3, -1e-3, 0.02, 0.03, -0.01])

    @jax.jit
    @jax.grad
    def slopes(numbers):
        return strain @ section_stiffness(**STIFF | numbers) @ strain / 2

    by = slopes({"torsional_stiffness": 6e5, "tension_centre": jnp.array([-0.08, 0.02])})
    stretch = 1e-3 + 0.03 * 0.02 - 0.01 * 0.08
    np.testing.assert_allclose(by["torsional_stiffness"], 0.02**2 / 2, rtol=1e-12)
    np.testing.assert_allclose(by["tension_centre"], 8e7 * stretch * np.array([0.01, 0.03]))


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"axial_stiffness": [1.0, -2.0]}, ValueError, r"axial_stiffness .* > 0, got -2\.0"),
        ({"tension_centre": 0.1}, ValueError, r"tension_centre must have shape \(2,\)"),
        ({"shear_centre": [0.1, np.nan]}, ValueError, "shear_centre must be finite"),
        ({"torsional_stiffness": [1, 2], "principal_angle": [0, 0, 0.0]}, ValueError,
         "principal_angle has 3 stations, and torsional_stiffness has 2"),
        ({"flap_shear_stiffness": "stiff"}, TypeError, "flap_shear_stiffness must be real"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told(change, error, message):
    with pytest.raises(error, match=message):
        section_stiffness(**STIFF | change)
