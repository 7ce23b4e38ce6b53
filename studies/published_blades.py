"""Published blades as their files say: a dispute on one, and how far two files of another go apart.

The first edgewise frequency of the blade of the IEA 15-MW turbine is 0.642 Hz in its report
(Gaertner et al. 2020), and 0.732 Hz as others compute from its files (issue 278 of its repository).
Of the blade of the IEA 22-MW turbine there are files of BeamDyn and of HAWC2, made of each other.
This reads each file with its sections as they are, and says the frequencies of the blade clamped at
its root, at rest; those of the straight beam that is left of it without couplings, offsets, shear
and curvature, with its twist and without; and, for files of blades of the same length to 1 %,
deflection and twist of the tip under a load that rises along the span, up to where the first of
them would, were it linear, bend by a quarter of its length.

Give paths of files that you have, of any of the formats with full sections that `read_blade` takes
(BeamDyn's primary file, htc of HAWC2 with FPM 1, windIO). The turbines are in the repositories
IEA-15-240-RWT and IEA-22-280-RWT of IEAWindSystems; there an htc of the former names the st file
without FPM, which two of its lines change. Without any it takes the made-up blades of the tests,
which are one blade.

    python studies/published_blades.py [--quick] [--out FOLDER] [FILE ...]
"""

import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import common
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

import jaxbeam as jb
from jaxbeam.blades import Blade, read_blade

MADE_UP = [
    Path(__file__).parents[1] / "tests" / "data" / "sections" / name
    for name in ("primary_beamdyn.inp", "blade_windio.yaml", "blade_hawc2.htc")
]
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)
COUNT = 4
SAID = {117: (0.642, 0.732)}  # Hz, by the length in m
NEAR = 1e-4  # of the length: points of the axis that are nearer are one


def read(path: Path) -> Blade:
    """The blade of a file, with what its reader warns of on the screen."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        blade = read_blade(path).beam
    for warning in said:
        print(f"    warning: {warning.message}")
    if not isinstance(blade, Blade):
        raise SystemExit(f"{path}: give a file with full sections, of BeamDyn, HAWC2 or windIO")
    return blade


def places_of(rows: Sequence[tuple[float, ...]], near: float) -> list[float]:
    """All of these places that are apart."""
    every = np.unique(np.concatenate(rows))
    apart = np.concatenate([[True], np.diff(every) > near])
    return [*every[apart & (every < 1 - near)].tolist(), 1.0]


def alike(blades: Sequence[Blade]) -> list[Blade]:
    """The same blades with stations at the same places: one program serves all."""
    stations = places_of([blade.stations for blade in blades], 1e-9)
    points = places_of([blade.axis_stations for blade in blades], NEAR)
    at, line = np.array(stations), np.array(points)
    return [
        Blade(
            stations, blade.stiffness_at(at), blade.inertia_at(at), blade.axis_at(line)[0],
            blade.twist_at(line), points,
        )
        for blade in blades
    ]  # fmt: skip


def answers(model: Any) -> Any:
    """Of a blade and a load: frequencies (Hz) about it, shares of energy, deflection of the tip
    downwind (m), and its twist (degrees)."""

    @jax.jit
    def of(blade: Blade, load: Any) -> Any:
        rotor = jb.Rotor(blade)
        rising = jb.Spanwise([0.0, 1.0], jnp.stack([0 * load, load]))
        loads = jb.Loads(force_per_length=[0.0, 0.0, rising])
        state = jb.steady(model, rotor, 0.0, loads=loads, throw=False)
        found = jb.modes(model, rotor, 0.0, 2 * COUNT, loads=loads, throw=False)
        tip = state.displacement(1.0)[0], jnp.degrees(state.torsion(1.0)[0])
        return found.frequency_hz, found.energy_share, tip[0][2], tip[1]

    return of


def edgewise(frequencies: np.ndarray, shares: np.ndarray) -> float:
    """The first of the two lowest that is in plane."""
    return float(frequencies[:2][np.argmax(shares[:2, jb.models.Direction.IN_PLANE])])


@jax.jit
def straight(blade: Blade, twisted: Any) -> Any:
    """Lowest frequencies in flap and in plane of the slender beam that is left of a blade, with its
    twist (1) or without (0)."""
    beam = blade.beam()
    twist: Any = beam.twist
    plain = jb.Beam(
        beam.length, beam.mass_per_length, beam.axial_stiffness, beam.in_plane_bending_stiffness,
        beam.flap_bending_stiffness, twist=jb.Spanwise(twist.stations, twisted * twist.values),
    )  # fmt: skip
    which = jb.labels(flap=1, in_plane=1)
    return jb.modes(jb.Hybrid(0, 14, 14), jb.Rotor(plain), 0.0, which, throw=False).frequency_hz


def loaded(of: Any, blades: Sequence[Blade], shares: np.ndarray) -> list[dict[str, np.ndarray]]:
    """Frequencies, deflections and twists over the load, which is the same for all."""
    tiny = 1e-6
    *_, bent, _ = of(blades[0], jnp.asarray(tiny))
    full = 0.25 * float(blades[0].length) * tiny / float(bent)
    out = []
    for blade in blades:
        frequencies, energies, deflection, twist = (
            np.stack(rows)
            for rows in zip(*(of(blade, jnp.asarray(full * s)) for s in shares), strict=True)
        )
        edge = [edgewise(f, e) for f, e in zip(frequencies, energies, strict=True)]
        out.append(
            {"frequencies": frequencies, "edge": np.array(edge), "deflection": deflection,
             "twist": twist}
        )  # fmt: skip
    return out


def grouped(blades: Sequence[Blade]) -> list[list[int]]:
    """Which of them are as long as one another."""
    groups: list[list[int]] = []
    for i, blade in enumerate(blades):
        for group in groups:
            if abs(float(blade.length / blades[group[0]].length) - 1) < 0.01:
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def report(
    paths: Sequence[Path], blades: Sequence[Blade], same: Sequence[Blade], found: dict[int, Any]
) -> None:
    """What each file says at rest, and how far others of the same blade are from the first."""
    for i, own in found.items():
        values = ", ".join(f"{f:.4f}" for f in own["frequencies"][0][:COUNT])
        size = f"{float(blades[i].length):.2f} m, {float(blades[i].mass):.0f} kg"
        print(f"  {paths[i].name}: {size}, {values} Hz; edgewise {own['edge'][0]:.4f} Hz")
        for twisted in (True, False):
            flap, edge = straight(same[i], jnp.asarray(float(twisted)))
            print(f"    straight, slender, {'with' if twisted else 'without'} twist: flap "
                  f"{flap:.4f}, edgewise {edge:.4f} Hz")  # fmt: skip
        for said in SAID.get(round(float(blades[i].length)), ()):
            print(f"    edgewise over {said} Hz less 1: {own['edge'][0] / said - 1:+.3f}")
    for group in grouped(blades):
        for i in group[1:]:
            for name in ("edge", "deflection", "twist"):
                by = [found[k][name] for k in (group[0], i)]
                with np.errstate(divide="ignore", invalid="ignore"):
                    gap = 100 * (by[1] / by[0] - 1)
                shown = ", ".join(f"{g:.2f}" for g in gap[0 if name == "edge" else 1 :])
                print(f"  {paths[i].name} from {paths[group[0]].name}, {name} as the load rises: "
                      f"{shown} %")  # fmt: skip


def draw(
    path: Path, paths: Sequence[Path], groups: list[list[int]], found: dict[int, Any],
    shares: np.ndarray,
) -> None:  # fmt: skip
    """Edgewise frequencies, deflections and twists over the load."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.6), layout="constrained")
    for i, colour in zip(found, COLOURS, strict=False):
        group = next(g for g in groups if i in g)
        first = i == group[0]
        style = {"color": colour, "lw": 4 if first else 1.5, "alpha": 0.4 if first else 1.0}
        for ax, name in zip(axes, ("edge", "deflection", "twist"), strict=True):
            ax.plot(shares, found[i][name], **style, label=paths[i].name)
    for ax, unit in zip(axes, ("first edgewise frequency (Hz)", "deflection of the tip (m)",
                               "twist of the tip (degrees)"), strict=True):  # fmt: skip
        ax.set(xlabel="load over the largest one", ylabel=unit)
        ax.grid(color="0.92")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3,
                  fontsize=8)  # fmt: skip
    common.save_figure(figure, path, dpi=110)


def main(quick: bool = False, out: Path | None = None, files: Sequence[Path] = ()) -> Path:
    """Run all of it; returns the folder that holds the figure and the tables."""
    began = time.perf_counter()
    out = common.folder(out, "published_blades")
    paths = list(files) or MADE_UP
    blades = []
    for path in paths:
        print(f"  {path.name}")
        blades.append(read(path))
    of = answers(jb.SpatialRod(8 if quick else 6, 1 if quick else 6))
    shares = np.linspace(0.0, 1.0, 2 if quick else 6)
    groups, same = grouped(blades), alike(blades)
    found: dict[int, Any] = {}
    for group in groups:
        found |= dict(zip(group, loaded(of, [same[i] for i in group], shares), strict=True))
    report(paths, blades, same, found)
    draw(out / "published_blades.png", paths, groups, found, shares)
    rows = [
        (paths[i].name, share, *(float(found[i][k][j]) for k in ("edge", "deflection", "twist")),
         *found[i]["frequencies"][j][:COUNT])
        for i in found for j, share in enumerate(shares)
    ]  # fmt: skip
    header = ("file", "load", "edgewise_hz", "deflection_m", "twist_deg",
              *(f"frequency_{k + 1}_hz" for k in range(COUNT)))  # fmt: skip
    common.write_csv(out / "published_blades.csv", header, rows)
    return common.finish(began, "figure and table are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "one element, two loads", "the figure and the table", files=True)
