"""What things cost: gradients, elements, and the first result of a fresh process.

Reverse mode against the forward run (the peak of a spin-up, a sweep of frequencies); a step
against the number of elements, with the slope on logarithmic scales; and from `import` to the first
result of a new process (a spin-up, its gradient), with an empty and with a filled compilation
cache. JAX does not keep programs that can raise in that cache, hence EQX_ON_ERROR=nan there.

    python studies/costs.py [--quick] [--out FOLDER]
"""

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import diffrax
import jax

jax.config.update("jax_enable_x64", True)

import matplotlib  # noqa: E402

matplotlib.use("Agg")
import jax.numpy as jnp  # noqa: E402
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

import jaxbeam as jb  # noqa: E402

BLADE = jb.Beam.from_section(
    length=8.0, density=2767.0, area=7.299e-5, in_plane_second_moment=8.214e-9,
    youngs_modulus=6.895e10,
)  # fmt: skip
TIMES = np.linspace(0.0, 20.0, 201)
FIRST = """
import time
start = time.perf_counter()
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import jaxbeam as jb

@jax.jit
def peak(tip_mass):
    blade = jb.Beam.from_section(length=8.0, youngs_modulus=6.895e10, density=2767.0,
                                 area=7.299e-5, in_plane_second_moment=8.214e-9)
    motion, times = jb.SmoothSpinUp(4.0, 15.0), jnp.linspace(0.0, 20.0, 201)
    rotor = jb.Rotor(blade, 0.0, tip_mass)
    return jb.simulate(jb.EngineeringANCF(8), rotor, motion, times).peak()[0]

FUNCTION(0.1).block_until_ready()
print(time.perf_counter() - start)
"""
Row = tuple[str, str, float, str]  # what, of what, number, unit


def seconds(repeats: int, function: Callable[..., Any], *args: Any) -> float:
    """Median, after compilation."""
    jax.block_until_ready(function(*args))
    taken = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(function(*args))
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def gradients(quick: bool) -> list[Row]:
    """Value and derivatives by four or five parameters by reverse mode, over the value alone."""
    repeats = 3 if quick else 15

    def peak(v: Any) -> Any:
        blade = jb.Beam(BLADE.length, v[0], v[1], v[2], v[2])
        return jb.simulate(
            jb.EngineeringANCF(8), jb.Rotor(blade, v[3], v[4]), jb.SmoothSpinUp(4.0, 15.0), TIMES,
            stepsize_controller=diffrax.PIDController(rtol=1e-5, atol=1e-5), throw=False,
        ).peak()[0]  # fmt: skip

    blade = [BLADE.mass_per_length, BLADE.axial_stiffness, BLADE.in_plane_bending_stiffness]
    tried: list[tuple[str, Any, Any]] = [
        ("spin-up peak, 8 elements", peak, jnp.asarray([*blade, 0.0, 0.0]))
    ]
    rng, size = np.random.default_rng(2), 1000 if quick else 10_000
    spans = ((0.0, 12.0), (0.0, 2.0), (0.0, 1.0), (200.0, 1000.0))
    cases = jnp.asarray(np.stack([rng.uniform(*span, size) for span in spans], 1))

    def swept(one: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda cases: jnp.sum(jax.vmap(one)(cases))

    def at(v: Any) -> tuple[jb.Rotor, Any]:
        return jb.Rotor(jb.Beam(1.0, 1.0, v[3] ** 2, 1.0, 1.0), v[1], v[2]), v[0]

    polynomials, elements = jb.Hybrid(8, 16, 0), jb.ANCF(10)
    for name, one, share in (
        ("frequencies, 16 + 8 polynomials",
         lambda v: jnp.sum(jb.frequencies(polynomials, *at(v), throw=False).frequency), 1),
        ("frequencies, 10 elements",
         lambda v: jnp.sum(jb.frequencies(elements, *at(v), throw=False).frequency), 1),
        ("modes, 16 + 8 polynomials",
         lambda v: jnp.sum(jb.modes(polynomials, *at(v), 3, throw=False).frequency), 10),
    ):  # fmt: skip
        tried.append((f"sweep of {name}", swept(one), cases[: size // share]))
    rows = []
    for name, function, v in tried:
        forward, reverse = jax.jit(function), jax.jit(jax.value_and_grad(function))
        price = seconds(repeats, reverse, v) / seconds(repeats, forward, v)
        rows.append(("reverse mode over forward run", name, price, "-"))
    return rows


def elements(quick: bool, out: Path) -> list[Row]:
    """A step of `Rodas5P`, alone: the first 200 of a spin-up."""
    counts = (8, 16, 32, 64) if quick else (8, 16, 32, 64, 128, 256)
    steps, taken = 200, []
    for n in counts:

        @jax.jit
        def run(speed: Any, n: int = n) -> Any:
            return jb.simulate(
                jb.EngineeringANCF(n), jb.Rotor(BLADE), jb.SmoothSpinUp(speed, 15.0), [0.0, 2.0],
                stepsize_controller=diffrax.ConstantStepSize(), dt0=2.0 / steps, throw=False,
            ).tip  # fmt: skip

        taken.append(seconds(3 if quick else 9, run, 4.0) / steps)
    slope, _ = np.polyfit(np.log(counts), np.log(taken), 1)
    figure, ax = plt.subplots(figsize=(5.5, 4), layout="constrained")
    ax.loglog(counts, 1e6 * np.array(taken), "o-")
    ax.loglog(counts, 1e6 * taken[0] * np.array(counts) / counts[0], "k:", label="linear")
    ax.set(xlabel="elements (-)", ylabel="wall time of a step of Rodas5P (µs)")
    ax.set_xticks(counts, [str(n) for n in counts], minor=False)
    ax.minorticks_off()
    ax.grid(alpha=0.3)
    ax.legend()
    figure.savefig(out / "elements.png", dpi=150)
    plt.close(figure)
    rows = [
        ("a step of Rodas5P", f"{n} elements", 1e6 * t, "us")
        for n, t in zip(counts, taken, strict=True)
    ]
    return [*rows, ("slope of step over elements", "Rodas5P", float(slope), "-")]


def fresh_processes(quick: bool) -> list[Row]:
    """From the first line of a script to its first result."""
    tried = (("spin-up", "peak"), ("gradient of its peak", "jax.grad(peak)"))
    plain = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "EQX_", "XLA_"))}
    rows = []
    with tempfile.TemporaryDirectory() as cache:
        kept = {
            "EQX_ON_ERROR": "nan", "JAX_COMPILATION_CACHE_DIR": cache,
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        }  # fmt: skip
        for what, function in tried[: 1 if quick else 2]:
            for how, more in (
                ("no cache", {}), ("cache being filled", kept), ("warm cache", kept),
            ):  # fmt: skip
                done = subprocess.run(
                    [sys.executable, "-c", FIRST.replace("FUNCTION", function)],
                    capture_output=True, text=True, check=True, env={**plain, **more},
                )  # fmt: skip
                rows.append((f"fresh process, {how}", what, float(done.stdout), "s"))
    return rows


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the table and the figure."""
    began = time.perf_counter()
    out = out or Path(tempfile.gettempdir()) / "jaxbeam" / "costs"
    out.mkdir(parents=True, exist_ok=True)
    rows: list[Row] = []
    for part in (
        lambda: gradients(quick),
        lambda: elements(quick, out),
        lambda: fresh_processes(quick),
    ):
        for row in part():
            print(f"{row[0]:32s} {row[1]:44s} {row[2]:10.2f} {row[3]}", flush=True)
            rows.append(row)
    with open(out / "costs.csv", "w", newline="") as file:
        csv.writer(file).writerows([("what", "of", "number", "unit"), *rows])
    print(f"{time.perf_counter() - began:.0f} s; table and figure are in {out}")
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="fewer cases and elements")
    parser.add_argument("--out", type=Path, help="folder for the table and the figure")
    arguments = parser.parse_args()
    main(arguments.quick, arguments.out)
