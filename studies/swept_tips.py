"""Rotating beams with swept tips as measured, by the rod, and what two numbers explain of it.

Epps and Chandra (1996, see `studies/data`) measured 48 frequencies of aluminium beams whose last 6
of 37.5 inches are swept back by 0, 15, 30 and 45 degrees, at 0, 500 and 750 rpm. Of the rod of the
nominal data 24 are within 5 % or 0.5 Hz, whichever is more, and all within 10 % or 1 Hz. Then a
factor of all stiffnesses and the radius of the root, at which the beam is held, are fitted to all
of them together, with noise in proportion to each frequency, of which the level is taken from the
residuals; what was read off figures to one digit after the point is no better than half of that.
The same with noise in proportion to the former bound, which has ten times as much for the first
mode at rest, stands beside it.

Measured in flap and torsion are the lowest modes in order: those in plane were not, and are left
out by their kinetic energy. Which is called torsion changes with the sweep, since bending and
torsion go together there.

    python studies/swept_tips.py [--quick] [--out FOLDER]
"""

import csv
import time
from pathlib import Path
from typing import Any

import common
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import BLUE, VERMILION

import jaxbeam as jb
from jaxbeam.blades import Blade

DATA = Path(__file__).parent / "data" / "epps_chandra_1996_swept_tips.csv"
INCH, POUND = 0.0254, 4.4482216152605
ROOT, STRAIGHT, TIP = 2.5 * INCH, 31.5 * INCH, 6.0 * INCH
WIDTH, HEIGHT = 1.0 * INCH, 0.063 * INCH
MODULUS, POISSON = 1.06e7 * POUND / INCH**2, 0.325
SHEAR = MODULUS / (2 * (1 + POISSON))
DENSITY = 2.51e-4 * POUND / INCH**4  # lb s^2 / in^4
AREA, FLAP, IN_PLANE = WIDTH * HEIGHT, WIDTH * HEIGHT**3 / 12, HEIGHT * WIDTH**3 / 12
STIFFNESS = np.diag(
    [
        MODULUS * AREA, SHEAR * AREA / 1.2000001839588001, SHEAR * AREA / 14.625127919304001,
        SHEAR * (FLAP + IN_PLANE) / 65.85255016982444, MODULUS * FLAP, MODULUS * IN_PLANE,
    ]
)  # fmt: skip
INERTIA = DENSITY * np.diag([AREA, AREA, AREA, FLAP + IN_PLANE, FLAP, IN_PLANE])
KINK = STRAIGHT / (STRAIGHT + TIP)
SWEEPS = (0, 15, 30, 45)  # degrees
RPM = np.array([0.0, 500.0, 750.0])
MODEL = jb.SpatialRod(8)
COUNT = 6  # modes in flap and torsion
NAMES = ("1 (1B)", "2 (2B)", "3 (3B)", "1T/5B", "5B/1T", "4B/1T")
NOMINAL = {"factor": 1.0, "root": ROOT}
DIGIT, BOUND = 0.05, 0.5  # Hz, the least noise beside 5 %


def measured() -> np.ndarray:
    """Frequencies in Hz by sweep, speed and mode, NaN where there are none."""
    out = np.full((len(SWEEPS), len(RPM), COUNT), np.nan)
    with open(DATA) as file:
        for row in csv.DictReader(file):
            place = list(RPM).index(float(row["rpm"])), NAMES.index(row["mode"])
            out[:, *place] = [float(row[f"sweep{sweep}"]) for sweep in SWEEPS]
    return out


def bounds(frequencies: Any, least: float = BOUND) -> Any:
    """5 % or so many Hz, whichever is more, in Hz."""
    return np.maximum(0.05 * frequencies, least)


def blade(sweep: Any, factor: Any) -> Blade:
    """With the tip swept back by an angle in rad."""
    back = TIP * jnp.stack([jnp.cos(sweep), -jnp.sin(sweep), 0 * sweep])
    inner = STRAIGHT * np.array([[0.0], [0.5], [1.0]]) * np.eye(3)[0]
    axis = jnp.concatenate([inner, inner[-1] + np.array([[0.5], [1.0]]) * back])
    places = [0.0, KINK / 2, KINK, (KINK + 1) / 2, 1.0]
    return Blade(
        [0.0, 1.0], factor * jnp.stack([STIFFNESS] * 2), [INERTIA] * 2, axis,
        axis_stations=places, kinks=[KINK],
    )  # fmt: skip


def frequencies(sweep: Any, rpm: Any, factor: Any, root: Any) -> Any:
    """The lowest in flap and torsion, in Hz."""
    rotor = jb.Rotor(blade(sweep, factor), root)
    # Beside them there are two in plane.
    found = jb.modes(MODEL, rotor, rpm * np.pi / 30, COUNT + 2, throw=False)
    in_plane = found.energy_share[:, jb.models.Direction.IN_PLANE] > 0.5
    return found.frequency_hz[jnp.argsort(in_plane, stable=True)[:COUNT]]


class Beam(jb.fitting.Experiment):
    """One of the beams: its frequencies at all speeds, in Hz."""

    measured: Any
    noise: Any
    sweep: Any
    factor: Any
    root: Any

    def predicted(self) -> Any:
        def at(rpm: Any) -> Any:
            return frequencies(self.sweep, rpm, self.factor, self.root)

        return jax.vmap(at)(jnp.asarray(RPM))


def fit(least: float) -> jb.results.Fit:
    """Of both numbers to all beams, with noise of so many Hz at least beside 5 %."""
    seen = measured()
    noise = bounds(np.nan_to_num(seen, nan=1.0), least)

    def beams(factor: Any, root: Any) -> list[Beam]:
        return [
            Beam(jnp.asarray(y), jnp.asarray(s), jnp.asarray(np.radians(sweep)), factor, root)
            for sweep, y, s in zip(SWEEPS, seen, noise, strict=True)
        ]

    free = {"factor": jb.FreeParameter(1.0), "root": jb.FreeParameter(ROOT, 0.0)}
    return jb.fit(beams, free, known_noise=False, progress=False)


def within(found: np.ndarray, share: float, hertz: float) -> int:
    """How many of the measured frequencies are met that well."""
    seen = measured()
    return int(np.sum(np.abs(found - seen) <= np.maximum(share * seen, hertz)))


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figure and the tables."""
    began = time.perf_counter()
    out = common.folder(out, "swept_tips")
    seen = measured()
    fine = np.linspace(0.0, 800.0, 9 if quick else 33)

    @jax.jit
    def at(rpm: Any, factor: Any, root: Any) -> Any:
        """By sweep, speed and mode."""

        def one(sweep: Any) -> Any:
            return jax.lax.map(lambda w: frequencies(sweep, w, factor, root), rpm)

        return jax.lax.map(one, jnp.radians(jnp.asarray(SWEEPS, float)))

    every = np.concatenate([RPM, fine])  # of one program

    def both(**p: Any) -> tuple[np.ndarray, np.ndarray]:
        found = np.asarray(at(every, *(jnp.asarray(p[name]) for name in NOMINAL)))
        return found[:, : len(RPM)], found[:, len(RPM) :]

    found, other = fit(DIGIT), fit(BOUND)
    print(found)
    low, high = (np.asarray(x) for x in found.interval()["factor"])
    print(
        f"  stiffness over nominal {float(found.parameters['factor']):.3f}, {low:.3f} to {high:.3f}"
    )
    low, high = (np.asarray(x) / INCH for x in found.interval()["root"])
    print(f"  root at {float(found.parameters['root']) / INCH:.2f} in, {low:.2f} to {high:.2f} in, "
          f"drawn at {ROOT / INCH:.1f} in")  # fmt: skip
    curves, rows = {}, []
    for name, p in (
        ("nominal", NOMINAL),
        ("fitted", found.parameters),
        ("fitted by the bound", other.parameters),
    ):
        said, curves[name] = both(**p)
        print(f"  {name}: of {np.isfinite(seen).sum()} frequencies {within(said, 0.05, 0.5)} are "
              f"within 5 % or 0.5 Hz, {within(said, 0.1, 1.0)} within 10 % or 1 Hz")  # fmt: skip
        rows += [
            (name, sweep, rpm, NAMES[k], seen[i, j, k], said[i, j, k])
            for i, sweep in enumerate(SWEEPS)
            for j, rpm in enumerate(RPM)
            for k in range(COUNT)
            if np.isfinite(seen[i, j, k])
        ]
    header = ("data", "sweep_deg", "rpm", "mode", "measured_hz", "rod_hz")
    common.write_csv(out / "swept_tips.csv", header, rows)
    draw(out / "swept_tips.png", fine, curves, seen)
    return common.finish(began, "figure and table are", out)


def draw(path: Path, fine: np.ndarray, curves: dict[str, np.ndarray], seen: np.ndarray) -> None:
    """Frequencies over speed for each sweep."""
    figure, axes = plt.subplots(1, 4, figsize=(13, 4.8), sharey=True, layout="constrained")
    looks = {"nominal": ("--", "0.5"), "fitted": ("-", BLUE)}
    for ax, sweep, i in zip(axes, SWEEPS, range(len(SWEEPS)), strict=True):
        for name, (style, colour) in looks.items():
            lines = ax.plot(fine, curves[name][i], style, color=colour, lw=1.3)
            lines[0].set_label(f"rod, {name} data")
        for j, rpm in enumerate(RPM):
            y = seen[i, j]
            marks = ax.errorbar(
                np.full(COUNT, rpm), y, bounds(y), fmt="o", ms=4, color=VERMILION, capsize=3, lw=1
            )
            if j == 0:
                marks.set_label("measured, 5 % or 0.5 Hz")
        ax.set(title=f"tip swept by {sweep}°", xlabel="rotor speed (rpm)", yscale="log",
               xlim=(-40, 830), ylim=(0.8, 250))  # fmt: skip
        ax.yaxis.set_major_formatter("{x:g}")
        ax.grid(color="0.92")
    axes[0].set(ylabel="frequency in flap and torsion (Hz)")
    axes[0].legend(fontsize=8, loc="lower right")
    common.save_figure(figure, path, dpi=110)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer speeds in the figure", "the figure and the table")
