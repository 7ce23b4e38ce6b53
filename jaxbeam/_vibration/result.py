"""Modes of one case, or of a batch."""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from jaxbeam._models.families import Family, Label
from jaxbeam._types import Code, Scalar, Vectors


class Modes(eqx.Module):
    """k modes x e^(lambda t) of M q'' + G q' + K q = 0 with n coordinates.

    | field        | shape  | unit  |                                                            |
    |--------------|--------|-------|------------------------------------------------------------|
    | eigenvalue   | (k,)   | rad/s | lambda = growth_rate + i frequency, frequency >= 0         |
    | shape        | (k, n) | *     | x, scaled to unit modal mass; while stable the axial part  |
    |              |        |       | (of coned beams that of flap) is imaginary, the rest real  |
    | family       | (k,)   |       | `Family` of the mode as an integer                         |
    | order        | (k,)   |       | its number within the family, from 1                       |
    | energy_share | (k, 4) |       | share of kinetic energy: in plane, flap, axial, torsion    |
    | residual     | (k,)   |       | backward error: norm(Q x) / ((abs(lambda)^2 norm(M)        |
    |              |        |       | + abs(lambda) norm(G) + norm(K)) norm(x))                  |
    | status       | ()     |       | `Status`; unless OK the numbers are NaN, but for residual  |
    | steady_strain| ()     |       | see `LinearSystem`                                         |

    (*) kg^-1/2 for coordinates in metres.

    **Labels** do not depend on how a speed was reached. Without Coriolis coupling the modes at any
    speed fall into families, each with simple frequencies that never cross, so their numbers mean
    something. A coupled mode takes the label of the uncoupled mode *at the same speed* in which it
    has most of its kinetic energy, each label given once. Through a crossing or a veering a label
    therefore stays with the kind of motion; inside a veering it changes branch where the two
    branches share the motion equally. The position among the in-plane and axial modes in order of
    frequency is the label that follows a branch instead.
    """

    eigenvalue: Complex[Array, " k"]
    shape: Vectors
    family: Int[Array, " k"]
    order: Int[Array, " k"]
    energy_share: Float[Array, "k 4"]
    residual: Float[Array, " k"]
    status: Code
    steady_strain: Scalar

    @property
    def frequency(self) -> Float[Array, "... k"]:
        """Im(lambda) in rad/s; zero for a mode that diverges."""
        return self.eigenvalue.imag

    @property
    def growth_rate(self) -> Float[Array, "... k"]:
        """Re(lambda) in 1/s: positive for a mode that grows."""
        return self.eigenvalue.real

    @property
    def labels(self) -> tuple[Label, ...]:
        """Labels of the modes, once their values are known (not under `jit`); of a batch a tuple
        of these for each case."""
        return _named(np.asarray(self.family), np.asarray(self.order))


def _named(family: np.ndarray, order: np.ndarray) -> tuple[Any, ...]:
    pairs = zip(family, order, strict=True)
    if family.ndim > 1:
        return tuple(_named(*pair) for pair in pairs)
    return tuple(Label(Family(int(f)), int(k)) for f, k in pairs)
