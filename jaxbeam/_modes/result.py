"""Modes of one case, or of a batch."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Inexact, Int

from jaxbeam._checks import check_kind, places
from jaxbeam._models.bases.shapes import Shapes
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.loaded import Conditions
from jaxbeam._modes.section_loads import modal_loads
from jaxbeam._modes.shapes import ShapePolynomials, fit
from jaxbeam._programs.program import Program
from jaxbeam._results import InHertz, asked_with, harmless, nan_unless, per_case
from jaxbeam._rotor.beam import AnyRotor, Beam, Rotor
from jaxbeam._rotor.directions import Direction, Label
from jaxbeam._rotor.span import polar_inertia
from jaxbeam._rotor.spanwise import along, points_within
from jaxbeam._status import Status
from jaxbeam._types import Code, Scalar, Vectors


class Modes(InHertz, eqx.Module):
    """k modes x e^(lambda t) of M q'' + G q' + K q = 0 with n coordinates, damping being part of G.

    | field           | shape  | unit  |                                                           |
    |-----------------|--------|-------|-----------------------------------------------------------|
    | eigenvalue      | (k,)   | rad/s | lambda = growth_rate + i frequency, frequency >= 0        |
    | shape           | (k, n) | *     | x, scaled to unit modal mass; while stable the axial part |
    |                 |        |       | (of coned beams that of flap) is imaginary, the rest      |
    |                 |        |       | real; under loads or with damping it is of any phase, and |
    |                 |        |       | x^H M x = 1                                               |
    | direction       | (k,)   |       | `Direction` of the mode as an integer                     |
    | number          | (k,)   |       | its number within the direction, from 1                   |
    | energy_share    | (k, 4) |       | share of kinetic energy by `Direction`                    |
    | residual        | (k,)   |       | backward error: norm(Q x) / ((abs(lambda)^2 norm(M) +     |
    |                 |        |       | abs(lambda) norm(G) + norm(K)) norm(x))                   |
    | status          | ()     |       | `Status`; unless OK the numbers are NaN, but for residual |
    | steady_strain   | ()     |       | see `LinearSystem`                                        |
    | frequency_error | (k,)   |       | estimate of what functions and quadrature leave out of    |
    |                 |        |       | lambda, relative; above 1e-3 the status says so, of a     |
    |                 |        |       | uniform beam where numbers of functions are those of the  |
    |                 |        |       | class. Of `SpatialRod` by how much it would rise if       |
    |                 |        |       | strains, not forces, were polynomials: much more than the |
    |                 |        |       | error where properties have kinks; above 0.1 the status   |
    |                 |        |       | says so. None of other elements, of coned beams, about    |
    |                 |        |       | loaded states, and on uniform beams but for `Hybrid` and  |
    |                 |        |       | `Classical` with `Polynomials` or `Layered`               |
    | model           |        |       | whose modes they are: of soft beams it may be one with    |
    |                 |        |       | other functions than were given; part of no table         |
    | rotor           |        |       | whose modes they are, as it was given; part of no table   |
    | angular_speed   | ()     | rad/s | of the hub, as it was given; part of no table             |
    | conditions      |        |       | loads and damping, None without; part of no table         |

    (*) kg^-1/2 for coordinates in metres.

    **Labels** do not depend on how a speed was reached. Without Coriolis coupling the modes at any
    speed move in one direction each, and those of one have simple frequencies that never cross, so
    that their numbers mean something. A coupled mode takes the label of the uncoupled mode *at the
    same speed* in which it has most of its kinetic energy, each label given once. Through a
    crossing or a veering a label therefore stays with the kind of motion; inside a veering it
    changes branch where the two branches share the motion equally. About a state that is bent, or
    of a rod, the uncoupled modes of bending take axial motion along, those of torsion all else;
    directions are those of the hub, and numbers within each go by frequency. The position among
    the in-plane and axial modes in order of frequency is the label that follows a branch instead.
    """

    eigenvalue: Complex[Array, " k"]
    shape: Vectors
    direction: Int[Array, " k"]
    number: Int[Array, " k"]
    energy_share: Float[Array, "k 4"]
    residual: Float[Array, " k"]
    status: Code
    steady_strain: Scalar
    frequency_error: Float[Array, " k"] | None = None
    model: AbstractModel | None = eqx.field(static=True, default=None)
    rotor: AnyRotor | None = asked_with()
    angular_speed: Scalar | None = asked_with()
    conditions: Conditions | None = asked_with()

    @property
    def frequency(self) -> Float[Array, "... k"]:
        """Im(lambda) in rad/s; zero for a mode that diverges."""
        return self.eigenvalue.imag

    @property
    def growth_rate(self) -> Float[Array, "... k"]:
        """Re(lambda) in 1/s: positive for a mode that grows."""
        return self.eigenvalue.real

    @property
    def damping_ratio(self) -> Float[Array, "... k"]:
        """-Re(lambda) / |lambda|, of critical damping; negative for a mode that grows, NaN for a
        motion that nothing holds."""
        return -self.eigenvalue.real / jnp.abs(self.eigenvalue)

    @property
    def labels(self) -> tuple[Label, ...]:
        """Labels of the modes, once their values are known (not under `jit`); of a batch a tuple
        of these for each case."""
        return _named(np.asarray(self.direction), np.asarray(self.number))

    @per_case
    def displacement(self, xi: Any = 1.0, *, tip: bool = False) -> Complex[Array, "... k p 3"]:
        """Amplitudes of modes along the span: axial, in plane and flap, to first order.

        They are at x = `xi` L, one number or p of them from 0 to 1; the motion is the real part of
        these times e^(lambda t).

        Of unit modal mass, in kg^-1/2; with `tip` such that the displacement of the tip in the
        mode's own direction is one, of modes of torsion L times the angle there. Differentiable,
        and under `jit` and `vmap`; of a batch with its axes in front.

        Raises `ValueError` for points out of range, and `TypeError` for traced ones.
        """
        asked, points = _asked(self), places(xi)
        table = asked.model.displacement(points, asked.rotor)
        return nan_unless(asked.fine, jnp.einsum("cpn,kn->kpc", table, asked.shapes(tip)))

    @per_case
    def torsion(self, xi: Any = 1.0, *, tip: bool = False) -> Complex[Array, "... k p"]:
        """L times the angle of torsion at `xi`, as in `displacement`, with the same `tip`, units
        and errors: zero but of models in space."""
        asked, points = _asked(self), places(xi)
        return nan_unless(
            asked.fine, asked.shapes(tip) @ asked.model.torsion(points, asked.rotor).T
        )

    @per_case
    def section_force(self, xi: Any = 0.0, *, tip: bool = False) -> Complex[Array, "... k p 3"]:
        """Forces in sections at `xi` that go with modes: tension, shear in plane, shear in flap.

        From equilibrium, and in the axes of sections, as `section_moment`. `tip` and batches are as
        in `displacement`; of unit modal mass in N kg^-1/2, with `tip` in N/m.

        Raises `ValueError` for points out of range, a `SpringRotor`, which has no sections, and a
        pre-cone in `Hybrid`; and `TypeError` for traced points.
        """
        return self._section_loads(xi, tip)[0]

    @per_case
    def section_moment(self, xi: Any = 0.0, *, tip: bool = False) -> Complex[Array, "... k p 3"]:
        """Modal moments in sections at `xi`: of torsion, of bending in plane, of bending in flap.

        By so much, times e^(lambda t), the moment in a section differs from that of the steady
        state, in the axes of the section, which turn with it (see `Simulation.section_moment`): it
        is of the inertia of the mode outboard, and of what steady forces, tension above all, do on
        the beam that it bends. So it is as accurate as the shape, where EI times its curvature is
        not. `Classical` leaves that of tension out of its modes, and has it here. `tip` and batches
        are as in `displacement`; of unit modal mass in N m kg^-1/2, with `tip` in N.

        Raises `ValueError` for points out of range, a `SpringRotor`, which has no sections, and a
        pre-cone in `Hybrid`; and `TypeError` for traced points.
        """
        return self._section_loads(xi, tip)[1]

    def _section_loads(self, xi: Any, tip: bool) -> Any:
        asked, points = _asked(self), tuple(places(xi).tolist())
        speed, conditions = harmless(asked.fine, (self.angular_speed, self.conditions))
        value = harmless(asked.fine, self.eigenvalue)
        about = asked.model, asked.rotor, speed, conditions
        return nan_unless(asked.fine, modal_loads(*about, value, asked.shapes(tip), points))

    def polynomials(self) -> ShapePolynomials:
        """The shapes of bending modes as ElastoDyn (OpenFAST) takes them: c_2 xi^2 + ... + c_6 xi^6
        by least squares over the span, scaled to c_2 + ... + c_6 = 1.

        They are fitted to the deflection in the mode's own direction, in plane or flap. Of sections
        that are turned ElastoDyn takes a shape p as a curvature p'' about their axes, and adds up
        what it does in both directions: with twist, p is the one for which that comes next to the
        deflection both ways. It turns the whole blade by its own pitch, so that shapes are those of
        a rotor without one. Value and slope at the root are zero, so that shapes of a root that
        yields do not fit: look at `misfit`, which for clamped blades is 1e-3 or so.
        `jaxbeam.blades.write_elastodyn` writes them into a file.

        Raises `ValueError` for a rotor with a pitch.
        """
        if self.rotor is not None and self.rotor.pitch is not None:
            raise ValueError(
                "rotor.pitch must be None for shapes of modes, since ElastoDyn turns the blade by "
                "a pitch of its own: take the modes of the rotor without its pitch"
            )
        return _polynomials(self)

    def mac(self, other: "Modes") -> Float[Array, "... k m"]:
        """The modal assurance criterion between each of the k modes and the m of another result:
        how alike their shapes are, from 0 to 1, whatever their phase and scale.

        MAC_ij = abs(<u_i, v_j>)^2 / (<u_i, u_i> <v_j, v_j>) with <u, v> = int rho conj(u) . v dx +
        m_t conj(u(L)) . v(L) + int J conj(theta_u) theta_v dx of the displacements u, v, and the
        angles of torsion theta, that both have at the same x / L, complex or not. The masses rho
        and m_t and the polar inertia J are those of the rotor of the first. Both may be of
        different models, speeds and rotors. One is the same shape; zero are two modes of one beam
        at rest, since they are orthogonal (but for the turning of a body at its tip).

        `other` are `Modes`, of one case or of a batch with the same axes. NaN where a case failed.
        Differentiable, and under `jit` and `vmap`. R. J. Allemang, D. L. Brown, A correlation
        coefficient for modal vector analysis, Proc. 1st IMAC, 1982.

        Raises `TypeError` for what are no modes, and `ValueError` for batches of unlike shapes and
        where one is of a beam and the other of a `SpringRotor`.
        """
        check_kind("other", other, Modes)
        if not jnp.ndim(other.status):
            return _mac(self, other)
        if not jnp.ndim(self.status):
            return _mac_of_batch(other, self)
        if jnp.shape(self.status) != jnp.shape(other.status):
            shapes = f"{jnp.shape(self.status)} and {jnp.shape(other.status)}"
            raise ValueError(f"other: batches must have the same axes, got {shapes}")
        return _Two(self, other, self.status).mac()


class _Two(eqx.Module):
    """Modes of two batches of the same axes, as one batch of pairs."""

    first: Modes
    second: Modes
    status: Code

    @per_case
    def mac(self) -> Float[Array, "k m"]:
        return _mac(self.first, self.second)


class _Asked(NamedTuple):
    """Modes of one case for methods of `Modes`, with harmless numbers where the case failed, that
    is where it is not `fine`."""

    model: AbstractModel
    rotor: AnyRotor
    shape: Vectors
    direction: Int[Array, " k"]
    fine: Array

    def shapes(self, tip: bool) -> Vectors:
        """Shapes (k, n), with `tip` divided by the motion of the tip in the direction of each."""
        if not tip:
            return self.shape
        return self.shape / own_tip(self.model, self.rotor, self.shape, self.direction)[:, None]


def _asked(modes: Modes) -> _Asked:
    if modes.model is None or modes.rotor is None:
        raise ValueError(
            "these modes do not say of which model and rotor they are: take those of modes()"
        )
    fine = modes.status == Status.OK
    rotor, shape = harmless(fine, modes.rotor), harmless(fine, modes.shape)
    return _Asked(modes.model, rotor, shape, modes.direction, fine)


@Program
@per_case
def _polynomials(modes: Modes) -> ShapePolynomials:
    asked = _asked(modes)
    direction = asked.direction
    is_bending = (direction == Direction.IN_PLANE) | (direction == Direction.FLAP)
    bent = jnp.where(is_bending[:, None], asked.shapes(True), 1.0).real
    places = fit(asked.rotor)
    table = asked.model.displacement(places.xi, asked.rotor)
    in_plane, flap = (bent @ table[axis].T for axis in (1, 2))
    is_flap = (direction == Direction.FLAP)[:, None]
    # A turned section has the first axis partly in flap, the second partly against in plane.
    main, across = jnp.where(is_flap, flap, in_plane), jnp.where(is_flap, -in_plane, flap)
    polynomials = jax.vmap(places.fitted)(main, across)
    return ShapePolynomials(*nan_unless(is_bending & asked.fine, polynomials))


@Program
@per_case
def _mac_of_batch(other: Modes, modes: Modes) -> Float[Array, "k m"]:
    return _mac(modes, other)


@Program
@per_case
def _mac(modes: Modes, other: Modes) -> Float[Array, "k m"]:
    first, second = _asked(modes), _asked(other)
    if type(first.rotor) is not type(second.rotor):
        raise ValueError("other must be modes of the same kind of rotor")
    xi, mass, polar = _masses(first.rotor)
    (u, a), (v, b) = (
        (
            jnp.einsum("cpn,kn->kpc", each.model.displacement(xi, each.rotor), each.shape),
            each.shape @ each.model.torsion(xi, each.rotor).T / each.rotor.length,
        )
        for each in (first, second)
    )

    def product(u: Array, v: Array, a: Array, b: Array) -> Array:
        moved = jnp.einsum("kpc,mpc,p->km", u.conj(), v, mass)
        return moved + jnp.einsum("kp,mp,p->km", a.conj(), b, polar)

    products = jnp.abs(product(u, v, a, b)) ** 2
    lengths = (jnp.diagonal(product(w, w, c, c)).real for w, c in ((u, a), (v, b)))
    norms = jnp.outer(*lengths)
    return nan_unless(first.fine & second.fine, products / norms)


def _masses(rotor: AnyRotor) -> tuple[np.ndarray, Array, Array]:
    """Places x / L, and the mass (kg) and the polar inertia (kg m^2) at each."""
    if not isinstance(rotor, Rotor):
        return np.ones(1), rotor.mass[None], jnp.zeros(1)
    beam = rotor.beam if isinstance(rotor.beam, Beam) else rotor.beam.beam()
    xi, weight = points_within(beam.edges)
    mass = along(beam.mass_with_points, xi) * weight * beam.length
    mass = jnp.append(mass, rotor.tip_mass)
    polar = polar_inertia(beam, lambda value: along(value, xi))
    return np.append(xi, 1.0), mass, jnp.append(polar * weight * beam.length, 0.0)


def own_tip(
    model: AbstractModel, rotor: AnyRotor, shape: Vectors, direction: Array,
    shapes: Shapes | None = None,
) -> Inexact[Array, " k"]:  # fmt: skip
    """The motion of the tip in the direction that names each mode, of torsion L times the twist;
    `shapes` are the functions on a beam that varies, where they are known."""
    if shapes is not None:
        same = np.array(model.directions)[None] == direction[:, None]
        return jnp.sum(jnp.where(same, shapes.ends.tip[None], 0.0) * shape, -1)
    end = np.ones(1)
    table = model.displacement(end, rotor)[:, 0]
    return jnp.sum(jnp.concatenate([table, model.torsion(end, rotor)])[direction] * shape, -1)


def _named(direction: np.ndarray, number: np.ndarray) -> tuple[Any, ...]:
    pairs = zip(direction, number, strict=True)
    if direction.ndim > 1:
        return tuple(_named(*pair) for pair in pairs)
    return tuple(Label(Direction(int(f)), int(k)) for f, k in pairs)
