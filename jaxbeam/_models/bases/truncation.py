"""Errors of frequencies by too few functions and by quadrature, by the differential equation.

A cantilever is statically determinate: bending moments and axial force of a mode x follow by
integration from its inertia, the tension and the body at the tip. With these moments m, the
compliance C of sections and the curvature k of the mode, d'' = C m - k is the curvature that the
functions leave out, but for the inertia of d itself. In the space of x and d the frequency is more
accurate: with Q(l) = l^2 M + l G + K, x^H Q d is minus e, twice the strain energy of d, and

    |l - l_better| = e^2 / (d^H Q d |x^H (2 l M + G) x|).

(That two moments, of which one is in equilibrium and the other compatible, bound the error of each:
W. Prager, J. L. Synge, Quarterly of Applied Mathematics 5, 1947.) All integrals have more points of
integration than those of the model. By these x^H Q(l) x would be zero without errors of quadrature.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.loads import FunctionCounts, Profile
from jaxbeam._models.bases.rotary import (
    SecondMoments,
    by_winding,
    first_order,
    of_body,
    of_sections,
    second_order,
)
from jaxbeam._models.bases.shapes import Shape
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.span import Span, on, outboard
from jaxbeam._types import Scalar

MORE_POINTS = 4  # points of each segment more than a model has, for these integrals
# Safety factor on errors of quadrature: enough for waves of properties, and for 19 of 20 kinks and
# dips that are not declared. Errors by undeclared steps may be larger.
_MISSED = 3.0


class _Case(NamedTuple):
    """A rotor, its properties at points of integration, its speed and its tension."""

    profile: Profile
    rotor: Rotor
    speed: Scalar
    counts: FunctionCounts
    pull: Array  # tension of steady rotation at the points, N
    tensioned: bool

    @property
    def span(self) -> Span:
        return self.profile.span

    def total(self, weight: Any, x: Array, y: Array | None = None) -> Array:
        """The integral of weight x^H y by x / L; with None of weight x^H x, which is real."""
        weight = weight.reshape(-1, *(1,) * (x.ndim - 1))
        if y is None:
            return self.span.total(weight * _square(x))
        return self.span.total(_times(weight, x.conj() * y))

    def tip(self, x: Shape) -> Array:
        """Displacements (3, k) of the centre of the mass at the tip."""
        at: Array = self.rotor.tip_body.centre(x.tip, x.tip_slope, self.rotor.beam.length)
        return at


class _Rotary(NamedTuple):
    """Rotary inertia at places along the beam: coefficients of mass and stiffness by products of
    slopes in plane and in flap, (..., 2, 2), and of stiffness by the turn phi, None for zero."""

    inertia: Array
    stiffness: Array
    wound: Array | None

    @classmethod
    def of(cls, case: _Case, moments: SecondMoments | None, scale: Any) -> "_Rotary | None":
        """Rotary inertia of mass with second moments E_kl, times a scale."""
        if moments is None:
            return None
        square = scale / case.rotor.beam.length**2
        steady = -(case.speed**2) * np.diag([1.0, 1.0, 0.0])
        held = first_order(steady)
        if case.tensioned:
            held = tuple(a + b for a, b in zip(held, second_order(steady), strict=True))
        one = first_order(jnp.eye(3, dtype=steady.dtype))
        inertia, stiffness = (
            square * sum(_outer(e, a) for e, a in zip(moments, of, strict=True) if e is not None)
            for of in (one, held)
        )
        wound = None
        if moments.crossed is not None and case.tensioned:
            wound = square * by_winding(steady)[2] * moments.crossed
        return cls(inertia, stiffness, wound)


class _Turning(NamedTuple):
    """Rotary inertia of sections, by x / L at the points, and of the body at the tip."""

    sections: _Rotary | None
    body: _Rotary | None
    wound: Array | None  # (p,), coefficients of v' w'' - w' v'' in the stiffness

    @classmethod
    def of(cls, case: _Case) -> "_Turning":
        rotor, span = case.rotor, case.span
        at = functools.partial(on, span=span)
        sections = _Rotary.of(case, of_sections(rotor, at), rotor.beam.length)
        body = _Rotary.of(case, of_body(rotor), 1.0)
        if body is not None and case.tensioned:
            # The centre of the body comes nearer to the axis of rotation when the body turns.
            pull = rotor.tip_mass * rotor.tip_mass_radius * case.speed**2
            nearer = pull * rotor.tip_body.centre(0.0, 1.0) / rotor.beam.length**2
            body = body._replace(stiffness=body.stiffness + nearer * np.eye(2))
        wound = None
        if body is not None and body.wound is not None:
            wound = body.wound + jnp.zeros(span.xi.shape)
        if sections is not None and sections.wound is not None:
            beyond = span.beyond(sections.wound[:, None])[:, 0]
            wound = beyond if wound is None else wound + beyond
        return cls(sections, body, wound)


def frequency_error(
    x: Shape, profile: Profile, rotor: Rotor, speed: Scalar, eigenvalue: Array,
    counts: FunctionCounts, pull: Array | None,
) -> Float[Array, " k"]:  # fmt: skip
    """Estimated relative error of each eigenvalue, zero for zero ones; x are the shapes. `pull` is
    the tension of steady rotation, in N, None in a theory without it. Where shapes are real, as
    without axial motion, squares of eigenvalues have to be real."""
    none = jnp.zeros_like(profile.mass)
    has_strain = pull is not None
    case = _Case(profile, rotor, speed, counts, none if pull is None else pull, has_strain)
    turning = _Turning.of(case)
    square = eigenvalue**2 if jnp.iscomplexobj(x.value) else (eigenvalue**2).real
    d = _left_out(case, turning, x, square, eigenvalue)
    (value, slope, _), (other, _, energy) = (
        _quotient(_forms(case, turning, shape), square, eigenvalue) for shape in (x, d)
    )
    other = other.real
    safe = jnp.where(energy > 0, jnp.maximum(other, energy / 4), 1.0)
    error = energy**2 / safe + _MISSED * jnp.abs(value)
    scale = jnp.abs(slope) * jnp.abs(eigenvalue)
    return jnp.where(scale > 0, error / jnp.where(scale > 0, scale, 1.0), 0.0)


def _quotient(forms: Any, square: Array, eigenvalue: Array) -> tuple[Array, Array, Array]:
    """The quotient x^H Q x of shapes, its derivative by the eigenvalue, and twice the strain
    energy, from the `forms` of `_forms`."""
    m, g, stiffness, energy = forms
    value, slope = square * m + stiffness, 2 * eigenvalue * m
    return (value, slope, energy) if g is None else (value + eigenvalue * g, slope + g, energy)


def forms(
    x: Shape, profile: Profile, rotor: Rotor, speed: Scalar, counts: FunctionCounts, pull: Array
) -> tuple[Array, Array, Array]:
    """The forms x^H M x, x^H G x and x^H K x of shapes, with the tension `pull`."""
    case = _Case(profile, rotor, speed, counts, pull, True)
    m, g, k, _ = _forms(case, _Turning.of(case), x)
    return m, jnp.zeros_like(m) if g is None else g, k


def tension(profile: Profile, rotor: Rotor, speed: Scalar, rounds: int = 0) -> Array:
    """Tension of steady rotation, in N, on the undeformed beam; with some rounds on one that has
    stretched, to that power of the strain."""
    span, beam = profile.span, rotor.beam
    c0, c1, c2 = rotor.tension(speed)
    share, outside, moment = outboard(beam.mass_with_points, span)
    rigid = pull = c0 + c1 * outside + c2 * moment
    for _ in range(rounds):
        strain = beam.length * pull / profile.axial
        more = beam.mass * span.beyond(share * span.up_to(strain))
        pull = rigid + speed**2 * (more + rotor.tip_mass * span.total(strain))
    return pull


def _times(real: Array, x: Array) -> Array:
    """The product of a real and a complex array, by real and imaginary parts: faster than XLA's,
    which converts the real one."""
    return jax.lax.complex(real * x.real, real * x.imag) if jnp.iscomplexobj(x) else real * x


def _square(x: Array) -> Array:
    """The square |x|^2 of real or complex numbers."""
    return x.real**2 + x.imag**2 if jnp.iscomplexobj(x) else x**2


def _outer(e: Any, table: Array) -> Array:
    """Products of numbers (...) and entries of a table (2, 2)."""
    return e[..., None, None] * table.reshape(*(1,) * jnp.ndim(e), 2, 2)


def _by_slopes(table: Array, x: Array) -> Array:
    """The forms x^H table x of slopes x in plane and in flap, (..., 2, k)."""
    return jnp.einsum("...ik,...ij,...jk->...k", x.conj(), table, x)


def _forms(case: _Case, turning: _Turning, x: Shape) -> tuple[Array, Array | None, Array, Array]:
    """The forms x^H M x, x^H G x (None for zero) and x^H K x of k shapes, and the part of the last
    that is strain energy, without springs."""
    profile, length, mass, at_tip = (
        case.profile, case.rotor.beam.length, case.rotor.tip_mass, case.tip(x)
    )  # fmt: skip
    carried = case.total(profile.mass, x.value) + mass * _square(at_tip)
    first, second = profile.in_section_axes(x.curvature[:, -2], x.curvature[:, -1])
    energy = case.total(profile.in_plane / length**3, first)
    energy = energy + case.total(profile.flap / length**3, second)
    gyroscopic = None
    if x.value.shape[1] > 2:  # shapes have axial motion
        energy = energy + case.total(profile.axial / length, x.slope[:, 0])
        swept = case.total(profile.mass, x.value[:, 1], x.value[:, 0])
        swept = swept + mass * at_tip[1].conj() * at_tip[0]
        gyroscopic = 2 * case.speed * (swept - swept.conj())
    geometric = case.total(case.pull / length, x.slope[:, -2:]).sum(0)
    m, k = carried.sum(0), energy - case.speed**2 * carried[:-1].sum(0) + geometric
    bends, bent = x.slope[:, -2:], x.curvature[:, -2:]
    if (body := turning.body) is not None:
        m = m + _by_slopes(body.inertia, x.tip_slope[-2:])
        k = k + _by_slopes(body.stiffness, x.tip_slope[-2:])
    if (sections := turning.sections) is not None:
        m = m + case.span.total(_by_slopes(sections.inertia, bends))
        k = k + case.span.total(_by_slopes(sections.stiffness, bends))
    if turning.wound is not None:
        phi = (bends[:, 0].conj() * bent[:, 1] - bends[:, 1].conj() * bent[:, 0]).real
        k = k + case.span.total(turning.wound[:, None] * phi)
    for root, spring in zip(x.root[-2:], case.rotor.springs, strict=True):
        if spring is not None:
            k = k + spring / length**2 * _square(root)
    return m, gyroscopic, k, energy


def _left_out(case: _Case, turning: _Turning, x: Shape, square: Array, eigenvalue: Array) -> Shape:
    """The shape d that functions leave out of modes x, by its curvature d'' = C m - k."""
    profile, span, length = case.profile, case.span, case.rotor.beam.length
    swings, drags = square - case.speed**2, 2 * case.speed * eigenvalue

    def inertia(moved: Array) -> list[Array]:
        """Inertia forces over the mass by displacements (..., 3 or 2, k), in each direction."""
        swing, drag, own = (
            a.reshape(*(1,) * (moved.ndim - 2), -1) for a in (swings, drags, square)
        )
        *stretch, in_plane, flap = (moved[..., way, :] for way in range(moved.shape[-2]))
        if not stretch:
            return [-swing * in_plane, -own * flap]
        (along,) = stretch
        return [drag * in_plane - swing * along, -drag * along - swing * in_plane, -own * flap]

    at_tip = [case.rotor.tip_mass * force for force in inertia(case.tip(x))]
    # Inertia forces of the mass outboard of each point: integrals of displacements times mass.
    carried = inertia(span.beyond(_times(profile.mass[:, None, None], x.value)))
    arm = case.rotor.tip_body.centre(1 - span.xi, 1.0, length)
    bends = x.slope[:, -2:]
    moment = span.beyond(
        length * jnp.stack(carried[-2:], 1) - _times(case.pull[:, None, None], bends)
    )
    moment = moment + length * jnp.stack(at_tip[-2:])[None] * arm[:, None, None]
    moment = moment - length * _turned(case, turning, x, square)
    bent = length**2 * _curvatures(case, moment) - x.curvature[:, -2:]
    bent = bent * np.sign(case.counts[1:])[None, :, None]
    in_section_axes = span.up_to(bent)
    none = jnp.zeros_like(x.tip)
    slope_there = none.at[-2:].set(span.total(bent))
    slope, curvature, value = in_section_axes, bent, span.up_to(in_section_axes)
    if x.value.shape[1] > 2:
        strain = moved = jnp.zeros_like(bent[:, :1])
        if case.counts[0]:
            pulled = (carried[0] + at_tip[0][None])[:, None]
            strain = length / profile.axial[:, None, None] * pulled - x.slope[:, :1]
            moved = span.up_to(strain)
        slope, curvature, value = (
            jnp.concatenate(both, 1)
            for both in ((strain, slope), (0 * strain, curvature), (moved, value))
        )
    return Shape(value, slope, curvature, span.total(slope), slope_there, none)


def _turned(case: _Case, turning: _Turning, x: Shape, square: Array) -> Any:
    """Bending moments (p, 2, k) by rotary inertia, over the length."""
    span, bends, bent = case.span, x.slope[:, -2:], x.curvature[:, -2:]
    out = jnp.zeros_like(bends)
    if (sections := turning.sections) is not None:
        held = sections.inertia @ (square[None, None] * bends) + sections.stiffness @ bends
        out = out + span.beyond(held)
    if (body := turning.body) is not None:
        slope_there = x.tip_slope[-2:]
        held = body.inertia @ (square[None] * slope_there) + body.stiffness @ slope_there
        out = out + held[None]
    if turning.wound is not None:
        wound = turning.wound[:, None, None]
        both = (wound * bends - span.beyond(wound * bent)) / 2
        out = out - both[:, ::-1] * np.array([[[1.0], [-1.0]]])
    return out


def _curvatures(case: _Case, moment: Array) -> Array:
    """Curvatures by moments in plane and in flap (p, 2, k), or in the one direction that bends."""
    own, across = case.profile.compliances
    if across is not None and not all(case.counts[1:]):
        # The stiffness c^2 EI_zz + s^2 EI_yy is EI_zz EI_yy times the other direction's compliance.
        stiff = case.profile.in_plane * case.profile.flap
        own, across = [1 / (stiff * c) for c in own[::-1]], None
    bent = jnp.stack(own, 1)[:, :, None] * moment
    return bent if across is None else bent + across[:, None, None] * moment[:, ::-1]
