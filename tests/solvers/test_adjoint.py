"""Reverse mode of a run: the derivative of what was computed, to rounding."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._programs.kernel import reverse_mode as kernels_reverse_mode
from jaxbeam._simulation.scene import Scene
from jaxbeam._solvers import run as loop
from jaxbeam._solvers.system import State
from tests.helpers import reverse_mode

TIMES = jnp.linspace(0.0, 1.2, 13)
P = jnp.array([1.3, 1.1, 4e4, 11.0, 0.4, 0.3, 3.0, 0.9])


def rotor_of(p):
    return jb.Rotor(jb.Beam(p[0], p[1], p[2], p[3], p[3]), p[4], p[5])


def spin_up(model, p, times=TIMES, motion=None, **options):
    motion = jb.SmoothSpinUp(p[6], p[7]) if motion is None else motion(p)
    return jb.simulate(model, rotor_of(p), motion, times, throw=False, **options)


def both(value, outputs, p, **options):
    """The Jacobian of so many outputs by our adjoint, and by that of diffrax."""
    found = []
    for adjoint in (None, diffrax.RecursiveCheckpointAdjoint()):

        def function(p, adjoint=adjoint):
            return value(p, adjoint=adjoint, **options)

        found.append(reverse_mode(function, outputs)[1](p))
    return found


def check(ours, other, tolerance=1e-10):
    scale = np.abs(other).max(-1, keepdims=True)
    assert (scale > 0).all()
    np.testing.assert_array_less(np.abs(ours - other) / scale, tolerance)


def step_of(system_of, n):
    """Of a step of `Rodas5P`: some number by parameters, the state before it, and both times."""
    solver = jb.solvers.Rodas5P()
    term = jb.solvers.SecondOrderSystem.term(solver)

    def number(p, q, v, t):
        y, error, info, _, _ = solver.step(term, t[0], t[1], State(q, v), system_of(p), None, False)
        weight = jnp.cos(jnp.arange(1.0, n + 1))
        parts = [y.q, y.v**2, error.q, error.v, *info["coefficients"].q, *info["coefficients"].v]
        return sum(i * (weight**i @ part) for i, part in enumerate(parts, 1))

    return number


def check_step(system_of, n, p, lanes=0):
    """The adjoint of a step is the transpose of its operations by JAX, by all arguments."""
    number = step_of(system_of, n)
    state = 0.01 * np.random.default_rng(1).normal(size=(2, n))
    args = (p, *jnp.asarray(state), jnp.array([0.7, 0.72]))
    grad = jax.grad(number, (0, 1, 2, 3))

    def by_adjoint(*args):
        with kernels_reverse_mode():
            return jax.grad(number, (0, 1, 2, 3))(*args)

    if lanes:
        factors = 1 + 0.01 * jnp.arange(lanes)
        args = jax.tree.map(lambda a: factors.reshape(-1, *(1,) * a.ndim) * a[None], args)
        grad, by_adjoint = jax.vmap(grad), jax.vmap(by_adjoint)
    found, expected = jax.jit(lambda *args: (by_adjoint(*args), grad(*args)))(*args)
    for own, other in zip(found, expected, strict=True):
        check(own, other, 1e-11)


class Pendulum(jb.solvers.SecondOrderSystem):
    """Something not linear in anything, with a matrix that is not symmetric."""

    mass: jax.Array
    p: jax.Array

    def inputs(self, t):
        return jnp.sin(self.p[2] * t)

    def force(self, x, q, v):
        rotated = jnp.stack([q[1], -(q[0] ** 3)])
        return x * self.p[:2] - jnp.sin(q) * (1 + q[0]) + self.p[1] * rotated - q * v**2


def test_step_back():
    """Of dense matrices."""

    def system_of(p):
        return Pendulum(jnp.array([[2.0, 0.4], [0.3, 1.0]]) * p[0], p)

    check_step(system_of, 2, jnp.array([1.1, 0.7, 3.0]))


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "lanes"),
    [(jb.PlanarRod(2), 3), (jb.papers.ANCF(2), 0)],
    ids=str,
)
def test_step_back_of_elements(model, lanes):
    """Also under loads and damping, and with a body at the tip."""

    def system_of(p):
        body = jb.TipBody(p[5], 0.1 * p[4], 0.2 * p[5])
        beam = jb.Beam(p[0], p[1], p[2], p[3], p[3], torsional_stiffness=p[3])
        loads = jb.Loads(tip_force=lambda t: p[3] * jnp.sin(t) * jnp.array([1.0, 1.0, 0.0]))
        return Scene(
            model, jb.Rotor(beam, p[4], tip_body=body), jb.SmoothSpinUp(p[6], p[7]), loads,
            jb.Damping(0.1 * p[4], 0.01 * p[5]), TIMES,
        )  # fmt: skip

    check_step(system_of, len(model.directions), P, lanes)


CASES = {
    "chord": {"solver": jb.solvers.ChordKvaerno5()},
    "exponential": {"solver": jb.solvers.Magnus()},
    "clipped": {
        "stepsize_controller": diffrax.ClipStepSizeController(
            diffrax.PIDController(1e-5, 1e-7), jump_ts=jnp.array([0.31, 0.8])
        )
    },
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("options", CASES.values(), ids=CASES.keys())
def test_is_that_of_diffrax(options):
    """Peak and end, also for solvers that keep a state and for controllers that tell of jumps."""

    def value(p, **options):
        run = spin_up(jb.Hybrid(0, 2, 0), p, **options)
        return jnp.stack([run.peak()[0], run.tip[-1, 1], run.strain_energy[7]])

    check(*both(value, 3, P, **{"max_steps": 4000} | options))


@pytest.mark.exhaustive
def test_checkpoints(monkeypatch):
    """Where steps are more than rows, states in between are computed once more: nothing changes."""
    monkeypatch.setattr(loop, "ROWS", 32)

    def value(p, **options):
        run = spin_up(jb.Hybrid(0, 2, 0), p, **options)
        return jnp.stack([run.peak()[0], run.tip[-1, 1]])

    options = {"stepsize_controller": diffrax.PIDController(1e-6, 1e-8), "dt0": 0.01}
    steps = spin_up(jb.Hybrid(0, 2, 0), P, **options).solution.stats["num_accepted_steps"]
    assert 50 < steps < 256
    check(*both(value, 2, P, max_steps=256, **options))


@pytest.mark.release
def test_rows_of_the_tape():
    """Every state that the sweep asks for is where it was put, whatever the number of steps."""
    rows = 8
    tape = np.full(rows, -1)
    for step in range(64):
        checkpoint_level = int(loop.checkpoint_level(jnp.asarray(step), rows))
        if step % 2**checkpoint_level == 0:
            place = int(loop.tape_row(jnp.asarray(step), rows))
            assert 0 <= place < rows
            tape[place] = step
        wanted = range(0, step + 1, 2**checkpoint_level)
        assert len(wanted) <= rows
        assert [tape[int(loop.tape_row(jnp.asarray(k), rows))] for k in wanted] == list(wanted)


@pytest.mark.exhaustive
def test_batch_with_a_lane_that_fails():
    """Lanes are alike and alone; one that fails has no share in the gradient."""
    model = jb.Hybrid(0, 2, 0)
    speeds = jnp.array([1.0, 3.0, jnp.nan, 5.0, 1.0])

    def total(p, **options):
        def one(speed):
            run = spin_up(model, p.at[6].set(speed), max_steps=4000, **options)
            return jnp.where(run.status == jb.Status.OK, run.peak()[0], 0.0)

        return jnp.sum(jax.vmap(one)(speeds))[None]

    def single(p, speed):
        return spin_up(model, p.at[6].set(speed), max_steps=4000).peak()[0]

    gradient = jax.jit(jax.grad(lambda p: total(p)[0]))(P)
    pull = jax.jit(jax.grad(single))
    alone = sum(pull(P, speed) for speed in speeds if np.isfinite(speed)).at[6].set(0.0)
    np.testing.assert_allclose(gradient, alone, rtol=1e-9, atol=1e-9 * np.abs(alone).max())

    each = jax.jit(jax.vmap(jax.grad(single), (None, 0)))(P, speeds)
    for own, speed in zip(each, speeds, strict=True):
        if np.isfinite(speed):
            np.testing.assert_allclose(own, pull(P, speed), rtol=1e-9, atol=1e-12)
        else:
            assert np.isfinite(own).all()


@pytest.mark.exhaustive
def test_by_times_of_outputs():
    """The first is where the run begins, the last where it ends. As differences have it: what the
    adjoint of diffrax says here depends on how it is compiled."""

    @jax.jit
    def value(p):
        times = jnp.stack([0.2 * p[6], 0.3 * p[0], 0.312 * p[3], 1.3 * p[1]])
        run = spin_up(
            jb.Hybrid(0, 2, 0), P, times, max_steps=256,
            stepsize_controller=diffrax.ConstantStepSize(), dt0=0.01,
        )  # fmt: skip
        return run.tip[1:, 1]

    p, h = P / jnp.array([1, 1, 1, 5.0, 1, 1, 10, 1]), 1e-6
    ours = reverse_mode(value, 3)[1](p)
    other = [(value(p + h * e) - value(p - h * e)) / (2 * h) for e in np.eye(8)]
    check(ours, np.stack(other, 1), 2e-4)


@pytest.mark.exhaustive
def test_with_an_event():
    """When and how a run ends at a limit of the deflection, by the limit too."""

    def value(p, **options):
        event = jb.deflection_limit(0.05 * p[7])
        run = spin_up(jb.Hybrid(0, 2, 0), p, event=event, max_steps=2000, **options)
        last = jnp.sum(jnp.isfinite(run.times)) - 1
        return jnp.stack([run.end_time, run.tip[last, 1], run.state.v[last, 0]])

    ours, other = both(value, 3, P.at[6].set(8.0))
    check(ours, other, 1e-8)
    run = spin_up(jb.Hybrid(0, 2, 0), P.at[6].set(8.0), event=jb.deflection_limit(0.05))
    assert run.end_time < 1.0


@pytest.mark.exhaustive
def test_with_jumps_and_closures():
    """By the times of jumps and corners, and by what functions of the user close over."""

    def value(p, **options):
        def speed(t):
            return jnp.stack([0.0 * t, 0.0 * t, jnp.where(t > p[0], p[1], 0.0) + p[2] * t])

        motion = jb.motions.HubVelocity(lambda t: 0.0 * speed(t), speed, jumps=p[:1])
        loads = jb.Loads(tip_force=lambda t: p[3] * jnp.sin(t) * jnp.array([1.0, 1.0, 0.0]))
        run = jb.simulate(
            jb.Hybrid(0, 2, 0), rotor_of(P), motion, TIMES, loads=loads, throw=False,
            max_steps=2000, **options,
        )  # fmt: skip
        return run.tip[-1:, 1]

    check(*both(value, 1, jnp.array([0.33, 0.5, 0.7, 0.2])), 1e-9)


@pytest.mark.slow
def test_a_step_is_pushed_forward_and_back():
    """By its state alone, so that rules of parts of which nothing is asked must be gone: each one
    and in a batch of directions, as differences have it."""
    motion = jb.SmoothSpinUp(3.0, 0.9)
    scene = Scene(jb.Hybrid(0, 2, 0), rotor_of(P), motion, jb.Loads(), jb.Damping(), TIMES)
    number = step_of(lambda p: scene, 2)

    @jax.jit
    def slope(q):
        with kernels_reverse_mode():
            return jax.grad(lambda q: number(P, q, 0.3 * q, jnp.array([0.7, 0.72])))(q)

    q, h = jnp.array([0.01, -0.004]), 1e-5
    hessian = jax.jit(jax.jacfwd(slope))(q)
    expected = [(slope(q + h * e) - slope(q - h * e)) / (2 * h) for e in np.eye(2)]
    check(hessian, np.stack(expected, 1), 1e-6)
    one = jax.jit(lambda q: jax.jvp(slope, (q,), (jnp.array([1.0, 0.0]),))[1])(q)
    check(one[None], hessian[:, :1].T, 1e-12)


@pytest.mark.exhaustive
def test_second_derivatives():
    """Forward over reverse, symmetric and as differences have it; reverse over reverse is refused
    by JAX."""
    fixed = {"stepsize_controller": diffrax.ConstantStepSize(), "dt0": 0.02, "max_steps": 64}

    def value(p):
        return spin_up(jb.Hybrid(0, 2, 0), P.at[jnp.array([4, 5])].set(p), **fixed).tip[-1, 1]

    p = P[jnp.array([4, 5])]
    slope = jax.jit(jax.grad(value))
    hessian = jax.jit(jax.jacfwd(jax.grad(value)))(p)
    h = 1e-5
    expected = [(slope(p + h * e) - slope(p - h * e)) / (2 * h) for e in np.eye(2)]
    np.testing.assert_allclose(hessian, expected, rtol=1e-6)
    np.testing.assert_allclose(hessian, hessian.T, rtol=1e-9)
    with pytest.raises(ValueError, match="everse-mode"):
        jax.grad(lambda p: jnp.sum(jax.grad(value)(p)))(p)


@pytest.mark.exhaustive
def test_second_derivatives_of_elements():
    """The same along one direction, where steps and their adjoints are kernels."""

    def value(p):
        rotor = jb.Rotor(jb.Beam(8.0, 0.2, 5e5, p, 566.0), 0.5, 0.1)
        run = jb.simulate(
            jb.PlanarRod(1), rotor, jb.SmoothSpinUp(4.0, 1.0), [0.0, 0.3], max_steps=256,
            throw=False,
        )  # fmt: skip
        return run.tip[-1, 1]

    p, h = 566.0, 0.1
    slope = jax.jit(jax.grad(value))
    _, curved = jax.jit(lambda p: jax.jvp(jax.grad(value), (p,), (1.0,)))(p)
    np.testing.assert_allclose(curved, (slope(p + h) - slope(p - h)) / (2 * h), rtol=1e-6)


@pytest.mark.slow
def test_bounds_of_memory():
    """The tape has a fixed number of rows, and max_steps=None none that would do."""
    model = jb.Hybrid(0, 2, 0)
    with pytest.raises(ValueError, match="give max_steps"):
        jax.grad(lambda p: spin_up(model, p, max_steps=None).tip[-1, 1])(P)
    run = spin_up(model, P, max_steps=None)
    assert run.status == jb.Status.OK
    assert eqx.is_array(run.tip)
