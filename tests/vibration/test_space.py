"""Small motion of beams in space, and where they lose their stability."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam.models import Direction
from tests.beams import TORSION, short, without_rotary_inertia
from tests.helpers import finite_difference, reverse_mode
from tests.references.rod import lateral_buckling
from tests.tiers import exhaustive, slow

BLADE = short(**TORSION)
ROTOR = jb.Rotor(BLADE, hub_radius=0.4, tip_mass=0.3)
WHICH = jb.labels(in_plane=2, flap=2)


def frequencies(model, rotor, speed, which=WHICH):
    return np.asarray(jb.modes(model, rotor, speed, which).frequency)


@pytest.mark.exhaustive
@pytest.mark.parametrize("speed", [0.0, 6.0])
def test_bending_of_a_straight_beam_is_that_of_the_planar_element_and_of_the_modal_theory(speed):
    """In the plane that of `PlanarRod`; out of it, which takes no part in its steady stretch, that
    of `Hybrid` where stretch is small."""
    rotor = dataclasses.replace(ROTOR, beam=dataclasses.replace(BLADE, polar_inertia=1e-9))
    found = frequencies(jb.SpatialRod(8), rotor, speed)
    strain = float(ROTOR.steady_strain(jnp.asarray(speed)))
    exact = frequencies(jb.Hybrid(12, 14, 14), without_rotary_inertia(ROTOR), speed)
    np.testing.assert_allclose(found, exact, rtol=1e-6 + 2 * strain)
    planar = frequencies(jb.PlanarRod(32), ROTOR, speed, jb.labels(in_plane=2))
    np.testing.assert_allclose(found[:2], planar, rtol=1e-5)


@pytest.mark.exhaustive
def test_torsion_is_that_of_a_bar_with_a_body_at_its_end():
    """cot(l) = l I / (j L): polar inertia j per length, I at the tip, w = l (GJ / j)^1/2 / L."""
    body = {"tip_body": jb.TipBody(0.3, axial_inertia=0.06)}
    for at_end, roots in (
        ({"tip_mass": 0.3}, np.pi / 2 * np.array([1, 3])),
        (body, [0.8603335890193797, 3.4256184594817]),
    ):
        rotor = jb.Rotor(BLADE, hub_radius=0.4, **at_end)
        found = frequencies(jb.SpatialRod(8), rotor, 0.0, jb.labels(torsion=2))
        np.testing.assert_allclose(found, np.array(roots) * np.sqrt(6.0 / 0.03) / 2, rtol=1e-5)


TWISTED = jb.Rotor(
    jb.Beam(
        2.0, 1.3, 4e5, 44.0, 7.0, twist=jb.Spanwise([0, 1], [0.5, -0.1]), torsional_stiffness=60.0,
        polar_inertia=1e-3,
    ),
    hub_radius=0.4, pitch=0.2,
)  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("speed", [0.0, 12.0])
def test_twisted_sections_couple_bending_as_in_the_modal_theory(speed):
    exact = frequencies(jb.Hybrid(12, 14, 14), TWISTED, speed)
    strain = float(TWISTED.steady_strain(jnp.asarray(speed)))
    found = frequencies(jb.SpatialRod(10), TWISTED, speed)
    np.testing.assert_allclose(found, exact, rtol=1e-5 + 2 * strain)


@pytest.mark.exhaustive
def test_a_cone_bends_and_couples_as_in_the_modal_theory():
    """Of a beam that hardly stretches or twists, `coned.py`."""
    beam = jb.Beam(1.0, 1.0, 1e6, 4.0, 1.0, torsional_stiffness=1e3, polar_inertia=1e-5)
    rotor, which = jb.Rotor(beam, hub_radius=0.1, precone=0.09), jb.labels(in_plane=1, flap=2)
    exact = frequencies(jb.Hybrid(0, 14, 14), rotor, 6.0, which)
    np.testing.assert_allclose(frequencies(jb.SpatialRod(10), rotor, 6.0, which), exact, rtol=1e-4)


@pytest.mark.exhaustive
def test_participation_says_what_twists():
    """Of sections whose spin hardly couples torsion with flap, in rotation."""
    rotor = dataclasses.replace(ROTOR, beam=dataclasses.replace(BLADE, polar_inertia=1e-4))
    found = jb.modes(jb.SpatialRod(4), rotor, 3.0, jb.labels(in_plane=1, flap=1, torsion=1))
    np.testing.assert_allclose(found.energy_share, np.eye(4)[[1, 2, 3]], atol=2e-3)


@pytest.mark.exhaustive
def test_gradients_by_all_parameters():
    """Of frequencies in a cone, twisted sections, both modes."""
    model, which = jb.SpatialRod(2), jb.labels(in_plane=1, flap=1, torsion=1)

    def of(x):
        beam = jb.Beam(
            x[0], x[1], 1e3 * x[2], 11 * x[3], 4 * x[4], twist=0.3 * x[5],
            torsional_stiffness=6 * x[6], polar_inertia=0.03 * x[7],
        )  # fmt: skip
        rotor = jb.Rotor(beam, 0.4 * x[8], 0.2 * x[9], precone=0.1 * x[10], pitch=0.1 * x[11])
        return jb.modes(model, rotor, 3.0 * x[12], which).frequency

    x = jnp.ones(13)
    value, jacobian = reverse_mode(of, 3)
    exact = jacobian(x)
    along = np.linspace(0.5, 1.5, 13)
    forward = jax.jit(lambda x: jax.jvp(of, (x,), (along,))[1])(x)
    np.testing.assert_allclose(forward, exact @ along, rtol=1e-6)  # rounding, of stiff shear
    numeric = finite_difference(value, x, 5e-2)
    np.testing.assert_allclose(exact, numeric, rtol=1e-6, atol=2e-6 * np.abs(exact).max())


def narrow(ratio, torsion, axial=1e5):
    return jb.Rotor(jb.Beam(1.0, 1.0, axial, ratio, 1.0, torsional_stiffness=torsion))


ACROSS = jb.Loads(tip_force=[0, 1.0, 0])
ALONG = np.array([-1.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "model",
    [
        exhaustive(jb.SpatialRod(4)),
        slow(jb.PlanarRod(4)),
        slow(jb.Hybrid(0, 6, 0)),
    ],
)
def test_a_column_buckles_under_the_load_of_euler(model):
    """pi^2 EI / 4 L^2 of the softer direction that a model has, less what it is shortened by."""
    softest = 1.0 if Direction.FLAP in model.directions else 2.5
    found = jb.critical_load(model, narrow(2.5, 0.3, 1e6), jb.Loads(tip_force=[-1.0, 0, 0]))
    np.testing.assert_allclose(found.factor, softest * np.pi**2 / 4, rtol=1e-4)
    assert Direction(int(found.direction)) == (
        Direction.FLAP if softest == 1 else Direction.IN_PLANE
    )


def pushed_at_the_tip_and_pulled_along_the_span():
    """Its load, for P = 1, p = 3, L = 2 and EI = 3: EI t'' = f (p s - P) t with t' = 0 at the tip,
    s = 0, and t = 0 at the root, by its power series."""

    def at_the_root(f):
        a = [1.0, 0.0]
        for n in range(120):
            before = a[n - 1] if n else 0.0
            a.append(f / 3 * (3 * before - a[n]) / ((n + 2) * (n + 1)))
        return np.polynomial.polynomial.polyval(2.0, a)

    low, high = 20.0, 40.0
    assert (np.array([at_the_root(f) for f in np.linspace(0.0, low, 50)]) > 0).all()
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if at_the_root(middle) > 0 else (low, middle)
    return low


@pytest.mark.parametrize(
    ("model", "error"),
    [(jb.Hybrid(0, 8, 8), 1e-4), exhaustive(jb.Hybrid(0, 16, 0), 1e-8),
     exhaustive(jb.PlanarRod(16), 2e-4), exhaustive(jb.VonKarman(13, 8, 0), 2e-3)],
)  # fmt: skip
def test_a_column_buckles_beyond_the_range_that_is_searched_at_first(model, error):
    """Where a force along the span pulls, and none but the end is pushed."""
    exact = pushed_at_the_tip_and_pulled_along_the_span()
    np.testing.assert_allclose(exact, 28.551027, rtol=1e-7)  # by scipy, too
    loads = jb.Loads(tip_force=[-1.0, 0, 0], force_per_length=(3.0, 0, 0))
    found = jb.critical_load(model, jb.Rotor(jb.Beam(2.0, 1.0, 1e9, 3.0, 6.0)), loads)
    np.testing.assert_allclose(found.factor, exact, rtol=error)
    assert found.direction == Direction.IN_PLANE


@pytest.mark.parametrize("stiffness", [1.0, 1e6])
def test_a_load_across_a_linear_model_is_refused_with_the_model_to_take(stiffness):
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e9, stiffness, 2 * stiffness))
    for model, loads in (
        (jb.Hybrid(0, 4, 4), jb.Loads(tip_force=[0.0, 1.0, 0.0])),
        (jb.Classical(0, 4, 4), jb.Loads(force_per_length=(-1.0, 0.0, 1.0))),
    ):
        with pytest.raises(ValueError, match=r"loads across .* take SpatialRod"):
            jb.critical_load(model, rotor, loads)
    pull = jb.Loads(tip_force=[1.0, 0.0, 0.0])
    assert jb.critical_load(jb.Hybrid(0, 4, 4), rotor, pull).factor == np.inf


@pytest.mark.exhaustive
def test_the_end_of_a_search_is_not_infinity():
    """A load across is stable up to where it ends; a pull is at any load, also one that outweighs
    a push at some sections, and none does where a push is left."""
    rotor = jb.Rotor(jb.Beam(2.0, 1.0, 1e9, 3.0, 6.0))

    @jax.jit
    @jax.vmap
    def of(tip, along):
        loads = jb.Loads(
            tip_force=jnp.stack([tip[0], tip[1], 0 * tip[0]]), force_per_length=(along, 0.0, 0.0)
        )
        found = jb.critical_load(jb.PlanarRod(4), rotor, loads, throw=False)
        return found.factor, found.status

    tips = jnp.array([[0.0, 1.0], [1.0, 0.0], [0.0, 0.0], [5.0, 0.0], [1.0, 0.0]])
    factor, status = of(tips, jnp.array([0.0, 0.0, 1.0, -2.0, -2.0]))
    assert status.tolist() == [jb.Status.SEARCH_ENDED, 0, 0, 0, 0]
    np.testing.assert_array_equal(factor[:4], [np.nan, np.inf, np.inf, np.inf])
    assert np.isfinite(factor[4])


@pytest.mark.exhaustive
def test_columns_of_any_slenderness_buckle_under_the_load_of_a_rod_that_gets_shorter():
    """P (1 - P / EA) = pi^2 EI / 4 L^2; none is lost where the search comes upon a stiffness that
    is singular but for rounding, at which no equilibrium is found."""
    axial = jnp.geomspace(30.0, 1e6, 200)

    def of(axial):
        rotor = jb.Rotor(jb.Beam(1.0, 1.0, axial, 1.0, 1.0))
        loads = jb.Loads(tip_force=[-1.0, 0, 0])
        found = jb.critical_load(jb.PlanarRod(2), rotor, loads, throw=False)
        return found.factor, found.status

    both = jax.jit(jax.vmap(of))
    factor, status = both(axial)
    assert (status == jb.Status.OK).all()
    exact = axial / 2 * (1 - jnp.sqrt(1 - np.pi**2 / axial))
    np.testing.assert_allclose(factor, exact, rtol=1e-3)  # of two elements
    slope = (both(axial * (1 + 1e-4))[0] / both(axial * (1 - 1e-4))[0] - 1) / 2e-4
    np.testing.assert_allclose(both(axial * (1 + 1e-8))[0] / factor - 1, 1e-8 * slope, atol=1e-11)


@pytest.mark.exhaustive
def test_a_heavy_column_buckles_under_its_weight():
    """7.8373 EI / L^3 per length (Greenhill)."""
    loads = jb.Loads(gravity=[-1.0, 0, 0])
    found = jb.critical_load(jb.SpatialRod(6), narrow(2.5, 0.3, 1e6), loads)
    np.testing.assert_allclose(found.factor, 7.8373474, rtol=3e-5)


@pytest.mark.exhaustive
def test_a_narrow_cantilever_buckles_sideways():
    """4.0126 (EI GJ)^1/2 / L^2 (Prandtl, Michell) in the narrow limit; more where the beam bends
    before it buckles."""
    limit = lateral_buckling(1e6, 0.3) / np.sqrt(0.3)
    np.testing.assert_allclose(limit, 4.012599, rtol=2e-6)
    for ratio in (2.5, 1e3):
        exact = lateral_buckling(ratio, 0.3)
        found = jb.critical_load(jb.SpatialRod(10), narrow(ratio, 0.3), ACROSS)
        np.testing.assert_allclose(found.factor, exact, rtol=2e-4)  # which does not stretch
    found = jb.critical_load(jb.SpatialRod(4), narrow(2.5, 0.3), ACROSS)
    assert Direction(int(found.direction)) in (Direction.FLAP, Direction.TORSION)


@pytest.mark.exhaustive
def test_a_beam_that_is_pushed_aside_comes_back_below_the_critical_load_alone():
    """Bracketed by integration in time: a disturbance stays small 3 % below, and grows above."""
    model, rotor = jb.SpatialRod(4), narrow(2.5, 0.3)
    factor = float(jb.critical_load(model, rotor, ACROSS).factor)
    for share, grows in ((0.97, False), (1.03, True)):
        aside = jb.Loads(tip_force=[0, share * factor, 1e-5])
        start = jb.steady_start(
            model, rotor, jb.ConstantSpeed(0.0), loads=jb.Loads(tip_force=[0, share * factor, 0])
        )
        run = jb.simulate(
            model, rotor, jb.ConstantSpeed(0.0), np.linspace(0, 20.0, 101), start=start, loads=aside
        )
        assert (np.abs(run.tip[:, 2]).max() > 0.02) == grows


@pytest.mark.exhaustive
def test_critical_loads_have_gradients():
    """In both modes, forwards in one direction."""

    def of(x):
        rotor = jb.Rotor(jb.Beam(x[0], 1.0, 1e3 * x[1], 2.5 * x[2], 1.0))
        return jb.critical_load(jb.PlanarRod(2), rotor, jb.Loads(tip_force=x[3] * ALONG)).factor

    x, of = jnp.ones(4), jax.jit(of)
    exact = jax.jit(jax.grad(of))(x)
    np.testing.assert_allclose(exact, finite_difference(of, x), rtol=1e-6, atol=1e-6)
    assert (np.abs(exact) > 1e-3).all()
    along = jnp.array([0.7, 1.0, -0.4, 0.2])
    forward = jax.jit(lambda x: jax.jvp(of, (x,), (along,))[1])(x)
    np.testing.assert_allclose(forward, exact @ along, rtol=1e-9)


@pytest.mark.exhaustive
def test_cases_of_a_batch_of_critical_loads_do_not_spoil_one_another():
    """The second pulls and never buckles, the third has no stiffness in torsion."""
    force = jnp.array([[-1.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0]])
    torsion = jnp.array([0.3, 0.3, -1.0])
    of = functools.partial(jb.critical_load, jb.SpatialRod(4), throw=False)
    found = jax.vmap(lambda f, t: of(narrow(2.5, t), jb.Loads(tip_force=f)))(force, torsion)
    assert list(map(jb.Status, found.status.tolist())) == [
        jb.Status.OK, jb.Status.OK, jb.Status.INVALID_TORSIONAL_STIFFNESS
    ]  # fmt: skip
    np.testing.assert_allclose(found.factor[0], np.pi**2 / 4, rtol=1e-3)
    assert np.isinf(found.factor[1])
    assert np.isnan(found.factor[2])


def test_loads_that_buckle_nothing_are_refused():
    rotor = narrow(2.5, 0.3)
    for loads, said in (
        (jb.Loads(tip_force=lambda t: jnp.array([0, 1.0, 0])), "must be constant"),
        (jb.Loads(), "there are none"),
    ):
        with pytest.raises(ValueError, match=said):
            jb.critical_load(jb.SpatialRod(2), rotor, loads)
    with pytest.raises(TypeError, match="loads must be of class Loads"):
        jb.critical_load(jb.SpatialRod(2), rotor, 3.0)
