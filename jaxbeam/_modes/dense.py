"""Modes of small motion of any system by dense eigenproblems, one case at a time."""

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from jaxbeam._models.contract.labelling import assigned, participation, ranked, uncoupled
from jaxbeam._models.contract.linear_system import LinearSystem, SystemPart
from jaxbeam._modes.result import Modes
from jaxbeam._modes.wanted import Wanted
from jaxbeam._numerics.gyroscopic import gyroscopic_eigenpairs, lowest_by_skew
from jaxbeam._numerics.linalg import planar_eigenpairs, positive_definite
from jaxbeam._numerics.quadratic import quadratic_eigenpairs
from jaxbeam._programs.batches import one_by_one
from jaxbeam._rotor.directions import Direction
from jaxbeam._status import Status, first_broken, first_failure

_MORE = 2  # modes beyond those wanted that are found with them
_CLEAR = 0.5  # share of the kinetic energy that one uncoupled mode has more of than all others
_SPREAD = 300.0  # between the lowest frequency and the highest, of which the square costs digits
ROUNDING = 1e-3  # what rounding may change a frequency by, relative, where that is OK
TOLERANCE = 5e6  # of residuals, over the resolution of the numbers: 1e-9 in double precision


def dense_modes(
    system: LinearSystem, wanted: Wanted, loose: Bool[Array, " 4"] | None = None, free: int = 0
) -> Modes:
    """The modes wanted of a system, stable or not, and their status.

    Up to `free` motions may have no stiffness, where the root yields. `loose` says in which
    directions it has a free hinge: there a frequency may be zero; in others a frequency of zero is
    one lost in rounding, and `INACCURATE`.
    """
    chosen = _chosen(system, wanted, free)
    eigenvalue, shape = chosen.eigenvalue, chosen.shape
    matrices = (system.mass, system.by_rates, system.stiffness)
    residual = _residual(matrices, eigenvalue, shape)
    tolerance = TOLERANCE * jnp.finfo(residual.dtype).eps
    accurate = residual.max() <= tolerance  # false for NaN
    if chosen.rounding is not None:
        accurate &= chosen.rounding.max() <= ROUNDING
    if loose is not None:
        accurate &= jnp.all((eigenvalue != 0) | loose[chosen.direction])
    found = first_broken(
        (chosen.positive, Status.NO_EQUILIBRIUM),
        (chosen.finite & jnp.all(jnp.isfinite(shape)), Status.NOT_FINITE),
        (accurate, Status.INACCURATE),
    )
    status = first_failure(system.status, found)
    share = energy_share(system.mass, shape, system.directions)
    return Modes(
        eigenvalue, shape, chosen.direction, chosen.number, share, residual, status,
        system.steady_strain,
    )  # fmt: skip


def energy_share(
    mass: Float[Array, "n n"], shape: Complex[Array, "k n"], directions: tuple[Direction, ...]
) -> Float[Array, "k 4"]:
    """Share of the kinetic energy of each of k modes that is in each `Direction`."""
    kinetic = (shape.conj() * (shape @ mass)).real
    share = kinetic @ (np.array(directions)[:, None] == np.array(Direction)[None]).astype(
        mass.dtype
    )
    return share / jnp.sum(share, -1, keepdims=True)


class _Chosen(NamedTuple):
    """The modes wanted, with their labels."""

    eigenvalue: Complex[Array, " k"]
    shape: Complex[Array, "k n"]
    direction: Array
    number: Array
    positive: Array  # whether the axial stiffness is positive definite
    finite: Array  # whether all modes of the system were found
    rounding: Float[Array, " k"] | None  # relative errors by rounding; None: small


def _chosen(system: LinearSystem, wanted: Wanted, free: int) -> _Chosen:
    """The modes wanted: of a conservative system of one group only the lowest few are computed, if
    their labels are certain, else all modes."""
    one_group = system.general and system.conservative and len(system.coupling) == 1
    few = one_group and wanted.named is None and 4 * wanted.count <= len(system.directions)
    if not few:
        return _chosen_of_all(system, wanted, free)

    def lowest_of(m: Array, c: Array, k: Array, *along: Array) -> _Chosen:
        case = dataclasses.replace(
            system, mass=m, gyroscopic=c, stiffness=k, taken_along=along[0] if along else None
        )
        return _lowest(case, wanted, free)

    along = () if system.taken_along is None else (system.taken_along,)
    chosen: _Chosen = one_by_one(lowest_of)(
        system.mass, system.gyroscopic, system.stiffness, *along
    )
    return chosen


def _lowest(system: LinearSystem, wanted: Wanted, free: int) -> _Chosen:
    """The lowest modes of a conservative system of one group. Only these are computed if the system
    is stable and their labels are certain, else all are.

    The label of a mode is certain if more than half of its kinetic energy is in one uncoupled mode,
    and less than half of that one is in modes that were not computed.
    """
    transverse, axial = system.coupling[0]
    part, count = system.part(*transverse, *axial), wanted.count
    m, c, k = part.mass, part.by_rates, part.stiffness
    lam, x, kinetic, stable = lowest_by_skew(m, c, k, count + _MORE)
    momenta = uncoupled(part, free, bent=True)
    share = participation(x, momenta)
    label = jnp.argmax(share, 1)
    # Shares 2 (kinetic / total energy) |x^H M v|^2 of modes x in an uncoupled mode v add up to one.
    elsewhere = 1 - 2 * kinetic @ jnp.abs(x @ momenta) ** 2
    clear = (jnp.max(share, 1) > _CLEAR) & (elsewhere[label] < _CLEAR)
    same = (label[:, None] == label[None]) & clear[None] & ~np.eye(len(x), dtype=bool)
    clear &= ~jnp.any(same, 1)
    near = jnp.abs(lam[count - 1]) < _SPREAD * jnp.abs(lam[0])
    right = jnp.max(_residual((m, c, k), lam, x)) <= TOLERANCE * jnp.finfo(m.dtype).eps

    def from_all() -> tuple[Array, Array, Array]:
        lam, x = quadratic_eigenpairs(m, c, k, True, free)
        label = assigned(participation(x, momenta))
        return lam[:count], x[:count], label[:count]

    certain = stable & jnp.all(clear[:count]) & near & right
    lam, x, label = jax.lax.cond(certain, lambda: (lam[:count], x[:count], label[:count]), from_all)
    finite, label = jnp.all(jnp.isfinite(lam)), ranked(label, part.sizes)
    x = _unmixed(m, x, coupling(part)[label])
    direction_of, number_of = _labels(system.directions, part.rows)
    return _Chosen(
        lam, x[:, np.argsort(part.rows)], direction_of[label], number_of[label],
        jnp.ones((), bool), finite, _rounding(m, c, k, lam, x, free),
    )  # fmt: skip


def _chosen_of_all(system: LinearSystem, wanted: Wanted, free: int) -> _Chosen:
    """The modes wanted, chosen from all modes of all coupling groups."""
    groups = [
        _group(system, transverse, axial, free)
        for transverse, axial in system.coupling
        if system.where(*transverse, *axial).size
    ]
    rows = np.concatenate([group.rows for group in groups])
    direction_of, number_of = _labels(system.directions, rows)
    eigenvalue = jnp.concatenate([group.eigenvalue for group in groups])
    # Modes that were not found may be among the lowest.
    finite = ~jnp.any(jnp.isnan(eigenvalue))
    shape = jax.scipy.linalg.block_diag(*[group.shape for group in groups])
    starts = np.cumsum([0, *(group.rows.size for group in groups)])
    label = jnp.concatenate([a.label + i for a, i in zip(groups, starts[:-1], strict=True)])
    direction, number = direction_of[label], number_of[label]
    if wanted.named is None:
        square = -(eigenvalue**2).real
        if system.general:  # eigenvalues are in order already
            square = jnp.arange(square.size, dtype=square.dtype)
        if not wanted.most[Direction.FLAP]:
            square = jnp.where(direction == Direction.FLAP, jnp.inf, square)
        pick = jnp.argsort(square)[: wanted.count]
        direction, number = direction[pick], number[pick]
    else:
        directions, numbers = (a[:, None] for a in wanted.named)
        named = (direction[None] == directions) & (number[None] == numbers)
        pick, (direction, number) = jnp.argmax(named, axis=1), wanted.named
    positive = functools.reduce(jnp.logical_and, [group.positive for group in groups])
    roundings = [group.rounding for group in groups if group.rounding is not None]
    rounding = jnp.concatenate(roundings)[pick] if roundings else None
    shape = shape[pick][:, np.argsort(rows)]
    return _Chosen(eigenvalue[pick], shape, direction, number, positive, finite, rounding)


class _Group(NamedTuple):
    """The modes of one coupling group, in the coordinates `rows`. The label of a mode is an index
    into `rows`: that of the coordinate with the same direction and number."""

    rows: np.ndarray
    eigenvalue: Complex[Array, " n"]
    shape: Complex[Array, "n n"]
    label: Int[Array, " n"]
    positive: Array
    rounding: Float[Array, " n"] | None


def _labels(directions: tuple[Direction, ...], rows: np.ndarray) -> tuple[Array, Array]:
    """The direction of each coordinate of `rows`, and its number within the direction, from 1."""
    kinds = np.asarray([int(directions[row]) for row in rows])
    return jnp.asarray(kinds), jnp.asarray(
        [sum(kinds[:i] == kinds[i]) + 1 for i in range(rows.size)]
    )


def _group(
    system: LinearSystem,
    transverse: tuple[Direction, ...],
    axial: tuple[Direction, ...],
    free: int,
) -> _Group:
    """All modes of one coupling group of a system."""
    part = system.part(*transverse, *axial)
    rows, _, sizes, m, g, k, _ = part
    if system.general:
        eigenvalue, shape = quadratic_eigenpairs(m, g, k, system.conservative, free)
        positive = jnp.ones((), int)  # not needed: growing modes are found like others
    elif transverse == axial:
        eigenvalue, shape, positive = gyroscopic_eigenpairs(m, g, k, free)
    else:
        nt = system.where(*transverse).size
        eigenvalue, shape, positive = planar_eigenpairs(m, g, k, nt, free)
        if Direction.FLAP in axial:  # a coned beam may be stable though flap alone is not
            rod, positive = system.part(Direction.AXIAL), jnp.ones((), int)
            if rod.sizes:
                positive = positive_definite(rod.stiffness).astype(int)
    label = jnp.arange(rows.size)
    if len(sizes) > 1:  # within one direction numbers are ranks of frequencies
        # Axial motion follows bending statically, unless it only moves in quadrature to it.
        bent = system.general or transverse == axial or Direction.FLAP in axial
        label = assigned(participation(shape, uncoupled(part, free, bent)))
    if system.general:
        label = ranked(label, sizes)
        shape = _unmixed(m, shape, coupling(part)[label])
    rounding = _rounding(m, g, k, eigenvalue, shape, free)
    return _Group(rows, eigenvalue, shape, label, positive == 1, rounding)


def _rounding(m: Array, g: Array, k: Array, eigenvalue: Array, x: Array, free: int) -> Array | None:
    """Bounds of the relative errors of frequencies by rounding; None where it is small.

    In double precision it matters only with a nearly `free` root, where x^H K x is much smaller
    than |x|^T |K| |x|: the bound is rounding times the ratio. In single precision the bound is that
    of the lowest mode, which is part of all others, the same for M, the ratio to the lowest
    frequency, and x^H Q x, which should be zero.
    """
    double = jnp.finfo(m.dtype).bits > 32
    if double and not free:
        return None
    moves = eigenvalue != 0
    size, omega = jnp.abs(x), jnp.where(moves, jnp.abs(eigenvalue), jnp.inf)
    size_k, size_m = (jnp.sum(size * (size @ jnp.abs(a)), 1) for a in (k, m))
    if double:
        return jnp.finfo(m.dtype).eps * size_k / (2 * omega**2)
    mass, drag, stiffness = (jnp.sum(x.conj() * (x @ a.T), 1) for a in (m, g, k))
    imbalance = jnp.abs(eigenvalue**2 * mass + eigenvalue * drag + stiffness) / omega**2
    mass = jnp.abs(mass)
    high = jnp.where(moves, omega, 0.0) / jnp.min(omega)
    units = jnp.max(size_k / (omega**2 * mass)) + size_m / mass + high
    return (jnp.finfo(m.dtype).eps * units + imbalance / mass) / 2


def coupled_with(system: LinearSystem, direction: Array) -> Bool[Array, "k n"]:
    """Whether each of n coordinates is coupled with the direction of each of k modes."""
    part = system.part(*Direction)
    linked = coupling(part)[:, np.argsort(part.rows)]
    first = [np.argmax(np.array(system.directions)[part.rows] == f) for f in Direction]
    return linked[jnp.array(first)[direction]]


def coupling(part: SystemPart) -> Bool[Array, "n n"]:
    """Whether the directions of each two coordinates are coupled, be it by way of others."""
    m, c, k, sizes = part.mass, part.by_rates, part.stiffness, part.sizes
    eps = 1e4 * jnp.finfo(m.dtype).eps
    direction = np.repeat(np.arange(len(sizes)), sizes)
    in_direction = jnp.asarray(direction[None] == np.arange(len(sizes))[:, None], m.dtype)
    every = jnp.abs(jnp.stack([m, c, k]))
    unit = jnp.max(every, (1, 2), keepdims=True)  # so that squares stay in the range of numbers
    unit = jnp.where(unit > 0, unit, 1.0)
    heavy, damped, stiff = unit * jnp.sqrt(in_direction @ (every / unit) ** 2 @ in_direction.T)
    scales = [jnp.sqrt(jnp.diag(a)) for a in (heavy, stiff)]
    unit_m, unit_k = (a[:, None] * a[None] for a in scales)
    linked = (
        (heavy > eps * unit_m) | (stiff > eps * unit_k) | (damped**2 > eps**2 * unit_m * unit_k)
    )
    linked = linked | linked.T | jnp.eye(len(sizes), dtype=bool)
    for _ in range(2):  # coupling by way of up to three others
        linked = jnp.any(linked[:, :, None] & linked[None], 1)
    return linked[np.ix_(direction, direction)]


def _unmixed(m: Array, x: Array, inside: Array) -> Array:
    """Modes with zeros in coordinates that are not coupled with their own: two modes of the same
    eigenvalue may come as mixtures."""
    x = jnp.where(inside, x, 0.0)
    mass = jnp.sum(x.conj() * (x @ m), 1).real
    return x / jnp.sqrt(mass)[:, None]


def _residual(matrices: tuple[Array, Array, Array], lam: Array, x: Array) -> Float[Array, " k"]:
    norm = jnp.linalg.norm
    m, g, k = matrices
    q = lam[:, None] ** 2 * (x @ m.T) + lam[:, None] * (x @ g.T) + x @ k.T
    size = jnp.abs(lam)
    m, g, k = norm(jnp.stack(matrices), axis=(1, 2))
    return norm(q, axis=-1) / ((size**2 * m + size * g + k) * norm(x, axis=-1))
