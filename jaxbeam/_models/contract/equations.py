"""Equations of motion: what the equations of every model provide."""

import abc
from typing import Any, NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.rotary import SecondMoments
from jaxbeam._models.bases.shapes import Shapes
from jaxbeam._models.contract.damping_data import Dampers, Drag
from jaxbeam._models.contract.equilibrium import Rest, equilibrium
from jaxbeam._models.contract.span_integrals import AbstractSpanForce, AbstractSpanIntegral
from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._numerics.kinematics import Kinematics, Straight
from jaxbeam._numerics.linalg import dense
from jaxbeam._numerics.small import SmallMatrix
from jaxbeam._programs.lanes import matvec_once, pairwise_sum, transposed
from jaxbeam._rotor.ends import Tip, TipBody
from jaxbeam._rotor.motion import Hub, axes, cross, rotation_vector
from jaxbeam._rotor.span import Span
from jaxbeam._types import Coordinates, Matrix, Number, Triple, Vector

_MOST_HIGH = 0.1  # share of forces in the highest functions up to which functions are enough
# Motion of the hub, load at the tip (a force, a `TipLoad` or None) and force along the span.
Inputs = tuple[Hub, Any, AbstractSpanForce | None]


def forces_are_resolved(share: tuple[Number, Number] | None) -> Array | bool:
    """Whether functions are enough for the forces in sections, by energies as of
    `Equations.high_share`."""
    return True if share is None else share[0] <= _MOST_HIGH**2 * share[1]


class Undeformed(NamedTuple):
    """The beam with its tip mass before it deforms, in hub axes from the centre of the hub."""

    mass: Number  # kg
    first: Triple  # int r dm, kg m
    inertia: Matrix  # int r.r - r r^T dm, kg m^2
    tip: Triple  # m


class Equations(eqx.Module):
    """A model of one rotor in motion: M v' = force(hub, q, v), in the hub frame, v = q' but of
    rods, which say how coordinates go with velocities (`kinematics`).

    Coordinates q (n,) are metres, velocities m/s, forces N; the angle of the polar discrete models,
    in rad, has moments for forces.

    Forces derive from the kinetic energy T(q, q', v, omega), v and omega being the velocity and
    angular velocity of the hub, and from elastic forces:

        d/dt dT/dq' - dT/dq + elastic_force(q) = external forces.

    Then T also gives what the hub feels, the momentum dT/dv and the angular momentum dT/domega,
    and for any T the total energy changes by exactly what hub and external forces do.
    """

    mass: eqx.AbstractVar[Matrix | BlockTridiagonal | SmallMatrix]
    rigid_moments: eqx.AbstractVar[Triple]  # int (1, X, X^2) dm, X the distance from the axis
    length: eqx.AbstractVar[Number]  # length of the beam, a scale of displacements, m
    tip_radius: eqx.AbstractVar[Number]  # distance of the undeformed tip from the axis, m
    energy_scale: eqx.AbstractVar[Number]  # a scale of energies, such as EI / L, J

    @property
    def kernel(self) -> Self | None:
        """The part of these equations that forces, tangents and energies take, if they suit
        `kernel`."""
        return None

    @property
    def is_linear(self) -> bool:
        """Whether `force` is linear in q and v."""
        return False

    @property
    def functions(self) -> Shapes | None:
        """The model's functions along a beam that varies; None of other beams and elements."""
        return None

    @property
    def undeformed(self) -> Undeformed:
        """The undeformed beam, along a1 from the hub."""
        mass, first, second = self.rigid_moments
        along, across = np.eye(3)[0], np.diag([0.0, 1.0, 1.0])
        return Undeformed(mass, first * along, second * across, self.tip_radius * along)

    @abc.abstractmethod
    def force(self, hub: Hub, q: Coordinates, v: Vector, tip_force: Triple | None) -> Vector:
        """Right-hand side of the equations of motion without damping; `tip_force` is in hub axes,
        in N, or a `TipLoad` for models that know it."""

    def as_force(self, q: Coordinates, generalised: Vector) -> Vector:
        """A generalised force (its power, in W, is that times q') as it enters `force`."""
        return generalised

    def kinematics(self, q: Coordinates, v: Vector) -> Coordinates:
        """The rates q' of coordinates, linear in velocities v."""
        return v

    def stage_kinematics(self, q: Coordinates, v: Vector, g: Number) -> Kinematics:
        """The kinematics of a stage of a solver, see `SecondOrderSystem`."""
        return Straight(g)

    def as_velocities(self, q: Coordinates, change: Vector) -> Vector:
        """A small change of coordinates, expressed as changes that velocities are the rates of."""
        return change

    def displaced(self, q: Coordinates) -> Vector:
        """Difference of coordinates from those of the undeformed beam, as small changes of n
        coordinates."""
        return q

    def velocity_measure(self) -> Matrix | None:
        """The matrix W of v^T W v, the square of one velocity that scales the errors of all
        velocities in step-size control; None where each has a scale of its own."""
        return None

    @property
    def rest(self) -> Vector:
        """Coordinates of the undeformed beam."""
        return jnp.zeros(self.mass.shape[0], self.length.dtype)

    def equilibrium(self, hub: Hub, tip_force: Any = None, span: Any = None) -> Rest:
        """Coordinates at which the beam rests in a hub whose motion does not change, and the status
        of the search: see `equilibrium`."""
        return equilibrium(self, hub, tip_force, span)

    def matrices_about(
        self, hub: Hub, q: Coordinates, tip_force: Any = None, span: Any = None
    ) -> tuple[Matrix, Matrix, Matrix]:
        """Matrices of mass, of rates and of stiffness for small motion about a state of rest."""
        k, c = self.tangents_under((hub, tip_force, span), q, jnp.zeros_like(q))
        m, c, k = (self.generalised(q, a) for a in (self.mass, c, k))
        return m, c, k

    def force_under(self, inputs: Inputs, q: Coordinates, v: Vector) -> Vector:
        """The force f of these inputs, a force along the span included."""
        hub, tip_force, span = inputs
        force = self.force(hub, q, v, tip_force)
        return force if span is None else force + span.on(self, q)

    def tangents_under(self, inputs: Inputs, q: Coordinates, v: Vector) -> tuple[Any, Any]:
        """Stiffness and damping of `force_under`, as of `tangents`."""
        hub, tip_force, span = inputs
        k, c = self.tangents(hub, q, v, tip_force)
        by_span = None if span is None else span.tangent(self, q)
        return k if by_span is None else k + by_span, c

    def damping_matrix_about(self, q: Coordinates, drag: Drag) -> Matrix:
        """The matrix of damping in small motion about a state of rest."""
        return self.generalised(q, self.damping_tangents(q, jnp.zeros_like(q), drag)[1])

    def generalised(self, q: Coordinates, a: Any) -> Matrix:
        """A matrix of generalised forces from one of forces, which `force` may scale; at rest the
        derivative of the scale has no effect."""
        return dense(a) / self.as_force(q, jnp.ones_like(q))[:, None]

    @abc.abstractmethod
    def elastic_force(self, q: Coordinates) -> Vector:
        """Generalised elastic forces; zero at q = 0, the undeformed beam."""

    @abc.abstractmethod
    def viscous_force(self, q: Coordinates, v: Vector) -> Vector:
        """The force B^T D B q' of stresses that are stiffness times rates of strain, with B =
        d strain/dq and D the stiffness. See `_models/ancf/strained.py`."""

    @abc.abstractmethod
    def strain_energy(self, q: Coordinates) -> Number:
        """Strain energy U, in J; zero at q = 0."""

    def root_slopes(self) -> Float[Array, "2 n"] | None:
        """Angles of the root, in plane and in flap, by coordinates, where they are linear in
        these; of models that support dampers."""
        return None

    def damper_force(self, q: Coordinates, v: Vector, dampers: Dampers) -> Vector:
        """The force B^T d B q', B = d phi/dq, of dampers d at the root with angles phi that are not
        linear in q; for models that support dampers."""
        raise NotImplementedError

    def damper_tangents(self, q: Coordinates, v: Vector, dampers: Dampers) -> tuple[Any, Any]:
        """Derivatives of `damper_force` by q and q', of the kind of `mass`."""
        raise NotImplementedError

    def like_mass(self, matrix: Matrix) -> Any:
        """A matrix (n, n) converted to the kind of `mass`; for models whose `Drag` has a matrix."""
        return matrix

    def nonconservative_force(self, q: Coordinates) -> Vector:
        """The part of elastic forces without a potential: `elastic_force` minus the gradient of
        `strain_energy`, zero in all models but Model A."""
        return jnp.zeros_like(q)

    @abc.abstractmethod
    def kinetic_energy(self, q: Coordinates, v: Vector, velocity: Triple, spin: Triple) -> Number:
        """Kinetic energy T without that of the rigid undeformed beam, T(0, 0, v, omega), in J."""

    @abc.abstractmethod
    def first_moment(self, q: Coordinates) -> Triple:
        """First moment int u dm: the mass times the displacement of its centre, kg m."""

    @abc.abstractmethod
    def displacement(self, q: Coordinates, xi: np.ndarray) -> Float[Array, "p 3"]:
        """Axial, in-plane and flap displacement in the hub frame at x = xi L, in m."""

    @abc.abstractmethod
    def strain(self, q: Coordinates, xi: np.ndarray) -> Float[Array, " p"]:
        """Axial strain of the centre line at x = xi L."""

    @abc.abstractmethod
    def curvature(self, q: Coordinates, xi: np.ndarray) -> Float[Array, "p 2"]:
        """In-plane and flap curvature at x = xi L, in 1/m: how fast the tangent turns by the
        unstretched length, in axes that turn with the section, but not with pitch and twist that
        the beam has by itself."""

    def tip(self, q: Coordinates) -> Triple:
        """Displacement of the tip, in m: shape (3,), axial, in plane, flap."""
        return self.displacement(q, np.ones(1))[0]

    def torsion(self, q: Coordinates, xi: np.ndarray) -> Float[Array, " p"]:
        """Angle of torsion at x = xi L, in rad; zero for models without torsion."""
        return jnp.zeros(len(xi), q.dtype)

    @property
    def pieces(self) -> tuple[float, ...]:
        """Edges x / L, from 0 to 1, between which displacements of a beam are smooth."""
        raise NotImplementedError

    def undeformed_at(self, xi: np.ndarray) -> Float[Array, "p 3"]:
        """Places x = xi L of the undeformed beam, in hub axes from the centre of the hub, in m."""
        tip = self.undeformed.tip
        root = (self.tip_radius - self.length) * jnp.eye(3, dtype=tip.dtype)[0]
        return root[None] + jnp.asarray(xi)[:, None] * (tip - root)[None]

    def rates(self, q: Coordinates, change: Vector) -> Vector:
        """The rates of coordinates q by those of the n unknowns of `matrices_about`."""
        return change

    def own_section_loads(
        self, q: Coordinates, v: Vector, xi: np.ndarray, outside: Any
    ) -> tuple[Array, Array] | None:
        """Force and moment in sections, as of `section_loads`, for models with equations of their
        own for these; None for others."""
        return None

    def own_reaction(
        self, hub: Hub, q: Coordinates, tip_force: Any = None, span: Any = None
    ) -> tuple[Triple, Triple] | None:
        """Force, and moment about its centre, by which the hub holds a beam that rests in it, for
        models with equations of their own for these; None for others."""
        return None

    def is_held(self, state: Rest) -> Array | None:
        """Whether supports or loads hold a state of rest in place; None where that is sure."""
        return None

    def lacking_about(self, q: Coordinates) -> Matrix | None:
        """The matrix by which the stiffness about q may be too small at most, where known."""
        return None

    def high_share(self, q: Coordinates) -> tuple[Number, Number] | None:
        """Energy of the forces in the highest functions, and of all forces in sections; None where
        these are not known."""
        return None

    def placed(self, q: Coordinates, span: Span) -> Float[Array, "p 3"]:
        """Places of the points of a span, in hub axes from the centre of the hub, in m."""
        return self.undeformed_at(span.xi) + self.displacement(q, np.asarray(span.xi))

    def direction(self, q: Coordinates, xi: np.ndarray) -> Float[Array, "p 3"]:
        """r' in hub axes, along the tangent, at x = xi L; of beams."""
        raise NotImplementedError

    def section_axes(self, q: Coordinates, xi: np.ndarray) -> Float[Array, "p 3 3"]:
        """Rows: the tangent and the axes of `curvature`, in hub axes, of sections at x = xi L."""
        r = self.direction(q, xi).T
        return jnp.moveaxis(axes(r / jnp.linalg.norm(r, axis=0)[None]), 2, 0)

    def rotation(self, q: Coordinates, xi: np.ndarray) -> Float[Array, "p 3"]:
        """Rotation of sections at x = xi L from where they are in the undeformed beam, as the axis
        times the angle in rad: along the beam, about a3 and about -a2, these leaned with it."""
        beam = self.section_axes(jnp.zeros_like(q), np.zeros(1))[0]
        along = beam @ self.section_axes(q, xi)[:, 0].T
        about, lowering, lag = rotation_vector(along)
        return jnp.stack([about, lag, -lowering], 1)

    def tip_energy(
        self, body: Tip, q: Coordinates, v: Vector, velocity: Triple, spin: Triple
    ) -> Number:
        """Kinetic energy of the mass at the tip, in J: of a mass M at r + c r', and for a body also
        `turning_energy`."""

        def centre(q: Coordinates) -> Any:
            return body.centre(self.undeformed.tip + self.tip(q), self.end(q))

        place, moving = jax.jvp(centre, (q,), (v,))
        moving = moving + velocity + cross(spin, place)
        energy = body.mass * pairwise_sum(moving * moving) / 2
        if isinstance(body, TipBody):
            energy = energy + self.turning_energy(body, q, v, spin)
        return energy

    def end(self, q: Coordinates) -> Triple:
        """The vector r' at the tip, along the axis of a body there."""
        return self.direction(q, np.ones(1))[0]

    def turning_energy(self, body: TipBody, q: Coordinates, v: Vector, spin: Triple) -> Number:
        """Kinetic energy of rotation of a body at the tip, in J; here without axial inertia."""
        along, rate = jax.jvp(self.end, (q,), (v,))
        rate = rate + cross(spin, along)
        return body.inertia * pairwise_sum(rate * rate) / 2

    def section_momentum(
        self, q: Coordinates, v: Vector, spin: Triple, span: Span, moments: SecondMoments
    ) -> Float[Array, "p 3"] | None:
        """Angular momentum of sections about their centres at the points of a span, from their
        second moments there; None where the model leaves their rotary inertia out."""
        return None

    def is_in_range(self, q: Coordinates) -> Array:
        """Whether deformation is within the range that the model is valid for."""
        return jnp.asarray(True)

    def is_unfolded(self, q: Coordinates) -> Array:
        """Whether the beam is nowhere turned back on itself, as no beam that was straight can be
        without bending: a search for where it rests may end there."""
        return jnp.asarray(True)

    def tip_power(self, q: Coordinates, v: Vector, tip_force: Any) -> Number:
        """The power of a load at the tip, in W."""
        return pairwise_sum(tip_force * jax.jvp(self.tip, (q,), (self.kinematics(q, v),))[1])

    def tip_action(self, q: Coordinates, tip_force: Any) -> tuple[Triple, Triple]:
        """Force and moment of a load at the tip, in hub axes, in N and N m."""
        return tip_force, jnp.zeros_like(tip_force)

    def span_integral(self, kinks: tuple[float, ...], follows: bool) -> AbstractSpanIntegral:
        """The generalised force of a force along the span, smooth but for these x / L; of models
        that support `loads.force_per_length`. If it follows, it turns with the sections: of those
        that support `loads.follows`."""
        raise NotImplementedError

    @transposed(on=False)
    def tangents(
        self, hub: Hub, q: Coordinates, v: Vector, tip_force: Triple | None
    ) -> tuple[Any, Any]:
        """Stiffness K = -d force / dq and damping C = -d force / dq', of the kind of `mass`."""
        k, c = jax.jacfwd(self.force, argnums=(1, 2))(hub, q, v, tip_force)
        return -k, -c

    def elastic_tangent(self, q: Coordinates) -> Any:
        """d elastic_force / dq, of the kind of `mass`."""
        return jax.jacfwd(self.elastic_force)(q)

    @transposed(on=False)
    def viscous_tangents(self, q: Coordinates, v: Vector) -> tuple[Any, Any]:
        """Derivatives of `viscous_force` by q and q', of the kind of `mass`."""
        by: tuple[Any, Any] = jax.jacfwd(self.viscous_force, (0, 1))(q, v)
        return by

    def damping(self, q: Coordinates, v: Vector, drag: Drag) -> Vector:
        """mass_coefficient dT/dq' + stiffness_coefficient viscous_force(q, q') and what dampers and
        the matrix do, T seen from the hub; see `Damping`."""
        out = jnp.zeros_like(q)
        if drag.mass_coefficient is not None:
            still = jnp.zeros((3, *q.shape[1:]), q.dtype)  # q may have axes of lanes

            def kinetic(v: Array) -> Array:
                return jnp.sum(self.kinetic_energy(q, v, still, still))

            out = out + drag.mass_coefficient * jax.grad(kinetic)(v)
        if drag.stiffness_coefficient is not None:
            out = out + drag.stiffness_coefficient * self.viscous_force(q, v)
        if drag.dampers is not None:
            out = out + self.damper_force(q, v, drag.dampers)
        if drag.matrix is not None:
            out = out + matvec_once(drag.matrix, v)
        return out

    def damping_tangents(self, q: Coordinates, v: Vector, drag: Drag) -> tuple[Any, Any]:
        """Derivatives of `damping`, as it enters `force`, by q and q'; here
        for inertia that does not depend on q."""
        own: Any = self.mass
        k, c = 0 * own, 0 * own
        if drag.mass_coefficient is not None:
            c = c + drag.mass_coefficient * own
        if drag.stiffness_coefficient is not None:
            by_q, by_v = self.viscous_tangents(q, v)
            k, c = k + drag.stiffness_coefficient * by_q, c + drag.stiffness_coefficient * by_v
        if drag.dampers is not None:
            by_q, by_v = self.damper_tangents(q, v, drag.dampers)
            k, c = k + by_q, c + by_v
        if drag.matrix is not None:
            c = c + self.like_mass(drag.matrix)
        return k, c
