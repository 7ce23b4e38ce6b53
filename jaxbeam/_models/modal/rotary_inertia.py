"""Rotary inertia of sections and of a body at the tip in Cartesian models: `bases/rotary.py`, by
integrals over slopes.

With B = 1, S = omega~ and W = S S + omega'~ for what acts on directors, and

    c(B) = sum E_kl d_k.B a_l,  by slopes,    F(B) = sum E_kl d_k.B d_l,  by two slopes,
    P(B) = sum E_kl d_k.B a_l,  of the directors' second order, twice,

equations of motion have F(1) q'' + F(2 S) q' + (F(W) + P(W)) q + c(W) = 0 more.
"""

import functools
from typing import Any, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.basis import Functions
from jaxbeam._models.bases.loads import FunctionCounts
from jaxbeam._models.bases.rotary import (
    SecondMoments,
    angular_momentum,
    by_winding,
    constant,
    directors,
    first_order,
    of_body,
    of_sections,
    second_order,
)
from jaxbeam._models.bases.shapes import Shapes
from jaxbeam._models.modal.shape_integrals import one_hots
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._programs.lanes import append_axes, matmul, matvec_once, pairwise_sum, weighted_sum
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.motion import Hub, hub_matrices, skew
from jaxbeam._rotor.span import Span, on
from jaxbeam._types import Matrix, Number, Triple, Vector


class _Integrals(NamedTuple):
    """Integrals by one weight."""

    slopes: Any  # (n,)
    products: Any  # (n, n), of slopes
    winding: Any  # (n, n), phi = q . winding q / 2


class RotaryInertia(eqx.Module):
    """Rotary inertia by the coordinates q of a model, of those E_kl that are not zero."""

    moments: SecondMoments  # of the whole
    slopes: SecondMoments  # (n,) each
    products: SecondMoments  # (n, n) each
    winding: SecondMoments | None  # (n, n) each; None in a theory of first order
    counts: FunctionCounts = eqx.field(static=True)

    @classmethod
    def _by(
        cls, moments: SecondMoments, integrals: SecondMoments, rotor: Rotor, shapes: Shapes,
        to_second_order: bool,
    ) -> Self:  # fmt: skip
        def each(name: str, power: int) -> SecondMoments:
            scale = rotor.beam.length**-power
            found = (None if a is None else scale * getattr(a, name) for a in integrals)
            return SecondMoments(*found)

        winding = each("winding", 2) if to_second_order else None
        return cls(moments, each("slopes", 1), each("products", 2), winding, shapes.counts)

    @classmethod
    def of_sections(cls, rotor: Rotor, shapes: Shapes, to_second_order: bool) -> Self | None:
        """Rotary inertia of sections, by the functions along a rotor's beam; None for nothing."""
        beam, span = rotor.beam, shapes.span
        if beam.is_uniform:
            each = of_sections(rotor, lambda value: value)
            if each is None:
                return None
            unit = _integrals(shapes, span.weight, 1 - span.xi)
            moments = SecondMoments(*(None if e is None else beam.length * e for e in each))
            integrals = SecondMoments(
                *(None if e is None else _Integrals(*(e * a for a in unit)) for e in moments)
            )
            return cls._by(moments, integrals, rotor, shapes, to_second_order)
        each = of_sections(rotor, functools.partial(on, span=span))
        if each is None:
            return None
        along = [None if e is None else beam.length * e for e in each]
        moments = SecondMoments(*(None if e is None else span.total(e) for e in along))
        integrals = SecondMoments(
            *(
                None if e is None else _integrals(shapes, span.weight * e, span.beyond(e))
                for e in along
            )
        )
        return cls._by(moments, integrals, rotor, shapes, to_second_order)

    @classmethod
    def of_body(cls, rotor: Rotor, shapes: Shapes, to_second_order: bool) -> Self | None:
        """Rotary inertia of a body at the tip, by the functions along a beam; None for nothing."""
        moments = of_body(rotor)
        if moments is None:
            return None
        slope, span = shapes.ends.tip_slope, shapes.span
        unit = _Integrals(slope, slope[:, None] * slope[None], _winding(shapes, span.weight))
        integrals = SecondMoments(
            *(None if e is None else _Integrals(*(e * a for a in unit)) for e in moments)
        )
        return cls._by(moments, integrals, rotor, shapes, to_second_order)

    def __add__(self, other: "RotaryInertia") -> "RotaryInertia":
        def both(a: SecondMoments, b: SecondMoments) -> SecondMoments:
            return SecondMoments(
                *(y if x is None else x if y is None else x + y for x, y in zip(a, b, strict=True))
            )

        winding = None
        if self.winding is not None and other.winding is not None:
            winding = both(self.winding, other.winding)
        return RotaryInertia(
            both(self.moments, other.moments), both(self.slopes, other.slopes),
            both(self.products, other.products), winding, self.counts,
        )  # fmt: skip

    @property
    def mass(self) -> Matrix:
        """Part of the mass matrix."""
        return self._of_products(first_order(self._unit))

    @property
    def rigid(self) -> Matrix:
        """Moments of inertia of the undeformed beam, kg m^2."""
        inertia: Matrix = self.moments.rigid
        return inertia

    def force(self, hub: Hub, q: Vector, v: Vector) -> Vector:
        """-d/dt dT/dq' + dT/dq, but for what the mass matrix says."""
        stiffness, damping = self.tangents(hub)
        out = -self._constant(hub_matrices(hub)[0]) - matvec_once(stiffness, q)
        return out if damping is None else out - matvec_once(damping, v)

    def tangents(self, hub: Hub) -> tuple[Matrix, Matrix | None]:
        """Stiffness and damping: minus the derivatives of `force` by q and q'."""
        w, coriolis = hub_matrices(hub)
        stiffness = self._of_products(first_order(w)) + self._of_second_order(w)
        # Of sections alone nothing: first_order(2 omega~) has E_11 alone.
        lies_along = self.products.along is not None
        return stiffness, self._of_products(first_order(coriolis)) if lies_along else None

    def energy(self, q: Vector, v: Vector, spin: Triple) -> Number:
        """Kinetic energy to second order, without that of the rigid beam."""
        spun = skew(spin)
        square = matmul(spun.swapaxes(0, 1), spun)
        out = pairwise_sum(self._constant(spun) * v) + pairwise_sum(self._constant(square) * q)
        out = out + pairwise_sum(v * matvec_once(self.mass, v)) / 2
        moved, held = (
            self._of_products(first_order(b)) + self._of_second_order(b) for b in (spun, square)
        )
        return (
            out
            + pairwise_sum(v * matvec_once(moved, q))
            + pairwise_sum(q * matvec_once(held, q)) / 2
        )

    def momentum(
        self, at: Functions, length: Number, span: Span, moments: SecondMoments, q: Vector,
        v: Vector, spin: Triple,
    ) -> Float[Array, "p 3"]:  # fmt: skip
        """Angular momentum of sections about their centres at the points of a span, by their second
        moments there and the functions `at` these."""
        bends = one_hots(self.counts)[:, 1:]
        curvature = jnp.where(bends.any(1), at.curvature, 0.0)

        def turned(q: Vector) -> Array:
            lag, flap = (at.slope @ (bends * q[:, None]) / length).T
            if self.winding is None:
                return directors(lag, flap, None)
            by_lag, by_flap = (curvature @ (bends * q[:, None]) / length).T
            phi = span.up_to((lag * by_flap - flap * by_lag)[:, None])[:, 0] / 2
            return directors(lag, flap, phi)

        own, rate = jax.jvp(turned, (q,), (v,))
        return angular_momentum(moments, own, rate, spin)

    @property
    def _unit(self) -> Array:
        some = next(e for e in self.moments if e is not None)
        return jnp.asarray(append_axes(np.eye(3), some.ndim)) * jnp.ones_like(some)

    def _constant(self, b: Array) -> Vector:
        """c(B) of the module's docstring."""
        rows = append_axes(one_hots(self.counts)[:, 1:], b.ndim - 2)
        each = zip(self.slopes, constant(b), strict=True)
        parts = [s * (rows[:, 0] * c[0] + rows[:, 1] * c[1]) for s, c in each if s is not None]
        return functools.reduce(jnp.add, parts)

    def _of_products(self, squares: tuple[Array, ...]) -> Matrix:
        """The sum of products of slopes by what each E_kl has of them, (2, 2)."""
        rows = append_axes(one_hots(self.counts)[:, 1:], squares[0].ndim - 2)
        parts = [
            table * matmul(matmul(rows, square), rows.swapaxes(0, 1))
            for table, square in zip(self.products, squares, strict=True)
            if table is not None
        ]
        return functools.reduce(jnp.add, parts)

    def _of_second_order(self, b: Array) -> Matrix | float:
        """P(B) of the module's docstring."""
        if self.winding is None:
            return 0.0
        out = self._of_products(second_order(b))
        there = [k for k, table in enumerate(self.winding[1:]) if table is not None]
        tables = jnp.stack([self.winding[1 + k] for k in there])
        return out + weighted_sum(by_winding(b)[np.array(there)], tables)


def of_rotor(
    rotor: Rotor, shapes: Shapes, to_second_order: bool
) -> tuple[RotaryInertia | None, RotaryInertia | None]:
    """Rotary inertia of sections and a body together, and of the body."""
    sections = RotaryInertia.of_sections(rotor, shapes, to_second_order)
    body = RotaryInertia.of_body(rotor, shapes, to_second_order)
    if sections is None or body is None:
        return (body if sections is None else sections), body
    return sections + body, body


def _integrals(shapes: Shapes, weight: Any, beyond: Any) -> _Integrals:
    """Integrals by a weight at the points of a span, `beyond` being its own integral from each to
    the tip."""
    slope = shapes.at.slope * _bends(shapes.counts)[None]
    products = symmetric_part(slope.T @ (weight[:, None] * slope))
    return _Integrals(weight @ slope, products, _winding(shapes, shapes.span.weight * beyond))


def _winding(shapes: Shapes, weight: Any) -> Matrix:
    """int beyond (e2 e3' - e3 e2') dx, symmetric."""
    one_hot, f = one_hots(shapes.counts), shapes.at
    # Axial functions may have no curvature at the clamp: nobody asks for it.
    where = jnp.where if isinstance(f.curvature, jax.Array) else np.where
    curvature = where(one_hot[None, :, 0] > 0, 0.0, f.curvature)
    lag, flap = one_hot[:, 1], one_hot[:, 2]
    mixed = f.slope.T @ (weight[:, None] * curvature)
    mixed = mixed * (np.outer(lag, flap) - np.outer(flap, lag))
    return symmetric_part(mixed)


def _bends(counts: FunctionCounts) -> np.ndarray:
    return one_hots(counts)[:, 1:].sum(1)
