"""Studies run through, write where they are told, and print numbers that the tests stand behind."""

import csv
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.helpers import run_optimised
from tests.tiers import exhaustive, slow
from tests.vibration import blade_reference

STUDIES = Path(__file__).parents[1] / "studies"
HASTY = 1  # level of optimisation of studies, most of whose time is compilation


def study(name, out):
    """What the study prints, made quick."""
    script = STUDIES / f"{name}.py"
    return run_optimised(script, "--quick", "--out", out, level=HASTY)


def rows_of(path):
    with open(path) as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("quick", [slow(["--quick"], id="quick"), exhaustive([], id="in full")])
def test_rotating_cantilever(quick, tmp_path):
    """The main command of the README, in another folder: files, printed numbers, and in full what
    it says of artefacts (physics of the tables)."""
    out, script = tmp_path / "made", STUDIES / "rotating_cantilever.py"
    said = run_optimised(script, *quick, "--out", out, level=HASTY, cwd=tmp_path)
    assert set(tmp_path.iterdir()) == {out}
    assert str(out) in said
    for name in ("campbell", "mode_shapes", "southwell_lines", "southwell_map"):
        assert (out / f"{name}.png").stat().st_size > 20_000
    for name in ("table_2", "tables_3_4_5", "resonances", "southwell", "southwell_map"):
        assert len((out / f"{name}.csv").read_text().splitlines()) > 5
    rows = rows_of(out / "tables_3_4_5.csv")
    gap = [abs(float(row["printed"]) - float(row["ten elements"])) for row in rows]
    assert len(gap) == 720
    assert sorted(gap)[-2] < 6e-4  # all but the partner of the veering pair
    assert "gamma = 3.8774421952" in said
    assert "entries with an axial mode below the printed bending mode: 127" in said
    southwell = np.genfromtxt(out / "southwell.csv", delimiter=",", names=True)
    np.testing.assert_allclose(southwell["phi_1"][0], 0.1933, atol=1e-3)
    if not quick:
        assert "ten elements 10.278, 40 elements 10.040" in said
        assert "inextensible 10.447" in said
        causes = np.genfromtxt(out / "causes.csv", delimiter=",", skip_header=1)
        at_low, at_high = causes[causes[:, 0] == 1], causes[causes[:, 0] == 50]
        assert (at_low[:, 2:5] < 0.05).all()  # there the tables are the physics, to 0.05 %
        assert (at_high[0, 2:5] > 20).all()  # each cause moves some first mode by over 20 %


def test_every_study_has_a_main():
    paths = set(STUDIES.glob("*.py")) - {STUDIES / "common.py"}
    assert len(paths) == 21
    for path in paths:
        text = path.read_text()
        assert "def main(quick: bool" in text
        assert "    common.run(main, __doc__, " in text  # which knows --quick and --out


@pytest.mark.exhaustive
def test_yoo1995(tmp_path):
    """Every figure, a table of peaks, and what Y says of its models."""
    study("yoo1995", tmp_path)
    for number in (4, 6, 8, 9, 12, 13, 14):
        assert (tmp_path / f"figure_{number}.png").stat().st_size > 10_000
    with open(tmp_path / "peaks.csv") as file:
        rows = {
            (r["figure"], r["case"], r["model"], r["component"]): r for r in csv.DictReader(file)
        }
    assert rows["6", "", "C.L.C.", "u2"]["status"] == "DIVERGED"
    assert rows["6", "", "present (hybrid)", "u2"]["status"] == "OK"
    assert rows["12-14", "20 rad/s", "LC", "y"]["status"] == "DIVERGED"
    present, exact = (float(rows["4", "", m, "u2"]["peak_m"]) for m in ("present (hybrid)", "ANCF"))
    assert 1.15 < present / exact < 1.3
    assert float(rows["4", "", "present (hybrid)", "u1"]["peak_m"]) < -5


@pytest.mark.exhaustive
def test_space(tmp_path):
    """What other programs computed and what was measured, and lateral buckling."""
    printed = study("space", tmp_path)
    for name in ("princeton", "buckling", "inclined", "filmstrip"):
        assert (tmp_path / f"{name}.png").stat().st_size > 20_000
    rows = rows_of(tmp_path / "princeton.csv")
    assert len(rows) == 49
    for row in rows:
        ours, theirs = ((float(row[k + e]) for k in ("flap", "chord")) for e in ("_ours_m", "_m"))
        apart = np.hypot(*(a - b for a, b in zip(ours, theirs, strict=True)))
        size = max(float(row["flap_ours_m"]), float(row["chord_ours_m"]))
        assert apart < {"mbdyn": 2e-3, "ansys_solid": 4e-2}.get(row["source"], 5e-3) * size
    assert "56.33 / 57." in printed  # measured, and ours, in mm
    assert abs(float(rows_of(tmp_path / "buckling.csv")[0]["critical_load"]) / 4.0126 - 1) < 0.02


@pytest.mark.exhaustive
def test_spin_up_film(tmp_path):
    study("spin_up_film", tmp_path)
    assert any(path.suffix == ".gif" for path in tmp_path.iterdir())
    assert any(path.suffix == ".png" for path in tmp_path.iterdir())


@pytest.mark.exhaustive
def test_berzeri1999(tmp_path):
    """Every figure, and the statements of B on Model 0 and Model A."""
    study("berzeri1999", tmp_path)
    for name in ("figures_2_3", "figures_4_5", "figures_6_7", "figure_10"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    with open(tmp_path / "peaks.csv") as file:
        rows = {(row["figure"], row["model"]): row for row in csv.DictReader(file)}
    for figure in ("4", "5"):
        assert float(rows[figure, "Model A, 2 elements"]["from_reference_percent"]) < 0.5
    assert rows["6", "Model 0, chord, 1 element"]["status"] == "DIVERGED"
    assert rows["7", "Model 0, chord, 2 elements"]["status"] != "OK"
    assert rows["7", "Model A, 2 elements"]["status"] == "OK"


@pytest.mark.exhaustive
def test_speed_accuracy(tmp_path):
    """Every scene has a front, failures are kept, and errors are what theory says."""
    printed = study("speed_accuracy", tmp_path)
    assert printed.count("the front alone") == 3
    for name in ("speed_accuracy", "speed_accuracy_frequencies"):
        assert (tmp_path / f"{name}.png").stat().st_size > 20_000
    rows = rows_of(tmp_path / "speed_accuracy.csv")
    error = {(r["scene"], r["model"], r["integrator"], r["setting"]): r for r in rows}
    scenes = {r["scene"] for r in rows}
    assert len(scenes) == 3
    for scene in scenes:
        ours = [r for r in rows if r["scene"] == scene and r["model"] == "hybrid, 16 + 8 functions"]
        if ours:
            assert {r["integrator"] for r in ours} == {"modes"}
            assert all(float(r["error"]) < 1e-9 for r in ours)
    for setting, least in (("0.0001", 1e-3), ("1e-06", 3e-4)):  # what eight elements leave
        row = error["B Ref. 21, 4 rad/s", "exact, 8 elements", "Rodas5P", setting]
        assert 1e-5 < float(row["error"]) < least
    abrupt = [r for r in rows if r["scene"].startswith("abrupt")]
    assert any(r["status"] != "OK" for r in abrupt)
    assert all(float(r["error"]) == np.inf for r in rows if r["status"] != "OK")
    linear = [float(r["error"]) for r in abrupt if r["model"].startswith("hybrid")]
    assert min(linear) > 0.15  # it moves three quarters of its length


@pytest.mark.exhaustive
def test_peers(tmp_path):
    """Other integrators and other codes find the same motion."""
    printed = study("peers", tmp_path)
    rows = {(r["method"], r["setting"]): float(r["error"]) for r in rows_of(tmp_path / "peers.csv")}
    assert rows["jaxbeam Rodas5P", "1e-05"] < 1e-5
    assert rows["SciPy Radau", "1e-05"] < 1e-5
    assert rows["diffrax KenCarp4", "1e-06"] < 1e-5
    assert rows["diffrax Dopri8", "1e-08"] < 1e-8
    assert rows["jaxbeam Magnus", "0.15 s"] < 1e-8
    assert rows["jaxbeam in lanes, one thread", "rtol 3e-4"] < 1e-4
    assert rows["jaxbeam modes, 16 + 8 polynomials, 1 thread", "2000 cases"] < 1e-8
    for name in ("jaxlib", "diffrax", "scipy", "exudyn", "pybmodes"):
        assert name in printed.splitlines()[0]
    assert "times as fast as SciPy Radau" in printed
    assert "times as fast as diffrax KenCarp4" in printed
    assert "times as fast as scipy.linalg.eig" in printed


@pytest.mark.exhaustive
def test_costs(tmp_path):
    study("costs", tmp_path)
    rows = rows_of(tmp_path / "costs.csv")
    assert all(np.isfinite(float(r["number"])) and float(r["number"]) > 0 for r in rows)
    assert {r["what"] for r in rows} >= {
        "reverse mode over forward run", "a step of Rodas5P, in space", "the next, with a cache",
    }  # fmt: skip
    assert (tmp_path / "elements.png").stat().st_size > 10_000


@pytest.mark.exhaustive
def test_stability(tmp_path):
    """Motions in time stay bounded for 200 periods 1 % below a critical speed, and grow 1 % above;
    over the maps they do what it says."""
    printed = study("stability", tmp_path)
    for name in ("stability_maps", "tongues"):
        assert (tmp_path / f"{name}.png").stat().st_size > 20_000
    rows = {r["model"]: r for r in rows_of(tmp_path / "critical_speeds.csv")}
    failing = [r for r in rows.values() if r["periods"] == "200"]
    assert {r["model"] for r in failing} >= {"C.L.C.", "LC", "hybrid", "Model 0, chord, 1"}
    for row in failing:
        assert float(row["growth_0.99"]) < 30
        assert float(row["growth_1.01"]) > 1000
    assert rows["Model A, 2 elements"]["what_gives_way"] == "nothing"
    assert rows["hybrid"]["what_gives_way"] == "the rod tears"
    done, total = (int(n) for n in re.search(r"maps: (\d+) of (\d+)", printed).groups())
    assert done >= 0.95 * total
    for row in rows_of(tmp_path / "tongues.csv"):
        if row["status"] == "OK":
            assert float(row["low_rad_s"]) < float(row["high_rad_s"])


@pytest.mark.exhaustive
def test_integrator_stability(tmp_path):
    """Theory and trial agree, and every wrong result is caught."""
    printed = study("integrator_stability", tmp_path)
    for name in ("amplification", "loose_tolerance"):
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    for row in rows_of(tmp_path / "stable_steps.csv"):
        theory, observed = float(row["theory"]), float(row["observed"])
        assert np.isinf(theory) or abs(observed / theory - 1) < 0.01
    runs = rows_of(tmp_path / "loose_tolerance.csv")
    wrong = [r for r in runs if not float(r["error"]) <= 0.05]
    assert len(wrong) >= 3
    assert all(r["status"] != "OK" for r in wrong)
    assert "of these not caught: 0" in printed


@pytest.mark.exhaustive
def test_validity(tmp_path):
    """Rayleigh gives the classical error; the hybrid one is quadratic, small strain linear."""
    study("validity", tmp_path)
    assert (tmp_path / "validity.png").stat().st_size > 20_000

    def table(name):
        rows = rows_of(tmp_path / f"{name}.csv")
        return {key: np.array([float(r[key]) for r in rows]) for key in rows[0]}

    c = table("classical_frequency")
    below = c["fraction"] < 1  # of the first rest frequency
    assert (c["growth_rate"][below] == 0).all()
    assert (c["growth_rate"][~below] > 0).all()
    ratio, error, x = (c[key][below] for key in ("ratio", "error", "fraction"))
    np.testing.assert_allclose(error, 1 - (1 + ratio / (1 - x**2)) ** -0.5, atol=0.01)
    small = ratio < 0.02
    np.testing.assert_allclose(error[small], ratio[small] / 2, rtol=0.03)
    d = table("deflection")
    w, e = d["deflection_over_length"], d["hybrid_error"]
    small = w < 0.25
    slope = np.polyfit(np.log(w[small]), np.log(e[small]), 1)[0]
    assert 1.85 < slope < 2.15
    assert ((e / w**2 > 0.2) & (e / w**2 < 0.6))[small].all()
    s = table("strain")
    small = s["strain"] < 0.05
    for name in ("small strain", "hybrid"):
        for mode in (1, 2):
            assert (np.abs(s[f"{name}_error_{mode}"]) < 0.95 * s["strain"])[small].all()
    plain = small & (s["hub"] == 0) & (s["tip"] == 0)
    slope = np.polyfit(np.log(s["strain"][plain]), np.log(s["small strain_error_1"][plain]), 1)[0]
    assert 0.9 < slope < 1.1


@pytest.mark.exhaustive
def test_ladder(tmp_path):
    """What is chosen is within the tolerance, or says that it is not."""
    printed = study("ladder", tmp_path)
    assert (tmp_path / "ladder.png").stat().st_size > 20_000
    rows = rows_of(tmp_path / "choices.csv")
    assert len(rows) == 2 * 40
    for tolerance in ("0.01", "0.001"):
        own = [r for r in rows if r["tolerance"] == tolerance]
        error = np.array([float(r["error"]) for r in own]) / float(tolerance)
        assert np.mean(error <= 1) >= 0.95
        assert all(e <= 10 or r["met"] == "False" for e, r in zip(error, own, strict=True))
        assert np.mean([int(r["above"]) <= 1 for r in own]) >= 0.9
    sweep = rows_of(tmp_path / "sweep.csv")
    assert len(sweep) == 64
    assert {r["rung"].split(",")[0].split()[-1] for r in sweep} >= {"hybrid", "elements"}
    assert "error above estimate: 0" in printed


@pytest.mark.exhaustive
def test_fit_experiment(tmp_path):
    """Measured frequencies that a fit has not seen, and a stiffness that differs from mode to mode
    where the theory of beams ends."""
    printed = study("fit_experiment", tmp_path)
    part = printed.split("EI, clamp by all but it at speed")[1].split("All modes")[0]
    errors = [float(x) for x in re.findall(r"([+-][\d.]+)%", part)]
    assert len(errors) == 4
    assert max(map(abs, errors)) < 5
    rows = rows_of(tmp_path / "left_out.csv")
    assert len(rows) == 32
    assert max(abs(float(r["relative_error"])) for r in rows) < 0.1
    found = re.findall(r"mode \d: ([\d.]+) to ([\d.]+)", printed)
    (_, _), (low2, _), (low3, high3), (_, high4) = [tuple(map(float, pair)) for pair in found]
    assert low2 > high3
    assert low3 > high4
    # A spring at the root explains none of it.
    assert "without spring over that with it: 1.000" in printed
    limits = re.findall(r"Softest spring by 95 %, .* fitted: (\d+) N m/rad", printed)
    np.testing.assert_allclose([float(k) for k in limits], [440, 212], rtol=0.05)
    springs = rows_of(tmp_path / "springs.csv")
    ratios = [float(r["sum_of_squares_over_that_of_rigid_root"]) for r in springs]
    assert len(ratios) == 14
    assert min(ratios) > 1
    found = re.findall(r"flap (\d): ([\d.]+) to ([\d.]+)", printed)
    lows, highs = np.array([[float(x) for x in row[1:]] for row in found]).T
    assert (lows[1:3] > highs[2:]).sum() >= 1
    assert lows[1] > highs[3]
    assert "times as long as one" in printed


@pytest.mark.slow
def test_validation(tmp_path):
    """Theory agrees as printed; a misprint and measured blades are shown as what they are."""
    printed = study("validation", tmp_path)
    assert (tmp_path / "validation.png").stat().st_size > 20_000
    rows = rows_of(tmp_path / "validation.csv")
    theory = [r for r in rows if r["source"] != "Epps"]
    assert len(theory) == 39 + 26 + 75 + 5 + 3 + 3 + 8 + 9
    good = [r for r in theory if r["verdict"] in ("as printed", "last digit")]
    assert [r["published"] for r in theory if r not in good] == ["38.4920"]
    assert sum(r["verdict"] == "as printed" for r in theory) >= 160
    assert all(abs(float(r["relative_difference"])) < 5e-4 for r in good)
    measured = [abs(float(r["relative_difference"])) for r in rows if r["source"] == "Epps"]
    assert len(measured) == 25
    assert 0.05 < max(measured) < 0.12
    assert "off" in printed


@pytest.mark.exhaustive
def test_detune(tmp_path):
    study("detune", tmp_path)
    before, after = rows_of(tmp_path / "detune.csv")
    assert float(before["margin"]) == 0.0
    assert float(after["margin"]) >= 0.05


@pytest.mark.exhaustive
def test_blade(tmp_path):
    """Frequencies are those of another method, pyBModes is as far off as it must be, and stiffness
    and mass times the same factor change nothing."""
    printed = study("blade", tmp_path)
    for name in ("campbell", "mode_shapes", "sensitivities", "sweep"):
        assert (tmp_path / f"{name}.png").stat().st_size > 20_000
    rows = rows_of(tmp_path / "frequencies.csv")
    names = ("flap 1", "edge 1", "flap 2", "edge 2", "flap 3")
    for rpm in (0.0, 12.1):
        own = [r for r in rows if r["twist"] == "True" and float(r["rpm"]) == rpm]
        assert tuple(r["mode"] for r in own) == names
        exact = hertz(blade_reference.nrel5mw(), rpm, 5)
        for column, tolerance in (("converged", 1e-7), ("functions_14", 2e-5), ("pybmodes", 1e-4)):
            found = [float(r[f"{column}_Hz"]) for r in own]
            if column != "pybmodes" or "pyBModes is not installed" not in printed:
                np.testing.assert_allclose(found, exact, rtol=tolerance)
    # Between harmonics and frequencies there is what the reference has there.
    for r in rows_of(tmp_path / "resonances.csv"):
        exact = hertz(blade_reference.nrel5mw(), float(r["rpm"]), 5)[names.index(r["mode"])]
        np.testing.assert_allclose(exact, float(r["harmonic"]) * float(r["rpm"]) / 60, rtol=1e-4)
    # omega^2 = omega_0^2 + phi Omega^2 to first order in Omega^2
    slow = np.square(hertz(blade_reference.nrel5mw(), 1.0, 5))
    phi = (slow - np.square(hertz(blade_reference.nrel5mw(), 0.0, 5))) * 3600
    found = [float(r["at_rest"]) for r in rows_of(tmp_path / "southwell.csv")]
    np.testing.assert_allclose(found, phi, rtol=3e-3)
    rows = rows_of(tmp_path / "sensitivities.csv")
    for name in names:
        change = {
            key: sum(float(r["of_the_station"]) for r in rows if (r["mode"], r["property"]) == key)
            for key in ((name, p) for p in {r["property"] for r in rows})
        }
        assert len(change) == 3
        assert abs(sum(change.values())) < 1e-9
        assert change[name, "mass_per_length"] < -0.4


def hertz(of, rpm, count):
    return np.array(blade_reference.frequencies(of, rpm * np.pi / 30, count)) / (2 * np.pi)


@pytest.mark.exhaustive
def test_tune_blade(tmp_path):
    """The tuned blade keeps its margin by another method, with hardly more mass than must be."""
    study("tune_blade", tmp_path)
    assert (tmp_path / "tune_blade.png").stat().st_size > 20_000
    before, after = rows_of(tmp_path / "verified.csv")
    assert float(before["clearance"]) < -0.01
    assert float(after["clearance"]) > 0.03
    design = rows_of(tmp_path / "design.csv")
    x, own, added = (
        np.array([float(r[key]) for r in design])
        for key in ("x_over_L", "mass_kg_per_m", "added_kg_per_m")
    )
    assert (added >= 0).all()
    assert (added < 0.2 * own * (1 + 1e-9)).all()
    assert 61.5 * np.trapezoid(added, x) == pytest.approx(float(after["added_kg"]), rel=1e-9)
    blade = blade_reference.nrel5mw()
    for mass, least in ((own, -np.inf), (own + added, 0.03)):
        found = np.array(
            [hertz(replace(blade, mass=(x, mass)), rpm, 3) for rpm in (11.0, 11.55, 12.1)]
        )
        harmonics = np.array([11.0, 11.55, 12.1])[:, None] * np.arange(1, 7) / 60
        away = (found[:, :, None] / harmonics[:, None] - 1).transpose(1, 2, 0)
        crossed = (away.min(2) < 0) & (away.max(2) > 0)
        assert crossed.sum() == (0 if least > 0 else 2)  # flap 1 with 4P, edge 1 with 6P
        if least > 0:
            assert np.abs(away).min() > least
    trade = rows_of(tmp_path / "trade_off.csv")
    kg = {(float(r["margin"]), r["way"]): float(r["added_kg"]) for r in trade}
    for margin in (0.01, 0.03):  # the less is allowed at a place, the more it takes
        ways = ("one mass at the tip", "up to 50 % more", "up to 20 % more", "up to 10 % more")
        assert sorted(kg[margin, way] for way in ways) == [kg[margin, way] for way in ways]
    shown = next(r for r in trade if (float(r["margin"]), r["way"]) == (0.03, "up to 20 % more"))
    assert 0 < float(shown["added_kg"]) - float(shown["least_of_linearised_kg"]) < 1.0


@pytest.mark.exhaustive
def test_quiet_spin_up(tmp_path):
    """The robust optimum is an order of magnitude quieter in the worst case than all others, on
    elements too, and not below what is least."""
    study("quiet_spin_up", tmp_path)
    assert (tmp_path / "quiet_spin_up.png").stat().st_size > 20_000
    rows = {r["shape"]: r for r in rows_of(tmp_path / "quiet_spin_up.csv")}
    worst = {name: float(r["worst"]) for name, r in rows.items()}
    robust, nominal = worst["robust optimum"], rows["nominal optimum"]
    for name in ("smooth, Y eq. 23", "quintic, Y eq. 21", "ZV shaper", "ZVD shaper"):
        assert worst[name] > 10 * robust
        assert float(rows[name]["worst_of_elements"]) > 8 * float(
            rows["robust optimum"]["worst_of_elements"]
        )
    assert worst["ZVD shaper"] < worst["ZV shaper"]
    # What was found for one rotor is best for it, and no good for the others.
    assert float(nominal["nominal"]) < 0.3 * float(rows["robust optimum"]["nominal"])
    assert float(nominal["worst"]) > 10 * robust
    least = {name: bound for name, bound in worst.items() if name.startswith("least")}
    assert len(least) == 3
    assert 0 < least["least, to first order about the optimum"] < robust
    assert 0 < least["least, stiffness as at full speed"] < least["least, stiffness as at rest"]


@pytest.mark.exhaustive
def test_ensembles(tmp_path):
    """A line for each comparison; the operations are those of a step."""
    said = study("ensembles", tmp_path)
    rows = {row["what"]: row for row in rows_of(tmp_path / "ensembles.csv")}
    for what in ("spin-ups, one jax.vmap", "spin-ups, sweep", "mixed batch", "modes, 10 elements"):
        assert float(rows[what]["seconds"]) > 0
        assert float(rows[what]["ratio"]) > 0
    assert 5e4 < int(rows["operations of a step a second"]["cases"]) < 5e5
    assert "Gflop/s a core" in said


@pytest.mark.exhaustive
def test_scale(tmp_path):
    """Sweeps come to the same bits on one core, on two, by two workers, and in a folder."""
    printed = study("scale", tmp_path)
    assert re.search(r"^(\d) of \1 sweeps have the same bits", printed, re.MULTILINE)
    with open(tmp_path / "scale.csv") as file:
        rows = list(csv.DictReader(file))
    assert {row["workers"] for row in rows} == {"0", "1", str(len(os.sched_getaffinity(0)))}
    assert all(float(row["ok"]) > 0.99 and float(row["memory"]) < 2048 for row in rows)
    assert (tmp_path / "scale.png").stat().st_size > 20_000


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("name", "made", "told"),
    [
        ("campbell", ["campbell.png"], "in-plane bending 1 meets 1 per turn at 3.0427"),
        ("sweep", ["frequencies.csv"], "39 of 195 cases failed; the first says: tip_mass must be"),
        ("spin_ups", [], "  4.0   -0.6759"),
        ("fit", [], "misfit"),
        ("critical_speeds", ["critical_speeds.csv", "critical_speeds.png"], "slowest: 16.1531"),
    ],
)
def test_templates(name, made, told, tmp_path):
    """Scripts to be copied are short, and run where they are."""
    script = STUDIES / "short" / f"{name}.py"
    assert len(script.read_text().splitlines()) <= 40
    assert told in run_optimised(script, level=HASTY, cwd=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(made)
