"""What elements in space say of a state in which nothing is straight: one statement of each kind,
in one program."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import CubicHermiteSpline

import jaxbeam as jb
from jaxbeam._models.space.frames import axes
from tests.beams import TORSION as TWISTS
from tests.beams import short
from tests.models.states import random_state

LENGTH, MASS, POLAR, TIP, TIP_POLAR, HUB, CONE, PITCH = 2.0, 1.3, 0.03, 0.3, 0.06, 0.4, 0.3, 0.4
AXIAL, LAG, FLAP, TORSION = 40.0, 14.0, 8.0, 6.0
STEP = 1e-4


# All that elements in space know but tables, which take long to compile.
EQUIPPED = jb.Rotor(
    short(4e3, **TWISTS), 0.4, precone=0.3, pitch=0.2,
    root_springs=jb.RootSprings(in_plane=40.0, flap=25.0),
    tip_body=jb.TipBody(0.3, offset=0.1, inertia=0.02, axial_inertia=0.05),
)  # fmt: skip


@pytest.mark.slow
def test_energies_are_those_of_strains_and_of_sections_that_spin_about_the_tangent():
    """Of one element. Strains and curvatures are seen from the turned section, twist is how fast
    that turns; small motion has the mass of the axis, and the inertia of a spin which is known at
    the ends, by itself and by its slope: by differences, of axes that `torsion` turns. What is in
    a cone has its moments of mass in axes of the hub."""
    free = jb.RootSprings(in_plane=0.0, flap=0.0)  # so that no tangent is the first axis
    model = jb.SpatialANCF(1).suited(dataclasses.replace(EQUIPPED, root_springs=free))
    q, v = 0.1 * np.random.default_rng(4).normal(size=(2, len(model.directions)))
    gauss, weight = (1 + leggauss(3)[0]) / 2, leggauss(3)[1] / 2
    fine, by_fine = (1 + leggauss(6)[0]) / 2, leggauss(6)[1] / 2
    around = np.concatenate([at + STEP * np.array([-2, -1, 0, 1, 2]) for at in (0.0, *gauss, 1.0)])

    @jax.jit
    def seen(q, v, pitch):
        beam = jb.Beam(
            LENGTH, MASS, AXIAL, LAG, FLAP, torsional_stiffness=TORSION, polar_inertia=POLAR
        )
        body = jb.TipBody(TIP, axial_inertia=TIP_POLAR)
        turned = dict(pitch=pitch, precone=CONE, root_springs=free)
        equations = model.equations(jb.Rotor(beam, HUB, tip_body=body, **turned))
        own = model.equations(jb.Rotor(beam, HUB, **turned))

        def sections(q):
            r = equations.gradient(q, around) + np.eye(3)[:, :1]
            return axes(r / jnp.linalg.norm(r, axis=0)[None], equations.torsion(q, around))

        strains = own.strain(q, np.array([0, 0.5, 1])), own.curvature(q, gauss)
        displaced = jax.jvp(lambda q: own.displacement(q, np.append(fine, 1.0)), (q,), (v,))
        moments = equations.first_moment(q), equations.undeformed
        squares = v @ (equations.mass_about(q) @ v), own.strain_energy(q)
        return jax.jvp(sections, (q,), (v,)), strains, displaced, squares, moments

    found = jax.tree.map(np.asarray, seen(q, v, PITCH))
    (now, rate), (strain, curvature), (apart, moved), (square, energy), (moment, rigid) = found
    spin = np.sum(rate[1] * now[2], 0).reshape(5, 5)  # t.w = d_2'.d_3
    slope = (8 * (spin[:, 3] - spin[:, 1]) - (spin[:, 4] - spin[:, 0])) / (12 * STEP)
    about = CubicHermiteSpline([0, 1], spin[[0, 4], 2], slope[[0, 4]])
    exact = by_fine @ (
        MASS * LENGTH * np.sum(moved[:-1] ** 2, 1) + POLAR * LENGTH * about(fine) ** 2
    )
    exact = exact + TIP * moved[-1] @ moved[-1] + TIP_POLAR * about(1.0) ** 2
    np.testing.assert_allclose(square, exact, rtol=1e-9)

    dm = np.append(MASS * LENGTH * by_fine, TIP)
    out = np.array([np.cos(CONE), 0, np.sin(CONE)])
    place = HUB * np.eye(3)[0] + LENGTH * np.append(fine, 1.0)[:, None] * out
    second = np.einsum("p,pi,pj->ij", dm, place, place)
    inertia = np.trace(second) * np.eye(3) - second + TIP_POLAR * np.outer(out, out)
    whole = dm.sum(), dm @ place, inertia, place[-1]
    for a, b in zip((moment, *rigid), (dm @ apart, *whole), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)

    frames = now.reshape(3, 3, 5, 5)
    ahead = np.einsum("k,rcpk->rcp", [1, -8, 0, 8, -1], frames) / (12 * STEP * LENGTH)
    twist = np.sum(ahead[1] * frames[2, :, :, 2], 0)[1:4]
    cos, sin = np.cos(PITCH), np.sin(PITCH)
    lag, flap = curvature @ [cos, sin], curvature @ [-sin, cos]
    bends = weight @ (LAG * lag**2 + FLAP * flap**2 + TORSION * twist**2)
    stretched = AXIAL * np.array([1, 4, 1]) / 6 @ strain**2
    np.testing.assert_allclose(energy, LENGTH * (bends + stretched) / 2, rtol=1e-9)
    bent = np.stack([np.sum(ahead[0] * frames[i, :, :, 2], 0)[1:4] for i in (1, 2)], 1)
    np.testing.assert_allclose(curvature, bent, rtol=0, atol=1e-8)


def rate(function, h=3e-3):
    """The derivative at zero, by differences: what is differentiated by JAX compiles longer."""
    weights = {1: 45, 2: -9, 3: 1}
    return sum(w * (function(k * h) - function(-k * h)) for k, w in weights.items()) / (60 * h)


@pytest.mark.slow
def test_equations_follow_from_energies_and_tangents_from_forces():
    """Of a damped beam on springs in a cone that bears a body, in one direction w: Lagrange's
    equations, w.force = w.(T - U + work)_q - d/dt w.T_q', T being quadratic in q'."""
    model = jb.SpatialANCF(1).suited(EQUIPPED)
    hub, q, v = random_state(model, 1, False)
    w, other = np.random.default_rng(2).normal(size=(2, len(q)))
    dead = jnp.array([3.0, -2.0, 1.5])

    @jax.jit
    def seen(rotor, q, v, velocity, spin):
        equations = model.equations(rotor)
        potential = dead @ equations.tip(q) + hub.gravity @ equations.first_moment(q)
        k, c = equations.tangents(hub, q, v, dead)
        return (
            equations.kinetic_energy(q, v, velocity, spin), equations.strain_energy(q), potential,
            equations.force(hub, q, v, dead), -(k @ w + c @ other), equations.viscous_force(q, v),
            equations.mass @ w,
        )  # fmt: skip

    def at(q, v, t=0.0):
        velocity = hub.velocity + t * hub.velocity_rate
        spin = hub.angular_velocity + t * hub.angular_velocity_rate
        return seen(EQUIPPED, q, v, velocity, spin)

    def momentum(t):
        return (at(q + t * v, v + w, t)[0] - at(q + t * v, v - w, t)[0]) / 2

    def lagrangian(t):
        kinetic, strain, potential, *_ = at(q + t * w, v)
        return kinetic - strain + potential

    *_, force, tangent, _, inertia = at(q, v)
    np.testing.assert_allclose(w @ force, rate(lagrangian) - rate(momentum), rtol=1e-9)
    square = at(q, w)[0] + at(q, -w)[0] - 2 * at(q, 0 * w)[0]
    np.testing.assert_allclose(w @ inertia, square, rtol=1e-10)
    change = rate(lambda t: at(q + t * w, v + t * other)[3])
    np.testing.assert_allclose(tangent, change, rtol=0, atol=1e-8 * np.abs(change).max())
    # Turned rigidly about its root, in plane, it strains that spring alone.
    turned = (
        1e-4 * EQUIPPED.beam.length * (np.array(model.directions) == jb.models.Direction.IN_PLANE)
    )
    np.testing.assert_allclose(at(turned, 0 * v)[1], 40.0 * 1e-8 / 2, rtol=1e-4)
    # Undeformed, rates of strain do twice what the energy of such strains is.
    small = 1e-4 * w
    energy = at(small, v)[1] + at(-small, v)[1]
    np.testing.assert_allclose(small @ at(0 * q, small)[5], energy, rtol=1e-5)
