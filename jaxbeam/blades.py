"""Beams from files of sectional properties, as blades of turbines are handed on.

`read_csv(path, length=61.5, axial_stiffness=1e10).beam` is a `jaxbeam.Beam` whose properties are
`jaxbeam.Spanwise`; what else a reader returns is a `BladeTable`, also what in the file is ignored.
"""

from jaxbeam._rotor.nrel_tables import read_bmodes as read_bmodes
from jaxbeam._rotor.nrel_tables import read_elastodyn as read_elastodyn
from jaxbeam._rotor.spanwise import SpanwiseFunction as SpanwiseFunction
from jaxbeam._rotor.tables import BladeTable as BladeTable
from jaxbeam._rotor.tables import read_csv as read_csv
