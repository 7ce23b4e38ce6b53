"""What a sweep costs at scale: cases per second and memory over cases, cores, workers, folders.

Frequencies of 1e4 to 1e6 cases, in memory and into a folder; frequencies, spin-ups, Floquet
multipliers and fits on one core, on all, and by workers of an executor, one and one for each core.
Each is measured in a process of its own, after compilation; results of the same sweep are compared
to the last bit.

    python studies/scale.py [--quick] [--out FOLDER]
"""

import hashlib
import json
import multiprocessing
import os
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import common
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import ALUMINIUM

import jaxbeam as jb

FIRST = jb.labels(in_plane=1)
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def frequencies(tip_mass: Any, hub_radius: Any) -> Any:
    rotor = jb.Rotor(jb.Beam.from_section(**ALUMINIUM), hub_radius, tip_mass)
    found = jb.modes(jb.Hybrid(10, 16, 0), rotor, 10.0, 3, throw=False)
    return {"frequency": found.frequency, "status": found.status}


def spin_up(tip_mass: Any, hub_radius: Any) -> Any:
    motion, times = jb.SmoothSpinUp(4.0, duration=15.0), jnp.linspace(0.0, 20.0, 201)
    rotor = jb.Rotor(jb.Beam.from_section(**ALUMINIUM), hub_radius, tip_mass)
    run = jb.simulate(jb.PlanarRod(4), rotor, motion, times, throw=False)
    return {"peak": run.peak()[0], "status": run.status}


def floquet(tip_mass: Any, hub_radius: Any) -> Any:
    motion = jb.motions.ModulatedSpeed(4.0, depth=0.5, frequency=8.0)
    rotor = jb.Rotor(jb.Beam.from_section(**ALUMINIUM), hub_radius, tip_mass)
    found = jb.floquet(jb.Hybrid(0, 3, 0), rotor, motion, throw=False)
    return {"growth": found.growth_rate, "status": found.status}


def fit(tip_mass: Any, hub_radius: Any) -> Any:
    """Stiffness from the first frequency, seen at three speeds."""

    def experiment(stiffness: Any) -> jb.FrequencyData:
        beam = jb.Beam(8.0, 0.2, 5e6, stiffness, 600.0)
        rotor = jb.Rotor(beam, hub_radius, tip_mass)
        seen = [[2.9], [3.8], [5.5]]
        return jb.FrequencyData(jb.Hybrid(0, 4, 0), rotor, [0.0, 5.0, 10.0], seen, 0.1, FIRST)

    found = jb.fit(experiment, {"stiffness": jb.FreeParameter(500.0)}, throw=False)
    return {"stiffness": found.parameters["stiffness"], "status": found.status}


class Kind(NamedTuple):
    function: Any
    chunk: int
    cases: int
    quick: int  # cases then; none where it is left out


KINDS = {
    "frequencies": Kind(frequencies, 4096, 1_000_000, 20_000),
    "spin-ups": Kind(spin_up, 32, 2_048, 0),
    "Floquet multipliers": Kind(floquet, 250, 20_000, 0),
    "fits": Kind(fit, 125, 8_000, 0),
}


def grid(n: int) -> jb.results.Cases:
    few = 2 ** int(np.log2(n) / 2)
    while n % few:
        few -= 1
    return jb.grid(tip_mass=np.linspace(0.0, 0.5, n // few), hub_radius=np.linspace(0.0, 2.0, few))


def peak_memory() -> float:
    """Of this process, in MiB. On Linux `ru_maxrss` begins at the peak of whoever started it."""
    status = Path("/proc/self/status")
    if status.exists():
        (line,) = (line for line in status.read_text().split("\n") if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 2**10
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20  # bytes on macOS


def measure(kind: str, n: int, cores: int, workers: int, folder: str | None) -> dict[str, Any]:
    """In this process: rate and peak memory, and a digest of all results."""
    if not workers and hasattr(os, "sched_setaffinity"):  # before threads start
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    function, chunk, _, _ = KINDS[kind]
    with ProcessPoolExecutor(workers or 1, multiprocessing.get_context("spawn")) as pool:
        how: Any = {"executor": pool} if workers else {"devices": cores * jax.devices()}
        how |= {"chunk": chunk, "progress": False}
        for _ in range(2 if workers else 1):  # so that every worker is there, and has compiled
            jb.sweep(function, grid(4 * chunk * max(cores, workers)), **how)
        start = time.perf_counter()
        table = jb.sweep(function, grid(n), folder=folder, **how)
        taken = time.perf_counter() - start
    memory = peak_memory()
    digest = hashlib.sha256()
    for name in sorted(table.values):
        digest.update(np.ascontiguousarray(table[name]).data)
    return {
        "what": kind, "cases": n, "cores": cores, "workers": workers,
        "folder": folder is not None, "rate": n / taken,
        "memory": memory, "ok": float(np.mean(table["status"] == jb.Status.OK)),
        "digest": digest.hexdigest(),
    }  # fmt: skip


def measured(kind: str, n: int, cores: int = 1, workers: int = 0, folder: bool = False) -> Any:
    """The same in a process of its own."""
    with tempfile.TemporaryDirectory() as place:
        asked = [kind, n, cores, workers, f"{place}/kept" if folder else None]
        command = [sys.executable, __file__, "--measure", json.dumps(asked)]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        raise RuntimeError(f"{kind}, {n} cases: the process failed")
    row = json.loads(done.stdout.splitlines()[-1])
    by = f"{workers} workers" if workers else f"{cores} cores  "
    where = "folder" if folder else "memory"
    print(
        f"{kind:20s} {n:8d} cases, {by}, {where}: {row['rate']:10.0f} /s, "
        f"{row['memory']:6.0f} MiB, {100 * row['ok']:.1f} % ok",
        flush=True,
    )
    return row


def draw(rows: list[dict[str, Any]], out: Path) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.8), layout="constrained")
    for folder, style in ((False, "o-"), (True, "s--")):
        some = [r for r in rows if r["series"] == "cases" and r["folder"] == folder]
        cases = [r["cases"] for r in some]
        name = "into a folder" if folder else "in memory"
        axes[0].semilogx(cases, [r["rate"] / 1e3 for r in some], style, label=name)
        axes[1].semilogx(cases, [r["memory"] for r in some], style, label=name)
    axes[0].set(xlabel="cases, of frequencies (-)", ylabel="rate (1000 cases per second)")
    axes[1].set(xlabel="cases, of frequencies (-)", ylabel="peak memory of the process (MiB)")
    for ax in axes[:2]:
        ax.set_ylim(0, 1.1 * ax.get_ylim()[1])
        ax.grid(alpha=0.3)
        ax.legend(loc="lower right")
    ways = [r for r in rows if r["series"] == "ways"]
    single = {r["what"]: r["rate"] for r in ways if (r["cores"], r["workers"]) == (1, 0)}
    kinds = list(single)
    at = np.arange(len(kinds))
    tried = sorted({(r["workers"], r["cores"]) for r in ways})
    for i, (workers, cores) in enumerate(tried):
        bars = [
            r["rate"] / single[r["what"]]
            for r in ways
            if (r["workers"], r["cores"]) == (workers, cores)
        ]
        many = workers or cores
        name = f"{many} {'worker' if workers else 'core'}{'s' if many > 1 else ''}"
        name += " of an executor" if workers else ", this process"
        width = 0.8 / len(tried)
        axes[2].bar(at + (i - (len(tried) - 1) / 2) * width, bars, width, label=name)
    axes[2].set_xticks(at, [kind.replace(" ", "\n") for kind in kinds])
    axes[2].set(ylabel="rate over that of one core (-)")
    axes[2].set_ylim(0, 1.3 * axes[2].get_ylim()[1])
    axes[2].legend(fontsize=8, loc="upper left")
    common.save_figure(figure, out / "scale.png", dpi=150)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the table and the figure."""
    began = time.perf_counter()
    out = common.folder(out, "scale")
    rows: list[dict[str, Any]] = []
    for n in (10_000, 40_000) if quick else (10_000, 100_000, 1_000_000):
        for folder in (False, True):
            row = measured("frequencies", n, folder=folder)
            rows.append({"series": "cases", **row})
    for kind, (_, _, many, few) in KINDS.items():
        cases = few if quick else many
        if not cases:
            continue
        for cores, workers in dict.fromkeys([(1, 0), (CORES, 0), (1, 1), (1, CORES)]):
            rows.append({"series": "ways", **measured(kind, cases, cores, workers)})
    by_way = {
        (r["cores"], r["workers"]): r["rate"] for r in rows
        if r["series"] == "ways" and r["what"] == "frequencies"
    }  # fmt: skip
    slower = by_way[CORES, 0] / by_way[1, CORES]
    print(f"frequencies take an executor {slower:.2f} times as long as {CORES} devices")
    digests: dict[Any, set[str]] = {}
    for row in rows:
        digests.setdefault((row["what"], row["cases"]), set()).add(row["digest"])
    same = sum(len(found) == 1 for found in digests.values())
    print(f"{same} of {len(digests)} sweeps have the same bits however they were run")
    for where in (False, True):
        rates = [r["rate"] for r in rows if r["series"] == "cases" and r["folder"] == where]
        name = "into a folder" if where else "in memory"
        ratio = rates[-1] / rates[0]
        print(f"rate of the largest sweep over that of the smallest, {name}: {ratio:.2f}")
    common.write_csv(out / "scale.csv", rows[0], (row.values() for row in rows))
    draw(rows, out)
    return common.finish(began, "table and figure are", out)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--measure"]:  # a process that this study started
        print(json.dumps(measure(*json.loads(sys.argv[2]))))
    else:
        common.run(main, __doc__, "fewer cases", "the table and the figure")
