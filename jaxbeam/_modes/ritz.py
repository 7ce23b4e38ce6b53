"""Guesses of the lowest modes: a Ritz problem of few functions, which all beams share."""

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

DEGREE = 24  # polynomials in which functions are given


class Ritz(NamedTuple):
    """Tables of a few functions that all beams share, and where searches start from."""

    stiffness: np.ndarray  # (m, m, 4): bending, and tension by tip mass, hub radius and own mass
    inertia: np.ndarray  # (m, m, 5): own, tip, and by axial motion: own, mixed, tip
    functions: np.ndarray  # (DEGREE, m): the functions, in polynomials
    start: np.ndarray  # (m, k): modes of a beam in the middle of all, in these functions

    def guess(
        self, stiffness: Sequence[Array], tip: Array, spin2: Array, drag: Array
    ) -> tuple[Float[Array, "k *lanes"], Float[Array, "m k *lanes"]]:
        """Frequencies without axial inertia (axial motion follows the Coriolis force at once, by
        which bending drags along 4 spin2 / axial stiffness of it), and modes in these functions."""
        lanes, one = tip.ndim, jnp.ones_like(tip)
        own = append_axes(self.inertia, lanes)
        inertia = combined(own, [one, tip, drag, drag * tip, drag * tip**2])
        spun = combined(own[:, :, :2], [-spin2, -spin2 * tip])
        k = combined(append_axes(self.stiffness, lanes), stiffness) + spun
        omega = largest(congruent(k, inertia), len(self.start[0])) ** -0.5
        start = jnp.broadcast_to(append_axes(self.start, lanes), (*self.start.shape, *tip.shape))
        whole = full(k)[:, :, None] - omega**2 * full(inertia)[:, :, None]
        return omega, polished(whole, start.astype(tip.dtype))


def combined(shape_integrals: Any, parts: Sequence[Array]) -> Array:
    """Sum of tables (..., p, *lanes) times p numbers."""
    lanes = parts[0].ndim
    axis = shape_integrals.ndim - lanes - 1
    return sum_of_products(shape_integrals, jnp.stack(parts)[(None,) * axis], axis, lanes)


@functools.lru_cache(maxsize=8)
def bending(count: int) -> Ritz:
    """Functions for bending: proper orthogonal decomposition of the modes of 72 beams."""
    shape_integrals = Hybrid(12, DEGREE, 0).shape_integrals
    u, w = slice(0, 12), slice(12, None)
    mass, mixed, axial = (
        shape_integrals.gram[w, w],
        shape_integrals.gram[w, u],
        shape_integrals.tip[u],
    )
    end = np.outer(shape_integrals.tip[w], shape_integrals.tip[w])
    stiffness = np.stack([shape_integrals.elastic[1], *shape_integrals.tension], -1)[w, w]
    along = np.outer(mixed @ axial, shape_integrals.tip[w])
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

    def within(shape_integrals: np.ndarray) -> np.ndarray:
        return np.einsum("ia,ijp,jb->abp", few, shape_integrals, few)

    return Ritz(within(stiffness), within(np.stack(inertia, -1)), few, few.T @ modes[17])


def _modes(k: np.ndarray, m: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    root = np.linalg.inv(np.linalg.cholesky(k))
    nu, v = np.linalg.eigh(root @ m @ root.T)
    return 1 / nu[: -count - 1 : -1], root.T @ v[:, : -count - 1 : -1]


class Axial(NamedTuple):
    """Modes of motion along a beam at rest: series in the tip mass, by Chebyshev polynomials of
    t = m_t / (rho L + m_t)."""

    square: np.ndarray  # (p, k): of mu, that of the first times 1 + m_t / (rho L)
    modes: np.ndarray  # (p, DEGREE, k): of coefficients of polynomials

    def guess(
        self, values: Float[np.ndarray, "n d"], tip: Array
    ) -> tuple[Float[Array, "k *lanes"], Float[Array, "n k *lanes"]]:
        """Values mu = omega^2 over EA / (rho L^2), and the modes by the values of polynomials."""
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
    """The axial modes, interpolated over the tip mass."""
    shape_integrals = Hybrid(DEGREE, 0, 0).shape_integrals
    t = chebyshev.chebpts1(terms)
    square, modes = [], []
    for tip in (1 + t) / (1 - t):
        mass = shape_integrals.gram + tip * np.outer(shape_integrals.tip, shape_integrals.tip)
        mu, v = _modes(shape_integrals.elastic[0], mass, count)
        square.append(np.append(mu[:1] * (1 + tip), mu[1:]))
        # All modes move the root the same way, which makes them smooth in t.
        modes.append(v * np.sign(v[:1]) / np.linalg.norm(v, axis=0))
    fit = np.linalg.inv(chebyshev.chebvander(t, terms - 1))
    return Axial(fit @ np.stack(square), np.einsum("pq,qnk->pnk", fit, np.stack(modes)))
