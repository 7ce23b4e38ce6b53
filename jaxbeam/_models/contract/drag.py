"""Damping as the equations of one beam have it: ratios of modes and dampers as matrices."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._models.contract.equations import Equations
from jaxbeam._models.contract.labelling import assigned, participation, uncoupled
from jaxbeam._numerics.linalg import symmetric_modes
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._results import without_derivatives
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.damping import Damping
from jaxbeam._rotor.directions import coupling_groups, loose_motions
from jaxbeam._types import Matrix, Vector


def drag_of(damping: Damping, model: AbstractModel, rotor: AnyRotor, equations: Equations) -> Drag:
    """The `Drag` of a damping for the equations of a model and rotor; all in range."""
    matrix = _modal(damping, model, rotor) if damping.ratios else None
    dampers, slopes = damping.dampers, equations.root_slopes()
    if slopes is not None:
        for damper, slope in zip(dampers, slopes, strict=True):
            if damper is not None:
                own = damper * slope[:, None] * slope[None]
                matrix = own if matrix is None else matrix + own
    there = slopes is None and any(damper is not None for damper in dampers)
    return Drag(
        damping.mass_coefficient, damping.stiffness_coefficient, dampers if there else None, matrix,
        damping.section_coefficients,
        damping.root_dampers, damping.tip_dampers,
    )  # fmt: skip


def _modal(damping: Damping, model: AbstractModel, rotor: AnyRotor) -> Matrix:
    """The matrix C = M Phi diag(2 zeta w) Phi^T M of `Damping`, by modes at the `ratio_speed`
    without Coriolis forces, direction by direction unless turned sections couple these."""
    speed = damping.ratio_speed
    system = model.matrices(rotor, jnp.zeros(()) if speed is None else speed)
    out = jnp.zeros_like(system.mass)
    # Together those directions that are coupled by stiffness or mass.
    groups = coupling_groups(rotor)
    every = [way for first, second in groups for way in (first, *((way,) for way in second))]
    for directions in every:
        part = system.part(*directions)
        ratios = [damping.ratios.get(direction) for direction in part.directions]
        if all(ratio is None for ratio in ratios):
            continue
        m, k = symmetric_part(part.mass), symmetric_part(part.stiffness)
        free = loose_motions(rotor)
        found = without_derivatives(symmetric_modes(*without_derivatives((m, k)), free))
        phi, square = _pairs(m, k, found, jnp.sum(found * (found @ k), 1))
        each = zip(ratios, part.sizes, strict=True)
        ratio = jnp.concatenate([_by_number(ratio, size) for ratio, size in each])
        if len(part.sizes) > 1:
            ratio = ratio[assigned(participation(phi, uncoupled(part, free, bent=False)))]
        moves = square > 0
        omega = jnp.where(moves, jnp.sqrt(jnp.where(moves, square, 1.0)), 0.0)
        # A mode that diverges has no frequency, and its ratio no meaning: NaN makes the case fail.
        rounding = 64 * jnp.finfo(m.dtype).eps * jnp.sum(jnp.abs(phi) * (jnp.abs(phi) @ abs(k)), 1)
        lost = (square < -rounding) & (ratio > 0)
        rate = jnp.where(lost, jnp.nan, 2 * ratio * omega)
        heavy = phi @ m
        out = out.at[np.ix_(part.rows, part.rows)].add(heavy.T @ (rate[:, None] * heavy))
    return out


@jax.custom_jvp
def _pairs(m: Matrix, k: Matrix, phi: Matrix, square: Vector) -> tuple[Matrix, Vector]:
    """The given modes as rows, with phi M phi^T = 1, and squares of frequencies, with derivatives
    by M and K to any order, except where two are equal."""
    return phi, square


@_pairs.defjvp
def _pairs_jvp(primals: Any, tangents: Any) -> tuple[tuple[Matrix, Vector], tuple[Matrix, Vector]]:
    phi, square = _pairs(*primals)
    heavier, stiffer = (phi @ change @ phi.T for change in tangents[:2])
    apart = square[:, None] - square[None]
    same = apart == 0
    mixing = (stiffer - square[:, None] * heavier) / jnp.where(same, 1.0, apart)
    mixing = jnp.where(same, 0.0, mixing) - jnp.diag(jnp.diag(heavier)) / 2
    return (phi, square), (mixing @ phi, jnp.diag(stiffer) - square * jnp.diag(heavier))


def _by_number(ratio: Array | None, size: int) -> Float[Array, " k"]:
    """Damping ratios of the modes of a direction, `size` of them: the last one given is that of all
    higher modes."""
    if ratio is None:
        return jnp.zeros(size)
    given = jnp.atleast_1d(ratio)
    return given[np.minimum(np.arange(size), given.size - 1)]
