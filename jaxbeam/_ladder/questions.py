"""What can be asked of a rotor, in terms that every theory answers."""

import abc
import dataclasses
from collections.abc import Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import check_kind, checked_speed, count_functions
from jaxbeam._ladder.deformed import END, deformed_by, straightened, strained_most
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.loaded import checked_conditions
from jaxbeam._models.contract.supports import borne
from jaxbeam._models.modal.theories import Hybrid
from jaxbeam._models.space.rod import SpatialRod
from jaxbeam._modes.modes import found_about
from jaxbeam._modes.wanted import choose
from jaxbeam._results import nan_unless
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping
from jaxbeam._rotor.directions import Direction, Label
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._rotor.motion import Motion
from jaxbeam._rotor.spanwise import at_root
from jaxbeam._simulation.checks import check_scene, checked_times, scene_status
from jaxbeam._simulation.result import Simulation, checked_point
from jaxbeam._simulation.simulate import adaptive, simulate
from jaxbeam._simulation.step_limits import during
from jaxbeam._status import Status
from jaxbeam._types import Real, Scalar, Vector


class Answer(eqx.Module):
    """The answer of one model to a question.

    `value` (m,) and what its errors are relative to, `scale` (m,); `size`, the largest deflection
    of the tip on the way over the length; `slope`, the largest at the tip; `steps` in time;
    `status`, and unless it is OK all but the steps is NaN; `constitutive_uncertainty`, what another
    axial law that agrees at small strains might change, relative.

    `constitutive_uncertainty` is the largest strain eps of the centre line plus the square of the
    largest curvature times the radius of gyration, (EI / EA)^(1/2), at the root: to first order in
    both the bending stiffness and the length of `GreenANCF` and `PlanarRod` differ. The limits
    of these two differ by 0.1 to 0.5 of it in static deflection, at most 0.4 in peaks of spin-ups,
    0.1 to 0.8 in histories and frequencies; once, in a history long enough for phases to drift
    apart, by 1.4.
    """

    value: Array  # in tables of many cases, with an axis of cases in front
    scale: Array
    size: Array
    slope: Array
    steps: Array
    status: Array
    constitutive_uncertainty: Real = 0.0

    def distance(self, reference: "Answer") -> np.ndarray:
        """Largest difference from the `reference`, a better answer, over the scale of that.

        Infinite where one has failed; of answers in a batch one by one.
        """
        apart = np.abs(np.asarray(self.value) - np.asarray(reference.value))
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(apart == 0, 0.0, apart / np.asarray(reference.scale))
        off = np.max(relative, axis=-1)
        failed = (np.asarray(self.status) != 0) | (np.asarray(reference.status) != 0)
        return np.where(failed | np.isnan(off), np.inf, off)


class Question(eqx.Module):
    """Something to be known of a rotor: its parameters are leaves, so a batch of questions is one
    question with batched leaves."""

    order: eqx.AbstractClassVar[int]  # order of convergence with the number of elements
    loads: eqx.AbstractVar[Loads]
    moving: ClassVar[bool] = True  # whether equations of motion are asked, not matrices alone

    @abc.abstractmethod
    def answer(self, model: AbstractModel, rotor: Rotor, accuracy: Scalar, size: Scalar) -> Answer:
        """The answer of `model` for `rotor`, as an `Answer`.

        Numerical errors are of the size of `accuracy`, relative, where the largest deflection is
        `size` times the length.
        """

    @abc.abstractmethod
    def speed(self) -> Scalar:
        """The largest angular speed that the question reaches, in rad/s."""

    @abc.abstractmethod
    def planar(self, rotor: Rotor) -> Array:
        """Whether motion, loads and answer stay in the plane of rotation of `rotor`."""

    def within(self, steps: int) -> "Question":
        """Question whose run in time, if it has one, gives up after so many steps at the latest."""
        return self

    @property
    def space_alone(self) -> str:
        """Parts of the question that rods in space alone bear, in words; empty where other
        theories do too."""
        return ""

    def cost(self, model: AbstractModel) -> float:
        """Cost in us of a case in a batch on one core, roughly: of 200 steps of a run, or of an
        eigenproblem. `studies/ladder.py` measures some of these numbers; they say only which of two
        rungs is tried first."""
        return 200 * model.step_cost if self.moving else 40 + 5e-3 * len(model.directions) ** 3

    @property
    @abc.abstractmethod
    def functions(self) -> tuple[int, ...]:
        """Numbers of bending functions that are worth while."""

    @abc.abstractmethod
    def excited(self, omega: Float[Array, " f"]) -> Float[Array, " f"]:
        """The shares of bending modes that are excited, of the most that a first one could be:
        known beforehand.

        `omega` (f,) are their frequencies at rest, in rad/s.
        """


class _InTime(Question):
    order: ClassVar[int] = 4
    motion: Motion
    times: Float[Array, " T"]
    loads: Loads
    damping: Damping
    max_steps: int = eqx.field(static=True)

    def __init__(
        self, motion: Motion, times: Any, *, loads: Loads = NO_LOADS,
        damping: Damping = NO_DAMPING, max_steps: int = 20_000,
    ) -> None:  # fmt: skip
        count_functions("max_steps", max_steps, least=1)
        self.motion, self.times, self.max_steps = motion, checked_times(times), max_steps
        self.loads, self.damping = loads, damping
        check_scene(self.motion, self.loads, self.damping, self.times[0])
        if damping.ratios:
            raise ValueError(
                f"{damping.features[0]}: exact rods, which judge, have no ratios of modes: give a "
                "stiffness_coefficient"
            )

    def within(self, steps: int) -> Question:
        fewer = steps < self.max_steps
        return dataclasses.replace(self, max_steps=steps) if fewer else self

    def resolved(self, rotor: Rotor, size: Scalar) -> Scalar:
        """The displacement over length that matters, where the largest deflection is `size`."""
        return size

    @abc.abstractmethod
    def read(self, model: AbstractModel, rotor: Rotor, run: Simulation) -> Vector:
        """The numbers that are asked for, read from a run."""

    def answer(self, model: AbstractModel, rotor: Rotor, accuracy: Scalar, size: Scalar) -> Answer:
        straight = straightened(rotor)
        # The model's `step_tolerance` says how much tighter its steps have to be than those of
        # others.
        rtol = accuracy * (model.step_tolerance / AbstractModel.step_tolerance)
        atol = rtol * self.resolved(straight, size) * straight.beam.length
        controller = adaptive(rtol, atol, self.times)
        run = simulate(
            model, rotor, self.motion, self.times, loads=self.loads, damping=self.damping,
            stepsize_controller=controller, max_steps=self.max_steps, throw=False,
            balance_tolerance=jnp.maximum(1e-3, 10 * accuracy),  # type: ignore[arg-type]
        )  # fmt: skip
        value = self.read(model, rotor, run)
        places = strained_most(straight)
        size, slope, law = deformed_by(
            straight, run.displacement(END), run.strain(places), run.curvature(places)
        )
        scale = jnp.max(jnp.abs(value)) + jnp.zeros_like(value)
        numbers = (value, scale, size, slope, law)
        value, scale, size, slope, law = nan_unless(run.status == Status.OK, numbers)
        steps = run.solution.stats["num_steps"]
        return Answer(value, scale, size, slope, steps, run.status, law)

    def speed(self) -> Scalar:
        moments = jnp.concatenate([self.times, during(self.times)])
        spin = jax.vmap(lambda t: self.motion.hub(t, None).angular_velocity)(moments)
        return jnp.max(jnp.linalg.norm(spin, axis=1))

    def planar(self, rotor: Rotor) -> Array:
        rotor, between = straightened(rotor), during(self.times)
        given, _ = scene_status(
            _LEAST, rotor, self.motion, self.loads, self.damping, self.times, between
        )
        return given != Status.OUT_OF_PLANE

    @property
    def space_alone(self) -> str:
        parts = [] if self.loads.has_potential else [*self.loads.features]
        parts += [feature for feature in self.damping.features if feature not in borne(Hybrid)]
        return next(iter(parts), "")

    @property
    def functions(self) -> tuple[int, ...]:
        return 1, 2, 4, 8

    def excited(self, omega: Float[Array, " f"]) -> Float[Array, " f"]:
        """|spectrum of the hub's angular acceleration| at each frequency over its largest possible,
        times (omega_1 / omega_k)^3: response to it of a clamped beam on a turning root.

        A mode phi of a uniform cantilever, of unit mass, takes part in the rotation of its root by
        int x phi dm, which is in proportion to 1 / omega (beta^-2, omega being EI^1/2 beta^2), and
        to a load that changes slowly it yields by that over omega^2.
        """
        n = 2048
        t = jnp.linspace(self.times[0], self.times[-1], n)
        step = t[1] - t[0]
        rate = jax.vmap(lambda t: self.motion.hub(t, None).angular_velocity_rate)(t)
        # Above the highest frequency that the samples resolve, take the highest.
        seen = jnp.minimum(omega, jnp.pi / (2 * step))
        spectrum = jnp.exp(1j * seen[:, None] * t[None]) @ rate
        total = jnp.sum(jnp.linalg.norm(rate, axis=1))
        least = jnp.finfo(omega.dtype).tiny
        return jnp.linalg.norm(spectrum, axis=1) / (total + least) * (omega[0] / omega) ** 3


_LEAST = Hybrid(0, 1, 0)


class _AtPoint(_InTime):
    direction: int = eqx.field(static=True)
    xi: float = eqx.field(static=True)

    def __init__(
        self, motion: Motion, times: Any, direction: int = 1, xi: float = 1.0, *,
        loads: Loads = NO_LOADS, damping: Damping = NO_DAMPING, max_steps: int = 20_000,
    ) -> None:  # fmt: skip
        super().__init__(motion, times, loads=loads, damping=damping, max_steps=max_steps)
        self.direction, self.xi = checked_point(direction, xi)


class DeflectionHistory(_AtPoint):
    """Displacement of a point over time, in the hub frame, in m; errors over its largest.

    `motion`, `times` (T,) in s, `loads`, `damping` and `max_steps` are those of `simulate`;
    `direction` 0, 1, 2 is axial, in plane, flap, and the point is x = `xi` L, xi from 0 to 1.

    Raises `ValueError` or `TypeError` for a malformed argument.
    """

    def read(self, model: AbstractModel, rotor: Rotor, run: Simulation) -> Vector:
        return run.displacement(self.xi)[:, 0, self.direction]


class PeakDeflection(_AtPoint):
    """The largest displacement of a point either way (`Simulation.peak`, m), shape (1,).

    Without sign: a free vibration goes as far one way as the other. Between `times` by the cubic of
    `Simulation.peak`, whose error all models share, so that no estimate knows it: give several
    times in each period. `motion`, `direction`, `xi`, `loads`, `damping` and `max_steps` are those
    of `DeflectionHistory`.

    Raises `ValueError` or `TypeError` for a malformed argument.
    """

    def read(self, model: AbstractModel, rotor: Rotor, run: Simulation) -> Vector:
        return jnp.abs(run.peak(self.direction, self.xi)[0])[None]


class RootStrain(_InTime):
    """Axial strain at the root, at `times` (T,) in s; errors over its largest.

    The force of the hub along the undeformed beam over EA, or where an end has a support the
    tension there. Of models without stretch that is the quasi-static strain; of elements it
    converges as deflections do, which their strain at a point does not. `motion`, `loads`,
    `damping` and `max_steps` are those of `simulate`.

    Raises `ValueError` or `TypeError` for a malformed argument.
    """

    def resolved(self, rotor: Rotor, size: Scalar) -> Scalar:
        """The stretch that matters, which is far smaller than the deflection."""
        return jnp.minimum(size, jnp.abs(rotor.steady_strain(self.speed())) + 1e-12)

    def read(self, model: AbstractModel, rotor: Rotor, run: Simulation) -> Vector:
        stiffness = at_root(straightened(rotor).beam.axial_stiffness)
        if rotor.root_support is not None or rotor.tip_support is not None:
            # The hub gives what both ends give, and the root may have turned.
            return run.section_force(0.0)[:, 0, 0] / stiffness
        force = run.hub_force[:, 0]
        if rotor.precone is not None:
            cos, sin = jnp.cos(rotor.precone), jnp.sin(rotor.precone)
            force = cos * force + sin * run.hub_force[:, 2]
        return -force / stiffness


class ModalFrequencies(Question):
    """Frequencies of bending and torsion in steady rotation, in rad/s, by label.

    `angular_speed` is in rad/s, either sign; `which` are labels (`labels`) of bending or torsion,
    of numbers up to 8. Errors are over each of the frequencies. About a state that `loads` deform
    (see `modes`) only rods in space are asked.

    Raises `ValueError` or `TypeError` for a malformed argument, and `ValueError` for loads that
    change in time.
    """

    order: ClassVar[int] = 4
    moving: ClassVar[bool] = False
    angular_speed: Scalar
    loads: Loads
    which: tuple[Label, ...] = eqx.field(static=True)

    def __init__(
        self, angular_speed: Any, which: Sequence[Label], *, loads: Loads = NO_LOADS
    ) -> None:
        self.angular_speed, self.loads = checked_speed(angular_speed), loads
        checked_conditions(loads, NO_DAMPING)
        listed = isinstance(which, Sequence) and not isinstance(which, Label)
        self.which = tuple(which) if listed else (which,)  # type: ignore[assignment]
        if not self.which or not all(isinstance(label, Label) for label in self.which):
            raise ValueError(f"which must be labels, see jaxbeam.labels; got {which!r}")
        for label in self.which:
            if label.direction == Direction.AXIAL or not 1 <= label.number <= 8:
                raise ValueError(f"which: bending or torsion of number 1 to 8, got {label}")

    def answer(self, model: AbstractModel, rotor: Rotor, accuracy: Scalar, size: Scalar) -> Answer:
        # Rungs are held against each other: what functions leave out is among their errors. But the
        # coarsest rods have modes that no blade has.
        wanted, conditions = choose(model, self.which), checked_conditions(self.loads, NO_DAMPING)
        speed = self.angular_speed
        judged = isinstance(model, SpatialRod)
        found, system = found_about(model, rotor, speed, wanted, judged, conditions)
        value, straight = found.frequency, straightened(rotor)
        deformed: tuple[Array, ...] = (0 * speed, 0 * speed, jnp.abs(straight.steady_strain(speed)))
        if conditions is not None:
            assert system.state is not None
            at, q, places = model.equations(rotor), system.state, strained_most(straight)
            seen = at.displacement(q, np.array(END)), at.strain(q, places), at.curvature(q, places)
            deformed = deformed_by(straight, *(a[None] for a in seen))
        size, slope, law = nan_unless(found.status == Status.OK, deformed)
        # A mode that diverges where another theory has it vibrate must not pass as 0 of 0.
        tiny = 1e-9 * straight.beam.frequency_scale
        scale = jnp.maximum(jnp.abs(value), tiny)
        return Answer(value, scale, size, slope, jnp.asarray(0), found.status, law)

    def speed(self) -> Scalar:
        return jnp.abs(self.angular_speed)

    def planar(self, rotor: Rotor) -> Array:
        return jnp.asarray(all(label.direction == Direction.IN_PLANE for label in self.which))

    @property
    def space_alone(self) -> str:
        torsion = [str(label) for label in self.which if label.direction == Direction.TORSION]
        return ", ".join(torsion if self.loads.are_none else ["loads", *torsion])

    @property
    def functions(self) -> tuple[int, ...]:
        """Numbers of bending functions, no fewer than the modes that are asked for."""
        return tuple(n for n in (1, 2, 4, 8, 16, 24, 32) if n >= self._highest)

    @property
    def _highest(self) -> int:
        return max(label.number for label in self.which)

    def excited(self, omega: Float[Array, " f"]) -> Float[Array, " f"]:
        """The modes that are asked for take part, others do not."""
        return jnp.where(np.arange(omega.size) < self._highest, 1.0, 0.0)


def checked_question(question: Question) -> Question:
    """The argument, if it is a question; raises `TypeError` otherwise."""
    check_kind("question", question, Question)
    return question
