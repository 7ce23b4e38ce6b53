"""Motions of the hub: a measured speed, any motion in space, and a motion of your own.

`jaxbeam.SmoothSpinUp` and `jaxbeam.ConstantSpeed` are the everyday ones. A motion is passed as an
object, `jaxbeam.simulate(model, rotor, motion, times)`. `QuinticSpinUp`, `ModulatedSpeed`,
`SpinUpThenDown` and `TabulatedSpeed` turn about a fixed axis, which is normal to the plane or
inclined (`inclined_axis`); `HubVelocity` and `HubPose` are any motion of the hub in space, stated
by JAX functions of time, whose rates are derived. A measured speed is a table:

```py
import jax
jax.config.update("jax_enable_x64", True)
import jaxbeam as jb

blade = jb.Beam.from_section(length=8.0, youngs_modulus=6.895e10, density=2767.0,
                             area=7.299e-5, in_plane_second_moment=8.214e-9)
rotor = jb.Rotor(blade, hub_radius=0.5, tip_mass=0.1)

import numpy
profile = [[0.0, 0.0], [4.0, 0.5], [6.0, 0.5], [14.0, 3.0]]  # s, rad/s
numpy.savetxt("profile.csv", profile, delimiter=",")
seconds, speeds = numpy.loadtxt("profile.csv", delimiter=",", unpack=True)
measured = jb.motions.TabulatedSpeed(seconds, speeds)  # linear between them; smooth=True: cubic
print(*jb.simulate(jb.Hybrid(0, 4, 0), rotor, measured, jax.numpy.linspace(0.0, 20.0, 201)).peak())
```

```txt
-0.668707 6.87855
```

**What a run sees of a motion.** A solver sees a motion at the stages of its steps alone, and a beam
at rest limits none of these. So `simulate` looks at the motion and the loads all along the run
before it begins, and steps with any controller are short enough for whatever lasts a thousandth of
the run or longer.

**What is shorter is declared.** `HubVelocity`, `HubPose` and `jaxbeam.Loads` take times of
`changes`, at which steps end, and times of `jumps`, at which velocities, rates or forces jump. A
motion class of your own states `change_times()` and `jump_times()`. At a jump of the hub's velocity
the beam gets its impulse, with the work that the impulse does. Gradients by the time of a jump or
corner are right there, which they are not where steps pass over it. A jump of velocity that nobody
declared is noticed in every model, and ends the run as `UNRESOLVED`.

**Measured motions** have a corner at each sample; declare its time, as `TabulatedSpeed` does.
Corners set all modes in motion, and of those that are faster than the samples these know nothing.
So between declared times, three or more, that are closer than a radian of the first mode, the error
of a step is that of displacements, mean along the beam: slow modes are followed, in some five or
ten steps from sample to sample, and fast ones are damped. Moments and torques there hold some per
cent of what fast modes would do; give a smaller `rtol` where they matter.

**Late times**, as clocks of computers show them, are rounded: 1.7e9 s to 2.4e-7 s. A run counts
time from its beginning and asks functions of time by their own clock; the times of a
`TabulatedSpeed` are counted from the beginning, too, and lose nothing (`Motion.since`). Declared
times that are closer than 1e-11 of the run, or 32 units of rounding of its latest time, are one.

**A motion of your own** derives from `Motion` (any motion in space) or from `Spin` (rotation about
a fixed axis); `Hub` is what it tells a model.
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
