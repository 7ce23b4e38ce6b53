"""What came of choosing a model: the rung, and the evidence for it."""

import dataclasses
from typing import NamedTuple

import numpy as np

from jaxbeam._ladder.rungs import Indicators, Rung
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._status import Status

NOT_NEEDED = "not needed"


class Evidence(NamedTuple):
    """The findings about one `rung`, in a choice between several.

    `estimate` is that of its error, relative (NaN: not run), and `verdict` says in words whether it
    meets the tolerance, misses it, failed, was ruled out or not needed.
    """

    rung: Rung
    estimate: float
    verdict: str


@dataclasses.dataclass(frozen=True, eq=False)
class Choice:
    """The cheapest rung found to meet a tolerance; as text, a table of the rungs looked at.

    | field                    | shape |                                                          |
    |--------------------------|-------|----------------------------------------------------------|
    | rung                     |       | the `Rung`; where none was found to, the best there is;  |
    |                          |       | None where none has an answer: then all numbers are NaN  |
    | estimate                 | ()    | of its relative error; infinite where there is none      |
    | status                   |       | `OK`; `TOLERANCE_NOT_MET`; of the last rung asked, where |
    |                          |       | none has an answer; what is wrong with rotor or question |
    | tolerance                | ()    | as given                                                 |
    | partial                  | (m,)  | what the rung says; `answer` is the same, NaN unless met |
    | constitutive_uncertainty | ()    | what an axial law other than the engineering strain      |
    |                          |       | might change (`Answer.constitutive_uncertainty`)         |
    | indicators               |       | what was known beforehand (`Indicators`)                 |
    | evidence                 |       | an `Evidence` for each rung, from the cheapest on        |
    """

    rung: Rung | None
    estimate: float
    status: Status
    tolerance: float
    partial: np.ndarray
    constitutive_uncertainty: float
    indicators: Indicators
    evidence: tuple[Evidence, ...]

    @property
    def met(self) -> bool:
        """Whether the tolerance is met, by `rung`."""
        return self.status == Status.OK

    @property
    def answer(self) -> np.ndarray:
        """The answer of the rung chosen, NaN unless it meets the tolerance."""
        return self.partial if self.met else np.full_like(self.partial, np.nan)

    @property
    def model(self) -> AbstractModel | None:
        """The model of the rung chosen; None where no rung has an answer."""
        return None if self.rung is None else self.rung.model

    def __str__(self) -> str:
        if self.rung is None:
            return f"no rung has an answer: {self.status.message}"
        beforehand = self.indicators
        takes_part = beforehand.excited > 0.1 * self.tolerance
        highest = np.max(beforehand.rest_frequency, where=takes_part, initial=0.0)
        excited = f"excited up to {highest:.3g} rad/s" if highest else "no mode excited by the hub"
        lines = [
            f"stiffening ratio {float(beforehand.stiffening_ratio):.2g}, deflection "
            f"{float(beforehand.size):.2g} L, slope {float(beforehand.slope):.2g}, steady strain "
            f"{float(beforehand.steady_strain):.2g}, {excited}",
        ]
        if self.constitutive_uncertainty > self.tolerance:
            lines.append(
                "strains are not small: an axial law other than that of the engineering strain "
                f"might change this by some {self.constitutive_uncertainty:.1g}"
            )
        if (
            stout := np.max(beforehand.timoshenko_reduction[:, takes_part], initial=0.0)
        ) > self.tolerance:
            lines.append(
                f"shear and rotary inertia might take off {stout:.1g}: of a Beam rods have the "
                "latter, and modal theories where there is a polar_inertia"
            )
        lines.append(f"{'rung':34} {'cost':>8} {'estimate':>10}  verdict")
        for rung, estimate, verdict in self.evidence:
            if verdict == NOT_NEEDED:
                continue
            said = "" if np.isnan(estimate) else f"{estimate:.2g}"
            lines.append(f"{rung.name:34} {rung.cost:8.3g} {said:>10}  {verdict}")
        if self.met:
            lines.append(f"{self.rung.name}: error {self.estimate:.2g}, asked {self.tolerance:.2g}")
        else:
            if not any(each.rung.model.is_reference for each in self.evidence):
                lines.append(
                    "von Karman beams judge, to second order in deflection: the beam's "
                    "torsional_stiffness would give rods in space to judge by"
                )
            lines.append(
                f"no rung was found to meet {self.tolerance:.2g}; the best, {self.rung.name}, has "
                f"{self.estimate:.2g}"
            )
        return "\n".join(lines)
