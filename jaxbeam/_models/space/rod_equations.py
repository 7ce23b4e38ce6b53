"""What the rest of the package asks of a rod that rests in its hub."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._models.contract.equations import Equations
from jaxbeam._models.contract.equilibrium import Rest
from jaxbeam._models.contract.span_integrals import AbstractSpanIntegral
from jaxbeam._models.space.rod_elements import Bent, bent, by_changes, pulled
from jaxbeam._models.space.rod_loads import RodSpanIntegral
from jaxbeam._models.space.rod_nodes import Rod, slot
from jaxbeam._models.space.rod_state import (
    Around,
    balance,
    differentiable,
    matrices_with_derivatives,
    settled,
)
from jaxbeam._models.space.rod_supports import dampers_of, ends_of
from jaxbeam._models.space.rod_tables import beam_axes, gauss, rod_tables, turned_by_pitch
from jaxbeam._models.space.rod_tails import tails
from jaxbeam._numerics.linalg import solve
from jaxbeam._numerics.quaternions import rotation, turn_of
from jaxbeam._results import without_derivatives
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.beam_sections import sections_of
from jaxbeam._rotor.loads import Loads, TipLoad
from jaxbeam._rotor.motion import Hub, spinning
from jaxbeam._rotor.sections import AbstractSections, frames
from jaxbeam._rotor.span import Span
from jaxbeam._status import Status, first_broken
from jaxbeam._types import Coordinates, Matrix, Number, Triple, Vector

_POINTS = 12  # of each piece of the span, for what loads do in sections
_SIGNS = np.array([[1.0, 1.0, -1.0]])  # of turns about a1, a3 and -a2
_FEW = 4  # degrees below which forces have no polynomials to spare
_TURN_ERROR = 0.02  # rad, of sections between nodes
_HELD = 1e-13  # lowest eigenvalue of K, over its diagonal, of what is held at all


class RestingRod(Equations):
    """A rod at rest in a hub that turns steadily: equilibrium, and small motion about it. How it
    moves in time is in `RodEquations`.

    Matrices are by displacements of nodes, and by their turns times the length, in axes of the
    beam; those of ends on supports by the ways of these.
    """

    rod: Rod
    rotor: Rotor
    mass: Matrix
    rigid_moments: Triple
    length: Number
    tip_radius: Number
    energy_scale: Number
    axes: Float[Array, "3 3"]  # of the beam, as rows, in those of the hub

    def __init__(self, rotor: Rotor, degree: int, ends: tuple[float, ...]) -> None:
        tables = rod_tables(rotor, degree, ends)
        inertia = tables.assembled(tables.inertia).at[-6:, -6:].add(tables.tip)
        length, beam = rotor.beam.length, rotor.beam.mean
        self.rotor, self.length = rotor, length
        self.rod = Rod(tables, inertia, *ends_of(rotor), length)
        self.axes = beam_axes(rotor)
        self.mass = self.rod.by_velocities(inertia)
        self.tip_radius = rotor.hub_radius + length
        weight, far = tables.weight[:, 0], tables.place[:, 0]
        self.rigid_moments = jnp.stack([jnp.sum(weight * far**k) for k in range(3)])
        self.energy_scale = beam.in_plane_bending_stiffness / length

    @property
    def rest(self) -> Coordinates:
        return jnp.zeros(7 * len(self.rod.tables.place), self.length.dtype)

    def equilibrium(self, hub: Hub, tip_force: Any = None, span: Any = None) -> Rest:
        given = self.rod, self._around(hub, tip_force, span)
        q, share, *pair = settled(*without_derivatives(given))
        q = differentiable(q, (pair[0], pair[1]), given)
        matrices = self._small_motion(
            q, *matrices_with_derivatives((pair[0], pair[1]), (q, *given))
        )
        status = first_broken(
            (share >= 1, Status.NOT_CONVERGED), (self.is_in_range(q), Status.OUT_OF_RANGE),
            (self.is_unfolded(q), Status.NO_EQUILIBRIUM),
        )  # fmt: skip
        fixed, at = without_derivatives((self, q))
        return Rest(q, status, matrices, fixed.lacking_about(at), fixed.taken_along(at))

    def lacking_about(self, q: Coordinates) -> Matrix:
        """The most by which stiffness is too small where strains, not forces, are polynomials."""
        rod = self.rod
        by = by_changes(rod.tables, bent(rod.tables, *rod.nodes(q)))
        more = rod.tables.assembled(by.swapaxes(1, 2) @ rod.tables.lacking @ by)
        return self._by_places(q, rod.led(q, more))

    def taken_along(self, q: Coordinates) -> Matrix | None:
        """The motion of nodes as a rigid body with a root that yields."""
        return None if self.rod.root is None else self.rod.taken_along(q)

    def is_in_range(self, q: Coordinates) -> Array:
        return self.rod.turn_error(q) <= _TURN_ERROR

    def is_unfolded(self, q: Coordinates) -> Array:
        return self.rod.least_stretch(q) > 0

    def matrices_about(
        self, hub: Hub, q: Coordinates, tip_force: Any = None, span: Any = None
    ) -> tuple[Matrix, Matrix, Matrix]:
        here = balance(self.rod, q, self._around(hub, tip_force, span))
        return self._small_motion(q, here.gyroscopic, here.stiffness)

    def _small_motion(
        self, q: Coordinates, gyroscopic: Float[Array, "N N"], stiffness: Float[Array, "N N"]
    ) -> tuple[Matrix, Matrix, Matrix]:
        """Matrices of mass, rates and stiffness by places, from the latter two by nodes."""
        mass = self.rod.led(q, self.rod.mass)
        m, c, k = (self._by_places(q, a) for a in (mass, gyroscopic, stiffness))
        return m, c, k

    def high_share(self, q: Coordinates) -> tuple[Number, Number] | None:
        """Twice the energy of the third of the polynomials of forces that is of the highest
        degrees, and of all: what is beyond has less."""
        tables, (points, weight) = self.rod.tables, gauss(self.rod.tables.degree)
        if tables.degree < _FEW:
            return None
        strain = bent(tables, *self.rod.nodes(q)).strain.reshape(tables.elements, -1)
        force = jnp.einsum("eij,ej->ei", tables.stiffness, strain)
        through = legendre.legvander(points, tables.degree - 1)
        high = np.arange(tables.degree) >= tables.degree - (tables.degree + 1) // 3
        kept = (through * high) @ np.linalg.inv(through) * weight[:, None] / weight[None]
        # Forces at Gauss points are by arc length, as these are.
        by_length = force.reshape(tables.elements, -1, 6) / tables.pace[:, :, None]
        top = tables.pace[:, :, None] * jnp.einsum("ab,ebc->eac", kept, by_length)
        top = top.reshape(force.shape)
        own = jax.vmap(solve)(tables.stiffness, top)
        return jnp.sum(top * own), jnp.sum(force * strain)

    def is_held(self, state: Rest) -> Array | None:
        if self.rod.root is None or state.matrices is None:
            return None
        k = state.matrices[2]
        size = jnp.sqrt(jnp.abs(jnp.diagonal(k)))
        size = jnp.where(size > 0, size, 1.0)
        anyhow = jnp.asarray(np.cos(np.arange(len(k))))
        soft = solve(k / (size[None] * size[:, None]), anyhow)
        return jnp.max(jnp.abs(soft)) < 1 / _HELD

    def damping_matrix_about(self, q: Coordinates, drag: Drag) -> Matrix:
        out = jnp.zeros_like(self.mass) if drag.matrix is None else drag.matrix
        if drag.mass_coefficient is not None:
            out = out + drag.mass_coefficient * self._by_places(q, self.rod.led(q, self.rod.mass))
        if drag.stiffness_coefficient is not None:
            still = self._around(spinning(0 * self.length), None, None)
            elastic = balance(self.rod, q, still).elastic
            out = out + drag.stiffness_coefficient * self._by_places(q, elastic)
        if drag.section_coefficients is not None:
            out = out + self._by_places(q, self._damped(q, drag.section_coefficients))
        return out + self._damped_ends(q, drag)

    def _damped_ends(self, q: Coordinates, drag: Drag) -> Matrix | float:
        """The forces of dampers of supports."""
        p, every = self.rod.nodes(q)[1], jnp.zeros_like(self.rod.mass)
        dampers = dampers_of(drag)
        if dampers == (None, None):
            return 0.0
        for node, end in self.rod.ends:
            own = dampers[node]
            if own is not None:
                rates, at = end.rates(p[node]), slot(node)
                every = every.at[at, at].add(rates.T @ (own[:, None] * rates))
        return self._by_places(q, self.rod.led(q, every))

    def _damped(self, q: Coordinates, by_strains: Float[Array, "6"]) -> Float[Array, "N N"]:
        """B^T mu S B with mu in axes of sections at Gauss points, where S makes forces of rates."""
        tables = self.rod.tables
        by = by_changes(tables, bent(tables, *self.rod.nodes(q)))
        own = self._viscous_forces(tables.stiffness @ by, by_strains)
        matrix = tables.assembled(by.swapaxes(1, 2) @ own)
        return self.rod.led(q, matrix)

    def _viscous_forces(
        self, forces: Float[Array, "E m k"], by_strains: Float[Array, "6"]
    ) -> Float[Array, "E m k"]:
        """Forces at Gauss points, by columns, times mu in axes of sections there."""
        frame, _ = self._frames(self.rod.tables.gauss_places)
        parts = forces.reshape(len(frame), 2, 3, -1)
        own = jnp.einsum("gab,xb,gcb,gxcl->gxal", frame, by_strains.reshape(2, 3), frame, parts)
        return own.reshape(forces.shape)

    def _viscous_sections(
        self, state: Bent, w: Float[Array, "nodes 6"], drag: Drag | None
    ) -> Float[Array, "E p 6"]:
        """Forces at Gauss points by rates of strain where nodes have these rates: stiffness times
        rates, with a `drag` times its coefficients."""
        tables = self.rod.tables
        by_elements = tables.of_elements(w).reshape(tables.elements, -1)
        rate = jnp.einsum("eml,el->em", by_changes(tables, state), by_elements)
        force = jnp.einsum("eij,ej->ei", tables.stiffness, rate)[..., None]
        if drag is not None:
            whole, each, given = drag.stiffness_coefficient, drag.section_coefficients, force
            force = jnp.zeros_like(given) if whole is None else whole * given
            force = force if each is None else force + self._viscous_forces(given, each)
        return force.reshape(state.strain.shape)

    def rates(self, q: Coordinates, change: Vector) -> Coordinates:
        n, rod = len(self.rod.tables.place), self.rod
        every = jnp.zeros(6 * n, change.dtype).at[rod.free].set(change, unique_indices=True)
        every = every.reshape(n, 2, 3)
        every = every * jnp.stack([jnp.ones_like(self.length), 1 / self.length])[None, :, None]
        attitude = rod.between_ends(rotation(rod.nodes(q)[1]))
        own = jnp.einsum("nba,nxb->nxa", attitude, every).reshape(-1)
        return rod.rates(q, own[rod.free])

    def undeformed_at(self, xi: np.ndarray) -> Float[Array, "p 3"]:
        return self._undeformed_in_beam_axes(np.asarray(xi)) @ self.axes

    def _undeformed_in_beam_axes(self, xi: np.ndarray) -> Float[Array, "p 3"]:
        along = sections_of(self.rotor.beam).axis_at(xi)[0] @ turned_by_pitch(self.rotor).T
        return along + self.rod.tables.place[:1]

    def displacement(self, q: Coordinates, xi: np.ndarray) -> Float[Array, "p 3"]:
        rows, _ = self.rod.tables.interpolating(xi)
        return jnp.asarray(rows) @ self.rod.nodes(q)[0] @ self.axes

    def rotation(self, q: Coordinates, xi: np.ndarray) -> Float[Array, "p 3"]:
        attitude = turn_of(self._quaternions(q, xi))
        return attitude[:, np.array([0, 2, 1])] * _SIGNS

    def torsion(self, q: Coordinates, xi: np.ndarray) -> Float[Array, " p"]:
        p = self._quaternions(q, xi)
        return 2 * jnp.arctan2(p[:, 1], p[:, 0])

    def strain(self, q: Coordinates, xi: np.ndarray) -> Float[Array, " p"]:
        strain, tangent = self._strains(q, xi)
        return jnp.sum(strain[:, :3] * tangent, 1)

    def curvature(self, q: Coordinates, xi: np.ndarray) -> Float[Array, "p 2"]:
        strain, _ = self._strains(q, xi)
        return jnp.stack([strain[:, 5], -strain[:, 4]], 1)

    def strain_energy(self, q: Coordinates) -> Number:
        tables, (u, p) = self.rod.tables, self.rod.nodes(q)
        strain = bent(tables, u, p).strain.reshape(tables.elements, -1)
        energy = jnp.einsum("em,eml,el->", strain, tables.stiffness, strain) / 2
        for node, end in self.rod.ends:
            energy = energy + end.energy(u[node], p[node])
        return energy

    def own_section_loads(
        self, q: Coordinates, v: Vector, xi: np.ndarray, outside: Any
    ) -> tuple[Float[Array, "p 3"], Float[Array, "p 3"]]:
        """Forces and moments in sections: polynomials of the degree of forces, in balance with all
        that acts on nodes, and what loads along the span do beside these; see `section_loads`."""
        viscous, loads = None, outside.loads
        if outside.damping.is_viscous:
            state = bent(self.rod.tables, *self.rod.nodes(q))
            viscous = self._viscous_sections(state, self.rod.of_velocities(v), outside.damping)
        six = self._sixes(q, xi, whole=True, more=viscous)
        if loads.act_along_span:
            nearest, tail = self._tails(q, xi, loads, outside.t)
            tables, (_, p) = self.rod.tables, self.rod.nodes(q)
            attitudes = rotation(jnp.einsum("gk,ekc->egc", tables.shapes, tables.of_elements(p)))
            own = [jnp.einsum("egba,egb->ega", attitudes, part) for part in nearest]
            inward = rotation(self._quaternions(q, xi)).swapaxes(1, 2)
            tail = jnp.einsum("pab,pxb->pxa", inward, tail.reshape(-1, 2, 3)).reshape(-1, 6)
            six = six + tail - tables.of_gauss(jnp.concatenate(own, -1), xi)
        return six[:, :3], six[:, np.array([3, 5, 4])] * _SIGNS

    def _tails(self, q: Coordinates, xi: np.ndarray, loads: Loads, t: Number) -> Any:
        """The section forces of loads along the span, as `tails` has it."""
        tables, sections = self.rod.tables, sections_of(self.rotor.beam)
        edges = tuple(sorted({*tables.ends, *sections.edges, *loads.kinks}))
        span = Span.between(edges, _POINTS)
        places, (u, p) = np.asarray(span.xi), self.rod.nodes(q)
        pace = _Pace(sections)(places)[:, None]
        force: Any = loads.along_span(t, places, pace)
        if loads.follows:
            rows, _ = tables.interpolating(places)
            force = jnp.einsum("pi,iab,pb->pa", rows, rotation(p), force)
        else:
            force = force @ self.axes.T

        def placed(xi: np.ndarray) -> Float[Array, "p 3"]:
            return self._undeformed_in_beam_axes(xi) + jnp.asarray(tables.interpolating(xi)[0]) @ u

        return tails(tables, u, span, pace * force, placed(places), placed(xi), xi)

    def own_reaction(
        self, hub: Hub, q: Coordinates, tip_force: Any = None, span: Any = None
    ) -> tuple[Triple, Triple]:
        """Force and moment about the centre of the hub by which the hub holds the rod that rests in
        it, by supports of the tip too: what is out of balance at ends without that."""
        u, p = self.rod.nodes(q)
        free = Rod(self.rod.tables, self.rod.mass, None, None, self.length)
        q = free.coordinates(u, p)
        residual = balance(free, q, self._around(hub, tip_force, span)).residual
        force, moment = jnp.zeros((2, 3), q.dtype)
        for node in (0,) if self.rod.tip is None else (0, -1):
            attitude, place = rotation(p[node]), self.rod.tables.place[node] + u[node]
            push = attitude @ residual[node, :3]
            force = force + push
            moment = moment + attitude @ residual[node, 3:] + jnp.cross(place, push)
        return force @ self.axes, moment @ self.axes

    def span_integral(self, kinks: tuple[float, ...], follows: bool) -> AbstractSpanIntegral:
        sections = sections_of(self.rotor.beam)
        edges = tuple(sorted({*self.rod.tables.ends, *sections.edges, *kinks}))
        return RodSpanIntegral(self.rod, _Pace(sections), self.axes, edges, follows)

    def _around(self, hub: Hub, tip_force: Any, span: Any) -> Around:
        """The surroundings of the resting rod, in axes of the beam."""
        load = self.load_in_beam_axes(tip_force)
        gravity = hub.gravity - hub.velocity_rate
        velocity, spin, gravity = (
            self.axes @ part for part in (hub.velocity, hub.angular_velocity, gravity)
        )
        return Around(velocity, spin, gravity, load, span)

    def load_in_beam_axes(self, load: Any) -> TipLoad | None:
        """A load at the tip, a force or a `TipLoad`; one that follows is in axes of its section."""
        if load is not None and not isinstance(load, TipLoad):
            load = TipLoad(load, jnp.zeros_like(load), False)
        if load is not None and not load.follows:
            load = TipLoad(self.axes @ load.force, self.axes @ load.moment, False)
        return load

    def _by_places(self, q: Coordinates, matrix: Float[Array, "N N"]) -> Matrix:
        """A matrix by displacements and turns in axes of the beam, the latter times the length."""
        n = len(self.rod.tables.place)
        attitude = self.rod.between_ends(rotation(self.rod.nodes(q)[1]))
        none = jnp.zeros_like(attitude)
        rows = jnp.concatenate([attitude, none], 2), jnp.concatenate([none, attitude], 2)
        node = jnp.concatenate([rows[0], rows[1] / self.length], 1)

        def times_nodes(matrix: Float[Array, "N N"]) -> Float[Array, "N N"]:
            return (node @ matrix.reshape(n, 6, -1)).reshape(6 * n, -1)

        by = times_nodes(times_nodes(matrix).T).T
        return by[np.ix_(self.rod.free, self.rod.free)]

    def _quaternions(self, q: Coordinates, xi: np.ndarray) -> Float[Array, "p 4"]:
        rows, _ = self.rod.tables.interpolating(xi)
        return jnp.asarray(rows) @ self.rod.nodes(q)[1]

    def _sixes(
        self, q: Coordinates, xi: np.ndarray, *, whole: bool = False, more: Array | None = None
    ) -> Float[Array, "p 6"]:
        """Forces in sections by the law of these, and `more` at Gauss points; or as a `whole`, with
        moments of their fibres."""
        tables = self.rod.tables
        strain = bent(tables, *self.rod.nodes(q)).strain
        weight = tables.pace * gauss(tables.degree)[1][None]
        force = jnp.einsum("eml,el->em", tables.stiffness, strain.reshape(tables.elements, -1))
        force = force.reshape(tables.elements, -1, 6)
        force = (force if more is None else force + more) / weight[:, :, None]
        if whole:
            force = pulled(tables, strain[..., 3:], force)
        return tables.of_gauss(force, xi)

    def _strains(
        self, q: Coordinates, xi: np.ndarray
    ) -> tuple[Float[Array, "p 6"], Float[Array, "p 3"]]:
        """Strains of sections by the forces in them, and tangents of the undeformed axis."""
        frame, sections = self._frames(xi)
        six = self._sixes(q, xi).reshape(-1, 2, 3)
        own = jnp.einsum("pab,pxa->pxb", frame, six).reshape(-1, 6)
        strain = jnp.einsum("pij,pj->pi", sections.compliance_at(xi), own).reshape(-1, 2, 3)
        strain = jnp.einsum("pab,pxb->pxa", frame, strain).reshape(-1, 6)
        tangent, fibres = frame[:, :, 0], sections.fibres_at(xi)
        if fibres is not None:
            square, built = fibres
            about = jnp.sum(strain[:, 3:] * tangent, 1)
            longer = square * (about / 2 + built) * about
            strain = strain.at[:, :3].add(-longer[:, None] * tangent)
        return strain, tangent

    def _frames(self, xi: np.ndarray) -> tuple[Float[Array, "p 3 3"], AbstractSections]:
        """Axes of sections, as columns, in those of the beam, and the sections."""
        sections = sections_of(self.rotor.beam)
        _, slope = sections.axis_at(xi)
        attitude = turned_by_pitch(self.rotor)
        return attitude[None] @ frames(slope, sections.twist_at(xi)), sections


class _Pace(eqx.Module):
    """The arc length by its share, at places."""

    sections: Any

    def __call__(self, places: np.ndarray) -> Float[Array, " p"]:
        _, slope = self.sections.axis_at(places)
        return jnp.sqrt(jnp.sum(slope**2, 1))
