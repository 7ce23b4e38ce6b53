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
_POINTS = 16  # points of a fit in each piece between kinks


class ShapePolynomials(NamedTuple):
    """Polynomials c_2 xi^2 + ... + c_6 xi^6 that are one at the tip; results of a batch have its
    axes in front.

    `coefficients` (k, 5) of k modes sum to one; `misfit` (k,) is the largest distance from the
    shape, at 16 points between kinks, over the largest deflection there. Both are NaN
    for modes of axial motion and torsion.
    """

    coefficients: Float[Array, "*batch k 5"]
    misfit: Float[Array, "*batch k"]


class PolynomialFit(NamedTuple):
    """Places x / L of a fit, weights of integration, and the deflection that each power xi^2 to
    xi^6 stands for: in the direction of the mode, and across it."""

    xi: np.ndarray  # (p,)
    weight: np.ndarray  # (p,)
    main: Any  # (p, 5)
    across: Any  # (p, 5); None where sections are not turned

    def fitted(self, main: Array, across: Array) -> tuple[Array, Array]:
        """Coefficients and misfit of one mode, by its deflections (p,) in its own direction and
        across."""
        rows, wanted, weight = self.main, main, self.weight
        if self.across is not None:
            rows = jnp.concatenate([self.main, self.across])
            wanted, weight = jnp.concatenate([main, across]), np.tile(weight, 2)
        scaled = weight[:, None] * rows
        found = solve(jnp.asarray(rows.T @ scaled), scaled.T @ wanted)
        misfit = largest(jnp.abs(rows @ found - wanted)) / largest(jnp.abs(wanted))
        return found / jnp.sum(found), misfit


def fit(rotor: AnyRotor) -> PolynomialFit:
    """The places and powers of a fit for a rotor's beam.

    Where sections are turned by an angle, p'' is a curvature about their axes: it makes the
    deflections int int p'' cos(angle) in the direction of the mode, and int int p'' sin(angle)
    across it.
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
    deflections = [
        span.up_to(span.up_to(curved * component[:, None]))
        for component in (jnp.cos(angle), jnp.sin(angle))
    ]
    return PolynomialFit(xi, np.asarray(span.weight), *deflections)
