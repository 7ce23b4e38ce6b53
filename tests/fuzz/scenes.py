"""Random numbers of scenes, and what holds for every answer."""

import math
import os

import jax
import numpy as np
from hypothesis import HealthCheck, Phase, event, settings
from hypothesis import strategies as st

import jaxbeam as jb
from jaxbeam import Status
from tests import tiers
from tests.helpers import BEAM, OF_ROTOR, ROTOR, SPRINGS, rules

FACTOR = float(os.environ.get("FUZZ_FACTOR", "1"))


def examples(number):
    """So many scenes, times FUZZ_FACTOR, drawn anew in each run of the exhaustive tier; elsewhere
    an eighth of them, the same ones in every run."""
    exhaustive = tiers.running == "exhaustive"
    return settings(
        max_examples=max(3, round(number * FACTOR / (1 if exhaustive else 8))),
        derandomize=not exhaustive,
        database=None,
        deadline=None,
        print_blob=True,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
    )


BAD = 0.0, -1.0, math.nan, math.inf, -math.inf
ABSURD = 1e-300, 1e-30, 1e30, 1e300  # and yet in range
RULES = rules(jb.Beam) | OF_ROTOR | rules(jb.papers.SpringRotor)
TWISTING = "torsional_stiffness", "polar_inertia"  # of rods in space
# What a parameter's status is called follows from its name.
NAMED = {key: Status[f"INVALID_{key.upper()}"] for key in (*RULES, *TWISTING)}
LEAST = {key: False if key in TWISTING else RULES[key]["zero"] for key in NAMED}
POSITIVE = {key: status for key, status in NAMED.items() if LEAST[key] is False} | {
    "duration": Status.INVALID_MOTION,
    "down_at": Status.INVALID_MOTION,
    "frequency": Status.INVALID_MOTION,
    "end": Status.INVALID_TIMES,
}
NOT_NEGATIVE = {key: status for key, status in NAMED.items() if LEAST[key] is True} | {
    "mass_damping": Status.INVALID_DAMPING,
    "stiffness_damping": Status.INVALID_DAMPING,
}
FINITE = {key: status for key, status in NAMED.items() if LEAST[key] is None} | {
    "angular_speed": Status.INVALID_MOTION,
    "depth": Status.INVALID_MOTION,
    "axis": Status.INVALID_MOTION,
    "gravity": Status.INVALID_LOAD,
    "force": Status.INVALID_LOAD,
    "start": Status.INVALID_START,
}


def decades(low, high):
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


def sizes(low, high):
    """A number between these decades, one time in five zero."""
    below = low - (high - low) / 4
    return st.floats(below, high).map(lambda e: 0.0 if e < low else 10.0**e)


def signed(numbers):
    return st.tuples(numbers, st.sampled_from([1.0, -1.0])).map(math.prod)


@st.composite
def rotors(draw, model):
    """A rotor, its unit of frequency (rad/s) and of force (N)."""
    length, unit = draw(decades(-2, 2)), draw(decades(-1, 2))
    slenderness = draw(decades(1, 3.5))
    if model.rotor_type is jb.papers.SpringRotor:
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
    if isinstance(model, jb.SpatialRod):
        rotor["torsional_stiffness"] = bending * draw(decades(-1, 1))
        rotor["polar_inertia"] = density * (length / slenderness) ** 2 * draw(decades(-1, 2))
    return rotor, unit, bending / length**2


def spoiled(draw, numbers):
    """Most often as they are, else with one or two that make no sense."""
    for _ in range(max(0, draw(st.integers(0, 5)) - 3)):
        numbers[draw(st.sampled_from(list(numbers)))] = draw(st.sampled_from(BAD + ABSURD))
    return numbers


@st.composite
def spinning(draw, model):
    """A rotor, with its speed."""
    rotor, unit, _ = draw(rotors(model))
    return spoiled(draw, rotor | {"angular_speed": unit * draw(signed(sizes(-2, 1.5)))})


def build(model, p):
    """The rotor of these numbers."""
    if model.rotor_type is jb.papers.SpringRotor:
        return jb.papers.SpringRotor(**{key: p[key] for key in SPRINGS})
    twisting = {key: p[key] for key in TWISTING if key in p}
    beam = jb.Beam(*(p[key] for key in BEAM), **twisting)
    return jb.Rotor(beam, p["hub_radius"], p["tip_mass"])


def broken(model, p, *others, **instead):
    """Status of the first number that is out of range: of the rotor, then of these others."""
    own = SPRINGS if model.rotor_type is jb.papers.SpringRotor else (*BEAM, *TWISTING, *ROTOR)
    for key in own + others:
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


def judged_at_speed(found, model, p, ok):
    """The same of a question that takes a rotor and its speed alone (see `spinning`)."""
    instead = {"angular_speed": Status.INVALID_ANGULAR_SPEED}
    return judged(found, broken(model, p, "angular_speed", **instead), p, ok)


def evaluated(function, p):
    """With all numbers as arrays, so that one compiled function takes every scene."""
    out = function({key: np.asarray(value) for key, value in p.items()})
    return jax.tree.map(np.asarray, out)
