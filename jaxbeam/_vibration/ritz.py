"""Guesses of the lowest frequencies: a Ritz problem of few functions, which all beams share."""

import functools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.modal import Hybrid
from jaxbeam._numerics.band import congruent, full, largest, polished
from jaxbeam._numerics.lanes import beside, contract
from jaxbeam._rotor.beam import Rotor, tension
from jaxbeam._types import Number

BENDING = 24  # polynomials in which the few functions are given


class Numbers(NamedTuple):
    """What the frequencies over sqrt(EI / (rho L^4)) depend on."""

    speed: Number  # over sqrt(EI / (rho L^4))
    hub: Number  # R / L
    tip: Number  # m_t / (rho L)
    softness: Number  # EI / (EA L^2)


def numbers_of(rotor: Rotor, speed: Number) -> Numbers:
    beam = rotor.beam
    return Numbers(
        speed / beam.frequency_scale, rotor.hub_radius / beam.length, rotor.tip_mass / beam.mass,
        beam.slenderness**-2,
    )  # fmt: skip


class Ritz(NamedTuple):
    """Tables of a few functions that all beams share, and where searches start from."""

    stiffness: np.ndarray  # (m, m, 4): bending, and tension by tip mass, hub radius and own mass
    inertia: np.ndarray  # (m, m, 5): own, tip, and by axial motion: own, mixed, tip
    functions: np.ndarray  # (BENDING, m): the functions, in polynomials
    start: np.ndarray  # (m, k): modes of a beam in the middle of all, in these functions

    def guess(
        self, numbers: Numbers
    ) -> tuple[Float[Array, "k *lanes"], Float[Array, "m k *lanes"]]:
        """Frequencies without axial inertia (axial motion follows the Coriolis force at once), and
        modes in these functions."""
        g, hub, tip, softness = numbers
        lanes, one = g.ndim, jnp.ones_like(g)
        drag = 4 * g**2 * softness
        parts = [one, tip * one, drag, drag * tip, drag * tip**2]
        own = beside(self.inertia, lanes)
        inertia = combined(own, parts)
        spun = combined(own[:, :, :2], [-(g**2), -(g**2) * tip])
        stiffness = combined(beside(self.stiffness, lanes), [one, *tension(g**2, hub, tip)]) + spun
        omega = largest(congruent(stiffness, inertia), self.start.shape[1]) ** -0.5
        start = jnp.broadcast_to(beside(self.start, lanes), (*self.start.shape, *g.shape))
        whole = full(stiffness)[:, :, None] - omega**2 * full(inertia)[:, :, None]
        return omega, polished(whole, start.astype(g.dtype))


def combined(tables: Any, parts: list[Array]) -> Array:
    """Sum of tables (..., p, *lanes) times p numbers."""
    lanes = parts[0].ndim
    axis = tables.ndim - lanes - 1
    return contract(tables, jnp.stack(parts)[(None,) * axis], axis, lanes)


@functools.lru_cache(maxsize=8)
def ritz_problem(count: int) -> Ritz:
    """Proper orthogonal decomposition of the modes of 72 beams."""
    size = 2 * ((count + 6) // 2)
    tables = Hybrid(12, BENDING, 0).tables
    u, w = slice(0, 12), slice(12, None)
    mass, mixed, axial = tables.gram[w, w], tables.gram[w, u], tables.tip[u]
    end = np.outer(tables.tip[w], tables.tip[w])
    stiffness = np.stack([tables.elastic[1], *tables.tension], -1)[w, w]
    along = np.outer(mixed @ axial, tables.tip[w])
    inertia = [mass, end, mixed @ mixed.T, along + along.T, axial @ axial * end]
    modes = []
    for g in (0.0, 3.0, 6.0, 12.0, 24.0, 48.0):
        for hub in (0.0, 0.3, 1.0, 4.0):
            for tip in (0.0, 0.3, 2.0):
                k = stiffness @ np.array([1.0, *tension(g**2, hub, tip)])
                m = mass + tip * end
                root = np.linalg.inv(np.linalg.cholesky(k - g**2 * m))
                _, v = np.linalg.eigh(root @ m @ root.T)
                modes.append(root.T @ v[:, : -count - 1 : -1])
    scaled = np.concatenate([v / np.linalg.norm(v, axis=0) for v in modes], 1)
    few = np.linalg.svd(scaled)[0][:, :size]

    def within(tables: np.ndarray) -> np.ndarray:
        return np.einsum("ia,ijp,jb->abp", few, tables, few)

    return Ritz(within(stiffness), within(np.stack(inertia, -1)), few, few.T @ modes[17])
