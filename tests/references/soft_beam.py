"""Frequencies of uniform beams that tension holds, however soft they are, without the package.

Curvatures are Legendre polynomials on segments that halve towards both ends, 2^-20 of the length at
the root and 2^-14 at the tip; slopes and values are their integrals. Nondimensional as in
`power_series.py`, with the inertia of a body at the tip about its centre besides.
"""

import functools
import itertools
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.polynomial import legendre

_DEGREE, _POINTS = 5, 8
_TIMES, _BESIDE = 15, 7  # inverse iterations, of so many more vectors than are asked for


class _Tables(NamedTuple):
    mass: np.ndarray  # (n, n)
    tension: np.ndarray  # (3, n, n): by 1, 1 - x, (1 - x^2) / 2
    tip: np.ndarray  # (n,), values there
    tip_slope: np.ndarray


@functools.cache
def _tables() -> _Tables:
    near, middle = 2.0 ** np.arange(-20, -2), np.arange(0.25, 0.8, 0.125)
    edges = np.concatenate([[0.0], near, middle, 1 - 2.0 ** -np.arange(3.0, 15.0), [1.0]])
    edges = np.unique(edges)
    t, w = legendre.leggauss(_POINTS)
    widths = np.diff(edges)
    x = (edges[:-1, None] + widths[:, None] * (1 + t) / 2).ravel()
    weight = (widths[:, None] * w / 2).ravel()
    slopes, values, tip_slope, tip = [], [], [], []
    for start, end in itertools.pairwise(edges):
        h = end - start
        place = np.clip(2 * (x - start) / h - 1, -1, 1)
        beyond = np.maximum(x - end, 0.0)
        for k in range(_DEGREE + 1):
            curvature = np.eye(k + 1)[k] * np.sqrt((2 * k + 1) / h)
            slope = legendre.legint(curvature, lbnd=-1) * h / 2
            value = legendre.legint(slope, lbnd=-1) * h / 2
            last = legendre.legval(1.0, slope)
            slopes.append(legendre.legval(place, slope))
            values.append(legendre.legval(place, value) + last * beyond)
            tip_slope.append(last)
            tip.append(legendre.legval(1.0, value) + last * (1 - end))
    f, df = np.stack(values, 1), np.stack(slopes, 1)
    shapes = (np.ones_like(x), 1 - x, (1 - x**2) / 2)
    tension = [df.T @ ((weight * p)[:, None] * df) for p in shapes]
    mass = f.T @ (weight[:, None] * f)
    return _Tables(mass, np.stack(tension), np.array(tip), np.array(tip_slope))


def frequencies(
    gamma: float, hub: float = 0.0, tip: float = 0.0, plane: str = "in plane", count: int = 3,
    inertia: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Lowest frequencies over sqrt(EI / (rho L^4)), to 1e-10."""
    tables = _tables()
    pulls = gamma**2 * np.array([tip * (hub + 1), hub, 1.0])
    stiffness = np.eye(len(tables.mass)) + np.tensordot(pulls, tables.tension, 1)
    mass = tables.mass + tip * np.outer(tables.tip, tables.tip)
    turned = inertia * np.outer(tables.tip_slope, tables.tip_slope)
    stiffness += gamma**2 * (turned if plane == "flap" else -mass)
    mass = mass + turned
    factors = scipy.linalg.cho_factor(stiffness)
    v = np.random.default_rng(0).normal(size=(len(mass), count + _BESIDE))
    for _ in range(_TIMES):
        v, _ = np.linalg.qr(scipy.linalg.cho_solve(factors, mass @ v))
    inverse = scipy.linalg.eigh(v.T @ mass @ v, v.T @ stiffness @ v, eigvals_only=True)
    return inverse[::-1][:count] ** -0.5
