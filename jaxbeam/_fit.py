"""Parameters from measurements: least squares, what is sure about them, and what is not."""

import dataclasses
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.stats as stats
import numpy as np
import optax
import optimistix
from jaxtyping import Array, Float

from jaxbeam._beam import kind_of, known, real_scalar
from jaxbeam._experiments import Experiment, residuals_of
from jaxbeam._free import Free, values_of
from jaxbeam._models.base import count_functions
from jaxbeam._results import per_case, where_known
from jaxbeam._status import Status
from jaxbeam._types import Code, Scalar

Experiments = Callable[..., Experiment | Sequence[Experiment]]


class _Problem(eqx.Module):
    """Residuals as a function of z, with those of priors at the end."""

    experiments: Experiments
    free: dict[str, Free]

    def listed(self, z: Array) -> list[Experiment]:
        return self.named(values_of(self.free, z))

    def named(self, values: dict[str, Scalar]) -> list[Experiment]:
        found = self.experiments(**values)
        return list(found) if isinstance(found, list | tuple) else [found]  # type: ignore[list-item]

    def residual(self, z: Array, _: Any = None) -> Array:
        parts = residuals_of(self.listed(z))
        for i, free in enumerate(self.free.values()):
            if free.prior is not None:
                mean, deviation = free.prior
                parts.append((free.value(z[i]) - mean)[None] / deviation)
        return jnp.concatenate(parts)

    def with_jacobian(self, z: Array) -> tuple[Array, Array]:
        """Residuals and their derivatives, from one run of the models."""
        jacobian, residual = jax.jacfwd(lambda z: (self.residual(z),) * 2, has_aux=True)(z)
        return residual, jacobian

    def count(self, experiments: list[Experiment]) -> Any:
        """Of numbers measured, priors among them; in NumPy if they are known."""
        present = [known(experiment.present).sum() for experiment in experiments]
        return sum(present) + sum(f.prior is not None for f in self.free.values())


class Fit(eqx.Module):
    """What a fit found: m parameters, from n numbers measured.

    | field       | shape  |                                                                      |
    |-------------|--------|----------------------------------------------------------------------|
    | parameters  | ()     | values by name                                                       |
    | deviation   | ()     | standard deviations by name; infinite where the data cannot tell     |
    | covariance  | (m, m) | of the parameters in alphabetical order (Gauss-Newton)               |
    | residuals   |        | of each experiment, over the noise, in its shape; NaN where missing  |
    | misfit      | ()     | sum of squared residuals over `freedom`: near 1 where noise is all   |
    | freedom     | ()     | n - m                                                                |
    | certainty   | (m,)   | singular values of the Jacobian by parameters over their `unit`      |
    | directions  | (m, m) | the combination of these that belongs to each, in rows               |
    | unit        | (m,)   | what changes of a parameter are measured by: its size, see `Free`    |
    | at_bound    | ()     | by name, whether a bound is nearer than a tenth of the deviation     |
    | steps       | ()     | of the last search                                                   |
    | status      | ()     | `OK`, `NOT_IDENTIFIABLE`, `FIT_NOT_CONVERGED`, `NOT_FINITE`          |

    Unless the status is `OK`, `parameters`, `deviation`, `covariance` and all that follows from
    them is NaN; `partial` is the same fit with the best that was found. Of a batch, every answer
    has the axes of the batch in front.
    """

    parameters: dict[str, Scalar]
    deviation: dict[str, Scalar]
    covariance: Float[Array, "m m"]
    residuals: tuple[Array, ...]
    misfit: Scalar
    freedom: Array
    certainty: Float[Array, " m"]
    directions: Float[Array, "m m"]
    unit: Float[Array, " m"]
    at_bound: dict[str, Array]
    steps: Array
    status: Code
    free: dict[str, Free]
    z: Float[Array, " m"]
    scale: Scalar
    known_noise: bool = eqx.field(static=True)

    @property
    @per_case
    def partial(self) -> "Fit":
        """The same fit with the best parameters found, whatever its status, and how sure they are:
        where the data cannot tell, with infinite deviations."""
        deviation, covariance = _spread(self.certainty, self.directions, self.unit, self.scale)
        return dataclasses.replace(
            self,
            parameters=values_of(self.free, self.z),
            deviation={name: deviation[i] for i, name in enumerate(self.free)},
            covariance=covariance,
        )

    @property
    @per_case
    def correlation(self) -> Float[Array, "m m"]:
        """Of the parameters."""
        deviation = jnp.sqrt(jnp.diag(self.covariance))
        return self.covariance / (deviation[:, None] * deviation[None])

    @per_case
    def width(self, confidence: float = 0.95) -> Array:
        """Half of an interval of this confidence, in standard deviations: of the normal
        distribution, or of Student's where the level of noise was estimated."""
        if not isinstance(confidence, int | float) or not 0 < confidence < 1:
            raise ValueError(f"confidence must be between 0 and 1, got {confidence!r}")
        if self.known_noise:
            return jnp.asarray(stats.norm.ppf(0.5 + confidence / 2))
        return _student(0.5 + confidence / 2, jnp.maximum(self.freedom, 1).astype(float))

    @per_case
    def interval(self, confidence: float = 0.95) -> dict[str, Array]:
        """(lower, upper) of each parameter. Symmetric in the variable of the search; where that
        would be a factor of e or more, symmetric in the parameter and cut off at its bounds."""
        found = {}
        for z, (name, free) in zip(self.z, self.free.items(), strict=True):
            half = self.width(confidence) * self.deviation[name]
            plain = jnp.stack([self.parameters[name] - half, self.parameters[name] + half])
            far = half / free.unit(z)[0]
            near = far < 1
            reach = jnp.where(near, far, 0.0)
            curved = jnp.stack([free.value(z - reach), free.value(z + reach)])
            found[name] = jnp.where(near, curved, jnp.clip(plain, free.lower, free.upper))
        return found

    @per_case
    def predict(self, function: Callable[..., Array]) -> tuple[Array, Array]:
        """A function of the parameters, by name, and the standard deviation of its values."""

        def at(values: Array) -> Array:
            return jnp.asarray(function(**dict(zip(self.free, values, strict=True))))

        values = jnp.stack(list(self.parameters.values()))
        slope = jax.jacfwd(at)(values)
        change = (slope * jnp.broadcast_to(self.unit, slope.shape)) @ self.directions.T
        still = jnp.abs(change) <= 1e-6 * jnp.max(jnp.abs(change), axis=-1, keepdims=True)
        sure = jnp.broadcast_to(self.certainty, change.shape)
        spread = jnp.where(still, 0.0, change / jnp.where(still, 1.0, sure))
        found = at(values), self.scale * jnp.linalg.norm(spread, axis=-1)
        return where_known(jnp.all(jnp.isfinite(values)), found)

    def __str__(self) -> str:
        """A table, of one that failed with the numbers of `partial`; of a batch, how many ended
        how."""
        if not eqx.is_array(self.status) or isinstance(self.status, jax.core.Tracer):
            return repr(self)
        if np.ndim(self.status):
            ended = Counter(np.ravel(self.status).tolist())
            how = [f"{count} {Status(status).message}" for status, count in sorted(ended.items())]
            return f"{np.size(self.status)} fits: " + "; ".join(how)
        names, found = list(self.parameters), self.partial
        lines = [f"{'':28}{'value':>13}{'deviation':>12}   95 % interval"]
        for name, (low, high) in found.interval().items():
            lines.append(
                f"{name:28}{float(found.parameters[name]):13.6g}{float(found.deviation[name]):12.2g}"
                f"   {float(low):.6g} to {float(high):.6g}"
            )
        lines.append(
            f"misfit {float(self.misfit):.3g} with {int(self.freedom)} degrees of freedom, "
            f"{int(self.steps)} steps: {Status(int(self.status)).message}"
        )
        if self.known_noise and self.excess() > 5:
            lines.append(
                "residuals are larger than the noise explains: the model leaves something out, or "
                "the noise is larger than said"
            )
        if bound := ", ".join(name for name, there in self.at_bound.items() if there):
            lines.append(f"held by a bound: {bound}")
        for sure, direction in zip(self.certainty, self.directions, strict=True):
            if float(sure) < float(self.scale) * _UNSURE:
                share = ", ".join(
                    f"{float(x):+.2f} {name}"
                    for name, x in zip(names, direction, strict=True)
                    if abs(float(x)) > 0.05
                )
                lines.append(f"the data cannot tell this combination: {share}")
        return "\n".join(lines)

    @per_case
    def excess(self) -> Scalar:
        """By how many of its standard deviations the misfit is above 1."""
        return _excess(jnp, self.misfit, self.freedom)


def _excess(xp: Any, misfit: Any, freedom: Any) -> Any:
    return (misfit - 1.0) / xp.sqrt(2.0 / xp.maximum(freedom, 1))


_UNSURE = 1.0  # a standard deviation as large as the parameter: as good as unknown
_RANK = 1e-7  # of the largest singular value; frequencies and their derivatives are good to 1e-9


class Descent(NamedTuple):
    """First-order search from many starts at once: `optimiser` of optax, for `steps`.

    `starts` lie within `spread` of the guess in the variables of the search: a factor of e each way
    by default, in a Latin hypercube.
    """

    optimiser: optax.GradientTransformation = optax.adam(0.05)
    starts: int = 16
    steps: int = 150
    spread: float = 1.0


def fit(
    experiments: Experiments,
    free: dict[str, Free],
    *,
    descent: Descent | None = None,
    solver: Any = None,
    max_steps: int = 100,
    known_noise: bool = True,
    seed: int = 0,
    progress: bool | None = None,
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
    plus relative, or after `max_steps`; a parameter that ran into a bound by then is held there.

    The covariance is that of Gauss and Newton, (J^T J)^-1. With `known_noise=False` only the
    relative size of the noise is believed and its level taken from the residuals, which priors
    would not bear. A direction in which the standard deviation is as large as the parameters, or
    in which the Jacobian is singular, gives `NOT_IDENTIFIABLE`; in `Fit.partial` its parameters are
    as near the guess as the search left them, their deviations large or infinite.

    Under `jax.vmap` and `jax.jit` (a batch of data: build the experiments from it inside) there is
    no second search, unless `descent` asks for one. Raises `ValueError` or `TypeError` for
    malformed arguments and fewer numbers than parameters; all else is left in `Fit.status`, with
    NaN for parameters and deviations unless it is `OK`, and the best found in `Fit.partial`.
    """
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
        if not isinstance(each, Free):
            raise TypeError(f"free[{name!r}] must be a Free, got {type(each).__name__}")
    problem = _Problem(experiments, dict(sorted(free.items())))  # as jax sorts them
    zero = jnp.asarray(np.zeros(len(free)))
    guessed = problem.named({name: each.guess for name, each in free.items()})
    for experiment in guessed:
        if not isinstance(experiment, Experiment):
            raise TypeError("experiments must return an Experiment or several of them")
    if not known_noise and any(each.prior is not None for each in free.values()):
        raise ValueError("a prior is in units of the parameter: it needs known_noise=True")
    if descent is not None and not isinstance(descent, Descent):
        raise TypeError(f"descent must be a Descent, got {kind_of(descent)}")
    if descent is not None:
        count_functions("descent.starts", descent.starts, least=1)
        count_functions("descent.steps", descent.steps, least=1)
        real_scalar("descent.spread", descent.spread)
        if not isinstance(descent.optimiser, optax.GradientTransformation):
            got = kind_of(descent.optimiser)
            raise TypeError(f"descent.optimiser must be an optimiser of optax, got {got}")
    count = problem.count(guessed)
    known = not isinstance(count, jax.core.Tracer)
    if known and int(count) < len(free):
        raise ValueError(
            f"{int(count)} numbers measured are too few for {len(free)} parameters: measure more, "
            "fix some, or give a prior"
        )
    if known and not known_noise and int(count) == len(free):
        raise ValueError("with as many numbers as parameters nothing tells the level of the noise")
    solver = optimistix.LevenbergMarquardt(rtol=1e-10, atol=1e-10) if solver is None else solver
    best = _refine(problem, zero, solver, max_steps, known_noise)
    traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(best))
    shown = (sys.stderr.isatty() if progress is None else progress) and not traced
    if not traced:
        _tell(shown, f"from the guess: misfit {float(best.misfit):.3g}, {int(best.steps)} steps")
        lost = int(best.status) in (Status.FIT_NOT_CONVERGED, Status.NOT_FINITE)
        poor = lost or (
            known_noise and _excess(np, *map(np.asarray, (best.misfit, best.freedom))) > 5
        )
        descent = Descent() if descent is None and poor else descent
    if descent is None:
        return best
    z = _descend(problem, descent, jax.random.key(seed))
    other = _refine(problem, z, solver, max_steps, known_noise)
    if not traced:
        _tell(shown, f"from the best of {descent.starts} starts: misfit {float(other.misfit):.3g}")
    lower = other.misfit < best.misfit * (1 - 1e-6)
    ended = (best.status == Status.FIT_NOT_CONVERGED) & (other.status != best.status)
    better = (
        ~jnp.isfinite(best.misfit) | lower | (ended & (other.misfit <= best.misfit * (1 + 1e-6)))
    )
    return jax.tree.map(lambda a, b: jnp.where(better, b, a), best, other)


def _tell(shown: bool, text: str) -> None:
    if shown:
        print(f"fit {text}", file=sys.stderr, flush=True)


@eqx.filter_jit
def _refine(problem: _Problem, z: Array, solver: Any, max_steps: int, known_noise: bool) -> Fit:
    m = z.size
    found: Any = optimistix.least_squares(
        problem.residual, solver, z, options={"jac": "fwd"}, max_steps=max_steps, throw=False
    )
    z = found.value
    residual, jacobian = problem.with_jacobian(z)
    listed = problem.listed(z)
    freedom = jnp.asarray(problem.count(listed) - m)
    square = jnp.sum(residual**2)
    misfit = square / jnp.maximum(freedom, 1)
    level = jnp.where(freedom < 1, jnp.inf, jnp.sqrt(misfit))
    scale = jnp.ones_like(level) if known_noise else level
    finite = jnp.all(jnp.isfinite(jacobian)) & jnp.isfinite(square)
    units = [free.unit(z[i]) for i, free in enumerate(problem.free.values())]
    slope, unit = (jnp.stack(column) for column in zip(*units, strict=True))
    by_unit = jacobian * (unit / jnp.maximum(slope, jnp.finfo(z.dtype).tiny))[None]
    few = max(m - residual.size, 0)  # rows of zeros, for directions that nothing was measured in
    by_unit = jnp.pad(jnp.where(finite, by_unit, 0.0), ((0, few), (0, 0)))
    _, certainty, directions = jnp.linalg.svd(by_unit, full_matrices=False)
    certainty = jnp.where(certainty > _RANK * certainty[0], certainty, 0.0)
    deviation, covariance = _spread(certainty, directions, unit, scale)
    room = jnp.stack([free.room(z[i]) for i, free in enumerate(problem.free.values())])
    at_bound = jnp.isfinite(deviation) & (room < 0.1 * deviation)
    status = jnp.where(jnp.min(certainty) < scale * _UNSURE, Status.NOT_IDENTIFIABLE, Status.OK)
    ended = (found.result == optimistix.RESULTS.successful) | jnp.any(at_bound)
    status = jnp.where(ended, status, Status.FIT_NOT_CONVERGED)
    status = jnp.where(finite, status, Status.NOT_FINITE)
    known = (values_of(problem.free, z), deviation, covariance)
    values, deviation, covariance = where_known(status == Status.OK, known)
    names, residuals, start = list(problem.free), [], 0
    for each in listed:
        own = residual[start : start + each.measured.size].reshape(each.measured.shape)
        residuals.append(jnp.where(each.present, own, jnp.nan))
        start += own.size
    return Fit(
        parameters=values,
        deviation={name: deviation[i] for i, name in enumerate(names)},
        covariance=covariance,
        residuals=tuple(residuals),
        misfit=jnp.where(finite, misfit, jnp.nan),
        freedom=freedom,
        certainty=certainty,
        directions=directions,
        unit=unit,
        at_bound=dict(zip(names, at_bound, strict=True)),
        steps=found.stats["num_steps"],
        status=status,
        free=problem.free,
        z=z,
        scale=scale,
        known_noise=known_noise,
    )


def _spread(certainty: Array, directions: Array, unit: Array, scale: Scalar) -> tuple[Array, Array]:
    """Deviation of each parameter, and their covariance."""
    spread = unit[:, None] * directions.T / jnp.where(certainty > 0, certainty, 1.0)[None]
    covariance = scale**2 * spread @ spread.T
    deviation = scale * unit * jnp.sqrt(_variance(certainty, directions))
    lost = ~jnp.isfinite(deviation)
    endless = jnp.where(np.eye(unit.size, dtype=bool), jnp.inf, jnp.nan)
    return deviation, jnp.where(lost[:, None] | lost[None], endless, covariance)


def _variance(certainty: Array, directions: Array) -> Array:
    """Of the variables of the search; infinite where a direction without certainty has a share."""
    share = directions**2
    share = jnp.where(share < 1e-12, 0.0, share)
    each = jnp.where(share == 0, 0.0, share / jnp.where(share == 0, 1.0, certainty[:, None] ** 2))
    return jnp.sum(each, axis=0)


def _student(p: float, freedom: Array) -> Array:
    """Quantile of Student's distribution by bisection of its incomplete beta function."""
    low, high = jnp.zeros_like(freedom), jnp.full_like(freedom, 1e4)

    def halve(_: int, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = (low + high) / 2
        x = freedom / (freedom + middle**2)
        below = 1 - 0.5 * jax.scipy.special.betainc(freedom / 2, 0.5, x) < p
        return jnp.where(below, middle, low), jnp.where(below, high, middle)

    low, high = jax.lax.fori_loop(0, 60, halve, (low, high))
    return (low + high) / 2


@eqx.filter_jit
def _descend(problem: _Problem, descent: Descent, key: Any) -> Array:
    """The best end of all starts."""
    n, m = descent.starts, len(problem.free)
    # A Latin hypercube: each parameter takes n values evenly, in an order of its own.
    order, within = jax.random.split(key)
    rows = jax.vmap(lambda k: jax.random.permutation(k, n), out_axes=1)(jax.random.split(order, m))
    away = descent.spread * (2 * (rows + jax.random.uniform(within, (n, m))) / n - 1)
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
