"""What became of a case: a code that travels through `jit` and `vmap`, and its sentence."""

import contextlib
import enum
import logging
import os
import re
from collections.abc import Iterator
from typing import Any, Self, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Primitive
from jax.interpreters import batching, mlir

from jaxbeam._types import is_concrete

Result = TypeVar("Result")


INPUT = True  # whether the input is wrong
_SECTIONS = " at every station: look at the order of rows (see jaxbeam.blades.Blade)"
_RADIANS = ", in rad (4 degrees are np.deg2rad(4.0))"


@enum.unique  # a number used twice would make two names of one code
class Status(enum.IntEnum):
    """Outcome of one case. Zero means that the numbers beside it may be used.

    A code keeps its number in all releases, since files hold them; new ones go to the end. Each
    has the sentence that an exception with it carries, and says whether the input is to blame.
    """

    message: str
    blames_input: bool

    def __new__(cls, code: int, message: str = "", blames_input: bool = False) -> Self:
        status = int.__new__(cls, code)
        status._value_, status.message, status.blames_input = code, message, blames_input
        return status

    OK = 0, "ok"
    INVALID_LENGTH = 1, "length must be finite and > 0", INPUT
    INVALID_MASS_PER_LENGTH = 2, "mass_per_length must be finite and > 0", INPUT
    INVALID_AXIAL_STIFFNESS = 3, "axial_stiffness must be finite and > 0", INPUT
    INVALID_IN_PLANE_BENDING_STIFFNESS = (
        4,
        "in_plane_bending_stiffness must be finite and > 0",
        INPUT,
    )
    INVALID_FLAP_BENDING_STIFFNESS = (
        5,
        "flap_bending_stiffness must be finite and > 0",
        INPUT,
    )
    INVALID_HUB_RADIUS = 6, "hub_radius must be finite", INPUT
    INVALID_TIP_MASS = 7, "tip_mass must be finite and >= 0", INPUT
    INVALID_ANGULAR_SPEED = 8, "angular_speed must be finite", INPUT
    INVALID_MASS = 9, "mass must be finite and > 0", INPUT
    INVALID_TRANSLATIONAL_SPRING = 10, "translational_spring must be finite and > 0", INPUT
    INVALID_TORSIONAL_SPRING = 11, "torsional_spring must be finite and > 0", INPUT
    INVALID_MOTION = (
        12,
        "motion must be finite over the whole run, its durations and frequencies > 0, its "
        "rotation proper orthogonal; in floquet and tongue its speed repeats after the period",
        INPUT,
    )
    INVALID_LOAD = 13, "gravity and all other loads must be finite over the whole run", INPUT
    INVALID_DAMPING = 14, "damping must be finite and >= 0", INPUT
    INVALID_TIMES = (
        15,
        "times must be finite and increasing, saveat must save within them, and dt0 be > 0",
        INPUT,
    )
    INVALID_START = 16, "start must be finite", INPUT
    OUT_OF_PLANE = (
        17,
        "the motion or the loads leave the plane of rotation, and the model has no "
        "coordinates there: take a model with flap functions",
        INPUT,
    )
    NO_EQUILIBRIUM = (
        18,
        "no stable steady rotation at this angular_speed: either the rod tears, since the "
        "centrifugal load grows faster with stretch than its stiffness carries (lower "
        "angular_speed, tip_mass or length, or raise axial_stiffness), or a mode grows, since "
        "bending or what holds the root is too soft for the speed, the gravity and the loads: "
        "lower them, give root_springs a stiffness, or take Hybrid in the place of Classical, "
        "which has no stiffening (see critical_speed, and growth_rate of modes)",
    )
    NOT_CONVERGED = (
        19,
        "the search did not converge at this angular_speed: where it was for the steady "
        "rotation, lower angular_speed or loads, or use more elements; where it was for the "
        "boundary of a tongue, another mode passes by",
    )
    NO_CROSSING = (
        20,
        "no crossing in bracket: frequency minus harmonic times angular_speed must change "
        "sign between its ends, and not by a jump where the label changes branch in a veering",
    )
    NOT_FINITE = 21, "the result is not finite"
    RAISED = 22, "the case raised an exception; see `errors`"
    INACCURATE = (
        23,
        "eigenvectors miss their equation by more than 1e-9 (see residual): use fewer "
        "functions, or keep away from a critical speed; in tongue: modes are not recognised at "
        "this depth, take a smaller one",
    )
    MAX_STEPS = (
        24,
        "the solver used up max_steps before the last time: raise max_steps, loosen the tolerance "
        "(stepsize_controller), give linear models at constant speed to jaxbeam.solvers.Magnus in "
        "long fixed steps, or look whether the model is unstable here",
    )
    STEP_FAILED = (
        25,
        "the solver could not make a step: an implicit stage did not converge, or the step "
        "fell below its minimum",
    )
    DIVERGED = (
        26,
        "the tip left its place by more than ten lengths: no such beam. The model is unstable "
        "here (Classical and LC above a critical speed are), its loads are too large, or the step "
        "is too long",
    )
    UNBALANCED = (
        27,
        "the solver called it a success, but energy is not balanced by the work done: tighten "
        "the tolerance, shorten the step, or take an implicit solver",
    )
    NO_TONGUE = (
        28,
        "no parametric resonance at this depth: damping outweighs the modulation, or the "
        "region is narrower than rounding resolves; raise the depth",
    )
    TOO_FEW_STEPS = (
        29,
        "steps are too long for the fastest mode, or for the one that stiffness_coefficient "
        "damps most: raise steps, or take a model with fewer functions. The axial modes are both: "
        "a model without them (Hybrid with n_stretch=0) needs few steps, others may need some "
        "thousands, which cost little beside the compilation",
    )
    TOLERANCE_NOT_MET = (
        30,
        "no rung of the ladder is sure to meet the tolerance: the best answer and the "
        "estimate of its error are kept",
    )
    NOT_IDENTIFIABLE = (
        31,
        "the data cannot tell all parameters apart: fix some, give a prior, or measure "
        "something else (see combinations)",
    )
    FIT_NOT_CONVERGED = (
        32,
        "the search for the best parameters did not end within max_steps: raise it, start "
        "nearer, or give bounds or priors",
    )
    UNRESOLVED = (
        33,
        "the hub's velocity changes by more than its rate integrates to: it jumps. Declare "
        "when (jumps=[...] of HubVelocity and HubPose, jump_times of a motion of your own), "
        "so that the beam gets the impulse, or let the motion rise smoothly",
    )
    INVALID_TWIST = 34, f"twist must be finite and within a turn either way{_RADIANS}", INPUT
    INVALID_PITCH = 35, f"pitch must be finite and within a turn either way{_RADIANS}", INPUT
    INVALID_ROOT_SPRINGS = 36, "springs at the root must be finite and >= 0", INPUT
    INVALID_TIP_BODY = (
        37,
        "offset of the tip body must be finite, its inertia finite and >= 0",
        INPUT,
    )
    INVALID_PRECONE = 38, f"precone must be finite and within a quarter turn{_RADIANS}", INPUT
    INVALID_TORSIONAL_STIFFNESS = 39, "torsional_stiffness must be finite and > 0", INPUT
    INVALID_POLAR_INERTIA = 40, "polar_inertia must be finite and > 0", INPUT
    OUT_OF_RANGE = (
        41,
        "sections of an element in space turn against each other by more than its polynomials "
        "follow: take a higher degree or more elements, or look whether the loads are meant",
    )
    TOO_FEW_FUNCTIONS = (
        42,
        "functions, or points of integration, leave out more than 1e-3 of a frequency, of a soft "
        "beam 1e-6 (see frequency_error): take more functions (of a SpatialRod elements) or ask "
        "for fewer modes, and of a soft beam whose numbers are traced the basis "
        "jaxbeam.models.Layered(); where a property varies faster than a table with stations of "
        "its own would say, give it stations or kinks",
    )
    NOT_HELD = (
        43,
        "nothing holds the beam at this angular_speed, since a hinge or a support is free (its "
        "springs are zero): give it a stiffness, or a speed at which it is held",
    )
    TURNING_GRAVITY = (
        44,
        "gravity must be along the axis of rotation, (0, 0, g), where angular_speed is not zero: "
        "across it, it turns in the hub, and nothing rests there",
        INPUT,
    )
    BUCKLED = (
        46,
        "the loads buckle the beam at rest, so that no speed is the first at which it loses its "
        "stability: see critical_load; lower them",
    )
    NO_POTENTIAL = (
        45,
        "loads that follow the tip, and moments at it, have no potential: where a beam that turns "
        "loses its stability under them, modes with loads and damping tells by its growth rates",
        INPUT,
    )
    INVALID_STEP = (
        47,
        "angle must be finite and > 0, damping_ratio finite, growth finite and > 1",
        INPUT,
    )
    LOADS_ACROSS = (
        48,
        "loads across the beam do not change the stiffness of a model that is linear, so that "
        "nothing gives way under them there: take SpatialRod, which buckles sideways (it needs "
        "torsional_stiffness), or PlanarRod in the plane; or keep of the loads what is along the "
        "beam",
        INPUT,
    )
    SEARCH_ENDED = (
        49,
        "the beam is stable under the largest of the loads that are looked at, and under larger "
        "ones it may not be (see critical_load): where loads bend it until it hangs from them "
        "nothing gives way; else take more elements or another model, or ask modes with loads",
    )
    INVALID_POINT_MASSES = 50, "point masses must be finite and >= 0", INPUT
    INVALID_SECTION_STIFFNESS = 55, f"stiffness must be positive definite{_SECTIONS}", INPUT
    INVALID_SECTION_INERTIA = 56, f"inertia must have mass > 0, moments >= 0{_SECTIONS}", INPUT
    INVALID_SUPPORT = 58, "springs of a support must be >= 0, its attitude at most 2 pi", INPUT
    INVALID_AXIS = 57, "points of the axis must be finite, each apart from the next", INPUT
    INVALID_RIGID_BODY = (
        60,
        "centre_of_mass of the rigid body must be finite, its inertia that of a body: principal "
        "moments >= 0, none above the sum of the others (look at signs of products)", INPUT,
    )  # fmt: skip
    INVALID_GYRATION = 61, "gyration must be finite and >= 0, in m, at every station", INPUT


_ALLOWED = np.ones(max(Status) + 1, bool)
_ALLOWED[[status for status in Status if status.blames_input]] = False


def in_range(status: Any) -> Any:
    """Whether all parameters of a case were in range, whatever its result."""
    return jnp.asarray(_ALLOWED)[status]


def trusted(status: Any) -> Any:
    """Whether the numbers of a run may be used as far as it got: it came to its end, or was stopped
    before. Every other status says that they are not those that were asked for."""
    whole = (status == Status.OK) | (status == Status.MAX_STEPS) | (status == Status.STEP_FAILED)
    return whole | (status == Status.DIVERGED) | (status == Status.UNRESOLVED)


def first_failure(*statuses: Any) -> Any:
    """The first of some statuses that is not `OK`, else `OK`. Works under `jit` and `vmap`."""
    *before, found = statuses
    for status in reversed(before):
        found = jnp.where(status == Status.OK, found, status)
    return jnp.asarray(found).astype(int)


def first_broken(*rules: tuple[Any, Status]) -> Any:
    """The status that belongs to the first rule that does not hold, else `OK`.

    A rule is a condition, which may be traced, and the status of a case that breaks it. One that is
    `True` costs nothing.
    """
    found = jnp.asarray(Status.OK)
    for holds, status in reversed(rules):
        found = found if holds is True else jnp.where(holds, found, status)
    return found.astype(int)


def raise_unless_ok(result: Result, status: Any) -> Result:
    """The `result`, or the exception that belongs to `status`; works inside `jit`.

    `ValueError` where a parameter is out of range, else `RuntimeError`. Inside a compiled program
    as a rule the latter, and it comes from the runtime of XLA: the sentence is its last line, and
    is logged before it (`said` finds it again). Of a batch the largest status counts.
    """
    if is_concrete(status):
        _raise_unless_ok(status, short=_short_floats())
        return result
    if os.environ.get("EQX_ON_ERROR", "raise") != "raise":  # NaN, for example
        sentences = [_explained(status, _short_floats()) for status in sorted(Status)]
        return eqx.branched_error_if(result, status != Status.OK, status, sentences)
    # Always true, but not known to the compiler.
    passed = _passed.bind(status, short=_short_floats()) >= 0
    return jax.tree.map(
        lambda leaf: jnp.where(passed, leaf, jnp.zeros_like(leaf)) if eqx.is_array(leaf) else leaf,
        result,
    )


def said(error: Exception) -> str | None:
    """The sentence of a case that raised in a compiled program; None for any other error."""
    if isinstance(error, eqx.EquinoxRuntimeError):
        # Equinox adds a stack to the sentence, and keeps only the last one of all threads: the
        # right one is in the exception behind.
        found = re.search(_SENTENCE, str(error.__context__ or error), re.DOTALL)
        return found.group(1) if found else str(error).strip().split("\n")[0]
    # JAX raises ValueError where it waits for a result, elsewhere JaxRuntimeError.
    found = re.search(_SENTENCE, str(error), re.DOTALL)
    return found.group(1) if found else None


@contextlib.contextmanager
def unlogged() -> Iterator[None]:
    """A block in which errors of cases are collected, and not logged."""

    def none(_: logging.LogRecord) -> bool:
        return False

    logs = _LOG, _LOG_OF_JAX
    for log in logs:
        log.addFilter(none)
    try:
        yield
    finally:
        for log in logs:
            log.removeFilter(none)


class CaseError(RuntimeError):
    """An error that passes through XLA, which keeps only its class name and sentence."""


_SENTENCE = r"(?:EquinoxRuntimeError|CaseError): (.*?)(?:\n\n|$)"
_LOG, _LOG_OF_JAX = map(logging.getLogger, ("jaxbeam", "jax._src.callback"))
# JAX logs the same exception with a stack of its own insides; once is enough.
_LOG_OF_JAX.addFilter(
    lambda record: not (record.exc_info and isinstance(record.exc_info[1], CaseError))
)


def _short_floats() -> bool:
    return bool(jnp.result_type(float) == jnp.float32)


def _explained(status: Status, short: bool) -> str:
    """The sentence of a status; with 32-bit floats, JAX's default, also with what these do to
    searches and runs."""
    if not short or status == Status.OK or status.blames_input:
        return status.message
    return (
        f"{status.message}. jax runs in 32-bit floats, in which tolerances may be out of reach: "
        "call jax.config.update('jax_enable_x64', True) before anything else"
    )


def _raise_unless_ok(status: Any, *, short: bool) -> None:
    ended = Status(int(status))
    if ended.blames_input:
        raise ValueError(ended.message)
    if ended != Status.OK:
        raise RuntimeError(_explained(ended, short))


# The status itself, if it is OK. Where values are concrete (in `vmap` and `grad` without `jit`) it
# raises as it does without them; in a compiled program by a call back to Python.
_passed = Primitive("passed")


@_passed.def_impl
def _passed_concrete(status: Any, *, short: bool) -> Any:
    _raise_unless_ok(status, short=short)
    return status


@_passed.def_abstract_eval
def _passed_shape(status: Any, **_: Any) -> Any:
    return status


def _passed_batch(given: Any, axes: Any, **how: Any) -> Any:
    (batch,) = given
    return jnp.broadcast_to(_passed.bind(jnp.max(batch), **how), batch.shape), *axes


def _passed_compiled(status: Any, *, short: bool) -> Any:
    def fail(code: Any) -> Any:
        message = _explained(Status(int(code)), short)
        _LOG.error(message)
        raise CaseError(message)

    shape = jax.ShapeDtypeStruct(status.shape, status.dtype)
    return jax.lax.cond(
        status == Status.OK, lambda s: s, lambda s: jax.pure_callback(fail, shape, s), status
    )


batching.primitive_batchers[_passed] = _passed_batch
mlir.register_lowering(_passed, mlir.lower_fun(_passed_compiled, multiple_results=False))
