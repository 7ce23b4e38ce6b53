"""Programs under transformations of JAX that no program is around: `jax.grad(f)(x)` without
`jit`."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jax.extend.core import take_current_trace

# What JAX calls the traces of `jvp`, `vmap` and `linearize` (which `grad`, `vjp` and `jacrev` use),
# and that of no transformation at all. Where it calls them otherwise, nothing is compiled by
# options under transformations, as JAX does by itself.
_FORWARD, _BATCH, _LINEARIZE, _OUTSIDE = "JVPTrace", "BatchTrace", "LinearizeTrace", "EvalTrace"


class Around(NamedTuple):
    """The transformations of JAX around the caller."""

    is_batched: bool
    is_linearized: bool


def around() -> Around | None:
    """The transformations around the caller, if each of their steps runs at once; None outside of
    all, within a program, and where more than one is a linearization."""
    names = []
    with take_current_trace() as trace:
        while trace is not None:
            names.append(type(trace).__name__)
            trace = getattr(trace, "parent_trace", None)
    if len(names) < 2 or names.pop() != _OUTSIDE or {*names} - {_FORWARD, _BATCH, _LINEARIZE}:
        return None
    if names.count(_LINEARIZE) > 1:
        return None
    return Around(_BATCH in names, _LINEARIZE in names)


def linear_program(function: Callable[..., Any], options: dict[str, Any]) -> Callable[..., Any]:
    """The program of a function's value and of its linearization, compiled with these options: of
    what it is linearized by, and of all other arguments, as two trees of `(args, kwargs)`."""

    def value_and_slope(by: Any, other: Any) -> Any:
        def value(by: Any) -> Any:
            args, kwargs = eqx.combine(by, other)
            return eqx.partition(function(*args, **kwargs), eqx.is_inexact_array)

        return jax.linearize(value, by, has_aux=True)

    return eqx.filter_jit(value_and_slope, compiler_options=options)


def linearized(function: Callable[..., Any], program: Any, args: Any, kwargs: Any) -> Any:
    """The result of a function within a linearization, its value by the `linear_program` of it.

    JAX stages what is linear in a program of its own, in which none may have options: only the
    value, and what the linear part needs of it, are compiled with them.
    """
    traced, concrete = eqx.partition((args, kwargs), lambda x: isinstance(x, jax.core.Tracer))
    still: Any = None  # what the result has beside arrays

    @jax.custom_jvp
    def result(traced: Any) -> Any:
        nonlocal still
        args, kwargs = eqx.combine(traced, concrete)
        arrays, still = eqx.partition(function(*args, **kwargs), eqx.is_array)
        return arrays

    @result.defjvp
    def result_and_slope(primals: Any, tangents: Any) -> Any:
        nonlocal still
        by, fixed = eqx.partition(primals[0], eqx.is_inexact_array)
        moved = jax.tree.map(lambda x, t: None if x is None else t, by, tangents[0], is_leaf=_none)
        value, slope, rest = program(by, eqx.combine(fixed, concrete))
        integers, still = eqx.partition(rest, eqx.is_array)
        none = jax.tree.map(lambda x: np.zeros(x.shape, jax.dtypes.float0), integers)
        return eqx.combine(value, integers), eqx.combine(slope(moved), none)

    return eqx.combine(result(traced), still)


def _none(x: Any) -> bool:
    return x is None
