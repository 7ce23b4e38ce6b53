"""Guesses of the lowest frequencies: a Ritz problem of few functions, which all beams share."""

import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.basis import Polynomials
from jaxbeam._numerics.band import congruent, full, largest, polished
from jaxbeam._numerics.kernel import beside, contract
from jaxbeam._rotor.beam import Rotor
from jaxbeam._types import Scalar

PLAIN = Polynomials()


class Numbers(NamedTuple):
    """What the frequencies over sqrt(EI / (rho L^4)) depend on."""

    speed: Scalar  # over sqrt(EI / (rho L^4))
    hub: Scalar  # R / L
    tip: Scalar  # m_t / (rho L)
    softness: Scalar  # EI / (EA L^2)


def numbers_of(rotor: Rotor, speed: Scalar) -> Numbers:
    beam = rotor.beam
    return Numbers(
        speed / beam.frequency_scale, rotor.hub_radius / beam.length, rotor.tip_mass / beam.mass,
        beam.slenderness**-2,
    )  # fmt: skip


class Ritz(NamedTuple):
    """Tables of a few functions that all beams share, and where searches start from."""

    stiffness: np.ndarray  # (m, m, 4): bending, and tension by tip mass, hub radius and own mass
    inertia: np.ndarray  # (m, m, 5): own, tip, and by axial motion: own, mixed, tip
    functions: np.ndarray  # (24, m): the functions, in polynomials
    start: np.ndarray  # (m, k): modes of a beam in the middle of all, in these functions

    def guess(self, numbers: Numbers) -> tuple[Float[Array, "k *lanes"], Float[Array, "m k *l"]]:
        """Frequencies without axial inertia (axial motion follows the Coriolis force at once), and
        modes in these functions."""
        g, hub, tip, softness = numbers
        lanes, one = g.ndim, jnp.ones_like(g)
        drag = 4 * g**2 * softness
        rigid = [g**2 * tip * (1 + hub), g**2 * hub, g**2]
        parts = [one, tip * one, drag, drag * tip, drag * tip**2]
        own = beside(self.inertia, lanes)
        inertia = combined(own, parts)
        spun = combined(own[:, :, :2], [-(g**2), -(g**2) * tip])
        stiffness = combined(beside(self.stiffness, lanes), [one, *rigid]) + spun
        omega = largest(congruent(stiffness, inertia), self.start.shape[1]) ** -0.5
        start = jnp.broadcast_to(beside(self.start, lanes), (*self.start.shape, *g.shape))
        whole = full(stiffness)[:, :, None] - omega**2 * full(inertia)[:, :, None]
        return omega, polished(whole, start.astype(g.dtype))


def combined(tables: Any, parts: list[Array]) -> Array:
    """Sum of tables (..., p, *lanes) times p numbers."""
    lanes = parts[0].ndim
    axis = tables.ndim - lanes - 1
    return contract(tables, jnp.stack(parts)[(None,) * axis], axis, lanes)


class Integrals(NamedTuple):
    """Of products of n bending (w) and m stretch functions (u)."""

    tip: np.ndarray  # slopes of w under a constant tension
    hub: np.ndarray  # under 1 - xi
    own: np.ndarray  # under (1 - xi^2) / 2
    mass: np.ndarray  # values of w
    axial: np.ndarray  # values of u
    mixed: np.ndarray  # values of w and u
    end: np.ndarray  # w at the tip
    axial_end: np.ndarray  # u at the tip


@functools.lru_cache(maxsize=16)
def integrals(n: int, m: int) -> Integrals:
    xi, weight = np.polynomial.legendre.leggauss(max(n, m) + 5)
    xi, weight, one = (1 + xi) / 2, weight[:, None] / 2, np.ones(1)
    w, u = PLAIN.bending(n, xi), PLAIN.stretch(max(m, 1), xi).value[:, :m]
    x = xi[:, None]
    return Integrals(
        tip=w.slope.T @ (weight * w.slope),
        hub=w.slope.T @ (weight * (1 - x) * w.slope),
        own=w.slope.T @ (weight * (1 - x**2) / 2 * w.slope),
        mass=w.value.T @ (weight * w.value),
        axial=u.T @ (weight * u),
        mixed=w.value.T @ (weight * u),
        end=PLAIN.bending(n, one).value[0],
        axial_end=PLAIN.stretch(max(m, 1), one).value[0, :m],
    )


@functools.lru_cache(maxsize=8)
def ritz_problem(count: int) -> Ritz:
    """Proper orthogonal decomposition of the modes of 72 beams."""
    n, size = 24, 2 * ((count + 6) // 2)
    a = integrals(n, 12)
    end = np.outer(a.end, a.end)
    stiffness = np.stack([np.eye(n), a.tip, a.hub, a.own], -1)
    along = np.outer(a.mixed @ a.axial_end, a.end)
    inertia = [a.mass, end, a.mixed @ a.mixed.T, along + along.T, a.axial_end @ a.axial_end * end]
    modes = []
    for g in (0.0, 3.0, 6.0, 12.0, 24.0, 48.0):
        for hub in (0.0, 0.3, 1.0, 4.0):
            for tip in (0.0, 0.3, 2.0):
                tension = g**2 * np.array([tip * (1 + hub), hub, 1.0])
                k = stiffness @ np.append(1.0, tension) - g**2 * (a.mass + tip * end)
                root = np.linalg.inv(np.linalg.cholesky(k))
                _, v = np.linalg.eigh(root @ (a.mass + tip * end) @ root.T)
                modes.append(root.T @ v[:, : -count - 1 : -1])
    scaled = np.concatenate([v / np.linalg.norm(v, axis=0) for v in modes], 1)
    few = np.linalg.svd(scaled)[0][:, :size]

    def within(tables: np.ndarray) -> np.ndarray:
        return np.einsum("ia,ijp,jb->abp", few, tables, few)

    return Ritz(within(stiffness), within(np.stack(inertia, -1)), few, few.T @ modes[17])
