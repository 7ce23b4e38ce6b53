"""What all models of a continuous beam share: displacements linear in the coordinates.

u_c(x, t) = f_a(x) q_a(t), summed over the coordinates a that move in direction c. Then the inertia
of a beam on any moving hub needs only one Gram matrix of all functions, int f_a f_b dm, and the
moments int f_a dm and int X f_a dm, X = R + x: with W = w~ w~ + w~' (w~ b = omega x b),

    M q'' + [2 w~] G q' + [W] G q + (a_O + W X a1) . f + P-terms + elastic forces = external forces

where [B] G has the entries B_cd G_ab, a moving in direction c and b in d. These are Y eqs. 18-20,
and B eq. 53 with any motion of the hub. Tables are NumPy, computed once for a unit beam.

Y: H. H. Yoo, R. R. Ryan, R. A. Scott, Dynamics of flexible beams undergoing overall motions,
Journal of Sound and Vibration, 1995.
B: M. Berzeri, A. A. Shabana, A finite element study of the geometric centrifugal stiffening effect,
Technical Report MBS99-5-UIC, 1999.
"""

import abc
import functools
from typing import NamedTuple, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.base import (
    AbstractModel,
    Equations,
    Family,
    LinearSystem,
    rigid_moments,
)
from jaxbeam._models.basis import Basis, Functions, bending_integrals, stretch_integrals
from jaxbeam._numerics.linalg import dense
from jaxbeam._rotor.beam import Rotor, tension
from jaxbeam._rotor.motion import Hub, skew, spinning
from jaxbeam._status import Status
from jaxbeam._types import Matrix, Number, Scalar, Triple, Vector

_DIRECTION = {Family.AXIAL: 0, Family.IN_PLANE: 1, Family.FLAP: 2}


class Elasticity(eqx.Module):
    """Elastic forces as a function of the coordinates."""

    @abc.abstractmethod
    def energy(self, q: Vector) -> Scalar:
        """Strain energy, J."""

    def force(self, q: Vector) -> Vector:
        """Left-hand side of the equations; the gradient of the energy unless a theory differs."""
        return jax.grad(self.energy)(q)

    def nonconservative_force(self, q: Vector) -> Vector:
        """force minus the gradient of energy."""
        return jnp.zeros_like(q)

    def tangent(self, q: Vector) -> Matrix:
        """d force / dq."""
        return jax.jacfwd(self.force)(q)

    @abc.abstractmethod
    def strain(self, gradient: Float[Array, "p 3"]) -> Float[Array, " p"]:
        """Axial strain from the displacement gradient du/dx."""


class LinearElasticity(Elasticity):
    """U = q.K q / 2, axial strain u1' (or s')."""

    stiffness: Matrix

    def energy(self, q: Vector) -> Scalar:
        return q @ self.stiffness @ q / 2

    def force(self, q: Vector) -> Vector:
        return self.stiffness @ q

    def tangent(self, q: Vector) -> Matrix:
        return self.stiffness

    def strain(self, gradient: Float[Array, "p 3"]) -> Float[Array, " p"]:
        return gradient[:, 0]


class Tables(NamedTuple):
    """Integrals over a beam of unit length and mass, and values at its tip."""

    direction: Float[np.ndarray, "n 3"]  # one-hot: which way a coordinate moves
    gram: Float[np.ndarray, "n n"]
    moment: Float[np.ndarray, " n"]
    first: Float[np.ndarray, " n"]  # int xi f
    tip: Float[np.ndarray, " n"]
    elastic: Float[np.ndarray, "3 n n"]  # axial f' f', in plane and flap f'' f''
    tension: Float[np.ndarray, "3 n n"]  # bending alone: int t_k f' f', see `Integrals`
    axial_tension: Float[np.ndarray, "3 n n"]  # the same for the axial coordinates


class CartesianModel(AbstractModel[Rotor]):
    """A model with `counts` functions of one basis for axial, in-plane and flap displacement."""

    @property
    @abc.abstractmethod
    def functions_from(self) -> Basis:
        """The basis that all functions of the model come from."""

    @property
    @abc.abstractmethod
    def counts(self) -> tuple[int, int, int]:
        """Number of axial, in-plane and flap coordinates; they come in this order."""

    @property
    def families(self) -> tuple[Family, ...]:
        """Families of the coordinates: axial first, then in plane, then flap."""
        each = zip((Family.AXIAL, Family.IN_PLANE, Family.FLAP), self.counts, strict=True)
        return tuple(family for family, count in each for _ in range(count))

    @property
    def foreshortens(self) -> bool:
        """Whether axial coordinates are arc-length stretch, so that deflection shortens u1."""
        return False

    def displacement(self, xi: Float[np.ndarray, " p"]) -> Float[Array, "3 p n"]:
        """To first order: foreshortening is of second order."""
        table = all_functions(self.functions_from, self.counts, np.asarray(xi, float)).value
        return jnp.asarray(np.einsum("pn,nc->cpn", table, self.tables.direction))

    @property
    def tables(self) -> Tables:
        """Integrals of the functions, computed once."""
        return _tables(self.functions_from, self.counts)

    def linear_stiffness(self, rotor: Rotor) -> Matrix:
        """EA int f' f' dx axially, EI int f'' f'' dx in bending: Y eqs. 9 and 10."""
        beam, length = rotor.beam, rotor.beam.length
        rigidity = (
            beam.axial_stiffness / length,
            beam.in_plane_bending_stiffness / length**3,
            beam.flap_bending_stiffness / length**3,
        )
        return jnp.tensordot(jnp.stack(rigidity), self.tables.elastic, 1)


def linear_system(model: CartesianModel, rotor: Rotor, speed: Scalar) -> LinearSystem:
    """Matrices of a model whose equations are linear: their coefficients, whatever the state."""
    equations, zero = model.equations(rotor), jnp.zeros(len(model.families), speed.dtype)
    k, c = equations.tangents(spinning(speed), zero, zero, None)
    return LinearSystem(
        mass=dense(equations.mass),
        gyroscopic=c,
        stiffness=k,
        steady_strain=rotor.steady_strain(speed),
        status=jnp.asarray(Status.OK),
        families=model.families,
    )


class CartesianEquations(Equations):
    """Inertia of a hub-mounted beam of any theory; `stiffening` and `elasticity` differ.

    `stiffening` holds int t_k f' f' on the coordinates on which the tension P(x) of the rigid
    motion acts, P(x) = -int_x^L a1 dm, a1 = a_O1 - (omega_2^2 + omega_3^2) X (Y eqs. 19, 20); None
    where a theory has no such term. It is what remains of the foreshortening
    -1/2 int_0^x u'^2 after linearisation, and enters the kinetic energy as such.
    """

    mass: Matrix
    gram: Matrix
    moment: Vector
    first: Vector
    rigid: Triple
    size: Number
    end: Number
    energy_scale: Number
    masses: tuple[Number, Number]  # of the beam and at the tip
    hub_radius: Number
    elasticity: Elasticity
    stiffening: Float[Array, "3 n n"] | None
    model: CartesianModel = eqx.field(static=True)

    @classmethod
    def build(
        cls,
        model: CartesianModel,
        rotor: Rotor,
        elasticity: Elasticity,
        stiffening: np.ndarray | None = None,
    ) -> Self:
        """Scale the tables of `model` to a rotor."""
        beam, t = rotor.beam, model.tables
        radius, length, mass, tip_mass = rotor.hub_radius, beam.length, beam.mass, rotor.tip_mass
        end = radius + length
        gram = mass * t.gram + tip_mass * np.outer(t.tip, t.tip)
        return cls(
            mass=gram * (t.direction @ t.direction.T),
            gram=gram,
            moment=mass * t.moment + tip_mass * t.tip,
            first=mass * (radius * t.moment + length * t.first) + tip_mass * end * t.tip,
            rigid=rigid_moments(rotor),
            size=length,
            end=end,
            energy_scale=beam.in_plane_bending_stiffness / length,
            masses=(mass, tip_mass),
            hub_radius=radius,
            elasticity=elasticity,
            stiffening=None if stiffening is None else jnp.asarray(stiffening),
            model=model,
        )

    def motion_stiffness(self, axial: Scalar, spin2: Scalar, tip_force: Triple | None) -> Matrix:
        """int P f' f' dx for a1(X) = axial - spin2 X, and for a force along the beam at its tip."""
        assert self.stiffening is not None
        mass, tip_mass = self.masses
        tip, *rest = tension(spin2, self.hub_radius, tip_mass, mass, self.size, axial)
        pull = 0.0 if tip_force is None else tip_force[0]
        coefficients = jnp.stack([tip + pull, *rest])
        return jnp.tensordot(coefficients / self.size, self.stiffening, 1)

    @property
    def is_linear(self) -> bool:
        return isinstance(self.elasticity, LinearElasticity)

    def force(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None) -> Vector:
        direction, w = self.model.tables.direction, _turning(hub)
        turn = 2 * skew(hub.angular_velocity)
        carried = (
            hub.acceleration[None] * self.moment[:, None] + w[:, 0][None] * self.first[:, None]
        )
        moving = self.gram @ jnp.concatenate([direction * q[:, None], direction * v[:, None]], 1)
        inertial = moving[:, :3] @ w.T + moving[:, 3:] @ turn.T + carried
        out = -jnp.sum(inertial * direction, 1) - self.elasticity.force(q)
        if tip_force is not None:
            out = out + self.model.tables.tip * (direction @ tip_force)
        if self.stiffening is not None:
            out = out - self._tension(hub, w, tip_force) @ q
        return out

    def tangents(
        self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None
    ) -> tuple[Matrix, Matrix]:
        w = _turning(hub)
        k = self.inertial(w) + self.elasticity.tangent(q)
        if self.stiffening is not None:
            k = k + self._tension(hub, w, tip_force)
        return k, self.inertial(2 * skew(hub.angular_velocity))

    def inertial(self, b: Float[Array, "3 3"]) -> Matrix:
        """[B] G of the module's docstring."""
        direction = self.model.tables.direction
        return (direction @ b @ direction.T) * self.gram

    def _tension(self, hub: Hub, w: Float[Array, "3 3"], tip_force: Triple | None) -> Matrix:
        return self.motion_stiffness(hub.acceleration[0], -w[0, 0], tip_force)

    def elastic_force(self, q: Vector) -> Vector:
        return self.elasticity.force(q)

    def elastic_tangent(self, q: Vector) -> Matrix:
        return self.elasticity.tangent(q)

    def strain_energy(self, q: Vector) -> Scalar:
        return self.elasticity.energy(q)

    def nonconservative_force(self, q: Vector) -> Vector:
        return self.elasticity.nonconservative_force(q)

    def kinetic_energy(self, q: Vector, v: Vector, velocity: Triple, spin: Triple) -> Scalar:
        """T = int |v + omega x (X a1 + u) + u'|^2 dm / 2 by moments of u and u'."""
        direction = self.model.tables.direction
        at, moving = direction * q[:, None], direction * v[:, None]
        g_moving = self.gram @ moving
        moment, rate = self.moment @ at, self.moment @ moving
        first = self.first @ at
        second = jnp.asarray(at.T @ (self.gram @ at))
        second = second.at[0].add(first).at[:, 0].add(first)
        mixed = (
            jnp.asarray(at.T @ g_moving).at[0].add(self.first @ moving)
        )  # int (X a1 + u)_c u'_d dm
        if self.stiffening is not None:
            zero, one = jnp.zeros_like(self.size), jnp.ones_like(self.size)
            short = self.motion_stiffness(-one, zero, None)  # -1/2 q.D q = int w dm
            short_first = self.motion_stiffness(zero, one, None)  # ... = int X w dm
            moment = moment.at[0].add(-q @ short @ q / 2)
            rate = rate.at[0].add(-q @ short @ v)
            second = second.at[0, 0].add(-q @ short_first @ q)
        # |omega x r|^2 = tr(w~ r r^T w~^T)
        turning = skew(spin) @ second
        return (
            velocity @ (skew(spin) @ moment)
            + velocity @ rate
            + jnp.sum(skew(spin) * turning) / 2
            - jnp.sum(skew(spin) * mixed)  # spin . int (X a1 + u) x u' dm
            + jnp.sum(moving * g_moving) / 2
        )

    def first_moment(self, q: Vector) -> Triple:
        out = self.moment @ (self.model.tables.direction * q[:, None])
        if self.stiffening is not None:
            one = jnp.ones_like(self.size)
            out = out.at[0].add(-q @ self.motion_stiffness(-one, 0 * one, None) @ q / 2)
        return out

    def tip(self, q: Vector) -> Triple:
        """To second order where there is `stiffening`, as the kinetic energy has it."""
        out = self.model.tables.tip @ (self.model.tables.direction * q[:, None])
        if self.stiffening is not None:
            zero = jnp.zeros_like(self.size)
            pull = self.motion_stiffness(zero, zero, jnp.ones(3, q.dtype))
            out = out.at[0].add(-q @ pull @ q / 2)
        return out

    def displacement(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        """For arc-length models u1 = s - 1/2 int_0^x (u2'^2 + u3'^2) dx (Y eq. 4)."""
        out = jnp.tensordot(self.model.displacement(xi), q, 1).T
        if self.model.foreshortens:
            key = tuple(np.asarray(xi, float).tolist())
            table = _foreshortening(self.model.functions_from, self.model.counts, key)
            out = out.at[:, 0].add(-jnp.einsum("a,pab,b->p", q, table, q) / (2 * self.size))
        return out

    def strain(self, q: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        slope = self._at(xi).slope
        gradient = slope @ (self.model.tables.direction * q[:, None]) / self.size
        return self.elasticity.strain(gradient)

    def curvature(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 2"]:
        bends = self.model.tables.direction[:, 1:]
        # Axial functions may have no curvature at the clamp: nobody asks for it.
        table = np.where(bends.any(1), self._at(xi).curvature, 0.0)
        return table @ (bends * q[:, None]) / self.size**2

    def _at(self, xi: np.ndarray) -> Functions:
        return all_functions(self.model.functions_from, self.model.counts, np.asarray(xi, float))


def _turning(hub: Hub) -> Float[Array, "3 3"]:
    """W = w~ w~ + w~', the acceleration of a point at rest in the hub by its position."""
    k = skew(hub.angular_velocity)
    return k @ k + skew(hub.angular_velocity_rate)


def all_functions(basis: Basis, counts: tuple[int, int, int], xi: np.ndarray) -> Functions:
    """All functions of a model side by side, at points xi."""
    parts = [basis.stretch(counts[0], xi)] if counts[0] else []
    parts += [basis.bending(n, xi) for n in counts[1:] if n]
    return Functions(*(np.concatenate(same, 1) for same in zip(*parts, strict=True)))


@functools.lru_cache(maxsize=64)
def _tables(basis: Basis, counts: tuple[int, int, int]) -> Tables:
    family = np.repeat(np.arange(3), counts)
    direction = np.eye(3)[family]
    xi, w = basis.quadrature(max(counts))
    f = all_functions(basis, counts, xi).value
    gram = f.T @ (w[:, None] * f)
    elastic, tension, axial_tension = (np.zeros((3, family.size, family.size)) for _ in range(3))
    for k, n in enumerate(counts):
        if n == 0:
            continue
        rows = np.ix_(family == k, family == k)
        own = (stretch_integrals if k == 0 else bending_integrals)(basis, n)
        gram[rows] = own.mass
        elastic[k][rows] = own.tension[0] if k == 0 else own.curvature
        for table, whole in zip(own.tension, axial_tension if k == 0 else tension, strict=True):
            whole[rows] = table
    return Tables(
        direction=direction,
        gram=(gram + gram.T) / 2,
        moment=w @ f,
        first=(w * xi) @ f,
        tip=all_functions(basis, counts, np.ones(1)).value[0],
        elastic=elastic,
        tension=tension,
        axial_tension=axial_tension,
    )


@functools.lru_cache(maxsize=64)
def _foreshortening(
    basis: Basis, counts: tuple[int, int, int], xi: tuple[float, ...]
) -> Float[np.ndarray, "p n n"]:
    """int_0^xi f' f' of functions that bend the same way, for a unit beam."""
    family = np.repeat(np.arange(3), counts)
    same = (family[:, None] == family) & (family > 0)
    points, w = basis.quadrature(max(counts))
    out = []
    for end in xi:
        # Rescaled to [0, xi], the rule stays exact for smooth functions.
        f = all_functions(basis, counts, end * points).slope
        out.append((f.T @ (end * w[:, None] * f)) * same)
    return np.stack(out)
