"""The lowest modes of motion about straight steady rotation, by inverse iteration in bands.

Transverse motion w and axial motion u move in quadrature, so that stable modes are where

    D(omega) = K - omega^2 M + omega C,   C symmetric, from the Coriolis coupling of w and u,

is singular. Bending polynomials and elements both give narrow bands. Ritz problems of few
functions, the same for all beams, guess the modes without C; inverse iterations with Rayleigh
quotients make them exact, and Sylvester's law of inertia says whether they are those asked for.
Modes for which it cannot are marked as not certain. Arrays have axes of lanes last (see `kernel`).
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._numerics.band import Pencil, band_matvec, factors, refined
from jaxbeam._numerics.blocks import padded
from jaxbeam._programs.lanes import append_axes, pairwise_sum
from jaxbeam._rotor.directions import Direction

Named = tuple[Array, Array] | None  # directions and numbers of the modes wanted; None: the lowest
_CLEAR = 0.6  # share of kinetic energy in an uncoupled mode beyond which its label is certain


class Entries(NamedTuple):
    """p modes (w, -i u) of unit modal mass, with real x = (w, u); `certain` is one where frequency,
    shape and label are right for sure, else zero."""

    omega: Float[Array, "p *lanes"]
    x: Float[Array, "p n *lanes"]
    direction: Float[Array, "p *lanes"]
    number: Float[Array, "p *lanes"]
    axial_share: Float[Array, "p *lanes"]  # share of kinetic energy in axial motion
    residual: Float[Array, "p *lanes"]
    certain: Float[Array, "p *lanes"]


class Guess(NamedTuple):
    """Guesses of the modes of one direction without coupling, lowest first, to some 1e-3 and not
    scaled."""

    omega: Float[Array, "k *lanes"]
    x: Float[Array, "k n *lanes"]


def coupled_modes(
    pencil: Pencil, is_axial: Bool[np.ndarray, " n"], bending: Guess, axial: Guess,
    named: Named, count: int,
) -> Entries:  # fmt: skip
    """Modes in the plane of rotation: those of directions and numbers `named`, or the lowest.

    Guesses are zero in coordinates of the other direction; `is_axial` tells these apart.
    """
    counts = [len(bending.omega), len(axial.omega)]
    lanes = bending.omega.ndim - 1
    directions = np.repeat([float(Direction.IN_PLANE), float(Direction.AXIAL)], counts)
    numbers = np.concatenate([1.0 + np.arange(n) for n in counts])
    directions, numbers = append_axes(directions, lanes), append_axes(numbers, lanes)
    is_axial = append_axes(is_axial, lanes)

    def momenta(x: Array) -> Array:
        """The product M x of an uncoupled mode, scaled to unit modal mass."""
        momentum = band_matvec(pencil.m, x)
        return momentum / jnp.sqrt(pairwise_sum(x * momentum))

    start = jnp.concatenate([bending.x, axial.x])
    momentum = jax.lax.map(momenta, start)
    guess = jnp.concatenate([bending.omega, axial.omega])
    rank = ranks(guess)

    def refined_mode(mode: Any) -> tuple[Array, ...]:
        """A mode refined from its guess. It is certain if its kinetic energy is mostly in one
        uncoupled mode, and if as many modes are below it as guesses are. Of an axial mode wanted
        by its label not all bending modes below are guessed, but its own guess is accurate enough
        without a count."""
        pick = _picked(mode, rank, directions, numbers)
        # A mode wanted of another group is not here: then the first mode is refined, unused.
        present = pairwise_sum(_number(pick)) > 0
        pick = pick | (~present & append_axes(np.arange(len(guess)) == 0, lanes))
        found = refined(
            pencil,
            pairwise_sum(jnp.where(pick, guess, 0.0)),
            pairwise_sum(jnp.where(pick[:, None], start, 0.0)),
        )
        share = jax.lax.map(lambda each: pairwise_sum(found.x * each) ** 2, momentum)
        bears = share > _CLEAR
        clear = (
            (pairwise_sum(_number(bears)) == 1)
            & (pairwise_sum(_number(bears & pick)) == 1)
            & found.done
        )
        placed = pairwise_sum(jnp.where(bears, rank, 0.0)) == found.below
        if named is not None:
            placed = placed | (mode[0] == Direction.AXIAL)
        clear = clear & placed
        direction, number = (pairwise_sum(jnp.where(pick, a, 0.0)) for a in (directions, numbers))
        return (
            found.omega, found.x, jnp.where(present, direction, -1.0), number,
            pairwise_sum(jnp.where(is_axial, found.x * band_matvec(pencil.m, found.x), 0.0)),
            residual(pencil, found.omega, found.x), _number(clear | ~present),
        )  # fmt: skip

    found = Entries(*jax.lax.map(refined_mode, _each(named, count)))
    pivots, _ = factors(pencil.k)
    return found._replace(certain=jnp.where(jnp.all(pivots > 0, 0), found.certain, 0.0))


def transverse(pencil: Pencil, direction: Direction, guess: Guess) -> Entries:
    """Modes of bending in one direction without coupling to others, refined from guesses."""
    lanes = guess.omega.ndim - 1

    def refined_mode(mode: tuple[Array, ...]) -> tuple[Array, ...]:
        omega, x, place = mode
        found = refined(pencil, omega, x)
        certain = _number(found.done & (found.below == place))
        return found.omega, found.x, residual(pencil, found.omega, found.x), certain

    places = np.arange(float(len(guess.omega)))
    omega, x, errors, certain = jax.lax.map(refined_mode, (*guess, places))
    zero = jnp.zeros_like(omega)
    return Entries(
        omega,
        x,
        float(direction) + zero,
        1 + append_axes(places, lanes) + zero,
        zero,
        errors,
        certain,
    )


def chosen(groups: Sequence[Entries], named: Named, count: int, size: int) -> Entries:
    """The modes named, or the lowest, of several coupling groups, whose coordinates follow each
    other. Vectors are padded with zeros to length `size`, for directions without a group."""
    omega, direction, number, share, errors, certain = (
        jnp.concatenate([getattr(group, field) for group in groups])
        for field in Entries._fields
        if field != "x"
    )
    if named is None:
        # If one mode is not certain, neither is the order of all.
        certain = jnp.where(jnp.all(certain > 0, 0), certain, 0.0)
    rank = ranks(omega)

    def chosen_mode(mode: Any) -> tuple[Array, ...]:
        pick = _picked(mode, rank, direction, number)
        parts, first = [], 0
        for group in groups:
            mine = pick[first : first + len(group.x), None]
            parts.append(pairwise_sum(jnp.where(mine, group.x, 0.0)))
            first += len(group.x)
        x = padded(jnp.concatenate(parts), 0, size - sum(len(part) for part in parts))
        numbers = [
            pairwise_sum(jnp.where(pick, a, 0.0))
            for a in (omega, direction, number, share, errors, certain)
        ]
        return numbers[0], x, *numbers[1:]

    return Entries(*jax.lax.map(chosen_mode, _each(named, count)))


def _each(named: Named, count: int) -> Any:
    """The modes wanted, as arrays to map over: ranks among all modes, or directions and numbers."""
    return np.arange(float(count)) if named is None else named


def _picked(mode: Any, rank: Array, direction: Any, number: Any) -> Array:
    """The mask of the mode, among all, that one entry of `_each` stands for."""
    return (direction == mode[0]) & (number == mode[1]) if isinstance(mode, tuple) else rank == mode


def residual(pencil: Pencil, omega: Array, x: Array) -> Float[Array, "*lanes"]:
    """The relative residual of a mode, as `Modes.residual` is defined."""
    matrices: list[Any] = [(1.0, pencil.k, 1.0), (omega**2, pencil.m, -1.0)]
    if pencil.c is not None:
        matrices.append((omega, pencil.c, 1.0))
    terms = [sign * weight * band_matvec(a, x) for weight, a, sign in matrices]
    sizes = [
        weight * jnp.sqrt(pairwise_sum(a[:, 0] ** 2 + 2 * jnp.sum(a[:, 1:] ** 2, 1)))
        for weight, a, _ in matrices
    ]
    force, size = (functools.reduce(jnp.add, each) for each in (terms, sizes))
    return jnp.sqrt(pairwise_sum(force**2) / pairwise_sum(x**2)) / size


def _number(true: Array) -> Array:
    return jnp.where(true, 1.0, 0.0)


def ranks(omega: Float[Array, "p *lanes"]) -> Float[Array, "p *lanes"]:
    """The rank of each of p modes by frequency, from 0; equal ones go by their place."""
    before = append_axes(np.tri(len(omega), k=-1).astype(bool), omega.ndim - 1)

    def rank(row: tuple[Array, Array]) -> Array:
        mine, earlier = row
        return pairwise_sum(_number((omega < mine) | ((omega == mine) & earlier)))

    return jax.lax.map(rank, (omega, jnp.asarray(before)))
