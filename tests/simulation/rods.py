"""Rods that tests of their motion in time share, each as a rotor and as what references take, and
how hubs turn, stated anew."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import jax.numpy as jnp
import numpy as np

import jaxbeam as jb
from jaxbeam.blades import Blade, RigidBody, Support
from tests.references.intrinsic import Rod
from tests.references.intrinsic_in_time import Scene, spin

FREE = Support(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
TIGHT = diffrax.PIDController(rtol=1e-10, atol=1e-10)
ALONG = np.eye(3)[0]


class Case(NamedTuple):
    """A rotor, the rod that it is, and the inertia of what is at its tip."""

    rotor: jb.Rotor
    rod: Rod
    body: np.ndarray


def uniform(
    stiffness: np.ndarray, inertia: np.ndarray, length: float, radius: float = 0.0,
    tip_mass: float = 0.0, **ends: Support,
) -> Case:  # fmt: skip
    """A straight rod of sections that are alike."""
    blade = Blade([0, 1], [stiffness] * 2, [inertia] * 2, length)
    rod = Rod(
        lambda x: (radius + length * x) * ALONG, lambda x: length * ALONG, lambda x: stiffness,
        lambda x: inertia,
    )  # fmt: skip
    body = tip_mass * np.diag([1.0, 1, 1, 0, 0, 0])
    return Case(jb.Rotor(blade, radius, tip_mass, **ends), rod, body)


def slender(
    length: float, mass: float, axial: float, lag: float, flap: float, radius: float = 0.0,
    tip_mass: float = 0.0,
) -> Case:  # fmt: skip
    """A rod of an isotropic material, with its rotary inertia and shear."""
    second = mass / axial * np.array([flap, lag])
    stiffness = np.diag([axial, axial / 3, axial / 3, (lag + flap) / 2.6, flap, lag])
    inertia = np.diag([mass, mass, mass, second.sum(), *second])
    return uniform(stiffness, inertia, length, radius, tip_mass)


def about(mass: float, centre: Any, inertia: np.ndarray) -> np.ndarray:
    """The inertia of a body or section about a point from which its centre of mass is so far."""
    arm = np.cross(np.eye(3), centre)  # the matrix of b -> centre x b
    return np.block([[mass * np.eye(3), -mass * arm], [mass * arm, inertia - mass * arm @ arm]])


def coupled() -> Case:
    """A tapered blade of full sections with centres off its axis, twisted and bent, with pitch and
    a body at its tip whose centre is off, too."""
    drawn, size = np.random.default_rng(11).normal(size=(6, 6)), [1e5, 3e4, 3e4, 20.0, 30.0, 40.0]
    size = np.sqrt(size)
    stiff = size[:, None] * (drawn @ drawn.T / 6 + 2 * np.eye(6)) * size
    stiffness, turning = np.stack([stiff, 0.4 * stiff]), np.diag([0.02, 0.008, 0.012])
    inertia = np.stack([
        about(1.4, [0, 0.05, -0.02], 1.4 * turning), about(0.7, [0, -0.03, 0.04], 0.7 * turning),
    ])  # fmt: skip
    points, twist = np.array([[0, 0, 0], [1.0, 0.06, 0.02], [2.0, 0.2, 0.1]]), [0.3, 0.1, 0.0]
    radius, pitch = 0.5, 0.2
    products = np.array([[0.02, 0.004, -0.005], [0.004, 0.02, 0.003], [-0.005, 0.003, 0.03]])
    carried = 0.3, np.array([0.1, -0.08, 0.05]), products
    blade = Blade([0, 1], stiffness, inertia, points, twist)
    rotor = jb.Rotor(blade, radius, pitch=pitch, tip_body=RigidBody(*carried))
    axis, angle = (np.polyfit([0, 0.5, 1], a, 2) for a in (points, twist))  # through all three
    pitched = _about_axis(pitch)

    def frame(x: float) -> np.ndarray:
        tangent = 2 * x * axis[0] + axis[1]
        third = np.cross(tangent, [0, 1, 0])
        second = np.cross(third, tangent)
        own = np.stack([a / np.linalg.norm(a) for a in (tangent, second, third)], 1)
        return pitched @ own @ _about_axis(np.polyval(angle, x))

    def along(tables: np.ndarray) -> Callable[[float], np.ndarray]:
        def at(x: float) -> np.ndarray:
            both = np.kron(np.eye(2), frame(x))
            return both @ ((1 - x) * tables[0] + x * tables[1]) @ both.T

        return at

    rod = Rod(
        lambda x: radius * ALONG + pitched @ (x**2 * axis[0] + x * axis[1] + axis[2]),
        lambda x: pitched @ (2 * x * axis[0] + axis[1]), along(stiffness), along(inertia),
    )  # fmt: skip
    return Case(rotor, rod, along(np.stack([about(*carried)] * 2))(1.0))


def coned(case: Case, angle: float) -> Case:
    """It leaves its root at an angle towards a3."""
    cos, sin, root = np.cos(angle), np.sin(angle), case.rod.place(0.0)
    tilt = np.array([[cos, 0, -sin], [0, 1, 0], [sin, 0, cos]])
    both = np.kron(np.eye(2), tilt)
    rod = Rod(
        lambda x: root + tilt @ (case.rod.place(x) - root), lambda x: tilt @ case.rod.slope(x),
        lambda x: both @ case.rod.stiffness(x) @ both.T,
        lambda x: both @ case.rod.inertia(x) @ both.T,
    )  # fmt: skip
    rotor = dataclasses.replace(case.rotor, precone=jnp.asarray(angle))
    return Case(rotor, rod, both @ case.body @ both.T)


def _about_axis(angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])


def spun_up(case: Case, way: str, speed: float, duration: float, axis: Any) -> Scene:
    """The scene of a `SmoothSpinUp` or a `QuinticSpinUp`, and no longer than that lasts or a
    little."""

    def smooth(x: float) -> tuple[float, float]:
        return x - np.sin(2 * np.pi * x) / (2 * np.pi), 1 - np.cos(2 * np.pi * x)

    def quintic(x: float) -> tuple[float, float]:
        return x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2

    profile = {"smooth": smooth, "quintic": quintic}[way]

    def at(t: float) -> tuple[float, float]:
        share, slope = profile(min(t / duration, 1.0))
        return speed * share, speed * slope / duration

    hub = spin(lambda t: at(t)[0], lambda t: at(t)[1], np.asarray(axis), case.rod.place(0.0))
    return Scene(case.rod, hub, body=case.body)
