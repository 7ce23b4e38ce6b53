"""Elements with properties along the span, a body at the tip and a root that yields, against
uniform beams, Lagrange's equations and frequencies computed without the package."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._models.ancf.sections import cuts
from jaxbeam._models.ancf.theories import axial_bending
from jaxbeam._numerics.linalg import dense
from jaxbeam.blades import SpanwiseFunction
from tests.beams import short
from tests.helpers import THEORIES, finite_difference, name
from tests.models.states import lagrange, random_state
from tests.references import blade as blade_reference
from tests.tiers import exhaustive, slow

AT_NODES, BETWEEN = (0.0, 0.5, 0.5, 1.0), (0.0, 0.3, 0.3, 0.45, 1.0)
BODY, SPRING = jb.TipBody(0.9, 0.3, 0.2, 0.1), jb.RootSprings(in_plane=9.0)


def some(slow_ones):
    """All theories, some of which take long to compile."""
    return [
        pytest.param(theory, marks=pytest.mark.exhaustive if theory in slow_ones else ())
        for theory in THEORIES
    ]


def table(value, stations, *factors):
    return jb.Spanwise(stations, value * np.asarray(factors or np.ones(len(stations))))


def varying(**more):
    """A step within an element, a kink in another, a smooth function."""
    stiffness = SpanwiseFunction(jax.tree_util.Partial(lambda x: 11.0 * (1 - 0.6 * x) ** 3))
    beam = jb.Beam(
        2.0, table(1.3, BETWEEN, 1.0, 0.8, 0.6, 0.7, 0.5),
        table(4e3, (0.0, 0.8, 1.0), 1.0, 0.7, 0.8), stiffness, 7.0,
    )  # fmt: skip
    return jb.Rotor(beam, 0.4, None if "tip_body" in more else 0.9, **more)


def test_parts_of_elements_end_at_kinks():
    assert cuts((0.0, 0.25, 0.5, 1.0), 4) == ((0.0, 1.0),) * 4
    one = cuts((0.0, 1 / 3, 1.0), 2)
    np.testing.assert_allclose(one, [[0, 2 / 3, 1], [0, 0.5, 1]])


@pytest.mark.parametrize("theory", some({*THEORIES} - {jb.PlanarRod, jb.papers.ANCF}), ids=name)
def test_constant_tables_are_a_uniform_beam(theory):
    """To rounding, where stations are nodes."""
    model, stations = theory(2), AT_NODES
    properties = (1.3, 4e3, 11.0)
    tables = (table(value, stations) for value in properties)
    beams = jb.Beam(2.0, *properties, 7.0), jb.Beam(2.0, *tables, 7.0)
    hub, q, v = random_state(model, 1, True)

    @jax.jit
    def answers(rotor, q, v):
        equations = model.equations(rotor)
        moves = hub.velocity, hub.angular_velocity
        return (
            equations.force(hub, q, v, jnp.array([3.0, -2.0, 0.0])),
            [dense(a) for a in equations.tangents(hub, q, v, None)],
            dense(equations.mass), equations.strain_energy(q), equations.first_moment(q),
            equations.kinetic_energy(q, v, *moves), equations.rigid_moments, equations.energy_scale,
        )  # fmt: skip

    uniform, constant = (answers(jb.Rotor(beam, 0.4, 0.9), q, v) for beam in beams)
    for a, b in zip(jax.tree.leaves(uniform), jax.tree.leaves(constant), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-13, atol=1e-14 * np.abs(a).max())


@pytest.mark.parametrize(
    ("theory", "yields"),
    [
        slow(jb.PlanarRod, True),
        exhaustive(jb.papers.GreenANCF, False),
        *(exhaustive(theory, True) for theory in THEORIES if theory is not jb.PlanarRod),
    ],
    ids=name,
)
def test_equations_of_varying_beams_follow_from_the_energies(theory, yields):
    """Tangents, too."""
    rotor = varying(tip_body=BODY, root_springs=SPRING if yields else None)
    model = theory(2).suited(rotor)
    hub, q, v = random_state(model, 1, True)
    force = jnp.array([3.0, -2.0, 0.0])

    @jax.jit
    def all_of_them(rotor, q, v):
        equations = model.equations(rotor)
        given = jnp.linalg.solve(dense(equations.mass), equations.force(hub, q, v, force))
        exact = jax.jacfwd(equations.force, (1, 2))(hub, q, v, force)
        tangents = [-dense(a) for a in equations.tangents(hub, q, v, force)]
        return (given, *tangents), (lagrange(equations, hub, q, v, force), *exact)

    given, exact = all_of_them(rotor, q, v)
    for a, b in zip(given, exact, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-11 * np.abs(b).max())


def test_inertia_of_the_rigid_beam_with_its_body():
    rotor, model = varying(tip_body=BODY), jb.PlanarRod(2)
    edges = (0.0, 0.3, 0.45, 1.0)
    x, w = np.polynomial.legendre.leggauss(3)
    moments = np.array([0.9, 0.9 * 2.7, 0.9 * 2.7**2 + 0.2])
    for start, end, left, right in zip(
        edges, edges[1:], (1.0, 0.6, 0.7), (0.8, 0.7, 0.5), strict=False
    ):
        share = (1 + x) / 2
        at, mass = 0.4 + 2 * (start + (end - start) * share), 1.3 * (left + (right - left) * share)
        moments += (end - start) * np.array([w @ (mass * at**k) for k in range(3)])
    equations = model.equations(rotor)
    np.testing.assert_allclose(equations.rigid_moments, moments, rtol=1e-14)
    # Of a turn by a small angle, as the elements see it: they hold rigid motions.
    turn = jnp.asarray([0.0, 1.0, 2.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0])  # w = x, clamped slope aside
    rotor = varying(tip_body=BODY, root_springs=SPRING)
    equations = jb.PlanarRod(2).suited(rotor).equations(rotor)
    turn = jnp.asarray([2.0, 0.0, 1.0, 2.0, 0.0, 0.0, 2.0, 2.0, 0.0, 0.0])
    mass, first, second = moments
    about_root = second - 2 * 0.4 * first + 0.4**2 * mass
    np.testing.assert_allclose(turn @ (equations.mass @ turn), about_root, rtol=1e-13)


def test_stretch_of_small_strain_elements_bends_with_a_varying_stiffness():
    """As that of elements of the Green strain does."""
    rotor, n = varying(), 2
    beam = rotor.beam

    def along(factor):
        stiffness = SpanwiseFunction(
            jax.tree_util.Partial(lambda x: factor * 11.0 * (1 - 0.6 * x) ** 3)
        )
        whole = jb.Beam(2.0, beam.mass_per_length, beam.axial_stiffness, stiffness, 7.0)
        equations = jb.papers.GreenANCF(n).equations(jb.Rotor(whole))
        k = jax.jit(lambda e: dense(e.elastic_tangent(jnp.zeros(4 * n + 1))))(equations)
        axial = np.asarray(jb.papers.GreenANCF(n).directions) == jb.models.Direction.AXIAL
        return np.asarray(k)[np.ix_(axial, axial)]

    found = axial_bending(jb.papers.SmallStrainANCF(n), rotor)
    expected = along(2.0) - along(1.0)
    np.testing.assert_allclose(found[: 2 * n + 1, : 2 * n + 1], expected, atol=1e-9)
    assert not np.any(found[2 * n + 1 :])


STATIONS = (0.0, 0.25, 0.5, 0.75, 1.0)
BLADES = {
    "breadth": (lambda x: 1 - 0.25 * x, lambda x: 1 - 0.25 * x),
    "height": (lambda x: 1 - 0.5 * x, lambda x: (1 - 0.5 * x) ** 3),
    "table": ((STATIONS, (1.0, 0.9, 0.95, 0.5, 0.4)), (STATIONS, (2.0, 1.1, 0.9, 0.7, 0.4))),
    "step": (
        ((0.0, 0.45, 0.45, 1.0), (1.0, 1.0, 0.6, 0.6)),
        ((0.0, 0.45, 0.45, 1.0), (4.0, 4.0, 2.0, 2.0)),
    ),
}
HUB, TIP = 0.2, blade_reference.Body(0.3, 0.1, 0.02)


@functools.cache
def errors(blade, n, speed, body=False, spring=None):
    """Of the first two frequencies in the plane; strains next to nothing, as in the reference."""
    mass, stiffness = BLADES[blade]
    reference = blade_reference.Blade(
        mass, stiffness, hub=HUB, tip=TIP if body else blade_reference.Body(), lag_spring=spring
    )
    mass, stiffness = (
        SpanwiseFunction(jax.tree_util.Partial(p)) if callable(p) else jb.Spanwise(*p)
        for p in BLADES[blade]
    )
    rotor = jb.Rotor(
        jb.Beam(1.0, mass, 1e10, stiffness, 1.0), HUB,
        tip_body=jb.TipBody(TIP.mass, TIP.offset, TIP.inertia) if body else None,
        root_springs=None if spring is None else jb.RootSprings(spring),
    )  # fmt: skip
    found = jb.modes(jb.PlanarRod(n), rotor, speed, jb.labels(in_plane=2)).frequency
    return np.abs(found / np.asarray(blade_reference.in_plane(reference, speed, 2)) - 1)


@pytest.mark.slow
def test_frequencies_of_a_table_with_a_body_at_the_tip():
    assert np.all(errors("table", 8, 6.0, body=True) < [2e-5, 6e-4])


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("blade", "more"),
    [slow("breadth", {}), ("table", {"body": True}), ("height", {"spring": 0.5})],
)
def test_order_of_convergence_of_varying_blades(blade, more):
    for speed in (0.0, 6.0):
        coarse, fine = (errors(blade, n, speed, **more) for n in (8, 16))
        assert np.all(fine < 5e-5)
        # A first frequency of a yielding root is right to rounding with few elements.
        assert np.all((coarse / fine > 2**3.4) | (fine < 1e-7))


@pytest.mark.exhaustive
def test_a_step_within_an_element_costs_the_order():
    """Curvature jumps there, and cubics have none that does; put a node there."""
    coarse, fine = (errors("step", n, 0.0) for n in (4, 16))
    assert np.all(fine < 2e-3)
    assert np.all(coarse / fine > 2)
    at_nodes = errors("step", 20, 0.0)
    assert np.all(at_nodes < 4e-6)


@pytest.mark.exhaustive
def test_axial_frequencies_with_a_body_converge_by_the_first_order():
    """The end that the body holds is not strained, other than that of the rod."""
    rotor = jb.Rotor(
        jb.Beam(1.0, 1.0, 1e4, 1.0, 1.0), HUB, tip_body=jb.TipBody(0.3, TIP.offset, TIP.inertia)
    )
    blade = blade_reference.Blade(stretch=1e4, hub=HUB, tip=TIP)
    [exact] = blade_reference.frequencies(blade, 0.0, 1, "axial")
    for n in (4, 16):
        [found] = jb.modes(jb.PlanarRod(n), rotor, 0.0, jb.labels(axial=1)).frequency
        assert abs(found / exact - 1) < 0.02 / n


@pytest.mark.exhaustive
def test_a_body_without_extent_is_a_point():
    """But for the strain of the end, which the body holds: an element's length of it."""
    frequencies = [
        jb.modes(
            jb.PlanarRod(16), jb.Rotor(jb.Beam.from_slenderness(100.0), HUB, **tip),
            6.0, jb.labels(in_plane=2),
        ).frequency
        for tip in ({"tip_mass": 0.3}, {"tip_body": jb.TipBody(0.3)})
    ]  # fmt: skip
    at_tip = 0.3 * 6.0**2 * 1.2 / 1e4
    np.testing.assert_allclose(*frequencies, rtol=at_tip / 16)


@pytest.mark.slow
def test_spin_up_of_a_varying_beam_keeps_its_energy():
    """The run says so itself."""
    times = jnp.linspace(0.0, 1.5, 7)
    run = jb.simulate(jb.PlanarRod(2), varying(tip_body=BODY), jb.SmoothSpinUp(2.0, 1.0), times)
    assert jb.Status(int(run.status)) is jb.Status.OK
    assert np.abs(run.tip[:, 1]).max() > 1e-2


@pytest.mark.exhaustive
def test_spin_up_with_a_root_that_yields():
    """Softly: the tip goes further than that of a clamped beam."""
    times, farthest = jnp.linspace(0.0, 1.5, 7), []
    for spring in (None, jb.RootSprings(9.0), jb.RootSprings(1e7)):
        run = jb.simulate(
            jb.PlanarRod(2),
            varying(tip_body=BODY, root_springs=spring),
            jb.SmoothSpinUp(2.0, 1.0),
            times,
        )
        assert jb.Status(int(run.status)) is jb.Status.OK
        farthest.append(float(np.abs(run.tip[:, 1]).max()))
    clamped, soft, hard = farthest
    assert soft > 1.2 * clamped
    np.testing.assert_allclose(hard, clamped, rtol=1e-4)


VALUES = jnp.array([1.0, 0.9, 0.85, 0.7, 0.6])


def of_stations(values):
    """All of a beam depends on these."""
    beam = jb.Beam(
        2.0, jb.Spanwise(STATIONS, values), jb.Spanwise(STATIONS, 4e3 * values),
        jb.Spanwise(STATIONS, 11 * values**2), 7.0,
    )  # fmt: skip
    return jb.Rotor(beam, 0.4, tip_body=BODY)


def lowest(values):
    model, which = jb.PlanarRod(3), jb.labels(in_plane=2)
    return jb.modes(model, of_stations(values), 3.0, which).frequency


@pytest.mark.exhaustive
def test_gradients_by_the_values_at_stations():
    exact = jax.jit(jax.jacfwd(lowest))(VALUES)
    np.testing.assert_allclose(exact, finite_difference(jax.jit(lowest), VALUES), rtol=1e-7)


@pytest.mark.exhaustive
def test_batches_over_the_values_at_stations_are_single_runs():
    """Of frequencies, and of runs, whose steps take lanes."""
    many = jnp.stack([VALUES, 1.1 * VALUES, VALUES**2])

    def run(values):
        model, motion = jb.PlanarRod(3), jb.SmoothSpinUp(2.0, 1.0)
        times = jnp.linspace(0.0, 1.5, 7)
        return jb.simulate(model, of_stations(values), motion, times, throw=False).tip

    for answer in (lowest, run):
        each = np.stack([answer(values) for values in many])
        np.testing.assert_allclose(jax.vmap(answer)(many), each, rtol=1e-9, atol=1e-11)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "tip", [{"tip_mass": 0.2}, {"tip_body": jb.TipBody(0.2)}], ids=["table", "table and body"]
)
def test_a_varying_rod_tears_where_its_axial_stiffness_is_lost(tip):
    """A constant table does so where a uniform rod does; a point that is called a body, too."""
    constant = [table(value, STATIONS) for value in (1.0, 400.0, 1.0)]
    rotor = jb.Rotor(jb.Beam(1.0, *constant, 1.0), 0.3, **tip)
    plain = jb.Rotor(jb.Beam(1.0, 1.0, 400.0, 1.0, 1.0), 0.3, 0.2)
    speeds = jnp.linspace(0.9, 1.1, 21) * 26.0
    torn = np.asarray([bool(plain.tears(speed)) for speed in speeds])
    assert 0 < torn.sum() < 21
    status = [
        jb.Status(int(jb.PlanarRod(8).linearise(rotor, speed, throw=False).status))
        for speed in speeds
    ]
    assert [one is jb.Status.NO_EQUILIBRIUM for one in status] == torn.tolist()
    assert all(one in (jb.Status.OK, jb.Status.NO_EQUILIBRIUM) for one in status)


@pytest.mark.parametrize(
    ("more", "model", "message"),
    [
        (
            {"pitch": 0.1},
            jb.papers.ANCF(2),
            "pitch: ANCF has no turned sections: take Hybrid or SpatialRod",
        ),
        (
            {"root_springs": jb.RootSprings(flap=3.0)},
            jb.papers.GreenANCF(2),
            "root_springs.flap: GreenANCF has no root that yields in flap: take",
        ),
    ],
)
def test_what_planar_elements_do_not_take_is_refused(more, model, message):
    with pytest.raises(ValueError, match=message):
        jb.modes(model, varying(**more), 1.0, 1)


def test_twist_is_refused():
    rotor = jb.Rotor(short(4e3, twist=0.2))
    with pytest.raises(ValueError, match=r"beam\.twist: PlanarRod has no turned sections"):
        jb.PlanarRod(2).linearise(rotor, 1.0)
