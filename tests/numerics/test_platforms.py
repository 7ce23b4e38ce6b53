"""What is for devices where loops are dear, traced and run on whatever is at hand."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._models.ancf.sections import each_element
from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._numerics.linalg import inverse
from jaxbeam._programs.kernel import kernel
from jaxbeam._programs.platforms import loops_are_dear, traced_for

LANES = 3


def test_what_is_traced_for_one_is_not_taken_for_the_other():
    dear = jax.jit(lambda: jnp.asarray(loops_are_dear()))
    for which, answer in ((None, False), ("others", True), ("cpu", False), ("others", True)):
        assert bool(traced_for(which, dear)()) == answer


def solved(rows, x):
    """A product and a solve with a matrix made of blocks, of each element its own."""
    each = x.reshape(3, 1, 2, *x.shape[1:])
    loads = each_element(lambda a, b: a[0][:, None] * b, (each, each))
    matrix = BlockTridiagonal(rows + 0 * x[0])
    return matrix.inverse() @ jnp.sum(loads, 2).reshape(x.shape), matrix @ x


def case():
    rng = np.random.default_rng(2)
    rows, x = rng.normal(size=(3, 2, 6)), rng.normal(size=(LANES, 6))
    rows[:, :, 2:4] += 9 * np.eye(2)
    full = np.asarray(BlockTridiagonal(jnp.asarray(rows)).dense())
    return rows, x, full, np.repeat(x.reshape(LANES, 3, 2).sum(2), 2, 1)


def test_solves_of_lanes_without_a_loop():
    rows, x, full, sums = case()
    program = jax.jit(traced_for("others", jax.vmap(kernel(solved), (None, 0))))
    found, product = program(rows, x)
    np.testing.assert_allclose(found, np.linalg.solve(full, (x * sums).T).T, rtol=1e-11)
    np.testing.assert_allclose(product, x @ full.T, rtol=1e-11, atol=1e-12)


def test_gradients_of_lanes_without_a_loop():
    rows, x, full, sums = case()

    def total(x):
        return jnp.sum(jax.vmap(kernel(solved), (None, 0))(rows, x)[0])

    program = jax.jit(traced_for("others", jax.grad(total)))
    back = np.linalg.solve(full.T, np.ones(6))
    exact = back * sums + np.repeat((back * x).reshape(LANES, 3, 2).sum(2), 2, 1)
    np.testing.assert_allclose(program(x), exact, rtol=1e-11, atol=1e-12)


def test_inverses_without_a_loop_choose_their_pivots():
    rng = np.random.default_rng(3)
    a = rng.normal(size=(LANES, 5, 5))
    a[:, range(4), range(4)] = 0.0
    program = jax.jit(traced_for("others", jax.vmap(inverse)))
    np.testing.assert_allclose(program(a), np.linalg.inv(a), rtol=1e-11, atol=1e-12)


def spun_up(model, speed):
    run = jb.simulate(
        model, jb.Rotor(jb.Beam.from_slenderness(300.0)), jb.SmoothSpinUp(speed, 8.0),
        [0.0, 1.0], stepsize_controller=diffrax.PIDController(rtol=1e-8, atol=1e-8), throw=False,
    )  # fmt: skip
    return run.tip, run.status


def lowest(speed):
    rotor = jb.Rotor(jb.Beam.from_slenderness(300.0))
    found = jb.modes(jb.Hybrid(0, 8, 0), rotor, speed, 3, throw=False)
    return found.frequency, found.status


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "case",
    [
        lambda speed: spun_up(jb.PlanarRod(2), speed),
        lambda speed: spun_up(jb.Hybrid(0, 3, 0), speed),
        lowest,
    ],
    ids=["elements", "polynomials", "modes"],
)
def test_batches_are_what_they_are_on_a_cpu(case):
    """More cases than a CPU works on together, and fewer than it finds modes of by bands."""
    speeds = jnp.linspace(0.5, 3.0, 40)
    here, status = jax.jit(jax.vmap(case))(speeds)
    there, other = jax.jit(traced_for("others", jax.vmap(case)))(speeds)
    np.testing.assert_array_equal(status, other)
    assert np.all(status == jb.Status.OK)
    np.testing.assert_allclose(there, here, rtol=1e-7, atol=1e-9)
