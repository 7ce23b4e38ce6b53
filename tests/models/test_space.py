"""Elements in space: their law, and statics against rods solved by collocation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxbeam as jb
from jaxbeam._models.ancf import energies as element_energies
from jaxbeam._models.ancf.exact import Engineering
from jaxbeam._models.space.energies import SpatialElement, SpatialRule
from jaxbeam._models.space.frames import axes, deformation
from jaxbeam._models.space.sections import SpatialSections
from jaxbeam._rotor.loads import TipLoad
from jaxbeam._rotor.motion import Hub, spinning
from tests.beams import TORSION, short
from tests.references.quaternions import rotation
from tests.references.rod import Rod, helix, solved
from tests.tiers import exhaustive, slow

STILL = jb.ConstantSpeed(0.0)
N = 4  # elements of the beam of which the one below is part


def element(turned=True):
    mixed = jnp.asarray(3e-5) if turned else None
    return SpatialElement((jnp.asarray(2e-4), mixed, jnp.asarray(1e-4)), jnp.asarray(5e-5), N)


def bent(seed):
    return jnp.asarray(0.3 * np.random.default_rng(seed).normal(size=13))


def turned(e, rotation):
    """The same element after a rotation of all of it about the root."""
    r = np.asarray(e[:9]).reshape(3, 3) + np.eye(3)[:, :1]
    out = np.array(e)
    out[:9] = (rotation @ r - np.eye(3)[:, :1]).ravel()
    for column, angle in ((0, 9), (2, 11)):
        t = r[:, column] / np.linalg.norm(r[:, column])
        second = rotation @ np.asarray(axes(jnp.asarray(t), e[angle]))[1]
        least = np.asarray(axes(jnp.asarray(rotation @ t), jnp.zeros(())))
        out[angle] = np.arctan2(second @ least[2], second @ least[1])
    return jnp.asarray(out)


@pytest.mark.exhaustive
@pytest.mark.parametrize("is_turned", [True, False])
def test_force_and_tangent_are_derivatives_of_the_energy(is_turned):
    law = element(is_turned)

    @jax.jit
    def both(e):
        given = law.force(e), law.tangent(e)
        return given, (jax.grad(law.energy)(e), jax.hessian(law.energy)(e))

    for seed in range(3):
        for a, b in zip(*both(bent(seed)), strict=True):
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-14 * np.abs(b).max())


@pytest.mark.slow
@pytest.mark.parametrize("is_turned", [True, exhaustive(False)])
def test_viscous_forces_are_those_of_rates_of_strain(is_turned):
    """B^T D B e', and its derivatives, by those of strains."""
    law = element(is_turned)

    def force(e, rate):
        change = jax.jvp(law.strains, (e,), (rate,))[1]
        return jax.vjp(law.strains, e)[1](law.stresses(change))[0]

    @jax.jit
    def both(*state):
        found = law.viscous(*state), *law.viscous_tangents(*state)
        return found, (force(*state), *jax.jacfwd(force, (0, 1))(*state))

    for a, b in zip(*both(bent(0), bent(1)), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-14 * np.abs(b).max())


@pytest.mark.parametrize("seed", range(6))
def test_rigid_rotations_of_any_size_change_strains_by_rounding_only(seed):
    e = bent(seed)
    other = turned(e, Rotation.random(random_state=seed).as_matrix())
    np.testing.assert_allclose(deformation(other, N), deformation(e, N), rtol=0, atol=2e-14)
    np.testing.assert_allclose(element().energy(other), element().energy(e), rtol=1e-13)


@pytest.mark.exhaustive
def test_lanes_are_cases():
    cases = jnp.stack([bent(0), bent(1), 0 * bent(2)], -1)
    for one, many in ((element().force, 1), (element().tangent, 2)):
        found = one(cases)
        for k in range(3):
            np.testing.assert_allclose(
                found[..., k], one(cases[:, k]), rtol=0, atol=1e-17 * 10**many
            )


@pytest.mark.exhaustive
def test_the_undeformed_element_has_finite_derivatives_of_any_order():
    both = jax.jit(lambda e: (element().tangent(e), jax.jacfwd(element().tangent)(e)))
    for value in both(jnp.zeros(13)):
        assert np.isfinite(value).all()


@pytest.mark.slow
def test_in_a_plane_it_is_the_planar_element_but_for_the_number_of_points():
    h, s = 1 / N, element_energies.POINTS
    none = np.zeros((s.size, 3))
    weights, slopes = h * element_energies.WEIGHTS, element_energies.along_element(s)
    rule = SpatialRule(
        weights, slopes, element_energies.along_element(s, 1) / h, none, none, weights, slopes
    )
    d = 0.2 * np.random.default_rng(5).normal(size=(2, 3))
    e = np.zeros(13)
    e[:9] = np.stack([d[1], d[0], 0 * d[0]]).ravel()
    stiff = jnp.asarray(2e-4), None, jnp.asarray(1.0)
    law, e = SpatialElement(stiff, jnp.asarray(1.0), N, part=rule), jnp.asarray(e)
    planar = Engineering(jnp.asarray(2e-4), N)
    np.testing.assert_allclose(law.energy(e), planar.energy(jnp.asarray(d)), rtol=1e-14)
    force = np.asarray(law.force(e))[:9].reshape(3, 3)
    np.testing.assert_allclose(force[:2][::-1], planar.force(jnp.asarray(d)), atol=1e-16)
    np.testing.assert_allclose(force[2], 0, atol=1e-17)


def tip(beam, loads, n, **rotor):
    model = jb.SpatialANCF(n)
    rotor = jb.Rotor(beam, **rotor)
    state = jb.steady_start(model, rotor, STILL, loads=loads)
    return np.asarray(model.equations(rotor).tip(state.q))


ROD = Rod(1.0, 1e4, 1.0, 0.4, 0.7, lambda s: 0.3 + 0.5 * s)
BEAM = jb.Beam(
    1.0, 1.0, 1e4, 1.0, 0.4, twist=jb.Spanwise([0, 1], [0.3, 0.8]), torsional_stiffness=0.7
)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("force", "moment", "follows"),
    [
        ((0, 3.0, 2.0), (0.5, 0, 1.0), False),
        ((0, 1.5, -1.0), (1.0, 0.5, 1.0), True),
        ((-1.0, 0.5, 0), (0, 0, 0), True),
    ],
)
def test_loads_at_the_tip_bend_it_as_they_do_a_rod(force, moment, follows):
    """Errors fall with the fourth power of an element's length, of a rod that is twisted; those of
    the attitude of its sections, at nodes and between them, with the third."""
    rod = solved(ROD, force, moment, follows)
    loads, rotor = jb.Loads(tip_force=force, tip_moment=moment, follows=follows), jb.Rotor(BEAM)
    xi, errors = np.array([0.3, 0.5, 0.9, 1.0]), []
    for n in (4, 8):
        q = jb.steady_start(jb.SpatialANCF(n), rotor, STILL, loads=loads).q
        equations = jb.SpatialANCF(n).equations(rotor)
        t = equations.gradient(q, xi) + np.eye(3)[:, :1]
        sections = axes(t / jnp.linalg.norm(t, axis=0, keepdims=True), equations.torsion(q, xi))
        turned = sections - np.moveaxis(rotation(rod(xi)[3:7]), 1, 0)
        errors.append([np.abs(part).max() for part in (
            equations.tip(q) - (rod(1.0)[:3] - [1, 0, 0]), turned
        )])  # fmt: skip
    (coarse, coarsely), (fine, finely) = errors
    assert fine < 3e-4
    assert fine < coarse / 10
    assert finely < 5e-3
    assert finely < coarsely / 6


@pytest.mark.slow
def test_pitch_is_a_twist_of_all_sections():
    rod = ROD._replace(twist=lambda s: 0.6 + 0 * s)
    end = solved(rod, (0, 3.0, 2.0))(1.0)[:3] - [1, 0, 0]
    uniform = jb.Beam(1.0, 1.0, 1e4, 1.0, 0.4, torsional_stiffness=0.7)
    found = tip(uniform, jb.Loads(tip_force=(0, 3.0, 2.0)), 8, pitch=0.6)
    np.testing.assert_allclose(found, end, rtol=0, atol=1e-4)


@pytest.mark.exhaustive
@pytest.mark.parametrize("stations", [[0.0, 0.37, 1.0], [0.0, 0.37, 0.4, 0.61, 1.0]])
def test_slender_beams_with_stations_within_elements_do_not_lock(stations):
    """They bend as far as uniform ones do, that are held by as many points of stretch."""
    axial, force = 1e8, (0, 3.0, 2.0)
    end = solved(Rod(1.0, axial, 1.0, 0.4, 0.7), force)(1.0)[:3] - [1, 0, 0]
    mass, stretch, lag, flap, torsion = (
        jb.Spanwise(stations, np.full(len(stations), value))
        for value in (1.0, axial, 1.0, 0.4, 0.7)
    )
    beam = jb.Beam(1.0, mass, stretch, lag, flap, torsional_stiffness=torsion)
    assert np.abs(tip(beam, jb.Loads(tip_force=force), 4) - end).max() < 3e-4


@pytest.mark.slow
def test_points_of_stretch_have_their_shares_of_the_axial_stiffness():
    """All of it, none less than nothing; of a linear one as the energy of strain has it."""

    def shares(stations, values):
        beam = jb.Beam(1.0, 1.0, jb.Spanwise(stations, values), 1.0, 0.4, torsional_stiffness=0.7)
        sections = SpatialSections(jb.Rotor(beam), 2)
        own = np.asarray(sections.each.law.stretching) * np.array([1, 4, 1]) / 12
        return (own * sections.axial_stiffness).reshape(2, -1, 3).sum(1)

    found = shares([0, 1], [3.0, 1.0])  # EA = 3 - 2 x, int EA N dx
    np.testing.assert_allclose(found, [[1 / 4, 5 / 6, 1 / 6], [1 / 6, 1 / 2, 1 / 12]], rtol=1e-13)
    for values in ([1e-3, 1e-3, 1.0, 1.0], [1.0, 1.0, 1e-3, 1e-3]):
        found = shares([0, 0.25, 0.25, 1], values)
        np.testing.assert_allclose(found.sum(), values[0] / 4 + values[-1] * 3 / 4, rtol=1e-12)
        assert (found > 0).all()


ROUND = jb.Beam(1.0, 1.0, 1e4, 1.0, 1.0, torsional_stiffness=0.7)


@pytest.mark.exhaustive
@pytest.mark.parametrize("moment", [(0, 0, 2 * np.pi), (2.0, 0, 4.0)], ids=["circle", "helix"])
def test_a_moment_rolls_it_into_a_circle_or_a_helix(moment):
    """To 1e-6, with the fourth power of an element's length."""
    end = helix(Rod(1.0, np.inf, 1.0, 1.0, 0.7), moment)
    if moment[0] == 0:
        np.testing.assert_allclose(end, 0, atol=1e-10)
    loads = jb.Loads(tip_moment=moment)
    errors = [np.abs(tip(ROUND, loads, n) - (end - [1, 0, 0])).max() for n in (26, 53)]
    assert errors[1] < 1e-6
    assert errors[1] < errors[0] / 8


@pytest.mark.exhaustive
@pytest.mark.parametrize("follows", [False, slow(True)])
def test_loads_at_the_tip_do_the_work_of_their_force_and_moment(follows):
    """Power, action on the hub and tangent, about a state without symmetry."""
    model = jb.SpatialANCF(2)
    equations = model.equations(jb.Rotor(short(**TORSION)))  # whose length is not one
    # Rates that are not those of the deflection itself: these would not turn about the tangent.
    q, v = jnp.asarray(0.05 * np.random.default_rng(1).normal(size=(2, len(model.directions))))
    hub = spinning(jnp.asarray(0.7))
    load = TipLoad(jnp.array([0.3, 0.5, -0.2]), jnp.array([0.3, -0.4, 0.6]), follows)

    def frame(q):
        d, angle = equations._tip_state(q)
        t = d + jnp.array([1.0, 0, 0])
        return axes(t / jnp.linalg.norm(t), angle)

    now, rate = jax.jvp(frame, (q,), (v,))
    spin = rate.T @ now
    turning = jnp.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    force, moment = equations.tip_action(q, load)
    expected = [now.T @ part if follows else part for part in (load.force, load.moment)]
    np.testing.assert_allclose([force, moment], expected, atol=1e-15)
    power = force @ jax.jvp(equations.tip, (q,), (v,))[1] + moment @ turning
    np.testing.assert_allclose(equations.tip_power(q, v, load), power, rtol=1e-12)
    both = jax.jit(lambda q: (equations.tangents(hub, q, v, load)[0].dense(),
                              -jax.jacfwd(equations.force, 1)(hub, q, v, load)))  # fmt: skip
    given, exact = both(q)
    np.testing.assert_allclose(given, exact, rtol=0, atol=1e-13 * np.abs(exact).max())


@pytest.mark.exhaustive
def test_the_hub_bears_what_acts_at_the_tip():
    """At rest, whatever the shape: -F, and -(M + r x F)."""
    force, moment = jnp.array([0.4, 1.0, 0.5]), jnp.array([0.3, 0.2, -0.5])
    loads, model = jb.Loads(tip_force=force, tip_moment=moment), jb.SpatialANCF(3)
    rotor = jb.Rotor(BEAM, hub_radius=0.2)
    start = jb.steady_start(model, rotor, STILL, loads=loads)
    run = jb.simulate(model, rotor, STILL, [0.0, 0.01], start=start, loads=loads)
    at = run.tip[-1] + jnp.array([1.2, 0, 0])
    np.testing.assert_allclose(run.hub_force[-1], -force, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        run.hub_torque[-1], -(moment + jnp.cross(at, force)), rtol=0, atol=1e-6
    )


def test_what_it_cannot_do_it_says():
    stiff = jb.Beam(1.0, 1.0, 1e4, 1.0, 0.4)
    with pytest.raises(ValueError, match="give torsional_stiffness"):
        jb.SpatialANCF(2).linearise(jb.Rotor(stiff), 1.0)
    rotor = jb.Rotor(BEAM, root_springs=jb.RootSprings(flap=3.0))
    with pytest.raises(ValueError, match=r"take model\.suited"):
        jb.SpatialANCF(2).equations(rotor)
    assert len(jb.SpatialANCF(2).suited(rotor).directions) == 1 + len(jb.SpatialANCF(2).directions)
    with pytest.raises(ValueError, match=r"loads\.tip_moment: PlanarRod has no moment"):
        jb.steady_start(
            jb.PlanarRod(2), jb.Rotor(stiff), STILL, loads=jb.Loads(tip_moment=[0, 0, 1])
        )
    loads = jb.Loads(tip_force=[0, 1, 0], follows=True)
    with pytest.raises(ValueError, match=r"loads\.follows: Hybrid has no load that turns with"):
        jb.simulate(jb.Hybrid(), jb.Rotor(stiff), STILL, [0.0, 1.0], loads=loads)
    with pytest.raises(TypeError, match="follows must be True or False"):
        jb.Loads(tip_force=[0, 1, 0], follows=1)
    with pytest.raises(ValueError, match="tip_moment must have shape"):
        jb.Loads(tip_moment=[0, 1])


@pytest.mark.slow
def test_what_leaves_the_range_of_an_element_is_reported():
    found = jb.steady_start(
        jb.SpatialANCF(2), jb.Rotor(ROUND), STILL, loads=jb.Loads(tip_moment=[0, 0, 6.0]),
        throw=False,
    )  # fmt: skip
    assert np.isnan(found.q).all()
    with pytest.raises(RuntimeError, match="turns or twists by more than a right angle"):
        jb.steady_start(
            jb.SpatialANCF(2), jb.Rotor(ROUND), STILL, loads=jb.Loads(tip_moment=[0, 0, 6.0])
        )


@pytest.mark.exhaustive
def test_hub_axes_are_those_of_loads_in_a_cone():
    """A beam in a cone of 90 degrees with a force along the axis of rotation is stretched."""
    beam = jb.Beam(1.0, 1.0, 10.0, 1.0, 0.4, torsional_stiffness=0.7)
    found = tip(beam, jb.Loads(tip_force=[0, 0, 1.0]), 2, precone=np.pi / 2)
    np.testing.assert_allclose(found, [0, 0, 0.1], atol=1e-12)
    hub = Hub(*jnp.zeros((5, 3)))
    assert jb.SpatialANCF(2).equations(jb.Rotor(beam, precone=0.3)).force(
        hub, jnp.zeros(18), jnp.zeros(18), None
    ).shape == (18,)
