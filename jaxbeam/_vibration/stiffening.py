"""What says beforehand whether a theory may be used."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._checks import checked_speed
from jaxbeam._models.bases.loads import Profile
from jaxbeam._models.contract.small_motion import guarded
from jaxbeam._models.modal.theories import Hybrid
from jaxbeam._modes.modes import find
from jaxbeam._modes.wanted import lowest
from jaxbeam._numerics.linalg import symmetric_modes
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, nan_unless
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.checked import checked_rotor
from jaxbeam._rotor.directions import loose_motions
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Real, Scalar, Vector

_SHEAR = 3.1  # E / (kappa G) of a solid section of metal


def _bending(rotor: Rotor) -> Hybrid:
    """The model of in-plane bending alone for a rotor."""
    return Hybrid(0, 14, 0).suited(rotor)


class StiffeningRatio(eqx.Module):
    """The `ratio` of motion-induced over elastic stiffness, without unit; and a `status`, unless
    which is OK it is NaN (derivatives: as in `modes`)."""

    ratio: Scalar
    status: Code


def stiffening_ratio(rotor: Rotor, angular_speed: Real, *, throw: bool = True) -> StiffeningRatio:
    """Motion-induced over elastic stiffness of the first in-plane mode at rest, without unit.

        ratio = int P(x) phi'^2 dx / int EI_zz phi''^2 dx,

    P(x) the tension that carries the rigid motion of `rotor` (a `Rotor`) at `angular_speed` (rad/s;
    `Rotor.tension`, N), phi the first bending mode of the beam at rest with its tip mass. These are
    the terms that Y eq. 19 has and the classical theory (`Classical`) has not; Y, below eq. 20 and
    on Fig. 6: that theory may be used while they are small beside the elastic ones, however small
    the deflection. The ratio is Omega^2 times an affine function of the hub radius, and does not
    depend on the axial stiffness. By Rayleigh

        omega^2 = omega_0^2 (1 + ratio) - Omega^2  (`Hybrid`),  omega_0^2 - Omega^2  (`Classical`):

    the classical frequency is too low by ratio / 2, relative, while that is small: by 1 % at 0.02.

    `rotor`, any but in a cone; `angular_speed` () in rad/s, of any sign. Returns a
    `StiffeningRatio`; derivatives of any order, those by what changes phi included. `throw=False`
    returns failures, those of `modes` for phi among them, in `StiffeningRatio.status`, and NaN.

    Raises `ValueError` or `TypeError` for a malformed argument, and, with `throw`, `ValueError` for
    a parameter out of range (under `jit` `RuntimeError`) and `RuntimeError` where phi is not found.
    """
    result = _ratio(checked_rotor(Rotor, rotor), checked_speed(angular_speed))
    return finish(result, throw)


@Program
def _ratio(rotor: Rotor, speed: Scalar) -> StiffeningRatio:
    given, rotor, speed = guarded(rotor, speed)
    still = jnp.zeros_like(speed)
    model = _bending(rotor)
    first = find(model, rotor, still, lowest(model, 1))
    ratio = stiffening_of(first.shape[0].real, rotor, speed)
    finite = first_broken((jnp.isfinite(ratio), Status.NOT_FINITE))
    status = first_failure(given, first.status, finite)
    return StiffeningRatio(nan_unless(status == Status.OK, ratio), status)


def stiffening_of(phi: Vector, rotor: Rotor, speed: Scalar) -> Scalar:
    """The `stiffening_ratio` of a case in range, from its first mode at rest."""
    equations = _bending(rotor).equations(rotor)
    motion = phi @ equations.motion_stiffness(jnp.zeros_like(speed), speed**2, None) @ phi
    return motion / (2 * equations.strain_energy(phi))


def bending_at_rest(rotor: Rotor) -> tuple[Vector, Float[Array, "k n"]]:
    """Frequencies in plane at rest (rad/s), and modes as rows, lowest first, without labels and
    derivatives: a program a fifth as large as `find`."""
    square, shape = _at_rest(_bending(rotor), rotor)
    return jnp.sqrt(jnp.maximum(square, 0.0)), shape


def _at_rest(model: Hybrid, rotor: Rotor) -> tuple[Vector, Float[Array, "k n"]]:
    """Squares of frequencies at rest, and modes as rows."""
    system = model.matrices(rotor, jnp.zeros_like(rotor.hub_radius))
    shape = symmetric_modes(system.mass, system.stiffness, loose_motions(rotor))
    return jnp.sum((shape @ system.stiffness) * shape, axis=1), shape


def timoshenko_reduction(rotor: Rotor) -> Float[Array, "2 6"]:
    """The relative reduction of the first frequencies in plane and in flap, at rest, by shear and
    rotary inertia; where sections are turned that of the lowest modes, twice.

        int r^2 phi'^2 dm / 2 + omega^2 int Q^2 / (kappa G A) dx / 2,   Q = int_x^L phi dm,

    r^2 = EI / EA, for modes of unit modal mass: Rayleigh's quotient to first order in (r / L)^2
    with the inertia of sections that turn, and with their compliance to the shear force
    (S. P. Timoshenko, Philosophical Magazine 41, 1921). For a solid section of metal, EA / (kappa G
    A) = 3.1; thin webs, or composite ones, yield more.
    """
    full = Hybrid(0, 14, 14).suited(rotor)
    if rotor.couples_bending:
        return jnp.stack(2 * [_reduction(full, rotor)])
    alone = (dataclasses.replace(full, n_flap=0), dataclasses.replace(full, n_in_plane=0))
    return jnp.stack([_reduction(model, rotor) for model in alone])


def _reduction(model: Hybrid, rotor: Rotor) -> Float[Array, " 6"]:
    beam, shapes, one_hot = rotor.beam, model.sampled(rotor, model.shapes(rotor)), model.one_hot
    square, shape = (a[:6] for a in _at_rest(model, rotor))
    span, at, ends = shapes.span, shapes.at, shapes.ends
    profile = Profile.of(rotor, span)
    ways = [shape * one_hot[None, :, k] for k in (1, 2)]
    first, second = profile.in_section_axes(*(at.slope @ way.T / beam.length for way in ways))
    dm = span.weight * profile.mass / profile.axial
    rotary = (dm * profile.in_plane) @ first**2 + (dm * profile.flap) @ second**2
    tip = rotor.tip_body.centre(ends.tip, ends.tip_slope, beam.length)
    force = [
        span.beyond(profile.mass[:, None] * (at.value @ way.T)).T
        + rotor.tip_mass * (way @ tip)[:, None]
        for way in ways
    ]
    sheared = (force[0] ** 2 + force[1] ** 2) @ (span.weight * beam.length / profile.axial)
    return (rotary + _SHEAR * square * sheared) / 2
