"""What was measured, and what a model says of it."""

import abc
import functools
import inspect
from collections.abc import Callable, Sequence
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._checks import (
    check_all,
    checked_speed,
    concrete_array,
    count_functions,
    increase,
    number_list,
    plain,
    real_array,
    real_scalar,
    with_gaps,
)
from jaxbeam._fitting.matching import match_modes
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.loaded import Conditions, checked_conditions, guarded_conditions
from jaxbeam._modes.modes import find
from jaxbeam._modes.wanted import Wanted, choose, lowest_in_plane
from jaxbeam._programs.program import Program
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping
from jaxbeam._rotor.directions import Direction, Label
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._rotor.motion import Motion
from jaxbeam._simulation.checks import check_scene, checked_times
from jaxbeam._simulation.result import Simulation, checked_point
from jaxbeam._simulation.simulate import simulate
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Scalar, is_concrete


class Experiment(eqx.Module):
    """Numbers measured, NaN or masked where missing, and the standard deviation of their noise."""

    measured: eqx.AbstractVar[Array]
    noise: eqx.AbstractVar[Array]

    @abc.abstractmethod
    def predicted(self) -> Array:
        """The prediction of the model, in the shape of `measured`; NaN where it has no answer."""

    @property
    def present(self) -> Bool[Array, "..."]:
        """The mask of numbers that were measured: the others are NaN in the data."""
        return jnp.isfinite(self.measured)

    def residual(self) -> Float[Array, "..."]:
        """Predicted less measured, over the noise; 0 where nothing was measured."""
        apart = self.predicted() - jnp.where(self.present, self.measured, 0.0)
        return jnp.where(self.present, apart / self.noise, 0.0)


class FrequencyData(Experiment):
    """Frequencies measured at several angular speeds, against those of a model.

    `model` and `rotor` are those of `modes`, `angular_speed` (S,) is in rad/s, increasing, and
    `measured` (S, k) in rad/s, > 0, NaN or masked where missing; `noise` > 0, its standard
    deviation, is a number or as many. `which` labels the k columns (`jaxbeam.labels`), whatever
    their order; or it is k, and the columns are the lowest in the plane of rotation, in order.
    Without it the modes are not known: each row holds k frequencies in any order, and is held
    against the lowest `among` ones of the model (2 k by default) by the assignment of least squares
    in which each mode serves once. Modes that the measurement missed are so passed over.

    Raises `ValueError` or `TypeError`, naming the argument.
    """

    model: AbstractModel
    rotor: Rotor
    angular_speed: Float[Array, " S"]
    measured: Float[Array, "S k"]
    noise: Float[Array, "S k"]
    which: tuple[Label, ...] | int | None = eqx.field(static=True)
    among: int = eqx.field(static=True)

    def __init__(
        self, model: AbstractModel, rotor: Rotor, angular_speed: Any, measured: Any, noise: Any,
        which: Sequence[Label] | int | None = None, *, among: int | None = None,
    ) -> None:  # fmt: skip
        self.model, self.rotor, _ = checked_case(model, rotor)
        model = self.model
        self.angular_speed = _increasing("angular_speed", angular_speed)
        self.measured, self.noise = _data(measured, noise, (self.angular_speed.size, None))
        check_all("measured frequencies must be > 0", self.measured, lambda x: ~(x <= 0))
        k, total = self.measured.shape[1], len(model.directions)
        which = (which,) if isinstance(which, Label) else plain(which)
        self.which = tuple(which) if isinstance(which, Sequence) else which
        if isinstance(self.which, tuple):
            choose(model, self.which)
        elif self.which is not None and (isinstance(which, bool) or not isinstance(which, int)):
            raise TypeError(f"which must be labels, an int or None, got {which!r}")
        named = self.which if self.which is None or isinstance(self.which, int) else len(self.which)
        if named not in (None, k):
            raise ValueError(f"which must name {k} modes, one a column, got {named}")
        inside = total - model.directions.count(Direction.FLAP)
        if isinstance(self.which, int) and k > inside:
            raise ValueError(f"which: this model has {inside} modes in plane, got {k} columns")
        self.among = min(2 * k, total) if among is None else among
        count_functions("among", self.among)
        if not k <= self.among <= total:
            raise ValueError(f"among must be between {k} and {total}, got {among}")

    def predicted(self) -> Float[Array, "S k"]:
        """Frequencies of each column, or of the modes matched to each row."""
        if isinstance(self.which, int):
            wanted = lowest_in_plane(self.model, self.which)
        else:
            wanted = choose(self.model, self.among if self.which is None else self.which)
        found = _frequencies(self.model, self.rotor, self.angular_speed, wanted)
        if self.which is not None:
            return found
        matched = jax.vmap(match_modes)(self.measured, found)
        return jnp.take_along_axis(found, matched, axis=1)


def _tip(run: Simulation) -> Array:
    return run.tip[:, 1]


class HistoryData(Experiment):
    """Something that `simulate` computes over time: deflection, strain, torque.

    `model`, `rotor`, `motion`, `loads` and `damping` are those of `simulate`; `times` (T,) in s,
    increasing. `of(run)` takes it from a `Simulation`, in the shape of `measured` (T, ...); the
    in-plane deflection of the tip if not given. `lambda run: run.strain(0.1)[:, 0]` and
    `lambda run: run.hub_torque[:, 2]` are others (name a function once: a new lambda compiles
    anew). `noise` > 0 is a standard deviation, a number or one for each, in the same unit.
    `**options` are other keywords of `simulate`, but not `adjoint` and `throw`; runs must be
    differentiable forwards.

    Raises `ValueError` or `TypeError`, naming the argument.
    """

    model: AbstractModel
    rotor: Rotor
    motion: Motion
    times: Float[Array, " T"]
    measured: Float[Array, "T ..."]
    noise: Float[Array, "T ..."]
    of: Callable[[Simulation], Array] = eqx.field(static=True)
    loads: Loads
    damping: Damping
    options: dict[str, Any]

    def __init__(
        self, model: AbstractModel, rotor: Rotor, motion: Motion, times: Any, measured: Any,
        noise: Any, of: Callable[[Simulation], Array] = _tip, *, loads: Loads = NO_LOADS,
        damping: Damping = NO_DAMPING, **options: Any,
    ) -> None:  # fmt: skip
        self.model, self.rotor, _ = checked_case(model, rotor)
        self.motion = motion
        self.times = checked_times(times)
        self.measured, self.noise = _data(measured, noise, (self.times.size, ...))
        if not callable(of):
            raise TypeError(f"of must be a function of a Simulation, got {of!r}")
        for name in options:
            if name not in inspect.signature(simulate).parameters:
                raise TypeError(f"{name} is no argument of HistoryData, nor of simulate")
            if name in ("adjoint", "throw"):
                raise TypeError(f"{name} must not be given: HistoryData has its own")
        self.of, self.options = of, options
        self.loads, self.damping = loads, damping
        case = self.model, self.rotor
        check_scene(self.motion, self.loads, self.damping, self.times[0], case, throw=True)

    def predicted(self) -> Float[Array, "T ..."]:
        """The history of a run, NaN where the run failed."""
        run = simulate(
            self.model, self.rotor, self.motion, self.times, loads=self.loads,
            damping=self.damping, adjoint=diffrax.ForwardMode(), throw=False, **self.options,
        )  # fmt: skip
        value = self.of(run.partial)  # outputs that may not be used are left out below
        if value.shape != self.measured.shape:
            raise ValueError(f"of must give the shape {self.measured.shape}, got {value.shape}")
        usable = (run.status == Status.OK) | (run.status == Status.UNBALANCED)
        return jnp.where(usable, value, jnp.nan)


class StaticData(Experiment):
    """Displacements of points of a beam, at rest or in steady rotation under constant loads.

    `model`, `rotor` and `loads`, constant in the hub, are those of `modes`; `measured` (p,) in m,
    NaN or masked where missing, of the points `xi` = x / L, p numbers from 0 to 1 (the tip by
    default); `noise` > 0, its standard deviation, a number or (p,); `direction` is a `Direction`
    (axial, in plane or flap); `angular_speed` in rad/s.

    Where the hub turns, only gravity along its axis is constant in it, and models in a plane bear
    no loads across it. Forces at the tip and along the span are no functions of time.

    Raises `ValueError` or `TypeError`, naming the argument, and `ValueError` for any other loads;
    where these are traced, predictions are NaN.
    """

    model: AbstractModel
    rotor: Rotor
    measured: Float[Array, " p"]
    noise: Float[Array, " p"]
    loads: Loads
    angular_speed: Scalar
    xi: tuple[float, ...] = eqx.field(static=True)
    direction: int = eqx.field(static=True)

    def __init__(
        self, model: AbstractModel, rotor: Rotor, loads: Loads, measured: Any, noise: Any,
        xi: Any = 1.0, direction: int = 1, *, angular_speed: Any = 0.0,
    ) -> None:  # fmt: skip
        (self.model, self.rotor, _), self.loads = checked_case(model, rotor), loads
        points = np.atleast_1d(concrete_array("xi", xi)).tolist()
        self.direction, _ = checked_point(direction, 1.0)
        self.xi = tuple(checked_point(direction, point)[1] for point in points)
        if direction == 2 and Direction.FLAP not in model.directions:
            raise ValueError("direction 2 (flap) needs a model with flap functions")
        self.measured, self.noise = _data(measured, noise, (len(self.xi),))
        self.angular_speed = checked_speed(angular_speed)
        conditions = checked_conditions(loads, NO_DAMPING)
        if conditions is not None:
            status = conditions.status(self.model, self.rotor, self.angular_speed)
            if is_concrete(status):
                raise_unless_ok(self.loads, status)

    def predicted(self) -> Float[Array, " p"]:
        """Displacements at the equilibrium, NaN where none was found."""
        return _static_displacements(self)


@Program
def _static_displacements(data: StaticData) -> Float[Array, " p"]:
    given, rotor, speed, conditions = guarded_conditions(
        data.model, data.rotor, data.angular_speed, Conditions(data.loads, NO_DAMPING)
    )
    q, status, *_ = conditions.state(data.model, rotor, speed)
    value = data.model.equations(rotor).displacement(q, np.array(data.xi))[:, data.direction]
    return jnp.where((given == Status.OK) & (status == Status.OK), value, jnp.nan)


class ResonanceMargin(Experiment):
    """A demand in place of a measurement: no frequency within `margin` of a harmonic of the speed.

    For the modes `which` (labels) of `model` and `rotor`, and the integer `harmonics` k of the
    working speeds Omega (`angular_speed`, shape (S,), in rad/s, increasing, all > 0; as many as
    make the range dense), f / (k Omega) stays above 1 + margin or below 1 - margin all along, on
    the side where most of it lies. `margin` is in (0, 1). `predicted`, shape (modes, harmonics, S),
    is by how much that falls short; `slack` > 0 stands for the noise. Give priors: where the demand
    is met it says nothing about the parameters.

    Raises `ValueError` or `TypeError`, naming the argument.
    """

    model: AbstractModel
    rotor: Rotor
    angular_speed: Float[Array, " S"]
    which: tuple[Label, ...] = eqx.field(static=True)
    harmonics: tuple[int, ...] = eqx.field(static=True)
    margin: Scalar
    measured: Float[Array, "m h S"]
    noise: Float[Array, "m h S"]

    def __init__(
        self, model: AbstractModel, rotor: Rotor, angular_speed: Any, which: Sequence[Label],
        harmonics: Sequence[int] | np.ndarray, margin: Any = 0.05, slack: Any = 1e-3,
    ) -> None:  # fmt: skip
        self.model, self.rotor, _ = checked_case(model, rotor)
        model = self.model
        self.angular_speed = _increasing("angular_speed", angular_speed)
        check_all("angular_speed must be > 0", self.angular_speed, lambda x: x > 0)
        self.which = (which,) if isinstance(which, Label) else tuple(_list_of("which", which))
        listed = harmonics.tolist() if isinstance(harmonics, np.ndarray) else harmonics
        self.harmonics = tuple(map(plain, _list_of("harmonics", listed)))
        choose(model, self.which)
        if not self.harmonics or any(type(k) is not int or k < 1 for k in self.harmonics):
            raise ValueError(f"harmonics must be integers >= 1, got {harmonics}")
        self.margin = real_scalar("margin", margin)
        check_all("margin must be in (0, 1)", self.margin, lambda x: (x > 0) & (x < 1))
        shape = (len(self.which), len(self.harmonics), self.angular_speed.size)
        self.measured, self.noise = _data(np.zeros(shape), slack, shape)

    def distance(self) -> Float[Array, "m h S"]:
        """The relative distance f / (k Omega) - 1 of each frequency from each harmonic."""
        wanted = choose(self.model, self.which)
        found = _frequencies(self.model, self.rotor, self.angular_speed, wanted).T
        lines = np.array(self.harmonics, float)[:, None] * self.angular_speed[None]
        return found[:, None] / lines[None] - 1

    def predicted(self) -> Float[Array, "m h S"]:
        """The part of the margin that is missing, zero where it is kept."""
        distance = self.distance()
        side = jnp.sign(jnp.mean(jnp.log1p(jax.lax.stop_gradient(distance)), 2, keepdims=True))
        return jnp.maximum(self.margin - side * distance, 0.0)


def residuals_of(experiments: list[Experiment]) -> list[Array]:
    """Residuals of each experiment; experiments of one structure share a program, one after the
    other."""
    groups: list[list[int]] = []
    for i, experiment in enumerate(experiments):
        for group in groups:
            if _alike(experiments[group[0]], experiment):
                group.append(i)
                break
        else:
            groups.append([i])
    found: dict[int, Array] = {}
    for group in groups:
        arrays, rest = zip(
            *(eqx.partition(experiments[i], eqx.is_array) for i in group), strict=True
        )
        stacked = jax.tree.map(lambda *a: jnp.stack(a), *arrays)
        one = functools.partial(_residual, rest[0])
        rows = jax.lax.map(one, stacked) if len(group) > 1 else [one(arrays[0])]
        found.update(zip(group, rows, strict=True))
    return [found[i] for i in range(len(experiments))]


def _residual(rest: Experiment, arrays: Experiment) -> Array:
    return eqx.combine(arrays, rest).residual().ravel()


def _alike(a: Experiment, b: Experiment) -> bool:
    """Whether two experiments differ only in values of arrays."""
    parts = [eqx.partition(each, eqx.is_array) for each in (a, b)]
    shapes = [[(x.shape, x.dtype) for x in jax.tree.leaves(arrays)] for arrays, _ in parts]
    structures = {jax.tree.structure(arrays) for arrays, _ in parts}
    others_equal = bool(eqx.tree_equal(*(rest for _, rest in parts)))
    return len(structures) == 1 and shapes[0] == shapes[1] and others_equal


def _frequencies(
    model: AbstractModel, rotor: Rotor, speeds: Float[Array, " S"], wanted: Wanted
) -> Float[Array, "S k"]:
    """Frequencies of the wanted modes at each speed, NaN where a case failed."""
    return jax.vmap(lambda w: find(model, rotor, w, wanted).frequency)(speeds)


def _list_of(name: str, values: Any) -> Sequence[Any]:
    if not isinstance(values, Sequence) or isinstance(values, str):
        raise TypeError(f"{name} must be a list, got {values!r}")
    return values


def _increasing(name: str, values: Any) -> Array:
    values = number_list(name, values)
    check_all(f"{name} must be finite", values)
    check_all(f"{name} must increase", values, increase)
    return values


def _data(measured: Any, noise: Any, shape: tuple[Any, ...]) -> tuple[Array, Array]:
    """Measured numbers and their noise as arrays, checked: of a shape with given lengths (None:
    any; ... at the end: any further axes)."""
    measured = real_array("measured", with_gaps(measured))
    given = shape[:-1] if shape[-1] is ... else shape
    right = len(measured.shape) >= len(given) if shape[-1] is ... else measured.ndim == len(given)
    if not right or any(n not in (None, m) for n, m in zip(given, measured.shape, strict=False)):
        wanted = ", ".join("any" if n is None else "..." if n is ... else str(n) for n in shape)
        raise ValueError(f"measured must have shape ({wanted}), got {measured.shape}")
    check_all("measured must be finite, or NaN where missing", measured, lambda x: ~np.isinf(x))
    check_all("measured must hold a number at least", measured, lambda x: np.isfinite(x).any())
    noise, shape = real_array("noise", noise), measured.shape
    if noise.ndim > len(shape) or any(
        n not in (1, m) for n, m in zip(noise.shape[::-1], shape[::-1], strict=False)
    ):
        raise ValueError(f"noise must be a number or have shape {shape}, got {noise.shape}")
    noise = jnp.broadcast_to(noise, shape)
    check_all("noise must be finite and > 0", noise, lambda x: np.isfinite(x) & (x > 0))
    return measured, noise
