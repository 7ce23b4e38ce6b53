"""Differentiable simulation of flexible beams that rotate, in pure JAX."""

import importlib
import inspect
import re
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxbeam._fitting.experiments import Clearance as Clearance
    from jaxbeam._fitting.experiments import Experiment as Experiment
    from jaxbeam._fitting.experiments import FrequencyData as FrequencyData
    from jaxbeam._fitting.experiments import HistoryData as HistoryData
    from jaxbeam._fitting.experiments import StaticData as StaticData
    from jaxbeam._fitting.experiments import match_modes as match_modes
    from jaxbeam._fitting.fit import Descent as Descent
    from jaxbeam._fitting.fit import fit as fit
    from jaxbeam._fitting.free import Free as Free
    from jaxbeam._fitting.result import Fit as Fit
    from jaxbeam._ladder.choose import Choice as Choice
    from jaxbeam._ladder.choose import Evidence as Evidence
    from jaxbeam._ladder.choose import answer as answer
    from jaxbeam._ladder.choose import choose_model as choose_model
    from jaxbeam._ladder.questions import Answer as Answer
    from jaxbeam._ladder.questions import DeflectionHistory as DeflectionHistory
    from jaxbeam._ladder.questions import ModalFrequencies as ModalFrequencies
    from jaxbeam._ladder.questions import PeakDeflection as PeakDeflection
    from jaxbeam._ladder.questions import Question as Question
    from jaxbeam._ladder.questions import RootStrain as RootStrain
    from jaxbeam._ladder.rungs import Indicators as Indicators
    from jaxbeam._ladder.rungs import Rung as Rung
    from jaxbeam._ladder.rungs import ladder as ladder
    from jaxbeam._ladder.sweep import ladder_sweep as ladder_sweep
    from jaxbeam._models.ancf import ANCF as ANCF
    from jaxbeam._models.ancf import ChordANCF as ChordANCF
    from jaxbeam._models.ancf import EngineeringANCF as EngineeringANCF
    from jaxbeam._models.ancf import GreenANCF as GreenANCF
    from jaxbeam._models.ancf import SmallStrainANCF as SmallStrainANCF
    from jaxbeam._models.ancf import TangentANCF as TangentANCF
    from jaxbeam._models.base import AbstractModel as AbstractModel
    from jaxbeam._models.base import Family as Family
    from jaxbeam._models.base import Label as Label
    from jaxbeam._models.base import LinearSystem as LinearSystem
    from jaxbeam._models.base import labels as labels
    from jaxbeam._models.basis import CantileverModes as CantileverModes
    from jaxbeam._models.basis import Polynomials as Polynomials
    from jaxbeam._models.discrete import DiscreteLC as DiscreteLC
    from jaxbeam._models.discrete import DiscreteLP as DiscreteLP
    from jaxbeam._models.discrete import DiscreteNC as DiscreteNC
    from jaxbeam._models.discrete import DiscreteNP as DiscreteNP
    from jaxbeam._models.discrete import DiscreteNS as DiscreteNS
    from jaxbeam._models.modal import Classical as Classical
    from jaxbeam._models.modal import Hybrid as Hybrid
    from jaxbeam._models.modal import VonKarman as VonKarman
    from jaxbeam._rotor.beam import Beam as Beam
    from jaxbeam._rotor.beam import Rotor as Rotor
    from jaxbeam._rotor.beam import SpringRotor as SpringRotor
    from jaxbeam._rotor.loads import Damping as Damping
    from jaxbeam._rotor.loads import Loads as Loads
    from jaxbeam._rotor.motion import Hub as Hub
    from jaxbeam._rotor.motion import HubPose as HubPose
    from jaxbeam._rotor.motion import HubVelocity as HubVelocity
    from jaxbeam._rotor.motion import Motion as Motion
    from jaxbeam._rotor.motion import Spin as Spin
    from jaxbeam._rotor.spins import ConstantSpeed as ConstantSpeed
    from jaxbeam._rotor.spins import ModulatedSpeed as ModulatedSpeed
    from jaxbeam._rotor.spins import QuinticSpinUp as QuinticSpinUp
    from jaxbeam._rotor.spins import SmoothSpinUp as SmoothSpinUp
    from jaxbeam._rotor.spins import SpinUpThenDown as SpinUpThenDown
    from jaxbeam._rotor.spins import TabulatedSpeed as TabulatedSpeed
    from jaxbeam._rotor.spins import inclined as inclined
    from jaxbeam._simulation.result import Simulation as Simulation
    from jaxbeam._simulation.scene import Scene as Scene
    from jaxbeam._simulation.simulate import deflection_limit as deflection_limit
    from jaxbeam._simulation.simulate import simulate as simulate
    from jaxbeam._simulation.simulate import steady_start as steady_start
    from jaxbeam._simulation.stable_step import StableStep as StableStep
    from jaxbeam._simulation.stable_step import amplification as amplification
    from jaxbeam._simulation.stable_step import stable_step as stable_step
    from jaxbeam._solvers.kvaerno import ChordKvaerno5 as ChordKvaerno5
    from jaxbeam._solvers.magnus import Magnus as Magnus
    from jaxbeam._solvers.rodas import Rodas4P as Rodas4P
    from jaxbeam._solvers.rodas import Rodas5P as Rodas5P
    from jaxbeam._solvers.rodas import Rosenbrock as Rosenbrock
    from jaxbeam._solvers.system import SecondOrderSystem as SecondOrderSystem
    from jaxbeam._solvers.system import State as State
    from jaxbeam._solvers.system import second_order_term as second_order_term
    from jaxbeam._status import Status as Status
    from jaxbeam._sweeps.cases import Cases as Cases
    from jaxbeam._sweeps.cases import grid as grid
    from jaxbeam._sweeps.cases import listed as listed
    from jaxbeam._sweeps.sweep import sweep as sweep
    from jaxbeam._sweeps.table import Table as Table
    from jaxbeam._vibration.campbell import Campbell as Campbell
    from jaxbeam._vibration.campbell import campbell as campbell
    from jaxbeam._vibration.critical_speed import CriticalSpeed as CriticalSpeed
    from jaxbeam._vibration.critical_speed import critical_speed as critical_speed
    from jaxbeam._vibration.crossing import Crossing as Crossing
    from jaxbeam._vibration.crossing import crossing as crossing
    from jaxbeam._vibration.floquet import Floquet as Floquet
    from jaxbeam._vibration.floquet import floquet as floquet
    from jaxbeam._vibration.frequencies import Frequencies as Frequencies
    from jaxbeam._vibration.frequencies import frequencies as frequencies
    from jaxbeam._vibration.modes import Modes as Modes
    from jaxbeam._vibration.modes import modes as modes
    from jaxbeam._vibration.southwell import Southwell as Southwell
    from jaxbeam._vibration.southwell import southwell as southwell
    from jaxbeam._vibration.stiffening import stiffening_ratio as stiffening_ratio
    from jaxbeam._vibration.tongues import Tongue as Tongue
    from jaxbeam._vibration.tongues import tongue as tongue
else:
    # The table above is read, not run: what a script does not ask for is not imported. Half of what
    # `import jaxbeam` would take is for solvers in time alone.
    _TABLE = re.findall(r"from (\S+) import (\w+) as", inspect.getsource(sys.modules[__name__]))
    _ROOMS = {name: room for room, name in _TABLE}

    def __getattr__(name: str) -> Any:
        if name not in _ROOMS:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(importlib.import_module(_ROOMS[name]), name)
        return value

    def __dir__() -> list[str]:
        return [*globals(), *_ROOMS]


__version__ = "0.1.0"
