"""First guesses of the lowest modes, by Ritz problems of few functions, the same for all beams."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import chebyshev

from jaxbeam._models.modal.theories import Hybrid
from jaxbeam._numerics.band import congruent, full, largest, polished
from jaxbeam._programs.lanes import append_axes, sum_of_products
from jaxbeam._rotor.span import tension

DEGREE = 24  # number of polynomials that functions are combinations of


class Ritz(NamedTuple):
    """Integrals of m bending functions, the same for all beams, and first guesses of k modes."""

    stiffness: np.ndarray  # (m, m, 4): bending, tension by tip mass, hub radius and beam's mass
    # (m, m, 5): in bending that of the beam and of the tip mass; in the axial motion that follows
    # the terms without, in and in the square of the tip mass
    inertia: np.ndarray
    functions: np.ndarray  # (DEGREE, m): the functions as combinations of polynomials
    start: np.ndarray  # (m, k): modes of a typical beam as combinations of the functions

    def guess(
        self, stiffness: Sequence[Array], tip: Array, spin2: Array, drag: Array
    ) -> tuple[Float[Array, "k *lanes"], Float[Array, "m k *lanes"]]:
        """Guesses of frequencies and modes by `stiffness` weights of the four tables, tip mass,
        square of the speed and `drag` = 4 spin2 / axial stiffness, over units of the beam. Axial
        motion follows the Coriolis force quasi-statically, and adds `drag` times axial integrals
        to the inertia of bending."""
        lanes, one = tip.ndim, jnp.ones_like(tip)
        tables = append_axes(self.inertia, lanes)
        inertia = combined(tables, [one, tip, drag, drag * tip, drag * tip**2])
        centrifugal = combined(tables[:, :, :2], [-spin2, -spin2 * tip])
        k = combined(append_axes(self.stiffness, lanes), stiffness) + centrifugal
        omega = largest(congruent(k, inertia), len(self.start[0])) ** -0.5
        start = jnp.broadcast_to(append_axes(self.start, lanes), (*self.start.shape, *tip.shape))
        shifted = full(k)[:, :, None] - omega**2 * full(inertia)[:, :, None]
        return omega, polished(shifted, start.astype(tip.dtype))


def combined(tables: Any, weights: Sequence[Array]) -> Array:
    """The sum of p tables, the last axis of (..., p) before those of lanes, times p weights."""
    lanes = weights[0].ndim
    axis = tables.ndim - lanes - 1
    return sum_of_products(tables, jnp.stack(weights)[(None,) * axis], axis, lanes)


@functools.lru_cache(maxsize=8)
def bending(count: int) -> Ritz:
    """Functions for guesses of `count` bending modes: the proper orthogonal decomposition of modes
    of 72 beams of different speeds, hub radii and tip masses."""
    unit = Hybrid(12, DEGREE, 0).shape_integrals
    u, w = slice(0, 12), slice(12, None)
    mass, mixed, axial = unit.gram[w, w], unit.gram[w, u], unit.tip[u]
    end = np.outer(unit.tip[w], unit.tip[w])
    stiffness = np.stack([unit.elastic[1], *unit.tension], -1)[w, w]
    along = np.outer(mixed @ axial, unit.tip[w])
    inertia = [mass, end, mixed @ mixed.T, along + along.T, axial @ axial * end]
    modes = []
    for g in (0.0, 3.0, 6.0, 12.0, 24.0, 48.0):
        for hub in (0.0, 0.3, 1.0, 4.0):
            for tip in (0.0, 0.3, 2.0):
                k = stiffness @ np.array([1.0, *tension(g**2, hub, tip)])
                m = mass + tip * end
                modes.append(_modes(k - g**2 * m, m, count)[1])
    scaled = np.concatenate([v / np.linalg.norm(v, axis=0) for v in modes], 1)
    few = np.linalg.svd(scaled)[0][:, : 2 * ((count + 6) // 2)]

    def projected(tables: np.ndarray) -> np.ndarray:
        return np.einsum("ia,ijp,jb->abp", few, tables, few)

    return Ritz(projected(stiffness), projected(np.stack(inertia, -1)), few, few.T @ modes[17])


def _modes(k: np.ndarray, m: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    root = np.linalg.inv(np.linalg.cholesky(k))
    nu, v = np.linalg.eigh(root @ m @ root.T)
    return 1 / nu[: -count - 1 : -1], root.T @ v[:, : -count - 1 : -1]


class Axial(NamedTuple):
    """Axial modes of a beam at rest by its tip mass, as series of Chebyshev polynomials of
    t = m_t / (rho L + m_t)."""

    square: np.ndarray  # (p, k): series of mu = omega^2, that of mode 1 times 1 + m_t / (rho L)
    modes: np.ndarray  # (p, DEGREE, k): series of modes as combinations of polynomials

    def guess(
        self, values: Float[np.ndarray, "n d"], tip: Array
    ) -> tuple[Float[Array, "k *lanes"], Float[Array, "n k *lanes"]]:
        """Eigenvalues mu = omega^2 over EA / (rho L^2), and modes at places or in coordinates, for
        which `values` are those of the polynomials."""
        lanes, t = tip.ndim, 2 * tip / (1 + tip) - 1
        terms = [jnp.ones_like(t), t]
        while len(terms) < len(self.square):
            terms.append(2 * t * terms[-1] - terms[-2])
        shapes = np.moveaxis(values @ self.modes, 0, -1)
        square = np.moveaxis(self.square, 0, -1)
        mu = combined(append_axes(square, lanes), terms)
        mu = jnp.concatenate([mu[:1] / (1 + tip), mu[1:]])
        return mu, combined(append_axes(shapes, lanes), terms)


@functools.lru_cache(maxsize=8)
def axial(count: int, terms: int = 14) -> Axial:
    """Axial modes for guesses, `count` of them, interpolated over the tip mass by `terms` terms."""
    unit = Hybrid(DEGREE, 0, 0).shape_integrals
    t = chebyshev.chebpts1(terms)
    square, modes = [], []
    for tip in (1 + t) / (1 - t):
        mass = unit.gram + tip * np.outer(unit.tip, unit.tip)
        mu, v = _modes(unit.elastic[0], mass, count)
        square.append(np.append(mu[:1] * (1 + tip), mu[1:]))
        # Signs by the slope at the root, so that modes are smooth functions of t.
        modes.append(v * np.sign(v[:1]) / np.linalg.norm(v, axis=0))
    fit = np.linalg.inv(chebyshev.chebvander(t, terms - 1))
    return Axial(fit @ np.stack(square), np.einsum("pq,qnk->pnk", fit, np.stack(modes)))
