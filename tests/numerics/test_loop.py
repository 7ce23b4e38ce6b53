"""Loops whose batches wait for nobody: same numbers, in order, in no more steps than needed."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.custom_batching import custom_vmap

from jaxbeam._programs.loop import loop
from tests.tiers import slow

STEPS: list[int] = []


@custom_vmap
def counted(x: Any) -> Any:
    """x; a batch writes down how many go ahead at once."""
    return x


@counted.def_vmap
def _count(size: int, batched: Any, x: Any) -> Any:
    jax.debug.callback(lambda _: STEPS.append(size), x.ravel()[0])
    return x, batched[0]


def power(base: Any, exponent: Any) -> Any:
    """base ** exponent and the exponent, by a loop."""

    def step(fixed: Any, state: Any) -> Any:
        x, k = state
        on = k < fixed[1]
        return jnp.where(on, counted(x) * fixed[0], x), k + on

    start = jnp.ones_like(base), jnp.zeros_like(exponent)
    return loop(lambda fixed, state: state[1] < fixed[1], step, (base, exponent), start)


def cases(n: int, longest: int = 40) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(n)
    return random.uniform(0.5, 1.5, n), random.integers(0, longest, n)


@pytest.mark.release
@pytest.mark.parametrize("n", [1, 2, 33, slow(32), slow(200)])
def test_batches_are_what_single_loops_are(n: int) -> None:
    base, exponent = cases(n)
    values, counts = jax.jit(jax.vmap(power))(base, exponent)
    np.testing.assert_array_equal(counts, exponent)
    alone = [float(power(b, e)[0]) for b, e in zip(base[:40], exponent[:40], strict=True)]
    np.testing.assert_array_equal(values[:40], alone)
    np.testing.assert_allclose(values, base**exponent, rtol=1e-13)


@pytest.mark.parametrize("shared", ["base", "exponent"])
def test_what_cases_share(shared: str) -> None:
    base, exponent = cases(100)
    if shared == "base":
        values = jax.vmap(power, in_axes=(None, 0))(jnp.asarray(1.25), exponent)[0]
        base = np.full(100, 1.25)
    else:
        values = jax.vmap(power, in_axes=(0, None))(base, jnp.asarray(7))[0]
        exponent = np.full(100, 7)
    np.testing.assert_allclose(values, base**exponent, rtol=1e-13)


@pytest.mark.slow
def test_a_batch_of_batches_is_a_batch() -> None:
    base, exponent = cases(120)
    values, counts = jax.jit(jax.vmap(jax.vmap(power)))(
        base.reshape(8, 15), exponent.reshape(8, 15)
    )
    np.testing.assert_allclose(values.ravel(), base**exponent, rtol=1e-13)
    np.testing.assert_array_equal(counts.ravel(), exponent)
    STEPS.clear()
    grid = jax.vmap(jax.vmap(power, in_axes=(None, 0)), in_axes=(0, None))(base, exponent)[0]
    np.testing.assert_allclose(grid, base[:, None] ** exponent, rtol=1e-13)
    jax.effects_barrier()
    assert set(STEPS) == {32}  # what one of the two shares is no other way


@pytest.mark.parametrize("nested", [False, True])
def test_nobody_waits_for_the_slowest(nested: bool) -> None:
    """One case in ten takes twenty times as long; together they take little more than their own
    steps, and the tail of the last ones."""
    exponent = np.where(np.arange(640) % 10 == 3, 200, 10)
    base = np.full(640, 1.01)
    STEPS.clear()
    function: Any = power
    if nested:
        base, exponent, function = base.reshape(40, 16), exponent.reshape(40, 16), jax.vmap(power)
    jax.block_until_ready(jax.jit(jax.vmap(function))(base, exponent))
    jax.effects_barrier()
    assert set(STEPS) == {32}
    own = exponent.sum() / 32
    assert own <= len(STEPS) <= 1.2 * own + 200


def test_forward_derivatives() -> None:
    base, exponent = cases(50)

    def rate(base: Any, exponent: Any) -> Any:
        return jax.jvp(lambda b: power(b, exponent)[0], (base,), (jnp.ones_like(base),))[1]

    exact = exponent * base ** (exponent - 1.0)
    np.testing.assert_allclose(jax.vmap(rate)(base, exponent), exact, rtol=1e-12)
    forward = jax.jvp(
        lambda b: jax.vmap(power)(b, jnp.asarray(exponent))[0], (base,), (np.ones_like(base),)
    )[1]
    np.testing.assert_allclose(forward, exact, rtol=1e-12)


@pytest.mark.slow
def test_rates_ride_with_their_cases() -> None:
    """In forward mode nobody waits either, and the rates of one case take its steps together."""
    exponent = np.where(np.arange(640) % 10 == 3, 200, 10)
    base = np.stack([np.full(640, 1.01), np.linspace(0.9, 1.1, 640)], 1)

    def product(pair: Any, exponent: Any) -> Any:
        return power(pair[0] * pair[1], exponent)[0]

    def rate(pair: Any, exponent: Any) -> Any:
        return jax.jvp(lambda pair: product(pair, exponent), (pair,), (jnp.array([1.0, 0.0]),))[1]

    STEPS.clear()
    first = jax.jit(jax.vmap(rate))(base, exponent)
    jax.effects_barrier()
    own = exponent.sum() / 32
    assert set(STEPS) == {32}
    assert own <= len(STEPS) <= 1.2 * own + 200
    exact = exponent[:, None] * np.prod(base, 1)[:, None] ** exponent[:, None] / base
    np.testing.assert_allclose(first, exact[:, 0], rtol=1e-11)
    rates = jax.jit(jax.vmap(jax.jacfwd(product)))(base, exponent)
    np.testing.assert_allclose(rates, exact, rtol=1e-11)


def test_rates_of_a_batch() -> None:
    base, exponent = cases(40)

    def mean(factors: Any) -> Any:
        scaled = jnp.asarray(base) * factors[0] * factors[1]
        return jax.vmap(power)(scaled, jnp.asarray(exponent))[0]

    rates = jax.jit(jax.jacfwd(mean))(jnp.array([1.0, 1.0]))
    exact = np.stack([exponent * base**exponent] * 2, 1)
    np.testing.assert_allclose(rates, exact, rtol=1e-11)


@pytest.mark.release
def test_second_derivatives() -> None:
    base, exponent = cases(40)
    second = jax.vmap(jax.jacfwd(jax.jacfwd(lambda b, e: power(b, e)[0])))(base, exponent)
    exact = exponent * (exponent - 1) * base ** (exponent - 2.0)
    np.testing.assert_allclose(second, exact, rtol=1e-11)
