"""The lowest frequencies alone, at the speed that sweeps of many cases want.

Transverse motion w and axial motion u move in quadrature, so that frequencies omega are where

    D(omega) = K - omega^2 M + omega C,   C symmetric, from the Coriolis coupling of w and u,

is singular. Bending polynomials and elements both give narrow bands. A Ritz problem of few
functions, which all beams share, guesses omega to some 1e-4; one or two inverse iterations in all
functions with Rayleigh quotients make it exact, and Sylvester's law says whether it is the one
asked for.

Y: H. H. Yoo, R. R. Ryan, R. A. Scott, Dynamics of flexible beams undergoing overall motions,
Journal of Sound and Vibration, 1995.
B: M. Berzeri, A. A. Shabana, A finite element study of the geometric centrifugal stiffening effect,
Technical Report MBS99-5-UIC, 1999.
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxbeam._models.base import AbstractModel, Equations, NodeByNode, PlanarTables, checked_case
from jaxbeam._models.basis import Polynomials
from jaxbeam._numerics.band import (
    Band,
    band,
    polished,
    product,
    refined,
    width_of,
)
from jaxbeam._numerics.kernel import kernel
from jaxbeam._numerics.lanes import beside, contract, total
from jaxbeam._numerics.program import Program
from jaxbeam._results import harmless, where_known, without_derivatives
from jaxbeam._rotor.beam import Rotor, tension
from jaxbeam._rotor.motion import spinning
from jaxbeam._status import Status, raise_unless_ok
from jaxbeam._types import Code, Number, Real, Scalar, Vector
from jaxbeam._vibration.ritz import BENDING, Numbers, combined, numbers_of, ritz_problem

_TOLERANCE = 2e-5  # of the vector: what is left of the frequency is below 1e-9
_Case = tuple[Rotor, Scalar]  # and its speed


class Frequencies(eqx.Module):
    """The lowest k frequencies (rad/s) of motion in the plane of rotation, in order.

    NaN unless `status` is `Status.OK`.
    """

    frequency: Float[Array, " k"]
    status: Code


def frequencies(
    model: AbstractModel, rotor: Rotor, angular_speed: Real, which: int = 3, *, throw: bool = True
) -> Frequencies:
    """The lowest `which` frequencies (rad/s) in the plane of rotation, much faster than `modes`.

    Roots omega > 0 of det(K - omega^2 M + omega C) = 0 about the steady state, C from the Coriolis
    coupling of bending and axial motion (Y eqs. 18-19, B eqs. 53-54), to 1e-9 of those of `modes`.
    For `Hybrid` with its usual basis (`Polynomials()`, eight or more functions in plane) and the
    elements that simulate too (`EngineeringANCF`, `GreenANCF`, `ANCF`, `ChordANCF`, `TangentANCF`).
    `angular_speed` in rad/s; `which` from 1 to 6. Made for `jax.vmap` over many cases, with first
    derivatives by every parameter; for second ones, labels, shapes, flap or growth take `modes`.

    Raises `TypeError` for other models, `ValueError` for parameters out of range, `RuntimeError`
    where there is no steady state (`NO_EQUILIBRIUM`) or where the search did not find what was
    asked for (`NOT_CONVERGED`): where an axial mode is among the lowest, or the steady state is
    unstable. `throw=False` keeps all but the first in `status`, and the frequencies are NaN, with
    derivatives that are NaN in forward mode and zero in reverse mode (see `modes`).
    """
    if isinstance(which, bool) or not isinstance(which, int):
        raise TypeError(f"which must be an int, got {type(which).__name__}")
    rotor, speed = checked_case(model, rotor, angular_speed)
    result = _frequencies(_solver(model, which), rotor, speed)
    return raise_unless_ok(result, result.status) if throw else result


@functools.lru_cache(maxsize=64)
def _solver(model: AbstractModel, count: int) -> Callable[[Rotor, Scalar], tuple[Array, Code]]:
    bands = model.bands()
    if isinstance(bands, PlanarTables):
        _check_count(count, len(bands.places) - 4)
        return _of_polynomials(bands, count)
    if isinstance(bands, NodeByNode):
        _check_count(count, bands.n_elements)
        return _of_elements(model, bands, count)
    raise TypeError(
        "model must be Hybrid with Polynomials() and n_in_plane >= 8, EngineeringANCF, GreenANCF, "
        f"ANCF, ChordANCF or TangentANCF, got {model!r}; take modes for other models"
    )


def _check_count(count: int, most: int) -> None:
    most = min(most, 6)
    if not 1 <= count <= most:
        raise ValueError(f"which must be between 1 and {most} for this model, got {count}")


@Program
def _frequencies(solver: Any, rotor: Rotor, speed: Scalar) -> Frequencies:
    given = rotor.status(speed)
    fine = given == Status.OK
    rotor = harmless(fine, rotor)
    omega, status = solver(rotor, jnp.where(fine, speed, 0.0))
    status = jnp.where(fine, status, given).astype(int)
    return Frequencies(where_known(status == Status.OK, omega), status)


class _Pencil(NamedTuple):
    """The matrices K, M, C of D(omega), as bands."""

    k: Band
    m: Band
    c: Band

    def by_mode(self) -> "_Pencil":
        """With an axis for the modes, before those of lanes."""
        return _Pencil(*(a[:, :, None] for a in self))


def _with_derivative(
    search: Callable[[Any], Any], polish: Callable[..., Any], form: Callable[..., Any]
) -> Callable[..., Any]:
    """search(arrays) -> (omega, hidden, found) with derivatives of omega from

        polish(arrays, hidden, omega) = what form wants, slope = -x^T D'(omega) x,
        form(arrays, what it wants, omega) = x^T D(omega) x = 0:

    d omega = d(x^T D x) / slope. `hidden` holds x and what else was found on the way; `polish`
    makes x as exact as omega is.
    """

    @jax.custom_jvp
    def call(arrays: Any) -> Any:
        return search(arrays)

    @call.defjvp
    def rule(primals: tuple[Any], rates: tuple[Any]) -> tuple[Any, Any]:
        out = call(*primals)
        ok = jnp.all(out[2] > 0)
        omega, hidden = harmless(ok, _once(out[:2]))
        hidden, slope = harmless(ok, _once(polish(*primals, hidden, omega)))
        change = jax.jvp(lambda a: form(a, hidden, omega), primals, rates)[1]
        rate = jnp.where(ok, change / slope, 0.0)
        _, *others = jax.tree.map(jnp.zeros_like, out)
        return out, (rate, *others)

    return call


@jax.custom_jvp
def _once(out: Any) -> Any:
    """No second derivatives: those of x would be missing."""
    return out


@_once.defjvp
def _no_more(primals: Any, tangents: Any) -> Any:
    raise NotImplementedError("frequencies has first derivatives only: take modes for second ones")


def _matrices(tables: Sequence[Any], numbers: Numbers) -> tuple[Array, Array, Array]:
    """K, M, C of the nine tables of `PlanarTables`, with lanes behind."""
    g, hub, tip, softness = numbers
    one = jnp.ones_like(g)
    weights = [one, 1 / softness, *tension(g**2, hub, tip), -(g**2), -(g**2) * tip]

    def summed(some: slice, weights: list[Array]) -> Array:
        return combined(jnp.stack(tables[some], -1 - g.ndim), weights)

    return (
        summed(slice(7), weights),
        summed(slice(5, 7), [one, tip * one]),
        summed(slice(7, 9), [2 * g, 2 * g * tip]),
    )


def _of_polynomials(
    bands: PlanarTables, count: int
) -> Callable[[Rotor, Scalar], tuple[Array, Code]]:
    ritz, (tables, places) = ritz_problem(count), bands
    stretches = len(tables[0]) > len(places)
    width = width_of(*tables)
    wide = [band(table, width) for table in tables]
    narrow = [band(table, width_of(table)) for table in tables]
    functions = np.zeros((len(tables[0]), ritz.functions.shape[1]))
    few = min(len(places), BENDING)
    functions[places[:few]] = ritz.functions[:few]

    def pencil(numbers: Numbers) -> _Pencil:
        return _Pencil(*_matrices([beside(a, numbers.speed.ndim) for a in wide], numbers)).by_mode()

    @kernel
    def search(numbers: Numbers) -> tuple[Array, Array, Array]:
        seen = numbers if stretches else numbers._replace(softness=0 * numbers.softness)
        return _search(pencil(numbers), *ritz.guess(seen), functions)

    @kernel
    def polish(numbers: Numbers, x: Array, omega: Array) -> tuple[list[Array], Array]:
        x = polished(_at(pencil(numbers), omega), x)
        each = [beside(table[:, :, None], numbers.speed.ndim) for table in narrow]
        shares = [total(x * product(table, x)) for table in each]
        _, m, c = _matrices(shares, numbers)
        return shares, 2 * omega * m - c

    @kernel
    def form(numbers: Numbers, shares: list[Array], omega: Array) -> Array:
        k, m, c = _matrices(shares, numbers)
        return k - omega**2 * m + omega * c

    lowest = _with_derivative(search, polish, form)

    def solver(rotor: Rotor, speed: Scalar) -> tuple[Array, Code]:
        omega, _, found = lowest(numbers_of(rotor, speed))
        status = jnp.where(jnp.all(found > 0), Status.OK, Status.NOT_CONVERGED)
        if stretches:
            status = jnp.where(rotor.tears(speed), Status.NO_EQUILIBRIUM, status)
        return omega * rotor.beam.frequency_scale, status

    return solver


def _search(
    pencil: _Pencil, guess: Array, modes: Array, functions: np.ndarray
) -> tuple[Array, Array, Array]:
    lanes = guess.ndim - 1
    x = contract(beside(functions[:, :, None], lanes), modes[None], 1, lanes)
    omega, x, done, below = refined(*pencil, guess, x, _TOLERANCE)
    place = beside(np.arange(len(guess)), lanes)
    right = done & (below == place)
    # What was not found must not end up, as NaN, in gradients of parameters that cases share.
    return jnp.where(right, omega, 1.0), x, jnp.where(right, 1.0, 0.0)


def _at(pencil: _Pencil, omega: Array) -> Band:
    """The matrix D(omega) as a band."""
    return pencil.k - omega**2 * pencil.m + omega * pencil.c


def _of_elements(
    model: AbstractModel, bands: NodeByNode, count: int
) -> Callable[[Rotor, Scalar], tuple[Array, Code]]:
    n, ritz = bands.n_elements, ritz_problem(count)
    at = Polynomials().bending(BENDING, np.linspace(0.0, 1.0, n + 1)[1:])
    size = ritz.functions.shape[1]
    functions = np.zeros((n, 4, size))
    functions[:, 0], functions[:, 1] = at.value @ ritz.functions, at.slope @ ritz.functions
    functions = np.concatenate([np.zeros((1, size)), functions.reshape(4 * n, size)])
    # Quadrature: rows of w and of u see the Coriolis force with opposite signs.
    signs = np.tile([-1.0, -1.0, 1.0, 1.0], n + 1).reshape(n + 1, 4, 1)

    @kernel
    def search(case: _Case) -> tuple[Array, Any, Array]:
        rotor, speed = case
        equations = model.equations(rotor)
        q, steady = _steady(equations, speed)
        guess, modes = ritz.guess(numbers_of(rotor, speed))
        pencil = _banded(equations, speed, q, signs)
        guess = rotor.beam.frequency_scale * guess
        omega, x, found = _search(pencil, guess, modes, functions)
        return omega, (x, q), found * steady

    @kernel
    def polish(case: _Case, hidden: Any, omega: Array) -> tuple[Any, Array]:
        x, q = hidden
        pencil = _banded(model.equations(case[0]), case[1], q, signs)
        x = polished(_at(pencil, omega), x)
        return (x, q), total(x * product(2 * omega * pencil.m - pencil.c, x))

    @kernel
    def form(case: _Case, hidden: Any, omega: Array) -> Array:
        equations, (x, q) = model.equations(case[0]), hidden
        pencil = _banded(equations, case[1], _newton(equations, case[1], q), signs)
        return total(x * product(_at(pencil, omega), x))

    lowest = _with_derivative(search, polish, form)

    def solver(rotor: Rotor, speed: Scalar) -> tuple[Array, Code]:
        omega, _, found = lowest((rotor, speed))
        status = jnp.where(jnp.all(found > 0), Status.OK, Status.NOT_CONVERGED)
        if bands.tears:
            status = jnp.where(rotor.tears(speed), Status.NO_EQUILIBRIUM, status)
        return omega, status

    return solver


def _newton(equations: Equations, speed: Number, q: Vector) -> Vector:
    """One step towards the steady state. Where it has been reached, the derivatives of the new q
    are those of the steady state."""
    rest, hub = jnp.zeros_like(q), spinning(speed)
    k, _ = without_derivatives(equations.tangents(hub, q, rest, None))
    return q + k.inverse() @ equations.force(hub, q, rest, None)


def _steady(equations: Equations, speed: Number) -> tuple[Vector, Number]:
    """The steady state by Newton's method, and whether it was found."""
    size = jnp.broadcast_to(equations.size, speed.shape)

    def go_on(state: tuple[Array, ...]) -> Array:
        return (state[0] < 20) & jnp.any(state[2] < 1)

    def improve(state: tuple[Array, ...]) -> tuple[Array, ...]:
        i, q, done = state
        new = _newton(equations, speed, q)
        small = jnp.where(total((new - q) ** 2) < (1e-9 * size) ** 2, 1.0, 0.0)
        return i + 1, jnp.where(done < 1, new, q), jnp.where(done < 1, small, done)

    n = equations.mass.shape[0]
    zero = jnp.zeros((n, *speed.shape), speed.dtype)
    state: tuple[Array, ...] = (jnp.zeros((), int), zero, jnp.zeros_like(speed))
    _, q, done = jax.lax.while_loop(go_on, improve, state)
    return q, done


def _banded(equations: Equations, speed: Number, q: Vector, signs: np.ndarray) -> _Pencil:
    k, c = equations.tangents(spinning(speed), q, jnp.zeros_like(q), None)

    def bands(rows: Float[Array, "k 4 12 *lanes"]) -> Band:
        longer = jnp.concatenate([rows, jnp.zeros_like(rows[:, :, :3])], 2)
        columns = jnp.stack([longer[:, i, 4 + i : 12 + i] for i in range(4)], 1)
        return columns.reshape(-1, *columns.shape[2:])[3:]

    mass: Any = equations.mass
    m = jnp.broadcast_to(mass.rows, k.rows.shape)
    turned = c.rows * beside(signs, q.ndim - 1)
    return _Pencil(bands(k.rows), bands(m), bands(turned)).by_mode()
