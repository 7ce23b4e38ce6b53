"""Damping of full sections by six coefficients: decay rates in closed form, and the power of rates
of strain that are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam._models.contract.damping_data import Drag
from jaxbeam.blades import Blade, read_blade
from tests.files.made_up import FOLDER

MU = np.array([3e-3, 0.0, 0.0, 6e-3, 5e-3, 4e-3])
STATIONS = [0, 1]


def coupled(seed=8):
    a = np.random.default_rng(seed).normal(size=(6, 6))
    size = np.sqrt([1e6, 2e5, 3e5, 3e3, 4e3, 6e3])
    return size[:, None] * (a @ a.T / 6 + 2 * np.eye(6)) * size


@pytest.mark.exhaustive
def test_each_motion_decays_by_its_own():
    """Of a straight blade without couplings x'' + mu w^2 x' + w^2 x = 0 in each direction."""
    stiff = np.diag([2e5, 1e10, 1e10, 300.0, 400.0, 900.0])
    blade = Blade(STATIONS, stiff, np.diag([2.0, 2.0, 2.0, 0.3, 0.1, 0.2]), 4.0)
    which = jb.labels(axial=1, in_plane=2, flap=2, torsion=1)

    @jax.jit
    def found(mu):
        damping = jb.Damping(section_coefficients=mu)
        return jb.modes(SpatialRod(10), jb.Rotor(blade), 0.0, which, damping=damping).eigenvalue

    undamped = found(jnp.zeros(6)).imag
    mu = MU[[0, 5, 5, 4, 4, 3]]
    np.testing.assert_allclose(found(jnp.asarray(MU)).real, -mu * undamped**2 / 2, rtol=1e-5)


@pytest.mark.slow
def test_the_power_of_rates_that_are_known():
    """A twisted blade of full sections whose strains change as forces F at the tip make them: rates
    are those of C A F, A what they do at s, and their power is F.(int A^T C mu A ds) G, which is
    not symmetric."""
    length, twist = 3.0, 0.8
    blade = Blade(STATIONS, coupled(), np.eye(6), length, twist=[0.0, twist])
    rotor = jb.Rotor(blade)

    @jax.jit
    def matrices():
        equations = SpatialRod(12).suited(rotor).equations(rotor)
        drags = [
            Drag(stiffness_coefficient=jnp.ones(())),
            Drag(section_coefficients=jnp.asarray(MU)),
        ]
        return [equations.damping_matrix_about(equations.rest, drag) for drag in drags]

    elastic, damped = matrices()
    unit = np.zeros((len(elastic), 6))
    unit[-6:] = np.diag([1, 1, 1, *[1 / length] * 3])  # turns are times the length
    rates = np.linalg.solve(elastic, unit)
    expected, compliance = np.zeros((6, 6)), np.linalg.inv(coupled())
    node, weight = np.polynomial.legendre.leggauss(40)
    for s, w in zip(length * (1 + node) / 2, weight * length / 2, strict=True):
        cos, sin = np.cos(twist * s / length), np.sin(twist * s / length)
        at = np.eye(6)
        at[4, 2], at[5, 1] = s - length, length - s
        at = np.kron(np.eye(2), [[1, 0, 0], [0, cos, sin], [0, -sin, cos]]) @ at
        expected += w * at.T @ compliance @ np.diag(MU) @ at
    power = rates.T @ damped @ rates
    np.testing.assert_allclose(power, expected, atol=1e-9 * np.abs(expected).max())
    assert np.abs(expected - expected.T).max() > 1e-2 * np.abs(expected).max()


@pytest.mark.exhaustive
def test_six_alike_are_one():
    """About any state, of a curved blade with pitch."""
    axis = [[0, 0, 0], [1, 0.02, 0], [2, 0.1, 0.05], [3, 0.3, 0.1]]
    blade = Blade(STATIONS, coupled(), np.eye(6), axis, twist=[0.3, 0.2, 0.1, 0])
    rotor = jb.Rotor(blade, 1.0, pitch=0.3)
    equations = SpatialRod(4, 2).suited(rotor).equations(rotor)
    change = 0.2 * np.random.default_rng(0).normal(size=len(equations.mass))
    q = equations.rod.changed(equations.rest, jnp.asarray(change))
    one = equations.damping_matrix_about(q, Drag(stiffness_coefficient=jnp.asarray(0.3)))
    six = equations.damping_matrix_about(q, Drag(section_coefficients=0.3 * jnp.ones(6)))
    np.testing.assert_allclose(six, one, atol=1e-13 * np.abs(one).max())


def test_those_of_a_file_and_those_that_are_wrong():
    table = read_blade(FOLDER / "primary_beamdyn.inp")
    damping = jb.Damping(section_coefficients=table.damping)
    np.testing.assert_array_equal(damping.section_coefficients, table.damping)
    assert not damping.are_none
    assert jb.Damping(section_coefficients=None).are_none
    with pytest.raises(ValueError, match=r"damping\.section_coefficients: Hybrid has no full sec"):
        jb.modes(jb.Hybrid(), jb.Rotor(jb.Beam(1.0, 1.0, 1e4, 4.0, 1.0)), 1.0, damping=damping)
    with pytest.raises(ValueError, match=r"section_coefficients must have shape \(6,\), .* \(5,\)"):
        jb.Damping(section_coefficients=[0.1] * 5)
    with pytest.raises(ValueError, match="damping must be finite and >= 0"):
        jb.Damping(section_coefficients=[0.1] * 5 + [-1.0])
