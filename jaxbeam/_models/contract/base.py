"""What every model offers to the rest of the package."""

import abc
from typing import Any, ClassVar, Generic, Self, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxbeam._checks import checked_speed, kind_of
from jaxbeam._models.contract.bands import BandTables, NodeByNode
from jaxbeam._models.contract.equations import Equations, Inputs
from jaxbeam._models.contract.equilibrium import Rest
from jaxbeam._models.contract.linear_system import LinearSystem
from jaxbeam._models.contract.supports import Neglects, check_supported
from jaxbeam._programs.program import Program
from jaxbeam._results import finish, harmless, nan_unless
from jaxbeam._rotor.beam import AnyRotor, Beam, Rotor
from jaxbeam._rotor.checked import checked_rotor
from jaxbeam._rotor.directions import ALL_COUPLED, CouplingGroup, Direction, coupling_groups
from jaxbeam._rotor.motion import spinning
from jaxbeam._rotor.spring_rotor import SpringRotor
from jaxbeam._status import Status, first_failure
from jaxbeam._types import Code, Real, Scalar, Vector, is_concrete

TheRotor = TypeVar("TheRotor", bound=AnyRotor)  # the kind of rotor that a model takes


class AbstractModel(eqx.Module, Generic[TheRotor]):
    """A theory with its discretisation. It holds no parameters of the beam, only static choices.

    A theory says what its `equations` are; frequencies, steady states and motions follow.
    """

    rotor_type: ClassVar[type[Rotor] | type[SpringRotor]] = Rotor
    # Names of what it knows beyond a plain rotor and a force at its tip, and of what it must have:
    # see `supports.py`. What derives from a model inherits all but `supports_in_matrices`.
    supports: ClassVar[frozenset[str]] = frozenset()
    supports_in_matrices: ClassVar[frozenset[str]] = frozenset()
    needs: ClassVar[frozenset[str]] = frozenset()
    # What the ladder asks. `called` is of the class itself, the name of the theory in words.
    called: ClassVar[str]
    couples_all: ClassVar[bool] = False  # whether anything may be coupled with anything
    is_linear: ClassVar[bool] = False  # whether its equations of motion are
    step_tolerance: ClassVar[float] = 1e-6  # of steps in time, relative, where none is given
    # Whether it converges to the exact rod of the engineering strain, to which errors refer; what
    # derives from such a model does not by that.
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

    @property
    def sizes(self) -> tuple[int, int]:
        """Numbers of coordinates and of velocities of a motion in time."""
        return len(self.directions), len(self.directions)

    def in_motion(self, rotor: TheRotor) -> tuple[Self, TheRotor]:
        """Model and rotor as a motion in time wants them."""
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
        system = _linearised(*checked_case(self, rotor, angular_speed))
        return finish(system, throw)

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
        """Which directions of small motion about steady rotation are coupled."""
        return ALL_COUPLED if self.couples_all else coupling_groups(rotor)

    def suited(self, rotor: TheRotor) -> Self:
        """A model of the same theory and size with a root that yields where that of the rotor does.

        Functions that take a model and a rotor begin with that.
        """
        return self

    def at_speed(self, rotor: TheRotor, speed: Any) -> Self:
        """The model with functions that follow a rotor at this speed (rad/s), the largest of
        several, where numbers are known and how many functions there are is not its user's own."""
        return self

    def judged(self, rotor: TheRotor) -> bool:
        """Whether too few functions are a failure: how many are enough is not its user's to say."""
        return isinstance(rotor, Rotor) and rotor.varies

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
        """What functions and quadrature leave out of frequencies, relative: see `Modes`. None where
        that is not estimated."""
        return None

    def mixes(self, system: LinearSystem, rotor: TheRotor) -> Any:
        """What functions on a beam that varies are made of, where `forms` are known of them; else
        None."""
        return None

    def forms(
        self, rotor: TheRotor, speed: Scalar, shape: Array, mixes: Any
    ) -> tuple[Array, Array, Array]:
        """x^T M x, x^T G x and x^T K x of shapes, by which eigenvalues have derivatives for less
        than by matrices: where `mixes` are known."""
        raise NotImplementedError

    def bands(self) -> BandTables | NodeByNode | None:
        """How matrices of small motion are bands, which makes `modes` fast; None: they are not.

        Whoever derives from a model need not think of this: tables are for a class itself alone.
        """
        return None


def small_motion(
    model: AbstractModel, rotor: AnyRotor, speed: Scalar, equations: Equations,
    state: Rest, inputs: Inputs | None = None,
) -> LinearSystem:  # fmt: skip
    """Matrices of small motion about a steady state under `inputs`, none by default but rotation:
    the tangents of the equations there."""
    hub, *acting = (spinning(speed), None, None) if inputs is None else inputs
    q, status, matrices, lacking, taken_along = state
    if matrices is None:
        matrices = equations.matrices_about(hub, q, *acting)
    mass, by_rates, stiffness = matrices
    return LinearSystem(
        mass=mass,
        gyroscopic=by_rates,
        stiffness=stiffness,
        steady_strain=steady_strain(rotor, speed, equations, q),
        status=status,
        directions=model.directions,
        coupling=model.coupling(rotor),
        shapes=equations.functions,
        lacking=lacking,
        taken_along=taken_along,
        general=model.couples_all,
    )


def checked_model(model: Any) -> AbstractModel:
    """The argument, if it is a model; else an error that says what is."""
    if not isinstance(model, AbstractModel):
        raise TypeError(f"model must be a model, such as jaxbeam.Hybrid(), got {kind_of(model)}")
    if any(isinstance(leaf, jax.Array | np.ndarray) for leaf in jax.tree.leaves(model)):
        raise TypeError(
            f"model: {kind_of(model)} holds an array, and a model holds static choices alone: make "
            "it a Python number, for which programs are compiled anew, or a parameter of the rotor"
        )
    return model


def checked_case(
    model: Any, rotor: Any, angular_speed: Any = 0.0
) -> tuple[AbstractModel[Any], Any, Scalar]:
    """A model as it suits a rotor at an angular speed, the rotor that it takes, and the speed, all
    checked.

    Public functions begin with that: rotors that a model does not know are refused here.
    """
    rotor = checked_rotor(checked_model(model).rotor_type, rotor)
    model = model.suited(rotor)
    check_supported(model, rotor, moving=False)
    speed = checked_speed(angular_speed)
    return model.at_speed(rotor, speed), rotor, speed


def fastest(speeds: Any) -> Any:
    """The largest of several speeds, as far as they are known and finite."""
    values = np.asarray(speeds, float) if is_concrete(speeds) else np.zeros(0)
    return np.max(np.abs(values[np.isfinite(values)]), initial=0.0)


def steady_strain(rotor: AnyRotor, speed: Scalar, equations: Equations, q: Vector) -> Scalar:
    """The largest axial strain of a steady state: at the root of a uniform beam; of one that varies
    P / EA, since functions that are smooth do not follow its steps."""
    if isinstance(rotor, Rotor) and rotor.varies and isinstance(rotor.beam, Beam):
        return rotor.steady_strain(speed)
    return equations.strain(q, np.zeros(1))[0]


@Program
def _linearised(model: AbstractModel, rotor: Rotor, speed: Scalar) -> LinearSystem:
    system = guarded_matrices(model, rotor, speed)
    matrices = (system.mass, system.gyroscopic, system.stiffness)
    kept = nan_unless(system.status == Status.OK, (*matrices, system.state))
    return eqx.tree_at(
        lambda s: (s.mass, s.gyroscopic, s.stiffness, s.state), system, kept,
        is_leaf=lambda leaf: leaf is None,
    )  # fmt: skip


def guarded_matrices(model: AbstractModel, rotor: Rotor, speed: Scalar) -> LinearSystem:
    """`model.matrices`, with parameters out of range reported in `status`."""
    given, rotor, speed = guarded(rotor, speed)
    system = model.matrices(rotor, speed)
    status = first_failure(given, system.status)
    strain = nan_unless(status == Status.OK, system.steady_strain)
    return eqx.tree_at(lambda s: (s.status, s.steady_strain), system, (status, strain))


def guarded(rotor: TheRotor, speed: Scalar) -> tuple[Code, TheRotor, Scalar]:
    """Whether parameters are in range, and harmless ones in the place of those that are not.

    A NaN in one lane of a batch would otherwise end up in the gradient of parameters that all lanes
    share.
    """
    given = rotor.status(speed)
    fine = given == Status.OK
    return given, harmless(fine, rotor), jnp.where(fine, speed, 0.0)
