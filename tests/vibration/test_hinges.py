"""Blades on free hinges: root springs of zero."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

import jaxbeam as jb
from tests.tiers import exhaustive, slow

LENGTH = 8.0
FREE = jb.RootSprings(0.0, 0.0)
WHICH = jb.labels(in_plane=2, flap=3)
LAG, FLAP = 0, slice(2, 5)  # among these


def hinged(hub_radius=0.0, flap_stiffness=400.0, root_springs=FREE, tip_mass=0.0, **more):
    beam = jb.Beam(LENGTH, 0.2, 5e6, 566.0, flap_stiffness, torsional_stiffness=300.0)
    return jb.Rotor(beam, hub_radius, tip_mass, root_springs=root_springs, **more)


MODEL = jb.Hybrid(0, 4, 8)


@jax.jit
def of(hub_radius, speed, spring=0.0, flap_stiffness=400.0, tip_mass=0.0):
    root = jb.RootSprings(spring, spring)
    rotor = hinged(hub_radius, flap_stiffness, root, tip_mass)
    return jb.modes(MODEL, rotor, speed, WHICH, throw=False)


def of_rigid(offset):
    """Frequencies in lag and flap of a rigid uniform blade, over the speed."""
    lag = 1.5 * offset / LENGTH
    return np.sqrt([lag, 1 + lag])


def test_a_rigid_blade_swings_at_the_speed_in_flap_and_by_its_offset_in_lag():
    """At low speeds, where the blade hardly bends; in flap about the axis of rotation, for which
    a turned plane of rotation is a steady state, at any speed and with anything at the tip."""
    for offset in (0.0, 0.5, 8.0):
        found = of(offset, 0.05).frequency / 0.05
        np.testing.assert_allclose(found[np.array([0, 2])], of_rigid(offset), rtol=1e-5, atol=1e-6)
    for speed, tip_mass in ((40.0, 0.0), (3.0, 2.0)):
        found = of(0.0, speed, tip_mass=tip_mass)
        assert found.status == jb.Status.OK
        np.testing.assert_allclose(found.frequency[FLAP][0], speed, rtol=1e-11)
        assert abs(found.eigenvalue[LAG]) < 1e-6 * speed


def test_a_cable_has_its_frequencies():
    """EI = 0: omega^2 = n (2 n - 1) Omega^2, Legendre polynomials of odd degree."""
    found = of(0.0, 3.0, flap_stiffness=1e-9).frequency[FLAP] / 3.0
    np.testing.assert_allclose(found, np.sqrt([1.0, 6.0, 15.0]), rtol=1e-9)


def test_at_rest_hinges_swing_freely_and_all_else_is_as_exact_as_ever():
    """A beam hinged at one end and free at the other: tan x = tanh x."""
    found = of(0.5, 0.0)
    assert found.status == jb.Status.OK
    assert found.labels == WHICH
    assert found.eigenvalue[LAG] == found.eigenvalue[FLAP][0] == 0.0
    assert not np.any(found.growth_rate)
    x = np.array([3.926602312047919, 7.068582745628732])
    flap = x**2 * np.sqrt(400.0 / 0.2) / LENGTH**2
    np.testing.assert_allclose(found.frequency[FLAP][1:], flap, rtol=1e-3)
    np.testing.assert_allclose(found.frequency[FLAP][1], flap[0], rtol=1e-7)


def test_a_frequency_that_is_lost_in_rounding_is_told():
    """A spring that holds the root by less than rounding leaves of the stiffness of bending: the
    frequency is not zero, and nobody knows it. Bending is as right as ever."""
    lost, soft = of(0.5, 0.0, 1e-13), of(0.5, 0.0, 1e-7)
    assert lost.status == jb.Status.INACCURATE
    assert soft.status == jb.Status.OK
    rigid = np.sqrt(1e-7 / (0.2 * LENGTH**3 / 3))
    np.testing.assert_allclose(soft.frequency[LAG], rigid, rtol=1e-3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.PlanarRod(4), jb.papers.ANCF(4), jb.SpatialRod(2)], ids=repr)
@pytest.mark.parametrize("count", [1, 3])
def test_elements_tell_what_rounding_leaves(model, count):
    """Right to 2e-3, or INACCURATE, from a spring that holds well to none at all."""
    springs = np.repeat(10.0 ** np.arange(-12.0, -1.0)[:, None], count, 1)

    @jax.jit
    def found(springs):
        def one(spring):
            rotor = hinged(root_springs=jb.RootSprings(in_plane=spring))
            return jb.modes(model, rotor, 0.0, jb.labels(in_plane=1), throw=False)

        return jax.vmap(one)(springs)

    right = np.sqrt(springs / (0.2 * LENGTH**3 / 3))
    told = 0
    for spring, exact in zip(springs, right, strict=True):
        each = found(spring)
        fine = np.asarray(each.status) == jb.Status.OK
        told += np.sum(~fine)
        assert set(np.asarray(each.status)[~fine]) <= {jb.Status.INACCURATE}
        np.testing.assert_allclose(each.frequency[fine, 0], exact[fine], rtol=2e-3)
    assert 0 < told < springs.size
    free = found(np.zeros(count))
    assert not np.any(free.status)
    assert not np.any(free.frequency)


@pytest.mark.slow
def test_springs_may_be_zero_in_some_cases_of_a_batch():
    springs, speeds = jnp.array([0.0, 0.0, 50.0, 50.0]), jnp.array([0.0, 4.0, 0.0, 4.0])
    found = jax.jit(jax.vmap(lambda k, w: of(0.5, w, k)))(springs, speeds)
    for i in range(4):
        alone = of(0.5, speeds[i], springs[i])
        np.testing.assert_allclose(found.eigenvalue[i], alone.eigenvalue, rtol=1e-11)
        assert found.status[i] == jb.Status.OK
    # A spring so soft that the blade hardly bends: k / (rho L^3 / 3).
    soft = of(0.5, 0.0, 1e-4).frequency
    np.testing.assert_allclose(soft[LAG], np.sqrt(1e-4 / (0.2 * LENGTH**3 / 3)), rtol=1e-6)


@pytest.mark.slow
def test_derivatives_of_a_frequency_of_zero_are_none_and_spoil_no_others():
    def frequency(spring, speed):
        return of(0.5, speed, spring).frequency

    by = jax.jit(jax.jacrev(frequency))
    forward = jax.jit(lambda k, w: jax.jvp(lambda k: frequency(k, w), (k,), (jnp.ones_like(k),))[1])
    for speed, known in ((0.0, np.array([1, 3, 4])), (3.0, np.arange(5))):
        step = 0.05  # one-sided: there are no springs below zero
        f0, f1, f2 = (frequency(k, speed) for k in (0.0, step, 2 * step))
        wanted = (4 * f1 - 3 * f0 - f2) / (2 * step)
        for found in (by(0.0, speed), forward(0.0, speed)):
            assert np.isnan(found).sum() == 5 - known.size
            np.testing.assert_allclose(found[known], wanted[known], rtol=1e-3)


@pytest.mark.parametrize(
    "model",
    [
        slow(jb.PlanarRod(3), id="elements"),
        exhaustive(jb.VonKarman(6, 4, 4), id="von_karman"),
        exhaustive(jb.papers.GreenANCF(3), id="green"),
        exhaustive(jb.papers.ANCF(3), id="ancf"),
        exhaustive(jb.Hybrid(3, 5, 5), id="hybrid"),
    ],
)
def test_every_theory_lets_a_hinge_turn(model):
    """At rest, in the axis and with an offset, where the blade's bending takes off little."""
    planar = jb.models.Direction.FLAP not in model.directions
    root = jb.RootSprings(0.0) if planar else FREE
    which = jb.labels(in_plane=1) if planar else jb.labels(in_plane=1, flap=1)

    @jax.jit
    def first(hub_radius, speed):
        return jb.modes(model, hinged(hub_radius, root_springs=root), speed, which, throw=False)

    still, axis, offset = first(0.5, 0.0), first(0.0, 4.0), first(0.5, 4.0)
    for case in (still, axis, offset):
        assert case.status == jb.Status.OK
        assert case.labels == which
    assert not np.any(still.eigenvalue)
    assert abs(axis.eigenvalue[0]) < 0.02 * 4.0  # von Karman's tension is not exact
    np.testing.assert_allclose(offset.frequency / 4, of_rigid(0.5)[: len(which)], rtol=1e-2)
    if not planar:
        np.testing.assert_allclose(axis.frequency[1], 4.0, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("stretch", [0, exhaustive(1)])
def test_two_hinges_in_one_plane(stretch):
    """Where sections are turned, lag and flap are coupled, and both free."""
    model = jb.Hybrid(stretch, 3, 3)
    which = jb.labels(in_plane=1, flap=1)

    @jax.jit
    def first(speed):
        return jb.modes(model, hinged(0.5, pitch=0.3), speed, which, throw=False)

    still, turning = first(0.0), first(0.05)
    assert still.status == turning.status == jb.Status.OK
    assert not np.any(still.eigenvalue)
    np.testing.assert_allclose(turning.frequency / 0.05, of_rigid(0.5), rtol=1e-4)


@pytest.mark.exhaustive
def test_southwell_coefficients_of_what_swings():
    """At rest 1 + 3 R / (2 L) in flap, 3 R / (2 L) in lag."""
    both = jb.labels(in_plane=1, flap=1)
    phi = jax.jit(lambda r: jb.southwell(MODEL, hinged(r), 0.0, both).coefficient)
    for offset in (0.0, 0.01, 0.5):
        np.testing.assert_allclose(phi(offset), of_rigid(offset) ** 2, atol=1e-9)
    elements = jb.PlanarRod(2)
    found = jb.southwell(
        elements, hinged(0.5, root_springs=jb.RootSprings(0.0)), 0.0, 1
    ).coefficient
    np.testing.assert_allclose(found, of_rigid(0.5)[0] ** 2, rtol=1e-6)


@pytest.mark.slow
def test_a_hinge_gives_way_at_once_or_never():
    """The classical theory has nothing that holds a hinge; the hybrid one does at any speed."""
    rotor, axis = (hinged(r, root_springs=jb.RootSprings(0.0)) for r in (0.5, 0.0))
    classical, hybrid = (theory(0, 4, 0) for theory in (jb.Classical, jb.Hybrid))
    assert jb.critical_speed(classical, rotor).angular_speed == 0.0
    assert jb.critical_speed(hybrid, rotor).angular_speed == np.inf
    assert jb.critical_speed(hybrid, axis).angular_speed == np.inf


@pytest.mark.exhaustive
def test_elements_on_a_hinge_in_the_axis_tear_before_they_give_way():
    """Neither held nor driven out, which is what rounding makes of differences of large numbers. A
    body that reaches beyond the axis drives it out at once, as the hybrid theory says."""
    free = jb.RootSprings(0.0)
    tears = np.pi / (2 * LENGTH) * np.sqrt(5e6 / 0.2)
    for n in (4, 8):
        found = jb.critical_speed(jb.PlanarRod(n), hinged(root_springs=free))
        np.testing.assert_allclose(found.angular_speed, tears, rtol=1e-6)
        assert found.direction == jb.models.Direction.AXIAL
    beyond = hinged(0.5, root_springs=free, tip_mass=None, tip_body=jb.TipBody(3.0, -12.0, 0.1))
    assert jb.critical_speed(jb.Hybrid(0, 8, 0), beyond).angular_speed == 0.0
    assert jb.critical_speed(jb.PlanarRod(4), beyond).angular_speed == 0.0


@pytest.mark.exhaustive
def test_a_column_on_a_free_hinge_is_held_by_nothing_but_its_speed():
    """Turned by phi the rod's load along the axis has the moment P L phi about its root, what
    carries it on its circle one of Omega^2 R (rho L^2 / 2) phi the other way."""
    rotor = jb.Rotor(jb.Beam(LENGTH, 0.2, 1e9, 1e7, 1e7), 0.5, root_springs=jb.RootSprings(0.0))
    model, push = jb.PlanarRod(2), jb.Loads(tip_force=jnp.array([-1.0, 0, 0]))
    still = jb.critical_load(model, rotor, push, 0.0, throw=False)
    assert still.status == jb.Status.NOT_HELD
    assert np.isnan(still.factor)
    held = jb.critical_load(model, rotor, push, 2.0)
    np.testing.assert_allclose(held.factor, 2.0**2 * 0.5 * 0.2 * LENGTH / 2, rtol=1e-4)


@pytest.mark.exhaustive
def test_a_free_blade_falls_and_swings():
    """A rigid blade at speed under gravity along the axis: phi = -3 g / (2 L Omega^2)
    (1 - cos Omega t); at rest it falls with phi'' = -3 g / (2 L). By exponentials too, which know
    no place where it rests."""
    model = jb.Hybrid(0, 1, 1)
    t, fall = jnp.linspace(0.0, 2.0, 21), jb.Loads(gravity=jnp.array([0.0, 0.0, -9.81]))

    @jax.jit
    def tip(speed):
        return jb.simulate(model, hinged(), jb.ConstantSpeed(speed), t, loads=fall).tip[:, 2]

    drop = 1.5 * 9.81
    np.testing.assert_allclose(tip(3.0), -drop / 9 * (1 - np.cos(3 * t)), atol=1e-5)
    np.testing.assert_allclose(tip(0.0), -drop * t**2 / 2, rtol=1e-7, atol=1e-9)
    run = jb.simulate(
        model, hinged(), jb.ConstantSpeed(0.0), t, loads=fall, solver=jb.solvers.Magnus(), dt0=0.1
    )
    np.testing.assert_allclose(run.tip[:, 2], -drop * t**2 / 2, rtol=1e-7, atol=1e-9)


@pytest.mark.exhaustive
def test_a_pendulum_of_elements_has_its_large_swing():
    """In the plane, let go level: half a turn in 2 K(1/2) (2 L / (3 g))^1/2, K = 1.8540746773."""
    rotor = jb.Rotor(jb.Beam(LENGTH, 0.2, 1e8, 1e5, 1e5), root_springs=jb.RootSprings(0.0))
    model = jb.PlanarRod(2)
    half = 2 * 1.8540746773013719 * np.sqrt(2 * LENGTH / (3 * 9.81))
    run = jb.simulate(
        model, rotor, jb.ConstantSpeed(0.0), jnp.array([0.0, half / 2, half]),
        loads=jb.Loads(gravity=jnp.array([0.0, -9.81, 0.0])),
    )  # fmt: skip
    np.testing.assert_allclose(run.tip[1:, :2], [[-8.0, -8.0], [-16.0, 0.0]], atol=0.05)


@pytest.mark.exhaustive
def test_multipliers_and_the_ladder_take_free_hinges():
    rotor = hinged(0.5, root_springs=jb.RootSprings(0.0))
    motion = jb.motions.ModulatedSpeed(5.0, 0.0, 20.0)
    found = jb.floquet(jb.Hybrid(0, 2, 0), rotor, motion)
    angle = 5 * of_rigid(0.5)[0] * 2 * np.pi / 20
    assert np.min(np.abs(np.angle(found.multipliers) - angle)) < 1e-3
    np.testing.assert_allclose(np.abs(found.multipliers), 1.0, atol=1e-9)
    question = jb.ladder.PeakDeflection(jb.SmoothSpinUp(1.0, 10.0), np.linspace(0.0, 12.0, 40))
    assert jb.choose_model(rotor, question, tolerance=0.05).model is not None


def rigid_in_a_cone(lag, flap, cone, hub, speed):
    """Frequencies of a rigid rod of length and mass one on a root of springs whose axes are those
    of the cone: by the elevation t and azimuth p of the rod, with the energies as they are."""

    def place(q, x):
        t, p = q
        return hub * np.eye(3)[0] + x * jnp.stack(
            [jnp.cos(t) * jnp.cos(p), jnp.cos(t) * jnp.sin(p), jnp.sin(t)]
        )

    def potential(q):
        along, side, up = place(q, 1.0) - hub * np.eye(3)[0]
        along, up = (
            jnp.cos(cone) * along + jnp.sin(cone) * up,
            jnp.cos(cone) * up - jnp.sin(cone) * along,
        )
        across = jnp.sqrt(side**2 + up**2)
        share = jnp.arctan2(across, along) / across
        springs = share**2 * (lag * side**2 + flap * up**2) / 2
        return springs - speed**2 * sum(w * r[0] ** 2 + w * r[1] ** 2 for w, r in each(q)) / 2

    def each(q):
        x, w = np.polynomial.legendre.leggauss(3)
        return [(b / 2, place(q, (1 + a) / 2)) for a, b in zip(x, w, strict=True)]

    slope = jax.jit(jax.grad(potential))
    t = scipy.optimize.brentq(lambda t: slope(jnp.array([t, 1e-9]))[0], -0.3, cone - 1e-6)
    q = jnp.array([t, 1e-6])  # not at zero, where the angle has a square root
    k = jax.hessian(potential)(q)
    x, w = np.polynomial.legendre.leggauss(3)
    ways = [jax.jacfwd(lambda q, a=a: place(q, (1 + a) / 2))(q) for a in x]
    m = sum(b / 2 * d.T @ d for b, d in zip(w, ways, strict=True))
    g = (
        2
        * speed
        * sum(b / 2 * (d[0, 0] * d[1, 1] - d[1, 0] * d[0, 1]) for b, d in zip(w, ways, strict=True))
    )
    g = np.array([[0, g], [-g, 0]])
    m, k, zero = np.asarray(m), np.asarray(k), np.zeros((2, 2))
    matrix = np.block([[zero, np.eye(2)], [-np.linalg.solve(m, k), -np.linalg.solve(m, g)]])
    return np.sort(np.linalg.eigvals(matrix).imag)[2:]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("lag", "flap", "cone", "hub", "speed"), [(5.0, 0.1, 1.0, 0.1, 4.0), (3.0, 2.0, 0.3, 0.1, 4.0)]
)
def test_springs_of_a_coned_root_have_its_axes(lag, flap, cone, hub, speed):
    """Of rigid blades, at steady turns of 0.98 and of 0.2 in flap."""
    root = jb.RootSprings(lag, flap)
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e9, 1e6, 1e6), hub, root_springs=root, precone=cone)
    found = jb.modes(jb.Hybrid(0, 4, 4), rotor, speed, 2).frequency
    np.testing.assert_allclose(found, rigid_in_a_cone(lag, flap, cone, hub, speed), rtol=1e-6)


@pytest.mark.parametrize("speed", [0.0, 2.0])
def test_a_hinge_for_lag_is_across_a_coned_blade(speed):
    """3 (k + W^2 (R / 2 cos b - sin^2 b / 3)): at rest a cone changes nothing."""
    cone, hub, spring = 0.6, 0.3, 5.0
    beam = jb.Beam(1.0, 1.0, 1e9, 1e6, 1e6)
    rotor = jb.Rotor(beam, hub, root_springs=jb.RootSprings(in_plane=spring), precone=cone)
    found = jb.modes(jb.Hybrid(0, 4, 4), rotor, speed, 1).frequency
    centrifugal = hub / 2 * np.cos(cone) - np.sin(cone) ** 2 / 3
    np.testing.assert_allclose(found, np.sqrt(3 * (spring + speed**2 * centrifugal)), rtol=1e-6)


@pytest.mark.parametrize("force", [0.2, 0.6])
def test_a_free_hinge_finds_where_a_force_turns_it(force):
    """A rigid rod on a hinge for lag: tan of its angle is F / (W^2 R m / 2)."""
    rotor = jb.Rotor(
        jb.Beam(1.0, 1.0, 1e5, 1e2, 1e2), 0.3, root_springs=jb.RootSprings(in_plane=0.0)
    )
    model = jb.papers.GreenANCF(2).suited(rotor)
    loads = jb.Loads(tip_force=[0.0, force, 0.0])
    found = jb.steady_start(model, rotor, jb.ConstantSpeed(2.0), loads=loads)
    angle = np.arctan(force / (4 * 0.3 / 2))
    tip = model.equations(rotor).tip(found.q)
    np.testing.assert_allclose(tip[:2], [np.cos(angle) - 1, np.sin(angle)], rtol=1e-3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("cone", [0.6, 0.1])
def test_a_coned_blade_on_a_free_hinge_lies_in_the_plane_of_rotation(cone):
    """Not folded inward, which is an equilibrium, too: flap at W (1 + 3 R / 2 L)^1/2."""
    beam = jb.Beam(1.0, 1.0, 1e5, 1e2, 1e2, torsional_stiffness=1e2, polar_inertia=1e-8)
    rotor = jb.Rotor(beam, 0.3, root_springs=jb.RootSprings(flap=0.0), precone=cone)
    model = jb.SpatialRod(2).suited(rotor)
    q, _ = model.steady(rotor, jnp.asarray(2.0))
    np.testing.assert_allclose(model.equations(rotor).tip(q)[2], -np.sin(cone), rtol=1e-3)
    found = jb.modes(model, rotor, 2.0, 1).frequency
    np.testing.assert_allclose(found, 2 * np.sqrt(1.45), rtol=1e-4)
