"""Where beams, and the methods that compute them, lose their stability.

Critical speeds of every model, directly, with their derivatives, and by motions in time that stay
bounded for 200 periods 1 % below and diverge 1 % above; maps over speed, hub radius and tip mass;
how the critical speed of Model 0 of Berzeri and Shabana (B) grows with its elements; and the
tongues of parametric resonance of a beam whose speed is modulated, traced along their boundaries on
top of Floquet multipliers. Writes figures and tables into a folder that it names. Takes some
minutes, most of them to compile.

    python studies/stability.py [--quick] [--out FOLDER]
"""

import functools
import time
from pathlib import Path
from typing import Any, NamedTuple

import common
import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import ALUMINIUM, BLUE, GREEN, VERMILION
from matplotlib.colors import ListedColormap
from scipy.interpolate import CubicHermiteSpline

import jaxbeam as jb

REF_21 = jb.Beam.from_section(**ALUMINIUM)
BEAM = jb.Beam.from_slenderness(70.0)
SPRINGS = jb.papers.SpringRotor(1.0, 1.0, 1.0, 1e6, 300.0)  # Y, Table 2
KICK = 1e-6  # of the length: what motions in time start from
NAMES = {
    jb.models.Direction.IN_PLANE: "in-plane divergence",
    jb.models.Direction.FLAP: "flap divergence",
    jb.models.Direction.AXIAL: "the rod tears",
}


class Case(NamedTuple):
    """A model and the rotor for which the table states its critical speed."""

    name: str
    model: Any
    rotor: Any


def rotor(beam: jb.Beam, radius: Any, mass: Any) -> jb.Rotor:
    """Hub radius over the length, tip mass over that of the beam."""
    return jb.Rotor(beam, radius * beam.length, mass * beam.mass)


def _aside(t: Any, y: jb.solvers.State, args: jb.results.Scene, **_: Any) -> Any:
    """The straight beam moves a hundredth of its length to the side: no need to go on."""
    return jnp.abs(args.equations.tip(y.q)[1]) > 0.01 * args.equations.length


def growth(model: Any, at: Any, speed: Any, push: Any, duration: Any) -> Any:
    """Largest distance from steady rotation, over that at the start, of a motion that begins with a
    small push; infinite where the run was given up, far away."""
    linear = model.equations(at).is_linear
    rest, _ = model.steady(at, speed)
    size = model.equations(at).length
    start = jb.solvers.State(rest + KICK * size * push, jnp.zeros_like(rest))
    run = jb.simulate(
        model, at, jb.ConstantSpeed(speed), jnp.linspace(0.0, 1.0, 101) * duration, start=start,
        # Magnus is exact, whatever its steps
        solver=jb.solvers.Magnus() if linear else None, dt0=duration / 20 if linear else None,
        stepsize_controller=diffrax.ConstantStepSize() if linear else diffrax.PIDController(
            rtol=1e-4, atol=1e-2 * KICK * size, dtmin=1e-9 * duration, force_dtmin=False
        ),
        event=diffrax.Event(_aside), max_steps=200_000, throw=False,
    )  # fmt: skip
    away = jnp.linalg.norm(run.state.q - rest[None], axis=1)
    largest = jnp.max(jnp.where(jnp.isfinite(run.times), away, 0.0))
    ended = (run.end_time < 0.999 * duration) | ~jnp.isfinite(largest)
    return jnp.where(ended, jnp.inf, largest / (KICK * size * jnp.linalg.norm(push)))


def critical_table(out: Path, quick: bool) -> None:
    """Critical speeds, their derivatives, and motions 1 % below and above."""
    hub, plain = rotor(BEAM, 0.5, 0.3), rotor(REF_21, 0.0, 0.0)
    counts = (1,) if quick else (1, 2, 4, 10)
    cases = [
        Case("C.L.C.", jb.Classical(4, 6, 6), hub),
        Case("hybrid", jb.Hybrid(8, 6, 6), hub),
        Case("LC", jb.papers.DiscreteLC(), SPRINGS),
        Case("Model A, 2 elements", jb.papers.ANCF(2), hub),
        *(Case(f"Model 0, chord, {n}", jb.papers.ChordANCF(n), plain) for n in counts),
    ]
    if not quick:
        cases += [
            Case("LP", jb.papers.DiscreteLP(), SPRINGS),
            Case("small-strain, 2 elements", jb.papers.SmallStrainANCF(2), hub),
            Case("Green, 2 elements", jb.papers.GreenANCF(2), hub),
            *(Case(f"Model 0, tangent, {n}", jb.papers.TangentANCF(n), plain) for n in counts),
        ]
    header = (
        "model", "critical_speed_rad_s", "over_first_rest_frequency", "what_gives_way",
        "derivative_by_hub_radius", "growth_0.99", "growth_1.01", "periods",
    )  # fmt: skip
    print(f"{'model':26s} {'rad/s':>14s} {'/ w1':>8s}  {'':19s}  growth at 0.99 and 1.01")
    rows = []
    for row in common.together(critical_row, cases):
        name, speed, ratio, gives_way, _, below, above, _ = row
        words = f"{name:26s} {speed:14.8f} {ratio:8.3f}  {gives_way:20s}"
        print(f"{words} {below:8.2g} {above:8.2g}", flush=True)
        rows.append(row)
    common.write_csv(out / "critical_speeds.csv", header, rows)
    if not quick:  # one point is no law
        element_law(out, rows)


def critical_row(case: Case) -> tuple[Any, ...]:
    """One line of the table."""
    model, at = case.model, case.rotor
    found = jb.critical_speed(model, at, throw=False)
    rest = float(jb.modes(model, at, 0.0, 1).frequency[0])
    speed = float(found.angular_speed)
    if not np.isfinite(speed):
        return case.name, speed, speed, "nothing", np.nan, np.nan, np.nan, 0

    def by_radius(radius: Any) -> Any:
        moved = eqx.tree_at(lambda r: r.hub_radius, at, radius)
        return jb.critical_speed(model, moved, throw=False).angular_speed

    slope = np.nan
    if not isinstance(
        model, jb.papers.ChordANCF | jb.papers.TangentANCF
    ):  # which compile for half a minute
        slope = float(jax.jit(jax.grad(by_radius))(at.hub_radius))
    below = jb.modes(model, at, 0.99 * speed, 1, throw=False)
    periods = 200
    duration = periods * 2 * np.pi / float(below.frequency[0])
    try_both = jax.jit(jax.vmap(lambda v: growth(model, at, v, found.shape, duration)))
    low, high = (float(g) for g in try_both(speed * jnp.array([0.99, 1.01])))
    direction = NAMES[jb.models.Direction(int(found.direction))]
    return case.name, speed, speed / rest, direction, slope, low, high, periods


def element_law(out: Path, rows: list[tuple[Any, ...]]) -> None:
    """Critical speed of Model 0 against its number of elements."""
    figure, ax = plt.subplots(figsize=(5.5, 4), layout="constrained")
    for frame, colour in (("chord", BLUE), ("tangent", VERMILION)):
        found = [(int(r[0].split(", ")[2]), r[1]) for r in rows if f"0, {frame}" in r[0]]
        n, speed = np.array(found).T
        power, factor = np.polyfit(np.log(n), np.log(speed), 1)
        law = f"{np.exp(factor):.2f} n^{power:.2f} rad/s"
        print(f"Model 0, {frame} frame: critical speed about {law}")
        ax.loglog(n, speed, "o", color=colour)
        along = np.geomspace(n[0], n[-1])
        ax.loglog(along, np.exp(factor) * along**power, color=colour, label=f"{frame}: {law}")
    for speed in (10, 40):
        ax.axhline(speed, color="0.6", lw=0.8, ls=":")
        ax.text(n[-1], speed, f"{speed} rad/s (B)", fontsize=8, va="bottom", ha="right")
    ax.set(xlabel="elements", ylabel="critical speed (rad/s)", title="Model 0, beam of B Ref. 21")
    ax.set_xticks(n, [f"{int(k)}" for k in n])
    ax.minorticks_off()
    ax.legend(fontsize=8)
    common.save_figure(figure, out / "model_0_elements.png", dpi=110)


def maps(out: Path, quick: bool) -> None:
    """Outcome of motions in time over hub radius and speed, with the boundary from gradients."""
    models: list[tuple[str, Any]] = [
        ("C.L.C.", jb.Classical(2, 4, 0)),
        ("hybrid", jb.Hybrid(6, 4, 0)),
        ("Model A, 2", jb.papers.ANCF(2)),
        ("Model 0, 1", jb.papers.ChordANCF(1)),
        ("Model 0, 2", jb.papers.ChordANCF(2)),
    ]
    models = models[:1] if quick else [*models, ("Model 0, 4", jb.papers.ChordANCF(4))]
    panels: list[list[tuple[str, Any, Any]]] = [
        [
            (f"{name}, N = {mass}", model, lambda r, mass=mass: rotor(BEAM, r, mass))
            for name, model in models
        ]
        for mass in (0.0, 1.0)
    ]
    panels[0].append(("LC", jb.papers.DiscreteLC(), springs))
    panels[1].append(("LP", jb.papers.DiscreteLP(), springs))
    radii = jnp.linspace(0.0, 4.0, 4 if quick else 9)
    speeds = jnp.geomspace(0.3, 100.0, 8 if quick else 22)  # over the first rest frequency
    figure, axes = plt.subplots(
        2, len(panels[0]), figsize=(2.1 * len(panels[0]) + 1, 6.4), layout="constrained",
        sharex=True, sharey=True,
    )  # fmt: skip
    jobs = [
        (ax, *panel)
        for line, row in zip(axes, panels, strict=True)
        for ax, panel in zip(line, row, strict=True)
    ]
    results = list(common.together(lambda job: outcome(job[2], job[3], radii, speeds), jobs))
    rows = []
    for (ax, name, _, _), (unstable, knots, values, slopes, direction) in zip(
        jobs, results, strict=True
    ):
        ax.pcolormesh(
            radii, speeds, np.asarray(unstable).T, shading="nearest", vmin=0, vmax=2,
            cmap=ListedColormap(["#CFE3F3", "#F6C9AE", "0.8"]),
        )  # fmt: skip
        if np.isfinite(values).all():
            along = np.linspace(0, 4, 200)
            curve = CubicHermiteSpline(knots, values, slopes)(along)
            style = (
                {"color": "k", "ls": "-"}
                if direction != jb.models.Direction.AXIAL
                else {"color": GREEN, "ls": "--"}
            )
            ax.plot(along, curve, lw=2, **style)
            ax.plot(knots, values, "o", ms=3.5, color=style["color"])
        ax.set_title(name, fontsize=9)
        rows += [
            (name, float(k), float(v), float(s))
            for k, v, s in zip(knots, values, slopes, strict=True)
        ]
    axes[0, 0].set_yscale("log")
    axes[0, 0].set_ylim(0.3, 100)
    for ax in axes[1]:
        ax.set_xlabel("hub radius / length")
    for line in axes:
        line[0].set_ylabel("speed / first rest frequency")
    handles = [
        plt.Rectangle((0, 0), 1, 1, color="#CFE3F3"), plt.Rectangle((0, 0), 1, 1, color="#F6C9AE"),
        plt.Rectangle((0, 0), 1, 1, color="0.8"), plt.Line2D([], [], color="k", lw=2, marker="o"),
        plt.Line2D([], [], color=GREEN, lw=2, ls="--", marker="o"),
    ]  # fmt: skip
    words = ["stays bounded", "grows", "no steady state", "divergence", "the rod tears"]
    figure.legend(handles, words, loc="outside lower center", ncols=5, fontsize=9)
    common.save_figure(figure, out / "stability_maps.png", dpi=110)
    header = ("panel", "hub_radius_over_length", "speed_over_rest_frequency", "slope")
    common.write_csv(out / "boundaries.csv", header, rows)
    right = total = 0
    for unstable, knots, values, slopes, _ in results:
        known = np.full((radii.size, 1), np.inf)
        if np.isfinite(values).all():
            known = CubicHermiteSpline(knots, values, slopes)(radii)[:, None]
        predicted = np.asarray(speeds)[None] > known
        right += int(((np.asarray(unstable) > 0) == predicted).sum())
        total += predicted.size
    print(f"maps: {right} of {total} motions in time do what the critical speed says")


def outcome(model: Any, make: Any, radii: Any, speeds: Any) -> tuple[Any, ...]:
    """Of motions in time, 0 bounded, 1 growing, 2 without steady state; and critical speeds over
    the first rest frequency with derivatives by the hub radius at some radii."""
    lowest = jb.modes(model, make(0.0), 0.0, 1)
    rest, push = lowest.frequency[0], lowest.shape[0].real
    push = push / jnp.max(jnp.abs(push))
    mesh = jnp.meshgrid(speeds, radii, indexing="ij")  # a batch holds cases of one pace
    cases = [jnp.concatenate([m.ravel(), m.ravel()[: -m.size % 32]]) for m in mesh]
    motions, boundary = compiled(model)
    parts = [
        motions(jax.vmap(make)(radius), share * rest, rest, push)
        for share, radius in zip(*(c.reshape(-1, 32) for c in cases), strict=True)
    ]
    unstable = jnp.concatenate(parts)[: mesh[0].size].reshape(mesh[0].shape).T
    knots = 4 * jnp.linspace(0.0, 1.0, 9) ** 2  # boundaries of Model 0 are steep at the left
    (values, direction), (slopes, _) = boundary(jax.vmap(make)(knots))
    size = make(0.0).beam.length if isinstance(make(0.0), jb.Rotor) else 1.0
    return unstable, np.asarray(knots), values / rest, slopes * size / rest, int(direction[0])


@functools.lru_cache
def compiled(model: Any) -> tuple[Any, Any]:
    """Batches of motions in time, and of critical speeds with derivatives by the hub radius."""

    def motion(at: Any, speed: Any, rest: Any, push: Any) -> Any:
        _, status = model.steady(at, speed)
        duration = 30 * 2 * jnp.pi / jnp.hypot(rest, 0.3 * speed)
        grew = growth(model, at, speed, push, duration)
        return jnp.where(status == jb.Status.OK, jnp.where(grew > 30, 1, 0), 2)

    def boundary(at: Any) -> Any:
        def critical(radius: Any) -> tuple[Any, Any]:
            moved = eqx.tree_at(lambda r: r.hub_radius, at, radius)
            found = jb.critical_speed(model, moved, throw=False)
            return found.angular_speed, found.direction

        return jax.jvp(critical, (at.hub_radius,), (jnp.ones_like(at.hub_radius),))

    return jax.jit(jax.vmap(motion, (0, 0, None, None))), jax.jit(jax.vmap(boundary))


def springs(radius: Any) -> jb.papers.SpringRotor:
    """The discrete analogue with this hub radius, in m."""
    return eqx.tree_at(lambda r: r.hub_radius, SPRINGS, jnp.asarray(radius))


def tongues(out: Path, quick: bool) -> None:
    """Growth over frequency and depth of modulation, with boundaries traced along the gradient."""
    model, at, mean = jb.Hybrid(0, 3, 0), rotor(BEAM, 0.5, 0.3), 3.0
    frequency, depth = (
        jnp.linspace(2.0, 50.0, 49 if quick else 385),
        jnp.linspace(0.02, 0.8, 8 if quick else 40),
    )

    def case(*, frequency: Any, depth: Any) -> Any:
        found = jb.floquet(
            model, at, jb.motions.ModulatedSpeed(mean, depth, frequency), throw=False
        )
        return {"growth": found.growth_rate, "status": found.status}

    table = jb.sweep(case, jb.grid(frequency=np.asarray(frequency), depth=np.asarray(depth)))
    figure, ax = plt.subplots(figsize=(8.5, 5), layout="constrained")
    image = ax.pcolormesh(
        frequency, depth, np.maximum(table["growth"], 0).T, shading="nearest", cmap="Blues"
    )
    figure.colorbar(image, label="growth rate (1/s, for a beam with L = rho = EI = 1)")
    labels = jb.labels(in_plane=2)
    wanted = [(0, 0, 2), (0, 0, 1), (0, 1, 1), (1, 1, 1)]
    wanted += [] if quick else [(0, 1, 2), (1, 1, 2)]
    depths = np.linspace(0.02, 0.8, 40)
    rows = []
    for damping, style in [(None, "-")] if quick else [(None, "-"), (0.1, ":")]:
        for i, j, order in wanted:
            found = jb.tongue(
                model, at, mean, (labels[i], labels[j]), depths, order=order, throw=False,
                damping=jb.Damping(mass_coefficient=damping),
            )  # fmt: skip
            good = np.asarray(found.status) == jb.Status.OK
            ax.plot(found.frequency[good], depths[good], style, color=VERMILION, lw=1.5)
            words = f"2 ω{i + 1}" if i == j else f"ω{i + 1} + ω{j + 1}"
            words = words if order == 1 else (f"ω{i + 1}" if i == j else f"({words}) / 2")
            if damping is None:
                ax.annotate(
                    words, (float(found.onset), 0.0), xytext=(0, -24), ha="center", fontsize=9,
                    textcoords="offset points", annotation_clip=False,
                )  # fmt: skip
            first = depths[good][0] if good.any() else np.nan
            print(
                f"tongue at {words:13s} onset {float(found.onset):9.5f}, "
                f"mass damping {damping or 0}: from depth {first:.2f}, "
                f"{good.sum()} of {good.size} depths"
            )
            for d, pair, status in zip(depths, found.frequency, found.status, strict=True):
                low, high = (float(f) for f in pair)
                rows.append((words, damping or 0, d, low, high, jb.Status(int(status)).name))
    ax.plot([], [], "-", color=VERMILION, label="boundary traced, undamped")
    ax.plot([], [], ":", color=VERMILION, label="mass damping 0.1 1/s")
    ax.set(
        xlabel="frequency of modulation (rad/s)", ylabel="depth of modulation", xlim=(2, 50),
        ylim=(0, 0.8), title=f"Parametric resonance at a mean speed of {mean} rad/s",
    )  # fmt: skip
    ax.xaxis.labelpad = 14  # below the names of the tongues
    ax.legend(fontsize=8, loc=(0.49, 0.08))
    common.save_figure(figure, out / "tongues.png", dpi=110)
    header = ("tongue", "damping_1_s", "depth", "low_rad_s", "high_rad_s", "status")
    common.write_csv(out / "tongues.csv", header, rows)
    table.to_csv(out / "floquet.csv")


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds figures and tables."""
    began = time.perf_counter()
    out = common.folder(out, "stability")
    for part in (tongues, critical_table, maps):
        start = time.perf_counter()
        part(out, quick)
        print(f"  [{part.__name__}: {time.perf_counter() - start:.0f} s]", flush=True)
    return common.finish(began, "figures and tables are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer models, elements and points", "figures and tables")
