"""The search for modes, case by case or of many cases together, without derivatives."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Inexact

from jaxbeam._models.bases.loads import Mixes
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.modal.cartesian_model import CartesianModel
from jaxbeam._modes.banded import Bands, Lowest
from jaxbeam._modes.dense import TOLERANCE, dense_modes
from jaxbeam._modes.result import Modes, own_tip
from jaxbeam._modes.wanted import Wanted
from jaxbeam._programs.batches import batchable, in_rows, mended, reaches
from jaxbeam._programs.platforms import by_platform
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.directions import CouplingGroup, Direction
from jaxbeam._status import Status
from jaxbeam._types import Scalar, Vector

# Cases of a batch from which on the search by bands is compiled for a CPU. That takes some 10 s
# longer, which is gained back after 11,000 cases of elements and 29,000 of polynomials
# (`studies/costs.py`), a few such batches.
MANY = 4096
_ROW = 16  # cases of beams that vary whose integrals fit into the cache of a CPU
_Query = tuple[AnyRotor, Scalar, Wanted]  # a rotor, its speed, and the modes wanted
_Found = tuple[Modes, Vector | None]  # modes, and the steady state of elements


def search(
    model: AbstractModel, bands: Bands | None, system: LinearSystem, case: _Query, free: int,
    judged: bool,
) -> tuple[Modes, Mixes | Vector | None]:  # fmt: skip
    """The modes wanted, with signs for which tips move the positive way, and, if `judged`, with
    estimates of their errors. Besides them, for derivatives by `forms`: the combinations that
    functions are made of (of beams that vary), the steady state (of elements), or None.

    By dense matrices, which compile quickly; with `bands` large batches are searched by bands, and
    by dense matrices where that is not certain.
    """
    if bands is not None:
        found, state = _by_bands(model, bands, system, case)
        shape, error = found.shape * _sign(model, case[0], system, found)[:, None], None
        if judged:
            error = model.frequency_error(system, *case[:2], found.eigenvalue, shape)
        return dataclasses.replace(found, shape=shape, frequency_error=error), state
    leaves, tree = jax.tree.flatten((system, case))

    def complete(system: LinearSystem, case: _Query) -> tuple[Modes, Mixes | None]:
        rotor, speed, wanted = case
        found = dense_modes(system, wanted, _loose(rotor) if free else None, free)
        shape = found.shape * _sign(model, rotor, system, found)[:, None]
        error = None
        if judged:
            error = model.frequency_error(system, rotor, speed, found.eigenvalue, shape)
        found = dataclasses.replace(found, shape=shape, frequency_error=error)
        return found, model.mixes(system, rotor) if judged else None

    def with_matrices(leaves: list[Array]) -> tuple[Modes, Mixes | None]:
        return complete(*jax.tree.unflatten(tree, leaves))

    def from_case(leaves: list[Array]) -> tuple[Modes, Mixes | None]:
        _, case = jax.tree.unflatten(tree, leaves)
        # Matrices are computed here again, so that XLA need not compute those of all cases.
        return complete(model.matrices(case[0], case[1]), case)

    def many(size: int, per_case: tuple[bool, ...], leaves: list[Array]) -> Any:
        def rows(leaves: list[Array]) -> Any:
            return in_rows(from_case, size, _ROW, per_case, leaves)

        at_once = jax.vmap(with_matrices, ([0 if varies else None for varies in per_case],))
        cpu = rows if reaches(size, _ROW + 1) else at_once
        return by_platform(leaves, cpu=cpu, default=at_once)

    rotor = case[0]
    if judged and rotor.varies and isinstance(model, CartesianModel):
        return batchable(with_matrices, many)(leaves)
    return with_matrices(leaves)


def _loose(rotor: AnyRotor) -> Bool[Array, " 4"]:
    """Whether the root has a free hinge, with a spring of no stiffness, by direction."""
    if rotor.root_support is not None:
        hinges = [spring == 0 for spring in rotor.root_support.springs if spring is not None]
        return jnp.broadcast_to(jnp.any(jnp.stack(hinges)), 4)
    in_plane, flap = (jnp.asarray(spring is not None and spring == 0) for spring in rotor.springs)
    no = jnp.zeros((), bool)
    return jnp.stack([no, in_plane, flap, no])


def _by_bands(model: AbstractModel, bands: Bands, system: LinearSystem, case: _Query) -> _Found:
    leaves, tree = jax.tree.flatten((system, case))

    def dense(leaves: list[Array]) -> _Found:
        system, (_, _, wanted) = jax.tree.unflatten(tree, leaves)
        return dense_modes(system, wanted), system.state

    def quick(leaves: list[Array]) -> tuple[_Found, Array]:
        _, (rotor, speed, wanted) = jax.tree.unflatten(tree, leaves)
        named = wanted.named and tuple(a.astype(speed.dtype) for a in wanted.named)
        found = bands.lowest(rotor, speed, named)
        return (_as_found(model, found), found.state), is_certain(found)

    def many(size: int, per_case: tuple[bool, ...], leaves: list[Array]) -> _Found:
        axes = [0 if varies else None for varies in per_case]

        def by_bands(leaves: list[Array]) -> _Found:
            def again(which: Array) -> _Found:
                one_case = [
                    a[which] if varies else a for a, varies in zip(leaves, per_case, strict=True)
                ]
                _, (rotor, speed, wanted) = jax.tree.unflatten(tree, one_case)
                # Matrices are computed here again, so that XLA need not compute those of all cases.
                system = model.matrices(rotor, speed)
                return dense_modes(system, wanted), system.state

            return mended(*jax.vmap(quick, (axes,))(leaves), again)

        if reaches(size, MANY):
            return by_bands(leaves)
        # On a GPU one dense case after the other takes much longer than bands take for all.
        return by_platform(leaves, cpu=jax.vmap(dense, (axes,)), default=by_bands)

    return batchable(dense, many)(leaves)


def is_certain(found: Lowest) -> Array:
    """Whether all modes of a search by bands are certain, accurate and finite."""
    entries = found.entries
    small = TOLERANCE * jnp.finfo(entries.residual.dtype).eps
    numbers = jnp.isfinite(entries.omega) & jnp.all(jnp.isfinite(entries.x), 1)
    return jnp.all((entries.certain > 0) & (entries.residual <= small) & numbers)


def _as_found(model: AbstractModel, found: Lowest) -> Modes:
    omega, x, direction, number, along, residual, _ = found.entries
    axial = np.array([direction == Direction.AXIAL for direction in model.directions])
    shape = jax.lax.complex(jnp.where(axial, 0.0, x), jnp.where(axial, -x, 0.0))
    flap = jnp.where(direction == Direction.FLAP, 1.0, 0.0)
    share = {
        Direction.AXIAL: along,
        Direction.IN_PLANE: 1 - flap - along,
        Direction.FLAP: flap,
        Direction.TORSION: 0 * flap,
    }
    return Modes(
        eigenvalue=jax.lax.complex(0 * omega, omega),
        shape=shape,
        direction=direction.astype(int),
        number=number.astype(int),
        energy_share=jnp.stack([share[direction] for direction in Direction], -1),
        residual=residual,
        status=jnp.asarray(Status.OK).astype(int),
        steady_strain=found.strain,
    )


def in_quadrature(coupling: tuple[CouplingGroup, ...]) -> Bool[np.ndarray, " f"]:
    """Whether each direction moves in quadrature to others that it is coupled with."""
    return np.array(
        [any(f in second and f not in first for first, second in coupling) for f in Direction]
    )


def mixed(coupling: tuple[CouplingGroup, ...]) -> Bool[np.ndarray, " f"]:
    """Whether each direction may be coupled with others in any phase."""
    return np.array(
        [any(f in first and f in second for first, second in coupling) for f in Direction]
    )


def _sign(
    model: AbstractModel, rotor: AnyRotor, system: LinearSystem, found: Modes
) -> Inexact[Array, " k"]:
    """Factors of modes, signs or phases, for which the tip moves the positive way in the direction
    of the mode's label."""
    shape, direction = found.shape, found.direction
    tip = own_tip(model, rotor, shape, direction, system.shapes)
    # Parts of stable modes in quadrature are imaginary: x = (w, -i u).
    real = jnp.where(jnp.asarray(in_quadrature(system.coupling))[direction], -tip.imag, tip.real)
    sign = jnp.where(real < 0, -1.0, 1.0)
    if mixed(system.coupling).any():  # modes of any phase get that for which the tip is real
        moving = jnp.where(tip == 0, 1.0, tip)
        sign = jnp.where(
            jnp.asarray(mixed(system.coupling))[direction], jnp.abs(moving) / moving, sign
        )
    return jax.lax.stop_gradient(sign)
