"""Speed against accuracy: which model, discretisation and integrator to take for an error.

Three spin-ups (a gentle one, B Ref. 21 at 4 rad/s, and the abrupt one of Y Fig. 4, up to three
quarters of the length), in the plane and about an axis inclined by 30 degrees, and frequencies of a
beam at low and at high speed. In motion the error is the largest difference of the tip's deflection
over the run from that of a rod of degree 14 (10 with --quick), over the peak: it holds what theory,
discretisation and integrator leave. Elements have no equation in common with that rod; other rods
are of lower degrees, with which errors fall exponentially. Costs are CPU seconds of a case after
compilation, the least of several, alone and in a batch. `failed.csv` says what failed,
`cheapest.csv` what is cheapest in each scene; printed is what is so in all scenes of a kind.

    python studies/speed_accuracy.py [--quick] [--out FOLDER]
"""

import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import common
import diffrax
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import ALUMINIUM, STIFF, cpu_seconds
from matplotlib.ticker import LogLocator, NullFormatter

import jaxbeam as jb

POINTS, LANES, MODES = 101, 64, 1024  # times of a run; cases in a batch of runs, of frequencies
ERRORS = 1e-2, 1e-3, 1e-5  # that somebody may ask for
PLANE, SPACE = "motion in the plane", "motion out of the plane"
LAG, FLAP = "frequencies in the plane", "frequencies out of the plane"
INCLINED = np.array([0.5, 0.0, np.sqrt(0.75)])
SLOWER = 4.0  # times what is cheapest alone of all that do everywhere: in batches not looked at
COLOURS = {
    "PlanarRod": "tab:green", "SpatialRod": "tab:red",
    "ANCF": "tab:orange", "ChordANCF": "gold", "Hybrid": "tab:blue", "VonKarman": "tab:purple",
    "Classical": "tab:brown",
}  # fmt: skip


class Method(NamedTuple):
    """A solver, and its settings: tolerances, or steps over the duration of the run."""

    solver: Any
    adaptive: bool
    settings: tuple[float, ...]


RODAS5P = Method(jb.solvers.Rodas5P(), True, (1e-3, 1e-4, 1e-5, 1e-6, 1e-7))
RODAS4P = RODAS5P._replace(solver=jb.solvers.Rodas4P())
CHORD = Method(jb.solvers.ChordKvaerno5(), False, (1 / 50, 1 / 100, 1 / 200, 1 / 400, 1 / 800))
MAGNUS = CHORD._replace(solver=jb.solvers.Magnus())


def each(method: Method | None, *models: tuple[Any, ...]) -> list[tuple[Any, Any, Method | None]]:
    """Class, size and method of models that are given as classes with sizes."""
    return [(cls, size, method) for cls, *sizes in models for size in sizes]


TRIED = {  # the first two of each kind with --quick
    PLANE: [
        *each(RODAS5P, (jb.PlanarRod, 8)), *each(MAGNUS, (jb.Hybrid, (3, 4, 0))),
        *each(RODAS5P, (jb.PlanarRod, 4, 16, 32), (jb.SpatialRod, 4, 6, 8), (jb.papers.ANCF, 8)),
        *each(RODAS5P, (jb.papers.ChordANCF, 8), (jb.Hybrid, (0, 6, 0)), (jb.VonKarman, (8, 4, 0))),
        *each(RODAS4P, (jb.PlanarRod, 8)), *each(CHORD, (jb.PlanarRod, 8)),
        *each(MAGNUS, (jb.Classical, (3, 4, 0))),
    ],
    SPACE: each(
        RODAS5P, (jb.SpatialRod, 8, 6, 4, 12), (jb.Hybrid, (0, 6, 6)),
    ),
    LAG: each(
        None, (jb.Hybrid, (8, 16, 0)), (jb.PlanarRod, 10, 20), (jb.SpatialRod, 6, 8, 10),
        (jb.Hybrid, (3, 6, 0), (5, 10, 0)), (jb.papers.ANCF, 10),
    ),
    FLAP: each(
        None, (jb.Hybrid, (8, 16, 16)), (jb.SpatialRod, 8, 6, 10),
        (jb.Hybrid, (3, 6, 6), (5, 10, 10)),
    ),
}  # fmt: skip


class Scene(NamedTuple):
    """One motion of one rotor."""

    title: str
    rotor: jb.Rotor
    duration: float
    smooth: float  # rad/s, B eq. 13
    quintic: float  # rad/s, Y eq. 21
    end: float


def alike(length: Any, mass: Any, axial: Any, bending: Any, *ends: Any) -> jb.Rotor:
    """Of a beam that bends alike both ways, and has a thousandth of the rotary inertia of a solid
    one, which most theories leave out."""
    beam = jb.Beam(
        length, mass, axial, bending, bending, torsional_stiffness=bending / 1.3,
        polar_inertia=2e-3 * mass * bending / axial,
    )  # fmt: skip
    return jb.Rotor(beam, *ends)


def scenes() -> tuple[Scene, ...]:
    one = jb.Beam.from_section(**ALUMINIUM)
    stiffness = one.axial_stiffness, one.in_plane_bending_stiffness
    ref_21, fig_4 = alike(one.length, one.mass_per_length, *stiffness), alike(*STIFF[:4])
    return (
        Scene("gentle: B Ref. 21, 0.5 rad/s", ref_21, 15.0, 0.5, 0.0, 20.0),
        Scene("B Ref. 21, 4 rad/s", ref_21, 15.0, 4.0, 0.0, 20.0),
        Scene("abrupt: Y Fig. 4", fig_4, 1.0, 0.0, 0.31, 10.0),
    )


class Point(NamedTuple):
    """One measurement of the chart."""

    kind: str
    scene: str
    theory: str
    model: str
    method: str
    setting: float
    error: float
    alone: float  # CPU ms
    batched: float  # CPU ms a case
    status: str

    @property
    def line(self) -> str:
        """Model and method in few words."""
        return f"{self.model}, {self.method}" if self.method else self.model


COSTS: dict[str, Callable[[Point], float]] = {
    "alone": lambda p: p.alone,
    "in batches": lambda p: p.batched,
}


def tip(kind: str, model: Any, method: Method, scene: Any, share: Any, setting: Any) -> Any:
    """Deflections at the times of the scene, and the status; `scene` is traced."""
    rotor, duration, smooth, quintic, end = scene
    axis = None if kind == PLANE else INCLINED
    run = jb.simulate(
        model, rotor, common.spin_up(duration, quintic * share, smooth * share, axis),
        jnp.linspace(0.0, 1.0, POINTS) * end,
        solver=method.solver, dt0=None if method.adaptive else setting * end,
        stepsize_controller=(
            diffrax.PIDController(rtol=setting, atol=setting * rotor.beam.length / 10)
            if method.adaptive
            else diffrax.ConstantStepSize()
        ),
        max_steps=5_000, throw=False,
    )  # fmt: skip
    return run.tip[:, 1:], run.status


def measured(
    kind: str, quick: bool, function: Callable[..., Any], scenes: Sequence[tuple[Any, ...]],
    shares: Any, off: Callable[[np.ndarray, np.ndarray], float],
) -> list[Point]:  # fmt: skip
    """All that is tried in scenes of a kind (title, case, reference): with finer settings until the
    error is small enough for anybody, or stands still. In batches what is not much slower alone.

    `function` takes model, method, case, share of its speed and setting."""
    points: list[Point] = []
    batches = []
    for cls, size, method in TRIED[kind][: 2 if quick else None]:
        given = size if isinstance(size, tuple) else (size,)
        name = f"{cls.__name__}({', '.join(map(str, given))})"
        solved, settings = (type(method[0]).__name__, method.settings) if method else ("", (0.0,))
        settings = settings[1:3] if quick and method else settings
        one = partial(function, cls(*given), method)
        alone, batch = jax.jit(one), jax.jit(jax.vmap(one, (None, 0, None)))
        for scene, case, reference in scenes:
            before = np.inf
            for k, setting in enumerate(settings):
                cost, (found, code) = cpu_seconds(alone, case, 1.0, setting, patience=1)
                error, status = off(np.asarray(found), reference), jb.Status(int(code))
                good = status == jb.Status.OK and error < 1
                error = error if good else np.inf
                labels = kind, f"{scene}, {kind.split(' ', 1)[1]}", cls.__name__, name, solved
                points.append(Point(*labels, setting, error, 1e3 * cost, np.nan, status.name))
                batches.append((batch, case, shares, setting))
                # What moves gently has as many steps by the two coarsest tolerances.
                if good and (error < ERRORS[-1] / 3 or (k > 1 and error > before / 1.2)):
                    break
                before = error
        print(f"  {points[-1].line}, {kind}", flush=True)
    for most in ERRORS:
        everywhere = {choice.points[0].line for choice in ranked(points, most, "alone")}
        for scene in dict.fromkeys(p.scene for p in points):
            enough = ranked([p for p in points if p.scene == scene], most, "alone")
            best = [choice.cost for choice in enough if choice.points[0].line in everywhere]
            for choice in enough:
                k = points.index(choice.points[0])
                if np.isnan(points[k].batched) and choice.cost < SLOWER * (best or [np.inf])[0]:
                    cost, _ = cpu_seconds(*batches[k], patience=1)
                    points[k] = points[k]._replace(batched=1e3 * cost / len(shares))
    return points


def motion(kind: str, quick: bool) -> list[Point]:
    """Spin-ups in or out of the plane."""

    def off(found: np.ndarray, exact: np.ndarray) -> float:
        apart, size = (np.linalg.norm(a, axis=1).max() for a in (found - exact, exact))
        return float(apart / size)

    judge = jax.jit(partial(tip, kind, jb.SpatialRod(10 if quick else 14), RODAS5P))
    where = []
    for scene in scenes()[1:] if quick else scenes():
        case = jax.tree.map(jnp.asarray, tuple(scene)[1:])
        exact = np.asarray(judge(case, 1.0, 1e-7 if quick else 1e-8)[0])
        where.append((scene.title, case, exact))
    shares = jnp.linspace(1.0, 0.9, LANES // 8 if quick else LANES)
    return measured(kind, quick, partial(tip, kind), where, shares, off)


def frequencies(kind: str, quick: bool) -> list[Point]:
    """Lowest three in or out of the plane of a beam of slenderness 500 with hub and tip mass. The
    steady strain, 3e-4 at the higher speed, is what linear theories leave out."""
    which = jb.labels(in_plane=3) if kind == LAG else jb.labels(flap=3)

    def found(model: Any, _: Any, speed: Any, share: Any, __: Any) -> Any:
        rotor = alike(1.0, 1.0, 500.0**2, 1.0, 0.5, 0.2)
        modes = jb.modes(model, rotor, speed * share, which, throw=False)
        return modes.frequency, modes.status

    judge, where = jax.jit(partial(found, jb.SpatialRod(16), None)), []
    for speed in (12.0,) if quick else (1.0, 12.0):
        exact = np.asarray(judge(speed, 1.0, 0.0)[0])
        where.append((f"speed {speed:g} sqrt(EI / rho L^4)", speed, exact))
    shares = jnp.linspace(1.0, 0.95, MODES // 4 if quick else MODES)
    off = lambda found, exact: float(np.max(np.abs(found / exact - 1)))  # noqa: E731
    return measured(kind, quick, found, where, shares, off)


class Choice(NamedTuple):
    """A model with a method that is good enough in some scenes."""

    cost: float  # ms, the geometric mean over these
    points: tuple[Point, ...]  # one of each scene, with the cheapest setting

    @property
    def name(self) -> str:
        """Model, method and settings."""
        given = sorted({f"{p.setting:.2g}" for p in self.points if p.method}, key=float)
        return self.points[0].line + (f" at {' or '.join(given)}" if given else "")


def ranked(points: Sequence[Point], most: float, how: str) -> list[Choice]:
    """What is good enough in all scenes, the cheapest first."""
    where, found = {p.scene for p in points}, []
    for line in dict.fromkeys(p.line for p in points):
        best: dict[str, Point] = {}
        for p in points:
            if p.line == line and p.error <= most and np.isfinite(COSTS[how](p)):
                best[p.scene] = min(p, best.get(p.scene, p), key=COSTS[how])
        if set(best) == where:
            costs = [COSTS[how](p) for p in best.values()]
            found.append(Choice(float(np.exp(np.mean(np.log(costs)))), tuple(best.values())))
    return sorted(found)


def advice(points: Sequence[Point], kind: str, most: float) -> str:
    """What is cheapest in all scenes of a kind, and by how much before the next theory."""
    said = []
    for how in COSTS:
        best = ranked([p for p in points if p.kind == kind], most, how)
        theories: dict[str, Choice] = {}
        for choice in best:
            theories.setdefault(choice.points[0].theory, choice)
        names = [
            f"{c.name} ({c.cost:.2g} ms)" if k == 0 else
            f"{c.cost / best[0].cost:.2g} times as fast as {c.points[0].line}"
            for k, c in enumerate([*theories.values()][:2])
        ]  # fmt: skip
        said.append(f"{how} {', '.join(names) or 'nothing'}")
    return f"of {kind} " + ", ".join(said)


def draw(path: Path, points: Sequence[Point]) -> None:
    """Error and cost of all settings, alone above and in batches below; one column a scene."""
    columns = list(dict.fromkeys(p.scene for p in points))
    lines = list(dict.fromkeys(p.line for p in points))
    if not points[0].method:  # sizes are settings there: a line is a theory
        lines = list(dict.fromkeys(p.theory for p in points))
    figure, axes = plt.subplots(
        2, len(columns), figsize=(4.6 * len(columns), 8.6), layout="constrained", squeeze=False,
        sharex="col", sharey="row",
    )  # fmt: skip
    for row, (how, cost) in zip(axes, COSTS.items(), strict=True):
        for ax, scene in zip(row, columns, strict=True):
            for k, line in enumerate(lines):
                mine = [p for p in points if p.scene == scene and line in (p.line, p.theory)]
                mine = [p for p in mine if p.error < 1 and np.isfinite(cost(p))]
                mine.sort(key=lambda p: (-p.setting, p.error))
                ax.loglog(
                    [p.error for p in mine], [cost(p) for p in mine], marker="osD^v<>PX*"[k % 10],
                    color=COLOURS[line.split("(")[0]], ms=5, lw=1, alpha=0.85, label=line,
                )  # fmt: skip
            ax.grid(alpha=0.3)
            ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            ax.yaxis.set_major_formatter("{x:g}")
            ax.yaxis.set_minor_formatter(NullFormatter())
        row[0].set_ylabel(f"CPU time of a case {how} (ms)")
    for ax, scene in zip(axes[0], columns, strict=True):
        ax.set_title(scene, fontsize=10)
    for ax in axes[-1]:
        ax.set_xlabel(f"largest {'error / peak' if points[0].method else 'relative error'} (-)")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    common.save_figure(figure, path, dpi=100)


def report(points: Sequence[Point], out: Path) -> None:
    """Figures and tables, and what to take."""
    common.write_csv(out / "speed_accuracy.csv", Point._fields, points)
    for name, kinds in (("", (PLANE,)), ("_space", (SPACE,)), ("_frequencies", (LAG, FLAP))):
        draw(out / f"speed_accuracy{name}.png", [p for p in points if p.kind in kinds])
    by_line: dict[tuple[str, ...], list[Point]] = {}
    for p in points:
        if not np.isfinite(p.error):
            by_line.setdefault((p.scene, p.line, p.status), []).append(p)
    failed = [(*key, " ".join(f"{p.setting:.2g}" for p in own)) for key, own in by_line.items()]
    common.write_csv(out / "failed.csv", ("scene", "what", "status", "settings"), failed)
    rows = []
    for scene in dict.fromkeys(p.scene for p in points):
        for most in ERRORS:
            row: list[Any] = [scene, most]
            for how in COSTS:
                best = ranked([p for p in points if p.scene == scene], most, how)[:1]
                row += [x for c in best for x in (c.name, c.cost)] or ["nothing", np.nan]
            rows.append(row)
            print(*row, sep=" | ")
    columns = ("scene", "error", "alone", "alone_ms", "batched", "batched_ms")
    common.write_csv(out / "cheapest.csv", columns, rows)
    for kinds in ((PLANE, SPACE), (LAG, FLAP)):
        for most in ERRORS:
            told = "; ".join(advice(points, kind, most) for kind in kinds)
            print(f"For {most:.0e} take, {told}.")


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figures and the tables."""
    began = time.perf_counter()
    out = common.folder(out, "speed_accuracy")
    points = [p for kind in (PLANE, SPACE) for p in motion(kind, quick)]
    report(points + [p for kind in (LAG, FLAP) for p in frequencies(kind, quick)], out)
    return common.finish(began, "figures and tables are", out)


if __name__ == "__main__":
    common.run(
        main, __doc__, "fewer of all",
        "the figures and the tables", keeps=False,
    )  # fmt: skip
