"""Every parameter is known wherever the physics is stated for speed: bands, forms of gradients and
estimates. Which parameters there are is read from the rotor itself, so that a new one counts."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._models.modal.finer import frequency_error
from jaxbeam._modes.banded import bands_of
from jaxbeam._modes.wanted import choose
from jaxbeam._rotor.directions import Direction
from jaxbeam._rotor.parameters import Parameters
from jaxbeam._status import Status
from tests.beams import AS_BUILT, short
from tests.tiers import exhaustive, slow

SPEED = 4.0
PLAIN = jb.Rotor(short(400.0, polar_inertia=0.03), hub_radius=0.4, tip_mass=0.3)


def scaled(case, shares):
    """A rotor and a speed, each of whose numbers is larger by its share."""
    leaves, tree = jax.tree.flatten(case)
    assert len(leaves) == len(shares)
    return jax.tree.unflatten(tree, [a * (1 + s) for a, s in zip(leaves, shares, strict=True)])


def numbers(rotor):
    """The case, names of its numbers, and a share of zero of each."""
    case = rotor, jnp.asarray(SPEED)
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(case)]
    return case, names, jnp.zeros(len(names))


def of_matrices(model, rotor, speed, x):
    """x^T S M x, x^T S G x and x^T S K x."""
    system = model.matrices(rotor, speed)
    signs = np.where(np.array(system.directions) == Direction.AXIAL, -1.0, 1.0)
    every = system.mass, system.gyroscopic, system.stiffness
    return jnp.stack([jnp.sum(signs[None] * x * (x @ a.T), 1) for a in every])


def check(found, right, names, unknown):
    """Derivatives of forms (3, k, numbers): the same, and each number has a part in them."""
    size = np.max(np.abs(right), (1, 2), keepdims=True)
    np.testing.assert_allclose(found / np.maximum(size, 1e-9), right / np.maximum(size, 1e-9),
                               atol=1e-9)  # fmt: skip
    idle = {n for n, each in zip(names, np.moveaxis(right, 2, 0), strict=True) if not each.any()}
    assert idle == {n for n in names if any(word in n for word in unknown)}


def optional(part, where=""):
    """Names of all parameters that may be None, and whether they are."""
    for field in dataclasses.fields(part):
        value = getattr(part, field.name)
        if field.default is None:
            yield where + field.name, value is None
        if isinstance(value, Parameters):
            yield from optional(value, f"{where}{field.name}.")


def test_all_that_modal_models_know_is_there():
    """Else the tests below would know nothing of it."""
    lacking = {name for name, is_none in optional(AS_BUILT) if is_none}
    assert not lacking & jb.Hybrid.supports


@pytest.mark.slow
def test_forms_of_beams_that_vary():
    """By integrals of shapes, and by matrices."""
    model = jb.Hybrid(0, 4, 4).suited(AS_BUILT)
    case, names, shares = numbers(AS_BUILT)
    x = jnp.asarray(np.random.default_rng(1).normal(size=(2, 8)))

    @jax.jit
    def both(shares):
        mixes = model.mixes(model.matrices(*case), AS_BUILT)

        def forms(shares):
            return jnp.stack(model.forms(*scaled(case, shares), x, mixes))

        def matrices(shares):
            return of_matrices(model, *scaled(case, shares), x)

        return [jax.jacfwd(f)(shares) for f in (forms, matrices)]

    # Without stretch its stiffness says nothing but where points of integration are.
    check(*both(shares), names, ["torsional", "axial_stiffness"])


@pytest.mark.parametrize(
    "model",
    [slow(jb.Hybrid(2, 8, 8)), exhaustive(jb.PlanarRod(2))],
    ids=lambda model: type(model).__name__,
)
def test_forms_of_bands(model):
    case, names, shares = numbers(PLAIN)
    bands = bands_of(model, (0, 2, 0, 0), 2)
    x = jnp.asarray(np.random.default_rng(2).normal(size=(2, len(model.directions))) + 0j)

    @jax.jit
    def both(shares):
        state, ok = model.matrices(*case).state, jnp.ones((), bool)

        def forms(shares):
            return jnp.stack(bands.forms(*scaled(case, shares), x, (state, ok)))

        def matrices(shares):
            return of_matrices(model, *scaled(case, shares), x)

        return [jax.jacfwd(lambda s, f=f: f(s).real)(shares) for f in (forms, matrices)]

    planar = Direction.FLAP not in model.directions
    check(*both(shares), names, ["flap", "polar"] if planar else [])


@pytest.mark.exhaustive
def test_modes_by_bands():
    """Frequencies with each number larger by a tenth, and by dense matrices."""
    model, (case, names, shares) = jb.Hybrid(2, 8, 8), numbers(PLAIN)
    wanted = choose(model, jb.labels(in_plane=2, flap=2, axial=1))
    bands = bands_of(model, wanted.most, wanted.count)

    @jax.jit
    def by_bands(shares):
        def one(shares):
            return bands.lowest(*scaled(case, shares), wanted.named).entries.omega

        return jax.vmap(one)(shares)

    @jax.jit
    def dense(shares):
        labels = jb.labels(in_plane=2, flap=2, axial=1)

        def one(shares):
            return jb.modes(model, *scaled(case, shares), labels).frequency

        return jax.vmap(one)(shares)

    each = jnp.concatenate([shares[None], 0.1 * jnp.eye(len(names))])
    found, right = (np.asarray(f(each)) for f in (by_bands, dense))
    np.testing.assert_allclose(found, right, rtol=1e-9)
    assert (np.abs(right[1:] - right[:1]) > 1e-6 * right[:1]).any(1).all()


@pytest.mark.exhaustive
@pytest.mark.parametrize(("few", "many", "rotor"), [((0, 7, 7), (0, 14, 14), AS_BUILT)])
def test_estimates(few, many, rotor):
    """Between a third of the error and three times it: what an estimate does not know of would be
    an error to it."""

    @jax.jit
    def found(rotor):
        near, right = (jb.modes(jb.Hybrid(*n), rotor, SPEED, 4, throw=False) for n in (few, many))
        return near.frequency / right.frequency - 1, near.frequency_error, near.status

    error, estimate, status = found(rotor)
    assert status == Status.OK
    assert (error > 1e-9).any()
    assert (estimate > error / 3).all()
    assert (estimate < 3 * error + 1e-9).all()


@pytest.mark.exhaustive
def test_estimates_of_uniform_beams():
    """What the next functions would add, by their equations and by matrices of more functions,
    which know whatever the model knows: with each number larger by a half."""
    springs, body = (
        jb.RootSprings(in_plane=40.0, flap=25.0),
        jb.TipBody(0.3, 0.1, 0.02, 0.005, 0.03),
    )
    beam = short(400.0, polar_inertia=1.0)  # so much that what does not know it is wrong
    rotor = jb.Rotor(beam, 0.4, root_springs=springs, tip_body=body)
    model = jb.Hybrid(4, 6, 6).suited(rotor)
    case, names, _ = numbers(rotor)

    @jax.jit
    def both(shares):
        def one(shares):
            rotor, speed = scaled(case, shares)
            speed = speed / 4
            found = jb.modes(model, rotor, speed, jb.labels(in_plane=3, flap=3), throw=False)
            by_matrices = frequency_error(model, rotor, speed, found.eigenvalue, found.shape)
            return found.frequency_error, by_matrices

        return jax.vmap(one)(shares)

    found, right = (np.asarray(a) for a in both(0.5 * jnp.eye(len(names))))
    assert (right[:, [2, 5]] > 1e-6).all()
    assert (found > right / 2).all()
    assert (found < right * 2).all()
