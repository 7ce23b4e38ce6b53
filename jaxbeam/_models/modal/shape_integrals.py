"""Integrals over the functions of a Cartesian model, all directions side by side.

For a uniform beam they are tables for a unit beam, in NumPy, computed once. Where properties vary
along the span, the same integrals are weighted: by mass per length over the mass in the place of
one, and by the stiffness at each point.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.basis import Basis, bending_integrals, stretch_integrals
from jaxbeam._models.bases.loads import FunctionCounts, Profile, in_beam_axes
from jaxbeam._models.bases.shapes import COMPONENTS, Shapes, all_functions, ends_of
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.span import outboard
from jaxbeam._types import Matrix


class ShapeIntegrals(NamedTuple):
    """Integrals of n functions f(xi) over a beam of unit length and mass, and values at its ends.

    The weights t_k of tension are 1, 1 - xi and (1 - xi^2) / 2 for a uniform beam.
    """

    one_hot: Float[np.ndarray, "n 3"]  # 1 in the column of the direction of each coordinate
    tip: Any  # (n,), f(1)
    tip_slope: Any  # (n,), f'(1) of bending functions, zero for axial ones
    root: Any  # (n,), f'(0) of bending functions, zero for axial ones
    elastic: Any  # (3, n, n), int f' f' axial, int f'' f'' in plane and flap; None if not uniform
    gram: Any  # (n, n), int f f
    mean: Any  # (n,), int f
    first: Any  # (n,), int xi f
    tension: Any  # (3, n, n), int t_k f' f' of bending functions, zero for axial ones
    axial_tension: Any  # (3, n, n), int t_k f' f' of axial functions, zero for bending ones


def one_hots(counts: FunctionCounts) -> Float[np.ndarray, "n 3"]:
    """Rows of the unit matrix: 1 in the column of a coordinate's direction."""
    return np.eye(3)[np.repeat(np.arange(3), counts)]


@functools.lru_cache(maxsize=64)
def shape_integrals(basis: Basis, counts: FunctionCounts) -> ShapeIntegrals:
    """Integrals over a uniform beam for `counts` functions of a basis, in NumPy."""
    direction = np.repeat(np.arange(3), counts)
    one_hot = np.eye(3)[direction]
    xi, w = basis.quadrature(max(counts))
    f = all_functions(basis, counts, xi).value
    gram = f.T @ (w[:, None] * f)
    elastic, tension, axial_tension = (
        np.zeros((3, direction.size, direction.size)) for _ in range(3)
    )
    for k, n in enumerate(counts):
        if n == 0:
            continue
        rows = np.ix_(direction == k, direction == k)
        integrals = (
            stretch_integrals(basis, n)
            if k == 0
            else bending_integrals(basis.towards(COMPONENTS[k]), n)
        )
        gram[rows] = integrals.mass
        elastic[k][rows] = integrals.tension[0] if k == 0 else integrals.curvature
        for table, whole in zip(
            integrals.tension, axial_tension if k == 0 else tension, strict=True
        ):
            whole[rows] = table
    ends = ends_of(basis, counts)
    return ShapeIntegrals(
        one_hot=one_hot,
        tip=ends.tip,
        tip_slope=ends.tip_slope,
        root=ends.root,
        elastic=elastic,
        gram=symmetric_part(gram),
        mean=w @ f,
        first=(w * xi) @ f,
        tension=tension,
        axial_tension=axial_tension,
    )


def weighted(shapes: Shapes, rotor: Rotor) -> ShapeIntegrals:
    """Integrals over a beam whose properties vary, by its mass; `elastic` is None."""
    span, f = shapes.span, shapes.at
    one_hot = one_hots(shapes.counts)
    mass_share, *beyond = outboard(rotor.beam.mass_with_points, span)
    mass_share = span.weight * mass_share
    tension_weights = span.weight[None] * jnp.stack([jnp.ones_like(mass_share), *beyond])
    axial, *bending = (
        _grams(slopes, tension_weights) for slopes in _by_direction(f.slope, shapes.counts)
    )
    zeros = [jnp.zeros_like(gram) for gram in (axial, *bending)]
    return ShapeIntegrals(
        one_hot=one_hot,
        tip=shapes.ends.tip,
        tip_slope=shapes.ends.tip_slope,
        root=shapes.ends.root,
        elastic=None,
        gram=_gram(f.value, mass_share),
        mean=mass_share @ f.value,
        first=(mass_share * span.xi) @ f.value,
        tension=_side_by_side([zeros[0], *bending]),
        axial_tension=_side_by_side([axial, *zeros[1:]]),
    )


def linear_stiffness(basis: Basis, counts: FunctionCounts, rotor: Rotor) -> Matrix:
    """EA int f' f' dx axially, EI int f'' f'' dx in bending (Y eqs. 9 and 10), of a uniform beam,
    and the springs at the root."""
    beam, length, unit = rotor.beam, rotor.beam.length, shape_integrals(basis, counts)
    rigidity = (
        beam.axial_stiffness / length,
        beam.in_plane_bending_stiffness / length**3,
        beam.flap_bending_stiffness / length**3,
    )
    out = jnp.tensordot(jnp.stack(rigidity), unit.elastic, 1)
    return out + springs(unit.root, unit.one_hot, rotor)


def varying_stiffness(shapes: Shapes, rotor: Rotor) -> Matrix:
    """Stiffness of a beam that varies along the span, or whose sections are turned.

    With the axes of the section turned by theta, twist and pitch together, bending has
    EI_vv = EI_zz c^2 + EI_yy s^2 and EI_ww = EI_yy c^2 + EI_zz s^2, c = cos(theta) and so on, and
    EI_vw = (EI_zz - EI_yy) s c between the two directions.
    """
    length, span, f, counts = rotor.beam.length, shapes.span, shapes.at, shapes.counts
    profile, weight = Profile.of(rotor, span), span.weight
    stretch = _by_direction(f.slope, counts)[0]
    _, in_plane_curvature, flap_curvature = _by_direction(f.curvature, counts)
    (in_plane, flap), coupling = in_beam_axes(profile.in_plane, profile.flap, profile.section_axes)
    blocks = [
        _gram(stretch, weight * profile.axial / length),
        _gram(in_plane_curvature, weight * in_plane / length**3),
        _gram(flap_curvature, weight * flap / length**3),
    ]
    out = jax.scipy.linalg.block_diag(*blocks)
    if coupling is not None:
        crossed = in_plane_curvature.T @ ((weight * coupling / length**3)[:, None] * flap_curvature)
        start = (counts[0], counts[0] + counts[1])
        upper = jax.lax.dynamic_update_slice(jnp.zeros_like(out), crossed, start)
        out = out + upper + upper.T
    return out + springs(shapes.ends.root, one_hots(counts), rotor)


def springs(root: Any, one_hot: np.ndarray, rotor: Rotor) -> Any:
    """Stiffness of the springs at the root: energy k phi^2 / 2, phi = f'(0) q / L."""
    out: Any = 0.0
    for k, spring in enumerate(rotor.springs, start=1):
        if spring is not None:
            slope = root * one_hot[:, k]
            out = out + spring / rotor.beam.length**2 * slope[:, None] * slope[None]
    return out


def _by_direction(columns: Array, counts: FunctionCounts) -> list[Array]:
    """Functions (p, n) of all coordinates as axial, in-plane and flap columns."""
    return jnp.split(columns, np.cumsum(counts)[:-1], 1)


def _grams(f: Array, weights: Array) -> Array:
    """Integrals (w, n, n) of products of functions (p, n) under w weights (w, p), as one product
    of matrices."""
    weighed = jnp.moveaxis(weights, 0, 1)[:, :, None] * f[:, None]
    products = (f.T @ weighed.reshape(len(f), -1)).reshape(f.shape[1], len(weights), f.shape[1])
    return jax.vmap(symmetric_part, 1)(products)


def _side_by_side(blocks: list[Array]) -> Array:
    """Block-diagonal matrices (w, n, n) of the blocks (w, k, k) of each direction."""
    return jax.vmap(lambda *each: jax.scipy.linalg.block_diag(*each))(*blocks)


def _gram(f: Any, weight: Any) -> Any:
    product = f.T @ (weight[:, None] * f)
    return symmetric_part(product)
