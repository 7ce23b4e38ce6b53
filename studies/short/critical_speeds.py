"""Where steady rotation is stable: critical speeds over hub radius and tip mass."""

import jax

jax.config.update("jax_enable_x64", True)

import matplotlib.pyplot as plt
import numpy as np

import jaxbeam as jb

model = jb.papers.ChordANCF(2)  # Model 0 of Berzeri and Shabana, which fails above a speed


def critical(hub_radius, tip_mass):
    blade = jb.Beam.from_slenderness(70.0)
    found = jb.critical_speed(model, jb.Rotor(blade, hub_radius, tip_mass), throw=False)
    return {"angular_speed": found.angular_speed, "status": found.status}


hubs, tips = np.linspace(0.0, 2.0, 9), np.linspace(0.0, 1.0, 6)
table = jb.sweep(critical, jb.grid(hub_radius=hubs, tip_mass=tips))
table.to_csv("critical_speeds.csv")

figure, ax = plt.subplots(layout="constrained")
lines = ax.contour(hubs, tips, table["angular_speed"].T, levels=12)
ax.clabel(lines, fmt="%.2f")
ax.set(xlabel="hub radius / length", ylabel="tip mass / mass of the beam")
ax.set_title(r"critical speed of two elements of Model 0, in $\sqrt{EI / (\rho L^4)}$")
figure.savefig("critical_speeds.png")
print("slowest:", table["angular_speed"].min(), "fastest:", table["angular_speed"].max())
