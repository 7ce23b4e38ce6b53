"""The Rosenbrock solver on second-order systems, through diffrax alone."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb


class Forced(jb.SecondOrderSystem):
    """Two oscillators, one stiff, coupled by a cubic spring and driven so that q is known.

    q = (sin t, cos 2t / 10) solves it; work' = q_1 q_1' makes work = sin^2 t / 2.
    """

    mass: jax.Array
    stiff: jax.Array

    def known(self, t):
        return jnp.stack([jnp.sin(t), jnp.cos(2 * t) / 10])

    def pull(self, q, v):
        matrix = jnp.array([[3.0, -1.0], [-1.0, 1.0]]).at[1, 1].add(self.stiff)
        return matrix @ q + 0.3 * (q[0] - q[1]) ** 3 * jnp.array([1.0, -1.0]) + 0.2 * v * v[0]

    def force(self, t, q, v):
        one = (jnp.ones_like(t),)
        exact, rate = jax.jvp(self.known, (t,), one)
        second = jax.jvp(lambda t: jax.jvp(self.known, (t,), one)[1], (t,), one)[1]
        return self.mass @ second + self.pull(exact, rate) - self.pull(q, v)

    def power(self, t, q, v):
        return q[0] * v[0]


MASS = jnp.array([[2.0, 0.4], [0.4, 1.0]])


def system(stiff):
    return Forced(MASS, jnp.asarray(stiff))


def solve(args, **kwargs):
    y0 = jb.State(jnp.array([0.0, 0.1]), jnp.array([1.0, 0.0]), jnp.zeros(()))
    solver = kwargs.pop("solver", jb.Rodas5P())
    return diffrax.diffeqsolve(
        jb.second_order_term(solver), solver, 0.0, 2.0, y0=y0, args=args, max_steps=10_000, **kwargs
    )


def slope(errors, steps):
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


@pytest.mark.parametrize(("stiff", "order"), [(0.0, 5.0), (1e4, 4.0)])
def test_order(stiff, order):
    """5 where nothing is stiff; stiff components cost at most one (Steinebach 2023)."""
    steps = np.array([0.05, 0.025, 0.0125])
    run = jax.jit(lambda h: solve(system(stiff), dt0=h).ys)
    ends = [run(h) for h in steps]
    errors = [np.abs(y.q[0] - system(stiff).known(2.0)).max() for y in ends]
    assert slope(errors, steps) > order - 0.25
    assert errors[-1] < 1e-6
    work = [abs(y.work[0] - np.sin(2.0) ** 2 / 2) for y in ends]
    assert work[-1] < errors[-1] + 1e-10
    if stiff == 0:
        assert slope(work, steps) > order - 0.25


def test_order_of_dense_output():
    """4, between steps."""
    steps = np.array([0.2, 0.1, 0.05])
    times = jnp.linspace(0.03, 1.97, 37)
    run = jax.jit(lambda h: solve(system(1e2), dt0=h, saveat=diffrax.SaveAt(ts=times)).ys.q)
    exact = jax.vmap(system(1e2).known)(times)
    errors = [np.abs(run(h) - exact).max() for h in steps]
    assert slope(errors, steps) > 3.75


def test_error_estimate_is_honest():
    """The error follows the tolerance, over six decades, and stays within a hundredfold of it."""
    run = jax.jit(
        lambda tol: (
            solve(
                system(1e4), dt0=None, stepsize_controller=diffrax.PIDController(rtol=tol, atol=tol)
            ).ys.q
        )
    )
    for tol in (1e-4, 1e-6, 1e-8, 1e-10):
        assert np.abs(run(tol)[0] - system(1e4).known(2.0)).max() < 100 * tol


def test_stock_solvers_take_the_same_system():
    exact = system(1e2).known(2.0)
    for solver in (diffrax.Dopri8(), diffrax.KenCarp4()):  # explicit; implicit-explicit
        controller = diffrax.PIDController(rtol=1e-5, atol=1e-5)
        end = solve(system(1e2), solver=solver, dt0=None, stepsize_controller=controller).ys
        np.testing.assert_allclose(end.q[0], exact, atol=1e-4)


def test_refuses_what_is_not_a_second_order_system():
    with pytest.raises(TypeError, match="SecondOrderSystem"):
        solve(None, dt0=0.1)
