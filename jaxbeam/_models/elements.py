"""Planar cubic elements in absolute nodal coordinates, at a cost linear in their number.

An element has the displacement and slope of its two nodes, along and across the beam, for local
coordinates e, shape (8,), with r' = a1 + S' e. Inertia is that of any beam on a moving hub (see
`cartesian.py`), element by element, with the constant mass matrix H = int N N^T; elastic forces do
not care in which frame they are written. Coordinates go node by node, (u, w, L w', L u'), so that
all matrices are block-tridiagonal; of the clamped node only the last is free (B eqs. 18-20):
4 n + 1 coordinates for n elements, all in metres.

What sets theories apart is the axial strain, with d = r' - a1 the displacement gradient:

    Model A        eps_A (1-4s+3s^2) + eps_M (6s-6s^2) + eps_B (3s^2-2s) of B eq. A-3, and forces
                   int EA eps S'^T r' dx that are not the gradient of an energy
    Green          d_1 + d.d / 2, forces from int [EA eps^2 + EI r''.r''] dx / 2
    Model 0        t.r' - 1 and curvature n.r'' in a frame that moves with the element
"""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._basis import Functions, hermite
from jaxbeam._beam import Rotor
from jaxbeam._blocks import BlockTridiagonal
from jaxbeam._models.base import Equations, rigid_moments
from jaxbeam._motion import Hub
from jaxbeam._types import Scalar, Triple, Vector

Local = Float[Array, " 8"]  # coordinates of an element, over L: (u, w, w', u') of both ends
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)  # exact to degree 9: eps^2 of Green has 8
_POINTS, _WEIGHTS = (1 + _POINTS) / 2, _WEIGHTS / 2
# Of the coordinates of an element: which of the four shapes, and which way it moves.
_SHAPE, _WAY = np.array([0, 0, 1, 1, 2, 2, 3, 3]), np.array([0, 1, 1, 0, 0, 1, 1, 0])
_A1 = np.array([[1.0, 0.0]])


def _spread(table: np.ndarray) -> np.ndarray:
    """From values of the four shapes (p, 4) to those of both components (p, 2, 8)."""
    return table[:, None, _SHAPE] * (np.arange(2)[:, None] == _WAY)


class Element(eqx.Module):
    """Elastic energy, force and tangent of an element, over EA L and with lengths over L.

    Everything is a product of the local coordinates with a constant matrix, a few operations at
    the Gauss points, and another product: many elements, and many cases, make one large product.
    """

    is_conservative: ClassVar[bool] = True  # whether `force` is the gradient of `energy`
    bending: Scalar  # EI / (EA L^2)
    n_elements: int = eqx.field(static=True)

    @abc.abstractmethod
    def energy(self, e: Local) -> Scalar:
        """Strain energy of one element."""

    def force(self, e: Local) -> Local:
        """Elastic force of one element."""
        return jax.grad(self.energy)(e)

    def tangent(self, e: Local) -> Float[Array, "8 8"]:
        """d force / de."""
        return jax.jacfwd(self.force)(e)

    def strain(self, gradient: Float[Array, "p 2"]) -> Float[Array, " p"]:
        """Axial strain where the displacement gradient is this."""
        return elongation(gradient)

    @property
    def weights(self) -> np.ndarray:
        """Of the Gauss points."""
        return _WEIGHTS / self.n_elements

    @property
    def slopes(self) -> np.ndarray:
        """Displacement gradient at the Gauss points per local coordinate (g, 2, 8)."""
        return _spread(hermite(_POINTS, 1 / self.n_elements).slope)

    @property
    def curvatures(self) -> np.ndarray:
        """r'' at the Gauss points per local coordinate (g, 2, 8)."""
        return _spread(hermite(_POINTS, 1 / self.n_elements).curvature)


def elongation(d: Float[Array, "... c"]) -> Float[Array, "..."]:
    """|a1 + d| - 1, without cancellation."""
    excess = 2 * d[..., 0] + jnp.sum(d**2, -1)
    return excess / (1 + jnp.sqrt(1 + excess))


def _at(table: np.ndarray, e: Local) -> Float[Array, "p 2"]:
    """table (p, 2, 8) times e, as one product."""
    return jnp.reshape(table.reshape(-1, 8) @ e, (-1, 2))


class Continuum(Element):
    """U = int EA eps^2 + EI r''.r'' dx / 2 and forces int EA eps S'^T r' + EI S''^T r'' dx.

    The strain is interpolated from `stations`, where it depends on the displacement gradient. The
    forces are the gradient of U where eps is the Green strain, d eps = S'^T r' . de.
    """

    @property
    @abc.abstractmethod
    def stations(self) -> np.ndarray:
        """Displacement gradients at the stations per local coordinate (k, 2, 8)."""

    @abc.abstractmethod
    def interpolated(self, values: Any) -> Any:
        """From values at the stations (k, ...) to those at the Gauss points (g, ...)."""

    @abc.abstractmethod
    def measure(self, d: Any) -> tuple[Float[Array, " k"], Float[Array, "k 2"]]:
        """Strain at the stations of d (k, 2), and its derivative by d."""

    def energy(self, e: Local) -> Scalar:
        """B eq. 9."""
        bend = jnp.sum(_at(self.curvatures, e) ** 2, 1)
        strain = self.interpolated(self.measure(_at(self.stations, e))[0])
        return jnp.sum(self.weights * (strain**2 + self.bending * bend)) / 2

    def force(self, e: Local) -> Local:
        """(K_l + K_t) e of B eqs. 10 and A-5, where A-6 and A-7 are misprinted."""
        tension = self.weights * self.interpolated(self.measure(_at(self.stations, e))[0])
        pull = tension[:, None] * (_at(self.slopes, e) + _A1)
        return self.slopes.reshape(-1, 8).T @ pull.reshape(-1) + self.bending * (self.bend @ e)

    @property
    def bend(self) -> np.ndarray:
        """int S''^T S'' dx."""
        return np.einsum("g,gci,gcj->ij", self.weights, self.curvatures, self.curvatures)

    def tangent(self, e: Local) -> Float[Array, "8 8"]:
        slopes = self.slopes
        strain, direction = self.measure(_at(self.stations, e))
        gradient = self.interpolated(jnp.sum(self.stations * direction[:, :, None], 1))
        pull = jnp.sum(slopes * (_at(slopes, e) + _A1)[:, :, None], 1)
        material = jnp.sum(self.weights[:, None, None] * pull[:, :, None] * gradient[:, None], 0)
        each = np.einsum("g,gci,gcj->gij", self.weights, slopes, slopes).reshape(-1, 64)
        geometric = (self.interpolated(strain) @ each).reshape(8, 8)
        return material + geometric + self.bending * self.bend


class ModelA(Continuum):
    """B eq. A-3: stations are the first end, the chord and the last end."""

    is_conservative = False

    @property
    def stations(self) -> np.ndarray:
        n = self.n_elements
        return _spread(np.array([[0, 1, 0, 0], [-n, 0, n, 0], [0, 0, 0, 1.0]]))

    def interpolated(self, values: Any) -> Any:
        s = _POINTS
        weight = np.stack([1 - 4 * s + 3 * s**2, 6 * s - 6 * s**2, 3 * s**2 - 2 * s], 1)
        return weight @ values

    def measure(self, d: Any) -> tuple[Float[Array, " k"], Float[Array, "k 2"]]:
        strain = elongation(d)
        return strain, (d + _A1) / (1 + strain)[:, None]


class Green(Continuum):
    """Green strain; stations are the Gauss points."""

    @property
    def stations(self) -> np.ndarray:
        return self.slopes

    def interpolated(self, values: Any) -> Any:
        return values

    def measure(self, d: Any) -> tuple[Float[Array, " k"], Float[Array, "k 2"]]:
        return self.strain(d), d + _A1

    def strain(self, gradient: Float[Array, "p 2"]) -> Float[Array, " p"]:
        return gradient[:, 0] + jnp.sum(gradient**2, 1) / 2


class ModelZero(Element):
    """Linear strain du_l/dx and curvature in a frame that moves with the element (B eq. 62)."""

    @abc.abstractmethod
    def along(self, e: Local) -> Float[Array, " 2"]:
        """Tangent of the frame, less a1, before it is made a unit vector."""

    def energy(self, e: Local) -> Scalar:
        axis = self.along(e)
        size = 1 + elongation(axis)
        # t.r' - 1 = (t - a1).r' + d_1, both small, so that nothing cancels.
        lean = (axis - (size - 1) * _A1[0]) / size
        tangent = lean + _A1[0]
        d = _at(self.slopes, e)
        strain = (d + _A1) @ lean + d[:, 0]
        bend = _at(self.curvatures, e) @ jnp.stack([-tangent[1], tangent[0]])
        return jnp.sum(self.weights * (strain**2 + self.bending * bend**2)) / 2


class Chord(ModelZero):
    """From one end to the other."""

    def along(self, e: Local) -> Float[Array, " 2"]:
        return (e[4:6] - e[:2]) * self.n_elements


class Tangent(ModelZero):
    """Of the first end."""

    def along(self, e: Local) -> Float[Array, " 2"]:
        return e[3:1:-1]


class ElementEquations(Equations):
    """Elements of any theory on a moving hub, with a mass at the tip.

    The plane's fields r, r' and r'' are all fields of these elements, rigid rotation included. So
    inertia forces are the mass matrix of all nodes, the clamped one too, times the nodal values of

        q'' + a_O - omega^2 r + (omega' r + 2 omega r' turned by a right angle),   r = X a1 + u.
    """

    mass: BlockTridiagonal
    rigid: Triple
    size: Scalar
    end: Scalar
    energy_scale: Scalar
    straight: Float[Array, "k 4"]  # nodal values of X a1
    element_mass: Scalar
    tip_mass: Scalar
    axial_stiffness: Scalar
    element: Element

    def __init__(self, rotor: Rotor, n_elements: int, element: type[Element]) -> None:
        beam = rotor.beam
        radius, length = rotor.hub_radius, beam.length
        self.size, self.end, self.rigid = length, radius + length, rigid_moments(rotor)
        self.element_mass, self.tip_mass = beam.mass / n_elements, rotor.tip_mass
        self.axial_stiffness = beam.axial_stiffness
        self.energy_scale = beam.in_plane_bending_stiffness / length
        along = radius + length * np.linspace(0.0, 1.0, n_elements + 1)
        still = jnp.zeros_like(along)
        self.straight = jnp.stack([along, still, still, length + still], 1)
        ratio = beam.in_plane_bending_stiffness / (beam.axial_stiffness * length**2)
        self.element = element(ratio, n_elements)
        self.mass = self._inertial(jnp.ones_like(length), jnp.zeros_like(length))

    def force(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None) -> Vector:
        spin, rate = hub.angular_velocity[2], hub.angular_velocity_rate[2]
        place = self.straight + self._nodes(q)
        field = _turned(rate * place + 2 * spin * self._nodes(v)) - spin**2 * place
        field = field + jnp.pad(hub.acceleration[:2], (0, 2))[None]
        own = self._elastic(q) + self.element_mass * (_local(field) @ self._gram)
        at_tip = self.tip_mass * field
        if tip_force is not None:
            at_tip = at_tip - jnp.pad(tip_force[:2], (0, 2))[None]
        return -_gathered(own, at_tip)

    def tangents(
        self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None
    ) -> tuple[BlockTridiagonal, BlockTridiagonal]:
        spin, rate = hub.angular_velocity[2], hub.angular_velocity_rate[2]
        k = self._inertial(-(spin**2), rate) + self.elastic_tangent(q)
        return k, self._inertial(jnp.zeros_like(spin), 2 * spin)

    def _inertial(self, straight: Scalar, turned: Scalar) -> BlockTridiagonal:
        """Mass matrix times `straight` + `turned` times a turn by a right angle."""
        gram = self.element_mass * self._gram
        local = straight * gram + turned * (gram @ _turned(np.eye(8)).T)
        at_tip = straight * np.eye(2) + turned * np.array([[0.0, -1.0], [1.0, 0.0]])
        return _assembled(
            jnp.broadcast_to(local, (self.element.n_elements, 8, 8)), self.tip_mass * at_tip
        )

    def elastic_tangent(self, q: Vector) -> BlockTridiagonal:
        local = jax.vmap(self.element.tangent)(self._shares(q))
        return _assembled(self.axial_stiffness / self.size * local, jnp.zeros((2, 2)))

    def elastic_force(self, q: Vector) -> Vector:
        return _gathered(self._elastic(q), jnp.zeros((1, 4)))

    def _elastic(self, q: Vector) -> Float[Array, "n 8"]:
        """Of every element."""
        return self.axial_stiffness * jax.vmap(self.element.force)(self._shares(q))

    def strain_energy(self, q: Vector) -> Scalar:
        energy = jnp.sum(jax.vmap(self.element.energy)(self._shares(q)))
        return self.axial_stiffness * self.size * energy

    def nonconservative_force(self, q: Vector) -> Vector:
        if self.element.is_conservative:
            return jnp.zeros_like(q)
        return self.elastic_force(q) - jax.grad(self.strain_energy)(q)

    def kinetic_energy(self, q: Vector, v: Vector, velocity: Triple, spin: Triple) -> Scalar:
        """int |a + b|^2 - |a|^2 dm / 2, a = v + omega x X a1 and b = omega x u + u'."""
        own = self._nodes(v) + spin[2] * _turned(self._nodes(q))
        carried = spin[2] * _turned(self.straight) + jnp.pad(velocity[:2], (0, 2))[None]
        return self._product(own, own / 2 + carried)

    def first_moment(self, q: Vector) -> Triple:
        nodes = self._nodes(q)
        x, y = (jnp.broadcast_to(np.eye(4)[i], nodes.shape) for i in range(2))
        zero = jnp.zeros_like(self.size)
        return jnp.stack([self._product(x, nodes), self._product(y, nodes), zero])

    def _product(self, a: Float[Array, "k 4"], b: Float[Array, "k 4"]) -> Scalar:
        """int a . b dm of two fields."""
        own = jnp.sum(_local(a) * (_local(b) @ self._gram))
        return self.element_mass * own + self.tip_mass * (a[-1, :2] @ b[-1, :2])

    @property
    def _gram(self) -> np.ndarray:
        """int N^T N over an element of unit mass (8, 8)."""
        value = _spread(hermite(_POINTS, 1 / self.element.n_elements).value)
        return np.einsum("g,gci,gcj->ij", _WEIGHTS, value, value)

    def tip(self, q: Vector) -> Triple:
        return jnp.pad(q[-4:-2], (0, 1))

    def displacement(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        """Of the cubic in the element where a point is."""
        shapes, local = self._around(q, xi)
        return jnp.pad(jnp.sum(shapes.value * local, 2), ((0, 0), (0, 1)))

    def strain(self, q: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        return self.element.strain(self.gradient(q, xi))

    def gradient(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 2"]:
        """Displacement gradient d = r' - a1 at x = xi L."""
        shapes, local = self._around(q, xi)
        return jnp.sum(shapes.slope * local, 2) / self.size

    def curvature(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 2"]:
        shapes, local = self._around(q, xi)
        bend = jnp.sum(shapes.curvature[:, 1:] * local, 2) / self.size**2
        return jnp.pad(bend, ((0, 0), (0, 1)))

    def _around(self, q: Vector, xi: np.ndarray) -> tuple[Functions, Float[Array, "p 1 8"]]:
        """Shapes at points, (p, 2, 8), and coordinates of the elements where they are."""
        xi, n = np.asarray(xi, float), self.element.n_elements
        index = np.clip((xi * n).astype(int), 0, n - 1)
        shapes = Functions(*map(_spread, hermite(xi * n - index, 1 / n)))
        return shapes, _local(self._nodes(q))[index][:, None]

    def _shares(self, q: Vector) -> Float[Array, "n 8"]:
        """Coordinates of every element over the length."""
        return _local(self._nodes(q)) / self.size

    def _nodes(self, q: Vector) -> Float[Array, "k 4"]:
        """Nodal values (u, w, L w', L u'), in m, those of the clamped node included."""
        return jnp.pad(q, (3, 0)).reshape(-1, 4)


def _local(nodes: Float[Array, "k 4"]) -> Float[Array, "n 8"]:
    """Of every element."""
    return jnp.concatenate([nodes[:-1], nodes[1:]], 1)


def _turned(nodes: Any) -> Any:
    """A field turned by a right angle: a1 becomes a2, a2 becomes -a1."""
    width = nodes.shape[1]
    return nodes[:, np.arange(width) ^ 1] * np.tile([-1.0, 1.0, 1.0, -1.0], width // 4)[None]


def _gathered(local: Float[Array, "n 8"], at_tip: Float[Array, "#k 4"]) -> Vector:
    """Sum of what elements do at nodes, and of `at_tip` at the last one."""
    first = jnp.pad(local[:, :4], ((0, 1), (0, 0)))
    last = jnp.pad(local[:, 4:], ((1, 0), (0, 0)))
    tip = np.zeros((len(local) + 1, 4))
    tip[-1, :2] = 1.0
    return (first + last + tip * at_tip).reshape(-1)[3:]


def _assembled(local: Float[Array, "n 8 8"], at_tip: Float[Array, "2 2"]) -> BlockTridiagonal:
    first = jnp.pad(local[:, :4], ((0, 1), (0, 0), (4, 0)))
    last = jnp.pad(local[:, 4:], ((1, 0), (0, 0), (0, 4)))
    return BlockTridiagonal((first + last).at[-1, :2, 4:6].add(at_tip), absent=3)
