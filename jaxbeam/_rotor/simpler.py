"""Blades simplified in one respect: without couplings, offsets, shear or curvature."""

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
# Entries of a compliance at the centres of a section that are no couplings: the diagonal, and shear
# with shear and bending with bending, which depend on principal axes.
_UNCOUPLED = np.eye(6)
_UNCOUPLED[1:3, 1:3] = _UNCOUPLED[4:, 4:] = 1.0


def uncoupled(blade: Blade) -> Blade:
    """The blade without couplings of stretch, shear, torsion and bending with each other, except
    those by centres that are off the axis."""
    compliance, back = _compliance_at_centres(blade)
    return _with(blade, back @ (_UNCOUPLED[None] * compliance) @ back.swapaxes(1, 2))


def centred(blade: Blade) -> Blade:
    """The blade with centres of tension, shear and mass moved to the axis."""
    compliance, _ = _compliance_at_centres(blade)
    inertia = full_matrices(blade.inertia)
    mass = inertia[:, 0, 0, None]
    centre = jnp.stack([-inertia[:, 0, 5], inertia[:, 0, 4]], 1) / mass
    back = at_centres(-centre, -centre)
    inertia = back.swapaxes(1, 2) @ inertia @ back
    return replaced(_with(blade, compliance), inertia=upper_triangles(inertia))


def stiff_in_shear(blade: Blade) -> Blade:
    """The blade with as little shear at shear centres as a `Beam`, and no coupling of shear."""
    compliance, back = _compliance_at_centres(blade)
    across = np.eye(6)[1:3]
    bending = jnp.stack([compliance[:, 5, 5], compliance[:, 4, 4]], 1)  # along axes 2 and 3
    shear = (STIFF_IN_SHEAR * blade.length**2 * bending)[:, :, None] * across[None]
    others = np.eye(6) - across.T @ across
    kept = others[None] @ compliance @ others[None] + across.T @ shear
    return _with(blade, back @ kept @ back.swapaxes(1, 2))


def straight(blade: Blade) -> Blade:
    """The blade with a straight axis of the same length."""
    along = np.asarray(blade.axis_stations)[:, None] * np.eye(3)[:1]
    return replaced(blade, axis=blade.length * along)


WITHOUT: dict[str, Callable[[Blade], Blade]] = {
    "couplings": uncoupled, "offsets": centred, "shear": stiff_in_shear, "curvature": straight,
}  # fmt: skip


def _with(blade: Blade, compliance: _SixBySix) -> Blade:
    return replaced(blade, stiffness=upper_triangles(inverses(compliance)))


def _compliance_at_centres(blade: Blade) -> tuple[_SixBySix, _SixBySix]:
    """Compliances with stretch at tension centres and shear at shear centres, and the matrices from
    such strains to those at the reference point."""
    f = inverses(full_matrices(blade.stiffness))
    # Tension N at (y, z) has the moments (z N, -y N): at the centre they cancel the bending by N.
    z, less_y = -jnp.linalg.solve(f[:, 4:, 4:], f[:, 4:, :1])[:, :, 0].T
    tension = jnp.stack([-less_y, z], 1)
    shear = jnp.stack([-f[:, 3, 2], f[:, 3, 1]], 1) / f[:, 3, 3, None]
    to_centres = at_centres(tension, shear)
    return to_centres @ f @ to_centres.swapaxes(1, 2), at_centres(-tension, -shear)
