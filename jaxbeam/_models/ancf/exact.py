"""Elements of the exact rod without shear, whose axial strain is the engineering strain.

XLA fuses a sum of few products into every operation that uses it, and so computes it many times:
`map_rows_once` and `compute_once` prevent that.
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
    """The product of `map_rows`, with lanes in a loop by itself: so its sums are computed once, not
    again for every number that uses them."""
    if x.ndim == 2 or loops_are_dear():
        return map_rows(table, x)
    return jax.lax.map(lambda row: map_rows(table, row[None])[0], x)


# Masks (c, d, 2, 2, 1) of second derivatives by component c of r' or r'' (third axis) and component
# d of r' or r'' (fourth axis): twice by r'; twice by the same component of r'; and by r' and r'',
# with the signs of a quarter turn.
_TWICE_BY_SLOPE = np.zeros((1, 1, 2, 2, 1))
_TWICE_BY_SLOPE[..., 0, 0, :] = 1.0
_SAME_COMPONENT = np.eye(2)[:, :, None, None, None] * _TWICE_BY_SLOPE
_SLOPE_AND_BEND = np.zeros((2, 2, 2, 2, 1))
_SLOPE_AND_BEND[:, :, 0, 1, 0], _SLOPE_AND_BEND[:, :, 1, 0, 0] = -QUARTER_TURN, QUARTER_TURN


class Engineering(Element):
    """U = int EA (|r'| - 1)^2 + EI phi'^2 dx / 2, phi' = (r' x r'') / r'.r' the rate of the angle.

    With s = r'.r', J the turn by a right angle from a2 to a1 and t = -J r', phi' = t.r'' / s has
    the derivatives (J r'' - 2 phi' r') / s by r' and t / s by r''.
    """

    # Three Gauss points would keep the order of convergence, and halve the error of few elements;
    # but then two coarse meshes agree by chance, and the ladder takes that for convergence.
    tears = True

    def strains(self, e: LocalGradients) -> Strains:
        bent = self._bent(e)
        return bent.strain, bent.angle_rate

    def force(self, e: LocalGradients) -> LocalGradients:
        bent = self._bent(e)
        weight = append_axes(self.weights, e.ndim - 2) / bent.square
        couple = self.bending * bent.angle_rate * weight
        axial = self.times_ea(bent.strain * bent.size) - 2 * self.bending * bent.angle_rate**2
        axial = axial * weight
        by_slope = axial[None] * bent.along + couple[None] * bent.curved_normal
        return self._projected(by_slope, couple[None] * bent.back)

    def force_rate(self, e: LocalGradients, rate: LocalGradients) -> LocalGradients:
        """The rate of the force at rates dr' and dr''. The rate of phi' is c - 2 phi' a, with the
        relative rate of stretch a = r'.dr' / s and c = (t.dr'' + J r''.dr') / s; `axial` and
        `couple`, the factors of r' and of J r'' in the force, have their rates too."""
        bent, lanes = self._bent(e), e.ndim - 2
        slope, bend = self._gradients(rate)
        stretch = (bent.along[0] * slope[0] + bent.along[1] * slope[1]) / bent.square
        change = bent.back[0] * bend[0] + bent.back[1] * bend[1]
        change = change + bent.curved_normal[0] * slope[0] + bent.curved_normal[1] * slope[1]
        change, b, w = change / bent.square, self.bending, append_axes(self.weights, lanes)
        couple = w * b * bent.angle_rate / bent.square
        axial = self.times_ea(bent.strain * bent.size) - 2 * b * bent.angle_rate**2
        axial = w * axial / bent.square
        mixed = bent.angle_rate * stretch
        couple_rate = w * b * (change - 4 * mixed) / bent.square
        bent_rate = 4 * b * bent.angle_rate * (change - 3 * mixed)
        axial_rate = w * (self.times_ea(bent.size * stretch) - bent_rate) / bent.square
        by_slope = axial_rate[None] * bent.along + couple_rate[None] * bent.curved_normal
        by_slope = by_slope + axial[None] * slope + couple[None] * jnp.stack([-bend[1], bend[0]])
        by_bend = couple_rate[None] * bent.back + couple[None] * jnp.stack([slope[1], -slope[0]])
        return self._projected(by_slope, by_bend)

    def tangent(self, e: LocalGradients) -> Float[Array, "2 3 2 3 *lanes"]:
        """Second derivatives of strain and angle, gathered: over EA and EI / (EA L^2) = b,

            int (|r'| - 4 b phi'^2) / s^2 p p^T + b k k^T dx, with
            p = S'^T r' and k = S'^T (J r'' - 4 phi' r') / s + S''^T t / s,

        and, from the second derivatives of r'.r' and of r' x r'',

            int (eps |r'| - 2 b phi'^2) / s S'^T S' + b phi' / s (S'^T J S'' + its transpose) dx.
        """
        state, bending, lanes = self._bent(e), self.bending, e.ndim - 2
        square, moment = state.square, bending * state.angle_rate
        bent = moment * state.angle_rate
        k = (state.curved_normal - 4 * state.angle_rate[None] * state.along) / square[None]
        # The vectors of k that S' and S'' are multiplied with.
        by_bend = compute_once(jnp.stack([k, state.back / square[None]], 1))
        factors = compute_once(
            (
                (self.times_ea(state.size) - 4 * bent) / square**2,
                (self.times_ea(state.strain * state.size) - 2 * bent) / square,
                moment / square,
                jnp.broadcast_to(bending, square.shape),
            )
        )
        by_p, along, crossed, by_k = (a[(None,) * 4] for a in factors)
        # All are summed by products with masks: XLA would compute concatenated rows number by
        # number.
        p = state.along[:, None] * state.along[None]
        rows = by_k * by_bend[:, None, :, None] * by_bend[None, :, None]
        rows = rows + append_axes(_TWICE_BY_SLOPE, lanes) * by_p * p[:, :, None, None]
        rows = rows + append_axes(_SAME_COMPONENT, lanes) * along
        rows = rows + append_axes(_SLOPE_AND_BEND, lanes) * crossed
        rows = rows.reshape(4, -1, *e.shape[2:])

        tables = self._tables.reshape(2, -1, 3).transpose(2, 0, 1)
        table = self.weights[(None,) * 4] * tables[:, None, :, None] * tables[None, :, None]
        found = map_rows_once(table.reshape(9, -1), rows)
        return found.reshape(2, 2, 3, 3, *e.shape[2:]).swapaxes(1, 2)

    def _bent(self, e: LocalGradients) -> "_Bent":
        """Strain, tangent and rate of the angle at the Gauss points."""
        d, curved = self._gradients(e)
        strain, along = self.strain(d), axis_of(d)
        size = 1 + strain
        back, curved_normal = jnp.stack([along[1], -along[0]]), jnp.stack([-curved[1], curved[0]])
        angle_rate = (along[1] * curved[0] - along[0] * curved[1]) / size**2
        return _Bent(strain, size, size**2, along, back, curved_normal, angle_rate)

    @property
    def _tables(self) -> Any:
        """The tables `slopes` and `curvatures`, one above the other, (2 g, 3)."""
        tables = self.slopes, self.curvatures
        constant = isinstance(tables[0], np.ndarray)
        return np.concatenate(tables) if constant else jnp.concatenate(tables)

    def _gradients(self, e: LocalGradients) -> tuple[Array, Array]:
        """The gradients d and r'' at the Gauss points, (2, g, *lanes)."""
        rows, g = map_rows_once(self._tables, e), len(self.weights)
        return rows[:, :g], rows[:, g:]

    def _projected(self, by_slope: Array, by_bend: Array) -> LocalGradients:
        """Forces on local coordinates from those on r' and r'': the transpose of `_gradients`."""
        return map_rows_once(self._tables.T, jnp.concatenate([by_slope, by_bend], 1))


class _Bent(NamedTuple):
    """The deformed axis at the Gauss points, in the symbols of `Engineering`."""

    strain: Float[Array, "g *lanes"]  # axial strain |r'| - 1
    size: Float[Array, "g *lanes"]  # |r'|
    square: Float[Array, "g *lanes"]  # s = r'.r'
    along: Float[Array, "2 g *lanes"]  # r'
    back: Float[Array, "2 g *lanes"]  # t = -J r'
    curved_normal: Float[Array, "2 g *lanes"]  # J r'', J the turn by a right angle from a2 to a1
    angle_rate: Float[Array, "g *lanes"]  # phi', rate of the angle of the tangent
