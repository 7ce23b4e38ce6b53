"""A rod of full sections at rest in a turning hub, by integrating its equilibrium along the axis.

Nothing here is of elements. Unknowns along s are the place r, the rotation R from the undeformed
rod as a quaternion, and force and moment (F, M) in axes that turn with it:

    r' = R (x' + eps),  R' = R kap~,  (eps, kap) = C^-1 (F, M),
    F' + kap x F = W x p - R^T f,   M' + kap x M + (x' + eps) x F = W x h + V x p,

V = R^T (omega x r), W = R^T omega, (p, h) = m (V, W); f is a dead force per length. What is at the
root is found by shooting, by Newton's method with differences.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root


class Case(NamedTuple):
    """A rod and its loads, in axes of the undeformed rod; sixes in these axes, too."""

    place: Callable[[float], np.ndarray]  # the axis by arc length, from the axis of rotation
    tangent: Callable[[float], np.ndarray]
    stiffness: Callable[[float], np.ndarray]
    inertia: Callable[[float], np.ndarray]
    length: float
    omega: np.ndarray = np.zeros(3)
    line: np.ndarray = np.zeros(3)
    force: np.ndarray = np.zeros(3)  # at the tip, as moment: dead
    moment: np.ndarray = np.zeros(3)
    following: np.ndarray = np.zeros(6)  # at the tip, in axes that turn with it
    body: np.ndarray = np.zeros((6, 6))  # inertia of what is at the tip, in axes that turn with it


def matrix(q: np.ndarray) -> np.ndarray:
    """The rotation of a quaternion (w, x)."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _slope(s: float, y: np.ndarray, case: Case) -> np.ndarray:
    r, q, force, moment = y[:3], y[3:7], y[7:10], y[10:]
    turn = matrix(q)
    strain = np.linalg.solve(case.stiffness(s), y[7:])
    along, kap = case.tangent(s) + strain[:3], strain[3:]
    w = turn.T @ case.omega
    v = turn.T @ np.cross(case.omega, r)
    momentum = case.inertia(s) @ np.concatenate([v, w])
    p, h = momentum[:3], momentum[3:]
    rates = np.array(
        [
            -q[1:] @ kap,
            *(q[0] * kap + np.cross(q[1:], kap)),
        ]
    ) / 2  # fmt: skip
    pull = np.cross(w, p) - turn.T @ case.line - np.cross(kap, force)
    bend = np.cross(w, h) + np.cross(v, p) - np.cross(kap, moment) - np.cross(along, force)
    return np.concatenate([turn @ along, rates, pull, bend])


def steady(case: Case, guess: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Place, quaternion, force and moment (p, 13) at arc lengths; `guess` is (F, M) at the root."""

    def along(start: np.ndarray) -> object:
        y = np.concatenate([case.place(0.0), [1.0, 0, 0, 0], start])
        return solve_ivp(
            _slope, (0.0, case.length), y, "DOP853", args=(case,), dense_output=True, rtol=1e-12,
            atol=1e-13,
        )  # fmt: skip

    def misses(start: np.ndarray) -> np.ndarray:
        end = along(start).y[:, -1]
        turn = matrix(end[3:7])
        own = np.concatenate([turn.T @ case.force, turn.T @ case.moment]) + case.following
        spin, moving = turn.T @ case.omega, turn.T @ np.cross(case.omega, end[:3])
        momentum = case.body @ np.concatenate([moving, spin])
        p, h = momentum[:3], momentum[3:]
        needed = np.concatenate([np.cross(spin, p), np.cross(spin, h) + np.cross(moving, p)])
        return end[7:] - own + needed

    found = root(misses, guess, method="hybr", options={"xtol": 1e-13, "eps": 1e-7})
    return along(found.x).sol(at).T
