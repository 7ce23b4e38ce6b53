"""Functions that XLA for CPUs compiles to one machine function each, with all loops fused."""

import functools
from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import ClosedJaxpr, Jaxpr, JaxprEqn, jaxpr_as_fun
from jax.interpreters.partial_eval import dce_jaxpr
from jaxtyping import Array

from jaxbeam._programs.lanes import pairwise_sum
from jaxbeam._programs.platforms import by_platform

# Operations, of those that this package uses, that XLA can compile as parts of one CPU function: no
# products of matrices (these call libraries), scattering, sorting or other calls.
# fmt: off
_ALLOWED = frozenset({
    "abs", "add", "add_any", "and", "atan2", "broadcast_in_dim", "clamp", "closed_call",
    "concatenate", "convert_element_type", "copy", "cos", "custom_jvp_call", "custom_linear_solve",
    "custom_vjp_call", "div", "dynamic_slice", "dynamic_update_slice", "eq", "eval_jaxpr", "exp",
    "ge", "gt", "integer_pow", "iota", "jit", "le", "log", "lt", "max", "min", "mul", "ne", "neg",
    "not", "or", "pad", "pow", "reduce_and", "reduce_or", "reduce_sum", "remat2", "reshape", "rev",
    "round", "rsqrt", "scan", "select_n", "sign", "sin", "slice", "split", "sqrt", "square",
    "squeeze", "stack", "stop_gradient", "sub", "transpose", "unstack", "while", "zeros_like",
})
# fmt: on
_REDUCED = 4000  # numbers that one sum may have: XLA calls a library for 4096 or more
_FEW = 16  # terms of a sum that are written out one by one: longer sums go by halves


def as_one_function(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that is compiled to one machine function on a CPU, if all its operations are
    allowed. Its derivatives are not: XLA may crash over forward mode of an adjoint."""

    @functools.cache
    def pushed() -> Callable[..., Any]:
        return jax.jit(lambda at, rates: jax.jvp(function, at, rates))

    @jax.custom_jvp
    @jax.jit
    def run(*args: Any) -> Any:
        closed, out = jax.make_jaxpr(function, return_shape=True)(*args)
        short = _shortened(without_dead_parts(closed))
        if not all(_is_allowed(equation) for equation in _equations(short)):
            return function(*args)

        @jax.jit
        def one_function(*args: Any) -> tuple[Any, Array]:
            leaves = jax.tree.leaves(args)
            # XLA crashes over unused operands here: a sum uses them all.
            used = sum(a[(0,) * a.ndim] if a.ndim else a for a in leaves if a.size)
            return jax.tree.unflatten(jax.tree.structure(out), jaxpr_as_fun(short)(*leaves)), used

        def fast(*args: Any) -> Any:
            # XLA moves constants into functions, and crashes over operands that are unused after
            # that: the barrier prevents it.
            args = jax.lax.optimization_barrier(args)
            how = {"xla_cpu_small_call": "true", "inlineable": "false"}
            return set_xla_metadata(one_function(*args), **how)[0]

        return by_platform(*args, cpu=fast, default=function)

    run.defjvp(lambda at, rates: pushed()(at, rates))
    return run


def _equations(closed: ClosedJaxpr | Jaxpr) -> Iterator[JaxprEqn]:
    """All equations of a program, those of inner programs included."""
    for equation in closed.eqns:
        yield equation
        inner = equation.params
        if equation.primitive.name == "custom_linear_solve":
            inner = inner["jaxprs"].solve
        for value in jax.tree.leaves(inner, is_leaf=_is_jaxpr):
            if _is_jaxpr(value):
                yield from _equations(value)


def _is_jaxpr(value: Any) -> bool:
    return isinstance(value, ClosedJaxpr | Jaxpr)


def _is_allowed(equation: JaxprEqn) -> bool:
    return equation.primitive.name in _ALLOWED and not _is_long_sum(equation)


def _is_long_sum(equation: Any) -> bool:
    return equation.primitive.name == "reduce_sum" and equation.invars[0].aval.size > _REDUCED


def without_dead_parts(closed: ClosedJaxpr) -> ClosedJaxpr:
    """The program without operations that its results do not need, inner programs included."""
    body, _ = dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars), instantiate=True)
    return ClosedJaxpr(body, closed.consts)


def without_rules(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of arrays without the rules for reverse mode (`jax.custom_vjp`) that functions
    within it have: JAX refuses forward mode where such a rule is left, even an unused one."""

    def run(*args: Any) -> Any:
        closed, out = jax.make_jaxpr(function, return_shape=True)(*args)
        plain = _mended(closed, _has_rule, _without_rule)
        return jax.tree.unflatten(
            jax.tree.structure(out), jaxpr_as_fun(plain)(*jax.tree.leaves(args))
        )

    return run


def _has_rule(equation: JaxprEqn) -> bool:
    return equation.primitive.name == "custom_vjp_call"


def _without_rule(equation: JaxprEqn) -> Callable[..., Any]:
    return jaxpr_as_fun(_mended(equation.params["call_jaxpr"], _has_rule, _without_rule))


def _shortened(closed: ClosedJaxpr) -> ClosedJaxpr:
    """The program with long sums in pieces, inner programs included: XLA gives long sums to a
    library, which one machine function cannot call."""
    return _mended(
        closed, _is_long_sum,
        lambda equation: functools.partial(_short_sum, axes=equation.params["axes"]),
    )  # fmt: skip


_Wrong = Callable[[JaxprEqn], bool]
_Instead = Callable[[JaxprEqn], Callable[..., Any]]


def _mended(closed: ClosedJaxpr, is_wrong: _Wrong, instead: _Instead) -> ClosedJaxpr:
    """The program in which a function `instead` takes the place of each equation that `is_wrong`,
    inner programs included."""
    return ClosedJaxpr(_mended_body(closed.jaxpr, is_wrong, instead), closed.consts)


def _mended_body(body: Jaxpr, is_wrong: _Wrong, instead: _Instead) -> Jaxpr:
    if not any(is_wrong(equation) for equation in _equations(body)):
        return body

    def inside(value: Any) -> Any:
        if isinstance(value, ClosedJaxpr):
            return _mended(value, is_wrong, instead)
        return _mended_body(value, is_wrong, instead) if isinstance(value, Jaxpr) else value

    def mended(equation: JaxprEqn) -> JaxprEqn:
        if is_wrong(equation):
            function, values = jax.jit(instead(equation)), [v.aval for v in equation.invars]
            [call] = jax.make_jaxpr(function)(*values).jaxpr.eqns
            return call.replace(invars=equation.invars, outvars=equation.outvars)
        inner = jax.tree.map(inside, equation.params, is_leaf=_is_jaxpr)
        return equation.replace(params=inner)

    return body.replace(eqns=[mended(equation) for equation in body.eqns])


def _short_sum(x: Array, axes: tuple[int, ...]) -> Array:
    for axis in sorted(axes, reverse=True):
        if x.size <= _REDUCED:
            x = jnp.sum(x, axis)
        elif x.shape[axis] <= _FEW:
            terms = [jax.lax.index_in_dim(x, i, axis, False) for i in range(x.shape[axis])]
            x = functools.reduce(jnp.add, terms)
        else:
            x = pairwise_sum(jnp.moveaxis(x, axis, 0))
    return x
