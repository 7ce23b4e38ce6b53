"""Beams from files of whichever format."""

from collections.abc import Callable
from pathlib import Path

import jax

from jaxbeam._files.beamdyn import read_beamdyn
from jaxbeam._files.bmodes import is_main_file, is_section_file, read_bmodes
from jaxbeam._files.csv import count_named, read_csv
from jaxbeam._files.elastodyn import head_of_stations, read_elastodyn
from jaxbeam._files.formats import BladeFormat, signature_of
from jaxbeam._files.hawc2 import read_hawc2
from jaxbeam._files.section_axes import no_axis
from jaxbeam._files.tables import BladeTable
from jaxbeam._files.texts import FilePath, read_lines
from jaxbeam._files.vabs import read_vabs
from jaxbeam._files.windio import read_windio
from jaxbeam._rotor.spanwise import AbstractSpanwise
from jaxbeam._types import Real


def _windio(path: FilePath, *, length: Real | None) -> BladeTable:
    if length is not None:
        raise ValueError(f"{path}: a windIO file says the axis, so no length must be given")
    return read_windio(path)


def _vabs(path: FilePath, *, length: Real | None) -> BladeTable:
    if length is None:
        better = "give read_vabs the axis, and a file for each station"
        raise no_axis(Path(path), "a file of VABS", better)
    with jax.ensure_compile_time_eval():
        return read_vabs([path, path], [0.0, 1.0], length)


_OF_BEAMS: dict[BladeFormat, Callable[..., BladeTable]] = {
    BladeFormat.CSV: read_csv,
    BladeFormat.ELASTODYN: read_elastodyn,
    BladeFormat.BMODES: read_bmodes,
}
_OF_SECTIONS: dict[BladeFormat, Callable[..., BladeTable]] = {
    BladeFormat.BEAMDYN: read_beamdyn,
    BladeFormat.HAWC2: read_hawc2,
    BladeFormat.VABS: _vabs,
    BladeFormat.WINDIO: _windio,
}


def read_blade(
    path: FilePath,
    *,
    length: Real | None = None,
    axial_stiffness: Real | AbstractSpanwise | None = None,
    format: BladeFormat | None = None,
) -> BladeTable:
    """A beam or a blade from a file of any known format, by what is in it and not by its name.

    Columns with names that are known, in the first line, make it a table (CSV); a line of titles
    with BlFract makes it a blade file of ElastoDyn; a line that names a sec_props_file, or the
    lines of BModes in their order, a main file of BModes, and n_secs before rows of numbers a
    section file. What these hold is said by `BladeFormat`. A line with kp_total behind its value
    makes it a primary file of BeamDyn, station_total its blade file (`read_beamdyn`); "begin
    main_body" and the like an htc file of HAWC2, "#1" and "$1" its st file (`read_hawc2`);
    components with a blade a turbine in windIO (`read_windio`), and titles of its matrices a file
    of VABS, of which one alone is a uniform blade (`read_vabs`). Files of AeroDyn, towers and
    primary files of ElastoDyn, and workbooks are named, and not read.

    `path` is that of the file; `length` (m) and `axial_stiffness` (N, a number or one that varies
    along the span) are what the file does not say, as its format wants it. `format`, a
    `BladeFormat`, is for a file that is to be of that format and no other: what is wrong in it is
    then said in the terms of that one. Returns a `BladeTable`, whose `beam` is a `Beam`, or a
    `Blade` where the file has full sections.

    Raises `ValueError`, which names file, line and column of the first mistake, and `OSError` where
    the file cannot be read. Of a file that is none of these it says what it looks like, and what is
    read. Raises `TypeError` for a `format` that is no `BladeFormat`.
    """
    if format is None:
        format = _format_of(Path(path))
    if not isinstance(format, BladeFormat):
        raise TypeError(f"format must be a BladeFormat, got {format!r}")
    if format in _OF_BEAMS:
        return _OF_BEAMS[format](path, length=length, axial_stiffness=axial_stiffness)
    if axial_stiffness is not None:
        raise ValueError(f"{path} is of {format.name}, which says axial_stiffness: give none")
    return _OF_SECTIONS[format](path, length=length)


def _format_of(path: Path) -> BladeFormat:
    """The format of a file by its contents; a table if it is like no other."""
    lines = read_lines(path)
    if count_named(path, lines) >= 2:
        return BladeFormat.CSV
    if head_of_stations(lines) is not None:
        return BladeFormat.ELASTODYN
    found = signature_of(lines)
    if found is not None and found.format in _OF_SECTIONS:
        return found.format
    return BladeFormat.BMODES if is_main_file(lines) or is_section_file(lines) else BladeFormat.CSV
