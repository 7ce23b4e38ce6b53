"""What a GPU is worth: modes, spin-ups and gradients a second on JAX's device, beside the CPU.

Batches of 2^8 to 2^17 random cases of the beam of B Ref. 21: the lowest three modes, the peak of a
spin-up, and the derivatives of the peaks by speed, stiffness and tip mass of each case, for a modal
model and for elements each; and the lowest five modes of the blade of the NREL 5-MW turbine, its
mass, its stiffness in flap and its speed varied. A CPU takes 32 cases at a time however many there
are: it is measured at 2^8, by one batch and by one on each core at once. A curve ends where a run
would take too long or memory ends, and its last row says so. All is compiled first, several
programs at a time; rates are of a run after that. Answers are held against those of the CPU for the
same cases.

    python studies/device.py [--quick] [--out FOLDER]
"""

import os
import re
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import common
import diffrax
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from blade import BEAM as BLADE
from blade import FASTEST, HUB, RPM, scaled
from common import ALUMINIUM

import jaxbeam as jb

BEAM = jb.Beam.from_section(**ALUMINIUM)
FEW = 2**8  # cases in a batch on a CPU
ROOM = 1024  # of steps, for reverse mode: some 550 are made
ENOUGH, PATIENCE, BRIEF = 280.0, 30.0, 2.0  # s: of all, of a run, and of one that is always made
FULL = 2**13  # cases from which no device is taken to have anything to spare
CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

Answers = tuple[jax.Array, jax.Array]  # (n, k) numbers, and the status of each case


class Curve(NamedTuple):
    """What is done with a batch, by what."""

    what: str
    model: str
    function: Callable[[jax.Array], Answers]
    cases: np.ndarray  # the first ones are those of a smaller batch
    sizes: tuple[int, ...]  # of batches on a device


class Row(NamedTuple):
    """One measurement."""

    what: str
    model: str
    device: str
    cases: int
    tracing_s: float = np.nan
    compilation_s: float = np.nan  # several at a time
    kernels: float = np.nan  # a run starts, were each loop of unknown length run through once
    program_MiB: float = np.nan  # of arguments, results and what lies between
    seconds: float = np.nan
    rate: float = np.nan  # cases a second
    device_peak_MiB: float = np.nan  # of the process so far, where the device tells
    difference: float = np.nan  # largest, from the CPU's, over the largest of the same quantity
    fine: float = np.nan  # share of cases with status OK
    note: str = ""


def modes(model: Any) -> Callable[[Any], Answers]:
    """Frequencies of the lowest three, of a beam of L = rho = EI = 1."""

    def one(case: Any) -> Answers:
        rotor, speed = common.rotating(case)
        found = jb.modes(model, rotor, speed, 3, throw=False)
        return found.frequency, found.status

    return jax.vmap(one)


def blade_modes(model: Any) -> Callable[[Any], Answers]:
    """Frequencies of the lowest five of a blade whose tables are multiplied by two factors."""

    def one(case: Any) -> Answers:
        mass, softer, speed = case
        factors = {"mass_per_length": mass, "flap_bending_stiffness": softer}
        rotor = jb.Rotor(scaled(BLADE, factors), HUB)
        found = jb.modes(model, rotor, FASTEST * RPM * speed, 5, throw=False)
        return found.frequency, found.status

    return jax.vmap(one)


def spin_ups(model: Any, room: int = 100_000) -> Callable[[Any], Answers]:
    """Peaks of the deflection of the tip, as in `ensembles.py`."""
    times, control = np.linspace(0.0, 20.0, 21), diffrax.PIDController(rtol=1e-4, atol=1e-4)

    def one(case: Any) -> Answers:
        speed, softer, tip_mass = case
        stiffness = BEAM.in_plane_bending_stiffness * softer
        beam = jb.Beam(
            BEAM.length, BEAM.mass_per_length, BEAM.axial_stiffness, stiffness, stiffness
        )
        run = jb.simulate(
            model, jb.Rotor(beam, 0.5, tip_mass), jb.SmoothSpinUp(speed, 15.0), times,
            stepsize_controller=control, max_steps=room, throw=False,
        )  # fmt: skip
        return run.peak()[0][None], run.status

    return jax.vmap(one)


def gradients(model: Any) -> Callable[[Any], Answers]:
    """Of the sum of the peaks by what each case has of its own."""
    peaks = spin_ups(model, ROOM)

    def total(cases: Any) -> Answers:
        found, status = peaks(cases)
        return jnp.sum(found), status

    return jax.grad(total, has_aux=True)


def curves(quick: bool) -> list[Curve]:
    """All that is measured."""
    sizes = (2**8, 2**11) if quick else (2**8, 2**11, 2**14, 2**17)
    most, draw = max(*sizes, CORES * FEW), np.random.default_rng(6)
    spans = ((1.0, 6.0), (0.8, 1.2), (0.0, 0.2))  # rad/s, -, kg
    turning = np.stack([draw.uniform(*span, most) for span in spans], 1)
    still = np.asarray(common.random_cases(most, seed=5))
    factors = draw.uniform([0.8, 0.8, 0.3], [1.2, 1.2, 1.0], (most, 3))
    few, elements = jb.Hybrid(0, 6, 0), jb.PlanarRod(8)
    out = [
        Curve("modes", "8 polynomials", modes(jb.Hybrid(0, 8, 0)), still, sizes),
        Curve("modes", "8 elements", modes(elements), still, sizes),
        Curve("spin-ups", "6 polynomials", spin_ups(few), turning, sizes),
        Curve("spin-ups", "8 elements", spin_ups(elements), turning, sizes),
        Curve("gradients", "6 polynomials", gradients(few), turning, sizes[1:]),
        # A case takes 0.6 MiB.
        Curve("modes", "blade, 12 + 12", blade_modes(jb.Hybrid(0, 12, 12)), factors, sizes[:3]),
        # It takes longest to compile and to run: one size, up to which all go at once.
        Curve("gradients", "8 elements", gradients(elements), turning, (2**13,)),
    ]
    return out[:5:2] if quick else out


def name_of(device: Any) -> str:
    return "CPU" if device.platform == "cpu" else device.device_kind


class Program(NamedTuple):
    """What is on its way to be measured."""

    curve: Curve
    device: Any
    size: int
    tracing: float
    compiled: Future[tuple[Any, float]]

    @property
    def row(self) -> Row:
        """What is known of it before it runs."""
        return Row(self.curve.what, self.curve.model, name_of(self.device), self.size, self.tracing)


def compiling(
    wanted: Sequence[tuple[Curve, Any, int]], pool: ThreadPoolExecutor
) -> Iterator[Program]:
    """Traced one after the other, since Python does that, and compiled side by side."""

    def compiled(lowered: Any) -> tuple[Any, float]:
        start = time.perf_counter()
        return lowered.compile(), time.perf_counter() - start

    for curve, device, size in wanted:
        start = time.perf_counter()
        cases = jax.device_put(curve.cases[:size], device)
        lowered = jax.jit(curve.function).lower(cases)
        taken = time.perf_counter() - start
        yield Program(curve, device, size, taken, pool.submit(compiled, lowered))


_LINE = re.compile(r"  (?:ROOT )?%\S+ = .*?[\])}] ([a-z][a-z-]*)\(")
_INNER = {
    "while": re.compile("body=(%[^ ,]+)"),
    "call": re.compile("to_apply=(%[^ ,]+)"),
    "conditional": re.compile(r"(?:branch_computations=\{|_computation=)(%[^}=]+)"),
}
_FREE = {"bitcast", "constant", "get-tuple-element", "parameter", "tuple"}


def kernels(text: str) -> int:
    """How many kernels, copies and calls of libraries a compiled program for a GPU starts, if each
    loop is run through once of which it does not say how often."""
    parts: dict[str, list[str]] = {}
    first = here = ""
    for line in text.splitlines():
        head = re.match(r"(ENTRY )?%(\S+) \(.*\{$", line)
        if head:
            here = head[2]
            parts[here] = []
            first = here if head[1] else first
        elif here:
            parts[here].append(line)

    def count(name: str) -> int:
        total = 0
        for line in parts[name]:
            found = _LINE.match(line)
            if not found or found[1] in _FREE or found[1].endswith("-done"):
                continue
            inner = _INNER[found[1]].findall(line) if found[1] in _INNER else []
            each = [count(n) for names in inner for n in re.findall("%([^ ,]+)", names)]
            known = re.search(r'known_trip_count":\{"n":"(\d+)"', line)
            total += (int(known[1]) if known else 1) * max(each, default=1)
        return total

    return count(first)


def expected(before: Sequence[Row], size: int, cpu: bool) -> float:
    """Seconds of the next run of a curve. Up to `FULL` cases a device that is not a CPU may have
    room for more at once, as the last two runs show; then it takes as much longer as cases are
    more."""
    if not before:
        return 0.0
    last, more = before[-1], size / before[-1].cases
    if cpu or size > 2 * FULL:
        return last.seconds * more
    return last.seconds * (last.seconds / before[-2].seconds if len(before) > 1 else 1.0)


def measured(program: Program, before: Sequence[Row], left: float) -> tuple[Row, Any]:
    """A row, and the answers; of a program that takes too long or too much it says so alone."""
    row, device = program.row, program.device
    try:
        run, compilation = program.compiled.result()
        memory = run.memory_analysis()
        parts = (memory.temp_size_in_bytes, memory.argument_size_in_bytes,
                 memory.output_size_in_bytes)  # fmt: skip
        cpu = device.platform == "cpu"
        row = row._replace(
            compilation_s=compilation, program_MiB=sum(parts) / 2**20,
            kernels=np.nan if cpu else kernels(run.as_text()),
        )  # fmt: skip
        limit = (device.memory_stats() or {}).get("bytes_limit", np.inf) / 2**20
        if row.program_MiB > limit:
            return row._replace(note=f"out of memory: there are {limit:.0f} MiB"), None
        ahead = expected(before, program.size, cpu)
        if ahead > min(PATIENCE, max(left, BRIEF)):
            return row._replace(note=f"left out: some {ahead:.0f} s"), None
        cases = jax.device_put(program.curve.cases[: program.size], device)
        seconds, answers = common.timed(1, run, cases)
        if seconds < PATIENCE / 4:  # else what comes once counts for little
            seconds, answers = common.timed(9, run, cases, patience=0.5)
    except (jax.errors.JaxRuntimeError, NotImplementedError) as error:
        said = str(error).splitlines()[0][:200]
        ended = "out of memory" if "RESOURCE_EXHAUSTED" in said else "failed"
        return row._replace(note=f"{ended}: {said}"), None
    peak = (device.memory_stats() or {}).get("peak_bytes_in_use", np.nan) / 2**20
    numbers, status = (np.asarray(part) for part in answers)
    fine = float(np.mean((status == jb.Status.OK) & np.isfinite(numbers).all(1)))
    rate = program.size / seconds
    return row._replace(seconds=seconds, rate=rate, device_peak_MiB=peak, fine=fine), numbers


def on_all_cores(program: Program, row: Row, cores: int) -> Row:
    """The same program with other cases on each core at once."""
    run, _ = program.compiled.result()
    batches = np.split(program.curve.cases[: cores * program.size], cores)
    given = [jax.device_put(some, program.device) for some in batches]
    rounds = max(1, int(0.3 / row.seconds))

    def work(cases: Any) -> Any:
        for _ in range(rounds):
            answers = jax.block_until_ready(run(cases))
        return answers

    with ThreadPoolExecutor(cores) as pool:
        start = time.perf_counter()
        answers = list(pool.map(work, given))
        seconds = (time.perf_counter() - start) / rounds
    fine = float(np.mean([np.mean(np.asarray(a[1]) == jb.Status.OK) for a in answers]))
    return row._replace(
        device=f"CPU, {cores} batches at once", cases=cores * program.size, seconds=seconds,
        rate=cores * program.size / seconds, fine=fine,
    )  # fmt: skip


def difference(numbers: np.ndarray, reference: np.ndarray) -> float:
    """Of the cases that both have, quantity by quantity over its largest number."""
    n = min(len(numbers), len(reference))
    off = np.max(np.abs(numbers[:n] - reference[:n]), 0) / np.max(np.abs(reference[:n]), 0)
    return float(np.max(off))


def said(row: Row) -> str:
    """The row as a line."""
    start = f"{row.what:9s} {row.model:13s} {row.device:24s}{row.cases:7d}: "
    made = f"traced in {row.tracing_s:.0f} s, compiled in {row.compilation_s:.0f} s"
    made += f", {row.program_MiB:.0f} MiB"
    if np.isfinite(row.kernels):
        made += f", {row.kernels:.0f} kernels"
    if row.note:
        return f"{start}{row.note} ({made})"
    off = f", off by {row.difference:.1e}" if np.isfinite(row.difference) else ""
    return (
        f"{start}{row.rate:9.0f} /s, {row.seconds:.3g} s, {100 * row.fine:.2f} % ok{off} ({made})"
    )


def study(some: Sequence[Curve], devices: Sequence[Any]) -> list[Row]:
    """All curves on all devices, the last of which is the CPU."""
    began, cpu = time.perf_counter(), devices[-1]
    wanted = [(c, device, n) for c in some for device in devices[:-1] for n in c.sizes]
    wanted += [(c, cpu, FEW) for c in some]
    # What takes longest to compile is the last of them: it goes first, all else by size.
    wanted.sort(key=lambda w: (w[0] is not some[-1], w[2]))
    programs: list[Program] = []
    with ThreadPoolExecutor(max(1, CORES - 1)) as pool:
        for program in compiling(wanted, pool):
            row, passed = program.row, time.perf_counter() - began
            what = f"{row.what}, {row.model}, {row.device}, {row.cases}"
            print(f"{passed:4.0f} s: traced {what} in {row.tracing_s:.0f} s", flush=True)
            programs.append(program)
            if passed > 0.6 * ENOUGH:
                print(f"{len(wanted) - len(programs)} programs are left out", flush=True)
                break
    # Nothing is compiled beside what is measured.
    print(f"{time.perf_counter() - began:4.0f} s: all are compiled", flush=True)
    programs.sort(key=lambda p: (p.device is not cpu, p.size, some.index(p.curve)))
    rows: list[Row] = []
    past: dict[tuple[str, str, str], list[Row]] = {}
    reference: dict[tuple[str, str], np.ndarray] = {}
    for program in programs:
        which = program.row[:3]
        before = past.setdefault(which, [])
        if before and before[-1].note:
            continue
        row, numbers = measured(program, before, ENOUGH - (time.perf_counter() - began))
        if program.device is cpu:
            reference[which[:2]] = numbers
        elif numbers is not None and reference.get(which[:2]) is not None:
            row = row._replace(difference=difference(numbers, reference[which[:2]]))
        before.append(row)
        more = [row]
        if program.device is cpu and not row.note and CORES > 1:
            more.append(on_all_cores(program, row, CORES))
        rows += more
        print(*(said(each) for each in more), sep="\n", flush=True)
    return rows


def draw(rows: Sequence[Row], path: Path) -> None:
    """Rates over batch size, one panel each of modes, spin-ups and gradients."""
    panels = list(dict.fromkeys(row.what for row in rows))
    models = list(dict.fromkeys(row.model for row in rows))
    devices = list(dict.fromkeys(row.device for row in rows))
    colours = dict(
        zip(models, (common.BLUE, common.VERMILION, common.GREEN, common.ORANGE), strict=False)
    )
    styles = {d: ("--" if "at once" in d else ":") if "CPU" in d else "o-" for d in devices}
    figure, axes = plt.subplots(
        1, len(panels), figsize=(4.2 * len(panels), 4.4), layout="constrained", squeeze=False
    )
    ends = [min(row.cases for row in rows), max(row.cases for row in rows)]
    for what, model, device in dict.fromkeys(row[:3] for row in rows):
        own = [r for r in rows if r[:3] == (what, model, device) and np.isfinite(r.rate)]
        if not own:
            continue
        cases, rates = [r.cases for r in own], [r.rate for r in own]
        if "CPU" in device:  # which takes so many at a time: the rate stays
            cases, rates = ends, 2 * rates[-1:]
        ax = axes[0, panels.index(what)]
        ax.plot(cases, rates, styles[device], color=colours[model])
    for ax, what in zip(axes[0], panels, strict=True):
        ax.set_xscale("log", base=2)
        ax.set(yscale="log", xlabel="cases in a batch (-)", ylabel=f"{what} a second (1/s)")
        ax.grid(alpha=0.3)
    handles = [plt.Line2D([], [], color=c, label=model) for model, c in colours.items()]
    for device, style in styles.items():
        handles += axes[0, 0].plot([], [], style, color="0.4", label=device)
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9)
    common.save_figure(figure, path, dpi=150)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the table and the figure."""
    began = time.perf_counter()
    out = common.folder(out, "device")
    cpu = jax.devices("cpu")[0]
    devices = [device for device in jax.devices()[:1] if device.platform != "cpu"] + [cpu]
    print(f"jax {jax.__version__}, {', '.join(map(name_of, devices))} with {CORES} cores,"
          f" {devices[0].client.platform_version.strip()}", flush=True)  # fmt: skip
    rows = study(curves(quick), devices)
    common.write_csv(out / "device.csv", Row._fields, rows)
    draw(rows, out / "device.png")
    return common.finish(began, "table and figure are", out)


if __name__ == "__main__":
    common.run(
        main, __doc__, "one model of each, up to 2^11 cases",
        "the table and the figure", keeps=False,
    )  # fmt: skip
