"""Planar cubic elements in absolute nodal coordinates, at a cost linear in their number.

An element has the displacement and slope of its two nodes, across and along the beam, for local
coordinates e, with r' = a1 + S' e. Inertia is that of any beam on a moving hub (see
`cartesian.py`), element by element, with the constant mass matrix H = int N N^T; elastic forces do
not care in which frame they are written. Coordinates go node by node, (w, L w', u, L u'), so that
all matrices are block-tridiagonal; of the clamped node only the last is free (B eqs. 18-20):
4 n + 1 coordinates for n elements, all in metres.

What sets theories apart is the axial strain, with d = r' - a1 the displacement gradient:

    Model A        eps_A (1-4s+3s^2) + eps_M (6s-6s^2) + eps_B (3s^2-2s) of B eq. A-3, and forces
                   int EA eps S'^T r' dx that are not the gradient of an energy
    Green          d_1 + d.d / 2, forces from int [EA eps^2 + EI r''.r''] dx / 2
    Model 0        t.r' - 1 and curvature n.r'' in a frame that moves with the element

In what follows vectors have their components in the order a2, a1, and any array may have further
axes, of lanes, behind those it is said to have (see `kernel`).
"""

import abc
import functools
from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._basis import Functions, hermite
from jaxbeam._beam import Rotor
from jaxbeam._blocks import BlockTridiagonal, padded
from jaxbeam._kernel import beside, contract, total
from jaxbeam._models.base import Equations, rigid_moments
from jaxbeam._motion import Hub
from jaxbeam._types import Scalar, Triple, Vector

Local = Float[Array, "2 4 *lanes"]  # over L: value and L times slope at either end
Nodes = Float[Array, "k 2 2 *lanes"]  # in m: value and L times slope
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)  # exact to degree 9: eps^2 of Green has 8
_POINTS, _WEIGHTS = (1 + _POINTS) / 2, _WEIGHTS / 2
_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])  # by a right angle: a1 becomes a2, a2 becomes -a1


def _of(table: Float[np.ndarray, "a b"], x: Float[Array, "c b *lanes"]) -> Array:
    """sum_b table_ab x_cb."""
    lanes = x.ndim - 2
    return contract(beside(table[None], lanes), x[:, None], 2, lanes)


def _integral(weights: np.ndarray, x: Float[Array, "g *lanes"]) -> Scalar:
    return _of(weights[None], x[None])[0, 0]


def _stretched(d: Float[Array, "2 *lanes"]) -> Array:
    """a1 + d."""
    return jnp.stack([d[0], 1 + d[1]])


def elongation(d: Float[Array, "2 *lanes"]) -> Scalar:
    """|a1 + d| - 1, without cancellation."""
    excess = 2 * d[1] + d[0] ** 2 + d[1] ** 2
    return excess / (1 + jnp.sqrt(1 + excess))


def _gradient(function: Callable[[Array], Scalar]) -> Callable[[Array], Array]:
    """Of one scalar, or of one for each lane."""
    return jax.grad(lambda x: jnp.sum(function(x)))


class Element(eqx.Module):
    """Elastic energy, force and tangent of an element, over EA L and with lengths over L."""

    is_conservative: ClassVar[bool] = True  # whether `force` is the gradient of `energy`
    bending: Scalar  # EI / (EA L^2)
    n_elements: int = eqx.field(static=True)

    @abc.abstractmethod
    def energy(self, e: Local) -> Scalar:
        """Strain energy of one element."""

    def force(self, e: Local) -> Local:
        """Elastic force of one element."""
        return _gradient(self.energy)(e)

    def tangent(self, e: Local) -> Float[Array, "2 4 2 4 *lanes"]:
        """d force / de."""

        def column(unit: Array) -> Array:
            along = jnp.broadcast_to(beside(unit, e.ndim - 2), e.shape)
            return jax.jvp(self.force, (e,), (along,))[1]

        columns = jax.vmap(column, out_axes=2)(jnp.eye(8, dtype=e.dtype).reshape(8, 2, 4))
        return columns.reshape(*e.shape[:2], *e.shape)

    def strain(self, d: Float[Array, "2 p *lanes"]) -> Float[Array, "p *lanes"]:
        """Axial strain where the displacement gradient is this."""
        return elongation(d)

    @property
    def weights(self) -> np.ndarray:
        """Of the Gauss points."""
        return _WEIGHTS / self.n_elements

    @property
    def slopes(self) -> np.ndarray:
        """Slopes of the four shapes at the Gauss points (g, 4)."""
        return hermite(_POINTS, 1 / self.n_elements).slope

    @property
    def curvatures(self) -> np.ndarray:
        """Curvatures of the four shapes at the Gauss points (g, 4)."""
        return hermite(_POINTS, 1 / self.n_elements).curvature


class Continuum(Element):
    """U = int EA eps^2 + EI r''.r'' dx / 2 and forces int EA eps S'^T r' + EI S''^T r'' dx.

    The strain is interpolated from `stations`, where it depends on the displacement gradient. The
    forces are the gradient of U where eps is the Green strain, d eps = S'^T r' . de.
    """

    @property
    @abc.abstractmethod
    def stations(self) -> np.ndarray:
        """Slopes of the four shapes at the stations (k, 4)."""

    @abc.abstractmethod
    def interpolated(self, values: Float[Array, "c k *lanes"]) -> Float[Array, "c g *lanes"]:
        """From values at the stations to those at the Gauss points."""

    @abc.abstractmethod
    def measure(
        self, d: Float[Array, "2 k *lanes"]
    ) -> tuple[Float[Array, "k *lanes"], Float[Array, "2 k *lanes"]]:
        """Strain at the stations, and its derivative by d."""

    def _strain(self, e: Local) -> Float[Array, "g *lanes"]:
        return self.interpolated(self.measure(_of(self.stations, e))[0][None])[0]

    def energy(self, e: Local) -> Scalar:
        """B eq. 9."""
        bend = total(_of(self.curvatures, e) ** 2)
        return _integral(self.weights, self._strain(e) ** 2 + self.bending * bend) / 2

    def force(self, e: Local) -> Local:
        """(K_l + K_t) e of B eqs. 10 and A-5, where A-6 and A-7 are misprinted."""
        pull = self._strain(e)[None] * _stretched(_of(self.slopes, e))
        return _of((self.weights[:, None] * self.slopes).T, pull) + self.bending * _of(self.bend, e)

    @property
    def bend(self) -> np.ndarray:
        """int S''^T S'' dx."""
        return np.einsum("g,gi,gj->ij", self.weights, self.curvatures, self.curvatures)

    def tangent(self, e: Local) -> Float[Array, "2 4 2 4 *lanes"]:
        slopes, stations = self.slopes, self.stations
        strain, direction = self.measure(_of(stations, e))
        axes = e.ndim - 2

        def rows(slopes: np.ndarray, vector: Array) -> Array:
            """S'^T . vector at every point: (8, p, *lanes)."""
            out = vector[:, None] * beside(slopes.T[None], axes)
            return out.reshape(8, *vector.shape[1:])

        pull = rows(slopes, _stretched(_of(slopes, e)))
        # By the derivative of the strain
        turn = self.interpolated(rows(stations, direction))
        terms = [w * pull[:, None, g] * turn[None, :, g] for g, w in enumerate(self.weights)]
        material = functools.reduce(jnp.add, terms).reshape(2, 4, *e.shape)
        # and of S'^T r', the same for both components, like bending.
        each = np.einsum("g,gi,gj->ijg", self.weights, slopes, slopes).reshape(16, -1)
        along = _of(each, self.interpolated(strain[None]))[0].reshape(4, *e.shape[1:])
        along = along + self.bending * beside(self.bend, axes)
        return material + _both(along)


def _both(a: Float[Array, "4 4 *lanes"]) -> Float[Array, "2 4 2 4 *lanes"]:
    """The same for both components, which it does not couple."""
    return beside(np.eye(2)[:, None, :, None], a.ndim - 2) * a[None, :, None]


class ModelA(Continuum):
    """B eq. A-3: stations are the first end, the chord and the last end."""

    is_conservative = False

    @property
    def stations(self) -> np.ndarray:
        n = self.n_elements
        return np.array([[0, 1, 0, 0], [-n, 0, n, 0], [0, 0, 0, 1.0]])

    def interpolated(self, values: Array) -> Array:
        s = _POINTS
        return _of(np.stack([1 - 4 * s + 3 * s**2, 6 * s - 6 * s**2, 3 * s**2 - 2 * s], 1), values)

    def measure(self, d: Array) -> tuple[Array, Array]:
        strain = elongation(d)
        return strain, _stretched(d) / (1 + strain)[None]


class Green(Continuum):
    """Green strain; stations are the Gauss points."""

    @property
    def stations(self) -> np.ndarray:
        return self.slopes

    def interpolated(self, values: Array) -> Array:
        return values

    def measure(self, d: Array) -> tuple[Array, Array]:
        return self.strain(d), _stretched(d)

    def strain(self, d: Array) -> Array:
        return d[1] + (d[0] ** 2 + d[1] ** 2) / 2


class ModelZero(Element):
    """Linear strain du_l/dx and curvature in a frame that moves with the element (B eq. 62)."""

    @abc.abstractmethod
    def along(self, e: Local) -> Float[Array, "2 *lanes"]:
        """Tangent of the frame, less a1, before it is made a unit vector."""

    def energy(self, e: Local) -> Scalar:
        axis = self.along(e)
        size = 1 + elongation(axis)
        # t.r' - 1 = (t - a1).r' + d_1, both small, so that nothing cancels.
        lean = jnp.stack([axis[0], axis[1] - (size - 1)]) / size[None]
        d, tangent = _of(self.slopes, e), _stretched(lean)
        stretched, curved = _stretched(d), _of(self.curvatures, e)
        strain = lean[0] * stretched[0] + lean[1] * stretched[1] + d[1]
        bend = tangent[1] * curved[0] - tangent[0] * curved[1]
        return _integral(self.weights, strain**2 + self.bending * bend**2) / 2


class Chord(ModelZero):
    """From one end to the other."""

    def along(self, e: Local) -> Float[Array, "2 *lanes"]:
        return (e[:, 2] - e[:, 0]) * self.n_elements


class Tangent(ModelZero):
    """Of the first end."""

    def along(self, e: Local) -> Float[Array, "2 *lanes"]:
        return e[:, 1]


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
    turned_mass: BlockTridiagonal  # M times a turn by a right angle
    straight: Nodes  # of X a1
    element_mass: Scalar
    tip_mass: Scalar
    axial_stiffness: Scalar
    element: Element

    takes_lanes: ClassVar[bool] = True

    def __init__(self, rotor: Rotor, n_elements: int, element: type[Element]) -> None:
        beam = rotor.beam
        radius, length = rotor.hub_radius, beam.length
        self.size, self.end, self.rigid = length, radius + length, rigid_moments(rotor)
        self.element_mass, self.tip_mass = beam.mass / n_elements, rotor.tip_mass
        self.axial_stiffness = beam.axial_stiffness
        self.energy_scale = beam.in_plane_bending_stiffness / length
        along = radius + length * beside(np.linspace(0.0, 1.0, n_elements + 1), length.ndim)
        along = jnp.stack([along, length + jnp.zeros_like(along)], 1)
        self.straight = jnp.stack([jnp.zeros_like(along), along], 1)
        ratio = beam.in_plane_bending_stiffness / (beam.axial_stiffness * length**2)
        self.element = element(ratio, n_elements)
        self.mass, self.turned_mass = self._inertial(np.eye(2)), self._inertial(_TURN)

    def _inertial(self, turn: np.ndarray) -> BlockTridiagonal:
        """Mass matrix times `turn`."""
        lanes = self.tip_mass.ndim
        local = np.einsum("cd,ij->cidj", turn, self._gram)[None]
        own = _assembled(jnp.repeat(local, self.element.n_elements, 0))
        at_tip = np.zeros((len(self.straight), 4, 12))
        at_tip[-1, ::2, 4:8:2] = turn
        rows = self.element_mass * beside(own.rows, lanes) + self.tip_mass * beside(at_tip, lanes)
        return BlockTridiagonal(rows, absent=3)

    def force(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None) -> Vector:
        spin, rate = hub.angular_velocity[2], hub.angular_velocity_rate[2]
        place = self.straight + self._nodes(q)
        field = _turned(rate * place + 2 * spin * self._nodes(v)) - spin**2 * place
        field = field + _constant(hub.acceleration)
        own = self._elastic(q) + self.element_mass * _each(self._gram, _local(field))
        at_tip = self.tip_mass * field[-1]
        if tip_force is not None:
            at_tip = at_tip - _constant(tip_force)[0]
        return -_gathered(own, at_tip[:, 0])

    def tangents(
        self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None
    ) -> tuple[BlockTridiagonal, BlockTridiagonal]:
        spin, rate = hub.angular_velocity[2], hub.angular_velocity_rate[2]
        k = -(spin**2) * self.mass + rate * self.turned_mass + self.elastic_tangent(q)
        return k, 2 * spin * self.turned_mass

    def elastic_tangent(self, q: Vector) -> BlockTridiagonal:
        local = jax.vmap(self.element.tangent)(self._shares(q))
        return _assembled(self.axial_stiffness / self.size * local)

    def elastic_force(self, q: Vector) -> Vector:
        own = self._elastic(q)
        return _gathered(own, jnp.zeros_like(own[-1, :, 0]))

    def _elastic(self, q: Vector) -> Float[Array, "n 2 4 *lanes"]:
        """Of every element."""
        return self.axial_stiffness * jax.vmap(self.element.force)(self._shares(q))

    def strain_energy(self, q: Vector) -> Scalar:
        energy = total(jax.vmap(self.element.energy)(self._shares(q)))
        return self.axial_stiffness * self.size * energy

    def nonconservative_force(self, q: Vector) -> Vector:
        if self.element.is_conservative:
            return jnp.zeros_like(q)
        return self.elastic_force(q) - _gradient(self.strain_energy)(q)

    def kinetic_energy(self, q: Vector, v: Vector, velocity: Triple, spin: Triple) -> Scalar:
        """int |a + b|^2 - |a|^2 dm / 2, a = v + omega x X a1 and b = omega x u + u'."""
        own = self._nodes(v) + spin[2] * _turned(self._nodes(q))
        carried = spin[2] * _turned(self.straight) + _constant(velocity)
        return self._product(own, own / 2 + carried)

    def first_moment(self, q: Vector) -> Triple:
        nodes, axes = self._nodes(q), jnp.eye(3, dtype=q.dtype)
        along, across = (
            self._product(jnp.broadcast_to(_constant(beside(axis, q.ndim - 1)), nodes.shape), nodes)
            for axis in axes[:2]
        )
        return jnp.stack([along, across, jnp.zeros_like(along)])

    def _product(self, a: Nodes, b: Nodes) -> Scalar:
        """int a . b dm of two fields."""
        own = _local(a) * _each(self._gram, _local(b))
        own = total(own.reshape(-1, *own.shape[3:]))
        return self.element_mass * own + self.tip_mass * total(a[-1, :, 0] * b[-1, :, 0])

    @property
    def _gram(self) -> np.ndarray:
        """int N N^T over an element of unit mass (4, 4)."""
        value = hermite(_POINTS, 1 / self.element.n_elements).value
        return np.einsum("g,gi,gj->ij", _WEIGHTS, value, value)

    def tip(self, q: Vector) -> Triple:
        return jnp.stack([q[-2], q[-4], jnp.zeros_like(q[-1])])

    def displacement(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        """Of the cubic in the element where a point is."""
        shapes, local = self._around(q, xi)
        across, along = jnp.sum(shapes.value * local, 2)
        return jnp.stack([along, across, jnp.zeros_like(along)], 1)

    def strain(self, q: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        return self.element.strain(self.gradient(q, xi))

    def gradient(self, q: Vector, xi: np.ndarray) -> Float[Array, "2 p"]:
        """Displacement gradient d = r' - a1 at x = xi L."""
        shapes, local = self._around(q, xi)
        return jnp.sum(shapes.slope * local, 2) / self.size

    def curvature(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 2"]:
        shapes, local = self._around(q, xi)
        bend = jnp.sum(shapes.curvature * local, 2)[0] / self.size**2
        return jnp.stack([bend, jnp.zeros_like(bend)], 1)

    def _around(self, q: Vector, xi: np.ndarray) -> tuple[Functions, Float[Array, "2 p 4"]]:
        """Shapes at points, (1, p, 4), and coordinates of the elements where they are."""
        xi, n = np.asarray(xi, float), self.element.n_elements
        index = np.clip((xi * n).astype(int), 0, n - 1)
        shapes = Functions(*(a[None] for a in hermite(xi * n - index, 1 / n)))
        return shapes, _local(self._nodes(q))[index].swapaxes(0, 1)

    def _shares(self, q: Vector) -> Float[Array, "n 2 4 *lanes"]:
        """Coordinates of every element over the length."""
        return _local(self._nodes(q)) / self.size

    def _nodes(self, q: Vector) -> Nodes:
        """Those of the clamped node included."""
        return padded(q, 3, 0).reshape(-1, 2, 2, *q.shape[1:])


def _each(table: np.ndarray, x: Float[Array, "n 2 4 *lanes"]) -> Float[Array, "n 2 4 *lanes"]:
    return jax.vmap(lambda x: _of(table, x))(x)


def _local(nodes: Nodes) -> Float[Array, "n 2 4 *lanes"]:
    """Of every element."""
    return jnp.concatenate([nodes[:-1], nodes[1:]], 2)


def _constant(vector: Triple) -> Float[Array, "1 2 2 *lanes"]:
    """Nodal values of a constant field."""
    value = jnp.stack([vector[1], vector[0]])
    return jnp.stack([value, jnp.zeros_like(value)], 1)[None]


def _turned(nodes: Nodes) -> Nodes:
    """`_TURN` applied to a field."""
    return jnp.stack([nodes[:, 1], -nodes[:, 0]], 1)


def _gathered(local: Float[Array, "n 2 4 *lanes"], at_tip: Float[Array, "2 *lanes"]) -> Vector:
    """Sum of what elements do at nodes, and of a force at the tip."""
    nodes = padded(local[:, :, :2], 0, 1) + padded(local[:, :, 2:], 1, 0)
    tip = padded(jnp.stack([at_tip, jnp.zeros_like(at_tip)], 1)[None], len(local), 0)
    return (nodes + tip).reshape(-1, *local.shape[3:])[3:]


def _assembled(local: Float[Array, "n 2 4 2 4 *lanes"]) -> BlockTridiagonal:
    n, lanes = len(local), local.shape[5:]
    # Rows by end, component, value and slope; columns the same.
    ends = local.reshape(n, 2, 2, 2, 2, 2, 2, *lanes)
    order = (2, 0, 1, 3, 5, 4, 6)
    first, last = ends.transpose(*order, *range(7, ends.ndim)).reshape(2, n, 4, 8, *lanes)
    beyond = jnp.zeros_like(first[:, :, :4])
    first = padded(jnp.concatenate([beyond, first], 2), 0, 1)
    last = padded(jnp.concatenate([last, beyond], 2), 1, 0)
    return BlockTridiagonal(first + last, absent=3)
