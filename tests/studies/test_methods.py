"""Studies of cost, accuracy and choice: of integrators, models, sweeps, and of others."""

import csv
import os
import re

import numpy as np
import pytest

from tests.helpers import run_optimised
from tests.studies.common import HASTY, STUDIES, rows_of, study


@pytest.mark.exhaustive
def test_speed_accuracy(tmp_path):
    """Errors are what theory says, failures are told, and what is cheapest is so."""
    printed = study("speed_accuracy", tmp_path)
    for name in ("", "_space", "_frequencies"):
        assert (tmp_path / f"speed_accuracy{name}.png").stat().st_size > 20_000
    rows = rows_of(tmp_path / "speed_accuracy.csv")
    scenes = {r["scene"] for r in rows}
    assert len(scenes) == 6

    def least(scene, model):
        here = [float(r["error"]) for r in rows if (r["scene"], r["model"]) == (scene, model)]
        return min(here)

    for scene in (s for s in scenes if s.startswith("speed 12")):  # 0.9 of the steady strain
        size = "(8, 16, 0)" if scene.endswith("in the plane") else "(8, 16, 16)"
        assert 1e-5 < least(scene, f"Hybrid{size}") < 3e-4
    # What eight elements leave; it moves three quarters of its length in the abrupt one.
    assert 1e-5 < least("B Ref. 21, 4 rad/s, in the plane", "PlanarRod(8)") < 3e-4
    assert least("B Ref. 21, 4 rad/s, out of the plane", "SpatialRod(6)") < 1e-4
    assert least("abrupt: Y Fig. 4, in the plane", "Hybrid(3, 4, 0)") > 0.15
    bad = {(r["scene"], r["status"]) for r in rows if float(r["error"]) == np.inf}
    assert bad == {(r["scene"], r["status"]) for r in rows_of(tmp_path / "failed.csv")}
    assert all(float(r["error"]) == np.inf for r in rows if r["status"] != "OK")
    for row in rows_of(tmp_path / "cheapest.csv"):  # nothing that is good enough costs less
        here = [r for r in rows if r["scene"] == row["scene"]]
        enough = [float(r["alone"]) for r in here if float(r["error"]) <= float(row["error"])]
        assert enough == [] or min(enough) == pytest.approx(float(row["alone_ms"]), rel=1e-12)
    assert (
        len(re.findall(r"^For 1e-0[235] take, of .* alone .*, in batches .*\.$", printed, re.M))
        == 6
    )


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
        "reverse mode over forward run", "a step of Rodas5P, in space", "the next, kept",
    }  # fmt: skip
    assert (tmp_path / "elements.png").stat().st_size > 10_000


@pytest.mark.exhaustive
def test_first_answers():
    """All that the study of costs asks of fresh processes is answered, also what `--quick` leaves
    out."""
    script = "import costs\nfor what in costs.FIRST: exec(costs.script_of(what), {})"
    seconds = run_optimised("-c", script, level=HASTY, cwd=STUDIES).split()
    assert len(seconds) == 18
    assert all(float(s) > 0 for s in seconds)


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
