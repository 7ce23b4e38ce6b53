"""What a blade of full sections loses where it is taken for a straight beam."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._checks import check_kind, count_functions
from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.small_motion import guarded
from jaxbeam._models.space.rod import SpatialRod
from jaxbeam._numerics.linalg import modes_and_squares
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, nan_unless
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.blade import Blade
from jaxbeam._rotor.simpler import WITHOUT
from jaxbeam._status import Status
from jaxbeam._types import Code

_ROD = SpatialRod()


class Reduction(eqx.Module):
    """Lowest frequencies of a blade at rest, and how they change where something is left out of it.

    `frequency` has those of the blade, in rad/s; `couplings`, `offsets`, `shear`, `curvature` and
    `beam` have relative changes w' / w - 1 without these, the last those of the beam that
    `Blade.beam` makes, which has none of them; each has shape (k,). There is a `status`.
    """

    frequency: Float[Array, " k"]
    couplings: Float[Array, " k"]
    offsets: Float[Array, " k"]
    shear: Float[Array, " k"]
    curvature: Float[Array, " k"]
    beam: Float[Array, " k"]
    status: Code


def reduction(
    rotor: Rotor, count: int = 3, *, rod: SpatialRod = _ROD, throw: bool = True
) -> Reduction:
    """The effect on the lowest frequencies at rest of each thing that `Blade.beam` leaves out.

    `rotor` has a `Blade`; `count` frequencies are found, with what is at its ends, by the matrices
    of `rod`, a `SpatialRod`. They are w of the blade as it is and w' of one without one thing,
    with all else as it is, and what is told is w' / w - 1 for

    - `couplings` of stretch, shear, torsion and bending: of compliances by strains at the centres
      of sections (stretch where tension does not bend, shear where force across does not twist)
      the entries beyond those of shear with shear and of bending with bending;
    - `offsets`: centres of tension, shear and mass are on the axis;
    - `shear`: next to none at shear centres, as in a `Beam`, and nothing coupled with it;
    - `curvature`: the axis is straight, of the same length and with the same twist;
    - `beam`: the beam that `rotor.beam.beam()` is. That is not the sum of these: one may undo
      another, and a beam has its polar inertia alone, which it shares between both ways of bending,
      and is linear in other quantities between stations.

    Frequencies are compared by their places in order: where two pass one another both places tell.
    Of what rotation does nothing is said: where an effect is not small, hold `SpatialRod` of both
    against each other at speed.

    Returns a `Reduction`. With `throw=False` a case that is not allowed is NaN with a `status`.

    Raises `TypeError` unless the beam of the rotor is a `Blade`, and `ValueError` for what is out
    of range.
    """
    check_kind("rod", rod, SpatialRod)
    check_kind("rotor", rotor, Rotor)
    check_kind("rotor.beam", rotor.beam, Blade)
    count_functions("count", count, least=1)
    _, rotor, _ = checked_case(rod, rotor, 0.0)
    own, *others = _of_blades(rod, rotor, count)
    beam = _of_beam(rod, rotor, count)
    changes = {name: each / own - 1 for name, each in zip(WITHOUT, others, strict=True)}
    status = rotor.status(jnp.zeros(()))
    held = nan_unless(status == Status.OK, (own, changes, beam / own - 1))
    return finish(Reduction(held[0], **held[1], beam=held[2], status=status), throw)


@Program
def _of_blades(model: SpatialRod, rotor: Rotor, count: int) -> Float[Array, "v k"]:
    """Frequencies of the blade, and of each simplified blade of `WITHOUT`."""
    _, rotor, _ = guarded(rotor, jnp.zeros(()))
    blade: Any = rotor.beam
    every = [blade, *(without(blade) for without in WITHOUT.values())]
    _, rest = eqx.partition(blade, eqx.is_array)
    each = [eqx.filter(blade, eqx.is_array) for blade in every]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)

    def lowest(numbers: Any) -> Float[Array, " k"]:
        return _lowest(model, dataclasses.replace(rotor, beam=eqx.combine(numbers, rest)), count)

    found: Any = jax.lax.map(lowest, stacked)
    return found


@Program
def _of_beam(model: SpatialRod, rotor: Rotor, count: int) -> Float[Array, " k"]:
    _, rotor, _ = guarded(rotor, jnp.zeros(()))
    return _lowest(model, dataclasses.replace(rotor, beam=rotor.beam.beam()), count)


def _lowest(model: SpatialRod, rotor: Rotor, count: int) -> Float[Array, " k"]:
    """The lowest frequencies of a blade at rest, about the undeformed rod."""
    equations = model.suited(rotor).equations(rotor)
    elastic = equations.damping_matrix_about(
        equations.rest, Drag(stiffness_coefficient=jnp.ones(()))
    )
    _, squares = modes_and_squares(equations.mass, elastic)
    return jnp.sqrt(squares[:count])
