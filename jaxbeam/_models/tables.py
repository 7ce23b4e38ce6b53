"""Integrals that Cartesian models are made of, over all functions of a model side by side.

Of a uniform beam they are tables for a unit beam, in NumPy, computed once. Where properties vary
along the span, the same integrals get their weights: mass per length over the mass in the place of
one, stiffness as it is at each point.
"""

import functools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from jaxbeam._models.basis import Basis, bending_integrals, stretch_integrals
from jaxbeam._models.shapes import (
    FAMILIES,
    Counts,
    Profile,
    Shapes,
    all_functions,
    ends_of,
)
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.span import outboard
from jaxbeam._types import Matrix


class Tables(NamedTuple):
    """Integrals over a beam of unit length and mass, and values at its ends."""

    direction: Float[np.ndarray, "n 3"]  # one-hot: which way a coordinate moves
    tip: Any  # (n,)
    turn: Any  # (n,), slope at the tip, of bending functions alone
    root: Any  # (n,), slope at the root, of bending functions alone
    elastic: Any  # (3, n, n), axial f' f', in plane and flap f'' f'', of a uniform beam alone
    gram: Any  # (n, n)
    moment: Any  # (n,)
    first: Any  # (n,), int xi f
    tension: Any  # (3, n, n), bending alone: int t_k f' f', see `Integrals`
    axial_tension: Any  # (3, n, n), the same for the axial coordinates

    def centre(self, rotor: Rotor) -> Any:
        """Values of the functions at the centre of the tip mass, (n,)."""
        if rotor.tip is None:
            return self.tip
        return self.tip + rotor.tip.offset / rotor.beam.length * self.turn


def directions(counts: Counts) -> Float[np.ndarray, "n 3"]:
    """One-hot: which way a coordinate moves, axially, in plane or in flap."""
    return np.eye(3)[np.repeat(np.arange(3), counts)]


@functools.lru_cache(maxsize=64)
def tables(basis: Basis, counts: Counts) -> Tables:
    """Those of a uniform beam, in NumPy."""
    family = np.repeat(np.arange(3), counts)
    direction = np.eye(3)[family]
    xi, w = basis.quadrature(max(counts))
    f = all_functions(basis, counts, xi).value
    gram = f.T @ (w[:, None] * f)
    elastic, tension, axial_tension = (np.zeros((3, family.size, family.size)) for _ in range(3))
    for k, n in enumerate(counts):
        if n == 0:
            continue
        rows = np.ix_(family == k, family == k)
        own = (
            stretch_integrals(basis, n)
            if k == 0
            else bending_integrals(basis.towards(FAMILIES[k]), n)
        )
        gram[rows] = own.mass
        elastic[k][rows] = own.tension[0] if k == 0 else own.curvature
        for table, whole in zip(own.tension, axial_tension if k == 0 else tension, strict=True):
            whole[rows] = table
    ends = ends_of(basis, counts)
    return Tables(
        direction=direction,
        tip=ends.tip,
        turn=ends.turn,
        root=ends.root,
        elastic=elastic,
        gram=(gram + gram.T) / 2,
        moment=w @ f,
        first=(w * xi) @ f,
        tension=tension,
        axial_tension=axial_tension,
    )


def weighted(shapes: Shapes, rotor: Rotor) -> Tables:
    """Those of a beam whose properties vary; `elastic` is left out."""
    span, f = shapes.span, shapes.at
    direction = directions(shapes.counts)
    share, *beyond = outboard(rotor.beam.mass_per_length, span)
    share = span.weight * share
    pulls = [_gram(f.slope, span.weight * shape) for shape in (jnp.ones_like(share), *beyond)]
    alike = direction @ direction.T
    bends = np.outer(direction[:, 0] == 0, direction[:, 0] == 0)
    return Tables(
        direction=direction,
        tip=shapes.ends.tip,
        turn=shapes.ends.turn,
        root=shapes.ends.root,
        elastic=None,
        gram=_gram(f.value, share),
        moment=share @ f.value,
        first=(share * span.xi) @ f.value,
        tension=jnp.stack(pulls) * (alike * bends)[None],
        axial_tension=jnp.stack(pulls) * (alike * ~bends)[None],
    )


def linear_stiffness(basis: Basis, counts: Counts, rotor: Rotor) -> Matrix:
    """EA int f' f' dx axially, EI int f'' f'' dx in bending (Y eqs. 9 and 10), of a uniform beam,
    and the springs at the root."""
    beam, length, known = rotor.beam, rotor.beam.length, tables(basis, counts)
    rigidity = (
        beam.axial_stiffness / length,
        beam.in_plane_bending_stiffness / length**3,
        beam.flap_bending_stiffness / length**3,
    )
    out = jnp.tensordot(jnp.stack(rigidity), known.elastic, 1)
    return out + springs(known.root, known.direction, rotor)


def varying_stiffness(shapes: Shapes, rotor: Rotor) -> Matrix:
    """The same of a beam that varies along the span, or whose sections are turned.

    With the axes of the section turned by theta, twist and pitch together, bending has
    EI_vv = EI_zz c^2 + EI_yy s^2 and EI_ww = EI_yy c^2 + EI_zz s^2, c = cos(theta) and so on, and
    EI_vw = (EI_zz - EI_yy) s c between the two directions.
    """
    length, span, f = rotor.beam.length, shapes.span, shapes.at
    direction = directions(shapes.counts)
    profile, weight = Profile.of(rotor, span), span.weight
    stretch = _gram(f.slope * direction[None, :, 0], weight * profile.axial)
    first, second = profile.turned(*(f.curvature * direction[None, :, k] for k in (1, 2)))
    bending = _gram(first, weight * profile.in_plane) + _gram(second, weight * profile.flap)
    return stretch / length + bending / length**3 + springs(shapes.ends.root, direction, rotor)


def springs(root: Any, direction: np.ndarray, rotor: Rotor) -> Any:
    """Stiffness of the springs at the root: energy k phi^2 / 2, phi = f'(0) q / L."""
    out: Any = 0.0
    for k, spring in enumerate(rotor.springs, start=1):
        if spring is not None:
            slope = root * direction[:, k]
            out = out + spring / rotor.beam.length**2 * slope[:, None] * slope[None]
    return out


def _gram(f: Any, weight: Any) -> Any:
    product = f.T @ (weight[:, None] * f)
    return (product + product.T) / 2
