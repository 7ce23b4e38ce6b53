"""Frequencies of the rotating cantilever, computed without the package.

Nondimensional: L = rho L = EI_zz = 1, slenderness^2 = EA. With W cos(wt), S sin(wt), g the speed,
p(x) = R (1 - x) + (1 - x^2) / 2 + N (R + 1):

    W'''' - g^2 (p W')' - (w^2 + c g^2) W + 2 g w S = 0          (c = 1 in plane, 0 flap)
    a^2 S'' + (w^2 + g^2) S - 2 g w W = 0
    W(0) = W'(0) = S(0) = 0,  W''(1) = 0
    W''' - g^2 p(1) W' + N [(w^2 + c g^2) W - 2 g w S] = 0       at 1
    a^2 S' - N [(w^2 + g^2) S - 2 g w W] = 0                     at 1

Coefficients are polynomials, so solutions from the root are everywhere convergent power series. A
Galerkin method with B-splines finds the roots and their order, Newton steps on the determinant in
multiple precision make them exact to 20 digits.
"""

import functools
import math
from collections.abc import Callable

import mpmath
import numpy as np
import scipy.interpolate
import scipy.linalg


def _splines(intervals: int = 48, degree: int = 6) -> tuple[np.ndarray, ...]:
    """x, weights, and values, slopes, curvatures of clamped B-splines graded towards the root."""
    breaks = np.linspace(0, 1, intervals + 1) ** 2
    knots = np.concatenate([[0.0] * degree, breaks, [1.0] * degree])
    t, w = np.polynomial.legendre.leggauss(degree + 3)
    x = (breaks[:-1, None] + np.diff(breaks)[:, None] * (t + 1) / 2).ravel()
    weight = (np.diff(breaks)[:, None] * w / 2).ravel()
    spline = scipy.interpolate.BSpline(knots, np.eye(len(knots) - degree - 1), degree)
    return x, weight, *(spline.derivative(d)(x) if d else spline(x) for d in range(3))


def _bending(gamma: float, hub: float, tip: float, plane: str) -> tuple[np.ndarray, np.ndarray]:
    """K and M of bending."""
    x, weight, f, df, ddf = _splines()
    p = hub * (1 - x) + (1 - x**2) / 2 + tip * (hub + 1)
    end = np.zeros(f.shape[1])
    end[-1] = 1.0

    def gram(table: np.ndarray, q: np.ndarray | float) -> np.ndarray:
        return table.T @ ((weight * q)[:, None] * table)

    mass = gram(f, 1.0) + tip * np.outer(end, end)
    c = 1.0 if plane == "in plane" else 0.0
    bending = gram(ddf, 1.0) + gamma**2 * gram(df, p) - c * gamma**2 * mass
    return bending[2:, 2:], mass[2:, 2:]


def _galerkin(gamma: float, hub: float, tip: float, slenderness: float | None, plane: str):
    _, weight, f, df, _ = _splines()
    end = np.zeros(f.shape[1])
    end[-1] = 1.0  # a clamped B-spline basis interpolates its end

    def gram(table: np.ndarray, q: np.ndarray | float) -> np.ndarray:
        return table.T @ ((weight * q)[:, None] * table)

    mass = gram(f, 1.0) + tip * np.outer(end, end)
    bending, mass_w = _bending(gamma, hub, tip, plane)
    if slenderness is None:
        nu = scipy.linalg.eigh(mass_w, bending, eigvals_only=True)
        return np.sort(nu[nu > 0] ** -0.5)
    axial = slenderness**2 * gram(df, 1.0) - gamma**2 * mass
    stiffness = scipy.linalg.block_diag(bending, axial[1:, 1:])
    inertia = scipy.linalg.block_diag(mass_w, mass[1:, 1:])
    n, nw = len(stiffness), len(bending)
    coriolis = np.zeros((n, n))
    coriolis[:nw, nw:] = 2 * gamma * mass[2:, 1:]
    coriolis[nw:, :nw] = -2 * gamma * mass[1:, 2:]
    # Hermitian pencil in 1 / omega: [[-i G, M], [M, 0]] z = nu diag(K, M) z
    left = np.block([[-1j * coriolis, inertia], [inertia, np.zeros((n, n))]])
    nu = scipy.linalg.eigh(left, scipy.linalg.block_diag(stiffness, inertia), eigvals_only=True)
    return np.sort(1 / nu[nu > 1e-7])


def _determinant(omega, gamma, hub, tip, slenderness, plane):
    """Boundary determinant of the power-series solutions at the tip.

    In integers, multiples of 2^-bits: all numbers are below e^growth, which `frequencies` adds to
    the digits, and Python multiplies integers ten times as fast as mpmath its numbers.
    """
    bits = mpmath.mp.prec
    w, g, r, n = (int(mpmath.mpf(v) * 2**bits) for v in (omega, gamma, hub, tip))

    def times(a: int, b: int) -> int:
        return a * b >> bits

    one, c = 1 << bits, 1 if plane == "in plane" else 0
    p0, p1, p2 = r + one // 2 + times(n, r + one), -r, -one // 2
    g2 = times(g, g)
    bending, axial = times(w, w) + c * g2, times(w, w) + g2
    cross = 2 * times(g, w)
    a2 = None if slenderness is None else int(mpmath.mpf(slenderness) ** 2 * 2**bits)
    columns = []
    for start in range(2 if a2 is None else 3):
        a, b = [0] * 4, [0] * 2
        if start < 2:
            a[2 + start] = one
        else:
            b[1] = one
        k, quiet = 0, 0
        while quiet < 12:
            j = k + 1  # coefficient j of p W' is c_j, and (k + 1) c_{k+1} is that of its derivative
            flow = (
                times(p0, (j + 1) * a[j + 1]) + times(p1, j * a[j]) + times(p2, (j - 1) * a[j - 1])
            )
            new = (k + 1) * times(g2, flow) + times(bending, a[k])
            if a2 is not None:
                new -= times(cross, b[k])
                rest = times(cross, a[k]) - times(axial, b[k])
                b.append((rest << bits) // (a2 * (k + 2) * (k + 1)))
            a.append(new // ((k + 4) * (k + 3) * (k + 2) * (k + 1)))
            small = abs(a[-1]) < 4 and (a2 is None or abs(b[-1]) < 4)
            quiet = quiet + 1 if small else 0
            k += 1

        def at_tip(series, d):
            return sum(v * math.perm(i, d) for i, v in enumerate(series) if i >= d)

        value, slope, curve, third = (at_tip(a, d) for d in range(4))
        s, ds = (at_tip(b, 0), at_tip(b, 1)) if a2 is not None else (0, 0)
        shear = third - times(times(g2, p0 + p1 + p2), slope)
        shear += times(n, times(bending, value) - times(cross, s))
        column = [curve, shear]
        if a2 is not None:
            column.append(times(a2, ds) - times(n, times(axial, s) - times(cross, value)))
        columns.append([mpmath.mpf(number) / 2**bits for number in column])
    return mpmath.det(mpmath.matrix(columns))


@functools.cache
def frequencies(
    gamma: float,
    hub: float = 0.0,
    tip: float = 0.0,
    slenderness: float | None = None,
    plane: str = "in plane",
    count: int = 3,
) -> tuple[float, ...]:
    """Lowest frequencies over sqrt(EI / (rho L^4)), to double precision."""
    guesses = _galerkin(gamma, hub, tip, slenderness, plane)[:count]
    others = gamma, hub, tip, slenderness, plane
    with mpmath.workdps(_digits(gamma, hub, tip, max(guesses))):
        return tuple(_root(lambda omega: _determinant(omega, *others), each) for each in guesses)


def _digits(gamma: float, hub: float, tip: float, omega: float) -> int:
    """Digits that outweigh the growth of the solutions; where the beam is pushed they swing."""
    growth = gamma * float(np.sqrt(abs(hub) + 0.5 + tip * abs(hub + 1))) + float(np.sqrt(omega))
    return 40 + int(1.8 * growth)


def _root(function: Callable, guess: float) -> float:
    """The root near a guess, by secants."""
    low, high = mpmath.mpf(guess) * (1 - mpmath.mpf(10) ** -7), mpmath.mpf(guess)
    at_low, at_high = function(low), function(high)
    for _ in range(8):
        if abs(high - low) < abs(high) * mpmath.mpf(10) ** -18:
            break
        new = high - at_high * (high - low) / (at_high - at_low)
        low, at_low = high, at_high
        high, at_high = new, function(new)
    assert abs(high - guess) < 1e-6 * guess, "the Galerkin guess was not near a root"
    return float(high)


def critical_speed(hub: float, tip: float = 0.0, plane: str = "in plane") -> float:
    """The lowest speed at which a frequency is zero, where there is one: w = 0 in the equations,
    in which stretch stands by itself then."""
    bent = [_bending(gamma, hub, tip, plane)[0] for gamma in (0.0, 1.0)]
    largest = scipy.linalg.eigh(bent[0] - bent[1], bent[0], eigvals_only=True)[-1]
    assert largest > 0, "it is stable at any speed"
    guess = largest**-0.5
    with mpmath.workdps(_digits(guess, hub, tip, 0.0)):
        return _root(lambda gamma: _determinant(0.0, gamma, hub, tip, None, plane), guess)
