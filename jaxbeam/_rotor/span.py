"""Points of integration along a beam, and integrals up to, beyond and over them.

Costs grow linearly with the number of points. Y and B are the papers of
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

# Least number of segments along a beam, so that kinks of functions that are not declared do little
# harm. Intervals of short tables are divided, also to follow stiffnesses that fall by decades.
_FEWEST = 48
# Length, over that of the beam, below which segments (of steps and points) are not divided.
_SHORT = 1e-4
_STEEPEST = 8.0  # largest logarithm of the ratio of stiffnesses in a segment that points follow


class Span(eqx.Module):
    """Gauss points in each segment between `edges`, in a coordinate t from 0 to 1.

    x / L is that of the start of the segment plus its length times s(t), where points may crowd
    towards small stiffness: with s = (e^(r t) - 1) / (e^r - 1) a stiffness that is linear in the
    segment and grows by e^r is an exponential of t, so that its reciprocal, which is nearly
    singular where the beam is soft, is as smooth as it is. Arrays at points are (p, ...), segment
    by segment, for p points in all. One stiffness may be small at the start and another at the
    end, by r_0 and r_1: then points crowd towards both, ds / dt is in proportion to the product of
    both, and

        s = (e^(r t) - 1) / (e^(r_0) - 1 + e^(r t) (1 - e^(-r_1))),   r = r_0 + r_1.
    """

    s: Any  # (p,) place in the segment, from 0 to 1
    xi: Any  # (p,) x / L
    weight: Any  # (p,) int_0^1 f = weight.f
    rate: Any  # (p,) d xi / dt
    steepness: Any  # (2, e) r_0 and r_1
    edges: tuple[float, ...] = eqx.field(static=True)
    points: int = eqx.field(static=True)  # number of points in each segment

    @classmethod
    def between(cls, edges: tuple[float, ...], points: int, steepness: Any = None) -> Self:
        """A span with so many points in each segment, which crowd by `steepness`, or without it are
        Gauss points in NumPy."""
        t, _ = _gauss(points)
        start, length = np.asarray(edges[:-1])[:, None], np.diff(edges)[:, None]
        if steepness is None:
            zeros = np.zeros((2, length.size))
            return cls._flat(
                t + 0 * length, start + length * t, length + 0 * t, zeros, edges, points
            )
        crowded = jnp.stack(_crowded(steepness[..., None], t[None]))
        s, s_rate = once(crowded.reshape(2, -1)).reshape(crowded.shape)
        return cls._flat(s, start + length * s, length * s_rate, steepness, edges, points)

    @classmethod
    def graded(cls, edges: tuple[float, ...], points: int, grading: int) -> Self:
        """A span with Gauss points in the coordinate xi^(1/grading), in NumPy."""
        t, _ = _gauss(points)
        places = np.asarray(edges) ** (1 / grading)
        root = places[:-1, None] + np.diff(places)[:, None] * t
        xi, rate = root**grading, np.diff(places)[:, None] * grading * root ** (grading - 1)
        s = (xi - np.asarray(edges[:-1])[:, None]) / np.diff(edges)[:, None]
        return cls._flat(s, xi, rate, np.zeros((2, len(edges) - 1)), edges, points)

    @classmethod
    def _flat(cls, s: Any, xi: Any, rate: Any, steepness: Any, edges: Any, points: int) -> Self:
        s, xi, weight, rate = (a.reshape(-1) for a in (s, xi, rate * _gauss(points)[1][None], rate))
        return cls(s, xi, weight, rate, steepness, edges, points)

    @classmethod
    def following(
        cls, stiffnesses: Sequence[Property], edges: tuple[float, ...], points: int
    ) -> Self:
        """A span with points that crowd where one of these stiffnesses is small."""
        ratios = jnp.stack([_steepness(stiffness, edges) for stiffness in stiffnesses])
        steepness = jnp.stack([jnp.max(jnp.maximum(sign * ratios, 0.0), 0) for sign in (1.0, -1.0)])
        # Integrals do not depend on where points are, so these need no derivatives.
        return cls.between(edges, points, jax.lax.stop_gradient(steepness))

    def up_to(self, f: Any) -> Array:
        """The integral int_0^xi f at the points, from values of f there."""
        return _by_parts(lambda f: self._integrated(f, _inside(self.points), forward=True), f)

    def beyond(self, f: Any) -> Array:
        """The integral int_xi^1 f at the points, from values of f there. It is summed from the tip:
        as a difference of integrals from the root it would be rounding alone near the tip."""
        from_tip = _inside(self.points)[::-1, ::-1]
        return _by_parts(lambda f: self._integrated(f, from_tip, forward=False), f)

    def total(self, f: Any) -> Array:
        """The integral int_0^1 f, from values of f at the points."""
        return _by_parts(lambda f: jnp.tensordot(jnp.asarray(self.weight), f, 1), f)

    def at_edges(self, f: Array) -> Array:
        """The integrals int_0^xi f at the edges, (e + 1, n), from values of f (p, n)."""
        segments = self._over(f, _gauss(self.points)[1][None])[:, 0]
        return _before(jnp.concatenate([segments, 0 * segments[:1]]), True)

    def interpolated(self, f: Array, xi: np.ndarray) -> Array:
        """Values at any places xi of a function f that is smooth within segments, from its values
        at the points."""
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
        """Integrals (e, r, n) over each of e segments of f (p, n), with r rows (r, points) of
        weights in t. Rates d xi / dt multiply the weights, not f: so f is used as it is in
        memory."""
        rate = jnp.asarray(self.rate).reshape(-1, 1, self.points)
        by_segment = f.reshape(len(self.edges) - 1, self.points, f.shape[1])
        return jnp.asarray(rows)[None] * rate @ by_segment

    def _integrated(self, f: Array, rows: np.ndarray, forward: bool) -> Array:
        over_all = _gauss(self.points)[1][None]
        integrals = self._over(f.reshape(f.shape[0], -1), np.concatenate([rows, over_all]))
        out = integrals[:, :-1] + _before(integrals[:, -1], forward)[:, None]
        return out.reshape(f.shape)


def _by_parts(function: Callable[[Array], Array], f: Any) -> Array:
    """The result of a real linear function for f, by real and imaginary parts if f is complex:
    products of complex numbers take several times as long."""
    if not jnp.iscomplexobj(f):
        return function(f)
    parts = function(jnp.concatenate([f.real, f.imag], -1))
    return jax.lax.complex(*jnp.split(parts, 2, -1))


def _before(parts: Array, forward: bool) -> Array:
    """Sums (e, n) of all parts before each, or with `forward` false of those after it. By a
    triangular matrix, or for many parts by two of them, within groups and over groups: that
    compiles much faster than a running sum."""
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
    return before.reshape(groups * size, *parts.shape[1:])[: len(parts)]


_MANY = 128  # number of segments beyond which sums are grouped
_NEARER, _TURNS = 4.0, 10  # ratio of lengths of segments towards an end, and their number
_FLAT = 1e-2  # points do not crowd where the logarithm of the ratio of stiffnesses is below


def on(value: Property, span: Span) -> Array:
    """Values of a property at the points of a span, among whose edges are all its kinks."""
    if not isinstance(value, AbstractSpanwise):
        return jnp.broadcast_to(value, span.xi.shape)
    return value.within(span.edges, span.s.reshape(-1, span.points)).reshape(-1)


def polar_inertia(beam: Any, at: Callable[[Property], Array]) -> Array:
    """Polar inertia per length (kg m) of a beam at places, where `at` gives the values of a
    property. If it is None, that of a homogeneous section, mass per length (EI_zz + EI_yy) / EA."""
    if beam.polar_inertia is not None:
        return at(beam.polar_inertia)
    lag, flap = at(beam.in_plane_bending_stiffness), at(beam.flap_bending_stiffness)
    return at(beam.mass_per_length) * (lag + flap) / at(beam.axial_stiffness)


def section_inertia(beam: Any, at: Callable[[Property], Any]) -> tuple[Any, Any] | None:
    """Second moments of mass per length (kg m) of sections, in plane and in flap, at places where
    `at` gives the values of a property: the `polar_inertia` divided in the ratio of the bending
    stiffnesses; None without one."""
    if beam.polar_inertia is None:
        return None
    return shared(at(beam.polar_inertia), beam, at)


def shared(polar: Any, beam: Any, at: Callable[[Property], Any]) -> tuple[Any, Any]:
    """A polar inertia divided into parts in plane and in flap, in the ratio of the bending
    stiffnesses."""
    lag, flap = at(beam.in_plane_bending_stiffness), at(beam.flap_bending_stiffness)
    share = polar / (lag + flap)
    return share * lag, share * flap


def outboard(mass: Property, span: Span) -> tuple[Array, Array, Array]:
    """Mass per length over its mean, int_x^L dm over the mass, and int_x^L x dm over mass and
    length, at the points of a span: for a uniform beam 1, 1 - xi and (1 - xi^2) / 2."""
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
    """Steepness of a stiffness in each segment: it is taken for the power, 1 to 4, of a linear
    function that fits its middle value best, and the logarithm of the ratio of this function at
    both ends is returned; zero where that is large, as at a pointed end, where points do not crowd.
    """
    start, end = (jnp.log(a) for a in at_ends(stiffness, edges))
    middle = jnp.full((len(edges) - 1, 1), 0.5)
    if isinstance(stiffness, AbstractSpanwise):
        half = jnp.log(stiffness.within(edges, middle))[:, 0]
    else:
        half = start
    powers = np.arange(1.0, 5.0)[:, None]
    end_ratio, half_ratio = (end - start)[None] / powers, (half - start)[None] / powers
    misfit = jnp.abs(2 * jnp.exp(half_ratio) - 1 - jnp.exp(end_ratio)) / (1 + jnp.exp(end_ratio))
    power = jnp.argmin(misfit, 0)
    ratio = jnp.take_along_axis(end_ratio, power[None], 0)[0]
    # A beam that tapers like a higher power loses mass, too, and its moments fall even faster than
    # its stiffness: points need not crowd as far.
    most = jnp.where(power == 0, _STEEPEST, _STEEPEST / 2)
    return jnp.where(jnp.abs(ratio) <= most, ratio, 0.0)


def _crowded(r: Array, t: np.ndarray) -> tuple[Array, Array]:
    """The map s(t) of `Span` for steepnesses r (2, ...), and its derivative ds/dt."""
    flat = r[0] + r[1] < _FLAT
    first, last = jnp.where(flat, 1.0, r[0]), jnp.where(flat, 0.0, r[1])
    soft, end = jnp.expm1(first), -jnp.expm1(-last)
    rise = jnp.expm1((first + last) * t)
    below = soft + (1 + rise) * end
    pace = (first + last) * (1 + rise) * (soft + end) / below**2
    return jnp.where(flat, t, rise / below), jnp.where(flat, 1.0, pace)


@functools.lru_cache(maxsize=64)
def shortened(edges: tuple[float, ...], root: bool = False) -> tuple[float, ...]:
    """Edges x / L with more between them, at least `_FEWEST` segments in all and none long, and one
    more near the tip, for beams that taper almost to a point. With `root` more edges follow towards
    the root in a geometric series, for integrands that are fractional powers of x there."""
    sizes = np.diff(edges)
    out, each = [0.0], -(-_FEWEST // int(np.sum(sizes > _SHORT)))
    for start, end in itertools.pairwise(edges):
        parts = max(int(np.ceil((end - start) * _FEWEST / 2 - 1e-9)), each)
        parts = parts if end - start > _SHORT else 1
        out += [*np.linspace(start, end, parts + 1)[1:-1].tolist(), end]
    towards_root = (out[1] * _NEARER ** np.arange(-_TURNS, 0.0)).tolist() if root else []
    tip = 1 - (1 - out[-2]) / _NEARER
    return (0.0, *towards_root, *out[1:-1], tip, 1.0)


@functools.lru_cache(maxsize=64)
def _gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    x, w = legendre.leggauss(points)
    return (1 + x) / 2, w / 2


@functools.lru_cache(maxsize=64)
def _coefficients(points: int) -> np.ndarray:
    """The matrix from values at the Gauss points to Legendre coefficients of their polynomial."""
    return np.linalg.inv(legendre.legvander(2 * _gauss(points)[0] - 1, points - 1))


@functools.lru_cache(maxsize=64)
def _chebyshev_coefficients(points: int) -> np.ndarray:
    return np.linalg.inv(chebyshev.chebvander(2 * _gauss(points)[0] - 1, points - 1))


@functools.lru_cache(maxsize=64)
def _inside(points: int) -> np.ndarray:
    """The matrix from values at the Gauss points of a segment to integrals of their polynomial from
    its start to each point."""
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
