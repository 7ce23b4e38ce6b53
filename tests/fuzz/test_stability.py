"""Random beams where they lose stability: critical speeds, Floquet multipliers, stable steps."""

import functools
import math

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
    judged_at_speed,
    rotors,
    signed,
    sizes,
    spinning,
    spoiled,
)
from tests.helpers import name

EPS = np.finfo(float).eps


@functools.cache
def critical(model):
    def run(p):
        rotor = build(model, p)
        found = jb.critical_speed(model, rotor, throw=False)
        speed = jnp.where(jnp.isfinite(found.angular_speed), found.angular_speed, 0.0)
        equations, rest = model.equations(rotor), jnp.zeros(len(model.directions))

        def undeformed(speed):
            hub = jb.motions.Hub(*jnp.zeros((5, 3)))._replace(angular_velocity=speed * np.eye(3)[2])
            return dense(equations.tangents(hub, rest, rest, None)[0])

        return {
            "status": found.status,
            "angular_speed": found.angular_speed,
            "shape": found.shape,
            "direction": found.direction,
            "rest": undeformed(0.0 * speed),
            "undeformed": undeformed(speed),
            # `linearise` gives NaN where the search for the steady state ends: just there.
            "steady": model.matrices(rotor, speed).stiffness,
            "halfway": model.linearise(rotor, speed / 2, throw=False).stiffness,
        }

    return jax.jit(run)


CRITICAL = [
    jb.Hybrid(3, 3, 3), jb.Classical(2, 3, 2), jb.VonKarman(4, 2, 2), jb.papers.ChordANCF(1),
    jb.papers.GreenANCF(1), jb.papers.DiscreteLC(),
]  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", CRITICAL, ids=name)
@examples(16)
@given(data=st.data())
def test_critical_speeds(model, data, watched):
    """There the stiffness is singular, in the direction and shape that are named; and halfway there
    it is positive definite."""
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
        tears = found["direction"] == Direction.AXIAL
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
    if model.rotor_type is jb.papers.SpringRotor:
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


MODULATED = [jb.Hybrid(0, 1, 0), jb.Hybrid(1, 2, 1), jb.papers.GreenANCF(1), jb.papers.DiscreteLP()]


@pytest.mark.exhaustive
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
        mu, n = found["multipliers"], len(model.directions)
        assert mu.size == 2 * n
        size, period = np.abs(mu), 2 * math.pi / p["frequency"]
        event(f"{'damped' if p['mass_damping'] + p['stiffness_damping'] else 'undamped'}")
        # the library's own absolute values may round otherwise in the last bits
        assert (np.diff(size) <= 8 * EPS * size[:-1]).all()
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
        found = jb.solvers.stable_step(model, rotor, speed, diffrax.Bosh3(), throw=False)
        system = model.linearise(rotor, speed, throw=False)
        return {
            "status": found.status,
            "step": found.step,
            "frequency": found.frequency,
            "matrices": (system.mass, system.gyroscopic, system.stiffness),
        }

    return jax.jit(run)


@pytest.mark.exhaustive
@examples(30)
@given(data=st.data())
def test_stable_steps(data, watched):
    """Bosh3 multiplies a vibration by abs(1 + i z - z^2 / 2 - i z^3 / 6)."""
    model = jb.Hybrid(1, 2, 1)
    p = data.draw(spinning(model), "scene")
    with watched(p):
        found = evaluated(stability(model), p)
        status = judged_at_speed(found, model, p, ["step", "frequency"])
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
