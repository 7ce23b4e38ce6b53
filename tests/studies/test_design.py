"""Studies of stability and of design: blades, fits, manoeuvres."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.references import blade as blade_reference
from tests.studies.common import rows_of, study


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
def test_loaded_blade(tmp_path):
    """A thrust bends the blade as much as it would a cantilever of its flap stiffness, stiffens its
    first modes, and adds to what twist couples."""
    study("loaded_blade", tmp_path)
    assert (tmp_path / "loaded_blade.png").stat().st_size > 20_000
    rows = rows_of(tmp_path / "thrust.csv")
    tip = [float(row["tip flap (m)"]) for row in rows]
    assert tip[0] < 0 < 7 < tip[-1] - tip[0] < 10
    for name, sign in (("flap 1", 1), ("edge 1", 1), ("edge 2", -1)):
        first, last = (float(row[f"{name} (Hz)"]) for row in (rows[0], rows[-1]))
        assert 0.005 < sign * (last / first - 1) < 0.03
    slopes = {row["mode"]: row for row in rows_of(tmp_path / "slopes.csv")}
    for row in slopes.values():  # frequencies go with the root of stiffness over mass
        given = {name: float(row[name]) for name in row if name != "mode"}
        assert abs(given["mass"] + 0.5) < 0.06
        assert abs(sum(given.values()) - given["speed"] - given["thrust"]) < 0.15
