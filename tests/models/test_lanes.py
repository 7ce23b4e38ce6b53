"""Theories with functions in lanes: the same as on one case, where a library does products."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._models.contract.damping_data import Drag
from jaxbeam._numerics.linalg import dense
from jaxbeam._programs.lanes import LARGE, in_kernel
from jaxbeam._rotor.motion import Hub
from tests.beams import AS_BUILT, short
from tests.helpers import name
from tests.tiers import slow

BODY = jb.TipBody(0.9, 0.05, 0.02, axial_inertia=0.03, flap_inertia=0.05)
BUILT = [jb.Rotor(short(4e3), 0.4, tip_body=BODY), AS_BUILT]
MODELS = [
    (jb.Hybrid(2, 4, 3), BUILT[0]),
    (jb.VonKarman(18, 2, 2), BUILT[0]),  # sums that are too long to be written out
    slow(jb.Classical(0, 3, 2), BUILT[0]),
    slow(jb.papers.SmallStrainANCF(2), jb.Rotor(short(4e3), 0.4, 0.9)),
    slow(jb.Hybrid(2, 4, 3), BUILT[1]),
]
CASES = 3
DRAG = Drag(jnp.asarray(0.3), jnp.asarray(2e-3))


def _all_of(equations, hub, q, v, force):
    """What steps and the account of energy ask for."""
    rate = jax.jvp(equations.first_moment, (q,), (v,))[1]
    energies = equations.kinetic_energy(q, v, hub.velocity, hub.angular_velocity)
    matrices = *equations.tangents(hub, q, v, force), *equations.damping_tangents(q, v, DRAG)
    return (
        equations.force(hub, q, v, force), equations.damping(q, v, DRAG), rate,
        equations.tip_power(q, v, force), energies, equations.strain_energy(q),
        [dense(a) for a in matrices],
    )  # fmt: skip


@pytest.mark.parametrize(("model", "rotor"), MODELS, ids=name)
def test_equations_in_lanes_are_those_of_each_case(model, rotor):
    rng, n = np.random.default_rng(2), len(model.directions)
    rotors = [
        jb.Rotor(
            rotor.beam, radius, tip_body=rotor.tip_body, root_springs=rotor.root_springs,
            pitch=rotor.pitch,
        )
        for radius in (0.1, 0.4, 1.3)
    ]  # fmt: skip
    # Axial displacement is of second order.
    size = np.where([d == jb.models.Direction.AXIAL for d in model.directions], 1e-3, 3e-2)[:, None]
    q, v = (jnp.asarray(size * rng.normal(size=(n, CASES))) for _ in range(2))
    hub = Hub(*(jnp.asarray(rng.normal(size=(3, CASES))) for _ in range(5)))
    force = jnp.asarray(rng.normal(size=(3, CASES)))
    equations_of = eqx.filter_jit(model.equations)
    each = [equations_of(r) for r in rotors]
    # What lanes share has lanes of length one: here all but what the radius changes.
    kernels = [e.kernel for e in each]
    lanes = jax.tree.map(
        lambda *a: jnp.stack(a, -1) if any((b != a[0]).any() for b in a) else a[0][..., None],
        *kernels,
    )

    @jax.jit
    def together(*args):
        with in_kernel(), jax.numpy_rank_promotion("allow"):
            return _all_of(*args)

    found = together(lanes, hub, q, v, force)
    one = jax.jit(_all_of)
    for i, equations in enumerate(each):
        case = jax.tree.map(lambda a, i=i: a[..., i], (hub, q, v, force))
        alone = one(equations, *case)
        for own, expected in zip(jax.tree.leaves(found), jax.tree.leaves(alone), strict=True):
            own = np.broadcast_to(own, (*own.shape[:-1], CASES))[..., i]
            scale = np.abs(np.asarray(expected)).max() + 1e-30
            np.testing.assert_allclose(own, expected, rtol=1e-10, atol=1e-12 * scale)


def test_what_is_not_known_to_take_lanes_or_is_large_is_not_a_kernel():
    rotor = BUILT[0]
    assert jb.Hybrid(0, LARGE, 0).equations(rotor).kernel is not None
    assert jb.Hybrid(0, LARGE + 1, 0).equations(rotor).kernel is None
    equations = jb.Hybrid(0, 2, 0).equations(rotor)

    class Other(type(equations)):
        pass

    class Soft(type(equations.elasticity)):
        pass

    other = object.__new__(Other)
    other.__dict__.update(equations.__dict__)
    assert other.kernel is None
    soft = Soft(equations.elasticity.stiffness)
    assert eqx.tree_at(lambda e: e.elasticity, equations, soft).kernel is None
