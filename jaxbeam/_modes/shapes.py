"""Shapes of modes as polynomials, as codes of wind turbines take them."""

import functools
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.loads import section_angle
from jaxbeam._numerics.linalg import largest, solve
from jaxbeam._results import replaced
from jaxbeam._rotor.beam import AnyRotor, Beam, Rotor
from jaxbeam._rotor.span import Span, on

POWERS = np.arange(2, 7)
_POINTS = 16  # between kinks


class ShapePolynomials(NamedTuple):
    """Polynomials c_2 xi^2 + ... + c_6 xi^6 that are one at the tip; of a batch with its axes in
    front.

    `coefficients` (k, 5) of k modes sum to one; `misfit` (k,) is the largest distance from the
    shape, at 16 points between kinks, over the largest deflection there. Both are NaN
    for modes of axial motion and torsion.
    """

    coefficients: Float[Array, "*batch k 5"]
    misfit: Float[Array, "*batch k"]


class PolynomialFit(NamedTuple):
    """The places at which shapes are looked at, and the values of each power there: in its own
    direction, and across."""

    xi: np.ndarray
    weight: np.ndarray
    own: Any  # (p, 5)
    across: Any  # (p, 5); None where sections are not turned

    def of(self, own: Array, across: Array) -> tuple[Array, Array]:
        """Coefficients and misfit of one mode, by its deflection (p,) its own way and across."""
        rows, wanted, weight = self.own, own, self.weight
        if self.across is not None:
            rows = jnp.concatenate([self.own, self.across])
            wanted, weight = jnp.concatenate([own, across]), np.tile(weight, 2)
        scaled = weight[:, None] * rows
        found = solve(jnp.asarray(rows.T @ scaled), scaled.T @ wanted)
        misfit = largest(jnp.abs(rows @ found - wanted)) / largest(jnp.abs(wanted))
        return found / jnp.sum(found), misfit


def fit(rotor: AnyRotor) -> PolynomialFit:
    """The fit to the deflection of a rotor's beam; where sections are turned, to what a curvature
    about their axes does.

    That is int int p'' cos(angle) its own way, and int int p'' sin(angle) across.
    """
    if isinstance(rotor, Rotor) and not isinstance(rotor.beam, Beam):
        rotor = replaced(rotor, beam=rotor.beam.beam())
    edges = rotor.beam.edges if isinstance(rotor, Rotor) else (0.0, 1.0)
    span = Span.between(edges, _POINTS)
    xi = np.asarray(span.xi)
    angle = None
    if isinstance(rotor, Rotor):
        angle = section_angle(rotor, functools.partial(on, span=span))
    if angle is None:
        return PolynomialFit(xi, np.asarray(span.weight), xi[:, None] ** POWERS[None], None)
    curved = (POWERS * (POWERS - 1))[None] * xi[:, None] ** (POWERS - 2)[None]
    both = [
        span.up_to(span.up_to(curved * part[:, None])) for part in (jnp.cos(angle), jnp.sin(angle))
    ]
    return PolynomialFit(xi, np.asarray(span.weight), *both)
