"""Figures that many studies want: Campbell diagrams, histories, sweeps, fits, films in space.

`campbell` draws a Campbell diagram with multiples of the speed, `mode_shape` a mode, `residuals`
what a fit leaves over, `swept` any number of a table over its parameters, `history` a run, and
`filmstrip` and `film` a beam that moves in space. Needs matplotlib; it is not imported by
`import jaxbeam`.
"""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from jaxbeam._checks import check_kind
from jaxbeam._fitting.result import Fit
from jaxbeam._models.bases.loads import section_angle
from jaxbeam._modes.result import Modes
from jaxbeam._rotor import spanwise
from jaxbeam._rotor.directions import Direction, Label
from jaxbeam._rotor.motion import axes as section_axes
from jaxbeam._simulation.result import Simulation
from jaxbeam._status import Status
from jaxbeam._sweeps.table import Table
from jaxbeam._vibration.campbell import Campbell

COLOURS = {
    Direction.IN_PLANE: "tab:blue", Direction.FLAP: "tab:orange", Direction.AXIAL: "tab:green",
    Direction.TORSION: "tab:red",
}  # fmt: skip
UNITS = {
    "length": "m", "pitch": "rad", "precone": "rad", "offset": "m", "inertia": "kg m²",
    "centre_of_mass": "m", "gyration": "m",
    "axial_inertia": "kg m²", "flap_inertia": "kg m²", "hub_radius": "m", "area": "m²",
    "time": "s", "duration": "s", "down_at": "s",
    "in_plane_second_moment": "m⁴", "flap_second_moment": "m⁴", "tip_mass": "kg",
    "density": "kg/m³", "mass_per_length": "kg/m", "youngs_modulus": "Pa", "axial_stiffness": "N",
    "in_plane_bending_stiffness": "N m²", "flap_bending_stiffness": "N m²", "mean": "rad/s",
    "angular_speed": "rad/s", "frequency": "rad/s", "translational_spring": "N/m",
    "torsional_spring": "N m", "mass": "kg", "mass_coefficient": "1/s",
    "stiffness_coefficient": "s", "section_coefficients": "s",
    "root_dampers": "SI", "tip_dampers": "SI",
    "in_plane_damper": "N m s", "flap_damper": "N m s",
    "ratio_speed": "rad/s", "angular_speed_rpm": "rpm", "mean_rpm": "rpm", "ratio_speed_rpm": "rpm",
}  # fmt: skip


def campbell(
    diagram: Campbell,
    ax: Axes,
    *,
    harmonics: Sequence[float] | np.ndarray = (),
    scale: float = 1.0,
    linestyle: str = "-",
) -> None:
    """Draw a Campbell diagram: frequencies over speed, with harmonics of it and their crossings.

    `diagram` is what `jaxbeam.campbell` returns, `ax` the axes of matplotlib to draw into;
    `harmonics` are numbers > 0, none by default. Speeds and frequencies are divided by `scale`
    (rad/s), `linestyle` is one of matplotlib. One colour a direction, named in the legend; growing
    modes are left out.

    Raises `ValueError` for harmonics that are not > 0.
    """
    crossings = diagram.crossings(harmonics)
    factors = np.asarray(harmonics, float).tolist()
    order = np.argsort(diagram.table.coords["angular_speed"])
    speed = diagram.table.coords["angular_speed"][order] / scale
    named = set()
    for i, label in enumerate(diagram.labels):
        frequency = diagram.table["frequency"][order, i] / scale
        frequency = np.where(diagram.table["growth_rate"][order, i] > 0, np.nan, frequency)
        title = None if label.direction in named else label.direction.title
        named.add(label.direction)
        ax.plot(speed, frequency, linestyle, color=COLOURS[label.direction], lw=1.3, label=title)
    top = np.nanmax(diagram.table["frequency"]) / scale * 1.05
    for harmonic in factors:
        ax.plot(speed, harmonic * speed, color="0.75", lw=0.8, zorder=0)
        end = min(speed[-1], top / harmonic)
        ax.annotate(
            f"{harmonic:g}P", (end, harmonic * end), (2, -9), textcoords="offset points",
            color="0.5", fontsize=8,
        )  # fmt: skip
    if factors:
        found = [c.angular_speed / scale for c in crossings]
        ks = [c.harmonic for c in crossings]
        ax.plot(found, np.multiply(found, ks), "o", color="tab:red", ms=4, label="resonance")
    ax.set_ylim(0, top)
    ax.set_xlim(speed[0], speed[-1])


def mode_shape(found: Modes, mode: Label, ax: Axes, points: int = 201, **style: object) -> None:
    """Draw the shape of one mode over x / L: its own displacement, of a mode of torsion the angle.

    `found` are what `jaxbeam.modes` returns, `mode` is the label of one of them, `ax` the axes of
    matplotlib to draw into; the line has so many `points`, and `**style` is what `Axes.plot` takes.
    The largest value is one.

    Raises `ValueError` for a mode that is not among those found, and `TypeError` for what are no
    modes: they know their model and their rotor.
    """
    check_kind("found", found, Modes)
    if mode not in found.labels:
        there = ", ".join(map(str, found.labels))
        raise ValueError(f"mode must be one of those found, {there}, got {mode}")
    xi = np.linspace(0, 1, points)
    if mode.direction == Direction.TORSION:
        every = found.torsion(xi, tip=True)
    else:
        every = found.displacement(xi, tip=True)[..., mode.direction]
    # Over the motion of the tip, so that the phase of the mode drops out.
    shape = np.asarray(every[found.labels.index(mode)]).real
    ax.plot(xi, shape / np.abs(shape).max(), **style)  # type: ignore[arg-type]


def residuals(found: Fit, ax: Axes) -> None:
    """Draw residuals over the noise, number by number, one colour an experiment.

    `found` is what `jaxbeam.fit` returns, `ax` the axes of matplotlib to draw into. The band holds
    95 % of them where noise is all there is.

    Raises `TypeError` for a batch of fits.
    """
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


def swept(table: Table, name: str, label: str) -> Figure:
    """One result over the first dimension of a sweep, a line for each value of the others.

    `name` is that of the result in the `table` of a `sweep`, `label` is written beside the axis;
    returns a `Figure` of matplotlib. Of a further dimension (modes, directions) entries that are
    zero throughout are left out; the others are lines in a sweep of one parameter, and panels in
    others. At most eight lines, evenly chosen, are drawn. Failed cases are left out.

    Raises `KeyError` where the table has no such result.
    """
    lead = table.dims["status"]
    panels, titles = [table], [""]
    for place in range(len(lead), table[name].ndim):
        dim = table.dims[name][place]
        there = np.nan_to_num(table[name]).reshape(-1, len(table.coords[dim])).any(0)
        table = table.take(dim, np.flatnonzero(there | ~there.any()))
        panels, titles = [table], [""]
        if len(lead) > 1:
            titles = table.coords[dim].tolist()
            panels = [table.take(dim, i) for i in range(len(titles))]
    columns = 2 if len(panels) == 4 else min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure = Figure((max(5.5, 3.7 * columns), 1 + 3.2 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).flat
    for i, (ax, part, title) in enumerate(zip(axes, panels, titles, strict=False)):
        lines = _lines(part, name, ax)
        ax.set(xlabel=_named(lead[0]), ylabel="" if i % columns else label)
        ax.set_title(title, fontsize=10)
    for ax in axes[len(panels) :]:
        ax.remove()
    handles, labels = axes[0].get_legend_handles_labels()
    if labels:
        figure.legend(
            handles, labels, loc="outside lower center", ncols=1 + columns, fontsize=8,
            title=f"{len(labels)} of {lines} lines" if len(labels) < lines else None,
            title_fontsize=8,
        )  # fmt: skip
    return figure


def _lines(table: Table, name: str, ax: Axes) -> int:
    """Draw at most eight of all lines; the number of all is returned."""
    first, *rest = table.dims[name]
    value, status = table[name], table["status"]
    fine = (status == Status.OK).reshape(status.shape + (1,) * (value.ndim - status.ndim))
    shown = np.where(fine, value, np.nan)
    places = np.argwhere(np.isfinite(shown).any(0))
    few = np.linspace(0, len(places) - 1, min(len(places), 8)).round().astype(int)
    for place in places[few]:
        at = zip(rest, place, strict=True)
        text = ", ".join(_stated(dim, table.coords[dim][k]) for dim, k in at)
        line = shown[(slice(None), *place)]
        ax.plot(table.coords[first], line, ".-", ms=4, lw=1.3, label=text)
    ax.grid(color="0.92")
    return len(places)


def _named(dim: str) -> str:
    unit = f" ({UNITS[dim]})" if dim in UNITS else ""
    return dim.replace("_", " ") + unit


def _stated(dim: str, at: object) -> str:
    if isinstance(at, str):
        return at
    return f"{dim.replace('_', ' ')} {at:.4g} {UNITS.get(dim, '')}".rstrip()


def history(table: Table) -> Figure:
    """Displacement of the tip over time, a panel for each direction in which it moves.

    `table` holds it as `tip`, by the dimensions time and direction, as `python -m jaxbeam` writes
    it; returns a `Figure` of matplotlib.

    Raises `KeyError` where the table has none.
    """
    tip, directions = table["tip"], table.coords["direction"]
    moving = [k for k in range(len(directions)) if np.nan_to_num(tip[:, k]).any()] or [1]
    figure = Figure((6.5, 1 + 1.9 * len(moving)), layout="constrained")
    axes = figure.subplots(len(moving), 1, sharex=True, squeeze=False)[:, 0]
    for ax, k in zip(axes, moving, strict=True):
        ax.plot(table.coords["time"], tip[:, k], lw=1.3)
        ax.set_ylabel(f"tip, {directions[k]} (m)")
        ax.grid(color="0.92")
    axes[-1].set_xlabel("time (s)")
    figure.align_ylabels()
    return figure


def filmstrip(run: Simulation, frames: int = 12) -> Figure:
    """The beam in three dimensions at some of the output times of a run, in hub axes and in space.

    `run` is what `simulate` returns, and `frames` how many times are drawn; returns a `Figure` of
    matplotlib. Each is a ribbon along the middle of its sections, half of it light, so
    that twist shows; dotted is the path of the tip. The motion has to state the attitude of the
    hub; a hub that moves along is drawn where it began.

    Raises `ValueError` for a batch of runs, or a motion that does not state the attitude, and
    `TypeError` for what is no run: it knows its rotor.
    """
    times, ribbons = _ribbons(run)
    in_space = _in_space(run, times, ribbons)
    colour, scale = colormaps["viridis"], Normalize(0, times[-1])
    figure = Figure((10.5, 5.2), layout="constrained")
    for k, (places, title) in enumerate(((ribbons, "axes of the hub"), (in_space, "space"))):
        ax = figure.add_subplot(1, 2, 1 + k, projection="3d")
        _boxed(ax, places, "axis {}" if k == 0 else "{}", title)
        for i in np.linspace(0, len(times) - 1, frames).round().astype(int):
            for faces, alpha in _faces(places[i]):
                shade = (*colour(scale(times[i]))[:3], alpha)
                ax.add_collection3d(Poly3DCollection(faces, facecolors=[shade]))
        ax.plot(*places[:, 1, -1].T, ":", color="k", lw=1)
    figure.colorbar(ScalarMappable(scale, colour), ax=figure.axes, label="time (s)", shrink=0.7)
    return figure


def film(run: Simulation, figure: Figure) -> FuncAnimation:
    """The beam as it moves in space, in a `figure` of pyplot's, a frame for each output time.

    `run` is that of `filmstrip`; `film(run, plt.figure()).save("film.gif")` writes the animation
    that it returns.

    Raises as `filmstrip` does.
    """
    times, ribbons = _ribbons(run)
    places = _in_space(run, times, ribbons)
    ax = figure.add_subplot(projection="3d")
    _boxed(ax, places, "{}", "")
    surfaces = [Poly3DCollection(f, facecolors=[(0.0, 0.45, 0.7, a)]) for f, a in _faces(places[0])]
    for surface in surfaces:
        ax.add_collection3d(surface)
    (path,) = ax.plot([], [], [], ":", color="k", lw=1)

    def frame(k: int) -> list[Artist]:
        for surface, (faces, _) in zip(surfaces, _faces(places[k]), strict=True):
            surface.set_verts(faces)
        path.set_data_3d(*places[: k + 1, 1, -1].T)
        ax.set_title(f"{times[k]:.3g} s", fontsize=10)
        return [*surfaces, path]

    return FuncAnimation(figure, frame, frames=len(times))


def _ribbons(run: Simulation, points: int = 41) -> tuple[np.ndarray, np.ndarray]:
    """Output times that were reached, and edge, middle and edge of a ribbon in axes of the hub,
    from where the hub's radius is measured: (T, 3, points, 3)."""
    check_kind("run", run, Simulation)
    if run.times.ndim != 1:
        raise ValueError("run must be that of one case, got a batch: take one by jax.tree.map")
    rotor: Any = run.rotor
    xi, length = np.linspace(0, 1, points), float(rotor.beam.length)
    cone = 0.0 if rotor.precone is None else float(rotor.precone)
    out = np.array([np.cos(cone), 0.0, np.sin(cone)])  # unit vector along the undeformed beam
    there = np.isfinite(np.asarray(run.times))
    along = np.asarray(run.displacement(xi))[there] + length * xi[:, None] * out
    middle = along + np.array([float(rotor.hub_radius), 0.0, 0.0])
    a2 = np.array([0.0, 1.0, 0.0])
    axes = np.stack([out, a2, np.cross(out, a2)])  # axes of the undeformed section
    t = np.gradient(along, xi, axis=1) @ axes.T
    t = t / np.linalg.norm(t, axis=2, keepdims=True)
    angles = np.asarray(run.torsion(xi))[there]
    if (angle := section_angle(rotor, lambda angles: spanwise.along(angles, xi))) is not None:
        angles = angles + np.asarray(angle)
    turned = section_axes(jnp.asarray(np.moveaxis(t, 2, 0)))
    _, second, third = np.moveaxis(np.asarray(turned), 1, 3)
    across = np.cos(angles)[..., None] * second + np.sin(angles)[..., None] * third
    wide = 0.04 * length * across @ axes
    return np.asarray(run.times)[there], np.stack([middle - wide, middle, middle + wide], 1)


def _in_space(run: Simulation, times: np.ndarray, places: np.ndarray) -> np.ndarray:
    attitude = np.asarray(jax.vmap(run.scene.motion.attitude)(jnp.asarray(times)))
    return np.einsum("tij,tkpj->tkpi", attitude, places)


def _faces(ribbon: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Quadrilaterals (n, 4, 3) of each half of a ribbon, with opacities."""
    halves = ((ribbon[0], ribbon[1], 0.35), (ribbon[1], ribbon[2], 0.9))
    return [(np.stack([a[:-1], b[:-1], b[1:], a[1:]], 1), alpha) for a, b, alpha in halves]


def _boxed(ax: Axes3D, places: np.ndarray, name: str, title: str) -> None:
    """Scale the axes of a figure so that all places and the centre of the hub fit, in one scale."""
    every = np.concatenate([places.reshape(-1, 3), np.zeros((1, 3))])
    low, high = every.min(0), every.max(0)
    half = 0.55 * np.maximum(high - low, 0.2 * (high - low).max())
    middle = (low + high) / 2
    ax.set(
        xlim=(middle[0] - half[0], middle[0] + half[0]), title=title,
        ylim=(middle[1] - half[1], middle[1] + half[1]),
        zlim=(middle[2] - half[2], middle[2] + half[2]),
        **{f"{c}label": name.format(k if "axis" in name else c) + " (m)"
           for k, c in enumerate("xyz", 1)},
    )  # fmt: skip
    ax.set_box_aspect(half)
    for axis, share in zip((ax.xaxis, ax.yaxis, ax.zaxis), half / half.max(), strict=True):
        axis.set_major_locator(MaxNLocator(max(2, round(6 * share))))
    ax.plot(0, 0, 0, "o", color="k", ms=4)
