"""Annotations of shapes, executed: whoever imports the package after `check` gets it checked.

Only annotations of arrays are, in arguments, results and fields: what else a user may get wrong is
for the package itself to refuse, in words of its own.
"""

import inspect
import types
import typing
from collections.abc import Callable
from typing import Any

import beartype
from jaxtyping import AbstractArray, install_import_hook

# What is written into sources for the hook to find.
_TYPECHECKER = "tests.shapes.arrays_alone"


def check() -> None:
    """Have the modules of the package that are imported from now on checked."""
    install_import_hook("jaxbeam", _TYPECHECKER)


def arrays_alone(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, with annotations of arrays checked whenever it is called."""
    if not inspect.isfunction(function):
        return function
    function.__annotations__ = {
        name: kind for name, kind in function.__annotations__.items() if _is_of_arrays(kind)
    }
    return beartype.beartype(function)


def _is_of_arrays(kind: Any) -> bool:
    """An array of a shape; a tuple of such; or one of several, or none."""
    if typing.get_origin(kind) in (tuple, typing.Union, types.UnionType):
        return all(_is_of_arrays(one) or one is type(None) for one in typing.get_args(kind))
    return inspect.isclass(kind) and issubclass(kind, AbstractArray)
