"""What columns of tables are called: all names of a property, in one place.

Names are in small letters, with one underscore where there are blanks, underscores and hyphens.
Where two programs mean different things by a name it is not here: EI_xx and EI_yy by their axes,
the twist of aerodynamic files, a radius that begins at the axis or at the root.
"""

from collections.abc import Mapping

from jaxbeam._files.tables import (
    AXIAL,
    FLAP,
    IN_PLANE,
    LENGTHS,
    MASS,
    PLACE,
    POLAR,
    POLARS,
    TORSION,
    TWIST,
    UNITS,
)


def _bending(*words: str) -> str:
    """Names of the bending stiffness in a direction that these words stand for."""
    made = ("{}_stiffness", "{}_bending_stiffness", "{}_rigidity", "ei_{}", "ei{}", "{}_ei")
    return "".join(f"{each.format(word)} " for word in words for each in made)


_SYNONYMS: Mapping[str, str] = {
    PLACE: "x_over_l x/l span_fraction blfract sec_loc",
    MASS: "mass_per_length mass_per_unit_length linear_mass linear_density mass_den bmassden rhoa",
    IN_PLANE: _bending("in_plane", "edge", "edgewise", "lag", "lead_lag")
    + "edgstff edge_stff lag_stff",
    FLAP: _bending("flap", "flapwise", "out_of_plane") + "flpstff flp_stff flap_stff",
    AXIAL: "axial_stiffness axial_rigidity extensional_stiffness ea eastff axial_stff",
    TWIST: "twist twist_angle structural_twist strctwst str_tw",
    TORSION: "torsional_stiffness torsion_stiffness torsional_rigidity gj gjstff tor_stff",
    POLAR: "polar_inertia polar_moment_of_inertia polar_mass_moment_of_inertia torsional_inertia",
    POLARS[0]: "flap_inertia flapwise_inertia flpiner flp_iner",
    POLARS[1]: "edge_inertia edgewise_inertia lag_inertia edginer edge_iner",
}
# From name of a column to property and units.
NAMES: Mapping[str, tuple[str, Mapping[str, float]]] = {
    name: (meaning, UNITS[meaning])
    for meaning, names in _SYNONYMS.items()
    for name in names.split()
} | {"x": (PLACE, LENGTHS)}


def meanings(names: str, factors: Mapping[str, float]) -> dict[str, tuple[str, float]]:
    """Properties and factors by the names of a format."""
    return {name: (NAMES[name][0], factors.get(NAMES[name][0], 1.0)) for name in names.split()}
