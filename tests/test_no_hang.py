"""Batched sweeps run to their end on two cores, without any environment variable.

Programs with several independent batched LAPACK calls wait for each other for ever there (see
jaxbeam._numerics.linalg). Each program below runs in a process of its own that sees two cores at
most.
"""

import dataclasses

import jax
import jax.numpy as jnp
import pytest

import jaxbeam as jb
from tests.helpers import run_optimised
from tests.tiers import exhaustive, slow

BLADE = jb.Beam(
    1.0, jb.Spanwise([0.0, 0.3, 1.0], [1.0, 0.5, 0.4]), 1e6, jb.Spanwise([0.0, 1.0], [9.0, 2.0]),
    4.0, torsional_stiffness=3.0, polar_inertia=0.01,
)  # fmt: skip
LAPACK = {
    "cholesky", "eig", "eigh", "geqp3", "geqrf", "hessenberg", "householder_product", "lu",
    "qr", "schur", "svd", "triangular_solve", "tridiagonal_solve",
}  # fmt: skip


def calls(program):
    """All equations of a program that call LAPACK."""
    for eqn in program.eqns:
        if eqn.primitive.name in LAPACK:
            yield eqn
        for value in jax.tree.leaves(eqn.params, is_leaf=lambda x: hasattr(x, "eqns")):
            if hasattr(value, "eqns"):
                yield from calls(value)


def modes(model):
    return lambda rotor: jb.modes(model, rotor, 3.0, 2, throw=False).frequency


def rest(model):
    return lambda rotor: jb.steady_start(model, rotor, jb.ConstantSpeed(1.0), throw=False).q


def buckling(rotor):
    loads = jb.Loads(tip_force=[-1.0, 0.0, 0.0])
    return jb.critical_load(jb.PlanarRod(4), rotor, loads=loads, throw=False).factor


def polynomials(rotor):
    return jb.modes(jb.Hybrid(0, 8, 8), rotor, 3.0, 4, throw=False).polynomials().coefficients


@pytest.mark.parametrize(
    "answer",
    [
        modes(jb.Hybrid(0, 4, 0)),
        slow(buckling),
        exhaustive(modes(jb.Hybrid(4, 6, 6))),
        exhaustive(polynomials),
        exhaustive(rest(jb.PlanarRod(3))),
        exhaustive(modes(jb.VonKarman(3, 6, 6))),
        exhaustive(modes(jb.SpatialRod(2))),
        exhaustive(rest(jb.Hybrid(4, 6, 6))),
        exhaustive(rest(jb.papers.ANCF(3))),
    ],
)
def test_lapack_meets_one_matrix_at_a_time(answer):
    """No equation of a program that calls LAPACK has a batch: programs of derivatives of a batch,
    in both modes, which make the values as well."""

    def case(values):
        stiffness = jb.Spanwise([0.0, 1.0], values)
        return answer(jb.Rotor(dataclasses.replace(BLADE, in_plane_bending_stiffness=stiffness)))

    batch = jnp.asarray([[9.0, 2.0], [8.0, 3.0]])
    for derivative in (jax.jacfwd, jax.jacrev):
        program = jax.make_jaxpr(jax.vmap(derivative(case)))(batch)
        shapes = [eqn.invars[0].aval.shape for eqn in calls(program)]
        assert shapes
        assert max(map(len, shapes)) == 2


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

BLADES = """
def frequency(values):
    stiffness = jb.Spanwise([0.0, 0.4, 1.0], values)
    blade = jb.Beam(1.0, 1.0, 1e6, stiffness, jb.Spanwise([0.0, 1.0], [3.0, 1.0]))
    return jb.modes(jb.Hybrid(4, 8, 8), jb.Rotor(blade), 3.0, 3, throw=False).frequency
many = np.random.default_rng(0).uniform(1.0, 9.0, (200, 3))
both = jax.jit(jax.vmap(lambda v: (frequency(v), jax.jacrev(frequency)(v))))
for _ in range(4):
    jax.block_until_ready(both(many))
"""

# Several models, gradients and second derivatives side by side in one program.
MIXED = """
models = jb.Hybrid(6, 8, 8), jb.papers.ANCF(6), jb.papers.SmallStrainANCF(10), jb.Classical(4, 6, 0)
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
        SWEEP.replace("MODEL", "jb.papers.ANCF(10)"),
        SWEEP.replace("MODEL", "jb.Classical(6, 8, 0)"),
        BLADES,
        MIXED,
    ],
    ids=["hybrid", "ancf", "classical", "blades", "mixed"],
)
def test_ends(body):
    run_optimised("-c", PROLOGUE + body, timeout=900)
