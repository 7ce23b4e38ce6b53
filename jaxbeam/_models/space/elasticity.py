"""Elastic and viscous forces of elements in space, in the words of `_models/space/elements.py`."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.contract.damping_data import Dampers
from jaxbeam._models.contract.equations import Equations
from jaxbeam._models.contract.strained import force_of
from jaxbeam._models.space.ends import SpatialEnds
from jaxbeam._models.space.frames import deformation
from jaxbeam._models.space.nodes import SpatialNodes, Ways, assembled, of_elements
from jaxbeam._models.space.sections import SpatialSections
from jaxbeam._numerics.blocks import BlockTridiagonal, padded
from jaxbeam._programs.lanes import compute_once, pairwise_sum
from jaxbeam._types import Number, Triple, Vector


class SpatialElasticity(Equations):
    """The elasticity of elements, of springs of the root and of what holds a body at the tip.

    Components of a node are in the order `ways`, and the first `absent` numbers of the first node
    are not coordinates: its values, and the slopes that the root does not let be.
    """

    sections: SpatialSections
    ends: SpatialEnds
    ways: Ways = eqx.field(static=True)
    absent: int = eqx.field(static=True)

    def elastic_tangent(self, q: Vector) -> BlockTridiagonal:
        def one(part: Any, local: Array) -> Array:
            return self._by_local(part.law.tangent(self._strains(local)))

        own = self.sections.by_element(one, of_elements(self._nodes(q)))
        return self._gathered_tangent(own, self._at_ends(self.ends.tangent, q))

    def elastic_force(self, q: Vector) -> Vector:
        own = self.sections.by_element(self._elastic, of_elements(self._nodes(q)))
        return self._gathered(own, None, self._at_ends(self.ends.force, q))

    def viscous_force(self, q: Vector, v: Vector) -> Vector:
        def one(part: Any, local: Array, rate: Array) -> Array:
            force = part.law.viscous(self._strains(local), self._strains(rate))
            return self.sections.axial_stiffness * self._on_nodes(force)

        both = of_elements(self._nodes(q)), of_elements(self._nodes(v))
        own = self.sections.by_element(one, *both)
        return self._gathered(own, None, self._at_ends(self.ends.viscous, q, v))

    def viscous_tangents(self, q: Vector, v: Vector) -> tuple[BlockTridiagonal, BlockTridiagonal]:
        def one(part: Any, local: Array, rate: Array) -> Array:
            both = part.law.viscous_tangents(self._strains(local), self._strains(rate))
            return jnp.stack([self._by_local(tangent) for tangent in both])

        both = of_elements(self._nodes(q)), of_elements(self._nodes(v))
        own = self.sections.by_element(one, *both)
        ends = self._at_ends(self.ends.viscous_tangents, q, v) or (None, None)
        by_q, by_v = (self._gathered_tangent(own[:, i], ends[i]) for i in (0, 1))
        return by_q, by_v

    def strain_energy(self, q: Vector) -> Number:
        each = self.sections.by_element(
            lambda part, local: part.law.energy(self._strains(local)), of_elements(self._nodes(q))
        )
        energy = self.sections.axial_stiffness * self.length * pairwise_sum(each)
        return energy if self.ends.are_plain else energy + self._at_ends(self.ends.energy, q)

    def is_in_range(self, q: Vector) -> Array:
        """Whether no element turns or twists by a right angle, or is stretched by a half, seen at
        its nodes and at its middle."""

        def one(part: Any, local: Array) -> Array:
            natural = deformation(self._strains(local), self.sections.n_elements)
            chord, last = natural[1:4], natural[4:7]
            first = jnp.concatenate([natural[:1], jnp.zeros_like(natural[:2])])
            # Between nodes that point the same way a loop may be folded.
            gradient = jnp.stack([first, (6 * chord - first - last) / 4, last], 1)
            stretch = jnp.abs(jnp.sqrt(pairwise_sum(gradient**2)) - 1)
            fits = jnp.all((gradient[0] > 0) & (stretch < 0.5), 0)
            return fits & (jnp.abs(natural[8]) < np.pi / 2)

        return jnp.all(self.sections.by_element(one, of_elements(self._nodes(q))))

    def _elastic(self, part: Any, local: Float[Array, "2 2 4 *#lanes"]) -> Array:
        """Elastic force of an element, (2, 2, 4, *lanes)."""
        force = force_of(part.law, self._strains(local), symmetric=True)
        return self.sections.axial_stiffness * self._on_nodes(force)

    def _strains(self, local: Float[Array, "2 2 4 *#lanes"]) -> Float[Array, "13 *#lanes"]:
        """The local coordinates of `_models/space/energies.py`."""
        first, last = local
        chord = self.sections.n_elements * (last[0] - first[0])
        gradient = jnp.stack([self._seen(d) for d in (first[1], chord, last[1])], 1)
        twist = jnp.stack([first[0, 3], first[1, 3], last[0, 3], last[1, 3]])
        return jnp.concatenate([gradient.reshape(9, *twist.shape[1:]), twist]) / self.length

    def _on_nodes(self, e: Float[Array, "13 *#lanes"]) -> Float[Array, "2 2 4 *#lanes"]:
        """Forces on nodes from those on local coordinates: the transpose of `_strains`, but for the
        length."""
        by = e[:9].reshape(3, 3, *e.shape[1:])
        first, chord, last = (self._ordered(by[:, j], 0 * e[9]) for j in range(3))
        chord = self.sections.n_elements * chord
        parts = [
            jnp.concatenate([force[:3], twist[None]])
            for force, twist in zip((-chord, first, chord, last), e[9:], strict=True)
        ]
        return jnp.stack(parts).reshape(2, 2, 4, *e.shape[1:])

    def _seen(self, node: Float[Array, "4 *#lanes"]) -> Triple:
        """The components of a displacement in the order a1, a2, a3."""
        return jnp.stack([node[self.ways.index(c)] for c in range(3)])

    def _ordered(self, vector: Triple, twist: Number) -> Float[Array, "4 *#lanes"]:
        """A vector and a twist in the order of a node."""
        return jnp.stack([*(vector[c] for c in self.ways[:3]), twist])

    def _four(self, matrix: Float[Array, "3 3 *#lanes"]) -> Float[Array, "4 4 *#lanes"]:
        """A matrix of displacements in the order of a node, zero for the twist."""
        none = jnp.zeros_like(matrix[0, 0])
        rows = [[matrix[c, d] for d in self.ways[:3]] + [none] for c in self.ways[:3]]
        return jnp.stack([jnp.stack(row) for row in [*rows, [none] * 4]])

    def _nodes(self, q: Vector) -> SpatialNodes:
        """Coordinates node by node, those of the clamped node included."""
        return padded(q, self.absent, 0).reshape(-1, 2, 4, *q.shape[1:])

    def _at_ends(self, function: Callable[..., Any], *q: Vector) -> Any:
        """The result of a function of the displacement gradients at root and tip; None where
        nothing is there."""
        if self.ends.are_plain:
            return None
        slopes = [(nodes[0, 1], nodes[-1, 1]) for nodes in map(self._nodes, q)]
        return function(*(jnp.stack([*map(self._seen, pair)]) / self.length for pair in slopes))

    def _matrix(self, rows: Float[Array, "k 8 24 *#lanes"]) -> BlockTridiagonal:
        return BlockTridiagonal(rows, absent=self.absent)

    def _at_node(self, i: int, block: Float[Array, "3 3 *#lanes"]) -> Array:
        """Rows that have a block on the slopes of the first (0) or the last (-1) node."""
        lanes, more = block.shape[2:], self.sections.n_elements
        row = jnp.pad(self._four(block), ((4, 0), (12, 8), *((0, 0),) * len(lanes)))[None]
        return padded(row, -i * more, (1 + i) * more)

    def damper_force(self, q: Vector, v: Vector, dampers: Dampers) -> Vector:
        none, ends = jnp.zeros_like(of_elements(self._nodes(q))), self.ends.damped_by(dampers)
        return self._gathered(none, None, self._at_ends(ends.viscous, q, v))

    def damper_tangents(
        self, q: Vector, v: Vector, dampers: Dampers
    ) -> tuple[BlockTridiagonal, BlockTridiagonal]:
        by = self._at_ends(self.ends.damped_by(dampers).viscous_tangents, q, v)
        by_q, by_v = (self._gathered_tangent(None, each) for each in by)
        return by_q, by_v

    def _by_local(self, tangent: Float[Array, "13 13 *#lanes"]) -> Array:
        """The tangent by an element's coordinates (16, 16) from that by its local ones."""
        return self._by_nodes(self.sections.axial_stiffness / self.length * tangent)

    def _by_nodes(self, matrix: Float[Array, "13 13 *#lanes"]) -> Array:
        """The matrix by an element's coordinates (16, 16) from that by local ones times the
        length."""
        for _ in range(2):
            rows = self._on_nodes(matrix)
            matrix = compute_once(rows.reshape(16, *rows.shape[3:])).swapaxes(0, 1)
        return matrix

    def _gathered_tangent(
        self, local: Float[Array, "E 16 16 *#lanes"] | None,
        ends: Float[Array, "2 3 3 *#lanes"] | None,
    ) -> BlockTridiagonal:  # fmt: skip
        """Sum of the tangents of elements and of what is at the ends."""
        rows: Any = 0.0 if local is None else assembled(local)
        if ends is not None:
            for i, tangent in zip((0, -1), ends, strict=True):
                rows = rows + self._at_node(i, tangent / self.length**2)
        return self._matrix(rows)

    def _gathered(
        self, local: Float[Array, "E 2 2 4 *#lanes"], at_tip: Array | None,
        ends: Float[Array, "2 3 *#lanes"] | None,
    ) -> Vector:  # fmt: skip
        """Sum of what elements do at nodes, of a force at the tip, and of what is at the ends."""
        own = padded(local[:, 0], 0, 1) + padded(local[:, 1], 1, 0)
        if at_tip is not None:
            own = own + padded(at_tip[None], len(local), 0)
        if ends is not None:
            for i, force in zip((0, -1), ends, strict=True):
                slope = self._ordered(force / self.length, jnp.zeros_like(force[0]))
                node = jnp.stack([jnp.zeros_like(slope), slope])[None]
                own = own + padded(node, -i * len(local), (1 + i) * len(local))
        return own.reshape(-1, *local.shape[4:])[self.absent :]
