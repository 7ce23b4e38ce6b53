"""What is done in one way on CPUs, and in another one elsewhere."""

from collections.abc import Callable
from typing import Any

import jax
from jax.extend import backend


def by_platform(*args: Any, cpu: Callable[..., Any], default: Callable[..., Any]) -> Any:
    """`jax.lax.platform_dependent`; but where there are only CPUs, what is for others is not even
    traced, which takes as long as what is used."""
    if _only_cpus():
        return cpu(*args)
    return jax.lax.platform_dependent(*args, cpu=cpu, default=default)


def _only_cpus() -> bool:
    return set(backend.backends()) <= {"cpu", "interpreter"}
