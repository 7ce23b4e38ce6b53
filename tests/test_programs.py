"""What people wait for the first time: imports are few, and programs are kept between processes."""

import os
import subprocess
import sys

import pytest

import jaxbeam as jb


def test_what_is_not_asked_for_is_not_imported():
    told = subprocess.run(
        [sys.executable, "-c", "import sys, jaxbeam as jb; jb.modes; print(*sys.modules)"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert not {"diffrax", "optimistix", "optax", "matplotlib"} & set(told.stdout.split())
    assert "modes" in dir(jb)
    with pytest.raises(AttributeError, match="no attribute 'mode'"):
        jb.mode  # noqa: B018


ANSWERS = """
import jax
import numpy as np

seen = {"compiled": 0, "kept": 0}


def count(event, *_, **__):
    if event == "/jax/compilation_cache/cache_hits":
        seen["kept"] += 1
    if event == "/jax/core/compile/backend_compile_duration":  # of those that were kept, too
        seen["compiled"] += 1


jax.monitoring.register_event_listener(count)
jax.monitoring.register_event_duration_secs_listener(count)
jax.config.update("jax_enable_x64", True)

import jaxbeam as jb

model, banded, plain = jb.Hybrid(2, 3, 2), jb.Hybrid(8, 10, 0), jb.Hybrid(0, 2, 0)
which = jb.labels(in_plane=2, flap=1)
first, motion = which[:1], jb.motions.ModulatedSpeed(2.0, 0.5, 3.0)


def rotor(stiffness):
    return jb.Rotor(jb.Beam(8.0, 0.2, 5e4, stiffness, stiffness), 0.5, 0.1)


def experiment(stiffness, tip_mass):
    seen = [[2.6, 16.6], [3.0, 17.3]]
    return jb.FrequencyData(model, rotor(stiffness), [0.0, 2.0], seen, 0.1, which[:2])


def lowest(stiffness):
    return jb.modes(model, rotor(stiffness), 3.0, which, throw=False).frequency[0]


differentiable = {
    "modes": lambda s: jb.modes(model, rotor(s), 3.0, which).frequency[0],
    "modes in bands": lambda s: jb.modes(banded, rotor(s), 3.0, 3).frequency[0],
    "modes of elements": lambda s: jb.modes(jb.PlanarRod(3), rotor(s), 3.0, 3).frequency[0],
    "linearise": lambda s: model.linearise(rotor(s), 3.0).stiffness[0, 0],
    "southwell": lambda s: jb.southwell(model, rotor(s), which=which).coefficient[0],
    "crossing": lambda s: jb.crossing(model, rotor(s), (0.5, 8.0), first[0], 2.0).angular_speed,
    "critical_speed": lambda s: jb.critical_speed(jb.papers.ChordANCF(2), rotor(s)).angular_speed,
    "floquet": lambda s: jb.floquet(model, rotor(s), motion, steps=128).growth_rate,
    "tongue": lambda s: jb.tongue(plain, rotor(s), 2.0, first * 2, [0.1]).frequency[0, 0],
}
free = {"stiffness": jb.FreeParameter(500.0), "tip_mass": jb.FreeParameter(0.2, prior=(0.1, 0.1))}
others = {
    "campbell": lambda: jb.campbell(model, rotor(560.0), np.linspace(0.1, 6.0, 8), which),
    "fit": lambda: jb.fit(experiment, free),
    "sweep": lambda: jb.sweep(lowest, jb.grid(stiffness=[500.0, 600.0])),
    "choose_model": lambda: jb.choose_model(
        rotor(560.0), jb.ladder.ModalFrequencies(3.0, first), 1e-2
    ),
}
for name, answer in differentiable.items():
    others[name] = lambda answer=answer: answer(560.0)
    others["gradient of " + name] = lambda answer=answer: jax.grad(answer)(560.0)
for name, answer in others.items():
    before = dict(seen)
    jax.block_until_ready([x for x in jax.tree.leaves(answer()) if isinstance(x, jax.Array)])
    compiled, kept = (seen[key] - before[key] for key in ("compiled", "kept"))
    print(f"{name}: {compiled - kept} of {compiled}")
"""


@pytest.mark.exhaustive
def test_a_second_process_compiles_nothing(tmp_path):
    """With JAX's own settings alone."""
    settings = {
        "JAX_COMPILATION_CACHE_DIR": str(tmp_path),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    }
    environment = {k: v for k, v in os.environ.items() if k != "EQX_ON_ERROR"} | settings

    def told():
        ended = subprocess.run(
            [sys.executable, "-c", ANSWERS],
            env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert ended.returncode == 0, ended.stderr
        return ended.stdout.splitlines()

    first, second = told(), told()
    assert len(first) == 22
    assert all(int(line.split(": ")[1].split()[0]) == 0 for line in second), second
    assert sum(int(line.split()[-1]) for line in first) > 50  # the signal is one
