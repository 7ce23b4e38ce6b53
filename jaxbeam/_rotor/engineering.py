"""Section matrices of a blade from engineering numbers: stiffnesses, centres, principal axes."""

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import check_all, is_valid, real_array

# Strains (or velocities) in the order along, two across, and about three axes: at another point of
# the section they are those at the reference point, plus these matrices times its coordinates.
# Part of strains along the blade, for the second and the third coordinate.
_ALONG = np.zeros((2, 6, 6))
_ALONG[0, 0, 5], _ALONG[1, 0, 4] = -1.0, 1.0
# Part of strains across the blade, for the second and the third coordinate.
_ACROSS = np.zeros((2, 6, 6))
_ACROSS[0, 2, 3], _ACROSS[1, 1, 3] = 1.0, -1.0
# A turn of the axes across by an angle a is _KEPT + cos(a) _TURNED + sin(a) _MIXED.
_KEPT = np.diag([1.0, 0.0, 0.0, 1.0, 0.0, 0.0])
_TURNED = np.diag([0.0, 1.0, 1.0, 0.0, 1.0, 1.0])
_MIXED = np.zeros((6, 6))
_MIXED[1, 2] = _MIXED[4, 5] = 1.0
_MIXED -= _MIXED.T


def section_stiffness(
    *, axial_stiffness: Any, in_plane_bending_stiffness: Any, flap_bending_stiffness: Any,
    torsional_stiffness: Any, in_plane_shear_stiffness: Any, flap_shear_stiffness: Any,
    tension_centre: Any = (0.0, 0.0), shear_centre: Any = (0.0, 0.0), principal_angle: Any = 0.0,
) -> Float[Array, "*n 6 6"]:  # fmt: skip
    """Stiffness of sections as a `Blade` takes it, from engineering numbers.

    | argument                   | symbol | meaning                                    | unit  |
    |----------------------------|--------|--------------------------------------------|-------|
    | axial_stiffness            | EA     |                                            | N     |
    | in_plane_bending_stiffness | EI_3   | about the third principal axis             | N m^2 |
    | flap_bending_stiffness     | EI_2   | about the second one                       | N m^2 |
    | torsional_stiffness        | GJ     | about the shear centre                     | N m^2 |
    | in_plane_shear_stiffness   | GA_2   | along the second principal axis            | N     |
    | flap_shear_stiffness       | GA_3   | along the third one                        | N     |
    | tension_centre             | t      | (2,) where tension does not bend           | m     |
    | shear_centre               | s      | (2,) where force across does not twist     | m     |
    | principal_angle            | a      | from the second axis towards the third one | rad   |

    Each is a number or has one for each station, (n,), and centres (n, 2). Stiffnesses are > 0 and
    without the shear-correction factor left to do: GA_2 is k G A. Centres are from the reference
    point, by the second (towards the leading edge) and the third axis of the section. At angle
    zero principal axes are those of the section. The matrix K has the energy, by length,

        e.K e / 2 = (EA eps_t^2 + GA_2 g_2^2 + GA_3 g_3^2 + GJ k_1^2 + EI_2 k_2^2 + EI_3 k_3^2) / 2

    of strains e = (eps, gamma, kappa) at the reference point, with eps_t = eps + (kappa x t)_1 the
    stretch at the tension centre, g the shear gamma + kappa x s at the shear centre, and g_2, g_3,
    k_2, k_3 along principal axes. So there are no couplings but those that centres make.

    There is no default for shear: a blade has some. Where nothing is known, 0.3 EA is that of a
    solid section of metal, and lowers first frequencies by some 10 EI / (GA L^2).

    Returns (n, 6, 6), or (6, 6) where all are numbers.

    Raises `TypeError` for what is no real number, and `ValueError` for shapes and stiffnesses that
    are not allowed.
    """
    given = {
        "axial_stiffness": axial_stiffness, "in_plane_shear_stiffness": in_plane_shear_stiffness,
        "flap_shear_stiffness": flap_shear_stiffness, "torsional_stiffness": torsional_stiffness,
        "flap_bending_stiffness": flap_bending_stiffness,
        "in_plane_bending_stiffness": in_plane_bending_stiffness,
    }  # fmt: skip
    numbers = {name: _numbers(name, value, zero=False) for name, value in given.items()}
    numbers["principal_angle"] = _numbers("principal_angle", principal_angle, zero=None)
    centres = {
        "tension_centre": _centres("tension_centre", tension_centre),
        "shear_centre": _centres("shear_centre", shear_centre),
    }
    *stiff, angle, tension, shear, is_one = _alike(numbers, centres)
    out = _sixes(stiff, at_centres(tension, shear), angle)
    return out[0] if is_one else out


def section_inertia(
    *, mass_per_length: Any, in_plane_inertia: Any, flap_inertia: Any,
    mass_centre: Any = (0.0, 0.0), inertia_angle: Any = 0.0,
) -> Float[Array, "*n 6 6"]:  # fmt: skip
    """Inertia of sections as a `Blade` takes it, from engineering numbers.

    | argument         | symbol | meaning                                            | unit |
    |------------------|--------|----------------------------------------------------|------|
    | mass_per_length  | m      |                                                    | kg/m |
    | in_plane_inertia | J_3    | about the third principal axis through the centre  | kg m |
    |                  |        | of mass, by length: int y^2 dm                     |      |
    | flap_inertia     | J_2    | about the second one: int z^2 dm                   | kg m |
    | mass_centre      | c      | (2,) from the reference point, by the second axis  | m    |
    |                  |        | (towards the leading edge) and the third one       |      |
    | inertia_angle    | a      | of principal axes, from the second axis of the     | rad  |
    |                  |        | section towards the third one                      |      |

    Each is a number or has one for each station, (n,), and the centre (n, 2); m is > 0, moments of
    inertia are >= 0. That about the axis along the blade is their sum, as of everything flat. The
    matrix M has the kinetic energy, by length,

        v.M v / 2 = (m |V + Omega x c|^2 + (J_2 + J_3) w_1^2 + J_2 w_2^2 + J_3 w_3^2) / 2

    of velocities v = (V, Omega) of the reference point, with w_2, w_3 along principal axes.

    Returns (n, 6, 6), or (6, 6) where all are numbers.

    Raises `TypeError` for what is no real number, and `ValueError` for shapes and numbers that are
    not allowed.
    """
    numbers = {
        "mass_per_length": _numbers("mass_per_length", mass_per_length, zero=False),
        "flap_inertia": _numbers("flap_inertia", flap_inertia, zero=True),
        "in_plane_inertia": _numbers("in_plane_inertia", in_plane_inertia, zero=True),
        "inertia_angle": _numbers("inertia_angle", inertia_angle, zero=None),
    }
    centres = {"mass_centre": _centres("mass_centre", mass_centre)}
    mass, about2, about3, angle, centre, is_one = _alike(numbers, centres)
    entries = [mass, mass, mass, about2 + about3, about2, about3]
    out = _sixes(entries, at_centres(centre, centre), angle)
    return out[0] if is_one else out


def at_centres(along: Float[Array, "n 2"], across: Float[Array, "n 2"]) -> Float[Array, "n 6 6"]:
    """The matrix from strains (or velocities) at the reference point to those along the blade at
    the point `along` and across it at the point `across`; that of -along and -across is its
    inverse."""
    pairs = ((along, _ALONG), (across, _ACROSS))
    offsets = [p[:, i, None, None] * table[i][None] for p, table in pairs for i in range(2)]
    return np.eye(6)[None] + sum(offsets)


def _sixes(entries: Any, at_points: Array, angle: Array) -> Float[Array, "n 6 6"]:
    """Matrices (n, 6, 6) with these diagonal entries for strains (or velocities) at other points,
    which `at_points` makes of those at the reference point, in axes turned by an angle."""
    cos, sin = jnp.cos(angle)[:, None, None], jnp.sin(angle)[:, None, None]
    turned = (_KEPT[None] + cos * _TURNED[None] + sin * _MIXED[None]) @ at_points
    out: Any = turned.swapaxes(1, 2) @ (jnp.stack(entries, 1)[:, :, None] * turned)
    return out


def _numbers(name: str, value: Any, zero: bool | None) -> Array:
    """A number or (n,) of them, checked: positive, with `zero` not negative, with None of any
    sign."""
    numbers = real_array(name, value)
    if numbers.ndim > 1 or not numbers.size:
        raise ValueError(f"{name} must be a number or (n,) of them, got shape {numbers.shape}")
    sign = "" if zero is None else " and >= 0" if zero else " and > 0"
    check_all(f"{name} must be finite{sign}", numbers, lambda each: is_valid(each, zero))
    return numbers


def _centres(name: str, value: Any) -> Array:
    """The coordinates (2,) or (n, 2) of centres, checked."""
    centre = real_array(name, value)
    if centre.ndim not in (1, 2) or centre.shape[-1] != 2 or not centre.size:
        raise ValueError(f"{name} must have shape (2,) or (n, 2), got {centre.shape}")
    check_all(f"{name} must be finite", centre)
    return centre


def _alike(numbers: dict[str, Array], centres: dict[str, Array]) -> list[Any]:
    """Numbers and centres, all broadcast to the same number of stations, and whether none of them
    has an axis of stations."""
    counts = {name: a.shape[0] for name, a in numbers.items() if a.ndim == 1}
    counts |= {name: a.shape[0] for name, a in centres.items() if a.ndim == 2}
    count = next(iter(counts.values()), 1)
    for name, size in counts.items():
        if size != count:
            first = next(iter(counts))
            raise ValueError(f"{name} has {size} stations, and {first} has {count}")
    every = [jnp.broadcast_to(a, (count,)) for a in numbers.values()]
    every += [jnp.broadcast_to(a, (count, 2)) for a in centres.values()]
    return [*every, not counts]
