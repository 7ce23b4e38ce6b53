"""Energy, force and tangent of one cubic element, by theory.

The local coordinates e are three values of the displacement gradient d = r' - a1, at the first
end, on the chord and at the last end, by which d is known along the element, (1-4s+3s^2) e_A +
(6s-6s^2) e_M + (3s^2-2s) e_B: forces do not depend on where the element is. Theories differ in the
axial strain:

    Model A        interpolated like d from those of the three values (B eq. A-3), and forces
                   int EA eps S'^T r' dx that are not the gradient of an energy
    Green          d_1 + d.d / 2, forces from int [EA eps^2 + EI r''.r''] dx / 2
    Engineering    |r'| - 1, forces from int [EA eps^2 + EI phi'^2] dx / 2, phi the tangent's angle
                   (`exact.py`)
    Model 0        t.r' - 1 and curvature n.r'' in a frame that moves with the element

Viscous forces follow from the rates of the same strains and curvatures: see `damping_data.py`.

Where EA and EI vary along an element, they have a number each at every point of integration, and
`Parts` integrates from kink to kink.

Vectors have their components in the order a2, a1, and any array may have axes of lanes behind all
others (see `kernel`).

B is the paper of `_models/contract/__init__.py`.
"""

import abc
import functools
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.ancf.strained import Strained, gradient_of
from jaxbeam._programs.lanes import append_axes, pairwise_sum, sum_of_products
from jaxbeam._types import Number

# Displacement gradient at the first end of an element, on its chord, and at its last end.
LocalGradients = Float[Array, "2 3 *lanes"]
Strains = tuple[Array, ...]  # axial strain and curvatures at the Gauss points, (g, *lanes) each
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(5)  # exact to degree 9; Green's eps^2 is of 8
POINTS, WEIGHTS = (1 + POINTS) / 2, WEIGHTS / 2
QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])  # a1 becomes a2, a2 becomes -a1


def map_rows(
    table: Float[np.ndarray, "a b"] | Float[Array, "a b"], x: Float[Array, "c b *lanes"]
) -> Array:
    """The sum over b of table_ab x_cb: a table times each row c of x, for all lanes."""
    lanes = x.ndim - 2
    return sum_of_products(append_axes(table[None], lanes), x[:, None], 2, lanes)


def along_element(s: np.ndarray, derivative: int = 0) -> Float[np.ndarray, "p 3"]:
    """The matrix from the three values of the gradient of an element to the gradient at points s,
    or to its derivative by s."""
    if derivative:
        return np.stack([6 * s - 4, 6 - 12 * s, 6 * s - 2], 1)
    return np.stack([1 - 4 * s + 3 * s**2, 6 * s - 6 * s**2, 3 * s**2 - 2 * s], 1)


def _integral(weights: np.ndarray, x: Float[Array, "g *lanes"]) -> Number:
    return map_rows(weights[None], x[None])[0, 0]


def axis_of(d: Float[Array, "2 *lanes"]) -> Array:
    """The tangent a1 + d of the deformed axis."""
    return jnp.concatenate([d[:1], 1 + d[1:]])


def elongation(d: Float[Array, "2 *lanes"]) -> Number:
    """|a1 + d| - 1, without cancellation."""
    excess = 2 * d[1] + d[0] ** 2 + d[1] ** 2
    return excess / (1 + jnp.sqrt(1 + excess))


class Rule(NamedTuple):
    """A quadrature over x / L on an element or a part of it, with g Gauss points."""

    weights: Any  # (g,)
    slopes: Any  # (g, 3), from the local coordinates to the gradient at the points
    curvatures: Any  # (g, 3), from the local coordinates to its derivative by x / L


def rule(n_elements: int, start: float = 0.0, end: float = 1.0) -> Rule:
    """Quadrature on one of `n_elements` elements, from s = start to s = end of it."""
    s, size = start + (end - start) * POINTS, (end - start) * WEIGHTS
    return Rule(size / n_elements, along_element(s), n_elements * along_element(s, 1))


class Element(Strained):
    """Elastic energy, force and tangent of an element, over EA L, and viscous forces.

    Where properties vary this EA is one value for the whole beam, and `bending` and `stretching`
    are numbers at the Gauss points, (g, *lanes).
    """

    is_conservative: ClassVar[bool] = True  # whether `force` is the gradient of `energy`
    tears: ClassVar[bool] = False  # whether steady states end where the rod tears
    bending: Number  # EI / (EA L^2)
    n_elements: int = eqx.field(static=True)
    stretching: Number | None = None  # EA at the points over the EA above; None: the same
    part: Rule | None = None  # the quadrature of a part of the element; None: the whole element

    @abc.abstractmethod
    def strains(self, e: LocalGradients) -> Strains:
        """Axial strain and curvature at the Gauss points; rigid motion does not change them."""

    def stresses(self, strains: Strains) -> Strains:
        """Axial forces and moments at the Gauss points over EA, times weights of integration."""
        strain, *curvatures = strains
        weights = append_axes(self.weights, strain.ndim - 1)
        moments = (weights * (self.bending * curvature) for curvature in curvatures)
        return weights * self.times_ea(strain), *moments

    def energy(self, e: LocalGradients) -> Number:
        """Strain energy of one element."""
        strain, *curvatures = self.strains(e)
        density = self.times_ea(strain**2)
        for curvature in curvatures:
            density = density + self.bending * curvature**2
        return _integral(self.weights, density) / 2

    def force(self, e: LocalGradients) -> LocalGradients:
        """Elastic force of one element."""
        return gradient_of(self.energy)(e)

    def tangent(self, e: LocalGradients) -> Float[Array, "2 3 2 3 *lanes"]:
        """The tangent d force / de of one element, (2, 3, 2, 3) and lanes."""
        return self.derivative(self.force, e)

    def strain(self, d: Float[Array, "2 p *lanes"]) -> Float[Array, "p *lanes"]:
        """The axial strain at points with these displacement gradients."""
        return elongation(d)

    @property
    def weights(self) -> np.ndarray:
        return self._rule.weights

    @property
    def slopes(self) -> np.ndarray:
        return self._rule.slopes

    @property
    def curvatures(self) -> np.ndarray:
        return self._rule.curvatures

    @property
    def _rule(self) -> Rule:
        return rule(self.n_elements) if self.part is None else self.part

    def times_ea(self, x: Float[Array, "g *lanes"]) -> Float[Array, "g *lanes"]:
        """Numbers at the Gauss points times `stretching`, the relative axial stiffness there."""
        return x if self.stretching is None else self.stretching * x


class Continuum(Element):
    """U = int EA eps^2 + EI r''.r'' dx / 2 and forces int EA eps S'^T r' + EI S''^T r'' dx.

    The strain is interpolated from k `stations`, where it depends on the displacement gradient.
    The forces are the gradient of U where eps is the Green strain, d eps = S'^T r' . de. Viscous
    forces are by the rates of eps and of the two components of r'' in axes that turn with r'.
    """

    @property
    @abc.abstractmethod
    def stations(self) -> np.ndarray:
        """The matrix (k, 3) from local coordinates to gradients at the stations."""

    @abc.abstractmethod
    def interpolated(self, values: Float[Array, "c k *lanes"]) -> Float[Array, "c g *lanes"]:
        """Values at the Gauss points from those at the stations."""

    @abc.abstractmethod
    def measure(
        self, d: Float[Array, "2 k *lanes"]
    ) -> tuple[Float[Array, "k *lanes"], Float[Array, "2 k *lanes"]]:
        """Strain at the stations, and its derivative by d."""

    def strains(self, e: LocalGradients) -> Strains:
        along, curved = axis_of(map_rows(self.slopes, e)), map_rows(self.curvatures, e)
        size = jnp.sqrt(along[0] ** 2 + along[1] ** 2)
        stretch_rate = (along[0] * curved[0] + along[1] * curved[1]) / size
        return self._strain(e), (along[1] * curved[0] - along[0] * curved[1]) / size, stretch_rate

    def _strain(self, e: LocalGradients) -> Float[Array, "g *lanes"]:
        return self.interpolated(self.measure(map_rows(self.stations, e))[0][None])[0]

    def energy(self, e: LocalGradients) -> Number:
        """Strain energy of B eq. 9."""
        curvature_squared = pairwise_sum(map_rows(self.curvatures, e) ** 2)
        density = self.times_ea(self._strain(e) ** 2) + self.bending * curvature_squared
        return _integral(self.weights, density) / 2

    def force(self, e: LocalGradients) -> LocalGradients:
        """The elastic force (K_l + K_t) e of B eqs. 10 and A-5; A-6 and A-7 are misprinted."""
        axial = self.times_ea(self._strain(e))[None] * axis_of(map_rows(self.slopes, e))
        axial = map_rows((self.weights[:, None] * self.slopes).T, axial)
        if self.stretching is None:
            return axial + self.bending * map_rows(self._bending_integral, e)
        moment = self.bending[None] * map_rows(self.curvatures, e)
        return axial + map_rows((self.weights[:, None] * self.curvatures).T, moment)

    @property
    def _bending_integral(self) -> np.ndarray:
        """The integral int S''^T S'' dx over an element."""
        return np.einsum("g,gi,gj->ij", self.weights, self.curvatures, self.curvatures)

    def tangent(self, e: LocalGradients) -> Float[Array, "2 3 2 3 *lanes"]:
        slopes, stations = self.slopes, self.stations
        strain, stretched = self.measure(map_rows(stations, e))
        forces = _rows(slopes, axis_of(map_rows(slopes, e)))
        # The part by the derivative of the strain,
        by_gradient = jax.vmap(self.times_ea)(self.interpolated(_rows(stations, stretched)))
        terms = [
            w * forces[:, None, g] * by_gradient[None, :, g] for g, w in enumerate(self.weights)
        ]
        material = functools.reduce(jnp.add, terms).reshape(2, 3, *e.shape)
        # and that by the derivative of S'^T r', the same for both components, like bending.
        forces = jax.vmap(self.times_ea)(self.interpolated(strain[None]))
        block = _weighted(self.weights, slopes, slopes, forces)
        if self.stretching is None:
            block = block + self.bending * append_axes(self._bending_integral, e.ndim - 2)
        else:
            bending = jnp.broadcast_to(self.bending, forces[0].shape)[None]
            block = block + _weighted(self.weights, self.curvatures, self.curvatures, bending)
        return material + _for_both_components(block)


def _rows(
    table: Float[np.ndarray, "p 3"] | Float[Array, "p 3"], vector: Float[Array, "2 p *lanes"]
) -> Float[Array, "6 p *lanes"]:
    """Rows table_pi vector_cp for the 6 local coordinates (c, i), at every point p."""
    out = vector[:, None] * append_axes(table.T[None], vector.ndim - 2)
    return out.reshape(6, *vector.shape[1:])


def _weighted(
    weights: np.ndarray, x: np.ndarray, y: np.ndarray, values: Float[Array, "1 g *lanes"]
) -> Float[Array, "3 3 *lanes"]:
    """The integral int x y^T values dx, (3, 3), of two tables x and y (g, 3)."""
    products = weights[None, None] * x.T[:, None] * y.T[None] + 0.0  # + 0.0: no negative zeros
    return map_rows(products.reshape(9, -1), values)[0].reshape(3, 3, *values.shape[2:])


def _for_both_components(a: Float[Array, "3 3 *lanes"]) -> Float[Array, "2 3 2 3 *lanes"]:
    """The tangent (2, 3, 2, 3) that has the same matrix (3, 3) for both components, uncoupled."""
    return append_axes(np.eye(2)[:, None, :, None], a.ndim - 2) * a[None, :, None]


class ModelA(Continuum):
    """Axial strain of B eq. A-3, interpolated from stations at both ends and on the chord."""

    is_conservative = False

    @property
    def stations(self) -> np.ndarray:
        return np.eye(3)

    def interpolated(self, values: Array) -> Array:
        return map_rows(self.slopes, values)

    def measure(self, d: Array) -> tuple[Array, Array]:
        strain = elongation(d)
        return strain, axis_of(d) / (1 + strain)[None]


class Green(Continuum):
    """Elements with Green strain, computed at the Gauss points: these are the stations."""

    @property
    def stations(self) -> np.ndarray:
        return self.slopes

    def interpolated(self, values: Array) -> Array:
        return values

    def measure(self, d: Array) -> tuple[Array, Array]:
        return self.strain(d), axis_of(d)

    def strain(self, d: Array) -> Array:
        return d[1] + (d[0] ** 2 + d[1] ** 2) / 2


class ModelZero(Element):
    """Linear strain du_l/dx and curvature in a frame that moves with the element (B eq. 62)."""

    tears = True

    @abc.abstractmethod
    def along(self, e: LocalGradients) -> Float[Array, "2 *lanes"]:
        """Tangent of the frame less a1, not yet of unit length."""

    def strains(self, e: LocalGradients) -> Strains:
        axis = self.along(e)
        size = 1 + elongation(axis)
        # t.r' - 1 = (t - a1).r' + d_1, both small, so that nothing cancels.
        lean = jnp.stack([axis[0], axis[1] - (size - 1)]) / size[None]
        d, tangent = map_rows(self.slopes, e), axis_of(lean)
        stretched, curved = axis_of(d), map_rows(self.curvatures, e)
        strain = lean[0] * stretched[0] + lean[1] * stretched[1] + d[1]
        return strain, tangent[1] * curved[0] - tangent[0] * curved[1]


class Chord(ModelZero):
    """The frame of an element lies along the chord from one end to the other."""

    def along(self, e: LocalGradients) -> Float[Array, "2 *lanes"]:
        return e[:, 1]


class Tangent(ModelZero):
    """The frame of an element lies along the tangent at its first end."""

    def along(self, e: LocalGradients) -> Float[Array, "2 *lanes"]:
        return e[:, 0]
