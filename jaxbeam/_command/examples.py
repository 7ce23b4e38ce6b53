"""Scenes to begin with, and what `--help` says."""

_ROTOR = """\
[beam]                        # arguments of Beam, Beam.from_section or Beam.from_slenderness
length = 8.0                  # m
youngs_modulus = 6.895e10     # Pa
density = 2767.0              # kg/m^3
area = 7.299e-5               # m^2
in_plane_second_moment = 8.214e-9  # m^4; flap_second_moment is the same unless given
[rotor]
hub_radius = 0.5              # m
tip_mass = 0.1                # kg
"""
_HYBRID = f"""\
[model]
name = "Hybrid"               # a model of jaxbeam; other keys are its arguments (n_in_plane = 24)
{_ROTOR}"""
EXAMPLES = {
    "frequencies": f"""{_HYBRID}\
[frequencies]                 # the question: how many modes of each direction
in_plane = 2
flap = 1                      # also axial, torsion, and angular_speed where it is not swept
[sweep]                       # numbers from above, by name: lists, or from, to and how many
angular_speed = {{from = 0.0, to = 10.0, count = 21}}
tip_mass = [0.0, 0.1, 0.2]
""",
    "southwell": f"""{_HYBRID}\
[southwell]                   # the question: of which modes, at rest unless angular_speed is given
in_plane = 2
[sweep]
hub_radius = {{from = 0.0, to = 4.0, count = 9}}
""",
    "spin_up": f"""\
[model]
name = "PlanarRod"            # geometrically exact elements, in the plane of rotation
n_elements = 8
{_ROTOR}\
[motion]
name = "SmoothSpinUp"         # a motion of jaxbeam; other keys are its arguments
angular_speed = 4.0           # rad/s
duration = 15.0               # s
[spin_up]                     # the question; without [sweep] histories, with it the peak of each
until = 20.0                  # s
points = 201                  # output times
""",
}
EPILOG = f"""\
Frequencies over speed, for three tip masses (--example prints it, and the others):

{EXAMPLES["frequencies"]}
Keys are arguments of jaxbeam's Beam, Rotor, Loads, Damping and so on, all of them; what these make
of numbers themselves are tables within: [rotor.root_springs] is a RootSprings, [rotor.tip_body] a
TipBody, and twist = {{stations = [0.0, 1.0], values = [0.2, 0.0]}} a Spanwise. Speeds may be in
rpm, as angular_speed_rpm = 12.1. A number that two tables have is swept as "rotor.tip_body.mass".
A [beam] may have file = "blade.csv", any file of blades.read_blade beside it, of which what it says
of rotor and angular_speed holds unless the scene has others. There may be [loads], such as
gravity = [0.0, 0.0, -9.81], and [damping]. A spin-up:

{EXAMPLES["spin_up"]}
Arguments, units and what a model can do are those of the package: help(jaxbeam.Beam) in Python.
FOLDER gets a table, as .csv and as .npz (for jaxbeam.Table.load), and a figure. A case that fails
has a status there (see jaxbeam.Status) and leaves the others alone. A sweep that was stopped goes
on when the same command runs again; after a change in the file remove FOLDER/chunks, or name
another FOLDER. Exit status: 0 if a case is ok, 1 if none is, 2 for a mistake in the file.
"""
