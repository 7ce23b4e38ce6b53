"""Turbines in windIO, of both versions."""

import copy
import sys

import numpy as np
import pytest
import yaml

from jaxbeam import blades
from tests.files.made_up import FOLDER, are_the_same, is_the_blade

PATH = FOLDER / "blade_windio.yaml"
TREE = yaml.safe_load(PATH.read_text())
SIX = TREE["components"]["blade"]["elastic_properties_mb"]["six_x_six"]


def second():
    """The blade in the form of version 2, in which an inertia is a mass, its centre and moments."""
    pairs = [(i, j) for i in range(6) for j in range(i, 6)]
    stiff, inert = (np.array(SIX[name]["values"]).T for name in ("stiff_matrix", "inertia_matrix"))
    grid = list(SIX["stiff_matrix"]["grid"])
    at = {pair: inert[n].tolist() for n, pair in enumerate(pairs)}
    mass = np.array(at[0, 0])
    shape = TREE["components"]["blade"]["outer_shape_bem"]
    degrees = np.degrees(shape["twist"]["values"]).tolist()
    blade = {
        "reference_axis": shape["reference_axis"],
        "outer_shape": {"twist": {"grid": shape["twist"]["grid"], "values": degrees}},
        "structure": {
            "elastic_properties": {
                "stiffness_matrix": {
                    "grid": grid,
                    **{f"K{i + 1}{j + 1}": stiff[n].tolist() for n, (i, j) in enumerate(pairs)},
                },
                "inertia_matrix": {
                    "grid": grid,
                    "mass": at[0, 0],
                    "cm_x": (np.array(at[1, 5]) / mass).tolist(),
                    "cm_y": (-np.array(at[0, 5]) / mass).tolist(),
                    "i_edge": at[3, 3],
                    "i_flap": at[4, 4],
                    "i_plr": at[5, 5],
                    "i_cp": (-np.array(at[3, 4])).tolist(),
                },
                "structural_damping": {"mu": [1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3]},
                "point_mass": {"grid": [0.0, 0.3, 1.0], "mass": [7.0, 5.0, 2.0]},
            }
        },
    }
    return {"windIO_version": "2.0", "components": {"blade": blade}}


def test_a_blade_of_windio_is_that_of_beamdyn():
    blade = blades.read_blade(PATH).beam
    is_the_blade(blade)
    are_the_same(blade, blades.read_beamdyn(FOLDER / "primary_beamdyn.inp").beam)


def test_a_blade_of_version_2(tmp_path):
    path = tmp_path / "turbine.yaml"
    path.write_text(yaml.safe_dump(second()))
    table = blades.read_blade(path)
    first = blades.read_windio(TREE)
    are_the_same(table.beam, first.beam, 2e-12)
    assert table.damping == (3e-3, 2e-3, 1e-3, 6e-3, 5e-3, 4e-3)
    assert first.damping is None
    assert table.tip_mass == 2.0
    assert table.beam.point_masses.places == (0.3,)
    np.testing.assert_array_equal(table.beam.point_masses.masses, [5.0])
    assert table.rotor(hub_radius=1.0).tip_mass == 2.0


def test_grids_may_differ():
    """Twice as many stations, halfway between the others, of the inertia alone."""
    tree = copy.deepcopy(TREE)
    table = tree["components"]["blade"]["elastic_properties_mb"]["six_x_six"]["inertia_matrix"]
    rows = np.array(table["values"])
    table["grid"] = [0.0, 0.2, 0.4, 0.7, 1.0]
    both = np.insert(rows, [1, 2], (rows[1:] + rows[:-1]) / 2, axis=0)
    table["values"] = both.tolist()
    blade, other = (blades.read_windio(each).beam for each in (tree, TREE))
    assert blade.stations == (0.0, 0.2, 0.4, 0.7, 1.0)
    at = np.array([0.1, 0.3, 0.9])
    for name in ("stiffness_at", "inertia_at"):
        mine, theirs = (getattr(each, name)(at) for each in (blade, other))
        np.testing.assert_allclose(mine, theirs, atol=1e-12 * np.max(theirs))


def test_a_grid_that_is_no_share_of_the_length_is_told():
    tree = copy.deepcopy(TREE)
    axis = tree["components"]["blade"]["elastic_properties_mb"]["six_x_six"]["reference_axis"]
    for name in "xyz":
        axis[name]["grid"] = [0.0, 0.3, 0.5, 0.75, 1.0]
    with pytest.warns(
        UserWarning, match=r"six_x_six/reference_axis: grid is not the share .* 0\.06"
    ):
        blades.read_windio(tree)


def changed(tree, keys, value):
    """The tree with a value, or without its key, below keys from the blade on."""
    tree = copy.deepcopy(tree)
    within = tree["components"]["blade"]
    for key in keys[:-1]:
        within = within[key]
    if value is None:
        del within[keys[-1]]
    else:
        within[keys[-1]] = value
    return tree


MB = "elastic_properties_mb", "six_x_six"
EP = "structure", "elastic_properties"
STIFF, TWIST = (*MB, "stiff_matrix"), (*MB, "twist", "values")
WRONG = {
    "no matrices": (TREE, MB[:1], {}, r"elastic_properties_mb/six_x_six: is missing"),
    "no inertia": (TREE, (*MB, "inertia_matrix"), None, r"six_x_six/inertia_matrix: is missing; "),
    "too few rows": (TREE, (*STIFF, "values"), [[1.0]], r"values: must be a list of 3, got 1"),
    "too few": (TREE, (*STIFF, "values"), [[1.0]] * 3, r"values/station 1: must be a list of 21"),
    "a step": (TREE, (*STIFF, "grid"), [0, 1, 1], r"stiff_matrix/grid: must increase, got 1 aft"),
    "no tip": (TREE, (*STIFF, "grid"), [0, 0.4, 0.9], r"grid: must go from 0 to 1, got 0 to 0\.9"),
    "a text": (TREE, TWIST, ["a", 0, 0, 0, 0], r"twist/values: number 1 is no number, 'a'"),
    "not finite": (TREE, TWIST, [0, "inf", 0, 0, 0], r"values: number 2 must be finite, got inf"),
    "back": (
        TREE, (*MB, "reference_axis", "z", "values"), [0, 3, 2, 5, 10],
        r"reference_axis/z: must increase, got 2 after 3",
    ),
    "no shear": (
        second(), (*EP, "stiffness_matrix", "K11"), None, r"stiffness_matrix/K11: is missing",
    ),
    "no centre": (
        second(), (*EP, "inertia_matrix", "cm_x"), None, r"inertia_matrix/cm_x: is missing",
    ),
    "indefinite": (
        second(), (*EP, "stiffness_matrix", "K16"), [0.0, 1e9, 0.0],
        r"matrices at 0\.4: the stiffness matrix must be positive definite",
    ),
    "no twist": (second(), ("outer_shape", "twist"), None, r"outer_shape/twist: is missing"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_in_windio(what):
    tree, keys, value, said = WRONG[what]
    with pytest.raises(ValueError, match=said):
        blades.read_windio(changed(tree, keys, value))


def test_files_that_cannot_be_read(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"components/wing: is missing; there are blade"):
        blades.read_windio(TREE, component="wing")
    with pytest.raises(ValueError, match=r"says the axis, so no length must be given"):
        blades.read_blade(PATH, length=10.0)
    path = tmp_path / "turbine.yaml"
    path.write_text("components:\n  blade: [1, 2\n")
    with pytest.raises(ValueError, match=r"turbine\.yaml, line 3: not YAML"):
        blades.read_blade(path)
    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(ImportError, match=r'PyYAML: pip install "jaxbeam\[yaml\]", or parse it'):
        blades.read_blade(PATH)
