"""Functions of short vectors by tables of their values at unit vectors."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._numerics.multilinear import multilinear
from jaxbeam._numerics.quaternions import cross, crossing, quaternion_product


@multilinear(2, 3)
def _moment(a, b):
    return np.outer(a, b) - 2 * np.outer(a[::-1], b)


def test_values_are_those_of_the_formula():
    draw = np.random.default_rng(0)
    a, b = draw.normal(size=(4, 1, 2)), draw.normal(size=(1, 5, 3))
    found = _moment(jnp.asarray(a), jnp.asarray(b))
    for i, j in np.ndindex(4, 5):
        own = np.outer(a[i, 0] - 2 * a[i, 0, ::-1], b[0, j])
        np.testing.assert_allclose(found[i, j], own, rtol=0, atol=1e-14)
    assert _moment(jnp.zeros(2, jnp.float32), jnp.zeros(3, jnp.float32)).dtype == jnp.float32


def test_products_of_vectors_and_quaternions():
    a, b, c = jnp.asarray(np.random.default_rng(1).normal(size=(3, 7, 3)))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose(jnp.einsum("nij,nj->ni", crossing(a), b), np.cross(a, b), atol=1e-15)
    # The derivative of a product of linear factors is the product with that of one.
    _, rate = jax.jvp(lambda a: cross(a, b), (a,), (c,))
    np.testing.assert_allclose(rate, np.cross(c, b), atol=1e-15)
    # i j = k, j k = i, k i = j, and i i = -1.
    one, i, j, k = jnp.eye(4)
    for p, q, product in ((i, j, k), (j, k, i), (k, i, j), (i, i, -one), (one, j, j)):
        np.testing.assert_array_equal(quaternion_product(p, q), product)
