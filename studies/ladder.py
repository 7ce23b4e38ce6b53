"""No more model than a scene needs: what the ladder chooses, whether it is right, what it saves.

Random scenes (spin-ups and steady rotation, slow and fast, slender and stout, with and without hub
and tip mass, deflections from a ten thousandth to three quarters of the length) are given to
`jb.choose_model` at three tolerances, and its choice is held against 64 geometrically exact
elements. Then a sweep of spin-ups goes through `jb.ladder_sweep`, and through the richest rung.

    python studies/ladder.py [--quick] [--out FOLDER]
"""

import functools
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import common
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jaxbeam as jb

TOLERANCES = (1e-2, 1e-3, 1e-4)
SHARES = np.linspace(0.0, 1.0, 121)  # of a run, where it is looked at
TRUTH = 64  # elements
KINDS: dict[str, Callable[..., jb.ladder.Question]] = {
    "peak": jb.ladder.PeakDeflection,
    "history": jb.ladder.DeflectionHistory,
    "strain": functools.partial(jb.ladder.RootStrain, max_steps=200_000),  # stretch rings fast
}


class Scene(NamedTuple):
    """Speed over the first frequency of the beam at rest, duration over its period, hub radius over
    its length, tip mass over its mass."""

    speed: Any
    duration: Any
    hub: Any
    tip: Any
    slenderness: Any


def rotor_of(scene: Scene) -> jb.Rotor:
    return jb.Rotor(jb.Beam.from_slenderness(scene.slenderness), scene.hub, scene.tip)


def spin_up(kind: Callable[..., jb.ladder.Question], scene: Scene, rest: Any) -> jb.ladder.Question:
    """Up to three fifths of a period after the spin-up; `rest` is the frequency at rest, rad/s."""
    period = 2 * np.pi / rest
    duration = scene.duration * period
    motion = jb.SmoothSpinUp(scene.speed * rest, duration)
    return kind(motion, SHARES * (duration + 0.6 * period))


def at_rest(tip: Any) -> Any:
    """First frequency at rest by Rayleigh's quotient with Dunkerley's tip mass, within 1 %: the
    scale of a scene need be no better."""
    return 3.5160 / jnp.sqrt(1 + 4.12 * tip)


def looked_at(scenes: Scene) -> jb.Table:
    """Deflection over length and steady strain of many scenes, by linear theory."""

    def look(**parameters: Any) -> dict[str, Any]:
        scene = Scene(**parameters)
        rotor = rotor_of(scene)
        question = spin_up(jb.ladder.PeakDeflection, scene, at_rest(scene.tip))
        found = question.answer(jb.Hybrid(0, 3, 0), rotor, jnp.asarray(1e-4), jnp.asarray(0.01))
        strain = rotor.steady_strain(question.speed())
        return {"size": found.size, "strain": strain, "status": found.status}

    return jb.sweep(look, jb.points(**scenes._asdict()), chunk=32, progress=False)


class Draw:
    """Random numbers of scenes, and the choice among these scenes."""

    def __init__(self, seed: int, count: int, more: int) -> None:
        """`count` are wanted; four times as many, and some more, are drawn."""
        self.rng, self.count, self.n = np.random.default_rng(seed), count, 4 * count + more

    def uniform(self, low: float, high: float) -> np.ndarray:
        return self.rng.uniform(low, high, self.n)

    def log(self, low: float, high: float) -> np.ndarray:
        return np.exp(self.uniform(np.log(low), np.log(high)))

    def some(self, values: np.ndarray) -> np.ndarray:
        """Of a third, zero."""
        return np.where(self.uniform(0, 1) < 1 / 3, 0.0, values)

    def spread(self, size: np.ndarray, usable: np.ndarray, low: float, high: float) -> np.ndarray:
        """Which of them are usable and have sizes evenly between two, on a logarithmic scale."""
        left, chosen = np.flatnonzero(usable & (size > low) & (size < high)), []
        for wanted in self.rng.permutation(np.geomspace(low, high, self.count)):
            nearest = int(np.argmin(np.abs(np.log(size[left] / wanted))))
            chosen.append(left[nearest])
            left = np.delete(left, nearest)
        return np.array(chosen)


def drawn(count: int, seed: int, **fixed: float) -> tuple[Scene, np.ndarray]:
    """Scenes whose deflections are spread evenly over four decades, to three quarters of the
    length, with steady strains up to 1 %; and these deflections over the length."""
    draw = Draw(seed, count, 1000)
    scenes = Scene(
        speed=draw.log(0.01, 4.0), duration=draw.log(0.1, 8.0), hub=draw.some(draw.uniform(0, 3)),
        tip=draw.some(draw.log(0.05, 2.0)), slenderness=draw.log(50.0, 700.0),
    )  # fmt: skip
    scenes = scenes._replace(**{name: np.full(draw.n, value) for name, value in fixed.items()})
    table = looked_at(scenes)
    usable = (table["status"] == 0) & (table["strain"] < 1e-2)
    chosen = draw.spread(table["size"], usable, 1e-4, 0.75)
    return Scene(*(column[chosen] for column in scenes)), table["size"][chosen]


class Outcome(NamedTuple):
    """Of one choice. `above`: how many rungs above the cheapest that would have done; `beyond`:
    above the cheapest that would have done and not by accident, which is to say that the next finer
    one of its theory does, too."""

    tolerance: float
    kind: str
    scene: Any  # a named tuple
    size: float
    rung: str
    estimate: float
    error: float
    met: bool
    above: int
    beyond: int
    seconds: float
    richest_seconds: float


class Asked(NamedTuple):
    kind: str
    scene: Any
    question: jb.ladder.Question
    rotor: jb.Rotor
    truth: jb.ladder.Answer
    richest: jb.models.AbstractModel


def asked(kind: str, scene: Scene, size: float) -> Asked:
    rotor = rotor_of(scene)
    if kind == "frequencies":
        question: jb.ladder.Question = jb.ladder.ModalFrequencies(
            scene.speed * float(at_rest(scene.tip)), jb.labels(in_plane=2)
        )
    else:
        question = spin_up(KINDS[kind], scene, float(at_rest(scene.tip)))
    accuracy = 1e-6 if kind == "strain" else 1e-7
    return answered(kind, scene, question, rotor, jb.PlanarRod(TRUTH), accuracy, size)


def answered(
    kind: str, scene: Any, question: jb.ladder.Question, rotor: jb.Rotor,
    richest: jb.models.AbstractModel, accuracy: float, size: float,
) -> Asked:  # fmt: skip
    """With the truth by the richest rung."""
    truth = jb.ladder.evaluate(richest, rotor, question, accuracy, size, throw=False)
    if int(truth.status) != jb.Status.OK:
        raise RuntimeError(
            f"no truth for {kind} of {scene}: {jb.Status(int(truth.status)).message}"
        )
    return Asked(kind, scene, question, rotor, truth, richest)


def judged(each: Asked, tolerance: float) -> Outcome:
    began = time.perf_counter()
    choice = jb.choose_model(each.rotor, each.question, tolerance, throw=False)
    if choice.rung is None:
        raise RuntimeError(str(choice))
    seconds = time.perf_counter() - began
    size = float(np.clip(choice.indicators.size, 1e-9, 1.0))
    rungs = [e.rung.model for e in choice.evidence]

    @functools.cache
    def error(model: Any) -> float:
        accuracy = 0.05 * tolerance  # as in the ladder
        found = jb.ladder.evaluate(model, each.rotor, each.question, accuracy, size, throw=False)
        return float(found.distance(each.truth))  # infinite where the model fails

    def settled(i: int) -> bool:
        """Whether the next finer rung of the theory, if there is one, is good enough as well."""
        same = [m for m in rungs[i + 1 :] if _theory(m) == _theory(rungs[i])]
        return not same or error(same[0]) <= tolerance

    began = time.perf_counter()
    error(each.richest)
    richest_seconds = time.perf_counter() - began
    place = rungs.index(choice.rung.model)
    enough = [i for i in range(place) if error(rungs[i]) <= tolerance]
    firm = [i for i in enough if settled(i)]
    above, beyond = (place - (some[0] if some else place) for some in (enough, firm))
    return Outcome(
        tolerance, each.kind, each.scene, float(choice.indicators.size), choice.rung.name,
        choice.estimate, error(choice.rung.model), choice.met, above, beyond, seconds,
        richest_seconds,
    )  # fmt: skip


def _theory(model: jb.models.AbstractModel) -> tuple[type, bool]:
    return type(model), jb.models.Direction.AXIAL in model.directions


def choices(quick: bool, out: Path, ax: Any) -> None:
    """Part 1: random scenes, one by one."""
    counts = {"peak": 40}  # each kind of question has to be compiled
    if not quick:
        counts = {"peak": 100, "history": 50, "strain": 20, "frequencies": 50}
    scenes = [
        (kind, Scene(*(float(x) for x in one)), float(size))
        for seed, (kind, n) in enumerate(counts.items())
        for scenes, sizes in [drawn(n, seed)]
        for *one, size in zip(*scenes, sizes, strict=True)
    ]
    tolerances = TOLERANCES[:2] if quick else TOLERANCES
    with ThreadPoolExecutor(2) as threads:
        began = time.perf_counter()
        known = list(threads.map(lambda each: asked(*each), scenes))
        print(f"{len(known)} scenes drawn and answered by {TRUTH} elements, "
              f"{time.perf_counter() - began:.0f} s", flush=True)  # fmt: skip
        outcomes: list[Outcome] = []
        for tolerance in tolerances:
            began = time.perf_counter()
            new = list(threads.map(lambda each, t=tolerance: judged(each, t), known))
            outcomes += new
            report(tolerance, new, TRUTH, time.perf_counter() - began)
    save(out / "choices.csv", outcomes)
    for tolerance, marker in zip(tolerances, "osv", strict=False):
        some = [o for o in outcomes if o.tolerance == tolerance]
        ax.plot(
            [o.estimate / tolerance for o in some], [o.error / tolerance for o in some], marker,
            ms=4, alpha=0.6, label=f"tolerance {tolerance:g}",
        )  # fmt: skip
    _error_against_estimate(ax, f"chosen one by one: {len(known)} scenes")


def report(tolerance: float, new: Sequence[Outcome], elements: int, seconds: float) -> None:
    """Print how many choices were right, and of which rung."""
    good = np.array([o.error <= tolerance for o in new])
    met = np.array([o.met for o in new])
    worst = max((o.error for o in new if o.met), default=0.0) / tolerance
    near = np.array([[o.above, o.beyond] for o in new]) <= 1
    print(
        f"tolerance {tolerance:g}: {good.mean():.1%} within it ({met.sum()} of {met.size} "
        f"said to be, {good[met].mean():.1%} of these are, worst {worst:.2f} of it); "
        f"{near[:, 0].mean():.1%} at most one rung above the cheapest that does, "
        f"{near[:, 1].mean():.1%} above the cheapest that does not by accident; medians: "
        f"{1e3 * np.median([o.seconds for o in new]):.0f} ms a choice, "
        f"{1e3 * np.median([o.richest_seconds for o in new]):.0f} ms a run of {elements} "
        f"elements; {seconds:.0f} s in all", flush=True,
    )  # fmt: skip
    for rung, many in Counter(o.rung for o in new).most_common():
        print(f"    {many:4} {rung}")
    dishonest = [o for o in new if o.error > o.estimate]
    print(f"    error above estimate: {len(dishonest)}", flush=True)
    for o in dishonest:
        print(f"        {o.rung}: {o.error:.3g} for {o.estimate:.3g}, deflection {o.size:.2g}")


def _error_against_estimate(ax: Any, title: str) -> None:
    line = np.geomspace(1e-4, 10, 2)
    ax.plot(line, line, "--", color="k", lw=1, label="error = estimate")
    ax.axhline(1, color="0.5", lw=1)
    ax.set(
        xscale="log", yscale="log", xlim=(1e-3, 20), ylim=(1e-4, 20), title=title,
        xlabel="estimate / tolerance (-)", ylabel="true error / tolerance (-)",
    )  # fmt: skip
    ax.legend(fontsize=8)


HUB, TIP, SLENDERNESS = 0.5, 0.2, 200.0  # of the rotor of the sweep


def situation(speed: Any, duration: Any) -> tuple[jb.Rotor, jb.ladder.Question]:
    """One rotor, spun up."""
    scene = Scene(speed, duration, HUB, TIP, SLENDERNESS)
    return rotor_of(scene), spin_up(jb.ladder.PeakDeflection, scene, at_rest(scene.tip))


def sweeps(quick: bool, out: Path, axes: Sequence[Any]) -> None:
    """Part 2: one rotor through many spin-ups."""
    n, tolerance = (64 if quick else 1000), 1e-3
    scenes, sizes = drawn(n, seed=7, hub=HUB, tip=TIP, slenderness=SLENDERNESS)
    cases = jb.points(speed=scenes.speed, duration=scenes.duration)
    times = []
    for _ in range(1 if quick else 2):
        began = time.perf_counter()
        table = jb.ladder_sweep(situation, cases, tolerance)
        times.append(time.perf_counter() - began)
    used = Counter(table["rung"].tolist())
    finest = max((int(r.split()[0]) for r in used if "element" in r), default=TRUTH)

    def everywhere(
        model: jb.models.AbstractModel, accuracy: float, runs: int = 1 if quick else 2
    ) -> tuple[jb.Table, list[float]]:
        """All cases by one model; seconds with compilation and without."""

        def one(size: Any, accuracy: Any, **parameters: Any) -> dict[str, Any]:
            rotor, question = situation(**parameters)
            found = question.answer(model, rotor, accuracy, size)
            return {"peak": found.value[0], "deflection": found.size, "status": found.status}

        columns = {**cases.columns, "size": sizes, "accuracy": np.full(n, accuracy)}
        spent = []
        for _ in range(runs):
            began = time.perf_counter()
            table = jb.sweep(one, jb.points(**columns), chunk=32, progress=False)
            spent.append(time.perf_counter() - began)
        return table, spent

    accuracy = 0.05 * tolerance  # as in the ladder
    models: list[jb.models.AbstractModel] = [jb.PlanarRod(TRUTH)]
    if not quick:
        models = [jb.Hybrid(0, 4, 0), *(jb.PlanarRod(k) for k in sorted({finest, TRUTH}))]
    tables, spent = zip(*(everywhere(model, accuracy) for model in models), strict=True)
    truth = tables[-1] if quick else everywhere(jb.PlanarRod(32), 1e-7, runs=1)[0]
    error = np.abs(table["partial"][:, 0] / truth["peak"] - 1)
    said = table["status"] == 0
    print(f"sweep of {n} spin-ups, tolerance {tolerance:g}")
    for rung, many in used.most_common():
        print(f"    {many:4} {rung}")
    print(
        f"  {np.mean(error <= tolerance):.1%} within it, {said.sum()} said to be, worst of these "
        f"{error[said].max(initial=0.0) / tolerance:.2f} of it; error above estimate: "
        f"{np.sum(error > table['estimate'])}"
    )
    expected = {
        rung.model: (rung.name, rung.cost) for rung in jb.ladder.rungs(*situation(1.0, 1.0))
    }
    print(
        f"  {'ladder':24} {times[-1]:6.1f} s, {times[0]:6.1f} s with compilation; over the ladder:"
    )
    for model, times_of in zip(models, spent, strict=True):
        cold, warm = times_of[0], times_of[-1]
        name, cost = expected[model]
        print(
            f"  {name + ' everywhere':24} {warm:6.1f} s, {cold:6.1f} s with compilation; "
            f"{warm / times[-1]:.1f}, {cold / times[0]:.1f}; cost over the first "
            f"{warm / spent[0][-1]:.1f}, expected {cost / expected[models[0]][1]:.1f}"
        )
    table.to_csv(out / "sweep.csv")

    ladder = [rung.name for rung in jb.ladder.rungs(*situation(1.0, 1.0))]
    order = [name for name in ladder if name in used]
    colours = plt.get_cmap("viridis")(np.linspace(0, 0.95, len(order)))
    size = truth["deflection"]
    for name, colour in zip(order, colours, strict=True):
        at = table["rung"] == name
        axes[0].plot(cases.columns["speed"][at], size[at], ".", color=colour, label=name)
        axes[1].plot(table["estimate"][at] / tolerance, error[at] / tolerance, ".", color=colour,
                     label=name)  # fmt: skip
    axes[0].set(
        xscale="log", yscale="log", xlabel="final speed / first frequency at rest (-)",
        ylabel="largest deflection of the tip / length (-)",
        title=f"rung chosen, tolerance {tolerance:g}, {n} spin-ups",
    )  # fmt: skip
    axes[0].legend(fontsize=8, markerscale=2)
    _error_against_estimate(axes[1], "the same sweep: true error beside the estimate")


def save(path: Path, outcomes: Sequence[Outcome]) -> None:
    plain = [name for name in Outcome._fields if name != "scene"]
    parts = type(outcomes[0].scene)._fields
    rows = ([*(getattr(o, name) for name in plain), *o.scene] for o in outcomes)
    common.write_csv(path, (*plain, *parts), rows)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the figure and the tables."""
    began = time.perf_counter()
    out = common.folder(out, "ladder")
    figure, axes = plt.subplots(1, 3, figsize=(17, 5.2), layout="constrained")
    sweeps(quick, out, axes[:2])
    choices(quick, out, axes[2])
    for ax in axes:
        ax.grid(alpha=0.3)
    common.save_figure(figure, out / "ladder.png", dpi=110)
    print()
    return common.finish(began, "figure and tables are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer scenes", "the figure and the tables", keeps=False)
