"""Functions whose bending moments are polynomials, on the blade of the NREL 5-MW turbine."""

import jax
import numpy as np
import pytest

import jaxbeam as jb
from tests.vibration import blade_reference

BLADE = jb.blades.read_csv(blade_reference.NREL, length=61.5, axial_stiffness=1e10).beam


@pytest.mark.slow
@pytest.mark.parametrize("rpm", [0.0, 12.1])
def test_sixteen_functions_of_a_twisted_blade(rpm):
    model = jb.Hybrid(0, 16, 16, basis=jb.models.MomentPolynomials.of(BLADE))
    speed = rpm * np.pi / 30
    found = jb.modes(model, jb.Rotor(BLADE, 1.5), speed, 6).frequency
    exact = blade_reference.frequencies(blade_reference.nrel5mw(), speed, 6)
    np.testing.assert_allclose(np.sort(found), exact, rtol=5e-5)


def test_made_within_a_program_that_is_compiled():
    made = []
    jax.jit(lambda x: made.append(jb.models.MomentPolynomials.of(BLADE)) or x)(1.0)
    assert made == [jb.models.MomentPolynomials.of(BLADE)]
