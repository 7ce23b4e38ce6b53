"""Functions whose bending moments are polynomials, on the blade of the NREL 5-MW turbine."""

import jax
import numpy as np
import pytest

import jaxbeam as jb
from tests.tiers import slow
from tests.vibration import blade_reference

BLADE = jb.blades.read_csv(blade_reference.NREL, length=61.5, axial_stiffness=1e10).beam


@pytest.mark.exhaustive
@pytest.mark.parametrize("rpm", [0.0, slow(12.1)])
def test_of_a_twisted_blade(rpm):
    """Some functions are for what a moment bends across."""
    speed = rpm * np.pi / 30
    exact = np.array(blade_reference.frequencies(blade_reference.nrel5mw(), speed, 5))
    for count, tolerances in ((12, (2e-7, 2e-7, 5e-6, 5e-6, 8e-5)), (16, 4 * (1e-6,) + (5e-6,))):
        model = jb.Hybrid(0, count, count, basis=jb.models.MomentPolynomials.of(BLADE))
        found = np.asarray(jb.modes(model, jb.Rotor(BLADE, 1.5), speed, 5).frequency)
        assert (np.abs(found / exact - 1) < tolerances).all()


def test_of_a_beam_turned_as_a_whole():
    """What bends across is no other function then."""
    beam = jb.Beam(1.0, 1.0, 1e6, 16.0, 1.0, twist=0.3)
    model = jb.Hybrid(0, 12, 12, basis=jb.models.MomentPolynomials.of(beam))
    found = jb.modes(model, jb.Rotor(beam), 0.0, 4).frequency
    first, second, third = 3.5160152685, 22.0344915647, 61.6972144135
    assert np.allclose(found[:3], [first, 4 * first, second], rtol=1e-8)
    assert np.allclose(found[3], third, rtol=1e-4)


def test_made_within_a_program_that_is_compiled():
    made = []
    jax.jit(lambda x: made.append(jb.models.MomentPolynomials.of(BLADE)) or x)(1.0)
    assert made == [jb.models.MomentPolynomials.of(BLADE)]
