"""One poisoned case among a thousand leaves the others as they are, to the last bit."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.tiers import exhaustive, slow

N, POISONED = 1000, 517
BEAM = jb.Beam.from_slenderness(70.0)
TWISTING = jb.Beam(1.0, 1.0, 4900.0, 1.0, 1.0, torsional_stiffness=0.7, polar_inertia=1e-2)
TIMES = jnp.linspace(0.0, 10.0, 11)
FIRST = jb.labels(in_plane=1)


def found_modes(speed, tip_mass):
    return jb.modes(jb.Hybrid(2, 3, 0), jb.Rotor(BEAM, 0.0, tip_mass), speed, FIRST, throw=False)


def raising(speed, tip_mass):
    return jb.modes(jb.Hybrid(2, 3, 0), jb.Rotor(BEAM, 0.0, tip_mass), speed, FIRST).frequency


def lowest(speed, tip_mass):
    return jb.modes(jb.Hybrid(4, 8, 0), jb.Rotor(BEAM, 0.0, tip_mass), speed, 2, throw=False)


def spun_up(model, speed, tip_mass):
    motion, rotor = jb.SmoothSpinUp(speed, 8.0), jb.Rotor(BEAM, 0.0, tip_mass)
    run = jb.simulate(model, rotor, motion, TIMES, max_steps=1000, throw=False)
    return {"tip": run.tip, "energy": run.strain_energy, "status": run.status}


def hybrid(speed, tip_mass):
    return spun_up(jb.Hybrid(0, 2, 0), speed, tip_mass)


def classical(speed, tip_mass):
    return spun_up(jb.Classical(0, 2, 0), 0.5 * speed, tip_mass)  # it diverges beyond 1.5


def elements(speed, tip_mass):
    return spun_up(jb.papers.GreenANCF(1), speed, tip_mass)


def modes_in_space(speed, tip_mass):
    rotor = jb.Rotor(TWISTING, 0.0, tip_mass)
    return jb.modes(jb.SpatialRod(2), rotor, speed, jb.labels(flap=1, torsion=1), throw=False)


def in_space(speed, tip_mass):
    motion = jb.SmoothSpinUp(speed, 1.0, jb.motions.inclined_axis(0.5))
    rotor = jb.Rotor(TWISTING, 0.0, tip_mass)
    times = jnp.linspace(0.0, 0.5, 3)
    run = jb.simulate(jb.SpatialRod(2), rotor, motion, times, max_steps=1000, throw=False)
    return {"tip": run.tip, "torsion": run.torsion(1.0), "status": run.status}


def modulated(speed, tip_mass):
    motion = jb.motions.ModulatedSpeed(speed, 0.3, 5.0)
    model, rotor = jb.Hybrid(0, 2, 0), jb.Rotor(BEAM, 0.0, tip_mass)
    return jb.floquet(model, rotor, motion, throw=False)


def steepness(speed, tip_mass):
    return jb.southwell(
        jb.Hybrid(0, 3, 0), jb.Rotor(BEAM, 0.0, tip_mass), speed, FIRST, throw=False
    )


NAN = {"tip_mass": float("nan")}
INVALID = jb.Status.INVALID_TIP_MASS


@pytest.mark.parametrize(
    ("function", "poison", "status"),
    [
        (found_modes, NAN, INVALID),
        (found_modes, {"speed": 1e3}, jb.Status.NO_EQUILIBRIUM),
        slow(raising, NAN, jb.Status.RAISED),
        slow(lowest, NAN, INVALID),
        slow(modulated, NAN, INVALID),
        exhaustive(modulated, {"speed": 1e3}, jb.Status.TOO_FEW_STEPS),
        exhaustive(steepness, NAN, INVALID),
        exhaustive(hybrid, NAN, INVALID),
        exhaustive(hybrid, {"speed": 100.0}, jb.Status.MAX_STEPS),
        exhaustive(classical, {"speed": 40.0}, jb.Status.DIVERGED),
        exhaustive(elements, NAN, INVALID),
        exhaustive(modes_in_space, NAN, INVALID),
        exhaustive(in_space, NAN, INVALID),
    ],
)
def test_poison(function, poison, status):
    rng = np.random.default_rng(0)
    columns = {"speed": rng.uniform(0.0, 2.0, N), "tip_mass": rng.uniform(0.0, 1.0, N)}
    sound = jb.sweep(function, jb.points(**columns), chunk=100)
    assert (sound["status"] == jb.Status.OK).all()
    for name, value in poison.items():
        columns[name][POISONED] = value
    table = jb.sweep(function, jb.points(**columns), chunk=100)
    assert table["status"][POISONED] == status
    for name in sound.values:
        others = [np.delete(t[name], POISONED, axis=0).tobytes() for t in (sound, table)]
        assert others[0] == others[1], name
