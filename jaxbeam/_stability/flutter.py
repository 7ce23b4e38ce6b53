"""Where loads that have no potential make a beam at rest flutter, or buckle.

With M q'' + K q = 0, K not symmetric, a beam is stable while all mu of K x = mu M x, the squares of
its frequencies, are real and positive. It buckles where one is zero, and flutters where two meet
and leave the real axis together: there mu is a double root of the function h of

    [[K - mu M, b], [c^T, 0]] (x, h) = (0, 1),

so that h is zero where it is stationary. (For a column under a force that follows its tip: M. Beck,
Zeitschrift fuer angewandte Mathematik und Physik 3, 1952.)
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from jaxbeam._numerics.brackets import Bracket, Looks, first_change
from jaxbeam._numerics.newton import find_root
from jaxbeam._programs.batches import one_by_one
from jaxbeam._stability.singular import AbstractPlace, border_of
from jaxbeam._status import Status
from jaxbeam._types import Code, Matrix, Scalar, Vector

# Imaginary part of 1 / mu, over its size, from which on two modes count as having met.
_MEETS = 1e-5
_CLOSE = 2.0**-31
_SECANTS = 5  # of which the first begins so far below a load that bisection found, relatively
_APART = 1e-5

# A function of the case and the factor of loads that returns mass and stiffness.
Matrices = Callable[[Any, Scalar], tuple[Matrix, Matrix]]


class Weakest(NamedTuple):
    """The mode that is lost first, if one is: whether one is and whether it flutters (1 or 0), mu,
    and its right and left eigenvectors, real unless two modes meet."""

    lost: Array
    flutters: Array
    square: Scalar
    right: Vector
    left: Vector


@one_by_one
def weakest(m: Matrix, k: Matrix) -> Weakest:
    """The weakest mode of K x = mu M x, by 1 / mu, of which the largest are the most accurate."""
    scale = 1 / jnp.sqrt(jnp.diag(m))
    unit = scale[:, None] * scale[None]
    m, k = m * unit, k * unit
    nu, left, right = jax.lax.linalg.eig(jnp.linalg.solve(k, m))
    flutters = jnp.abs(nu.imag) > _MEETS * jnp.abs(nu)
    lost = flutters | ~(nu.real > 0)
    first = jnp.argmax(jnp.where(lost, 1.0, 1e-9) * jnp.abs(nu))
    # With y^H K^-1 M = nu y^H the left eigenvector of K x = mu M x is K^-H y.
    x, y = right[:, first], jnp.linalg.solve(k.T + 0j, left[:, first])
    return Weakest(
        lost[first].astype(int), flutters[first].astype(int), (1 / nu[first]).real,
        scale * _largest_part(x), scale * _largest_part(y),
    )  # fmt: skip


def _largest_part(x: Array) -> Vector:
    """The real part of a complex vector in the phase in which its largest entry is real."""
    most = x[jnp.argmax(jnp.abs(x))]
    out: Array = (x * most.conj() / jnp.abs(most)).real
    return out


class LostPlace(AbstractPlace):
    """A load under which a beam flutters, or buckles, though its stiffness is not symmetric."""

    x: Vector
    exists: Array
    left: Vector
    square: Scalar
    flutters: Array
    k0: Matrix  # K without loads, and without derivatives
    matrices: Matrices

    def rest(self, given: Any) -> Matrix:
        return self.k0

    def stiffness(self, given: Any, value: Scalar) -> Matrix:
        return self.matrices(given, jnp.where(self.exists, value, 0.0))[1]

    def bordered(self, given: Any, value: Scalar) -> Scalar:
        """The function h where it is stationary, or where mu is zero if the beam buckles."""
        m, k = self.matrices(given, jnp.where(self.exists, value, 0.0))
        own = jnp.diag(self.k0)
        scale = jnp.where(own > 0, own, 1.0) ** -0.5
        unit = scale[:, None] * scale[None]
        m = jnp.where(self.exists, self.square * m * unit, 0.0)
        k = jnp.where(self.exists, k * unit, jnp.eye(len(m), dtype=m.dtype))
        right, left = (a / scale / jnp.linalg.norm(a / scale) for a in (self.x, self.left))
        both = self.exists & (self.flutters > 0)

        def h(share: Scalar) -> Scalar:
            """The scalar of the bordered system, by mu over that which is known."""
            return border_of(k - share * m, left, right)

        def slope(share: Vector, _: Any = None) -> Vector:
            return jnp.where(both, jax.jvp(h, (share[0],), (one,))[1], share[0])[None]

        one = jnp.ones_like(value)
        share = find_root(slope, jnp.where(both, one, 0.0)[None])[0]
        return jnp.where(self.exists, h(share[0]), value - 1.0)


def first_lost(
    loaded: Callable[[Scalar], tuple[Matrix, Matrix, Code]], n: int, bottom: Scalar, ratio: float,
    many: Array,
) -> Bracket:  # fmt: skip
    """The least load, from `bottom` on and each `ratio` times the last, under which a mode is lost,
    by bisection; with the weakest mode at the least load found too large, and a status."""

    def look(here: Bracket) -> tuple[Scalar, tuple[Weakest, Code], Array]:
        m, k, status = loaded(here.value)
        mode = weakest(m, k)
        lost = mode.lost == 1
        mode = jax.tree.map(lambda new, old: jnp.where(lost, new, old), mode, here.kept[0])
        return jnp.where(lost, -1.0, 1.0) + 0 * bottom, (mode, status), jnp.asarray(False)

    zero, none = jnp.zeros_like(bottom), jnp.asarray(0)
    vector = jnp.zeros(n, bottom.dtype)
    kept = Weakest(none, none, zero + 1, vector, vector), jnp.asarray(int(Status.OK))
    top = bottom * jnp.asarray(ratio, bottom.dtype) ** (many - 1)
    looks = Looks(bottom, ratio, top, many, _CLOSE, signs=True)
    return first_change(look, looks, kept, lambda kept: kept[1] == Status.OK)


def polished(place: LostPlace, given: Any, value: Scalar) -> Scalar:
    """The load to rounding, by secants of h, which need no change of its sign: where two modes
    buckle at once it has none."""

    def body(_: int, state: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        old, old_h, new = state
        h = place.bordered(given, new)
        change = jnp.where(h == old_h, 0.0, h * (new - old) / jnp.where(h == old_h, 1.0, h - old_h))
        # A change larger than the last one is of rounding: there the search has ended.
        return new, h, new - jnp.where(jnp.abs(change) < jnp.abs(new - old), change, 0.0)

    near = value * (1 - _APART)
    start = near, place.bordered(given, near), value
    return jax.lax.fori_loop(0, _SECANTS, body, start)[2]
