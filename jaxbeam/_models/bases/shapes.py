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
COMPONENTS = (Direction.AXIAL, Direction.IN_PLANE, Direction.FLAP)  # of displacements
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


class Loads(eqx.Module):
    """Loads on a rotor's beam at the points of a span, and what they do there.

    In each direction that bends, of n functions, they are n moments, n // 2 pulls of the tension
    and, where sections are turned, n moments across.
    """

    profile: Profile
    shapes: Array  # (p, k) polynomials
    share: Array  # of the mass, (p,)
    tension: Array  # at unit speed, over the mass and the length
    own: tuple[Array, Array]  # compliances of both directions, over that of the mean, (p,)
    across: tuple[Array, Array] | None
    axial: Array  # stiffness, over that of the mean
    kind: Kind = eqx.field(static=True)
    bent: tuple[int, ...] = eqx.field(static=True)  # functions that bend, in plane and in flap
    yields: tuple[bool, ...] = eqx.field(static=True)
    body: bool = eqx.field(static=True)

    @classmethod
    def on(cls, kind: Kind, rotor: Rotor, span: Span) -> Self:
        beam, length = rotor.beam, rotor.beam.length
        mean, profile = beam.mean, Profile.of(rotor, span)
        share, outside, moment = outboard(beam.mass_per_length, span)
        beside = rotor.tip_mass / beam.mass * rotor.tip_mass_radius / length
        (first, second), across = profile.compliances
        in_plane, flap = mean.in_plane_bending_stiffness, mean.flap_bending_stiffness
        one = jnp.ones_like(span.xi)
        return cls(
            profile=profile,
            shapes=polynomials(span.xi ** (1 / kind.grading), max(*kind.counts, 1)),
            share=share,
            tension=beside + rotor.hub_radius / length * outside + moment,
            own=(in_plane * first, flap * second),
            across=None if across is None else (in_plane * across, flap * across),
            axial=profile.axial / mean.axial_stiffness if kind.arc_length else one,
            kind=kind,
            bent=tuple(kind.bent(rotor)),
            yields=tuple(spring is not None for spring in rotor.springs),
            body=rotor.tip_body is not None,
        )

    @property
    def stiffness(self) -> tuple[Array, Array, Array]:
        """What strains and curvatures are weighed with, (p,) each."""
        return self.axial, 1 / self.own[0], 1 / self.own[1]

    def raw(self) -> tuple[Array, Array, Array]:
        """Strains, and curvatures in plane and in flap, by each load, (p, loads)."""
        span, stretches = self.profile.span, self.shapes
        force = span.beyond(self.share[:, None] * self.shapes)
        if self.kind.arc_length:
            stretches = _ordered(force, jnp.ones_like(span.xi), False) / self.axial[:, None]
        moments = _ordered(span.beyond(force), 1 - span.xi, self.body)
        pulls = self._pulls([jnp.eye(n // 2, dtype=force.dtype) for n in self.bent])
        raw = []
        for way, (n, pull) in enumerate(zip(self.bent, pulls, strict=True)):
            columns = [self.own[way][:, None] * jnp.concatenate([moments[:, :n], pull], 1)]
            if self.across is not None:
                columns.append(self.across[way][:, None] * moments[:, :n])
            raw.append(jnp.concatenate(columns, 1))
        return stretches[:, : self.kind.counts[0]], raw[0], raw[1]

    def strains(self, mixes: Sequence[Array]) -> tuple[Array, Array, Array]:
        """The same by k combinations of loads, (loads, k) of each direction: much less than by all
        loads where there are few."""
        groups, halves = [], []
        for n, mix in zip(self.bent, mixes[1:], strict=True):
            moments, pulls, across = jnp.split(mix, [n, n + n // 2])
            groups += [moments] if self.across is None else [moments, across]
            halves.append(pulls)
        bent = jnp.split(self._moments(groups), len(groups), 1)
        each, raw = len(groups) // 2, []
        for way, pull in enumerate(self._pulls(halves)):
            curvature = self.own[way][:, None] * (bent[each * way] + pull)
            if self.across is not None:
                curvature = curvature + self.across[way][:, None] * bent[each * way + 1]
            raw.append(curvature)
        return self._stretches(mixes[0]), raw[0], raw[1]

    def _stretches(self, mix: Array) -> Array:
        if not self.kind.arc_length or not len(mix):
            return self.shapes[:, : len(mix)] @ mix
        by_mass, by_tip = self._sorted(mix, 1)
        force = self.profile.span.beyond(self.share[:, None] * (self.shapes @ by_mass))
        return (force + by_tip) / self.axial[:, None]

    def _moments(self, groups: Sequence[Array]) -> Array:
        span, body = self.profile.span, 2 if self.body else 1
        both = (self._sorted(group, body) for group in groups)
        by_mass, by_tip = (jnp.concatenate(same, 1) for same in zip(*both, strict=True))
        force = span.beyond(self.share[:, None] * (self.shapes @ by_mass))
        moments = span.beyond(force) + (1 - span.xi)[:, None] * by_tip[:1]
        return moments + by_tip[1:] if self.body else moments

    def _sorted(self, mix: Array, ends: int) -> tuple[Array, Array]:
        """Of `_ordered` loads those by polynomials, and those at the tip."""
        by_mass, by_tip = jnp.concatenate([mix[:1], mix[1 + ends :]]), mix[1 : 1 + ends]
        sizes = (self.shapes.shape[1], ends)
        whole = (
            jnp.pad(part[:size], ((0, size - len(part[:size])), (0, 0)))
            for part, size in zip((by_mass, by_tip), sizes, strict=True)
        )
        first, second = whole
        return first, second

    def _pulls(self, halves: Sequence[Array]) -> list[Array]:
        """Moments of the tension on slopes, in plane and in flap."""
        span, bent, turned = self.profile.span, [], []
        for own, half, yields in zip(self.own, halves, self.yields, strict=True):
            at_root = half[:1] if yields else half[:0]
            rest = half[len(at_root) :]
            bent.append(own[:, None] * (self.shapes[:, : len(rest)] @ rest))
            turned.append(jnp.sum(at_root, 0))
        slopes = span.up_to(jnp.concatenate(bent, 1)) + jnp.concatenate(turned)[None]
        return jnp.split(span.beyond(self.tension[:, None] * slopes), [halves[0].shape[1]], 1)


def _ordered(by_mass: Array, by_tip: Array, body: bool) -> Array:
    """Loads in the order in which they count: the first polynomial, the tip, all others."""
    tip = [by_tip[:, None]] + [jnp.ones_like(by_tip[:, None])] * body
    return jnp.concatenate([by_mass[:, :1], *tip, by_mass[:, 1:]], 1)


def mixed(loads: Loads, raw: tuple[Array, Array, Array]) -> Mixes:
    """Combinations that are orthonormal in their strain energy."""
    weight, each = loads.profile.span.weight, zip(raw, loads.stiffness, strict=True)
    stretch, *bent = (
        jax.lax.stop_gradient(jnp.sqrt(weight * stiffness)[:, None] * columns)
        for columns, stiffness in each
    )
    in_plane, flap = (_mix(columns, n, n // 2) for columns, n in zip(bent, loads.bent, strict=True))
    return _mix(stretch, loads.kind.counts[0], 0), in_plane, flap


def _mix(columns: Array, n: int, pulled: int) -> Array:
    """Combinations of columns (loads, by tension, across), so many, for which they do most.

    A load counts the less the higher its polynomial, and what tension does, or a moment across, as
    its polynomial would. Of what loads do already (of a uniform beam all that tension does is that)
    little is left, so that there are always as many functions that are independent.
    """
    if not n:
        return jnp.zeros((columns.shape[1], 0), columns.dtype)
    size = jnp.linalg.norm(columns, axis=0)
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
    loads = Loads.on(kind, rotor, span_of(kind, rotor))
    raw = loads.raw()
    mixes = mixed(loads, raw)
    unit = [jnp.eye(n) for n in kind.counts]
    # What turns the root has no curvature.
    turns = [((0, 0), (len(root), 0)) for root in _at_root(loads, unit)]
    each = zip(raw, mixes, turns, strict=True)
    strains = [columns @ jnp.pad(mix, first) for columns, mix, first in each]
    at, ends = _integrated(loads, strains, unit)
    return Shapes(loads.profile.span, at, ends, mixes, kind.counts)


def _at_root(loads: Loads, coordinates: Sequence[Array]) -> list[Array]:
    """Of coordinates those that turn the root, (0 or 1, k) of each direction."""
    yields = (False, *loads.yields)
    return [q[: int(turns)] for q, turns in zip(coordinates, yields, strict=True)]


def _integrated(
    loads: Loads, strains: Sequence[Array], coordinates: Sequence[Array]
) -> tuple[Functions, Ends]:
    """What coordinates of functions, (n, k) by direction, are along the beam, from their strains:
    k axially, k in plane and k in flap, side by side."""
    span, (stretch, *bent) = loads.profile.span, strains
    root = jnp.concatenate([jnp.sum(q, 0) for q in _at_root(loads, coordinates)])
    # Strains are slopes, curvatures become such.
    curvature = jnp.concatenate(bent, 1)
    slope = jnp.concatenate([stretch, span.up_to(curvature)], 1) + root[None]
    tip_slope = jnp.concatenate([jnp.zeros_like(stretch[0]), span.total(curvature)]) + root
    curvature = jnp.concatenate([jnp.zeros_like(stretch), curvature], 1)
    at = Functions(span.up_to(slope), slope, curvature)
    return at, Ends(span.total(slope), tip_slope, root)


class Shape(NamedTuple):
    """k shapes along a beam axially, in plane and in flap: (p, 3, k), and (3, k) at the ends; by
    x / L, in metres, real or complex. Strains are slopes. Where nothing moves axially, that may be
    left out: (p, 2, k)."""

    value: Array
    slope: Array
    curvature: Array
    tip: Array
    tip_slope: Array
    root: Array

    @classmethod
    def of(cls, at: Functions, ends: Ends, ways: int) -> Self:
        """Shapes in so many directions, side by side."""
        return cls(*(a.reshape(*a.shape[:-1], ways, -1) for a in (*at, *ends)))


def shape_of(
    kind: Kind, rotor: Rotor, mixes: Mixes, parts: Sequence[Array], finer: int = 1
) -> tuple[Profile, Shape]:
    """What coordinates, by direction, are at the points of integration, or so many times as many;
    those of models without axial functions have to be real."""
    loads = Loads.on(kind, rotor, span_of(kind, rotor, finer))
    if kind.counts[0]:
        parts = [jnp.concatenate([q.real, q.imag], 1) for q in parts]
    turned = _at_root(loads, parts)
    rest = [q[len(root) :] for q, root in zip(parts, turned, strict=True)]
    strains = loads.strains([mix @ q for mix, q in zip(mixes, rest, strict=True)])
    if not kind.counts[0]:
        # All is real, and nothing moves axially: half of the work, or less.
        strains = (strains[0][:, :0], *strains[1:])
        turned = [turned[0][:, :0], *turned[1:]]
        return loads.profile, Shape.of(*_integrated(loads, strains, turned), 2)
    at, ends = _integrated(loads, strains, turned)

    def joined(a: Array) -> Array:
        sides = a.reshape(*a.shape[:-1], 3, 2, -1)
        return jax.lax.complex(sides[..., 0, :], sides[..., 1, :])

    return loads.profile, Shape(*map(joined, (*at, *ends)))


def of_basis(basis: Basis, counts: Counts, span: Span, parts: Sequence[Array]) -> Shape:
    """What coordinates of functions of a basis, by direction, are on a span."""
    q = jax.scipy.linalg.block_diag(*parts)
    at, ends = all_functions(basis, counts, span.xi), ends_of(basis, counts)
    # Axial functions may have no curvature at the clamp: nobody asks for it.
    bends = np.repeat(np.arange(3), counts) > 0
    at = at._replace(curvature=np.where(bends, at.curvature, 0.0))
    return Shape.of(Functions(*(a @ q for a in at)), Ends(*(a @ q for a in ends)), 3)


def follows(basis: Basis, rotor: Rotor) -> bool:
    """Whether functions are those that suit the beam: polynomials, where it varies."""
    return type(basis) is Polynomials and not rotor.beam.is_uniform
