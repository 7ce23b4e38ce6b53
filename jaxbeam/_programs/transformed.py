"""Programs called within transformations of JAX, as by `jax.grad(f)(x)` without `jit`."""

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


class Transformations(NamedTuple):
    """The transformations of JAX around a call: whether one is a linearization, as in `grad`, and
    whether one is of a batch, as in `vmap` and `jacfwd`."""

    is_linearized: bool
    is_batched: bool


def around() -> Transformations | None:
    """The transformations around the caller, in which a program may have options of the compiler;
    None outside of all, within another program, within two linearizations, and within a
    linearization of a derivative in forward mode."""
    names = []
    with take_current_trace() as trace:
        while trace is not None:
            names.append(type(trace).__name__)
            trace = getattr(trace, "parent_trace", None)
    if len(names) < 2 or names.pop() != _OUTSIDE or {*names} - {_FORWARD, _BATCH, _LINEARIZE}:
        return None
    is_linearized = _LINEARIZE in names
    if is_linearized:
        first = names.index(_LINEARIZE)  # from the innermost transformation on
        if _FORWARD in names[:first] or _LINEARIZE in names[first + 1 :]:
            return None
    return Transformations(is_linearized, _BATCH in names)


def linear_program(function: Callable[..., Any], options: dict[str, Any]) -> Callable[..., Any]:
    """The program of a function's value and linearization, compiled with these options. It takes
    two trees of `(args, kwargs)`: the arrays by which it is linearized, and all that is left."""

    def value_and_slope(by: Any, other: Any) -> Any:
        def value(by: Any) -> Any:
            args, kwargs = eqx.combine(by, other)
            return eqx.partition(function(*args, **kwargs), eqx.is_inexact_array)

        return jax.linearize(value, by, has_aux=True)

    how: dict[str, Any] = {"compiler_options": options}  # which the types of equinox do not know
    return eqx.filter_jit(value_and_slope, **how)


def linearized(function: Callable[..., Any], program: Any, args: Any, kwargs: Any) -> Any:
    """The result of a function within a linearization by JAX, by the function's `linear_program`.

    JAX makes a program of its own of the linear part, in which no other may have options, so that
    those of `program` are for the value and for what the linear part takes from it.
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
