"""Figures: what is drawn, and what cannot be."""

import warnings

import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure

import jaxbeam as jb
from jaxbeam import plot
from jaxbeam.results import Campbell, Modes

BEAM = jb.Beam(8.0, 0.2, 5e6, 500.0, 300.0, torsional_stiffness=400.0, polar_inertia=1e-3)
ROTOR = jb.Rotor(BEAM, 0.5)
XI = np.linspace(0.0, 1.0, 5)


def modes_of(model, *shapes):
    """Modes of these directions and shapes, each with the number 1."""
    k = len(shapes)
    directions, vectors = (jnp.asarray(part) for part in zip(*shapes, strict=True))
    return Modes(
        jnp.ones(k, complex), vectors.astype(complex), directions, jnp.ones(k, int),
        jnp.ones((k, 4)),
        jnp.zeros(k), jnp.asarray(0), jnp.asarray(0.0), None, model, ROTOR,
    )  # fmt: skip


def drawn(found, mode):
    ax = Figure().subplots()
    plot.mode_shape(found, mode, ax, len(XI))
    return ax.lines[0].get_ydata()


@pytest.mark.parametrize("phase", [1, 1j, -1j, 0.6 - 0.8j])
def test_a_mode_is_drawn_in_its_direction_whatever_its_phase(phase):
    """Of coned beams that of flap is imaginary, of others the axial one."""
    model = jb.SpatialRod(2)
    table = np.concatenate([model.displacement(XI, ROTOR), model.torsion(XI, ROTOR)[None]])
    rows = {"axial": 0, "in_plane": 1, "flap": 2, "torsion": 3}
    labels = [jb.labels(**{direction: 1})[0] for direction in rows]
    shapes = [phase * table[row, -1] for row in rows.values()]
    directions = [int(label.direction) for label in labels]
    found = modes_of(model, *zip(directions, shapes, strict=True))
    for row, label in enumerate(labels):
        wanted = table[row] @ table[row, -1]
        assert wanted[-1] > 0
        np.testing.assert_allclose(drawn(found, label), wanted / np.abs(wanted).max(), atol=1e-12)


def test_a_mode_that_is_not_there_is_named():
    model = jb.Hybrid(0, 2, 2)
    (flap,), (torsion,) = jb.labels(flap=1), jb.labels(torsion=1)
    found = modes_of(model, (int(flap.direction), jnp.ones(4, complex)))
    with pytest.raises(ValueError, match=f"mode must be one of those found, {flap}, got {torsion}"):
        drawn(found, torsion)


def test_harmonics_and_names_are_checked_before_anything_is_drawn():
    speeds = np.array([6.0, 0.0])
    dims = {name: ("angular_speed", "mode") for name in ("frequency", "growth_rate")}
    table = jb.Table(
        {"frequency": np.full((2, 1), 20.0), "growth_rate": np.zeros((2, 1)), "status": [0, 0]},
        {**dims, "status": ("angular_speed",)}, {"angular_speed": speeds, "mode": np.array(["1"])},
    )  # fmt: skip
    diagram = Campbell(jb.Hybrid(0, 2, 2), ROTOR, jb.labels(flap=1), table)
    ax = Figure().subplots()
    plot.campbell(diagram, ax, harmonics=np.array([1.0, 2.0]))
    assert [text.get_text() for text in ax.texts] == ["1P", "2P"]
    assert ax.lines[0].get_xdata().tolist() == [0.0, 6.0]  # in whatever order they came
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match="harmonics must be a list of numbers > 0"):
            plot.campbell(diagram, ax, harmonics=[0])
    with pytest.raises(KeyError, match="no values named 'typo'"):
        plot.swept(table, "typo", "")
