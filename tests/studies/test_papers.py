"""Studies of both papers and of published numbers: they write where they are told, and print what
the tests stand behind."""

import csv
import re

import numpy as np
import pytest

from tests.helpers import run_optimised
from tests.studies.common import HASTY, STUDIES, rows_of, study
from tests.tiers import exhaustive, slow


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
    assert len(paths) == 27
    for path in paths:
        text = path.read_text()
        assert "def main(quick: bool" in text
        # Which knows --quick and --out.
        assert re.search(r"^ +common\.run\(\s*main, __doc__, ", text, re.M), path.name


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
def test_spin_up_film(tmp_path):
    study("spin_up_film", tmp_path)
    assert any(path.suffix == ".gif" for path in tmp_path.iterdir())
    assert any(path.suffix == ".png" for path in tmp_path.iterdir())


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
@pytest.mark.parametrize(
    ("name", "made", "told"),
    [
        ("campbell", ["campbell.png"], "in-plane bending 1 meets 1 per turn at 3.0427"),
        ("sweep", ["frequencies.csv"], "39 of 195 cases failed; the first says: tip_mass must be"),
        ("spin_ups", [], "  4.0   -0.6759"),
        ("fit", [], "reduced chi squared"),
        slow("critical_speeds", ["critical_speeds.csv", "critical_speeds.png"], "slowest: 16.1531"),
    ],
)
def test_templates(name, made, told, tmp_path):
    """Scripts to be copied are short, and run where they are."""
    script = STUDIES / "short" / f"{name}.py"
    assert len(script.read_text().splitlines()) <= 40
    assert told in run_optimised(script, level=HASTY, cwd=tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(made)
