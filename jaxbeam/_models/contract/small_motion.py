"""Matrices of small motion about a state of rest."""

from typing import Any, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxbeam._models.contract.equations import Equations, Inputs
from jaxbeam._models.contract.equilibrium import Rest
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._programs.program import Program
from jaxbeam._results import harmless, nan_unless
from jaxbeam._rotor.beam import AnyRotor, Beam, Rotor
from jaxbeam._rotor.motion import spinning
from jaxbeam._status import Status, first_failure
from jaxbeam._types import Code, Coordinates, Scalar

TheRotor = TypeVar("TheRotor", bound=AnyRotor)  # the kind of rotor that a model takes


def small_motion(
    model: Any, rotor: AnyRotor, speed: Scalar, equations: Equations, rest: Rest,
    inputs: Inputs | None = None, **known: Any,
) -> LinearSystem:  # fmt: skip
    """Matrices of small motion about a state of rest: tangents of the equations under `inputs`, by
    default steady rotation without loads. `known` are fields of the system that callers have."""
    hub, *acting = (spinning(speed), None, None) if inputs is None else inputs
    q, status, matrices, lacking, taken_along = rest
    if matrices is None:
        matrices = equations.matrices_about(hub, q, *acting)
    if "steady_strain" not in known:
        known["steady_strain"] = steady_strain(rotor, speed, equations, q)
    fields = {
        "coupling": model.coupling(rotor),
        "shapes": equations.functions,
        "lacking": lacking,
        "taken_along": taken_along,
        "general": model.couples_all,
    }
    mass, by_rates, stiffness = matrices
    return LinearSystem(
        mass=mass,
        gyroscopic=by_rates,
        stiffness=stiffness,
        status=status,
        directions=model.directions,
        **fields | known,
    )


def steady_strain(rotor: AnyRotor, speed: Scalar, equations: Equations, q: Coordinates) -> Scalar:
    """The axial strain of a steady state: at the root, or of a beam that varies the largest P / EA,
    since smooth functions do not have the steps of strain."""
    if isinstance(rotor, Rotor) and rotor.varies and isinstance(rotor.beam, Beam):
        return rotor.steady_strain(speed)
    return equations.strain(q, np.zeros(1))[0]


@Program
def linearised(model: Any, rotor: Rotor, speed: Scalar) -> LinearSystem:
    """Matrices of small motion about steady rotation, NaN where there is no steady state or
    parameters are out of range."""
    given, rotor, speed = guarded(rotor, speed)
    system = model.matrices(rotor, speed)
    status = first_failure(given, system.status)

    def numbers(s: LinearSystem) -> tuple[Any, ...]:
        return s.mass, s.gyroscopic, s.stiffness, s.steady_strain, s.state

    kept = *nan_unless(status == Status.OK, numbers(system)), status
    return eqx.tree_at(
        lambda s: (*numbers(s), s.status), system, kept, is_leaf=lambda leaf: leaf is None
    )


def guarded(rotor: TheRotor, speed: Scalar) -> tuple[Code, TheRotor, Scalar]:
    """The status of rotor and speed, and these with harmless numbers where they are not in range.

    A NaN in one case of a batch would otherwise come into gradients by parameters that cases share.
    """
    given = rotor.status(speed)
    fine = given == Status.OK
    return given, harmless(fine, rotor), jnp.where(fine, speed, 0.0)
