"""The reference for blades as built, against closed forms, prints, and other descriptions."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.linalg

from tests.references import power_series
from tests.references.blade import (
    Blade,
    Body,
    by_integrals,
    coned,
    flap,
    frequencies,
    in_plane,
    nrel5mw,
)
from tests.tiers import exhaustive, slow


def _breadth(c: float, **others) -> Blade:
    line = ((0, 1), (1, 1 - c))
    return Blade(mass=line, flap=line, **others)


def _height(c: float, width: int = 1) -> Blade:
    """Height falls linearly; width is constant (1) or falls with it (2)."""
    return Blade(mass=lambda x: (1 - c * x) ** width, flap=lambda x: (1 - c * x) ** (width + 2))


HALVES = (0, 0.5, 0.5, 1)
STEP = Blade((HALVES, (1, 1, 0.6, 0.6)), (HALVES, (4, 4, 2, 2)), (HALVES, (1, 1, 0.3, 0.3)))
HINGED = Blade(lag_spring=0.5, flap_spring=0.5)
EXTENSIBLE = Blade(lag=3.0, stretch=400.0, twist=0.4, hub=0.3)
# Everything at once, with a body that bends the soft end of the blade.
LOADED = replace(
    nrel5mw(), tip=Body(500.0, 0.5, 300.0, 200.0), lag_spring=1e10, flap_spring=3e9, pitch=0.1
)
RATED = 12.1 * 2 * np.pi / 60


# --- against numbers computed elsewhere ----------------------------------------------------------


@pytest.mark.parametrize(
    ("compute", "blade", "speed", "expected"),
    [
        (flap, _breadth(0.25), 0.0, (3.836431909, 22.63870144, 62.28840742)),
        (flap, _breadth(0.25, tip=Body(0.4375)), 0.0, (2.120822629, 17.11334634, 51.81662538)),
        (flap, STEP, 0.0, (4.229795412, 18.42243632, 52.80636718)),
        (in_plane, STEP, 0.0, (8.720704384, 42.6861244, 118.7831992)),
        (frequencies, Blade(lag=16.0), 1.0, (3.681646814, 14.07093018, 22.18101115, 61.84176259)),
        (flap, HINGED, 0.0, (1.158197107, 15.86088999, 50.44763967)),
        (flap, HINGED, 4.0, (4.167463675,)),
        (in_plane, HINGED, 4.0, (1.169509931,)),
    ],
)
def test_values_to_ten_digits(compute, blade, speed, expected):
    """Computed twice elsewhere, by other methods."""
    np.testing.assert_allclose(compute(blade, speed, len(expected)), expected, rtol=5e-10)


@pytest.mark.parametrize(
    ("speed", "expected"),
    [
        (0.0, (3.8238, 18.3173, 47.2648)),
        (1.0, (3.9866, 18.4740, 47.4173)),
        (12.0, (13.4711, 34.0877, 65.5237)),
    ],
)
def test_hodges_and_rutkowski(speed, expected):
    """AIAA Journal 19 (1981) 1459: height tapers to one half, flap."""
    np.testing.assert_allclose(flap(_height(0.5), speed), expected, rtol=0, atol=5.1e-5)


def test_nrel_blade_at_rest():
    hertz, straight = 2 * np.pi, nrel5mw(twisted=False)
    cases = [
        (flap(straight, 0.0, 2), (0.69221634, 1.99263646)),
        (in_plane(straight, 0.0, 1), (1.11441018,)),
        (frequencies(nrel5mw()), (0.69290036, 1.11080466, 1.99815719)),
    ]
    for found, expected in cases:
        np.testing.assert_allclose(np.array(found) / hertz, expected, rtol=0, atol=5.1e-9)


def _bessel(n: int, c: float, omega) -> mpmath.mpf:
    """Zero at the frequencies of m ~ y^n, EI ~ y^(n + 2), y = 1 - c x.

    w = y^(-n/2) Z_n(2 b sqrt(y)) with b^2 = omega / c^2 and Z any of J, Y, I, K (Kirchhoff 1879).
    """
    b, rows = mpmath.sqrt(omega) / c, []
    root, tip = 2 * b, 2 * b * mpmath.sqrt(1 - c)
    # signs with which y^(-n/2) Z_n goes to Z_(n+1), and y^(n/2) Z_n to Z_(n-1), on differentiation
    signs = {"besselj": (-1, 1), "bessely": (-1, 1), "besseli": (1, 1), "besselk": (-1, -1)}
    for name, (up, down) in signs.items():
        z = getattr(mpmath, name)
        rows.append([z(n, root), up * z(n + 1, root), z(n + 2, tip), down * z(n + 1, tip)])
    return mpmath.det(mpmath.matrix(rows))


def _secant(function, guess: float):
    low, high = mpmath.mpf(guess) * (1 - mpmath.mpf(10) ** -7), mpmath.mpf(guess)
    at_low, at_high = function(low), function(high)
    for _ in range(2):  # from 1e-12 or better
        if at_low == at_high:
            break
        low, high, at_low = high, high - at_high * (high - low) / (at_high - at_low), at_high
        at_high = function(high)
    return high


@pytest.mark.parametrize("width", [1, 2], ids=["wedge", "cone"])
@pytest.mark.parametrize("c", [0.5, exhaustive(0.25), exhaustive(0.95)])
def test_tapered_to_an_edge_or_a_point(width, c):
    with mpmath.workdps(30):
        for found in flap(_height(c, width), 0.0, 3):
            exact = _secant(lambda omega: _bessel(width, mpmath.mpf(c), omega), found)
            assert abs(found / exact - 1) < 2e-12


@pytest.mark.parametrize(
    ("gamma", "hub", "tip", "slenderness", "plane"),
    [
        (0.0, 0.0, 0.0, None, "flap"),
        (10.0, 2.0, 0.5, None, "flap"),
        (10.0, 2.0, 0.5, 70.0, "in plane"),
        exhaustive(1.0, 0.0, 1.0, 70.0, "in plane"),
        exhaustive(10.0, 0.0, 0.0, None, "in plane"),
        exhaustive(50.0, 0.0, 0.0, 216.2125, "in plane"),
        exhaustive(50.0, 5.0, 4.0, None, "flap"),
        exhaustive(50.0, 5.0, 4.0, 216.2125, "in plane"),
    ],
)
def test_uniform_blades_against_power_series(gamma, hub, tip, slenderness, plane):
    expected = power_series.frequencies(gamma, hub, tip, slenderness, plane)
    stretch = None if slenderness is None else slenderness**2
    blade = Blade(stretch=stretch, hub=hub, tip=Body(tip))
    found = (flap if plane == "flap" else in_plane)(blade, gamma)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_stretch_alone():
    found = frequencies(Blade(stretch=400.0), 3.0, 3, "axial")
    exact = np.sqrt((20 * (np.arange(3) + 0.5) * np.pi) ** 2 - 9)
    np.testing.assert_allclose(found, exact, rtol=1e-13)


# --- against itself, described otherwise ---------------------------------------------------------


@pytest.mark.slow
def test_tip_body_is_a_stiff_end_of_the_blade():
    """A rod that hardly bends, of twice the offset: the difference goes with its flexibility."""
    reach, mass, error = 0.15, 0.6, []
    inertia = mass * (2 * reach) ** 2 / 12
    body = replace(EXTENSIBLE, tip=Body(mass, reach, inertia, inertia))
    expected = np.array(frequencies(body, 4.0, 4))
    joint = 1 / (1 + 2 * reach)
    for stiff in (1e5, 1e7):

        def joined(blade, rod):
            return (0, joint, joint, 1), (blade, blade, rod, rod)

        rod = Blade(
            mass=joined(1.0, mass / (2 * reach)),
            lag=joined(3.0, 3 * stiff),
            flap=joined(1.0, stiff),
            stretch=joined(400.0, 400 * stiff),
            **dict(twist=0.4, hub=0.3, length=1 + 2 * reach),
        )
        error.append(np.array(frequencies(rod, 4.0, 4)) / expected - 1)
    assert np.abs(error[0]).max() < 1e-6
    np.testing.assert_allclose(error[1], error[0] / 100, rtol=0.01, atol=1e-12)


@pytest.mark.parametrize("speed", [slow(0.0), exhaustive(RATED)])
def test_integral_equation_agrees(speed):
    for blade, motion in ((LOADED, None), (EXTENSIBLE, None), (HINGED, "flap")):
        shot = frequencies(blade, speed, 5, motion)
        np.testing.assert_allclose(by_integrals(blade, speed, 5, motion, stages=7), shot, rtol=1e-9)


@pytest.mark.exhaustive
def test_resolution_does_not_matter():
    cases = [(LOADED, RATED), (EXTENSIBLE, 9.0), (_height(0.95), 5.0), (STEP, 20.0)]
    for blade, speed in cases:
        plain, fine = (frequencies(blade, speed, 4, resolution=r) for r in (1.0, 1.7))
        np.testing.assert_allclose(plain, fine, rtol=5e-12)


@pytest.mark.slow
def test_turned_sections():
    square = Blade(flap=2.0, lag=2.0, hub=0.2)
    for speed in (0.0, 3.0):  # at rest every frequency is double
        both = sorted(flap(square, speed) + in_plane(square, speed))
        twisted = replace(square, twist=((0, 0.3, 1), (0.5, -0.2, 0.9)), pitch=0.4)
        for blade in (square, twisted):
            np.testing.assert_allclose(frequencies(blade, speed, 6), both, rtol=1e-12)
    flat = Blade(lag=16.0, stretch=900.0)
    upright = replace(flat, lag=1.0, flap=16.0, pitch=np.pi / 2)
    np.testing.assert_allclose(frequencies(flat, 3.0, 5), frequencies(upright, 3.0, 5), rtol=1e-12)


def test_units_do_not_matter():
    length, mass, stiffness = 61.5, 678.9, 1.8e10
    unit = np.sqrt(stiffness / mass) / length**2
    step = [(HALVES, tuple(s * v for v in (1, 1, 0.5, 0.5))) for s in (mass, stiffness)]
    real = Blade(
        *(step[0], 4 * stiffness, step[1], 400 * stiffness / length**2, ((0, 1), (0.3, 0))),
        **dict(length=length, hub=0.1 * length, tip=Body(0.2 * mass * length, 0.1 * length)),
    )
    half = (HALVES, (1, 1, 0.5, 0.5))
    plain = Blade(half, 4.0, half, 400.0, ((0, 1), (0.3, 0)), hub=0.1, tip=Body(0.2, 0.1))
    found = np.array(frequencies(real, 5 * unit, 4)) / unit
    np.testing.assert_allclose(found, frequencies(plain, 5.0, 4), rtol=1e-12)


def test_nearly_inextensible():
    stiff = in_plane(Blade(stretch=1e11, hub=1.0, tip=Body(0.3)), 10.0)
    np.testing.assert_allclose(stiff, in_plane(Blade(hub=1.0, tip=Body(0.3)), 10.0), rtol=1e-7)


# --- coned blades --------------------------------------------------------------------------------


def test_coned_values():
    """Printed to five digits, computed twice elsewhere."""
    blade, cone = Blade(lag=16.0), float(np.deg2rad(5))
    for found, expected in (
        (frequencies(blade, 8.0, 2), (9.2568, 14.4872)),
        (coned(blade, 8.0, cone), (9.2527, 14.4935)),
        (coned(blade, 8.0, cone, deflected=False), (9.1311, 14.5783)),
    ):
        np.testing.assert_allclose(found, expected, rtol=0, atol=5.1e-5)


@pytest.mark.slow
def test_coned_limits():
    blade = replace(STEP, hub=0.2, tip=Body(0.3))
    flat = frequencies(blade, 6.0, 4)
    np.testing.assert_allclose(coned(blade, 6.0, 0.0, 4), flat, rtol=1e-12)
    np.testing.assert_allclose(coned(blade, 0.0, 0.3, 4), frequencies(blade, 0.0, 4), rtol=1e-12)
    fine = coned(blade, 6.0, 0.3, 4, resolution=1.7)
    np.testing.assert_allclose(coned(blade, 6.0, 0.3, 4), fine, rtol=1e-12)
    assert abs(fine[0] / flat[0] - 1) > 1e-3


def _frame(angles):
    p, t, c = angles
    zero, one = jnp.zeros(()), jnp.ones(())
    azimuth = [jnp.cos(p), -jnp.sin(p), zero], [jnp.sin(p), jnp.cos(p), zero], [zero, zero, one]
    lift = [jnp.cos(t), zero, -jnp.sin(t)], [zero, one, zero], [jnp.sin(t), zero, jnp.cos(t)]
    turn = [one, zero, zero], [zero, jnp.cos(c), -jnp.sin(c)], [zero, jnp.sin(c), jnp.cos(c)]
    return jnp.array(azimuth) @ jnp.array(lift) @ jnp.array(turn)


def _from_finite_rotations(lag, speed, cone, hub, tip, n=10, nodes=24):
    """Modes of a uniform coned rod from its energies alone, in polynomials for the two angles."""
    t, w = np.polynomial.legendre.leggauss(nodes)
    shapes = np.polynomial.legendre.legvander(t, n - 1)
    lagrange = np.linalg.inv(np.polynomial.legendre.legvander(t, nodes - 1))
    primitives = np.polynomial.legendre.legint(lagrange, lbnd=-1)
    upto, w = np.polynomial.legendre.legval(t, primitives).T / 2, w / 2
    mass = np.append(w, tip)

    def section(angles, rates):
        frame, change = jax.jvp(_frame, (angles,), (rates,))
        spin = frame.T @ change
        return jnp.array([spin[2, 1], spin[0, 2], spin[1, 0]]), frame[:, 0]

    def kinematics(z):
        rise, swing = shapes @ z[:n], shapes @ z[n:]
        t = cone + upto @ rise
        turn = -swing * jnp.sin(t)  # no torsion
        angles = jnp.stack([upto @ swing, t, upto @ turn], 1)
        k, tangent = jax.vmap(section)(angles, jnp.stack([swing, rise, turn], 1))
        return k, jnp.concatenate([upto @ tangent, (w @ tangent)[None]]).at[:, 0].add(hub)

    def potential(z):
        k, r = kinematics(z)
        elastic = w @ (k[:, 1] ** 2 + lag * k[:, 2] ** 2)
        return (elastic - speed**2 * mass @ (r[:, 0] ** 2 + r[:, 1] ** 2)) / 2

    gradient, hessian = jax.jit(jax.grad(potential)), jax.jit(jax.hessian(potential))
    z = jnp.zeros(2 * n)
    for _ in range(10):
        z -= jnp.linalg.solve(hessian(z), gradient(z))
    assert np.abs(gradient(z)).max() < 1e-12
    assert np.abs(kinematics(z + 0.01)[0][:, 0]).max() < 1e-14
    moves = np.asarray(jax.jacfwd(lambda z: kinematics(z)[1])(z))
    m = np.einsum("k,kci,kcj->ij", mass, moves, moves)
    g = 2 * speed * np.einsum("k,ki,kj->ij", mass, moves[:, 1], moves[:, 0])
    k, one = np.asarray(hessian(z)), np.eye(2 * n)
    g = g - g.T
    system = np.block([[0 * one, one], [-np.linalg.solve(m, k), -np.linalg.solve(m, g)]])
    found = scipy.linalg.eigvals(system).imag
    return np.sort(found[found > 0])


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", [(16.0, 8.0, 0.1, 0.0, 0.0), (4.0, 6.0, 0.5, 0.2, 0.3)])
def test_coned_against_finite_rotations(case):
    """The equations of `coned` were derived by hand; here differentiation is left to JAX."""
    lag, speed, cone, hub, tip = case
    found = coned(Blade(lag=lag, hub=hub, tip=Body(tip)), speed, cone, 3)
    np.testing.assert_allclose(_from_finite_rotations(*case)[:3], found, rtol=1e-7)


# --- refusals ------------------------------------------------------------------------------------


def test_what_it_refuses():
    with pytest.raises(ValueError, match="stations must ascend"):
        Blade(mass=((0, 0.5, 0.4, 1), (1, 1, 1, 1)))
    with pytest.raises(ValueError, match="stations must ascend"):
        Blade(mass=((0, 0.5), (1, 1)))
    with pytest.raises(ValueError, match="one motion"):
        flap(Blade(twist=0.1))
    with pytest.raises(ValueError, match="motion names"):
        frequencies(Blade(), motion="torsion")
    with pytest.raises(ValueError, match="clamped, inextensible"):
        coned(Blade(twist=0.1), 1.0, 0.1)
