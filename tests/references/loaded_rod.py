"""Small vibration of rods about the steady state in which loads and rotation bend them, in NumPy
alone and without the package.

A rod that bends, twists and stretches but does not shear, on a hub that turns at W about its third
axis; all vectors are in axes of the hub. By the length s of the unstretched rod, with the axes
(t, d_2, d_3) of the section before pitch and twist as a unit quaternion q, force n and moment m,

    r' = (1 + n.t / EA) t,   q' = q (0, kappa) / 2,   kappa = moments of the section over stiffness,
    n' = -f - m_s (g - W x (W x r)) + m_s (r_1'' + 2 W x r_1'),   m' = -r' x n + j (t.phi'') t,

where r_1 is the small vibration, phi the small rotation of sections in it, g gravity, f a force
per length, m_s mass and j polar inertia per length. The root is clamped at the distance R along
a_1, its axes leaned by the cone about -a_2. Loads that follow have constant components along
t, d_2, d_3: a force and a moment at the tip those of the section there, a force per length those of
each section.

The only inertia of rotation of sections is that about the tangent, in small vibration alone. A body
at the tip has the mass M at r + c t and the energies J |dt/dt|^2 / 2, for its inertia across, and
J_a (t.phi' + t.W)^2 / 2, about the rod, without the gyroscopic force by which J_a t.W turns t.

Method. All fields are polynomials through Chebyshev points, and the equations are integrated from
the end where a field is given, so that nothing is differentiated: spectral accuracy, and matrices
that more points do not make ill-conditioned. Newton's method with derivatives by complex steps
finds the steady state. There the same linear equations make the matrix F that says how far
generalised forces move what has mass, o = F p, the change of centrifugal forces included; inertia
forces p = -(w^2 M + w G) o for motion as e^(w t), so 1 / w is an eigenvalue of
[[-F G, -F M], [1, 0]]: the lowest frequencies are the best ones.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from tests.references.quaternions import rotation, times_vector

Property = float | Callable[[np.ndarray], np.ndarray]  # a smooth function of s / L
Vector = tuple[float, float, float]
NONE = (0.0, 0.0, 0.0)
STEP = 1e-30  # of complex steps
_FORWARD, _N, _M = slice(0, 7), slice(7, 10), slice(10, 13)  # fields given at the root; n; m
_KINDS = slice(0, 3), slice(3, 7), _N, _M  # of fields in one unit
_KIND_OF = np.repeat(np.arange(4), [3, 4, 3, 3])


@dataclasses.dataclass(frozen=True)
class Rod:
    """In any consistent units; `lag` is EI in the plane of rotation, `flap` out of it, before twist
    and pitch turn the section from the second axis to the third. Moments act as forces do: in axes
    of the hub, or in those of the section at the tip."""

    length: float = 1.0
    mass: Property = 1.0
    axial: Property = 1e10
    lag: Property = 1.0
    flap: Property = 1.0
    torsion: Property = 1.0
    polar: Property = 0.0
    twist: Property = 0.0
    pitch: float = 0.0
    cone: float = 0.0
    hub: float = 0.0
    speed: float = 0.0
    tip_mass: float = 0.0
    offset: float = 0.0
    inertia: float = 0.0
    axial_inertia: float = 0.0
    gravity: Vector = NONE
    force: Vector = NONE
    moment: Vector = NONE
    follows: bool = False
    line: tuple[Property, Property, Property] = NONE  # force per length

    def at(self, name: str, x: np.ndarray) -> np.ndarray:
        """A property at x = s / L."""
        return _at(getattr(self, name), x)

    def under(self, share: float) -> "Rod":
        """With a share of its loads and of its centrifugal forces."""
        line = tuple(lambda x, f=f: share * _at(f, x) for f in self.line)
        gravity, force, moment = (
            tuple(share * np.asarray(v, float)) for v in (self.gravity, self.force, self.moment)
        )
        speed = np.sqrt(share) * self.speed
        return dataclasses.replace(
            self, line=line, gravity=gravity, force=force, moment=moment, speed=speed
        )

    @property
    def axis(self) -> np.ndarray:
        """Of the undeformed rod."""
        return np.array([np.cos(self.cone), 0.0, np.sin(self.cone)])


def _at(value: Property, x: np.ndarray) -> np.ndarray:
    return np.broadcast_to(value(x) if callable(value) else float(value), np.shape(x))


class _Points:
    """Chebyshev points x of (0, 1), both ends among them, and `integral`, from values there to the
    integrals from 0 to each of them of the polynomial through these."""

    def __init__(self, n: int) -> None:
        cheb = np.polynomial.chebyshev
        z = -np.cos(np.pi * np.arange(n + 1) / n)
        self.x = (1 + z) / 2
        sums = np.stack([cheb.chebval(z, cheb.chebint(c, lbnd=-1)) for c in np.eye(n + 1)], 1)
        self.coefficients = np.linalg.inv(cheb.chebvander(z, n))
        self.integral = sums @ self.coefficients / 2

    def between(self, values: np.ndarray, x: np.ndarray) -> np.ndarray:
        """The polynomials through values (..., n + 1) at other points."""
        table = np.polynomial.chebyshev.chebvander(2 * x - 1, len(self.x) - 1)
        return values @ (table @ self.coefficients).T


def _outward(rod: Rod, place: np.ndarray) -> np.ndarray:
    """-W x (W x place)."""
    flat = np.array([1.0, 1.0, 0.0]).reshape(3, *(1,) * (place.ndim - 1))
    return rod.speed**2 * flat * place


def _rates(rod: Rod, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """y' / L of the steady state, y (13, k): position, quaternion, force, moment."""
    r, q, n, m = y[:3], y[3:7], y[_N], y[_M]
    axes = rotation(q)
    along, about_2, about_3 = np.einsum("ijk,ik->jk", axes, m)
    angle = rod.at("twist", x) + rod.pitch
    cos, sin = np.cos(angle), np.sin(angle)
    # The lag stiffness is about the third axis of the turned section.
    k_2 = (cos * about_2 + sin * about_3) / rod.at("flap", x)
    k_3 = (cos * about_3 - sin * about_2) / rod.at("lag", x)
    kappa = np.array([along / rod.at("torsion", x), cos * k_2 - sin * k_3, sin * k_2 + cos * k_3])
    t = axes[:, 0]
    rate = (1 + np.sum(n * t, 0) / rod.at("axial", x)) * t
    line = np.stack([_at(f, x) for f in rod.line])
    line = np.einsum("ijk,jk->ik", axes, line) if rod.follows else line
    weight = rod.at("mass", x) * (np.reshape(rod.gravity, (3, 1)) + _outward(rod, r))
    parts = [rate, times_vector(q, kappa) / 2, -line - weight, -np.cross(rate, n, axis=0)]
    return rod.length * np.concatenate(parts)


def _at_tip(rod: Rod, last: np.ndarray, extra: np.ndarray) -> np.ndarray:
    """Force and moment (6,) that end the rod, by its fields there (13,); `extra` are generalised
    forces of inertia (7,) on the centre of the body, on t and on the turn about it."""
    axes = rotation(last[3:7])
    t = axes[:, 0]
    turn = axes if rod.follows else np.eye(3)
    centre = last[:3] + rod.offset * t
    pull = rod.tip_mass * (np.asarray(rod.gravity) + _outward(rod, centre)) + extra[:3]
    across = rod.inertia * _outward(rod, t) + extra[3:6]
    across = across + np.array([0.0, 0.0, rod.axial_inertia * rod.speed**2]) * t
    force = turn @ np.asarray(rod.force) + pull
    moment = turn @ np.asarray(rod.moment) + np.cross(t, rod.offset * pull + across)
    return np.concatenate([force, moment + t * extra[6]])


def _by_complex_steps(function: Callable, at: np.ndarray) -> np.ndarray:
    """d out_i / d at_j, (i, j, ...)."""
    columns = []
    for j in range(len(at)):
        moved = at.astype(complex)
        moved[j] += 1j * STEP
        columns.append(function(moved).imag / STEP)
    return np.stack(columns, 1)


def _tangent(rod: Rod, points: _Points, y: np.ndarray) -> np.ndarray:
    """Derivative by all fields of what `_residual` says, (13 k, 13 k)."""
    own, k = _by_complex_steps(lambda y: _rates(rod, points.x, y), y), len(points.x)
    end = _by_complex_steps(lambda last: _at_tip(rod, last, np.zeros(7)), y[:, -1])
    out = np.eye(13 * k).reshape(13, k, 13, k)
    back = points.integral - points.integral[-1]
    out[_FORWARD] -= np.einsum("kl,cdl->ckdl", points.integral, own[_FORWARD])
    out[7:] -= np.einsum("kl,cdl->ckdl", back, own[7:])
    out[7:, :, :, -1] -= end[:, None]
    return out.reshape(13 * k, 13 * k)


def _residual(rod: Rod, points: _Points, y: np.ndarray) -> np.ndarray:
    """What is left of the integrated equations, (13, k)."""
    rates = _rates(rod, points.x, y)
    whole = rates @ points.integral.T
    half = rod.cone / 2
    root = np.array([rod.hub, 0, 0, np.cos(half), 0, -np.sin(half), 0])
    end = _at_tip(rod, y[:, -1], np.zeros(7))
    from_root = y[_FORWARD] - root[:, None] - whole[_FORWARD]
    from_tip = y[7:] - end[:, None] - whole[7:] + whole[7:, -1:]
    return np.concatenate([from_root, from_tip])


def steady(rod: Rod, n: int = 32, steps: int = 6) -> tuple[_Points, np.ndarray]:
    """Points and fields (13, n + 1) of the steady state; loads rise in steps, on few points."""
    points, half = _Points(min(n, 12)), rod.cone / 2
    y = np.zeros((13, len(points.x)))
    y[0] = rod.hub
    y[:3] += rod.length * points.x * rod.axis[:, None]
    y[3], y[5] = np.cos(half), -np.sin(half)
    for i, share in enumerate(np.linspace(0, 1, steps + 1)[1:]):
        part = rod.under(share)
        if i == 0:  # the pull that stiffens the straight rod
            y[_N] -= _residual(part, points, y)[_N]
        y = _solved(part, points, y)
    fine = _Points(n)
    return fine, _solved(rod, fine, points.between(y, fine.x))


def _solved(rod: Rod, points: _Points, y: np.ndarray) -> np.ndarray:
    for _ in range(30):
        left = _residual(rod, points, y)
        change = np.linalg.solve(_tangent(rod, points, y), left.ravel()).reshape(y.shape)
        y = y - change
        # What is left is about the square of the change.
        sizes = np.array([np.abs(y[part]).max() for part in _KINDS])[_KIND_OF]
        if (np.abs(change).max(1) <= 1e-8 * sizes).all():
            return y
    raise RuntimeError("no steady state: take more steps")


def _moves(rod: Rod, y: np.ndarray) -> np.ndarray:
    """From fields to what has inertia: position and turn about the tangent at points, and at the
    tip of the centre of the body, of t and of the turn about it: (4 k + 7, 13 k)."""
    k = y.shape[1]
    unit = y[3:7]
    t = rotation(unit)[:, 0]
    by_q = _by_complex_steps(lambda q: rotation(q)[:, 0], unit)  # of t, (3, 4, k)
    # A change dq turns the section by phi = 2 vec(dq q*).
    turn = []
    for j in range(4):
        step = np.zeros_like(unit)
        step[j] = 1
        turn.append(2 * (step[1:] * unit[:1] - times_vector(step, unit[1:])[1:]))
    twist = np.einsum("ik,jik->jk", t, np.stack(turn))
    out = np.zeros((4 * k + 7, 13, k))
    nodes = out[: 4 * k].reshape(4, k, 13, k)
    each = np.arange(k)
    for c in range(3):
        nodes[c, each, c, each] = 1
    for j in range(4):
        nodes[3, each, 3 + j, each] = twist[j]
    tip = out[4 * k :, :, -1]
    tip[:3, :3] = np.eye(3)
    tip[:3, 3:7] = rod.offset * by_q[:, :, -1]
    tip[3:6, 3:7] = by_q[:, :, -1]
    tip[6, 3:7] = twist[:, -1]
    return out.reshape(4 * k + 7, 13 * k)


def _acts(rod: Rod, points: _Points, y: np.ndarray) -> np.ndarray:
    """From generalised forces that belong to `_moves` to what they put into the integrated
    equations: (13 k, 4 k + 7)."""
    k = len(points.x)
    back = -rod.length * (points.integral - points.integral[-1])
    t = rotation(y[3:7])[:, 0]
    out = np.zeros((13, k, 4 * k + 7))
    nodes = out[:, :, : 4 * k].reshape(13, k, 4, k)
    for c in range(3):
        nodes[7 + c, :, c] = back
        nodes[10 + c, :, 3] = back * t[c]
    tip = _by_complex_steps(lambda extra: _at_tip(rod, y[:, -1], extra), np.zeros(7))
    out[7:, :, 4 * k :] = tip[:, None]
    return out.reshape(13 * k, 4 * k + 7)


def eigenvalues(rod: Rod, n: int = 32, steps: int = 6) -> np.ndarray:
    """All w, of motions as e^(w t), with Im w >= 0, by their size."""
    points, y = steady(rod, n, steps)
    k = n + 1
    acts, moves = _acts(rod, points, y), _moves(rod, y)
    reach = moves @ np.linalg.solve(_tangent(rod, points, y), acts)
    mass = np.concatenate([
        *(rod.at("mass", points.x),) * 3, rod.at("polar", points.x),
        *(np.full(3, m) for m in (rod.tip_mass, rod.inertia)), [rod.axial_inertia],
    ])  # fmt: skip
    # 2 W x of positions, of the centre of the body and of t.
    turn = np.zeros((4 * k + 7, 4 * k + 7))
    each, spin = np.arange(k), 2 * rod.speed
    firsts = np.concatenate([each, [4 * k, 4 * k + 3]])
    seconds = np.concatenate([k + each, [4 * k + 1, 4 * k + 4]])
    turn[firsts, seconds], turn[seconds, firsts] = -spin, spin
    if rod.axial_inertia and rod.speed:  # W t_3 is part of the spin about t
        turn[-1, -2], turn[-2, -1] = rod.speed, -rod.speed * rod.axial_inertia / rod.inertia
    kept = mass > 0
    reach = (reach * mass)[np.ix_(kept, kept)]
    turn = turn[np.ix_(kept, kept)]
    unit = np.sqrt(np.abs(np.linalg.eigvals(reach)).max())  # near the longest period
    one = np.eye(len(reach))
    companion = np.block([[-reach @ turn / unit, -reach / unit**2], [one, 0 * one]])
    found = np.linalg.eigvals(companion)
    found = 1 / (unit * found[np.abs(found) > 1e-12])
    found = found[found.imag >= 0]
    return found[np.argsort(np.abs(found))]


def frequencies(rod: Rod, count: int, n: int = 32, steps: int = 6) -> np.ndarray:
    """The lowest imaginary parts, of a state that is stable."""
    found = eigenvalues(rod, n, steps)[:count]
    assert np.abs(found.real).max() < 1e-6 * np.abs(found).max(), found
    return found.imag
