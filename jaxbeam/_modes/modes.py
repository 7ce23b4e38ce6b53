"""Frequencies, growth rates and mode shapes about steady rotation, labelled and differentiable."""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.contract.loaded import (
    Conditions,
    checked_conditions,
    guarded_conditions,
    system_of,
)
from jaxbeam._modes.banded import bands_of
from jaxbeam._modes.dense import coupled_with, energy_share
from jaxbeam._modes.result import Modes
from jaxbeam._modes.search import in_quadrature, mixed, search
from jaxbeam._modes.wanted import Wanted, choose
from jaxbeam._numerics.linalg import quotient, solve
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, nan_unless, without_derivatives
from jaxbeam._rotor.beam import AnyRotor, Rotor
from jaxbeam._rotor.damping import NO_DAMPING, Damping
from jaxbeam._rotor.directions import Direction, Label, loose_motions
from jaxbeam._rotor.loads import NO_LOADS, Loads
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Real, Scalar


def modes(
    model: AbstractModel,
    rotor: Rotor,
    angular_speed: Real,
    which: int | Sequence[Label] | None = None,
    *,
    loads: Loads = NO_LOADS,
    damping: Damping = NO_DAMPING,
    throw: bool = True,
) -> Modes:
    """Modes of small vibration about steady rotation at `angular_speed` (rad/s, either sign).

    `model` is a theory such as `Hybrid()`, and `rotor` a `Rotor` (a `SpringRotor` for the discrete
    ones). `which` is how many, lowest first (growing ones before all), six by default, or the
    labels wanted, in that order (see `labels`).

    With `loads` they are about the state that these deform: gravity, which has to be along the axis
    where the beam turns, a force along the span, and force and moment at the tip, constant in the
    hub or following (see `Loads`); with `damping`, of which `Modes.damping_ratio` tells. Anything
    may be coupled then, growing modes are found whatever the cause, and there is no
    `frequency_error`. Models that are linear know only the force along the beam.

    Real symmetric computations while the stiffness is positive definite, the general eigenproblem
    with growth rates where it is not. In a batch of 4096 cases or more, by one `jax.vmap` or
    several, models that have `bands` are some ten times faster a case in 64 bits, and compile for
    longer; on a GPU, which is slow with dense ones, in any batch.

    Eigenvalues and shapes are differentiable with respect to every parameter and the speed, in
    both modes and to any order, wherever the eigenvalue is simple among modes that are coupled;
    crossings of flap with in-plane modes are harmless. Where pitch or twist couple the two a label
    goes to the mode that has most of the uncoupled one in it, and `energy_share` says how mixed it
    is. First derivatives of eigenvalues need no derivatives of shapes:
    d lambda = -y^T (lambda^2 dM + lambda dG + dK) x / y^T (2 lambda M + G) x.

    `throw=False` returns failures as `Modes.status` instead of raising: use it in sweeps. The
    numbers of a case that failed are NaN, and so are their derivatives in forward mode; in reverse
    mode they are zero, lest they spoil gradients by parameters that cases of a batch share.

    Raises `ValueError` or `TypeError` for a malformed argument, and, with `throw`, `ValueError` for
    a parameter out of range (under `jit` `RuntimeError`) and `RuntimeError` where the case fails:
    no steady state exists or is found, or modes are not resolved (`Status`).
    """
    model, rotor, speed = checked_case(model, rotor, angular_speed)
    conditions = checked_conditions(loads, damping, (model, rotor), (speed,), throw)
    result = find(model, rotor, speed, choose(model, which), conditions=conditions)
    asked = {"rotor": rotor, "angular_speed": speed, "conditions": conditions}
    return dataclasses.replace(finish(result, throw), **asked)


@Program
def find(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, wanted: Wanted, judged: bool = True,
    conditions: Conditions | None = None,
) -> Modes:  # fmt: skip
    """The modes of `modes` after its arguments have been checked; unless `judged` without a look
    at whether the model has enough functions for them."""
    return found_about(model, rotor, speed, wanted, judged, conditions)[0]


def found_about(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, wanted: Wanted, judged: bool,
    conditions: Conditions | None,
) -> tuple[Modes, LinearSystem]:  # fmt: skip
    """The modes of `find`, and the matrices of small motion that they belong to."""
    unloaded = conditions is None
    given, rotor, speed, conditions = guarded_conditions(model, rotor, speed, conditions)
    # In single precision dense matrices are used, since they estimate errors by rounding.
    banded = unloaded and rotor.is_plain and jnp.finfo(speed.dtype).bits > 32
    bands = bands_of(model, wanted.most, wanted.count) if banded else None
    system = system_of(model, rotor, speed, conditions)
    is_judged = judged and (unloaded or system.lacking is not None)
    fixed = without_derivatives((system, (rotor, speed, wanted)))
    found, extra = search(model, bands, *fixed, loose_motions(rotor), is_judged)
    status, error = first_failure(given, found.status), found.frequency_error
    if error is not None and model.judged(rotor):
        error = jnp.where(status == Status.OK, error, jnp.nan)
        resolved = jnp.max(error) <= model.most_error(rotor, speed)
        status = first_failure(status, first_broken((resolved, Status.TOO_FEW_FUNCTIONS)))
    ok = status == Status.OK
    eigenvalue, shape = _differentiable(system, ok, found)
    if bands is not None:
        if bands.has_forms:
            eigenvalue = _eigenvalue(bands.forms, rotor, speed, eigenvalue, shape, (extra, ok))
    elif extra is not None:
        eigenvalue = _eigenvalue(model.forms, rotor, speed, eigenvalue, shape, extra)
    share = _valued(found.energy_share, energy_share(system.mass, shape, system.directions))
    result = Modes(
        eigenvalue=nan_unless(ok, eigenvalue),
        shape=nan_unless(ok, shape),
        direction=found.direction,
        number=found.number,
        energy_share=nan_unless(ok, share),
        residual=found.residual,
        status=status,
        steady_strain=nan_unless(ok, _valued(found.steady_strain, system.steady_strain)),
        frequency_error=error,
        model=model,
    )
    return result, system


def _differentiable(system: LinearSystem, ok: Array, found: Modes) -> tuple[Array, Array]:
    """Eigenvalues and shapes, with derivatives by all parameters that the matrices depend on."""
    dtype = system.mass.dtype
    kinds = np.array(system.directions)
    if system.general:
        inside = coupled_with(system, found.direction).astype(dtype)
        return _pairs(system, ok, found, inside, None)
    signature = np.where(in_quadrature(system.coupling)[kinds], -1.0, 1.0)
    signature = np.where(mixed(system.coupling)[kinds], 0.0, signature)
    in_group = np.array(
        [[f in first + second for f in Direction] for first, second in system.coupling]
    )
    group = np.argmax(in_group, 0)
    inside = (group[kinds][None] == jnp.asarray(group)[found.direction][:, None]).astype(dtype)
    return _pairs(system, ok, found, inside, jnp.asarray(signature, dtype))


def _pairs(
    system: LinearSystem, ok: Array, found: Modes, inside: Array, signature: Array | None
) -> tuple[Array, Array]:
    dtype = system.mass.dtype
    # In a case that failed, a regular problem takes the place of its own, so that no NaN comes into
    # gradients of other cases by parameters that they share.
    identity = jnp.eye(len(system.directions), dtype=dtype)
    matrices = (system.mass, system.by_rates, system.stiffness)
    instead = (identity, 0 * identity, 2 * identity)
    return _eigenpairs(
        *(jnp.where(ok, a, b) for a, b in zip(matrices, instead, strict=True)),
        jnp.where(ok, found.eigenvalue, 1j),
        jnp.where(ok, found.shape, identity[jnp.argmax(inside, axis=1)]),
        inside,
        signature,
        system.conservative and system.damping is None,
    )


@jax.custom_jvp
def _valued(value: Array, formula: Array) -> Array:
    """The given value, with the derivatives of a formula for it."""
    return value


@_valued.defjvp
def _valued_jvp(primals: tuple[Any, Any], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    return _valued(*primals), tangents[1]


_Forms = Callable[[Rotor, Scalar, Array, Any], tuple[Array, Array, Array]]


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _eigenvalue(
    forms: _Forms, rotor: Rotor, speed: Scalar, eigenvalue: Array, shape: Array, extra: Any
) -> Array:
    """The given eigenvalues, with derivatives by rotor and speed,

        d lambda = -(lambda^2 dm + lambda dg + dk) / (2 lambda m + g),

    where m = x^T S M x, g and k are the forms, and `extra` is a further argument of these, from
    `search`. Derivatives of the shapes x matter to second derivatives alone.
    """
    return eigenvalue


@_eigenvalue.defjvp
def _eigenvalue_jvp(forms: _Forms, primals: Any, tangents: Any) -> tuple[Array, Array]:
    rotor, speed, _, shape, extra = primals
    # The function itself is called here, so that this rule can be differentiated again.
    lam = _eigenvalue(forms, *primals)

    def of_shape(rotor: Rotor, speed: Scalar) -> Any:
        return forms(rotor, speed, shape, extra)

    (m, g, _), (dm, dg, dk) = jax.jvp(of_shape, (rotor, speed), tangents[:2])
    change, slope = lam**2 * dm + lam * dg + dk, 2 * lam * m + g
    return lam, -jax.vmap(quotient)(change, slope)  # 0 / 0 at an eigenvalue zero of a free hinge


@functools.partial(jax.custom_jvp, nondiff_argnums=(7,))
def _eigenpairs(
    mass: Array,
    gyroscopic: Array,
    stiffness: Array,
    eigenvalue: Array,
    shape: Array,
    inside: Array,
    signature: Array | None,
    conservative: bool,
) -> tuple[Array, Array]:
    """The given eigenvalues and shapes, with derivatives by the three matrices.

    Left eigenvectors are y = S x, S = diag(`signature`), where M and K are symmetric and G is skew
    and couples only coordinates of opposite signature. Where G may couple any coordinates, the
    signature is zero, and left eigenvectors of stable modes are the conjugates of x. Without a
    `signature` they are these if the system is `conservative` and no mode grows, and are else
    computed from the transposed matrix.
    """
    return eigenvalue, shape


@_eigenpairs.defjvp
def _eigenpairs_jvp(
    conservative: bool, primals: tuple[Any, ...], tangents: tuple[Any, ...]
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    m, g, k, _, _, inside, signature = primals
    dm, dg, dk = tangents[:3]
    # The function itself is called here, so that this rule can be differentiated again.
    eigenvalue, shape = _eigenpairs(*primals, conservative)

    like = shape.conj()
    if signature is not None:
        like = jnp.where((signature == 0)[None], like, signature[None] * shape)

    def bordered(lam: Array, x: Array, group: Array, like: Array) -> tuple[Array, Array]:
        # [Q, Q'x; (S M x)^T, 0] [dx; dlam] = [-dQ x; -x^T S dM x / 2], Q = lam^2 M + lam G + K,
        # regular for a simple eigenvalue. Rows of other groups are replaced by dx = 0, since
        # there Q may be singular: flap and in-plane frequencies of a square section coincide.
        within = group[:, None] * group[None]
        q = jnp.where(within > 0, lam**2 * m + lam * g + k, jnp.diag(1 - group))
        slope = 2 * lam * (m @ x) + g @ x
        # At lambda = 0, where d lambda may be infinite, the border is that for d lambda^2.
        border = jnp.where(lam == 0, m @ x + 0j, slope)
        return jnp.block([[q, border[:, None]], [(like @ m)[None], jnp.zeros((1, 1))]]), slope

    def left_vector(lam: Array, x: Array, group: Array, like: Array) -> Array:
        unit = jnp.zeros(len(x) + 1, x.dtype).at[-1].set(1.0)
        return solve(bordered(lam, x, group, like)[0].T, unit)[:-1]

    def derivatives(
        lam: Array, x: Array, group: Array, like: Array, left: Array
    ) -> tuple[Array, Array]:
        force = lam**2 * (dm @ x) + lam * (dg @ x) + dk @ x
        matrix, slope = bordered(lam, x, group, like)
        right = jnp.concatenate([-force * group, -0.5 * (like @ (dm @ x))[None]])
        return -quotient(left @ force, left @ slope), solve(matrix, right)[:-1]

    each = (eigenvalue, shape, inside, like)
    left = like
    if signature is None:
        stable = conservative & jnp.all(eigenvalue.real == 0)
        left = jax.lax.cond(stable, lambda *_: like, jax.vmap(left_vector), *each)
    return (eigenvalue, shape), jax.vmap(derivatives)(*each, left)
