"""What solvers of second-order systems share: one step as a function of time, and its work."""

import abc
import functools
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Self

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._numerics.kinematics import Kinematics
from jaxbeam._programs.kernel import Adjoint, in_reverse_mode, kernel
from jaxbeam._programs.lanes import append_axes, sum_of_products
from jaxbeam._results import without_derivatives
from jaxbeam._solvers.system import SecondOrderSystem, State
from jaxbeam._types import Coordinates, Number, Vector

_NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
_NODES, WEIGHTS = (1 + _NODES) / 2, WEIGHTS / 2
_PLACES = np.array([0.0, *_NODES, 1.0])
# From values at the nodes to coefficients of s, ..., s^4 of the integral of the cubic there.
_INTEGRAL = np.linalg.inv(np.vander(_NODES, increasing=True)) / np.arange(1, 5)[:, None]


class Interpolation(diffrax.AbstractLocalInterpolation):
    """The state along a step, as a function of the share s of it that has passed."""

    t0: Any  # type: ignore[misc]
    t1: Any  # type: ignore[misc]
    y0: State

    @abc.abstractmethod
    def at(self, s: Number) -> State:
        """The state at the time t0 + s (t1 - t0) within the step."""

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> Any:
        """The value at t0, or the increment from t0 to t1, as diffrax asks for it."""
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        return self.at((t0 - self.t0) / length(self.t0, self.t1))


class StepPolynomial(Interpolation):
    """The polynomial y0 + bends_1 s + bends_2 s^2 + ... along a step. Unlike Hermite's cubic
    through the ends, what solvers put in here does not amplify what is stiff."""

    coefficients: State  # with a leading axis

    def at(self, s: Number) -> State:
        powers = s ** np.arange(1, len(self.coefficients.work) + 1)
        return jax.tree.map(lambda y, c: y + powers @ c, self.y0, self.coefficients)


class SecondOrderSolver(diffrax.AbstractAdaptiveSolver):
    """A solver for `SecondOrderSystem`, given as `args`."""

    term_structure: ClassVar = diffrax.ODETerm

    def error_order(self, terms: Any) -> Any:
        """Order of the local error of an embedded method that is one order lower."""
        return self.order(terms)

    def init(self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem) -> Any:
        """Nothing is kept from step to step."""

    def func(self, terms: Any, t0: Any, y0: State, args: SecondOrderSystem) -> State:
        """The first-order right-hand side."""
        return args.rate(t0, y0)


def length(t0: Any, t1: Any) -> Array:
    """The length of a step. In a batch, lanes that are done go on with steps of zero, whose results
    are thrown away; dividing by zero, or overflow in a long step, would still leave NaN in
    gradients."""
    return jnp.where(t1 == t0, 1e-9, t1 - t0)


class Linearised(NamedTuple):
    """A system about the state in which a step begins, for stages whose share of it is g.

    With D, B and N of `Kinematics` (g, 1 and 1 where q' = v), changes u of coordinates and z of
    velocities by rates f and forces F solve

        u = D (f + B z),  A z = F - K N D f,   A = M / g + C + K N D B.
    """

    k: Any  # the tangent K
    kinematics: Kinematics
    solve: Any  # A^-1

    @classmethod
    def of(
        cls,
        system: SecondOrderSystem,
        q: Coordinates,
        v: Vector,
        g: Number,
        tangents: tuple[Any, Any],
    ) -> Self:
        """The system about q and v, where it has the tangents K and C."""
        k, c = tangents
        kinematics = system.stage_kinematics(q, v, g)
        return cls(
            k, kinematics, kinematics.inverse(system.mass / g + c + kinematics.eliminated(k))
        )

    def change(self, rates: Coordinates, force: Vector) -> Array:
        """The changes u and z, side by side, by rates of coordinates and a force."""
        kinematics = self.kinematics
        z = self.solve @ (force - self.k @ kinematics.seen(kinematics.before(rates)))
        return jnp.concatenate([kinematics.change(rates, z), z])


Core = Any  # a function of a solver, a system and arrays


def run_core(
    core: Core, solver: SecondOrderSolver | None, system: SecondOrderSystem, *arrays: Any,
    adjoint: Adjoint | None = None,
) -> Any:  # fmt: skip
    """The result of core(solver, system, *arrays), by a `kernel` where the system allows it; then
    the core must not ask the system for its inputs.

    The functions of an `adjoint`, if there is one, take the solver before what `Adjoint` says; the
    arguments are (system, *arrays).
    """
    part = system.kernel
    if part is not None:
        leaves, tree = jax.tree.flatten(part)
        return _kernel(core, solver, tree, adjoint)(leaves, *arrays)
    if adjoint is None or not in_reverse_mode():
        return core(solver, system, *arrays)
    return _with_adjoint((system, *arrays), solver, adjoint)


@functools.lru_cache(maxsize=100)
def _kernel(
    core: Core, solver: SecondOrderSolver | None, tree: Any, adjoint: Adjoint | None
) -> Callable[..., Any]:
    def of(function: Core) -> Core:
        return lambda leaves, *arrays: function(solver, jax.tree.unflatten(tree, leaves), *arrays)

    if adjoint is None:
        return kernel(of(core))
    forwards, backwards = adjoint

    def back(moving: Any, args: Any, kept: Any, out: Any) -> Any:
        moving, args = ((jax.tree.unflatten(tree, a[0]), *a[1:]) for a in (moving, args))
        return backwards(solver, moving, args, kept, out)

    return kernel(of(core), adjoint=Adjoint(of(forwards), back))


@eqx.filter_custom_vjp
def _with_adjoint(args: Any, solver: SecondOrderSolver | None, adjoint: Adjoint) -> Any:
    return adjoint.forwards(solver, *args)[0]


@_with_adjoint.def_fwd
def _forwards(
    perturbed: Any, args: Any, solver: SecondOrderSolver | None, adjoint: Adjoint
) -> tuple[Any, Any]:
    out, kept = adjoint.forwards(solver, *args)
    return out, (kept, jax.tree.map(jnp.zeros_like, out))


@_with_adjoint.def_bwd
def _backwards(
    residuals: Any, out: Any, perturbed: Any, args: Any, solver: SecondOrderSolver | None,
    adjoint: Adjoint,
) -> Any:  # fmt: skip
    kept, zeros = residuals
    out = jax.tree.map(
        lambda o, zero: zero if o is None else o, out, zeros, is_leaf=lambda o: o is None
    )
    return adjoint.backwards(solver, perturbed, args, kept, out)


def inputs_along(system: SecondOrderSystem, t0: Number, h: Number) -> Any:
    """Inputs at the start of a step, at the four points of Gauss with `WEIGHTS`, and at its end."""
    return without_derivatives(jax.vmap(system.inputs)(t0 + h * _PLACES))


def step_inputs(
    system: SecondOrderSystem, stages: Float[Array, " s"], t0: Number, h: Number
) -> tuple[Any, Any]:
    """Inputs at the times of the stages, and at those where `work_along` wants them, which carry no
    derivatives."""
    found = jax.vmap(system.inputs)(jnp.concatenate([stages, t0 + h * _NODES]))
    s = stages.size
    between = without_derivatives(jax.tree.map(lambda a: a[s:], found))
    return jax.tree.map(lambda a: a[:s], found), between


def work_along(
    system: SecondOrderSystem,
    inputs: Any,
    h: Number,
    y0: State,
    coefficients: Float[Array, "b m *lanes"],
) -> Float[Array, "4 *lanes"]:
    """Work along a `StepPolynomial` of q and v side by side, as coefficients of its own.

    By quadrature: the work drives nothing, so it needs no stages of its own, and it carries no
    derivatives.
    """
    n = len(y0.q)
    system, inputs, h, start, along = without_derivatives(
        (system, inputs, h, jnp.concatenate([y0.q, y0.v]), coefficients)
    )
    states = start[None] + combined(_NODES[:, None] ** np.arange(1, len(coefficients) + 1), along)
    power = jax.vmap(lambda x, y: system.power(x, y[:n], y[n:]))(inputs, states)
    return h * combined(_INTEGRAL, power[:, None])[:, 0]


def combined(weights: Any, rows: Float[Array, "s n *lanes"]) -> Float[Array, "r n *lanes"]:
    """Sums of s rows with weights (r, s)."""
    return sum_of_products(append_axes(weights, rows.ndim - 1), rows[None], 1, rows.ndim - 2)


def step_result(
    y0: State, end: Float[Array, " m"], error: Float[Array, " m"],
    coefficients: Float[Array, "b m *lanes"], work: Float[Array, " 4"],
) -> tuple[State, State, dict[str, State]]:  # fmt: skip
    """End, error and `StepPolynomial` of a step, from those of q and v side by side."""
    n, m = y0.q.size, len(coefficients)
    info = {
        "y0": y0,
        "coefficients": State(coefficients[:, :n], coefficients[:, n:], jnp.pad(work, (0, m - 4))),
    }
    off = State(error[:n], error[n:], jnp.zeros_like(y0.work))
    return State(end[:n], end[n:], y0.work + jnp.sum(work)), off, info
