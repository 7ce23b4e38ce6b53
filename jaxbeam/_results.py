"""What results share: how a failure is told, NaN where a case failed, answers of a batch case by
case, what they are asked with, no derivatives."""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxbeam._status import raise_unless_ok

Method = TypeVar("Method", bound=Callable[..., Any])
Tree = TypeVar("Tree")


def finish(result: Tree, throw: bool, *, noted: bool = False) -> Tree:
    """The result of a public function, or an error; the last call of all functions that can fail.

    With `throw` the result, or the exception that belongs to its `status` (of several the largest);
    `noted` adds the text of the result to that, where it says what is known nevertheless. Without
    `throw` the result as it is, whose numbers are NaN where its status is not `OK`.

    Raises `ValueError` where a parameter is out of range, else `RuntimeError`; under `jit` as
    `raise_unless_ok` does.
    """
    if not throw:
        return result
    status: Any = result.status  # type: ignore[attr-defined]
    try:
        return raise_unless_ok(result, jnp.max(status) if jnp.ndim(status) else status)
    except (ValueError, RuntimeError) as error:
        if noted:
            error.add_note(str(result))
        raise


class InHertz:
    """A result with a `frequency` in rad/s, given in Hz as well."""

    @property
    def frequency_hz(self) -> Any:
        """`frequency` / (2 pi), in Hz, of the same shape."""
        frequency: Any = self.frequency  # type: ignore[attr-defined]
        return frequency / (2 * math.pi)


def asked_with() -> Any:
    """A field for what a result needs to answer with, such as the rotor whose modes they are. It
    was given and not found, so it is no part of a table: see `found_alone`."""
    return eqx.field(default=None, metadata={"asked_with": True})


def found_alone(tree: Any) -> Any:
    """A pytree in which results lack what they are asked with."""

    def needs(node: Any) -> list[str]:
        fields = dataclasses.fields(node) if isinstance(node, eqx.Module) else ()
        return [field.name for field in fields if field.metadata.get("asked_with")]

    def alone(node: Any) -> Any:
        names = needs(node)
        return replaced(node, **dict.fromkeys(names)) if names else node

    return jax.tree.map(alone, tree, is_leaf=lambda node: bool(needs(node)))


def replaced(module: Tree, **fields: Any) -> Tree:
    """A copy of a module with other values in some of its fields, without its checks."""
    changed: Tree = eqx.tree_at(
        lambda module: [getattr(module, name) for name in fields], module, [*fields.values()],
        is_leaf=lambda leaf: leaf is None,
    )  # fmt: skip
    return changed


def per_case(method: Method) -> Method:
    """Lets a method (or a property, below `@property`) of a result answer for a batch of results.

    The method is written for one case, whose `status` is a scalar. Where results came out of
    `jax.vmap` or `equinox.filter_vmap`, nested or not, `status` has leading axes, and so has every
    array in the result: the method is mapped over these axes, and its answer has them in front.
    Leaves that are no arrays (functions of a motion, say), or have no axis, belong to all cases.
    """

    @functools.wraps(method)
    def answer(self: Any, *args: Any, **kwargs: Any) -> Any:
        arrays, rest = eqx.partition(self, eqx.is_array)
        leaves, structure = jax.tree.flatten(arrays)

        def one(leaves: list[Array]) -> Any:
            result = eqx.combine(jax.tree.unflatten(structure, leaves), rest)
            return method(result, *args, **kwargs)

        return _mapped(one, leaves, jnp.ndim(self.status))

    return answer  # type: ignore[return-value]


def _mapped(one: Callable[[list[Array]], Any], leaves: list[Array], axes: int) -> Any:
    if axes == 0:
        return one(leaves)
    where = [0 if leaf.ndim else None for leaf in leaves]
    return jax.vmap(lambda leaves: _mapped(one, leaves, axes - 1), (where,))(leaves)


def finite_rows(values: Float[Array, "k n"]) -> Bool[Array, " k"]:
    """Whether all numbers of each row are finite, by a scaled sum, which compiles much faster than
    a search."""
    values = jax.lax.stop_gradient(values)
    return jnp.isfinite(jnp.sum(values * jnp.finfo(values.dtype).tiny, 1))


@jax.custom_jvp
def nan_unless(valid: Bool[Array, "..."], values: Any) -> Any:
    """Real or complex arrays, NaN where they are not `valid`, and so are their derivatives.

    `valid` has the leading axes of all arrays in `values`. Derivatives in forward mode are NaN
    where the values are. In reverse mode nothing flows back from there: in a batch a NaN would
    spoil the gradient by parameters that its cases share, and a case cannot know whether it is
    one of a batch.
    """

    def one(value: Array) -> Array:
        beside = valid.reshape(valid.shape + (1,) * (value.ndim - valid.ndim))
        # 0 / 1 where all is valid, else 0 / 0, since `jax_debug_nans` would find a constant NaN
        # among what reverse mode keeps.
        hole = 0.0 / jnp.where(beside, 1.0, 0.0).astype(value.real.dtype)
        if jnp.iscomplexobj(value):
            hole = jax.lax.complex(hole, hole)
        return jnp.where(beside, value, hole)

    return jax.tree.map(one, values)


@nan_unless.defjvp
def _nan_unless_jvp(primals: tuple[Any, Any], tangents: tuple[Any, Any]) -> tuple[Any, Any]:
    valid, _ = primals
    # The function itself is called, so that second derivatives are NaN, too.
    return nan_unless(*primals), nan_unless(valid, tangents[1])


def without_derivatives(tree: Tree) -> Tree:
    """A pytree with `jax.lax.stop_gradient` on all arrays, and all else in place."""
    dynamic, static = eqx.partition(tree, eqx.is_array)
    return eqx.combine(jax.lax.stop_gradient(dynamic), static)


def harmless(fine: Bool[Array, ""], tree: Tree) -> Tree:
    """A pytree with ones in the place of real arrays unless they are `fine`.

    A NaN in one lane of a batch would keep the others waiting, and end up in gradients of
    parameters that lanes share; and what is out of range may be worse.
    """
    return jax.tree.map(
        lambda leaf: jnp.where(fine, leaf, 1.0) if eqx.is_inexact_array(leaf) else leaf, tree
    )
