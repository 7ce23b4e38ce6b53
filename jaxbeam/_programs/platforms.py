"""What is done in one way on CPUs, and in another one elsewhere."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend import backend
from jaxtyping import Array

# For what a function is traced: "cpu", "others", or, outside of `by_platform`, None. JAX's caches
# see a context of this kind, so that what is traced for one is not taken for the other.
_TRACED_FOR = jax.make_user_context(None)


def once(rows: Array) -> Array:
    """Rows of numbers (k, p), which are computed once: compilers for CPUs would rather make what is
    dear, a cosine say, anew for each of the many numbers that it is a factor of. What they do not
    put off is a product of matrices, if only with the unit matrix."""
    return jnp.eye(len(rows), dtype=rows.dtype) @ rows


def by_platform(*args: Any, cpu: Callable[..., Any], default: Callable[..., Any]) -> Any:
    """The result of `jax.lax.platform_dependent`; but where there are only CPUs, what is for others
    is not even traced, which takes as long as what is used. Nor is, within one, what is for the
    other."""
    if loops_are_dear():
        return default(*args)
    if is_for_cpus():
        return cpu(*args)
    return jax.lax.platform_dependent(
        *args, cpu=traced_for("cpu", cpu), default=traced_for("others", default)
    )


def is_for_cpus() -> bool:
    """Whether it is sure that what is traced here is for CPUs."""
    return not loops_are_dear() and (_only_cpus() or bool(_TRACED_FOR.value == "cpu"))


def loops_are_dear() -> bool:
    """Whether what is traced here is for a device, such as a GPU, that starts some kernels of its
    own in each turn of a loop, which takes longer than a short turn does. A short loop is better
    written out there; on a CPU it keeps in the cache what it works on, and programs small."""
    return bool(_TRACED_FOR.value == "others")


def traced_for(which: str | None, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that is traced as if for "cpu" or for "others" alone."""

    def traced(*args: Any) -> Any:
        with _TRACED_FOR(which):
            return function(*args)

    return traced


def _only_cpus() -> bool:
    return set(backend.backends()) <= {"cpu", "interpreter"}
