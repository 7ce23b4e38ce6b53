"""Forces in sections of a rod by loads along the span, which may be anywhere, as forces at points.

Forces in sections are polynomials through Gauss points of elements. What is smooth along the span
they follow; of a force at a point they are what is nearest by the equations of nodes. With shapes
N_i of nodes but the first, values at Gauss points g with weights w and derivatives by the place in
the element, a load along an element does there

    sum_g w N_i' F_g = int N_i f,   sum_g w N_i' M_g = sum_g w N_i (r' x F)_g,

which gives way to what it does in truth: all of it beyond the section, to the end of the element.
The second is that of small turns within an element.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.space.rod_tables import RodTables, gauss, lagrange, lobatto, located
from jaxbeam._rotor.span import Span

_Rows = Float[Array, "p 3"]
_OfGauss = Float[Array, "E g 3"]


def tails(
    tables: RodTables, u: Float[Array, "nodes 3"], span: Span, force: _Rows, placed: _Rows,
    here: Float[Array, "m 3"], xi: Float[np.ndarray, " m"],
) -> tuple[tuple[_OfGauss, _OfGauss], Float[Array, "m 6"]]:  # fmt: skip
    """Force and moment at Gauss points that a force by x / L at the points of a span, which are
    `placed`, makes there, and what it does in sections at x / L = `xi`, which are `here`, by what
    is beyond these in their elements; all in axes of the beam."""
    knots, (at, weight) = lobatto(tables.degree), gauss(tables.degree)
    values, slopes = lagrange(knots, at)
    back = np.linalg.inv((weight[:, None] * slopes[:, 1:]).T)  # to Gauss points from nodes
    places = np.asarray(span.xi)
    where, within = located(tables.ends, places)
    own = (where[None] == np.arange(tables.elements)[:, None]) * np.asarray(span.weight)[None]
    on_nodes = jnp.einsum("ep,pi,pc->eic", own, lagrange(knots, within)[0][:, 1:], force)
    nearest = jnp.einsum("gi,eic->egc", back, on_nodes)
    rise = tables.pace[:, :, None] * (tables.tangent + tables.rate @ tables.of_elements(u))
    couple = weight[None, :, None] * jnp.cross(rise, nearest)
    moment = jnp.einsum("gi,hi,ehc->egc", back, values[:, 1:], couple)
    beyond = span.beyond(jnp.concatenate([force, jnp.cross(placed, force)], 1))
    ends = np.asarray(tables.ends)[located(tables.ends, xi)[0] + 1]
    tail: Any = span.interpolated(beyond, xi) - span.interpolated(beyond, ends)
    about = tail[:, 3:] - jnp.cross(here, tail[:, :3])
    return (nearest, moment), jnp.concatenate([tail[:, :3], about], 1)
