"""The stages of a Rosenbrock method for second-order systems, and their adjoint.

With g = gamma h, S_i = y + sum_j weight_ij U_j and P_i = sum_j coupling_ij U_j / h, each with a
part in q and one in v, and D, B and N of `Kinematics` (g, 1 and 1 where q' = v), a stage
U_i = (D (f_i + B z_i), z_i), f_i = kinematics(S_i) + P_i,q, solves

    A z_i = F(x_i, S_i) + M P_i,v + h rate_i F' - K N D f_i,   A = M / g + C + K N D B.

Its adjoint goes through the stages backwards. The cotangent of U_i, (a_i, b_i), is known when all
later ones are done; then

    A^T y_i = B^T D^T a_i + b_i,  and cotangents are, of f_i: e_i = D^T (a_i - N^T K^T y_i),
    of S_i: dF^T y_i + dkinematics^T e_i,   of P_i: (e_i, M^T y_i).

By all else, M, C, K, F' and kinematics, the derivative is that of

    sum_i y_i . (F(x_i, S_i) + h rate_i F' + M (P_i,v - z_i / g) - C z_i - K N U_i,q)
          + e_i . (d kinematics U_i)

with stages as they are; by h it is sum_i (p_i . (U_i / g - P_i) / h + rate_i y_i . F'), p_i being
the cotangent of P_i. Where q' = v, K and C get sums of y_i U_i^T, and are differentiated once. Else
-C z - K N u is the derivative of the force along U, and is differentiated as that. So a step back
asks for first derivatives of the force at every stage, and for second ones along stages at the
start, in place of the transpose of every operation.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._numerics.blocks import padded
from jaxbeam._numerics.kinematics import Straight
from jaxbeam._numerics.linalg import outer
from jaxbeam._programs.lanes import compute_once, pairwise_sum, transposed
from jaxbeam._programs.one_function import without_rules
from jaxbeam._solvers.steps import Linearised, combined
from jaxbeam._solvers.system import SecondOrderSystem, State
from jaxbeam._types import Coordinates, Number, Scalar, Vector


class Tableau(NamedTuple):
    """Coefficients of a Rosenbrock method in the form that saves products with the Jacobian J,

        (1 / (h gamma) - J) U_i = f(t + times_i h, y + sum_j weight_ij U_j)
                                  + sum_j coupling_ij U_j / h + h rate_i df/dt,

    ending at y + weight_last U + U_last with the error U_last (stiffly accurate); `dense` gives
    D = dense U of y0 + s (y1 - y0) + s (1 - s) (D_1 + s D_2 + s^2 D_3).
    """

    order: int
    gamma: float
    weight: Float[np.ndarray, "s s"]
    coupling: Float[np.ndarray, "s s"]
    times: Float[np.ndarray, " s"]
    rate: Float[np.ndarray, " s"]
    dense: Float[np.ndarray, "3 s"]

    @property
    def of_stages(self) -> Float[np.ndarray, "4 s"]:
        """The change over a step, and D, from the stages."""
        return np.stack([np.append(self.weight[-1, :-1], 1.0), *self.dense])


class Stages(NamedTuple):
    """The stages of a step."""

    about: Linearised
    force_rate: Vector  # F'
    done: Float[Array, "s m *lanes"]  # U of q and v side by side
    at: Any  # S (s, m, *lanes), and P, if they are kept
    past: Any


def stages(
    table: Tableau, system: SecondOrderSystem, h: Number, y0: State, start: Any, inputs: Any,
    *, every: bool = False,
) -> Stages:  # fmt: skip
    """The stages of a step, with what `every` one begins with if that is asked for."""
    q, v, g = y0.q, y0.v, table.gamma * h
    n, both = len(q), jnp.concatenate([q, v])
    x0, input_rate = start
    k, c, force_rate = _beginning(system, x0, input_rate, q, v)
    about = Linearised.of(system, q, v, g, (k, c))

    def stage(done: Array, row: Any) -> tuple[Array, Any]:
        i, rows, d, now = row
        # Held, or they would be made anew for each number that is made of them.
        step, past = compute_once(combined(rows, done))
        step, past = both + step, past / h
        at = step[:n], step[n:]
        first = system.kinematics(*at) + past[:n]
        right = system.force(now, *at) + system.mass @ past[n:] + h * d * force_rate
        done = jax.lax.dynamic_update_index_in_dim(done, about.change(first, right), i, 0)
        return done, (step, past) if every else None

    rows = jnp.asarray(np.stack([table.weight, table.coupling], 1), q.dtype)
    count = len(table.times)
    done, began = jax.lax.scan(
        stage,
        jnp.zeros((count, *both.shape), q.dtype),
        (jnp.arange(count), rows, jnp.asarray(table.rate, q.dtype), inputs),
    )
    return Stages(about, force_rate, done, *(began if every else (None, None)))


def _beginning(
    system: SecondOrderSystem, x0: Any, input_rate: Any, q: Coordinates, v: Vector
) -> tuple[Any, Any, Vector]:
    """The tangents K and C and the rate F' where a step begins."""
    k, c = system.tangents(x0, q, v)
    with transposed(on=False):
        _, force_rate = jax.jvp(lambda x: system.force(x, q, v), (x0,), (input_rate,))
    return k, c, force_rate


def back_through_stages(table: Tableau, moving: Any, args: Any, found: Stages, out: Any) -> Any:
    """Cotangents of those of the arguments (system, h, y0, start, inputs, ...) of a step that are
    `moving`, from those of its end, error and polynomial. Those of others are None."""
    arrays, rest = eqx.partition((args, found, out), eqx.is_array)

    def back(arrays: Any) -> Any:
        return _back(table, moving, *eqx.combine(arrays, rest))

    return without_rules(back)(arrays)


def _back(table: Tableau, moving: Any, args: Any, found: Stages, out: Any) -> Any:
    own, still = eqx.partition(args, moving)
    _, h, y0 = args[:3]
    n, g, done, past = len(y0.q), table.gamma * h, found.done, found.past
    end, error, (c0, c1, c2, c3) = out[:3]
    to_done = combined(table.of_stages.T, jnp.stack([end + c0, c0 - c1, c1 - c2, c2 - c3]))
    to_done = to_done + padded(error[None], len(done) - 1, 0)
    (later, to_system), (y, e, to_inputs) = _backwards(table, own, still, args, found, to_done)

    # By what stages have in common
    mass, by_rate = args[0].mass, combined(table.rate[None], y)[0]
    shared = outer(mass, y, past[:, n:] - done[:, n:] / g), h * by_rate
    plain = isinstance(found.about.kinematics, Straight)
    pull_back = _back_by_matrices if plain else _back_along
    more, to_start, by_q, by_v = pull_back(own, still, y0, shared, (y, e, done))
    by_past = later[1::2]
    to_y = end + pairwise_sum(later[::2])
    to_y0 = State(to_y[:n] + by_q, to_y[n:] + by_v, jnp.zeros_like(y0.work))
    to_h = None
    if own[1] is not None:
        by_past = by_past * (done / g - past)
        to_h = pairwise_sum(by_rate * found.force_rate) + pairwise_sum(
            by_past.reshape(-1, *done.shape[2:])
        )
    to_system = jax.tree.map(jnp.add, to_system, more)
    whole = (to_system, to_h, eqx.filter(to_y0, moving[2]), to_start, to_inputs)
    return *whole, *(_zeros(a) for a in own[5:])


def _backwards(
    table: Tableau, own: Any, still: Any, args: Any, found: Stages, to_done: Array
) -> tuple[tuple[Array, Any], tuple[Array, Array, Any]]:
    """Cotangents of S_i and P_i / h, in this order for each stage, and of the system by the forces
    of all; y_i, e_i and the cotangent of the inputs, of each."""
    system, h, y0 = args[:3]
    n, s, (k, kinematics, solve) = len(y0.q), len(to_done), found.about

    def rates(
        system: Any, own_x: Any, q: Coordinates, v: Vector, other_x: Any
    ) -> tuple[Coordinates, Vector]:
        whole: SecondOrderSystem = eqx.combine(system, still[0])
        return whole.kinematics(q, v), whole.force(eqx.combine(own_x, other_x), q, v)

    def stage(state: tuple[Any, Any], row: Any) -> tuple[Any, Any]:
        later, to_system = state
        i, columns, to_u, at, x, other_x = row
        to_u = to_u + compute_once(combined(columns[None], later)[0])
        to_q, to_v = to_u[:n], to_u[n:]
        y = (kinematics.led_back(to_q, y0.v) + to_v) @ solve
        e = to_q - kinematics.seen_back(y @ k, y0.q)
        e = kinematics.before_back(e, y0.q)
        with transposed():
            _, pull = jax.vjp(
                lambda system, x, q, v: rates(system, x, q, v, other_x),
                own[0], x, at[:n], at[n:],
            )  # fmt: skip
        more, to_x, by_q, by_v = pull((e, y))
        by_past = jnp.concatenate([e, y @ system.mass]) / h
        new = jnp.stack([jnp.concatenate([by_q, by_v]), by_past])
        later = jax.lax.dynamic_update_slice_in_dim(later, new, 2 * i, 0)
        return (later, jax.tree.map(jnp.add, to_system, more)), (y, e, to_x)

    columns = np.stack([table.weight, table.coupling]).transpose(2, 1, 0).reshape(s, 2 * s)
    rows = (
        jnp.arange(s), jnp.asarray(columns, to_done.dtype), to_done, found.at, own[4], still[4],
    )  # fmt: skip
    zero = jnp.zeros((2 * s, *to_done.shape[1:]), to_done.dtype), _zeros(own[0])
    return jax.lax.scan(stage, zero, rows, reverse=True)


def _back_by_matrices(own: Any, still: Any, y0: State, shared: Any, done: Any) -> Any:
    """Cotangents of the system, of the inputs at the start, and of q and v there, by M, K, C and F'
    where a step begins."""
    to_mass, to_rate = shared
    y, _, u = done
    n = len(y0.q)

    def beginning(system: Any, start: Any, q: Coordinates, v: Vector) -> Any:
        whole: SecondOrderSystem = eqx.combine(system, still[0])
        x0, input_rate = eqx.combine(start, still[3])
        return whole.mass, *_beginning(whole, x0, input_rate, q, v)

    with transposed():
        _, pull = jax.vjp(beginning, own[0], own[3], y0.q, y0.v)
    return pull((to_mass, outer(to_mass, -y, u[:, :n]), outer(to_mass, -y, u[:, n:]), to_rate))


def _back_along(own: Any, still: Any, y0: State, shared: Any, done: Any) -> Any:
    """Cotangents as of `_back_by_matrices`, by derivatives of force and kinematics along stages:
    matrices of second derivatives are never made."""
    to_mass, to_rate = shared
    y, e, u = done
    n = len(y0.q)

    def work(system: Any, start: Any, q: Coordinates, v: Vector, y: Any, e: Any) -> Scalar:
        whole: SecondOrderSystem = eqx.combine(system, still[0])
        x0, _ = eqx.combine(start, still[3])
        return y @ whole.force(x0, q, v) + e @ whole.kinematics(q, v)

    def along(y: Any, e: Any, u: Any) -> Any:
        def by(q: Coordinates, v: Vector) -> Any:
            return jax.grad(work, (0, 1, 2, 3))(own[0], own[3], q, v, y, e)

        return jax.jvp(by, (y0.q, y0.v), (u[:n], u[n:]))[1]

    def rest(system: Any, start: Any, q: Coordinates, v: Vector) -> Any:
        whole: SecondOrderSystem = eqx.combine(system, still[0])
        x0, input_rate = eqx.combine(start, still[3])
        _, rate = jax.jvp(lambda x: whole.force(x, q, v), (x0,), (input_rate,))
        return whole.mass, rate

    _, pull = jax.vjp(rest, own[0], own[3], y0.q, y0.v)
    each = jax.tree.map(pairwise_sum, jax.vmap(along)(y, e, u))
    return jax.tree.map(jnp.add, each, pull((to_mass, to_rate)))


def _zeros(tree: Any) -> Any:
    return jax.tree.map(jnp.zeros_like, tree)
