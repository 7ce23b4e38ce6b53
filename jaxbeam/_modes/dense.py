"""All modes of small motion by dense eigenproblems, one case at a time: for whatever there is."""

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
    """The modes wanted, whether or not the steady state is stable, with numbers where there are
    any. At a root that yields, so that so many motions may be `free`, `loose` says in which
    directions nothing may hold it: there a frequency may be zero, elsewhere one of zero is lost in
    rounding."""
    chosen = _chosen(system, wanted, free)
    eigenvalue, shape = chosen.eigenvalue, chosen.shape
    matrices = (system.mass, system.by_rates, system.stiffness)
    residual = _residual(matrices, eigenvalue, shape)
    tolerance = TOLERANCE * jnp.finfo(residual.dtype).eps
    accurate = residual.max() <= tolerance  # NaN is not
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
    """Share of the kinetic energy that is in each `Direction`."""
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
    finite: Array  # whether all modes that there are were found
    rounding: Float[Array, " k"] | None  # what it may do to each


def _chosen(system: LinearSystem, wanted: Wanted, free: int) -> _Chosen:
    """The modes wanted: the lowest few of a conservative system alone, if they can be told apart,
    else out of all that there are."""
    one_group = system.general and system.conservative and len(system.coupling) == 1
    few = one_group and wanted.named is None and 4 * wanted.count <= len(system.directions)
    if not few:
        return _chosen_of_all(system, wanted, free)

    def one(m: Array, c: Array, k: Array, *along: Array) -> _Chosen:
        here = dataclasses.replace(
            system, mass=m, gyroscopic=c, stiffness=k, taken_along=along[0] if along else None
        )
        return _lowest(here, wanted, free)

    along = () if system.taken_along is None else (system.taken_along,)
    chosen: _Chosen = one_by_one(one)(system.mass, system.gyroscopic, system.stiffness, *along)
    return chosen


def _lowest(system: LinearSystem, wanted: Wanted, free: int) -> _Chosen:
    """The lowest modes of a conservative system of one group: alone, where it is stable and each
    bears a label for certain, else out of all.

    One does if more than half of its kinetic energy is in an uncoupled mode of which less than half
    is in modes that were not found.
    """
    transverse, axial = system.coupling[0]
    part, count = system.part(*transverse, *axial), wanted.count
    m, c, k = part.mass, part.by_rates, part.stiffness
    lam, x, moving, stable = lowest_by_skew(m, c, k, count + _MORE)
    heavy = uncoupled(part, free, bent=True)
    share = participation(x, heavy)
    label = jnp.argmax(share, 1)
    # Of a velocity modes have 2 kinetic / whole energy |x^H M v|^2, which all together are one.
    elsewhere = 1 - 2 * moving @ jnp.abs(x @ heavy) ** 2
    clear = (jnp.max(share, 1) > _CLEAR) & (elsewhere[label] < _CLEAR)
    same = (label[:, None] == label[None]) & clear[None] & ~np.eye(len(x), dtype=bool)
    clear &= ~jnp.any(same, 1)
    near = jnp.abs(lam[count - 1]) < _SPREAD * jnp.abs(lam[0])
    right = jnp.max(_residual((m, c, k), lam, x)) <= TOLERANCE * jnp.finfo(m.dtype).eps

    def all_of_them() -> tuple[Array, Array, Array]:
        lam, x = quadratic_eigenpairs(m, c, k, True, free)
        label = assigned(participation(x, heavy))
        return lam[:count], x[:count], label[:count]

    certain = stable & jnp.all(clear[:count]) & near & right
    lam, x, label = jax.lax.cond(
        certain, lambda: (lam[:count], x[:count], label[:count]), all_of_them
    )
    finite, label = jnp.all(jnp.isfinite(lam)), ranked(label, part.sizes)
    x = _apart(m, x, coupling(part)[label])
    direction_of, number_of = _labels(system.directions, part.rows)
    return _Chosen(
        lam, x[:, np.argsort(part.rows)], direction_of[label], number_of[label],
        jnp.ones((), bool), finite, _rounding(m, c, k, lam, x, free),
    )  # fmt: skip


def _chosen_of_all(system: LinearSystem, wanted: Wanted, free: int) -> _Chosen:
    """The modes wanted, chosen out of all."""
    groups = [
        _group(system, transverse, axial, free)
        for transverse, axial in system.coupling
        if system.where(*transverse, *axial).size
    ]
    rows = np.concatenate([group.rows for group in groups])
    direction_of, number_of = _labels(system.directions, rows)
    eigenvalue = jnp.concatenate([group.eigenvalue for group in groups])
    # What could not be found may be among the lowest.
    finite = ~jnp.any(jnp.isnan(eigenvalue))
    shape = jax.scipy.linalg.block_diag(*[group.shape for group in groups])
    starts = np.cumsum([0, *(group.rows.size for group in groups)])
    label = jnp.concatenate([a.label + i for a, i in zip(groups, starts[:-1], strict=True)])
    direction, number = direction_of[label], number_of[label]
    if wanted.named is None:
        square = -(eigenvalue**2).real
        if system.general:  # they come in order
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
    """The modes of one coupling group, in coordinates `rows`, and the label of each as the place
    among `rows` of the coordinate that bears the same one."""

    rows: np.ndarray
    eigenvalue: Complex[Array, " n"]
    shape: Complex[Array, "n n"]
    label: Int[Array, " n"]
    positive: Array
    rounding: Float[Array, " n"] | None


def _labels(directions: tuple[Direction, ...], rows: np.ndarray) -> tuple[Array, Array]:
    """Direction of each coordinate, and its number within the direction."""
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
    """All modes of directions that are coupled, or of one alone."""
    part = system.part(*transverse, *axial)
    rows, _, sizes, m, g, k, _ = part
    if system.general:
        eigenvalue, shape = quadratic_eigenpairs(m, g, k, system.conservative, free)
        positive = jnp.ones((), int)  # no matter: what grows is found as all else is
    elif transverse == axial:
        eigenvalue, shape, positive = gyroscopic_eigenpairs(m, g, k, free)
    else:
        nt = system.where(*transverse).size
        eigenvalue, shape, positive = planar_eigenpairs(m, g, k, nt, free)
        if Direction.FLAP in axial:  # of a coned beam: it may be stable though flap alone is not
            rod, positive = system.part(Direction.AXIAL), jnp.ones((), int)
            if rod.sizes:
                positive = positive_definite(rod.stiffness).astype(int)
    label = jnp.arange(rows.size)
    if len(sizes) > 1:  # in one direction alone the rank is the number
        # What moves in quadrature to bending alone does not follow it.
        bent = system.general or transverse == axial or Direction.FLAP in axial
        label = assigned(participation(shape, uncoupled(part, free, bent)))
    if system.general:
        label = ranked(label, sizes)
        shape = _apart(m, shape, coupling(part)[label])
    rounding = _rounding(m, g, k, eigenvalue, shape, free)
    return _Group(rows, eigenvalue, shape, label, positive == 1, rounding)


def _rounding(m: Array, g: Array, k: Array, eigenvalue: Array, x: Array, free: int) -> Array | None:
    """The relative error that rounding may bring to frequencies, where it may be much. In double
    precision that is where a root that is all but `free` leaves little of x^H K x: to |x|^T |K| |x|
    over that. In single precision to that of the lowest modes, which all others have some of, and
    to |x|^T |M| |x|, over what is left of them; to what is far above the lowest; and how far x^H Q
    x is from zero."""
    double = jnp.finfo(m.dtype).bits > 32
    if double and not free:
        return None
    moves = eigenvalue != 0
    size, omega = jnp.abs(x), jnp.where(moves, jnp.abs(eigenvalue), jnp.inf)
    stiff, heavy = (jnp.sum(size * (size @ jnp.abs(a)), 1) for a in (k, m))
    if double:
        return jnp.finfo(m.dtype).eps * stiff / (2 * omega**2)
    mass, drag, held = (jnp.sum(x.conj() * (x @ a.T), 1) for a in (m, g, k))
    left = jnp.abs(eigenvalue**2 * mass + eigenvalue * drag + held) / omega**2
    mass = jnp.abs(mass)
    high = jnp.where(moves, omega, 0.0) / jnp.min(omega)
    units = jnp.max(stiff / (omega**2 * mass)) + heavy / mass + high
    return (jnp.finfo(m.dtype).eps * units + left / mass) / 2


def coupled_with(system: LinearSystem, direction: Array) -> Bool[Array, "k n"]:
    """The coordinates that are coupled with modes of these directions."""
    part = system.part(*Direction)
    linked = coupling(part)[:, np.argsort(part.rows)]
    first = [np.argmax(np.array(system.directions)[part.rows] == f) for f in Direction]
    return linked[jnp.array(first)[direction]]


def coupling(part: SystemPart) -> Bool[Array, "n n"]:
    """Whether the directions of each two coordinates are coupled, be it by way of others."""
    m, c, k, sizes = part.mass, part.by_rates, part.stiffness, part.sizes
    eps = 1e4 * jnp.finfo(m.dtype).eps
    direction = np.repeat(np.arange(len(sizes)), sizes)
    of_each = jnp.asarray(direction[None] == np.arange(len(sizes))[:, None], m.dtype)
    every = jnp.abs(jnp.stack([m, c, k]))
    unit = jnp.max(every, (1, 2), keepdims=True)  # lest squares leave the range of the numbers
    unit = jnp.where(unit > 0, unit, 1.0)
    heavy, damped, stiff = unit * jnp.sqrt(of_each @ (every / unit) ** 2 @ of_each.T)
    own = [jnp.sqrt(jnp.diag(a)) for a in (heavy, stiff)]
    unit_m, unit_k = (a[:, None] * a[None] for a in own)
    linked = (
        (heavy > eps * unit_m) | (stiff > eps * unit_k) | (damped**2 > eps**2 * unit_m * unit_k)
    )
    linked = linked | linked.T | jnp.eye(len(sizes), dtype=bool)
    for _ in range(2):  # by way of up to three others
        linked = jnp.any(linked[:, :, None] & linked[None], 1)
    return linked[np.ix_(direction, direction)]


def _apart(m: Array, x: Array, inside: Array) -> Array:
    """Modes without what is not coupled with them, of which they may have taken some where two have
    the same eigenvalue."""
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
