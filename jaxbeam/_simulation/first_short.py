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


def quick_first(
    program: Program, short: tuple[Any, ...], given: tuple[Any, ...], is_whole: bool
) -> Any:
    """The result, which has a `status`, of a program by the arguments that are `given`: at first
    one that is compiled quickly, by arguments that make a run `short`, if the whole run is not or
    ends before; then one that is compiled well."""
    if program.for_call(*short) is program.quick is not program.well:
        result = program.quick(*short)
        if is_whole or result.status != Status.MAX_STEPS:
            return result
        program.enough(*short)
    return program.at_length(*given)


def first_short(program: Program, max_steps: int | None, *given: Any) -> Simulation:
    """The result of program(*given, max_steps). The quickly compiled program tries first, with at
    most `STEPS` steps; a run that needs more is made again by the well compiled one. Solvers of
    others, and runs that call back to the user, who would see it twice, take that at once."""
    solver, _, _, saveat, _, event, meter = given[7:14]
    result: Simulation
    if not isinstance(solver, SecondOrderSolver) or not (saveat is event is meter is None):
        result = program.at_length(*given, max_steps)
        return result
    few = STEPS if max_steps is None else min(STEPS, max_steps)
    result = quick_first(program, (*given, few), (*given, max_steps), few == max_steps)
    solution: diffrax.Solution = result.solution
    stats = {**solution.stats, "max_steps": max_steps}
    return dataclasses.replace(result, solution=dataclasses.replace(solution, stats=stats))
