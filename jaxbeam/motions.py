"""Motions of the hub beyond the everyday ones, and what a motion of your own is.

`jaxbeam.SmoothSpinUp` and `jaxbeam.ConstantSpeed` are the everyday ones. A motion is passed as an
object, `jaxbeam.simulate(model, rotor, motion, times)`. To write one, derive from `Motion` (any
motion in space) or from `Spin` (rotation about a fixed axis).
"""

from jaxbeam._rotor.motion import Hub as Hub
from jaxbeam._rotor.motion import HubPose as HubPose
from jaxbeam._rotor.motion import HubVelocity as HubVelocity
from jaxbeam._rotor.motion import Motion as Motion
from jaxbeam._rotor.motion import Spin as Spin
from jaxbeam._rotor.spins import ModulatedSpeed as ModulatedSpeed
from jaxbeam._rotor.spins import QuinticSpinUp as QuinticSpinUp
from jaxbeam._rotor.spins import SpinUpThenDown as SpinUpThenDown
from jaxbeam._rotor.spins import TabulatedSpeed as TabulatedSpeed
from jaxbeam._rotor.spins import inclined_axis as inclined_axis
