"""Random arguments outside `jax.jit`: taken, or refused by name."""

import functools
import math

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import jaxbeam as jb
from tests.fuzz.scenes import POSITIVE, examples
from tests.helpers import BEAM, SPRINGS

WRONG = "1", None, 1j, True, [1.0], np.ones(1), np.array(1), jnp.asarray(2), object()
BEAM_OF_ONES = jb.Beam(*5 * [1.0])
ARGUMENTS = [
    *((jb.Beam, dict.fromkeys(BEAM, 1.0), key) for key in BEAM),
    *(
        (functools.partial(jb.Rotor, BEAM_OF_ONES), {"hub_radius": 1.0, "tip_mass": 1.0}, key)
        for key in ("hub_radius", "tip_mass")
    ),
    *((jb.papers.SpringRotor, dict.fromkeys(SPRINGS, 1.0), key) for key in SPRINGS),
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
    (jb.Damping, {"mass_coefficient": 1.0}, "mass_coefficient"),
    (jb.Damping, {"stiffness_coefficient": 1.0}, "stiffness_coefficient"),
    (jb.Damping, {"in_plane_damper": 1.0}, "in_plane_damper"),
    (jb.Beam.from_slenderness, {"slenderness": 1.0}, "slenderness"),
]
STRICT = [
    *((make, key) for make, _, key in ARGUMENTS if key in POSITIVE and make is not jb.Damping),
    (jb.Beam.from_slenderness, "slenderness"),
]
SIGNED = "hub_radius"  # of a beam that points inward it is below zero
ANY = "angular_speed", "mean", "depth"  # whether they are finite is asked with the times of a run


@pytest.mark.exhaustive
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
    if value is None and (make is jb.Damping or key == "tip_mass"):
        return  # there is none
    told = "damping" if make is jb.Damping else key
    number = isinstance(value, int | float) and not isinstance(value, bool)
    within = number and (isinstance(value, float) or abs(value) < 2**1023)
    allowed = within and (
        key in ANY
        or (math.isfinite(value) and (key == SIGNED or value > 0))
        or (value == 0 and (make, key) not in STRICT)
    )
    if allowed and make == jb.Beam.from_slenderness:
        assume(1e-150 < value < 1e150)  # it is squared
    if allowed:
        make(**arguments | {key: value})
        return
    with pytest.raises((TypeError, ValueError), match=told):
        make(**arguments | {key: value})
