"""Southwell coefficients, Campbell diagrams, crossings."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.beams import SOFT_SPRINGS
from tests.helpers import DISCRETE, finite_difference, name, slender
from tests.references import power_series
from tests.tiers import exhaustive, slow

IN_PLANE, FLAP, AXIAL = (
    jb.models.Direction.IN_PLANE,
    jb.models.Direction.FLAP,
    jb.models.Direction.AXIAL,
)
PLANAR = jb.labels(in_plane=3)


def phi_of(*args, **kwargs):
    return jb.southwell(*args, **kwargs).coefficient


def crossing_at(*args, **kwargs):
    return jb.crossing(*args, **kwargs).angular_speed


MODELS = [
    (jb.Hybrid(0, 14, 0), None),
    exhaustive(jb.Hybrid(12, 14, 0), 150.0),
]


@pytest.mark.parametrize(("model", "slenderness"), MODELS)
@pytest.mark.parametrize(
    ("hub", "tip", "speed"),
    [
        (0.0, 0.0, 0.0),
        exhaustive(0.5, 0.8, 2.0),
        exhaustive(0.5, 0.8, 0.0),
        exhaustive(1.5, 0.0, 6.0),
    ],
)
def test_against_differences_of_converged_frequencies(model, slenderness, hub, tip, speed):
    """d(omega^2) / d(Omega^2) of the power-series reference, to 1e-6."""
    found = phi_of(model, slender(slenderness or 70.0, hub, tip), speed, PLANAR)

    def square(s2):
        return np.array(power_series.frequencies(float(np.sqrt(s2)), hub, tip, slenderness)) ** 2

    h = 1e-2  # omega^2 is analytic in Omega^2 and bends on the scale of 10; six points, h^6
    if speed:
        weights = dict(zip((-3, -2, -1, 1, 2, 3), (-1, 9, -45, 45, -9, 1), strict=True))
    else:  # one-sided of order 6: no speed has a negative square
        weights = dict(enumerate((-147, 360, -450, 400, -225, 72, -10)))
    fd = sum(w * square(speed**2 + k * h) for k, w in weights.items()) / (60 * h)
    np.testing.assert_allclose(found, fd, rtol=1e-6)


@pytest.mark.parametrize("label", [jb.models.Label(IN_PLANE, 1), jb.models.Label(IN_PLANE, 2)])
@pytest.mark.parametrize("tip", [0.0, 0.6])
def test_rayleigh_quotient_and_linearity_in_hub_radius(label, tip):
    """Inextensible, at rest: phi = int p W'^2 dx / int W^2 dm - 1, linear in R / L.

    W from the clamped-free frequency of the reference, integrated as an initial-value problem.
    """
    model = jb.Hybrid(0, 16, 0)
    omega = power_series.frequencies(0.0, 0.0, tip)[label.number - 1]
    b = np.sqrt(omega)
    x, w = np.polynomial.legendre.leggauss(60)
    x, w = (x + 1) / 2, w / 2

    def shape(x):  # clamped at 0, W''(1) = 0
        c = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
        value = np.cosh(b * x) - np.cos(b * x) - c * (np.sinh(b * x) - np.sin(b * x))
        slope = b * (np.sinh(b * x) + np.sin(b * x) - c * (np.cosh(b * x) - np.cos(b * x)))
        return value, slope

    value, slope = shape(x)
    mass = np.sum(w * value**2) + tip * shape(1.0)[0] ** 2

    def closed(hub):
        p = hub * (1 - x) + (1 - x**2) / 2 + tip * (1 + hub)
        return np.sum(w * p * slope**2) / mass - 1

    hubs = np.array([0.0, 0.3, 1.0, 4.0])
    found = [float(phi_of(model, slender(70.0, r, tip), 0.0, [label])[0]) for r in hubs]
    np.testing.assert_allclose(found, [closed(r) for r in hubs], rtol=1e-9)
    line = found[0] + (found[2] - found[0]) * hubs
    np.testing.assert_allclose(found, line, rtol=1e-11)


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", [slow(DISCRETE[0]), *DISCRETE[1:]], ids=name)
def test_discrete_analogue(model):
    """Against differences of squared frequencies: the error is of order speed squared."""
    springs, which = SOFT_SPRINGS, jb.labels(in_plane=1)

    def square(speed):
        return jb.modes(model, springs, speed, which).frequency[0] ** 2

    coarse, fine = ((square(h) - square(0.0)) / h**2 for h in (0.4, 0.2))
    found = phi_of(model, springs, 0.0, which)[0]
    np.testing.assert_allclose(found, (4 * fine - coarse) / 3, rtol=1e-4)
    at_speed = phi_of(model, springs, 2.0, which)[0]
    slope = (square(2.001) - square(1.999)) / (2 * 2.0 * 0.002)
    np.testing.assert_allclose(at_speed, slope, rtol=1e-5)


def test_known_values():
    """0.1933 for R = N = 0 (Schilhansl's 0.173, B eq. 68, is an approximation)."""
    found = phi_of(jb.Hybrid(0, 16, 0), slender(), 0.0, jb.labels(in_plane=1))
    assert float(found[0]) == pytest.approx(0.1933, abs=5e-5)


@pytest.mark.parametrize("hub", [0.0, 2.0])
@pytest.mark.parametrize("tip", [0.0, 1.0])
@pytest.mark.parametrize("speed", [0.0, 3.0])
def test_flap_exceeds_in_plane_by_one(hub, tip, speed):
    which = jb.labels(in_plane=3, flap=3)
    phi = phi_of(jb.Hybrid(0, 16, 16), slender(70.0, hub, tip), speed, which)
    np.testing.assert_allclose(phi[3:] - phi[:3], 1.0, rtol=1e-9)


@pytest.mark.parametrize(
    "model",
    [
        jb.Hybrid(8, 12, 12),
        exhaustive(jb.papers.ANCF(5)),
        exhaustive(jb.papers.SmallStrainANCF(5)),
    ],
)
def test_continuous_at_rest(model):
    which = jb.labels(in_plane=2, axial=1)
    at_rest = phi_of(model, slender(40.0, 0.3, 0.2), 0.0, which)
    nearly = phi_of(model, slender(40.0, 0.3, 0.2), 1e-3, which)
    np.testing.assert_allclose(at_rest, nearly, rtol=1e-4)


@pytest.mark.slow
def test_classical_never_stiffens():
    phi = phi_of(jb.Classical(0, 12, 12), slender(), 0.0, jb.labels(in_plane=2, flap=2))
    np.testing.assert_allclose(phi, [-1, -1, 0, 0], atol=1e-9)
    beyond = phi_of(jb.Classical(0, 12, 0), slender(), 5.0, jb.labels(in_plane=1))
    assert float(beyond[0]) == pytest.approx(-1)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("speed", "jacobian"),
    [(0.0, jax.jacrev), (4.0, jax.jacfwd)],
)
def test_derivatives_of_coefficients(speed, jacobian):
    model, which = jb.Hybrid(8, 12, 12), jb.labels(in_plane=2, flap=1)

    @jax.jit
    def phi(p):
        rotor = jb.Rotor(jb.Beam.from_slenderness(p[0]), p[1], p[2])
        return phi_of(model, rotor, speed, which)

    at = jnp.array([40.0, 0.4, 0.3])
    exact = jax.jit(jacobian(phi))(at)
    np.testing.assert_allclose(exact, finite_difference(phi, at), rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_rest_and_speed_in_one_batch():
    model, which = jb.Hybrid(6, 10, 0), jb.labels(in_plane=2)
    speeds = jnp.array([0.0, 1.0, 0.0, 3.0])

    def phi(s):
        return phi_of(model, slender(50.0), s, which)

    batch = jax.jit(jax.vmap(phi))(speeds)
    np.testing.assert_allclose(batch, np.stack([phi(s) for s in speeds]), rtol=1e-12)


# Length, mass per length, bending stiffness, speed; then hub radius, tip mass and all else are one.
OVERFLOWING = [
    (1.0, 1.0, 1.0, 1e300), (1.0, 1.0, 1.0, 1e160), (1e-300, 1.0, 1.0, 1.0),
    (1e-300, 1.0, 1.0, 0.0), (1e-81, 1.0, 1.0, 0.0), (1e80, 1.0, 1.0, 0.0),
    (1.0, 1e300, 1.0, 0.0), (1.0, 1.0, 1e-300, 0.0), (1e300, 1e-300, 1.0, 0.0),
]  # fmt: skip


@pytest.mark.parametrize(
    "model",
    [jb.Hybrid(0, 1, 0), pytest.param(jb.papers.GreenANCF(1), marks=pytest.mark.slow)],
    ids=name,
)
def test_what_overflows_is_not_blamed_on_the_speed(model):
    """Nor is a coefficient that is not a number called ok; in a batch others are as they were."""

    def found(case):
        length, mass, bending, speed = case
        rotor = jb.Rotor(jb.Beam(length, mass, 100.0, bending, 1.0), 1.0, 1.0)
        return jb.southwell(model, rotor, speed, 1, throw=False)

    fine = (1.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, -0.5), (1.0, 1.0, 1.0, np.nan)
    many = jax.jit(jax.vmap(found))(np.array([*OVERFLOWING, *fine]))
    codes = [jb.Status(int(code)) for code in many.status]
    assert not any(code.blames_input for code in codes[:-1])
    assert codes[-3:] == [jb.Status.OK, jb.Status.OK, jb.Status.INVALID_ANGULAR_SPEED]
    known = np.isfinite(many.coefficient).all(1)
    np.testing.assert_array_equal(known, many.status == jb.Status.OK)


# --- crossings -----------------------------------------------------------------------------------


@pytest.mark.exhaustive
def test_first_resonance():
    """First in-plane mode meets the speed at gamma = 3.88 (B, section 7), to 1e-10 by solver.

    Checked by the reference: at that speed its own first frequency is the speed.
    """
    model, label = jb.Hybrid(0, 16, 0), jb.models.Label(IN_PLANE, 1)
    at = crossing_at(model, slender(), (2.0, 6.0), label, 1.0)
    assert float(at) == pytest.approx(3.88, abs=5e-3)
    assert power_series.frequencies(float(at))[0] == pytest.approx(float(at), rel=1e-10)
    extensible = crossing_at(jb.Hybrid(12, 16, 0), slender(70.0), (2.0, 6.0), label, 1.0)
    assert power_series.frequencies(float(extensible), 0.0, 0.0, 70.0)[0] == pytest.approx(
        float(extensible), rel=1e-10
    )


@pytest.mark.exhaustive
def test_derivatives_of_the_resonance():
    model, label = jb.Hybrid(8, 12, 0), jb.models.Label(IN_PLANE, 1)

    def at(p):
        rotor = jb.Rotor(jb.Beam.from_slenderness(p[0]), p[1], p[2])
        return crossing_at(model, rotor, (0.5, 9.0), label, p[3])

    p = jnp.array([60.0, 0.05, 0.1, 1.0])
    exact = jax.jit(jax.jacrev(at))(p)
    np.testing.assert_allclose(exact, finite_difference(at, p), rtol=1e-7)
    np.testing.assert_allclose(exact, jax.jit(jax.jacfwd(at))(p), rtol=1e-10)


@pytest.mark.slow
def test_crossings_under_vmap():
    model, label = jb.Hybrid(6, 10, 0), jb.models.Label(IN_PLANE, 1)
    hubs = jnp.array([0.0, 0.05, 0.1, 3.0])

    def at(hub):
        return crossing_at(model, slender(60.0, hub), (0.5, 9.0), label, 1.0, throw=False)

    batch = np.asarray(jax.jit(jax.vmap(at))(hubs))
    single = np.stack([at(h) for h in hubs])
    np.testing.assert_allclose(batch, single, rtol=1e-12)
    assert np.isnan(batch[3])  # with that hub the first mode stays above the speed
    assert np.isfinite(batch[:3]).all()
    with pytest.raises(RuntimeError, match="no crossing in bracket"):
        crossing_at(model, slender(60.0, 3.0), (0.5, 9.0), label, 1.0)


@pytest.mark.slow
def test_crossing_of_the_classical_beam():
    """omega^2 = omega_0^2 - Omega^2 meets Omega at omega_0 / sqrt(2)."""
    at = crossing_at(
        jb.Classical(0, 12, 0), slender(), (1.0, 3.4), jb.models.Label(IN_PLANE, 1), 1.0
    )
    assert float(at) == pytest.approx(power_series.frequencies(0.0)[0] / np.sqrt(2), rel=1e-10)


@pytest.mark.exhaustive
def test_campbell_diagram():
    model, rotor = jb.Hybrid(8, 12, 12), slender(60.0)
    which = jb.labels(in_plane=2, flap=2)
    speeds = np.linspace(0.0, 12.0, 25)
    diagram = jb.campbell(model, rotor, speeds, which)
    column = diagram.table.sel(mode="flap bending 2")["frequency"]
    single = [jb.modes(model, rotor, s, [jb.models.Label(FLAP, 2)]).frequency[0] for s in speeds]
    np.testing.assert_allclose(column, single, rtol=1e-12)
    found = diagram.crossings((1, 2, 3))
    assert found
    assert [c.angular_speed for c in found] == sorted(c.angular_speed for c in found)
    for c in found:
        f = jb.modes(model, rotor, c.angular_speed, [c.label]).frequency[0]
        assert float(f) == pytest.approx(c.harmonic * c.angular_speed, rel=1e-12)
    # every sign change of the finely sampled curves is there
    fine = jb.campbell(model, rotor, np.linspace(0.0, 12.0, 200), which)
    for i, label in enumerate(which):
        for harmonic in (1, 2, 3):
            gap = fine.table["frequency"][:, i] - harmonic * fine.table.coords["angular_speed"]
            changes = int((gap[:-1] * gap[1:] < 0).sum())
            assert changes == sum(c.label == label and c.harmonic == harmonic for c in found)


@pytest.mark.slow
def test_divergence_is_no_resonance():
    diagram = jb.campbell(
        jb.Classical(0, 8, 0), slender(), np.linspace(0.5, 10, 20), jb.labels(in_plane=1)
    )
    assert [c.harmonic for c in diagram.crossings((1,))] == [1]
    growing = diagram.table["growth_rate"][:, 0] > 0
    assert growing.any()
    assert (diagram.table["frequency"][growing, 0] == 0).all()


def test_neither_order_nor_failed_cases_hide_or_double_a_crossing(monkeypatch):
    """Of the frequency 6 + speed, which is twice the speed between 4 and 7."""

    def middle(_, __, bracket, label, harmonic, **_options):
        at = (jnp.asarray(number) for number in (harmonic, sum(bracket) / 2))
        return jb.results.Crossing(label, *at, jnp.asarray(int(jb.Status.OK)))

    monkeypatch.setattr("jaxbeam._vibration.campbell.crossing", middle)
    dims = ("angular_speed", "mode")
    for speeds in ([0.0, 1.0, 4.0, 7.0], [7.0, 0.0, 4.0], [0.0, 1.0, np.nan, 4.0, np.nan, 7.0]):
        at = np.array(speeds)
        values = {"frequency": (6 + at)[:, None], "growth_rate": 0 * at[:, None]}
        table = jb.Table(values, dict.fromkeys(values, dims), {"angular_speed": at})
        diagram = jb.results.Campbell(jb.Hybrid(0, 1, 1), slender(), jb.labels(flap=1), table)
        found = diagram.crossings(np.array([2]))
        assert [(c.harmonic, c.angular_speed) for c in found] == [(2, 5.5)]


@pytest.mark.exhaustive
def test_no_resonance_where_a_label_changes_branch():
    """The line passes through the gap of the veering of in-plane 3 with stretch 1 at 25.53."""
    model, rotor, harmonic = jb.Hybrid(8, 14, 0), slender(70.0), 4.6487
    for label, bracket in (
        (jb.models.Label(AXIAL, 1), (25.4, 25.6)),
        (jb.models.Label(IN_PLANE, 3), (25.45, 25.6)),
    ):
        with pytest.raises(RuntimeError, match="not by a jump where the label changes branch"):
            jb.crossing(model, rotor, bracket, label, harmonic)
    diagram = jb.campbell(model, rotor, np.linspace(20, 30, 41), jb.labels(in_plane=3, axial=1))
    for c in diagram.crossings((harmonic,)):
        frequency = jb.modes(model, rotor, c.angular_speed, [c.label]).frequency[0]
        assert float(frequency) == pytest.approx(harmonic * c.angular_speed, rel=1e-9)
        assert abs(c.angular_speed - 25.5325) > 1e-3


@pytest.mark.exhaustive
def test_a_line_that_passes_through_a_gap_meets_the_branches_beside_it():
    """Between 3 and 4 rad/s both labels change branch, and what is then the upper one is met by the
    line twice the speed: frequencies in order, which are smooth, tell where."""
    at = [0.0, 0.5, 1.0]
    beam = jb.Beam(
        5.0, jb.Spanwise(at, [0.3, 0.2, 0.1]), 4e6, jb.Spanwise(at, [500.0, 400.0, 200.0]),
        jb.Spanwise(at, [300.0, 250.0, 100.0]), twist=jb.Spanwise([0, 1], [0.3, 0.0]),
    )  # fmt: skip
    rotor, model = jb.Rotor(beam, 0.5, 0.1, pitch=0.2), jb.Hybrid(0, 8, 8)
    speeds = np.linspace(0.0, 10.0, 801)
    both = jax.jit(jax.vmap(lambda s: jb.modes(model, rotor, s, 2, throw=False).frequency))(speeds)
    gap = np.asarray(both) - 2 * speeds[:, None]
    i, column = np.nonzero(gap[:-1] * gap[1:] < 0)
    before, after = gap[i, column], gap[i + 1, column]
    exact = np.sort(speeds[i] - (speeds[1] - speeds[0]) * before / (after - before))
    diagram = jb.campbell(model, rotor, np.linspace(0, 10, 11), jb.labels(in_plane=1, flap=1))
    found = [c.angular_speed for c in diagram.crossings([2])]
    np.testing.assert_allclose(found, exact, atol=1e-4)


@pytest.mark.exhaustive
def test_status_in_sweeps():
    model, label = jb.Hybrid(4, 8, 0), jb.models.Label(IN_PLANE, 1)

    def coefficient(hub_radius):
        return jb.southwell(model, slender(60.0, hub_radius), 0.0, (label,), throw=False)

    def resonance(hub_radius):
        return jb.crossing(model, slender(60.0, hub_radius), (0.5, 9.0), label, 1.0, throw=False)

    cases, status = jb.grid(hub_radius=[0.0, np.nan, 3.0]), jb.Status
    table = jb.sweep(coefficient, cases)
    assert table["status"].tolist() == [status.OK, status.INVALID_HUB_RADIUS, status.OK]
    table = jb.sweep(resonance, cases)
    assert table["status"].tolist() == [status.OK, status.INVALID_HUB_RADIUS, status.NO_CROSSING]


def test_bad_arguments_of_crossing():
    good = (jb.Hybrid(0, 4, 0), slender(), (1.0, 5.0), jb.models.Label(IN_PLANE, 1))
    for harmonic in (0.0, -1.0, float("nan")):
        with pytest.raises(ValueError, match="harmonic must be finite and > 0"):
            jb.crossing(*good, harmonic)
    for bracket in (1.0, (1.0,), (1.0, 2.0, 3.0)):
        with pytest.raises(ValueError, match="bracket must be two speeds"):
            jb.crossing(*good[:2], bracket, good[3], 1.0)
    with pytest.raises(ValueError, match="bracket must be finite"):
        jb.crossing(*good[:2], (1.0, float("nan")), good[3], 1.0)
    with pytest.raises(TypeError, match="label must be a Label"):
        jb.crossing(*good[:3], "flap 1", 1.0)
