"""Spin-ups in a batch: how far does the tip lag, and what would change it?"""

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp

import jaxbeam as jb

times = jnp.linspace(0.0, 20.0, 201)


def peak(angular_speed, stiffness, tip_mass):
    """Largest deflection of the tip in plane, in m, and what became of the run."""
    blade = jb.Beam(8.0, 0.202, 5e6, stiffness, stiffness)
    motion = jb.SmoothSpinUp(angular_speed, duration=15.0)
    run = jb.simulate(jb.PlanarRod(4), jb.Rotor(blade, 0.5, tip_mass), motion, times, throw=False)
    deflection, _ = run.peak()
    return deflection, run.status


@jax.jit
@jax.vmap
def case(angular_speed):
    slopes, status = jax.grad(peak, (1, 2), has_aux=True)(angular_speed, 566.0, 0.1)
    deflection, _ = peak(angular_speed, 566.0, 0.1)
    return deflection, *slopes, status


print("speed   lag (m)  by stiffness (1/(N m))  by tip mass (m/kg)")
speeds = jnp.linspace(1.0, 6.0, 6)
for speed, lag, by_stiffness, by_mass, status in zip(speeds, *case(speeds), strict=True):
    said = jb.Status(int(status)).message
    print(f"{speed:5.1f} {lag:9.4f} {by_stiffness:23.2e} {by_mass:19.4f}  {said}")
