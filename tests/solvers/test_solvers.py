"""Solvers of second-order systems, through diffrax alone."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

import jaxbeam as jb
from tests.beams import SPRINGS, short
from tests.tiers import exhaustive, slow


class Forced(jb.solvers.SecondOrderSystem):
    """Two oscillators, one stiff, coupled by a spring and driven so that q is known.

    q = (sin t, cos 2t / 10) solves it; work' = q_1 q_1' makes work = sin^2 t / 2. Nothing in it is
    constant: stiffness and damping change with time, and, unless linear, with q and q'.
    """

    mass: jax.Array
    stiff: jax.Array
    cubic: float = 0.3
    drag: float = 0.2

    @property
    def is_linear(self):
        return self.cubic == self.drag == 0

    def known(self, t):
        return jnp.stack([jnp.sin(t), jnp.cos(2 * t) / 10])

    def pull(self, t, q, v):
        matrix = jnp.array([[3.0, -1.0], [-1.0, 1.0]]).at[1, 1].add(self.stiff)
        turning = jnp.sin(t) * jnp.stack([-v[1], v[0]]) + (1 + jnp.cos(t)) * q
        spring = self.cubic * (q[0] - q[1]) ** 3 * jnp.array([1.0, -1.0])
        return matrix @ q + turning + spring + self.drag * v * v[0]

    def force(self, t, q, v):
        one = (jnp.ones_like(t),)
        exact, rate = jax.jvp(self.known, (t,), one)
        second = jax.jvp(lambda t: jax.jvp(self.known, (t,), one)[1], (t,), one)[1]
        return self.mass @ second + self.pull(t, exact, rate) - self.pull(t, q, v)

    def power(self, t, q, v):
        return q[0] * v[0]


MASS = jnp.array([[2.0, 0.4], [0.4, 1.0]])


def system(stiff, linear=False):
    return Forced(MASS, jnp.asarray(stiff), *((0.0, 0.0) if linear else ()))


def solve(args, solver, **kwargs):
    y0 = jb.solvers.State(jnp.array([0.0, 0.1]), jnp.array([1.0, 0.0]))
    return diffrax.diffeqsolve(
        jb.solvers.SecondOrderSystem.term(solver),
        solver,
        0.0,
        2.0,
        y0=y0,
        args=args,
        max_steps=20_000,
        **kwargs,
    )


def slope(errors, steps):
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


SOLVERS = [
    jb.solvers.Rodas4P(),
    jb.solvers.Rodas5P(),
    jb.solvers.ChordKvaerno5(),
    jb.solvers.Magnus(),
]
each_solver = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)


def is_linear(solver):
    return isinstance(solver, jb.solvers.Magnus)


@pytest.mark.release
@pytest.mark.parametrize(
    ("solver", "stiff", "order"),
    [
        slow(jb.solvers.Rodas4P(), 0.0, 4),
        slow(jb.solvers.Rodas4P(), 1e4, 4),
        (jb.solvers.Rodas5P(), 0.0, 5),
        slow(jb.solvers.Rodas5P(), 1e4, 4),  # stiff components cost at most one (Steinebach 2023)
        (jb.solvers.ChordKvaerno5(), 0.0, 5),
        slow(jb.solvers.ChordKvaerno5(), 1e4, 4),
        (jb.solvers.Magnus(), 0.0, 4),
        slow(jb.solvers.Magnus(), 1e4, 2),  # steps and vibration beat; errors are small
    ],
    ids=lambda v: type(v).__name__ if isinstance(v, diffrax.AbstractSolver) else None,
)
def test_order(solver, stiff, order):
    """On a non-autonomous system, where nothing is stiff and where something is."""
    steps = np.array([0.1, 0.05, 0.025, 0.0125])
    if is_linear(solver) and not stiff:
        steps /= 4  # longer ones are better than its order, motions being measured from equilibrium
    args = system(stiff, is_linear(solver))
    run = jax.jit(lambda h: solve(args, solver, dt0=h).ys)
    ends = [run(h) for h in steps]
    errors = [np.abs(y.q[0] - args.known(2.0)).max() for y in ends]
    assert slope(errors, steps) > order - 0.25
    assert errors[-1] < 1e-6
    work = [abs(y.work[0] - np.sin(2.0) ** 2 / 2) for y in ends]
    assert work[-1] < errors[-1] + (1e-6 if is_linear(solver) else 1e-10)
    if stiff == 0:
        assert slope(work, steps) > order - 0.25


@pytest.mark.parametrize(
    ("solver", "order"),
    [
        slow(jb.solvers.Rodas5P(), 4),
        slow(jb.solvers.Rodas4P(), 3),
        slow(jb.solvers.ChordKvaerno5(), 4),
        exhaustive(jb.solvers.Magnus(), 3),
    ],
    ids=lambda v: type(v).__name__ if isinstance(v, diffrax.AbstractSolver) else None,
)
def test_order_of_dense_output(solver, order):
    """Between steps."""
    steps = np.array([0.2, 0.1, 0.05])
    times = jnp.linspace(0.03, 1.97, 37)
    args = system(1e2, is_linear(solver))
    run = jax.jit(lambda h: solve(args, solver, dt0=h, saveat=diffrax.SaveAt(ts=times)).ys)
    exact = jax.vmap(args.known)(times)
    errors = [np.abs(run(h).q - exact).max() for h in steps]
    assert slope(errors, steps) > order - 0.25
    # rates are those of the coordinates
    rates = jax.vmap(lambda t: jax.jvp(args.known, (t,), (1.0,))[1])(times)
    np.testing.assert_allclose(run(0.025).v, rates, atol=1e-3)


@pytest.mark.parametrize(
    "solver", [SOLVERS[0], *map(slow, SOLVERS[1:])], ids=lambda s: type(s).__name__
)
def test_error_estimate_is_honest(solver):
    """The error follows the tolerance, over six decades, and stays within a hundredfold of it."""
    args = system(1e4, is_linear(solver))
    run = jax.jit(
        lambda tol: (
            solve(
                args,
                solver,
                dt0=None,
                stepsize_controller=diffrax.PIDController(rtol=tol, atol=tol),
            ).ys.q
        )
    )
    for tol in (1e-4, 1e-6, 1e-8, 1e-10):
        error = np.abs(run(tol)[0] - args.known(2.0)).max()
        assert error < 100 * tol


@pytest.mark.slow
def test_stock_solvers_take_the_same_system():
    exact = system(1e2).known(2.0)
    for solver in (diffrax.Dopri8(), diffrax.KenCarp4()):  # explicit; implicit-explicit
        controller = diffrax.PIDController(rtol=1e-5, atol=1e-5)
        end = solve(system(1e2), solver, dt0=None, stepsize_controller=controller).ys
        np.testing.assert_allclose(end.q[0], exact, atol=1e-4)


@each_solver
def test_refuses_what_is_not_a_second_order_system(solver):
    with pytest.raises(TypeError, match="SecondOrderSystem"):
        solve(None, solver, dt0=0.1)


def test_magnus_refuses_what_is_not_linear():
    with pytest.raises(TypeError, match="linear"):
        solve(system(1.0), jb.solvers.Magnus(), dt0=0.1)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "model", [slow(jb.Hybrid(2, 3, 0)), jb.Classical(2, 3, 2), jb.papers.DiscreteLP()]
)
def test_magnus_is_exact_in_one_step_at_constant_speed(model):
    rotor = SPRINGS
    if not isinstance(model, jb.papers.DiscreteLP):
        rotor = jb.Rotor(short(), 0.4, 0.3)
    rng = np.random.default_rng(3)
    q, v = jnp.asarray(1e-3 * rng.normal(size=(2, len(model.directions))))
    times = np.linspace(0.0, 10.0, 7)
    case = model, rotor, jb.ConstantSpeed(1.7), times
    one = jb.simulate(
        *case, start=jb.solvers.State(q, v), solver=jb.solvers.Magnus(), dt0=10.0,
        stepsize_controller=diffrax.ConstantStepSize(),
    )  # fmt: skip
    assert int(one.solution.stats["num_steps"]) == 1
    system = model.linearise(rotor, 1.7)
    n = len(q)
    flexible = np.linalg.inv(system.mass)
    equations, hub = model.equations(rotor), one.scene.hub(jnp.zeros(()))
    load = flexible @ equations.force(hub, 0 * q, 0 * q, None)
    rate = np.zeros((2 * n + 1, 2 * n + 1))
    rate[:n, n:-1] = np.eye(n)
    rate[n:-1] = np.column_stack(
        [-flexible @ system.stiffness, -flexible @ system.gyroscopic, load]
    )
    for t, found in zip(times, one.state.q, strict=True):
        exact = expm(t * rate) @ np.r_[q, v, 1.0]
        np.testing.assert_allclose(found, exact[:n], rtol=1e-8, atol=1e-8 * np.abs(exact[:n]).max())


class Loose(jb.solvers.SecondOrderSystem):
    """Coordinates that nothing holds, that grow, and that are stiff, under a constant load."""

    mass: jax.Array
    is_linear = True

    def force(self, t, q, v):
        return jnp.array([0.0, 4.0, -1e4]) * q + 1.0


def test_magnus_takes_what_nothing_holds():
    """Free motion is a parabola, whatever the length of a step."""
    solver, start = jb.solvers.Magnus(), jb.solvers.State(jnp.zeros(3), jnp.ones(3))
    loose, term = Loose(jnp.eye(3)), jb.solvers.SecondOrderSystem.term(solver)
    step = jax.jit(lambda h: solver.step(term, 0 * h, h, start, loose, None, False)[0].q)
    for h in (2.0, 0.1):
        grown = (np.cosh(2 * h) - 1) / 4 + np.sinh(2 * h) / 2
        swung = (1 - np.cos(100 * h)) / 1e4 + np.sin(100 * h) / 100
        exact = [h + h**2 / 2, grown, swung]
        np.testing.assert_allclose(step(h), exact, rtol=1e-10, atol=1e-12)


class Loaded(Loose):
    """The same with a load that does work."""

    def power(self, t, q, v):
        return jnp.sum(v)


def test_work_of_a_load_is_exact_in_steps_longer_than_a_vibration():
    """It is the load times the way, also between the ends of a step."""
    solver, start = jb.solvers.Magnus(), jb.solvers.State(jnp.zeros(3), jnp.ones(3))
    loaded, term = Loaded(jnp.eye(3)), jb.solvers.SecondOrderSystem.term(solver)

    @jax.jit
    def states(h):
        end, _, info, *_ = solver.step(term, 0 * h, h, start, loaded, None, False)
        between = solver.interpolation_cls(t0=0 * h, t1=h, **info).at(0.3 + 0 * h)
        return end, between

    for h in (2.0, 0.1):
        for state in states(h):
            np.testing.assert_allclose(state.work, jnp.sum(state.q), rtol=1e-11)


class Slow(jb.solvers.SecondOrderSystem):
    """A vibration at 3.8 rad/s under a load at 0.5 rad/s."""

    mass: jax.Array
    is_linear = True

    def force(self, t, q, v):
        return jnp.sin(0.5 * t) - 3.8**2 * q


def test_magnus_measures_slow_motion_from_its_equilibrium():
    """Its error stays small where a vibration takes 20 steps."""
    solver, slow = jb.solvers.Magnus(), Slow(jnp.eye(1))
    start, times = jb.solvers.State(jnp.zeros(1), jnp.zeros(1)), np.linspace(0.0, 30.0, 41)
    run = diffrax.diffeqsolve(
        jb.solvers.SecondOrderSystem.term(solver), solver, 0.0, 30.0, 0.075, start, slow,
        saveat=diffrax.SaveAt(ts=times), max_steps=500,
    )  # fmt: skip
    exact = (np.sin(0.5 * times) - 0.5 / 3.8 * np.sin(3.8 * times)) / (3.8**2 - 0.25)
    np.testing.assert_allclose(run.ys.q[:, 0], exact, rtol=0, atol=4.5e-7 * np.abs(exact).max())


class Pushed(jb.solvers.SecondOrderSystem):
    """q'' = 0, then 1 from t = 1 on."""

    mass: jax.Array

    def force(self, t, q, v):
        return jnp.where(t >= 1.0, jnp.ones_like(q), jnp.zeros_like(q))


@pytest.mark.parametrize("solver", [jb.solvers.Rodas5P(), jb.solvers.Rodas4P()], ids=repr)
def test_forces_may_jump_where_the_controller_is_told(solver):
    control = diffrax.ClipStepSizeController(
        diffrax.PIDController(rtol=1e-6, atol=1e-6), jump_ts=[1.0]
    )
    found = diffrax.diffeqsolve(
        jb.solvers.SecondOrderSystem.term(solver), solver, 0.0, 2.0, 0.5,
        jb.solvers.State(jnp.zeros(1), jnp.zeros(1)),
        Pushed(jnp.eye(1)), stepsize_controller=control,
    )  # fmt: skip
    np.testing.assert_allclose(found.ys.q[-1], 0.5, rtol=1e-12)
    np.testing.assert_allclose(found.ys.v[-1], 1.0, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("jumped", [True, jnp.asarray(True)])
def test_an_acceleration_from_before_a_jump_is_not_used(jumped):
    solver, still = jb.solvers.ChordKvaerno5(), jb.solvers.State(jnp.zeros(1), jnp.zeros(1))
    term, pushed = jb.solvers.SecondOrderSystem.term(solver), Pushed(jnp.eye(1))
    span = jnp.asarray(1.0), jnp.asarray(1.5)
    end = solver.step(term, *span, still, pushed, jnp.zeros(1), jumped)[0]
    np.testing.assert_allclose(end.q, 0.125, rtol=1e-12)


class Sprung(jb.solvers.SecondOrderSystem):
    """q'' = 1 - 1e8 q."""

    mass: jax.Array

    def force(self, t, q, v):
        return 1 - 1e8 * q


def test_what_is_stiff_after_a_jump():
    """Along the first step from rest under a force, and in its end, it is where the force holds it,
    or not far from that; the rate at the start would bring it some thousand times as far."""
    solver, still = jb.solvers.ChordKvaerno5(), jb.solvers.State(jnp.zeros(1), jnp.zeros(1))
    term, pushed = jb.solvers.SecondOrderSystem.term(solver), Sprung(jnp.eye(1))
    span, held = (jnp.asarray(0.0), jnp.asarray(0.1)), 1e-8

    @jax.jit
    def step():
        end, _, info, _, _ = solver.step(term, *span, still, pushed, jnp.ones(1), False)
        along = solver.interpolation_cls(t0=span[0], t1=span[1], **info)
        return end.q, jax.vmap(along.evaluate)(jnp.linspace(0, 0.1, 11))

    end, along = step()
    np.testing.assert_allclose(end, held, rtol=1e-2)
    assert np.abs(along.q).max() < 3 * held
    assert np.abs(along.v).max() < 30 * held / 0.1


def test_iterations_are_checked():
    with pytest.raises(ValueError, match="iterations must be at least 1"):
        jb.solvers.ChordKvaerno5(iterations=0)
    with pytest.raises(TypeError, match="iterations must be an int"):
        jb.solvers.ChordKvaerno5(iterations=2.0)
