"""The fast sweeps of frequencies: what `modes` finds, and the continuum."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.vibration import reference

PLANE = jb.Hybrid(n_stretch=8, n_in_plane=16, n_flap=0)
ELEMENTS = [jb.ANCF(10), jb.EngineeringANCF(6), jb.models.ChordANCF(6), jb.models.TangentANCF(6)]
MODELS = [PLANE, jb.Hybrid(n_stretch=0, n_in_plane=12, n_flap=0), *ELEMENTS]
NAMES = (
    "speed", "hub_radius", "tip_mass", "length", "mass_per_length", "axial_stiffness", "bending",
)  # fmt: skip


def rotor(values):
    """A rotor and its speed."""
    v = dict(zip(NAMES, values, strict=True))
    beam = jb.Beam(
        v["length"], v["mass_per_length"], v["axial_stiffness"], v["bending"], v["bending"]
    )
    return jb.Rotor(beam, v["hub_radius"], v["tip_mass"]), v["speed"]


def by_number(gamma, hub, tip, slenderness):
    return jb.Rotor(jb.Beam(1.0, 1.0, slenderness**2, 1.0, 1.0), hub, tip), gamma


@pytest.mark.parametrize(
    ("gamma", "hub", "tip", "slenderness"),
    [
        (0.0, 0.0, 0.0, 200.0), (3.0, 0.5, 0.0, 300.0),
        (12.0, 0.0, 1.0, 200.0), (12.0, 2.0, 1.0, 500.0),
    ],
)  # fmt: skip
def test_frequencies_of_the_continuum(gamma, hub, tip, slenderness):
    """Multiple precision, see `reference`."""
    ours = jb.frequencies(PLANE, *by_number(gamma, hub, tip, slenderness))
    exact = reference.frequencies(gamma, hub, tip, slenderness)
    np.testing.assert_allclose(ours.frequency, exact, rtol=1e-8)


def batch(size, top=12.0):
    rng = np.random.default_rng(5)
    spans = ((0.0, top), (0.0, 2.0), (0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (4e4, 4e5), (0.5, 2.0))
    return jnp.asarray(np.stack([rng.uniform(*span, size) for span in spans], 1))


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS, ids=repr)
def test_frequencies_are_those_of_modes(model):
    # Model 0 is unstable at high speed.
    cases = batch(
        40, 2.0 if isinstance(model, jb.models.ChordANCF | jb.models.TangentANCF) else 12.0
    )
    fast = jax.jit(jax.vmap(lambda v: jb.frequencies(model, *rotor(v), throw=False)))(cases)
    slow = jax.jit(jax.vmap(lambda v: jb.modes(model, *rotor(v), 3, throw=False).frequency))(cases)
    assert np.all(fast.status == jb.Status.OK)
    np.testing.assert_allclose(fast.frequency, slow, rtol=2e-9)
    alone = jax.jit(lambda v: jb.frequencies(model, *rotor(v)))(cases[7])
    np.testing.assert_allclose(alone.frequency, fast.frequency[7], rtol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 6])
def test_any_number_of_them(count):
    case = by_number(8.0, 1.0, 0.2, 1000.0)
    ours = jb.frequencies(PLANE, *case, count).frequency
    np.testing.assert_allclose(ours, jb.modes(PLANE, *case, count).frequency, rtol=2e-9)


@pytest.mark.slow
@pytest.mark.parametrize("model", [PLANE, jb.ANCF(6)], ids=repr)
def test_gradients_are_those_of_modes(model):
    """By every parameter, in both modes, case by case and of a sum over a batch."""
    cases = batch(5)

    def fast(v):
        return jb.frequencies(model, *rotor(v), throw=False).frequency

    def slow(v):
        return jb.modes(model, *rotor(v), 3, throw=False).frequency

    wanted = jax.jit(jax.vmap(jax.jacrev(slow)))(cases)
    scale = np.abs(wanted).max(axis=(0, 1))[None, None]
    for jacobian in (jax.jacfwd, jax.jacrev):
        ours = jax.jit(jax.vmap(jacobian(fast)))(cases)
        np.testing.assert_allclose(ours / scale, wanted / scale, atol=1e-7)
    summed = jax.jit(jax.grad(lambda cases: jnp.sum(jax.vmap(fast)(cases))))(cases)
    np.testing.assert_allclose(summed / scale[0], wanted.sum(1) / scale[0], atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("model", [PLANE, jb.ANCF(6)], ids=repr)
def test_bad_cases_are_named_and_leave_the_others_as_they_are(model):
    cases = batch(5)
    spoilt = cases.at[1, 0].set(jnp.nan).at[2, 2].set(-1.0).at[3, 0].set(1e5)
    run = jax.jit(jax.vmap(lambda v: jb.frequencies(model, *rotor(v), throw=False)))
    good, bad = run(cases), run(spoilt)
    torn = jb.Status.NO_EQUILIBRIUM if isinstance(model, jb.Hybrid) else jb.Status.NOT_CONVERGED
    expected = [0, jb.Status.INVALID_ANGULAR_SPEED, jb.Status.INVALID_TIP_MASS, torn, 0]
    if isinstance(model, jb.Hybrid):
        np.testing.assert_array_equal(bad.status, expected)
    else:  # Model A hardens: at some speeds it is right, at none it is silent
        np.testing.assert_array_equal(np.delete(bad.status, 3), np.delete(expected, 3))
        assert bad.status[3] in (0, torn)
    for kept in (0, 4):
        np.testing.assert_array_equal(bad.frequency[kept], good.frequency[kept])
    assert np.all(np.isnan(bad.frequency[1:3]))

    def total(change):
        found = jax.vmap(lambda v: jb.frequencies(model, *rotor(v + change), throw=False))(spoilt)
        return jnp.nansum(found.frequency)

    assert np.all(np.isfinite(jax.jit(jax.grad(total))(jnp.zeros(7))))


def test_a_beam_without_stretch_does_not_tear():
    """Whatever its axial stiffness is said to be."""
    model, case = jb.Hybrid(n_stretch=0, n_in_plane=12, n_flap=0), by_number(20.0, 0.3, 0.2, 10.0)
    ours = jb.frequencies(model, *case).frequency
    np.testing.assert_allclose(ours, jb.modes(model, *case, 3).frequency, rtol=2e-9)


def test_an_axial_mode_among_the_lowest_is_reported():
    found = jb.frequencies(PLANE, *by_number(0.0, 0.0, 0.0, 10.0), throw=False)
    assert found.status == jb.Status.NOT_CONVERGED
    with pytest.raises(RuntimeError, match="converge"):
        jb.frequencies(PLANE, *by_number(0.0, 0.0, 0.0, 10.0))
    with pytest.raises(RuntimeError, match=r"an axial mode is among them .* so take modes"):
        jb.frequencies(PLANE, *by_number(0.0, 0.0, 0.0, 10.0))


@pytest.mark.parametrize(
    ("model", "numbers"),  # axial stiffness, tip mass, speed
    [
        (jb.Hybrid(4, 8, 0), (6264.3353665688555, 3.1622776601683795, 3.1622776601683795)),
        pytest.param(jb.GreenANCF(3), (1000.0, 1.0, 1.0), marks=pytest.mark.slow),
        pytest.param(
            jb.GreenANCF(3), (1596.338544287942, 0.1333521432163324, 1.0), marks=pytest.mark.slow
        ),
    ],
)
def test_no_mode_is_skipped(model, numbers):
    """Here, and where axial modes pass through the lowest ones, found by drawing scenes."""
    stiffness, tip_mass, speed = numbers
    stiffness = stiffness * np.r_[1.0, np.geomspace(0.1, 10.0, 40)]

    def both(stiffness):
        case = jb.Rotor(jb.Beam(1.0, 1.0, stiffness, 1.0, 1.0), 1.0, tip_mass), speed
        ours = jb.frequencies(model, *case, 3, throw=False)
        return ours.status, ours.frequency, jb.modes(model, *case, 3, throw=False).frequency

    status, ours, theirs = jax.jit(jax.vmap(both))(stiffness)
    fine = status == jb.Status.OK
    assert status[0] == jb.Status.NOT_CONVERGED
    assert 5 < fine.sum() < 40
    np.testing.assert_allclose(ours[fine], theirs[fine], rtol=1e-8)


def test_an_unstable_steady_state_is_reported():
    case = by_number(30.0, 0.0, 0.0, 200.0)
    found = jb.frequencies(jb.models.TangentANCF(2), *case, 1, throw=False)
    assert found.status == jb.Status.NOT_CONVERGED


def test_arguments_are_checked():
    case = by_number(1.0, 0.0, 0.0, 200.0)
    with pytest.raises(TypeError, match="take modes"):
        jb.frequencies(jb.VonKarman(), *case)
    with pytest.raises(TypeError, match="take modes"):
        jb.frequencies(jb.Hybrid(4, 4, 0), *case)
    with pytest.raises(ValueError, match="between 1 and 6"):
        jb.frequencies(PLANE, *case, 7)
    with pytest.raises(TypeError, match="which must be an int"):
        jb.frequencies(PLANE, *case, 2.0)
    with pytest.raises(NotImplementedError, match="first derivatives"):
        jax.hessian(lambda v: jb.frequencies(PLANE, *rotor(v), throw=False).frequency[0])(
            batch(1)[0]
        )


def _softer(given):
    """The rotor with half of its bending stiffness."""
    stiffness = given.beam.in_plane_bending_stiffness / 2
    return eqx.tree_at(lambda r: r.beam.in_plane_bending_stiffness, given, stiffness)


class _SoftHybrid(jb.Hybrid):
    def equations(self, rotor):
        return super().equations(_softer(rotor))


class _StiffHybrid(jb.Hybrid):
    def linear_stiffness(self, rotor):
        return 4 * super().linear_stiffness(rotor)


class _SoftElements(jb.GreenANCF):
    def equations(self, rotor):
        return super().equations(_softer(rotor))


def test_models_with_other_equations_do_not_get_those_of_their_base():
    """Elements say all that counts in their equations; the tables of `Hybrid` do not."""
    given, speed = rotor(batch(1)[0])
    for model in (_SoftHybrid(), _StiffHybrid()):
        with pytest.raises(TypeError, match="take modes for other models"):
            jb.frequencies(model, given, speed)
    found = jb.frequencies(_SoftElements(4), given, speed, 2).frequency
    expected = jb.frequencies(jb.GreenANCF(4), _softer(given), speed, 2).frequency
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    assert np.all(found < 0.99 * jb.frequencies(jb.GreenANCF(4), given, speed, 2).frequency)
