"""What a model does not know is refused, by name and before anything is compiled."""

import dataclasses
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam import SpatialRod
from jaxbeam._models.contract.supports import _REFUSED, RATIOS, borne, unsupported
from jaxbeam._rotor.parameters import optional
from tests.helpers import DISCRETE, ELEMENTS

BEAM = jb.Beam(1.0, 1.0, 1e4, 16.0, 1.0)
TWISTING = jb.Beam(1.0, 1.0, 1e4, 16.0, 1.0, torsional_stiffness=3.0)
VARYING = jb.Beam(1.0, jb.Spanwise([0.0, 1.0], [1.0, 0.9]), 1e4, 16.0, 1.0, torsional_stiffness=3.0)
HAVING = {  # a rotor and loads with each of the features, and what goes before it
    "spanwise": (jb.Rotor(VARYING), {}),
    "beam.point_masses": (
        jb.Rotor(dataclasses.replace(TWISTING, point_masses=jb.PointMasses([0.5], [0.1]))),
        {},
    ),
    "beam.twist": (jb.Rotor(jb.Beam(1.0, 1.0, 1e4, 16.0, 1.0, 0.1, 3.0)), {}),
    "pitch": (jb.Rotor(TWISTING, pitch=0.0), {}),
    "precone": (jb.Rotor(TWISTING, precone=0.0), {}),
    "precone beside": (jb.Rotor(TWISTING, precone=0.1, pitch=0.1), {}),
    "root_springs.in_plane": (jb.Rotor(TWISTING, root_springs=jb.RootSprings(0.0)), {}),
    "root_springs.flap": (jb.Rotor(TWISTING, root_springs=jb.RootSprings(flap=1.0)), {}),
    "root_support": (jb.Rotor(TWISTING, root_support=jb.blades.Support()), {}),
    "tip_support": (jb.Rotor(TWISTING, tip_support=jb.blades.Support(0.0)), {}),
    "tip_body": (jb.Rotor(TWISTING, tip_body=jb.TipBody(0.1)), {}),
    "tip_body.flap_inertia": (
        jb.Rotor(TWISTING, tip_body=jb.TipBody(0.1, flap_inertia=0.0)),
        {},
    ),
    "tip_body.centre_of_mass": (
        jb.Rotor(TWISTING, tip_body=jb.blades.RigidBody(0.1, [0.1, 0.2, 0], np.eye(3))),
        {},
    ),
    "loads.tip_moment": (jb.Rotor(TWISTING), {"tip_moment": [0, 0, 1.0]}),
    "loads.follows": (jb.Rotor(TWISTING), {"tip_force": [0, 1.0, 0], "follows": True}),
    "loads.force_per_length": (jb.Rotor(TWISTING), {"force_per_length": [0, 1.0, 0]}),
    "loads.point_forces": (
        jb.Rotor(TWISTING),
        {"point_forces": jb.PointForces([0.5], [[0, 1.0, 0]])},
    ),
}
DAMPERS = {"damping.in_plane_damper", "damping.flap_damper"}
SUPPORTED = {"root_support", "tip_support", "damping.root_dampers", "damping.tip_dampers"}
HAVING |= {
    feature: (jb.Rotor(TWISTING), {}, jb.Damping(**{feature.removeprefix("damping."): 0.0}))
    for feature in RATIOS | DAMPERS
} | {
    feature: (jb.Rotor(TWISTING), {}, jb.Damping(**{feature.removeprefix("damping."): [0.0] * 6}))
    for feature in SUPPORTED if feature.startswith("damping")
}  # fmt: skip
HAVING["damping.section_coefficients"] = (
    jb.Rotor(TWISTING), {}, jb.Damping(section_coefficients=[0.1] * 6)
)  # fmt: skip
MODELS = [jb.Hybrid, jb.Classical, jb.VonKarman, *{type(m): 0 for m in ELEMENTS},
          jb.papers.SmallStrainANCF, SpatialRod]  # fmt: skip


def refused_by(model, feature, moving=True):
    rotor, loads, *damping = HAVING[feature]
    return unsupported(model, rotor, jb.Loads(**loads), *damping, moving=moving)


def test_what_is_refused_is_named_with_models_that_know_it():
    for feature in HAVING:
        why = refused_by(jb.models.AbstractModel, feature)
        assert why.startswith(feature.split(".")[0]), why
    for feature, (_, advice) in _REFUSED.items():
        for named in re.findall(r"Hybrid|\w+ANCF|\w+Rod", advice):
            assert feature in borne(getattr(jb, named), moving=False), (feature, named)


def test_the_door_is_shut():
    """At once, where compiling would take its time; and at the equations, which have doors too."""
    coned, pitched = (HAVING[feature][0] for feature in ("precone", "pitch"))
    for ask in (
        lambda: jb.modes(jb.PlanarRod(2), pitched, 1.0, 1),
        lambda: jb.PlanarRod(2).equations(pitched),
        lambda: jb.critical_speed(jb.papers.ANCF(2), pitched),
    ):
        with pytest.raises(ValueError, match=r"^pitch: \w+ has no turned sections: take"):
            ask()
    with pytest.raises(ValueError, match=r"^precone: Hybrid has no motion of a coned beam: take"):
        jb.Hybrid(0, 2, 2).equations(coned)
    with pytest.raises(ValueError, match=r"^beam\.torsional_stiffness: SpatialRod needs it"):
        jb.simulate(jb.SpatialRod(2), jb.Rotor(BEAM), jb.ConstantSpeed(1.0), [0.0, 1.0])


class _Plain(jb.Hybrid):
    """Says nothing of cones."""


class _Coned(jb.Hybrid):
    """Says that cones are its own affair."""

    supports_in_matrices = frozenset({"precone"})


def test_what_derives_from_hybrid_has_to_declare_cones():
    rotor = jb.Rotor(BEAM, 0.1, precone=0.1)
    for refused in (
        lambda: jb.modes(_Plain(0, 3, 3), rotor, 2.0, 1),
        lambda: _Plain(0, 3, 3).matrices(rotor, jnp.asarray(2.0)),
    ):
        with pytest.raises(ValueError, match="precone: _Plain has no motion of a coned beam"):
            refused()
    found = jax.eval_shape(lambda speed: _Coned(0, 2, 2).matrices(rotor, speed), 2.0)
    assert found.stiffness.shape == (4, 4)


class _Founded(jb.Rotor):
    """A rotor with a parameter more, of which no model knows."""

    foundation: jnp.ndarray | None = optional(jb.Status.INVALID_ROOT_SPRINGS)

    def __init__(self, beam, foundation):
        names = [field.name for field in dataclasses.fields(self)]
        given = {"beam": beam, "hub_radius": 0.0, "foundation": foundation}
        given |= {"tip_body": jb.Rotor(beam).tip_body}
        self._take({**dict.fromkeys(names), **given})


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_a_parameter_that_a_model_does_not_declare_is_refused(model):
    assert unsupported(model, _Founded(TWISTING, None)) == ""
    why = unsupported(model, _Founded(TWISTING, 3.0))
    assert why == f"foundation: {model.__name__} has no such thing: leave it out"


def test_discrete_models_declare_nothing():
    assert all(not model.supports for model in DISCRETE)
