"""A body of a full inertia at the tip of a rod, against a body on a spring of six by six, and
integration along the axis."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
import scipy

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam._models.space.rod_tables import _body
from jaxbeam.blades import Blade, RigidBody
from tests.references import full_rod

LENGTH, TWIST = 3.0, 0.6
CENTRE = np.array([0.2, -0.15, 0.1])
PRODUCTS = np.array([[0.05, 0.008, -0.01], [0.008, 0.04, 0.006], [-0.01, 0.006, 0.07]])
BODY = RigidBody(4.0, CENTRE, PRODUCTS)


def stiffness():
    a = np.random.default_rng(8).normal(size=(6, 6))
    size = np.sqrt([1e6, 2e5, 3e5, 3e3, 4e3, 6e3])
    return size[:, None] * (a @ a.T / 6 + 2 * np.eye(6)) * size


def about_tip(body):
    """The inertia of a body about the tip, by its kinetic energy for velocities of one each."""
    arm = np.asarray(body.centre_of_mass)
    moving = np.stack([six[:3] + np.cross(six[3:], arm) for six in np.eye(6)])
    spins = np.eye(6)[:, 3:]
    return float(body.mass) * moving @ moving.T + spins @ np.asarray(body.inertia) @ spins.T


def rolled(angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return np.kron(np.eye(2), [[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


@pytest.mark.exhaustive
def test_a_body_on_a_light_blade():
    """Six frequencies at rest are those of the body on the flexibility of the tip, which is what
    strains do along the blade: int A^T C A ds, A what forces at the tip do at s."""
    blade = Blade(
        [0, 1], stiffness(), 1e-9 * np.eye(6), LENGTH, twist=[0.0, TWIST],
    )  # fmt: skip
    found = jb.modes(SpatialRod(10), jb.Rotor(blade, tip_body=BODY), 0.0, 6).frequency
    flexible, compliance = np.zeros((6, 6)), np.linalg.inv(stiffness())
    node, weight = np.polynomial.legendre.leggauss(30)
    for s, w in zip(LENGTH * (1 + node) / 2, weight * LENGTH / 2, strict=True):
        at = np.eye(6)
        at[4, 2], at[5, 1] = -(LENGTH - s), LENGTH - s  # (L - s) e1 x F
        turn = rolled(TWIST * s / LENGTH)
        flexible += w * at.T @ turn @ compliance @ turn.T @ at
    own = rolled(TWIST) @ about_tip(BODY) @ rolled(TWIST).T
    squares = scipy.linalg.eigh(np.linalg.inv(flexible), own, eigvals_only=True)
    np.testing.assert_allclose(found, np.sqrt(squares), rtol=2e-7)


@pytest.mark.exhaustive
def test_a_body_that_turns():
    """Centrifugal force and moments of products of inertia on a soft blade, against integration of
    its equilibrium; and what is measured where it is held."""
    mass, stiff = np.diag([1.2, 1.2, 1.2, 0.02, 0.008, 0.012]), stiffness()
    rotor = jb.Rotor(Blade([0, 1], stiff, mass, LENGTH), 1.0, tip_body=BODY)
    state = jb.steady(SpatialRod(10), rotor, 8.0)
    case = full_rod.Case(
        place=lambda s: np.array([1.0 + s, 0, 0]), tangent=lambda s: np.eye(3)[0],
        stiffness=lambda s: stiff, inertia=lambda s: mass, length=LENGTH,
        omega=np.array([0, 0, 8.0]), body=about_tip(BODY),
    )  # fmt: skip
    at = np.array([0.0, 0.5, 1.0])
    forces, moments = state.section_force(at), np.asarray(state.section_moment(at))
    own = np.stack([moments[:, 0], -moments[:, 2], moments[:, 1]], 1)
    guess = np.concatenate([forces[0], own[0]])
    found = full_rod.steady(case, guess, at * LENGTH)
    straight = np.stack([1 + LENGTH * at, 0 * at, 0 * at], 1)
    np.testing.assert_allclose(state.displacement(at), found[:, :3] - straight, atol=1e-8)
    scale = np.abs(found[:, 7:]).max()
    np.testing.assert_allclose(np.concatenate([forces, own], 1), found[:, 7:], atol=1e-7 * scale)
    assert abs(own[-1, 0]) > 1  # torsion by products and offset


def test_what_is_a_body():
    """Its numbers are those of a body, and other models refuse it by name."""
    beam = jb.Beam(LENGTH, 1.0, 1e6, 1e3, 1e3, torsional_stiffness=1e3)
    rotor = jb.Rotor(beam, tip_body=BODY)
    assert rotor.features == ("tip_body", "tip_body.centre_of_mass")
    with pytest.raises(ValueError, match=r"tip_body\.centre_of_mass: Hybrid has no body .* full"):
        jb.modes(jb.Hybrid(), rotor, 1.0)
    np.testing.assert_allclose(_body(rotor), about_tip(BODY), atol=1e-15)
    RigidBody(0.0, [0, 0, 0], np.zeros((3, 3)))
    RigidBody(1.0, [0, 0, 0], np.diag([1.333333, 1.0, 0.333334]))  # of a plate, rounded
    wrong = [
        (-1.0, CENTRE, PRODUCTS, "tip_mass must be finite"),
        (1.0, CENTRE[:2], PRODUCTS, r"centre_of_mass must have shape \(3,\)"),
        (1.0, CENTRE * np.nan, PRODUCTS, "centre_of_mass of the rigid body must be finite"),
        (1.0, CENTRE, np.diag([3.0, 1.0, 1.0]), "none above the sum of the others"),
        (1.0, CENTRE, np.diag([-0.1, 1.0, 1.0]), "principal moments >= 0"),
        (1.0, CENTRE, np.triu(PRODUCTS), "inertia must be symmetric"),
    ]
    for mass, centre, inertia, message in wrong:
        with pytest.raises(ValueError, match=message):
            RigidBody(mass, centre, inertia)
    other = dataclasses.replace(BODY, inertia=jnp.diag(jnp.array([1.0, 2.0, 2.5])))
    assert float(other.mass) == 4.0
