"""Errors of frequencies of a uniform beam by too few functions: what the next ones would add.

Where nothing varies along the span and functions are integrated orthogonal polynomials, the
residual r = Q(l) x, Q(l) = l^2 M + l G + K, of a mode x is in the next few functions alone: inertia
and tension are polynomials of low degree times the mode, elastic forces of different functions are
orthogonal, and bodies and springs at the ends act on the first functions only. Of x, too, only the
last coefficients matter. To second order the next functions j change l by

    |d l| = sum_j |r_j|^2 / |Q_jj| / |x^H (2 l M + G) x|,

where |x^H (2 l M + G) x| is 2 |l| for unit modal mass, but for the Coriolis force. With pitch, the
functions of one number in plane and in flap are coupled by stiffness, and count together. In a soft
beam, held by tension more than by its stiffness, the next functions are coupled with earlier and
far higher ones, for which `_enlarged` enlarges the sum. `_models/bases/truncation.py` has this
estimate for beams that vary; here all integrals are tables.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from jaxbeam._models.bases.basis import Basis, Polynomials, Yielding
from jaxbeam._models.bases.loads import FunctionCounts, in_beam_axes
from jaxbeam._models.modal.finer import relative
from jaxbeam._models.modal.shape_integrals import shape_integrals
from jaxbeam._numerics.loose import cholesky, lower_solve
from jaxbeam._programs.batches import batchable
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.span import section_inertia
from jaxbeam._types import Scalar


def _polynomials(basis: Basis) -> Polynomials | None:
    functions = basis.basis if isinstance(basis, Yielding) else basis
    return functions if type(functions) is Polynomials else None


def _are_enough(basis: Basis, counts: FunctionCounts) -> bool:
    """Whether functions are so many that bodies and springs at the ends do not act on the next
    ones."""
    polynomials, slopes = _polynomials(basis), _slopes(basis, counts)
    if polynomials is None:
        return False
    least = [(4 if any(slopes) else 1), *(4 if slope else 2 for slope in slopes[1:])]
    each = zip(counts, slopes, least, strict=True)
    return all(not n or n - slope >= needed * polynomials.grading for n, slope, needed in each)


def _slopes(basis: Basis, counts: FunctionCounts) -> list[int]:
    """How many functions of each direction are for the slope at a root that yields: 0 or 1."""
    yields = (False, basis.in_plane, basis.flap) if isinstance(basis, Yielding) else (False,) * 3
    return [int(y and n > 0) for y, n in zip(yields, counts, strict=True)]


class _Higher(NamedTuple):
    """Tables of a unit beam: how the next e functions of all directions are coupled with c
    functions of the model, and with themselves."""

    places: np.ndarray  # (c,), coordinates of the functions of the model that are coupled
    direction: np.ndarray  # (e,), of the next functions
    coupled: Float[np.ndarray, "t e c"]  # gram, 3 of tension, Coriolis force, stiffness by pitch
    diagonal: Float[np.ndarray, "4 e"]  # gram and 3 parts of tension of each next function
    pairs: np.ndarray  # (2, p), next functions in plane and in flap that are coupled by stiffness


@functools.lru_cache(maxsize=64)
def _higher(basis: Basis, counts: FunctionCounts, mixed: bool) -> _Higher:
    """Tables for the functions that follow `counts` of a basis. `mixed`: sections are turned, so
    that stiffness couples functions of one number in plane and in flap."""
    polynomials = _polynomials(basis)
    assert polynomials is not None
    # In bending inertia is integrated twice, so that it is four degrees higher than curvature.
    width = 4 * polynomials.grading
    slopes = _slopes(basis, counts)
    polynomial_counts = np.subtract(counts, slopes)
    size = max(polynomial_counts) + width
    wide = shape_integrals(polynomials, tuple(size if n else 0 for n in counts))

    def numbered(ranges: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Direction, number and row in the tables of the functions of these numbers."""
        direction = np.repeat(np.arange(3), [each.size for each in ranges])
        before = size * np.cumsum([0, *(n > 0 for n in counts)])[direction]
        return direction, np.concatenate(ranges), before + np.concatenate(ranges)

    most = [
        polynomial_counts[0],
        *([max(polynomial_counts[1:])] * 2 if mixed else polynomial_counts[1:]),
    ]
    ahead = [
        np.arange(a, (b + width) * (n > 0))
        for a, b, n in zip(polynomial_counts, most, counts, strict=True)
    ]
    direction, number, row = numbered(ahead)
    to, other, column = numbered([np.arange(n) for n in polynomial_counts])

    def couples(on: Direction, of: Direction) -> np.ndarray:
        return (direction[:, None] == on) & (to == of)

    # The Coriolis force is that of the velocity in plane on the stretch, and the other way round.
    lag, flap, axial = Direction.IN_PLANE, Direction.FLAP, Direction.AXIAL
    dragged = 1.0 * couples(lag, axial) - couples(axial, lag)
    in_common = (couples(lag, flap) | couples(flap, lag)) & (number[:, None] == other)
    gram, tension = wide.gram[np.ix_(row, column)], wide.tension[:, row[:, None], column]
    coupled = np.stack([gram * (direction[:, None] == to), *tension, gram * dragged, in_common])
    coupled = np.where(np.abs(coupled) > 1e-13 * np.abs(coupled).max(), coupled, 0.0)[
        : 6 if mixed else 5
    ]
    columns = np.flatnonzero(coupled.any((0, 1)))
    beyond_both = [(direction == k) & (number >= most[k]) & mixed for k in (1, 2)]
    return _Higher(
        places=(np.arange(polynomial_counts.sum()) + np.cumsum(slopes)[to])[columns],
        direction=direction,
        coupled=coupled[:, :, columns],
        diagonal=np.stack([table[row, row] for table in (wide.gram, *wide.tension)]),
        pairs=np.stack([np.flatnonzero(each) for each in beyond_both]),
    )


def frequency_error(
    model: Any, rotor: Rotor, speed: Scalar, eigenvalue: Array, shape: Array, *, tensioned: bool
) -> Float[Array, " k"] | None:
    """Estimated relative error of each eigenvalue, zero for zero ones. None where functions are
    not `Polynomials`, or so few that bodies or springs at the ends act on the next ones.

    `shape` (k, n) are modes with unit modal mass; `tensioned` is whether the theory has the
    stiffness of tension.
    """
    if not _are_enough(model.basis, model.counts):
        return None
    mixed = rotor.pitch is not None and min(model.counts[1:]) > 0
    higher = _higher(model.basis, model.counts, mixed)
    tables, diagonal = higher.coupled, higher.diagonal
    mass, eigenvalues = rotor.beam.mass, eigenvalue[:, None]
    elastic, coupling = _stiffness(rotor)
    one_hot = np.eye(3)[higher.direction]
    elastic = (one_hot @ elastic)[None]
    centrifugal = speed**2 * np.where(higher.direction == Direction.FLAP, 0.0, 1.0)
    inertia = mass * (eigenvalues**2 - centrifugal[None])
    tension = jnp.stack(rotor.tension(speed)) / rotor.beam.length

    # Products with tables are by real and imaginary parts: faster than in complex numbers.
    parts = jnp.stack([shape.real, shape.imag])[:, :, higher.places]
    products = jax.lax.complex(*jnp.tensordot(parts, tables, (2, 2)))
    residual = inertia * products[:, 0] + 2 * mass * speed * eigenvalues * products[:, 4]
    stiffness = elastic + inertia.real * diagonal[:1]
    rotary = section_inertia(rotor.beam, lambda value: value)
    if rotary is not None:
        # Rotary inertia of sections; with tension, centrifugal forces turn none in plane.
        across_beam = one_hot[:, 1:] @ jnp.stack(rotary) / rotor.beam.length
        centrifugal = speed**2 * (one_hot[:, 2] if tensioned else one_hot[:, 1:].sum(1))
        turn = across_beam[None] * (eigenvalues**2 - centrifugal[None])
        residual = residual + turn * products[:, 1]
        stiffness = stiffness + turn.real * diagonal[1:2]
    if tensioned:
        residual = residual + jnp.sum(products[:, 1:4] * tension[None, :, None], 1)
        stiffness = stiffness + (tension @ diagonal[1:])[None]
    if mixed:
        residual = residual + coupling * products[:, 5]
    stiffness = jnp.maximum(jnp.abs(stiffness), elastic / 4)

    energy, scale = jnp.abs(residual) ** 2 / stiffness, 2 * jnp.abs(eigenvalue) ** 2
    if tensioned:
        matters = jnp.any(jnp.sum(energy, 1) > _MATTERS * scale)
        energy = energy * _enlarged(model, rotor, speed, residual, matters)
    whole = jnp.sum(energy, 1)
    if mixed:  # pairs that stiffness couples count together, not one by one
        (r, t), (h, g) = (jnp.moveaxis(a[:, higher.pairs], 1, 0) for a in (residual, stiffness))
        determinant = jnp.maximum(h * g - coupling**2, h * g / 1e8)
        crossed = 2 * coupling * (r * t.conj()).real
        of_pairs = (jnp.abs(r) ** 2 * g - crossed + jnp.abs(t) ** 2 * h) / determinant
        whole = whole + jnp.sum(of_pairs - jnp.sum(energy[:, higher.pairs], 1), 1)
    return relative(whole, scale)


_MATTERS = 1e-10  # relative error from which on `_enlarged` is worth computing


def _enlarged(model: Any, rotor: Rotor, speed: Scalar, residual: Array, matters: Array) -> Array:
    """Factors (k, e) of the energies of the next functions for the full matrix K of all functions
    in the place of its diagonal: r^H K^-1 r over the sum of |r_j|^2 / K_jj. K is that of flap in
    plane too, where centrifugal forces may leave the first mode, and it alone, hardly any
    stiffness."""
    polynomials = _polynomials(model.basis)
    assert polynomials is not None
    mixed = rotor.pitch is not None and min(model.counts[1:]) > 0
    direction = _higher(model.basis, model.counts, mixed).direction
    polynomial_counts = np.subtract(model.counts, _slopes(model.basis, model.counts))
    elastic, _ = _stiffness(rotor)
    tension = jnp.stack(rotor.tension(speed)) / rotor.beam.length
    directions = [k for k in (Direction.IN_PLANE, Direction.FLAP) if model.counts[k]]
    if not directions:
        return jnp.ones_like(residual.real)
    weights = jnp.stack([jnp.concatenate([elastic[k][None], tension]) for k in directions])
    width = 4 * polynomials.grading
    next_ones = np.stack([np.flatnonzero(direction == k)[:width] for k in directions])
    residuals = jnp.moveaxis(residual[:, next_ones], 1, 0)  # (directions, k, width)
    solver = _enlarger(polynomials.grading, tuple(int(polynomial_counts[k]) for k in directions))
    ratios = solver(weights, jnp.concatenate([residuals.real, residuals.imag], 1), matters)
    is_in = (direction[None] == np.array(directions)[:, None]).astype(float)
    return ratios.T @ is_in + (1 - np.sum(is_in, 0)[None])


@functools.lru_cache(maxsize=64)
def _enlarger(grading: int, counts: tuple[int, ...]) -> Callable[[Array, Array, Array], Array]:
    """The ratios of `_enlarged` from weights (d, 4) of tables and residuals (d, 2 k, width) of d
    directions, with a rule for batches. They are ones for stiff beams, whose kappa = L sqrt(P / EI)
    is no more than the number of functions."""

    def direction_ratios(elastic: Array, r: Array, n: int) -> Array:
        size, k = n + _FAR * grading, len(r) // 2
        whole = jnp.tensordot(elastic, _products(grading, size), 1)
        columns = jnp.pad(r.T, ((n, size - n - r.shape[1]), (0, 0)))
        both = jnp.sum(lower_solve(cholesky(whole), columns) ** 2, 0)
        alone = jnp.sum(r**2 / jnp.diag(whole)[None, n : n + r.shape[1]], 1)
        both, alone = (a[:k] + a[k:] for a in (both, alone))
        return jnp.where(alone > 0, jnp.maximum(both / jnp.where(alone > 0, alone, 1.0), 1.0), 1.0)

    def needed(weights: Array, matters: Array) -> Array:
        tension = weights @ np.array([0.0, 1.0, 1.0, 0.5])
        stiff = np.array(counts).reshape(*(1,) * (tension.ndim - 1), -1) ** 2 * weights[..., 0]
        return jnp.any(matters) & jnp.any(tension > stiff)

    def solver(weights: Array, residuals: Array, matters: Array) -> Array:
        ones = jnp.ones((len(counts), residuals.shape[1] // 2), residuals.dtype)

        def enlarged() -> Array:
            if len(set(counts)) == 1:  # equal counts share one program
                return jax.lax.map(
                    lambda case: direction_ratios(case[0], case[1], counts[0]), (weights, residuals)
                )
            each = zip(weights, residuals, counts, strict=True)
            return jnp.stack([direction_ratios(elastic, r, n) for elastic, r, n in each])

        return jax.lax.cond(needed(weights, matters), enlarged, lambda: ones)

    def many(size: int, per_case: tuple[bool, ...], leaves: list[Array]) -> Array:
        """The factors of a batch; in batches without a case that needs them, they are ones without
        a look at single cases."""
        weights, residuals, matters = leaves
        ones = jnp.ones((size, len(counts), residuals.shape[-2] // 2), residuals.dtype)

        def each(moving: list[Array]) -> Array:
            rest = iter(moving)
            return solver(*(next(rest) if o else a for a, o in zip(leaves, per_case, strict=True)))

        moving = [a for a, o in zip(leaves, per_case, strict=True) if o]
        return jax.lax.cond(
            needed(weights, matters), lambda: jax.lax.map(each, moving), lambda: ones
        )

    found = batchable(lambda leaves: solver(*leaves), many)
    return lambda *leaves: found(list(leaves))


_FAR = 64  # functions beyond those of a model: they see layers of a ten thousandth of the length


@functools.lru_cache(maxsize=64)
def _products(grading: int, size: int) -> Float[np.ndarray, "4 n n"]:
    """Integrals of products of `size` functions: of curvatures, and of slopes with the three parts
    of tension."""
    t, w = legendre.leggauss(grading * (size + 4))
    xi, rate = ((1 + t) / 2) ** grading, grading * ((1 + t) / 2) ** (grading - 1) / 2
    root = np.sqrt(w * rate)[:, None]
    q, r = np.linalg.qr(root * legendre.legvander(t, size - 1))
    inverse = np.linalg.inv(legendre.legvander(t, t.size - 1))
    inside = legendre.legval(t, legendre.legint(inverse, lbnd=-1, axis=0)).T * rate[None]
    slope = inside @ (q * np.sign(np.diag(r)) / root)
    shapes = (np.ones_like(xi), 1 - xi, (1 - xi**2) / 2)
    tensions = [slope.T @ (root**2 * p[:, None] * slope) for p in shapes]
    return np.stack([np.eye(size), *tensions])


def _stiffness(rotor: Rotor) -> tuple[Float[Array, " 3"], Any]:
    """The stiffness of functions of a unit beam in each direction, and what couples bending."""
    beam, cubed = rotor.beam, rotor.beam.length**3
    in_plane, flap = beam.in_plane_bending_stiffness / cubed, beam.flap_bending_stiffness / cubed
    axes = None if rotor.pitch is None else (jnp.cos(rotor.pitch), jnp.sin(rotor.pitch))
    bending, across = in_beam_axes(in_plane, flap, axes)
    stiffness = jnp.broadcast_arrays(beam.axial_stiffness / beam.length, *bending)
    return jnp.stack(stiffness), 0.0 if across is None else across
