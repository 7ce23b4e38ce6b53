"""Modes of many cases at once, by bands: those of single cases, and of the continuum."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._models.contract.door import checked_case
from jaxbeam._modes.banded import bands_of
from jaxbeam._modes.search import MANY, is_certain
from jaxbeam._modes.wanted import choose
from tests.references import power_series
from tests.tiers import slow

PLANE = jb.Hybrid(n_stretch=8, n_in_plane=16, n_flap=0)
SPACE = jb.Hybrid(n_stretch=4, n_in_plane=8, n_flap=10)
STIFF = jb.Hybrid(n_stretch=0, n_in_plane=12, n_flap=0)
ELEMENTS = [jb.papers.ANCF(4), jb.papers.TangentANCF(6)]
NAMES = (
    "speed", "hub_radius", "tip_mass", "length", "mass_per_length", "axial_stiffness",
    "in_plane_bending_stiffness", "flap_bending_stiffness",
)  # fmt: skip


def rotor(values):
    """A rotor and its speed."""
    v = dict(zip(NAMES, values, strict=True))
    beam = jb.Beam(*(v[name] for name in NAMES[3:]))
    return jb.Rotor(beam, v["hub_radius"], v["tip_mass"]), v["speed"]


def cases(size=MANY, top=12.0):
    rng = np.random.default_rng(5)
    spans = (
        (0.0, top), (0.0, 2.0), (0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (4e4, 4e5), (0.5, 2.0),
        (0.5, 4.0),
    )  # fmt: skip
    return jnp.asarray(np.stack([rng.uniform(*span, size) for span in spans], 1))


def of(model, which):
    return lambda v: jb.modes(model, *rotor(v), which, throw=False)


def alone(model, which, cases):
    """The same, case by case."""
    one = jax.jit(of(model, which))
    found = [one(case) for case in cases]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *found)


def assert_alike(many, single):
    for name in ("direction", "number", "status"):
        np.testing.assert_array_equal(getattr(many, name), getattr(single, name), name)
    np.testing.assert_allclose(many.eigenvalue, single.eigenvalue, rtol=1e-9, atol=1e-9)
    scale = np.nanmax(np.abs(single.shape))
    np.testing.assert_allclose(many.shape / scale, single.shape / scale, atol=1e-6)
    np.testing.assert_allclose(many.energy_share, single.energy_share, atol=1e-8)
    np.testing.assert_allclose(many.steady_strain, single.steady_strain, rtol=1e-9, atol=1e-13)
    assert np.all(np.nan_to_num(many.residual) < 1e-9)


def by_bands(model, which, cases):
    """Whether the search in bands vouches for all modes of a case."""
    wanted = choose(model, which)
    bands = bands_of(model, wanted.most, wanted.count)
    named = wanted.named and tuple(a.astype(float) for a in wanted.named)

    def one(v):
        return is_certain(bands.lowest(*checked_case(model, *rotor(v))[1:], named))

    return np.asarray(jax.jit(jax.vmap(one))(cases))


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "named"),
    [
        (PLANE, False),
        (ELEMENTS[0], False),
        slow(SPACE, True),
        (STIFF, True),
        (ELEMENTS[1], True),
    ],
    ids=repr,
)
def test_many_are_as_single_ones(model, named):
    """Eigenvalues, shapes, labels, shares of energy; and bands find all of them."""
    which = 3
    if named:
        which = jb.labels(in_plane=2, axial=int(model != STIFF), flap=2 if model == SPACE else 0)[
            ::-1
        ]
    # Model 0 is unstable at high speed.
    soft = isinstance(model, jb.papers.TangentANCF)
    some = cases(top=2.0 if soft else 12.0)
    many = jax.jit(jax.vmap(of(model, which)))(some)
    assert np.all(many.status == jb.Status.OK)
    assert_alike(jax.tree.map(lambda a: a[:40], many), alone(model, which, some[:40]))
    assert np.mean(by_bands(model, which, some)) > 0.97


@pytest.mark.exhaustive
@pytest.mark.parametrize("which", [6, jb.labels(flap=1)], ids=repr)
def test_six_of_them_or_those_of_one_plane(which):
    some = cases()
    many = jax.jit(jax.vmap(of(SPACE, which)))(some)
    assert_alike(jax.tree.map(lambda a: a[:40], many), alone(SPACE, which, some[:40]))
    assert np.mean(by_bands(SPACE, which, some)) > 0.9


@pytest.mark.exhaustive
def test_measured_frequencies_in_plane_pass_over_flap():
    """One by one and many at once."""
    given, _ = rotor(cases()[0])
    speeds = np.linspace(0.0, 5.0, MANY)
    plain = jb.modes(SPACE, given, speeds[7], jb.labels(in_plane=2)).frequency
    for seen in (speeds[:10], speeds):
        data = jb.FrequencyData(SPACE, given, seen, np.ones((len(seen), 2)), 1.0, 2)
        np.testing.assert_allclose(data.predicted()[7], plain, rtol=1e-9)


@pytest.mark.release
@pytest.mark.slow
@pytest.mark.parametrize("model", [PLANE], ids=repr)
def test_frequencies_of_the_continuum(model):
    """Multiple precision, see `power_series`; what is asked for with them does not matter."""
    numbers = [(0.0, 0.0, 0.0, 200.0), (3.0, 0.5, 0.0, 300.0), (12.0, 0.0, 1.0, 200.0)]
    rows = [(g, hub, tip, 1.0, 1.0, s**2, 1.0, 1.0) for g, hub, tip, s in numbers]
    ours = jax.jit(jax.vmap(of(model, 3)))(jnp.asarray(rows * (MANY // 3 + 1)))
    for row, case in enumerate(numbers):
        exact = power_series.frequencies(*case)
        np.testing.assert_allclose(ours.frequency[row], exact, rtol=1e-8)
        np.testing.assert_array_equal(ours.frequency[row + 3], ours.frequency[row])
    np.testing.assert_array_equal(np.argmax(ours.energy_share, -1), ours.direction)
    assert np.all(ours.direction == jb.models.Direction.IN_PLANE)


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.Hybrid(8, 16, 8), jb.PlanarRod(8)], ids=repr)
def test_random_rotors_get_an_answer_or_a_true_reason(model):
    """Slender and stout ones, at speeds up to where they tear and beyond, whatever is lowest."""
    rng = np.random.default_rng(20)
    n = 300
    slenderness = np.exp(rng.uniform(np.log(50.0), np.log(1500.0), n))
    columns = (
        rng.uniform(0.0, 60.0, n), rng.uniform(0.0, 6.0, n), rng.uniform(0.0, 5.0, n), np.ones(n),
        np.ones(n), slenderness**2, np.ones(n), rng.uniform(0.5, 2.0, n),
    )  # fmt: skip
    some = jnp.asarray(np.stack(columns, 1))
    many = jax.jit(jax.vmap(of(model, 3)))(some)
    torn = np.asarray(jax.vmap(lambda v: rotor(v)[0].tears(v[0]))(some))
    np.testing.assert_array_equal(many.status, np.where(torn, jb.Status.NO_EQUILIBRIUM, 0))
    assert 10 < torn.sum() < 200
    lowest = np.asarray(many.direction)[~torn]
    assert np.sum(np.any(lowest == jb.models.Direction.AXIAL, 1)) > 30
    sure = by_bands(model, 3, some)
    assert not np.any(sure & torn)
    assert np.mean(sure[~torn]) > 0.6
    assert_alike(jax.tree.map(lambda a: a[:60], many), alone(model, 3, some[:60]))


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [PLANE, jb.papers.ANCF(4)], ids=repr)
def test_derivatives_are_those_of_single_cases(model):
    """By every parameter, in both modes, of eigenvalues, shapes and shares; second ones too."""
    some = cases()

    def numbers(v):
        found = of(model, 3)(v)
        return jnp.stack([found.frequency, found.energy_share[:, 1], found.shape[:, -1].real])

    def close(ours, wanted):
        scale = np.abs(wanted).max(axis=0)[None] + 1e-6 * np.abs(wanted).max() + 1e-300
        np.testing.assert_allclose(ours / scale, wanted / scale, atol=1e-6)

    def frequency(v):
        return of(model, 3)(v).frequency

    single = jax.jit(jax.jacfwd(numbers))
    wanted = np.stack([single(v) for v in some[:4]])
    close(jax.jit(jax.vmap(jax.jacfwd(numbers)))(some)[:4], wanted)
    ours = jax.jit(jax.vmap(jax.jacrev(frequency)))(some)[:4]
    close(ours, wanted[:, 0])
    step = 1e-6 * np.maximum(np.abs(some[:4]), 1e-2)
    many = jax.jit(jax.vmap(frequency))
    for i in range(some.shape[1]):
        ahead, behind = (many(some.at[:4, i].add(sign * step[:, i]))[:4] for sign in (1.0, -1.0))
        difference = (ahead - behind) / (2 * step[:, i, None])
        scale = np.abs(wanted[:, 0]).max(axis=(0, 1))[i] + 1e-9
        np.testing.assert_allclose(difference / scale, wanted[:, 0, :, i] / scale, atol=1e-5)
    if model == PLANE:
        curved = jax.jit(jax.jacfwd(jax.jacrev(frequency)))
        ours = jax.jit(jax.vmap(jax.jacfwd(jax.jacrev(frequency))))(some)[:2]
        close(ours, np.stack([curved(v) for v in some[:2]]))


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [slow(PLANE), jb.papers.ANCF(4)], ids=repr)
def test_bad_cases_are_named_and_leave_the_others_as_they_are(model):
    some = cases()
    spoilt = some.at[1, 0].set(jnp.nan).at[2, 2].set(-1.0).at[3, 0].set(1e5)
    run = jax.jit(jax.vmap(of(model, 3)))
    good, bad = run(some), run(spoilt)
    expected = [0, jb.Status.INVALID_ANGULAR_SPEED, jb.Status.INVALID_TIP_MASS, 0]
    np.testing.assert_array_equal(bad.status[np.array([0, 1, 2, 4])], expected)
    assert bad.status[3] == (jb.Status.NO_EQUILIBRIUM if model == PLANE else good.status[0])
    kept = np.r_[0, 4 : len(some)]
    np.testing.assert_array_equal(bad.frequency[kept], good.frequency[kept])
    assert np.all(np.isnan(bad.frequency[1:3]))

    spoilt = spoilt.at[4, 3].set(1e100)  # whose frequency scale is zero

    def total(change):
        return jnp.nansum(jax.vmap(lambda v: of(model, 3)(v + change).frequency)(spoilt))

    assert np.all(np.isfinite(jax.jit(jax.grad(total))(jnp.zeros(len(NAMES)))))


@pytest.mark.exhaustive
def test_growing_modes_come_first_among_many():
    """Those that bands do not find: of a model that is unstable at these speeds."""
    model, some = jb.papers.TangentANCF(2), cases(top=30.0)
    many = jax.jit(jax.vmap(of(model, 2)))(some)
    grows = np.asarray(many.growth_rate[:, 0] > 0)
    assert 20 < grows.sum() < MANY - 20
    assert not np.any(by_bands(model, 2, some) & grows)
    first = np.flatnonzero(grows)[:10]
    single = alone(model, 2, some[first])
    assert_alike(jax.tree.map(lambda a: a[first], many), single)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "numbers"),  # axial stiffness, tip mass, speed
    [
        (jb.Hybrid(4, 8, 0), (6264.3353665688555, 3.1622776601683795, 3.1622776601683795)),
        (jb.papers.GreenANCF(3), (1000.0, 1.0, 1.0)),
        (jb.papers.GreenANCF(3), (1596.338544287942, 0.1333521432163324, 1.0)),
    ],
)
def test_no_mode_is_skipped_where_axial_ones_pass(model, numbers):
    """Here, and where axial modes pass through the lowest ones, found by drawing scenes."""
    stiffness, tip_mass, speed = numbers
    stiffness = stiffness * np.r_[1.0, np.geomspace(0.1, 10.0, MANY)]
    rest = (speed, 1.0, tip_mass, 1.0, 1.0)
    some = jnp.asarray([(*rest, ea, 1.0, 1.0) for ea in stiffness])
    many = jax.jit(jax.vmap(of(model, 3)))(some)
    few = np.r_[0, 1:MANY:6]
    assert_alike(jax.tree.map(lambda a: a[few], many), alone(model, 3, some[few]))


def _softer(given):
    """The rotor with half of its bending stiffness."""
    stiffness = given.beam.in_plane_bending_stiffness / 2
    return eqx.tree_at(lambda r: r.beam.in_plane_bending_stiffness, given, stiffness)


class _RibbedElements(jb.papers.GreenANCF):
    """Whose bending stiffness has a part in N m^2 that no parameter says."""

    def equations(self, rotor):
        bending = rotor.beam.in_plane_bending_stiffness + 0.5
        return super().equations(
            eqx.tree_at(lambda r: r.beam.in_plane_bending_stiffness, rotor, bending)
        )


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [slow(jb.PlanarRod(2)), _RibbedElements(2)], ids=repr)
def test_derivatives_of_elements_are_limits_of_differences(model):
    """Also where, in units of the beam, equations depend on more than those of the package."""
    some = cases().at[:, :3].add(0.05)  # what is not negative is not made so
    ours = jax.jit(jax.vmap(jax.jacrev(lambda v: of(model, 2)(v).frequency)))(some)
    some, ours = some[: MANY // 8], ours[: MANY // 8]
    # Of six points, far apart: rounding of single frequencies is what counts.
    step = 1e-2 * jnp.maximum(jnp.abs(some), 0.1)
    ways = jnp.array([[1.0, 2.0, 3.0], [-1.0, -2.0, -3.0]])
    along = jnp.einsum("sk,ni,ij->skinj", ways, step, jnp.eye(len(NAMES)))
    beside = (some[None, None, None] + along).reshape(-1, len(NAMES))
    found = jax.jit(jax.vmap(lambda v: of(model, 2)(v).frequency))(beside)
    ahead, behind = found.reshape(*along.shape[:-1], 2)
    apart = jnp.einsum("k,kinm->nmi", jnp.array([45, -9, 1]) / 60, ahead - behind)
    scale = jnp.abs(ours).max((0, 1), keepdims=True) + 1e-9
    np.testing.assert_allclose(apart / step[:, None] / scale, ours / scale, atol=1e-7)


class _HeldElements(jb.papers.GreenANCF):
    def steady(self, rotor, speed):
        q, status = super().steady(rotor, speed)
        return 0 * q, status


class _OtherMatrices(jb.papers.GreenANCF):
    def matrices(self, rotor, speed):
        return super().matrices(rotor, 2 * speed)


@pytest.mark.parametrize("kind", [_HeldElements, _OtherMatrices])
def test_derivatives_of_derived_classes_are_of_what_these_say(kind):
    """Alone, where eigenvalues are those of the matrices."""
    beam = jb.Beam(1.0, 1.0, 1e3, 1.0, 1.0)

    @jax.jit
    def both(radius):
        def frequency(radius):
            return jb.modes(kind(1), jb.Rotor(beam, radius, 0.1), 2.0, 1, throw=False).frequency

        return frequency(radius), jax.jacfwd(frequency)(radius)

    (ahead, _), (behind, _), (_, slope) = (both(0.3 + step) for step in (1e-4, -1e-4, 0.0))
    np.testing.assert_allclose((ahead - behind) / 2e-4, slope, rtol=1e-6, atol=1e-9)


class _SoftHybrid(jb.Hybrid):
    def equations(self, rotor):
        return super().equations(_softer(rotor))


class _StiffHybrid(jb.Hybrid):
    def linear_stiffness(self, rotor, shapes):
        return 4 * super().linear_stiffness(rotor, shapes)


class _SoftElements(jb.papers.GreenANCF):
    def equations(self, rotor):
        return super().equations(_softer(rotor))


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [_SoftHybrid(4, 8, 0), _StiffHybrid(4, 8, 0), _SoftElements(2)])
def test_models_with_other_equations_do_not_get_those_of_their_base(model):
    """Elements say all that counts in their equations; the tables of `Hybrid` do not."""
    some = cases()
    many = jax.jit(jax.vmap(of(model, 2)))(some)
    assert_alike(jax.tree.map(lambda a: a[:5], many), alone(model, 2, some[:5]))
    changed = {_SoftHybrid: jb.Hybrid(4, 8, 0), _StiffHybrid: jb.Hybrid(4, 8, 0)}
    base = changed.get(type(model), jb.papers.GreenANCF(2))
    theirs = alone(base, 2, some[:5]).frequency
    assert np.all(np.abs(many.frequency[:5, 0] / theirs[:, 0] - 1) > 0.01)
