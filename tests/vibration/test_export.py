"""Programs for batches of any size, by `jax.export`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export

import jaxbeam as jb

BEAM = jb.Beam.from_slenderness(70.0)
TAPERED = jb.Beam(1.0, jb.Spanwise([0, 1], [1.0, 0.5]), 4900.0, jb.Spanwise([0, 1], [1.0, 0.5]), 1)
CASES = {
    "bands": (jb.PlanarRod(3), BEAM),
    "dense": (jb.Hybrid(2, 4, 0), BEAM),
    "rows": (jb.Hybrid(0, 3, 3), TAPERED),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
def test_modes_of_batches_of_any_size(name):
    """One program for a few cases and for many, which find what programs of their own do."""
    model, beam = CASES[name]

    @jax.jit
    @jax.vmap
    def found(hub_radius):
        return jb.modes(model, jb.Rotor(beam, hub_radius), 3.0, 2, throw=False).frequency

    any_size = jax.ShapeDtypeStruct(export.symbolic_shape("b"), float)
    program = export.export(found)(any_size)
    for size in (1, 40):
        hub_radius = jnp.linspace(0.0, 1.0, size)
        np.testing.assert_allclose(program.call(hub_radius), found(hub_radius), rtol=1e-12)
