"""Parameters that a fit is to find."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._checks import check_all, numpy_if_concrete, real_scalar
from jaxbeam._types import Scalar, is_concrete


class FreeParameter(eqx.Module):
    """A parameter to be found: a `guess`, strict bounds, and what is known of it before.

    All are scalars in its unit, `lower` < guess < `upper`; infinite ones are no bounds. The search
    runs over z, with z = 0 at the guess:

        value = lower + (guess - lower) exp(z)                   lower bound alone (0 by default)
        value = upper - (upper - guess) exp(-z)                  upper bound alone
        value = lower + (upper - lower) / (1 + r exp(-z))        both, r = (upper - guess) /
                                                                 (guess - lower)
        value = guess + |guess| z (guess + z where it is 0)      none

    `prior` is (mean, standard deviation) of a normal distribution: one more measurement.

    Raises `TypeError` for what is no real scalar, and `ValueError` for a guess that is not between
    the bounds or a deviation that is not > 0.
    """

    guess: Scalar
    lower: Scalar
    upper: Scalar
    prior: tuple[Scalar, Scalar] | None
    bounded: tuple[bool, bool] = eqx.field(static=True)

    def __init__(
        self, guess: Any, lower: float = 0.0, upper: float = float("inf"), *,
        prior: tuple[Any, Any] | None = None,
    ) -> None:  # fmt: skip
        self.guess, self.lower = real_scalar("guess", guess), real_scalar("lower", lower)
        self.upper = real_scalar("upper", upper)
        self.bounded = (bool(np.isfinite(lower)), bool(np.isfinite(upper)))
        numbers = [numpy_if_concrete(number) for number in (self.lower, self.guess, self.upper)]
        if is_concrete(numbers) and not (
            numbers[0] < numbers[1] < numbers[2] and np.isfinite(numbers[1])
        ):
            raise ValueError(f"guess must be finite and between {lower} and {upper}, got {guess}")
        self.prior = None
        if prior is not None:
            rule = "prior must be a mean and a standard deviation > 0"
            if not isinstance(prior, tuple | list) or len(prior) != 2:
                raise ValueError(f"{rule}, got {prior}")
            self.prior = real_scalar("prior", prior[0]), real_scalar("prior", prior[1])
            check_all(rule, self.prior, lambda x: np.isfinite(x).all() & (x[1] > 0))

    def value(self, z: Scalar) -> Scalar:
        """The parameter that belongs to the variable z of the search, which knows no bounds."""
        match self.bounded:
            case True, True:
                r = (self.upper - self.guess) / (self.guess - self.lower)
                return self.lower + (self.upper - self.lower) / (1 + r * jnp.exp(-z))
            case True, False:
                return self.lower + (self.guess - self.lower) * jnp.exp(z)
            case False, True:
                return self.upper - (self.upper - self.guess) * jnp.exp(-z)
        return self.guess + jnp.where(self.guess == 0, 1.0, jnp.abs(self.guess)) * z

    def unit(self, z: Scalar) -> tuple[Scalar, Scalar]:
        """The slope d value / dz, and the measure of changes of the parameter: the parameter
        itself, but no less than a tenth of it at the guess, nor, between two bounds, of the
        distance from the lower one; without bounds, so of the value and the guess."""
        slope, value = jax.grad(self.value), self.value(z)
        here = jnp.abs(value) if self.bounded == (False, False) else slope(z)
        least = slope(jnp.zeros_like(z))
        if all(self.bounded):  # at the upper bound the slope is no measure of changes
            least = jnp.maximum(least, value - self.lower)
        return slope(z), jnp.maximum(here, 0.1 * least)


def values_of(free: dict[str, FreeParameter], z: Array) -> dict[str, Scalar]:
    """The parameters by name, from variables z of the search."""
    return {name: each.value(z[i]) for i, (name, each) in enumerate(free.items())}
