"""Where a stiffness that goes with one parameter becomes singular: found, and differentiated."""

import abc
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._numerics.brackets import Bracket, Looks, first_change, root
from jaxbeam._numerics.linalg import lowest_eigenpair, solve
from jaxbeam._results import nan_unless
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.directions import Direction, naming
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Matrix, Scalar, Vector

# Relative distance of two secants from which on the later one is right to rounding, or nearly.
_NEAR = 1e-6


class AbstractPlace(eqx.Module):
    """A singular stiffness as it is known without derivatives: the coordinates x that give way.

    The parameter is the root of the scalar f of the bordered system

        [[K, b], [b^T, 0]] (x, f) = (0, 1).
    """

    x: eqx.AbstractVar[Vector]
    exists: eqx.AbstractVar[Array]

    @abc.abstractmethod
    def rest(self, given: Any) -> Matrix:
        """The stiffness K where the parameter is zero."""

    @abc.abstractmethod
    def stiffness(self, given: Any, value: Scalar) -> Matrix:
        """The stiffness K at a value of the parameter."""

    def bordered(self, given: Any, value: Scalar) -> Scalar:
        """The function f of the bordered system."""
        x = self.x
        # K is scaled to ones on its diagonal without loads, so that the border fits.
        own = jnp.diag(jax.lax.stop_gradient(self.rest(given)))
        scale = jnp.where(own > 0, own, 1.0) ** -0.5  # a free hinge has none
        border = x / scale / jnp.linalg.norm(x / scale)
        # In a case without a singular stiffness any regular problem will do.
        k = scale[:, None] * self.stiffness(given, value) * scale[None]
        k = jnp.where(self.exists, k, jnp.eye(x.size))
        return jnp.where(self.exists, border_of(k, border, border), value - 1.0)


def border_of(k: Matrix, left: Vector, right: Vector) -> Scalar:
    """The scalar f of the bordered system [[K, left], [right^T, 0]] (x, f) = (0, 1)."""
    system = jnp.block([[k, left[:, None]], [right[None], jnp.zeros((1, 1))]])
    scalar: Scalar = solve(system, jnp.zeros(left.size + 1).at[-1].set(1.0))[-1]
    return scalar


def answer(place: AbstractPlace, given: Any, value: Scalar, status: Code) -> tuple[Scalar, Vector]:
    """The critical value, differentiable by all that is `given`, infinite where there is none, and
    the shape that gives way, largest entry 1; NaN where the status is not OK."""
    x, exists = place.x, place.exists
    value = root(place.bordered, given, jnp.where(exists, value, 1.0))
    value = nan_unless(status == Status.OK, jnp.where(exists, value, jnp.inf))
    return value, jnp.where(exists, x / x[jnp.argmax(jnp.abs(x))], jnp.nan)


class Softest(NamedTuple):
    """The result of an evaluation of K: the group with the lowest eigenvalue, its direction and
    shape, and the lowest eigenvalue of each group."""

    direction: Code
    x: Vector
    values: Vector
    status: Code


class Scan(NamedTuple):
    """The search for a change of sign of the lowest eigenvalue of K."""

    at: Callable[[Scalar], tuple[Matrix, Code]]  # K at a value of the parameter, and a status
    groups: "Groups"
    measure: Callable[[Matrix], Matrix]  # the matrix by which eigenvalues of K are measured, from K
    looks: Looks
    hinged: bool = False  # whether some motions may have no stiffness but rounding

    def run(self, first: int, x: Vector) -> Bracket:
        """The search; it keeps a `Softest`, at first one of the group `first` with the shape
        given."""
        start = Softest(
            self.groups.codes[first], x, jnp.ones(len(self.groups.rows), x.dtype),
            jnp.asarray(int(Status.OK)),
        )  # fmt: skip
        return first_change(self._look, self.looks, start, lambda kept: kept.status == Status.OK)

    def status(self, end: Bracket) -> Code:
        """Whether the search came to an end."""
        ended = first_broken((end.ended(self.looks), Status.INACCURATE))
        return first_failure(end.kept.status, ended)

    def _look(self, here: Bracket) -> tuple[Scalar, Softest, Array]:
        stiffness, status = self.at(here.value)
        by = self.measure(stiffness)
        pairs = [softest(rows, stiffness, by) for rows in self.groups.rows]
        values, x = (jnp.stack(each) for each in zip(*pairs, strict=True))
        if self.hinged:
            size, eps = jnp.abs(x), jnp.finfo(x.dtype).eps
            rough = jnp.sum(size * (size @ jnp.abs(stiffness)), 1) / jnp.sum(x * (x @ by), 1)
            values = values + eps * rough
        low = jnp.argmin(values)
        # Where K is singular to rounding no equilibrium is found: that is the value sought.
        near = jnp.abs(here.value - here.last) < _NEAR * here.value
        there = here.found & near & (status == Status.NOT_CONVERGED)
        return jnp.min(values), Softest(self.groups.codes[low], x[low], values, status), there


class Groups(NamedTuple):
    """Coordinates that lose their stability together, named by one of their directions."""

    directions: tuple[Direction, ...]
    rows: tuple[np.ndarray, ...]

    @property
    def codes(self) -> Array:
        return jnp.asarray([int(direction) for direction in self.directions])


def groups_of(model: AbstractModel, rotor: AnyRotor) -> Groups:
    """Groups in the order of directions. Where axial motion is coupled with others it is also a
    group of its own, at the end, since a rod tears by it."""
    found = {}
    for group in model.coupling(rotor):
        for directions in dict.fromkeys(group):
            rows = np.flatnonzero([direction in directions for direction in model.directions])
            if rows.size:
                found[naming(model.directions[row] for row in rows)] = rows
    found = dict(sorted(found.items()))
    axial = np.flatnonzero([direction == Direction.AXIAL for direction in model.directions])
    if axial.size and Direction.AXIAL not in found:
        found[Direction.AXIAL] = axial
    return Groups(tuple(found), tuple(found.values()))


def softest(rows: np.ndarray, k: Matrix, k0: Matrix) -> tuple[Scalar, Vector]:
    """The lowest eigenvalue of K x = value K_0 x in coordinates `rows`, and x in all
    coordinates."""
    least, x = lowest_eigenpair(k[np.ix_(rows, rows)], k0[np.ix_(rows, rows)])
    return least, x @ np.eye(len(k))[rows]


def direction_of_energy(directions: tuple[Direction, ...], k: Matrix, x: Vector) -> Code:
    """The direction whose coordinates have most of the elastic energy of a shape x, by the
    stiffness K without loads."""
    energy = x * (k @ x)
    shares = [jnp.sum(energy, where=np.equal(directions, direction)) for direction in Direction]
    return jnp.argmax(jnp.stack(shares))


def is_affine(model: AbstractModel, rotor: AnyRotor) -> bool:
    """Whether nothing in the steady state changes the stiffness."""
    return model.equations(rotor).is_linear or Direction.AXIAL not in model.directions


def gives_way(
    rows: np.ndarray, k1: Matrix, k0: Matrix
) -> tuple[Float[Array, ""], Float[Array, " n"]]:
    """The least s > 0 at which K_0 + s K_1 is singular in coordinates `rows`, infinite where there
    is none, NaN for overflow; and the shape in all coordinates."""
    least, x = softest(rows, k1, k0)  # lowest eigenvalue of K_1 x = least K_0 x
    own = np.ix_(rows, rows)
    bound = 1e-13 * jnp.max(jnp.abs(k1[own])) / jnp.max(jnp.abs(k0[own]))  # squares may overflow
    soft = least < -bound
    none = jnp.where(jnp.isfinite(least) & jnp.isfinite(bound), jnp.inf, jnp.nan)
    return jnp.where(soft, 1 / jnp.abs(jnp.where(soft, least, 1.0)), none), x
