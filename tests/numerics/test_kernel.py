"""Steps compiled to one function: the same numbers, in every transformation."""

import functools
import re

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._programs.kernel import kernel
from jaxbeam._programs.lanes import append_axes, pairwise_sum, sum_of_products
from jaxbeam._solvers.system import State
from tests.beams import ROUND

compiled = pytest.mark.skipif(
    jax.default_backend() != "cpu", reason="only on a CPU is all compiled to one function"
)
TABLE = np.random.default_rng(3).normal(size=(5, 6))


def chain(parameters, x):
    """Products, a loop, a solve and sums: what a step is made of."""
    lanes = x.ndim - 1
    y = sum_of_products(append_axes(TABLE, lanes), x[None], 1, lanes)
    y, _ = jax.lax.scan(lambda y, p: (jnp.sin(p * y), None), y, parameters["scale"])
    rows = parameters["rows"] + 0 * x[0]
    z = BlockTridiagonal(rows, absent=1).inverse() @ y
    return {"z": z, "total": pairwise_sum(z**2)}


def case(shape=(), seed=0):
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(*shape, 3, 2, 6))
    rows[..., 2:4] += 9 * np.eye(2)
    parameters = {"scale": rng.uniform(0.5, 1.0, (*shape, 4)), "rows": rows}
    return jax.tree.map(jnp.asarray, (parameters, rng.normal(size=(*shape, 6))))


def plain(parameters, x):
    with jax.numpy_rank_promotion("allow"):
        return chain(parameters, x)


def calls(lowered):
    """Of kernels as one function each: asked for, and in what XLA makes of it, which may repeat
    them, and makes functions of short loops of its own accord."""
    compiled = re.findall(
        r"call\(.*to_apply=%one_function.*small_call", lowered.compile().as_text()
    )
    return asked_for(lowered), len(compiled)


def asked_for(lowered):
    """How many kernels are to be one function each; what is held in them is a function, too."""
    return len(re.findall(r"call @one_function.*small_call", lowered.as_text()))


def close(a, b, **tolerance):
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, **tolerance), a, b)


@pytest.mark.release
@pytest.mark.slow
def test_values_and_first_and_second_derivatives_are_those_of_the_function():
    fast, args, way = kernel(chain), case(), case(seed=1)
    close(jax.jit(fast)(*args), plain(*args), rtol=1e-12, atol=1e-14)

    def push(f):
        return jax.jit(lambda a, d: jax.jvp(f, a, d)[1])(args, way)

    def pull(f):
        return jax.jit(jax.grad(lambda *a: f(*a)["total"], argnums=(0, 1)))(*args)

    def hessian(f):
        return jax.jit(jax.jacfwd(jax.jacfwd(lambda x: f(args[0], x)["total"])))(args[1])

    for derivative in (push, pull, hessian):
        close(derivative(fast), derivative(plain), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("size", "shared"), [(1, True), (70, True), (3, False)])
@pytest.mark.exhaustive
def test_lanes_see_their_own_case_alone(size, shared):
    fast = kernel(chain)
    parameters, x = case((size,))
    axes = (None, 0) if shared else (0, 0)
    if shared:
        parameters = jax.tree.map(lambda a: a[0], parameters)
    close(
        jax.jit(jax.vmap(fast, axes))(parameters, x), jax.vmap(plain, axes)(parameters, x),
        rtol=1e-12, atol=1e-14,
    )  # fmt: skip

    def each(f):
        return jax.vmap(jax.grad(lambda *a: f(*a)["total"], argnums=(0, 1)), axes)(parameters, x)

    def summed(f):
        loss = lambda *a: jnp.sum(jax.vmap(f, axes)(*a)["total"])  # noqa: E731
        return jax.grad(loss, argnums=(0, 1))(parameters, x)

    for gradient in (each, summed):
        close(jax.jit(lambda g=gradient: g(fast))(), gradient(plain), rtol=1e-11, atol=1e-11)


@pytest.mark.slow
def test_rates_that_are_constant_beside_others_that_are_not():
    """As of what is computed from parameters that do not move."""
    fast, (parameters, x) = kernel(chain), case((3,))

    @jax.custom_jvp
    def still(a):
        return a

    still.defjvp(lambda primals, tangents: (primals[0], jnp.zeros_like(primals[0])))

    def loss(f, x):
        return jnp.sum(jax.vmap(f)(jax.tree.map(still, parameters), x)["total"])

    ours = jax.jit(jax.grad(lambda x: loss(fast, x)))(x)
    close(ours, jax.grad(lambda x: loss(plain, x))(x), rtol=1e-11, atol=1e-11)


@pytest.mark.release
@compiled
def test_large_sums_also_in_loops():
    """Written out in pieces: more numbers than may be summed at once."""

    def weighed(a, y):
        return jnp.sum(a * y[None, :, None], (0, 2))

    def f(p, x):
        y, rows = jax.lax.scan(lambda y, a: (y + weighed(a, y), a[0, 0]), x, p)
        return jnp.sum(y) + jnp.sum(rows) + jnp.sum(p * p)

    def g(p, x):
        state = jax.lax.while_loop(
            lambda s: s[0] < 3, lambda s: (s[0] + 1, s[1] + weighed(p[0], s[1])), (0, x)
        )
        return state[1]

    rng = np.random.default_rng(4)
    args = jnp.asarray(rng.normal(size=(2, 17, 17, 20)) / 50), jnp.asarray(rng.normal(size=17))
    for function in (f, g):
        assert calls(jax.jit(kernel(function)).lower(*args)) == (1, 1)
        np.testing.assert_allclose(jax.jit(kernel(function))(*args), function(*args), rtol=1e-12)
    gradient = jax.jit(jax.grad(kernel(f), argnums=(0, 1)))
    assert calls(gradient.lower(*args))[0] >= 1
    close(gradient(*args), jax.grad(f, argnums=(0, 1))(*args), rtol=1e-11, atol=1e-12)


@pytest.mark.release
@pytest.mark.slow
def test_lanes_of_lanes():
    fast = kernel(chain)
    args = case((2, 5))
    close(jax.vmap(jax.vmap(fast))(*args), jax.vmap(jax.vmap(plain))(*args), rtol=1e-12, atol=1e-14)


def test_functions_with_other_operations_still_work():
    fast = kernel(lambda a, x: jnp.sort(jnp.asarray(TABLE[:, :5]) @ x))
    x = jnp.arange(5.0)
    np.testing.assert_allclose(jax.jit(fast)(x, x), np.sort(TABLE[:, :5] @ x), rtol=1e-14)


MODELS = [
    jb.PlanarRod(2),
    jb.papers.GreenANCF(2),
    jb.papers.ANCF(2),
    jb.papers.ChordANCF(2),
    jb.papers.TangentANCF(2),
]


ROTOR = jb.Rotor(ROUND, tip_mass=0.1)


def end(model, solver, rotor, speed, damping=1e-4):
    """Of a short run with all that can act on a beam."""
    run = jb.simulate(
        model, rotor, jb.SmoothSpinUp(speed, 1.0), [0.0, 0.1], solver=solver, dt0=0.01,
        stepsize_controller=diffrax.ConstantStepSize(), throw=False,
        loads=jb.Loads(gravity=[0.0, -9.8, 0.0], tip_force=[0.0, speed, 0.0]),
        damping=jb.Damping(mass_coefficient=0.1, stiffness_coefficient=damping),
    )  # fmt: skip
    return run.tip[-1, 1]


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.PlanarRod(2), jb.papers.ANCF(2)], ids=repr)
def test_a_batch_of_runs_is_as_the_runs_alone(model):
    """Values, and gradients of one model: for others these take a minute each to compile."""
    run = functools.partial(end, model, jb.solvers.Rodas4P(), ROTOR)
    if isinstance(model, jb.PlanarRod):
        run = jax.value_and_grad(run, (0, 1))
    one = jax.jit(run)
    speeds, damping = jnp.array([1.0, 2.0, 5.0]), jnp.array([1e-4, 0.0, 1e-3])
    found = jax.jit(jax.vmap(run))(speeds, damping)
    for i, case in enumerate(zip(speeds, damping, strict=True)):
        close(jax.tree.map(lambda a, i=i: a[i], found), one(*case), rtol=1e-7)


def step(model, speed, mass):
    """Where the tip is after one."""
    rotor, loads = jb.Rotor(ROTOR.beam, tip_mass=mass), jb.Loads([0, -9.8, 0], [0, 1, 0])
    scene = jb.results.Scene(model, rotor, jb.ConstantSpeed(speed), loads, jb.Damping(0.1))
    rest = State(jnp.zeros(scene.mass.shape[0]), jnp.zeros(scene.mass.shape[0]))
    span = jnp.asarray(0.0), jnp.asarray(0.01)
    return jb.solvers.Rodas5P().step(None, *span, rest, scene, None, False)[0].q[-1]


SEVERAL = jnp.full(40, 2.0), jnp.full(40, 0.1)  # more lanes than are worked on together


@pytest.mark.exhaustive
@compiled
@pytest.mark.parametrize("model", MODELS, ids=repr)
def test_steps_of_elements_are_one_function(model):
    """Alone and in batches, and another one backwards: else they take several times as long, and
    nothing but this test tells."""
    run = functools.partial(step, model)
    alone = jax.jit(run).lower(2.0, 0.1)
    batch = jax.jit(jax.vmap(jax.value_and_grad(run, (0, 1)))).lower(*SEVERAL)
    counts = [asked_for(lowered) for lowered in (alone, batch)]
    assert counts == [1, 2]


@compiled
@pytest.mark.exhaustive
def test_steps_are_compiled_to_one_function():
    """What is asked for is what XLA does."""
    run = jax.value_and_grad(functools.partial(step, jb.PlanarRod(2)), (0, 1))
    for lowered in (jax.jit(run).lower(2.0, 0.1), jax.jit(jax.vmap(run)).lower(*SEVERAL)):
        assert calls(lowered) == (2, 2)


@pytest.mark.exhaustive
@compiled
@pytest.mark.parametrize(
    ("model", "solver"),
    [(MODELS[0], jb.solvers.ChordKvaerno5()), (MODELS[1], jb.solvers.Rodas5P())],
    ids=repr,
)
def test_spin_ups_of_elements_are_one_function(model, solver):
    """One makes steps, one the account of energies; the step that is made again for the gradient
    may be the same function, or another."""
    forwards = jax.jit(lambda r: end(model, solver, r, 1.0)).lower(ROTOR)
    assert asked_for(forwards) == 2
    backwards = jax.jit(jax.grad(lambda r: end(model, solver, r, 1.0))).lower(ROTOR)
    assert asked_for(backwards) >= 3


@pytest.mark.exhaustive
@pytest.mark.parametrize("n", [48])
def test_any_number_of_elements(n):
    """Programs grow with it, and XLA treats large operations in other ways."""

    def tip(n, speed):
        run = jb.simulate(jb.PlanarRod(n), ROTOR, jb.SmoothSpinUp(speed, 5.0), [0.0, 2.0])
        return run.tip[-1, 1]

    np.testing.assert_allclose(tip(n, 2.0), tip(16, 2.0), rtol=1e-4)
    batch = jax.jit(jax.vmap(lambda speed: tip(n, speed)))(jnp.array([2.0, 3.0]))
    np.testing.assert_allclose(batch[0], tip(n, 2.0), rtol=1e-6)
