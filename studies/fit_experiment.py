"""A composite blade from its measured flap frequencies, and what the theory of beams leaves over.

Bending stiffness is fitted to the frequencies of the blade of Epps and Chandra (1996, see
`studies/data`): at rest alone, to say how the first mode stiffens with speed; to all speeds but
one, to say the one left out; with the effective place of the root or not, and with a spring at the
root. The level of noise is not known and taken from the residuals. Then what fits cost, on
synthetic frequencies.

One beam does not explain all modes, with a spring at the root no better than without: fitted, the
spring goes to infinity and leaves the sum of squares as it was, and by 95 % it is above 440 N
m/rad, 53 EI / L (210 where the place of the root is fitted too). It would lower first modes most,
and what is left over is that higher ones are too low: stiffness from one mode at a time has
intervals that do not overlap, with the softest spring as without.

    python studies/fit_experiment.py [--quick] [--out FOLDER]
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import common
import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import BLUE, GREEN, ORANGE, VERMILION

import jaxbeam as jb

DATA = Path(__file__).parent / "data" / "epps_chandra_1996_composite.csv"
INCH, POUND = 0.0254, 4.4482216152605
LENGTH, HUB, WIDTH, HEIGHT = 37.5 * INCH, 2.5 * INCH, 1.0 * INCH, 0.117 * INCH
MODULUS = 2.059e7 * POUND / INCH**2
DENSITY = 1.44e-4 * POUND / INCH**4  # lb s^2 / in^4
AREA = WIDTH * HEIGHT
NOMINAL = MODULUS * WIDTH * HEIGHT**3 / 12
MODEL = jb.Hybrid(1, 1, 12)
WHICH = jb.labels(flap=4)
NOISE = 0.01  # relative; only that it is the same for all is believed
COLOURS = (BLUE, VERMILION, GREEN, ORANGE)


def measured() -> tuple[np.ndarray, np.ndarray]:
    """Speeds in rad/s, and four frequencies in rad/s at each."""
    table = np.loadtxt(DATA, delimiter=",", skiprows=1)
    return table[:, 0] * np.pi / 30, table[:, 1:] * 2 * np.pi


def blade(stiffness: Any, clamp: Any = 0.0, spring: Any = None) -> jb.Rotor:
    """`clamp`: how much farther out than drawn the root is, so much shorter the free length;
    `spring`: of the root in flap, in N m/rad, or none for one that does not yield."""
    return jb.Rotor(
        jb.Beam(
            LENGTH - clamp, DENSITY * AREA, MODULUS * AREA,
            MODULUS * HEIGHT * WIDTH**3 / 12, stiffness,
        ),
        HUB + clamp, root_springs=None if spring is None else jb.RootSprings(flap=spring),
    )  # fmt: skip


class Seen(eqx.Module):
    """What was measured; as leaves, so that other data do not compile anew. And a spring, if one is
    held."""

    speeds: Any
    frequencies: Any
    held: Any = None

    def __call__(self, stiffness: Any, clamp: Any = 0.0, spring: Any = None) -> jb.FrequencyData:
        noise = NOISE * jnp.where(jnp.isfinite(self.frequencies), self.frequencies, 1.0)
        spring = self.held if spring is None else spring
        rotor, model = blade(stiffness, clamp, spring), MODEL
        return jb.FrequencyData(model, rotor, self.speeds, self.frequencies, noise, WHICH)


@jax.jit
def frequencies_at(speeds: Any, stiffness: Any, clamp: Any = 0.0) -> Any:
    """In Hz, (speeds, 4)."""
    rotor = blade(stiffness, clamp)
    found = jax.vmap(lambda w: jb.modes(MODEL, rotor, w, WHICH, throw=False).frequency)(
        jnp.asarray(speeds)
    )
    return found / (2 * np.pi)


STIFFNESS = {"stiffness": jb.FreeParameter(NOMINAL)}
BOTH = STIFFNESS | {"clamp": jb.FreeParameter(1.0 * INCH, 0.0, 6.0 * INCH)}
SPRING = STIFFNESS | {"spring": jb.FreeParameter(30 * NOMINAL / LENGTH)}


def fit(
    speeds: Any, frequencies: Any, free: dict[str, jb.FreeParameter], known: bool = False,
    spring: float | None = None,
) -> jb.results.Fit:  # fmt: skip
    """`spring` is one that is held."""
    # How well beams can explain this is the question: no second search where they do not.
    held = None if spring is None else jnp.asarray(spring)
    seen = Seen(jnp.asarray(speeds), jnp.asarray(frequencies), held)
    return jb.fit(seen, free, known_noise=known, progress=False, throw=False)


def left_out(free: dict[str, jb.FreeParameter]) -> list[tuple[float, int, float, float]]:
    """(rpm, mode, measured in Hz, relative error of what the other speeds predict)."""
    speeds, frequencies = measured()
    rows = []
    for i, speed in enumerate(speeds):
        others = np.where(np.arange(len(speeds))[:, None] == i, np.nan, frequencies)
        found = fit(speeds, others, free)
        said = np.asarray(frequencies_at([speed], **found.partial.parameters))[0]
        for k, (f, g) in enumerate(zip(said, frequencies[i] / (2 * np.pi), strict=True)):
            rows.append((speed * 30 / np.pi, k + 1, g, f / g - 1))
    return rows


def squares(found: jb.results.Fit) -> float:
    """Sum of squares of the residuals."""
    return float(found.reduced_chi_squared * found.degrees_of_freedom)


def held_springs(free: dict[str, jb.FreeParameter], count: int) -> list[tuple[float, float]]:
    """(spring, sum of squares over that of a root that does not yield)."""
    rigid = squares(fit(*measured(), free))
    springs = NOMINAL / LENGTH * np.geomspace(3.0, 3e3, count)
    return [(k, squares(fit(*measured(), free, spring=k)) / rigid) for k in springs]


def softest(rows: list[tuple[float, float]], found: jb.results.Fit) -> float:
    """The spring at the lower end of its 95 % interval, by the sum of squares; `found` is the fit
    with a root that does not yield."""
    freedom = int(found.degrees_of_freedom) - 1
    rise = 1 + float(found.width()) ** 2 / freedom
    springs, ratios = np.array(rows).T
    # What a stiff spring adds goes by its inverse: logarithms lie on a line.
    return float(np.exp(np.interp(-np.log(rise - 1), -np.log(ratios - 1), np.log(springs))))


def one_mode(mode: int, spring: float | None = None) -> jb.results.Fit:
    """Stiffness from one mode at rest and at speed alone."""
    speeds, frequencies = measured()
    only = np.full_like(frequencies, np.nan)
    only[:, mode] = frequencies[:, mode]
    return fit(speeds, only, STIFFNESS, spring=spring)


def costs(quick: bool) -> list[str]:
    """Six parameters from frequencies: one fit, a hundred in a batch, a Jacobian."""
    draws = 100
    model, which, speeds = (
        jb.Hybrid(3, 6, 6),
        jb.labels(in_plane=3, flap=3, axial=1),
        [0.0, 2, 4, 6],
    )
    truth = {"in_plane": 2.0, "flap": 1.2, "axial": 3e4, "mass": 1.1, "hub": 0.3, "tip": 0.4}

    def build(measured: Any, noise: Any) -> Callable[..., list[jb.fitting.Experiment]]:
        def experiments(**p: Any) -> list[jb.fitting.Experiment]:
            beam = jb.Beam(1.0, p["mass"], p["axial"], p["in_plane"], p["flap"])
            return [
                jb.FrequencyData(
                    model, jb.Rotor(beam, p["hub"], p["tip"] + more), speeds, y, s, which
                )
                for more, y, s in zip((0.0, 0.25), measured, noise, strict=True)
            ]

        return experiments

    ones = np.ones((2, len(speeds), len(which)))
    exact = np.stack([np.asarray(e.predicted()) for e in build(ones, ones)(**truth)])
    noise = 1e-3 * exact
    rng = np.random.default_rng(0)
    measured = exact + noise * rng.normal(size=(draws, *exact.shape))
    free = {name: jb.FreeParameter(1.1 * value) for name, value in truth.items()}

    def one(y: Any) -> jb.results.Fit:
        return jb.fit(build(y, noise), free, throw=False)

    vector = jnp.asarray(list(truth.values()))

    def residual(p: Any) -> Any:
        named = dict(zip(truth, p, strict=True))
        return jnp.stack([e.residual() for e in build(exact, noise)(**named)])

    spent, compiled = {}, {}
    for name, function, argument in (
        ("one fit", jax.jit(one), measured[0]),
        ("100 fits in a batch", jax.jit(jax.vmap(one)), measured),
        ("residuals", jax.jit(residual), vector),
        ("residuals and Jacobian", jax.jit(jax.jacfwd(residual)), vector),
    ):
        compiled[name], _ = common.timed(1, function, argument)
        spent[name], _ = common.timed(3 if quick else 10, function, argument)
    lines = [
        f"  {name:24} {1e3 * seconds:9.2f} ms; the first time {compiled[name]:.1f} s"
        for name, seconds in spent.items()
    ]
    ratio = spent["100 fits in a batch"] / spent["one fit"]
    gradient = spent["residuals and Jacobian"] / spent["residuals"]
    lines.append(f"  100 fits in a batch take {ratio:.1f} times as long as one")
    lines.append(f"  residuals with Jacobian take {gradient:.1f} times as long as alone")
    return lines


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figure and the tables."""
    out = common.folder(out, "fit_experiment")
    speeds, frequencies = measured()
    rpm, hertz = speeds * 30 / np.pi, frequencies / (2 * np.pi)

    rest = np.full_like(frequencies, np.nan)
    rest[0, 0] = frequencies[0, 0]
    others = frequencies.copy()
    others[1:, 0] = np.nan
    alone = fit(speeds, rest, STIFFNESS, known=True)  # one number: no noise to be seen
    said = {
        "EI by its frequency at rest": alone,
        "EI, clamp by all but it at speed": fit(speeds, others, BOTH),
    }
    print("First mode at speed, predicted without having been seen there, and measured")
    for name, found in said.items():
        best = found.partial.parameters  # also where the data leave much open
        first = np.asarray(frequencies_at(speeds, **best))[:, 0]
        values = ", ".join(f"{k} {float(v):.4g}" for k, v in best.items())
        print(f"  {name}: {values} ({jb.Status(int(found.status)).message})")
        for r, f, g in zip(rpm, first, hertz[:, 0], strict=True):
            print(f"    {r:4.0f} rpm  {f:8.3f} Hz  {g:8.3f} Hz  {f / g - 1:+.1%}")

    fits = {
        "stiffness": fit(speeds, frequencies, STIFFNESS),
        "and clamp": fit(speeds, frequencies, BOTH),
        "and spring": fit(speeds, frequencies, SPRING),
    }
    for name, found in fits.items():
        print(f"\nAll modes at all speeds: {name}\n{found}")
    total = {name: squares(found) for name, found in fits.items()}
    for name in ("clamp", "spring"):
        gain = total["stiffness"] / total[f"and {name}"]
        print(f"\nSum of squares without {name} over that with it: {gain:.3f}")
    springs = {
        "stiffness": held_springs(STIFFNESS, 7 if quick else 19),
        "and clamp": held_springs(BOTH, 7 if quick else 19),
    }
    limit = {name: softest(some, fits[name]) for name, some in springs.items()}
    for name, k in limit.items():
        print(f"Softest spring by 95 %, {name} fitted: {k:.0f} N m/rad, "
              f"{k * LENGTH / NOMINAL:.0f} E b h^3 / 12 / L")  # fmt: skip
    common.write_csv(
        out / "springs.csv", ("fitted", "spring_n_m", "sum_of_squares_over_that_of_rigid_root"),
        ((name, *row) for name, some in springs.items() for row in some),
    )  # fmt: skip
    print("\nStiffness over E b h^3 / 12 from one mode at all speeds (equal if beams explained it)")
    for spring in (None, limit["stiffness"]):
        if spring is not None:
            print(f"the same with a spring of {spring:.0f} N m/rad")
        for mode in range(4):
            one = one_mode(mode, spring)
            low, high = (float(x) / NOMINAL for x in one.interval()["stiffness"])
            print(f"  {'mode' if spring is None else 'flap'} {mode + 1}: {low:.3f} to {high:.3f}")

    rows = {
        "stiffness": left_out(STIFFNESS),
        "and clamp": left_out(BOTH),
    }
    print("\nEach speed predicted from the others: relative errors, modes 1 to 4")
    for name, some in rows.items():
        for r in rpm:
            errors = [row[3] for row in some if abs(row[0] - r) < 1e-6]
            print(f"  {name:12} {r:4.0f} rpm  " + "  ".join(f"{e:+.1%}" for e in errors))
    common.write_csv(
        out / "left_out.csv", ("fitted", "rpm", "mode", "measured_hz", "relative_error"),
        ((name, *row) for name, some in rows.items() for row in some),
    )  # fmt: skip

    print("\nSix parameters from 56 frequencies")
    print("\n".join(costs(quick)))
    draw(out / "fit_experiment.png", fits["and clamp"], rpm, hertz, springs)
    print(f"\nfigure and table are in {out}")
    return out


def draw(
    path: Path, found: jb.results.Fit, rpm: np.ndarray, hertz: np.ndarray,
    springs: dict[str, list[tuple[float, float]]],
) -> None:  # fmt: skip
    """Campbell diagram with intervals, residuals, and what a spring at the root makes of them."""
    figure, (left, right, last) = plt.subplots(1, 3, figsize=(17, 5), layout="constrained")
    fine = np.linspace(0.0, 800.0, 41)
    value, deviation = found.predict(lambda **p: frequencies_at(fine * np.pi / 30, **p))
    at, _ = found.predict(lambda **p: frequencies_at(rpm * np.pi / 30, **p))
    for k, colour in enumerate(COLOURS):
        low, high = (value[:, k] + sign * found.width() * deviation[:, k] for sign in (-1, 1))
        left.fill_between(fine, low, high, color=colour, alpha=0.25, lw=0)
        left.plot(fine, value[:, k], color=colour, label=f"flap {k + 1}")
        left.plot(rpm, hertz[:, k], "o", color=colour, mec="k")
        right.plot(
            rpm, 100 * (at[:, k] / hertz[:, k] - 1), "o-", color=colour, label=f"flap {k + 1}"
        )
    common.per_turn(left, fine, (1, 2, 4, 8), at=790, unit=1 / 60, style=":")
    left.set(
        yscale="log", ylim=(3, 300), xlim=(0, 800), xlabel="rotor speed (rpm)",
        ylabel="frequency (Hz)", title="measured (dots), fitted with 95 % interval",
    )  # fmt: skip
    right.axhline(0, color="k", lw=1)
    right.set(
        xlabel="rotor speed (rpm)", ylabel="fitted over measured - 1 (%)",
        title="what a uniform Euler-Bernoulli beam leaves over",
    )  # fmt: skip
    for (name, some), colour in zip(springs.items(), (BLUE, VERMILION), strict=True):
        last.plot(*np.array(some).T, "o-", color=colour, label=f"{name} fitted")
    last.axhline(1, color="k", lw=1, label="root that does not yield")
    last.set(
        xscale="log", yscale="log", xlabel="spring of the root in flap (N m/rad)",
        ylabel="sum of squares over that of a rigid root", title="what a root that yields adds",
    )  # fmt: skip
    for ax in (left, right, last):
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    common.save_figure(figure, path, dpi=110)


if __name__ == "__main__":
    common.run(
        main, __doc__, "fewer repetitions of timings",
        "the figure and the table", keeps=False,
    )  # fmt: skip
