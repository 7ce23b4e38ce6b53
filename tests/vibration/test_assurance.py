"""The modal assurance criterion between shapes, and frequencies in Hz."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam.results import CriticalLoad, Crossing, Modes, StableStep, Tongue

BEAM = jb.Beam(2.0, 3.0, 1e7, 50.0, 20.0, torsional_stiffness=9.0, polar_inertia=0.01)
ROTOR = jb.Rotor(BEAM, 0.1, 0.7)
XI, WEIGHT = (
    f((1 + x) / 2, w / 2) for x, w in [np.polynomial.legendre.leggauss(40)]
    for f in (lambda x, w: x, lambda x, w: w)
)  # fmt: skip


def shaped(model, shape, rotor=ROTOR, direction=2, status=0):
    """Modes of these shapes, (k, n)."""
    shape = jnp.asarray(shape) + 0j
    one = jnp.ones(len(shape))
    return Modes(
        one + 0j, shape, direction * one.astype(int), one.astype(int), one[:, None], one,
        jnp.asarray(status), one[0], model=model, rotor=rotor,
    )  # fmt: skip


def random(count, n, seed):
    made = np.random.default_rng(seed)
    return made.normal(size=(count, n)) + 1j * made.normal(size=(count, n))


def test_it_is_what_the_formula_says():
    """Between different models, of complex shapes, with a mass at the tip and torsion."""
    first = shaped(jb.Hybrid(1, 2, 2), random(3, 5, 1))
    space = jb.SpatialRod(2)
    second = shaped(space, random(2, len(space.directions), 2))
    found = jax.jit(lambda a, b: a.mac(b))(first, second)

    def fields(modes):
        at = np.append(XI, 1.0)
        return np.concatenate(
            [modes.displacement(at), np.asarray(modes.torsion(at))[..., None]], -1
        )

    mass = np.append(3.0 * 2.0 * WEIGHT, 0.7)[:, None] * [1.0, 1.0, 1.0, 0.0]
    mass = mass + np.append(0.01 * WEIGHT / 2.0, 0.0)[:, None] * [0.0, 0.0, 0.0, 1.0]
    u, v = fields(first), fields(second)
    across = np.abs(np.einsum("ipc,jpc,pc->ij", u.conj(), v, mass)) ** 2
    own = [np.einsum("ipc,ipc,pc->i", a.conj(), a, mass).real for a in (u, v)]
    np.testing.assert_allclose(found, across / np.outer(*own), rtol=1e-10)
    np.testing.assert_allclose(jnp.diagonal(first.mac(first)), 1.0, rtol=1e-13)
    turned = shaped(first.model, first.shape * jnp.array([1j, -2.0, 0.3 - 0.4j])[:, None])
    np.testing.assert_allclose(first.mac(turned), first.mac(first), rtol=1e-12)


def test_angles_of_beams_of_other_lengths_are_angles():
    """The same displacements and angles at the same x / L, of a beam three times as long: what it
    does in flap and in torsion goes together as in the first one."""
    model = jb.SpatialRod(2)
    both = random(1, len(model.directions), 6)
    torsion = np.array([way == 3 for way in model.directions])
    longer = jb.Rotor(dataclasses.replace(BEAM, length=6.0), 0.1, 0.7)
    table = [model.displacement(XI, rotor) for rotor in (ROTOR, longer)]
    np.testing.assert_allclose(*table, rtol=1e-12)
    other = shaped(model, both * np.where(torsion, 3.0, 1.0), longer)
    np.testing.assert_allclose(shaped(model, both).mac(other), 1.0, rtol=1e-12)


@pytest.mark.exhaustive
def test_modes_at_rest_are_unlike_one_another_and_like_those_of_other_models():
    @jax.jit
    def both(rotor):
        which = jb.labels(flap=2, in_plane=1, torsion=1)
        space = jb.modes(jb.SpatialRod(4), rotor, 0.0, which)
        return space.mac(space), jb.modes(jb.Hybrid(0, 4, 6), rotor, 0.0, which[:3]).mac(space)

    same, other = both(ROTOR)
    np.testing.assert_allclose(same, np.eye(4), atol=1e-6)
    np.testing.assert_allclose(other, np.eye(4)[:3], atol=1e-3)


def test_batches_and_cases_that_failed():
    model, n = jb.Hybrid(0, 2, 2), 4
    shapes = jnp.asarray(np.stack([random(2, n, seed) for seed in (3, 4)]))
    other = shaped(model, random(3, n, 5))
    status = jnp.array([0, 1])
    many = jax.vmap(lambda x, s: shaped(model, x, status=s))(shapes, status)
    alone = shaped(model, shapes[0])

    @jax.jit
    def asked():
        batches = many.mac(other), other.mac(many), many.mac(many)
        return batches, (alone.mac(other), other.mac(alone), alone.mac(alone))

    for found, wanted in zip(*asked(), strict=True):
        np.testing.assert_allclose(found[0], wanted, rtol=1e-12, atol=1e-15)
        assert np.isnan(found[1]).all()
    three = jax.vmap(lambda x: shaped(model, x))(jnp.concatenate([shapes, shapes[:1]]))
    with pytest.raises(ValueError, match=r"same axes, got \(2,\) and \(3,\)"):
        many.mac(three)
    with pytest.raises(TypeError, match="other must be a Modes, got Rotor"):
        many.mac(ROTOR)
    springs = jb.papers.SpringRotor(1.0, 1.0, 0.0, 1e4, 10.0)
    discrete = shaped(jb.papers.DiscreteNC(), np.eye(2), springs)
    same = jax.jit(lambda: discrete.mac(discrete))()
    np.testing.assert_allclose(same, np.eye(2), atol=1e-15)
    with pytest.raises(ValueError, match="same kind of rotor"):
        discrete.mac(other)


def test_frequencies_in_hertz():
    """Of all that has a frequency."""
    two, ok = jnp.array([2.0, 4.0]) * jnp.pi, jnp.zeros((), int)
    modes = shaped(jb.Hybrid(0, 2, 0), np.eye(2))
    modes = Modes(**{**vars(modes), "eigenvalue": 1j * two})
    for found, hertz in (
        (modes, [1.0, 2.0]),
        (Crossing(jb.labels(flap=1)[0], 2.0, -jnp.pi, ok), 1.0),
        (CriticalLoad(two[0], ok, two, two[1], ok), 2.0),
        (Tongue(two, jnp.stack([two, two]), two, two[0], ok), [[1.0, 2.0]] * 2),
        (StableStep(two[0], two[0], ok), 1.0),
    ):
        np.testing.assert_allclose(found.frequency_hz, hertz, rtol=1e-15)
