"""What all models of a continuous beam share: displacements linear in the coordinates.

u_c(x, t) = f_a(x) q_a(t), summed over the coordinates a that move in direction c. Then the inertia
of a beam on any moving hub needs only one Gram matrix of all functions, int f_a f_b dm, and the
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
    What it and sections have because they turn is `rotary`, that of the body alone `tip_rotary`.
    """

    mass: Matrix | SmallMatrix
    gram: Matrix
    first_moments: Vector
    first: Vector
    at_tip: Vector
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
    own: ShapeIntegrals | None  # of a beam that varies
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
        """Scale the tables of `model` to a rotor; `stiffened` says which are `stiffening`."""
        check_supported(model, rotor)
        own = None
        if shapes is not None and rotor.varies:
            own = weighted(shapes, rotor)
        beam, t, body = rotor.beam, model.shape_integrals if own is None else own, rotor.tip_body
        radius, length, mass, tip_mass = rotor.hub_radius, beam.length, beam.mass, rotor.tip_mass
        end, tip = radius + length, body.centre(t.tip, t.tip_slope, length)
        stiffening = None if stiffened is None else stiffened(t)
        gram = mass * t.gram + tip_mass * _outer(tip)
        first = mass * (radius * t.mean + length * t.first) + tip_mass * rotor.tip_mass_radius * tip
        rotary = tip_rotary = None
        if body.is_body and stiffening is not None:
            alike = _outer(t.tip_slope) * (t.one_hot @ t.one_hot.T)
            stiffening = jnp.concatenate([stiffening, alike[None]])
        if rotor.turns_mass:
            sampled = model.sampled(rotor, shapes)
            rotary, tip_rotary = of_rotor(rotor, sampled, stiffening is not None)
        inertia = gram * (t.one_hot @ t.one_hot.T)
        if least := massless(model.functions_from, gram.dtype):
            inertia = inertia + least * (mass + tip_mass) * np.eye(len(t.one_hot))
        return cls(
            mass=inertia if rotary is None else inertia + rotary.mass,
            gram=gram,
            first_moments=mass * t.mean + tip_mass * tip,
            first=first,
            at_tip=jnp.asarray(t.tip),
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
            own=own,
            model=model,
        )

    @property
    def kernel(self) -> Self | None:
        # What derives from this, or from an elasticity, may not be written for lanes.
        suits = type(self) is CartesianEquations and vars(type(self.elasticity)).get("takes_lanes")
        if not suits or len(self.gram) > LARGE or isinstance(self.mass, SmallMatrix):
            return None
        return replaced(self, mass=SmallMatrix(self.mass), shapes=None, own=None, tip_rotary=None)

    @property
    def functions(self) -> Shapes | None:
        return self.shapes

    @property
    def shape_integrals(self) -> ShapeIntegrals:
        """Integrals of the functions, and their values at the ends."""
        return self.model.shape_integrals if self.own is None else self.own

    @property
    def undeformed(self) -> Undeformed:
        """The undeformed beam, with rotary inertia."""
        out = super().undeformed
        if self.rotary is None:
            return out
        # Which of a body is in `rigid_moments` by what it has in plane.
        body, both = self.tip_body, append_axes(np.diag([0.0, 1.0, 1.0]), self.length.ndim)
        less = body.inertia * both if isinstance(body, TipBody) else 0.0
        return out._replace(inertia=out.inertia + self.rotary.rigid - less)

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
        if isinstance(body, TipBody):  # what its centre does when the end of the beam turns
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
        carried = self._along(hub.acceleration) * self.first_moments
        carried = carried + self._along(w[:, 0]) * self.first
        inertial = self._carried((w, q), (coriolis, v))
        out = -(inertial + carried) - self.elasticity.force(q)
        if tip_force is not None:
            out = out + self._along(tip_force) * self.at_tip
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

    def _along(self, vector: Triple) -> Vector:
        """The component of a vector in the direction of each coordinate."""
        return matvec(append_axes(self.model.one_hot, vector.ndim - 1), vector)

    def _carried(self, *parts: tuple[LaneMatrix, Vector]) -> Vector:
        """The sum of [B] G q of the module's docstring, B and q being each of these: rows of one
        direction after the other, which need one row of B."""
        out, start = [], 0
        for c, count in enumerate(self.model.counts):
            if count:
                rows = self.gram[start : start + count]
                terms = [self._along(b[c]) * q for b, q in parts]
                out.append(matvec_once(rows, functools.reduce(jnp.add, terms)))
            start += count
        return jnp.concatenate(out)

    def span_integral(self, kinks: tuple[float, ...], follows: bool) -> FunctionSpanIntegral:
        model, edges = self.model, tuple(sorted({0.0, 0.25, 0.5, 0.75, 1.0, *kinks}))
        at = self._at(model.functions_from.rule(model.products, edges).xi)
        return FunctionSpanIntegral(at.value, at.slope, self.length, model, edges)

    def inertial(self, b: Float[Array, "3 3 *#lanes"]) -> Matrix:
        """[B] G of the module's docstring."""
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
        spun = skew(spin)
        back = spun.swapaxes(0, 1)  # S^T
        away = matmul(back, spun)
        shift = matvec(back, velocity)
        moving = self._carried((jnp.asarray(append_axes(np.eye(3), spin.ndim - 1)), v))
        out = pairwise_sum(v * moving) / 2 + pairwise_sum(
            q * self._carried((away / 2, q), (-spun, v))
        )
        at, rate = self._along(shift) * q, self._along(velocity) * v
        out = out + pairwise_sum(self.first_moments * (at + rate))
        out = out + pairwise_sum(self.first * (self._along(away[0]) * q - self._along(spun[0]) * v))
        if self.stiffening is not None:
            # The beam is shorter along a1 by w, int w dm = q.D q / 2 and int X w dm = q.E q / 2
            # with what is motion stiffness for a1(X) = -1 and for X.
            at = matvec_once(self.motion_stiffness(-shift[0] / 2, away[0, 0] / 2, None), q)
            rate = matvec_once(self.motion_stiffness(-velocity[0], 0 * velocity[0], None), v)
            out = out - pairwise_sum(q * (at + rate))
        return out if self.rotary is None else out + self.rotary.energy(q, v, spin)

    def first_moment(self, q: Vector) -> Triple:
        out = self._sum(self.first_moments * q)
        if self.stiffening is not None:
            one = jnp.ones_like(self.length)
            out = self._shortened(out, self.motion_stiffness(-one, 0 * one, None), q)
        return out

    def tip(self, q: Vector) -> Triple:
        """Displacement of the tip, to second order with `stiffening`, as the kinetic energy has
        it."""
        out = self._sum(self.at_tip * q)
        if self.stiffening is not None:
            zero = jnp.zeros_like(self.length)
            pull = self.motion_stiffness(zero, zero, jnp.stack([1 + zero, zero, zero]))
            out = self._shortened(out, pull, q)
        return out

    def _sum(self, each: Vector) -> Triple:
        """The vector of numbers along the direction of each coordinate."""
        return matvec(append_axes(self.model.one_hot.T, each.ndim - 1), each)

    def _shortened(self, vector: Triple, matrix: Matrix, q: Vector) -> Triple:
        """A vector, shortened by q.matrix q / 2 along the beam."""
        less = pairwise_sum(q * matvec_once(matrix, q)) / 2
        return vector - append_axes(np.eye(3)[0], less.ndim) * less[None]

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
        """Where points are: as `displacement` has it, by integrals from point to point."""
        at, each = self._at(np.asarray(span.xi)), self.model.one_hot * q[:, None]
        place = self.undeformed_at(span.xi) + at.value @ each
        if not self.model.foreshortens:
            return place
        slope = at.slope @ each[:, 1:]
        shorter = span.up_to(jnp.sum(slope * slope, 1)[:, None]) / (2 * self.length)
        return place - shorter * np.eye(3)[:1]

    def direction(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 3"]:
        """r', to second order in theories of arc length."""
        slope = self._at(xi).slope @ (self.model.one_hot * q[:, None]) / self.length
        out = slope + np.eye(3)[:1]
        if not self.model.foreshortens:
            return out
        return out - jnp.sum(slope[:, 1:] ** 2, 1)[:, None] / 2 * np.eye(3)[:1]

    def end(self, q: Vector) -> Triple:
        """The unit vector e of the class's docstring."""
        slope = self._sum(self.shape_integrals.tip_slope * q) / self.length
        across = slope * np.array([0.0, 1.0, 1.0])
        short = 0.0 if self.stiffening is None else pairwise_sum(across * across) / 2
        return across + (1 - short) * np.eye(3)[0]

    def turning_energy(self, body: TipBody, q: Vector, v: Vector, spin: Triple) -> Number:
        own = self.tip_rotary
        assert own is not None
        return own.energy(q, v, spin) + spin @ own.rigid @ spin / 2

    def section_momentum(
        self, q: Vector, v: Vector, spin: Triple, span: Span, moments: SecondMoments
    ) -> Float[Array, "p 3"]:
        assert self.rotary is not None
        at = self._at(np.asarray(span.xi))
        return self.rotary.momentum(at, self.length, span, moments, q, v, spin)

    @property
    def pieces(self) -> tuple[float, ...]:
        return _PIECES

    def strain(self, q: Vector, xi: np.ndarray) -> Float[Array, " p"]:
        slope = self._at(xi).slope
        gradient = slope @ (self.model.one_hot * q[:, None]) / self.length
        return self.elasticity.strain(gradient)

    def curvature(self, q: Vector, xi: np.ndarray) -> Float[Array, "p 2"]:
        bends = self.model.one_hot[:, 1:]
        # Axial functions may have no curvature at the clamp: nobody asks for it.
        table = jnp.where(bends.any(1), self._at(xi).curvature, 0.0)
        return table @ (bends * q[:, None]) / self.length**2

    def _at(self, xi: np.ndarray) -> Functions:
        return self.model.functions(self.shapes, np.asarray(xi, float))


# Between these functions are smooth enough for points of integration; the root has boundary layers.
_PIECES = (0.0, *(2.0**-k for k in range(9, 3, -1)), *np.linspace(0.125, 0.875, 7).tolist(), 1.0)


def _outer(x: Vector | np.ndarray) -> Any:
    return x[:, None] * x[None]
