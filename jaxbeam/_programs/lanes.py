"""The rule of lanes: what `kernel` works on has the axes of a batch behind all others.

Arithmetic of numbers alike is then that of whole arrays, in the vector units of a processor. Most
of NumPy works with it as it is: sums and products of arrays, indexing and stacking along first
axes. Here is the rest, with which functions for one case are functions for many: tables of
constants beside arrays with lanes, products that sum over an axis, and sums along the first axis.

To write `@` and `jnp.sum` in their place, and have a traced program rewritten, would have to know
of every product which of its axes are lanes once `jax.vmap` has put them in front; these functions
say so where it is known.
"""

import contextlib
import functools
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.xla_metadata import set_xla_metadata
from jaxtyping import Array, Float

from jaxbeam._programs.platforms import is_for_cpus

LARGE = 48  # rows beyond which a dense matrix is none for `kernel`
_IN_KERNEL: ContextVar[bool] = ContextVar("in_kernel", default=False)
# A matrix, or constants of one, with lanes behind its axes.
LaneMatrix = Float[Array, "_ _ *#lanes"] | Float[np.ndarray, "_ _ *#lanes"]
_WRITTEN_OUT = 16  # terms of a sum that are written out one by one; where they are more, in groups
_TRANSPOSED: ContextVar[bool] = ContextVar("transposed", default=False)


@contextlib.contextmanager
def transposed(on: bool = True) -> Iterator[None]:
    """A block whose products have transposes of their own, so that they bear `jax.vjp` alone.

    The transpose of the parts that products are written out in would put arrays together from
    slices. Within the block `transposed(False)` makes them as outside.
    """
    token = _TRANSPOSED.set(on)
    try:
        yield
    finally:
        _TRANSPOSED.reset(token)


@contextlib.contextmanager
def in_kernel() -> Iterator[None]:
    """A block in which what is traced is for a `kernel`."""
    token = _IN_KERNEL.set(True)
    try:
        yield
    finally:
        _IN_KERNEL.reset(token)


def is_transposed() -> bool:
    """Whether the caller is in a block of `transposed`."""
    return _TRANSPOSED.get()


def sum_of_products(a: Any, x: Any, axis: int, lanes: int) -> Array:
    """Sum over an axis of a * x, which broadcast: the form of a product that a kernel bears.

    Where there are axes of lanes it is written out, so that they fill vector units.
    """
    return _transposable((a, x), axis, lanes) if is_transposed() else _contract(a, x, axis, lanes)


def _contract(a: Any, x: Any, axis: int, lanes: int) -> Array:
    if not lanes:
        return jnp.sum(a * x, axis)

    def part(array: Any, of: int | slice) -> Any:
        if array.shape[axis] == 1:
            return array[(slice(None),) * axis + (0 if isinstance(of, int) else slice(None),)]
        return array[(slice(None),) * axis + (of,)]

    def total_of(terms: int, term: Any) -> Any:
        return functools.reduce(jnp.add, map(term, range(terms)))

    count = max(a.shape[axis], x.shape[axis])
    if count <= _WRITTEN_OUT:
        return total_of(count, lambda i: part(a, i) * part(x, i))
    groups = -(-count // _WRITTEN_OUT)
    each = count // groups

    def grouped(array: Any) -> Any:
        shape = (1, 1) if array.shape[axis] == 1 else (groups, each)
        whole = part(array, slice(groups * each))
        return whole.reshape(*array.shape[:axis], *shape, *array.shape[axis + 1 :])

    sums = _contract(grouped(a), grouped(x), axis + 1, lanes)
    out = total_of(groups, lambda i: jax.lax.index_in_dim(sums, i, axis, keepdims=False))
    if groups * each == count:
        return jnp.asarray(out)
    rest = slice(groups * each, None)
    return out + _contract(part(a, rest), part(x, rest), axis, lanes)


@eqx.filter_custom_vjp
def _transposable(both: tuple[Any, Any], axis: int, lanes: int) -> Array:
    return _contract(*both, axis, lanes)


@_transposable.def_fwd
def _forwards(perturbed: Any, both: tuple[Any, Any], axis: int, lanes: int) -> tuple[Array, None]:
    return _contract(*both, axis, lanes), None


@_transposable.def_bwd
def _backwards(
    residuals: None, out: Array, perturbed: Any, both: tuple[Any, Any], axis: int, lanes: int
) -> tuple[Any, Any]:
    out = jnp.expand_dims(out, axis)

    def pulled(own: Any, other: Any) -> Array:
        """Sum of the other factor times `out` over the axes along which this one is repeated."""
        whole = jnp.broadcast_shapes(own.shape, other.shape)
        repeated = [i for i, n in enumerate(whole) if own.shape[i] != n]
        if not repeated:
            return jnp.broadcast_to(other * out, whole)
        found = jnp.expand_dims(_contract(other, out, repeated[0], lanes), repeated[0])
        for i in repeated[1:]:
            found = pairwise_sum(jnp.moveaxis(found, i, 0))[None]
            found = jnp.moveaxis(found, 0, i)
        return jnp.broadcast_to(found, own.shape)

    a, x = both
    moves = [p is True for p in perturbed]
    return pulled(a, x) if moves[0] else None, pulled(x, a) if moves[1] else None


def matmul(a: LaneMatrix, b: LaneMatrix) -> Array:
    """The product of two matrices, in the form that a kernel bears if this is in one."""
    lanes = max(a.ndim, b.ndim) - 2
    return (
        sum_of_products(a[:, :, None], b[None], 1, lanes)
        if _is_written_out(lanes)
        else jnp.asarray(a @ b)
    )


def matvec(a: LaneMatrix, x: Float[Array, "b *#lanes"]) -> Array:
    """The product of a matrix and a vector, in the form that a kernel bears if this is in one."""
    lanes = x.ndim - 1
    return sum_of_products(a, x[None], 1, lanes) if _is_written_out(lanes) else jnp.asarray(a @ x)


def _is_written_out(lanes: int) -> bool:
    """Whether a product with so many axes of lanes is written out as sums, and not given to a
    library."""
    return lanes > 0 or _IN_KERNEL.get()


def matvec_once(a: LaneMatrix, x: Float[Array, "b *#lanes"]) -> Array:
    """The product of a matrix and a vector, computed once, and its factors too.

    Neither are the factors made anew for each row, nor is the product for each use, and a loop over
    lanes has no more in it than compilers vectorise.
    """
    return compute_once(matvec(a, compute_once(x)))


def weighted_sum(
    weights: Float[Array, "k *#lanes"], tables: Float[Array, "k n n *#lanes"]
) -> Array:
    """The sum of matrices with weights, which are computed once."""
    lanes = weights.ndim - 1
    if not _is_written_out(lanes):
        return jnp.tensordot(weights, tables, 1)
    return sum_of_products(compute_once(weights)[:, None, None], tables, 0, lanes)


def append_axes(table: Any, axes: int) -> Any:
    """A table with axes of length one behind its own, so that it broadcasts over lanes."""
    return table.reshape(*table.shape, *(1,) * axes)


def pairwise_sum(x: Float[Array, "n *rest"]) -> Float[Array, "*rest"]:
    """Sum along the first axis, by halves (pairwise summation)."""
    if len(x) == 3:  # the same sum, in fewer operations
        return x[0] + x[1] + x[2]
    while len(x) > 1:
        half = len(x) // 2
        x = jnp.concatenate([x[:half] + x[half : 2 * half], x[2 * half :]])
    return x[0]


@jax.jit
def _same(values: Any) -> Any:
    return values


def compute_once(values: Any) -> Any:
    """Arrays as they are, computed once: a barrier to the fusion of loops.

    XLA for CPUs joins loops, and would rather compute a product or a sum anew for each row of
    numbers that is made of it, and what that is made of; but not across the border of a call.
    """
    if not is_for_cpus():
        return values
    if not _IN_KERNEL.get():
        # XLA moves constants into functions, and ends the process over operands that nothing uses
        # any more. Kernels have their own barrier, and could not be one function with this.
        values = jax.lax.optimization_barrier(values)
    with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
        return _same(values)
