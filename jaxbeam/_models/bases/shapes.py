"""Functions along a beam, side by side, and shapes that are made of them."""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.basis import Basis, Functions, Polynomials
from jaxbeam._models.bases.loads import (
    FunctionCounts,
    Kind,
    LoadFunctions,
    Mixes,
    Profile,
    mixed,
    span_of,
)
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.span import Span

COMPONENTS = tuple(Direction)[:3]  # directions of displacements: without torsion


class EndValues(NamedTuple):
    """Values of n functions at the tip, slopes there, and slopes at the root."""

    tip: Any  # (n,)
    tip_slope: Any
    root: Any


class Shapes(eqx.Module):
    """All functions of a model, side by side, at the points of integration of a rotor's beam."""

    span: Span
    at: Functions  # (p, n)
    ends: EndValues
    mixes: Mixes | None  # combinations of loads that functions are; None: functions of a basis
    counts: FunctionCounts = eqx.field(static=True)
    basis: Basis | None = eqx.field(static=True, default=None)

    def places(self, xi: np.ndarray) -> Functions:
        """Values, slopes and curvatures of the functions at any x / L."""
        if self.basis is not None:
            return all_functions(self.basis, self.counts, xi)
        return Functions(*(self.span.interpolated(table, xi) for table in self.at))

    def shortening(self, xi: np.ndarray) -> Float[Array, "p n n"]:
        """Integrals int_0^xi f_a' f_b' of bending functions of the same direction, for a unit beam;
        zero for others."""
        if self.basis is not None:
            return jnp.asarray(shortening(self.basis, self.counts, tuple(xi.tolist())))
        slope = self.at.slope
        products = slope[:, :, None] * slope[:, None] * _bend_alike(self.counts)[None]
        return self.span.interpolated(self.span.up_to(products), xi)


def all_functions(basis: Basis, counts: FunctionCounts, xi: Any) -> Functions:
    """All functions of a basis side by side, at points xi."""
    parts = [basis.stretch(counts[0], xi)] if counts[0] else []
    ways = zip(COMPONENTS[1:], counts[1:], strict=True)
    parts += [basis.towards(direction).bending(n, xi) for direction, n in ways if n]
    return Functions(*(np.concatenate(same, 1) for same in zip(*parts, strict=True)))


@functools.lru_cache(maxsize=64)
def shortening(basis: Basis, counts: FunctionCounts, xi: tuple[float, ...]) -> np.ndarray:
    """Integrals as of `Shapes.shortening` for functions of a basis, at places xi."""
    # The rule for [0, 1], scaled to [0, xi], is exact there too.
    rules = [basis.up_to(max(counts), end) for end in xi]
    points, w = np.stack([rule[0] for rule in rules]), np.stack([rule[1] for rule in rules])
    # Functions at all points at once, since recurrences of polynomials take longer than the values.
    f = all_functions(basis, counts, points.ravel()).slope.reshape(*points.shape, sum(counts))
    return f.swapaxes(1, 2) @ (w[:, :, None] * f) * _bend_alike(counts)


def _bend_alike(counts: FunctionCounts) -> np.ndarray:
    direction = np.repeat(np.arange(3), counts)
    alike: np.ndarray = (direction[:, None] == direction) & (direction > 0)
    return alike


@functools.lru_cache(maxsize=64)
def sampled(
    basis: Basis, counts: FunctionCounts, products: int, edges: tuple[float, ...]
) -> Shapes:
    """All functions of a basis at the points of its quadrature from edge to edge, in NumPy."""
    span = basis.rule(products, edges)
    ends = ends_of(basis, counts)
    return Shapes(span, all_functions(basis, counts, span.xi), ends, None, counts, basis)


def ends_of(basis: Basis, counts: FunctionCounts) -> EndValues:
    """Values and slopes of the functions of a basis at root and tip."""
    bends = np.repeat(np.arange(3), counts) > 0
    tip = all_functions(basis, counts, np.ones(1))
    # The slope of axial functions may be infinite at the clamp, and is not needed.
    root = all_functions(basis, counts, np.zeros(1)).slope[0]
    return EndValues(tip.value[0], np.where(bends, tip.slope[0], 0.0), np.where(bends, root, 0.0))


def shapes_on(kind: Kind, rotor: Rotor) -> Shapes:
    """The functions, deflections by loads, on a rotor's beam that varies."""
    loads = LoadFunctions.on(kind, rotor, span_of(kind, rotor))
    raw = loads.raw()
    mixes = mixed(loads, raw)
    unit = [jnp.eye(n) for n in kind.counts]
    # The function for the slope at a root that yields has no curvature: it comes first, as zeros.
    turns = [((0, 0), (len(root), 0)) for root in _at_root(loads, unit)]
    each = zip(raw, mixes, turns, strict=True)
    strains = [columns @ jnp.pad(mix, first) for columns, mix, first in each]
    at, ends = _integrated(loads, strains, unit)
    return Shapes(loads.profile.span, at, ends, mixes, kind.counts)


def _at_root(loads: LoadFunctions, coordinates: Sequence[Array]) -> list[Array]:
    """Coordinates of the functions for the slope at the root, (0 or 1, k) in plane and in flap."""
    yields = (False, *loads.yields)
    return [q[: int(turns)] for q, turns in zip(coordinates, yields, strict=True)]


def _integrated(
    loads: LoadFunctions, strains: Sequence[Array], coordinates: Sequence[Array]
) -> tuple[Functions, EndValues]:
    """Values along the beam and at its ends, by integration of strains and curvatures: k columns
    each axially, in plane and in flap. `coordinates` (n, k) say what the slopes at the root are."""
    span, (stretch, *bent) = loads.profile.span, strains
    root = jnp.concatenate([jnp.sum(q, 0) for q in _at_root(loads, coordinates)])
    # Strains are slopes of axial displacement; slopes of deflections are integrals of curvatures.
    curvature = jnp.concatenate(bent, 1)
    slope = jnp.concatenate([stretch, span.up_to(curvature)], 1) + root[None]
    tip_slope = jnp.concatenate([jnp.zeros_like(stretch[0]), span.total(curvature)]) + root
    curvature = jnp.concatenate([jnp.zeros_like(stretch), curvature], 1)
    at = Functions(span.up_to(slope), slope, curvature)
    return at, EndValues(span.total(slope), tip_slope, root)


class Shape(NamedTuple):
    """k shapes along a beam, real or complex: axial, in-plane and flap displacements (p, 3, k) at p
    points and (3, k) at the ends, in m, with derivatives by x / L. Shapes without axial motion may
    have the other two directions alone, (p, 2, k)."""

    value: Array
    slope: Array
    curvature: Array
    tip: Array
    tip_slope: Array
    root: Array

    @classmethod
    def of(cls, at: Functions, ends: EndValues, ways: int) -> Self:
        """Shapes from functions and end values whose columns are those of `ways` directions, side
        by side."""
        return cls(*(a.reshape(*a.shape[:-1], ways, -1) for a in (*at, *ends)))


def shape_of(
    kind: Kind, rotor: Rotor, mixes: Mixes, parts: Sequence[Array], beside: int = 0
) -> tuple[Profile, Shape]:
    """Shapes of coordinates `parts`, given by direction, along a beam that varies, with `beside`
    more points of integration in each segment; without axial functions they have to be real."""
    loads = LoadFunctions.on(kind, rotor, span_of(kind, rotor, beside))
    if kind.counts[0]:
        parts = [jnp.concatenate([q.real, q.imag], 1) for q in parts]
    roots = _at_root(loads, parts)
    rest = [q[len(root) :] for q, root in zip(parts, roots, strict=True)]
    strains = loads.strains([mix @ q for mix, q in zip(mixes, rest, strict=True)])
    if not kind.counts[0]:
        # Shapes are real, and have no axial motion: half of the work, or less.
        strains = (strains[0][:, :0], *strains[1:])
        roots = [roots[0][:, :0], *roots[1:]]
        return loads.profile, Shape.of(*_integrated(loads, strains, roots), 2)
    at, ends = _integrated(loads, strains, roots)

    def joined(a: Array) -> Array:
        sides = a.reshape(*a.shape[:-1], 3, 2, -1)
        return jax.lax.complex(sides[..., 0, :], sides[..., 1, :])

    return loads.profile, Shape(*map(joined, (*at, *ends)))


def of_basis(basis: Basis, counts: FunctionCounts, span: Span, parts: Sequence[Array]) -> Shape:
    """Shapes of coordinates `parts`, given by direction, of functions of a basis on a span."""
    moving = parts if counts[0] else parts[1:]
    q = jax.scipy.linalg.block_diag(*moving)
    at, ends = all_functions(basis, counts, span.xi), ends_of(basis, counts)
    # The curvature of axial functions may be infinite at the clamp, and is not needed.
    bends = np.repeat(np.arange(3), counts) > 0
    at = at._replace(curvature=np.where(bends, at.curvature, 0.0))
    return Shape.of(Functions(*(a @ q for a in at)), EndValues(*(a @ q for a in ends)), len(moving))


def follows(basis: Basis, rotor: Rotor) -> bool:
    """Whether functions are deflections by loads: with `Polynomials`, on a beam that varies."""
    return type(basis) is Polynomials and rotor.varies
