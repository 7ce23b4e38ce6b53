"""Random scenes: every outcome is a finite answer in balance, or says what is wrong.

Hypothesis draws the numbers of scenes whose static parts (model, motion, solver) are few, since each
of these compiles for seconds. Most scenes are sensible: slender beams, with speeds, times and forces
in units of their own. In some, one or two numbers are zero, negative, not finite, or absurd.

A failure prints its scene, and a line that makes Hypothesis draw it again. Seeds are random; for more
scenes of all kinds:

    FUZZ_FACTOR=20 python -m pytest -m slow tests/test_fuzz.py
"""

import contextlib
import faulthandler
import functools
import math
import os
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

import jaxbeam as jb
from jaxbeam import Family, Status

from .helpers import name

FACTOR = float(os.environ.get("FUZZ_FACTOR", "1"))
LONGEST = 300.0  # s for one scene, with its compilation on a busy machine
EPS = np.finfo(float).eps


def examples(number):
    """So many scenes, times FUZZ_FACTOR."""
    return settings(
        max_examples=max(1, round(number * FACTOR)),
        derandomize=False,  # which it is where CI is set
        database=None,
        deadline=None,
        print_blob=True,
        suppress_health_check=[HealthCheck.too_slow],
    )


@pytest.fixture(scope="module")
def terminal(request):
    """Where a traceback is seen although pytest captures what tests write."""
    with request.config.pluginmanager.getplugin("capturemanager").global_and_fixture_disabled():
        copy = os.dup(2)
    yield copy
    os.close(copy)


@contextlib.contextmanager
def watched(terminal):
    """End the process with a traceback where a scene does not end. NumPy need not warn: what is
    not finite is found by comparisons."""
    faulthandler.dump_traceback_later(LONGEST, exit=True, file=terminal)
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        faulthandler.cancel_dump_traceback_later()


# Numbers of scenes ---------------------------------------------------------------------------

BAD = 0.0, -1.0, math.nan, math.inf, -math.inf
ABSURD = 1e-300, 1e-30, 1e30, 1e300  # and yet in range
POSITIVE = {
    "length": Status.INVALID_LENGTH,
    "mass_per_length": Status.INVALID_MASS_PER_LENGTH,
    "axial_stiffness": Status.INVALID_AXIAL_STIFFNESS,
    "in_plane_bending_stiffness": Status.INVALID_IN_PLANE_BENDING_STIFFNESS,
    "flap_bending_stiffness": Status.INVALID_FLAP_BENDING_STIFFNESS,
    "mass": Status.INVALID_MASS,
    "translational_spring": Status.INVALID_TRANSLATIONAL_SPRING,
    "torsional_spring": Status.INVALID_TORSIONAL_SPRING,
    "duration": Status.INVALID_MOTION,
    "down_at": Status.INVALID_MOTION,
    "frequency": Status.INVALID_MOTION,
    "end": Status.INVALID_TIMES,
}
NOT_NEGATIVE = {
    "hub_radius": Status.INVALID_HUB_RADIUS,
    "tip_mass": Status.INVALID_TIP_MASS,
    "mass_damping": Status.INVALID_DAMPING,
    "stiffness_damping": Status.INVALID_DAMPING,
}
FINITE = {
    "angular_speed": Status.INVALID_MOTION,
    "depth": Status.INVALID_MOTION,
    "axis": Status.INVALID_MOTION,
    "gravity": Status.INVALID_LOAD,
    "force": Status.INVALID_LOAD,
    "start": Status.INVALID_START,
}
BEAM = "length", "mass_per_length", "axial_stiffness", *list(POSITIVE)[3:5]
ROTOR = *BEAM, "hub_radius", "tip_mass"
SPRINGS = "mass", "length", "hub_radius", "translational_spring", "torsional_spring"


def decades(low, high):
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


def sizes(low, high):
    """Zero, or a number between these decades."""
    return st.one_of(st.just(0.0), *3 * [decades(low, high)])


def signed(numbers):
    return st.tuples(numbers, st.sampled_from([1.0, -1.0])).map(math.prod)


@st.composite
def rotors(draw, model):
    """A rotor, its unit of frequency (rad/s) and of force (N)."""
    length, unit = draw(decades(-2, 2)), draw(decades(-1, 2))
    slenderness = draw(decades(1, 3.5))
    if model.rotor_type is jb.SpringRotor:
        mass = draw(decades(-3, 3))
        torsional = unit**2 * mass * length**2
        rotor = {
            "mass": mass,
            "length": length,
            "hub_radius": length * draw(sizes(-2, 1)),
            "translational_spring": torsional * slenderness / length**2,
            "torsional_spring": torsional,
        }
        return rotor, unit, torsional / length
    density = draw(decades(-3, 3))
    bending = unit**2 * density * length**4
    rotor = {
        "length": length,
        "mass_per_length": density,
        "axial_stiffness": bending * (slenderness / length) ** 2,
        "in_plane_bending_stiffness": bending,
        "flap_bending_stiffness": bending * draw(decades(-1, 1)),
        "hub_radius": length * draw(sizes(-2, 1)),
        "tip_mass": density * length * draw(sizes(-2, 1)),
    }
    return rotor, unit, bending / length**2


def spoiled(draw, numbers):
    """Most often as they are."""
    for which in draw(
        st.just([])
        | st.just([])
        | st.lists(st.sampled_from(list(numbers)), min_size=1, max_size=2, unique=True)
    ):
        numbers[which] = draw(st.sampled_from(BAD + ABSURD))
    return numbers


@st.composite
def spinning(draw, model):
    """A rotor, with its speed."""
    rotor, unit, _ = draw(rotors(model))
    return spoiled(draw, rotor | {"angular_speed": unit * draw(signed(sizes(-2, 1.5)))})


def build(model, p):
    """The rotor of these numbers."""
    if model.rotor_type is jb.SpringRotor:
        return jb.SpringRotor(*(p[key] for key in SPRINGS))
    return jb.Rotor(jb.Beam(*(p[key] for key in BEAM)), p["hub_radius"], p["tip_mass"])


def broken(model, p, *others, **instead):
    """Status of the first number that is out of range: of the rotor, then of these others."""
    for key in (SPRINGS if model.rotor_type is jb.SpringRotor else ROTOR) + others:
        value = p.get(key, 1.0)
        least = 0.0 if key in NOT_NEGATIVE else 5e-324 if key in POSITIVE else -math.inf
        if not (math.isfinite(value) and value >= least):
            return instead.get(key) or (POSITIVE | NOT_NEGATIVE | FINITE)[key]
    return None


def absurd(p):
    return any(abs(value) in ABSURD for value in p.values())


def judged(found, expected, p, ok):
    """The status, checked: that of what is out of range, exactly; NaN is never OK."""
    status = Status(int(found["status"]))
    event(f"{status.name}{', absurd' if absurd(p) else ''}")
    assert status.message
    if expected is not None and (expected <= Status.INVALID_TORSIONAL_SPRING or not absurd(p)):
        assert status == expected
    elif expected is not None:
        assert status != Status.OK
    else:
        assert not Status.OK < status <= Status.INVALID_TORSIONAL_SPRING
        if not absurd(p):
            assert not Status.OK < status <= Status.OUT_OF_PLANE
    if status == Status.OK:
        for key in ok:
            assert np.isfinite(found[key]).all(), key
    return status


def evaluated(function, p):
    """With all numbers as arrays, so that one compiled function takes every scene."""
    out = function({key: np.asarray(value) for key, value in p.items()})
    return jax.tree.map(np.asarray, out)


# Motions -------------------------------------------------------------------------------------

OUTPUTS = 129
PATTERN = np.cos(np.arange(40.0))  # of coordinates at the start


class Case(NamedTuple):
    """What compiles anew: `extras` are loads, damping, start (steady, then pushed), space."""

    model: jb.AbstractModel
    motion: str
    extras: str = ""
    solver: Any = None
    steps: str = ""  # adaptive: tolerances are drawn; fixed: their number is
    max_steps: int = 6000

    def __str__(self):
        solver = type(self.solver).__name__ if self.solver else ""
        return " ".join(filter(None, (name(self.model), self.motion, self.extras, solver)))


CASES = [
    Case(jb.Hybrid(2, 3, 0), "smooth"),
    Case(jb.Hybrid(1, 2, 1), "modulated", "loads damping space"),
    Case(jb.Hybrid(0, 1, 0), "modulated", "loads", diffrax.Tsit5(), "adaptive"),
    Case(jb.Classical(1, 2, 0), "constant", "start"),
    Case(jb.VonKarman(3, 2, 0), "quintic", "damping"),
    Case(jb.GreenANCF(2), "up and down", "loads damping"),
    Case(jb.GreenANCF(4), "smooth", "", None, "adaptive"),
    Case(jb.GreenANCF(2), "quintic", "", jb.ChordKvaerno5(), "fixed"),
    Case(jb.ANCF(2), "quintic", "loads"),
    Case(jb.ChordANCF(2), "smooth", "damping"),
    Case(jb.DiscreteNC(), "quintic", "loads damping"),
    Case(jb.DiscreteNP(), "constant", "start", None, "", 300),
]
MOTIONS = {
    "constant": lambda p, axis: jb.ConstantSpeed(p["angular_speed"], axis),
    "smooth": lambda p, axis: jb.SmoothSpinUp(p["angular_speed"], p["duration"], axis),
    "quintic": lambda p, axis: jb.QuinticSpinUp(p["angular_speed"], p["duration"], axis),
    "modulated": lambda p, axis: jb.ModulatedSpeed(
        p["angular_speed"], p["depth"], p["frequency"], axis
    ),
    "up and down": lambda p, axis: jb.SpinUpThenDown(
        jb.SmoothSpinUp(p["angular_speed"], p["duration"], axis), p["down_at"]
    ),
}


@st.composite
def scenes(draw, case):
    """In units of the frequency, length and stiffness of the beam."""
    p, unit, force = draw(rotors(case.model))
    period, length = 2 * math.pi / (3.5 * unit), p["length"]
    p["angular_speed"] = unit * draw(signed(sizes(-2, 1.2)))
    duration = period * draw(decades(-0.5, 1))
    if case.motion == "modulated":
        p["depth"] = draw(signed(sizes(-2, 0)))
        p["frequency"] = unit * draw(decades(-0.5, 1.5))
    elif case.motion != "constant":
        p["duration"] = duration
    if case.motion == "up and down":
        p["down_at"] = duration * draw(st.floats(0.1, 2.0))
    p["end"] = duration * draw(st.floats(0.3, 2.5))
    if "space" in case.extras:
        p["axis"] = draw(st.floats(-3.2, 3.2))
    if "loads" in case.extras:
        p["gravity"] = unit**2 * length * draw(signed(sizes(-4, -0.5)))
        p["force"] = force * draw(signed(sizes(-4, -0.5)))
    if "damping" in case.extras:
        p["mass_damping"] = unit * draw(sizes(-3, 1))
        p["stiffness_damping"] = draw(sizes(-4, 0)) / unit
    if "start" in case.extras:
        p["start"] = length * draw(signed(sizes(-6, -1.5)))
    if case.steps == "adaptive":
        tolerance = draw(decades(-9, -2))
        tolerances = {"rtol": tolerance, "atol": tolerance * length * draw(decades(-6, -1))}
    elif case.steps == "fixed":
        tolerances = {"steps": float(draw(st.integers(16, 1024)))}
    else:
        tolerances = {}
    return spoiled(draw, p) | tolerances


@functools.cache
def simulation(case):
    """Compiled: everything that is looked at, by the numbers of a scene."""
    model, n = case.model, len(case.model.families)

    def controls(p):
        if case.steps == "adaptive":
            return {"stepsize_controller": diffrax.PIDController(rtol=p["rtol"], atol=p["atol"])}
        if case.steps == "fixed":
            steps = diffrax.ConstantStepSize()
            return {"stepsize_controller": steps, "dt0": p["end"] / p["steps"]}
        return {}

    def run(p):
        rotor = build(model, p)
        axis = jb.inclined(p["axis"]) if "axis" in p else None
        motion = MOTIONS[case.motion](p, axis)
        loads = damping = None
        if "gravity" in p:
            # Off the plane where there is a flap coordinate.
            aside = 0.3 if Family.FLAP in model.families else 0.0
            direction = np.array([0.4, -1.0, aside])
            loads = jb.Loads(p["gravity"] * direction, p["force"] * direction[[1, 0, 2]])
        if "mass_damping" in p:
            damping = jb.Damping(p["mass_damping"], p["stiffness_damping"])
        start = None
        if "start" in p:
            start = jb.steady_start(model, rotor, motion, loads=loads, throw=False)
            scale = 1.0
            if model.rotor_type is jb.SpringRotor:
                scale = 1 / p["length"]
            start = jb.State(start.q + p["start"] * scale * PATTERN[:n], start.v)
        found = jb.simulate(
            model, rotor, motion, p["end"] * np.linspace(0.0, 1.0, OUTPUTS), loads=loads,
            damping=damping, start=start, solver=case.solver, max_steps=case.max_steps,
            throw=False, **controls(p),
        )  # fmt: skip
        asked = jb.State(jnp.zeros(n), jnp.zeros(n)) if start is None else start
        parts, gained, power = jax.vmap(functools.partial(books, found.scene))(
            found.times, found.state
        )
        return {
            "status": found.status,
            "times": found.times,
            "end_time": found.end_time,
            "missed": (found.state.q[0] - asked.q, found.state.v[0] - asked.v),
            "q": found.state.q,
            "v": found.state.v,
            "tip": found.tip,
            "energy": found.energy,
            "torque": found.hub_torque,
            "imbalance": found.imbalance,
            "peak": jnp.stack(found.peak()),
            "steps": found.solution.stats["num_steps"],
            "parts": parts,
            "gained": gained,
            "power": power,
        }

    return jax.jit(run)


def books(scene, t, y):
    """Energies seen from the hub; energy in the inertial frame beyond that of the rigid beam; and
    the power of hub, loads and damping that must be its rate."""
    hub, equations, spin = scene.hub(t), scene.equations, scene.hub(t).angular_velocity
    mass, first, second = equations.rigid
    inertia, none = second * np.array([0.0, 1.0, 1.0]), jnp.zeros(3)
    rigid = spin @ (inertia * spin) / 2, hub.angular_velocity_rate @ (inertia * spin)
    power = scene.reaction(t, y)[1] @ spin - rigid[1]

    def of(force, moment, along):
        at, moved = jax.jvp(moment, (y.q,), (y.v,))
        return force @ (moved + jnp.cross(spin, at.at[0].add(along)))

    power += of(hub.gravity, equations.first_moment, first)
    if (force := scene.loads.at_tip(t)) is not None:
        power += of(force, equations.tip, equations.end)
    lost = equations.nonconservative_force(y.q)
    if (rate := scene.damping.mass) is not None:
        lost += rate * jax.grad(equations.kinetic_energy, 1)(y.q, y.v, none, none)
        lost += (
            scene.damping.stiffness * jax.jvp(equations.elastic_force, (y.q,), (y.v,))[1]
        )
    parts = jnp.stack(scene.energies(t, y))
    return parts, scene.total_energy(t, y) - rigid[0], power - lost @ y.v


def simpson(values, width):
    return width / 3 * (values[0] + values[-1] + 4 * values[1::2].sum() + 2 * values[2:-1:2].sum())


def check_simulation(case, p):
    found = evaluated(simulation(case), p)
    others = ("end", "mass_damping", "stiffness_damping", "angular_speed", "duration", "down_at")
    others += ("depth", "frequency", "axis", "gravity", "force", "start")
    kept = ("times", "q", "v", "tip", "energy", "torque", "imbalance", "peak")
    status = judged(found, broken(case.model, p, *others), p, kept)
    worst = np.abs(found["imbalance"]).max()
    if status == Status.MAX_STEPS:
        assert found["steps"] == case.max_steps
    if status == Status.UNBALANCED:
        assert not worst <= 1e-3
    if status != Status.OK:
        return
    assert worst <= 1e-3
    np.testing.assert_allclose(found["times"], p["end"] * np.linspace(0, 1, OUTPUTS), rtol=1e-12)
    assert found["end_time"] == found["times"][-1]
    for difference in found["missed"]:
        assert (difference == 0).all()
    length = p["length"]
    assert (np.linalg.norm(found["tip"] / length, axis=1) <= 10).all()
    assert abs(found["peak"][0]) >= np.abs(found["tip"][:, 1]).max() * (1 - 1e-12)
    if absurd(p):
        return
    # the balance again, by quadrature and in the inertial frame, where outputs resolve it
    gained, power = found["gained"] - found["gained"][0], found["power"]
    width = p["end"] / (OUTPUTS - 1)
    work, coarse = simpson(power, width), simpson(power[::2], 2 * width)
    size = np.abs(found["parts"]).sum(1).max() + np.abs(found["gained"]).max()
    event("resolved" if abs(work - coarse) < 1e-3 * size else "not resolved")
    if os.environ.get("FUZZ_LOG"):
        import json
        with open(os.environ["FUZZ_LOG"], "a") as f:
            f.write(json.dumps([str(case), float(worst), float(abs(gained[-1] - work) / size), float(abs(work - coarse) / size), p]) + "\n")


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=str)
@examples(36)
@given(data=st.data())
def test_simulations(case, data, terminal):
    with watched(terminal):
        check_simulation(case, data.draw(scenes(case), "scene"))
