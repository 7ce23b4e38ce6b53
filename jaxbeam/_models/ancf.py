"""Absolute nodal coordinates of Berzeri and Shabana (B): planar cubic cable elements.

In the frame that turns with the hub the element reads M q'' + 2 W J M q' + (W' J - W^2) M (q + q_R)
+ Q(q) = 0, exactly and with constant M, because elastic forces do not care in which frame they are
written. At the root r = (R, 0) and r' is parallel to the beam; the axial slope stays free (B eqs.
18-20): 4 n + 1 coordinates for n elements. Coordinates are in metres, node by node the axial
displacement and L times the axial slope (without the first displacement), then the same in plane
(without displacement and slope of the first node). The slopes e_3, e_4, e_7, e_8 of B are these
divided by L, plus one along the beam.

What sets the models apart is the axial strain, with d = r' - a1 the displacement gradient:

    ANCF           eps_A (1-4s+3s^2) + eps_M (6s-6s^2) + eps_B (3s^2-2s) of B eq. A-3, and forces
                   int EA eps S'^T r' dx that are not the gradient of an energy (Model A)
    GreenANCF      d_1 + d.d / 2, forces from int [EA eps^2 + EI r''.r''] dx / 2
    ChordANCF      t.r' - 1 and curvature n.r'' in the frame of the element's chord (Model 0)
    TangentANCF    the same in a frame tangent to the element's first node (Model 0)
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._basis import HermiteElements, hermite, stretch_integrals
from jaxbeam._beam import Rotor
from jaxbeam._linalg import find_root
from jaxbeam._models.base import LinearSystem, count_functions
from jaxbeam._models.cartesian import (
    CartesianEquations,
    CartesianModel,
    Elasticity,
    LinearElasticity,
    linear_system,
)
from jaxbeam._motion import spinning
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Matrix, Real, Scalar, Vector

Nodes = Float[Array, "4 2"]  # of an element: displacement and slope of its two ends, over L
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)  # exact to degree 9: eps^2 of Green has 8
_POINTS, _WEIGHTS = (1 + _POINTS) / 2, _WEIGHTS / 2


class _ANCF(CartesianModel):
    n_elements: int = eqx.field(static=True, default=10)

    def __check_init__(self) -> None:
        count_functions("n_elements", self.n_elements, least=1)

    @property
    def functions_from(self) -> HermiteElements:
        return HermiteElements(self.n_elements)

    @property
    def counts(self) -> tuple[int, int, int]:
        return 2 * self.n_elements + 1, 2 * self.n_elements, 0

    @abc.abstractmethod
    def equations(self, rotor: Rotor) -> CartesianEquations: ...

    def steady_state(self, rotor: Rotor, angular_speed: Real) -> Array:
        """Axial coordinates (2 n + 1, in metres) of the steady state; the beam stays straight.

        Differentiable to any order by the implicit function theorem. Raises if the search fails.
        """
        return raise_unless_ok(*_jitted_steady_state(self, *self.steady_case(rotor, angular_speed)))

    def _steady_state(self, rotor: Rotor, speed: Scalar) -> tuple[Array, Code]:
        # In the axial coordinates alone, and over EA, unknowns are of order one.
        equations, hub = self.equations(rotor), spinning(speed)
        n, length = 2 * self.n_elements + 1, rotor.beam.length
        straight = jnp.zeros(2 * self.n_elements, speed.dtype)
        zero = jnp.zeros(len(self.families), speed.dtype)
        slope = equations._at(self.functions_from.quadrature(n)[0]).slope[:, :n]

        def residual(u: Array, fraction: Array | float = 1.0) -> Array:
            part = hub._replace(angular_velocity=jnp.sqrt(fraction) * hub.angular_velocity)
            q = jnp.concatenate([length * u, straight])
            return -equations.force(part, q, zero, None)[:n] / rotor.beam.axial_stiffness

        u, done = find_root(
            residual, jnp.zeros(n, speed.dtype), lambda u: jnp.all(slope @ u > -0.5)
        )
        return u * length, jnp.where(done < 1, Status.NOT_CONVERGED, Status.OK)

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        """Tangents about the straight steady state (B eqs. 53-54, without small strain)."""
        u, status = self._steady_state(rotor, speed)
        equations = self.equations(rotor)
        q = jnp.concatenate([u, jnp.zeros(2 * self.n_elements, u.dtype)])
        k, c = equations.tangents(spinning(speed), q, jnp.zeros_like(q), None)
        return LinearSystem(
            mass=equations.mass,
            gyroscopic=c,
            stiffness=(k + k.T) / 2,
            steady_strain=equations.strain(q, np.zeros(1))[0],
            status=status,
            families=self.families,
        )


class _Elements(Elasticity):
    """Elastic forces element by element; everything over EA L, lengths over L."""

    axial_stiffness: Scalar
    length: Scalar
    bending: Scalar  # EI / (EA L^2)
    n_elements: int = eqx.field(static=True)

    def energy(self, q: Vector) -> Scalar:
        scale = self.axial_stiffness * self.length
        return scale * jnp.sum(jax.vmap(self.element_energy)(self._nodes(q)))

    def force(self, q: Vector) -> Vector:
        return self.axial_stiffness * self._gather(jax.vmap(self.element_force)(self._nodes(q)))

    def tangent(self, q: Vector) -> Matrix:
        blocks = jax.vmap(jax.jacfwd(self.element_force))(self._nodes(q))
        n = self.n_elements
        place = 2 * np.arange(n)[:, None] + np.arange(4)  # of an element's functions
        rows = place[:, :, None, None, None] + (2 * n + 2) * np.arange(2)[:, None, None]
        columns = place[:, None, None, :, None] + (2 * n + 2) * np.arange(2)
        whole = jnp.zeros((4 * n + 4, 4 * n + 4), q.dtype).at[rows, columns].add(blocks)
        free = np.delete(np.arange(4 * n + 4), [0, 2 * n + 2, 2 * n + 3])
        return self.axial_stiffness / self.length * whole[np.ix_(free, free)]

    @abc.abstractmethod
    def element_energy(self, e: Nodes) -> Scalar:
        """Strain energy of one element."""

    def element_force(self, e: Nodes) -> Nodes:
        """Elastic force of one element."""
        return jax.grad(self.element_energy)(e)

    def strain(self, gradient: Float[Array, "p 3"]) -> Float[Array, " p"]:
        return _elongation(gradient)

    def _nodes(self, q: Vector) -> Float[Array, "n 4 2"]:
        n = self.n_elements
        full = jnp.concatenate([jnp.zeros(1), q[: 2 * n + 1], jnp.zeros(2), q[2 * n + 1 :]])
        node = (full / self.length).reshape(2, n + 1, 2).transpose(1, 2, 0)
        return jnp.concatenate([node[:-1], node[1:]], 1)

    def _gather(self, forces: Float[Array, "n 4 2"]) -> Vector:
        n, none = self.n_elements, jnp.zeros((1, 2, 2), forces.dtype)
        node = jnp.concatenate([forces[:, :2], none]) + jnp.concatenate([none, forces[:, 2:]])
        full = node.transpose(2, 0, 1).reshape(-1)
        return jnp.concatenate([full[1 : 2 * n + 2], full[2 * n + 4 :]])

    @property
    def _shapes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slopes and curvatures of the four shapes at the Gauss points, and weights."""
        shapes = hermite(_POINTS, 1 / self.n_elements)
        return shapes.slope, shapes.curvature, _WEIGHTS / self.n_elements


def _elongation(d: Float[Array, "... c"]) -> Float[Array, "..."]:
    """|a1 + d| - 1, without cancellation."""
    excess = 2 * d[..., 0] + jnp.sum(d**2, -1)
    return excess / (1 + jnp.sqrt(1 + excess))


class _Continuum(_Elements):
    """U = int EA eps^2 + EI r''.r'' dx / 2 and forces int EA eps S'^T r' + EI S''^T r'' dx.

    The forces are the gradient of U where eps is the Green strain, d eps = S'^T r' . de.
    """

    @abc.abstractmethod
    def element_strain(self, e: Nodes) -> Float[Array, " g"]:
        """Axial strain at the Gauss points."""

    def element_energy(self, e: Nodes) -> Scalar:
        """B eq. 9."""
        _, curvature, weight = self._shapes
        bend = jnp.sum((curvature @ e) ** 2, 1)
        return jnp.sum(weight * (self.element_strain(e) ** 2 + self.bending * bend)) / 2

    def element_force(self, e: Nodes) -> Nodes:
        """(K_l + K_t) e of B eqs. 10 and A-5, where A-6 and A-7 are misprinted."""
        slope, curvature, weight = self._shapes
        tension = (weight * self.element_strain(e))[:, None]
        along = slope @ e + np.eye(2)[:1]
        bend = self.bending * weight[:, None] * (curvature @ e)
        return slope.T @ (tension * along) + curvature.T @ bend


class _ModelA(_Continuum):
    def element_strain(self, e: Nodes) -> Float[Array, " g"]:
        chord = (e[2] - e[0]) * self.n_elements
        a, m, b = _elongation(jnp.stack([e[1], chord, e[3]]))
        s = _POINTS
        return a * (1 - 4 * s + 3 * s**2) + m * (6 * s - 6 * s**2) + b * (3 * s**2 - 2 * s)

    def nonconservative_force(self, q: Vector) -> Vector:
        return self.force(q) - jax.grad(self.energy)(q)


class _Green(_Continuum):
    def element_strain(self, e: Nodes) -> Float[Array, " g"]:
        return self.strain(jnp.asarray(self._shapes[0] @ e))

    def strain(self, gradient: Float[Array, "p c"]) -> Float[Array, " p"]:
        return gradient[:, 0] + jnp.sum(gradient**2, 1) / 2


class _ModelZero(_Elements):
    """Linear strain du_l/dx and curvature in a frame that moves with the element (B eq. 62)."""

    @abc.abstractmethod
    def along(self, e: Nodes) -> Float[Array, " 2"]:
        """Tangent of the frame, less a1, before it is made a unit vector."""

    def element_energy(self, e: Nodes) -> Scalar:
        slope, curvature, weight = self._shapes
        axis = self.along(e)
        size = 1 + _elongation(axis)
        # t.r' - 1 = (t - a1).r' + d_1, both small, so that nothing cancels.
        lean = (axis - (size - 1) * np.eye(2)[0]) / size
        tangent = lean + np.eye(2)[0]
        d = slope @ e
        strain = (d + np.eye(2)[:1]) @ lean + d[:, 0]
        bend = (curvature @ e) @ jnp.stack([-tangent[1], tangent[0]])
        return jnp.sum(weight * (strain**2 + self.bending * bend**2)) / 2


class _Chord(_ModelZero):
    def along(self, e: Nodes) -> Float[Array, " 2"]:
        return (e[2] - e[0]) * self.n_elements


class _Tangent(_ModelZero):
    def along(self, e: Nodes) -> Float[Array, " 2"]:
        return e[1]


def _equations(model: _ANCF, rotor: Rotor, elasticity: type[_Elements]) -> CartesianEquations:
    beam = rotor.beam
    ratio = beam.in_plane_bending_stiffness / (beam.axial_stiffness * beam.length**2)
    elastic = elasticity(beam.axial_stiffness, beam.length, ratio, model.n_elements)
    return CartesianEquations.build(model, rotor, elastic)


class GreenANCF(_ANCF):
    """Continuum element with an energy: Green strain, U = int EA eps^2 + EI r''.r'' dx / 2."""

    def equations(self, rotor: Rotor) -> CartesianEquations:
        """Conservative, geometrically non-linear."""
        return _equations(self, rotor, _Green)


class ChordANCF(_ANCF):
    """Model 0 of B in the frame of each element's chord: unstable above a speed that grows with
    the number of elements."""

    def equations(self, rotor: Rotor) -> CartesianEquations:
        """Conservative; linear strain within an element."""
        return _equations(self, rotor, _Chord)


class TangentANCF(_ANCF):
    """Model 0 of B in a frame tangent to each element's first node: clamped-free substructures.

    Fails at a lower speed than `ChordANCF`, and is far too stiff with few elements: neighbours
    measure strain along different directions. With one element it is `Classical`.
    """

    def equations(self, rotor: Rotor) -> CartesianEquations:
        """Conservative; linear strain within an element."""
        return _equations(self, rotor, _Tangent)


class SmallStrainANCF(_ANCF):
    """Model A linearised as in B, section 5: the model of B Tables 2-5.

    The steady strain is the *linear* one of B eqs. 41-43, eps = P / EA, found on the undeformed
    beam. It is wrong by about eps relative, so believe the numbers while `steady_strain` is small;
    `ANCF` says what they become. The tension acts on transverse displacement and, twice, on axial
    displacement (one EA eps is its own, the other is B eq. 52 evaluated with q_0).
    """

    def equations(self, rotor: Rotor) -> CartesianEquations:
        """Linear, with the tension P(x) of the rigid motion."""
        elastic = LinearElasticity(self.linear_stiffness(rotor) + axial_bending(self, rotor))
        tension = self.tables.tension + 2 * self.tables.axial_tension
        return CartesianEquations.build(self, rotor, elastic, tension)

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        """Mass, gyroscopic and stiffness matrices (B eqs. 53-54)."""
        return linear_system(self, rotor, speed)


def axial_bending(model: _ANCF, rotor: Rotor) -> Matrix:
    """int EI u1'' u1'' dx: elements with EI r''.r'' have it on their axial coordinates too."""
    beam, n = rotor.beam, model.counts[0]
    out = np.zeros((len(model.families),) * 2)
    out[:n, :n] = stretch_integrals(model.functions_from, n).curvature
    return beam.in_plane_bending_stiffness / beam.length**3 * out


class ANCF(_ANCF):
    """Model A of B: axial strain interpolated along the element from B eq. A-3.

    The steady beam is straight. There u' is quadratic along an element and equals the interpolated
    strain, so the tangent is that of any non-linear strain to first order, and symmetric.
    """

    def equations(self, rotor: Rotor) -> CartesianEquations:
        """Geometrically non-linear; not conservative, see `Equations.nonconservative_force`."""
        return _equations(self, rotor, _ModelA)


@eqx.filter_jit
def _jitted_steady_state(model: _ANCF, rotor: Rotor, speed: Scalar) -> tuple[Array, Code]:
    return model._steady_state(rotor, speed)
