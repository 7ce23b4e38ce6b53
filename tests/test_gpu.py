"""Programs lowered for a GPU, which takes none to be at hand: all lanes go at once."""

import re

import jax
import jax.numpy as jnp
import pytest

import jaxbeam as jb
from jaxbeam._models.contract.door import checked_case
from jaxbeam._modes.banded import bands_of
from jaxbeam._modes.wanted import choose
from jaxbeam._programs import platforms
from jaxbeam._programs.batches import CPU_LANES

SIZE = 301
BEAM = jb.Beam.from_slenderness(300.0)


def lowest(model):
    """The search of `modes` in batches; what it cannot vouch for is mended one by one."""
    wanted = choose(model, 3)
    bands = bands_of(model, wanted.most, wanted.count)
    return lambda speed: bands.lowest(*checked_case(model, jb.Rotor(BEAM), speed)[1:], None)


def spun_up(speed):
    times, motion = jnp.linspace(0.0, 10.0, 11), jb.SmoothSpinUp(speed, 8.0)
    run = jb.simulate(jb.PlanarRod(4), jb.Rotor(BEAM), motion, times, throw=False)
    return run.tip, run.strain_energy, run.status


@pytest.fixture
def as_with_a_gpu(monkeypatch):
    """What is for other platforms is traced where there are others."""
    monkeypatch.setattr(platforms, "_only_cpus", lambda: False)
    jax.clear_caches()
    yield
    jax.clear_caches()


@pytest.mark.exhaustive
@pytest.mark.usefixtures("as_with_a_gpu")
@pytest.mark.parametrize(
    "case",
    [lowest(jb.Hybrid(4, 8, 8)), lowest(jb.PlanarRod(4)), spun_up],
    ids=["modes", "modes of elements", "spin-ups"],
)
def test_all_lanes_at_once_and_no_calls_of_libraries(case):
    program = jax.jit(jax.vmap(case))
    speeds = jnp.linspace(0.5, 3.0, SIZE)
    text = jax.export.export(program, platforms=["cuda"])(speeds).mlir_module()
    assert "custom_call" not in text
    assert re.search(rf"[<x]{SIZE}xf64", text)
    rows = rf"x{CPU_LANES}xf64"  # of lanes, behind all other axes
    assert rows not in text
    there = jax.export.export(program, platforms=["cpu"])(speeds).mlir_module()
    assert rows in there  # so that its absence says something
