"""Scenes of `python -m jaxbeam`: every argument of the package's constructors is a key."""

import tomllib

import equinox as eqx
import jax
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam.__main__ import main
from jaxbeam._command.parts import TABLES, keys_of, part
from jaxbeam._command.scene import read
from jaxbeam._types import Real

SCENE = """
[model]
name = "SpatialRod"
degree = 2
[beam]
length = 7.6
mass_per_length = 9.0
axial_stiffness = 5e8
in_plane_bending_stiffness = {stations = [0.0, 0.5, 1.0], values = [4e5, 3e5, 1e5]}
flap_bending_stiffness = 3e5
torsional_stiffness = 1e5
[rotor]
hub_radius = 0.4
[rotor.root_springs]
flap = 2e5
[rotor.tip_body]
mass = 1.5
offset = 0.1
[loads]
gravity = [0.0, 0.0, -9.81]
tip_force = [1.0, 2.0, 3.0]
follows = true
force_per_length = [0.0, {stations = [0.0, 1.0], values = [0.0, 5.0]}, 1.0]
[damping]
stiffness_coefficient = 1e-3
[frequencies]
torsion = 1
flap = 2
"""
SPEED = "[frequencies]\nangular_speed_rpm = 30.0\n"


class Seen(Exception):
    """What a question was asked with."""


@pytest.fixture
def asked(monkeypatch):
    """Arguments of `modes` in the case that a scene is."""

    def modes(*args, **kwargs):
        raise Seen(args, kwargs)

    monkeypatch.setattr(jb, "modes", modes)

    def of(text, **numbers):
        scene = read(tomllib.loads(text))
        numbers = numbers or {name: values[0] for name, values in scene.axes.items()}
        with pytest.raises(Seen) as seen:
            scene.case(**numbers)
        return seen.value.args

    return of


def test_all_parts_of_a_scene_are_those_of_the_package(asked):
    (model, rotor, speed, which), more = asked(SCENE.replace("[frequencies]\n", SPEED))
    beam = jb.Beam(
        7.6, 9.0, 5e8, jb.Spanwise([0, 0.5, 1], [4e5, 3e5, 1e5]), 3e5, torsional_stiffness=1e5
    )
    wanted = jb.Rotor(
        beam, 0.4, root_springs=jb.RootSprings(flap=2e5), tip_body=jb.TipBody(1.5, 0.1)
    )
    loads = jb.Loads(
        [0, 0, -9.81], [1.0, 2.0, 3.0], follows=True,
        force_per_length=(0.0, jb.Spanwise([0, 1], [0.0, 5.0]), 1.0),
    )  # fmt: skip
    assert model == jb.SpatialRod(2)
    assert eqx.tree_equal(rotor, wanted)
    assert eqx.tree_equal(more["loads"], loads)
    assert eqx.tree_equal(more["damping"], jb.Damping(stiffness_coefficient=1e-3))
    assert which == jb.labels(flap=2, torsion=1)
    np.testing.assert_allclose(speed, np.pi, rtol=1e-14)


def test_speeds_are_swept_in_rpm(asked):
    sweep = "[sweep]\nangular_speed_rpm = {from = 0.0, to = 12.0, count = 3}\n"
    assert read(tomllib.loads(SCENE + sweep)).axes == {"angular_speed_rpm": [0.0, 6.0, 12.0]}
    (*_, speed, _), _ = asked(SCENE + sweep, angular_speed_rpm=12.0)
    np.testing.assert_allclose(speed, 0.4 * np.pi, rtol=1e-14)


def test_numbers_within_are_swept_by_name_and_by_path(asked):
    text = SCENE.replace("[frequencies]\n", SPEED)
    (_, rotor, *_), _ = asked(text + "[sweep]\nrotor.tip_body.mass = [2.5]\nflap = [7.0]\n")
    assert float(rotor.tip_mass) == 2.5
    assert float(rotor.root_springs.flap) == 7.0
    both = text + "[sweep]\nstiffness_coefficient = [0.1]\n"
    assert float(asked(both)[1]["damping"].stiffness_coefficient) == 0.1


def test_ratios_are_numbers_or_lists_and_are_swept(asked):
    given = "in_plane_ratio = [0.005]\nflap_ratio = [0.01, 0.02]\nratio_speed_rpm = 30.0\n"
    text = SCENE.replace("[frequencies]\n", SPEED).replace("SpatialRod", "Hybrid")
    text = text.replace("degree = 2", "n_flap = 2")
    text = text.replace("stiffness_coefficient = 1e-3\n", given + "flap_damper = 3.0\n")
    wanted = jb.Damping(
        in_plane_ratio=[0.005], flap_ratio=[0.01, 0.02], ratio_speed=jb.rpm(30.0), flap_damper=3.0
    )
    assert eqx.tree_equal(asked(text)[1]["damping"], wanted)
    swept = text.replace("in_plane_ratio = [0.005]\n", "") + "[sweep]\nin_plane_ratio = [0.1]\n"
    assert float(asked(swept)[1]["damping"].in_plane_ratio) == 0.1


def test_an_argument_that_a_class_gains_is_a_key():
    class Brake(eqx.Module):
        places: tuple
        drag: float

        def __init__(self, places: list[float], drag: Real) -> None:
            self.places, self.drag = tuple(places), drag

    class Toy(eqx.Module):
        first: float
        more: jb.RootSprings | None
        on: bool

        def __init__(
            self, first: Real, more: jb.RootSprings | None = None, on: bool = False
        ) -> None:
            self.first, self.more, self.on = first, more, on

    made = part("toy", [Toy], {"more": {"flap": 3.0}, "on": True}, ["first"])
    found = made.make({"first": 2.0, "toy.more.flap": 4.0})
    assert (found.first, found.on, float(found.more.flap)) == (2.0, True, 4.0)
    assert list(made.keys) == ["toy", "toy.more"]
    assert part("brake", [Brake], {"places": [0.1, 0.2], "drag": 1}, []).make({}).places == (
        0.1,
        0.2,
    )


@pytest.mark.parametrize(
    ("kind", "table"),
    [(jb.Beam, "beam"), (jb.Rotor, "rotor"), (jb.Loads, "loads"), (jb.Damping, "damping")],
)
def test_each_field_can_be_given(kind, table):
    """What a constructor takes is a number, a list, true or false, or a table of its own."""
    for name, parameter in keys_of(kind).items():
        if name in TABLES:
            continue
        fine = []
        for value in (1.0, [1.0], True, {}):
            try:
                part(table, [kind], {**_required(kind), name: value}, [])
            except ValueError as error:
                if "lacks" in str(error):
                    fine.append(value)
                continue
            fine.append(value)
        assert fine, (name, parameter)


def _required(kind):
    return {n: 1.0 for n, p in keys_of(kind).items() if p.default is p.empty}


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("[rotor.root_springs]", "[root_springs]", "there is no table root_springs, it is "
         "[rotor.root_springs]: but model, beam, rotor"),
        ("[rotor.tip_body]\nmass", "[rotor.tip_body]\nmas", "[rotor.tip_body] has no mas: did you "
         "mean mass? TipBody takes mass, offset, inertia"),
        ("mass = 1.5\n", "", "[rotor.tip_body] lacks mass: TipBody takes mass, offset"),
        ("flap = 2e5", "flap = -2e5", "[rotor.root_springs] springs at the root must be finite"),
        ("hub_radius = 0.4", "hub_radius = 0.4\nprecone = 'a'", "[rotor] precone must be a number"),
        ("[rotor.root_springs]\nflap = 2e5\n", "root_springs = 3\n", "[rotor] root_springs must be "
         "a table, [rotor.root_springs], got 3"),
        ("stations = [0.0, 0.5, 1.0]", "places = [0.0, 0.5, 1.0]",
         "[beam.in_plane_bending_stiffness] has no places"),
        ("follows = true", "follows = 1", "[loads] follows must be true or false, got 1"),
        ("tip_force = [1.0", "tip_force = ['a'", "[loads] tip_force must be a number, got 'a'"),
        ("tip_force = [1.0, 2.0", "tip_force = [2.0", "[loads] tip_force must have shape (3,)"),
        ("torsion = 1\nflap = 2\n", "", "asks for no mode: in_plane, flap, axial, torsion"),
        ("torsion = 1", "torsion = 1\nangular_speed_rpm = 1\nangular_speed = 2",
         "[frequencies] angular_speed is angular_speed_rpm again"),
        ("torsion = 1", "torsion = 1\nangular_speed_rpm = 'fast'",
         "[frequencies] angular_speed_rpm must be a number, got 'fast'"),
        ("hub_radius = 0.4", "hub_radius_rpm = 0.4", "[rotor] has no hub_radius_rpm: did you mean"),
        ("[frequencies]", "[sweep]\nangular_speed_rpm = [1]\nangular_speed = [2]\n[frequencies]",
         "[sweep] angular_speed is angular_speed_rpm again"),
        ("[frequencies]", "[sweep]\nhub_radius = [1.0]\nrotor.hub_radius = [2.0]\n[frequencies]\n"
         "angular_speed = 1.0", "[sweep] rotor.hub_radius is hub_radius again"),
        ('name = "SpatialRod"\ndegree = 2', 'name = "Hybrid"\nbasis = "Layered"',
         "[model] basis is made in scripts alone: leave it out"),
    ],
)  # fmt: skip
def test_mistakes(old, new, complaint):
    assert old in SCENE
    text = SCENE.replace(old, new, 1)
    if "angular_speed" not in text:
        text = text.replace("[frequencies]", "[frequencies]\nangular_speed = 0.0")
    with pytest.raises(ValueError) as caught:  # noqa: PT011
        read(tomllib.loads(text))
    assert complaint in str(caught.value)


def test_a_beam_of_a_file_has_what_its_reader_takes():
    beam = 'name = "Hybrid"\n[beam]\nfile = "blade.csv"\ntwist = 0.1\n'
    with pytest.raises(ValueError, match=r"\[beam\] has no twist: read_blade takes file, length"):
        read(tomllib.loads(f"[model]\n{beam}{SPEED}flap = 1"))


def test_a_name_that_two_tables_have_is_not_guessed(monkeypatch):
    class Damping(eqx.Module):
        flap: float

        def __init__(self, flap: Real | None = None) -> None:
            self.flap = flap

    monkeypatch.setattr(jb, "Damping", Damping)
    text = SCENE.replace("stiffness_coefficient = 1e-3", "flap = 0.1") + "[sweep]\n"
    text += "angular_speed = [1.0]\n"
    with pytest.raises(
        ValueError, match=r"\[sweep\] flap is several numbers: write rotor\.root_sp"
    ):
        read(tomllib.loads(text + "flap = [1.0]\n"))
    scene = read(tomllib.loads(text + "damping.flap = [0.2]\n"))
    assert list(scene.axes) == ["angular_speed", "damping.flap"]


@pytest.mark.exhaustive
def test_torsion_of_a_coned_blade_under_gravity(tmp_path):
    text = SCENE.split("[rotor]")[0].replace(
        "{stations = [0.0, 0.5, 1.0], values = [4e5, 3e5, 1e5]}", "4e5"
    )
    text += "[rotor]\nprecone = 0.03\nhub_radius = 0.4\n[damping]\nmass_coefficient = 0.2\n"
    text += "[loads]\ngravity = [0.0, 0.0, -9.81]\n[frequencies]\ntorsion = 1\nflap = 1\n"
    (tmp_path / "scene.toml").write_text(text + "[sweep]\nangular_speed_rpm = [0.0, 250.0]\n")
    assert main([str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 0
    table = jb.Table.load(tmp_path / "out/frequencies.npz")
    beam = jb.Beam(7.6, 9.0, 5e8, 4e5, 3e5, torsional_stiffness=1e5)
    alone = jb.modes(
        jb.SpatialRod(2), jb.Rotor(beam, 0.4, precone=0.03), jb.rpm(250.0),
        jb.labels(flap=1, torsion=1), loads=jb.Loads([0.0, 0.0, -9.81]), damping=jb.Damping(0.2),
    )  # fmt: skip
    at = table.sel(angular_speed_rpm=250.0)
    np.testing.assert_allclose(at["frequency"], alone.frequency, rtol=1e-10)
    np.testing.assert_allclose(at["frequency_hz"], alone.frequency / (2 * np.pi), rtol=1e-10)
    np.testing.assert_allclose(at["damping_ratio"], alone.damping_ratio, rtol=1e-6)
    # Torsion of a rod at rest, (pi / 2 L) (GJ / J)^(1/2), but for elements and Coriolis coupling.
    inertia = 9.0 * (4e5 + 3e5) / 5e8
    rod = np.pi / (2 * 7.6) * np.sqrt(1e5 / inertia)
    np.testing.assert_allclose(at["frequency"][1], rod, rtol=0.01)


def test_rpm():
    assert jb.rpm(30.0) == pytest.approx(np.pi, rel=1e-15)
    assert isinstance(jb.rpm(30), float)
    np.testing.assert_allclose(jb.rpm([0.0, 60.0]), [0.0, 2 * np.pi], rtol=1e-15)
    assert jb.rpm(np.arange(6).reshape(2, 3)).shape == (2, 3)
    np.testing.assert_allclose(jax.jit(jax.grad(jb.rpm))(3.0), np.pi / 30, rtol=1e-15)
    for wrong in ("12 rpm", True, 1j, None):
        with pytest.raises(TypeError, match="speed must be"):
            jb.rpm(wrong)
