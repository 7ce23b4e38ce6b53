"""Elastic parts with strains, and their viscous forces: stresses in proportion to rates of strain
(Kelvin and Voigt).

With strains s(q) and an energy s.D s / 2, D constant, stresses D s' do the forces B^T D B q' on the
coordinates, B = ds/dq. Their power is twice the energy of the rates of strain, never negative, and
zero in any rigid motion, however much is strained: stress that turns with the material is at rest
in it. Where strains are linear in the coordinates that is the stiffness times q'; else the rate of
the elastic force is more, by the stress times d B^T/dt.
"""

import abc
import math
from collections.abc import Callable
from typing import Any, ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._programs.lanes import (
    append_axes,
    is_transposed,
    pairwise_sum,
    sum_of_products,
    transposed,
)
from jaxbeam._rotor.beam import Rotor
from jaxbeam._types import Number


class Strained(eqx.Module):
    """A part of a beam with strains s and the energy s.D s / 2, by coordinates e, an array with
    `axes` axes and those of lanes behind them."""

    axes: ClassVar[int]

    @abc.abstractmethod
    def strains(self, e: Array) -> Any:
        """Strains s at coordinates e, a pytree."""

    @abc.abstractmethod
    def stresses(self, strains: Any) -> Any:
        """Stresses D s, a pytree like the strains."""

    @abc.abstractmethod
    def force(self, e: Array) -> Array:
        """The elastic force at coordinates e."""

    @transposed(on=False)
    def force_rate(self, e: Array, rate: Array) -> Array:
        """The rate of the force, (d force / de) e'."""
        return jax.jvp(self.force, (e,), (rate,))[1]

    def viscous(self, e: Array, rate: Array) -> Array:
        """Viscous force B^T D B e'."""
        return viscous(self.strains, self.stresses, e, rate)

    @transposed(on=False)
    def viscous_tangents(self, e: Array, rate: Array) -> tuple[Array, Array]:
        """Derivatives of `viscous` by e, which are B^T D d(B e')/de and that of B^T, and by e',
        B^T D B."""

        def rates(e: Array) -> tuple[Any, Any]:
            strains: tuple[Any, Any] = jax.jvp(self.strains, (e,), (rate,))
            return strains

        (_, change), push = jax.linearize(rates, e)
        stress, pull = self.stresses(change), self._rows
        b, b_rate = jax.vmap(push)(self._units(e))
        held = self.derivative(lambda e: jax.vjp(self.strains, e)[1](stress)[0], e)
        by = [jax.vmap(self.stresses)(a) for a in (b_rate, b)]
        lanes, b = e.ndim - self.axes, pull(b, e)[:, None]
        by_e, by_rate = (
            sum_of_products(b, pull(a, e)[None], 2, lanes).reshape(held.shape) for a in by
        )
        return held + by_e, by_rate

    @transposed(on=False)
    def derivative(self, function: Callable[[Array], Array], e: Array) -> Array:
        """The derivative of a force by the coordinates; its axes are those of the force, of the
        coordinates and of lanes."""
        push = jax.linearize(function, e)[1]
        own = e.shape[: self.axes]
        return jax.vmap(push, out_axes=self.axes)(self._units(e)).reshape(*own, *e.shape)

    def _units(self, e: Array) -> Array:
        """Unit vectors of all coordinates, (n, *e.shape), repeated over lanes."""
        own, lanes = e.shape[: self.axes], e.ndim - self.axes
        units = jnp.eye(math.prod(own), dtype=e.dtype).reshape(-1, *own)
        return jnp.broadcast_to(append_axes(units, lanes), (len(units), *e.shape))

    def _rows(self, strains: Any, e: Array) -> Array:
        """All k numbers of n strains as one array, (n, k, *lanes)."""
        leaves = jax.tree.leaves(strains)
        lanes = e.shape[self.axes :]
        return jnp.concatenate([a.reshape(len(a), -1, *lanes) for a in leaves], 1)


class Parts(eqx.Module):
    """An element whose properties have kinks inside, as the sum of parts that all take the
    coordinates of the whole element."""

    each: Any  # an element whose arrays have a first axis of parts

    def energy(self, e: Array) -> Number:
        return pairwise_sum(jax.vmap(lambda part: part.energy(e))(self.each))

    def force(self, e: Array) -> Array:
        return pairwise_sum(jax.vmap(lambda part: part.force(e))(self.each))

    def tangent(self, e: Array) -> Array:
        return pairwise_sum(jax.vmap(lambda part: part.tangent(e))(self.each))

    def force_rate(self, e: Array, rate: Array) -> Array:
        return pairwise_sum(jax.vmap(lambda part: part.force_rate(e, rate))(self.each))

    def viscous(self, e: Array, rate: Array) -> Array:
        return pairwise_sum(jax.vmap(lambda part: part.viscous(e, rate))(self.each))

    def viscous_tangents(self, e: Array, rate: Array) -> tuple[Array, Array]:
        by_e, by_rate = jax.vmap(lambda part: part.viscous_tangents(e, rate))(self.each)
        return pairwise_sum(by_e), pairwise_sum(by_rate)


@transposed(on=False)
def viscous(
    strains: Callable[[Array], Any], stresses: Callable[[Any], Any], q: Array, rate: Array
) -> Array:
    """The viscous force B^T D B q' of strains s(q) with stresses D s."""
    push = jax.linearize(strains, q)[1]
    force: Array = jax.linear_transpose(push, q)(stresses(push(rate)))[0]
    return force


def gradient_of(function: Callable[[Array], Number]) -> Callable[[Array], Array]:
    """Gradient of a function whose value is one scalar, or one for each lane."""
    return jax.grad(lambda x: jnp.sum(function(x)))


def holding(rotor: Rotor, axial_stiffness: Number, n_elements: int) -> Number | None:
    """Stiffness, in J, that keeps the end of the beam unstretched where a body is, or None.

    It grows with the number of elements: with a fixed stiffness the force of the body would stretch
    the end, and with it the arm of the body, for any number of elements.
    """
    stiffness = 10 * n_elements * axial_stiffness * rotor.beam.length
    return stiffness if rotor.tip_body.is_body else None


def force_of(law: Any, e: Array, symmetric: bool) -> Array:
    """The elastic force law.force(e). If its derivative by e is `symmetric`, reverse mode by e uses
    forward mode, which is a shorter program."""
    return _symmetric((law, e)) if symmetric and is_transposed() else law.force(e)


@eqx.filter_custom_vjp
def _symmetric(both: tuple[Any, Array]) -> Array:
    force: Array = both[0].force(both[1])
    return force


@_symmetric.def_fwd
def _forwards(perturbed: Any, both: tuple[Any, Array]) -> tuple[Array, None]:
    # Without rules for reverse mode inside, so that this can be differentiated once more.
    with transposed(on=False):
        force: Array = both[0].force(both[1])
    return force, None


@_symmetric.def_bwd
def _backwards(
    residuals: None, out: Array, perturbed: Any, both: tuple[Any, Array]
) -> tuple[Any, Array]:
    law, e = both
    own, still = eqx.partition(law, perturbed[0])
    _, pull = jax.vjp(lambda own: eqx.combine(own, still).force(e), own)
    return pull(out)[0], law.force_rate(e, out)


class EndSprings(Strained):
    """Springs at both ends with the energy sum k s^2 / 2. Each strain s depends on the displacement
    gradient d = r' - a1 at one end, root or tip, of the array (2, c, *lanes) of both."""

    axes: ClassVar[int] = 2

    @abc.abstractmethod
    def strains(self, e: Float[Array, "2 c *lanes"]) -> list[Number]:
        """Strains of the springs, without those of ends that have none."""

    @property
    @abc.abstractmethod
    def stiffness(self) -> list[Number]:
        """Stiffness of each of the springs, in the order of `strains`."""

    @abc.abstractmethod
    def damped_by(self, dampers: tuple[Number | None, Number | None]) -> Self:
        """The ends with `dampers` as the stiffness of springs, and none at the tip: the `viscous`
        force of these is that of the dampers."""

    @property
    def are_plain(self) -> bool:
        """Whether there are no springs."""
        return not self.stiffness

    def stresses(self, strains: list[Number]) -> list[Number]:
        return [k * s for k, s in zip(self.stiffness, strains, strict=True)]

    def energy(self, d: Float[Array, "2 c *lanes"]) -> Number:
        energy = jnp.zeros_like(d[0, 0])
        for k, s in zip(self.stiffness, self.strains(d), strict=True):
            energy = energy + k * s**2 / 2
        return energy

    def force(self, d: Float[Array, "2 c *lanes"]) -> Float[Array, "2 c *lanes"]:
        return gradient_of(self.energy)(d)

    def tangent(self, d: Float[Array, "2 c *lanes"]) -> Float[Array, "2 c c *lanes"]:
        """The tangent d force / dd of each end."""
        return self.derivative(self.force, d)

    def viscous_tangents(self, e: Array, rate: Array) -> tuple[Array, Array]:
        return (
            self.derivative(lambda e: self.viscous(e, rate), e),
            self.derivative(lambda rate: self.viscous(e, rate), rate),
        )

    @transposed(on=False)
    def derivative(
        self, function: Callable[[Array], Array], e: Array
    ) -> Float[Array, "2 c c *lanes"]:
        """The derivative of the force at each end by the gradient at that end; those by the other
        end are zero."""
        push, units = jax.linearize(function, e)[1], jnp.eye(e.shape[1], dtype=e.dtype)[:, None]
        along = jnp.broadcast_to(append_axes(units, e.ndim - 2), (e.shape[1], *e.shape))
        return jax.vmap(push, out_axes=2)(along)
