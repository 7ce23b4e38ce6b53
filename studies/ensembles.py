"""What a batch is worth: the same cases in one batch, and one after the other, in one run.

Spin-ups of B Ref. 21 (8 elements, 1 to 6 rad/s) by one plain `jax.vmap` and through `sweep`, a
batch of very different numbers of steps, the gradient of a batch, and lowest modes with labels,
shapes and flap (`fit_experiment.py` has fits); and the operations of a step, counted in the traced
program, beside the clock. Times are without compilation, medians of repeated runs; ratios are
between lines of the same run. On one core: `taskset -c 0 python studies/ensembles.py`.

    python studies/ensembles.py [--quick] [--out FOLDER]
"""

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import common
import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from common import ALUMINIUM

import jaxbeam as jb

REF_21 = jb.Beam.from_section(**ALUMINIUM)
DURATION, ELEMENTS = 15.0, 8
TIMES = np.linspace(0.0, 20.0, 201)
MODEL = jb.PlanarRod(ELEMENTS)


class Line(NamedTuple):
    """One ratio, and what it is made of."""

    what: str
    cases: int
    seconds: float  # a case
    against: str
    ratio: float


def seconds(repeats: int, function: Callable[..., Any], *args: Any) -> tuple[float, Any]:
    """Median of runs after the first one, which compiles; and the result."""
    jax.block_until_ready(function(*args))
    return common.timed(repeats, function, *args, patience=20)


def spin_up(speed: Any, tolerance: Any = 1e-4, rotor: Any = None) -> Any:
    """A run, with what it is asked for: its peak, and its number of steps."""
    control = diffrax.PIDController(rtol=tolerance, atol=tolerance)
    rotor = jb.Rotor(REF_21) if rotor is None else rotor
    run = jb.simulate(
        MODEL, rotor, jb.SmoothSpinUp(speed, DURATION), TIMES, stepsize_controller=control,
        throw=False,
    )  # fmt: skip
    return run.peak()[0], run.solution.stats["num_steps"]


def spin_ups(quick: bool) -> list[Line]:
    """Batches of runs over a loop of them, and a mixed batch over the sum of its own steps."""
    repeats = 1 if quick else 3
    single, batch = jax.jit(spin_up), jax.jit(jax.vmap(spin_up))
    lines = []
    for size in (64,) if quick else (64, 256):
        speeds = jnp.linspace(1.0, 6.0, size)
        together, _ = seconds(repeats, batch, speeds)
        some = speeds[:: 4 if quick else 1]
        alone, _ = seconds(repeats, lambda some=some: [single(s) for s in some])
        ratio = alone / len(some) / (together / size)
        lines.append(Line("spin-ups, one jax.vmap", size, together / size, "a loop", ratio))

    def peak(speed: Any) -> Any:
        return spin_up(speed)[0]

    def through_sweep() -> Any:
        return jb.sweep(peak, jb.grid(speed=speeds)).values["value"]

    swept, _ = seconds(repeats, through_sweep)
    ratio = alone / len(some) / (swept / size)
    lines.append(Line("spin-ups, sweep", size, swept / size, "a loop", ratio))

    like, steps = seconds(repeats, batch, jnp.full(size, 4.0))
    each = like / float(jnp.sum(steps[1]))
    exponents = jnp.linspace(-8.5, -2.0, size)
    tolerances = 10.0 ** jax.random.permutation(jax.random.key(1), exponents)
    mixed, (_, count) = seconds(
        repeats, jax.jit(jax.vmap(spin_up)), jnp.full(size, 4.0), tolerances
    )
    ratio = mixed / (each * float(jnp.sum(count)))
    spread = f"its own steps ({int(count.min())} to {int(count.max())})"
    lines.append(Line("mixed batch", size, mixed / size, spread, ratio))
    return lines


def gradients(quick: bool) -> list[Line]:
    """The mean peak of a batch, and its gradient by five parameters."""
    size = 32 if quick else 256
    beam = REF_21
    stiffness = beam.axial_stiffness, beam.in_plane_bending_stiffness
    at = jnp.stack([beam.mass_per_length, *stiffness, 0.1, 0.05])
    speeds = jnp.linspace(1.0, 6.0, size)

    def mean(p: Any) -> Any:
        rotor = jb.Rotor(jb.Beam(beam.length, p[0], p[1], p[2], p[2]), p[3], p[4])
        return jnp.mean(jax.vmap(lambda s: spin_up(s, rotor=rotor)[0])(speeds))

    forward, _ = seconds(1 if quick else 3, jax.jit(mean), at)
    reverse, _ = seconds(1 if quick else 3, jax.jit(jax.value_and_grad(mean)), at)
    return [Line("gradient of the mean peak", size, reverse / size, "the batch", reverse / forward)]


def modes(quick: bool) -> list[Line]:
    """Lowest modes with labels, shapes and flap, in a batch and by dense matrices case by case."""
    table = common.random_cases(400 if quick else 10_000, seed=5)
    lines = []
    for name, model, which in (
        ("modes, 16 + 8 + 16 polynomials", jb.Hybrid(8, 16, 16), jb.labels(in_plane=2, flap=1)),
        ("modes, 10 elements", jb.papers.ANCF(10), jb.labels(in_plane=3)),
    ):

        def one(case: Any, model: Any = model, which: Any = which) -> Any:
            rotor, speed = common.rotating(case)
            found = jb.modes(model, rotor, speed, which, throw=False)
            return found.frequency, found.shape, found.status

        batch = jax.jit(jax.vmap(one))
        many, _ = seconds(1 if quick else 5, batch, table)
        few, _ = seconds(1 if quick else 5, batch, table[:200])
        each = many / len(table)
        lines.append(Line(name, len(table), each, "case by case", few / 200 / each))
    return lines


def operations(quick: bool) -> list[Line]:
    """Those of a step of 8 elements, from its traced program, and how many a second a core does."""
    rotor, h, n = jax.tree.map(jnp.asarray, jb.Rotor(REF_21)), 0.05, 4 * ELEMENTS + 1
    motion, solver = jb.SmoothSpinUp(4.0, DURATION), jb.solvers.Rodas5P()
    scene = jb.results.Scene(MODEL, rotor, motion, jb.Loads(), jb.Damping())

    def step(q: Any, v: Any) -> Any:
        t = jnp.asarray(3.0)
        y = solver.step(None, t, t + h, jb.solvers.State(q, v), scene, None, False)[0]
        return 1e-3 * y.q, 1e-3 * y.v

    zero = jnp.zeros(n)
    count = _flops(jax.make_jaxpr(step)(zero, zero).jaxpr)
    rounds, lanes = 200, 32
    start = jnp.full((lanes, n), 1e-3), jnp.full((lanes, n), 1e-3)

    def one_lane(q: Any, v: Any) -> Any:
        return jax.lax.fori_loop(0, rounds, lambda _, y: step(*y), (q, v))

    many = jax.jit(jax.vmap(one_lane))
    taken, _ = seconds(5, many, *start)
    each = taken / rounds / lanes
    size = 64
    factor = jnp.full((size, size), 1e-2)
    product = jax.jit(
        lambda a: jax.lax.fori_loop(0, 2000, lambda _, b: jnp.tanh(0 * b[:1, :1]) + a @ b, a)
    )
    peak = 2 * size**3 * 2000 / seconds(5, product, factor)[0]
    print(f"  a step has {count:,} operations: {count / each / 1e9:.1f} Gflop/s a core;")
    print(f"  products of {size} by {size} matrices, by a library: {peak / 1e9:.1f} Gflop/s")
    ratio = count / each / peak
    return [Line("operations of a step a second", count, each, "those of a library", ratio)]


def _flops(jaxpr: Any) -> int:
    """Additions, multiplications, divisions and roots of a program that is known to run through
    every loop to its end."""
    total = 0
    for equation in jaxpr.eqns:
        name, inner, times = equation.primitive.name, equation.params, 1
        if name in ("add", "sub", "mul", "div", "sqrt", "integer_pow", "add_any", "neg"):
            aval = equation.outvars[0].aval
            total += math.prod(aval.shape) if jnp.issubdtype(aval.dtype, jnp.inexact) else 0
        elif name == "reduce_sum":
            total += math.prod(equation.invars[0].aval.shape)
        elif name == "dot_general":
            (left, _), _ = inner["dimension_numbers"]
            shared = math.prod(equation.invars[0].aval.shape[i] for i in left)
            total += 2 * shared * math.prod(equation.outvars[0].aval.shape)
        elif name == "scan":
            times = inner["length"]
        if name == "cond":
            total += max(_flops(branch.jaxpr) for branch in inner["branches"])
            continue
        if name == "custom_linear_solve":
            total += _flops(inner["jaxprs"].solve.jaxpr)
            continue
        if name == "while":
            total += 4 * _flops(inner["body_jaxpr"].jaxpr)  # of blocks of four
            continue
        for value in inner.values():
            if isinstance(value, jax.extend.core.ClosedJaxpr):
                total += times * _flops(value.jaxpr)
    return total


PARTS: tuple[Callable[[bool], list[Line]], ...] = (spin_ups, gradients, modes, operations)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the table."""
    began = time.perf_counter()
    out = common.folder(out, "ensembles")
    lines: list[Line] = []
    for part in PARTS:
        print((part.__doc__ or "").split("\n")[0], flush=True)
        for line in part(quick):
            lines.append(line)
            print(
                f"  {line.what:46s}{line.cases:6d} cases {1e6 * line.seconds:12.1f} us each,"
                f" over {line.against}: {line.ratio:.3g}",
                flush=True,
            )
    common.write_csv(out / "ensembles.csv", Line._fields, lines)
    return common.finish(began, "the table is", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer cases", "the table")
