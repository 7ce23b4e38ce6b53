"""How long steps may be: theory against closed forms, and against what happens."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam.solvers import amplification, stable_step
from tests.beams import SPRINGS
from tests.tiers import exhaustive, slow

ROTOR = jb.Rotor(jb.Beam.from_slenderness(50.0), 0.1, 0.0)
SPEED = 2.0  # rad/s: more than half the lowest frequency
STEPS, GROWTH = 200, 100.0
GREEN = jb.papers.GreenANCF(2)


def named(value):
    return type(value).__name__


def some(quick, rest):
    return [*quick, *(exhaustive(value) for value in rest)]


def each_angle(solver, angles, ratio=0.0):
    def one(angle):
        return amplification(solver, angle, ratio, throw=False).factor

    return np.asarray(jax.vmap(one)(jnp.asarray(angles)))


def stability_function(solver, z):
    """R(z) = 1 + z b^T (I - z A)^-1 1, from the tableau."""
    tableau = getattr(solver.tableau, "tableaus", (solver.tableau,))[-1]  # the implicit one
    s = len(tableau.b_sol)
    a = np.zeros((s, s))
    for i, row in enumerate(tableau.a_lower):
        a[i + 1, : i + 1] = row
    if tableau.a_diagonal is not None:
        a += np.diag(tableau.a_diagonal)
    return 1 + z * tableau.b_sol @ np.linalg.solve(np.eye(s) - z * a, np.ones(s))


CLOSED = {
    diffrax.Euler: lambda z: 1 + z,
    diffrax.Heun: lambda z: 1 + z + z**2 / 2,
    diffrax.Midpoint: lambda z: 1 + z + z**2 / 2,
    diffrax.Bosh3: lambda z: 1 + z + z**2 / 2 + z**3 / 6,
    diffrax.ImplicitEuler: lambda z: 1 / (1 - z),
    jb.solvers.Magnus: np.exp,
}


@pytest.mark.parametrize(
    "method",
    some(
        (diffrax.Euler, diffrax.Heun, diffrax.Bosh3, jb.solvers.Magnus),
        (diffrax.Midpoint, diffrax.ImplicitEuler),
    ),
    ids=lambda m: m.__name__,
)
def test_closed_forms(method):
    """With damping there are two eigenvalues, at different angles from the axis."""
    angles = np.geomspace(0.01, 30, 40)
    exact = np.abs(CLOSED[method](1j * angles))
    np.testing.assert_allclose(each_angle(method(), angles), exact, rtol=1e-10)
    both = -0.3 + 1j * np.sqrt(1 - 0.3**2)
    exact = np.abs(CLOSED[method](both * angles))
    np.testing.assert_allclose(each_angle(method(), angles, 0.3), exact, rtol=1e-10)
    over = np.array([-2 + np.sqrt(3), -2 - np.sqrt(3)])  # two real ones
    exact = np.abs(CLOSED[method](np.outer(over, angles))).max(0)
    np.testing.assert_allclose(each_angle(method(), angles, 2.0), exact, rtol=1e-9)


@pytest.mark.parametrize(
    "solver",
    some(
        (diffrax.Tsit5(), diffrax.Dopri8()),
        (diffrax.Dopri5(), diffrax.Kvaerno5(), diffrax.KenCarp4()),
    ),
    ids=named,
)
def test_runge_kutta_methods(solver):
    """Stock implicit ones have no tolerances of their own, implicit-explicit ones two parts."""
    angles = np.geomspace(0.01, 30, 40)
    exact = [abs(stability_function(solver, 1j * z)) for z in angles]
    np.testing.assert_allclose(each_angle(solver, angles), exact, rtol=1e-8)


@pytest.mark.slow
def test_chord_iterations_solve_what_is_linear():
    """Forces z times as large as the state carry z times its rounding."""
    angles = np.geomspace(0.01, 1e6, 60)
    exact = [abs(stability_function(diffrax.Kvaerno5(), 1j * z)) for z in angles]
    error = np.abs(each_angle(jb.solvers.ChordKvaerno5(), angles) - exact)
    assert (error < 2 * np.finfo(float).eps * (1 + angles)).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "solver",
    some(
        (jb.solvers.Rodas5P(),),
        (jb.solvers.Rodas4P(), jb.solvers.ChordKvaerno5(), diffrax.Kvaerno5()),
    ),
    ids=named,
)
def test_stable_at_any_step(solver):
    """On the axis, and all the more with damping; what is stiff is gone after a step."""
    angles = np.geomspace(1e-3, 1e8, 400)
    for ratio in (0.0, 0.1, 1.5):
        found = each_angle(solver, angles, ratio)
        assert found.max() < 1 + 1e-12
        assert found[-1] < 1e-5
    assert stable_step(jb.papers.DiscreteLP(), SPRINGS, SPEED, solver).step == np.inf


def limit(solver, steps=1000, growth=100.0):
    """h omega."""
    found = stable_step(jb.papers.DiscreteLP(), SPRINGS, SPEED, solver, steps=steps, growth=growth)
    return float(found.step * found.frequency)


def test_limits_in_closed_form():
    """Euler and Heun grow at any step, the more steps the worse; Bosh3 up to sqrt(3) never does."""
    for steps, growth in ((1000, 100.0), (10**5, 2.0)):
        gain = growth ** (2 / steps) - 1
        np.testing.assert_allclose(limit(diffrax.Euler(), steps, growth), gain**0.5, rtol=1e-9)
        heun = limit(diffrax.Heun(), steps, growth)
        np.testing.assert_allclose(heun, (4 * gain) ** 0.25, rtol=1e-9)
    np.testing.assert_allclose(limit(diffrax.Bosh3(), 10**9), 3**0.5, rtol=1e-6)


@pytest.mark.parametrize("solver", some((), (diffrax.Tsit5(), diffrax.Dopri5())), ids=named)
def test_limits_of_high_order(solver):
    """Where |R(iz)|^2 - 1, a polynomial, is first positive; a run of a thousand steps bears more,
    since growth is slow at first."""
    z = np.arange(1, 41) / 40
    size = [abs(stability_function(solver, 1j * z)) ** 2 - 1 for z in z]
    powers = np.arange(6, 2 * len(solver.tableau.b_sol) + 1, 2)  # order 5: nothing below z^6
    series = np.zeros(powers[-1] - 5)
    series[::2] = np.linalg.lstsq(z[:, None] ** powers, np.array(size), rcond=None)[0]
    roots = np.polynomial.polynomial.polyroots(np.trim_zeros(series, "b"))
    exact = min(root.real for root in roots if abs(root.imag) < 1e-9 and root.real > 0)
    np.testing.assert_allclose(limit(solver, 10**12), exact, rtol=1e-3)
    assert limit(solver, 1000) > 1.5 > 1.0 > exact


@pytest.mark.slow
def test_high_order_does_not_mean_stable():
    """Dopri8 grows below 1.502 too, by 3e-8 a step: by theory at any step, in practice at none."""
    below, above = each_angle(diffrax.Dopri8(), [1.3, 2.5])
    assert 0 < below - 1 < 1e-7
    assert above < 1
    assert 3.7 < limit(diffrax.Dopri8(), 10**6) < limit(diffrax.Dopri8(), 1000) < 4.0
    assert limit(diffrax.Dopri8(), 10**9) < 1.5


@pytest.mark.slow
def test_step_follows_the_highest_frequency():
    """Under jit and vmap, with derivatives by the rotor."""
    model, euler = jb.papers.DiscreteLP(), diffrax.Euler()

    def step(mass):
        springs = jb.papers.SpringRotor(mass, 0.8, 0.4, 6000.0, 30.0)
        return stable_step(model, springs, SPEED, euler, throw=False).step

    def highest(mass):
        springs = jb.papers.SpringRotor(mass, 0.8, 0.4, 6000.0, 30.0)
        return jb.modes(model, springs, SPEED, 2, throw=False).frequency.max()

    masses = jnp.array([1.3, 2.0])
    (found, slope) = jax.jit(jax.vmap(jax.value_and_grad(step)))(masses)
    (omega, rate) = jax.jit(jax.vmap(jax.value_and_grad(highest)))(masses)
    np.testing.assert_allclose(found, limit(euler) / omega, rtol=1e-12)
    np.testing.assert_allclose(slope, -found * rate / omega, rtol=1e-9)


@pytest.mark.slow
def test_flap_modes_count():
    """The highest frequency may be out of plane."""
    beam = jb.Beam(1.0, 1.0, 1e3, 1.0, 100.0)
    found = stable_step(jb.Hybrid(1, 1, 3), jb.Rotor(beam), 0.0, diffrax.Tsit5())
    flap = jb.modes(jb.Hybrid(1, 1, 3), jb.Rotor(beam), 0.0, jb.labels(flap=3)).frequency
    np.testing.assert_allclose(found.frequency, flap.max(), rtol=1e-12)


def test_bad_input():
    with pytest.raises(TypeError, match="solver must be a diffrax solver, got int"):
        amplification(3, 1.0)
    with pytest.raises(TypeError, match="solver must be a one-step method, got ReversibleHeun"):
        amplification(diffrax.ReversibleHeun(), 1.0)
    for angle in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match="angle must be finite and > 0"):
            amplification(diffrax.Euler(), angle)
    with pytest.raises(TypeError, match="damping_ratio must be a real"):
        amplification(diffrax.Euler(), 1.0, "much")
    case = jb.papers.DiscreteLP(), SPRINGS, SPEED, diffrax.Euler()
    with pytest.raises(ValueError, match="steps must be >= 1, got 0"):
        stable_step(*case, steps=0)
    with pytest.raises(TypeError, match="steps must be an int, got float"):
        stable_step(*case, steps=10.0)
    for growth in (1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match="growth must be finite and > 1"):
            stable_step(*case, growth=growth)
    with pytest.raises(TypeError, match="rotor must be a SpringRotor, got Rotor"):
        stable_step(jb.papers.DiscreteLP(), ROTOR, SPEED, diffrax.Euler())
    with pytest.raises(TypeError, match="solver must be a diffrax solver"):
        stable_step(*case[:3], None)


@pytest.mark.parametrize(
    ("model", "rotor", "speed", "status"),
    [
        (jb.papers.DiscreteLC(), SPRINGS, 20.0, jb.Status.NO_EQUILIBRIUM),  # its spring gives way
        slow(jb.Classical(2, 3, 0), ROTOR, 5.0, jb.Status.NO_EQUILIBRIUM),
        slow(jb.Hybrid(2, 3, 0), ROTOR, 90.0, jb.Status.NO_EQUILIBRIUM),
    ],
)
def test_no_step_where_the_model_itself_grows(model, rotor, speed, status):
    found = stable_step(model, rotor, speed, diffrax.Euler(), throw=False)
    assert int(found.status) == status
    assert np.isnan(found.step)
    assert np.isnan(found.frequency)
    # Whichever it is, its cause is among those that are named.
    causes = "no stable steady rotation .* rod tears, .*axial_stiffness.* or a mode grows, .*loads"
    with pytest.raises(RuntimeError, match=causes):
        stable_step(model, rotor, speed, diffrax.Euler())


def fastest(model, rotor):
    """Steady rotation with a trace of the fastest mode, far above rounding and far below what is
    not linear; and how to measure it, the same at all times for a mode that neither grows nor
    decays."""
    motion, tiny = jb.ConstantSpeed(SPEED), 1e-9
    modes = jb.modes(model, rotor, SPEED, len(model.directions))
    k = jnp.argmax(modes.frequency)
    omega, shape = modes.frequency[k], modes.shape[k] * tiny / jnp.linalg.norm(modes.shape[k])
    still = jb.steady_start(model, rotor, motion)
    start = jb.solvers.State(still.q + shape.real, still.v - omega * shape.imag)

    def size(state):
        off = jnp.concatenate([state.q - still.q, (state.v - still.v) / omega])
        return jnp.linalg.norm(off) / tiny

    return motion, start, size


def follow(solver, model, rotor):
    """Growth of that mode in STEPS steps of length h, and the status, for many h at once."""
    motion, start, size = fastest(model, rotor)

    def one(h):
        run = jb.simulate(
            model, rotor, motion, jnp.stack([jnp.zeros_like(h), STEPS * h]), start=start,
            solver=solver, stepsize_controller=diffrax.ConstantStepSize(), dt0=h, throw=False,
            max_steps=STEPS + 1,
        )  # fmt: skip
        return size(jax.tree.map(lambda a: a[-1], run.state)), run.status

    return jax.jit(jax.vmap(one))


def largest_stable(run, low, high):
    """Sixteen steps at a time; the first that grows ends it (NaN: the run blew up)."""
    for _ in range(3):
        h = np.linspace(low, high, 16)
        grows = ~(np.asarray(run(jnp.asarray(h))[0]) <= GROWTH)
        first = int(np.argmax(grows))
        assert grows[first:].all()
        assert first > 0
        low, high = h[first - 1], h[first]
    return low


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("solver", "model"),
    [
        (diffrax.Euler(), jb.papers.DiscreteLP()),
        (diffrax.Tsit5(), jb.Hybrid(1, 2, 0)),
        (diffrax.Tsit5(), jb.papers.GreenANCF(1)),
    ],
    ids=named,
)
def test_steps_fail_where_theory_says_and_not_below(solver, model):
    """Other methods: in the study."""
    rotor = SPRINGS if model.rotor_type is jb.papers.SpringRotor else ROTOR
    theory = float(stable_step(model, rotor, SPEED, solver, steps=STEPS, growth=GROWTH).step)
    run = follow(solver, model, rotor)
    np.testing.assert_allclose(largest_stable(run, 0.5 * theory, 1.5 * theory), theory, rtol=1e-3)
    growth, status = run(theory * jnp.linspace(0.9, 1.6, 16))
    assert growth[0] < GROWTH
    assert int(status[0]) == jb.Status.OK
    if not isinstance(solver, diffrax.Euler):  # which creeps
        assert set(np.asarray(status[-3:])) <= {
            jb.Status.DIVERGED, jb.Status.NOT_FINITE, jb.Status.UNBALANCED
        }  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("solver", "model"),
    [
        (jb.solvers.Rodas5P(), GREEN),
        (jb.solvers.ChordKvaerno5(), GREEN),
        (jb.solvers.Magnus(), jb.papers.DiscreteLP()),
    ],
    ids=named,
)
def test_implicit_and_exponential_steps_may_be_long(solver, model):
    """A hundred times what the best explicit method bears."""
    rotor = SPRINGS if model.rotor_type is jb.papers.SpringRotor else ROTOR
    explicit = stable_step(model, rotor, SPEED, diffrax.Dopri8())
    assert stable_step(model, rotor, SPEED, solver).step == np.inf
    growth, status = follow(solver, model, rotor)(100 * explicit.step * jnp.array([0.01, 0.1, 1.0]))
    np.testing.assert_array_equal(status, jb.Status.OK)
    if isinstance(solver, jb.solvers.Magnus):
        np.testing.assert_allclose(growth, 1, rtol=1e-5)
    else:
        assert (np.asarray(growth) < 1).all()
