"""Parametric stability: Mathieu's equation, symplectic pairs, motions in time, tongues."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import mathieu_a, mathieu_b

import jaxbeam as jb
from tests.helpers import finite_difference, name, slender
from tests.tiers import exhaustive, slow

ROTOR = slender(hub=0.5, tip=0.3)
SPRINGS = jb.papers.SpringRotor(1.0, 1.0, 1.0, 400.0, 300.0)
ONE = jb.Hybrid(0, 1, 0)  # m w'' + (k_0 + k_1 Omega^2) w = 0
IN_PLANE = jb.labels(in_plane=2)


def of_one():
    """k_0 / m and k_1 / m."""
    system = ONE.linearise(ROTOR, 0.0)
    squares = [ONE.linearise(ROTOR, v).stiffness[0, 0] / system.mass[0, 0] for v in (0.0, 1.0)]
    return float(squares[0]), float(squares[1] - squares[0])


class Mathieu(jb.motions.Spin):
    """A speed with which `ONE` obeys w'' + (a - 2 q cos 2t) w = 0 in the time nu t / 2."""

    a: jax.Array
    q: jax.Array
    nu: jax.Array
    of_one: tuple[float, float]
    axis: jax.Array

    def angle(self, t):
        return t  # never asked for

    def angular_speed(self, t):
        k0, k1 = self.of_one
        square = (self.nu / 2) ** 2 * (self.a - 2 * self.q * jnp.cos(self.nu * t))
        return jnp.sqrt((square - k0) / k1)


def mathieu(a, q, nu=12.0, **kwargs):
    a, q, nu, *ratios = (jnp.asarray(v, float) for v in (a, q, nu, *of_one()))
    motion = Mathieu(a, q, nu, tuple(ratios), jnp.eye(3)[2])
    return jb.floquet(ONE, ROTOR, motion, 2 * jnp.pi / nu, **kwargs)


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("function", [mathieu_a, mathieu_b])
@pytest.mark.parametrize("q", [0.05, 0.2])
def test_mathieu_characteristic_values(n, function, q):
    """There two multipliers are (-1)^n: trace 2 (-1)^n, and eigenvalues to half the digits."""
    found = mathieu(function(n, q), q)
    np.testing.assert_allclose(jnp.sum(found.multipliers), 2 * (-1) ** n, atol=1e-8)
    np.testing.assert_allclose(jnp.prod(found.multipliers), 1, atol=1e-12)


@pytest.mark.parametrize(("a", "q"), [(1.0, 0.2), (2.3, 0.4), (1.05, 0.1), (4.0, 0.6)])
def test_mathieu_between_characteristic_values(a, q):
    """Multipliers against an independent integration; growth as between b_n < a < a_n."""
    found = mathieu(a, q)

    def rate(t, y):
        return [y[1], -(a - 2 * q * np.cos(2 * t)) * y[0]]

    ends = [
        solve_ivp(rate, (0, np.pi), start, "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        for start in ([1, 0], [0, 1])
    ]
    expected = np.linalg.eigvals(np.stack(ends, 1))
    expected = expected[np.argsort(-np.abs(expected))]
    order = np.argsort(-np.abs(found.multipliers) + 1e-6 * np.imag(found.multipliers))
    expected = expected[np.argsort(-np.abs(expected) + 1e-6 * np.imag(expected))]
    np.testing.assert_allclose(np.asarray(found.multipliers)[order], expected, atol=1e-8)
    inside = any(mathieu_b(n, q) < a < mathieu_a(n, q) for n in (1, 2))
    assert (float(found.growth_rate) > 1e-6) == inside


@pytest.mark.slow
def test_order():
    """6, by the error of the trace."""
    errors = [
        abs(mathieu(mathieu_a(1, 0.2), 0.2, steps=n).multipliers.sum() + 2) for n in (8, 16, 32)
    ]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    np.testing.assert_allclose(orders, 6, atol=0.3)


SHORT = slender(20.0, 0.5, 0.3)
PAIRED = [
    slow(jb.Hybrid(2, 3, 2), SHORT),
    exhaustive(jb.Classical(2, 3, 2), SHORT),
    (jb.papers.SmallStrainANCF(2), SHORT),
    exhaustive(jb.papers.DiscreteLP(), SPRINGS),
    exhaustive(jb.papers.DiscreteNP(), SPRINGS),
    exhaustive(jb.VonKarman(3, 2, 1), SHORT),
    exhaustive(jb.papers.ANCF(1), SHORT),
    exhaustive(jb.papers.ChordANCF(1), SHORT),
]


@pytest.mark.parametrize(("model", "rotor"), PAIRED, ids=name)
def test_multipliers_come_in_pairs(model, rotor):
    """mu and 1 / mu: product one, whatever the steps."""
    found = jb.floquet(model, rotor, jb.motions.ModulatedSpeed(2.0, 0.4, 5.0), steps=48)
    mu = np.asarray(found.multipliers)
    np.testing.assert_allclose(np.prod(mu), 1, atol=1e-10)
    for value in mu:
        assert np.abs(mu - 1 / value).min() < 1e-7  # multipliers that meet have half the digits
    assert mu.size == 2 * len(model.directions)


TIMED = [
    (jb.Hybrid(1, 2, 1), jb.Damping()),
    (jb.Hybrid(1, 2, 1), jb.Damping(mass_coefficient=0.3, stiffness_coefficient=2e-3)),
    (jb.papers.SmallStrainANCF(1), jb.Damping(stiffness_coefficient=2e-3)),
]


@pytest.mark.exhaustive
@pytest.mark.parametrize(("model", "damping"), TIMED, ids=["Hybrid", "damped", "elements, damped"])
def test_against_motions_in_time(model, damping):
    """Differences of simulations from unit starts are the same matrix in other coordinates."""
    rotor, motion, n = (
        slender(20.0, 0.5, 0.3),
        jb.motions.ModulatedSpeed(2.0, 0.4, 5.0),
        len(model.directions),
    )
    times = np.array([0.0, 2 * np.pi / 5.0])

    def end(start):
        run = jb.simulate(
            model, rotor, motion, times, start=jb.solvers.State(start[:n], start[n:]),
            damping=damping,
            solver=jb.solvers.Rodas5P(), dt0=times[1] / 4000, throw=False,
            stepsize_controller=diffrax.ConstantStepSize(),
        )  # fmt: skip
        return jnp.concatenate([run.state.q[-1], run.state.v[-1]])

    starts = jnp.concatenate([jnp.zeros((1, 2 * n)), jnp.eye(2 * n)])
    ends = jax.jit(jax.vmap(end))(starts)
    expected = np.linalg.eigvals(np.asarray(ends[1:] - ends[:1]).T)
    found = np.asarray(jb.floquet(model, rotor, motion, damping=damping, steps=256).multipliers)
    for mu in expected:
        assert np.abs(found - mu).min() < 1e-6
    for mu in found:
        assert np.abs(expected - mu).min() < 1e-6


def test_mass_damping_without_stretch_is_a_factor():
    """q = exp(-c t / 2) y, and y is undamped with K - c^2 M / 4: multipliers shrink by it."""
    c, nu = 0.2, 12.0
    damped = mathieu(1.0, 0.2, nu, damping=jb.Damping(mass_coefficient=c))
    other = mathieu(1.0 - (c / 2) ** 2 / 36.0, 0.2)
    shrunk = other.multipliers * jnp.exp(-c * jnp.pi / nu)
    np.testing.assert_allclose(np.sort(damped.multipliers.real), np.sort(shrunk.real), atol=1e-9)


@pytest.mark.parametrize(
    ("model", "pair", "order"),
    [
        exhaustive(jb.Hybrid(0, 3, 0), (0, 0), 2),
        exhaustive(jb.Hybrid(0, 3, 0), (0, 1), 1),
        exhaustive(jb.Hybrid(2, 3, 0), (0, 1), 1),
        exhaustive(jb.papers.SmallStrainANCF(2), (0, 0), 1),
    ],
    ids=lambda v: name(v) or str(v),
)
def test_tongues(model, pair, order):
    """They begin at (omega_i + omega_j) / order; motion grows just inside, not just outside."""
    labels = tuple(IN_PLANE[i] for i in pair)
    frequency = jb.modes(model, ROTOR, 2.0, labels).frequency
    depths = np.array([0.01, 0.1, 0.3])
    found = jb.tongue(model, ROTOR, 2.0, labels, depths, order=order, steps=128)
    assert (found.status == jb.Status.OK).all()
    np.testing.assert_allclose(found.frequency[0], frequency.sum() / order, rtol=5e-3)
    # towards the tip, middle and width shrink with the square and the power `order` of the depth
    middle, width = found.frequency.mean(1) - found.onset, np.diff(found.frequency)[:, 0]
    np.testing.assert_allclose(middle[0] / middle[1], 0.01, rtol=0.2)
    np.testing.assert_allclose(width[0] / width[1], 0.1**order, rtol=0.05)

    @jax.jit
    def growth(depth, nu):
        return jb.floquet(
            model, ROTOR, jb.motions.ModulatedSpeed(2.0, depth, nu), steps=128, throw=False
        ).growth_rate

    for depth, (low, high) in zip(depths[1:], found.frequency[1:], strict=True):
        step = 1e-4 * (high - low)
        inside, outside = growth(depth, (low + high) / 2), 1e-9
        for end, way in ((low, 1), (high, -1)):
            assert growth(depth, end + way * step) > 1e-3 * inside > 100 * outside
            assert growth(depth, end - way * step) < outside


@pytest.mark.exhaustive
def test_damping_moves_the_tip_by_the_analytic_amount():
    """w'' + c w' + (omega^2 + eps sin nu t) w = 0: the principal tongue begins at eps = 2 c omega,
    to second order; here eps = 2 depth k_1 Omega^2."""
    k0, k1 = of_one()
    omega = np.sqrt(k0 + k1 * 4.0)
    depth = 0.02
    c = depth * k1 * 4.0 / omega
    for damping, share in (
        (jb.Damping(mass_coefficient=c), 1),
        (jb.Damping(mass_coefficient=c / 4), 0.25),
    ):
        found = jb.tongue(
            ONE, ROTOR, 2.0, jb.labels(in_plane=1) * 2, share * depth * np.array([0.995, 1.005]),
            damping=damping, throw=False,
        )  # fmt: skip
        assert found.status.tolist() == [jb.Status.NO_TONGUE, jb.Status.OK]


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.papers.GreenANCF(1), jb.papers.ChordANCF(1)], ids=name)
def test_elements_linearised_about_the_stretched_beam(model):
    """They grow in the middle of their principal tongue; Green elements, at strains of 1e-4, as the
    small-strain linearisation does."""

    def growth(model, nu):
        return jb.floquet(model, ROTOR, jb.motions.ModulatedSpeed(2.0, 0.3, nu)).growth_rate

    middle = 2 * jb.modes(model, ROTOR, 2.0, IN_PLANE[:1]).frequency[0]
    assert growth(model, middle) > 0.1
    if isinstance(model, jb.papers.GreenANCF):
        for nu in (0.97 * middle, middle, 1.05 * middle):
            expected = growth(jb.papers.SmallStrainANCF(1), nu)
            assert expected > 0.05
            np.testing.assert_allclose(growth(model, nu), expected, rtol=0.01)


@pytest.mark.exhaustive
def test_boundaries_with_damping():
    """Of a combination tongue, where growth changes sign."""
    model, damping = (
        jb.Hybrid(1, 3, 0),
        jb.Damping(mass_coefficient=0.03, stiffness_coefficient=1e-5),
    )
    found = jb.tongue(model, ROTOR, 2.0, IN_PLANE, [0.15, 0.3], damping=damping)

    @jax.jit
    def growth(nu, depth):
        motion = jb.motions.ModulatedSpeed(2.0, depth, nu)
        return jb.floquet(model, ROTOR, motion, damping=damping, throw=False).growth_rate

    for depth, (low, high) in zip(found.depth, found.frequency, strict=True):
        for end, way in ((low, 1), (high, -1)):
            assert growth(end + way * 1e-5 * (high - low), depth) > 0
            assert growth(end - way * 1e-5 * (high - low), depth) < 0


@pytest.mark.exhaustive
def test_derivatives_of_multipliers_and_tongues():
    at = jnp.array([1.0, 1.0, 100.0**2, 1.0, 1.0, 0.5, 0.3, 2.0, 0.2])
    model = jb.Hybrid(0, 2, 0)

    def rotor(p):
        return jb.Rotor(jb.Beam(*p[:5]), p[5], p[6])

    def growth(p):
        return jb.floquet(
            model, rotor(p), jb.motions.ModulatedSpeed(p[7], p[8], 6.0), throw=False
        ).growth_rate

    def ends(p):
        found = jb.tongue(
            model, rotor(p), p[7], IN_PLANE[:1] * 2, p[8:],
            damping=jb.Damping(mass_coefficient=0.02),
            throw=False,
        )  # fmt: skip
        return found.frequency[0]

    assert growth(at) > 0.01
    gradient, expected = (
        jax.jit(jax.grad(growth))(at),
        finite_difference(jax.jit(growth), at, 2e-4),
    )
    np.testing.assert_allclose(gradient, expected, atol=1e-6 * np.abs(expected).max())
    forward, expected = (
        jax.jit(jax.jacrev(ends))(at),
        finite_difference(jax.jit(ends), at, 2e-4),
    )
    np.testing.assert_allclose(forward, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.slow
def test_a_bad_case_spoils_no_other():
    def growth(mass, depth):
        motion = jb.motions.ModulatedSpeed(2.0, depth, 6.0)
        return jb.floquet(ONE, slender(hub=0.5, tip=mass), motion, throw=False)

    masses, depths = jnp.array([0.3, -1.0, 0.3]), jnp.array([0.2, 0.2, jnp.nan])
    found = jax.jit(jax.vmap(growth))(masses, depths)
    assert found.status.tolist() == [0, jb.Status.INVALID_TIP_MASS, jb.Status.INVALID_MOTION]
    assert np.isnan(found.growth_rate).tolist() == [False, True, True]
    alone = growth(masses[0], depths[0])
    np.testing.assert_allclose(found.multipliers[0], alone.multipliers, rtol=1e-12)


@pytest.mark.exhaustive
def test_a_bad_depth_spoils_no_other():
    def low(hub, depth):
        found = jb.tongue(ONE, slender(hub=hub, tip=0.3), 2.0, IN_PLANE[:1] * 2, depth, throw=False)
        return found.frequency[:, 0], found.status

    depths = jnp.array([[0.1, jnp.nan, 0.3], [0.1, 0.2, 0.3], [0.1, -1.0, 0.3]])
    hub = jnp.asarray(0.5)
    ends, status = jax.jit(jax.vmap(low, (None, 0)))(hub, depths)
    bad = jb.Status.INVALID_MOTION
    assert status.tolist() == [[0, bad, 0], [0, 0, 0], [0, bad, 0]]
    assert np.isnan(ends).tolist() == (np.asarray(status) > 0).tolist()
    np.testing.assert_allclose(ends[0, ::2], ends[1, ::2], rtol=1e-10)

    def total(hub):
        return jnp.nansum(jax.vmap(low, (None, 0))(hub, depths)[0])

    assert np.isfinite(jax.jit(jax.grad(total))(hub))


@pytest.mark.exhaustive
def test_where_there_is_nothing_to_modulate():
    """Beyond a critical speed, or that of tearing."""
    unstable = jb.tongue(
        jb.Classical(0, 3, 0), ROTOR, 4.5, IN_PLANE, [0.1], throw=False
    )  # fmt: skip
    assert unstable.status[0] == jb.Status.NO_EQUILIBRIUM
    motion = jb.motions.ModulatedSpeed(1.2 * np.pi / 2 * 70, 0.01, 50.0)
    for model in (jb.Hybrid(3, 2, 0), jb.VonKarman(3, 2, 0)):
        found = jb.floquet(model, slender(70.0), motion, throw=False, steps=256)
        assert found.status == jb.Status.NO_EQUILIBRIUM


@pytest.mark.parametrize(
    ("depth", "counts"), [(0.3, [65]), exhaustive(0.3, [48, 129]), exhaustive(0.9, [48, 65, 129])]
)
def test_errors_of_multipliers_are_what_steps_do(depth, counts):
    """Of those that are stable and those that grow, damped lightly."""
    motion = jb.motions.ModulatedSpeed(3.0, depth, 7.0)

    def found(steps):
        return jb.floquet(
            jb.Hybrid(0, 3, 0), slender(hub=0.5, tip=0.3), motion, steps=steps,
            damping=jb.Damping(stiffness_coefficient=2e-4),
        )  # fmt: skip

    exact = found(512).multipliers
    for few in map(found, counts):
        apart = np.abs(few.multipliers[:, None] - exact[None]).min(1)
        assert 1e-10 < apart.max() < 1e-3
        np.testing.assert_allclose(np.log(few.multiplier_error / apart), 0, atol=np.log(20))


@pytest.mark.exhaustive
def test_a_modulus_that_may_be_far_off_is_no_answer():
    """Of elements, whose fast modes take more steps, though each step is short enough."""
    model, motion = jb.papers.SmallStrainANCF(2), jb.motions.ModulatedSpeed(2.0, 0.3, 6.04)
    few, many = (jb.floquet(model, ROTOR, motion, steps=n, throw=False) for n in (64, 128))
    assert (few.status, many.status) == (jb.Status.TOO_FEW_STEPS, jb.Status.OK)
    assert np.isnan(few.multiplier_error).all()
    assert many.multiplier_error.max() < 1e-2


@pytest.mark.exhaustive
@pytest.mark.parametrize("depth", [0.3, 0.9])
def test_errors_of_boundaries_are_what_steps_do(depth):
    case = jb.Hybrid(0, 3, 0), slender(hub=0.5, tip=0.3), 3.0, IN_PLANE[:1] * 2, [depth]
    exact, found = (jb.tongue(*case, order=2, steps=steps) for steps in (256, 32))
    apart = np.abs(found.frequency - exact.frequency)
    np.testing.assert_allclose(np.log(found.frequency_error / apart), 0, atol=np.log(10))


@pytest.mark.exhaustive
def test_steps_that_are_too_long_see_no_tongue():
    """And say so, where the beam has one: a stiff one."""
    rotor = jb.Rotor(jb.Beam(8.0, 0.2, 5e9, 566.0, 400.0), 0.5, 0.1)
    case = jb.Hybrid(4, 3, 3), rotor, 6.0, jb.labels(flap=1) * 2, [0.1]
    few, many = (jb.tongue(*case, steps=steps, throw=False) for steps in (2, 8))
    assert few.status.tolist() == [jb.Status.TOO_FEW_STEPS]
    assert many.status.tolist() == [jb.Status.OK]


@pytest.mark.exhaustive
def test_a_rod_that_is_damped_hard_takes_more_steps_or_no_stretch():
    """The axial frequency is about 1.6e3 / s, so that it is damped 40 times beyond the critical."""
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e6, 1.0, 1.0), 0.3)
    case = rotor, jb.motions.ModulatedSpeed(2.0, 0.1, 5.0)
    how = {"damping": jb.Damping(stiffness_coefficient=0.05), "throw": False}
    few = jb.floquet(jb.Hybrid(1, 2, 0), *case, **how)
    assert few.status == jb.Status.TOO_FEW_STEPS
    many = jb.floquet(jb.Hybrid(1, 2, 0), *case, **how, steps=8192)
    stiff = jb.floquet(jb.Hybrid(0, 2, 0), *case, **how)
    found, wanted = (np.abs(one.multipliers[:2]) for one in (many, stiff))
    np.testing.assert_allclose(found, wanted, rtol=1e-4)  # 1e-6 is the share of stretch


def test_errors():
    motion = jb.motions.ModulatedSpeed(2.0, 0.2, 6.0)
    with pytest.raises(TypeError, match="period must be given"):
        jb.floquet(ONE, ROTOR, jb.ConstantSpeed(2.0))
    with pytest.raises(TypeError, match="motion must turn"):
        jb.floquet(ONE, ROTOR, 2.0)
    with pytest.raises(ValueError, match="steps must be >= 2"):
        jb.floquet(ONE, ROTOR, motion, steps=1)
    with pytest.raises(ValueError, match="motion must be"):
        jb.floquet(ONE, ROTOR, motion, 1.0)  # not its period
    with pytest.raises(ValueError, match="leave the plane"):
        jb.floquet(
            ONE, ROTOR, jb.motions.ModulatedSpeed(2.0, 0.2, 6.0, jb.motions.inclined_axis(1.0))
        )
    with pytest.raises(TypeError, match="damping must be"):
        jb.floquet(ONE, ROTOR, motion, damping=0.1)
    with pytest.raises(ValueError, match="coupled with each other"):
        jb.tongue(jb.Hybrid(0, 2, 2), ROTOR, 2.0, jb.labels(in_plane=1, flap=1), [0.1])
    with pytest.raises(ValueError, match="two labels"):
        jb.tongue(ONE, ROTOR, 2.0, IN_PLANE[:1], [0.1])
    with pytest.raises(ValueError, match="depths must be finite, positive and increasing"):
        jb.tongue(ONE, ROTOR, 2.0, IN_PLANE[:1] * 2, [0.2, 0.1])
    with pytest.raises(ValueError, match="order must be >= 1"):
        jb.tongue(ONE, ROTOR, 2.0, IN_PLANE[:1] * 2, [0.1], order=0)
    what_to_do = "stiffness_coefficient .* raise steps, or take .* fewer functions.* n_stretch=0"
    with pytest.raises(RuntimeError, match=what_to_do):
        jb.floquet(jb.Hybrid(), ROTOR, motion, steps=4)
    bad = eqx.tree_at(lambda r: r.tip_mass, ROTOR, -1.0)
    with pytest.raises(ValueError, match="tip_mass"):
        jb.floquet(ONE, bad, motion)
