"""What became of a case: a code that travels through `jit` and `vmap`, and its sentence."""

import enum
from typing import Any, TypeVar

import equinox as eqx
import jax

Result = TypeVar("Result")


class Status(enum.IntEnum):
    """Outcome of one case. Zero means that the numbers beside it may be used."""

    OK = 0
    INVALID_LENGTH = 1
    INVALID_MASS_PER_LENGTH = 2
    INVALID_AXIAL_STIFFNESS = 3
    INVALID_IN_PLANE_BENDING_STIFFNESS = 4
    INVALID_FLAP_BENDING_STIFFNESS = 5
    INVALID_HUB_RADIUS = 6
    INVALID_TIP_MASS = 7
    INVALID_ANGULAR_SPEED = 8
    NO_EQUILIBRIUM = 9
    NOT_CONVERGED = 10
    NO_CROSSING = 11
    NOT_FINITE = 12
    RAISED = 13
    INACCURATE = 14

    @property
    def message(self) -> str:
        """The sentence that an exception with this status carries."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OK: "ok",
    Status.INVALID_LENGTH: "length must be finite and > 0",
    Status.INVALID_MASS_PER_LENGTH: "mass_per_length must be finite and > 0",
    Status.INVALID_AXIAL_STIFFNESS: "axial_stiffness must be finite and > 0",
    Status.INVALID_IN_PLANE_BENDING_STIFFNESS: (
        "in_plane_bending_stiffness must be finite and > 0"
    ),
    Status.INVALID_FLAP_BENDING_STIFFNESS: "flap_bending_stiffness must be finite and > 0",
    Status.INVALID_HUB_RADIUS: "hub_radius must be finite and >= 0",
    Status.INVALID_TIP_MASS: "tip_mass must be finite and >= 0",
    Status.INVALID_ANGULAR_SPEED: "angular_speed must be finite",
    Status.NO_EQUILIBRIUM: (
        "no stable steady rotation at this angular_speed: the centrifugal load grows faster "
        "with stretch than the axial stiffness carries; lower angular_speed, tip_mass or "
        "length, or raise axial_stiffness"
    ),
    Status.NOT_CONVERGED: (
        "the search for the steady rotation did not converge at this angular_speed; "
        "lower it, or use more elements"
    ),
    Status.NO_CROSSING: (
        "no crossing in bracket: frequency minus harmonic times angular_speed must change "
        "sign between its ends, and not by a jump where the label changes branch in a veering"
    ),
    Status.NOT_FINITE: "the result is not finite",
    Status.RAISED: "the case raised an exception; see `errors`",
    Status.INACCURATE: (
        "eigenvectors miss their equation by more than 1e-9 (see residual): use fewer functions, "
        "or keep away from a critical speed"
    ),
}


def raise_unless_ok(result: Result, status: Any) -> Result:
    """`result`, or the exception that belongs to `status`; works inside `jit`.

    `ValueError` where a parameter is out of range, else `RuntimeError`; inside `jit` always the
    latter, with the same sentence.
    """
    if isinstance(status, jax.core.Tracer):
        sentences = [s.message for s in Status]
        return eqx.branched_error_if(result, status != Status.OK, status, sentences)
    ended = Status(int(status))
    if Status.OK < ended < Status.NO_EQUILIBRIUM:
        raise ValueError(ended.message)
    if ended != Status.OK:
        raise RuntimeError(ended.message)
    return result
