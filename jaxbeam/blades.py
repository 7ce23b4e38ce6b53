"""Beams as they are built: properties along the span, from tables and files, and held ends.

`read_blade(path, length=61.5, axial_stiffness=1e10).beam` is a `jaxbeam.Beam` whose properties are
`jaxbeam.Spanwise`. It reads a table of any spreadsheet with named columns and units (CSV), a blade
file of OpenFAST's ElastoDyn, and a section file or main file of BModes, and tells them apart by
what is in them; `help(jaxbeam.blades.BladeFormat)` says which columns and lines these have, and
`format=BladeFormat.CSV` insists on one. What else a reader returns is a `BladeTable`: it knows what
the file says of the `Rotor`, and what in the file is ignored.
`write_elastodyn` writes a blade file with a beam and the shapes of its modes. What has full
sections is read as well, and written for two programs: see "Full sections" below.

Tables can also be written in a script, and their values differentiated:

```py
import jax
jax.config.update("jax_enable_x64", True)
import jaxbeam as jb

at = [0.0, 0.3, 0.3, 1.0]  # x / L; two equal stations are a step
def stepped(flap):
    return jb.Beam(
        length=10.0, mass_per_length=jb.Spanwise(at, [60.0, 50.0, 30.0, 12.0]), axial_stiffness=1e9,
        in_plane_bending_stiffness=jb.Spanwise(at, [9e6, 8e6, 4e6, 4e5]),
        flap_bending_stiffness=jb.Spanwise(at, flap), twist=jb.Spanwise([0, 1], [0.2, 0.0]),
    )
flap = jax.numpy.array([5e6, 4e6, 1e6, 5e4])
def stepped_flap(flap):
    root, tip = jb.RootSprings(flap=4e6), jb.TipBody(5.0, 0.1, 0.2)
    held = jb.Rotor(stepped(flap), 1.0, root_springs=root, tip_body=tip)
    return jb.modes(jb.Hybrid(0, 12, 12), held, 5.0, jb.labels(flap=1)).frequency[0]
print(stepped_flap(flap), *(flap * jax.grad(stepped_flap)(flap)))
```

```txt
12.4283 0.963301 0.595257 2.15335 0.0399697
```

**Properties.** Every property of a `Beam` but the length may be a number, a table (`Spanwise`) or a
function of x / L (`SpanwiseFunction`). Its values are leaves like all others, so that they are
swept, fitted and differentiated. How many functions such a beam needs, and how `modes` estimates
what is missing, is said in docs/vibration.md.

**Full sections.** A `Blade` has a stiffness and an inertia of 6 x 6 at each station, about an axis
that may be curved, swept and twisted. `SpatialRod` takes it, and every `Beam`:

```py
import numpy
stiffness = numpy.diag([8e7, 1.5e7, 8e6, 6e5, 1e6, 5.5e6])  # N, N m^2
stiffness[3, 4] = stiffness[4, 3] = 2e5  # it twists where it bends in flap
inertia = numpy.diag([60.0, 60.0, 60.0, 2.9, 0.3, 2.6])
swept = [[0, 0, 0], [4, 0, 0], [8, -0.2, 0.1], [10, -0.6, 0.3]]  # axis, from the root
blade = jb.blades.Blade([0, 1], [stiffness, stiffness / 4], [inertia, inertia / 4], swept)
print(jb.modes(jb.SpatialRod(), jb.Rotor(blade, 1.0), 5.0, 3).frequency_hz)
```

```txt
[1.32466 2.28493 5.14356]
```

`read_blade` reads such blades from files of BeamDyn, HAWC2 (with FPM) and windIO, and `read_vabs`
from sections of VABS; `write_beamdyn` and `write_hawc2` write them. `Blade.of(beam)` is the
blade that a beam is, and `blade.beam()` the straight beam that is left for other models: how much
that leaves out `reduction` says by the lowest frequencies. `section_stiffness` and
`section_inertia` make matrices of EA, EI, GJ and GA, of centres of tension, shear and mass, and of
principal axes:

```py
box = jb.blades.section_stiffness(
    axial_stiffness=8e7, in_plane_bending_stiffness=5e6, flap_bending_stiffness=[1e6, 3e5],
    torsional_stiffness=6e5, in_plane_shear_stiffness=1.5e7, flap_shear_stiffness=8e6,
    tension_centre=(-0.08, 0.02), shear_centre=(-0.02, 0.01), principal_angle=0.05,
)  # (2, 6, 6): two stations
laden = jb.blades.section_inertia(
    mass_per_length=60.0, in_plane_inertia=2.0, flap_inertia=0.3, mass_centre=(-0.1, 0.01)
)
blade = jb.blades.Blade([0, 1], box, laden, 10.0)
print(jb.modes(jb.SpatialRod(), jb.Rotor(blade, 1.0), 5.0, 3).frequency_hz)
```

```txt
[1.13814 1.66406 4.25959]
```

**Points.** `Beam(..., point_masses=jb.PointMasses([0.4, 0.7], [2.0, 0.5]))` carries 2 kg and 0.5 kg
at 40 and 70 % of its span: sensors, joints, a brake. All theories know them, and `PointForces` of
the loads, as they know a mass per length: each is spread over a millionth of the span. Functions of
`Hybrid` that suit the beam follow them (12 of them, with a mass of 0.2 to 5 beams at 37 % of the
span: the first three frequencies to 1e-9). With a mass of one beam 8 elements are off by 2e-6,
2e-5 and 4e-4, whether or not a node is there.

**Ends.** A `Rotor` has a `pitch`, `root_springs` where its root yields in plane or in flap (zero is
a free hinge) and, where what is at its tip is no point, a `tip_body` in the place of a `tip_mass`.
All theories know them, in frequencies, motions, stability, fits and the ladder. What a model cannot
do it refuses by name:
planar elements have no twist, no pitch and no spring in flap; `SpatialRod` has all of them. In
planar elements a body at the tip is held by a stiff spring, which costs bending frequencies 1e-4
and axial frequencies some tenths of a per cent. A `RigidBody` has a full inertia and its centre
anywhere; `SpatialRod` alone knows it.

**Cones.** Of a beam with `precone` there are frequencies in `Hybrid(n_stretch=0)`. They are about
the deflected steady state of the beam, which is that of the exact rod: at 5 degrees, γ = 8 and EI
ratio 16 the first two are 9.2527 and 14.4935, right to all digits. About the undeformed axis of the
cone 9.1311 and 14.5783 would come out, which is further off than 9.2568 and 14.4872 without a cone;
so no theory here does that. `SpatialRod` has frequencies of coned blades that are twisted as well,
and their motions.

**Full sections.** Of files with matrices of six for each section `read_blade(path).beam` is a
`Blade`, about an axis that may be curved and swept. These are the primary file of BeamDyn, which
names its blade file (`read_beamdyn`), an htc file of HAWC2, which names its st file
(`read_hawc2`), a turbine in windIO, version 1 or 2 (`read_windio`; it takes PyYAML, `pip install
"jaxbeam[yaml]"`), and files of VABS, one for each section, to which you say where they are
(`read_vabs`). `beam.beam()` is the straight beam that is left of it for theories that know no more.
A file of sections alone has no axis: with `length=` it is a straight blade without twist.

What programs mean differs, and readers make one thing of it, the axes of a `Blade`:

| | BeamDyn, windIO | HAWC2 | VABS |
|---|---|---|---|
| axes of sections, as a1, a2, a3 of a `Blade` | z, -y, x | z, x, y | x1, x2, x3, or turned |
| order of sixes | x, y, z, about x, y, z | the same | that of a `Blade` |
| twist | about -z; deg, in windIO 1 rad | about +z, deg | not in files |
| reference point | the axis | (x_e, y_e), axes turned by pitch | the axis |
| inertia | a matrix | radii of gyration | a matrix |
| stations | shares of the length of arc | r, along the arc | arguments |

Splines go through the points of a file over z, and sections are linear between stations; the points
of a `Blade` are as many as its own splines take to follow that to 1e-9 of the length. A blade that
`write_beamdyn` or `write_hawc2` writes is read again as it was, to rounding. Key points keep their
places: where the first one is not at zero, the blade begins there. The coefficients mu of BeamDyn
are the `damping` of the table, which `jb.Damping(section_coefficients=table.damping)` takes.

Warnings tell where a file may mean something else than its format says: matrices that are not
symmetric (the mean is taken), radii of gyration in HAWC2 that some programs write about the centre
of mass (`gyration_about_mass_centre` says which), matrices there that seem to be about the axis
already, and half chords on the other side of the axis of pitch. Frequencies would not tell: a sign
of these moves them by 0.1 to 6 %.
"""

from jaxbeam._files.beamdyn import read_beamdyn as read_beamdyn
from jaxbeam._files.beamdyn_writer import write_beamdyn as write_beamdyn
from jaxbeam._files.blade import read_blade as read_blade
from jaxbeam._files.elastodyn_writer import write_elastodyn as write_elastodyn
from jaxbeam._files.formats import BladeFormat as BladeFormat
from jaxbeam._files.hawc2 import read_hawc2 as read_hawc2
from jaxbeam._files.hawc2_writer import write_hawc2 as write_hawc2
from jaxbeam._files.tables import BladeTable as BladeTable
from jaxbeam._files.vabs import read_vabs as read_vabs
from jaxbeam._files.windio import read_windio as read_windio
from jaxbeam._rotor.blade import Blade as Blade
from jaxbeam._rotor.ends import RigidBody as RigidBody
from jaxbeam._rotor.engineering import section_inertia as section_inertia
from jaxbeam._rotor.engineering import section_stiffness as section_stiffness
from jaxbeam._rotor.spanwise import SpanwiseFunction as SpanwiseFunction
from jaxbeam._rotor.support import Support as Support
from jaxbeam._vibration.reduction import Reduction as Reduction
from jaxbeam._vibration.reduction import reduction as reduction
