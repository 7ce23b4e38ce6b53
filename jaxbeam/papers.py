"""Theories of two papers that are here to compare with: what each states, and where it fails.

Everyday theories are in `jaxbeam`. Those of this module are what Yoo, Ryan and Scott (1995, Y) and
Berzeri and Shabana (1999, B) compute with beside them. They are models like all others, for
`jaxbeam.modes`, `simulate`, `critical_speed` and so on:

```py
import jax
jax.config.update("jax_enable_x64", True)
import jaxbeam as jb

rotor = jb.Rotor(jb.Beam.from_slenderness(70.0))
models = [jb.papers.ChordANCF(1), jb.papers.ChordANCF(2), jb.papers.TangentANCF(2)]
print(*(jb.critical_speed(model, rotor).angular_speed for model in models))
springs = jb.papers.SpringRotor(1.0, 1.0, 1.0, 1e6, 300.0)  # Table 2 of Y
for model in jb.papers.DiscreteLC(), jb.papers.DiscreteLP(), jb.papers.DiscreteNC():
    print(jb.modes(model, springs, 15.0, 1).frequency)
```

```txt
10.9545 28.719 5.38168
[8.65636]
[22.9026]
[22.8945]
```

**Of Y** the everyday theories are `Hybrid` (stretch along the arc and two deflections, which
stiffens as it must), `Classical` (the same without motion-induced stiffness, called C.L.C. there)
and `VonKarman`. The paper shows them by an analogue with two degrees of freedom, a particle in a
hinged tube that two springs hold (`SpringRotor`):

- `DiscreteNC` and `DiscreteNP` are exact, in Cartesian and in polar coordinates, and move alike;
- `DiscreteLC` is linear in Cartesian coordinates. It softens with speed and diverges above the
  square root of k_r / (m L²), whatever the radius of the hub: the error of `Classical`;
- `DiscreteLP` is linear in polar coordinates, as `Hybrid` is along the arc, and stiffens;
- `DiscreteNS` has the stretch to second degree, as `VonKarman` has.

Table 1 of Y is misprinted: NC, LC and NS lack the Euler term m Ω' (d + L), without which they
hardly move, NP lacks d in the last inertia term of both equations, and the stiffness of LP is
m d L Ω² + k_r. What is computed here has them.

**Of B** all models are planar elements with absolute nodal coordinates, cubic between two nodes:

- `ANCF` is Model A: axial strain is interpolated along the element (eq. A-3). Its forces are not
  the gradient of an energy, and do work of their own on the way: on a spin-up to 4 rad/s 16, 11,
  3.2 and 0.8 % of the largest strain energy with 1, 2, 4 and 8 elements. It hardens with strain,
  and so has no speed at which it tears. Equations A-6 and A-7 are misprinted.
- `SmallStrainANCF` is its linearisation about a small steady strain, behind Tables 2 to 5. Its
  frequencies are off by up to 0.9 of the steady strain, relative.
- `ChordANCF` and `TangentANCF` are Model 0: linear strain in a frame that moves with the element,
  along its chord or with its first node. Steady rotation is unstable above a speed that grows with
  the number of elements (above: of one and of two, over the unit of frequency); the tangent frame
  is also far too stiff with few elements, and with one of them is `Classical`.
- `GreenANCF` takes the place of Model A where there has to be an energy: a Green strain, and
  EI r''·r''. That is another material where strains are not small: it hardens.

For an answer that is to be right in large motions take `jaxbeam.PlanarRod`, the same elements for
the exact rod. `studies/yoo1995.py` and `studies/berzeri1999.py` hold all of these against what the
papers print, and jaxbeam/README.md says where each equation stands.
"""

from jaxbeam._models.ancf.theories import ANCF as ANCF
from jaxbeam._models.ancf.theories import ChordANCF as ChordANCF
from jaxbeam._models.ancf.theories import GreenANCF as GreenANCF
from jaxbeam._models.ancf.theories import SmallStrainANCF as SmallStrainANCF
from jaxbeam._models.ancf.theories import TangentANCF as TangentANCF
from jaxbeam._models.discrete import DiscreteLC as DiscreteLC
from jaxbeam._models.discrete import DiscreteLP as DiscreteLP
from jaxbeam._models.discrete import DiscreteNC as DiscreteNC
from jaxbeam._models.discrete import DiscreteNP as DiscreteNP
from jaxbeam._models.discrete import DiscreteNS as DiscreteNS
from jaxbeam._rotor.spring_rotor import SpringRotor as SpringRotor
