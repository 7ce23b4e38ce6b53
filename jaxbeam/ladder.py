"""How much model a question needs: questions, and what `jaxbeam.choose_model` goes by.

A question is passed as an object: `PeakDeflection`, `DeflectionHistory`, `RootStrain`,
`ModalFrequencies`, or one that derives from `Question`. `rungs` lists the models for it from cheap
to dear, and `evaluate` has one of them answer it.

```py
import jax
jax.config.update("jax_enable_x64", True)
import jaxbeam as jb

blade = jb.Beam.from_section(length=8.0, youngs_modulus=6.895e10, density=2767.0,
                             area=7.299e-5, in_plane_second_moment=8.214e-9)
rotor = jb.Rotor(blade, hub_radius=0.5, tip_mass=0.1)
motion = jb.SmoothSpinUp(4.0, duration=15.0)

question = jb.ladder.PeakDeflection(motion, jax.numpy.linspace(0.0, 20.0, 201))
print(jb.choose_model(rotor, question, tolerance=1e-2))
```

```txt
stiffening ratio 3, deflection 0.085 L, slope 0.12, steady strain 2.6e-05, no mode excited by the hub
rung                                   cost   estimate  verdict
classical, 1 mode                         1             ruled out: stiffening ratio 3
classical, 2 modes                     1.05             ruled out: stiffening ratio 3
hybrid, 1 mode                         1.05     0.0075  meets it
hybrid, 4 functions                    1.31     0.0048  meets it too
4 elements                             12.8      0.009  meets it too
8 elements                             23.3     0.0029  meets it too
hybrid, 1 mode: error 0.0075, asked 0.01
```

**How a model is chosen.** A linear theory looks first. Then exact rods are refined until they stand
still, and cheaper rungs are held against them. What these converge to is a named material, that of
the engineering strain (`PlanarRod`, `SpatialRod`). What another law that agrees at small strains
may change is part of the estimate of every rung that has one, and the text says so where it is more
than the tolerance: it is some 1e-5 of the peak on Kane's spin-up, and thousandths where beams
strain by one per cent. Theories of your own stand beside these: `choose_model(..., models=[...])`.

**Many cases.** `ladder_sweep` does this for a few cases of many, and answers the others on the rung
that suffices, with an estimate each. Cases that outgrow their rung go on to the next.

**In space.** Out of the plane `SpatialRod` judges, if the beam has its `torsional_stiffness`. What no
other theory bears (a moment at the tip, loads that follow it, motion in a cone, modes of torsion, a
`blades.Blade`, what is between `blades.Support`s) it answers alone. It has rotary inertia of
sections, modal theories where the beam has a `polar_inertia`, and elements in the plane none, by
which frequencies of bending are lower by some EI k^2 / (2 EA).

**How reliable it is.** Of 220 random scenes in the plane (peaks, histories, strains, frequencies;
`studies/ladder.py`) at 1e-2, 1e-3 and 1e-4 each, and of 300 in space (`studies/ladder_space.py`) at
1e-2 and 1e-3 each, all choices are within the tolerance, and no error is larger than its estimate
but for two in space at 1e-3, of 3.2e-4 for 2.1e-4 and of 4.9e-4 for 4.7e-4. In the plane 97.3, 96.4
and 97.3 % of them, and in space 97.7 and 89.3 %, are at most one rung above the cheapest that does.
In a single number, such as a peak, errors of coarse rungs cancel by chance, and a rung that agrees
by accident is not looked for: leaving out those whose next finer one does not agree it is 98.2,
98.2 and 98.6 %, and 99.0 and 94.7 %. Frequencies of 8 blades, half of them uneven along the span,
at 1e-2 and 1e-3 are within the tolerance, and no error is larger than its estimate.

**What it costs.** On 1000 spin-ups at 1e-3 all are within the tolerance, and the whole takes a
fifth of what 64 elements take everywhere (10 s and 52 s). But five models have to be compiled
first, side by side on the cores there are, which takes the rest of the time in a fresh process (see
docs/startup.md). A single choice takes as long as one run of 64 elements, or up to twice that: it
pays in sweeps and for long scenes.
"""  # noqa: E501

from jaxbeam._ladder.choice import Choice as Choice
from jaxbeam._ladder.choice import Evidence as Evidence
from jaxbeam._ladder.evaluate import evaluate as evaluate
from jaxbeam._ladder.questions import Answer as Answer
from jaxbeam._ladder.questions import DeflectionHistory as DeflectionHistory
from jaxbeam._ladder.questions import ModalFrequencies as ModalFrequencies
from jaxbeam._ladder.questions import PeakDeflection as PeakDeflection
from jaxbeam._ladder.questions import Question as Question
from jaxbeam._ladder.questions import RootStrain as RootStrain
from jaxbeam._ladder.rungs import Indicators as Indicators
from jaxbeam._ladder.rungs import Rung as Rung
from jaxbeam._ladder.rungs import rungs as rungs
