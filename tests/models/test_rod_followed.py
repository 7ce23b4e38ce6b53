"""Whether one polynomial of forces can follow a blade with a soft tip, whose numbers are traced:
every question that the rod answers tells."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import SpatialRod
from tests.beams import soft_tipped

FEW = jb.Status.TOO_FEW_FUNCTIONS
ROTOR = jb.Rotor(soft_tipped(), 1.0)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "ask",
    [
        pytest.param(
            lambda r: jb.critical_load(
                SpatialRod(), r, jb.Loads(gravity=[-1.0, 0, 0]), throw=False
            ),
            id="a load that is a tenth of what it should be", marks=pytest.mark.slow,
        ),
        lambda r: jb.critical_speed(SpatialRod(), r, throw=False),
        lambda r: jb.floquet(
            SpatialRod(), r, jb.motions.ModulatedSpeed(1.0, 0.1, 8.6), steps=2, throw=False
        ),
        lambda r: jb.tongue(
            SpatialRod(), r, 1.0, jb.labels(flap=2), [0.1], steps=2, throw=False
        ),
    ],
)  # fmt: skip
def test_stability_tells(ask):
    assert np.all(jax.jit(ask)(ROTOR).status == FEW)


@pytest.mark.slow
def test_a_steady_state_tells():
    """Its tip stretches by 7 % too little in rotation, which is told; forces that are polynomials
    are followed however soft the tip is, and so is a weight."""

    @jax.jit
    def both(rotor, speed, gravity, moment):
        loads = jb.Loads(gravity=gravity, tip_moment=moment)
        traced = jb.steady(SpatialRod(), rotor, speed, loads=loads, throw=False)
        finer = jb.steady(SpatialRod(8, 6).suited(ROTOR), rotor, speed, loads=loads, throw=False)
        tips = traced.tip, finer.tip
        return *tips, jnp.stack([traced.status, finer.status])

    none = np.zeros(3)
    *_, status = both(ROTOR, 1.0, none, none)
    assert list(status) == [FEW, jb.Status.OK]
    *tips, status = both(ROTOR, 0.0, np.array([0, 0, -9.81]), none)
    assert not np.any(status)
    np.testing.assert_allclose(*tips, rtol=2e-2, atol=1e-12)
    *_, status = both(ROTOR, 0.0, none, np.array([1e-2, 0, 0]))
    assert not np.any(status)
