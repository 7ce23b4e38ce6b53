"""Compiled functions, called by users and within other programs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._programs import program
from jaxbeam._programs.program import _HASTE, CALLS, Program, _known
from tests.beams import README_ROTOR, ROUND
from tests.compilation import OLD_EMITTERS


@pytest.mark.release
def test_haste_where_the_compiler_knows_it():
    """Nothing else tells whether users wait twice as long."""
    assert bool(_known(_HASTE)) == OLD_EMITTERS


@pytest.mark.release
def test_first_calls_are_compiled_quickly():
    """Of each kind of arguments by itself; also of a user's functions, which are no arrays."""
    assert _known(program.QUICK)

    @Program
    def scaled(x, function):
        return function(x)

    x, double = jnp.asarray(3.0), lambda x: 2 * x
    assert scaled.quick is not scaled.well
    for kind in ((x, double), (x[None], double), (x, jnp.sin)):
        taken = [scaled.for_call(*kind) for _ in range(CALLS + 2)]
        assert taken == [scaled.quick] * CALLS + [scaled.well] * 2
    assert scaled(x, double) == 6.0
    assert Program(lambda x: x, calls=0).for_call(x) is not None


@pytest.mark.release
def test_a_call_within_another_program_is_a_part_of_it():
    seen = []

    @Program
    def squared(x):
        return x**2

    def asked(x):
        seen.append(squared.for_call(x))
        return squared(x)

    x = jnp.asarray(3.0)
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
        assert all(each is (squared.quick if call is asked else squared.part) for each in seen)


class _Mixed(eqx.Module):
    """A result with arrays, numbers and a name."""

    value: jax.Array
    count: jax.Array
    name: str = eqx.field(static=True)
    size: int = 3


@pytest.mark.release
def test_transformations_outside_of_programs_compile_by_options():
    """Values, slopes and batches of a function of numbers, whole ones and objects, whose result is
    a mixture; the same as of its closed form x^3 n."""

    @Program
    def mixed(x, n, *, power):
        return _Mixed(x**power * n, n + 1, "cube", 3)

    def cube(x):
        found = mixed(x, jnp.asarray(2), power=3)
        assert (found.name, found.size, found.count.dtype) == ("cube", 3, jnp.asarray(2).dtype)
        return found.value

    def twice(x):  # with a whole number that JAX transforms, too
        return mixed(x, jax.lax.stop_gradient(x).astype(int), power=3).value

    x, xs = jnp.asarray(3.0), jnp.asarray([1.0, 3.0])
    for found, value in (
        (jax.grad(cube)(x), 54.0),
        (jax.value_and_grad(cube)(x), (54.0, 54.0)),
        (jax.grad(twice)(x), 81.0),
        (jax.jvp(cube, (x,), (x,)), (54.0, 162.0)),
        (jax.linearize(cube, x)[1](x), 162.0),
        (jax.jit(jax.linearize(cube, x)[1])(x), 162.0),
        (jax.vjp(cube, x)[1](x)[0], 162.0),
        (jax.vmap(cube)(xs), [2.0, 54.0]),
        (jax.vmap(jax.grad(cube))(xs), [6.0, 54.0]),
        (jax.grad(lambda xs: jnp.sum(jax.vmap(cube)(xs)))(xs), [6.0, 54.0]),
        (jax.jacrev(jax.vmap(cube))(xs), [[6.0, 0.0], [0.0, 54.0]]),
        (jax.hessian(cube)(x), 36.0),
        (jax.jacrev(jax.jacfwd(cube))(x), 36.0),
        (jax.grad(jax.grad(cube))(x), 36.0),
        (jax.jit(jax.grad(cube))(x), 54.0),
        (jax.grad(jax.jit(cube))(x), 54.0),
        (jax.grad(jax.checkpoint(cube))(x), 54.0),
    ):
        np.testing.assert_array_equal(found, value)

    # A function among the arguments may close over what is differentiated.
    applied = Program(lambda x, function: function(x))
    for closed in (lambda x: applied(x, lambda y: x * y), lambda x: applied(3.0, lambda y: x * y)):
        slope = 2 * float(x) if float(closed(x + 1)) == 16.0 else 3.0
        assert float(jax.grad(closed)(x)) == slope
        assert float(jax.jvp(closed, (x,), (x,))[1]) == 3.0 * slope
        np.testing.assert_array_equal(jax.vmap(jax.grad(closed))(x[None]), [slope])

    fresh = Program(lambda x: x**2)
    taken = []
    for _ in range(CALLS + 1):
        jax.grad(fresh)(x)
        taken.append("_linear" in vars(fresh.well))
    assert "_linear" in vars(fresh.quick)
    assert taken == [False] * CALLS + [True]
    many = Program(lambda x: x**2)
    jax.vmap(jax.grad(many))(xs)  # a batch begins with the good program
    assert "_linear" in vars(many.well)
    assert "_linear" not in vars(many.quick)


@pytest.mark.slow
def test_a_long_run_is_compiled_well(monkeypatch):
    """A run that takes more steps than it is worth to save the compiler is made anew, and is the
    same; what it says of its steps is of what was asked for."""
    model, times = jb.Hybrid(0, 2, 0), jnp.linspace(0.0, 8.0, 3)

    def run():
        return jb.simulate(model, README_ROTOR, jb.SmoothSpinUp(4.0, 6.0), times, max_steps=5000)

    short = run()
    assert short.solution.stats["max_steps"] == 5000
    monkeypatch.setattr("jaxbeam._simulation.first_short.STEPS", 10)
    long = run()
    assert long.solution.stats["num_steps"] == short.solution.stats["num_steps"] > 10
    assert long.solution.stats["max_steps"] == 5000
    np.testing.assert_allclose(long.tip, short.tip, rtol=1e-10)


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
