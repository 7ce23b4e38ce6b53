"""Figures 2-7 and 10 of Berzeri and Shabana 1999 (B): beams spun up from rest to a steady speed.

Elements with non-linear strain (Model A) and with linear strain in a moving frame (Model 0) on the
two beams of B Table 1, beside a geometrically exact reference of many elements. Prints what
B says of these figures with numbers, the speeds above which Model 0 has no stable steady state,
and how far the forces of Model A are from being conservative.

    python studies/berzeri1999.py [--quick] [--out FOLDER]
"""

import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import common
import jax
import matplotlib.pyplot as plt
import numpy as np
from common import ALUMINIUM, BLUE, GREEN, PURPLE, VERMILION
from matplotlib.axes import Axes

import jaxbeam as jb

DURATION, END = 15.0, 20.0  # s, of the spin-up (T of B eq. 13) and of the runs
# B Table 1: the beams of its references 19 and 21. Hub radius 1 m and 0.
REF_19 = jb.Beam.from_section(
    length=10.0, density=3000.0, area=4e-4, in_plane_second_moment=1.997e-7, youngs_modulus=7e10
)
REF_21 = jb.Beam.from_section(**ALUMINIUM)
STYLES: dict[str, dict[str, Any]] = {  # by the first key with which a name begins
    "reference": {"color": "0.78", "lw": 5.0},
    "Model A, 10": {"color": PURPLE, "lw": 1.4},
    "Model A": {"color": BLUE, "lw": 1.4},
    "Model 0, chord, 10": {"color": "k", "lw": 1.8, "ls": (0, (1, 2.5))},
    "Model 0, chord": {"color": VERMILION, "lw": 1.4, "ls": "--"},
    "Model 0, tangent": {"color": GREEN, "lw": 1.4, "ls": "-."},
    "prestressed": {"color": "k", "lw": 1.8, "ls": (0, (1, 2.5))},
}
A2, A10 = "Model A, 2 elements", "Model A, 10 elements"
Z1, Z2, Z10 = (f"Model 0, chord, {n}" for n in ("1 element", "2 elements", "10 elements"))
T2, MODAL = "Model 0, tangent, 2 elements", "prestressed, 8 functions"

Row = dict[str, Any]
Runs = dict[str, jb.results.Simulation]  # the first is the reference


class Case(NamedTuple):
    """One figure of B: a rotor, its steady speed in rad/s, what the figure compares."""

    figure: str
    rotor: jb.Rotor
    speed: float
    names: tuple[str, ...]


CASES = (
    Case("2-3", jb.Rotor(REF_19, 1.0, 0.0), 6.0, (A2, Z2, T2, MODAL)),
    Case("4", jb.Rotor(REF_21, 0.0, 0.0), 2.0, (A2, Z2, T2)),
    Case("5", jb.Rotor(REF_21, 0.0, 0.0), 4.0, (A2, Z2, T2)),
    Case("6", jb.Rotor(REF_21, 0.0, 0.0), 10.0, (A10, Z10, Z1)),
    Case("7", jb.Rotor(REF_21, 0.0, 0.0), 40.0, (A2, A10, Z2)),
)
MODELS: dict[str, jb.models.AbstractModel] = {
    A2: jb.papers.ANCF(2), A10: jb.papers.ANCF(10), Z1: jb.papers.ChordANCF(1),
    Z2: jb.papers.ChordANCF(2), Z10: jb.papers.ChordANCF(10),
    T2: jb.papers.TangentANCF(2), MODAL: jb.Hybrid(0, 8, 0),
}  # fmt: skip


def spin_up(model: jb.models.AbstractModel, case: Case, quick: bool) -> jb.results.Simulation:
    # A stable run takes at most 7500 steps. An unstable one swings ever faster and would take
    # millions: the limit stops it, and `throw=False` keeps what it found.
    return jb.simulate(
        model, case.rotor, jb.SmoothSpinUp(case.speed, DURATION),
        np.linspace(0, END, 401 if quick else 801), max_steps=15_000, throw=False,
    )  # fmt: skip


def status(run: jb.results.Simulation) -> str:
    return jb.Status(int(run.status)).name


def run_case(case: Case, quick: bool) -> tuple[Runs, list[Row]]:
    """Simulate all models of a figure; the runs, and a line of the table for each."""
    count = 8 if quick else 16
    models: dict[str, jb.models.AbstractModel] = {
        f"reference, {count} elements": jb.PlanarRod(count)
    }
    models |= {name: MODELS[name] for name in case.names}
    found = common.together(lambda model: spin_up(model, case, quick), models.values())
    runs = dict(zip(models, found, strict=True))
    rows: list[Row] = []
    for name, run in runs.items():
        peak, at = map(float, run.partial.peak())
        away = float(np.nanmax(apart(run, runs)))
        row = {
            "figure": case.figure, "speed_rad_s": case.speed, "model": name, "peak_m": peak,
            "peak_at_s": at, "status": status(run), "reached_s": float(run.end_time),
            "imbalance": float(np.nanmax(np.abs(run.imbalance))),
            "steps": int(run.solution.stats["num_steps"]), "from_reference_m": away,
            "from_reference_percent": 100 * away / abs(rows[0]["peak_m"] if rows else peak),
        }  # fmt: skip
        rows.append(row)
        print(
            "{figure:>5s} {speed_rad_s:5g}  {model:28s} {peak_m:10.4g} {peak_at_s:7.3f}  "
            "{status:9s} {reached_s:6.2f} {imbalance:7.0e} {steps:6d} {from_reference_m:8.1e} "
            "{from_reference_percent:8.3g}".format(**row),
            flush=True,
        )
    return runs, rows


def deflection(run: jb.results.Simulation) -> Any:
    return np.asarray(run.partial.tip)[:, 1]


def rotation(run: jb.results.Simulation) -> Any:
    """Angle of the last ten-thousandth of the beam."""
    short = 1e-4
    before, tip = np.moveaxis(np.asarray(run.partial.displacement((1 - short, 1.0))), 1, 0)
    chord = tip - before
    return np.arctan2(chord[:, 1], short * float(run.scene.equations.length) + chord[:, 0])


def apart(run: jb.results.Simulation, runs: Runs) -> Any:
    """Distance of the tip deflection from that of the reference."""
    return np.abs(deflection(run) - deflection(next(iter(runs.values()))))


def within_a_second(values: Any) -> Any:
    """The largest value half a second to either side."""
    half = round(0.5 / END * (len(values) - 1))
    padded = np.pad(values, half, mode="edge")
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).max(1)


def lines(ax: Axes, runs: Runs, values: dict[str, Any]) -> None:
    """Values of runs over time; the axis fits those that are stable, with some room below."""
    for name, y in values.items():
        style = next(style for key, style in STYLES.items() if name.startswith(key))
        end = "" if runs[name].status == jb.Status.OK else f": {status(runs[name])}"
        ax.plot(runs[name].times, y, label=name + end, **style)
    stable = [y for name, y in values.items() if runs[name].status == jb.Status.OK]
    low, high = np.min(stable), np.max(stable)
    room = 0.06 if len(stable) == len(values) else 0.5
    ax.set_ylim(low - room * (high - low), high + 0.06 * (high - low))


def draw(
    out: Path, name: str, cases: Sequence[Case], found: dict[str, Runs],
    quantities: Mapping[str, Callable[[jb.results.Simulation], Any]],
) -> None:  # fmt: skip
    """Angular velocity, quantities, distance from the reference; a column for each figure of B."""
    count = len(quantities) + 2
    figure, axes = plt.subplots(
        count, len(cases), sharex=True, squeeze=False, layout="constrained",
        figsize=(1.5 + 5 * len(cases), 2 + 2.1 * count), height_ratios=[0.5, *[1] * (count - 1)],
    )  # fmt: skip
    for column, case in zip(axes.T, cases, strict=True):
        runs = found[case.figure]
        column[0].set_title(f"B Fig. {case.figure}: {case.speed:g} rad/s", fontsize=11)
        times = runs[case.names[0]].times
        speed = jax.vmap(jb.SmoothSpinUp(case.speed, DURATION).angular_speed)(times)
        column[0].plot(times, speed, "k", lw=1.2)
        for ax, quantity in zip(column[1:-1], quantities.values(), strict=True):
            lines(ax, runs, {name: quantity(run) for name, run in runs.items()})
        lines(column[-1], runs, {n: within_a_second(apart(runs[n], runs)) for n in case.names})
        column[-1].set(yscale="log", ylim=(3e-7, 3), xlabel="time (s)", xlim=(0, END))
        for ax in column:
            ax.grid(color="0.92")
        handles, names = column[1].get_legend_handles_labels()
        column[-1].legend(handles, names, loc="upper center", bbox_to_anchor=(0.5, -0.25))
    labels = ("angular velocity\n(rad/s)", *quantities, "tip, distance from\nreference (m)")
    for ax, label in zip(axes[:, 0], labels, strict=True):
        ax.set_ylabel(label)
    figure.align_ylabels()
    common.save_figure(figure, out / name, dpi=120)


def steady_strain(out: Path) -> None:
    """B Fig. 10: strain in steady rotation against the parabola of B eqs. 41-43."""
    print(
        "\nB Fig. 10, steady strain, Ref. 19 beam at 6 rad/s: largest distance from P / EA over "
        "strain at\nroot. B eq. 39 leaves out that EI r''.r'' acts on axial slopes; without EI the "
        "distance is of the\norder of the strain, for P is that of the undeformed beam"
    )
    hub, speed, xi = 1.0, 6.0, np.linspace(0, 1, 101)
    length, mass, rigidity = map(float, (REF_19.length, REF_19.mass, REF_19.axial_stiffness))
    limp = jb.Beam(length, mass / length, rigidity, 1e-4, 1e-4)
    figure, axes = plt.subplots(1, 2, figsize=(10.5, 4.6), layout="constrained")
    for ratio, colour in ((0.0, BLUE), (1.0, VERMILION)):
        reach = hub * (1 - xi) + length * (1 - xi**2) / 2 + ratio * (hub + length)
        exact = mass * speed**2 * reach / rigidity
        axes[0].plot(xi, 1e6 * exact, color=colour, lw=4, alpha=0.4, label=f"P / EA, N = {ratio:g}")
        for count, marker, every, dash in ((1, "s", 25, "-"), (10, ".", 5, "--")):
            name = f"Model A, {count} element{'s' * (count > 1)}, N = {ratio:g}"
            model, worst = jb.papers.ANCF(count), []
            for beam in (limp, REF_19):
                rotor = jb.Rotor(beam, hub, ratio * mass)
                start = jb.steady_start(model, rotor, jb.ConstantSpeed(speed))
                strain = np.asarray(model.equations(rotor).strain(start.q, xi))
                away = (strain - exact) / exact[0]
                worst.append(np.abs(away).max())
            axes[0].plot(xi[::every], 1e6 * strain[::every], marker, color=colour, label=name)
            axes[1].plot(xi, 1e6 * away, dash, color=colour, label=name)
            print(
                "  {}: {:.1e}, without EI {:.1e}; strain {:.1e}".format(
                    name.ljust(29), *worst[::-1], exact[0]
                )
            )
    axes[0].set(ylim=(0, None), ylabel=r"longitudinal strain ($10^{-6}$)")
    axes[1].set(ylabel=r"(strain - P / EA) / strain at root ($10^{-6}$)")
    for ax in axes:
        ax.set(xlabel="position x / L (-)", title="N: tip mass / mass of the beam")
        ax.grid(color="0.92")
        ax.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=2)
    common.save_figure(figure, out / "figure_10.png", dpi=120)


def remainder(quick: bool) -> None:
    """What the forces of Model A do beside changing its strain energy, B Fig. 5."""
    print(
        "\nModel A, 4 rad/s: work against its non-conservative forces (negative: the beam gains) "
        "at the end\nand at its largest, over the largest strain energy"
    )
    counts = (2, 10) if quick else (1, 2, 4, 8)
    runs = common.together(lambda n: spin_up(jb.papers.ANCF(n), CASES[2], quick), counts)
    for count, run in zip(counts, runs, strict=True):
        force = jax.jit(jax.vmap(run.scene.equations.nonconservative_force))(run.state.q)
        power = np.sum(np.asarray(force * run.state.v), 1)
        work = np.cumsum(np.diff(run.times) * (power[1:] + power[:-1]) / 2)
        end, largest = np.array([work[-1], np.abs(work).max()]) / np.max(run.strain_energy)
        print(f"  {count:2d} element{'s' * (count > 1):1s} {end:9.5f}, largest {largest:.5f}")


def critical_speed(model: jb.models.AbstractModel) -> float:
    """Speed in rad/s up to which steady rotation is stable, by bisection; 100 is the highest."""
    low, high = 0.0, 100.0
    while high - low > 0.05:
        middle = (low + high) / 2
        grows = jb.modes(model, CASES[1].rotor, middle, 1).growth_rate[0] > 1e-6
        low, high = (low, middle) if grows else (middle, high)
    return high


def critical_speeds() -> None:
    """B: "there always exists a critical value" that depends on the number of elements."""
    print("\nModel 0 in either frame, Ref. 21 beam: speed (rad/s) up to which it is stable")
    models = [kind(n) for kind in (jb.papers.ChordANCF, jb.papers.TangentANCF) for n in (1, 2, 10)]
    for model, speed in zip(models, common.together(critical_speed, models), strict=True):
        name = f"{type(model).__name__}, {model.n_elements}:"
        print(f"  {name:16s} {'> ' * (speed == 100)}{speed:.1f}")


def statements(rows: list[Row], runs: dict[str, Runs]) -> None:
    """What B says of its Figs. 4-7, with numbers."""
    found = {(row["figure"], row["model"]): row for row in rows}
    away = {key: f"{row['from_reference_percent']:.3g} %" for key, row in found.items()}
    lost = runs["6"][Z1]
    left = lost.times[np.argmax(np.abs(deflection(lost)) > float(REF_21.length))]
    between = np.abs(deflection(runs["6"][Z10]) - deflection(runs["6"][A10])).max()
    print(
        "\nWhat B says of these runs (% of the peak of the reference, and away from it)\n"
        f"  2 and 4 rad/s, two elements: Model A accurate ({away['4', A2]}, {away['5', A2]}), "
        f"Model 0 less so\n    (chord {away['4', Z2]}, {away['5', Z2]}; "
        f"tangent {away['4', T2]}, {away['5', T2]})\n"
        f"  10 rad/s: one element of Model 0 unstable ({status(lost)}, a beam's length away at "
        f"{left:.1f} s);\n    ten almost identical with Model A ({1e3 * between:.0f} mm apart)\n"
        f"  40 rad/s: two elements of Model 0 not sufficient ({found['7', Z2]['status']} at "
        f"{found['7', Z2]['reached_s']:.1f} s, {away['7', Z2]});\n    Model A stays stable "
        f"({found['7', A2]['status']}), yet {away['7', A2]} away; ten elements {away['7', A10]}"
    )


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figures and the table."""
    began = time.perf_counter()
    out = common.folder(out, "berzeri1999")
    print(
        f" Fig. rad/s  {'model':28s}   peak (m)  at (s)  status    to (s) balance  steps  apart (m)"
        "   (%)"
    )
    runs: dict[str, Runs] = {}
    rows: list[Row] = []
    for case in CASES:
        runs[case.figure], more = run_case(case, quick)
        rows += more
    common.write_csv(out / "peaks.csv", rows[0], (row.values() for row in rows))
    tip = {"tip deflection (m)": deflection}
    draw(out, "figures_2_3.png", CASES[:1], runs, tip | {"rotation of\nfree end (rad)": rotation})
    draw(out, "figures_4_5.png", CASES[1:3], runs, tip)
    draw(out, "figures_6_7.png", CASES[3:], runs, tip)
    statements(rows, runs)
    if not quick:
        critical_speeds()
    steady_strain(out)
    remainder(quick)
    print()
    return common.finish(began, "figures and table are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "coarser, in about a minute", "the figures and the table")
