"""Motion in time of a rod of full sections, by the intrinsic equations of `intrinsic.py` (D. H.
Hodges, International Journal of Solids and Structures 26, 1990), without the package.

Unknowns are velocities (V, W), polynomials of degree n through Gauss-Lobatto points, and forces
(F, M), of degree n - 1 through Gauss points: no displacements, and no rotations but those of both
ends, which follow in time from the velocities there and on which dead loads alone depend. By
Galerkin's method, with n + 6 points of integration,

    int N_f C (F, M)_t ds = int N_f ((V, W)' + what `spatial` has beside it) ds,
    int N_v m (V, W)_t ds = int N_v (what it has beside (F, M)') ds - int N_v' (F, M) dx + ends,

which are quadratic, and keep int (V, W).m (V, W) + (F, M).C (F, M) ds where nothing acts. So do
Gauss's methods in time (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, IV.5), of
order 2 s with s stages, which are found by Newton's method with one matrix for many steps, each by
itself in the eigenvectors of the method. Errors fall exponentially with n and with s.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre

from tests.references.intrinsic import Rod, spatial

_MORE = 6  # points of integration beyond the degree
_CHANGES, _SLOW = 40, 8  # Newton's, at most, and after which the matrix is made anew
_CLOSE = 1e-12


class Scene(NamedTuple):
    """A rod in axes of the undeformed rod, which are those of space at the first time.

    `hub` gives velocity and angular velocity (6,) of the root in its own axes at a time, and their
    rates. None: the rod flies, and begins with `start` (6,), those of a rigid body, at the origin.
    `loads` gives forces and moments (2, 6) at root and tip, in axes that turn with these, at a time
    and for rotations (2, 3, 3) of both ends; `body` is the inertia of what is at the tip.
    """

    rod: Rod
    hub: Callable[[float], tuple[np.ndarray, np.ndarray]] | None = None
    start: np.ndarray = np.zeros(6)
    loads: Callable[[float, np.ndarray], np.ndarray] | None = None
    body: np.ndarray = np.zeros((6, 6))


class History(NamedTuple):
    """At asked times: displacement (T, 3) of the tip in axes of the root, places (T, 2, 3) and
    rotations (T, 2, 3, 3) of root and tip in space, energy (T,), and in axes that turn with
    sections velocities (T, n + 1, 6) at nodes and forces (T, n, 6) at Gauss points."""

    tip: np.ndarray
    places: np.ndarray
    rotations: np.ndarray
    energy: np.ndarray
    velocities: np.ndarray
    forces: np.ndarray


class _Points(NamedTuple):
    tangent: np.ndarray
    strains: np.ndarray
    momenta: np.ndarray


def spin(angular: Callable, rate: Callable, axis: np.ndarray, root: np.ndarray) -> Callable:
    """A `hub` that turns about an axis through the origin, by its speed and the rate of that;
    `root` is where the rod begins."""
    six = np.concatenate([np.cross(axis, root), axis])
    return lambda t: (angular(t) * six, rate(t) * six)


def matrix(q: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) of unit quaternions (..., 4)."""
    across = np.cross(q[..., None, 1:], np.eye(3)).swapaxes(-1, -2)
    return np.eye(3) + 2 * (q[..., :1, None] * across + across @ across)


def _shapes(knots: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lagrange's polynomials through knots from -1 to 1, and their derivatives by x from 0 to 1."""
    count = len(knots)
    through = np.linalg.inv(legendre.legvander(knots, count - 1))
    slopes = legendre.legvander(at, count - 2) @ legendre.legder(through)
    return legendre.legvander(at, count - 1) @ through, 2 * slopes


class _Equations:
    """Rates of unknowns: velocities of nodes, forces, and places and quaternions of both ends."""

    def __init__(self, scene: Scene, n: int) -> None:
        self.scene, rod = scene, scene.rod
        at, weight = legendre.leggauss(n + _MORE)
        inner = np.sort(legendre.legroots(legendre.legder(np.eye(n + 1)[n])).real)
        self.nodes = (1 + np.array([-1.0, *inner, 1.0])) / 2
        self.by_v, slope = _shapes(2 * self.nodes - 1, at)
        self.by_f, _ = _shapes(legendre.leggauss(n)[0], at)
        along = np.stack([rod.slope(x) for x in (1 + at) / 2])
        pace = np.linalg.norm(along, axis=1)
        self.length = pace * weight / 2
        self.gradient = np.einsum("qa,q,qb->ab", self.by_f, weight / 2, slope)
        strains, momenta = np.zeros((2, len(at), 6, 12))
        strains[:, :, 6:] = np.linalg.inv(np.stack([rod.stiffness(x) for x in (1 + at) / 2]))
        momenta[:, :, :6] = np.stack([rod.inertia(x) for x in (1 + at) / 2])
        self.points = _Points(along / pace[:, None], strains, momenta)
        self.v, self.all = 6 * (n + 1), 6 * (2 * n + 1)
        self.mass = np.zeros((self.all, self.all))
        self.mass[: self.v, : self.v] = self._within(self.by_v, momenta[:, :, :6], self.by_v)
        self.mass[self.v :, self.v :] = self._within(self.by_f, strains[:, :, 6:], self.by_f)
        self.mass[self.v - 6 : self.v, self.v - 6 : self.v] += scene.body
        self.held = 0 if scene.hub is None else 6
        self.inverse = np.linalg.inv(self.mass[self.held :, self.held :])

    def _within(self, test: np.ndarray, sixes: np.ndarray, by: np.ndarray) -> np.ndarray:
        found = np.einsum("q,qa,qij,qb->aibj", self.length, test, sixes, by, optimize=True)
        return found.reshape(6 * test.shape[1], -1)

    def start(self, t: float) -> np.ndarray:
        scene = self.scene
        places = np.stack([scene.rod.place(x) for x in self.nodes])
        six = scene.start if scene.hub is None else scene.hub(t)[0]
        arms = places - (0 if scene.hub is None else places[0])
        moved = np.concatenate([six[:3] + np.cross(six[3:], arms), 0 * arms + six[3:]], 1)
        ends = np.concatenate([places[[0, -1]], np.eye(4)[[0, 0]]], 1)
        return np.concatenate([moved.ravel(), np.zeros(self.all - self.v), ends.ravel()])

    def whole(self, t: float, y: np.ndarray) -> np.ndarray:
        """Unknowns with the velocities of the hub, where there is one."""
        return y if self.held == 0 else np.concatenate([self.scene.hub(t)[0], y[6:]])

    def parts(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        v, f, ends = np.split(y, [self.v, self.all])
        return v.reshape(-1, 6), f.reshape(-1, 6), ends.reshape(2, 7)

    def rate(self, t: float, y: np.ndarray) -> np.ndarray:
        y = self.whole(t, y)
        v, f, ends = self.parts(y)
        value, _ = spatial(self.points, np.concatenate([self.by_v @ v, self.by_f @ f], 1))
        strain = self.by_f.T @ (self.length[:, None] * value[:, :6]) + self.gradient @ v
        momentum = self.by_v.T @ (self.length[:, None] * value[:, 6:]) - self.gradient.T @ f
        six, q = v[[0, -1]], ends[:, 3:]
        (p, h), (velocity, w) = (self.scene.body @ six[1]).reshape(2, 3), six[1].reshape(2, 3)
        momentum[-1] -= np.concatenate([np.cross(w, p), np.cross(w, h) + np.cross(velocity, p)])
        turned = matrix(q)
        if self.scene.loads is not None:
            momentum[[0, -1]] += self.scene.loads(t, turned)
        out = np.concatenate([momentum.ravel(), strain.ravel()])
        led = np.zeros(0) if self.held == 0 else self.scene.hub(t)[1]
        free = out[self.held :] - self.mass[self.held :, : self.held] @ led
        moved = np.einsum("eij,ej->ei", turned, six[:, :3])
        real = -np.sum(q[:, 1:] * six[:, 3:], 1, keepdims=True)
        others = q[:, :1] * six[:, 3:] + np.cross(q[:, 1:], six[:, 3:])
        ends = np.concatenate([moved, real / 2, others / 2], 1)
        return np.concatenate([led, self.inverse @ free, ends.ravel()])

    def jacobian(self, t: float, y: np.ndarray) -> np.ndarray:
        """Of what may be stiff: rates of velocities and forces by these."""
        v, f, _ = self.parts(self.whole(t, y))
        _, slope = spatial(self.points, np.concatenate([self.by_v @ v, self.by_f @ f], 1))
        along = np.kron(self.gradient, np.eye(6))
        by = (self.by_v, slice(6)), (self.by_f, slice(6, 12))
        every = np.block([
            [self._within(test, slope[:, rows, columns], shape) for shape, columns in by]
            for test, rows in ((self.by_v, slice(6, 12)), (self.by_f, slice(6)))
        ])  # fmt: skip
        every[: self.v, self.v :] -= along.T
        every[self.v :, : self.v] += along
        out = np.zeros((len(y), len(y)))
        own = slice(self.held, self.all)
        out[own, own] = self.inverse @ every[self.held :, self.held :]
        return out

    def history(self, y: np.ndarray) -> History:
        v, f, ends = (np.stack(part) for part in zip(*map(self.parts, y), strict=True))
        moving = y[:, : self.all]
        place, turned = ends[:, :, :3], matrix(ends[:, :, 3:])
        between = np.einsum("tji,tj->ti", turned[:, 0], place[:, 1] - place[:, 0])
        energy = np.einsum("ti,ij,tj->t", moving, self.mass, moving) / 2
        rod = self.scene.rod
        return History(between - rod.place(1.0) + rod.place(0.0), place, turned, energy, v, f)


def run(scene: Scene, times: np.ndarray, n: int = 10, steps: int = 1, stages: int = 5) -> History:
    """With so many steps between two of the asked times, the first of which is the beginning."""
    equations, at = _Equations(scene, n), legendre.leggauss(stages)[0]
    weight, _ = _shapes(at, at)
    whole = legendre.legint(np.linalg.inv(legendre.legvander(at, stages - 1)), lbnd=-1) / 2
    a, weight = legendre.legvander(at, stages) @ whole, legendre.legval(1.0, whole)
    c, (values, vectors) = (1 + at) / 2, np.linalg.eig(a)
    onward, _ = _shapes(np.array([-1.0, *at]), 2 + at)
    y = equations.start(times[0])
    part = np.repeat([0, 1, 2], [equations.v, equations.all - equations.v, 14])
    stage, scale, factors, made = np.zeros((stages, len(y))), np.full(3, 1e-9), None, 0.0
    saved = [y]
    for first, last in itertools.pairwise(times):
        h = (last - first) / steps
        for t in first + h * np.arange(steps):
            for count in range(_CHANGES):
                if factors is None or abs(made / h - 1) > 1e-9 or count == _SLOW:
                    own = equations.jacobian(t, y)
                    factors = np.linalg.inv(np.eye(len(y)) - h * values[:, None, None] * own)
                    made = h
                rates = [equations.rate(t + h * x, y + z) for x, z in zip(c, stage, strict=True)]
                miss = np.linalg.solve(vectors, stage - h * a @ np.stack(rates))
                change = (vectors @ np.einsum("sij,sj->si", factors, miss)).real
                stage = stage - change
                found = np.abs(y + stage[-1])
                scale = np.maximum(scale, [found[part == k].max() for k in range(3)])
                if np.all(np.abs(change) < _CLOSE * scale[part]):
                    break
            else:
                raise RuntimeError(f"stages not found at {t}, but to {np.abs(change).max()}")
            rates = [equations.rate(t + h * x, y + z) for x, z in zip(c, stage, strict=True)]
            later = equations.whole(t + h, y + h * weight @ np.stack(rates))
            stage = onward @ np.concatenate([0 * y[None], stage]) - (later - y)
            factors, y = None if count > _SLOW else factors, later
        saved.append(y)
    return equations.history(np.stack(saved))
