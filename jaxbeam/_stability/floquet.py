"""Parametric stability: Floquet multipliers of a beam whose speed is modulated periodically.

Small motions of a beam that turns at Omega(t) obey the Hill equation of B made periodic,

    (M q')' + G q' + G' q / 2 + D q' + K q = 0,   G = G(Omega(t)) skew,   K = K(Omega(t)) symmetric,

with the matrices of steady rotation at that speed; the rate of the speed enters through G' alone,
and D is damping. Bending about the straight beam, that is: what the modulation itself drives is a
motion about which a linear model vibrates in the same way; non-linear ones are linearised about the
straight beam stretched as in steady rotation. With momenta p = M q' + G q / 2 it is Hamiltonian,

    q' = v,   p' = -G v / 2 - K q - D v,   v = M^-1 (p - G q / 2),

but for D. Exponentials of its matrices and their commutators are then symplectic, so multipliers
of undamped beams come in pairs mu, 1 / mu to rounding, whatever the steps are.

B is the paper of `_models/contract/__init__.py`.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from jaxbeam._checks import count_functions, kind_of, numpy_if_concrete, positive
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.drag import drag_of
from jaxbeam._models.contract.left_out import status_of_shape
from jaxbeam._models.contract.loaded import checked_damping
from jaxbeam._numerics.exponential import exponential
from jaxbeam._numerics.linalg import (
    eigensystem,
    inverse,
    lowest_eigenpair,
    symmetric_modes,
)
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, harmless, nan_unless, without_derivatives
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping, damping_in_range
from jaxbeam._rotor.directions import Direction, loose_motions
from jaxbeam._rotor.loads import in_plane
from jaxbeam._rotor.motion import Spin
from jaxbeam._rotor.spins import ModulatedSpeed
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Matrix, Real, Scalar, Vector

_NODES = (1 + np.polynomial.legendre.leggauss(3)[0]) / 2
# Squarings for steps of up to 160 periods of the fastest mode, longer than is accurate.
_SQUARINGS = 12


class Floquet(eqx.Module):
    """Multipliers of n coordinates over one period; of a beam by `SpatialRod` of two thirds of its
    coordinates, without those of stiff shear.

    | field            | shape | unit |                                                         |
    |------------------|-------|------|---------------------------------------------------------|
    | multipliers      | (2n,) |      | largest modulus first; NaN, as what follows, unless     |
    |                  |       |      | status is OK                                            |
    | multiplier_error | (2n,) |      | estimate of what `steps` do to each: see `floquet`      |
    | direction        | (2n,) |      | `Direction` of each: `IN_PLANE` (with axial motion) or  |
    |                  |       |      | `FLAP`; `IN_PLANE` for all where turned sections couple |
    |                  |       |      | them                                                    |
    | growth_rate      | ()    | 1/s  | log(largest modulus) / period; of undamped stable beams |
    |                  |       |      | zero to rounding (1e-8 / period where two multipliers   |
    |                  |       |      | are close)                                              |
    | status           | ()    |      | `Status`; being unstable is no failure                  |
    """

    multipliers: Complex[Array, " m"]
    multiplier_error: Float[Array, " m"]
    direction: Int[Array, " m"]
    growth_rate: Scalar
    status: Code


def floquet(
    model: AbstractModel,
    rotor: AnyRotor,
    motion: Spin,
    period: Real | None = None,
    *,
    damping: Damping = NO_DAMPING,
    steps: int = 64,
    throw: bool = True,
) -> Floquet:
    """Floquet multipliers of small motions while the speed varies with `period` (s, > 0).

    `model` and `rotor` are those of `modes`, `motion` turns about the axis a3 with a speed of that
    period (a `ModulatedSpeed` states its own), `damping` is a `Damping`, `steps` an int >= 2.
    The matrix that takes (q, p) through a period is a product of `steps` Magnus exponentials of
    order 6 (S. Blanes, F. Casas, J. Ros, BIT 42 (2002) 262-284), symplectic without damping.
    Errors fall with the sixth power of `steps`, so `Floquet.multiplier_error` is 1/63 of what half
    as many change in a multiplier. Where this changes a modulus by more than 1e-2 (of itself, if it
    is above one) the status is `TOO_FEW_STEPS`. Many functions need many
    steps, for a mode that nobody asks for, and so does an axial mode that a `stiffness_coefficient`
    damps hard: take small models, without stretch where it does not matter, or steps by the
    thousand. First derivatives of multipliers by every parameter are exact in both modes, where a
    multiplier is simple.

    `throw=False` returns failures in `Floquet.status`: those of parameters, motion and damping out
    of range, `NO_EQUILIBRIUM` where the beam has no steady state at the largest speed,
    `TOO_FEW_STEPS`, and `TOO_FEW_FUNCTIONS` where rotation holds the beam out more than the default
    numbers of functions can follow. The numbers are then NaN (derivatives: as in `modes`).

    Raises as `modes` does, `TypeError` for a motion that does not turn about a fixed axis or whose
    period is not given, and `ValueError` for a coned beam.
    """
    model, rotor, motion, period, damping = _checked(model, rotor, motion, period, damping)
    count_functions("steps", steps, least=2)
    result = _floquet(model, rotor, motion, period, damping, steps)
    return finish(result, throw)


def _checked(
    model: AbstractModel, rotor: AnyRotor, motion: Any, period: Any, damping: Any
) -> tuple[AbstractModel, Any, Spin, Scalar, Damping]:
    model, rotor, _ = checked_case(model, rotor)
    refuse_cone(rotor)
    if not isinstance(motion, Spin):
        raise TypeError(f"motion must turn about a fixed axis, got {kind_of(motion)}")
    if period is None:
        if not isinstance(motion, ModulatedSpeed):
            raise TypeError("period must be given, but for a ModulatedSpeed")
        period = 2 * np.pi / numpy_if_concrete(motion.frequency)
    damping = checked_damping(damping, (model, rotor))
    return model, rotor, motion, positive("period", period), damping


def refuse_cone(rotor: AnyRotor) -> None:
    """Raise `ValueError` for a coned beam, which a speed that varies bends to and fro."""
    if rotor.precone is not None:
        raise ValueError("precone: small motion about a modulated speed is of beams without a cone")


@Program
def _floquet(
    model: AbstractModel, rotor: AnyRotor, motion: Spin, period: Scalar, damping: Damping,
    steps: int,
) -> Floquet:  # fmt: skip
    given = modulation_status(model, rotor, motion, period, damping)
    fine = given == Status.OK
    rotor, motion, period, damping = harmless(fine, (rotor, motion, period, damping))

    def speed(t: Scalar) -> Scalar:
        return jnp.where(fine, motion.angular_speed(t), 0.0)

    drag = drag_of(damping, model, rotor, model.equations(rotor))
    parts, ok, enough = [], jnp.asarray(True), jnp.asarray(True)
    few = jnp.asarray(int(Status.OK))
    for transverse, axial in model.coupling(rotor):
        directions = transverse + axial
        if any(direction in model.directions for direction in directions):
            group = Reduced(model, rotor, speed, period, drag, directions)
            mu, error, short, shapes = _estimated(group, steps)
            few = first_failure(few, *(status_of_shape(model, rotor, shape) for shape in shapes))
            parts.append((mu, error, jnp.full(mu.shape, int(directions[0]))))
            ok &= group.status == Status.OK
            enough &= short
    mu, error, direction = (jnp.concatenate(part) for part in zip(*parts, strict=True))
    order = jnp.argsort(-jnp.abs(mu))
    mu, error, direction = mu[order], error[order], direction[order]
    status = first_failure(
        given,
        first_broken((ok, Status.NO_EQUILIBRIUM)),
        few,
        first_broken((enough, Status.TOO_FEW_STEPS)),
    )
    ok = status == Status.OK
    rate = jnp.log(jnp.abs(jnp.where(ok, mu[0], 1.0))) / period
    return Floquet(
        nan_unless(ok, mu), nan_unless(ok, error), direction, nan_unless(ok, rate), status
    )


def _estimated(
    group: "Reduced", steps: int
) -> tuple[Complex[Array, " m"], Vector, Array, tuple[Array, Array]]:
    """The multipliers, their errors by the number of steps, whether steps are short enough, and
    shapes of the lowest mode and of the growing one (the lowest again if none grows)."""
    found = group.monodromy(steps, half(steps))
    assert found.by_fewer is not None
    product = jnp.where(found.sound, found.matrix, jnp.eye(len(found.matrix)))
    mu, x, y = eigensystem(jax.lax.stop_gradient(product))
    adjoint = y.conj()
    other = jnp.sum(adjoint * (found.by_fewer @ x), 0) / jnp.sum(adjoint * x, 0)
    move = jnp.abs(mu - other) * left_by(steps)
    # Errors of two multipliers that meet are not of first order: they change as roots of a
    # quadratic.
    apart = jnp.min(jnp.abs(mu[:, None] - mu[None]) + jnp.diag(jnp.full(mu.size, jnp.inf)), 1)
    error = 2 * move / (1 + jnp.sqrt(1 + 4 * move / (apart + 1e-300)))
    # An error that only turns a multiplier on its circle, such as that of a fast mode, does not
    # make the motion unstable.
    size = jnp.abs(mu)
    outwards = jnp.minimum(jnp.abs(size - jnp.abs(other)) * left_by(steps), error)
    short = found.sound & jnp.all(outwards <= 1e-2 * jnp.maximum(size, 1.0))  # False for NaN
    phi, root = found.coordinates
    first = jnp.argmax(size)
    grows = (phi / root[None]) @ x[: root.size, first]
    grows = jnp.where(size[first] > 1 + error[first], grows, phi[:, 0])
    every = np.eye(len(group.model.directions))[group.rows]
    mu = _multipliers(product, mu, x, y)
    return mu, jax.lax.stop_gradient(error), short, (phi[:, 0] @ every, grows @ every)


def half(steps: int) -> int:
    """Half of a number of steps, rounded up."""
    return -(-steps // 2)


def left_by(steps: int) -> float:
    """The error of a method of order 6 with so many steps, over the difference to the result with
    half as many."""
    return 1 / ((steps / half(steps)) ** 6 - 1)


def modulation_status(
    model: AbstractModel, rotor: AnyRotor, motion: Spin, period: Scalar, damping: Damping
) -> Code:
    """The status of rotor, motion and damping, and of the model's number of functions for the
    motion."""
    t = period * jnp.linspace(0.0, 1.0, 8)
    now, later = (jax.vmap(motion.angular_speed)(at) for at in (t, t + period))
    scale = jnp.max(jnp.abs(now))
    repeats = jnp.all(jnp.abs(later - now) <= 1e-6 * scale)  # False for NaN
    planar = in_plane(motion.axis[:2], motion.axis[2]) & (motion.axis[2] > 0)
    modulated = first_broken(
        (repeats & jnp.isfinite(period) & (period > 0), Status.INVALID_MOTION),
        (damping_in_range(damping), Status.INVALID_DAMPING),
        (planar, Status.OUT_OF_PLANE),
        (model.resolves(rotor, scale), Status.TOO_FEW_FUNCTIONS),
    )
    return first_failure(rotor.status(jnp.zeros_like(period)), modulated)


class Reduced(NamedTuple):
    """Motion of one coupling group over a period, in coordinates of its modes at the mean speed.

    With Phi^T M Phi = 1 and the frequencies w there, q = Phi w^-1/2 x, p = M Phi w^1/2 y:
    canonical, and each mode goes round in its own (x, y) at its own frequency. The change of
    coordinates carries no derivatives, which multipliers do not ask for.
    """

    model: AbstractModel
    rotor: AnyRotor
    speed: Any
    period: Scalar
    drag: Drag
    directions: tuple[Direction, ...]

    @property
    def rows(self) -> np.ndarray:
        """Indices of the coordinates of this coupling group."""
        return np.flatnonzero([f in self.directions for f in self.model.directions])

    def matrices(self, speed: Scalar) -> tuple[Matrix, Matrix, Matrix, Matrix, Code]:
        """The matrices M, G, K, D at a speed, and the status of the steady state."""
        own = np.ix_(self.rows, self.rows)
        system = self.model.matrices(self.rotor, speed)
        m, g, k = (a[own] for a in (system.mass, system.gyroscopic, system.stiffness))
        if self.drag.is_none:
            return m, g, k, jnp.zeros_like(m), system.status
        equations = self.model.equations(self.rotor)
        q = equations.rest
        if not equations.is_linear:
            q, _ = self.model.steady(self.rotor, speed)
        d = equations.damping_matrix_about(q, self.drag)
        return m, g, k, d[own], system.status

    @property
    def mean_speed(self) -> Scalar:
        """The mean speed over eight equidistant times of the period."""
        return jnp.mean(jax.vmap(self.speed)(self.period * jnp.arange(8) / 8))

    @property
    def status(self) -> Code:
        """Status at the largest speed: of the search for the steady state, and whether the rod
        bears it."""
        speeds = jnp.abs(jax.vmap(self.speed)(self.period * jnp.arange(32) / 32))
        m, _, k, _, status = without_derivatives(self.matrices(jnp.max(speeds)))
        axial = np.flatnonzero([self.model.directions[row] == Direction.AXIAL for row in self.rows])
        if axial.size:
            least, _ = lowest_eigenpair(k[np.ix_(axial, axial)], m[np.ix_(axial, axial)])
            status = jnp.where(least > 0, status, Status.NO_EQUILIBRIUM)
        return status

    @property
    def coordinates(self) -> tuple[Matrix, Vector]:
        """The coordinates of the reduced problem: modes Phi and scales w^(1/2)."""
        m, _, k, _, _ = without_derivatives(self.matrices(self.mean_speed))
        phi = symmetric_modes(m, k, loose_motions(self.rotor)).T
        phi = phi[:, : self.model.slow_modes(self.rotor, len(phi))]
        w2 = jnp.abs(jnp.sum(phi * (k @ phi), 0))
        slow = (2 * jnp.pi / without_derivatives(self.period)) ** 2 / 100
        return phi, jnp.maximum(w2, slow) ** 0.25

    def monodromy(self, steps: int, fewer: int | None = None) -> "Monodromy":
        """The matrices that take (x, y) through a period, by `steps` steps and by `fewer`."""
        phi, root = self.coordinates
        n = root.size

        def rate(t: Scalar) -> Matrix:
            m, g, k, d, _ = self.matrices(self.speed(t))
            # M is the unit matrix, but with derivatives.
            m, g, k, d = (phi.T @ a @ phi for a in (m, g, k, d))
            light = inverse(m)
            rotation = light @ (g / 2)
            press = g / 2 + d
            blocks = [[-rotation, light], [press @ rotation - k, -press @ light]]
            scale = jnp.concatenate([root, 1 / root])
            return scale[:, None] * jnp.block(blocks) / scale[None]

        def step(state: tuple[Matrix, Matrix], each: Array) -> tuple[tuple[Matrix, Matrix], Array]:
            number, share, longest = each
            done, product = jax.tree.map(
                lambda old, new: jnp.where(number == 0, new, old), state, (state[1], start)
            )
            h = share * self.period
            a, b, c = jax.vmap(rate)(h * (number + _NODES))
            one, two = h * b, np.sqrt(15) / 3 * h * (c - a)
            three = 10 / 3 * h * (a - 2 * b + c)
            first = _commutator(one, two)
            second = -_commutator(one, 2 * three + first) / 60
            both = _commutator(-20 * one - three + first, two + second) / 240
            size = jax.lax.stop_gradient(jnp.max(jnp.abs(both)))
            # Steps too long for the order of the method may overflow.
            exponent = jnp.where(size < longest, one + three / 12 + both, 0.0)
            return (done, exponential(exponent, _SQUARINGS) @ product), size

        # One after the other in one loop, whose body is compiled once.
        start, counts = jnp.eye(2 * n), [steps] if fewer is None else [steps, fewer]
        each = [
            np.stack([np.arange(m), np.full(m, 1 / m), np.full(m, (steps / m) ** 3)], 1)
            for m in counts
        ]
        (done, last), sizes = jax.lax.scan(step, (start, start), jnp.concatenate(each))
        correction = jnp.max(sizes[:steps])
        if fewer is None:
            return Monodromy(last, correction, (phi, root))
        return Monodromy(done, correction, (phi, root), jax.lax.stop_gradient(last))


class Monodromy(NamedTuple):
    """The monodromy matrix over a period; the size of the terms of third order of the exponents,
    which for one or more says that steps are too long; the coordinates; and the matrix by fewer
    steps."""

    matrix: Float[Array, "m m"]
    correction: Scalar
    coordinates: tuple[Matrix, Vector]
    by_fewer: Float[Array, "m m"] | None = None

    @property
    def sound(self) -> Array:
        """Whether the steps are short enough."""
        return jnp.all(jnp.isfinite(self.matrix)) & (self.correction < 1)  # False for NaN


def _commutator(a: Matrix, b: Matrix) -> Matrix:
    return a @ b - b @ a


@jax.custom_jvp
def _multipliers(monodromy: Array, mu: Array, right: Array, left: Array) -> Array:
    return mu


@_multipliers.defjvp
def _multipliers_jvp(
    primals: tuple[Array, ...], tangents: tuple[Array, ...]
) -> tuple[Array, Array]:
    """The derivative d mu = y^H dPhi x / y^H x of a simple eigenvalue."""
    _, mu, x, y = primals
    adjoint = y.conj()
    return mu, jnp.sum(adjoint * (tangents[0] @ x), 0) / jnp.sum(adjoint * x, 0)
