"""Film of an abrupt spin-up: the beam of Yoo, Ryan and Scott (Y), Figs. 3 and 4.

Hybrid (linear, with motion-induced stiffness) and geometrically exact beam; the tip of the
latter moves three quarters of the length, so this is where the two part. Writes a filmstrip of
shapes in the hub frame and in space, coloured by time, and an animated GIF of the two in space.

    python studies/spin_up_film.py [--quick] [--out FOLDER]
"""

import time
from pathlib import Path
from typing import Any

import common
import jax
import matplotlib.pyplot as plt
import numpy as np
from common import BLUE, STIFF, VERMILION
from matplotlib.animation import FuncAnimation, PillowWriter

import jaxbeam as jb

ROTOR = jb.Rotor(jb.Beam(*STIFF))
MOTION = jb.motions.QuinticSpinUp(0.31, 1.0)
END = 20.0  # s: about one turn
LENGTH = float(ROTOR.beam.length)
XI = np.linspace(0, 1, 41)
HYBRID, NONLINEAR = "hybrid", "geometrically exact"
COLOURS = {HYBRID: VERMILION, NONLINEAR: BLUE}

Shapes = dict[str, Any]  # (T, p, 2) in m, for each model


def shapes(times: Any, quick: bool) -> tuple[Shapes, Shapes]:
    """The beams in the hub frame and in space."""
    turn = np.asarray(jax.vmap(MOTION.attitude)(times))[:, :2, :2]
    hub, space = {}, {}
    models = {HYBRID: jb.Hybrid(0, 8, 0), NONLINEAR: jb.PlanarRod(4 if quick else 8)}
    for name, model in models.items():
        run = jb.simulate(model, ROTOR, MOTION, times)
        place = np.asarray(run.displacement(XI))[:, :, :2] + np.outer(LENGTH * XI, [1, 0])
        hub[name], space[name] = place, np.einsum("tij,tpj->tpi", turn, place)
        tip, at = (float(x) for x in run.peak())
        print(f"{name:25s} tip {tip:7.2f} m = {tip / LENGTH:5.2f} L at {at:.2f} s")
    return hub, space


def filmstrip(out: Path, times: Any, hub: Shapes, space: Shapes) -> None:
    """A shape each second, and the path of the tip; a row for each model."""
    figure, axes = plt.subplots(
        2, 2, figsize=(8.3, 9), layout="constrained", width_ratios=[36, 68],
        sharex="col", sharey=True,
    )  # fmt: skip
    colour = plt.get_cmap("viridis")
    for row, name in zip(axes, hub, strict=True):
        for ax, place, title in zip(
            row, (hub[name], space[name]), ("hub frame", "space"), strict=True
        ):
            for k in range(0, len(times), (len(times) - 1) // 20):
                ax.plot(*place[k].T, color=colour(times[k] / END), lw=1.4)
            (path,) = ax.plot(*place[:, -1].T, ":", color="k", lw=1, label="path of the tip")
            ax.plot(0, 0, "o", color="k", ms=5)
            ax.set_title(f"{name}, {title}", fontsize=10)
            ax.set(xlim=(-2, 34), ylim=(-34, 34), aspect="equal")
            ax.grid(color="0.92")
        row[0].set_ylabel("y (m)")
        row[1].set_xlim(-34, 34)
    for ax in axes[1]:
        ax.set_xlabel("x (m)")
    figure.legend(handles=[path], loc="outside lower center", fontsize=9)
    scale = plt.cm.ScalarMappable(plt.Normalize(0, END), colour)
    figure.colorbar(scale, ax=axes, label="time (s)", shrink=0.6)
    common.save_figure(figure, out / "spin_up_film.png", dpi=110)


def animation(out: Path, times: Any, space: Shapes) -> None:
    """Both beams in space, with the paths of their tips."""
    figure, ax = plt.subplots(figsize=(4.2, 4.7))
    figure.subplots_adjust(left=0.16, right=0.97, top=0.92, bottom=0.2)
    ax.set(xlim=(-34, 34), ylim=(-34, 34), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    beams = {name: ax.plot([], [], color=COLOURS[name], lw=2.5, label=name)[0] for name in space}
    paths = {name: ax.plot([], [], ":", color=COLOURS[name], lw=1)[0] for name in space}
    ax.plot(0, 0, "o", color="k", ms=5)
    figure.legend(loc="lower center", fontsize=8, ncols=2)

    def frame(k: int) -> list[Any]:
        for name, place in space.items():
            beams[name].set_data(*place[k].T)
            paths[name].set_data(*place[: k + 1, -1].T)
        ax.set_title(f"{times[k]:.1f} s", fontsize=10)
        return []

    film = FuncAnimation(figure, frame, frames=len(times))
    film.save(out / "spin_up_film.gif", writer=PillowWriter(fps=10), dpi=75)
    plt.close(figure)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the filmstrip and the animation."""
    began = time.perf_counter()
    out = common.folder(out, "spin_up_film")
    times = np.linspace(0, END, 41 if quick else 81)
    hub, space = shapes(times, quick)
    filmstrip(out, times, hub, space)
    animation(out, times, space)
    return common.finish(began, "filmstrip and animation are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer frames and elements", "the filmstrip and the animation")
