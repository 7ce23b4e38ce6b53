"""Small motion about states that loads deform, with damping, and where it is lost."""

import dataclasses
import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
import scipy.optimize

import jaxbeam as jb
from jaxbeam._models.contract.loaded import Conditions, loads_at
from jaxbeam._numerics.linalg import dense
from jaxbeam._numerics.quadratic import quadratic_eigenpairs
from jaxbeam._stability.flutter import LostPlace, first_lost, polished
from jaxbeam._status import Status
from tests.beams import TORSION, short

BEAM = short(4e5, **TORSION)
ROTOR = jb.Rotor(BEAM, hub_radius=0.4, tip_mass=0.3)
UNIT = jb.Beam(1.0, 1.0, 1e8, 1.0, 2.0, torsional_stiffness=0.7, polar_inertia=1e-9)
GREENHILL = 7.837347439  # weight per length of a column that buckles under it, over EI / L^3
BECK = 20.0509536, 11.0155745  # force and frequency of flutter: EI / L^2, (EI / m)^1/2 / L^2


@pytest.mark.parametrize("kind", ["stable", "unstable", "damped", "circulatory"])
def test_quadratic_eigenpairs(kind):
    """Half of the eigenvalues of the companion matrix, of pairs the upper one, lowest first."""
    rng = np.random.default_rng(7)
    a, b, c = rng.normal(size=(3, 5, 5))
    m, g, k = a @ a.T + np.eye(5), 3 * (b - b.T), c @ c.T + 2 * np.eye(5)
    if kind == "unstable":
        k = k - 9 * np.eye(5)
    if kind == "damped":
        g = g + 4 * c @ c.T  # of which some creep back
    if kind == "circulatory":
        k = k + 3 * (a - a.T)
    conservative = kind in ("stable", "unstable")
    lam, x = quadratic_eigenpairs(*map(jnp.asarray, (m, g, k)), conservative)
    lam, x = np.asarray(lam), np.asarray(x).T
    residual = m @ x * lam**2 + g @ x * lam + k @ x
    assert np.abs(residual).max() < 1e-10
    np.testing.assert_allclose(np.sum(x.conj() * (m @ x), 0), 1.0, rtol=1e-12)
    companion = np.block([[np.zeros((5, 5)), np.eye(5)], [-np.linalg.solve(m, np.hstack([k, g]))]])
    whole = np.linalg.eigvals(companion)
    real = np.sort(whole[np.abs(whole.imag) < 1e-9].real)[::-1]
    right = np.concatenate([whole[whole.imag > 1e-9], real[: real.size // 2]])
    assert np.abs(lam[:, None] - right[None]).min(0).max() < 1e-9
    creeps = lam.imag == 0
    assert (np.diff(np.abs(lam[~creeps])) > -1e-9).all()
    assert creeps.sum() == real.size // 2
    assert kind != "damped" or creeps.any()


def test_a_shaft_that_whirls_beside_what_is_stiff():
    """Beyond its critical speed w it swings at W + w and W - w in turning axes, where its stiffness
    w^2 - W^2 is negative: that no shift makes it seem positive, however stiff all else is."""
    w, turning = 1.0, 2.5
    gyroscopic = np.zeros((4, 4))
    gyroscopic[:2, :2] = 2 * turning * np.array([[0, -1], [1, 0]])
    for stiffest in (1e6, 1e12, 1e17):
        stiffness = np.diag([w**2 - turning**2, w**2 - turning**2, 200.0, stiffest])
        matrices = map(jnp.asarray, (np.eye(4), gyroscopic, stiffness))
        found, _ = quadratic_eigenpairs(*matrices, True, 2)
        np.testing.assert_allclose(found[:2], [1.5j, 3.5j], atol=1e-9)


def test_a_double_pendulum_under_a_force_that_follows():
    """With masses 2 m and m and springs c it flutters from (7/2 - 2^1/2) c / l on (H. Ziegler,
    Ingenieur-Archiv 20, 1952); and so by the springs."""
    m = jnp.array([[3.0, 1.0], [1.0, 1.0]])

    def matrices(c, load):
        return m, c * jnp.array([[2.0, -1.0], [-1.0, 1.0]]) + load * jnp.array(
            [[-1.0, 1.0], [0, 0]]
        )

    c = jnp.asarray(1.7)

    def lost(load):
        return *matrices(c, load), jnp.asarray(int(Status.OK))

    end = first_lost(lost, 2, jnp.asarray(0.1), 1.3, 30)
    mode = end.kept[0]
    place = LostPlace(
        x=mode.right, exists=end.found, left=mode.left, square=mode.square, flutters=mode.flutters,
        k0=matrices(c, 0.0)[1], matrices=matrices,
    )  # fmt: skip
    load = polished(place, c, end.b[0])
    assert mode.flutters == 1
    np.testing.assert_allclose(load, (3.5 - np.sqrt(2)) * 1.7, rtol=1e-13)
    # The product of both squares of frequencies is det K / det M = c^2 / 2, whatever the load.
    np.testing.assert_allclose(mode.square, 1.7 / np.sqrt(2), rtol=1e-6)
    by_c, by_load = jax.grad(place.bordered, (0, 1))(c, load)
    np.testing.assert_allclose(-by_c / by_load, 3.5 - np.sqrt(2), rtol=1e-9)


def test_a_column_under_its_own_weight():
    """Standing, it buckles at Greenhill's weight, about which its first mode stands still and
    beyond which it grows; hanging, it stiffens. Weight is a force along the span or gravity."""
    model, rotor = jb.Hybrid(0, 10, 0), jb.Rotor(jb.Beam(1.0, 1.0, 1e8, 1.0, 2.0))

    @jax.jit
    @jax.vmap
    def first(weight):
        loads = jb.Loads(force_per_length=(-weight, 0.0, 0.0))
        return jb.modes(model, rotor, 0.0, 1, loads=loads, throw=False).eigenvalue[0]

    found = np.asarray(first(GREENHILL * jnp.array([-1.0, 0.0, 0.9, 1 - 1e-9, 1 + 1e-9, 1.1])))
    assert (found[:4].real == 0).all()
    assert (np.diff(found[:4].imag) < 0).all()
    np.testing.assert_allclose(found[1].imag, 3.516015269, rtol=1e-9)
    assert found[3].imag < 2e-4
    assert 0 < found[4].real < 2e-4
    assert found[4].imag == 0
    assert found[5].real > 0.1
    half = jb.blades.SpanwiseFunction(lambda x: -1.0 + 0 * x)  # and half by gravity
    for force, gravity in ((-2.0, None), (half, [-1.0, 0.0, 0.0])):
        loads = jb.Loads(gravity, force_per_length=(force, 0.0, 0.0))
        critical = jb.critical_load(model, rotor, loads)
        np.testing.assert_allclose(critical.factor, GREENHILL / 2, rtol=1e-9)
        assert critical.frequency == 0


def test_damping_at_rest():
    """lambda^2 + (a + c w^2) lambda + w^2 = 0 with the frequencies w without damping."""
    model, mass, stiffness = jb.Hybrid(0, 6, 0), 0.4, 8e-3
    w = np.asarray(jb.modes(model, ROTOR, 0.0, 6).frequency)
    damping = jb.Damping(mass, stiffness)
    found = jb.modes(model, ROTOR, 0.0, 6, damping=damping)
    ratio = (mass / w + stiffness * w) / 2
    assert (ratio < 1).any()
    assert (ratio > 1).any()
    swings = ratio < 1
    right = np.where(
        swings, w * (-ratio + 1j * np.sqrt(np.abs(1 - ratio**2))),
        w * (-ratio + np.sqrt(np.abs(ratio**2 - 1))),
    )  # fmt: skip
    order = np.asarray(found.number) - 1
    assert (order == np.arange(6)).all()  # those that creep back come where they swing undamped
    np.testing.assert_allclose(found.eigenvalue, right[order], rtol=1e-8)
    np.testing.assert_allclose(found.damping_ratio[swings], ratio[swings], rtol=1e-8)


def test_what_loads_may_be():
    model, plane = jb.Hybrid(0, 2, 2), jb.Hybrid(0, 2, 0)
    for loads, said in (
        (jb.Loads(tip_force=lambda t: jnp.array([0, 1.0, 0])), "tip_force must be constant"),
        (jb.Loads(force_per_length=lambda t: (0.0, t, 0.0)), "force_per_length must be constant"),
        (jb.Loads(tip_moment=[0, 0, 1.0]), "Hybrid has no moment at its tip"),
    ):
        with pytest.raises(ValueError, match=said):
            jb.modes(model, ROTOR, 1.0, 1, loads=loads)
    with pytest.raises(TypeError, match="loads must be of class Loads"):
        jb.modes(model, ROTOR, 1.0, 1, loads=3.0)
    with pytest.raises(TypeError, match="damping must be of class Damping"):
        jb.modes(model, ROTOR, 1.0, 1, damping=0.1)
    for which, rotor, speed, gravity, status in (
        (plane, ROTOR, 1.0, [0.0, 1.0, 0.0], Status.TURNING_GRAVITY),
        (plane, ROTOR, 1.0, [1.0, 0.0, 0.0], Status.TURNING_GRAVITY),
        (plane, ROTOR, 0.0, [0.0, 0.0, 1e-13], Status.OUT_OF_PLANE),
        (plane, ROTOR, 0.0, [0.0, 1.0, 0.0], Status.OK),
    ):
        loads = jb.Loads(gravity=gravity)
        found = jb.modes(which, rotor, speed, 1, loads=loads, throw=False)
        assert found.status == status
        assert np.isfinite(found.frequency).all() == (status == Status.OK)
    free = jb.Rotor(BEAM, root_springs=jb.RootSprings(in_plane=0.0))
    for rotor, force, status in (
        (free, [0.0, 0.1, 0.0], Status.NOT_HELD),
        (jb.Rotor(BEAM, 0.4), [0.0, 1e3, 0.0], Status.DIVERGED),
    ):
        found = jb.modes(plane, rotor, 2.0, 1, loads=jb.Loads(tip_force=force), throw=False)
        assert found.status == status
    following, turning = jb.Loads(tip_force=[1.0, 0, 0], follows=True), jb.SpatialRod(2)
    twisting = jb.Rotor(dataclasses.replace(BEAM, torsional_stiffness=1.0))
    for function in (jb.southwell, jb.critical_speed):
        with pytest.raises(ValueError, match="no potential"):
            function(turning, twisting, loads=following)
        with pytest.raises(ValueError, match=r"loads\.follows: Hybrid has no"):
            function(model, ROTOR, loads=following)
    across = jb.Loads(gravity=[0.0, 1.0, 0.0])
    found = jb.critical_speed(plane, ROTOR, loads=across, throw=False)
    assert found.status == Status.TURNING_GRAVITY
    for given, said in (
        ((0.0, 1.0), "three parts"),
        ((0.0, np.nan, 0.0), "must be finite"),
        ((0.0, jb.Spanwise([0, 1], [0.0, np.inf]), 0.0), "must be finite"),
        (lambda t: (0.0, t), "three parts"),
    ):
        with pytest.raises(ValueError, match=said):
            jb.Loads(force_per_length=given)


@pytest.mark.exhaustive
def test_a_column_under_a_force_that_follows_its_tip():
    """Beck's: it flutters, with no divergence before, at 20.0509536 EI / L^2; its frequencies by
    `modes` meet there."""
    rotor, loads = jb.Rotor(UNIT), jb.Loads(tip_force=[-1.0, 0.0, 0.0], follows=True)
    found = jb.critical_load(jb.SpatialRod(8), rotor, loads)
    load, frequency = found.factor, found.frequency
    np.testing.assert_allclose(load, BECK[0], rtol=1e-6)
    np.testing.assert_allclose(frequency, BECK[1], rtol=1e-4)

    def eigenvalues(factor):
        loads = jb.Loads(tip_force=jnp.stack([-factor, 0 * factor, 0 * factor]), follows=True)
        return jb.modes(jb.SpatialRod(8), rotor, 0.0, 3, loads=loads).eigenvalue

    below, above = (np.asarray(eigenvalues(load * share)) for share in (1 - 1e-4, 1 + 1e-4))
    assert np.abs(below.real).max() < 1e-9
    assert (above.real > 0.05).sum() == 1
    assert np.abs(above[above.real > 0.05].imag - frequency) < 0.1
    damped = jb.modes(jb.SpatialRod(8), rotor, 0.0, 3, loads=loads, damping=jb.Damping(0.1))
    np.testing.assert_allclose(damped.eigenvalue.real, -0.05, rtol=1e-9)


LEIPHOLZ = 40.0537  # force per length of flutter, over EI / L^3


@pytest.mark.exhaustive
def test_a_column_under_a_force_along_the_span_that_turns_with_it():
    """40.05 EI / L^3 (H. Leipholz, Ingenieur-Archiv 32, 1963), in place of the 7.837 of a heavy
    column."""
    loads = jb.Loads(force_per_length=(-1.0, 0.0, 0.0), follows=True)
    found = jb.critical_load(jb.SpatialRod(8), jb.Rotor(UNIT), loads)
    np.testing.assert_allclose(found.factor, LEIPHOLZ, rtol=2e-5)
    assert found.frequency > 10


def followed(load, square, spring):
    """The determinant of a column of unit length, mass and bending stiffness on a root spring k,
    under a force P that follows its tip: w_xxxx + P w_xx = omega^2 w, with w = 0 and w_xx = k w_x
    at the root, w_xx = w_xxx = 0 at the tip."""
    root = np.sqrt(load**2 + 4 * square)
    a, b = np.sqrt((root + load) / 2), np.sqrt((root - load) / 2)
    # w = A (cos a x - cosh b x) + B sin a x + C sinh b x, which is zero at the root.
    ca, sa, cb, sb = np.cos(a), np.sin(a), np.cosh(b), np.sinh(b)
    rows = [
        [-(a**2) - b**2, -spring * a, -spring * b],
        [-(a**2) * ca - b**2 * cb, -(a**2) * sa, b**2 * sb],
        [a**3 * sa - b**3 * sb, -(a**3) * ca, b**3 * cb],
    ]
    return np.linalg.det(np.array(rows))


@pytest.mark.exhaustive
@pytest.mark.parametrize("spring", [0.5, 3.0])
def test_a_column_on_a_soft_root_flutters(spring):
    """At a load far beyond what its root would bear if it did not follow. Where two roots of the
    determinant meet, it and its derivative by the square of the frequency are zero."""

    def meets(at):
        load, square = at
        h = 1e-5 * square
        up, down = (followed(load, square + s * h, spring) for s in (1, -1))
        return [followed(load, square, spring), (up - down) / (2 * h)]

    rotor = jb.Rotor(UNIT, root_springs=jb.RootSprings(in_plane=spring))
    loads = jb.Loads(tip_force=[-1.0, 0.0, 0.0], follows=True)
    found = jb.critical_load(jb.SpatialRod(8), rotor, loads)
    start = np.array([float(found.factor), float(found.frequency) ** 2])
    exact = scipy.optimize.root(meets, 1.01 * start, tol=1e-12)
    assert exact.success
    assert exact.x[0] > 16.0
    np.testing.assert_allclose(found.factor, exact.x[0], rtol=1e-4)
    np.testing.assert_allclose(found.frequency, np.sqrt(exact.x[1]), rtol=1e-3)


@pytest.mark.exhaustive
def test_a_beam_that_swings_far_on_a_soft_root_is_stable():
    """Pushed sideways it turns towards the load, by which it is stretched: K is positive definite,
    though where bending was soft there is axial stiffness then, ten decades above it."""
    soft = jb.Beam(1.0, 1.0, 1e8, 1.0, 50.0, torsional_stiffness=5.0, polar_inertia=1e-4)
    rotor = jb.Rotor(soft, root_springs=jb.RootSprings(in_plane=0.01))
    aside = jb.Loads(tip_force=[0.0, 1.0, 0.0])
    found = jb.critical_load(jb.SpatialRod(4), rotor, aside, throw=False)
    assert found.status == jb.Status.SEARCH_ENDED
    model = jb.SpatialRod(4).suited(rotor)

    def lowest(force):
        loads = jb.Loads(tip_force=jnp.stack([0 * force, force, 0 * force]))
        return jb.modes(model, rotor, 0.0, 1, loads=loads).frequency[0]

    frequency = jax.lax.map(lowest, jnp.array([1e-3, 3e-3, 1e-2, 0.1, 1.0]))
    assert (np.diff(frequency) > 0).all()


@pytest.mark.exhaustive
def test_a_strip_loses_its_stiffness_sideways_at_prandtls_load():
    """With a dead load in its stiff plane, 4.0126 (EI GJ)^1/2 / L^2 in the narrow limit."""
    strip = jb.Rotor(jb.Beam(1.0, 1.0, 1e9, 1e4, 1.0, torsional_stiffness=1.0, polar_inertia=1e-3))
    model = jb.SpatialRod(6)

    def lowest(force):
        loads = jb.Loads(tip_force=jnp.stack([0 * force, force, 0 * force]))
        return jb.modes(model, strip, 0.0, 1, loads=loads, throw=False).eigenvalue[0]

    critical = jb.critical_load(model, strip, jb.Loads(tip_force=[0.0, 1.0, 0.0])).factor
    np.testing.assert_allclose(critical, 4.0126, rtol=1e-3)
    below, above = (complex(lowest(critical * share)) for share in (1 - 1e-6, 1 + 1e-6))
    assert below.real == 0
    assert below.imag < 1e-2 * complex(lowest(0 * critical)).imag
    assert above.imag == 0
    assert above.real > 0


def loaded(model, parameters, count=4, throw=True):
    """Eigenvalues of a blade by a vector of parameters: all loads, damping, speed, EI, pre-cone."""
    p = parameters
    beam = jb.Beam(
        1.0, 1.0, 1e4, p[8], jb.Spanwise([0, 1], [1.5, 1.0]), torsional_stiffness=0.7,
        polar_inertia=1e-3,
    )  # fmt: skip
    in_space = isinstance(model, jb.SpatialRod)
    rotor = jb.Rotor(beam, 0.2, 0.1, precone=p[9] if in_space else None)
    flap = p[3] if in_space else 0 * p[3]
    loads = jb.Loads(
        gravity=jnp.stack([0 * p[0], 0 * p[0], p[0] * in_space]),
        tip_force=jnp.stack([p[1], p[2], flap]),
        tip_moment=jnp.stack([0 * p[4], p[4], p[4]]) if in_space else None,
        follows=in_space,
        force_per_length=(p[5], jb.Spanwise([0, 0.4, 1], jnp.stack([0 * p[6], p[6], p[5]])), 0.0),
    )
    damping = jb.Damping(mass_coefficient=p[7], stiffness_coefficient=p[7] / 100)
    found = jb.modes(model, rotor, p[10], count, loads=loads, damping=damping, throw=throw)
    return jnp.concatenate([found.eigenvalue.real, found.eigenvalue.imag])


PARAMETERS = jnp.array([0.3, 0.2, 0.3, -0.2, 0.1, 0.2, 0.3, 0.05, 2.0, 0.1, 3.0])


@pytest.mark.exhaustive
@pytest.mark.parametrize(("model", "digits"), [(jb.PlanarRod(3), 0), (jb.SpatialRod(2), 4)])
def test_gradients_through_the_state(model, digits):
    """By loads, damping, speed, stiffness and cone, both ways, against differences, of which the
    stiff shear of a rod takes digits; and batches are as single cases, of which one that fails
    leaves the others alone."""
    loss = 10.0**digits
    function = jax.jit(functools.partial(loaded, model, throw=False))
    forward = jax.jit(jax.jacfwd(functools.partial(loaded, model, throw=False)))(PARAMETERS)
    reverse = jax.jit(jax.jacrev(functools.partial(loaded, model, throw=False)))(PARAMETERS)
    np.testing.assert_allclose(reverse, forward, rtol=1e-8, atol=1e-9 * loss)
    for by, derivative in enumerate(forward.T):
        step = 1e-2 * jnp.abs(PARAMETERS[by])
        apart = [
            function(PARAMETERS.at[by].add(k * step)) - function(PARAMETERS.at[by].add(-k * step))
            for k in (1, 2, 3)
        ]
        difference = np.array([45, -9, 1]) @ np.stack(apart) / (60 * step)
        # 2e-9 is what six points leave, of the largest derivative by a parameter.
        most = 5e-8 * loss * max(np.abs(derivative).max(), 1e-2)
        np.testing.assert_allclose(difference, derivative, rtol=0, atol=most)
    many = jnp.stack([PARAMETERS, PARAMETERS.at[8].set(-1.0), 1.1 * PARAMETERS])
    found = np.asarray(jax.vmap(function)(many))
    assert np.isnan(found[1]).all()
    for one, alone in zip(found[::2], many[::2], strict=True):
        np.testing.assert_allclose(one, function(alone), rtol=1e-10, atol=1e-10)


@pytest.mark.exhaustive
def test_they_are_those_of_small_free_motion():
    """By `simulate`, from the steady state with a little of a mode added, in the mode's own way:
    after a time the amplitude has the factor e^(lambda t); with damping, and without."""
    model, rotor = jb.Hybrid(3, 5, 3), jb.Rotor(short(4e5), hub_radius=0.4, tip_mass=0.3)
    loads = jb.Loads(
        tip_force=[0.5, 0.8, 0.4], force_per_length=(0.2, 0.3, jb.Spanwise([0, 1], [0.5, 0.1]))
    )
    speed, end = 3.0, 0.5
    for damping in (jb.Damping(), jb.Damping(mass_coefficient=0.3, stiffness_coefficient=2e-3)):
        found = jb.modes(model, rotor, speed, 2, loads=loads, damping=damping)
        motion = jb.ConstantSpeed(speed)
        state = jb.steady_start(model, rotor, motion, loads=loads)
        for lam, x in zip(found.eigenvalue, found.shape, strict=True):
            x = 1e-6 * x / jnp.abs(x).max()
            start = jb.solvers.State(state.q + x.real, (lam * x).real)
            run = jb.simulate(
                model, rotor, motion, jnp.array([0.0, end]), loads=loads, damping=damping,
                start=start, stepsize_controller=diffrax.PIDController(rtol=1e-10, atol=1e-12),
            )  # fmt: skip
            moved = np.asarray(run.state.q[-1] - state.q)
            right = np.asarray((x * jnp.exp(lam * end)).real)
            assert np.abs(moved - right).max() < 1e-4 * np.abs(right).max()


@pytest.mark.exhaustive
def test_decay_is_that_of_floquet_at_constant_speed():
    damping, speed = jb.Damping(mass_coefficient=0.3, stiffness_coefficient=2e-3), 5.0
    for model in (jb.Hybrid(2, 4, 4), jb.PlanarRod(2)):
        found = jb.modes(model, ROTOR, speed, 3, damping=damping).eigenvalue
        period = 2 * np.pi / speed
        motion = jb.ConstantSpeed(speed)
        mu = jb.floquet(model, ROTOR, motion, period, damping=damping, steps=2000).multipliers
        for lam in np.asarray(found):
            assert np.abs(np.asarray(mu) - np.exp(lam * period)).min() < 1e-8


@pytest.mark.exhaustive
def test_diagrams_and_coefficients_under_loads():
    """Campbell diagrams and their crossings are those of `modes`; the coefficient of Southwell is
    the slope of squares; a pull along the beam delays nothing but its buckling."""
    model, pull = jb.PlanarRod(3), jb.Loads(tip_force=[6.0, 2.0, 0.0])
    which = jb.labels(in_plane=2)
    diagram = jb.campbell(model, ROTOR, np.linspace(0.5, 12.0, 6), which, loads=pull)
    each = [jb.modes(model, ROTOR, w, which, loads=pull).frequency for w in (0.5, 12.0)]
    np.testing.assert_allclose(diagram.table["frequency"][[0, -1]], each, rtol=1e-12)
    for crossing in diagram.crossings([1, 2]):
        at = jb.modes(model, ROTOR, crossing.angular_speed, [crossing.label], loads=pull)
        gap = at.frequency[0] - crossing.harmonic * crossing.angular_speed
        assert abs(gap) < 1e-8

    def square(speed):
        return jb.modes(model, ROTOR, speed, which, loads=pull).frequency ** 2

    slope = (square(3.001) - square(2.999)) / (3.001**2 - 2.999**2)
    found = jb.southwell(model, ROTOR, 3.0, which, loads=pull).coefficient
    np.testing.assert_allclose(found, slope, rtol=1e-6)
    assert jb.southwell(model, ROTOR, 0.0, which, loads=pull).status == Status.OK
    push = jb.Loads(tip_force=[-20.0, 0.0, 0.0])
    assert jb.critical_speed(model, ROTOR, loads=push, throw=False).status == Status.BUCKLED
    torn = jb.Loads(tip_force=[1e9, 0.0, 0.0])
    assert jb.critical_speed(model, ROTOR, loads=torn, throw=False).status == Status.DIVERGED
    tears = [jb.critical_speed(m, ROTOR, loads=pull).direction for m in (model, jb.Hybrid(3, 4, 0))]
    assert tears == [jb.models.Direction.AXIAL] * 2


@pytest.mark.exhaustive
def test_a_push_along_the_tube_makes_a_particle_diverge_as_it_turns():
    """With r = (k_T L - P) / (k_T - m Omega^2) from the axis it does where P r = k_r, before its
    spring tears at m Omega^2 = k_T: a closed form, and its derivative, which differences give too.
    """
    along, hinge, length, mass = 50.0, 3.0, 1.3, 0.7
    rotor, model = jb.papers.SpringRotor(mass, length, 0.0, along, hinge), jb.papers.DiscreteNC()

    @jax.jit
    @jax.value_and_grad
    def critical(push):
        loads = jb.Loads(tip_force=jnp.stack([-push, 0 * push, 0 * push]))
        return jb.critical_speed(model, rotor, loads=loads, throw=False).angular_speed

    step = 2e-3 * np.array([1, 2, 3])
    push = np.concatenate([[0.5, 2.0, 2.2, 2.4], 2 * (1 + step), 2 * (1 - step)])
    found, slope = np.array([critical(jnp.asarray(each)) for each in push]).T
    assert np.isnan(found[3])  # which buckles at rest
    held = np.delete(np.arange(push.size), 3)
    push, found, slope = (each[held] for each in (push, found, slope))
    right = np.sqrt((along - push * (along * length - push) / hinge) / mass)
    np.testing.assert_allclose(found, right, rtol=1e-12)
    np.testing.assert_allclose(
        slope, (2 * push - along * length) / (2 * hinge * mass * right), rtol=1e-11
    )
    rate = np.array([45, -9, 1]) @ (found[3:6] - found[6:]) / (60 * 2 * step[0])
    np.testing.assert_allclose(slope[1], rate, rtol=1e-10)


@pytest.mark.exhaustive
def test_states_are_those_that_a_slow_rise_of_the_loads_ends_in():
    """200 random ones, from small to far beyond buckling: loads and squares of the speed rise in a
    hundred steps from nothing, with Newton's method of the test's own in each of them."""
    beam = jb.Beam(1.0, 1.0, 1e4, 1.0, 2.0, torsional_stiffness=0.7, polar_inertia=1e-3)
    model, rotor = jb.PlanarRod(4), jb.Rotor(beam, 0.1, 0.1)
    equations = model.equations(rotor)

    @jax.jit
    def both(p):
        force = p[:3] * jnp.array([1.0, 1.0, 0.0])
        loads = jb.Loads(tip_force=force, force_per_length=(p[3], p[4], 0.0))
        conditions = Conditions(loads, jb.Damping())
        found, status, *_ = conditions.state(model, rotor, p[6])
        tip, span = loads_at(equations, loads, p[6])

        def rise(q, share):
            hub = conditions.inputs(equations, jnp.sqrt(share) * p[6])[0]

            def newton(q, _):
                out = equations.force(hub, q, 0 * q, share * tip) + share * span.on(equations, q)
                slope = dense(equations.tangents(hub, q, 0 * q, share * tip)[0])
                return q + jnp.linalg.solve(slope, out), None

            return jax.lax.scan(newton, q, None, length=8)[0], None

        end, _ = jax.lax.scan(rise, 0 * found, jnp.linspace(0, 1, 101)[1:])
        return found, status, end

    rng, fine = np.random.default_rng(0), 0
    for size in rng.choice([0.1, 1.0, 2.0], 200):
        p = rng.normal(size=7) * np.array([4, 4, 4, 4, 4, 4, 3.0]) * size
        found, status, end = both(jnp.asarray(p))
        fine += status == Status.OK
        assert status == Status.OK
        np.testing.assert_allclose(found, end, atol=1e-8)
    assert fine > 180


@pytest.mark.exhaustive
def test_the_ladder_answers_about_loaded_states():
    """Rods do, and what is known beforehand is of the deformed state, by the coarsest of them."""
    rotor, loads = ROTOR, jb.Loads(tip_force=[0.0, 1.0, 2.0])
    question = jb.ladder.ModalFrequencies(3.0, jb.labels(in_plane=1, flap=1), loads=loads)
    choice = jb.choose_model(rotor, question, 1e-3)
    assert choice.met
    assert isinstance(choice.model, jb.SpatialRod)
    fine = jb.modes(jb.SpatialRod(10), rotor, 3.0, question.which, loads=loads).frequency
    assert np.abs(choice.answer / np.asarray(fine) - 1).max() < 1e-3
    tip = jb.steady(jb.SpatialRod(10), rotor, 3.0, loads=loads).tip
    size = jnp.linalg.norm(tip[1:]) / rotor.beam.length
    np.testing.assert_allclose(choice.indicators.size, size, rtol=5e-2)
