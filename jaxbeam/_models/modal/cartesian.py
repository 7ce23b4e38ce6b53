"""Equations of motion of beams whose displacements are linear in the coordinates.

u_c(x, t) = f_a(x) q_a(t), summed over the coordinates a that move in direction c. Then the inertia
of a beam on any moving hub needs only one Gram matrix G of all functions, int f_a f_b dm, and the
moments int f_a dm and int X f_a dm, X = R + x: with W = w~ w~ + w~' (w~ b = omega x b),

    M q'' + [2 w~] G q' + [W] G q + (a_O + W X a1) . f + P-terms + elastic forces = external forces

where [B] G has the entries B_cd G_ab, a moving in direction c and b in d. These are Y eqs. 18-20,
and B eq. 53 with any motion of the hub. Tables are NumPy, computed once for a unit beam.

Y and B are the papers of `_models/contract/__init__.py`.
"""

import functools
from collections.abc import Callable
from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.bases.basis import Functions
from jaxbeam._models.bases.layered import massless
from jaxbeam._models.bases.rotary import SecondMoments
from jaxbeam._models.bases.shapes import Shapes, shortening
from jaxbeam._models.contract.elasticity import Elasticity, LinearElasticity
from jaxbeam._models.contract.equations import Equations, Undeformed
from jaxbeam._models.contract.span_integrals import FunctionSpanIntegral
from jaxbeam._models.contract.supports import check_supported
from jaxbeam._models.modal.cartesian_model import CartesianModel
from jaxbeam._models.modal.rotary_inertia import RotaryInertia, of_rotor
from jaxbeam._models.modal.shape_integrals import ShapeIntegrals, weighted
from jaxbeam._numerics.small import SmallMatrix
from jaxbeam._programs.lanes import (
    LARGE,
    LaneMatrix,
    append_axes,
    matmul,
    matvec,
    matvec_once,
    pairwise_sum,
    weighted_sum,
)
from jaxbeam._results import replaced
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.ends import Tip, TipBody
from jaxbeam._rotor.motion import Hub, hub_matrices, skew
from jaxbeam._rotor.span import Span, tension
from jaxbeam._types import Matrix, Number, Triple, Vector


class CartesianEquations(Equations):
    """Inertia of a hub-mounted beam of any theory; `stiffening` and `elasticity` differ.

    `stiffening` holds int t_k f' f' on the coordinates on which the tension P(x) of the rigid
    motion acts, P(x) = -int_x^L a1 dm, a1 = a_O1 - (omega_2^2 + omega_3^2) X (Y eqs. 19, 20); None
    where a theory has no such term. It is what remains of the foreshortening
    -1/2 int_0^x u'^2 after linearisation, and enters the kinetic energy as such.

    A rigid body at the tip has its centre at r_L + c e, with the unit vector e along the beam's
    end, a1 + f'(L) q / L to first order and shorter along a1 by half the square of the slope.
    `rotary` is the rotary inertia of sections and body, `tip_rotary` that of the body alone.
    """

    mass: Matrix | SmallMatrix
    gram: Matrix
    first_moments: Vector  # int f dm
    first: Vector  # int X f dm
    at_tip: Vector  # f(L)
    rigid_moments: Triple
    length: Number
    tip_radius: Number
    energy_scale: Number
    beam_mass: Number
    hub_radius: Number
    tip_mass_radius: Number
    tip_body: Tip
    rotary: RotaryInertia | None
    tip_rotary: RotaryInertia | None
    elasticity: Elasticity
    stiffening: Float[Array, "k n n"] | None
    shapes: Shapes | None
    weighted_integrals: ShapeIntegrals | None  # None for a uniform beam: those of the model
    model: CartesianModel = eqx.field(static=True)

    @classmethod
    def build(
        cls,
        model: CartesianModel,
        rotor: Rotor,
        elasticity: Elasticity,
        shapes: Shapes | None,
        stiffened: Callable[[ShapeIntegrals], Array | np.ndarray] | None = None,
    ) -> Self:
        """Scale the integrals of `model` to a rotor; `stiffened` takes `stiffening` from them."""
        check_supported(model, rotor)
        by_mass = weighted(shapes, rotor) if shapes is not None and rotor.varies else None
        beam, body = rotor.beam, rotor.tip_body
        integrals = model.shape_integrals if by_mass is None else by_mass
        radius, length, mass, tip_mass = rotor.hub_radius, beam.length, beam.mass, rotor.tip_mass
        end, tip = radius + length, body.centre(integrals.tip, integrals.tip_slope, length)
        stiffening = None if stiffened is None else stiffened(integrals)
        gram = mass * integrals.gram + tip_mass * _outer(tip)
        first_moments = mass * (radius * integrals.mean + length * integrals.first)
        first_moments = first_moments + tip_mass * rotor.tip_mass_radius * tip
        rotary = tip_rotary = None
        if body.is_body and stiffening is not None:
            tip_slopes = _outer(integrals.tip_slope) * (integrals.one_hot @ integrals.one_hot.T)
            stiffening = jnp.concatenate([stiffening, tip_slopes[None]])
        if rotor.turns_mass:
            along_beam = model.sampled(rotor, shapes)
            rotary, tip_rotary = of_rotor(rotor, along_beam, stiffening is not None)
        inertia = gram * (integrals.one_hot @ integrals.one_hot.T)
        if least_mass := massless(model.functions_from, gram.dtype):
            inertia = inertia + least_mass * (mass + tip_mass) * np.eye(len(integrals.one_hot))
        return cls(
            mass=inertia if rotary is None else inertia + rotary.mass,
            gram=gram,
            first_moments=mass * integrals.mean + tip_mass * tip,
            first=first_moments,
            at_tip=jnp.asarray(integrals.tip),
            rigid_moments=rotor.rigid_moments,
            length=length,
            tip_radius=end,
            energy_scale=beam.mean.in_plane_bending_stiffness / length,
            beam_mass=mass,
            hub_radius=radius,
            tip_mass_radius=rotor.tip_mass_radius,
            tip_body=body,
            rotary=rotary,
            tip_rotary=tip_rotary,
            elasticity=elasticity,
            stiffening=None if stiffening is None else jnp.asarray(stiffening),
            shapes=shapes,
            weighted_integrals=by_mass,
            model=model,
        )

    @property
    def kernel(self) -> Self | None:
        # Subclasses of these equations or of an elasticity may not be written for lanes.
        suits = type(self) is CartesianEquations and vars(type(self.elasticity)).get("takes_lanes")
        if not suits or len(self.gram) > LARGE or isinstance(self.mass, SmallMatrix):
            return None
        return replaced(
            self, mass=SmallMatrix(self.mass), shapes=None, weighted_integrals=None, tip_rotary=None
        )

    @property
    def functions(self) -> Shapes | None:
        return self.shapes

    @property
    def shape_integrals(self) -> ShapeIntegrals:
        """Integrals of the model's functions over this beam, and their values at its ends."""
        by_mass = self.weighted_integrals
        return self.model.shape_integrals if by_mass is None else by_mass

    @property
    def undeformed(self) -> Undeformed:
        """The undeformed beam, with rotary inertia."""
        out = super().undeformed
        if self.rotary is None:
            return out
        # `rigid_moments` have the in-plane inertia of the body about a2 and a3 already.
        body, about = self.tip_body, append_axes(np.diag([0.0, 1.0, 1.0]), self.length.ndim)
        counted = body.inertia * about if isinstance(body, TipBody) else 0.0
        return out._replace(inertia=out.inertia + self.rotary.rigid - counted)

    def motion_stiffness(self, axial: Number, spin2: Number, tip_force: Triple | None) -> Matrix:
        """int P f' f' dx for a1(X) = axial - spin2 X, and for a force along the beam at its tip."""
        assert self.stiffening is not None
        body = self.tip_body
        coefficients = [
            *tension(
                spin2, self.hub_radius, body.mass, self.beam_mass, self.length, axial,
                self.tip_mass_radius,
            )
        ]  # fmt: skip
        if isinstance(body, TipBody):  # its centre comes nearer when the end of the beam turns
            coefficients.append(body.offset * coefficients[0] / self.length)
        if tip_force is not None:
            coefficients[0] = coefficients[0] + tip_force[0]
        terms = jnp.stack(jnp.broadcast_arrays(*coefficients)) / self.length
        return weighted_sum(terms, self.stiffening)

    @property
    def is_linear(self) -> bool:
        return isinstance(self.elasticity, LinearElasticity)

    def force(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None) -> Vector:
        w, coriolis = hub_matrices(hub)
        motion = self._components(hub.acceleration) * self.first_moments
        motion = motion + self._components(w[:, 0]) * self.first
        inertial = self._gram_product((w, q), (coriolis, v))
        out = -(inertial + motion) - self.elasticity.force(q)
        if tip_force is not None:
            out = out + self._components(tip_force) * self.at_tip
        if self.stiffening is not None:
            out = out - matvec_once(self._tension(hub, w, tip_force), q)
        if self.rotary is not None:
            out = out + self.rotary.force(hub, q, v)
        return out

    def tangents(self, hub: Hub, q: Vector, v: Vector, tip_force: Triple | None) -> tuple[Any, Any]:
        w, coriolis = hub_matrices(hub)
        k = self.inertial(w) + self.elasticity.tangent(q)
        if self.stiffening is not None:
            k = k + self._tension(hub, w, tip_force)
        c = self.inertial(coriolis)
        if self.rotary is not None:
            more = self.rotary.tangents(hub)
            k, c = k + more[0], c if more[1] is None else c + more[1]
        return self.like_mass(k), self.like_mass(c)

    def like_mass(self, matrix: Matrix) -> Matrix | SmallMatrix:
        return SmallMatrix(matrix) if isinstance(self.mass, SmallMatrix) else matrix

    def _components(self, vector: Triple) -> Vector:
        """The component of a vector (3,) in the direction of each coordinate, (n,)."""
        return matvec(append_axes(self.model.one_hot, vector.ndim - 1), vector)

    def _gram_product(self, *pairs: tuple[LaneMatrix, Vector]) -> Vector:
        """The sum of [B] G q, [B] G as of `inertial`, over pairs (B, q), direction by direction:
        the rows of G of one direction need one row of B."""
        out, start = [], 0
        for c, count in enumerate(self.model.counts):
            if count:
                rows = self.gram[start : start + count]
                terms = [self._components(b[c]) * q for b, q in pairs]
                out.append(matvec_once(rows, functools.reduce(jnp.add, terms)))
            start += count
        return jnp.concatenate(out)

    def span_integral(self, kinks: tuple[float, ...], follows: bool) -> FunctionSpanIntegral:
        model, edges = self.model, tuple(sorted({0.0, 0.25, 0.5, 0.75, 1.0, *kinks}))
        functions = self._at(model.functions_from.rule(model.products, edges).xi)
        return FunctionSpanIntegral(functions.value, functions.slope, self.length, model, edges)

    def inertial(self, b: Float[Array, "3 3 *#lanes"]) -> Matrix:
        """The matrix [B] G with the entries B_cd G_ab, for coordinates a and b of directions c and
        d."""
        one_hot = append_axes(self.model.one_hot, b.ndim - 2)
        return matmul(matmul(one_hot, b), one_hot.swapaxes(0, 1)) * self.gram

    def _tension(
        self, hub: Hub, w: Float[Array, "3 3 *#lanes"], tip_force: Triple | None
    ) -> Matrix:
        return self.motion_stiffness(hub.acceleration[0], -w[0, 0], tip_force)

    def elastic_force(self, q: Vector) -> Vector:
        return self.elasticity.force(q)

    def elastic_tangent(self, q: Vector) -> Any:
        return self.like_mass(self.elasticity.tangent(q))

    def viscous_force(self, q: Vector, v: Vector) -> Vector:
        return self.elasticity.viscous(q, v)

    def viscous_tangents(self, q: Vector, v: Vector) -> tuple[Any, Any]:
        by_q, by_v = self.elasticity.viscous_tangents(q, v)
        return self.like_mass(by_q), self.like_mass(by_v)

    def root_slopes(self) -> Float[Array, "2 n"]:
        return self.shape_integrals.root[None] * self.model.one_hot[:, 1:].T / self.length

    def strain_energy(self, q: Vector) -> Number:
        return self.elasticity.energy(q)

    def nonconservative_force(self, q: Vector) -> Vector:
        return self.elasticity.nonconservative_force(q)

    def kinetic_energy(self, q: Vector, v: Vector, velocity: Triple, spin: Triple) -> Number:
        """T = int |v + omega x (X a1 + u) + u'|^2 dm / 2, with S = omega~ and S^T S = |omega|^2 -
        omega omega^T:

        int |u'|^2 dm / 2 + int (S^T v + S^T S X a1).u + v.u' dm + int u.S^T S u / 2 - u.S u' dm
            - int X a1.S u' dm.
        """
        s = skew(spin)
        st, sts = s.swapaxes(0, 1), matmul(s.swapaxes(0, 1), s)
        shift = matvec(st, velocity)
        moving = self._gram_product((jnp.asarray(append_axes(np.eye(3), spin.ndim - 1)), v))
        out = pairwise_sum(v * moving) / 2
        out = out + pairwise_sum(q * self._gram_product((sts / 2, q), (-s, v)))
        by_q, by_v = self._components(shift) * q, self._components(velocity) * v
        out = out + pairwise_sum(self.first_moments * (by_q + by_v))
        by_q, by_v = self._components(sts[0]) * q, self._components(s[0]) * v
        out = out + pairwise_sum(self.first * (by_q - by_v))
        if self.stiffening is not None:
            # The beam is shorter along a1 by w, with int w dm = q.D q / 2 and int X w dm =
            # q.E q / 2: D and E are the motion stiffness for a1(X) = -1 and for a1(X) = -X.
            by_q = matvec_once(self.motion_stiffness(-shift[0] / 2, sts[0, 0] / 2, None), q)
            by_v = matvec_once(self.motion_stiffness(-velocity[0], 0 * velocity[0], None), v)
            out = out - pairwise_sum(q * (by_q + by_v))
        return out if self.rotary is None else out + self.rotary.energy(q, v, spin)

    def first_moment(self, q: Vector) -> Triple:
        out = self._vector(self.first_moments * q)
        if self.stiffening is not None:
            one = jnp.ones_like(self.length)
            out = self._foreshortened(out, self.motion_stiffness(-one, 0 * one, None), q)
        return out

    def tip(self, q: Vector) -> Triple:
        """Displacement of the tip; to second order with `stiffening`, like the kinetic energy."""
        out = self._vector(self.at_tip * q)
        if self.stiffening is not None:
            zero = jnp.zeros_like(self.length)
            per_tip_force = self.motion_stiffness(zero, zero, jnp.stack([1 + zero, zero, zero]))
            out = self._foreshortened(out, per_tip_force, q)
        return out

    def _vector(self, each: Vector) -> Triple:
        """The vector (3,) whose components are sums over the coordinates of each direction."""
        return matvec(append_axes(self.model.one_hot.T, each.ndim - 1), each)

    def _foreshortened(self, vector: Triple, matrix: Matrix, q: Vector) -> Triple:
        """A vector (3,) less q.matrix q / 2 along the undeformed beam."""
        reduction = pairwise_sum(q * matvec_once(matrix, q)) / 2
        return vector - append_axes(np.eye(3)[0], reduction.ndim) * reduction[None]

    def displacement(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        """Displacement; of arc-length models u1 = s - 1/2 int_0^x (u2'^2 + u3'^2) dx (Y eq. 4)."""
        out = self._at(xi).value @ (self.model.one_hot * q[:, None])
        if not self.model.foreshortens:
            return out
        places = np.asarray(xi, float)
        if self.shapes is None:
            key = self.model.functions_from, self.model.counts, tuple(places.tolist())
            table: Any = shortening(*key)
        else:
            table = self.shapes.shortening(places)
        return out.at[:, 0].add(-jnp.einsum("a,pab,b->p", q, table, q) / (2 * self.length))

    def placed(self, q: Vector, span: Span) -> Float[Array, "p 3"]:
        """Positions of the points of a span: x a1 + `displacement`, integrated along the points."""
        functions, by_direction = self._at(np.asarray(span.xi)), self.model.one_hot * q[:, None]
        place = self.undeformed_at(span.xi) + functions.value @ by_direction
        if not self.model.foreshortens:
            return place
        slope = functions.slope @ by_direction[:, 1:]
        reduction = span.up_to(jnp.sum(slope * slope, 1)[:, None]) / (2 * self.length)
        return place - reduction * np.eye(3)[:1]

    def direction(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        """The tangent r' at x = `xi` L, to second order in theories of arc length."""
        slope = self._at(xi).slope @ (self.model.one_hot * q[:, None]) / self.length
        out = slope + np.eye(3)[:1]
        if not self.model.foreshortens:
            return out
        return out - jnp.sum(slope[:, 1:] ** 2, 1)[:, None] / 2 * np.eye(3)[:1]

    def end(self, q: Vector) -> Triple:
        """The unit vector along the end of the beam, to first order a1 + f'(L) q / L."""
        slope = self._vector(self.shape_integrals.tip_slope * q) / self.length
        across = slope * np.array([0.0, 1.0, 1.0])
        short = 0.0 if self.stiffening is None else pairwise_sum(across * across) / 2
        return across + (1 - short) * np.eye(3)[0]

    def turning_energy(self, body: TipBody, q: Vector, v: Vector, spin: Triple) -> Number:
        rotary = self.tip_rotary
        assert rotary is not None
        return rotary.energy(q, v, spin) + spin @ rotary.rigid @ spin / 2

    def section_momentum(
        self, q: Vector, v: Vector, spin: Triple, span: Span, moments: SecondMoments
    ) -> Float[Array, "p 3"]:
        assert self.rotary is not None
        functions = self._at(np.asarray(span.xi))
        return self.rotary.momentum(functions, self.length, span, moments, q, v, spin)

    @property
    def pieces(self) -> tuple[float, ...]:
        return _PIECES

    def strain(self, q: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        slope = self._at(xi).slope
        gradient = slope @ (self.model.one_hot * q[:, None]) / self.length
        return self.elasticity.strain(gradient)

    def curvature(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 2"]:
        bending = self.model.one_hot[:, 1:]
        # The curvature of axial functions may be infinite at the clamp, and is not needed.
        table = jnp.where(bending.any(1), self._at(xi).curvature, 0.0)
        return table @ (bending * q[:, None]) / self.length**2

    def _at(self, xi: np.ndarray) -> Functions:
        return self.model.functions(self.shapes, np.asarray(xi, float))


# Edges x / L of pieces that Gauss points integrate: short ones at the root for boundary layers.
_PIECES = (0.0, *(2.0**-k for k in range(9, 3, -1)), *np.linspace(0.125, 0.875, 7).tolist(), 1.0)


def _outer(x: Vector | np.ndarray) -> Any:
    return x[:, None] * x[None]
