"""What tests of simulations share: one run of each kind, and how tightly it is integrated."""

import diffrax
import pytest

import jaxbeam as jb
from tests.beams import SPRINGS, short
from tests.helpers import name
from tests.tiers import exhaustive, slow

BLADE = short()
ROTOR = jb.Rotor(BLADE, hub_radius=0.4, tip_mass=0.3)
TIGHT = diffrax.PIDController(rtol=1e-9, atol=1e-11)
# What runs have in common, whatever the theory: one for each kind of equations that there is, with
# polynomials and by elements, with an energy and without, with masses that vary.
RUNS = [
    (jb.Hybrid(2, 3, 0), ROTOR),
    (jb.PlanarRod(2), ROTOR),
    (jb.papers.ANCF(2), ROTOR),
    (jb.papers.DiscreteNP(), SPRINGS),
]


def each_kind(test):
    """Slow on one model, exhaustive on the others."""
    rest = [slow(*RUNS[0]), *(exhaustive(*case) for case in RUNS[1:])]
    return pytest.mark.parametrize(("model", "rotor"), rest, ids=name)(test)
