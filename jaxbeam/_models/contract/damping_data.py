"""Damping as the equations of one beam have it."""

import equinox as eqx
import jax
from jaxtyping import Array, Float

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
