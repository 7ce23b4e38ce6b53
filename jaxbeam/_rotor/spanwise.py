"""Properties of a beam along its span, as functions of xi = x / L from 0 at the root to 1."""

import abc
import functools
import itertools
from collections.abc import Callable, Sequence
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import legendre

from jaxbeam._checks import (
    check_all,
    concrete_array,
    is_valid,
    kind_of,
    known_array,
    real_scalar,
    traceable,
)
from jaxbeam._status import Status
from jaxbeam._types import Number, Scalar, is_concrete

_POINTS = 16  # Gauss points of each segment; two are exact for linear properties


class AbstractSpanwise(eqx.Module):
    """A property that varies along the span."""

    kinks: eqx.AbstractVar[tuple[float, ...]]  # where it is not smooth, between 0 and 1
    steps: eqx.AbstractVar[tuple[float, ...]]  # kinks at which it may jump

    @abc.abstractmethod
    def at(self, xi: Float[Array | np.ndarray, " p"]) -> Float[Array, " p"]:
        """Values at places xi = x / L, none of which is a kink."""

    def within(self, edges: tuple[float, ...], s: Array) -> Float[Array, "e p"]:
        """Values at places s, from 0 to 1, of each segment between edges, among which all kinks
        must be."""
        places = np.asarray(edges)
        return self.at((places[:-1, None] + np.diff(places)[:, None] * s).reshape(-1)).reshape(
            s.shape
        )

    def ends(self, edges: tuple[float, ...]) -> tuple[Float[Array, " e"], Float[Array, " e"]]:
        """Values just after the start and just before the end of every segment between edges."""
        first, last = (self.at(xi) for xi in beside_kinks(edges))
        return first, last

    @abc.abstractmethod
    def samples(self) -> Float[Array, " k"]:
        """Values that are checked to tell whether the property is in range."""

    def checked(self) -> Self:
        """A copy made by the constructor, so that numbers set by `eqx.tree_at` are checked."""
        return self


class Spanwise(AbstractSpanwise):
    """A property given at stations along the span, linear from one to the next.

    `stations` (k,) are x / L, known numbers that do not decrease from 0 to 1; two that are equal
    are a step, from the first value to the second. `values` (k,) are in the unit of the property;
    each of them can be swept, fitted or differentiated.

    Raises `ValueError`, which says where stations go wrong, and `TypeError` for what are no real
    numbers or, of stations, not known when a program is compiled.
    """

    values: Float[Array, " k"]
    stations: tuple[float, ...] = eqx.field(static=True)
    kinks: tuple[float, ...] = eqx.field(static=True)
    steps: tuple[float, ...] = eqx.field(static=True)

    def __init__(self, stations: Sequence[float], values: Any) -> None:
        self.stations = checked_stations("stations", stations)
        self.values = known_array("values", values)
        count = len(self.stations)
        if self.values.shape != (count,):
            raise ValueError(
                f"values must be as many as stations, {count}, got shape {self.values.shape}"
            )
        self.kinks = tuple(sorted(set(self.stations[1:-1])))
        self.steps = steps_of(self.stations)

    def at(self, xi: Float[Array | np.ndarray, " p"]) -> Float[Array, " p"]:
        left, share = between(self.stations, np.asarray(xi, float))
        return self.values[left] * (1 - share) + self.values[left + 1] * share

    def within(self, edges: tuple[float, ...], s: Array) -> Float[Array, "e p"]:
        start, end = self.ends(edges)
        return start[:, None] + (end - start)[:, None] * s

    def ends(self, edges: tuple[float, ...]) -> tuple[Float[Array, " e"], Float[Array, " e"]]:
        places, stations = np.asarray(edges), np.asarray(self.stations)
        left, _ = between(self.stations, (places[1:] + places[:-1]) / 2)
        gap = stations[left + 1] - stations[left]
        first, second = self.values[left], self.values[left + 1]
        both = ((edge - stations[left]) / gap for edge in (places[:-1], places[1:]))
        start, end = (first * (1 - share) + second * share for share in both)
        return start, end

    def samples(self) -> Float[Array, " k"]:
        return self.values

    def checked(self) -> Self:
        return type(self)(self.stations, self.values)


class SpanwiseFunction(AbstractSpanwise):
    """A property given by a function of x / L.

    `function` takes an array of x / L and returns as many values, by operations of JAX; numbers
    that are to be swept, fitted or differentiated are leaves of it, if it is a pytree such as an
    `equinox.Module` or a `jax.tree_util.Partial`. `kinks` names the x / L, between 0 and 1, where
    it or a derivative of it jumps, so that integrals stop there.

    Raises `TypeError` for what is no function, or none that JAX can trace, and `ValueError` for
    kinks out of range or values of another shape.
    """

    function: Callable[[Float[Array, " p"]], Float[Array, " p"]]
    kinks: tuple[float, ...] = eqx.field(static=True)
    steps: tuple[float, ...] = eqx.field(static=True)

    def __init__(self, function: Callable[[Array], Array], kinks: Sequence[float] = ()) -> None:
        if not callable(function):
            raise TypeError(f"function must be a function of x / L, got {function!r}")
        places = np.unique(concrete_array("kinks", kinks)) if len(kinks) else np.zeros(0)
        if not np.all((places > 0) & (places < 1)):
            raise ValueError(f"kinks must be between 0 and 1 (x / L), got {tuple(kinks)}")
        # Functions that are no pytrees are wrapped, since `jax.jit` takes none as leaves.
        function = jax.tree.map(
            lambda leaf: jax.tree_util.Partial(leaf) if callable(leaf) else leaf, function
        )
        self.function, self.kinks = function, tuple(places.tolist())
        self.steps = self.kinks  # it may jump at any of them

    def at(self, xi: Float[Array | np.ndarray, " p"]) -> Float[Array, " p"]:
        with jax.ensure_compile_time_eval():  # concrete places, so that the function may use NumPy
            points = jnp.asarray(xi)
        with traceable("function"):
            values = self.function(points)
        if jnp.shape(values) != np.shape(xi):
            raise ValueError(
                f"function must return a value for each of {len(xi)} points, got shape "
                f"{jnp.shape(values)}"
            )
        return values

    def samples(self) -> Float[Array, " k"]:
        edges = (0.0, *self.kinks, 1.0)
        return self.at(points_within(edges)[0])


def checked_stations(name: str, given: Any, steps: bool = True) -> tuple[float, ...]:
    """Places x / L that go from 0 to 1 and do not decrease, two that are equal being a step between
    the ends; or increase, where there are no `steps`; else an error that says where they do not."""
    places = concrete_array(name, given)
    if places.ndim != 1 or places.size < 2:
        raise ValueError(f"{name} must be two or more in a row, got shape {places.shape}")
    if not (places[0] == 0 and places[-1] == 1):
        raise ValueError(f"{name} must go from 0 to 1 (x / L), got {places[0]:g} to {places[-1]:g}")
    for i, (before, here) in enumerate(itertools.pairwise(places.tolist()), 1):
        if not (here >= before if steps else here > before):  # NaN is neither
            how = "not decrease" if steps else "increase"
            raise ValueError(
                f"{name} must {how}, got {before:g} and then {here:g} at number {i + 1}"
            )
        if i > 1 and here == before == places[i - 2]:
            raise ValueError(f"{name}: more than two are equal, at x / L = {here:g}")
    if places[1] == 0 or places[-2] == 1:
        raise ValueError(f"{name}: a step must be between the ends, not at 0 or 1")
    return tuple(places.tolist())


def steps_of(stations: tuple[float, ...]) -> tuple[float, ...]:
    """Stations that are there twice."""
    return tuple(here for before, here in itertools.pairwise(stations) if here == before)


Property = Any  # Scalar | AbstractSpanwise: whoever gave numbers gets numbers back


def along(value: Property, xi: Float[Array | np.ndarray, " p"]) -> Float[Array, " p"]:
    """Values of a property at places xi = x / L, none of which is a kink."""
    if isinstance(value, AbstractSpanwise):
        return value.at(xi)
    return jnp.broadcast_to(value, np.shape(xi))


def at_root(value: Property) -> Scalar:
    """The value of a property at the root."""
    return value.at(np.zeros(1))[0] if isinstance(value, AbstractSpanwise) else value


def mean(value: Property) -> Number:
    """Mean of a property over the span; a number, which may have lanes, is its own mean."""
    if not isinstance(value, AbstractSpanwise):
        return value
    xi, weight = points_within((0.0, *value.kinks, 1.0))
    return jnp.asarray(weight) @ value.at(xi)


@functools.lru_cache(maxsize=64)
def points_within(edges: tuple[float, ...], points: int = _POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Gauss points x / L and weights of all segments between edges, so many in each."""
    x, w = legendre.leggauss(points)
    start, length = np.asarray(edges[:-1])[:, None], np.diff(edges)[:, None]
    return (start + length * (1 + x) / 2).ravel(), (length * w / 2).ravel()


def between(stations: tuple[float, ...], xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The index of the station before each place xi, and the place as a share, from 0 to 1, of the
    way from it to the next one."""
    places = np.asarray(stations)
    left = np.clip(np.searchsorted(places, xi, side="right") - 1, 0, places.size - 2)
    return left, (xi - places[left]) / (places[left + 1] - places[left])


def at_ends(
    value: Property, edges: tuple[float, ...]
) -> tuple[Float[Array, " e"], Float[Array, " e"]]:
    """Values of a property at the start and at the end of every segment between edges."""
    if isinstance(value, AbstractSpanwise):
        return value.ends(edges)
    both = jnp.broadcast_to(value, (len(edges) - 1,))
    return both, both


def beside_kinks(edges: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Places just after the start and just before the end of every segment between edges."""
    places = np.asarray(edges)
    near = 1e-9 * np.diff(places)
    return places[:-1] + near, places[1:] - near


def edges_between(properties: Sequence[AbstractSpanwise]) -> tuple[float, ...]:
    """Edges x / L, from 0 to 1, between which all of these properties are smooth."""
    return 0.0, *sorted({kink for p in properties for kink in p.kinks}), 1.0


def taken(name: str, value: Any, varies: bool) -> Property:
    """An argument as a scalar or, if it `varies`, as the property along the span that it is; raises
    `TypeError` for others."""
    if isinstance(value, AbstractSpanwise) and varies:
        return value
    if varies and callable(value) and not hasattr(value, "dtype"):
        raise TypeError(
            f"{name} must be a number, a Spanwise or a SpanwiseFunction, got {kind_of(value)}: "
            "wrap a function in SpanwiseFunction"
        )
    return real_scalar(name, value)


def samples(value: Property) -> Any:
    """Numbers that are checked to tell whether a property is in range."""
    return value.samples() if isinstance(value, AbstractSpanwise) else value


def check(status: Status, value: Property, zero: bool | None, most: float | None = None) -> None:
    """Raise `ValueError` with the sentence of `status` unless a property, if concrete, is in range:
    positive, with `zero` not negative, with None of any sign, and at most `most`."""
    with jax.ensure_compile_time_eval():  # concrete numbers, also within a traced function
        numbers = samples(value)
    if not is_concrete(numbers):  # a function that closes over traced numbers
        return
    numbers = np.asarray(numbers)
    fine = is_valid(numbers, zero, most)
    if isinstance(value, Spanwise) and not np.all(fine):
        i = int(np.argmin(fine))
        place = f"{numbers[i]} at station {i + 1}, x / L = {value.stations[i]:g}"
        raise ValueError(f"{status.message}, got {place}")
    check_all(status, numbers, lambda _: fine)
