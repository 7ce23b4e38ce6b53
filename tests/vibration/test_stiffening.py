"""The ratio of motion-induced to elastic stiffness."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import jaxbeam as jb
from jaxbeam import stiffening_ratio
from jaxbeam._vibration.stiffening import timoshenko_reduction
from tests.helpers import build, finite_difference, slender
from tests.references import power_series
from tests.tiers import exhaustive, slow


def closed_form(hub, tip, speed):
    """Of a beam of unit length, mass and bending stiffness, by Gauss quadrature of the mode."""
    b = 1.8751040687 if tip == 0 else np.sqrt(power_series.frequencies(0.0, 0.0, tip)[0])
    x, w = np.polynomial.legendre.leggauss(40)
    x, w = (x + 1) / 2, w / 2
    c = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
    slope = b * (np.sinh(b * x) + np.sin(b * x) - c * (np.cosh(b * x) - np.cos(b * x)))
    bend = b**2 * (np.cosh(b * x) + np.cos(b * x) - c * (np.sinh(b * x) + np.sin(b * x)))
    tension = speed**2 * (hub * (1 - x) + (1 - x**2) / 2 + tip * (1 + hub))
    return np.sum(w * tension * slope**2) / np.sum(w * bend**2)


@pytest.mark.parametrize("hub", [0.0, 1.5])
@pytest.mark.parametrize("tip", [0.0, 0.8])
def test_closed_form(hub, tip):
    for speed in (1e-4, 2.0, -2.0):
        found = stiffening_ratio(slender(70.0, hub, tip), speed).ratio
        assert float(found) == pytest.approx(closed_form(hub, tip, speed), rel=2e-9)


@pytest.mark.slow
def test_southwell_coefficient():
    """By Rayleigh: of the flap mode at rest ratio omega_0^2 / Omega^2, in plane less by one."""
    rotor, speed = slender(70.0, 0.5, 0.3), 1.7
    phi = jb.southwell(jb.Hybrid(0, 16, 0), rotor, 0.0, jb.labels(in_plane=1)).coefficient[0]
    omega = power_series.frequencies(0.0, 0.0, 0.3)[0]
    found = stiffening_ratio(rotor, speed).ratio * (omega / speed) ** 2 - 1
    np.testing.assert_allclose(found, phi, rtol=1e-9)


def test_without_unit():
    """Any beam is one of unit length, mass and stiffness; those along the axis do not matter."""
    beam = jb.Beam(4.0, 0.5, 3e5, 20.0, 7.0)
    speed = 1.3 * beam.frequency_scale
    found = stiffening_ratio(jb.Rotor(beam, 2.0, 0.6), speed).ratio
    assert float(found) == pytest.approx(closed_form(0.5, 0.3, 1.3), rel=1e-9)


@pytest.mark.slow
def test_gradient():
    where = jnp.array([2.0, 0.7, 3e4, 5.0, 4.0, 1.1, 0.4, 3.0])

    both = jax.jit(jax.value_and_grad(lambda p: stiffening_ratio(*build(p)).ratio))
    exact = both(where)[1]
    np.testing.assert_allclose(exact, finite_difference(lambda p: both(p)[0], where), atol=1e-9)
    assert float(exact[2]) == float(exact[4]) == 0  # EA, EI in flap


@pytest.mark.slow
def test_batch_with_traced_input_out_of_range():
    """NaN there, and nothing of it in the derivative by what all lanes share."""

    @jax.jit
    def total(hub):
        tips = jnp.array([0.2, -1.0, jnp.nan, 0.5])

        def one(tip):
            return stiffening_ratio(slender(70.0, hub, tip), 1.0, throw=False)

        found = jax.vmap(one)(tips)
        return jnp.nansum(found.ratio), found

    slope, found = jax.grad(total, has_aux=True)(0.5)
    values, bad = found.ratio, jb.Status.INVALID_TIP_MASS
    np.testing.assert_array_equal(found.status, [0, bad, bad, 0])
    np.testing.assert_array_equal(jnp.isnan(values), [False, True, True, False])
    assert float(values[3]) == pytest.approx(closed_form(0.5, 0.5, 1.0), rel=1e-9)
    change = [closed_form(1.0, tip, 1.0) - closed_form(0.0, tip, 1.0) for tip in (0.2, 0.5)]
    np.testing.assert_allclose(slope, sum(change), rtol=1e-9)  # affine in the hub radius


def test_bad_input():
    with pytest.raises(TypeError, match="rotor must be a Rotor"):
        stiffening_ratio(jb.Beam.from_slenderness(70.0), 1.0)
    with pytest.raises(TypeError, match="angular_speed"):
        stiffening_ratio(slender(), "fast")
    with pytest.raises(ValueError, match="angular_speed must be finite"):
        stiffening_ratio(slender(), jnp.inf)
    with pytest.raises(ValueError, match="tip_mass"):
        stiffening_ratio(eqx.tree_at(lambda r: r.tip_mass, slender(), jnp.asarray(-1.0)), 1.0)


def timoshenko(slenderness, count):
    """Frequencies of a cantilever with shear and rotary inertia: L = rho A = EI = 1, r = 1 /
    slenderness and E / (kappa G) = 3.1, from the transfer matrix of (w, psi, M, Q)."""
    r2 = slenderness**-2.0
    shear = 1 / (3.1 * r2)  # kappa G A, since EA = EI / r^2

    def misfit(omega):
        a = np.zeros((4, 4))
        a[0, 1], a[0, 3] = 1.0, 1 / shear  # w' = psi + Q / (kappa G A)
        a[1, 2] = 1.0  # psi' = M / EI
        a[2, 1], a[2, 3] = -(omega**2) * r2, -1.0  # M' = -Q - omega^2 rho I psi
        a[3, 0] = -(omega**2)  # Q' = -omega^2 rho A w
        return np.linalg.det(scipy.linalg.expm(a)[2:, 2:])

    grid = np.linspace(0.5, 150.0, 150)
    values = np.array([misfit(omega) for omega in grid])
    ends = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))[:count]
    return np.array([scipy.optimize.brentq(misfit, grid[i], grid[i + 1]) for i in ends])


@pytest.mark.parametrize("slenderness", [slow(60.0), exhaustive(150.0)])
def test_what_timoshenko_takes_off(slenderness):
    """In plane, and in flap of a beam that is as stout there, or turned by a right angle."""
    exact = timoshenko(slenderness, 3)
    slender = jb.Beam(1.0, 1.0, slenderness**2, 1e-4, 1.0)
    for rotor, row in (
        (jb.Rotor(jb.Beam.from_slenderness(slenderness)), 0),
        (jb.Rotor(slender), 1),
        (jb.Rotor(jb.Beam(1.0, 1.0, slenderness**2, 1.0, 1e8), pitch=0.0), 0),
    ):
        known = jax.jit(timoshenko_reduction)(rotor)[row, :3]
        taken = 1 - exact / CANTILEVER
        # What is left is of second order.
        np.testing.assert_array_less(np.abs(known / taken - 1), 3 * taken)
    turned = jax.jit(timoshenko_reduction)(jb.Rotor(slender, pitch=np.pi / 2))
    straight = jax.jit(timoshenko_reduction)(jb.Rotor(slender))
    np.testing.assert_allclose(turned[0], straight[0], rtol=1e-6)  # the soft modes, now in flap


CANTILEVER = np.array([1.8751040687119611, 4.694091132974174, 7.854757438237613]) ** 2


@pytest.mark.exhaustive
def test_what_timoshenko_takes_off_with_a_body_at_the_tip():
    """A body beyond the tip shears the beam by the inertia of its centre: against quadrature."""
    body = jb.TipBody(0.5, 0.5, 0.1)
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, 900.0, 1.0, 1.0), tip_body=body)
    model = jb.Hybrid(0, 14, 0)
    mode = jb.modes(model, rotor, 0.0, 1)
    x, w = np.polynomial.legendre.leggauss(200)
    x, w = (1 + x) / 2, w / 2
    shapes = np.asarray(model.displacement(np.append(x, [1.0 - 1e-5, 1.0]), rotor))[1]
    phi = shapes @ np.asarray(mode.shape[0].real)
    rise = (phi[-1] - phi[-2]) / 1e-5
    carried = np.array([np.sum((w * phi[:-2])[x > at]) for at in x]) + 0.5 * (phi[-1] + 0.5 * rise)
    slope = np.gradient(phi[:-2], x)
    omega = float(mode.frequency[0])
    wanted = (np.sum(w * slope**2) / 900 + 3.1 * omega**2 * np.sum(w * carried**2) / 900) / 2
    np.testing.assert_allclose(timoshenko_reduction(rotor)[0, 0], wanted, rtol=1e-2)
