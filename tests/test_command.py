"""`python -m jaxbeam`: the numbers are those of the package, mistakes are named in one line."""

import csv
import inspect
import itertools
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import plot
from jaxbeam.__main__ import EXAMPLES, main, read
from tests.beams import ALUMINIUM
from tests.rotor.files import CSV, DECK, SECTIONS

BEAM = """
[beam]
length = 8.0
youngs_modulus = 6.895e10
density = 2767.0
area = 7.299e-5
in_plane_second_moment = 8.214e-9
"""
HYBRID = '[model]\nname = "Hybrid"\nn_stretch = 2\nn_in_plane = 4\nn_flap = 0\n'
FREQUENCIES = f"""{HYBRID}{BEAM}
[rotor]
hub_radius = 0.5
tip_mass = 0.1
[frequencies]
in_plane = 2
[sweep]
angular_speed = {{from = 0.0, to = 10.0, count = 3}}
tip_mass = [0.0, -0.1]
"""
SPIN_UP = f"""
[model]
name = "GreenANCF"
n_elements = 2
{BEAM}
[rotor]
tip_mass = 0.1
[motion]
name = "SmoothSpinUp"
angular_speed = 4.0
duration = 15.0
[spin_up]
until = 20.0
points = 11
"""
SPRINGS = """
[model]
name = "DiscreteNC"
[rotor]
mass = 1.0
length = 1.0
hub_radius = 0.0
translational_spring = 1e4
torsional_spring = 10.0
[frequencies]
in_plane = 1
angular_speed = 2.0
"""
MODEL = jb.Hybrid(2, 4, 0)


@pytest.fixture
def command(tmp_path, capsys, monkeypatch):
    """Runs the command on a text; its exit status, what it printed, and what it complained of."""
    monkeypatch.chdir(tmp_path)

    def run(text, *options):
        (tmp_path / "scene.toml").write_text(text)
        code = main(["scene.toml", *options])
        return code, *capsys.readouterr()

    return run


def columns(path):
    """Of a CSV file, by name."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


@pytest.mark.slow
def test_frequencies_resumed_and_refused(command, tmp_path):
    code, said, _ = command(FREQUENCIES, "--out", "out", "--chunk", "4", "--cores", "2")
    assert code == 0
    assert said.splitlines() == [
        "6 cases over angular_speed, tip_mass",
        "3 of 6 ok",
        "3 INVALID_TIP_MASS: tip_mass must be finite and >= 0",
        "out/frequencies.csv, .npz and .png",
    ]
    table = jb.Table.load(tmp_path / "out/frequencies.npz")
    which = jb.labels(in_plane=2)
    found = columns(tmp_path / "out/frequencies.csv")
    np.testing.assert_array_equal(found["angular_speed"], [0, 0, 5, 5, 10, 10])
    for i in range(6):
        speed, tip_mass = found["angular_speed"][i], found["tip_mass"][i]
        frequency = [found[f"frequency[{label}]"][i] for label in which]
        if tip_mass < 0:
            assert found["status"][i] == jb.Status.INVALID_TIP_MASS
            assert np.isnan(frequency).all()
            continue
        alone = jb.modes(MODEL, jb.Rotor(ALUMINIUM, 0.5, tip_mass), speed, which)
        np.testing.assert_allclose(frequency, alone.frequency, rtol=1e-12)
        np.testing.assert_allclose(found["steady_strain"][i], alone.steady_strain, rtol=1e-12)
        kept = table.sel(angular_speed=speed, tip_mass=tip_mass)["frequency"]
        np.testing.assert_array_equal(kept, frequency)
    assert (tmp_path / "out/frequencies.png").read_bytes().startswith(b"\x89PNG")

    def written():
        return {file: file.stat().st_mtime_ns for file in (tmp_path / "out/chunks").iterdir()}

    assert json.loads((tmp_path / "out/chunks/sweep.json").read_text())["chunk"] == 4
    before = written()
    assert command(FREQUENCIES, "--out", "out", "--chunk", "4")[0] == 0
    assert written() == before  # read, not computed again
    code, _, complaint = command(
        FREQUENCIES.replace("length = 8.0", "length = 8.5"), "--out", "out", "--chunk", "4"
    )
    assert code == 2
    assert complaint.startswith("scene.toml: out/chunks belongs to another sweep")
    assert complaint.count("\n") == 1
    assert "name another folder, or remove this one" in complaint


def test_southwell_at_one_speed(command, tmp_path):
    text = FREQUENCIES.split("[frequencies]")[0]
    assert command(text + "[southwell]\nin_plane = 2\nangular_speed = 3.0")[0] == 0
    found = columns(tmp_path / "scene/southwell.csv")
    expected = jb.southwell(MODEL, jb.Rotor(ALUMINIUM, 0.5, 0.1), 3.0, jb.labels(in_plane=2))
    coefficient = [found[f"coefficient[in-plane bending {k}]"][0] for k in (1, 2)]
    np.testing.assert_allclose(coefficient, expected.coefficient, rtol=1e-12)


@pytest.mark.exhaustive
def test_histories_of_a_spin_up(command, tmp_path):
    code, said, _ = command(SPIN_UP)
    assert code == 0
    assert said.splitlines() == ["1 of 1 ok", "scene/spin_up.csv, .npz and .png"]
    times = np.linspace(0.0, 20.0, 11)
    motion = jb.SmoothSpinUp(4.0, 15.0)
    run = jb.simulate(jb.papers.GreenANCF(2), jb.Rotor(ALUMINIUM, 0.0, 0.1), motion, times)
    rows = columns(tmp_path / "scene/spin_up.csv")
    np.testing.assert_array_equal(rows["time"], times)
    for i, direction in enumerate(("axial", "in plane", "flap")):
        np.testing.assert_allclose(rows[f"tip[{direction}]"], run.tip[:, i], rtol=1e-12)
        np.testing.assert_allclose(rows[f"hub_torque[a{i + 1}]"], run.hub_torque[:, i], rtol=1e-12)
    np.testing.assert_allclose(rows["energy"], run.energy, rtol=1e-12)
    np.testing.assert_allclose(rows["imbalance"], run.imbalance, rtol=1e-12, atol=1e-15)
    table = jb.Table.load(tmp_path / "scene/spin_up.npz")
    peak = [table[name][1] for name in ("peak", "peak_time")]
    np.testing.assert_allclose(peak, run.peak(), rtol=1e-12)


@pytest.mark.exhaustive
def test_swept_spin_up(command, tmp_path):
    text = f"{HYBRID}{SPIN_UP.split('n_elements = 2')[1]}[sweep]\nangular_speed = [2, 4, inf]\n"
    code, said, _ = command(text, "--chunk", "3")
    assert code == 0
    assert "2 of 3 ok\n1 INVALID_MOTION: motion must be finite" in said
    rows = columns(tmp_path / "scene/spin_up.csv")
    ways = ("axial", "in plane", "flap")
    peaks = [f"{name}[{way}]" for name in ("peak", "peak_time") for way in ways]
    assert list(rows) == ["angular_speed", *peaks, "status"]
    times = jax.numpy.linspace(0.0, 20.0, 11)
    tips = jb.Table.load(tmp_path / "scene/spin_up.npz")
    for i, speed in enumerate((2.0, 4.0)):
        motion = jb.SmoothSpinUp(speed, 15.0)
        run = jb.simulate(MODEL, jb.Rotor(ALUMINIUM, 0.0, 0.1), motion, times)
        found = [rows[name][i] for name in ("peak[in plane]", "peak_time[in plane]")]
        np.testing.assert_allclose(found, run.peak(), rtol=1e-5)  # tolerance 1e-6, other rounding
        tip = tips.sel(angular_speed=speed)["tip"]
        np.testing.assert_allclose(tip, run.tip, atol=1e-6)
    assert np.isnan(rows["peak[in plane]"][2])


@pytest.mark.slow
def test_no_case_is_ok(command):
    code, said, _ = command(SPRINGS + "[sweep]\nmass = [-1, 0]")
    assert code == 1
    assert "0 of 2 ok\n2 INVALID_MASS: mass must be finite and > 0" in said


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_accepted(name, capsys):
    assert main(["--example", name]) == 0
    scene = read(tomllib.loads(capsys.readouterr().out))
    assert scene.question == name
    assert bool(scene.axes) == (name != "spin_up")


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_run(name, command):
    code, said, _ = command(EXAMPLES[name])
    assert code == 0
    assert "ok\n" in said


def test_further_scenes_are_accepted():
    with_loads = (
        SPIN_UP + "[loads]\ngravity = [0.0, -9.81, 0.0]\n[damping]\nmass_coefficient = 0.1\n"
    )
    scene = read(
        tomllib.loads(with_loads + "[sweep]\nmass_coefficient = [0.1, 0.2]\nlength = [8, 9]")
    )
    assert scene.axes == {"mass_coefficient": [0.1, 0.2], "length": [8.0, 9.0]}
    slender = (
        '[beam]\n[model]\nname = "ANCF"\n[southwell]\nin_plane = 1\n[sweep]\nslenderness = [70]'
    )
    assert read(tomllib.loads(slender)).axes == {"slenderness": [70.0]}
    assert read(tomllib.loads(SPRINGS)).axes == {"angular_speed": [2.0]}


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("[frequencies]", "[frequency]", "no table frequency: did you mean frequencies?"),
        ("[sweep]", "[southwell]\n[sweep]", "must ask one of [frequencies], [southwell], [spin_up],"
         " there is [frequencies] and [southwell]"),
        ("[model]", "omega = 1.0\n[model]", "there is no table omega: but model, beam"),
        ("[sweep]", "[[sweep]]", "sweep must be a table: [sweep], and its keys below"),
        ("[rotor]", "[motion]\nname='SmoothSpinUp'\n[rotor]", "[motion] has no use here"),
        ('"Hybrid"', '"Hybird"', "[model] needs a name, got 'Hybird': did you mean Hybrid?"),
        ('"Hybrid"', '"ExactRodANCF"', "[model] ExactRodANCF is jaxbeam.PlanarRod now"),
        ('name = "Hybrid"', "", "[model] needs a name, got None: there are"),
        ("youngs_modulus", "youngs_moduls", "[beam] has no youngs_moduls: did you mean "
         "youngs_modulus? Beam.from_section takes length,"),
        ("area = 7.299e-5", "", "[beam] lacks area: Beam.from_section takes length,"),
        ("length = 8.0", "length = '8.0'", "[beam] length must be a number, got '8.0'"),
        ("length = 8.0", "length = true", "[beam] length must be a number, got True"),
        ("length = 8.0", "length = [8.0]", "[beam] length must be a number, got [8.0]"),
        (BEAM, "[beam]\nfile = 3\n", "[beam] file must be a text in quotes, got 3"),
        ("length = 8.0", "length = -8.0", "[beam] length must be finite and > 0, got -8.0"),
        ("hub_radius = 0.5", "hub_radius = inf", "[rotor] hub_radius must be finite"),
        ("n_flap = 0", "n_flap = 1.5", "[model] n_flap must be an int, got float"),
        ("in_plane = 2\n", "in_plane = 2\nbasis = {}\n", "[frequencies] has no basis"),
        ("in_plane = 2\n", "in_plane = 2.0\n", "[frequencies] in_plane must be an int, got float"),
        ("in_plane = 2\n", "in_plane = 0\n", "[frequencies] asks for no mode"),
        ("in_plane = 2\n", "flap = 1\n", "there is no flap bending 1"),
        ("tip_mass = [0.0, -0.1]", "tip_mass = []", "[sweep] tip_mass must be a list of"),
        ("tip_mass = [0.0, -0.1]", "tip_mass = [0, 0]", "[sweep] tip_mass must not repeat values"),
        ("tip_mass = [0.0, -0.1]", "tip_mass = [0, true]", "[sweep] tip_mass must be a list"),
        ("tip_mass = [0.0, -0.1]", "tip_mass = 0.1", "[sweep] tip_mass must be a list of numbers"),
        ("tip_mass = [0.0, -0.1]", "tipmass = [0.0]", "[sweep] tipmass is not swept: did you mean "
         "tip_mass? numbers are length, youngs_modulus, density, area,"),
        ("tip_mass = [0.0, -0.1]", "n_flap = [0, 1]", "[sweep] n_flap is not swept: numbers are"),
        ("count = 3", "count = 1", "[sweep] angular_speed count must be >= 2, got 1"),
        ("count = 3", "count = 3.0", "[sweep] angular_speed count must be an int, got float"),
        ("to = 10.0", "to = inf", "[sweep] angular_speed must be a list of numbers or {from ="),
        ("to = 10.0", f"to = 1{400 * '0'}", "[sweep] angular_speed must be a list of numbers or"),
        ("count = 3", "steps = 3", "[sweep] angular_speed must be a list of numbers or {from ="),
        ("from = 0.0", "from = 'a'", "[sweep] angular_speed must be a list of numbers or {from ="),
        ("angular_speed = {", "# {", "[frequencies] lacks angular_speed: its keys are angular"),
        ("hub_radius = 0.5", "hub_radius", "(at line 15, column 11)"),
    ],
)  # fmt: skip
def test_mistakes(old, new, complaint, command):
    assert old in FREQUENCIES
    refused(command, FREQUENCIES.replace(old, new, 1), complaint)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('"SmoothSpinUp"', '"SmoothSpin"', "[motion] needs a name, got 'SmoothSpin': did you mean "
         "SmoothSpinUp? there are ConstantSpeed, ModulatedSpeed, QuinticSpinUp, SmoothSpinUp"),
        ("duration = 15.0", "", "[motion] lacks duration: its keys are angular_speed, duration"),
        ("duration = 15.0", "duration = 0", "[motion] duration must be finite and > 0, got 0.0"),
        ("duration = 15.0", "duration = 9\naxis = [0, 1]", "[motion] axis must have shape (3,)"),
        ("until = 20.0", "until = -1.0", "[spin_up] until must be finite and > 0, got -1.0"),
        ("points = 11", "points = 1", "[spin_up] points must be >= 2, got 1"),
        ("points = 11", "max_steps = 0", "[spin_up] max_steps must be >= 1, got 0"),
        ("points = 11", "angular_speed = 1", "[spin_up] has no angular_speed: its keys are until"),
        ("points = 11", "[damping]\nmass_coefficient = -1",
         "[damping] damping must be finite and >= 0"),
        ("points = 11", "[sweep]\nuntil = [1.0]", "[sweep] until is not swept"),
    ],
)  # fmt: skip
def test_mistakes_in_spin_ups(old, new, complaint, command):
    assert old in SPIN_UP
    refused(command, SPIN_UP.replace(old, new, 1), complaint)


def test_no_two_tables_have_a_number_of_one_name():
    """So that a sweep can name a number alone."""
    beam = _numbers_of(jb.Beam) | set(inspect.signature(jb.Beam.from_section).parameters)
    more = [_numbers_of(jb.Damping)]
    more += [set().union(*map(_numbers_of, jb.motions.Spin.__subclasses__()))]
    beam = [beam, *map(_numbers_of, (jb.Rotor, jb.RootSprings, jb.blades.Support, jb.TipBody))]
    for rotor in (beam, [_numbers_of(jb.papers.SpringRotor)]):
        for one, other in itertools.combinations([*rotor, *more], 2):
            assert not one & other


def _numbers_of(kind):
    return set(inspect.signature(kind).parameters)


def refused(command, text, complaint):
    code, _, complaints = command(text)
    assert code == 2
    assert complaint in complaints
    assert complaints.startswith("scene.toml: ")
    assert complaints.count("\n") == 1


def test_no_file_and_no_folder(command, capsys, tmp_path):
    assert main(["nowhere.toml"]) == 2
    assert "No such file or directory" in capsys.readouterr().err
    (tmp_path / "taken").write_text("")
    code, _, complaints = command(FREQUENCIES, "--out", "taken")
    assert code == 2
    assert complaints.startswith("scene.toml: cannot write to taken/chunks: Not a directory")
    with pytest.raises(SystemExit, match="2"):
        main([])


def test_figures_leave_out_what_is_not_there():
    def tip(a, b, c):
        peak = jax.numpy.stack([a + b, 0 * a, a * c])
        return {"peak": jax.numpy.where(b > 1, np.nan, peak)}

    cases = jb.grid(a=[0, 1, 2], b=[0, 1, 2], c=np.arange(5.0))
    table = jb.sweep(tip, cases, dims={"peak": {"direction": ["axial", "in plane", "flap"]}})
    figure = plot.swept(table, "peak", "peak (m)")
    assert [ax.get_title() for ax in figure.axes] == ["axial", "flap"]
    assert [len(ax.lines) for ax in figure.axes] == [8, 8]
    (legend,) = figure.legends
    assert legend.get_title().get_text() == "8 of 10 lines"
    assert legend.get_texts()[0].get_text() == "b 0, c 0"


@pytest.mark.slow
def test_help_in_a_process_of_its_own():
    done = subprocess.run(
        [sys.executable, "-m", "jaxbeam", "--help"], capture_output=True, text=True, check=True
    )
    assert EXAMPLES["frequencies"] in done.stdout
    assert EXAMPLES["spin_up"] in done.stdout


def test_a_blade_from_a_table(tmp_path, capsys, monkeypatch):
    """With a spring and a body, as in Python; what the table holds besides is named."""
    rows = [(0.0, 60, 9e6, 5e6), (0.3, 50, 8e6, 4e6), (0.3, 30, 4e6, 1e6), (1.0, 12, 4e5, 5e4)]
    head = "x_over_L,mass_per_length_kg_per_m,edge_stiffness_N_m2,flap_stiffness_N_m2,cg_m\n"
    table = head + "".join(",".join(map(str, (*row, 0.1))) + "\n" for row in rows)
    folder = tmp_path / "scenes"
    folder.mkdir()
    (folder / "blade.csv").write_text(table)
    (folder / "scene.toml").write_text(
        """
        [model]
        name = "Hybrid"
        n_stretch = 0
        [beam]
        file = "blade.csv"
        length = 10.0
        axial_stiffness = 1e9
        [rotor]
        hub_radius = 1.0
        [rotor.root_springs]
        flap = 4e6
        [rotor.tip_body]
        mass = 5.0
        offset = 0.1
        [frequencies]
        angular_speed = 0.0
        in_plane = 1
        flap = 2
        """
    )
    monkeypatch.chdir(tmp_path)
    assert main(["scenes/scene.toml", "--out", "found"]) == 0
    assert "cg_m" in capsys.readouterr().err
    columns = np.array(rows).T
    beam = jb.Beam(10.0, *(jb.Spanwise(columns[0], c) if np.ndim(c) else c for c in (
        columns[1], 1e9, columns[2], columns[3],
    )))  # fmt: skip
    rotor = jb.Rotor(
        beam, 1.0, root_springs=jb.RootSprings(flap=4e6), tip_body=jb.TipBody(5.0, 0.1)
    )
    model = jb.Hybrid(0)
    wanted = jb.modes(model, rotor, 0.0, jb.labels(in_plane=1, flap=2)).frequency
    found = jb.Table.load(tmp_path / "found" / "frequencies.npz")["frequency"].ravel()
    np.testing.assert_allclose(found, wanted, rtol=1e-10)


@pytest.mark.slow
def test_a_blade_of_full_sections_is_reduced_where_a_scene_says_so(tmp_path, monkeypatch):
    rotors = []
    monkeypatch.setattr(jb, "modes", lambda model, rotor, *_, **__: rotors.append(rotor))
    file = Path(__file__).parent / "data" / "sections" / "primary_beamdyn.inp"
    table = jb.blades.read_blade(file)
    with monkeypatch.context() as once:
        once.setattr(jb.blades, "read_blade", lambda *_, **__: table)
        beam = {"file": str(file), "reduced": True}
        tables = {
            "model": {"name": "Hybrid"}, "beam": beam,
            "frequencies": {"flap": 1, "angular_speed": 5.0},
        }  # fmt: skip
        with pytest.raises(AttributeError):  # of the modes that there are not
            read(tables).case(angular_speed=5.0)
    assert eqx.tree_equal(rotors[0].beam, table.beam.beam())
    (tmp_path / "blade.csv").write_text(CSV)
    beam |= {"file": str(tmp_path / "blade.csv"), "length": 9.0, "axial_stiffness": 1e9}
    with pytest.raises(ValueError, match=r"\[beam\] reduced is for files of full sections, which"):
        read(tables)


def test_a_main_file_of_bmodes_says_what_the_rotor_is(tmp_path, capsys, monkeypatch):
    """By what is in it, whatever it is called, and unless the scene says otherwise; the scene has a
    byte-order mark, as editors of Windows write. The deck's speed holds too, in the command's note,
    in its cases and for a motion, unless the scene has one."""
    (tmp_path / "sec.dat").write_text(SECTIONS)
    (tmp_path / "blade.txt").write_text(DECK.format(title="2 tip_mass options"))
    scene = """
        [model]
        name = "Hybrid"
        n_stretch = 0
        [beam]
        file = "blade.txt"
        [rotor]
        tip_mass = 20.0
        [frequencies]
        flap = 1
        """
    (tmp_path / "scene.toml").write_bytes(scene.encode("utf-8-sig"))
    monkeypatch.chdir(tmp_path)
    seen = []

    def modes(model, rotor, *_, **__):
        seen.append(rotor)
        raise ValueError("this is all that is asked")

    monkeypatch.setattr(jb, "modes", modes)
    main(["scene.toml"])
    said = capsys.readouterr().err
    assert "tw_iner is ignored" in said
    assert "angular_speed is 1.26711 rad/s, as the beam's file says" in said
    wanted = jb.blades.read_blade("blade.txt").rotor(tip_mass=20.0)
    assert (float(wanted.hub_radius), float(wanted.tip_mass)) == (1.5, 20.0)
    assert eqx.tree_equal(seen[0], wanted)
    stated = jb.blades.read_blade("blade.txt").angular_speed
    np.testing.assert_allclose(stated, 12.1 * np.pi / 30, rtol=1e-12)
    tables = tomllib.loads(scene)
    assert read(tables).axes == {"angular_speed": [stated]}
    assert "angular_speed" not in tables["frequencies"]
    more = tomllib.loads(scene + "[sweep]\ntip_mass = [0.0, 1.0]")
    assert read(more).case.args[1]["frequencies"]["angular_speed"] == stated
    tables["frequencies"]["angular_speed"] = 2.0
    assert read(tables).axes == {"angular_speed": [2.0]}
    del tables["frequencies"]
    tables |= {"motion": {"name": "SmoothSpinUp", "duration": 3.0}, "spin_up": {"until": 4.0}}
    assert read(tables).case.args[1]["motion"]["angular_speed"] == stated
    (tmp_path / "blade.txt").write_text(DECK.format(title="2").replace("12.1 rot", "0.0 rot"))
    assert read(tomllib.loads(scene)).axes == {"angular_speed": [0.0]}


@pytest.mark.slow
def test_springs_are_swept_also_under_the_name_of_a_count(tmp_path):
    """`flap` is a spring of the root, and how many modes a question asks for."""
    (tmp_path / "scene.toml").write_text(
        """
        [model]
        name = "Hybrid"
        n_stretch = 0
        n_in_plane = 3
        n_flap = 3
        [beam]
        length = 8.0
        mass_per_length = 0.2
        axial_stiffness = 5e6
        in_plane_bending_stiffness = 566.0
        flap_bending_stiffness = 400.0
        [rotor.root_springs]
        [frequencies]
        angular_speed = 5.0
        flap = 1
        [sweep]
        flap = [0.0, 100.0]
        """
    )
    assert main([str(tmp_path / "scene.toml"), "--out", str(tmp_path / "found")]) == 0
    found = jb.Table.load(tmp_path / "found" / "frequencies.npz")["frequency"].ravel()
    np.testing.assert_allclose(found[0], 5.0, rtol=1e-9)  # a free hinge in the axis
    assert found[1] > 5.1


def test_units_at_axes_are_those_of_the_parameters():
    """As the tables of the docstrings have them; of motions, whose angles are in rad."""
    units = dict.fromkeys(("angular_speed", "mean", "frequency"), "rad/s")
    for kind in (jb.Beam, jb.Rotor, jb.papers.SpringRotor, jb.Damping):
        for row in re.findall(r"^ *\| (\w+) +\|[^|]*\| (\S[^|]*?) *\|", kind.__doc__, re.MULTILINE):
            units[row[0]] = row[1].replace("^2", "²")
    del units["field"]
    assert units.items() <= plot.UNITS.items()
    assert len(units) > 12
