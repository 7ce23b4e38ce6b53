"""Frequencies, growth rates and mode shapes about steady rotation, labelled and differentiable."""

import functools
import operator
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from jaxbeam._models.base import (
    AbstractModel,
    Family,
    Label,
    LinearSystem,
    checked_case,
    checked_model,
    guarded_matrices,
)
from jaxbeam._numerics.linalg import planar_eigenpairs, solve, symmetric_modes
from jaxbeam._numerics.program import Program
from jaxbeam._results import where_known
from jaxbeam._rotor.beam import Rotor
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Real, Scalar, Vectors


class Modes(eqx.Module):
    """k modes x e^(lambda t) of M q'' + G q' + K q = 0 with n coordinates.

    | field        | shape  | unit  |                                                            |
    |--------------|--------|-------|------------------------------------------------------------|
    | eigenvalue   | (k,)   | rad/s | lambda = growth_rate + i frequency, frequency >= 0         |
    | shape        | (k, n) | *     | x, scaled to unit modal mass; transverse part real, axial  |
    |              |        |       | part imaginary (a quarter turn later) while stable         |
    | family       | (k,)   |       | `Family` of the mode as an integer                         |
    | order        | (k,)   |       | its number within the family, from 1                       |
    | energy_share | (k, 3) |       | share of kinetic energy that is in plane, flap, axial      |
    | residual     | (k,)   |       | backward error: norm(Q x) / ((abs(lambda)^2 norm(M)        |
    |              |        |       | + abs(lambda) norm(G) + norm(K)) norm(x))                  |
    | status       | ()     |       | `Status`; unless OK the numbers are NaN, but for residual  |
    | steady_strain| ()     |       | see `LinearSystem`                                         |

    (*) kg^-1/2 for coordinates in metres.

    **Labels** do not depend on how a speed was reached. Without Coriolis coupling the modes at any
    speed fall into families, each with simple frequencies that never cross, so their numbers mean
    something. A coupled mode takes the label of the uncoupled mode *at the same speed* in which it
    has most of its kinetic energy, each label given once. Through a crossing or a veering a label
    therefore stays with the kind of motion; inside a veering it changes branch where the two
    branches share the motion equally. The position among the in-plane and axial modes in order of
    frequency is the label that follows a branch instead.
    """

    eigenvalue: Complex[Array, " k"]
    shape: Vectors
    family: Int[Array, " k"]
    order: Int[Array, " k"]
    energy_share: Float[Array, "k 3"]
    residual: Float[Array, " k"]
    status: Code
    steady_strain: Scalar

    @property
    def frequency(self) -> Float[Array, "... k"]:
        """Im(lambda) in rad/s; zero for a mode that diverges."""
        return self.eigenvalue.imag

    @property
    def growth_rate(self) -> Float[Array, "... k"]:
        """Re(lambda) in 1/s: positive for a mode that grows."""
        return self.eigenvalue.real

    @property
    def labels(self) -> tuple[Label, ...]:
        """Labels of the modes, once their values are known (not under `jit`); of a batch a tuple
        of these for each case."""
        return _named(np.asarray(self.family), np.asarray(self.order))


def _named(family: np.ndarray, order: np.ndarray) -> tuple[Any, ...]:
    pairs = zip(family, order, strict=True)
    if family.ndim > 1:
        return tuple(_named(*pair) for pair in pairs)
    return tuple(Label(Family(int(f)), int(k)) for f, k in pairs)


def modes(
    model: AbstractModel,
    rotor: Rotor,
    angular_speed: Real,
    which: int | Sequence[Label] | None = None,
    *,
    throw: bool = True,
) -> Modes:
    """Modes of small vibration about steady rotation at `angular_speed` (rad/s).

    `which` is how many, lowest first (growing ones before all), six by default, or the labels
    wanted, in that order (see `labels`). Real symmetric computations while the stiffness is
    positive definite, the general eigenproblem with growth rates where it is not.

    Eigenvalues and shapes are differentiable with respect to every parameter and the speed, in
    both modes and to any order, wherever the eigenvalue is simple within its plane; crossings of
    flap with in-plane modes are harmless. First derivatives of eigenvalues cost no linear solve:
    d lambda = -y^T (lambda^2 dM + lambda dG + dK) x / y^T (2 lambda M + G) x.

    `throw=False` returns failures as `Modes.status` instead of raising: use it in sweeps. The
    numbers of a case that failed are NaN, and so are their derivatives in forward mode; in reverse
    mode they are zero, lest they spoil gradients by parameters that cases of a batch share.

    Raises `ValueError` or `TypeError` for a malformed argument, and, with `throw`, `ValueError` for
    a parameter out of range (under `jit` `RuntimeError`) and `RuntimeError` where no steady state
    exists or is found.
    """
    result = find(model, *checked_case(model, rotor, angular_speed), choose(model, which))
    return raise_unless_ok(result, result.status) if throw else result


# How many modes, or family and order of each wanted mode: arrays, so that asking for other labels
# does not compile anew.
Selection = int | tuple[Int[Array, " k"], Int[Array, " k"]]


def choose(model: AbstractModel, which: int | Sequence[Label] | None) -> Selection:
    """`which` of `modes`, checked against what the model has."""
    total = len(checked_model(model).families)
    if which is None:
        return min(6, total)
    if isinstance(which, Label):
        which = (which,)
    if not isinstance(which, Sequence):
        if isinstance(which, bool) or np.shape(which) or not hasattr(which, "__index__"):
            raise TypeError(f"which must be an int or labels, got {which!r}")
        try:
            count = operator.index(which)
        except TypeError:  # of an array of floats
            raise TypeError(f"which must be an int or labels, got {which!r}") from None
        if not 1 <= count <= total:
            raise ValueError(f"which must be between 1 and {total} for this model, got {count}")
        return count
    if not which:
        raise ValueError("which must name at least one mode")
    for label in which:
        if not isinstance(label, Label) or not isinstance(label.family, Family):
            raise TypeError(f"which: not a Label: {label!r}; make them with jaxbeam.labels")
        if isinstance(label.order, bool) or not isinstance(label.order, int):
            raise TypeError(f"which: the order of a Label must be an int, got {label.order!r}")
        available = model.families.count(label.family)
        if not 1 <= label.order <= available:
            raise ValueError(
                f"which: this model has {available} modes of {label.family.title}, "
                f"so there is no {label}"
            )
    named = np.array([(int(family), order) for family, order in which])
    return jnp.asarray(named[:, 0]), jnp.asarray(named[:, 1])


@Program
def find(model: AbstractModel, rotor: Rotor, speed: Scalar, selection: Selection) -> Modes:
    """What `modes` does once its arguments are checked."""
    system = guarded_matrices(model, rotor, speed)
    eigenvalue, shape, family, order, positive = _selected(system, selection)
    matrices = (system.mass, system.gyroscopic, system.stiffness)
    residual = jax.lax.stop_gradient(_residual(matrices, eigenvalue, shape))
    tolerance = 5e6 * jnp.finfo(speed.dtype).eps  # 1e-9
    status = jnp.where(residual.max() <= tolerance, Status.OK, Status.INACCURATE)  # NaN is not
    finite = jnp.all(jnp.isfinite(eigenvalue)) & jnp.all(jnp.isfinite(shape))
    status = jnp.where(finite, status, Status.NOT_FINITE)
    status = jnp.where(positive, status, Status.NO_EQUILIBRIUM)
    status = jnp.where(system.status == Status.OK, status, system.status).astype(int)
    ok = status == Status.OK
    eigenvalue, shape = _differentiable(system, ok, eigenvalue, shape, family)
    kinds = jnp.asarray(system.families)
    kinetic = (shape.conj() * (shape @ system.mass)).real
    share = kinetic @ (kinds[:, None] == np.array(Family)[None]).astype(speed.dtype)
    return Modes(
        eigenvalue=where_known(ok, eigenvalue),
        shape=where_known(ok, shape * _sign(model, shape, family)[:, None]),
        family=family,
        order=order,
        energy_share=where_known(ok, share / jnp.sum(share, -1, keepdims=True)),
        residual=residual,
        status=status,
        steady_strain=where_known(ok, system.steady_strain),
    )


def _selected(system: LinearSystem, selection: Selection) -> tuple[Array, ...]:
    """Eigenvalues, shapes, families and orders of the modes wanted, without derivatives; and
    whether the axial stiffness is positive definite."""
    planes = [
        _plane(system, *families)
        for families in ((Family.IN_PLANE, Family.AXIAL), (Family.FLAP,))
        if system.where(*families).size
    ]
    rows = np.concatenate([plane.rows for plane in planes])
    family_of, order_of = _labels(system.families, rows)
    eigenvalue = jnp.concatenate([plane.eigenvalue for plane in planes])
    shape = jax.scipy.linalg.block_diag(*[plane.shape for plane in planes])
    starts = np.cumsum([0, *(plane.rows.size for plane in planes)])
    label = jnp.concatenate([a.label + i for a, i in zip(planes, starts[:-1], strict=True)])
    family, order = family_of[label], order_of[label]
    if isinstance(selection, int):
        pick = jnp.argsort(-(eigenvalue**2).real)[:selection]
        family, order = family[pick], order[pick]
    else:
        named = (family[None] == selection[0][:, None]) & (order[None] == selection[1][:, None])
        pick, (family, order) = jnp.argmax(named, axis=1), selection
    positive = functools.reduce(jnp.logical_and, [plane.positive for plane in planes])
    return eigenvalue[pick], shape[pick][:, np.argsort(rows)], family, order, positive


def _differentiable(
    system: LinearSystem, ok: Array, eigenvalue: Array, shape: Array, family: Array
) -> tuple[Array, Array]:
    """The same modes, with derivatives by all that the matrices depend on."""
    dtype = system.mass.dtype
    kinds = jnp.asarray(system.families)
    signature = jnp.where(kinds == Family.AXIAL, -1.0, 1.0)
    same_plane = (kinds == Family.FLAP)[None] == (family == Family.FLAP)[:, None]
    same_plane = same_plane.astype(dtype)
    # In a case that failed, a regular problem takes the place of its own, so that the NaN put in
    # later is the end of it: gradients of other cases by shared parameters stay finite.
    identity = jnp.eye(len(system.families), dtype=dtype)
    matrices = (system.mass, system.gyroscopic, system.stiffness)
    instead = (identity, 0 * identity, 2 * identity)
    return _eigenpairs(
        *(jnp.where(ok, a, b) for a, b in zip(matrices, instead, strict=True)),
        jnp.where(ok, eigenvalue, 1j),
        jnp.where(ok, shape, identity[jnp.argmax(same_plane, axis=1)]),
        same_plane,
        signature,
    )


class _Plane(NamedTuple):
    """What is found in one plane: modes in coordinates `rows`, and the label of each as the place
    among `rows` of the coordinate that bears the same one."""

    rows: np.ndarray
    eigenvalue: Complex[Array, " n"]
    shape: Complex[Array, "n n"]
    label: Int[Array, " n"]
    positive: Array


def _labels(families: tuple[Family, ...], rows: np.ndarray) -> tuple[Array, Array]:
    """Family of each coordinate, and its number within the family."""
    kinds = np.asarray([int(families[row]) for row in rows])
    return jnp.asarray(kinds), jnp.asarray(
        [sum(kinds[:i] == kinds[i]) + 1 for i in range(rows.size)]
    )


def _plane(system: LinearSystem, transverse: Family, *axial: Family) -> _Plane:
    """All modes of one plane, without derivatives: these come in `find`."""
    rows = system.where(transverse, *axial)
    n, n_transverse = rows.size, system.where(transverse).size
    m, g, k = (
        jax.lax.stop_gradient(a)[np.ix_(rows, rows)]
        for a in (system.mass, system.gyroscopic, system.stiffness)
    )
    pairs = planar_eigenpairs(m, g, k, n_transverse)
    label = jnp.arange(n)
    if 0 < n_transverse < n:  # in one family alone the rank is the order
        label = _assign(_participation(m, k, pairs.right, n_transverse))
    return _Plane(rows, pairs.eigenvalue, pairs.right, label, pairs.positive == 1)


def _participation(m: Array, k: Array, x: Array, n_transverse: int) -> Float[Array, "n n"]:
    """Share of the kinetic energy of coupled mode i that lies in uncoupled mode j."""
    parts = []
    for part in (slice(0, n_transverse), slice(n_transverse, None)):
        v = symmetric_modes(m[part, part], k[part, part])
        parts.append(jnp.abs(x[:, part] @ m[part, part] @ v.T) ** 2)
    share = jnp.concatenate(parts, axis=1)
    return share / jnp.sum(share, axis=1, keepdims=True)


def _assign(share: Float[Array, "n n"]) -> Int[Array, " n"]:
    """Column for each row: the largest entry first, each row and column used once.

    All pairs that prefer each other are settled at once, which ends in the same assignment as
    taking the largest entry left, in a few rounds instead of n.
    """
    n = share.shape[0]

    def body(state: tuple[Array, Array]) -> tuple[Array, Array]:
        left, column = state
        preferred = jnp.argmax(left, axis=1)
        mutual = (column < 0) & (jnp.argmax(left, axis=0)[preferred] == jnp.arange(n))
        taken = jnp.any(mutual[:, None] & (preferred[:, None] == jnp.arange(n)[None]), axis=0)
        left = jnp.where(mutual[:, None] | taken[None], -1.0, left)
        return left, jnp.where(mutual, preferred, column)

    # NaN, from a case that failed, would never settle.
    start = jnp.where(jnp.isnan(share), 0.0, share)
    return jax.lax.while_loop(lambda state: jnp.any(state[1] < 0), body, (start, jnp.full(n, -1)))[
        1
    ]


@jax.custom_jvp
def _eigenpairs(
    mass: Array,
    gyroscopic: Array,
    stiffness: Array,
    eigenvalue: Array,
    shape: Array,
    same_plane: Array,
    signature: Array,
) -> tuple[Array, Array]:
    """Identity on (eigenvalue, shape) that knows their derivatives by the three matrices.

    Left eigenvectors are y = S x, S = diag(`signature`), because M and K are symmetric and G is
    skew and couples only coordinates of opposite signature.
    """
    return eigenvalue, shape


@_eigenpairs.defjvp
def _eigenpairs_jvp(
    primals: tuple[Array, ...], tangents: tuple[Array, ...]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    m, g, k, _, _, same_plane, signature = primals
    dm, dg, dk = tangents[:3]
    # Through the function itself, not its arguments: then this rule can be differentiated again.
    eigenvalue, shape = _eigenpairs(*primals)

    def one(lam: Array, x: Array, plane: Array) -> tuple[Array, Array]:
        y = signature * x
        force = lam**2 * (dm @ x) + lam * (dg @ x) + dk @ x
        slope = 2 * lam * (m @ x) + g @ x
        dlam = -(y @ force) / (y @ slope)
        # [Q, Q'x; (S M x)^T, 0] [dx; dlam] = [-dQ x; -x^T S dM x / 2], Q = lam^2 M + lam G + K,
        # regular for a simple eigenvalue. Rows of the other plane are replaced by dx = 0, since
        # there Q may be singular: flap and in-plane frequencies of a square section coincide.
        inside = plane[:, None] * plane[None]
        q = jnp.where(inside > 0, lam**2 * m + lam * g + k, jnp.diag(1 - plane))
        bordered = jnp.block([[q, slope[:, None]], [(y @ m)[None], jnp.zeros((1, 1))]])
        right = jnp.concatenate([-force * plane, -0.5 * (y @ (dm @ x))[None]])
        return dlam, solve(bordered, right)[:-1]

    return (eigenvalue, shape), jax.vmap(one)(eigenvalue, shape, same_plane)


def _residual(matrices: tuple[Array, Array, Array], lam: Array, x: Array) -> Float[Array, " k"]:
    norm = jnp.linalg.norm
    m, g, k = matrices
    q = lam[:, None] ** 2 * (x @ m.T) + lam[:, None] * (x @ g.T) + x @ k.T
    size = jnp.abs(lam)
    m, g, k = norm(jnp.stack(matrices), axis=(1, 2))
    return norm(q, axis=-1) / ((size**2 * m + size * g + k) * norm(x, axis=-1))


def _sign(model: AbstractModel, shape: Vectors, family: Array) -> Float[Array, " k"]:
    """Sign that makes the tip move the positive way in the direction that names the mode."""
    # Displacement is ordered axial, in plane, flap.
    tip = model.displacement(np.ones(1))[np.array([1, 2, 0]), 0]
    own = jnp.sum(tip[family] * shape, -1)
    # Stable axial parts are imaginary: x = (w, -i u).
    own = jnp.where(family == Family.AXIAL, -own.imag, own.real)
    return jax.lax.stop_gradient(jnp.where(own < 0, -1.0, 1.0))
