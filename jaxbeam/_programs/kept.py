"""Functions of users whose programs are kept between processes."""

import functools
import warnings
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from jaxbeam._programs.functions import identity
from jaxbeam._programs.program import Program
from jaxbeam._programs.structure import NotKept


def kept(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function like `jax.jit` of it, whose program is kept in the folder of `keep`, if there is
    one.

    `function` is of pytrees of arrays and numbers, and returns such; or what `jax.grad`, `jax.vmap`
    and their kin make of one. Without `keep` this is a `jax.jit` whose first calls are of a program
    that is compiled quickly, as those of this package are. Within another transformation it is
    a part of that: write `kept(jax.grad(f))`, not `jax.grad(kept(f))`.

    A program never answers for another function: it belongs to the instructions and constants of
    `function` and of all functions that it refers to, in closures and by names in its module, and
    to the values of numbers and arrays that it finds there, as they are at the first call. Other
    names may mean parts of jaxbeam, JAX, NumPy, Equinox, diffrax, optimistix and lineax (of their
    installed versions), and of Python what knows nothing but arguments: `math`, `functools`, `len`
    and so on. A function that refers to anything else (modules and classes of yours, `open`,
    `numpy.load`, `jb.blades.read_blade`, random numbers) is compiled in each process, with a
    warning: hand it such things as arguments. So is one that calls back to Python, as those of this
    package do to raise: pass `throw=False`. What a function of those packages is told to read from
    a file behind another name is not seen.

    Returns the compiled function, with the arguments and results of `jax.jit(function)`.

    Raises `TypeError` unless `function` can be called.
    """
    if not callable(function):
        raise TypeError(f"function must be a function, got {type(function).__name__}")

    def of_arrays(*args: Any, **kwargs: Any) -> Any:
        return _as_arrays(function(*args, **kwargs))

    of_arrays.__name__ = getattr(function, "__name__", type(function).__name__)
    program = Program(
        of_arrays, jax.jit, identity=lambda: ["kept", identity(function)],
        refused=functools.partial(_warn, function),
    )  # fmt: skip

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        return program(*_as_arrays(args), **_as_arrays(kwargs))

    return call


def _warn(function: Callable[..., Any], error: Exception) -> None:
    why = f"of {error}" if isinstance(error, NotKept) else "it calls back to Python"
    warnings.warn(
        f"the program of {getattr(function, '__qualname__', function)} is not kept, because {why}: "
        "see help(jaxbeam.programs.kept)",
        stacklevel=2,
    )


def _as_arrays(tree: Any) -> Any:
    """A tree with arrays in the place of numbers of Python: `jax.jit` takes and returns them."""
    numbers = bool, int, float, complex
    return jax.tree.map(lambda x: jnp.asarray(x) if isinstance(x, numbers) else x, tree)
