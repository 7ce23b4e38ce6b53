"""Sections along a beam: full matrices about an axis, as the elements of a rod ask for them."""

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
    """Symmetric matrices from their upper triangles, row by row."""
    return rows[:, _PLACE.ravel()].reshape(-1, 6, 6)


def upper_triangles(matrices: Float[Array, "n 6 6"]) -> Float[Array, "n 21"]:
    """Upper triangles of matrices, which may differ from symmetric ones by rounding."""
    return ((matrices + matrices.swapaxes(1, 2)) / 2)[:, SIXES[0], SIXES[1]]


def unsymmetric(matrices: Float[np.ndarray, "n 6 6"]) -> tuple[int, ...] | None:
    """The place of the first entry that differs from its mirror image by more than rounding, of the
    geometric mean of the two on the diagonal; None where there is none."""
    own = np.sqrt(np.abs(np.einsum("nii->ni", matrices)))
    apart = np.abs(matrices - matrices.swapaxes(1, 2))
    found = np.argwhere(apart > _UNSYMMETRIC * own[:, :, None] * own[:, None])
    return tuple(found[0].tolist()) if len(found) else None


class AbstractSections(eqx.Module):
    """An axis in space, and what is at each place along it, a share of its length from 0 to 1."""

    @property
    @abc.abstractmethod
    def breaks(self) -> tuple[float, ...]:
        """Places between the ends where the axis has a kink or a property a step."""

    @property
    @abc.abstractmethod
    def edges(self) -> tuple[float, ...]:
        """Places from 0 to 1 between which all is smooth."""

    @abc.abstractmethod
    def axis_at(self, places: Places) -> tuple[Float[Array, "m 3"], Float[Array, "m 3"]]:
        """Points of the axis in axes of the blade, from its root, and how they go on with the
        place, in m."""

    @abc.abstractmethod
    def twist_at(self, places: Places) -> Float[Array, " m"]:
        """Angles of the sections about the axis, in rad."""

    def fibres_at(self, places: Places) -> tuple[Float[Array, " m"], Float[Array, " m"]] | None:
        """The square of the polar radius of gyration of the stiffness, and the rate at which
        sections turn about the axis as they are built, in rad/m; None: fibres along the axis do not
        lengthen where sections twist."""
        return None

    @abc.abstractmethod
    def compliance_at(self, places: Places) -> Float[Array, "m 6 6"]:
        """Strains by forces, in axes of the sections."""

    @abc.abstractmethod
    def stiffness_at(self, places: Places) -> Float[Array, "m 6 6"]:
        """Forces by strains, in axes of the sections."""

    @abc.abstractmethod
    def inertia_at(self, places: Places) -> Float[Array, "m 6 6"]:
        """Momenta by velocities and length, in axes of the sections."""


def frames(slope: Float[Array, "m 3"], twist: Float[Array, " m"]) -> Float[Array, "m 3 3"]:
    """Axes of sections, as columns, of an axis that goes on in these ways: the tangent, and across
    it, where there is no twist, the one that is nearest to a2, and a third."""
    tangent = slope / jnp.sqrt(jnp.sum(slope**2, 1, keepdims=True))
    across = jnp.stack([-tangent[:, 2], 0 * tangent[:, 0], tangent[:, 0]], 1)
    across = across / jnp.sqrt(jnp.sum(across**2, 1, keepdims=True))
    own: Any = jnp.cross(across, tangent)
    cos, sin = jnp.cos(twist)[:, None], jnp.sin(twist)[:, None]
    return jnp.stack([tangent, cos * own + sin * across, cos * across - sin * own], 2)
