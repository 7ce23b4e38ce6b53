"""Functions for soft beams, with the thin layers that tension leaves to bending at both ends.

Where tension carries a beam its slope follows a string's, but for layers of width sqrt(EI / P) in
which bending turns it to what the ends ask for: a clamp, a body at the tip, an end without moment.
There curvature goes with exp(-kappa xi), kappa = L sqrt(P / EI), and polynomials need some
kappa^(1/2) functions to follow it. Exponentials of a geometric series of kappa are together what
any of them is, to an error that falls exponentially with their number: so functions need not know
how soft a beam is.

All is in NumPy, at Gauss points of segments that get shorter towards both ends: curvatures are
made orthonormal there and then integrated, so that slopes and values belong to them to rounding.
"""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.polynomial import legendre

from jaxbeam._models.bases.basis import Basis, Functions, Polynomials, Yielding, segments
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.span import Span, tension
from jaxbeam._types import is_concrete

_SOFTEST, _STIFFEST = 3e5, 40.0  # range of kappa = L sqrt(P / EI) that layers are for
_ROOT, _TIP = 18, 10  # numbers of layers at root and tip, where they matter less
LAYERS = _ROOT + _TIP
_POINTS = 10  # points of each segment, in which the narrowest layer falls to e^-20
_HALVINGS, _MIDDLE = 20, 4  # segments at the ends are 2^-20 long, and in the middle 2^-4
_MORE = 12  # polynomials that the estimate of errors takes beyond those of a model

_Array = np.ndarray


@dataclasses.dataclass(frozen=True)
class Layered(Basis):
    """Polynomials, and layers at both ends, for beams that rotation or a tip mass holds out.

    Of n bending functions 28 are layers, exponentials exp(-kappa xi) and exp(-kappa (1 - xi)) of
    kappa from 40 to 3e5, and n - 28 polynomials, of which 16 are enough for three modes each way.
    They follow a beam whose kappa = L sqrt(P / EI), P its tension at the root, is anything up to
    1e5; `Hybrid()` takes them by itself where that is above 40 and numbers are known, and under
    `jit`, `vmap` and `grad` `Hybrid(10, 44, 44, jb.models.Layered())` does.

    Raises `ValueError` where there are no more than 28 bending functions.
    """

    def bending(self, n: int, xi: _Array) -> Functions:
        return _at(n - LAYERS, False, xi)

    def stretch(self, n: int, xi: _Array) -> Functions:
        return Polynomials().stretch(n, xi)

    def quadrature(self, n: int) -> tuple[_Array, _Array]:
        span = segments(_edges(), _POINTS)
        return span.xi, span.weight

    def rule(self, n: int, edges: tuple[float, ...]) -> Span:
        own = np.array(_edges())
        # Ends of segments that are nearly at an edge of the beam are left out.
        far = np.min(np.abs(own[:, None] - np.array(edges[1:-1])), 1, initial=1.0) > 1e-9
        return segments(tuple(sorted({*own[far].tolist(), *edges})), _POINTS)


@dataclasses.dataclass(frozen=True)
class Finer(Layered):
    """The functions of `Layered`, then more polynomials and layers between those of `Layered`."""

    def bending(self, n: int, xi: _Array) -> Functions:
        return _at(n - more_functions() - LAYERS, True, xi)


def has_layers(basis: Basis | None) -> bool:
    """Whether a basis is `Layered`, or `Yielding` with it."""
    return isinstance(basis.basis if isinstance(basis, Yielding) else basis, Layered)


def massless(basis: Basis | None, dtype: Any) -> float:
    """A small number, over the mass of the beam, to be added to the diagonal of the mass matrix.

    Layers have less mass than rounding of the matrix, which might not be positive definite. With 50
    units of rounding it is, and relative changes of frequencies are at most kappa times that. Zero
    for bases without layers.
    """
    return 50 * float(jnp.finfo(dtype).eps) if has_layers(basis) else 0.0


def is_soft(rotor: Rotor, speed: Any) -> Any:
    """Whether a uniform beam, at a speed in rad/s, is so soft that 16 polynomials leave out more
    than 1e-6 of a frequency; false in 32 bits, which do not resolve that."""
    if jnp.finfo(jnp.result_type(speed)).bits <= 32:
        return False
    beam, least = rotor.beam, held_by(rotor, speed) / _STIFFEST**2
    return (least > beam.in_plane_bending_stiffness) | (least > beam.flap_bending_stiffness)


def is_known_to_be_soft(rotor: Rotor, speed: Any) -> bool:
    """Whether numbers are concrete and the beam is so soft that layers are needed."""
    # By NumPy, so that nothing is compiled.
    return is_concrete((rotor, speed)) and bool(is_soft(*jax.tree.map(np.asarray, (rotor, speed))))


def are_followed(counts: tuple[int, ...], rotor: Rotor, speed: Any) -> Any:
    """Whether so many polynomials in plane and in flap are enough, to some 1e-3, for the boundary
    layer at a clamp: n are if kappa is at most n^2."""
    beam, fine = rotor.beam, jnp.ones((), bool)
    stiffness = (beam.in_plane_bending_stiffness, beam.flap_bending_stiffness)
    for n, own, spring in zip(counts, stiffness, rotor.springs, strict=True):
        if n and spring is None:
            fine = fine & (held_by(rotor, speed) <= n**4 * own)
    return fine


def without_layers(basis: Basis) -> bool:
    """Whether a basis is `Polynomials()`, or `Yielding` with it."""
    return (basis.basis if isinstance(basis, Yielding) else basis) == Polynomials()


def with_layers(basis: Basis) -> Basis:
    """The basis of polynomials with `LAYERS` more functions, for boundary layers."""
    own = Layered()
    return dataclasses.replace(basis, basis=own) if isinstance(basis, Yielding) else own


def held_by(rotor: Rotor, speed: Any) -> Any:
    """The product P L^2 = kappa^2 EI of a uniform beam in steady rotation, P the tension at its
    root."""
    # By fields of the rotor, which may be numbers of NumPy, not by its properties, which use JAX.
    length, tip, end = rotor.beam.length, rotor.tip_body, rotor.hub_radius + rotor.beam.length
    c0, c1, c2 = tension(
        speed**2, rotor.hub_radius, tip.mass, rotor.beam.mass_per_length * length, length,
        tip_mass_radius=tip.centre(end, 1.0),
    )  # fmt: skip
    return (c0 + c1 + c2 / 2) * length**2


def more_functions() -> int:
    """The number of bending functions that `Finer` has beyond those of `Layered`."""
    return _MORE + LAYERS - 2


def _edges() -> tuple[float, ...]:
    near = 2.0 ** np.arange(-_HALVINGS, -_MIDDLE)
    middle = np.linspace(0.0, 1.0, 2**_MIDDLE + 1)
    return tuple(np.concatenate([[0.0], near, middle[1:-1], 1 - near[::-1], [1.0]]).tolist())


def _layers(xi: _Array, between: bool) -> list[_Array]:
    """Curvatures at places xi of the layers, or with `between` of layers between these."""
    columns = []
    for count, x in ((_ROOT, xi), (_TIP, 1 - xi)):
        kappas = np.geomspace(_STIFFEST, _SOFTEST, 2 * count - 1)[int(between) :: 2]
        columns += [np.exp(-kappa * x) * kappa**0.5 for kappa in kappas]
    return columns


def _curvatures(polynomials: int, finer: bool, xi: _Array) -> _Array:
    """Curvatures at places xi of all functions, before these are made orthonormal."""

    def degrees(first: int, last: int) -> list[_Array]:
        return [legendre.legval(2 * xi - 1, np.eye(last)[k]) for k in range(first, last)]

    columns = degrees(0, polynomials) + _layers(xi, False)
    if finer:
        columns += degrees(polynomials, polynomials + _MORE) + _layers(xi, True)
    return np.stack(columns, 1)


@functools.lru_cache(maxsize=16)
def _tables(polynomials: int, finer: bool) -> tuple[_Array, _Array, _Array]:
    """Values, slopes and curvatures of n functions at the points, (segments, points, n)."""
    if polynomials < 1:
        raise ValueError(f"Layered has {LAYERS} layers: take more bending functions than that")
    span = segments(_edges(), _POINTS)
    root = np.sqrt(span.weight)[:, None]
    q, r = np.linalg.qr(root * _curvatures(polynomials, finer, span.xi))
    curvature = q * np.sign(np.diag(r)) / root
    curvature = curvature.reshape(-1, _POINTS, curvature.shape[1])
    slope = _integrated(curvature)
    return _integrated(slope), slope, curvature


def _integrated(f: _Array) -> _Array:
    """The integral int_0^xi f at the points of each segment, from values of f there."""
    t, w = legendre.leggauss(_POINTS)
    half = np.diff(_edges())[:, None, None] / 2
    powers = legendre.legint(np.linalg.inv(legendre.legvander(t, _POINTS - 1)), lbnd=-1, axis=0)
    inside = legendre.legval(t, powers).T @ f * half
    whole = w @ f * half[:, 0]
    before: _Array = np.cumsum(whole, 0) - whole
    return inside + before[:, None]


def _at(polynomials: int, finer: bool, xi: _Array) -> Functions:
    edges, xi = np.array(_edges()), np.asarray(xi, float)
    where = np.clip(np.searchsorted(edges, xi, side="right") - 1, 0, edges.size - 2)
    nodes, _ = legendre.leggauss(_POINTS)
    t = 2 * (xi - edges[where]) / np.diff(edges)[where] - 1
    rows = legendre.legvander(t, _POINTS - 1) @ np.linalg.inv(
        legendre.legvander(nodes, _POINTS - 1)
    )
    return Functions(
        *(np.einsum("pi,pin->pn", rows, f[where]) for f in _tables(polynomials, finer))
    )
