"""Second-order systems, as solvers see them."""

import abc
from typing import Any, get_origin

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._numerics.kinematics import Kinematics, Straight
from jaxbeam._numerics.linalg import inverse
from jaxbeam._numerics.small import SmallMatrix
from jaxbeam._results import without_derivatives
from jaxbeam._types import Coordinates, Matrix, Number, Scalar, Vector


class State(eqx.Module):
    """The state that is integrated: coordinates `q`, velocities `v`, and an integral along the way,
    `work`.

    `q` (n,) in m and `v` (m,) in m/s are those of a model (the angle of the polar discrete models
    in rad), the rates of q, but of rods (`SpatialRod`), whose velocities are in axes that turn with
    their nodes; of a history or a batch they have further axes in front. `work`, a scalar, zero
    unless it is given, is carried by the solver like a coordinate and acts on nothing. Beam models
    keep in it what changes their Jacobi integral (see `Scene`), in units of EI / L^2, so that it is
    a length like q.
    """

    q: Float[Array, "..."]  # (n,), and of a history or a batch further axes in front
    v: Float[Array, "..."]  # (m,)
    work: Float[Array, "..."]

    def __init__(self, q: Array, v: Array, work: Array | None = None) -> None:
        self.q, self.v = q, v
        self.work = jnp.zeros((), jnp.result_type(float)) if work is None else work


class SecondOrderSystem(eqx.Module):
    """The system M v' = force(x, q, v), q' = kinematics(q, v), work' = power(x, q, v), x =
    inputs(t), with constant M; by default q' = v.

    `State.work` carries no derivatives by parameters: it is there to judge a result.

    Subclass it, pass an instance as `args` and its `term(solver)` as `terms` to
    `diffrax.diffeqsolve`: every diffrax solver takes it as a first-order system; `Rodas5P`,
    `Rodas4P` and `ChordKvaerno5` use its structure, `Magnus` too where it is linear.
    """

    mass: eqx.AbstractVar[Matrix | BlockTridiagonal | SmallMatrix]

    @property
    def is_linear(self) -> bool:
        """Whether `force` is linear in q and v, at any time."""
        return False

    @property
    def kernel(self) -> "SecondOrderSystem | None":
        """The part of this system without `inputs`, if force, tangents and power suit `kernel`; its
        arrays must be its leaves. By default None."""
        return None

    def inputs(self, t: Scalar) -> Any:
        """All that depends on time alone, a pytree of floating-point arrays; by default, t itself.

        Solvers compute it for all stages of a step at once.
        """
        return t

    @abc.abstractmethod
    def force(self, x: Any, q: Coordinates, v: Vector) -> Vector:
        """Right-hand side, under the inputs x."""

    def kinematics(self, q: Coordinates, v: Vector) -> Coordinates:
        """The rates q' of coordinates, linear in v."""
        return v

    def stage_kinematics(self, q: Coordinates, v: Vector, g: Number) -> Kinematics:
        """The kinematics that a stage asks for, g being its share of the step, in s."""
        return Straight(g)

    def power(self, x: Any, q: Coordinates, v: Vector) -> Number:
        """Rate of `State.work`."""
        return jnp.zeros((), q.dtype)

    def tangents(self, x: Any, q: Coordinates, v: Vector) -> tuple[Any, Any]:
        """The tangents K = -d force / dq and C = -d force / dv, of the kind of `mass`; K by the
        small changes of which velocities are the rates."""
        k, c = jax.jacfwd(self.force, argnums=(1, 2))(x, q, v)
        return -k, -c

    def acceleration(self, t: Scalar, q: Coordinates, v: Vector) -> Vector:
        """The accelerations v'. Subclasses that keep the inverse of M save its computation."""
        return inverse(self.mass) @ self.force(self.inputs(t), q, v)

    def rate(self, t: Scalar, y: State) -> State:
        """The rate of the whole state: the system as one of first order."""
        q, v = y.q, y.v
        return State(self.kinematics(q, v), self.acceleration(t, q, v), work_rate(self, t, q, v))

    @staticmethod
    def term(solver: diffrax.AbstractSolver) -> diffrax.AbstractTerm:
        """The term of diffrax for any system that is given as `args`, as `solver` takes it.

        `solver` is any of diffrax, or of `jaxbeam.solvers`: implicit-explicit ones
        (`diffrax.KenCarp4` and others) get all of the system as the implicit part.

        Raises `AttributeError` for what is no solver; the term, `TypeError` for any other `args`.
        """
        term = diffrax.ODETerm(_rate)
        if get_origin(solver.term_structure) is diffrax.MultiTerm:
            return diffrax.MultiTerm(diffrax.ODETerm(_nothing), term)
        return term


def work_rate(system: SecondOrderSystem, t: Scalar, q: Coordinates, v: Vector) -> Scalar:
    """`system.power` without derivatives, which nobody asks for and which cost compilation."""
    system, t, q, v = without_derivatives((system, t, q, v))
    return system.power(system.inputs(t), q, v)


def _rate(t: Any, y: State, args: SecondOrderSystem) -> State:
    if not isinstance(args, SecondOrderSystem):
        raise TypeError(f"args must be a SecondOrderSystem, got {type(args).__name__}")
    return args.rate(t, y)


def _nothing(t: Any, y: State, args: SecondOrderSystem) -> State:
    return jax.tree.map(jnp.zeros_like, y)
