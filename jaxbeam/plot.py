"""Figures that many studies want. Needs matplotlib; not imported by `import jaxbeam`."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from jaxbeam._fit import Fit
from jaxbeam._models.base import AbstractModel, Family, Label
from jaxbeam._modes import Modes
from jaxbeam._southwell import Campbell

COLOURS = {Family.IN_PLANE: "tab:blue", Family.FLAP: "tab:orange", Family.AXIAL: "tab:green"}


def campbell(
    diagram: Campbell,
    ax: Axes,
    *,
    harmonics: Sequence[float] = (),
    scale: float = 1.0,
    linestyle: str = "-",
) -> None:
    """Frequencies over speed, both divided by `scale`; lines of harmonics and their crossings.

    One colour a family, named in the legend; growing modes are left out.
    """
    speed = diagram.table.coords["angular_speed"] / scale
    named = set()
    for i, label in enumerate(diagram.labels):
        frequency = diagram.table["frequency"][:, i] / scale
        frequency = np.where(diagram.table["growth_rate"][:, i] > 0, np.nan, frequency)
        title = None if label.family in named else label.family.title
        named.add(label.family)
        ax.plot(speed, frequency, linestyle, color=COLOURS[label.family], lw=1.3, label=title)
    top = np.nanmax(diagram.table["frequency"]) / scale * 1.05
    for harmonic in harmonics:
        ax.plot(speed, harmonic * speed, color="0.75", lw=0.8, zorder=0)
        end = min(speed[-1], top / harmonic)
        ax.annotate(
            f"{harmonic:g}P", (end, harmonic * end), (2, -9), textcoords="offset points",
            color="0.5", fontsize=8,
        )  # fmt: skip
    if harmonics:
        crossings = diagram.crossings(harmonics)
        found = [c.angular_speed / scale for c in crossings]
        ks = [c.harmonic for c in crossings]
        ax.plot(found, np.multiply(found, ks), "o", color="tab:red", ms=4, label="resonance")
    ax.set_ylim(0, top)
    ax.set_xlim(speed[0], speed[-1])


def mode_shape(
    model: AbstractModel, found: Modes, mode: Label, ax: Axes, points: int = 201, **style: object
) -> None:
    """Displacement of one mode in the direction that names it over x / L, largest value one."""
    row, turn = {Family.AXIAL: (0, 1j), Family.IN_PLANE: (1, 1), Family.FLAP: (2, 1)}[mode.family]
    xi = np.linspace(0, 1, points)
    table = np.asarray(model.displacement(xi))[row]
    # Stable axial parts are -i times a real shape, see `Modes`.
    shape = (turn * (table @ np.asarray(found.shape[found.labels.index(mode)]))).real
    ax.plot(xi, shape / np.abs(shape).max(), **style)  # type: ignore[arg-type]


def residuals(found: Fit, ax: Axes) -> None:
    """Residuals over the noise, number by number, one colour an experiment, with the band that
    holds 95 % of them where noise is all there is."""
    start = 0
    ax.axhspan(-1.96, 1.96, color="0.9", lw=0)
    ax.axhline(0, color="0.5", lw=0.8)
    for i, values in enumerate(found.residuals):
        flat = np.asarray(values).ravel() / float(found.scale)
        at = start + np.arange(flat.size)
        ax.plot(at, flat, ".", label=f"experiment {i + 1}")
        start += flat.size
    ax.set(xlabel="number of the measurement", ylabel="residual / noise (-)")
    if len(found.residuals) > 1:
        ax.legend(fontsize=8)
