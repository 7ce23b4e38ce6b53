"""The same numbers on one device and on many."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.sweeps.common import BEAM, CASES, SMALL, WHICH, assert_same, found_modes, raising
from tests.tiers import exhaustive, slow


def lowest(hub_radius, tip_mass):
    return jb.modes(jb.Hybrid(4, 8, 0), jb.Rotor(BEAM, hub_radius, tip_mass), 3.0, 2, throw=False)


def spun_up(hub_radius, tip_mass):
    motion, times = jb.SmoothSpinUp(0.5, 8.0), jnp.linspace(0.0, 10.0, 11)
    rotor = jb.Rotor(BEAM, hub_radius, tip_mass)
    run = jb.simulate(jb.Hybrid(0, 2, 0), rotor, motion, times, throw=False)
    return {"tip": run.tip, "status": run.status}


def modulated(hub_radius, tip_mass):
    motion = jb.motions.ModulatedSpeed(1.0, 0.3, 5.0)
    model, rotor = jb.Hybrid(0, 2, 0), jb.Rotor(BEAM, hub_radius, tip_mass)
    return jb.floquet(model, rotor, motion, throw=False)


def fitted(hub_radius, tip_mass):
    def experiment(stiffness):
        rotor = jb.Rotor(jb.Beam(1.0, 1.0, 4900.0, stiffness, 1.0), hub_radius, tip_mass)
        return jb.FrequencyData(SMALL, rotor, [0.0, 2.0], [[3.4], [4.0]], 0.1, WHICH[:1])

    return jb.fit(experiment, {"stiffness": jb.FreeParameter(0.9)}, throw=False)


@pytest.mark.exhaustive
@pytest.mark.parametrize("function", [found_modes, raising, lowest, spun_up])
def test_eight_devices(function):
    devices = jax.devices()
    assert len(devices) == 8
    one = jb.sweep(function, CASES, chunk=4)
    assert_same(one, jb.sweep(function, CASES, chunk=4, devices=devices))
    bad = jb.Status.RAISED if function is raising else jb.Status.INVALID_TIP_MASS
    np.testing.assert_array_equal(one["status"][0], [0, 0, bad, bad, 0])
    assert len(one.errors) == (14 if function is raising else 0)


@pytest.mark.parametrize(
    "function",
    [slow(found_modes), *(exhaustive(f) for f in (modulated, fitted))],
)
def test_two_devices_and_one_named_twice(function):
    """Uneven: nine chunks for three, the last of three cases."""
    one = jb.sweep(function, CASES, chunk=4)
    first, second = jax.devices()[:2]
    assert_same(one, jb.sweep(function, CASES, chunk=4, devices=[first, second, first]))
    assert (one["status"] == 0).sum() == 21


@pytest.mark.slow
def test_more_devices_than_chunks():
    one = jb.sweep(found_modes, CASES, chunk=20)
    assert_same(one, jb.sweep(found_modes, CASES, chunk=20, devices=3 * jax.devices()[:1]))


def test_each_device_compiles_once():
    traces = 0

    def f(a):
        nonlocal traces
        traces += 1
        return 2 * a

    cases = jb.grid(a=np.arange(40.0))
    table = jb.sweep(f, cases, chunk=3, devices=3 * jax.devices()[:2])
    np.testing.assert_array_equal(table["value"], 2 * np.arange(40.0))
    assert traces == 1


def test_errors_reach_the_caller():
    def f(a):
        return jax.pure_callback(lambda a: 1 / 0, a, a, vmap_method="sequential")

    with pytest.raises(jax.errors.JaxRuntimeError, match="ZeroDivisionError"):
        jb.sweep(f, jb.grid(a=np.arange(9.0)), chunk=2, devices=jax.devices()[:2])


def test_each_case_has_its_own_message():
    """Though many raise at once."""

    def f(a):
        sentences = [f"no {kind}" for kind in "abcd"]
        return eqx.branched_error_if(a, a > 3, (a % 4).astype(int), sentences)

    cases = jb.grid(a=np.arange(100.0))
    table = jb.sweep(f, cases, chunk=2, devices=4 * jax.devices()[:1])
    assert table.errors == {i: f"no {'abcd'[i % 4]}" for i in range(4, 100)}


def test_arrays_bound_to_a_device_move_to_others():
    bound = jax.device_put(jnp.asarray(3.0), jax.devices()[2])
    function = jax.tree_util.Partial(lambda factor, a: factor * a, bound)
    table = jb.sweep(function, jb.grid(a=np.arange(9.0)), chunk=2, devices=jax.devices()[:2])
    np.testing.assert_array_equal(table["value"], 3 * np.arange(9.0))


@pytest.mark.exhaustive
def test_ladder_sweep_takes_devices():
    def situation(tip_mass):
        question = jb.ladder.ModalFrequencies(1.0, WHICH)
        return jb.Rotor(BEAM, 0.0, tip_mass), question

    cases = jb.grid(tip_mass=np.linspace(0.0, 1.0, 9))
    one, two = (
        jb.ladder_sweep(situation, cases, 1e-2, chunk=4, representatives=2, devices=devices)
        for devices in (None, 2 * jax.devices()[:1])
    )
    assert_same(one, two)


def test_bad_devices():
    for bad in ([], ["cpu"], jax.devices()[0]):
        with pytest.raises(TypeError, match=r"devices must be some of jax.devices\(\)"):
            jb.sweep(lambda a: a, jb.grid(a=[1]), devices=bad)


def test_precision_of_a_context_manager_does_not_reach_threads():
    with (
        jax.enable_x64(False),
        pytest.raises(RuntimeError, match="settings made by a context manager"),
    ):
        jb.sweep(lambda a: a, jb.grid(a=[1, 2]), chunk=1, devices=2 * jax.devices()[:1])
