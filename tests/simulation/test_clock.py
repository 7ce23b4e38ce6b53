"""Late times: a run at 1.7e9 s, as clocks of computers show it, is the same run."""

from pathlib import Path

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.beams import README_ROTOR
from tests.helpers import run_optimised
from tests.simulation.common import TIGHT

A2, A3 = jnp.array([0.0, 1.0, 0.0]), jnp.array([0.0, 0.0, 1.0])
MODEL = jb.Hybrid(0, 2, 0)
LATE = 1.7e9
# A thousand samples a second by a late clock, whose times are rounded to 2.4e-7 s.
BY_CLOCK = LATE + np.linspace(0.0, 0.2, 201)
SINCE = BY_CLOCK - LATE
OUT = np.array([0, 57, 200])


@pytest.mark.slow
def test_a_measured_speed_by_a_late_clock():
    """No time is lost, and none is rounded."""

    @jax.jit
    def found(shift):
        table = jb.motions.TabulatedSpeed(SINCE + shift, 2.0 * np.sin(15.0 * SINCE) ** 2)
        run = jb.simulate(MODEL, README_ROTOR, table, SINCE[OUT] + shift, throw=False)
        return run.tip[:, 1], run.status, run.times

    (early, ok, _), (late, also, times) = found(0.0), found(LATE)
    assert ok == also == jb.Status.OK
    np.testing.assert_array_equal(times, BY_CLOCK[OUT])
    np.testing.assert_allclose(late, early, rtol=0, atol=1e-9)
    assert abs(early[1:]).min() > 1e-3


@pytest.mark.exhaustive
def test_times_that_differ_by_rounding_are_one():
    """A sum of three thousand steps ends beside the end of the spin-up."""
    found = jax.jit(
        lambda at: jb.simulate(
            MODEL,
            README_ROTOR,
            jb.SmoothSpinUp(2.0, 3.0),
            [0.0, 5.0],
            loads=jb.Loads(tip_force=A2, changes=at),
            throw=False,
        )
    )
    almost = np.cumsum(np.full(3000, 1e-3))[-1:]
    assert 0 < abs(almost[0] - 3.0) < 1e-11
    one, two = found(almost), found(np.array([3.0]))
    assert one.status == two.status == jb.Status.OK
    np.testing.assert_allclose(one.tip, two.tip, rtol=0, atol=1e-9)


def struck(shift, delay, how):
    """Impulses of the hub, one as the run begins, and a push, by a user's functions of time."""
    at = shift + jnp.array([0.0, 0.25, 0.5]) + delay * jnp.array([0.0, 1.0, 0.0])
    motion = jb.motions.HubVelocity(
        lambda t: jnp.zeros(3), lambda t: 0.3 * jnp.sum(jnp.where(t > at, 1.0, 0.0)) * A3, jumps=at
    )
    push = jb.Loads(tip_force=lambda t: jnp.where(t > at[1], 0.1, 0.0) * A2, jumps=at[1:2])
    times = shift + jnp.array([0.0, 0.25, 0.3125, 0.625])
    return jb.simulate(MODEL, README_ROTOR, motion, times, loads=push, throw=False, **how)


@pytest.mark.exhaustive
@pytest.mark.parametrize("solver", [None, diffrax.Dopri8()], ids=["own", "diffrax"])
def test_jumps_by_a_late_clock(solver):
    """Each strikes once, on its own side, and gradients by its time are right."""
    how = {"solver": solver, "stepsize_controller": TIGHT}

    @jax.jit
    def found(shift, delay):
        run = struck(shift, delay, how)
        return jnp.concatenate([run.tip[:, 1], run.state.v[1:, 1], run.hub_torque[:, 2]]), run

    values, run = zip(*(found(shift, 0.0) for shift in (0.0, LATE)), strict=True)
    assert run[0].status == run[1].status == jb.Status.OK
    np.testing.assert_allclose(values[1], values[0], rtol=1e-6, atol=1e-6 * abs(values[0][3]))
    slope = jax.jit(jax.jacrev(lambda delay: found(LATE, delay)[0][3]))(0.0)
    later, sooner = (found(0.0, delay)[0][3] for delay in (1e-3, -1e-3))
    expected = (later - sooner) / 2e-3
    np.testing.assert_allclose(slope, expected, rtol=1e-4)


@pytest.mark.exhaustive
def test_what_users_ask_is_by_their_clock():
    """Events, functions of `SaveAt`, dense output and controllers."""
    motion = jb.SmoothSpinUp(2.0, 3.0)
    late = jb.motions.HubVelocity(
        lambda t: jnp.zeros(3), lambda t: motion.angular_speed(t - LATE) * A3, changes=[LATE]
    )
    times = LATE + np.linspace(0.0, 2.0, 5)

    def run(**how):
        return jb.simulate(MODEL, README_ROTOR, late, times, **how)

    def at(t, y, args, **_):
        return (t - LATE - 1.0) + 0.0 * args.hub(t).velocity[0]

    ended = run(event=diffrax.Event(at, jb.deflection_limit(1.0).root_finder))
    np.testing.assert_allclose(ended.end_time - LATE, 1.0, atol=1e-6)

    def speed(t, y, args):
        return args.hub(t).angular_velocity[2]

    saved = run(saveat=diffrax.SaveAt(ts=jnp.asarray(times), fn=speed)).solution
    np.testing.assert_allclose(
        saved.ys, jax.vmap(motion.angular_speed)(jnp.asarray(times) - LATE), rtol=1e-6
    )
    plain, dense = run(), run(saveat=diffrax.SaveAt(dense=True))
    np.testing.assert_allclose(dense.tip[:, 1], plain.tip[:, 1], rtol=1e-6)
    between = dense.solution.evaluate(LATE + 1.25).q, dense.solution.t0, dense.solution.t1
    assert np.isfinite(between[0]).all()
    np.testing.assert_array_equal(between[1:], times[[0, -1]])
    fixed = run(stepsize_controller=diffrax.StepTo(jnp.linspace(times[0], times[-1], 201)))
    np.testing.assert_allclose(fixed.tip[:, 1], plain.tip[:, 1], rtol=1e-4)
    clipped = diffrax.ClipStepSizeController(TIGHT, jump_ts=jnp.asarray(times[1:3]))
    np.testing.assert_allclose(
        run(stepsize_controller=clipped).tip[:, 1], plain.tip[:, 1], rtol=1e-4
    )


ROOT = Path(__file__).parents[2]
TABLES = """
import sys, jax
jax.config.update("jax_enable_x64", sys.argv[1] == "64")
import numpy as np, jaxbeam as jb
from tests.beams import README_ROTOR as rotor

for count in 201, 1001, 2001:
    seconds = np.linspace(0.0, 200.0, count)
    table = jb.motions.TabulatedSpeed(seconds, 3.0 * np.sin(seconds / 7.0) ** 2)
    how = {"damping": jb.Damping(0.05), "throw": False}
    run = jb.simulate(jb.Hybrid(0, 3, 0), rotor, table, np.linspace(0.0, 200.0, 41), **how)
    print(int(run.status), *np.asarray(run.tip[:, 1], float))
"""


@pytest.mark.exhaustive
def test_tables_in_32_bits():
    """More corners are no more errors than 32 bits have."""
    tips = {}
    for bits in "64", "32":
        lines = run_optimised("-c", TABLES, bits, level=0, cwd=ROOT).splitlines()
        status, *values = np.array([line.split() for line in lines], float).T
        np.testing.assert_array_equal(status, jb.Status.OK)
        tips[bits] = np.array(values)
    largest = abs(tips["64"]).max(0)
    assert largest.min() > 0.1
    off = abs(tips["32"] - tips["64"]).max(0) / largest
    np.testing.assert_array_less(off, 3e-3)
