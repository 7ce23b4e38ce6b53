"""Theories of one's own stand on the ladder: it asks a model, and knows none by name."""

import inspect
import re

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import jaxbeam as jb
from jaxbeam._ladder import choice, choose, pool, questions, rungs, sweep
from jaxbeam._models.contract.supports import Neglects
from tests.helpers import DISCRETE, ELEMENTS, SPRINGS, slender

BENDING = jb.ladder.ModalFrequencies(1.0, jb.labels(in_plane=2))


class _Thinned(jb.Hybrid):
    """Half of the tension is left out, which nobody is told but by what follows."""

    neglects = Neglects(stiffening=0.25)

    def equations(self, rotor):
        equations = super().equations(rotor)
        return equations.__class__(**{**vars(equations), "stiffening": equations.stiffening / 2})


class _Same(jb.Hybrid):
    """What it derives from, under another name."""

    called = "mine"


def test_a_theory_of_ones_own_is_a_rung():
    own = [_Thinned(0, 3, 0), _Same(0, 3, 0), jb.papers.GreenANCF(3)]
    found = jb.ladder.rungs(slender(), BENDING, own)
    names = [rung.name for rung in found]
    assert {"_Thinned, 3 functions", "mine, 3 functions", "GreenANCF, 3 elements"} < {*names}
    assert [rung.cost for rung in found] == sorted(rung.cost for rung in found)
    assert len(found) == len(jb.ladder.rungs(slender(), BENDING)) + 3
    place = names.index("mine, 3 functions")
    assert names.index("hybrid, 2 modes") < place < names.index("hybrid, 4 functions")


def test_what_it_does_not_bear_is_refused():
    rotor = jb.Rotor(jb.Beam(1.0, 1.0, 1e4, 1.0, 1.0, torsional_stiffness=1.0), precone=0.1)
    with pytest.raises(ValueError, match="precone: _Same has no motion of a coned beam"):
        jb.ladder.rungs(rotor, BENDING, [_Same(0, 3, 3)])
    with pytest.raises(TypeError, match="rotor must be a SpringRotor"):
        jb.ladder.rungs(rotor, BENDING, [DISCRETE[0]])
    with pytest.raises(TypeError, match="model must be a model"):
        jb.ladder.rungs(rotor, BENDING, [_Same])


def test_what_it_says_that_it_neglects_rules_it_out():
    some = {"size": 0.0, "slope": 0.0, "steady_strain": 0.0, "rest_frequency": jnp.ones(6)}
    beforehand = jb.ladder.Indicators(
        stiffening_ratio=0.1, excited=np.zeros(6), timoshenko_reduction=jnp.zeros((2, 6)), **some
    )
    assert rungs.ruled_out(_Thinned(0, 3, 0), beforehand, 1e-3) == "stiffening ratio 0.1"
    assert rungs.ruled_out(_Thinned(0, 3, 0), beforehand, 1e-2) == ""
    assert rungs.ruled_out(_Same(0, 3, 0), beforehand, 1e-3) == ""


class _Silent(_Thinned):
    """The same, which says nothing of it: it has to be asked."""

    neglects = Neglects()


@pytest.mark.exhaustive
def test_it_is_chosen_where_it_is_the_cheapest_that_will_do():
    own = [_Thinned(0, 6, 0), _Silent(0, 6, 0), _Same(0, 6, 0)]
    question = jb.ladder.ModalFrequencies(4.0, jb.labels(in_plane=1))
    found = jb.choose_model(slender(1000.0, 0.5, 0.5), question, 1e-4, models=own)
    verdicts = {evidence.rung.name: evidence.verdict for evidence in found.evidence}
    assert verdicts["_Thinned, 6 functions"] == "ruled out: stiffening ratio 7.3"
    assert verdicts["_Silent, 6 functions"] == "misses it"
    assert found.rung.name == "mine, 6 functions"
    assert verdicts["hybrid, 8 functions"] != "meets it"


def test_whether_it_is_linear_is_what_its_equations_say():
    springs = jb.papers.SpringRotor(*len(SPRINGS) * [1.0])
    beams = [*ELEMENTS, jb.Hybrid(2, 2, 0), jb.Classical(2, 2, 0), jb.VonKarman(2, 2, 0)]
    for models, rotor in ((beams, slender()), (DISCRETE, springs)):
        for model in models:
            found = eqx.filter_eval_shape(model.equations, rotor)
            assert model.is_linear == found.is_linear, model


def test_the_ladder_asks_no_model_for_its_class():
    for module in (choice, choose, pool, questions, rungs, sweep):
        text = inspect.getsource(module)
        theories = r"Hybrid|Classical|VonKarman|ANCF|PlanarRod|Yielding"
        assert not re.search(rf"isinstance\([^)]*({theories})", text)
