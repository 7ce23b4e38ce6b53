"""Random blades: stations decades apart and next to one another, springs, bodies, twist. What is
said to be right agrees with many more functions as well as is estimated."""

import functools
import math

import jax
import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st

import jaxbeam as jb
from jaxbeam import Status
from tests.fuzz.scenes import BAD, decades, evaluated, examples, signed, sizes

STATIONS = (0.0, 0.2, 0.2 + 1e-7, 0.6, 0.9, 1.0)
TABLES = {
    "mass_per_length": Status.INVALID_MASS_PER_LENGTH,
    "in_plane_bending_stiffness": Status.INVALID_IN_PLANE_BENDING_STIFFNESS,
    "flap_bending_stiffness": Status.INVALID_FLAP_BENDING_STIFFNESS,
    "twist": Status.INVALID_TWIST,
}
NUMBERS = {
    "hub_radius": Status.INVALID_HUB_RADIUS,
    "tip_mass": Status.INVALID_TIP_MASS,
    "pitch": Status.INVALID_PITCH,
    "offset": Status.INVALID_TIP_BODY,
    "inertia": Status.INVALID_TIP_BODY,
    "lag": Status.INVALID_ROOT_SPRINGS,
    "flap": Status.INVALID_ROOT_SPRINGS,
    "angular_speed": Status.INVALID_ANGULAR_SPEED,
}


@st.composite
def blades(draw):
    """Of length 1; up to two decades either way from station to station, taper to the tip or not;
    springs from soft to clamped."""
    p = {}
    spread, taper = draw(st.floats(0.0, 1.5)), draw(st.booleans())
    for key in list(TABLES)[:3]:
        values = np.array([draw(st.floats(-spread, spread)) for _ in STATIONS])
        p[key] = 10.0 ** (np.sort(values)[::-1] if taper else values)
    p["mass_per_length"] **= 0.5
    p["in_plane_bending_stiffness"] *= draw(decades(0, 1.5))
    turned = draw(st.sampled_from([0.0, 0.1, 0.4]))
    p["twist"] = turned * np.array([draw(st.floats(-1.0, 1.0)) for _ in STATIONS])
    body = draw(st.sampled_from([0.0, 1.0]))
    p |= {
        "hub_radius": draw(sizes(-2, 0)),
        "tip_mass": draw(sizes(-2, 0)),
        "pitch": draw(signed(sizes(-2, 0))),
        "offset": body * draw(sizes(-2, -1)),
        "inertia": body * draw(sizes(-4, -2)),
        "lag": draw(decades(-1, 3)),
        "flap": draw(decades(-1, 3)),
        "angular_speed": draw(signed(sizes(-1, 1))),
    }
    if draw(st.integers(0, 5)) == 5:
        key, value = draw(st.sampled_from([*TABLES, *NUMBERS])), draw(st.sampled_from(BAD))
        if key in TABLES:
            p[key] = np.where(np.arange(len(STATIONS)) == draw(st.integers(0, 5)), value, p[key])
        else:
            p[key] = value
    return p


def expected(p):
    """Status of the first number that is out of range."""
    signs = {"twist", "pitch", "offset", "angular_speed"}
    zero = {"hub_radius", "tip_mass", "inertia", "lag", "flap"}
    for key, status in (TABLES | NUMBERS).items():
        for value in np.atleast_1d(p[key]):
            fine = math.isfinite(value) and (
                value > 0 or key in signs or (value == 0 and key in zero)
            )
            if not fine:
                return status
    return None


@functools.cache
def frequencies(springs, size):
    def run(p):
        tables = {key: jb.Spanwise(STATIONS, p[key]) for key in TABLES}
        beam = jb.Beam(1.0, axial_stiffness=1e6, **tables)
        root = jb.RootSprings(p["lag"], p["flap"]) if springs else None
        body = jb.TipBody(p["offset"], p["inertia"])
        rotor = jb.Rotor(
            beam, p["hub_radius"], p["tip_mass"], pitch=p["pitch"], tip_body=body, root_springs=root
        )
        found = jb.modes(jb.Hybrid(0, size, size), rotor, p["angular_speed"], 4, throw=False)
        return {
            "status": found.status, "value": found.eigenvalue, "error": found.frequency_error
        }  # fmt: skip

    return jax.jit(run)


@pytest.mark.exhaustive
@pytest.mark.parametrize("springs", [False, True])
@examples(150)
@given(data=st.data())
def test_frequencies(springs, data, watched):
    p = data.draw(blades(), "blade")
    with watched(p):
        found = evaluated(frequencies(springs, 12), p)
        status = Status(int(found["status"]))
        event(status.name)
        if (bad := expected(p)) is not None:
            assert status == bad or (not springs and bad == Status.INVALID_ROOT_SPRINGS)
        if bad is not None or status != Status.OK:
            assert status == Status.OK or np.isnan(found["value"]).all()
            return
        assert np.isfinite(found["value"]).all()
        assert (found["error"] <= 1e-3).all()
        better = evaluated(frequencies(springs, 26), p)
        assert Status(int(better["status"])) == Status.OK
        size = np.abs(better["value"])
        off = np.abs(found["value"] - better["value"]) / np.maximum(size, 1e-5 * size[-1])
        assert (off <= 3 * found["error"] + 3 * better["error"] + 1e-8).all()
