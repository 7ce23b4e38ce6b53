"""The blade of the NREL 5-MW reference turbine, from its published table of sections.

Campbell diagram, resonances, mode shapes coupled by twist, Southwell coefficients, and what each
station of the table does to each frequency; beside pyBModes on the same table, for frequencies and
for time. Properties are linear between stations, and the mass has no factor. All errors are
relative to twice as many functions, whose own estimate says that they are right to 1e-7.

    python studies/blade.py [--quick] [--out FOLDER]
"""

import dataclasses
import importlib.metadata
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import common
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import BLUE, GREEN, ORANGE, PURPLE, VERMILION

import jaxbeam as jb

TABLE = Path(__file__).parent / "data" / "nrel5mw_blade.csv"
HUB = 1.5  # m
# No column of the table. Motion along the blade is left out, so that it says nothing here.
AXIAL_STIFFNESS = 1e10  # N
BEAM = jb.blades.read_blade(TABLE, length=61.5, axial_stiffness=AXIAL_STIFFNESS).beam
STRAIGHT = dataclasses.replace(BEAM, twist=None)
CUT_IN, RATED, FASTEST = 6.9, 12.1, 20.0  # rpm
RPM = np.pi / 30
FLAP, EDGE = jb.labels(flap=3), jb.labels(in_plane=2)
LOWEST = (FLAP[0], EDGE[0], FLAP[1], EDGE[1], FLAP[2])  # in order of frequency
NAMES = ("flap 1", "edge 1", "flap 2", "edge 2", "flap 3")
COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE)
HARMONICS = (1, 2, 3, 4, 5, 6, 9)
PROPERTIES = {
    "flap_bending_stiffness": ("flap stiffness", BLUE),
    "in_plane_bending_stiffness": ("edge stiffness", VERMILION),
    "mass_per_length": ("mass", GREEN),
}


def few(count: int) -> jb.Hybrid:
    """So many functions in each direction."""
    return jb.Hybrid(0, count, count)


def hertz(model: jb.Hybrid, beam: jb.Beam, rpm: Any) -> Any:
    """The frequencies `LOWEST`."""
    found = jb.modes(model, jb.Rotor(beam, HUB), rpm * RPM, LOWEST, throw=False)
    return found.frequency / (2 * np.pi)


def scaled(beam: jb.Beam, factors: dict[str, Any]) -> jb.Beam:
    """The beam with some properties multiplied, all along or station by station."""
    spans: Any = {
        name: jb.Spanwise(getattr(beam, name).stations, getattr(beam, name).values * factor)
        for name, factor in factors.items()
    }
    return dataclasses.replace(beam, **spans)


# --- pyBModes ------------------------------------------------------------------------------------


def pybmodes_run(per_interval: int, twisted: bool) -> Callable[[float], np.ndarray]:
    """From rpm to its lowest frequencies in Hz; so many elements between two stations, in each of
    which section data are constant. Torsion and stretch are made too stiff to matter."""
    from pybmodes.io.bmi import BMIFile, ScalingFactors, TipMassProps
    from pybmodes.io.sec_props import SectionProperties
    from pybmodes.models._pipeline import run_fem

    x, twist, mass, flap, edge = np.loadtxt(TABLE, delimiter=",", skiprows=2).T
    none, one = np.zeros_like(x), np.ones_like(x)
    section = SectionProperties(
        title="", n_secs=x.size, span_loc=x, str_tw=twist * twisted, tw_iner=none, mass_den=mass,
        flp_iner=1e-3 * one, edge_iner=1e-3 * one, flp_stff=flap, edge_stff=edge,
        tor_stff=1e12 * one, axial_stff=1e12 * one, cg_offst=none, sc_offst=none, tc_offst=none,
    )  # fmt: skip
    tip = TipMassProps(**dict.fromkeys(TipMassProps.__dataclass_fields__, 0.0))
    places = np.arange(per_interval * (x.size - 1) + 1) / per_interval
    nodes = np.interp(places, np.arange(x.size), x)

    def run(rpm: float) -> np.ndarray:
        blade = BMIFile(
            title="", echo=False, beam_type=1, rot_rpm=rpm, rpm_mult=1.0, radius=61.5 + HUB,
            hub_rad=HUB, precone=0.0, bl_thp=0.0, hub_conn=1, n_modes_print=5, tab_delim=False,
            mid_node_tw=False, tip_mass=tip, id_mat=1, sec_props_file="",
            scaling=ScalingFactors(), n_elements=nodes.size - 1, el_loc=nodes,
        )  # fmt: skip
        return np.array([shape.freq_hz for shape in run_fem(blade, 5, section).shapes])

    return run


def has_pybmodes() -> bool:
    try:
        version = importlib.metadata.version("pybmodes")
    except importlib.metadata.PackageNotFoundError:
        print('pyBModes is not installed and left out (python -m pip install ".[bench]").')
        return False
    print(f"pyBModes {version} runs on the same table.")
    return True


# --- what the study says -------------------------------------------------------------------------


def compare(out: Path, quick: bool, peer: bool) -> None:
    """Frequencies side by side; then seconds and errors of a case."""
    rows, error = [], {}
    pairs = [(True, 0.0), (True, RATED)] + [(False, 0.0), (False, RATED)] * (not quick)
    exact, ours = {}, {}
    for twisted, rpm in pairs:
        beam = BEAM if twisted else STRAIGHT
        exact[twisted, rpm] = np.asarray(hertz(few(28), beam, rpm))
        ours[twisted, rpm] = np.asarray(hertz(few(14), beam, rpm))
    theirs = {pair: pybmodes_run(4, pair[0])(pair[1]) for pair in pairs} if peer else {}
    print(
        "\nFrequencies in Hz. Converged: 28 functions; pyBModes: four elements between\n"
        "two stations; 14 functions: in each direction.\n"
        "  twist    rpm  mode     converged    pyBModes  (error)    14 functions  (error)"
    )
    for pair in pairs:
        for k, name in enumerate(NAMES):
            best, own = exact[pair][k], ours[pair][k]
            peers = theirs[pair][k] if peer else np.nan
            rows.append((*pair, name, best, peers, own, peers / best - 1, own / best - 1))
            print(
                f"  {'yes' if pair[0] else 'no':5s} {pair[1]:6.1f}  {name:7s} {best:10.6f}  "
                f"{peers:10.6f}  ({abs(peers / best - 1):.0e})    {own:10.6f}  "
                f"({abs(own / best - 1):.0e})"
            )
    header = ("twist", "rpm", "mode", "converged_Hz", "pybmodes_Hz", "functions_14_Hz")
    common.write_csv(out / "frequencies.csv", (*header, "error_pybmodes", "error_14"), rows)

    # The most of the error over the modes, at rest and at rated speed, with twist.
    cases = 1000 if quick else 10_000
    print(
        f"\nTime of a case: for us {cases} cases of speed and flap stiffness in one jax.vmap, on "
        "this CPU,\nwithout compilation; for pyBModes one of its runs, the fastest of "
        f"{2 if quick else 4}. Errors are the largest\nof five modes, at rest and at rated speed."
    )
    lines = []
    for count in (14,) if quick else (12, 14):
        model = few(count)
        found = [np.asarray(hertz(model, BEAM, rpm)) for rpm in (0.0, RATED)]
        error[count] = largest(found, exact)
        seconds, frequency = sweep(model, cases, 2)
        lines.append((f"jaxbeam, {count} + {count} functions", error[count], seconds / cases))
    draw_sweep(out, cases, frequency)
    for per_interval in ((4,) if quick else (2, 4)) if peer else ():
        run = pybmodes_run(per_interval, True)
        found = [run(rpm) for rpm in (0.0, RATED)]
        taken = []
        for rpm in np.linspace(0.0, FASTEST, 2 if quick else 4):
            start = time.perf_counter()
            run(float(rpm))
            taken.append(time.perf_counter() - start)
        name = f"pyBModes, {per_interval} elements an interval"
        lines.append((name, largest(found, exact), min(taken)))
    for name, gap, seconds in lines:
        print(f"  {name:36s} error {gap:.1e}  {seconds * 1e3:9.3f} ms  "
              f"{seconds * 1e4:8.1f} s for 10,000")  # fmt: skip
    for name, gap, seconds in [x for x in lines if x[0].startswith("pyBModes")]:
        mine = [x for x in lines if x[0].startswith("jaxbeam") and x[1] <= gap]
        if mine:
            best = min(mine, key=lambda line: line[2])
            print(f"  {best[0]} is {seconds / best[2]:.0f} times as fast as {name},\n"
                  f"    at an error of {best[1]:.1e} against {gap:.1e}.")  # fmt: skip
    common.write_csv(out / "times.csv", ("method", "largest_error", "seconds_a_case"), lines)


def largest(found: list[np.ndarray], exact: dict[tuple[bool, float], np.ndarray]) -> float:
    best = np.stack([exact[True, 0.0], exact[True, RATED]])
    return float(np.abs(np.stack(found) / best - 1).max())


def grid_of(cases: int) -> tuple[np.ndarray, np.ndarray]:
    """Speeds in rpm, factors of the flap stiffness."""
    factors = np.linspace(0.8, 1.2, 25)
    return np.linspace(0.0, FASTEST, cases // factors.size), factors


def sweep(model: jb.Hybrid, cases: int, repeats: int) -> tuple[float, Any]:
    """Seconds, the fastest of so many runs, and frequencies (factor, speed, mode)."""

    def case(rpm: Any, factor: Any) -> Any:
        return hertz(model, scaled(BEAM, {"flap_bending_stiffness": factor}), rpm)

    speeds, factors = grid_of(cases)
    run = jax.jit(jax.vmap(case))
    each = [a.ravel() for a in np.meshgrid(speeds, factors)]
    common.timed(1, run, *each)
    best, found = min((common.timed(1, run, *each) for _ in range(repeats)), key=lambda x: x[0])
    return best, np.asarray(found).reshape(factors.size, speeds.size, -1)


def draw_sweep(out: Path, cases: int, frequency: np.ndarray) -> None:
    """How far the nearest of 1 to 6 per turn is from flap 1 and edge 1."""
    speeds, factors = grid_of(cases)
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained", sharey=True)
    turns = np.arange(1, 7)[:, None, None] * speeds / 60
    moving = speeds > 3
    for ax, k in zip(axes, (0, 1), strict=True):
        with np.errstate(divide="ignore"):
            away = np.abs(frequency[..., k] / turns - 1).min(0)
        filled = ax.contourf(
            speeds[moving], factors, 100 * away[:, moving], np.arange(0, 21, 2), extend="max"
        )
        ax.axvline(RATED, color="w", ls="--", lw=1)
        ax.set(title=f"{NAMES[k]} (dashed: rated speed)", xlabel="speed (rpm)")
    axes[0].set_ylabel("factor of the flap stiffness (-)")
    figure.colorbar(filled, ax=axes, label="distance from the nearest of 1P to 6P (%)")
    common.save_figure(figure, out / "sweep.png", dpi=120)


def campbell(out: Path, peer: bool, quick: bool) -> None:
    """Frequencies over speed, resonances, and the points of pyBModes."""
    diagram = jb.campbell(few(14), jb.Rotor(BEAM, HUB), np.linspace(0.0, FASTEST, 41) * RPM, LOWEST)
    speeds = np.asarray(diagram.table.coords["angular_speed"]) / RPM
    frequency = diagram.table["frequency"] / (2 * np.pi)
    figure, ax = plt.subplots(figsize=(9, 6.2), layout="constrained")
    for k, (name, colour) in enumerate(zip(NAMES, COLOURS, strict=True)):
        ax.plot(speeds, frequency[:, k], color=colour, lw=2, label=name)
    common.per_turn(ax, speeds, HARMONICS, at=FASTEST - 0.3, unit=1 / 60)
    found = [c for c in diagram.crossings(HARMONICS) if c.angular_speed > 1.0 * RPM]
    at = np.array([c.angular_speed for c in found]) / RPM
    ax.plot(at, [c.harmonic * a / 60 for c, a in zip(found, at, strict=True)], "ko", ms=4,
            label="resonance")  # fmt: skip
    if peer:
        run = pybmodes_run(4, True)
        few_speeds = np.linspace(0.0, FASTEST, 3 if quick else 6)
        points = np.stack([run(float(rpm)) for rpm in few_speeds])
        ax.plot(few_speeds, points, "x", color="k", ms=7, label=["pyBModes"] + 4 * [None])
    ax.axvspan(CUT_IN, RATED, color="gold", alpha=0.2, lw=0, label="6.9 to 12.1 rpm: in operation")
    ax.set(xlabel="rotor speed (rpm)", ylabel="frequency (Hz)", xlim=(0, FASTEST), ylim=(0, 5.4),
           title="Blade of the NREL 5-MW turbine")  # fmt: skip
    ax.grid(alpha=0.3)
    handles, names = ax.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, fontsize=9)
    common.save_figure(figure, out / "campbell.png", dpi=120)
    common.write_csv(
        out / "campbell.csv", ("rpm", *(f"{n} (Hz)" for n in NAMES)),
        np.column_stack([speeds, frequency]),
    )  # fmt: skip
    names_of = dict(zip(LOWEST, NAMES, strict=True))
    common.write_csv(
        out / "resonances.csv", ("mode", "harmonic", "rpm"),
        [(names_of[c.label], c.harmonic, a) for c, a in zip(found, at, strict=True)],
    )  # fmt: skip
    print("\nResonances between 6.9 and 12.1 rpm: " + ", ".join(
        f"{names_of[c.label]} with {c.harmonic:g}P at {a:.2f}"
        for c, a in zip(found, at, strict=True) if CUT_IN <= a <= RATED
    ) + " rpm.")  # fmt: skip


def southwell(out: Path) -> None:
    """At rest, and the local slope at rated speed."""
    rotor = jb.Rotor(BEAM, HUB)
    rest, rated = (
        np.asarray(jb.southwell(few(14), rotor, rpm * RPM, LOWEST).coefficient)
        for rpm in (0.0, RATED)
    )
    print("\nSouthwell coefficients d(omega^2) / d(Omega^2)")
    for name, a, b in zip(NAMES, rest, rated, strict=True):
        print(f"  {name:7s} at rest {a:8.4f}, at rated speed {b:8.4f}")
    rows = zip(NAMES, rest, rated, strict=True)
    common.write_csv(out / "southwell.csv", ("mode", "at_rest", "at_rated_speed"), rows)


def shapes(out: Path) -> None:
    """Deflections in both directions at rated speed; the larger one is one at its largest."""
    model, xi = few(14), np.linspace(0.0, 1.0, 201)
    found = jb.modes(model, jb.Rotor(BEAM, HUB), RATED * RPM, LOWEST)
    moves = np.array(found.displacement(xi).real).transpose(0, 2, 1)[:, 1:]
    figure, axes = plt.subplots(1, 5, figsize=(14, 3.6), layout="constrained", sharey=True)
    for k, (ax, move) in enumerate(zip(axes, moves, strict=True)):
        move = move / move.flat[np.argmax(np.abs(move))]
        moves[k] = move
        ax.plot(xi, move[1], color=BLUE, lw=2, label="out of the plane (flap)")
        ax.plot(xi, move[0], color=VERMILION, lw=2, label="in the plane (edge)")
        ax.axhline(0, color="0.7", lw=0.8)
        hertz_now = float(found.frequency[k]) / (2 * np.pi)
        ax.set(title=f"{NAMES[k]}, {hertz_now:.3f} Hz", xlabel="position x / L (-)")
    axes[0].set_ylabel("deflection / its largest (-)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    common.save_figure(figure, out / "mode_shapes.png", dpi=120)
    columns = [f"{name} {way}" for name in NAMES for way in ("edge", "flap")]
    common.write_csv(
        out / "mode_shapes.csv", ("x_over_L", *columns),
        np.column_stack([xi, moves.reshape(-1, xi.size).T]),
    )  # fmt: skip
    print("\nShare of the kinetic energy in the plane at rated speed: " + ", ".join(
        f"{name} {float(share):.1%}"
        for name, share in zip(NAMES, found.energy_share[:, 1], strict=True)
    ) + ".")  # fmt: skip


def sensitivities(out: Path) -> None:
    """d ln f / d ln value of the values at every station, at rated speed."""
    model = few(14)
    stations = np.asarray(BEAM.mass_per_length.stations)

    def logarithms(logs: dict[str, Any]) -> Any:
        factors = {name: jnp.exp(value) for name, value in logs.items()}
        return jnp.log(hertz(model, scaled(BEAM, factors), RATED))

    none = {name: jnp.zeros(stations.size) for name in PROPERTIES}
    found = jax.jit(jax.jacrev(logarithms))(none)
    # The part of the span that a station stands for: the integral of its hat function.
    share = np.convolve(np.diff(stations, prepend=0.0, append=1.0), [0.5, 0.5], "valid")
    figure, axes = plt.subplots(5, 1, figsize=(8.5, 11), layout="constrained", sharex=True)
    rows = []
    for k, (ax, name) in enumerate(zip(axes, NAMES, strict=True)):
        for key, (title, colour) in PROPERTIES.items():
            by_station = np.asarray(found[key])[k]
            ax.plot(stations, by_station / share, ".-", color=colour, ms=4, lw=1.3, label=title)
            rows += [
                (name, key, *row)
                for row in zip(stations, by_station, by_station / share, strict=True)
            ]
        ax.axhline(0, color="0.7", lw=0.8)
        ax.set(title=name, xlim=(0, 1))
        ax.grid(alpha=0.3)
    axes[-1].set_xlabel("position of the station x / L (-)")
    figure.supylabel("d ln f / d ln value, per unit of x / L (-)")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    common.save_figure(figure, out / "sensitivities.png", dpi=110)
    header = ("mode", "property", "x_over_L", "of_the_station", "per_unit_of_x_over_L")
    common.write_csv(out / "sensitivities.csv", header, rows)
    print(
        "\nSums over all stations of d ln f / d ln value at rated speed; those of a mode add up "
        "to\nzero, since stiffness and mass times the same factor change no frequency."
    )
    for k, name in enumerate(NAMES):
        sums = [f"{PROPERTIES[key][0]} {np.sum(found[key][k]):+.4f}" for key in PROPERTIES]
        print(f"  {name:7s} " + ", ".join(sums))


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figures and tables."""
    began = time.perf_counter()
    out = common.folder(out, "blade")
    peer = has_pybmodes()
    compare(out, quick, peer)
    campbell(out, peer, quick)
    shapes(out)
    southwell(out)
    sensitivities(out)
    print()
    return common.finish(began, "figures and tables are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer cases, in under 30 s", "figures and tables")
