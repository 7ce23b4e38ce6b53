"""What studies share: how they are run and timed, what they write, and numbers of beams.

To import it asks for 64-bit floats, and for figures without a display. B is Berzeri and Shabana
1999, Y is Yoo, Ryan and Scott 1995.
"""

import argparse
import csv
import math
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import jaxbeam as jb

jax.config.update("jax_enable_x64", True)
matplotlib.use("Agg")

# Colours of Okabe and Ito.
BLUE, VERMILION, GREEN, ORANGE = "#0072B2", "#D55E00", "#009E73", "#E69F00"
PURPLE, SKY = "#CC79A7", "#56B4E9"

# Beams by their numbers: arrays would start JAX, and scale.py names its cores before that.
ALUMINIUM = {  # of `Beam.from_section`: the beam of Ref. 21 of B, Table 1
    "length": 8.0, "youngs_modulus": 6.895e10, "density": 2767.0, "area": 7.299e-5,
    "in_plane_second_moment": 8.214e-9,
}  # fmt: skip
# Of `Beam`: that of Y Figs. 3 and 4, its data as corrected: 550 kg/m, E = 6.89 GPa.
STIFF = 30.5, 550.0, 6.89e9 * 9.29e-2, 6.89e9 * 7.19e-4, 6.89e9 * 7.19e-4
SPRINGS = 1.0, 1.0, 1.0, 6e5, 300.0  # of `SpringRotor`: Y Figs. 12-14


def aluminium_in_space() -> jb.Beam:
    """`ALUMINIUM` with a section that is alike in all directions, and G = E / 2.6."""
    plane = jb.Beam.from_section(**ALUMINIUM)
    stiffness = plane.in_plane_bending_stiffness
    return jb.Beam(
        plane.length, plane.mass_per_length, plane.axial_stiffness, stiffness, stiffness,
        torsional_stiffness=stiffness / 1.3,
        polar_inertia=2 * ALUMINIUM["density"] * ALUMINIUM["in_plane_second_moment"],
    )  # fmt: skip


class SpinUp(jb.motions.Spin):
    """The sum of two, one of them at rest: one class, so that a model compiles only once."""

    axis: jax.Array
    parts: tuple[jb.motions.Spin, jb.motions.Spin]

    def angle(self, t: Any) -> Any:
        return self.parts[0].angle(t) + self.parts[1].angle(t)


def spin_up(duration: Any, quintic: Any = 0.0, smooth: Any = 0.0, axis: Any = None) -> SpinUp:
    """To the speed `quintic` by Y eq. 21, or to the speed `smooth` by Y eq. 23."""
    parts = jb.motions.QuinticSpinUp(quintic, duration), jb.SmoothSpinUp(smooth, duration, axis)
    return SpinUp(parts[1].axis, parts)


def random_cases(count: int, seed: int) -> Any:
    """Rows of speed, hub radius, tip mass and slenderness of beams of L = rho = EI = 1."""
    rng = np.random.default_rng(seed)
    spans = ((0.0, 12.0), (0.0, 2.0), (0.0, 1.0), (200.0, 1000.0))
    return jnp.asarray(np.stack([rng.uniform(*span, count) for span in spans], 1))


def rotating(case: Any) -> tuple[jb.Rotor, Any]:
    """Of a row of `random_cases`."""
    speed, hub, tip, slenderness = case
    return jb.Rotor(jb.Beam(1.0, 1.0, slenderness**2, 1.0, 1.0), hub, tip), speed


def run(
    main: Callable[..., object], about: str | None, quick: str, out: str, files: bool = False,
    keeps: bool = True,
) -> None:  # fmt: skip
    """Run `main(quick, out)` as the command line says; `quick` and `out` end the help on these
    options. With `files` it takes paths as well: `main(quick, out, files)`. Unless `keeps`, as what
    measures compilation does not, programs are kept between processes."""
    parser = argparse.ArgumentParser(description=(about or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument("--out", type=Path, help=f"folder for {out}")
    if keeps:
        parser.add_argument("--no-keep", action="store_true", help="compile programs anew")
    if files:
        parser.add_argument("files", type=Path, nargs="*", metavar="FILE", help="files to read")
    arguments = parser.parse_args()
    if keeps and not arguments.no_keep and (kept := jb.keep()):
        print(f"programs are kept in {kept}", flush=True)
    main(arguments.quick, arguments.out, *([arguments.files] if files else []))


def folder(out: Path | None, study: str) -> Path:
    """The folder `out`, or one with the name of the study among temporary ones; it is made."""
    out = out or Path(tempfile.gettempdir()) / "jaxbeam" / study
    out.mkdir(parents=True, exist_ok=True)
    return out


def finish(began: float, what: str, out: Path) -> Path:
    """Say how long it took since `began` and what is where; returns the folder."""
    print(f"{time.perf_counter() - began:.0f} s; {what} in {out}")
    return out


def write_csv(path: Path, header: Iterable[str], rows: Iterable[Iterable[Any]]) -> None:
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)


def save_figure(figure: Any, path: Path, dpi: int) -> None:
    """Write a figure, and forget it."""
    figure.savefig(path, dpi=dpi)
    plt.close(figure)


def per_turn(
    ax: Any, speeds: Any, harmonics: Iterable[int], at: float, unit: float = 1.0, style: str = "-"
) -> None:
    """Lines of so many vibrations per turn over the speed, with their names at the speed `at`;
    `unit` is that of speeds over that of frequencies."""
    for n in harmonics:
        ax.plot(speeds, n * speeds * unit, style, color="0.6", lw=1)
        ax.annotate(
            f"{n}/rev", (at, n * at * unit), fontsize=8, color="0.4", ha="right", va="bottom"
        )


def timed(
    repeats: int, function: Callable[..., Any], *args: Any, patience: float = math.inf
) -> tuple[float, Any]:
    """Median of the seconds of so many runs, of fewer once they took longer than `patience` in all,
    and the last result. The first run of all compiles."""
    taken: list[float] = []
    while len(taken) < repeats and sum(taken) < patience:
        start = time.perf_counter()
        result = jax.block_until_ready(function(*args))
        taken.append(time.perf_counter() - start)
    return float(np.median(taken)), result


def cpu_seconds(
    function: Callable[..., Any], *args: Any, repeats: int = 4, patience: float = math.inf
) -> tuple[float, Any]:
    """Least CPU time of so many runs, the first of which may compile, of two once they took longer
    than `patience` in all; and the last result."""
    taken: list[float] = []
    while len(taken) < 2 or (len(taken) < repeats and sum(taken) < patience):
        start = time.process_time()
        result = jax.block_until_ready(function(*args))
        taken.append(time.process_time() - start)
    return min(taken), result


def together(function: Callable[..., Any], *arguments: Iterable[Any]) -> Iterator[Any]:
    """`map` on two threads: compiling takes most of the time, and one core each."""
    with ThreadPoolExecutor(2) as pool:
        yield from pool.map(function, *arguments)
