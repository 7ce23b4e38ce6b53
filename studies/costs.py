"""What things cost: gradients, elements, and the first result of a fresh process.

Reverse mode against the forward run (the peak of a spin-up, a sweep of frequencies); modes of a
blade beside those of a uniform beam, a case of a batch, and of a rod of full sections; a step
against the number of elements, in the plane and in space, with slopes on logarithmic scales; and
CPU seconds from the start of a new process to its first result, beside what diffrax alone takes for
ten linear oscillators, and in the next process where `jb.keep` keeps programs. It measures the
Python that runs it.

    python studies/costs.py [--quick] [--out FOLDER]
"""

import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import blade
import common
import diffrax
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from common import ALUMINIUM, cpu_seconds

import jaxbeam as jb

REF_21 = jb.Beam.from_section(**ALUMINIUM)
TIMES = np.linspace(0.0, 20.0, 201)
START = """
import os
import time
aside = 0.0
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
"""
SCENE = """
import jaxbeam as jb
if "JAXBEAM_KEEP" in os.environ:
    jb.keep()
blade = jb.Beam.from_section(length=8.0, youngs_modulus=6.895e10, density=2767.0,
                             area=7.299e-5, in_plane_second_moment=8.214e-9)
rotor, model, which = jb.Rotor(blade, 0.5, 0.1), jb.Hybrid(), jb.labels(in_plane=2, flap=1)
"""
END = """
jax.block_until_ready(ANSWER)
print(time.process_time() - aside)
"""
SPIN_UP = """
def peak(tip_mass):
    motion, times = jb.SmoothSpinUp(4.0, 15.0), jnp.linspace(0.0, 20.0, 201)
    run = jb.simulate(jb.PlanarRod(8), jb.Rotor(blade, 0.0, tip_mass), motion, times,
                      throw=False)
    return run.peak()[0]
"""
# What another library takes that does much less: diffrax alone, with ten linear oscillators.
YARDSTICK = """
import diffrax
@jax.jit
def peak(scale):
    term = diffrax.ODETerm(lambda t, y, scale: scale * jnp.arange(1.0, 11.0) * jnp.roll(y, 5)
                           * jnp.repeat(jnp.array([1.0, -1.0]), 5))
    solution = diffrax.diffeqsolve(
        term, diffrax.Kvaerno5(), 0.0, 20.0, 0.01, jnp.ones(10), scale,
        saveat=diffrax.SaveAt(ts=jnp.linspace(0.0, 20.0, 201)),
        stepsize_controller=diffrax.PIDController(1e-6, 1e-6))
    return jnp.max(jnp.abs(solution.ys))
"""
BATCH = """
def lowest(speed):
    return jb.modes(model, rotor, speed, which, throw=False).frequency
speeds = jnp.linspace(0.0, 5.0, 256)
"""
FIT = """
import numpy as np
true = dict(axial=5e5, bending=566.0, flap=700.0, hub_radius=0.5, tip_mass=0.1)
model, labels = jb.Hybrid(4, 6, 6), jb.labels(in_plane=4, flap=3, axial=1)
speeds = jnp.linspace(0.0, 12.0, 7)
measuring = time.process_time()
def rotor_of(axial, bending, flap, hub_radius, tip_mass):
    return jb.Rotor(jb.Beam(8.0, 0.202, axial, bending, flap), hub_radius, tip_mass)
seen = jax.vmap(lambda speed: jb.modes(model, rotor_of(**true), speed, labels,
                                       throw=False).frequency)(speeds)
seen += 0.02 * np.random.default_rng(1).normal(size=seen.shape)
first = time.process_time()
def experiment(**parameters):
    return jb.FrequencyData(model, rotor_of(**parameters), speeds, seen, 0.02, labels)
found = jb.fit(experiment, {name: jb.FreeParameter(1.1 * value) for name, value in true.items()})
aside = first - measuring  # the measurements are not the fit's
"""
# As many as go by bands, or one fewer: what the first batch takes beside its run, and the run.
MANY = """
speeds = jnp.linspace(0.0, 5.0, SIZE)
jb.programs.compile_well()
batch = jb.programs.kept(jax.vmap(lowest))
jax.block_until_ready(batch(speeds))
first = time.process_time()
jax.block_until_ready(batch(speeds))
each = time.process_time() - first
print(first - each, each / SIZE)
"""
CHOICE = """
times = jnp.linspace(0.0, 20.0, 201)
question = jb.ladder.PeakDeflection(jb.SmoothSpinUp(4.0, 15.0), times)
"""
LADDER = """
import numpy as np
def situation(speed, duration):
    times = jnp.linspace(0.0, 1.5 * duration, 121)
    return rotor, jb.ladder.PeakDeflection(jb.SmoothSpinUp(speed, duration), times)
draw = np.random.default_rng(7)
cases = jb.points(speed=draw.uniform(0.2, 4.0, 1000), duration=draw.uniform(5.0, 20.0, 1000))
"""
Row = tuple[str, str, float, str]  # what, of what, number, unit


def seconds(repeats: int, function: Callable[..., Any], *args: Any) -> float:
    """Median, after compilation."""
    common.timed(1, function, *args)
    return common.timed(repeats, function, *args)[0]


def by_tip_mass(model: jb.models.AbstractModel) -> Callable[[Any], Any]:
    """The peak of a spin-up, as a function of the tip mass."""

    def peak(tip_mass: Any) -> Any:
        rotor = jb.Rotor(REF_21, 0.0, tip_mass)
        return jb.simulate(model, rotor, jb.SmoothSpinUp(4.0, 15.0), TIMES, throw=False).peak()[0]

    return peak


def gradients_of_runs() -> Iterator[Row]:
    """Derivatives of the peak of a spin-up by the tip mass, of one run and of batches of 256, over
    the same runs alone, and runs one by one over a batch of equal ones: ratios of CPU time, all
    settings as they are by default."""
    masses, one = jnp.linspace(0.05, 0.3, 256), jnp.asarray(0.1)
    for name, model in (("8 elements", jb.PlanarRod(8)), ("6 polynomials", jb.Hybrid(0, 6, 0))):
        peak = by_tip_mass(model)
        grad = jax.grad(peak)
        alone, together = jax.jit(peak), jax.jit(jax.vmap(peak))
        for what, forward, reverse, at in (
            ("a run", alone, grad, one),
            ("256 runs", together, jax.vmap(grad), masses),
        ):
            price = cpu_seconds(jax.jit(reverse), at)[0] / cpu_seconds(forward, at)[0]
            yield "reverse mode over forward run", f"spin-ups, {name}: {what}", price, "-"
        equal = jnp.full_like(masses, one)
        price = equal.size * cpu_seconds(alone, one)[0] / cpu_seconds(together, equal)[0]
        yield "loop over batch", f"256 equal spin-ups, {name}", price, "-"


def gradients(quick: bool) -> list[Row]:
    """Value and derivatives by four or five parameters by reverse mode, over the value alone."""
    repeats = 3 if quick else 15

    def peak(v: Any) -> Any:
        blade = jb.Beam(REF_21.length, v[0], v[1], v[2], v[2])
        return jb.simulate(
            jb.PlanarRod(8), jb.Rotor(blade, v[3], v[4]), jb.SmoothSpinUp(4.0, 15.0), TIMES,
            stepsize_controller=diffrax.PIDController(rtol=1e-5, atol=1e-5), throw=False,
        ).peak()[0]  # fmt: skip

    blade = [REF_21.mass_per_length, REF_21.axial_stiffness, REF_21.in_plane_bending_stiffness]
    tried: list[tuple[str, Any, Any]] = []
    if not quick:
        tried = [("spin-up peak, 8 elements", peak, jnp.asarray([*blade, 0.0, 0.0]))]
    size = 1000 if quick else 10_000
    cases, at = common.random_cases(size, seed=2), common.rotating

    def swept(one: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda cases: jnp.sum(jax.vmap(one)(cases))

    for name, model in (
        ("modes, 16 + 8 polynomials", jb.Hybrid(8, 16, 0)),
        ("modes, 10 elements", jb.papers.ANCF(10)),
    )[: 1 if quick else 2]:  # fmt: skip

        def one(v: Any, model: Any = model) -> Any:
            return jnp.sum(jb.modes(model, *at(v), 3, throw=False).frequency)

        tried.append((f"sweep of {name}", swept(one), cases))
    rows = []
    for name, function, v in tried:
        forward, reverse = jax.jit(function), jax.jit(jax.value_and_grad(function))
        price = seconds(repeats, reverse, v) / seconds(repeats, forward, v)
        rows.append(("reverse mode over forward run", name, price, "-"))
    return rows


def batches() -> Iterator[Row]:
    """A case of `modes` in a batch: of a uniform beam by bands, and of a blade that varies at all
    stations, five modes with estimates; then with the gradients of the sum of its frequencies."""
    draw = np.random.default_rng(4)
    names, beam = tuple(blade.PROPERTIES), blade.BEAM
    stations = len(beam.mass_per_length.stations)
    factors = draw.uniform(0.9, 1.1, (256, len(names), stations))

    def vary(v: Any) -> Any:
        varied = blade.scaled(beam, dict(zip(names, v, strict=True)))
        return blade.hertz(blade.few(12), varied, blade.RATED)

    def uniform(v: Any) -> Any:
        return jb.modes(jb.Hybrid(8, 16, 0), *common.rotating(v), 3, throw=False).frequency

    for name, one, cases in (
        ("uniform, 16 + 8 polynomials", uniform, common.random_cases(4096, seed=2)),
        ("a blade, 12 + 12 functions", vary, factors),
    ):
        v = jnp.asarray(cases)
        slopes = jax.jit(jax.vmap(jax.value_and_grad(lambda v, one=one: jnp.sum(one(v)))))
        size, each = len(v), jax.jit(jax.vmap(one))
        yield f"modes, a case of {size}", name, 1e6 * seconds(5, each, v) / size, "us"
        yield "the same with gradients", name, 1e6 * seconds(5, slopes, v) / size, "us"


def levels() -> Iterator[Row]:
    """Programs by the first level of LLVM's optimiser, which those of the package take, over the
    same by the third, which JAX takes: compilation, and the least CPU time of runs in turns."""
    peak, masses = by_tip_mass(jb.PlanarRod(8)), jnp.linspace(0.05, 0.3, 64)
    cases = jnp.asarray(common.random_cases(4096, seed=2))

    def uniform(v: Any) -> Any:
        return jb.modes(jb.Hybrid(8, 16, 0), *common.rotating(v), 3, throw=False).frequency

    def steps(model: Any) -> Callable[[Any], Any]:
        return lambda speed: jb.simulate(
            model, jb.Rotor(common.aluminium_in_space()), jb.SmoothSpinUp(speed, 15.0), [0.0, 2.0],
            stepsize_controller=diffrax.ConstantStepSize(), dt0=0.01, throw=False,
        ).tip  # fmt: skip

    for name, function, at in (
        ("a spin-up", peak, masses[0]),
        ("its gradient", jax.grad(peak), masses[0]),
        ("64 spin-ups", jax.vmap(peak), masses),
        ("4096 modes", jax.vmap(uniform), cases),
        ("200 steps of 256 elements", steps(jb.PlanarRod(256)), jnp.asarray(4.0)),
        ("200 steps of a rod", steps(jb.SpatialRod(8)), jnp.asarray(4.0)),
    ):
        lowered = jax.jit(function).lower(at)
        programs, compiling = [], []
        for level in (1, 3):
            begin = time.process_time()
            how: dict[str, Any] = {"xla_backend_optimization_level": level}
            programs.append(lowered.compile(how))
            compiling.append(time.process_time() - begin)
        turns = [[cpu_seconds(p, at, repeats=3)[0] for p in programs] for _ in range(4)]
        run = np.min(turns, 0)
        yield "level 1 over level 3, to run", name, run[0] / run[1], "-"
        yield "level 1 over level 3, to compile", name, compiling[0] / compiling[1], "-"


def full_blade() -> jb.blades.Blade:
    """30 stations of full sections with every coupling, tapered, twisted, swept and bent."""
    draw, along = np.random.default_rng(0), np.linspace(0.0, 1.0, 30)
    size = np.sqrt([2e9, 2e8, 1e8, 1e8, 5e8, 1.5e9])
    a = draw.normal(size=(6, 6))
    stiff = size[:, None] * (a @ a.T / 60 + np.eye(6)) * size
    arm = np.cross([0.0, 0.1, 0.02], np.eye(3)).T
    about = np.diag([60.0, 20.0, 40.0]) - 300 * arm @ arm
    heavy = np.block([[300 * np.eye(3), -300 * arm], [300 * arm, about]])
    taper = (1 - 0.7 * along)[:, None, None]
    axis = np.stack([60 * along, -2 * along**2, -3 * along**2], 1)
    return jb.blades.Blade(along.tolist(), taper**2 * stiff, taper * heavy, axis, 0.2 * (1 - along))


def rods() -> Iterator[Row]:
    """The rod of a blade, 48 coordinates: its steady rotation, six modes about that, a case of a
    batch, and derivatives by all 42 numbers of all sections."""
    model, blade = jb.SpatialRod(8), full_blade()
    names = "six modes, 30 full sections", "tip in steady rotation, the same"
    numbers = blade.stiffness, blade.inertia

    def rotor(stiffness: Any, inertia: Any) -> jb.Rotor:
        fields = blade.stations, stiffness, inertia, blade.axis, blade.twist
        return jb.Rotor(jb.blades.Blade(*fields), 2.0)

    def six(*of: Any) -> Any:
        return jb.modes(model, rotor(*of), 1.2, 6, throw=False).frequency

    def tip(*of: Any) -> Any:
        return jb.steady(model, rotor(*of), 1.2, throw=False).tip

    def taken(function: Any, *of: Any) -> float:  # as runs, by the least CPU time
        return cpu_seconds(jax.jit(function), *of, repeats=30)[0]

    price = taken(six, *numbers)
    yield "a rod alone", names[1], 1e6 * taken(tip, *numbers), "us"
    yield "a rod alone", names[0], 1e6 * price, "us"
    draw = np.random.default_rng(4)
    factors = jnp.asarray(draw.uniform(0.9, 1.1, (256, 2, 30, 1)))
    many = jax.jit(jax.vmap(lambda f: six(*(f * jnp.stack(numbers)))))
    yield "a rod, a case of 256", names[0], 1e6 * cpu_seconds(many, factors)[0] / 256, "us"
    by = 0, 1
    for what, slope in (
        ("gradient of their sum, over them", jax.value_and_grad(lambda *of: jnp.sum(six(*of)), by)),
        ("gradients of all six, over them", jax.jacrev(six, by)),
    ):
        yield what, names[0], taken(slope, *numbers) / price, "-"


def elements(quick: bool, out: Path) -> Iterator[Row]:
    """A step of `Rodas5P`, alone, of elements in the plane and of rods in space: the first 200 of a
    spin-up of a beam that bends alike both ways."""
    steps, some = 200, (8, 32) if quick else (8, 16, 32, 64, 128, 256)
    beam = common.aluminium_in_space()
    figure, ax = plt.subplots(figsize=(5.5, 4), layout="constrained")
    first = {}
    for kind, name, counts in (
        (jb.PlanarRod, "in the plane", some),
        (jb.SpatialRod, "in space", (8,) if quick else (4, 8, 12, 16)),
    ):
        taken = []
        for n in counts:

            @jax.jit
            def run(speed: Any, model: Any = kind(n)) -> Any:  # noqa: B008
                return jb.simulate(
                    model, jb.Rotor(beam), jb.SmoothSpinUp(speed, 15.0), [0.0, 2.0],
                    stepsize_controller=diffrax.ConstantStepSize(), dt0=2.0 / steps, throw=False,
                ).tip  # fmt: skip

            taken.append(seconds(3 if quick else 9, run, 4.0) / steps)
            size = f"{n} elements" if kind is jb.PlanarRod else f"degree {n}"
            yield f"a step of Rodas5P, {name}", size, 1e6 * taken[-1], "us"
        if len(counts) > 1:
            slope, _ = np.polyfit(np.log(counts), np.log(taken), 1)
            yield "slope of step over elements or degree", name, float(slope), "-"
        first[name] = taken[counts.index(8)]
        ax.loglog(counts, 1e6 * np.array(taken), "o-", label=name)
    ratio = first["in space"] / first["in the plane"]
    yield "step in space over in the plane", "degree 8, 8 elements", ratio, "-"
    ax.loglog(some, 1e6 * first["in the plane"] * np.array(some) / some[0], "k:", label="linear")
    ax.set(
        xlabel="elements in the plane, degree in space (-)",
        ylabel="wall time of a step of Rodas5P (µs)",
    )
    ax.set_xticks(some, [str(n) for n in some], minor=False)
    ax.minorticks_off()
    ax.grid(alpha=0.3)
    ax.legend()
    common.save_figure(figure, out / "elements.png", dpi=150)


IN_SPACE = """
stiff = jb.Beam(8.0, 0.2, 5e6, 566.0, 400.0, torsional_stiffness=300.0, polar_inertia=1e-3)
loads = jb.Loads(tip_force=[0.0, 2.0, 3.0])
def turning(tip_mass):
    rotor = jb.Rotor(stiff, 0.0, tip_mass, precone=0.05)
    motion, times = jb.SmoothSpinUp(4.0, 15.0), jnp.linspace(0.0, 20.0, 201)
    return jb.simulate(jb.SpatialRod(8), rotor, motion, times, throw=False).peak()[0]
def bent(tip_mass):
    return jb.modes(jb.SpatialRod(8), jb.Rotor(stiff, 0.0, tip_mass), 2.0, 3, loads=loads,
                    throw=False).frequency[0]
"""
# What is asked, and what comes before it.
FIRST = {
    "diffrax alone": ("peak(1.0)", YARDSTICK),
    "diffrax alone, gradient": ("jax.grad(peak)(1.0)", YARDSTICK),
    "modes": ("jb.modes(model, rotor, 5.0, which).frequency", SCENE),
    "spin-up": ("peak(0.1)", SCENE + SPIN_UP),
    "gradient of its peak": ("jb.programs.kept(jax.grad(peak))(0.1)", SCENE + SPIN_UP),
    "256 modes, 10 elements": (
        "jb.programs.kept(jax.vmap(lowest))(speeds)",
        SCENE + "model, which = jb.PlanarRod(10), jb.labels(in_plane=2)\n" + BATCH,
    ),
    "256 modes, 16 + 8 polynomials": (
        "jb.programs.kept(jax.vmap(lowest))(speeds)",
        SCENE + "model, which = jb.Hybrid(8, 16, 0), jb.labels(in_plane=2)\n" + BATCH,
    ),
    "modes of a rod": (
        "jb.modes(jb.SpatialRod(), jb.Rotor(stiff, 0.5), 2.0, 6).frequency",
        SCENE + IN_SPACE,
    ),
    "in space: run": ("turning(0.1)", SCENE + IN_SPACE),
    "in space: gradient of a run": (
        "jb.programs.kept(jax.grad(turning))(0.1)", SCENE + IN_SPACE,
    ),
    "in space: loaded modes": ("bent(0.1)", SCENE + IN_SPACE),
    "in space: their gradient": ("jb.programs.kept(jax.grad(bent))(0.1)", SCENE + IN_SPACE),
    "southwell": ("jb.southwell(model, rotor, 0.0, which).coefficient", SCENE),
    "critical_speed": (
        "jb.critical_speed(jb.papers.ChordANCF(4), rotor).angular_speed", SCENE,
    ),
    "floquet": (
        "jb.floquet(jb.Hybrid(0, 3, 2), rotor, jb.motions.ModulatedSpeed(3.0, 0.5, 10.0)).status",
        SCENE,
    ),
    "fit of five parameters": ("found", SCENE + FIT),
    "choose_model": ("str(jb.choose_model(rotor, question, 1e-2))", SCENE + CHOICE),
    "ladder_sweep, 1000 spin-ups": (
        'jb.ladder_sweep(situation, cases, 1e-3)["value"]', SCENE + LADDER,
    ),
}  # fmt: skip


def script_of(what: str) -> str:
    """One of `FIRST`, as what Python is given."""
    answer, before = FIRST[what]
    return START + before + END.replace("ANSWER", answer)


def printed(script: str, folder: str = "") -> list[float]:
    """The numbers that a script prints in a process of its own, which keeps programs in a folder if
    one is given."""
    ours = "JAX_", "EQX_", "XLA_", "JAXBEAM_"
    plain = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True,
        env={**plain, "JAXBEAM_KEEP": folder} if folder else plain,
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{script}: {done.stderr}")
    return [float(number) for number in done.stdout.split()]


def bands() -> Iterator[Row]:
    """From how many `modes` on a program with bands has paid for its longer compilation, in fresh
    processes and where programs are kept: CPU time of 4096 cases and of one fewer, the least of
    three."""
    for what in (name for name in FIRST if name.startswith("256 modes, ")):
        scripts = [
            START + FIRST[what][1] + MANY.replace("SIZE", str(size)) for size in (4095, 4096)
        ]
        with tempfile.TemporaryDirectory() as kept:
            for script in scripts:
                printed(script, kept)
            for where, folder in (("fresh", ""), ("kept", kept)):
                dense, banded = (
                    np.min([printed(script, folder) for _ in range(3)], 0) for script in scripts
                )
                name = f"{what.removeprefix('256 modes, ')}, {where}"
                longer, saved = banded[0] - dense[0], dense[1] - banded[1]
                yield "bands compile longer by", name, longer, "CPU s"
                yield "bands save, of a case", name, 1e6 * saved, "CPU us"
                yield "bands pay from", name, longer / saved, "cases"


def fresh_processes(quick: bool) -> Iterator[Row]:
    """CPU seconds of whole processes to the first result, imports included: medians of five, with
    nothing kept, and where another process has kept its programs."""
    repeats = range(1 if quick else 5)
    for what in ("spin-up",) if quick else FIRST:
        script = script_of(what)
        fresh = np.median([printed(script) for _ in repeats])
        yield "fresh process", what, float(fresh), "CPU s"
        if SCENE not in script:
            continue
        with tempfile.TemporaryDirectory() as folder:
            printed(script, folder)
            again = np.median([printed(script, folder) for _ in repeats])
            yield "the next, kept", what, float(again), "CPU s"


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the table and the figure."""
    began = time.perf_counter()
    out = common.folder(out, "costs")
    rows: list[Row] = []
    print(f"Python {platform.python_version()}, jax {jax.__version__}", flush=True)
    for part in (
        lambda: gradients(quick),
        lambda: () if quick else batches(),
        lambda: () if quick else levels(),
        lambda: () if quick else rods(),
        lambda: () if quick else gradients_of_runs(),
        lambda: elements(quick, out),
        lambda: () if quick else bands(),
        lambda: fresh_processes(quick),
    ):
        for row in part():
            print(f"{row[0]:32s} {row[1]:44s} {row[2]:10.2f} {row[3]}", flush=True)
            rows.append(row)
    common.write_csv(out / "costs.csv", ("what", "of", "number", "unit"), rows)
    return common.finish(began, "table and figure are", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer cases and elements", "the table and the figure", keeps=False)
