"""Where each theory may be used: error against a number that is known beforehand.

Three neglects, three numbers. The classical linear theory leaves out the motion-induced stiffness:
its error goes with the ratio of that to the elastic one (`jb.stiffening_ratio`; Y, below eq. 20 and
on Fig. 6). The hybrid theory is linear in deflection: its error goes with the square of the peak
deflection over the length. The small-strain linearisation puts the tension on the unstretched beam:
its error goes with the steady strain, by a factor that also holds how the law of bending counts
stretch (here a moment EI times the change of angle per unstretched length, up to 0.9; against a
moment from EI r''.r'', up to 0.4). Beams of L = rho = EI = 1; all else follows by dimensions.

    python studies/validity.py [--quick] [--out FOLDER]
"""

import functools
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
from common import BLUE, GREEN, ORANGE, VERMILION
from matplotlib.colors import LogNorm

import jaxbeam as jb
from jaxbeam._models.bases.basis import HermiteElements

MARKERS = "os^vDP*Xd"
SLENDER = 347.0  # of the beam of Y Fig. 4
LANES = 8  # cases of a batch, which waits for its slowest
HYBRID, CLASSICAL = jb.Hybrid(0, 8, 0), jb.Classical(0, 8, 0)
ELEMENTS = 8
Columns = dict[str, np.ndarray]


def rotor_of(hub: Any, tip: Any, slenderness: Any) -> jb.Rotor:
    """Hub radius over length, tip mass over that of the beam, L sqrt(EA / EI)."""
    return jb.Rotor(jb.Beam.from_slenderness(slenderness), hub, tip)


def frequency_pair(
    fraction: Any, rest: Any, hub: Any, tip: Any, slenderness: Any
) -> dict[str, Any]:
    """First in-plane frequency at a fraction of that at rest, with and without P(x)."""
    speed = fraction * rest
    rotor, first = rotor_of(hub, tip, slenderness), jb.labels(in_plane=1)
    pair = [
        jb.modes(model, rotor, speed, first, throw=False)
        for model in (jb.Hybrid(4, 10, 0), jb.Classical(4, 10, 0))
    ]
    return {
        "ratio": jb.stiffening_ratio(rotor, speed, throw=False).ratio,
        "error": 1 - pair[1].frequency[0] / pair[0].frequency[0],
        "growth_rate": pair[1].growth_rate[0],
        "status": jnp.maximum(pair[0].status, pair[1].status),
    }


@functools.cache  # one function, one compilation
def peak_of(model: jb.models.AbstractModel) -> Callable[..., dict[str, Any]]:
    """Largest deflection of the tip up to half a period after a spin-up."""

    def peak(
        duration: Any, rest: Any, abrupt: Any, speed: Any, hub: Any, tip: Any, slenderness: Any,
        size: Any,
    ) -> dict[str, Any]:  # fmt: skip
        run = jb.simulate(
            model, rotor_of(hub, tip, slenderness),
            common.spin_up(duration, quintic=abrupt * speed, smooth=(1 - abrupt) * speed),
            jnp.linspace(0.0, 1.0, 121) * (duration + 0.55 * 2 * jnp.pi / rest), throw=False,
            stepsize_controller=diffrax.PIDController(rtol=1e-6, atol=1e-6 * size),
        )  # fmt: skip
        return {"peak": jnp.abs(run.peak()[0]), "status": run.status}

    return peak


class Family(NamedTuple):
    """Spin-ups that differ in strength. Hub radius over length, tip mass over that of the beam."""

    periods: float  # duration over the period of the first mode at rest
    abrupt: float  # 1: Y eq. 21, 0: Y eq. 23
    hub: float
    tip: float
    slenderness: float = SLENDER

    def __str__(self) -> str:
        parts = [f"{'abrupt' if self.abrupt else 'smooth'} {self.periods:g}"]
        parts += [f"hub {self.hub:g}"] if self.hub else []
        parts += [f"tip {self.tip:g}"] if self.tip else []
        parts += [f"slender {self.slenderness:g}"] if self.slenderness != SLENDER else []
        return ", ".join(parts)


def spin_ups(families: Sequence[Family], speeds: Iterable[Any], sizes: Any) -> jb.results.Cases:
    """All families, each to its speeds (over the first frequency at rest)."""
    rows = []
    for f, own in zip(families, speeds, strict=True):
        rest = rest_frequency(f.tip)
        for speed, size in zip(own, np.broadcast_to(sizes, np.shape(own)), strict=True):
            duration = f.periods * 2 * np.pi / rest
            row = (duration, rest, f.abrupt, speed * rest, f.hub, f.tip, f.slenderness, size)
            rows.append(row)
    names = ("duration", "rest", "abrupt", "speed", "hub", "tip", "slenderness", "size")
    return jb.points(**dict(zip(names, np.array(rows).T, strict=True)))


@functools.cache
def rest_frequency(tip: float) -> float:
    found = jb.modes(jb.Hybrid(0, 10, 0), rotor_of(0.0, tip, SLENDER), 0.0, 1)
    return float(found.frequency[0])


def sweep(
    what: str, function: Callable[..., Any], cases: jb.results.Cases, chunk: int = LANES
) -> jb.Table:
    began = time.perf_counter()
    table = jb.sweep(function, cases, chunk=chunk, progress=False)
    good = int(np.sum(table["status"] == 0))
    print(f"  {what:44} {good}/{len(cases)} ok, {time.perf_counter() - began:5.1f} s", flush=True)
    return table


def peaks(
    model: jb.models.AbstractModel, cases: jb.results.Cases, shape: tuple[int, ...]
) -> np.ndarray:
    """NaN where a run failed."""
    table = sweep(f"{type(model).__name__}, spin-ups", peak_of(model), cases)
    return np.where(table["status"] == 0, table["peak"], np.nan).reshape(shape)


def passing(x: np.ndarray, error: np.ndarray, level: float) -> float:
    """Where an error that grows along the last axis passes a level: the least of all rows."""
    least, rows = np.inf, (-1, x.shape[-1])
    for a, e in zip(x.reshape(rows), np.abs(error).reshape(rows), strict=True):
        above = np.flatnonzero(e > level)
        if above.size and above[0]:
            i = above[0]
            share = np.log(level / e[i - 1]) / np.log(e[i] / e[i - 1])
            least = min(least, a[i - 1] * (a[i] / a[i - 1]) ** share)
    return float(least)


def rule(
    what: str, x: np.ndarray, error: np.ndarray, power: float, small: float, name: str
) -> None:
    """Print error = c x^power for x < small, and where levels are passed."""
    use = (x < small) & np.isfinite(error) & (error != 0)
    c = np.abs(error[use]) / x[use] ** power
    slope = np.polyfit(np.log(x[use]), np.log(np.abs(error[use])), 1)[0]
    levels = ", ".join(
        f"{100 * level:g} % at {at:.3g}"
        for level in (1e-3, 1e-2, 5e-2)
        if np.isfinite(at := passing(x, error, level))
    )
    exponent = "" if power == 1 else f"^{power:g}"
    print(
        f"{what}: error = c {name}{exponent}, c = {np.median(c):.2f} ({c.min():.2f} to "
        f"{c.max():.2f}) for {name} < {small:g}; slope {slope:.2f}; passes {levels}"
    )


def frequency_errors(path: Path, **axes: Any) -> list[np.ndarray]:
    """Ratio, error and growth rate of the classical theory on a grid; NaN where modes fail."""
    grid = jb.grid(**axes)
    rest = np.array([rest_frequency(tip) for tip in grid.columns["tip"]])
    cases = jb.points(**grid.columns, rest=rest)
    table = sweep("Classical, frequencies", frequency_pair, cases, chunk=64)
    table.to_csv(path)
    shape = tuple(len(axis) for axis in grid.axes.values())
    good = table["status"] == 0
    names = ("ratio", "error", "growth_rate")
    return [np.where(good, table[name], np.nan).reshape(shape) for name in names]


def classical(quick: bool, out: Path, axes: Sequence[Any]) -> None:
    """Part 1: frequency, map, peak of a spin-up."""
    tips, slender = ([0.0, 2.0], [SLENDER]) if quick else ([0.0, 0.5, 2.0], [70.0, SLENDER])
    fraction = np.append(np.geomspace(0.01, 0.98, 16 if quick else 28), [1.02, 1.5])
    radii = [0.0, 0.2, 1.0, 5.0]
    ratio, error, growth = frequency_errors(
        out / "classical_frequency.csv", hub=radii, tip=tips, slenderness=slender, fraction=fraction
    )
    stable = growth == 0
    ratio, error = (np.where(stable, a, np.nan) for a in (ratio, error))
    below, above = growth[..., :-2] > 0, growth[..., -2:] > 0
    print(
        f"  {below.sum()} of {below.size} cases below the first rest frequency diverge, "
        f"{above.sum()} of {above.size} above it"
    )
    rule("Classical, first frequency", ratio, error, 1, 0.02, "ratio")
    softened = ratio / (1 - fraction**2)
    closed = 1 - 1 / np.sqrt(1 + softened)
    print(f"  largest difference from 1 - (1 + ratio / (1 - (Omega / omega_0)^2))^-1/2: "
          f"{np.nanmax(np.abs(error - closed)):.1e}")  # fmt: skip

    ax = axes[0]
    x = np.broadcast_to(fraction, ratio.shape)
    dots = ax.scatter(ratio, error, c=x, s=9, cmap="viridis", norm=LogNorm(0.01, 1))
    line = np.geomspace(1e-4, 1, 50)
    ax.plot(line, line / 2, "--", color="k", lw=1, label="ratio / 2")
    ax.figure.colorbar(dots, ax=ax, label="speed / first rest frequency (-)")
    ax.set(
        xscale="log", yscale="log", ylim=(3e-5, 2), xlabel="stiffening ratio (-)",
        ylabel="relative error of the first in-plane frequency (-)",
        title=f"classical: {int(stable.sum())} cases, R to 5 L, m_t to 2 m",
    )  # fmt: skip
    ax.legend()

    n = 24 if quick else 48
    fraction, hub = np.geomspace(0.01, 0.995, n), np.linspace(0, 5, n // 2)
    ratio, error, _ = (
        a[..., 0, 0]
        for a in frequency_errors(
            out / "classical_map.csv", hub=hub, fraction=fraction, tip=[0.0], slenderness=[SLENDER]
        )
    )
    ax = axes[1]
    shades = ax.pcolormesh(
        fraction, hub, error, norm=LogNorm(1e-4, 1), shading="gouraud", cmap="cividis"
    )
    ax.figure.colorbar(shades, ax=ax, label="relative error of the first in-plane frequency (-)")
    lines = ax.contour(fraction, hub, ratio, [2e-3, 2e-2, 0.2, 2], colors="w", linewidths=1)
    ax.clabel(lines, fmt="ratio %g", fontsize=8)
    ax.axvspan(1, 1.6, color=VERMILION, alpha=0.8)
    ax.text(1.26, 2.5, "diverges", rotation=90, ha="center", va="center", color="w")
    ax.set(
        xscale="log", xlim=(0.01, 1.6), xlabel="speed / first rest frequency (-)",
        ylabel="hub radius / length (-)", title="classical: error (shades) and stiffening ratio",
    )  # fmt: skip
    classical_spin_up(quick, out, axes[2])


def classical_spin_up(quick: bool, out: Path, ax: Any) -> None:
    rotors = [(0.0, 0.0), (5.0, 1.0)] if quick else [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (5.0, 1.0)]
    durations = (0.057, 1.0) if quick else (0.057, 0.5, 1.0, 10.0)
    families = [Family(t, t < 0.1, *r) for t in durations for r in rotors]
    fractions = np.geomspace(0.01, 0.9, LANES)
    cases = spin_ups(families, [fractions] * len(families), 1e-3)
    shape = len(families), LANES
    exact, wrong = common.together(lambda model: peaks(model, cases, shape), [HYBRID, CLASSICAL])
    error = wrong / exact - 1
    ratios = jax.vmap(lambda f, h, t, s: jb.stiffening_ratio(rotor_of(h, t, f), s).ratio)
    c = cases.columns
    ratio = np.asarray(ratios(*(jnp.asarray(c[k]) for k in ("slenderness", "hub", "tip", "speed"))))
    ratio = ratio.reshape(shape)
    write(out / "classical_spin_up.csv", families, {
        "speed_over_rest": np.tile(fractions, (len(families), 1)), "ratio": ratio,
        "hybrid_peak": exact, "classical_peak": wrong, "error": error,
    })  # fmt: skip
    colours = plt.get_cmap("viridis")(np.linspace(0, 0.9, len(durations)))
    for colour, periods in zip(colours, durations, strict=True):
        rows = [i for i, f in enumerate(families) if f.periods == periods]
        rule(f"Classical, peak, duration {periods:g} periods", ratio[rows], error[rows], 1, 0.05,
             "ratio")  # fmt: skip
        for i in rows:
            label = f"{periods:g}" if i == rows[0] else None
            ax.plot(ratio[i], np.abs(error[i]), ".-", color=colour, lw=0.8, label=label)
    ax.set(
        xscale="log", yscale="log", ylim=(1e-5, 30),
        xlabel="stiffening ratio at the final speed (-)",
        ylabel="relative error of the peak deflection (-)", title="classical: spin-ups to ratio",
    )  # fmt: skip
    line = np.geomspace(1e-4, 1, 50)
    ax.plot(line, line / 2, "--", color="k", lw=1, label="ratio / 2")
    ax.legend(fontsize=8, title="duration / period at rest")


def deflection(quick: bool, out: Path, ax: Any) -> None:
    """Part 2: hybrid and von Karman against geometrically exact elements."""
    families = [
        Family(0.057, 1, 0.0, 0.0), Family(0.057, 1, 1.0, 0.0), Family(0.5, 0, 1.0, 1.0),
        Family(2.0, 0, 0.0, 0.0), Family(7.0, 0, 0.0, 0.0),
    ]  # fmt: skip
    if not quick:
        families += [
            Family(0.057, 1, 0.0, 1.0), Family(0.057, 1, 0.0, 0.0, 70.0), Family(0.5, 0, 0.0, 0.0),
            Family(2.0, 0, 1.0, 0.5),
        ]  # fmt: skip
    shape = len(families), LANES
    colours = {"hybrid": BLUE, "von Karman": ORANGE}
    # From the deflection per speed while both are small to speeds for the deflections wanted.
    unit = peaks(HYBRID, spin_ups(families, np.full(shape, 1e-3), 1e-4), shape)
    wanted = np.geomspace(0.03, 0.9, LANES)
    speeds = 1e-3 * wanted / unit
    every = spin_ups(families, speeds, wanted / 3)
    some = [1, 6]  # a weak and a strong one of each: what eight elements leave
    few = spin_ups(families, speeds[:, some], wanted[some] / 3)
    models = [(jb.PlanarRod(8), every, shape), (HYBRID, every, shape)]
    if not quick:
        models += [
            (jb.VonKarman(13, 7, 0), every, shape),
            (jb.PlanarRod(16), few, (len(families), 2)),
        ]  # fmt: skip
    exact, *others = common.together(peaks, *zip(*models, strict=True))
    found = dict(zip(colours, others[:2], strict=False))
    error = {name: peak / exact - 1 for name, peak in found.items()}
    columns = {"deflection_over_length": exact}
    for name in found:
        columns |= {f"{name}_peak": found[name], f"{name}_error": error[name]}
    if not quick:
        off = np.abs(exact[:, some] / others[2] - 1) / np.abs(error["hybrid"][:, some])
        print(f"  16 elements instead of 8 change a part of the hybrid error: {off.max():.3f}")
    write(out / "deflection.csv", families, columns)
    for name in found:
        colour = colours[name]
        rule(f"{name}, peak", exact, error[name], 2, 0.25, "(w/L)")
        ax.plot([], [], color=colour, label=name)
    print(f"  {'each: c, where 1 % and 5 % are passed':44} {'hybrid':18}   von Karman")
    for i, (family, marker) in enumerate(zip(families, MARKERS, strict=False)):
        ax.plot([], [], marker, color="0.3", ms=5, mfc="none", label=str(family))
        numbers = []
        for name in found:
            colour = colours[name]
            w, e = exact[i], np.abs(error[name][i])
            ax.plot(w, e, marker + "-", color=colour, lw=0.7, ms=5, mfc="none")
            c = np.median((e / w**2)[w < 0.25])
            at = (passing(w, e, level) for level in (0.01, 0.05))
            numbers.append(f"{c:.2f} " + " ".join(f"{a:6.3f}" if a < 1 else "     -" for a in at))
        print(f"  {family!s:44} {'   '.join(numbers)}")
    line = np.geomspace(0.02, 1, 20)
    ax.plot(line, 0.3 * line**2, "--", color="k", lw=1, label="0.3 (w / L)²")
    ax.set(
        xscale="log", yscale="log", ylim=(1e-4, 1),
        xlabel="peak deflection of the tip / length (-)",
        ylabel="relative error of the peak deflection (-)", title="hybrid: spin-ups to deflection",
    )  # fmt: skip
    ax.legend(
        fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False,
        title="duration (periods at rest), hub radius / L, tip mass / m", title_fontsize=8,
    )  # fmt: skip


def linearised(model: jb.models.AbstractModel) -> Callable[..., dict[str, Any]]:
    """First two in-plane frequencies at the speed of a steady strain P(0) / EA."""

    def case(hub: Any, tip: Any, slenderness: Any, strain: Any) -> dict[str, Any]:
        rotor = rotor_of(hub, tip, slenderness)
        speed = jnp.sqrt(strain / rotor.steady_strain(jnp.ones(())))
        found = jb.modes(model, rotor, speed, jb.labels(in_plane=2), throw=False)
        return {"frequency": found.frequency, "status": found.status}

    return case


def strain(quick: bool, out: Path, axes: Sequence[Any]) -> None:
    """Part 3: linear theories with tension against exact ones, of the same elements."""
    n = ELEMENTS
    models = {
        "exact": jb.PlanarRod(n),
        "small strain": jb.papers.SmallStrainANCF(n),
        "hybrid": jb.Hybrid(2 * n + 1, 2 * n, 0, basis=HermiteElements(n)),
    }
    if not quick:
        models["Model A"] = jb.papers.ANCF(n)
    level = np.geomspace(1e-5, 0.5, 9 if quick else 13)
    hubs, tips, slender = [0.0, 1.0], [0.0, 1.0], [100.0] if quick else [30.0, 100.0, 300.0]
    cases = jb.grid(hub=hubs, tip=tips, slenderness=slender, strain=level)

    def run(model: jb.models.AbstractModel) -> np.ndarray:
        what = f"{type(model).__name__}, steady strain"
        table = sweep(what, linearised(model), cases, chunk=36)
        return np.where((table["status"] == 0)[..., None], table["frequency"], np.nan)

    frequency = dict(zip(models, common.together(run, list(models.values())), strict=True))
    x = np.broadcast_to(level, frequency["exact"].shape[:-1])
    columns = {"strain": x}
    styles = {"small strain": ("x", GREEN), "hybrid": ("o", BLUE), "Model A": ("v", "0.6")}
    for name in [name for name in models if name != "exact"]:
        marker, colour = styles[name]
        for k, ax in enumerate(axes):
            error = frequency[name][..., k] / frequency["exact"][..., k] - 1
            columns[f"{name}_error_{k + 1}"] = error
            rule(f"{name}, mode {k + 1}", x, error, 2 if name == "Model A" else 1, 0.05, "strain")
            if name != "Model A":
                signed = (error / x)[x < 0.05]
                print(f"    with its sign c = {signed.min():+.2f} to {signed.max():+.2f}")
            ax.plot(x.ravel(), np.abs(error).ravel(), marker, color=colour, ms=5, mfc="none",
                    label=name)  # fmt: skip
    flat = {key: value.ravel() for key, value in columns.items()}
    grid = {key: cases.columns[key] for key in ("hub", "tip", "slenderness")}
    save(out / "strain.csv", grid | flat)
    for mode, ax in enumerate(axes, 1):
        ax.plot(level, 0.9 * level, "--", color="k", lw=1, label="0.9 strain")
        ax.set(
            xscale="log", yscale="log", ylim=(1e-7, 1),
            xlabel="steady strain at the root P(0) / EA (-)",
            ylabel=f"relative error of in-plane frequency {mode} (-)",
            title=f"linear in strain: in-plane mode {mode}, {n} elements",
        )  # fmt: skip
        ax.legend()


def write(path: Path, families: Sequence[Family], columns: Columns) -> None:
    """A line for every spin-up."""
    many = next(iter(columns.values())).shape[1]
    own = np.repeat(np.array([tuple(f) for f in families], float), many, axis=0)
    save(path, dict(zip(Family._fields, own.T, strict=True)) | {
        name: column.ravel() for name, column in columns.items()
    })  # fmt: skip


def save(path: Path, columns: Columns) -> None:
    common.write_csv(path, columns, zip(*(c.tolist() for c in columns.values()), strict=True))


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figure and the tables."""
    began = time.perf_counter()
    out = common.folder(out, "validity")
    figure, axes = plt.subplots(2, 3, figsize=(17, 10.5), layout="constrained")
    classical(quick, out, axes[0])
    deflection(quick, out, axes[1, 0])
    strain(quick, out, axes[1, 1:])
    for ax in axes.flat:
        ax.grid(alpha=0.3)
    common.save_figure(figure, out / "validity.png", dpi=110)
    print()
    return common.finish(began, "figure and tables are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer cases, in under a minute", "the figure and the tables")
