"""Numbers that are masked, by `numpy.ma` or by pandas, are refused or taken as not measured."""

import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam.fitting import StaticData
from jaxbeam.motions import TabulatedSpeed

MASKED = np.ma.array([1.0, 2.0, 3.0], mask=[False, True, False])
WHOLE = np.ma.array([1.0, 2.0, 3.0])
PLAIN = [1.0, 2.0, 3.0]
MODEL, BEAM = jb.Hybrid(0, 2, 0), jb.Beam.from_slenderness(70.0)
ROTOR = jb.Rotor(BEAM)
TAKERS = {
    "values": lambda given: jb.Spanwise([0.0, 0.5, 1.0], given).values,
    "stations": lambda given: jb.Spanwise((given - 1) / 2, PLAIN).stations,
    "times": lambda given: TabulatedSpeed(given, PLAIN).times,
    "speeds": lambda given: TabulatedSpeed(PLAIN, given).pieces,
    "a": lambda given: jb.points(a=given).columns["a"],
    "b": lambda given: jb.grid(b=given).columns["b"],
    "angular_speed": lambda given: jb.FrequencyData(MODEL, ROTOR, given, [[1.0]] * 3, 1.0),
    "noise": lambda given: jb.FrequencyData(MODEL, ROTOR, PLAIN, [[1.0]] * 3, given[:, None]),
    "tip_force": lambda given: jb.Loads(tip_force=given).tip_force,
    "length": lambda given: jb.Beam(given[1], 1.0, 1.0, 1.0, 1.0).length,
    "hub_radius": lambda given: jb.Rotor(BEAM, given[1]).hub_radius,
    "gravity": lambda given: jb.Loads(gravity=list(given)).gravity,
}


@pytest.mark.parametrize("name", TAKERS)
def test_masked_numbers_are_refused_by_name(name):
    with pytest.raises(ValueError, match=f"^{name} must not have masked numbers: leave them out"):
        TAKERS[name](MASKED)
    TAKERS[name](WHOLE)


def test_masked_measurements_were_not_made():
    column = MASKED[:, None]
    for given in (column, list(column), [[1], [np.ma.masked], [3]]):
        data = jb.FrequencyData(MODEL, ROTOR, PLAIN, given, 1.0)
        np.testing.assert_array_equal(data.measured, [[1.0], [np.nan], [3.0]])
        np.testing.assert_array_equal(data.present, [[True], [False], [True]])
    at_rest = StaticData(
        MODEL, ROTOR, jb.Loads(tip_force=[0.0, 1.0, 0.0]), MASKED, 1.0, [0, 0.5, 1]
    )
    np.testing.assert_array_equal(at_rest.measured, [1.0, np.nan, 3.0])


def test_numbers_of_pandas_that_may_be_missing():
    pd = pytest.importorskip("pandas")
    whole = pd.Series([1, 2, 3], dtype="Int64")
    missing = pd.Series([1.0, None, 3.0], dtype="Float64")
    np.testing.assert_array_equal(jb.Spanwise([0, 0.5, 1], whole).values, PLAIN)
    np.testing.assert_array_equal(jb.points(a=whole).columns["a"], PLAIN)
    with pytest.raises(ValueError, match="times must be finite"):
        TabulatedSpeed(missing, PLAIN)
    at_rest = StaticData(
        MODEL, ROTOR, jb.Loads(tip_force=[0.0, 1.0, 0.0]), missing, 1.0, [0, 0.5, 1]
    )
    np.testing.assert_array_equal(at_rest.measured, [1.0, np.nan, 3.0])
