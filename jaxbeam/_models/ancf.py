"""Absolute nodal coordinate formulation, Model A of Berzeri and Shabana (B), linearised.

In the frame that turns with the hub, Model A is M q'' + 2 Omega J M q' - Omega^2 M (q + q_R)
+ Q(q) = 0 with constant M, elastic forces Q = K_l(e) e + K_t e, axial strain interpolated along an
element from eps_A, eps_M, eps_B (B eq. A-3), and r = (R, 0), r' parallel to the beam at the root:
4 n + 1 coordinates for n elements, the axial slope at the root being free (B eqs. 18-20).

The steady beam is straight. There u' is quadratic along an element and equals the interpolated
strain, so the tangent is, exactly and for Model A as for the Green-strain element to first order,

    axial   int [EA (1 + 2 eps) psi' psi'^T + EI psi'' psi''^T] dx - Omega^2 M
    bending int [EA eps phi' phi'^T + EI phi'' phi''^T] dx         - Omega^2 M

(one EA eps is the tension that acts on both displacement components, the other is B eq. 52
evaluated with q_0). What is left to choose is the steady strain eps(x).
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._basis import (
    HermiteElements,
    bending_integrals,
    coupling_integral,
    hermite,
    stretch_integrals,
)
from jaxbeam._beam import Rotor, steady_case
from jaxbeam._linalg import solve
from jaxbeam._models.base import (
    AbstractModel,
    Family,
    LinearSystem,
    count_functions,
    inertia,
    tension_stiffness,
)
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Matrix, Real, Scalar


class _ANCF(AbstractModel):
    """Coordinates in metres: node by node the axial displacement and L times the axial slope
    (without the first displacement), then the same in plane (without displacement and slope of
    the first node). The slopes e_3, e_4, e_7, e_8 of B are these divided by L.
    """

    n_elements: int = eqx.field(static=True, default=10)

    def __check_init__(self) -> None:
        count_functions("n_elements", self.n_elements, least=1)

    @property
    def families(self) -> tuple[Family, ...]:
        """Axial, then in plane; the model is planar."""
        return (Family.AXIAL,) * (2 * self.n_elements + 1) + (Family.IN_PLANE,) * (
            2 * self.n_elements
        )

    @property
    def _basis(self) -> HermiteElements:
        return HermiteElements(self.n_elements)

    @abc.abstractmethod
    def steady_tension(self, rotor: Rotor, speed: Scalar) -> tuple[Matrix, Matrix, Scalar, Code]:
        """Stiffness of the steady tension EA eps on axial and on in-plane coordinates (N/m),
        the largest steady strain, and how the search for it ended."""

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        """Mass, gyroscopic and stiffness matrices (B eqs. 53-54)."""
        beam, length, tip_mass = rotor.beam, rotor.beam.length, rotor.tip_mass
        n_axial, n_bending = 2 * self.n_elements + 1, 2 * self.n_elements
        u = stretch_integrals(self._basis, n_axial)
        w = bending_integrals(self._basis, n_bending)
        on_axial, on_bending, strain, ended = self.steady_tension(rotor, speed)
        mass_u, mass_w = inertia(rotor, u), inertia(rotor, w)
        g = (
            2
            * speed
            * (
                beam.mass * coupling_integral(self._basis, n_bending, n_axial)
                + tip_mass * np.outer(w.tip, u.tip)
            )
        )
        rigidity = beam.in_plane_bending_stiffness / length**3
        stiffness_u = (
            beam.axial_stiffness / length * u.tension[0] + rigidity * u.curvature + 2 * on_axial
        )
        stiffness_w = rigidity * w.curvature + on_bending
        zero = jnp.zeros((n_axial, n_bending), speed.dtype)

        def pair(a: Array, b: Array) -> Array:
            return jnp.block([[a, zero], [zero.T, b]])

        return LinearSystem(
            mass=pair(mass_u, mass_w),
            gyroscopic=jnp.block([[jnp.zeros_like(mass_u), -g.T], [g, jnp.zeros_like(mass_w)]]),
            stiffness=pair(stiffness_u - speed**2 * mass_u, stiffness_w - speed**2 * mass_w),
            steady_strain=strain,
            status=ended,
            families=self.families,
        )

    def displacement(self, xi: Float[np.ndarray, " p"]) -> Float[Array, "3 p n"]:
        """Cubic Hermite interpolation; the model is planar, so flap is zero."""
        xi = np.asarray(xi, float)
        n_axial, n_bending = 2 * self.n_elements + 1, 2 * self.n_elements
        out = np.zeros((3, xi.size, n_axial + n_bending))
        out[0, :, :n_axial] = self._basis.stretch(n_axial, xi).value
        out[1, :, n_axial:] = self._basis.bending(n_bending, xi).value
        return jnp.asarray(out)


class SmallStrainANCF(_ANCF):
    """Model A linearised as in B, section 5: the model of B Tables 2-5.

    The steady strain is the *linear* one of B eqs. 41-43, eps = P / EA, found on the undeformed
    beam. It is wrong by about eps relative, so believe the numbers while `steady_strain` is small;
    `ANCF` says what they become.
    """

    def steady_tension(self, rotor: Rotor, speed: Scalar) -> tuple[Matrix, Matrix, Scalar, Code]:
        """Integrals of P(x) in closed form."""
        u = stretch_integrals(self._basis, 2 * self.n_elements + 1)
        w = bending_integrals(self._basis, 2 * self.n_elements)
        c0, c1, c2 = rotor.tension(speed)
        return (
            tension_stiffness(rotor, speed, u),
            tension_stiffness(rotor, speed, w),
            (c0 + c1 + c2 / 2) / rotor.beam.axial_stiffness,
            jnp.asarray(Status.OK),
        )


class ANCF(_ANCF):
    """Model A linearised exactly about its own non-linear steady state.

    The steady axial displacement solves int EA eps (1 + eps) psi' dx + EI int u'' psi'' dx
    = Omega^2 M (x + R + u), eps = u', by Newton iteration with the load raised from zero in
    adaptive steps when one step will not do. `Status.NOT_CONVERGED` where that ends short of the
    full load.
    """

    def steady_state(self, rotor: Rotor, angular_speed: Real) -> Array:
        """Axial coordinates (2 n + 1, in metres) of the steady state.

        Differentiable to any order by the implicit function theorem. Raises if the search fails.
        """
        return raise_unless_ok(*_jitted_steady_state(self, *steady_case(rotor, angular_speed)))

    def _steady_state(self, rotor: Rotor, speed: Scalar) -> tuple[Array, Code]:
        beam, length = rotor.beam, rotor.beam.length
        n_axial = 2 * self.n_elements + 1
        f = stretch_integrals(self._basis, n_axial)
        xi, weight = self._basis.quadrature(n_axial)
        slope = self._basis.stretch(n_axial, xi).slope
        # Divided by EA / L and by the length, so that unknowns and residuals are of order one.
        bending = beam.in_plane_bending_stiffness / (beam.axial_stiffness * length**2)
        load = speed**2 * length / beam.axial_stiffness
        mass = load * inertia(rotor, f)
        # Loads on the undeformed beam: int (R + x) psi dm / L. x is in the span of the functions
        # (nodal values of xi with slope one), R times the first moment of the functions is not.
        linear = self._interpolate_xi()
        moment = self._basis.stretch(n_axial, xi).value.T @ weight
        rigid = mass @ linear + load * rotor.hub_radius / length * (
            beam.mass * moment + rotor.tip_mass * f.tip
        )

        def residual(u: Array, fraction: Array | float = 1.0) -> Array:
            strain = slope @ u
            elastic = slope.T @ (weight * strain * (1 + strain)) + bending * (f.curvature @ u)
            return elastic - fraction * (rigid + mass @ u)

        def newton(u: Array, fraction: Array) -> tuple[Array, Array]:
            def body(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
                u, _, k = state
                du = solve(jax.jacfwd(residual)(u, fraction), residual(u, fraction))
                return u - du, jnp.max(jnp.abs(du)) / (1 + jnp.max(jnp.abs(u))), k + 1

            def go_on(state: tuple[Array, Array, Array]) -> Array:
                return (state[1] > 1e-13) & (state[2] < 20)  # NaN ends it too

            u, change, _ = jax.lax.while_loop(
                go_on, body, (u, jnp.asarray(jnp.inf), jnp.asarray(0))
            )
            # At round-off the step stalls slightly above the tolerance: accept that.
            return u, (change < 1e-10) & jnp.all(slope @ u > -0.5)

        def continuation(_: object, start: Array) -> tuple[Array, Array]:
            def body(
                state: tuple[Array, Array, Array, Array],
            ) -> tuple[Array, Array, Array, Array]:
                u, done, step, k = state
                target = jnp.minimum(done + step, 1.0)
                new, ok = newton(u, target)
                return (
                    jnp.where(ok, new, u),
                    jnp.where(ok, target, done),
                    jnp.where(ok, 2 * step, step / 4),
                    k + 1,
                )

            def go_on(state: tuple[Array, Array, Array, Array]) -> Array:
                return (state[1] < 1) & (state[2] > 1e-9) & (state[3] < 100)

            one = jnp.ones((), start.dtype)
            u, done, _, _ = jax.lax.while_loop(go_on, body, (start, 0 * one, one, jnp.asarray(0)))
            return u, done

        u, done = jax.lax.custom_root(
            residual,
            jnp.zeros(n_axial, speed.dtype),
            continuation,
            lambda g, y: solve(jax.jacfwd(g)(jnp.zeros_like(y)), y),
            has_aux=True,
        )
        return u * length, jnp.where(done < 1, Status.NOT_CONVERGED, Status.OK)

    def _interpolate_xi(self) -> np.ndarray:
        nodes = np.stack([np.linspace(0, 1, self.n_elements + 1), np.ones(self.n_elements + 1)], 1)
        return nodes.ravel()[1:]

    def steady_tension(self, rotor: Rotor, speed: Scalar) -> tuple[Matrix, Matrix, Scalar, Code]:
        """Integrals of EA eps over each element by Gauss points, exact for cubic shapes."""
        u, ended = self._steady_state(rotor, speed)
        n, length = self.n_elements, rotor.beam.length
        xi, weight = self._basis.quadrature(2 * n + 1)
        strain = self._basis.stretch(2 * n + 1, xi).slope @ (u / length)
        shapes = hermite(xi[:4] * n, 1 / n).slope  # the same in every element
        pairs = np.einsum("gi,gj->gij", shapes, shapes)
        blocks = jnp.einsum("eg,gij->eij", (weight * strain).reshape(n, 4), pairs)
        rows = 2 * np.arange(n)[:, None, None] + np.arange(4)[:, None]
        full = jnp.zeros((2 * n + 2, 2 * n + 2), u.dtype)
        full = full.at[rows, np.swapaxes(rows, 1, 2)].add(blocks)
        full = full * rotor.beam.axial_stiffness / length
        return full[1:, 1:], full[2:, 2:], u[0] / length, ended


@eqx.filter_jit
def _jitted_steady_state(model: ANCF, rotor: Rotor, speed: Scalar) -> tuple[Array, Code]:
    return model._steady_state(rotor, speed)
