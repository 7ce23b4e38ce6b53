"""What is at the ends of a beam in space: springs of the root, a body and a load at the tip."""

from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.contract.strained import EndSprings, holding
from jaxbeam._models.space.energies import elongation
from jaxbeam._models.space.frames import A1, carried
from jaxbeam._programs.lanes import append_axes, pairwise_sum, sum_of_products, transposed
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.loads import TipLoad
from jaxbeam._rotor.motion import axes, cross
from jaxbeam._types import Number, Triple


class SpatialEnds(EndSprings):
    """Elastic energy of what is at the ends, by the displacement gradients d = r' - a1 there, as
    `PlanarEnds`. A spring at the root has k phi^2 / 2, phi the component about its axis of the
    least rotation from a1 to the tangent."""

    springs: tuple[Number | None, Number | None]  # in plane and in flap, N m / rad
    hold: Number | None  # J

    def __init__(self, rotor: Rotor, axial_stiffness: Number, n_elements: int) -> None:
        self.springs = rotor.springs
        self.hold = holding(rotor, axial_stiffness, n_elements)

    def damped_by(self, dampers: tuple[Number | None, Number | None]) -> Self:
        ends: Self = eqx.tree_at(
            lambda s: (*s.springs, s.hold), self, (*dampers, None), is_leaf=lambda s: s is None
        )
        return ends

    @property
    def stiffness(self) -> list[Number]:
        return [k for k in (*self.springs, self.hold) if k is not None]

    def strains(self, e: Float[Array, "2 3 *lanes"]) -> list[Number]:
        """Angles at the root and the elongation at the tip."""
        root, tip = e
        angles = zip(self.springs, _angles(root), strict=True)
        strains = [angle for spring, angle in angles if spring is not None]
        return strains if self.hold is None else [*strains, elongation(tip)]


def _angles(d: Triple) -> tuple[Number, Number]:
    """Components of the least rotation from a1 to the tangent, in plane and in flap, in rad."""
    size = 1 + elongation(d)
    # The rotation is 2 arctan(u^(1/2)), its sine the share of what is across.
    square = (d[1] ** 2 + d[2] ** 2) / (size + 1 + d[0]) ** 2
    small = square < 1e-2
    large = jnp.sqrt(jnp.where(small, 1.0, square))
    series = sum((-square) ** k / (2 * k + 1) for k in range(8))
    share = (1 + square) * jnp.where(small, series, jnp.arctan2(large, 1.0 + 0 * large) / large)
    return share * d[1] / size, share * d[2] / size


def in_beam_axes(load: TipLoad, d: Triple, angle: Number) -> tuple[Triple, Triple]:
    """Force and moment at the tip in axes of the beam, by the displacement gradient and the angle
    of twist there."""
    if not load.follows:
        return load.force, load.moment
    back = axes((d + append_axes(A1, d.ndim - 1)) / (1 + elongation(d))[None], angle).swapaxes(0, 1)
    force, moment = (
        sum_of_products(back, part[None], 1, d.ndim - 1) for part in (load.force, load.moment)
    )
    return force, moment


def push(load: TipLoad, d: Triple, angle: Number) -> Float[Array, "7 *#lanes"]:
    """The forces of a load at the tip on the displacement, on its gradient and on the angle of
    twist there, by their work. The section turns by t x dt, and about t by the change of the angle
    and by what the least rotation turns there: see `space.carried`."""
    force, moment = in_beam_axes(load, d, angle)
    size = 1 + elongation(d)
    t = (d + append_axes(A1, d.ndim - 1)) / size[None]
    about = pairwise_sum(moment * t)
    slope = (cross(moment, t) + about[None] * carried(t)) / size[None]
    return jnp.concatenate([force, slope, about[None]])


@transposed(on=False)
def push_tangent(load: TipLoad, d: Triple, angle: Number) -> Float[Array, "7 4 *#lanes"]:
    """Derivatives of `push` by the gradient and the angle."""
    at: Any = jnp.concatenate([d, angle[None]])
    steps = [jnp.broadcast_to(append_axes(unit, d.ndim - 1), at.shape) for unit in np.eye(4)]
    each = [jax.jvp(lambda e: push(load, e[:3], e[3]), (at,), (step,))[1] for step in steps]
    return jnp.stack(each, 1)
