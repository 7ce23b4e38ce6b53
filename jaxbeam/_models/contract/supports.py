"""Checks of features: rotors, loads and damping that a model does not know are refused by name.

A rotor, loads and damping name what they have (`features` of each); a model declares what
its equations of motion know (`supports`), what its matrices of small motion know besides
(`supports_in_matrices`), and what it cannot do without (`needs`).
"""

from typing import Any, NamedTuple

import numpy as np

from jaxbeam._rotor.beam import CONED_AND_MORE, AnyRotor, Rotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._rotor.support import WAYS, Support
from jaxbeam._types import is_concrete

RATIOS = frozenset({"damping.in_plane_ratio", "damping.flap_ratio", "damping.axial_ratio"})
# For each feature, phrases for the error: what a model without it has not, and what to do.
_REFUSED = {
    "blade": (
        "full sections nor curved axes",
        "take SpatialRod, or the straight beam that blade.beam() makes of it",
    ),
    "spanwise": ("property that varies along the span", "take Hybrid or PlanarRod"),
    "beam.twist": ("turned sections", "take Hybrid or SpatialRod"),
    "pitch": ("turned sections", "take Hybrid or SpatialRod"),
    "precone": (
        "motion of a coned beam",
        "take SpatialRod, or for frequencies Hybrid(n_stretch=0); else leave it out, which for "
        "soft beams is the smaller error",
    ),
    CONED_AND_MORE: ("equations of that", "take SpatialRod"),
    "root_springs": ("root that yields", "take Hybrid or PlanarRod"),
    "root_springs.in_plane": ("root that yields in plane", "take Hybrid or PlanarRod"),
    "root_springs.flap": ("root that yields in flap", "take Hybrid or SpatialRod"),
    "root_support": ("support of its root", "take SpatialRod, or root_springs=RootSprings(...)"),
    "tip_support": ("support of its tip", "take SpatialRod, or leave it out"),
    "tip_body": ("body at the tip", "take Hybrid or PlanarRod"),
    "tip_body.centre_of_mass": (
        "body at the tip of a full inertia",
        "take SpatialRod, or a TipBody, which has moments about the axes of its section alone",
    ),
    "loads.tip_moment": ("moment at its tip", "take SpatialRod, or leave it out"),
    "loads.follows": ("load that turns with its sections", "take SpatialRod, or leave it out"),
    "beam.point_masses": ("masses at points of the beam", "take Hybrid or PlanarRod"),
    "loads.point_forces": (
        "forces on points of the beam",
        "take Hybrid or PlanarRod, or leave them out",
    ),
    "loads.force_per_length": (
        "force along the span",
        "take Hybrid or PlanarRod, or leave it out",
    ),
}
_REFUSED |= dict.fromkeys(
    RATIOS, ("modes that last", "take Hybrid, or give a stiffness_coefficient")
) | {
    "damping.in_plane_damper": ("damper in plane", "take Hybrid or PlanarRod"),
    "damping.flap_damper": ("damper in flap", "take Hybrid or SpatialRod"),
    "damping.section_coefficients": (
        "full sections",
        "take SpatialRod, or a stiffness_coefficient",
    ),
    "damping.root_dampers": ("dampers of a support", "take SpatialRod, or in_plane_damper=..."),
    "damping.tip_dampers": ("dampers of a support", "take SpatialRod, or leave them out"),
}
_NEEDED = {"beam.torsional_stiffness": ": give torsional_stiffness=..., GJ in N m^2, to the Beam"}
# Features that all models of a continuous beam know.
AS_BUILT = frozenset(
    {
        "spanwise", "beam.point_masses", "tip_body", "tip_body.flap_inertia",
        "loads.force_per_length", "loads.point_forces",
    }
)  # fmt: skip
ROOT_IN_PLANE = frozenset({"root_springs", "root_springs.in_plane", "damping.in_plane_damper"})
ROOT_SPRINGS = ROOT_IN_PLANE | {"root_springs.flap", "damping.flap_damper"}
TURNED = frozenset({"beam.twist", "pitch"})
SUPPORTS = frozenset(
    f"{end}_support{part}" for end in ("root", "tip")
    for part in ("", *(f".{name}" for name in (*WAYS, "attitude")))
) | {"damping.root_dampers", "damping.tip_dampers"}  # fmt: skip


class Neglects(NamedTuple):
    """Typical relative errors of a theory, each over a number that they are in proportion to. All
    are zero where nothing is known."""

    stiffening: float = 0.0  # error over the stiffening ratio
    deflection: float = 0.0  # error over the square of deflection over length
    strain: float = 0.0  # error over the steady strain


def borne(model: type[Any], *, moving: bool = True) -> frozenset[str]:
    """Features that models of a class know; linear ones know damping ratios, since their modes do
    not change."""
    own: frozenset[str] = model.supports | (RATIOS if model.is_linear else frozenset())
    return own if moving else own | vars(model).get("supports_in_matrices", frozenset())


def missing(
    model: type[Any], rotor: AnyRotor, loads: Loads = NO_LOADS, damping: Damping = NO_DAMPING, *,
    moving: bool = True,
) -> list[str]:  # fmt: skip
    """Features of a rotor, loads and damping that models of a class do not know.

    `moving` is whether equations of motion are asked for, not matrices alone. What derives from a
    class inherits `supports`, as its equations; matrices of their own it has to declare again.
    """
    every = *rotor.features, *loads.features, *damping.features
    own = borne(model, moving=moving)
    return [feature for feature in every if feature not in own]


def unsupported(
    model: type[Any], rotor: AnyRotor, loads: Loads = NO_LOADS, damping: Damping = NO_DAMPING, *,
    moving: bool = True,
) -> str:  # fmt: skip
    """A sentence that says why models of a class cannot take a rotor, loads and damping; empty
    where they can."""
    for feature in missing(model, rotor, loads, damping, moving=moving):
        what, advice = _REFUSED.get(feature, ("such thing", "leave it out"))
        return f"{feature}: {model.__name__} has no {what}: {advice}"
    for need in sorted(model.needs):
        if need not in rotor.given:
            return f"{need}: {model.__name__} needs it{_NEEDED.get(need, '')}"
    return ""


def check_supported(
    model: Any, rotor: AnyRotor, loads: Loads = NO_LOADS, damping: Damping = NO_DAMPING, *,
    moving: bool = True,
) -> None:  # fmt: skip
    """Raise `ValueError` for features that a model does not know, dampers where the root is
    clamped, and, for motion, a model that does not suit the root of the rotor.

    Called by `checked_case` for all public functions, and where equations are made.
    """
    why = unsupported(type(model), rotor, loads, damping, moving=moving)
    if not why and isinstance(rotor, Rotor):
        why = _clamped(rotor, damping)
    if not why and moving and model.suited(rotor) != model:
        why = (
            f"rotor: it is held otherwise than what this {type(model).__name__} suits: take "
            "model.suited(rotor)"
        )
    if why:
        raise ValueError(why)


def _clamped(rotor: Rotor, damping: Damping) -> str:
    """A sentence that says which damper is where the beam is clamped; empty where there is none."""
    if rotor.root_support is None:
        each = zip(("in_plane", "flap"), damping.dampers, rotor.springs, strict=True)
        for way, damper, spring in each:
            if damper is not None and spring is None:
                return (
                    f"damping.{way}_damper: the root is clamped there: give the Rotor "
                    f"root_springs=RootSprings({way}=...), zero for a free hinge"
                )
    elif damping.dampers != (None, None):
        return "damping: dampers of a root_support are root_dampers=[...], six numbers"
    ends = (
        ("root", damping.root_dampers, rotor.root_support),
        ("tip", damping.tip_dampers, rotor.tip_support),
    )
    for end, dampers, support in ends:
        if dampers is None:
            continue
        if support is None:
            return f"damping.{end}_dampers: give the Rotor {end}_support=Support(...) as well"
        if why := _rigid(end, dampers, support):
            return why
    return ""


def _rigid(end: str, dampers: Any, support: Support) -> str:
    """A sentence that says which damper of a support is where that is rigid; empty without one."""
    if not is_concrete(dampers):
        return ""
    for way, damper, spring in zip(WAYS, np.asarray(dampers), support.springs, strict=True):
        if spring is None and damper:
            return (
                f"damping.{end}_dampers: the support holds rigidly what is {way}: give "
                f"Support({way}=...), zero where it is free"
            )
    return ""
