"""How coordinates go with velocities within one stage of a linearly implicit method.

Where q' = kinematics(q, v), a stage asks for the change u of the coordinates that goes with the
change z of the velocities,

    u / g - A u - B z = f,   A = d kinematics / dq,   B = d kinematics / dv,

so u = D (f + B z) with D = (1 / g - A)^-1. Forces change by -K N u: tangents K are by small changes
of nodes, and N makes these of changes of coordinates. D, B and N act node by node, so that they
cost little beside K.
"""

import abc
from typing import Any

import equinox as eqx
import jax
from jaxtyping import Array, Float

from jaxbeam._numerics.linalg import inverse
from jaxbeam._types import Coordinates, Vector


class Kinematics(eqx.Module):
    """The matrices D, B and N of a stage (see the module) in the state in which a step begins, and
    their transposes, for reverse mode."""

    @abc.abstractmethod
    def before(self, first: Coordinates) -> Coordinates:
        """The change of coordinates D f by rates f of these."""

    @abc.abstractmethod
    def rates(self, z: Vector) -> Coordinates:
        """The rates of coordinates B z by velocities z."""

    @abc.abstractmethod
    def seen(self, change: Coordinates) -> Vector:
        """The small changes of nodes N u, to which tangents refer, by a change u of coordinates."""

    @abc.abstractmethod
    def eliminated(self, stiffness: Any) -> Any:
        """The stiffness K N D B by changes of velocities, as a matrix of the kind of K."""

    @abc.abstractmethod
    def inverse(self, matrix: Any) -> Any:
        """The inverse of the matrix of a step, for products (`@`) with a few vectors from either
        side."""

    def led(self, z: Vector) -> Coordinates:
        """The change of coordinates D B z by velocities z."""
        return self.before(self.rates(z))

    def change(self, first: Coordinates, z: Vector) -> Coordinates:
        """The change of coordinates D (f + B z) by rates f and velocities z."""
        return self.before(first + self.rates(z))

    def before_back(self, to_change: Coordinates, like: Coordinates) -> Coordinates:
        """The product D^T a with the transpose of `before`; `like` is any vector of coordinates."""
        (out,) = jax.linear_transpose(self.before, like)(to_change)
        return out

    def led_back(self, to_change: Coordinates, like: Vector) -> Vector:
        """The product B^T D^T a with the transpose of `led`; `like` is any vector of velocities."""
        (out,) = jax.linear_transpose(self.led, like)(to_change)
        return out

    def seen_back(self, to_small: Vector, like: Coordinates) -> Coordinates:
        """The product N^T y with the transpose of `seen`; `like` is any vector of coordinates."""
        (out,) = jax.linear_transpose(self.seen, like)(to_small)
        return out


class Straight(Kinematics):
    """The kinematics q' = v of all models but rods: D is g, B and N are one."""

    g: Float[Array, "*lanes"]

    def before(self, first: Coordinates) -> Coordinates:
        return self.g * first

    def rates(self, z: Vector) -> Coordinates:
        return z

    def seen(self, change: Coordinates) -> Vector:
        return change

    def eliminated(self, stiffness: Any) -> Any:
        return self.g * stiffness

    def inverse(self, matrix: Any) -> Any:
        return inverse(matrix)

    def before_back(self, to_change: Coordinates, like: Coordinates) -> Coordinates:
        return self.g * to_change

    def led_back(self, to_change: Coordinates, like: Vector) -> Vector:
        return self.g * to_change

    def seen_back(self, to_small: Vector, like: Coordinates) -> Coordinates:
        return to_small
