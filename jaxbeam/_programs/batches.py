"""Functions with rules of their own for batches, also nested ones, of `jax.vmap`."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_batching import custom_vmap
from jaxtyping import Array

from jaxbeam._programs.platforms import by_platform

# A function of the number n of cases, of which leaves have one value for each case, and of all
# leaves, that returns the results (n, ...).
Many = Callable[[int, tuple[bool, ...], list[Array]], Any]

CPU_LANES = 32  # cases that a CPU works on together: their matrices stay in the cache


_LARGE = 4 * CPU_LANES  # cases from which on a last row that is not full costs little


# As `Many`, but returns results, and which of them have a value for each case; or None.
Otherwise = Callable[[int, tuple[bool, ...], list[Array]], tuple[Any, Any] | None]


def reaches(size: int, number: int) -> bool:
    """Whether a batch has at least `number` cases; assumed of sizes that are symbols of
    `jax.export`."""
    return not isinstance(size, int) or size >= number


def batchable(
    one: Callable[..., Any], many: Many, apart: bool = False, unless: Otherwise | None = None
) -> Callable[..., Any]:
    """A function `one` of a list of arrays, of which a batch is computed by `many`.

    Nested batches become one batch, with copies of leaves that only some cases share. With `apart`,
    large batches within a batch that share a leaf go one after the other on a CPU, where copies
    would take longer than the work. Where `unless` returns results, these are taken, and `many` is
    not called.
    """
    function = custom_vmap(lambda leaves: one(leaves))

    @function.def_vmap
    def rule(size: int, batched: Any, leaves: list[Array]) -> tuple[Any, Any]:
        per_case = tuple(batched[0])
        if not any(per_case):  # calls by JAX for derivatives alone
            return _shared(one, leaves)
        found = unless(size, per_case, leaves) if unless else None
        if found is not None:
            return found
        out = _batch(many, size, per_case, apart, unless)(leaves)
        return out, jax.tree.map(lambda _: True, out)

    return function


def _batch(
    many: Many, size: int, per_case: tuple[bool, ...], apart: bool = False,
    unless: Otherwise | None = None,
) -> Callable[..., Any]:  # fmt: skip
    function = custom_vmap(lambda leaves: many(size, per_case, leaves))

    def as_one(more: int, varies: tuple[bool, ...], leaves: list[Array]) -> Any:
        each = zip(leaves, per_case, varies, strict=True)
        all_flat = [_flat(more, size, *one) for one in each]
        moves = tuple(a or b for a, b in zip(per_case, varies, strict=True))
        out = _batch(many, more * size, moves, apart, unless)(all_flat)
        return jax.tree.map(lambda a: a.reshape(more, size, *a.shape[1:]), out)

    def in_turn(more: int, varies: tuple[bool, ...], leaves: list[Array]) -> Any:
        def each(moving: list[Array]) -> Any:
            rest = iter(moving)
            here = [next(rest) if v else a for a, v in zip(leaves, varies, strict=True)]
            return many(size, per_case, here)

        def on_cpu(leaves: list[Array]) -> Any:
            return jax.lax.map(each, [a for a, v in zip(leaves, varies, strict=True) if v])

        return by_platform(leaves, cpu=on_cpu, default=lambda leaves: as_one(more, varies, leaves))

    @function.def_vmap
    def rule(more: int, batched: Any, leaves: list[Array]) -> tuple[Any, Any]:
        varies = tuple(batched[0])
        if not any(varies):
            return _shared(lambda leaves: many(size, per_case, leaves), leaves)
        found = _case_by_case(unless, more, per_case, varies, leaves) if unless else None
        if found is not None:
            return found
        shares = any(v and not o for v, o in zip(varies, per_case, strict=True))
        if apart and shares and reaches(size, _LARGE):
            out = _batch(in_turn, more, varies)(leaves)
        else:
            out = as_one(more, varies, leaves)
        return out, jax.tree.map(lambda _: True, out)

    return function


def one_by_one(one: Callable[..., Any], quick: Callable[..., Any] | None = None) -> Any:
    """A function `one` of arrays, of which a batch goes case by case on a CPU, all at once on a
    GPU.

    It is for calls of libraries, which take batches on a GPU, where single calls would start many
    kernels for each case. There `quick` takes the batch, and returns results and whether each is
    right; those that are not are computed by `one`, case by case. Without `quick`, `one` takes the
    batch.
    """
    function = custom_vmap(one)

    @function.def_vmap
    def rule(size: int, batched: Any, *given: Array) -> tuple[Any, Any]:
        if not any(batched):
            return _shared(one, *given)
        axes = [0 if is_per_case else None for is_per_case in batched]

        def on_cpu(*given: Array) -> Any:
            def each(leaves: list[Array]) -> Any:
                moving = iter(leaves)
                here = [
                    a if axis is None else next(moving) for a, axis in zip(given, axes, strict=True)
                ]
                return function(*here)

            return jax.lax.map(each, [a for a, axis in zip(given, axes, strict=True) if axis == 0])

        def elsewhere(*given: Array) -> Any:
            if quick is None:
                return jax.vmap(one, axes)(*given)
            found, certain = jax.vmap(quick, axes)(*given)

            def again(which: Array) -> Any:
                return one(
                    *(a if axis is None else a[which] for a, axis in zip(given, axes, strict=True))
                )

            return mended(found, certain, again)

        out = by_platform(*given, cpu=on_cpu, default=elsewhere)
        return out, jax.tree.map(lambda _: True, out)

    return function


def in_rows(
    one: Callable[[list[Array]], Any], size: int, width: int, per_case: tuple[bool, ...],
    leaves: list[Array],
) -> Any:  # fmt: skip
    """The results of a batch of `size` cases, `width` at a time, whose numbers fit into the cache.
    `per_case` says which leaves have a value for each case."""
    rows = -(-size // width)
    extra = rows * width - size

    def cut(a: Array) -> Array:
        # Copies of the last case fill up the last row.
        a = jnp.concatenate([a, jnp.broadcast_to(a[-1:], (extra, *a.shape[1:]))])
        return a.reshape(rows, width, *a.shape[1:])

    def row(moving: list[Array]) -> Any:
        rest = iter(moving)
        here = [next(rest) if moves else a for a, moves in zip(leaves, per_case, strict=True)]
        return jax.vmap(one, ([0 if moves else None for moves in per_case],))(here)

    moving = [cut(a) for a, moves in zip(leaves, per_case, strict=True) if moves]
    out = jax.lax.map(row, moving)
    return jax.tree.map(lambda a: a.reshape(rows * width, *a.shape[2:])[:size], out)


def mended(results: Any, certain: Array, again: Callable[[Array], Any]) -> Any:
    """Results of a batch, of which those that are not `certain` are computed `again`, a function of
    the index, case by case."""
    doubtful = jnp.argsort(certain)

    def mend(i: Array, results: Any) -> Any:
        which = doubtful[i]
        return jax.tree.map(lambda all, one: all.at[which].set(one), results, again(which))

    return jax.lax.fori_loop(0, jnp.sum(~certain), mend, results)


def _shared(function: Callable[..., Any], *given: Any) -> tuple[Any, Any]:
    """The results of a function whose arguments all cases share, with False for each: none has a
    value for each case, as rules for batches of JAX return it."""
    out = function(*given)
    return out, jax.tree.map(lambda _: False, out)


def _flat(more: int, size: int, a: Array, per_case: bool, varies: bool) -> Array:
    """A leaf of a batch of batches, reshaped as one of a single batch."""
    if not per_case:
        return jnp.repeat(a, size, 0) if varies else a
    a = a if varies else jnp.broadcast_to(a, (more, *a.shape))
    return a.reshape(more * size, *a.shape[2:])


def _case_by_case(
    unless: Otherwise, more: int, per_case: tuple[bool, ...], varies: tuple[bool, ...],
    leaves: list[Array],
) -> tuple[Any, Any] | None:  # fmt: skip
    """The results of `unless` for each case of a batch of batches, and which of them have a value
    for each case; None where it has none."""
    flags: Any = None

    def case(leaves: list[Array]) -> Any:
        nonlocal flags
        out, flags = unless(more, varies, leaves) or (None, None)
        return out

    axes = [(1 if v else 0) if o else None for o, v in zip(per_case, varies, strict=True)]
    out = jax.vmap(case, (axes,))(leaves)
    if flags is None:
        return None
    return jax.tree.map(lambda a, f: jnp.swapaxes(a, 0, 1) if f else a, out, flags), flags
