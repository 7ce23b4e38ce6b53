"""Compiled functions, called by users and within other programs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._programs.program import Program, _haste
from tests.beams import ROUND
from tests.compilation import OLD_EMITTERS


@pytest.mark.release
def test_haste_where_the_compiler_knows_it():
    """Nothing else tells whether users wait twice as long."""
    assert _haste() == OLD_EMITTERS


@pytest.mark.release
def test_a_call_within_another_program_is_a_part_of_it():
    seen = []

    @Program
    def squared(x):
        return x**2

    def asked(x):
        seen.append(squared.here)
        return squared(x)

    x = jnp.asarray(3.0)
    alone = squared.alone if OLD_EMITTERS else squared.part
    for call, value in (
        (asked, 9.0),
        (jax.grad(asked), 6.0),
        (lambda x: jax.jvp(asked, (x,), (x,))[1], 18.0),
        (lambda x: jax.vmap(asked)(x[None])[0], 9.0),
        (lambda x: eqx.filter_vmap(asked)(x[None])[0], 9.0),
        (lambda x: jax.linearize(asked, x)[0], 9.0),
        (jax.jit(asked), 9.0),
        (jax.jacfwd(jax.grad(asked)), 2.0),
        (lambda x: jax.lax.map(asked, x[None])[0], 9.0),
    ):
        seen.clear()
        assert float(call(x)) == value
        assert seen
        assert all(each is (alone if call is asked else squared.part) for each in seen)


@pytest.mark.exhaustive
def test_numbers_that_a_motion_closes_over():
    """They are traced, and no argument of the program shows it."""
    rotor = jb.Rotor(ROUND, 0.5, 0.1)

    def tip(size):
        axis, none = jnp.array([0.0, 0.0, 1.0]), jnp.zeros(3)
        motion = jb.motions.HubVelocity(lambda t: none, lambda t: size * axis * jnp.sin(t) ** 2)
        times = jnp.array([0.0, 1.0])
        return jb.simulate(jb.Hybrid(0, 1, 0), rotor, motion, times, throw=False).tip[-1, 1]

    slope = (tip(0.501) - tip(0.499)) / 0.002
    np.testing.assert_allclose(jax.grad(tip)(0.5), slope, rtol=1e-4)
    np.testing.assert_allclose(jax.vmap(tip)(jnp.array([0.5, 1.0]))[0], tip(0.5), rtol=1e-6)
