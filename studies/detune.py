"""Tip mass and hub radius for which no harmonic of the speed meets a frequency.

A rotor in a range of working speeds: as designed, frequencies cross lines of so many per turn.
`jb.fitting.ResonanceMargin` demands a margin along the whole range, priors ask for as little change
as may be, and `jb.fit` searches from many starts at once.

    python studies/detune.py [--quick] [--out FOLDER]
"""

import time
from pathlib import Path
from typing import Any

import common
import jax
import matplotlib.pyplot as plt
import numpy as np
from common import BLUE, GREEN, VERMILION

import jaxbeam as jb

MODEL = jb.Hybrid(1, 4, 6)
WHICH = jb.labels(flap=2, in_plane=1)
NAMES = ("flap 1", "flap 2", "in plane 1")
HARMONICS = (1, 2, 3, 4, 5, 6)
MARGIN = 0.05
WORKING = (36.0, 42.0)  # rad/s
HUB, TIP = 0.3, 0.5  # as designed, m and kg
BEAM = (4.0, 3.0, 3e8 * 3e-4, 12_000.0, 5_000.0)  # m, kg/m, N, N m^2, N m^2
COLOURS = (BLUE, VERMILION, GREEN)


def rotor(hub: Any, tip: Any) -> jb.Rotor:
    return jb.Rotor(jb.Beam(*BEAM), hub, tip)


def demand(count: int, margin: float = MARGIN) -> Any:
    speeds = np.linspace(*WORKING, count)

    def experiments(hub: Any, tip: Any) -> jb.fitting.ResonanceMargin:
        return jb.fitting.ResonanceMargin(MODEL, rotor(hub, tip), speeds, WHICH, HARMONICS, margin)

    return experiments


def least(hub: Any, tip: Any) -> tuple[float, str]:
    """Smallest relative distance on a fine grid, 0 if a line is crossed, and where."""
    distance = np.asarray(demand(241)(hub, tip).distance())
    crossed = np.sign(distance).min(2) != np.sign(distance).max(2)
    near = np.where(crossed, 0.0, np.abs(distance).min(2))
    i, j = np.unravel_index(np.argmin(near), near.shape)
    return float(near[i, j]), f"{NAMES[i]} and {HARMONICS[j]}/rev"


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figure and the table."""
    out = common.folder(out, "detune")
    free = {
        "hub": jb.FreeParameter(HUB, 0.05, 1.0, prior=(HUB, 0.3)),
        "tip": jb.FreeParameter(TIP, 0.0, 6.0, prior=(TIP, 2.0)),
    }
    began = time.perf_counter()
    # A little more than is wanted: priors pull back into the margin by the slack.
    experiments = demand(13, MARGIN + 0.001)
    descent = jb.fitting.Descent(starts=16 if quick else 64, steps=100, starts_within=3.0)
    found = jb.fit(experiments, free, descent=descent, throw=False)
    seconds = time.perf_counter() - began
    new = {name: float(value) for name, value in found.partial.parameters.items()}
    rows = []
    for title, design in (("as designed", {"hub": HUB, "tip": TIP}), ("detuned", new)):
        margin, where = least(**design)
        rows.append((title, design["hub"], design["tip"], margin, where))
        print(f"{title:12} hub radius {design['hub']:.3f} m, tip mass {design['tip']:.3f} kg: "
              f"margin {margin:.2%} ({where})")  # fmt: skip
    print(f"demanded: {MARGIN:.0%} from {WORKING[0]:g} to {WORKING[1]:g} rad/s; {seconds:.0f} s")
    header = ("design", "hub_radius_m", "tip_mass_kg", "margin", "nearest")
    common.write_csv(out / "detune.csv", header, rows)
    draw(out / "detune.png", rows)
    print(f"figure and table are in {out}")
    return out


def at_speed(hub: Any, tip: Any, speed: Any) -> Any:
    return jb.modes(MODEL, rotor(hub, tip), speed, WHICH).frequency


def draw(path: Path, rows: Any) -> None:
    """Campbell diagrams of both designs."""
    figure, axes = plt.subplots(1, 2, figsize=(12, 5), layout="constrained", sharey=True)
    speeds = np.linspace(0.5, 50.0, 80)
    for ax, (title, hub, tip, margin, _) in zip(axes, rows, strict=True):
        found = jax.vmap(at_speed, (None, None, 0))(hub, tip, speeds)
        for k, (name, colour) in enumerate(zip(NAMES, COLOURS, strict=True)):
            ax.plot(speeds, found[:, k], color=colour, label=name, lw=2)
        common.per_turn(ax, speeds, HARMONICS, at=49.5)
        band = speeds[(speeds > WORKING[0]) & (speeds < WORKING[1])]
        for n in HARMONICS:
            ax.fill_between(
                band, n * band * (1 - MARGIN), n * band * (1 + MARGIN), color="0.8", lw=0
            )
        ax.axvspan(*WORKING, color="gold", alpha=0.2, lw=0)
        ax.set(
            xlabel="angular speed (rad/s)", xlim=(0, 50), ylim=(0, 310),
            title=f"{title}: hub {hub:.2f} m, tip mass {tip:.2f} kg, margin {margin:.1%}",
        )  # fmt: skip
        ax.legend(fontsize=8, loc="upper left")
        ax.grid(alpha=0.3)
    axes[0].set_ylabel("frequency (rad/s)")
    common.save_figure(figure, path, dpi=110)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer starts", "the figure and the table")
