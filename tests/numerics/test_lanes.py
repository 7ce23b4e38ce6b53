"""What works on arrays with lanes says the same in each lane as on one case."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxbeam._programs.kernel import kernel
from jaxbeam._programs.lanes import (
    compute_once,
    matmul,
    matvec,
    matvec_once,
    sum_of_products,
    transposed,
    weighted_sum,
)

RNG = np.random.default_rng(3)
LANES = 7


def _in_lanes(function, *arrays):
    """The function in each lane, one by one, behind."""
    each = [function(*(jnp.asarray(a[..., i]) for a in arrays)) for i in range(LANES)]
    return np.stack(each, -1)


@pytest.mark.parametrize("count", [16, 17, 24, 37])
def test_long_sums_are_made_of_groups(count):
    """And what is repeated along the axis is no longer for it."""
    a, x = RNG.normal(size=(3, count, 4, LANES)), RNG.normal(size=(1, count, 4, LANES))
    found = jax.jit(lambda a, x: sum_of_products(a, x, 1, 1))(a, x)
    np.testing.assert_allclose(found, (a * x).sum(1), rtol=1e-12, atol=1e-13)
    once = jax.jit(lambda a, x: sum_of_products(a, x[:, :1], 1, 1))(a, x)
    np.testing.assert_allclose(once, (a * x[:, :1]).sum(1), rtol=1e-12, atol=1e-13)


def test_products_in_a_kernel_are_those_of_a_library():
    a, b, x = (RNG.normal(size=(*size, LANES)) for size in ((4, 5), (5, 3), (5,)))
    tables, weights = RNG.normal(size=(2, 4, 4, LANES)), RNG.normal(size=(2, LANES))
    for function, args in (
        (matmul, (a, b)), (matvec, (a, x)), (matvec_once, (a, x)),
        (weighted_sum, (weights, tables)),
    ):  # fmt: skip
        alone = _in_lanes(function, *args)
        found = jax.vmap(kernel(partial(function)), -1, -1)(*args)
        np.testing.assert_allclose(found, alone, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("shapes", [((4, 5, 1), (1, 5, 7)), ((1, 5, 7), (4, 5, 7))])
def test_transposes_of_contract(shapes):
    """By both factors, where one or two of their axes are repeated."""
    a, x = (jnp.asarray(RNG.normal(size=shape)) for shape in shapes)

    def pulled(a, x):
        out, pull = jax.vjp(lambda a, x: sum_of_products(a, x, 1, 1), a, x)
        return pull(jnp.cos(jnp.arange(out.size).reshape(out.shape)))

    with transposed():
        found = pulled(a, x)
    for own, other in zip(found, pulled(a, x), strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-12, atol=1e-13)


@pytest.mark.release
def test_held_numbers_are_what_they_were_with_their_derivatives():
    """In a kernel, alone, in a batch, and where all is constant; in forward and reverse mode."""

    def made(hold):
        def one(x):
            cos, sin = hold((jnp.cos(x), jnp.sin(x)))
            return jnp.stack([cos * sin, hold(cos / (2 + sin)) - x])

        return kernel(one)

    x = jnp.linspace(-1.0, 2.0, 6).reshape(2, 3)

    def all_of(function):
        rates = jax.jvp(function, (x[0],), (x[1],))[1]
        parts = function(x[0]), jax.vmap(function)(x), jax.jacrev(function)(x[1]), rates
        return jnp.concatenate([part.ravel() for part in parts])

    found, expected = (
        jax.jit(all_of, static_argnums=0)(made(f)) for f in (compute_once, lambda a: a)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-15)
    constant = jax.jit(lambda: made(compute_once)(jnp.ones(3)))()
    np.testing.assert_allclose(constant, made(lambda a: a)(jnp.ones(3)), rtol=1e-14)
