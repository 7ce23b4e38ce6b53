"""Blades without one of the things that `Blade.beam` leaves out."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._numerics.small import inverses
from jaxbeam._results import replaced
from jaxbeam._rotor.beam_sections import STIFF_IN_SHEAR
from jaxbeam._rotor.blade import Blade
from jaxbeam._rotor.engineering import at_centres
from jaxbeam._rotor.sections import full_matrices, upper_triangles

_SixBySix = Float[Array, "n 6 6"]
# Entries that are no couplings of a section whose strains are at its centres: shear with shear and
# bending with bending are what principal axes are of.
_OWN = np.eye(6)
_OWN[1:3, 1:3] = _OWN[4:, 4:] = 1.0


def uncoupled(blade: Blade) -> Blade:
    """A blade without the couplings of stretch, shear, torsion and bending, but for those that
    centres make which are off the axis."""
    compliance, back = _seen_from_centres(blade)
    return _with(blade, back @ (_OWN[None] * compliance) @ back.swapaxes(1, 2))


def centred(blade: Blade) -> Blade:
    """A blade whose centres of tension, shear and mass are on the axis."""
    compliance, _ = _seen_from_centres(blade)
    inertia = full_matrices(blade.inertia)
    mass = inertia[:, 0, 0, None]
    centre = jnp.stack([-inertia[:, 0, 5], inertia[:, 0, 4]], 1) / mass
    back = at_centres(-centre, -centre)
    inertia = back.swapaxes(1, 2) @ inertia @ back
    return replaced(_with(blade, compliance), inertia=upper_triangles(inertia))


def stiff_in_shear(blade: Blade) -> Blade:
    """A blade with hardly any shear at shear centres, as a `Beam` has it, and no coupling of it."""
    compliance, back = _seen_from_centres(blade)
    across = np.eye(6)[1:3]
    bending = jnp.stack([compliance[:, 5, 5], compliance[:, 4, 4]], 1)  # along axes 2 and 3
    shear = (STIFF_IN_SHEAR * blade.length**2 * bending)[:, :, None] * across[None]
    others = np.eye(6) - across.T @ across
    kept = others[None] @ compliance @ others[None] + across.T @ shear
    return _with(blade, back @ kept @ back.swapaxes(1, 2))


def straight(blade: Blade) -> Blade:
    """A blade with a straight axis of the same length."""
    along = np.asarray(blade.axis_stations)[:, None] * np.eye(3)[:1]
    return replaced(blade, axis=blade.length * along)


WITHOUT: dict[str, Callable[[Blade], Blade]] = {
    "couplings": uncoupled, "offsets": centred, "shear": stiff_in_shear, "curvature": straight,
}  # fmt: skip


def _with(blade: Blade, compliance: _SixBySix) -> Blade:
    return replaced(blade, stiffness=upper_triangles(inverses(compliance)))


def _seen_from_centres(blade: Blade) -> tuple[_SixBySix, _SixBySix]:
    """Compliances of stretch at tension centres and shear at shear centres, and what makes of such
    strains those at the reference point."""
    f = inverses(full_matrices(blade.stiffness))
    # Tension N at (y, z) has the moments (z N, -y N), and bends by none where that is undone.
    z, less_y = -jnp.linalg.solve(f[:, 4:, 4:], f[:, 4:, :1])[:, :, 0].T
    tension = jnp.stack([-less_y, z], 1)
    shear = jnp.stack([-f[:, 3, 2], f[:, 3, 1]], 1) / f[:, 3, 3, None]
    there = at_centres(tension, shear)
    return there @ f @ there.swapaxes(1, 2), at_centres(-tension, -shear)
