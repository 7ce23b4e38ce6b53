"""A table of frequencies over speed, hub radius and tip mass: as CSV, and for xarray."""

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np

import jaxbeam as jb

blade = jb.Beam.from_section(
    length=8.0, youngs_modulus=6.895e10, density=2767.0, area=7.299e-5,
    in_plane_second_moment=8.214e-9,
)  # fmt: skip
model, which = jb.Hybrid(), jb.labels(in_plane=2, flap=1)


def case(angular_speed, hub_radius, tip_mass):
    rotor = jb.Rotor(blade, hub_radius, tip_mass)
    found = jb.modes(model, rotor, angular_speed, which, throw=False)
    return {"frequency": found.frequency, "status": found.status}


cases = jb.grid(
    angular_speed=np.linspace(0.0, 12.0, 13), hub_radius=[0.0, 0.5, 1.0],
    tip_mass=np.linspace(-0.1, 0.3, 5),  # the first of which cannot be
)  # fmt: skip
table = jb.sweep(case, cases, dims={"frequency": {"mode": [str(label) for label in which]}})
table.to_csv("frequencies.csv")

failed = table["status"] != jb.Status.OK
said = table.message(angular_speed=0.0, hub_radius=0.0, tip_mass=-0.1)
print(f"{failed.sum()} of {failed.size} cases failed; the first says: {said}")
print(table.sel(hub_radius=0.5, tip_mass=0.1, mode="flap bending 1")["frequency"])
try:
    print(table.to_xarray())
except ImportError:
    print("pip install xarray to see the table as a data set")
