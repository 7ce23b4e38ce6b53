"""Damping by the rates of strain: its power, what it leaves alone, and rates of decay at speed."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._numerics.linalg import dense
from tests.beams import SOFT_SPRINGS, short
from tests.helpers import BUILT, DISCRETE, ELEMENTS, THEORIES, finite_difference, name
from tests.models.states import random_state
from tests.tiers import exhaustive, slow

BEAM = jb.Beam(8.0, 0.2, 5e6, 566.0, 566.0, torsional_stiffness=400.0)
LONG = jb.Rotor(BEAM, 0.5)
SHORT = jb.Rotor(short(4e3, torsional_stiffness=6.0), 0.4)
# As `AS_BUILT`, without what elements in the plane have not.
STEPPED = jb.Rotor(
    jb.Beam(2.0, 1.3, jb.Spanwise([0, 0.3, 0.3, 1], [4e3, 4e3, 3e3, 2e3]), 11.0, 7.0), 0.4,
    root_springs=jb.RootSprings(in_plane=40.0), tip_body=jb.TipBody(0.3, 0.1, 0.02),
)  # fmt: skip
C, SPEEDS = jnp.array(2e-3), np.array([0.0, 10.0, 20.0])
DRAG = Drag(stiffness_coefficient=C)


def rest(*cases):
    return [exhaustive(*case) for case in cases]


def decay(model, rotor, damping):
    """Rates of decay of the first in-plane mode at all speeds: eigenvalues of the derivatives of
    the forces about steady rotation."""
    zero = jnp.zeros(())

    @jax.jit
    @jax.vmap
    def linearised(speed):
        scene = jb.results.Scene(model, rotor, jb.ConstantSpeed(speed), jb.Loads(), damping)
        q = jnp.zeros(len(model.directions))
        if not scene.is_linear:
            q, _ = model.steady(rotor, speed)
        k, c = jax.jacfwd(scene.force, (1, 2))(scene.inputs(zero), q, jnp.zeros_like(q))
        return dense(scene.mass), k, c

    directions = [
        f in (jb.models.Direction.AXIAL, jb.models.Direction.IN_PLANE) for f in model.directions
    ]
    own = np.ix_(np.flatnonzero(directions), np.flatnonzero(directions))
    found = []
    for m, k, c in zip(*map(np.asarray, linearised(SPEEDS)), strict=True):
        light = np.linalg.solve(m[own], np.hstack([k[own], c[own]]))
        n = len(light)
        each = np.linalg.eigvals(np.vstack([np.eye(n, 2 * n, n), light]))
        each = each[each.imag > np.abs(each.real)]  # not overdamped
        found.append(-each[np.argmin(each.imag)].real)
    return np.array(found)


def expected():
    """c phi^T K phi / 2 of the beam without stretch, K its elastic stiffness, phi^T M phi = 1."""
    model = jb.Hybrid(0, 10, 0)
    elastic = np.asarray(model.linearise(LONG, 0.0).stiffness)
    found = []
    for speed in SPEEDS:
        system = model.linearise(LONG, speed)
        root = np.linalg.inv(np.linalg.cholesky(system.mass))
        phi = root.T @ np.linalg.eigh(root @ system.stiffness @ root.T)[1][:, 0]
        found.append(C * phi @ elastic @ phi / 2)
    return np.array(found)


@pytest.mark.parametrize(
    ("model", "within"),
    [
        (jb.Hybrid(4, 10, 0), 6e-3),
        slow(jb.PlanarRod(8), 3e-2),
        slow(jb.VonKarman(20, 10, 0), 5e-3),
        *rest(
            (jb.papers.GreenANCF(16), 5e-3),
            (jb.papers.ANCF(16), 5e-3),
            (jb.papers.SmallStrainANCF(16), 5e-3),
            (jb.papers.ChordANCF(8), 8e-2),
        ),
    ],
    ids=name,
)
def test_rates_of_decay_at_speed(model, within):
    """Tension stiffens, but does not damp."""
    found = decay(model, LONG, jb.Damping(stiffness_coefficient=C))
    np.testing.assert_allclose(found, expected(), rtol=within)


@pytest.mark.parametrize("kind", [THEORIES[0], *rest(*((k,) for k in THEORIES[1:]))])
def test_a_rigid_rotation_is_damped_by_the_spring_of_the_root_alone(kind):
    """Of a rod bent and stretched as it may be: moment c k omega, and nothing on any other
    coordinate."""
    n, spring, spin = 3, 40.0, 0.7
    rotor = jb.Rotor(SHORT.beam, 0.4, root_springs=jb.RootSprings(in_plane=spring))
    model = kind(n).suited(rotor)
    _, q, _ = random_state(model, 3, True)
    # L w' and L u' of the root, then w, L w', u, L u' of the other nodes, about the root.
    along = np.append([2.0], np.stack([2.0 * np.arange(1, n + 1) / n, np.full(n, 2.0)], 1))
    across, lengthwise = np.r_[0, 2:4, 6:8, 10:12], np.r_[1, 4:6, 8:10, 12:14]
    v = jnp.zeros_like(q).at[across].set(spin * (along + q[lengthwise]))
    v = v.at[lengthwise].set(-spin * q[across])
    force = jax.jit(lambda q, v: model.equations(rotor).damping(q, v, DRAG))(q, v)
    np.testing.assert_allclose(force @ v, C * spring * spin**2, rtol=1e-10)
    np.testing.assert_allclose(force[2:], 0.0, atol=1e-13)
    strained = jax.jit(lambda q, v: model.equations(rotor).damping(q, v, DRAG))(q, 1.1 * v + q)
    assert np.abs(strained[2:]).max() > 0.1  # what is not rigid is damped


@pytest.mark.parametrize(
    ("model", "points"), [(jb.PlanarRod(2), 5), *rest((jb.VonKarman(5, 3, 2), 12))], ids=name
)
def test_power_is_twice_the_energy_of_the_rates_of_strain(model, points):
    """c int EA eps'^2 + EI kappa'^2 dx, by strain and curvature as results give them."""
    rotor = SHORT
    _, q, v = random_state(model, 1, jb.models.Direction.FLAP not in model.directions)
    x, w = np.polynomial.legendre.leggauss(points)
    xi = np.ravel((np.arange(2)[:, None] + (1 + x) / 2) / 2)
    dx = np.tile(w, 2) * rotor.beam.length / 4

    @jax.jit
    def both(q, v):
        equations = model.equations(rotor)
        strain = jax.jvp(lambda q: equations.strain(q, xi), (q,), (v,))[1]
        bend = jax.jvp(lambda q: equations.curvature(q, xi), (q,), (v,))[1]
        stiffness = jnp.stack([
            rotor.beam.in_plane_bending_stiffness, rotor.beam.flap_bending_stiffness
        ])  # fmt: skip
        power = rotor.beam.axial_stiffness * strain**2 + bend**2 @ stiffness
        return equations.damping(q, v, DRAG) @ v, C * dx @ power

    given, found = both(q, v)
    np.testing.assert_allclose(given, found, rtol=1e-9)


EVERY = [(model, SHORT) for model in ELEMENTS[1:]]
EVERY += [(kind(2).suited(STEPPED), STEPPED) for kind in THEORIES] + [
    (m, SOFT_SPRINGS) for m in DISCRETE
]
EVERY += BUILT


@pytest.mark.parametrize(
    ("model", "rotor"),
    # The second one ended the process where all but the rates was constant, see `compute_once`.
    [
        (jb.papers.GreenANCF(2), SHORT), (jb.VonKarman(5, 3, 2), SHORT),
        (DISCRETE[0], SOFT_SPRINGS),
        *rest(*EVERY),
    ],
    ids=name,
)  # fmt: skip
def test_damping_is_the_stiffness_at_rest_and_has_its_tangents(model, rotor):
    """About the undeformed beam it is the stiffness, of any theory; anywhere the matrix of damping
    is symmetric and not negative, and its tangents are derivatives."""
    _, q, v = random_state(model, 2, jb.models.Direction.FLAP not in model.directions)

    @jax.jit
    def found(q, v):
        equations = model.equations(rotor)
        rest = jnp.zeros_like(q)
        at_rest = equations.viscous_force(rest, v), jax.jvp(
            equations.elastic_force, (rest,), (v,)
        )[1]  # fmt: skip
        given = equations.damping_tangents(q, v, DRAG)
        exact = jax.jacfwd(
            lambda q, v: equations.as_force(q, equations.damping(q, v, DRAG)), (0, 1)
        )(q, v)
        matrix = jax.jacfwd(equations.viscous_force, 1)(q, v)
        return at_rest, [dense(a) for a in given], exact, matrix

    at_rest, given, exact, matrix = found(q, v)
    np.testing.assert_allclose(*at_rest, rtol=1e-9, atol=1e-10 * np.abs(at_rest[1]).max())
    for a, b in zip(given, exact, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-11 * np.abs(b).max())
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-10, atol=1e-11 * np.abs(matrix).max())
    assert np.linalg.eigvalsh(matrix)[0] > -1e-10 * np.abs(matrix).max()


def test_discrete_coordinates_do_not_matter():
    """Exact springs have one power, by x and y as by s and theta."""
    polar = jb.papers.DiscreteNP().equations(SOFT_SPRINGS)
    s, rate = jnp.array([0.1, 0.7]), jnp.array([-0.4, 1.3])
    q, v = jax.jvp(polar.place, (s,), (rate,))
    power = jb.papers.DiscreteNC().equations(SOFT_SPRINGS).viscous_force(q, v) @ v
    np.testing.assert_allclose(power, 600.0 * 0.4**2 + 30.0 * 1.3**2, rtol=1e-12)
    np.testing.assert_allclose(polar.viscous_force(s, rate) @ rate, power, rtol=1e-12)


@pytest.mark.exhaustive
def test_floquet_of_damped_elements_at_a_constant_speed():
    """Multipliers decay as the linearised forces say."""
    model, period = jb.PlanarRod(2), 0.3
    found = jb.floquet(
        model, LONG, jb.ConstantSpeed(20.0), period=period,
            damping=jb.Damping(stiffness_coefficient=C),
        steps=512,
    )  # fmt: skip
    slowest = np.log(np.abs(found.multipliers)).max() / period
    rate = decay(model, LONG, jb.Damping(stiffness_coefficient=C))[-1]
    np.testing.assert_allclose(-slowest, rate, rtol=1e-6)


@pytest.mark.exhaustive
def test_gradient_and_batch_by_the_coefficient():
    """Of a spin-up of elements, against differences, and each of a batch as it is alone."""
    times = jnp.linspace(0.0, 0.8, 9)

    def end(c):
        return jb.simulate(
            jb.PlanarRod(2), SHORT, jb.SmoothSpinUp(3.0, 0.5), times,
            damping=jb.Damping(stiffness_coefficient=c), throw=False, dt0=0.01, max_steps=128,
            stepsize_controller=diffrax.ConstantStepSize(),
        ).tip[-1, 1]  # fmt: skip

    each = jnp.array([1e-3, 5e-3])
    value, slope = jax.jit(jax.vmap(jax.value_and_grad(end)))(each)
    one = jax.jit(end)
    np.testing.assert_allclose(value, [one(c) for c in each], rtol=1e-12)
    np.testing.assert_allclose(
        slope[1], finite_difference(lambda c: one(c[0]), each[1:])[0], rtol=1e-6
    )
