"""Operations on arrays with lanes: in a `kernel`, arrays have axes of lanes behind all others.

So the vector units of a processor work on whole rows of lanes. Most operations of NumPy work on
such arrays as they are: sums and products of arrays, indexing and stacking along first axes. Here
are the others, with which a function for one case is one for many: constants beside arrays with
lanes, products that sum over an axis, and sums along the first axis.

Rewriting traced programs with `@` and `jnp.sum` instead would have to find out of every product
which of its axes are lanes, after `jax.vmap` has put them in front; these functions state it.
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

LARGE = 48  # rows beyond which a dense matrix is too large for a `kernel`
_IN_KERNEL: ContextVar[bool] = ContextVar("in_kernel", default=False)
# A matrix with axes of lanes behind its own, or a constant matrix without lanes.
LaneMatrix = Float[Array, "_ _ *#lanes"] | Float[np.ndarray, "_ _ *#lanes"]
_WRITTEN_OUT = 16  # terms of a sum that are written out one by one; longer sums go in groups
_TRANSPOSED: ContextVar[bool] = ContextVar("transposed", default=False)


@contextlib.contextmanager
def transposed(on: bool = True) -> Iterator[None]:
    """A block in which `sum_of_products` has a transpose that is given, and derivatives by
    `jax.vjp` alone.

    JAX's transpose of the slices that products are written out in would put arrays together from
    slices, slowly. Within the block `transposed(False)` gives the derivatives of JAX again.
    """
    token = _TRANSPOSED.set(on)
    try:
        yield
    finally:
        _TRANSPOSED.reset(token)


@contextlib.contextmanager
def in_kernel() -> Iterator[None]:
    """A block in which functions are traced for a `kernel`: matrices are multiplied by sums."""
    token = _IN_KERNEL.set(True)
    try:
        yield
    finally:
        _IN_KERNEL.reset(token)


def is_transposed() -> bool:
    """Whether the caller is in a block of `transposed`."""
    return _TRANSPOSED.get()


def sum_of_products(a: Any, x: Any, axis: int, lanes: int) -> Array:
    """The sum over an axis of a * x, which broadcast, with so many axes of `lanes`: the form of a
    product of matrices that is allowed in a kernel.

    With lanes it is written out as a sum of arrays, so that lanes fill vector units.
    """
    return _transposable((a, x), axis, lanes) if is_transposed() else _contract(a, x, axis, lanes)


def _contract(a: Any, x: Any, axis: int, lanes: int) -> Array:
    if not lanes:
        return jnp.sum(a * x, axis)

    def slice_of(array: Any, index: int | slice) -> Any:
        if array.shape[axis] == 1:
            return array[(slice(None),) * axis + (0 if isinstance(index, int) else slice(None),)]
        return array[(slice(None),) * axis + (index,)]

    def total_of(terms: int, term: Any) -> Any:
        return functools.reduce(jnp.add, map(term, range(terms)))

    count = max(a.shape[axis], x.shape[axis])
    if count <= _WRITTEN_OUT:
        return total_of(count, lambda i: slice_of(a, i) * slice_of(x, i))
    groups = -(-count // _WRITTEN_OUT)
    each = count // groups

    def grouped(array: Any) -> Any:
        shape = (1, 1) if array.shape[axis] == 1 else (groups, each)
        whole = slice_of(array, slice(groups * each))
        return whole.reshape(*array.shape[:axis], *shape, *array.shape[axis + 1 :])

    sums = _contract(grouped(a), grouped(x), axis + 1, lanes)
    out = total_of(groups, lambda i: jax.lax.index_in_dim(sums, i, axis, keepdims=False))
    if groups * each == count:
        return jnp.asarray(out)
    rest = slice(groups * each, None)
    return out + _contract(slice_of(a, rest), slice_of(x, rest), axis, lanes)


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

    def cotangent(factor: Any, other: Any) -> Array:
        """The cotangent of one factor: the sum of the other one times `out` over the axes along
        which the factor is broadcast."""
        whole = jnp.broadcast_shapes(factor.shape, other.shape)
        repeated = [i for i, n in enumerate(whole) if factor.shape[i] != n]
        if not repeated:
            return jnp.broadcast_to(other * out, whole)
        found = jnp.expand_dims(_contract(other, out, repeated[0], lanes), repeated[0])
        for i in repeated[1:]:
            found = pairwise_sum(jnp.moveaxis(found, i, 0))[None]
            found = jnp.moveaxis(found, 0, i)
        return jnp.broadcast_to(found, factor.shape)

    a, x = both
    moves = [p is True for p in perturbed]
    return cotangent(a, x) if moves[0] else None, cotangent(x, a) if moves[1] else None


def matmul(a: LaneMatrix, b: LaneMatrix) -> Array:
    """The product of two matrices, as `sum_of_products` in kernels and with lanes, else as `@`."""
    lanes = max(a.ndim, b.ndim) - 2
    return (
        sum_of_products(a[:, :, None], b[None], 1, lanes)
        if _is_written_out(lanes)
        else jnp.asarray(a @ b)
    )


def matvec(a: LaneMatrix, x: Float[Array, "b *#lanes"]) -> Array:
    """The product of a matrix and a vector, as `sum_of_products` in kernels and with lanes, else as
    `@`."""
    lanes = x.ndim - 1
    return sum_of_products(a, x[None], 1, lanes) if _is_written_out(lanes) else jnp.asarray(a @ x)


def _is_written_out(lanes: int) -> bool:
    """Whether a product of arrays with so many axes of lanes is written out as sums, and not given
    to a library: in kernels, and with lanes."""
    return lanes > 0 or _IN_KERNEL.get()


def matvec_once(a: LaneMatrix, x: Float[Array, "b *#lanes"]) -> Array:
    """The product of a matrix and a vector, with barriers against fusion (see `compute_once`).

    So the vector is not computed again for each row, nor the product for each of its uses, and
    loops over lanes stay short enough for compilers to vectorise.
    """
    return compute_once(matvec(a, compute_once(x)))


def weighted_sum(
    weights: Float[Array, "k *#lanes"], tables: Float[Array, "k n n *#lanes"]
) -> Array:
    """The sum of k matrices times weights; in kernels the weights are computed once."""
    lanes = weights.ndim - 1
    if not _is_written_out(lanes):
        return jnp.tensordot(weights, tables, 1)
    return sum_of_products(compute_once(weights)[:, None, None], tables, 0, lanes)


def append_axes(table: Any, axes: int) -> Any:
    """An array with `axes` axes of length one behind its own, so that it broadcasts over lanes."""
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
    """Arrays as they are behind a barrier, so that XLA computes them once.

    XLA for CPUs fuses loops, and may compute a product or a sum again for each row of numbers that
    uses it, and all that it depends on; but it does not fuse across a call of a function.
    """
    if not is_for_cpus():
        return values
    if not _IN_KERNEL.get():
        # XLA moves constants into functions, and crashes over operands that are unused after that:
        # the barrier prevents it. Kernels have their own, and bear none inside.
        values = jax.lax.optimization_barrier(values)
    with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
        return _same(values)
