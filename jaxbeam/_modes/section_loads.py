"""Force and moment in sections in modes of small motion about a steady state."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._models.contract.loaded import Conditions, equations_under, resting
from jaxbeam._models.contract.section_loads import Environment, Moved, section_loads
from jaxbeam._programs.program import Program
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.damping import NO_DAMPING
from jaxbeam._rotor.loads import NO_LOADS
from jaxbeam._types import Coordinates, Scalar, Vector, Vectors


@Program
def modal_loads(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, conditions: Conditions | None,
    eigenvalue: Complex[Array, " k"], shape: Vectors, xi: tuple[float, ...],
) -> tuple[Complex[Array, "k p 3"], Complex[Array, "k p 3"]]:  # fmt: skip
    """Force and moment in sections less those of the steady state, in axes that turn with sections,
    as factors of e^(lambda t) like the shapes (k, n).

    They are the derivative of `section_loads` by coordinates, rates and accelerations: the inertia
    of the mode, and the steady loads, tension above all, on the beam that the mode bends.
    """
    unloaded = conditions is None
    conditions = Conditions(NO_LOADS, NO_DAMPING) if conditions is None else conditions
    equations = equations_under(model, rotor, conditions.loads)
    inputs = conditions.inputs(equations, speed)
    # In linear theories the tension acts on the undeformed beam.
    q = equations.rest if unloaded and model.is_linear else resting(rotor, equations, inputs).q
    drag = Drag(conditions.damping.mass_coefficient)
    environment = Environment(inputs[0], conditions.loads, jnp.zeros_like(speed), drag)

    def loads(q: Coordinates, v: Vector, a: Vector) -> tuple[Array, Array]:
        return section_loads(rotor, equations, environment, Moved(q, v, a), np.array(xi))

    def change(*motion: Vector) -> tuple[Array, Array]:
        moved, *rates = (equations.rates(q, each) for each in motion)
        rates = [equations.as_velocities(q, rate) for rate in rates]
        return jax.jvp(loads, (q, *(0 * rate for rate in rates)), (moved, *rates))[1]

    rates = eigenvalue[:, None]
    moved = shape + 0 * rates, rates * shape, rates**2 * shape
    parts = (jnp.stack([a.real, a.imag]) for a in moved)
    force, moment = jax.vmap(jax.vmap(change))(*parts)
    return jax.lax.complex(*force), jax.lax.complex(*moment)
