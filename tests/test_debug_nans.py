"""Where all is well there is no NaN, not even one that is put in and masked: `jax_debug_nans`."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.tiers import exhaustive, slow

UNIFORM = jb.Beam(8.0, 0.2, 5e6, 566.0, 400.0)
VARYING = jb.Beam(
    8.0, jb.Spanwise([0, 1], [0.4, 0.1]), 5e6, 566.0, 400.0, twist=jb.Spanwise([0, 1], [0.2, 0.0])
)
SPINS = jb.SmoothSpinUp(2.0, 1.0)


def frequency(beam, model=jb.Hybrid(1, 2, 2)):  # noqa: B008
    return lambda r: jb.modes(model, jb.Rotor(beam, r, 0.1), 3.0, 2).frequency[0]


def hinged(r):
    rotor = jb.Rotor(UNIFORM, r, root_springs=jb.RootSprings(0.0, 0.0))
    return jb.modes(jb.Hybrid(0, 2, 2), rotor, 0.0, 3).frequency[2]


def tip(r, adjoint=None):
    times = jnp.linspace(0.0, 2.0, 3)
    run = jb.simulate(jb.Hybrid(0, 2, 0), jb.Rotor(UNIFORM, r), SPINS, times, adjoint=adjoint)
    return run.tip[-1, 1]


def forward_tip(r):
    return tip(r, diffrax.ForwardMode())


def southwell(r):
    return jb.southwell(jb.Hybrid(0, 2, 0), jb.Rotor(UNIFORM, r), 1.0, 1).coefficient[0]


@pytest.mark.parametrize(
    ("function", "derivative"),
    [
        exhaustive(frequency(UNIFORM), jax.grad, id="modes reverse"),
        slow(frequency(VARYING), jax.grad, id="varying reverse"),
        exhaustive(frequency(VARYING), jax.jacfwd, id="varying forward"),
        exhaustive(frequency(UNIFORM), lambda f: jax.jacfwd(jax.grad(f)), id="second"),
        exhaustive(frequency(UNIFORM, jb.PlanarRod(2)), jax.grad, id="elements"),
        exhaustive(hinged, jax.grad, id="hinged"),
        exhaustive(southwell, jax.grad, id="southwell"),
        exhaustive(tip, jax.grad, id="run reverse"),
        exhaustive(forward_tip, jax.jacfwd, id="run forward"),
    ],
)
def test_derivatives_of_what_is_well_make_no_nan(function, derivative):
    with jax.debug_nans(True):
        assert np.isfinite(derivative(function)(0.5))
