"""What functions leave out of a frequency of a uniform beam: what a finer set of them adds.

The functions of a model are the first of a finer one's. With the residual r = Q(l) x of a mode x
among these, Q(l) = l^2 M + l G + K, which is zero for its own functions, to second order

    |d l| = r^H (K + W^2 M)^-1 r / |x^H (2 l M + G) x|,

W the speed, where K + W^2 M, which holds motion in plane as it does flap, stands for Q: what is
left out is far above the mode. It is made of the matrices of the model itself, whatever is in them.
(`truncation.py`, for beams that vary, takes the compliance of bending alone for K^-1, which of a
beam that tension holds says too little.)
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

# More polynomials each way. A mode leaves its residual in the next four, which tension
# couples with others: four more see 0.6 of the error at gamma = 100, eight 0.92 to 1.1 of it.
_MORE = 8


def _finer(model: Any) -> Any:
    """The model with more functions, of which its own are the first; None where there is none."""
    yields = isinstance(model.basis, Yielding)
    own = model.basis.basis if yields else model.basis
    stretch, *bends = model.counts
    if isinstance(own, Layered):
        own, more = Finer(), more_functions()
    elif type(own) is Polynomials:
        stretch, more = stretch + _MORE * (stretch > 0), _MORE
    else:
        return None
    lag, flap = (n + more * (n > 0) for n in bends)
    basis = dataclasses.replace(model.basis, basis=own) if yields else own
    return dataclasses.replace(model, n_stretch=stretch, n_in_plane=lag, n_flap=flap, basis=basis)


def frequency_error(
    model: Any, rotor: Rotor, speed: Scalar, eigenvalue: Array, shape: Array
) -> Float[Array, " k"] | None:
    """Estimate for each eigenvalue, relative; zero for zero ones; None where no functions are known
    to be finer. `shape` (k, n) are modes with unit modal mass."""
    finer = _finer(model)
    if finer is None:
        return None
    system = finer.matrices(rotor, speed)
    ways = zip(finer.counts, model.counts, strict=True)
    own = np.concatenate([np.arange(many) < few for many, few in ways])
    x = jnp.zeros((len(shape), own.size), shape.dtype).at[:, np.flatnonzero(own)].set(shape)
    lam = eigenvalue[:, None]
    mass, gyroscopic = x @ system.mass.T, x @ system.gyroscopic.T
    left = lam**2 * mass + lam * gyroscopic + x @ system.stiffness.T
    left = jnp.where(own[None], 0.0, left)
    holds = system.stiffness + speed**2 * system.mass
    both = solve_columns(holds, jnp.concatenate([left.real, left.imag]).T)
    real, imaginary = jnp.split(both.T, 2)
    energy = jnp.sum(left.real * real + left.imag * imaginary, 1)
    slope = jnp.sum(x.conj() * (2 * lam * mass + gyroscopic), 1)
    # Less what the mass that layers have been given, but have not, takes away.
    given = massless(model.basis, x.real.dtype) * (rotor.beam.mass + rotor.tip_mass)
    energy = energy - jnp.abs(eigenvalue) ** 2 * given * jnp.sum(jnp.abs(shape) ** 2, 1)
    return relative(energy, jnp.abs(slope) * jnp.abs(eigenvalue))


def relative(change: Array, scale: Array) -> Array:
    """The error of an eigenvalue l, relative to the right one, by the change of l^2 / 2 over that
    of `scale`, l^2: also where little is left of it. Zero for zero ones."""
    positive = scale > 0
    error = jnp.abs(change) / jnp.where(positive, scale, 1.0)
    left = jnp.log1p(-jnp.minimum(2 * error, 1 - 1e-4))
    return jnp.where(positive, jnp.maximum(jnp.expm1(-left / 2), error), 0.0)
