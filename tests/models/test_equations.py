"""Equations of motion against Lagrange's equations, by JAX, of energies stated independently."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import chebyshev

import jaxbeam as jb
from jaxbeam._numerics.linalg import dense
from jaxbeam._rotor.motion import skew
from tests.beams import AS_BUILT, SOFT_SPRINGS, TORSION, short
from tests.helpers import BUILT, DISCRETE, ELEMENTS, KINDS, name
from tests.models.states import lagrange, random_state
from tests.tiers import exhaustive, slow

BLADE = short(4e3, **TORSION)
SLENDER = short(4e3)  # without rotary inertia
ROTOR = jb.Rotor(BLADE, hub_radius=0.4, tip_mass=0.9)
BEAM_MODELS = [
    jb.Hybrid(3, 4, 3),
    jb.Hybrid(0, 4, 3),
    jb.Classical(3, 4, 3),
    jb.VonKarman(5, 3, 2),
    *ELEMENTS,
]
EVERY = [(m, ROTOR) for m in BEAM_MODELS] + [(m, SOFT_SPRINGS) for m in DISCRETE]
EVERY += BUILT


def tiered(model, rotor):
    """One of each kind is quick; rods in space have tests of their own."""
    is_quick = isinstance(model, jb.Hybrid if rotor is AS_BUILT else KINDS)
    return (model, rotor) if is_quick else slow(model, rotor)


CASES = [tiered(*case) for case in EVERY]


@pytest.mark.parametrize(("model", "rotor"), CASES, ids=name)
def test_equations_of_motion_follow_from_the_energies(model, rotor):
    planar = jb.models.Direction.FLAP not in model.directions
    hub, q, v = random_state(model, 1, planar)
    if isinstance(
        model, jb.papers.DiscreteLP
    ):  # linear: forces times s, theta products are left out
        q, v = q * 1e-9, v * 1e-9
    force = jnp.array([3.0, -2.0, 0.0 if planar else 1.5])

    @jax.jit
    def both(rotor, q, v):
        equations = model.equations(rotor)
        given = jnp.linalg.solve(dense(equations.mass), equations.force(hub, q, v, force))
        return given, lagrange(equations, hub, q, v, force)

    given, derived = both(rotor, q, v)
    np.testing.assert_allclose(given, derived, rtol=1e-9, atol=1e-9 * np.abs(derived).max())


@pytest.mark.parametrize(("model", "rotor"), CASES, ids=name)
def test_tangents_are_derivatives_of_the_force(model, rotor):
    hub, q, v = random_state(model, 2, jb.models.Direction.FLAP not in model.directions)
    force = jnp.array([3.0, -2.0, 0.0])

    @jax.jit
    def both(rotor, q, v):
        equations = model.equations(rotor)
        exact = jax.jacfwd(equations.force, (1, 2))(hub, q, v, force)
        given = [dense(a) for a in equations.tangents(hub, q, v, force)]
        return given, exact

    given, exact = both(rotor, q, v)
    for a, b in zip(given, exact, strict=True):
        np.testing.assert_allclose(a, -b, rtol=1e-11, atol=1e-12 * np.abs(b).max())


@pytest.mark.parametrize("seed", [0, exhaustive(1)])
@pytest.mark.parametrize("model", [slow(jb.Hybrid(3, 4, 3)), jb.Classical(3, 4, 3)], ids=name)
def test_yoo_equations_linearise_exact_kinematics(model, seed):
    """Y eqs. 18-20: dm = rho dx + m_t delta, u1 = s - int (u2'^2 + u3'^2) / 2, any 3-D motion;
    sections without rotary inertia."""
    rotor = jb.Rotor(SLENDER, hub_radius=0.4, tip_mass=0.9)
    x, w = np.polynomial.legendre.leggauss(40)
    xi, w = (1 + x) / 2, w / 2
    rho, length = SLENDER.mass_per_length, SLENDER.length
    radius, tip = rotor.hub_radius, rotor.tip_mass
    dm = jnp.append(rho * length * w, tip)
    at = np.append(xi, 1.0)
    # int_0^xi of u'^2 by a rule of its own on each interval [0, xi]
    inner = np.outer(at, xi)
    shapes = model.displacement(at, rotor)
    # Slopes by differentiating the interpolant, exact for polynomials of this degree.
    knots = np.cos(np.pi * (np.arange(12) + 0.5) / 12)
    values = np.moveaxis(np.asarray(model.displacement((1 + knots) / 2, rotor)), 1, 0).reshape(
        12, -1
    )
    coefficients = chebyshev.chebder(chebyshev.chebfit(knots, values, 11)) * 2 / float(length)
    slopes = chebyshev.chebval(2 * inner - 1, coefficients)
    slopes = np.moveaxis(slopes.reshape(3, -1, *inner.shape), 1, -1).swapaxes(0, 1)
    short = isinstance(model, jb.Hybrid)

    def place(q):
        u = jnp.einsum("cpn,n->pc", shapes, q)
        if short:
            bend = jnp.sum(jnp.einsum("acpn,n->acp", slopes[:, 1:], q) ** 2, 1)
            u = u.at[:, 0].add(-0.5 * jnp.sum(bend * w[None], 1) * at * length)
        return u.at[:, 0].add(radius + at * length)

    hub, _, _ = random_state(model, seed, False)
    spin, rate = hub.angular_velocity, hub.angular_velocity_rate

    def virtual_work(q, v, a):
        """-int (d place / dq) . acceleration dm, the inertia part of Kane's equations."""
        jac = jax.jacfwd(place)(q)
        rho, velocity = place(q), jac @ v
        curving = jax.jvp(lambda q: jax.jacfwd(place)(q) @ v, (q,), (v,))[1]
        acceleration = (
            hub.acceleration[None]
            + rho @ (skew(rate) + skew(spin) @ skew(spin)).T
            + 2 * velocity @ skew(spin).T
            + jac @ a
            + curving
        )
        return -jnp.einsum("pcn,pc,p->n", jac, acceleration, dm)

    zero = jnp.zeros(len(model.directions))
    equations = model.equations(rotor)
    load = virtual_work(zero, zero, zero)
    k, c, m = (-a for a in jax.jacfwd(virtual_work, (0, 1, 2))(zero, zero, zero))
    given_k, given_c = equations.tangents(hub, zero, zero, None)
    given_k = given_k - model.linear_stiffness(rotor, None)
    for given, exact in (
        (equations.force(hub, zero, zero, None), load),
        (given_k, k),
        (given_c, c),
        (equations.mass, m),
    ):
        np.testing.assert_allclose(given, exact, rtol=0, atol=1e-10 * np.abs(exact).max())
