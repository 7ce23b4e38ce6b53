"""Parameters from measurements: experiments of all kinds, and what `jaxbeam.fit` says of them.

```py
import jax
jax.config.update("jax_enable_x64", True)
import jaxbeam as jb

blade = jb.Beam.from_section(length=8.0, youngs_modulus=6.895e10, density=2767.0,
                             area=7.299e-5, in_plane_second_moment=8.214e-9)
model, bending = jb.Hybrid(), jb.labels(in_plane=2)
seen = [[2.61, 16.63], [3.60, 20.76], [5.19, 29.93]]  # rad/s, at three speeds, each to 0.02

def experiment(stiffness, tip_mass):
    beam = jb.Beam(8.0, blade.mass_per_length, blade.axial_stiffness, stiffness, stiffness)
    rotor, speeds = jb.Rotor(beam, 0.5, tip_mass), [0.0, 5.0, 10.0]  # rad/s
    return jb.FrequencyData(model, rotor, speeds, seen, 0.02, bending)

print(jb.fit(experiment, {"stiffness": jb.FreeParameter(500.0), "tip_mass": jb.FreeParameter(0.2)}))
```

```txt
                                    value   deviation   95 % interval
stiffness                         565.984         2.2   561.77 to 570.23
tip_mass                        0.0991883      0.0032   0.0931109 to 0.105662
reduced chi squared 0.901 with 4 degrees of freedom, 19 steps: ok
```

**Experiments.** An experiment is whatever was measured, built from the parameters: frequencies with
labels or without (`jaxbeam.FrequencyData`; they are matched one to one, also where the measurement
missed a mode), histories of anything that `simulate` computes (`HistoryData`), static deflections
(`StaticData`), or several of these at once. NaN is a missing number, and a prior counts as one more
measurement. `ResonanceMargin` is a demand in place of a measurement: no frequency lies within a
margin of so many per revolution. To write an experiment of your own, derive from `Experiment`: it
says what was measured, and what a model predicts in its place.

**The search.** Levenberg-Marquardt starts from the guess. Where it ends badly, sixteen starts go
downhill together (`Descent`) and it goes on from the best. What the data cannot tell apart is an
error that names it; with `throw=False`, intervals are then infinite, `parameters` are NaN, and the
best of them is in `Fit.partial`. `jax.vmap` fits a batch.

**What it costs.** Six parameters from 56 noisy frequencies take 16 ms (7 s in a fresh process), and
from two noisy histories of a modal beam 0.7 s; the Jacobian adds a third to the residuals. A batch
of a hundred takes 144 and 52 times as long as one, because on a CPU there is little overhead to
share.

**What it is worth.** In a hundred draws each, estimates are without bias, and 95 % intervals hold
the truth in 90 to 99 %. Without noise the truth is found to 1e-8.
"""

from jaxbeam._fitting.experiments import Experiment as Experiment
from jaxbeam._fitting.experiments import HistoryData as HistoryData
from jaxbeam._fitting.experiments import ResonanceMargin as ResonanceMargin
from jaxbeam._fitting.experiments import StaticData as StaticData
from jaxbeam._fitting.fit import Descent as Descent
