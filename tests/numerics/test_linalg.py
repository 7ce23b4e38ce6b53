"""Block-tridiagonal and small matrices, and the matrix exponential."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._numerics.exponential import exponential
from jaxbeam._numerics.small import SmallMatrix
from jaxbeam._programs.kernel import kernel
from tests.tiers import slow


def case(blocks, size, absent, seed=1):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(blocks, size, 3 * size))
    rows[:, :, size : 2 * size] += 3 * size * np.eye(size)
    return jnp.asarray(rows), jnp.asarray(rng.normal(size=blocks * size - absent))


SHAPES = [
    (5, 4, 3),
    (1, 4, 0),
    *(slow(*s) for s in ((2, 3, 1), (9, 4, 3), (3, 1, 0))),
]


@pytest.mark.parametrize(("blocks", "size", "absent"), SHAPES)
def test_sums_and_products_are_those_of_dense_matrices(blocks, size, absent):
    rows, x = case(blocks, size, absent)
    a = BlockTridiagonal(rows, absent)
    full = np.asarray(a.dense())
    assert a.shape == full.shape == (x.size, x.size)
    corner = full[size - absent :, : size - absent]  # first column of blocks, below its own
    assert not corner[size:].any()
    xs, ys = np.stack([x, 2 * x, x**2]), np.stack([x**3, x, 1 + x])
    found = jax.jit(lambda a, x: ((2 * a + a / 4) @ x, x @ a, a.outer(xs, ys).dense()))(a, x)
    near = np.asarray(BlockTridiagonal(jnp.ones_like(rows), absent).dense())
    for own, expected in zip(found, (2.25 * full @ x, x @ full, near * (xs.T @ ys)), strict=True):
        np.testing.assert_allclose(own, expected, rtol=1e-12)
    np.testing.assert_array_equal(a.matrix_of(lambda x: full @ x), full)


@pytest.mark.slow
@pytest.mark.parametrize(("blocks", "size", "absent"), SHAPES)
def test_solutions_and_their_derivatives(blocks, size, absent):
    """To the second derivative, in both modes, alone and in a batch."""
    rows, x = case(blocks, size, absent)

    def fast(rows, x):
        inverse = BlockTridiagonal(rows, absent).inverse()
        return inverse @ (inverse @ x) + x @ inverse

    def slow(rows, x):
        a = BlockTridiagonal(rows, absent).dense()
        return jnp.linalg.solve(a, jnp.linalg.solve(a, x)) + jnp.linalg.solve(a.T, x)

    weight = jnp.cos(jnp.arange(x.size))
    direction = case(blocks, size, absent, 2)[0]

    def derivatives(f):
        def value(rows, x):
            return weight @ f(rows, x)

        def along(rows, x):
            return jax.jvp(lambda r: value(r, x), (rows,), (direction,))[1]

        return f(rows, x), jax.grad(value, (0, 1))(rows, x), jax.grad(along)(rows, x)

    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12),
        *(jax.jit(lambda f=f: derivatives(f))() for f in (fast, slow)),
    )
    many = jnp.stack([rows, 1.1 * rows, rows + 0.1])
    found = jax.jit(jax.vmap(fast, (0, None)))(many, x)
    expected = jax.jit(lambda: jnp.stack([slow(r, x) for r in many]))()
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("size", [1e-3, 1.0, 30.0, 1e3])
def test_exponential(size):
    a = np.random.default_rng(0).normal(size=(9, 9))
    a = size * (a - a.T) / 6
    found = jax.jit(exponential)(jnp.asarray(a))
    np.testing.assert_allclose(found, expm(a), atol=1e-15 * max(size, 1) * 50)
    np.testing.assert_allclose(found @ found.T, np.eye(9), atol=1e-15 * max(size, 1) * 50)


def test_derivative_of_exponential():
    a, e = np.random.default_rng(0).normal(size=(2, 5, 5)) * 3
    both = np.block([[a, e], [np.zeros((5, 5)), a]])
    found = jax.jit(lambda: jax.jvp(exponential, (jnp.asarray(a),), (jnp.asarray(e),))[1])()
    np.testing.assert_allclose(found, expm(both)[:5, 5:], rtol=1e-11)
    reverse = jax.jit(lambda: jax.grad(lambda a: jnp.sum(exponential(a) * e))(jnp.asarray(a)))()
    np.testing.assert_allclose(jnp.sum(reverse * e), jnp.sum(found * e), rtol=1e-11)


def test_small_matrices_are_those_of_a_library():
    """In a kernel of lanes, with derivatives in both modes."""
    rng = np.random.default_rng(5)
    array, x = rng.normal(size=(3, 6, 6)), rng.normal(size=(3, 6))
    array = array + 8 * np.eye(6)

    def all_of(array, x):
        a = SmallMatrix(array)
        whole = 2 * a / 4 + a
        pairs = a.outer(jnp.stack([x, x**2]), jnp.stack([x**2, 1 + x])).array
        return whole @ x, x @ whole, whole.inverse() @ x, x @ whole.inverse(), pairs

    def by_library(a, x):
        whole = 1.5 * a
        solved = jnp.linalg.solve(whole, x), jnp.linalg.solve(whole.T, x)
        return whole @ x, x @ whole, *solved, jnp.outer(x, x**2) + jnp.outer(x**2, 1 + x)

    both = [jax.jit(jax.vmap(f)) for f in (kernel(all_of), by_library)]
    rates = rng.normal(size=array.shape), rng.normal(size=x.shape)
    for own, expected in zip(*(jax.jvp(f, (array, x), rates) for f in both), strict=True):
        for a, b in zip(own, expected, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-12)
    out, pull = jax.vjp(both[0], array, x)
    expected = jax.vjp(both[1], array, x)[1](out)
    for a, b in zip(pull(out), expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11)
