"""Theories of a rotating beam: how far they reach, their parts, and what a model is.

A model is passed as an object, `jaxbeam.modes(Hybrid(), ...)`. The everyday ones are in `jaxbeam`
itself: `Hybrid`, `Classical` and `VonKarman` in functions along the beam, `PlanarRod` in finite
elements in the plane, `SpatialRod` in space. What only the papers need, to
compare with, is in `jaxbeam.papers`. Here are

- `Polynomials`, `CantileverModes` and, for beams that are all but strings, `Layered`: bases for the
  modal models (`Hybrid(basis=...)`). How many functions are needed is said in docs/vibration.md;
- `Label` and `Direction`, the names of modes that `jaxbeam.labels` makes;
- `AbstractModel` and `LinearSystem`, what a model of your own derives from, and what
  `model.linearise` returns: the matrices of mass, gyroscopic coupling and stiffness.
  jaxbeam/README.md says how to add one.

**How far a theory reaches**, as `studies/validity.py` measures theories against each other:

    theory                                   error                             1 % at
    Classical, first in-plane frequency      0.50 of stiffening_ratio          0.02
    Hybrid, peak of a spin-up in the plane   0.3 (w / L)²                      w = 0.14 to 0.20 L
    Hybrid, SmallStrainANCF, frequencies     0.5 to 0.9 of the steady strain   0.011

where w is the deflection of the tip. `jaxbeam.choose_model` applies such measures to a question;
docs/limitations.md has the limits of each theory.
The papers that docstrings call Y and B are cited in `_models/contract/__init__.py`.
"""

from jaxbeam._models.bases.basis import CantileverModes as CantileverModes
from jaxbeam._models.bases.basis import Polynomials as Polynomials
from jaxbeam._models.bases.layered import Layered as Layered
from jaxbeam._models.contract.base import AbstractModel as AbstractModel
from jaxbeam._models.contract.linear_system import LinearSystem as LinearSystem
from jaxbeam._rotor.directions import Direction as Direction
from jaxbeam._rotor.directions import Label as Label
