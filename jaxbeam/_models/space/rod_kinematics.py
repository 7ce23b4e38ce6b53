"""How coordinates of a rod go with velocities of its nodes within a stage of a step.

Velocities are (V, W) of nodes, in axes that turn with them. Quaternions change by P' =
P (0, W) / 2, the root by u' = R V, and strains eps of Gauss points (`rod_places.py`) by

    eps' = d + s x w,   d = R^T sum N_i' R_i V_i,   w / 2 = vec(a),   a = Q^-1 sum N_i L_i W_i,

with s = x' + eps and L_i as in `rod_elements.py`. Where nodes turn by t_i the section turns by
h = 2 vec(b), b = Q^-1 sum N_i L_i t_i, and

    d eps' = d x h + R^T sum N_i' R_i (t_i x V_i)
             + 2 s x vec(Q^-1 sum N_i L_i t_i (0, W_i) / 2 - b a) + d eps x w = A t + d eps x w,

all at fixed V and W. The slope r' of the place changes by R (d eps + h x s).
"""

from typing import Self

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._models.space.rod_elements import Bent, bent, on_diagonal
from jaxbeam._models.space.rod_nodes import Rod, small_turns
from jaxbeam._models.space.rod_places import rises, without_drift
from jaxbeam._numerics.kinematics import Kinematics
from jaxbeam._numerics.linalg import Factors
from jaxbeam._numerics.quaternions import cross, crossing, quaternion_product, rotation
from jaxbeam._types import Coordinates, Matrix, Number, Vector

_Sixes = Float[Array, "nodes 6"]
_ByTurns = Float[Array, "E p 3 k 3"]  # vectors at Gauss points, by turns of nodes


class Moving(Kinematics):
    """Kinematics of a rod whose nodes have velocities w where a step begins."""

    rod: Rod
    p: Float[Array, "nodes 4"]  # of whatever length
    w: _Sixes
    g: Number
    state: Bent
    turned: _ByTurns  # h
    strained: _ByTurns  # A
    lasting: Float[Array, "E p 3 3"]  # (1 / g + w~)^-1, of changes of strains

    @classmethod
    def of(cls, rod: Rod, q: Coordinates, w: _Sixes, g: Number) -> Self:
        """Kinematics about the state q."""
        tables = rod.tables
        state = bent(tables, *rod.loose_nodes(q))
        moving, spun = tables.of_elements(w[:, :3]), tables.of_elements(w[:, 3:])
        shapes, eye = jnp.asarray(tables.shapes), jnp.eye(3)[None, None]
        share = shapes[None, :, None, :, None]
        by = share * jnp.einsum("egqa,ekat->egqkt", state.seen, state.leads)
        turned = 2 * by[:, :, 1:]
        rise = jnp.einsum("ekab,ekb->eka", state.turns, moving)
        rise = jnp.einsum("egab,egb->ega", state.inward, tables.rate @ rise)
        turning = shapes @ jnp.einsum("ekqt,ekt->ekq", state.leads, spun)
        turning = jnp.einsum("egqa,ega->egq", state.seen, turning)
        omega, across = 2 * turning[..., 1:], crossing(state.stretch)
        # A small turn t of a node changes its quaternion by L t, and so the rate L W = p (0, W) / 2
        # of that by L t (0, W) / 2.
        half = jnp.concatenate([jnp.zeros_like(spun[..., :1]), spun / 2], -1)
        later = quaternion_product(state.leads.swapaxes(-1, -2), half[:, :, None]).swapaxes(-1, -2)
        later = jnp.einsum("egqa,ekat->egqkt", state.seen[:, :, 1:], later)
        own = crossing(omega) / 2 - turning[..., :1, None] * eye
        about = jnp.einsum("egab,egbkt->egakt", own, turned) + 2 * share * later
        about = about - omega[..., None, None] * by[:, :, :1]
        carried = jnp.einsum("ekab,ekbt->ekat", state.turns, crossing(moving))
        carried = jnp.einsum("egk,egab,ekbt->egakt", tables.rate, state.inward, carried)
        strained = jnp.einsum("egab,egbkt->egakt", crossing(rise), turned) - carried
        strained = strained + jnp.einsum("egab,egbkt->egakt", across, about)
        a = g * omega
        lasting = eye + a[..., :, None] * a[..., None, :] - crossing(a)
        lasting = g * lasting / (1 + jnp.sum(a * a, -1))[..., None, None]
        return cls(rod, rod.quaternions(q), w, g, state, turned, strained, lasting)

    def before(self, first: Coordinates) -> Coordinates:
        root, turns, strain = self.rod.parts(first)
        half = jnp.concatenate([jnp.zeros_like(self.w[:, :1]), self.w[:, 3:] / 2], 1)
        spun = self._own[:, None] * (turns / self.g + quaternion_product(turns, half))
        about = small_turns(self.p, spun)
        root = root + self.state.turns[0, 0] @ cross(about[0], self.w[0, :3])
        by_turns = jnp.einsum("egakt,ekt->ega", self.strained, self.rod.tables.of_elements(about))
        strain = jnp.einsum("egab,egb->ega", self.lasting, strain + by_turns)
        return self.rod.joined(self.g * root, spun, strain)

    def rates(self, z: Vector) -> Coordinates:
        return self.rod.rates_in(self.state, self.p, self.rod.of_velocities(z))

    def seen(self, change: Coordinates) -> Vector:
        return self.rod.velocities_in(self.state, self.p, change)

    def eliminated(self, stiffness: Matrix) -> Matrix:
        tables, state, (g, w) = self.rod.tables, self.state, (self.g, self.w)
        eye, across = jnp.broadcast_to(jnp.eye(3), (len(w), 3, 3)), crossing(state.stretch)
        turns = self._own[:, None, None] * (eye / g - crossing(w[:, 3:]) / 2)
        by_node = tables.of_elements(turns)
        about = jnp.einsum("egakb,ekbt->egakt", self.turned, by_node)
        # Strains and slopes at Gauss points, by rates of nodes.
        moving = jnp.einsum("egk,egab,ekbt->egakt", tables.rate, state.inward, state.turns)
        turning = jnp.einsum("egab,egbkt->egakt", across, self.turned)
        turning = turning + jnp.einsum("egakb,ekbt->egakt", self.strained, by_node)
        moving, turning = (
            jnp.einsum("egab,egbkt->egakt", self.lasting, part) for part in (moving, turning)
        )
        turning = turning - jnp.einsum("egab,egbkt->egakt", across, about)
        slopes = jnp.concatenate([moving, turning], -1)
        slopes = jnp.einsum("egba,egbkt->egakt", state.inward, slopes)
        first = jnp.concatenate([eye[0], -crossing(w[0, :3]) @ turns[0]], 1)
        moved = self._along(g * state.turns[0, 0] @ first, rises(tables, slopes))
        moved = jnp.einsum("nba,nbm->nam", rotation(self.p), moved)
        turned = on_diagonal(jnp.pad(turns, ((0, 0), (3, 0), (3, 0)))).reshape(len(w), 6, -1)
        both = jnp.concatenate([moved, turned[:, 3:]], 1).reshape(6 * len(w), -1)
        return self.rod.after_changes(stiffness, both)

    def _along(
        self, root: Float[Array, "3 6"], each: Float[Array, "E p 3 k 6"]
    ) -> Float[Array, "nodes 3 N"]:
        """Displacements of all nodes by rates of nodes, of which those of the root are given, and
        those in elements by the first node of these."""
        tables, width = self.rod.tables, 6 * each.shape[3]
        step = width - 6
        row = jnp.zeros((1, 3, 6 * len(tables.place)), root.dtype).at[0, :, :6].set(root)
        rows = [row]
        for e, part in enumerate(each):
            columns = slice(step * e, step * e + width)
            more = jnp.broadcast_to(row, (len(part), *row.shape[1:]))
            rows.append(more.at[:, :, columns].add(part.reshape(len(part), 3, width)))
            row = rows[-1][-1:]
        return without_drift(tables, jnp.concatenate(rows), self.rod.held_tip)

    def inverse(self, matrix: Matrix) -> Factors:
        return Factors.of_matrix(matrix)

    @property
    def _own(self) -> Float[Array, " nodes"]:
        return self.g**2 / (1 + self.g**2 * jnp.sum(self.w[:, 3:] ** 2, 1) / 4)
