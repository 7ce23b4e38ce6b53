"""Batches of runs that end at different times: the same runs, in the order given."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.helpers import optimised
from tests.tiers import exhaustive, slow

TIMES = np.linspace(0.0, 12.0, 5)
SPEEDS = np.random.default_rng(7).permutation(np.geomspace(0.3, 3.0, 40))


def run(model, speed, tip_mass=0.1, bending=566.0):
    """Tip at the times, number of steps, status."""
    beam = jb.Beam(8.0, 0.2, 5e6, bending, bending)
    control = diffrax.PIDController(rtol=1e-4, atol=1e-4)
    out = jb.simulate(
        model, jb.Rotor(beam, tip_mass=tip_mass), jb.SmoothSpinUp(speed, 10.0), TIMES,
        stepsize_controller=control, balance_tolerance=0.5, throw=False,
    )  # fmt: skip
    return out.tip[:, 1], out.solution.stats["num_steps"], out.status


@pytest.mark.parametrize("model", [exhaustive(jb.PlanarRod(2)), slow(jb.Hybrid(1, 2, 0))])
def test_a_batch_is_its_single_runs(model):
    """More cases than go ahead together, of which the longest takes many times the steps of the
    shortest; two of them fail, at once and on the way."""
    speeds = np.append(SPEEDS, [np.nan, 40.0])
    tip, steps, status = jax.jit(jax.vmap(lambda s: run(model, s)))(speeds)
    single = jax.jit(lambda s: run(model, s))
    alone = [single(s) for s in speeds]
    np.testing.assert_array_equal(status, [a[2] for a in alone])
    assert (status[:40] == jb.Status.OK).all()
    assert status[40] == jb.Status.INVALID_MOTION
    # Vectors and single numbers round differently, by which a step may be made anew.
    np.testing.assert_allclose(steps, [a[1] for a in alone], rtol=0.05, atol=2)
    np.testing.assert_allclose(tip, np.stack([a[0] for a in alone]), rtol=1e-3, atol=1e-4)


@pytest.mark.exhaustive
def test_a_grid_is_a_batch():
    model, masses = jb.PlanarRod(2), jnp.array([0.0, 0.05, 0.2])

    def one(mass, speed):
        return run(model, speed, mass)[0]

    grid = optimised(jax.vmap(jax.vmap(one, (None, 0)), (0, None)))(masses, SPEEDS[:15])
    flat = optimised(jax.vmap(one))(jnp.repeat(masses, 15), np.tile(SPEEDS[:15], 3))
    np.testing.assert_allclose(grid.reshape(45, -1), flat, rtol=1e-9, atol=1e-12)


@pytest.mark.exhaustive
def test_gradients_through_a_batch():
    """Reverse mode of a mean over cases is the mean of theirs, to what rounding makes of steps."""
    model = jb.PlanarRod(2)

    def peak(bending, speed):
        return jnp.sum(run(model, speed, bending=bending)[0] ** 2)

    def mean(bending):
        return jnp.mean(jax.vmap(lambda s: peak(bending, s))(SPEEDS))

    value, slope = jax.jit(jax.value_and_grad(mean))(566.0)
    each = jax.jit(jax.value_and_grad(peak))
    alone = np.array([each(566.0, s) for s in SPEEDS])
    np.testing.assert_allclose([value, slope], alone.mean(0), rtol=1e-4)
