"""Parameters of a blade from measured frequencies, with intervals."""

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp

import jaxbeam as jb

model, which = jb.Hybrid(4, 8, 8), jb.labels(in_plane=2, flap=2)
speeds = [0.0, 3.0, 6.0]  # rad/s
measured = [  # rad/s, a row for each speed; NaN where nothing was seen
    [2.64, 16.56, 1.85, 11.73],
    [3.02, 18.22, 3.79, 14.25],
    [3.89, 22.43, jnp.nan, 19.93],
]


def experiment(bending, flap, tip_mass):
    blade = jb.Beam(8.0, 0.202, 5e6, bending, flap)
    rotor = jb.Rotor(blade, hub_radius=0.5, tip_mass=tip_mass)
    return jb.FrequencyData(model, rotor, speeds, measured, 0.03, which)


free = {
    "bending": jb.FreeParameter(500.0),
    "flap": jb.FreeParameter(400.0),
    "tip_mass": jb.FreeParameter(0.2),
}
found = jb.fit(experiment, free)
print(found)
for name, (low, high) in found.interval(0.95).items():
    print(f"{name}: {low:.4g} to {high:.4g}")
