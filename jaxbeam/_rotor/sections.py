"""Sections along a beam as matrices of six by six about an axis, for elements of rods."""

import abc
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

SIXES = np.triu_indices(6)
_UNSYMMETRIC = 1e-6  # of the geometric mean of diagonal entries
_PLACE = np.zeros((6, 6), int)
_PLACE[SIXES] = np.arange(21)
_PLACE = np.maximum(_PLACE, _PLACE.T)
Places = Float[np.ndarray, " m"]


def full_matrices(rows: Float[Array, "n 21"]) -> Float[Array, "n 6 6"]:
    """Symmetric matrices from their upper triangles, whose 21 entries are given row by row."""
    return rows[:, _PLACE.ravel()].reshape(-1, 6, 6)


def upper_triangles(matrices: Float[Array, "n 6 6"]) -> Float[Array, "n 21"]:
    """Upper triangles of the symmetric parts of matrices, 21 entries row by row."""
    return ((matrices + matrices.swapaxes(1, 2)) / 2)[:, SIXES[0], SIXES[1]]


def unsymmetric(matrices: Float[np.ndarray, "n 6 6"]) -> tuple[int, ...] | None:
    """The place of the first entry that differs from its mirror image by more than rounding, of the
    geometric mean of the two on the diagonal; None where there is none."""
    own = np.sqrt(np.abs(np.einsum("nii->ni", matrices)))
    apart = np.abs(matrices - matrices.swapaxes(1, 2))
    found = np.argwhere(apart > _UNSYMMETRIC * own[:, :, None] * own[:, None])
    return tuple(found[0].tolist()) if len(found) else None


class AbstractSections(eqx.Module):
    """An axis in space with sections along it; places are shares of its length from 0 to 1."""

    @property
    @abc.abstractmethod
    def breaks(self) -> tuple[float, ...]:
        """Places between the ends where the axis has a kink or a property a step."""

    @property
    @abc.abstractmethod
    def edges(self) -> tuple[float, ...]:
        """Places from 0 to 1 between which axis and properties are smooth."""

    @abc.abstractmethod
    def axis_at(self, places: Places) -> tuple[Float[Array, "m 3"], Float[Array, "m 3"]]:
        """Points of the axis in axes of the blade, from its root, and their derivatives by the
        place, in m."""

    @abc.abstractmethod
    def twist_at(self, places: Places) -> Float[Array, " m"]:
        """Angles of the sections about the axis, in rad."""

    def fibres_at(self, places: Places) -> tuple[Float[Array, " m"], Float[Array, " m"]] | None:
        """The square of the polar radius of gyration of the stiffness (m^2), and the rate of twist
        as built (rad/m); None: twist does not lengthen fibres along the axis."""
        return None

    @abc.abstractmethod
    def compliance_at(self, places: Places) -> Float[Array, "m 6 6"]:
        """Compliances, which make strains of forces, in axes of the sections."""

    @abc.abstractmethod
    def stiffness_at(self, places: Places) -> Float[Array, "m 6 6"]:
        """Stiffnesses, which make forces of strains, in axes of the sections."""

    @abc.abstractmethod
    def inertia_at(self, places: Places) -> Float[Array, "m 6 6"]:
        """Inertias, which make momenta per length of velocities, in axes of the sections."""


def frames(slope: Float[Array, "m 3"], twist: Float[Array, " m"]) -> Float[Array, "m 3 3"]:
    """Axes of sections, as columns, from the derivative of the axis by the place, and the twist:
    the tangent, then without twist the direction across it that is nearest to a2, and a third."""
    tangent = slope / jnp.sqrt(jnp.sum(slope**2, 1, keepdims=True))
    third = jnp.stack([-tangent[:, 2], 0 * tangent[:, 0], tangent[:, 0]], 1)
    third = third / jnp.sqrt(jnp.sum(third**2, 1, keepdims=True))
    second: Any = jnp.cross(third, tangent)
    cos, sin = jnp.cos(twist)[:, None], jnp.sin(twist)[:, None]
    return jnp.stack([tangent, cos * second + sin * third, cos * third - sin * second], 2)
