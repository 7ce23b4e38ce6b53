"""Modal (Ritz) models of Yoo, Ryan and Scott (Y), linear about steady rotation.

With the hub turning at Omega about a3 and the beam along a1, Y eqs. 18-20 read, in words: inertia
of the relative acceleration in the turning frame, plus elastic stiffness, plus for bending the
stiffness of the tension P(x) that carries the undeformed beam round:

    rho (s''  - 2 Omega u2' - Omega^2 s)  - (EA s_x)_x                     = 0     stretch
    rho (u2'' + 2 Omega s'  - Omega^2 u2) + (EI_zz u2_xx)_xx - (P u2_x)_x  = 0     in plane
    rho  u3''                             + (EI_yy u3_xx)_xx - (P u3_x)_x  = 0     flap

(primes are time derivatives), with the tip mass as a point in the mass measure. The two theories
below differ in one thing: whether P is there.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._basis import (
    Basis,
    Integrals,
    Polynomials,
    bending_integrals,
    coupling_integral,
    stretch_integrals,
)
from jaxbeam._beam import Rotor
from jaxbeam._models.base import (
    AbstractModel,
    Family,
    LinearSystem,
    count_functions,
    inertia,
    tension_stiffness,
)
from jaxbeam._status import Status
from jaxbeam._types import Matrix, Scalar


class _Modal(AbstractModel):
    """Ritz coordinates q in metres: s = psi.q_s, u2 = phi.q_2, u3 = phi.q_3, in this order."""

    n_stretch: int = eqx.field(static=True, default=10)
    n_in_plane: int = eqx.field(static=True, default=16)
    n_flap: int = eqx.field(static=True, default=16)
    basis: Basis = eqx.field(static=True, default=Polynomials())

    def __check_init__(self) -> None:
        for name in ("n_stretch", "n_in_plane", "n_flap"):
            count_functions(name, getattr(self, name))
        if self.n_stretch + self.n_in_plane + self.n_flap == 0:
            raise ValueError("n_stretch, n_in_plane, n_flap: at least one must be > 0")
        if not isinstance(self.basis, Basis):
            raise TypeError(f"basis must be a Basis, got {type(self.basis).__name__}")

    @property
    def families(self) -> tuple[Family, ...]:
        """Stretch, then in plane, then flap."""
        return (
            (Family.AXIAL,) * self.n_stretch
            + (Family.IN_PLANE,) * self.n_in_plane
            + (Family.FLAP,) * self.n_flap
        )

    @abc.abstractmethod
    def motion_stiffness(self, f: Integrals, rotor: Rotor, speed: Scalar) -> Matrix:
        """Stiffness that the steady motion adds to bending, beside the inertia terms."""

    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        """Mass, gyroscopic and stiffness matrices (Y eqs. 18-20); coordinates in metres."""
        beam, length, tip_mass = rotor.beam, rotor.beam.length, rotor.tip_mass
        ns, n2, n3 = self.n_stretch, self.n_in_plane, self.n_flap
        size = ns + n2 + n3
        at_s, at_2, at_3 = slice(0, ns), slice(ns, ns + n2), slice(ns + n2, size)
        mass, gyroscopic, stiffness = (jnp.zeros((size, size), speed.dtype) for _ in range(3))
        if ns:
            f = stretch_integrals(self.basis, ns)
            own = inertia(rotor, f)
            elastic = beam.axial_stiffness / length * f.tension[0]
            mass = mass.at[at_s, at_s].set(own)
            stiffness = stiffness.at[at_s, at_s].set(elastic - speed**2 * own)
        for n, at, rigidity, centrifugal in (
            (n2, at_2, beam.in_plane_bending_stiffness, speed**2),
            (n3, at_3, beam.flap_bending_stiffness, 0.0),
        ):
            if n:
                f = bending_integrals(self.basis, n)
                own = inertia(rotor, f)
                elastic = rigidity / length**3 * f.curvature
                motion = self.motion_stiffness(f, rotor, speed)
                mass = mass.at[at, at].set(own)
                stiffness = stiffness.at[at, at].set(elastic + motion - centrifugal * own)
        if ns and n2:
            tips = np.outer(
                bending_integrals(self.basis, n2).tip, stretch_integrals(self.basis, ns).tip
            )
            coupling = beam.mass * coupling_integral(self.basis, n2, ns) + tip_mass * tips
            gyroscopic = gyroscopic.at[at_2, at_s].set(2 * speed * coupling)
            gyroscopic = gyroscopic.at[at_s, at_2].set(-2 * speed * coupling.T)
        # The tension is largest at the root: c_0 + c_1 + c_2 / 2.
        c0, c1, c2 = rotor.tension(speed)
        return LinearSystem(
            mass=mass,
            gyroscopic=gyroscopic,
            stiffness=stiffness,
            steady_strain=(c0 + c1 + c2 / 2) / beam.axial_stiffness,
            status=jnp.asarray(Status.OK),
            families=self.families,
        )

    def displacement(self, xi: Float[np.ndarray, " p"]) -> Float[Array, "3 p n"]:
        """To first order u1 = s: foreshortening (Y eq. 4) is of second order."""
        xi = np.asarray(xi, float)
        ns, n2, n3 = self.n_stretch, self.n_in_plane, self.n_flap
        out = np.zeros((3, xi.size, ns + n2 + n3))
        if ns:
            out[0, :, :ns] = self.basis.stretch(ns, xi).value
        if n2:
            out[1, :, ns : ns + n2] = self.basis.bending(n2, xi).value
        if n3:
            out[2, :, ns + n2 :] = self.basis.bending(n3, xi).value
        return jnp.asarray(out)


class Hybrid(_Modal):
    """Arc-length stretch and two Cartesian deflections: the method of Y.

    Stiffens as it must at any speed. The tension acts on the undeformed beam, so frequencies are
    right to first order in the steady strain: compare `ANCF` where that is not small.

    `n_stretch`, `n_in_plane`, `n_flap` functions of `basis`; zero leaves a direction out.
    `Hybrid(n_stretch=0)` is the inextensible (prestressed, bending-only) beam.
    """

    def motion_stiffness(self, f: Integrals, rotor: Rotor, speed: Scalar) -> Matrix:
        """int P(x) phi' phi'^T dx: the second and third lines of Y eqs. 19 and 20."""
        return tension_stiffness(rotor, speed, f)


class Classical(_Modal):
    """Classical linear Cartesian theory (C.L.C. of Y): no motion-induced stiffness.

    Offered because it is widely used and wrong: in plane it diverges at the first rest frequency
    of bending whatever the hub radius, and it never stiffens. Where its numbers may be trusted is
    where the tension is small against the bending stiffness.
    """

    def motion_stiffness(self, f: Integrals, rotor: Rotor, speed: Scalar) -> Matrix:
        """Zero: what this theory leaves out."""
        return jnp.zeros_like(f.mass)
