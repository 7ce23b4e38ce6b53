"""Frequencies of blades as built, computed without the package.

Unit-free form: lengths in L, masses in m(L/2) L, stiffness in EI_flap(L/2). With w frequency, W
speed, m, EI, EA, theta functions of x, the linear theory ("hybrid": arc-length stretch s, small
deflections v in the plane of rotation and w along the axis, tension of the undeformed beam) reads

    P(x) = W^2 [int_x^1 m (R + x) dx + M (R + 1 + c)]
    (EI_vv v'' + EI_vw w'')'' - (P v')' - m (w^2 + W^2) v + 2 W w m s = 0
    (EI_vw v'' + EI_ww w'')'' - (P w')' - m w^2 w                     = 0
    (EA s')' + m (w^2 + W^2) s - 2 W w m v                            = 0

(lag and flap in phase, stretch in quadrature), EI_vv = EI_lag cos^2 + EI_flap sin^2 of
theta + pitch and so on. Root: displacements vanish, slopes vanish or meet springs, moment k slope.
Tip: a rigid body of mass M, centre c beyond the tip, inertia J across, J_z - J_x = d, adds

    [W^2 M c (R + 1 + c) (v'^2 + w'^2) + W^2 d w'^2 - (w^2 + W^2) M ((v + c v')^2 + s^2)
     - w^2 (M (w + c w')^2 + J (v'^2 + w'^2)) + 4 W w M (v + c v') s] / 2

to the functional whose stationary points these equations are; its derivatives are the forces there.

Method. With coordinates q and the forces p that belong to them, any such problem is Hamiltonian,

    q' = A q + D p,   p' = S(w) q - A^T p,   p(1) = -T(w) q(1),   S, T quadratic in w

with no derivative of a property in it, so that kinks and steps need no more than an element's end.
Gauss collocation in elements gives each element's transfer matrix with order 20; solutions from the
root and from the tip, orthonormalised after every element so that exponential growth costs nothing,
meet in the middle, and w is where a combination of them fits (successive linear problems, which
double roots do not slow). Where to start, and how many roots there are, comes from the same
problem as an integral equation for the bending moments, u = D^(1/2) p: identity plus compact, so
well conditioned, and with enough nodes a second method (`by_integrals`). Results are right to about
1e-12; tests/vibration/test_blade_reference.py holds them against closed forms and prints.

Sources: the hybrid model is that of Yoo, Ryan, Scott (1995), eqs. 18-20, with weights; section
stiffness and structural twist as in Houbolt, Brooks (NACA 1346, 1958) without torsion; marching
with orthonormalisation after Godunov (1961) and Conte (1966). Coned blades: see `coned`.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import scipy.linalg

# A constant, a smooth function of x / L, or stations x / L and values at them, linear between them;
# two equal stations are a step.
Profile = float | Callable[[np.ndarray], np.ndarray] | tuple[Sequence[float], Sequence[float]]
NREL = Path(__file__).parents[2] / "studies" / "data" / "nrel5mw_blade.csv"
PROPERTIES = ("mass", "lag", "flap", "stretch", "twist")


@dataclasses.dataclass(frozen=True)
class Body:
    """Rigid body at the tip; `difference` is J_z - J_x (a rod along x: `inertia`, a ball: 0)."""

    mass: float = 0.0
    offset: float = 0.0
    inertia: float = 0.0
    difference: float = 0.0


@dataclasses.dataclass(frozen=True)
class Blade:
    """A cantilever on a hub, in any consistent units; springs act about the hub's axes.

    mass is per length; lag, flap and stretch are EI_lag, EI_flap and EA (None: inextensible); twist
    and pitch are in radians. Where functions among the properties have kinks, `kinks` names x / L.
    """

    mass: Profile = 1.0
    lag: Profile = 1.0
    flap: Profile = 1.0
    stretch: Profile | None = None
    twist: Profile = 0.0
    pitch: float = 0.0
    length: float = 1.0
    hub: float = 0.0
    tip: Body = Body()
    lag_spring: float | None = None
    flap_spring: float | None = None
    kinks: tuple[float, ...] = ()

    def __post_init__(self):
        for name in PROPERTIES:  # hashable, for the cache
            value = getattr(self, name)
            if value is not None and not callable(value) and np.ndim(value) != 0:
                stations, values = (tuple(float(v) for v in part) for part in value)
                whole = stations[0] == 0 and stations[-1] == 1 and len(stations) == len(values)
                if not whole or list(stations) != sorted(stations):
                    raise ValueError(f"{name}: stations must ascend from 0 to 1, one value at each")
                object.__setattr__(self, name, (stations, values))

    def at(self, name: str, x: np.ndarray) -> np.ndarray:
        """A property at x / L; never asked for at a station."""
        profile = getattr(self, name)
        if callable(profile):
            return np.broadcast_to(profile(x), np.shape(x))
        if isinstance(profile, tuple):
            return np.interp(x, *profile)
        return np.full(np.shape(x), float(profile))

    def breaks(self) -> np.ndarray:
        """Ends of the intervals in which every property is smooth."""
        profiles = (getattr(self, name) for name in PROPERTIES)
        stations = [p[0] for p in profiles if isinstance(p, tuple)]
        return np.unique(np.concatenate([[0.0, 1.0], self.kinks, *stations]))

    def unit(self) -> float:
        """Frequency in which the unit-free problem is measured."""
        half = np.array(0.5)
        return float(np.sqrt(self.at("flap", half) / self.at("mass", half)) / self.length**2)


@functools.cache
def nrel5mw(twisted: bool = True) -> Blade:
    """The blade of the NREL 5-MW reference turbine in SI units, inextensible, linear in between."""
    x, twist, mass, flap_stiffness, lag_stiffness = np.loadtxt(NREL, delimiter=",", skiprows=2).T
    return Blade(
        mass=(x, mass),
        lag=(x, lag_stiffness),
        flap=(x, flap_stiffness),
        twist=(x, np.deg2rad(twist)) if twisted else 0.0,
        length=61.5,
        hub=1.5,
    )


class _Grid:
    """Elements with Gauss nodes, integrals over them, and the blade's unit-free numbers there."""

    def __init__(self, blade: Blade, speed: float, edges: np.ndarray, stages: int):
        self.edges, self.a, self.b, nodes = edges, *_gauss(stages)
        self.h = np.diff(edges)
        self.x = edges[:-1, None] + self.h[:, None] * nodes
        self.weight = self.h[:, None] * self.b
        half, length = np.array(0.5), blade.length
        mass, stiffness = blade.at("mass", half), blade.at("flap", half)
        self.mass = blade.at("mass", self.x) / mass
        self.lag, self.flap = (blade.at(p, self.x) / stiffness for p in ("lag", "flap"))
        if blade.stretch is not None:
            self.stretch = blade.at("stretch", self.x) * length**2 / stiffness
        self.angle = blade.at("twist", self.x) + blade.pitch
        self.speed, self.hub = speed / blade.unit(), blade.hub / length
        self.body = blade.tip.mass / (mass * length)
        self.offset = blade.tip.offset / length
        self.inertia, self.difference = (
            j / (mass * length**3) for j in (blade.tip.inertia, blade.tip.difference)
        )
        self.lag_spring, self.flap_spring = (
            None if k is None else k * length / stiffness
            for k in (blade.lag_spring, blade.flap_spring)
        )
        self.centre = self.hub + 1 + self.offset
        self.tension = self.speed**2 * (
            self.outboard(self.mass * (self.hub + self.x)) + self.body * self.centre
        )

    def outboard(self, f: np.ndarray) -> np.ndarray:
        """int_x^1 f dx at the nodes."""
        inner = self.h[:, None] * (f @ self.a.T)
        per_element = (self.weight * f).sum(1)
        return np.cumsum(per_element[::-1])[::-1][:, None] - inner

    def integral(self) -> np.ndarray:
        """The matrix of int_0^x from nodes to nodes."""
        e, s = self.x.shape
        full = np.zeros((e, s, e, s))
        for k in range(e):
            full[k, :, k] = self.h[k] * self.a
            full[k + 1 :, :, k] = self.weight[k]
        return full.reshape(e * s, e * s)


@functools.cache
def _gauss(stages: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Runge-Kutta matrix, weights and nodes of Gauss collocation on (0, 1)."""
    t, w = np.polynomial.legendre.leggauss(stages)
    degree = np.arange(stages)
    legendre = np.polynomial.legendre.legvander(t, stages)
    # int_-1^t P_k = (P_{k+1} - P_{k-1}) / (2 k + 1)
    below = np.concatenate([-legendre[:, :1], legendre[:, : stages - 1]], axis=1)
    primitive = (legendre[:, 1:] - below) / (2 * degree + 1)
    coefficients = (degree + 0.5)[:, None] * legendre[:, :stages].T * w
    return primitive @ coefficients / 2, w / 2, (t + 1) / 2


def _edges(blade: Blade, speed: float, omega: float, fine: tuple[float, float, float]):
    """Elements no longer than fine[0], in which no solution grows by more than e^fine[1] and no
    property by more than a factor of fine[2]: 1 / EI has a pole where a linear EI has its zero.
    """
    edges, (longest, exponent, ratio) = blade.breaks(), fine
    while True:
        grid, size = _Grid(blade, speed, edges, 10), np.diff(edges)
        soft = np.minimum(grid.lag, grid.flap)
        waves = ((omega / blade.unit()) ** 2 + grid.speed**2) * grid.mass / soft
        rate = np.maximum(np.sqrt(grid.tension / soft), waves**0.25).max(1)
        stiff = [grid.lag, grid.flap, *([] if blade.stretch is None else [grid.stretch])]
        spread = np.max([v.max(1) / v.min(1) for v in stiff], 0)
        bad = (size > longest * (1 + 1e-9)) | (size * rate > exponent) | (spread > ratio)
        if not bad.any():
            return edges
        if len(edges) > 2000:
            raise ValueError("a stiffness vanishes, or varies too much")
        edges = np.sort(np.concatenate([edges, (edges[:-1] + size / 2)[bad]]))


@dataclasses.dataclass
class _Problem:
    """q' = A q + G u, u = G^T p, p' = S q - A^T p; S and the tip's T by powers of frequency.

    `root` holds the coordinates that are free at the root, with their springs.
    """

    a: np.ndarray
    g: np.ndarray
    s: np.ndarray
    tip: np.ndarray
    root: dict[int, float]

    @classmethod
    def empty(cls, grid: _Grid, coordinates: int, strains: int):
        node, n = grid.x.shape, coordinates
        return cls(
            np.zeros((*node, n, n)),
            np.zeros((*node, n, strains)),
            np.zeros((3, *node, n, n)),
            np.zeros((3, n, n)),
            {},
        )

    def balanced(self, omega: float):
        """The same with p in a unit in which S is of order one: rounding falls a thousandfold."""
        unit = 1 + np.abs(self.s[0] + omega**2 * self.s[2]).max()
        root = {i: k / unit for i, k in self.root.items()}
        return _Problem(self.a, self.g * unit**0.5, self.s / unit, self.tip / unit, root)


# --- the linear theory ---------------------------------------------------------------------------


def _flat(grid: _Grid, motion: frozenset[str]) -> _Problem:
    """Coordinates: s, v, v', w, w' as far as the motion has them."""
    of = {"s": "axial", "v": "lag", "dv": "lag", "w": "flap", "dw": "flap"}
    at = {name: i for i, name in enumerate(n for n in of if of[n] in motion)}
    bending = [d for d in ("dv", "dw") if d in at]
    problem = _Problem.empty(grid, len(at), len(bending) + ("s" in at))
    a, g, s = problem.a, problem.g, problem.s
    if len(bending) == 2:
        cos, sin = np.cos(grid.angle), np.sin(grid.angle)
        g[..., at["dv"], 0], g[..., at["dw"], 0] = cos / grid.lag**0.5, sin / grid.lag**0.5
        g[..., at["dv"], 1], g[..., at["dw"], 1] = -sin / grid.flap**0.5, cos / grid.flap**0.5
    elif bending:
        if grid.angle.any():
            raise ValueError("with twist or pitch, lag and flap are one motion")
        stiffness = grid.lag if "lag" in motion else grid.flap
        g[..., at[bending[0]], 0] = stiffness**-0.5
    for slope in bending:
        a[..., at[slope[1]], at[slope]] = 1.0
        s[0, ..., at[slope], at[slope]] = grid.tension
        spring = grid.lag_spring if slope == "dv" else grid.flap_spring
        if spring is not None:
            problem.root[at[slope]] = spring
    for name in at.keys() & {"s", "v", "w"}:
        s[2, ..., at[name], at[name]] = -grid.mass
        if name != "w":
            s[0, ..., at[name], at[name]] = -(grid.speed**2) * grid.mass
    if "s" in at:
        g[..., at["s"], -1] = grid.stretch**-0.5
    if at.keys() >= {"s", "v"}:
        for i, j in (("s", "v"), ("v", "s")):
            s[1, ..., at[i], at[j]] = 2 * grid.speed * grid.mass
    _add_body(grid, at, problem.tip)
    return problem


def _add_body(grid: _Grid, at: dict[str, int], tip: np.ndarray) -> None:
    unit = np.eye(len(at))
    moves = {}
    for name, slope in (("s", None), ("v", "dv"), ("w", "dw")):
        if name in at:
            arm = grid.offset * unit[at[slope]] if slope else 0.0
            moves[name] = unit[at[name]] + arm
            tip[2] -= grid.body * np.outer(moves[name], moves[name])
            if name != "w":
                tip[0] -= grid.speed**2 * grid.body * np.outer(moves[name], moves[name])
        if slope in at:
            turn = np.outer(unit[at[slope]], unit[at[slope]])
            tip[2] -= grid.inertia * turn
            tip[0] += grid.speed**2 * grid.body * grid.offset * grid.centre * turn
            if slope == "dw":
                tip[0] += grid.speed**2 * grid.difference * turn
    if moves.keys() >= {"s", "v"}:
        both = np.outer(moves["s"], moves["v"])
        tip[1] += 2 * grid.speed * grid.body * (both + both.T)


# --- coned blades --------------------------------------------------------------------------------


def _steady(grid: _Grid, cone: float, deflected: bool):
    """Angle from the plane of rotation, its derivative and the radial force, at the nodes.

    (EI theta')' = H sin theta, theta(0) = cone, theta'(1) = 0, H = W^2 [int_x^1 m X + M X(1)] and
    X = R + int_0^x cos theta: Newton steps on the moment equation, in theta' at the nodes.
    """
    inward, w = grid.integral(), grid.weight.ravel()
    outward = w - inward
    m, ei, curvature = grid.mass.ravel(), grid.flap.ravel(), np.zeros(grid.x.size)
    for _ in range(30):
        theta = cone + inward @ curvature
        sin, cos = np.sin(theta), np.cos(theta)
        radius, tip = grid.hub + inward @ cos, grid.hub + w @ cos
        force = grid.speed**2 * (outward @ (m * radius) + grid.body * tip)
        if not deflected:
            break
        residual = ei * curvature + outward @ (force * sin)
        moved = -(inward * sin) @ inward
        d_force = grid.speed**2 * (outward @ (m[:, None] * moved) - grid.body * (w * sin) @ inward)
        slope = sin[:, None] * d_force + (force * cos)[:, None] * inward
        step = np.linalg.solve(np.diag(ei) + outward @ slope, residual)
        curvature -= step
        if np.abs(step).max() < 1e-13 * (1 + np.abs(curvature).max()):
            break
    else:
        raise ArithmeticError("no steady state found")
    return (v.reshape(grid.x.shape) for v in (theta, curvature, force))


def _coned(grid: _Grid, cone: float, deflected: bool) -> _Problem:
    """Coordinates: elevation, X, Z; azimuth, Y, twist angle; see `coned`."""
    theta, bent, force = _steady(grid, cone, deflected)
    cos, sin, excess = np.cos(theta), np.sin(theta), grid.lag - grid.flap
    elevation, x, z, azimuth, y, twist = range(6)
    problem = _Problem.empty(grid, 6, 2)
    a, g, s = problem.a, problem.g, problem.s
    a[..., x, elevation], a[..., z, elevation], a[..., y, azimuth] = -sin, cos, cos
    g[..., elevation, 0] = grid.flap**-0.5
    # d azimuth / dx = r (u - r e theta' cos twist), with r = 1 / (sqrt(EI_lag) cos)
    root = grid.lag**-0.5 / cos
    g[..., azimuth, 1], g[..., twist, 1] = root, -root * sin
    pull = excess * cos * bent
    a[..., azimuth, twist], a[..., twist, twist] = -(root**2) * pull, root**2 * pull * sin
    s[0, ..., twist, twist] = excess * bent**2 - (root * pull) ** 2
    s[0, ..., elevation, elevation] = s[0, ..., azimuth, azimuth] = force * cos
    if not deflected:
        # Where forces do not balance, second derivatives depend on the coordinates: these are
        # displacements across the undeformed axis, v' = cos t p, with their foreshortening.
        s[0, ..., azimuth, azimuth] *= cos**2
    for i in (x, y, z):
        s[2, ..., i, i] = -grid.mass
        problem.tip[2, i, i] = -grid.body
    for i in (x, y):
        s[0, ..., i, i] = -(grid.speed**2) * grid.mass
        problem.tip[0, i, i] = -(grid.speed**2) * grid.body
    for i, j in ((x, y), (y, x)):
        s[1, ..., i, j] = -2 * grid.speed * grid.mass
        problem.tip[1, i, j] = -2 * grid.speed * grid.body
    return problem


# --- the integral equation -----------------------------------------------------------------------


def _energies(grid: _Grid, problem: _Problem) -> list[np.ndarray]:
    """L_0 + w L_1 + w^2 L_2, whose null vectors are the modes: u sqrt(weight), springs' slopes."""
    e, stages, n, strains = problem.g.shape
    nodes, free = e * stages, list(problem.root)
    weight, integral = grid.weight.ravel(), grid.integral()
    a, g = problem.a.reshape(nodes, n, n), problem.g.reshape(nodes, n, strains)
    forcing = np.zeros((nodes, n, nodes * strains + len(free)))
    per_unit = g / np.sqrt(weight)[:, None, None]
    columns = np.einsum("ij,jnk->injk", integral, per_unit)
    forcing[..., : nodes * strains] = columns.reshape(nodes, n, -1)
    start = np.zeros((n, forcing.shape[-1]))
    for k, i in enumerate(free):
        start[i, nodes * strains + k] = 1.0
    forcing += start
    # integrals of A q, coordinate by coordinate: q is what is left after (1 - integral A)
    operator = np.eye(nodes * n) - np.einsum("ij,jnk->injk", integral, a).reshape(nodes * n, -1)
    q = np.linalg.solve(operator, forcing.reshape(nodes * n, -1)).reshape(nodes, n, -1)
    rate = a @ q
    for j in range(nodes):
        rate[j, :, j * strains : (j + 1) * strains] += per_unit[j]
    tip = start + np.tensordot(weight, rate, 1)
    flat, out = q.reshape(nodes * n, -1), []
    for s, t in zip(problem.s.reshape(3, nodes, n, n), problem.tip, strict=True):
        weighted = (weight[:, None, None] * (s @ q)).reshape(nodes * n, -1)
        out.append(flat.T @ weighted + tip.T @ t @ tip)
    out[0][np.diag_indices(nodes * strains)] += 1.0
    for k, i in enumerate(free):
        out[0][nodes * strains + k, nodes * strains + k] += problem.root[i]
    return [(matrix + matrix.T) / 2 for matrix in out]


def _roots(energies: list[np.ndarray], count: int) -> np.ndarray:
    """Lowest w > 0 with L(w) singular; with Coriolis forces, in the lowest modes without them."""
    stiffness, coriolis, inertia = energies[0], energies[1], -energies[2]
    n = len(stiffness)
    keep = n if n < 150 else 60
    gyroscopic = bool(np.abs(coriolis).max() > 0)
    wanted = (n - (keep if gyroscopic else min(n, count)), n - 1)
    nu, x = scipy.linalg.eigh(inertia, stiffness, subset_by_index=wanted)
    if not gyroscopic:
        return nu[::-1] ** -0.5
    c, root = x.T @ coriolis @ x, np.diag(np.sqrt(np.maximum(nu, 0.0)))
    mu = np.linalg.eigvalsh(np.block([[-c, root], [root, np.zeros_like(c)]]))
    return 1 / mu[::-1][:count]


# --- shooting ------------------------------------------------------------------------------------


def _transfers(grid: _Grid, problem: _Problem, omega: float) -> np.ndarray:
    """(q, p) at the end of each element for unit values at its beginning."""
    n, (e, stages) = problem.a.shape[-1], grid.x.shape
    s = problem.s[0] + omega * problem.s[1] + omega**2 * problem.s[2]
    f = np.empty((e, stages, 2 * n, 2 * n))
    f[..., :n, :n], f[..., :n, n:] = problem.a, problem.g @ problem.g.swapaxes(-1, -2)
    f[..., n:, :n], f[..., n:, n:] = s, -problem.a.swapaxes(-1, -2)
    f *= grid.h[:, None, None, None]
    coupled = -grid.a[:, None, :, None] * f.transpose(0, 2, 1, 3)[:, None]
    system = coupled.reshape(e, stages * 2 * n, stages * 2 * n)
    i = np.arange(stages * 2 * n)
    system[:, i, i] += 1.0
    right = np.broadcast_to(np.tile(np.eye(2 * n), (stages, 1)), (e, stages * 2 * n, 2 * n))
    inside = np.linalg.solve(system, right).reshape(e, stages, 2 * n, 2 * n)
    return np.eye(2 * n) + np.einsum("j,ejab->eab", grid.b, f @ inside)


def _orthonormal(y: np.ndarray) -> np.ndarray:
    q, r = np.linalg.qr(y)
    return q * np.where(np.diag(r) < 0, -1.0, 1.0)  # so that q depends smoothly on frequency


def _misfit(grid: _Grid, problem: _Problem, omega: float) -> np.ndarray:
    """Singular where a solution that fits the root continues one that fits the tip."""
    n = problem.a.shape[-1]
    unit, zero = np.eye(n), np.zeros((n, n))
    clamped = np.diag([0.0 if i in problem.root else 1.0 for i in range(n)])
    springs = np.diag([problem.root.get(i, 0.0) for i in range(n)])
    left = _orthonormal(np.vstack([unit - clamped, clamped + springs]))
    tip = problem.tip[0] + omega * problem.tip[1] + omega**2 * problem.tip[2]
    right = _orthonormal(np.vstack([unit, -tip]))
    across = np.block([[zero, unit], [-unit, zero]])
    transfers = _transfers(grid, problem, omega)
    backward = -across @ transfers.swapaxes(-1, -2) @ across  # Gauss collocation is symplectic
    middle = len(transfers) // 2
    for transfer in transfers[:middle]:
        left = _orthonormal(transfer @ left)
    for transfer in backward[: middle - 1 if middle else None : -1]:
        right = _orthonormal(transfer @ right)
    return right.T @ across @ left


def _polish(grid: _Grid, problem: _Problem, guess: float) -> float:
    """The root of `_misfit` near the guess."""
    omega = guess
    step = 1e-5 * omega
    value = _misfit(grid, problem, omega)
    slope = (_misfit(grid, problem, omega + step) - value) / step
    for _ in range(12):
        shifts = scipy.linalg.eigvals(value, -slope)
        change = float(np.real(shifts[np.argmin(np.abs(shifts))]))
        omega += change
        if abs(omega / guess - 1) > 1e-3:
            raise ArithmeticError(f"no frequency near {guess}")
        if abs(change) < 1e-9 * omega:  # what is left is 1e-5 of it
            return omega
        value, old = _misfit(grid, problem, omega), value
        if abs(change) > 1e-5 * omega:
            slope = (value - old) / change
    raise ArithmeticError(f"no convergence from {guess}")


def _solve(blade: Blade, speed: float, build: Callable, count: int, resolution: float):
    coarse = _Grid(blade, speed, _edges(blade, speed, 0.0, (1 / 16, 3.0, 3.0)), 4)
    guesses = _roots(_energies(coarse, build(coarse)), count)
    highest = guesses[-1] * blade.unit()
    limits = (0.125 / resolution, 2.0 / resolution, 2.0 ** (1 / resolution))
    fine = _Grid(blade, speed, _edges(blade, speed, highest, limits), 10)
    problem = build(fine).balanced(guesses[-1])
    found = np.array([_polish(fine, problem, guess) for guess in guesses])
    apart = np.abs(np.diff(guesses)) > 1e-5 * guesses[1:]
    if (np.abs(np.diff(found))[apart] < 1e-9 * found[1:][apart]).any():
        raise ArithmeticError("two starting values led to one frequency")
    return tuple(float(v) for v in np.sort(found) * blade.unit())


# --- what tests call -----------------------------------------------------------------------------


def _motion(blade: Blade, motion: str | None) -> frozenset[str]:
    if motion is None:
        motion = "lag flap" if blade.stretch is None else "axial lag flap"
    directions = frozenset(motion.split())
    if not directions or directions - {"axial", "lag", "flap"}:
        raise ValueError(f"motion names axial, lag, flap, not {motion!r}")
    return directions


@functools.cache
def frequencies(
    blade: Blade,
    speed: float = 0.0,
    count: int = 3,
    motion: str | None = None,
    resolution: float = 1.0,
) -> tuple[float, ...]:
    """Lowest frequencies, ascending, in radians per unit of time.

    motion: what may move, among "axial", "lag", "flap", separated by blanks; all, unless the blade
    is inextensible. Doubling the resolution halves the elements' length.
    """
    directions = _motion(blade, motion)
    return _solve(blade, speed, lambda grid: _flat(grid, directions), count, resolution)


def flap(blade: Blade, speed: float = 0.0, count: int = 3) -> tuple[float, ...]:
    """Lowest frequencies along the axis of rotation, without twist."""
    return frequencies(blade, speed, count, "flap")


def in_plane(blade: Blade, speed: float = 0.0, count: int = 3) -> tuple[float, ...]:
    """Lowest frequencies in the plane of rotation, without twist; with stretch if the blade has."""
    return frequencies(blade, speed, count, "lag" if blade.stretch is None else "axial lag")


@functools.cache
def by_integrals(
    blade: Blade,
    speed: float = 0.0,
    count: int = 3,
    motion: str | None = None,
    elements: int = 6,
    stages: int = 12,
) -> tuple[float, ...]:
    """The same by the integral equation alone: a second method, for checks of the first."""
    directions = _motion(blade, motion)
    grid = _Grid(blade, speed, _edges(blade, speed, 0.0, (1 / elements, np.inf, 2.0)), stages)
    found = _roots(_energies(grid, _flat(grid, directions)), count)
    return tuple(float(v) for v in found * blade.unit())


@functools.cache
def coned(
    blade: Blade,
    speed: float,
    cone: float,
    count: int = 2,
    deflected: bool = True,
    resolution: float = 1.0,
) -> tuple[float, ...]:
    """Lowest frequencies of an inextensible coned blade about its true steady rotation.

    Geometrically exact rod without extension, shear and torsion (k_1 = 0), sections principal,
    root clamped at the distance `hub` from the axis, at `cone` radians from the plane of rotation;
    a point mass may sit at the tip. With the tangent (cos t cos p, cos t sin p, sin t), elevation
    t, azimuth p, and the section turned by c about it, curvatures are

        k_1 = c' + p' sin t = 0,  k_2 = -t' cos c + p' cos t sin c,  k_3 = t' sin c + p' cos t cos c

    and the position is X = R + int cos t cos p, Y = int cos t sin p, Z = int sin t. Steady state:
    `_steady`. With small e, p, c about t(x), the terms of second order are

        EI_flap e'^2 + EI_lag (p' cos t)^2 + (EI_lag - EI_flap) (t'^2 c^2 + 2 t' cos t p' c)
        + H cos t (e^2 + p^2) - m [(w^2 + W^2) (X_1^2 + Y_1^2) + w^2 Z_1^2 + 4 W w X_1 Y_1]

    over two, c' = -p' sin t, X_1' = -e sin t, Z_1' = e cos t, Y_1' = p cos t, flap and lag being in
    quadrature. `deflected=False` linearises about the undeformed coned axis instead, as if that
    were steady: for comparison only.
    """
    plain = blade.stretch is None and blade.lag_spring is None and blade.flap_spring is None
    turned = blade.at("twist", np.linspace(0, 1, 9)).any() or blade.pitch
    tip = blade.tip
    if not plain or turned or tip.offset or tip.inertia or tip.difference:
        raise ValueError("coned: clamped, inextensible, untwisted, with a point mass at most")
    return _solve(blade, speed, lambda grid: _coned(grid, cone, deflected), count, resolution)
