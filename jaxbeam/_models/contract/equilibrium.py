"""Where a beam rests in its hub."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from jaxbeam._models.contract.span_integrals import AbstractSpanForce
from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._numerics.linalg import dense
from jaxbeam._numerics.newton import find_root
from jaxbeam._rotor.motion import Hub
from jaxbeam._status import Status
from jaxbeam._types import Code, Coordinates, Matrix, Scalar, Vector


class Rest(NamedTuple):
    """A state of rest: its coordinates, the status of the search for it, and, if the search has
    them, the matrices of mass, of rates and of stiffness for small motion about it, with `lacking`
    and `taken_along` as of `LinearSystem`."""

    q: Coordinates
    status: Code
    matrices: tuple[Matrix, Matrix, Matrix] | None = None
    lacking: Matrix | None = None
    taken_along: Matrix | None = None


def equilibrium(
    equations: Any, hub: Hub, tip_force: Any = None, span: AbstractSpanForce | None = None
) -> Rest:
    """Coordinates at which the beam rests in a hub whose motion does not change, and a `Status`.

    Newton's method with the load raised from zero in adaptive steps where one step will not do;
    where that ends in none that is stable, one is looked for that is (see `find_root`), as of a
    blade that only the centrifugal load holds on its hinge. Differentiable by the implicit function
    theorem. `hub` is taken as it is at this moment.
    """
    rest = jnp.zeros(equations.mass.shape[0], equations.length.dtype)
    scale = equations.energy_scale / equations.length

    def share(fraction: Scalar | float) -> tuple[Hub, Any, Any]:
        """A share of the load: the motion of the hub, and what acts at the tip and the span."""
        root = jnp.sqrt(fraction)  # loads are quadratic in the velocities, linear in all else
        part = Hub(
            root * hub.velocity, root * hub.angular_velocity, fraction * hub.velocity_rate,
            fraction * hub.angular_velocity_rate, fraction * hub.gravity,
        )  # fmt: skip
        return part, *jax.tree.map(lambda part: fraction * part, (tip_force, span))

    def residual(q: Coordinates, fraction: Scalar | float = 1.0) -> Vector:
        return -equations.force_under(share(fraction), equations.length * q, rest) / scale

    def jacobian(q: Coordinates, fraction: Scalar) -> Any:
        k, _ = equations.tangents_under(share(fraction), equations.length * q, rest)
        return (equations.length / scale) * k

    # A support of the size of the loads on the undeformed beam, in proportion to its mass matrix.
    load = jnp.max(jnp.abs(residual(rest)))
    inertia = dense(equations.mass) / equations.as_force(rest, jnp.ones_like(rest))[:, None]
    support = jax.lax.stop_gradient(inertia * load / jnp.max(jnp.abs(inertia)))
    # The Jacobian of elements costs much less than derivatives by one unknown after the other.
    by_elements = isinstance(equations.mass, BlockTridiagonal)
    q, done = find_root(residual, rest, support=support, jacobian=jacobian if by_elements else None)
    q = equations.length * q
    status = jnp.where(equations.is_in_range(q), Status.OK, Status.OUT_OF_RANGE)
    status = jnp.where(equations.is_unfolded(q), status, Status.NO_EQUILIBRIUM)
    return Rest(q, jnp.where(done < 1, Status.NOT_CONVERGED, status))
