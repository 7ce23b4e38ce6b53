"""Folders of programs that processes share, one after another and at once, and die over."""

import concurrent.futures
import os
import random
import subprocess
import sys

import pytest

from tests.helpers import environment

pytest.importorskip("flatbuffers")

ANSWERS = """
import sys
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)
import jaxbeam as jb
from jaxbeam._programs import traced

made, exported = [], traced._exported
traced._exported = lambda *given: (made.append(given), exported(*given))[1]
if sys.argv[1]:
    jb.keep(sys.argv[1])

BEAM, TIMES = jb.Beam.from_slenderness(70.0), jnp.linspace(0.0, 4.0, 9)
MODEL = jb.Hybrid(0, 1, 0)


def frequency(speed, hub_radius):
    rotor = jb.Rotor(BEAM, hub_radius)
    return jb.modes(jb.Hybrid(0, 2, 0), rotor, speed, 1, throw=False).frequency[0]


modes = jb.modes(jb.Hybrid(1, 2, 1), jb.Rotor(BEAM, 0.1), 2.0, 3)
run = jb.simulate(MODEL, jb.Rotor(BEAM, 0.1), jb.SmoothSpinUp(1.0, 3.0), TIMES)
slope = jb.programs.kept(jax.value_and_grad(frequency, (0, 1)))
found = [modes.eigenvalue, modes.shape, run.state, run.peak(), slope(1.0, 0.1)]
for leaf in jax.tree.leaves(found):
    print(np.asarray(leaf).tobytes().hex())
print(*f"{modes.model} {run.model} {run.scene} {run.solution.stats['max_steps']}".split())
print(len(made), file=sys.stderr)
"""


def begun(program, *arguments, flags=()):
    return subprocess.Popen(
        [sys.executable, *flags, "-c", program, *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment(),
    )  # fmt: skip


def ended(process):
    """What a process prints, and its last word beside that."""
    said, beside = process.communicate(timeout=300)
    assert process.returncode == 0, beside
    return said, beside.splitlines()[-1]


@pytest.mark.slow
def test_results_are_the_same_to_the_last_bit(tmp_path):
    """Not kept, kept by two processes at once, and taken from the folder."""
    plain, _ = ended(begun(ANSWERS, ""))
    folder = str(tmp_path / "programs")
    both = [begun(ANSWERS, folder) for _ in range(2)]
    assert [ended(process)[0] for process in both] == [plain, plain]
    assert ended(begun(ANSWERS, folder, flags=("-W", "error::UserWarning"))) == (plain, "0")
    assert plain.count("\n") == 11


SMALL = """
import sys
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)
import jaxbeam as jb
from jaxbeam._programs import traced

jb.keep(sys.argv[1])
print("ready", flush=True)
x = jnp.arange(4.0)
order = range(30) if len(sys.argv) < 3 else np.random.default_rng(int(sys.argv[2])).permutation(30)
for n in order:
    f = jb.programs.kept(lambda x, n=float(n): jnp.cumsum(n * x) + n)
    np.testing.assert_array_equal(f(x), np.cumsum(n * np.arange(4.0)) + n)
"""


@pytest.mark.exhaustive
def test_processes_that_are_killed_while_they_write(tmp_path):
    """A hundred of them, two at a time; those that follow find the right numbers, and no warning
    of half a file twice."""
    folder = str(tmp_path / "programs")
    draw = random.Random(7)

    def killed(number):
        process = begun(SMALL, folder, str(number))
        assert process.stdout.readline() == "ready\n"
        try:
            process.communicate(timeout=draw.uniform(0.0, 0.6))
        except subprocess.TimeoutExpired:
            process.kill()
            _, beside = process.communicate()
            assert "Error: " not in beside, beside
        return process.returncode

    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        codes = list(pool.map(killed, range(100)))
    assert codes.count(-9) > 50
    assert set(codes) <= {0, -9}, codes
    ended_well = begun(SMALL, folder, flags=("-W", "error::UserWarning"))
    assert ended_well.communicate(timeout=300)[1] == ""
    assert ended_well.returncode == 0
    assert len([name for name in os.listdir(f"{folder}/traced") if name[0] != "."]) == 30
