"""The lowest modes of motion about straight steady rotation, by inverse iteration in bands.

Transverse motion w and axial motion u move in quadrature, so that stable modes are where

    D(omega) = K - omega^2 M + omega C,   C symmetric, from the Coriolis coupling of w and u,

is singular. Bending polynomials and elements both give narrow bands. Ritz problems of few
functions, which all beams share, guess the modes without C; inverse iterations with Rayleigh
quotients make them exact, and Sylvester's law says whether they are the ones asked for. What it
cannot vouch for is told, and left to others. All is written for `kernel`.
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

Named = tuple[Array, Array] | None  # directions and numbers of the modes wanted, or the lowest
_CLEAR = 0.6  # share of the kinetic energy from which a mode bears a label for certain


class Entries(NamedTuple):
    """Modes: all arrays are of p modes, those of lanes behind.

    x = (w, u) is real: the mode is (w, -i u), of unit modal mass. `certain` is one where all else
    is right, else zero.
    """

    omega: Float[Array, "p *lanes"]
    x: Float[Array, "p n *lanes"]
    direction: Float[Array, "p *lanes"]
    number: Float[Array, "p *lanes"]
    axial_share: Float[Array, "p *lanes"]  # of the kinetic energy
    residual: Float[Array, "p *lanes"]
    certain: Float[Array, "p *lanes"]


class Guess(NamedTuple):
    """Modes of one direction without coupling, lowest first, right to some 1e-3 and not scaled."""

    omega: Float[Array, "k *lanes"]
    x: Float[Array, "k n *lanes"]


def coupled_modes(
    pencil: Pencil, is_axial: Bool[np.ndarray, " n"], bends: Guess, pulls: Guess,
    named: Named, count: int,
) -> Entries:  # fmt: skip
    """Modes in the plane of rotation: those of directions and numbers `named`, or the lowest.

    Guesses are zero for coordinates of the other direction; `is_axial` says which is which.
    """
    n_bends, n_pulls = len(bends.omega), len(pulls.omega)
    lanes = bends.omega.ndim - 1
    directions = np.repeat([float(Direction.IN_PLANE), float(Direction.AXIAL)], [n_bends, n_pulls])
    numbers = np.concatenate([1.0 + np.arange(n_bends), 1.0 + np.arange(n_pulls)])
    directions, numbers = append_axes(directions, lanes), append_axes(numbers, lanes)
    is_axial = append_axes(is_axial, lanes)

    def momenta(x: Array) -> Array:
        """Momenta of an uncoupled mode of unit modal mass."""
        heavy = band_matvec(pencil.m, x)
        return heavy / jnp.sqrt(pairwise_sum(x * heavy))

    start = jnp.concatenate([bends.x, pulls.x])
    heavy = jax.lax.map(momenta, start)
    guess = jnp.concatenate([bends.omega, pulls.omega])
    rank = ranks(guess)

    def one(mode: Any) -> tuple[Array, ...]:
        """A mode, refined, with its label: the share of one must be clear, and as many modes be
        below as their guesses say. There are none of all bending below an axial mode that is asked
        for, but its own, of a beam at rest, is known well."""
        pick = _picked(mode, rank, directions, numbers)
        present = (
            pairwise_sum(_number(pick)) > 0
        )  # else it is in another group: begin with the first here
        pick = pick | (~present & append_axes(np.arange(len(guess)) == 0, lanes))
        found = refined(
            pencil,
            pairwise_sum(jnp.where(pick, guess, 0.0)),
            pairwise_sum(jnp.where(pick[:, None], start, 0.0)),
        )
        bears = jax.lax.map(lambda heavy: pairwise_sum(found.x * heavy) ** 2, heavy) > _CLEAR
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

    found = Entries(*jax.lax.map(one, _each(named, count)))
    pivots, _ = factors(pencil.k)
    return found._replace(certain=jnp.where(jnp.all(pivots > 0, 0), found.certain, 0.0))


def transverse(pencil: Pencil, direction: Direction, guess: Guess) -> Entries:
    """Modes of bending that nothing is coupled with."""
    lanes = guess.omega.ndim - 1

    def one(mode: tuple[Array, ...]) -> tuple[Array, ...]:
        omega, x, place = mode
        found = refined(pencil, omega, x)
        certain = _number(found.done & (found.below == place))
        return found.omega, found.x, residual(pencil, found.omega, found.x), certain

    places = np.arange(float(len(guess.omega)))
    omega, x, left, certain = jax.lax.map(one, (*guess, places))
    none = jnp.zeros_like(omega)
    return Entries(
        omega,
        x,
        float(direction) + none,
        1 + append_axes(places, lanes) + none,
        none,
        left,
        certain,
    )


def chosen(groups: Sequence[Entries], named: Named, count: int, size: int) -> Entries:
    """The modes named, or the lowest, of several groups, whose coordinates are one group behind the
    other, `size` in all. They are zero for groups that are not there."""
    omega, direction, number, share, left, certain = (
        jnp.concatenate([getattr(group, field) for group in groups])
        for field in Entries._fields
        if field != "x"
    )
    if named is None:
        # The order of all, should one of them not be what it seems, is not to be relied on.
        certain = jnp.where(jnp.all(certain > 0, 0), certain, 0.0)
    rank = ranks(omega)

    def one(mode: Any) -> tuple[Array, ...]:
        pick = _picked(mode, rank, direction, number)
        parts, first = [], 0
        for group in groups:
            mine = pick[first : first + len(group.x), None]
            parts.append(pairwise_sum(jnp.where(mine, group.x, 0.0)))
            first += len(group.x)
        x = padded(jnp.concatenate(parts), 0, size - sum(len(part) for part in parts))
        numbers = [
            pairwise_sum(jnp.where(pick, a, 0.0))
            for a in (omega, direction, number, share, left, certain)
        ]
        return numbers[0], x, *numbers[1:]

    return Entries(*jax.lax.map(one, _each(named, count)))


def _each(named: Named, count: int) -> Any:
    """The modes that are asked for, one by one: a place in the order of all, or a direction and a
    number."""
    return np.arange(float(count)) if named is None else named


def _picked(mode: Any, rank: Array, direction: Any, number: Any) -> Array:
    """The mask of one of many modes, by one of `_each`."""
    return (direction == mode[0]) & (number == mode[1]) if isinstance(mode, tuple) else rank == mode


def residual(pencil: Pencil, omega: Array, x: Array) -> Float[Array, "*lanes"]:
    """Residual of a mode, as `Modes` has it."""
    parts: list[Any] = [(1.0, pencil.k, 1.0), (omega**2, pencil.m, -1.0)]
    if pencil.c is not None:
        parts.append((omega, pencil.c, 1.0))
    terms = [sign * weight * band_matvec(a, x) for weight, a, sign in parts]
    sizes = [
        weight * jnp.sqrt(pairwise_sum(a[:, 0] ** 2 + 2 * jnp.sum(a[:, 1:] ** 2, 1)))
        for weight, a, _ in parts
    ]
    left, size = (functools.reduce(jnp.add, some) for some in (terms, sizes))
    return jnp.sqrt(pairwise_sum(left**2) / pairwise_sum(x**2)) / size


def _number(true: Array) -> Array:
    return jnp.where(true, 1.0, 0.0)


def ranks(omega: Float[Array, "p *lanes"]) -> Float[Array, "p *lanes"]:
    """The number of modes that are lower, or as low and before, for each mode."""
    before = append_axes(np.tri(len(omega), k=-1).astype(bool), omega.ndim - 1)

    def one(row: tuple[Array, Array]) -> Array:
        mine, earlier = row
        return pairwise_sum(_number((omega < mine) | ((omega == mine) & earlier)))

    return jax.lax.map(one, (omega, jnp.asarray(before)))
