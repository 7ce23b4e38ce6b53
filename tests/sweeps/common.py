"""What tests of sweeps share: cases, functions that other processes can import, and equality."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxbeam as jb

BEAM = jb.Beam.from_slenderness(70.0)
CASES = jb.grid(hub_radius=np.linspace(0.0, 2.0, 7), tip_mass=[0.0, 0.3, float("nan"), -1.0, 1.0])
MANY = jb.grid(hub_radius=np.linspace(0.0, 1.0, 40), tip_mass=np.linspace(0.0, 1.0, 25))
WHICH = jb.labels(in_plane=2)
SMALL = jb.Hybrid(2, 3, 0)


def found_modes(hub_radius, tip_mass):
    return jb.modes(SMALL, jb.Rotor(BEAM, hub_radius, tip_mass), 3.0, WHICH, throw=False)


def raising(hub_radius, tip_mass):
    return jb.modes(SMALL, jb.Rotor(BEAM, hub_radius, tip_mass), 3.0, WHICH).frequency


def spin(hub_radius, tip_mass):
    rotor = jb.Rotor(BEAM, hub_radius, tip_mass)
    return jb.Hybrid(0, 2, 0).linearise(rotor, 3.0, throw=False)


@jax.custom_vjp
def scaled_backwards(factors, a):
    return a


scaled_backwards.defvjp(lambda f, a: (a, f), lambda f, g: (jnp.zeros_like(f), (f * g).sum()))
# Functions of constants and a number, by where in their programs the constants stand.
READERS = {
    "itself": lambda c, a: (c * a).sum(),
    "a loop": lambda c, a: jax.lax.scan(lambda s, x: (s * (x + c).sum(), None), a, c)[0],
    "a branch": lambda c, a: jax.lax.cond(a > 0, lambda a: (c * a).sum(), lambda a: a, a),
    "a program": lambda c, a: jax.jit(lambda a: (c * a).sum())(a),
    "a derivative": lambda c, a: jax.grad(lambda a: scaled_backwards(c, a))(a),
    "its end": lambda c, a: c,
}


def assert_same(one: jb.Table, other: jb.Table) -> None:
    """To the last bit, NaN among them."""
    assert one.values.keys() == other.values.keys()
    for name in one.values:
        assert one[name].tobytes() == other[name].tobytes(), name
    assert one.errors == other.errors
    assert one.dims == other.dims
