"""Parameters from measurements: least squares, what is sure about them, and what is not."""

import functools
import sys
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import optimistix
from jaxtyping import Array

from jaxbeam._checks import check_kind, count_functions, kind_of, real_scalar
from jaxbeam._fitting.bounds import (
    CLOSE,
    decomposed,
    gain,
    least_certain,
    others_arrived,
    rooms,
    settled,
    units,
)
from jaxbeam._fitting.experiments import Experiment
from jaxbeam._fitting.free import FreeParameter, values_of
from jaxbeam._fitting.result import (
    UNSURE,
    Experiments,
    Fit,
    Problem,
    excess_of,
    uncertainty,
)
from jaxbeam._numerics.newton import value_and_jacobian
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, nan_unless
from jaxbeam._status import Status, first_broken
from jaxbeam._types import is_concrete

# Gain of the sum of squares, absolute plus relative, below which a search has converged.
_ENOUGH = 1e-10


class Descent(NamedTuple):
    """First-order search from many starts at once: `optimiser` of optax, for `steps`.

    The `starts`, so many, lie within `starts_within` of the guess in the variables of the search: a
    factor of e each way by default, in a Latin hypercube.
    """

    optimiser: optax.GradientTransformation = optax.adam(0.05)
    starts: int = 16
    steps: int = 150
    starts_within: float = 1.0


def fit(
    experiments: Experiments,
    free: dict[str, FreeParameter],
    *,
    descent: Descent | None = None,
    solver: Any = None,
    max_steps: int = 100,
    known_noise: bool = True,
    seed: int = 0,
    progress: bool | None = None,
    throw: bool = True,
) -> Fit:
    """The parameters that explain the measurements best.

    `experiments(**parameters)` returns one `Experiment` or several, built with the parameters as
    scalars; an `equinox.Module` with the data as leaves compiles once for all data of one shape.
    `free` names the parameters. The sum of squared residuals over the noise, and of priors, is
    minimised: by Levenberg-Marquardt from the guess. Where that does not converge, or leaves
    residuals that the noise does not explain (the sum five standard deviations above what is
    expected), 16 starts around the guess (`Descent`) go downhill in one batch and
    Levenberg-Marquardt goes on from the best; the better of the two ends is kept. With a `descent`
    given that happens at once. `solver` is a least-squares solver of optimistix: it stops where
    both the sum of squares and the variables of the search change by less than 1e-10, absolute
    plus relative, or after `max_steps`, which is no failure where a step of Gauss and Newton would
    gain less than that. A parameter that the data press against a bound is put there and named in
    `Fit.at_bound`; all others are found, judged and given intervals as if it were known. `seed`,
    an int, draws the starts; `progress` (by default on a terminal) tells of each search on stderr.

    The covariance is that of Gauss and Newton, (J^T J)^-1. With `known_noise=False` only the
    relative size of the noise is believed and its level taken from the residuals, which priors
    would not bear. A direction in which the standard deviation is as large as the parameters, or
    in which the Jacobian is singular, gives `NOT_IDENTIFIABLE`; in `Fit.partial` its parameters are
    as near the guess as the search left them, their deviations large or infinite.

    Under `jax.vmap` and `jax.jit` (a batch of data: build the experiments from it inside) there is
    no second search, unless `descent` asks for one. `throw=False` leaves failures in `Fit.status`,
    with NaN for parameters and deviations, and the best found in `Fit.partial`: use it for batches.

    Raises `ValueError` or `TypeError` for malformed arguments and fewer numbers than parameters,
    and `RuntimeError` unless the status is `OK`.
    """
    _check_kinds(experiments, free, max_steps, solver)
    problem = Problem(experiments, dict(sorted(free.items())))  # sorted by name, as JAX does
    _check_problem(problem, known_noise, descent)
    solver = optimistix.LevenbergMarquardt(rtol=_ENOUGH, atol=_ENOUGH) if solver is None else solver
    search = _FitSearch(problem, solver, max_steps, known_noise, descent)
    found = search.best(jax.random.key(seed), progress)
    # The error says which parameters, and what is known of them.
    return finish(found, throw, noted=True)


def _check_kinds(experiments: Any, free: Any, max_steps: Any, solver: Any) -> None:
    """Raise `TypeError` or `ValueError` unless arguments are of the right kinds."""
    if not callable(experiments):
        raise TypeError(f"experiments must be a function of the parameters, got {experiments!r}")
    if not isinstance(free, dict) or not free:
        raise ValueError("free must be a dict that names one parameter at least")
    count_functions("max_steps", max_steps, least=1)
    if solver is not None and not isinstance(
        solver, optimistix.AbstractLeastSquaresSolver | optimistix.AbstractMinimiser
    ):
        raise TypeError(f"solver must be a least-squares solver, got {kind_of(solver)}")
    for name, each in free.items():
        if not isinstance(name, str):
            raise TypeError(f"free must name parameters by texts, got {name!r}")
        if not isinstance(each, FreeParameter):
            raise TypeError(f"free[{name!r}] must be a FreeParameter, got {type(each).__name__}")


def _check_problem(problem: Problem, known_noise: bool, descent: Any) -> None:
    """Raise `ValueError` unless there are experiments, with enough measurements for the
    parameters."""
    free = problem.free
    guessed = problem.named({name: each.guess for name, each in free.items()})
    for experiment in guessed:
        if not isinstance(experiment, Experiment):
            raise TypeError("experiments must return an Experiment or several of them")
    if not known_noise and any(each.prior is not None for each in free.values()):
        raise ValueError("a prior is in units of the parameter: it needs known_noise=True")
    if descent is not None:
        _check_descent(descent)
    count = problem.count(guessed)
    concrete = is_concrete(count)
    if concrete and int(count) < len(free):
        raise ValueError(
            f"{int(count)} numbers measured are too few for {len(free)} parameters: measure more, "
            "fix some, or give a prior"
        )
    if concrete and not known_noise and int(count) == len(free):
        raise ValueError("with as many numbers as parameters nothing tells the level of the noise")


def _check_descent(descent: Any) -> None:
    check_kind("descent", descent, Descent)
    count_functions("descent.starts", descent.starts, least=1)
    count_functions("descent.steps", descent.steps, least=1)
    real_scalar("descent.starts_within", descent.starts_within)
    if not isinstance(descent.optimiser, optax.GradientTransformation):
        got = kind_of(descent.optimiser)
        raise TypeError(f"descent.optimiser must be an optimiser of optax, got {got}")


class _FitSearch(NamedTuple):
    """The search for the parameters, after the arguments of `fit` have been checked."""

    problem: Problem
    solver: Any
    max_steps: int
    known_noise: bool
    descent: Descent | None

    def best(self, key: Any, progress: bool | None) -> Fit:
        """The result of the search from the guess, or after a `descent` the better one of two."""
        first = self.refined(jnp.asarray(np.zeros(len(self.problem.free))))
        traced = not is_concrete(first)
        shown = (sys.stderr.isatty() if progress is None else progress) and not traced
        descent = self.descent
        if not traced:
            told = f"{float(first.reduced_chi_squared):.3g} after {int(first.steps)} steps"
            told = f"reduced chi squared {told}"
            _tell(shown, f"from the guess: {told}")
            descent = Descent() if descent is None and _is_poor(first) else descent
        if descent is None:
            return first
        other = self.refined(_descend(self.problem, descent, key))
        if not traced:
            told = f"reduced chi squared {float(other.reduced_chi_squared):.3g}"
            _tell(shown, f"from the best of {descent.starts} starts: {told}")
        return _better(first, other)

    def refined(self, z: Array) -> Fit:
        """The point at which Levenberg-Marquardt, or the solver given, ends from a start."""
        return _refine(self.problem, z, self.solver, self.max_steps, self.known_noise)


def _is_poor(found: Fit) -> bool:
    """Whether a fit with known noise has failed, or leaves more than the noise explains."""
    if int(found.status) in (Status.FIT_NOT_CONVERGED, Status.NOT_FINITE):
        return True
    reduced_chi_squared, degrees_of_freedom = map(
        np.asarray, (found.reduced_chi_squared, found.degrees_of_freedom)
    )
    return found.known_noise and bool(excess_of(np, reduced_chi_squared, degrees_of_freedom) > 5)


def _better(first: Fit, other: Fit) -> Fit:
    """The better of two results; of equal ones that which has converged."""
    lower = other.reduced_chi_squared < first.reduced_chi_squared * (1 - 1e-6)
    ended = (first.status == Status.FIT_NOT_CONVERGED) & (other.status != first.status)
    level = other.reduced_chi_squared <= first.reduced_chi_squared * (1 + 1e-6)
    better = ~jnp.isfinite(first.reduced_chi_squared) | lower | (ended & level)
    return jax.tree.map(lambda a, b: jnp.where(better, b, a), first, other)


def _tell(shown: bool, text: str) -> None:
    if shown:
        print(f"fit {text}", file=sys.stderr, flush=True)


@eqx.filter_custom_jvp
def _residual(z: Array, residual: Any) -> Array:
    """The residual at z, whose derivative is linear in the rates of z as it stands.

    The solver asks for values now and derivatives later (`jax.linearize`), but rates go along with
    the steps of a run. So its Jacobian is made at once with the values.
    """
    return residual(z)


@_residual.def_jvp
def _(primals: Any, tangents: Any) -> tuple[Array, Array]:
    (z, residual), (rate, change) = primals, tangents
    value, jacobian = value_and_jacobian(residual, z)
    by_z = jnp.zeros_like(value) if rate is None else jacobian @ rate
    if not jax.tree.leaves(change):
        return value, by_z
    return value, by_z + eqx.filter_jvp(lambda f: f(z), (residual,), (change,))[1]


@functools.partial(Program, calls=0)
def _refine(problem: Problem, z: Array, solver: Any, max_steps: int, known_noise: bool) -> Fit:
    m = z.size
    # Arrays that it closes over become leaves.
    closed = eqx.filter_closure_convert(problem.residual, z)
    found: Any = optimistix.least_squares(
        _residual, solver, z, closed, {"jac": "fwd"}, max_steps=max_steps, throw=False,
    )  # fmt: skip
    z, residual, jacobian, side = settled(problem, found.value)
    held = side != 0
    experiments = problem.experiments_at(z)
    degrees_of_freedom = jnp.asarray(problem.count(experiments) - m)
    square = jnp.sum(residual**2)
    reduced_chi_squared = square / jnp.maximum(degrees_of_freedom, 1)
    level = jnp.where(degrees_of_freedom < 1, jnp.inf, jnp.sqrt(reduced_chi_squared))
    scale = jnp.ones_like(level) if known_noise else level
    finite = jnp.all(jnp.isfinite(jacobian)) & jnp.isfinite(square)
    slope, unit = units(problem.free, z)
    by_unit = jnp.where(finite, jacobian * (unit / slope)[None], 0.0)
    along, certainty, combinations = decomposed(by_unit, held)
    # Where the gain is within rounding, no step counts as downhill, and the solver goes on until it
    # gives up.
    arrived = gain(residual, along, certainty) <= _ENOUGH * (1 + square)
    standard_deviation, covariance = uncertainty(certainty, combinations, unit, scale)
    room = rooms(problem.free, z)
    near = jnp.isfinite(standard_deviation) & (jnp.min(room, 0) < CLOSE * standard_deviation)
    at_bound = jnp.where(near & ~held, jnp.where(room[0] < room[1], -1, 1), side)
    arrived |= others_arrived(residual, by_unit, at_bound != 0, scale)
    ended = (found.result == optimistix.RESULTS.successful) | arrived
    sure = least_certain(certainty, combinations, held) >= scale * UNSURE
    status = first_broken(
        (finite, Status.NOT_FINITE),
        (ended, Status.FIT_NOT_CONVERGED),
        (sure, Status.NOT_IDENTIFIABLE),
    )
    numbers = (values_of(problem.free, z), standard_deviation, covariance)
    values, standard_deviation, covariance = nan_unless(status == Status.OK, numbers)
    names, residuals, start = list(problem.free), [], 0
    for each in experiments:
        own = residual[start : start + each.measured.size].reshape(each.measured.shape)
        residuals.append(jnp.where(each.present, own, jnp.nan))
        start += own.size
    return Fit(
        parameters=values,
        standard_deviation={name: standard_deviation[i] for i, name in enumerate(names)},
        covariance=covariance,
        residuals=tuple(residuals),
        reduced_chi_squared=jnp.where(finite, reduced_chi_squared, jnp.nan),
        degrees_of_freedom=degrees_of_freedom,
        certainty=certainty,
        combinations=combinations,
        parameter_scale=unit,
        at_bound=dict(zip(names, at_bound, strict=True)),
        steps=found.stats["num_steps"],
        status=status,
        free=problem.free,
        z=z,
        scale=scale,
        known_noise=known_noise,
    )


@functools.partial(Program, calls=0)
def _descend(problem: Problem, descent: Descent, key: Any) -> Array:
    """The best of the points at which descents from all starts end."""
    n, m = descent.starts, len(problem.free)
    # A Latin hypercube: each parameter takes n evenly spread values, each once, in a random order
    # of its own.
    order, within = jax.random.split(key)
    rows = jax.vmap(lambda k: jax.random.permutation(k, n), out_axes=1)(jax.random.split(order, m))
    away = descent.starts_within * (2 * (rows + jax.random.uniform(within, (n, m))) / n - 1)
    starts = away.at[0].set(0.0)

    def loss(z: Array) -> tuple[Array, Array]:
        residual, jacobian = problem.with_jacobian(z)
        gradient = jacobian.T @ residual
        return jnp.sum(residual**2) / 2, jnp.where(jnp.isfinite(gradient), gradient, 0.0)

    def one(z: Array) -> tuple[Array, Array]:
        def step(carry: Any, _: None) -> tuple[Any, None]:
            z, state, best, least = carry
            value, gradient = loss(z)
            better = value < least
            best, least = jnp.where(better, z, best), jnp.where(better, value, least)
            update, state = descent.optimiser.update(gradient, state, z)
            return (optax.apply_updates(z, update), state, best, least), None

        begin = (z, descent.optimiser.init(z), z, jnp.asarray(jnp.inf))
        (_, _, best, least), _ = jax.lax.scan(step, begin, None, length=descent.steps)
        return best, least

    ends, least = jax.vmap(one)(starts)
    return ends[jnp.argmin(least)]
