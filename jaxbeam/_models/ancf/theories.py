"""Absolute nodal coordinates of Berzeri and Shabana (B): planar cubic cable elements.

See `elements.py` and `_models/ancf/energies.py` for the equations.

B is the paper of `_models/contract/__init__.py`.
"""

import dataclasses
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import count_functions
from jaxbeam._models.ancf.elements import ElementEquations
from jaxbeam._models.ancf.energies import Chord, Element, Green, ModelA, Tangent
from jaxbeam._models.ancf.exact import Engineering
from jaxbeam._models.bases.basis import HermiteElements, stretch_integrals
from jaxbeam._models.contract.bands import NodeByNode
from jaxbeam._models.contract.door import checked_case
from jaxbeam._models.contract.elasticity import LinearElasticity
from jaxbeam._models.contract.equilibrium import Rest
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.contract.small_motion import small_motion
from jaxbeam._models.contract.supports import AS_BUILT, ROOT_IN_PLANE, check_supported
from jaxbeam._models.modal.cartesian import CartesianEquations
from jaxbeam._models.modal.cartesian_model import CartesianModel, linear_system
from jaxbeam._numerics.linalg import dense, positive_definite
from jaxbeam._numerics.loose import symmetric_part
from jaxbeam._numerics.newton import find_root
from jaxbeam._programs.program import Program
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.motion import spinning
from jaxbeam._rotor.spanwise import AbstractSpanwise
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Matrix, Real, Scalar, Vector


class _ANCF(CartesianModel):
    supports = AS_BUILT
    n_elements: int = eqx.field(static=True, default=10)

    def __check_init__(self) -> None:
        count_functions("n_elements", self.n_elements, least=1)

    @property
    def title(self) -> str:
        return self._titled(f"{self.n_elements} element{'s' * (self.n_elements > 1)}")

    @property
    def functions_from(self) -> HermiteElements:
        return HermiteElements(self.n_elements)

    @property
    def counts(self) -> tuple[int, int, int]:
        return 2 * self.n_elements + 1, 2 * self.n_elements, 0


class _Nodal(_ANCF):
    """Geometrically non-linear elements, whose coordinates are ordered node by node.

    Properties may vary along the span, and a body may be at the tip (see `PlanarEnds`). With
    `_yields` the slope at the root is a coordinate too, held by the spring of the rotor.
    """

    supports = _ANCF.supports | ROOT_IN_PLANE
    element: ClassVar[type[Element]]
    # Whether the root yields; set by `suited`.
    _yields: bool = eqx.field(static=True, default=False, kw_only=True)

    @property
    def directions(self) -> tuple[Direction, ...]:
        """Directions of the coordinates: L u' of the first node, L w' before it if the root yields,
        then w, L w', u and L u' of each other node, w in plane and u axial."""
        first = (Direction.IN_PLANE, Direction.AXIAL)[0 if self._yields else 1 :]
        node = (Direction.IN_PLANE, Direction.IN_PLANE, Direction.AXIAL, Direction.AXIAL)
        return (*first, *self.n_elements * node)

    @property
    def step_cost(self) -> float:
        return 2.3 * (2 + 2.2 * self.n_elements)  # more than twice as many steps as linear motion

    def equations(self, rotor: Rotor) -> ElementEquations:
        """Equations of motion with the law of strain of `element`."""
        check_supported(self, rotor)
        return ElementEquations(rotor, self.n_elements, self.element)

    def suited(self, rotor: Rotor) -> Self:
        """The model with the slope at the root as a coordinate if the rotor has a spring there."""
        return dataclasses.replace(self, _yields=rotor.springs[0] is not None)

    def bands(self) -> NodeByNode | None:
        """The band of the matrices, node by node; None where the root yields."""
        # Equations of a subclass may depend on numbers that are no parameters.
        methods = ("equations", "steady", "matrices")
        on_four = all(getattr(type(self), name) is getattr(_Nodal, name) for name in methods)
        return None if self._yields else NodeByNode(self.n_elements, on_four)

    def displacement(self, xi: Float[np.ndarray, " p"], rotor: Rotor) -> Float[Array, "3 p n"]:
        """Axial, in-plane and flap displacement at x = xi L per unit of each coordinate."""
        n = self.n_elements
        # Functions that are zero at the root, by coordinate: slope there, value and slope of nodes.
        shapes = self.functions_from.stretch(2 * n + 1, xi).value
        out = np.zeros((3, len(xi), 4 * n + 2))
        node = 2 + 4 * np.arange(n)[:, None] + np.arange(2)
        for component, columns in ((1, np.append(0, node)), (0, np.append(1, node + 2))):
            out[component][:, columns] = shapes
        return jnp.asarray(out[:, :, 0 if self._yields else 1 :])

    def steady_state(self, rotor: Rotor, angular_speed: Real) -> Array:
        """Axial coordinates (2 n + 1, in metres) of the steady state; the beam stays straight.

        L times the slope at the root, then the displacement and L times the slope of every other
        node. Differentiable to any order by the implicit function theorem. `rotor` is a `Rotor`,
        `angular_speed` in rad/s.

        Raises `RuntimeError` where no state is found, `ValueError` or `TypeError` as `modes` does.
        """
        model, rotor, speed = checked_case(self, rotor, angular_speed)
        assert isinstance(model, _Nodal)
        return raise_unless_ok(*_jitted_steady(model, rotor, speed))[model._axial]

    def steady(self, rotor: Rotor, speed: Scalar) -> tuple[Vector, Code]:
        """The steady state, in which the beam is straight, and the status of the search for it."""
        # The unknowns are axial coordinates over L, and the residual is over EA: of order one.
        equations, hub = self.equations(rotor), spinning(speed)
        length, axial = rotor.beam.length, self._axial
        zero = jnp.zeros(len(self.directions), speed.dtype)
        columns = length * np.eye(zero.size)[axial]
        points, _ = self.functions_from.quadrature(axial.size)

        def residual(u: Array, fraction: Array | float = 1.0) -> Array:
            slower = hub._replace(angular_velocity=jnp.sqrt(fraction) * hub.angular_velocity)
            q = u @ columns
            return -equations.force(slower, q, zero, None)[axial] / equations.axial_stiffness

        def acceptable(u: Array) -> Array:
            return jnp.all(equations.gradient(u @ columns, points)[1] > -0.5)

        u, done = find_root(residual, zero[axial], acceptable)
        q = u @ columns
        status = jnp.where(done < 1, Status.NOT_CONVERGED, Status.OK)
        if self.element.tears:
            if not rotor.varies and not rotor.tip_body.is_body:
                torn = rotor.tears(speed)
            else:
                k, _ = equations.tangents(hub, q, zero, None)
                torn = ~positive_definite(dense(k)[axial][:, axial])
            status = jnp.where(torn, Status.NO_EQUILIBRIUM, status)
        return q, status

    @property
    def _axial(self) -> np.ndarray:
        return np.flatnonzero([direction == Direction.AXIAL for direction in self.directions])

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        """Matrices of small motion about the straight steady state, however large its strain (B
        eqs. 53-54 are for small strain)."""
        rest, equations = Rest(*self.steady(rotor, speed)), self.equations(rotor)
        m, c, k = equations.matrices_about(spinning(speed), rest.q)
        rest = rest._replace(matrices=(m, c, symmetric_part(k)))
        return small_motion(self, rotor, speed, equations, rest, state=rest.q)


class GreenANCF(_Nodal):
    """Finite elements with an energy of Green strain, U = int EA eps^2 + EI r''.r'' dx / 2.

    It hardens with strain, axially and, since r''.r'' = (phi' |r'|)^2 + |r'|'^2 with phi the angle
    of the tangent, in bending; its limit is not that of `PlanarRod`, see there.

    `n_elements` (int >= 1, 10 by default) as in `PlanarRod`.

    Raises as `PlanarRod` does.
    """

    element = Green


class PlanarRod(_Nodal):
    """Finite elements of the shear-free rod of Reissner, geometrically exact, in a plane.

    Their axial strain is the engineering strain |r'| - 1, and

        U = int EA (|r'| - 1)^2 + EI phi'^2 dx / 2,   phi' = (r' x r'') / r'.r',

    phi the angle of the tangent. So axial force is EA times strain, and bending moment is EI times
    the change of angle per *undeformed* length: what those who measure EA and EI on a specimen mean
    by them. The judge of `choose_model` and the reference of the studies.

    r''.r'' in place of phi'^2, as Berzeri and Shabana and `GreenANCF` have it, is another material:
    it is (phi' |r'|)^2 + |r'|'^2. The first makes bending stiffer by 2 eps, relative, and lets
    bending shorten the beam, by the square of phi' times the radius of gyration; the second resists
    changes of stretch. Curvature per deformed length, phi' / |r'|, would be softer by as much
    (Gerstmayr and Irschik, J. Sound Vib. 318, 2008, on these measures). All agree where strains,
    those of bending included, are small. The limits of `GreenANCF` and of this differ by 1e-5 of
    the largest deflection on the spin-up of B Ref. 21 to 4 rad/s (strain 2e-5), 5e-5 for a
    cantilever of slenderness 300 bent to 0.8 L, 3e-3 to 3e-2 where motion strains by 1 to 4 %.

    The straight rod is linear in its stretch: like `Hybrid` it tears at a finite speed, at
    Omega L (rho / EA)^(1/2) = pi / 2 without a tip mass, beyond which it has no steady state.

    `n_elements` is how many equal elements there are, an int >= 1.

    Raises `TypeError` or `ValueError` for any other number of elements.
    """

    element = Engineering
    called = ""
    is_reference = True


class ChordANCF(_Nodal):
    """Model 0 of B, linear strain in the frame of each element's chord.

    Unstable above a speed that grows with the number of elements.

    `n_elements` (int >= 1, 10 by default) as in `PlanarRod`.

    Raises as `PlanarRod` does.
    """

    element = Chord


class TangentANCF(_Nodal):
    """Model 0 of B in a frame tangent to each element's first node: clamped-free substructures.

    Fails at a lower speed than `ChordANCF`, and is far too stiff with few elements: neighbours
    measure strain along different directions. With one element it is `Classical`.

    `n_elements` (int >= 1, 10 by default) as in `PlanarRod`.

    Raises as `PlanarRod` does.
    """

    element = Tangent


class SmallStrainANCF(_ANCF):
    """Model A linearised as in B, section 5: the model of B Tables 2-5.

    The steady strain is the *linear* one of B eqs. 41-43, eps = P / EA, found on the undeformed
    beam. Frequencies are wrong by up to 0.9 eps, relative, against `PlanarRod` (0.4 eps
    against `GreenANCF`): believe them while `steady_strain` is small. The tension acts on
    transverse displacement and, twice, on axial displacement (one EA eps is its own, the other is
    B eq. 52 evaluated with q_0).

    `n_elements` is how many equal elements there are, an int >= 1.

    Raises `TypeError` or `ValueError` for any other number of them.
    """

    is_linear = True

    def equations(self, rotor: Rotor) -> CartesianEquations:
        """Linear equations of motion, with the tension P(x) of the undeformed beam."""
        shapes = self.shapes(rotor)
        stiffness = self.linear_stiffness(rotor, shapes) + axial_bending(self, rotor)
        return CartesianEquations.build(
            self, rotor, LinearElasticity(stiffness), shapes,
            lambda integrals: integrals.tension + 2 * integrals.axial_tension,
        )  # fmt: skip

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        """Mass, gyroscopic and stiffness matrices (B eqs. 53-54)."""
        return linear_system(self, rotor, speed)


def axial_bending(model: _ANCF, rotor: Rotor) -> Matrix:
    """The stiffness int EI u1'' u1'' dx of axial coordinates, which is part of EI r''.r''."""
    beam, n = rotor.beam, model.counts[0]
    stiffness, others = beam.in_plane_bending_stiffness, len(model.directions) - n
    if isinstance(stiffness, AbstractSpanwise):
        rule = model.functions_from.rule(n, (0.0, *stiffness.kinks, 1.0))
        curvature = model.functions_from.stretch(n, rule.xi).curvature
        block = curvature.T @ ((rule.weight * stiffness.at(rule.xi))[:, None] * curvature)
        return jnp.pad(block / beam.length**3, (0, others))
    out = np.zeros((len(model.directions),) * 2)
    out[:n, :n] = stretch_integrals(model.functions_from, n).curvature
    return stiffness / beam.length**3 * out


class ANCF(_Nodal):
    """Model A of Berzeri and Shabana (B): axial strain interpolated along the element (B eq. A-3).

    Not conservative, see `Equations.nonconservative_force`.

    The steady beam is straight. There u' is quadratic along an element and equals the interpolated
    strain, so the tangent is that of any non-linear strain to first order, and symmetric.

    `n_elements` (int >= 1, 10 by default) as in `PlanarRod`.

    Raises as `PlanarRod` does.
    """

    element = ModelA


@Program
def _jitted_steady(model: _Nodal, rotor: Rotor, speed: Scalar) -> tuple[Vector, Code]:
    return model.steady(rotor, speed)
