"""What tells a function from others: the program that it compiles to, and all numbers in that."""

import contextlib
import functools
import hashlib
import inspect
from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, Jaxpr, Literal

from jaxbeam._sweeps.chunks import batched, lowered


def program_of(function: Callable[..., Any], columns: dict[str, jax.Array]) -> dict[str, Any]:
    """A digest of the program that a function compiles to, with all constants and bound arrays;
    and, for people, the function's name and what it reads.

    The text of a program holds its constants or names them as arguments, by a setting of JAX. So
    they are taken from what was traced, too.
    """
    program = hashlib.sha256(lowered(function, columns).as_text().encode())
    traced, *_ = eqx.filter_make_jaxpr(batched)(function, columns)
    for number in (*_constants(traced), *jax.tree.leaves(eqx.filter(function, eqx.is_array))):
        array = plain_array(number)
        program.update(f"{array.dtype} {array.shape}".encode() + array.tobytes())
    bare = inspect.unwrap(function)
    while isinstance(bare, functools.partial):  # `jax.tree_util.Partial` is one
        bare = bare.func
    name = getattr(bare, "__qualname__", type(bare).__qualname__)
    return {
        "function": f"{getattr(bare, '__module__', None)}.{name}",
        "reads": _reads(function, bare),
        "program": program.hexdigest(),
    }


def plain_array(value: Any) -> np.ndarray:
    """Numbers as an array of NumPy; of a key of random numbers those that it consists of."""
    is_key = eqx.is_array(value) and jnp.issubdtype(value.dtype, jax.dtypes.prng_key)
    return np.asarray(jax.random.key_data(value) if is_key else value)


def _constants(traced: Any) -> Iterator[Any]:
    """The constants of a traced program and of all programs within it, in order."""
    if isinstance(traced, ClosedJaxpr):
        yield from traced.consts
        traced = traced.jaxpr
    for step in traced.eqns:
        yield from _literals(step.invars)
        for part in jax.tree.leaves(step.params, is_leaf=_is_program):
            if _is_program(part):
                yield from _constants(part)
    yield from _literals(traced.outvars)


def _is_program(part: Any) -> bool:
    return isinstance(part, ClosedJaxpr | Jaxpr)


def _literals(variables: Any) -> Iterator[Any]:
    return (each.val for each in variables if isinstance(each, Literal))


def _reads(function: Any, bare: Any) -> dict[str, str]:
    """Modules and numbers that a function is bound to or finds in its module."""
    parts: dict[str, Any] = {}
    if isinstance(function, eqx.Module):
        parts = {name: getattr(function, name) for name in vars(function)}
    elif isinstance(function, functools.partial):
        parts = {**{str(i): a for i, a in enumerate(function.args)}, **function.keywords}
    if inspect.isfunction(bare):
        with contextlib.suppress(ValueError):  # raised for a variable that is not bound yet
            outside = inspect.getclosurevars(bare)
            parts |= {**outside.globals, **outside.nonlocals}
    kinds = (eqx.Module, int, float, str, np.ndarray, jax.Array, tuple, dict)

    def number(leaf: Any) -> Any:
        return plain_array(leaf).tolist() if eqx.is_array(leaf) and leaf.ndim == 0 else leaf

    return {
        name: eqx.tree_pformat(jax.tree.map(number, part), short_arrays=False)
        for name, part in parts.items()
        if isinstance(part, kinds)
    }
