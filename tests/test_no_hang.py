"""Batched sweeps run to their end on two cores, without any environment variable.

Programs with several independent batched LAPACK calls wait for each other for ever there (see
jaxbeam._numerics.linalg). Each program below runs in a process of its own that sees two cores at
most.
"""

import pytest

from tests.helpers import run_optimised

PROLOGUE = """
import os
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:2])
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import numpy as np
import jaxbeam as jb
beam = jb.Beam.from_slenderness(70.0)
cases = np.random.default_rng(0).uniform([0, 0, 0], [20, 1, 0.5], (1000, 3))
"""

SWEEP = """
def case(angular_speed, hub_radius, tip_mass):
    rotor = jb.Rotor(beam, hub_radius, tip_mass)
    return jb.modes(MODEL, rotor, angular_speed, 6, throw=False)
columns = dict(zip(("angular_speed", "hub_radius", "tip_mass"), cases.T))
table = jb.sweep(case, jb.points(**columns), chunk=100)
assert table["status"].shape == (1000,)
"""

# Several models, gradients and second derivatives side by side in one program.
MIXED = """
models = jb.Hybrid(6, 8, 8), jb.ANCF(6), jb.models.SmallStrainANCF(10), jb.Classical(4, 6, 0)
@jax.jit
@jax.vmap
def everything(c):
    rotor = lambda c: jb.Rotor(beam, c[1], c[2])
    f = [jb.modes(m, rotor(c), c[0], 3, throw=False).frequency for m in models]
    g = jax.grad(lambda c: jb.modes(models[0], rotor(c), c[0], 3, throw=False).frequency[0])(c)
    h = jax.grad(lambda c: jb.modes(models[2], rotor(c), c[0], 3, throw=False).frequency[0])(c)
    p = jb.southwell(models[0], rotor(c), c[0], jb.labels(in_plane=2), throw=False)
    x = jb.crossing(models[0], rotor(c), (0.1, 9.0), jb.labels(in_plane=1)[0], 4.0, throw=False)
    return f, g, h, p, x
for _ in range(8):
    jax.block_until_ready(everything(jnp.asarray(cases[:100])))
"""


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "body",
    [
        SWEEP.replace("MODEL", "jb.Hybrid(8, 12, 12)"),
        SWEEP.replace("MODEL", "jb.ANCF(10)"),
        SWEEP.replace("MODEL", "jb.Classical(6, 8, 0)"),
        MIXED,
    ],
    ids=["hybrid", "ancf", "classical", "mixed"],
)
def test_ends(body):
    run_optimised("-c", PROLOGUE + body, timeout=900)
