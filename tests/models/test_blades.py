"""Beams as built in the modal models, against references that are computed without them."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import chebyshev

import jaxbeam as jb
from jaxbeam._numerics.linalg import dense
from jaxbeam._rotor.motion import skew
from jaxbeam.blades import SpanwiseFunction
from jaxbeam.models import Polynomials
from tests.beams import short
from tests.helpers import name
from tests.models.states import assert_alike_to_second_order, random_state
from tests.references import blade as reference
from tests.tiers import exhaustive, slow

STIFF = 1e9  # axial stiffness of what the reference has as inextensible: no model here uses it
QUARTERS, TABLE = (0, 0.2, 0.45, 0.7, 1), ((2, 1.2, 1, 0.8, 0.3), (3, 1.5, 1, 0.5, 0.1))
EIGHTH = np.pi / 4
CANTILEVER = np.array([1.8751040687119611, 4.694091132974174]) ** 2


def _power(factor, base, exponent, x):
    return factor * (1 - base * x) ** exponent


def power(base, exponent, factor=1.0):
    """Its numbers are leaves, so that all tapers share a program."""
    return SpanwiseFunction(jax.tree_util.Partial(_power, factor, base, exponent))


def lowest(model, rotor, speed, count=6):
    return np.sort(np.asarray(jb.modes(model, rotor, speed, count).frequency))


def tapered(taper, mass, stiffness, **more):
    """A blade of ours and of the reference with m ~ (1 - c x)^mass, EI ~ (1 - c x)^stiffness."""
    lag, flap = power(taper, stiffness, 16.0), power(taper, stiffness)
    ours = jb.Beam(1.0, power(taper, mass), STIFF, lag, flap)
    theirs = reference.Blade(
        mass=lambda x: (1 - taper * x) ** mass, flap=lambda x: (1 - taper * x) ** stiffness,
        lag=lambda x: 16 * (1 - taper * x) ** stiffness, **more,
    )  # fmt: skip
    return ours, theirs


@pytest.mark.parametrize("speed", [1.0, exhaustive(0.0), exhaustive(12.0)])
@pytest.mark.parametrize(
    ("taper", "functions"),
    [
        (0.5, 16),
        *(exhaustive(c, n) for c, n in ((0.25, 16), (0.9, 28))),
    ],
)
@pytest.mark.parametrize(
    ("mass", "stiffness"),
    [(1, 3), *(exhaustive(*powers) for powers in ((1, 1), (2, 4)))],
)
def test_tapered_beams(mass, stiffness, taper, functions, speed):
    """Breadth, height and both: three modes of each direction by 16 polynomials, 28 for a tip a
    tenth as broad as the root."""
    hub, tip = (0.0, 0.0) if speed < 1 else (1.0, 0.1)
    ours, theirs = tapered(taper, mass, stiffness, hub=hub, tip=reference.Body(tip))
    model = jb.Hybrid(0, functions, functions)
    found = jb.modes(model, jb.Rotor(ours, hub, tip), speed, jb.labels(in_plane=3, flap=3))
    wanted = [*reference.in_plane(theirs, speed), *reference.flap(theirs, speed)]
    np.testing.assert_allclose(found.frequency, wanted, rtol=1e-8)


@pytest.mark.slow
def test_printed_frequencies_of_tapered_beams():
    """Hodges and Rutkowski (1981): height taper 1/2; Kirchhoff's wedge and cone, whose tips are
    sharp: 5.315 and 8.719 of the thick end (Bessel functions)."""
    frequency = lowest(jb.Hybrid(0, 0, 16), jb.Rotor(tapered(0.5, 1, 3)[0]), 0.0, 3)
    np.testing.assert_allclose(frequency, [3.8238, 18.3173, 47.2648], atol=6e-5)
    for powers, printed in (((1, 3), 5.315), ((2, 4), 8.719)):
        sharp = jb.Rotor(tapered(1 - 1e-6, *powers)[0])
        np.testing.assert_allclose(lowest(jb.Hybrid(0, 0, 40), sharp, 0.0, 1), printed, atol=6e-4)


def stepped(flap=True):
    halves = (0, 0.5, 0.5, 1)
    lag, mass = jb.Spanwise(halves, [4, 4, 2, 2]), jb.Spanwise(halves, [1, 1, 0.6, 0.6])
    ours = jb.Beam(1.0, mass, STIFF, lag, jb.Spanwise(halves, [1, 1, 0.3, 0.3]))
    theirs = reference.Blade(
        mass=(halves, (1, 1, 0.6, 0.6)), lag=(halves, (4, 4, 2, 2)), flap=(halves, (1, 1, 0.3, 0.3))
    )
    return ours, theirs


def in_table(twist=None):
    mass, stiffness = TABLE
    lag = tuple(4 * np.array(stiffness))
    turn = None if twist is None else jb.Spanwise(QUARTERS, twist)
    ours = jb.Beam(
        1.0, jb.Spanwise(QUARTERS, mass), STIFF, jb.Spanwise(QUARTERS, lag),
        jb.Spanwise(QUARTERS, stiffness), turn,
    )  # fmt: skip
    theirs = reference.Blade(
        mass=(QUARTERS, mass), lag=(QUARTERS, lag), flap=(QUARTERS, stiffness),
        twist=0.0 if twist is None else (QUARTERS, twist), hub=0.5,
    )  # fmt: skip
    return ours, theirs


@pytest.mark.parametrize("speed", [0.0, exhaustive(6.0)])
@pytest.mark.parametrize(
    ("build", "close"), [slow(stepped, 1e-6), (in_table, 2e-7)], ids=["step", "table"]
)
def test_steps_and_tables(build, close, speed):
    """Functions follow both by themselves."""
    ours, theirs = build()
    wanted = reference.frequencies(theirs, speed, 6)
    found = lowest(jb.Hybrid(0, 16, 16), jb.Rotor(ours, theirs.hub), speed)
    np.testing.assert_allclose(found, wanted, rtol=close)


@pytest.mark.parametrize("speed", [1.0, exhaustive(12.0)])
@pytest.mark.parametrize("ratio", [64.0, exhaustive(16.0)])
@pytest.mark.parametrize("pitch", [0.3, exhaustive(0.0)])
def test_twist_and_pitch(ratio, pitch, speed):
    """Twist to 45 degrees; labels go to those modes which have most of them."""
    ours = jb.Beam(1.0, 1.0, STIFF, ratio, 1.0, twist=jb.Spanwise([0, 1], [0, EIGHTH]))
    theirs = reference.Blade(lag=ratio, twist=((0, 1), (0, EIGHTH)), pitch=pitch, hub=0.5)
    rotor = jb.Rotor(ours, 0.5, pitch=pitch)
    found = jb.modes(jb.Hybrid(0, 16, 16), rotor, speed, 6)
    wanted = reference.frequencies(theirs, speed, 6)
    np.testing.assert_allclose(np.sort(found.frequency), wanted, rtol=3e-8)
    np.testing.assert_allclose(found.energy_share.sum(1), 1.0)
    assert 0.01 < np.min(np.max(found.energy_share, 1)) < 0.99  # mixed
    labels = {(int(f), int(k)) for f, k in zip(found.direction, found.number, strict=True)}
    assert len(labels) == 6


@pytest.mark.slow
def test_labels_of_turned_sections():
    """A quarter turn exchanges the names of the directions, no turn leaves them; what is between
    goes from one to the other."""
    ours = jb.Beam(1.0, 1.0, STIFF, 16.0, 1.0)
    model, wanted = jb.Hybrid(0, 8, 8), jb.labels(in_plane=2, flap=2)

    def at(pitch):
        return jb.modes(model, jb.Rotor(ours, pitch=pitch), 0.0, wanted).frequency

    np.testing.assert_allclose(at(0.0), jb.modes(model, jb.Rotor(ours), 0.0, wanted).frequency)
    np.testing.assert_allclose(at(np.pi / 2), np.roll(np.asarray(at(0.0)), 2), rtol=1e-9)
    np.testing.assert_allclose(at(0.1), at(-0.1), rtol=1e-12)


@pytest.mark.parametrize("spring", [1.0, *(exhaustive(k) for k in (0.01, 100.0, 1e6))])
@pytest.mark.parametrize("speed", [0.0, exhaustive(4.0)])
def test_root_springs(spring, speed):
    ours = jb.Beam(1.0, 1.0, STIFF, 16.0, 1.0)
    theirs = reference.Blade(lag=16.0, lag_spring=2 * spring, flap_spring=spring, hub=0.2)
    rotor = jb.Rotor(ours, 0.2, root_springs=jb.RootSprings(2 * spring, spring))
    model = jb.Hybrid(0, 14, 14)
    wanted = reference.frequencies(theirs, speed, 6)
    np.testing.assert_allclose(lowest(model, rotor, speed), wanted, rtol=1e-9)


def test_root_that_yields_one_way():
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, STIFF, 16.0, 1.0), root_springs=jb.RootSprings(flap=0.5))
    model = jb.Hybrid(0, 14, 14)
    found = jb.modes(model, rotor, 0.0, jb.labels(in_plane=1, flap=3)).frequency
    clamped = 4 * 1.8751040687119611**2  # the first root of cos(b) cosh(b) = -1
    printed = [1.158197107, 15.86088999, 50.44763967]
    np.testing.assert_allclose(found, [clamped, *printed], rtol=1e-9)
    clamped = jb.papers.SmallStrainANCF(2)
    with pytest.raises(ValueError, match="root_springs: SmallStrainANCF has no root that yields"):
        jb.modes(clamped, jb.Rotor(rotor.beam, root_springs=jb.RootSprings(in_plane=0.5)), 0.0)


@pytest.mark.parametrize(
    ("speed", "stretch"),
    [slow(4.0, 0), *(exhaustive(w, 6) for w in (0.0, 4.0))],
)
def test_tip_bodies(speed, stretch):
    body = jb.TipBody(0.5, 0.1, 0.03, 0.01)
    ours = jb.Beam(1.0, 1.0, 400.0, 16.0, 1.0)
    theirs = reference.Blade(
        lag=16.0, hub=0.3, tip=reference.Body(0.5, 0.1, 0.03, 0.03 - 0.01),
        stretch=400.0 if stretch else None,
    )  # fmt: skip
    model = jb.Hybrid(stretch, 14, 14)
    found = lowest(model, jb.Rotor(ours, 0.3, tip_body=body), speed)
    np.testing.assert_allclose(found, reference.frequencies(theirs, speed, 6), rtol=1e-9)
    point = jb.Rotor(ours, 0.3, 0.5)
    none = jb.Rotor(ours, 0.3, tip_body=jb.TipBody(0.5))
    np.testing.assert_allclose(lowest(model, none, speed), lowest(model, point, speed), rtol=1e-12)


@pytest.mark.exhaustive
def test_tip_bodies_of_two_inertias():
    """In flap the body turns against its own inertia there; the centrifugal moment is that of what
    is along the beam less that above and below: J - J_x."""
    ours, model = jb.Beam(1.0, 1.0, 400.0, 16.0, 1.0), jb.Hybrid(0, 14, 14)
    labels = jb.labels(in_plane=2, flap=2)
    body = reference.Body(0.5, 0.1, 0.05, 0.03 - 0.01)
    theirs = reference.Blade(lag=1e6, hub=0.3, tip=body)
    even, uneven = (
        jb.modes(model, jb.Rotor(ours, 0.3, tip_body=tip), 4.0, labels).frequency
        for tip in (jb.TipBody(0.5, 0.1, 0.03, 0.01), jb.TipBody(0.5, 0.1, 0.03, 0.01, 0.05))
    )
    np.testing.assert_allclose(uneven[:2], even[:2], rtol=1e-12)
    np.testing.assert_allclose(uneven[2:], reference.frequencies(theirs, 4.0, 2), rtol=1e-9)


@pytest.mark.parametrize("pitch", [0.6, exhaustive(None)])
def test_a_body_at_the_tip_moves_as_one(pitch):
    """Six particles, two on each axis of the last section of a beam that does not twist: their
    kinetic energy to second order, in any motion of the hub, against the exact one."""
    twist = None if pitch is None else jb.Spanwise([0, 1], [0.3, -0.2])
    beam = jb.Beam(2.0, 1e-9, 4e3, 11.0, 7.0, twist)
    arms, mass, offset = np.array([0.5, 0.4, 0.9]), 0.9, 0.3
    along, across, up = mass * arms**2 / 3  # second moments
    body = jb.TipBody(mass, offset, along + across, across + up, along + up)
    rotor, model = jb.Rotor(beam, 0.4, pitch=pitch, tip_body=body), jb.Hybrid(2, 3, 3)
    equations = eqx.filter_jit(model.equations)(rotor)
    hub, q, v = random_state(model, 3, False)
    end = model.displacement(np.ones(1), rotor)[:, 0]
    # Slopes of what is smooth, along the beam.
    points = np.linspace(0.0, 1.0, 401)
    knots = np.cos(np.pi * (np.arange(10) + 0.5) / 10)
    values = np.moveaxis(np.asarray(model.displacement((1 + knots) / 2, rotor)), 1, 0).reshape(
        10, -1
    )
    slopes = chebyshev.chebder(chebyshev.chebfit(knots, values, 9)) * 2
    slopes = chebyshev.chebval(2 * points - 1, slopes).reshape(3, -1, points.size)
    angle = 0.0 if pitch is None else pitch - 0.2
    turned = np.array([[0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]])
    section = np.concatenate([np.eye(3)[:1], turned])

    def carried(frame, tangents):
        """A frame from one tangent to the next, by the least rotation that turns these."""
        one, two = tangents
        axis = skew(jnp.cross(one, two))
        return (jnp.eye(3) + axis + axis @ axis / (1 + one @ two)) @ frame, None

    def particles(q):
        """Where they are, exact but for what is of third order in the place of the tip."""
        rise = jnp.einsum("cnp,n->pc", slopes[1:], q) / 2.0
        short = 2.0 * jnp.trapezoid(jnp.sum(rise**2, 1), points) / 2
        tangents = jnp.concatenate([jnp.sqrt(1 - jnp.sum(rise**2, 1))[:, None], rise], 1)
        pairs = jnp.stack([tangents[:-1], tangents[1:]], 1)
        axes = section @ jax.lax.scan(carried, jnp.eye(3), pairs)[0].T
        tip = end @ q + jnp.array([2.4, 0.0, 0.0]).at[0].add(-short) + offset * axes[0]
        return tip[None] + jnp.concatenate([arms[:, None] * axes, -arms[:, None] * axes])

    def exact(q, v):
        r, dr = jax.jvp(particles, (q,), (v,))
        moving = dr + jnp.cross(hub.angular_velocity[None], r) + hub.velocity[None]
        return mass / 6 * jnp.sum(moving**2) / 2

    def ours(q, v):
        return equations.kinetic_energy(q, v, hub.velocity, hub.angular_velocity)

    assert_alike_to_second_order(ours, exact, q, v, rtol=1e-4)
    spread = np.einsum("k,ka,kb->ab", [along, across, up], section, section)
    own = np.trace(spread) * np.eye(3) - spread
    centre = mass * 2.7**2 * np.diag([0.0, 1.0, 1.0])
    np.testing.assert_allclose(equations.undeformed.inertia, own + centre, atol=1e-7)


CONES = [
    slow(16.0, 0.5, 0.2, 6.0, 0.3),
    *(
        exhaustive(*case)
        for case in (
            (16.0, 0.0, 0.0, 8.0, np.deg2rad(5.0)), (4.0, 0.0, 0.0, 12.0, -0.2),
            (16.0, 0.3, 0.1, 0.0, 0.3),
        )
    ),
]  # fmt: skip


@pytest.mark.parametrize(("ratio", "hub", "tip", "speed", "cone"), CONES)
def test_precone(ratio, hub, tip, speed, cone):
    """About the deflected steady state, by 12 functions each way."""
    theirs = reference.Blade(lag=ratio, hub=hub, tip=reference.Body(tip))
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, STIFF, ratio, 1.0), hub, tip, precone=cone)
    found = jb.modes(jb.Hybrid(0, 12, 12), rotor, speed, 4)
    wanted = reference.coned(theirs, speed, cone, 4)
    np.testing.assert_allclose(np.sort(found.frequency), wanted, rtol=1e-9)
    assert np.max(found.residual) < 1e-12


def about_the_axis(first, second, speed):
    """The rates of a shaft about its axis in each mode, of the rest frequencies that both ways
    have, growing ones and those that swing: see `coned.py`."""
    square = [1, 0, first**2 + second**2 + 2 * speed**2, 0]
    rates = np.roots([*square, (first**2 - speed**2) * (second**2 - speed**2)])
    return [rate for rate in rates if rate.imag > 1e-6 or rate.real > 1e-6]


@pytest.mark.slow
def test_a_cone_of_a_right_angle_is_a_shaft():
    """Round: rest frequency less and plus the speed, also beyond it; of two stiffnesses: unstable
    between the two rest frequencies."""
    rest = CANTILEVER

    def found(ratio, speed):
        rotor = jb.Rotor(jb.Beam(1.0, 1.0, STIFF, ratio, 1.0), 0.0, precone=np.pi / 2)
        return jb.modes(jb.Hybrid(0, 8, 8), rotor, speed, jb.labels(in_plane=2, flap=2))

    for speed in (0.5 * rest[0], 1.5 * rest[0]):
        round_one = found(1.0, speed)
        wanted = np.sort(np.abs(np.concatenate([rest - speed, rest + speed])))
        np.testing.assert_allclose(np.sort(round_one.frequency), wanted, rtol=1e-7)
        np.testing.assert_allclose(round_one.growth_rate, 0.0, atol=1e-9)
        assert abs(round_one.steady_strain) < 1e-20
    for speed in (0.5 * rest[0], 1.5 * rest[0], 2.5 * rest[0]):
        rates = np.asarray(found(4.0, speed).eigenvalue)
        wanted = np.concatenate([about_the_axis(2 * w, w, speed) for w in rest])
        assert (rates.real.max() > 1e-6) == (rest[0] < speed < 2 * rest[0])
        ours, wanted = (sorted(each, key=abs) for each in (rates, wanted))
        np.testing.assert_allclose(ours, wanted, atol=1e-5)


@pytest.mark.exhaustive
@pytest.mark.parametrize("springs", [None, (5.0, 3.0)])
@pytest.mark.parametrize(
    ("cone", "speed", "hub"),
    [(90.0, 2.0, 0.3), (89.9, 2.0, 0.3), (60.0, 3.0, 0.3), (90.0, 5.0, 0.0)],
)
def test_steep_cones_by_rods_in_space(cone, speed, hub, springs):
    """Which know nothing of azimuths."""
    beam = jb.Beam(1.0, 1.0, 1e6, 4.0, 1.0, torsional_stiffness=1e4, polar_inertia=1e-7)
    root = springs and jb.RootSprings(*springs)
    rotor = jb.Rotor(beam, hub, 0.1, precone=np.deg2rad(cone), root_springs=root)
    rod, found = (
        np.asarray(jb.modes(model, rotor, speed, 3).eigenvalue)
        for model in (jb.SpatialRod(6), jb.Hybrid(0, 10, 10))
    )
    np.testing.assert_allclose(found, rod, rtol=3e-4, atol=1e-6)


@pytest.mark.exhaustive
def test_precone_of_a_table():
    """Differences and both modes of derivatives, kinks, a root that yields, a batch; a cone of
    zero is none."""
    ours, theirs = in_table()
    model = jb.Hybrid(0, 16, 16)
    wanted = reference.coned(theirs, 3.0, 0.1, 4)
    found = lowest(model, jb.Rotor(ours, 0.5, precone=0.1), 3.0, 4)
    np.testing.assert_allclose(found, wanted, rtol=1e-5)
    yielding = jb.Hybrid(0, 9, 9)

    def frequency(cone, spring=20.0):
        rotor = jb.Rotor(ours, 0.5, root_springs=jb.RootSprings(spring, spring), precone=cone)
        return jb.modes(yielding, rotor, 3.0, 4).frequency

    flat = jb.Rotor(ours, 0.5, root_springs=jb.RootSprings(20.0, 20.0))
    np.testing.assert_allclose(frequency(0.0), jb.modes(yielding, flat, 3.0, 4).frequency)
    ends = jax.vmap(frequency)(jnp.array([0.1 - 1e-4, 0.1, 0.1 + 1e-4]))
    np.testing.assert_allclose(ends[1], frequency(0.1), rtol=1e-12)
    exact = jax.jacfwd(frequency)(0.1)
    np.testing.assert_allclose(exact, (ends[2] - ends[0]) / 2e-4, rtol=1e-6)
    np.testing.assert_allclose(jax.jacrev(frequency)(0.1), exact, rtol=1e-9)


@pytest.mark.slow
def test_what_coned_beams_cannot_do_is_named():
    rotor = jb.Rotor(BEAM, precone=0.1)
    small, modulated = jb.Hybrid(0, 3, 3), jb.motions.ModulatedSpeed(2.0, 0.3, 5.0)
    for refused in (
        lambda: jb.simulate(small, rotor, jb.ConstantSpeed(1.0), [0.0, 1.0]),
        lambda: jb.modes(jb.Hybrid(), rotor, 1.0),
        lambda: jb.modes(jb.VonKarman(), rotor, 1.0),
        lambda: jb.modes(small, jb.Rotor(BEAM, precone=0.1, pitch=0.1), 1.0),
        lambda: jb.modes(small, jb.Rotor(BEAM, precone=0.1, tip_body=jb.TipBody(0.0)), 1.0),
        lambda: jb.critical_speed(small, rotor),
        lambda: jb.floquet(small, rotor, modulated),
        lambda: jb.stiffening_ratio(rotor, 1.0),
    ):
        with pytest.raises(ValueError, match=r"^precone"):
            refused()
    bad = jax.vmap(lambda c: jb.modes(small, jb.Rotor(BEAM, precone=c), 1.0, throw=False).status)
    np.testing.assert_array_equal(bad(jnp.array([0.1, jnp.nan])), [0, jb.Status.INVALID_PRECONE])


MODES = jb.models.CantileverModes()  # functions that are the same on every beam
CONSTANT = [
    slow(jb.Hybrid(3, 4, 3, MODES)),
    exhaustive(jb.papers.SmallStrainANCF(2)),
    exhaustive(jb.Classical(3, 4, 3, MODES)),
    exhaustive(jb.VonKarman(5, 3, 2, MODES)),
]


@pytest.mark.parametrize("model", CONSTANT, ids=name)
def test_constant_tables_are_the_uniform_beam(model):
    """With a kink in the table, twist of zero and a body that is a point."""
    uniform = jb.Rotor(short(4e3), 0.4, 0.9)

    def same(value):
        return jb.Spanwise([0.0, 0.3, 1.0], 3 * [value])

    flat = jb.models.Direction.FLAP not in model.directions
    built = jb.Rotor(
        jb.Beam(2.0, same(1.3), same(4e3), same(11.0), same(7.0), None if flat else same(0.0)),
        0.4, tip_body=jb.TipBody(0.9),
    )  # fmt: skip
    hub, q, v = random_state(model, 4, flat)
    force = jnp.array([3.0, -2.0, 0.0])

    @jax.jit
    def numbers(rotor):
        equations = model.equations(rotor)
        return (
            equations.force(hub, q, v, force), *map(dense, equations.tangents(hub, q, v, force)),
            equations.strain_energy(q), equations.first_moment(q), equations.tip(q),
            equations.kinetic_energy(q, v, hub.velocity, hub.angular_velocity),
            equations.rigid_moments,
            equations.displacement(q, np.array([0.4, 1.0])), rotor.steady_strain(jnp.asarray(2.0)),
        )  # fmt: skip

    for ours, wanted in zip(numbers(built), numbers(uniform), strict=True):
        np.testing.assert_allclose(ours, wanted, rtol=1e-11, atol=1e-12 * np.abs(wanted).max())
    ours, wanted = (model.linearise(rotor, 2.0) for rotor in (built, uniform))
    for matrix in ("mass", "gyroscopic", "stiffness"):
        there = getattr(wanted, matrix)
        scale = 1e-12 * np.abs(there).max()
        np.testing.assert_allclose(getattr(ours, matrix), there, rtol=1e-11, atol=scale)


@pytest.mark.parametrize(
    "model",
    [
        exhaustive(jb.Hybrid(6, 12, 12)),
        exhaustive(jb.Classical(6, 12, 12)),
        exhaustive(jb.VonKarman(24, 12, 12)),
        exhaustive(jb.Hybrid(10, 14, 14, Polynomials(grading=2))),
    ],
    ids=name,
)
def test_constant_tables_in_functions_of_their_own(model):
    """A uniform beam is as it is by functions that suit a table: modes, rest and energies."""
    uniform = jb.Rotor(short(4e3), 0.4, 0.9)
    same = [jb.Spanwise([0.0, 0.3, 1.0], 3 * [value]) for value in (1.3, 4e3, 11.0, 7.0, 0.0)]
    built = jb.Rotor(jb.Beam(2.0, *same), 0.4, 0.9)
    wanted, found = (jb.modes(model, rotor, 2.0, 5) for rotor in (uniform, built))
    np.testing.assert_allclose(found.frequency, wanted.frequency, rtol=1e-8)
    assert np.max(found.frequency_error) < 1e-8
    loads, places = jb.Loads(tip_force=[0.1, 0.2, 0.3]), np.array([0.1, 0.3, 0.7, 1.0])

    def rest(rotor):
        q = jb.steady_start(model, rotor, jb.ConstantSpeed(1.0), loads=loads).q
        equations = model.equations(rotor)
        return (
            equations.displacement(q, places), equations.strain(q, places),
            equations.curvature(q, places), equations.strain_energy(q), equations.first_moment(q),
        )  # fmt: skip

    for ours, theirs in zip(rest(built), rest(uniform), strict=True):
        scale = np.abs(theirs).max()
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-6 * scale)


def built_from(values):
    """A rotor all of whose numbers come from one vector."""
    mass, axial, lag, flap, twist, rest = jnp.split(values, [3, 5, 8, 11, 14])
    stations = (0.0, 0.4, 1.0)
    beam = jb.Beam(
        1.0, jb.Spanwise(stations, mass), jb.Spanwise((0, 1), axial), jb.Spanwise(stations, lag),
        jb.Spanwise(stations, flap), jb.Spanwise(stations, twist),
    )  # fmt: skip
    hub, tip, pitch, first, second, offset, inertia, axial_inertia, flap_inertia = rest
    return jb.Rotor(
        beam, hub, pitch=pitch, root_springs=jb.RootSprings(first, second),
        tip_body=jb.TipBody(tip, offset, inertia, axial_inertia, flap_inertia),
    )  # fmt: skip


OF_BEAM = (1.0, 0.9, 0.5, 5e3, 4e3, 16.0, 12.0, 5.0, 1.0, 0.8, 0.4, 0.3, 0.2, 0.05)
VALUES = np.array([*OF_BEAM, 0.2, 0.3, 0.1, 50.0, 20.0, 0.05, 0.02, 0.01, 0.03])


@pytest.mark.exhaustive
def test_gradients_by_every_number():
    """By every value at a station and all the rest, against differences, in both modes; and a batch
    is as single cases. Functions enough that what moves their choice does not count."""
    model = jb.Hybrid(3, 14, 14)

    def frequency(values):
        return jb.modes(model, built_from(values), 3.0, 3, throw=False).frequency

    exact = jax.jit(jax.jacfwd(frequency))(VALUES)
    step = 1e-5 * np.abs(VALUES)
    ends = np.concatenate([VALUES + np.diag(step), VALUES - np.diag(step)])
    many = jax.jit(jax.vmap(frequency))(ends)
    above, below = np.split(np.asarray(many), 2)
    differences = ((above - below) / (2 * step[:, None])).T
    exact = np.asarray(exact)
    scale = np.abs(differences * VALUES[None]).max()
    np.testing.assert_allclose(
        exact * VALUES[None], differences * VALUES[None], rtol=1e-7, atol=1e-7 * scale
    )
    np.testing.assert_allclose(jax.jit(jax.jacrev(frequency))(VALUES), exact, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(many[3], frequency(ends[3]), rtol=1e-12)


@pytest.mark.slow
def test_a_bad_number_fails_alone():
    def case(values):
        return jb.modes(jb.Hybrid(3, 6, 6), built_from(values), 3.0, 4, throw=False)

    bad = {1: -1.0, 4: np.nan, 13: np.inf, 16: np.nan, 17: -1.0, 20: -1.0}
    cases = np.tile(VALUES, (len(bad) + 1, 1))
    for row, (place, value) in enumerate(bad.items()):
        cases[row, place] = value
    found = jax.vmap(case)(cases)
    status = jb.Status
    np.testing.assert_array_equal(
        found.status,
        [
            status.INVALID_MASS_PER_LENGTH, status.INVALID_AXIAL_STIFFNESS, status.INVALID_TWIST,
            status.INVALID_PITCH, status.INVALID_ROOT_SPRINGS, status.INVALID_TIP_BODY, status.OK,
        ],
    )  # fmt: skip
    np.testing.assert_allclose(found.frequency[-1], case(VALUES).frequency, rtol=1e-12)


def test_a_function_is_as_its_table():
    table = jb.Spanwise([0, 0.4, 1], [2.0, 1.0, 0.5])
    function = SpanwiseFunction(
        jax.tree_util.Partial(lambda a, x: jnp.where(x < 0.4, 2 - a * x, 1 - (x - 0.4) / 1.2), 2.5),
        kinks=(0.4,),
    )
    model = jb.Hybrid(0, 8, 8)
    each = [
        lowest(model, jb.Rotor(jb.Beam(1.0, mass, STIFF, 4.0, mass)), 2.0)
        for mass in (table, function)
    ]
    np.testing.assert_allclose(each[0], each[1], rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: jb.Spanwise([0, 0.5, 0.4, 1], [1, 2, 3, 4]), "0.5 and then 0.4 at number 3"),
        (lambda: jb.Spanwise([0, 0.5, 0.5, 0.5, 1], [1, 2, 3, 4, 5]), "more than two are equal"),
        (lambda: jb.Spanwise([0, 0.9], [1, 2]), "from 0 to 1"),
        (lambda: jb.Spanwise([0, 1], [1, 2, 3]), "as many as stations, 2"),
        (lambda: jb.Spanwise([0], [1]), "two or more"),
        (lambda: jb.Spanwise([0, np.nan, 1], [1, 2, 3]), "must not decrease"),
        (lambda: jb.Spanwise([0, 0, 1], [1, 2, 3]), "between the ends"),
        (lambda: SpanwiseFunction(3.0), "must be a function"),
        (lambda: SpanwiseFunction(jnp.sin, kinks=(1.5,)), "between 0 and 1"),
        (lambda: jb.Beam(1, jb.Spanwise([0, 1], [1, -1]), 1, 1, 1), "station 2, x / L = 1"),
        (lambda: jb.Beam(1, SpanwiseFunction(lambda x: 0.5 - x), 1, 1, 1), "mass_per_length"),
        (lambda: jb.Beam(1, SpanwiseFunction(lambda x: x[:2]), 1, 1, 1), "for each of"),
        (lambda: jb.Beam(1, 1, 1, 1, jnp.sin), "wrap a function in SpanwiseFunction"),
        (lambda: jb.Beam(jb.Spanwise([0, 1], [1, 1]), 1, 1, 1, 1), "length must be"),
        (lambda: jb.RootSprings(-1e-9), "springs at the root"),
        (lambda: jb.TipBody(1.0, 0.0, -1.0), "tip body"),
        (lambda: jb.TipBody(1.0, flap_inertia=-1.0), "tip body"),
        (lambda: jb.Rotor(BEAM, root_springs=3.0), "root_springs must be a RootSprings"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(make, message):
    with pytest.raises((ValueError, TypeError), match=message):
        make()


BEAM = jb.Beam(1.0, 1.0, STIFF, 4.0, 1.0)
