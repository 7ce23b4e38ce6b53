"""The ladder in space: rods judge where the beam says how it twists, and answer alone where no
other theory bears what is asked."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb

TIMES = np.linspace(0.0, 4.0, 41)
UP = jb.SmoothSpinUp(0.5, 2.0)


def rotor(torsional_stiffness=0.8, **more):
    beam = jb.Beam(1.0, 1.0, 200.0**2, 1.0, 0.7, torsional_stiffness=torsional_stiffness)
    return jb.Rotor(beam, **more)


class Raised(eqx.Module):
    """A vector that rises smoothly from zero."""

    largest: jax.Array
    duration: float

    def __call__(self, t):
        share = jnp.clip(t / self.duration, 0.0, 1.0)
        return self.largest * share**3 * (10 - 15 * share + 6 * share**2)


def raised(largest, duration=2.0):
    return Raised(jnp.asarray(largest), duration)


def flap(motion=UP, **loads):
    """The largest deflection of the tip out of the plane."""
    return jb.ladder.PeakDeflection(motion, TIMES, 2, loads=jb.Loads(**loads))


def inclined(speed, angle=0.7, **loads):
    return flap(jb.SmoothSpinUp(speed, 2.0, jb.motions.inclined_axis(angle)), **loads)


def names(*asked):
    return [rung.name for rung in jb.ladder.rungs(*asked)]


MOMENT = flap(tip_moment=[0.0, 0.2, 0.0])
FOLLOWING = flap(tip_force=[0.0, 0.0, 0.2], follows=True)
TORSION = jb.ladder.ModalFrequencies(2.0, jb.labels(in_plane=1, torsion=1))
BENDING = jb.ladder.ModalFrequencies(2.0, jb.labels(in_plane=1, flap=1))


def test_rods_in_space_are_rungs_where_the_beam_says_how_it_twists():
    with_rods, without = names(rotor(), inclined(1.0)), names(rotor(None), inclined(1.0))
    assert with_rods[-1] == "rod of 1 element of degree 24 in space"
    assert "rod of 1 element of degree 2 in space" in with_rods
    assert not any("rod" in name for name in without)
    theirs = {name for name in with_rods if "rod" not in name}
    assert theirs == {name for name in without if not name.startswith("von Karman, 8")}


PLANAR = [
    jb.ladder.PeakDeflection(UP, TIMES),
    jb.ladder.RootStrain(UP, TIMES, loads=jb.Loads(tip_force=[0.0, 0.1, 0.0])),
    jb.ladder.ModalFrequencies(1.0, jb.labels(in_plane=2)),
]


@pytest.mark.parametrize("question", PLANAR)
def test_rungs_in_the_plane_do_not_ask_how_the_beam_twists(question):
    assert names(rotor(), question) == names(rotor(None), question)
    assert any(name == "64 elements" for name in names(rotor(), question))


ALONE = [
    (MOMENT, {}, "loads.tip_moment"),
    (FOLLOWING, {}, "loads.follows"),
    (jb.ladder.PeakDeflection(UP, TIMES), {"precone": 0.1}, "precone"),
    (BENDING, {"precone": 0.1, "pitch": 0.2}, "precone beside pitch"),
    (TORSION, {}, "torsion 1"),
]


@pytest.mark.parametrize(("question", "more", "needed"), ALONE, ids=[a[2] for a in ALONE])
def test_what_rods_in_space_alone_bear(question, more, needed):
    """They are all the rungs there are, and without them there is an error that names the cause."""
    assert all(isinstance(r.model, jb.SpatialRod) for r in jb.ladder.rungs(rotor(**more), question))
    refused = rotor(None, **more)
    for ask in (
        lambda: jb.ladder.rungs(refused, question),
        lambda: jb.choose_model(refused, question),
        lambda: jb.ladder_sweep(lambda **_: (refused, question), jb.points(speed=[1.0])),
    ):
        with pytest.raises(ValueError, match=f"{needed}.*give torsional_stiffness"):
            ask()


def test_frequencies_in_a_cone_have_hybrid_rungs_without_stretch():
    models = [rung.model for rung in jb.ladder.rungs(rotor(precone=0.1), BENDING)]
    assert {type(model) for model in models} == {jb.Hybrid, jb.SpatialRod}
    assert all(model.n_stretch == 0 for model in models if isinstance(model, jb.Hybrid))
    with pytest.raises(ValueError, match=r"^precone: .* give torsional_stiffness"):
        jb.ladder.rungs(rotor(None, precone=0.1), BENDING)


def blade(stations=2):
    """Tapered, twisted and swept, of full sections; with more than two stations stiffness and mass
    are uneven along it."""
    rng = np.random.default_rng(2)
    a, size = rng.normal(size=(6, 6)), np.sqrt([1e6, 2e5, 2e5, 3e2, 4e2, 6e2])
    stiffness = size[:, None] * (a @ a.T / 6 + 2 * np.eye(6)) * size
    mass = np.diag([1.2, 1.2, 1.2, 0.02, 0.008, 0.012])
    axis = [[0, 0, 0], [1, 0.02, 0], [2, 0.1, 0.05], [3, 0.3, 0.1]]
    along, uneven = np.linspace(0, 1, stations), 0.3 * (stations > 2)
    both = [
        ((1 - less * along) * np.exp(uneven * rng.normal(size=stations)))[:, None, None] * section
        for less, section in ((0.6, stiffness), (0.4, mass))
    ]
    return jb.blades.Blade(along.tolist(), *both, axis, twist=[0.3, 0.2, 0.1, 0])


def test_rods_alone_bear_blades_and_supports():
    """Of their frequencies and of their motion."""
    held = {"tip_support": jb.blades.Support(0.0, None, None, 0.0, 0.0, 0.0)}
    for asked in (jb.Rotor(blade(), 0.5), rotor(**held)):
        in_plane = jb.ladder.ModalFrequencies(1.0, jb.labels(in_plane=1))
        for question in (BENDING, in_plane, inclined(1.0), jb.ladder.RootStrain(UP, TIMES)):
            models = [rung.model for rung in jb.ladder.rungs(asked, question)]
            assert {type(model) for model in models} == {jb.SpatialRod}


@pytest.mark.exhaustive
def test_root_strain_of_a_bar_that_is_held_at_both_ends():
    """int N dx = 0 with N' = -rho W^2 (R + x): N(0) = rho W^2 (R L / 2 + L^2 / 6)."""
    asked = rotor(hub_radius=0.5, tip_support=jb.blades.Support())
    question = jb.ladder.RootStrain(jb.SmoothSpinUp(0.3, 30.0), np.linspace(0.0, 33.0, 12))
    found = truth(asked, question, 1e-4, 4)
    strain = 0.3**2 * (0.5 / 2 + 1 / 6) / 200.0**2
    np.testing.assert_allclose(found.value[-1], strain, rtol=1e-3)


def test_places_in_a_cone():
    """The axes of the hub are not those of the beam, for many points as for one."""
    coned = rotor(precone=0.3)
    model = jb.SpatialRod(2).suited(coned)
    equations = model.equations(coned)
    q = jnp.linspace(-0.1, 0.1, model.sizes[0])
    tip = equations.displacement(q, np.array([1.0]))[0]
    np.testing.assert_allclose(equations.displacement(q, np.array([0.5, 1.0]))[1], tip, atol=1e-15)
    np.testing.assert_allclose(equations.displacement(q, np.ones(1))[0], tip, atol=1e-15)


def truth(asked, question, size, degree):
    richest = jb.SpatialRod(degree).suited(asked)
    found = jb.ladder.evaluate(richest, asked, question, 1e-6, size)
    assert int(found.status) == 0
    return found


def honest(choice, asked, question, degree=16):
    """Met, and truly: the error is no larger than its estimate."""
    assert choice.met
    best = truth(asked, question, float(np.clip(choice.indicators.size, 1e-9, 1.0)), degree)
    off = np.max(np.abs(choice.answer - np.asarray(best.value)) / np.asarray(best.scale))
    assert off <= choice.estimate <= choice.tolerance


@pytest.mark.exhaustive
def test_small_deflections_need_no_rods():
    asked, question = rotor(), inclined(0.02, tip_force=raised([0.0, 0.0, 1e-3]))
    choice = jb.choose_model(asked, question, 1e-2)
    assert isinstance(choice.model, jb.Classical | jb.Hybrid)
    assert choice.estimate < 0.5 * choice.tolerance
    honest(choice, asked, question)


@pytest.mark.exhaustive
def test_large_deflections_are_for_rods():
    """About an inclined axis, under a load that follows."""
    asked, question = rotor(), inclined(0.7, tip_force=raised([0.0, 0.1, 0.3]), follows=True)
    choice = jb.choose_model(asked, question, 1e-3)
    assert isinstance(choice.model, jb.SpatialRod)
    assert choice.indicators.size > 0.1
    honest(choice, asked, question)


@pytest.mark.exhaustive
def test_without_torsional_stiffness_the_choice_says_what_it_would_take():
    choice = jb.choose_model(rotor(None), inclined(1.0), 1e-3, throw=False)
    assert not choice.met
    assert "torsional_stiffness would give rods in space" in str(choice).splitlines()[-2]


@pytest.mark.exhaustive
def test_a_moment_at_the_tip_bends_a_circle():
    """Raised slowly, M at the tip turns it by M L / EI."""
    asked = rotor()
    question = jb.ladder.PeakDeflection(
        jb.ConstantSpeed(0.0), 12 * TIMES, 2,
        loads=jb.Loads(tip_moment=raised([0.0, -0.28, 0.0], 40.0)),
    )  # fmt: skip
    choice = jb.choose_model(asked, question, 1e-3)
    turn = 0.28 / 0.7
    assert choice.met
    assert choice.answer[0] == pytest.approx((1 - np.cos(turn)) / turn, rel=2e-3)
    assert choice.rung.name.endswith("in space")


@pytest.mark.exhaustive
def test_motion_in_a_cone():
    """At the end of a slow spin-up the root strain is that of the tension along the beam."""
    asked = rotor(precone=0.2, hub_radius=0.5)
    question = jb.ladder.RootStrain(jb.SmoothSpinUp(0.3, 30.0), np.linspace(0.0, 33.0, 12))
    choice = jb.choose_model(asked, question, 2e-2)
    assert choice.met
    # Of the undeformed beam: int (R + x cos b) cos b dm, and the centrifugal force is radial.
    along = 0.3**2 * np.cos(0.2) * (0.5 + np.cos(0.2) / 2) / 200.0**2
    assert choice.answer[-1] == pytest.approx(along, rel=2e-2)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("question", "more", "tolerance"),
    [
        (BENDING, {"precone": 0.1, "hub_radius": 0.2}, 1e-3),
        (TORSION, {}, 1e-2),
    ],
    ids=["coned", "torsion"],
)
def test_frequencies(question, more, tolerance):
    asked = rotor(**more)
    honest(jb.choose_model(asked, question, tolerance), asked, question)


@pytest.mark.exhaustive
def test_torsion_of_a_turning_beam():
    """The propeller moment stiffens it: omega^2 = (pi / 2 L)^2 GJ / J + Omega^2 (J_3 - J_2) / J,
    where J is small, so that gyroscopic moments do not couple it with flap."""
    beam = jb.Beam(1.0, 1.0, 200.0**2, 1.0, 0.7, torsional_stiffness=3.2e-4, polar_inertia=2e-5)
    question = jb.ladder.ModalFrequencies(4.0, jb.labels(torsion=1))
    choice = jb.choose_model(jb.Rotor(beam), question, 1e-3)
    exact = np.sqrt((np.pi / 2) ** 2 * 16 + 16 * 0.3 / 1.7)
    assert choice.met
    assert abs(choice.answer[0] / exact - 1) <= choice.estimate <= 1e-3


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("stations", "loads"),
    [(2, {}), (2, {"tip_force": [0.0, 10.0, 20.0]}), (12, {})],
    ids=["alone", "loaded", "uneven"],
)
def test_frequencies_of_a_blade(stations, loads):
    """Of a rod of degree 24, which intrinsic equations of such a blade agree with to 1e-10."""
    asked = jb.Rotor(blade(stations), 0.5)
    question = jb.ladder.ModalFrequencies(
        6.0, jb.labels(in_plane=1, flap=2, torsion=1), loads=jb.Loads(**loads)
    )
    choice = jb.choose_model(asked, question, 1e-3)
    honest(choice, asked, question, 24)
    assert choice.model.degree <= 12


@pytest.mark.exhaustive
def test_a_sweep_of_a_blade():
    """Frequencies over speed, none farther off than its estimate."""
    cases, asked = jb.grid(speed=np.linspace(0.0, 8.0, 6)), jb.Rotor(blade(), 0.5)

    def situation(speed):
        return asked, jb.ladder.ModalFrequencies(speed, jb.labels(in_plane=1, flap=2))

    table = jb.ladder_sweep(situation, cases, 1e-3, representatives=2)
    assert np.all(table["status"] == jb.Status.OK)
    exact = [truth(*situation(speed), 1e-2, 24).value for speed in table.coords["speed"]]
    off = np.max(np.abs(table["value"] / np.stack(exact) - 1), -1)
    assert np.all(off <= table["estimate"])


def pushed(speed, load, angle):
    """A spin-up about an inclined axis under a load in flap."""
    motion = jb.SmoothSpinUp(speed, 2.0, jb.motions.inclined_axis(angle))
    force = raised(jnp.stack([0 * load, 0 * load, load]))
    return rotor(), jb.ladder.PeakDeflection(motion, TIMES, 2, loads=jb.Loads(tip_force=force))


@pytest.mark.exhaustive
def test_sweep_in_space():
    """Small ones on linear rungs, large ones on rods, all as honest as they say."""
    rng = np.random.default_rng(3)
    n, tolerance = 8, 2e-3
    columns = {
        "speed": rng.uniform(0.1, 1.0, n),
        "load": np.geomspace(1e-3, 1.0, n),
        "angle": rng.uniform(0.3, 1.5, n),
    }
    columns["speed"][:3] *= 0.05
    table = jb.ladder_sweep(pushed, jb.points(**columns), tolerance, representatives=4, chunk=4)

    def best(speed, load, angle):
        asked, question = pushed(speed, load, angle)
        found = question.answer(jb.SpatialRod(12), asked, jnp.asarray(1e-6), jnp.asarray(1e-2))
        return {"value": found.value[0], "status": found.status}

    exact = jb.sweep(best, jb.points(**columns), chunk=4, progress=False)
    assert (exact["status"] == 0).all()
    error = np.abs(table["partial"][:, 0] / exact["value"] - 1)
    assert (error <= table["estimate"]).all()
    assert (table["status"] == 0).mean() > 0.9
    assert (error[table["status"] == 0] <= tolerance).all()
    assert table["rung"][-1].startswith("rod")
    assert table["rung"][0].startswith("hybrid")
