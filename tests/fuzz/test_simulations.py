"""Random simulations: in balance, at the times asked for, and from the start that was asked for."""

import functools
import math
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from hypothesis import event, given
from hypothesis import strategies as st

import jaxbeam as jb
from jaxbeam import Status
from jaxbeam._numerics.linalg import dense
from jaxbeam.models import Direction
from tests.fuzz.scenes import (
    absurd,
    broken,
    build,
    decades,
    evaluated,
    examples,
    judged,
    rotors,
    signed,
    sizes,
    spoiled,
)
from tests.helpers import name
from tests.tiers import slow

OUTPUTS = 257
PATTERN = np.cos(np.arange(40.0))  # of coordinates at the start


class Case(NamedTuple):
    """What compiles anew: `extras` are loads, damping, start (steady, then pushed), space."""

    model: jb.models.AbstractModel
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
    Case(jb.papers.GreenANCF(4), "up and down", "loads damping"),
    Case(jb.papers.GreenANCF(2), "quintic", "", jb.solvers.ChordKvaerno5(), "fixed"),
    Case(jb.papers.ANCF(2), "quintic", "loads"),
    Case(jb.papers.ChordANCF(2), "smooth", "damping"),
    Case(jb.papers.DiscreteNC(), "quintic", "loads damping"),
    slow(Case(jb.papers.DiscreteNP(), "constant", "start", None, "", 300)),
]
MOTIONS = {
    "constant": lambda p, axis: jb.ConstantSpeed(p["angular_speed"], axis),
    "smooth": lambda p, axis: jb.SmoothSpinUp(p["angular_speed"], p["duration"], axis),
    "quintic": lambda p, axis: jb.motions.QuinticSpinUp(p["angular_speed"], p["duration"], axis),
    "modulated": lambda p, axis: jb.motions.ModulatedSpeed(
        p["angular_speed"], p["depth"], p["frequency"], axis
    ),
    "up and down": lambda p, axis: jb.motions.SpinUpThenDown(
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
    model, n = case.model, len(case.model.directions)

    def controls(p):
        if case.steps == "adaptive":
            return {"stepsize_controller": diffrax.PIDController(rtol=p["rtol"], atol=p["atol"])}
        if case.steps == "fixed":
            steps = diffrax.ConstantStepSize()
            return {"stepsize_controller": steps, "dt0": p["end"] / p["steps"]}
        return {}

    def run(p):
        rotor = build(model, p)
        axis = jb.motions.inclined_axis(p["axis"]) if "axis" in p else None
        motion = MOTIONS[case.motion](p, axis)
        loads, damping = jb.Loads(), jb.Damping()
        if "gravity" in p:
            # Off the plane where there is a flap coordinate.
            aside = 0.3 if Direction.FLAP in model.directions else 0.0
            direction = np.array([0.4, -1.0, aside])
            loads = jb.Loads(p["gravity"] * direction, p["force"] * direction[[1, 0, 2]])
        if "mass_damping" in p:
            damping = jb.Damping(p["mass_damping"], p["stiffness_damping"])
        start = None
        if "start" in p:
            start = jb.steady_start(model, rotor, motion, loads=loads, throw=False)
            push = p["start"] * PATTERN[:n]
            if isinstance(model, jb.papers.DiscreteNP):
                push = push.at[1].divide(p["length"])  # an angle
            start = jb.solvers.State(start.q + push, start.v)
        found = jb.simulate(
            model, rotor, motion, p["end"] * np.linspace(0.0, 1.0, OUTPUTS), loads=loads,
            damping=damping, start=start, solver=case.solver, max_steps=case.max_steps,
            throw=False, **controls(p),
        )  # fmt: skip
        asked = jb.solvers.State(jnp.zeros(n), jnp.zeros(n)) if start is None else start
        energies, rates, power, damped = jax.vmap(functools.partial(books, found.scene))(
            found.times, found.state
        )
        equations, rest = found.scene.equations, jnp.zeros(n)
        still = found.scene.hub(found.times[0])
        stiffness, _ = equations.tangents(still, rest, rest, None)
        return {
            "status": found.status,
            "times": found.times,
            "end_time": found.end_time,
            "asked": (asked.q, asked.v),
            "q": found.state.q,
            "v": found.state.v,
            "tip": found.tip,
            "energy": found.energy,
            "torque": found.hub_torque,
            "imbalance": found.imbalance,
            "peak": jnp.stack(found.peak()),
            "steps": found.solution.stats["num_steps"],
            "parts": energies,
            "power": power,
            "damped": damped,
            "matrices": (dense(stiffness), dense(equations.mass)),
            "rates": rates,
        }

    return jax.jit(run)


def books(scene, t, y):
    """Energies seen from the hub, and energy in the inertial frame beyond that of the rigid beam;
    their rates, the last by the power of hub, loads and damping; this; and what damping takes."""
    hub, equations = scene.hub(t), scene.equations
    spin, none = hub.angular_velocity, jnp.zeros(3)
    _, first, second = equations.rigid_moments

    def carried_by(hub):
        """Energy of the rigid beam, and its rate."""
        momentum = second * np.array([0.0, 1.0, 1.0]) * hub.angular_velocity
        return momentum @ hub.angular_velocity / 2, momentum @ hub.angular_velocity_rate

    torque = scene.reaction(t, y)[1]
    power = torque @ spin - carried_by(hub)[1]

    def of(force, moment, along):
        at, moved = jax.jvp(moment, (y.q,), (y.v,))
        return force @ (moved + jnp.cross(spin, at.at[0].add(along)))

    power += of(hub.gravity, equations.first_moment, first)
    if (force := scene.loads.at_tip(t)) is not None:
        power += of(force, equations.tip, equations.tip_radius)
    lost = equations.nonconservative_force(y.q)
    damped = jnp.zeros_like(lost)
    if (damping := scene.damping).mass_coefficient is not None:
        damped += damping.mass_coefficient * jax.grad(equations.kinetic_energy, 1)(
            y.q, y.v, none, none
        )
        damped += damping.stiffness_coefficient * equations.viscous_force(y.q, y.v)
        lost += damped

    def energies(t, y):
        rigid = carried_by(scene.hub(t))[0]
        return jnp.stack([*scene.energies(t, y), scene.total_energy(t, y) - rigid])

    moving = jb.solvers.State(y.v, scene.acceleration(t, y.q, y.v))
    values, rates = jax.jvp(energies, (t, y), (jnp.ones_like(t), moving))
    return values, jnp.append(rates, power - lost @ y.v), torque @ spin, damped @ y.v


def integrals(rates, width):
    """By Simpson's rule, from the first time to every other one."""
    return np.cumsum(rates[:-1:2] + 4 * rates[1::2] + rates[2::2], 0) * width / 3


def check_simulation(case, p):
    found = evaluated(simulation(case), p)
    others = ["end", "mass_damping", "stiffness_damping", "angular_speed", "duration", "down_at"]
    others += ["depth", "frequency", "axis", "gravity", "force", "start"]
    kept = ["times", "q", "v", "tip", "imbalance", "peak"]
    if not absurd(p):  # or squares may overflow
        kept += ["energy", "torque", "parts", "rates"]
    expected = broken(case.model, p, *others)
    if expected is None and not np.isfinite(found["asked"]).all():
        expected = Status.INVALID_START  # of a steady rotation that was not found
    status = judged(found, expected, p, kept)
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
    for asked, key in zip(found["asked"], "qv", strict=True):
        np.testing.assert_array_equal(found[key][0], asked)
    assert (np.linalg.norm(found["tip"] / p["length"], axis=1) <= 10).all()
    if absurd(p):
        return
    assert abs(found["peak"][0]) >= np.abs(found["tip"][:, 1]).max() * (1 - 1e-12)
    # Energy beyond that of the rigid beam changes at the power of hub, loads and damping: of any
    # state, to rounding.
    energies, rates = found["parts"], found["rates"]
    size = (np.abs(rates).sum(1) + np.abs(found["power"])).max()
    size = max(size, 1e-200)  # products of numbers as small as that are rounded to the least number
    assert np.abs(rates[:, 3] - rates[:, 4]).max() <= 1e-10 * size
    assert (found["damped"] >= -1e-12 * size).all()
    # Integrated it is the change of energy, if output times resolve all that goes on. Where a beam
    # is bent far, nothing is known of how fast that is.
    width = p["end"] / (OUTPUTS - 1)
    fastest = max(
        np.sqrt(np.abs(scipy.linalg.eigvals(*found["matrices"])).max()),
        abs(p["angular_speed"]) * (1 + abs(p.get("depth", 0.0))),
        p.get("frequency", 0.0),
    )
    near = np.linalg.norm(found["tip"], axis=1).max() < 0.2 * p["length"]
    if near and fastest * width < 0.4:
        event("resolved")
        change = energies[2::2] - energies[:1]
        off = np.abs(integrals(rates[:, [0, 1, 2, 4]], width) - change).max()
        assert off <= 2e-3 * max(np.abs(energies).sum(1).max(), 1e-200)


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", CASES, ids=str)
@examples(36)
@given(data=st.data())
def test_simulations(case, data, watched):
    p = data.draw(scenes(case), "scene")
    with watched(p):
        check_simulation(case, p)
