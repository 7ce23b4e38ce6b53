"""Sweeps into a folder: nothing is lost, nothing is misread."""

import contextlib
import errno
import functools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._sweeps import identity, store, sweep
from jaxbeam._sweeps.identity import program_of
from tests.helpers import environment, run_optimised
from tests.sweeps.common import READERS, assert_same

CASES = jb.grid(a=np.linspace(0.0, 1.0, 10), b=[0.0, 1.0, float("nan")])


def function(a, b):
    a = eqx.error_if(a, (a > 0.5) & (b == 1), "too much")
    return {
        "sum": a + b,
        "wave/length": jnp.exp(1j * a * jnp.arange(3)),
        "flag": a > 0.5,
        "none": jnp.zeros((0,)),
        "file": jnp.stack([a, b]),
    }


DIMS = {"file": {"which": ["a", "b"]}}


def run(folder, function=function, cases=CASES, **how):
    return jb.sweep(function, cases, **{"chunk": 4, "dims": DIMS, **how}, folder=folder)


@pytest.fixture
def computed(monkeypatch):
    """Numbers of the chunks that are computed."""
    numbers = []
    original = sweep._Job.columns

    def counting(job, number):
        numbers.append(number)
        return original(job, number)

    monkeypatch.setattr(sweep._Job, "columns", counting)
    return numbers


@pytest.mark.release
def test_the_same_table_from_a_folder(tmp_path, computed):
    table = jb.sweep(function, CASES, chunk=4, dims=DIMS)
    assert len(table.errors) == 5
    for devices in (None, jax.devices()[:3]):
        folder = tmp_path / str(devices)
        assert_same(table, run(folder, devices=devices))
        computed.clear()
        assert_same(table, run(folder))
        assert_same(table, jb.Table.load(folder))
        assert computed == []
    loaded = jb.Table.load(folder)
    assert isinstance(loaded["sum"], np.memmap)
    assert loaded.message(a=1, b=1) == "too much"
    loaded.to_csv(tmp_path / "a.csv")
    table.to_csv(tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_text() == (tmp_path / "b.csv").read_text()
    np.testing.assert_array_equal(np.load(folder / "sum.npy").reshape(10, 3), table["sum"])


def test_explicit_lists(tmp_path):
    cases = jb.points(a=[1.0, 0.3, 0.3], b=[0.0, float("nan"), 2.0])
    table = run(tmp_path / "list", cases=cases, chunk=2)
    assert_same(table, jb.sweep(function, cases, chunk=2, dims=DIMS))
    assert_same(table, jb.Table.load(tmp_path / "list"))


def flip(path, place):
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


def cut(path, much):
    os.truncate(path, path.stat().st_size - much)


DAMAGES = {
    "flipped bit of the second chunk": (lambda f: flip(f / "sum.npy", 128 + 4 * 8 + 5), [1]),
    "truncated array": (lambda f: os.truncate(f / "wave%2Flength.npy", 128 + 9 * 48), range(2, 8)),
    "damaged header": (lambda f: flip(f / "flag.npy", 12), range(8)),
    "missing array": (lambda f: (f / "status.npy").unlink(), range(8)),
    "missing index": (lambda f: (f / "index.txt").unlink(), range(8)),
    "flipped bit in the index": (lambda f: flip(f / "index.txt", 20), [0]),
    "torn index": (lambda f: cut(f / "index.txt", 9), [7]),
    "damaged cases": (lambda f: flip(f / "cases.npz", 100), []),
    "missing cases": (lambda f: (f / "cases.npz").unlink(), []),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_found_and_mended(damage, tmp_path, computed):
    table = run(tmp_path / "kept")
    harm, again = DAMAGES[damage]
    harm(tmp_path / "kept")
    with pytest.raises(ValueError, match="run the same sweep again"):
        jb.Table.load(tmp_path / "kept")
    computed.clear()
    assert_same(table, run(tmp_path / "kept"))
    assert computed == list(again)
    computed.clear()
    assert_same(table, run(tmp_path / "kept"))
    assert computed == []


def other_function(a, b):
    return {**function(a, b), "sum": a + 1.0000000001 * b}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"function": other_function}, "program"),
        ({"cases": jb.grid(a=np.linspace(0.0, 1.0, 10), b=[0.0, 1.0, 2.0])}, "parameters"),
        ({"chunk": 5}, r"chunk \(there 4, here 5\)"),
        ({"dims": {}}, "dims"),
    ],
)
def test_the_folder_of_another_sweep_is_refused(change, said, tmp_path):
    table = run(tmp_path / "kept")
    with pytest.raises(ValueError, match=f"belongs to another sweep, of .*in.*{said}"):
        run(tmp_path / "kept", **change)
    assert_same(table, jb.Table.load(tmp_path / "kept"))


@pytest.mark.parametrize(
    ("name", "there"),
    [("precision", "float32"), ("versions", {"jax": "0.1"}), ("platform", "tpu"), ("format", 0)],
)
def test_results_of_other_circumstances_are_refused(name, there, tmp_path):
    run(tmp_path / "kept")
    path = tmp_path / "kept" / "sweep.json"
    told = {**json.loads(path.read_text()), name: there}
    del told["check"]
    path.write_text(json.dumps({**told, "check": store._digest(told)}))
    with pytest.raises(ValueError, match=f"belongs to another sweep, of .*different in {name}"):
        run(tmp_path / "kept")
    if name == "format":
        with pytest.raises(ValueError, match="have the format 0"):
            jb.Table.load(tmp_path / "kept")


def test_order_matters(tmp_path):
    """Of parameters, and of dimensions of a result that are as long."""

    def square(a, b):
        return jnp.eye(2) * (a + 10 * b)

    axes, names = {"a": [1, 2, 3], "b": [0, 1]}, {"x": ["p", "q"], "y": ["r", "s"]}
    table = jb.sweep(square, jb.grid(**axes), dims={"value": names}, folder=tmp_path / "kept")
    turned = dict(reversed(axes.items()))
    with pytest.raises(ValueError, match="different in parameters"):
        jb.sweep(square, jb.grid(**turned), dims={"value": names}, folder=tmp_path / "kept")
    turned = {"value": dict(reversed(names.items()))}
    with pytest.raises(ValueError, match="different in dims"):
        jb.sweep(square, jb.grid(**axes), dims=turned, folder=tmp_path / "kept")
    assert_same(table, jb.Table.load(tmp_path / "kept"))


def test_cases_of_another_sweep_are_not_taken(tmp_path):
    for name, shift in (("one", 0.0), ("two", 1.0)):
        run(tmp_path / name, cases=jb.grid(a=[0.1 + shift], b=[0.0, 2.0]))
    cases = (tmp_path / "two" / "cases.npz").read_bytes()
    (tmp_path / "one" / "cases.npz").write_bytes(cases)
    with pytest.raises(ValueError, match=r"cases\.npz is missing or damaged"):
        jb.Table.load(tmp_path / "one")


def test_names_that_some_file_systems_confuse(tmp_path):
    with pytest.raises(ValueError, match="differ in more than case"):
        run(tmp_path / "kept", lambda a, b: {"x": a, "X": b}, dims={})


def test_bound_arrays_and_what_is_read_tell_sweeps_apart(tmp_path):
    def scaled(factor, a, b):
        return factor * a

    bound = [jax.tree_util.Partial(scaled, jnp.asarray(f)) for f in (2.0, 3.0)]
    run(tmp_path / "kept", bound[0], dims={})
    with pytest.raises(ValueError, match="different in program"):
        run(tmp_path / "kept", bound[1], dims={})
    model = jb.Hybrid(0, 2, 0)
    rotor = jb.Rotor(jb.Beam.from_slenderness(70.0), 0.25)

    def frequency(a, b):
        return jb.modes(model, rotor, a, 1, throw=False).frequency

    run(tmp_path / "modes", frequency, dims={}, cases=jb.grid(a=[0.0], b=[0.0]))
    told = json.loads((tmp_path / "modes" / "sweep.json").read_text())
    assert told["function"].endswith("frequency")
    assert told["reads"]["model"] == "Hybrid(n_stretch=0, n_in_plane=2, n_flap=0)"
    assert "hub_radius=0.25" in told["reads"]["rotor"]
    assert told["precision"] == "float64"
    assert told["versions"]["jax"] == jax.__version__


@pytest.mark.parametrize("reader", READERS)
def test_constants_are_found_wherever_they_stand(reader):
    read, numbers = READERS[reader], np.append(np.arange(5.0), 0.123)
    for constant in (numbers, jnp.asarray(numbers)):
        traced = jax.make_jaxpr(functools.partial(read, constant))(0.5)
        assert any(np.array_equal(numbers, found) for found in identity._constants(traced))


APART = """
import numpy as np, jax, jax.numpy as jnp
from jaxbeam._sweeps.identity import program_of
from tests.sweeps.common import READERS
assert jax.config.jax_use_simplified_jaxpr_constants
for read in READERS.values():
    for kind in (np.asarray, jnp.asarray):
        constants = [kind(np.append(np.arange(5.0), x)) for x in (1, 1, 2)]
        functions = [lambda a, c=c: read(c, a) for c in constants]
        assert len({program_of(f, {"a": jnp.zeros(1)})["program"] for f in functions}) == 2
"""


@pytest.mark.exhaustive
def test_constants_that_are_arguments_of_programs_tell_sweeps_apart():
    """As a setting of JAX makes them, which is read when it is imported."""
    settings = {"JAX_USE_SIMPLIFIED_JAXPR_CONSTANTS": "1", "JAX_ENABLE_X64": "1"}
    there = environment(HASTY) | settings
    subprocess.run([sys.executable, "-c", APART], env=there, check=True, timeout=600)


def test_a_key_that_is_closed_over_tells_sweeps_apart(tmp_path):
    def noisy(key, a):
        return a + jax.random.normal(key)

    one, other = jax.random.key(0), jax.random.key(1)
    cases = jb.grid(a=[0.5])
    table = jb.sweep(lambda a: noisy(one, a), cases, folder=tmp_path / "kept")
    np.testing.assert_allclose(table["value"], 0.5 + jax.random.normal(one), rtol=1e-14)
    with pytest.raises(ValueError, match="different in program"):
        jb.sweep(lambda a: noisy(other, a), cases, folder=tmp_path / "kept")
    bound = [jax.tree_util.Partial(noisy, key) for key in (one, one, other)]
    assert len({program_of(each, {"a": jnp.zeros(1)})["program"] for each in bound}) == 2
    with pytest.raises(TypeError, match=r"numbers, but value is of key<fry>.*key_data\(key\)"):
        jb.sweep(lambda a: jax.random.fold_in(one, 1), cases)


def test_numbers_of_types_that_numpy_has_not(tmp_path):
    """They are kept by the shortest type that holds them, and NaN among them is seen."""
    wide = dict.fromkeys(["bfloat16", "float8_e5m2", "float8_e4m3fn"], np.float32)
    kinds = {**wide, "int4": np.int8, "uint4": np.uint8, "float16": np.float16, "int8": np.int8}

    def short(a):
        return {kind: a.astype(kind) for kind in kinds}

    cases = jb.grid(a=[1.0, 2.5, 7.0, float("nan")])
    table = jb.sweep(short, cases, chunk=3, folder=tmp_path / "kept")
    assert_same(table, jb.Table.load(tmp_path / "kept"))
    table.save(tmp_path / "kept.npz")
    assert_same(table, jb.Table.load(tmp_path / "kept.npz"))
    assert_same(table, jb.sweep(short, cases, chunk=3))
    assert table["status"].tolist() == [0, 0, 0, jb.Status.NOT_FINITE]
    for kind, kept in kinds.items():
        assert table[kind].dtype == kept
        np.testing.assert_array_equal(table[kind][:3], [1, 2 if "int" in kind else 2.5, 7])


@pytest.mark.parametrize("described", ["<V2", "<f1"])
def test_a_folder_of_numbers_that_cannot_be_told_says_so(described, tmp_path):
    """Such as were once written for bfloat16 and float8."""
    jb.sweep(lambda a: a, jb.grid(a=[1.0]), folder=tmp_path / "kept")
    path = tmp_path / "kept" / "sweep.json"
    told = json.loads(path.read_text())
    told["results"]["value"][0] = described
    del told["check"]
    path.write_text(json.dumps({**told, "check": store._digest(told)}))
    with pytest.raises(ValueError, match=r"value was written as .*another folder"):
        jb.Table.load(tmp_path / "kept")


def before_chunk(monkeypatch, number, happens):
    """Has something happen once, while a sweep is under way."""
    original, left = sweep._Job.columns, [happens]

    def columns(job, now):
        if now == number and left:
            left.pop()()
        return original(job, now)

    monkeypatch.setattr(sweep._Job, "columns", columns)


GONE = "kept was removed, or taken over .* run it again"


@pytest.mark.parametrize("how", ["folder", "renamed", "contents", "sweep.json"])
def test_a_folder_removed_under_its_sweep(how, tmp_path, monkeypatch):
    folder = tmp_path / "kept"

    def happens():
        if how == "renamed":
            folder.rename(tmp_path / "elsewhere")
        elif how == "folder":
            shutil.rmtree(folder)
        else:
            for path in folder.glob("*" if how == "contents" else how):
                path.unlink()

    before_chunk(monkeypatch, 4, happens)
    with pytest.raises(RuntimeError, match=GONE):
        run(folder)
    if how == "renamed":  # it goes on there
        assert_same(run(tmp_path / "elsewhere"), run(None))


def interrupted(*_):
    raise InterruptedError


@pytest.mark.parametrize("so_far", [0, 2, 8])
@pytest.mark.parametrize("second", [other_function, function])
def test_a_folder_taken_over(second, so_far, tmp_path, monkeypatch):
    """By a sweep that began when it had been removed under the first one: each gets its own."""
    folder, original = tmp_path / "kept", sweep._Job.columns

    def happens():
        shutil.rmtree(folder)
        before_chunk(monkeypatch, so_far, interrupted)
        with contextlib.suppress(InterruptedError):
            run(folder, second)
        monkeypatch.setattr(sweep._Job, "columns", original)

    before_chunk(monkeypatch, 4, happens)
    if second is function and so_far == 8:  # these are its own
        assert_same(run(folder), run(None))
    else:
        said = "are missing or damaged; run the same sweep again" if second is function else GONE
        with pytest.raises((RuntimeError, ValueError), match=said):
            run(folder)
    assert_same(run(folder, second), run(None, second))


@pytest.mark.parametrize("what", ["a chunk of another sweep", "a missing file", "a flipped bit"])
def test_what_others_did_while_it_ran_is_found(what, tmp_path, monkeypatch, computed):
    """In the moment between a look at the folder and writing to it, too."""
    folder = tmp_path / "kept"
    run(folder, other_function)
    late = store.reopened(folder)[0]
    part = store.ChunkResults({name: spec.blank(4) for name, spec in late.specs.items()}, {})
    shutil.rmtree(folder)

    def happens():
        if what == "a missing file":
            (folder / "sum.npy").unlink()
        elif what == "a flipped bit":
            flip(folder / "sum.npy", 128 + 3 * 8)
        else:
            monkeypatch.setattr(store.ResultFolder, "_must_be_ours", lambda _: None)
            late.put(0, part)

    before_chunk(monkeypatch, 4, happens)
    with pytest.raises(ValueError, match="chunks are missing or damaged; run the same sweep again"):
        run(folder)
    monkeypatch.undo()
    assert_same(run(folder), run(None))


def test_other_folders_are_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(ValueError, match="holds files that are not of a sweep"):
        run(tmp_path)
    with pytest.raises(ValueError, match="is not the folder of a sweep"):
        jb.Table.load(tmp_path)
    with pytest.raises(OSError, match=r"cannot write to .*thesis\.tex"):
        run(tmp_path / "thesis.tex")
    run(tmp_path / "kept")
    whole = (tmp_path / "kept" / "sweep.json").read_text()
    for damaged in (whole[:30], whole.replace('"a"', '"c"', 1)):
        (tmp_path / "kept" / "sweep.json").write_text(damaged)
        with pytest.raises(ValueError, match=r"sweep\.json is damaged"):
            run(tmp_path / "kept")


def test_begun_folders(tmp_path):
    """Killed while it was made: empty, or with a file that was not yet in place."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "begun").mkdir()
    (tmp_path / "begun" / ".new-sweep.json.123").write_text("{")
    assert_same(run(tmp_path / "empty"), run(tmp_path / "begun"))


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
@pytest.mark.parametrize("where", ["array", "index"])
def test_a_disk_that_fails(number, where, tmp_path, monkeypatch, computed):
    """In the middle of the fourth chunk, with part of it written."""
    table = run(None)
    left = [3 * len(table.values) if where == "array" else 3]

    class Full:
        def __init__(self, file):
            self.file = file

        def __getattr__(self, name):
            return getattr(self.file, name)

        def __enter__(self):
            return self

        def __exit__(self, *_):
            self.file.close()

        def write(self, data):
            if len(data) > 100 and data[:6] == b"\x93NUMPY":
                return self.file.write(data)
            left[0] -= 1
            if left[0] < 0:
                self.file.write(data[: len(data) // 2])
                raise OSError(number, os.strerror(number))
            return self.file.write(data)

    def failing(path, mode):
        file = open(path, mode)  # noqa: SIM115
        wanted = {"array": ".npy", "index": ".txt"}[where]
        return Full(file) if str(path).endswith(wanted) and mode != "rb" else file

    monkeypatch.setattr(store, "open", failing, raising=False)
    with pytest.raises(OSError, match=f"cannot write to .*kept: {os.strerror(number)}") as failure:
        run(tmp_path / "kept")
    assert failure.value.errno == number
    monkeypatch.setattr(store, "open", open)
    computed.clear()
    assert_same(table, run(tmp_path / "kept"))
    assert computed == [3, 4, 5, 6, 7]


REAL = """
import subprocess, sys
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp, numpy as np, jaxbeam as jb
disk, cases = sys.argv[1], jb.grid(a=np.arange(1000.0))
def mount(*options):
    subprocess.run(["mount", "-t", "tmpfs", "-o", ",".join(options), "none", disk], check=True)
def function(a):
    return a * jnp.arange(100.0)
def run():
    try:
        return jb.sweep(function, cases, chunk=50, folder=disk + "/kept")
    except OSError as error:
        print(error.errno, error, flush=True)
def chunks():
    return len(open(disk + "/kept/index.txt").readlines())
mount("size=500k")
run()
print(chunks())
mount("remount", "ro", "size=500k")
run()
mount("remount", "rw", "size=5m")
assert chunks() > 5
table = run()
np.testing.assert_array_equal(table["value"], np.arange(1000.0)[:, None] * np.arange(100.0))
mount("remount", "ro")
assert run()["value"].tobytes() == table["value"].tobytes()
"""


@pytest.mark.slow
def test_a_disk_that_is_full_and_one_that_is_read_only(tmp_path):
    """Real ones, in a mount namespace of their own."""
    prefix = ["unshare", "--mount"] if os.geteuid() == 0 else ["unshare", "-Urm"]
    try:
        possible = subprocess.run([*prefix, "mount", "-t", "tmpfs", "none", tmp_path]).returncode
    except FileNotFoundError:
        possible = 1
    if possible:
        pytest.skip("no right to mount a file system here")
    command = [*prefix, sys.executable, "-c", REAL, str(tmp_path)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=600, check=True)
    full, chunks, read_only = done.stdout.splitlines()
    assert full.startswith(f"{errno.ENOSPC} [Errno {errno.ENOSPC}] cannot write to ")
    assert "No space left on device" in full
    assert 5 < int(chunks) < 20
    assert read_only.startswith(f"{errno.EROFS} [Errno {errno.EROFS}] cannot write to ")
    assert "Read-only file system" in read_only


KILLED = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
import jaxbeam as jb
from jaxbeam._sweeps import identity, store, sweep
from jaxbeam._sweeps.identity import program_of
from tests.sweeps.common import MANY, spin
jb.sweep(spin, MANY, chunk=4, folder=sys.argv[1])
"""
HASTY = 0  # to be there soon is what counts


@pytest.mark.exhaustive
def test_killed_at_twenty_moments(tmp_path):
    """One sweep killed twenty times while it writes, at random; the same bits in the end."""
    seed = random.randrange(2**32)
    print("seed", seed)  # shown on failure
    moments = random.Random(seed)
    folder, index = tmp_path / "kept", tmp_path / "kept" / "index.txt"
    command = "-c", KILLED

    def finished():
        return index.read_bytes().count(b"\n") if index.exists() else 0

    for _ in range(20):
        before = finished()
        process = subprocess.Popen(
            [sys.executable, *command, folder], stderr=subprocess.DEVNULL, env=environment(HASTY)
        )
        deadline = time.monotonic() + 120
        wanted = before + moments.choice([0, 1, 1, 2, 3])
        while finished() < wanted and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.001)
        time.sleep(moments.uniform(0.0, 0.006))
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        assert finished() >= before  # nothing is lost
    assert 20 <= finished() < 250
    for place in (folder, tmp_path / "at once"):
        run_optimised(*command, place, level=HASTY, timeout=600)
    assert_same(jb.Table.load(tmp_path / "at once"), jb.Table.load(folder))
    # No finished chunk was computed again: at most one is lost where a process is killed.
    lines = [line.partition(b" ") for line in index.read_bytes().split(b"\n")]
    whole = [json.loads(text)["chunk"] for check, _, text in lines if check == store._check(text)]
    assert sorted(whole) == list(range(250))


MILLION = """
import jax
jax.config.update("jax_enable_x64", True)
import numpy as np, jaxbeam as jb
beam = jb.Beam.from_slenderness(70.0)
def case(angular_speed, hub_radius):
    rotor = jb.Rotor(beam, hub_radius)
    found = jb.modes(jb.Hybrid(4, 8, 0), rotor, angular_speed, 3, throw=False)
    return {"frequency": found.frequency, "status": found.status}
for n in (10, 1000):
    cases = jb.grid(angular_speed=np.linspace(0, 10, 1000), hub_radius=np.linspace(0, 1, n))
    table = jb.sweep(case, cases, chunk=2000, folder=FOLDER + str(n), progress=False)
    assert (table["status"] == 0).all()
    # Not ru_maxrss, which begins at the peak of the process that started this one.
    status = dict(line.split(":", 1) for line in open("/proc/self/status"))
    print(int(status["VmHWM"].split()[0]) / 1024)
"""


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform != "linux", reason="peak memory of one process, from /proc")
def test_memory_stays_flat(tmp_path):
    """A million cases, and no more than a small sweep but for what the results take."""
    program = MILLION.replace("FOLDER", repr(str(tmp_path / "kept")))
    small, large = map(float, run_optimised("-c", program, timeout=600).split())  # MiB
    assert large < 2048
    assert large - small < 150  # 30 of results as they are mapped, 8 to look at them
