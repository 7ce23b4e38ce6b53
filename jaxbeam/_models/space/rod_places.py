"""Displacements of the nodes of a rod from strains and rotations, and back.

With eps = R^T r' - x' at Gauss points the derivative of displacements there is

    u' = R (x' + eps) - x',

and as many points as an element has nodes but the first give displacements of these from that of
the first, exactly. So a rotation and a strain that no force opposes to speak of, those of torsion,
never meet the stiffness of stretch and shear, whatever the shape of the rod is.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.space.rod_elements import Bent
from jaxbeam._models.space.rod_tables import RodTables, gauss, lagrange, lobatto
from jaxbeam._numerics.quaternions import conjugate, cross, rotation, turned_by
from jaxbeam._types import Triple

_Nodes = Float[Array, "nodes 3"]
_Points = Float[Array, "E p 3"]


@functools.lru_cache(maxsize=64)
def _integrals(degree: int) -> np.ndarray:
    """Values at nodes but the first, of polynomials that are zero there, by slopes at Gauss points,
    by the coordinate from -1 to 1."""
    return np.linalg.inv(lagrange(lobatto(degree), gauss(degree)[0])[1][:, 1:])


def rises(tables: RodTables, slopes: Float[Array, "E p *k"]) -> Float[Array, "E p *k"]:
    """Rise of a function with these slopes by arc length at Gauss points, from the first node of
    each element to its others."""
    return jnp.einsum("ng,eg,eg...->en...", _integrals(tables.degree), tables.pace, slopes)


def integrals(tables: RodTables, first: Triple, slopes: _Points) -> _Nodes:
    """Values at nodes of a function that begins so and has these slopes at Gauss points."""
    each = rises(tables, slopes)
    begin = jnp.concatenate([jnp.zeros_like(each[:1, -1]), jnp.cumsum(each[:-1, -1], 0)])
    inner = (begin[:, None] + each).reshape(-1, 3)
    return first[None] + jnp.concatenate([jnp.zeros_like(inner[:1]), inner])


def displacements(
    tables: RodTables, root: Triple, p: Float[Array, "nodes 4"], strain: _Points
) -> _Nodes:
    """Displacements of nodes, by that of the root, unit quaternions and strains."""
    q = jnp.asarray(tables.shapes) @ tables.of_elements(p)
    slopes = jnp.einsum("egij,egj->egi", turned_by(q), tables.tangent)
    slopes = slopes + jnp.einsum("egij,egj->egi", rotation(q), strain)
    return integrals(tables, root, slopes)


def without_drift(
    tables: RodTables, u: Float[Array, "nodes 3 *k"], held: Float[Array, "3 3"] | None
) -> Float[Array, "nodes 3 *k"]:
    """Displacements, or changes of them, less what grows evenly along the rod to that of the tip in
    ways in which it is held: this is rounding, and what steps leave."""
    if held is None:
        return u
    return u - jnp.einsum("n,ab,b...->na...", tables.node_places, held, u[-1])


def strains(tables: RodTables, u: _Nodes, p: Float[Array, "nodes 4"]) -> _Points:
    """Strains at Gauss points, by displacements and unit quaternions of nodes."""
    q = jnp.asarray(tables.shapes) @ tables.of_elements(p)
    back = conjugate(q)
    rise = jnp.einsum("egij,egj->egi", rotation(back), tables.rate @ tables.of_elements(u))
    return rise + jnp.einsum("egij,egj->egi", turned_by(back), tables.tangent)


def turning(tables: RodTables, state: Bent, turns: Float[Array, "nodes 3"]) -> _Points:
    """The turns 2 vec(Q^-1 Q') of sections at Gauss points, in their axes, by those of nodes."""
    leading = jnp.einsum("ekab,ekb->eka", state.leads, tables.of_elements(turns))
    whole = jnp.asarray(tables.shapes) @ leading
    return 2 * jnp.einsum("egab,egb->ega", state.seen[:, :, 1:], whole)


def strain_rates(tables: RodTables, state: Bent, rates: Float[Array, "nodes 6"]) -> _Points:
    """Rates of strains at Gauss points where nodes move so, in axes that turn with them:

    eps' = R^T r' + 2 (x' + eps) x vec(Q^-1 Q'), the rates of r' and Q by those of nodes.
    """
    moving = jnp.einsum("ekab,ekb->eka", state.turns, tables.of_elements(rates[:, :3]))
    rise = jnp.einsum("egab,egb->ega", state.inward, tables.rate @ moving)
    return rise + cross(state.stretch, turning(tables, state, rates[:, 3:]))
