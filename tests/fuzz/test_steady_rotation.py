"""Random beams in steady rotation: their modes, frequencies and Southwell coefficients."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import event, given
from hypothesis import strategies as st

import jaxbeam as jb
from jaxbeam import Status
from jaxbeam._modes.search import MANY
from jaxbeam.models import Direction
from tests.fuzz.scenes import absurd, build, evaluated, examples, judged_at_speed, spinning
from tests.helpers import name
from tests.tiers import slow

EPS = np.finfo(float).eps


@functools.cache
def vibration(model):
    """Compiled: all modes, and the matrices that they belong to."""

    def run(p):
        rotor, n = build(model, p), len(model.directions)
        found = jb.modes(model, rotor, p["angular_speed"], n, throw=False)
        system = model.linearise(rotor, p["angular_speed"], throw=False)
        return {
            "status": found.status,
            "eigenvalue": found.eigenvalue,
            "shape": found.shape,
            "label": jnp.stack([found.direction, found.number], -1),
            "energy_share": found.energy_share,
            "residual": found.residual,
            "steady_strain": found.steady_strain,
            "matrices": (system.mass, system.gyroscopic, system.stiffness),
            "linearised": system.status,
        }

    return jax.jit(run)


def check_modes(model, p):
    found = evaluated(vibration(model), p)
    kept = "eigenvalue", "shape", "energy_share", "residual", "steady_strain"
    status = judged_at_speed(found, model, p, kept)
    assert status in (Status.OK, found["linearised"]) or found["linearised"] == Status.OK
    assert status == Status.OK or np.isnan(found["eigenvalue"]).all()
    if status != Status.OK or absurd(p):
        return
    (m, g, k), lam, x = found["matrices"], found["eigenvalue"], found["shape"]
    assert (lam.imag >= 0).all()
    square = (lam**2).real
    assert (np.diff(square) <= 1e-9 * np.abs(square[1:])).all()  # lowest first
    labels = [tuple(label) for label in found["label"]]
    assert sorted(labels) == [
        (direction, order + 1)
        for direction in Direction
        for order in range(model.directions.count(direction))
    ]
    np.testing.assert_allclose(found["energy_share"].sum(1), 1, rtol=1e-9)
    # what `residual` says, again
    norm, size = np.linalg.norm, np.abs(lam)
    q = lam[:, None] ** 2 * (x @ m.T) + lam[:, None] * (x @ g.T) + x @ k.T
    scale = size**2 * norm(m) + size * norm(g) + norm(k)
    assert (norm(q, axis=1) <= 1.1e-9 * scale * norm(x, axis=1)).all()
    # All are there: the product of their squares is det K / det M; and as many grow as K has
    # negative eigenvalues (the reasons are in `jaxbeam._stability.critical_speed`).
    scaled = np.sqrt(np.diag(m))
    m, k = (a / scaled / scaled[:, None] for a in (m, k))
    spread = np.abs(np.linalg.eigvalsh(k))
    lost = len(m) * EPS * (spread.max() / spread.min() + np.linalg.cond(m))
    product = np.linalg.slogdet(k)[1] - np.linalg.slogdet(m)[1]
    assert abs(2 * np.log(size).sum() - product) <= 1e-8 + 100 * lost
    if lost < 1e-3:
        assert (lam.real > 1e-6 * size).sum() == (np.linalg.eigvalsh(k) < 0).sum()


VIBRATING = [
    slow(jb.Hybrid(2, 4, 2)), jb.Classical(2, 3, 2), jb.VonKarman(3, 2, 2),
    slow(jb.papers.GreenANCF(2)), jb.papers.ChordANCF(2), jb.papers.SmallStrainANCF(2),
    jb.papers.DiscreteNC(), jb.SpatialRod(2),
]  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", VIBRATING, ids=name)
@examples(24)
@given(data=st.data())
def test_modes(model, data, watched):
    p = data.draw(spinning(model), "scene")
    with watched(p):
        check_modes(model, p)


@examples(12)
@given(data=st.data())
def test_few_modes(data, watched):
    """Of the smallest model, for the quick part."""
    model = jb.Hybrid(0, 1, 1)
    p = data.draw(spinning(model), "scene")
    with watched(p):
        check_modes(model, p)


@functools.cache
def one_and_many(model):
    def run(p):
        def found(speed):
            return jb.modes(model, build(model, p), speed, 3, throw=False)

        many = jax.vmap(found)(p["angular_speed"] + jnp.zeros(MANY))
        one = found(p["angular_speed"])
        return {
            "status": many.status[0],
            "frequency": many.frequency[0],
            "labels": jnp.stack([many.direction[0], many.number[0]]),
            "one": one.frequency,
            "one's labels": jnp.stack([one.direction, one.number]),
            "one's status": one.status,
            "steady_strain": many.steady_strain[0],
        }

    return jax.jit(run)


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [slow(jb.Hybrid(4, 8, 0)), jb.papers.GreenANCF(3)], ids=name)
@examples(24)
@given(data=st.data())
def test_many_modes(model, data, watched):
    """Those of a single case."""
    p = data.draw(spinning(model), "scene")
    with watched(p):
        found = evaluated(one_and_many(model), p)
        status = judged_at_speed(found, model, p, ["frequency"])
        assert (status == Status.OK) == np.isfinite(found["frequency"]).all()
        if status != Status.OK or found["one's status"] != Status.OK or absurd(p):
            return
        np.testing.assert_allclose(found["frequency"], found["one"], rtol=1e-8)
        np.testing.assert_array_equal(found["labels"], found["one's labels"])


@functools.cache
def stiffening(model):
    """Compiled: Southwell coefficients, and squares of frequencies at neighbouring speeds."""
    which = jb.labels(in_plane=2)

    def run(p):
        rotor, speed = build(model, p), p["angular_speed"]
        slope = jb.southwell(model, rotor, speed, which, throw=False)
        unit = rotor.beam.frequency_scale
        scale = jnp.where(speed == 0, unit, jnp.maximum(jnp.abs(speed), unit / 10))

        def square(speed):
            found = jb.modes(model, rotor, speed, which, throw=False)
            return -(found.eigenvalue**2).real

        # from rest, and to both sides of a speed
        steps = 1e-3 * np.array([1.0, 0.5, 0.25])
        outer = jax.lax.map(square, jnp.sqrt(speed**2 + scale**2 * steps))
        least = jnp.where(speed == 0, 0.0, speed**2 - scale**2 * steps)
        inner = jax.lax.map(square, jnp.sqrt(least))
        change = jnp.where(speed == 0, 1.0, 2.0) * scale**2 * steps
        return {
            "status": slope.status,
            "coefficient": slope.coefficient,
            "differences": (outer - inner) / change[:, None],
        }

    return jax.jit(run)


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [jb.Hybrid(2, 3, 0), slow(jb.papers.GreenANCF(2))], ids=name)
@examples(20)
@given(data=st.data())
def test_southwell_coefficients(model, data, watched):
    """Where ratios of differences converge, to the limit of these."""
    p = data.draw(spinning(model), "scene")
    with watched(p):
        found = evaluated(stiffening(model), p)
        status = judged_at_speed(found, model, p, ["coefficient"])
        if status != Status.OK or absurd(p):
            return
        first, second, third = found["differences"]
        off = np.abs(third - second)
        converging = (np.abs(second - first) < 0.02 * np.abs(third)) & (off < 0.01 * np.abs(third))
        event(f"{converging.sum()} of 2 converge")
        miss = np.abs(found["coefficient"] - third)
        assert (miss <= 3 * off + 1e-4 * np.abs(third))[converging].all()
