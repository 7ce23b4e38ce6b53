"""Masses at points of a beam, and forces on them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxbeam as jb
from jaxbeam._rotor.loads import loads_in_range
from jaxbeam._simulation.scene import Scene
from tests.beams import short
from tests.references import blade
from tests.tiers import exhaustive

PLACE = 0.37


def with_mass(mass, place=PLACE):
    """A uniform beam of unit length and mass with a mass at a place."""
    points = jb.PointMasses([place], [mass])
    return jb.Beam(1.0, 1.0, 1e6, 1.0, 1.0, point_masses=points)


def exact(mass, place, count):
    """Frequencies at rest: Krylov's functions from the root, with the jump of the shear force where
    the mass is, and neither moment nor shear force at the tip."""

    def krylov(x):  # and those of the derivatives before: K_j' = K_(j - 1)
        s, c, sh, ch = np.sin(x), np.cos(x), np.sinh(x), np.cosh(x)
        return np.array([ch + c, sh + s, ch - c, sh - s]) / 2

    def misfit(b):
        here, whole, rest = krylov(b * place), krylov(b), krylov(b * (1 - place))
        moment, shear = (
            [whole[k - d] + mass * b * here[k] * rest[3 - d] for k in (2, 3)] for d in (2, 3)
        )
        return moment[0] * shear[1] - moment[1] * shear[0]

    places = np.linspace(0.3, 17.0, 2000)
    values = [misfit(b) for b in places]
    ways = zip(places[:-1], places[1:], values[:-1], values[1:], strict=True)
    roots = [brentq(misfit, a, b, xtol=1e-14) for a, b, low, high in ways if low * high < 0]
    return np.square(roots[:count])


def found_with(mass):
    """The first three modes, without an exception for a mass that is none."""
    which = jb.labels(in_plane=3)
    return jb.modes(jb.Hybrid(0, 12, 0), jb.Rotor(with_mass(mass)), 0.0, which, throw=False)


def test_forces_that_balance_one_another_are_seen():
    """Out of the plane they leave neither a sum nor a moment, and are refused there all the same;
    and steps look out for them."""

    @jax.jit
    def seen(forces):
        loads = jb.Loads(point_forces=jb.PointForces([0.25, 0.5, 0.75], forces))
        moments = loads.span_moments(jnp.zeros(()), 2.0)
        none = jnp.zeros(3)
        return moments, loads_in_range(none, none, None, moments)

    for aside in (0.0, 1e-12, 5.0):
        forces = np.array([[0.0, 1.0, aside], [0.0, 1.0, -2 * aside], [0.0, 1.0, aside]])
        moments, (finite, planar) = seen(forces)
        np.testing.assert_allclose(moments[0], [0.0, 3.0, 0.0], atol=1e-9)
        np.testing.assert_allclose(moments[2], [0.0, 3.0, 4 * aside], atol=1e-9)
        assert finite
        assert planar == (aside < 1e-9)


def test_frequencies_with_a_point_mass():
    """Those of a uniform beam with a mass between its ends, within their estimate; one that is out
    of range has a status and leaves its neighbours alone."""
    found = jax.jit(jax.vmap(found_with))(jnp.array([0.2, 5.0, -1.0]))
    assert found.status.tolist() == [jb.Status.OK, jb.Status.OK, jb.Status.INVALID_POINT_MASSES]
    assert np.isnan(found.frequency[2]).all()
    for i, mass in enumerate((0.2, 5.0)):
        off = np.abs(found.frequency[i] / exact(mass, PLACE, 3) - 1)
        assert np.all(off < 2 * found.frequency_error[i] + 1e-11)
        assert off.max() < 1e-7


@pytest.mark.exhaustive
def test_derivatives_by_a_point_mass():
    slope = jax.jit(jax.jacfwd(lambda mass: found_with(mass).frequency))(0.2)
    expected = (exact(0.2 + 1e-4, PLACE, 3) - exact(0.2 - 1e-4, PLACE, 3)) / 2e-4
    np.testing.assert_allclose(slope, expected, rtol=1e-6)


def test_inertia_of_point_masses():
    """Mass and moments of the rigid beam, and tension at the root, are sums."""
    points = jb.PointMasses([0.25, 0.5], [0.3, 0.7])
    rotor = jb.Rotor(short(point_masses=points), hub_radius=0.4, tip_mass=0.1)
    at, masses = np.array([0.9, 1.4, 2.4]), np.array([0.3, 0.7, 0.1])
    own = [1.3 * np.diff(np.array([0.4, 2.4]) ** k)[0] / k for k in (1, 2, 3)]
    expected = [a + masses @ at**k for k, a in enumerate(own)]
    np.testing.assert_allclose(rotor.rigid_moments, expected, rtol=1e-12)
    np.testing.assert_allclose(rotor.beam.mass, expected[0] - 0.1, rtol=1e-12)
    np.testing.assert_allclose(rotor.steady_strain(3.0), 9 * expected[1] / 4e4, rtol=1e-10)
    # The polar inertia of a solid section is that of the beam alone.
    assert rotor.beam.mass_per_length == 1.3


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: jb.PointMasses([0.5, 0.2], [1.0, 1.0]), "places must increase"),
        (lambda: jb.PointMasses([1.0], [1.0]), "places must be between 0 and 1 .* tip_mass"),
        (lambda: jb.PointMasses([0.5], [1.0, 2.0]), "masses must be as many as places, 1"),
        (lambda: jb.PointMasses([0.5], [-1.0]), "point masses must be finite and >= 0"),
        (lambda: jb.PointForces([0.5], [1.0, 2.0, 3.0]), r"forces must have shape \(1, 3\)"),
        (lambda: jb.PointForces([0.5], [[np.inf, 0.0, 0.0]]), "must be finite"),
        (lambda: jb.PointForces([0.5], lambda t: jnp.zeros(3)), r"forces must return .* \(1, 3\)"),
    ],
)
def test_points_that_are_no_points(build, message):
    with pytest.raises(ValueError, match=message):
        build()


MODELS = [jb.VonKarman(5, 3, 2), jb.PlanarRod(2), jb.Hybrid(2, 3, 3)]


@pytest.mark.parametrize("model", [MODELS[-1], *map(exhaustive, MODELS[:-1])])
def test_point_forces_do_virtual_work(model):
    """The generalised force of a force on a point is that by which the point moves with each
    coordinate, in any state."""
    force = np.array([3.0, -2.0, 0.0 if isinstance(model, jb.PlanarRod) else 1.5])
    rotor = jb.Rotor(short(torsional_stiffness=6.0), 0.4)
    forces = jb.PointForces([PLACE], lambda t: t * force[None])
    model, rng = model.suited(rotor), np.random.default_rng(3)
    q, v = (0.05 * rng.normal(size=n) for n in model.sizes)

    @jax.jit
    def both(q, v):
        scenes = [
            Scene(model, rotor, jb.ConstantSpeed(1.5), loads, jb.Damping())
            for loads in (jb.Loads(), jb.Loads(point_forces=forces))
        ]
        t = jnp.asarray(0.7)
        moved = [scene.force(scene.inputs(t), q, v) for scene in scenes]
        equations = scenes[0].equations
        _, back = jax.vjp(lambda q: equations.displacement(q, np.array([PLACE])), q)
        return moved[1] - moved[0], equations.as_force(q, back(t * force[None])[0])

    found, expected = both(jnp.asarray(q), jnp.asarray(v))
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.exhaustive
def test_turning_beams_with_a_point_mass():
    """Against collocation, for which the mass is spread over a thousandth of the span."""
    width, mass = 1e-3, 2.0
    at = [0.0, PLACE - width / 2, PLACE - width / 2, PLACE + width / 2, PLACE + width / 2, 1.0]
    heavy = 1 + mass / width
    reference = blade.Blade(
        mass=(at, [1.0, 1.0, heavy, heavy, 1.0, 1.0]), hub=0.3, tip=blade.Body(0.5)
    )
    rotor = jb.Rotor(with_mass(mass), 0.3, 0.5)
    found = jb.modes(jb.Hybrid(0, 16, 16), rotor, 6.0, jb.labels(in_plane=3, flap=3)).frequency
    expected = [*blade.in_plane(reference, 6.0, 3), *blade.flap(reference, 6.0, 3)]
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    elements = jb.modes(jb.PlanarRod(20), rotor, 6.0, jb.labels(in_plane=3)).frequency
    # Of the steady strain, 1.5e-4, and of the elements, which have no node where the mass is.
    np.testing.assert_allclose(elements, found[:3], rtol=1e-3)


# --- columns -------------------------------------------------------------------------------------


def pushed(model, places, pushes):
    """The critical factor of forces along the beam, in EI / L^2."""
    rotor = jb.Rotor(jb.Beam(2.0, 1.3, 4e5, 11.0, 7.0), 0.4)
    forces = np.stack([pushes, 0 * np.asarray(pushes), 0 * np.asarray(pushes)], 1)
    loads = jb.Loads(point_forces=jb.PointForces(places, forces))
    softest = 7.0 if jb.models.Direction.FLAP in model.directions else 11.0
    return jb.critical_load(model, rotor, loads).factor * 4.0 / softest


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "tolerance"), [(jb.Hybrid(0, 12, 12), 4e-3), (jb.PlanarRod(8), 4e-3)]
)
def test_columns_pushed_at_points(model, tolerance):
    """What is beyond the force is free: Euler's column of length a, pi^2 / (4 a^2). Of two that
    balance one another, x tan x = h / a, h between them, which stands on a spring EI / a."""
    found = pushed(model, [0.3], [-1.0])
    np.testing.assert_allclose(found, np.pi**2 / (4 * 0.3**2), rtol=tolerance)
    x = brentq(lambda x: x * np.tan(x) - 4 / 3, 0.5, 1.5)
    found = pushed(model, [0.3, 0.7], [1.0, -1.0])
    np.testing.assert_allclose(found, (x / 0.4) ** 2, rtol=tolerance)


@pytest.mark.exhaustive
def test_forces_that_only_pull_have_no_critical_factor():
    """Two elements have compression beside the step of the tension, and say so of no load."""
    assert pushed(jb.PlanarRod(2), [0.3, 0.7], [1.0, 1.0]) == np.inf
