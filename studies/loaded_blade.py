"""Frequencies of a blade about the state that a thrust bends it to.

The blade of the NREL 5-MW reference turbine at a pre-cone of 2.5 degrees, under a force per length
across the plane of rotation that grows from zero at the root to the tip. How far it bends, how its
frequencies move with the thrust and with the speed, what moves with them, and which number of the
blade each depends on. By a rod in space; the hybrid theory, linear about the straight beam, knows
nothing of it.

The published table has no stiffness along the blade, none of torsion and no polar inertia: sections
are taken as solid ellipses of one material, GJ = 4 EI_1 EI_2 / (EI_1 + EI_2) / 2.6, along the blade
stiff enough not to matter, and the polar inertia is that of the two bending stiffnesses over that.

    python studies/loaded_blade.py [--quick] [--out FOLDER]
"""

import time
from pathlib import Path
from typing import Any

import common
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

import jaxbeam as jb

TABLE = Path(__file__).parent / "data" / "nrel5mw_blade.csv"
LENGTH, HUB, CONE = 61.5, 1.5, np.radians(2.5)
AXIAL_STIFFNESS = 1e10  # N
RATED, RPM = 12.1, np.pi / 30
THRUST = 257e3  # N of each blade at the rated wind: a third of that of the rotor
LABELS = jb.labels(flap=3, in_plane=2)
NAMES = ("flap 1", "flap 2", "flap 3", "edge 1", "edge 2")
COLOURS = (BLUE, SKY, GREEN, VERMILION, ORANGE)
FACTORS = ("thrust", "flap stiffness", "edge stiffness", "torsional stiffness", "mass", "speed")


def blade(flap: Any = 1.0, edge: Any = 1.0, torsion: Any = 1.0, mass: Any = 1.0) -> jb.Rotor:
    """The blade with properties multiplied all along."""
    table = jb.blades.read_blade(TABLE, length=LENGTH, axial_stiffness=AXIAL_STIFFNESS).beam
    stations = table.mass_per_length.stations
    first, second = (
        getattr(table, name).values
        for name in ("in_plane_bending_stiffness", "flap_bending_stiffness")
    )
    twisting = 4 * first * second / (first + second) / 2.6
    spans = (
        (table.mass_per_length.values, mass), (first, edge), (second, flap), (twisting, torsion)
    )  # fmt: skip
    per_length, in_plane, across, about = (
        jb.Spanwise(stations, value * factor) for value, factor in spans
    )
    beam = jb.Beam(
        LENGTH, per_length, AXIAL_STIFFNESS, in_plane, across, twist=table.twist,
        torsional_stiffness=about,
    )  # fmt: skip
    return jb.Rotor(beam, HUB, precone=CONE)


def pushed(thrust: Any) -> jb.Loads:
    """A force along the span that is zero at the root, and `thrust` in all."""
    most = 2 * jnp.asarray(thrust) / LENGTH
    return jb.Loads(force_per_length=(0.0, 0.0, jb.Spanwise([0, 1], jnp.stack([0 * most, most]))))


def about(model: jb.SpatialRod, thrust: Any, rpm: Any, **factors: Any) -> jb.results.Modes:
    """Modes about the state under a thrust."""
    rotor = blade(**factors)
    return jb.modes(model, rotor, rpm * RPM, LABELS, loads=pushed(thrust), throw=False)


def state(model: jb.SpatialRod, thrust: Any, rpm: Any) -> jax.Array:
    """Displacement of the tip, in m, and its twist, in degrees."""
    rotor = blade()
    found = jb.steady(model, rotor, rpm * RPM, loads=pushed(thrust), throw=False)
    return jnp.concatenate([found.tip, jnp.degrees(found.torsion(1.0))])


def sensitivities(model: jb.SpatialRod) -> np.ndarray:
    """d ln f / d ln p of each mode (row) by each of `FACTORS`, at the rated thrust and speed."""

    def logarithm(p: jax.Array) -> jax.Array:
        found = about(
            model, THRUST * p[0], RATED * p[5], flap=p[1], edge=p[2], torsion=p[3], mass=p[4]
        )
        return jnp.log(found.frequency)

    return np.asarray(jax.jit(jax.jacfwd(logarithm))(jnp.ones(6)))


def draw(path: Path, thrusts: Any, states: Any, moved: Any, diagram: Any, slopes: Any) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(12.0, 8.6), layout="constrained")
    ax = axes[0, 0]
    for column, name, colour in ((2, "flap", BLUE), (1, "edge", VERMILION), (0, "along", GREEN)):
        ax.plot(thrusts / 1e3, states[:, column], color=colour, label=name)
    ax.set(xlabel="thrust of the blade (kN)", ylabel="displacement of the tip (m)")
    twin = ax.twinx()
    twin.plot(thrusts / 1e3, states[:, 3], color=PURPLE, ls="--", label="twist (right)")
    twin.set_ylabel("twist of the tip (degrees)")
    lines = [*ax.get_lines(), *twin.get_lines()]
    ax.legend(lines, [line.get_label() for line in lines], loc="upper left")
    ax.set_title(f"State at {RATED} rpm")
    ax = axes[0, 1]
    for row, name, colour in zip(moved.T, NAMES, COLOURS, strict=True):
        ax.plot(thrusts / 1e3, 100 * (row / row[0] - 1), color=colour, label=name)
    ax.axhline(0.0, color="0.6", lw=0.8, zorder=0)
    ax.set(xlabel="thrust of the blade (kN)", ylabel="change of the frequency (%)")
    ax.set_title(f"Frequencies at {RATED} rpm over those without thrust")
    ax.legend(loc="lower left")
    ax = axes[1, 0]
    rpm, free, loaded = diagram
    for k, (name, colour) in enumerate(zip(NAMES, COLOURS, strict=True)):
        ax.plot(rpm, free[:, k], color=colour, label=name)
        ax.plot(rpm, loaded[:, k], color=colour, ls="--")
    common.per_turn(ax, rpm, (1, 2, 3, 6, 9), rpm[-1], 1 / 60)
    ax.set(xlabel="speed (rpm)", ylabel="frequency (Hz)")
    ax.set_ylim(0.0, 1.08 * np.nanmax(free))
    ax.set_title(f"No thrust (lines) and {THRUST / 1e3:.0f} kN (dashed)")
    ax.legend(loc="center left", bbox_to_anchor=(0.0, 0.6), fontsize="small")
    ax = axes[1, 1]
    place, width = np.arange(len(FACTORS)), 0.16
    for k, (name, colour) in enumerate(zip(NAMES, COLOURS, strict=True)):
        ax.bar(place + (k - 2) * width, slopes[k], width, color=colour, label=name)
    ax.axhline(0.0, color="0.3", lw=0.8)
    ax.set_xticks(place, [name.replace(" ", "\n") for name in FACTORS])
    ax.set_ylabel("d ln frequency / d ln number")
    ax.legend(loc="lower left", fontsize="small")
    ax.set_title(f"What each depends on at {RATED} rpm and {THRUST / 1e3:.0f} kN")
    common.save_figure(figure, path, 110)


def main(quick: bool, out: Path | None) -> Path:
    began, out = time.perf_counter(), common.folder(out, "loaded_blade")
    model = jb.SpatialRod(6 if quick else 12)
    thrusts = np.linspace(0.0, 400e3, 3 if quick else 9)
    rpm = np.linspace(0.0, 14.0, 3 if quick else 8)
    print(f"{model}: states and frequencies under {len(thrusts)} thrusts", flush=True)
    states = np.asarray(jax.jit(jax.vmap(lambda f: state(model, f, RATED)))(thrusts))
    at_rated = np.stack([thrusts, 0 * thrusts + RATED], 1)
    at_speeds = [np.stack([0 * rpm + thrust, rpm], 1) for thrust in (0.0, THRUST)]
    cases = np.concatenate([at_rated, *at_speeds])
    found = jax.jit(jax.vmap(lambda case: about(model, case[0], case[1])))(cases)
    hertz = np.asarray(found.frequency) / (2 * np.pi)
    moved, free, loaded = np.split(hertz, [len(thrusts), len(thrusts) + len(rpm)])
    shares = np.asarray(found.energy_share)[: len(thrusts)]
    print("slopes by " + ", ".join(FACTORS), flush=True)
    slopes = sensitivities(model)
    hybrid = jb.modes(jb.Hybrid(0, 16, 16), plain(), RATED * RPM, LABELS).frequency / (2 * np.pi)
    for k, name in enumerate(NAMES):
        print(
            f"{name:7s} {moved[0, k]:7.4f} Hz, {100 * (moved[-1, k] / moved[0, k] - 1):+6.2f} % at "
            f"{thrusts[-1] / 1e3:.0f} kN (share of torsion {shares[0, k, 3]:.4f} to "
            f"{shares[-1, k, 3]:.4f}); Hybrid without cone {hybrid[k]:7.4f} Hz at any thrust"
        )
    rows = [
        [f, *each, *row, *share[:, 3]]
        for f, each, row, share in zip(thrusts, states, moved, shares, strict=True)
    ]
    header = ["thrust (N)", *(f"tip {way} (m)" for way in ("along", "edge", "flap"))]
    header += ["tip twist (deg)", *(f"{name} (Hz)" for name in NAMES)]
    common.write_csv(
        out / "thrust.csv", [*header, *(f"{n}: share of torsion" for n in NAMES)], rows
    )
    common.write_csv(
        out / "speed.csv", ["rpm", "thrust (N)", *(f"{name} (Hz)" for name in NAMES)],
        [[w, f, *row] for f, part in ((0.0, free), (THRUST, loaded))
         for w, row in zip(rpm, part, strict=True)],
    )  # fmt: skip
    common.write_csv(
        out / "slopes.csv", ["mode", *FACTORS],
        [[name, *row] for name, row in zip(NAMES, slopes, strict=True)],
    )  # fmt: skip
    draw(out / "loaded_blade.png", thrusts, states, moved, (rpm, free, loaded), slopes)
    return common.finish(began, "loaded_blade.png and three tables", out)


def plain() -> jb.Rotor:
    """The blade without its cone."""
    return jb.Rotor(blade().beam, HUB)


if __name__ == "__main__":
    common.run(main, __doc__, "six elements and fewer cases", "the figure and three tables")
