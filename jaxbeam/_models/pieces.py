"""Bases for beams as built: with nodes where properties have kinks, and with a root that yields."""

import dataclasses
import functools
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

from jaxbeam._checks import count_functions, kind_of, known_array
from jaxbeam._models.basis import Basis, Functions, Polynomials, Rule, hermite, segments
from jaxbeam._models.families import Family
from jaxbeam._rotor.beam import Beam, Rotor
from jaxbeam._rotor.spanwise import along, points_within
from jaxbeam._types import Real, is_known

_Array = np.ndarray
_POINTS = 12  # of a segment, at which the compliance of a beam is kept


@dataclasses.dataclass(frozen=True)
class PiecewisePolynomials(Basis):
    """Polynomials of one `degree` between `nodes` (x / L, from 0 to 1): see kinks and steps.

    Bending functions have a continuous slope, those of stretch are continuous. Where a stiffness
    has a step the curvature jumps, and smooth functions converge slowly: with a node at every kink
    (`Beam.edges`) convergence is exponential in the degree. Each piece has the cubic Hermite
    shapes or the straight line of its ends, and above them integrals of Legendre polynomials, which
    vanish there (the p-version; B. Szabo, I. Babuska, Finite Element Analysis, 1991): with e pieces
    e (degree - 1) functions for bending and e degree for stretch, and no other numbers.
    `Hybrid.on(PiecewisePolynomials(beam.edges))` is a model of them.
    """

    nodes: tuple[float, ...]
    degree: int = 8

    def __post_init__(self) -> None:
        nodes = known_array("nodes", self.nodes)
        if nodes.ndim != 1 or nodes.size < 2 or nodes[0] != 0 or nodes[-1] != 1:
            raise ValueError(f"nodes must go from 0 to 1 (x / L), got {self.nodes}")
        if not np.all(np.diff(nodes) > 0):
            raise ValueError(f"nodes must increase, got {self.nodes}")
        count_functions("degree", self.degree, least=3)
        object.__setattr__(self, "nodes", tuple(nodes.tolist()))

    @property
    def sizes(self) -> tuple[int, int, int]:
        pieces = len(self.nodes) - 1
        bending = pieces * (self.degree - 1)
        return pieces * self.degree, bending, bending

    def bending(self, n: int, xi: _Array) -> Functions:
        self._check(n, self.sizes[1])
        return self._assembled(xi, 2)

    def stretch(self, n: int, xi: _Array) -> Functions:
        self._check(n, self.sizes[0])
        return self._assembled(xi, 1)

    def quadrature(self, n: int) -> tuple[_Array, _Array]:
        rule = segments(self.nodes, self.degree + 1)
        return rule.xi, rule.weight

    def rule(self, n: int, edges: tuple[float, ...]) -> Rule:
        every = tuple(np.unique([*self.nodes, *edges]).tolist())
        return segments(every, self.degree + 5)

    def up_to(self, n: int, end: float) -> tuple[_Array, _Array]:
        return _before(self.rule(n, (0.0, end, 1.0)), end)

    def _check(self, n: int, wanted: int) -> None:
        if n != wanted:
            raise ValueError(
                f"this basis has {wanted} functions there, not {n}: make the model by "
                "Hybrid.on(basis), which asks for as many as there are"
            )

    def _assembled(self, xi: _Array, order: int) -> Functions:
        """Functions whose derivatives below `order` are continuous, those of the clamp left out:
        first node by node what nodes have, then piece by piece what is within."""
        xi, nodes = np.asarray(xi, float), np.asarray(self.nodes)
        pieces, inner = nodes.size - 1, self.degree + 1 - 2 * order
        out = np.zeros((3, xi.size, order * nodes.size + pieces * inner))
        where = np.clip(np.searchsorted(nodes, xi, side="right") - 1, 0, pieces - 1)
        for piece in range(pieces):
            rows = np.flatnonzero(where == piece)
            h = nodes[piece + 1] - nodes[piece]
            s = (xi[rows] - nodes[piece]) / h
            ends = np.stack(hermite(s, h) if order == 2 else _line(s, h))
            first, within = order * piece, order * nodes.size + piece * inner
            out[:, rows, first : first + 2 * order] = ends
            if inner:
                out[:, rows, within : within + inner] = _bubbles(s, h, order, inner)
        return Functions(*out[:, :, order:])


def _before(rule: Rule, end: float) -> tuple[_Array, _Array]:
    """Points and weights of a rule up to one of its edges."""
    inside = rule.xi < end
    return rule.xi[inside], rule.weight[inside]


def _line(s: _Array, h: float) -> tuple[_Array, _Array, _Array]:
    """The two straight lines of a piece."""
    slope = np.tile([-1 / h, 1 / h], (s.size, 1))
    return np.stack([1 - s, s], -1), slope, 0 * slope


def _bubbles(s: _Array, h: float, order: int, count: int) -> _Array:
    """Legendre polynomials from degree `order` on, integrated `order` times, with derivatives: they
    vanish with those below `order` at both ends."""
    found = []
    for k in range(order, order + count):
        legend = np.zeros(k + 1)
        legend[k] = np.sqrt(2 * k + 1)
        chain: list[_Array] = [legend]
        for _ in range(order):
            chain.append(legendre.legint(chain[-1], lbnd=-1) / 2)
        chain = chain[::-1]
        while len(chain) < 3:
            chain.append(2 * legendre.legder(chain[-1]))
        # By s times h^order, so that the highest derivative is of order one.
        found.append(
            [h ** (order - d) * legendre.legval(2 * s - 1, c) for d, c in enumerate(chain[:3])]
        )
    return np.stack([np.stack(column, -1) for column in zip(*found, strict=True)])


@dataclasses.dataclass(frozen=True)
class MomentPolynomials(Basis):
    """Functions whose bending moments EI f'' are polynomials, EI being that of a known beam.

    What makes global functions converge slowly in a blade is that its curvature follows every kink
    and step of EI, while its bending moment is smooth: with f'' = P_k / EI a dozen functions do
    what many dozens of `Polynomials` do, and a few more what `PiecewisePolynomials` do with
    hundreds. `MomentPolynomials.of(beam)` takes the stiffness of a beam whose numbers are known, in
    the directions of the hub, its twist included: 1 / EI in the plane is the compliance
    c^2 / EI_zz + s^2 / EI_yy. With twist a moment bends the beam across, too, by the compliance
    (1 / EI_zz - 1 / EI_yy) s c: a quarter of the functions are for that. Beams that differ from it,
    in a sweep or in a fit, are still right, with slower convergence the more they differ. Stretch
    has `Polynomials`.
    """

    edges: tuple[float, ...]
    in_plane: tuple[float, ...]  # compliance at `_POINTS` points of each segment, over its largest
    flap: tuple[float, ...]
    across: tuple[float, ...] | None = None  # of moments about the other axis, with twist
    direction: Family = Family.IN_PLANE

    @classmethod
    def of(cls, beam: Beam, pitch: Real | None = None) -> Self:
        """Functions for a beam, at a pitch in rad; the numbers of both must be known."""
        if not isinstance(beam, Beam):
            raise TypeError(f"beam must be a Beam, got {kind_of(beam)}")
        if not is_known(_bending_of(beam, pitch)):
            raise TypeError(
                "beam and pitch must be known when a program is compiled: give those that you "
                "begin from"
            )
        xi, _ = points_within(beam.edges, _POINTS)
        with jax.ensure_compile_time_eval():  # also within a program that is being compiled
            zz, yy, angle = (
                np.asarray(along(value, xi))
                for value in (
                    beam.in_plane_bending_stiffness, beam.flap_bending_stiffness,
                    jnp.zeros(()) if beam.twist is None else beam.twist,
                )
            )  # fmt: skip
        Rotor(beam, pitch=pitch)  # which says what is wrong with a pitch
        angle = angle if pitch is None else angle + float(pitch)
        c2 = np.cos(angle) ** 2
        each = (c2 / zz + (1 - c2) / yy, c2 / yy + (1 - c2) / zz)
        in_plane, flap = (tuple((a / a.max()).tolist()) for a in each)
        across = (1 / zz - 1 / yy) * np.sin(angle) * np.cos(angle)
        largest = np.abs(across).max()
        if largest < 1e-9 * min(a.max() for a in each):
            return cls(beam.edges, in_plane, flap)
        return cls(beam.edges, in_plane, flap, tuple((across / largest).tolist()))

    def towards(self, family: Family) -> Basis:
        return dataclasses.replace(self, direction=family)

    def bending(self, n: int, xi: _Array) -> Functions:
        xi, edges = np.asarray(xi, float), np.asarray(self.edges)
        where = np.clip(np.searchsorted(edges, xi, side="right") - 1, 0, edges.size - 2)
        start, length = edges[where], np.diff(edges)[where]
        s = 2 * (xi - start) / length - 1
        compliance = self.flap if self.direction == Family.FLAP else self.in_plane
        points = self._points(n, self.edges)
        tables = _from_curvature(self.edges, compliance, self.across, n, points)
        rows = legendre.legvander(s, tables.shape[2] - 1)
        return Functions(*(np.einsum("pk,pkn->pn", rows, table[where]) for table in tables))

    def stretch(self, n: int, xi: _Array) -> Functions:
        return Polynomials().stretch(n, xi)

    def quadrature(self, n: int) -> tuple[_Array, _Array]:
        rule = self.rule(n, self.edges)
        return rule.xi, rule.weight

    def rule(self, n: int, edges: tuple[float, ...]) -> Rule:
        every = tuple(np.unique([*self.edges, *edges]).tolist())
        return segments(every, self._points(n, every))

    def _points(self, n: int, edges: tuple[float, ...]) -> int:
        return max(Polynomials().points(n, edges), _POINTS)

    def up_to(self, n: int, end: float) -> tuple[_Array, _Array]:
        return _before(self.rule(n, (0.0, end, 1.0)), end)


@functools.lru_cache(maxsize=64)
def _from_curvature(
    edges: tuple[float, ...], compliance: tuple[float, ...], across: tuple[float, ...] | None,
    n: int, points: int,
) -> Float[_Array, "3 e m n"]:  # fmt: skip
    """Legendre coefficients, segment by segment, of functions, their slopes and their curvatures:
    polynomials times what `compliance` is between its points, and times what `across` is there."""
    x, _ = legendre.leggauss(points)
    own = np.linalg.inv(legendre.legvander(legendre.leggauss(_POINTS)[0], _POINTS - 1))
    at = legendre.legvander(x, _POINTS - 1) @ own  # from those points to the points of a segment
    length = np.diff(edges)
    xi, weight = points_within(edges, points)
    moments = legendre.legvander(2 * xi - 1, n - 1) * np.sqrt(2 * np.arange(n) + 1)
    curved = (np.reshape(compliance, (-1, _POINTS)) @ at.T).ravel()[:, None] * moments
    if across is not None:
        other = (np.reshape(across, (-1, _POINTS)) @ at.T).ravel()[:, None] * moments[:, : n // 4]
        curved = _independent(np.insert(curved, [n - n // 4], other, axis=1), weight)[:, :n]
    curved = curved.reshape(length.size, points, n)
    chain = [np.linalg.inv(legendre.legvander(x, points - 1)) @ curved]
    for _ in range(2):
        grown = legendre.legint(chain[-1], lbnd=-1, axis=1) * length[:, None, None] / 2
        rise = grown.sum(1)  # Legendre polynomials are one at the end of their interval
        grown[:, 0] += np.cumsum(rise, 0) - rise
        chain.append(grown)
    wide = [np.pad(table, ((0, 0), (0, points + 2 - table.shape[1]), (0, 0))) for table in chain]
    return np.stack(wide[::-1])


def suited(basis: Basis, rotor: Rotor) -> Basis:
    """A basis for what a rotor is: `MomentPolynomials` in the place of `Polynomials` for a beam
    that varies along the span and is known, `Hinged` where the root yields."""
    own = basis.basis if isinstance(basis, Hinged) else basis
    beam = rotor.beam
    known = _has_numbers(_bending_of(beam, rotor.pitch))
    if own == Polynomials() and not beam.is_uniform and known:
        own = MomentPolynomials.of(beam, rotor.pitch)
    if rotor.root is None:
        return own
    return Hinged(own, *(spring is not None for spring in rotor.springs))


def _bending_of(beam: Beam, pitch: Any) -> Any:
    """What the shapes of functions are made of."""
    return beam.in_plane_bending_stiffness, beam.flap_bending_stiffness, beam.twist, pitch


def _has_numbers(tree: Any) -> bool:
    """Whether all leaves are known; of a rotor that only shows what others are like none are."""
    return is_known(tree) and all(hasattr(a, "__array__") for a in jax.tree.leaves(tree))


def _independent(columns: _Array, weight: _Array) -> _Array:
    """An orthonormal basis of what columns span, without those that hardly differ from what the
    ones before them span."""
    root = np.sqrt(weight)[:, None]
    q, r = np.linalg.qr(root * columns)
    left = np.abs(np.diag(r)) / np.linalg.norm(root * columns, axis=0)
    return (q / root)[:, left > 1e-9]


@dataclasses.dataclass(frozen=True)
class Hinged(Basis):
    """The functions of `basis`, and before them x / L, in the directions in which a root yields.

    For rotors with `RootSprings`: in plane, in flap, or both. It counts as one of the functions.
    """

    basis: Basis = dataclasses.field(default_factory=Polynomials)
    in_plane: bool = True
    flap: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.basis, Basis):
            raise TypeError(f"basis must be a Basis, got {kind_of(self.basis)}")

    def towards(self, family: Family) -> Basis:
        yields = self.in_plane if family == Family.IN_PLANE else self.flap
        return Hinged(self.basis, True, True) if yields else self.basis

    @property
    def yields(self) -> bool:
        return True

    @property
    def sizes(self) -> tuple[int, int, int] | None:
        if self.basis.sizes is None:
            return None
        stretch, in_plane, flap = self.basis.sizes
        return stretch, in_plane + self.in_plane, flap + self.flap

    def bending(self, n: int, xi: _Array) -> Functions:
        xi = np.asarray(xi, float)
        own = Functions(xi[:, None], np.ones((xi.size, 1)), np.zeros((xi.size, 1)))
        if n == 1:
            return own
        parts = zip(own, self.basis.bending(n - 1, xi), strict=True)
        return Functions(*(np.concatenate(same, 1) for same in parts))

    def stretch(self, n: int, xi: _Array) -> Functions:
        return self.basis.stretch(n, xi)

    def quadrature(self, n: int) -> tuple[_Array, _Array]:
        return self.basis.quadrature(n)

    def rule(self, n: int, edges: tuple[float, ...]) -> Rule:
        return self.basis.rule(n, edges)

    def up_to(self, n: int, end: float) -> tuple[_Array, _Array]:
        return self.basis.up_to(n, end)
