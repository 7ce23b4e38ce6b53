"""Points of integration along a beam, and integrals from them, segment by segment.

All costs grow with the number of points, not with its square. Y and B are the papers of
`_models/contract/__init__.py`.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.polynomial import chebyshev, legendre

from jaxbeam._programs.platforms import once
from jaxbeam._rotor.spanwise import AbstractSpanwise, Property, at_ends

# Segments of a beam at least, so that what is not smooth is seen; where a table has fewer intervals
# several are in each, which follow stiffnesses that fall to both ends of it by decades.
_FEWEST = 48
_SHORT = 1e-4  # of the span: a segment in which nothing but a step or a point is, left whole
_STEEPEST = 8.0  # logarithm of the ratio of stiffnesses at the ends of a segment that is followed


class Span(eqx.Module):
    """Gauss points in each segment between `edges`, in a coordinate t that goes from 0 to 1 there.

    x / L is that of the start of the segment and its length times s(t), and s may crowd to where
    a stiffness is small: with s = (e^(r t) - 1) / (e^r - 1) a stiffness that is linear in the
    segment and grows by e^r is an exponential of t, so that its reciprocal, which is nearly
    singular where the beam is soft, is as smooth as it is. Arrays at points are (p, ...), segment
    by segment, p of them in all. Of two stiffnesses one may be small at the start and one at the
    end, r_0 and r_1: then points crowd to both, ds / dt goes with the product of the two, and

        s = (e^(r t) - 1) / (e^(r_0) - 1 + e^(r t) (1 - e^(-r_1))),   r = r_0 + r_1.
    """

    s: Any  # (p,) place in the segment, from 0 to 1
    xi: Any  # (p,) x / L
    weight: Any  # (p,) int_0^1 f = weight.f
    rate: Any  # (p,) d xi / dt
    steepness: Any  # (2, e) r_0 and r_1
    edges: tuple[float, ...] = eqx.field(static=True)
    points: int = eqx.field(static=True)  # of each segment

    @classmethod
    def between(cls, edges: tuple[float, ...], points: int, steepness: Any = None) -> Self:
        """Points of integration, so many in each segment; without `steepness` known ones, in
        NumPy."""
        t, _ = _gauss(points)
        start, length = np.asarray(edges[:-1])[:, None], np.diff(edges)[:, None]
        if steepness is None:
            zeros = np.zeros((2, length.size))
            return cls._of(t + 0 * length, start + length * t, length + 0 * t, zeros, edges, points)
        both = jnp.stack(_crowded(steepness[..., None], t[None]))
        s, pace = once(both.reshape(2, -1)).reshape(both.shape)
        return cls._of(s, start + length * s, length * pace, steepness, edges, points)

    @classmethod
    def graded(cls, edges: tuple[float, ...], points: int, grading: int) -> Self:
        """Points that are Gauss points in xi^(1/grading), in NumPy."""
        t, _ = _gauss(points)
        places = np.asarray(edges) ** (1 / grading)
        root = places[:-1, None] + np.diff(places)[:, None] * t
        xi, rate = root**grading, np.diff(places)[:, None] * grading * root ** (grading - 1)
        s = (xi - np.asarray(edges[:-1])[:, None]) / np.diff(edges)[:, None]
        return cls._of(s, xi, rate, np.zeros((2, len(edges) - 1)), edges, points)

    @classmethod
    def _of(cls, s: Any, xi: Any, rate: Any, steepness: Any, edges: Any, points: int) -> Self:
        s, xi, weight, rate = (a.reshape(-1) for a in (s, xi, rate * _gauss(points)[1][None], rate))
        return cls(s, xi, weight, rate, steepness, edges, points)

    @classmethod
    def following(
        cls, stiffnesses: Sequence[Property], edges: tuple[float, ...], points: int
    ) -> Self:
        """Points that crowd where one of these stiffnesses is small."""
        ratios = jnp.stack([_steepness(stiffness, edges) for stiffness in stiffnesses])
        both = jnp.stack([jnp.max(jnp.maximum(sign * ratios, 0.0), 0) for sign in (1.0, -1.0)])
        # Where points are does not change what an integral is.
        return cls.between(edges, points, jax.lax.stop_gradient(both))

    def up_to(self, f: Any) -> Array:
        """The integral int_0^xi f at the points, from values of f there."""
        return _by_parts(lambda f: self._integrated(f, _inside(self.points), forward=True), f)

    def beyond(self, f: Any) -> Array:
        """The integral int_xi^1 f at the points. Not the difference of the whole and of what is
        before: towards the tip that would be rounding alone."""
        back = _inside(self.points)[::-1, ::-1]
        return _by_parts(lambda f: self._integrated(f, back, forward=False), f)

    def total(self, f: Any) -> Array:
        """The integral int_0^1 f."""
        return _by_parts(lambda f: jnp.tensordot(jnp.asarray(self.weight), f, 1), f)

    def at_edges(self, f: Array) -> Array:
        """The integral int_0^xi f at the edges, (e + 1, n), of f (p, n)."""
        parts = self._over(f, _gauss(self.points)[1][None])[:, 0]
        return _before(jnp.concatenate([parts, 0 * parts[:1]]), True)

    def interpolated(self, f: Array, xi: np.ndarray) -> Array:
        """Values at any places of what is smooth within segments, from those at the points."""
        edges = np.asarray(self.edges)
        where = np.clip(np.searchsorted(edges, xi, side="right") - 1, 0, edges.size - 2)
        s = (xi - edges[where]) / np.diff(edges)[where]
        first, last = jnp.asarray(self.steepness)[:, where]
        flat = first + last < _FLAT
        first, last = jnp.where(flat, 1.0, first), jnp.where(flat, 0.0, last)
        t = jnp.log1p(s * jnp.expm1(first)) - jnp.log1p(s * jnp.expm1(-last))
        t = jnp.where(flat, s, t / (first + last))
        rows = polynomials(t, self.points) @ _chebyshev_coefficients(self.points)
        f = f.reshape(len(self.edges) - 1, self.points, *f.shape[1:])
        return jnp.einsum("qp,qp...->q...", rows, f[where])

    def _over(self, f: Array, rows: np.ndarray) -> Array:
        """Integrals (e, r, n) in each segment with these rows (r, points) of weights, of f (p, n).
        The rates go with the weights: products of small matrices take f as it lies in memory."""
        rate = jnp.asarray(self.rate).reshape(-1, 1, self.points)
        by_segment = f.reshape(len(self.edges) - 1, self.points, f.shape[1])
        return jnp.asarray(rows)[None] * rate @ by_segment

    def _integrated(self, f: Array, own: np.ndarray, forward: bool) -> Array:
        whole = _gauss(self.points)[1][None]
        within = self._over(f.reshape(f.shape[0], -1), np.concatenate([own, whole]))
        out = within[:, :-1] + _before(within[:, -1], forward)[:, None]
        return out.reshape(f.shape)


def _by_parts(function: Callable[[Array], Array], f: Any) -> Array:
    """The result of a linear function with real coefficients, by real and imaginary parts: of
    complex numbers it takes several times as long."""
    if not jnp.iscomplexobj(f):
        return function(f)
    both = function(jnp.concatenate([f.real, f.imag], -1))
    return jax.lax.complex(*jnp.split(both, 2, -1))


def _before(parts: Array, forward: bool) -> Array:
    """Sums of all parts (e, n) before each, or behind it: by a matrix; of many in groups, and over
    groups, which compiles as two small matrices do, much faster than a running sum."""
    if len(parts) <= _MANY:
        inside = np.tri(len(parts), k=-1)
        return jnp.asarray(inside if forward else inside.T) @ parts
    size = int(np.ceil(np.sqrt(len(parts))))
    groups = -(-len(parts) // size)
    beyond = ((0, groups * size - len(parts)), *((0, 0),) * (parts.ndim - 1))
    grouped = jnp.pad(parts, beyond).reshape(groups, size, *parts.shape[1:])
    inside, outside = (
        rows if forward else rows.T for rows in (np.tri(size, k=-1), np.tri(groups, k=-1))
    )
    before = jnp.einsum("ij,gj...->gi...", inside, grouped)
    before = before + jnp.tensordot(outside, jnp.sum(grouped, 1), 1)[:, None]
    return before.reshape(groups * size, *parts.shape[1:])[: len(parts)]  # there may be no columns


_MANY = 128  # segments of which sums are grouped
_NEARER, _TURNS = 4.0, 10  # ratio of segments towards the ends, and how many towards the root
_FLAT = 1e-2  # ratios whose logarithm is below need no crowding


def on(value: Property, span: Span) -> Array:
    """A property at the points of a span, whose edges are all its kinks and may be more."""
    if not isinstance(value, AbstractSpanwise):
        return jnp.broadcast_to(value, span.xi.shape)
    return value.within(span.edges, span.s.reshape(-1, span.points)).reshape(-1)


def polar_inertia(beam: Any, at: Callable[[Property], Array]) -> Array:
    """Polar inertia per length (kg m) of a beam where `at` looks at its properties: if it is not
    given, that of a section whose material is alike throughout, mass (EI_zz + EI_yy) / EA."""
    if beam.polar_inertia is not None:
        return at(beam.polar_inertia)
    lag, flap = at(beam.in_plane_bending_stiffness), at(beam.flap_bending_stiffness)
    return at(beam.mass_per_length) * (lag + flap) / at(beam.axial_stiffness)


def section_inertia(beam: Any, at: Callable[[Property], Any]) -> tuple[Any, Any] | None:
    """Second moments per length (kg m) of the mass of sections, across the beam in plane and in
    flap, where `at` looks at its properties; None without a `polar_inertia`, which they share as
    the stiffnesses of bending do: what the sections of a `Beam` are."""
    if beam.polar_inertia is None:
        return None
    return shared(at(beam.polar_inertia), beam, at)


def shared(polar: Any, beam: Any, at: Callable[[Property], Any]) -> tuple[Any, Any]:
    """A polar inertia as the stiffnesses of bending in plane and in flap share it."""
    lag, flap = at(beam.in_plane_bending_stiffness), at(beam.flap_bending_stiffness)
    share = polar / (lag + flap)
    return share * lag, share * flap


def outboard(mass: Property, span: Span) -> tuple[Array, Array, Array]:
    """Share of a mass per length at points, int_x^L dm over the mass, and int_x^L x dm over the
    mass and the length: what 1, 1 - xi and (1 - xi^2) / 2 are for a uniform beam."""
    value = on(mass, span)
    share = value / span.total(value)
    return share, span.beyond(share), span.beyond(span.xi * share)


def tension(
    spin2: Any, hub_radius: Any, tip_mass: Any, mass: Any = 1.0, length: Any = 1.0,
    axial: Any = 0.0, tip_mass_radius: Any = None,
) -> tuple[Any, Any, Any]:  # fmt: skip
    """Axial force that carries the undeformed beam along, as three coefficients c in N:

    P(x) = -int_x^L a1 dm = c_0 + c_1 (1 - xi) + c_2 (1 - xi^2) / 2,  xi = x / L,

    where a1(X) = axial - spin2 X is the acceleration along the beam at the distance X = R + x from
    the axis. P of Y eqs. 19-20, with the tip mass in the mass measure; in steady rotation, spin2 =
    Omega^2 and axial = 0, EA times the strains of B eqs. 41-43:

    P(x) = Omega^2 { m_t (R + L) + rho R (L - x) + rho (L^2 - x^2) / 2 }

    Where the mass varies along the span, int_x^L dm and int_x^L x dm over the mass and its product
    with L take the place of 1 - xi and (1 - xi^2) / 2: see `outboard`. `tip_mass_radius` is that of
    the tip mass where it is not R + L.
    """
    tip_mass_radius = hub_radius + length if tip_mass_radius is None else tip_mass_radius
    return (
        tip_mass * (spin2 * tip_mass_radius - axial),
        mass * (spin2 * hub_radius - axial),
        mass * spin2 * length,
    )


def _steepness(stiffness: Property, edges: tuple[float, ...]) -> Array:
    """Logarithm of the ratio, over each segment, of what is linear there and of which the stiffness
    is a power; zero where it ends in a point, which needs no crowding."""
    start, end = (jnp.log(a) for a in at_ends(stiffness, edges))
    middle = jnp.full((len(edges) - 1, 1), 0.5)
    if isinstance(stiffness, AbstractSpanwise):
        half = jnp.log(stiffness.within(edges, middle))[:, 0]
    else:
        half = start
    powers = np.arange(1.0, 5.0)[:, None]
    rise, bend = (end - start)[None] / powers, (half - start)[None] / powers
    off = jnp.abs(2 * jnp.exp(bend) - 1 - jnp.exp(rise)) / (1 + jnp.exp(rise))
    power = jnp.argmin(off, 0)
    ratio = jnp.take_along_axis(rise, power[None], 0)[0]
    # What tapers like a power loses its mass, too, and moments fall faster than it does.
    most = jnp.where(power == 0, _STEEPEST, _STEEPEST / 2)
    return jnp.where(jnp.abs(ratio) <= most, ratio, 0.0)


def _crowded(r: Array, t: np.ndarray) -> tuple[Array, Array]:
    """The map s(t) that crowds points, and ds/dt."""
    flat = r[0] + r[1] < _FLAT
    first, last = jnp.where(flat, 1.0, r[0]), jnp.where(flat, 0.0, r[1])
    soft, end = jnp.expm1(first), -jnp.expm1(-last)
    rise = jnp.expm1((first + last) * t)
    below = soft + (1 + rise) * end
    pace = (first + last) * (1 + rise) * (soft + end) / below**2
    return jnp.where(flat, t, rise / below), jnp.where(flat, 1.0, pace)


@functools.lru_cache(maxsize=64)
def shortened(edges: tuple[float, ...], root: bool = False) -> tuple[float, ...]:
    """Edges with others between them, so that no segment is too long and none of few has to follow
    too much; one more near the tip, for what tapers almost to a point there. With `root` they go on
    towards the root as a geometric series does, for powers of x that are not whole."""
    sizes = np.diff(edges)
    out, each = [0.0], -(-_FEWEST // int(np.sum(sizes > _SHORT)))
    for start, end in itertools.pairwise(edges):
        parts = max(int(np.ceil((end - start) * _FEWEST / 2 - 1e-9)), each)
        parts = parts if end - start > _SHORT else 1
        out += [*np.linspace(start, end, parts + 1)[1:-1].tolist(), end]
    near = (out[1] * _NEARER ** np.arange(-_TURNS, 0.0)).tolist() if root else []
    tip = 1 - (1 - out[-2]) / _NEARER
    return (0.0, *near, *out[1:-1], tip, 1.0)


@functools.lru_cache(maxsize=64)
def _gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    x, w = legendre.leggauss(points)
    return (1 + x) / 2, w / 2


@functools.lru_cache(maxsize=64)
def _coefficients(points: int) -> np.ndarray:
    """Legendre coefficients of the polynomial through values at the points."""
    return np.linalg.inv(legendre.legvander(2 * _gauss(points)[0] - 1, points - 1))


@functools.lru_cache(maxsize=64)
def _chebyshev_coefficients(points: int) -> np.ndarray:
    return np.linalg.inv(chebyshev.chebvander(2 * _gauss(points)[0] - 1, points - 1))


@functools.lru_cache(maxsize=64)
def _inside(points: int) -> np.ndarray:
    """Integrals from the start of a segment to its points, of the polynomial through values."""
    integrals = legendre.legint(_coefficients(points), lbnd=-1, axis=0) / 2
    return legendre.legval(2 * _gauss(points)[0] - 1, integrals).T


def polynomials(t: Any, count: int) -> Array:
    """Chebyshev polynomials of 2 t - 1, (..., count), by T_(m+k) = 2 T_m T_k - T_(m-k)."""
    x = (2 * jnp.asarray(t) - 1)[..., None]
    out = jnp.concatenate([jnp.ones_like(x), x], -1)
    while (m := out.shape[-1]) < count:
        more = 2 * x * out[..., -1:] - out[..., -2:-1]
        rest = 2 * more * out[..., 1:] - out[..., :0:-1]
        out = jnp.concatenate([out, more, rest], -1)[..., : max(count, m + 1)]
    return out[..., :count]
