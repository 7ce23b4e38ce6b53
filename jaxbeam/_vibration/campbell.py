"""Campbell diagrams: frequencies over speed."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from jaxbeam._checks import concrete_array
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case, fastest
from jaxbeam._models.contract.loaded import Conditions, checked_conditions
from jaxbeam._modes.modes import find
from jaxbeam._modes.wanted import Wanted, choose
from jaxbeam._results import InHertz
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping
from jaxbeam._rotor.directions import Label
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._status import Status
from jaxbeam._sweeps.cases import grid
from jaxbeam._sweeps.sweep import sweep
from jaxbeam._sweeps.table import Table
from jaxbeam._types import Scalar
from jaxbeam._vibration.branches import along_branches
from jaxbeam._vibration.crossing import Crossing, crossing

_CLOSER = 17  # number of speeds at which an interval where a label jumps is looked at again


class Campbell(InHertz, eqx.Module):
    """Frequency over speed for labelled modes of one rotor.

    `table` holds `frequency` and `growth_rate` (rad/s, 1/s; dimensions angular_speed, mode) and
    `status`; `labels` names the modes. `model`, `rotor`, `loads` and `damping` are those of which
    the diagram is.
    """

    model: AbstractModel
    rotor: Rotor
    labels: tuple[Label, ...] = eqx.field(static=True)
    table: Table = eqx.field(static=True)
    loads: Loads = NO_LOADS
    damping: Damping = NO_DAMPING

    @property
    def frequency(self) -> np.ndarray:
        """Frequencies in rad/s, (speeds, modes)."""
        return self.table["frequency"]

    @property
    def status(self) -> np.ndarray:
        """`Status` of each speed of the diagram, in the order given."""
        return self.table["status"]

    def branches(self) -> Table:
        """Frequencies along branches, in the place of those of labels.

        In a veering two branches come near and part, and their modes exchange their motion; labels
        go with the motion, from one branch to the other, so that a line of theirs jumps. A branch
        is one smooth function of the speed. Each bears the label of its mode at the slowest speed
        of the diagram, zero if that is among them (at the first one at which no two modes that are
        coupled have the same frequency). At all others it is the mode with as many below it among
        those that are coupled with it, since such never cross: exact, however narrow veerings are,
        and however far speeds are apart. Directions of motion that the rotor does not couple (flap
        with bending in plane, of sections that are not turned) are counted apart, and cross; a
        symmetry beside these is not known of, and branches that it lets cross seem to veer.

        Returns a `Table` with `frequency` (rad/s; angular_speed, mode) and `status`: as in the
        diagram, and `NO_EQUILIBRIUM` where the stiffness is not positive definite, as where a mode
        grows. There the order of modes is none.

        Raises `ValueError` for diagrams with damping, or with loads that have no potential.
        """
        conditions = checked_conditions(self.loads, self.damping)
        if not self.damping.are_none or not self.loads.has_potential:
            raise ValueError(
                "branches are followed by the order of frequencies, which with damping, or under "
                "loads that turn with the beam and moments, may cross: take the diagram without"
            )
        speeds = self.table.coords["angular_speed"]
        frequency, status = along_branches(self.model, self.rotor, conditions, speeds, self.labels)
        dims = {name: self.table.dims[name] for name in ("frequency", "status")}
        return Table({"frequency": frequency, "status": status}, dims, self.table.coords)

    def crossings(
        self, harmonics: Sequence[float] | np.ndarray = (1, 2, 3, 4, 5, 6)
    ) -> list[Crossing]:
        """All speeds in the range of the diagram where frequency = harmonic * speed.

        `harmonics` is a list of numbers > 0. Sign changes between neighbouring speeds of the
        diagram, in whatever order they were given and but for those that failed, refined by
        `crossing`; two crossings between two neighbours are not seen. Where a label changes branch
        in a veering and the line passes through the gap, there is no crossing. Branches may still
        cross the line beside the gap, so such an interval is looked at again in sixteen parts.
        Ordered by speed; their numbers are those of Python.

        Raises `ValueError` for other harmonics.
        """
        factors = concrete_array("harmonics", harmonics)
        if factors.ndim != 1 or not (np.isfinite(factors) & (factors > 0)).all():
            raise ValueError(f"harmonics must be a list of numbers > 0, got {harmonics!r}")
        found = self._crossings(factors.tolist(), True)
        return sorted(found, key=lambda crossing: crossing.angular_speed)

    def _crossings(self, harmonics: list[float], closer: bool) -> list[Crossing]:
        """The crossings, in any order; with `closer` intervals in which a label jumps over a line
        are looked at with more speeds, since it may come back within one."""
        found: dict[tuple[tuple[float, float], float], list[Crossing]] = {}
        jumped = []
        for column, label in enumerate(self.labels):
            frequency = self.table["frequency"][:, column]
            there = np.flatnonzero(np.isfinite(frequency))
            speed, order = np.unique(self.table.coords["angular_speed"][there], return_index=True)
            there = there[order]
            growing = self.table["growth_rate"][there, column] > 0
            for harmonic in harmonics:
                # Divergence, with a gap of zero at rest, is no resonance.
                gap = np.where(growing, np.nan, frequency[there] - harmonic * np.abs(speed))
                # A root on a sample counts once, for the interval that it begins.
                change = (gap[:-1] * gap[1:] < 0) | (gap[:-1] == 0)
                change[-1:] |= gap[-1:] == 0
                for i in np.flatnonzero(change):
                    bracket = (float(speed[i]), float(speed[i + 1]))
                    at = crossing(
                        self.model, self.rotor, bracket, label, harmonic,
                        loads=self.loads, damping=self.damping, throw=False,
                    )  # fmt: skip
                    if at.status == Status.OK:
                        own = jax.tree.map(lambda number: number.item(), at)
                        found.setdefault((bracket, harmonic), []).append(own)
                    elif at.status == Status.NO_CROSSING:
                        jumped.append((bracket, harmonic))
        for bracket, harmonic in dict.fromkeys(jumped) if closer else ():
            near = campbell(
                self.model, self.rotor, np.linspace(*bracket, _CLOSER), self.labels,
                loads=self.loads, damping=self.damping,
            )  # fmt: skip
            found[bracket, harmonic] = near._crossings([harmonic], False)
        return [each for some in found.values() for each in some]


def campbell(
    model: AbstractModel,
    rotor: Rotor,
    angular_speeds: Any,
    which: Sequence[Label],
    *,
    loads: Loads = NO_LOADS,
    damping: Damping = NO_DAMPING,
) -> Campbell:
    """Campbell diagram: frequencies of labelled modes over the angular speed.

    `model`, `rotor`, `loads` and `damping` are those of `modes`, `angular_speeds` a list of
    different speeds (rad/s) in any order, and `which` the labels of the modes (see `labels`). At
    every speed the modes are those about the state that the loads deform. Returns a `Campbell`. It
    is a batch, as `sweep` and `ladder_sweep` are: it never raises for a speed that fails, but has a
    status for each of them (`Campbell.status`), and NaN there.

    Raises `ValueError` or `TypeError` for a malformed argument, also where numbers are traced.
    """
    which = (which,) if isinstance(which, Label) else which
    if not isinstance(which, Sequence):
        raise TypeError(f"which must be labels, got {which!r}")
    which = tuple(which)
    model, rotor, _ = checked_case(model, rotor, fastest(angular_speeds))
    conditions = checked_conditions(loads, damping, (model, rotor))
    table = sweep(
        # the rotor as an argument: diagrams of other rotors reuse the compiled code
        jax.tree_util.Partial(_campbell_case, model, rotor, choose(model, which), conditions),
        grid(angular_speed=angular_speeds),
        dims={
            name: {"mode": [str(label) for label in which]} for name in ("frequency", "growth_rate")
        },
    )
    return Campbell(model, rotor, which, table, loads, damping)


def _campbell_case(
    model: AbstractModel, rotor: Rotor, wanted: Wanted, conditions: Conditions | None,
    *, angular_speed: Scalar,
) -> dict[str, Array]:  # fmt: skip
    found = find(model, rotor, angular_speed, wanted, conditions=conditions)
    return {
        "frequency": found.frequency,
        "growth_rate": found.growth_rate,
        "status": found.status,
    }
