"""Damping as the equations of one beam have it, and the viscous forces of whatever has strains.

Stresses may be in proportion to the rates of strain (Kelvin and Voigt). With strains s(q) and an
energy s.D s / 2, D constant, stresses D s' do the forces B^T D B q' on the coordinates, B = ds/dq.
Their power is twice the energy of the rates of strain, never negative, and zero in any rigid
motion, however much is strained: stress that turns with the material is at rest in it. Where
strains are linear in the coordinates that is the stiffness times q'; else the rate of the elastic
force is more, by the stress times d B^T/dt.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Float

from jaxbeam._programs.lanes import transposed
from jaxbeam._types import Matrix, Number

Dampers = tuple[Number | None, Number | None]  # at the root, in plane and in flap, N m s


class Drag(eqx.Module):
    """A `Damping` in the form that equations of motion take: coefficients; dampers of the root, if
    its angles are not linear in the coordinates; a constant matrix, of ratios and of dampers whose
    angles are linear; coefficients of full sections, in models that support these; and dampers of
    supports."""

    mass_coefficient: Number | None = None
    stiffness_coefficient: Number | None = None
    dampers: Dampers | None = None
    matrix: Matrix | None = None
    section_coefficients: Float[Array, "6"] | None = None
    root: Float[Array, "6"] | None = None
    tip: Float[Array, "6"] | None = None

    @property
    def is_none(self) -> bool:
        """Whether nothing is damped."""
        return not jax.tree.leaves(self)

    @property
    def is_viscous(self) -> bool:
        """Whether rates of strains are damped."""
        return not (self.stiffness_coefficient is None and self.section_coefficients is None)


@transposed(on=False)
def viscous(
    strains: Callable[[Array], Any], stresses: Callable[[Any], Any], q: Array, rate: Array
) -> Array:
    """The viscous force B^T D B q' of strains s(q) with stresses D s."""
    push = jax.linearize(strains, q)[1]
    force: Array = jax.linear_transpose(push, q)(stresses(push(rate)))[0]
    return force
