"""Rods in space by collocation of their boundary-value problem, independent of the package.

A rod that bends, twists and stretches but does not shear, clamped at s = 0 along the first axis:
position r, attitude as a unit quaternion, force n and moment m in fixed axes, by the length s of
the unstretched rod,

    r' = (1 + n.t / EA) t,   d_i' = kappa x d_i,   n' = -f(s),   m' = -r' x n,

kappa = m.t / GJ t + m.d_2 / EI_2 d_2 + m.d_3 / EI_3 d_3, d_2 and d_3 the principal axes of the
section. At the end force and moment are given, in fixed axes or in those of the section there.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import brentq

from tests.references.quaternions import rotation, times_vector


class Rod(NamedTuple):
    """EI_3 is that of bending towards the second axis of the hub, as "in plane" is."""

    length: float
    axial: float
    bending_3: float
    bending_2: float
    torsion: float
    twist: Any = None  # angle of the section's axes by s


def _rates(rod, s, y, line):
    """y' for r (3), quaternion (4), force (3) and moment (3)."""
    axes = rotation(y[3:7])  # of the section before `Rod.twist`
    n, m = y[7:10], y[10:13]
    own = np.einsum("ijm,im->jm", axes, m)  # moments about the axes of the section
    angle = np.zeros_like(s) if rod.twist is None else rod.twist(s)
    cos, sin = np.cos(angle), np.sin(angle)
    about_2, about_3 = cos * own[1] + sin * own[2], cos * own[2] - sin * own[1]
    k2, k3 = about_2 / rod.bending_2, about_3 / rod.bending_3
    kappa = np.array([own[0] / rod.torsion, cos * k2 - sin * k3, sin * k2 + cos * k3])
    t = axes[:, 0]
    along = (1 + np.sum(n * t, 0) / rod.axial) * t
    force = np.broadcast_to(-np.asarray(line(s), float).reshape(3, -1), n.shape)
    return np.vstack([along, times_vector(y[3:7], kappa) / 2, force, -np.cross(along, n, axis=0)])


def solved(
    rod, force=(0.0, 0.0, 0.0), moment=(0.0, 0.0, 0.0), follows=False, line=None, steps=8,
    tolerance=1e-11,
):  # fmt: skip
    """The solution under a load at the end, raised in steps: a function of s to (13,)."""
    force, moment = np.asarray(force, float), np.asarray(moment, float)
    s = np.linspace(0, rod.length, 41)
    y = np.zeros((13, s.size))
    y[0], y[3] = s, 1
    for share in np.linspace(0, 1, steps + 1)[1:]:

        def ends(first, last, share=share):
            back = rotation(last[3:7]) if follows else np.eye(3)
            return np.concatenate([
                first[:3], first[3:7] - [1, 0, 0, 0], last[7:10] - share * back @ force,
                last[10:13] - share * back @ moment,
            ])  # fmt: skip

        def rates(s, y, share=share):
            here = (lambda s: np.zeros((3, 1))) if line is None else lambda s: share * line(s)
            return _rates(rod, s, y, here)

        last = tolerance if share == 1 else 1e-6
        found = solve_bvp(rates, ends, s, y, tol=last, max_nodes=20000)
        assert found.status == 0, found.message
        s, y = found.x, found.y
    return found.sol


def helix(rod, moment):
    """Where a rod of equal bending stiffnesses ends under a moment in fixed axes: its curvature,
    seen from the section, turns about the tangent at a constant rate."""
    moment = np.asarray(moment, float)

    def rates(s, y):
        t, d = y[3:6], y[6:9]
        e = np.cross(t, d)
        kappa = moment @ t / rod.torsion * t + (moment - moment @ t * t) / rod.bending_3
        return np.concatenate([t, np.cross(kappa, t), np.cross(kappa, d), 0 * e])

    start = np.concatenate([np.zeros(3), [1, 0, 0], [0, 1, 0], np.zeros(3)])
    found = solve_ivp(rates, (0, rod.length), start, rtol=1e-12, atol=1e-13, method="DOP853")
    return found.y[:3, -1]


def lateral_buckling(ratio, torsion, guess=(1.5, 4.5)):
    """The load at the end, over EI_weak / L^2, under which a cantilever that bends in its stiff
    direction, `ratio` times as stiff, buckles sideways; GJ is `torsion` times EI_weak.

    Small deflections out of the bent plane state: rotations (a, b, c) of the section in fixed axes
    by s, with the elevation of the tangent th(s) of the plane elastica EI th' = m, m' = -P cos th.
    """

    def bent(load):
        def rates(s, y):
            return np.array([y[1] / ratio, -load * np.cos(y[0])])

        def ends(a, b):
            return np.array([a[0], b[1]])

        s = np.linspace(0, 1, 201)
        begin = np.array([load / ratio * (s - s**2 / 2), load * (1 - s)])
        found = solve_bvp(rates, ends, s, begin, tol=1e-11, max_nodes=20000)
        assert found.status == 0
        return found.sol

    def singular(load):
        plane = bent(load)

        # Rotations w of sections beyond the plane state and the moment M beyond it, both in the
        # plane of the beam and so of two components: along the tangent t and along d = e_3 x t.
        # M' = -(dr)' x n with dr' = w x t: force P e_2; curvature changes by (own stiffness) M.
        def rates(s, y):
            th, m3 = plane(s)  # elevation of the tangent, moment
            cos, sin = np.cos(th), np.sin(th)
            t, d = np.array([cos, sin]), np.array([-sin, cos])
            w, moment = y[:2], y[2:]
            # The moment of the plane state, m3 e_3, is fixed, the section turns: about its axes it
            # has -(w x e_3) m3, e_3 x w being its part in the plane.
            turned = m3 * np.array([-w[1], w[0]])
            about_t, about_d = (moment + turned) @ t, (moment + turned) @ d
            # w' is the change of twist and curvature of the section, along its axes.
            rate = about_t / torsion * t + about_d * d
            # dr' = w x t, out of the plane: (w_1 t_2 - w_2 t_1) e_3; moment -(dr' x P e_2).
            out = w[0] * t[1] - w[1] * t[0]
            return np.concatenate([rate, [load * out, 0.0]])

        columns = []
        for start in ([0, 0, 1, 0], [0, 0, 0, 1]):
            found = solve_ivp(rates, (0, 1), start, rtol=1e-11, atol=1e-13, method="DOP853")
            columns.append(found.y[2:, -1])
        return np.linalg.det(np.array(columns))

    return brentq(singular, *guess, xtol=1e-11)
