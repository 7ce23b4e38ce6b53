"""Derivatives of the eigenvalues of planar elements, at little more than the cost of the values.

An eigenvalue with the mode x changes by x^T S dM x, x^T S dC x and x^T S dK x, S = 1 for
deflections across the beam and -1 along it: these are the forms of the matrices of small motion M,
C (of the Coriolis forces) and K. A uniform clamped beam with a mass at its tip, in units of its own
length, mass and bending stiffness, depends on four numbers alone: see `UnitBeam`. So every first
derivative of a form is a combination of the four by these numbers. Each number moves the steady
state q as well, by dq = K^-1 dF, where dF is the change of the force at fixed q. One `kernel`
computes the forms and their four derivatives with one factorisation of K; JAX combines them.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

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
from jaxbeam._programs.lanes import append_axes, pairwise_sum
from jaxbeam._rotor.beam import Beam, Rotor
from jaxbeam._rotor.motion import Hub, spinning
from jaxbeam._types import Number, Vector


class UnitBeam(NamedTuple):
    """The four numbers that a beam depends on in units of itself; or derivatives of these."""

    speed: Number  # speed over sqrt(EI / (rho L^4))
    hub_radius: Number  # hub radius over L
    tip_mass: Number  # tip mass over rho L
    axial_stiffness: Number  # EA L^2 / EI


_Values = Float[Array, "2 3 k *lanes"]  # real and imaginary parts of the forms of M, C and K


class ElementForms:
    """Forms x^T S M x, x^T S C x and x^T S K x of a model's matrices; S = diag(`signs`)."""

    def __init__(self, model: AbstractModel, signs: np.ndarray) -> None:
        self.model, self.signs = model, signs
        self.expansion = kernel(self._expansion)

    def __call__(self, four: UnitBeam, q: Vector, x: Float[Array, "2 k n"]) -> _Values:
        """Forms of k modes `x`, given by real and imaginary parts, about the steady state `q` of a
        unit beam of `four` numbers; their derivatives by these include those of q."""
        return _values(self, four, q, x)

    def _equations(self, four: UnitBeam) -> tuple[Equations, Hub]:
        """Equations of the unit beam and the motion of its hub."""
        ones = Rotor(Beam(1, 1, 1, 1, 1))
        unit: Any = jax.tree.map(lambda a: jnp.full_like(four.speed, a), ones)
        rotor = eqx.tree_at(
            lambda r: (r.hub_radius, r.tip_body.mass, r.beam.axial_stiffness), unit, four[1:]
        )
        return self.model.equations(rotor), spinning(four.speed)

    def _rows(self, four: UnitBeam, q: Vector) -> Float[Array, "3 b 4 12 *lanes"]:
        """The matrices M, C and K at the state q, in rows of blocks."""
        equations, hub = self._equations(four)
        k, c = equations.tangents(hub, q, jnp.zeros_like(q), None)
        mass: Any = equations.mass
        return jnp.stack(jnp.broadcast_arrays(mass.rows, c.rows, k.rows))

    def state_rate(self, four: UnitBeam, q: Vector) -> Callable[[UnitBeam], Vector]:
        """The linear map from changes of the numbers to that of the steady state, K^-1 dF."""
        rest, (equations, hub) = jnp.zeros_like(q), self._equations(four)
        inverse = equations.tangents(hub, q, rest, None)[0].inverse()

        def force(four: UnitBeam) -> Vector:
            equations, hub = self._equations(four)
            return equations.force(hub, q, rest, None)

        return lambda rates: inverse @ jax.jvp(force, (four,), (rates,))[1]

    def _expansion(
        self, four: UnitBeam, q: Vector, x: Float[Array, "2 k n *lanes"]
    ) -> tuple[_Values, Float[Array, "4 2 3 k *lanes"]]:
        """Forms of modes, and their derivatives by each of the four numbers."""
        q = _steady_state(self, q, four)
        one, state_rate = jnp.ones_like(q[0]), self.state_rate(four, q)

        def by_number(unit: Array) -> Array:
            rates = UnitBeam(*(one * rate for rate in unit))
            rows: Array = jax.jvp(self._rows, (four, q), (rates, state_rate(rates)))[1]
            return rows

        rows = self._rows(four, q)[None]
        rows = jnp.concatenate([rows, jax.lax.map(by_number, jnp.eye(len(four), dtype=q.dtype))])
        mass: Any = self._equations(four)[0].mass
        left = append_axes(self.signs[None, None], q.ndim - 1) * x

        def forms_of_matrix(rows: Array) -> Array:
            matrix = BlockTridiagonal(rows, absent=mass.absent)

            def of_mode(both: tuple[Array, Array]) -> Array:
                left, right = both[0], [matrix @ part for part in both[1]]
                return jnp.stack([
                    pairwise_sum(left[0] * right[0]) - pairwise_sum(left[1] * right[1]),
                    pairwise_sum(left[0] * right[1]) + pairwise_sum(left[1] * right[0]),
                ])  # fmt: skip

            return jax.lax.map(of_mode, (jnp.swapaxes(left, 0, 1), jnp.swapaxes(x, 0, 1)))

        forms = jax.lax.map(forms_of_matrix, rows.reshape(-1, *rows.shape[2:]))
        forms = forms.reshape(1 + len(four), 3, *forms.shape[1:])  # (5, 3, k, 2, *lanes)
        forms = jnp.moveaxis(forms, 3, 1)
        return forms[0], forms[1:]


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _values(elements: ElementForms, four: UnitBeam, q: Vector, x: Array) -> _Values:
    """The forms, with derivatives by the numbers from `ElementForms.expansion`, which include those
    of the steady state; q itself is taken as constant."""
    out: _Values = elements.expansion(four, q, x)[0]
    return out


@functools.partial(_values.defjvp, symbolic_zeros=True)
def _values_jvp(elements: ElementForms, primals: Any, tangents: Any) -> tuple[_Values, _Values]:
    four, q, x = primals
    rates, _, x_rate = tangents
    out, by_number = elements.expansion(four, q, x)
    change = jnp.zeros_like(out)
    for derivative, rate in zip(by_number, rates, strict=True):
        if not isinstance(rate, SymbolicZero):
            change = change + derivative * rate
    if not isinstance(x_rate, SymbolicZero):

        def of_modes(x: Array) -> _Values:
            forms: _Values = elements.expansion(four, q, x)[0]
            return forms

        change = change + jax.jvp(of_modes, (x,), (x_rate,))[1]
    return out, change


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _steady_state(elements: ElementForms, q: Vector, four: UnitBeam) -> Vector:
    """The given steady state q, with derivatives by the numbers that it belongs to."""
    return q


@_steady_state.defjvp
def _steady_state_jvp(elements: ElementForms, primals: Any, tangents: Any) -> tuple[Vector, Vector]:
    # The function itself is called here, so that this rule can be differentiated again.
    q, four = _steady_state(elements, *primals), primals[1]
    return q, elements.state_rate(four, q)(tangents[1])
