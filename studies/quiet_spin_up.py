"""The shape of a spin-up that leaves 256 rotors quiet whose tip mass and stiffness are uncertain.

What vibrates on after arrival at a constant speed keeps its energy E: the Jacobi integral, kinetic
energy seen from the hub plus strain energy plus centrifugal potential, which is zero at rest in the
hub. The measure is what deflection of the tip, over the length, this energy would make as a static
one at full speed: (2 E c)^(1/2) / L, c the compliance at the tip. L-BFGS of optax searches twelve
cosines in the acceleration for the least of its worst case over the rotors, by gradients of the
batch. Beside it stand the optimum for the nominal rotor, the smooth spin-ups of Y, input shapers
(N. C. Singer, W. P. Seering, Preshaping command inputs to reduce system vibration, 1990), and least
values over all accelerations within a limit, by linear programming. The modal model finds the
shapes; geometrically exact elements judge them by what the tip does.

    python studies/quiet_spin_up.py [--quick] [--out FOLDER]
"""

import math
import time
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import common
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax
import scipy.linalg
from common import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from scipy.optimize import linprog

import jaxbeam as jb

BEAM = jb.Beam.from_section(**common.ALUMINIUM)
LENGTH = common.ALUMINIUM["length"]
HUB, TIP = 0.5, 0.2  # m, kg
STIFFNESS, MASS = (0.8, 1.2), (0.5, 1.5)  # of the nominal bending stiffness and tip mass
SPEED, DURATION = 2.5, 8.0  # rad/s, s
FUNCTIONS = 3
MODEL, JUDGE = jb.Hybrid(0, FUNCTIONS, 0), jb.PlanarRod(8)
FREE, WAVES = 12, 40  # cosines of the search, and of the bound
LIMIT = 2.5  # of accelerations in the bound, over the mean one; `SmoothSpinUp` reaches 2
AFTER = 3.0  # s for which elements are watched after arrival: more than a period of all rotors
WATCH = np.linspace(0.0, DURATION + AFTER, 221)
STEPS = 1000  # at most: reverse mode keeps numbers for every step that there may be
SMOOTH, ROBUST, NOMINAL = "smooth, Y eq. 23", "robust optimum", "nominal optimum"
COLOURS = {
    SMOOTH: BLUE, "quintic, Y eq. 21": SKY, "ZV shaper": ORANGE, "ZVD shaper": GREEN,
    NOMINAL: PURPLE, ROBUST: VERMILION,
}  # fmt: skip


class SpinUp(jb.motions.Spin):
    """All shapes in one class, so that the model compiles only once: a quintic, smooth spin-ups
    that begin one after the other, and cosines in the acceleration."""

    quintic: jb.motions.QuinticSpinUp
    smooth: jb.SmoothSpinUp
    delays: jax.Array  # (3,) of the smooth ones, s
    shares: jax.Array  # (3,) of them in the speed
    waves: jax.Array  # (WAVES,) of cos(k pi t / T), k = 1, 2, ..., over the mean acceleration
    axis: jax.Array

    def change_times(self) -> jax.Array:
        return jnp.concatenate([self.quintic.change_times(), self.delays])

    def _phases(self, t: Any) -> tuple[Any, Any]:
        duration = self.quintic.duration
        k = np.pi * np.arange(1, self.waves.size + 1)
        return k, k * jnp.where(t > duration, 1.0, jnp.where(t < 0, 0.0, t / duration))

    def angular_speed(self, t: Any) -> Any:
        """Its rate is the mean acceleration times the sum of the cosines, and the rest."""
        k, phase = self._phases(t)
        begun = jnp.stack([self.smooth.angular_speed(t - late) for late in self.delays])
        waves = SPEED * jnp.sum(self.waves * jnp.sin(phase) / k)
        return self.quintic.angular_speed(t) + self.shares @ begun + waves

    def angle(self, t: Any) -> Any:
        k, phase = self._phases(t)
        begun = jnp.stack([self.smooth.angle(t - late) for late in self.delays])
        waves = SPEED * self.quintic.duration * jnp.sum(self.waves * (1 - jnp.cos(phase)) / k**2)
        return self.quintic.angle(t) + self.shares @ begun + waves


def shaped(shares: Any = (1.0, 0.0, 0.0), late: Any = 0.0, waves: Any = None) -> SpinUp:
    """Smooth spin-ups in these shares, each `late` (s) after the one before it: the last of those
    that there are ends when the duration does. What the shares leave is quintic."""
    shares = jnp.asarray(shares)
    last = jnp.sum(shares > 0) - 1
    smooth = jb.SmoothSpinUp(SPEED, DURATION - jnp.maximum(last, 0) * late)
    return SpinUp(
        quintic=jb.motions.QuinticSpinUp(SPEED * (1 - jnp.sum(shares)), DURATION),
        smooth=smooth, delays=late * jnp.arange(3.0), shares=shares,
        waves=jnp.zeros(WAVES) if waves is None else waves, axis=smooth.axis,
    )  # fmt: skip


# Rows of waves whose acceleration vanishes at both ends, one for each free coefficient.
BASIS = np.eye(FREE, WAVES, 2) - np.eye(WAVES)[np.arange(FREE) % 2]


class Plant(NamedTuple):
    """What is known of each rotor at a speed: modes of unit modal mass, and how they are driven."""

    frequency: Any  # (n,), rad/s
    modal: Any  # (n, n): modal coordinates of Ritz ones, kg^1/2
    drive: Any  # (n,): forces of a unit angular acceleration of the hub, kg^1/2 m
    unit: Any  # (c)^(1/2) / L, which makes the measure of roots of twice the energy


def rotor(stiffness: Any, mass: Any) -> jb.Rotor:
    bending = stiffness * BEAM.in_plane_bending_stiffness
    beam = jb.Beam(LENGTH, BEAM.mass_per_length, BEAM.axial_stiffness, bending, bending)
    return jb.Rotor(beam, HUB, mass * TIP)


@jax.jit
@partial(jax.vmap, in_axes=(0, None))
def linear(rotor: jb.Rotor, speed: Any) -> tuple[jb.models.LinearSystem, Any]:
    """Matrices at a speed, and forces of a unit angular acceleration of the hub."""
    none, zero = jnp.zeros(3), jnp.zeros(FUNCTIONS)
    pull = jb.motions.Hub(none, none, none, jnp.array([0.0, 0.0, 1.0]), none)
    system = MODEL.linearise(rotor, speed, throw=False)
    return system, MODEL.equations(rotor).force(pull, zero, zero, None)


def plants(rotors: jb.Rotor, speed: float) -> Plant:
    """Of each rotor. Without stretch nothing couples by Coriolis forces: modes are real."""
    system, force = jax.tree.map(np.asarray, linear(rotors, speed))
    tip, found = np.asarray(MODEL.displacement(np.ones(1), rotors)[1, 0]), []
    for mass, stiffness, pull in zip(system.mass, system.stiffness, force, strict=True):
        square, shape = scipy.linalg.eigh(stiffness, mass)
        unit = np.sqrt(tip @ np.linalg.solve(stiffness, tip)) / LENGTH
        found.append(Plant(np.sqrt(square), shape.T @ mass, shape.T @ pull, unit))
    return jax.tree.map(lambda *each: np.stack(each), *found)


def amplitude(motion: SpinUp, rotor: jb.Rotor, plant: Plant) -> Any:
    """At arrival: (mode, 2), whose sum of squares is the square of the measure."""
    ends = np.array([0.0, DURATION])
    run = jb.simulate(MODEL, rotor, motion, ends, max_steps=STEPS, throw=False)
    place, rate = plant.modal @ run.state.q[-1], plant.modal @ run.state.v[-1]
    return plant.unit * jnp.stack([plant.frequency * place, rate], 1)


def weighted(waves: Any, rotor: jb.Rotor, plant: Plant, weight: Any) -> Any:
    """The sum of weighted amplitudes of a rotor."""
    return jnp.sum(weight * amplitude(shaped(waves=waves), rotor, plant))


def tip(motion: SpinUp, rotor: jb.Rotor) -> Any:
    """Deflection of the tip of the elements over the length, on the way and afterwards."""
    run = jb.simulate(JUDGE, rotor, motion, WATCH, max_steps=20 * STEPS, throw=False)
    return run.tip[:, 1] / LENGTH


# Each is compiled once, since batches are of one shape. They share the motion, at which `simulate`
# then looks once for all of them.
amplitudes = jax.jit(jax.vmap(amplitude, (None, 0, 0)))
slopes = jax.jit(jax.vmap(jax.value_and_grad(weighted), (None, 0, 0, 0)))
tips = jax.jit(jax.vmap(tip, (None, 0)))


class Fleet:
    """The rotors side by side, the nominal one last."""

    def __init__(self, side: int) -> None:
        grid = np.meshgrid(np.linspace(*STIFFNESS, side), np.linspace(*MASS, side))
        stiffness, mass = (np.append(x, 1.0) for x in grid)
        self.count = stiffness.size
        self.rotors = jax.vmap(rotor)(stiffness, mass)
        self.plants = plants(self.rotors, SPEED)
        # Every third each way, with the edges: enough for bounds and for the judge.
        picked = np.unique(np.append(np.arange(0, side, 3), side - 1))
        self.some = (picked[:, None] * side + picked).ravel()

    def amplitudes(self, motion: SpinUp) -> np.ndarray:
        return np.asarray(amplitudes(motion, self.rotors, self.plants))

    def slopes(self, waves: Any, weight: Any) -> np.ndarray:
        """Of weighted amplitudes, by the waves: (rotor, WAVES)."""
        return np.asarray(slopes(waves, self.rotors, self.plants, weight)[1])


def size(amplitudes: np.ndarray) -> np.ndarray:
    """The measure of what is left, of each rotor."""
    return np.linalg.norm(amplitudes, axis=(1, 2))


def mean_power(found: np.ndarray, chosen: np.ndarray, power: float) -> tuple[float, np.ndarray]:
    """Logarithm of the mean of residuals to this power, its root taken, over the rotors chosen, and
    its derivatives: close to the largest of them where the power is high."""
    left = size(found)
    top = left[chosen].max()
    share = np.where(chosen, (left / top) ** power, 0.0)
    value = np.log(top) + np.log(share.sum() / chosen.sum()) / power
    return float(value), (share / share.sum() / left**2)[:, None, None] * found


def quietest(
    fleet: Fleet,
    start: np.ndarray,
    chosen: np.ndarray,
    power: float,
    steps: int,
    enough: float = 0.0,
) -> np.ndarray:
    """Coefficients from L-BFGS, steps shortened until the mean falls; it ends where the mean falls
    by less than 1 in 10,000, or is below `enough`."""

    def look(x: np.ndarray) -> tuple[float, np.ndarray]:
        return mean_power(fleet.amplitudes(shaped(waves=x @ BASIS)), chosen, power)

    optimiser = optax.scale_by_lbfgs(memory_size=FREE)
    update, state = jax.jit(optimiser.update), optimiser.init(start)
    x, (value, weight) = start, look(start)
    for k in range(steps):
        slope = BASIS @ fleet.slopes(x @ BASIS, weight).sum(0)
        direction, state = update(slope, state, x)
        uphill = direction @ slope <= 0  # where curvature along the last step was negative
        if uphill:
            direction, state = update(slope, optimiser.init(x), x)
        step = -np.asarray(direction)
        if uphill or k == 0:
            step *= 0.05 / np.linalg.norm(step)
        before, trial = value, look(x + step)
        while not trial[0] < before + 1e-4 * slope @ step and np.abs(step).max() > 1e-9:
            step, trial = step / 3, look(x + step / 3)
        if not trial[0] < before:
            break
        x, (value, weight) = x + step, trial
        if before - value < 1e-4 or np.exp(value) < enough:
            break
    print(f"  power {power:3g}: {k + 1:3d} steps, mean {np.exp(value):.2e}", flush=True)
    return x


def least(now: np.ndarray, by: np.ndarray, waves: np.ndarray) -> float:
    """Least worst case over all waves within LIMIT of amplitudes (rotor, 2) that are `now` with
    these waves and linear in them, `by` (rotor, 2, WAVES). A polygon of 24 sides around the circle
    makes it a linear programme, low by 1 % at most. Without a limit it would be zero: large enough
    accelerations cancel on any band of frequencies that ends."""
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    sides = np.stack([np.cos(turn), np.sin(turn)], 1)
    unit = 1e4  # of the measure, so that the programme is well scaled
    rows = unit * np.einsum("sc,rcw->rsw", sides, by).reshape(-1, WAVES)
    right = rows @ waves - unit * np.einsum("sc,rc->rs", sides, now).ravel()
    rows = np.append(rows, -np.ones((len(rows), 1)), 1)
    wave = np.cos(np.outer(np.linspace(0, np.pi, 241), np.arange(1, WAVES + 1)))
    wave = np.append(wave, np.zeros((241, 1)), 1)
    found = linprog(
        np.append(np.zeros(WAVES), 1.0), np.concatenate([rows, wave, -wave]),
        np.concatenate([right, np.full(241, LIMIT - 1), np.full(241, LIMIT + 1)]),
        bounds=[(None, None)] * WAVES + [(0, None)],
    )  # fmt: skip
    if not found.success:
        raise RuntimeError(f"the bound was not found: {found.message}")
    return float(found.fun) / unit


def least_linear(fleet: Fleet, speed: float) -> float:
    """For rotors whose stiffness stays what it is at one speed: by Duhamel's integral."""
    at = jax.tree.map(lambda x: np.asarray(x)[fleet.some], plants(fleet.rotors, speed))
    t = np.linspace(0.0, DURATION, 4001)
    wave = np.cos(np.outer(np.arange(WAVES + 1), np.pi * t / DURATION))
    phase = np.outer(at.frequency[:, 0], DURATION - t)
    kernel = np.stack([np.sin(phase), np.cos(phase)], 1)[:, :, None] * wave
    scale = at.unit * at.drive[:, 0] * SPEED / DURATION
    by = scale[:, None, None] * np.trapezoid(kernel, t)
    return least(by[:, :, 0], by[:, :, 1:], np.zeros(WAVES))


def least_nearby(fleet: Fleet, waves: np.ndarray) -> float:
    """To first order about these waves added to the smooth spin-up, stiffening and all, for first
    modes. A bound for small changes alone: stiffness goes with the square of the speed."""
    now = fleet.amplitudes(shaped(waves=waves))
    by = []
    for component in range(2):
        weight = np.zeros(now.shape)
        weight[:, 0, component] = 1.0
        by.append(fleet.slopes(waves, weight)[fleet.some])
    total = waves - np.eye(WAVES)[1]  # with the cosine of `SmoothSpinUp` itself
    return least(now[fleet.some, 0], np.stack(by, 1), total)


def shaper(fleet: Fleet, shares: Any) -> tuple[SpinUp, float]:
    """The shaper whose frequency leaves the nominal rotor quietest: it stiffens on the way, so no
    frequency is its own. And that frequency, rad/s."""
    rest, full = (float(plants(fleet.rotors, s).frequency[-1, 0]) for s in (0.0, SPEED))
    frequencies = np.linspace(0.6 * rest, 1.1 * full, 25)
    motions = [shaped(shares, np.pi / frequency) for frequency in frequencies]
    best = int(np.argmin([size(fleet.amplitudes(motion))[-1] for motion in motions]))
    return motions[best], float(frequencies[best])


def optima(fleet: Fleet, quick: bool) -> dict[str, np.ndarray]:
    """Waves of both optima."""
    steps, everyone = 25 if quick else 80, np.arange(fleet.count) < fleet.count - 1
    x = np.zeros(FREE)
    print(ROBUST)
    for power in (4.0, 16.0) if quick else (4.0, 16.0, 64.0):
        x = quietest(fleet, x, everyone, power, steps)
    print(NOMINAL)
    alone = quietest(fleet, np.zeros(FREE), ~everyone, 2.0, steps, 1e-6)
    return {NOMINAL: alone @ BASIS, ROBUST: x @ BASIS}


def watched(fleet: Fleet, motion: SpinUp) -> np.ndarray:
    """Tips of some of the rotors on elements."""
    some = jax.tree.map(lambda x: x[fleet.some], fleet.rotors)
    return np.asarray(tips(motion, some))


def acceleration(motion: SpinUp, times: np.ndarray) -> np.ndarray:
    """Of the hub, rad/s^2."""
    return np.asarray(jax.vmap(jax.grad(motion.angular_speed))(times))


def tell(out: Path, motions: Any, found: Any, seen: Any, bounds: dict[str, float]) -> None:
    """Print and write the table."""
    after, rows = WATCH > DURATION, []
    times = np.linspace(0, DURATION, 801)
    print("vibration of the tip over L   nominal      rms    worst  of elements  acceleration")
    for name, motion in motions.items():
        left, peak = found[name], np.abs(acceleration(motion, times)).max()
        elements, rms = np.abs(seen[name][:, after]).max(), np.sqrt(np.mean(left[:-1] ** 2))
        rows.append((name, left[-1], rms, left[:-1].max(), elements, peak))
        print("{:27s} {:.2e} {:.2e} {:.2e}     {:.2e}  {:.3f} rad/s^2".format(*rows[-1]))
    for name, bound in bounds.items():
        rows.append((name, "", "", bound, "", LIMIT * SPEED / DURATION))
        print(f"{name:46s}{bound:.2e}")
    print(f"elements: largest deflection {max(np.abs(x).max() for x in seen.values()):.3f} L")
    header = ("shape", "nominal", "rms", "worst", "worst_of_elements", "acceleration_rad_s2")
    common.write_csv(out / "quiet_spin_up.csv", header, rows)


def draw(
    path: Path, motions: Any, found: Any, seen: Any, bounds: dict[str, float], at_rest: Any
) -> None:
    """Accelerations, the tip of the softest rotor with the heaviest mass, and what is left."""
    figure, axes = plt.subplot_mosaic(
        "ab;cc", figsize=(10, 7.5), layout="constrained", height_ratios=[4, 5]
    )
    times, corner = np.linspace(0.0, DURATION, 401), -math.isqrt(len(seen[SMOOTH]))
    for name, motion in motions.items():
        line: Any = {"color": COLOURS[name], "lw": 2 if name == ROBUST else 1.2}
        axes["a"].plot(times, acceleration(motion, times), **line)
        axes["b"].plot(WATCH, LENGTH * seen[name][corner], **line)
        axes["c"].plot(at_rest, found[name][:-1], ".", ms=5, color=COLOURS[name], label=name)
    for (name, bound), style in zip(bounds.items(), (":", "-.", "--"), strict=True):
        axes["c"].axhline(bound, ls=style, color="0.3", lw=1, label=name)
    axes["b"].axvline(DURATION, color="0.7", lw=1)
    axes["a"].set(xlabel="time (s)", ylabel="acceleration of the hub (rad/s²)")
    axes["b"].set(xlabel="time (s)", ylabel="deflection of the tip (m)", ylim=(-0.25, 0.25),
                  xlim=(DURATION - 1.0, DURATION + AFTER))  # fmt: skip
    axes["b"].set_title("softest rotor, heaviest tip, on elements; arrival at the line", fontsize=9)
    axes["c"].set(xlabel="first in-plane frequency at rest (rad/s)", yscale="log",
                  ylabel="vibration of the tip over the length")  # fmt: skip
    for ax in axes.values():
        ax.grid(alpha=0.3)
    figure.legend(*axes["c"].get_legend_handles_labels(), loc="outside lower center", ncols=3,
                  fontsize=8, markerscale=2)  # fmt: skip
    common.save_figure(figure, path, dpi=85)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figure and the table."""
    began = time.perf_counter()
    out = common.folder(out, "quiet_spin_up")
    fleet = Fleet(5 if quick else 16)
    at_rest = plants(fleet.rotors, 0.0).frequency[:-1, 0]
    full = fleet.plants.frequency[:-1, 0]
    print(f"{fleet.count - 1} rotors, first in-plane frequency {at_rest.min():.2f} to "
          f"{at_rest.max():.2f} rad/s at rest, {full.min():.2f} to {full.max():.2f} rad/s at "
          f"{SPEED:g} rad/s, reached in {DURATION:g} s")  # fmt: skip
    (zv, zv_at), (zvd, zvd_at) = (shaper(fleet, s) for s in ((0.5, 0.5, 0.0), (0.25, 0.5, 0.25)))
    print(f"shapers: ZV for {zv_at:.3f} rad/s, ZVD for {zvd_at:.3f} rad/s")
    waves = optima(fleet, quick)
    first = (shaped(), shaped((0.0, 0.0, 0.0)), zv, zvd)
    motions = dict(zip(COLOURS, (*first, *(shaped(waves=w) for w in waves.values())), strict=True))
    found = {name: size(fleet.amplitudes(motion)) for name, motion in motions.items()}
    seen = {name: watched(fleet, motion) for name, motion in motions.items()}
    bounds = {
        "least, stiffness as at rest": least_linear(fleet, 0.0),
        "least, stiffness as at full speed": least_linear(fleet, SPEED),
        "least, to first order about the optimum": least_nearby(fleet, waves[ROBUST]),
    }
    tell(out, motions, found, seen, bounds)
    both, _ = common.timed(3, fleet.slopes, waves[ROBUST], np.ones((fleet.count, FUNCTIONS, 2)))
    forward, _ = common.timed(3, fleet.amplitudes, motions[ROBUST])
    print(f"all rotors {forward:.2f} s, with gradients by {WAVES} waves {both:.2f} s")
    draw(out / "quiet_spin_up.png", motions, found, seen, bounds, at_rest)
    return common.finish(began, "the figure and the table are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "25 rotors and fewer steps", "the figure and the table")
