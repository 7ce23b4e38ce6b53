"""Linearly implicit (Rosenbrock) integration of second-order systems."""

from typing import Any, ClassVar

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from jaxbeam._linalg import inverse
from jaxbeam._solvers.system import SecondOrderSystem, State, without_derivatives

# Rodas5P: G. Steinebach, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks
# within the Julia Differential Equations package, BIT 63:27 (2023). In the form that saves
# products with the Jacobian: (1/(h g) - J) U_i = f(t_i, y + sum a_ij U_j) + sum c_ij U_j / h
# + h d_i f_t.
_GAMMA = 0.21193756319429014
_A = (
    (3.0,),
    (2.849394379747939, 0.45842242204463923),
    (-6.954028509809101, 2.489845061869568, -10.358996098473584),
    (2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641),
    (
        -7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256,
        0.030198172008377946,
    ),
)  # fmt: skip
_C = (
    (-14.155112264123755,),
    (-17.97296035885952, -2.859693295451294),
    (147.12150275711716, -1.41221402718213, 71.68940251302358),
    (165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306),
    (
        24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125,
        -0.6610691825249471,
    ),
    (
        30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783,
        -19.097331116725623, -28.087943162872662,
    ),
    (
        37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047,
        -40.06618937091002, -54.66780262877968, -9.48861652309627,
    ),
)  # fmt: skip
_TIMES = (
    0,
    0.6358126895828704,
    0.4095798393397535,
    0.9769306725060716,
    0.4288403609558664,
    1,
    1,
    1,
)
_D = (
    _GAMMA, -0.42387512638858027, -0.3384627126235924, 1.8046452872882734, 2.325825639765069,
    0, 0, 0,
)  # fmt: skip
# Dense output of order 4: y0 + s (y1 - y0) + s (1 - s) (D_1 + s D_2 + s^2 D_3), D = _DENSE U.
_DENSE = np.array(
    [
        [
            25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204,
            0.524948541321073, 1.1241088310450404, 0.4272876194431874, -0.17202221070155493,
        ],
        [
            -9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796,
            20.176138334709044, 15.98066361424651, -6.789040303419874, -6.710236069923372,
        ],
        [
            11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643,
            -52.072871366152654, -59.78993625266729, -0.15582684282751913, 4.883087185713722,
        ],
    ]
)  # fmt: skip


def _square(rows: tuple[tuple[float, ...], ...]) -> np.ndarray:
    out = np.zeros((8, 8))
    for i, row in enumerate(rows):
        out[i + 1, : len(row)] = row
    return out


_WEIGHT, _COUPLING = _square(_A), _square(_C)
for _i in (6, 7):  # stiffly accurate: each of the last two stages starts where the one before ends
    _WEIGHT[_i] = _WEIGHT[_i - 1]
    _WEIGHT[_i, _i - 1] = 1.0


Stages = tuple[Any, Any]  # of q and v


def _integral_of_cubic(nodes: np.ndarray) -> np.ndarray:
    """From values at four nodes to increment, D_1, D_2, D_3 of the integral of the cubic there."""
    coefficients = np.linalg.inv(np.vander(nodes, increasing=True)) / np.arange(1, 5)[:, None]
    _, a2, a3, a4 = coefficients  # of s, ..., s^4
    return np.stack([coefficients.sum(0), -a4 - a3 - a2, -a4 - a3, -a4])


_NODES = (1 + np.polynomial.legendre.leggauss(4)[0]) / 2
_QUADRATURE = _integral_of_cubic(_NODES)


class RodasInterpolation(diffrax.AbstractLocalInterpolation):
    """Dense output of order 4 that, unlike Hermite's, does not amplify what is stiff."""

    t0: Any  # type: ignore[misc]
    t1: Any  # type: ignore[misc]
    y0: Any
    y1: Any
    d1: Any
    d2: Any
    d3: Any

    def evaluate(self, t0: Any, t1: Any | None = None, left: bool = True) -> Any:
        """As in diffrax: the value at t0, or the increment from t0 to t1."""
        if t1 is not None:
            return jax.tree.map(lambda a, b: b - a, self.evaluate(t0), self.evaluate(t1))
        width = self.t1 - self.t0
        s = jnp.where(width == 0, 0.0, (t0 - self.t0) / jnp.where(width == 0, 1.0, width))

        def one(y0: Any, y1: Any, d1: Any, d2: Any, d3: Any) -> Any:
            return y0 + s * (y1 - y0) + s * (1 - s) * (d1 + s * (d2 + s * d3))

        return jax.tree.map(one, self.y0, self.y1, self.d1, self.d2, self.d3)


class Rodas5P(diffrax.AbstractAdaptiveSolver):
    """Rosenbrock method of order 5 with an embedded one of order 4, for `SecondOrderSystem`.

    L-stable and stiffly accurate, no Newton iteration. Stages for q are eliminated, so that the
    one matrix of a step is n by n: M / (h g) + C + h g K. It is inverted once, which is as
    accurate as solving here and lets stages, and a batch, run on products alone.
    """

    term_structure: ClassVar = diffrax.ODETerm
    interpolation_cls: ClassVar = RodasInterpolation

    def order(self, terms: Any) -> int:
        """5."""
        return 5

    def error_order(self, terms: Any) -> int:
        """Local error of the embedded method."""
        return 5

    def init(self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem) -> None:
        """Nothing is kept from step to step."""

    def func(self, terms: Any, t0: Any, y0: State, args: SecondOrderSystem) -> State:
        """The first-order right-hand side."""
        return args.rate(t0, y0)

    def step(
        self, terms: Any, t0: Any, t1: Any, y0: State, args: SecondOrderSystem, solver_state: None,
        made_jump: Any,
    ) -> tuple[State, State, dict[str, State], None, Any]:  # fmt: skip
        """One step."""
        # In a batch, lanes that are done go on with steps of length zero, whose results are thrown
        # away; dividing by zero, or overflow in a long step, would still leave NaN in gradients.
        h = jnp.where(t1 == t0, 1e-9, t1 - t0)
        q, v, g = y0.q, y0.v, _GAMMA * h
        k, c = args.tangents(t0, q, v)
        solve = inverse(args.mass / g + c + g * k)
        _, force_rate = jax.jvp(lambda t: args.force(t, q, v), (t0,), (jnp.ones_like(t0),))

        def stage(done: Stages, row: Any) -> tuple[Stages, None]:
            i, weight, coupling, time, d = row
            at = tuple(y + weight @ u for y, u in zip((q, v), done, strict=True))
            past = tuple(coupling @ u / h for u in done)
            first = at[1] + past[0]
            right = args.force(t0 + time * h, *at) + args.mass @ past[1] + h * d * force_rate
            z = solve @ (right - g * (k @ first))
            new = (g * (first + z), z)
            return tuple(u.at[i].set(a) for u, a in zip(done, new, strict=True)), None

        zero = jnp.zeros((8, q.size), q.dtype)
        table = tuple(jnp.asarray(a, q.dtype) for a in (_WEIGHT, _COUPLING, _TIMES, _D))
        (x, z), _ = jax.lax.scan(stage, (zero, zero), (jnp.arange(8), *table))
        last = np.append(_WEIGHT[7, :7], 1.0)
        end = State(q + last @ x, v + last @ z, y0.work)
        dense = [State(row @ x, row @ z, jnp.zeros_like(y0.work)) for row in _DENSE]
        error = State(x[7], z[7], jnp.zeros_like(y0.work))
        done, *bends = self._work(args, t0, h, (y0, end, *dense))
        end = State(end.q, end.v, y0.work + done)
        dense = [State(d.q, d.v, bend) for d, bend in zip(dense, bends, strict=True)]
        info = {"y0": y0, "y1": end, "d1": dense[0], "d2": dense[1], "d3": dense[2]}
        return end, error, info, None, diffrax.RESULTS.successful

    def _work(self, args: SecondOrderSystem, t0: Any, h: Any, step: tuple[State, ...]) -> Any:
        """Increment and dense output of the work: quadrature along the dense output of the rest.

        It drives nothing, so it needs no stages of its own, and it carries no derivatives.
        """
        args, t0, h, step = without_derivatives((args, t0, h, step))
        along = RodasInterpolation(0.0, 1.0, *step)

        def power(s: Any) -> Any:
            y = along.evaluate(s)
            return args.power(t0 + h * s, y.q, y.v)

        return h * (_QUADRATURE @ jax.vmap(power)(jnp.asarray(_NODES, h.dtype)))
