"""What comes out of a simulation, computed when asked for."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._scene import Scene
from jaxbeam._solvers.system import State
from jaxbeam._status import in_range
from jaxbeam._types import Code, Scalar, Vector


class Simulation(eqx.Module):
    """What became of a scene: T times, n coordinates, p points.

    | field      | shape  | unit |                                                               |
    |------------|--------|------|---------------------------------------------------------------|
    | times      | (T,)   | s    | output times                                                  |
    | state      | (T, n) | m    | coordinates `q`, rates `v`, `work` (see `Scene`); NaN where   |
    |            |        |      | the run did not get (it failed, or an event ended it)         |
    | imbalance  | (T,)   |      | change of `jacobi_integral` less work, over its largest parts |
    | status     | ()     |      | `Status`                                                      |
    | end_time   | ()     | s    | the last output time that was reached                         |
    | solution   |        |      | the solution of diffrax: statistics, interpolation, events    |
    | scene      |        |      | what was simulated                                            |

    Everything else is computed when asked for. Displacements are in the hub frame, components
    axial, in plane, flap, from the undeformed place; points are given as xi = x / L.
    """

    times: Float[Array, " T"]
    state: State
    imbalance: Float[Array, " T"]
    status: Code
    end_time: Scalar
    solution: diffrax.Solution
    scene: Scene

    def displacement(self, xi: Any = 1.0) -> Float[Array, "T p 3"]:
        """Displacement of the points xi, in m."""
        return self._each(_displacement, *_points(xi))

    @property
    def tip(self) -> Float[Array, "T 3"]:
        """Displacement of the tip, in m."""
        return self.displacement()[:, 0]

    def strain(self, xi: Any = 0.0) -> Float[Array, "T p"]:
        """Axial strain of the centre line."""
        return self._each(_strain, *_points(xi))

    def curvature(self, xi: Any = 0.0) -> Float[Array, "T p 2"]:
        """In-plane and flap curvature, in 1/m: surface strain is the axial one less y times it."""
        return self._each(_curvature, *_points(xi))

    @property
    def strain_energy(self) -> Float[Array, " T"]:
        """In J."""
        return self._each(_strain_energy)

    @property
    def energy(self) -> Float[Array, " T"]:
        """Kinetic energy in the inertial frame plus strain energy, in J."""
        return self._each(Scene.total_energy)

    @property
    def jacobi_integral(self) -> Float[Array, " T"]:
        """Kinetic energy seen from the hub, centrifugal potential and strain energy, in J."""
        return self._each(_jacobi)

    @property
    def hub_force(self) -> Float[Array, "T 3"]:
        """Force of the hub on the beam, in N, hub axes."""
        return self._each(Scene.reaction)[0]

    @property
    def hub_torque(self) -> Float[Array, "T 3"]:
        """Moment of the hub on the beam about the centre of the hub, in N m, hub axes."""
        return self._each(Scene.reaction)[1]

    def peak(self, component: int = 1, xi: float = 1.0) -> tuple[Scalar, Scalar]:
        """Largest deflection either way (m, with its sign) of a point, and when (s).

        Between output times by cubic interpolation with the rates, exact to fourth order.
        Components 0, 1, 2 are axial, in plane, flap. The value is differentiable; the time carries
        no derivative.
        """
        if self.times.size < 2:
            raise ValueError("peak needs two or more output times")
        return self._own(_peak(self, *checked_point(component, xi)))

    def _each(self, function: Any, *xi: float) -> Any:
        return self._own(_mapped(function, self.scene, self.times, self.state, xi))

    def _own(self, out: Any) -> Any:
        """NaN where a case is out of range: it ran with harmless numbers in place of its own."""
        own = in_range(self.status)
        return jax.tree.map(lambda values: jnp.where(own, values, jnp.nan), out)


@eqx.filter_jit
def _mapped(function: Any, scene: Scene, times: Array, state: State, xi: tuple[float, ...]) -> Any:
    return jax.vmap(lambda t, y: function(scene, t, y, *xi))(times, state)


def _points(xi: Any) -> tuple[float, ...]:
    points = np.atleast_1d(np.asarray(xi, float))
    if points.ndim != 1 or not ((points >= 0) & (points <= 1)).all():
        raise ValueError(f"xi must be a number or a list of numbers in [0, 1], got {xi}")
    return tuple(points.tolist())


def checked_point(component: int, xi: float) -> tuple[int, float]:
    if component not in (0, 1, 2):
        raise ValueError(f"component must be 0 (axial), 1 (in plane) or 2 (flap), got {component}")
    (point,) = _points(xi)
    return component, point


def _displacement(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, "p 3"]:
    return scene.equations.displacement(y.q, np.array(xi))


def _strain(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, " p"]:
    return scene.equations.strain(y.q, np.array(xi))


def _curvature(scene: Scene, t: Scalar, y: State, *xi: float) -> Float[Array, "p 2"]:
    return scene.equations.curvature(y.q, np.array(xi))


def _strain_energy(scene: Scene, t: Scalar, y: State) -> Scalar:
    return scene.equations.strain_energy(y.q)


def _jacobi(scene: Scene, t: Scalar, y: State) -> Scalar:
    return sum(scene.energies(t, y))  # type: ignore[return-value]


@eqx.filter_jit
def _peak(run: Simulation, component: int, xi: float) -> tuple[Scalar, Scalar]:
    def place(q: Vector) -> Scalar:
        return run.scene.equations.displacement(q, np.array([xi]))[0, component]

    def both(y: State) -> tuple[Scalar, Scalar]:
        return jax.jvp(place, (y.q,), (y.v,))

    u, rate = jax.vmap(both)(run.state)
    t, h = run.times[:-1], jnp.diff(run.times)
    s, value = jax.vmap(_extremes)(u[:-1], h * rate[:-1], u[1:], h * rate[1:])
    at = jnp.argmax(jnp.where(jnp.isnan(value), -1.0, jnp.abs(value)))
    return value.ravel()[at], (t[:, None] + h[:, None] * s).ravel()[at]


def _extremes(u0: Scalar, v0: Scalar, u1: Scalar, v1: Scalar) -> tuple[Vector, Vector]:
    """Where in [0, 1] the cubic of these values and slopes can be extreme, and its values there."""
    rise = u1 - u0
    a, b = v0 + v1 - 2 * rise, 3 * rise - 2 * v0 - v1
    # Roots of v0 + 2 b s + 3 a s^2, in the form that does not cancel. They carry no derivative:
    # where an extremum is does not matter to the derivative of its value.
    half = -b - jnp.copysign(jnp.sqrt(jnp.maximum(b**2 - 3 * a * v0, 0.0)), b)
    roots = half / jnp.where(a == 0, 1.0, 3 * a), v0 / jnp.where(half == 0, 1.0, half)
    s = jax.lax.stop_gradient(jnp.stack([jnp.zeros_like(a), jnp.ones_like(a), *roots]))
    s = jnp.clip(s, 0.0, 1.0)
    return s, u0 + s * (v0 + s * (b + s * a))
