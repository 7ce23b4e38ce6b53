"""Branches of a Campbell diagram: what a mode becomes as the speed changes, followed by order.

Eigenvalues of small motion of a conservative system whose stiffness is positive definite are those
of a Hermitian matrix,

    i [[0, A^T], [-A, -g]],   A = R^-1 L,  g = R^-1 G R^-T,  K = L L^T,  M = R R^T,

and of a family of such by one parameter two do not meet, but part in a veering, unless a symmetry
keeps them from being coupled (J. von Neumann, E. Wigner, Physikalische Zeitschrift 30, 1929). So
the k-th lowest frequency of all modes that are coupled with one another is one smooth function of
the speed, however narrow its veerings are: nothing is followed from speed to speed, and it does not
matter how far these are apart.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.loaded import Conditions, guarded_conditions, system_of
from jaxbeam._modes.dense import coupled_with
from jaxbeam._modes.search import search
from jaxbeam._modes.wanted import Wanted, lowest
from jaxbeam._numerics.linalg import positive_definite
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._results import without_derivatives
from jaxbeam._rotor.beam import AnyRotor, Rotor
from jaxbeam._rotor.directions import Direction, Label, loose_motions
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._sweeps.cases import grid
from jaxbeam._sweeps.sweep import sweep
from jaxbeam._types import Scalar

# Relative distance of two frequencies below which shapes of the modes are arbitrary mixtures.
_APART = 1e-6
_MORE = 4  # modes computed at first, beyond twice those wanted


def along_branches(
    model: AbstractModel, rotor: Rotor, conditions: Conditions | None, speeds: np.ndarray,
    labels: tuple[Label, ...],
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Frequencies (speeds, labels) along the branches whose modes have these labels at the slowest
    speed, and the status of each speed."""
    total = len(model.directions)
    count = min(2 * len(labels) + _MORE, total)
    while True:
        case = jax.tree_util.Partial(_case, model, rotor, lowest(model, count), conditions)
        seen = sweep(case, grid(angular_speed=speeds)).values
        frequency, status, are_few = _joined(seen, np.abs(speeds), labels)
        if not are_few or count == total:
            return frequency, status
        count = min(2 * count, total)


def _case(
    model: AbstractModel, rotor: AnyRotor, wanted: Wanted, conditions: Conditions | None,
    *, angular_speed: Scalar,
) -> dict[str, Array]:  # fmt: skip
    """The lowest modes at one speed, the directions that are coupled with each, and whether
    functions are too few, which does not matter for the highest."""
    given, rotor, speed, held = guarded_conditions(model, rotor, angular_speed, conditions)
    system = system_of(model, rotor, speed, held)
    free = loose_motions(rotor)
    fixed = without_derivatives((system, (rotor, speed, wanted)))
    found, _ = search(model, None, *fixed, free, conditions is None or system.lacking is not None)
    definite = positive_definite(symmetric_part(system.stiffness)) | ((speed == 0) & (free > 0))
    steady = definite & jnp.all(found.eigenvalue.real <= 0)
    status = first_failure(given, found.status, first_broken((steady, Status.NO_EQUILIBRIUM)))
    error, few = found.frequency_error, jnp.zeros(wanted.count, bool)
    if error is not None and model.judged(rotor):
        few = ~(error <= model.most_error(rotor, speed))
    of_each = np.array(system.directions)[:, None] == np.array(Direction)
    inside = coupled_with(system, found.direction)
    return {
        "frequency": found.eigenvalue.imag,
        "direction": found.direction,
        "number": found.number,
        "coupled": jnp.any(inside[:, :, None] & of_each[None], 1),
        "few": few,
        "status": status,
    }


def _joined(
    seen: dict[str, Any], speeds: np.ndarray, labels: tuple[Label, ...]
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Frequencies and status by branch, from the lowest modes at all speeds, and whether there are
    too few of these.

    Directions that are coupled at one speed are so at all but single ones, such as zero.
    """
    frequency = np.full((len(speeds), len(labels)), np.nan)
    status = np.array(seen["status"])
    fine = np.flatnonzero(status == Status.OK)
    if not fine.size:
        return frequency, status, False
    coupled = seen["coupled"][fine].reshape(-1, len(Direction)).astype(int)
    linked = np.linalg.matrix_power(coupled.T @ coupled + np.eye(len(Direction)), 4) > 0
    group = np.argmax(linked, 1)[seen["direction"]]
    same = group[:, :, None] == group[:, None]
    rank = np.sum(np.tril(same, -1), 2)  # ranks, since frequencies are in order
    place = group * rank.shape[1] + rank
    first = _clear(seen["frequency"], same, fine[np.argsort(speeds[fine])])
    wanted = np.array(labels)
    is_named = (seen["direction"][first] == wanted[:, :1]) & (
        seen["number"][first] == wanted[:, 1:]
    )
    of_label = np.where(is_named.any(1), place[first][np.argmax(is_named, 1)], -1)
    for i in fine:
        own = place[i] == of_label[:, None]
        if not own.any(1).all():
            status[i] = Status.NOT_FINITE
            continue
        at = np.argmax(own, 1)
        below = same[i][at] & (rank[i] <= rank[i][at, None])
        if np.any(below & seen["few"][i]):
            status[i] = Status.TOO_FEW_FUNCTIONS
        else:
            frequency[i] = seen["frequency"][i][at]
    return frequency, status, bool(np.any(status[fine] == Status.NOT_FINITE))


def _clear(frequency: np.ndarray, same: np.ndarray, order: np.ndarray) -> int:
    """The first of the speeds, in this order, at which modes that are coupled are apart, so that
    labels are certain; else the first."""
    for i in order:
        near = np.abs(frequency[i][:, None] - frequency[i]) <= _APART * frequency[i]
        if np.sum(near & same[i]) == len(near):
            return int(i)
    return int(order[0])
