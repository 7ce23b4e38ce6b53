"""Choices between CPUs and other devices, such as GPUs, when functions are traced."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend import backend
from jaxtyping import Array

# The device that a function is traced for: "cpu", "others", or None outside of `by_platform`. As a
# context of JAX it is a key of JAX's caches, so that no trace for one device is used for another.
_TRACED_FOR = jax.make_user_context(None)


def once(rows: Array) -> Array:
    """Rows of numbers (k, p) as they are, computed once. XLA for CPUs may compute a dear factor,
    such as a cosine, again for each of the numbers that it multiplies; but it computes a product of
    matrices once, here with the unit matrix."""
    return jnp.eye(len(rows), dtype=rows.dtype) @ rows


def by_platform(*args: Any, cpu: Callable[..., Any], default: Callable[..., Any]) -> Any:
    """The result of `cpu` on CPUs, of `default` elsewhere, by `jax.lax.platform_dependent`. Where
    the device is known (there are only CPUs, or this is within another `by_platform`) the other
    function is not even traced, which would take as long as the one that is used."""
    if loops_are_dear():
        return default(*args)
    if is_for_cpus():
        return cpu(*args)
    return jax.lax.platform_dependent(
        *args, cpu=traced_for("cpu", cpu), default=traced_for("others", default)
    )


def is_for_cpus() -> bool:
    """Whether functions that are traced here are known to be for CPUs."""
    return not loops_are_dear() and (_only_cpus() or bool(_TRACED_FOR.value == "cpu"))


def loops_are_dear() -> bool:
    """Whether functions that are traced here are for a device, such as a GPU, that starts kernels
    of its own in each turn of a loop: this takes longer than a short turn. Short loops are better
    written out there, while on a CPU they keep data in the cache and programs small."""
    return bool(_TRACED_FOR.value == "others")


def traced_for(which: str | None, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that is traced as if for "cpu" or for "others" alone."""

    def traced(*args: Any) -> Any:
        with _TRACED_FOR(which):
            return function(*args)

    return traced


def _only_cpus() -> bool:
    return set(backend.backends()) <= {"cpu", "interpreter"}
