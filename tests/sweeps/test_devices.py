"""The same numbers on one device, on many, and in several processes."""

import json
import socket
import subprocess
import sys
import textwrap

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb

BEAM = jb.Beam.from_slenderness(70.0)
CASES = jb.grid(hub_radius=np.linspace(0.0, 2.0, 7), tip_mass=[0.0, 0.3, float("nan"), -1.0, 1.0])
WHICH = jb.labels(in_plane=2)
SMALL = jb.Hybrid(2, 3, 0)


def found_modes(hub_radius, tip_mass):
    return jb.modes(SMALL, jb.Rotor(BEAM, hub_radius, tip_mass), 3.0, WHICH, throw=False)


def raising(hub_radius, tip_mass):
    return jb.modes(SMALL, jb.Rotor(BEAM, hub_radius, tip_mass), 3.0, WHICH).frequency


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


def assert_same(one: jb.Table, other: jb.Table) -> None:
    """To the last bit, NaN among them."""
    assert one.values.keys() == other.values.keys()
    for name in one.values:
        assert one[name].tobytes() == other[name].tobytes(), name
    assert one.errors == other.errors
    assert one.dims == other.dims


@pytest.mark.slow
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
    [found_modes, *(pytest.param(f, marks=pytest.mark.slow) for f in (modulated, fitted))],
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


@pytest.mark.slow
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


# What each of two processes does; a port and its own number are given.
PROCESS = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", 2)
port, me, out = sys.argv[1], int(sys.argv[2]), sys.argv[3]
jax.distributed.initialize(f"127.0.0.1:{port}", 2, me)
import json
import jaxbeam as jb
from tests.sweeps.test_devices import CASES, found_modes, raising
assert len(jax.devices()) == 4 and len(jax.local_devices()) == 2

for name, function in (("modes", found_modes), ("raising", raising)):
    jb.sweep(function, CASES, chunk=4, devices=jax.devices()).save(f"{out}/{name}{me}.npz")
for again in range(2):
    table = jb.sweep(found_modes, CASES, chunk=4, devices=jax.devices(), folder=f"{out}/kept")
    table.save(f"{out}/kept{again}{me}.npz")
alone = jb.sweep(found_modes, CASES, chunk=4, devices=jax.local_devices())  # not in step
alone.save(f"{out}/alone{me}.npz")

said = []
for cases, devices, folder in (
    (CASES, jax.devices(), f"{out}/other"),  # holds something else
    (jb.grid(hub_radius=[0.0, 1.0 + me], tip_mass=[0.0]), jax.devices(), None),
    (CASES, jax.devices(), f"{out}/private{me}"),  # not shared
    (CASES, jax.devices()[2 * me :] + jax.devices()[: 2 * me], None),
    (CASES, jax.devices()[2 * me :] + (1 + me) * jax.devices()[: 2 * me], None),
    (CASES, jax.devices(), "another function"),
):
    another = folder == "another function"
    function = (found_modes, raising)[me] if another else found_modes
    try:
        folder = None if another else folder
        jb.sweep(function, cases, chunk=4, devices=devices, folder=folder)
    except Exception as error:
        said.append(f"{type(error).__name__}: {error}")
print(json.dumps(said))
"""


@pytest.mark.slow
def test_two_processes(tmp_path):
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").touch()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    command = [sys.executable, "-c", textwrap.dedent(PROCESS), port]
    processes = [
        subprocess.Popen([*command, str(i), str(tmp_path)], stdout=subprocess.PIPE, text=True)
        for i in range(2)
    ]
    try:
        said = [p.communicate(timeout=300)[0] for p in processes]
    finally:
        for p in processes:
            p.kill()
    assert [p.returncode for p in processes] == [0, 0]
    one = jb.sweep(found_modes, CASES, chunk=4)
    for me in range(2):
        for name in ("modes", "kept0", "kept1", "alone"):
            assert_same(one, jb.Table.load(tmp_path / f"{name}{me}.npz"))
        raised = jb.Table.load(tmp_path / f"raising{me}.npz")
        assert_same(jb.sweep(raising, CASES, chunk=4), raised)
    assert_same(one, jb.Table.load(tmp_path / "kept"))
    first, second = (json.loads(text.splitlines()[-1]) for text in said)
    assert "other holds files that are not of a sweep" in first[0]
    assert second[0].startswith("RuntimeError: process 0 failed: ValueError")
    for i in (1, 3, 4, 5):
        assert first[i] == second[i]
        assert first[i].startswith("ValueError: processes must run the same")
    assert first[2].startswith("RuntimeError: process 1 failed: ValueError")
    assert "private1 must be in a file system that all processes share" in second[2]
