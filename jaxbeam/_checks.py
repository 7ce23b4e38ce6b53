"""Arguments of public functions: numbers as arrays of real floats, or errors that name them."""

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxbeam._status import Status
from jaxbeam._types import Scalar, is_concrete


def _default_float() -> Any:
    return jnp.result_type(float)


def real_scalar(name: str, value: Any) -> Scalar:
    """`value` as a real floating-point scalar array, or an error that names the argument.

    Python numbers are welcome, and integers of NumPy, but not masked ones. Arrays must be real,
    floating and without axes: an integer array has no derivative, and a batch belongs outside, in
    `jax.vmap` or `jaxbeam.sweep`. Shorter floats are promoted to the default float, so that one of
    them does not spoil a result.
    """
    value = plain(unmasked(name, value))
    if isinstance(value, bool):
        raise TypeError(f"{name} must be a real number, got {value!r}")
    if isinstance(value, int | float):
        if isinstance(value, int) and abs(value) >= 2**1024:
            raise ValueError(f"{name} must be finite, got an int beyond the range of floats")
        return jnp.asarray(np.asarray(value, _default_float()))
    dtype = getattr(value, "dtype", None)
    if dtype is None or not jnp.issubdtype(dtype, jnp.floating):
        kind = type(value).__name__ if dtype is None else f"an array of {dtype}"
        raise TypeError(f"{name} must be a real floating-point scalar, got {kind}")
    if np.shape(value) != ():
        raise ValueError(
            f"{name} must be a scalar, got shape {np.shape(value)}; "
            "batch from outside with jax.vmap or jaxbeam.sweep"
        )
    return jnp.asarray(numpy_if_concrete(value), _default_float())


def plain(value: Any) -> Any:
    """An integer of NumPy as one of Python; other values as they are."""
    return int(value) if isinstance(value, np.integer) else value


def numpy_if_concrete(value: Any) -> Any:
    """A value in NumPy, whose arithmetic is not compiled, if it is concrete."""
    return np.asarray(value) if is_concrete(value) else value


def kind_of(value: Any) -> str:
    """A phrase for the type of an argument, for errors."""
    return f"the class {value.__name__}" if isinstance(value, type) else type(value).__name__


def check_kind(name: str, value: Any, kind: type, *others: type) -> None:
    """Raise `TypeError` unless an argument is of a kind, or of others that need no mention."""
    if not isinstance(value, (kind, *others)):
        raise TypeError(f"{name} must be a {kind.__name__}, got {kind_of(value)}")


def real_array(name: str, value: Any) -> Array:
    """`value` as an array of real floats of any shape, or an error that names the argument.

    Lists of numbers, integers too, are welcome; complex numbers, booleans, texts, lists of unequal
    lengths and masked numbers are not. What pandas calls NA is NaN.
    """
    return jnp.asarray(_real(name, value), _default_float())


def known_array(name: str, value: Any) -> Array:
    """`value` as `real_array` has it, known while a program is compiled if it is now."""
    if not is_concrete(value):
        return real_array(name, value)
    with jax.ensure_compile_time_eval():
        return real_array(name, value)


def number_list(name: str, value: Any, least: int = 1) -> Array:
    """`value` as a list of real floats, so many at least, or an error that names the argument."""
    array = real_array(name, value)
    if array.ndim != 1 or array.size < least:
        raise ValueError(
            f"{name} must be a list of {least} or more numbers, got shape {array.shape}"
        )
    return array


def shaped_array(name: str, value: Any, shape: tuple[int, ...], meaning: str = "") -> Array:
    """`value` as `real_array` has it, if it has this shape; else an error that says what that
    means."""
    array = real_array(name, value)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}{meaning}, got {array.shape}")
    return array


def concrete_array(name: str, value: Any) -> np.ndarray:
    """The argument as an array of NumPy; raises for numbers that are traced."""
    array = _real(name, value)
    if not is_concrete(array):
        raise TypeError(f"{name} must be known when a program is compiled, got {value!r}")
    return np.asarray(array, float)


def places(xi: Any) -> np.ndarray:
    """The argument `xi` of questions along the span, as places x / L: (p,) of NumPy."""
    points = np.atleast_1d(concrete_array("xi", xi))
    if points.ndim > 1 or not ((points >= 0) & (points <= 1)).all():
        raise ValueError(f"xi must be x / L in [0, 1], one or several in a row, got {xi}")
    return points


def unmasked(name: str, value: Any) -> Any:
    """Numbers without the masks of `numpy.ma`, which JAX does not know, if nothing is masked, and
    numbers of pandas, which has types of its own, in NumPy; anything else as it is."""
    for part in value if isinstance(value, list | tuple) else [value]:
        if np.ma.isMaskedArray(part) and np.ma.is_masked(part):
            raise ValueError(
                f"{name} must not have masked numbers: leave them out, or, where one may be "
                "missing, give NaN in its place, as by numpy.ma.filled(values, numpy.nan)"
            )
    if np.ma.isMaskedArray(value):
        return value.data
    kind = getattr(getattr(value, "dtype", None), "kind", "")
    if kind and kind in "iuf" and not isinstance(value.dtype, np.dtype):
        return value.to_numpy(dtype=float, na_value=np.nan)
    return value


def with_gaps(value: Any) -> Any:
    """Numbers of which some may be missing, with NaN in the place of masked ones."""
    if isinstance(value, list | tuple):
        return [with_gaps(part) for part in value]
    if np.ma.isMaskedArray(value) and value.dtype.kind in "iuf":
        return np.ma.filled(value.astype(float), np.nan)
    return value


def _real(name: str, value: Any) -> Any:
    value = unmasked(name, value)
    try:
        array = value if hasattr(value, "dtype") else np.asarray(value)
    except (TypeError, ValueError):  # raised for unequal lengths, or traced numbers in a list
        try:
            array = jnp.asarray(value)
        except (TypeError, ValueError) as error:
            raise TypeError(f"{name} must be real numbers, got {value!r}") from error
    if not (jnp.issubdtype(array.dtype, np.floating) or jnp.issubdtype(array.dtype, np.integer)):
        raise TypeError(f"{name} must be real numbers, got {value!r}")
    return array


def is_there(given: Any) -> bool:
    """Whether a list of numbers, which may be traced, is not empty."""
    return len(given) > 0 if isinstance(given, list | tuple) else np.size(given) > 0


@contextlib.contextmanager
def traceable(name: str) -> Iterator[None]:
    """A block around a call of a user's function, in which errors of JAX say that the function must
    be traceable."""
    try:
        yield
    except (jax.errors.TracerArrayConversionError, jax.errors.ConcretizationTypeError) as error:
        raise TypeError(
            f"{name} makes a plain number of one that JAX traces: in it take functions of "
            "jax.numpy in the place of those of numpy and math (jnp.sin for np.sin), jnp.where for "
            "if, and no float()"
        ) from error


def is_valid(value: Any, zero: bool | None, most: float | None = None) -> Any:
    """Whether numbers are finite and positive, or `zero`; with None they may have any sign. With
    `most` their magnitudes are no larger. Of numbers of NumPy by NumPy: under `jit` jax would trace
    constants."""
    of: Any = np if isinstance(value, np.ndarray) else jnp
    fine = of.isfinite(value) if most is None else of.abs(value) <= most  # NaN is not
    return fine if zero is None else fine & ((value >= 0) if zero else (value > 0))


def check_all(
    rule: str | Status, values: Any, holds: Callable[[np.ndarray], Any] = np.isfinite
) -> None:
    """Raise `ValueError` with a rule, or that of a status, and what breaks it, unless it holds for
    all of some numbers, where these are known."""
    if not is_concrete(values):
        return
    numbers = np.asarray(values)
    fine = np.asarray(holds(numbers))
    if not fine.all():
        told = rule.message if isinstance(rule, Status) else rule
        wrong = numbers[~fine] if fine.shape == numbers.shape else numbers
        raise ValueError(f"{told}, got {wrong.item() if wrong.size == 1 else wrong}")


def increase(values: np.ndarray) -> np.ndarray:
    """Whether numbers in a list are finite and each is more than that before."""
    return np.isfinite(values).all() & (np.diff(values) > 0)


def positive(name: str, value: Any) -> Scalar:
    value = real_scalar(name, value)
    if not is_concrete(value):
        # NaN of a number that is not positive reaches all results, and with them the status; signs
        # could cancel.
        return jnp.where(is_valid(value, False), value, jnp.nan)
    if not is_valid(np.asarray(value), False):
        raise ValueError(f"{name} must be finite and > 0, got {value}")
    return value


def checked_speed(angular_speed: Any) -> Scalar:
    """The angular speed as a finite real scalar, or an error that names it."""
    speed = real_scalar("angular_speed", angular_speed)
    check_all(Status.INVALID_ANGULAR_SPEED, speed)
    return speed


def count_functions(name: str, value: int, least: int = 0) -> None:
    """Raise unless `value` is a whole number of functions or elements, at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"{name} must be an int, got {type(value).__name__}")
    if value < least:
        raise ValueError(f"{name} must be >= {least}, got {value}")
