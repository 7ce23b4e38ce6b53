"""Matrices of the models, against the papers and against exact kinematics."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.helpers import slender

DIRECTION = jb.models.Direction
MODELS = [
    jb.Hybrid(4, 5, 6),
    jb.Hybrid(4, 5, 0, jb.models.CantileverModes()),
    jb.Hybrid(4, 5, 6, jb.models.Polynomials(2)),
    jb.Classical(4, 5, 6),
    jb.papers.SmallStrainANCF(3),
    jb.papers.ANCF(3),
]
ids = [repr(m) for m in MODELS]
ROTOR = jb.Rotor(jb.Beam(2.0, 0.7, 3e3, 5.0, 8.0), hub_radius=0.4, tip_mass=0.3)


def test_curvature_is_that_of_the_axis_however_far_it_is_bent():
    """Of elements that are laid along half a circle, but for what cubics are off."""
    model = jb.PlanarRod(8)
    equations = model.equations(jb.Rotor(jb.Beam(2.0, 0.7, 3e3, 5.0, 8.0, torsional_stiffness=1.0)))
    xi = np.linspace(0.0, 1.0, 81)
    angle, radius = np.pi * xi, 2.0 / np.pi
    circle = radius * np.stack([np.sin(angle) - angle, 1 - np.cos(angle), 0 * angle], 1)
    linear = jax.jacfwd(lambda q: equations.displacement(q, xi).ravel())
    q = np.linalg.lstsq(linear(jnp.zeros(len(model.directions))), circle.ravel(), rcond=None)[0]
    found = equations.curvature(jnp.asarray(q), xi)
    np.testing.assert_allclose(found[:, 0], 1 / radius, rtol=0.03)
    np.testing.assert_allclose(found[:, 1], 0.0, atol=1e-9)


@pytest.mark.parametrize("model", MODELS, ids=ids)
def test_structure(model):
    system = model.linearise(ROTOR, 1.7)
    m, g, k = system.mass, system.gyroscopic, system.stiffness
    np.testing.assert_allclose(m, m.T, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(g, -g.T)
    np.testing.assert_allclose(k, k.T, atol=1e-12 * float(jnp.abs(k).max()))
    assert np.linalg.eigvalsh(m).min() > 0
    kinds = np.asarray(system.directions)
    other = kinds[:, None] != kinds
    assert not m[other].any()
    assert not k[other].any()
    coupled = {DIRECTION.AXIAL, DIRECTION.IN_PLANE}
    allowed = other & np.array([[{a, b} == coupled for b in kinds] for a in kinds])
    assert not g[~allowed].any()
    opposite = model.linearise(ROTOR, -1.7)
    np.testing.assert_array_equal(opposite.gyroscopic, -g)
    np.testing.assert_array_equal(opposite.stiffness, k)


@pytest.mark.parametrize("model", MODELS, ids=ids)
def test_mass_is_the_kinetic_energy(model):
    """For random motions, against quadrature of the displacement field that the model reports."""
    system = model.linearise(ROTOR, 0.9)
    v = np.random.default_rng(1).normal(size=len(system.directions))
    x, w = np.polynomial.legendre.leggauss(300)
    table = np.asarray(model.displacement((x + 1) / 2, ROTOR))
    at_end = np.asarray(model.displacement(np.ones(1), ROTOR))[:, 0]
    field, end = table @ v, at_end @ v
    expected = 0.7 * np.sum(w * field**2) + 0.3 * np.sum(end**2)  # L / 2 = 1
    np.testing.assert_allclose(v @ system.mass @ v, expected, rtol=1e-6)
    # Coriolis power of velocities a on b: 2 Omega int (a_y b_x - a_x b_y) dm
    u = np.random.default_rng(2).normal(size=v.size)
    other, tip = table @ u, at_end @ u
    cross = other[1] * field[0] - other[0] * field[1]
    expected = 1.8 * (0.7 * np.sum(w * cross) + 0.3 * (tip[1] * end[0] - tip[0] * end[1]))
    np.testing.assert_allclose(u @ system.gyroscopic @ v, expected, rtol=1e-6)


def test_hybrid_minus_classical_is_the_tension():
    hybrid, classical = jb.Hybrid(3, 6, 6), jb.Classical(3, 6, 6)
    a, b = hybrid.linearise(ROTOR, 3.0), classical.linearise(ROTOR, 3.0)
    np.testing.assert_array_equal(a.mass, b.mass)
    np.testing.assert_array_equal(a.gyroscopic, b.gyroscopic)
    extra = a.stiffness - b.stiffness
    assert not extra[:3].any()
    x, w = np.polynomial.legendre.leggauss(40)
    s = x + 1  # length 2
    slope = hybrid.basis.bending(6, s / 2).slope / 2
    p = 9 * (0.7 * (0.4 * (2 - s) + (4 - s**2) / 2) + 0.3 * 2.4)
    expected = slope.T @ ((w * p)[:, None] * slope)
    for part in (slice(3, 9), slice(9, 15)):
        np.testing.assert_allclose(extra[part, part], expected, rtol=1e-10, atol=1e-10)


# Model A of B for one element, from the printed matrices. Order (q1, q2, q3, q4, q5) of B eq. 19:
# axial slope at the root, tip x, tip y, tip x slope, tip y slope.
def _printed(m, l, m_t, EA, EI):  # noqa: E741
    def full(*rows):
        upper = np.zeros((5, 5))
        for i, row in enumerate(rows):
            upper[i, i:] = row
        return upper + np.triu(upper, 1).T

    mass = full(
        [m * l**2 / 105, 13 * m * l / 420, 0, -m * l**2 / 140, 0],
        [13 * m / 35 + m_t, 0, -11 * m * l / 210, 0],
        [13 * m / 35 + m_t, 0, -11 * m * l / 210],
        [m * l**2 / 105, 0],
        [m * l**2 / 105],
    )
    k_a = full(
        [12 * l**2, 18 * l, 0, -2 * l**2, 0],
        [-36, 0, -3 * l, 0],
        [-36, 0, -3 * l],
        [-2 * l**2, 0],
        [-2 * l**2],
    )
    k_m = full(
        [18 * l**2, -36 * l, 0, -3 * l**2, 0],
        [324, 0, -36 * l, 0],
        [324, 0, -36 * l],
        [18 * l**2, 0],
        [18 * l**2],
    )
    k_b = full(
        [-2 * l**2, -3 * l, 0, -2 * l**2, 0],
        [-36, 0, 18 * l, 0],
        [-36, 0, 18 * l],
        [12 * l**2, 0],
        [12 * l**2],
    )
    k_t = full(
        [4 * l**2, -6 * l, 0, 2 * l**2, 0], [12, 0, -6 * l, 0], [12, 0, -6 * l], [4 * l**2, 0],
        [4 * l**2],
    )  # fmt: skip
    scale = EA / (210 * l)
    return mass, (scale * k_a, scale * k_m, scale * k_b), EI / l**3 * k_t


ONE = jb.Rotor(jb.Beam(1.3, 0.8, 900.0, 4.0, 4.0), hub_radius=0.5, tip_mass=0.6)
# package order: L * slope at the root, tip y, L * tip y slope, tip x, L * tip x slope
TO_PAPER = np.array([[1 / 1.3, 0, 0, 0, 0], [0, 0, 0, 1, 0], [0, 1, 0, 0, 0],
                     [0, 0, 0, 0, 1 / 1.3], [0, 0, 1 / 1.3, 0, 0]])  # fmt: skip


def test_one_element_mass_and_coriolis_are_those_printed():
    """B eqs. 25 and 26, the latter with its misprinted rows 4 and 5 as skew partners."""
    mass, _, _ = _printed(0.8 * 1.3, 1.3, 0.6, 900.0, 4.0)
    system = jb.papers.ANCF(1).linearise(ONE, 2.0)
    np.testing.assert_allclose(system.mass, TO_PAPER.T @ mass @ TO_PAPER, rtol=1e-12)
    axial, transverse = [0, 1, 3], [2, 4]
    c = np.zeros((5, 5))
    # scalar mass matrix on (root slope, tip, tip slope) for both directions
    scalar = mass[np.ix_(axial, axial)]
    c[np.ix_(axial, transverse)] = -4.0 * scalar[:, 1:]
    c -= c.T
    np.testing.assert_allclose(system.gyroscopic, TO_PAPER.T @ c @ TO_PAPER, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("speed", [0.0, 3.0, 12.0])
def test_one_element_tangent_is_that_of_the_printed_forces(speed):
    """Exact linearisation against JAX differentiating the printed non-linear Model A (B eq. 27)."""
    mass, k_l, k_t = _printed(0.8 * 1.3, 1.3, 0.6, 900.0, 4.0)
    m, length = 0.8 * 1.3, 1.3
    hub = 0.5 * np.array([m * length / 12, m / 2 + 0.6, 0, -m * length / 12, 0])  # B eq. 32

    def force(q):
        eps = (
            jnp.hypot(q[0], 0.0) - 1,
            jnp.hypot(q[1], q[2]) / length - 1,
            jnp.hypot(q[3], q[4]) - 1,
        )
        stiffness = sum((e * k for e, k in zip(eps, k_l, strict=True)), jnp.asarray(k_t))
        return stiffness @ q - speed**2 * (mass @ q + hub)

    model = jb.papers.ANCF(1)
    u = model.steady_state(ONE, speed)
    q0 = jnp.array([1 + u[0] / length, length + u[1], 0.0, 1 + u[2] / length, 0.0])
    assert float(jnp.abs(force(q0)).max()) < 1e-9
    tangent = jax.jacfwd(force)(q0)
    ours = model.linearise(ONE, speed).stiffness
    np.testing.assert_allclose(TO_PAPER.T @ tangent @ TO_PAPER, ours, rtol=1e-9, atol=1e-9)


def test_small_strain_tends_to_exact_as_strain_vanishes():
    """Their difference is of second order in the steady strain (relative to the tension)."""
    gaps, strains = [], []
    for slenderness in (50.0, 100.0, 200.0, 400.0):
        rotor = slender(slenderness, 0.5, 0.5)
        a = jb.papers.SmallStrainANCF(6).linearise(rotor, 3.0)
        b = jb.papers.ANCF(6).linearise(rotor, 3.0)
        bent = [
            s.stiffness[np.ix_(i, i)] for s, i in ((s, s.where(DIRECTION.IN_PLANE)) for s in (a, b))
        ]
        gap = bent[0] - bent[1]
        gaps.append(float(jnp.abs(gap).max()))
        strains.append(float(a.steady_strain))
    order = np.polyfit(np.log(strains), np.log(gaps), 1)[0]
    assert order == pytest.approx(1.0, abs=0.02)  # of a tension that does not depend on EA


def test_steady_state_against_the_first_integral_of_the_rod():
    """(EA p (p - 1))' + rho Omega^2 r = 0, p = r', without bending and tip mass:

    EA (p^3 2/3 - p^2 / 2 + ...) is exact in r: int (2 p - 1) p dp = -rho Omega^2 r dr / EA, so
    2/3 (p^3 - 1) - (p^2 - 1) / 2 = rho Omega^2 (r_L^2 - r^2) / (2 EA).
    """
    slenderness, speed, hub = 1e5, 3e4, 0.25
    rotor = slender(slenderness, hub)
    u = jb.papers.ANCF(40).steady_state(rotor, speed)
    beta2 = (speed / slenderness) ** 2
    tip = 1 + hub + float(u[-2])
    node = np.asarray(u)[1::2]
    slopes = 1 + np.concatenate([[u[0]], np.asarray(u)[2::2]])
    r = hub + np.linspace(0, 1, 41) + np.concatenate([[0.0], node])
    left = 2 / 3 * (slopes**3 - 1) - (slopes**2 - 1) / 2
    np.testing.assert_allclose(left, beta2 * (tip**2 - r**2) / 2, atol=2e-7)


@pytest.mark.slow
def test_steady_state_derivative():
    @jax.jit
    def tip(speed):
        return jb.papers.ANCF(5).steady_state(slender(30.0, 0.5, 0.5), speed)[-2]

    h = 1e-3
    for d, order in ((jax.grad(tip), 1), (jax.grad(jax.grad(tip)), 2)):
        lower = tip if order == 1 else jax.jit(jax.grad(tip))
        fd = (8 * (lower(8 + h) - lower(8 - h)) - (lower(8 + 2 * h) - lower(8 - 2 * h))) / 12 / h
        assert float(jax.jit(d)(8.0)) == pytest.approx(float(fd), rel=1e-8)


@pytest.mark.slow
def test_search_that_fails_says_so():
    rotor = slender(5.0, 0.5, 1.0)
    for call in (
        jb.papers.ANCF(3).steady_state,
        jb.papers.ANCF(3).linearise,
        partial(jb.modes, jb.papers.ANCF(3)),
    ):
        with pytest.raises(RuntimeError, match="did not converge at this angular_speed"):
            call(rotor, 1e9)
    system = jb.papers.ANCF(3).linearise(rotor, 1e9, throw=False)
    assert jb.Status(int(system.status)) is jb.Status.NOT_CONVERGED
    failed = jb.modes(jb.papers.ANCF(3), rotor, 1e9, throw=False)
    assert jnp.isnan(failed.frequency).all()
    assert jnp.isnan(failed.growth_rate).all()


@pytest.mark.parametrize("make", [jb.papers.ANCF, jb.papers.SmallStrainANCF])
def test_bad_element_counts(make):
    for bad in (0, -1):
        with pytest.raises(ValueError, match="n_elements must be >= 1"):
            make(bad)
    with pytest.raises(TypeError, match="n_elements must be an int"):
        make(2.0)


@pytest.mark.parametrize("make", [jb.Hybrid, jb.Classical])
def test_bad_function_counts(make):
    with pytest.raises(ValueError, match="n_in_plane must be >= 0"):
        make(n_in_plane=-1)
    with pytest.raises(TypeError, match="n_flap must be an int"):
        make(n_flap=3.0)
    with pytest.raises(ValueError, match="at least one must be > 0"):
        make(0, 0, 0)
