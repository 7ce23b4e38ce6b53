"""What elements of a rod are made of: everything that makes a blade difficult is here, and is
turned into axes of the beam once.

An element has p + 1 nodes at Gauss-Lobatto points and p Gauss points. Displacements and rotations
are Lagrange polynomials through nodes; forces in sections are polynomials of degree p - 1 through
Gauss points, so that compliances are integrated against them: with l_a those through Gauss points
and w_a their weights,

    S = W F^-1 W,   F_ab = int l_a l_b C^-1 ds,   W = diag(w_a),

gives the generalised forces of the strains at Gauss points. Kinks and steps within an element do no
harm to forces, which are smooth. Sections enter turned into axes of the beam by their frames as
they are built; so twist, sweep, kinks and pitch are nowhere else.
"""

import functools
import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from jaxbeam._numerics.linalg import positive_inverse
from jaxbeam._numerics.quaternions import crossing
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.beam_sections import sections_of
from jaxbeam._rotor.ends import PointMass
from jaxbeam._rotor.sections import AbstractSections, frames

A1 = np.eye(3)[0]


@functools.lru_cache(maxsize=64)
def lobatto(degree: int) -> np.ndarray:
    """Gauss-Lobatto points from -1 to 1: the ends, and where the derivative of a Legendre
    polynomial is zero."""
    inside = legendre.legroots(legendre.legder(np.eye(degree + 1)[degree])).real
    return np.array([-1.0, *np.sort(inside).tolist(), 1.0])


@functools.lru_cache(maxsize=64)
def gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points from -1 to 1, and weights."""
    at, weight = legendre.leggauss(points)
    return at, weight


def lagrange(knots: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and slopes at places of polynomials that are one at one knot and zero at others."""
    count = len(knots)
    through = np.linalg.inv(legendre.legvander(knots, count - 1))
    slopes = [legendre.legval(at, legendre.legder(row)) + 0 * at for row in np.eye(count)]
    return legendre.legvander(at, count - 1) @ through, np.stack(slopes, -1) @ through


class Quadrature(eqx.Module):
    """Gauss points of all pieces of elements between edges of properties, element by element, with
    as many for each as for the one that has most; the others are of no weight."""

    places: np.ndarray  # (E, q) shares of the length
    weight: np.ndarray  # (E, q) by the share of the length
    within: np.ndarray  # (E, q) in the element, from -1 to 1

    @classmethod
    def of(cls, ends: tuple[float, ...], edges: tuple[float, ...], degree: int) -> "Quadrature":
        """Points for elements between these ends and properties that are smooth between edges."""
        rows = []
        for start, end in itertools.pairwise(ends):
            near = 1e-9 * (end - start)
            cuts = [start, *(edge for edge in edges if start + near < edge < end - near), end]
            at, weight = gauss(max(degree + 3 - len(cuts), 4))
            pieces = np.array(list(itertools.pairwise(cuts)))
            middle, half = pieces.mean(1)[:, None], np.diff(pieces) / 2
            rows.append(np.stack([(middle + half * at).ravel(), (half * weight).ravel()]))
        most = max(row.shape[1] for row in rows)
        padded = [np.pad(row, ((0, 0), (0, most - row.shape[1])), "edge") for row in rows]
        for row, own in zip(padded, rows, strict=True):
            row[1, own.shape[1] :] = 0.0
        places, weights = np.stack(padded, 1)
        bounds = np.array(list(itertools.pairwise(ends)))
        within = (places - bounds.mean(1)[:, None]) / (np.diff(bounds) / 2)
        return cls(places, weights, within)


class RodTables(eqx.Module):
    """Elements of a rod, E of degree p with E p + 1 nodes, in axes of the beam; sixes are along
    its axes 1, 2, 3, then about them. The order of nodes is that from the root."""

    place: Float[Array, "nodes 3"]  # undeformed, from the centre of the hub, m
    tangent: Float[Array, "E p 3"]  # of the undeformed axis at Gauss points
    rate: Float[Array, "E p k"]  # derivatives of shapes by arc length, k = p + 1, 1/m
    stiffness: Float[Array, "E m m"]  # S, m = 6 p
    lacking: Float[Array, "E m m"]  # what S is less than where strains, not forces, are smooth
    inertia: Float[Array, "E l l"]  # by velocities of nodes, l = 6 k
    weight: Float[Array, "nodes 4"]  # mass and first moment of nodes, for gravity
    tip: Float[Array, "6 6"]  # inertia of the body at the tip
    pace: Float[Array, "E p"]  # arc length by the coordinate from -1 to 1 at Gauss points, m
    ends: tuple[float, ...] = eqx.field(static=True)
    degree: int = eqx.field(static=True)
    # What fibres lengthen by, k_1 being the rate of twist: half the first k_1^2 + the second k_1.
    fibres: tuple[Float[Array, "E p"], Float[Array, "E p"]] | None = None

    @property
    def shapes(self) -> np.ndarray:
        """Values (p, k) of the shapes of nodes at Gauss points."""
        return lagrange(lobatto(self.degree), gauss(self.degree)[0])[0]

    @property
    def elements(self) -> int:
        """The number of elements."""
        return len(self.ends) - 1

    @property
    def node_places(self) -> np.ndarray:
        """Places (n,) of nodes, shares of the length."""
        ends, inner = np.asarray(self.ends), (1 + lobatto(self.degree)[1:]) / 2
        return np.concatenate([[0.0], (ends[:-1, None] + np.diff(ends)[:, None] * inner).ravel()])

    @property
    def gauss_places(self) -> np.ndarray:
        """Places (E p,) of Gauss points, shares of the length."""
        return _within(self.ends, gauss(self.degree)[0]).ravel()

    def of_elements(self, nodes: Array) -> Array:
        """Values of nodes (n, ...), by element (E, k, ...)."""
        p = self.degree
        if self.elements == 1:
            return nodes[None]
        index = np.arange(self.elements)[:, None] * p + np.arange(p + 1)
        return nodes[index]

    def gathered(self, parts: Array) -> Array:
        """Sums (n, ...) at nodes of what elements have there (E, k, ...)."""
        inner = parts[:, 1:-1]
        ends = jnp.concatenate([parts[:, :1], inner], 1).reshape(-1, *parts.shape[2:])
        out = jnp.concatenate([ends, jnp.zeros_like(ends[:1])])
        return out.at[self.degree :: self.degree].add(parts[:, -1])

    def assembled(self, blocks: Float[Array, "E l l"]) -> Float[Array, "N N"]:
        """The matrix (6 n, 6 n) of element matrices."""
        if len(blocks) == 1:
            return blocks[0]
        size, step = blocks.shape[1], 6 * self.degree
        out = jnp.zeros((step * len(blocks) + 6,) * 2, blocks.dtype)
        for e, block in enumerate(blocks):
            out = out.at[e * step : e * step + size, e * step : e * step + size].add(block)
        return out

    def interpolating(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows that interpolate between nodes, as `node_rows` has them."""
        return node_rows(self.ends, self.degree, places)

    def of_gauss(self, values: Float[Array, "E p *k"], places: np.ndarray) -> Array:
        """Values at places (m, ...) of polynomials through Gauss points of elements."""
        where, within = located(self.ends, places)
        rows = lagrange(gauss(self.degree)[0], within)[0]
        return jnp.einsum("mp,mp...->m...", rows, values[where])


def located(ends: tuple[float, ...], places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The element of each place, and where in it, from -1 to 1."""
    bounds = np.asarray(ends)
    where = np.clip(np.searchsorted(bounds, places, side="left") - 1, 0, len(ends) - 2)
    size = np.diff(bounds)[where]
    return where, 2 * (places - bounds[where]) / size - 1


def node_rows(
    ends: tuple[float, ...], degree: int, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Rows (m, n) that make of nodes what is at places, and those of derivatives by the share of
    the length."""
    where, within = located(ends, places)
    value, slope = lagrange(lobatto(degree), within)
    rows, slopes = np.zeros((2, len(places), len(ends[1:]) * degree + 1))
    half = np.diff(ends)[where] / 2
    for m, e in enumerate(where):
        own = slice(e * degree, (e + 1) * degree + 1)
        rows[m, own], slopes[m, own] = value[m], slope[m] / half[m]
    return rows, slopes


def rod_tables(rotor: Rotor, degree: int, ends: tuple[float, ...]) -> RodTables:
    """The elements of a rotor's beam or blade, which end there."""
    sections = sections_of(rotor.beam)
    points = Quadrature.of(ends, sections.edges, degree)
    attitude = turned_by_pitch(rotor)
    flat = points.places.ravel()
    _, slope = sections.axis_at(flat)
    pace = jnp.sqrt(jnp.sum(slope**2, 1))
    frame = attitude[None] @ frames(slope, sections.twist_at(flat))
    length = (pace * points.weight.ravel()).reshape(points.weight.shape)
    shapes, _ = lagrange(lobatto(degree), points.within.ravel())
    forces, _ = lagrange(gauss(degree)[0], points.within.ravel())
    inertia = _turned(sections.inertia_at(flat), frame)
    within = _within(ends, gauss(degree)[0])
    _, at_gauss = sections.axis_at(within.ravel())
    size = jnp.sqrt(jnp.sum(at_gauss**2, 1)).reshape(within.shape)
    half = np.diff(ends)[:, None] / 2
    _, slopes = lagrange(lobatto(degree), gauss(degree)[0])
    nodes = np.concatenate([[0.0], _within(ends, lobatto(degree)[1:]).ravel()])
    mass = _integrated(shapes, inertia, length)
    weight = _weight(inertia)
    weights = half * size * gauss(degree)[1][None]
    by_node = jnp.einsum("eq,eqk,eqw->ekw", length, *(
        a.reshape(*length.shape, -1) for a in (jnp.asarray(shapes), weight)
    ))  # fmt: skip
    soft = _turned(sections.compliance_at(flat), frame)
    stiff = _turned(sections.stiffness_at(flat), frame)
    stiffness = _stiffness(soft, forces, length, weights)
    tables = RodTables(
        place=(attitude @ sections.axis_at(nodes)[0].T).T + _root(rotor)[None],
        tangent=((attitude @ at_gauss.T).T / size.reshape(-1, 1)).reshape(*within.shape, 3),
        rate=jnp.asarray(slopes)[None] / (half * size)[:, :, None],
        stiffness=stiffness,
        lacking=_integrated(forces, stiff, length) - stiffness,
        inertia=mass,
        weight=jnp.zeros((len(nodes), 4)),
        tip=jnp.zeros((6, 6)),
        pace=jnp.asarray(half) * size,
        ends=ends,
        degree=degree,
        fibres=_fibres(sections, points.places, forces, length, weights),
    )  # fmt: skip
    return _with_bodies(tables, rotor, sections, attitude, tables.gathered(by_node))


def _within(ends: tuple[float, ...], at: np.ndarray) -> np.ndarray:
    """Places (E, m) along the blade of points from -1 to 1 in elements."""
    bounds = np.asarray(ends)
    return bounds[:-1, None] + np.diff(bounds)[:, None] * (1 + at) / 2


def _integrated(shapes: np.ndarray, sixes: Array, length: Array) -> Float[Array, "E l l"]:
    """int N_i N_j m ds of sixes at points, element by element."""
    count = shapes.shape[1]
    pairs = (shapes[:, :, None] * shapes[:, None]).reshape(*length.shape, -1)
    each = (length[:, :, None] * pairs).swapaxes(1, 2) @ sixes.reshape(*length.shape, 36)
    blocks = each.reshape(-1, count, count, 6, 6).transpose(0, 1, 3, 2, 4)
    return blocks.reshape(-1, 6 * count, 6 * count)


def _stiffness(
    compliance: Float[Array, "q 6 6"], forces: np.ndarray, length: Array, weight: Array
) -> Float[Array, "E m m"]:
    """Generalised forces by strains at Gauss points."""
    flexible = _integrated(forces, compliance, length)
    # Stretch is stiffer than bending by many powers of ten: rounding would mix them.
    size = jnp.sqrt(jnp.diagonal(flexible, axis1=1, axis2=2))
    each = jnp.repeat(weight, 6, 1) / size
    alike = jax.vmap(positive_inverse)(flexible / (size[:, :, None] * size[:, None]))
    out = each[:, :, None] * alike * each[:, None]
    return (out + out.swapaxes(1, 2)) / 2


def _fibres(
    sections: AbstractSections, places: np.ndarray, forces: np.ndarray, length: Array,
    weight: Array,
) -> tuple[Float[Array, "E p"], Float[Array, "E p"]] | None:  # fmt: skip
    """Means of i^2 and i^2 k_0, as forces in sections, which are polynomials, are affected by
    them."""
    found = sections.fibres_at(places.ravel())
    if found is None:
        return None
    square, rate = (part.reshape(length.shape) for part in found)
    rows = jnp.asarray(forces).reshape(*length.shape, -1)
    first, second = (
        jnp.einsum("eqp,eq,eq->ep", rows, length, part) / weight for part in (square, square * rate)
    )
    return first, second


def _turned(sixes: Float[Array, "q 6 6"], frame: Float[Array, "q 3 3"]) -> Float[Array, "q 6 6"]:
    """Matrices of sections in axes of the beam."""
    parts = sixes.reshape(-1, 2, 3, 2, 3)
    out = jnp.einsum("qab,qxbyc,qdc->qxayd", frame, parts, frame)
    return out.reshape(-1, 6, 6)


def _weight(inertia: Float[Array, "*q 6 6"]) -> Float[Array, "*q 4"]:
    """Mass and first moment of sixes [[m, -m c~], [m c~, J]]."""
    first = [inertia[..., 5, 1], inertia[..., 3, 2], inertia[..., 4, 0]]
    return jnp.stack([inertia[..., 0, 0], *first], -1)


def turned_by_pitch(rotor: Rotor) -> Float[Array, "3 3"]:
    """The rotation by the pitch, from a2 towards a3."""
    angle = rotor.pitch
    if angle is None:
        return jnp.eye(3)
    attitude = jnp.sin(angle) * crossing(jnp.asarray(A1)) + jnp.cos(angle) * np.diag(
        [0.0, 1.0, 1.0]
    )
    return attitude + np.diag(A1)


def beam_axes(rotor: Rotor) -> Float[Array, "3 3"]:
    """Axes of the beam, as rows, in those of the hub."""
    if rotor.precone is None:
        return jnp.eye(3)
    cos, sin = jnp.cos(rotor.precone), jnp.sin(rotor.precone)
    none, one = jnp.zeros_like(cos), jnp.ones_like(cos)
    return jnp.stack([cos, none, sin, none, one, none, -sin, none, cos]).reshape(3, 3)


def _root(rotor: Rotor) -> Float[Array, "3"]:
    """The root in axes of the beam, from the centre of the hub."""
    return beam_axes(rotor)[:, 0] * rotor.hub_radius


def _with_bodies(
    tables: RodTables, rotor: Rotor, sections: AbstractSections, attitude: Array, weight: Array
) -> RodTables:
    """Elements with masses at points and what is at the tip."""
    _, slope = sections.axis_at(np.ones(1))
    frame = attitude[None] @ frames(slope, sections.twist_at(np.ones(1)))
    tip = _turned(_body(rotor)[None], frame)[0]
    weight = weight.at[-1].add(_weight(tip))
    points, inertia = rotor.beam.point_masses, tables.inertia
    if points is not None:
        rows, _ = tables.interpolating(np.asarray(points.places))
        weight = weight.at[:, 0].add(rows.T @ points.masses)
        own = tables.of_elements(jnp.asarray(rows.T)).transpose(0, 2, 1)  # (E, points, k)
        # A node between two elements is in both: a point is in one of them.
        where, _ = located(tables.ends, np.asarray(points.places))
        own = own * (where[None] == np.arange(tables.elements)[:, None])[:, :, None]
        lumps = jnp.einsum("m,emi,emj->eij", points.masses, own, own)
        moves = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        inertia = inertia + jnp.einsum("eij,ab->eiajb", lumps, moves).reshape(inertia.shape)
    return eqx.tree_at(lambda t: (t.inertia, t.weight, t.tip), tables, (inertia, weight, tip))


def _body(rotor: Rotor) -> Float[Array, "6 6"]:
    """The inertia of the mass or body at the tip, about the tip, in axes of the last section."""
    body = rotor.tip_body
    if isinstance(body, PointMass):
        return body.mass * jnp.diag(np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))
    centre, about = body.in_space
    arm = crossing(centre)
    mass, first = body.mass * np.eye(3), body.mass * arm
    return jnp.block([[mass, -first], [first, about - body.mass * arm @ arm]])
