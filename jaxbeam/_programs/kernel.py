"""Short programs of many small operations, at the speed that the hardware allows.

A step of a beam with few elements is some hundred operations on some hundred numbers. Run one by
one they take longer to start than to finish; batched with the lanes in front, their short inner
axes leave vector units idle. `kernel` mends both.
"""

import contextlib
import functools
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from jaxbeam._programs.batches import CPU_LANES, batchable, reaches
from jaxbeam._programs.lanes import in_kernel
from jaxbeam._programs.one_function import as_one_function
from jaxbeam._programs.platforms import by_platform


class Adjoint(NamedTuple):
    """A transpose that takes the place of the one that JAX would make."""

    # forwards(*args) returns the result and residuals, which `backwards` gets.
    forwards: Callable[..., tuple[Any, Any]]
    # backwards(moving, args, residuals, cotangent of the result) returns cotangents of the
    # arguments, None for leaves that `moving`, a tree of bools, says have no derivative.
    backwards: Callable[..., Any]


def kernel(
    function: Callable[..., Any], shared: bool = True, adjoint: Adjoint | None = None
) -> Callable[..., Any]:
    """A `function` of pytrees of floating-point arrays, differentiable to any order, made fast.

    Reverse mode may be applied once: higher derivatives are forward over that.
    The function must work on arrays that have axes of lanes behind those of one case, the same for
    each lane and independent of other lanes: `jax.vmap` calls it with batches in this form. With
    `shared`, leaves of its first argument that are equal for all lanes get an axis of lanes of
    length one, to be broadcast as by NumPy.

    In `reverse_mode` an `adjoint` takes the place of the function and its transpose.

    On a CPU the function and its first derivatives are compiled to one machine function each, where
    they consist of operations that allow it. Keep what this returns: it is traced once.
    """
    plain = _jitted(function)
    fast = _batched(plain, shared)
    maps_for = functools.cache(functools.partial(_maps, plain))
    both_ways = _both_ways(fast, maps_for)

    def transpose(*which: Any) -> Callable[..., Any]:
        if adjoint is None:
            return kernel(maps_for(*which)[1], shared=False)
        return _batched(_jitted(_given_transpose(adjoint.backwards, *which)))

    def no_residuals(*args: Any) -> tuple[Any, Any]:
        return fast(*args), ()

    forwards = no_residuals if adjoint is None else _batched(_jitted(adjoint.forwards), shared)
    in_reverse = _in_reverse(forwards, transpose)

    def call(*args: Any) -> Any:
        return (in_reverse if _IN_REVERSE.get() else both_ways)(*args)

    return call


_IN_REVERSE: ContextVar[bool] = ContextVar("in_reverse", default=False)


@contextlib.contextmanager
def reverse_mode() -> Iterator[None]:
    """A block in which kernels have derivatives by `jax.vjp` alone, not by `jax.jvp`."""
    token = _IN_REVERSE.set(True)
    try:
        yield
    finally:
        _IN_REVERSE.reset(token)


def in_reverse_mode() -> bool:
    """Whether the caller is in a block of `reverse_mode`."""
    return _IN_REVERSE.get()


def _is_zero(rate: Any) -> bool:
    return isinstance(rate, SymbolicZero)


def _jitted(function: Callable[..., Any]) -> Callable[..., Any]:
    @jax.jit
    def run(*args: Any) -> Any:
        with jax.numpy_rank_promotion("allow"), in_kernel():
            return function(*args)

    return run


# A function of the structure of the arguments and of which leaves move, that returns as `_maps`.
_Maps = Callable[[Any, tuple[bool, ...]], tuple[Callable[..., Any], Callable[..., Any]]]


def _maps(plain: Callable[..., Any], tree: Any, moving: tuple[bool, ...]) -> tuple[Any, Any]:
    """Derivatives of a function `plain` of a tree of arguments, some of whose leaves are `moving`:
    the map from (still, at, rates), with leaves `still` and moving ones `at`, to the rate of the
    result, and the transpose of that."""

    def partial(still: list[Array], at: list[Array]) -> Any:
        rest, moved = iter(still), iter(at)
        leaves = [next(moved) if moves else next(rest) for moves in moving]
        return plain(*jax.tree.unflatten(tree, leaves))

    def push(still: list[Array], at: list[Array], rates: list[Array]) -> Any:
        return jax.jvp(lambda *at: partial(still, list(at)), at, rates)[1]

    def pull(still: list[Array], at: list[Array], out: Any, kept: Any = ()) -> Any:
        return list(jax.vjp(lambda *at: partial(still, list(at)), *at)[1](out))

    return push, pull


def _given_transpose(
    back: Callable[..., Any], tree: Any, moving: tuple[bool, ...]
) -> Callable[..., Any]:
    """A transpose with the arguments of that of `_maps`, by a given function `back` as of
    `Adjoint.backwards`."""

    def pull(still: list[Array], at: list[Array], out: Any, kept: Any) -> list[Array]:
        rest, moved = iter(still), iter(at)
        leaves = [next(moved) if moves else next(rest) for moves in moving]
        which, args = (jax.tree.unflatten(tree, part) for part in (moving, leaves))
        return jax.tree.leaves(back(which, args, kept, out))

    return pull


def _in_reverse(
    fast: Callable[..., Any], transpose: Callable[..., Callable[..., Any]]
) -> Callable[..., Any]:
    """A function with derivatives in reverse mode alone, from `fast`, which returns a result and
    residuals, and `transpose`, which makes the transpose for a structure and the leaves that
    move."""
    transpose = functools.cache(transpose)

    @jax.custom_vjp
    def pulled(*args: Any) -> Any:
        return fast(*args)[0]

    def forwards(*args: Any) -> tuple[Any, Any]:
        values = jax.tree.map(lambda a: a.value, args)
        moves = [a.perturbed for a in jax.tree.leaves(args)]
        flat, tree = jax.tree.flatten(values)
        at = [a if m else None for a, m in zip(flat, moves, strict=True)]
        still = [None if m else a for a, m in zip(flat, moves, strict=True)]
        structure = jax.tree_util.Partial(tree.unflatten)  # type: ignore[attr-defined]
        out, kept = fast(*values)
        return out, (structure, at, still, kept)

    def backwards(residuals: Any, out: Any) -> Any:
        structure, at, still, kept = residuals
        unflatten = structure.func
        moving = tuple(a is not None for a in at)
        out = jax.tree.map(
            lambda o: jnp.zeros(o.shape, o.dtype) if _is_zero(o) else o, out, is_leaf=_is_zero
        )
        parts = ([a for a in part if a is not None] for part in (still, at))
        tree = jax.tree.structure(unflatten(range(len(at))))
        found = iter(transpose(tree, moving)(*parts, out, kept))
        return unflatten([next(found) if moves else None for moves in moving])

    pulled.defvjp(forwards, backwards, symbolic_zeros=True)
    return pulled


def _both_ways(fast: Callable[..., Any], maps: _Maps) -> Callable[..., Any]:
    """The function `fast` with derivatives in both modes, by linear `maps` of `_maps`."""

    @functools.cache
    def derivative(tree: Any, moving: tuple[bool, ...]) -> Callable[..., Any]:
        push, pull = maps(tree, moving)
        return _linear_map(_jitted(push), _jitted(pull))

    @jax.custom_jvp
    def both_ways(*args: Any) -> Any:
        return fast(*args)

    def rule(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Any, Any]:
        at, tree = jax.tree.flatten(primals)
        rates = jax.tree.leaves(tangents, is_leaf=_is_zero)
        moving = tuple(not _is_zero(rate) for rate in rates)
        parts = [
            [a for a, moves in zip(leaves, moving, strict=True) if moves == which]
            for leaves, which in ((at, False), (at, True), (rates, True))
        ]
        out = both_ways(*primals)
        return out, derivative(tree, moving)(*parts, out)

    both_ways.defjvp(rule, symbolic_zeros=True)
    return both_ways


def _linear_map(push: Callable[..., Any], pull: Callable[..., Any]) -> Callable[..., Any]:
    """The map from (still, at, rates, out) to push(still, at, rates), of the structure of `out`,
    with `pull` as its transpose.

    It is the solution y of [[1, 0], [-push, 1]] (x, y) = (rates, 0) by
    `jax.lax.custom_linear_solve`: of JAX's linear maps with a given transpose the one that can be
    batched and differentiated again.
    """
    fast_push, fast_pull = _batched(push), _batched(pull)

    def apply(still: list[Array], at: list[Array], rates: list[Array], out: Any) -> Any:
        def matvec(xy: Any) -> Any:
            x, y = xy
            return x, jax.tree.map(jnp.subtract, y, push(still, at, x))

        def solve(_: Any, xy: Any) -> Any:
            x, y = xy
            return x, jax.tree.map(jnp.add, y, fast_push(still, at, x))

        def transpose_solve(_: Any, xy: Any) -> Any:
            x, y = xy
            return jax.tree.map(jnp.add, x, fast_pull(still, at, y)), y

        # To be transposed, the whole right-hand side must depend linearly on the rates: so must the
        # zeros in it, and rates that are constants.
        nil = jnp.asarray(sum(jnp.where(np.False_, rate.ravel()[0], 0.0) for rate in rates))
        rates = [rate + nil.astype(rate.dtype) for rate in rates]
        zero = jax.tree.map(lambda a: jnp.broadcast_to(nil, a.shape).astype(a.dtype), out)
        return jax.lax.custom_linear_solve(matvec, (rates, zero), solve, transpose_solve)[1]

    return apply


def _batched(function: Callable[..., Any], shared: bool = False) -> Callable[..., Any]:
    """The function with the batch rule of kernels: lanes become last axes, and leaves that lanes
    share are copied, but those of the first argument if `shared`."""
    one = as_one_function(function)

    def call(*args: Any) -> Any:
        flat, tree = jax.tree.flatten(args)
        first = len(jax.tree.leaves(args[0])) if shared else 0

        def many(size: int, moves: tuple[bool, ...], leaves: list[Array]) -> Any:
            def in_rows_of(width: int) -> Callable[..., Any]:
                return lambda leaves: _in_rows(
                    lambda leaves: one(*jax.tree.unflatten(tree, leaves)),
                    size, width, moves, leaves, first,
                )  # fmt: skip

            if not reaches(size, CPU_LANES + 1):
                return in_rows_of(size)(leaves)
            return by_platform(leaves, cpu=in_rows_of(CPU_LANES), default=in_rows_of(size))

        def alone(leaves: list[Array]) -> Any:
            return one(*jax.tree.unflatten(tree, leaves))

        return batchable(alone, many, apart=True)(flat)

    return call


def _in_rows(
    one: Callable[..., Any], size: int, width: int, moves: tuple[bool, ...], leaves: list[Array],
    shared: int,
) -> Any:  # fmt: skip
    """The results of `size` lanes, in rows of `width`. Leaves that all lanes share are copied for
    each lane of a row, but not the first `shared` leaves."""
    rows = -(-size // width)
    extra = rows * width - size

    def last(a: Array, moved: bool, copies: int) -> Array:
        if not moved:
            return jnp.broadcast_to(a[..., None], (*a.shape, copies))
        # Copies of the last lane fill up the last row.
        a = jnp.concatenate([a, jnp.broadcast_to(a[-1:], (extra, *a.shape[1:]))])
        return jnp.moveaxis(a.reshape(rows, width, *a.shape[1:]), 1, -1)

    copies = [1] * shared + [width] * (len(leaves) - shared)
    moved = [last(*each) for each in zip(leaves, moves, copies, strict=True)]

    def row_results(row_leaves: list[Array]) -> Any:
        rest = iter(row_leaves)
        out = one(
            [next(rest) if moves_lane else a for a, moves_lane in zip(moved, moves, strict=True)]
        )
        return jax.tree.map(lambda a: jnp.broadcast_to(a, (*a.shape[:-1], width)), out)

    row_leaves = [a for a, moves_lane in zip(moved, moves, strict=True) if moves_lane]
    if rows == 1:
        # Without a loop, so that XLA can drop the transpositions between one kernel and the next.
        out = jax.tree.map(lambda a: a[None], row_results([a[0] for a in row_leaves]))
    else:
        out = jax.lax.map(row_results, row_leaves)
    return jax.tree.map(
        lambda a: jnp.moveaxis(a, -1, 1).reshape(rows * width, *a.shape[1:-1])[:size], out
    )
