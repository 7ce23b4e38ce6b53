"""Random scenes: every outcome is a finite answer in balance, or says what is wrong.

Hypothesis draws the numbers of scenes whose static parts (model, motion, solver) are few, since
each of these compiles for seconds. Most scenes are sensible: slender beams, with speeds, times and
forces in units of their own. In some, one or two numbers are zero, negative, not finite, or absurd.

A failure prints its scene, and a line that makes Hypothesis draw it again. Seeds are random; for
more scenes of all kinds:

    FUZZ_FACTOR=20 python -m pytest -m slow tests/test_fuzz*.py
"""

import functools
import math
from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from hypothesis import assume, event, given
from hypothesis import strategies as st

import jaxbeam as jb
from jaxbeam import Family, Status
from jaxbeam._numerics.linalg import dense
from tests.fuzzing import (
    BEAM,
    POSITIVE,
    SPRINGS,
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
    spinning,
    spoiled,
)
from tests.helpers import name

EPS = np.finfo(float).eps


# Motions -------------------------------------------------------------------------------------

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
    Case(jb.GreenANCF(2), "up and down", "loads damping"),
    Case(jb.GreenANCF(4), "smooth", "", None, "adaptive"),
    Case(jb.GreenANCF(2), "quintic", "", jb.solvers.ChordKvaerno5(), "fixed"),
    Case(jb.ANCF(2), "quintic", "loads"),
    Case(jb.models.ChordANCF(2), "smooth", "damping"),
    Case(jb.models.DiscreteNC(), "quintic", "loads damping"),
    Case(jb.models.DiscreteNP(), "constant", "start", None, "", 300),
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
        axis = jb.motions.inclined_axis(p["axis"]) if "axis" in p else None
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
            push = p["start"] * PATTERN[:n]
            if isinstance(model, jb.models.DiscreteNP):
                push = push.at[1].divide(p["length"])  # an angle
            start = jb.solvers.State(start.q + push, start.v)
        found = jb.simulate(
            model, rotor, motion, p["end"] * np.linspace(0.0, 1.0, OUTPUTS), loads=loads,
            damping=damping, start=start, solver=case.solver, max_steps=case.max_steps,
            throw=False, **controls(p),
        )  # fmt: skip
        asked = jb.solvers.State(jnp.zeros(n), jnp.zeros(n)) if start is None else start
        energies, rates, power = jax.vmap(functools.partial(books, found.scene))(
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
            "matrices": (dense(stiffness), dense(equations.mass)),
            "rates": rates,
        }

    return jax.jit(run)


def books(scene, t, y):
    """Energies seen from the hub, and energy in the inertial frame beyond that of the rigid beam;
    their rates, the last by the power of hub, loads and damping."""
    hub, equations = scene.hub(t), scene.equations
    spin, none = hub.angular_velocity, jnp.zeros(3)
    _, first, second = equations.rigid

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
        power += of(force, equations.tip, equations.end)
    lost = equations.nonconservative_force(y.q)
    if (damping := scene.damping).mass is not None:
        lost += damping.mass * jax.grad(equations.kinetic_energy, 1)(y.q, y.v, none, none)
        lost += damping.stiffness * jax.jvp(equations.elastic_force, (y.q,), (y.v,))[1]

    def energies(t, y):
        rigid = carried_by(scene.hub(t))[0]
        return jnp.stack([*scene.energies(t, y), scene.total_energy(t, y) - rigid])

    moving = jb.solvers.State(y.v, scene.acceleration(t, y.q, y.v))
    values, rates = jax.jvp(energies, (t, y), (jnp.ones_like(t), moving))
    return values, jnp.append(rates, power - lost @ y.v), torque @ spin


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
    assert np.abs(rates[:, 3] - rates[:, 4]).max() <= 1e-10 * size
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
        assert off <= 2e-3 * np.abs(energies).sum(1).max()


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=str)
@examples(36)
@given(data=st.data())
def test_simulations(case, data, watched):
    p = data.draw(scenes(case), "scene")
    with watched(p):
        check_simulation(case, p)


# Steady rotation -----------------------------------------------------------------------------


@functools.cache
def vibration(model):
    """Compiled: all modes, and the matrices that they belong to."""

    def run(p):
        rotor, n = build(model, p), len(model.families)
        found = jb.modes(model, rotor, p["angular_speed"], n, throw=False)
        system = model.linearise(rotor, p["angular_speed"], throw=False)
        return {
            "status": found.status,
            "eigenvalue": found.eigenvalue,
            "shape": found.shape,
            "label": jnp.stack([found.family, found.order], -1),
            "energy_share": found.energy_share,
            "residual": found.residual,
            "steady_strain": found.steady_strain,
            "matrices": (system.mass, system.gyroscopic, system.stiffness),
            "linearised": system.status,
        }

    return jax.jit(run)


def check_modes(model, p):
    found = evaluated(vibration(model), p)
    kept = "eigenvalue", "shape", "energy_share", "residual", "steady_strain"
    expected = broken(model, p, "angular_speed", angular_speed=Status.INVALID_ANGULAR_SPEED)
    status = judged(found, expected, p, kept)
    assert status in (Status.OK, found["linearised"]) or found["linearised"] == Status.OK
    assert status == Status.OK or np.isnan(found["eigenvalue"]).all()
    if status != Status.OK or absurd(p):
        return
    (m, g, k), lam, x = found["matrices"], found["eigenvalue"], found["shape"]
    assert (lam.imag >= 0).all()
    square = (lam**2).real
    assert (np.diff(square) <= 1e-9 * np.abs(square[1:])).all()  # lowest first
    labels = [tuple(label) for label in found["label"]]
    assert sorted(labels) == [
        (family, order + 1) for family in Family for order in range(model.families.count(family))
    ]
    np.testing.assert_allclose(found["energy_share"].sum(1), 1, rtol=1e-9)
    # what `residual` says, again
    norm, size = np.linalg.norm, np.abs(lam)
    q = lam[:, None] ** 2 * (x @ m.T) + lam[:, None] * (x @ g.T) + x @ k.T
    scale = size**2 * norm(m) + size * norm(g) + norm(k)
    assert (norm(q, axis=1) <= 1.1e-9 * scale * norm(x, axis=1)).all()
    # All are there: the product of their squares is det K / det M; and as many grow as K has
    # negative eigenvalues (the reasons are in `jaxbeam._vibration.critical_speed`).
    scaled = np.sqrt(np.diag(m))
    m, k = (a / scaled / scaled[:, None] for a in (m, k))
    spread = np.abs(np.linalg.eigvalsh(k))
    lost = len(m) * EPS * (spread.max() / spread.min() + np.linalg.cond(m))
    product = np.linalg.slogdet(k)[1] - np.linalg.slogdet(m)[1]
    assert abs(2 * np.log(size).sum() - product) <= 1e-8 + 100 * lost
    if lost < 1e-3:
        assert (lam.real > 1e-6 * size).sum() == (np.linalg.eigvalsh(k) < 0).sum()


VIBRATING = [
    jb.Hybrid(2, 4, 2), jb.Classical(2, 3, 2), jb.VonKarman(3, 2, 2), jb.GreenANCF(2),
    jb.models.ChordANCF(2), jb.models.SmallStrainANCF(2), jb.models.DiscreteNC(),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("model", VIBRATING, ids=name)
@examples(24)
@given(data=st.data())
def test_modes(model, data, watched):
    p = data.draw(spinning(model), "scene")
    with watched(p):
        check_modes(model, p)


@examples(12)
@given(data=st.data())
def test_few_modes(data, watched):
    """Of the smallest model, for the quick part."""
    model = jb.Hybrid(0, 1, 1)
    p = data.draw(spinning(model), "scene")
    with watched(p):
        check_modes(model, p)


@functools.cache
def both_frequencies(model):
    def run(p):
        case = model, build(model, p), p["angular_speed"]
        fast = jb.frequencies(*case, 3, throw=False)
        found = jb.modes(*case, len(model.families), throw=False)
        return {
            "status": fast.status,
            "frequency": fast.frequency,
            "modes": found.frequency,
            "modes_status": found.status,
            "steady_strain": found.steady_strain,
        }

    return jax.jit(run)


@pytest.mark.slow
@pytest.mark.parametrize("model", [jb.Hybrid(4, 8, 0), jb.GreenANCF(3)], ids=name)
@examples(24)
@given(data=st.data())
def test_frequencies(model, data, watched):
    """Those of `modes`."""
    p = data.draw(spinning(model), "scene")
    with watched(p):
        found = evaluated(both_frequencies(model), p)
        expected = broken(model, p, "angular_speed", angular_speed=Status.INVALID_ANGULAR_SPEED)
        status = judged(found, expected, p, ["frequency"])
        assert (status == Status.OK) == np.isfinite(found["frequency"]).all()
        if status != Status.OK or found["modes_status"] != Status.OK or absurd(p):
            return
        np.testing.assert_allclose(found["frequency"], found["modes"][:3], rtol=1e-8)


@functools.cache
def stiffening(model):
    """Compiled: Southwell coefficients, and squares of frequencies at neighbouring speeds."""
    which = jb.labels(in_plane=2)

    def run(p):
        rotor, speed = build(model, p), p["angular_speed"]
        slope = jb.southwell(model, rotor, speed, which, throw=False)
        unit = rotor.beam.frequency_scale
        scale = jnp.where(speed == 0, unit, jnp.maximum(jnp.abs(speed), unit / 10))

        def square(speed):
            found = jb.modes(model, rotor, speed, which, throw=False)
            return -(found.eigenvalue**2).real

        # from rest, and to both sides of a speed
        steps = 1e-3 * np.array([1.0, 0.5, 0.25])
        outer = jax.lax.map(square, jnp.sqrt(speed**2 + scale**2 * steps))
        least = jnp.where(speed == 0, 0.0, speed**2 - scale**2 * steps)
        inner = jax.lax.map(square, jnp.sqrt(least))
        change = jnp.where(speed == 0, 1.0, 2.0) * scale**2 * steps
        return {
            "status": slope.status,
            "coefficient": slope.coefficient,
            "differences": (outer - inner) / change[:, None],
        }

    return jax.jit(run)


@pytest.mark.slow
@pytest.mark.parametrize("model", [jb.Hybrid(2, 3, 0), jb.GreenANCF(2)], ids=name)
@examples(20)
@given(data=st.data())
def test_southwell_coefficients(model, data, watched):
    """Where ratios of differences converge, to the limit of these."""
    p = data.draw(spinning(model), "scene")
    with watched(p):
        found = evaluated(stiffening(model), p)
        expected = broken(model, p, "angular_speed", angular_speed=Status.INVALID_ANGULAR_SPEED)
        status = judged(found, expected, p, ["coefficient"])
        if status != Status.OK or absurd(p):
            return
        first, second, third = found["differences"]
        off = np.abs(third - second)
        converging = (np.abs(second - first) < 0.02 * np.abs(third)) & (off < 0.01 * np.abs(third))
        event(f"{converging.sum()} of 2 converge")
        miss = np.abs(found["coefficient"] - third)
        assert (miss <= 3 * off + 1e-4 * np.abs(third))[converging].all()


@functools.cache
def critical(model):
    def run(p):
        rotor = build(model, p)
        found = jb.critical_speed(model, rotor, throw=False)
        speed = jnp.where(jnp.isfinite(found.angular_speed), found.angular_speed, 0.0)
        equations, rest = model.equations(rotor), jnp.zeros(len(model.families))

        def undeformed(speed):
            hub = jb.motions.Hub(*jnp.zeros((5, 3)))._replace(angular_velocity=speed * np.eye(3)[2])
            return dense(equations.tangents(hub, rest, rest, None)[0])

        return {
            "status": found.status,
            "angular_speed": found.angular_speed,
            "shape": found.shape,
            "family": found.family,
            "rest": undeformed(0.0 * speed),
            "undeformed": undeformed(speed),
            # `linearise` gives NaN where the search for the steady state ends: just there.
            "steady": model.matrices(rotor, speed).stiffness,
            "halfway": model.linearise(rotor, speed / 2, throw=False).stiffness,
        }

    return jax.jit(run)


CRITICAL = [
    jb.Hybrid(3, 3, 3), jb.Classical(2, 3, 2), jb.VonKarman(4, 2, 2), jb.models.ChordANCF(1),
    jb.GreenANCF(1), jb.models.DiscreteLC(),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("model", CRITICAL, ids=name)
@examples(16)
@given(data=st.data())
def test_critical_speeds(model, data, watched):
    """There the stiffness is singular, in the family and direction that are named; and halfway
    there it is positive definite."""
    p = spoiled(data.draw, data.draw(rotors(model), "rotor")[0])
    with watched(p):
        found = evaluated(critical(model), p)
        status = judged(found, broken(model, p), p, [])
        assert (status == Status.OK) != np.isnan(found["angular_speed"])
        assert not found["angular_speed"] <= 0
        if status != Status.OK or absurd(p) or np.isinf(found["angular_speed"]):
            return
        assert np.isfinite(found["shape"]).all()
        # in coordinates in which the stiffness at rest has ones on its diagonal
        scale = np.sqrt(np.diag(found["rest"]))
        tears = found["family"] == Family.AXIAL
        k, halfway, rest = (
            found[key] / scale / scale[:, None]
            for key in ("undeformed" if tears else "steady", "halfway", "rest")
        )
        least = np.linalg.eigvalsh(rest)[0]
        x = found["shape"] * scale
        assert np.abs(np.linalg.eigvalsh(k)).min() <= 1e-8 * least
        assert np.linalg.norm(k @ x) <= 1e-8 * least * np.linalg.norm(x)
        assert np.linalg.eigvalsh(halfway)[0] > 0


@functools.cache
def multipliers(model):
    def run(p):
        rotor = build(model, p)
        motion = jb.motions.ModulatedSpeed(p["angular_speed"], p["depth"], p["frequency"])
        damping = jb.Damping(p["mass_damping"], p["stiffness_damping"])
        found = jb.floquet(model, rotor, motion, damping=damping, throw=False)
        rest, one = (
            model.linearise(rotor, speed, throw=False) for speed in (0.0, rotor_frequency(model, p))
        )
        return {
            "status": found.status,
            "multipliers": found.multipliers,
            "growth_rate": found.growth_rate,
            "rest": (rest.mass, rest.stiffness),
            "one": one.stiffness,
        }

    return jax.jit(run)


def rotor_frequency(model, p):
    """Unit of frequency."""
    if model.rotor_type is jb.models.SpringRotor:
        return (p["torsional_spring"] / p["mass"]) ** 0.5 / p["length"]
    return (p["in_plane_bending_stiffness"] / p["mass_per_length"]) ** 0.5 / p["length"] ** 2


def hill(p, m, k, slope, damping):
    """Trace of the monodromy of m q'' + damping q' + (k + slope Omega^2) q = 0, by Runge-Kutta."""
    steps = 4000
    h = 2 * math.pi / p["frequency"] / steps
    t = h / 2 * np.arange(2 * steps + 1)
    square = (p["angular_speed"] * (1 + p["depth"] * np.sin(p["frequency"] * t))) ** 2
    zero = np.zeros_like(t)
    pull = -(k + slope * square) / m
    a = np.stack([np.stack([zero, zero + 1]), np.stack([pull, zero - damping / m])]).transpose(
        2, 0, 1
    )
    y = np.eye(2)
    for start, middle, end in zip(a[:-2:2], a[1:-1:2], a[2::2], strict=True):
        one = start @ y
        two = middle @ (y + h / 2 * one)
        three = middle @ (y + h / 2 * two)
        y = y + h / 6 * (one + 2 * two + 2 * three + end @ (y + h * three))
    return np.trace(y)


@st.composite
def modulated(draw, model):
    p, unit, _ = draw(rotors(model))
    p["angular_speed"] = unit * draw(signed(sizes(-2, 1)))
    p["depth"] = draw(signed(sizes(-2, 0)))
    p["frequency"] = unit * draw(decades(-0.3, 1.7))
    damped = draw(st.booleans())
    p["mass_damping"] = damped * unit * draw(sizes(-3, 0))
    p["stiffness_damping"] = damped / unit * draw(sizes(-5, -1))
    return spoiled(draw, p)


MODULATED = [jb.Hybrid(0, 1, 0), jb.Hybrid(1, 2, 1), jb.GreenANCF(1), jb.models.DiscreteLP()]


@pytest.mark.slow
@pytest.mark.parametrize("model", MODULATED, ids=name)
@examples(20)
@given(data=st.data())
def test_floquet_multipliers(model, data, watched):
    """Pairs mu, 1 / mu without damping; with it their product is that of Liouville; and of one
    coordinate the trace is that of another integration."""
    p = data.draw(modulated(model), "scene")
    with watched(p):
        found = evaluated(multipliers(model), p)
        others = "angular_speed", "depth", "frequency", "mass_damping", "stiffness_damping"
        expected = broken(model, p, *others)
        status = judged(found, expected, p, ["multipliers", "growth_rate"])
        if status != Status.OK or absurd(p):
            return
        mu, n = found["multipliers"], len(model.families)
        assert mu.size == 2 * n
        size, period = np.abs(mu), 2 * math.pi / p["frequency"]
        event(f"{'damped' if p['mass_damping'] + p['stiffness_damping'] else 'undamped'}")
        assert (np.diff(size) <= 0).all()
        np.testing.assert_allclose(found["growth_rate"] * period, np.log(size[0]), atol=1e-12)
        undamped = p["mass_damping"] == p["stiffness_damping"] == 0
        mass, rest = found["rest"]
        # rounding of the largest one hides the smallest
        lost = EPS * size[0] / size[-1]
        if undamped and size[0] < 1e3:
            off = max(np.abs(mu * value - 1).min() for value in mu)
            assert off <= 1e-6 * size[0]  # multipliers that meet have half the digits
        if model.equations(build(model, p)).is_linear:
            share = np.trace(np.linalg.solve(mass, rest))
            decay = n * p["mass_damping"] + p["stiffness_damping"] * share
            if lost < 1e-8:
                off = abs(np.log(size).sum() + decay * period)
                assert off <= 1e-8 + 1e3 * lost + 1e-10 * decay * period
        if n == 1:
            (m,), (k,), (turning,) = mass[0], rest[0], found["one"][0]
            slope = (turning - k) / rotor_frequency(model, p) ** 2
            damping = p["mass_damping"] * m + p["stiffness_damping"] * k
            most = (abs(p["angular_speed"]) * (1 + abs(p["depth"]))) ** 2
            if math.sqrt((k + abs(slope) * most) / m) * period / 64 < 0.5:  # steps resolve it
                event("integrated")
                trace = hill(p, m, k, slope, damping)
                assert abs(mu.sum() - trace) <= 1e-5 * (1 + size[0])


@functools.cache
def stability(model):
    def run(p):
        rotor, speed = build(model, p), p["angular_speed"]
        found = jb.stable_step(model, rotor, speed, diffrax.Bosh3(), throw=False)
        system = model.linearise(rotor, speed, throw=False)
        return {
            "status": found.status,
            "step": found.step,
            "frequency": found.frequency,
            "matrices": (system.mass, system.gyroscopic, system.stiffness),
        }

    return jax.jit(run)


@pytest.mark.slow
@examples(30)
@given(data=st.data())
def test_stable_steps(data, watched):
    """Bosh3 multiplies a vibration by abs(1 + i z - z^2 / 2 - i z^3 / 6)."""
    model = jb.Hybrid(1, 2, 1)
    p = data.draw(spinning(model), "scene")
    with watched(p):
        found = evaluated(stability(model), p)
        expected = broken(model, p, "angular_speed", angular_speed=Status.INVALID_ANGULAR_SPEED)
        status = judged(found, expected, p, ["step", "frequency"])
        if status != Status.OK:
            assert np.isnan(found["step"])
            return
        assert found["step"] > 0
        if absurd(p):
            return
        z = found["step"] * found["frequency"]
        growth = abs(1 + 1j * z - z**2 / 2 - 1j * z**3 / 6)
        np.testing.assert_allclose(growth**1000, 100.0, rtol=1e-6)
        m, g, k = found["matrices"]
        n = len(m)
        first = np.block([[np.zeros((n, n)), np.eye(n)], [-k, -g]])
        lam = scipy.linalg.eigvals(first, scipy.linalg.block_diag(np.eye(n), m))
        np.testing.assert_allclose(found["frequency"], np.abs(lam.imag).max(), rtol=1e-6)


# Outside jit ---------------------------------------------------------------------------------

WRONG = "1", None, 1j, True, [1.0], np.ones(1), np.array(1), jnp.asarray(2), object()
BEAM_OF_ONES = jb.Beam(*5 * [1.0])
ARGUMENTS = [
    *((jb.Beam, dict.fromkeys(BEAM, 1.0), key) for key in BEAM),
    *(
        (functools.partial(jb.Rotor, BEAM_OF_ONES), {"hub_radius": 1.0, "tip_mass": 1.0}, key)
        for key in ("hub_radius", "tip_mass")
    ),
    *((jb.models.SpringRotor, dict.fromkeys(SPRINGS, 1.0), key) for key in SPRINGS),
    *(
        (kind, {"angular_speed": 1.0, "duration": 1.0}, key)
        for kind in (jb.SmoothSpinUp, jb.motions.QuinticSpinUp)
        for key in ("angular_speed", "duration")
    ),
    (jb.ConstantSpeed, {"angular_speed": 1.0}, "angular_speed"),
    *(
        (jb.motions.ModulatedSpeed, dict.fromkeys(("mean", "depth", "frequency"), 1.0), key)
        for key in ("mean", "depth", "frequency")
    ),
    (
        functools.partial(jb.motions.SpinUpThenDown, jb.ConstantSpeed(1.0)),
        {"down_at": 1.0},
        "down_at",
    ),
    (jb.Damping, {"mass": 1.0}, "mass"),
    (jb.Damping, {"stiffness": 1.0}, "stiffness"),
    (jb.Beam.from_slenderness, {"slenderness": 1.0}, "slenderness"),
]
STRICT = [(make, key) for make, _, key in ARGUMENTS if key in POSITIVE and make is not jb.Damping]
STRICT.append((jb.Beam.from_slenderness, "slenderness"))
ANY = "angular_speed", "mean", "depth"  # whether they are finite is asked with the times of a run


@pytest.mark.slow
@examples(200)
@given(
    which=st.sampled_from(ARGUMENTS),
    value=st.sampled_from(WRONG)
    | st.floats(allow_subnormal=False)
    | st.integers()
    | st.just(10**400),
)
def test_construction(which, value):
    """Numbers in range are taken; anything else is refused, by name."""
    make, arguments, key = which
    if value is None and make is jb.Damping:
        return
    told = "damping" if make is jb.Damping else key
    number = isinstance(value, int | float) and not isinstance(value, bool)
    within = number and (isinstance(value, float) or abs(value) < 2**1023)
    allowed = within and (
        key in ANY
        or (math.isfinite(value) and (value > 0 or (value == 0 and (make, key) not in STRICT)))
    )
    if allowed and make == jb.Beam.from_slenderness:
        assume(1e-150 < value < 1e150)  # it is squared
    if allowed:
        make(**arguments | {key: value})
        return
    with pytest.raises((TypeError, ValueError), match=told):
        make(**arguments | {key: value})
