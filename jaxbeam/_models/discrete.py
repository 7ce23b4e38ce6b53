"""The discrete analogue of a rotating beam: a particle, two springs, five theories (Y, section 6).

Cartesian x, y (from the relaxed place, in the frame of the hub) or polar s, theta, with
x = (L + s) cos(theta) - L, y = (L + s) sin(theta):

    DiscreteNC  exact, Cartesian        DiscreteLC  linear in x, y (no stiffening: C.L.C.)
    DiscreteNP  exact, polar            DiscreteLP  linear in s, theta (the hybrid method)
    DiscreteNS  stretch to second degree in x, y (von Karman)

Y Table 1 is misprinted: NC, LC and NS lack the Euler term m Omega' (d + L), without which they
hardly move; NP lacks d in the last inertia term of both equations; the stiffness in LP is
m d L Omega^2 + k_r, not m Omega^2 + k_r. The motion must turn about the axis normal to the plane.

Y is the paper of `_models/contract/__init__.py`.
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.damping_data import Drag, viscous
from jaxbeam._models.contract.equations import Equations
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.motion import Hub, cross, skew
from jaxbeam._rotor.spring_rotor import SpringRotor
from jaxbeam._types import Matrix, Scalar, Triple, Vector


class _Discrete(AbstractModel[SpringRotor]):
    rotor_type = SpringRotor

    @property
    def directions(self) -> tuple[Direction, ...]:
        """Directions of the two coordinates: along the tube first, then across."""
        return Direction.AXIAL, Direction.IN_PLANE

    def displacement(
        self, xi: Float[np.ndarray, " p"], rotor: SpringRotor
    ) -> Float[Array, "3 p n"]:
        """Displacement of the particle to first order, for any xi; an angle theta moves it across
        by L theta."""
        one = jnp.ones(np.asarray(xi).size)
        zero = jnp.zeros((*one.shape, 2))
        return jnp.stack([zero.at[:, 0].set(one), zero.at[:, 1].set(one), zero])

    @abc.abstractmethod
    def equations(self, rotor: SpringRotor) -> "_Particle": ...


StrainLaw = Callable[
    [SpringRotor, Vector], tuple[Scalar, Scalar]
]  # strains of both springs: stretch, and angle


class _Particle(Equations):
    """The particle at (X, y) in the frame of the hub, X = d + L + x."""

    mass: Matrix
    rigid_moments: Triple
    length: Scalar
    tip_radius: Scalar
    energy_scale: Scalar
    rotor: SpringRotor
    strains: StrainLaw = eqx.field(static=True)

    @property
    def is_linear(self) -> bool:
        return self.strains is _quadratic

    def tip(self, q: Vector) -> Triple:
        return jnp.concatenate([self.place(q), jnp.zeros(1)])

    def elastic_force(self, q: Vector) -> Vector:
        return jax.grad(self.strain_energy)(q)

    def strain_energy(self, q: Vector) -> Scalar:
        stretch, angle = self.strains(self.rotor, q)
        return (self._springs[0] * stretch**2 + self._springs[1] * angle**2) / 2

    def viscous_force(self, q: Vector, v: Vector) -> Vector:
        def strains(q: Vector) -> tuple[Scalar, Scalar]:
            return self.strains(self.rotor, q)

        def stresses(rates: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            return self._springs[0] * rates[0], self._springs[1] * rates[1]

        return viscous(strains, stresses, q, v)

    @property
    def _springs(self) -> tuple[Scalar, Scalar]:
        return self.rotor.translational_spring, self.rotor.torsional_spring

    def displacement(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        return jnp.broadcast_to(self.tip(q), (np.asarray(xi).size, 3))

    @abc.abstractmethod
    def place(self, q: Vector) -> Float[Array, " 2"]:
        """Cartesian displacements x, y of the particle in the hub frame."""

    def strain(self, q: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        """Stretch of the spring along the tube over its length."""
        at = self.place(q) / self.rotor.length
        excess = 2 * at[0] + at @ at
        return jnp.broadcast_to(excess / (1 + jnp.sqrt(1 + excess)), np.asarray(xi).shape)

    def curvature(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 2"]:
        """Angle of the hinge over the length: the analogue of a curvature."""
        at = self.place(q)
        angle = jnp.arctan2(at[1], self.rotor.length + at[0]) / self.rotor.length
        return jnp.broadcast_to(angle, (np.asarray(xi).size, 2)) * np.array([1.0, 0.0])

    def first_moment(self, q: Vector) -> Triple:
        return self.rotor.mass * self.tip(q)

    def kinetic_energy(self, q: Vector, v: Vector, velocity: Triple, spin: Triple) -> Scalar:
        end = jnp.zeros(3).at[0].set(self.tip_radius)
        rigid = velocity + cross(spin, end)
        more = skew(spin) @ self.tip(q) + jax.jvp(self.tip, (q,), (v,))[1]
        return self.rotor.mass * (rigid @ more + more @ more / 2)

    def damping_tangents(self, q: Vector, v: Vector, drag: Drag) -> tuple[Matrix, Matrix]:
        def force(q: Vector, v: Vector) -> Vector:
            return self.as_force(q, self.damping(q, v, drag))

        return jax.jacfwd(force, argnums=(0, 1))(q, v)


class _Cartesian(_Particle):
    """m x'' - m Omega' y - 2 m Omega y' - m Omega^2 (d + L + x) + dU/dx = 0,
    m y'' + m Omega' (d + L + x) + 2 m Omega x' - m Omega^2 y + dU/dy = 0."""

    def place(self, q: Vector) -> Float[Array, " 2"]:
        return q

    def force(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None) -> Vector:
        m, d, length = self.rotor.mass, self.rotor.hub_radius, self.rotor.length
        spin, rate = hub.angular_velocity[2], hub.angular_velocity_rate[2]
        at = jnp.stack([d + length + q[0], q[1]])
        normal, normal_rate = jnp.stack([-at[1], at[0]]), jnp.stack([-v[1], v[0]])
        inertia = rate * normal + 2 * spin * normal_rate - spin**2 * at + hub.acceleration[:2]
        out = -m * inertia - self.elastic_force(q)
        return out if tip_force is None else out + tip_force[:2]


class _Polar(_Particle):
    def place(self, q: Vector) -> Float[Array, " 2"]:
        length = self.rotor.length
        # 2 sin^2 is 1 - cos without cancellation.
        across = (length + q[0]) * jnp.sin(q[1])
        return jnp.stack([q[0] - 2 * (length + q[0]) * jnp.sin(q[1] / 2) ** 2, across])


class _ExactPolar(_Polar):
    """m s'' + m a_r + k_T s = 0, (L + s) [m (L + s) theta'' + m a_theta] + k_r theta = 0.

    With a_r = Omega' d sin - (L + s)(theta' + Omega)^2 - d Omega^2 cos, a_theta = Omega' (L + s +
    d cos) + 2 s' (theta' + Omega) + d Omega^2 sin (of theta). The second equation is divided by
    (1 + s / L)^2, so that the mass matrix is constant.
    """

    def as_force(self, q: Vector, generalised: Vector) -> Vector:
        return generalised * jnp.stack([jnp.ones_like(q[0]), (1 + q[0] / self.rotor.length) ** -2])

    def force(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None) -> Vector:
        m, d, long = self.rotor.mass, self.rotor.hub_radius, self.rotor.length + q[0]
        spin, rate = hub.angular_velocity[2], hub.angular_velocity_rate[2]
        cos, sin = jnp.cos(q[1]), jnp.sin(q[1])
        push = -m * hub.acceleration[:2]
        push = push if tip_force is None else push + tip_force[:2]
        elastic = self.elastic_force(q)
        total = v[1] + spin
        along = m * (long * total**2 + d * spin**2 * cos - rate * d * sin) - elastic[0]
        across = -m * (rate * (long + d * cos) + 2 * v[0] * total + d * spin**2 * sin)
        along = along + push[0] * cos + push[1] * sin
        across = long * (across + push[1] * cos - push[0] * sin) - elastic[1]
        return self.as_force(q, jnp.stack([along, across]))


class _LinearPolar(_Polar):
    """m s'' + m Omega' d theta - 2 m L Omega theta' - m Omega^2 (d + L + s) + k_T s = 0,
    m L^2 theta'' + m Omega' [L (L + d) + (2 L + d) s] + 2 m L Omega s'
    + (m d L Omega^2 + k_r) theta = 0."""

    @property
    def is_linear(self) -> bool:
        return True

    def force(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None) -> Vector:
        m, d, length = self.rotor.mass, self.rotor.hub_radius, self.rotor.length
        spin, rate = hub.angular_velocity[2], hub.angular_velocity_rate[2]
        push = -m * hub.acceleration[:2]
        push = push if tip_force is None else push + tip_force[:2]
        elastic = self.elastic_force(q)
        along = spin**2 * (d + length + q[0]) + 2 * length * spin * v[1] - rate * d * q[1]
        across = rate * (length * (length + d) + (2 * length + d) * q[0])
        across = across + 2 * length * spin * v[0] + d * length * spin**2 * q[1]
        # Generalised forces, by s and theta, of a force along x and y, to first order in both.
        pull = push[0] + push[1] * q[1], length * (push[1] - push[0] * q[1]) + push[1] * q[0]
        return jnp.stack([m * along + pull[0], pull[1] - m * across]) - elastic

    def place(self, q: Vector) -> Float[Array, " 2"]:
        """Displacements x, y to second order, with which the kinetic energy gives the linear
        equations."""
        length = self.rotor.length
        return jnp.stack([q[0] - length * q[1] ** 2 / 2, (length + q[0]) * q[1]])

    def displacement(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        """Displacement by the exact x, y of s, theta, as in Y."""
        at = jnp.concatenate([super().place(q), jnp.zeros(1)])
        return jnp.broadcast_to(at, (np.asarray(xi).size, 3))

    def first_moment(self, q: Vector) -> Triple:
        return self.rotor.mass * jnp.concatenate([self.place(q), jnp.zeros(1)])

    def kinetic_energy(self, q: Vector, v: Vector, velocity: Triple, spin: Triple) -> Scalar:
        """Kinetic energy to second order in s, theta and their rates."""
        m, length = self.rotor.mass, self.rotor.length
        end = jnp.zeros(3).at[0].set(self.tip_radius)
        rigid = velocity + cross(spin, end)
        flat, none = jnp.array([1.0, length]), jnp.zeros(1)
        more = skew(spin) @ jnp.concatenate([flat * q, none]) + jnp.concatenate([flat * v, none])
        at, moving = jax.jvp(self.place, (q,), (v,))
        whole = skew(spin) @ jnp.concatenate([at, none]) + jnp.concatenate([moving, none])
        return m * (rigid @ whole + more @ more / 2)


def _particle(kind: type[_Particle], rotor: SpringRotor, strains: StrainLaw) -> _Particle:
    one, end = jnp.ones_like(rotor.length), rotor.hub_radius + rotor.length
    arm = rotor.length if issubclass(kind, _Polar) else one  # metres across per unit of q_2
    return kind(
        mass=rotor.mass * jnp.diag(jnp.stack([one, arm**2])),
        rigid_moments=rotor.mass * jnp.stack([one, end, end**2]),
        length=rotor.length,
        tip_radius=end,
        energy_scale=rotor.torsional_spring,
        rotor=rotor,
        strains=strains,
    )


def _exact(rotor: SpringRotor, q: Vector) -> tuple[Scalar, Scalar]:
    length = rotor.length
    excess = (2 * q[0] * length + q @ q) / length**2
    stretch = length * excess / (1 + jnp.sqrt(1 + excess))
    return stretch, jnp.arctan2(q[1], length + q[0])


def _quadratic(rotor: SpringRotor, q: Vector) -> tuple[Scalar, Scalar]:
    return q[0], q[1] / rotor.length


def _second_degree(rotor: SpringRotor, q: Vector) -> tuple[Scalar, Scalar]:
    return q[0] + q[1] ** 2 / (2 * rotor.length), q[1] / rotor.length


def _polar(rotor: SpringRotor, q: Vector) -> tuple[Scalar, Scalar]:
    return q[0], q[1]


class DiscreteNC(_Discrete):
    """The discrete analogue, exact in x, y.

    U = k_T (|r| - L)^2 / 2 + k_r atan(y / (L + x))^2 / 2.
    """

    def equations(self, rotor: SpringRotor) -> _Particle:
        """Equations in the coordinates x, y, in m."""
        return _particle(_Cartesian, rotor, _exact)


class DiscreteLC(_Discrete):
    """The discrete analogue, linear in x, y.

    Unstable above Omega = sqrt(k_r / m) / L, whatever d is.
    """

    is_linear = True

    def equations(self, rotor: SpringRotor) -> _Particle:
        """Equations in the coordinates x, y, in m."""
        return _particle(_Cartesian, rotor, _quadratic)


class DiscreteNS(_Discrete):
    """The discrete analogue with the stretch x + y^2 / (2 L).

    U = k_T (x + y^2 / (2 L))^2 / 2 + k_r (y / L)^2 / 2.
    """

    def equations(self, rotor: SpringRotor) -> _Particle:
        """Equations in the coordinates x, y, in m."""
        return _particle(_Cartesian, rotor, _second_degree)


class DiscreteNP(_Discrete):
    """The discrete analogue, exact in s, theta; the same motion as `DiscreteNC`."""

    def equations(self, rotor: SpringRotor) -> _Particle:
        """Equations in the coordinates s, in m, and theta, in rad."""
        return _particle(_ExactPolar, rotor, _polar)


class DiscreteLP(_Discrete):
    """The discrete analogue, linear in s, theta: stiffens with speed as it must."""

    is_linear = True

    def equations(self, rotor: SpringRotor) -> _Particle:
        """Equations in the coordinates s, in m, and theta, in rad."""
        return _particle(_LinearPolar, rotor, _polar)
