"""A blade of full sections about a curved axis."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._checks import real_array, shaped_array
from jaxbeam._numerics.small import inverses
from jaxbeam._numerics.splines import spline_rows
from jaxbeam._rotor.beam import Beam
from jaxbeam._rotor.beam_sections import BeamSections, sections_of
from jaxbeam._rotor.parameters import FULL_TURN, Parameters, optional, parameter, whole
from jaxbeam._rotor.points import PointMasses
from jaxbeam._rotor.sections import (
    AbstractSections,
    Places,
    full_matrices,
    unsymmetric,
    upper_triangles,
)
from jaxbeam._rotor.spanwise import (
    AbstractSpanwise,
    Spanwise,
    between,
    checked_stations,
    points_within,
    steps_of,
)
from jaxbeam._status import Status
from jaxbeam._types import Number, Scalar, is_concrete

_POINTS = 6  # of each piece, at which the length of the axis is integrated
_BESIDE = 1e-3  # of the length, from a kink of the twist of a beam to points of the axis
_NEAR = 1e-5  # of the length, to either side, for how the direction of the axis goes on


@jax.jit
def is_stiffness(rows: Float[Array, "n 21"]) -> Bool[Array, ""]:
    """Whether all stiffness matrices, given as upper triangles, are positive definite."""
    matrices = full_matrices(rows)
    size = jnp.sqrt(jnp.diagonal(matrices, axis1=1, axis2=2))
    scaled = matrices / (size[:, :, None] * size[:, None])
    return jnp.all(jnp.isfinite(jnp.linalg.cholesky(scaled)))


@jax.jit
def is_inertia(rows: Float[Array, "n 21"]) -> Bool[Array, ""]:
    """Whether all inertia matrices, given as upper triangles, have a positive mass and no negative
    moment of inertia."""
    each = jnp.diagonal(full_matrices(rows), axis1=1, axis2=2)
    return jnp.all(jnp.isfinite(rows)) & jnp.all(each[:, :3] > 0) & jnp.all(each[:, 3:] >= 0)


@jax.jit
def is_axis(points: Float[Array, "k 3"]) -> Bool[Array, ""]:
    """Whether all points of an axis are finite, and neighbours are apart."""
    steps = jnp.diff(points, axis=0)
    return jnp.all(jnp.isfinite(points)) & jnp.all(jnp.sum(steps * steps, 1) > 0)


class Blade(Parameters, AbstractSections):
    """A blade as it is built: full sections about an axis that may be curved, swept and twisted.

    | field         | meaning                                                      | unit      |
    |---------------|--------------------------------------------------------------|-----------|
    | stations      | (n,) places of sections along the axis, from 0 at the root   |           |
    |               | to 1, as shares of its length; two that are equal are a step |           |
    | stiffness     | (n, 6, 6), symmetric and positive definite                   | N, N m,   |
    |               |                                                              | N m^2     |
    | inertia       | (n, 6, 6), symmetric, by length                              | kg/m, kg, |
    |               |                                                              | kg m      |
    | axis          | (k, 3) points of the reference axis, from the root of the    | m         |
    |               | hub; or its length, of a straight one                        |           |
    | twist         | (k,) angle of the sections about the axis; None: zero        | rad       |
    | axis_stations | (k,) places of these points; None: evenly spaced             |           |
    | kinks         | places of points at which the axis has a kink                |           |
    | point_masses  | `PointMasses` on the axis, or None                           |           |
    | gyration      | (n,) or a number: polar radius of gyration of the stiffness; | m         |
    |               | None: fibres do not lengthen where sections twist            |           |

    **Axes of the blade** are a1 along the blade at its root, a2 in the plane of rotation, the way
    that it turns (the leading edge), and a3 along the axis of rotation: those of the hub, which
    `precone` and `pitch` of the rotor turn. A section stands across the axis. Its first axis is the
    tangent; without twist its third one is across a2, and twist turns the second from a2 towards
    a3, as `Beam.twist` does.

    **Order** of sixes, in the axes of the section: along it, shear along the second and the third
    axis, torsion, bending about the second axis (flap) and about the third one (in plane). The
    **reference point** is where the axis goes through the section. With m the mass by length, c the
    place of its centre across and J the moments of inertia about the reference point, an inertia is
    [[m, -m c~], [m c~, J]], c~ the matrix of b -> c x b.

    **Fibres** along the axis become helices about it where sections twist: with `gyration` i, of
    which i^2 = int E (y^2 + z^2) dA / EA, y and z from the axis, k_0 the rate of twist as built and
    k_1 what is added, their mean strain is

        eps + i^2 ((k_0 + k_1)^2 - k_0^2) / 2

    where eps is that of the axis, and takes its place in the law of the section. So tension T
    stiffens torsion, to GJ + T i^2, and untwists what is twisted as built, by the moment -T i^2 k_0
    (the trapeze or Wagner effect; M. A. Biot, Journal of Applied Physics 10, 1939). What belongs to
    the stiffness is what differences of strain between fibres do, E (int r^4 dA - i^4 A) k_0^2
    beside GJ, and warping. Where it has the coupling of stretch with torsion by k_0 already, as
    that of VABS for a section with a twist, the linear part would count twice: give no `gyration`.

    `stiffness` and `inertia` are linear from station to station; the axis and the twist are cubic
    splines ("not a knot") between kinks, whose length is that of the curve. What is given may also
    be (n, 21): the upper triangle of each matrix, row by row, which is how fields hold it; or one
    matrix for all stations. `section_stiffness` and `section_inertia` make them of engineering
    numbers. All but places can be swept, fitted and differentiated. `SpatialRod` takes all
    of it; for other models see `beam`.

    Raises `TypeError` for what are no real numbers, and `ValueError` for what is not allowed, and
    for matrices that are not symmetric.
    """

    stations: tuple[float, ...] = eqx.field(static=True)
    axis_stations: tuple[float, ...] = eqx.field(static=True)
    kinks: tuple[float, ...] = eqx.field(static=True)
    stiffness: Float[Array, "n 21"] = whole(Status.INVALID_SECTION_STIFFNESS, is_stiffness)
    inertia: Float[Array, "n 21"] = whole(Status.INVALID_SECTION_INERTIA, is_inertia)
    axis: Float[Array, "k 3"] = whole(Status.INVALID_AXIS, is_axis)
    twist: Float[Array, " k"] = parameter(Status.INVALID_TWIST, zero=None, most=FULL_TURN)
    point_masses: PointMasses | None = None
    gyration: Float[Array, " n"] | None = optional(Status.INVALID_GYRATION, zero=True)

    def __init__(
        self, stations: Sequence[float], stiffness: Any, inertia: Any, axis: Any,
        twist: Any = None, axis_stations: Sequence[float] | None = None,
        kinks: Sequence[float] = (), point_masses: PointMasses | None = None,
        gyration: Any = None,
    ) -> None:  # fmt: skip
        self.stations = checked_stations("stations", stations)
        self.stiffness = _sixes("stiffness", stiffness, len(self.stations))
        self.inertia = _sixes("inertia", inertia, len(self.stations))
        points = real_array("axis", axis)
        if points.ndim == 0:
            points = points[None, None] * np.eye(2, 3, -1)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
            raise ValueError(
                f"axis must be a length or two and more points (k, 3), got shape {points.shape}"
            )
        self.axis, count = points, len(points)
        places = np.linspace(0.0, 1.0, count) if axis_stations is None else axis_stations
        self.axis_stations = checked_stations("axis_stations", places, steps=False)
        if len(self.axis_stations) != count:
            raise ValueError(
                f"axis_stations must be as many as points of the axis, {count}, got "
                f"{len(self.axis_stations)}"
            )
        twist = jnp.zeros(count) if twist is None else twist
        self.twist = shaped_array("twist", twist, (count,), ", one for each point of the axis")
        self.kinks = tuple(float(kink) for kink in kinks)
        if not set(self.kinks) <= set(self.axis_stations[1:-1]):
            raise ValueError(
                f"kinks must be among the inner axis_stations, {self.axis_stations[1:-1]}, got "
                f"{self.kinks}"
            )
        self.point_masses = point_masses
        self.gyration = None
        if gyration is not None:
            radius, count = real_array("gyration", gyration), len(self.stations)
            if radius.shape not in ((), (count,)):
                raise ValueError(
                    f"gyration must be a number or ({count},), one for each station, got shape "
                    f"{radius.shape}"
                )
            self.gyration = jnp.broadcast_to(radius, (count,))

    @classmethod
    def of(cls, beam: Beam, stations: Sequence[float] | None = None) -> Self:
        """The blade that has the properties of a `Beam`: straight, with diagonal sections.

        `stations` (n,) are places of sections and of points of the axis: by default those of the
        beam's tables, 33 more if a property is a function or the twist varies, and two beside each
        kink of the twist, which is smooth in a blade. Shear, which a `Beam` has not, gets a large
        stiffness, and `polar_inertia` is divided in the ratio of the bending stiffnesses. Raises
        `ValueError` unless the beam has its `torsional_stiffness`, and for a twist that jumps.
        """
        if beam.torsional_stiffness is None:
            raise ValueError("beam.torsional_stiffness: a blade needs it: give GJ in N m^2")
        jumps = beam.twist.steps if isinstance(beam.twist, AbstractSpanwise) else ()
        if jumps:
            raise ValueError(
                f"beam.twist: the twist of a blade does not jump, as it does at {jumps}"
            )
        sections = sections_of(beam)
        places = np.asarray(_stations_of(beam) if stations is None else stations, float)
        is_step = np.concatenate([places[:-1] == places[1:], [False]])
        beside_steps = places + 1e-12 * (np.roll(is_step, 1).astype(float) - is_step)
        inner = np.unique(places)
        line, _ = sections.axis_at(inner)
        return cls(
            places.tolist(),
            sections.stiffness_at(beside_steps),
            sections.inertia_at(beside_steps),
            line,
            sections.twist_at(inner),
            inner.tolist(),
            point_masses=beam.point_masses,
        )

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(sorted({*steps_of(self.stations), *self.kinks}))

    @property
    def edges(self) -> tuple[float, ...]:
        return tuple(sorted({*self.stations, *self.kinks}))

    def axis_at(self, places: Places) -> tuple[Float[Array, "m 3"], Float[Array, "m 3"]]:
        value, slope = (jnp.asarray(rows) for rows in self._spline(places))
        return value @ self.axis, slope @ self.axis

    def twist_at(self, places: Places) -> Float[Array, " m"]:
        angle: Any = self._spline(places)[0] @ self.twist
        return angle

    def fibres_at(self, places: Places) -> tuple[Float[Array, " m"], Float[Array, " m"]] | None:
        if self.gyration is None:
            return None
        radius: Any = self._linear(places) @ self.gyration
        _, slope = self.axis_at(places)
        # A curved axis turns its sections, too, since their third axis stays across a2.
        before, after = (self.axis_at(places + side)[1] for side in (-_NEAR, _NEAR))
        across = before[:, 0] * after[:, 2] - before[:, 2] * after[:, 0]
        along = before[:, 0] * after[:, 0] + before[:, 2] * after[:, 2]
        length_rate = jnp.sqrt(jnp.sum(slope**2, 1))
        rising = slope[:, 1] / length_rate * jnp.arctan2(across, along) / (2 * _NEAR)
        rate: Any = (jnp.asarray(self._spline(places)[1]) @ self.twist - rising) / length_rate
        return radius**2, rate

    def stiffness_at(self, places: Places) -> Float[Array, "m 6 6"]:
        return full_matrices(self._linear(places) @ self.stiffness)

    def _linear(self, places: Places) -> Float[Array, "m n"]:
        """The matrix from values at n stations to values at m places, linear between them."""
        left, share = between(self.stations, places)
        unit = np.eye(len(self.stations))
        return jnp.asarray((1 - share)[:, None] * unit[left] + share[:, None] * unit[left + 1])

    def _spline(self, places: Places) -> tuple[np.ndarray, np.ndarray]:
        """The matrices from values at points of the axis to values and to slopes at places."""
        knots, count = np.asarray(self.axis_stations), len(self.axis_stations)
        ends = [0, *(self.axis_stations.index(kink) for kink in self.kinks), count - 1]
        value, slope = np.zeros((2, len(places), count))
        for start, end in itertools.pairwise(ends):
            inside = (places >= knots[start]) | (start == 0)
            piece = slice(start, end + 1)
            rows = spline_rows(knots[piece], places[inside])
            value[inside], slope[inside] = 0.0, 0.0
            value[inside, piece], slope[inside, piece] = rows
        return value, slope

    def compliance_at(self, places: Places) -> Float[Array, "m 6 6"]:
        return inverses(self.stiffness_at(places))

    def inertia_at(self, places: Places) -> Float[Array, "m 6 6"]:
        return full_matrices(self._linear(places) @ self.inertia)

    @property
    def length(self) -> Scalar:
        """Length of the axis, in m."""
        places, weight = points_within((0.0, *self.axis_stations[1:-1], 1.0), _POINTS)
        _, slope = self.axis_at(places)
        length: Any = weight @ jnp.sqrt(jnp.sum(slope**2, 1))
        return length

    is_uniform = False  # a blade always counts as varying
    span_features = ("blade",)

    def _given(self) -> Iterator[tuple[str, Mapping[str, Any]]]:
        yield from super()._given()
        yield "torsional_stiffness", {"of_torsion": True}  # every section has one

    @property
    def mean(self) -> Beam:
        """The uniform beam whose properties are the means of the reduced `beam` over the span."""
        return self.beam().mean

    @property
    def mass(self) -> Number:
        """Mass of the blade with its point masses, in kg."""
        places, weight = points_within(self.edges, _POINTS)
        _, slope = self.axis_at(places)
        density = self.inertia_at(places)[:, 0, 0] * jnp.sqrt(jnp.sum(slope**2, 1))
        more = 0.0 if self.point_masses is None else jnp.sum(self.point_masses.masses)
        return jnp.asarray(weight) @ density + more

    @property
    def frequency_scale(self) -> Number:
        """The frequency scale of the reduced `beam`, in rad/s."""
        return self.mean.frequency_scale

    def beam(self) -> Beam:
        """The straight beam with the stiffnesses of the sections along their own axes, for models
        that know no more.

        The length is that of the axis. Compliances of stretch, torsion and bending alone make EA,
        GJ and the two EI, the latter about the axes in which they are not coupled, to which `twist`
        turns; of inertia the mass by length is kept and the moment about the centre of mass (the
        whole mass too where points of the axis are at shares of its length of arc). That leaves out
        couplings, offsets, shear, the curve of the axis and `gyration`: how much the first four are
        of the lowest frequencies says `jaxbeam.blades.reduction`.
        """
        more = set(self.axis_stations) - set(self.stations)
        stations = sorted([*self.stations, *more])
        places = np.asarray(stations)
        # A step has two equal stations: the first takes values before it, the second after it.
        is_step = np.concatenate([places[:-1] == places[1:], [False]])
        beside_steps = places + 1e-12 * (np.roll(is_step, 1).astype(float) - is_step)
        f = inverses(self.stiffness_at(beside_steps))
        about2, about3, coupling = f[:, 4, 4], f[:, 5, 5], f[:, 4, 5]
        difference = about2 - about3
        # Principal axes nearest to axes of the section, or these themselves if bending is
        # isotropic.
        sign, isotropic = jnp.where(difference < 0, -1.0, 1.0), (coupling == 0) & (difference == 0)
        across, along = (
            jnp.where(isotropic, 0.0, sign * 2 * coupling),
            jnp.where(isotropic, 1.0, sign * difference),
        )
        half = jnp.where(isotropic, 0.0, sign * jnp.hypot(across, along) / 2)
        middle = (about2 + about3) / 2
        m = self.inertia_at(beside_steps)
        mass, first = m[:, 0, 0], jnp.stack([m[:, 0, 4], m[:, 0, 5]])
        columns = {
            "mass_per_length": mass,
            "axial_stiffness": 1 / f[:, 0, 0],
            "in_plane_bending_stiffness": 1 / (middle - half),
            "flap_bending_stiffness": 1 / (middle + half),
            "twist": self.twist_at(beside_steps) + jnp.arctan2(across, along) / 2,
            "torsional_stiffness": 1 / f[:, 3, 3],
            "polar_inertia": m[:, 3, 3] - jnp.sum(first**2, 0) / mass,
        }
        tables: Any = {name: Spanwise(stations, rows) for name, rows in columns.items()}
        return Beam(self.length, point_masses=self.point_masses, **tables)


def _stations_of(beam: Beam) -> list[float]:
    """Places for sections of a beam: stations of its tables, twice where one has a step, and more
    for functions and for twist."""
    sections = BeamSections(beam)
    places, twist = {*sections.edges}, beam.twist
    if sections.has_functions or isinstance(twist, AbstractSpanwise):
        places |= set(np.linspace(0, 1, 33).tolist())
    if isinstance(twist, AbstractSpanwise):
        places |= {kink + side for kink in twist.kinks for side in (-_BESIDE, _BESIDE)}
    return sorted([*(place for place in places if 0 <= place <= 1), *sections.breaks])


def _sixes(name: str, given: Any, count: int) -> Float[Array, "n 21"]:
    """An argument as `count` upper triangles of symmetric matrices of six by six, checked."""
    rows = real_array(name, given)
    if rows.shape == (6, 6):
        rows = jnp.broadcast_to(rows, (count, 6, 6))
    if rows.shape == (count, 21):
        return rows
    if rows.shape != (count, 6, 6):
        raise ValueError(
            f"{name} must have shape ({count}, 6, 6), a matrix for each station, or ({count}, 21), "
            f"got {rows.shape}"
        )
    if is_concrete(rows) and (found := unsymmetric(np.asarray(rows))) is not None:
        station, row, column = found
        raise ValueError(
            f"{name} must be symmetric, got {rows[station, row, column]} and "
            f"{rows[station, column, row]} in rows {row + 1} and {column + 1} at station "
            f"{station + 1}"
        )
    return upper_triangles(rows)
