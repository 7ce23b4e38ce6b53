"""How long fixed steps may be, and what adaptive explicit methods do at loose tolerance.

A table of the largest stable step of each integrator on each model, from the spectrum and by trial;
the amplification of a vibration by one step of each; and the spin-up of B Ref. 21 at every
tolerance, where explicit methods return successes that are nonsense, and the balance of energy
tells which.

    python studies/integrator_stability.py [--quick] [--out FOLDER]
"""

import functools
import time
from pathlib import Path
from typing import Any, NamedTuple

import common
import diffrax
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import ALUMINIUM, BLUE, GREEN, ORANGE, PURPLE, SKY, SPRINGS, VERMILION
from matplotlib.lines import Line2D

import jaxbeam as jb

ROTOR = jb.Rotor(jb.Beam.from_section(**ALUMINIUM))
SPRING_ROTOR = jb.papers.SpringRotor(*SPRINGS)
SPEEDS = (0.0, 2.0)  # rad/s
STEPS, GROWTH, TINY = 1000, 100.0, 1e-9  # TINY in m: far above rounding, and linear
WRONG = 0.05  # of the peak
TOP = 1e2  # where runs stand that ended early

EXPLICIT = (
    diffrax.Euler(), diffrax.Heun(), diffrax.Bosh3(), diffrax.Tsit5(), diffrax.Dopri5(),
    diffrax.Dopri8(),
)  # fmt: skip
SOLVERS = (*EXPLICIT, jb.solvers.Rodas5P())
COLOURS = {
    "Euler": "0.75", "Heun": "0.5", "Bosh3": ORANGE, "Tsit5": VERMILION, "Dopri5": PURPLE,
    "Dopri8": SKY, "Rodas5P": BLUE, "ChordKvaerno5": GREEN, "Magnus": "k",
}  # fmt: skip
MODELS = {
    "hybrid, 3 + 2 functions": jb.Hybrid(2, 3, 0),
    "Green, 2 elements": jb.papers.GreenANCF(2),
    "Model A, 2 elements": jb.papers.ANCF(2),
    "Model 0, 1 element": jb.papers.ChordANCF(1),
    "discrete, NC": jb.papers.DiscreteNC(),
    "discrete, LP": jb.papers.DiscreteLP(),
}
MARKERS = {"OK": "o", "UNBALANCED": "X", "DIVERGED": "^", "MAX_STEPS": "s", "STEP_FAILED": "D"}


def title(value: Any) -> str:
    return type(value).__name__


class Limit(NamedTuple):
    """A row of the table; steps in s, `observed` of implicit methods the longest one tried."""

    model: str
    angular_speed: float
    integrator: str
    highest_frequency: float  # rad/s
    theory: float
    observed: float


def growth(solver: Any, model: Any, rotor: Any, speed: Any, mode: Any, h: Any) -> Any:
    """Of the fastest mode, started as a trace on steady rotation, in STEPS steps of length h."""
    omega, shape, still = mode
    scene = jb.results.Scene(model, rotor, jb.ConstantSpeed(speed), jb.Loads(), jb.Damping())
    case = jb.solvers.SecondOrderSystem.term(solver), jnp.zeros_like(h), h
    start = jb.solvers.State(still + shape.real, -omega * shape.imag)

    def step(_: Any, carry: Any) -> Any:
        y, kept = carry
        y, _, _, kept, _ = solver.step(*case, y, scene, kept, False)
        return y, kept

    end, _ = jax.lax.fori_loop(0, STEPS, step, (start, solver.init(*case, start, scene)))
    return jnp.linalg.norm(jnp.concatenate([end.q - still, end.v / omega])) / TINY


def limits(name: str, model: Any, solvers: Any) -> list[Limit]:
    """Of one model: all integrators at all speeds."""
    rotor: Any = SPRING_ROTOR if model.rotor_type is jb.papers.SpringRotor else ROTOR
    settings: dict[str, Any] = {"steps": STEPS, "growth": GROWTH}
    modes = []
    for speed in SPEEDS:
        found = jb.modes(model, rotor, speed, len(model.directions))
        k = int(jnp.argmax(found.frequency))
        shape = found.shape[k] * TINY / jnp.linalg.norm(found.shape[k])
        still = jb.steady_start(model, rotor, jb.ConstantSpeed(speed)).q
        modes.append((found.frequency[k], shape, still))
    rows = []
    runs = {
        solver: jax.jit(
            jax.vmap(
                lambda s, mode, h, solver=solver: growth(solver, model, rotor, s, mode, h),
                (None, None, 0),
            )
        )
        for solver in solvers
    }
    for speed, mode in zip(SPEEDS, modes, strict=True):
        for solver, run in runs.items():
            theory = float(jb.solvers.stable_step(model, rotor, speed, solver, **settings).step)
            bounds = theory / 2, 1.5 * theory
            if np.isinf(theory):
                explicit = jb.solvers.stable_step(model, rotor, speed, EXPLICIT[-1], **settings)
                bounds = 0.0, 100 * float(explicit.step)
            for _ in range(3):  # sixteen steps at a time
                steps = np.linspace(*bounds, 17)
                grows = ~(np.asarray(run(speed, mode, jnp.asarray(steps[1:]))) <= GROWTH)
                if not grows.any():
                    bounds = (steps[-1], steps[-1])
                    break
                bounds = (steps[np.argmax(grows)], steps[1 + np.argmax(grows)])
            rows.append(Limit(name, speed, title(solver), float(mode[0]), theory, bounds[0]))
    return rows


def table(out: Path, quick: bool) -> None:
    """Print and write it."""
    models = dict(list(MODELS.items())[:: 5 if quick else 1])
    solvers = SOLVERS[3::3] if quick else SOLVERS
    parts = common.together(lambda name: limits(name, models[name], solvers), models)
    rows = [row for part in parts for row in part]
    common.write_csv(out / "stable_steps.csv", Limit._fields, rows)
    print(f"largest step by which {STEPS} steps multiply a vibration by {GROWTH:g} at most, in ms:")
    print("theory, and in brackets by trial (of implicit methods: the longest one tried)")
    print(" " * 31 + "".join(f"{title(solver):>18s}" for solver in solvers))
    for k in range(0, len(rows), len(solvers)):
        own = rows[k : k + len(solvers)]
        cells = [f"{1e3 * r.theory:.4g} ({1e3 * r.observed:.4g})" for r in own]
        line = "".join(f"{cell:>18s}" for cell in cells)
        print(f"{own[0].model:24s}{own[0].angular_speed:g} rad/s{line}")
    gaps = [abs(r.observed / r.theory - 1) for r in rows if np.isfinite(r.theory)]
    print(f"largest gap between theory and trial: {100 * max(gaps):.2f} %", flush=True)


def grown(solver: diffrax.AbstractSolver, angle: jax.Array) -> jax.Array:
    """By what a step multiplies the amplitude of a vibration; NaN where it fails."""
    return jb.solvers.amplification(solver, angle, throw=False).factor


def draw_amplification(out: Path, quick: bool) -> None:
    """Near the limits, and far beyond."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 4.6), layout="constrained")
    ranges = np.linspace(0.01, 5, 300), np.geomspace(0.1, 1000, 300)
    solvers = SOLVERS[::3] if quick else (*SOLVERS, jb.solvers.ChordKvaerno5(), jb.solvers.Magnus())
    columns = []
    for solver in solvers:
        name = title(solver)
        sizes = jax.jit(jax.vmap(functools.partial(grown, solver)))
        for ax, angles in zip(axes, ranges, strict=True):
            size = np.asarray(sizes(jnp.asarray(angles)))
            dash = "-" if solver in EXPLICIT else (0, (5, 2))
            ax.plot(angles, size, color=COLOURS[name], ls=dash, lw=1.8, label=name)
        columns.append(size)
    common.write_csv(
        out / "amplification.csv", ["angle_rad", *map(title, solvers)],
        np.column_stack([ranges[1], *columns]),
    )  # fmt: skip
    for ax in axes:
        ax.axhline(1, color="0.85", lw=6, zorder=0)
        ax.set_xlabel("step times frequency, $h\\omega$ (rad)")
        ax.grid(color="0.93")
    axes[0].set(ylim=(0.7, 1.5), xlim=(0, 5), ylabel="amplification of a vibration by one step")
    axes[1].set(xscale="log", yscale="log", ylim=(1e-3, 1e4), xlim=(0.1, 1000))
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5)
    common.save_figure(figure, out / "amplification.png", dpi=120)


class Run(NamedTuple):
    """A spin-up at one tolerance."""

    integrator: str
    tolerance: float
    error: float  # of the tip deflection, over the peak; infinite where the run ended early
    status: str
    imbalance: float
    steps: int


def spin_ups(quick: bool) -> list[Run]:
    """B Ref. 21 to 4 rad/s in 15 s, past the largest lag at 6.9 s; all tolerances at once."""
    model = jb.papers.GreenANCF(1 if quick else 2)
    case = model, ROTOR, jb.SmoothSpinUp(4.0, 15.0), jnp.linspace(0.0, 8.0, 81)
    tight = diffrax.PIDController(rtol=1e-10, atol=1e-11)
    exact = np.asarray(jb.simulate(*case, stepsize_controller=tight).tip[:, 1])
    tolerances = 10.0 ** -np.arange(1, 9, 2 if quick else 1)

    def all_of(solver: Any) -> list[Run]:
        def one(tolerance: Any) -> Any:
            atol = tolerance * ROTOR.beam.length / 10
            run = jb.simulate(
                *case, solver=solver, max_steps=10**6, throw=False,
                stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=atol),
            )  # fmt: skip
            worst = jnp.max(jnp.abs(jnp.where(jnp.isnan(run.imbalance), 0, run.imbalance)))
            return run.partial.tip[:, 1], run.status, worst, run.solution.stats["num_steps"]

        tips, status, worst, steps = jax.jit(jax.vmap(one))(jnp.asarray(tolerances))
        error = np.max(np.abs(np.asarray(tips) - exact), 1) / np.max(np.abs(exact))
        error = np.where(np.isfinite(error), error, np.inf)
        return [
            Run(title(solver), float(t), float(e), jb.Status(int(s)).name, float(w), int(n))
            for t, e, s, w, n in zip(tolerances, error, status, worst, steps, strict=True)
        ]

    solvers = [diffrax.Tsit5(), diffrax.Dopri8(), diffrax.Bosh3(), jb.solvers.Rodas5P()]
    if not quick:
        solvers.insert(1, diffrax.Dopri5())
    return [run for part in common.together(all_of, solvers) for run in part]


def report(out: Path, runs: list[Run]) -> None:
    """Print, write and draw them."""
    common.write_csv(out / "loose_tolerance.csv", Run._fields, runs)
    figure, ax = plt.subplots(figsize=(7.5, 5.6), layout="constrained")
    names = list(dict.fromkeys(run.integrator for run in runs))
    for k, name in enumerate(names):
        own = [run for run in runs if run.integrator == name]
        # Beside each other where all of them fail.
        x = [run.tolerance * 1.12 ** (k - len(names) / 2) for run in own]
        y = [min(run.error, TOP) for run in own]
        ax.plot(x, y, color=COLOURS[name], lw=1, zorder=1)
        for at, error, run in zip(x, y, own, strict=True):
            face = COLOURS[name] if run.status != "OK" else "w"
            ax.plot(at, error, MARKERS.get(run.status, "*"), mfc=face, mec=COLOURS[name], ms=8)
    ax.axhline(WRONG, color="0.6", ls=":", lw=1)
    beside: dict[str, Any] = {"transform": ax.get_yaxis_transform(), "color": "0.4", "fontsize": 9}
    ax.text(0.02, WRONG * 1.4, f"{100 * WRONG:g} % of the peak", **beside)
    ax.axhspan(TOP / 3, TOP * 3, color="0.93", zorder=0)
    ax.text(0.02, TOP, "ended early", va="center", **beside)
    ax.set(
        xscale="log", yscale="log", ylim=(1e-12, TOP * 3), xlabel="tolerance",
        ylabel="largest error of the tip deflection over its peak",
    )  # fmt: skip
    seen = [name for name in MARKERS if any(run.status == name for run in runs)]
    handles: list[Any] = [Line2D([], [], color=COLOURS[name], label=name) for name in names]
    handles += [
        Line2D([], [], ls="", marker=MARKERS[s], mec="0.3", mfc="w" if s == "OK" else "0.3",
               label=s, ms=8)
        for s in seen
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=9)
    common.save_figure(figure, out / "loose_tolerance.png", dpi=120)
    print("spin-up of B Ref. 21 with adaptive steps")
    for run in runs:
        print(
            f"  {run.integrator:9s} {run.tolerance:5.0e} error {run.error:8.1e} {run.status:10s} "
            f"imbalance {run.imbalance:7.0e} {run.steps:7d} steps"
        )
    wrong = [run for run in runs if not run.error <= WRONG]
    missed = [run for run in wrong if run.status == "OK"]
    strict = [run for run in runs if run.error <= WRONG and run.status != "OK"]
    print(f"wrong by more than {100 * WRONG:g} %: {len(wrong)}; of these not caught: {len(missed)}")
    print(f"tip right to {100 * WRONG:g} %, but energy out of balance: {len(strict)}")


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figures and tables."""
    began = time.perf_counter()
    out = common.folder(out, "integrator_stability")
    for part in (table, draw_amplification):
        part(out, quick)
        print(f"  {time.perf_counter() - began:.0f} s", flush=True)
    report(out, spin_ups(quick))
    return common.finish(began, "figures and tables are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer models and tolerances", "the figures and tables")
