"""Critical speeds: closed forms, the stiffness itself, growth rates, motions in time."""

from pathlib import Path

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxbeam as jb
from tests.beams import ALUMINIUM
from tests.helpers import finite_difference, name, slender
from tests.tiers import exhaustive, slow

DATA = Path(__file__).parents[1] / "data"
SPRINGS = jb.papers.SpringRotor(1.0, 1.0, 1.0, 1e6, 300.0)
REF_21 = jb.Rotor(ALUMINIUM)
# Those that lose their stability: the model, its rotor, the direction that gives way.
FAILING = [
    (jb.Classical(4, 6, 6), slender(hub=0.5, tip=0.3), jb.models.Direction.IN_PLANE),
    (jb.papers.DiscreteLC(), SPRINGS, jb.models.Direction.IN_PLANE),
    exhaustive(jb.papers.ChordANCF(1), REF_21, jb.models.Direction.IN_PLANE),
    exhaustive(jb.papers.TangentANCF(2), REF_21, jb.models.Direction.IN_PLANE),
]
TEARING = [
    (jb.Hybrid(12, 6, 6), slender(hub=0.5, tip=0.3)),
    (jb.papers.DiscreteLP(), SPRINGS),
    exhaustive(jb.VonKarman(10, 5, 0), slender(hub=0.5, tip=0.3)),
    exhaustive(jb.papers.DiscreteNC(), SPRINGS),
    slow(jb.papers.DiscreteNP(), SPRINGS),
    (jb.papers.DiscreteNS(), SPRINGS),
]
STABLE = [
    slow(jb.papers.ANCF(2), slender(hub=0.5, tip=0.3)),
    exhaustive(jb.papers.GreenANCF(2), slender(hub=0.5, tip=0.3)),
    (jb.papers.SmallStrainANCF(4), slender(hub=0.5, tip=0.3)),
    (jb.Hybrid(0, 6, 6), slender(hub=0.5, tip=0.3)),
]
SLOW = (jb.papers.ChordANCF, jb.papers.TangentANCF)  # to compile


def tear(rotor):
    """Closed form: beta tan(beta) = m / m_t, Omega L sqrt(rho / EA) = beta."""
    if isinstance(rotor, jb.papers.SpringRotor):
        return float(np.sqrt(rotor.translational_spring / rotor.mass))
    beam, ratio = rotor.beam, float(rotor.tip_mass / rotor.beam.mass)
    beta = np.pi / 2
    if ratio > 0:
        beta = brentq(lambda b: b * np.sin(b) - np.cos(b) / ratio, 1e-9, np.pi / 2, xtol=1e-15)
    return beta * float(jnp.sqrt(beam.axial_stiffness / beam.mass_per_length) / beam.length)


@pytest.mark.exhaustive
def test_classical_diverges_at_the_first_rest_frequency():
    """In plane, whatever the hub radius: 3.5160 without tip mass, Table 2 of B with."""
    table = np.genfromtxt(
        DATA / "berzeri_1999_table_2.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    printed = {row["N"]: row["omega_exact"] for row in table if row["mode"] == "TRANSV-I"}
    model = jb.Classical(4, 10, 4)
    masses, radii = (jnp.asarray([float(n) for n in printed]), jnp.array([0.0, 0.3, 1.0, 5.0]))

    def both(radius, mass):
        rotor = slender(hub=radius, tip=mass)
        found = jb.critical_speed(model, rotor, throw=False)
        rest = jb.modes(model, rotor, 0.0, jb.labels(in_plane=1), throw=False).frequency[0]
        return found, rest

    found, rest = jax.jit(jax.vmap(jax.vmap(both, (0, None)), (None, 0)))(radii, masses)
    assert (found.status == jb.Status.OK).all()
    assert (found.direction == jb.models.Direction.IN_PLANE).all()
    np.testing.assert_allclose(found.angular_speed, rest, rtol=1e-10)
    np.testing.assert_allclose(found.angular_speed[0], 3.5160152685, rtol=1e-9)  # 1.8751040687^2
    for speeds, value in zip(found.angular_speed, printed.values(), strict=True):
        np.testing.assert_allclose(speeds, value, atol=1e-4)

    def out_of_plane(radius, mass):
        return jb.critical_speed(jb.Classical(0, 0, 6), slender(hub=radius, tip=mass), throw=False)

    never = jax.jit(jax.vmap(jax.vmap(out_of_plane, (0, None)), (None, 0)))(radii, masses)
    assert (never.angular_speed == np.inf).all()


@pytest.mark.parametrize("radius", [0.0, 0.7, 4.0])
def test_lc_diverges_at_the_speed_of_its_hinge(radius):
    rotor = eqx.tree_at(lambda r: r.hub_radius, SPRINGS, jnp.asarray(radius))
    found = jb.critical_speed(jb.papers.DiscreteLC(), rotor)
    assert found.direction == jb.models.Direction.IN_PLANE
    np.testing.assert_allclose(found.angular_speed, np.sqrt(300.0), rtol=1e-14)  # 17.3205


@pytest.mark.parametrize(("model", "rotor"), TEARING, ids=name)
def test_rods_of_constant_stiffness_tear_and_nothing_gives_way_before(model, rotor):
    found = jb.critical_speed(model, rotor)
    assert found.direction == jb.models.Direction.AXIAL
    np.testing.assert_allclose(found.angular_speed, tear(rotor), rtol=1e-9)


@pytest.mark.parametrize(("model", "rotor"), STABLE, ids=name)
def test_hardening_and_inextensible_beams_are_stable(model, rotor):
    """Eigenvalues of their stiffness say the same, over all speeds up to that of tearing."""
    assert jb.critical_speed(model, rotor).angular_speed == np.inf
    speeds = jnp.geomspace(0.3, 1.0, 20) * tear(rotor)
    k = jax.jit(jax.vmap(lambda v: model.linearise(rotor, v, throw=False).stiffness))(speeds)
    assert (np.linalg.eigvalsh(k) > 0).all()


@pytest.mark.parametrize(("model", "rotor", "direction"), FAILING, ids=name)
def test_stiffness_changes_sign_within_a_hundred_millionth(model, rotor, direction):
    """The method fails where theory says it must, and stops failing on the other side."""
    found = jb.critical_speed(model, rotor)
    assert found.direction == direction
    system = jax.jit(lambda v: model.linearise(rotor, v, throw=False))
    scale = jnp.sqrt(jnp.diag(system(0.0).stiffness))

    def negative(speed):
        k = system(speed).stiffness
        return int((np.linalg.eigvalsh(k / scale[:, None] / scale[None]) < 0).sum())

    assert negative(found.angular_speed * (1 - 1e-8)) == 0
    assert negative(found.angular_speed * (1 + 1e-8)) == 1
    np.testing.assert_allclose(jnp.max(jnp.abs(found.shape)), 1.0)
    k = system(found.angular_speed).stiffness
    assert jnp.linalg.norm(k @ found.shape) < 1e-7 * jnp.linalg.norm(k) * np.linalg.norm(
        found.shape
    )


@pytest.mark.exhaustive
def test_model_0_as_b_says():
    """One element fails at 10 rad/s, ten do not; two fail at 40 rad/s (B, Figs. 6 and 7). Always a
    critical speed, that grows with the number of elements; in the tangent frame a lower one, with
    one element that of the classical theory."""

    def critical(model):
        return float(jb.critical_speed(model, REF_21).angular_speed)

    chord = [critical(jb.papers.ChordANCF(n)) for n in (1, 2, 10)]
    tangent = [critical(jb.papers.TangentANCF(n)) for n in (1, 2)]
    assert chord[0] < 10 < chord[1] < 40 < chord[2] < tear(REF_21)
    assert tangent[0] < tangent[1]
    assert all(t < c for t, c in zip(tangent, chord, strict=False))
    one = jb.papers.SmallStrainANCF(1).linearise(REF_21, 0.0)
    rest = np.linalg.eigvals(np.linalg.solve(one.mass[3:, 3:], one.stiffness[3:, 3:]))
    np.testing.assert_allclose(tangent[0], np.sqrt(rest.min()), rtol=1e-9)


@pytest.mark.exhaustive
def test_a_batch_finds_what_single_cases_find():
    """Along hub radii, where the boundary of Model 0 rises steeply before it falls."""

    def critical(radius):
        rotor = slender(70.0, hub=radius)
        return jb.critical_speed(jb.papers.ChordANCF(1), rotor, throw=False).angular_speed

    radii = jnp.linspace(0.0, 1.0, 11)
    together = jax.jit(jax.vmap(critical))(radii)
    np.testing.assert_allclose(together, [critical(r) for r in radii], rtol=1e-9)


PARAMETERS = [  # and whether the rod tears
    exhaustive(jb.Hybrid(8, 3, 0), True),
    exhaustive(jb.Classical(2, 5, 0), False),
    exhaustive(jb.papers.ChordANCF(1), False),
]


@pytest.mark.parametrize(("model", "tears"), PARAMETERS, ids=name)
def test_derivatives_by_every_parameter(model, tears):
    at = jnp.array([8.0, 0.2, 5.0e6, 566.0, 600.0, 0.5, 0.2])

    def critical(p):
        found = jb.critical_speed(model, jb.Rotor(jb.Beam(*p[:5]), p[5], p[6]), throw=False)
        return found.angular_speed

    run = critical if isinstance(model, SLOW) else jax.jit(critical)  # compiled anyhow
    scale, gradient = run(at) / at, jax.jit(jax.jacrev(critical))(at)
    expected = finite_difference(run, at)
    np.testing.assert_allclose(gradient / scale, expected / scale, atol=1e-6)
    assert (abs(gradient[2] / scale[2] - 0.5) < 1e-9) == tears  # the speed of sound in the rod
    if model.directions.count(jb.models.Direction.FLAP) == 0 and not isinstance(model, SLOW):
        np.testing.assert_allclose(jax.jit(jax.jacfwd(critical))(at), gradient, rtol=1e-10)


@pytest.mark.slow
def test_second_derivative():
    """Of sqrt(k_r / m) / L."""

    def critical(m, length, spring):
        rotor = jb.papers.SpringRotor(m, length, 1.0, 1e6, spring)
        return jb.critical_speed(jb.papers.DiscreteLC(), rotor, throw=False).angular_speed

    at = tuple(jnp.asarray(v) for v in (2.0, 0.5, 300.0))
    by_length, by_spring = jax.jit(jax.hessian(critical, (1, 2)))(*at)
    speed = np.sqrt(150.0) / 0.5
    np.testing.assert_allclose(by_length[0], 2 * speed / 0.25, rtol=1e-8)
    np.testing.assert_allclose(by_spring[1], -speed / 4 / 300.0**2, rtol=1e-8)


@pytest.mark.slow
def test_a_bad_case_spoils_no_other():
    def critical(mass):
        return jb.critical_speed(jb.Classical(2, 5, 2), slender(tip=mass), throw=False)

    masses = jnp.array([0.3, jnp.nan, -1.0, 0.7])
    found = jax.jit(jax.vmap(critical))(masses)
    assert found.status.tolist() == [0, jb.Status.INVALID_TIP_MASS, jb.Status.INVALID_TIP_MASS, 0]
    assert np.isnan(found.angular_speed).tolist() == [False, True, True, False]
    for i in (0, 3):
        alone = jax.jit(critical)(masses[i])
        np.testing.assert_allclose(found.angular_speed[i], alone.angular_speed, rtol=1e-13)

    def total(slenderness, masses):
        """By what all share."""

        def one(mass):
            rotor = slender(slenderness, tip=mass)
            return jb.critical_speed(jb.Hybrid(4, 3, 0), rotor, throw=False).angular_speed

        return jnp.nansum(jax.vmap(one)(masses))

    by_all, by_good = (
        jax.jit(jax.grad(total))(80.0, m) for m in (masses, masses[np.array([0, 3])])
    )
    np.testing.assert_allclose(by_all, by_good, rtol=1e-12)


@pytest.mark.slow
def test_units_do_not_matter():
    """A beam of a fifth of a millimetre; a spring of 1e20 N/m."""
    beam = jb.Beam.from_section(
        length=2e-4, youngs_modulus=1.7e11, density=2330.0, area=1e-10,
        in_plane_second_moment=1e-22,
    )  # fmt: skip
    rotor = jb.Rotor(beam)
    np.testing.assert_allclose(
        jb.critical_speed(jb.Hybrid(10, 3, 0), rotor).angular_speed, tear(rotor), rtol=1e-9
    )
    stiff = jb.papers.SpringRotor(1.0, 1.0, 1.0, 1e20, 300.0)
    for model in (jb.papers.DiscreteLP(), jb.papers.DiscreteNS()):
        np.testing.assert_allclose(jb.critical_speed(model, stiff).angular_speed, 1e10, rtol=1e-9)


def test_errors():
    with pytest.raises(TypeError, match="rotor must be a Rotor"):
        jb.critical_speed(jb.Classical(), SPRINGS)
    with pytest.raises(ValueError, match="tip_mass must be finite"):
        jb.critical_speed(jb.Classical(), eqx.tree_at(lambda r: r.tip_mass, slender(), -1.0))


def test_what_overflows_is_not_infinite():
    """Lengths L at which the stiffness, of 1 / L^3, or its ratio to the mass is no number. With the
    parabola alone the square of the speed is 20 EI / (rho L^4)."""

    def critical(length):
        rotor = jb.Rotor(jb.Beam(length, 1.0, 1e4, 1.0, 1.0))
        return jb.critical_speed(jb.Classical(0, 1, 1), rotor, throw=False)

    found = jax.jit(jax.vmap(critical))(jnp.array([10.0, 1e100, 1e300, 1e-300]))
    assert found.status.tolist() == [0, *3 * [jb.Status.NOT_FINITE]]
    np.testing.assert_allclose(found.angular_speed, [np.sqrt(20) / 100, *3 * [np.nan]], rtol=1e-9)


def test_no_flutter():
    """As many modes grow, without oscillating, as the stiffness has negative eigenvalues; with
    damping as well (Kelvin, Tait, Chetaev)."""
    model = jb.Classical(3, 4, 2)

    @jax.jit
    def system(length, slenderness, tip, share):
        rotor = jb.Rotor(jb.Beam.from_slenderness(slenderness), length, tip)
        speed = share * 3.516 * jnp.sqrt(1 / (1 + 4 * tip))
        return model.linearise(rotor, speed, throw=False)

    rng = np.random.default_rng(5)
    counts = set()
    for _ in range(30):
        drawn = rng.uniform([0, 30, 0, 0.5], [2, 300, 2, 12])
        s = system(*(jnp.asarray(v) for v in drawn))
        m, g, k = (np.asarray(a) for a in (s.mass, s.gyroscopic, s.stiffness))
        axial = s.where(jb.models.Direction.AXIAL)
        assert np.linalg.eigvalsh(k[np.ix_(axial, axial)]).min() > 0
        negative = int((np.linalg.eigvalsh(k) < 0).sum())
        counts.add(negative)
        n = len(m)
        for rate in (0.0, 1e-2):
            c = g + rate * (m + 1e-3 * np.abs(np.diag(np.diag(k))))
            low = np.concatenate([-np.linalg.solve(m, k), -np.linalg.solve(m, c)], 1)
            top = np.concatenate([np.zeros((n, n)), np.eye(n)], 1)
            lam = np.linalg.eigvals(np.concatenate([top, low]))
            growing = lam[lam.real > 1e-6 * np.abs(lam).max()]
            assert len(growing) == negative
            assert np.all(np.abs(growing.imag) < 1e-6 * np.abs(lam).max())
    assert {0, 1, 2} <= counts


@pytest.mark.exhaustive
@pytest.mark.parametrize("tip", [0.0, 0.5])
def test_liapunov_function(tip):
    """B eq. 61 is constant to rounding along linearised motions; eq. 56 is positive definite."""
    model, rotor = jb.papers.SmallStrainANCF(1), slender(hub=0.5, tip=tip)

    def stiffness(radius, mass, speed):
        return model.linearise(slender(hub=radius, tip=mass), speed, throw=False).stiffness

    axes = jnp.linspace(0, 5, 6), jnp.linspace(0, 4, 5), jnp.linspace(0, 300, 25)
    mesh = [m.ravel() for m in jnp.meshgrid(*axes)]
    assert (np.linalg.eigvalsh(jax.jit(jax.vmap(stiffness))(*mesh)) > 0).all()
    motion = jb.ConstantSpeed(5.0)
    rest = jb.steady_start(model, rotor, motion)
    rng = np.random.default_rng(0)
    start = jb.solvers.State(
        rest.q + 1e-3 * rng.normal(size=5), 1e-2 * jnp.asarray(rng.normal(size=5))
    )
    system = model.linearise(rotor, 5.0)
    period = 2 * np.pi / float(jb.modes(model, rotor, 5.0, 1).frequency[0])
    run = jb.simulate(
        model, rotor, motion, np.linspace(0, 50 * period, 501), start=start,
        solver=jb.solvers.Magnus(),
        stepsize_controller=diffrax.ConstantStepSize(), dt0=period / 7,
    )  # fmt: skip
    q, v = run.state.q - rest.q[None], run.state.v
    energy = jnp.sum(v * (v @ system.mass) + q * (q @ system.stiffness), 1) / 2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-11)


def test_printed_matrices():
    """B eqs. 57-60, Omega^2 the unit: positive semidefinite; transverse blocks are those of the
    model behind Tables 3-5. Axial ones have the tension once there (B eq. 52 evaluated with q_rb),
    the model has it twice: the mean of them and of -M."""
    printed = {  # upper triangles by rows, times 420, for m = l = 1
        "m l": [20, -19, 0, -1, 0, 24, 0, -5, 0, 24, 0, -5, 6, 0, 6],
        "m R": [42, 0, 0, -7, 0, 252, 0, -42, 0, 252, 0, -42, 14, 0, 14],
        "m_t l": [56, -42, 0, -14, 0, 84, 0, -42, 0, 84, 0, -42, 56, 0, 56],
        "m_t R": [56, -42, 0, -14, 0, 504, 0, -42, 0, 504, 0, -42, 56, 0, 56],
    }
    order = np.ix_(*[[0, 1, 3, 2, 4]] * 2)  # r_x' at the root, r_x, r_y, r_x', r_y' at the tip

    @jax.jit
    def parts(radius, mass):
        systems = [
            jb.papers.SmallStrainANCF(1).linearise(slender(hub=radius, tip=mass), v) for v in (0, 1)
        ]
        return systems[1].stiffness - systems[0].stiffness, systems[0].mass

    def at(radius, mass):
        k, m = (420 * np.asarray(a)[order] for a in parts(float(radius), float(mass)))
        return k, m

    (k00, m0), (k10, _), (k01, m1), (k11, _) = (at(*c) for c in ((0, 0), (1, 0), (0, 1), (1, 1)))
    ours = {"m l": k00, "m R": k10 - k00, "m_t l": k01 - k00, "m_t R": k11 - k10 - k01 + k00}
    masses = {"m l": m0, "m R": 0 * m0, "m_t l": m1 - m0, "m_t R": 0 * m0}
    across, along = np.ix_([2, 4], [2, 4]), np.ix_([0, 1, 3], [0, 1, 3])
    for name_, triangle in printed.items():
        upper = np.zeros((5, 5))
        upper[np.triu_indices(5)] = triangle
        whole = upper + np.triu(upper, 1).T
        assert np.linalg.eigvalsh(whole).min() > -1e-12
        np.testing.assert_allclose(ours[name_][across], whole[across], atol=1e-9)
        once = (ours[name_] - masses[name_]) / 2
        np.testing.assert_allclose(once[along], whole[along], atol=1e-9)


@pytest.mark.exhaustive
def test_rods_in_space_tear_as_any_rod():
    """By degree 12: strains are of order one there, which lower ones do not follow."""
    beam = jb.Beam(5.0, 0.3, 4e6, 500.0, 300.0, torsional_stiffness=300.0)
    found = jb.critical_speed(jb.SpatialRod(12), jb.Rotor(beam, 0.3))
    np.testing.assert_allclose(found.angular_speed, np.pi / 10 * np.sqrt(4e6 / 0.3), rtol=1e-9)


@pytest.mark.slow
def test_what_tension_nearly_holds_wants_more_functions():
    """A root just beyond the axis: the layer at the clamp is a spring (EI P)^1/2, which gives way
    at (2 EI / m)^1/2 / (|R| L). With the default number of functions that would be infinite."""

    def found(model, hub_radius):
        rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e9, 1.0, 1.0), hub_radius)
        return jb.critical_speed(model, rotor, throw=False)

    radii = jnp.array([0.0, -0.1, -0.01, -0.002])
    by_default = jax.jit(jax.vmap(lambda r: found(jb.Hybrid(0), r)))(radii)
    few, fine = jb.Status.TOO_FEW_FUNCTIONS, jb.Status.OK
    np.testing.assert_array_equal(by_default.status, [fine, fine, few, few])
    assert jnp.isinf(by_default.angular_speed[0])
    more = jax.jit(lambda r: found(jb.Hybrid(0, 40, 0), r).angular_speed)(-0.005)
    np.testing.assert_allclose(more, 2**0.5 / 0.005, rtol=1e-2)
