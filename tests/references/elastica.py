"""The elastica that stretches: a geometrically exact beam in a plane, at rest and in rotation.

With the angle phi(x) of the tangent t and the strain eps(x), r' = (1 + eps) t and
U = int EA eps^2 + EI phi'^2 dx / 2; it does not shear.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import legendre
from scipy.integrate import solve_ivp
from scipy.optimize import brentq


class Beam(NamedTuple):
    """In any consistent units, clamped on a hub; mass is per length, at the tip a point mass."""

    length: float
    mass: float
    axial: float
    bending: float
    hub: float = 0.0
    tip_mass: float = 0.0


def tip_at_rest(force, stiffness: float) -> np.ndarray:
    """Displacement (2,) of the tip of a beam with L = EI = 1 and EA = `stiffness` that does not
    rotate, under a dead force at its end, by shooting: eps = F.t / EA, M = phi',
    M' = -(1 + eps) t x F."""
    fx, fy = force

    def rates(x, state):
        phi, moment, _, _ = state
        t = np.cos(phi), np.sin(phi)
        stretch = 1 + (fx * t[0] + fy * t[1]) / stiffness
        return [moment, -stretch * (t[0] * fy - t[1] * fx), stretch * t[0], stretch * t[1]]

    def end(moment):
        start = [0.0, moment, 0.0, 0.0]
        return solve_ivp(rates, (0, 1), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]

    moment = brentq(lambda moment: end(moment)[1], 0.0, 1.2 * abs(fy) + abs(fx), xtol=1e-13)
    return end(moment)[2:] - np.array([1.0, 0.0])


def tip_history(
    beam: Beam, speed, times, n_angle: int = 7, n_strain: int = 3, rtol: float = 1e-9
) -> np.ndarray:
    """Axial and transverse displacement of the tip at `times`, from rest; speed(t) in rad/s.

    Unknowns are phi and eps, in shifted Legendre polynomials. Equations of motion come from the
    Lagrangian by JAX and are integrated by SciPy's Radau. Spectral in x: six or eight functions are
    converged.
    """
    length, rho, ea, ei, hub, tip = beam
    node, weight = legendre.leggauss(24)
    w = weight / 2
    # Antiderivatives from 0, at the nodes and at 1: int_0^x f = A f, by Legendre interpolation.
    values = np.linalg.inv(legendre.legvander(node, 23))
    primitive = legendre.legint(values, lbnd=-1) / 2
    a = legendre.legval(np.append(node, 1.0), primitive).T
    curvature = legendre.legvander(node, n_angle - 1)  # of phi', per length
    angle = (a @ curvature)[:-1]
    stretch = legendre.legvander(node, n_strain - 1) * 1e-3
    dm = np.append(rho * length * w, tip)

    def place(q):
        phi, eps = angle @ q[:n_angle], stretch @ q[n_angle:]
        slope = jnp.stack([(1 + eps) * jnp.cos(phi), (1 + eps) * jnp.sin(phi)], 1)
        return length * (a @ slope) + jnp.array([[hub, 0.0]])

    def lagrangian(q, v, t):
        r, rate = jax.jvp(place, (q,), (v,))
        spin = speed(t)
        moving = rate + spin * jnp.stack([-r[:, 1], r[:, 0]], 1)
        kinetic = jnp.sum(dm[:, None] * moving**2) / 2
        bend = ei / length * jnp.sum(w * (curvature @ q[:n_angle]) ** 2)
        return kinetic - bend / 2 - ea * length * jnp.sum(w * (stretch @ q[n_angle:]) ** 2) / 2

    n = n_angle + n_strain

    def rate(t, y):
        q, v = y[:n], y[n:]
        momentum = jax.grad(lagrangian, 1)
        mass = jax.jacfwd(momentum, 1)(q, v, t)
        drift = jax.jvp(lambda q, t: momentum(q, v, t), (q, t), (v, 1.0))[1]
        force = jax.grad(lagrangian)(q, v, t) - drift
        return jnp.concatenate([v, jnp.linalg.solve(mass, force)])

    function, jacobian = jax.jit(rate), jax.jit(jax.jacfwd(rate, 1))
    done = solve_ivp(
        lambda t, y: np.asarray(function(t, y)), (times[0], times[-1]), np.zeros(2 * n), "Radau",
        np.asarray(times), jac=lambda t, y: np.asarray(jacobian(t, y)), rtol=rtol, atol=rtol,
    )  # fmt: skip
    assert done.success
    ends = jax.vmap(lambda y: place(y[:n])[-1])(jnp.asarray(done.y.T))
    return np.asarray(ends) - np.array([hub + length, 0.0])
