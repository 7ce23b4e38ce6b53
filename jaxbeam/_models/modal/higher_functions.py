"""What the functions of a uniform beam leave out of a frequency: what the next ones would add.

Where nothing varies along the span and functions are integrated orthogonal polynomials, a mode x
leaves its residual r = Q(l) x, Q(l) = l^2 M + l G + K, in the next few functions alone: inertia and
tension are polynomials of low degree times the mode, and elastic forces of different functions have
nothing to do with each other; what is at the tip or at the root meets only the first functions. Of
x, too, only the last coefficients matter. To second order the next functions j change l by

    |d l| = sum_j |r_j|^2 / |Q_jj| / |x^H (2 l M + G) x|

(with pitch the two of one number, in plane and in flap, have stiffness in common, which counts; and
in a soft beam, which tension holds more than its stiffness does, the next functions take along
others before and far beyond, for which `_enlarged` enlarges the sum), where |x^H (2 l M + G) x| is
2 |l| for unit modal mass, but for what the Coriolis force does in it.
This is the estimate of `_models/bases/truncation.py` for beams on which all is known beforehand.
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
    own = basis.basis if isinstance(basis, Yielding) else basis
    return own if type(own) is Polynomials else None


def _are_enough(basis: Basis, counts: FunctionCounts) -> bool:
    """Whether the next functions see nothing of what is at the tip, and none for a slope at the
    root."""
    polynomials, slopes = _polynomials(basis), _slopes(basis, counts)
    if polynomials is None:
        return False
    least = [(4 if any(slopes) else 1), *(4 if slope else 2 for slope in slopes[1:])]
    own = zip(counts, slopes, least, strict=True)
    return all(not n or n - slope >= most * polynomials.grading for n, slope, most in own)


def _slopes(basis: Basis, counts: FunctionCounts) -> list[int]:
    """How many functions of each direction are for a root that yields."""
    yields = (False, basis.in_plane, basis.flap) if isinstance(basis, Yielding) else (False,) * 3
    return [int(y and n > 0) for y, n in zip(yields, counts, strict=True)]


class _Higher(NamedTuple):
    """Tables of a unit beam, for the next e functions of all directions, by the c functions of the
    model that they meet."""

    places: np.ndarray  # (c,), of these among the coordinates
    direction: np.ndarray  # (e,)
    met: Float[np.ndarray, "t e c"]  # gram, three parts of tension, Coriolis force, turned sections
    own: Float[np.ndarray, "4 e"]  # gram and tension of the next functions by themselves
    pairs: np.ndarray  # (2, p), of next functions in plane and in flap with stiffness in common


@functools.lru_cache(maxsize=64)
def _higher(basis: Basis, counts: FunctionCounts, mixed: bool) -> _Higher:
    """`mixed`: sections are turned, so that functions of one number in plane and in flap have
    stiffness in common."""
    polynomials = _polynomials(basis)
    assert polynomials is not None
    # In bending inertia is integrated twice, so that it is four degrees higher than curvature.
    width = 4 * polynomials.grading
    slopes = _slopes(basis, counts)
    own = np.subtract(counts, slopes)
    size = max(own) + width
    wide = shape_integrals(polynomials, tuple(size if n else 0 for n in counts))

    def numbered(ranges: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Direction, number, and place in the tables."""
        direction = np.repeat(np.arange(3), [each.size for each in ranges])
        before = size * np.cumsum([0, *(n > 0 for n in counts)])[direction]
        return direction, np.concatenate(ranges), before + np.concatenate(ranges)

    most = [own[0], *([max(own[1:])] * 2 if mixed else own[1:])]
    ahead = [np.arange(a, (b + width) * (n > 0)) for a, b, n in zip(own, most, counts, strict=True)]
    direction, number, row = numbered(ahead)
    to, other, column = numbered([np.arange(n) for n in own])

    def acts(on: Direction, of: Direction) -> np.ndarray:
        return (direction[:, None] == on) & (to == of)

    # The Coriolis force is that of the velocity in plane on the stretch, and the other way round.
    lag, flap, axial = Direction.IN_PLANE, Direction.FLAP, Direction.AXIAL
    dragged = 1.0 * acts(lag, axial) - acts(axial, lag)
    in_common = (acts(lag, flap) | acts(flap, lag)) & (number[:, None] == other)
    gram, tension = wide.gram[np.ix_(row, column)], wide.tension[:, row[:, None], column]
    met = np.stack([gram * (direction[:, None] == to), *tension, gram * dragged, in_common])
    met = np.where(np.abs(met) > 1e-13 * np.abs(met).max(), met, 0.0)[: 6 if mixed else 5]
    meet = np.flatnonzero(met.any((0, 1)))
    neither = [(direction == k) & (number >= most[k]) & mixed for k in (1, 2)]
    return _Higher(
        places=(np.arange(own.sum()) + np.cumsum(slopes)[to])[meet],
        direction=direction,
        met=met[:, :, meet],
        own=np.stack([table[row, row] for table in (wide.gram, *wide.tension)]),
        pairs=np.stack([np.flatnonzero(each) for each in neither]),
    )


def frequency_error(
    model: Any, rotor: Rotor, speed: Scalar, eigenvalue: Array, shape: Array, *, tensioned: bool
) -> Float[Array, " k"] | None:
    """Estimate for each eigenvalue, relative; zero for zero ones. None where functions are not
    `Polynomials`, or so few that the next ones see what is at the ends.

    `shape` (k, n) are modes with unit modal mass; `tensioned` is whether the theory knows the
    tension.
    """
    if not _are_enough(model.basis, model.counts):
        return None
    mixed = rotor.pitch is not None and min(model.counts[1:]) > 0
    higher = _higher(model.basis, model.counts, mixed)
    tables, own = higher.met, higher.own
    mass, eigenvalues = rotor.beam.mass, eigenvalue[:, None]
    elastic, across = _stiffness(rotor)
    ways = np.eye(3)[higher.direction]
    elastic = (ways @ elastic)[None]
    carried = speed**2 * np.where(higher.direction == Direction.FLAP, 0.0, 1.0)
    swing = mass * (eigenvalues**2 - carried[None])
    pull = jnp.stack(rotor.tension(speed)) / rotor.beam.length

    # Products with tables in real numbers, which are the faster ones.
    parts = jnp.stack([shape.real, shape.imag])[:, :, higher.places]
    met = jax.lax.complex(*jnp.tensordot(parts, tables, (2, 2)))
    left = swing * met[:, 0] + 2 * mass * speed * eigenvalues * met[:, 4]
    held = elastic + swing.real * own[:1]
    rotary = section_inertia(rotor.beam, lambda value: value)
    if rotary is not None:
        # Of mass off the axis, which the tension does not let turn outwards in plane.
        across_beam = ways[:, 1:] @ jnp.stack(rotary) / rotor.beam.length
        carried = speed**2 * (ways[:, 2] if tensioned else ways[:, 1:].sum(1))
        turn = across_beam[None] * (eigenvalues**2 - carried[None])
        left, held = left + turn * met[:, 1], held + turn.real * own[1:2]
    if tensioned:
        left = left + jnp.sum(met[:, 1:4] * pull[None, :, None], 1)
        held = held + (pull @ own[1:])[None]
    if mixed:
        left = left + across * met[:, 5]
    held = jnp.maximum(jnp.abs(held), elastic / 4)

    energy, scale = jnp.abs(left) ** 2 / held, 2 * jnp.abs(eigenvalue) ** 2
    if tensioned:
        matters = jnp.any(jnp.sum(energy, 1) > _MATTERS * scale)
        energy = energy * _enlarged(model, rotor, speed, left, matters)
    whole = jnp.sum(energy, 1)
    if mixed:  # and of pairs what they have in common
        (r, t), (h, g) = (jnp.moveaxis(a[:, higher.pairs], 1, 0) for a in (left, held))
        both = jnp.maximum(h * g - across**2, h * g / 1e8)
        crossed = 2 * across * (r * t.conj()).real
        of_pairs = (jnp.abs(r) ** 2 * g - crossed + jnp.abs(t) ** 2 * h) / both
        whole = whole + jnp.sum(of_pairs - jnp.sum(energy[:, higher.pairs], 1), 1)
    return relative(whole, scale)


_MATTERS = 1e-10  # an error of which it matters whether it is several times as large


def _enlarged(model: Any, rotor: Rotor, speed: Scalar, left: Array, matters: Array) -> Array:
    """Factors (k, e) of the energies of the next functions, for what is beside the diagonal and for
    all functions before and beyond: r^H K^-1 r over the sum of |r_j|^2 / K_jj. K is that of flap,
    also in plane: there the first mode may be held next to nothing by it, of which others have no
    part."""
    polynomials = _polynomials(model.basis)
    assert polynomials is not None
    mixed = rotor.pitch is not None and min(model.counts[1:]) > 0
    direction = _higher(model.basis, model.counts, mixed).direction
    own = np.subtract(model.counts, _slopes(model.basis, model.counts))
    elastic, _ = _stiffness(rotor)
    pulls = jnp.stack(rotor.tension(speed)) / rotor.beam.length
    ways = [k for k in (Direction.IN_PLANE, Direction.FLAP) if model.counts[k]]
    if not ways:
        return jnp.ones_like(left.real)
    weights = jnp.stack([jnp.concatenate([elastic[k][None], pulls]) for k in ways])
    width = 4 * polynomials.grading
    here = np.stack([np.flatnonzero(direction == k)[:width] for k in ways])
    met = jnp.moveaxis(left[:, here], 1, 0)  # (ways, k, width)
    solver = _enlarger(polynomials.grading, tuple(int(own[k]) for k in ways))
    ratios = solver(weights, jnp.concatenate([met.real, met.imag], 1), matters)
    of_each = (direction[None] == np.array(ways)[:, None]).astype(float)
    return ratios.T @ of_each + (1 - np.sum(of_each, 0)[None])


@functools.lru_cache(maxsize=64)
def _enlarger(grading: int, counts: tuple[int, ...]) -> Callable[[Array, Array, Array], Array]:
    """The batch rule of `_enlarged`, of (ways, 4) weights of tables and (ways, 2 k, width)
    residuals, case by case, where it matters: stiff beams, of which kappa = L sqrt(P / EI) is no
    more than functions are, need it not."""

    def one(elastic: Array, r: Array, n: int) -> Array:
        size, k = n + _FAR * grading, len(r) // 2
        whole = jnp.tensordot(elastic, _products(grading, size), 1)
        columns = jnp.pad(r.T, ((n, size - n - r.shape[1]), (0, 0)))
        both = jnp.sum(lower_solve(cholesky(whole), columns) ** 2, 0)
        alone = jnp.sum(r**2 / jnp.diag(whole)[None, n : n + r.shape[1]], 1)
        both, alone = (a[:k] + a[k:] for a in (both, alone))
        return jnp.where(alone > 0, jnp.maximum(both / jnp.where(alone > 0, alone, 1.0), 1.0), 1.0)

    def needed(weights: Array, matters: Array) -> Array:
        pulls = weights @ np.array([0.0, 1.0, 1.0, 0.5])
        stiff = np.array(counts).reshape(*(1,) * (pulls.ndim - 1), -1) ** 2 * weights[..., 0]
        return jnp.any(matters) & jnp.any(pulls > stiff)

    def solver(weights: Array, residuals: Array, matters: Array) -> Array:
        ones = jnp.ones((len(counts), residuals.shape[1] // 2), residuals.dtype)

        def enlarged() -> Array:
            if len(set(counts)) == 1:  # what is alike is compiled once
                return jax.lax.map(
                    lambda case: one(case[0], case[1], counts[0]), (weights, residuals)
                )
            each = zip(weights, residuals, counts, strict=True)
            return jnp.stack([one(elastic, r, n) for elastic, r, n in each])

        return jax.lax.cond(needed(weights, matters), enlarged, lambda: ones)

    def many(size: int, own: tuple[bool, ...], leaves: list[Array]) -> Array:
        """The factors of a batch, whose cases are not even looked at one by one where none needs
        it."""
        weights, residuals, matters = leaves
        ones = jnp.ones((size, len(counts), residuals.shape[-2] // 2), residuals.dtype)

        def each(moving: list[Array]) -> Array:
            rest = iter(moving)
            return solver(*(next(rest) if o else a for a, o in zip(leaves, own, strict=True)))

        moving = [a for a, o in zip(leaves, own, strict=True) if o]
        return jax.lax.cond(
            needed(weights, matters), lambda: jax.lax.map(each, moving), lambda: ones
        )

    found = batchable(lambda leaves: solver(*leaves), many)
    return lambda *leaves: found(list(leaves))


_FAR = 64  # functions beyond those of a model: they see layers of a ten thousandth of the length


@functools.lru_cache(maxsize=64)
def _products(grading: int, size: int) -> Float[np.ndarray, "4 n n"]:
    """Products of so many functions, of curvatures and by the three parts of tension."""
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
    own = jnp.broadcast_arrays(beam.axial_stiffness / beam.length, *bending)
    return jnp.stack(own), 0.0 if across is None else across
