"""The deflection at which a run ends."""

from typing import Any

import diffrax
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix

from jaxbeam._checks import positive
from jaxbeam._simulation.result import checked_point
from jaxbeam._simulation.scene import Scene
from jaxbeam._solvers.system import State
from jaxbeam._types import Scalar


def deflection_limit(limit: Any, direction: int = 1, xi: float = 1.0) -> diffrax.Event:
    """Event that ends a run where a deflection reaches `limit` (m, > 0) either way.

    It does so to rounding in time. `direction` 0, 1, 2: axial, in plane, flap, of the point x =
    `xi` L, 0 to 1. The last output is at the event. A run that starts beyond it ends where it comes
    back. Ends of steps tell: what goes beyond and comes back within one step is not seen, which is
    for limits within 1e-4 of a peak, and within some per cent where `stepsize_controller` allows
    errors of 1e-3. Give it to `simulate` as `event`.

    Raises `ValueError` or `TypeError` for a number out of range or of another kind.
    """
    return diffrax.Event(
        _Limit(positive("limit", limit), *checked_point(direction, xi)),
        optimistix.Newton(rtol=1e-10, atol=1e-10),
    )


class _Limit(eqx.Module):
    limit: Scalar
    direction: int = eqx.field(static=True)
    xi: float = eqx.field(static=True)

    def __call__(self, t: Scalar, y: State, args: Scene, **_: Any) -> Scalar:
        u = args.equations.displacement(y.q, np.array([self.xi]))[0, self.direction]
        return self.limit - jnp.abs(u)
