"""What every model offers to the rest of the package."""

import abc
import enum
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._basis import Integrals
from jaxbeam._beam import Rotor, steady_case
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Matrix, Real, Scalar


class Family(enum.IntEnum):
    """Which way a coordinate or a mode moves."""

    IN_PLANE = 0
    FLAP = 1
    AXIAL = 2

    @property
    def title(self) -> str:
        return ("in-plane bending", "flap bending", "axial")[self]


class Label(NamedTuple):
    """Name of a mode: its family, and its number within the family, from 1."""

    family: Family
    order: int

    def __str__(self) -> str:
        return f"{self.family.title} {self.order}"


def labels(*, in_plane: int = 0, flap: int = 0, axial: int = 0) -> tuple[Label, ...]:
    """Labels of the first modes of each family: `labels(in_plane=2, flap=1)` is three labels."""
    counts = {Family.IN_PLANE: in_plane, Family.FLAP: flap, Family.AXIAL: axial}
    return tuple(Label(f, k + 1) for f, count in counts.items() for k in range(count))


class LinearSystem(eqx.Module):
    """Small motion about steady rotation: mass q'' + gyroscopic q' + stiffness q = 0.

    `mass` is symmetric positive definite, `gyroscopic` skew, `stiffness` symmetric; its unit is
    N/m when coordinates are metres. In-plane and axial coordinates are coupled by `gyroscopic`
    alone, flap coordinates are coupled to neither: true of a straight beam that turns in its
    plane, and what the eigensolver builds on. `families` names the direction of each coordinate.
    `steady_strain` is the axial strain at the root, the largest of the steady state, without
    unit: that of the steady state in `ANCF`, elsewhere the estimate P(0) / EA from the tension on
    the undeformed beam.
    """

    mass: Matrix
    gyroscopic: Matrix
    stiffness: Matrix
    steady_strain: Scalar
    status: Code
    families: tuple[Family, ...] = eqx.field(static=True)

    def where(self, *families: Family) -> np.ndarray:
        """Indices of the coordinates of these families, in the order of the families given."""
        found = [np.flatnonzero([f == g for g in self.families]) for f in families]
        return np.concatenate(found) if found else np.zeros(0, int)


class AbstractModel(eqx.Module):
    """A theory with its discretisation. It holds no parameters of the beam, only static choices."""

    @property
    @abc.abstractmethod
    def families(self) -> tuple[Family, ...]:
        """Direction of each of the n coordinates."""

    def linearise(self, rotor: Rotor, angular_speed: Real, *, throw: bool = True) -> LinearSystem:
        """Matrices of small motion about steady rotation at `angular_speed` (rad/s, any sign).

        `throw=False` leaves failures in `LinearSystem.status` instead of raising.
        """
        system = _linearised(self, *steady_case(rotor, angular_speed))
        return raise_unless_ok(system, system.status) if throw else system

    @abc.abstractmethod
    def matrices(self, rotor: Rotor, speed: Scalar) -> LinearSystem:
        """`linearise` for parameters in range: what a theory has to say.

        `status` is that of the search for the steady state, if there is one.
        """

    @abc.abstractmethod
    def displacement(self, xi: Float[np.ndarray, " p"]) -> Float[Array, "3 p n"]:
        """Axial, in-plane and flap displacement at x = xi L per unit of each coordinate."""


def inertia(rotor: Rotor, f: Integrals) -> Matrix:
    """int f f^T dm over beam and tip mass, in kg."""
    return rotor.beam.mass * f.mass + rotor.tip_mass * np.outer(f.tip, f.tip)


def tension_stiffness(rotor: Rotor, speed: Scalar, f: Integrals) -> Matrix:
    """int P f' f'^T dx of the tension P on the undeformed beam (`Rotor.tension`), in N/m."""
    return jnp.tensordot(jnp.stack(rotor.tension(speed)) / rotor.beam.length, f.tension, 1)


@eqx.filter_jit
def _linearised(model: AbstractModel, rotor: Rotor, speed: Scalar) -> LinearSystem:
    return guarded_matrices(model, rotor, speed)


def guarded_matrices(model: AbstractModel, rotor: Rotor, speed: Scalar) -> LinearSystem:
    """`model.matrices`, with parameters out of range reported in `status`.

    They are replaced by harmless ones: a NaN in one lane of a batch would otherwise end up in the
    gradient of parameters that all lanes share.
    """
    given = rotor.status(speed)
    fine = given == Status.OK
    rotor = jax.tree.map(lambda leaf: jnp.where(fine, leaf, 1.0), rotor)
    system = model.matrices(rotor, jnp.where(fine, speed, 0.0))
    status = jnp.where(fine, system.status, given)
    strain = jnp.where(status == Status.OK, system.steady_strain, jnp.nan)
    return eqx.tree_at(lambda s: (s.status, s.steady_strain), system, (status, strain))


def count_functions(name: str, value: int, least: int = 0) -> None:
    """Raise unless `value` is a whole number of functions or elements, at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"{name} must be an int, got {type(value).__name__}")
    if value < least:
        raise ValueError(f"{name} must be >= {least}, got {value}")
