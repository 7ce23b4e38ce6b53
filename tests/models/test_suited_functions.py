"""Functions that suit a beam, on the blade of the NREL 5-MW turbine."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._rotor.span import Span
from tests.tiers import slow
from tests.vibration import blade_reference

BLADE = jb.blades.read_csv(blade_reference.NREL, length=61.5, axial_stiffness=1e10).beam


@pytest.mark.exhaustive
@pytest.mark.parametrize("rpm", [0.0, slow(12.1)])
def test_of_a_twisted_blade(rpm):
    """Some functions are for what a moment bends across; what is left is known, by per cents where
    functions leave it and not quadrature, of which twice as much is said to be missed."""
    speed = rpm * np.pi / 30
    exact = np.array(blade_reference.frequencies(blade_reference.nrel5mw(), speed, 5))
    for count, tolerances in ((12, (4e-7, 4e-7, 2e-5, 2e-5, 2e-4)), (16, 4 * (3e-6,) + (2e-5,))):
        found = jb.modes(jb.Hybrid(0, count, count), jb.Rotor(BLADE, 1.5), speed, 5)
        error = np.abs(np.asarray(found.frequency) / exact - 1)
        assert (error < tolerances).all()
        estimate = np.asarray(found.frequency_error)
        assert (estimate > error / 3).all()
        assert (estimate < 30 * error).all()
        np.testing.assert_allclose(estimate[error > 1e-7], error[error > 1e-7], rtol=0.05)


def test_of_a_beam_turned_as_a_whole():
    """What bends across is no other function then."""
    beam = jb.Beam(1.0, 1.0, 1e6, 16.0, 1.0, twist=0.3)
    found = jb.modes(jb.Hybrid(0, 12, 12), jb.Rotor(beam), 0.0, 4).frequency
    first, second, third = 3.5160152685, 22.0344915647, 61.6972144135
    assert np.allclose(found, [first, 4 * first, second, third], rtol=1e-8)


def cone(**more):
    """A blade that tapers in both directions to a tenth: 1 / EI grows ten thousandfold."""
    mass, stiffness = (
        jb.blades.SpanwiseFunction(lambda x, n=n: (1 - 0.9 * x) ** n, **more) for n in (2, 4)
    )
    return jb.Beam(1.0, mass, 1e9, stiffness, stiffness)


def test_of_what_is_soft_at_its_tip():
    """A truncated cone; the same where the stiffness of a table is traced; two stations that are
    next to each other, as steps are written. References are of tests/vibration/blade_reference.py.
    """
    model = jb.Hybrid(0, 12, 0)
    found = jb.modes(model, jb.Rotor(cone()), 0.0, 2)
    wanted = blade_reference.Blade(
        mass=lambda x: (1 - 0.9 * x) ** 2, flap=lambda x: (1 - 0.9 * x) ** 4
    )
    exact = np.array(blade_reference.flap(wanted, 0.0, 2))
    np.testing.assert_allclose(found.frequency, exact, rtol=1e-7)
    assert np.max(found.frequency_error) < 1e-7


@pytest.mark.slow
def test_of_a_layer_at_the_root():
    """At high speed a beam bends near its clamp: graded polynomials are for that, built or not."""
    stiffness = jb.Spanwise([0.0, 1.0], [1.0, 0.3])
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e8, 1.0, stiffness), 0.1)
    wanted = blade_reference.Blade(hub=0.1, flap=lambda x: 1 - 0.7 * x)
    exact = np.array(blade_reference.flap(wanted, 100.0, 3))
    for grading, most in ((2, 6e-5), (1, 3e-4)):
        model = jb.Hybrid(0, 0, 14, jb.models.Polynomials(grading=grading))
        found = jb.modes(model, rotor, 100.0, 3)
        error = np.abs(np.asarray(found.frequency) / exact - 1)
        assert error.max() < most
        assert (error < 3 * np.asarray(found.frequency_error) + 1e-10).all()
        assert (np.asarray(found.frequency_error) < 3 * error + 1e-10).all()


def stations(soft, gap=1e-6):
    stiffness = jb.Spanwise([0, 0.3, 0.3 + gap, 1], jnp.array([1.0, 1.0, 0.5, 1.0]) * soft)
    return jb.Rotor(jb.Beam(1.0, 1.0, 1e9, stiffness, 1.0))


def test_no_columns_have_integrals():
    """Models with one function in each direction have none that tension makes."""
    span = Span.between((0.0, 0.5, 1.0), 4)
    for integral in (span.up_to, span.beyond):
        assert integral(np.zeros((8, 0))).shape == (8, 0)


@pytest.mark.slow
def test_traced_values_and_stations_side_by_side():
    """Values may be traced; a step that is written as two near stations is one."""
    soft = np.array([1.0, 1.0, 1.0, 0.01])

    def frequency(soft, gap=1e-6):
        return jb.modes(jb.Hybrid(0, 12, 0), stations(soft, gap), 1.0, 2).frequency

    values = np.array([1.0, 1.0, 0.5, 1.0]) * soft
    near = blade_reference.Blade(flap=((0, 0.3, 0.3, 1), tuple(values)), lag=1.0)
    flap = np.array(blade_reference.flap(near, 1.0, 2))
    exact = np.sqrt(flap**2 - 1)
    np.testing.assert_allclose(jax.jit(frequency)(soft), exact, rtol=5e-6)
    np.testing.assert_allclose(frequency(jnp.asarray(soft), 1e-12), exact, rtol=1e-6)
    slope = jax.jit(jax.jacrev(frequency))(soft)
    ends = [jax.jit(frequency)(soft * (1 + step)) for step in (1e-5, -1e-5)]
    np.testing.assert_allclose(slope @ soft, (ends[0] - ends[1]) / 2e-5, rtol=1e-6)


@pytest.mark.slow
def test_what_nobody_declared_is_estimated():
    """A step that no kink names, a property that varies faster than points of integration, and too
    few functions: the error is known, and beyond 1e-3 there is a status."""

    def step(x):
        return jnp.where(x < 0.43, 1.0, 0.25)

    def of(function, n=16, kinks=()):
        beam = jb.Beam(1.0, 1.0, 1e9, jb.blades.SpanwiseFunction(function, kinks), 1.0)
        return jb.modes(jb.Hybrid(0, n, 0), jb.Rotor(beam), 0.0, 3, throw=False)

    exact = np.asarray(of(step, 24, (0.43,)).frequency)
    found = of(step)
    if found.status == jb.Status.OK:
        error = np.abs(np.asarray(found.frequency) / exact - 1)
        assert (found.frequency_error > error / 3).all()
    else:
        assert found.status == jb.Status.TOO_FEW_FUNCTIONS
    assert np.max(found.frequency_error) > 1e-4
    waves = of(lambda x: 1.2 + jnp.sin(900 * x))
    assert waves.status == jb.Status.TOO_FEW_FUNCTIONS
    assert np.isnan(waves.frequency).all()
    few = of(step, 3, (0.43,))
    assert few.status == jb.Status.TOO_FEW_FUNCTIONS
    assert np.max(few.frequency_error) > 1e-3


class Drawn:
    """A random kind of blade, and blades of that kind: a table or a taper, with or without twist,
    springs of the root and a body at the tip."""

    def __init__(self, seed):
        self.rng = rng = np.random.default_rng([1, seed])
        self.places = np.array([0, *np.sort(rng.uniform(0.02, 0.98, rng.integers(0, 10))), 1])
        if self.places.size > 3 and rng.uniform() < 0.3:
            self.places[2] = self.places[1] + 10 ** rng.uniform(-8, -3)
            self.places.sort()
        self.tapers, self.has_body = rng.uniform(size=2) < (0.2, 0.35)
        self.twists, *self.springs = rng.uniform(size=3) < (0.4, 0.3, 0.3)
        self.powers = int(rng.integers(1, 5)), int(rng.integers(0, 3))

    def draw(self):
        """Numbers of a blade; tables vary over up to three decades."""
        rng, n, decades = self.rng, self.places.size, self.rng.uniform(0, 3)

        def logarithms():
            some = rng.uniform(-decades, 0, n)
            return np.sort(some)[::-1] if rng.uniform() < 0.5 else some

        flap, ratio = logarithms(), rng.uniform(1, 30)
        lag = logarithms() if rng.uniform() < 0.5 else flap
        mass = flap * rng.uniform(0.3, 0.7) if rng.uniform() < 0.7 else rng.uniform(-1, 0, n)
        tip = rng.uniform(0, 0.5) if self.has_body or rng.uniform() < 0.4 else 0.0
        return {
            "flap": 10**flap, "lag": ratio * 10**lag, "mass": 10**mass, "hub": rng.uniform(0, 1),
            "twist": np.sort(rng.uniform(-0.5, 0.5, n)), "tip": tip, "ratio": ratio,
            "end": rng.choice([1e-3, 1e-2, 0.1, 0.5]), "springs": 10 ** rng.uniform(-1, 2, 2),
            "body": np.array([0.1, 0.02 * tip, 0.01 * tip]) * rng.uniform(size=3),
        }  # fmt: skip

    def properties(self, v):
        """Mass per length, lag and flap stiffness over x, of a taper."""
        p, q = self.powers

        def taper(power, factor):
            return jax.tree_util.Partial(
                lambda end, factor, x: factor * (1 - (1 - end) * x) ** power, v["end"], factor
            )

        return taper(q, 1.0), taper(p, v["ratio"]), taper(p, 1.0)

    def ours(self, v):
        def table(name):
            return jb.Spanwise(self.places, v[name])

        parts = [table(name) for name in ("mass", "lag", "flap")]
        if self.tapers:
            parts = [jb.blades.SpanwiseFunction(part) for part in self.properties(v)]
        twist = table("twist") if self.twists else None
        springs = [
            k if there else None for k, there in zip(v["springs"], self.springs, strict=True)
        ]
        offset, inertia, axial = v["body"]
        body = jb.TipBody(offset, inertia, axial) if self.has_body else None
        root = jb.RootSprings(*springs) if any(self.springs) else None
        beam = jb.Beam(1.0, parts[0], 1e6, *parts[1:], twist)
        return jb.Rotor(beam, v["hub"], v["tip"], root_springs=root, tip_body=body)

    def theirs(self, v):
        offset, inertia, axial = v["body"].tolist()
        body = blade_reference.Body(v["tip"])
        if self.has_body:
            body = blade_reference.Body(v["tip"], offset, inertia, inertia - axial)
        parts = [(self.places, v[name]) for name in ("mass", "lag", "flap")]
        if self.tapers:
            parts = [
                lambda x, part=part: np.asarray(part(x)) + 0 * x for part in self.properties(v)
            ]
        springs = [
            float(k) if there else None for k, there in zip(v["springs"], self.springs, strict=True)
        ]
        return blade_reference.Blade(
            mass=parts[0], lag=parts[1], flap=parts[2], hub=v["hub"], tip=body,
            twist=(self.places, v["twist"]) if self.twists else 0.0,
            lag_spring=springs[0], flap_spring=springs[1],
        )  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(28))
def test_random_blades(seed):
    """336 against independent references, numbers traced: the lowest six by 16 functions to 5e-5,
    or to 1e-3 with twist and of tapers almost to a point; estimates are no less than a third of the
    error and no more than thirty times as much."""
    kind = Drawn(seed)

    @jax.jit
    def of(v, speed):
        found = jb.modes(jb.Hybrid(0, 16, 16), kind.ours(v), speed, throw=False)
        return found.frequency, found.frequency_error, found.status

    for _ in range(12):
        v = kind.draw()
        theirs = kind.theirs(v)
        speed = kind.rng.choice([0.0, kind.rng.uniform(0.5, 2)])
        speed *= blade_reference.frequencies(theirs, 0.0, 1)[0]
        exact = np.array(blade_reference.frequencies(theirs, speed, 6))
        frequency, estimate, status = of(v, speed)
        order = np.argsort(frequency)
        error = np.abs(np.asarray(frequency)[order] / exact - 1)
        estimate = np.asarray(estimate)[order]
        assert status == jb.Status.OK
        assert error.max() < (1e-3 if kind.tapers or kind.twists else 5e-5)
        seen = error > 1e-9
        assert (estimate[seen] > error[seen] / 3).all()
        assert (estimate < 30 * error + 1e-8).all()


@pytest.mark.exhaustive
def test_memory_grows_with_the_number_of_stations():
    """Of six hundred some tens of MB."""
    places, rng = np.linspace(0, 1, 600), np.random.default_rng(0)
    values = [rng.uniform(0.5, 1.0, places.size) for _ in range(3)]

    def frequency(values):
        mass, lag, flap = (jb.Spanwise(places, v) for v in values)
        return jb.modes(jb.Hybrid(0, 16, 16), jb.Rotor(jb.Beam(1.0, mass, 1e6, lag, flap)), 1.0)

    program = jax.jit(frequency).lower(values).compile()
    assert program.memory_analysis().temp_size_in_bytes < 2e8
