"""What tests of studies share."""

import csv
from pathlib import Path

from tests.helpers import run_optimised

STUDIES = Path(__file__).parents[2] / "studies"
HASTY = 1  # level of optimisation of studies, most of whose time is compilation


def study(name, out):
    """What the study prints, made quick."""
    script = STUDIES / f"{name}.py"
    return run_optimised(script, "--quick", "--out", out, level=HASTY)


def rows_of(path):
    with open(path) as file:
        return list(csv.DictReader(file))
