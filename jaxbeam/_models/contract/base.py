"""What every model offers to the rest of the package."""

import abc
from typing import Any, ClassVar, Generic, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._checks import checked_speed, kind_of
from jaxbeam._models.contract.bands import BandTables, NodeByNode
from jaxbeam._models.contract.equations import Equations
from jaxbeam._models.contract.equilibrium import Rest
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.contract.small_motion import TheRotor, linearised, small_motion
from jaxbeam._models.contract.supports import Neglects, check_supported
from jaxbeam._results import finish
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.checked import checked_rotor
from jaxbeam._rotor.directions import ALL_COUPLED, CouplingGroup, Direction, coupling_groups
from jaxbeam._rotor.motion import spinning
from jaxbeam._rotor.spring_rotor import SpringRotor
from jaxbeam._types import Code, Real, Scalar, Vector


class AbstractModel(eqx.Module, Generic[TheRotor]):
    """A theory with its discretisation. It holds no parameters of the beam, only static choices.

    A theory says what its `equations` are; frequencies, steady states and motions follow.
    """

    rotor_type: ClassVar[type[Rotor] | type[SpringRotor]] = Rotor
    # Names of features that the model knows, beyond a plain rotor with a force at its tip, and of
    # those that it needs: see `supports.py`. Subclasses inherit all but `supports_in_matrices`.
    supports: ClassVar[frozenset[str]] = frozenset()
    supports_in_matrices: ClassVar[frozenset[str]] = frozenset()
    needs: ClassVar[frozenset[str]] = frozenset()
    # Class variables for the ladder; `called` is the name of the theory in words, not inherited.
    called: ClassVar[str]
    couples_all: ClassVar[bool] = False  # whether any two directions may be coupled, in any phase
    is_linear: ClassVar[bool] = False  # whether the equations of motion are linear
    step_tolerance: ClassVar[float] = 1e-6  # default relative tolerance of steps in time
    # Whether it converges to the exact rod of the engineering strain, to which errors refer. Not
    # inherited.
    is_reference: ClassVar[bool] = False
    neglects: ClassVar[Neglects] = Neglects()

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        cls.is_reference = vars(cls).get("is_reference", False)

    @property
    def title(self) -> str:
        """Theory and size in words."""
        return self._titled(f"{len(self.directions)} coordinates")

    def _titled(self, size: str) -> str:
        name = vars(type(self)).get("called", type(self).__name__)
        return f"{name}, {size}" if name else size

    @property
    def step_cost(self) -> float:
        """Cost of a step in time in a batch on one core, in us, roughly; times the number of steps
        over those of linear motion."""
        return 2 + len(self.directions) ** 2 / 30

    @property
    @abc.abstractmethod
    def directions(self) -> tuple[Direction, ...]:
        """Direction of each of the n coordinates."""

    def slow_modes(self, rotor: TheRotor, count: int) -> int:
        """The number of modes of a rotor, of so many, that a speed that varies may move: all,
        unless the highest are of what stands for something rigid."""
        return count

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of coordinates and of velocities of a motion in time."""
        return len(self.directions), len(self.directions)

    def in_motion(self, rotor: TheRotor) -> tuple[Self, TheRotor]:
        """The model and the rotor in the form that a motion in time takes."""
        return self, rotor

    @abc.abstractmethod
    def equations(self, rotor: TheRotor) -> Equations:
        """Equations of motion of a `rotor` whose parameters are in range."""

    @abc.abstractmethod
    def displacement(self, xi: Float[np.ndarray, " p"], rotor: TheRotor) -> Float[Array, "3 p n"]:
        """Axial, in-plane and flap displacement of a rotor's beam at x = xi L per unit of each
        coordinate."""

    def torsion(self, xi: Float[np.ndarray, " p"], rotor: TheRotor) -> Float[Array, "p n"]:
        """Angle of torsion at x = xi L per unit of each coordinate, in rad over the length."""
        return jnp.zeros((len(xi), len(self.directions)))

    def linearise(
        self, rotor: TheRotor, angular_speed: Real, *, throw: bool = True
    ) -> LinearSystem:
        """Matrices of small motion about steady rotation at `angular_speed` (rad/s, any sign).

        `rotor` is one that the model takes; `throw=False` leaves failures in `LinearSystem.status`.

        Raises as `jaxbeam.modes` does.
        """
        return finish(linearised(*self.with_case(rotor, angular_speed)), throw)

    def with_case(self, rotor: Any, angular_speed: Any) -> tuple["AbstractModel[Any]", Any, Scalar]:
        """The model as it suits a rotor at an angular speed, the rotor that it takes, and the
        speed, all checked: rotors that it does not know are refused here."""
        _refuse_arrays(self)
        rotor = checked_rotor(self.rotor_type, rotor)
        model = self.suited(rotor)
        check_supported(model, rotor, moving=False)
        speed = checked_speed(angular_speed)
        return model.at_speed(rotor, speed), rotor, speed

    def matrices(self, rotor: TheRotor, speed: Scalar) -> LinearSystem:
        """`linearise` for parameters in range: tangents of the equations at their equilibrium.

        `status` is that of the search for the steady state, if there is one.
        """
        state = Rest(*self.steady(rotor, speed))
        return small_motion(self, rotor, speed, self.equations(rotor), state)

    def steady(self, rotor: TheRotor, speed: Scalar) -> tuple[Vector, Code]:
        """Coordinates of steady rotation, for parameters in range, and the status of the search."""
        return self.equations(rotor).equilibrium(spinning(speed))[:2]

    def coupling(self, rotor: TheRotor) -> tuple[CouplingGroup, ...]:
        """The groups of directions that small motion about steady rotation couples."""
        return ALL_COUPLED if self.couples_all else coupling_groups(rotor)

    def suited(self, rotor: TheRotor) -> Self:
        """A model of the same theory and size with a root that yields where that of the rotor does.

        Functions that take a model and a rotor begin with that.
        """
        return self

    def at_speed(self, rotor: TheRotor, speed: Any) -> Self:
        """The model with functions chosen for this speed (rad/s), the largest of several, if speed
        and rotor are not traced and the user has set no number of functions; else unchanged."""
        return self

    def judged(self, rotor: TheRotor) -> bool:
        """Whether too few functions are a failure, as where the user has not chosen their
        number."""
        return rotor.varies

    def most_error(self, rotor: TheRotor, speed: Scalar) -> Any:
        """The largest `frequency_error`, relative, that is no failure of a model that is judged."""
        return 1e-3

    def resolves(self, rotor: TheRotor, speed: Scalar) -> Bool[Array, ""]:
        """Whether functions that nobody has chosen can follow a beam that turns as fast as this, to
        some 1e-3 of its frequencies: for runs, which have no estimate."""
        return jnp.ones((), bool)

    def frequency_error(
        self, system: LinearSystem, rotor: TheRotor, speed: Scalar, eigenvalue: Array, shape: Array
    ) -> Float[Array, " k"] | None:
        """The relative error of frequencies by lack of functions and by quadrature: see `Modes`.
        None where that is not estimated."""
        return None

    def mixes(self, system: LinearSystem, rotor: TheRotor) -> Any:
        """Combinations of loads that functions on a beam that varies are made of; None where
        `forms` are not known of them."""
        return None

    def forms(
        self, rotor: TheRotor, speed: Scalar, shape: Array, mixes: Any
    ) -> tuple[Array, Array, Array]:
        """The forms x^T M x, x^T G x and x^T K x of shapes x, the rows of `shape`. Derivatives of
        eigenvalues by these cost less than by matrices. Asked for only where `mixes` is not None.
        """
        raise NotImplementedError

    def bands(self) -> BandTables | NodeByNode | None:
        """The bands that matrices of small motion are, which make `modes` fast; None where they are
        not.

        Whoever derives from a model need not think of this: tables are for a class itself alone.
        """
        return None


def _refuse_arrays(model: AbstractModel[Any]) -> None:
    if any(isinstance(leaf, jax.Array | np.ndarray) for leaf in jax.tree.leaves(model)):
        raise TypeError(
            f"model: {kind_of(model)} holds an array, and a model holds static choices alone: make "
            "it a Python number, for which programs are compiled anew, or a parameter of the rotor"
        )
