"""Beams from files of sectional properties, as blades of turbines are handed on.

`read_blade(path, length=61.5, axial_stiffness=1e10).beam` is a `jaxbeam.Beam` whose properties are
`jaxbeam.Spanwise`; what else a reader returns is a `BladeTable`, also what in the file is ignored.
"""

from jaxbeam._files.any import read_blade as read_blade
from jaxbeam._files.bmodes import read_bmodes as read_bmodes
from jaxbeam._files.csv import read_csv as read_csv
from jaxbeam._files.elastodyn import read_elastodyn as read_elastodyn
from jaxbeam._files.elastodyn_writer import write_elastodyn as write_elastodyn
from jaxbeam._files.tables import BladeTable as BladeTable
from jaxbeam._rotor.spanwise import SpanwiseFunction as SpanwiseFunction
