"""Functions for beams as built: their own deflections under loads.

A dozen polynomials cannot approximate the curvature of a blade, which has every kink and step of
1 / EI, but they can approximate the load. So functions on a beam that varies are its deflections by
loads that are its mass per length times polynomials, by a force at the tip, by a moment there if it
has a body, and by the tension on slopes, which have the steps of the curvature. The only
approximation is quadrature.

With c the compliance, m the mass per length and T the tension at unit speed, bending moments are

    int_x^1 (y - x) m p_k dy,   1 - x,   1,   int_x^1 T g_k' dy with g_k'' = c p_k

(and g' = 1 where the root yields), and curvatures are c times these, all over x / L. With twist or
pitch the same moments bend the beam across, too. These are more than twice as many as the functions
of a model, which are the combinations of them that have most of the motion, when each load is
weighted by the share of motion that its polynomial has.

Without tension they are one step of inverse iteration from polynomials, the Ritz vectors of E. L.
Wilson, M. Yuan, J. M. Dickens, Earthquake Engineering and Structural Dynamics 10, 1982.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._models.bases.basis import Polynomials
from jaxbeam._numerics.subspace import principal
from jaxbeam._programs.platforms import once
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.span import Span, on, outboard, polynomials, shortened
from jaxbeam._rotor.spanwise import Property

FunctionCounts = tuple[int, int, int]  # numbers of axial, in-plane and flap functions
_FALLS = 6.0  # the load of polynomial k = 0, 1, ... has the weight (1 + k)^-6: smooth loads first
_MORE = 5  # points of a segment beyond those for polynomials


# For each direction the combinations (loads, n) of deflections by loads that n functions are. They
# are taken as constant in derivatives: the deflections have derivatives, and those of the
# combinations would change results by no more than functions that are left out.
Mixes = tuple[Array, Array, Array]


@dataclasses.dataclass(frozen=True)
class Kind:
    """Static choices of a model about its functions."""

    counts: FunctionCounts
    grading: int  # grading of polynomials: they are polynomials of x^(1/grading)
    points: int  # number of functions whose products the points of integration are exact for
    arc_length: bool  # whether axial functions are stretch by N / EA, not polynomials

    def bent(self, rotor: Rotor) -> list[int]:
        """The numbers of functions with curvature in plane and in flap: without those for the slope
        at a root that yields."""
        counts = zip(self.counts[1:], rotor.springs, strict=True)
        return [max(n - (spring is not None), 0) for n, spring in counts]


def span_of(kind: Kind, rotor: Rotor, beside: int = 0) -> Span:
    """Points of integration along a rotor's beam, with `beside` more of them in each segment."""
    beam = rotor.beam
    cut = shortened(beam.edges, kind.grading > 1)
    more = _MORE + 3 * (kind.grading > 1) + beside  # graded polynomials are fractional powers of x
    points = Polynomials(kind.grading).points(kind.points, cut, more)
    stiffnesses = [beam.in_plane_bending_stiffness, beam.flap_bending_stiffness]
    stiffnesses += [beam.axial_stiffness] if kind.counts[0] else []
    return Span.following(stiffnesses, cut, points)


def in_beam_axes(
    zz: Array, yy: Array, section_axes: tuple[Array, Array] | None
) -> tuple[list[Array], Array | None]:
    """Stiffnesses (or compliances) of bending in plane and in flap, c^2 zz + s^2 yy and c^2 yy +
    s^2 zz, and the coupling of both, (zz - yy) s c, from those about the two axes of sections and
    the cosine and sine of their angle; None: not turned."""
    if section_axes is None:
        return [zz, yy], None
    cos, sin = section_axes
    return [cos**2 * zz + sin**2 * yy, cos**2 * yy + sin**2 * zz], (zz - yy) * sin * cos


class Profile(eqx.Module):
    """Properties of a rotor's beam at the points of a span."""

    span: Span
    mass: Array  # mass by x / L, kg
    axial: Array
    in_plane: Array
    flap: Array
    section_axes: tuple[Array, Array] | None  # cosine and sine of their angle; None: not turned

    @classmethod
    def of(cls, rotor: Rotor, span: Span) -> Self:
        beam = rotor.beam
        mass, axial, in_plane, flap = (
            on(value, span)
            for value in (
                beam.mass_with_points, beam.axial_stiffness, beam.in_plane_bending_stiffness,
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
        """Bending compliances in plane and in flap, and the coupling compliance of turned
        sections."""
        return in_beam_axes(1 / self.in_plane, 1 / self.flap, self.section_axes)

    def in_section_axes(self, in_plane: Array, flap: Array) -> tuple[Array, Array]:
        """Curvatures (or slopes) (p, n) in axes of sections, from those in plane and in flap."""
        if self.section_axes is None:
            return in_plane, flap
        cos, sin = (a[:, None] for a in self.section_axes)
        return in_plane * cos + flap * sin, flap * cos - in_plane * sin


class LoadFunctions(eqx.Module):
    """Strains of a rotor's beam, at the points of a span, by the loads that functions are made of.

    For n functions in a direction of bending there are n loads by moments, n // 2 by the tension on
    slopes and, where sections are turned, n by moments across.
    """

    profile: Profile
    shapes: Array  # (p, k), polynomials
    share: Array  # (p,), mass per length over its mean
    tension: Array  # (p,), at unit speed, over the mass and the length
    own: tuple[Array, Array]  # (p,), compliances in plane and in flap, over those of the mean beam
    across: tuple[Array, Array] | None
    axial: Array  # (p,), EA over that of the mean beam
    kind: Kind = eqx.field(static=True)
    bent: tuple[int, ...] = eqx.field(static=True)  # functions with curvature, in plane and flap
    yields: tuple[bool, ...] = eqx.field(static=True)
    body: bool = eqx.field(static=True)

    @classmethod
    def on(cls, kind: Kind, rotor: Rotor, span: Span) -> Self:
        beam, length = rotor.beam, rotor.beam.length
        mean, profile = beam.mean, Profile.of(rotor, span)
        share, outside, moment = outboard(beam.mass_with_points, span)
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
            body=rotor.tip_body.is_body,
        )

    @property
    def stiffness(self) -> tuple[Array, Array, Array]:
        """Stiffnesses of stretch and of bending in plane and in flap, (p,) each, over the mean."""
        return self.axial, 1 / self.own[0], 1 / self.own[1]

    def raw(self) -> tuple[Array, Array, Array]:
        """Strains, and curvatures in plane and in flap, by each of the loads, (p, loads)."""
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
        """Strains, and curvatures in plane and in flap, (p, k), by k combinations (loads, k) of
        loads in each direction: for few of them this costs much less than `raw`."""
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
        """Combinations `mix` of `_ordered` loads, split by loads: polynomials, and at the tip."""
        by_mass, by_tip = jnp.concatenate([mix[:1], mix[1 + ends :]]), mix[1 : 1 + ends]
        sizes = (self.shapes.shape[1], ends)
        whole = (
            jnp.pad(part[:size], ((0, size - len(part[:size])), (0, 0)))
            for part, size in zip((by_mass, by_tip), sizes, strict=True)
        )
        first, second = whole
        return first, second

    def _pulls(self, halves: Sequence[Array]) -> list[Array]:
        """Moments of the tension on slopes, in plane and in flap, for combinations of the
        polynomials that curvatures are made of."""
        span, bent, at_root = self.profile.span, [], []
        for own, half, yields in zip(self.own, halves, self.yields, strict=True):
            first = half[:1] if yields else half[:0]
            rest = half[len(first) :]
            bent.append(own[:, None] * (self.shapes[:, : len(rest)] @ rest))
            at_root.append(jnp.sum(first, 0))
        slopes = span.up_to(jnp.concatenate(bent, 1)) + jnp.concatenate(at_root)[None]
        return jnp.split(span.beyond(self.tension[:, None] * slopes), [halves[0].shape[1]], 1)


def _ordered(by_mass: Array, by_tip: Array, body: bool) -> Array:
    """Columns of loads in the order of their weight: first polynomial, force and moment at the tip,
    other polynomials."""
    tip = [by_tip[:, None]] + [jnp.ones_like(by_tip[:, None])] * body
    return jnp.concatenate([by_mass[:, :1], *tip, by_mass[:, 1:]], 1)


def mixed(loads: LoadFunctions, raw: tuple[Array, Array, Array]) -> Mixes:
    """The combinations of loads that functions are: orthonormal by strain energy."""
    weight, each = loads.profile.span.weight, zip(raw, loads.stiffness, strict=True)
    stretch, *bent = (
        jax.lax.stop_gradient(jnp.sqrt(weight * stiffness)[:, None] * columns)
        for columns, stiffness in each
    )
    in_plane, flap = (_mix(columns, n, n // 2) for columns, n in zip(bent, loads.bent, strict=True))
    return _mix(stretch, loads.kind.counts[0], 0), in_plane, flap


def _mix(columns: Array, n: int, pulled: int) -> Array:
    """The n combinations of columns (by moments, by tension, by moments across) that have most of
    them when each column is weighted.

    Weights fall with the number of the polynomial, also of columns by tension or moments across.
    These may depend on the columns by moments, as those by tension on a uniform beam do; the n
    combinations are independent all the same.
    """
    if not n:
        return jnp.zeros((columns.shape[1], 0), columns.dtype)
    size = jnp.linalg.norm(columns, axis=0)
    # Columns by moments across are scaled like those by the same moments, since they may be tiny.
    size = jnp.concatenate([size[: n + pulled], size[: columns.shape[1] - n - pulled]])
    rank = np.concatenate([np.arange(k) for k in (n, pulled, columns.shape[1] - n - pulled)])
    share: Any = (1.0 + rank) ** -_FALLS / size
    # Start with the columns of the largest weights, each plus some of lower weight, since one alone
    # may depend on others.
    start = np.eye(n)[np.argsort(np.argsort(rank, kind="stable")) % n]
    return share[:, None] * principal(columns * share[None], start)


def section_angle(rotor: Rotor, at: Callable[[Property], Array]) -> Any:
    """The angle by which twist and pitch turn sections, at places where `at` gives the values of a
    property; None where they are not turned."""
    if not rotor.couples_bending:
        return None
    angles = [at(angle) for angle in (rotor.beam.twist, rotor.pitch) if angle is not None]
    return functools.reduce(jnp.add, angles)
