"""The rod of `references/loaded_rod.py` against closed forms, and `SpatialRod` against it."""

import dataclasses
import functools
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import jv

import jaxbeam as jb
from tests.references import blade as blade_reference
from tests.references.loaded_rod import Rod, eigenvalues, frequencies
from tests.references.rod import lateral_buckling

STIFF = dict(axial=1e12, torsion=1e9)

# --- the reference by itself ---------------------------------------------------------------------


def test_bars_and_cantilevers_at_rest():
    """cos k cosh k = -1 of bending; cot z = z J / (j L) of torsion, j being its inertia."""
    ks = np.array([brentq(lambda k: np.cos(k) + 1 / np.cosh(k), *at) for at in ((1, 2), (4, 5))])
    z = np.array([brentq(lambda z: np.cos(z) - z * np.sin(z), *at) for at in ((0.5, 1), (3, 4))])
    twists = z * np.sqrt(6.0 / 0.03) / 2
    rod = Rod(2.0, 1.3, 4e9, 44.0, 11.0, 6.0, 0.03, tip_mass=0.3, axial_inertia=0.06)
    found = eigenvalues(rod, 24)[:12].imag
    assert np.abs(found[:, None] / twists - 1).min(0).max() < 1e-11
    plain = frequencies(Rod(lag=4.0, **STIFF), 4, 20)
    np.testing.assert_allclose(plain, np.outer(ks**2, [1, 2]).ravel(), rtol=1e-10)


def test_rotating_blades_that_hardly_stretch_or_twist():
    """A second method: flat with turned sections and a body, and coned, to 2e-10 with what stretch
    is left; the cone of `test_coned_values` among them."""
    shape, hub = dict(lag=16.0, speed=6.0, hub=0.2, tip_mass=0.3), 0.2
    body = blade_reference.Body(0.3, 0.1, 0.02, 0.02)
    blade = blade_reference.Blade(lag=16.0, hub=hub, twist=((0, 1), (0.5, -0.3)), pitch=0.2)
    exact = blade_reference.frequencies(replace(blade, tip=body), 6.0, 4)
    turned = Rod(
        **shape, **STIFF, pitch=0.2, twist=lambda x: 0.5 - 0.8 * x, offset=0.1, inertia=0.02
    )
    np.testing.assert_allclose(frequencies(turned, 4, 20), exact, rtol=1e-9)
    blade = blade_reference.Blade(lag=16.0, hub=hub, tip=blade_reference.Body(0.3))
    exact = blade_reference.coned(blade, 6.0, 0.3, 4)
    np.testing.assert_allclose(
        frequencies(Rod(**shape, **STIFF, cone=0.3), 4, 20), exact, rtol=2e-9
    )
    printed = frequencies(Rod(lag=16.0, speed=8.0, cone=float(np.deg2rad(5)), **STIFF), 2, 20)
    np.testing.assert_allclose(printed, (9.2527, 14.4935), rtol=0, atol=5.1e-5)


def test_columns_and_narrow_beams_lose_their_stability_where_they_should():
    """A heavy column under 9 z^2 / 4 EI / L^3 per length, J_-1/3(z) = 0 (Greenhill); a narrow beam
    that is loaded across, under 2 z (EI GJ)^1/2 / L^2, J_-1/4(z) = 0 (Prandtl, Michell); a column
    under a following force (Beck), 20.0509536 EI / L^2, by flutter."""
    weight = 9 / 4 * brentq(lambda z: jv(-1 / 3, z), 1.5, 2.2, xtol=1e-15) ** 2
    across = 2 * np.sqrt(0.3) * brentq(lambda z: jv(-1 / 4, z), 1.8, 2.2, xtol=1e-15)
    for share, grows in ((1 - 1e-7, False), (1 + 1e-7, True)):
        heavy = Rod(lag=2.5, axial=1e12, torsion=0.3, gravity=(-share * weight, 0, 0))
        narrow = Rod(lag=1e9, axial=1e12, torsion=0.3, force=(0, share * across, 0))
        pushed = Rod(lag=1e4, force=(-share * 20.05095361, 0, 0), follows=True, **STIFF)
        for rod in (heavy, narrow, pushed):
            assert (eigenvalues(rod, 16, 2)[:2].real.max() > 1e-5) == grows


@pytest.mark.exhaustive
def test_beams_bend_before_they_buckle_sideways():
    load = lateral_buckling(2.5, 0.3)
    for share, grows in ((1 - 1e-9, False), (1 + 1e-9, True)):
        rod = Rod(lag=2.5, axial=1e12, torsion=0.3, force=(0, share * load, 0))
        assert (eigenvalues(rod, 24)[0].real > 1e-7) == grows


@pytest.mark.exhaustive
def test_what_turns_with_its_loads_vibrates_as_before():
    """At rest, bodies and inertia of twist included; loads that follow turn by themselves."""
    cone = 0.4
    cos, sin = np.cos(cone), np.sin(cone)
    turn = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    rod = Rod(
        axial=50.0, lag=3.0, torsion=0.8, polar=0.02, twist=lambda x: 0.5 - 0.8 * x, tip_mass=0.3,
        offset=0.1, inertia=0.02, axial_inertia=0.01, **LOADS, gravity=(1.0, 2.0, -3.0),
    )  # fmt: skip
    for follows in (False, True):
        rod = replace(rod, follows=follows)
        names = ["gravity"] if follows else ["gravity", "line", "force", "moment"]
        turned = {name: tuple(turn @ getattr(rod, name)) for name in names}
        first, second = (
            eigenvalues(each, 16)[:6] for each in (rod, replace(rod, cone=cone, **turned))
        )
        np.testing.assert_allclose(second, first, rtol=1e-11)


@pytest.mark.exhaustive
def test_a_few_points_are_enough():
    first, second = (eigenvalues(LOADED, n)[:8] for n in (16, 28))
    np.testing.assert_allclose(first, second, rtol=1e-7)
    np.testing.assert_allclose(eigenvalues(LOADED, 24)[:8], second, rtol=1e-12)


# --- rods against it ----------------------------------------------------------------------------

TWIST = 0.5, -0.1  # at root and tip
LOADS = dict(force=(1.0, 2.0, 1.0), moment=(0.5, 1.0, -1.0), line=(0.2, -0.5, 0.8))
BLADE = Rod(
    length=2.0, mass=1.3, axial=4e5, lag=44.0, flap=7.0, torsion=6.0, polar=1e-9,
    twist=lambda x: TWIST[0] + (TWIST[1] - TWIST[0]) * x, pitch=0.2, cone=0.12, hub=0.4, speed=6.0,
    tip_mass=0.3,
)  # fmt: skip
LOADED = replace(BLADE, **LOADS, gravity=(0.0, 0.0, -9.8))
COUNT = 5


@functools.partial(jax.jit, static_argnames=("degree", "body", "follows"))
def _found(given, degree, body, follows):
    beam = jb.Beam(
        *(given[name] for name in ("length", "mass", "axial", "lag", "flap")),
        twist=jb.Spanwise([0, 1], given["twist"]),
        torsional_stiffness=given["torsion"],
        polar_inertia=given["polar"],
    )
    at_tip = (given[name] for name in ("tip_mass", "offset", "inertia", "axial_inertia"))
    rotor = jb.Rotor(
        beam, given["hub"], pitch=given["pitch"], precone=given["cone"],
        **({"tip_body": jb.TipBody(*at_tip)} if body else {"tip_mass": given["tip_mass"]}),
    )  # fmt: skip
    loads = jb.Loads(
        given["gravity"], given["force"], tip_moment=given["moment"], follows=follows,
        force_per_length=list(given["line"]),
    )  # fmt: skip
    found = jb.modes(
        jb.SpatialRod(degree), rotor, given["speed"], COUNT, loads=loads,
        damping=jb.Damping(given["damping"]), throw=False,
    )  # fmt: skip
    return found.eigenvalue, found.status


def by_rods(rod, degree, damping=0.0):
    """The lowest eigenvalues, with so much damping in proportion to mass; programs are compiled by
    `degree`, `follows` and whether there is a body at the tip alone."""
    given = {
        field.name: jnp.asarray(getattr(rod, field.name), float)
        for field in dataclasses.fields(rod)
        if field.name not in ("twist", "follows")
    }
    given["twist"], given["damping"] = jnp.array(TWIST), jnp.asarray(damping)
    body = rod.offset != 0 or rod.inertia != 0
    eigenvalue, status = _found(given, degree, body, rod.follows)
    assert status == jb.Status.OK
    return np.asarray(eigenvalue)


def exactly(rod):
    found = eigenvalues(rod, 28)
    return found[found.imag > 0][:COUNT]


TAME = replace(BLADE, torsion=30.0, speed=4.0)
LESS = dict(force=(0.5, 1.0, 0.5), moment=(0.3, 0.5, -0.5), line=(0.1, -0.3, 0.4))
AT_REST = replace(TAME, speed=0.0, **LESS, gravity=(1.0, 2.0, -3.0))
AT_SPEED = replace(TAME, **LESS, gravity=(0.0, 0.0, -9.8))
BODY = dict(offset=0.15, inertia=0.02, follows=True)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "rod", [BLADE, TAME, AT_REST, AT_SPEED, LOADED, replace(BLADE, **BODY), replace(LOADED, **BODY)]
)
def test_rods_tend_to_the_reference_exponentially(rod):
    """Coned, pitched and twisted blades, turning and at rest, bent far by dead loads, of which the
    moment feeds some modes and damps others, and by loads that follow, with a body."""
    coarse, fine = (np.abs(by_rods(rod, degree) / exactly(rod) - 1).max() for degree in (6, 12))
    assert fine < coarse / 100
    assert fine < 3e-6  # most of it is the shear of a rod, which the reference has not


@pytest.mark.slow
def test_damping_in_proportion_to_mass_moves_squares():
    """At rest, by -a lambda."""
    still, a = replace(AT_REST, polar=0.03), 0.3
    free, damped = (by_rods(still, 6, damping) for damping in (0.0, a))
    np.testing.assert_allclose(damped**2 + a * damped, free**2, rtol=1e-8)


@pytest.mark.exhaustive
def test_a_body_that_spins_about_the_beam_couples_flap_with_torsion():
    """With its axis t at t.phi' + t.Omega: that drives flap out, and joins it with torsion. The
    third frequency would be 7 % higher without."""
    rod = replace(TAME, cone=0.0, axial_inertia=0.05, **BODY)
    np.testing.assert_allclose(by_rods(rod, 12), exactly(rod), rtol=3e-6)
