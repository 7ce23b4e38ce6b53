"""Bases for beams as built: with nodes where properties have kinks, and with a root that yields."""

import dataclasses

import numpy as np
from numpy.polynomial import legendre

from jaxbeam._checks import kind_of, known_array
from jaxbeam._models.base import Family, count_functions
from jaxbeam._models.basis import Basis, Functions, Polynomials, Rule, hermite, segments

_Array = np.ndarray


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
        if end == 0:
            return np.zeros(1), np.zeros(1)
        nodes = (*(node for node in self.nodes if node < end), end)
        rule = segments(tuple(np.asarray(nodes) / end), self.degree + 1)
        return end * rule.xi, end * rule.weight

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
