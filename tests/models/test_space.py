"""Beams in space at rest, against rods solved by collocation."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxbeam as jb
from tests.references.quaternions import rotation
from tests.references.rod import Rod, helix, solved

STILL = jb.ConstantSpeed(0.0)


def tip(beam, loads, degree, **rotor):
    model, rotor = jb.SpatialRod(degree), jb.Rotor(beam, **rotor)
    return np.asarray(jb.steady(model, rotor, 0.0, loads=loads).tip)


ROD = Rod(1.0, 1e4, 1.0, 0.4, 0.7, lambda s: 0.3 + 0.5 * s)
BEAM = jb.Beam(
    1.0, 1.0, 1e4, 1.0, 0.4, twist=jb.Spanwise([0, 1], [0.3, 0.8]), torsional_stiffness=0.7
)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("force", "moment", "follows"),
    [
        ((0, 3.0, 2.0), (0.5, 0, 1.0), False),
        ((0, 1.5, -1.0), (1.0, 0.5, 1.0), True),
        ((-1.0, 0.5, 0), (0, 0, 0), True),
    ],
)
def test_loads_at_the_tip_bend_it_as_they_do_a_rod(force, moment, follows):
    """Displacements and attitudes of sections of a rod that is twisted, between nodes too."""
    rod, xi = solved(ROD, force, moment, follows), np.array([0.3, 0.5, 0.9, 1.0])
    loads, rotor = jb.Loads(tip_force=force, tip_moment=moment, follows=follows), jb.Rotor(BEAM)
    found = jb.steady(jb.SpatialRod(12), rotor, 0.0, loads=loads)
    place, turn = (np.asarray(each) for each in (found.displacement(xi), found.rotation(xi)))
    exact = rod(xi)
    off = place - (exact[:3].T - xi[:, None] * [1, 0, 0])
    turned = Rotation.from_rotvec(turn[:, [0, 2, 1]] * [1, -1, 1]).as_matrix()
    np.testing.assert_allclose(off, 0, atol=1e-6)
    sections = np.moveaxis(rotation(exact[3:7]), -1, 0)
    np.testing.assert_allclose(turned, sections, rtol=0, atol=1e-6)


@pytest.mark.slow
def test_pitch_is_a_twist_of_all_sections():
    rod = ROD._replace(twist=lambda s: 0.6 + 0 * s)
    end = solved(rod, (0, 3.0, 2.0))(1.0)[:3] - [1, 0, 0]
    uniform = jb.Beam(1.0, 1.0, 1e4, 1.0, 0.4, torsional_stiffness=0.7)
    found = tip(uniform, jb.Loads(tip_force=(0, 3.0, 2.0)), 8, pitch=0.6)
    np.testing.assert_allclose(found, end, rtol=0, atol=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("stations", [[0.0, 0.37, 1.0], [0.0, 0.37, 0.4, 0.61, 1.0]])
def test_slender_beams_with_stations_within_elements_do_not_lock(stations):
    """They bend as far as uniform ones do."""
    axial, force = 1e8, (0, 3.0, 2.0)
    end = solved(Rod(1.0, axial, 1.0, 0.4, 0.7), force)(1.0)[:3] - [1, 0, 0]
    mass, stretch, lag, flap, torsion = (
        jb.Spanwise(stations, np.full(len(stations), value))
        for value in (1.0, axial, 1.0, 0.4, 0.7)
    )
    beam = jb.Beam(1.0, mass, stretch, lag, flap, torsional_stiffness=torsion)
    assert np.abs(tip(beam, jb.Loads(tip_force=force), 8) - end).max() < 1e-6


ROUND = jb.Beam(1.0, 1.0, 1e4, 1.0, 1.0, torsional_stiffness=0.7)


@pytest.mark.exhaustive
@pytest.mark.parametrize("moment", [(0, 0, 2 * np.pi), (2.0, 0, 4.0)], ids=["circle", "helix"])
def test_a_moment_rolls_it_into_a_circle_or_a_helix(moment):
    """Which shears by 1e-8 and stretches by 1e-4 of its length, where force is none."""
    end = helix(Rod(1.0, np.inf, 1.0, 1.0, 0.7), moment)
    if moment[0] == 0:
        np.testing.assert_allclose(end, 0, atol=1e-10)
    loads = jb.Loads(tip_moment=moment)
    np.testing.assert_allclose(tip(ROUND, loads, 12), end - [1, 0, 0], rtol=0, atol=1e-9)


@pytest.mark.exhaustive
def test_the_hub_bears_what_acts_at_the_tip():
    """At rest, whatever the shape: -F, and -(M + r x F)."""
    force, moment = jnp.array([0.4, 1.0, 0.5]), jnp.array([0.3, 0.2, -0.5])
    loads, model = jb.Loads(tip_force=force, tip_moment=moment), jb.SpatialRod(3)
    rotor = jb.Rotor(BEAM, hub_radius=0.2)
    start = jb.steady_start(model, rotor, STILL, loads=loads)
    run = jb.simulate(model, rotor, STILL, [0.0, 0.01], start=start, loads=loads)
    at = run.tip[-1] + jnp.array([1.2, 0, 0])
    np.testing.assert_allclose(run.hub_force[-1], -force, rtol=0, atol=1e-6)
    np.testing.assert_allclose(
        run.hub_torque[-1], -(moment + jnp.cross(at, force)), rtol=0, atol=1e-6
    )


def test_what_it_cannot_do_it_says():
    stiff = jb.Beam(1.0, 1.0, 1e4, 1.0, 0.4)
    with pytest.raises(ValueError, match="give torsional_stiffness"):
        jb.SpatialRod(2).linearise(jb.Rotor(stiff), 1.0)
    rotor = jb.Rotor(BEAM, root_springs=jb.RootSprings(flap=3.0))
    with pytest.raises(ValueError, match=r"take model\.suited"):
        jb.SpatialRod(2).equations(rotor)
    assert len(jb.SpatialRod(2).suited(rotor).directions) == 1 + len(jb.SpatialRod(2).directions)
    with pytest.raises(ValueError, match=r"loads\.tip_moment: PlanarRod has no moment"):
        jb.steady_start(
            jb.PlanarRod(2), jb.Rotor(stiff), STILL, loads=jb.Loads(tip_moment=[0, 0, 1])
        )
    loads = jb.Loads(tip_force=[0, 1, 0], follows=True)
    with pytest.raises(ValueError, match=r"loads\.follows: Hybrid has no load that turns with"):
        jb.simulate(jb.Hybrid(), jb.Rotor(stiff), STILL, [0.0, 1.0], loads=loads)
    with pytest.raises(TypeError, match="follows must be True or False"):
        jb.Loads(tip_force=[0, 1, 0], follows=1)
    with pytest.raises(ValueError, match="tip_moment must have shape"):
        jb.Loads(tip_moment=[0, 1])


@pytest.mark.exhaustive
def test_hub_axes_are_those_of_loads_in_a_cone():
    """A beam in a cone of 90 degrees with a force along the axis of rotation is stretched."""
    beam = jb.Beam(1.0, 1.0, 10.0, 1.0, 0.4, torsional_stiffness=0.7)
    found = tip(beam, jb.Loads(tip_force=[0, 0, 1.0]), 2, precone=np.pi / 2)
    np.testing.assert_allclose(found, [0, 0, 0.1], atol=1e-12)
