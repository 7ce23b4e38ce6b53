"""What is at the tip is one object with a mass: a point, which a number makes, or a body."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import jaxbeam as jb

BEAM = jb.Beam(1.0, 1.0, 1e4, 4.0, 1.0)
POINT, BODY = jb.Rotor(BEAM, 0.1, 0.5), jb.Rotor(BEAM, 0.1, tip_body=jb.TipBody(0.5, 0.2, 0.03))


@pytest.mark.parametrize("rotor", [POINT, BODY], ids=["point", "body"])
def test_its_mass_is_read_and_replaced_in_one_way(rotor):
    assert float(rotor.tip_mass) == float(rotor.tip_body.mass) == 0.5
    heavier = eqx.tree_at(lambda r: r.tip_mass, rotor, jnp.asarray(0.7))
    assert float(heavier.tip_mass) == 0.7
    pitched = dataclasses.replace(heavier, pitch=0.1)
    assert eqx.tree_equal(pitched.tip_body, heavier.tip_body)
    moments = 1.5, 0.1 + 0.5 + 0.5 * float(rotor.tip_mass_radius)
    assert rotor.rigid_moments[:2] == pytest.approx(moments)


def test_a_point_gives_way_to_another_and_to_a_body():
    assert float(dataclasses.replace(POINT, tip_mass=0.7).tip_mass) == 0.7
    assert dataclasses.replace(POINT, tip_body=BODY.tip_body).features == ("tip_body",)
    assert dataclasses.replace(BODY, tip_body=None).is_plain
    assert float(jb.Rotor(BEAM).tip_mass) == 0.0


def test_derivatives_by_its_mass():
    def moment(rotor):
        return rotor.rigid_moments[2]

    assert float(jax.grad(moment)(POINT).tip_mass) == pytest.approx(1.1**2)
    assert float(jax.grad(moment)(BODY).tip_mass) == pytest.approx(1.3**2)
    assert float(jax.grad(lambda m: moment(jb.Rotor(BEAM, 0.1, m)))(0.5)) == pytest.approx(1.1**2)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: jb.Rotor(BEAM, 0.1, 0.5, tip_body=BODY.tip_body), ValueError, "no tip_mass"),
        (lambda: jb.Rotor(BEAM, 0.1, 0.5, tip_body=jb.TipBody(0.1, 0.02)), ValueError, "mass=..."),
        (lambda: dataclasses.replace(BODY, tip_mass=0.3), ValueError, "has a mass of its own"),
        (lambda: jb.TipBody(-1.0), ValueError, "tip_mass must be finite and >= 0"),
        (lambda: jb.Rotor(BEAM, tip_body=0.5), TypeError, "tip_body must be a TipBody, got float"),
    ],
)
def test_what_is_wrong_is_told(make, error, message):
    with pytest.raises(error, match=message):
        make()
