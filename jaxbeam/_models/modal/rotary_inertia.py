"""Rotary inertia of sections and of a body at the tip in Cartesian models, whose directors d_k and
second moments E_kl are those of `bases/rotary.py`, by integrals over slopes.

With S = omega~ and W = S S + omega'~, equations of motion have these terms more,

    F(1) q'' + F(2 S) q' + (F(W) + P(W)) q + c(W), where
    c(B): derivatives by q of sum E_kl d_k.B a_l, d_k to first order in slopes,
    F(B): second derivatives of sum E_kl d_k.B d_l / 2, d_k to first order,
    P(B): second derivatives of sum E_kl d_k.B a_l, d_k to second order.
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
    """Integrals of slopes f' over the span by one weight, such as a second moment of mass."""

    slopes: Any  # (n,), int f'
    products: Any  # (n, n), int f' f'
    winding: Any  # (n, n), of the turn phi about the tangent: phi = q . winding q / 2


class RotaryInertia(eqx.Module):
    """Rotary inertia in the n coordinates of a model: integrals for E_kl that are not zero."""

    moments: SecondMoments  # E_kl of the whole beam, kg m^2
    slopes: SecondMoments  # (n,) each, int E_kl f' / L
    products: SecondMoments  # (n, n) each, int E_kl f' f' / L^2
    winding: SecondMoments | None  # (n, n) each; None in a theory of first order
    counts: FunctionCounts = eqx.field(static=True)

    @classmethod
    def _scaled(
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
        """Rotary inertia of sections, by the functions along a rotor's beam; None if there is
        none."""
        beam, span = rotor.beam, shapes.span
        if beam.is_uniform:
            per_length = of_sections(rotor, lambda value: value)
            if per_length is None:
                return None
            unit = _integrals(shapes, span.weight, 1 - span.xi)
            moments = SecondMoments(*(None if e is None else beam.length * e for e in per_length))
            integrals = SecondMoments(
                *(None if e is None else _Integrals(*(e * a for a in unit)) for e in moments)
            )
            return cls._scaled(moments, integrals, rotor, shapes, to_second_order)
        per_length = of_sections(rotor, functools.partial(on, span=span))
        if per_length is None:
            return None
        per_x = [None if e is None else beam.length * e for e in per_length]
        moments = SecondMoments(*(None if e is None else span.total(e) for e in per_x))
        integrals = SecondMoments(
            *(
                None if e is None else _integrals(shapes, span.weight * e, span.beyond(e))
                for e in per_x
            )
        )
        return cls._scaled(moments, integrals, rotor, shapes, to_second_order)

    @classmethod
    def of_body(cls, rotor: Rotor, shapes: Shapes, to_second_order: bool) -> Self | None:
        """Rotary inertia of a body at the tip, by the functions along a beam; None without one."""
        moments = of_body(rotor)
        if moments is None:
            return None
        slope, span = shapes.ends.tip_slope, shapes.span
        unit = _Integrals(slope, slope[:, None] * slope[None], _winding(shapes, span.weight))
        integrals = SecondMoments(
            *(None if e is None else _Integrals(*(e * a for a in unit)) for e in moments)
        )
        return cls._scaled(moments, integrals, rotor, shapes, to_second_order)

    def __add__(self, other: "RotaryInertia") -> "RotaryInertia":
        def total(a: SecondMoments, b: SecondMoments) -> SecondMoments:
            return SecondMoments(
                *(y if x is None else x if y is None else x + y for x, y in zip(a, b, strict=True))
            )

        winding = None
        if self.winding is not None and other.winding is not None:
            winding = total(self.winding, other.winding)
        return RotaryInertia(
            total(self.moments, other.moments), total(self.slopes, other.slopes),
            total(self.products, other.products), winding, self.counts,
        )  # fmt: skip

    @property
    def mass(self) -> Matrix:
        """Rotary part F(1) of the mass matrix."""
        return self._from_products(first_order(self._identity))

    @property
    def rigid(self) -> Matrix:
        """Moments of inertia of the undeformed beam, kg m^2."""
        inertia: Matrix = self.moments.rigid
        return inertia

    def force(self, hub: Hub, q: Vector, v: Vector) -> Vector:
        """Generalised force -d/dt dT/dq' + dT/dq of rotary inertia, without -F(1) q'', which the
        mass matrix has."""
        stiffness, damping = self.tangents(hub)
        out = -self._constant(hub_matrices(hub)[0]) - matvec_once(stiffness, q)
        return out if damping is None else out - matvec_once(damping, v)

    def tangents(self, hub: Hub) -> tuple[Matrix, Matrix | None]:
        """Stiffness and damping: minus the derivatives of `force` by q and q'."""
        w, coriolis = hub_matrices(hub)
        stiffness = self._from_products(first_order(w)) + self._second_order(w)
        # Sections have no damping: first_order(2 omega~) is not zero for E_11 alone, of a body.
        lies_along = self.products.along is not None
        return stiffness, self._from_products(first_order(coriolis)) if lies_along else None

    def energy(self, q: Vector, v: Vector, spin: Triple) -> Number:
        """Kinetic energy to second order, without that of the rigid beam."""
        spin_matrix = skew(spin)
        centrifugal = matmul(spin_matrix.swapaxes(0, 1), spin_matrix)
        out = pairwise_sum(self._constant(spin_matrix) * v) + pairwise_sum(
            self._constant(centrifugal) * q
        )
        out = out + pairwise_sum(v * matvec_once(self.mass, v)) / 2
        gyroscopic, stiffness = (
            self._from_products(first_order(b)) + self._second_order(b)
            for b in (spin_matrix, centrifugal)
        )
        return (
            out
            + pairwise_sum(v * matvec_once(gyroscopic, q))
            + pairwise_sum(q * matvec_once(stiffness, q)) / 2
        )

    def momentum(
        self, functions: Functions, length: Number, span: Span, moments: SecondMoments, q: Vector,
        v: Vector, spin: Triple,
    ) -> Float[Array, "p 3"]:  # fmt: skip
        """Angular momentum per length of sections about their centres at the points of a span, by
        their second moments and the functions there."""
        bending = one_hots(self.counts)[:, 1:]
        curvature = jnp.where(bending.any(1), functions.curvature, 0.0)

        def turned_directors(q: Vector) -> Array:
            lag, flap = (functions.slope @ (bending * q[:, None]) / length).T
            if self.winding is None:
                return directors(lag, flap, None)
            by_lag, by_flap = (curvature @ (bending * q[:, None]) / length).T
            phi = span.up_to((lag * by_flap - flap * by_lag)[:, None])[:, 0] / 2
            return directors(lag, flap, phi)

        turned, rate = jax.jvp(turned_directors, (q,), (v,))
        return angular_momentum(moments, turned, rate, spin)

    @property
    def _identity(self) -> Array:
        some = next(e for e in self.moments if e is not None)
        return jnp.asarray(append_axes(np.eye(3), some.ndim)) * jnp.ones_like(some)

    def _constant(self, b: Array) -> Vector:
        """Derivatives c(B), by coordinates, of sum E_kl d_k.B a_l with directors d_k to first
        order."""
        rows = append_axes(one_hots(self.counts)[:, 1:], b.ndim - 2)
        each = zip(self.slopes, constant(b), strict=True)
        terms = [s * (rows[:, 0] * c[0] + rows[:, 1] * c[1]) for s, c in each if s is not None]
        return functools.reduce(jnp.add, terms)

    def _from_products(self, squares: tuple[Array, ...]) -> Matrix:
        """The sum over E_kl of integrals of products of slopes, by factors (2, 2) for slopes in
        plane and in flap."""
        rows = append_axes(one_hots(self.counts)[:, 1:], squares[0].ndim - 2)
        terms = [
            table * matmul(matmul(rows, square), rows.swapaxes(0, 1))
            for table, square in zip(self.products, squares, strict=True)
            if table is not None
        ]
        return functools.reduce(jnp.add, terms)

    def _second_order(self, b: Array) -> Matrix | float:
        """Second derivatives P(B), by coordinates, of sum E_kl d_k.B a_l with directors d_k to
        second order."""
        if self.winding is None:
            return 0.0
        out = self._from_products(second_order(b))
        present = [k for k, table in enumerate(self.winding[1:]) if table is not None]
        tables = jnp.stack([self.winding[1 + k] for k in present])
        return out + weighted_sum(by_winding(b)[np.array(present)], tables)


def of_rotor(
    rotor: Rotor, shapes: Shapes, to_second_order: bool
) -> tuple[RotaryInertia | None, RotaryInertia | None]:
    """Rotary inertia of sections and body together, and of the body alone."""
    sections = RotaryInertia.of_sections(rotor, shapes, to_second_order)
    body = RotaryInertia.of_body(rotor, shapes, to_second_order)
    if sections is None or body is None:
        return (body if sections is None else sections), body
    return sections + body, body


def _integrals(shapes: Shapes, weight: Any, beyond: Any) -> _Integrals:
    """Integrals of slopes by a weight at the points of a span; `beyond` is the integral of the
    weight from each point to the tip."""
    slope = shapes.at.slope * _is_bending(shapes.counts)[None]
    products = symmetric_part(slope.T @ (weight[:, None] * slope))
    return _Integrals(weight @ slope, products, _winding(shapes, shapes.span.weight * beyond))


def _winding(shapes: Shapes, weight: Any) -> Float[Array | np.ndarray, "n n"]:
    """The matrix of int weight (e2 e3' - e3 e2') dx, symmetric, with slopes e2 and e3."""
    one_hot, f = one_hots(shapes.counts), shapes.at
    # The curvature of axial functions may be infinite at the clamp, and is not needed.
    where = jnp.where if isinstance(f.curvature, jax.Array) else np.where
    curvature = where(one_hot[None, :, 0] > 0, 0.0, f.curvature)
    lag, flap = one_hot[:, 1], one_hot[:, 2]
    mixed = f.slope.T @ (weight[:, None] * curvature)
    mixed = mixed * (np.outer(lag, flap) - np.outer(flap, lag))
    return symmetric_part(mixed)


def _is_bending(counts: FunctionCounts) -> np.ndarray:
    return one_hots(counts)[:, 1:].sum(1)
