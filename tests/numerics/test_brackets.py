"""Changes of sign are found where they are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxbeam._numerics.brackets import Looks, first_change, halved


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
