"""Modes of one case, or of a batch."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Inexact, Int

from jaxbeam._checks import concrete_array
from jaxbeam._models.bases.shapes import Shapes
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._modes.shapes import ShapePolynomials, fit
from jaxbeam._results import nan_unless, per_case
from jaxbeam._rotor.beam import AnyRotor, Rotor
from jaxbeam._rotor.directions import Direction, Label
from jaxbeam._status import Status
from jaxbeam._types import Code, Scalar, Vectors


class Modes(eqx.Module):
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
    |                 |        |       | class. None of elements, of coned beams, about loaded     |
    |                 |        |       | states, and on uniform beams but for `Hybrid` and         |
    |                 |        |       | `Classical` with `Polynomials` or `Layered`               |
    | model           |        |       | whose modes they are: of soft beams it may be one with    |
    |                 |        |       | other functions than were given; part of no table         |

    (*) kg^-1/2 for coordinates in metres.

    **Labels** do not depend on how a speed was reached. Without Coriolis coupling the modes at any
    speed move in one direction each, and those of one have simple frequencies that never cross, so
    that their numbers mean something. A coupled mode takes the label of the uncoupled mode *at the
    same speed* in which it has most of its kinetic energy, each label given once. Through a
    crossing or a veering a label therefore stays with the kind of motion; inside a veering it
    changes branch where the two branches share the motion equally. About a state that is bent, the
    uncoupled modes of bending take axial motion along, and directions are those of the hub. The
    position among the in-plane and axial modes in order of frequency is the label that follows a
    branch instead.
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

    def displacement(
        self, rotor: AnyRotor, xi: Any = 1.0, *, tip: bool = False
    ) -> Complex[Array, "... k p 3"]:
        """Amplitudes of modes along the span: axial, in plane and flap, to first order.

        They are at x = `xi` L, a number from 0 to 1 or p of them, of the `rotor` whose modes they
        are; the motion is the real part of these times e^(lambda t).

        Of unit modal mass, in kg^-1/2; with `tip` such that the displacement of the tip in the
        mode's own direction is one, of modes of torsion L times the angle there. Differentiable,
        under `jit`, and of a batch of one rotor with its axes in front; where rotors differ from
        case to case, `jax.vmap` it over both.

        Raises `ValueError` for xi out of range, and `TypeError` where it is traced.
        """
        return _displacement(self, rotor, _places(xi), tip)

    def torsion(
        self, rotor: AnyRotor, xi: Any = 1.0, *, tip: bool = False
    ) -> Complex[Array, "... k p"]:
        """L times the angle of torsion at `xi` of the `rotor`: zero but in `SpatialANCF`.

        `tip`, units and batches are as in `displacement`.

        Raises `ValueError` where `xi` is not within 0 and 1.
        """
        return _torsion(self, rotor, _places(xi), tip)

    def polynomials(self, rotor: AnyRotor) -> ShapePolynomials:
        """The shapes of bending modes as ElastoDyn (OpenFAST) takes them: c_2 xi^2 + ... + c_6 xi^6
        by least squares over the span, scaled to c_2 + ... + c_6 = 1.

        They are fitted to the deflection in the mode's own direction, in plane or flap. Of sections
        that are turned ElastoDyn takes a shape p as a curvature p'' about their axes, and adds up
        what it does in both directions: with twist, p is the one for which that comes next to the
        deflection both ways. It turns the whole blade by its own pitch, so that shapes are those of
        a rotor without one. Value and slope at the root are zero, so that shapes of a root that
        yields do not fit: look at `misfit`, which for clamped blades is 1e-3 or so.
        `jaxbeam.blades.write_elastodyn` writes them into a file. `rotor` and batches are as in
        `displacement`.

        Raises `ValueError` for a rotor with a pitch.
        """
        if isinstance(rotor, Rotor) and rotor.pitch is not None:
            raise ValueError(
                "rotor.pitch must be None for shapes of modes, since ElastoDyn turns the blade by "
                "a pitch of its own: take the modes of the rotor without its pitch"
            )
        return _polynomials(self, rotor)


@per_case
def _displacement(
    modes: Modes, rotor: AnyRotor, xi: np.ndarray, tip: bool
) -> Complex[Array, "k p 3"]:
    table = _model_of(modes).displacement(xi, rotor)
    return jnp.einsum("cpn,kn->kpc", table, _scaled(modes, rotor, tip))


def _places(xi: Any) -> np.ndarray:
    """The argument as places x / L."""
    points = np.atleast_1d(concrete_array("xi", xi))
    if points.ndim > 1 or not np.all((points >= 0) & (points <= 1)):
        raise ValueError(f"xi must be x / L from 0 to 1, one or several in a row, got {xi}")
    return points


@per_case
def _torsion(modes: Modes, rotor: AnyRotor, xi: np.ndarray, tip: bool) -> Complex[Array, "k p"]:
    return _scaled(modes, rotor, tip) @ _model_of(modes).torsion(xi).T


@per_case
def _polynomials(modes: Modes, rotor: AnyRotor) -> ShapePolynomials:
    direction = modes.direction
    bends = (direction == Direction.IN_PLANE) | (direction == Direction.FLAP)
    bent = jnp.where(bends[:, None], _scaled(modes, rotor, True), 1.0).real
    into = fit(rotor)
    table = _model_of(modes).displacement(into.xi, rotor)
    in_plane, flap = (bent @ table[axis].T for axis in (1, 2))
    is_flap = (direction == Direction.FLAP)[:, None]
    # The first axis of a section turns towards flap, the second away from in plane.
    own, across = jnp.where(is_flap, flap, in_plane), jnp.where(is_flap, -in_plane, flap)
    found = jax.vmap(into.of)(own, across)
    return ShapePolynomials(*nan_unless(bends & (modes.status == Status.OK), found))


def _model_of(modes: Modes) -> AbstractModel:
    if modes.model is None:
        raise ValueError("these modes do not say of which model they are: take those of modes()")
    return modes.model


def _scaled(modes: Modes, rotor: AnyRotor, tip: bool) -> Vectors:
    """Shapes as they are, or divided by what the tip does in the direction of each."""
    if not tip:
        return modes.shape
    return modes.shape / own_tip(_model_of(modes), rotor, modes.shape, modes.direction)[:, None]


def own_tip(
    model: AbstractModel, rotor: AnyRotor, shape: Vectors, direction: Array,
    shapes: Shapes | None = None,
) -> Inexact[Array, " k"]:  # fmt: skip
    """What the tip does in the direction that names each mode, of torsion L times the twist;
    `shapes` are the functions on a beam that varies, where they are known."""
    if shapes is not None:
        same = np.array(model.directions)[None] == direction[:, None]
        return jnp.sum(jnp.where(same, shapes.ends.tip[None], 0.0) * shape, -1)
    end = np.ones(1)
    table = model.displacement(end, rotor)[:, 0]
    return jnp.sum(jnp.concatenate([table, model.torsion(end)])[direction] * shape, -1)


def _named(direction: np.ndarray, number: np.ndarray) -> tuple[Any, ...]:
    pairs = zip(direction, number, strict=True)
    if direction.ndim > 1:
        return tuple(_named(*pair) for pair in pairs)
    return tuple(Label(Direction(int(f)), int(k)) for f, k in pairs)
