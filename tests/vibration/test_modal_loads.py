"""Force and moment in sections that go with modes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.beams import SPRINGS, TORSION, short

BEAM = short(4e6)


def test_moments_of_a_cantilever():
    """At rest EI f'': at the root EI (b / L)^2 by the deflection of the tip, b = 1.8751 and so on,
    and nothing at the tip."""
    modes = jb.modes(jb.Hybrid(0, 7, 0), jb.Rotor(BEAM, 0.4), 0.0, 2)
    moments = modes.section_moment([0.0, 1.0], tip=True)
    b = np.array([1.875104068711961, 4.694091132974175])
    np.testing.assert_allclose(np.abs(moments[:, 0, 1]), 11.0 * (b / 2) ** 2, rtol=1e-6)
    np.testing.assert_allclose(moments[:, 1], 0.0, atol=1e-9)


@pytest.mark.exhaustive
def test_shear_of_a_cantilever():
    """At the root s EI (b / L)^3, s = (sinh b - sin b) / (cosh b + cos b)."""
    modes = jb.modes(jb.Hybrid(0, 7, 7), jb.Rotor(BEAM, 0.4), 0.0, jb.labels(in_plane=2, flap=1))
    forces = modes.section_force([0.0, 1.0], tip=True)
    b = np.array([1.875104068711961, 4.694091132974175, 1.875104068711961])
    s = (np.sinh(b) - np.sin(b)) / (np.cosh(b) + np.cos(b))
    right = np.array([11.0, 11.0, 7.0]) * s * (b / 2) ** 3
    np.testing.assert_allclose(np.abs(forces[[0, 1, 2], 0, [1, 1, 2]]), right, rtol=1e-6)
    np.testing.assert_allclose(forces[:, 1], 0.0, atol=1e-9)


@pytest.mark.slow
def test_moments_of_a_rotating_beam_bend_it_as_it_is_bent():
    """Twice integrated over EI, moments are the shape: with the tension on the bent beam, which is
    most of what there is."""
    rotor, (t, weight) = jb.Rotor(BEAM, 0.4, 0.3), np.polynomial.legendre.leggauss(24)
    xi = (1 + t) / 2

    @jax.jit
    def found(speed):
        modes = jb.modes(jb.Hybrid(0, 12, 12), rotor, speed, jb.labels(in_plane=1, flap=2))
        return modes.section_moment(xi, tip=True), modes.displacement(1.0, tip=True)

    moments, tip = found(12.0)
    for k, way, stiff in ((0, 1, 11.0), (1, 2, 7.0), (2, 2, 7.0)):
        bent = weight / 2 * moments[k, :, way].real / stiff
        np.testing.assert_allclose(4 * bent @ (1 - xi), tip[k, 0, way].real, rtol=1e-5)


@pytest.mark.exhaustive
def test_moments_about_a_loaded_state():
    """At rest and turning very slowly they are the same; and those of a planar rod are those of one
    in space."""
    beam = jb.Beam(2.0, 1.3, 4e4, 11.0, 7.0, **TORSION)
    rotor, model = jb.Rotor(beam, 0.4, 0.3), jb.SpatialRod(4)
    loads = jb.Loads(tip_force=[0.0, 2.0, 1.5])

    @jax.jit
    def found(speed):
        modes = jb.modes(model, rotor, speed, 2, loads=loads)
        return modes.section_moment([0.0, 0.4]), modes.section_force([0.0, 0.4]), modes.eigenvalue

    still, slow = found(0.0), found(1e-6)
    for a, b in zip(still, slow, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-4 * np.abs(b).max())
    # A planar rod has the same in its plane.
    flat = jb.modes(jb.PlanarRod(4), rotor, 3.0, jb.labels(in_plane=1))
    full = jb.modes(model, rotor, 3.0, jb.labels(in_plane=1))
    a, b = (np.abs(m.section_moment([0.0, 0.4], tip=True)[0, :, 1]) for m in (flat, full))
    np.testing.assert_allclose(a, b, rtol=3e-3)


def test_what_has_no_sections_says_so():
    modes = jb.modes(jb.papers.DiscreteLC(), SPRINGS, 1.0)
    with pytest.raises(ValueError, match="SpringRotor has none"):
        modes.section_moment(0.5)
    assert jnp.isfinite(modes.frequency).all()
