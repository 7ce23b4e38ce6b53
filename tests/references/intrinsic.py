"""Frequencies of a rod of full sections about steady rotation, by the intrinsic equations of D. H.
Hodges (International Journal of Solids and Structures 26, 1990), without displacements, rotations
or elements, and without the package.

Unknowns along s are velocities (V, W) and forces (F, M) in axes that turn with the sections from
those of the undeformed rod, whose tangent is t:

    eps_t = V' + kap x V + (t + eps) x W,            kap_t = W' + kap x W,
    p_t = F' + kap x F - W x p,   h_t = M' + kap x M + (t + eps) x F - W x h - V x p,

(eps, kap) = C^-1 (F, M), (p, h) = m (V, W). At the root (V, W) are those of the hub, at the tip
(F, M) is zero. The rod goes from x = 0 to 1 along a curve whose arc length has the slope `pace`.

Derivatives of unknowns are polynomials through Gauss points, where the equations hold; unknowns are
their integrals from the end at which they are given, so that the errors fall exponentially and the
lowest frequencies are those that rounding spares. Newton's method finds the steady state.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

_LOAD_STEPS = 4
_CHANGES = 30


class Rod(NamedTuple):
    """By x from 0 to 1, in axes of the undeformed rod; sixes in these axes, too."""

    place: Callable[[float], np.ndarray]  # from the axis of rotation
    slope: Callable[[float], np.ndarray]  # its derivative
    stiffness: Callable[[float], np.ndarray]
    inertia: Callable[[float], np.ndarray]


class _Points(NamedTuple):
    """What the equations need at Gauss points."""

    unknowns: np.ndarray  # (n, 12, n, 12), from derivatives
    pace: np.ndarray  # (n, 1, 1)
    tangent: np.ndarray  # (n, 3)
    strains: np.ndarray  # (n, 6, 12), from unknowns
    momenta: np.ndarray  # (n, 6, 12), the same
    root: np.ndarray  # (12,), unknowns where derivatives are zero, for a speed of one


def _across(a: np.ndarray) -> np.ndarray:
    """The matrices (n, 3, 3) of b -> a x b."""
    return np.cross(np.eye(3)[None], a[:, None]).swapaxes(1, 2) * -1.0


def _points(rod: Rod, axis: np.ndarray, count: int) -> _Points:
    at = legendre.leggauss(count)[0]
    through = np.linalg.inv(legendre.legvander(at, count - 1))
    whole = legendre.legint(np.eye(count), axis=1, lbnd=-1) / 2
    integral = legendre.legvander(at, count) @ whole.T @ through
    total = legendre.legvander(np.ones(1), count) @ whole.T @ through
    unknowns = np.zeros((count, 12, count, 12))
    for way in range(12):
        unknowns[:, way, :, way] = integral - (0 if way < 6 else total)
    x = (1 + at) / 2
    slope = np.stack([rod.slope(one) for one in x])
    pace = np.linalg.norm(slope, axis=1)[:, None]
    strains, momenta = np.zeros((2, count, 6, 12))
    strains[:, :, 6:] = np.linalg.inv(np.stack([rod.stiffness(one) for one in x]))
    momenta[:, :, :6] = np.stack([rod.inertia(one) for one in x])
    hub = np.concatenate([np.cross(axis, rod.place(0.0)), axis, np.zeros(6)])
    return _Points(unknowns, pace[:, :, None], slope / pace, strains, momenta, hub)


def spatial(points: _Points, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What stands beside V', W', F', M' in the equations, of unknowns (n, 12), and its derivative
    by them (n, 12, 12)."""
    strain, momentum = points.strains, points.momenta
    eps, kap = np.split(np.einsum("nij,nj->ni", strain, f), 2, 1)
    p, h = np.split(np.einsum("nij,nj->ni", momentum, f), 2, 1)
    v, w, force, moment = np.split(f, 4, 1)
    along = points.tangent + eps
    of_v, of_w, of_f, of_m = (np.eye(12)[None, 3 * k : 3 * k + 3] for k in range(4))
    of_eps, of_kap = strain[:, :3], strain[:, 3:]
    of_p, of_h = momentum[:, :3], momentum[:, 3:]
    terms = [  # rows, sign, and the factors of a product, each with its derivative
        (0, 1, (kap, of_kap), (v, of_v)), (0, 1, (along, of_eps), (w, of_w)),
        (1, 1, (kap, of_kap), (w, of_w)),
        (2, 1, (kap, of_kap), (force, of_f)), (2, -1, (w, of_w), (p, of_p)),
        (3, 1, (kap, of_kap), (moment, of_m)), (3, 1, (along, of_eps), (force, of_f)),
        (3, -1, (w, of_w), (h, of_h)), (3, -1, (v, of_v), (p, of_p)),
    ]  # fmt: skip
    value, slope = np.zeros_like(f), np.zeros((len(f), 12, 12))
    for row, sign, (a, by_a), (b, by_b) in terms:
        own = slice(3 * row, 3 * row + 3)
        value[:, own] += sign * np.cross(a, b)
        slope[:, own] += sign * (_across(a) @ by_b - _across(b) @ by_a)
    return value, slope


def _tangent(points: _Points, slope: np.ndarray) -> np.ndarray:
    """A matrix by derivatives of unknowns, from one by unknowns at points."""
    size = points.unknowns.shape[0] * 12
    return np.einsum("nij,njmk->nimk", points.pace * slope, points.unknowns).reshape(size, size)


def frequencies(
    rod: Rod, speed: float, count: int, points: int = 24, axis: tuple[float, ...] = (0.0, 0.0, 1.0)
) -> np.ndarray:
    """So many eigenvalues with positive imaginary parts, the lowest ones, in order: frequencies are
    the imaginary parts, and the real parts would be zero."""
    at = _points(rod, np.asarray(axis, float), points)
    rates = np.zeros((points, 12))
    for share in np.linspace(0, 1, _LOAD_STEPS + 1)[1:]:
        for _ in range(_CHANGES):
            unknowns = share * speed * at.root + np.tensordot(at.unknowns, rates)
            value, slope = spatial(at, unknowns)
            out = rates + at.pace[:, 0] * value
            whole = np.eye(12 * points) + _tangent(at, slope)
            change = np.linalg.solve(whole, out.ravel()).reshape(rates.shape)
            rates = rates - change
            if np.abs(change).max() < 1e-12 * np.abs(rates).max():
                break
    moving = _tangent(at, np.concatenate([at.strains, at.momenta], 1))
    values = 1 / np.linalg.eigvals(np.linalg.solve(whole, moving))
    values = values[values.imag > 0]
    return values[np.argsort(np.abs(values))][:count]
