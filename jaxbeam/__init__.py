"""Differentiable simulation of flexible beams that rotate, in pure JAX."""

from jaxbeam._basis import CantileverModes as CantileverModes
from jaxbeam._basis import Polynomials as Polynomials
from jaxbeam._beam import Beam as Beam
from jaxbeam._beam import Rotor as Rotor
from jaxbeam._models.ancf import ANCF as ANCF
from jaxbeam._models.ancf import SmallStrainANCF as SmallStrainANCF
from jaxbeam._models.base import AbstractModel as AbstractModel
from jaxbeam._models.base import Family as Family
from jaxbeam._models.base import Label as Label
from jaxbeam._models.base import LinearSystem as LinearSystem
from jaxbeam._models.base import labels as labels
from jaxbeam._models.modal import Classical as Classical
from jaxbeam._models.modal import Hybrid as Hybrid
from jaxbeam._modes import Modes as Modes
from jaxbeam._modes import modes as modes
from jaxbeam._southwell import Campbell as Campbell
from jaxbeam._southwell import Crossing as Crossing
from jaxbeam._southwell import Resonance as Resonance
from jaxbeam._southwell import Southwell as Southwell
from jaxbeam._southwell import campbell as campbell
from jaxbeam._southwell import crossing as crossing
from jaxbeam._southwell import southwell as southwell
from jaxbeam._status import Status as Status
from jaxbeam._sweep import Cases as Cases
from jaxbeam._sweep import Table as Table
from jaxbeam._sweep import grid as grid
from jaxbeam._sweep import listed as listed
from jaxbeam._sweep import sweep as sweep

__version__ = "0.1.0"
