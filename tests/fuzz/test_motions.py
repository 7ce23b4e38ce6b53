"""Random motions and loads as users write them: delayed, short, repeated, cornered, jumping,
tabulated, in float32, NaN at some times. OK means right; what jumps and is not declared is not OK.
"""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, event, given
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

import jaxbeam as jb
from jaxbeam import Status
from tests.fuzz.scenes import (
    build,
    decades,
    evaluated,
    examples,
    rotors,
    signed,
    sizes,
)
from tests.helpers import name

MODEL = jb.Hybrid(0, 2, 0)
OUTPUTS = 65
SHORTEST = 1 / 500  # event that is never passed over, of a run
CLOSE = 1e-3  # to the reference, of the largest deflection
ACROSS, ABOUT = jnp.array([0.0, 1.0, 0.0]), jnp.array([0.0, 0.0, 1.0])


@st.composite
def beams(draw, model, longest=1.0):
    """Of no deflection to speak of out of balance with `angular_speed`; the run's `end`."""
    p, unit, force = draw(rotors(model))
    units = {
        "angular_speed": unit * draw(signed(decades(-2, 0.3))),
        "velocity": unit * p["length"] * draw(signed(decades(-3, -0.5))),
        "force": force * draw(signed(decades(-4, -0.7))),
    }
    return p | {"end": 6.3 / 3.5 / unit * draw(decades(-0.3, longest))}, units


def chosen(draw, units):
    """Some of the three: what is left out is zero."""
    which = draw(st.sets(st.sampled_from(sorted(units)), min_size=1))
    return {key: value * (key in which) for key, value in units.items()}


def places(number, low=0.0, high=1.0):
    """In a run, some of them output times."""
    place = st.floats(low, high) | st.integers(1, 63).map(lambda k: k / 64)
    return st.lists(place, min_size=number, max_size=number).map(np.array)


def scene(p, value, **declared):
    """Motion and loads that go with value(t, key)."""
    motion = jb.motions.HubVelocity(
        lambda t: value(t, "velocity") * ACROSS,
        lambda t: value(t, "angular_speed") * ABOUT,
        **declared,
    )
    return motion, jb.Loads(tip_force=lambda t: value(t, "force") * ACROSS, **declared)


def run(model, p, motion, loads, tight=False):
    """`tight` is that of a reference."""
    control = diffrax.PIDController(rtol=1e-7, atol=1e-9 * p["length"]) if tight else None
    found = jb.simulate(
        model, build(model, p), motion, p["end"] * np.linspace(0.0, 1.0, OUTPUTS), loads=loads,
        stepsize_controller=control, max_steps=10_000 if tight else 4000, throw=False,
    )  # fmt: skip
    return found.status, found.tip, found.peak()[0]


def judged(found):
    """The status; unless it is OK there is no peak, and what is kept are the first outputs."""
    status, tip, peak = found
    status = Status(int(status))
    assert status.message
    assert np.isfinite(peak) == (status == Status.OK)
    there = np.isfinite(tip).all(1)
    assert there.all() if status == Status.OK else (np.diff(there.astype(int)) <= 0).all()
    return status


def assert_right(found, expected, length):
    """If the reference is, which has more to do. The tolerance of a run is that of the deflection
    under the loads if they went on: of short ones little may be left, so that a millionth of the
    length counts for nothing."""
    (status, tip, _), (sure, wanted, _) = found, expected
    if status == Status.OK == sure:
        event("right")
        np.testing.assert_allclose(
            tip, wanted, rtol=0, atol=CLOSE * np.abs(wanted).max() + 1e-6 * length
        )


# Events --------------------------------------------------------------------------------------

SHAPES = {
    "bump": lambda s: jnp.sin(jnp.pi * s) ** 2,
    "rise": lambda s: s**3 * (10 - 15 * s + 6 * s**2),
    "wave": lambda s: jnp.sin(jnp.pi * s) ** 2 * jnp.cos(5 * jnp.pi * s),
    "triangle": lambda s: 1 - jnp.abs(2 * s - 1),
}


@st.composite
def eventful(draw, model):
    p, units = draw(beams(model))
    width = np.array([draw(decades(np.log10(SHORTEST), -0.5)) for _ in range(3)])
    p |= chosen(draw, units) | {
        "start": draw(places(3)),
        "width": width,
        "share": np.array([draw(signed(sizes(-3, 0))) for _ in range(3)]),
        "shape": draw(st.integers(0, len(SHAPES) - 1)),
        "single": draw(st.sampled_from([0, 0, 0, 1])),
        "missing": draw(st.sampled_from([0, 0, 0, 0, 1, 2, 3])),
        "hole": np.array([draw(st.floats(0.0, 1.0)), draw(decades(-6, 0))]),
    }
    return p


@functools.cache
def events(model):
    """As they come, in the precision drawn and with the hole; and declared, without either."""

    def one(p, declare):
        def value(t, key):
            of = {"velocity": 1, "angular_speed": 2, "force": 3}[key]
            start, width = p["start"] * p["end"], p["width"] * p["end"]

            def profile(t, start, width, share):
                s = jnp.clip((t - start) / width, 0.0, 1.0)
                at = jax.lax.switch(p["shape"], list(SHAPES.values()), s)
                return p[key].astype(t.dtype) * jnp.sum(share * at)

            exact = profile(t, start, width, p["share"])
            if declare:
                return exact
            single = (a.astype(jnp.float32) for a in (t, start, width, p["share"]))
            out = jnp.where(p["single"] == 1, profile(*single).astype(t.dtype), exact)
            first, long = p["hole"] * p["end"]
            hole = (t > first) & (t < first + long) & (p["missing"] == of)
            return jnp.where(hole, jnp.nan, out)

        times = jnp.stack([p["start"], p["start"] + p["width"] / 2, p["start"] + p["width"]])
        declared = {"jumps": times.ravel() * p["end"]} if declare else {}
        return run(model, p, *scene(p, value, **declared), tight=declare)

    return jax.jit(lambda p: (one(p, False), one(p, True)))


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [MODEL, jb.PlanarRod(1)], ids=name)
@examples(16)
@given(data=st.data())
def test_events(model, data, watched):
    p = data.draw(eventful(model), "scene")
    with watched(p):
        found, expected = evaluated(events(model), p)
        status, reference = judged(found), judged(expected)
        event(f"{'single, ' * p['single']}hole {p['missing']}: {status.name}")
        event(f"reference {reference.name}")
        first, long = p["hole"]
        seen = min(first + long, 1.0) - first > 1 / 1000
        if p["missing"] and seen:
            invalid = Status.INVALID_LOAD if p["missing"] == 3 else Status.INVALID_MOTION
            assert status == invalid
        if not p["missing"] and not p["single"]:
            assert status != Status.UNRESOLVED
        assert_right(found, expected, p["length"])


# Jumps ---------------------------------------------------------------------------------------

RISE = 1e-5  # of a run, instead of a jump


@st.composite
def jumping(draw):
    p, units = draw(beams(MODEL, 0.7))
    p |= chosen(draw, units) | {"at": draw(places(3)), "base": units["angular_speed"]}
    p["share"] = np.array([draw(signed(sizes(-4, 0))) for _ in range(3)])
    p["base"] *= draw(st.sampled_from([0.0, 1.0]))
    # Corners of the speed, before, between and after what jumps, and at one time in four with it.
    p["corner"] = units["angular_speed"] * draw(st.sampled_from([0.0, 1.0, 3.0]))
    p["change"] = draw(places(3))
    p["change"][0] = draw(st.sampled_from([p["at"][0], *3 * [p["change"][0]]]))
    return p


def steady_part(p, s, xp):
    """Of the speed, at places of the run: all but its jumps."""
    corners = xp.abs(s[..., None] - p["change"]).sum(-1) / 3
    return p["base"] * xp.sin(3 * s) + p["corner"] * corners


@functools.cache
def jumps(how):
    """Declared, not declared, or short smooth rises."""

    def one(p):
        def value(t, key):
            if how == "smooth":
                s = jnp.clip((t / p["end"] - p["at"]) / RISE, 0.0, 1.0)
                steps = SHAPES["rise"](s)
            else:
                steps = jnp.where(t > p["at"] * p["end"], 1.0, 0.0)
            base = steady_part(p, t / p["end"], jnp) * (key == "angular_speed")
            return base + p[key] * jnp.sum(p["share"] * steps)

        declared = {"changes": p["change"] * p["end"]}
        if how == "declared":
            declared["jumps"] = p["at"] * p["end"]
        if how == "smooth":
            places = jnp.concatenate([p["change"], p["at"], p["at"] + RISE])
            declared = {"changes": places * p["end"]}
        return run(MODEL, p, *scene(p, value, **declared), tight=how == "smooth")

    return jax.jit(one)


@pytest.mark.exhaustive
@examples(20)
@given(data=st.data())
def test_jumps(data, watched):
    """Declared they are the limit of short rises, whatever changes are declared beside them; not
    declared, those of velocity end the run."""
    p = data.draw(jumping(), "scene")
    apart = np.abs(np.subtract.outer(p["at"], p["at"]))[np.triu_indices(3, 1)]
    assume(((apart == 0) | (apart > SHORTEST)).all())
    with watched(p):
        found, expected = evaluated(jumps("declared"), p), evaluated(jumps("smooth"), p)
        event(f"declared {judged(found).name}, smooth {judged(expected).name}")
        assert judged(found) != Status.UNRESOLVED
        assert_right(found, expected, p["length"])
        status = judged(bare := evaluated(jumps("not declared"), p))
        event(f"not declared {status.name}")
        # The largest jump, over the largest velocity.
        inside = (p["at"] > 0) & (p["at"] < 1)
        t = np.linspace(0.0, 1.0, 4001)[:, None]
        speed = steady_part(p, t[:, 0], np)
        speed += p["angular_speed"] * ((t > p["at"]) @ p["share"])
        speed, lift = np.abs(speed).max(), np.abs(p["velocity"] * ((t > p["at"]) @ p["share"]))
        most = max(speed * (p["hub_radius"] + p["length"]), lift.max())
        net = [abs(p["share"][p["at"] == a].sum()) for a in p["at"][inside]]
        size = max(p["angular_speed"] * (p["hub_radius"] + p["length"]), p["velocity"], key=abs)
        if net and abs(size) * max(net) > 1e-4 * most:
            assert status != Status.OK
        assert_right(bare, expected, p["length"])


# Tables --------------------------------------------------------------------------------------

ENTRIES = 6


@st.composite
def tables(draw):
    p, units = draw(beams(MODEL))
    p["begin"] = draw(st.floats(-0.5, 0.9))
    p["gap"] = np.array([draw(decades(-3, 0)) for _ in range(ENTRIES - 1)])
    p["speed"] = units["angular_speed"] * np.array([draw(signed(sizes(-2, 0))) for _ in range(6)])
    return p


@functools.cache
def tabulated(smooth):
    def both(p):
        times = p["times"]
        table = jb.motions.TabulatedSpeed(times, p["speed"], smooth=smooth)

        def speed(t):
            if not smooth:
                return jnp.interp(t, times, p["speed"])
            i = jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, ENTRIES - 2)
            s = jnp.clip(t, times[0], times[-1]) - times[i]
            return jnp.polyval(p["cubics"][:, i], s)

        def still(t):
            return jnp.zeros(3)

        same = jb.motions.HubVelocity(still, lambda t: speed(t) * ABOUT)
        none = jb.Loads()
        return run(MODEL, p, table, none), run(MODEL, p, same, none, tight=True)

    return jax.jit(both)


@pytest.mark.exhaustive
@pytest.mark.parametrize("smooth", [False, True])
@examples(20)
@given(data=st.data())
def test_tables(smooth, data, watched):
    """As `jnp.interp`, or the cubic of SciPy, of the same numbers."""
    p = data.draw(tables(), "scene")
    p["times"] = p["end"] * (p["begin"] + np.concatenate([[0.0], np.cumsum(p["gap"])]))
    chord, h = np.diff(p["speed"]) / np.diff(p["times"]), np.diff(p["times"])
    inner = (h[1:] * chord[:-1] + h[:-1] * chord[1:]) / (h[1:] + h[:-1])
    slope = np.concatenate([[0.0], inner, [0.0]])
    p["cubics"] = CubicHermiteSpline(p["times"], p["speed"], slope).c
    with watched(p):
        found, expected = evaluated(tabulated(smooth), p)
        event(f"{judged(found).name}, reference {judged(expected).name}")
        assert judged(found) != Status.UNRESOLVED
        assert judged(expected) != Status.UNRESOLVED
        assert_right(found, expected, p["length"])
