"""A force along the span that turns with the sections, in the words of
`_models/space/elements.py`.

At a point s of an element, with the frame of its first node, the tangent t seen from that and the
turn h (see `_models/space/energies.py`), the section has the axes that the least rotation brings
from the first axis of that frame to t, turned by h: a force has constant components along these. It
acts on the axis of the beam, so that its work goes with displacements alone.
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.ancf.energies import along_element
from jaxbeam._models.ancf.sections import Cuts, cuts, each_element, gauss_points
from jaxbeam._models.bases.basis import hermite
from jaxbeam._models.contract.span_integrals import (
    POINTS,
    AbstractSpanForce,
    AbstractSpanIntegral,
)
from jaxbeam._models.space.energies import turns
from jaxbeam._models.space.frames import LocalCoordinates, deformation, frames
from jaxbeam._models.space.nodes import of_elements
from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._programs.lanes import (
    append_axes,
    compute_once,
    pairwise_sum,
    sum_of_products,
    transposed,
)
from jaxbeam._rotor.motion import axes
from jaxbeam._types import Vector

Pushes = Float[Array, "3 p *lanes"]  # forces at points of one element


class FollowingForce(AbstractSpanForce):
    """Forces that turn with the sections, at points of elements, each with its share of the
    length."""

    push: Float[Array, "E 3 p *#lanes"]  # along the axes of the section there, in N
    parts: Cuts = eqx.field(static=True)

    def on(self, equations: Any, q: Vector) -> Vector:
        n = equations.sections.n_elements

        def one(tables: Any, push: Pushes, local: Array) -> Array:
            (value, slopes, angles), lanes = tables, local.ndim - 3
            acts = in_beam_axes(equations._strains(local), push, slopes, angles, n)
            return _on_nodes(equations, acts, value, lanes)

        own = self._of_each(one, of_elements(equations._nodes(q)))
        gathered: Vector = equations._gathered(own, None, None)
        return gathered

    @transposed(on=False)
    def tangent(self, equations: Any, q: Vector) -> BlockTridiagonal:
        n = equations.sections.n_elements

        def one(tables: Any, push: Pushes, local: Array) -> Array:
            (value, slopes, angles), lanes, e = tables, local.ndim - 3, equations._strains(local)
            units = jnp.broadcast_to(append_axes(np.eye(13), lanes), (13, *e.shape))

            def force(e: LocalCoordinates) -> Pushes:
                return in_beam_axes(e, push, slopes, angles, n)

            by = jax.vmap(lambda unit: jax.jvp(force, (e,), (unit,))[1])(units)
            acts = jax.vmap(lambda by: _on_nodes(equations, by, value, lanes))(by)
            acts = acts.reshape(13, 16, *acts.shape[4:]) / equations.length
            by_nodes = equations._on_nodes(acts)
            return -by_nodes.reshape(16, 16, *by_nodes.shape[4:]).swapaxes(0, 1)

        own = self._of_each(one, of_elements(equations._nodes(q)))
        gathered: BlockTridiagonal = equations._gathered_tangent(own, None)
        return gathered

    def _of_each(self, function: Any, local: Array) -> Array:
        return each_element(function, (_tables(self.parts), self.push, local), 4)


class FollowingIntegral(AbstractSpanIntegral):
    """Elements whose axes turn; cut at the kinks of the force, all into as many parts."""

    equations: Any
    parts: Cuts = eqx.field(static=True)

    @classmethod
    def of(cls, equations: Any, n_elements: int, kinks: tuple[float, ...]) -> "FollowingIntegral":
        """The integral over so many elements."""
        return cls(equations, cuts((0.0, *kinks, 1.0), n_elements))

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        s, weight = _points(self.parts)
        n = len(self.parts)
        return ((np.arange(n)[:, None] + s) / n).ravel(), weight.ravel()

    def generalised_force(self, density: Float[Array, "p 3"]) -> FollowingForce:
        _, weight = _points(self.parts)
        push = self.equations.length * weight[..., None] * density.reshape(*weight.shape, 3)
        return FollowingForce(push.swapaxes(1, 2), self.parts)

    def acting(self, q: Vector, density: Float[Array, "p 3"]) -> Float[Array, "p 3"]:
        equations, n = self.equations, len(self.parts)
        _, slopes, angles = _tables(self.parts)
        local = jax.vmap(equations._strains)(of_elements(equations._nodes(q)))
        given = density.reshape(n, -1, 3).swapaxes(1, 2)
        there = jax.vmap(functools.partial(in_beam_axes, n_elements=n))(
            local, given, slopes, angles
        )
        there = there.swapaxes(1, 2).reshape(-1, 3)
        return jax.vmap(equations._outward)(there)


def in_beam_axes(
    e: LocalCoordinates, push: Pushes, slopes: Any, angles: Any, n_elements: int
) -> Pushes:
    """Forces in axes of the beam, from those along the axes of the sections at points of an
    element."""
    lanes = e.ndim - 1
    natural, rows = deformation(e, n_elements), frames(e, n_elements).rows
    none = jnp.zeros_like(natural[0])
    stations = jnp.stack([jnp.stack([natural[0], none, none]), natural[1:4], natural[4:7]], 1)
    here = sum_of_products(stations[:, None], append_axes(slopes, lanes)[None], 2, max(lanes, 1))
    angle = sum_of_products(natural[None, 7:], append_axes(angles, lanes), 1, max(lanes, 1))
    size = jnp.sqrt(pairwise_sum(here * here))
    sections = compute_once(axes(here / size[None], angle))
    seen = compute_once(sum_of_products(sections, push[:, None], 0, max(lanes, 1)))
    return sum_of_products(rows[:, :, None], seen[:, None], 0, max(lanes, 1))


def _on_nodes(equations: Any, push: Pushes, value: Any, lanes: int) -> Array:
    """Forces on the nodes of an element (2, 2, 4, *lanes) by forces at its points."""
    by = sum_of_products(
        append_axes(value, lanes)[:, :, None], push.swapaxes(0, 1)[:, None], 0, max(lanes, 1)
    )
    rows = [equations._ordered(vector, jnp.zeros_like(vector[0])) for vector in by]
    return jnp.stack(rows).reshape(2, 2, 4, *push.shape[2:])


def _points(parts: Cuts) -> tuple[np.ndarray, np.ndarray]:
    """Places in each element, and weights over x / L: (E, p)."""
    s, weight = gauss_points(parts, _GAUSS)
    return s.reshape(len(parts), -1), weight.reshape(len(parts), -1)


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(POINTS)
_GAUSS = (1 + _NODES) / 2, _WEIGHTS / 2


def _tables(parts: Cuts) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Functions of the nodes of each element at its points (E, p, 4), and what makes r' and the
    turn there of what is at its stations and of its rates (E, p, 3)."""
    s, n = _points(parts)[0], len(parts)
    each = hermite(s.ravel(), 1 / n).value, along_element(s.ravel()), turns(s.ravel(), 1 / n)
    value, slopes, angles = (table.reshape(*s.shape, -1) for table in each)
    return value, slopes, angles
