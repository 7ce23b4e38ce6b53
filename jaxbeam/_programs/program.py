"""Compiled functions, by a compiler in a hurry where there is one."""

import functools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
from jax.extend.core import get_opaque_trace_state

# XLA once had other emitters of code for the CPU, which take half as long for programs like ours
# and make them as fast. The last releases of JAX for Python 3.11 have both; later ones know no
# such option.
_HASTE = {"xla_cpu_use_fusion_emitters": False}


class Program:
    """`equinox.filter_jit` of a function: a decorator.

    Called by a user it compiles in haste. Within another program or a transformation it becomes a
    part of what is compiled there, by the options of that. With `jit=jax.jit`, for functions of
    arrays alone, its programs end with it; those of equinox stay for ever.
    """

    def __init__(self, function: Callable[..., Any], jit: Any = eqx.filter_jit) -> None:
        functools.update_wrapper(self, function)
        self.part = part = jit(function)

        @functools.wraps(function)
        def whole(*args: Any, **kwargs: Any) -> Any:
            return part(*args, **kwargs)  # what is traced for one is there for the other

        how: Any = {"compiler_options": _HASTE}
        self.alone = jit(whole, **how)

    @property
    def here(self) -> Any:
        """The program that a call from here takes."""
        alone = _haste() and get_opaque_trace_state() == _outside()
        return self.alone if alone else self.part

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self.here(*args, **kwargs)

    def lower(self, *args: Any, **kwargs: Any) -> Any:
        """The lowered program of a call with the same arguments, as by
        `jax.jit(function).lower`."""
        return self.here.lower(*args, **kwargs)


def _elsewhere(ask: Callable[[], Any]) -> Any:
    """The answer in a new thread, where nothing is traced."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(ask).result()


@functools.cache
def _outside() -> Any:
    """What JAX calls the state in which nothing is traced."""
    return _elsewhere(get_opaque_trace_state)


@functools.cache
def _haste() -> bool:
    """Whether programs are compiled for a CPU, by a compiler that knows the option."""
    if jax.default_backend() != "cpu":
        return False
    try:
        _elsewhere(lambda: jax.jit(lambda: 0, compiler_options=_HASTE).lower().compile())
    except Exception:  # of what kind differs from release to release
        return False
    return True
