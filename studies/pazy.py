"""A wing that bends by half of its span, from two loads, beside what was measured of it.

The Pazy wing of the Technion without its skin (see `studies/data`) is held at its root and bears a
mass at its tip: at mid-chord, or on a rod behind the trailing edge, where it twists the wing as
well. Its stiffness as a beam is published, from a model of finite elements; two factors on it, one
of bending out of its plane and one of torsion, are found such that the rod meets two numbers, the
deflection by one mass at mid-chord and the twist by one mass behind. All others are predictions:
deflections and twists under all masses, measured to 39 % of the span, and of a published solid
model to half of it, which is calibrated on two of its own numbers in the same way.

What holds the mass behind the wing is a piece of the rod: its axis turns back at the tip, stiff and
without mass, so that the moment of the weight is that of the place to which it moves.

    python studies/pazy.py [--quick] [--out FOLDER]
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

DATA = Path(__file__).parent / "data"
GRAVITY = 9.80665  # m/s^2
SPAN, CHORD, TIP = 0.55, 0.1, 0.549843728  # m
NODES = np.array([*(0.03825 * np.arange(14)), 0.530718683, TIP])
MIDDLE, TRAILING, BEHIND = 0.006, 0.056, 0.096  # m behind the axis, which is at 44 % of the chord
LENGTH = TIP + BEHIND
AT_AXIS, AT_MIDDLE, AT_TRAILING = (
    (TIP + far) / LENGTH for far in (1e-6, MIDDLE, TRAILING)
)  # on the part that turns back
ORDER = [0, 3, 4, 5]  # of the published numbers: axial, torsion, out of plane, in plane
MODEL = jb.SpatialRod(6)
CALIBRATED = {"measured": (1.0, 2.0), "GFEM_SOL400": (1.0, 1.0)}  # kg, in bending and in torsion
SHOWN = {"measured": "measured", "GFEM_SOL400": "solid model"}


def rows_of(name: str) -> list[dict[str, str]]:
    with open(DATA / name) as file:
        return list(csv.DictReader(file))


def sections() -> tuple[np.ndarray, np.ndarray]:
    """Stiffnesses of 15 elements, and inertias by length about the axis."""
    stiffness = np.zeros((len(NODES) - 1, 6, 6))
    rigid = 1e7  # N: sections that do not shear
    for own, row in zip(stiffness, rows_of("pazy_stiffness.csv"), strict=True):
        for i in range(4):
            for j in range(i, 4):
                own[ORDER[i], ORDER[j]] = own[ORDER[j], ORDER[i]] = float(row[f"K{i + 1}{j + 1}"])
        own[[1, 2], [1, 2]] = rigid
    inertia = []
    share = np.diff(NODES, prepend=NODES[0], append=NODES[-1])
    for far, row in zip((share[1:] + share[:-1]) / 2, rows_of("pazy_inertia.csv"), strict=True):
        mass = float(row["mass"]) / far
        # Here the second axis points forwards.
        centre = np.array([0.0, -float(row["cgx"]), float(row["cgz"])])
        arm = np.cross(np.eye(3), centre)  # the matrix of a product with it, by rows
        about = np.diag([float(row[k]) / far for k in ("Iyy", "Ixx", "Izz")])
        inertia.append(
            np.block([[mass * np.eye(3), mass * arm], [-mass * arm, about + mass * arm.T @ arm]])
        )
    return stiffness, np.stack(inertia)


def wing() -> tuple[list[float], np.ndarray, np.ndarray, np.ndarray]:
    """Stations, stiffnesses, inertias and axis: linear between elements, with a step before the
    last one, and before what turns back."""
    elements, lumps = sections()
    middles = (NODES[1:] + NODES[:-1]) / 2
    inner = middles[:-1]
    places = [0.0, *inner, NODES[-2], NODES[-2], TIP, TIP, LENGTH]
    lever = np.diag([1e7, 1e7, 1e7, 1e4, 1e4, 1e4])
    stiffness = np.stack(
        [elements[0], *elements[:-1], elements[-2], *elements[[-1, -1]], lever, lever]
    )
    at = np.minimum(places[:-2], TIP)
    inertia = np.stack([[[np.interp(p, NODES, lumps[:, i, j]) for j in range(6)] for i in range(6)]
                        for p in at])  # fmt: skip
    light = 1e-6 * np.diag([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4])
    # Not quite across: sections have no axes of their own about that of the chord.
    back = np.array([1e-3, -1.0, 0.0]) / np.hypot(1e-3, 1.0)
    axis = np.stack([[0, 0, 0], [TIP, 0, 0], TIP * np.eye(3)[0] + BEHIND * back])
    return [p / LENGTH for p in places], stiffness, np.concatenate([inertia, [light, light]]), axis


def rotor_of(factors: Any) -> jb.Rotor:
    """With factors of the stiffness in bending out of the plane and in torsion."""
    places, stiffness, inertia, axis = wing()
    bending, torsion = jnp.sqrt(factors)
    one = jnp.ones(())
    by = jnp.stack([one, one, one, torsion, bending, one])
    stations = [0.0, TIP / LENGTH, 1.0]
    blade = Blade(
        places, by[:, None] * stiffness * by, inertia, axis, axis_stations=stations,
        kinks=stations[1:2],
    )  # fmt: skip
    return jb.Rotor(blade)


def at_tip(factors: Any, middle: Any, behind: Any) -> Any:
    """Height of mid-chord in % of the span, and twist in degrees, with these masses in kg."""
    rotor = rotor_of(factors)
    down = -GRAVITY * np.eye(3)[2]
    forces = jnp.stack([middle * down, behind * down])
    loads = jb.Loads(
        gravity=down, tip_force=forces[1],
        point_forces=jb.PointForces([AT_MIDDLE], forces[:1]),
    )  # fmt: skip
    state = jb.steady(MODEL, rotor, 0.0, loads=loads, throw=False)
    places = np.array([AT_AXIS, AT_MIDDLE, AT_TRAILING])
    high = state.displacement(places)[:, 2]
    twist = jnp.arcsin((high[0] - high[2]) / (TRAILING - 1e-6))
    return jnp.stack([100 * high[1] / SPAN, jnp.degrees(twist)])


@jax.jit
def answers(factors: Any, masses: Any) -> tuple[Any, Any]:
    """For rows of both masses (k, 2), less those of the wing alone, and derivatives by factors."""

    def one(row: Any) -> tuple[Any, Any]:
        def value(factors: Any) -> Any:
            return at_tip(factors, row[0], row[1])

        return value(factors), jax.jacfwd(value)(factors)

    found, by = jax.lax.map(one, masses)
    return found[1:] - found[0], by[1:] - by[0]


def asked(masses: Any, behind: bool) -> np.ndarray:
    """Rows of both masses, the first of which is the wing alone."""
    out = np.zeros((len(masses) + 1, 2))
    out[1:, int(behind)] = masses
    return out


def table(source: str, load: str, quantity: str) -> tuple[np.ndarray, np.ndarray]:
    """Masses and values."""
    rows = [
        (float(row["tip_mass_kg"]), float(row["value"]))
        for row in rows_of("pazy_static.csv")
        if (row["source"], row["load"], row["quantity"]) == (source, load, quantity)
    ]
    masses, values = np.array(sorted(rows)).T
    return masses[1:], values[1:]


def calibrated(source: str, masses: np.ndarray) -> tuple[np.ndarray, dict[Any, np.ndarray]]:
    """Factors that meet a deflection and a twist, and what follows for all masses, by quantity."""
    tables = {key: table(source, *key) for key in QUANTITIES}
    factors, count = np.ones(2), len(masses)
    rows = np.concatenate([asked(masses, False), asked(masses, True)[1:]])
    places, aims = [], []
    for key, mass in zip((QUANTITIES[0], QUANTITIES[2]), CALIBRATED[source], strict=True):
        places.append(int(np.argmin(np.abs(masses - mass))))
        aims.append(float(np.interp(mass, *tables[key])))
    for _ in range(12):
        found, by = (np.asarray(x) for x in answers(jnp.asarray(factors), jnp.asarray(rows)))
        one, other = places[0], count + places[1]
        missing = np.array([found[one, 0] - aims[0], found[other, 1] - aims[1]])
        if np.abs(missing).max() < 1e-9:
            break
        factors = factors - np.linalg.solve(np.stack([by[one, 0], by[other, 1]]), missing)
    return factors, {
        QUANTITIES[0]: found[:count, 0], QUANTITIES[1]: found[count:, 0],
        QUANTITIES[2]: found[count:, 1],
    }  # fmt: skip


QUANTITIES = (("bending", "disp"), ("torsion", "disp"), ("torsion", "rot"))
TITLES = (
    "mass at mid-chord: deflection", "mass behind: deflection", "mass behind: twist",
)  # fmt: skip


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figure and the table."""
    began = time.perf_counter()
    out = common.folder(out, "pazy")
    every = np.union1d(np.arange(1, 11) * 0.2, np.arange(1, 15) * 0.25)
    masses = np.array([0.5, 1.0, 2.0, 3.0, 3.5]) if quick else every
    figure, axes = plt.subplots(1, 3, figsize=(12, 4.2), layout="constrained")
    looks = {"measured": (BLUE, "o"), "GFEM_SOL400": (VERMILION, "s")}
    lines: list[tuple[Any, ...]] = []
    for source, (colour, marker) in looks.items():
        factors, found = calibrated(source, masses)
        print(
            f"  {SHOWN[source]}: factors {factors[0]:.4f} of bending, {factors[1]:.4f} of torsion"
        )
        for ax, key in zip(axes, QUANTITIES, strict=True):
            sign = 1 if key[1] == "rot" else -1
            seen, values = table(source, *key)
            drawn = (masses >= seen[0]) & (masses <= seen[-1])
            ax.plot(masses[drawn], sign * found[key][drawn], color=colour, lw=1.3,
                    label=f"rod for the {SHOWN[source]}")  # fmt: skip
            ax.plot(
                seen, sign * values, marker, color=colour, mfc="none", ms=5, label=SHOWN[source]
            )
            own = np.array(
                [np.interp(m, masses, found[key]) if m in masses else np.nan for m in seen]
            )
            apart = np.abs(own - values)
            unit = "degrees" if key[1] == "rot" else "% of the span"
            print(f"    {key[0]}, {key[1]}: largest difference {np.nanmax(apart):.2f} {unit} of "
                  f"{np.abs(values).max():.1f}")  # fmt: skip
            lines += [
                (source, *key, m, v, o) for m, v, o in zip(seen, values, own, strict=True) if o == o
            ]
        for ax, mass, row in zip(axes[::2], CALIBRATED[source], (0, 2), strict=True):
            key = QUANTITIES[row]
            value = np.abs(np.interp(mass, *table(source, *key)))
            ax.plot(mass, value, marker, color=colour, ms=9, mew=1.5, mfc="none", zorder=5)
    down = "mid-chord of the tip, down (% of the span)"
    for ax, title, unit in zip(
        axes, TITLES, (down, down, "twist of the tip (degrees)"), strict=True
    ):
        ax.set(title=title, xlabel="mass (kg)", xlim=(0, 3.7), ylim=(0, None),
               ylabel=unit)  # fmt: skip
        ax.grid(color="0.92")
        ax.legend(fontsize=8, loc="lower right")
    common.save_figure(figure, out / "pazy.png", dpi=110)
    header = ("source", "load", "quantity", "mass_kg", "value", "rod")
    common.write_csv(out / "pazy.csv", header, lines)
    return common.finish(began, "figure and table are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer masses", "the figure and the table")
