"""What the functions of a uniform beam leave out of a frequency: what the next ones would add.

Where nothing varies along the span and functions are integrated orthogonal polynomials, a mode x
leaves its residual r = Q(l) x, Q(l) = l^2 M + l G + K, in the next few functions alone: inertia and
tension are polynomials of low degree times the mode, and elastic forces of different functions have
nothing to do with each other; what is at the tip or at the root meets only the first functions. Of
x, too, only the last coefficients matter. To second order the next functions j change l by

    |d l| = sum_j |r_j|^2 / |Q_jj| / |x^H (2 l M + G) x|

(with pitch the two of one number, in plane and in flap, have stiffness in common, which counts),
where |x^H (2 l M + G) x| is 2 |l| for unit modal mass, but for what the Coriolis force does in it.
This is the estimate of `_models/bases/truncation.py` for beams on which all is known beforehand.
"""

import functools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.basis import Basis, Polynomials, Yielding
from jaxbeam._models.bases.loads import Counts
from jaxbeam._models.modal.shape_integrals import shape_integrals
from jaxbeam._rotor.beam import Rotor
from jaxbeam._types import Scalar


def _polynomials(basis: Basis) -> Polynomials | None:
    own = basis.basis if isinstance(basis, Yielding) else basis
    return own if type(own) is Polynomials else None


def _are_enough(basis: Basis, counts: Counts) -> bool:
    """Whether the next functions see nothing of what is at the tip, and none for a slope at the
    root."""
    polynomials, slopes = _polynomials(basis), _slopes(basis, counts)
    if polynomials is None:
        return False
    least = [(4 if any(slopes) else 1), *(4 if slope else 2 for slope in slopes[1:])]
    own = zip(counts, slopes, least, strict=True)
    return all(not n or n - slope >= most * polynomials.grading for n, slope, most in own)


def _slopes(basis: Basis, counts: Counts) -> list[int]:
    """How many functions of each direction are for a root that yields."""
    yields = (False, basis.in_plane, basis.flap) if isinstance(basis, Yielding) else (False,) * 3
    return [int(y and n > 0) for y, n in zip(yields, counts, strict=True)]


class _Higher(NamedTuple):
    """Tables of a unit beam, for the next e functions of one direction."""

    same: Float[np.ndarray, "4 e c"]  # gram and tension by the last functions of this direction
    own: Float[np.ndarray, "4 e"]  # the same by themselves
    places: np.ndarray  # (c,), of the last functions among the coordinates
    dragged: Float[np.ndarray, "e b"]  # gram by functions that the Coriolis force couples with them
    dragging: np.ndarray  # (b,), of these
    alike: np.ndarray  # functions across that are the same as the first of the e


@functools.lru_cache(maxsize=64)
def _higher(basis: Basis, counts: Counts, mixed: bool) -> tuple[_Higher | None, ...]:
    """Tables of each direction, None where a model has no functions; `mixed`: sections are turned,
    so that both directions of bending have stiffness in common."""
    polynomials = _polynomials(basis)
    assert polynomials is not None
    # In bending inertia is integrated twice, so that it is four degrees higher than curvature.
    width = 4 * polynomials.grading
    slopes = _slopes(basis, counts)
    own = [n - slope for n, slope in zip(counts, slopes, strict=True)]
    here = np.cumsum([0, *counts])[:3] + slopes
    many = tuple(max(own) + width if n else 0 for n in counts)
    wide, start = shape_integrals(polynomials, many), np.cumsum([0, *many])[:3]

    def next_ones(k: int) -> _Higher:
        n, (drags, across) = own[k], ((1, 0), (0, 2), (2, 1))[k]
        most = max(n, own[drags] * (drags != k), own[across] * (mixed and k > 0))
        beyond = np.arange(n, min(most + width, many[k]))
        last = np.arange(max(0, n - width), n)
        tables = np.stack([wide.gram, *(wide.axial_tension if k == 0 else wide.tension)])
        others = np.arange(own[drags] * (drags != k))
        dragged = wide.gram[np.ix_(start[k] + beyond, start[drags] + others)]
        meet = np.abs(dragged).max(0, initial=0.0) > 1e-13 * np.abs(wide.gram).max()
        alike = np.arange(n, own[across] if mixed and k > 0 else n)
        return _Higher(
            same=tables[:, (start[k] + beyond)[:, None], start[k] + last],
            own=tables[:, start[k] + beyond, start[k] + beyond],
            places=here[k] + last,
            dragged=dragged[:, meet],
            dragging=here[drags] + others[meet],
            alike=here[across] + alike,
        )

    return tuple(next_ones(k) if n else None for k, n in enumerate(counts))


class _Left(NamedTuple):
    """What is left in the next functions of one direction, and what holds these."""

    left: Float[Array, "2 k e"]  # real and imaginary parts
    held: Float[Array, "k e"]
    alone: int  # how many the other direction of bending has among its own

    @property
    def energy(self) -> Float[Array, "k e"]:
        """Twice the strain energy that it makes."""
        return jnp.sum(self.left**2, 0) / self.held

    def with_common(self, other: "_Left", common: Any) -> Float[Array, "k e"]:
        """What a stiffness in common adds to the energies of the functions that neither has."""
        n = min(self.left.shape[2] - self.alone, other.left.shape[2] - other.alone)
        (r, h), (s, g) = (
            (a.left[:, :, a.alone : a.alone + n], a.held[:, a.alone : a.alone + n])
            for a in (self, other)
        )
        both = jnp.maximum(h * g - common**2, h * g / 1e8)
        whole = jnp.sum(r**2, 0) * g - 2 * common * jnp.sum(r * s, 0) + jnp.sum(s**2, 0) * h
        return whole / both - jnp.sum(r**2, 0) / h - jnp.sum(s**2, 0) / g


def frequency_error(
    model: Any, rotor: Rotor, speed: Scalar, eigenvalue: Array, shape: Array, *, tensioned: bool
) -> Float[Array, " k"] | None:
    """Estimate for each eigenvalue, relative; zero for zero ones. None where functions are not
    `Polynomials`, or so few that the next ones see what is at the ends.

    `shape` (k, n) are modes with unit modal mass; `tensioned` is whether the theory knows the
    tension.
    """
    basis = model.basis
    if not _are_enough(basis, model.counts):
        return None
    beam, length, square = rotor.beam, rotor.beam.length, eigenvalue**2
    bends, across = [beam.in_plane_bending_stiffness, beam.flap_bending_stiffness], 0.0
    if rotor.pitch is not None:
        cos, sin = jnp.cos(rotor.pitch), jnp.sin(rotor.pitch)
        across = (bends[0] - bends[1]) * cos * sin / length**3
        bends = [a * cos**2 + b * sin**2 for a, b in (bends, bends[::-1])]
    elastic = [beam.axial_stiffness / length, *(a / length**3 for a in bends)]
    pull = [c / length for c in rotor.tension(speed)]
    swing = [square - speed**2, square - speed**2, square]
    drag = 2 * beam.mass * speed * eigenvalue
    parts = jnp.stack([shape.real, shape.imag])
    found: list[_Left | None] = []
    every = _higher(basis, model.counts, rotor.pitch is not None)
    for k, (tables, stiff) in enumerate(zip(every, elastic, strict=True)):
        if tables is None:
            found.append(None)
            continue
        _, e, c = tables.same.shape
        at = parts[:, :, tables.places] @ tables.same.reshape(-1, c).T
        at = at.reshape(2, -1, 4, e)
        re, im = swing[k].real * beam.mass, swing[k].imag * beam.mass
        left = _product((re, im), at[:, :, 0])
        held = stiff + re[:, None] * tables.own[0][None]
        if k and tensioned:
            left = left + sum(c * at[:, :, i + 1] for i, c in enumerate(pull))
            held = held + sum(c * tables.own[i + 1] for i, c in enumerate(pull))[None]
        if tables.dragging.size:
            sign = 1.0 if k == 1 else -1.0
            dragged = parts[:, :, tables.dragging] @ tables.dragged.T
            left = left + sign * _product((drag.real, drag.imag), dragged)
        if tables.alike.size:
            left = left.at[:, :, : tables.alike.size].add(across * parts[:, :, tables.alike])
        found.append(_Left(left, jnp.maximum(jnp.abs(held), stiff / 4), tables.alike.size))
    energy = sum(jnp.sum(each.energy, 1) for each in found if each is not None)
    if rotor.pitch is not None and found[1] is not None and found[2] is not None:
        energy = energy + jnp.sum(found[1].with_common(found[2], across), 1)
    scale = 2 * (eigenvalue.real**2 + eigenvalue.imag**2)
    return jnp.where(scale > 0, energy / jnp.where(scale > 0, scale, 1.0), 0.0)


def _product(a: tuple[Array, Array], b: Float[Array, "2 k e"]) -> Float[Array, "2 k e"]:
    """Complex numbers times others, by real and imaginary parts."""
    re, im = a[0][:, None], a[1][:, None]
    return jnp.stack([re * b[0] - im * b[1], re * b[1] + im * b[0]])
