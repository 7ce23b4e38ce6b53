"""The load at which a beam buckles, as a differentiable function of parameters.

At rest in the hub under loads that have a potential a beam is stable while its stiffness, about the
deformed state, is positive definite; damping only helps. So what comes first as the loads grow is
that K becomes singular: with the load along the beam its bending gives way (Euler), with a load
across in its stiff direction bending the other way and twist do together (lateral buckling).
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._checks import kind_of
from jaxbeam._models.base import AbstractModel, checked_case, equilibrium
from jaxbeam._models.families import Family
from jaxbeam._numerics.linalg import dense, lowest_eigenpair, solve
from jaxbeam._numerics.program import Program
from jaxbeam._results import harmless, without_derivatives
from jaxbeam._rotor.beam import AnyRotor
from jaxbeam._rotor.loads import Loads
from jaxbeam._rotor.motion import Hub, spinning
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Matrix, Scalar, Triple, Vector
from jaxbeam._vibration.singular import AbstractPlace, Groups, Scan, answer

_HELD = 1e-13  # lowest eigenvalue, over the diagonal, of what is held at all
# Loads that are looked at, over the softest stiffness of the tip times the length: up to twenty,
# from where a section that hardly resists torsion buckles. That of Euler's column is 0.82.
_LEAST, _LARGEST, _SCANNED = 1 / 60, 20.0, 48


class CriticalLoad(eqx.Module):
    """Where a beam at rest in the hub buckles.

    | field  | shape | unit |                                                                     |
    |--------|-------|------|---------------------------------------------------------------------|
    | factor | ()    |      | least factor of the loads at which the stiffness is singular;       |
    |        |       |      | infinite where there is none                                        |
    | family | ()    |      | `Family` of the coordinates that take most of the elastic energy of |
    |        |       |      | what gives way; without meaning where there is no such factor       |
    | shape  | (n,)  |      | the direction that gives way, largest entry 1                       |
    | status | ()    |      | `Status`                                                            |
    """

    factor: Scalar
    family: Code
    shape: Vector
    status: Code


def critical_load(
    model: AbstractModel,
    rotor: AnyRotor,
    loads: Loads,
    angular_speed: Any = 0.0,
    *,
    throw: bool = True,
) -> CriticalLoad:
    """The least factor of gravity and force at the tip, both constant in the hub, with which the
    beam buckles: K, at the equilibrium under the loads, is singular.

    The lowest eigenvalue of K is looked at for 48 loads, each 16 % above the last, from 1 / 60
    up to 20 times the softest stiffness of the tip times the length (3 EI / L^2 of the softer
    bending); its change of sign is then found to rounding. Infinity means that there is none up to
    there. It is differentiable by rotor, loads and speed, in both modes and to any order, as
    `critical_speed` is.

    Loads that follow the tip and moments at it have no potential, and may make a beam flutter
    first: `ValueError`, as for loads that change in time. `throw=False` returns failures in
    `CriticalLoad.status`, and NaN.
    """
    model, rotor, speed = checked_case(model, rotor, angular_speed)
    if not isinstance(loads, Loads):
        raise TypeError(f"loads must be of class Loads, got {kind_of(loads)}")
    if not loads.is_plain:
        raise ValueError(
            "loads: a moment, or a force that follows the tip, has no potential; where such a beam "
            "loses its stability, simulate says"
        )
    if callable(loads.tip_force):
        raise ValueError("loads.tip_force must be constant, shape (3,), got a function of time")
    if loads.tip_force is None and loads.gravity is None:
        raise ValueError("loads: there are none; give tip_force=... or gravity=...")
    none = jnp.zeros(3, speed.dtype)
    force, gravity = (none if a is None else a for a in (loads.tip_force, loads.gravity))
    result = _critical(model, rotor, speed, force, gravity)
    return raise_unless_ok(result, result.status) if throw else result


_Given = tuple[AnyRotor, Scalar, Triple, Triple]


@Program
def _critical(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, force: Triple, gravity: Triple
) -> CriticalLoad:
    status = rotor.status(speed)
    finite = jnp.all(jnp.isfinite(force)) & jnp.all(jnp.isfinite(gravity))
    status = jnp.where((status == Status.OK) & ~finite, Status.INVALID_LOAD, status)
    fine = status == Status.OK
    speed, force, gravity = (jnp.where(fine, a, 0.0) for a in (speed, force, gravity))
    given = harmless(fine, rotor), speed, force, gravity
    found, family, x, searched = _search(model, without_derivatives(given))
    status = jnp.where(fine, searched, status).astype(int)
    place = _Place(x=x, exists=jnp.isfinite(found) & (status == Status.OK), model=model)
    factor, shape = answer(place, given, found, status)
    return CriticalLoad(factor=factor, family=family, shape=shape, status=status)


class _Place(AbstractPlace):
    """A critical load."""

    x: Vector
    exists: Array
    model: AbstractModel

    def rest(self, given: _Given) -> Matrix:
        return _loaded(self.model, given, jnp.zeros_like(self.x[0]))[0]

    def stiffness(self, given: _Given, value: Scalar) -> Matrix:
        return _loaded(self.model, given, jnp.where(self.exists, value, 0.0))[0]


def _loaded(model: AbstractModel, given: _Given, factor: Scalar) -> tuple[Matrix, Code]:
    """K about the equilibrium under so many times the loads, and the status of the search."""
    rotor, speed, force, gravity = given
    equations, still = model.equations(rotor), spinning(speed)
    hub = Hub(*still[:4], factor * gravity)
    q, status = equilibrium(equations, hub, factor * force)
    k = dense(equations.tangents(hub, q, jnp.zeros_like(q), factor * force)[0])
    k = k / equations.as_force(q, jnp.ones_like(q))[:, None]
    return (k + k.T) / 2, status


def _search(model: AbstractModel, given: _Given) -> tuple[Scalar, Code, Vector, Code]:
    """Critical factor, family and direction, and a status."""
    rotor, speed, force, gravity = given
    k0, _ = _loaded(model, given, jnp.zeros_like(speed))
    equations = model.equations(rotor)
    ways = jax.jacfwd(equations.tip)(jnp.zeros(len(k0), speed.dtype))
    soft = ways @ jax.vmap(functools.partial(solve, k0), out_axes=1)(ways)
    softness = -lowest_eigenpair(-soft, jnp.eye(len(soft), dtype=soft.dtype))[0]
    weight = jnp.linalg.norm(force) + equations.rigid[0] * jnp.linalg.norm(gravity)
    unit = equations.size / (softness * jnp.where(weight > 0, weight, 1.0))
    groups = Groups((min(model.families),), (np.arange(len(k0)),))
    scan = Scan(
        lambda factor: _loaded(model, given, factor), groups, k0, _LARGEST * unit,
        (_LARGEST / _LEAST) ** (1 / (_SCANNED - 1)) * jnp.ones_like(speed), _SCANNED,
    )  # fmt: skip
    end = scan.run(_LEAST * unit, 0, jnp.ones_like(k0[0]))
    energy = end.x * (k0 @ end.x)
    shares = [jnp.sum(energy, where=np.equal(model.families, family)) for family in Family]
    factor = jnp.where(end.found, end.value, jnp.inf)
    # A beam on a free hinge at rest buckles at once or never, as the load would have it.
    size = jnp.sqrt(jnp.abs(jnp.diag(k0)))
    size = jnp.where(size > 0, size, 1.0)
    least, _ = lowest_eigenpair(k0 / (size[None] * size[:, None]), jnp.eye(len(k0), dtype=k0.dtype))
    status = jnp.where(least > _HELD, scan.status(end), Status.NOT_HELD)
    return factor, jnp.argmax(jnp.stack(shares)), end.x, status
