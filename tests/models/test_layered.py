"""Soft beams, which tension holds out: functions with layers, and what they leave out."""

import functools

import jax
import numpy as np
import pytest
import scipy.linalg

import jaxbeam as jb
from jaxbeam._models.bases.basis import Polynomials, bending_integrals
from jaxbeam._models.bases.layered import LAYERS, massless
from jaxbeam.models import Layered
from tests.references import power_series, soft_beam


def test_the_reference_against_power_series():
    for gamma, hub, tip, plane in ((30.0, 0.0, 0.0, "in plane"), (50.0, 0.3, 0.2, "flap")):
        exact = power_series.frequencies(gamma, hub, tip, plane=plane)
        found = soft_beam.frequencies(gamma, hub, tip, plane)
        np.testing.assert_allclose(found, exact, rtol=1e-10)


def by_layers(gamma, hub, tip, plane, inertia):
    """By integrals of the functions alone."""
    own, eps = bending_integrals(Layered(), 16 + LAYERS), massless(Layered(), np.float64)
    pulls = gamma**2 * np.array([tip * (hub + 1), hub, 1.0])
    slope = Layered().bending(16 + LAYERS, np.ones(1)).slope[0]
    mass = own.mass + tip * np.outer(own.tip, own.tip)
    turned = inertia * np.outer(slope, slope)
    stiffness = own.curvature + np.tensordot(pulls, own.tension, 1)
    stiffness += gamma**2 * (turned if plane == "flap" else -mass)
    mass = mass + turned + eps * (1 + tip) * np.eye(len(mass))
    first, second = np.linalg.cholesky(stiffness), np.linalg.cholesky(mass)
    inverse = scipy.linalg.solve_triangular(first, second, lower=True)
    return 1 / np.linalg.svd(inverse, compute_uv=False)[:3]


def test_layers_follow_beams_of_any_softness():
    """Three modes each way; in the axis of rotation the first one in plane is held by the layer
    alone."""
    for gamma in (10.0, 1e3, 1e5):
        for hub, tip in ((0.0, 1.0), (0.5, 0.0)):
            for plane in ("in plane", "flap"):
                right = soft_beam.frequencies(gamma, hub, tip, plane)
                found = by_layers(gamma, hub, tip, plane, 0.0)
                np.testing.assert_allclose(found, right, rtol=1e-6)
    right = soft_beam.frequencies(1e3, 0.5, 0.1, "flap", inertia=0.01)
    np.testing.assert_allclose(by_layers(1e3, 0.5, 0.1, "flap", 0.01), right, rtol=1e-5)


def test_the_first_functions_are_polynomials_and_slopes_belong_to_curvatures():
    xi = np.sort(np.random.default_rng(0).random(40))
    found, plain = Layered().bending(8 + LAYERS, xi), Polynomials().bending(8, xi)
    for own, few in zip(found, plain, strict=True):
        np.testing.assert_allclose(own[:, :8], few, rtol=1e-11, atol=1e-11)
    own = bending_integrals(Layered(), 8 + LAYERS)
    np.testing.assert_allclose(own.curvature, np.eye(8 + LAYERS), atol=1e-10)
    with pytest.raises(ValueError, match="28 layers"):
        Layered().bending(LAYERS, xi)


# The satellite boom of the report: its right value is that of 400 graded elements.
BOOM = jb.Rotor(jb.Beam(50.0, 0.0045, 2e4, 1e-3, 1e-3), 0.6, 0.025)
SPIN = 5.5 * 2 * np.pi / 60
FIRST = jb.labels(in_plane=1)


@pytest.mark.slow
def test_a_boom_of_wire_by_default():
    """Known numbers: layers; traced ones: polynomials, and the status says so. The derivative by
    the speed is that of differences."""
    model = jb.Hybrid(0, 16, 0)
    found = jb.modes(model, BOOM, SPIN, FIRST)
    np.testing.assert_allclose(found.frequency[0] / SPIN, 0.1306413, rtol=1e-6)
    assert found.frequency_error[0] < 1e-8
    assert isinstance(found.model.basis, Layered)
    traced = jax.jit(lambda speed: jb.modes(model, BOOM, speed, FIRST, throw=False))(SPIN)
    assert traced.status == jb.Status.TOO_FEW_FUNCTIONS
    ours = jax.jit(jax.value_and_grad(lambda w: jb.modes(found.model, BOOM, w, FIRST).frequency[0]))
    near = [ours(SPIN * (1 + h))[0] for h in (-1e-3, 1e-3)]
    np.testing.assert_allclose(ours(SPIN)[1], (near[1] - near[0]) / (2e-3 * SPIN), rtol=1e-5)


@functools.cache
def of_user(functions):
    """A user's own number of polynomials: status OK, with an estimate."""
    model = jb.Hybrid(0, functions, 0)

    @jax.jit
    def found(gamma, hub, tip):
        rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e9, 1.0, 1.0), hub, tip)
        return jb.modes(model, rotor, gamma, jb.labels(in_plane=3))

    return found


@pytest.mark.slow
def test_by_default_traced_numbers_give_what_is_right_to_1e_6_or_a_status():
    """From stiff to soft, in a batch; a user's own numbers are judged by their user."""
    hub, tip, gammas = 0.1, 0.1, np.array([30.0, 45.0, 70.0, 150.0, 1e4])

    @jax.jit
    @jax.vmap
    def found(gamma):
        rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e9, 1.0, 1.0), hub, tip)
        return jb.modes(jb.Hybrid(0, 16, 0), rotor, gamma, 2, throw=False)

    modes = found(gammas)
    few = jb.Status.TOO_FEW_FUNCTIONS
    assert modes.status.tolist() == [jb.Status.OK, jb.Status.OK, few, few, few]
    for k, gamma in enumerate(gammas[:4]):
        exact = soft_beam.frequencies(gamma, hub, tip)[:2]
        error = np.abs(of_user(17)(gamma, hub, tip).frequency[:2] / exact - 1)
        assert (np.max(error) < 1e-6) == (k < 2)
        if k < 2:
            np.testing.assert_allclose(modes.frequency[k], exact, rtol=1e-6)


@pytest.mark.exhaustive
def test_modulated_speeds_of_soft_beams_have_a_status():
    motion, model = jb.motions.ModulatedSpeed(SPIN, 0.1, 1.0), jb.Hybrid(0, 16, 0)
    assert jb.floquet(model, BOOM, motion, throw=False).status == jb.Status.TOO_FEW_FUNCTIONS


@pytest.mark.slow
def test_the_estimate_of_polynomials_knows_the_tension():
    """Errors from 1e-6 to 0.1: within a tenth, and where little is left of the frequency, within a
    factor of two."""
    for gamma, hub, tip in ((100.0, 0.1, 0.0), (1e3, 0.1, 0.0), (1e5, 3.0, 1.0), (300.0, 0.0, 0.3)):
        found = of_user(17)(gamma, hub, tip)
        error = np.asarray(found.frequency) / soft_beam.frequencies(gamma, hub, tip) - 1
        np.testing.assert_allclose(found.frequency_error, error, rtol=0.1)
    found = of_user(17)(1e4, 0.0, 0.3)
    error = np.asarray(found.frequency) / soft_beam.frequencies(1e4, 0.0, 0.3) - 1
    assert np.all(found.frequency_error > error / 2)
    assert np.all(found.frequency_error < error * 2)


@pytest.mark.exhaustive
def test_random_soft_beams():
    """300 from rest to 1e5, with tip masses and hub radii, by default: right to 1e-6, and their
    estimates within a factor of two where the error is above 1e-9, which rounding makes."""
    rng = np.random.default_rng()
    labels = jb.labels(in_plane=3, flap=3)
    for case in range(300):
        gamma, ratio = 10.0 ** rng.uniform(0, 5) * (case % 20 > 0), 10.0 ** rng.uniform(-1, 1)
        gamma = min(gamma, 1e5 * ratio**0.5)
        hub, tip = (rng.choice([0.0, 10.0 ** rng.uniform(-3, 1)]) for _ in range(2))
        print(f"gamma {gamma}, flap over in plane {ratio}, hub {hub}, tip {tip}")
        rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e9, 1.0, ratio), hub, tip)
        found = jb.modes(jb.Hybrid(0), rotor, gamma, labels)
        flap = soft_beam.frequencies(gamma / ratio**0.5, hub, tip, "flap") * ratio**0.5
        right = np.append(soft_beam.frequencies(gamma, hub, tip), flap)
        error, estimate = np.abs(found.frequency / right - 1), found.frequency_error
        assert np.all(error < 1e-6)
        assert np.all(estimate > error / 2 - 1e-9)
        assert np.all(estimate < error * 2 + 1e-9)
