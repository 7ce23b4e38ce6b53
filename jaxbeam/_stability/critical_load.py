"""The load at which a beam buckles, as a differentiable function of parameters.

At rest in the hub under loads that have a potential a beam is stable while its stiffness, about the
deformed state, is positive definite; damping only helps. So what comes first as the loads grow is
that K becomes singular: with the load along the beam its bending gives way (Euler), with a load
across in its stiff direction bending the other way and twist do together (lateral buckling). Loads
that turn with the beam, and moments, have none, and it may flutter first: see `flutter.py`.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.equilibrium import Rest
from jaxbeam._models.contract.left_out import status_of_shape
from jaxbeam._models.contract.loaded import (
    Conditions,
    checked_conditions,
    equations_under,
    guarded_conditions,
)
from jaxbeam._models.contract.small_motion import small_motion
from jaxbeam._numerics.brackets import Looks
from jaxbeam._numerics.linalg import lowest_eigenpair, solve
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._programs.program import Program
from jaxbeam._results import InHertz, finish, nan_unless, replaced, without_derivatives
from jaxbeam._rotor.beam import AnyRotor, Rotor
from jaxbeam._rotor.damping import NO_DAMPING
from jaxbeam._rotor.directions import Direction, is_hinged, naming
from jaxbeam._rotor.first_look import acts_along, refuse
from jaxbeam._rotor.loads import Loads, are_along, only_pull
from jaxbeam._stability.flutter import LostPlace, first_lost, polished
from jaxbeam._stability.singular import (
    AbstractPlace,
    Groups,
    Scan,
    answer,
    direction_of_energy,
    gives_way,
)
from jaxbeam._status import Status, first_broken, first_failure
from jaxbeam._types import Code, Matrix, Scalar, Vector, is_concrete

# Least eigenvalue of K, scaled to ones on its diagonal, of a beam that counts as held.
_HELD = 1e-13
# Range of loads that are searched, and their number, over the softest stiffness of the tip times
# the length: up to twenty, from where a section of little torsional stiffness buckles. Euler's
# column has 0.82. Where the root yields they go on to as large a share of the stiffness of the
# clamped beam.
_LEAST, _LARGEST, _SCANNED = 1 / 60, 20.0, 48
_RATIO = (_LARGEST / _LEAST) ** (1 / (_SCANNED - 1))
# Factors by which a search goes beyond the expected load, and beyond its range at most.
_FURTHER, _MOST = 2.0, 1e3
# Largest ratio of the tip's softness to that with a clamped root by which a range is extended.
_MOST_YIELDING = 1e6
_NEAR = 1e-6  # relative distance of what bisection finds from the exact root


class CriticalLoad(InHertz, eqx.Module):
    """The load under which a beam at rest in the hub buckles.

    | field     | shape | unit  |                                                                  |
    |-----------|-------|-------|------------------------------------------------------------------|
    | factor    | ()    |       | least factor of the loads at which the beam loses its stability; |
    |           |       |       | infinite where there is none, however large                      |
    | direction | ()    |       | `Direction` of the coordinates that take most of the elastic     |
    |           |       |       | energy of what gives way; without meaning where there is no such |
    |           |       |       | factor                                                           |
    | shape     | (n,)  |       | the shape that gives way, largest entry 1                        |
    | frequency | ()    | rad/s | of the flutter that begins there; zero where the beam buckles    |
    |           |       |       | (divergence); without derivatives: those of it come out as zero  |
    | status    | ()    |       | `Status`                                                         |
    """

    factor: Scalar
    direction: Code
    shape: Vector
    frequency: Scalar
    status: Code


def critical_load(
    model: AbstractModel,
    rotor: AnyRotor,
    loads: Loads,
    angular_speed: Any = 0.0,
    *,
    throw: bool = True,
) -> CriticalLoad:
    """The least factor of loads with which the beam loses its stability: it buckles or flutters.

    `model` and `rotor` are those of `modes`; `loads` some, and constant; `angular_speed` in rad/s.
    Where the loads have a potential (gravity, a force in hub axes), K at the equilibrium under them
    is singular there, and the beam buckles.

    Of linear models K is affine in the factor, K_0 + factor K_1, and this is one eigenproblem. Only
    what is along the beam changes their stiffness: loads across are refused (`LOADS_ACROSS`). Of
    others the lowest eigenvalue of K is looked at for 48 loads, each 16 % above the last, from
    1 / 60 up to 20 times the softest stiffness of the tip times the length (3 EI / L^2 of the
    softer bending); its change of sign is then found to rounding. More loads are looked at where
    the root yields, up to where they would end if it were clamped, and up to twice the load at
    which K would be singular if it went on as it begins. Infinity means that there is none: loads
    along the beam that pull at every section only stiffen it. Otherwise a beam that is stable up to
    the last load has the status `SEARCH_ENDED`. The factor is differentiable by rotor, loads and
    speed, in both modes and to any order, as `critical_speed` is.

    Loads that turn with the beam, and moments at its tip, have no potential: at the least load two
    frequencies meet, from where the beam flutters, or one is zero (M. Beck, Zeitschrift fuer
    angewandte Mathematik und Physik 3, 1952). That is without damping, of which a little may well
    make it flutter sooner (H. Ziegler, Ingenieur-Archiv 20, 1952): ask `modes` with `damping`. It
    is found at rest alone, since with Coriolis forces the least of such loads makes some mode grow
    slowly: `NO_POTENTIAL` at speed.

    `throw=False` returns failures in `CriticalLoad.status`, and NaN.

    Raises as `modes` does, and `ValueError` for loads that change in time, or none.
    """
    model, rotor, speed = checked_case(model, rotor, angular_speed)
    conditions = checked_conditions(loads, NO_DAMPING, (model, rotor), (speed,), throw)
    if conditions is None:
        raise ValueError(
            "loads: there are none; give tip_force=..., gravity=... force_per_length=... or "
            "point_forces=..."
        )
    refuse(
        throw,
        (loads.has_potential or not (is_concrete(speed) and float(speed)), Status.NO_POTENTIAL),
        (not model.is_linear or acts_along(loads), Status.LOADS_ACROSS),
    )
    result = _critical(model, rotor, speed, conditions.loads)
    return finish(result, throw)


_Given = tuple[AnyRotor, Scalar, Loads]


@Program
def _critical(model: AbstractModel, rotor: AnyRotor, speed: Scalar, loads: Loads) -> CriticalLoad:
    status, rotor, speed, conditions = guarded_conditions(
        model, rotor, speed, Conditions(loads, NO_DAMPING)
    )
    assert conditions is not None
    if not loads.has_potential:
        status = first_failure(status, first_broken((speed == 0, Status.NO_POTENTIAL)))
    given = rotor, speed, conditions.loads
    find = _buckling if loads.has_potential else _lost
    found, direction, place, searched = find(model, without_derivatives(given))
    there = jnp.isfinite(found)
    few = jnp.where(there, status_of_shape(model, rotor, place.x), Status.OK)
    status = first_failure(status, searched, few)
    exists = there & (status == Status.OK)
    place = replaced(place, exists=exists)
    factor, shape = answer(place, given, found, status)
    frequency, there = jnp.zeros_like(factor), status == Status.OK
    if isinstance(place, LostPlace):
        square = place.flutters * place.square
        frequency, there = jnp.sqrt(jnp.where(square > 0, square, 0.0)), exists
    return CriticalLoad(factor, direction, shape, nan_unless(there, frequency), status)


class _CriticalLoadPlace(AbstractPlace):
    """The singular stiffness at a critical load, for loads that have a potential."""

    x: Vector
    exists: Array
    model: AbstractModel

    def rest(self, given: _Given) -> Matrix:
        return _loaded(self.model, given, jnp.zeros_like(self.x[0]))[1]

    def stiffness(self, given: _Given, value: Scalar) -> Matrix:
        return _loaded(self.model, given, jnp.where(self.exists, value, 0.0))[1]


def _loaded(model: AbstractModel, given: _Given, factor: Scalar) -> tuple[Matrix, Matrix, Code]:
    """The matrices M and K about the equilibrium under the loads times a factor, and the status of
    the search for it; linear models have the same K about any state."""
    rotor, speed, loads = given
    conditions = Conditions(loads, NO_DAMPING)
    equations = equations_under(model, rotor, loads)
    if equations.is_linear:
        still = Rest(jnp.zeros(len(model.directions), speed.dtype), jnp.asarray(int(Status.OK)))
        inputs = conditions.inputs(equations, speed, factor)
        system = small_motion(model, rotor, speed, equations, still, inputs)
    else:
        system = conditions.system(model, rotor, speed, factor)
    k = system.stiffness
    return system.mass, symmetric_part(k) if loads.has_potential else k, system.status


class _Unloaded(NamedTuple):
    """The stiffness `k` without loads, and the factors of loads that are searched: so many `looks`
    in geometric progression, from the `first` to the `last`."""

    k: Matrix
    first: Scalar
    last: Scalar
    looks: Array

    @classmethod
    def of(cls, model: AbstractModel, given: _Given) -> "_Unloaded":
        speed = given[1]

        def look(_: Any, state: tuple[Matrix, Matrix, Scalar, Scalar]) -> Any:
            """The stiffness K without loads, and then as it begins to change."""
            k0, _, unit, _ = state
            k = symmetric_part(_loaded(model, given, _LEAST * unit)[1])
            k0 = jnp.where(unit == 0, k, k0)
            return (k0, k, *_unit(model, given, k0))

        zero, n = jnp.zeros_like(speed), len(model.directions)
        k = jnp.zeros((n, n), speed.dtype)
        k0, k, unit, yields = jax.lax.fori_loop(0, 2, look, (k, k, zero, zero))
        straight, _ = gives_way(np.arange(n), (k - k0) / (_LEAST * unit), k0)
        last = _LARGEST * unit * yields
        further = jnp.clip(_FURTHER * straight, last, _MOST * last)
        last = jnp.where(jnp.isfinite(straight), further, last)
        looks = jnp.ceil(jnp.log(last / (_LEAST * unit)) / np.log(_RATIO) - 1e-6).astype(int)
        return cls(k0, _LEAST * unit, last, looks + 1)

    def held(self, rotor: AnyRotor, status: Code) -> Code:
        """The status of a search, which fails if the unloaded beam is not held: on a free hinge at
        rest it buckles at once or never, and at some speed a rod tears."""
        nowhere = Status.NOT_HELD if is_hinged(rotor) else Status.NO_EQUILIBRIUM
        size = jnp.sqrt(jnp.abs(jnp.diag(self.k)))
        size = jnp.where(size > 0, size, 1.0)
        scaled = self.k / (size[None] * size[:, None])
        least, _ = lowest_eigenpair(scaled, jnp.eye(len(scaled), dtype=scaled.dtype))
        return jnp.where(least > _HELD, status, nowhere)


def _unit(model: AbstractModel, given: _Given, k: Matrix) -> tuple[Scalar, Scalar]:
    """The factor of loads that deflect the tip by about a length, from the stiffness k without
    them; and the ratio to it of that with a clamped root."""
    rotor, speed, loads = given
    equations = model.equations(rotor)
    ways = model.displacement(np.ones(1), rotor)[:, 0]
    soft = ways @ jax.vmap(functools.partial(solve, k), out_axes=1)(ways)
    softness = -lowest_eigenpair(-soft, jnp.eye(len(soft), dtype=soft.dtype))[0]
    clamped = _softness(model, rotor, softness)
    yields = jnp.clip(softness / clamped, 1.0, _MOST_YIELDING)
    if rotor.tip_support is not None:
        softness = jnp.maximum(softness, clamped)  # the tip need not move where a beam buckles
    span = loads.span_moments(jnp.zeros_like(speed), equations.length)
    parts: Any = (
        (loads.tip_force, 1.0),
        (loads.gravity, equations.rigid_moments[0]),
        (loads.tip_moment, 1 / equations.length),
        (None if span is None else span[:2], 1.0),
    )
    weight = sum(jnp.linalg.norm(part) * unit for part, unit in parts if part is not None)
    return equations.length / (softness * jnp.where(weight > 0, weight, 1.0)), yields


def _softness(model: AbstractModel, rotor: AnyRotor, own: Scalar) -> Scalar:
    """The largest softness of the tip with a clamped root and without rotation, L^3 / (3 EI) of the
    `mean` beam, where the root yields or the tip is held; else its softness `own`."""
    if not isinstance(rotor, Rotor):
        return own
    supports = rotor.root_support, rotor.tip_support, *rotor.springs
    if all(support is None for support in supports):
        return own
    bends = [way in model.directions for way in (Direction.IN_PLANE, Direction.FLAP)]
    return 4 / 3 * rotor.beam.length * jnp.max(rotor.compliance[np.flatnonzero(bends)])


def _diagonal(k0: Matrix, k: Matrix) -> Matrix:
    """The diagonal of K where that is positive, as a scale of its eigenvalues. That of K_0 is none
    where loads move a beam far: K_0 may be axially stiff in a direction of bending."""
    own = jnp.diag(k)
    return jnp.diag(jnp.where(own > 0, own, jnp.diag(k0)))


def _buckling(model: AbstractModel, given: _Given) -> tuple[Scalar, Code, AbstractPlace, Code]:
    """The critical factor, direction and place for loads that have a potential, and a status."""
    if model.equations(given[0]).is_linear:
        return _affine(model, given)
    bare = _Unloaded.of(model, given)
    k0 = bare.k
    groups = Groups((naming(model.directions),), (np.arange(len(k0)),))
    scan = Scan(
        lambda factor: _loaded(model, given, factor)[1:], groups, functools.partial(_diagonal, k0),
        Looks(bare.first, _RATIO, bare.last, bare.looks),
    )  # fmt: skip
    end = scan.run(0, jnp.ones_like(k0[0]))
    # Loads that are tension everywhere never buckle a beam, unless its smooth functions have
    # compression beside a step of tension.
    pulls = only_pull(given[2], model.equations(given[0]).length)
    if given[0].tip_support is not None:
        pulls = jnp.asarray(False)  # its tip may be pushed against
    found = end.found & ~pulls
    factor = jnp.where(found, end.value, jnp.inf)
    place = _CriticalLoadPlace(x=end.kept.x, exists=found, model=model)
    searched = first_failure(scan.status(end), first_broken((end.found, Status.SEARCH_ENDED)))
    status = jnp.where(pulls, Status.OK, searched)
    return (
        factor,
        direction_of_energy(model.directions, k0, end.kept.x),
        place,
        bare.held(given[0], status),
    )


def _affine(model: AbstractModel, given: _Given) -> tuple[Scalar, Code, AbstractPlace, Code]:
    """The results of `_buckling` for linear models, whose stiffness only loads along the beam
    change, in proportion."""
    speed, loads = given[1:]
    zero, one = jnp.zeros_like(speed), jnp.ones_like(speed)
    k0, k1 = jax.jvp(lambda factor: _loaded(model, given, factor)[1], (zero,), (one,))
    bare = _Unloaded(k0, zero, zero, jnp.asarray(0))
    factor, x = gives_way(np.arange(len(k0)), k1, k0)
    status = first_broken(
        (are_along(loads, model.equations(given[0]).length), Status.LOADS_ACROSS),
        (~jnp.isnan(factor), Status.NOT_FINITE),
    )
    place = _CriticalLoadPlace(x=x, exists=jnp.isfinite(factor), model=model)
    direction = direction_of_energy(model.directions, k0, x)
    return factor, direction, place, bare.held(given[0], status)


def _lost(model: AbstractModel, given: _Given) -> tuple[Scalar, Code, AbstractPlace, Code]:
    """The critical load, direction, place and status for loads without a potential."""
    bare = _Unloaded.of(model, given)
    end = first_lost(
        lambda factor: _loaded(model, given, factor), len(bare.k), bare.first, _RATIO, bare.looks,
    )  # fmt: skip
    (mode, searched), upper = end.kept, end.b[0]

    def matrices(given: _Given, value: Scalar) -> tuple[Matrix, Matrix]:
        return _loaded(model, given, value)[:2]

    place = LostPlace(
        x=mode.right, exists=end.found, left=mode.left, square=mode.square,
        flutters=mode.flutters, k0=bare.k, matrices=matrices,
    )  # fmt: skip
    exact = polished(place, given, upper)
    near = jnp.abs(exact - upper) <= _NEAR * upper
    status = first_failure(
        searched,
        first_broken((end.found, Status.SEARCH_ENDED), (near, Status.INACCURATE)),
    )
    factor = jnp.where(end.found, exact, jnp.inf)
    return (
        factor,
        direction_of_energy(model.directions, bare.k, mode.right),
        place,
        bare.held(given[0], status),
    )
