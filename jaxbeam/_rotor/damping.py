"""Damping by material and inertia, by ratios of modes, and by dampers at root and tip."""

from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._checks import check_all, real_array, real_scalar, shaped_array
from jaxbeam._results import replaced
from jaxbeam._rotor.directions import Direction
from jaxbeam._status import Status
from jaxbeam._types import Real, Scalar

Ratios = Real | Sequence[Real] | None  # one for all modes of a direction, or by number of the mode


class Damping(eqx.Module):
    """Damping of a material, of a motion, of modes and of the root; none by default.

    | field                 | symbol | unit  |                                                 |
    |-----------------------|--------|-------|-------------------------------------------------|
    | mass_coefficient      | a      | 1/s   | in proportion to inertia                        |
    | stiffness_coefficient | c      | s     | in proportion to stiffness, as in a material    |
    | in_plane_ratio        | zeta   |       | () or (m,), of modes in plane (lag)             |
    | flap_ratio            | zeta   |       | () or (m,), of modes in flap                    |
    | axial_ratio           | zeta   |       | () or (m,), of axial modes                      |
    | ratio_speed           |        | rad/s | at which these are the modes, 0 unless given    |
    | in_plane_damper       | d      | N m s | at the root, parallel to the spring in plane    |
    | flap_damper           | d      | N m s | at the root, parallel to the spring in flap     |
    | section_coefficients  | mu     | s     | (6,) of a material, by strains of full sections |
    | root_dampers          | d      | SI    | (6,), parallel to the springs of a root_support |
    | tip_dampers           | d      | SI    | (6,), parallel to the springs of a tip_support  |

    All are finite and, but for the speed, >= 0; None leaves a term out, and all terms add up.

    **Coefficients** do the forces -(a dT/dq' + c B^T D B q'): a mode of frequency w at rest has the
    damping ratio (a / w + c w) / 2. T is the kinetic energy seen from the hub, B is d strain/dq and
    D the stiffness of the strains: c stands for the damping of a material (Kelvin and Voigt), with
    stresses EA eps', EI kappa' and GJ k_1' beside those of elasticity, and takes twice the energy
    of the rates of strain. So rigid motion is not damped, nor is stress that only turns with the
    beam, however large: with phi^T M phi = 1 a mode decays at the rate c phi^T K phi / 2, K the
    stiffness without what tension adds to it. In theories that are linear B^T D B is K. The springs
    of a root, and of the discrete models, are such a material, too.

    **Ratios** are those that are measured: of the first mode of a direction, of the second and so
    on; the last one, or the only one, is that of all higher modes, so that a zero at the end leaves
    these undamped. They do the forces -C q',

        C = M Phi diag(2 zeta w) Phi^T M,   K Phi = M Phi diag(w^2),   Phi^T M Phi = 1,

    where M and K are the matrices of small motion about steady rotation at `ratio_speed`, without
    loads. There each mode has the growth rate -zeta w, exactly, where Coriolis forces do not couple
    it (at rest, or without stretch); at other speeds and under loads C stays what it is, as the
    damping of a material does. Where pitch or twist couple flap and lag a mode has the direction
    and number that `modes` would give it. Where a mode with a ratio diverges at `ratio_speed` the
    case fails.
    Theories that are linear alone have modes that last: `Hybrid`, `Classical`, and of `jb.models`
    `SmallStrainANCF`, `DiscreteLC` and `DiscreteLP`. All others refuse ratios by name.

    **Dampers** do the moment -d phi' in a root that yields, phi being the angle of the root, of
    which the `RootSprings` have the energy k phi^2 / 2: a rigid blade with the moment of inertia I
    about its hinge has the ratio d / (2 (k I)^(1/2)). Those of a `Support` are six, three in N s/m
    along its axes and three in N m s about them, zero where there is none, with the force -d s' on
    s = a_k . u or a_k . phi. Where an end is held rigidly they are refused, and by models that have
    no such end.

    **Of sections.** Forces and moments in a section beside those of elasticity are mu_i (K e')_i in
    its own axes, K its stiffness of 6 x 6 and e' the rates of its strains, in the order of a
    `Blade`: mu_1 of stretch, mu_2 and mu_3 of shear, mu_4 of torsion, mu_5 of bending in flap and
    mu_6 in plane. That is how BeamDyn has it, whose coefficients `BladeTable.damping` are. Six that
    are equal do what c does, but for springs of the root. Where K couples what has unequal mu (also
    by offsets of centres) mu K is not symmetric: it may then feed some motion with energy, which
    growth rates of `modes` show. `SpatialRod` knows it, and no other model.

    Raises `TypeError` for what is no real number, and `ValueError` for what is not allowed.
    """

    mass_coefficient: Scalar | None
    stiffness_coefficient: Scalar | None
    in_plane_ratio: Float[Array, "*m"] | None
    flap_ratio: Float[Array, "*m"] | None
    axial_ratio: Float[Array, "*m"] | None
    ratio_speed: Scalar | None
    in_plane_damper: Scalar | None
    flap_damper: Scalar | None
    section_coefficients: Float[Array, "6"] | None
    root_dampers: Float[Array, "6"] | None
    tip_dampers: Float[Array, "6"] | None

    def __init__(
        self, mass_coefficient: Real | None = None, stiffness_coefficient: Real | None = None, *,
        in_plane_ratio: Ratios = None, flap_ratio: Ratios = None, axial_ratio: Ratios = None,
        ratio_speed: Real | None = None,
        in_plane_damper: Real | None = None, flap_damper: Real | None = None,
        section_coefficients: Sequence[Real] | None = None,
        root_dampers: Sequence[Real] | Array | None = None,
        tip_dampers: Sequence[Real] | Array | None = None,
    ) -> None:  # fmt: skip
        self.mass_coefficient = _taken(real_scalar, "mass_coefficient", mass_coefficient)
        self.stiffness_coefficient = _taken(
            real_scalar, "stiffness_coefficient", stiffness_coefficient
        )
        self.in_plane_ratio = _taken(_ratios, "in_plane_ratio", in_plane_ratio)
        self.flap_ratio = _taken(_ratios, "flap_ratio", flap_ratio)
        self.axial_ratio = _taken(_ratios, "axial_ratio", axial_ratio)
        self.ratio_speed = _taken(real_scalar, "ratio_speed", ratio_speed, np.isfinite)
        self.in_plane_damper = _taken(real_scalar, "in_plane_damper", in_plane_damper)
        self.flap_damper = _taken(real_scalar, "flap_damper", flap_damper)
        self.section_coefficients = _taken(_sections, "section_coefficients", section_coefficients)
        self.root_dampers = _taken(_support, "root_dampers", root_dampers)
        self.tip_dampers = _taken(_support, "tip_dampers", tip_dampers)

    @property
    def ratios(self) -> dict[Direction, Array]:
        """Damping ratios, by direction, of the directions that have any."""
        every = {
            Direction.AXIAL: self.axial_ratio, Direction.IN_PLANE: self.in_plane_ratio,
            Direction.FLAP: self.flap_ratio,
        }  # fmt: skip
        return {direction: ratio for direction, ratio in every.items() if ratio is not None}

    @property
    def dampers(self) -> tuple[Scalar | None, Scalar | None]:
        """Dampers of the root, in plane and in flap."""
        return self.in_plane_damper, self.flap_damper

    @property
    def are_none(self) -> bool:
        """Whether nothing is damped."""
        return not self.features and self.mass_coefficient is self.stiffness_coefficient is None

    @property
    def features(self) -> tuple[str, ...]:
        """The features that a model has to know, beyond the coefficients."""
        names = (
            "in_plane_ratio", "flap_ratio", "axial_ratio", "in_plane_damper", "flap_damper",
            "section_coefficients",
            "root_dampers", "tip_dampers",
        )  # fmt: skip
        return tuple(f"damping.{name}" for name in names if getattr(self, name) is not None)


def _none_negative(numbers: np.ndarray) -> Any:
    return np.isfinite(numbers) & (numbers >= 0)


def _taken(
    array: Callable[[str, Any], Array], name: str, value: Any,
    holds: Callable[[np.ndarray], Any] = _none_negative,
) -> Array | None:  # fmt: skip
    """An argument that may be left out, as an array whose numbers are in range."""
    if value is None:
        return None
    numbers = array(f"damping.{name}", value)
    check_all(Status.INVALID_DAMPING, numbers, holds)
    return numbers


def _ratios(name: str, value: Any) -> Array:
    ratios = real_array(name, value)
    if ratios.ndim > 1 or not ratios.size:
        raise ValueError(
            f"{name} must be a number, or a list of them by the numbers of the modes, got shape "
            f"{ratios.shape}"
        )
    return ratios


def _sections(name: str, value: Any) -> Array:
    return shaped_array(name, value, (6,), ", in the order of sixes of a Blade")


def _support(name: str, value: Any) -> Array:
    meaning = ", along three axes and about them, zero where there is none"
    return shaped_array(name, value, (6,), meaning)


def damping_in_range(damping: Damping) -> Array:
    """Whether all numbers of a damping are finite and, except the speed, not negative."""
    speed = jnp.zeros(()) if damping.ratio_speed is None else damping.ratio_speed
    others = jax.tree.leaves(replaced(damping, ratio_speed=None))
    every = jnp.concatenate([jnp.abs(speed)[None], *map(jnp.ravel, others)])
    return jnp.all(jnp.isfinite(every) & (every >= 0))


NO_DAMPING = Damping()  # the default of public functions
