"""Beams in space: bent both ways, twisted and buckled, where theories of second order end.

1. The Princeton beam, a cantilever that carries a weight at its tip and is turned about its
   length, beside what other programs computed for it; and a wing that hangs under its own weight,
   beside what was measured of it.
2. Lateral buckling: a narrow cantilever bent in its stiff direction gives way sideways. Its
   critical load over the ratio of stiffnesses, the way sideways as the load rises beyond it, and
   the way back as the beam is spun up.
3. Spin-up about inclined axes to large deflections: how far hybrid, classical and von Karman
   theories are from a rod in space, and how their error goes with the deflection.
4. A filmstrip of one of these.

    python studies/space.py [--quick] [--out FOLDER]
"""

import csv
import functools
import time
from pathlib import Path
from typing import Any, NamedTuple

import common
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import BLUE, GREEN, ORANGE, VERMILION
from matplotlib.ticker import NullFormatter

import jaxbeam as jb
from jaxbeam.plot import filmstrip

DATA = Path(__file__).parent / "data"
STILL = jb.ConstantSpeed(0.0)
PRINCETON = jb.Beam(0.508, 0.107, 2.84191e6, 36.2794, 2.42873, torsional_stiffness=3.10338)
ANGLES = np.linspace(0.0, 90.0, 31)  # degrees
WING = jb.Rotor(
    jb.Beam(0.4508, 0.2351, 1e6, 18.44, 0.4186, torsional_stiffness=0.9539, polar_inertia=2.056e-5),
    tip_mass=0.0417,
)
GRAVITY = 9.807  # m/s^2


def numbers(name: str) -> list[dict[str, str]]:
    with open(DATA / name) as file:
        return list(csv.DictReader(file))


def at_angles(model: Any, rotor: jb.Rotor, loads: Any, angles: Any) -> Any:
    """Displacement (k, 3) and twist (k) of the tip under loads that a function makes of the angle
    in rad."""
    return _deflected(model)(rotor, jax.vmap(loads)(jnp.radians(jnp.asarray(angles))))


@functools.cache
def _deflected(model: Any) -> Any:
    """Of a rotor and many loads."""

    def of(rotor: jb.Rotor, loads: jb.Loads) -> Any:
        state = jb.steady(model, rotor, 0.0, loads=loads, throw=False)
        return state.tip, state.torsion(1.0)[0]

    return jax.jit(jax.vmap(of, (None, 0)))


def across(angle: Any, size: Any) -> Any:
    """A vector that points in the stiff direction at the angle zero, and in the soft one at a right
    angle."""
    return size * jnp.stack([0 * angle, jnp.cos(angle), jnp.sin(angle)])


def princeton(out: Path, quick: bool) -> None:
    """Tip displacement and twist over the angle of the load, and where each program differs."""
    model, rows = jb.SpatialRod(4 if quick else 8), numbers("princeton_beam.csv")
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
    header = ("source", "load_N", "angle_deg", "flap_m", "chord_m", "flap_ours_m", "chord_ours_m")
    table: list[tuple[Any, ...]] = []
    markers = {"ansys_beam": "o", "ansys_solid": "^", "exudyn": "s", "mbdyn": "x"}
    apart: dict[str, list[float]] = {source: [] for source in markers}
    for weight, colour in ((4.448, GREEN), (8.896, BLUE), (13.345, VERMILION)):

        def loads(angle: Any, weight: float = weight) -> jb.Loads:
            return jb.Loads(tip_force=across(angle, weight))

        tip, twist = at_angles(model, jb.Rotor(PRINCETON), loads, ANGLES)
        linear = at_angles(jb.Hybrid(0, 6, 6), jb.Rotor(PRINCETON), loads, ANGLES)[0]
        for ax, values in zip(axes, (tip[:, 2], tip[:, 1], np.degrees(twist)), strict=True):
            ax.plot(ANGLES, values, color=colour, lw=1.3, label=f"{weight:g} N")
        for ax, c in zip(axes, (2, 1), strict=False):
            ax.plot(ANGLES, linear[:, c], ":", color=colour, lw=1)
        for row in rows:
            if float(row["load_N"]) != weight:
                continue
            angle, flap, chord = (float(row[k]) for k in ("angle_deg", "flap_m", "chord_m"))
            (own,) = tip[np.isclose(ANGLES, angle)]
            for ax, value in zip(axes, (flap, chord), strict=False):
                ax.plot(angle, value, markers[row["source"]], mfc="none", color="0.25", ms=5)
            ours = float(own[2]), float(own[1])
            table.append((row["source"], weight, angle, flap, chord, *ours))
            size = float(np.linalg.norm(own[1:]))
            apart[row["source"]].append(float(np.hypot(own[2] - flap, own[1] - chord)) / size)
    for source, marker in markers.items():
        axes[0].plot([], [], marker, mfc="none", color="0.25", label=source.replace("_", ", "))
        print(
            f"  Princeton beam, {source}: within {100 * max(apart[source]):.2f} % of the"
            " displacement of the tip"
        )
    axes[0].plot([], [], ":", color="0.25", label="linear")
    for ax, title in zip(axes, ("soft way (m)", "stiff way (m)", "twist (degrees)"), strict=True):
        ax.set(xlabel="angle of the load (degrees)", ylabel=f"tip, {title}", xticks=ANGLES[::5])
        ax.grid(color="0.92")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=8,
                  fontsize=8)  # fmt: skip
    common.save_figure(figure, out / "princeton.png", dpi=130)
    common.write_csv(out / "princeton.csv", header, table)


def wing(quick: bool) -> None:
    """What was measured of the wing, over what a rod says."""

    def weight(angle: Any) -> jb.Loads:
        return jb.Loads(gravity=across(np.pi / 2 - angle, GRAVITY))

    rows = [row for row in numbers("tang_dowell_2001_wing.csv") if row["flap_m"]]
    angles = [float(row["root_angle_deg"]) for row in rows]
    tip, twist = at_angles(jb.SpatialRod(4 if quick else 8), WING, weight, angles)
    print("  wing under its own weight, measured / ours: root angle, flap, chord (mm), twist (deg)")
    for row, at, turn in zip(rows, tip, twist, strict=True):
        flap, chord, measured = (float(row[k]) for k in ("flap_m", "chord_m", "twist_deg"))
        print(
            f"    {row['root_angle_deg']:>3s}  {1e3 * flap:7.2f} / {1e3 * abs(at[2]):5.2f}"
            f"  {1e3 * chord:6.3f} / {1e3 * abs(at[1]):5.3f}"
            f"  {measured:6.3f} / {abs(np.degrees(turn)):5.3f}"
        )


def narrow(ratio: Any) -> jb.Rotor:
    """A cantilever of L = rho = 1 whose soft bending stiffness is 1, this share of the stiff one.
    It twists as a thin rectangle of metal does, GJ / EI = 2 / (1 + 0.3)."""
    beam = jb.Beam(1.0, 1.0, 1e4 / ratio, 1 / ratio, 1.0, torsional_stiffness=2 / 1.3)
    return jb.Rotor(beam)


SIDEWAYS = np.sqrt(2 / 1.3)  # (EI GJ)^(1/2) of it
RATIO, BEYOND, TOP = 0.05, 1.2, 4.0  # of the runs; load over the critical one, speed in rad/s
DOWN = jb.Loads(tip_force=[0.0, -1.0, 0.0])


class Ramp(NamedTuple):
    """A load that rises to `largest` in `duration`, and a three-hundredth of it sideways."""

    largest: Any
    duration: Any

    def __call__(self, t: Any) -> Any:
        size = self.largest * jnp.clip(t / self.duration, 0.0, 1.0)
        return jnp.stack([0 * size, -size, size / 300])


class Later(NamedTuple):
    """A spin-up that begins at `start`."""

    spin_up: jb.motions.Motion
    start: Any

    def __call__(self, t: Any) -> Any:
        return self.spin_up.velocities(jnp.maximum(t - self.start, 0.0))[1]


def still(t: Any) -> Any:
    return jnp.zeros(3)


def buckling(out: Path, quick: bool) -> None:
    """Critical loads; then one run: a load that rises slowly beyond, and then a slow spin-up."""
    model = jb.SpatialRod(4 if quick else 10)
    ratios = np.array([1e-3, 0.025, 0.05, 0.1, 0.15, 0.2])
    rotor, speeds = narrow(jnp.asarray(RATIO)), np.linspace(0.0, TOP, 9)

    def critical(ratio: Any, speed: Any) -> Any:
        return jb.critical_load(model, narrow(ratio), DOWN, speed).factor

    both = np.append(ratios, np.full(9, RATIO)), np.append(np.zeros(len(ratios)), speeds)
    loads, over = np.split(np.asarray(jax.jit(jax.vmap(critical))(*both)), [len(ratios)])
    ramp = 10.0 if quick else 40.0
    push = Ramp(BEYOND * over[0], jnp.asarray(ramp))
    up = jb.SmoothSpinUp(TOP, ramp)
    motion = jb.motions.HubVelocity(
        still, jax.tree_util.Partial(Later(up, jnp.asarray(ramp))), changes=[ramp, 2 * ramp]
    )
    times = np.linspace(0.0, 2 * ramp, 401)
    run = jb.simulate(
        model, rotor, motion, times, loads=jb.Loads(tip_force=push, changes=[ramp]),
        damping=jb.Damping(mass_coefficient=2.0, stiffness_coefficient=1e-3), max_steps=100_000,
    )  # fmt: skip
    aside, lowered = np.abs(run.tip[:, 2]), -run.tip[:, 1]
    rising = times <= ramp

    figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
    axes[0].axhline(4.0126, color="0.6", lw=1, label="4.0126 (Prandtl, Michell)")
    axes[0].plot(ratios, loads / SIDEWAYS, "o-", color=BLUE, ms=4, lw=1.3, label="rod")
    axes[0].set(xlabel="soft over stiff bending stiffness",
                ylabel=r"critical load $P L^2 / (EI\,GJ)^{1/2}$")  # fmt: skip
    share = BEYOND * times[rising] / ramp
    axes[1].plot(share, aside[rising], color=VERMILION, lw=1.3, label="sideways")
    axes[1].plot(share, lowered[rising], color=BLUE, lw=1.3, label="the way the load pulls")
    axes[1].axvline(1.0, color="0.6", lw=1)
    axes[1].set(xlabel="load over the critical one", ylabel="tip displacement / L")
    speed = np.asarray(jax.vmap(up.angular_speed)(jnp.asarray(times[~rising] - ramp)))
    axes[2].plot(speed, aside[~rising], color=VERMILION, lw=1.3, label="sideways")
    axes[2].plot(speed, lowered[~rising], color=BLUE, lw=1.3, label="the way the load pulls")
    back = float(np.interp(BEYOND, over / over[0], speeds))
    axes[2].axvline(back, color="0.6", lw=1)
    axes[2].set(xlabel="angular speed (rad/s)", ylabel="tip displacement / L")
    for ax, title in zip(axes, ("critical load", "the load rises", "then the hub"), strict=True):
        ax.set_title(title, fontsize=10)
        ax.grid(color="0.92")
        ax.legend(fontsize=8)
    common.save_figure(figure, out / "buckling.png", dpi=130)
    for name, by, at, values in (
        ("buckling", "stiffness_ratio", ratios, loads),
        ("buckling_in_rotation", "angular_speed", speeds, over),
    ):
        pairs = zip(at.tolist(), (values / SIDEWAYS).tolist(), strict=True)
        common.write_csv(out / f"{name}.csv", (by, "critical_load"), pairs)
    print(
        f"  lateral buckling: {loads[0] / SIDEWAYS:.4f} (EI GJ)^1/2 / L^2 in the narrow limit;"
        f" at {BEYOND:g} times the critical load the tip is {aside[rising][-1]:.2f} L aside, and"
        f"\n    spinning straightens it: {back:.2f} rad/s make the load the critical one, at"
        f" {TOP:g} rad/s it is {aside[-1]:.4f} L aside"
    )


BLADE = jb.Beam(1.0, 1.0, 4e4, 1.0, 0.5, torsional_stiffness=0.4)
INCLINED = jb.Rotor(BLADE)
AXIS = jb.motions.inclined_axis(np.radians(60.0))
END = 3.0  # s: the spin-up takes two, a period in flap at rest 2.5
MODELS = {
    "classical": jb.Classical(0, 4, 4), "hybrid": jb.Hybrid(0, 4, 4),
    "von Karman": jb.VonKarman(9, 4, 4),
}  # fmt: skip
COLOURS = {"classical": ORANGE, "hybrid": BLUE, "von Karman": GREEN}


def inclined(out: Path, quick: bool) -> jb.results.Simulation:
    """How wrong simpler theories are; returns the run of the largest deflection."""
    judge = jb.SpatialRod(6 if quick else 10)
    speeds = jnp.asarray(np.geomspace(0.1, 2.6, 4 if quick else 12))
    times = np.linspace(0.0, END, 121)

    def runs(model: Any) -> jb.results.Simulation:
        def run(speed: Any) -> Any:
            return jb.simulate(
                model, INCLINED, jb.SmoothSpinUp(speed, 2.0, AXIS), times, throw=False,
                max_steps=50_000,
            )  # fmt: skip

        return jax.jit(jax.vmap(run))(speeds)

    best = runs(judge)
    exact = np.asarray(best.tip)
    found = {name: np.asarray(runs(model).tip) for name, model in MODELS.items()}
    size = np.linalg.norm(exact[:, :, 1:], axis=2).max(1)
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    for name, tip in {"rod in space": exact, **found}.items():
        look = {"color": COLOURS.get(name, "0.7"), "lw": 1.3 if name in found else 4}
        for c, style in ((1, "-"), (2, "--")):
            axes[0].plot(times, tip[-1, :, c], style, label=name if c == 1 else None, **look)
    axes[0].set(xlabel="time (s)", ylabel="tip / L", ylim=(-1, 1),
                title=f"to {speeds[-1]:.1f} rad/s; solid: in plane, dashed: flap")  # fmt: skip
    rows: list[tuple[Any, ...]] = []
    for name, tip in found.items():
        error = np.linalg.norm(tip - exact, axis=2).max(1) / size
        axes[1].loglog(size, error, "o-", color=COLOURS[name], ms=4, lw=1.3, label=name)
        rows += zip(len(size) * [name], speeds.tolist(), size, error, strict=True)
        law = (error / size**2)[(size > 0.03) & (size < 0.3)]
        print(
            f"  spin-up about an axis inclined by 60 degrees, {name}: error"
            f" {law.min():.2g} to {law.max():.2g} (w/L)^2 of the largest deflection"
        )
    axes[1].loglog(size, size**2, color="0.6", lw=1, label="$(w/L)^2$")
    axes[1].set(xlabel="largest deflection w / L", ylabel="error / largest deflection",
                xlim=(0.02, 1), ylim=(1e-6, 10), title="what theories leave out")  # fmt: skip
    axes[1].xaxis.set_minor_formatter(NullFormatter())
    for ax in axes:
        ax.grid(color="0.92")
        ax.legend(fontsize=8)
    common.save_figure(figure, out / "inclined.png", dpi=130)
    common.write_csv(out / "inclined.csv", ("model", "angular_speed", "size", "error"), rows)
    return jax.tree.map(lambda a: a[-1], best)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds figures and tables."""
    began = time.perf_counter()
    out = common.folder(out, "space")
    princeton(out, quick)
    wing(quick)
    buckling(out, quick)
    run = inclined(out, quick)
    common.save_figure(filmstrip(run), out / "filmstrip.png", dpi=130)
    return common.finish(began, "figures and tables are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer elements and cases", "figures and tables")
