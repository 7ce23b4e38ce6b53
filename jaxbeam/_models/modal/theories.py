"""Modal (Ritz) models of Yoo, Ryan and Scott (Y) in three dimensions, with hub and tip mass.

Y eqs. 18-20 read, in words: inertia of the relative acceleration in the moving frame, plus elastic
stiffness, plus for bending the stiffness of the tension P(x) that carries the undeformed beam along
(`cartesian.py`). With the hub turning at Omega about a3 and the beam along a1,

    rho (s''  - 2 Omega u2' - Omega' u2 - Omega^2 s)  - (EA s_x)_x                    = Omega^2 X
    rho (u2'' + 2 Omega s'  + Omega' s  - Omega^2 u2) + (EI_zz u2_xx)_xx - (P u2_x)_x = -Omega' X
    rho  u3''                                         + (EI_yy u3_xx)_xx - (P u3_x)_x = 0

(primes are time derivatives), with the tip mass as a point in the mass measure. The theories below
differ in two things: whether P is there, and what stretches the beam.

Y is the paper of `_models/contract/__init__.py`.
"""

import abc
import dataclasses
from typing import Any, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._checks import check_kind, count_functions
from jaxbeam._models.bases import layered
from jaxbeam._models.bases.basis import Basis, CantileverModes, Polynomials, Yielding
from jaxbeam._models.bases.loads import FunctionCounts, Kind, Mixes, Profile
from jaxbeam._models.bases.shapes import (
    Shapes,
    all_functions,
    follows,
    of_basis,
    shape_of,
    shapes_on,
)
from jaxbeam._models.bases.truncation import MORE_POINTS, forms, frequency_error, tension
from jaxbeam._models.contract.bands import BandTables
from jaxbeam._models.contract.elasticity import LinearElasticity
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.contract.supports import (
    AS_BUILT,
    ROOT_SPRINGS,
    TURNED,
    Neglects,
    check_supported,
)
from jaxbeam._models.modal import finer, higher_functions
from jaxbeam._models.modal.cartesian import CartesianEquations
from jaxbeam._models.modal.cartesian_model import CartesianModel, linear_system
from jaxbeam._models.modal.coned import coned_system
from jaxbeam._models.modal.von_karman import VonKarmanElasticity
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.span import on, shortened
from jaxbeam._types import Scalar


class _Modal(CartesianModel):
    """Ritz coordinates q in metres: s or u1 = psi.q_1, u2 = phi.q_2, u3 = phi.q_3, in this order.

    `n_stretch`, `n_in_plane`, `n_flap` are how many functions of `basis`, `Polynomials()` by
    default, there are of each; zero leaves a direction out.

    Raises `TypeError` for what are no ints or no basis, and `ValueError` for negative numbers, or
    zeros throughout.
    """

    supports = AS_BUILT | ROOT_SPRINGS | TURNED
    n_stretch: int = eqx.field(static=True, default=10)
    n_in_plane: int = eqx.field(static=True, default=16)
    n_flap: int = eqx.field(static=True, default=16)
    basis: Basis = eqx.field(static=True, default=Polynomials())

    def __check_init__(self) -> None:
        for name in ("n_stretch", "n_in_plane", "n_flap"):
            count_functions(name, getattr(self, name))
        if self.n_stretch + self.n_in_plane + self.n_flap == 0:
            raise ValueError("n_stretch, n_in_plane, n_flap: at least one must be > 0")
        check_kind("basis", self.basis, Basis)

    @classmethod
    def of_size(cls, n: int, rotor: Rotor, planar: bool, n_stretch: int = 0) -> Self:
        """The model with n bending functions in plane and, unless `planar`, in flap, and one more
        in each where the root yields, for a rotor and others of its kind."""
        # One or two modes at rest are better than as many polynomials, from three on polynomials
        # are better. Modes of a uniform beam are not those of one that varies.
        few = n <= 2 and not n_stretch and not rotor.varies
        basis = CantileverModes() if few else Polynomials()
        in_plane, flap = (n + (spring is not None) for spring in rotor.springs)
        return cls(n_stretch, in_plane, 0 if planar else flap, basis=basis).suited(rotor)

    @property
    def title(self) -> str:
        n, flap, unit = self.n_in_plane, self.n_flap, self.basis.unit
        count = f"{n} and {flap} {unit}s" if flap else f"{n} {unit}{'s' * (n > 1)}"
        return self._titled(count + f", stretch {self.n_stretch}" * (self.n_stretch > 0))

    @property
    def functions_from(self) -> Basis:
        return self.basis

    def suited(self, rotor: Rotor) -> Self:
        """The model with functions for a slope at the root where the rotor has springs there. All
        functions of the package that take a model begin with this."""
        basis = self.basis.basis if isinstance(self.basis, Yielding) else self.basis
        if rotor.root_springs is not None and not follows(basis, rotor):
            basis = Yielding(basis, *(spring is not None for spring in rotor.springs))
        return dataclasses.replace(self, basis=basis)

    def judged(self, rotor: Rotor) -> bool:
        """Whether the error by too few functions is judged: of a uniform beam too where functions
        have layers, or are as many as by default, or none."""
        numbers = ((self.n_in_plane, type(self).n_in_plane), (self.n_flap, type(self).n_flap))
        by_default = all(n in (0, default) for n, default in numbers)
        return super().judged(rotor) or by_default or layered.has_layers(self.basis)

    def resolves(self, rotor: Rotor, speed: Scalar) -> Bool[Array, ""]:
        """Whether functions are enough: n polynomials are for boundary layers at a clamp if
        kappa = L sqrt(P / EI) is at most n^2."""
        if rotor.varies or not self.judged(rotor) or layered.has_layers(self.basis):
            return super().resolves(rotor, speed)
        return layered.are_followed(self.counts[1:], rotor, speed)

    def tension(self, rotor: Rotor, profile: Profile, speed: Scalar) -> Array | None:
        """The tension in sections in steady rotation, in N; None in a theory that neglects it."""
        return tension(profile, rotor, speed)

    def frequency_error(
        self, system: LinearSystem, rotor: Rotor, speed: Scalar, eigenvalue: Array, shape: Array
    ) -> Float[Array, " k"] | None:
        """The estimate of relative errors of frequencies by too few functions, for beams that
        vary, from the residual of the differential equation (`truncation.py`)."""
        if not rotor.varies or rotor.precone is not None:
            return None
        # Without axial motion all shapes are real.
        shape = shape if self.n_stretch else shape.real
        coordinates = self._by_direction(shape)
        if system.shapes is not None and system.shapes.mixes is not None:
            profile, shapes = shape_of(
                self._kind, rotor, system.shapes.mixes, coordinates, MORE_POINTS
            )
        else:
            span = self.basis.rule(2 * self.products, shortened(rotor.beam.edges))
            profile = Profile.of(rotor, span)
            shapes = of_basis(self.basis, self.counts, span, coordinates)
        tension = self.tension(rotor, profile, speed)
        return frequency_error(shapes, profile, rotor, speed, eigenvalue, self.counts, tension)

    def _by_direction(self, shape: Array) -> list[Array]:
        """Coordinates (k, n) of k modes as matrices (n_d, k) of axial, in-plane and flap ones."""
        return jnp.split(shape.T, np.cumsum(self.counts)[:-1])

    @property
    def stretch_follows(self) -> bool:
        """Whether stretch functions on a beam that varies have the steps of 1 / EA."""
        return True

    @property
    def _kind(self) -> Kind:
        assert isinstance(self.basis, Polynomials)
        return Kind(self.counts, self.basis.grading, self.products, self.stretch_follows)

    def shapes(self, rotor: Rotor) -> Shapes | None:
        if follows(self.basis, rotor):
            return shapes_on(self._kind, rotor)
        return super().shapes(rotor)

    @property
    def counts(self) -> FunctionCounts:
        return self.n_stretch, self.n_in_plane, self.n_flap

    @abc.abstractmethod
    def equations(self, rotor: Rotor) -> CartesianEquations: ...


class _Linear(_Modal):
    is_linear = True

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        """Matrices of small motion: the coefficients of the linear equations of motion."""
        return linear_system(self, rotor, speed)

    def frequency_error(
        self, system: LinearSystem, rotor: Rotor, speed: Scalar, eigenvalue: Array, shape: Array
    ) -> Float[Array, " k"] | None:
        """The estimate for uniform beams by what more functions would add: `higher_functions.py`
        for polynomials, `finer.py` for layers and rotary inertia with pitch. Beams that vary have
        that of `_Modal`."""
        if rotor.varies or rotor.precone is not None:
            return super().frequency_error(system, rotor, speed, eigenvalue, shape)
        # Subclasses may have other functions.
        if type(self) not in (Hybrid, Classical):
            return None
        skew = rotor.pitch is not None and rotor.beam.polar_inertia is not None
        if skew or layered.has_layers(self.basis):
            return finer.frequency_error(self, rotor, speed, eigenvalue, shape)
        return higher_functions.frequency_error(
            self, rotor, speed, eigenvalue, shape, tensioned=self.foreshortens
        )


class Hybrid(_Linear):
    """Arc-length stretch and two Cartesian deflections: the method of Y, linear.

    Stiffens as it must at any speed. The tension acts on the undeformed beam, so frequencies are
    wrong by up to 0.9 of the steady strain, relative, and motions are right to second order in
    deflection over length: compare `PlanarRod` where those are not small.
    `Hybrid(n_stretch=0)` is the inextensible (prestressed, bending-only) beam.

    `n_stretch`, `n_in_plane` and `n_flap` (10, 16 and 16) are numbers of functions, ints >= 0 of
    which zero leaves a direction out, of `basis` (`Polynomials()`, or another of `jb.models`). With
    these numbers, and of bending with zero, uniform beams so soft that tension holds them have
    `Layered()` functions where speed and rotor are known; with others the choice is the user's own.

    Raises `TypeError` or `ValueError` for any other numbers, zeros throughout, or no basis.
    """

    supports_in_matrices = frozenset({"precone"})
    called = "hybrid"
    neglects = Neglects(deflection=0.3, strain=0.4)

    def at_speed(self, rotor: Rotor, speed: Any) -> Self:
        """The model with boundary layers among its functions by default, for a uniform beam so
        soft that polynomials leave out 1e-6 of a frequency or more."""
        if not (self._lacks_layers(rotor) and layered.is_known_to_be_soft(rotor, speed)):
            return self
        lag, flap = (n + layered.LAYERS * (n > 0) for n in self.counts[1:])
        basis = layered.with_layers(self.basis)
        return dataclasses.replace(self, basis=basis, n_in_plane=lag, n_flap=flap)

    def most_error(self, rotor: Rotor, speed: Scalar) -> Any:
        """The error above which frequencies fail: 1e-6 for beams that `at_speed` gives layers."""
        soft = self._lacks_layers(rotor) and layered.is_soft(rotor, speed)
        return jnp.where(soft, 1e-6, super().most_error(rotor, speed))

    def _lacks_layers(self, rotor: Rotor) -> bool:
        return layered.without_layers(self.basis) and not rotor.varies and self.judged(rotor)

    @property
    def foreshortens(self) -> bool:
        return True

    def equations(self, rotor: Rotor) -> CartesianEquations:
        """Equations with the stiffness int P(x) phi' phi'^T dx of the tension P: the second and
        third lines of Y eqs. 19 and 20."""
        shapes = self.shapes(rotor)
        elastic = LinearElasticity(self.linear_stiffness(rotor, shapes))
        return CartesianEquations.build(self, rotor, elastic, shapes, lambda t: t.tension)

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        """Matrices of small motion: the coefficients of the linear equations, or of a coned beam
        those about its deflected steady state (`coned.py`)."""
        if rotor.precone is None:
            return super().matrices(rotor, speed)
        check_supported(self, rotor, moving=False)
        if self.n_stretch or not self.n_in_plane or not self.n_flap:
            raise ValueError(
                "precone: take Hybrid(n_stretch=0), with functions in plane and in flap, for the "
                "frequencies of a coned beam"
            )
        return coned_system(rotor, speed, self.sampled(rotor, self.shapes(rotor)), self.directions)

    def mixes(self, system: LinearSystem, rotor: Rotor) -> Mixes | None:
        """Combinations of loads that the functions of a beam that varies are deflections by; None
        for models with stretch, cones and subclasses."""
        alone = type(self) is Hybrid and not self.n_stretch and rotor.precone is None
        return system.shapes.mixes if alone and system.shapes is not None else None

    def forms(
        self, rotor: Rotor, speed: Scalar, shape: Array, mixes: Mixes
    ) -> tuple[Array, Array, Array]:
        """Quadratic forms of modes `shape` (k, n) by integrals of the k shapes themselves: much
        fewer than integrals of all functions."""
        profile, x = shape_of(self._kind, rotor, mixes, self._by_direction(shape.real))
        tension = self.tension(rotor, profile, speed)
        assert tension is not None
        return forms(x, profile, rotor, speed, self.counts, tension)

    def bands(self) -> BandTables | None:
        """Tables of the band matrices: polynomials give narrow bands if they are ordered by
        degree, in-plane ones first. None for other functions."""
        # Subclasses may differ in stiffness, functions or equations.
        enough = self.n_in_plane >= 8 and self.n_flap not in range(1, 8)
        if type(self) is not Hybrid or self.basis != Polynomials() or not enough:
            return None
        unit, m, n = self.shape_integrals, self.n_stretch, self.n_in_plane
        order = np.argsort(np.append(np.arange(m) + 0.5, np.arange(n)), kind="stable")
        rows, one_hot = np.ix_(order, order), unit.one_hot[order]
        same, tips = one_hot @ one_hot.T, np.outer(unit.tip, unit.tip)
        in_plane = [table[rows] for table in (*unit.elastic[[1, 0]], *unit.tension)]
        in_plane += [same * unit.gram[rows], same * tips[rows]]
        in_plane += [(1 - same) * unit.gram[rows], (1 - same) * tips[rows]]
        flap = [
            table[m + n :, m + n :] for table in (unit.elastic[2], *unit.tension, unit.gram, tips)
        ]
        return BandTables(
            in_plane=[_without_rounding(table) for table in in_plane],
            flap=[_without_rounding(table) for table in flap] if self.n_flap else [],
            order=np.append(order, np.arange(m + n, len(self.directions))),
            places=np.argsort(order)[m:],
        )


def _without_rounding(table: np.ndarray) -> np.ndarray:
    return np.where(np.abs(table) > 1e-12 * np.abs(table).max(initial=0.0), table, 0.0)


class Classical(_Linear):
    """Classical linear Cartesian theory (C.L.C. of Y): no motion-induced stiffness.

    Offered because it is widely used and wrong: in plane it diverges at the first rest frequency
    of bending whatever the hub radius, and it never stiffens. Where its numbers may be trusted is
    where the tension is small against the bending stiffness.

    `n_stretch`, `n_in_plane`, `n_flap` and `basis` as in `Hybrid`.

    Raises as `Hybrid` does.
    """

    called = "classical"
    neglects = Neglects(stiffening=0.5, deflection=0.3, strain=0.4)

    @property
    def step_cost(self) -> float:
        return super().step_cost - 0.1

    def tension(self, rotor: Rotor, profile: Profile, speed: Scalar) -> None:
        return None

    def equations(self, rotor: Rotor) -> CartesianEquations:
        """Equations without P: what this theory leaves out."""
        shapes = self.shapes(rotor)
        elastic = LinearElasticity(self.linear_stiffness(rotor, shapes))
        return CartesianEquations.build(self, rotor, elastic, shapes)


class VonKarman(_Modal):
    """Cartesian displacements with the von Karman strain u1' + (u2'^2 + u3'^2) / 2 (Y, section 3).

    The non-linear counterpart of `Hybrid`: no motion-induced stiffness, but the stretching energy
    is quartic and gives it back. Functions for u1 must follow u2'^2, so take at least twice as
    many (less one) of them as for bending, or the beam locks.

    `n_stretch`, `n_in_plane`, `n_flap` (16, 8 and 8) and `basis` as in `Hybrid`.

    Raises as `Hybrid` does.
    """

    called = "von Karman"
    neglects = Neglects(deflection=1.0)
    n_stretch: int = eqx.field(static=True, default=16)
    n_in_plane: int = eqx.field(static=True, default=8)
    n_flap: int = eqx.field(static=True, default=8)

    @classmethod
    def of_size(cls, n: int, rotor: Rotor, planar: bool, n_stretch: int = 0) -> Self:
        """A model with n bending functions each way; functions of u1 follow u2'^2."""
        return super().of_size(n, rotor, planar, 2 * n + 1)

    @property
    def step_cost(self) -> float:
        return 2 * super().step_cost  # its strain is integrated

    @property
    def products(self) -> int:
        return 2 * max(self.counts)

    @property
    def stretch_follows(self) -> bool:
        return False  # u1 follows u2'^2

    def tension(self, rotor: Rotor, profile: Profile, speed: Scalar) -> Array:
        return tension(profile, rotor, speed, rounds=6)

    def equations(self, rotor: Rotor) -> CartesianEquations:
        """U = int EA (u1' + (u2'^2 + u3'^2) / 2)^2 + EI_zz u2''^2 + EI_yy u3''^2 dx / 2."""
        beam, shapes = rotor.beam, self.shapes(rotor)
        if shapes is None or not rotor.varies:
            xi, weight = self.basis.quadrature(self.products)
            stiffness, along_it = beam.axial_stiffness, jnp.asarray(weight)
            slope: Any = all_functions(self.basis, self.counts, xi).slope
        else:
            slope, stiffness = shapes.at.slope, beam.mean.axial_stiffness
            along_it = shapes.span.weight * on(beam.axial_stiffness, shapes.span) / stiffness
        is_bending = self.one_hot[:, 1:].sum(1)
        elastic = VonKarmanElasticity(
            bending=self.linear_stiffness(rotor, shapes) * np.outer(is_bending, is_bending),
            axial_stiffness=stiffness,
            length=beam.length,
            slope=jnp.asarray(slope),
            weight=along_it,
            one_hot=jnp.asarray(self.one_hot),
        )
        # Zero tension tables: the axial strain says how far points come nearer, but not the centre
        # of a body at the tip or mass off the axis, which do when sections turn.
        stiffened = (lambda t: jnp.zeros_like(t.tension)) if rotor.turns_mass else None
        return CartesianEquations.build(self, rotor, elastic, shapes, stiffened)
