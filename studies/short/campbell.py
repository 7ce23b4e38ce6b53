"""Campbell diagram of a blade: at which speeds do its frequencies meet multiples of the speed?"""

import jax

jax.config.update("jax_enable_x64", True)

import matplotlib.pyplot as plt
import numpy as np

import jaxbeam as jb
from jaxbeam import plot

blade = jb.Beam.from_section(
    length=8.0, youngs_modulus=6.895e10, density=2767.0, area=7.299e-5,
    in_plane_second_moment=8.214e-9, flap_second_moment=4.1e-9,
)  # fmt: skip
rotor = jb.Rotor(blade, hub_radius=0.5, tip_mass=0.1)
which = jb.labels(in_plane=2, flap=2)

diagram = jb.campbell(jb.Hybrid(), rotor, np.linspace(0.0, 12.0, 61), which)
for crossing in diagram.crossings(harmonics=(1, 2, 3, 4)):
    print(f"{crossing.label} meets {crossing.harmonic:g} per turn at {crossing.angular_speed:.4f}")

figure, ax = plt.subplots(layout="constrained")
plot.campbell(diagram, ax, harmonics=(1, 2, 3, 4))
ax.set(xlabel="angular speed (rad/s)", ylabel="frequency (rad/s)")
ax.legend()
figure.savefig("campbell.png")
