"""The shortest model of your own: a rotating string, with frequencies in closed form."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._models.bases.basis import Polynomials


@dataclasses.dataclass(frozen=True)
class _Hinged(Polynomials):
    """A string may have a slope at the hub: it deflects as a rod stretches, f(0) = 0 alone."""

    def bending(self, n, xi):
        return self.stretch(n, xi)


class String(jb.Hybrid):
    """Tension alone, no bending stiffness."""

    def linear_stiffness(self, rotor, shapes):
        rigidity = rotor.beam.axial_stiffness / rotor.beam.length
        return jnp.asarray(rigidity * self.shape_integrals.elastic[0])


@pytest.mark.slow
def test_frequencies_of_a_rotating_string():
    """On a hub without radius: flap omega_k = Omega (k (2 k - 1))^1/2, from Legendre polynomials of
    odd degree; in plane omega^2 is less by Omega^2."""
    model, speed = String(0, 16, 16, _Hinged()), 3.0
    rotor = jb.Rotor(jb.Beam(2.0, 0.7, 3e3, 5.0, 8.0))
    k = np.arange(1, 7)
    flap = speed * np.sqrt(k * (2 * k - 1))
    found = jb.modes(model, rotor, speed, jb.labels(flap=6)).frequency
    np.testing.assert_allclose(found, flap, rtol=1e-12)
    found = jb.modes(model, rotor, speed, jb.labels(in_plane=6)).frequency
    np.testing.assert_allclose(found**2, flap**2 - speed**2, rtol=1e-12, atol=1e-12)


class _Sprung(jb.Hybrid):
    """A spring between tip and hub in plane, as stiff as the model says: in N/m."""

    spring: Any = 0.0

    def linear_stiffness(self, rotor, shapes):
        way = self.one_hot[:, 1] * self.shape_integrals.tip
        return super().linear_stiffness(rotor, shapes) + self.spring * np.outer(way, way)


def test_a_model_holds_no_array():
    """A float is a static choice; a number that is traced could not tell programs apart."""
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e6, 1.0, 1.0))

    def first(spring):
        return jb.modes(_Sprung(0, 2, 0, spring=spring), rotor, 0.0, 1).frequency[0]

    for function in (first, jax.grad(first)):
        with pytest.raises(TypeError, match="_Sprung holds an array, and a model holds static"):
            function(jnp.asarray(7.3))
