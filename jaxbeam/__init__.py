"""Differentiable simulation of flexible beams that rotate, in pure JAX.

Say `jax.config.update("jax_enable_x64", True)` and `import jaxbeam as jb`. Everything is in SI
units and written for one case; `jax.vmap` or `jb.sweep` batch it, and `jax.grad` goes through.

What rotates        Beam, Rotor; Loads and Damping act on it
As built            Spanwise: a property along the span; RootSprings, TipBody,
                    PointMasses, PointForces: what is at its ends and between; jb.blades
Theories            Hybrid, Classical, VonKarman in functions along the beam;
                    PlanarRod, the exact rod in the plane; SpatialRod in space: it bends
                    both ways, twists and shears, of every beam and blade
At a steady speed   steady: the state that loads and rotation deform, with internal forces
                    modes; labels name the modes that are asked for; rpm makes rad/s of turns
                    southwell, stiffening_ratio: how fast they stiffen
                    campbell, crossing: frequencies over speed, resonances with harmonics of it
                    critical_speed, critical_load: where the beam, or the theory, loses its
                    stability
Modulated speed     floquet, tongue: multipliers, boundaries of parametric resonance
In time             simulate through a motion (SmoothSpinUp, ConstantSpeed, ...)
                    steady_start, deflection_limit: how a run begins and when it ends
Many cases          sweep over grid or points gives a Table
Measurements        fit finds each FreeParameter from FrequencyData, ...
Start-up            keep: the next process need not trace and compile again
How much model      choose_model for one question, ladder_sweep for many cases
What went wrong     Status: whatever can fail raises, or takes throw=False and then carries one;
                    batches (sweep, ladder_sweep, campbell) carry one a case and never raise for it

The rest is by subject: jb.models, jb.papers (theories that are here to compare with), jb.motions,
jb.blades (beams as built, and from files), jb.solvers, jb.ladder, jb.fitting, jb.results (what
functions return), jb.programs (how well they are compiled) and jb.plot. `help` of each is a chapter
of the manual with examples; the others, on vibration, loads, stability, sweeps, speed, start-up and
limitations, are in the folder docs of the repository, with a table of all names.
`help(jb.simulate)` and so on tell the details. `python -m jaxbeam --help` does without a script.
"""

import functools
import importlib
import inspect
import re
import sys
from typing import TYPE_CHECKING, Any

# New names of objects that were renamed in this version; those that only moved are found without.
_RENAMED = {
    "ExactRodANCF": "jaxbeam.PlanarRod",
    "SpatialANCF": "jaxbeam.SpatialRod",
    "second_order_term": "jaxbeam.solvers.SecondOrderSystem.term",
    "read_csv": "jaxbeam.blades.read_blade(path, format=BladeFormat.CSV)",
    "read_elastodyn": "jaxbeam.blades.read_blade(path, format=BladeFormat.ELASTODYN)",
    "read_bmodes": "jaxbeam.blades.read_blade(path, format=BladeFormat.BMODES)",
}

if TYPE_CHECKING:
    from jaxbeam import blades as blades
    from jaxbeam import fitting as fitting
    from jaxbeam import ladder as ladder
    from jaxbeam import models as models
    from jaxbeam import motions as motions
    from jaxbeam import papers as papers
    from jaxbeam import plot as plot
    from jaxbeam import programs as programs
    from jaxbeam import results as results
    from jaxbeam import solvers as solvers
    from jaxbeam._fitting.experiments import FrequencyData as FrequencyData
    from jaxbeam._fitting.fit import fit as fit
    from jaxbeam._fitting.free import FreeParameter as FreeParameter
    from jaxbeam._ladder.choose import choose_model as choose_model
    from jaxbeam._ladder.sweep import ladder_sweep as ladder_sweep
    from jaxbeam._models.ancf.theories import PlanarRod as PlanarRod
    from jaxbeam._models.modal.theories import Classical as Classical
    from jaxbeam._models.modal.theories import Hybrid as Hybrid
    from jaxbeam._models.modal.theories import VonKarman as VonKarman
    from jaxbeam._models.space.rod import SpatialRod as SpatialRod
    from jaxbeam._modes.modes import modes as modes
    from jaxbeam._programs.folder import keep as keep
    from jaxbeam._rotor.beam import Beam as Beam
    from jaxbeam._rotor.beam import Rotor as Rotor
    from jaxbeam._rotor.damping import Damping as Damping
    from jaxbeam._rotor.directions import labels as labels
    from jaxbeam._rotor.ends import RootSprings as RootSprings
    from jaxbeam._rotor.ends import TipBody as TipBody
    from jaxbeam._rotor.loads import Loads as Loads
    from jaxbeam._rotor.points import PointForces as PointForces
    from jaxbeam._rotor.points import PointMasses as PointMasses
    from jaxbeam._rotor.spanwise import Spanwise as Spanwise
    from jaxbeam._rotor.spins import ConstantSpeed as ConstantSpeed
    from jaxbeam._rotor.spins import SmoothSpinUp as SmoothSpinUp
    from jaxbeam._rotor.units import rpm as rpm
    from jaxbeam._simulation.limit import deflection_limit as deflection_limit
    from jaxbeam._simulation.simulate import simulate as simulate
    from jaxbeam._simulation.steady import steady as steady
    from jaxbeam._simulation.steady import steady_start as steady_start
    from jaxbeam._stability.critical_load import critical_load as critical_load
    from jaxbeam._stability.critical_speed import critical_speed as critical_speed
    from jaxbeam._stability.floquet import floquet as floquet
    from jaxbeam._stability.tongues import tongue as tongue
    from jaxbeam._status import Status as Status
    from jaxbeam._sweeps.cases import grid as grid
    from jaxbeam._sweeps.cases import points as points
    from jaxbeam._sweeps.sweep import sweep as sweep
    from jaxbeam._sweeps.table import Table as Table
    from jaxbeam._vibration.campbell import campbell as campbell
    from jaxbeam._vibration.crossing import crossing as crossing
    from jaxbeam._vibration.southwell import southwell as southwell
    from jaxbeam._vibration.stiffening import stiffening_ratio as stiffening_ratio
else:
    # The imports above are read as a table, and not run before they are needed: half of the time of
    # `import jaxbeam` would be for solvers in time.
    _TABLE = re.findall(r"from (\S+) import (\w+) as", inspect.getsource(sys.modules[__name__]))
    _ROOMS = {name: room for room, name in _TABLE}

    def __getattr__(name: str) -> Any:
        if name not in _ROOMS:
            return _absent(__name__, name)
        room = _ROOMS[name]
        if room == __name__:
            module = importlib.import_module(f"{room}.{name}")
            module.__getattr__ = functools.partial(_absent, module.__name__)
            return module
        value = globals()[name] = getattr(importlib.import_module(room), name)
        return value

    def __dir__() -> list[str]:
        return [*globals(), *_ROOMS]

    def _absent(module: str, name: str) -> Any:
        """Raise for a name that a public module has not, and say where it is."""
        raise AttributeError(f"module {module!r} has no attribute {name!r}{_elsewhere(name)}")

    def _elsewhere(name: str) -> str:
        """The place of a name that is looked for in a module without it, in words."""
        if name in _RENAMED:
            return f"; it is {_RENAMED[name]} now"
        if _ROOMS.get(name, __name__) != __name__:
            return f"; it is in {__name__}"
        subjects = [room for room, where in _ROOMS.items() if where == __name__ and room != "plot"]
        for subject in () if name.startswith("_") else subjects:
            if name in vars(__getattr__(subject)):
                return f"; it is in {__name__}.{subject}"
        return ""


__version__ = "0.1.0"
