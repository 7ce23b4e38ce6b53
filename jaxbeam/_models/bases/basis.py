"""Spatial functions on the unit interval xi = x / L, and the integrals that models are made of.

Everything here is plain NumPy in float64, computed once per basis and size: no quantity depends on
a beam, a speed or a hub, so models only scale and add these matrices.

B is the paper of `_models/contract/__init__.py`.
"""

import abc
import dataclasses
import functools
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Chebyshev, legendre

from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.span import Span

_Array = np.ndarray


class Functions(NamedTuple):
    """n functions f_i on [0, 1] and their derivatives, tabulated at p points, (p, n); those of a
    basis in NumPy."""

    value: Any
    slope: Any
    curvature: Any


class Integrals(NamedTuple):
    """Integrals over [0, 1] of products of functions of one kind, and their values at xi = 1.

    mass = int f f^T, curvature = int f'' f''^T, tip = f(1), and
    tension[k] = int t_k f' f'^T with t = (1, 1 - xi, (1 - xi^2) / 2), the three shapes that the
    tension of a rotating beam is made of (see `Rotor.tension`).
    """

    mass: Float[_Array, "n n"]
    tension: Float[_Array, "3 n n"]
    curvature: Float[_Array, "n n"]
    tip: Float[_Array, " n"]


class Basis(abc.ABC):
    """Functions for bending (f(0) = f'(0) = 0) and for stretch (f(0) = 0).

    A basis is hashable and holds no arrays, so that it can be a static part of a model.
    """

    @abc.abstractmethod
    def bending(self, n: int, xi: Float[_Array, " p"]) -> Functions:
        """The first n bending functions at the points xi in [0, 1]."""

    @abc.abstractmethod
    def stretch(self, n: int, xi: Float[_Array, " p"]) -> Functions:
        """The first n stretch functions at the points xi in [0, 1]."""

    @abc.abstractmethod
    def quadrature(self, n: int) -> tuple[Float[_Array, " p"], Float[_Array, " p"]]:
        """Points and weights on [0, 1], exact to rounding for products of two of n functions."""

    @abc.abstractmethod
    def rule(self, n: int, edges: tuple[float, ...]) -> Span:
        """A quadrature for products of n functions with a property, smooth between `edges`."""

    def up_to(self, n: int, end: float) -> tuple[Float[_Array, " p"], Float[_Array, " p"]]:
        """Points and weights on [0, end] for products of n functions."""
        xi, weight = self.quadrature(n)
        return end * xi, end * weight

    @property
    def unit(self) -> str:
        """The noun for one function of the basis, for titles of models."""
        return "function"

    def towards(self, direction: Direction) -> "Basis":
        """The basis for bending in one direction: itself, unless functions differ by direction."""
        return self


@functools.lru_cache(maxsize=64)
def segments(edges: tuple[float, ...], points: int, grading: int = 1) -> Span:
    """A span with Gauss points, in the coordinate xi^(1/grading), between neighbouring edges."""
    return Span.graded(edges, points, grading)


# Gauss points of each segment beyond those for products of functions alone, for a property that
# multiplies them and is smooth there.
_MORE = 8


def _gauss(n: int) -> tuple[_Array, _Array]:
    x, w = legendre.leggauss(n)
    return (1 + x) / 2, w / 2


@dataclasses.dataclass(frozen=True)
class Polynomials(Basis):
    """Integrated orthogonal polynomials: the most accurate basis per unknown.

    With t = xi^(1/grading), the second derivatives of the bending functions and the first
    derivatives of the stretch functions are Jacobi polynomials P_k^(0, grading-1)(2t - 1),
    orthonormal in xi, so that the elastic stiffness is the identity whatever n is and the lowest
    frequencies keep full relative accuracy for 100 functions and more. Convergence is exponential
    because the modes are entire functions of xi.

    grading = 1 gives Legendre polynomials and is right for ordinary speeds. At high speed a
    boundary layer of width sqrt(EI / P(0)) grows at the clamp; grading = 2 packs the resolution
    quadratically towards it. It needs a few functions more than grading = 1 while the layer is
    thick, and far fewer when it is thin: 28 against 48 for a layer of 0.4 % of the length.

    Raises `ValueError` unless `grading` is 1 or 2.
    """

    grading: int = 1

    def __post_init__(self) -> None:
        if type(self.grading) is not int or self.grading not in (1, 2):
            raise ValueError(f"grading must be 1 or 2, got {self.grading!r}")

    def bending(self, n: int, xi: _Array) -> Functions:
        return Functions(*self._integrated(n, xi, 2)[::-1])

    def stretch(self, n: int, xi: _Array) -> Functions:
        t = np.asarray(xi) ** (1 / self.grading)
        value, slope = self._integrated(n, xi, 1)[::-1]
        derivative = np.stack([p.deriv()(t) for p in self._highest(n)], -1)
        # d/dxi = (dt/dxi) d/dt is infinite at the clamp for grading 2, where it is not needed:
        # Gauss points are inside, and stretch has no energy of curvature.
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = t ** (1.0 - self.grading) / self.grading
            return Functions(value, slope, derivative * rate[:, None])

    def quadrature(self, n: int) -> tuple[_Array, _Array]:
        m = self.grading
        t, w = _gauss(m * (n + 4))
        return t**m, w * m * t ** (m - 1)

    def rule(self, n: int, edges: tuple[float, ...]) -> Span:
        return segments(edges, self.points(n, edges), self.grading)

    def points(self, n: int, edges: tuple[float, ...], more: int = _MORE) -> int:
        """The number of points in each segment that products of n functions need, and some more."""
        # The k zeros of a polynomial of degree k are evenly spaced in arccos(1 - 2 t).
        angles = np.arccos(1 - 2 * np.asarray(edges) ** (1 / self.grading))
        waves = self.grading * (n + 2) * np.max(np.diff(angles)) / np.pi
        return int(np.ceil(waves)) + more

    def _highest(self, n: int) -> list[Chebyshev]:
        """Orthonormal polynomials in t, by the three-term recurrence in Chebyshev form."""
        m = self.grading
        t, w = _gauss(m * (n + 2))
        w = w * m * t ** (m - 1)
        line = Chebyshev.identity(domain=[0, 1])
        one = Chebyshev([1.0], domain=[0, 1])
        out = [one]
        while len(out) < n:
            p = line * out[-1]
            for _ in range(2):  # Stieltjes with one re-orthogonalisation
                for q in out[-2:]:
                    p = p - float(np.sum(w * p(t) * q(t))) * q
            out.append(p / float(np.sqrt(np.sum(w * p(t) ** 2))))
        return out[:n]

    def _integrated(self, n: int, xi: _Array, times: int) -> list[_Array]:
        """The highest derivative of the functions, its integral over xi, that of this and so on,
        each (p, n)."""
        m = self.grading
        t = np.asarray(xi) ** (1 / m)
        jacobian = m * Chebyshev.identity(domain=[0, 1]) ** (m - 1)
        table = []
        for p in self._highest(n):
            row = [p]
            for _ in range(times):
                row.append((row[-1] * jacobian).integ(lbnd=0))
            table.append([q(t) for q in row])
        return [np.stack([row[d] for row in table], -1) for d in range(times + 1)]


@dataclasses.dataclass(frozen=True)
class CantileverModes(Basis):
    """Rest modes of the cantilever without tip mass: the functions of paper Y.

    Bending: clamped-free modes, cos(b) cosh(b) = -1, in a form that never subtracts growing
    exponentials (the textbook difference of cosh and sinh loses all digits near the 12th mode).
    Stretch: sqrt(2) sin((k - 1/2) pi xi). Exact at rest with one function a mode, but
    convergence is algebraic once tension, tip mass or hub radius enter: prefer `Polynomials`.
    """

    @property
    def unit(self) -> str:
        return "mode"

    def bending(self, n: int, xi: _Array) -> Functions:
        b = clamped_free_roots(n)
        z = np.outer(xi, b)
        # phi = cosh z - cos z - s (sinh z - sin z), with 1 - s = gap / (1 + small):
        gap = np.sin(b) - np.cos(b) - np.exp(-b)
        scale = (1 - np.exp(-2 * b)) / 2 + np.sin(b) * np.exp(-b)
        growing = 0.5 * gap / scale * np.exp(z - b)
        s = 1 - gap / scale * np.exp(-b)
        decaying = 0.5 * (1 + s) * np.exp(-z)
        return Functions(
            growing + decaying - np.cos(z) + s * np.sin(z),
            b * (growing - decaying + np.sin(z) + s * np.cos(z)),
            b**2 * (growing + decaying + np.cos(z) - s * np.sin(z)),
        )

    def stretch(self, n: int, xi: _Array) -> Functions:
        a = (np.arange(n) + 0.5) * np.pi
        z = np.outer(xi, a)
        f = np.sqrt(2) * np.sin(z)
        return Functions(f, np.sqrt(2) * a * np.cos(z), -(a**2) * f)

    def quadrature(self, n: int) -> tuple[_Array, _Array]:
        # A product of two functions has about n half waves: four points each, and a margin.
        return _gauss(4 * n + 30)

    def rule(self, n: int, edges: tuple[float, ...]) -> Span:
        waves = 2 * n * float(np.max(np.diff(edges)))
        return segments(edges, int(np.ceil(2 * waves)) + 2 * _MORE)


@dataclasses.dataclass(frozen=True)
class Yielding(Basis):
    """The functions of `basis`, after x / L as the first one in directions in which a root yields.

    It counts as one of the functions.
    """

    basis: Basis
    in_plane: bool = True
    flap: bool = True

    @property
    def unit(self) -> str:
        return self.basis.unit

    def towards(self, direction: Direction) -> Basis:
        yields = self.in_plane if direction == Direction.IN_PLANE else self.flap
        return Yielding(self.basis, True, True) if yields else self.basis

    def bending(self, n: int, xi: _Array) -> Functions:
        xi = np.asarray(xi, float)
        own = Functions(xi[:, None], np.ones((xi.size, 1)), np.zeros((xi.size, 1)))
        if n == 1:
            return own
        parts = zip(own, self.basis.bending(n - 1, xi), strict=True)
        return Functions(*(np.concatenate(same, 1) for same in parts))

    def stretch(self, n: int, xi: _Array) -> Functions:
        return self.basis.stretch(n, xi)

    def quadrature(self, n: int) -> tuple[_Array, _Array]:
        return self.basis.quadrature(n)

    def rule(self, n: int, edges: tuple[float, ...]) -> Span:
        return self.basis.rule(n, edges)


def clamped_free_roots(n: int) -> Float[_Array, " n"]:
    """First n positive roots of cos(b) cosh(b) = -1, to rounding."""
    b = (np.arange(n) + 0.5) * np.pi
    b[:1] += 0.3  # the first root is 1.8751, not near pi / 2
    for _ in range(8):
        sech = 1 / np.cosh(b)
        b = b - (np.cos(b) + sech) / (-np.sin(b) - sech * np.tanh(b))
    return b


@dataclasses.dataclass(frozen=True)
class HermiteElements(Basis):
    """Cubic Hermite shapes on `elements` equal elements (B eqs. 5-6).

    Coordinates are, node by node, the displacement and L times its slope, all in metres. Clamping
    removes the first displacement, for bending the first slope too: 2 elements + 1 stretch and
    2 elements bending functions. n must be these numbers.
    """

    elements: int

    def bending(self, n: int, xi: _Array) -> Functions:
        return self._clamped(n, xi, 2)

    def stretch(self, n: int, xi: _Array) -> Functions:
        return self._clamped(n, xi, 1)

    def quadrature(self, n: int) -> tuple[_Array, _Array]:
        x, w = _gauss(4)
        e = self.elements
        return ((np.arange(e)[:, None] + x) / e).ravel(), np.tile(w / e, e)

    def rule(self, n: int, edges: tuple[float, ...]) -> Span:
        # Rounded, so that ends of elements that are edges too compare as equal.
        ends = np.round(np.arange(self.elements + 1) / self.elements, 12)
        return segments(tuple(np.unique(np.append(ends, np.round(edges, 12))).tolist()), _MORE)

    def _clamped(self, n: int, xi: _Array, removed: int) -> Functions:
        total = 2 * self.elements + 2 - removed
        if n != total:
            raise ValueError(f"{self.elements} Hermite elements have {total} functions, not {n}")
        xi = np.asarray(xi, float)
        e = np.clip((xi * self.elements).astype(int), 0, self.elements - 1)
        shapes = hermite(xi * self.elements - e, 1 / self.elements)
        out = np.zeros((3, xi.size, 2 * self.elements + 2))
        for i in range(4):
            out[:, np.arange(xi.size), 2 * e + i] = [s[:, i] for s in shapes]
        return Functions(*out[:, :, removed:])


def hermite(s: Float[_Array, " p"], h: float) -> Functions:
    """The four cubic Hermite shapes of an element of length h at s in [0, 1] (B eqs. 5-6)."""
    s = np.asarray(s, float)
    value = [1 - 3 * s**2 + 2 * s**3, h * (s - 2 * s**2 + s**3), 3 * s**2 - 2 * s**3]
    slope = [(6 * s**2 - 6 * s) / h, 1 - 4 * s + 3 * s**2, (6 * s - 6 * s**2) / h]
    curve = [(12 * s - 6) / h**2, (6 * s - 4) / h, (6 - 12 * s) / h**2]
    return Functions(
        np.stack([*value, h * (s**3 - s**2)], -1),
        np.stack([*slope, 3 * s**2 - 2 * s], -1),
        np.stack([*curve, (6 * s - 2) / h], -1),
    )


@functools.lru_cache(maxsize=64)
def bending_integrals(basis: Basis, n: int) -> Integrals:
    """`Integrals` of the first n bending functions of a basis."""
    xi, w = basis.quadrature(n)
    return _integrals(basis.bending(n, xi), xi, w, basis.bending(n, np.ones(1)))


@functools.lru_cache(maxsize=64)
def stretch_integrals(basis: Basis, n: int) -> Integrals:
    """`Integrals` of the first n stretch functions of a basis."""
    xi, w = basis.quadrature(n)
    return _integrals(basis.stretch(n, xi), xi, w, basis.stretch(n, np.ones(1)))


def _integrals(f: Functions, xi: _Array, w: _Array, end: Functions) -> Integrals:
    def gram(table: _Array, weight: _Array) -> _Array:
        product = table.T @ (weight[:, None] * table)
        return symmetric_part(product)

    shapes = (np.ones_like(xi), 1 - xi, (1 - xi**2) / 2)
    return Integrals(
        mass=gram(f.value, w),
        tension=np.stack([gram(f.slope, w * shape) for shape in shapes]),
        curvature=gram(f.curvature, w),
        tip=end.value[0],
    )
