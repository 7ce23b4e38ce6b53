"""What functions leave out of frequencies of uniform beams, by what the next ones would add."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._modes.search import MANY
from jaxbeam.models import Polynomials
from tests.references import power_series

BEAM = jb.Beam(1.0, 1.0, 1e6, 1.0, 2.0)


def estimates(model, many, rotor, speed, labels):
    """Errors of frequencies against those of a model with many functions, and their estimates."""

    @jax.jit
    def found(rotor, speed):
        few, true = (jb.modes(m, rotor, speed, labels, throw=False) for m in (model, many))
        return few.frequency / true.frequency - 1, few.frequency_error

    return [np.asarray(a) for a in found(rotor, speed)]


def is_right(error, estimate, least=1e-11):
    """Between a third of the error and three times it, where it is more than rounding."""
    told = np.abs(error) > least
    assert told.any()
    assert (estimate[told] > np.abs(error[told]) / 3).all()
    assert (estimate[told] < 3 * np.abs(error[told])).all()
    assert (estimate[~told] < 3 * least).all()


def test_against_power_series():
    """Thin layers at the root: flap at gamma = 100, errors of 1e-7 to 4e-6."""
    found = jb.modes(jb.Hybrid(0, 0, 16), jb.Rotor(BEAM, 0.05), 100 * 2**0.5, jb.labels(flap=3))
    exact = 2**0.5 * np.array(power_series.frequencies(100.0, 0.05, plane="flap"))
    is_right(np.asarray(found.frequency) / exact - 1, np.asarray(found.frequency_error))


def test_of_coupled_directions():
    """Stretch, which the Coriolis force couples with bending in plane; sections that are turned; a
    body at the tip; errors from 5e-10 to 8e-4."""
    body = jb.TipBody(0.1, offset=0.1, inertia=0.05, axial_inertia=0.01, flap_inertia=0.02)
    rotor = jb.Rotor(BEAM, 0.05, pitch=0.5, tip_body=body)
    labels = jb.labels(in_plane=3, flap=2, axial=2)
    is_right(*estimates(jb.Hybrid(4, 7, 6), jb.Hybrid(8, 12, 12), rotor, 5.0, labels))


def test_of_sections_turned_far():
    """Stiffness in common, 100 to 1 and at 45 degrees: errors from 4e-8 to 3e-2."""
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e6, 100.0, 1.0), pitch=np.pi / 4)
    is_right(*estimates(jb.Hybrid(0, 5, 5), jb.Hybrid(0, 12, 12), rotor, 0.0, 4))


SPRINGS = jb.RootSprings(in_plane=5.0, flap=0.0)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("model", "rotor", "speed", "labels"),
    [
        (jb.Hybrid(4, 6, 6), jb.Rotor(BEAM, 0.5, 0.1, root_springs=SPRINGS), 5.0, (3, 2, 2)),
        (jb.Hybrid(0, 7, 6), jb.Rotor(BEAM, 0.1, 0.1, 0.5, SPRINGS), 10.0, (4, 3, 0)),
        (jb.Hybrid(0, 8, 8, Polynomials(grading=2)), jb.Rotor(BEAM, 0.05), 30.0, (4, 3, 0)),
        (jb.Hybrid(12, 4, 4), jb.Rotor(BEAM, 0.05, 0.1), 5.0, (3, 2, 0)),
        (jb.Hybrid(3, 8, 0), jb.Rotor(jb.Beam(1.0, 1.0, 400.0, 1.0, 1.0), 0.05), 2.5, (4, 0, 1)),
        (jb.Classical(4, 6, 6), jb.Rotor(BEAM, 0.05, 0.1), 1.5, (4, 2, 2)),
    ],
    ids=["springs", "turned on springs", "grading", "much stretch", "soft", "classical"],
)
def test_of_many_kinds(model, rotor, speed, labels):
    """Errors from 1e-9 to 3e-2."""
    many = dataclasses.replace(model, n_stretch=30 * (model.n_stretch > 0), n_in_plane=30,
                               n_flap=30 * (model.n_flap > 0))  # fmt: skip
    in_plane, flap, axial = labels
    named = jb.labels(in_plane=in_plane, flap=flap, axial=axial)
    is_right(*estimates(model, many, rotor, speed, named), least=1e-9)


@pytest.mark.parametrize("count", [1, MANY])
def test_of_nearly_the_default(count):
    """By bands, alone and in a batch: a thin layer at the root, an error of 1e-4, which the default
    numbers of functions would make a failure."""

    model = jb.Hybrid(10, 15, 16)

    @jax.jit
    def found(speeds):
        return jax.vmap(
            lambda speed: jb.modes(model, jb.Rotor(BEAM, 0.05), speed, jb.labels(in_plane=1))
        )(speeds)

    many = found(np.full(count, 100.0))
    exact = power_series.frequencies(100.0, 0.05, 0.0, 1e3)
    is_right(np.asarray(many.frequency[-1]) / exact[:1] - 1, np.asarray(many.frequency_error[-1]))


class Stiffer(jb.Hybrid):
    """A theory with a term that nobody knows of."""

    def linear_stiffness(self, rotor, shapes):
        return 2 * super().linear_stiffness(rotor, shapes)


def test_where_nothing_is_said():
    """Of derived theories; of functions that are no polynomials; of one function; of few beside a
    root that yields."""
    clamped, hinged = jb.Rotor(BEAM), jb.Rotor(BEAM, root_springs=jb.RootSprings(in_plane=5.0))
    for model, rotor in (
        (Stiffer(0, 4, 0), clamped),
        (jb.Hybrid(0, 4, 0, jb.models.CantileverModes()), clamped),
        (jb.Hybrid(0, 1, 0), clamped),
        (jb.Hybrid(0, 1, 0), hinged),
        (jb.Hybrid(0, 4, 0), hinged),
    ):
        assert jb.modes(model, rotor, 1.0, 1).frequency_error is None
