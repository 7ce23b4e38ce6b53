"""Runs of which nobody knows how long they are: a short one need not wait for a good compiler."""

import dataclasses
from typing import Any

import diffrax

from jaxbeam._programs.program import Program
from jaxbeam._simulation.result import Simulation
from jaxbeam._solvers.steps import SecondOrderSolver
from jaxbeam._status import Status

# Steps up to which a run uses the quickly compiled program: then they take as long as that saved.
# Longer runs are done again, by the well compiled program.
STEPS = 4000


def first_short(program: Program, max_steps: int | None, *given: Any) -> Simulation:
    """The result of a run by a program of arguments `given` and a number of steps: by the quickly
    compiled program first, unless the run is longer than that is worth, or calls back to the user,
    who would see it run twice."""
    solver, _, _, saveat, _, event, meter = given[7:14]
    ours = isinstance(solver, SecondOrderSolver)
    few = STEPS if max_steps is None else min(STEPS, max_steps)
    seen = not (ours and saveat is None and event is None and meter is None)
    result: Simulation
    if not seen and program.for_call(*given, few) is program.quick is not program.well:
        result = program.quick(*given, few)
        if few == max_steps or result.status != Status.MAX_STEPS:
            stats = {**result.solution.stats, "max_steps": max_steps}
            solution: diffrax.Solution = dataclasses.replace(result.solution, stats=stats)
            return dataclasses.replace(result, solution=solution)
        program.enough(*given, few)
    result = program.at_length(*given, max_steps)
    return result
