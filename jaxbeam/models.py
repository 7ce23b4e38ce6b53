"""Theories of a rotating beam beyond the everyday ones, their parts, and what a model is.

The everyday ones are in `jaxbeam` itself: `Hybrid`, `Classical`, `VonKarman`, `ANCF`,
`ExactRodANCF`, `GreenANCF`. A model is passed as an object, `jaxbeam.modes(Hybrid(), ...)`. The
papers that docstrings call Y and B are cited in `_models/contract/__init__.py`.
"""

from jaxbeam._models.ancf.theories import ChordANCF as ChordANCF
from jaxbeam._models.ancf.theories import SmallStrainANCF as SmallStrainANCF
from jaxbeam._models.ancf.theories import TangentANCF as TangentANCF
from jaxbeam._models.bases.basis import CantileverModes as CantileverModes
from jaxbeam._models.bases.basis import Polynomials as Polynomials
from jaxbeam._models.contract.base import AbstractModel as AbstractModel
from jaxbeam._models.contract.base import LinearSystem as LinearSystem
from jaxbeam._models.discrete import DiscreteLC as DiscreteLC
from jaxbeam._models.discrete import DiscreteLP as DiscreteLP
from jaxbeam._models.discrete import DiscreteNC as DiscreteNC
from jaxbeam._models.discrete import DiscreteNP as DiscreteNP
from jaxbeam._models.discrete import DiscreteNS as DiscreteNS
from jaxbeam._rotor.directions import Direction as Direction
from jaxbeam._rotor.directions import Label as Label
from jaxbeam._rotor.spring_rotor import SpringRotor as SpringRotor
