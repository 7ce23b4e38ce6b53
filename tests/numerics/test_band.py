"""Symmetric band matrices."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxbeam._numerics.band import band, band_matvec, factors, polished, solved, width_of


def matrix(n, b, seed=0):
    a = np.tril(np.random.default_rng(seed).normal(size=(n, n)))
    a = np.tril(a) - np.tril(a, -b - 1)
    return a + a.T + 4 * b * np.eye(n)


@pytest.mark.parametrize(("n", "b"), [(7, 1), (9, 3), (4, 3), (2, 1)])
def test_products_and_solutions_are_those_of_dense_matrices(n, b):
    a, x = matrix(n, b), np.linspace(1.0, 2.0, n)
    assert width_of(a) == b + 1
    narrow = jnp.asarray(band(a, b + 1))
    np.testing.assert_allclose(band_matvec(narrow, jnp.asarray(x)), a @ x, rtol=1e-13)
    found = solved(*factors(narrow), jnp.asarray(x))
    np.testing.assert_allclose(found, np.linalg.solve(a, x), rtol=1e-12)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_null_vectors_of_matrices_that_are_singular_to_the_last_bit(size):
    """Three of a million frequencies were not found since the guess of one was that good."""
    springs = size * jnp.array([[1.0, -1.0], [2.0, -1.0], [1.0, 0.0]])  # a free chain of masses
    x = polished(springs, jnp.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(jnp.abs(x), 3**-0.5, rtol=1e-12)
