"""States of motion, and what Lagrange's equations say of them."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._rotor.motion import Hub


def random_state(model, seed, planar):
    """Hub motion with random velocities and rates, coordinates, rates; no symmetry left."""
    rng = np.random.default_rng(seed)
    flat = np.array([[1, 1, 0], [0, 0, 1], [1, 1, 0], [0, 0, 1], [1, 1, 0]])
    hub = rng.normal(size=(5, 3)) * (flat if planar else 1)
    q, v = 0.1 * rng.normal(size=(2, len(model.directions)))
    return Hub(*jnp.asarray(hub)), jnp.asarray(q), jnp.asarray(v)


def lagrange(equations, hub, q, v, tip_force):
    """Generalised acceleration from T, U and the work of external forces alone."""

    def kinetic(q, v, t):
        along = (
            hub.velocity + t * hub.velocity_rate,
            hub.angular_velocity + t * hub.angular_velocity_rate,
        )
        return equations.kinetic_energy(q, v, *along)

    # The rigid part of T does not depend on q, v; that which the hub does to int u dm does.
    t = jnp.zeros(())
    momentum = jax.grad(kinetic, 1)
    mass = jax.jacfwd(momentum, 1)(q, v, t)
    drift = jax.jvp(lambda q, t: momentum(q, v, t), (q, t), (v, jnp.ones(())))[1]
    work = jax.jacfwd(equations.first_moment)(q).T @ hub.gravity
    work = work + jax.jacfwd(equations.tip)(q).T @ tip_force
    elastic = jax.grad(equations.strain_energy)(q) + equations.nonconservative_force(q)
    return jnp.linalg.solve(mass, jax.grad(kinetic)(q, v, t) - drift - elastic + work)


def _orders(energy, q, v):
    """Parts of an energy of first and of second order, but for what is of third and fourth."""
    there, back, still = energy(q, v), energy(-q, -v), energy(0 * q, 0 * v)
    return jnp.stack([(there - back) / 2, (there + back) / 2 - still])


def assert_alike_to_second_order(ours, exact, q, v, rtol):
    """Two energies of small coordinates and rates, and of either alone."""
    both = jax.jit(lambda q, v: [_orders(energy, q, v) for energy in (ours, exact)])
    q, v = 1e-3 * q, 1e-3 * v
    for at in ((q, v), (0 * q, v), (q, 0 * v)):
        np.testing.assert_allclose(*both(*at), rtol=rtol)
