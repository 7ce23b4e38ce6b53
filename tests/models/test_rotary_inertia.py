"""Rotary inertia of sections in modal theories: closed forms, particles, and rods."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import jaxbeam as jb
from tests.beams import short
from tests.models.states import assert_alike_to_second_order, random_state
from tests.tiers import exhaustive

POLAR = 0.03
BEAM = short(polar_inertia=POLAR)  # of L = 2, rho = 1.3, EI_zz = 11, EI_yy = 7
LAG, FLAP = POLAR * 11.0 / 18.0, POLAR * 7.0 / 18.0  # second moments of mass across the beam


def rayleigh(bending, inertia, count):
    """Frequencies of a cantilever with rotary inertia but no shear: EI w'''' + j W^2 w'' = m W^2 w,
    with no moment and EI w''' + j W^2 w' = 0 at its tip."""
    mass, end = 1.3, 2.0

    def determinant(omega):
        a, b = inertia * omega**2 / bending, mass * omega**2 / bending
        p, q = np.sqrt((np.array([-a, a]) + np.sqrt(a**2 + 4 * b)) / 2)
        # w = A (cosh px - cos qx) + B (sinh px / p - sin qx / q), over cosh.
        (c, s), ch, sh = np.array([np.cos(q * end), np.sin(q * end)]), 1.0, np.tanh(p * end)
        c, s = np.array([c, s]) / np.cosh(p * end)
        moment = p**2 * ch + q**2 * c, p * sh + q * s
        force = (
            p**3 * sh - q**3 * s + a * (p * sh + q * s),
            p**2 * ch + q**2 * c + a * (ch - c),
        )
        return moment[0] * force[1] - moment[1] * force[0]

    grid = np.linspace(0.1, 60.0, 4001)
    values = [determinant(omega) for omega in grid]
    ends = [i for i in range(4000) if values[i] * values[i + 1] < 0]
    return [brentq(determinant, grid[i], grid[i + 1], xtol=1e-12) for i in ends[:count]]


def test_a_cantilever_at_rest():
    found = jb.modes(jb.Hybrid(0, 14, 14), jb.Rotor(BEAM), 0.0, jb.labels(in_plane=3, flap=3))
    wanted = [*rayleigh(11.0, LAG, 3), *rayleigh(7.0, FLAP, 3)]
    np.testing.assert_allclose(found.frequency, wanted)
    assert np.max(found.frequency_error) < 1e-12


@pytest.mark.parametrize("model", [jb.Hybrid(0, 3, 3), exhaustive(jb.VonKarman(6, 3, 3))], ids=str)
def test_a_rigid_blade_on_hinges(model):
    """It flaps by (I_3 - I_1) / I_2 and lags by what its centre is off the hinge, I its moments of
    inertia about the hinge: Southwell's coefficients of a body."""
    beam = jb.Beam(2.0, 1.3, 4e11, 11e7, 7e7, polar_inertia=POLAR)
    springs = jb.RootSprings(in_plane=0.0, flap=0.0)
    along, first = 1.3 * 2.0**3 / 3, 1.3 * 2.0**2 / 2
    lag, flap = 2.0 * LAG, 2.0 * FLAP
    rotor = jb.Rotor(beam, 0.4, root_springs=springs)
    found = jb.modes(model, rotor, 3.0, jb.labels(in_plane=1, flap=1)).frequency
    offset = 0.4 * first
    wanted = offset / (along + lag), (along - flap + offset) / (along + flap)
    np.testing.assert_allclose(found, 3.0 * np.sqrt(wanted), rtol=1e-6)


def test_particles_off_the_axis():
    """Kinetic energy to second order in any motion of the hub, against particles on the axes of
    turned sections, which the least rotation carries along the beam."""
    twist = jb.Spanwise([0, 1], [0.5, -0.3])
    beam = jb.Beam(
        2.0, 1e-9, 4e3, 11.0, 7.0, twist, polar_inertia=jb.Spanwise([0, 1], [0.05, 0.02])
    )
    model, rotor = jb.Hybrid(2, 3, 3), jb.Rotor(beam, 0.4, pitch=0.2)
    equations = model.equations(rotor)
    hub, q, v = random_state(model, 3, False)
    points, length = np.linspace(0.0, 1.0, 2001), 2.0
    # Slopes by those of the polynomial through values.
    values = np.asarray(model.displacement(points, rotor))
    slopes = np.gradient(values, length * points, axis=1, edge_order=2)
    angle = 0.2 + 0.5 - 0.8 * points
    zero, c, s = 0 * points, np.cos(angle), np.sin(angle)
    sections = np.stack([np.stack([zero, c, s], 1), np.stack([zero, -s, c], 1)], 1)
    share = (0.05 - 0.03 * points) / 18.0
    arms = np.sqrt(share[:, None] * np.array([11.0, 7.0]))  # of a unit mass along the beam

    def turned(q):
        """Axes of sections, the arms in them, at all points."""
        rise = jnp.einsum("cpn,n->pc", slopes[1:], q)
        tangents = jnp.concatenate([jnp.sqrt(1 - jnp.sum(rise**2, 1))[:, None], rise], 1)

        def carried(frame, both):
            one, two = both
            axis = jnp.cross(one, two)
            skewed = jnp.cross(axis[None], jnp.eye(3)).T
            frame = (jnp.eye(3) + skewed + skewed @ skewed / (1 + one @ two)) @ frame
            return frame, frame

        _, frames = jax.lax.scan(carried, jnp.eye(3), (tangents[:-1], tangents[1:]))
        frames = jnp.concatenate([jnp.eye(3)[None], frames])
        return jnp.einsum("pkc,pdc->pkd", arms[:, :, None] * sections, frames)

    def exact(q, v):
        r, rate = jax.jvp(turned, (q,), (v,))
        moving = rate + jnp.cross(hub.angular_velocity[None, None], r)
        return length * jnp.trapezoid(jnp.sum(moving**2, (1, 2)), points) / 2

    def ours(q, v):
        return equations.rotary.energy(q, v, hub.angular_velocity)

    assert_alike_to_second_order(ours, exact, q, v, rtol=1e-3)
    still = equations.undeformed.inertia - jb.Rotor(
        jb.Beam(2.0, 1e-9, 4e3, 11.0, 7.0), 0.4
    ).rigid_moments[2] * np.diag([0.0, 1.0, 1.0])
    spread = np.einsum(
        "pk,pkc,pkd,p->cd", arms**2, sections, sections, np.full(2001, length / 2000)
    )
    ends = [np.einsum("k,kc,kd->cd", arms[i] ** 2, sections[i], sections[i]) for i in (0, -1)]
    spread = spread - length / 4000 * sum(ends)
    np.testing.assert_allclose(still, np.trace(spread) * np.eye(3) - spread, rtol=1e-5, atol=1e-8)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("twist", "pitch"), [(None, None), (jb.Spanwise([0, 1], [0.6, -0.4]), 0.1)]
)
def test_what_it_takes_off_is_that_of_rods(twist, pitch):
    """Of a turning beam, whose rod has it by its own equations: some per cent of frequencies."""

    @jax.jit
    def frequencies(polar):
        beam = jb.Beam(2.0, 1.0, 1e8, 16.0, 1.0, twist, 1e5, polar)
        rotor = jb.Rotor(beam, 0.5, 0.2, pitch)
        models = jb.Hybrid(0, 14, 14), jb.SpatialRod(16)
        return [jb.modes(model, rotor, 4.0, 6).frequency for model in models]

    few, much = frequencies(1e-5), frequencies(0.02)
    ours, theirs = (np.asarray(a) - np.asarray(b) for a, b in zip(much, few, strict=True))
    np.testing.assert_allclose(ours, theirs, rtol=1e-3)
    assert np.max(np.abs(theirs / np.asarray(few[1]))) > 0.01


@pytest.mark.exhaustive
def test_force_and_moment_at_the_root_are_those_of_the_hub():
    """Of a run: equilibrium of all that is outboard, and momentum."""
    rotor = jb.Rotor(short(4e4, polar_inertia=0.3), hub_radius=0.4, pitch=0.3)
    motion = jb.SmoothSpinUp(2e-3, duration=1.0)
    loads = jb.Loads(gravity=[0.0, -1e-4, 2e-4])
    times = np.array([0.0, 0.5, 0.9])
    run = jb.simulate(jb.Hybrid(0, 4, 4), rotor, motion, times, loads=loads)
    force, moment = run.section_force([0.0])[:, 0], run.section_moment([0.0])[:, 0]
    twist, lag, lowered = moment.T
    about = np.stack([twist, -lowered, lag], 1) + np.cross([0.4, 0.0, 0.0], force)
    np.testing.assert_allclose(about[1:], -run.hub_torque[1:], rtol=2e-4)
