"""Chunks in other processes: the same bits, whoever dies."""

import functools
import importlib
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from pathlib import Path
from typing import ClassVar

import dask
import distributed
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._sweeps import executors
from tests.sweeps.common import CASES, MANY, assert_same, found_modes, raising
from tests.tiers import slow


def processes():
    return ProcessPoolExecutor(2, multiprocessing.get_context("spawn"))


def told(say, x):
    """`x`, once `say` has been called with it, in whatever process that is."""

    def call(x):
        say(float(x))
        return x

    return jax.pure_callback(call, jax.ShapeDtypeStruct((), x.dtype), x, vmap_method="sequential")


def slept(_):
    if multiprocessing.parent_process() is not None:
        time.sleep(0.05)


def long(hub_radius, tip_mass):
    """In a worker, so that there is time to be killed."""
    return jnp.sin(10 * hub_radius + told(slept, tip_mass))


def log(folder, a):
    """Every process leaves a line for each case; the first to come is slow."""

    def say(a):
        slow = Path(folder) / "slow"
        if not slow.exists():
            slow.write_text(str(os.getpid()))
        with open(Path(folder) / f"{os.getpid()}.log", "a") as file:
            file.write(f"{a}\n")
        time.sleep(0.5 if slow.read_text() == str(os.getpid()) else 0.02)

    return jnp.sin(told(say, a))


def die(folder, deadly, times, a):
    """Kills its process at a case, so many times."""

    def say(a):
        if a == deadly and len(os.listdir(folder)) < times:
            (Path(folder) / f"death{os.getpid()}").touch()
            os.kill(os.getpid(), signal.SIGKILL)

    return jnp.sin(told(say, a))


def sine(a):
    return jnp.sin(a)


def fail(a):
    return told(lambda a: 1 / (a - 3), a)


@pytest.fixture
def cluster():
    """Workers of Dask on this machine, and how many there are to be."""
    # Or a worker that happens to be dead so long after another death is not started again.
    patience = {"distributed.deploy.lost-worker-timeout": "1 hour"}
    with (
        dask.config.set(patience),
        distributed.LocalCluster(
            n_workers=0, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0",
            silence_logs=50,
        ) as workers,
        distributed.Client(workers) as client,
    ):  # fmt: skip

        def started(n):
            workers.scale(n)
            client.wait_for_workers(n, timeout=120)
            return client

        started.workers = workers.workers
        yield started


def pids(folder):
    return {path.stem: path.read_text().count("\n") for path in Path(folder).glob("*.log")}


@pytest.mark.parametrize("function", [found_modes, raising])
def test_threads_are_workers(function):
    """Uneven, with cases that fail."""
    with ThreadPoolExecutor(2) as pool:
        table = jb.sweep(function, CASES, chunk=4, executor=pool)
    assert_same(jb.sweep(function, CASES, chunk=4), table)


def test_scripts_send_their_functions_along():
    factor = jnp.asarray(3.0)
    with ThreadPoolExecutor(1) as pool:
        table = jb.sweep(lambda a: factor * a, jb.grid(a=[1, 2]), chunk=1, executor=pool)
    np.testing.assert_array_equal(table["value"], [3.0, 6.0])


def test_a_worker_that_would_find_other_bits_is_refused(monkeypatch):
    pool = ThreadPoolExecutor(1)
    monkeypatch.setattr(pool, "submit", later(pool.submit, "XLA_FLAGS", "--xla_other=1"))
    with pytest.raises(RuntimeError, match=r"it would find other bits, being different in flags"):
        jb.sweep(lambda a: a + 17, jb.grid(a=[1]), executor=pool)


def later(submit, name, value):
    """What is submitted finds another environment."""

    def changed(work, *arguments):
        def there():
            before = os.environ.get(name)
            os.environ[name] = value
            try:
                return work(*arguments)
            finally:
                os.environ.pop(name) if before is None else os.environ.update({name: before})

        return submit(there)

    return changed


def test_what_goes_wrong_is_told():
    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(RuntimeError, match=r"(?s)a worker failed: .*ZeroDivisionError"):
            jb.sweep(fail, jb.grid(a=np.arange(9.0)), chunk=2, executor=pool)
        with pytest.raises(ValueError, match="give devices of this process or an executor"):
            jb.sweep(fail, jb.grid(a=[1]), devices=jax.devices(), executor=pool)
        lock = threading.Lock()
        with pytest.raises(TypeError, match=r"function must be picklable.*cannot pickle"):
            jb.sweep(lambda a: (lock, a)[1], jb.grid(a=[1]), executor=pool)
    with pytest.raises(RuntimeError, match="cannot schedule new futures after shutdown"):
        jb.sweep(fail, jb.grid(a=[1]), executor=pool)
    with pytest.raises(TypeError, match=r"executor must be, or make, a concurrent.futures"):
        jb.sweep(fail, jb.grid(a=[1]), executor=2)
    with pytest.raises(TypeError, match=r"executor must be, or make, a concurrent.futures"):
        jb.sweep(fail, jb.grid(a=[1]), executor=lambda: 2)
    fork = multiprocessing.get_context("fork")
    with pytest.raises(ValueError, match="JAX does not survive a fork"):
        jb.sweep(fail, jb.grid(a=[1]), executor=lambda: ProcessPoolExecutor(1, fork))


def test_workers_that_cannot_begin_are_told():
    """One whose packages are missing, and pools that end before they answer."""

    class Elsewhere(ThreadPoolExecutor):
        def submit(self, *_):
            return super().submit(importlib.import_module, "no_such_package")

    with (
        Elsewhere(1) as pool,
        pytest.raises(
            RuntimeError, match=r"could not begin: ModuleNotFoundError.*it needs jaxbeam"
        ),
    ):
        jb.sweep(sine, jb.grid(a=np.arange(9.0)), chunk=1, executor=pool)
    made = []

    class Broken(ThreadPoolExecutor):
        def submit(self, *_):
            made.append(self)
            raise BrokenExecutor("a process ended")

    with pytest.raises(RuntimeError, match="10 executors ended, one after the other, before any"):
        jb.sweep(sine, jb.grid(a=np.arange(9.0)), chunk=1, executor=lambda: Broken(1))
    assert len(made) == 10


def test_what_is_not_wanted_any_more_is_cancelled(tmp_path, monkeypatch):
    """A sweep that ends early leaves no work behind."""

    sent = []

    class Idle(ThreadPoolExecutor):
        def submit(self, *arguments):
            sent.append(Future() if sent else super().submit(*arguments))
            return sent[-1]

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("jaxbeam._sweeps.store.ResultFolder._write", full)
    with Idle(3) as pool, pytest.raises(OSError, match="Chunks finished before are intact"):
        jb.sweep(sine, jb.points(a=np.arange(9.0)), chunk=1, executor=pool, folder=tmp_path)
    assert [future.cancelled() for future in sent] == [False, *5 * [True]]


class Leaving(Executor):
    """Its workers answer some chunks and are gone; it says how many there are, look by look, and
    when nothing is left to say the chunks are answered."""

    def __init__(self, *workers, answers=0):
        self.numbers, self.left, self.waiting = list(workers), answers, []
        self._client = self

    def nthreads(self):
        number = self.numbers.pop(0)
        if not self.numbers:
            for answer in self.waiting:
                answer()
        return dict.fromkeys(range(number))

    def submit(self, work, *arguments):
        future, self.left = Future(), self.left - 1
        self.waiting.append(lambda: future.set_result(work(*arguments)))
        if self.left >= 0:
            self.waiting.pop()()
        return future


@pytest.fixture
def hasty(monkeypatch):
    """Looks at once, and has no patience."""
    for name in ("_LOOK", "_PATIENCE"):
        monkeypatch.setattr(executors, name, 0.0)


def test_workers_that_are_gone_for_good_end_a_sweep(hasty, tmp_path):
    """What is done stays done."""
    cases = jb.grid(a=np.arange(9.0))
    with (
        Leaving(2, 1, 0, 0, answers=4) as pool,
        pytest.raises(RuntimeError, match=r"all workers of the executor are gone.*again"),
    ):
        jb.sweep(sine, cases, chunk=1, executor=pool, folder=tmp_path / "kept")
    with pytest.raises(ValueError, match="5 of 9 chunks are missing"):
        jb.Table.load(tmp_path / "kept")
    with ThreadPoolExecutor(1) as pool:
        table = jb.sweep(sine, cases, chunk=1, executor=pool, folder=tmp_path / "kept")
    np.testing.assert_array_equal(table["value"], np.sin(np.arange(9.0)))


def test_workers_that_come_late_or_come_back_are_waited_for(hasty, monkeypatch):
    one = jb.grid(a=[1.0])
    with (
        Leaving(0, 0, 0, 0) as pool,
        pytest.warns(UserWarning, match="has no workers: the sweep waits for one"),
    ):
        assert jb.sweep(sine, one, executor=pool)["value"] == np.sin(1.0)
    monkeypatch.setattr(executors, "_PATIENCE", 1e9)
    with Leaving(1, 0, 0, 0) as pool:
        assert jb.sweep(sine, one, executor=pool)["value"] == np.sin(1.0)


@pytest.mark.exhaustive
def test_a_cluster_that_lost_all_its_workers_ends_a_sweep(tmp_path):
    """Their nannies give up those that are killed while they start."""
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0",
            silence_logs=50,
        ) as workers,
        distributed.Client(workers) as client,
    ):  # fmt: skip
        over = threading.Event()

        def kill():
            while not over.wait(0.2):
                for nanny in list(workers.workers.values()):
                    if nanny.pid:
                        os.kill(nanny.pid, signal.SIGKILL)

        killer, index = threading.Timer(1.0, kill), tmp_path / "kept" / "index.txt"
        killer.start()
        try:
            with pytest.raises(RuntimeError, match="all workers of the executor are gone"):
                jb.sweep(
                    long, MANY, chunk=4, executor=client.get_executor(), folder=tmp_path / "kept"
                )
        finally:
            over.set()
            killer.join()
        before = index.read_bytes().count(b"\n") if index.exists() else 0
        workers.scale(0)
        workers.scale(2)
        client.wait_for_workers(2, timeout=120)
        table = jb.sweep(
            long, MANY, chunk=4, executor=client.get_executor(), folder=tmp_path / "kept"
        )
    assert index.read_bytes().count(b"\n") == 250 >= before
    assert_same(table, jb.sweep(long, MANY, chunk=4))


class Deadly(Executor):
    """Its worker dies of one case, and is its own process otherwise."""

    tries: ClassVar[list[int]] = []

    def submit(self, function, /, job, columns, deaths):
        future = Future()
        if 5.0 in np.asarray(columns["a"]):
            self.tries.append(deaths)
            future.set_exception(BrokenExecutor("gone"))
        else:
            future.set_result(function(job, columns, deaths))
        return future


def test_a_chunk_that_kills_three_workers_is_given_up_and_not_done(tmp_path):
    table = jb.sweep(
        sine, jb.grid(a=np.arange(8.0)), chunk=2, executor=Deadly, folder=tmp_path / "kept"
    )
    assert Deadly.tries == [0, 1, 2]
    lost = np.isin(np.arange(8), [4, 5])
    np.testing.assert_array_equal(table["status"], np.where(lost, jb.Status.RAISED, jb.Status.OK))
    with pytest.raises(ValueError, match="1 of 4 chunks are missing"):
        jb.Table.load(tmp_path / "kept")


@pytest.mark.exhaustive
def test_processes_of_the_standard_library(tmp_path):
    one = jb.sweep(found_modes, CASES, chunk=4)
    assert_same(one, jb.sweep(found_modes, CASES, chunk=4, executor=processes))
    raised = jb.sweep(raising, CASES, chunk=4, executor=processes, folder=tmp_path)
    assert_same(jb.sweep(raising, CASES, chunk=4), raised)
    assert_same(jb.Table.load(tmp_path), raised)


@pytest.mark.exhaustive
def test_processes_of_loky(tmp_path):
    """They begin anew when one dies."""
    loky = pytest.importorskip("loky")

    def pool():
        return loky.get_reusable_executor(2)

    one = jb.sweep(found_modes, CASES, chunk=4)
    assert_same(one, jb.sweep(found_modes, CASES, chunk=4, executor=pool))
    cases = jb.points(a=np.arange(8.0))
    killed = jb.sweep(functools.partial(die, tmp_path, 3.0, 2), cases, chunk=2, executor=pool)
    assert len(os.listdir(tmp_path)) == 2
    assert_same(jb.sweep(sine, cases, chunk=2), killed)


BY_MPI = """
import jax
from mpi4py.futures import MPIPoolExecutor
import jaxbeam as jb
from jaxbeam._sweeps import executors
from tests.sweeps.common import CASES, assert_same, found_modes

if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    with MPIPoolExecutor() as pool:
        many = jb.sweep(found_modes, CASES, chunk=4, executor=pool)
    assert_same(jb.sweep(found_modes, CASES, chunk=4), many)
    print("the same")
"""


@pytest.mark.exhaustive
def test_processes_by_mpi(tmp_path):
    """One that sends and two workers; `pip install mpi4py mpich` is enough for it."""
    pytest.importorskip("mpi4py")
    where = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    mpiexec = shutil.which("mpiexec", path=where)
    if mpiexec is None:
        pytest.skip("there is no mpiexec")
    script = tmp_path / "script.py"
    script.write_text(BY_MPI)
    root = str(Path(jb.__file__).parents[1])
    command = [mpiexec, "-n", "3", sys.executable, "-m", "mpi4py.futures", str(script)]
    environment = {**os.environ, "PYTHONPATH": root, "JAX_ENABLE_X64": "1"}
    done = subprocess.run(
        command, cwd=root, env=environment, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert "the same" in done.stdout


@pytest.mark.exhaustive
def test_shorter_floats_are_those_of_the_caller():
    with jax.enable_x64(False):
        table = jb.sweep(sine, jb.grid(a=[1.0, 2.0]), executor=processes)
    assert table["value"].dtype == np.float32
    with (
        jax.enable_x64(False), ThreadPoolExecutor(1) as pool,
        pytest.raises(RuntimeError, match="different in precision"),
    ):  # fmt: skip
        jb.sweep(sine, jb.grid(a=[1.0, 3.0]), executor=pool)


@pytest.mark.exhaustive
@pytest.mark.parametrize("deaths", [slow(2), 99])
def test_processes_that_die(deaths, tmp_path):
    """Two deaths cost time alone; a case that kills whoever touches it costs its chunk."""
    (tmp_path / "deaths").mkdir()
    function = functools.partial(die, str(tmp_path / "deaths"), 5.0, deaths)
    cases = jb.grid(a=np.arange(16.0))
    table = jb.sweep(function, cases, chunk=2, executor=processes, folder=tmp_path / "kept")
    died = len(os.listdir(tmp_path / "deaths"))
    lost = np.isin(np.arange(16), [4, 5] if deaths == 99 else [])
    assert died == min(deaths, 3)
    np.testing.assert_array_equal(table["status"], np.where(lost, jb.Status.RAISED, jb.Status.OK))
    np.testing.assert_array_equal(table["value"], np.where(lost, np.nan, np.sin(cases.axes["a"])))
    assert sorted(table.errors) == list(np.flatnonzero(lost))
    if deaths == 99:
        assert "the worker that computed its chunk died: BrokenProcessPool" in table.message(a=4)
        with pytest.raises(ValueError, match="1 of 8 chunks are missing"):
            jb.Table.load(tmp_path / "kept")
        with processes() as pool, pytest.raises(RuntimeError, match="pass a function that makes"):
            jb.sweep(function, cases, chunk=2, executor=pool)


@pytest.mark.slow
def test_a_worker_that_is_slow_and_one_that_comes_late(cluster, tmp_path):
    client = cluster(1)
    function = functools.partial(log, str(tmp_path))

    def come():
        while not pids(tmp_path):
            time.sleep(0.01)
        cluster(2)

    late = threading.Thread(target=come)
    late.start()
    cases = jb.grid(a=np.linspace(0.0, 1.0, 100))
    table = jb.sweep(function, cases, chunk=1, executor=client.get_executor())
    late.join()
    np.testing.assert_array_equal(table["value"], jb.sweep(sine, cases)["value"])
    slow = (tmp_path / "slow").read_text()
    done = pids(tmp_path)
    assert len(done) == 2
    assert done.pop(slow) < sum(done.values())


@pytest.mark.exhaustive
def test_a_case_that_kills_workers_of_dask(cluster, tmp_path):
    (tmp_path / "deaths").mkdir()
    function = functools.partial(die, str(tmp_path / "deaths"), 5.0, 99)
    pool = cluster(2).get_executor()
    table = jb.sweep(function, jb.grid(a=np.arange(16.0)), chunk=2, executor=pool)
    assert sorted(table.errors) == [4, 5]
    assert "KilledWorker" in table.errors[4]
    assert (table["status"] != 0).sum() == 2
    assert 4 < len(os.listdir(tmp_path / "deaths")) <= 8  # Dask allows for three, twice


@pytest.mark.exhaustive
def test_twenty_kills_at_random_moments(cluster, tmp_path):
    """Of workers of Dask, by the system, during a thousand cases in 250 chunks."""
    seed = random.randrange(2**32)
    print("seed", seed)  # shown on failure
    moments = random.Random(seed)
    when = sorted(moments.sample(range(240), 20))  # chunks that are finished then
    index, killed, over = tmp_path / "kept" / "index.txt", [], threading.Event()
    client = cluster(2)

    def alive():
        """Processes that work: nannies give up those that die while they start."""
        running = distributed.core.Status.running
        return [n.pid for n in cluster.workers.values() if n.process.status == running]

    def kill():
        for finished in when:
            while not index.exists() or index.read_bytes().count(b"\n") < finished:
                if over.wait(0.005):
                    return
            time.sleep(moments.uniform(0.0, 0.2))
            while not (pids := alive()):
                time.sleep(0.01)
            killed.append(moments.choice(pids))
            os.kill(killed[-1], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        table = jb.sweep(
            long, MANY, chunk=4, executor=client.get_executor(), folder=tmp_path / "kept"
        )
    finally:
        over.set()
        killer.join()
    assert len(killed) == 20
    assert len(set(killed)) > 10  # workers that were new
    assert (table["status"] == 0).all()
    assert_same(table, jb.sweep(long, MANY, chunk=4))
    assert_same(table, jb.Table.load(tmp_path / "kept"))
