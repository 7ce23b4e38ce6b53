"""Errors of frequencies of a uniform beam by too few functions: what a finer set of them adds.

The functions of a model are the first of a finer model's. A mode x with eigenvalue l has there the
residual r = Q(l) x, Q(l) = l^2 M + l G + K, which is zero for the model's own functions. To second
order

    |d l| = r^H (K + W^2 M)^-1 r / |x^H (2 l M + G) x|,

with the speed W, where K + W^2 M, the stiffness of flap also in plane, stands for Q, since
functions that are left out vibrate far above the mode. All matrices are those of the finer model.
(`truncation.py`, for beams that vary, takes the compliance of bending alone for K^-1: too little
for a beam that tension holds.)
"""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.basis import Polynomials, Yielding
from jaxbeam._models.bases.layered import Finer, Layered, massless, more_functions
from jaxbeam._numerics.linalg import solve_columns
from jaxbeam._rotor.beam import Rotor
from jaxbeam._types import Scalar

# Polynomials more in each direction. A mode has its residual in the next four, which tension
# couples with others: by four more the estimate is 0.6 of the error at gamma = 100, by eight 0.92
# to 1.1 of it.
_MORE = 8


def _finer(model: Any) -> Any:
    """The model with more functions, its own being the first; None for bases without finer ones."""
    yields = isinstance(model.basis, Yielding)
    functions = model.basis.basis if yields else model.basis
    stretch, *bending = model.counts
    if isinstance(functions, Layered):
        functions, more = Finer(), more_functions()
    elif type(functions) is Polynomials:
        stretch, more = stretch + _MORE * (stretch > 0), _MORE
    else:
        return None
    lag, flap = (n + more * (n > 0) for n in bending)
    basis = dataclasses.replace(model.basis, basis=functions) if yields else functions
    return dataclasses.replace(model, n_stretch=stretch, n_in_plane=lag, n_flap=flap, basis=basis)


def frequency_error(
    model: Any, rotor: Rotor, speed: Scalar, eigenvalue: Array, shape: Array
) -> Float[Array, " k"] | None:
    """Estimated relative error of each eigenvalue, zero for zero ones; None where no finer
    functions are known. `shape` (k, n) are modes with unit modal mass."""
    finer = _finer(model)
    if finer is None:
        return None
    system = finer.matrices(rotor, speed)
    numbers = zip(finer.counts, model.counts, strict=True)
    within = np.concatenate([np.arange(many) < few for many, few in numbers])
    x = jnp.zeros((len(shape), within.size), shape.dtype).at[:, np.flatnonzero(within)].set(shape)
    lam = eigenvalue[:, None]
    mass, gyroscopic = x @ system.mass.T, x @ system.gyroscopic.T
    residual = lam**2 * mass + lam * gyroscopic + x @ system.stiffness.T
    residual = jnp.where(within[None], 0.0, residual)
    stiffness = system.stiffness + speed**2 * system.mass
    changes = solve_columns(stiffness, jnp.concatenate([residual.real, residual.imag]).T)
    real, imaginary = jnp.split(changes.T, 2)
    energy = jnp.sum(residual.real * real + residual.imag * imaginary, 1)
    slope = jnp.sum(x.conj() * (2 * lam * mass + gyroscopic), 1)
    # Less the share of the small mass that `massless` gives to coordinates of layers.
    small_mass = massless(model.basis, x.real.dtype) * (rotor.beam.mass + rotor.tip_mass)
    energy = energy - jnp.abs(eigenvalue) ** 2 * small_mass * jnp.sum(jnp.abs(shape) ** 2, 1)
    return relative(energy, jnp.abs(slope) * jnp.abs(eigenvalue))


def relative(change: Array, scale: Array) -> Array:
    """The relative error of an eigenvalue l, by the `change` of l^2 / 2 over `scale` = l^2, also
    where the change is most of it. Zero for zero ones."""
    positive = scale > 0
    error = jnp.abs(change) / jnp.where(positive, scale, 1.0)
    left = jnp.log1p(-jnp.minimum(2 * error, 1 - 1e-4))
    return jnp.where(positive, jnp.maximum(jnp.expm1(-left / 2), error), 0.0)
