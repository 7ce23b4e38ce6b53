"""Elements of the exact rod without shear, whose axial strain is the engineering strain.

Compilers that fuse operations compute sums of few products anew for every number that is made of
them, unless they are `map_rows_once`; what was divided is computed once.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.ancf.energies import (
    QUARTER_TURN,
    Element,
    LocalGradients,
    Strains,
    axis_of,
    map_rows,
)
from jaxbeam._programs.lanes import append_axes, compute_once
from jaxbeam._programs.platforms import loops_are_dear


def map_rows_once(
    table: Float[np.ndarray, "a b"] | Float[Array, "a b"], x: Float[Array, "c b *lanes"]
) -> Array:
    """The product of `map_rows`, where there are lanes in a loop of its own: the sums are computed
    once, and not anew for every number that is made of them."""
    if x.ndim == 2 or loops_are_dear():
        return map_rows(table, x)
    return jax.lax.map(lambda row: map_rows(table, row[None])[0], x)


# Masks of second derivatives by components c and d of r' or r'', (c, d, 2, 2, g): of those by r'
# alone, of these by the same component twice, and of those by r' and r'', which are skewed.
_OF_SLOPES = np.zeros((1, 1, 2, 2, 1))
_OF_SLOPES[..., 0, 0, :] = 1.0
_OF_BOTH = np.eye(2)[:, :, None, None, None] * _OF_SLOPES
_SKEWED = np.zeros((2, 2, 2, 2, 1))
_SKEWED[:, :, 0, 1, 0], _SKEWED[:, :, 1, 0, 0] = -QUARTER_TURN, QUARTER_TURN


class Engineering(Element):
    """U = int EA (|r'| - 1)^2 + EI phi'^2 dx / 2, phi' = (r' x r'') / r'.r' the rate of the angle.

    With s = r'.r', J a turn by a right angle and t = r' turned back by one, phi' = t.r'' / s, and
    its derivatives are (J r'' - 2 phi' r') / s by r' and t / s by r''.
    """

    # Three points would do for the order of convergence, and halve the error of few elements; but
    # then two coarse meshes agree by chance, and the ladder takes that for convergence.
    tears = True

    def strains(self, e: LocalGradients) -> Strains:
        at = self._at(e)
        return at.strain, at.angle_rate

    def force(self, e: LocalGradients) -> LocalGradients:
        at = self._at(e)
        over = append_axes(self.weights, e.ndim - 2) / at.square
        couple = self.bending * at.angle_rate * over
        pull = (self.pulled(at.strain * at.size) - 2 * self.bending * at.angle_rate**2) * over
        by_slope = pull[None] * at.along + couple[None] * at.curved_normal
        return self._projected(by_slope, couple[None] * at.back)

    def force_rate(self, e: LocalGradients, rate: LocalGradients) -> LocalGradients:
        """Rates of the force. With a = r'.d r' / s, that of stretch, and
        c = (t.d r'' + J r''.d r') / s, that of phi' is c - 2 phi' a, and those of what the force
        has before r' and J r'' are as below."""
        at, lanes = self._at(e), e.ndim - 2
        slope, bend = self._gradients(rate)
        stretch = (at.along[0] * slope[0] + at.along[1] * slope[1]) / at.square
        change = at.back[0] * bend[0] + at.back[1] * bend[1]
        change = change + at.curved_normal[0] * slope[0] + at.curved_normal[1] * slope[1]
        change, b, w = change / at.square, self.bending, append_axes(self.weights, lanes)
        couple = w * b * at.angle_rate / at.square
        pull = w * (self.pulled(at.strain * at.size) - 2 * b * at.angle_rate**2) / at.square
        twist = at.angle_rate * stretch
        couple_rate = w * b * (change - 4 * twist) / at.square
        pull_rate = self.pulled(at.size * stretch) - 4 * b * at.angle_rate * (change - 3 * twist)
        pull_rate = w * pull_rate / at.square
        by_slope = pull_rate[None] * at.along + couple_rate[None] * at.curved_normal
        by_slope = by_slope + pull[None] * slope + couple[None] * jnp.stack([-bend[1], bend[0]])
        by_bend = couple_rate[None] * at.back + couple[None] * jnp.stack([slope[1], -slope[0]])
        return self._projected(by_slope, by_bend)

    def tangent(self, e: LocalGradients) -> Float[Array, "2 3 2 3 *lanes"]:
        """Second derivatives of strain and angle, gathered: over EA and EI / (EA L^2) = b,

            int (|r'| - 4 b phi'^2) / s^2 p p^T + b k k^T dx, with
            p = S'^T r' and k = S'^T (J r'' - 4 phi' r') / s + S''^T t / s,

        and, from the second derivatives of r'.r' and of r' x r'',

            int (eps |r'| - 2 b phi'^2) / s S'^T S' + b phi' / s (S'^T J S'' + its transpose) dx.
        """
        at, bending, lanes = self._at(e), self.bending, e.ndim - 2
        square, moment = at.square, bending * at.angle_rate
        bent = moment * at.angle_rate
        k = (at.curved_normal - 4 * at.angle_rate[None] * at.along) / square[None]
        both = compute_once(
            jnp.stack([k, at.back / square[None]], 1)
        )  # of k, what goes with S' and S''
        each = compute_once(
            (
                (self.pulled(at.size) - 4 * bent) / square**2,
                (self.pulled(at.strain * at.size) - 2 * bent) / square,
                moment / square,
                jnp.broadcast_to(bending, square.shape),
            )
        )
        by_p, along, across, by_k = (a[(None,) * 4] for a in each)
        # All of them by products, since a compiler would make rows put together from parts number
        # by number.
        p = at.along[:, None] * at.along[None]
        rows = by_k * both[:, None, :, None] * both[None, :, None]
        rows = rows + append_axes(_OF_SLOPES, lanes) * by_p * p[:, :, None, None]
        rows = rows + append_axes(_OF_BOTH, lanes) * along + append_axes(_SKEWED, lanes) * across
        rows = rows.reshape(4, -1, *e.shape[2:])

        tables = self._tables.reshape(2, -1, 3).transpose(2, 0, 1)
        table = self.weights[(None,) * 4] * tables[:, None, :, None] * tables[None, :, None]
        found = map_rows_once(table.reshape(9, -1), rows)
        return found.reshape(2, 2, 3, 3, *e.shape[2:]).swapaxes(1, 2)

    def _at(self, e: LocalGradients) -> "_Bent":
        """The strain and its derivatives at the Gauss points."""
        d, curved = self._gradients(e)
        strain, along = self.strain(d), axis_of(d)
        size = 1 + strain
        back, curved_normal = jnp.stack([along[1], -along[0]]), jnp.stack([-curved[1], curved[0]])
        angle_rate = (along[1] * curved[0] - along[0] * curved[1]) / size**2
        return _Bent(strain, size, size**2, along, back, curved_normal, angle_rate)

    @property
    def _tables(self) -> Any:
        """The tables `slopes` and `curvatures`."""
        tables = self.slopes, self.curvatures
        constant = isinstance(tables[0], np.ndarray)
        return np.concatenate(tables) if constant else jnp.concatenate(tables)

    def _gradients(self, e: LocalGradients) -> tuple[Array, Array]:
        """The gradients d and r'' at the Gauss points, (2, g, *lanes)."""
        both, g = map_rows_once(self._tables, e), len(self.weights)
        return both[:, :g], both[:, g:]

    def _projected(self, by_slope: Array, by_bend: Array) -> LocalGradients:
        """Forces on local coordinates: the transpose of `_gradients`."""
        return map_rows_once(self._tables.T, jnp.concatenate([by_slope, by_bend], 1))


class _Bent(NamedTuple):
    """Strain and tangent vectors of `Engineering`: eps, |r'|, s, r', t, J r'' and phi'."""

    strain: Float[Array, "g *lanes"]
    size: Float[Array, "g *lanes"]
    square: Float[Array, "g *lanes"]
    along: Float[Array, "2 g *lanes"]
    back: Float[Array, "2 g *lanes"]
    curved_normal: Float[Array, "2 g *lanes"]
    angle_rate: Float[Array, "g *lanes"]
