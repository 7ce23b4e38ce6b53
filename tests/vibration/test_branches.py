"""Branches of Campbell diagrams: against continuation in small steps, and where there are none."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import jaxbeam as jb

MODEL = jb.Hybrid(0, 3, 3)
LABELS = jb.labels(in_plane=2, flap=2)


def rotor(pitch=None, **more):
    beam = jb.Beam(1.0, 1.0, 4e3, 1.1, 1.0)
    return jb.Rotor(beam, 0.2, pitch=pitch, **more)


@functools.cache
def diagram(pitch):
    return jb.campbell(MODEL, rotor(pitch), np.linspace(0, 4.0, 9), LABELS)


def continued(model, scene, speeds, steps):
    """Frequencies of the lowest four modes, each the most alike to itself a small step before, by
    dense eigenproblems."""
    every = np.linspace(speeds[0], speeds[-1], (len(speeds) - 1) * steps + 1)
    suited = model.suited(scene)
    made = jax.jit(jax.vmap(lambda speed: suited.linearise(scene, speed)))(jnp.asarray(every))
    matrices = [np.asarray(a) for a in (made.mass, made.gyroscopic, made.stiffness)]
    out, before = [], None
    for mass, gyroscopic, stiffness in zip(*matrices, strict=True):
        n = len(mass)
        first = np.block([[-gyroscopic, -stiffness], [np.eye(n), np.zeros((n, n))]])
        lam, shape = scipy.linalg.eig(first, scipy.linalg.block_diag(mass, np.eye(n)))
        pick = np.flatnonzero(lam.imag > 0)
        pick = pick[np.argsort(lam[pick].imag)]
        shape = (np.linalg.cholesky(mass).T @ shape[n:, pick]).T
        shape = shape / np.linalg.norm(shape, axis=1)[:, None]
        alike = np.eye(n)[:4] if before is None else np.abs(before.conj() @ shape.T) ** 2
        own = np.argmax(alike, 1)
        assert len(set(own)) == 4
        assert np.max(alike, 1).min() > 0.9
        before = shape[own]
        out.append(lam[pick][own].imag)
    return np.stack(out[::steps])


def test_branches_are_those_of_continuation():
    """Of a pitched beam, whose labels go to other branches in a veering, by few speeds."""
    labelled = diagram(0.05)
    found = labelled.branches()
    assert np.all(found["status"] == jb.Status.OK)
    expected = continued(
        labelled.model, labelled.rotor, labelled.table.coords["angular_speed"], 100
    )
    order = [["f", "i"].index(str(label)[0]) + 2 * (label.number - 1) for label in LABELS]
    np.testing.assert_allclose(found["frequency"], expected[:, order], rtol=1e-12)
    assert np.abs(found["frequency"] / labelled.frequency - 1).max() > 0.02


def test_branches_cross_where_nothing_couples_them():
    """Flap with bending in plane, of a beam whose sections are not turned: as labels do."""
    labelled = diagram(None)
    frequency = labelled.branches()["frequency"]
    np.testing.assert_array_equal(frequency, labelled.frequency)
    ahead = frequency[:, 0] > frequency[:, 2]
    assert ahead[0]
    assert not ahead[-1]


def test_where_order_says_nothing():
    turning = jb.Loads(tip_force=[0.1, 0, 0], follows=True)
    for more in ({"damping": jb.Damping(mass_coefficient=0.1)}, {"loads": turning}):
        with pytest.raises(ValueError, match="order of frequencies"):
            dataclasses.replace(diagram(0.05), **more).branches()


@pytest.mark.exhaustive
def test_where_there_are_no_branches():
    fast = jb.campbell(jb.Classical(0, 3, 3), rotor(), [0.0, 3.0, 60.0], LABELS).branches()
    lost = fast["status"] == jb.Status.NO_EQUILIBRIUM
    np.testing.assert_array_equal(lost, [False, False, True])
    np.testing.assert_array_equal(np.isnan(fast["frequency"]).all(1), lost)


@pytest.mark.exhaustive
def test_a_hinge_that_is_free_at_rest():
    springs = jb.RootSprings(in_plane=0.0)
    hinged = jb.campbell(MODEL, rotor(root_springs=springs), [2.0, 0.0, 1.0], jb.labels(in_plane=2))
    found = hinged.branches()
    assert np.all(found["status"] == jb.Status.OK)
    np.testing.assert_array_equal(found["frequency"], hinged.frequency)
