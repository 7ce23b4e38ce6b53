"""Ratios of modes and dampers of the root: growth rates, runs, energy, and what is refused."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import jaxbeam as jb
from jaxbeam._numerics.linalg import dense
from tests.beams import AS_BUILT, SOFT_SPRINGS, short
from tests.helpers import finite_difference, name
from tests.tiers import exhaustive, slow

ROTOR = jb.Rotor(short(), 0.4, 0.3)
SPEED = 7.0
FOUR = jb.labels(in_plane=2, flap=2)
# A rod that does not bend, on hinges of the root.
LENGTH, DENSITY, LAG, RISE, D = 2.0, 1.3, 40.0, 25.0, 1.7
STIFF = jb.Beam(LENGTH, DENSITY, 1e9, 1e8, 1e8, torsional_stiffness=1e6)
INERTIA = DENSITY * LENGTH**3 / 3


@pytest.mark.parametrize("rotor", [slow(ROTOR), exhaustive(jb.Rotor(short(), 0.4, pitch=0.3))])
def test_modes_have_the_ratios_that_are_given(rotor):
    """By their numbers, beyond the list the last; at the stated speed, to rounding, with all but
    the frequency of the real part: omega stays, since C is diagonal in the modes."""
    model = jb.Hybrid(0, 3, 3)

    @jax.jit
    def both(first, second, rest):
        damping = jb.Damping(
            in_plane_ratio=rest, flap_ratio=jnp.stack([first, second]), ratio_speed=SPEED
        )
        damped = jb.modes(model, rotor, SPEED, jb.labels(in_plane=3, flap=3), damping=damping)
        return damped.eigenvalue, jb.modes(model, rotor, SPEED, jb.labels(in_plane=3, flap=3))

    found, free = both(0.01, 0.03, 0.005)
    zeta = np.array([0.005] * 3 + [0.01, 0.03, 0.03])
    np.testing.assert_allclose(found.real, -zeta * free.frequency, rtol=1e-9)
    np.testing.assert_allclose(np.abs(found), free.frequency, rtol=1e-10)


def by_hand(model, system, ratios):
    """C = M Phi diag(2 zeta w) Phi^T M of the modes of each direction, by SciPy."""
    kinds, c = np.array(model.directions), np.zeros(system.mass.shape)
    for direction, (first, rest) in ratios.items():
        own = np.ix_(*[np.flatnonzero(kinds == direction)] * 2)
        m, k = (np.asarray(a)[own] for a in (system.mass, system.stiffness))
        square, phi = scipy.linalg.eigh(k, m)
        zeta = np.where(np.arange(square.size) == 0, first, rest)
        c[own] = m @ phi @ np.diag(2 * zeta * np.sqrt(square)) @ phi.T @ m
    return c


KIND = jb.models.Direction
RATIOS = {KIND.AXIAL: (0.2, 0.2), KIND.IN_PLANE: (0.05, 0.1)}
GIVEN = jb.Damping(axial_ratio=0.2, in_plane_ratio=[0.05, 0.1], ratio_speed=2.0)


@pytest.mark.parametrize(
    ("model", "rotor"),
    [
        (jb.Hybrid(2, 3, 1), ROTOR),
        *(exhaustive(m, ROTOR) for m in (jb.Classical(2, 3, 2), jb.papers.SmallStrainANCF(2))),
        exhaustive(jb.papers.DiscreteLP(), SOFT_SPRINGS),
        exhaustive(jb.papers.DiscreteLC(), SOFT_SPRINGS),
    ],
    ids=name,
)  # fmt: skip
def test_ratios_as_a_matrix(model, rotor):
    @jax.jit
    def matrix():
        still = jb.ConstantSpeed(0.0)
        scene = jb.results.Scene(model, rotor, still, jb.Loads(), GIVEN)
        return scene.damping.matrix, model.matrices(rotor, jnp.asarray(2.0))

    found, system = matrix()
    expected = by_hand(model, system, RATIOS)
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


@pytest.mark.exhaustive
@pytest.mark.parametrize("speed", [2.0, 5.0])
def test_ratios_beside_coriolis_forces(speed):
    """Of lag and stretch, by an eigenproblem made by itself, at the stated speed and at others."""
    model = jb.Hybrid(2, 3, 0)
    found = jb.modes(model, ROTOR, speed, jb.labels(in_plane=3, axial=1), damping=GIVEN)
    now, c = model.linearise(ROTOR, speed), by_hand(model, model.linearise(ROTOR, 2.0), RATIOS)
    n = len(model.directions)
    right = -np.linalg.solve(now.mass, np.hstack([now.stiffness, now.gyroscopic + c]))
    expected = np.linalg.eigvals(np.vstack([np.eye(n, 2 * n, n), right]))
    nearest = np.abs(np.asarray(found.eigenvalue)[:, None] - expected[None]).min(1)
    assert (nearest < 1e-10 * np.abs(found.eigenvalue)).all()
    assert (found.damping_ratio > 0.03).all()


@pytest.mark.exhaustive
def test_turned_sections_keep_the_labels_of_their_modes():
    """At rest the modes of a beam with a pitch are those without one, about other axes, and each
    has the ratio of its label."""
    damping = jb.Damping(in_plane_ratio=[0.01, 0.02], flap_ratio=[0.03, 0.04])
    model = jb.Hybrid(0, 3, 3)
    found = jb.modes(model, jb.Rotor(short(), 0.4, pitch=0.3), 0.0, FOUR, damping=damping)
    straight = jb.modes(model, jb.Rotor(short(), 0.4), 0.0, FOUR)
    np.testing.assert_allclose(found.damping_ratio, [0.01, 0.02, 0.03, 0.04], rtol=1e-9)
    np.testing.assert_allclose(np.abs(found.eigenvalue), straight.frequency, rtol=1e-9)


HINGED = jb.Rotor(STIFF, 0.3, root_springs=jb.RootSprings(LAG, RISE))
LAGS = jb.Rotor(STIFF, 0.3, root_springs=jb.RootSprings(LAG))


@pytest.mark.parametrize(
    ("model", "rotor"),
    [
        slow(jb.PlanarRod(1), LAGS), exhaustive(jb.Hybrid(0, 2, 2), HINGED),
        *(exhaustive(model, HINGED) for model in (jb.SpatialRod(2), jb.VonKarman(3, 2, 2))),
        exhaustive(jb.papers.ANCF(2), LAGS),
    ],
    ids=name,
)  # fmt: skip
def test_rigid_blade_on_a_damped_hinge(model, rotor):
    """I phi'' + d phi' + (k + c) phi = 0, c by the centrifugal force: in plane W^2 R S, S the first
    moment, in flap W^2 (R S + I). The rate is d / 2 I at any speed."""
    flaps = rotor is HINGED
    damping = jb.Damping(in_plane_damper=D, flap_damper=2 * D if flaps else None)
    which = jb.labels(in_plane=1, flap=1) if flaps else jb.labels(in_plane=1)
    found = jax.jit(
        jax.vmap(lambda speed: jb.modes(model, rotor, speed, which, damping=damping).eigenvalue)
    )(jnp.array([0.0, 3.0]))
    for eigenvalue, speed in zip(np.asarray(found), (0.0, 3.0), strict=True):
        lever = speed**2 * 0.3 * DENSITY * LENGTH**2 / 2
        held = np.array([LAG + lever, RISE + lever + speed**2 * INERTIA])[: len(eigenvalue)]
        rate = np.array([D, 2 * D])[: len(eigenvalue)] / (2 * INERTIA)
        np.testing.assert_allclose(eigenvalue.real, -rate, rtol=1e-5)
        np.testing.assert_allclose(np.abs(eigenvalue) ** 2, held / INERTIA, rtol=1e-5)
        if speed == 0:
            zeta = -eigenvalue.real / np.abs(eigenvalue)
            np.testing.assert_allclose(zeta[0], D / (2 * np.sqrt(LAG * INERTIA)), rtol=1e-5)


SWINGS = jb.Rotor(short(), 0.4, root_springs=jb.RootSprings(LAG, RISE))


@pytest.mark.parametrize(
    ("model", "rotor"),
    [
        (jb.PlanarRod(1), jb.Rotor(short(), 0.4, root_springs=jb.RootSprings(LAG))),
        exhaustive(jb.VonKarman(3, 2, 2), SWINGS), exhaustive(jb.Hybrid(0, 2, 2), SWINGS),
    ],
    ids=name,
)  # fmt: skip
def test_dampers_do_a_moment_on_the_angle_of_the_root(model, rotor):
    """However far the root has turned: power d phi'^2, phi by the slope of the curve, and tangents
    that are derivatives."""
    model, rng = model.suited(rotor), np.random.default_rng(3)
    lag, rise = rotor.springs
    damping = jb.Damping(
        in_plane_damper=None if lag is None else D, flap_damper=None if rise is None else 3 * D
    )
    n = len(model.directions)
    q, v = (jnp.asarray(0.4 * rng.normal(size=n)) for _ in range(2))

    @jax.jit
    def found(q, v):
        scene = jb.results.Scene(model, rotor, jb.ConstantSpeed(0.0), jb.Loads(), damping)
        equations, drag = scene.equations, scene.damping

        def angles(q):
            t = equations.direction(q, np.zeros(1))[0]
            if equations.is_linear or equations.root_slopes() is not None:
                return t[1:]
            across = jnp.linalg.norm(t[1:])
            return jnp.arctan2(across, t[0]) / across * t[1:]

        force = equations.damping(q, v, drag)
        exact = jax.jacfwd(lambda q, v: equations.damping(q, v, drag), (0, 1))(q, v)
        given = [dense(a) for a in equations.damping_tangents(q, v, drag)]
        return force @ v, jax.jvp(angles, (q,), (v,))[1], given, exact

    power, rate, given, exact = found(q, v)
    d = np.array([0.0 if lag is None else D, 0.0 if rise is None else 3 * D])
    np.testing.assert_allclose(power, d @ np.asarray(rate) ** 2, rtol=1e-10)
    for a, b in zip(given, exact, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-12 * np.abs(b).max())


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.PlanarRod(1), jb.Hybrid(0, 2, 0)], ids=name)
def test_a_damper_takes_the_energy_that_is_lost(model):
    """Jacobi's integral falls by int d phi'^2 dt in a run that swings far, and work is balanced."""
    rotor = jb.Rotor(short(), 0.4, root_springs=jb.RootSprings(LAG))
    times = jnp.linspace(0.0, 1.0, 401)
    run = jb.simulate(
        model, rotor, jb.SmoothSpinUp(3.0, 0.5), times, damping=jb.Damping(in_plane_damper=D)
    )
    assert np.abs(run.imbalance).max() < 1e-6
    late = np.asarray(times) >= 0.5  # where the hub turns steadily
    suited = model.suited(rotor)
    scene = jb.results.Scene(suited, rotor, jb.ConstantSpeed(0.0), jb.Loads(), jb.Damping())

    @jax.jit
    @jax.vmap
    def rate(q, v):
        t, turning = jax.jvp(lambda q: scene.equations.direction(q, np.zeros(1))[0], (q,), (v,))
        return turning[1] if suited.is_linear else (t[0] * turning[1] - t[1] * turning[0]) / (t @ t)

    lost = scipy.integrate.simpson(
        D * np.asarray(rate(run.state.q, run.state.v))[late] ** 2, x=np.asarray(times)[late]
    )
    h = np.asarray(run.jacobi_integral)[late]
    np.testing.assert_allclose(h[0] - h[-1], lost, rtol=1e-4)
    assert lost > 0.03 * np.asarray(run.strain_energy).max()


@pytest.mark.slow
def test_a_run_decays_as_its_ratio_says():
    """Of the first mode, by e^(-zeta omega t) cos and so on; the second list entry is another."""
    model, zeta = jb.Hybrid(0, 2, 0), 0.04
    system, times = model.linearise(ROTOR, 0.0), jnp.linspace(0.0, 2.0, 41)
    square, shapes = scipy.linalg.eigh(system.stiffness, system.mass)
    omega, shape = np.sqrt(square[0]), jnp.asarray(shapes[:, 0] / shapes[0, 0]) * 1e-3
    run = jb.simulate(
        model, ROTOR, jb.ConstantSpeed(0.0), times, start=jb.solvers.State(shape, 0 * shape),
        damping=jb.Damping(in_plane_ratio=[zeta, 0.3]),
    )  # fmt: skip
    swings = omega * np.sqrt(1 - zeta**2)
    decay = np.exp(-zeta * omega * times)
    exact = decay * (np.cos(swings * times) + zeta * omega / swings * np.sin(swings * times))
    np.testing.assert_allclose(run.state.q, exact[:, None] * shape[None], atol=3e-5 * shape[0])
    assert np.abs(run.imbalance).max() < 1e-6


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "damping"),
    [
        (jb.Hybrid(0, 1, 1), jb.Damping(in_plane_ratio=0.02, flap_ratio=0.05, flap_damper=D)),
        (jb.PlanarRod(1), jb.Damping(in_plane_damper=D)),
    ],
    ids=name,
)
def test_floquet_at_a_constant_speed(model, damping):
    """Multipliers are e^(lambda T) of `modes`."""
    rotor = SWINGS if isinstance(model, jb.Hybrid) else jb.Rotor(
        short(), 0.4, root_springs=jb.RootSprings(LAG)
    )  # fmt: skip
    found = jb.floquet(model, rotor, jb.ConstantSpeed(2.0), 0.3, damping=damping, steps=16)
    modes = jb.modes(model, rotor, 2.0, 2, damping=damping)
    expected = np.sort(np.abs(np.exp(0.3 * modes.eigenvalue)))
    for each in expected:
        assert np.abs(np.abs(found.multipliers) - each).min() < 1e-8


def form(x):
    """v^T C v by a ratio, a damper, the spring of the root and the speed of the ratios."""
    ratio, damper, spring, speed = x
    rotor = jb.Rotor(short(), 0.4, root_springs=jb.RootSprings(spring))
    damping = jb.Damping(in_plane_ratio=[ratio, 0.02], in_plane_damper=damper, ratio_speed=speed)
    model, still = jb.Hybrid(0, 3, 0).suited(rotor), jb.ConstantSpeed(0.0)
    v = jnp.array([0.3, -0.7, 0.9])
    return v @ jb.results.Scene(model, rotor, still, jb.Loads(), damping).damping.matrix @ v


AT = jnp.array([0.05, 0.3, LAG, 3.0])


@pytest.mark.slow
def test_derivatives_of_ratios_and_dampers():
    slope, value = jax.jit(jax.grad(form)), jax.jit(form)
    np.testing.assert_allclose(slope(AT), finite_difference(value, AT), rtol=1e-8)


@pytest.mark.exhaustive
def test_second_derivatives_of_ratios_and_dampers():
    found = jax.jit(jax.hessian(form))(AT)
    expected = finite_difference(jax.jit(jax.grad(form)), AT)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-9 * np.abs(expected).max())


@pytest.mark.exhaustive
def test_gradients_and_batches():
    """By ratios, dampers and the rotor, in reverse mode, against differences; a bad case of a batch
    spoils itself alone."""

    def rates(x):
        ratio, damper, spring = x
        rotor = jb.Rotor(short(), 0.4, root_springs=jb.RootSprings(spring))
        damping = jb.Damping(in_plane_ratio=[ratio, 0.02], in_plane_damper=damper, ratio_speed=3.0)
        found = jb.modes(
            jb.Hybrid(0, 2, 0), rotor, SPEED, jb.labels(in_plane=2), damping=damping, throw=False
        )
        return found.growth_rate, found.status

    one = jax.jit(lambda x: rates(x)[0])
    at = jnp.array([0.05, 0.3, LAG])
    slope = jax.jit(jax.jacrev(lambda x: rates(x)[0]))(at)
    np.testing.assert_allclose(slope, finite_difference(one, at), rtol=1e-6)
    bad = jnp.stack([at, at.at[0].set(jnp.nan), at.at[1].set(-1.0), 2 * at])
    found, status = jax.jit(jax.vmap(rates))(bad)
    invalid = jb.Status.INVALID_DAMPING
    np.testing.assert_array_equal(status, [jb.Status.OK, invalid, invalid, jb.Status.OK])
    assert np.isnan(found[1:3]).all()
    np.testing.assert_allclose(found[::3], [one(at), one(2 * at)], rtol=1e-10)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "rotor", "damping"),
    [
        (jb.Hybrid(2, 2, 2), AS_BUILT, lambda x: jb.Damping(flap_ratio=x, in_plane_ratio=[x, 0.1])),
        (jb.PlanarRod(2), jb.Rotor(short(), 0.4, root_springs=jb.RootSprings(LAG)),
         lambda x: jb.Damping(in_plane_damper=x)),
    ],
    ids=name,
)  # fmt: skip
def test_runs_in_a_batch_and_their_gradients(model, rotor, damping):
    """Each as it is alone, and against differences."""

    def end(x):
        return jb.simulate(
            model, rotor, jb.SmoothSpinUp(3.0, 0.5), jnp.linspace(0.0, 0.8, 9),
            damping=damping(x), throw=False,
        ).tip[-1, 1]  # fmt: skip

    each = jnp.array([0.03, 0.1])
    value, slope = jax.jit(jax.vmap(jax.value_and_grad(end)))(each)
    one = jax.jit(end)
    np.testing.assert_allclose(value, [one(x) for x in each], rtol=1e-7)
    np.testing.assert_allclose(
        slope[1], finite_difference(lambda x: one(x[0]), each[1:], 0.02)[0], rtol=1e-3
    )


def test_what_is_refused():
    in_plane, flap = jb.Damping(in_plane_ratio=0.01), jb.Damping(flap_damper=1.0)
    steady = jb.ConstantSpeed(1.0)
    for ask in (
        lambda model, damping: jb.modes(model, ROTOR, 1.0, damping=damping),
        lambda model, damping: jb.simulate(model, ROTOR, steady, [0.0, 1.0], damping=damping),
        lambda model, damping: jb.floquet(model, ROTOR, steady, 1.0, damping=damping),
    ):
        with pytest.raises(ValueError, match=r"^damping\.in_plane_ratio: \w+ has no modes that"):
            ask(jb.PlanarRod(1), in_plane)
        with pytest.raises(ValueError, match=r"^damping\.flap_damper: the root is clamped there"):
            ask(jb.Hybrid(0, 2, 2), flap)
        with pytest.raises(ValueError, match=r"^damping\.flap_damper: PlanarRod has no damper"):
            ask(jb.PlanarRod(1), flap)
    with pytest.raises(ValueError, match=r"^damping\.in_plane_ratio: exact rods, which judge"):
        jb.ladder.PeakDeflection(steady, [0.0, 1.0], damping=in_plane)
    with pytest.raises(ValueError, match=r"in_plane_ratio must be a number, or a list"):
        jb.Damping(in_plane_ratio=[[0.1]])
    with pytest.raises(ValueError, match="damping must be finite and >= 0"):
        jb.Damping(flap_ratio=[0.1, -0.1])


@pytest.mark.exhaustive
def test_a_mode_that_diverges_has_no_ratio():
    """At the speed at which ratios are stated; that of another direction is no matter."""

    def status(**ratio):
        damping = jb.Damping(ratio_speed=40.0, **ratio)
        model = jb.Classical(0, 2, 2)
        return jb.modes(model, ROTOR, 0.0, 2, damping=damping, throw=False).status

    assert status(in_plane_ratio=0.05) == jb.Status.NOT_FINITE
    assert status(flap_ratio=0.05) == jb.Status.OK
