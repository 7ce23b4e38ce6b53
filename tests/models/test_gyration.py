"""Tension in fibres of sections that twist: closed forms, and derivatives."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam._models.space.rod_state import Around, balance
from jaxbeam._rotor.sections import frames
from jaxbeam.blades import Blade
from tests.tiers import slow

LENGTH, RADIUS, TORSION, POLAR = 3.0, 0.1, 40.0, 0.03
STIFF = np.diag([2e5, 1e5, 1e5, TORSION, 400.0, 900.0])
MASS = np.diag([2.0, 2.0, 2.0, POLAR, 0.01, 0.02])


def strip(twist=0.0, gyration=RADIUS):
    return jb.Rotor(Blade([0, 1], STIFF, MASS, LENGTH, twist=[0.0, twist], gyration=gyration))


@pytest.mark.exhaustive
def test_tension_stiffens_torsion():
    """The first frequency of torsion is that of GJ + T i^2, of a blade that stretches by 1 %."""
    which = jb.labels(torsion=1)

    @jax.jit
    def found(tension):
        loads = jb.Loads(tip_force=tension * jnp.eye(3)[0])
        return jb.modes(SpatialRod(10), strip(), 0.0, which, loads=loads).frequency[0]

    for tension in (0.0, 2000.0, -200.0):
        true = np.pi / 2 / LENGTH * np.sqrt((TORSION + tension * RADIUS**2) / POLAR)
        np.testing.assert_allclose(found(tension), true, rtol=1e-8)


@pytest.mark.exhaustive
@pytest.mark.parametrize("elements", [slow(1), 3])
def test_tension_untwists(elements):
    """A strip that is twisted by k_0 as built turns back by T i^2 k_0 / (GJ + T i^2); no moment is
    in its sections, and its axis is lengthened by what fibres are, and by what they unwind."""
    twist, tension = 1.2, 2000.0
    built = twist / LENGTH
    state = jb.steady(
        SpatialRod(8, elements), strip(twist), 0.0, loads=jb.Loads(tip_force=[tension, 0, 0])
    )
    unwound = -tension * RADIUS**2 * built / (TORSION + tension * RADIUS**2)
    at = np.array([0.0, 0.4, 1.0])
    np.testing.assert_allclose(state.torsion(at), unwound * LENGTH * at, rtol=1e-8, atol=1e-12)
    strain = tension / 2e5 - RADIUS**2 * (unwound / 2 + built) * unwound
    np.testing.assert_allclose(state.strain(at), strain, rtol=1e-8)
    np.testing.assert_allclose(state.tip, [strain * LENGTH, 0, 0], atol=1e-9)
    np.testing.assert_allclose(state.section_moment(at), 0, atol=1e-8 * tension * RADIUS)
    np.testing.assert_allclose(state.section_force(at)[:, 0], tension, rtol=1e-9)


@pytest.mark.exhaustive
def test_derivatives_of_energy_and_force():
    """Of a curved, twisted blade of full sections, in any state."""
    rng = np.random.default_rng(4)
    a = rng.normal(size=(6, 6))
    size = np.sqrt([1e6, 2e5, 2e5, 3e2, 4e2, 6e2])
    stiffness = size[:, None] * (a @ a.T / 6 + 2 * np.eye(6)) * size
    axis = [[0, 0, 0], [1, 0.02, 0], [2, 0.1, 0.05], [3, 0.3, 0.1]]
    blade = Blade(
        [0, 0.4, 1], stiffness, MASS, axis, twist=[0.3, 0.2, 0.1, 0], gyration=[0.3, 0.2, 0.4]
    )
    rotor = jb.Rotor(blade, 1.0, root_springs=jb.RootSprings(200.0, 300.0))
    equations = SpatialRod(3, 2).suited(rotor).equations(rotor)
    rod = equations.rod
    start = rod.changed(equations.rest, jnp.asarray(0.2 * rng.normal(size=rod.free.size)))
    around = Around(*(jnp.zeros(3) for _ in range(3)), None, None)

    @jax.jit
    def both(q):
        def force(change):
            return balance(rod, rod.changed(q, change), around).residual.reshape(-1)[rod.free]

        def energy(change):
            return equations.strain_energy(rod.changed(q, change))

        still = jnp.zeros(rod.free.size)
        own = balance(rod, q, around).stiffness[np.ix_(rod.free, rod.free)]
        return jax.grad(energy)(still), force(still), jax.jacfwd(force)(still), own

    slope, force, tangent, own = both(start)
    np.testing.assert_allclose(force, slope, atol=1e-10 * np.abs(slope).max())
    np.testing.assert_allclose(own, tangent, atol=1e-9 * np.abs(tangent).max())


def test_the_rate_of_twist_as_built():
    """What turns sections of a curved axis about it, against differences of their axes; none is
    refused and none is not there."""
    axis = [[0, 0, 0], [1, 0.2, 0], [2, 0.3, 0.5], [3, 0.9, 1.1], [3.5, 1.5, 1.2]]
    blade = Blade([0, 1], STIFF, MASS, axis, twist=[0.3, 0.5, 0.1, 0, 0.2], gyration=[0.1, 0.3])
    at, step = np.linspace(0.05, 0.95, 7), 1e-4
    square, rate = blade.fibres_at(at)
    np.testing.assert_allclose(square, (0.1 + 0.2 * at) ** 2, rtol=1e-12)

    def axes(places):
        return np.asarray(frames(blade.axis_at(places)[1], blade.twist_at(places)))

    change = (axes(at + step) - axes(at - step)) / (2 * step)
    pace = np.linalg.norm(blade.axis_at(at)[1], axis=1)
    expected = np.einsum("pa,pa->p", axes(at)[:, :, 2], change[:, :, 1]) / pace
    np.testing.assert_allclose(rate, expected, rtol=1e-5, atol=1e-6)
    plain = dataclasses.replace(blade, gyration=None)
    assert plain.fibres_at(at) is None
    assert jb.Rotor(blade).features == ("blade", "beam.gyration")
    with pytest.raises(ValueError, match="gyration must be finite and >= 0"):
        dataclasses.replace(blade, gyration=-0.1)
    with pytest.raises(ValueError, match=r"gyration must be a number or \(2,\)"):
        dataclasses.replace(blade, gyration=[0.1] * 3)
