"""What a fit is asked to make small, and what is said of the parameters found."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.stats as stats
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import numpy_if_concrete
from jaxbeam._fitting.experiments import Experiment, residuals_of
from jaxbeam._fitting.free import FreeParameter, values_of
from jaxbeam._numerics.brackets import halved
from jaxbeam._numerics.newton import value_and_jacobian
from jaxbeam._results import nan_unless, per_case
from jaxbeam._status import Status
from jaxbeam._types import Code, Scalar, is_concrete

UNSURE = 1.0  # standard deviation over the parameter from which on it counts as unknown

Experiments = Callable[..., Experiment | Sequence[Experiment]]


class Problem(eqx.Module):
    """Residuals of measurements, with those of priors at the end, as a function of variables z of
    the search."""

    experiments: Experiments
    free: dict[str, FreeParameter]

    def experiments_at(self, z: Array) -> list[Experiment]:
        return self.named(values_of(self.free, z))

    def named(self, values: dict[str, Scalar]) -> list[Experiment]:
        found = self.experiments(**values)
        return list(found) if isinstance(found, list | tuple) else [found]  # type: ignore[list-item]

    def residual(self, z: Array, _: Any = None) -> Array:
        parts = residuals_of(self.experiments_at(z))
        for i, free in enumerate(self.free.values()):
            if free.prior is not None:
                mean, standard_deviation = free.prior
                parts.append((free.value(z[i]) - mean)[None] / standard_deviation)
        return jnp.concatenate(parts)

    def with_jacobian(self, z: Array) -> tuple[Array, Array]:
        """Residuals and their derivatives, by one run of the models."""
        return value_and_jacobian(self.residual, z)

    def count(self, experiments: list[Experiment]) -> Any:
        """The number of measured numbers, priors included; as one of NumPy if they are concrete."""
        present = [numpy_if_concrete(experiment.present).sum() for experiment in experiments]
        return sum(present) + sum(f.prior is not None for f in self.free.values())


class Fit(eqx.Module):
    """The result of a fit: m parameters, from n numbers measured.

    | field               | shape  |                                                              |
    |---------------------|--------|--------------------------------------------------------------|
    | parameters          | ()     | values by name                                               |
    | standard_deviation  | ()     | by name; infinite where data cannot tell                     |
    | covariance          | (m, m) | of the parameters in alphabetical order (Gauss-Newton)       |
    | residuals           |        | of each experiment, over the noise; NaN where missing        |
    | reduced_chi_squared | ()     | sum of squared residuals over the degrees of freedom: one    |
    |                     |        | where noise is all                                           |
    | degrees_of_freedom  | ()     | n - m                                                        |
    | certainty           | (m,)   | singular values of the Jacobian by parameters over their     |
    |                     |        | scales                                                       |
    | combinations        | (m, m) | of the parameters, the one that belongs to each, in rows     |
    | parameter_scale     | (m,)   | what their changes are measured by, see `FreeParameter`      |
    | at_bound            | ()     | by name: -1 at the lower bound, 1 at the upper one, else 0   |
    | steps               | ()     | of the last search                                           |
    | status              | ()     | `OK`, `NOT_IDENTIFIABLE`, `FIT_NOT_CONVERGED`, `NOT_FINITE`  |

    A parameter is at a bound where the data press it against that, or where the bound is nearer
    than a tenth of the standard deviation. Of one that they press, the standard deviation says how
    well the data would tell it without the bound; those of all others, and the covariance, are
    conditional on its being there. A large `reduced_chi_squared` then says that the bound is wrong.

    Unless the status is `OK`, `parameters`, `standard_deviation`, `covariance` and all that follows
    from them is NaN; `partial` is the same fit with the best that was found. Of a batch, every
    answer has the axes of the batch in front.
    """

    parameters: dict[str, Scalar]
    standard_deviation: dict[str, Scalar]
    covariance: Float[Array, "m m"]
    residuals: tuple[Array, ...]
    reduced_chi_squared: Scalar
    degrees_of_freedom: Array
    certainty: Float[Array, " m"]
    combinations: Float[Array, "m m"]
    parameter_scale: Float[Array, " m"]
    at_bound: dict[str, Array]
    steps: Array
    status: Code
    free: dict[str, FreeParameter]
    z: Float[Array, " m"]
    scale: Scalar
    known_noise: bool = eqx.field(static=True)

    @property
    @per_case
    def partial(self) -> "Fit":
        """The fit with the best parameters found, whatever its status, and how sure they are.

        Where the data cannot tell, deviations are infinite.
        """
        standard_deviation, covariance = uncertainty(
            self.certainty, self.combinations, self.parameter_scale, self.scale
        )
        return dataclasses.replace(
            self,
            parameters=values_of(self.free, self.z),
            standard_deviation={name: standard_deviation[i] for i, name in enumerate(self.free)},
            covariance=covariance,
        )

    @property
    @per_case
    def correlation(self) -> Float[Array, "m m"]:
        """Correlation coefficients of the parameters."""
        standard_deviation = jnp.sqrt(jnp.diag(self.covariance))
        return self.covariance / (standard_deviation[:, None] * standard_deviation[None])

    @per_case
    def width(self, confidence: float = 0.95) -> Array:
        """Half of an interval of this `confidence` (between 0 and 1), in standard deviations.

        That of the normal distribution, or of Student's where the level of noise was estimated.

        Raises `ValueError` for another confidence.
        """
        if not isinstance(confidence, int | float) or not 0 < confidence < 1:
            raise ValueError(f"confidence must be between 0 and 1, got {confidence!r}")
        if self.known_noise:
            return jnp.asarray(stats.norm.ppf(0.5 + confidence / 2))
        return student(0.5 + confidence / 2, jnp.maximum(self.degrees_of_freedom, 1).astype(float))

    @per_case
    def interval(self, confidence: float = 0.95) -> dict[str, Array]:
        """An interval, [lower, upper], of each parameter by name, at a `confidence` as in `width`.

        Symmetric in the variable of the search; where that would be a factor of e or more,
        symmetric in the parameter and cut off at its bounds.
        """
        found = {}
        for z, (name, free) in zip(self.z, self.free.items(), strict=True):
            half = self.width(confidence) * self.standard_deviation[name]
            plain = jnp.stack([self.parameters[name] - half, self.parameters[name] + half])
            far = half / free.unit(z)[0]
            near = far < 1
            step = jnp.where(near, far, 0.0)
            curved = jnp.stack([free.value(z - step), free.value(z + step)])
            found[name] = jnp.where(near, curved, jnp.clip(plain, free.lower, free.upper))
        return found

    @per_case
    def predict(self, function: Callable[..., Array]) -> tuple[Array, Array]:
        """Values of a function of the parameters, and their standard deviation.

        `function(**parameters)` returns a number or an array, by operations of JAX; both have its
        shape.
        """

        def at(values: Array) -> Array:
            return jnp.asarray(function(**dict(zip(self.free, values, strict=True))))

        values = jnp.stack(list(self.parameters.values()))
        slope = jax.jacfwd(at)(values)
        change = (slope * jnp.broadcast_to(self.parameter_scale, slope.shape)) @ self.combinations.T
        still = jnp.abs(change) <= 1e-6 * jnp.max(jnp.abs(change), axis=-1, keepdims=True)
        sure = jnp.broadcast_to(self.certainty, change.shape)
        scaled = jnp.where(still, 0.0, change / jnp.where(still, 1.0, sure))
        found = at(values), self.scale * jnp.linalg.norm(scaled, axis=-1)
        return nan_unless(jnp.all(jnp.isfinite(values)), found)

    def __str__(self) -> str:
        """A table, of one that failed with the numbers of `partial`; of a batch, how many ended
        how."""
        if not eqx.is_array(self.status) or not is_concrete(self.status):
            return repr(self)
        if np.ndim(self.status):
            ended = Counter(np.ravel(self.status).tolist())
            how = [f"{count} {Status(status).message}" for status, count in sorted(ended.items())]
            return f"{np.size(self.status)} fits: " + "; ".join(how)
        names, found = list(self.parameters), self.partial
        lines = [f"{'':28}{'value':>13}{'deviation':>12}   95 % interval"]
        for name, (low, high) in found.interval().items():
            value, spread = found.parameters[name], found.standard_deviation[name]
            lines.append(
                f"{name:28}{float(value):13.6g}{float(spread):12.2g}"
                f"   {float(low):.6g} to {float(high):.6g}"
            )
        lines.append(
            f"reduced chi squared {float(self.reduced_chi_squared):.3g} with "
            f"{int(self.degrees_of_freedom)} degrees of freedom, {int(self.steps)} steps: "
            f"{Status(int(self.status)).message}"
        )
        if self.known_noise and self.excess() > 5:
            lines.append(
                "residuals are larger than the noise explains: the model leaves something out, or "
                "the noise is larger than said"
            )
        sides = {-1: "lower", 1: "upper"}
        there = {name: sides[int(s)] for name, s in self.at_bound.items() if int(s)}
        if there:
            told = ", ".join(f"{name} ({side})" for name, side in there.items())
            lines.append(f"held by a bound: {told}")
        for sure, combination in zip(self.certainty, self.combinations, strict=True):
            largest = names[int(np.argmax(np.abs(combination)))]
            if float(sure) < float(self.scale) * UNSURE and largest not in there:
                share = ", ".join(
                    f"{float(x):+.2f} {name}"
                    for name, x in zip(names, combination, strict=True)
                    if abs(float(x)) > 0.05
                )
                lines.append(f"the data cannot tell this combination: {share}")
        return "\n".join(lines)

    @per_case
    def excess(self) -> Scalar:
        """`reduced_chi_squared` less 1, over its standard deviation."""
        return excess_of(jnp, self.reduced_chi_squared, self.degrees_of_freedom)


def excess_of(xp: Any, reduced_chi_squared: Any, degrees_of_freedom: Any) -> Any:
    return (reduced_chi_squared - 1.0) / xp.sqrt(2.0 / xp.maximum(degrees_of_freedom, 1))


def uncertainty(
    certainty: Array, combinations: Array, unit: Array, scale: Scalar
) -> tuple[Array, Array]:
    """Standard deviation of each parameter, and their covariance."""
    scaled = unit[:, None] * combinations.T / jnp.where(certainty > 0, certainty, 1.0)[None]
    covariance = scale**2 * scaled @ scaled.T
    standard_deviation = scale * unit * jnp.sqrt(variance(certainty, combinations))
    lost = ~jnp.isfinite(standard_deviation)
    endless = jnp.where(np.eye(unit.size, dtype=bool), jnp.inf, jnp.nan)
    return standard_deviation, jnp.where(lost[:, None] | lost[None], endless, covariance)


def variance(certainty: Array, combinations: Array) -> Array:
    """Variances of the variables of the search; infinite for variables with a part in a combination
    of certainty zero."""
    share = combinations**2
    share = jnp.where(share < 1e-12, 0.0, share)
    each = jnp.where(share == 0, 0.0, share / jnp.where(share == 0, 1.0, certainty[:, None] ** 2))
    return jnp.sum(each, axis=0)


def student(p: float, degrees_of_freedom: Array) -> Array:
    """Quantile of Student's distribution, by bisection of its incomplete beta function."""
    low, high = jnp.zeros_like(degrees_of_freedom), jnp.full_like(degrees_of_freedom, 1e4)

    def below(t: Array) -> Array:
        x = degrees_of_freedom / (degrees_of_freedom + t**2)
        return 1 - 0.5 * jax.scipy.special.betainc(degrees_of_freedom / 2, 0.5, x) < p

    low, high = halved(below, low, high, 60)
    return (low + high) / 2
