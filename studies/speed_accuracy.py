"""Speed against accuracy: which model, discretisation and integrator to take for an error.

Three motions (a gentle spin-up, B Ref. 21 at 4 rad/s, and the abrupt one of Y Fig. 4, up to
three quarters of the length) and the frequencies of a beam at low and at high speed. The reference
is the geometrically exact rod throughout (32 elements in motion, 16 with --quick; 64 and 48 for
frequencies). In motion the error is the largest difference of the tip deflection over the run from
it, over the peak: it holds what the theory, the discretisation and the integrator leave. Wall time
is that of a case after compilation, alone and in a batch. In each panel the front is named: what is
cheapest for errors of 1e-1, 1e-2, ... Failures stand in a band of their own, and beside it their
names. `cheapest.csv` says for each error what to take, and what that costs.

    python studies/speed_accuracy.py [--quick] [--out FOLDER]
"""

import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import common
import diffrax
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import ALUMINIUM, STIFF
from matplotlib.ticker import LogLocator, NullFormatter

import jaxbeam as jb

REF_21 = jb.Beam.from_section(**ALUMINIUM)
POINTS, LANES = 101, 32
DECADES = tuple(10.0**-k for k in range(1, 7))  # errors that somebody may ask for
THEORIES = {  # the first word of a model's name
    "exact": "tab:green", "hybrid": "tab:blue", "von": "tab:purple", "classical": "tab:brown",
    "Model": "tab:orange",
}  # fmt: skip
PATIENCE = 0.5  # s, after which a run is not repeated


class Scene(NamedTuple):
    """One motion of one rotor."""

    title: str
    rotor: jb.Rotor
    duration: float
    smooth: float  # rad/s, B eq. 13
    quintic: float  # rad/s, Y eq. 21
    end: float


SCENES = (
    Scene("gentle: B Ref. 21, 0.5 rad/s", jb.Rotor(REF_21), 15.0, 0.5, 0.0, 20.0),
    Scene("B Ref. 21, 4 rad/s", jb.Rotor(REF_21), 15.0, 4.0, 0.0, 20.0),
    Scene("abrupt: Y Fig. 4", jb.Rotor(jb.Beam(*STIFF)), 1.0, 0.0, 0.31, 10.0),
)


class Method(NamedTuple):
    """A solver, what its setting means, and the settings tried."""

    name: str
    solver: Any
    adaptive: bool
    settings: tuple[float, ...]  # tolerances, or steps over the duration of the run
    batched: bool = True


ADAPTIVE = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
STEPS = (1 / 25, 1 / 50, 1 / 100, 1 / 200, 1 / 400, 1 / 800)
RODAS5P = Method("Rodas5P", jb.solvers.Rodas5P(), True, ADAPTIVE)
RODAS4P = Method("Rodas4P", jb.solvers.Rodas4P(), True, ADAPTIVE)
CHORD = Method("ChordKvaerno5", jb.solvers.ChordKvaerno5(), False, STEPS)
MAGNUS = Method("Magnus", jb.solvers.Magnus(), False, STEPS)
KENCARP = Method("diffrax KenCarp4", diffrax.KenCarp4(), True, ADAPTIVE[2:4], batched=False)
DOPRI = Method("diffrax Dopri5", diffrax.Dopri5(), True, ADAPTIVE)


def pairs(quick: bool) -> list[tuple[str, Any, Method]]:
    """What is tried."""
    elements: list[tuple[str, Any]] = [
        ("exact, 8 elements", jb.ExactRodANCF(8)), ("exact, 4 elements", jb.ExactRodANCF(4)),
        ("Model A, 8 elements", jb.ANCF(8)), ("exact, 16 elements", jb.ExactRodANCF(16)),
        ("Model 0, 8 elements", jb.models.ChordANCF(8)),
    ]  # fmt: skip
    linear: list[tuple[str, Any]] = [
        ("hybrid, 4 + 3 functions", jb.Hybrid(3, 4, 0)),
        ("hybrid, 2, no stretch", jb.Hybrid(0, 2, 0)),
        ("hybrid, 6, no stretch", jb.Hybrid(0, 6, 0)),
        ("classical, 4 + 3", jb.Classical(3, 4, 0)),
    ]
    out = [(name, model, RODAS5P) for name, model in elements[: 1 if quick else 5]]
    out += [(name, model, MAGNUS) for name, model in linear[: 1 if quick else 4]]
    if not quick:
        green = elements[0]
        out += [(*green, RODAS4P), (*green, CHORD), (*green, KENCARP)]
        out += [(*linear[0], RODAS5P), (*linear[2], RODAS5P), (*linear[2], DOPRI)]
        out += [("von Karman, 4 + 8", jb.VonKarman(8, 4, 0), RODAS5P)]
    return out


class Point(NamedTuple):
    """One measurement of the chart."""

    scene: str
    model: str
    integrator: str
    setting: float
    error: float
    alone: float  # ms
    batched: float  # ms a case; NaN where it was not tried
    compilation: float  # s, of the case alone
    status: str


def tip(scene: Any, model: Any, method: Method, share: Any, setting: Any) -> tuple[Any, Any]:
    """Deflection at the times of the scene, and the status; `scene` is traced."""
    rotor, duration, smooth, quintic, end = scene
    motion = common.spin_up(duration, quintic * share, smooth * share)
    run = jb.simulate(
        model, rotor, motion, jnp.linspace(0.0, 1.0, POINTS) * end,
        solver=method.solver, dt0=None if method.adaptive else setting * end,
        stepsize_controller=(
            diffrax.PIDController(rtol=setting, atol=setting * rotor.beam.length / 10)
            if method.adaptive
            else diffrax.ConstantStepSize()
        ),
        max_steps=1_000_000, throw=False,
    )  # fmt: skip
    return run.tip[:, 1], run.status


def motions(quick: bool) -> list[Point]:
    """All pairs in all scenes."""
    repeats = 1 if quick else 3
    scenes = SCENES[1:] if quick else SCENES
    given = [jax.tree.map(jnp.asarray, tuple(s)[1:]) for s in scenes]
    judge, fine = (jb.ExactRodANCF(16), 1e-8) if quick else (jb.ExactRodANCF(32), 1e-9)
    exact = jax.jit(lambda g: tip(g, judge, RODAS5P, 1.0, fine)[0])
    references = [np.asarray(exact(g)) for g in given]
    shares = jnp.asarray(np.linspace(1.0, 0.9, LANES))
    points: list[Point] = []
    for name, model, method in pairs(quick):
        alone = jax.jit(lambda g, x, m=model, how=method: tip(g, m, how, 1.0, x))
        batch = jax.jit(
            jax.vmap(lambda g, s, x, m=model, how=method: tip(g, m, how, s, x), (None, 0, None))
        )
        compilation, _ = common.timed(1, alone, given[0], method.settings[0])
        batched = method.batched and not (quick and points)  # then, of the first pair alone
        if batched:
            jax.block_until_ready(batch(given[0], shares, method.settings[0]))
        for scene, g, reference in zip(scenes, given, references, strict=True):
            for setting in method.settings[:: 2 if quick else 1]:
                one, (found, status) = common.timed(repeats, alone, g, setting, patience=PATIENCE)
                many = np.nan
                if batched:
                    half = max(1, repeats // 2)
                    many, _ = common.timed(half, batch, g, shares, setting, patience=PATIENCE)
                error = float(np.max(np.abs(found - reference)) / np.max(np.abs(reference)))
                if int(status) or not error < 1:
                    error = np.inf
                points.append(
                    Point(
                        scene=scene.title, model=name, integrator=method.name, setting=setting,
                        error=error, alone=1e3 * one, batched=1e3 * many / LANES,
                        compilation=compilation, status=jb.Status(int(status)).name,
                    )
                )  # fmt: skip
        print(f"  {name:24s} {method.name:18s} compiled in {compilation:4.1f} s", flush=True)
    return points


def eigenvalues(quick: bool) -> list[Point]:
    """Lowest three in plane of a beam of slenderness 500 with hub and tip mass. The steady strain,
    3e-4 at the higher speed, is what linear theories leave out."""
    cases = 320 if quick else 3200
    points = []
    for gamma in (12.0,) if quick else (1.0, 12.0):
        title = f"frequencies, speed {gamma:g} sqrt(EI / rho L^4)"
        speeds = jnp.asarray(gamma * np.linspace(1.0, 0.95, cases))

        def at(speed: Any) -> tuple[jb.Rotor, Any]:
            return jb.Rotor(jb.Beam(1.0, 1.0, 500.0**2, 1.0, 1.0), 0.5, 0.2), speed

        def by_modes(model: Any) -> Callable[[Any], Any]:
            return lambda s: jb.modes(model, *at(s), 3, throw=False).frequency

        judge = jb.ExactRodANCF(48 if quick else 64)
        exact = np.asarray(jax.jit(by_modes(judge))(gamma))
        tried: list[tuple[str, Any]] = []
        for n in (8, 16) if quick else (6, 8, 10, 12, 16, 24):
            name, model = f"hybrid, {n} + {n // 2} functions", jb.Hybrid(n // 2, n, 0)
            tried.append((name, by_modes(model)))
        for n in (10,) if quick else (4, 10, 20):
            tried.append((f"Model A, {n} elements", by_modes(jb.ANCF(n))))
            tried.append((f"exact, {n} elements", by_modes(jb.ExactRodANCF(n))))
        for name, function in tried:
            alone, batch = jax.jit(function), jax.jit(jax.vmap(function))
            compilation, _ = common.timed(1, alone, gamma)
            jax.block_until_ready(batch(speeds))
            one, found = common.timed(3 if quick else 9, alone, gamma, patience=PATIENCE)
            many, _ = common.timed(1 if quick else 3, batch, speeds, patience=PATIENCE)
            error = float(np.max(np.abs(np.asarray(found) / exact - 1)))
            good = np.isfinite(error)
            points.append(
                Point(
                    scene=title, model=name, integrator="modes", setting=np.nan,
                    error=max(error, 1e-15) if good else np.inf, alone=1e3 * one,
                    batched=1e3 * many / cases, compilation=compilation,
                    status="OK" if good else "FAILED",
                )
            )  # fmt: skip
    return points


def front(points: Sequence[Point], cost: Callable[[Point], float]) -> list[Point]:
    """Those that no other beats in both error and cost, cheapest first."""
    best: list[Point] = []
    for point in sorted(points, key=cost):
        if np.isfinite(point.error + cost(point)) and (not best or point.error < best[-1].error):
            best.append(point)
    return best


def cheapest(points: Sequence[Point], cost: Callable[[Point], float]) -> dict[float, Point]:
    """What is cheapest for each of `DECADES`, where anything is good enough."""
    best = front(points, cost)
    found = {most: [p for p in best if p.error <= most] for most in DECADES}
    return {most: few[0] for most, few in found.items() if few}


def name_of(point: Point) -> str:
    """What was tried, in few words."""
    setting = "" if np.isnan(point.setting) else f" {point.setting:.2g}"
    by = "" if point.integrator == "modes" else f", {point.integrator}{setting}"
    return f"{point.model}{by}"


def draw(path: Path, points: Sequence[Point], scenes: Iterable[str]) -> None:
    """Alone above, batched below; one column a scene."""
    scenes = list(scenes)
    figure, axes = plt.subplots(
        2, len(scenes), figsize=(7.4 * len(scenes), 11.5), layout="constrained", squeeze=False
    )
    costs: tuple[tuple[str, Callable[[Point], float]], ...] = (
        ("alone", lambda p: p.alone),
        (f"in a batch of {LANES} or more, one core", lambda p: p.batched),
    )
    for row, (what, cost) in zip(axes, costs, strict=True):
        for ax, scene in zip(row, scenes, strict=True):
            panel(ax, [p for p in points if p.scene == scene and np.isfinite(cost(p))], cost)
            ax.set(title=scene, ylabel=f"wall time, {what} (ms)")
    there = {p.model.split()[0].rstrip(",") for p in points}
    titles = {"von": "von Karman", "Model": "Models A and 0"}
    handles = [
        plt.Line2D([], [], color=c, marker="o", ls="none", label=titles.get(n, n))
        for n, c in THEORIES.items()
        if n in there
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    common.save_figure(figure, path, dpi=110)


def panel(ax: Any, here: Sequence[Point], cost: Callable[[Point], float]) -> None:
    """One scene: all points, the front with its names, and what failed in a band of its own."""
    good = [p for p in here if np.isfinite(p.error)]
    left, right = min(p.error for p in good), max(p.error for p in good)
    width = max(np.log10(right / left), 1.0)
    # Names stand left of the front, where nothing can be: nothing beats it in both.
    low, band = left / 10 ** (0.6 + 1.1 * width), right * 10 ** (0.14 * width)
    ax.set(xscale="log", yscale="log", xlim=(low, band * 10 ** (0.1 * width)))
    ax.axvspan(band / 10 ** (0.07 * width), ax.get_xlim()[1], color="0.93", zorder=0)
    for p in here:
        colour = THEORIES[p.model.split()[0].rstrip(",")]
        x, marker = (p.error, "o") if np.isfinite(p.error) else (band, "x")
        ax.plot(x, cost(p), color=colour, ms=4.5, ls="none", marker=marker, alpha=0.8)
    best = front(here, cost)
    ax.plot([p.error for p in best], [cost(p) for p in best], color="k", lw=1.2, zorder=1)
    ax.margins(y=0.08)
    bottom, top = np.log10(ax.get_ylim())
    height = np.inf
    for p in reversed(list(dict.fromkeys(cheapest(here, cost).values()))):
        at = (np.log10(cost(p)) - bottom) / (top - bottom)
        height = min(at, height - 0.04)
        ax.annotate(
            name_of(p), (p.error, cost(p)), (-10, height), fontsize=7.5, ha="right", va="center",
            textcoords=("offset points", "axes fraction"),
            arrowprops={"arrowstyle": "-", "lw": 0.5, "color": "0.5"},
        )  # fmt: skip
    failed: dict[tuple[str, str], list[float]] = {}
    for p in here:
        if not np.isfinite(p.error):
            failed.setdefault((p.model, p.integrator), []).append(p.setting)
    names = [
        f"{model}, {by} " + ", ".join(f"{s:.2g}" for s in sorted(settings))
        for (model, by), settings in failed.items()
    ]
    said = ["failed, at", *names] if names else ["nothing failed"]
    ax.text(1.015, 1.0, "\n".join(said), fontsize=6, transform=ax.transAxes, va="top", color="0.3")
    timed = any(np.isfinite(p.setting) for p in here)
    ax.set_xlabel("largest error / peak (-)" if timed else "largest relative error (-)")
    ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ax.yaxis.set_major_formatter("{x:g}")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())
    ax.grid(alpha=0.3)


def advice(points: Sequence[Point]) -> list[tuple[str, float, str, float, str, float]]:
    """For each scene and error what is cheapest alone and in a batch, and its ms a case."""
    rows = []
    for scene in dict.fromkeys(p.scene for p in points):
        here = [p for p in points if p.scene == scene]
        alone, batched = (cheapest(here, cost) for cost in (lambda p: p.alone, lambda p: p.batched))
        for most in DECADES:
            one, many = alone.get(most), batched.get(most)
            rows.append((
                scene, most, name_of(one) if one else "nothing", one.alone if one else np.nan,
                name_of(many) if many else "nothing", many.batched if many else np.nan,
            ))  # fmt: skip
    return rows


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figures and the table."""
    began = time.perf_counter()
    out = common.folder(out, "speed_accuracy")
    moving, still = motions(quick), eigenvalues(quick)
    common.write_csv(out / "speed_accuracy.csv", Point._fields, moving + still)
    draw(out / "speed_accuracy.png", moving, dict.fromkeys(p.scene for p in moving))
    draw(out / "speed_accuracy_frequencies.png", still, dict.fromkeys(p.scene for p in still))
    rows = advice(moving + still)
    columns = ("scene", "error", "alone", "alone_ms", "batched", "batched_ms")
    common.write_csv(out / "cheapest.csv", columns, rows)
    print(f"\n{'error':>8s} {'alone, ms':>10s} {'batch, ms':>10s}  cheapest alone; in a batch")
    for k, (scene, most, one, alone, many, batched) in enumerate(rows):
        if k % len(DECADES) == 0:
            print(scene)
        print(f"{most:8.0e} {alone:10.3g} {batched:10.3g}  {one}; {many}")
    print()
    return common.finish(began, "figures and tables are", out)


if __name__ == "__main__":
    common.run(
        main, __doc__, "fewer of all, in about two minutes",
        "the figures and the tables", keeps=False,
    )  # fmt: skip
