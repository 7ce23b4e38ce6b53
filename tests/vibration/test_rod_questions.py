"""What follows from modes, asked of the rod as of any other model: of a straight slender beam it
says what `Hybrid` does."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam.blades import Blade

BEAM = jb.Beam(8.0, 0.2, 5e9, 566.0, 400.0, torsional_stiffness=200.0, polar_inertia=1e-6)
BLADE = Blade.of(BEAM)
ROD, HYBRID = SpatialRod(6), jb.Hybrid(4, 6, 6)
WHICH = jb.labels(in_plane=1, flap=1)
FLAP = WHICH[1]
NEAR = 1e-4  # of frequencies, by degree 6


def rotor(radius, of_blade=False):
    return jb.Rotor(BLADE if of_blade else BEAM, radius, 0.1)


@pytest.mark.exhaustive
def test_diagrams_and_resonances():
    """A Campbell diagram and its resonances."""
    said = []
    for model, scene in ((HYBRID, rotor(0.5)), (ROD, rotor(0.5, True))):
        diagram = jb.campbell(model, scene, [0.0, 1.0, 2.0, 4.0], WHICH)
        assert not np.any(diagram.status)
        found = diagram.crossings([2])
        assert [crossing.label for crossing in found] == [FLAP, WHICH[0]]
        said.append((diagram.frequency, [crossing.angular_speed for crossing in found]))
    (own, own_speeds), (exact, speeds) = said[1], said[0]
    np.testing.assert_allclose(own, exact, rtol=NEAR)
    np.testing.assert_allclose(own_speeds, speeds, rtol=NEAR)


@pytest.mark.exhaustive
def test_a_batch_and_its_gradients():
    """Resonances and Southwell coefficients by the radius of the hub: of a batch, and of its
    gradients in both modes."""
    radii, said = jnp.array([0.4, 0.5]), []
    for model, of_blade in ((HYBRID, False), (ROD, True)):

        def crossing(radius, model=model, of_blade=of_blade):
            scene = rotor(radius, of_blade)
            return jb.crossing(model, scene, (1.0, 4.0), FLAP, 2.0).angular_speed

        def southwell(radius, model=model, of_blade=of_blade):
            return jb.southwell(model, rotor(radius, of_blade), 0.0, WHICH).coefficient

        value, slope = jax.jit(jax.vmap(jax.value_and_grad(crossing)))(radii)
        said.append((value, slope, *(jax.jit(jax.vmap(f))(radii) for f in (
            southwell, jax.jacrev(southwell))
        )))  # fmt: skip
    for own, exact in zip(said[1], said[0], strict=True):
        np.testing.assert_allclose(own, exact, rtol=10 * NEAR)


@pytest.mark.exhaustive
def test_a_sweep_and_a_fit():
    """What `Hybrid` says of two radii and two speeds, and the radius that explains it."""

    def frequency(radius, speed, model=ROD, of_blade=True):
        return jb.modes(model, rotor(radius, of_blade), speed, WHICH, throw=False).frequency

    case = jb.grid(radius=[0.4, 0.5], speed=[0.0, 5.0])
    own = jb.sweep(frequency, case)["value"]
    exact = jb.sweep(functools.partial(frequency, model=HYBRID, of_blade=False), case)["value"]
    np.testing.assert_allclose(own, exact, rtol=NEAR)

    def experiments(radius):
        data = exact[1], 1e-4 * exact[1]
        return jb.FrequencyData(ROD, rotor(radius, True), [0.0, 5.0], *data, WHICH)

    found = jb.fit(experiments, {"radius": jb.FreeParameter(0.7)}, progress=False)
    np.testing.assert_allclose(found.parameters["radius"], 0.5, rtol=1e-2)


@pytest.mark.slow
def test_the_first_torsion_is_the_lowest():
    """Of a swept blade with couplings and mass off its axis, at any speed: were all else held, its
    torsion would be several times as stiff, and like none of its modes."""
    size = np.sqrt([1e6, 2e5, 2e5, 600.0, 800.0, 1200.0])
    stiffness = size[:, None] * (np.eye(6) + 0.2 * np.eye(6, k=1) + 0.2 * np.eye(6, k=-1)) * size
    arm = np.cross([0.0, 0.05, -0.03], np.eye(3)).T
    about = np.diag([0.02, 0.008, 0.012]) - arm @ arm
    inertia = np.block([[np.eye(3), -arm], [arm, about]])
    axis = [[0, 0, 0], [1, 0.05, 0], [2, 0.2, 0.1], [3, 0.45, 0.2]]
    scene = jb.Rotor(Blade([0, 1], [stiffness] * 2, [inertia] * 2, axis), 0.3)
    torsion = jb.models.Direction.TORSION

    @jax.jit
    def labels(speed):
        found = jb.modes(ROD, scene, speed, 8)
        return found.direction, found.number, found.energy_share[:, torsion]

    for speed in (0.0, 8.0, 16.0):
        direction, number, share = (np.asarray(part) for part in labels(speed))
        np.testing.assert_array_equal(direction == torsion, share > 0.5)
        np.testing.assert_array_equal(number[share > 0.5], 1 + np.arange(np.sum(share > 0.5)))


@pytest.mark.exhaustive
def test_a_speed_that_is_modulated_at_twice_a_frequency():
    """Flap grows as fast as by `Hybrid`; at a constant speed multipliers are those of `modes`."""
    beam = jb.Beam(1.0, 1.0, 1e5, 1.0, 0.6, torsional_stiffness=0.5, polar_inertia=1e-5)
    asked, hybrid = jb.Rotor(beam, 0.3, 0.1), jb.Hybrid(0, 6, 6)
    twice = 2 * jb.modes(hybrid, asked, 2.0, [FLAP]).frequency[0]
    motion = jb.motions.ModulatedSpeed(2.0, 0.6, twice)
    rates = [
        jb.floquet(model, asked, motion, steps=2000).growth_rate
        for model in (hybrid, SpatialRod(4))
    ]
    np.testing.assert_allclose(*rates, rtol=1e-2)
    still = jb.floquet(SpatialRod(4), asked, jb.ConstantSpeed(2.0), np.pi, steps=500).multipliers
    for each in jb.modes(SpatialRod(4), asked, 2.0, 4).eigenvalue:
        assert np.abs(still - np.exp(each * np.pi)).min() < 3e-6
