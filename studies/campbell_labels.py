"""Whether the labels of Campbell diagrams follow modes of blades in which all is coupled.

Blades are drawn at random: tapered, twisted, swept and bent, of full sections with every coupling
and with centres of mass off the axis. Of each, the six lowest modes at rest are looked at over 20
speeds, up to one and a half times the first frequency. Four ways to connect them:

- labels, which `campbell` gives to modes of one speed without those of any other;
- continuation: from speed to speed to the mode that is most alike (by the modal assurance
  criterion, MAC, with the mass matrix), in steps a tenth or a hundredth as long wherever a mode is
  alike by less than 0.98;
- `Campbell.branches`, by the order of frequencies at each of the 20 speeds alone;
- plain tracking: continuation over the 20 speeds alone.

In a veering two branches come near and part, and their modes exchange their motion. Continuation
stays on a branch unless the gap is narrower than a hundredth of a step; a label goes with the
motion, from one branch to the other, in the middle of the veering. So labels that part from
continuation are not wrong, but mean something else; where `branches` or plain tracking do they are
wrong.

    python studies/campbell_labels.py [--quick] [--out FOLDER]
"""

import time
from pathlib import Path
from typing import Any, NamedTuple

import common
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import BLUE, GREEN, VERMILION

import jaxbeam as jb
from jaxbeam.blades import Blade

MODEL = jb.SpatialRod(6)
COUNT, MORE = 6, 4  # modes that are followed, and others beside which they may move
SPEEDS, SPLIT, ALIKE, SAME = 20, 10, 0.98, 1e-6
LENGTH = 3.0
SIZE = np.sqrt([1e6, 2e5, 2e5, 3e2, 4e2, 6e2])  # square roots of stiffnesses of sections
BLADES, FEW = 1000, 10
OTHERS = "labels", "branches", "plain tracking"


class Seen(NamedTuple):
    """Modes at speeds, as rows: frequencies, shapes of unit modal mass, labels."""

    frequency: np.ndarray
    shape: np.ndarray
    label: np.ndarray


def drawn(rng: np.random.Generator) -> Blade:
    """A blade at random."""
    stiffness, masses, taper = [], [], rng.uniform(0.3, 1.0)
    for share in (1.0, taper):
        a = rng.normal(size=(6, 6))
        stiffness.append(share**2 * SIZE[:, None] * (a @ a.T / 6 + 2 * np.eye(6)) * SIZE)
        mass, arm = share, np.cross([0.0, *(0.05 * rng.normal(size=2))], np.eye(3)).T
        about = share**2 * np.diag([0.02, 0.008, 0.012]) - mass * arm @ arm
        masses.append(np.block([[mass * np.eye(3), -mass * arm], [mass * arm, about]]))
    along = np.linspace(0, 1, 4)
    sweep, bend = rng.normal(size=2) * 0.1
    axis = LENGTH * np.stack([along, sweep * along**2, bend * along**2], 1)
    return Blade([0, 1], stiffness, masses, axis, rng.uniform(0, 0.6) * (1 - along))


@jax.jit
def modes_at(rotor: jb.Rotor, root: Any, speeds: Any) -> tuple[Any, ...]:
    """Of the lowest modes; `root` is a factor of the mass matrix."""

    def one(speed: Any) -> tuple[Any, ...]:
        found = jb.modes(MODEL, rotor, speed, COUNT + MORE, throw=False)
        shape = found.shape @ root
        size = jnp.sqrt(jnp.sum(jnp.abs(shape) ** 2, 1))
        label = 100 * found.direction + found.number
        return found.frequency, shape / size[:, None], label, found.status

    return jax.lax.map(one, speeds)


def seen(rotor: jb.Rotor, root: Any, speeds: np.ndarray) -> Seen:
    """Modes at speeds; raises `RuntimeError` where there are none."""
    chunks = np.array_split(speeds, max(-(-len(speeds) // SPEEDS), 1))
    parts = []
    for chunk in chunks:  # all of one size, for one program
        padded = np.concatenate([chunk, np.repeat(chunk[-1:], SPEEDS - len(chunk))])
        *found, status = modes_at(rotor, root, padded)
        if np.any(status):
            raise RuntimeError(f"no modes: {jb.Status(int(np.max(status))).name}")
        parts.append([np.asarray(part)[: len(chunk)] for part in found])
    return Seen(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def next_of(places: np.ndarray, before: np.ndarray, here: np.ndarray) -> tuple[np.ndarray, float]:
    """Which of the modes here is most alike to those at `places` before, each to another; and how
    much that is at least."""
    alike = np.abs(before[places].conj() @ here.T) ** 2
    out, left = np.zeros(len(places), int), alike.copy()
    for _ in places:
        row, column = np.unravel_index(np.argmax(left), left.shape)
        out[row] = column
        left[row], left[:, column] = -1, -1
    return out, float(alike[np.arange(len(places)), out].min())


def followed(
    rotor: jb.Rotor, root: Any, speeds: np.ndarray, modes: Seen, places: np.ndarray, depth: int
) -> np.ndarray:
    """Places of the modes that are at `places` of the first speed at all others, by continuation;
    steps may be divided so many times more."""
    out = [places]
    for i in range(len(speeds) - 1):
        new, least = next_of(out[-1], modes.shape[i], modes.shape[i + 1])
        if least < ALIKE and depth:
            closer = np.linspace(speeds[i], speeds[i + 1], SPLIT + 1)
            within = followed(rotor, root, closer, seen(rotor, root, closer), out[-1], depth - 1)
            new = within[-1]
        out.append(new)
    return np.stack(out)


def compared(rotor: jb.Rotor) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Speeds, and frequencies of modes by the three ways, of one rotor."""
    at_rest = MODEL.suited(rotor).linearise(rotor, 0.0)
    root = jnp.linalg.cholesky(at_rest.mass)
    first = seen(rotor, root, np.zeros(1)).frequency[0, 0]
    speeds = np.linspace(0.0, 1.5 * first, SPEEDS)
    modes, places = seen(rotor, root, speeds), np.arange(COUNT)
    every = np.arange(SPEEDS)[:, None]
    fine, plain = (followed(rotor, root, speeds, modes, places, depth) for depth in (2, 0))
    is_own = modes.label[:, None] == modes.label[0, :COUNT, None]
    labelled = np.where(is_own.any(2), np.argmax(is_own, 2), -1)
    none = np.concatenate([modes.frequency, np.full((SPEEDS, 1), np.nan)], 1)
    ways = {"continuation": fine, "labels": labelled, "plain tracking": plain}
    found = {name: none[every, place] for name, place in ways.items()}
    names = [jb.models.Label(jb.models.Direction(n // 100), int(n % 100)) for n in modes.label[0]]
    diagram = jb.campbell(MODEL, rotor, speeds, names[:COUNT])
    return speeds, found | {"branches": diagram.branches()["frequency"]}


def main(quick: bool = False, out: Path | None = None, blades: int = BLADES) -> Path:
    """Run all of it; returns the folder that holds the figure and the table."""
    began = time.perf_counter()
    out = common.folder(out, "campbell_labels")
    rows, example, failed = [], None, 0
    for number in range(FEW if quick else blades):
        rotor = jb.Rotor(drawn(np.random.default_rng(number)), 0.3)
        try:
            speeds, found = compared(rotor)
        except RuntimeError as error:
            print(f"  blade {number}: {error}")
            failed += 1
            continue
        exact = found["continuation"]
        parts = {name: ~(np.abs(found[name] - exact) <= SAME * exact) for name in OTHERS}
        turns = np.abs(np.diff(parts["labels"].astype(int), axis=0)).sum(0)
        rows += [
            (number, mode + 1, *(int(part[:, mode].sum()) for part in parts.values()), turns[mode])
            for mode in range(COUNT)
        ]
        if example is None or np.any(parts["labels"]) > np.any(example[2]["labels"]):
            example = speeds, found, parts
    table = np.array(rows)
    header = ("blade", "mode", "speeds_at_which_the_label_parts", "and_the_branch",
              "and_plain_tracking", "turns_of_the_label")  # fmt: skip
    common.write_csv(out / "campbell_labels.csv", header, rows)
    count = len(table) // COUNT
    print(f"{count} blades; {failed} more have no steady state up to the last speed")
    for name, column in zip(OTHERS, (2, 3, 4), strict=True):
        part = table[:, column].reshape(count, COUNT)
        print(
            f"  {name} part from continuation at {part.sum() / (part.size * SPEEDS):.2%} of points,"
            f" {np.mean(part > 0):.1%} of modes, {np.mean(part.any(1)):.1%} of blades"
        )
    turns = table[:, 5]
    print(f"  labels go to another branch {turns.sum()} times, and {np.sum(turns > 1)} of "
          f"{turns.size} more than once")  # fmt: skip
    draw(out / "campbell_labels.png", table.reshape(count, COUNT, 6), example)
    return common.finish(began, "figure and table are", out)


def draw(path: Path, table: np.ndarray, example: Any) -> None:
    """A blade whose labels part, and how often which mode does."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    speeds, found, parts = example
    lines = left.plot(speeds, found["continuation"], color=BLUE, lw=1.2)
    lines[0].set_label("continuation")
    for name, mark, colour in (("labels", "o", VERMILION), ("plain tracking", "x", GREEN)):
        at = np.where(parts[name], found[name], np.nan)
        marks = left.plot(speeds, at, mark, color=colour, ms=6 if mark == "o" else 4, mfc="none")
        marks[0].set_label(f"{name}, where these part from it")
    left.set(xlabel="speed (rad/s)", ylabel="frequency (rad/s)", title="one blade")
    left.set_ylim(0, 1.35 * np.max(found["continuation"]))
    left.legend(loc="upper left", fontsize=8)
    modes, width = np.arange(1, COUNT + 1), 0.27
    for side, name, colour in zip((-1, 0, 1), OTHERS, (VERMILION, BLUE, GREEN), strict=True):
        share = 100 * np.mean(table[:, :, side + 3] > 0, 0)
        right.bar(modes + side * width, share, width, color=colour,
                  label=f"{name}: {np.mean(share):.1f} % of modes")  # fmt: skip
    right.set(xlabel="mode at rest", ylabel="blades in which it parts (%)",
              title=f"of {len(table)} blades")  # fmt: skip
    right.legend(fontsize=8)
    for ax in (left, right):
        ax.grid(color="0.92")
        ax.set_axisbelow(True)
    common.save_figure(figure, path, dpi=110)


if __name__ == "__main__":
    common.run(main, __doc__, "10 blades in place of 1,000", "the figure and the table")
