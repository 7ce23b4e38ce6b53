"""Frequencies of rotating cantilevers: both theories, against the printed tables of paper B.

Sweeps speed gamma, hub radius R / L and tip mass N with the modal (hybrid) and the absolute nodal
coordinate theory; compares with B Tables 2-5; separates what in those tables is physics from what
is ten elements or small-strain linearisation; draws Campbell diagrams, mode shapes, frequency
squared over speed squared with Southwell's and Schilhansl's lines, and maps of Southwell
coefficients. Frequencies and speeds in units of sqrt(EI / (rho L^4)).

    python studies/rotating_cantilever.py [--quick] [--out FOLDER]
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import common
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxbeam as jb
import jaxbeam.plot as jbplot

DATA = Path(__file__).parents[1] / "tests" / "data"
GAMMAS = (1.0, 2.0, 3.0, 4.0, 5.0, 10.0, 20.0, 50.0)
# The slenderness L sqrt(A / I) that reproduces all 20 simulation values of B Table 2.
SLENDERNESS = 216.21246
BEAM = jb.Beam.from_slenderness(SLENDERNESS)
FIRST_THREE = jb.labels(in_plane=3)


def rotor(hub_radius: Any, tip_mass: Any) -> jb.Rotor:
    return jb.Rotor(BEAM, hub_radius, tip_mass)


def frequency_case(
    model: jb.models.AbstractModel, which: int | tuple[jb.models.Label, ...]
) -> Callable[..., Any]:
    def case(tip_mass: Any, hub_radius: Any, angular_speed: Any) -> dict[str, Any]:
        found = jb.modes(model, rotor(hub_radius, tip_mass), angular_speed, which, throw=False)
        return {
            "frequency": found.frequency,
            "transverse_share": found.energy_share[:, jb.models.Direction.IN_PLANE],
            "steady_strain": found.steady_strain,
            "status": found.status,
        }

    return case


def table_2(out: Path) -> None:
    """B Table 2: at rest, three bending and one axial frequency for five tip masses."""
    rows = np.genfromtxt(
        DATA / "berzeri_1999_table_2.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    which = jb.labels(in_plane=3, axial=1)
    columns = {}
    for name, model, slenderness in (
        ("simulation", jb.papers.SmallStrainANCF(10), SLENDERNESS),
        ("exact", jb.Hybrid(12, 14, 0), 216.2162),  # the exact column is of a beam so slender
    ):
        beam = jb.Beam.from_slenderness(slenderness)
        columns[name] = np.concatenate(
            [jb.modes(model, jb.Rotor(beam, 0.0, float(n)), 0.0, which).frequency for n in range(5)]
        )
    header = ("N", "mode", "printed_exact", "modal", "printed_simulation", "ten_elements")
    lines = zip(
        rows["N"], rows["mode"], rows["omega_exact"], columns["exact"].round(6),
        rows["omega_simulation"], columns["simulation"].round(6), strict=True,
    )  # fmt: skip
    common.write_csv(out / "table_2.csv", header, lines)
    simulation = np.abs(columns["simulation"] - rows["omega_simulation"])
    exact = np.abs(columns["exact"] - rows["omega_exact"])
    print("B Table 2, at rest (20 values each)")
    print(f"  simulation column by ten elements:  largest difference {simulation.max():.1e}")
    worst = int(np.argmax(exact))
    print(
        f"  exact column by the modal theory:   largest difference {np.sort(exact)[-2]:.1e}, "
        f"but for N = {rows['N'][worst]}, {rows['mode'][worst]}: {exact[worst]:.1e}\n"
        "    (that print is one unit off in its last digit, if one slenderness is to fit all five)"
    )


def tables_3_to_5(out: Path, quick: bool) -> None:
    """B Tables 3-5, and what other models say of the same 240 beams."""
    rows = np.genfromtxt(DATA / "berzeri_1999_tables_3_4_5.csv", delimiter=",", names=True)
    cases = jb.grid(tip_mass=[0, 1, 2, 3, 4], hub_radius=[0, 1, 2, 3, 4, 5], angular_speed=GAMMAS)
    speed = np.searchsorted(GAMMAS, rows["gamma"])
    at = (rows["N"].astype(int), rows["R_over_L"].astype(int), speed)
    order = rows["mode"].astype(int) - 1
    columns = ("N", "R_over_L", "gamma", "mode", "omega_printed")

    # The model of the tables, with all modes below those printed.
    ten = jb.sweep(frequency_case(jb.papers.SmallStrainANCF(10), 30), cases)
    ten.save(out / "sweep_ten_elements.npz")
    lowest, share = ten["frequency"][at], ten["transverse_share"][at]
    mostly = np.argsort(share < 0.5, axis=1, kind="stable")  # mostly transverse first, in order
    column = np.take_along_axis(mostly, order[:, None], 1)
    found = np.take_along_axis(lowest, column, 1)[:, 0]
    strain = ten["steady_strain"][at]
    gap = np.abs(found - rows["omega_printed"])
    odd = int(np.argmax(gap))
    place = np.argmin(np.abs(lowest - rows["omega_printed"][:, None]), axis=1)
    print("\nB Tables 3-5 (720 values) by ten small-strain elements")
    print(f"  largest difference of 719:          {np.delete(gap, odd).max():.1e}")
    print(
        "  the other, N = {N:g}, R/L = {R_over_L:g}, gamma = {gamma:g}, mode {mode:g}, is the less "
        "transverse partner of a\n    veering pair".format(
            **{name: rows[name][odd] for name in columns}
        )
        + f" ({100 * share[odd, place[odd]]:.0f} % against {100 * share[odd, column[odd, 0]]:.0f} %"
        f" transverse): printed {rows['omega_printed'][odd]:.3f}, that partner "
        f"{lowest[odd, place[odd]]:.3f}"
    )
    print(f"  entries with an axial mode below the printed bending mode: {(place != order).sum()}")

    graded = jb.models.Polynomials(grading=2)
    models: dict[str, jb.models.AbstractModel] = {
        "modal with stretch": jb.Hybrid(28, 28, 0, graded)
    }
    if not quick:
        models |= {
            "modal inextensible": jb.Hybrid(0, 28, 0, graded),
            "40 elements small strain": jb.papers.SmallStrainANCF(40),
            "40 elements exact": jb.papers.ANCF(40),
        }
    frequency = {}
    for name, model in models.items():
        table = jb.sweep(frequency_case(model, FIRST_THREE), cases)
        table.save(out / f"sweep_{name.replace(' ', '_')}.npz")
        frequency[name] = table["frequency"][(*at, order)]
        if name == "modal with stretch":
            torn = int((table["status"] != jb.Status.OK).sum())
    common.write_csv(
        out / "tables_3_4_5.csv",
        ("N", "R_over_L", "gamma", "mode", "printed", "ten elements", *models, "steady_strain"),
        zip(
            *(rows[c].tolist() for c in columns), found.round(6).tolist(),
            *(f.round(6).tolist() for f in frequency.values()), strain.round(6).tolist(),
            strict=True,
        ),
    )  # fmt: skip
    if not quick:
        causes(out, rows, order, strain, found, *frequency.values())
    print(
        f"  Beyond a steady strain of a few per cent the tables are an exercise in linearisation:\n"
        f"  {int((strain > 0.05).sum())} of 720 entries have more than 5 %, the largest "
        f"{100 * strain.max():.0f} %; the rod of the modal theory bears {240 - torn} of 240."
    )


def causes(
    out: Path,
    rows: Any,
    order: Any,
    strain: Any,
    ten: Any,
    modal: Any,
    flat: Any,
    fine: Any,
    exact: Any,
) -> None:
    """What in the printed values is ten elements, small-strain linearisation, Coriolis coupling."""
    print(
        "\nWhat the printed values owe to what: largest change in % over R/L = 0..5, N = 0..4\n"
        "  gamma  mode   ten elements   small-strain      leaving out        largest\n"
        "                 against 40    linearisation   Coriolis coupling  steady strain"
    )
    lines = []
    for gamma in GAMMAS:
        for k in (0, 1, 2):
            pick = (rows["gamma"] == gamma) & (order == k)
            parts = [
                100 * np.abs(a / b - 1)[pick].max()
                for a, b in ((ten, fine), (fine, exact), (flat, modal))
            ]
            lines.append((gamma, k + 1, *(round(p, 4) for p in parts), strain[pick].max().round(5)))
            if gamma in (1.0, 5.0, 10.0, 20.0, 50.0):
                a, b, c = parts
                print(
                    f"  {gamma:5g}  {k + 1:4d} {a:14.2f} {b:15.2f} {c:16.2f} "
                    f"{strain[pick].max():17.4f}"
                )
    header = ("gamma", "mode", "ten_elements_%", "linearisation_%", "coriolis_%", "steady_strain")
    common.write_csv(out / "causes.csv", header, lines)
    one = (rows["gamma"] == 50) & (order == 0) & (rows["N"] == 0) & (rows["R_over_L"] == 0)
    a, b, c, d, e, f = (
        float(v[one][0]) for v in (rows["omega_printed"], ten, fine, exact, modal, flat)
    )
    print(
        f"  gamma = 50, N = R = 0, mode 1: printed {a:.3f}, ten elements {b:.3f}, "
        f"40 elements {c:.3f},\n"
        f"    exact linearisation {d:.3f}, modal {e:.3f}, inextensible {f:.3f}"
    )


def campbell_figure(out: Path, quick: bool) -> None:
    """Frequencies over speed, modal lines and element markers, resonances by root finding."""
    speeds = np.linspace(0.0, 12.0, 25 if quick else 61)
    figure, axes = plt.subplots(1, 2, figsize=(11, 5.4), layout="constrained")
    modal = jb.Hybrid(8, 16, 16)
    which = jb.labels(in_plane=2, flap=2)
    lines = []
    for ax, (hub, tip) in zip(axes, ((0.0, 0.0), (1.0, 0.5)), strict=True):
        diagram = jb.campbell(modal, rotor(hub, tip), speeds, which)
        jbplot.campbell(diagram, ax, harmonics=(1, 2, 3, 4, 5, 6))
        lines += [
            (hub, tip, str(c.label), c.harmonic, c.angular_speed)
            for c in diagram.crossings((1, 2, 3, 4, 5, 6))
        ]
        if quick:
            ax.set_title(f"R / L = {hub:g}, N = {tip:g}")
            continue
        elements = jb.campbell(
            jb.papers.ANCF(10), rotor(hub, tip), np.linspace(0.0, 12.0, 13), jb.labels(in_plane=2)
        )
        ax.plot(
            elements.table.coords["angular_speed"], elements.table["frequency"], "x",
            color="k", ms=5, label=["ten ANCF elements, in plane", None],
        )  # fmt: skip
        classical = jb.campbell(jb.Classical(8, 16, 0), rotor(hub, tip), speeds, which[:2])
        shown = np.where(classical.table["growth_rate"] > 0, np.nan, classical.table["frequency"])
        ax.plot(speeds, shown, ":", color="tab:purple", label=["classical theory, in plane", None])
        ax.set_title(f"R / L = {hub:g}, N = {tip:g}")
    for ax in axes:
        ax.set_xlabel(r"angular speed $\gamma = \Omega\,(\rho L^4/EI)^{1/2}$ (-)")
        ax.set_ylabel(r"frequency $\omega\,(\rho L^4/EI)^{1/2}$ (-)")
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=5, fontsize=9)
    common.save_figure(figure, out / "campbell.png", dpi=130)
    common.write_csv(out / "resonances.csv", ("R_over_L", "N", "mode", "harmonic", "gamma"), lines)

    at, (by_hub, by_tip) = jax.jit(
        jax.value_and_grad(
            lambda p: (
                jb.crossing(
                    jb.Hybrid(0, 16, 0), rotor(p[0], p[1]), (2.0, 6.0), FIRST_THREE[0], 1.0
                ).angular_speed
            )
        )
    )(jnp.zeros(2))
    print(
        f"\nFirst resonance of speed and in-plane frequency (N = R = 0): gamma = {at:.10f}\n"
        f"  its derivative by R / L {by_hub:.6f}, by N {by_tip:.6f} (inextensible; B prints 3.88)"
    )


def mode_shape_figure(out: Path, quick: bool) -> None:
    """B Figs. 11 and 12."""
    model = jb.Hybrid(0 if quick else 28, 28, 0, jb.models.Polynomials(grading=2))
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained", sharey=True)
    for ax, (hub, tip) in zip(axes, ((0.0, 0.0), (2.0, 3.0)), strict=True):
        for gamma, style in ((0.0, "-"), (50.0, "--")):
            found = jb.modes(model, rotor(hub, tip), gamma, FIRST_THREE)
            for k, label in enumerate(FIRST_THREE):
                jbplot.mode_shape(
                    found, label, ax, color=f"C{k}", linestyle=style,
                    label=rf"mode {k + 1}, $\gamma$ = {gamma:g}",
                )  # fmt: skip
        ax.axhline(0, color="0.8", lw=0.8, zorder=0)
        ax.set_title(f"R / L = {hub:g}, N = {tip:g}")
        ax.set_xlabel("position x / L (-)")
    axes[0].set_ylabel("in-plane displacement / its largest (-)")
    handles, names = axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=6, fontsize=8)
    common.save_figure(figure, out / "mode_shapes.png", dpi=130)


SCHILHANSL = ((0.173, 1.558), (5.380, 8.631))  # B eqs. 68-69: phi = a + b R / L


def southwell_coefficients(out: Path, quick: bool) -> jb.Table:
    """phi at rest of two in-plane modes over hub radius and tip mass, by differentiation."""
    which = jb.labels(in_plane=2)
    table = jb.sweep(
        lambda hub_radius, tip_mass: jb.southwell(
            jb.Hybrid(8, 16, 0), rotor(hub_radius, tip_mass), 0.0, which, throw=False
        ),
        jb.grid(
            hub_radius=np.linspace(0, 5, 11 if quick else 41),
            tip_mass=np.linspace(0, 4, 11 if quick else 41),
        ),
        dims={"coefficient": {"mode": which}},
    )
    table.to_csv(out / "southwell_map.csv")
    return table


def southwell_lines_figure(out: Path, coefficients: jb.Table, quick: bool) -> None:
    """B Figs. 13 and 14: frequency squared over speed squared."""
    model, which = jb.Hybrid(8, 16, 0), jb.labels(in_plane=2)
    hubs = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    speeds = np.linspace(0.0, 5.0, 26)
    case = frequency_case(model, which)
    square = (
        jb.sweep(case, jb.grid(tip_mass=[0], hub_radius=hubs, angular_speed=speeds)).sel(
            tip_mass=0
        )["frequency"]
        ** 2
    )
    phi = coefficients.sel(hub_radius=hubs, tip_mass=0)["coefficient"]
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.8), layout="constrained")
    for k, ax in enumerate(axes):
        for i, hub in enumerate(hubs):
            a, b = SCHILHANSL[k]
            line = square[i, 0, k] + (a + b * hub) * speeds**2
            tangent = square[i, 0, k] + phi[i, k] * speeds**2
            curves = ax.plot(speeds**2, square[i, :, k], color="tab:blue")
            curves += ax.plot(speeds**2, tangent, "--", color="k", lw=1)
            curves += ax.plot(speeds**2, line, ":", color="tab:red")
            ax.annotate(f" R/L = {hub:g}", (25, square[i, -1, k]), fontsize=8, va="center")
        ax.set_xlim(0, 29.5)
        ax.set_title(f"in-plane mode {k + 1}, N = 0")
        ax.set_xlabel(r"speed squared $\gamma^2$ (-)")
        ax.set_ylabel(r"frequency squared $\omega^2\rho L^4/EI$ (-)")
        names = ("modal theory", "Southwell's line, exact coefficient", "Schilhansl's line")
        ax.legend(curves, names, loc="upper left", fontsize=8)
    common.save_figure(figure, out / "southwell_lines.png", dpi=130)
    common.write_csv(
        out / "southwell.csv",
        ("R_over_L", "phi_1", "schilhansl_1", "phi_2", "schilhansl_2"),
        [
            (r, phi[i, 0], SCHILHANSL[0][0] + SCHILHANSL[0][1] * r,
             phi[i, 1], SCHILHANSL[1][0] + SCHILHANSL[1][1] * r)
            for i, r in enumerate(hubs)
        ],
    )  # fmt: skip
    if quick:
        return
    thin = jb.southwell(jb.Hybrid(0, 16, 0), rotor(0.0, 0.0), 0.0, which).coefficient
    slope = jb.southwell(jb.Hybrid(0, 16, 0), rotor(1.0, 0.0), 0.0, which).coefficient - thin
    print("\nSouthwell coefficients at rest, N = 0, inextensible (exactly linear in R / L)")
    for k in (0, 1):
        a, b = SCHILHANSL[k]
        print(
            f"  mode {k + 1}: {float(thin[k]):.4f} + {float(slope[k]):.4f} R/L"
            f"    Schilhansl: {a:.3f} + {b:.3f} R/L"
        )


def southwell_map_figure(out: Path, table: jb.Table) -> None:
    """Southwell coefficients of the first two in-plane modes over hub radius and tip mass."""
    which = jb.labels(in_plane=2)
    figure, axes = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
    for k, ax in enumerate(axes):
        hub, tip = table.coords["hub_radius"], table.coords["tip_mass"]
        phi = table["coefficient"][:, :, k].T
        filled = ax.contourf(hub, tip, phi, 20)
        lines = ax.contour(hub, tip, phi, 8, colors="w", linewidths=0.7)
        ax.clabel(lines, fontsize=8)
        figure.colorbar(filled, ax=ax, label=r"Southwell coefficient $\phi$ (-)")
        ax.set_title(f"{which[k]}, at rest")
        ax.set_xlabel("hub radius R / L (-)")
        ax.set_ylabel("tip mass N = m_t / m (-)".replace("m_t", "$m_t$"))
    common.save_figure(figure, out / "southwell_map.png", dpi=130)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figures and tables."""
    start = time.perf_counter()
    out = common.folder(out, "rotating_cantilever")
    table_2(out)
    tables_3_to_5(out, quick)
    campbell_figure(out, quick)
    mode_shape_figure(out, quick)
    coefficients = southwell_coefficients(out, quick)
    southwell_lines_figure(out, coefficients, quick)
    southwell_map_figure(out, coefficients)
    print()
    return common.finish(start, "figures and tables are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "coarser, in under 30 s", "figures and tables")
