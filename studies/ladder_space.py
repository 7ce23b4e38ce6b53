"""No more model than a scene in space needs: what the ladder chooses where the beam twists.

Random spin-ups about axes inclined up to a right angle, in gravity and under a force that rises at
the tip, across the plane, with and without hub and tip mass, slender and stout, soft and stiff in
flap and in torsion, deflections from a thousandth to half the length, are given to
`jb.choose_model`, and its choice is held against geometrically exact rods of a higher degree: for
the largest deflection in flap, for its course in time, and for frequencies at the speed reached.

    python studies/ladder_space.py [--quick] [--out FOLDER]
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import common
import equinox as eqx
import jax.numpy as jnp
import ladder
import numpy as np
from jaxtyping import Array

import jaxbeam as jb

TOLERANCES = (1e-2, 1e-3)
SHARES = np.linspace(0.0, 1.0, 61)  # of a run, where it is looked at
TRUTH = 16  # degree
LARGEST = 0.5  # deflection over length
FLAP = 2
LABELS = jb.labels(in_plane=1, flap=2)
KINDS: dict[str, Callable[..., jb.ladder.Question]] = {
    "peak": jb.ladder.PeakDeflection,
    "history": jb.ladder.DeflectionHistory,
}


class Scene(NamedTuple):
    """Speed over the first frequency in plane at rest, duration over its period, inclination of the
    axis of rotation to a3 (rad) and its azimuth from the beam, hub radius over the length, tip mass
    over that of the beam; gravity and tip force as deflections over the length that they would
    cause, roughly; stiffness in flap and in torsion over that in plane."""

    speed: Any
    duration: Any
    inclination: Any
    azimuth: Any
    hub: Any
    tip: Any
    gravity: Any
    force: Any
    slenderness: Any
    flap: Any
    torsion: Any


class Raised(eqx.Module):
    """A force in flap that rises smoothly, as the speed does."""

    largest: Array
    duration: Array

    def __call__(self, t: Any) -> Any:
        share = jnp.clip(t / self.duration, 0.0, 1.0)
        force = self.largest * share**3 * (10 - 15 * share + 6 * share**2)
        return jnp.stack([0 * force, 0 * force, force])


def situation(scene: Scene, kind: str = "peak") -> tuple[jb.Rotor, jb.ladder.Question]:
    """Rotor and question: the deflection in flap up to three fifths of a period after the spin-up,
    or frequencies of steady rotation."""
    beam = jb.Beam(
        1.0, 1.0, jnp.square(scene.slenderness), 1.0, scene.flap, torsional_stiffness=scene.torsion
    )
    rotor = jb.Rotor(beam, scene.hub, scene.tip)
    rest = ladder.at_rest(scene.tip)
    if kind == "frequencies":
        return rotor, jb.ladder.ModalFrequencies(scene.speed * rest, LABELS)
    period = 2 * np.pi / rest
    duration = scene.duration * period
    sin, cos = jnp.sin(scene.inclination), jnp.cos(scene.inclination)
    axis = jnp.stack([sin * jnp.cos(scene.azimuth), sin * jnp.sin(scene.azimuth), cos])
    motion = jb.SmoothSpinUp(scene.speed * rest, duration, axis)
    weight = 8 * scene.flap * scene.gravity / (1 + 8 / 3 * scene.tip)
    loads = jb.Loads(
        gravity=jnp.stack([0 * weight, 0 * weight, -weight]),
        tip_force=Raised(3 * scene.flap * scene.force, duration),
    )
    times = SHARES * (duration + 0.6 * period)
    return rotor, KINDS[kind](motion, times, FLAP, loads=loads, max_steps=100_000)


def drawn(count: int, seed: int) -> tuple[list[Scene], np.ndarray]:
    """Scenes whose deflections are spread evenly from a thousandth to half the length, by linear
    theory, with steady strains up to 1 %; and these deflections over the length."""
    draw = ladder.Draw(seed, count, 400)
    log, some = draw.log, draw.some
    scenes = Scene(
        speed=log(0.01, 3.0), duration=log(0.5, 5.0), inclination=draw.uniform(0, np.pi / 2),
        azimuth=draw.uniform(0, 2 * np.pi), hub=some(draw.uniform(0, 2)),
        tip=some(log(0.05, 1.0)), gravity=some(log(1e-4, 0.2)), force=log(5e-4, 1.0),
        slenderness=log(50.0, 500.0), flap=log(0.1, 2.0), torsion=log(0.1, 2.0),
    )  # fmt: skip

    def look(**parameters: Any) -> dict[str, Any]:
        rotor, question = situation(Scene(**parameters))
        found = question.answer(jb.Hybrid(0, 3, 3), rotor, jnp.asarray(1e-4), jnp.asarray(0.01))
        strain = rotor.steady_strain(question.speed())
        return {
            "size": found.size, "asked": found.value[0], "strain": strain, "status": found.status
        }  # fmt: skip

    table = jb.sweep(look, jb.points(**scenes._asdict()), chunk=32, progress=False)
    size = table["size"]
    # What is asked for must not be a small part of what there is.
    usable = (table["status"] == 0) & (table["strain"] < 1e-2) & (table["asked"] > 0.1 * size)
    chosen = draw.spread(size, usable, 1e-3, LARGEST)
    return [Scene(*(float(column[i]) for column in scenes)) for i in chosen], size[chosen]


def asked(kind: str, scene: Scene, size: float) -> ladder.Asked:
    rotor, question = situation(Scene(*map(jnp.asarray, scene)), kind)
    richest = jb.SpatialRod(TRUTH)
    return ladder.answered(kind, scene, question, rotor, richest, 1e-6, size)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the table."""
    began = time.perf_counter()
    out = common.folder(out, "ladder_space")
    counts = {"peak": 12} if quick else {"peak": 200, "history": 50, "frequencies": 50}
    scenes = [
        (kind, scene, float(size))
        for seed, (kind, count) in enumerate(counts.items(), start=5)
        for scene, size in zip(*drawn(count, seed), strict=True)
    ]
    known = []
    for each in scenes:
        try:
            known.append(asked(*each))
        except RuntimeError as error:  # half a turn within an element, or too many steps
            print(error, flush=True)
    print(
        f"{len(known)} of {len(scenes)} scenes drawn and answered by degree {TRUTH}, "
        f"{time.perf_counter() - began:.0f} s", flush=True,
    )  # fmt: skip
    outcomes: list[ladder.Outcome] = []
    for tolerance in TOLERANCES:
        for kind in counts:
            start = time.perf_counter()
            new = [ladder.judged(each, tolerance) for each in known if each.kind == kind]
            outcomes += new
            print(f"{kind}:")
            ladder.report(tolerance, new, TRUTH, time.perf_counter() - start)
    ladder.save(out / "choices.csv", outcomes)
    return common.finish(began, "table is", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer scenes", "the table")
