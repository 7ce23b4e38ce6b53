"""Compiled functions: compiled quickly for first calls, and well when they are called often."""

import functools
from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.extend.core import get_opaque_trace_state

from jaxbeam._programs.structure import name_of
from jaxbeam._programs.traced import Traces
from jaxbeam._programs.transformed import Transformations, around, linear_program, linearized

# XLA's older emitters of CPU code compile programs like ours in half the time, and the programs are
# as fast. The last releases of JAX for Python 3.11 still have them; later ones have no such option.
_HASTE = {"xla_cpu_use_fusion_emitters": False}
# At the first level of LLVM's optimiser programs compile in three quarters of the time of the
# third, JAX's default, and run as fast; but runs in time of many elements, or in batches, take up
# to a fifth longer to run.
_LEVEL = "xla_backend_optimization_level"
# Without LLVM's optimiser programs compile in a fifth to a half of the time, and take six to ten
# times as long to run.
QUICK = {_LEVEL: 0}
# Calls with arguments of one kind that use the program compiled quickly. By then they have taken,
# for programs of some milliseconds, about as long as to compile well, which is done next. Counted,
# not timed, so that a script gives the same bits each time that it runs.
CALLS = 32

_may_be_quick = True


class Program:
    """A decorator like `equinox.filter_jit`, with programs of two kinds.

    A user's first calls, as many as `calls`, are of a program that is compiled quickly and runs
    slowly, later ones of one that is compiled well. `calls` is zero for functions that work on many
    cases or for long. Within another program the function becomes a part of that; within
    transformations of JAX alone, such as `jax.grad`, it is compiled in the same way, as far as JAX
    allows. With `jit=jax.jit`, for functions of arrays alone, transformations have it without
    options, and its programs are freed with it; those of equinox stay for ever. `identity` returns
    what tells the function from others in a folder of programs (by default its name in this
    package), and `refused` is called with the error for which a program is not kept. `level` is
    that of the optimiser for what is compiled well.
    """

    def __init__(
        self, function: Callable[..., Any], jit: Any = eqx.filter_jit, calls: int = CALLS,
        identity: Callable[[], Any] | None = None,
        refused: Callable[[Exception], object] = lambda _: None, level: int = 1,
    ) -> None:  # fmt: skip
        functools.update_wrapper(self, function)
        self._jit, self._calls, self._level = jit, calls, level
        self._made: dict[Hashable, int] = {}  # quick calls made, for each kind of arguments
        self.part = part = jit(function)

        @functools.wraps(function)
        def whole(*args: Any, **kwargs: Any) -> Any:
            return part(*args, **kwargs)  # so that both kinds of programs share one trace

        self._whole = whole
        # Traced from `function`, since to `part`, as a program of JAX, 1, 1.0 and True are equal.
        self._traces = Traces(identity or (lambda: name_of(self)), function, refused)

    @functools.cached_property
    def well(self) -> "OuterProgram":
        """The well compiled program, for calls outside of all other programs."""
        how = _known(_HASTE) | _known({_LEVEL: self._level})
        made = self._jit(self._whole, compiler_options=how) if how else self.part
        return OuterProgram(made, self.part, self._traces, how)

    @functools.cached_property
    def quick(self) -> "OuterProgram":
        """The quickly compiled program, for calls outside of all other programs; `well` on devices
        whose compiler has no such option."""
        how = _known(QUICK)
        if not how:
            return self.well
        how = _known(_HASTE) | how
        made = self._jit(self._whole, compiler_options=how)
        return OuterProgram(made, self.part, self._traces, how)

    def for_call(self, *args: Any, **kwargs: Any) -> Any:
        """The program that a call with these arguments uses, which depends on whether it comes from
        within another program; the call is counted."""
        return self.part if _is_within() else self._counted(args, kwargs)

    def _counted(self, args: Any, kwargs: Any) -> "OuterProgram":
        """The program for a call outside of all other programs, which is counted."""
        kind = _kind((args, kwargs))
        program = self._next(kind)
        if program is not self.well:
            self._made[kind] = self._made.get(kind, 0) + 1
        return program

    def _next(self, kind: Hashable | None) -> "OuterProgram":
        """The program, `quick` or `well`, that the next call with arguments of a kind uses outside
        of all other programs."""
        may_be_quick = _may_be_quick and kind is not None
        return self.quick if may_be_quick and self._made.get(kind, 0) < self._calls else self.well

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        if (transformations := self._around()) is None:
            return self.for_call(*args, **kwargs)(*args, **kwargs)
        program = self.well if transformations.is_batched else self._counted(args, kwargs)
        return program.transformed(transformations, args, kwargs)

    def enough(self, *args: Any, **kwargs: Any) -> None:
        """Let all further calls with arguments of this kind use the well compiled program, since
        they take long."""
        self._made[_kind((args, kwargs))] = self._calls

    def at_length(self, *args: Any, **kwargs: Any) -> Any:
        """The result of a call that is known to take long, by the well compiled program."""
        if (transformations := self._around()) is None:
            return (self.part if _is_within() else self.well)(*args, **kwargs)
        return self.well.transformed(transformations, args, kwargs)

    def _around(self) -> Transformations | None:
        """Transformations of JAX around the caller in which a program may have options."""
        return around() if self._jit is eqx.filter_jit else None

    def prepare(self, *args: Any, **kwargs: Any) -> None:
        """Compile the program that the next call with these arguments will use; not to be called
        from within other programs."""
        self._next(_kind((args, kwargs))).prepare(*args, **kwargs)

    def lower(self, *args: Any, **kwargs: Any) -> Any:
        """The lowered program of a call with the same arguments, as by
        `jax.jit(function).lower`; whether programs are kept or not, it is the same one."""
        return (self.part if _is_within() else self.well).lower(*args, **kwargs)


class OuterProgram:
    """A program, with options of the compiler, for calls outside of all other programs: the traced
    one of `keep`'s folder where there is one."""

    def __init__(self, made: Any, part: Any, traces: Traces, options: dict[str, Any]) -> None:
        """`part` is the same program without options."""
        self._made, self._part, self._traces, self._options = made, part, traces, options

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        traced, arrays = self._traces.lookup(args, kwargs)
        if traced is None:
            return self._made(*args, **kwargs)
        return traced.result(traced.program(self._options)(*arrays))

    def transformed(self, transformations: Transformations, args: Any, kwargs: Any) -> Any:
        """The result of a call within transformations of JAX that no other program is around."""
        if not transformations.is_linearized:
            return self._made(*args, **kwargs)
        try:
            return linearized(self._made, self._linear, args, kwargs)
        except jax.errors.UnexpectedTracerError:  # functions among arguments close over what moves
            return self._part(*args, **kwargs)

    @functools.cached_property
    def _linear(self) -> Callable[..., Any]:
        """The program of the value and of the linearization, with the same options."""
        return linear_program(self._part, self._options)

    def prepare(self, *args: Any, **kwargs: Any) -> None:
        """Compile the program for a call with these arguments."""
        traced, arrays = self._traces.lookup(args, kwargs)
        if traced is None:
            self._made.lower(*args, **kwargs).compile()
        else:
            traced.program(self._options).lower(*arrays).compile()

    def lower(self, *args: Any, **kwargs: Any) -> Any:
        """The program lowered in this process, never a kept one."""
        return self._made.lower(*args, **kwargs)


def compile_well(always: bool = True) -> None:
    """Compile programs well from their first call on, or no longer.

    Unless it is `always`, the first calls are of programs that compile in a fifth to a half of the
    time and run six to ten times as long, and whose numbers differ in the last bits. Returns
    nothing.

    Raises `TypeError` unless `always` is a bool.
    """
    global _may_be_quick
    if not isinstance(always, bool):
        raise TypeError(f"always must be a bool, got {always!r}")
    _may_be_quick = not always


def _kind(arguments: Any) -> Hashable | None:
    """The kind of arguments that a program is compiled for: structure, shapes, types and static
    values; None where these cannot be hashed."""
    leaves, structure = jax.tree.flatten(arguments)
    kinds: list[Any] = [structure]
    for leaf in leaves:
        is_array = isinstance(leaf, jax.Array | np.ndarray | np.generic)
        kinds.append((leaf.shape, leaf.dtype) if is_array else leaf)
    try:
        hash(kind := tuple(kinds))
    except TypeError:
        return None
    return kind


def _is_within() -> bool:
    """Whether the caller is traced by another program or a transformation of JAX, in which programs
    with compiler options are not allowed."""
    return get_opaque_trace_state() != _outside()


@functools.cache
def _outside() -> Any:
    """The state of JAX in which nothing is traced."""
    return _elsewhere(get_opaque_trace_state)


def _elsewhere(ask: Callable[[], Any]) -> Any:
    """The answer of a function in a new thread, where nothing is traced."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(ask).result()


def _known(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options themselves where programs are for a CPU and the compiler has them, else none."""
    return dict(options) if _knows(tuple(options.items())) else {}


@functools.cache
def _knows(options: tuple[tuple[str, Any], ...]) -> bool:
    if jax.default_backend() != "cpu":
        return False
    try:
        _elsewhere(lambda: jax.jit(lambda: 0, compiler_options=dict(options)).lower().compile())
    except Exception:  # the class of the error differs from release to release
        return False
    return True
