"""Changes of sign are found where they are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxbeam._numerics.brackets import Looks, change_between, first_change, halved, root


def test_halved_intervals_hold_the_place():
    ends = jnp.zeros(3), jnp.full(3, 2.0)
    places = np.array([0.3, 1.0, 1.7])
    low, high = jax.jit(lambda low, high: halved(lambda x: x < places, low, high, 40))(*ends)
    assert np.all((low <= places) & (places <= high))
    np.testing.assert_allclose(high - low, 2.0**-39)


@pytest.mark.parametrize("signs", [False, True])
def test_the_first_change_is_found_in_each_case(signs):
    """That of cos(k x) at pi / (2 k), from 0.1 on in steps of a tenth; none up to 2 is told."""

    @jax.vmap
    def search(k):
        def look(here):
            value = jnp.cos(k * here.value)
            number = jnp.where(value > 0, 1.0, -1.0) if signs else value
            return number, here.tries, jnp.asarray(False)

        looks = Looks(jnp.asarray(0.1), 1.1, jnp.asarray(2.0), 40, 1e-12, signs)
        end = first_change(look, looks, jnp.asarray(0), lambda kept: kept < 1000)
        return end.value, end.found, end.ended(looks), end.kept

    k = jnp.array([0.5, 1.0, 2.0, 5.0])
    value, found, ended, tries = jax.jit(search)(k)
    np.testing.assert_array_equal(found, [False, True, True, True])
    assert np.all(ended)
    np.testing.assert_allclose(value[1:], np.pi / 2 / k[1:], rtol=1e-11)
    assert np.all(tries < (80 if signs else 50))


def test_a_change_between_two_places_is_found_to_rounding():
    """Of x^3 - c from either side, at an end and where the function jumps; and how it goes with c,
    twice: c^(1/3) / 3c and -2/9 c^(1/3) / c^2."""

    def found(c, low, high):
        ends = low, high
        place = change_between(lambda x: x**3 - c, ends, tuple(x**3 - c for x in ends))
        return root(lambda c, x: x**3 - c, c, jax.lax.stop_gradient(place))

    low, high = jnp.array([-1.0, 3.0, -1.0, 2.0]), jnp.array([2.0, -7.0, 2.0, 5.0])
    c = jnp.array([1.7, -40.0, -1.0, 8.0])
    second = jax.grad(jax.grad(found))
    value, slope, bend = jax.jit(jax.vmap(lambda *x: (found(*x), jax.grad(found)(*x), second(*x))))(
        c, low, high
    )
    exact = np.cbrt(c)
    np.testing.assert_allclose(value, exact, rtol=4e-16)
    np.testing.assert_allclose(slope, exact / 3 / c, rtol=1e-14)
    np.testing.assert_allclose(bend, -2 / 9 * exact / c**2, rtol=1e-14)
    jump = change_between(
        lambda x: jnp.sign(x - 0.3), (jnp.asarray(-1.0), jnp.asarray(2.0)), (-1, 1)
    )
    np.testing.assert_allclose(jump, 0.3, rtol=1e-14)
