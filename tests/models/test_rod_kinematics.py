"""Kinematics of rods within a step, against derivatives of what they are the kinematics of."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._models.space.rod_nodes import UPRIGHT
from jaxbeam._numerics.quaternions import rotation
from jaxbeam._rotor.motion import Hub
from jaxbeam.blades import Support
from tests.simulation.rods import coupled

G = 0.37
HINGED = Support(about_1=2.0, about_2=3.0, about_3=1.0, attitude=(0.2, -0.3, 0.5))
GUIDED = Support(along_1=0.0, attitude=(0.1, 0.2, -0.3))
LOOSE = Support(*(1.0,) * 6, attitude=(0.3, 0.1, 0.2))
SLIDING = Support(along_3=0.0, about_3=1.0, attitude=(0.2, -0.3, 0.5))
IN_A_PLANE = Support(along_1=1.0, along_2=0.0, about_3=0.0)
CASES = {
    "clamped": (jb.SpatialRod(4), None, None),
    "three elements, hinged": (jb.SpatialRod(3, 3), HINGED, None),
    "guided at the tip": (jb.SpatialRod(3, 2), None, GUIDED),
    "sliding along its hinge": (jb.SpatialRod(3), SLIDING, None),
    "in a plane at the tip": (jb.SpatialRod(3), None, IN_A_PLANE),
    "loose at the root, a joint at the tip": (jb.SpatialRod(3), LOOSE, HINGED),
}


def in_motion(model, root, tip):
    rotor = coupled().rotor
    rotor = jb.Rotor(rotor.beam, rotor.hub_radius, root_support=root, tip_support=tip)
    return model.suited(rotor).in_motion(rotor)


@pytest.mark.parametrize("name", CASES)
def test_kinematics_of_a_stage(name):
    """u / g - A u - B z = f, of which `before` is the part of f and `rates` that of z; forces
    change by minus K N u."""
    model, rotor = in_motion(*CASES[name])

    def all_of_it():
        equations = model.equations(rotor)
        rod, rng = equations.rod, np.random.default_rng(3)
        size = equations.mass.shape[0]
        v, z, *hub = (jnp.asarray(rng.normal(size=n)) for n in (size, size, 3, 3, 3, 3, 3))
        changes = [jnp.asarray(0.2 * rng.normal(size=rod.free.size)) for _ in range(2)]
        q = equations.rest
        for change in changes:
            q = rod.changed(q, change)
        root, p, strain = rod.parts(q)
        q = rod.joined(root, 1.02 * p + 0.02 * UPRIGHT[None], strain)  # of whatever length
        f = equations.kinematics(q, jnp.cos(jnp.arange(size)))  # none of what is held
        f = f + rod.joined(*rod.parts(0.1 * q))
        kinematics = equations.stage_kinematics(q, v, jnp.asarray(G))
        before = kinematics.before(f)
        by_q = jax.jvp(lambda q: equations.kinematics(q, v), (q,), (before,))[1]
        k, c = equations.tangents(Hub(*hub), q, v, None)
        led = kinematics.led(z)

        def force(q):
            return equations.force(Hub(*hub), q, v, None)

        def along(z):
            return equations.force(Hub(*hub), q, z, None)

        moved = jax.jvp(lambda q: rod.nodes(q)[0], (q,), (equations.kinematics(q, v),))[1]
        attitude = rotation(rod.nodes(q)[1])
        velocity = jnp.einsum("nij,nj->ni", attitude, rod.of_velocities(v)[:, :3])
        again = rod.coordinates(*rod.nodes(q))
        return {
            "displacements": (moved, velocity),
            "there and back": (rod.nodes(again)[0], rod.nodes(q)[0]),
            "before": (before / G - by_q, f),
            "rates": (kinematics.rates(z), equations.kinematics(q, z)),
            "by places": (jax.jvp(force, (q,), (led,))[1], -k @ kinematics.seen(led)),
            "by velocities": (jax.jvp(along, (v,), (z,))[1], -c @ z),
            "eliminated": (kinematics.eliminated(k) @ z, k @ kinematics.seen(led)),
        }  # fmt: skip

    for what, (found, expected) in jax.jit(all_of_it)().items():
        size = np.abs(expected).max()
        np.testing.assert_allclose(found, expected, atol=1e-11 * size, err_msg=what)
