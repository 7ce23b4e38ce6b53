"""What a model cannot do is refused by name, here and nowhere else.

A rotor and loads name what they have (`Rotor.features`, `Loads.features`); a model declares what
its equations of motion know (`supports`), what its matrices of small motion know besides
(`supports_in_matrices`), and what it cannot do without (`needs`).
"""

from typing import Any, NamedTuple

from jaxbeam._rotor.beam import CONED_AND_MORE, AnyRotor
from jaxbeam._rotor.loads import NO_LOADS, Loads

# Of each feature: what a model that does not know it has not, and what to do.
_REFUSED = {
    "blade": (
        "full sections nor curved axes",
        "take SpatialRod, or the straight beam that blade.beam() makes of it",
    ),
    "spanwise": ("property that varies along the span", "take Hybrid or ExactRodANCF"),
    "beam.twist": ("turned sections", "take Hybrid or SpatialANCF"),
    "pitch": ("turned sections", "take Hybrid or SpatialANCF"),
    "precone": (
        "motion of a coned beam",
        "take SpatialANCF, or for frequencies Hybrid(n_stretch=0); else leave it out, which for "
        "soft beams is the smaller error",
    ),
    CONED_AND_MORE: ("equations of that", "take SpatialANCF"),
    "root_springs": ("root that yields", "take Hybrid or ExactRodANCF"),
    "root_springs.in_plane": ("root that yields in plane", "take Hybrid or ExactRodANCF"),
    "root_springs.flap": ("root that yields in flap", "take Hybrid or SpatialANCF"),
    "tip_body": ("body at the tip", "take Hybrid or ExactRodANCF"),
    "tip_body.flap_inertia": (
        "body at the tip of two inertias across the beam",
        "leave flap_inertia out, or take Hybrid",
    ),
    "loads.tip_moment": ("moment at its tip", "take SpatialANCF, or leave it out"),
    "loads.follows": ("load that turns with its sections", "take SpatialANCF, or leave it out"),
    "beam.point_masses": ("masses at points of the beam", "take Hybrid or ExactRodANCF"),
    "loads.point_forces": (
        "forces on points of the beam",
        "take Hybrid or ExactRodANCF, or leave them out",
    ),
    "loads.force_per_length": (
        "force along the span",
        "take Hybrid or ExactRodANCF, or leave it out",
    ),
}
_NEEDED = {"beam.torsional_stiffness": ": give torsional_stiffness=..., GJ in N m^2, to the Beam"}
# What all beams know.
AS_BUILT = frozenset(
    {
        "spanwise", "beam.point_masses", "tip_body", "loads.force_per_length",
        "loads.point_forces",
    }
)  # fmt: skip
ROOT_SPRINGS = frozenset({"root_springs", "root_springs.in_plane", "root_springs.flap"})
TURNED = frozenset({"beam.twist", "pitch"})


class Neglects(NamedTuple):
    """What a theory leaves out, as a rule: its relative error over three numbers. All are zero
    where nothing is known."""

    stiffening: float = 0.0  # over the stiffening ratio
    deflection: float = 0.0  # over the square of deflection over length
    strain: float = 0.0  # over the steady strain


def missing(
    model: type[Any], rotor: AnyRotor, loads: Loads = NO_LOADS, *, moving: bool = True
) -> list[str]:
    """Features of a rotor and loads that models of a class do not know.

    `moving` is whether equations of motion are asked for, not matrices alone. What derives from a
    class inherits `supports`, as its equations; matrices of their own it has to declare again.
    """
    borne: frozenset[str] = model.supports
    if not moving:
        borne |= vars(model).get("supports_in_matrices", frozenset())
    return [feature for feature in (*rotor.features, *loads.features) if feature not in borne]


def unsupported(
    model: type[Any], rotor: AnyRotor, loads: Loads = NO_LOADS, *, moving: bool = True
) -> str:
    """Why models of a class do not bear a rotor and loads, in a sentence; empty where they do."""
    for feature in missing(model, rotor, loads, moving=moving):
        what, advice = _REFUSED.get(feature, ("such thing", "leave it out"))
        return f"{feature}: {model.__name__} has no {what}: {advice}"
    for need in sorted(model.needs):
        if need not in rotor.given:
            return f"{need}: {model.__name__} needs it{_NEEDED.get(need, '')}"
    return ""


def check_supported(
    model: Any, rotor: AnyRotor, loads: Loads = NO_LOADS, *, moving: bool = True
) -> None:
    """Raise `ValueError` where a model does not bear what there is, or in motion its root yields
    otherwise than that of the rotor.

    All functions pass here: `checked_case` at the door, equations of motion and matrices of their
    own as they are built.
    """
    why = unsupported(type(model), rotor, loads, moving=moving)
    if not why and moving and model.suited(rotor) != model:
        why = (
            f"root_springs: the root of the rotor yields otherwise than that of this "
            f"{type(model).__name__}: take model.suited(rotor)"
        )
    if why:
        raise ValueError(why)
