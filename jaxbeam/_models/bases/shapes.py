"""Functions that suit a beam as built: what loads do to it.

A dozen polynomials cannot follow the curvature of a blade, which has every kink and step of 1 / EI,
and of the mass. What they can follow is the load. So functions on a beam that varies are its own
deflections: by loads that are its mass per length times polynomials, by a force at the tip, by a
moment there if it has a body, and by the pull of the tension on slopes, which has the steps of the
curvature. Nothing is divided by the length of a segment, or approximated but by quadrature.

With c the compliance, m the mass per length and T the tension at unit speed, bending moments are

    int_x^1 (y - x) m p_k dy,   1 - x,   1,   int_x^1 T g_k' dy with g_k'' = c p_k

(and g' = 1 where the root yields), curvatures are c times that, all over x / L. With twist or pitch
the same moments bend the beam across, too. Of these more than twice as many are made as functions
are asked for; a singular value decomposition keeps what counts most, each being given the share of
motion that its polynomial has.

Without tension they are one step of inverse iteration from polynomials, the Ritz vectors of E. L.
Wilson, M. Yuan, J. M. Dickens, Earthquake Engineering and Structural Dynamics 10, 1982.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.basis import Basis, Functions, Polynomials
from jaxbeam._numerics.linalg import principal_rows
from jaxbeam._programs.platforms import once
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.span import Span, on, outboard, polynomials, shortened
from jaxbeam._rotor.spanwise import Property

Counts = tuple[int, int, int]  # of axial, in-plane and flap functions
COMPONENTS = tuple(Direction)[:3]  # of displacements
_FALLS = 6.0  # the share of a load with the power of its number
_MORE = 5  # points of a segment, besides those that polynomials need


class Ends(NamedTuple):
    """Values of n functions at the tip, slopes there, and slopes at the root."""

    tip: Any  # (n,)
    tip_slope: Any
    root: Any


class Shapes(eqx.Module):
    """All functions of a model, side by side, at the points of integration of a rotor's beam."""

    span: Span
    at: Functions  # (p, n)
    ends: Ends
    mixes: "Mixes | None"  # of loads; None of the functions of a basis
    counts: Counts = eqx.field(static=True)
    basis: Basis | None = eqx.field(static=True, default=None)

    def places(self, xi: np.ndarray) -> Functions:
        """The functions at any x / L."""
        if self.basis is not None:
            return all_functions(self.basis, self.counts, xi)
        return Functions(*(self.span.interpolated(table, xi) for table in self.at))

    def shortening(self, xi: np.ndarray) -> Float[Array, "p n n"]:
        """int_0^xi f' f' of functions that bend the same way, for a unit beam."""
        if self.basis is not None:
            return jnp.asarray(shortening(self.basis, self.counts, tuple(xi.tolist())))
        slope = self.at.slope
        products = slope[:, :, None] * slope[:, None] * _bend_alike(self.counts)[None]
        return self.span.interpolated(self.span.up_to(products), xi)


def all_functions(basis: Basis, counts: Counts, xi: Any) -> Functions:
    """All functions of a basis side by side, at points xi."""
    parts = [basis.stretch(counts[0], xi)] if counts[0] else []
    ways = zip(COMPONENTS[1:], counts[1:], strict=True)
    parts += [basis.towards(direction).bending(n, xi) for direction, n in ways if n]
    return Functions(*(np.concatenate(same, 1) for same in zip(*parts, strict=True)))


@functools.lru_cache(maxsize=64)
def shortening(basis: Basis, counts: Counts, xi: tuple[float, ...]) -> np.ndarray:
    """Shortening by the functions of a basis."""
    # Rescaled to [0, xi], a rule stays exact for smooth functions.
    rules = [basis.up_to(max(counts), end) for end in xi]
    points, w = np.stack([rule[0] for rule in rules]), np.stack([rule[1] for rule in rules])
    # All of them at once: of polynomials the recurrences take much longer than the values.
    f = all_functions(basis, counts, points.ravel()).slope.reshape(*points.shape, sum(counts))
    return f.swapaxes(1, 2) @ (w[:, :, None] * f) * _bend_alike(counts)


def _bend_alike(counts: Counts) -> np.ndarray:
    direction = np.repeat(np.arange(3), counts)
    alike: np.ndarray = (direction[:, None] == direction) & (direction > 0)
    return alike


@functools.lru_cache(maxsize=64)
def sampled(basis: Basis, counts: Counts, products: int, edges: tuple[float, ...]) -> Shapes:
    """All functions of a basis at the points of its rule that stops at edges, in NumPy."""
    span = basis.rule(products, edges)
    ends = ends_of(basis, counts)
    return Shapes(span, all_functions(basis, counts, span.xi), ends, None, counts, basis)


def ends_of(basis: Basis, counts: Counts) -> Ends:
    """What functions of a basis are at the ends."""
    bends = np.repeat(np.arange(3), counts) > 0
    tip = all_functions(basis, counts, np.ones(1))
    # Axial functions may have no slope at the clamp: nobody asks for it.
    root = all_functions(basis, counts, np.zeros(1)).slope[0]
    return Ends(tip.value[0], np.where(bends, tip.slope[0], 0.0), np.where(bends, root, 0.0))


# Of each direction, how functions are made of what loads do; without derivatives. What loads do to
# the beam has them; that the choice of combinations moves as well changes a derivative by no more
# than the functions that are left out do.
Mixes = tuple[Array, Array, Array]


@dataclasses.dataclass(frozen=True)
class Kind:
    """What functions are asked for: as static as the model that asks."""

    counts: Counts
    grading: int  # of polynomials
    points: int  # products of so many functions are integrated
    arc_length: bool  # stretch has N / EA for strain; else polynomials, which follow bending, too

    def bent(self, rotor: Rotor) -> list[int]:
        """How many functions bend, in plane and in flap: where the root yields, one turns there."""
        counts = zip(self.counts[1:], rotor.springs, strict=True)
        return [max(n - (spring is not None), 0) for n, spring in counts]


def span_of(kind: Kind, rotor: Rotor, finer: int = 1) -> Span:
    """Points of integration; `finer` cuts segments into so many."""
    beam = rotor.beam
    cut = shortened(beam.edges, kind.grading > 1)
    more = _MORE + 3 * (kind.grading > 1)  # towards the root powers are not whole
    points = Polynomials(kind.grading).points(kind.points, cut, more)
    if finer > 1:
        inner = np.linspace(cut[:-1], cut[1:], finer, endpoint=False).T.ravel()
        cut = (*inner.tolist(), 1.0)
    stiffnesses = [beam.in_plane_bending_stiffness, beam.flap_bending_stiffness]
    stiffnesses += [beam.axial_stiffness] if kind.counts[0] else []
    return Span.following(stiffnesses, cut, points)


class Profile(eqx.Module):
    """Properties of a rotor's beam at the points of a span."""

    span: Span
    mass: Array  # by x / L, kg
    axial: Array
    in_plane: Array
    flap: Array
    section_axes: tuple[Array, Array] | None  # cosine and sine of their angle, where turned

    @classmethod
    def of(cls, rotor: Rotor, span: Span) -> Self:
        beam = rotor.beam
        mass, axial, in_plane, flap = (
            on(value, span)
            for value in (
                beam.mass_per_length, beam.axial_stiffness, beam.in_plane_bending_stiffness,
                beam.flap_bending_stiffness,
            )
        )  # fmt: skip
        angle = section_angle(rotor, functools.partial(on, span=span))
        section_axes = None
        if angle is not None:
            cos, sin = once(jnp.stack([jnp.cos(angle), jnp.sin(angle)]))
            section_axes = cos, sin
        return cls(span, beam.length * mass, axial, in_plane, flap, section_axes)

    @property
    def compliances(self) -> tuple[list[Array], Array | None]:
        """1 / EI in plane and in flap, and of moments about the one axis on curvature about the
        other: c^2 / EI_zz + s^2 / EI_yy and so on, and (1 / EI_zz - 1 / EI_yy) s c."""
        zz, yy = 1 / self.in_plane, 1 / self.flap
        if self.section_axes is None:
            return [zz, yy], None
        cos, sin = self.section_axes
        return [cos**2 * zz + sin**2 * yy, cos**2 * yy + sin**2 * zz], (zz - yy) * sin * cos

    def in_section_axes(self, in_plane: Array, flap: Array) -> tuple[Array, Array]:
        """Curvatures or slopes (p, n) in the axes of sections, which twist and pitch turn: about
        that of the stiffness in plane, and across."""
        if self.section_axes is None:
            return in_plane, flap
        cos, sin = (a[:, None] for a in self.section_axes)
        return in_plane * cos + flap * sin, flap * cos - in_plane * sin


class Loaded(eqx.Module):
    """Curvatures, or strains, by loads on a rotor's beam at the points of a span."""

    profile: Profile
    raw: tuple[Array, Array, Array]  # of each direction, (p, loads)
    stiffness: tuple[Array, Array, Array]  # what curvatures and strains are weighed with, (p,)

    @classmethod
    def on(cls, kind: Kind, rotor: Rotor, span: Span) -> Self:
        beam, length = rotor.beam, rotor.beam.length
        mean = beam.mean
        share, outside, moment = outboard(beam.mass_per_length, span)
        most = max(*kind.counts, 1)
        shapes = once(polynomials(span.xi ** (1 / kind.grading), most).T).T
        force = span.beyond(share[:, None] * shapes)
        moments = _ordered(span.beyond(force), 1 - span.xi, rotor.tip_body.is_body)
        beside = rotor.tip_mass / beam.mass * rotor.tip_mass_radius / length
        tension = beside + rotor.hub_radius / length * outside + moment
        profile = Profile.of(rotor, span)
        own, across = profile.compliances
        scales = mean.in_plane_bending_stiffness, mean.flap_bending_stiffness
        own = [c * scale for c, scale in zip(own, scales, strict=True)]
        held = [spring is not None for spring in rotor.springs]
        sizes = kind.bent(rotor)
        bent = span.up_to(jnp.concatenate([c[:, None] * shapes for c in own], 1))
        slopes = [
            jnp.concatenate([jnp.ones_like(part[:, :1]), part], 1) if yields else part
            for part, yields in zip(jnp.split(bent, 2, 1), held, strict=True)
        ]
        pulled = [part[:, : n // 2] for part, n in zip(slopes, sizes, strict=True)]
        both = span.beyond(tension[:, None] * jnp.concatenate(pulled, 1))
        pulls = jnp.split(both, [sizes[0] // 2], 1)
        raw = []
        for n, c, scale, pull in zip(sizes, own, scales, pulls, strict=True):
            columns = [c[:, None] * moments[:, :n], c[:, None] * pull]
            if across is not None:
                columns.append((scale * across)[:, None] * moments[:, :n])
            raw.append(jnp.concatenate(columns, 1))
        stretches, weight = shapes[:, : kind.counts[0]], jnp.ones_like(span.xi)
        if kind.arc_length:
            weight = profile.axial / mean.axial_stiffness
            loads = _ordered(force, jnp.ones_like(span.xi), False)[:, : kind.counts[0]]
            stretches = loads / weight[:, None]
        in_plane, flap = raw
        return cls(profile, (stretches, in_plane, flap), (weight, 1 / own[0], 1 / own[1]))

    def mixes(self, kind: Kind, rotor: Rotor) -> Mixes:
        """Combinations that are orthonormal in their strain energy."""
        in_plane, flap = (
            _mix(self, way, n) for way, n in zip((1, 2), kind.bent(rotor), strict=True)
        )
        return _mix(self, 0, kind.counts[0]), in_plane, flap


def _ordered(by_mass: Array, by_tip: Array, body: bool) -> Array:
    """Loads in the order in which they count: the first polynomial, the tip, all others."""
    tip = [by_tip[:, None]] + [jnp.ones_like(by_tip[:, None])] * body
    return jnp.concatenate([by_mass[:, :1], *tip, by_mass[:, 1:]], 1)


def _mix(loaded: Loaded, way: int, n: int) -> Array:
    """Combinations of raw columns (loads, by tension, across), so many, for which they do most.

    A load counts the less the higher its polynomial, and what tension does, or a moment across, as
    its polynomial would. Of what loads do already (of a uniform beam all that tension does is that)
    little is left, so that there are always as many functions that are independent.
    """
    root = jnp.sqrt(loaded.profile.span.weight * loaded.stiffness[way])[:, None]
    columns = jax.lax.stop_gradient(root * loaded.raw[way])
    if not n:
        return jnp.zeros((columns.shape[1], 0))
    size = jnp.linalg.norm(columns, axis=0)
    pulled = n // 2 if way else 0
    # A moment across has the size of the same moment's own curvature: it may be next to nothing.
    size = jnp.concatenate([size[: n + pulled], size[: columns.shape[1] - n - pulled]])
    rank = np.concatenate([np.arange(k) for k in (n, pulled, columns.shape[1] - n - pulled)])
    share: Any = (1.0 + rank) ** -_FALLS / size
    value, rows = principal_rows(columns * share[None])
    value = jnp.maximum(value, jnp.finfo(value.dtype).eps * value[0])
    return share[:, None] * (rows[:n] / value[:n, None]).T


def section_angle(rotor: Rotor, at: Callable[[Property], Array]) -> Any:
    """The angle by which twist and pitch turn sections, `at` some places; None where they are not
    turned."""
    if not rotor.couples_bending:
        return None
    angles = [at(angle) for angle in (rotor.beam.twist, rotor.pitch) if angle is not None]
    return functools.reduce(jnp.add, angles)


def shapes_on(kind: Kind, rotor: Rotor) -> Shapes:
    """The functions on a rotor's beam."""
    loaded = Loaded.on(kind, rotor, span_of(kind, rotor))
    mixes = loaded.mixes(kind, rotor)
    at, ends = integrated(loaded, mixes, rotor, [jnp.eye(n) for n in kind.counts])
    return Shapes(loaded.profile.span, at, ends, mixes, kind.counts)


def integrated(
    loaded: Loaded, mixes: Mixes, rotor: Rotor, coordinates: Sequence[Array]
) -> tuple[Functions, Ends]:
    """What coordinates of functions, (n, k) by direction, are along the beam: k axially, k in plane
    and k in flap, side by side."""
    span = loaded.profile.span
    held = [False, *(spring is not None for spring in rotor.springs)]
    bent, roots = [], []
    for raw, mix, q, yields in zip(loaded.raw, mixes, coordinates, held, strict=True):
        yields = yields and len(q) > 0
        bent.append(raw @ (mix @ q[1 if yields else 0 :]))
        roots.append(q[0] if yields else jnp.zeros_like(bent[-1][0]))
    # Strains are slopes, curvatures become such.
    curvature, root = jnp.concatenate(bent[1:], 1), jnp.concatenate(roots)
    slope = jnp.concatenate([bent[0], span.up_to(curvature)], 1) + root[None]
    tip_slope = jnp.concatenate([0 * roots[0], span.total(curvature)]) + root
    curvature = jnp.concatenate([jnp.zeros_like(bent[0]), curvature], 1)
    at = Functions(span.up_to(slope), slope, curvature)
    return at, Ends(span.total(slope), tip_slope, root)


class Shape(NamedTuple):
    """k shapes along a beam axially, in plane and in flap: (p, 3, k), and (3, k) at the ends; by
    x / L, in metres, complex. Strains are slopes."""

    value: Array
    slope: Array
    curvature: Array
    tip: Array
    tip_slope: Array
    root: Array

    @classmethod
    def of(cls, at: Functions, ends: Ends) -> Self:
        """Shapes in three directions, side by side."""
        return cls(*(a.reshape(len(a), 3, -1) for a in at), *(a.reshape(3, -1) for a in ends))


def finer(kind: Kind, rotor: Rotor, mixes: Mixes, parts: Sequence[Array]) -> tuple[Profile, Shape]:
    """What coordinates, by direction, are at twice as many points."""
    loaded = Loaded.on(kind, rotor, span_of(kind, rotor, finer=2))
    both = [jnp.concatenate([q.real, q.imag], 1) for q in parts]
    at, ends = integrated(loaded, mixes, rotor, both)

    def joined(a: Array) -> Array:
        sides = a.reshape(*a.shape[:-1], 3, 2, -1)
        return jax.lax.complex(sides[..., 0, :], sides[..., 1, :])

    return loaded.profile, Shape(*map(joined, (*at, *ends)))


def of_basis(basis: Basis, counts: Counts, span: Span, parts: Sequence[Array]) -> Shape:
    """What coordinates of functions of a basis, by direction, are on a span."""
    q = jax.scipy.linalg.block_diag(*parts)
    at, ends = all_functions(basis, counts, span.xi), ends_of(basis, counts)
    # Axial functions may have no curvature at the clamp: nobody asks for it.
    bends = np.repeat(np.arange(3), counts) > 0
    at = at._replace(curvature=np.where(bends, at.curvature, 0.0))
    return Shape.of(Functions(*(a @ q for a in at)), Ends(*(a @ q for a in ends)))


def follows(basis: Basis, rotor: Rotor) -> bool:
    """Whether functions are those that suit the beam: polynomials, where it varies."""
    return type(basis) is Polynomials and not rotor.beam.is_uniform
