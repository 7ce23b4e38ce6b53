"""How eigenvalues of planar elements change with what they depend on, in batches.

A uniform clamped beam with a mass at its tip, in units of its length, mass and bending stiffness,
depends on four numbers: `EXPANDED`. So all first derivatives of x^T S A x, of M, C and K about the
steady state q, are four of each, whatever they are wanted by: those that move the numbers and, with
them, the steady state, K dq = dF, F the force at a fixed q. One `kernel` finds them with the forms
themselves, from one factorisation; what is left to JAX are products with changes of four numbers.
"""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.equations import Equations
from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._programs.kernel import kernel
from jaxbeam._programs.lanes import beside, total
from jaxbeam._rotor.beam import Beam, Rotor
from jaxbeam._rotor.motion import spinning
from jaxbeam._types import Number, Vector

# Speed over sqrt(EI / (rho L^4)), R / L, m_t / (rho L) and EA L^2 / EI.
EXPANDED = 4
_Numbers = tuple[Number, ...]
_Parts = Float[Array, "2 3 k *lanes"]  # real and imaginary parts of forms of M, C and K


class ElementForms:
    """Forms of the matrices of a model whose coordinates have these `signs` in S."""

    def __init__(self, model: AbstractModel, signs: np.ndarray) -> None:
        self.model, self.signs = model, signs
        self.expansion = kernel(self._expansion)

    def __call__(self, numbers: _Numbers, q: Vector, x: Float[Array, "2 k n"]) -> _Parts:
        """Forms of vectors, given by their real and imaginary parts, about a steady state."""
        return _forms(self, numbers, q, x)

    def _equations(self, numbers: _Numbers) -> tuple[Equations, Any]:
        """Equations of the unit beam and the motion of its hub."""
        speed, hub, tip, stretch = numbers
        unit: Any = jax.tree.map(lambda a: jnp.full_like(speed, a), Rotor(Beam(1, 1, 1, 1, 1)))
        rotor = eqx.tree_at(
            lambda r: (r.hub_radius, r.tip_body.mass, r.beam.axial_stiffness), unit,
            (hub, tip, stretch),
        )  # fmt: skip
        return self.model.equations(rotor), spinning(speed)

    def _rows(self, numbers: _Numbers, q: Vector) -> Float[Array, "3 b 4 12 *lanes"]:
        """M, C and K by rows of blocks."""
        equations, hub = self._equations(numbers)
        k, c = equations.tangents(hub, q, jnp.zeros_like(q), None)
        mass: Any = equations.mass
        return jnp.stack(jnp.broadcast_arrays(mass.rows, c.rows, k.rows))

    def _state_rate(self, numbers: _Numbers, q: Vector) -> Callable[[_Numbers], Vector]:
        """From rates of the numbers to the rate of the steady state, K^-1 dF."""
        rest, (equations, hub) = jnp.zeros_like(q), self._equations(numbers)
        inverse = equations.tangents(hub, q, rest, None)[0].inverse()

        def force(*numbers: Number) -> Vector:
            equations, hub = self._equations(numbers)
            return equations.force(hub, q, rest, None)

        return lambda rates: inverse @ jax.jvp(force, numbers, rates)[1]

    def _expansion(
        self, numbers: _Numbers, q: Vector, x: Float[Array, "2 k n *lanes"]
    ) -> tuple[_Parts, Float[Array, "4 2 3 k *lanes"]]:
        """Forms, and their derivatives by the numbers."""
        q = _settled(self, q, numbers)
        one, state_rate = jnp.ones_like(q[0]), self._state_rate(numbers, q)

        def along(direction: Array) -> Array:
            rates = tuple(one * rate for rate in direction)
            rows: Array = jax.jvp(self._rows, (numbers, q), (rates, state_rate(rates)))[1]
            return rows

        rows = self._rows(numbers, q)[None]
        rows = jnp.concatenate([rows, jax.lax.map(along, jnp.eye(EXPANDED, dtype=q.dtype))])
        mass: Any = self._equations(numbers)[0].mass
        left = beside(self.signs[None, None], q.ndim - 1) * x

        def of_matrix(rows: Array) -> Array:
            matrix = BlockTridiagonal(rows, absent=mass.absent)

            def of_vector(both: tuple[Array, Array]) -> Array:
                left, right = both[0], [matrix @ part for part in both[1]]
                return jnp.stack([
                    total(left[0] * right[0]) - total(left[1] * right[1]),
                    total(left[0] * right[1]) + total(left[1] * right[0]),
                ])  # fmt: skip

            return jax.lax.map(of_vector, (jnp.swapaxes(left, 0, 1), jnp.swapaxes(x, 0, 1)))

        every = jax.lax.map(of_matrix, rows.reshape(-1, *rows.shape[2:]))
        every = every.reshape(1 + EXPANDED, 3, *every.shape[1:])  # (5, 3, k, 2, *lanes)
        every = jnp.moveaxis(every, 3, 1)
        return every[0], every[1:]


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _forms(forms: ElementForms, numbers: _Numbers, q: Vector, x: Array) -> _Parts:
    out: _Parts = forms.expansion(numbers, q, x)[0]
    return out


@functools.partial(_forms.defjvp, symbolic_zeros=True)
def _forms_jvp(forms: ElementForms, primals: Any, tangents: Any) -> tuple[_Parts, _Parts]:
    x = primals[2]
    rates, _, shape_rate = tangents
    out, by = forms.expansion(*primals)
    change = jnp.zeros_like(out)
    for derivative, rate in zip(by, rates, strict=True):
        if not isinstance(rate, SymbolicZero):
            change = change + derivative * rate
    if not isinstance(shape_rate, SymbolicZero):
        still = primals[:2]
        change = change + jax.jvp(lambda x: forms.expansion(*still, x)[0], (x,), (shape_rate,))[1]
    return out, change


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _settled(forms: ElementForms, q: Vector, numbers: _Numbers) -> Vector:
    """A steady state that is known, with its derivatives."""
    return q


@_settled.defjvp
def _settled_jvp(forms: ElementForms, primals: Any, tangents: Any) -> tuple[Vector, Vector]:
    # Through the function itself: then this rule can be differentiated again.
    q, numbers = _settled(forms, *primals), primals[1]
    return q, forms._state_rate(numbers, q)(tuple(tangents[1]))
