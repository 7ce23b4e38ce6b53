"""Parameters: meaning, checks, errors that name the argument."""

import dataclasses
import re
import subprocess
import sys
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam.blades import SpanwiseFunction
from tests.beams import ALUMINIUM_SECTION
from tests.tiers import slow

GOOD = {
    "length": 8.0,
    "mass_per_length": 0.2,
    "axial_stiffness": 5e6,
    "in_plane_bending_stiffness": 566.0,
    "flap_bending_stiffness": 300.0,
}


def test_from_section_gives_products():
    beam = jb.Beam.from_section(**ALUMINIUM_SECTION, flap_second_moment=1e-9)
    # B Table 1, column "Ref. 21"
    assert float(beam.mass) == pytest.approx(1.615, rel=1e-3)
    assert float(beam.in_plane_bending_stiffness) == pytest.approx(566.4, rel=1e-4)
    assert float(beam.flap_bending_stiffness) == pytest.approx(68.95)
    assert float(beam.axial_stiffness) == pytest.approx(6.895e10 * 7.299e-5)
    assert float(beam.slenderness) == pytest.approx(8 * np.sqrt(7.299e-5 / 8.214e-9))


def test_from_slenderness_is_nondimensional():
    beam = jb.Beam.from_slenderness(100.0, flap_to_in_plane=0.25)
    assert float(beam.slenderness) == pytest.approx(100.0)
    assert float(beam.frequency_scale) == 1.0
    assert float(beam.flap_bending_stiffness) == 0.25


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf")])
def test_beam_rejects_bad_values(name, bad):
    with pytest.raises(ValueError, match=f"{name} must be finite and > 0"):
        jb.Beam(**GOOD | {name: bad})


@pytest.mark.parametrize("name", ["hub_radius", "tip_mass"])
@pytest.mark.parametrize("bad", [-1e-9, float("nan"), float("inf")])
def test_rotor_rejects_bad_values(name, bad):
    if (name, bad) == ("hub_radius", -1e-9):  # of a beam that points inward
        assert jb.Rotor(jb.Beam(**GOOD), hub_radius=bad).hub_radius == bad
        return
    with pytest.raises(ValueError, match=f"{name} must be finite"):
        jb.Rotor(jb.Beam(**GOOD), **{name: bad})


@pytest.mark.parametrize("bad", [jnp.array(1), jnp.array(1 + 1j), np.array(3), "1", None, True])
@pytest.mark.parametrize("name", [*GOOD, "hub_radius", "tip_mass", "angular_speed"])
def test_not_a_real_number(name, bad):
    if (name, bad) == ("tip_mass", None):  # which is none, as where a body is at the tip
        assert float(jb.Rotor(jb.Beam(**GOOD), tip_mass=None).tip_mass) == 0.0
        return
    with pytest.raises(TypeError, match=f"{name} must be a real"):
        _with(name, bad)


@pytest.mark.parametrize("name", [*GOOD, "hub_radius", "tip_mass", "angular_speed"])
def test_not_a_scalar(name):
    with pytest.raises(ValueError, match=f"{name} must be a scalar, got shape"):
        _with(name, jnp.ones(3))


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_speed_must_be_finite(bad):
    with pytest.raises(ValueError, match="angular_speed must be finite"):
        _with("angular_speed", bad)


@pytest.mark.parametrize(
    "name", ["length", "tip_mass", *map(slow, [*list(GOOD)[1:], "hub_radius"])]
)
def test_bad_value_inside_jit_names_the_argument(name):
    @eqx.filter_jit
    def traced(value):
        return _with(name, value).frequency

    with pytest.raises(RuntimeError, match=f"{name} must be finite"):
        traced(jnp.asarray(-jnp.inf))


BEAM, QUARTER, TURN = jb.Beam.from_slenderness(70.0), np.pi / 2, 2 * np.pi
# What is allowed to the last, and what is as of someone who means degrees.
ANGLES = {
    "precone": (lambda x: jb.Rotor(BEAM, precone=x), QUARTER, 4.0),
    "pitch": (lambda x: jb.Rotor(BEAM, pitch=x), TURN, -13.3),
    "twist": (lambda x: jb.Rotor(_twisted(x)), TURN, 13.3),
    "twist at stations": (lambda x: jb.Rotor(_twisted(jb.Spanwise([0, 1], [x, 0]))), TURN, -13.3),
    "twist by a function": (lambda x: jb.Rotor(_twisted(_linear(x))), TURN, 13.3),
}


def _twisted(twist):
    return jb.Beam(1.0, 1.0, 1e4, 1.0, 1.0, twist)


def _linear(x):
    return SpanwiseFunction(jax.tree_util.Partial(lambda a, xi: a * (1 - xi), x))


@pytest.mark.parametrize("name", ANGLES)
def test_degrees_for_radians(name):
    make, most, wrong = ANGLES[name]
    code = jb.Status[f"INVALID_{name.split()[0].upper()}"]
    assert code.blames_input
    assert "in rad (4 degrees are np.deg2rad(4.0))" in code.message
    with pytest.raises(ValueError, match=re.escape(f"{code.message}, got")):
        make(wrong)
    for x in (most, -most, np.float32(most), np.deg2rad(wrong)):
        make(x)
    cases = jnp.array([most, -most, np.deg2rad(wrong), wrong, -wrong, jnp.nan])
    found = jax.jit(jax.vmap(lambda x: make(x).status(jnp.zeros(()))))(cases)
    np.testing.assert_array_equal(found, [0, 0, 0, code, code, code])


def test_degrees_in_an_argument_of_a_program():
    """A case of a batch fails alone; what gets in without its constructor meets the checks, too."""
    model, level = jb.Hybrid(0, 1, 1), jb.Rotor(BEAM, pitch=0.0)

    def case(pitch):
        rotor = eqx.tree_at(lambda rotor: rotor.pitch, level, pitch)
        return jb.modes(model, rotor, 1.0, 1, throw=False)

    found = jax.jit(jax.vmap(case))(jnp.array([0.1, 13.3]))
    np.testing.assert_array_equal(found.status, [0, jb.Status.INVALID_PITCH])
    np.testing.assert_array_equal(np.isfinite(found.frequency), [[True], [False]])
    with pytest.raises(ValueError, match="pitch must be finite and within a turn"):
        case(jnp.asarray(13.3))


def test_bad_sections_name_the_argument():
    section = {
        "length": 1.0,
        "youngs_modulus": 1.0,
        "density": 1.0,
        "area": 1.0,
        "in_plane_second_moment": 1.0,
    }
    for name in section:
        with pytest.raises(ValueError, match=f"{name} must be finite and > 0"):
            jb.Beam.from_section(**section | {name: -1.0})
    with pytest.raises(ValueError, match="slenderness must be finite and > 0"):
        jb.Beam.from_slenderness(0.0)


@pytest.mark.slow
def test_signs_do_not_cancel_in_a_sweep():
    model = jb.Hybrid(2, 4, 0)

    def of_slenderness(slenderness):
        return jb.modes(model, jb.Rotor(jb.Beam.from_slenderness(slenderness)), 1.0, throw=False)

    table = jb.sweep(of_slenderness, jb.grid(slenderness=[-60.0, 60.0]))
    assert table["status"].tolist() == [jb.Status.INVALID_AXIAL_STIFFNESS, jb.Status.OK]

    def of_material(density, area):
        beam = jb.Beam.from_section(
            length=1.0, youngs_modulus=1.0, density=density, area=area, in_plane_second_moment=1.0
        )
        return jb.modes(model, jb.Rotor(beam), 0.1, throw=False)

    table = jb.sweep(of_material, jb.points(density=[-1.0, 1.0], area=[-1.0, 1.0]))
    assert table["status"].tolist() == [jb.Status.INVALID_MASS_PER_LENGTH, jb.Status.OK]


def _with(name, value):
    model = jb.Hybrid(2, 2, 2)
    if name in GOOD:
        return jb.modes(model, jb.Rotor(jb.Beam(**GOOD | {name: value})), 1.0)
    rotor = jb.Beam(**GOOD)
    if name == "angular_speed":
        return jb.modes(model, jb.Rotor(rotor), value)
    return jb.modes(model, jb.Rotor(rotor, **{name: value}), 1.0)


@pytest.mark.slow
def test_import_leaves_jax_configuration_alone_and_32_bits_bring_a_warning():
    program = """
import warnings, jax, jaxbeam as jb
assert not jax.config.read("jax_enable_x64")
rotor = jb.Rotor(jb.Beam.from_slenderness(100.0))
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    found = jb.modes(jb.Hybrid(2, 6, 0), rotor, 1.0, 1)
assert any("32-bit" in str(w.message) for w in caught)
assert abs(float(found.frequency[0]) - 3.54) < 0.01
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=900)


def test_tension_is_the_integral_of_the_centrifugal_load():
    rotor = jb.Rotor(jb.Beam(**GOOD), hub_radius=0.7, tip_mass=0.3)
    x = np.linspace(0, 8, 9)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    for speed in (0.0, 2.5):
        c0, c1, c2 = rotor.tension(jnp.asarray(speed))
        xi = x / 8
        p = c0 + c1 * (1 - xi) + c2 * (1 - xi**2) / 2
        for xk, pk in zip(x, p, strict=True):
            y = xk + (8 - xk) * (nodes + 1) / 2
            beam = 0.2 * np.sum(weights * (8 - xk) / 2 * (0.7 + y))
            np.testing.assert_allclose(pk, speed**2 * (beam + 0.3 * 8.7), rtol=1e-13)


def test_functions_along_the_span_under_jit():
    """What is known is checked under `jit` as well, and what a closure hides is not."""
    known = jb.Rotor(jb.Beam(**GOOD | {"mass_per_length": SpanwiseFunction(lambda x: 2 - x)}))
    model = jb.Hybrid(0, 0, 6)

    def first(rotor):
        return jb.modes(model, rotor, 1.0, jb.labels(flap=1)).frequency

    np.testing.assert_allclose(jax.jit(lambda: first(known))(), first(known), rtol=1e-12)

    def hidden(taper):
        mass = SpanwiseFunction(lambda x: 2 - taper * x)
        return jb.Beam(**GOOD | {"mass_per_length": mass}).mass

    np.testing.assert_allclose(jax.jit(hidden)(1.0), 12.0, rtol=1e-12)
    with pytest.raises(ValueError, match="mass_per_length"):
        jax.jit(lambda: hidden(3.0))()


def test_a_function_of_the_span_may_hold_functions_of_its_own():
    """As the layers of a network hold what they are passed through: a rotor goes through `jit`."""

    class Layer(eqx.Module):
        scale: jax.Array
        through: Callable

        def __call__(self, xi):
            return 1.0 + self.through(self.scale * xi)

    layer = SpanwiseFunction(Layer(jnp.asarray(0.5), jnp.square))
    rotor = jb.Rotor(jb.Beam(**GOOD | {"mass_per_length": layer}))
    found = jax.jit(lambda r: (r, r.beam.mass_per_length.at(np.ones(1))))(rotor)
    np.testing.assert_allclose(found[1], 1.25)
    assert jax.tree.structure(found[0]) == jax.tree.structure(rotor)


@pytest.mark.parametrize("values", [[3.0, 2.0], [3.0, 2.0, 1.0, 0.5, 0.2], 3.0])
def test_values_put_into_a_table_are_as_many_as_its_stations(values):
    """JAX would take the last one again, or leave out what is too much, without a word."""
    beam = jb.Beam(10.0, jb.Spanwise([0, 0.5, 1], [3.0, 2.0, 1.0]), 1e9, 1e6, 1e6)
    other = eqx.tree_at(lambda beam: beam.mass_per_length.values, beam, jnp.array(values))
    with pytest.raises(ValueError, match="values must be as many as stations, 3"):
        jb.modes(jb.Hybrid(0, 4, 0), jb.Rotor(other), 0.0)


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(jb.Beam) if f.default is None])
def test_what_a_beam_need_not_have_takes_a_rotor_off_the_bands(name):
    """Tables of bands know no more than a plain rotor has; of torsion they need to know nothing."""
    given = jb.PointMasses([0.5], [0.3]) if name == "point_masses" else 0.3
    rotor = jb.Rotor(jb.Beam(**GOOD, **{name: given}))
    assert rotor.is_plain == (name in ("torsional_stiffness", "polar_inertia"))
