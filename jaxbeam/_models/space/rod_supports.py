"""How the ends of a rod are held: springs, dampers, and what is held rigidly, in six ways.

A support has axes a_k, which stay as they are in the hub. With u the displacement of the end and
phi its rotation vector the ways are a_k . u and a_k . phi, and springs have half their squares for
energy; see `Support`. What is held rigidly is zero, and is eliminated: changes (h, t) of the node,
in axes that turn with it, are led by those of the ways that are free,

    h = R^T a_k dy_k,   t = R^T a_k dy_k (all three free),   t = a_k dy (one),
    t = a_i dy_i + a_j dy_j - a_k a_k.(x x (a_i dy_i + a_j dy_j)) / w (two, a_k held),

(w, x) the quaternion, of which x stays in the plane of a_i and a_j. With B that matrix and r what
is out of balance at the node, B^T r is what is out of balance in the ways, and its derivative
B^T (dr) B + (dB)^T r. An end of which nothing is held needs none of that.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._numerics.quaternions import crossing, of_turn, rotation, turn_of
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.support import WAYS, Support
from jaxbeam._types import Number, Scalar

_Six = Float[Array, "6"]
_Block = Float[Array, "6 6"]
_SMALL = 0.1  # square of an angle below which a series is exact to rounding
# Of (1 - a cot(a)) / (4 a^2) by a^2.
_SERIES = 1 / 12, 1 / 180, 1 / 1890, 1 / 18900, 1 / 187110, 691 / 1277025750, 1 / 18243225


class Held(eqx.Module):
    """A support, in axes of the beam."""

    springs: tuple[Number | None, ...]  # six, None where it holds rigidly
    attitude: Float[Array, "3 3"] | None  # its axes as columns; None: those of the beam

    @classmethod
    def of(cls, support: Support | None) -> "Held | None":
        """The support of an end, if there is one."""
        if support is None:
            return None
        vector = support.attitude
        return cls(support.springs, None if vector is None else rotation(of_turn(vector)))

    @property
    def ways(self) -> tuple[int, ...]:
        """The ways, of six, that are free or have springs."""
        return tuple(k for k, spring in enumerate(self.springs) if spring is not None)

    @property
    def leads(self) -> bool:
        """Whether changes of the node are not simply those of the free ways."""
        about = sum(way > 2 for way in self.ways)
        plain = about != 2 and len(self.ways) == about and self.attitude is None
        return len(self.ways) < 6 and not plain

    @property
    def axes(self) -> Float[Array, "3 3"]:
        """Axes of the support as columns."""
        return jnp.eye(3) if self.attitude is None else self.attitude

    @property
    def stiffness(self) -> Float[Array, "6"]:
        """Stiffness of the springs, zero where it holds rigidly."""
        return jnp.stack([jnp.asarray(0.0 if k is None else k) for k in self.springs])

    def free(self, part: int) -> Float[np.ndarray, "1 3"]:
        """One where a shift (part 0) or a rotation (part 1) is free or has a spring, else zero."""
        return np.array([[float(3 * part + k in self.ways) for k in range(3)]])

    def outward(
        self, u: Float[Array, "3"], p: Float[Array, "4"]
    ) -> tuple[Float[Array, "3"], Float[Array, "4"]]:
        """Displacement and quaternion in axes of the beam, from those in its own."""
        if self.attitude is None:
            return u, p
        return self.attitude @ u, jnp.concatenate([p[:1], self.attitude @ p[1:]])

    def own(
        self, u: Float[Array, "3"], p: Float[Array, "4"]
    ) -> tuple[Float[Array, "3"], Float[Array, "4"]]:
        """Displacement and quaternion in its own axes, zero what is held rigidly."""
        if self.attitude is not None:
            u, p = self.attitude.T @ u, jnp.concatenate([p[:1], self.attitude.T @ p[1:]])
        along, about = self.free(0)[0], self.free(1)[0]
        return along * u, jnp.concatenate([p[:1], about * p[1:]])

    def basis(self, p: Float[Array, "4"]) -> _Block:
        """The matrix B that makes changes of the node of those of the ways, zero for those that are
        held rigidly."""
        along, about = self.axes * self.free(0), self.axes * self.free(1)
        inward, held = rotation(p).T, np.flatnonzero(self.free(1) == 0)
        if held.size == 0:
            about = inward @ about
        elif held.size == 1:
            axis = self.axes[:, held[0]]
            led = (axis @ crossing(p[1:] / p[0])) @ about
            about = about - axis[:, None] * led[None]
        return _diagonal(inward @ along, about)

    def by_reaction(self, p: Float[Array, "4"], force: _Six) -> _Block:
        """The matrix (dB)^T r: the change of B^T r with the ways where r, at the node, stays."""
        basis, held = self.basis(p)[3:, 3:], np.flatnonzero(self.free(1) == 0)
        none = jnp.zeros((3, 3), p.dtype)
        outward = -(self.axes.T @ rotation(p)) @ crossing(force.reshape(2, 3))
        shifts, about = jnp.asarray(self.free(0).T) * (outward[0] @ basis), outward[1] @ basis
        if held.size == 1:  # x / w changes by (1 + |x / w|^2) / 2 times what leads
            axis, free, y = self.axes[:, held[0]], self.axes * self.free(1), p[1:] / p[0]
            about = -(axis @ force[3:]) * (1 + y @ y) / 2 * (free.T @ crossing(axis) @ free)
        elif held.size:
            about = none
        return jnp.block([[none, shifts], [none, about]])

    def rates(self, p: Float[Array, "4"]) -> _Block:
        """The matrix of the six ways by changes of the node."""
        return _diagonal(self.axes.T @ rotation(p), self.axes.T @ _by_turn(turn_of(p)))

    def energy(self, u: Float[Array, "3"], p: Float[Array, "4"]) -> Scalar:
        """Energy of the springs, in J."""
        ways = jnp.concatenate([self.axes.T @ u, self.axes.T @ turn_of(p)])
        return self.stiffness @ ways**2 / 2

    def acting(self, u: Float[Array, "3"], p: Float[Array, "4"]) -> tuple[_Six, _Block, _Block]:
        """Forces of springs on the node, in its own axes, their symmetric tangent, and of that the
        part of the springs alone: rates^T k rates."""
        axes, vector = self.axes, turn_of(p)
        about = axes @ (self.stiffness[3:, None] * axes.T)

        def moment(vector: Float[Array, "3"]) -> Float[Array, "3"]:
            return _by_turn(vector).T @ (about @ vector)

        rates = self.rates(p)
        alone = rates.T @ (self.stiffness[:, None] * rates)
        # Along a turn t that goes on the vector changes by J t: so this is the second derivative.
        second = symmetric_part(jax.jacfwd(moment)(vector) @ _by_turn(vector))
        if not any(way < 3 for way in self.ways):
            none = jnp.zeros((3, 3), p.dtype)
            return jnp.pad(moment(vector), (3, 0)), _diagonal(none, second), alone
        push = rates[:3, :3].T @ (self.stiffness[:3] * (axes.T @ u))
        # To second order the node goes by R (h + t x h / 2).
        across = crossing(push) / 2
        both = jnp.block([[alone[:3, :3], across], [across.T, second]])
        return jnp.concatenate([push, moment(vector)]), both, alone


def _by_turn(vector: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """The matrix J = 1 + phi~ / 2 + c phi~ phi~ of the rotation vector phi by small turns in axes
    of the node, c = (1 - phi / 2 cot(phi / 2)) / phi^2."""
    square = vector @ vector
    small = square < _SMALL
    half = jnp.sqrt(jnp.where(small, 1.0, square)) / 2
    large = (1 - half / jnp.tan(half)) / (4 * half**2)
    series = sum(factor * (square / 4) ** k for k, factor in enumerate(_SERIES))
    across = crossing(vector)
    return jnp.eye(3) + across / 2 + jnp.where(small, series, large) * across @ across


def _diagonal(first: Float[Array, "3 3"], second: Float[Array, "3 3"]) -> _Block:
    none = jnp.zeros((3, 3), first.dtype)
    return jnp.block([[first, none], [none, second]])


def ends_of(rotor: Rotor) -> tuple[Held | None, Held | None]:
    """How root and tip are held; None: clamped at the root, free at the tip."""
    in_plane, flap = rotor.springs
    root = Held.of(rotor.root_support)
    if rotor.root_springs is not None:
        root = Held((None, None, None, None, flap, in_plane), None)
    return root, Held.of(rotor.tip_support)


def moving_end(name: str, end: Held | None, attitude: Any, stiff: Number) -> Support | None:
    """The support, of this attitude, of an end that moves in time: its ways stay as they are in
    axes of its node.

    Raises `ValueError` where there is none such.
    """
    if end is None:
        return None
    shifts = {way for way in end.ways if way < 3}
    turns = [way - 3 for way in end.ways if way > 2]
    # Rotations about one axis leave that axis, and the plane across it, where they are.
    lasting: list[set[int]] = [set(), {0, 1, 2}]
    if len(turns) == 1:
        lasting += [set(turns), {0, 1, 2} - set(turns)]
    if turns and shifts not in lasting:
        raise ValueError(
            f"{name}: in motion in time an end that turns is free to shift in all ways or in none, "
            "or, where it turns about one axis, along that or in all ways across: give a spring "
            "instead of None to the ways in which it is held"
        )
    springs = end.springs
    if len(turns) == 2:
        springs = (*springs[:3], *(stiff if spring is None else spring for spring in springs[3:]))
    return Support(**dict(zip(WAYS, springs, strict=True)), attitude=attitude)


def free_changes(nodes: int, root: Sequence[int] | None, tip: Sequence[int] | None) -> np.ndarray:
    """Places of the changes that are free among the six of each node, by ways of the ends that are
    free; None: as they are without a support."""
    last = 6 * (nodes - 1)
    first, end = () if root is None else root, range(6) if tip is None else tip
    return np.array([*first, *range(6, last), *(last + way for way in end)])


def dampers_of(drag: Drag) -> tuple[Float[Array, "6"] | None, Float[Array, "6"] | None]:
    """Dampers of root and tip, six each."""
    if drag.dampers is None:
        return drag.root, drag.tip
    in_plane, flap = (0.0 if damper is None else damper for damper in drag.dampers)
    return jnp.stack([*map(jnp.asarray, (0.0, 0.0, 0.0, 0.0, flap, in_plane))]), drag.tip
