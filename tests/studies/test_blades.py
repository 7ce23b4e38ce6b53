"""Studies of blades with full sections: what they print and draw of measured and published ones."""

import numpy as np
import pytest

from tests.studies.common import rows_of, study


@pytest.mark.exhaustive
def test_pazy(tmp_path):
    """Two loads tell the others: deflections to 1 % of the span, to half of which they go, and
    twists to 0.7 degrees as measured, in steps of that, and to 0.3 of the solid model."""
    study("pazy", tmp_path)
    assert (tmp_path / "pazy.png").stat().st_size > 20_000
    rows = rows_of(tmp_path / "pazy.csv")
    apart, most = {}, {}
    for row in rows:
        key = row["source"], row["quantity"]
        gap = abs(float(row["value"]) - float(row["rod"]))
        apart[key] = max(gap, apart.get(key, 0.0))
        most[key] = max(abs(float(row["rod"])), most.get(key, 0.0))
    assert apart["measured", "disp"] < 1.0
    assert apart["measured", "rot"] < 0.7
    assert apart["GFEM_SOL400", "disp"] < 0.5
    assert apart["GFEM_SOL400", "rot"] < 0.3
    assert most["GFEM_SOL400", "disp"] > 50
    assert np.all([abs(float(row["rod"])) > 0.5 for row in rows])


@pytest.mark.exhaustive
def test_campbell_labels(tmp_path):
    """Continuation in small steps is what branches are and what plain tracking finds in nearly all
    blades, and labels go with the motion, once through each veering."""
    printed = study("campbell_labels", tmp_path)
    assert "10 blades; 0 more" in printed
    assert (tmp_path / "campbell_labels.png").stat().st_size > 20_000
    rows = rows_of(tmp_path / "campbell_labels.csv")
    assert len(rows) == 60
    assert not any(int(row["and_the_branch"]) for row in rows)
    assert sum(int(row["and_plain_tracking"]) > 0 for row in rows) <= 2
    assert sum(int(row["turns_of_the_label"]) > 1 for row in rows) <= 3
    assert any(int(row["speeds_at_which_the_label_parts"]) for row in rows)


@pytest.mark.exhaustive
def test_swept_tips(tmp_path):
    """Of the nominal data 24 of 48 frequencies are within 5 % or 0.5 Hz and all within twice that;
    two numbers make it 47, or 45 where the first mode at rest has little weight."""
    printed = study("swept_tips", tmp_path)
    assert (tmp_path / "swept_tips.png").stat().st_size > 20_000
    within = {}
    for row in rows_of(tmp_path / "swept_tips.csv"):
        seen, rod = float(row["measured_hz"]), float(row["rod_hz"])
        gap = abs(seen - rod) / max(0.05 * seen, 0.5)
        within.setdefault(row["data"], []).append(gap)
    counts = {name: sum(gap <= 1 for gap in gaps) for name, gaps in within.items()}
    assert all(len(gaps) == 48 for gaps in within.values())
    assert counts["nominal"] == 24
    assert max(within["nominal"]) <= 2
    assert counts["fitted"] >= 46
    assert counts["fitted by the bound"] >= 45
    assert "stiffness over nominal 1.10" in printed


@pytest.mark.exhaustive
def test_published_blades(tmp_path):
    """Without files it takes one blade in three formats, which are alike."""
    printed = study("published_blades", tmp_path)
    assert (tmp_path / "published_blades.png").stat().st_size > 20_000
    assert "primary_beamdyn.inp: 10." in printed
    by_load = {}
    for row in rows_of(tmp_path / "published_blades.csv"):
        numbers = [float(row[k]) for k in ("edgewise_hz", "deflection_m", "frequency_1_hz")]
        by_load.setdefault(row["load"], []).append(numbers)
    for numbers in by_load.values():
        assert len(numbers) == 3
        np.testing.assert_allclose(numbers[1], numbers[0], rtol=1e-5)
        # What is between stations of HAWC2 is linear in other quantities.
        np.testing.assert_allclose(numbers[2], numbers[0], rtol=2e-3, atol=1e-9)
