"""Energy, force and tangent of a cubic element that bends both ways, twists and stretches.

The axis is the cubic r(s) of positions and slopes of the nodes, as in the plane. At a node the
section is turned by the angle a from the frame to which the least rotation brings the axes of the
hub, a1 to the tangent t. Within an element it is turned by h(s) from the frame which the least
rotation, t_A to t(s), makes of that of the first node; h is the cubic of its rates at the ends and
of what separates the frames of the nodes there,

    h_B = a_B - a_A - W,   tan(W / 2) = a1.(t_A x t_B) / (1 + a1.t_A + t_A.t_B + t_B.a1),

W the area of the triangle of the three directions on the unit sphere. With primes for d/dx and
t = (x, y, z) in the axes of the first node's frame, curvatures before the turn by h, and twist, are

    k_2 = y' - y x' / (1 + x),   k_3 = z' - z x' / (1 + x),   k_1 = h' + (z y' - y z') / (1 + x).

This is exact for the interpolated beam, whatever the size of its rotation. So strains depend on no
path and do not change when all is turned rigidly, and in a plane what is left is `Engineering`,
integrated with three points of bending and three of stretch in place of five.

The local coordinates e (13,) are three values of the displacement gradient r' - a1, as in
`_models/ancf/energies.py`, component by component in the order a1, a2, a3; then a and the twist L
k_1 of the first node, and of the last. Any array may have further axes, of lanes, behind those it
is said to have (see `kernel`).

Frames by least rotations: M. Bergou et al., Discrete elastic rods, ACM Trans. Graph. 27, 2008, with
angles of twist about them; C. Meier, A. Popp, W. A. Wall, An objective 3D large deformation finite
element formulation for geometrically exact curved Kirchhoff rods, Comput. Methods Appl. Mech. Eng.
278, 2014, with the first node's frame as the reference.
"""

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.ancf.energies import along_element, map_rows
from jaxbeam._models.contract.strained import Strained
from jaxbeam._models.space.frames import (
    LocalCoordinates,
    Natural,
    between,
    deformation,
    frames,
    gradients,
    pulled_back,
    pulled_back_tangent,
    stretched,
)
from jaxbeam._models.space.points import Points
from jaxbeam._models.space.rotated import Rotated, Way
from jaxbeam._programs.lanes import (
    append_axes,
    compute_once,
    pairwise_sum,
    sum_of_products,
    transposed,
)
from jaxbeam._types import Number

# Gauss points of an element and their weights, exact to degree 5, as small bending and twist want
# it.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
GAUSS = (1 + _NODES) / 2, _WEIGHTS / 2
# Of stretch, the ends and the middle (Simpson): as slender beams bend far, stretch has to vanish at
# each of these points, of which n elements have 2 n + 1 different ones, as many as they have
# unknowns along the beam. With Gauss points, 3 n, elements lock: they bend too little. With fewer
# points there would be stretch that none of them sees. So parts of elements have no others.
SIMPSON = np.array([0.0, 0.5, 1.0]), np.array([1.0, 4.0, 1.0]) / 6


class SpatialRule(NamedTuple):
    """A quadrature over x / L on an element, or a part of it."""

    weights: Any  # of the Gauss points (g,)
    slopes: Any  # from the values of the gradient to the gradient there (g, 3)
    curvatures: Any  # and to its derivative by x / L (g, 3)
    angles: Any  # from the rates of turn at both ends, and the turn between, to the turn (g, 3)
    rates: Any  # and to its derivative by x / L (g, 3)
    pulls: Any  # weights of the points of stretch, of all of the element (3,)
    strained: Any  # from the values of the gradient to the gradient there (3, 3)

    @property
    def tables(self) -> Any:
        """The tables that make r' and turn, and their derivatives, of those at stations (2, 4, g,
        3)."""
        stack = np.stack if isinstance(self.slopes, np.ndarray) else jnp.stack
        tables = (self.slopes, self.angles), (self.curvatures, self.rates)
        return stack([stack([along] * 3 + [about]) for along, about in tables])


def spatial_rule(n_elements: int, start: float = 0.0, end: float = 1.0) -> SpatialRule:
    """Quadrature on one of so many elements, from s = start to s = end."""
    (places, weights), (ends, pulls) = GAUSS, SIMPSON
    s, size, h = start + (end - start) * places, (end - start) * weights, 1 / n_elements
    rates = [1 - 4 * s + 3 * s**2, (6 * s - 6 * s**2) / h, 3 * s**2 - 2 * s]
    return SpatialRule(
        h * size, along_element(s), along_element(s, 1) / h, turns(s, h),
        np.stack(rates, 1), h * pulls, along_element(ends),
    )  # fmt: skip


def turns(s: np.ndarray, h: float) -> Float[np.ndarray, "p 3"]:
    """The matrix that makes the turn at points s of its rates at both ends and of its whole between
    them."""
    return np.stack([h * (s - 2 * s**2 + s**3), 3 * s**2 - 2 * s**3, h * (s**3 - s**2)], 1)


def section_angles(e: Float[Array, "p 13"], s: np.ndarray, n_elements: int) -> Float[Array, " p"]:
    """The angle a at a point s of each element: by which the section is turned from the frame
    to which the least rotation brings the axes of the hub, as at the nodes."""

    def one(e: LocalCoordinates, along: Array, by_angles: Array) -> Number:
        r = stretched(gradients(e))
        first, here = r[:, 0], r @ along
        first, here = (t / jnp.linalg.norm(t) for t in (first, here))
        return e[9] + by_angles @ deformation(e, n_elements)[7:] + between(first, here)

    shapes = along_element(s), turns(s, 1 / n_elements)
    return jax.vmap(one)(e, *map(jnp.asarray, shapes))


class SpatialElement(Strained):
    """Elastic energy, force and tangent of an element, over EA L, and viscous forces:

    int EA (|r'| - 1)^2 + GJ k_1^2 + EI_vv k_v^2 + 2 EI_vw k_v k_w + EI_ww k_w^2 dx / 2,

    (k_v, k_w) being (k_2, k_3) turned by h, and the stiffnesses those of the section as twist and
    pitch turn it: see `linear_stiffness`. Where properties vary, EA is any one value of it, and
    all others are numbers at the Gauss points (g, *lanes); `stretching` is what belongs to the
    points of stretch, over what would if EA were constant.
    """

    axes: ClassVar[int] = 1
    bending: tuple[Number, Number | None, Number]  # vv, vw (None: zero) and ww over EA L^2
    torsion: Number  # GJ / (EA L^2)
    n_elements: int = eqx.field(static=True)
    stretching: Number | None = None
    part: SpatialRule | None = None  # of a part of the element; None: of the whole

    @property
    def rule(self) -> SpatialRule:
        return spatial_rule(self.n_elements) if self.part is None else self.part

    def strains(self, e: LocalCoordinates) -> tuple[Array, Array]:
        """Strain eps at the points of stretch, and (k_1, k_v, k_w) at Gauss points, (3, g)."""
        strain = elongation(map_rows(self.rule.strained, gradients(e)))
        return strain, self._moments(self._at(deformation(e, self.n_elements)))[0]

    def stresses(self, strains: tuple[Array, Array]) -> tuple[Array, Array]:
        strain, (twist, v, w) = strains
        rule, lanes = self.rule, strain.ndim - 1
        moments = jnp.stack([self.torsion * twist, *self._bends(v, w)])
        pull = append_axes(rule.pulls, lanes) * _pulled(self.stretching, strain)
        return pull, append_axes(rule.weights[None], lanes) * moments

    def energy(self, e: LocalCoordinates) -> Number:
        """Strain energy of one element."""
        rule, natural = self.rule, deformation(e, self.n_elements)
        strain = elongation(map_rows(rule.strained, gradients(e)))
        stretch = _pulled(self.stretching, strain**2)
        return map_rows(rule.pulls[None], stretch[None])[0, 0] / 2 + self._turns(natural)

    def force(self, e: LocalCoordinates) -> LocalCoordinates:
        """Elastic force of one element."""
        rule = self.rule
        d = map_rows(rule.strained, gradients(e))
        strain, w = elongation(d), append_axes(rule.pulls, e.ndim - 1)
        pull = w * _pulled(self.stretching, strain / (1 + strain))
        pull = map_rows(rule.strained.T, pull[None] * stretched(d))
        n = self.n_elements
        angle = pulled_back(frames(e, n), self._bent(deformation(e, n))[:, None], n)[:, 0]
        return angle + _padded(pull.reshape(9, *e.shape[1:]))

    def tangent(self, e: LocalCoordinates) -> Float[Array, "13 13 *lanes"]:
        """The tangent d force / de of one element."""
        n = self.n_elements
        force, second = self._second(deformation(e, n))
        return pulled_back_tangent(frames(e, n), force, second, n) + self._stretching(e)

    def _bent(self, natural: Natural) -> Natural:
        """The gradient of `_turns`."""
        at = self._at(natural)
        _, moments, on_turn = self._moments(at)
        return self._over_points(self._by(at.moment_ways(moments, on_turn)[:1], at)[:, 0])

    def _turns(self, natural: Natural) -> Number:
        """Energy of bending and torsion."""
        strains, (twist, *_), _ = self._moments(self._at(natural))
        k, v, w = strains
        by_v, by_w = self._bends(v, w)
        density = (twist * k + by_v * v + by_w * w) / 2
        return pairwise_sum(append_axes(self.rule.weights, natural.ndim - 1) * density)

    def _at(self, natural: Natural) -> Rotated:
        """Vectors and angles at the Gauss points, in the axes of the first node's frame."""
        none, lanes = jnp.zeros_like(natural[0]), natural.ndim - 1
        first = jnp.stack([natural[0], none, none])
        stations = jnp.stack([first, natural[1:4], natural[4:7]], 1)
        stations = jnp.concatenate([stations, natural[None, 7:]])
        here, ahead = compute_once(
            sum_of_products(
                append_axes(self.rule.tables, lanes), stations[None, :, None], 3, lanes + 1
            )
        )
        cos, sin = compute_once((jnp.cos(here[3]), jnp.sin(here[3])))
        return Rotated(Points.of(here[:3], ahead[:3]), cos, sin, ahead[3])

    def _moments(self, at: Rotated) -> tuple[Array, Array, Array]:
        """Twist and curvatures of the section (3, g), the moments of twist and of bending about the
        axes before the turn (3, g), and what bending does on the turn (g)."""
        _, second, third = at.points.seen
        v, w = at.cos * second + at.sin * third, at.cos * third - at.sin * second
        twist = at.rate + at.points.rise
        by_v, by_w = self._bends(v, w)
        moments = jnp.stack([self.torsion * twist, *at.before_turn(by_v, by_w)])
        return compute_once((jnp.stack([twist, v, w]), moments, by_v * w - by_w * v))

    def _bends(self, v: Array, w: Array) -> tuple[Array, Array]:
        """Bending moments about the axes of the section."""
        vv, vw, ww = self.bending
        return (vv * v, ww * w) if vw is None else (vv * v + vw * w, ww * w + vw * v)

    def _second(self, natural: Natural) -> tuple[Natural, Float[Array, "10 10 *lanes"]]:
        """First and second derivatives of `_turns`."""
        rule, at, lanes = self.rule, self._at(natural), natural.ndim - 1
        strains, moments, on_turn = self._moments(at)
        by = self._by([*at.strain_ways(strains), *at.moment_ways(moments, on_turn)], at)
        weights = append_axes(rule.weights[None], lanes)
        stiff = compute_once(weights[None] * jax.vmap(self._stiff)(by[:, :3]))
        second = self._fixed(at, moments, by[:, 4])
        for way in range(3):
            for g in range(len(rule.weights)):
                second = second + by[:, None, way, g] * stiff[None, :, way, g]
        return self._over_points(by[:, 3]), second

    def _stiff(self, strains: Float[Array, "3 *rest"]) -> Array:
        """Moments of twist and of bending about the axes of the section, from its twist and
        curvatures."""
        twist, v, w = strains
        return jnp.stack([self.torsion * twist, *self._bends(v, w)])

    def _by(self, ways: list[Way], at: Rotated) -> Float[Array, "10 k g *lanes"]:
        """The forces of each of k ways on `Natural`."""
        moments, on_turns, on_rates = (jnp.stack(each) for each in zip(*ways, strict=True))
        forces = jax.vmap(at.points.forces)(moments)
        loads = jnp.stack([*forces[:3], on_turns, *forces[3:], on_rates])
        loads = compute_once(_back(at.points, loads.reshape(2, 4, *on_turns.shape)))
        return compute_once(_natural(_by_stations(self.rule.tables, loads)))

    def _over_points(self, values: Float[Array, "10 g *lanes"]) -> Natural:
        """Integral of what is at the Gauss points."""
        weights = append_axes(self.rule.weights[None], values.ndim - 2)
        return pairwise_sum(jnp.moveaxis(weights * values, 1, 0))

    @transposed(on=False)
    def viscous_tangents(self, e: LocalCoordinates, rate: LocalCoordinates) -> tuple[Array, Array]:
        """Derivatives of the viscous force as in `Strained`, in a smaller program, by the strains'
        own derivatives."""
        lanes = e.ndim - 1
        b, change = jax.jvp(self._strain_rows, (e,), (rate,))
        rates = compute_once(sum_of_products(b, rate[:, None], 0, max(lanes, 1)))
        by = (compute_once(jax.vmap(self._stressed)(a)) for a in (change, b))
        by_e, by_rate = (sum_of_products(b[:, None], a[None], 2, lanes) for a in by)
        return by_e + self._geometric(e, rates), by_rate

    def viscous(self, e: LocalCoordinates, rate: LocalCoordinates) -> LocalCoordinates:
        """The viscous force as in `Strained`, in a smaller program."""
        b, lanes = self._strain_rows(e), e.ndim - 1
        rates = compute_once(sum_of_products(b, rate[:, None], 0, max(lanes, 1)))
        return sum_of_products(b, self._stressed(rates)[None], 1, lanes)

    def _stressed(self, strains: Array) -> Array:
        """Stresses by all strains (s, *lanes), in the order of `_strain_rows`."""
        points, rest = len(self.rule.pulls), strains.shape[1:]
        pull, moments = self.stresses((strains[:points], strains[points:].reshape(3, -1, *rest)))
        return jnp.concatenate([pull, moments.reshape(-1, *rest)])

    def _strain_rows(self, e: LocalCoordinates) -> Float[Array, "13 s *lanes"]:
        """Derivatives of all strains by the local coordinates: of stretch, and then of twist and
        curvatures, point by point."""
        n, at = self.n_elements, self._at(deformation(e, self.n_elements))
        bends = self._by(at.strain_ways(self._moments(at)[0]), at)
        bends = pulled_back(frames(e, n), bends.reshape(10, -1, *e.shape[1:]), n)
        d = map_rows(self.rule.strained, gradients(e))
        rows = self._rows_of(stretched(d) / (1 + elongation(d))[None])
        return compute_once(jnp.concatenate([_padded(rows), bends], 1))

    def _rows_of(self, along: Float[Array, "3 p *lanes"]) -> Float[Array, "9 p *lanes"]:
        """Derivatives by the values of the gradient, of components along vectors at points of
        stretch."""
        table = append_axes(self.rule.strained.T[None], along.ndim - 2)
        return (along[:, None] * table).reshape(9, *along.shape[1:])

    def _geometric(self, e: LocalCoordinates, rates: Array) -> Float[Array, "13 13 *lanes"]:
        """Second derivatives of all strains, times the stresses by these rates."""
        rule, n, lanes = self.rule, self.n_elements, e.ndim - 1
        points = len(rule.pulls)
        d = map_rows(rule.strained, gradients(e))
        size = 1 + elongation(d)
        pull = append_axes(rule.pulls, lanes) * _pulled(self.stretching, rates[:points] / size)
        natural = deformation(e, n)
        at = self._at(natural)
        (_, v, w), *_ = self._moments(at)
        twist, by_v, by_w = self._stiff(rates[points:].reshape(3, -1, *e.shape[1:]))
        moments = jnp.stack([twist, *at.before_turn(by_v, by_w)])
        by = self._by(at.moment_ways(moments, by_v * w - by_w * v), at)
        second = self._fixed(at, moments, by[:, 1])
        bent = pulled_back_tangent(frames(e, n), self._over_points(by[:, 0]), second, n)
        return bent + self._by_pulls(stretched(d) / size[None], -pull, pull)

    def _fixed(self, at: Rotated, moments: Array, on_turn: Array) -> Array:
        """The part of second derivatives that belongs to moments that stay as they are: the change
        of their forces with the turn (10, g)."""
        rule = self.rule
        own, mixed = at.points.second(moments)
        values = compute_once(jnp.stack([own, mixed, mixed.swapaxes(0, 1)], 2))
        values = values.reshape(9, -1, *values.shape[4:])
        along, bend = (table.T for table in (rule.slopes, rule.curvatures))
        pairs = (along, along), (along, bend), (bend, along)
        stack = np.concatenate if isinstance(along, np.ndarray) else jnp.concatenate
        weights = rule.weights[None, None]
        table = stack([weights * a[:, None] * b[None] for a, b in pairs], 2)
        blocks = map_rows(table.reshape(9, -1), values).reshape(3, 3, 3, 3, *values.shape[2:])
        half = _natural(jnp.moveaxis(blocks, 2, 1))  # (7, d, k)
        rest = _natural(jnp.moveaxis(half, 0, 2))
        turns = map_rows((rule.weights[:, None] * rule.angles).T, on_turn)
        rest = jnp.concatenate([rest, turns[:7].swapaxes(0, 1)])
        return compute_once(jnp.concatenate([rest, turns], 1))

    def _stretching(self, e: LocalCoordinates) -> Float[Array, "13 13 *lanes"]:
        """Second derivatives of the energy of stretch, int EA (t t^T + eps (1 - t t^T)) / |r'|."""
        rule, lanes = self.rule, e.ndim - 1
        d = map_rows(rule.strained, gradients(e))
        strain = elongation(d)
        size = 1 + strain
        w = append_axes(rule.pulls, lanes) * _pulled(self.stretching, 1 / size)
        return self._by_pulls(stretched(d) / size[None], w, w * strain)

    def _by_pulls(
        self, t: Float[Array, "3 p *lanes"], w: Array, alike: Array
    ) -> Float[Array, "13 13 *lanes"]:
        """The sum of w t t^T + alike 1 over points of stretch, by the gradients there."""
        rule, lanes = self.rule, t.ndim - 2
        rows = compute_once(self._rows_of(t))
        both = sum_of_products(compute_once(w[None] * rows)[:, None], rows[None], 2, lanes + 1)
        pairs = rule.strained.T[:, None] * rule.strained.T[None]  # (3, 3, p)
        alike = compute_once(map_rows(pairs.reshape(9, -1), alike[None])[0])
        alike = alike.reshape(3, 3, *t.shape[2:])
        ways: Any = append_axes(np.eye(3)[:, None, :, None], lanes)
        both = both + (ways * alike[None, :, None]).reshape(9, 9, *t.shape[2:])
        return jnp.pad(both, ((0, 4), (0, 4), *((0, 0),) * lanes))


def _back(points: Points, loads: Float[Array, "2 4 k g *lanes"]) -> Array:
    """Forces on r' and L r'', from those on changes of these in frames at the points."""
    on_both = sum_of_products(points.rows[None, :, :, None], loads[:, :3, None], 1, loads.ndim - 3)
    return compute_once(jnp.concatenate([on_both, loads[:, 3:]], 1))


def _by_stations(tables: Any, loads: Float[Array, "2 4 k g *lanes"]) -> Array:
    """Derivatives by the stations (4, 3, k, g), from those by what is at the Gauss points."""
    tables = append_axes(tables.swapaxes(2, 3)[:, :, :, None], loads.ndim - 4)
    return sum_of_products(tables, loads[:, :, None], 0, 1)


def _natural(stations: Float[Array, "c 3 *rest"]) -> Float[Array, "n *rest"]:
    """Derivatives by `Natural` from those by stations."""
    return jnp.concatenate([stations[0, :1], stations[:3, 1], stations[:3, 2], *stations[3:]])


def elongation(d: Float[Array, "3 *rest"]) -> Number:
    """|a1 + d| - 1, without cancellation."""
    excess = 2 * d[0] + pairwise_sum(d * d)
    return excess / (1 + jnp.sqrt(1 + excess))


def _padded(x: Float[Array, "9 *lanes"]) -> LocalCoordinates:
    return jnp.pad(x, ((0, 4), *((0, 0),) * (x.ndim - 1)))


def _pulled(stretching: Number | None, x: Array) -> Array:
    return x if stretching is None else stretching * x
