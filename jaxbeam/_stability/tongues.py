"""Tongues: where a modulation of the speed makes two modes grow."""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from jaxbeam._checks import check_all, count_functions, increase, number_list, positive
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.drag import drag_of
from jaxbeam._models.contract.loaded import checked_damping
from jaxbeam._modes.modes import find
from jaxbeam._modes.result import Modes
from jaxbeam._modes.wanted import Wanted, choose
from jaxbeam._numerics.linalg import eigensystem
from jaxbeam._programs.program import Program
from jaxbeam._results import InHertz, finish, harmless, nan_unless, without_derivatives
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping
from jaxbeam._rotor.directions import Direction, Label
from jaxbeam._rotor.spins import ModulatedSpeed
from jaxbeam._stability.floquet import Reduced, half, left_by, modulation_status, refuse_cone
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Matrix, Real, Scalar, Vector


class Tongue(InHertz, eqx.Module):
    """Boundaries of a region of parametric resonance, at D depths of modulation.

    | field           | shape  | unit  |                                                         |
    |-----------------|--------|-------|---------------------------------------------------------|
    | depth           | (D,)   |       | as given                                                |
    | frequency       | (D, 2) | rad/s | lowest and highest frequency of modulation of the       |
    |                 |        |       | region                                                  |
    | frequency_error | (D, 2) | rad/s | estimate of what `steps` do to each, as in `floquet`    |
    | onset           | ()     | rad/s | where it begins without damping: (omega_i + omega_j) /  |
    |                 |        |       | order                                                   |
    | status          | (D,)   |       | `Status`; `NO_TONGUE` where damping leaves none at this |
    |                 |        |       | depth                                                   |

    Where `status` is not OK the frequencies are NaN (derivatives: as in `modes`); so is `onset`
    where nothing could be computed at any depth.
    """

    depth: Float[Array, " D"]
    frequency: Float[Array, "D 2"]
    frequency_error: Float[Array, "D 2"]
    onset: Scalar
    status: Int[Array, " D"]


def tongue(
    model: AbstractModel,
    rotor: AnyRotor,
    mean: Real,
    pair: tuple[Label, Label],
    depths: Any,
    *,
    order: int = 1,
    damping: Damping = NO_DAMPING,
    steps: int = 64,
    throw: bool = True,
) -> Tongue:
    """The boundaries of `ModulatedSpeed(mean, depth, frequency)` at which the modes of `pair` grow.

    That is the region of parametric resonance that begins at the frequency (omega_i + omega_j) /
    order, those of the modes at the speed `mean` (rad/s, > 0): principal where both labels are the
    same, of combination type where they differ. `model`, `rotor`, `damping` and `steps` are those
    of `floquet`, `pair` two labels (see `labels`) of modes that may be coupled, `depths` (D,)
    positive and increasing, without unit, `order` an int >= 1.

    The two multipliers that belong to the two modes define a function that changes sign at the
    boundary. With their sum s and product p, t = s / p^1/2 and r = abs(p)^-1/2 it is

        Re(t)^2 + [Im(t) (r + 1/r) / (r - 1/r)]^2 - (r + 1/r)^2,

    positive where one of them is outside the unit circle (condition of Schur and Cohn, for
    abs(p) <= 1); without damping (s^2 - 4 p) / p, negative while they are apart on the circle. Its
    roots are found by Newton's method with exact derivatives, from depth to depth along the tangent
    that the gradient gives, set right by a parabola through three points. First derivatives of
    `frequency` by parameters are exact.

    The modulation is about a positive mean speed at which the beam is stable, else the status is
    `NO_EQUILIBRIUM`. `INACCURATE` where the two modes are not recognised by what they are without
    modulation, `NOT_CONVERGED` where Newton's method did not settle, because multipliers of another
    mode pass by, say. `throw=False` returns failures in `Tongue.status`.

    Raises as `floquet` does.
    """
    if not isinstance(pair, tuple | list) or len(pair) != 2:
        raise ValueError(f"pair must be two labels, got {pair!r}")
    model, rotor, _ = checked_case(model, rotor)
    wanted = choose(model, tuple(pair))
    refuse_cone(rotor)
    every = [transverse + axial for transverse, axial in model.coupling(rotor)]
    groups = [
        directions for directions in every if all(label.direction in directions for label in pair)
    ]
    if not groups:
        raise ValueError(
            "pair must be coupled with each other: flap is not coupled with in-plane motion"
        )
    count_functions("order", order, least=1)
    count_functions("steps", steps, least=2)
    depths, rule = number_list("depths", depths), "depths must be finite, positive and increasing"
    check_all(rule, depths, lambda x: (x > 0).all() & increase(x))
    speed = positive("mean", mean)
    damping = checked_damping(damping, (model, rotor))
    share = jnp.asarray(float(order))  # an array, so that another order needs no new program
    result = _tongue(model, rotor, speed, wanted, depths, share, damping, groups[0], steps)
    return finish(result, throw)


@functools.partial(Program, calls=0)
def _tongue(
    model: AbstractModel, rotor: AnyRotor, mean: Scalar, wanted: Wanted, depths: Vector,
    order: Scalar, damping: Damping, directions: tuple[Direction, ...], steps: int,
) -> Tongue:  # fmt: skip
    found, given = _unmodulated(model, rotor, mean, wanted, damping)
    fine = given == Status.OK
    rotor, damping = harmless(fine, (rotor, damping))
    mean = jnp.where(fine, mean, 0.0)
    eigenvalue = jnp.where(fine, found.eigenvalue, 1j)
    onset_now = jnp.sum(eigenvalue.imag) / order
    onset = without_derivatives(onset_now)
    without_depth = without_derivatives(_Modulation(rotor, mean, damping, onset, 0 * onset))
    still = without_depth.group(model, directions)
    shapes = jnp.where(fine, found.shape, 1.0)
    basis = without_derivatives(_basis(still, mean, eigenvalue, shapes))
    margin = _Margin(model, directions, basis, steps)
    search = _BoundarySearch(margin, rotor, mean, damping, onset, order)
    kept, rates, status = search.boundaries(depths)
    ends, error = jax.vmap(jax.vmap(search.polished, (0, 0, None)))(kept, rates, depths)
    status = first_failure(given, status)
    ok = status == Status.OK
    reached = ok[:, None] & jnp.isfinite(kept)
    return Tongue(
        depths, nan_unless(reached, ends), nan_unless(reached, error),
        nan_unless(fine, onset_now), status,
    )  # fmt: skip


def _unmodulated(
    model: AbstractModel, rotor: AnyRotor, mean: Scalar, wanted: Wanted, damping: Damping
) -> tuple[Modes, Code]:
    """The modes at the mean speed, and the status of the case."""
    unit = ModulatedSpeed(mean, 0.0, 1.0)
    given = modulation_status(model, rotor, unit, 2 * jnp.pi / unit.frequency, damping)
    found = find(model, rotor, mean, wanted)
    stable = ~jnp.any(found.growth_rate > 0)
    at_mean = first_broken((stable, Status.NO_EQUILIBRIUM))
    return found, first_failure(given, found.status, at_mean)


class _Modulation(NamedTuple):
    """A beam and a modulation of its speed: all parameters that a margin has derivatives by."""

    rotor: AnyRotor
    mean: Scalar
    damping: Damping
    frequency: Scalar
    depth: Scalar

    def group(self, model: AbstractModel, directions: tuple[Direction, ...]) -> Reduced:
        """Motion of a coupling group over a period of the modulation."""
        motion = ModulatedSpeed(self.mean, self.depth, self.frequency)
        period = 2 * jnp.pi / self.frequency
        drag = drag_of(self.damping, model, self.rotor, model.equations(self.rotor))
        return Reduced(model, self.rotor, motion.angular_speed, period, drag, directions)


class _Margin(NamedTuple):
    """The function that changes sign at a boundary of a tongue, for two modes that span `basis`."""

    model: AbstractModel
    directions: tuple[Direction, ...]
    basis: Complex[Array, "m 2"]
    steps: int

    def at(self, case: _Modulation) -> tuple[Scalar, Scalar]:
        """The margin, positive where unstable, and how well the two modes are recognised, one at
        best; NaN where steps are too long."""
        found = case.group(self.model, self.directions).monodromy(self.steps)
        value, ahead = self.of(found.matrix, found.sound)
        return value, jnp.where(found.sound, ahead, jnp.nan)

    def estimated(self, case: _Modulation) -> tuple[Scalar, Scalar]:
        """The margin of `at`, and its error by the number of steps."""
        found = case.group(self.model, self.directions).monodromy(self.steps, half(self.steps))
        assert found.by_fewer is not None
        value, _ = self.of(found.matrix, found.sound)
        other, _ = self.of(found.by_fewer, jnp.all(jnp.isfinite(found.by_fewer)))
        return value, jax.lax.stop_gradient(jnp.abs(value - other)) * left_by(self.steps)

    def of(self, monodromy: Any, sound: Array) -> tuple[Scalar, Scalar]:
        """The margin from a matrix over a period, NaN if it is not sound, and how well the two
        modes are recognised."""
        total, product, ahead = self.pair(jnp.where(sound, monodromy, jnp.eye(len(self.basis))))
        return _beyond(total, product), ahead

    def pair(self, monodromy: Matrix) -> tuple[Complex[Array, ""], Complex[Array, ""], Scalar]:
        """Sum and product of the two multipliers, and by how much more than the next they are like
        the two modes."""
        _, right, left = eigensystem(jax.lax.stop_gradient(monodromy))
        share = jnp.linalg.norm(self.basis.conj().T @ right, axis=0)
        likeness, index = jax.lax.top_k(share / jnp.linalg.norm(right, axis=0), min(3, share.size))
        # By the invariant subspace of both: at the boundary the two multipliers coincide, and have
        # infinite derivatives, but their sum and product are smooth.
        x, y = (_orthonormal(*a[:, index[:2]].T) for a in (right, left))
        small = _inverse2(y.conj().T @ x) @ (y.conj().T @ (monodromy @ x))
        ahead = likeness[1] - likeness[2] if share.size > 2 else likeness[1]
        return small[0, 0] + small[1, 1], _determinant2(small), ahead


def _beyond(total: Complex[Array, ""], product: Complex[Array, ""]) -> Scalar:
    """How far two multipliers of this sum and product are outside the unit circle: see `tongue`."""
    # Scaled to a product of one the sum is t, and the unit circle has the radius rho: both
    # multipliers are inside if t is in the ellipse with half axes rho +- 1 / rho.
    t, rho = total / jnp.sqrt(product), jnp.abs(product) ** -0.5
    minor = rho - 1 / rho
    flat = jnp.abs(minor) < 1e-12  # without damping t is real
    aside = jnp.where(flat, 0.0, t.imag / jnp.where(flat, 1.0, minor))
    major = rho + 1 / rho
    return t.real**2 + (aside * major) ** 2 - major**2


class _End(NamedTuple):
    """The state of Newton's method in the search for a boundary of the tongue."""

    frequency: Scalar
    change: Scalar
    likeness: Scalar
    rate: Scalar
    tries: Scalar


class _BoundaryPoint(NamedTuple):
    """The boundary at one depth, from which the search at the next depth starts."""

    depth: Scalar
    centre: Scalar
    width: Scalar
    slopes: Float[Array, " 2"]


class _BoundarySearch(NamedTuple):
    """The search for the two boundaries of one tongue, without derivatives but for `polished`."""

    margin: _Margin
    rotor: AnyRotor
    mean: Scalar
    damping: Damping
    onset: Scalar
    order: Scalar

    def boundaries(self, depths: Vector) -> tuple[Array, Array, Array]:
        """Both ends of the tongue at each depth, derivatives of the margin there, and a status."""
        onset, least = self.onset, jnp.full_like(self.onset, 1e-3)
        first = _BoundaryPoint(least, onset, 0.01 * onset * least**self.order, jnp.full(2, jnp.nan))
        return jax.lax.scan(self.follow, *without_derivatives((first, depths)))[1]

    def follow(
        self, last: _BoundaryPoint, given: Scalar
    ) -> tuple[_BoundaryPoint, tuple[Array, Array, Array]]:
        """One step of the search, from one depth to the next."""
        valid = jnp.isfinite(given) & (given > 0)
        depth = jnp.where(valid, given, last.depth)
        # The middle moves with the square of the depth, the width grows with its power `order`.
        drift = jnp.nan_to_num(jnp.mean(last.slopes)) / (2 * last.depth)
        centre = last.centre + drift * (depth**2 - last.depth**2)
        centre, width = self.vertex(centre, last.width * (depth / last.depth) ** self.order, depth)
        exists = jnp.isfinite(width)
        start = jnp.where(exists, centre + width * np.array([-1.0, 1.0]), self.onset)
        end = jax.vmap(lambda nu: self.newton(nu, depth))(start)
        rise = jax.vmap(lambda nu: self.slope(nu, depth, (0.0, 1.0))[2])(end.frequency)
        ends = end.frequency
        good = exists & jnp.all(end.change <= 1e-9 * self.onset) & (ends[1] > ends[0])
        status = _ended(end, valid, exists, good)
        good &= valid
        new = _BoundaryPoint(
            depth=depth,
            centre=jnp.where(good, jnp.mean(ends), centre),
            width=jnp.where(good, (ends[1] - ends[0]) / 2, last.width),
            slopes=jnp.where(good, -rise / end.rate, jnp.nan),
        )
        return new, (jnp.where(good, ends, jnp.nan), end.rate, status)

    def vertex(self, centre: Scalar, spacing: Scalar, depth: Scalar) -> tuple[Scalar, Scalar]:
        """Middle and half width of where a parabola through points is positive; NaN if nowhere."""

        def body(_: int, state: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
            centre, spacing = state[:2]
            at = centre + spacing * jnp.arange(-1.0, 2.0)
            low, mid, high = jax.lax.map(lambda nu: self.margin.at(self.case(nu, depth))[0], at)
            bend, tilt = (low + high) / 2 - mid, (high - low) / 2
            shift = jnp.clip(-tilt / (2 * jnp.minimum(bend, -1e-30)), -2.0, 2.0)
            top = mid + shift * (tilt + shift * bend)
            width = spacing * jnp.sqrt(jnp.maximum(top / -bend, 0.0))
            near = jnp.where(width > 0, jnp.clip(width, 0.05 * spacing, 2.0 * spacing), spacing)
            near = jnp.where(jnp.abs(shift) >= 2, 4 * spacing, near)  # not near the tongue yet
            return centre + shift * spacing, near, jnp.where(top > 0, width, jnp.nan)

        centre, _, width = jax.lax.fori_loop(0, 6, body, (centre, spacing, spacing))
        return centre, width

    def newton(self, start: Scalar, depth: Scalar) -> _End:
        """The boundary near a start, by Newton's method."""

        def body(end: _End) -> _End:
            value, likeness, rate = self.slope(end.frequency, depth, (1.0, 0.0))
            change = jnp.clip(value / rate, -0.02 * self.onset, 0.02 * self.onset)
            return _End(end.frequency - change, jnp.abs(change), likeness, rate, end.tries + 1)

        def go_on(end: _End) -> Array:
            return (end.change > 1e-13 * self.onset) & (end.tries < 20)

        one = jnp.ones_like(start)
        return jax.lax.while_loop(go_on, body, _End(start, jnp.inf * one, one, one, 0 * one))

    def slope(self, nu: Scalar, depth: Scalar, along: tuple[float, float]) -> tuple[Scalar, ...]:
        """The margin and how well modes are recognised, and the derivative of the margin along a
        direction in (frequency, depth)."""
        start, one = self.case(nu, depth), jnp.ones_like(nu)
        still: _Modulation = jax.tree.map(jnp.zeros_like, start)
        push = still._replace(frequency=along[0] * one, depth=along[1] * one)
        (value, likeness), (rate, _) = jax.jvp(self.margin.at, (start,), (push,))
        return value, likeness, rate

    def case(self, frequency: Scalar, depth: Scalar) -> _Modulation:
        """A modulation of this beam, without derivatives."""
        return without_derivatives(
            _Modulation(self.rotor, self.mean, self.damping, frequency, depth)
        )

    def polished(self, end: Scalar, rate: Scalar, depth: Scalar) -> tuple[Scalar, Scalar]:
        """One more step of Newton's method, with derivatives by the parameters, and the error by
        the number of steps in time."""
        here = jnp.isfinite(end)
        depth = jnp.where(here, depth, 1e-3)
        start = jnp.where(here, end, self.onset)
        case = _Modulation(self.rotor, self.mean, self.damping, start, depth)
        value, error = self.margin.estimated(case)
        value, end = jnp.where(here, value, 0.0), jnp.where(here, end, self.onset)
        rate = jnp.where(here, rate, 1.0)
        return end - value / rate, error / jnp.abs(rate)


def _ended(end: _End, valid: Array, exists: Array, good: Array) -> Code:
    """The status of both ends of a tongue at a depth."""
    clear = jnp.all(end.likeness > 0.2)
    status = jnp.where(clear, Status.OK, Status.INACCURATE)
    status = jnp.where(good, status, Status.NOT_CONVERGED)
    status = jnp.where(exists, status, Status.NO_TONGUE)
    # Steps are too long for any result.
    status = jnp.where(jnp.any(jnp.isnan(end.likeness)), Status.TOO_FEW_STEPS, status)
    return jnp.where(valid, status, Status.INVALID_MOTION)


def _basis(
    group: Reduced, speed: Scalar, eigenvalue: Complex[Array, " 2"], shape: Complex[Array, "2 n"]
) -> Complex[Array, "m 2"]:
    """Orthonormal vectors that span two modes in (x, y), the second one with its frequency
    negative: these two multipliers meet."""
    phi, root = group.coordinates
    m, g, *_ = group.matrices(speed)

    def canonical(lam: Array, x: Array) -> Array:
        own = x[group.rows]
        p = lam * (m @ own) + g @ own / 2
        return jnp.concatenate([root * (phi.T @ (m @ own)), (phi.T @ p) / root])

    return _orthonormal(
        canonical(eigenvalue[0], shape[0]), canonical(eigenvalue[1], shape[1]).conj()
    )


def _orthonormal(a: Complex[Array, " m"], b: Complex[Array, " m"]) -> Complex[Array, "m 2"]:
    a = a / jnp.linalg.norm(a)
    b = b - a * (a.conj() @ b)
    return jnp.stack([a, b / jnp.linalg.norm(b)], 1)


def _determinant2(a: Complex[Array, "2 2"]) -> Complex[Array, ""]:
    return a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]


def _inverse2(a: Complex[Array, "2 2"]) -> Complex[Array, "2 2"]:
    rows = [jnp.stack([a[1, 1], -a[0, 1]]), jnp.stack([-a[1, 0], a[0, 0]])]
    return jnp.stack(rows) / _determinant2(a)
