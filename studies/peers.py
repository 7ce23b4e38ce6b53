"""jaxbeam beside its peers: the same scene, the same measure of error, one run.

A spin-up of B Ref. 21 (8 elements, 4 rad/s, 20 s) by `Rodas5P`, by stock diffrax and SciPy
integrators with the same right-hand side, and by Exudyn's ANCFCable2D; the same about an inclined
axis, in space, beside Exudyn's ANCFCable; batches of the first; the slow spin-up of Y Fig. 6 by a
modal model; and frequencies with hub and tip mass by `frequencies`, `modes`, a loop over
`scipy.linalg.eig`, and pyBModes. An error is the largest difference of the tip
deflection over the run from the same equations integrated to convergence, over the peak. Times are
without compilation, medians of repeated runs, of fewer where they are long; ratios are between
lines of the same run. pyBModes computes all directions and shapes, and leaves out the tension of a
tip mass: it gets none.

    python -m pip install ".[bench]" && python studies/peers.py [--quick] [--out FOLDER]

Peers that are not installed are left out, and named.
"""

import importlib.metadata
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import common
import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import scipy.integrate
import scipy.linalg
from common import ALUMINIUM

import jaxbeam as jb

REF_21 = jb.Beam.from_section(**ALUMINIUM)
DURATION, END, ELEMENTS = 15.0, 20.0, 8
TIMES = np.linspace(0.0, END, 201)
TILT = math.radians(30.0)
INCLINED = np.array([math.sin(TILT), 0.0, math.cos(TILT)])  # an axis of rotation
CORES = os.cpu_count() or 1


class Line(NamedTuple):
    """One measurement."""

    method: str
    setting: str
    seconds: float  # a case
    error: float
    compilation: float
    remark: str = ""
    scene: str = ""


def median(
    repeats: int, function: Callable[..., Any], *args: Any, first: tuple[Any, ...] | None = None
) -> tuple[float, float, Any]:
    """Seconds of a run (fewer runs where they are long) and of compilation, and the result.

    `first`: arguments of a shorter run that compiles the same program.
    """
    compilation, _ = common.timed(1, function, *(args if first is None else first))
    seconds, result = common.timed(repeats, function, *args, patience=10)
    return seconds, max(compilation - (seconds if first is None else 0.0), 0.0), result


def off(tip: Any, reference: Any) -> float:
    """Largest difference over the peak; infinite where there is nothing."""
    difference = np.max(np.abs(np.asarray(tip) - reference))
    return float(difference / np.max(np.abs(reference))) if np.isfinite(difference) else np.inf


def at_error(lines: list[Line], method: str, error: float) -> float:
    """Seconds that a method takes for this error, between its settings on logarithmic scales; if
    all are better the fastest one, NaN if none is."""
    points = sorted((x.error, x.seconds) for x in lines if x.method == method and x.error > 0)
    good = [seconds for e, seconds in points if e <= error]
    if not good:
        return np.nan
    worse = [(e, s) for e, s in points if e > error and s < min(good)]
    if not worse:
        return min(good)
    errors, seconds = zip(*[p for p in points if p[0] <= error][-1:], worse[0], strict=True)
    share = np.interp(np.log(error), np.log(errors), np.log(seconds))
    return float(min(np.exp(share), min(good)))


def spin_up(speed: Any, solver: Any, controller: Any, dt0: Any) -> tuple[Any, Any]:
    """Tip deflection, and number of steps."""
    run = jb.simulate(
        jb.PlanarRod(ELEMENTS), jb.Rotor(REF_21),
        jb.SmoothSpinUp(speed, DURATION), TIMES, solver=solver, stepsize_controller=controller,
        dt0=dt0, max_steps=10_000_000, throw=False,
    )  # fmt: skip
    return run.partial.tip[:, 1], run.solution.stats["num_steps"]


def adaptive(solver: Any) -> Callable[[float, float], tuple[Any, Any]]:
    """(speed, tolerance) to `spin_up`."""

    @jax.jit
    def run(speed: Any, tolerance: Any) -> tuple[Any, Any]:
        control = diffrax.PIDController(rtol=tolerance, atol=tolerance)
        return spin_up(speed, solver, control, None)

    return run


def spin_ups(quick: bool) -> list[Line]:
    """B Ref. 21 at 4 rad/s, one case at a time."""
    repeats = 1 if quick else 5
    ours = adaptive(jb.solvers.Rodas5P())
    reference = np.asarray(ours(4.0, 1e-10)[0])
    lines = []

    def measure(method: str, settings: Iterable[float], run: Any, repeats: int) -> None:
        compilation = 0.0
        for setting in settings:
            # A beam that does not move takes the largest steps of all.
            seconds, first, (tip, steps) = median(repeats, run, 4.0, setting, first=(0.0, setting))
            compilation = compilation or first
            remark = f"{int(steps)} steps"
            error = off(tip, reference)
            lines.append(Line(method, f"{setting:g}", seconds, error, compilation, remark))
            say(lines[-1])

    measure("jaxbeam Rodas5P", (1e-4, 3e-5, 1e-5, 1e-6), ours, repeats)

    @jax.jit
    def chord(speed: Any, h: Any) -> tuple[Any, Any]:
        return spin_up(speed, jb.solvers.ChordKvaerno5(), diffrax.ConstantStepSize(), h)

    if not quick:
        fourth = adaptive(jb.solvers.Rodas4P())
        measure("jaxbeam Rodas4P", (1e-4, 1e-5, 1e-6), fourth, repeats)
        measure("jaxbeam ChordKvaerno5", (0.1, 0.08), chord, repeats)
    for name, solver, tolerances in (
        ("KenCarp4", diffrax.KenCarp4(), (1e-6,) if quick else (1e-4, 3e-5, 1e-5, 1e-6)),
        ("Kvaerno5", diffrax.Kvaerno5(), () if quick else (1e-5,)),
        ("Dopri8", diffrax.Dopri8(), () if quick else (1e-5,)),
    ):
        measure(f"diffrax {name}", tolerances, adaptive(solver), 1 if quick else 3)
    equations = first_order()
    more: tuple[tuple[str, tuple[float, ...]], ...] = (
        ("Radau", (1e-5,) if quick else (1e-4, 1e-5, 1e-6)), ("LSODA", () if quick else (1e-5,)),
    )  # fmt: skip
    for name, settings in more:
        for tolerance in settings:
            runs = [scipy_run(*equations, name, tolerance, patience=60.0)]
            if np.isfinite(runs[0][0]) and not quick:
                runs += [scipy_run(*equations, name, tolerance, patience=60.0) for _ in range(2)]
            seconds = float(np.median([run[0] for run in runs]))
            _, tip, remark = runs[0]
            error = off(tip, reference)
            lines.append(Line(f"SciPy {name}", f"{tolerance:g}", seconds, error, np.nan, remark))
            say(lines[-1])
    if installed("exudyn"):
        steps = (0.0025, 0.001) if quick else (0.01, 0.005, 0.0025, 0.001, 0.0008)
        exact = exudyn_run(4.0, 0.0001)[0]
        for h in steps:
            found = [exudyn_run(4.0, h) for _ in range(1 if quick else 3)]
            seconds = float(np.median([s for _, s in found]))
            lines.append(Line("Exudyn", f"{h:g} s", seconds, off(found[0][0], exact), np.nan))
            say(lines[-1])
    return lines


def first_order() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """The same equations for SciPy, with their exact Jacobian: functions of t and (q, v)."""
    n = 4 * ELEMENTS + 1
    scene = jb.results.Scene(
        jb.PlanarRod(ELEMENTS), jax.tree.map(jnp.asarray, jb.Rotor(REF_21)),
        jb.SmoothSpinUp(4.0, DURATION), jb.Loads(), jb.Damping(),
    )  # fmt: skip

    def rate(t: Any, y: Any) -> Any:
        return jnp.concatenate([y[n:], scene.acceleration(t, y[:n], y[n:])])

    rate_, jacobian = jax.jit(rate), jax.jit(jax.jacfwd(rate, argnums=1))
    t, y = np.float64(0.0), np.zeros(2 * n)
    jax.block_until_ready((rate_(t, y), jacobian(t, y)))
    return rate_, jacobian


def scipy_run(
    rate: Callable[..., Any], jacobian: Callable[..., Any], method: str, tolerance: float,
    patience: float,
) -> tuple[float, Any, str]:  # fmt: skip
    """Seconds, tip deflection and remark; given up after so many seconds."""
    start = time.perf_counter()

    def in_time(t: float, y: Any) -> np.ndarray:
        if time.perf_counter() - start > patience:
            raise TimeoutError(f"given up at {t:.2g} s of {END:g} s")
        return np.asarray(rate(np.float64(t), y))

    try:
        found = scipy.integrate.solve_ivp(
            in_time, (0.0, END), np.zeros(2 * (4 * ELEMENTS + 1)), method, TIMES, rtol=tolerance,
            atol=tolerance, jac=lambda t, y: np.asarray(jacobian(np.float64(t), y)),
        )  # fmt: skip
    except TimeoutError as late:
        return np.inf, np.nan, str(late)
    seconds = time.perf_counter() - start
    tip = found.y[4 * ELEMENTS - 3] if found.success else np.nan
    return seconds, tip, f"{found.nfev} evaluations"


def exudyn_run(speed: float, h: float) -> tuple[Any, float]:
    """Tip deflection at TIMES and seconds: ANCFCable2D, generalised alpha, full Newton.

    With its default tolerances of Newton's method it takes forty times as long, for nothing.
    """
    sys.exudynFast = True  # type: ignore[attr-defined]  # the build without checks of ranges
    import exudyn as exu
    import exudyn.itemInterface as items
    from exudyn.beams import GenerateStraightLineANCFCable2D

    speed = float(speed)

    angle = partial(spun, speed=speed)

    mbs = exu.SystemContainer().AddSystem()
    cable = items.Cable2D(
        physicsMassPerLength=float(REF_21.mass_per_length),
        physicsBendingStiffness=float(REF_21.in_plane_bending_stiffness),
        physicsAxialStiffness=float(REF_21.axial_stiffness),
    )
    nodes, elements, *_ = GenerateStraightLineANCFCable2D(
        mbs, [0, 0, 0], [float(REF_21.length), 0, 0], ELEMENTS, cable
    )
    turning = mbs.AddNode(items.NodeRigidBody2D())
    hub = mbs.AddObject(items.ObjectRigidBody2D(mass=1.0, inertia=1.0, nodeNumber=turning))
    ends = [
        mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=body, localPosition=[0, 0, 0]))
        for body in (hub, elements[0])
    ]
    mbs.AddObject(items.GenericJoint(markerNumbers=ends, constrainedAxes=[1, 1, 0, 0, 0, 1]))
    ground = mbs.AddNode(items.NodePointGround())
    fixed = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    for i in range(3):
        own = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=turning, coordinate=i))
        how = {"offsetUserFunction": lambda _, t, *__: angle(t)} if i == 2 else {}
        mbs.AddObject(items.CoordinateConstraint(markerNumbers=[fixed, own], **how))
    place, seconds = exudyn_solved(mbs, nodes[-1], h)
    turned = np.array([angle(t) for t in TIMES])
    return -np.sin(turned) * place[:, 0] + np.cos(turned) * place[:, 1], seconds


def exudyn_solved(mbs: Any, node: Any, h: float) -> tuple[np.ndarray, float]:
    """Positions of a node at TIMES (T, 3), and seconds."""
    import exudyn as exu
    import exudyn.itemInterface as items

    sensor = mbs.AddSensor(
        items.SensorNode(
            nodeNumber=node, storeInternal=True,
            outputVariableType=exu.OutputVariableType.Position,
        )
    )  # fmt: skip
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.timeIntegration.numberOfSteps = round(END / h)
    settings.timeIntegration.endTime = END
    settings.timeIntegration.newton.relativeTolerance = 1e-6
    settings.timeIntegration.newton.absoluteTolerance = 1e-6
    settings.timeIntegration.newton.useModifiedNewton = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.6
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = float(TIMES[1])
    start = time.perf_counter()
    mbs.SolveDynamic(settings)
    seconds = time.perf_counter() - start
    place = np.asarray(mbs.GetSensorStoredData(sensor))
    if place.shape[0] != TIMES.size or not np.allclose(place[:, 0], TIMES):
        raise RuntimeError("Exudyn did not write at the times asked for")
    return place[:, 1:], seconds


def in_space(quick: bool) -> list[Line]:
    """The spin-up of B Ref. 21 about an axis that is inclined by 30 degrees, of a beam that bends
    alike both ways: the tip goes a third of the length out of the plane of rotation. Each against
    its own refinement, elements and steps: peaks of both agree to 1e-4."""
    if not installed("exudyn"):
        return []
    beam = common.aluminium_in_space()

    def ours(model: Any) -> Callable[..., Any]:
        @jax.jit
        def run(speed: Any, tolerance: Any) -> Any:
            found = jb.simulate(
                model, jb.Rotor(beam),
                jb.SmoothSpinUp(speed, DURATION, jnp.asarray(INCLINED)), TIMES,
                stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
                max_steps=100_000, throw=False,
            )  # fmt: skip
            return found.partial.tip[:, 1:], found.solution.stats["num_steps"]

        return run

    lines = []
    best = np.asarray(ours(jb.SpatialRod(8 if quick else 10))(4.0, 1e-8)[0])
    degrees = (5,) if quick else (4, 5, 6, 8)
    for degree in degrees:
        run = ours(jb.SpatialRod(degree))
        for tolerance in (1e-3, 1e-4) if quick else (1e-3, 3e-4, 1e-4, 1e-5, 1e-6):
            seconds, first, (tip, steps) = median(
                1 if quick else 5, run, 4.0, tolerance, first=(0.0, tolerance)
            )
            setting, remark = f"degree {degree}, {tolerance:g}", f"{int(steps)} steps"
            error = off(tip, best)
            lines.append(Line("jaxbeam rod", setting, seconds, error, first, remark))
            say(lines[-1])
    best = exudyn_in_space(32 if quick else 48, 0.005 if quick else 0.0025)[0]
    sizes = ((8, 0.01), (16, 0.01)) if quick else ((8, 0.02), (8, 0.01), (12, 0.02), (12, 0.01),
                                                  (16, 0.01), (24, 0.01), (24, 0.005))  # fmt: skip
    for elements, h in sizes:
        tip, seconds = exudyn_in_space(elements, h)
        lines.append(Line("Exudyn", f"{elements}, {h:g} s", seconds, off(tip, best), np.nan))
        say(lines[-1])
    return lines


def exudyn_in_space(elements: int, h: float, speed: float = 4.0) -> tuple[np.ndarray, float]:
    """Deflections of the tip at TIMES in axes of the hub (T, 2), and seconds: ANCFCable, whose
    tangent at the root is led along."""
    sys.exudynFast = True  # type: ignore[attr-defined]
    import exudyn as exu
    import exudyn.itemInterface as items
    from exudyn.beams import GenerateStraightLineANCFCable

    def turned(t: float) -> np.ndarray:
        """The axes of the hub, in columns."""
        angle = spun(t, speed)
        cross = np.cross(np.eye(3), INCLINED)
        turn: np.ndarray = np.eye(3) + math.sin(angle) * cross
        return turn + (1 - math.cos(angle)) * cross @ cross

    mbs = exu.SystemContainer().AddSystem()
    cable = items.ObjectANCFCable(
        physicsMassPerLength=float(REF_21.mass_per_length),
        physicsBendingStiffness=float(REF_21.in_plane_bending_stiffness),
        physicsAxialStiffness=float(REF_21.axial_stiffness),
    )
    length = float(REF_21.length)
    nodes, *_ = GenerateStraightLineANCFCable(
        mbs, [0, 0, 0], [length, 0, 0], elements, cable, fixedConstraintsNode0=[1, 1, 1, 0, 0, 0]
    )
    ground = mbs.AddNode(items.NodePointGround())
    fixed = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    for i in range(3):

        def led(_: Any, t: float, *__: Any, i: int = i) -> float:
            return float(turned(t)[i, 0]) - (i == 0)

        own = mbs.AddMarker(items.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=3 + i))
        mbs.AddObject(
            items.CoordinateConstraint(markerNumbers=[fixed, own], offsetUserFunction=led)
        )
    place, seconds = exudyn_solved(mbs, nodes[-1], h)
    own_axes = np.stack([turned(t).T @ x for t, x in zip(TIMES, place, strict=True)])
    return own_axes[:, 1:], seconds


def spun(t: float, speed: float) -> float:
    """The angle of the hub."""
    if t >= DURATION:
        return speed * (t - DURATION / 2)
    wave = DURATION / (4 * math.pi**2) * (math.cos(2 * math.pi * t / DURATION) - 1)
    return speed * (t * t / (2 * DURATION) + wave)


def batches(quick: bool) -> list[Line]:
    """256 speeds (or 64) from 1 to 6 rad/s, the worst case 1e-4 off: in lanes, in a loop, by
    Exudyn."""
    size, width = 64 if quick else 256, 32
    speeds = np.linspace(1.0, 6.0, size)
    index = np.linspace(0, size - 1, 4 if quick else 16).astype(int)
    sample = speeds[index]

    @jax.jit
    def ours(speed: Any, finer: Any = 1.0) -> tuple[Any, Any]:
        # Deflections go with the speed, so the tolerance does.
        control = diffrax.PIDController(rtol=3e-4 * finer, atol=1.5e-5 * finer * speed)
        return spin_up(speed, jb.solvers.Rodas5P(), control, None)

    reference = np.asarray(jax.jit(jax.vmap(lambda s: ours(s, 1e-3 if quick else 1e-5)[0]))(sample))
    together = jax.jit(jax.vmap(ours))
    chunks = np.split(speeds, size // width)  # neighbours need about as many steps
    out = []

    def worst(tips: Any) -> float:
        return max(off(a, b) for a, b in zip(tips, reference, strict=True))

    def on_both() -> Any:
        with ThreadPoolExecutor(CORES) as pool:
            return [np.asarray(tip) for tip, _ in pool.map(together, chunks)]

    for method, run in (
        (f"in lanes, {CORES} threads", on_both),
        ("in lanes, one thread", lambda: [together(c)[0] for c in chunks]),
        ("loop", lambda: [jax.block_until_ready(ours(s)[0])[None] for s in speeds]),
    ):
        seconds, first, tips = median(1 if quick else 3, run)
        error = worst(np.concatenate(tips)[index])
        out.append(Line(f"jaxbeam {method}", "rtol 3e-4", seconds / size, error, first))
        say(out[-1])
    if installed("exudyn"):
        some = sample if quick else sample[::2]
        exact = [exudyn_run(s, 0.0004)[0] for s in (1.0, 6.0)]
        for h in (0.0025,) if quick else (0.005, 0.0025, 0.002):
            error = max(off(exudyn_run(s, h)[0], e) for s, e in zip((1.0, 6.0), exact, strict=True))
            with ProcessPoolExecutor(CORES, mp_context=get_context("spawn")) as pool:
                list(pool.map(exudyn_run, some[:CORES], [h] * CORES))  # imports
                start = time.perf_counter()
                list(pool.map(exudyn_run, some, [h] * len(some)))
                seconds = (time.perf_counter() - start) / len(some)
            out.append(Line(f"Exudyn, {CORES} processes", f"{h:g} s", seconds, error, np.nan))
            say(out[-1])
    return out


def slow_spin_up(quick: bool) -> list[Line]:
    """Y Fig. 6, hybrid model: stiff in stretch, slow in all that matters."""
    repeats = 1 if quick else 3
    rotor = jb.Rotor(jb.Beam(10.0, 1.2, 2.8e7, 1.4e4, 1.4e4))
    end = 30.0 if quick else 150.0
    model, times = jb.Hybrid(3, 4, 0), np.linspace(0.0, end, 301)

    def runs(solver: Any, fixed: bool) -> Callable[..., Any]:
        @jax.jit
        def run(speed: Any, setting: Any) -> Any:
            return jb.simulate(
                model, rotor, jb.SmoothSpinUp(speed, 120.0), times, solver=solver,
                dt0=setting if fixed else None, max_steps=10_000_000, throw=False,
                stepsize_controller=(
                    diffrax.ConstantStepSize()
                    if fixed
                    else diffrax.PIDController(rtol=setting, atol=setting)
                ),
            ).partial.tip[:, 1]  # fmt: skip

        return run

    best = np.asarray(runs(jb.solvers.Rodas5P(), True)(6.0, 0.0125))
    lines = []
    tried: tuple[tuple[str, Any, bool, tuple[float, ...]], ...] = (
        ("jaxbeam Magnus", jb.solvers.Magnus(), True, (0.3, 0.15, 0.075)),
        ("diffrax Dopri8", diffrax.Dopri8(), False, (1e-8,) if quick else (1e-5, 1e-8)),
        ("jaxbeam Rodas5P", jb.solvers.Rodas5P(), True, (0.2, 0.1, 0.08, 0.05)),
        ("diffrax KenCarp4", diffrax.KenCarp4(), False, (1e-7, 1e-8, 1e-9)),
    )
    for name, solver, fixed, settings in tried[: 2 if quick else 4]:
        run = runs(solver, fixed)
        for setting in settings:
            seconds, first, tip = median(repeats, run, 6.0, setting, first=(0.0, setting))
            unit = " s" if fixed else ""
            lines.append(Line(name, f"{setting:g}{unit}", seconds, off(tip, best), first))
            say(lines[-1])
    return lines


def eigenvalues(quick: bool) -> list[Line]:
    """Lowest three modes with labels and shapes, with hub and tip mass, gamma up to 12: the
    frequencies in plane against the continuum (24 + 12 polynomials, right to 1e-11). Few at once
    go by dense matrices, case by case."""
    cases = 2_000 if quick else 10_000
    table, at = common.random_cases(cases, seed=1), common.rotating
    sample = table[:50]

    def modes(model: Any, which: Any) -> Callable[[Any], Any]:
        return jax.jit(jax.vmap(lambda v: jb.modes(model, *at(v), which, throw=False)))

    inside, both_planes = jb.labels(in_plane=3), jb.labels(in_plane=2, flap=1)
    judge = modes(jb.Hybrid(12, 24, 0), inside)
    exact = np.asarray(judge(sample).frequency)
    lines = []
    plane, space, elements = jb.Hybrid(8, 16, 0), jb.Hybrid(8, 16, 16), jb.papers.ANCF(10)
    many, few = cases, 200
    tried: tuple[tuple[str, Any, Any, int], ...] = (
        ("modes, 16 + 8 polynomials", plane, inside, many),
        ("modes, 16 + 8 + 16 with flap", space, both_planes, many),
        ("modes, 10 elements", elements, inside, many),
        ("modes, 16 + 8 polynomials", plane, inside, few),
        ("modes, 16 + 8 + 16 with flap", space, both_planes, few),
        ("modes, 10 elements", elements, inside, few),
    )
    for name, model, which, size in tried[:: 5 if quick else 1]:
        run, use = modes(model, which), np.asarray(table[:size])
        parts = np.array_split(use, CORES)

        def threaded(run: Any = run, parts: Any = parts) -> Any:
            with ThreadPoolExecutor(CORES) as pool:
                done = list(pool.map(lambda part: jax.block_until_ready(run(part)), parts))
            return jax.tree.map(lambda *some: np.concatenate(some), *done)

        for threads, function in ((1, partial(run, use)), (CORES, threaded)):
            if size == few and threads > 1:
                continue
            seconds, first, found = median(1 if quick else 5, function)
            count = sum(label in inside for label in which)
            ours = np.asarray(found.frequency[:50, :count])
            error = float(np.max(np.abs(ours / exact[:, :count] - 1)))
            method = f"jaxbeam {name}, {threads} thread" + "s" * (threads > 1)
            lines.append(Line(method, f"{size} cases", seconds / size, error, first))
            say(lines[-1])

    linearised = jax.jit(lambda v: jb.papers.ANCF(10).linearise(*at(v), throw=False))
    systems = [jax.tree.map(np.asarray, linearised(v)) for v in sample]

    def loop() -> np.ndarray:
        found = []
        for system in systems:
            m, g, k = system.mass, system.gyroscopic, system.stiffness
            zero, one = np.zeros_like(m), np.eye(len(m))
            below = scipy.linalg.solve(m, np.concatenate([-k, -g], 1), assume_a="pos")
            lam = scipy.linalg.eig(np.block([[zero, one], [below]]), right=False)
            found.append(np.sort(lam.imag[lam.imag > 1e-6])[:3])
        return np.stack(found)

    seconds, _, found = median(1 if quick else 5, loop)
    error = float(np.max(np.abs(found / exact - 1)))
    lines.append(Line("scipy.linalg.eig, 10 elements", "50 cases", seconds / 50, error, np.nan))
    say(lines[-1])
    if installed("pybmodes"):
        light = np.asarray(sample[:20] * np.array([1.0, 1.0, 0.0, 1.0]))
        exact = np.asarray(judge(jnp.asarray(light)).frequency)
        seconds, _, found = median(3, lambda: np.stack([pybmodes_run(v) for v in light]))
        error = float(np.max(np.abs(found / exact - 1)))
        remark = "no tip mass"
        lines.append(Line("pyBModes, 10 elements", "20 cases", seconds / 20, error, np.nan, remark))
        say(lines[-1])
    return lines


def pybmodes_run(case: Any) -> np.ndarray:
    """Lowest three frequencies in plane of (speed, hub radius, tip mass, slenderness)."""
    from pybmodes.io.bmi import BMIFile, ScalingFactors, TipMassProps
    from pybmodes.io.sec_props import SectionProperties
    from pybmodes.models._pipeline import run_fem

    speed, hub, tip, slenderness = (float(x) for x in case)
    one, none, n = np.ones(2), np.zeros(2), 10
    section = SectionProperties(
        title="", n_secs=2, span_loc=np.array([0.0, 1.0]), str_tw=none, tw_iner=none, mass_den=one,
        flp_iner=1e-9 * one, edge_iner=1e-9 * one, flp_stff=one, edge_stff=one, tor_stff=1e3 * one,
        axial_stff=slenderness**2 * one, cg_offst=none, sc_offst=none, tc_offst=none,
    )  # fmt: skip
    at_tip = TipMassProps(**{**dict.fromkeys(TipMassProps.__dataclass_fields__, 0.0), "mass": tip})
    blade = BMIFile(
        title="", echo=False, beam_type=1, rot_rpm=speed * 30 / np.pi, rpm_mult=1.0,
        radius=1.0 + hub, hub_rad=hub, precone=0.0, bl_thp=0.0, hub_conn=1, n_modes_print=10,
        tab_delim=False, mid_node_tw=False, tip_mass=at_tip, id_mat=1, sec_props_file="",
        scaling=ScalingFactors(), n_elements=n, el_loc=np.linspace(0.0, 1.0, n + 1),
    )  # fmt: skip
    found = run_fem(blade, 10, section).shapes
    lag = [s.freq_hz for s in found if np.ptp(s.lag_disp) > np.ptp(s.flap_disp)]
    return 2 * np.pi * np.array(lag[:3])


def installed(package: str) -> bool:
    """Whether a peer is there; says so once if it is not."""
    try:
        importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        print(f"  ({package} is not installed: left out)")
        return False
    return True


def say(line: Line) -> None:
    print(
        f"  {line.method:50s} {line.setting:>11s} {line.seconds * 1e3:12.4f} ms"
        f"   error {line.error:7.1e}   compiled in {line.compilation:4.1f} s   {line.remark}",
        flush=True,
    )


def ratios(lines: list[Line]) -> None:
    """What the table says of ours against the others."""

    def best(scene: str, start: str, error: float = np.inf, others: str = "") -> tuple[float, str]:
        names = {x.method for x in lines if x.scene == scene and x.method.startswith(start)}
        names = {x for x in names if not (others and x.startswith(others))}
        times = {x: at_error([y for y in lines if y.scene == scene], x, error) for x in names}
        times = {x: t for x, t in times.items() if np.isfinite(t)}
        name = min(times, key=times.__getitem__) if times else start
        return times.get(name, np.nan), name

    def tell(scene: str, ours: str, starts: tuple[str, ...], error: float = np.inf) -> None:
        seconds, mine = best(scene, ours, error)
        for start in starts:
            theirs, name = best(scene, start, error, ours)
            at = f" at an error of {error:g}" if np.isfinite(error) else ""
            ratio = theirs / seconds
            how = f"{ratio:.3g} times as fast as" if np.isfinite(ratio) else "not met there by"
            print(f"  {scene}{at}: {mine} is {how} {name}")

    print("\nRatios")
    tell("B Ref. 21, 4 rad/s", "jaxbeam Rodas5P", ("diffrax", "SciPy", "Exudyn"), 1e-5)
    tell("B Ref. 21, axis inclined", "jaxbeam", ("Exudyn",), 1e-3)
    tell("Y Fig. 6, hybrid", "jaxbeam", ("diffrax",), 1e-8)
    for scene, start, others, error in (
        ("many speeds, 1 to 6 rad/s", "jaxbeam in lanes", ("jaxbeam loop", "Exudyn"), 1e-4),
        ("frequencies, in plane", "jaxbeam", ("scipy", "pyBModes"), np.inf),
    ):
        for name in dict.fromkeys(x.method for x in lines if x.scene == scene):
            if name.startswith(start):
                tell(scene, name, others, error)


def main(quick: bool = False, out: Path | None = None) -> Path:
    """Run all of it; returns the folder that holds the table."""
    began = time.perf_counter()
    out = common.folder(out, "peers")
    names = ("jaxbeam", "jax", "jaxlib", "diffrax", "numpy", "scipy", "exudyn", "pybmodes")
    versions = []
    for name in names:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            versions.append(f"{name} -")
    print(f"{', '.join(versions)}; Python {platform.python_version()}; {CORES} cores")
    lines: list[Line] = []
    for title, part in (
        ("B Ref. 21, 4 rad/s", spin_ups), ("B Ref. 21, axis inclined", in_space),
        ("many speeds, 1 to 6 rad/s", batches),
        ("Y Fig. 6, hybrid", slow_spin_up), ("frequencies, in plane", eigenvalues),
    ):  # fmt: skip
        print(f"\n{title} (a case)")
        lines += [line._replace(scene=title) for line in part(quick)]
    common.write_csv(out / "peers.csv", Line._fields, lines)
    ratios(lines)
    print()
    return common.finish(began, "the table is", out)


if __name__ == "__main__":
    common.run(main, __doc__, "fewer of all, in three minutes", "the table", keeps=False)
