"""What a motion or a load does along the way: seen by every step, declared or not; jumps."""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from tests.beams import README_ROTOR, SPRINGS
from tests.helpers import finite_difference, name, optimised
from tests.simulation.common import BLADE, ROTOR, RUNS, TIGHT, each_kind

A3 = jnp.array([0.0, 0.0, 1.0])
TIMES = jnp.linspace(0.0, 20.0, 201)
STILL = jb.ConstantSpeed(0.0)
HYBRID = jb.Hybrid(0, 3, 0)


def turning(speed, **declared):
    """A hub that turns at speed(t) about a3."""
    return jb.motions.HubVelocity(lambda t: jnp.zeros(3), lambda t: speed(t) * A3, **declared)


def push(force, **declared):
    """A force across the tip."""
    return jb.Loads(tip_force=lambda t: force(t) * jnp.array([0.0, 1.0, 0.0]), **declared)


def bump(t, start, width):
    """Smooth, one at its middle."""
    inside = (t > start) & (t < start + width)
    return jnp.where(inside, jnp.sin(jnp.pi * (t - start) / width) ** 2, 0.0)


def run(model, rotor, motion, times=TIMES, **options):
    return jb.simulate(model, rotor, motion, times, throw=False, **options)


def rise(duration, at=1.0, by=0.5):
    """Of the speed, smooth, in a short time from `at` on."""
    up = jb.SmoothSpinUp(by, duration)
    return turning(lambda t: up.angular_speed(t - at))


def step(at=1.0, by=0.5, **declared):
    return turning(lambda t: jnp.where(t > at, by, 0.0), **declared)


class Kinked(jb.motions.Spin):
    """An angle with a kink."""

    at: jax.Array
    axis: jax.Array

    def angle(self, t):
        return 0.5 * jnp.maximum(t - self.at, 0.0)


def assert_same(found, expected, rtol):
    assert int(found.status) == int(expected.status) == jb.Status.OK
    size = jnp.max(jnp.abs(expected.tip))
    assert size > 0
    np.testing.assert_allclose(found.tip, expected.tip, rtol=0, atol=rtol * size)


@pytest.mark.exhaustive
def test_a_spin_up_that_begins_later_is_the_same_later():
    """At rest nothing limits a step but what is to come."""

    @jax.jit
    @jax.vmap
    def both(duration):
        up = jb.SmoothSpinUp(2.0, duration)
        later = run(HYBRID, README_ROTOR, turning(lambda t: up.angular_speed(t - 5.0)))
        at_once = run(HYBRID, README_ROTOR, up, jnp.linspace(0.0, 15.0, 151))
        return later.status + at_once.status, later.tip, at_once.tip

    status, later, at_once = both(jnp.array([0.2, 1.0, 2.0]))
    np.testing.assert_array_equal(status, jb.Status.OK)
    np.testing.assert_allclose(later[:, :50], 0.0, atol=1e-15)
    np.testing.assert_allclose(later[:, 50:], at_once, rtol=0, atol=1e-4)
    assert (jnp.max(jnp.abs(later), (1, 2)) > 4.0).all()


@pytest.mark.exhaustive
@pytest.mark.parametrize(("model", "rotor"), RUNS, ids=name)
def test_a_start_before_the_spin_up_changes_nothing(model, rotor):
    motion, times = jb.SmoothSpinUp(0.5, 0.4), jnp.linspace(0.0, 2.0, 41)
    options = {"stepsize_controller": TIGHT, "max_steps": 30_000}
    later = jnp.concatenate([jnp.linspace(-30.0, -1.0, 30), times])
    before = run(model, rotor, motion, later, **options)
    # As many times, and so the same program.
    longer = jnp.concatenate([times, times[-1] + jnp.linspace(0.01, 0.3, 30)])
    expected = run(model, rotor, motion, longer, **options)
    assert int(before.status) == int(expected.status) == jb.Status.OK
    size = jnp.max(jnp.abs(expected.tip))
    np.testing.assert_allclose(before.tip[30:], expected.tip[:41], rtol=0, atol=1e-6 * size)


@optimised
@jax.vmap
def pushed(starts, widths, sizes):
    """Status and motion of the tip under several pulses, not declared and declared."""

    def force(t):
        pulses = [a * bump(t, s, w) for s, w, a in zip(starts, widths, sizes, strict=True)]
        return sum(pulses)

    found = run(HYBRID, README_ROTOR, STILL, loads=push(force))
    ends = jnp.concatenate([starts, starts + widths])
    declared = run(HYBRID, README_ROTOR, STILL, loads=push(force, changes=ends))
    return found.status + declared.status, found.tip, declared.tip


@pytest.mark.exhaustive
def test_pulses_of_force_are_seen_wherever_they_are():
    """Short, repeated, small beside large ones: at places that no step would look at."""
    chance = np.random.default_rng(5)
    places = np.append(chance.uniform(0.3, 17.0, 8), [5.0, 10.0, 12.5])
    widths = np.tile([2.0, 0.3, 0.1, 0.03], 11)
    cases = [(np.full(3, s), np.full(3, w), np.array([0.5, 0, 0]))
             for s, w in zip(np.repeat(places, 4), widths, strict=True)]  # fmt: skip
    for spread in (1.0, 17.0):  # side by side, and far apart
        first = chance.uniform(1.0, 18.0 - spread, (4, 1))
        starts = first + chance.uniform(0.0, spread, (4, 3))
        pairs = zip(starts, chance.uniform(0.03, 0.3, (4, 3)), strict=True)
        cases += [(start, width, np.ones(3)) for start, width in pairs]
    # Short ones beside longer ones, which hid them once.
    cases += [(np.array([12.21, 2.1, 1.693]), np.array([0.0338, 0.1409, 0.0358]), np.ones(3))]
    cases += [(np.array([17.95, 17.821, 17.653]), np.array([0.0752, 0.2246, 0.0341]), np.ones(3))]
    cases += [(np.array([3.3, 15.0, 15.0]), np.array([0.2, 2.0, 2.0]), np.array([1e-3, 1.0, 0.0]))]
    status, found, expected = pushed(*(jnp.asarray(column) for column in zip(*cases, strict=True)))
    np.testing.assert_array_equal(status, jb.Status.OK)
    size = jnp.max(jnp.abs(expected), (1, 2), keepdims=True)
    assert (size > 1e-4).all()
    error = jnp.max(jnp.abs(found - expected) / size, (1, 2))
    assert jnp.max(error) < 1e-4, (cases[int(jnp.argmax(error))], error)
    early = slice(None, 150)  # before the large one begins
    assert jnp.max(jnp.abs(expected[-1, early])) > 5e-5
    np.testing.assert_allclose(found[-1, early], expected[-1, early], rtol=0, atol=1e-6)


@pytest.mark.exhaustive
def test_a_damped_beam_at_rest_at_speed_sees_the_spin_down():
    up = jb.SmoothSpinUp(2.0, 1.0)
    damping = jb.Damping(mass_coefficient=3.0)
    motion = jb.motions.SpinUpThenDown(up, down_at=100.0)
    found = run(HYBRID, README_ROTOR, motion, jnp.linspace(0.0, 130.0, 261), damping=damping)
    down = turning(lambda t: 2.0 - up.angular_speed(t))
    start = jb.steady_start(HYBRID, README_ROTOR, down)
    expected = run(
        HYBRID, README_ROTOR, down, jnp.linspace(0.0, 30.0, 61), damping=damping, start=start
    )
    assert int(found.status) == int(expected.status) == jb.Status.OK
    assert jnp.max(jnp.abs(expected.tip[:, 1])) > 0.5
    np.testing.assert_allclose(found.tip[200:], expected.tip, rtol=0, atol=1e-4)


CONTROLLED = [
    (jb.solvers.Rodas5P(), diffrax.ConstantStepSize(), 0.1),
    (jb.solvers.Rodas4P(), diffrax.StepTo(TIMES), None),
    (jb.solvers.ChordKvaerno5(), diffrax.ConstantStepSize(), 0.1),
    (
        jb.solvers.Rodas5P(),
        diffrax.ClipStepSizeController(diffrax.PIDController(1e-6, 1e-6), step_ts=[9.0]),
        None,
    ),
    (diffrax.Tsit5(), diffrax.PIDController(1e-8, 1e-8), None),
    (diffrax.Kvaerno5(), diffrax.PIDController(1e-7, 1e-7), None),
]


SUDDEN = rise(0.06, at=5.02, by=0.2)


@functools.cache
def after_a_sudden_rise():
    return run(jb.Hybrid(0, 1, 0), README_ROTOR, SUDDEN, stepsize_controller=TIGHT)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("solver", "controller", "dt0"),
    CONTROLLED,
    ids=lambda value: type(value).__name__,
)
def test_every_controller_sees_what_comes_later(solver, controller, dt0):
    """Between two steps of a tenth of a second."""
    options = {"solver": solver, "stepsize_controller": controller, "dt0": dt0}
    found = run(jb.Hybrid(0, 1, 0), README_ROTOR, SUDDEN, max_steps=20_000, **options)
    assert_same(found, after_a_sudden_rise(), 0.02)


@each_kind
def test_a_jump_of_speed_that_is_not_declared_ends_the_run(model, rotor):
    motion, times = step(), jnp.linspace(0.0, 2.0, 41)
    found = run(model, rotor, motion, times)
    assert int(found.status) == jb.Status.UNRESOLVED
    assert 0.9 < found.end_time <= 1.0
    np.testing.assert_allclose(found.tip[:20], 0.0, atol=1e-12)
    assert jnp.isnan(found.peak()[0])
    with pytest.raises(RuntimeError, match="it jumps"):
        jb.simulate(model, rotor, motion, times)


@pytest.mark.exhaustive
def test_jumps_of_other_kinds_that_are_not_declared():
    times = jnp.linspace(0.0, 2.0, 41)
    sideways = jb.motions.HubVelocity(
        lambda t: jnp.where(t > 1.3, 0.2, 0.0) * jnp.array([0.0, 1.0, 0.0]), lambda t: 0.0 * A3
    )
    pieces = turning(lambda t: jnp.floor(50 * t) / 50)  # a measured speed that is held
    passed_over = diffrax.ClipStepSizeController(
        diffrax.PIDController(1e-6, 1e-6), jump_ts=jnp.array([1.0])
    )
    for motion, options in (
        (Kinked(jnp.asarray(1.0), A3), {}),
        (sideways, {}),
        (pieces, {}),
        (step(), {"stepsize_controller": passed_over}),
        (step(), {"stepsize_controller": diffrax.ConstantStepSize(), "dt0": 0.05}),
    ):
        assert int(run(HYBRID, ROTOR, motion, times, **options).status) == jb.Status.UNRESOLVED


@each_kind
def test_the_impulse_of_a_jump_is_the_limit_of_short_rises(model, rotor):
    times = jnp.linspace(0.0, 1.3, 27)

    @jax.jit  # one program for both: a jump beyond the end is none
    def after(duration, jump):
        up = jb.SmoothSpinUp(0.5, duration)

        def speed(t):
            return jnp.where(jump > times[-1], up.angular_speed(t - 1.0), jnp.where(t > 1, 0.5, 0))

        motion = turning(speed, jumps=jump[None])
        return run(model, rotor, motion, times, stepsize_controller=TIGHT)

    found = after(1.0, jnp.asarray(1.0))
    assert int(found.status) == jb.Status.OK
    assert jnp.max(jnp.abs(found.imbalance)) < 1e-6
    size = jnp.max(jnp.abs(found.tip))
    assert size > 0.01
    errors = []
    for duration in (1e-3, 1e-4):
        smooth = after(duration, jnp.asarray(2.0))
        assert int(smooth.status) == jb.Status.OK
        errors.append(float(jnp.max(jnp.abs(smooth.tip - found.tip)[22:]) / size))
    assert errors[0] < 0.02
    np.testing.assert_allclose(errors[1] / errors[0], 0.1, rtol=0.2)


SOLVERS = [None, jb.solvers.ChordKvaerno5(5), diffrax.Dopri8(), diffrax.Kvaerno5()]


@pytest.mark.exhaustive
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda value: type(value).__name__)
def test_jumps_of_all_kinds_at_any_time(solver):
    """Of the hub's place and angle together; at the start, at an output, in between."""
    times = jnp.linspace(0.0, 1.0, 21)
    across = jnp.array([0.0, 1.0, 0.0])

    def motion(jump, **declared):
        return jb.motions.HubVelocity(
            lambda t: 0.3 * jump(t) * across, lambda t: 0.4 * jump(t) * A3, **declared
        )

    @jax.jit
    def both(at):
        jump = motion(lambda t: jnp.where(t > at, 1.0, 0.0), jumps=at[None])
        up = jb.SmoothSpinUp(1.0, 1e-5)
        smooth = motion(lambda t: up.angular_speed(t - at), changes=jnp.stack([at, at + 1e-5]))
        expected = run(HYBRID, ROTOR, smooth, times, stepsize_controller=TIGHT)
        options = {"stepsize_controller": TIGHT, "max_steps": 30_000}
        return run(HYBRID, ROTOR, jump, times, solver=solver, **options), expected

    for at in (0.0, 0.4, 0.437):
        found, expected = both(jnp.asarray(at))
        assert_same(found, expected, 1e-4)
        assert jnp.max(jnp.abs(found.imbalance)) < 1e-5


BEAT = np.linspace(0.0, 1.3, 27)


def rising(t, at, width):
    """From zero to one at each time: in so short a time, smoothly, or at once where it is zero."""
    share = jnp.clip((t - at) / jnp.where(width > 0, width, 1.0), 0.0, 1.0)
    smooth = share - jnp.sin(2 * jnp.pi * share) / (2 * jnp.pi)
    return jnp.where(width > 0, smooth, jnp.where(t > at, 1.0, 0.0))


@jax.jit
@jax.vmap
def leaping(p):
    """Status, motion of the tip and imbalance under jumps of the hub's speeds and of the force,
    with a spin-up and other times declared around them; jumps beyond the end are none."""
    up, width = jb.SmoothSpinUp(p["spin"], p["changes"][1] - p["changes"][0]), p["width"]

    def angular_velocity(t):
        jumps = p["turn"] @ rising(t, p["hub_at"], width)
        return (up.angular_speed(t - p["changes"][0]) + jumps) * A3

    motion = jb.motions.HubVelocity(
        lambda t: p["side"] @ rising(t, p["hub_at"], width) * jnp.array([0.0, 1.0, 0.0]),
        angular_velocity,
        changes=jnp.concatenate([p["changes"], p["hub_at"] + width]),
        jumps=jnp.where(p["declared"], p["hub_at"], 9.0),
    )
    loads = push(
        lambda t: p["push"] @ rising(t, p["push_at"], width),
        changes=jnp.concatenate([p["changes"], p["push_at"] + width]),
        jumps=jnp.where(p["declared"], p["push_at"], 9.0),
    )
    found = run(ONE, ROTOR, motion, BEAT, loads=loads, stepsize_controller=TIGHT)
    return found.status, found.tip[:, 1], jnp.max(jnp.abs(found.imbalance))


ONE = jb.Hybrid(0, 1, 0)


def struck_twice(chance, jumps, **more):
    """Two jumps of each kind named at random times, with changes before, between and after."""
    t = np.sort(chance.uniform(0.02, 1.25, 7))
    p = {"declared": True, "width": 0.0, "spin": 0.0, "changes": t[[0, 3, 6]]}
    p |= {"hub_at": t[[1, 4]], "push_at": t[[2, 5]]}
    for kind in ("turn", "side", "push"):
        sizes = chance.uniform(0.1, 0.3, 2) * chance.choice([-1.0, 1.0], 2)
        p[kind] = sizes if kind in jumps else np.zeros(2)
    return p | more


def rung(p):
    """The closed form for one coordinate in a hub that does not turn."""
    equations, zero = ONE.equations(ROTOR), jnp.zeros(1)
    none = jnp.zeros(3)
    across = jnp.array([0.0, 1.0, 0.0])
    still = jb.motions.Hub(none, none, none, none, none)
    stiffness = -jax.grad(lambda q: equations.force(still, q, zero, None)[0])(zero)[0]
    mass = equations.mass[0, 0]
    by_hub = equations.force(still._replace(velocity_rate=across), zero, zero, None)[0]
    by_push = equations.force(still, zero, zero, across)[0]
    w = np.sqrt(stiffness / mass)
    since = {key: np.maximum(BEAT[:, None] - p[key], 0.0) for key in ("hub_at", "push_at")}
    q = by_hub / (mass * w) * np.sin(w * since["hub_at"]) @ p["side"]
    q += by_push / stiffness * (1 - np.cos(w * since["push_at"])) @ p["push"]
    return q * jax.jvp(equations.tip, (zero,), (jnp.ones(1),))[1][1]


@pytest.mark.slow
def test_jumps_strike_once_among_changes():
    """Of loads, of the hub and of both: by the closed form, as short rises do, and not at all where
    what is declared does not jump."""
    chance = np.random.default_rng(5)
    straight = [struck_twice(chance, kinds) for kinds in (["push"], ["side"], ["side", "push"])]
    together = struck_twice(chance, ["side", "push"])
    straight.append(together | {"push_at": together["hub_at"]})
    spun = [struck_twice(chance, kinds, spin=0.5) for kinds in (["push"], ["turn", "side", "push"])]
    # Exactly where the spin-up ends.
    spun.append(struck_twice(chance, ["turn", "push"], spin=0.5))
    spun[-1]["hub_at"] = spun[-1]["changes"][[1, 2]]
    rises = [p | {"declared": False, "width": 1e-5} for p in spun]
    nothing = struck_twice(chance, [], spin=0.5)
    cases = [*straight, *spun, *rises, nothing, nothing | {"declared": False}]
    status, tip, imbalance = leaping(jax.tree.map(lambda *a: jnp.stack(a), *cases))
    np.testing.assert_array_equal(status, jb.Status.OK)
    assert jnp.max(imbalance) < 1e-6
    expected = [*map(rung, straight), *tip[7:10], tip[11]]
    found = [*tip[:7], tip[10]]
    for p, one, other, near in zip(
        [*straight, *spun, nothing], found, expected, [1e-7] * 4 + [3e-4] * 3 + [1e-7], strict=True
    ):
        size = np.max(np.abs(other))
        assert size > 1e-3
        np.testing.assert_allclose(one, other, rtol=0, atol=near * size, err_msg=str(p))


@pytest.mark.slow
def test_jumps_closer_than_a_step_and_just_before_the_end():
    """They strike as one, or are no part of the run; as many cases as above, and so one program."""
    unit = np.finfo(float).eps
    p = struck_twice(np.random.default_rng(6), ["turn", "side", "push"], spin=0.5)
    close = [p | {"hub_at": 0.7 + unit * np.array([0, k])} for k in (0, 3, 7, 13, 20, 40)]
    gone = p | {kind: p[kind] * np.array([1.0, 0.0]) for kind in ("turn", "side")}
    late = [p | {"hub_at": np.array([0.7, 1.3 - k * unit])} for k in (0, 7, 20, 60, 200)]
    cases = [*close, gone | {"hub_at": np.array([0.7, 1.3])}, *late]
    status, tip, _ = leaping(jax.tree.map(lambda *a: jnp.stack(a), *cases))
    np.testing.assert_array_equal(status, jb.Status.OK)
    for same in (tip[:6], tip[6:]):
        size = jnp.max(jnp.abs(same[0]))
        np.testing.assert_allclose(same, same[:1].repeat(6, 0), rtol=0, atol=1e-7 * size)


@pytest.mark.exhaustive
def test_a_controller_may_know_of_the_same_jumps():
    """Steps that it wants within the pause about a jump would lead back before it."""
    motion, times = step(jumps=[1.0]), jnp.linspace(0.0, 2.0, 41)
    told = diffrax.ClipStepSizeController(TIGHT, jump_ts=[0.6, 1.0])
    found, expected = (
        run(ONE, ROTOR, motion, times, stepsize_controller=how) for how in (told, TIGHT)
    )
    assert_same(found, expected, 1e-7)


@pytest.mark.exhaustive
def test_jumps_at_both_ends_of_a_run():
    """Struck at the start; what jumps at the end is no part of the run."""
    times = jnp.linspace(0.0, 1.0, 21)

    @jax.jit
    def both(places):
        """With the default controller."""

        def one(places):
            speed = lambda t: 0.5 * jnp.sum(jnp.where(t > places, 1.0, 0.0))  # noqa: E731
            found = run(HYBRID, ROTOR, turning(speed, jumps=places), times)
            return found.status, found.tip, found.hub_torque

        return jax.vmap(one)(jnp.stack([places, places.at[1].set(2.0)]))

    status, tip, torque = both(jnp.array([0.0, 1.0]))
    np.testing.assert_array_equal(status, jb.Status.OK)
    assert jnp.max(jnp.abs(tip)) > 0.01
    for a in (tip, torque):
        np.testing.assert_allclose(a[0], a[1], rtol=0, atol=1e-5 * jnp.max(jnp.abs(a[1])))


@pytest.mark.exhaustive
def test_corners_cost_no_rejected_steps_where_they_are_declared():
    """With a tolerance that rejects nothing, what is left are steps that missed a corner."""
    times = jnp.array([0.0, 2.03, 3.07, 6.01, 6.52, 10.04])
    speeds = jnp.array([0.0, 0.5, 0.5, 2.0, 1.5, 1.5])
    table = jb.motions.TabulatedSpeed(times, speeds)
    same = turning(lambda t: jnp.interp(t, times, speeds))
    lax = diffrax.PIDController(1.0, 1e3, dtmax=0.1)
    outputs = jnp.linspace(0.0, 12.0, 13)
    declared, undeclared = (
        run(HYBRID, README_ROTOR, motion, outputs, stepsize_controller=lax)
        for motion in (table, same)
    )
    assert int(declared.status) == jb.Status.OK
    assert int(declared.solution.stats["num_rejected_steps"]) == 0
    assert int(undeclared.solution.stats["num_rejected_steps"]) > 10
    size = jnp.max(jnp.abs(declared.tip))
    np.testing.assert_allclose(undeclared.partial.tip, declared.tip, rtol=0, atol=0.01 * size)


@pytest.mark.exhaustive
def test_gradients_by_times_of_jumps_and_corners():
    """Steps end there: what the state does on either side of a moving time is not forgotten."""
    times = jnp.linspace(0.0, 1.2, 13)

    def end(p, **options):
        at, corner, kick = p
        motion = turning(
            lambda t: jnp.where(t > at, 0.3, 0.0) + jnp.maximum(t - corner, 0.0),
            jumps=jnp.stack([at, corner]),
        )
        loads = push(lambda t: jnp.where(t > kick, 0.5, 0.0), jumps=kick[None])
        found = run(HYBRID, ROTOR, motion, times, loads=loads, stepsize_controller=TIGHT, **options)
        return found.tip[-1, 1]

    at = jnp.array([0.33, 0.52, 0.71])
    expected = finite_difference(optimised(end), at, 1e-3)
    np.testing.assert_allclose(jax.jit(jax.grad(end))(at), expected, rtol=1e-5)
    forward = jax.jit(jax.jacfwd(lambda p: end(p, adjoint=diffrax.ForwardMode())))(at)
    np.testing.assert_allclose(forward, expected, rtol=1e-5)


@pytest.mark.exhaustive
def test_jumps_in_a_batch_are_those_of_single_runs():
    times = jnp.linspace(0.0, 1.0, 21)

    def one(at):
        return run(HYBRID, ROTOR, step(at, jumps=at[None]), times)

    places = jnp.array([0.2, 0.5, 0.71, 0.0])
    batch = jax.vmap(one)(places)
    for i, place in enumerate(places):
        alone = one(place)
        assert int(batch.status[i]) == int(alone.status) == jb.Status.OK
        np.testing.assert_allclose(batch.tip[i], alone.tip, rtol=0, atol=1e-12)


@pytest.mark.exhaustive
def test_a_small_speed_profile_from_a_file(tmp_path):
    """Piecewise linear and cubic, against the smooth motion that it is taken from."""
    up = jb.SmoothSpinUp(4.0, 15.0)
    outputs = jnp.linspace(0.0, 20.0, 201)
    truth = run(HYBRID, README_ROTOR, up, outputs)
    errors = {}
    for count in (31, 61):
        t = np.linspace(0.0, 15.0, count)
        speed = np.asarray(jax.vmap(up.angular_speed)(jnp.asarray(t)))
        np.savetxt(tmp_path / "profile.csv", np.stack([t, speed], 1), delimiter=",", header="t, w")
        t, speed = np.loadtxt(tmp_path / "profile.csv", delimiter=",", unpack=True)
        for smooth in (False, True):
            found = run(
                HYBRID, README_ROTOR, jb.motions.TabulatedSpeed(t, speed, smooth=smooth), outputs
            )
            assert int(found.status) == jb.Status.OK
            errors[count, smooth] = float(jnp.max(jnp.abs(found.tip - truth.tip)))
    assert errors[61, False] < 0.35 * errors[31, False] < 0.02
    assert errors[61, True] < 0.2 * errors[31, True] < 2e-3


@pytest.mark.exhaustive
@pytest.mark.parametrize("smooth", [False, True])
def test_tabulated_speeds(smooth):
    times, speeds = jnp.array([1.0, 2.0, 2.5, 4.0]), jnp.array([0.5, 1.0, -1.0, 2.0])
    motion = jb.motions.TabulatedSpeed(times, speeds, smooth=smooth)
    speed = jax.vmap(motion.angular_speed)
    np.testing.assert_allclose(speed(times), speeds, atol=1e-14)
    np.testing.assert_allclose(speed(jnp.array([-3.0, 0.9, 4.1, 9.0])), [0.5, 0.5, 2.0, 2.0])
    fine = jnp.linspace(-1.0, 6.0, 70_001)
    middle = (fine[1:] + fine[:-1]) / 2
    angle = jax.vmap(motion.angle)(fine)
    np.testing.assert_allclose(jnp.diff(angle) / 1e-4, speed(middle), atol=1e-6)
    rate = jax.vmap(lambda t: motion.hub(t, None).angular_velocity_rate[2])(fine)
    jumps = jnp.max(jnp.abs(jnp.diff(rate)))
    assert jumps < 0.01 if smooth else jumps > 1.0
    parabola = jb.motions.TabulatedSpeed(times, times**2, smooth=True)
    np.testing.assert_allclose(parabola.angular_speed(jnp.asarray(2.2)), 2.2**2)  # both neighbours


def test_spin_ups_end_with_the_right_speed_whatever_rounds():
    """Where t / T rounds to one, and t is larger than T by a bit."""
    for motion in (jb.SmoothSpinUp(2.0, 0.2), jb.motions.QuinticSpinUp(2.0, 0.2)):
        near = 0.2 * (1 + np.finfo(float).eps * np.arange(-8.0, 9.0) / 2)
        speed = jax.jit(jax.vmap(motion.angular_speed))(jnp.asarray(near))
        np.testing.assert_allclose(speed, 2.0, rtol=1e-12)


@pytest.mark.parametrize(
    ("build", "match"),
    [
        (lambda: jb.motions.TabulatedSpeed([0.0, 1.0, 0.5], [0, 1, 2]), "must increase"),
        (lambda: jb.motions.TabulatedSpeed([0.0, 1.0], [0, 1, 2]), "equally many"),
        (lambda: jb.motions.TabulatedSpeed([0.0], [1.0]), "two or more"),
        (lambda: jb.motions.TabulatedSpeed([0.0, np.nan], [1.0, 2.0]), "times must be finite"),
        (lambda: jb.motions.TabulatedSpeed([0.0, 1.0], [1.0, np.inf]), "speeds must be finite"),
        (lambda: step(jumps=[[1.0]]), "jumps must be a list"),
        (lambda: step(changes=np.nan), "changes must be"),
        (lambda: jb.Loads(jumps=[np.inf]), "jumps must be finite"),
        (lambda: jb.Loads(changes=["a"]), "changes must be real numbers"),
    ],
)
def test_bad_tables_and_times(build, match):
    with pytest.raises((TypeError, ValueError), match=match):
        build()


def test_what_cannot_be_watched_says_so():
    """The adjoint that integrates backwards bears no jumps."""
    with pytest.raises(ValueError, match="BacksolveAdjoint"):
        jb.simulate(
            HYBRID, jb.Rotor(BLADE), step(jumps=[1.0]), jnp.linspace(0.0, 2.0, 3),
            solver=diffrax.Kvaerno5(), adjoint=diffrax.BacksolveAdjoint(),
        )  # fmt: skip


@pytest.mark.exhaustive
def test_the_particle_is_struck_as_mechanics_says():
    """The hub of the discrete analogue stops dead: the particle keeps its momentum across."""
    times = jnp.array([0.0, 1.0, 1.0 + 1e-6])
    motion = turning(lambda t: jnp.where(t > 1.0, 0.0, 0.7), jumps=[1.0])
    for model in (jb.papers.DiscreteNC(), jb.papers.DiscreteNP()):
        start = jb.steady_start(model, SPRINGS, jb.ConstantSpeed(0.7))
        found = run(model, SPRINGS, motion, times, start=start)
        equations, y = model.equations(SPRINGS), found.state
        _, moving = jax.jvp(equations.tip, (y.q[2],), (y.v[2],))
        arm = equations.tip_radius + found.tip[0, 0]
        np.testing.assert_allclose(moving[1], 0.7 * arm, rtol=1e-4)
