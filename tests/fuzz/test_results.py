"""Random batches, bad cases among them: each lane answers as it does alone, and says what failed;
tongues, fits and choices of the ladder say what independent computations say.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, event, given
from hypothesis import strategies as st

import jaxbeam as jb
from jaxbeam import Status
from tests.fuzz.scenes import (
    BAD,
    build,
    decades,
    evaluated,
    examples,
    rotors,
    signed,
    sizes,
    spinning,
    spoiled,
)
from tests.helpers import ROTOR

LANES = 4
ONE, TWO = jb.Hybrid(0, 1, 0), jb.Hybrid(0, 2, 0)
FIRST = jb.labels(in_plane=1)


# Batches -------------------------------------------------------------------------------------


def simulated(p):
    motion = jb.SmoothSpinUp(p["angular_speed"], p["duration"])
    times = p["duration"] * np.linspace(0.0, 1.5, 9)
    loads = jb.Loads(tip_force=lambda t: p["force"] * jnp.array([0.0, 1.0, 0.0]) * jnp.sin(t))
    run = jb.simulate(
        TWO, build(TWO, p), motion, times, loads=loads, max_steps=300, throw=False
    )  # fmt: skip
    return run.status, run.peak(), (run.tip, run.hub_torque, run.energy), run.partial.peak()


def vibrating(p):
    found = jb.modes(
        jb.Hybrid(2, 2, 1), build(TWO, p), p["angular_speed"], 3, throw=False
    )  # fmt: skip
    return found.status, (found.frequency, found.growth_rate, found.steady_strain)


def lowest(p):
    found = jb.modes(jb.Hybrid(), build(TWO, p), p["angular_speed"], 2, throw=False)
    return found.status, (found.frequency,)


def critical(p):
    found = jb.critical_speed(jb.Classical(0, 3, 0), build(TWO, p), throw=False)
    return found.status, (found.angular_speed,)


def multiplied(p):
    motion = jb.motions.ModulatedSpeed(p["angular_speed"], 0.3, 2 * math.pi / p["duration"])
    found = jb.floquet(ONE, build(ONE, p), motion, throw=False)
    return found.status, (found.multipliers, jnp.exp(found.growth_rate * p["duration"]))


ASKED = [simulated, vibrating, lowest, critical, multiplied]


@st.composite
def lane(draw):
    p, unit, force = draw(rotors(TWO))
    p["angular_speed"] = unit * draw(signed(sizes(-2, 1.0)))
    p["duration"] = draw(decades(-0.5, 1)) / unit
    p["force"] = force * draw(signed(sizes(-3, -0.5)))
    return spoiled(draw, p)


@functools.cache
def compiled(asked):
    return jax.jit(asked), jax.jit(jax.vmap(asked))


@pytest.mark.exhaustive
@pytest.mark.parametrize("asked", ASKED, ids=lambda asked: asked.__name__)
@examples(8)
@given(data=st.data())
def test_lanes(asked, data, watched):
    """A lane alone, in the batch, and beside others; unless it is OK its answers are NaN."""
    lanes = [data.draw(lane(), f"lane {i}") for i in range(LANES)]
    with watched(lanes):
        alone, together = compiled(asked)
        batch = {key: np.array([p[key] for p in lanes]) for key in lanes[0]}
        found = evaluated(together, batch)
        for i, p in enumerate(lanes):
            status, *answers = jax.tree.map(lambda a, i=i: a[i], found)
            expected, *wanted = evaluated(alone, p)
            event(Status(int(expected)).name)
            assert status == expected
            for a, b in zip(jax.tree.leaves(answers), jax.tree.leaves(wanted), strict=True):
                scale = np.abs(b).max(initial=0.0, where=np.isfinite(b))
                np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6 * scale)
            for a in jax.tree.leaves(answers[0]):
                assert np.isfinite(a).all() if status == Status.OK else np.isnan(a).all()


# Tongues -------------------------------------------------------------------------------------


@st.composite
def parametric(draw):
    p, unit, _ = draw(rotors(TWO))
    p["angular_speed"] = unit * draw(decades(-0.5, 0.7))
    p["depth"] = draw(decades(-1.5, -0.5))
    p["mass_damping"] = unit * draw(sizes(-4, -2))
    p["order"] = draw(st.integers(1, 2))
    return p


@functools.cache
def boundaries(pair):
    def run(p):
        rotor, damping = build(TWO, p), jb.Damping(p["mass_damping"])
        found = jb.tongue(
            TWO, rotor, p["angular_speed"], pair, p["depth"][None], damping=damping, throw=False
        )
        low, high = jnp.nan_to_num(found.frequency[0], nan=1.0)
        width = 1e-3 * (high - low)
        nu = jnp.stack([low - width, low + width, (low + high) / 2, high - width, high + width])

        def growth(nu):
            motion = jb.motions.ModulatedSpeed(p["angular_speed"], p["depth"], nu)
            one = jb.floquet(TWO, rotor, motion, damping=damping, throw=False)
            return one.growth_rate, one.status

        return found.status[0], found.frequency[0], found.onset, *jax.vmap(growth)(nu)

    return jax.jit(run)


@pytest.mark.exhaustive
@pytest.mark.parametrize("pair", [(0, 0), (0, 1)], ids=str)
@examples(12)
@given(data=st.data())
def test_tongues(pair, data, watched):
    """Motion grows just inside, and just outside it does not, unless in another tongue."""
    p = data.draw(parametric(), "scene")
    labels = jb.labels(in_plane=2)
    with watched(p):
        status, frequency, tip, growth, sound = evaluated(
            boundaries(tuple(labels[i] for i in pair)), p
        )
        status = Status(int(status))
        event(status.name)
        if status != Status.OK:
            assert np.isnan(frequency).all()
            return
        assert np.isfinite(tip)
        assert frequency[0] < frequency[1]
        fine = sound == Status.OK
        event(f"{fine.sum()} of 5 looked at")
        least = 1e-9 * frequency[1]
        inside = growth[1:4][fine[1:4]]
        assert (inside > -least).all()
        outside = growth[[0, 4]][fine[[0, 4]]]
        assert (outside < np.maximum(least, 0.2 * growth[2])).all()


# Fits ----------------------------------------------------------------------------------------


@st.composite
def truths(draw):
    p, unit, _ = draw(rotors(TWO))
    p |= {"hub_radius": p["length"] * draw(decades(-1, 0.5))}
    p |= {"tip_mass": p["mass_per_length"] * p["length"] * draw(decades(-1, 0.5))}
    p["unit"] = unit
    p["guess"] = np.exp([draw(st.floats(-0.5, 0.5)) for _ in range(3)])
    p["lost"] = np.array([draw(st.sampled_from([0, 0, 0, 1])) for _ in range(8)])
    p["noise"] = draw(decades(-4, -1))
    spoil = draw(st.sampled_from([None] * 6 + ["unit", "hub_radius", "noise", "length"]))
    if spoil:
        p[spoil] = draw(st.sampled_from(BAD))
    return p


FITTED = "hub_radius", "in_plane_bending_stiffness", "tip_mass"


@jax.jit
def fits(p):
    speeds = p["unit"] * jnp.array([0.5, 2.0, 4.0, 6.0])

    def predicted(rotor):
        return jax.vmap(
            lambda speed: (
                jb.modes(
                    jb.Hybrid(0, 3, 0), rotor, speed, jb.labels(in_plane=2), throw=False
                ).frequency
            )
        )(speeds)

    exact = predicted(build(TWO, p))
    measured = jnp.where(p["lost"].reshape(4, 2) == 1, jnp.nan, exact)

    class Frequencies(jb.fitting.Experiment):
        rotor: jb.Rotor
        measured: jax.Array
        noise: jax.Array

        def predicted(self):
            return predicted(self.rotor)

    def experiment(**free):
        return Frequencies(build(TWO, p | free), measured, p["noise"] * exact)

    free = {key: jb.FreeParameter(p[key] * p["guess"][i]) for i, key in enumerate(FITTED)}
    found = jb.fit(experiment, free, max_steps=60, throw=False)
    return found.status, found.parameters, found.standard_deviation, found.reduced_chi_squared


@pytest.mark.exhaustive
@examples(30)
@given(data=st.data())
def test_fits(data, watched):
    """Of frequencies without noise, some of them lost: OK gives back what was put in."""
    p = data.draw(truths(), "scene")
    assume((p["lost"] == 0).sum() >= 4)
    with watched(p):
        status, parameters, deviation, misfit = evaluated(fits, p)
        status = Status(int(status))
        sound = all(math.isfinite(p[key]) and p[key] > 0 for key in (*ROTOR, "noise"))
        sound = sound and math.isfinite(p["unit"])  # speeds may have any sign
        event(f"{status.name}, {'sound' if sound else 'spoiled'}")
        numbers = np.array([[found[key] for key in FITTED] for found in (parameters, deviation)])
        if status != Status.OK:
            assert np.isnan(numbers).all()
            return
        assert np.isfinite(numbers).all()
        assert sound
        truth = np.array([p[key] for key in FITTED])
        assert misfit < 1e-6
        assert (np.abs(numbers[0] - truth) <= 1e-3 * numbers[1] + 1e-7 * truth).all()


# The ladder ----------------------------------------------------------------------------------


@pytest.mark.exhaustive
@examples(4)
@given(data=st.data())
def test_choices_of_the_ladder(data, watched):
    """What is met is met against elements finer than the judge, and the estimate covers it."""
    p = data.draw(spinning(TWO), "scene")
    tolerance = data.draw(decades(-3, -1), "tolerance")
    assume(all(math.isfinite(value) and value >= 0 for key, value in p.items() if key in ROTOR))
    with watched((p, tolerance)):
        try:
            rotor = build(TWO, p)
            question = jb.ladder.ModalFrequencies(p["angular_speed"], FIRST)
            choice = jb.choose_model(rotor, question, tolerance, throw=False)
        except (ValueError, RuntimeError) as error:
            event(f"{type(error).__name__}: {error}")
            return
        event("met" if choice.met else "not met")
        assert np.isfinite(choice.answer).all() == choice.met
        assert choice.met == (choice.estimate <= tolerance)
        exact = jb.ladder.evaluate(jb.PlanarRod(48), rotor, question, 1e-9, throw=False)
        if int(exact.status) == Status.OK and np.isfinite(choice.estimate):
            event("compared")
            error = np.max(np.abs(choice.partial / np.asarray(exact.value) - 1))
            assert error <= choice.estimate + 1e-9
