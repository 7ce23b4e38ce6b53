"""A check whether a model has enough functions, for results without estimates of frequencies."""

import jax.numpy as jnp
from jaxtyping import Array, Inexact

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._results import without_derivatives
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.motion import spinning
from jaxbeam._status import Status, first_broken
from jaxbeam._types import Code

# Relative error of the elastic energy of a shape that is allowed: 0.1 of a frequency.
MOST_LEFT_OUT = 0.2
_ROUNDING = 1e-12  # relative error of terms of a sum by rounding


def status_of_shape(model: AbstractModel, rotor: AnyRotor, shape: Inexact[Array, " n"]) -> Code:
    """`TOO_FEW_FUNCTIONS` where x^H L x > 0.2 x^H K x for a shape x: the stiffness K of the beam at
    rest is too small by L (`Equations.lacking_about`), a fifth of it; OK for models without L."""
    model_of, shape = without_derivatives((model.equations(rotor), shape))
    lacking = model_of.lacking_about(model_of.rest)
    if lacking is None:
        return jnp.asarray(int(Status.OK))
    still = spinning(jnp.zeros((), lacking.dtype))
    stiffness = symmetric_part(model_of.matrices_about(still, model_of.rest)[2])
    more, energy = (jnp.sum(shape.conj() * (a @ shape)).real for a in (lacking, stiffness))
    size = jnp.abs(shape)
    rough = _ROUNDING * size @ jnp.abs(lacking) @ size  # rigid motion has no more energy than this
    fine = jnp.abs(more) <= MOST_LEFT_OUT * jnp.abs(energy) + rough
    return first_broken((fine | ~jnp.all(jnp.isfinite(shape)), Status.TOO_FEW_FUNCTIONS))
