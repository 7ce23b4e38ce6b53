"""Models whose matrices are bands: their lowest modes in batches, and how eigenvalues change."""

import abc
import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from jaxbeam._models.bases.basis import Functions, Polynomials
from jaxbeam._models.contract.bands import BandTables, NodeByNode
from jaxbeam._models.contract.base import AbstractModel
from jaxbeam._models.contract.equations import Equations
from jaxbeam._modes import ritz
from jaxbeam._modes.element_forms import ElementForms, UnitBeam
from jaxbeam._modes.ritz import combined
from jaxbeam._modes.spectrum import Entries, Guess, Named, chosen, coupled_modes, transverse
from jaxbeam._numerics.band import Band, Pencil, band, width_of
from jaxbeam._numerics.blocks import BlockTridiagonal
from jaxbeam._programs.kernel import kernel
from jaxbeam._programs.lanes import append_axes, pairwise_sum
from jaxbeam._results import harmless
from jaxbeam._rotor.beam import Rotor
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.motion import spinning
from jaxbeam._rotor.span import section_inertia, tension
from jaxbeam._types import Number, Scalar, Vector

MOST = 6  # modes of a direction that can be searched by bands; half as many axial ones
ModeCounts = tuple[int, int, int, int]  # numbers of modes of each `Direction`
About = tuple[Vector | None, Array]  # the steady state of elements, and whether the case is OK
_BandForms = tuple[Complex[Array, " k"], Complex[Array, " k"], Complex[Array, " k"]]


class Lowest(NamedTuple):
    """Modes, and the steady state that they are about."""

    entries: Entries
    strain: Scalar  # axial, at the root
    state: Vector | None  # coordinates of elements; None of `Hybrid`, whose beam is undeformed


class Bands(abc.ABC):
    """Searches of modes and derivatives of eigenvalues for a model whose matrices are bands."""

    has_forms: bool

    @abc.abstractmethod
    def lowest(self, rotor: Rotor, speed: Scalar, named: Named) -> Lowest:
        """The modes wanted, marked where they are not certain; without derivatives."""

    def forms(
        self, rotor: Rotor, speed: Scalar, x: Complex[Array, "k n"], about: About
    ) -> _BandForms:
        """The forms x^T S M x, x^T S G x and x^T S K x of k vectors, differentiable; S is 1 on w
        and -1 on u. Only of bands with `has_forms`, for which they cost less than the matrices."""
        # A harmless beam at rest takes the place of a case that failed, whose NaN would spoil
        # gradients by parameters that other cases share.
        state, ok = about
        speed, state = jax.tree.map(lambda a: jnp.where(ok, a, 0.0), (speed, state))
        return self._forms(harmless(ok, rotor), speed, x, state)

    @abc.abstractmethod
    def _forms(
        self, rotor: Rotor, speed: Scalar, x: Complex[Array, "k n"], state: Vector | None
    ) -> _BandForms:
        """The forms of `forms` for a case that did not fail."""


@functools.lru_cache(maxsize=64)
def bands_of(model: AbstractModel, most: ModeCounts, count: int) -> Bands | None:
    """Bands for up to `most` modes of each direction, `count` in all; None for models whose
    matrices are no bands or too small, and for more modes than `MOST`."""
    bands = model.bands()
    axial, in_plane, flap, _ = most
    if max(2 * axial, in_plane, flap) > MOST or in_plane == 0:
        return None
    if isinstance(bands, BandTables):
        return _Polynomials(bands, most, count)
    if isinstance(bands, NodeByNode) and in_plane <= bands.n_elements:
        return _Elements(model, bands, most, count)
    return None


class _Numbers(NamedTuple):
    """The numbers that modes depend on, in units of length, mass and EI_zz of the beam."""

    speed: Number  # speed over sqrt(EI_zz / (rho L^4))
    hub: Number  # R / L
    tip: Number  # m_t / (rho L)
    softness: Number  # EI_zz / (EA L^2)
    flap: Number  # EI_yy / EI_zz
    rotary: tuple[Number, ...] | None  # E_22 and E_33 of sections, over rho L^2

    def stiffness_weights(self, bending: Any) -> list[Any]:
        """Weights of stiffness tables: of bending, and the three of tension."""
        return [bending, *tension(self.speed**2, self.hub, self.tip)]


def _numbers(rotor: Rotor, speed: Number) -> _Numbers:
    beam = rotor.beam
    rotary: Any = section_inertia(beam, lambda value: value)
    if rotary is not None:
        rotary = tuple(each / (beam.mass * beam.length) for each in rotary)
    return _Numbers(
        speed / beam.frequency_scale, rotor.hub_radius / beam.length, rotor.tip_mass / beam.mass,
        beam.slenderness**-2, beam.flap_bending_stiffness / beam.in_plane_bending_stiffness, rotary,
    )  # fmt: skip


class _Terms(NamedTuple):
    """The tables of `BandTables` that each matrix is a sum of: weights by number of the table."""

    stiffness: dict[int, Any]
    mass: dict[int, Any]
    coriolis: dict[int, Any]


def _in_plane(numbers: _Numbers) -> _Terms:
    """Weights of the nine in-plane tables of `BandTables`."""
    g, tip = numbers.speed, numbers.tip
    bending, *tensions = numbers.stiffness_weights(1.0)
    stiffness = {0: bending, 1: 1 / numbers.softness, **dict(enumerate(tensions, 2))}
    mass: dict[int, Any] = {5: 1.0, 6: tip}
    coriolis = {7: 2 * g, 8: 2 * g * tip}
    stiffness |= {table: -(g**2) * weight for table, weight in mass.items()}
    if numbers.rotary is not None:  # no centrifugal stiffness: in plane the speed adds none
        mass |= {2: numbers.rotary[0]}
    return _Terms(stiffness, mass, coriolis)


def _out_of_plane(numbers: _Numbers) -> _Terms:
    """Weights of the six flap tables of `BandTables`."""
    stiffness = dict(enumerate(numbers.stiffness_weights(numbers.flap)))
    mass = {4: 1.0, 5: numbers.tip}
    if numbers.rotary is not None:
        stiffness[1] = stiffness[1] - numbers.speed**2 * numbers.rotary[1]
        mass |= {1: numbers.rotary[1]}
    return _Terms(stiffness, mass, {})


def _summed(tables: Sequence[Any], weights: dict[int, Any], like: Array) -> Array:
    """The sum of tables with weights by their number; it has the lanes of `like` last."""
    beside_lanes = [append_axes(tables[table], like.ndim) for table in weights]
    weighted = [a * jnp.ones_like(like) for a in weights.values()]
    return combined(jnp.stack(beside_lanes, -1 - like.ndim), weighted)


def _guessed(few: Float[Array, "m k *lanes"], functions: np.ndarray) -> Float[Array, "k n *lanes"]:
    """Modes in n coordinates from modes in m functions, which are the columns of `functions`."""
    columns = append_axes(functions, few.ndim - 2)
    return jax.lax.map(
        lambda mode: functools.reduce(jnp.add, [columns[:, i] * c for i, c in enumerate(mode)]),
        jnp.swapaxes(few, 0, 1),
    )


def _bending(numbers: _Numbers, ratio: Any, spin2: Any, softness: Any) -> tuple[Any, ...]:
    """Arguments of `Ritz.guess`: `ratio` is that of bending stiffness to EI_zz, `softness` EI_zz /
    (EA L^2) for axial motion that follows the Coriolis force, zero without."""
    one = jnp.ones_like(numbers.speed)
    return (
        [a * one for a in numbers.stiffness_weights(ratio)], numbers.tip * one, spin2 * one,
        4 * numbers.speed**2 * softness * one,
    )  # fmt: skip


def _axial_guess(numbers: _Numbers, count: int, values: np.ndarray) -> Guess:
    """Guesses of `count` axial modes in coordinates, which `values` makes of polynomials."""
    mu, x = ritz.axial(count).guess(values, numbers.tip * jnp.ones_like(numbers.speed))
    omega = jnp.sqrt(mu / numbers.softness - numbers.speed**2)
    return Guess(omega, jnp.swapaxes(x, 0, 1))


class _Polynomials(Bands):
    """Bands of `Hybrid`, whose matrices are sums of constant tables."""

    has_forms = True

    def __init__(self, bands: BandTables, most: ModeCounts, count: int) -> None:
        tables = bands.in_plane
        n = len(tables[0])
        self.is_axial = ~np.isin(np.arange(n), bands.places)
        self.signs = np.where(self.is_axial, -1.0, 1.0)
        self.most, self.count = most, count
        self.order, self.to_model = bands.order, np.argsort(bands.order)
        # Without stretch functions bending is not coupled with axial motion.
        self.stretch = int(np.sum(self.is_axial))
        self.n_flap = len(bands.flap[0]) if bands.flap else 0
        self.across = _placed(bands.places, _unit(n - self.stretch), n)
        self.along = _placed(np.flatnonzero(self.is_axial), _unit(self.stretch), n)
        self.whole, self.flap = _wide(tables), _wide(bands.flap)
        self.diagonals = max(width_of(*tables), width_of(*bands.flap))
        self.shares = self._sums(bands)
        self.search = kernel(self._search)

    @functools.cached_property
    def few(self) -> ritz.Ritz:
        """Functions for guesses of modes, computed at the first batch: single cases need none."""
        return ritz.bending(max(self.most[Direction.IN_PLANE], self.most[Direction.FLAP]))

    def _bending_guess(self, guess: tuple[Array, Array], count: int, rows: np.ndarray) -> Guess:
        """The first `count` guessed modes in coordinates, which `rows` makes of polynomials."""
        omega, few = guess
        functions = rows @ self.few.functions
        return Guess(omega[:count], _guessed(few[:, :count], functions))

    def _sums(self, bands: BandTables) -> Float[np.ndarray, "mn t"]:
        """A matrix that makes x^T S T x, for each of t tables T, of the products x_i x_(i + m)."""
        size = len(self.order)
        out = []
        for i, table in enumerate((*bands.in_plane, *bands.flap)):
            first = 0 if i < 9 else len(self.signs)
            padded_table = np.zeros((size, size))
            padded_table[first : first + len(table), first : first + len(table)] = table
            signs = np.append(self.signs, np.ones(size - len(self.signs)))
            left = padded_table * signs[:, None] if i < 7 else padded_table
            columns = band(left, self.diagonals).T
            columns[1:] *= 2
            out.append(columns.ravel())
        return np.stack(out, 1)

    def lowest(self, rotor: Rotor, speed: Scalar, named: Named) -> Lowest:
        found, beam = self.search(_numbers(rotor, speed), named), rotor.beam
        x = found.x[:, self.to_model] * beam.mass**-0.5
        omega = found.omega * beam.frequency_scale
        return Lowest(found._replace(omega=omega, x=x), rotor.steady_strain(speed), None)

    def _search(self, numbers: _Numbers, named: Named) -> Entries:
        g, (n_axial, n_in_plane, n_flap, _) = numbers.speed, self.most
        in_plane_guess, flap_guess = self._guess(numbers)
        terms = _in_plane(numbers)[: 3 if self.stretch else 2]
        in_plane = Pencil(*(_summed(self.whole, weights, g) for weights in terms))
        bending = self._bending_guess(in_plane_guess, n_in_plane, self.across)
        if self.stretch:
            axial = _axial_guess(numbers, n_axial, self.along)
            count = min(self.count, len(self.signs))
            groups = [coupled_modes(in_plane, self.is_axial, bending, axial, named, count)]
        else:
            groups = [transverse(in_plane, Direction.IN_PLANE, bending)]
        if n_flap:
            terms = _out_of_plane(numbers)[:2]
            flap = Pencil(*(_summed(self.flap, weights, g) for weights in terms))
            guess = self._bending_guess(flap_guess, n_flap, _unit(self.n_flap))
            groups.append(transverse(flap, Direction.FLAP, guess))
        return chosen(groups, named, self.count, len(self.to_model))

    def _guess(self, numbers: _Numbers) -> Any:
        """Guesses of bending in plane and in flap, both computed together; None without flap."""
        softness = numbers.softness if self.stretch else 0.0
        in_plane = _bending(numbers, 1.0, numbers.speed**2, softness)
        if not self.most[Direction.FLAP]:
            return self.few.guess(*in_plane), None
        flap = _bending(numbers, numbers.flap, 0.0, 0.0)
        both = jax.tree.map(lambda *each: jnp.stack(each), in_plane, flap)
        omega, few = self.few.guess(*both)
        return (omega[:, 0], few[:, :, 0]), (omega[:, 1], few[:, :, 1])

    def _forms(
        self, rotor: Rotor, speed: Scalar, x: Complex[Array, "k n"], state: Vector | None
    ) -> _BandForms:
        # Products x_i x_(i + m) for all diagonals m of the tables.
        beyond = jnp.pad(x[:, self.order], ((0, 0), (0, self.diagonals)))
        pairs = [x[:, self.order] * beyond[:, m : m + x.shape[1]] for m in range(self.diagonals)]
        every = jnp.concatenate(pairs, 1)
        shares = jax.lax.complex(every.real @ self.shares, every.imag @ self.shares).T

        numbers, scale = _numbers(rotor, speed), rotor.beam.frequency_scale

        def summed(*weights: dict[int, Any]) -> Array:
            each = (
                (shares[9 * i + t], w) for i, some in enumerate(weights) for t, w in some.items()
            )
            return functools.reduce(jnp.add, (share * weight for share, weight in each))

        groups = [_in_plane(numbers), *([_out_of_plane(numbers)] if self.n_flap else [])]
        stiffness, mass, coriolis = (summed(*same) for same in zip(*groups, strict=True))
        unit = rotor.beam.mass
        return unit * mass, unit * scale * coriolis, unit * scale**2 * stiffness


def _wide(tables: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The band arrays of symmetric matrices, all of the width of the widest."""
    width = width_of(*tables)
    return [band(table, width) for table in tables]


_RotorAtSpeed = tuple[Rotor, Scalar]  # a rotor and its speed


class _Elements(Bands):
    """Bands of finite elements, whose coordinates are ordered node by node."""

    def __init__(
        self, model: AbstractModel, bands: NodeByNode, most: ModeCounts, count: int
    ) -> None:
        n = bands.n_elements
        self.model, self.most, self.count = model, most, count
        nodes, basis = np.linspace(0.0, 1.0, n + 1), Polynomials()
        self.signs = np.tile([1.0, 1.0, -1.0, -1.0], n + 1)
        self.is_axial = self.signs[3:] < 0
        across, along = (_at_nodes(f(ritz.DEGREE, nodes)) for f in (basis.bending, basis.stretch))
        size = len(self.is_axial)
        self.across = _placed(np.flatnonzero(~self.is_axial), across[2:], size)
        self.along = _placed(np.flatnonzero(self.is_axial), along[1:], size)
        self.search = kernel(self._search)
        self.has_forms = bands.depends_on_four
        self.unit_forms = ElementForms(model, self.signs[3:])

    def lowest(self, rotor: Rotor, speed: Scalar, named: Named) -> Lowest:
        return Lowest(*self.search((rotor, speed), named))

    def _forms(
        self, rotor: Rotor, speed: Scalar, x: Complex[Array, "k n"], state: Vector | None
    ) -> _BandForms:
        assert state is not None
        numbers, scale, mass = _numbers(rotor, speed), rotor.beam.frequency_scale, rotor.beam.mass
        four = UnitBeam(numbers.speed, numbers.hub, numbers.tip, 1 / numbers.softness)
        unit = jax.lax.stop_gradient(state / rotor.beam.length)
        m, c, k = jax.lax.complex(*self.unit_forms(four, unit, jnp.stack([x.real, x.imag])))
        return mass * m, mass * scale * c, mass * scale**2 * k

    def _search(self, case: _RotorAtSpeed, named: Named) -> tuple[Entries, Number, Vector]:
        rotor, speed = case
        equations, numbers = self.model.equations(rotor), _numbers(rotor, speed)
        element: Any = equations.element  # type: ignore[attr-defined]
        q, (k, c), steady = _steady(equations, speed)
        few, scale = ritz.bending(self.most[Direction.IN_PLANE]), rotor.beam.frequency_scale
        omega, modes = few.guess(*_bending(numbers, 1.0, numbers.speed**2, numbers.softness))
        bending = Guess(scale * omega, _guessed(modes, self.across @ few.functions))
        axial = _axial_guess(numbers, self.most[Direction.AXIAL], self.along)
        axial = axial._replace(omega=scale * axial.omega)
        pencil = self._pencil(equations.mass, k, c)
        found = coupled_modes(pencil, self.is_axial, bending, axial, named, self.count)
        root = jnp.stack([jnp.zeros_like(q[0]), q[0] / equations.length])[:, None]
        strain = element.strain(root)[0]
        return found._replace(certain=found.certain * steady), strain, q

    def _pencil(self, mass: Any, k: BlockTridiagonal, c: BlockTridiagonal) -> Pencil:
        m = jnp.broadcast_to(mass.rows, k.rows.shape)
        # Since u moves in quadrature to w, signs of the Coriolis rows of u are changed.
        signed = c.rows * append_axes(self.signs.reshape(-1, 4, 1), k.rows.ndim - 3)
        return Pencil(*(_banded(rows) for rows in (k.rows, m, signed)))


def _steady(equations: Equations, speed: Number) -> tuple[Vector, Any, Number]:
    """The steady state by Newton's method, tangents K and C there, and whether it converged."""
    size, hub = jnp.broadcast_to(equations.length, speed.shape), spinning(speed)

    def go_on(state: tuple[Any, ...]) -> Array:
        return (state[0] < 21) & jnp.any(state[3] < 1)

    def improve(state: tuple[Any, ...]) -> tuple[Any, ...]:
        # A case that has converged stays in place, so that tangents are those at its state.
        i, q, near, _, _ = state
        rest = jnp.zeros_like(q)
        k, c = equations.tangents(hub, q, rest, None)
        step = k.inverse() @ equations.force(hub, q, rest, None)
        square = pairwise_sum(step**2) / size**2
        small, tiny = (jnp.where(square < most**2, 1.0, 0.0) for most in (1e-9, 1e-15))
        ended = jnp.maximum(near, tiny)
        q = jnp.where(ended < 1, q + step, q)
        return i + 1, q, jnp.maximum(near, small), ended, (k, c)

    zero = jnp.zeros((equations.mass.shape[0], *speed.shape), speed.dtype)
    zeros = jnp.zeros_like(speed)
    like = jax.eval_shape(equations.tangents, hub, zero, zero, None)
    nothing = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), like)
    state: tuple[Any, ...] = (jnp.zeros((), int), zero, zeros, zeros, nothing)
    _, q, _, done, tangents = jax.lax.while_loop(go_on, improve, state)
    return q, tangents, done


def _unit(n: int) -> Float[np.ndarray, "n d"]:
    """The matrix from polynomials of guesses to coordinates of n such polynomials."""
    return np.eye(n, ritz.DEGREE)


def _placed(places: Int[np.ndarray, " m"], rows: Float[np.ndarray, "m d"], size: int) -> np.ndarray:
    """A matrix of `size` rows with these rows at their places, and zeros elsewhere."""
    out = np.zeros((size, rows.shape[1]))
    out[places] = rows
    return out


def _at_nodes(functions: Functions) -> np.ndarray:
    """Values and slopes of functions at nodes, as rows in the order of coordinates of nodes."""
    rows = np.stack([functions.value, functions.slope], 1)
    return rows.reshape(-1, rows.shape[-1])


def _banded(rows: Float[Array, "k 4 12 *lanes"]) -> Band:
    longer = jnp.concatenate([rows, jnp.zeros_like(rows[:, :, :3])], 2)
    columns = jnp.stack([longer[:, i, 4 + i : 12 + i] for i in range(4)], 1)
    return columns.reshape(-1, *columns.shape[2:])[3:]
