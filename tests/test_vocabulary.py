"""One word, one meaning: words that had several are no identifiers any more."""

import io
import tokenize

import pytest

import jaxbeam as jb
from tests.package import MODULES

# What takes their place is in the glossary of jaxbeam/README.md.
RETIRED = {
    "turn", "turned", "turning", "TURN", "known", "is_known", "where_known", "reach", "tabled",
    "family", "families", "Family", "planes_of", "stoutness", "law_effect", "left_of", "deviation",
    "freedom", "struck", "Course", "LOST", "Watch", "march", "Task", "Given", "EngineeringANCF",
}  # fmt: skip


def test_retired_words_are_not_identifiers():
    found = []
    for name, path in MODULES.items():
        tokens = tokenize.generate_tokens(io.StringIO(path.read_text()).readline)
        words = {token.string for token in tokens if token.type == tokenize.NAME}
        found += [(name, word) for word in sorted(words & RETIRED)]
    assert found == []


def test_an_old_name_says_the_new_one():
    for old, new in jb._RENAMED.items():
        with pytest.raises(AttributeError, match=rf"it is {new} now"):
            getattr(jb, old)


@pytest.mark.parametrize(
    ("make", "old", "new"),
    [
        (jb.Rotor, "root", "root_springs"), (jb.Rotor, "tip", "tip_body"),
        (jb.Damping, "mass", "mass_coefficient"),
        (jb.Damping, "stiffness", "stiffness_coefficient"),
        (jb.results.Simulation.peak, "component", "direction"),
        (jb.deflection_limit, "component", "direction"),
        (jb.ladder.PeakDeflection, "component", "direction"),
        (jb.ladder.DeflectionHistory, "component", "direction"),
        (jb.fitting.StaticData, "component", "direction"),
    ],
)  # fmt: skip
def test_an_old_argument_says_the_new_one(make, old, new):
    with pytest.raises(TypeError, match=f"{old} is {new} now"):
        make(**{old: None})
