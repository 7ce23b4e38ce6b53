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

COMPONENTS = tuple(Direction)[:3]  # of displacements


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
    mixes: Mixes | None  # of loads; None of the functions of a basis
    counts: FunctionCounts = eqx.field(static=True)
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


def all_functions(basis: Basis, counts: FunctionCounts, xi: Any) -> Functions:
    """All functions of a basis side by side, at points xi."""
    parts = [basis.stretch(counts[0], xi)] if counts[0] else []
    ways = zip(COMPONENTS[1:], counts[1:], strict=True)
    parts += [basis.towards(direction).bending(n, xi) for direction, n in ways if n]
    return Functions(*(np.concatenate(same, 1) for same in zip(*parts, strict=True)))


@functools.lru_cache(maxsize=64)
def shortening(basis: Basis, counts: FunctionCounts, xi: tuple[float, ...]) -> np.ndarray:
    """Shortening by the functions of a basis."""
    # Rescaled to [0, xi], a rule stays exact for smooth functions.
    rules = [basis.up_to(max(counts), end) for end in xi]
    points, w = np.stack([rule[0] for rule in rules]), np.stack([rule[1] for rule in rules])
    # All of them at once: of polynomials the recurrences take much longer than the values.
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
    """All functions of a basis at the points of its rule that stops at edges, in NumPy."""
    span = basis.rule(products, edges)
    ends = ends_of(basis, counts)
    return Shapes(span, all_functions(basis, counts, span.xi), ends, None, counts, basis)


def ends_of(basis: Basis, counts: FunctionCounts) -> EndValues:
    """Values and slopes of the functions of a basis at the ends."""
    bends = np.repeat(np.arange(3), counts) > 0
    tip = all_functions(basis, counts, np.ones(1))
    # Axial functions may have no slope at the clamp: nobody asks for it.
    root = all_functions(basis, counts, np.zeros(1)).slope[0]
    return EndValues(tip.value[0], np.where(bends, tip.slope[0], 0.0), np.where(bends, root, 0.0))


def shapes_on(kind: Kind, rotor: Rotor) -> Shapes:
    """The functions on a rotor's beam."""
    loads = LoadFunctions.on(kind, rotor, span_of(kind, rotor))
    raw = loads.raw()
    mixes = mixed(loads, raw)
    unit = [jnp.eye(n) for n in kind.counts]
    # What turns the root has no curvature.
    turns = [((0, 0), (len(root), 0)) for root in _at_root(loads, unit)]
    each = zip(raw, mixes, turns, strict=True)
    strains = [columns @ jnp.pad(mix, first) for columns, mix, first in each]
    at, ends = _integrated(loads, strains, unit)
    return Shapes(loads.profile.span, at, ends, mixes, kind.counts)


def _at_root(loads: LoadFunctions, coordinates: Sequence[Array]) -> list[Array]:
    """Coordinates of the functions that turn the root, (0 or 1, k) of each direction."""
    yields = (False, *loads.yields)
    return [q[: int(turns)] for q, turns in zip(coordinates, yields, strict=True)]


def _integrated(
    loads: LoadFunctions, strains: Sequence[Array], coordinates: Sequence[Array]
) -> tuple[Functions, EndValues]:
    """Values along the beam of coordinates of functions, (n, k) by direction, from their strains: k
    axially, k in plane and k in flap, side by side."""
    span, (stretch, *bent) = loads.profile.span, strains
    root = jnp.concatenate([jnp.sum(q, 0) for q in _at_root(loads, coordinates)])
    # Strains are slopes, curvatures become such.
    curvature = jnp.concatenate(bent, 1)
    slope = jnp.concatenate([stretch, span.up_to(curvature)], 1) + root[None]
    tip_slope = jnp.concatenate([jnp.zeros_like(stretch[0]), span.total(curvature)]) + root
    curvature = jnp.concatenate([jnp.zeros_like(stretch), curvature], 1)
    at = Functions(span.up_to(slope), slope, curvature)
    return at, EndValues(span.total(slope), tip_slope, root)


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
    def of(cls, at: Functions, ends: EndValues, ways: int) -> Self:
        """Shapes in so many directions, side by side."""
        return cls(*(a.reshape(*a.shape[:-1], ways, -1) for a in (*at, *ends)))


def shape_of(
    kind: Kind, rotor: Rotor, mixes: Mixes, parts: Sequence[Array], beside: int = 0
) -> tuple[Profile, Shape]:
    """Values of coordinates, by direction, at the points of integration, or at those of `beside`
    more in each segment; those of models without axial functions have to be real."""
    loads = LoadFunctions.on(kind, rotor, span_of(kind, rotor, beside))
    if kind.counts[0]:
        parts = [jnp.concatenate([q.real, q.imag], 1) for q in parts]
    roots = _at_root(loads, parts)
    rest = [q[len(root) :] for q, root in zip(parts, roots, strict=True)]
    strains = loads.strains([mix @ q for mix, q in zip(mixes, rest, strict=True)])
    if not kind.counts[0]:
        # All is real, and nothing moves axially: half of the work, or less.
        strains = (strains[0][:, :0], *strains[1:])
        roots = [roots[0][:, :0], *roots[1:]]
        return loads.profile, Shape.of(*_integrated(loads, strains, roots), 2)
    at, ends = _integrated(loads, strains, roots)

    def joined(a: Array) -> Array:
        sides = a.reshape(*a.shape[:-1], 3, 2, -1)
        return jax.lax.complex(sides[..., 0, :], sides[..., 1, :])

    return loads.profile, Shape(*map(joined, (*at, *ends)))


def of_basis(basis: Basis, counts: FunctionCounts, span: Span, parts: Sequence[Array]) -> Shape:
    """Values on a span of coordinates of the functions of a basis, by direction."""
    moving = parts if counts[0] else parts[1:]
    q = jax.scipy.linalg.block_diag(*moving)
    at, ends = all_functions(basis, counts, span.xi), ends_of(basis, counts)
    # Axial functions may have no curvature at the clamp: nobody asks for it.
    bends = np.repeat(np.arange(3), counts) > 0
    at = at._replace(curvature=np.where(bends, at.curvature, 0.0))
    return Shape.of(Functions(*(a @ q for a in at)), EndValues(*(a @ q for a in ends)), len(moving))


def follows(basis: Basis, rotor: Rotor) -> bool:
    """Whether a basis follows the loads of a beam: polynomials, where the beam varies."""
    return type(basis) is Polynomials and rotor.varies
